"""Where a plan begins, what it passes and where it ends, as conditions on the unknowns of nodes."""

import casadi as ca
import numpy as np

from socontrol.mechanics.kinematics import Kinematics
from socontrol.programs.plans.giving import DEAR
from socontrol.programs.postures.posture import goal_rows


class Passages:
    """The moments of a question in its transcription; sizes [n]: what counts as one of each coordinate."""

    def __init__(self, question, transcription, giving, sizes):
        self._question, self._robot, self._giving, self._sizes = question, question.loaded, giving, sizes
        self._transcription, self._program = transcription, transcription.program

    def hold(self, start):
        """Start (q, v, u NaN where it may be any), waypoints and end."""
        q, v, u = start
        t = self._transcription
        t.hold("q", t.node["q"][0], q, q)
        if not self._question.quasi_static:
            t.hold("v", t.node["v"][0], v, v)
        first = t.node["u"][0] if t.continuous else t.lead[0] if t.lead.size else t.point["u"][0, 0]
        for i, value in enumerate(u):
            if np.isfinite(value) and (t.continuous or not self._question.start.is_settled):
                t.hold("u", first[i], value, value)
        for name, k, moment in self._question.moments:
            self._passed(name, k, moment)

    def _passed(self, path, k, moment):
        """What the state at node k has to meet."""
        t, question, robot = self._transcription, self._question, self._robot
        for i, value in question.named("coordinates", moment.coordinates, f"{path}.coordinates").items():
            name = f"{path}.coordinates.{robot.coordinates[i]}"
            self._giving.met(name, robot.coordinate_units[i], t.node["q"][k, i], value, self._sizes[i], k)
        rates = question.rates(moment.rates, f"{path}.rates")
        for i in range(robot.n):
            if (moment.velocity == "rest" or i in rates) and not question.quasi_static:
                value = rates.get(i, 0.0)
                t.hold("v", t.node["v"][k, i], value, value)
        point = (k - 1, -1) if k > 0 else (0, 0)
        if moment.settled and not question.quasi_static:
            t.hold("a", t.point["a"][point], 0.0, 0.0)
        for i, value in question.named("inputs", moment.inputs, f"{path}.inputs").items():
            t.hold("u", t.point["u"][(*point, i)], value, value)
        for name, goal in (moment.goals or {}).items():
            self._goal(f"{path}.goals.{name}", goal, t.node["q"][k : k + 1], k)

    def _goal(self, name, goal, places, k):
        robot, size = self._robot, np.array(goal.scales(self._robot.length))
        target, when = ca.DM(goal.numbers()), [k]

        def miss(q):
            return goal.miss(robot, Kinematics(robot.tree, q), target)

        if goal.weight is not None:
            if not self._giving.gives:
                self._wished(name, goal, places, when, size)
            return
        if self._giving.gives:
            for i, unit in enumerate(goal.units()):
                one = lambda q, i=i: miss(q)[i]  # noqa: E731
                self._giving.rows(name, unit, {"q": places}, one, 0.0, 0.0, float(size[i]), when, DEAR)
        else:
            rows = lambda q: {"rows": miss(q), "scale": size, "units": goal.units()}  # noqa: E731
            self._program.add(name, {"q": places}, rows, when=when)
        if hasattr(goal, "guard"):
            guard = lambda q: {"rows": goal.guard(robot, Kinematics(robot.tree, q), target)}  # noqa: E731
            self._program.add(f"{name}.side", {"q": places}, guard, upper=np.inf, when=when)

    def _wished(self, name, goal, places, when, size):
        """Half the weighted square of how far a goal is away."""
        robot, target, weight = self._robot, ca.DM(goal.numbers()), np.sqrt(goal.weight)

        def squares(q):
            apart = goal_rows(name, goal, "distance", robot, Kinematics(robot.tree, q), target)
            return {"squares": weight * apart / ca.DM(np.resize(size, apart.numel()))}

        self._program.add(name, {"q": places}, squares, when=when)
