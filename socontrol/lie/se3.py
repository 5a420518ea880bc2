"""Poses and twists: SE(3), its adjoints, exponential, logarithm and tangent map.

    g = [R r; 0 1],   hat(xi) = [skew(w) v; 0 0],   xi = [w; v]   (angular first, body frame)
    exp(Omega) = [R  A v; 0 1],   tangent(Omega) = int_0^1 exp(s ad_Omega) ds = [A 0; Q A]
    R = c_0 I + c_1 skew(w) + c_2 w w^T,   A = c_1 I + c_2 skew(w) + c_3 w w^T,   Q = derivative of A along v

with c_k the Stumpff functions of w.w. The map T_xi(X) of the sources is X tangent(X xi), and the body twist
of g = exp(Omega) is Ad_g^-1 tangent(Omega) Omega_dot = tangent(-Omega) Omega_dot.
Source: F. Renda, L. Seneviratne, ICRA 2018; F. Renda et al., T-RO 2018;
T. Barfoot, "State Estimation for Robotics", 2017, secs. 7.1.3-7.1.5 (block form of the tangent map).
"""

import casadi as ca

from socontrol.lie import so3
from socontrol.lie.stumpff import series


def pose(R, r):
    """g [4 x 4] of the rotation R [3 x 3] and the position r [3]."""
    return ca.blockcat([[R, r], [ca.DM(1, 3), 1]])


def rotation(g):
    """R [3 x 3] of g."""
    return g[:3, :3]


def position(g):
    """r [3] of g, in the parent frame."""
    return g[:3, 3]


def inverse(g):
    """g^-1 [4 x 4]: inverse(g_ab) = g_ba."""
    back = rotation(g).T
    return pose(back, -(back @ position(g)))


def transform(g, x):
    """The point x [3] of the body frame, in the parent frame [3]: R x + r."""
    return rotation(g) @ x + position(g)


def hat(xi):
    """[4 x 4] matrix of the twist xi [6]: [skew(w) v; 0 0]."""
    return ca.blockcat([[ca.skew(xi[:3]), xi[3:]], [ca.DM(1, 3), ca.DM(1, 1)]])


def vee(X):
    """Twist [6] of the matrix X [4 x 4], the inverse of `hat`."""
    return ca.vertcat(X[2, 1], X[0, 2], X[1, 0], X[:3, 3])


def ad(xi):
    """ad_xi [6 x 6] = [W 0; V W]: ad(a) b is the bracket of the twists a, b."""
    W, V = ca.skew(xi[:3]), ca.skew(xi[3:])
    return ca.blockcat([[W, ca.DM(3, 3)], [V, W]])


def coad(xi):
    """coad_xi [6 x 6] = [W V; 0 W] = -ad_xi^T: Newton-Euler is M eta_dot + coad(eta) M eta = F."""
    W, V = ca.skew(xi[:3]), ca.skew(xi[3:])
    return ca.blockcat([[W, V], [ca.DM(3, 3), W]])


def Ad(g):
    """Ad_g [6 x 6] = [R 0; skew(r) R R]: twists from the body frame of g to its parent frame."""
    R = rotation(g)
    return ca.blockcat([[R, ca.DM(3, 3)], [ca.skew(position(g)) @ R, R]])


def Ad_inv(g):
    """Ad_g^-1 [6 x 6] = [R^T 0; -R^T skew(r) R^T]: twists from the parent frame of g to its body frame."""
    back = rotation(g).T
    return ca.blockcat([[back, ca.DM(3, 3)], [-(back @ ca.skew(position(g))), back]])


def coAd(g):
    """coAd_g [6 x 6] = [R skew(r) R; 0 R] = Ad_g^-T: wrenches from the body frame to the parent frame."""
    R = rotation(g)
    return ca.blockcat([[R, ca.skew(position(g)) @ R], [ca.DM(3, 3), R]])


def exp(Omega, coefficients=series):
    """g [4 x 4] = exp(hat(Omega)), Omega [6]; `series` holds for angles up to 2 pi, `switched` for any."""
    return exp_and_tangent(Omega, coefficients)[0]


