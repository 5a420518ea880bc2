"""Critical points of a branch of equilibria: where stiffness is lost, and the branches that leave from there.

On the motions that loops leave, H v = 0 with w^T H = 0. If the change g of the force with the parameter does work on
the mode, w^T g /= 0, the branch turns back (limit point); if it does none, another branch crosses it (bifurcation),
along the direction in the span of t and (v, 0) across t. Without a potential, stability may also be lost where H stays
regular, by two motions that drive each other (flutter): no other equilibrium is near, and no critical point.
Source: H. Keller, in "Applications of Bifurcation Theory", 1977; R. Seydel, "Practical Bifurcation and Stability
Analysis", 2010, ch. 5.
"""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.programs.equilibria.branches import Branch, follow
from socontrol.programs.equilibria.family import CLOSE, Point
from socontrol.programs.equilibria.stability import MARGINAL

ROOT, ZERO = 1e-10, 1e-13  # share of a step, and value, at which a root is found
HALVINGS = 80
NULL = 1e-7  # singular value of H, which is of the size of 1: less is none
ASLANT = 1e-2  # work: below, another branch may be near, and the point is found from points further off
NODES, SPREADS = 8, (0.5, 0.1, 0.02)  # of these: how many, and over which share of a step to either side
SMOOTH = 1e-9  # share of the highest terms of a polynomial through these: of a function that is smooth
NOTHING = 1e-8  # change of the scaled force: rounding, as where all forces vanish
IDLE = 1e-6  # work of the change of the force on a mode, over the size of that change: less is none
MET, ALIKE = 1e-4, 0.9  # scaled distance to a known critical point, and cosine between modes: the branch meets it
SAME = 1e-6  # share of a step: nearer roots are one
KICKS = (1e-3, 4e-3, 2e-4, 1e-2, 2e-2)  # first steps onto another branch: short, so that nothing happens before
CROWDED, SMALLEST = 0.1, 0.2  # root of the least other eigenvalue below which they are shorter still, to which share


@dataclass(frozen=True)
class Critical:
    """A limit point or bifurcation: modes [n x d] (largest scaled entry 1), work of the changing force on them over the
    size of that change, eigenvalue of H that vanishes, counts of unstable motions before and after."""

    point: Point
    kind: str
    modes: np.ndarray
    work: float
    eigenvalue: float
    before: int
    after: int

    @property
    def loses(self):
        """Whether stability is lost there, along the way it was passed."""
        return self.before == 0 and self.after > 0


