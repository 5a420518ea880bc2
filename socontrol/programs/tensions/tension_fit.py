"""Inputs that come nearest to a wanted generalised force, within limits: one bounded least-squares problem a sample.

What inputs u leave unmet, B u - tau, displaces the robot by dq = K^-1 (B u - tau). Made small, each far before the
next: the miss of the tracked points J dq + miss over the robot's length, the energy of dq, the effort, which counts
from the inputs at rest where they are known. K is the tangent at rest and a little mass, M over the duration squared,
so that robots without stiffness are displaced as by Gauss's principle of least constraint. Loops bear what they can:
dq is among the motions they leave, and K the tangent with the force A^T lam that they add.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.statics import Statics
from socontrol.native.buffers import Buffered
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.postures.posture import goal_rows

ENERGY, EFFORT = 0.03, 0.01  # of the miss: inputs that at their limits displace less than EFFORT are hardly used
ROUNDS = 3  # each starts effort at the inputs before: what effort shifts, (EFFORT / displaced)^2, is left to this power
NEAR = 1e-13  # of what rows of this size pull: less is rounding, and does not move an input off its limit
MOST_SETS = 20  # sets of inputs at limits that are tried, for each input
FLAT = 1e-12  # of the largest: smaller stiffnesses count as that
SOFTEST = 0.1  # of the stiffness at q = 0: what gives way further counts as that


def bounded(R, c, lower, upper, start):
    """x [m] within limits that makes |R x - c| least; R [m x m] is regular, `start` is a first guess.

    Active sets, as in C. Lawson, R. Hanson, "Solving Least Squares Problems", 1974, ch. 23, with both limits (P. Stark,
    R. Parker, Computational Statistics 10 (1995)).
    """
    x = np.clip(start, lower, upper)
    free = (x > lower) & (x < upper)
    for _ in range(MOST_SETS * x.size):
        x, free = _descended(R, c, lower, upper, x, free)
        if free.all():
            break
        pull = (c - R @ x) @ R
        inward = np.where(free | (lower >= upper), 0.0, np.where(x >= upper, -pull, pull))
        worst = int(np.argmax(inward))
        if inward[worst] <= NEAR * np.linalg.norm(R[:, worst]) * np.linalg.norm(c):
            break
        free[worst] = True
    return x


def _descended(R, c, lower, upper, x, free):
    """x and its free set after going to the least squares of the free inputs, stopping at each limit on the way."""
    while free.any():
        goal = x.copy()
        goal[free] = np.linalg.lstsq(R[:, free], c - R[:, ~free] @ x[~free], rcond=None)[0]
        step = goal - x
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0, (upper - x) / step, np.where(step < 0, (lower - x) / step, np.inf))
        room[~free] = np.inf
        first = int(np.argmin(room))
        if room[first] >= 1.0:
            return goal, free
        x = x + max(room[first], 0.0) * step
        x[first] = upper[first] if step[first] > 0 else lower[first]
        free = free.copy()
        free[first] = False
    return x, free


class Tracked:
    """Rows that say how far a posture is from goals {name: record} whose targets change in time."""

    def __init__(self, robot, goals):
        q = ca.SX.sym("q", robot.n)
        kin = Kinematics(robot.tree, q)
        sizes = [len(goal.numbers()) for goal in goals.values()]
        target = ca.SX.sym("target", sum(sizes))
        parts = ca.vertsplit(target, np.cumsum([0, *sizes]).tolist())
        rows = [goal_rows(name, goal, "miss", robot, kin, part)
                for (name, goal), part in zip(goals.items(), parts, strict=True)]  # fmt: skip
        scale = ca.DM([size for goal in goals.values() for size in goal.scales(robot.length)])
        miss = ca.vertcat(*rows) / scale
        self._run = Buffered(ca.Function("tracked", [q, target], [ca.densify(miss), ca.densify(ca.jacobian(miss, q))]))

    def __call__(self, q, target):
        """Miss [r] over the robot's length (or in radians), and its derivative [r x n]."""
        (miss,), J = self._run(q, target)
        return miss.copy(), J.T.copy()


@dataclass(frozen=True)
class Fit:
    """Inputs u [m]; the displacement by what they leave unmet, dq [n]; miss [r] of what is tracked after it."""

    u: np.ndarray
    dq: np.ndarray
    miss: np.ndarray


