"""Integrators of the equation of motion: their settings, and the march through time that they share.

`radau` (default) chooses its steps by an error estimate and damps what is too fast to resolve; `gauss` takes equal
steps and keeps the energy of undamped robots; `cvodes` is SUNDIALS through CasADi on the explicit form.
"""

import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from socontrol.programs.looks.answer import collapsed
from socontrol.programs.motions.charts import Charts
from socontrol.programs.motions.collocation import ITERATIONS, Steps
from socontrol.programs.motions.plant import WORKS
from socontrol.programs.motions.signals import breaks
from socontrol.programs.result import Status
from socontrol.quantities import Bad, Count, PositiveNumber, Unit, record

Duration = Annotated[float, Unit("s", lower=1e-9)]
MOST_STAGES = 9  # CasADi knows the nodes of so many
SHORTEST = 1e-12  # of the time reached: shorter steps do not move the clock
SLOWEST = 0.1  # robot lengths in the whole time: errors are not measured by smaller speeds
SAFETY, SHRINK, GROW = 0.9, 0.2, 6.0
GOOD = 0.02  # contraction below which the tangents of an earlier step still serve


@record(kw_only=True)
class _Limits:
    """max_steps, max_seconds (of the clock on the wall): where to give up."""

    max_steps: Count = 200_000
    max_seconds: Annotated[float, Unit("s", lower=0)] = 3600.0


@record(kw_only=True)
class Radau(_Limits):
    """Radau IIA of order 5. `tolerance`: of the largest speed, per step; steps between `first_step` and
    `longest_step` (default: an output interval, the whole time)."""

    tolerance: PositiveNumber = 1e-5
    first_step: Duration | None = None
    longest_step: Duration | None = None
    type = "radau"


@record(kw_only=True)
class Gauss(_Limits):
    """Gauss collocation with `stages` nodes (order 2 stages) and equal steps of at most `step`."""

    step: Duration
    stages: Count = 3
    tolerance: PositiveNumber = 1e-12
    type = "gauss"

    def __post_init__(self):
        if self.stages > MOST_STAGES:
            raise Bad("stages", f"{self.stages} stages; at most {MOST_STAGES}")


@record(kw_only=True)
class Cvodes(_Limits):
    """SUNDIALS' variable-order BDF on qdd = M^-1 (...). `tolerance`: relative; absolute a thousandth of it, in SI."""

    tolerance: PositiveNumber = 1e-8
    type = "cvodes"


@dataclass
class March:
    """What a march has recorded: at each output t [k], q, qd [k x n each] and work [k x 11], the integrals of
    `Plant.power`; u [k x m], motors [k x d] and lam [k x l], where conditions decide them: inputs, forces of motors on
    driven coordinates, multipliers of loops; changes of what is held (t, name, whether it is held from then on); steps
    taken, refused, iterations; status."""

    t: list = field(default_factory=list)
    q: list = field(default_factory=list)
    qd: list = field(default_factory=list)
    work: list = field(default_factory=list)
    u: list = field(default_factory=list)
    motors: list = field(default_factory=list)
    lam: list = field(default_factory=list)
    changes: list = field(default_factory=list)
    steps: int = 0
    refused: int = 0
    iterations: int = 0
    status: Status = Status("solved", "Solved.")

    @contextmanager
    def guarded(self):
        """While marching: what stops it, Ctrl-C included, becomes the status."""
        try:
            yield
        except Stop as stop:
            self.status = stop.status
        except KeyboardInterrupt:
            reached = self.t[-1] if self.t else 0.0
            message = f"Stopped by the user at t = {reached:.6g} s; what was computed is kept."
            self.status = Status("interrupted", message)

    def keep(self, t, q, qd, work):
        self.t.append(float(t))
        self.q.append(q.copy())
        self.qd.append(qd.copy())
        self.work.append(work.copy())


class Stop(Exception):
    """The march cannot go on; `status` says why."""

    def __init__(self, outcome, message):
        super().__init__(message)
        self.status = Status(outcome, message)


