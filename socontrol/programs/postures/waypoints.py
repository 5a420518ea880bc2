"""Ways that a point can be asked to follow: circles, polygons, figures of eight, each as its waypoints."""

from typing import Annotated, Any

import numpy as np

from socontrol.quantities import Axis, Bad, Count, Either, Length, Position, record

MOST_WAYPOINTS = 100_000


def unit(direction):
    """Unit vector along a direction of any size."""
    direction = np.array(direction, dtype=float) / np.max(np.abs(direction))
    return direction / np.linalg.norm(direction)


def plane(normal, start):
    """Unit vectors [3] in the plane across `normal`: nearest `start`, and a right angle on; raises Bad without one."""
    n, e = unit(normal), unit(start)
    e = e - n * np.dot(n, e)
    if np.linalg.norm(e) < 1e-9:
        raise Bad("start", "it is along the normal; give a direction in the plane")
    e = e / np.linalg.norm(e)
    return e, np.cross(n, e)


@record(kw_only=True)
class _Round:
    """`count` waypoints round `center` in the plane across `normal`, closed."""

    center: Position
    normal: Axis = (0.0, 0.0, 1.0)
    start: Axis = (1.0, 0.0, 0.0)
    count: Count

    def __post_init__(self):
        if self.count > MOST_WAYPOINTS:
            raise Bad("count", f"{self.count} waypoints; at most {MOST_WAYPOINTS}")

    def _angles(self):
        """[count + 1] once round."""
        return 2 * np.pi * np.arange(self.count + 1) / self.count


@record(kw_only=True)
class Circle(_Round):
    """`count` waypoints round a circle, closed, from the direction nearest `start`."""

    radius: Length
    count: Count = 36

    def waypoints(self):
        return [tuple(p) for p in around(self, self._angles())]


def around(circle, angles):
    """Points [K x 3] of a circle at angles [K] from the direction nearest its `start`; raises Bad without one."""
    e, across = plane(circle.normal, circle.start)
    angles = np.asarray(angles)[:, None]
    return circle.center + circle.radius * (np.cos(angles) * e + np.sin(angles) * across)


@record(kw_only=True)
class FigureEight(_Round):
    """`count` waypoints round a lying figure of eight, closed: `width` long in the direction nearest `start`, `height`
    high across it, crossing itself in `center`, where it begins."""

    width: Length
    height: Length
    count: Count = 48

    def waypoints(self):
        e, across = plane(self.normal, self.start)
        angles = self._angles()[:, None]
        way = self.width / 2 * np.sin(angles) * e + self.height / 2 * np.sin(2 * angles) * across
        return [tuple(p) for p in np.array(self.center) + way]


@record(kw_only=True)
class Polygon:
    """Straight edges through `corners`, a waypoint at least every `spacing` metres; `closed` returns to the first."""

    corners: tuple[Position, ...]
    spacing: Length
    closed: bool = True

    def __post_init__(self):
        if len(self.corners) < 2:
            raise Bad("corners", "at least two corners are wanted")
        corners = np.array(self.corners)
        around = float(np.sum(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)))
        if not around / self.spacing <= MOST_WAYPOINTS:
            raise Bad("spacing", f"more than {MOST_WAYPOINTS} waypoints; take a larger spacing")

    def waypoints(self):
        corners = [np.array(c) for c in self.corners]
        ends = corners[1:] + corners[:1] if self.closed else corners[1:]
        points = [corners[0]]
        for a, b in zip(corners, ends, strict=False):
            parts = max(1, int(np.ceil(np.linalg.norm(b - a) / self.spacing - 1e-9)))
            points += [a + (b - a) * k / parts for k in range(1, parts + 1)]
        return [tuple(p) for p in points]


Way = Annotated[Any, Either(tuple[Position, ...], Circle, FigureEight, Polygon)]
