"""Goals: what the robot should hold. A goal without weight is met exactly; with a weight its miss joins the cost.

Each record gives rows of miss(kin, target) in `units`, zero when met, `scales` to divide them by, and its target as
a flat list of numbers, so that a program keeps targets as parameters and can be solved again for others. Where the
rows a solver likes are not what a person would measure, a record adds `measured`, `distance` (for nearest postures)
and `guard` (positive on the right side).
"""

from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np

from socontrol.lie import se3, so3
from socontrol.mechanics.kinematics import Kinematics
from socontrol.model.bases import STRAINS
from socontrol.programs.postures.waypoints import Way, unit
from socontrol.quantities import (
    Axis,
    Bad,
    Fraction,
    Metre,
    Numbers,
    OneOf,
    Position,
    PositiveNumber,
    RotationVector,
    Unit,
    joined,
    record,
)

PerMetre = Annotated[float, Unit("1/m")]
PartialPosition = Annotated[tuple[Metre | None, Metre | None, Metre | None], Numbers(3)]


def locate(robot, goal):
    """Frame of a goal; raises Bad naming the key."""
    try:
        return robot.tree.locate(goal.on, goal.at)
    except ValueError as error:
        raise Bad("at" if goal.on in robot.tree.of else "on", str(error)) from None


@record(kw_only=True)
class Point:
    """The origin of the frame at X of a segment stands at `target` (world, m); null leaves a coordinate free."""

    on: str
    target: PartialPosition
    at: Fraction = 1.0
    weight: PositiveNumber | None = None

    def __post_init__(self):
        if all(x is None for x in self.target):
            raise Bad("target", "all three coordinates are free; give at least one")

    @property
    def rows(self):
        return [i for i, x in enumerate(self.target) if x is not None]

    def numbers(self):
        return [self.target[i] for i in self.rows]

    def units(self):
        return ["m"] * len(self.rows)

    def scales(self, length):
        return [length] * len(self.rows)

    def miss(self, robot, kin, target):
        return se3.position(kin.frame_pose(locate(robot, self)))[self.rows] - target

    def reached(self, f, q):
        """Numbers of the target that q meets."""
        return np.array(f.pose(self.on, self.at)(q))[self.rows, 3]

    def between(self, start, stop, t):
        """Numbers of the target on the way from `start` to `stop`."""
        return (1 - t) * start + t * stop


@record(kw_only=True)
class PoseTarget:
    """A world pose: position [m] and rotation vector [rad]."""

    position: Position
    rotation: RotationVector


@record(kw_only=True)
class Pose:
    """The frame at X of a segment has this world pose."""

    on: str
    target: PoseTarget
    at: Fraction = 1.0
    weight: PositiveNumber | None = None

    def numbers(self):
        return [*self.target.position, *self.target.rotation]

    def units(self):
        return ["m"] * 3 + ["rad"] * 3

    def scales(self, length):
        return [length] * 3 + [1.0] * 3

    def miss(self, robot, kin, target):
        g = kin.frame_pose(locate(robot, self))
        turn = so3.log(so3.exp(target[3:]).T @ se3.rotation(g))
        return ca.vertcat(se3.position(g) - target[:3], turn)

    def reached(self, f, q):
        g = f.pose(self.on, self.at)(q)
        return np.array(ca.vertcat(g[:3, 3], so3.log(g[:3, :3]))).ravel()

    def between(self, start, stop, t):
        R0, R1 = so3.exp(ca.DM(start[3:])), so3.exp(ca.DM(stop[3:]))
        turned = so3.log(R0 @ so3.exp(t * so3.log(R0.T @ R1)))
        return np.concatenate([(1 - t) * start[:3] + t * stop[:3], np.array(turned).ravel()])


