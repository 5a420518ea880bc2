"""The equilibria of a robot as one parameter changes: their equations, tangents and Newton's method across a tangent.

    r(q, s) - E^T lam = 0,    e(q, s) = 0,    s = 0 at the beginning and 1 at the end of the parameter's range.
A predicted point x* of (q, lam, s) is brought back to the equilibria in the plane t^T (x - x*) = 0. Rows of loops may
depend on each other: singular values choose those that count, at the closed shape one comes from, since linkages that
are overconstrained have more where they are open; lam is the least.
Source: H. Keller, in "Applications of Bifurcation Theory", 1977 (pseudo-arclength).
"""

from dataclasses import dataclass, field

import numpy as np

from socontrol.mechanics.loops import independent
from socontrol.programs.equilibria.stability import MARGINAL, eigenvalues

ITERATIONS = 10  # of Newton's method
EXACT, CLOSE = 1e-15, 1e-9  # scaled residual: none; and below which one that falls no more is rounding
SINGULAR = 5e-10  # singular values over the largest: directions nothing decides, in which no step is made
REGULAR = 1e5  # solution at a probe of size 1 an entry: a larger one asks for a look at the singular values
FARTHEST = 10.0  # scaled length of a step of Newton's method


@dataclass(frozen=True)
class Growth:
    """The parameter mu = start + s (stop - start). kind: `loads`, a factor on `values` [p], the parameters of the
    balance; `input` or `coordinate`, the value of the one at `index`."""

    kind: str
    start: float
    stop: float
    unit: str = "1"
    index: int = -1
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def span(self):
        return self.stop - self.start

    def at(self, s):
        """The parameter at s."""
        return self.start + s * self.span


@dataclass(frozen=True)
class Point:
    """A point of a branch: q [n], lam [k], s, and there, scaled: tangent t [f + 1] of (free q, s); Z [f x d] that loops
    leave free, stiffness H [d x d] and the change g [d] of the force with s on it; eigenvalues [d] of H, real parts."""

    q: np.ndarray
    lam: np.ndarray
    s: float
    t: np.ndarray
    Z: np.ndarray
    H: np.ndarray
    g: np.ndarray
    eigenvalues: np.ndarray

    @property
    def unstable(self):
        """How many motions are unstable."""
        return int(np.sum(self.eigenvalues < -MARGINAL))

    @property
    def flutters(self):
        """Whether what is unstable are motions that drive each other, whose eigenvalues are complex."""
        values = np.linalg.eigvals(self.H)
        growing = values[values.real < -MARGINAL]
        return bool(growing.size and np.all(np.abs(growing.imag) > MARGINAL))

    @property
    def smallest(self):
        return float(np.min(self.eigenvalues, initial=np.inf))


@dataclass(frozen=True)
class _Rows:
    """Scaled residual r [f] and e [k], their slopes in q (K, E), and in s (g, h)."""

    r: np.ndarray
    e: np.ndarray
    K: np.ndarray
    E: np.ndarray
    g: np.ndarray
    h: np.ndarray

    @property
    def left(self):
        return max(np.max(np.abs(self.r), initial=0.0), np.max(np.abs(self.e), initial=0.0))


