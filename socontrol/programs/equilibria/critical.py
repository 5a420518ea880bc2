"""Critical points of a branch of equilibria: where stiffness is lost, and the branches that leave from there.

On the motions that loops leave, H v = 0 with w^T H = 0. If the change g of the force with the parameter does work on
the mode, w^T g /= 0, the branch turns back (limit point); if it does none, another branch crosses it (bifurcation),
along the direction in the span of t and (v, 0) across t.
Source: H. Keller, in "Applications of Bifurcation Theory", 1977; R. Seydel, "Practical Bifurcation and Stability
Analysis", 2010, ch. 5.
"""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.programs.equilibria.branches import FIRST, Branch, follow
from socontrol.programs.equilibria.family import CLOSE, Point

ROOT, ZERO = 1e-10, 1e-13  # share of a step, and value, at which a root is found
HALVINGS = 80
NULL = 1e-7  # singular value of H, which is of the size of 1: less is none
ASLANT = 1e-2  # work: below, another branch may be near, and the point is found from points further off
NODES, SPREAD = 8, 0.5  # of these: how many, and over which share of a step to either side
IDLE = 1e-6  # work of the change of the force on a mode, over the size of that change: less is none
MET = 1e-4  # scaled distance to a critical point that is known: the branch meets it
KICKS = (1.0, 0.5, 2.0, 0.25, 0.1, 4.0)  # times FIRST: first steps onto another branch


@dataclass(frozen=True)
class Critical:
    """A limit point or bifurcation: modes [n x d] (largest scaled entry 1), work of the changing force on them over the
    size of that change, counts of unstable motions before and after."""

    point: Point
    kind: str
    modes: np.ndarray
    work: float
    before: int
    after: int


