"""Problem type `inverse_statics`: which inputs hold the goals under these loads, within the limits?

From rest first; if that fails, the nearest reachable posture is sought, then the goal by continuation from rest,
then from further starts (random inputs, fixed seed). Every attempt is kept in `details["attempts"]`.
"""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from socontrol.programs.equilibria.balance import load_parameters
from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.looks.answer import Look
from socontrol.programs.nlp.solver import Outcome
from socontrol.programs.postures.closed import HELD
from socontrol.programs.postures.costs import Cost
from socontrol.programs.postures.goals import Goal, Path, locate
from socontrol.programs.postures.paths import follow
from socontrol.programs.postures.posture import Posture
from socontrol.programs.postures.sensitivity import sensitivities
from socontrol.programs.postures.statics import looked_at
from socontrol.programs.postures.unreachable import explain
from socontrol.programs.question import Question
from socontrol.programs.result import Result, Status, Value
from socontrol.programs.words import pretty
from socontrol.quantities import Bad, Flag, record

AT_REST = 1e-9  # of the robot's length, or radians: a goal so near to rest is met there
GOAL_TOLERANCE = 1e-7  # of the robot's length, or radians
STEPS = 5  # of the continuation from rest to goal


@record(kw_only=True)
class InverseStatics(Question):
    """Which inputs hold the goals under these loads, within the limits?

    goals: what to hold; costs: what to keep small (default: input effort); sensitivities: print du/d(goal, load).
    """

    goals: dict[str, Goal]
    costs: dict[str, Cost] | None = None
    sensitivities: Flag = False
    optimises, knows_loops = True, True
    asked = "inverse_statics"  # what results call this type

    def __post_init__(self):
        super().__post_init__()
        self.refuse_goals()
        self._refuse_given_beyond_limits()

    def refuse_goals(self):
        """Raise Bad for goals that cannot be asked for."""
        if not self.goals:
            raise Bad("goals", "no goal is given; name at least one")
        if sum(isinstance(g, Path) for g in self.goals.values()) > 1:
            raise Bad("goals", "one path at the most; its waypoints set the order")
        if not self.robot.m and not (self.coordinates or {}):
            raise Bad("goals", "the robot has no actuators that could meet a goal; add `actuators:` to its file")
        for name, goal in self.goals.items():
            _locate(self.robot, name, goal)

    def _refuse_given_beyond_limits(self):
        for key, (lower, upper) in (("inputs", self.input_limits()), ("coordinates", self.coordinate_limits())):
            for i, value in self.named(key, getattr(self, key)).items():
                if not lower[i] <= value <= upper[i]:
                    name = getattr(self.robot, key)[i]
                    raise Bad(f"{key}.{name}", f"{value:g} is outside its limits [{lower[i]:g}, {upper[i]:g}] (SI)")

    def prepare(self):
        return InverseSolver(self)

    def solve(self, progress=None):
        return self.prepare().solve(progress=progress)


def _worst(goal, miss):
    """Where along a shape the remainder is largest, in words."""
    if not hasattr(goal, "places"):
        return ""
    size, X = max((float(np.linalg.norm(miss[rows])), at) for at, rows in goal.places())
    return f" in all, at most by {pretty(size, goal.units()[0])} at X = {X:g}"


def _locate(robot, name, goal):
    try:
        locate(robot, goal)
    except Bad as bad:
        raise Bad(f"goals.{name}.{bad.key}", str(bad)) from None


@dataclass(frozen=True)
class Attempt:
    """One call of the solver: where it started, how it ended, its own log if that is kept."""

    start: str
    outcome: str
    iterations: int
    seconds: float
    log: str = field(default="", repr=False)

    @classmethod
    def of(cls, start, outcome):
        return cls(start, outcome.status.outcome, outcome.iterations, outcome.seconds, outcome.log)


class _Interrupted(Exception):
    """The user stopped the solver; what it had reached is in `outcome`."""

    def __init__(self, outcome):
        super().__init__()
        self.outcome = outcome


def _log(attempts):
    """The solver's logs, one after the other."""
    return "\n".join(f"--- {a.start}: {a.outcome}, {a.iterations} iterations\n{a.log}" for a in attempts if a.log)


