"""Loops: two places of the tree joined by a closing joint of any lumped kind.

With g = g_b^-1 g_a the pose of the joint frame of `a` seen from that of `b`, R and r its rotation and position, each
kind gives as many rows e(q) as it takes away freedoms, zero when closed, in closed form: no row has a cut where a
closing joint turns on and on. To first order the rows are Phi_perp^T log(g); where e = 0 their Jacobian is exactly
    A = Phi_perp^T (Ad_g J_a - J_b),
both Jacobians in the joint frame of b, Phi_perp an orthonormal basis of the null space of Phi^T.
Multipliers lam [force dual to the rows] make tau_loop = A^T lam; Phi_perp lam is the wrench on a by b in b's joint
frame.
Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import casadi as ca
import numpy as np

from socontrol.lie import se3, so3
from socontrol.mechanics.loop_slopes import Slopes, turning
from socontrol.model import joints
from socontrol.model.bodies import Placement
from socontrol.quantities import Axis, Bad, Fraction, MetrePerRadian, OneOf, Text, nearest, record

FLIPPED = 1e-3  # of 1 + cos: axes that point against each other have no nearest way to close
DEPENDENT = 1e-9  # of the largest singular value: rows that hold nothing of their own


@record(kw_only=True)
class End:
    """A place on the robot (or `world`), and the joint's frame there."""

    segment: Annotated[str, Text("the name of a segment, or 'world'")]
    at: Fraction = 1.0
    placement: Placement = Placement()

    def locate(self, tree):
        """Frame of the end, None for the world; raises Bad naming the key."""
        if self.segment == "world":
            return None
        if self.segment not in tree.of:
            raise Bad("segment", f"unknown segment '{self.segment}'{nearest(self.segment, ['world', *tree.of])}")
        try:
            return tree.locate(self.segment, self.at)
        except ValueError as error:
            raise Bad("at", str(error)) from None

    def pose(self, kin, frame):
        """World <- joint frame [4 x 4]."""
        placement = self.placement.pose()
        return placement if frame is None else kin.frame_pose(frame) @ placement

    def jacobian(self, kin, frame):
        """Body Jacobian [6 x n] of the joint frame."""
        if frame is None:
            return ca.DM(6, kin.tree.n)
        return se3.Ad_inv(self.placement.pose()) @ kin.jacobian(frame)


@record(kw_only=True)
class Closing:
    """What all closing joints share: the ends they join."""

    a: End
    b: End

    units = ()  # of the rows

    def Phi(self):
        """Basis of the motion that is left [6 x d], in the joint frame of b."""
        raise NotImplementedError

    def Phi_perp(self):
        """Orthonormal basis [6 x (6 - d)] of what is held, in the order of `rows`."""
        raise NotImplementedError

    def rows(self, R, r):
        """e [6 - d] of the relative rotation and position."""
        raise NotImplementedError


def _angular(columns):
    return ca.vertcat(columns, ca.DM(3, columns.shape[1]))


def _linear(columns):
    return ca.vertcat(ca.DM(3, columns.shape[1]), columns)


@record(kw_only=True)
class _AlongAxis(Closing):
    """What joints with one axis share."""

    axis: Axis = (1.0, 0.0, 0.0)

    @property
    def _a(self):
        return joints.unit(self.axis)

    @property
    def _across(self):
        return joints.normal_basis(self.axis)

    def _tilt(self, R):
        """The axis of a across that of b [2]: twice the tangent of half the angle between them, and which way."""
        a, turned = self._a, R @ self._a
        c = ca.dot(a, turned)
        return self._across.T @ ca.cross(a, turned) * 2 / ca.fmax(1 + c, FLIPPED)

    def _aside(self, R, r):
        """How far the origin of a is off the axis [2]."""
        return self._across.T @ (r - ca.dot(self._a, r) * (R @ self._a))


@record(kw_only=True)
class Revolute(_AlongAxis):
    """Turns about `axis`."""

    units = ("rad",) * 2 + ("m",) * 3

    def Phi(self):
        return _angular(self._a)

    def Phi_perp(self):
        return ca.horzcat(_angular(self._across), _linear(ca.DM.eye(3)))

    def rows(self, R, r):
        return ca.vertcat(self._tilt(R), r)


