"""Where lines run inside rods: offset d(X) = (0, y, z) from the axis, and its slopes along the way.

    parallel    d constant
    converging  d linear in X
    helix       y = r cos(phase + 2 pi turns X), z = r sin(phase + 2 pi turns X), r constant or linear in X
with X in [0, 1] over all the segments a line runs along, whatever part of them it covers.
"""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Any

import casadi as ca

from socontrol.quantities import Distance, Length, Metre, Number, OneOf, Pair, Radian, record

Offset = Pair[Metre]


@dataclass(frozen=True)
class Parallel:
    """(y, z) all along."""

    offset: Any

    def at(self, X):
        return self.offset

    def slope(self, X):
        return 0, 0

    bend = slope


@record(kw_only=True)
class Converging:
    """(y, z) changes linearly from `start` to `end` over all the segments the line runs along."""

    start: Offset
    end: Offset

    def at(self, X):
        """(y, z) [m]."""
        return tuple((1 - X) * a + X * b for a, b in zip(self.start, self.end, strict=True))

    def slope(self, X):
        """d(y, z)/dX [m]."""
        return tuple(b - a for a, b in zip(self.start, self.end, strict=True))

    def bend(self, X):
        """d2(y, z)/dX2 [m]."""
        return 0, 0


@record(kw_only=True)
class Helix:
    """Winds `turns` times about the axis, from y to z where above 0, over all the segments the line runs along.

    y = r cos a, z = r sin a, a = phase + 2 pi turns X; r goes linearly from `radius` to `end_radius`, default the same.
    """

    radius: Length
    turns: Number
    phase: Radian = 0.0
    end_radius: Distance | None = None

    def at(self, X):
        """(y, z) [m]."""
        r, _, _, (c, s) = self._polar(X)
        return r * c, r * s

    def slope(self, X):
        """d(y, z)/dX [m]."""
        r, grows, w, (c, s) = self._polar(X)
        return grows * c - r * w * s, grows * s + r * w * c

    def bend(self, X):
        """d2(y, z)/dX2 [m]."""
        r, grows, w, (c, s) = self._polar(X)
        return -2 * grows * w * s - r * w * w * c, 2 * grows * w * c - r * w * w * s

    def _polar(self, X):
        """r, dr/dX, da/dX, (cos a, sin a)."""
        grows = 0 if self.end_radius is None else self.end_radius - self.radius
        w = 2 * pi * self.turns
        a = self.phase + w * X
        return self.radius + grows * X, grows, w, (ca.cos(a), ca.sin(a))


ROUTES = {"helix": Helix}
Winding = Annotated[Any, OneOf(ROUTES, what="route")]


@dataclass(frozen=True)
class Route:
    """A route over `total` metres."""

    kind: Any
    total: Any

    @property
    def parallel(self):
        return isinstance(self.kind, Parallel)

    def at(self, X):
        """d [3]."""
        return ca.vertcat(0, *self.kind.at(X))

    def slope(self, X):
        """dd/ds [3]."""
        return ca.vertcat(0, *(value / self.total for value in self.kind.slope(X)))

    def bend(self, X):
        """d2d/ds2 [3]."""
        return ca.vertcat(0, *(value / self.total**2 for value in self.kind.bend(X)))


def route(offset, total):
    """The Route of what a file says: a pair, or one of the records above."""
    return Route(offset if isinstance(offset, (Converging, Helix)) else Parallel(offset), total)


@dataclass(frozen=True)
class Stretch:
    """The part of a route inside one section of rod: fractions `first` to `last` of the way, x from 0 to 1."""

    route: Route
    first: Any
    last: Any

    @property
    def parallel(self):
        return self.route.parallel

    def at(self, x):
        """d [3] at x."""
        return self.route.at(self._X(x))

    def slope(self, x):
        """dd/ds [3] at x."""
        return self.route.slope(self._X(x))

    def bend(self, x):
        """d2d/ds2 [3] at x."""
        return self.route.bend(self._X(x))

    def _X(self, x):
        return self.first + (self.last - self.first) * x
