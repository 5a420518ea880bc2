"""A posture's program as plain rows, for a solver that eliminates the shape through the equilibrium.

    rows(x, p) = (r, g, side, R),   minimise |R|^2 / 2 + f   subject to   r = 0, g = 0, side >= 0, lower <= x <= upper
with x = (q, u) over their scales: r the balance of forces, g the goals to be met exactly, `side` their guards (an axis
may not point the other way), R the rows of costs and weighted goals that are squares, f what is not. Costs are divided
by `level`, the sum of their weights, so that their size does not matter. Of a `statics` question x = q, and the inputs
are parameters. p stacks targets, loads (and inputs), all in SI.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.lie import stumpff
from socontrol.mechanics.loads import Wrench
from socontrol.programs.equilibria.balance import Balance, load_parameters
from socontrol.programs.postures.costs import Effort
from socontrol.programs.postures.inverse_statics import InverseSolver, InverseStatics
from socontrol.programs.postures.posture import Terms, goal_rows
from socontrol.programs.postures.statics import Statics

SINGULAR = 1e-12  # smallest over largest singular value of the scaled tangent: below it inputs do not fix the shape


@dataclass(frozen=True)
class Given:
    """An argument of the solver: a target, a load or the inputs; `value` as the file gives it."""

    name: str
    value: np.ndarray
    units: tuple
    what: str


def load_paths(robot):
    """Paths of force and moment of every point load."""
    loads = robot.description.loads or {}
    return [f"loads.{n}.{key}" for n, load in loads.items() if isinstance(load, Wrench) for key in ("force", "moment")]


def _units(goal):
    """Units of a target's numbers; a direction has none."""
    units, count = goal.units(), len(goal.numbers())
    return tuple(units) if len(units) == count else ("1",) * count


def _meaning(name, goal):
    """What the numbers of a target are."""
    if hasattr(goal, "rows"):
        return f"{', '.join('xyz'[i] for i in goal.rows)} of goal {name}, world axes"
    if len(goal.units()) < len(goal.numbers()):
        return f"direction of goal {name}, a unit vector in world axes"
    return f"goal {name} in world axes: positions, then a rotation vector if it asks for one"


