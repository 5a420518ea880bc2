"""A wanted motion put onto closed loops, and what loops leave of displacements and forces.

Samples are put back onto e(q) = 0 by the least change of coordinates over their scales, rates onto A q' = 0 and
accelerations onto A q'' + A' q' = 0. Of a force the loops bear A^T lam, the least lam; what is left is up to the
inputs, which move the robot along Z, A Z = 0.
"""

from dataclasses import replace

import numpy as np

from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.closing import CLOSED, ITERATIONS, Assembly
from socontrol.programs.motions.closed_start import Begun
from socontrol.programs.motions.conditions import Constrained
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.integrators import March
from socontrol.programs.motions.loop_answer import with_loops
from socontrol.programs.motions.ties import Ties
from socontrol.programs.result import Status

FIRST = 1e3  # by so much given coordinates count more than others
PULLS, STILL = 50, 1e-12  # steps along closed shapes to the nearest one; of a coordinate's scale: no step
FOLLOWED, SLOW = 1e-7, 1e-9  # of the largest rate, or of the robot's length in the whole time: what is left of A q'


class Closing:
    """Loops of a robot, moved by the coordinates `free` [n mask]; first: indices of those that are to stay first."""

    def __init__(self, balance, free, first=()):
        self.balance, self.free = balance, free
        self._size, self._force = balance.scales.q[free], balance.scales.force[free]
        self._assembly = Assembly(balance, free)
        self._weights = np.where(np.isin(np.flatnonzero(free), list(first)), FIRST, 1.0)
        self._rows = buffered(balance.robot.functions().loop_motion)

    @classmethod
    def of(cls, question, balance=None):
        """Closing of a question's robot, by all coordinates that are not held; None without loops.

        balance: its ClosedBalance, where it is made.
        """
        robot = question.loaded
        if not robot.loops:
            return None
        free = ~np.isin(np.arange(robot.n), list(question.named("coordinates", question.coordinates)))
        return cls(balance or ClosedBalance(replace(robot, compiled=False)), free)

    def others(self, given):
        """The same loops, closed without the coordinates `given` (indices)."""
        free = self.free.copy()
        free[list(given)] = False
        return Closing(self.balance, free)

    def keeping(self, given):
        """The same loops, closed by all, but by the coordinates `given` (indices) as little as can be."""
        return Closing(self.balance, self.free, given)

    def left(self, q):
        """Z [f x d]: closed motions of the free coordinates over their scales, orthonormal."""
        return self.balance.split(q, self.free).left

    def shared(self, q, r):
        """What loops bear of a force r [n] on the free coordinates, lam [k], and what they leave of it [f]."""
        split, scaled = self.balance.split(q, self.free), r[self.free] / self._force
        return self.balance.least(split, scaled), self._force * (scaled - split.held.T @ (split.held @ scaled))

    def turning(self, q, lam):
        """d(A^T lam)/dq [n x n]."""
        return self.balance.closing(q, lam)[2]

    def redundant(self, q):
        """{loop: rows that hold nothing of their own}."""
        return self.balance.redundant(q, self.free)

    def closed(self, motion):
        """(the Wanted motion with its loops closed, None), or (the motion as it is, why they do not close)."""
        dq, change = np.zeros(motion.q.shape), None
        for k, q in enumerate(motion.q):
            found, error = self._nearest(q, change)
            if not error <= CLOSED:
                return motion, _timed(motion.t[k], self._assembly.told(found))
            change = dq[k] = found - q
        found = motion.moved(dq)
        rates = [self._following(*found.state(k)) for k in range(len(found.t))]
        left, largest = (np.array([row[i] for row in rates]) for i in (2, 3))
        worst = int(np.argmax(left))
        if left[worst] > max(FOLLOWED * np.max(largest), SLOW / motion.t[-1]):
            told = "Loops do not let the given coordinates move so; give other ones, or keep away from dead points."
            return motion, _timed(motion.t[worst], Status("infeasible", told))
        return replace(found, qd=np.array([row[0] for row in rates]), qdd=np.array([row[1] for row in rates])), None

    def _nearest(self, q, change):
        """(the closed shape nearest to q [n], scaled error), looked for at q + change, None: from anywhere."""
        wanted = q[self.free] / self._size
        with np.errstate(all="ignore"):
            found, error = self._assembly.assembled(q) if change is None else self._closed(q + change)
            for _ in range(PULLS):
                Z = self.left(found) if error <= CLOSED else np.zeros((0, 0))
                if not Z.size:
                    break
                away = (wanted - found[self.free] / self._size) * self._weights
                pull = Z @ np.linalg.lstsq(self._weights[:, None] * Z, away, rcond=None)[0]
                if np.max(np.abs(pull)) <= STILL:
                    break
                trial = found.copy()
                trial[self.free] += pull * self._size
                found, error = self._closed(trial)
        return found, error

    def _closed(self, q):
        return self._assembly.closed(q, ITERATIONS)

    def _following(self, q, qd, qdd):
        """The nearest rates and accelerations that keep loops closed, what is left of A q', and |A||q'|."""
        split, reach = self.balance.split(q, self.free), self.balance.reach
        back = self._size[:, None] * (split.held.T @ split.inverse.T)
        qd, qdd = qd.copy(), qdd.copy()
        A = self._rows(q, qd)[1].T / reach[:, None]
        qd[self.free] -= back @ (A @ qd)
        _, A, bias = self._rows(q, qd)
        A = A.T / reach[:, None]
        qdd[self.free] -= back @ (A @ qdd + bias[0] / reach)
        return qd, qdd, np.max(np.abs(A @ qd)), np.max(np.abs(A) @ np.abs(qd))


def of_coordinates(question, loops, motion, given):
    """(a motion of `given` coordinates (indices) with its loops closed, None), or (..., Status: why it is none).

    The others close them, as near to the guess, 0 without one, as they can; where they cannot, all do.
    """
    robot, others, asked = question.loaded, loops.others(given), motion.q.copy()
    guess = question.vector("coordinates", question.guess.coordinates, "guess.coordinates")
    asked[:, others.free] = guess[others.free]
    motion = replace(motion, q=asked)
    found, status = others.closed(motion)
    if status is None:
        return found, None
    found, status = loops.keeping(given).closed(motion)
    off = np.abs(found.q - asked)[:, given] * displacement_weights(robot)[given]
    beyond = off > question.motion.tolerance * robot.length
    if status is not None or not beyond.any():
        return found, status
    k = int(np.argmax(beyond.any(axis=1)))
    i = int(np.argmax(off[k]))
    name, unit, x, near = (row[given[i]] for row in (robot.coordinates, robot.coordinate_units, asked[k], found.q[k]))
    told = f"Loops do not close with {name} at {x:.6g} {unit} and the others as given: the nearest found is {near:.6g}"
    fix = "give fewer coordinates, or a guess of the others"
    return found, _timed(motion.t[k], Status("infeasible", f"{told} {unit}; {fix}."))


def bearing(result, loops, plant):
    """The Result of a motion of a plant with what its loops bear, array `lam`, and how well they are closed."""
    arrays, ties = result.arrays, Ties(plant.robot, plant.free)
    if "lam" not in arrays:
        return result
    for t, q in zip(arrays["t"], arrays["q"], strict=True):
        ties.choose(t, q)
    begun = Begun(arrays["q"][0], arrays["qd"][0], redundant=loops.redundant(arrays["q"][0]))
    return with_loops(result, Constrained(plant, None, ties), March(lam=arrays["lam"]), begun)


def _timed(t, status):
    return Status(status.outcome, f"At t = {t:.4g} s: {status.message}")
