"""From a trajectory question to its answer: guess, solve, ask what to loosen where it is infeasible, check."""

from dataclasses import replace

import casadi as ca
import numpy as np

from socontrol.programs.motions.massless import refuse_massless
from socontrol.programs.motions.plant import Plant
from socontrol.programs.motions.signals import History
from socontrol.programs.nlp.solver import NLP
from socontrol.programs.plans.loosen import loosened
from socontrol.programs.plans.plan_answer import answered, cleared
from socontrol.programs.plans.plan_guess import FINE, Course, Guesses, settled
from socontrol.programs.plans.planner import Planner
from socontrol.programs.postures.inverse_statics import Attempt
from socontrol.programs.result import Result, Status, Value

NAMED = 3  # limits in the sentence on what to loosen
LEAST_SECONDS = 2.0  # for the look at half the mesh
COARSE = 8  # intervals: with fewer, these may be what is missing


def plan(question, progress=None):
    """Result of a trajectory question."""
    start, status = settled(question)
    status = status or _refused(question, start[0])
    if status is not None:
        return Result(name=question.name, type="trajectory", status=status, question=question)
    return _Search(question, start, progress).result()


def _refused(question, q):
    """Status of a question whose start cannot be, or None; raises Bad where coordinates move no mass."""
    robot, held = replace(question.loaded, compiled=False), question.named("coordinates", question.coordinates)
    lower, upper = question.coordinate_limits()
    for i in np.flatnonzero((q < lower - 1e-9) | (q > upper + 1e-9)):
        told = f"{robot.coordinates[i]} is {q[i]:.4g} at the start, outside its limits [{lower[i]:.4g}, {upper[i]:.4g}]"
        return Status("infeasible", f"{told}; begin elsewhere, or loosen them.")
    for name, rows in cleared(question, q[None]).items():
        short = question.obstacles[name].clearance - rows[0]
        if short > 1e-9:
            told = f"At the start the robot is {short * 1e3:.3g} mm too near to '{name}'"
            return Status("infeasible", f"{told}; move one of the two.")
    if not question.quasi_static:
        fixed = {i: History(lambda t, value=value: ca.DM(value)) for i, value in held.items()}
        refuse_massless(Plant(robot, [History(lambda t: ca.DM(0))] * robot.m, fixed, {}))
    return None


class _Search:
    """One program, tried from several courses. attempts: every call of the solver; best: the best outcome."""

    def __init__(self, question, start, progress):
        self.question, self.start, self.progress = question, start, progress
        self.planner = Planner(question, start)
        self.nlp = NLP(self.planner.program, question.solver, question.loaded.compiled, progress)
        self.attempts, self.best, self.details = [], None, {}

    def result(self):
        self._searched()
        if self.best.status.outcome in ("infeasible", "numerical", "limit") and np.all(np.isfinite(self.best.x)):
            self._loosen()
        result = answered(self.question, self.planner, self.best, self.attempts, self.nlp.build_seconds)
        result = replace(result, details={**result.details, **self.details})
        fine = self.question.mesh.intervals > max(len(self.question.moments), self._half)
        return self._halved(result) if result.status.solved and self.question.mesh.halved and fine else result

    def _halved(self, result):
        """The result with the cost's change where the mesh has half the intervals: above what twice as many change."""
        question = self.question
        coarse = replace(question, mesh=replace(question.mesh, intervals=max(len(question.moments), self._half)))
        planner = Planner(coarse, self.start)
        course = self._course(self.planner.transcription.planned(self.best.values))
        spent = sum(attempt.seconds for attempt in self.attempts)
        nlp = NLP(planner.program, _brief(coarse.solver, spent), question.loaded.compiled, self.progress)
        outcome = nlp.solve(course.fill(planner.transcription))
        change = abs(outcome.cost - self.best.cost) if outcome.status.solved else None
        values = {} if change is None else {"mesh.cost_change": Value(change, "1")}
        details = {**result.details, "halved": {"intervals": coarse.mesh.intervals, "cost_change": change}}
        return replace(result, values={**result.values, **values}, details=details)

    @property
    def _half(self):
        return -(-self.question.mesh.intervals // 2)

    def _course(self, curve):
        """A planned motion as a course to start from."""
        shares = np.linspace(0.0, 1.0, FINE + 1)
        q, _, _, u, _ = curve.at(shares * curve.duration)
        span = self.question.span
        return Course(shares, q, u, float(np.clip(curve.duration, span.shortest, span.longest)))

    def _searched(self):
        """As many guesses as asked for, and the straight one where the first fails."""
        question = self.question
        guesses = Guesses(question, self.start)
        first, given = guesses.first(), question.guess.times is not None
        self.first, self.unheld = first, guesses.unheld.copy()
        self._tried("given motion" if given else "equilibria", first)
        if not self.best.status.solved and not given and self._goes_on:
            straight = guesses.straight()
            if not np.allclose(straight.q, first.q):
                self._tried("straight", straight)
        for k in range(1, question.guess.starts):
            if self._goes_on:
                self._tried(f"start {k + 1}", guesses.further(first, k))

    @property
    def _goes_on(self):
        return self.attempts[-1].outcome != "interrupted"

    def _tried(self, label, course):
        outcome = self.nlp.solve(course.fill(self.planner.transcription))
        self.attempts.append(Attempt.of(label, outcome))
        if self.best is None or _quality(outcome) > _quality(self.best):
            self.best = outcome

    def _loosen(self):
        """Name what to loosen; where nothing has to give way, go on from the motion that shows it."""
        curve = self.planner.transcription.planned(self.best.values)
        rows, found, outcome = loosened(self.question, self.start, [self.first, self._course(curve)], self.progress)
        self.attempts.append(Attempt.of("loosened", outcome))
        if rows is None:
            return
        if not rows:
            self._tried("from the loosened", self._course(found))
            return
        told = " and ".join(_gives_way(row) for row in rows[:NAMED]) + (" and more" if len(rows) > NAMED else "")
        coarse = " Or take more intervals." if self.question.mesh.intervals < COARSE else ""
        still = f" No equilibrium was found that meets the goals of: {', '.join(self.unheld)}." if self.unheld else ""
        sentence = f"No motion was found within the limits; {told}.{still}{coarse}"
        self.details["loosen"] = rows
        self.best = replace(self.best, status=Status("infeasible", sentence))


def _brief(solver, seconds):
    """The solver with about as much time as the plan itself took, where it knows of time."""
    if not hasattr(solver, "max_seconds"):
        return solver
    return replace(solver, max_seconds=min(solver.max_seconds or np.inf, max(LEAST_SECONDS, seconds)))


def _gives_way(row):
    by = f"{row['by']:.3g} {row['unit']}".removesuffix(" 1")
    return f"{row['quantity']} would have to {'grow' if row['quantity'] == 'duration' else 'give way'} by {by}"


def _quality(outcome):
    """What makes an outcome better: solved at less cost; else nearer to what was asked for."""
    solved = outcome.status.solved
    size = -outcome.cost if solved else -outcome.violation
    return solved, size if np.isfinite(size) else -np.inf
