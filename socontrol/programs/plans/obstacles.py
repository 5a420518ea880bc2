"""Obstacles: what a robot's body keeps out of, and the places of the body that are looked at.

The signed distance d(p) of a point is below 0 inside. Kinks are rounded, so that d and its first and second
derivatives are finite and continuous everywhere: on axes, at centres, on faces, edges and corners. Rounding errs
towards the obstacle: outside, d is never above the true distance, and below it by at most 1e-4 of the obstacle's
size (radius; smallest side of a box). At the centre of a sphere, on the axis of a capsule and where a box is
symmetric the derivative across is 0: from there no way out is nearest.

A body is a row of balls (`stations`) of the radius of its cross-section, held clear one by one. An obstacle of
radius R sinks in between two balls of radius r, a distance h apart, by at most (r + R) - sqrt((r + R)^2 - h^2/4):
0.06 r for R = r and h = r. The edge of a box has R = 0; what is flat sinks in by nothing.
"""

import re
from dataclasses import dataclass, replace
from math import ceil, hypot, inf
from typing import Annotated, Any

import casadi as ca
import numpy as np

from socontrol.lie import se3, so3
from socontrol.mechanics.kinematics import Kinematics
from socontrol.model.rods import Rod
from socontrol.model.sections import section_at
from socontrol.model.tree import Frame
from socontrol.quantities import (
    Axis,
    Bad,
    Distance,
    Length,
    OneOf,
    Position,
    RotationVector,
    Triple,
    is_symbolic,
    nearest,
    record,
)
from socontrol.units import LONGEST, QUANTITY

ROUND = 0.01  # radius of a rounding over that of what is round: errors are of second order, ROUND^2
SHARP = 6e-5  # the same over the smallest side of a box, whose edges it moves by up to 1.5 SHARP
MOST = 200  # intervals of a section or rigid segment for the sake of a small obstacle
SMALLEST = 1e-9  # m, of a size: squares of roundings stay far from underflow


def _refuse_speck(key, size):
    """Raise Bad for a size that is not at least SMALLEST."""
    if not is_symbolic(size) and not size >= SMALLEST:
        raise Bad(key, f"{size:g} m is too small for an obstacle; at least {SMALLEST:g} m")


def _ball(offset, radius):
    """|offset| - radius [1 x k] of columns [3 x k], rounded at 0 and exact on the surface.

    With e the rounding: not above the true value outside, below it by at most e^2 / (2 radius).
    """
    e = ROUND * radius
    return ca.sqrt(ca.sum1(offset**2) + e**2) - ca.sqrt(radius**2 + e**2)


def _positive(x, width):
    """max(x, 0), above it by at most width / 2 and never 0 to the precision of a number; -_positive(-x) is min(x, 0),
    and the two sum to x."""
    return (x + ca.sqrt(x**2 + width**2)) / 2


@record(kw_only=True)
class Sphere:
    """A ball."""

    center: Position
    radius: Length
    clearance: Distance = 0.0

    def __post_init__(self):
        _refuse_speck("radius", self.radius)

    @property
    def reach(self):
        """How far apart places of a thin body may be looked at [m]."""
        return self.radius

    def distance(self, p):
        """Signed distance [1 x k, m] of points p [3 x k]."""
        return _ball(p - ca.vertcat(*self.center), self.radius)


@record(kw_only=True)
class Capsule:
    """All points within `radius` of the straight line from `from` to `to`; a ball where these are one point.

    The second derivative changes from that of a cylinder to that of a ball within about ROUND radius of the planes
    through the ends.
    """

    from_: Position
    to: Position
    radius: Length
    clearance: Distance = 0.0

    def __post_init__(self):
        _refuse_speck("radius", self.radius)

    @property
    def reach(self):
        """How far apart places of a thin body may be looked at [m]."""
        return self.radius

    def distance(self, p):
        """Signed distance [1 x k, m] of points p [3 x k], from a point of the line next to the nearest one."""
        a, b = np.array(self.from_, dtype=float), np.array(self.to, dtype=float)
        half = np.linalg.norm(b - a) / 2
        axis = ca.DM((b - a) / (2 * half) if half > 0 else np.zeros(3))
        x, e = p - ca.DM((a + b) / 2), ROUND * self.radius
        s = axis.T @ x
        along = (ca.sqrt((s + half) ** 2 + e**2) - ca.sqrt((s - half) ** 2 + e**2)) / 2  # s, held between the ends
        return _ball(x - axis @ along, self.radius) - e**2 / (4 * self.radius)  # the least that keeps below the truth


