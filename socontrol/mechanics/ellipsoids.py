"""Ellipsoids of a frame: how far it moves, gives way or is driven, and what it can push with, in every direction.

J [6 x n] is the frame's Jacobian in world axes, angular first, K [n x n] the tangent of the balance r(q, u) = 0 in q,
H = B(q) [n x m] that of the inputs' forces in u, and Z [n x k] a basis of the motions that are left (Z = I for a tree;
for closed loops the null space of A(q), K then with what the loops' forces change). With S = Z (W^T K Z)^-1 W^T
    kinematic   J Z Z^T J^T, Z orthonormal      force       the inverse of a block of it
    compliance  J S J^T                         actuation   (J S H) (J S H)^T.
W [n x k] are the directions in which what holds the robot does not push: W = Z, but for cables with friction that are
held at their lengths. Compliance maps a small wrench to a small motion; the others are squares, {v: v^T M^-1 v <= 1}.
Every formula takes numbers and symbols alike. Source: T. Yoshikawa, Int. J. Robotics Research 4(2), 1985.
"""

import casadi as ca
import numpy as np

PARTS = {"rotation": slice(0, 3), "translation": slice(3, 6)}
RANK = 1e-9  # of the largest singular value: smaller ones are zero


def in_world(g, J):
    """Jacobian [6 x n] in world axes from that in the axes of the frame g [4 x 4]."""
    R = g[:3, :3]
    return ca.vertcat(R @ J[:3, :], R @ J[3:, :])


def yielding(K, Z=None, W=None):
    """S [n x n]: the change of q at rest per generalised force. Z = None: nothing is held."""
    if Z is None:
        return ca.solve(K, ca.DM.eye(K.shape[0]))
    W = Z if W is None else W
    return Z @ ca.solve(W.T @ K @ Z, W.T)


def compliance(J, K, Z=None, W=None):
    """[6 x 6]: turn and displacement of the frame per moment and force on it."""
    return J @ yielding(K, Z, W) @ J.T


def moved(J, Z=None):
    """[6 x k]: motions of the frame; Z [n x k] orthonormal."""
    return J if Z is None else J @ Z


def driven(J, K, H, Z=None, W=None):
    """[6 x m]: motions of the frame at rest per input; H: columns times what counts as 1 of each input."""
    return J @ yielding(K, Z, W) @ H


def kinematic(J, Z=None):
    """[6 x 6] of changes of q whose squares sum to 1."""
    return square(moved(J, Z))


def actuation(J, K, H, Z=None, W=None):
    """[6 x 6] of changes of the inputs whose squares sum to 1."""
    return square(driven(J, K, H, Z, W))


def square(F):
    """F F^T: the ellipsoid {F x: |x| <= 1}."""
    return F @ F.T


def force(M):
    """Inverse [3 x 3] of a block of the kinematic matrix, which must be regular."""
    return ca.inv(M)


def block(M, part):
    """Block [3 x 3] of `translation` or `rotation`."""
    return M[PARTS[part], PARTS[part]]


def rows(F, part):
    """Rows [3 x k] of `translation` or `rotation`."""
    return F[PARTS[part], :]


def null_space(A, size):
    """Basis [n x k] of {z: A z = 0} in numbers, orthonormal where coordinates count in units of `size` [n]."""
    n = len(size)
    if not len(A):
        return np.diag(size)
    _, values, rows = np.linalg.svd(np.asarray(A) * size)
    rank = int(np.sum(values > RANK * values[0])) if values[0] > 0 else 0
    return size[:, None] * rows[rank:n].T


def principal(F, size=0.0):
    """Semi-axes [3] of {F x: |x| <= 1}, longest first, and their directions (columns, largest entry positive), in
    numbers; F [3 x k]. What rounding leaves of an axis beside the longest, or beside `size`, is 0."""
    F = np.asarray(F, dtype=float)
    vectors, values, _ = np.linalg.svd(np.hstack([F, np.zeros((3, 3))]), full_matrices=False)
    vectors = np.where(np.abs(vectors) < RANK, 0.0, vectors)
    leading = vectors[np.argmax(np.abs(vectors), axis=0), range(3)]
    return np.where(values > RANK * max(values[0], size), values, 0.0), vectors * np.where(leading < 0, -1.0, 1.0) + 0.0