@record(kw_only=True)
class Prismatic(_AlongAxis):
    """Slides along `axis`."""

    units = ("rad",) * 3 + ("m",) * 2

    def Phi(self):
        return _linear(self._a)

    def Phi_perp(self):
        return ca.horzcat(_angular(ca.DM.eye(3)), _linear(self._across))

    def rows(self, R, r):
        return ca.vertcat(so3.log(R), self._aside(R, r))


@record(kw_only=True)
class Helical(_AlongAxis):
    """Turns about `axis` and advances `pitch` metres per radian."""

    pitch: MetrePerRadian

    units = ("rad",) * 2 + ("m",) * 3

    def Phi(self):
        return ca.vertcat(self._a, self.pitch * self._a)

    def Phi_perp(self):
        held = ca.vertcat(-self.pitch * self._a, self._a) / ca.sqrt(1 + self.pitch**2)
        return ca.horzcat(_angular(self._across), _linear(self._across), held)

    def rows(self, R, r):
        """The last row holds the turn against the advance modulo a whole turn, so that it has no cut."""
        a, across = self._a, self._across
        turned = R @ across[:, 0]
        turn = ca.atan2(ca.dot(across[:, 1], turned), ca.dot(across[:, 0], turned))
        if self.pitch == 0:
            behind = ca.dot(a, r)
        else:
            gap = turn - ca.dot(a, r) / self.pitch
            behind = -self.pitch * ca.atan2(ca.sin(gap), ca.cos(gap))
        return ca.vertcat(self._tilt(R), self._aside(R, r), behind / ca.sqrt(1 + self.pitch**2))


@record(kw_only=True)
class Cylindrical(_AlongAxis):
    """Turns about `axis` and slides along it."""

    units = ("rad",) * 2 + ("m",) * 2

    def Phi(self):
        return ca.horzcat(_angular(self._a), _linear(self._a))

    def Phi_perp(self):
        return ca.horzcat(_angular(self._across), _linear(self._across))

    def rows(self, R, r):
        return ca.vertcat(self._tilt(R), self._aside(R, r))


@record(kw_only=True)
class Planar(_AlongAxis):
    """Moves in the plane across `axis`, its normal."""

    axis: Axis = (0.0, 0.0, 1.0)

    units = ("rad",) * 2 + ("m",)

    def Phi(self):
        return ca.horzcat(_angular(self._a), _linear(self._across))

    def Phi_perp(self):
        return ca.horzcat(_angular(self._across), _linear(self._a))

    def rows(self, R, r):
        return ca.vertcat(self._tilt(R), ca.dot(R @ self._a, r))


@record(kw_only=True)
class Spherical(Closing):
    """Turns freely about a point."""

    units = ("m",) * 3

    def Phi(self):
        return _angular(ca.DM.eye(3))

    def Phi_perp(self):
        return _linear(ca.DM.eye(3))

    def rows(self, R, r):
        return r


@record(kw_only=True)
class Fixed(Closing):
    """No motion: the two ends are welded."""

    units = ("rad",) * 3 + ("m",) * 3

    def Phi(self):
        return ca.DM(6, 0)

    def Phi_perp(self):
        return ca.DM.eye(6)

    def rows(self, R, r):
        return ca.vertcat(so3.log(R), r)


