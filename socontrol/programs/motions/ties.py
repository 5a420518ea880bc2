"""Loops in motion: as many combinations c = T e(q) of their rows as are independent, all in metres.

T^T has orthonormal columns over rows of which those in rad count times the robot's length; it is chosen at one shape
and anew where another shape makes it a poor choice. The multipliers lam' of c stand for lam = -T^T lam' of the rows, up
to what rows that depend on each other may share among them: the least is told.
"""

import numpy as np

from socontrol.mechanics.loops import independent, loop_of, reach, units_of
from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.scaling import scales

POOR = 0.3  # of what independent rows hold at least: combinations that hold less are chosen anew
NEAR = 0.3  # of what the weakest combination holds at the most: from there dead points are looked for
PLACES, THIRDS = 9, 16  # looks on the way to a dead point; then a third of the way between them is left out each time
LOST = 1e-2  # of what the weakest combination holds mostly: less is a dead point, as near as steps can tell


class Ties:
    """The loops of a robot on the coordinates `moving`: at most k combinations, `rank` of them that hold something."""

    def __init__(self, robot, moving):
        f = robot.functions()
        self.robot, self.moving, self.size = robot, moving, scales(robot).q[moving]
        self._rows, self._closing = buffered(f.loop_motion), buffered(f.closing)
        self.units = units_of(robot.loops)
        self.reach = reach(self.units, robot.length)
        self.metres = robot.length / self.reach
        self.k = min(len(self.units), moving.size)
        self.T, self.rank = np.zeros((self.k, len(self.units))), -1
        self._looks, self._before, self._most = [], None, 0.0

    def rows(self, q, qd):
        """c [k], A [k x n], c' [k], what A q'' must be to keep c'' = 0, and zeros [k]."""
        e, A, turning = self._rows(q, qd)
        A = self.T @ A.T
        return self.T @ e[0], A, A @ qd, self.T @ turning[0], np.zeros(self.k)

    def turning(self, q, lam):
        """d(A^T lam)/dq [n x n] under multipliers of combinations."""
        return -self._closing(q, -self.T.T @ lam)[2].T

    def error(self, q):
        """e [number of rows] of all rows, in their units."""
        return self._rows(q, 0.0)[0][0].copy()

    def _split(self, q):
        A = self._rows(q, 0.0)[1].T
        return A, independent(A[:, self.moving] * self.size, self.units, self.robot.length)

    def _scaled(self, A):
        return A[:, self.moving] * self.size / self.reach[:, None]

    def choose(self, t, q):
        """Whether T was chosen anew at q."""
        A, split = self._split(q)
        rank, s = split.rank, split.s
        self._watch(t, q, s[-1] if rank else 1.0)
        if rank == self.rank:
            own = self.T[:rank] / self.metres @ self._scaled(A)
            if not rank or np.linalg.svd(own, compute_uv=False)[-1] >= POOR * s[-1]:
                return False
        self.rank, self.T[:] = rank, 0.0
        self.T[:rank] = split.U.T * self.metres
        return True

    def _watch(self, t, q, held):
        """Note what the weakest combination held at the least since the look before."""
        self._most = max(held, self._most)
        if self._looks and min(held, self._looks[-1][1]) < NEAR * self._most:
            held = min(held, self._weakest(self._before, q - self._before))
        self._looks.append((float(t), held))
        self._before = q.copy()

    def _weakest(self, q, change):
        """What the weakest combination holds where it holds least on the straight way from q by `change`."""

        def held(x):
            A = self._scaled(self._rows(q + x * change, 0.0)[1].T)
            return np.linalg.svd(A, compute_uv=False)[self.rank - 1]

        places = np.linspace(0.0, 1.0, PLACES)
        values = [held(x) for x in places]
        k = int(np.argmin(values))
        low, high = places[max(k - 1, 0)], places[min(k + 1, PLACES - 1)]
        for _ in range(THIRDS):
            one, two = low + (high - low) / 3, high - (high - low) / 3
            low, high = (low, two) if held(one) < held(two) else (one, high)
        return held((low + high) / 2)

    @property
    def share(self):
        """What the weakest combination held at the last look, of what it did at the most."""
        return self._looks[-1][1] / self._most if self._looks else 1.0

    @property
    def singular(self):
        """Times at which rows that else are independent came to depend on each other."""
        held = np.array([held for _, held in self._looks])
        low = held < LOST * np.median(held) if held.size else np.zeros(0, dtype=bool)
        return [t for (t, _), now, before in zip(self._looks, low, [False, *low], strict=False) if now and not before]

    def least(self, q, lam):
        """The least multipliers of all rows for those of combinations, and what else driven coordinates feel [n]."""
        A, split = self._split(q)
        given = -self.T.T @ lam
        force = self.size * (A[:, self.moving].T @ given)
        found = split.least(force) / self.reach
        return found, A.T @ (given - found)

    def opened(self, q):
        """(name of the loop that is furthest open, by how much over the robot's length, in words)."""
        e = self.error(q)
        apart = np.abs(e) * self.metres / self.robot.length
        worst = int(np.argmax(apart))
        name = loop_of(self.robot.loops, worst)
        told = f"{np.degrees(e[worst]):.3g} deg" if self.units[worst] == "rad" else f"{1e3 * e[worst]:.3g} mm"
        return name, float(apart[worst]), told
