"""A posture as a program: coordinates q and inputs u in equilibrium, goals met exactly or nearly, least cost.

    minimise   sum costs + sum_weighted w |miss / scale|^2 / 2
    subject to r(q, u) = 0,  miss_exact(q) = 0,  limits on q and u
The equilibrium brings its own tangent dr/dq = K_tot, dr/du = -B and curvature sum_i mu_i d2r_i: for loads with a
potential the latter is the derivative of K_tot along mu, one forward sweep instead of n. Loops add their multipliers
lam to the unknowns, r(q, u) - E^T lam = 0 with E = de/dq, and the rows e(q) = 0.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.statics import Statics
from socontrol.programs.nlp.program import Program
from socontrol.programs.nlp.solver import NLP
from socontrol.programs.postures.closed import HELD, ClosedRows
from socontrol.programs.postures.costs import Effort
from socontrol.programs.result import Status
from socontrol.quantities import Bad

NEAREST = 100.0  # weight of a miss over the robot's length in the search for the nearest posture
SECOND = 1e-9  # of all else there: enough to single out one of several nearest postures


class Posture:
    """Expressions and programs of one question; `goals` {name: record} without paths."""

    def __init__(self, question, goals, balance):
        self.question, self.goals, self.robot, self.balance = question, goals, question.loaded, balance
        self.scales = balance.scales
        self.prescribed = question.named("coordinates", question.coordinates)
        self.given = question.named("inputs", question.inputs)

    @cached_property
    def exact(self):
        """NLP with unweighted goals as constraints."""
        return self._nlp(False)

    @cached_property
    def nearest(self):
        """NLP with every goal as a cost: the nearest reachable posture."""
        return self._nlp(True)

    @cached_property
    def freed(self):
        """The exact NLP that keeps near an `anchor` (scaled x) with the weights `pull`, before all other costs."""
        return self._nlp(False, anchored=True)

    @cached_property
    def _resting(self):
        """Equilibrium without effort: inputs at 0 (or what is given, or the limit nearest 0)."""
        return self.balance.solve(self._least_inputs, prescribed=self.prescribed)

    @property
    def _least_inputs(self):
        return np.clip(np.zeros(self.robot.m), *self._input_limits())

    @cached_property
    def loops(self):
        """ClosedRows, chosen where the robot rests; None without loops."""
        return ClosedRows(self.balance, self.free, self._resting.q) if self.robot.loops else None

    @cached_property
    def apart(self):
        """Status of loops that cannot close; None where they can."""
        if self.loops is None or self.loops.error(self._resting.q) <= HELD:
            return None
        return self._resting.status

    @cached_property
    def rest(self):
        """{variable: SI values} at rest without effort; of a robot that finds no rest q = 0, or closed loops."""
        settled = self._resting.status.solved or self.robot.loops
        return self.posed(self._resting.q if settled else np.zeros(self.robot.n), self._least_inputs)

    def posed(self, q, u):
        """{variable: SI values} of coordinates under inputs: where a program may start."""
        return {"q": q, "u": u} | ({} if self.loops is None else {"lam": self.loops.pushing(q, u)})

    def told(self, outcome):
        """(arrays q, u and lam, details) of an outcome: lam the least that pushes alike."""
        values = {key: outcome.values[key] for key in ("q", "u")}
        if self.loops is None or not np.all(np.isfinite(values["q"])):
            return values, {}
        lam = self.loops.least(values["q"], outcome.values["lam"])
        return {**values, "lam": lam}, {"redundant_rows": self.balance.redundant(values["q"], self.free)}

    def open(self, outcome):
        """Status of loops that cannot close, none where an outcome leaves none open; within limits, or at all."""
        q = outcome.values["q"]
        if self.loops is None or outcome.status.outcome != "infeasible" or self.loops.error(q) <= HELD:
            return None
        if self.apart is not None:
            return self.apart
        told = self.loops.told(q)
        return Status(told.outcome, f"Within the limits, {told.message[0].lower()}{told.message[1:]}")

    def elsewhere(self, q):
        """The same question with the rows of loops that hold them near q."""
        other = Posture(self.question, self.goals, self.balance)
        other._resting, other.loops = self._resting, self.loops.elsewhere(q)
        return other

    @cached_property
    def free(self):
        """Mask [n] of coordinates that are not prescribed."""
        mask = np.ones(self.robot.n, dtype=bool)
        mask[list(self.prescribed)] = False
        return mask

    @cached_property
    def counts(self):
        """(numbers that unweighted goals ask for, inputs that are free to meet them)."""
        lower, upper = self.limits()["u"]
        asked = sum(len(goal.units()) for goal in self.goals.values() if goal.weight is None)
        return asked, int(np.sum(lower < upper))

    @property
    def overdetermined(self):
        """Whether goals ask for more numbers than there are free inputs: met by luck or redundancy only."""
        return self.counts[0] > self.counts[1]

    def targets(self):
        """{parameter: numbers} of the goals as declared."""
        return {f"target.{name}": goal.numbers() for name, goal in self.goals.items()}

    def limits(self):
        """{variable: (lower, upper)} with given inputs and prescribed coordinates held."""
        lower, upper = self.question.coordinate_limits()
        for i, value in self.prescribed.items():
            lower[i] = upper[i] = value
        pairs = {"q": (lower, upper), "u": self._input_limits()}
        return pairs if self.loops is None else {**pairs, "lam": self.loops.limits()}

    def _input_limits(self):
        lower, upper = self.question.input_limits()
        for i, value in self.given.items():
            lower[i] = upper[i] = value
        return lower, upper

    def program(self, nearest=False, anchored=False):
        """The program as declared: one can add to it before it is made ready."""
        robot, s, limits = self.robot, self.scales, self.limits()
        program = Program(ca.SX.sym)
        q = program.variable("q", robot.n, scale=s.q, lower=limits["q"][0], upper=limits["q"][1])
        u = program.variable("u", robot.m, scale=s.u, lower=limits["u"][0], upper=limits["u"][1])
        changing = {path: program.parameter(path, robot.value(path)) for path in self.balance.parameters}
        arguments = (q, u, ca.vertcat(*changing.values()))[: self.balance.function.n_in()]
        terms = Terms(self.balance, q, u, self.balance.function(*arguments), program.variables["q"].symbol, changing)
        equilibrium = terms.residual, {"q": terms.tangent, "u": -terms.actuation}, terms.curvature
        residual, tangent, curvature = self.loops.joined(program, *equilibrium) if self.loops else equilibrium
        slack = np.where(self.free, 0.0, np.inf)
        program.constrain(
            "equilibrium", residual, lower=-slack, upper=slack, scale=s.force, unit="scaled",
            tangent=tangent, curvature=curvature,
        )  # fmt: skip
        if held := getattr(self.question, "held", None):
            lengths = robot.functions(compiled=False).actuator_lengths.function(q)
            program.constrain("lengths", held.gap(lengths, u), scale=robot.length, unit="m")
        for name, goal in self.goals.items():
            target = program.parameter(f"target.{name}", goal.numbers())
            scale = np.array(goal.scales(robot.length))
            if nearest or goal.weight is not None:
                weight = NEAREST if goal.weight is None else goal.weight * (SECOND if nearest else 1.0)
                distance = goal_rows(name, goal, "distance", robot, terms.kin, target)
                sizes = ca.DM(np.resize(scale, distance.numel()))
                program.minimize(weight * ca.sumsqr(distance / sizes) / 2)
                continue
            miss = goal_rows(name, goal, "miss", robot, terms.kin, target)
            program.constrain(f"goals.{name}", miss, scale=scale, unit=goal.units())
            if hasattr(goal, "guard"):
                side = goal.guard(robot, terms.kin, target)
                program.constrain(f"goals.{name}.side", side, upper=np.inf)
        weight = SECOND if nearest else 1.0
        for cost in (self.question.costs or {"effort": Effort()}).values():
            program.minimize(weight * cost.expression(terms))
        if anchored:
            pull, anchor = (program.parameter(key, np.zeros(program.scale.size)) for key in ("pull", "anchor"))
            program.minimize(ca.dot(pull, (program.x - anchor) ** 2) / 2)
        return program

    def _nlp(self, nearest, anchored=False):
        often = not anchored and nearest == self.overdetermined  # the others are for goals out of reach
        return NLP(self.program(nearest, anchored), self.question.solver, self.robot.compiled and often)

    def misses(self, q, targets=None):
        """{goal: miss in SI [rows]} at numeric q."""
        targets = targets or self.targets()
        rows = self._misses(q, *(np.asarray(targets[f"target.{name}"], dtype=float) for name in self.goals))
        rows = rows if isinstance(rows, (tuple, list)) else [rows]
        return {name: np.array(row).ravel() for name, row in zip(self.goals, rows, strict=True)}

    @cached_property
    def _misses(self):
        """Function (q, target of each goal) -> its miss in the units a person would measure."""
        q = ca.SX.sym("q", self.robot.n)
        kin = Kinematics(self.robot.tree, q)
        targets = [ca.SX.sym(f"t{k}", len(goal.numbers())) for k, goal in enumerate(self.goals.values())]
        rows = [
            ca.densify(goal_rows(name, goal, "measured", self.robot, kin, target))
            for (name, goal), target in zip(self.goals.items(), targets, strict=True)
        ]
        return ca.Function("misses", [q, *targets], rows)


class Terms:
    """The expressions costs and constraints are made of (also what `costs` calls a posture).

    found: residual, tangent and actuation at (q, u); hat: the unknown that q is the scaled form of; changing:
    {path: symbol} of the robot's values that are parameters.
    """

    def __init__(self, balance, q, u, found, hat, changing=None):
        self.robot, self.q, self.u = balance.robot, q, u
        driving = {path: symbol for path, symbol in (changing or {}).items() if path.startswith("actuators.")}
        self.q_scale, self.u_scale, self.energy_scale = balance.scales.q, balance.scales.u, balance.scales.energy
        self.statics = Statics(balance.robot.with_values(driving) if driving else balance.robot, q, u)
        self.kin = self.statics.kin
        self.residual, self.tangent, self.actuation = found
        self._hat = hat
        self._conservative = balance.conservative and self.statics.conservative_actuation

    def elastic_energy(self):
        return self.statics.elastic_energy()

    def curvature(self, mu):
        """Blocks of sum_i mu_i d2 r_i for (q, q) and (q, u)."""
        if self._conservative:
            along = ca.jtimes(ca.vec(self.tangent), self._hat, mu / ca.DM(self.q_scale))
            qq = ca.reshape(along, self.tangent.shape)
        else:
            qq = ca.jacobian(self.tangent.T @ mu, self._hat) @ ca.diag(1 / ca.DM(self.q_scale))
        return {("q", "q"): qq, ("q", "u"): -self.statics.actuation_gradient(mu)}


def goal_rows(name, goal, kind, robot, kin, target):
    """Rows of a goal: its own `kind` (measured, distance) if it has one, else its miss."""
    try:
        return getattr(goal, kind, goal.miss)(robot, kin, target)
    except Bad as bad:
        raise Bad(f"goals.{name}.{bad.key}", str(bad)) from None