class Family:
    """The equilibria of a Balance (or ClosedBalance) at inputs u [m] as a Growth goes on.

    free: mask [n] of the coordinates that are not held; conservative: whether all forces have a potential.
    """

    def __init__(self, balance, growth, u, free, conservative):
        self.balance, self.growth, self.u, self.free = balance, growth, np.array(u, dtype=float), free
        self.conservative, self.count = conservative, 0
        self.size, self.force = balance.scales.q[free], balance.scales.force[free]
        self.loops = bool(balance.robot.loops)
        self.reach = balance.reach if self.loops else np.zeros(0)

    def given(self, s, q):
        """(q, u, p) with the parameter in its place."""
        growth, q, u, p = self.growth, np.array(q, dtype=float), self.u.copy(), None
        if growth.kind == "loads":
            p = growth.at(s) * growth.values
        elif growth.kind == "input":
            u[growth.index] = growth.at(s)
        else:
            q[growth.index] = growth.at(s)
        return q, u, p

    def _rows(self, q, lam, s):
        balance, growth, free = self.balance, self.growth, self.free
        q, u, p = self.given(s, q)
        r, K, B = (np.array(x) for x in balance.evaluate(q, u, p))
        e, E, S = balance.closing(q, lam, p) if self.loops else (np.zeros(0), np.zeros((0, q.size)), 0.0)
        r, K, e, E = r - E.T @ lam, K - S, np.array(e) / self.reach, E / self.reach[:, None]
        h = np.zeros(e.size)
        if growth.kind == "loads":  # forces are linear in what is multiplied
            g = np.array(balance.evaluate(q, u, p + growth.span * growth.values)[0]) - E.T @ (lam * self.reach) - r
        elif growth.kind == "input":
            g = -growth.span * B[:, growth.index]
        else:
            g, h = growth.span * K[:, growth.index], growth.span * E[:, growth.index]
        K = K[np.ix_(free, free)] * self.size / self.force[:, None]
        return _Rows(r[free] / self.force, e, K, E[:, free] * self.size, g[free] / self.force, h)

    def _split(self, q, s):
        """Split of the rows of loops."""
        if not self.loops:
            return independent(np.zeros((0, self.size.size)), (), 1.0)
        q, _, p = self.given(s, q)
        return self.balance.split(q, self.free, p)

    def distance(self, a, b):
        """Scaled way from point a to point b [f + 1]."""
        return np.append((b.q - a.q)[self.free] / self.size, b.s - a.s)

    def point(self, q, lam, s, ahead):
        """The Point at an equilibrium, its tangent along `ahead` [f + 1]; None where numbers are not finite."""
        q = self.given(s, q)[0]
        rows = self._rows(q, np.zeros_like(lam), s)
        split = self._split(q, s)
        if self.loops:
            lam = self.balance.least(split, rows.r)
            rows = self._rows(q, lam, s)
        if not all(np.all(np.isfinite(x)) for x in (rows.r, rows.K, rows.E, rows.g)):
            return None
        system = self._system(rows, split.inverse, ahead)
        t = _solved(system, np.append(np.zeros(len(system) - 1), 1.0))
        t = np.append(t[: self.size.size], t[-1])
        Z = split.left
        drawn = -split.held.T @ (split.inverse.T @ rows.h)  # motion that a driven coordinate imposes through loops
        H = Z.T @ rows.K @ Z
        values, g = eigenvalues(H, self.conservative), Z.T @ (rows.g + rows.K @ drawn)
        return Point(q, lam, float(s), _without_neutral(t / np.linalg.norm(t), Z, H, g), Z, H, g, values)

    def tangents(self, point, count):
        """Orthonormal directions [f + 1 x count] of (free q, s) in which equilibria go on from a point."""
        inverse = self._split(point.q, point.s).inverse
        system = self._system(self._rows(point.q, point.lam, point.s), inverse, np.zeros(self.size.size + 1))[:-1]
        steep = max(1.0, float(np.linalg.norm(system[:, -1])))
        system[:, -1] /= steep
        null = np.linalg.svd(system)[2][-count:].T
        null[-1] /= steep
        return np.linalg.qr(np.vstack([null[: self.size.size], null[-1:]]))[0]

    def left(self, point):
        """Largest scaled residual at a point."""
        return self._rows(point.q, point.lam, point.s).left

    def _system(self, rows, inverse, plane):
        """Bordered tangent of (q, y, s) with lam scaled = inverse y; the last row is the plane's normal."""
        rank, count = inverse.shape[1], self.size.size
        last = np.concatenate([plane[:-1], np.zeros(rank), plane[-1:]])
        return np.vstack([
            np.hstack([rows.K, -rows.E.T @ inverse, rows.g[:, None]]),
            np.hstack([inverse.T @ rows.E, np.zeros((rank, rank)), (inverse.T @ rows.h)[:, None]]),
            last.reshape(1, count + rank + 1),
        ])  # fmt: skip

    def corrected(self, point, way, plane=None):
        """(the Point near point + way [f + 1] in the plane across `plane`, iterations); None where there is none."""
        plane = point.t if plane is None else plane
        q, lam, s, scale = point.q.copy(), point.lam.copy(), point.s + way[-1], self.balance.scales.energy
        q[self.free] += way[:-1] * self.size
        if not np.all(np.isfinite(q)) or self.balance.robot.overstrained(q):
            return None, 0
        inverse, off, before = self._split(point.q, point.s).inverse, 0.0, np.inf
        for count in range(1, ITERATIONS + 1):
            self.count += 1
            rows = self._rows(q, lam, s)
            left = rows.left
            if not np.isfinite(left) or (left <= CLOSE and left >= before / 2) or left <= EXACT:
                break
            before = left
            step = -_solved(self._system(rows, inverse, plane), np.concatenate([rows.r, inverse.T @ rows.e, [off]]))
            if not np.all(np.abs(step) < FARTHEST):
                return None, count
            q[self.free] += step[: self.size.size] * self.size
            lam = lam + inverse @ step[self.size.size : -1] * (scale / self.reach if self.loops else 0.0)
            s, off = s + step[-1], 0.0
            if self.balance.robot.overstrained(q):
                return None, count
        if not left <= CLOSE:
            return None, count
        return self.point(q, lam, s, plane), count

    def at(self, a, b, s):
        """The Point at a given s between points a and b; None where Newton's method fails."""
        share = (s - a.s) / (b.s - a.s) if b.s != a.s else 0.0
        upright = np.append(np.zeros(self.size.size), 1.0)
        way = share * self.distance(a, b)
        way[-1] = s - a.s
        found = self.corrected(a, way, upright)[0]
        return found and self.point(found.q, found.lam, s, a.t)


def _without_neutral(t, Z, H, g):
    """The tangent without motions that cost nothing and that the parameter does not drive, as of a round rod about its
    own axis: a branch does not go astray along these."""
    left, values, right = np.linalg.svd(H)
    idle = values <= MARGINAL
    if not idle.any() or np.linalg.norm(left[:, idle].T @ g) > 1e-6 * np.linalg.norm(g):
        return t
    free = (Z @ right[idle].T) @ (right[idle] @ (Z.T @ t[:-1]))
    rest = np.append(t[:-1] - free, t[-1])
    size = np.linalg.norm(rest)
    return rest / size if size > 0.1 else t


def _solved(system, rhs):
    """Least solution of a bordered system, its last column and row brought to the size of the others first."""
    system, rhs = system.copy(), rhs.copy()
    steep = max(1.0, float(np.linalg.norm(system[:-1, -1])))
    system[:, -1] /= steep
    size = np.linalg.norm(system[-1])
    system[-1], rhs[-1] = system[-1] / size, rhs[-1] / size
    probe = np.random.default_rng(0).standard_normal(rhs.size)  # shows a small singular value by its solution
    try:
        found, shown = np.linalg.solve(system, np.column_stack([rhs, probe])).T
    except np.linalg.LinAlgError:
        found, shown = rhs, np.full_like(rhs, np.inf)
    if not np.linalg.norm(shown) <= REGULAR:
        found = np.linalg.lstsq(system, rhs, rcond=SINGULAR)[0]
    found[-1] /= steep
    return found
