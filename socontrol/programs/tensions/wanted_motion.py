"""The motion that tensions shall make: in samples, and as a file gives it by coordinates in time."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from socontrol.programs.equilibria.lengths import KEYS as LENGTHS
from socontrol.programs.motions.integrators import Duration
from socontrol.programs.motions.signals import Signal, Table, history, sampled
from socontrol.programs.question import Raw
from socontrol.programs.tensions.timed_way import Curve
from socontrol.quantities import Bad, Either, Flag, PositiveNumber, Second, nearest, record

MOST_SAMPLES = 100_000
Given = Annotated[Any, Either(Raw, tuple[Raw, ...], Signal)]


@record(kw_only=True)
class Motion:
    """A motion in samples `every` so often: of the path in its `timing`, between its waypoints a smooth curve, or of
    coordinates in time, the others at 0, or where loops close as near to 0 or to the `guess` as can be.

    coordinates: values, histories, or lists at rising `times`; `file`: a plan, a simulation or comma-separated text.
    duration: to the end of the path's timing, or of the lists, where none is given. simulate: the motion again under
    the tensions; it is not held where it goes off by more than `tolerance`, of the robot's length.
    """

    every: Duration
    duration: Duration | None = None
    times: tuple[Second, ...] | None = None
    coordinates: dict[str, Given] | None = None
    file: str | None = None
    simulate: Flag = True
    tolerance: PositiveNumber = 0.01

    def __post_init__(self):
        if self.file is not None:
            raise Bad("file", "a file is read with the problem file that names it; from Python give times and values")
        if self.times is not None and not self.coordinates:
            raise Bad("coordinates", "the times are given; give the coordinates at these times")
        for name, values in (self.coordinates or {}).items():
            if isinstance(values, (tuple, list)):
                if self.times is None:
                    raise Bad("times", "a list of coordinates is given; give its times")
                try:
                    Table(times=self.times, values=values)
                except Bad as bad:
                    raise Bad(f"coordinates.{name}", str(bad)) from None

    @property
    def given(self):
        """Whether coordinates in time are given."""
        return self.coordinates is not None

    def check(self, question):
        """Raise Bad for a motion that makes no sense for the question and its robot."""
        for key in LENGTHS:
            if getattr(question, key, None):
                raise Bad(key, "the tensions of a motion are found by inverse dynamics, lengths follow; leave this out")
        if not question.has_path:
            self.read(question)
            return
        for key in ("duration", "coordinates"):
            if getattr(self, key) is not None:
                raise Bad(f"motion.{key}", "the path and its `timing` say it; leave this key out")
        self.samples(question.timing.duration)

    def read(self, question):
        """{index: History} of the given coordinates, {index: value} of held ones, times [K]; raises Bad."""
        held = question.named("coordinates", question.coordinates)
        histories = self._histories(question.robot, held)
        end = min((h.end for h in histories.values()), default=np.inf)
        duration = end if self.duration is None else self.duration
        if not np.isfinite(duration):
            raise Bad("motion.duration", "missing key 'duration': these coordinates have no end of their own")
        if duration > end * (1 + 1e-9):
            raise Bad("motion.duration", f"{duration:g} s is given, but the coordinates end at {end:g} s")
        return histories, held, self.samples(duration)

    def _histories(self, robot, held):
        found = {}
        for name, values in (self.coordinates or {}).items():
            path = f"motion.coordinates.{name}"
            if name not in robot.coordinates:
                raise Bad(path, f"the robot has no coordinate '{name}'{nearest(name, robot.coordinates)}")
            i = robot.coordinates.index(name)
            if i in held:
                raise Bad(path, "`coordinates` holds it the whole time; leave one of the two out")
            if isinstance(values, (tuple, list)):
                values = Table(times=self.times, values=tuple(values))
            found[i] = history(values, robot.coordinate_units[i], path, motion=True)
            if found[i].start > 0:
                raise Bad(f"{path}.times", f"the table begins at {found[i].start:g} s, after the motion does, at 0 s")
        return found

    def samples(self, duration):
        """Times [K] from 0 to `duration`; raises Bad."""
        if not self.every <= duration:
            raise Bad("motion.every", f"{self.every:g} s is beyond the duration, {duration:g} s")
        count = int(np.ceil(duration / self.every * (1 - 1e-9)))
        if count > MOST_SAMPLES:
            raise Bad("motion.every", f"{count} samples; at most {MOST_SAMPLES}")
        return np.linspace(0.0, count * self.every, count + 1).clip(max=duration)


@dataclass(frozen=True)
class Wanted:
    """A motion in samples: t [K], q, qd, qdd [K x n], targets [K x r] of what is tracked, and the inputs [K x m] from
    which effort counts: those at rest where they are known."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    targets: np.ndarray
    rest: np.ndarray

    def state(self, k):
        return self.q[k], self.qd[k], self.qdd[k]

    def moved(self, dq):
        """The motion with dq [K x n] added, its rates by a cubic spline in time."""
        _, first, second = Curve(self.t, dq)(self.t)
        return Wanted(self.t, self.q + dq, self.qd + first, self.qdd + second, self.targets, self.rest)


def of_histories(robot, histories, held, t):
    """q, qd, qdd [K x n] at t [K] of coordinates {index: History}, held ones {index: value}, 0 elsewhere."""
    q, qd, qdd = (np.zeros((len(t), robot.n)) for _ in range(3))
    rows = sampled(list(histories.values()), order=2)
    for k, x in enumerate(t):
        for own, values in zip((q, qd, qdd), rows(x), strict=True):
            own[k, list(histories)] = np.array(values).ravel()
    for i, value in held.items():
        q[:, i] = value
    return q, qd, qdd