@record(kw_only=True)
class Box:
    """A box with sides `size` along its own axes, turned by `rotation` about its `center`.

    The first derivative turns within about SHARP of the smallest side: at edges and corners of the box, and inside
    where two faces are equally near.
    """

    center: Position
    size: Triple[Length]
    rotation: RotationVector = (0.0, 0.0, 0.0)
    clearance: Distance = 0.0

    def __post_init__(self):
        for k, side in enumerate(self.size):
            _refuse_speck(f"size.{k}", side)

    @property
    def reach(self):
        """How far apart places of a thin body may be looked at [m]: less than that of its edges is not seen."""
        return min(self.size) / 2

    def distance(self, p):
        """Signed distance [1 x k, m] of points p [3 x k]: |max(past, 0)| + min(max(past), 0), past [3] the faces."""
        half, w = ca.vertcat(*self.size) / 2, SHARP * min(self.size)
        x = so3.exp(ca.vertcat(*self.rotation)).T @ (p - ca.vertcat(*self.center))
        past = ca.sqrt(x**2 + w**2) - ca.sqrt(half**2 + w**2)
        farthest = past[0, :] + _positive(past[1, :] - past[0, :], w)
        farthest = farthest + _positive(past[2, :] - farthest, w)
        return ca.sqrt(ca.sum1(_positive(past, w) ** 2)) - _positive(-farthest, w) - w


@record(kw_only=True)
class HalfSpace:
    """All on the side of the plane through `point` that `normal` points away from; exact."""

    point: Position
    normal: Axis
    clearance: Distance = 0.0

    def __post_init__(self):
        if not any(is_symbolic(x) or x for x in self.normal):
            raise Bad("normal", "all numbers are zero; give the direction out of the obstacle, e.g. [0, 0, 1]")

    @property
    def reach(self):
        """How far apart places of a thin body may be looked at [m]: it has no edge."""
        return inf

    def distance(self, p):
        """Signed distance [1 x k, m] of points p [3 x k]."""
        n = np.array(self.normal, dtype=float) / np.max(np.abs(self.normal))
        return ca.DM(n / np.linalg.norm(n)).T @ (p - ca.vertcat(*self.point))


OBSTACLES = {"sphere": Sphere, "capsule": Capsule, "box": Box, "half_space": HalfSpace}
Obstacle = Annotated[Any, OneOf(OBSTACLES, what="obstacle")]

FLAGS = {  # in the order of a flag's numbers: keys, and how many numbers each takes
    "sphere": {"center": 3, "radius": 1},
    "capsule": {"from": 3, "to": 3, "radius": 1},
    "box": {"center": 3, "size": 3},
    "half_space": {"point": 3, "normal": 3},
}


def parse(text):
    """What a file says for `sphere:0.05,0,0.05,10 mm` and the like: a mapping, numbers with units left as text.

    Raises ValueError with what is wrong and how the kind is written.
    """
    kind, _, numbers = text.partition(":")
    kind = kind.strip()
    if kind not in FLAGS:
        forms = nearest(kind, FLAGS) if kind else f"; allowed: {', '.join(FLAGS)}"
        raise ValueError(f"'{text[:LONGEST]}': unknown obstacle '{kind[:LONGEST]}'{forms}")
    keys = FLAGS[kind]
    words = [f"{key} x,y,z" if count == 3 else key for key, count in keys.items()]
    form = f"{kind} takes {sum(keys.values())} numbers: {', '.join(words)}"
    given = [_number(word.strip(), form) for word in numbers.split(",")] if numbers.strip() else []
    if len(given) != sum(keys.values()):
        raise ValueError(f"'{text[:LONGEST]}': {len(given)} given; {form}")
    mapping = {"type": kind}
    for key, count in keys.items():
        mapping[key], given = given[:count] if count > 1 else given[0], given[count:]
    return mapping


def _number(word, form):
    """The float of `0.05`, the text of `50 mm`."""
    match = QUANTITY.fullmatch(word) if len(word) <= LONGEST else None
    if match is None:
        raise ValueError(f"'{word[:LONGEST]}' is not a number; {form}")
    return float(match[1]) if match[2] is None else re.sub(r"\s+", " ", word)


@dataclass(frozen=True)
class Station:
    """A ball of the body: X on a rod, or the share of the straight line from moving to end frame of a rigid segment.

    held: no coordinate moves it.
    """

    segment: str
    X: float
    radius: float
    held: bool = False

    @property
    def name(self):
        return f"{self.segment} at {self.X:.4g}"


