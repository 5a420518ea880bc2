"""What an input does to one piece: lines through rods and joints, and torques, with exact derivatives.

A line runs at d(X) = (0, y, z) through a rod; its tangent is t = v / |v| with v = p + k x d + d' = E xi + d',
E = [-skew(d) I]. Axial force N: -T in a cable of tension T, +P a in a chamber of pressure P and area a. Then
    tau = N int Phi^T E^T t ds = N d(length)/dq,   d tau/dq = N int Phi^T E^T (I - t t^T)/|v| E Phi ds.
A `NormalLine` pushes along the section's normal e1 instead. Through a joint a cable runs straight between the guide
holes of its two sides, and so it does between two holes of one rigid body, where it does no work. |v| and the chord
through a joint have floors (LINE_FLOOR, CHORD_FLOOR) far below any real length, so that a line of no length keeps a
finite force. What friction makes of the tension stands in `friction`. Source: F. Renda et al., RA-L 2020 (T there is
N here).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from socontrol.lie import arcs, se3
from socontrol.mechanics.loads import dead

E1 = ca.DM([1, 0, 0])
LINE_FLOOR = 1e-12  # of |v|, 1 in a straight unstretched rod: its square vanishes in rounding unless |v| < 1e-4
CHORD_FLOOR = 1e-9  # of a chord beside its own length at q = 0: its square vanishes in rounding above 1e-1


def norm(x):
    """Length of x [3], a float where x holds numbers."""
    return ca.norm_2(x) if ca.symvar(ca.SX(x)) else float(ca.norm_2(ca.DM(x)))


@lru_cache(maxsize=1)
def line_element():
    """Function (xi, d, d') -> |v|, E^T t [6] and its derivative in xi [6 x 6], made once and inlined."""
    xi, d, slope = ca.SX.sym("xi", 6), ca.SX.sym("d", 3), ca.SX.sym("slope", 3)
    E = ca.horzcat(-ca.skew(d), ca.DM.eye(3))
    v = E @ xi + slope
    size = _size(v)
    pull = E.T @ (v / size)
    return ca.Function("line_element", [xi, d, slope], [size, pull, (E.T @ E - pull @ pull.T) / size])


def _size(v, floor=LINE_FLOOR):
    """sqrt(v . v + floor^2): smooth, and above 0 where v [3] vanishes."""
    return ca.sqrt(ca.dot(v, v) + floor**2)


@dataclass(frozen=True)
class RodLine:
    """A line through one section of rod.

    nodes: (weight [m], d [3], dd/ds [3]); gain: N per unit of input; route: its Stretch of the section; part: the x
    it covers; conservative: whether the force is the same all along it, so that it works along a length.
    """

    piece: int
    nodes: tuple
    gain: Any
    route: Any
    part: tuple = (0.0, 1.0)
    conservative: bool = True

    def length(self, tree, q):
        """int |v| ds [m]."""
        return self._sum(tree.pieces[self.piece], q)[0]

    def force(self, tree, q):
        """Generalised force [n_i] for unit input."""
        piece = tree.pieces[self.piece]
        return self.gain * (piece.Phi.T @ self._sum(piece, q)[1])

    def gradient(self, tree, q):
        """d(force)/dq [n_i x n_i]."""
        piece = tree.pieces[self.piece]
        return self.gain * (piece.Phi.T @ self._sum(piece, q)[2] @ piece.Phi)

    def _sum(self, piece, q):
        """int (|v|, E^T t, E^T (I - t t^T) E / |v|) ds over the nodes."""
        xi, totals = piece.strain(q), (0, 0, 0)
        for w, d, slope in self.nodes:
            totals = [total + w * value for total, value in zip(totals, line_element()(xi, d, slope), strict=True)]
        return totals

    def wrench(self, tree, q, x):
        """F_a = gain [d x t; t] [6] at x, body frame, for unit input; zero where the line does not run."""
        if not self.part[0] <= x <= self.part[1]:
            return ca.DM(6, 1)
        d, t = self.route.at(x), self.direction(tree, q, x)
        return self.gain * ca.vertcat(ca.cross(d, t), t)

    def direction(self, tree, q, x):
        """Unit vector [3] at x along which it pulls, body frame there."""
        xi, d = tree.pieces[self.piece].strain(q), self.route.at(x)
        v = xi[3:] + ca.cross(xi[:3], d) + (0 if self.route.parallel else self.route.slope(x))
        return v / _size(v)


@dataclass(frozen=True)
class NormalLine(RodLine):
    """A chamber that pushes along the section normal: F_a = [d x e1; e1], whatever the strain."""

    def length(self, tree, q):
        """int e1 . v ds [m], linear in q, shifted to int |v| ds at q = 0: force = gain d(length)/dq."""
        piece = tree.pieces[self.piece]
        straight = self._sum(piece, ca.DM(tree.n, 1))[0]
        return straight + self._pull().T @ (piece.Phi @ q[piece.columns])

    def force(self, tree, q):
        return self.gain * (tree.pieces[self.piece].Phi.T @ self._pull())

    def gradient(self, tree, q):
        size = tree.pieces[self.piece].size
        return ca.DM(size, size)

    def _pull(self):
        """int E^T e1 ds [6]."""
        return sum(w * ca.vertcat(ca.cross(d, E1), E1) for w, d, _ in self.nodes)

    def direction(self, tree, q, x):
        return E1


@dataclass(frozen=True)
class Chord:
    """A straight run from `start` [3, base frame of a joint] to `stop` [3, its moving frame].

    Its length is sqrt(span^2 + floor^2), floor = CHORD_FLOOR |stop - start|: where the two holes meet, the direction
    of pull is undefined, and the force passes smoothly through zero within about that distance.
    """

    piece: int
    start: Any
    stop: Any
    gain: Any
    conservative: bool = True

    def length(self, tree, q):
        return self._size(self._span(tree, q)[1])

    def directions(self, tree, q):
        """Unit vector [3] from hole to hole, in the joint's base frame and in its moving frame."""
        g, span, _ = self._span(tree, q)
        t = span / self._size(span)
        return t, se3.rotation(g).T @ t

    def force(self, tree, q):
        g, span, S = self._span(tree, q)
        t = span / self._size(span)
        return self.gain * (S.T @ ca.vertcat(ca.cross(se3.transform(g, self.stop), t), t))

    def gradient(self, tree, q):
        g, span, S = self._span(tree, q)
        size = self._size(span)
        t, y = span / size, se3.transform(g, self.stop)
        E = ca.horzcat(-ca.skew(y), ca.DM.eye(3))
        turn = E.T @ ((ca.DM.eye(3) - t @ t.T) / size) @ E
        F = ca.vertcat(ca.cross(y, t), t)
        piece = tree.pieces[self.piece]
        return self.gain * (piece.wrench_gradient(q, 1.0, F) + S.T @ (dead(y, t, 1) + turn) @ S)

    def _span(self, tree, q):
        g, S = tree.pieces[self.piece].step(q, 1.0)
        return g, se3.transform(g, self.stop) - self.start, S

    def _size(self, span):
        return _size(span, CHORD_FLOOR * norm(self.stop - self.start))


@dataclass(frozen=True)
class Run:
    """A straight run on one rigid body, from `start` to `stop` [3]: in the base frame of a piece or, `moved`, in its
    frame at x = 1. Its length stays the same, so it does no work."""

    piece: int
    moved: bool
    start: Any
    stop: Any
    gain: Any
    conservative: bool = True

    def length(self, tree, q):
        return self._size()

    def force(self, tree, q):
        return ca.DM(tree.pieces[self.piece].size, 1)

    def gradient(self, tree, q):
        size = tree.pieces[self.piece].size
        return ca.DM(size, size)

    def wrench(self, tree, q, x):
        """None [6] inside a rod that carries both holes."""
        return ca.DM(6, 1)

    def direction(self):
        """Unit vector [3] from start to stop."""
        return (self.stop - self.start) / self._size()

    def _size(self):
        return _size(self.stop - self.start)


@dataclass(frozen=True)
class Torque:
    """Input `degree` of a joint: the body wrench dual to that column of Phi, tau = S_body^T Phi (Phi^T Phi)^-1 u."""

    piece: int
    degree: int
    gain: float = 1.0
    conservative = False  # of several degrees of freedom; for one its gradient is zero anyway

    def length(self, tree, q):
        return q[tree.pieces[self.piece].columns][self.degree]

    def force(self, tree, q):
        piece = tree.pieces[self.piece]
        if piece.is_screw:
            return ca.DM.ones(1, 1)
        S_body = se3.tangent(-piece.strain(q), piece.coefficients()) @ piece.Phi
        return S_body.T @ self._wrench(piece)

    def gradient(self, tree, q):
        piece = tree.pieces[self.piece]
        if piece.is_screw:
            return ca.DM(1, 1)
        gradient = arcs.tangent_gradient(-piece.strain(q), self._wrench(piece), piece.coefficients())
        return -(piece.Phi.T @ gradient @ piece.Phi)

    def _wrench(self, piece):
        dual = piece.Phi @ ca.inv(piece.Phi.T @ piece.Phi)
        return dual[:, self.degree]


@dataclass(frozen=True)
class Bending:
    """A moment inside one section of rod, a hat over X with its top at one station: tau = Phi^T e int hat ds u.

    corners: (x, hat) at rising x from 0 to 1, straight lines between.
    """

    piece: int
    strain: int
    weight: Any
    corners: tuple
    gain: float = 1.0

    conservative = True

    def length(self, tree, q):
        """int hat strain ds [rad]: the turn that the moment works on."""
        return self.weight * tree.pieces[self.piece].strain(q)[self.strain]

    def force(self, tree, q):
        return self.weight * tree.pieces[self.piece].Phi[self.strain, :].T

    def gradient(self, tree, q):
        size = tree.pieces[self.piece].size
        return ca.DM(size, size)

    def wrench(self, tree, q, x):
        """Wrench [6] of the actuator at x for unit input, body frame."""
        F = ca.DM(6, 1)
        F[self.strain] = float(np.interp(x, *zip(*self.corners, strict=True)))
        return F
