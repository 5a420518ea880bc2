"""States of a robot that its C code is tried on, and what Python's functions give there."""

from dataclasses import dataclass

import numpy as np

from socontrol.lie import stumpff

RANDOM = 100  # shapes beside the straight one and the limits
BEND = np.pi  # largest turn of a section [rad]
STRAIN = 0.2  # largest stretch and shear
REACH = 1.0  # of coordinates and inputs without limits
DIGITS = 5  # of the states: short numbers
NUMBERS = 2500  # results of one function that are kept; larger results are kept at fewer states
LEAST = 10  # states of any function
SMALLEST = 1e-3  # part of the limits below which no finite results are looked for


@dataclass(frozen=True)
class Samples:
    """States by rows: q, qd, qdd [N x n each], qdd_joints, u. Row 0 is straight and still, 1 and 2 the limits."""

    values: dict

    def __len__(self):
        return len(self.values["q"])

    def rounded(self, real):
        """The same states as numbers of another real type, in double."""
        return Samples({name: x.astype(real).astype(float) for name, x in self.values.items()})


def samples(robot, functions, real="double"):
    """Samples at which all casadi Functions are finite: materials may lock, so that the limits shrink where needed."""
    rng, part = np.random.default_rng(20), 1.0
    lower, upper = _limits(robot)
    while part > SMALLEST:
        found = _samples(robot, part * lower, part * upper, rng)
        found = found.rounded("float32") if real == "float" else found
        good = np.array([_finite(functions, found, k) for k in range(len(found))])
        if good[:3].all() and good.sum() > len(good) / 2:
            return Samples({name: x[good] for name, x in found.values.items()})
        part /= 2
    raise ValueError("the functions are not finite near the straight shape; check the robot with socontrol check")


def _limits(robot):
    """Lower and upper q [n]: of joints, or of a section that turns by BEND."""
    lower, upper = np.array(robot.joint_limits).T.copy() if robot.n else (np.zeros(0), np.zeros(0))
    for piece in robot.tree.pieces:
        if piece.is_rod:
            turning = np.any(np.array(piece.Phi)[:3] != 0, axis=0)
            bend = BEND / (np.sqrt(max(1, turning.sum())) * float(piece.length))
            upper[piece.columns] = np.where(turning, bend, STRAIN)
            lower[piece.columns] = -upper[piece.columns]
    return _bounded(lower, upper)


def _bounded(lower, upper):
    """The limits with REACH where there is none."""
    low, high = np.isfinite(lower), np.isfinite(upper)
    return (
        np.where(low, lower, np.where(high, upper, REACH) - 2 * REACH),
        np.where(high, upper, np.where(low, lower, -REACH) + 2 * REACH),
    )


def _samples(robot, lower, upper, rng):
    """Samples between limits of q; rates and accelerations cross the same width in a second."""
    width, count = upper - lower, RANDOM + 3
    share = rng.random((count, robot.n))
    share[1:3] = [[0.0], [1.0]]
    q = lower + width * share
    q[0] = 0.0
    while far := [k for k in range(count) if robot.overstrained(q[k])]:
        q[far] /= 2
    qd, qdd = (width * (rng.random((count, robot.n)) - 0.5) for _ in range(2))
    u_lower, u_upper = _bounded(*np.array(robot.input_limits).reshape(-1, 2).T)
    u = u_lower + (u_upper - u_lower) * rng.random((count, robot.m))
    u[1], u[2] = u_lower, u_upper
    qd[0], qdd[0], u[0] = 0.0, 0.0, 0.0
    values = {"q": q, "qd": qd, "qdd": qdd, "qdd_joints": qdd[:, 6:], "u": u}
    return Samples({name: _short(x) for name, x in values.items()})


def _short(x):
    """Numbers of few digits, none larger than before."""
    with np.errstate(divide="ignore"):
        unit = 10.0 ** (np.floor(np.log10(np.abs(np.where(x == 0, 1.0, x)))) - DIGITS + 1)
    return np.array([float(f"{v:.{DIGITS}g}") for v in (np.trunc(x / unit) * unit).ravel()]).reshape(x.shape)


def results_at(function, found, k):
    """Results of a casadi Function at state k, as dense arrays."""
    arguments = [found.values[function.name_in(i)][k] for i in range(function.n_in())]
    results = function.call(arguments)
    return [np.array(r.full()) for r in results]


def _finite(functions, found, k):
    return all(np.all(np.isfinite(r)) for f in functions for r in results_at(f, found, k))


def count(function):
    """At how many states a function's results are kept."""
    size = max(1, sum(function.numel_out(i) for i in range(function.n_out())))
    return min(RANDOM + 3, max(LEAST, NUMBERS // size))


def out_of_range(robot):
    """A q [n] whose first rod section turns beyond the range of the series, or None where nothing can."""
    for piece in robot.tree.pieces:
        if piece.is_rod and np.any(np.array(piece.Phi)[:3] != 0):
            column = int(np.flatnonzero(np.any(np.array(piece.Phi)[:3] != 0, axis=0))[0])
            q = np.zeros(robot.n)
            q[piece.columns.start + column] = 2 * stumpff.RANGE / float(piece.length)
            return _short(q)
    return None
