"""Actuators: tendons, pressure chambers and joint torques; tau = B(q) u, column by column and piece by piece.

A line runs at d(X) = (0, y, z) through a rod; its tangent is t = v / |v| with v = p + k x d + d' = E xi + d',
E = [-skew(d) I]. Axial force N: -T in a cable of tension T, +P a in a chamber of pressure P and area a. Then
    tau = N int Phi^T E^T t ds = N d(length)/dq,   d tau/dq = N int Phi^T E^T (I - t t^T)/|v| E Phi ds.
`direction: normal` lets a chamber push along the section's normal e1 instead. Through a joint a cable runs straight
between the guide holes of its two sides. |v| and that chord have floors (LINE_FLOOR, CHORD_FLOOR) far below any real
length, so that a line of no length keeps a finite force. Source: F. Renda et al., RA-L 2020 (T there is N here).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal

import casadi as ca

from socontrol.lie import arcs, se3
from socontrol.mechanics.loads import dead
from socontrol.quantities import (
    Area,
    Bad,
    Either,
    Fraction,
    Limits,
    Metre,
    Newton,
    OneOf,
    Pair,
    Pascal,
    Unit,
    nearest,
    record,
)

E1 = ca.DM([1, 0, 0])
LINE_FLOOR = 1e-12  # of |v|, 1 in a straight unstretched rod: its square vanishes in rounding unless |v| < 1e-4
CHORD_FLOOR = 1e-9  # of a chord beside its own length at q = 0: its square vanishes in rounding above 1e-1


@lru_cache(maxsize=1)
def line_element():
    """Function (xi, d, d') -> |v|, E^T t [6] and its derivative in xi [6 x 6], made once and inlined."""
    xi, d, slope = ca.SX.sym("xi", 6), ca.SX.sym("d", 3), ca.SX.sym("slope", 3)
    E = ca.horzcat(-ca.skew(d), ca.DM.eye(3))
    v = E @ xi + slope
    size = _size(v)
    pull = E.T @ (v / size)
    return ca.Function("line_element", [xi, d, slope], [size, pull, (E.T @ E - pull @ pull.T) / size])


def _size(v, floor=LINE_FLOOR):
    """sqrt(v . v + floor^2): smooth, and above 0 where v [3] vanishes."""
    return ca.sqrt(ca.dot(v, v) + floor**2)


@dataclass(frozen=True)
class RodLine:
    """A line through one section of rod.

    nodes: (weight [m], d [3], dd/ds [3]); gain: N per unit of input; ends: d at x = 0 and 1; part: the x it covers.
    """

    piece: int
    nodes: tuple
    gain: Any
    ends: tuple = ()
    part: tuple = (0.0, 1.0)

    conservative = True

    def length(self, tree, q):
        """int |v| ds [m]."""
        return self._sum(tree.pieces[self.piece], q)[0]

    def force(self, tree, q):
        """Generalised force [n_i] for unit input."""
        piece = tree.pieces[self.piece]
        return self.gain * (piece.Phi.T @ self._sum(piece, q)[1])

    def gradient(self, tree, q):
        """d(force)/dq [n_i x n_i]."""
        piece = tree.pieces[self.piece]
        return self.gain * (piece.Phi.T @ self._sum(piece, q)[2] @ piece.Phi)

    def _sum(self, piece, q):
        """int (|v|, E^T t, E^T (I - t t^T) E / |v|) ds over the nodes."""
        xi, totals = piece.strain(q), (0, 0, 0)
        for w, d, slope in self.nodes:
            totals = [total + w * value for total, value in zip(totals, line_element()(xi, d, slope), strict=True)]
        return totals

    def wrench(self, tree, q, x):
        """F_a = gain [d x t; t] [6] at x, body frame, for unit input; zero where the line does not run."""
        if not self.part[0] <= x <= self.part[1]:
            return ca.DM(6, 1)
        piece, d = tree.pieces[self.piece], (1 - x) * self.ends[0] + x * self.ends[1]
        xi = piece.strain(q)
        v = xi[3:] + ca.cross(xi[:3], d) + self.nodes[0][2]
        t = self._direction(v)
        return self.gain * ca.vertcat(ca.cross(d, t), t)

    def _direction(self, v):
        return v / _size(v)


@dataclass(frozen=True)
class NormalLine(RodLine):
    """A chamber that pushes along the section normal: F_a = [d x e1; e1], whatever the strain."""

    def length(self, tree, q):
        """int e1 . v ds [m], linear in q, shifted to int |v| ds at q = 0: force = gain d(length)/dq."""
        piece = tree.pieces[self.piece]
        straight = self._sum(piece, ca.DM(tree.n, 1))[0]
        return straight + self._pull().T @ (piece.Phi @ q[piece.columns])

    def force(self, tree, q):
        return self.gain * (tree.pieces[self.piece].Phi.T @ self._pull())

    def gradient(self, tree, q):
        size = tree.pieces[self.piece].size
        return ca.DM(size, size)

    def _pull(self):
        """int E^T e1 ds [6]."""
        return sum(w * ca.vertcat(ca.cross(d, E1), E1) for w, d, _ in self.nodes)

    def _direction(self, v):
        return E1


@dataclass(frozen=True)
class Chord:
    """A straight run from `start` [3, base frame of a joint] to `stop` [3, its moving frame].

    Its length is sqrt(span^2 + floor^2), floor = CHORD_FLOOR |stop - start|: where the two holes meet, the direction
    of pull is undefined, and the force passes smoothly through zero within about that distance.
    """

    piece: int
    start: Any
    stop: Any
    gain: Any

    conservative = True

    def length(self, tree, q):
        return self._size(self._span(tree, q)[1])

    def force(self, tree, q):
        g, span, S = self._span(tree, q)
        t = span / self._size(span)
        return self.gain * (S.T @ ca.vertcat(ca.cross(se3.transform(g, self.stop), t), t))

    def gradient(self, tree, q):
        g, span, S = self._span(tree, q)
        size = self._size(span)
        t, y = span / size, se3.transform(g, self.stop)
        E = ca.horzcat(-ca.skew(y), ca.DM.eye(3))
        turn = E.T @ ((ca.DM.eye(3) - t @ t.T) / size) @ E
        F = ca.vertcat(ca.cross(y, t), t)
        piece = tree.pieces[self.piece]
        return self.gain * (piece.wrench_gradient(q, 1.0, F) + S.T @ (dead(y, t, 1) + turn) @ S)

    def _span(self, tree, q):
        g, S = tree.pieces[self.piece].step(q, 1.0)
        return g, se3.transform(g, self.stop) - self.start, S

    def _size(self, span):
        return _size(span, CHORD_FLOOR * _norm(self.stop - self.start))


@dataclass(frozen=True)
class Torque:
    """Input `degree` of a joint: the body wrench dual to that column of Phi, tau = S_body^T Phi (Phi^T Phi)^-1 u."""

    piece: int
    degree: int
    gain: float = 1.0
    conservative = False  # of several degrees of freedom; for one its gradient is zero anyway

    def length(self, tree, q):
        return q[tree.pieces[self.piece].columns][self.degree]

    def force(self, tree, q):
        piece = tree.pieces[self.piece]
        if piece.is_screw:
            return ca.DM.ones(1, 1)
        S_body = se3.tangent(-piece.strain(q), piece.coefficients()) @ piece.Phi
        return S_body.T @ self._wrench(piece)

    def gradient(self, tree, q):
        piece = tree.pieces[self.piece]
        if piece.is_screw:
            return ca.DM(1, 1)
        gradient = arcs.tangent_gradient(-piece.strain(q), self._wrench(piece), piece.coefficients())
        return -(piece.Phi.T @ gradient @ piece.Phi)

    def _wrench(self, piece):
        dual = piece.Phi @ ca.inv(piece.Phi.T @ piece.Phi)
        return dual[:, self.degree]


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
    return piece.record.length if piece.is_rod else _norm(se3.position(piece.end))


def _norm(x):
    """Length of x [3], a float where x holds numbers."""
    return ca.norm_2(x) if ca.symvar(ca.SX(x)) else float(ca.norm_2(ca.DM(x)))


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
    length = _norm(stop - start)
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


def _some(along):
    if not along:
        raise Bad("along", "no segment is named")
    if len(set(along)) < len(along):
        raise Bad("along", "a segment is named twice")


def _refuse_empty(key, value):
    if isinstance(value, (tuple, list)) and not value:
        raise Bad(key, "the list is empty; fill it or leave the key out")


ACTUATORS = {"tendon": Tendon, "chamber": Chamber, "joint_torque": JointTorque}
Actuator = Annotated[Any, OneOf(ACTUATORS, what="actuator")]
