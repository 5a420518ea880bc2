"""Actuators as a file describes them: tendons, pressure chambers, joint torques and moments inside rods.

tau = B(q) u, column by column and piece by piece; what a line does to one piece stands in `lines`, where it runs in
`courses`.
"""

from dataclasses import replace
from typing import Annotated, Any, Literal

import casadi as ca

from socontrol.mechanics import courses
from socontrol.mechanics.lines import Bending, NormalLine, RodLine, Torque
from socontrol.mechanics.routes import Converging, Offset, Winding
from socontrol.model.bases import STRAINS
from socontrol.quantities import (
    Area,
    Bad,
    Count,
    Either,
    Fraction,
    Length,
    Limits,
    Newton,
    NewtonMetre,
    NonNegativeNumber,
    OneOf,
    Pascal,
    Position,
    Unit,
    other_wanted,
    record,
)


class _Way(Unit):
    """`in`, `out`, or a number between."""

    shapes = frozenset({"number", "text"})
    words = {"in": 1.0, "out": -1.0}
    wanted = "in, out or a number from -1 to 1"

    def read(self, value):
        if isinstance(value, str) and value not in self.words:
            raise other_wanted(value, self.wanted)
        return super().read(self.words.get(value, value) if isinstance(value, str) else value)


Way = Annotated[float, _Way("1", lower=-1, upper=1)]
Strength = Annotated[float, Unit("N", lower=0, exclusive=True)]


@record(kw_only=True)
class Tendon:
    """A cable that pulls with tension u [N] and ends at `to`; `offset` (y, z), {start, end} to converge, or a helix.

    holes: {segment: points [m]} it is threaded through in rigid segments, in the moving frame, base to tip. friction:
    capstan coefficient; u is the tension at `from`, at the motor. moving: in (1) where the motor pulls the cable in,
    out (-1), or between; counts at rest, a motion has a direction of its own. spool: radius of the motor's drum.
    stiffness: E A of the cable, force per unit of strain, not with `friction`; without it the cable does not stretch.
    """

    along: tuple[str, ...]
    offset: Annotated[Any, Either(Offset, Converging, Winding)]
    limits: Limits[Newton] | None = None
    from_: Fraction = 0.0
    to: Fraction = 1.0
    holes: dict[str, tuple[Position, ...]] | None = None
    friction: NonNegativeNumber = 0.0
    moving: Way = 1.0
    spool: Length | None = None
    stiffness: Strength | None = None
    unit = "N"

    def __post_init__(self):
        _some(self.along)
        _refuse_empty("limits", self.limits)
        for name, points in (self.holes or {}).items():
            _refuse_empty(f"holes.{name}", points)
        if self.from_ >= self.to:
            raise Bad("from", f"{self.from_:g} is not below to: {self.to:g}")
        if self.rubs and self.stiffness is not None:
            raise Bad("stiffness", "a cable that rubs is not stretched here; leave `friction` or `stiffness` out")

    @property
    def rubs(self):
        """Whether the coefficient of friction is not plainly 0."""
        return not (isinstance(self.friction, (int, float)) and self.friction == 0)

    def resolve(self, tree):
        """One list of lines for each input."""
        shares = courses.course(tree, self.along, self.offset, -1.0, (self.from_, self.to), self.holes)
        return [[replace(share, conservative=False) for share in shares] if self.rubs else shares]


@record(kw_only=True)
class Chamber:
    """A chamber of cross-section `area` under pressure u [Pa]; several offsets share the pressure."""

    along: tuple[str, ...]
    offset: Annotated[Any, Either(Offset, tuple[Offset, ...], Converging, Winding)]
    area: Area
    direction: Literal["tangent", "normal"] = "tangent"
    limits: Limits[Pascal] | None = None
    unit = "Pa"

    def __post_init__(self):
        _some(self.along)
        _refuse_empty("limits", self.limits)
        _refuse_empty("offset", self.offset)

    def offsets(self):
        """The route of each part of the chamber."""
        several = isinstance(self.offset, tuple) and isinstance(self.offset[0], (tuple, list))
        return self.offset if several else (self.offset,)

    def resolve(self, tree):
        kind = RodLine if self.direction == "tangent" else NormalLine
        shares = []
        for offset in self.offsets():
            if any(name in tree.of and not tree.pieces[tree.of[name][0]].is_rod for name in self.along):
                name = next(n for n in self.along if not tree.pieces[tree.of[n][0]].is_rod)
                raise Bad("along", f"'{name}' is a joint; a chamber runs along rods only")
            shares += courses.shares(tree, self.along, offset, self.area, kind)
        return [shares]


