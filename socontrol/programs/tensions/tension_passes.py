"""Inputs over all samples of a motion, and the motion moved to where the robot can follow it.

What is left unmet at a sample displaces the robot there. Where motion is slow beside vibration, the robot follows the
motion so displaced, and inputs made for that one leave less: a few passes are made, each with rates of its own. They
do not converge for what is faster than the lowest vibration, so the best is kept and none is made past it.
"""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.programs.tensions.wanted_motion import Wanted
from socontrol.programs.words import would_need

PASSES = 5
BETTER = 0.7  # of the displacement before: a pass that leaves more is not worth its accelerations, and not taken
NOTHING = 1e-10  # of the robot's length: smaller displacements need no further pass
ON = 1e-9  # of an input's scale: less is not beyond a limit
LOOKED = 20  # samples at which limits are let go
MOST = 0.5  # of what all limits displace: then it is the upper ones that do


@dataclass(frozen=True)
class Samples:
    """Inputs u [K x m] for a motion, the displacement dq [K x n] by what they leave unmet, and the miss [K x r] of what
    is tracked after it."""

    u: np.ndarray
    dq: np.ndarray
    miss: np.ndarray


@dataclass(frozen=True)
class Need:
    """An input at its limit that without it would be `value` at `time` [s]; moved [m]: how far that moves the robot."""

    name: str
    unit: str
    pulls: bool
    value: float
    limit: float
    time: float
    moved: float

    @property
    def sentence(self):
        """`c1 would need 2.6 N at t = 0.4 s, its limit is 2 N`."""
        if self.pulls and self.value < 0:
            return f"{self.name} is slack at t = {self.time:.4g} s and would have to push with {-self.value:.3g} N"
        values = (f"{x:.3g} {self.unit}" for x in (self.value, self.limit))
        return would_need(self.name, *values, f" at t = {self.time:.4g} s")


def sampled(fitter, motion, near, progress=None, sentence="tensions"):
    """Samples of a motion, from the first to the last; `near` [m]: inputs at about its beginning."""
    rows = []
    near = fitter.fit(motion, 0, near).u
    for k in range(len(motion.t)):
        limits = fitter.within(near, motion.t[k] - motion.t[k - 1]) if k else None
        rows.append(fitter.fit(motion, k, near, limits))
        near = rows[-1].u
        if progress and k % 20 == 0:
            progress(k, len(motion.t), f"{sentence}, sample {k + 1} of {len(motion.t)}")
    return Samples(*(np.array([getattr(row, key) for row in rows]) for key in ("u", "dq", "miss")))


@dataclass(frozen=True)
class Hurry:
    """A sentence on an input whose limits on rates are in the way; moved [m]: how far all of them move the robot."""

    sentence: str
    moved: float


@dataclass(frozen=True)
class Passes:
    """The motion as wanted and its Samples, that which the robot follows and its Samples, how many passes were made."""

    wanted: Wanted
    first: Samples
    followed: Wanted
    last: Samples
    count: int


def passed(fitter, wanted, near, weights, length, most=PASSES, progress=None):
    """At `most` so many passes from a wanted motion. weights [n]: metres that a unit of each coordinate moves the
    robot, `length` [m] its own; `near` as in `sampled`."""
    first = sampled(fitter, wanted, near, progress, "pass 1")
    best, size = Passes(wanted, first, wanted, first, 1), _largest(first, weights)
    while best.count < most and size > NOTHING * length:
        motion = fitter.closed(best.followed.moved(best.last.dq))
        if motion is None:
            break
        found = sampled(fitter, motion, first.u[0], progress, f"pass {best.count + 1}")
        own = _largest(found, weights)
        if own > BETTER * size:
            break
        best, size = replace(best, followed=motion, last=found, count=best.count + 1), own
    return best


def _largest(samples, weights):
    return float(np.max(np.abs(samples.dq) * weights, initial=0.0))


def needed(fitter, motion, found, weights):
    """Need of the input whose limits, rates aside, displace the robot most, None where no limits do: at the samples
    with the largest displacements, first without upper limits, then, where cables would have to push, without any."""
    robot, (lower, upper) = fitter.plant.robot, fitter.limits
    loose, worst = upper > lower, None
    high, low = np.where(loose, np.inf, upper), np.where(loose, -np.inf, lower)
    for k in np.argsort(-np.max(np.abs(found.dq) * weights, axis=1, initial=0.0))[:LOOKED]:
        rows = []
        for limits, sign, limit in (((lower, high), 1, upper), ((low, high), -1, lower)):
            u = (freed := fitter.fit(motion, k, found.u[k], limits)).u
            moved = float(np.max(np.abs(freed.dq - found.dq[k]) * weights, initial=0.0))
            beyond = np.where(loose, sign * (u - limit) / fitter.size, 0.0)
            i = int(np.argmax(beyond))
            rows.append((moved if beyond[i] > ON else 0.0, i, u[i], limit[i]))
        moved, i, value, limit = rows[0] if rows[0][0] > MOST * rows[1][0] else rows[1]
        if moved > (worst.moved if worst else 0.0):
            worst = Need(robot.inputs[i], robot.input_units[i], bool(robot.pulls[i]), value, limit, motion.t[k], moved)
    return worst
