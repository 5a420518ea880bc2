"""Gauss-Legendre quadrature on [0, 1] (exact for polynomials of degree 2 n - 1)."""

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=64)
def gauss_legendre(count):
    """Nodes and weights [count] each, weights summing to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return tuple((1 + nodes) / 2), tuple(weights / 2)