def moving(robot, per_section, obstacle):
    """The stations that can come near an obstacle: those that move, near enough together for its size."""
    return [station for station in stations(robot, per_section, obstacle.reach) if not station.held]


def stations(robot, per_section=3, reach=inf):
    """Stations along every rod, ends and section boundaries among them, and along every rigid segment.

    At least `per_section` intervals a section or rigid segment, none wider than the larger of 3 radii and a tenth of
    the robot, over `per_section`, nor than the body's radius and an obstacle's `reach` [m] together. Rigid segments
    have no thickness, those without a tip are one point; of stations in one place the thickest is kept. What stands
    between a segment and its placed child is not looked at.
    """
    rows = []
    for name, segment in robot.tree.segments.items():
        if isinstance(segment, Rod):
            rows += _rod_stations(robot, name, segment, per_section, reach)
        else:
            rows += _link_stations(robot, name, per_section, reach)
    return _apart(robot, rows)


def _rod_stations(robot, name, rod, per_section, reach):
    bounds, X = rod.boundaries(), [0.0]
    for a, b in zip(bounds, bounds[1:], strict=False):
        slimmest = min(outer_radius(section_at(rod.cross_section, x)) for x in (a, b))
        count = _intervals(robot, (b - a) * float(rod.length), slimmest, per_section, reach)
        X += [a + (b - a) * k / count for k in range(1, count)] + [b]
    return [Station(name, x, outer_radius(section_at(rod.cross_section, x))) for x in X]


def _link_stations(robot, name, per_section, reach):
    tip = np.array(ca.DM(robot.tree.pieces[robot.tree.of[name][0]].end))[:3, 3]
    if not np.any(tip):
        return [Station(name, 1.0, 0.0)]
    count = _intervals(robot, np.linalg.norm(tip), 0.0, per_section, reach)
    return [Station(name, k / count, 0.0) for k in range(count + 1)]


def _intervals(robot, length, radius, per_section, reach):
    """Number of intervals on a length of body."""
    widest = min(max(3 * radius, robot.length / 10) / per_section, max(radius + reach, length / MOST))
    return max(per_section, ceil(length / widest - 1e-9))


def outer_radius(section):
    """Radius [m] of the circle round the outline of a cross-section, about its centre."""
    kind, *sizes = section.outline()[0]
    sizes = [float(size) for size in sizes]
    return hypot(*sizes) / 2 if kind == "rectangle" else max(sizes)


def _apart(robot, rows):
    """The stations without those that always coincide with a thicker one; `held` is set."""
    wave = min(0.3, 1 / robot.length) * np.sin(np.arange(1.0, 2 * robot.n + 1)).reshape(2, robot.n)
    shapes = [Kinematics(robot.tree, ca.DM(q)) for q in (np.zeros(robot.n), *wave)]  # two that nothing makes special
    places = np.array([np.array(_positions(robot, kin, rows)).T for kin in shapes])  # [3 shapes x stations x 3]
    same, kept = 1e-9 * robot.length, []
    held = np.max(np.abs(places - places[0]), axis=(0, 2)) < same
    for k, station in enumerate(rows):
        gaps = np.max(np.abs(places[:, kept] - places[:, [k]]), axis=(0, 2))
        twins = np.flatnonzero(gaps < same)
        if not len(twins):
            kept.append(k)
        elif station.radius > rows[kept[twins[0]]].radius:
            kept[twins[0]] = k
    return [replace(rows[k], held=bool(held[k])) for k in kept]


def _positions(robot, kin, rows):
    """Positions [3 x k] of stations."""
    return ca.horzcat(*(se3.position(kin.frame_pose(_frame(robot, station))) for station in rows))


def _frame(robot, station):
    """Frame of a station."""
    if isinstance(robot.tree.segments[station.segment], Rod):
        return robot.tree.locate(station.segment, station.X)
    piece = robot.tree.of[station.segment][0]
    return Frame(piece, 1.0, se3.pose(ca.DM.eye(3), station.X * robot.tree.pieces[piece].end[:3, 3]))


def clearances(robot, kin, obstacle, stations):
    """How far each station is out of an obstacle [number of stations, m]: its distance less radius and clearance."""
    if not stations:
        return ca.DM(0, 1)
    radii = ca.DM([station.radius for station in stations])
    return obstacle.distance(_positions(robot, kin, stations)).T - radii - obstacle.clearance