@record(kw_only=True)
class AxisDirection:
    """The body direction `axis` (default: along the segment) at X of a segment points along `target` in the world."""

    on: str
    target: Axis
    axis: Axis = (1.0, 0.0, 0.0)
    at: Fraction = 1.0
    weight: PositiveNumber | None = None

    def numbers(self):
        return list(unit(self.target))

    def units(self):
        return ["rad"] * 2

    def scales(self, length):
        return [1.0] * 2

    def miss(self, robot, kin, target):
        """The two components of the axis across the target; the opposite direction is excluded by `guard`."""
        return self._beside(target).T @ self._direction(robot, kin)

    def guard(self, robot, kin, target):
        """Positive on the target's side: cosine of the angle between axis and target."""
        return ca.dot(self._direction(robot, kin), target)

    def distance(self, robot, kin, target):
        """Chord between axis and target [3]: what a nearest posture makes small."""
        return self._direction(robot, kin) - target

    def measured(self, robot, kin, target):
        """The angle between axis and target [rad], as a vector [2] across the target."""
        a = self._direction(robot, kin)
        beside = self._beside(target).T @ a
        size = ca.norm_2(beside)
        away = ca.if_else(size > 1e-12, beside / ca.fmax(size, 1e-12), ca.DM([1, 0]))
        return ca.atan2(size, ca.dot(a, target)) * away

    def _direction(self, robot, kin):
        axis = ca.DM(unit(self.axis))
        return se3.rotation(kin.frame_pose(locate(robot, self))) @ axis

    def _beside(self, target):
        """Two directions [3 x 2] across the target: those of the declared one, turned with it."""
        declared = ca.DM(self.numbers())
        v, c = ca.cross(declared, target), ca.dot(declared, target)
        turn = ca.DM.eye(3) + ca.skew(v) + ca.skew(v) @ ca.skew(v) / (1 + c + 1e-12)
        return turn @ ca.DM(self._across())

    def reached(self, f, q):
        axis = unit(self.axis)
        return np.array(f.pose(self.on, self.at)(q))[:3, :3] @ axis

    def _across(self):
        """Two directions [3 x 2] across the declared target."""
        t = np.array(self.numbers())
        e = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
        e = e / np.linalg.norm(e)
        return np.column_stack([e, np.cross(t, e)])

    def between(self, start, stop, t):
        way = (1 - t) * start + t * stop
        size = np.linalg.norm(way)
        return way / size if size > 1e-9 else stop


class _AtPoints:
    """What goals at several points of one segment have in common; `at` is the last of them."""

    def __post_init__(self):
        if not self.target:
            raise Bad("target", "no point is given")

    @property
    def at(self):
        return self.target[-1].at

    def between(self, start, stop, t):
        return (1 - t) * start + t * stop


@record(kw_only=True)
class ShapePoint:
    """X on the segment and its position [world, m]."""

    at: Fraction
    position: Position


@record(kw_only=True)
class Shape(_AtPoints):
    """Points along one segment stand at given positions; more than the inputs can meet need a `weight`."""

    on: str
    target: tuple[ShapePoint, ...]
    weight: PositiveNumber | None = None

    def numbers(self):
        return [x for point in self.target for x in point.position]

    def units(self):
        return ["m"] * (3 * len(self.target))

    def scales(self, length):
        return [length] * (3 * len(self.target))

    def miss(self, robot, kin, target):
        frames = [locate(robot, Point(on=self.on, at=p.at, target=p.position)) for p in self.target]
        return ca.vertcat(*(se3.position(kin.frame_pose(f)) for f in frames)) - target

    def places(self):
        """(X, rows of the miss) of each point."""
        return [(point.at, slice(3 * k, 3 * k + 3)) for k, point in enumerate(self.target)]

    def reached(self, f, q):
        return np.concatenate([np.array(f.pose(self.on, p.at)(q))[:3, 3] for p in self.target])


@record(kw_only=True)
class CurvaturePoint:
    """X on the segment and the strains its section shall have there [1/m]; those left out are free."""

    at: Fraction
    twist: PerMetre | None = None
    bend_y: PerMetre | None = None
    bend_z: PerMetre | None = None

    def __post_init__(self):
        if not self.wanted():
            raise Bad("at", "no strain is given; give at least one of twist, bend_y and bend_z")

    def wanted(self):
        """{strain: 1/m} of those given."""
        return {name: x for name in STRAINS[:3] if (x := getattr(self, name)) is not None}


