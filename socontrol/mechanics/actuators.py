"""Actuators: tendons, pressure chambers and joint torques as a file describes them, and where their lines run.

tau = B(q) u, column by column and piece by piece; what a line does to one piece stands in `lines`.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics.lines import Bending, Chord, NormalLine, RodLine, Torque, norm
from socontrol.model.bases import STRAINS
from socontrol.quantities import (
    Area,
    Bad,
    Count,
    Either,
    Fraction,
    Limits,
    Metre,
    Newton,
    NewtonMetre,
    OneOf,
    Pair,
    Pascal,
    Unit,
    nearest,
    record,
)

# Routing: where a line runs

Offset = Pair[Metre]


@record(kw_only=True)
class Converging:
    """(y, z) changes linearly from `start` to `end` over all the segments the line runs along."""

    start: Offset
    end: Offset


@dataclass(frozen=True)
class Route:
    """Offset of a line as a function of the fraction `X` of the way along all its segments."""

    start: Any
    stop: Any
    total: Any

    def at(self, X):
        """d [3]."""
        return ca.vertcat(0, *((1 - X) * a + X * b for a, b in zip(self.start, self.stop, strict=True)))

    def slope(self):
        """dd/ds [3]."""
        return ca.vertcat(0, *((b - a) / self.total for a, b in zip(self.start, self.stop, strict=True)))

    @property
    def parallel(self):
        return self.start is self.stop


def _route(offset, total):
    if isinstance(offset, Converging):
        return Route(offset.start, offset.end, total)
    return Route(offset, offset, total)


def lines(tree, along, offset, gain, span=(0.0, 1.0), kind=RodLine):
    """The pieces' shares of one line along the named segments, in order from `span[0]` to `span[1]` of the whole.

    Raises Bad for unknown segments, segments that are no chain, joints where a chamber cannot run, and cables of no
    length through a joint.
    """
    for index, name in enumerate(along):
        if name not in tree.of:
            raise Bad(f"along.{index}", _unknown(name, tree))
    for index, (before, name) in enumerate(zip(along, along[1:], strict=False), start=1):
        _refuse_gap(tree, before, name, f"along.{index}")
    lengths = {name: _length(tree, name) for name in along}
    total = sum(lengths.values())
    route, done, shares = _route(offset, total), 0.0, []
    for name in along:
        for i in tree.of[name]:
            piece = tree.pieces[i]
            own = piece.length if piece.is_rod else lengths[name]
            first, last = done / total, (done + own) / total
            done = done + own
            part = _covered(span, first, last)
            if part is None:
                continue
            if piece.is_rod:
                ends = (route.at(first), route.at(last))
                shares.append(kind(i, _nodes(piece, route, first, last, part), gain, ends, part))
            elif piece.size:
                shares.append(_chord(tree, i, name, route, first, last, gain, kind))
    return shares


def _refuse_gap(tree, before, name, key):
    """Raise Bad unless `name` stands on the end of `before`, directly or on unnamed segments without motion."""
    child = tree.segments[name]
    while child.parent != before:
        if child.parent == "world":
            raise Bad(key, f"'{name}' does not stand on the end of '{before}'; name the segments in order, base first")
        child, between = tree.segments[child.parent], child.parent
        piece = tree.pieces[tree.of[between][0]]
        if (piece.is_rod or piece.size) and before in _ancestors(tree, between):
            what = "rod" if piece.is_rod else "joint"
            raise Bad(key, f"{what} '{between}' stands between '{before}' and '{name}'; name it too")
    if child.at != 1:
        raise Bad(key, f"'{name}' does not stand on the end of '{before}' but at X = {child.at:g}")


def _ancestors(tree, name):
    """Names of the segments below a segment, down to its root."""
    while (name := tree.segments[name].parent) != "world":
        yield name


def _covered(span, first, last):
    """Fractions of a piece from `first` to `last` between which a line runs; None where it does not."""
    if span == (0.0, 1.0):
        return span
    if not (ca.SX(first).is_constant() and ca.SX(last).is_constant()):
        raise ValueError("the lengths along a cable that begins or ends on the way (from, to) must be numbers")
    first, last = float(first), float(last)
    if span[0] >= last - 1e-12 or span[1] <= first + 1e-12:
        return None
    return (max(span[0], first) - first) / (last - first), (min(span[1], last) - first) / (last - first)


def _unknown(name, tree):
    return f"unknown segment '{name}'{nearest(name, tree.of)}"


def _length(tree, name):
    """Length of a rod, or from a joint to its end frame [m]."""
    piece = tree.pieces[tree.of[name][0]]
    return piece.record.length if piece.is_rod else norm(se3.position(piece.end))


def _nodes(piece, route, first, last, part):
    if route.parallel:
        return (((part[1] - part[0]) * piece.length, route.at(0.0), ca.DM(3, 1)),)
    factor = len(piece.slices) // piece.record.quadrature
    slices = piece.record.slices(piece.index, factor, *part)
    return tuple((p.weight, route.at(first + (last - first) * p.x), route.slope()) for p in slices)


def _chord(tree, i, name, route, first, last, gain, kind):
    if kind is not RodLine:
        raise Bad("along", f"'{name}' is a joint; a chamber runs along rods only")
    piece = tree.pieces[i]
    start, stop = route.at(first), se3.transform(piece.end, route.at(last))
    length = norm(stop - start)
    if isinstance(length, float) and length == 0:
        raise Bad("along", f"the cable has no length through the joint '{name}'; give '{name}' a tip")
    return Chord(i, start, stop, gain)


# What a file can say


@record(kw_only=True)
class Tendon:
    """A cable that pulls with tension u [N] and ends at `to`; `offset` (y, z), or {start, end} to converge."""

    along: tuple[str, ...]
    offset: Annotated[Any, Either(Offset, Converging)]
    limits: Limits[Newton] | None = None
    from_: Fraction = 0.0
    to: Fraction = 1.0
    unit = "N"

    def __post_init__(self):
        _some(self.along)
        _refuse_empty("limits", self.limits)
        if self.from_ >= self.to:
            raise Bad("from", f"{self.from_:g} is not below to: {self.to:g}")

    def resolve(self, tree):
        """One list of lines for each input."""
        return [lines(tree, self.along, self.offset, -1.0, (self.from_, self.to))]


@record(kw_only=True)
class Chamber:
    """A chamber of cross-section `area` under pressure u [Pa]; several offsets share the pressure."""

    along: tuple[str, ...]
    offset: Annotated[Any, Either(Offset, tuple[Offset, ...], Converging)]
    area: Area
    direction: Literal["tangent", "normal"] = "tangent"
    limits: Limits[Pascal] | None = None
    unit = "Pa"

    def __post_init__(self):
        _some(self.along)
        _refuse_empty("limits", self.limits)
        _refuse_empty("offset", self.offset)

    def offsets(self):
        """(y, z) of each part of the chamber, or the one Converging."""
        several = isinstance(self.offset, tuple) and isinstance(self.offset[0], (tuple, list))
        return self.offset if several else (self.offset,)

    def resolve(self, tree):
        kind = RodLine if self.direction == "tangent" else NormalLine
        shares = []
        for offset in self.offsets():
            if any(name in tree.of and not tree.pieces[tree.of[name][0]].is_rod for name in self.along):
                name = next(n for n in self.along if not tree.pieces[tree.of[n][0]].is_rod)
                raise Bad("along", f"'{name}' is a joint; a chamber runs along rods only")
            shares += lines(tree, self.along, offset, self.area, kind=kind)
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
            raise Bad("joint", _unknown(self.joint, tree))
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
    for index, name in enumerate(along):
        if name not in tree.of:
            raise Bad(f"along.{index}", _unknown(name, tree))
        if not tree.pieces[tree.of[name][0]].is_rod:
            raise Bad(f"along.{index}", f"'{name}' is a joint; moments act inside rods")
    for index, (before, name) in enumerate(zip(along, along[1:], strict=False), start=1):
        _refuse_gap(tree, before, name, f"along.{index}")
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
