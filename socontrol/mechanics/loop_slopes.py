"""First and second derivatives of the rows e(q) of a loop, from those in one twist.

With L [k x 6] and H [6 x 6] the first derivative of e and the second of lam . e in a twist sigma of a, seen from b,
that turns g = g_b^-1 g_a into exp(sigma) g, and J_a, J_b the world twists of the ends per coordinate, about the world's
origin,
    E = de/dq = L Ad_b^-1 (J_a - J_b),    E^T lam = (J_a - J_b)^T F,    F = coAd_b L^T lam,
    dF = C(F) J_b dq + coAd_b (H + C(L^T lam) / 2) Ad_b^-1 (J_a - J_b) dq,    C(F) s = coad_s F,
and what the wrench F on a and -F on b give where they do not change follows as for loads. L and H come from the rows
of each kind by differentiation in symbols of their own, which do not leave this module.
"""

from collections import defaultdict
from functools import cached_property

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics import recursions
from socontrol.mechanics.loads import turned


def turning(kin, loops, lam):
    """d(E^T lam)/dq [n x n] of loops [Slopes] with the multipliers of each."""
    tree, total = kin.tree, ca.DM(kin.tree.n, kin.tree.n)
    places = [defaultdict(recursions.Carried) for _ in tree.pieces]
    for loop, own in zip(loops, lam, strict=True):
        f = loop.L.T @ own
        F, P = se3.coAd(loop.b) @ f, loop.second(own) + turned(f) / 2
        total += loop.apart.T @ (turned(F) @ loop.J_b) + loop.apart_in_b.T @ (P @ loop.apart_in_b)
        for frame, wrench in zip(loop.frames, (F, -F), strict=True):
            if frame is not None:
                places[frame.piece][frame.x].add(wrench, ca.DM(6, 6))
    return total + recursions.external_tangent(kin, *recursions.gathered(kin, places, [[] for _ in tree.pieces]))


class Slopes:
    """One loop's frames, world twists [6 x n] of its ends and those apart, and the derivatives of its rows."""

    def __init__(self, loop, kin, frames):
        self.loop, self.frames, self.b = loop, frames, loop.b.pose(kin, frames[1])
        J_a, self.J_b = (_twists(kin, frame) for frame in frames)
        self.apart, g = J_a - self.J_b, se3.inverse(self.b) @ loop.a.pose(kin, frames[0])
        self.apart_in_b = se3.Ad_inv(self.b) @ self.apart
        R, r, sigma = ca.SX.sym("R", 3, 3), ca.SX.sym("r", 3), ca.SX.sym("sigma", 6)
        W = ca.skew(sigma[:3])
        turn = ca.DM.eye(3) + W + W @ W / 2  # exp(sigma) to second order
        rows = loop.rows(turn @ R, turn @ r + sigma[3:] + W @ sigma[3:] / 2)
        self._symbols, self._rows, self._g = (R, r, sigma), rows, (se3.rotation(g), se3.position(g), ca.DM(6, 1))

    @cached_property
    def E(self):
        """de/dq [k x n]."""
        return self.L @ self.apart_in_b

    @cached_property
    def L(self):
        """[k x 6]: what a twist of a, seen from b, changes in e."""
        return self._at(ca.jacobian(self._rows, self._symbols[2]))

    def second(self, lam):
        """H [6 x 6] of lam . e."""
        own = ca.SX.sym("own", self._rows.numel())
        return self._at(ca.hessian(ca.dot(own, self._rows), self._symbols[2])[0], (own, lam))

    def _at(self, expression, *more):
        """The expression at this loop's g and sigma = 0; values that are symbols stay."""
        given = [*zip(self._symbols, self._g, strict=True), *more]
        known = {s.__hash__() for symbol, _ in given for s in ca.symvar(symbol)}
        free = [s for s in ca.symvar(expression) if s.__hash__() not in known]
        function = ca.Function("rows", [symbol for symbol, _ in given] + free, [expression])
        return function(*(value for _, value in given), *free)


def _twists(kin, frame):
    """World twists [6 x n], about the world's origin, that the coordinates give a frame."""
    tree = kin.tree
    parts = [ca.DM(6, piece.size) for piece in tree.pieces]
    for i, x in tree.chain(frame.piece, frame.x) if frame is not None else ():
        if tree.pieces[i].size:
            parts[i] = kin.twists(i, x)
    return ca.horzcat(*parts)
