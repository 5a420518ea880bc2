"""The course of a line: from the segments it is threaded through to its shares in the pieces, base to tip.

Through rods it follows its route. Rigid segments guide it by holes, in order: those given, in the segment's moving
frame, or else one in its base plane (of a moving joint: in the frame it starts from) and one in its end plane, where
the route is. Between holes, and from a rod's end to the next hole, it runs straight.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics.lines import Chord, RodLine, Run, norm
from socontrol.mechanics.routes import Stretch, route
from socontrol.quantities import Bad, nearest

TOUCHING = 1e-12  # of a line's length: a run shorter than that is rounding
DIGITS = 9  # to which a refusal prints an X; a line that begins or ends so near to a segment's end does so there


@dataclass(frozen=True)
class Hole:
    """A point p [3] of a rigid body, in the base frame of a piece or, `moved`, in its frame at x = 1; flush: it stands
    on the point before it."""

    piece: int
    moved: bool
    p: Any
    flush: bool = False


def shares(tree, along, offset, gain, kind=RodLine):
    """Of one line along rods: its share of each section, in order."""
    return [share for share in course(tree, along, offset, gain, kind=kind) if not isinstance(share, Run)]


def course(tree, along, offset, gain, span=(0.0, 1.0), holes=None, kind=RodLine):
    """The pieces' shares of one line along the named segments, in order from `span[0]` to `span[1]` of the whole.

    holes: {segment: points} through rigid segments. Raises Bad for unknown segments, segments that are no chain, holes
    of segments that have none, cables of no length through a joint, and a span that parts a rigid segment.
    """
    refuse_no_chain(tree, along)
    lengths = {name: _length(tree, name) for name in along}
    total = sum(lengths.values())
    total = 1.0 if isinstance(total, float) and total == 0 else total  # of nothing but joints without a tip
    way, done, found = route(offset, total), 0.0, _Course(tree, gain, holes or {}, along)
    for name in along:
        for i in tree.of[name]:
            piece = tree.pieces[i]
            own = piece.length if piece.is_rod else lengths[name]
            first, last = done / way.total, (done + own) / way.total
            done = done + own
            part = _covered(span, first, last)
            if not piece.is_rod:
                _refuse_parted(name, part, first, last, span)
            if part is None:
                continue
            if piece.is_rod:
                found.follow(i, Stretch(way, first, last), part, kind)
            else:
                found.thread(i, (way.at(first), way.at(last)))
    found.refuse_unused()
    return found.shares


class _Course:
    """The shares so far, and the point where the line has come to."""

    def __init__(self, tree, gain, holes, along):
        self.tree, self.gain, self.holes, self.along = tree, gain, holes, along
        self.shares, self.here, self._unused = [], None, dict.fromkeys(holes)

    def follow(self, i, stretch, part, kind):
        """Through a section of rod, from and to the x of `part`."""
        piece = self.tree.pieces[i]
        if piece.index == 0:
            self._run(Hole(i, False, stretch.at(0.0), self._is_flush(i)))
        self.shares.append(kind(i, _nodes(piece, stretch, part), self.gain, stretch, part))
        self.here = Hole(i, True, stretch.at(1.0))

    def thread(self, i, offsets):
        """Through the holes of a rigid segment; offsets: d at its base and at its end."""
        piece = self.tree.pieces[i]
        given, moves = self.holes.get(piece.segment), piece.size > 0
        self._unused.pop(piece.segment, None)
        if given is None:
            tip = se3.transform(piece.end, offsets[1])
            points = [Hole(i, False, offsets[0], self._is_flush(i)), Hole(i, moves, tip)]
        else:
            points = [Hole(i, moves, ca.vertcat(*p)) for p in given]
        for point in points:
            self._run(point)

    def _run(self, point):
        """Straight to the next point."""
        before, self.here = self.here, point
        if before is None or point.flush:
            return
        body, at = _on_body(self.tree, before)
        moves = body != _on_body(self.tree, point)[0]  # through the joint that carries the point
        frame = Hole(point.piece, point.moved and not moves, point.p)
        start = before.p if (before.piece, before.moved) == (frame.piece, frame.moved) else _seen(self.tree, frame, at)
        size = norm(point.p - start)
        if moves:
            if isinstance(size, float) and size == 0:
                name = self.tree.pieces[point.piece].segment
                raise Bad("along", f"the cable has no length through the joint '{name}'; give '{name}' a tip")
            self.shares.append(Chord(point.piece, start, point.p, self.gain))
        elif not isinstance(size, float) or size > TOUCHING:
            self.shares.append(Run(point.piece, point.moved, start, point.p, self.gain))

    def _is_flush(self, i):
        """Whether segment i begins exactly where the one before it ends, and the line there too."""
        piece, before = self.tree.pieces[i], self.here
        if before is None or self.tree.pieces[before.piece].segment != piece.record.parent:
            return False
        if piece.record.parent in self.holes:
            return False
        shift = ca.SX(piece.record.placement.pose() - ca.DM.eye(4))
        return shift.is_constant() and not ca.sparsify(ca.DM(shift)).nnz()

    def refuse_unused(self):
        for name in self._unused:
            if name not in self.tree.of:
                raise Bad(f"holes.{name}", unknown(name, self.tree))
            if name in self.along and self.tree.pieces[self.tree.of[name][0]].is_rod:
                raise Bad(f"holes.{name}", f"'{name}' is a rod; in a rod the line runs at `offset`")
            if name in self.along:
                raise Bad(f"holes.{name}", f"the line does not pass '{name}', which is beyond its `from` or `to`")
            raise Bad(f"holes.{name}", f"the line does not pass '{name}'; it runs along {', '.join(self.along)}")


def _on_body(tree, point):
    """(moving piece that carries the point, None: world; the point in that piece's frame at its place)."""
    g, parent = body(tree, point.piece, point.moved)
    return parent, point.p if g is None else se3.transform(g, point.p)


def body(tree, i, moved):
    """(pose of a frame of piece i in that of the piece that carries it, that piece; None: world), over fixed segments.

    Of the frame at x = 1 of a piece that moves: (None, i).
    """
    piece = tree.pieces[i]
    if moved:
        return None, i
    g, parent = piece.placement, piece.parent
    while parent is not None and not tree.pieces[parent].is_rod and tree.pieces[parent].size == 0:
        g, parent = tree.pieces[parent].placement @ g, tree.pieces[parent].parent
    return g, parent


def _seen(tree, point, at):
    """A point of the body that carries a Hole's frame, in that frame."""
    g, _ = body(tree, point.piece, point.moved)
    return at if g is None else se3.transform(se3.inverse(g), at)


def refuse_no_chain(tree, along):
    """Raise Bad unless each named segment stands on the end of the one before it."""
    for index, name in enumerate(along):
        if name not in tree.of:
            raise Bad(f"along.{index}", unknown(name, tree))
    for index, (before, name) in enumerate(zip(along, along[1:], strict=False), start=1):
        _refuse_gap(tree, before, name, f"along.{index}")


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
    size, near = last - first, 10.0**-DIGITS
    if size <= TOUCHING:
        return (0.0, 1.0) if span[0] - near <= first <= span[1] + near else None
    if span[0] >= last - near or span[1] <= first + near:
        return None
    begin = 0.0 if span[0] <= first + near else (span[0] - first) / size
    return begin, 1.0 if span[1] >= last - near else (span[1] - first) / size


def _refuse_parted(name, part, first, last, span):
    """Raise Bad where a line begins or ends inside a rigid segment from `first` to `last`."""
    for key, X, parts in (("from", span[0], part and part[0] > 0), ("to", span[1], part and part[1] < 1)):
        if parts:
            where = f"inside the rigid segment '{name}', which is from X = {first:.{DIGITS}g} to {last:.{DIGITS}g}"
            raise Bad(key, f"{X:g} is {where}; begin and end at an end of it or in a rod")


def unknown(name, tree):
    """`unknown segment 'x'` and the nearest name."""
    return f"unknown segment '{name}'{nearest(name, tree.of)}"


def _length(tree, name):
    """Length of a rod, or from a joint to its end frame [m]."""
    piece = tree.pieces[tree.of[name][0]]
    return piece.record.length if piece.is_rod else norm(se3.position(piece.end))


def _nodes(piece, stretch, part):
    if stretch.parallel:
        return (((part[1] - part[0]) * piece.length, stretch.at(0.0), ca.DM(3, 1)),)
    factor = len(piece.slices) // piece.record.quadrature
    slices = piece.record.slices(piece.index, factor, *part)
    return tuple((p.weight, stretch.at(p.x), stretch.slope(p.x)) for p in slices)