class InverseSolver:
    """A question made ready: programs built once, solved for changing targets, loads and starts.

    posture: the programs, of the rows of loops that held at the last answer.
    """

    def __init__(self, question):
        self.question = question
        self.path = next(((n, g) for n, g in question.goals.items() if isinstance(g, Path)), None)
        goals = dict(question.goals)
        if self.path:
            goals[self.path[0]] = self.path[1].stop(self.path[1].waypoints()[0])
        robot = question.loaded
        uncompiled = replace(robot, compiled=False)  # a few solves: rest, starts
        self.balance = balance_of(uncompiled, parameters=load_parameters(robot))
        self.posture = Posture(question, goals, self.balance)
        self.look = Look(question, self.balance)

    @property
    def rest(self):
        """Equilibrium {variable: SI values} without effort."""
        return self.posture.rest

    @cached_property
    def _resting(self):
        """Rest as what a solver might have returned, without multipliers."""
        program = self.posture.exact.program
        x = program.stack(self.rest)
        nothing = np.zeros(program.limits()[0].size)
        status = Status("solved", "Solved; the robot rests there.")
        return Outcome(status, program.split(x), x, np.zeros(x.size), nothing, 0.0, 0, 0.0, 0.0)

    @property
    def _costs_nothing(self):
        """Whether rest is the least there is: only effort counts, and nothing else is wanted. All inputs are then at
        their limits, where an interior-point solver comes slowly or not at all."""
        question, (lower, upper) = self.question, self.posture.limits()["q"]
        plain = not question.costs and not getattr(question, "held", None) and not question.sensitivities
        weighted = any(goal.weight is not None for goal in self.posture.goals.values())
        return plain and not weighted and bool(np.all((lower <= self.rest["q"]) & (self.rest["q"] <= upper)))

    def guess(self):
        """Where the plain solve starts: the question's guess, or rest."""
        given = self.question.guess
        if not given.inputs and not given.coordinates:
            return self.rest
        u = self.question.vector("inputs", given.inputs, "guess.inputs")
        if given.coordinates:
            return self.posture.posed(self.question.vector("coordinates", given.coordinates, "guess.coordinates"), u)
        return self.posture.posed(self.balance.solve(u, prescribed=self.posture.prescribed).q, u)

    def find(self, targets, start=None, warm=None):
        """(outcome, attempts) for {parameter: numbers}: the exact program from several starts, or the nearest one."""
        attempts, parameters = [], {**self.posture.targets(), **targets}

        def attempt(label, nlp, **how):
            outcome = nlp.solve(**{"parameters": parameters, **how})
            attempts.append(Attempt.of(label, outcome))
            if outcome.status.outcome == "interrupted":
                raise _Interrupted(outcome)
            return outcome

        try:
            if self.posture.apart is not None:
                return replace(self._resting, status=self.posture.apart), attempts
            outcome = self._find(parameters, attempt, attempts, start, warm)
            return self._on_all_rows(outcome, attempt), attempts
        except _Interrupted as stop:
            return stop.outcome, attempts

    def _on_all_rows(self, outcome, attempt):
        """The outcome; where its loops are held by other rows than those chosen at rest, found again with them."""
        loops, q = self.posture.loops, outcome.values["q"]
        if loops is None or not np.all(np.isfinite(q)) or loops.hold(q):
            return outcome
        other = self.posture.elsewhere(q)
        nlp = other.nearest if outcome.status.outcome == "infeasible" or other.overdetermined else other.exact
        found = attempt("other rows of the loops", nlp, guess=other.posed(q, outcome.values["u"]))
        if not found.status.solved or loops.error(q) <= HELD < loops.error(found.values["q"]):
            return outcome
        self.posture = other
        return replace(found, status=outcome.status)

    def _find(self, parameters, attempt, attempts, start, warm):
        posture = self.posture
        if self._costs_nothing and self.meets(self._resting, parameters, AT_REST):
            attempts.append(Attempt.of("rest", self._resting))
            return self._resting
        if posture.overdetermined:
            near = attempt("nearest", posture.nearest, guess=start or self.guess())
            return self._several_starts(parameters, attempt, near, near)
        if warm is not None and self._alike(warm):
            outcome = attempt("neighbour", posture.exact, warm=warm)
            if outcome.status.solved:
                return outcome
        outcome = attempt("guess" if start is None and self.question.guess.inputs else "rest",
                          posture.exact, guess=start or self.guess())  # fmt: skip
        if outcome.status.solved:
            return outcome
        near = attempt("nearest", posture.nearest, guess=self.rest)
        if near.status.solved and self.meets(near, parameters, 1e-3):
            outcome = attempt("from the nearest", posture.exact, guess=near.values)
            if outcome.status.solved:
                return outcome
        outcome = self._continuation(parameters, attempt) or outcome
        if outcome.status.solved:
            return outcome
        return self._several_starts(parameters, attempt, near, outcome)

    def _alike(self, outcome):
        """Whether an outcome is one of the exact program: as many rows, those of loops the same."""
        loops = self.posture.loops
        same = outcome.lam_g.size == self.posture.exact.program.limits()[0].size
        return same and (loops is None or loops.bear(outcome.values["lam"]))

    def _continuation(self, parameters, attempt):
        """From rest to goal in steps, each from the one before; None where a step fails."""
        start, outcome = self._reached(self.rest["q"]), None
        guess = self.rest
        for k in range(1, STEPS + 1):
            way = {
                f"target.{n}": goal.between(np.array(start[n]), np.array(parameters[f"target.{n}"]), k / STEPS)
                for n, goal in self.posture.goals.items()
            }
            label = f"continuation {k}/{STEPS}"
            outcome = attempt(label, self.posture.exact, guess=guess, parameters={**parameters, **way})
            if not outcome.status.solved:
                return outcome
            guess = outcome.values
        return outcome

    def _several_starts(self, parameters, attempt, near, outcome):
        """Random inputs within the limits, in equilibrium; the exact program, or else the nearest posture of all."""
        rng = np.random.default_rng(self.question.solver.seed)
        best = near if near.status.solved else None
        if self.posture.overdetermined and best is not None and self.meets(best, parameters):
            return replace(best, status=self._verdict(best, outcome, parameters))
        for k in range(self.question.solver.starts):
            u = self.random_inputs(rng)
            q = self.balance.solve(u, self.rest["q"], prescribed=self.posture.prescribed).q
            guess = self.posture.posed(q if np.all(np.isfinite(q)) else self.rest["q"], u)
            near = attempt(f"nearest, start {k + 1}", self.posture.nearest, guess=guess)
            if near.status.solved and (best is None or near.cost < best.cost - 1e-12):
                best = near
            if near.status.solved and not self.posture.overdetermined and self.meets(near, parameters, 1e-3):
                found = attempt(f"start {k + 1}", self.posture.exact, guess=near.values)
                if found.status.solved:
                    return found
        if best is None:
            return outcome
        return replace(best, status=self._verdict(best, outcome, parameters))

    def random_inputs(self, rng):
        """Inputs [m] anywhere within the limits."""
        lower, upper = self.posture.limits()["u"]
        lower = np.where(np.isfinite(lower), lower, -self.balance.scales.u)
        upper = np.where(np.isfinite(upper), upper, self.balance.scales.u)
        return lower + (upper - lower) * rng.random(lower.size)

    def _verdict(self, best, exact, parameters):
        """Status of the nearest posture found when the exact program failed from every start."""
        if self.meets(best, parameters):
            sentence = "Solved; the goal's conditions are singular there, so that the cost may not be the least."
            return Status("solved", sentence)
        if exact.status.outcome == "numerical" and self.meets(best, parameters, 1e-4):
            return Status("numerical", f"The goal is nearly met, then: {exact.status.message}")
        return Status("infeasible", "The goal is out of reach; the nearest reachable posture is returned.")

    def meets(self, outcome, parameters, tolerance=GOAL_TOLERANCE):
        """Whether every unweighted goal is met within `tolerance` of the robot's length (or radians)."""
        misses = self.posture.misses(outcome.values["q"], parameters)
        return all(
            np.max(np.abs(miss / np.array(self.posture.goals[n].scales(self.question.robot.length)))) <= tolerance
            for n, miss in misses.items()
            if self.posture.goals[n].weight is None
        )

    def _reached(self, q):
        """Numbers each goal would have as target at q: where a continuation starts."""
        f, numbers = self.look.functions, {}
        for name, goal in self.posture.goals.items():
            numbers[name] = goal.reached(f, q)
        return numbers

    def solve(self, targets=None, start=None, warm=None, progress=None):
        """The answer as a Result: inputs, posture, residuals; a path gives one answer with arrays over waypoints."""
        if self.path:
            return follow(self, progress)
        began = time.perf_counter()
        outcome, attempts = self.find(targets or {}, start, warm)
        return self.result(
            outcome, attempts, {**self.posture.targets(), **(targets or {})}, time.perf_counter() - began
        )

    def result(self, outcome, attempts, parameters, seconds):
        """Result of an outcome: values, misses, the independent look, and for a miss the way out."""
        question, posture = self.question, self.posture
        q = outcome.values["q"]
        arrays, details = posture.told(outcome)
        solver = {"iterations": sum(a.iterations for a in attempts), "seconds": seconds}
        result = Result(
            name=question.name, type=question.asked, status=outcome.status, question=question, log=_log(attempts),
            arrays=arrays, solver=solver, details={"attempts": attempts, "targets": parameters, **details},
        )  # fmt: skip
        if not np.all(np.isfinite(q)):
            return result
        if (open_ := posture.open(outcome)) is not None:
            return replace(result, status=open_)
        residuals, misses = {}, posture.misses(q, parameters)
        for name, miss in misses.items():
            units = np.array(posture.goals[name].units())
            for unit in dict.fromkeys(units):
                key = f"goals.{name}" if unit == units[0] else f"goals.{name}.{unit}"
                residuals[key] = Value(float(np.linalg.norm(miss[units == unit])), str(unit))
        if outcome.status.solved:
            missed = [
                f"{n} missed by {pretty(r.value, r.unit)}{_worst(goal, misses[n])}"
                for n, goal in posture.goals.items()
                if goal.weight is not None and (r := residuals[f"goals.{n}"]).value > GOAL_TOLERANCE
            ]
            sentence = f"{outcome.status.message.rstrip('.')}; weighted goal {', '.join(missed)}."
            result = replace(result, status=Status("solved", sentence)) if missed else result
        result = looked_at(result, self.look, posture.free, posture.prescribed, residuals)
        if result.status.solved and not self.meets(outcome, parameters):
            status = Status("rejected", "The recomputed goal is missed; tighten the solver's tolerance.")
            result = Result(**{**vars(result), "status": status})
        if result.status.outcome == "infeasible":
            result = explain(self, result, outcome, parameters)
        if question.sensitivities and result.status.solved:
            result.details["sensitivities"] = sensitivities(self, outcome, parameters)
        return result
