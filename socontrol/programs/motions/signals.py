"""Histories: values that change in time, as a file can say them, and the CasADi expressions they become.

A plain value is constant. Values are in the unit of what they drive (read when that is known); times in seconds.
Motions of joints need two derivatives: ramps and tables are smoothed for them (quintic steps, cubic splines).
"""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Any

import casadi as ca

from socontrol.programs.question import Raw, read
from socontrol.quantities import Bad, Either, Flag, OneOf, Radian, Second, Unit, record

LONGEST = 100_000  # rows of a table


@dataclass(frozen=True)
class History:
    """value(t): a CasADi expression of the time; breaks: times where it or its rates jump; start, end: what is known.

    pace: longest step [s] of an integrator that sees it change.
    """

    value: Any
    breaks: tuple = ()
    start: float = 0.0
    end: float = float("inf")
    pace: float = float("inf")


@record(kw_only=True)
class Ramp:
    """From `from` before `start` to `to` after `stop`, in a straight line, or `smooth` (quintic, rates 0 at both
    ends, as motions of joints always are)."""

    to: Raw
    stop: Second
    from_: Raw = 0.0
    start: Second = 0.0
    smooth: Flag = False

    def __post_init__(self):
        if not self.start < self.stop:
            raise Bad("stop", f"{self.stop:g} s is not after start: {self.start:g} s")

    def history(self, unit, path, motion):
        first, last = read(self.from_, unit, f"{path}.from"), read(self.to, unit, f"{path}.to")

        def value(t):
            x = ca.fmin(1, ca.fmax(0, (t - self.start) / (self.stop - self.start)))
            share = x**3 * (10 - 15 * x + 6 * x**2) if self.smooth or motion else x
            return first + (last - first) * share

        return History(value, (self.start, self.stop), pace=(self.stop - self.start) / 10 if motion else float("inf"))


@record(kw_only=True)
class Sinusoid:
    """mean + amplitude sin(2 pi t / period + phase)."""

    amplitude: Raw
    period: Annotated[float, Unit("s", lower=0, exclusive=True)]
    mean: Raw = 0.0
    phase: Radian = 0.0

    def history(self, unit, path, motion):
        mean, amplitude = (read(getattr(self, key), unit, f"{path}.{key}") for key in ("mean", "amplitude"))
        turns = 2 * pi / self.period
        return History(lambda t: mean + amplitude * ca.sin(turns * t + self.phase), pace=self.period / 16)


@record(kw_only=True)
class Rate:
    """`from` until `start`, then changing at `rate` per second: a motor at a given speed, already turning at start."""

    rate: Raw
    from_: Raw = 0.0
    start: Second = 0.0

    def history(self, unit, path, motion):
        first, rate = read(self.from_, unit, f"{path}.from"), read(self.rate, f"{unit}/s", f"{path}.rate")
        if motion and self.start > 0:
            raise Bad(f"{path}.start", "the joint would jump to its rate; start at 0 s, or use a ramp or a table")
        return History(lambda t: first + rate * ca.fmax(0, t - self.start) if self.start else first + rate * t,
                       (self.start,) if self.start else ())  # fmt: skip


@record(kw_only=True)
class Table:
    """`values` at rising `times`, straight lines between them (a cubic spline for motions of joints).

    From a file: `file` (comma-separated, one head line) and the `column` of the values; its first column is the time.
    """

    times: tuple[Second, ...] = ()
    values: tuple[Raw, ...] = ()
    column: str | None = None
    file: str | None = None

    def __post_init__(self):
        if self.file is not None:
            raise Bad("file", "a file is read with the problem file that names it; from Python give times and values")
        if len(self.times) < 2 or len(self.times) != len(self.values):
            raise Bad("values", f"{len(self.times)} times and {len(self.values)} values; give two or more of both")
        if len(self.times) > LONGEST:
            raise Bad("times", f"{len(self.times)} rows; at most {LONGEST}")
        for k, (a, b) in enumerate(zip(self.times, self.times[1:], strict=False), start=1):
            if not a < b:
                raise Bad(f"times.{k}", f"{b:g} s does not come after {a:g} s; times must rise")

    def history(self, unit, path, motion):
        values = [read(value, unit, f"{path}.values.{k}") for k, value in enumerate(self.values)]
        first, last = self.times[0], self.times[-1]
        if motion and (len(values) < 4 or first > 0):
            raise Bad(f"{path}.times", "a table of a motion needs four or more times, the first 0 s or before")
        spline = ca.interpolant("table", "bspline" if motion else "linear", [list(self.times)], values)

        def value(t):  # fmin and fmax would halve the rate at the ends
            return spline(ca.if_else(t < first, first, ca.if_else(t > last, last, t)))

        if not motion:
            return History(value, self.times, first, last)
        gaps = [b - a for a, b in zip(self.times, self.times[1:], strict=False)]
        return History(value, (), first, last, min(gaps) / 2)


SIGNALS = {"ramp": Ramp, "sinusoid": Sinusoid, "rate": Rate, "table": Table}
Signal = Annotated[Any, OneOf(SIGNALS, what="history")]
Changing = Annotated[Any, Either(Raw, Signal)]


def history(given, unit, path, motion=False):
    """History of a plain value or a signal, in `unit`; `motion`: of a joint's coordinate. Raises Bad at `path`."""
    if isinstance(given, tuple(SIGNALS.values())):
        return given.history(unit, path, motion)
    value = read(given, unit, path)
    return History(lambda t: ca.DM(value))


def breaks(histories, stop):
    """Rising times inside (0, stop) at which any history jumps or bends."""
    return sorted({float(t) for h in histories for t in h.breaks if 1e-12 < t < stop * (1 - 1e-12)})


def sampled(histories, order=0):
    """Function t -> the histories' values [k], and with `order` their first derivatives in t, [k] each."""
    t = ca.MX.sym("t")
    values = ca.vertcat(*(ca.MX(h.value(t)) for h in histories)) if histories else ca.MX(0, 1)
    outputs = [values]
    for _ in range(order):
        outputs.append(ca.jtimes(outputs[-1], t, ca.MX(1)) if histories else ca.MX(0, 1))
    return ca.Function("histories", [t], [ca.densify(o) for o in outputs])
