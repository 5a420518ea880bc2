"""Rotations: exponential and logarithm of SO(3), and the 3 x 3 matrices both groups are assembled from.

    exp(w) = c_0 I + c_1 skew(w) + c_2 w w^T     (Rodrigues; c_k the Stumpff functions of w.w)
    log(R) = 2 atan2(|v|, s) v / |v|             (s, v scalar and vector part of the quaternion of R)

R maps body to parent coordinates; w is a rotation vector in radians.
Source: T. Barfoot, "State Estimation for Robotics", 2017, sec. 7.1; choice of the quaternion column:
S. Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
"""

import casadi as ca

from socontrol.lie.stumpff import switched

ROW, COLUMN = [0, 0, 1], [1, 2, 2]  # places of the three entries above the diagonal
NEAR = 0.05  # tan^2(angle/2): series below; above, second derivatives lose only eps/NEAR^2 = 1e-13
NEAR_TERMS = 16  # first dropped term NEAR^16/33 = 5e-23, its second derivative 4e-18


def exp(w, coefficients=switched):
    """R [3 x 3] of the rotation vector w [3]; by default for any angle."""
    diagonal, off = outer(w)
    c0, c1, c2, *_ = coefficients(ca.sum1(diagonal))
    return assemble(c0 + c2 * diagonal, c2 * off, c1 * w)


def log(R):
    """Rotation vector w [3] of R [3 x 3], |w| <= pi; accurate over the whole range, smooth below pi.

    Near the identity w = 2 p (1 - z/3 + z^2/5 - ...), p = v / s the Gibbs vector and z = p.p = tan^2(|w|/2).
    """
    quaternion = _quaternion(R)
    s, v = quaternion[0], quaternion[1:]
    squared = ca.dot(v, v)
    near = squared < NEAR * s**2

    s_near = ca.if_else(near, s, 1)
    z = ca.if_else(near, squared, 0) / s_near**2
    arc = 1 / (2 * NEAR_TERMS - 1)
    for i in reversed(range(NEAR_TERMS - 1)):
        arc = 1 / (2 * i + 1) - z * arc

    norm = ca.sqrt(ca.if_else(near, 1, squared))
    return 2 * ca.if_else(near, arc / s_near, ca.atan2(norm, s) / norm) * v


def outer(w):
    """w w^T of w [3], as its diagonal [3] and the entries above it [3], in the order xy, xz, yz."""
    return w * w, w[ROW] * w[COLUMN]


def outer_sum(w, v):
    """w v^T + v w^T of w, v [3], as its diagonal [3] and the entries above it [3]."""
    return 2 * (w * v), w[ROW] * v[COLUMN] + v[ROW] * w[COLUMN]


def assemble(diagonal, off, axial):
    """[3 x 3] of its symmetric part (diagonal [3], off = entries xy, xz, yz [3]) plus skew(axial [3])."""
    turn = ca.vertcat(axial[2], -axial[1], axial[0])
    entries = ca.vertcat(diagonal, off - turn, off + turn)
    return ca.reshape(entries[[0, 6, 7, 3, 1, 8, 4, 5, 2]], 3, 3)


def _quaternion(R):
    """[s; v] [4] of R, s >= 0, of length 2 to 4: the longest column of 4 [s; v] [s; v]^T, linear in R."""
    trace = ca.trace(R)
    axial = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    square = ca.blockcat([[1 + trace, axial.T], [axial, R + R.T + (1 - trace) * ca.DM.eye(3)]])
    column, longest = square[:, 0], square[0, 0]
    for k in (1, 2, 3):
        column = ca.if_else(square[k, k] > longest, square[:, k], column)
        longest = ca.fmax(square[k, k], longest)
    return ca.if_else(column[0] < 0, -1, 1) * column
