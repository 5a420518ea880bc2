"""Stumpff functions, the coefficients of every exponential and tangent map in this library.

    c_k(x) = sum_i (-x)^i / (2 i + k)!,   x = t^2,   t = rotation angle in radians

    c_0 = cos t,  c_1 = sin t / t,  c_2 = (1 - cos t) / t^2,  c_3 = (t - sin t) / t^3, ...
    c_k = 1/k! - x c_{k+2},   dc_k/dx = -(c_{k+1} - k c_{k+2}) / 2

They are entire functions of t^2, so a series in t^2 has the right derivatives of every order at t = 0.
Source: K. Stumpff, "Himmelsmechanik I", 1959; J. Danby, "Fundamentals of Celestial Mechanics", 1988, ch. 6.
"""

from math import factorial, pi

import casadi as ca

RANGE = 2 * pi * (1 + 1e-9)  # largest rotation angle for which `series` keeps its accuracy; a closed circle is within
TERMS = 17  # c_0 at x = RANGE^2 drops RANGE^38 / 38! = 4e-15 first; 16 terms would drop 1e-13
SWITCH = 10.0  # in x: the closed forms divide rounding errors by x up to four times (c_5''), harmless above 1
SWITCH_TERMS = 14  # below SWITCH c_0'' drops 16^2 SWITCH^14 / 32! = 1e-19 first


def series(x, terms=TERMS, top=5):
    """(c_0, ..., c_top) at x = t^2 [scalar], branch-free, to 1e-13 for 0 <= t <= RANGE.

    Only the last two are summed (Horner), the others follow by c_k = 1/k! - x c_{k+2}.
    """
    c = [_horner(x, top, terms), _horner(x, top - 1, terms)]
    for k in reversed(range(top - 1)):
        c.append(1 / factorial(k) - x * c[-2])
    return tuple(reversed(c))


def slopes(c):
    """(dc_0/dx, ..., dc_{n-2}/dx) from (c_0, ..., c_n)."""
    return tuple(-(c[k + 1] - k * c[k + 2]) / 2 for k in range(len(c) - 2))


def switched(x, top=5):
    """(c_0, ..., c_top) at any x = t^2 >= 0 [scalar]: the series below SWITCH, sines and cosines above.

    Each branch sees its own safe argument, so that the branch not taken stays finite, derivatives included.
    """
    near = x < SWITCH
    small = series(ca.if_else(near, x, SWITCH), SWITCH_TERMS, top)
    large = _closed(ca.if_else(near, SWITCH, x), top)
    return tuple(ca.if_else(near, a, b) for a, b in zip(small, large, strict=True))


def _horner(x, k, terms):
    """The first `terms` terms of c_k(x) [scalar]."""
    value = 1 / factorial(2 * (terms - 1) + k)
    for i in reversed(range(terms - 1)):
        value = 1 / factorial(2 * i + k) - x * value
    return value


def _closed(x, top):
    """(c_0, ..., c_top) from sine and cosine, for x well above zero."""
    t = ca.sqrt(x)
    c = [ca.cos(t), ca.sin(t) / t]
    for k in range(top - 1):
        c.append((1 / factorial(k) - c[k]) / x)
    return tuple(c)
