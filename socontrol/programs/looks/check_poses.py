"""Poses and twists in numpy for the independent look: sines and cosines, no series."""

import casadi as ca
import numpy as np

from socontrol.model.quadrature import gauss_legendre

POINTS = 16  # Gauss points of the adjoint's integral: exact to 1e-13 for one full turn
GENTLE = ((0.5, 6), (1.0, 8))  # (largest turn [rad], points): enough for 1e-14 there


def numeric(matrix):
    """A constant CasADi matrix as numpy."""
    return np.array(ca.DM(matrix).full())


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def exponentials(xi, s):
    """exp(s hat(xi)) [k x 4 x 4] at arcs s [k] by Rodrigues' formula."""
    W, z = skew(xi[:3]), s * np.linalg.norm(xi[:3])
    near = z < 1e-2
    if near.any():
        safe = np.where(near, 1.0, z)
        a = s * np.where(near, 1 - z**2 / 6 + z**4 / 120, np.sin(safe) / safe)
        b = s**2 * np.where(near, 0.5 - z**2 / 24 + z**4 / 720, 2 * (np.sin(safe / 2) / safe) ** 2)
        c = s**3 * np.where(near, 1 / 6 - z**2 / 120 + z**4 / 5040, (safe - np.sin(safe)) / safe**3)
    else:
        t, sine = s / z, np.sin(z)
        a, b, c = t * sine, 2 * (t * np.sin(z / 2)) ** 2, t**3 * (z - sine)
    WW = W @ W
    g = np.zeros((s.size, 4, 4))
    g[:, :3, :3] = np.eye(3) + a[:, None, None] * W + b[:, None, None] * WW
    g[:, :3, 3] = s[:, None] * xi[3:] + b[:, None] * (W @ xi[3:]) + c[:, None] * (WW @ xi[3:])
    g[:, 3, 3] = 1.0
    return g


def adjoints(g):
    """Ad of poses [k x 4 x 4], [k x 6 x 6]."""
    R, r = g[:, :3, :3], g[:, :3, 3]
    Ad = np.zeros((len(g), 6, 6))
    Ad[:, :3, :3] = Ad[:, 3:, 3:] = R
    turned = np.zeros((len(g), 3, 3))
    turned[:, [2, 0, 1], [1, 2, 0]], turned[:, [1, 2, 0], [2, 0, 1]] = r, -r
    Ad[:, 3:, :3] = turned @ R
    return Ad


def moved(xi, s):
    """int_0^s Ad(exp(sigma xi)) dsigma [k x 6 x 6] for arcs s [k], by Gauss quadrature."""
    turn = np.linalg.norm(xi[:3]) * np.max(s, initial=0.0)
    nodes, weights = map(np.array, gauss_legendre(next((n for most, n in GENTLE if turn < most), POINTS)))
    Ad = adjoints(exponentials(xi, np.outer(s, nodes).ravel())).reshape(s.size, nodes.size, 36)
    return s[:, None, None] * (weights @ Ad).reshape(s.size, 6, 6)