class Finder:
    """The critical points of a Family's branches, in the order in which they are found."""

    def __init__(self, family):
        self.family, self.found = family, []

    def between(self, a, b):
        """[(Point, (index in `found`, whether it was known before))] between neighbours on a branch, in order; none
        where b is on another branch, as it is if its parameter goes on as that of a in spite of a limit point."""
        marks, after, known = [], a.unstable, len(self.found)
        for found, change in self._roots(a, b):
            before, after = after, after + change
            critical = self._described(found, a, b, before, after)
            if critical is None:
                continue
            k = self._index(critical)
            if k >= known and marks and marks[-1][1][0] == k:  # modes lost at once, told apart by rounding
                self.found[k] = replace(self.found[k], after=after)
                continue
            if k == len(self.found):
                self.found.append(critical)
            marks.append((critical.point, (k, k < known)))
        if marks and marks[-1][1][0] >= known and after != b.unstable:  # a change whose place was not found
            self.found[-1] = replace(self.found[-1], after=b.unstable)
        passed = [self.found[k] for _, (k, _) in marks]
        turns = sum(critical.kind == "limit point" and critical.work > ASLANT for critical in passed)
        if turns and turns % 2 != (a.t[-1] * b.t[-1] < 0):
            del self.found[known:]
            return []
        return marks

    def _roots(self, a, b):
        """[(Point, change of the count of unstable motions)] where something happens between a and b, in order."""
        roots = []
        for test, change in self._tests(a, b):
            root = self._between_nodes(a, b, test, self._root(a, b, test))
            if root is None:
                continue
            same = next((other for other in roots if abs(root[0] - other[0]) <= SAME), None)
            if same is None:
                roots.append([*root, change])
            else:
                same[2] += change
        return [(point, change) for _, point, change in sorted(roots, key=lambda root: root[0])]

    def _tests(self, a, b):
        """[(function of a Point that changes its sign where something happens between a and b, change of the count of
        unstable motions there)]."""
        (low, high), change = sorted((a.unstable, b.unstable)), 1 if b.unstable > a.unstable else -1
        tests = [(_eigenvalue(j, a, b), change) for j in range(low, high)]
        return tests + [(lambda x: x.t[-1], 0)] * bool(a.t[-1] * b.t[-1] < 0)

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
        for spread in SPREADS:
            points = [family.corrected(a, (root[0] + spread * x) * way)[0] for x in nodes]
            if any(point is None for point in points):
                continue
            values = np.array([test(point) for point in points])
            terms = np.abs(np.polynomial.chebyshev.chebfit(nodes, values, NODES - 1))
            if np.max(terms[-2:]) > SMOOTH * np.max(terms):  # as where another eigenvalue becomes the j-th
                continue
            powers = np.linalg.inv(np.vander(nodes))
            near = np.roots(powers @ values)
            near = near[np.argmin(np.abs(near))] if near.size else np.nan
            if not abs(near) < 1 / NODES or abs(near.imag) > ROOT:
                continue
            rows = np.array([[*point.q, *point.lam, point.s] for point in points])
            q, lam, s = np.split(np.vander([near.real], NODES)[0] @ (powers @ rows), [a.q.size, -1])
            point = family.point(q, lam, float(s[0]), a.t)
            if point is not None and _work(point)[1] and family.left(point) <= CLOSE:
                return root[0] + spread * near.real, point
        return root

    def _described(self, point, a, b, before, after):
        """Critical at a point between a and b, None where H is regular."""
        force, count = _work(point)
        if not count:
            return None
        right = np.linalg.svd(point.H)[2]
        moved = point.Z @ right[-count:].T
        if count > 1:  # the modes whose stiffness changes at rates of their own
            change = sum(side * (moved.T @ x.Z) @ x.H @ (x.Z.T @ moved) for side, x in ((1, b), (-1, a)))
            moved = moved @ np.linalg.eigh((change + change.T) / 2)[1]
        modes = np.zeros((point.q.size, count))
        moved /= np.max(np.abs(moved), axis=0)
        first = np.argmax(np.abs(moved) > 0.5, axis=0)  # the first large entry is positive: modes have no sign
        modes[self.family.free] = moved * np.sign(moved[first, np.arange(count)]) * self.family.size[:, None]
        kind = "limit point" if force > IDLE else "bifurcation"
        if kind == "bifurcation":  # its tangent is that of the branch passed: where two cross, both would do
            both = self.family.tangents(point, count + 1)
            along = both @ (both.T @ self.family.distance(a, b))
            point = replace(point, t=along / np.linalg.norm(along))
        vanishing = point.eigenvalues[np.argsort(np.abs(point.eigenvalues))[count - 1]]
        return Critical(point, kind, modes, force, float(vanishing), before, after)

    def _index(self, critical):
        """Index in `found` of the critical point that this one is, that of the next if it is new."""
        for k, other in enumerate(self.found):
            near = np.linalg.norm(self.family.distance(critical.point, other.point)) < MET
            if near and self._alike(critical.modes, other.modes):
                return k
        return len(self.found)

    def _alike(self, a, b):
        """Whether the modes of one are among those of the other."""
        a, b = (np.linalg.qr(modes[self.family.free] / self.family.size[:, None])[0] for modes in (a, b))
        return np.linalg.svd(a.T @ b, compute_uv=False)[-1] > ALIKE

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
        other = np.sort(np.abs(critical.point.eigenvalues))[critical.modes.shape[1] :]
        share = np.clip(np.sqrt(np.min(other, initial=1.0)) / CROWDED, SMALLEST, 1.0)  # stiffness falls by the square
        for step in share * np.array(KICKS):
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
    count, size = int(np.sum(values <= NULL)), max(float(np.linalg.norm(point.g)), NOTHING)
    return float(np.linalg.norm(left[:, len(values) - count :].T @ point.g)) / size, count


def _eigenvalue(j, a, b):
    """The j-th eigenvalue of a Point; less what counts as none where it does not change its sign between a and b, as
    beside motions that cost nothing."""
    shift = 0.0 if a.eigenvalues[j] * b.eigenvalues[j] < 0 else MARGINAL
    return lambda point: point.eigenvalues[j] + shift