class Loops:
    """Rows of all loops {name: record} at one q."""

    def __init__(self, loops, kin):
        self.loops, self.kin = loops, kin
        self._frames = {name: (loop.a.locate(kin.tree), loop.b.locate(kin.tree)) for name, loop in loops.items()}

    @property
    def units(self):
        """Unit of each row."""
        return units_of(self.loops)

    def relative(self, name):
        """g [4 x 4]: joint frame of a seen from that of b."""
        loop, (a, b) = self.loops[name], self._frames[name]
        return se3.inverse(loop.b.pose(self.kin, b)) @ loop.a.pose(self.kin, a)

    def error(self):
        """e(q) of all loops, in file order."""
        rows = [loop.rows(se3.rotation(g), se3.position(g))
                for loop, g in ((loop, self.relative(name)) for name, loop in self.loops.items())]  # fmt: skip
        return ca.vertcat(*rows) if rows else ca.DM(0, 1)

    def slope(self):
        """E(q) = de/dq [k x n] of all loops."""
        rows = [slopes.E for slopes in self._slopes]
        return ca.vertcat(*rows) if rows else ca.DM(0, self.kin.tree.n)

    def turning(self, lam):
        """d(E^T lam)/dq [n x n]."""
        return turning(self.kin, self._slopes, [lam[own] for own in slices(self.loops).values()])

    @cached_property
    def _slopes(self):
        return [Slopes(loop, self.kin, self._frames[name]) for name, loop in self.loops.items()]

    def jacobian(self):
        """A(q) of all loops: A qd = 0 is what closed loops leave."""
        rows = []
        for name, loop in self.loops.items():
            a, b = self._frames[name]
            apart = se3.Ad(self.relative(name)) @ loop.a.jacobian(self.kin, a) - loop.b.jacobian(self.kin, b)
            rows.append(loop.Phi_perp().T @ apart)
        return ca.vertcat(*rows) if rows else ca.DM(0, self.kin.tree.n)


def slices(loops):
    """{name: slice} of the rows of each loop, in file order."""
    found, first = {}, 0
    for name, loop in loops.items():
        found[name] = slice(first, first + len(loop.units))
        first = found[name].stop
    return found


def units_of(loops):
    """Unit of each row, in file order."""
    return tuple(unit for loop in loops.values() for unit in loop.units)


def loop_of(loops, row):
    """Name of the loop that a row belongs to."""
    return next(name for name, own in slices(loops).items() if own.start <= row < own.stop)


def reach(units, size):
    """[k]: how much of each row's unit counts as 1: one rad, or `size` of those in m."""
    return np.where(np.array(units, dtype=object) == "rad", 1.0, size)


@dataclass(frozen=True)
class Split:
    """Rows [k x n] over their reach as U diag(s) Vt, s falling: `rank` of them do not depend on each other.

    Vt [n x n], its first `rank` rows what is held; U [k x rank], s [rank].
    """

    rank: int
    Vt: np.ndarray
    U: np.ndarray
    s: np.ndarray

    @property
    def held(self):
        """[rank x n]: orthonormal directions that rows hold."""
        return self.Vt[: self.rank]

    @property
    def left(self):
        """Z [n x n - rank]: orthonormal motions that rows leave."""
        return self.Vt[self.rank :].T

    @property
    def inverse(self):
        """U / s [k x rank]: of what is held to rows."""
        return self.U / self.s

    def least(self, force):
        """The least multipliers [k], times reach, that push as what rows hold of a force [n]."""
        return self.inverse @ (self.held @ force)


def independent(rows, units, size):
    """Split of rows [k x n], those in m taken over `size`."""
    if not rows.size:
        return Split(0, np.eye(rows.shape[1]), np.zeros((rows.shape[0], 0)), np.zeros(0))
    U, s, Vt = np.linalg.svd(rows / reach(units, size)[:, None])
    rank = int(np.sum(s > DEPENDENT * np.max(s, initial=0.0)))
    return Split(rank, Vt, U[:, :rank], s[:rank])


def chosen(rows, units, size):
    """Indices, rising, of rows [k x n] that hold what all of them hold and do not depend on each other.

    The row farthest from those taken before is taken next; those in m count over `size`. As many as `independent` says.
    """
    left, found = rows / reach(units, size)[:, None], []
    for _ in range(independent(rows, units, size).rank):
        distance = np.linalg.norm(left, axis=1)
        distance[found] = 0.0
        found.append(int(np.argmax(distance)))
        along = left[found[-1]] / distance[found[-1]]
        left = left - np.outer(left @ along, along)
    return np.array(sorted(found), dtype=int)


LOOPS = {
    "revolute": Revolute,
    "prismatic": Prismatic,
    "helical": Helical,
    "cylindrical": Cylindrical,
    "planar": Planar,
    "spherical": Spherical,
    "fixed": Fixed,
}
Loop = Annotated[Any, OneOf(LOOPS, what="closing joint")]
