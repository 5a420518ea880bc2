"""Screws and screw systems of numeric twists: the geometry behind a joint or a strain field.

    pitch h = k.p / t^2,   axis through k x p / t^2 along k,   magnitude m = X t,   xi = [k; p],  t = |k|

k = 0 is a pure translation (h infinite, m = X |p|), h = 0 a rotation or circular arc. A joint or a piece of
rod moves in the span of the columns of Phi and of xi_bar; the order is the dimension of that span.
Source: F. Renda, L. Seneviratne, ICRA 2018, table of lumped and distributed joints.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from socontrol.lie import se3

TOLERANCE = 1e-9  # on unit twists: far above rounding (1e-16), far below any pitch or angle one builds


@dataclass(frozen=True)
class Screw:
    """`pitch` in metres per radian; `axis_point` [3] nearest to the origin; `axis_direction` [3] unit vector;
    `magnitude` in radians, in metres where the pitch is infinite."""

    pitch: float
    axis_point: np.ndarray
    axis_direction: np.ndarray
    magnitude: float


@dataclass(frozen=True)
class ScrewSystem:
    """`name` of the subspace or subalgebra of se(3), and its dimension `order`."""

    name: str
    order: int


def screw(xi, X=1.0):
    """Screw of the numeric twist xi [6] followed up to X.

    A pure translation gets the origin as its axis point; the zero twist, a translation by nothing, gets the
    direction zero.
    """
    k, p = np.split(_column(xi), 2)
    t = np.linalg.norm(k)
    if t > 0:
        k_unit, p_unit = k / t, p / t
        return Screw(float(k_unit @ p_unit), np.cross(k_unit, p_unit), k_unit, float(X * t))
    length = np.linalg.norm(p)
    return Screw(float("inf"), np.zeros(3), p / length if length > 0 else p, float(X * length))


def screw_system(Phi, xi_bar):
    """ScrewSystem of numeric Phi [6 x n] and xi_bar [6] (zero for a lumped joint).

    The name is that of the algebra when the span is one of {0}, so(2), R, h_p, so(2) x R, se(2), so(3),
    se(3), else how it is spanned. Congruent spans have the same name: the frame does not matter.
    """
    Phi = np.reshape(np.asarray(ca.DM(Phi), dtype=float), (6, -1))
    B = _basis(Phi)
    S = _basis(np.column_stack([Phi, _column(xi_bar)]))
    order = S.shape[1]
    name = _algebra(S) or ("span B" if order == B.shape[1] else "span{B, xi_bar}")
    return ScrewSystem(name, order)


def _algebra(S):
    """Name of the subalgebra spanned by the orthonormal S [6 x order]; None: not closed, or nameless here.

    The order and the number of independent pure translations tell the closed spans apart, up to their pitch.
    """
    order = S.shape[1]
    translations = order - np.linalg.matrix_rank(S[:3], tol=TOLERANCE)
    kind = (order, translations)
    if kind == (0, 0):
        return "{0}"
    if kind == (1, 1):
        return "R"
    if kind == (1, 0):
        return "so(2)" if _pitch_free(S) else "h_p"
    if kind == (6, 3):
        return "se(3)"
    if not _closed(S):
        return None
    if kind == (2, 1):
        return "so(2) x R"
    if kind == (3, 0):
        return "so(3)"
    return "se(2)" if kind == (3, 2) and _pitch_free(S) else None


def _pitch_free(S):
    """Whether k.p = 0 in every twist [k; p] of the span of S [6 x n], that is, p is at right angles to k."""
    product = S[:3].T @ S[3:]
    size = np.linalg.norm(S[:3]) * np.linalg.norm(S[3:])
    return bool(np.abs(product + product.T).max() <= TOLERANCE * size)


def _closed(S):
    """Whether the span of the orthonormal S [6 x n] contains the bracket of any two of its twists."""
    for a in S.T:
        for b in S.T:
            bracket = np.asarray(se3.ad(ca.DM(a)) @ ca.DM(b)).ravel()
            left_over = bracket - S @ (S.T @ bracket)
            turn_a, turn_b = np.linalg.norm(a[:3]), np.linalg.norm(b[:3])
            if np.linalg.norm(left_over) > TOLERANCE * (turn_a + turn_b):
                return False
    return True


def _basis(columns):
    """Orthonormal basis of the span of `columns` [m x n], each column scaled to length one first."""
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns[:, lengths > 0] / lengths[lengths > 0]
    left, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return left[:, values > TOLERANCE]


def _column(xi):
    """xi [6] as a flat numpy array of numbers."""
    return np.asarray(ca.DM(xi), dtype=float).ravel()
