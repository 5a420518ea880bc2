"""Weighted sums over an arc exp(s xi), and derivatives of the tangent map, as closed forms of xi.

Along a constant twist xi = [k; p] the centreline is r(s) = s p + s^2 c_2 k x p + s^3 c_3 k x (k x p) with Stumpff
functions of s^2 |k|^2, so a weighted sum over any number of points needs only the moments m_k = sum_i w_i s_i^k:
    sum_i w_i r(s_i) = m_1 p + P_2 k x p + P_3 k x (k x p),   P_k(t^2) = sum_j m_{2j+k} (-t^2)^j / (2j + k)!.
The small derivatives are made once, as SX Functions, and inlined wherever they are called.
"""

from functools import lru_cache
from math import factorial

import casadi as ca

from socontrol.lie import se3, stumpff

TERMS = stumpff.TERMS  # the same range of t as the exponential
MOMENTS = 2 * TERMS + 4


def moment(xi, moments):
    """sum_i w_i r(s_i) [3] from the moments m_k [MOMENTS] of the weights."""
    return _moment_functions()[0](xi, moments)


def _weighted(x, moments, k, order=0):
    """The derivative of P_k in x of this order, by Horner's rule."""
    total = 0
    for j in reversed(range(order, TERMS)):
        factor = (-1) ** j * factorial(j) / factorial(j - order) / factorial(2 * j + k)
        total = moments[2 * j + k] * factor + x * total
    return total


@lru_cache(maxsize=1)
def _moment_functions():
    """Value, Jacobian, and gradient and Hessian of a projection, with P_k differentiated as series of their own.

    Automatic differentiation through Horner's rule would repeat it for each of the six directions.
    """
    xi, m, f, P = ca.SX.sym("xi", 6), ca.SX.sym("m", MOMENTS), ca.SX.sym("f", 3), ca.SX.sym("P", 2)
    k, p = xi[:3], xi[3:]
    x, dx, ddx = ca.dot(k, k), ca.vertcat(2 * k, 0, 0, 0), ca.diag(ca.DM([2, 2, 2, 0, 0, 0]))
    values, first, second = (ca.vertcat(*(_weighted(x, m, n, order) for n in (2, 3))) for order in (0, 1, 2))
    kp = ca.cross(k, p)
    c = m[1] * p + P[0] * kp + P[1] * ca.cross(k, kp)
    jacobian = ca.jacobian(c, xi) + ca.jacobian(c, P) @ first @ dx.T

    phi = ca.dot(f, c)
    by_P = ca.gradient(phi, P)
    slope, bend = ca.dot(by_P, first), ca.dot(by_P, second)
    F1 = ca.SX.sym("F1", 2)
    mixed = ca.substitute(ca.gradient(ca.dot(by_P, F1), xi), F1, first) @ dx.T
    hessian = ca.hessian(phi, xi)[0] + mixed + mixed.T + bend * dx @ dx.T + slope * ddx
    gradient = ca.gradient(phi, xi) + slope * dx

    def made(name, inputs, outputs):
        return ca.Function(name, inputs, [ca.substitute(e, P, values) for e in outputs])

    return (
        made("moment", [xi, m], [c]),
        made("moment_jacobian", [xi, m], [jacobian]),
        made("moment_derivatives", [xi, m, f], [gradient, hessian]),
    )


def moment_jacobian(xi, moments):
    """d(moment)/dxi [3 x 6]."""
    return _moment_functions()[1](xi, moments)


def moment_derivatives(xi, moments, f):
    """Gradient [6] and Hessian [6 x 6] in xi of f . moment(xi)."""
    return _moment_functions()[2](xi, moments, f)


@lru_cache(maxsize=4)
def _step(coefficients):
    Omega = ca.SX.sym("Omega", 6)
    return ca.Function("step", [Omega], [*se3.exp_and_tangent(Omega, coefficients)])


def exp_and_tangent(Omega, coefficients=stumpff.series):
    """exp(Omega) [4 x 4] and tangent(Omega) [6 x 6], the expressions of `se3`, formed once and inlined."""
    return _step(coefficients)(Omega)


@lru_cache(maxsize=4)
def _tangent_slopes(coefficients):
    Omega, rate = ca.SX.sym("Omega", 6), ca.SX.sym("rate", 6)
    T = se3.tangent(Omega, coefficients)
    slope = ca.reshape(ca.jtimes(ca.vec(T), Omega, rate), 6, 6)
    return (
        ca.Function("tangent_slope", [Omega, rate], [slope]),
        ca.Function("tangent_rate", [Omega, rate], [ca.jtimes(T @ rate, Omega, rate)]),
    )


def tangent_slope(Omega, rate, coefficients=stumpff.series):
    """d/dt tangent(Omega) [6 x 6] at Omega_dot = rate."""
    return _tangent_slopes(coefficients)[0](Omega, rate)


def tangent_rate(Omega, rate, coefficients=stumpff.series):
    """d/dt tangent(Omega) Omega_dot [6] at Omega_dot = rate, Omega_ddot = 0."""
    return _tangent_slopes(coefficients)[1](Omega, rate)


@lru_cache(maxsize=4)
def _tangent_gradient(coefficients):
    """The coefficients enter as symbols with known slopes dc_k/dx, so that their sums are formed once."""
    Omega, F, c = ca.SX.sym("Omega", 6), ca.SX.sym("F", 6), ca.SX.sym("c", 6)
    w = Omega[:3]
    pulled = se3.tangent(Omega, lambda x: ca.vertsplit(c)).T @ F
    known = coefficients(ca.dot(w, w), top=7)
    along = ca.jacobian(pulled, c) @ ca.vertcat(*stumpff.slopes(known))
    total = ca.jacobian(pulled, Omega) + along @ ca.vertcat(2 * w, 0, 0, 0).T
    return ca.Function("tangent_gradient", [Omega, F], [ca.substitute(total, c, ca.vertcat(*known[:6]))])


def tangent_gradient(Omega, F, coefficients=stumpff.series):
    """d(tangent(Omega)^T F)/dOmega [6 x 6] at fixed F."""
    return _tangent_gradient(coefficients)(Omega, F)
