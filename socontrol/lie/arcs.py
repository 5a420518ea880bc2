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
    k, p = xi[:3], xi[3:]
    x = ca.dot(k, k)
    kp = ca.cross(k, p)
    return moments[1] * p + _weighted(x, moments, 2) * kp + _weighted(x, moments, 3) * ca.cross(k, kp)


def _weighted(x, moments, k):
    """P_k(x) by Horner's rule."""
    total = 0
    for j in reversed(range(TERMS)):
        total = moments[2 * j + k] * ((-1) ** j / factorial(2 * j + k)) + x * total
    return total


@lru_cache(maxsize=1)
def _moment_functions():
    xi, m, f = ca.SX.sym("xi", 6), ca.SX.sym("m", MOMENTS), ca.SX.sym("f", 3)
    c = moment(xi, m)
    hessian, gradient = ca.hessian(ca.dot(f, c), xi)
    return (
        ca.Function("moment_jacobian", [xi, m], [ca.jacobian(c, xi)]),
        ca.Function("moment_derivatives", [xi, m, f], [gradient, hessian]),
    )


def moment_jacobian(xi, moments):
    """d(moment)/dxi [3 x 6]."""
    return _moment_functions()[0](xi, moments)


def moment_derivatives(xi, moments, f):
    """Gradient [6] and Hessian [6 x 6] in xi of f . moment(xi)."""
    return _moment_functions()[1](xi, moments, f)


@lru_cache(maxsize=4)
def _tangent_gradient(coefficients):
    Omega, F = ca.SX.sym("Omega", 6), ca.SX.sym("F", 6)
    pulled = se3.tangent(Omega, coefficients).T @ F
    return ca.Function("tangent_gradient", [Omega, F], [ca.jacobian(pulled, Omega)])


def tangent_gradient(Omega, F, coefficients=stumpff.series):
    """d(tangent(Omega)^T F)/dOmega [6 x 6] at fixed F."""
    return _tangent_gradient(coefficients)(Omega, F)