class _Effort(Unit):
    """A moment or a force, whichever the text names; the joint decides which it is."""

    def read(self, value):
        is_force = isinstance(value, str) and value.strip().endswith("N")
        return Unit("N").read(value) if is_force else super().read(value)


Effort = Annotated[float, _Effort("N m")]


@record(kw_only=True)
class JointTorque:
    """A motor on a joint, one input a degree of freedom: N m for turns, N for slides."""

    joint: str
    limits: Annotated[Any, Either(Limits[Effort], tuple[Limits[Effort], ...])] = None
    unit = "N m"

    def __post_init__(self):
        _refuse_empty("limits", self.limits)

    def resolve(self, tree):
        if self.joint not in tree.of:
            raise Bad("joint", courses.unknown(self.joint, tree))
        i = tree.of[self.joint][0]
        piece = tree.pieces[i]
        if piece.is_rod or piece.size == 0:
            raise Bad("joint", f"'{self.joint}' has no joint coordinate to drive; name a moving joint")
        several = self.limits is not None and isinstance(self.limits[0], (tuple, list))
        if several and len(self.limits) != piece.size:
            raise Bad("limits", f"{len(self.limits)} pairs given, {piece.size} wanted, one a degree of freedom")
        return [[Torque(i, degree)] for degree in range(piece.size)]


STATIONS = 200  # at most: each one is an input


@record(kw_only=True)
class InternalMoment:
    """Moments inside rods, as muscles make them: one input [N m] a station, linear in X between `stations` that stand
    at equal distances along the named rods; one station is a uniform moment. `strain`: what they work on."""

    along: tuple[str, ...]
    strain: Literal["twist", "bend_y", "bend_z"]
    stations: Count = 1
    limits: Limits[NewtonMetre] | None = None
    unit = "N m"

    def __post_init__(self):
        _some(self.along)
        _refuse_empty("limits", self.limits)
        if self.stations > STATIONS:
            raise Bad("stations", f"{self.stations} stations; at most {STATIONS}")

    def resolve(self, tree):
        """One list of shares for each station."""
        shares = [[] for _ in range(self.stations)]
        for i, first, last, length in _stretches(tree, self.along):
            for k, own in enumerate(shares):
                corners = self._corners(k, first, last)
                weight = sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in zip(corners, corners[1:], strict=False))
                if weight > 0:
                    own.append(Bending(i, STRAINS.index(self.strain), weight * length, corners))
        return shares

    def _corners(self, k, first, last):
        """(x, hat of station k) on the part of the whole from `first` to `last`."""
        if self.stations == 1:
            return (0.0, 1.0), (1.0, 1.0)
        tops = [j / (self.stations - 1) for j in range(self.stations)]
        bends = sorted({first, last, *(X for X in tops if first < X < last)})
        gap = 1 / (self.stations - 1)
        return tuple(((X - first) / (last - first), max(0.0, 1 - abs(X - tops[k]) / gap)) for X in bends)


def _stretches(tree, along):
    """(piece, fraction of the whole at its base, at its end, length) of the named rods, in order."""
    courses.refuse_no_chain(tree, along)
    for index, name in enumerate(along):
        if not tree.pieces[tree.of[name][0]].is_rod:
            raise Bad(f"along.{index}", f"'{name}' is a joint; moments act inside rods")
    lengths = [tree.pieces[i].length for name in along for i in tree.of[name]]
    if not all(ca.SX(length).is_constant() for length in lengths):
        raise ValueError("the lengths along an internal moment must be numbers")
    total, done = float(sum(lengths)), 0.0
    for name in along:
        for i in tree.of[name]:
            length = float(tree.pieces[i].length)
            yield i, done / total, (done + length) / total, length
            done += length


def _some(along):
    if not along:
        raise Bad("along", "no segment is named")
    if len(set(along)) < len(along):
        raise Bad("along", "a segment is named twice")


def _refuse_empty(key, value):
    if isinstance(value, (tuple, list)) and not value:
        raise Bad(key, "the list is empty; fill it or leave the key out")


ACTUATORS = {
    "tendon": Tendon,
    "chamber": Chamber,
    "joint_torque": JointTorque,
    "internal_moment": InternalMoment,
}
Actuator = Annotated[Any, OneOf(ACTUATORS, what="actuator")]
