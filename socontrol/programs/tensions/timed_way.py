"""A path of postures run through in time: a smooth curve through what was solved at rest, at the pace of a timing."""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.programs.postures.paths import is_closed, shares

SAME = 1e-6  # of a coordinate's scale: one that ends this near to its beginning comes back
WRAP = 12  # knots by which a closed curve goes on beyond its ends: 0.27^12 of an end's error is left


class Curve:
    """A cubic spline through rows [K x n] at rising x [K]; `closed`: it goes on behind the last row as at the first."""

    def __init__(self, x, rows, closed=False):
        x, rows = np.asarray(x, dtype=float), np.asarray(rows, dtype=float)
        if closed:
            turns, own = np.divmod(np.arange(-WRAP, len(x) + WRAP), len(x) - 1)
            x, rows = x[own] + turns * (x[-1] - x[0]), rows[own]
        while len(x) < 4:  # a straight line or a parabola holds too few knots for a cubic
            x, rows = _halved(x, rows)
        self._width = rows.shape[1]
        self._spline = ca.interpolant("curve", "bspline", [x], rows.ravel()) if self._width else None

    def __call__(self, x):
        """Rows and their first and second derivatives at x [K], [K x n] each."""
        x = np.asarray(x, dtype=float)
        if not self._width:
            return [np.zeros((len(x), 0))] * 3
        return [np.array(rows).T for rows in self._sampled.map(len(x))(x[None, :])]

    @cached_property
    def _sampled(self):
        x = ca.MX.sym("x")
        rows = [self._spline(x)]
        for _ in range(2):
            rows.append(ca.jtimes(rows[-1], x, ca.MX(1)))
        return ca.Function("sampled", [x], rows)


def _halved(x, rows):
    """Knots and, between them, points of the polynomial through all."""
    fine = np.sort(np.concatenate([x, (x[1:] + x[:-1]) / 2]))
    powers = np.vander(x - x[0], len(x))
    return fine, np.vander(fine - x[0], len(x)) @ np.linalg.solve(powers, rows)


class Way:
    """A path solved at rest, over the share of its length: postures q [K x n] and waypoints [K x 3], a cubic spline
    through each. size [n]: scale of the coordinates."""

    def __init__(self, waypoints, q, size):
        share, points = shares(waypoints), np.array(waypoints)
        kept = np.concatenate([[True], np.diff(share) > 0])
        share, points, q = share[kept], points[kept], q[kept]
        closed = is_closed(points)
        again = closed and bool(np.all(np.abs(q[0] - q[-1]) <= SAME * size))
        self._points, self._q = Curve(share, points, closed), Curve(share, q, again)

    def place(self, share):
        """Points [K x 3] of the path at shares [K] of its length."""
        return self._points(share)[0]

    def timed(self, timing, t):
        """q, qd, qdd [K x n] at t [K]."""
        share, speed, change = (x[:, None] for x in timing.share(t))
        q, first, second = self._q(share[:, 0])
        return q, first * speed, second * speed**2 + first * change
