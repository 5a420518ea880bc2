"""How fast inputs and cable lengths change from waypoint to waypoint of a path in its timing, and how fast they may.

Between waypoints k and k + 1, dt seconds apart: low dt <= y_(k+1) - y_k <= high dt for a limited input or length y.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from socontrol.programs.postures.paths import is_closed, shares
from socontrol.programs.result import Value
from socontrol.programs.words import pretty, would_need
from socontrol.quantities import Bad

ROUND = 3  # digits of a duration that would do
WORST = 3  # quantities that a sentence names


@dataclass(frozen=True)
class Rate:
    """A limited rate: of `letter` u or l, component `index`; low < 0 < high in `unit`; scale: of the quantity."""

    letter: str
    index: int
    name: str
    unit: str
    low: float
    high: float
    scale: float

    def share(self, change, dt):
        """change over what the limit allows in dt: above 1 it is too fast."""
        room = np.where(np.asarray(change) < 0, self.low, self.high) * dt
        return np.divide(change, room, out=np.where(np.asarray(change) == 0, 0.0, np.inf), where=room != 0)

    def needed(self, change, dt):
        """`c1 would need 3.4 N/s, its limit is 2 N/s`."""
        limit = self.high if change >= 0 else self.low
        return would_need(self.name, self.speed(change / dt), self.speed(limit))

    def speed(self, rate):
        """`3.4 N/s`, without sign where the limits are alike both ways."""
        return f"{pretty(abs(rate) if self.low == -self.high else rate, self.unit)}/s"


class Pace:
    """Times and rates of a question's path; functions: of its robot, where they are made."""

    def __init__(self, question, path, functions=None):
        self.question, self.robot = question, question.robot
        self._functions = functions or self.robot.functions(compiled=False)
        waypoints = np.array(path.waypoints(), dtype=float)
        self.shares = shares(waypoints)
        self.closed = is_closed(waypoints)
        self.timing = getattr(question, "timing", None)
        self.t = None if self.timing is None else self.timing.when(self.shares)
        self.rates = limited(question)
        if self.rates and np.any(np.diff(self.shares) == 0):
            first = int(np.argmax(np.diff(self.shares) == 0)) + 1
            raise Bad("goals", f"waypoints {first} and {first + 1} are one place, which leaves no time between them")

    @property
    def dt(self):
        """[K - 1], s."""
        return np.diff(self.t)

    @cached_property
    def lengths_of(self):
        """Function q -> lengths [m] of the actuators."""
        return self._functions.actuator_lengths.function

    def lengths(self, q):
        """[K x m] at postures q [K x n]."""
        return np.array([np.array(self.lengths_of(row)).ravel() for row in q]).reshape(len(q), self.robot.m)

    def changes(self, u, lengths):
        """Of each limited rate, the change [K - 1] from waypoint to waypoint."""
        rows = {"u": np.diff(u, axis=0), "l": np.diff(lengths, axis=0)}
        return [rows[rate.letter][:, rate.index] for rate in self.rates]

    def strain(self, u, lengths):
        """[K - 1]: the largest share of a limit that is taken on the way to each waypoint; above 1 it is too fast."""
        dt = self.dt[: len(u) - 1]
        rows = [rate.share(change, dt) for rate, change in zip(self.rates, self.changes(u, lengths), strict=True)]
        return np.max(rows, axis=0, initial=0.0)

    def duration(self, stretch):
        """Duration [s], rounded up, that leaves stretch [K - 1] times the time between waypoints; None without one."""
        wanted, low, high = np.asarray(stretch) * self.dt, self.timing.duration, self.timing.duration
        if not np.all(np.isfinite(wanted)):
            return None

        def enough(duration):
            own = np.diff(replace(self.timing, duration=duration).when(self.shares))
            return np.all(own >= wanted * (1 - 1e-9))

        while not enough(high):  # a ramp of its own lets dt there grow by the root of the duration only
            high *= 2
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        digits = 10.0 ** (np.floor(np.log10(high)) - ROUND + 1)
        return float(np.ceil(high / digits * (1 - 1e-6)) * digits)

    def would_do(self, stretch):
        """`a duration of 13.6 s would do`, or nothing."""
        duration = self.duration(stretch)
        return "" if duration is None else f"a duration of {duration:.{ROUND}g} s would do"

    def values(self, u, lengths):
        """{rates.NAME, length_rates.NAME: the largest, either way}."""
        if self.t is None or len(u) < 2:
            return {}
        dt, robot, found = self.dt[: len(u) - 1], self.robot, {}
        for key, y, units in (("rates", u, robot.input_units), ("length_rates", lengths, robot.length_units)):
            for name, unit, change in zip(robot.inputs, units, np.abs(np.diff(y, axis=0)).T, strict=True):
                rate = np.divide(change, dt, out=np.zeros(dt.size), where=change > 0)
                found[f"{key}.{name}"] = Value(float(np.max(rate)), f"{unit}/s")
        return found

    def binding(self, u, lengths, least):
        """`c1 would need 3.4 N/s on the way to waypoint 12, its limit is 2 N/s`: of the limits taken `least` times."""
        dt, told = self.dt[: len(u) - 1], []
        for rate, change in zip(self.rates, self.changes(u, lengths), strict=True):
            share = rate.share(change, dt)
            if np.max(share, initial=0.0) >= least:
                k = int(np.argmax(share))
                told.append((share[k], f"{rate.needed(change[k], dt[k])} (on the way to waypoint {k + 2})"))
        told.sort(key=lambda row: -row[0])
        return "; ".join(text for _, text in told[:WORST])

    def fastest(self, u, lengths):
        """`Fastest: c1 1.9 of 2 N/s on the way to waypoint 12.`, of the limits that are nearest."""
        if not self.rates or len(u) < 2:
            return ""
        dt, rows = self.dt[: len(u) - 1], []
        for rate, change in zip(self.rates, self.changes(u, lengths), strict=True):
            share = rate.share(change, dt)
            k = int(np.argmax(share))
            limit = rate.high if change[k] >= 0 else rate.low
            fast = rate.speed(change[k] / dt[k]) if dt[k] > 0 else rate.speed(0.0)
            rows.append((share[k], f"{rate.name} {fast} (limit {rate.speed(limit)}) on the way to waypoint {k + 2}"))
        rows.sort(key=lambda row: -row[0])
        return f" Fastest: {'; '.join(text for _, text in rows[:WORST])}."


def limited(question):
    """Rates [Rate] that a question limits; raises Bad for those that make no sense."""
    limits, robot = getattr(question, "limits", None), question.robot
    found = []
    for key, letter, units in (("input_rates", "u", robot.input_units), ("length_rates", "l", robot.length_units)):
        ranges = limits.ranges(key, robot.inputs, [f"{unit}/s" for unit in units]) if limits is not None else {}
        for i, (low, high) in ranges.items():
            path = f"limits.{key}.{robot.inputs[i]}"
            if question.timing is None:
                raise Bad(path, "a rate needs to know when the path is where; give `timing: {duration: ...}`")
            if not low < 0 < high:
                raise Bad(path, f"{low:g} to {high:g} {units[i]}/s leaves no way to stay; 0 has to be between them")
            scale = _scale(question, letter, i)
            found.append(Rate(letter, i, robot.inputs[i], units[i], low, high, scale))
    return found


def _scale(question, letter, i):
    """What counts as one of an input or a length."""
    if letter == "l":
        return question.robot.length if question.robot.length_units[i] == "m" else 1.0
    lower, upper = question.input_limits()
    largest = max(abs(lower[i]), abs(upper[i]))
    return float(largest) if np.isfinite(largest) and largest > 0 else 1.0