def tangent(Omega, coefficients=series):
    """[6 x 6] int_0^1 exp(s ad_Omega) ds, Omega [6]; body form: Ad_g^-1 tangent(Omega) = tangent(-Omega)."""
    return exp_and_tangent(Omega, coefficients)[1]


def exp_and_tangent(Omega, coefficients=series):
    """(exp(Omega) [4 x 4], tangent(Omega) [6 x 6]) of Omega [6], from the same coefficients and the same A.

    Q follows from dc_k/dx = -(c_{k+1} - k c_{k+2}) / 2 and dx = 2 w.v; it equals the block
    V/2 + c_3 (WV + VW + WVW) + c_4 (WWV + VWW - 3 WVW) + (c_4 - 3 c_5)/2 (WVWW + WWVW) with W = skew(w) and
    V = skew(v), since skew(w) skew(v) = v w^T - w.v I.
    """
    w, v = Omega[:3], Omega[3:]
    diagonal, off = so3.outer(w)
    c0, c1, c2, c3, c4, c5 = coefficients(ca.sum1(diagonal))
    R = so3.assemble(c0 + c2 * diagonal, c2 * off, c1 * w)
    A = so3.assemble(c1 + c3 * diagonal, c3 * off, c2 * w)

    sum_diagonal, sum_off = so3.outer_sum(w, v)
    half_dx = ca.sum1(sum_diagonal) / 2
    d1, d2, d3 = (half_dx * slope for slope in (c2 - c3, c3 - 2 * c4, c4 - 3 * c5))
    Q = so3.assemble(c3 * sum_diagonal - d3 * diagonal - d1, c3 * sum_off - d3 * off, c2 * v - d2 * w)
    return pose(R, A @ v), ca.blockcat([[A, ca.DM(3, 3)], [Q, A]])


def screw_motion(Phi, angle):
    """exp(angle Phi) [4 x 4] of a twist Phi [6] that stays the same, for any angle.

    With k = |w|, a = w / k, turn = k angle:
    R = I + sin a~ + (1 - cos) a~^2,  r = (sin/k + (1 - cos)/k a~ + (angle - sin/k) a a^T) v.
    """
    w, v = Phi[:3, 0], Phi[3:, 0]
    if w.is_constant() and float(ca.sumsqr(ca.DM(w))) == 0:
        return pose(ca.DM.eye(3), v * angle)
    k = ca.norm_2(w)
    a = ca.sparsify(w / k)
    turn, sine, gap = ca.skew(a), ca.sin(k * angle), 1 - ca.cos(k * angle)
    R = ca.DM.eye(3) + sine * turn + gap * (turn @ turn)
    along = a @ (a.T @ v)
    r = sine / k * (v - along) + gap / k * (turn @ v) + angle * along
    return pose(R, r)


def log(g):
    """Omega [6] with exp(Omega) = g [4 x 4], angle at most pi, smooth below pi."""
    w = so3.log(rotation(g))
    return ca.vertcat(w, _inverse_of_A(w, series) @ position(g))


def tangent_inverse(Omega, coefficients=series):
    """tangent(Omega)^-1 [6 x 6] = [A^-1 0; -A^-1 Q A^-1 A^-1], Omega [6]; singular at the angle 2 pi."""
    Q = tangent(Omega, coefficients)[3:, :3]
    back = _inverse_of_A(Omega[:3], coefficients)
    return ca.blockcat([[back, ca.DM(3, 3)], [-(back @ Q @ back), back]])


def _inverse_of_A(w, coefficients):
    """A^-1 [3 x 3] = I - W/2 + (c_3 - 2 c_4)/(2 c_2) W^2, W = skew(w); t cot(t/2) without its 0/0."""
    _, _, c2, c3, c4, _ = coefficients(ca.dot(w, w))
    W = ca.skew(w)
    return ca.DM.eye(3) - W / 2 + (c3 - 2 * c4) / (2 * c2) * (W @ W)