class Marcher:
    """One plant on its way from rest or motion at t = 0 through the requested `times`."""

    def __init__(self, plant, settings, times, weights, length):
        self.plant, self.settings, self.times, self.length = plant, settings, times, length
        fixed = isinstance(settings, Gauss)
        self.fixed, scheme = fixed, "legendre" if fixed else "radau"
        self.steps = Steps(plant, scheme, settings.stages if fixed else 3, weights, settings.tolerance)
        self.charts, self.march = Charts(plant.robot, plant.driven), March()
        self.free, self.weights, self._follow = plant.free, weights[plant.free], None

    def run(self, q, qd, progress=None):
        """March; what stops it, Ctrl-C included, is in its status and keeps what was recorded."""
        march, self._progress = self.march, progress or (lambda done, total, sentence: None)
        self.q, self.qd, self.t = q.copy(), qd.copy(), 0.0
        self.work, self.began = np.zeros(len(WORKS) + 6), time.perf_counter()
        self.plant.place(0.0, self.q, self.qd)
        self._prepare()
        self._keep(0.0, self.q, self.qd, self.work)
        with march.guarded():
            for leg in legs(self.plant, self.times):
                self._leg(leg)
        return march

    def _prepare(self):
        """What is to be done at the start: nothing here."""

    def _keep(self, t, q, qd, work):
        self.march.keep(t, q, qd, work)

    def _leg(self, stop):
        """March to `stop`, in between which no history jumps."""
        self._last, self.speed = None, max(self._speed(self.qd[self.free]), SLOWEST * self.length / self.times[-1])
        self._acceleration = self._begin()
        h, outputs = self._first(stop), [t for t in self.times if self.t < t <= stop]
        while self.t < stop:
            if self.fixed:
                target = outputs[0] if outputs else stop
                count = max(1, int(np.ceil((target - self.t) / self.settings.step * (1 - 1e-9))))
                h = (target - self.t) / count
            else:
                h = min(h, self._longest)
                left = stop - self.t
                h = left if h >= left * (1 - 1e-9) else min(h, left / 2) if h > left / 2 else h
            h, follow = self._step(h)
            end = stop if abs(stop - self.t - h) <= 1e-12 * stop else self.t + h
            while outputs and outputs[0] <= end * (1 + 1e-14):
                self._output(outputs.pop(0), h)
            self._accept(end)
            h = self._follow = follow

    @property
    def _longest(self):
        """Histories may change between the nodes of a long step unseen, motors' most of all: they are given."""
        paces = [history.pace for history in self.plant.histories]
        own = [self.settings.longest_step or np.inf, self.times[1] if self.plant.led else np.inf]
        return min(*own, *paces)

    def _begin(self):
        try:
            return self.plant.acceleration(self.t, self.q, self.qd)[self.free]
        except np.linalg.LinAlgError:
            raise Stop("numerical", f"At t = {self.t:.6g} s the mass matrix is singular.") from None

    def _first(self, stop):
        """Length of the first step of a leg."""
        settings = self.settings
        if getattr(settings, "first_step", None):
            return settings.first_step
        if self._follow is not None:  # histories mostly bend where a leg ends; a jump shortens the step by itself
            return self._follow
        fall = self.weights * np.abs(self._acceleration)
        shortest = 0.01 * min(stop, self.times[1] if len(self.times) > 1 else stop)
        reach = float(np.max(fall, initial=0.0))
        return min(shortest, (1e-6 * self.length / reach) ** 0.5 if reach > 0 else shortest)

    def _step(self, h):
        """(length, length of the next) of a step that is good enough; it is left in `self._last`."""
        steps, march = self.steps, self.march
        q, v, fresh, grow = self.q[self.free], self.qd[self.free], False, GROW
        if not steps.has_tangents or self._last is None or self._last.contraction > GOOD:
            steps.refresh(self.t, self.q, self.qd)
            fresh = True
        while True:
            self._look_up(h)
            guess = np.tile(self._acceleration, (steps.table.c.size, 1))
            if self._last is not None:
                guess = steps.extrapolated(self._last, h)
            step = steps.take(self.t, q, v, h, guess, self.speed)
            if step is None:
                if fresh:
                    march.refused, grow = march.refused + 1, 1.0
                    h = self._shorter(h, 0.3)
                else:
                    steps.refresh(self.t, self.q, self.qd)
                    fresh = True
                continue
            march.iterations += step.iterations
            error = 0.0 if self.fixed else self._error(step, v)
            if error <= 1.0:
                break
            march.refused, grow = march.refused + 1, 1.0
            h = self._shorter(h, max(SHRINK, SAFETY * error**-0.25))
        march.steps += 1
        self._before, self._last = (q, v), step
        calm = (2 * ITERATIONS + 1) / (2 * ITERATIONS + step.iterations)  # many iterations ask for shorter steps
        factor = min(grow, SAFETY * calm * max(error, 1e-8) ** -0.25)
        return h, h if 1.0 <= factor < 1.2 else h * factor

    def _error(self, step, v):
        """Estimated error of a step over what is allowed."""
        eq, ev = self.steps.error(step, v, self._acceleration)
        fast = max(self.speed, float(np.max(np.abs(step.v) * self.weights, initial=0.0)))
        of_v = np.max(np.abs(ev) * self.weights, initial=0.0) / fast
        of_q = np.max(np.abs(eq) * self.weights, initial=0.0) / self.length
        error = float(max(of_v, of_q)) / self.settings.tolerance
        return error if np.isfinite(error) else 1e9

    def _shorter(self, h, factor):
        if self.fixed:
            raise Stop("numerical", f"At t = {self.t:.6g} s a step of {h:.3g} s does not converge; lower `step`.")
        if h * factor < max(SHORTEST * self.t, SHORTEST * 1e-3):
            worst = self.plant.robot.coordinates[self.free[int(np.argmax(np.abs(self._acceleration) * self.weights))]]
            sentence = f"At t = {self.t:.6g} s steps of {h:.1g} s are still too long: {worst} runs away."
            raise Stop("numerical", f"{sentence} Look at loads and inputs there, or at rods that collapse.")
        return h * factor

    def _look_up(self, h):
        """Progress, and the limits that a user can raise."""
        total = self.times[-1]
        self._progress(min(self.t, total), total, f"t = {self.t:.3g} of {total:g} s")
        if self.march.steps >= self.settings.max_steps:
            raise Stop("limit", f"{self.march.steps} steps reached t = {self.t:.6g} s; raise `max_steps`.")
        seconds = time.perf_counter() - self.began
        if seconds > self.settings.max_seconds:
            raise Stop("limit", f"{seconds:.0f} s on the wall reached t = {self.t:.6g} s; raise `max_seconds`.")

    def _output(self, t, h):
        step, (q0, v0) = self._last, self._before
        x = (t - self.t) / h
        q, qd = self.q.copy(), self.qd.copy()
        q[self.free], qd[self.free] = self.steps.end(step, v0, q0, x)
        self.plant.place(t, q, qd)
        self.plant.project(t, q, qd)
        self._keep(t, q, qd, self.work + self._worked(step, x))

    def _worked(self, step, x):
        """Integrals of power [11] from the beginning of a step to its fraction x."""
        if step.power is None:
            step.power = self.steps.power(self.t, step)
        return step.h * (self.steps.table.weights(x) @ step.power)

    def _accept(self, t):
        """Move the clock to the end of the last step."""
        step, (q0, v0) = self._last, self._before
        self.work = self.work + self._worked(step, 1.0)
        self.q[self.free], self.qd[self.free] = self.steps.end(step, v0, q0)
        self.t = t
        self.plant.place(t, self.q, self.qd)
        self.plant.project(t, self.q, self.qd)
        refuse_singular(self.plant.robot, self.charts, t, self.q[: self.plant.robot.n])
        self.speed = max(self.speed, self._speed(self.qd[self.free]))
        if self.charts.renewed(self.q, self.qd):
            self._last, self._acceleration = None, self._begin()
            self.steps.forget()
        else:
            self._acceleration = step.a[-1].copy()  # of Radau's last node; for Gauss a guess

    def _speed(self, v):
        return float(np.max(np.abs(v) * self.weights, initial=0.0))


def refuse_singular(robot, charts, t, q):
    """Raise Stop where a rod is crushed or turns past the range of the series, or a joint is a full turn away."""
    if joint := charts.stuck(q):
        why = "its springs, dampers, limits or motor keep its coordinates, which are singular there"
        raise Stop("numerical", f"At t = {t:.6g} s joint {joint} is nearly a full turn away: {why}.")
    names = collapsed(robot, q)
    if names:
        fix = "use more sections, or look at loads and inputs there"
        raise Stop("numerical", f"At t = {t:.6g} s section {names[0]} is crushed or turns by more than 2 pi; {fix}.")


def legs(plant, times, every=None):
    """Rising times up to which nothing jumps; with `every` each so many-th output is among them."""
    marks = {*breaks(plant.histories, times[-1]), float(times[-1])}
    return sorted(marks | set(map(float, times[every::every])) if every else marks)


INTEGRATORS = {"radau": Radau, "gauss": Gauss, "cvodes": Cvodes}
