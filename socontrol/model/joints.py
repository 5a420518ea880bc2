"""Lumped joints: one record a kind, the basis Phi of its twist, and what is mounted on its moving frame.

The moving frame is base @ exp(Phi q); the end frame, where children stand, is moving @ tip. `axis` is any
direction in the base frame, `point` moves it off the origin: Phi = Ad(pose(I, point)) Phi_0.
Stiffness acts on the coordinates' deviation from `rest`. Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

from typing import Annotated, Any

import casadi as ca

from socontrol.lie import se3
from socontrol.model.bodies import Body, Placement, numbers_in, refuse_indefinite
from socontrol.model.fluids import BodyFluid
from socontrol.quantities import (
    AxialDamping,
    AxialStiffness,
    Axis,
    Bad,
    Either,
    Fraction,
    Limits,
    Metre,
    MetrePerRadian,
    Number,
    OneOf,
    Position,
    Radian,
    TorsionDamping,
    TorsionStiffness,
    is_symbolic,
    record,
)

ROTATION, TRANSLATION = ("rad", "N m"), ("m", "N")
STOPS = {"rad": (100.0, 0.01), "m": (1e5, 1e-3)}  # stiffness, and way past the limit by which half of it is there
Entries = Annotated[Any, Either(Number, tuple[Number, ...])]
Matrix = Annotated[Any, Either(Number, tuple[Number, ...], tuple[tuple[Number, ...], ...])]


@record(kw_only=True)
class Lumped:
    """What all joints share. `stiffness`, `damping`: a number, a list by degree of freedom, or a matrix, in SI.

    Past its `limits` a joint meets a smooth stop of `stop_stiffness` (default 100 N m/rad, 1e5 N/m): d past a limit the
    force is k d^3 / (d^2 + w^2), w = 0.01 rad or 1 mm, with two continuous derivatives.
    """

    parent: str = "world"
    at: Fraction = 1.0
    placement: Placement = Placement()
    stiffness: Matrix = 0.0
    damping: Matrix = 0.0
    rest: Entries = 0.0
    limits: tuple | None = None
    stop_stiffness: Entries | None = None
    body: Body | None = None
    fluid: BodyFluid | None = None
    tip: Placement = Placement()

    def __post_init__(self):
        n = len(self.units)
        for key in ("stiffness", "damping"):
            _check_shape(key, getattr(self, key), n, matrix=True)
            _check_sign(key, getattr(self, key))
        _check_shape("rest", self.rest, n, matrix=False)
        if self.limits is None:
            if self.stop_stiffness is not None:
                raise Bad("stop_stiffness", "there are no `limits` to stop at")
            return
        _check_shape("stop_stiffness", self.stop_stiffness, n, matrix=False)
        _check_sign("stop_stiffness", self.stop_stiffness or 0)
        if n == 0:
            raise Bad("limits", "a fixed joint has no coordinate to limit; leave the key out")
        if len(self.limit_pairs()) != n:
            raise Bad("limits", f"{len(self.limit_pairs())} pairs given, {n} wanted, one a degree of freedom")

    def Phi(self):
        """Basis of the joint twist [6 x n] in the base frame."""
        raise NotImplementedError

    def limit_pairs(self):
        """(lower, upper) of each degree of freedom."""
        limits = self.limits
        return (limits,) if limits and not isinstance(limits[0], (tuple, list)) else tuple(limits)

    def stops(self):
        """(index, limit, side, stiffness, width) of each finite limit; side is +1 for an upper one."""
        rows = []
        for i, pair in enumerate(self.limit_pairs() if self.limits else ()):
            stiffness, width = STOPS[self.units[i][0]]
            given = self.stop_stiffness
            if given is not None:
                stiffness = given[i] if isinstance(given, (tuple, list)) else given
            for limit, side in zip(pair, (-1, 1), strict=True):
                if is_symbolic(limit) or (limit is not None and abs(limit) < float("inf")):
                    rows.append((i, limit, side, stiffness, width))
        return rows

    def matrix(self, key):
        """`stiffness` or `damping` as an n x n matrix."""
        value, n = getattr(self, key), len(self.units)
        if not isinstance(value, (tuple, list)):
            return value * ca.DM.eye(n)
        if n == 0:
            return ca.DM(0, 0)
        if isinstance(value[0], (tuple, list)):
            return ca.vertcat(*(ca.horzcat(*row) for row in value))
        return ca.diag(ca.vertcat(*value))

    def rest_coordinates(self):
        """Rest coordinates [n]."""
        if not isinstance(self.rest, (tuple, list)):
            return self.rest * ca.DM.ones(len(self.units), 1)
        return ca.vertcat(*self.rest)


def _check_shape(key, value, n, matrix):
    if not isinstance(value, (tuple, list)):
        return
    rows = [row for row in value if isinstance(row, (tuple, list))]
    if rows and (not matrix or len(rows) != len(value)):
        raise Bad(key, f"a number or a list of {n} is wanted" + (f", or {n} x {n}" if matrix else ""))
    if len(value) != n or any(len(row) != n for row in rows):
        raise Bad(key, f"{len(value)} entries given, {n} wanted, one a degree of freedom")


def _check_sign(key, value):
    """Refuse springs and dampers that would drive: numbers below 0, and matrices with a negative eigenvalue."""
    if not isinstance(value, (tuple, list)):
        value = (value,)
        keys = (key,)
    elif value and isinstance(value[0], (tuple, list)):
        return refuse_indefinite(key, value)
    else:
        keys = [f"{key}.{index}" for index in range(len(value))]
    for place, number in zip(keys, value, strict=True):
        if numbers_in([number]) and number < 0:
            raise Bad(place, f"a {key} of {number:g} is negative")


def _angular(axis):
    return ca.vertcat(axis, ca.DM.zeros(3))


def _linear(axis):
    return ca.vertcat(ca.DM.zeros(3), axis)


def unit(axis):
    if all(isinstance(a, (int, float)) for a in axis):
        axis = [a / max(map(abs, axis)) for a in axis]  # a direction of any size
    axis = ca.vertcat(*axis)
    return axis / ca.norm_2(axis)


def normal_basis(normal):
    """Two unit vectors across `normal` [3 x 2], right-handed with it; e1, e2 for the normal e3."""
    n = [float(x) for x in ca.DM(unit(normal)).full().ravel()]
    a, b = n[0], n[1]
    aside = a * a + b * b
    if n[2] < 0 and aside < 1e-30:  # opposite to e3: turn by pi about x
        return ca.DM([[1, 0], [0, -1], [0, 0]])
    # columns of the smallest rotation that takes e3 to n; 1/(1 + n_z) without its cancellation near -1
    c = 1 / (1 + n[2]) if n[2] > 0 else (1 - n[2]) / aside
    return ca.DM([[1 - a * a * c, -a * b * c], [-a * b * c, 1 - b * b * c], [-a, -b]])


@record(kw_only=True)
class AboutAxis(Lumped):
    """What turning joints of one degree of freedom share."""

    axis: Axis = (1.0, 0.0, 0.0)
    point: Position = (0.0, 0.0, 0.0)
    stiffness: TorsionStiffness = 0.0
    damping: TorsionDamping = 0.0
    rest: Radian = 0.0
    limits: Limits[Radian] | None = None
    units = (ROTATION,)


@record(kw_only=True)
class Revolute(AboutAxis):
    """Turns about `axis` through `point`."""

    def Phi(self):
        return _through(self.point, _angular(unit(self.axis)))


@record(kw_only=True)
class Prismatic(Lumped):
    """Slides along `axis`."""

    axis: Axis = (1.0, 0.0, 0.0)
    stiffness: AxialStiffness = 0.0
    damping: AxialDamping = 0.0
    rest: Metre = 0.0
    limits: Limits[Metre] | None = None
    units = (TRANSLATION,)

    def Phi(self):
        return _linear(unit(self.axis))


@record(kw_only=True)
class Helical(AboutAxis):
    """Turns about `axis` through `point` and advances `pitch` metres per radian."""

    pitch: MetrePerRadian

    def Phi(self):
        a = unit(self.axis)
        return _through(self.point, ca.vertcat(a, self.pitch * a))


@record(kw_only=True)
class Cylindrical(Lumped):
    """Turns about `axis` through `point` and slides along it, independently."""

    axis: Axis = (1.0, 0.0, 0.0)
    point: Position = (0.0, 0.0, 0.0)
    limits: tuple[Limits[Radian], Limits[Metre]] | None = None
    units = (ROTATION, TRANSLATION)

    def Phi(self):
        a = unit(self.axis)
        return _through(self.point, ca.horzcat(_angular(a), _linear(a)))


@record(kw_only=True)
class Planar(Lumped):
    """Moves in the plane across `axis` (its normal): turn about it, then two translations."""

    axis: Axis = (0.0, 0.0, 1.0)
    point: Position = (0.0, 0.0, 0.0)
    limits: tuple[Limits[Radian], Limits[Metre], Limits[Metre]] | None = None
    units = (ROTATION, TRANSLATION, TRANSLATION)

    def Phi(self):
        across = normal_basis(self.axis)
        return _through(self.point, ca.horzcat(_angular(unit(self.axis)), _linear(across[:, 0]), _linear(across[:, 1])))


@record(kw_only=True)
class Spherical(Lumped):
    """Turns freely about `point`; coordinates are a rotation vector."""

    point: Position = (0.0, 0.0, 0.0)
    limits: tuple[Limits[Radian], Limits[Radian], Limits[Radian]] | None = None
    units = (ROTATION,) * 3

    def Phi(self):
        return _through(self.point, ca.DM.eye(6)[:, :3])


@record(kw_only=True)
class Free(Lumped):
    """Six degrees of freedom; coordinates are the twist whose exponential is the pose."""

    limits: (
        tuple[Limits[Radian], Limits[Radian], Limits[Radian], Limits[Metre], Limits[Metre], Limits[Metre]] | None
    ) = None
    units = (ROTATION,) * 3 + (TRANSLATION,) * 3

    def Phi(self):
        return ca.DM.eye(6)


@record(kw_only=True)
class Fixed(Lumped):
    """No motion: a rigid link, or a place to mount a body."""

    units = ()

    def Phi(self):
        return ca.DM(6, 0)


def _through(point, Phi_0):
    return ca.sparsify(se3.Ad(se3.pose(ca.DM.eye(3), ca.vertcat(*point))) @ Phi_0)


JOINTS = {
    "revolute": Revolute,
    "prismatic": Prismatic,
    "helical": Helical,
    "cylindrical": Cylindrical,
    "planar": Planar,
    "spherical": Spherical,
    "free": Free,
    "fixed": Fixed,
}
Joint = Annotated[Any, OneOf(JOINTS, what="joint")]
