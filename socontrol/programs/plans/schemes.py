"""Collocation of q'' = a: in an interval the acceleration is the polynomial through its values at the points.

With fractions c_i of an interval h that begins at q_k, v_k,
    v(x) = v_k + h sum_j V_j(x) a_j,    q(x) = q_k + h x v_k + h^2 sum_j Q_j(x) a_j,
V_j and Q_j the single and double integral of the Lagrange polynomial l_j from 0 to x: position and rate belong to one
motion, which a first-order scheme on (q, v) gives at the ends of an interval at best.
Source: S. Moreno-Martin, L. Ros, E. Celaya, "Collocation methods for second and higher order systems", 2023
(arXiv 2302.09056). The nodes: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, sec. IV.5.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

MOST_POINTS = 9  # CasADi knows the Radau points of so many; no plan wants more


@dataclass(frozen=True)
class Scheme:
    """Fractions c [s] of an interval; `shared`: the first point is the node where the interval begins."""

    name: str
    c: np.ndarray
    shared: bool
    order: int

    @property
    def size(self):
        return self.c.size

    def values(self, x):
        """l_j [len(x) x s] at fractions x."""
        return self._polynomial(x, 0)

    def rates(self, x):
        """V_j [len(x) x s]: integrals of l_j from 0 to x."""
        return self._polynomial(x, 1)

    def positions(self, x):
        """Q_j [len(x) x s]: double integrals of l_j from 0 to x."""
        return self._polynomial(x, 2)

    @property
    def weights(self):
        """Quadrature weights [s] of the whole interval."""
        return self.rates([1.0])[0]

    def knots(self, inputs, continuous):
        """Fractions [p] whose values make the inputs of an interval: `linear`, `constant`, or through the `points`."""
        if inputs == "points":
            return self.c if self.shared or not continuous else np.array([0.0, *self.c])
        return np.array([0.0, 1.0] if inputs == "linear" else [1.0])

    def _polynomial(self, x, integrals):
        s = self.size
        powers = np.linalg.inv(np.vander(self.c, increasing=True)).T  # l_j = sum_k [j, k] x^k
        k = np.arange(s)
        factors = np.ones(s)
        for i in range(1, integrals + 1):
            factors = factors / (k + i)
        x = np.atleast_1d(np.asarray(x, dtype=float))
        return x[:, None] ** (k + integrals) @ (powers * factors).T


def through(knots, x):
    """[len(x) x p]: value at fractions x of the polynomial through values at knots [p]."""
    powers = np.linalg.inv(np.vander(knots, increasing=True)).T
    return np.vander(np.atleast_1d(x), knots.size, increasing=True) @ powers.T


def slopes(knots, x):
    """[len(x) x p]: derivative at fractions x of the polynomial through values at knots [p]."""
    if knots.size == 1:
        return np.zeros((np.size(x), 1))
    powers = np.linalg.inv(np.vander(knots, increasing=True)).T[:, 1:] * np.arange(1, knots.size)
    return np.vander(np.atleast_1d(x), knots.size - 1, increasing=True) @ powers.T


def lobatto(points):
    """Legendre-Gauss-Lobatto fractions of [0, 1]: both ends and the extrema of P_(points - 1)."""
    inner = np.polynomial.legendre.Legendre.basis(points - 1).deriv().roots() if points > 2 else []
    return (np.array([-1.0, *np.sort(np.real(inner)), 1.0]) + 1) / 2


@lru_cache(maxsize=32)
def scheme(name, points):
    """Scheme of a name in SCHEMES and a number of points (given by the name for the two classical ones)."""
    return SCHEMES[name](points)


def _radau(points):
    return Scheme("radau", np.array(ca.collocation_points(points, "radau")), False, 2 * points - 1)


def _lobatto(points):
    return Scheme("lobatto", lobatto(points), True, 2 * points - 2)


SCHEMES = {
    "radau": _radau,
    "lobatto": _lobatto,
    "trapezoidal": lambda points: _lobatto(2),
    "hermite_simpson": lambda points: _lobatto(3),
}
LEAST = {"radau": 1, "lobatto": 2}
FIXED = {"trapezoidal": 2, "hermite_simpson": 3}
