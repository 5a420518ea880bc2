"""The tree of pieces that a robot's segments become, with names for its coordinates."""

from dataclasses import dataclass
from typing import Any

import casadi as ca

from socontrol.model.bases import STRAIN_UNITS
from socontrol.model.rods import Rod
from socontrol.model.steps import Piece
from socontrol.quantities import Bad, nearest


@dataclass(frozen=True)
class Frame:
    """A place on the robot: x on a piece, then a fixed `offset` [4 x 4]."""

    piece: int
    x: float
    offset: Any


@dataclass(frozen=True)
class Tree:
    """Pieces in file order, parents before children; `of[segment]` gives the indices of a segment's pieces."""

    pieces: tuple
    of: dict
    coordinates: tuple
    units: tuple
    segments: dict

    @property
    def n(self):
        return len(self.coordinates)

    def locate(self, segment, X=1.0):
        """Frame at X of a segment: any X on a rod; 0 (before) or 1 (end frame) on a joint.

        Raises ValueError with the segments' names or the allowed X.
        """
        if segment not in self.of:
            raise ValueError(f"unknown segment '{segment}'{nearest(segment, self.of)}")
        if not 0 <= X <= 1:
            raise ValueError(f"X = {X:g} on '{segment}' is outside [0, 1]")
        record, indices = self.segments[segment], self.of[segment]
        if isinstance(record, Rod):
            bounds = record.boundaries()
            section = next((i for i in range(len(indices)) if bounds[i + 1] >= X), len(indices) - 1)
            x = (X - bounds[section]) / (bounds[section + 1] - bounds[section])
            return Frame(indices[section], x, ca.DM.eye(4))
        if X not in (0, 1):
            raise ValueError(f"X = {X:g} on '{segment}': a joint has only 0 (before it) and 1 (its end frame)")
        return Frame(indices[0], X, self.pieces[indices[0]].end if X == 1 else ca.DM.eye(4))

    @property
    def sections(self):
        """Names of the sections of rods, from base to end of each rod, rods in file order."""
        return [f"{piece.segment}.{piece.index}" for piece in self.pieces if piece.is_rod]

    def turns(self, q):
        """Vector [3, rad] by which each of `sections` turns at q; the series of exp hold up to a length of 2 pi."""
        return [piece.strain(q)[:3] * piece.length for piece in self.pieces if piece.is_rod]

    def chain(self, piece, x):
        """(piece, x) of everything that carries the place x on `piece`, from it to the root."""
        while piece is not None:
            yield piece, x
            piece, x = self.pieces[piece].parent, self.pieces[piece].place


def build(segments, factor=1):
    """Tree of an ordered mapping name -> joint or rod record; `factor` multiplies the Gauss points.

    Raises Bad for a parent that does not stand before its child, pointing at `<name>.parent`.
    """
    tree = Tree((), {}, (), (), {})
    for name, record in segments.items():
        parent, place, placement = _stand(tree, name, record, segments)
        pieces, names, units = list(tree.pieces), list(tree.coordinates), list(tree.units)
        for piece, own_names, own_units in _pieces(
            name, record, parent, place, placement, len(names), factor, len(pieces)
        ):
            pieces.append(piece)
            names += own_names
            units += own_units
        of = {**tree.of, name: tuple(range(len(tree.pieces), len(pieces)))}
        tree = Tree(tuple(pieces), of, tuple(names), tuple(units), {**tree.segments, name: record})
    return tree


def _stand(tree, name, record, segments):
    """Parent piece, x on it, and the placement of a segment's base there."""
    if record.parent == "world":
        return None, 0.0, record.placement.pose()
    if record.parent == name:
        raise Bad(f"{name}.parent", "a segment cannot be its own parent")
    if record.parent not in tree.of:
        if record.parent in segments:
            raise Bad(
                f"{name}.parent",
                f"'{record.parent}' stands after '{name}' (or in a cycle); put parents before children",
            )
        raise Bad(f"{name}.parent", f"unknown segment '{record.parent}'{nearest(record.parent, ['world', *tree.of])}")
    try:
        frame = tree.locate(record.parent, record.at)
    except ValueError as error:
        raise Bad(f"{name}.at", str(error)) from None
    return frame.piece, frame.x, frame.offset @ record.placement.pose()


def _pieces(name, record, parent, place, placement, first, factor, count):
    """(piece, coordinate names, units) for each piece of one segment."""
    if not isinstance(record, Rod):
        n = len(record.units)
        names = [name] if n == 1 else [f"{name}.{i}" for i in range(n)]
        piece = Piece(
            segment=name, index=0, record=record, parent=parent, place=place, placement=placement,
            columns=slice(first, first + n), Phi=record.Phi(), xi_bar=ca.DM(6, 1), xi_star=None, length=1.0,
            end=record.tip.pose(),
        )  # fmt: skip
        return [(piece, names, [unit for unit, _ in record.units])]
    rows, bounds, active = [], record.boundaries(), record.active()
    for i in range(len(bounds) - 1):
        start = first + i * len(active)
        piece = Piece(
            segment=name, index=i, record=record, parent=parent if i == 0 else count + i - 1,
            place=place if i == 0 else 1.0, placement=placement if i == 0 else ca.DM.eye(4),
            columns=slice(start, start + len(active)), Phi=record.Phi(), xi_bar=record.xi_bar(i),
            xi_star=record.xi_star(i),
            length=(bounds[i + 1] - bounds[i]) * record.length, end=ca.DM.eye(4), slices=record.slices(i, factor),
        )  # fmt: skip
        rows.append((piece, [f"{name}.{i}.{s}" for s in active], [STRAIN_UNITS[s] for s in active]))
    return rows