class Fitter:
    """Inputs of a plant within limits (lower [m], upper [m]) at states of a motion; rates (low [m], high [m]): how fast
    they may change, a second; duration [s]: time in which masses yield; loops: Closing of the plant, or None."""

    def __init__(self, plant, tracked, limits, rates, duration, loops=None):
        robot, s = plant.robot, scales(plant.robot)
        self.plant, self.tracked, self.size, self.loops = plant, tracked, s.u, loops
        self.limits, self.rates = limits, rates
        self._own, self._energy, self._yielding = plant.free, s.energy, duration**-2
        zero, grid = np.zeros(robot.n), np.ix_(plant.free, plant.free)
        K = np.array(ca.DM(Statics(robot, ca.DM(zero)).stiffness()))
        M, _, _ = plant.yielding(zero, zero, np.zeros(robot.m))
        self._size = s.q[plant.free]
        values, V = np.linalg.eigh((K + M * self._yielding)[grid] * np.outer(self._size, self._size) / s.energy)
        values = np.maximum(values, FLAT * np.max(values, initial=0.0))
        self._unit = self._size[:, None] * V / np.sqrt(values)  # displacements [n_f x n_f] of unit energy at q = 0
        self._stiffness = V * values @ V.T

    def _units(self, q):
        """Displacements [n_f x d] that loops leave at q, of unit energy at q = 0."""
        if not self.loops:
            return self._unit
        Z = self.loops.left(q)
        return self._size[:, None] * (Z @ np.linalg.inv(np.linalg.cholesky(Z.T @ self._stiffness @ Z)).T)

    def closed(self, motion):
        """The motion with its loops closed, None where they do not close."""
        if not self.loops:
            return motion
        found, status = self.loops.closed(motion)
        return found if status is None else None

    def within(self, before, dt):
        """Limits (lower [m], upper [m]) of inputs that were `before` [m] dt seconds ago."""
        (lower, upper), (low, high) = self.limits, self.rates
        return np.maximum(lower, before + low * dt), np.minimum(upper, before + high * dt)

    def fit(self, motion, k, near, limits=None):
        """Fit at sample k of a Wanted motion; `near`: inputs at about this time."""
        own, plant, state = self._own, self.plant, motion.state(k)
        unit = self._units(state[0])
        M, K, _ = plant.yielding(*state[:2], near)
        if self.loops:
            K = K - self.loops.turning(state[0], self.loops.shared(state[0], plant.missing(*state, near))[0])
        columns = plant.columns(*state, self.size) * self.size
        forces = np.column_stack([columns, -plant.missing(*state, 0 * near)])[own]
        moved = self._softness((K + M * self._yielding)[np.ix_(own, own)], unit) @ (unit.T / self._energy) @ forces
        miss, J = self.tracked(state[0], motion.targets[k])
        seen = J[:, own] @ unit @ moved
        seen[:, -1] += miss
        rest = motion.rest[k] / self.size
        x = self._least(np.vstack([seen, ENERGY * moved]), rest, near / self.size, limits or self.limits)
        dq = np.zeros(plant.n)
        dq[own] = unit @ (moved[:, :-1] @ x + moved[:, -1])
        return Fit(self.size * x, dq, seen[:, :-1] @ x + seen[:, -1])

    def _least(self, rows, rest, near, limits):
        """Inputs over their size, within limits, that make rows [.. x m + 1] of them and of 1 least, near `rest`."""
        m, (lower, upper) = near.size, (limit / self.size for limit in limits)
        Q, R = np.linalg.qr(np.vstack([rows[:, :-1], EFFORT * np.eye(m)]))
        c = -Q[:-m].T @ rows[:, -1]
        x = near
        for _ in range(ROUNDS):
            x = rest = bounded(R, c + EFFORT * Q[-m:].T @ rest, lower, upper, x)
        return x

    def _softness(self, K, unit):
        """Inverse of the tangent in displacements of unit energy; where it gives way or nearly so, as if it did not."""
        K = unit.T @ K @ unit / self._energy
        even = (K + K.T) / 2
        try:
            np.linalg.cholesky(even - SOFTEST * np.eye(K.shape[0]))
            return np.linalg.inv(K)
        except np.linalg.LinAlgError:
            values, V = np.linalg.eigh(even)
            return V / np.maximum(values, SOFTEST) @ V.T
