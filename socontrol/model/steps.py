"""Pieces: the one thing joints and sections of rods have in common, a twist with a basis.

A piece carries a frame from its base along xi = Phi q + xi_bar. The step from the base to arc s is
    g(s) = exp(s xi),   eta(s) = Ad(exp(-s xi)) (eta_base + S(s) qd),   S(s) = s tangent(s xi) Phi,
S(s) [6 x n] seen from the base frame (angular first). A lumped joint runs up to s = 1 with xi_bar = 0; a section
of rod up to its length in metres. Places on a piece are named by x = s / length in [0, 1]. Sweeps ask a piece only
for `step`, `wrench_gradient` and `first_moment`, so a piece whose strain varies along s may answer them with
products of exponentials.
Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from socontrol.lie import arcs, se3, stumpff


@dataclass(frozen=True)
class Slice:
    """A quadrature point of a section of rod: place x in [0, 1], `weight` [m], X on the segment, cross-section."""

    x: float
    weight: Any
    X: float
    section: Any


@dataclass(frozen=True)
class Piece:
    """One joint, or one section of a rod.

    parent, place: the piece it stands on (None: world) and x there; placement [4 x 4]: from that frame to the base
    of this piece; columns: its coordinates in q; record: the segment it came from; end [4 x 4]: end frame in the
    frame at x = 1.
    """

    segment: str
    index: int
    record: Any
    parent: int | None
    place: float
    placement: Any
    columns: slice
    Phi: Any
    xi_bar: Any
    xi_star: Any
    length: Any
    end: Any
    slices: tuple = ()

    @property
    def size(self):
        return self.columns.stop - self.columns.start

    @property
    def is_rod(self):
        return bool(self.slices)

    @property
    def is_screw(self):
        """A lumped joint of at most one degree of freedom: its twist does not change as it moves, S = Phi."""
        return not self.is_rod and self.size <= 1

    def coefficients(self):
        return stumpff.series if self.is_rod else stumpff.switched

    def strain(self, q):
        """xi [6] for all coordinates q [n]."""
        return self.xi_bar + self.Phi @ q[self.columns] if self.size else self.xi_bar

    def step(self, q, x=1.0):
        """g [4 x 4] and S [6 x n] from the base to x, both seen from the base."""
        if x == 0:
            return ca.DM.eye(4), ca.DM(6, self.size)
        if not self.is_rod:
            return self.joint_step(q[self.columns])
        s, xi = x * self.length, self.strain(q)
        g, T = arcs.exp_and_tangent(s * xi, self.coefficients())
        return g, s * (T @ self.Phi)

    def joint_step(self, own):
        """g [4 x 4] and S [6 x n_i] of a whole joint, from its own coordinates [n_i]."""
        if self.size == 0:
            return ca.DM.eye(4), ca.DM(6, 0)
        if self.is_screw:
            return se3.screw_motion(self.Phi, own), self.Phi
        g, T = arcs.exp_and_tangent(self.Phi @ own, self.coefficients())
        return g, T @ self.Phi

    def twist_rate(self, own, rate):
        """dS/dt rate [6] of a whole joint, with its own coordinates and their rates [n_i]."""
        if self.is_screw:
            return ca.DM(6, 1)
        return arcs.tangent_rate(self.Phi @ own, self.Phi @ rate, self.coefficients())

    def twists_rate(self, q, qd, x):
        """dS/dt [6 x n_i] at x, for all coordinates q and their rates [n]."""
        if x == 0 or self.is_screw:
            return ca.DM(6, self.size)
        s, rate = x * self.length, self.Phi @ qd[self.columns]
        return s * (arcs.tangent_slope(s * self.strain(q), s * rate, self.coefficients()) @ self.Phi)

    def wrench_gradient(self, q, x, F):
        """d(S(x)^T F)/dq [n x n] for a wrench F [6] that stays fixed in the base frame."""
        if x == 0 or self.is_screw:
            return ca.DM(self.size, self.size)
        s = x * self.length
        return s**2 * (self.Phi.T @ arcs.tangent_gradient(s * self.strain(q), F, self.coefficients()) @ self.Phi)

    def first_moment(self, q, moments):
        """sum_i w_i r(x_i) [3] over the slices, base frame, from the `moments` of the weights."""
        return arcs.moment(self.strain(q), moments)

    def force_potential(self, q, moments, f):
        """Gradient [n] and Hessian [n x n] in q of f . first_moment(q), f [3] fixed in the base frame."""
        gradient, hessian = arcs.moment_derivatives(self.strain(q), moments, f)
        return self.Phi.T @ gradient, self.Phi.T @ hessian @ self.Phi

    def moment_jacobian(self, q, moments):
        """d(first_moment)/dq [3 x n]."""
        return arcs.moment_jacobian(self.strain(q), moments) @ self.Phi

    def moments(self, weights):
        """Moments sum_i w_i s_i^k of weights [per slice] along the piece, k = 0 ... arcs.MOMENTS - 1."""
        exponents = np.arange(arcs.MOMENTS)
        powers = ca.DM(np.array([[p.x] for p in self.slices]) ** exponents)
        return (ca.vertcat(*weights).T @ powers).T * self.length**exponents