@record(kw_only=True)
class Curvature(_AtPoints):
    """A rod has given curvatures at points along it; more than the inputs can meet need a `weight`."""

    on: str
    target: tuple[CurvaturePoint, ...]
    weight: PositiveNumber | None = None

    def numbers(self):
        return [x for point in self.target for x in point.wanted().values()]

    def units(self):
        return ["1/m"] * len(self.numbers())

    def scales(self, length):
        return [1 / length] * len(self.numbers())

    def places(self):
        """(X, rows of the miss) of each point."""
        ends = np.cumsum([0, *(len(point.wanted()) for point in self.target)]).tolist()
        rows = zip(ends, ends[1:], strict=False)
        return [(point.at, slice(a, b)) for point, (a, b) in zip(self.target, rows, strict=True)]

    def miss(self, robot, kin, target):
        return self._strains(robot.tree, kin.q) - target

    def reached(self, f, q):
        return np.array(ca.DM(self._strains(f.base.tree, ca.DM(q)))).ravel()

    def _strains(self, tree, q):
        """The wanted strains at q; raises Bad where the segment is no rod."""
        rows = []
        for k, point in enumerate(self.target):
            piece = tree.pieces[tree.locate(self.on, point.at).piece]
            if not piece.is_rod:
                raise Bad("on", f"'{self.on}' is a joint and has no curvature; name a rod")
            xi = piece.strain(q)
            for name in point.wanted():
                if name not in piece.record.active():
                    free = joined(piece.record.active(), "and")
                    raise Bad(f"target.{k}.{name}", f"'{self.on}' is held straight in {name}; it has {free}")
                rows.append(xi[STRAINS.index(name)])
        return ca.vertcat(*rows)


@record(kw_only=True)
class Path:
    """The point at X of a segment visits waypoints in order, each solved from its neighbour. `axes`: the world
    coordinates that are held; the others are left free, whatever the waypoints say of them."""

    on: str
    target: Way
    at: Fraction = 1.0
    axes: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    orientation: RotationVector | None = None
    weight: PositiveNumber | None = None

    def __post_init__(self):
        try:
            count = len(self.waypoints())
        except Bad as bad:
            raise Bad(f"target.{bad.key}", str(bad)) from None
        if count < 2:
            raise Bad("target", "a path needs at least two waypoints")
        if not self.axes or len(set(self.axes)) < len(self.axes):
            raise Bad("axes", "name one, two or three of x, y and z, each once")
        if self.orientation is not None and len(self.axes) < 3:
            raise Bad("axes", "an orientation goes with all three coordinates; leave one of the two out")

    def waypoints(self):
        return [tuple(p) for p in (self.target if isinstance(self.target, tuple) else self.target.waypoints())]

    def stop(self, waypoint):
        """The goal at one waypoint."""
        if self.orientation is None:
            held = tuple(x if axis in self.axes else None for axis, x in zip("xyz", waypoint, strict=True))
            return Point(on=self.on, at=self.at, target=held, weight=self.weight)
        target = PoseTarget(position=waypoint, rotation=self.orientation)
        return Pose(on=self.on, at=self.at, target=target, weight=self.weight)

    def beside(self, places, tips):
        """Places [K x 3] with the coordinates that are left free as the tips [at most K x 3] have them."""
        free = ["xyz".index(axis) for axis in "xyz" if axis not in self.axes]
        places = np.array(places, dtype=float)
        places[: len(tips), free] = np.asarray(tips)[:, free]
        return places


def goal_miss(goal, robot, q):
    """Miss [rows] of a goal at numeric q, in the units a person would measure."""
    kin = Kinematics(robot.tree, ca.DM(np.asarray(q, dtype=float)))
    rows = getattr(goal, "measured", goal.miss)(robot, kin, ca.DM(goal.numbers()))
    return np.array(ca.DM(rows)).ravel()


GOALS = {
    "point": Point,
    "pose": Pose,
    "axis": AxisDirection,
    "shape": Shape,
    "curvature": Curvature,
    "path": Path,
}
Goal = Annotated[Any, OneOf(GOALS, what="goal")]
