"""Elastic forces of rods and joint springs, their tangent, and the stored energy, piece by piece.

Rod: f = int Phi^T F(xi - xi_star) ds with F = dW/dxi; joint: f = K (q - rest). Units of f: N m and N times the
unit of length of each strain (N m^2 for a curvature, N m for a stretch).
Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca


def quadrature(piece):
    """(weight [m], section) pairs that integrate a rod's law: one pair where nothing changes along the piece."""
    if piece.record.is_uniform():
        return ((piece.length, piece.slices[0].section),)
    return tuple((p.weight, p.section) for p in piece.slices)


def deviation(piece, q):
    """eps = xi - xi_star [6] of a section of rod."""
    return piece.strain(q) - piece.xi_star


def force(piece, q):
    """Generalised elastic force [n_i] of one piece."""
    if piece.is_rod:
        eps, material = deviation(piece, q), piece.record.material
        return piece.Phi.T @ sum(w * material.force(eps, section) for w, section in quadrature(piece))
    force, n = piece.record.matrix("stiffness") @ (q[piece.columns] - piece.record.rest_coordinates()), piece.size
    for i, d, side, k, w in _stops(piece, q):
        force = force + ca.DM.triplet([i], [0], [side], n, 1) * (k * d**3 / (d**2 + w**2))
    return force


def _stops(piece, q):
    """(index, way past the limit, side, stiffness, width) of a joint's stops; the way is 0 inside."""
    for i, limit, side, k, w in piece.record.stops():
        yield i, ca.fmax(0, side * (q[piece.columns][i] - limit)), side, k, w


def stiffness(piece, q):
    """Tangent d(force)/dq [n_i x n_i] of one piece."""
    if piece.is_rod:
        eps, material = deviation(piece, q), piece.record.material
        tangent = sum(w * material.stiffness(eps, section) for w, section in quadrature(piece))
        return piece.Phi.T @ tangent @ piece.Phi
    K, n = piece.record.matrix("stiffness"), piece.size
    for i, d, _, k, w in _stops(piece, q):
        K = K + ca.DM.triplet([i], [i], [1], n, n) * (k * d**2 * (d**2 + 3 * w**2) / (d**2 + w**2) ** 2)
    return K


def energy(piece, q):
    """Stored energy [J] of one piece; 0 at rest."""
    if piece.is_rod:
        eps, material = deviation(piece, q), piece.record.material
        return sum(w * material.energy(eps, section) for w, section in quadrature(piece))
    away = q[piece.columns] - piece.record.rest_coordinates()
    spring = ca.bilin(piece.record.matrix("stiffness"), away, away) / 2
    return spring + sum((k / 2 * (d**2 - w**2 * ca.log1p(d**2 / w**2)) for _, d, _, k, w in _stops(piece, q)), 0)


def damping(piece, q):
    """Kelvin-Voigt damping [n_i x n_i]: viscosity diag(Jx, 3 Jy, 3 Jz, 3 A, A, A), or the joint's own matrix."""
    if not piece.is_rod:
        return piece.record.matrix("damping")
    material = piece.record.material
    return piece.Phi.T @ sum(w * material.damping(section) for w, section in quadrature(piece)) @ piece.Phi
