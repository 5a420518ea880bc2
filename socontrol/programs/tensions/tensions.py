"""Problem type `tensions`: which tensions (or pressures) hold a posture, a path of postures, or a motion in time?

A posture is inverse statics of inputs that pull only, a path its waypoints in order or together, a motion inverse
dynamics at every sample, simulated again under the tensions found.
"""

import numpy as np

from socontrol.programs.equilibria.lengths import LengthQuestion
from socontrol.programs.plans.motion_limits import PathLimits
from socontrol.programs.postures.goals import Goal, Path
from socontrol.programs.postures.inverse_statics import InverseSolver, InverseStatics
from socontrol.programs.tensions.compliance import Compliance, braced
from socontrol.programs.tensions.pace import limited
from socontrol.programs.tensions.tension_motion import Motion, driven
from socontrol.programs.tensions.tension_path import followed
from socontrol.programs.tensions.timing import Timing
from socontrol.quantities import Bad, Flag, Number, record

OF_PATHS = ("timing", "together", "smoothness", "limits")


@record(kw_only=True)
class Tensions(InverseStatics, LengthQuestion):
    """Which tensions hold a posture (`goals`), a path (a `path` among them) or a motion (`motion`)? Cables pull only.

    compliance: how the tip gives way, and which of redundant tensions to take. timing: when a path is where; limits:
    rates of inputs and cable lengths on the way; together: all waypoints in one program, with `smoothness` the weight
    of changes of the inputs from one to the next. motion: the path run in time, or coordinates given in time.
    """

    goals: dict[str, Goal] | None = None
    compliance: Compliance | None = None
    timing: Timing | None = None
    limits: PathLimits = PathLimits()
    together: Flag = False
    smoothness: Number = 0.0
    motion: Motion | None = None
    asked = "tensions"

    def __post_init__(self):
        super().__post_init__()
        if not self.robot.m:
            raise Bad("robot", "the robot has no actuators, so there is no tension to find; add `actuators:` to it")
        if self.smoothness < 0:
            raise Bad("smoothness", f"{self.smoothness:g} is negative")
        self._refuse_keys()
        if self.compliance is not None:
            self.compliance.check(self)
        if self.motion is not None:
            self.motion.check(self)

    def refuse_goals(self):
        if self.motion is None or not self.motion.given:
            super().refuse_goals()
        elif self.goals:
            raise Bad("goals", "the motion is given by its coordinates; leave goals out, or the coordinates")

    def _refuse_keys(self):
        """Raise Bad for keys that belong to another kind than this one."""
        plain = {"timing": None, "together": False, "smoothness": 0.0, "limits": PathLimits()}
        wanted = {"posture": ("compliance",), "path": OF_PATHS, "motion": OF_PATHS}[self.kind]
        if self.compliance is not None and "compliance" not in wanted:
            raise Bad("compliance", f"it is asked of a posture, and this is a {self.kind}; leave the key out")
        for key in OF_PATHS:
            if getattr(self, key) != plain[key] and (key not in wanted or not self.has_path):
                raise Bad(key, "it belongs to a path; name a goal of type `path`, or leave the key out")
        if self.kind == "motion" and self.has_path and self.timing is None:
            raise Bad("timing", "missing key 'timing': when is the path where? e.g. {duration: 8 s}")
        if self.smoothness and not self.together:
            raise Bad("smoothness", "it needs `together: true`: in order, waypoints to come are not known")
        if self.has_path and (limited(self) or self.together) and self.sensitivities:
            raise Bad("sensitivities", "they are of a posture alone; leave them out, or the limits and `together`")

    @property
    def has_path(self):
        """Whether one of the goals is a path."""
        return any(isinstance(goal, Path) for goal in (self.goals or {}).values())

    @property
    def kind(self):
        """posture, path or motion."""
        if self.motion is not None:
            return "motion"
        return "path" if self.has_path else "posture"

    def input_limits(self):
        """(lower [m], upper [m]): tendons pull only."""
        lower, upper = super().input_limits()
        for i in np.flatnonzero(self.robot.pulls):
            lower[i] = max(lower[i], 0.0)
            if upper[i] < 0:
                largest = f"its largest tension is {upper[i]:g} N; a cable only pulls"
                raise Bad(f"bounds.inputs.{self.robot.inputs[i]}", largest)
        return lower, upper

    def prepare(self):
        return TensionSolver(self)

    def solve(self, progress=None):
        result = driven(self, progress) if self.kind == "motion" else self.prepare().solve(progress=progress)
        result.details["kind"] = self.kind
        return result


class TensionSolver(InverseSolver):
    """A question of postures made ready: programs built once, solved for changing targets, loads and starts."""

    def solve(self, targets=None, start=None, warm=None, progress=None):
        if self.path:
            return followed(self, progress)
        result = super().solve(targets, start, warm, progress)
        if self.question.compliance is None or not result.status.solved:
            return result
        return braced(self, result)
