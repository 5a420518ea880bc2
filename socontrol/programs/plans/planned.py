"""A planned motion in numbers: polynomials in every interval, to be sampled, drawn and driven by."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from socontrol.programs.plans.schemes import Scheme, slopes, through


@dataclass(frozen=True)
class Planned:
    """shares [N] of the duration; q, v [N+1 x n] at nodes; a [N x s x n] at points; u [N x p x m] at knots.

    knots [p]: fractions of an interval whose values make the polynomials of the inputs."""

    scheme: Scheme
    duration: float
    shares: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    knots: np.ndarray

    @cached_property
    def nodes(self):
        """Times [N+1] of the nodes."""
        return np.concatenate([[0.0], np.cumsum(self.shares)]) * self.duration / np.sum(self.shares)

    @property
    def points(self):
        """Times [N s] of the collocation points."""
        return (self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * self.scheme.c).ravel()

    def at(self, times):
        """q, v, a [K x n], u and its rate [K x m] at times; at a node, what the interval before it says."""
        times = np.asarray(times, dtype=float)
        k = np.clip(np.searchsorted(self.nodes, times, side="left") - 1, 0, len(self.shares) - 1)
        h = np.diff(self.nodes)[k]
        return self.inside(k, (times - self.nodes[k]) / h)

    def inside(self, k, x):
        """The same at fractions x of intervals k."""
        k, x, scheme = np.asarray(k), np.asarray(x, dtype=float), self.scheme
        h = np.diff(self.nodes)[k][:, None]
        a = self.a[k]
        q = self.q[k] + h * x[:, None] * self.v[k] + h**2 * np.einsum("ks,ksn->kn", scheme.positions(x), a)
        v = self.v[k] + h * np.einsum("ks,ksn->kn", scheme.rates(x), a)
        u, ud = (np.einsum("kp,kpm->km", rows(self.knots, x), self.u[k]) for rows in (through, slopes))
        return q, v, np.einsum("ks,ksn->kn", scheme.values(x), a), u, ud / h