class Reduced:
    """The rows of a `statics` or `inverse_statics` question, with counts, limits, scales and a start.

    Raises ValueError, with a sentence, where the equilibrium does not fix the shape.
    """

    def __init__(self, question):
        self.question, self.robot = question, question.loaded
        self.inverse = isinstance(question, InverseStatics)
        if not self.inverse and not isinstance(question, Statics):
            raise TypeError("a statics or inverse_statics question is wanted")
        if self.robot.loops:
            raise ValueError("it has loops, which a solver in C does not know yet; a robot file gives plain functions")
        self.solver = InverseSolver(question) if self.inverse else None
        self.paths = load_paths(self.robot)
        self.balance = self.solver.balance if self.inverse else Balance(self.robot, load_parameters(self.robot))
        self.scales = self.balance.scales
        self.held = question.named("coordinates", question.coordinates)
        self.goals = self.solver.posture.goals if self.inverse else {}
        self._refuse_singular()

    @property
    def inputs(self):
        """Number of unknown inputs."""
        return self.robot.m if self.inverse else 0

    @property
    def scale(self):
        """x times this is (q, u) in SI."""
        return np.concatenate([self.scales.q, self.scales.u]) if self.inverse else self.scales.q

    @cached_property
    def limits(self):
        """(lower, upper) of (q, u) in SI; a held coordinate's are its value, given inputs' theirs."""
        if self.inverse:
            pairs = self.solver.posture.limits()
            return tuple(np.concatenate([pairs["q"][side], pairs["u"][side]]) for side in (0, 1))
        sides = tuple(np.full(self.robot.n, bound) for bound in (-np.inf, np.inf))
        for index, value in self.held.items():
            sides[0][index] = sides[1][index] = value
        return sides

    @cached_property
    def start(self):
        """(q, u) in SI that a cold solve starts from: rest, or the shape of the question as it stands."""
        if self.inverse:
            guess = self.solver.guess()
            return np.concatenate([guess["q"], guess["u"]])
        question = self.question
        q0 = question.vector("coordinates", question.guess.coordinates, "guess.coordinates")
        u = question.vector("inputs", question.inputs)
        answer = self.balance.solve(u, q0, prescribed=self.held)
        return answer.q if answer.status.solved else q0

    @cached_property
    def given(self):
        """The arguments in the order of p."""
        rows = [
            Given(f"target.{name}", np.array(goal.numbers(), dtype=float), _units(goal), _meaning(name, goal))
            for name, goal in self.goals.items()
        ]
        if not self.inverse and self.robot.m:
            u = self.question.vector("inputs", self.question.inputs)
            rows.append(Given("inputs", u, self.robot.input_units, "inputs, in order"))
        for path in self.paths:
            unit = "N" if path.endswith("force") else "N m"
            value = np.array(self.robot.value(path), dtype=float)
            _, name, key = path.split(".")
            load = self.robot.description.loads[name]
            what = f"{key} of load {name} on {load.on} at X = {load.at:g}, {load.axes} axes"
            rows.append(Given(path, value, (unit,) * 3, what))
        return rows

    @property
    def counts(self):
        """Numbers of rows {r, g, side, R} in the order of `function`."""
        return {name: sum(block.numel() for block in blocks) for name, blocks in self._blocks.items()}

    @cached_property
    def function(self):
        """Function (x, p) -> rows, their transposed Jacobian (so that C reads it by rows), f, df/dx, `beyond`."""
        made = self._blocks
        rows = ca.vertcat(*(block for blocks in made.values() for block in blocks))
        blocks = [*made["g"], *made["side"], *made["R"]]
        J = ca.vertcat(self._tangent, *(ca.jacobian(block, self._x) for block in blocks))
        f = ca.SX(self._smooth)
        outputs = ca.cse([ca.densify(ca.SX(e)) for e in (rows, J.T, f, ca.gradient(f, self._x), self._beyond)])
        names = ["rows", "slopes", "f", "gradient", "beyond"]
        return ca.Function("rows", [self._x, self._p], outputs, ["x", "p"], names)

    def cost(self, q, u, p):
        """|R|^2 / 2 + f at numeric q, u, p [SI]."""
        rows, _, f, _, _ = self.function(np.concatenate([q, u]) / self.scale, p)
        squares = np.array(rows).ravel()[sum(self.counts.values()) - self.counts["R"] :] ** 2
        return self.level * float(np.sum(squares) / 2 + f)

    @property
    def _beyond(self):
        """Largest squared turn of a section over what the series hold for."""
        q = self._x[: self.robot.n] * ca.DM(self.scales.q)
        turns = [ca.sumsqr(turn) / stumpff.RANGE**2 for turn in self.robot.tree.turns(q)]
        return ca.mmax(ca.vertcat(*turns)) if turns else ca.SX(0)

    @cached_property
    def _x(self):
        return ca.SX.sym("x", self.scale.size)

    @cached_property
    def _p(self):
        return ca.SX.sym("p", sum(g.value.size for g in self.given))

    @cached_property
    def _arguments(self):
        """{argument: its part of p}."""
        ends = np.cumsum([0, *(g.value.size for g in self.given)]).tolist()
        return {g.name: self._p[a:b] for g, a, b in zip(self.given, ends, ends[1:], strict=False)}

    @cached_property
    def _terms(self):
        """Expressions of the posture at x and p."""
        x, n, p = self._x * ca.DM(self.scale), self.robot.n, self._arguments
        q = x[:n]
        u = x[n:] if self.inverse else p.get("inputs", ca.SX(0, 1))
        statics = self.robot.functions(self.paths, compiled=False).statics.function
        loads = ca.vertcat(*(p[path] for path in self.paths))
        found = statics(q, u, *((loads,) if self.paths else ()))
        return Terms(self.balance, q, u, found, self._x[:n])

    @property
    def _tangent(self):
        terms, scale = self._terms, ca.DM(self.scale)
        slopes = ca.horzcat(terms.tangent, -terms.actuation) if self.inverse else terms.tangent
        return ca.diag(1 / ca.DM(self.scales.force)) @ slopes @ ca.diag(scale)

    @cached_property
    def _blocks(self):
        """{r, g, side, R: expressions}."""
        terms, robot = self._terms, self.robot
        blocks = {"r": [terms.residual / ca.DM(self.scales.force)], "g": [], "side": [], "R": []}
        for name, goal in self.goals.items():
            target, scale = self._arguments[f"target.{name}"], np.array(goal.scales(robot.length))
            if goal.weight is not None:
                distance = goal_rows(name, goal, "distance", robot, terms.kin, target)
                sizes = ca.DM(np.resize(scale, distance.numel()))
                blocks["R"].append(float(np.sqrt(goal.weight / self.level)) * distance / sizes)
                continue
            blocks["g"].append(goal_rows(name, goal, "miss", robot, terms.kin, target) / ca.DM(scale))
            if hasattr(goal, "guard"):
                blocks["side"].append(goal.guard(robot, terms.kin, target))
        blocks["R"] += [cost.rows(terms) / np.sqrt(self.level) for cost in self._costs if hasattr(cost, "rows")]
        return blocks

    @property
    def _costs(self):
        if not self.inverse:
            return []
        return (self.question.costs or {"effort": Effort()}).values()

    @property
    def _smooth(self):
        smooth = (cost.expression(self._terms) for cost in self._costs if not hasattr(cost, "rows"))
        return sum(smooth, 0) / self.level

    @property
    def level(self):
        """Sum of the costs' weights; 1 where there is no cost."""
        return float(sum(cost.weight for cost in self._costs)) or 1.0

    @property
    def smooth(self):
        """Weight of f, the elastic energy, over the level."""
        return float(sum(cost.weight for cost in self._costs if not hasattr(cost, "rows"))) / self.level

    def _refuse_singular(self):
        """Raise ValueError naming a coordinate that inputs and loads do not fix at the start."""
        start, n = self.start, self.robot.n
        u = start[n:] if self.inverse else self.question.vector("inputs", self.question.inputs)
        free = [i for i in range(n) if i not in self.held]
        tangent = np.array(self.balance.evaluate(start[:n], u)[1])[np.ix_(free, free)]
        tangent = tangent * self.scales.q[free][None, :] / self.scales.force[free][:, None]
        if not tangent.size:
            return
        _, values, directions = np.linalg.svd(tangent)
        if not values[-1] > SINGULAR * values[0]:
            name = self.robot.coordinates[free[int(np.argmax(np.abs(directions[-1])))]]
            raise ValueError(
                f"the equilibrium does not fix coordinate {name}: nothing pulls it back. An exported solver eliminates"
                f" the shape: give {name.split('.')[0]} stiffness or weight, or hold it under `coordinates:`"
            )
