"""Where the search for a plan begins: through equilibria between start and goal, or along a motion that is given.

Between two moments the inputs go straight from one to the other and the robot follows in equilibrium; where nothing
holds it there (motors at rigid joints), the coordinates go straight. The pace is that of a rest-to-rest motion.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.question import Raw
from socontrol.quantities import Bad, Count, Integer, Second, nearest, record

STOPS = 12  # equilibria between two moments
FINE = 400  # samples of the motion from start to end
JITTER = 0.3  # of a coordinate's scale: how far further starts bend off the first


@record(kw_only=True)
class PlanGuess:
    """A motion to start from: `file` (a result folder, or comma-separated text), or coordinates and inputs by name at
    rising `times`, which are stretched to the duration. starts: searches from so many guesses, the further ones bent
    off at random (`seed`); the best is kept."""

    file: str | None = None
    times: tuple[Second, ...] | None = None
    coordinates: dict[str, tuple[Raw, ...]] | None = None
    inputs: dict[str, tuple[Raw, ...]] | None = None
    starts: Count = 1
    seed: Integer = 1

    def __post_init__(self):
        if self.seed < 0:
            raise Bad("seed", f"{self.seed} is negative")
        if self.file is not None:
            raise Bad("file", "a file is read with the problem file that names it; from Python give times and values")
        if self.times is None and (self.coordinates or self.inputs):
            raise Bad("times", "give the times of the guess")
        if self.times is not None and (len(self.times) < 2 or any(np.diff(self.times) <= 0)):
            raise Bad("times", "two or more rising times are wanted")
        for key in ("coordinates", "inputs"):
            for name, values in (getattr(self, key) or {}).items():
                if len(values) != len(self.times):
                    raise Bad(f"{key}.{name}", f"{len(values)} values for {len(self.times)} times")

    def check(self, robot):
        """Raise Bad for names the robot does not have."""
        for key in ("coordinates", "inputs"):
            names = getattr(robot, key)
            for name in getattr(self, key) or {}:
                if name not in names:
                    raise Bad(f"guess.{key}.{name}", f"the robot has no {key[:-1]} '{name}'{nearest(name, names)}")


@dataclass(frozen=True)
class Course:
    """A motion by samples over the share of the duration: q [K x n], u [K x m]; rates by differences."""

    shares: np.ndarray
    q: np.ndarray
    u: np.ndarray
    duration: float

    def rows(self, values):
        """Function of shares -> rows of one of the sampled quantities."""
        return lambda x: np.column_stack([np.interp(x, self.shares, column) for column in values.T])

    def fill(self, transcription):
        """x [SI] of a transcription that holds this motion."""
        t = self.shares * self.duration
        v = np.gradient(self.q, t, axis=0)
        a = np.gradient(v, t, axis=0)
        return transcription.filled(*(self.rows(x) for x in (self.q, v, a, self.u)), self.duration)


class Guesses:
    """The courses a search begins with; `start` (q, v, u)."""

    def __init__(self, question, start):
        self.question, self.robot, self.start = question, replace(question.loaded, compiled=False), start
        self.balance = Balance(self.robot)
        self.held = question.named("coordinates", question.coordinates)
        self.unheld = []  # moments whose goals no equilibrium within the limits was found to meet

    def first(self):
        """The Course a file or the equilibria say."""
        return self._recorded() if self.question.guess.times is not None else self._through()

    def further(self, course, k):
        """The course bent off at random, ends kept."""
        rng = np.random.default_rng([self.question.guess.seed, k])
        waves = np.sin(np.pi * np.outer(course.shares, np.arange(1, 4)))
        bent = course.q + waves @ rng.standard_normal((3, course.q.shape[1])) * JITTER * self.balance.scales.q
        lower, upper = self.question.coordinate_limits()
        return replace(course, q=np.clip(bent, lower, upper))

    def straight(self):
        """The course whose coordinates go straight from start to end."""
        return self._through(straight=True)

    def _recorded(self):
        guess, question = self.question.guess, self.question
        times = np.array(guess.times)
        shares = (times - times[0]) / (times[-1] - times[0])
        q = np.tile(self.start[0], (times.size, 1))
        u = np.tile(rest_inputs(self.question), (times.size, 1))
        for key, own in (("coordinates", q), ("inputs", u)):
            for k in range(times.size):
                row = {name: values[k] for name, values in (getattr(guess, key) or {}).items()}
                for i, value in question.named(key, row, f"guess.{key}").items():
                    own[k, i] = value
        duration = times[-1] - times[0] if question.span.free else question.span.guess
        duration = float(np.clip(duration, question.span.shortest, question.span.longest))
        fine = np.linspace(0, 1, FINE + 1)
        course = Course(shares, q, u, duration)
        return Course(fine, course.rows(q)(fine), course.rows(u)(fine), duration)

    def _through(self, straight=False):
        """Equilibria between the moments, at rest-to-rest pace from moment to moment."""
        fine = np.linspace(0.0, 1.0, FINE + 1)
        q, u = np.zeros((fine.size, self.robot.n)), np.zeros((fine.size, self.robot.m))
        for (a, q0, u0), (b, q1, u1) in zip(self._stops, self._stops[1:], strict=False):
            own = (fine >= a - 1e-12) & (fine <= b + 1e-12)
            x = (fine[own] - a) / (b - a)
            pace = x**3 * (10 - 15 * x + 6 * x**2)
            steps, states = self._between(q0, u0, q1, u1, straight)
            q[own] = np.column_stack([np.interp(pace, steps, column) for column in states.T])
            u[own] = u0 + pace[:, None] * (u1 - u0)
        return Course(fine, q, u, self.question.span.guess)

    @cached_property
    def _stops(self):
        """(share of the duration, q, u) at the start and at every moment."""
        shares, u = np.concatenate([[0.0], np.cumsum(self.question.shares)]), self.start[2]
        stops = [(0.0, self.start[0], np.where(np.isfinite(u), u, rest_inputs(self.question)))]
        for path, k, moment in self.question.moments:
            stops.append((shares[k], *self._posture(path, moment, *stops[-1][1:])))
        return stops

    def _posture(self, path, moment, q, u):
        """(q, u) near what a moment asks for; from the ones before where nothing is known."""
        question = self.question
        held = {**self.held, **question.named("coordinates", moment.coordinates)}
        if moment.goals:
            found = self._reaching(path, moment, q, u)
            if found is not None:
                return found
        inputs = u.copy()
        for i, value in question.named("inputs", moment.inputs).items():
            inputs[i] = value
        if not held and not moment.inputs:
            return q, u
        target = q.copy()
        for i, value in held.items():
            target[i] = value
        if len(held) < self.robot.n:
            answer = self.balance.solve(inputs, target, prescribed=held, max_iterations=60)
            target = answer.q if answer.status.solved and not self.robot.overstrained(answer.q) else target
        return target, inputs

    def _reaching(self, path, moment, q, u):
        """(q, u) of an equilibrium that meets the goals of a moment, or the nearest; None without one."""
        question = self.question
        asked = InverseStatics(
            robot=question.robot, loads=question.loads, bounds=question.bounds, goals=moment.goals,
            coordinates={**(question.coordinates or {}), **(moment.coordinates or {})} or None,
            inputs={**(question.inputs or {}), **(moment.inputs or {})} or None,
            solver=Ipopt(starts=1, max_iterations=100), discretisation=False,
        )  # fmt: skip
        solver = asked.prepare()
        outcome, _ = solver.find({}, start={"q": q, "u": u})
        if outcome.status.outcome == "infeasible":
            self.unheld.append(path)
        found = outcome.values["q"], outcome.values["u"]
        return found if all(np.all(np.isfinite(x)) for x in found) else None

    def _between(self, q0, u0, q1, u1, straight):
        """Shares of the way [k] and coordinates [k x n] there."""
        steps = np.linspace(0.0, 1.0, STOPS + 1)
        line = q0 + steps[:, None] * (q1 - q0)
        if straight or np.allclose(u0, u1) or not self._holds(q0, u0) or not self._holds(q1, u1):
            return steps, line
        states, q = [q0], q0
        for x in steps[1:-1]:
            answer = self.balance.solve(u0 + x * (u1 - u0), q, prescribed=self.held, max_iterations=60)
            if not answer.status.solved or self.robot.overstrained(answer.q):
                return steps, line
            q = answer.q
            states.append(q)
        return steps, np.array([*states, q1])

    def _holds(self, q, u):
        """Whether (q, u) is an equilibrium."""
        r = np.array(self.balance.evaluate(q, u)[0])
        r[list(self.held)] = 0.0
        return bool(np.max(np.abs(r / self.balance.scales.force)) < 1e-6)


def rest_inputs(question):
    """Inputs [m] without effort: those given, else 0 or the limit nearest 0."""
    lower, upper = question.input_limits()
    u = np.clip(np.zeros(question.robot.m), lower, upper)
    for i, value in question.named("inputs", question.inputs).items():
        u[i] = value
    return u


def settled(question):
    """((q, v, u) at t = 0, u NaN where it may be any, None), or (None, status) where no rest shape is found."""
    start, u = question.start, rest_inputs(question)
    own = question.named("inputs", start.inputs, "start.inputs")
    for i, value in own.items():
        u[i] = value
    q, v = question.first_coordinates(), np.zeros(question.robot.n)
    if not start.is_settled:
        for i, value in question.rates(start.rates, "start.rates").items():
            v[i] = value
        return (q, v, np.array([own.get(i, np.nan) for i in range(u.size)])), None
    balance = Balance(replace(question.loaded, compiled=False))
    held = question.named("coordinates", question.coordinates)
    answer = balance.solve(u, q, prescribed=held)
    if not answer.status.solved:
        return None, replace(answer.status, message=f"No shape at rest to start from. {answer.status.message}")
    return (answer.q, v, u), None
