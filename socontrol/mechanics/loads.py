"""Loads on a robot, and the wrenches they become.

A record (`LOADS`) says what a file can say; it resolves on a tree into point wrenches and force fields, the two
forms that the recursions know. World axes: the force or moment keeps its direction (a dead load); body axes: it
turns with the segment (a follower). Wrenches [moment; force]; seen from the world they act about its origin.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import casadi as ca

from socontrol.lie import se3
from socontrol.quantities import (
    Bad,
    Density,
    Forces,
    Fraction,
    Moments,
    NewtonMetrePerMetre,
    NewtonPerMetre,
    OneOf,
    Triple,
    Velocity,
    record,
)

ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class PointLoad:
    """A force and a moment at x on a piece, then `offset` [4 x 4]; in body axes if `follower`.

    `spread`: one quadrature point of a load that acts all along the piece.
    """

    piece: int
    x: float
    offset: Any
    force: Any
    moment: Any
    follower: bool
    spread: bool = False

    @property
    def conservative(self):
        """A dead force is the gradient of a potential; dead moments and followers in general are not."""
        return not self.follower and self.moment is None

    def wrench(self, kin):
        """F [6] about the world's origin and dF/ds [6 x 6] for a rigid world twist s of the place it acts on."""
        g = kin.pose(self.piece, self.x) @ self.offset
        force = ca.vertcat(*self.force)
        moment = ca.DM(3, 1) if self.moment is None else ca.vertcat(*self.moment)
        if self.follower:
            F = se3.coAd(g) @ ca.vertcat(moment, force)
            return F, turned(F)
        r = se3.position(g)
        return ca.vertcat(ca.cross(r, force) + moment, force), dead(r, force, 1)


@dataclass(frozen=True)
class Field:
    """A dead force [3] per unit weight on a section of rod; the weights enter by their moments sum_i w_i s_i^k."""

    piece: int
    weights: tuple
    moments: Any
    force: Any
    conservative = True

    @property
    def weight(self):
        return self.moments[0]


def field(piece, index, weights, force):
    """Field of `force` [3] per unit weight on piece `index`, with the moments of its weights."""
    return Field(index, tuple(weights), piece.moments(weights), ca.vertcat(*force))


def dead(weighted_position, force, weight):
    """dF/ds [6 x 6] of dead forces: weighted_position = sum w r, F = [sum w r x force; sum w force]."""
    f, r = ca.skew(force), ca.skew(weighted_position)
    return ca.blockcat([[f @ r, -weight * f], [ca.DM(3, 3), ca.DM(3, 3)]])


def turned(F):
    """C(F) [6 x 6] with C(F) s = coad_s F: how a wrench changes when it is carried along by the twist s."""
    m, f = ca.skew(F[:3]), ca.skew(F[3:])
    return -ca.blockcat([[m, f], [f, ca.DM(3, 3)]])


@record(kw_only=True)
class Wrench:
    """A force [N] and a moment [N m] at X of a segment."""

    on: str
    at: Fraction = 1.0
    force: Forces = ZERO
    moment: Moments = ZERO
    axes: Literal["world", "body"] = "world"

    def resolve(self, tree):
        frame = _locate(tree, self.on, self.at)
        moment = None if is_zero(self.moment) else self.moment
        return [PointLoad(frame.piece, frame.x, frame.offset, self.force, moment, self.axes == "body")]


@record(kw_only=True)
class Distributed:
    """A force [N/m] and a moment [N m/m] per length along a rod."""

    on: str
    force: Triple[NewtonPerMetre] = ZERO
    moment: Triple[NewtonMetrePerMetre] = ZERO
    axes: Literal["world", "body"] = "world"

    def resolve(self, tree):
        pieces = [i for i in tree.of[_locate(tree, self.on, 1.0) and self.on]]
        if not all(tree.pieces[i].is_rod for i in pieces):
            raise Bad("on", f"'{self.on}' is a joint; a distributed load needs a rod (use type 'wrench')")
        loads = []
        for i in pieces:
            weights = tuple(p.weight for p in tree.pieces[i].slices)
            if self.axes == "world" and is_zero(self.moment):
                loads.append(field(tree.pieces[i], i, weights, self.force))
                continue
            for w, p in zip(weights, tree.pieces[i].slices, strict=True):
                force, moment = [w * f for f in self.force], [w * m for m in self.moment]
                loads.append(PointLoad(i, p.x, ca.DM.eye(4), force, moment, self.axes == "body", spread=True))
        return loads


@record(kw_only=True)
class Fluid:
    """Water around the whole robot: buoyancy, and by the segments' `fluid` coefficients drag, lift and added mass.

    `velocity`: of the water, the same everywhere, world axes.
    """

    density: Density
    velocity: Velocity = ZERO

    def resolve(self, tree):
        """No wrench of its own: weights and the motion through it know it as `Robot.water`."""
        return []


def _locate(tree, segment, X):
    try:
        return tree.locate(segment, X)
    except ValueError as error:
        raise Bad("at" if segment in tree.of else "on", str(error)) from None


def is_zero(vector):
    return all(isinstance(v, (int, float)) and v == 0 for v in vector)


def gravity(tree, acceleration, water=0):
    """Weights of all rods and bodies under `acceleration` [3, m/s^2, world], less those of `water` [kg/m^3] displaced.

    Buoyancy acts at the centre of mass of a slice or body (F. Renda, L. Seneviratne, ICRA 2018).
    """
    if is_zero(acceleration):
        return []
    loads = []
    for i, piece in enumerate(tree.pieces):
        if piece.is_rod:
            loads += _rod_weight(i, piece, acceleration, water)
        elif piece.record.body is not None:
            body = piece.record.body
            mass = body.mass - (0 if is_zero((water,)) else water * body.displaced_volume)
            if not is_zero((mass,)):
                offset = se3.pose(ca.DM.eye(3), ca.vertcat(*body.com))
                loads.append(PointLoad(i, 1.0, offset, [mass * a for a in acceleration], None, False))
    return loads


def _rod_weight(i, piece, acceleration, water):
    masses, centres = [], []
    for p in piece.slices:
        M = piece.record.inertia_density(p)
        heavy = M[3, 3] if is_zero((water,)) else M[3, 3] - water * piece.record.displaced(p)
        masses.append(p.weight * heavy)
        centres.append(ca.vertcat(0, M[0, 5] / M[3, 3], -M[0, 4] / M[3, 3]))
    centred = all(c.is_constant() and float(ca.sumsqr(c)) == 0 for c in map(ca.SX, centres))
    if centred:
        return [field(piece, i, masses, acceleration)]
    return [
        PointLoad(i, p.x, se3.pose(ca.DM.eye(3), c), [m * a for a in acceleration], None, False, spread=True)
        for p, c, m in zip(piece.slices, centres, masses, strict=True)
    ]


LOADS = {"wrench": Wrench, "distributed": Distributed, "fluid": Fluid}
Load = Annotated[Any, OneOf(LOADS, what="load")]