class Finder:
    """The critical points of a Family's branches, in the order in which they are found."""

    def __init__(self, family):
        self.family, self.found = family, []

    def between(self, a, b):
        """[(Point, (index in `found`, whether it was known before))] between neighbours on a branch, in order."""
        roots = []
        for test in self._tests(a, b):
            root = self._between_nodes(a, b, test, self._root(a, b, test))
            if root is not None and all(abs(root[0] - other[0]) > 1e-6 for other in roots):
                roots.append(root)
        marks = []
        for _, found in sorted(roots, key=lambda root: root[0]):
            critical = self._described(found, a, b)
            if critical is not None:
                known = self._known(critical.point)
                if known < 0:
                    self.found.append(critical)
                marks.append((critical.point, (len(self.found) - 1 if known < 0 else known, known >= 0)))
        return marks

    def _tests(self, a, b):
        """Functions of a Point that change their sign where something happens between a and b."""
        tests = []
        if self.family.conservative:
            low, high = sorted((a.unstable, b.unstable))
            tests += [lambda x, j=j: x.eigenvalues[j] for j in range(low, high)]
        elif (a.unstable - b.unstable) % 2:
            tests.append(_divergence)
        return tests + [lambda x: x.t[-1]] * bool(a.t[-1] * b.t[-1] < 0)

    def _root(self, a, b, test):
        """(share of the way, Point) where a test is zero, or None where it does not change its sign."""
        way = self.family.distance(a, b)
        (left, f), (right, g) = (0.0, test(a)), (1.0, test(b))
        if not f * g < 0:
            return None
        best, side = None, 0
        for k in range(HALVINGS):
            x = (left * g - right * f) / (g - f) if k % 8 < 6 else (left + right) / 2  # now and then for a poor slope
            point = self.family.corrected(a, x * way)[0]
            if point is None:  # beside it there may be one
                f, g = (f / 2, g) if k % 2 else (f, g / 2)
                continue
            value, best = test(point), (x, point)
            if abs(value) <= ZERO or right - left <= ROOT:
                break
            if value * f > 0:
                left, f, g, side = x, value, g / 2 if side < 0 else g, -1
            else:
                right, g, f, side = x, value, f / 2 if side > 0 else f, 1
        return best

    def _between_nodes(self, a, b, test, root):
        """The root again where another branch is near, from polynomials through points further off: rounding is an
        imperfection, which bends the branch near a bifurcation by its cube root."""
        if root is None or _work(root[1])[0] > ASLANT:
            return root
        nodes = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        way, family = self.family.distance(a, b), self.family
        points = [family.corrected(a, (root[0] + SPREAD * x) * way)[0] for x in nodes]
        if any(point is None for point in points):
            return root
        powers = np.linalg.inv(np.vander(nodes))
        slopes = powers @ np.array([test(point) for point in points])
        near = np.roots(slopes)
        near = near[np.argmin(np.abs(near))] if near.size else np.nan
        if not abs(near) < 1 / NODES or abs(near.imag) > ROOT:
            return root
        rows = np.array([[*point.q, *point.lam, point.s] for point in points])
        found = np.vander([near.real], NODES)[0] @ (powers @ rows)
        q, lam, s = np.split(found, [a.q.size, -1])
        point = family.point(q, lam, float(s[0]), a.t)
        if point is None or not (_work(point)[1] and family.left(point) <= CLOSE):
            return root
        return root[0] + SPREAD * near.real, point

    def _described(self, point, a, b):
        """Critical at a point between a and b."""
        force, count = _work(point)
        if not count:
            return None
        right = np.linalg.svd(point.H)[2]
        moved = point.Z @ right[-count:].T
        modes = np.zeros((point.q.size, count))
        moved /= np.max(np.abs(moved), axis=0)
        first = np.argmax(np.abs(moved) > 0.5, axis=0)  # the first large entry is positive: modes have no sign
        modes[self.family.free] = moved * np.sign(moved[first, np.arange(count)]) * self.family.size[:, None]
        kind = "limit point" if force > IDLE else "bifurcation"
        if kind == "bifurcation":  # its tangent is that of the branch passed: where two cross, both would do
            both = self.family.tangents(point, count + 1)
            along = both @ (both.T @ self.family.distance(a, b))
            point = replace(point, t=along / np.linalg.norm(along))
        return Critical(point, kind, modes, force, a.unstable, b.unstable)

    def _known(self, point):
        """Index of the critical point that this one is, -1 if it is new."""
        for k, other in enumerate(self.found):
            if np.linalg.norm(self.family.distance(point, other.point)) < MET:
                return k
        return -1

    def ways(self, critical):
        """Directions [f + 1] in which branches leave a bifurcation, both ways along each mode."""
        t, found = critical.point.t, []
        for mode in critical.modes.T:
            way = np.append(mode[self.family.free] / self.family.size, 0.0)
            way = way / np.linalg.norm(way)
            way = way - (way @ t) * t
            way = way / np.linalg.norm(way)
            found += [way, -way]
        return found

    def switched(self, critical, way, points):
        """Branch that leaves a bifurcation along `way`; None where no first step onto it was found."""
        for kick in KICKS:
            step = kick * FIRST
            first = self.family.corrected(critical.point, step * way, way)[0]
            if first is None:
                continue
            aside = self.family.distance(critical.point, first) - step * way
            if np.linalg.norm(aside) <= step:
                branch = follow(self.family, first, points, self.between, lambda mark: "meets" if mark[1] else None)
                points = [replace(critical.point, t=way), *branch.points]
                return Branch(points, branch.ended, {k + 1: mark for k, mark in branch.marks.items()})
        return None


def _work(point):
    """(work of the changing force on the modes at a point over the size of that change, how many modes there are)."""
    left, values, _ = np.linalg.svd(point.H)
    count, size = int(np.sum(values <= NULL)), max(float(np.linalg.norm(point.g)), 1e-300)
    return float(np.linalg.norm(left[:, len(values) - count :].T @ point.g)) / size, count


def _divergence(point):
    """Changes its sign where a real eigenvalue of H does."""
    return np.linalg.slogdet(point.H)[0] * float(np.min(np.abs(np.linalg.eigvals(point.H)), initial=np.inf))
