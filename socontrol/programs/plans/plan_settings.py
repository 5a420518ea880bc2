"""How a plan is made and looked at: mesh, duration, what is stored, the simulation that checks it."""

from typing import Literal

from socontrol.programs.motions.integrators import Duration
from socontrol.programs.plans.schemes import FIXED, LEAST, MOST_POINTS
from socontrol.quantities import Bad, Count, Flag, PositiveNumber, record

MOST_INTERVALS = 5000


@record(kw_only=True)
class Mesh:
    """`intervals` of the whole motion, in each the `points` of a collocation scheme: radau (order 2 points - 1),
    lobatto (2 points - 2), trapezoidal (2), hermite_simpson (4). inputs: linear or constant in an interval, or the
    polynomial through the points, which is richer and may leave its limits between them. halved: solve again with
    half the intervals, to say what the mesh does to the cost."""

    intervals: Count = 20
    scheme: Literal["radau", "lobatto", "trapezoidal", "hermite_simpson"] = "radau"
    points: Count = 3
    inputs: Literal["linear", "constant", "points"] = "linear"
    halved: Flag = True

    def __post_init__(self):
        if self.intervals > MOST_INTERVALS:
            raise Bad("intervals", f"{self.intervals} intervals; at most {MOST_INTERVALS}")
        if self.inputs == "constant" and self.scheme != "radau":
            raise Bad("inputs", f"'{self.scheme}' has points that belong to two intervals; use 'radau', or linear")
        if self.scheme in FIXED and self.points not in (FIXED[self.scheme], 3):
            raise Bad("points", f"'{self.scheme}' has {FIXED[self.scheme]}; leave this key out, or use lobatto")
        least = LEAST.get(self.scheme, 1)
        if not least <= self.points <= MOST_POINTS:
            raise Bad("points", f"{self.points} points; '{self.scheme}' has {least} to {MOST_POINTS}")


@record(kw_only=True)
class FreeDuration:
    """A duration to be found between `shortest` and `longest`."""

    shortest: Duration
    longest: Duration
    guess: Duration | None = None

    def __post_init__(self):
        if not self.shortest < self.longest:
            raise Bad("longest", f"{self.longest:g} s is not after shortest: {self.shortest:g} s")
        if self.guess is not None and not self.shortest <= self.guess <= self.longest:
            raise Bad("guess", f"{self.guess:g} s is outside [{self.shortest:g}, {self.longest:g}] s")


@record(kw_only=True)
class Outputs:
    """What is stored of a plan: samples `every` so often (default: 200 of the whole)."""

    every: Duration


@record(kw_only=True)
class Replay:
    """The plan is simulated again under its own inputs by another integrator; `tolerance`: of the tip's way off, over
    the robot's length; beyond it the plan is rejected."""

    tolerance: PositiveNumber = 1e-3
    active: Flag = True
