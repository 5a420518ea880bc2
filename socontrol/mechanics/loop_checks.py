"""Loops that cannot be meant: on one rigid body, given twice, or leaving the robot no freedom to move."""

from dataclasses import replace

import numpy as np

from socontrol.mechanics.loops import independent, slices, units_of
from socontrol.quantities import Bad

CLOSED = 1e-9  # rows [m, rad] that count as zero where freedom is counted
STARTS = 6  # random shapes from which loops are closed to count the freedom they leave


def _carrier(tree, frame):
    """What rigid body or cross-section a frame stands on: (piece, x), None for the world."""
    piece, x = (None, 0.0) if frame is None else (frame.piece, frame.x)
    while piece is not None and (x == 0 or tree.pieces[piece].size == 0):
        piece, x = tree.pieces[piece].parent, tree.pieces[piece].place
    return None if piece is None else (piece, float(x))


def refuse_alike(loops, tree):
    """Raise Bad for an end that is nowhere, a loop on one rigid body, and a loop that is there twice."""
    seen = []
    for name, loop in loops.items():
        carriers = []
        for key in ("a", "b"):
            try:
                carriers.append(_carrier(tree, getattr(loop, key).locate(tree)))
            except Bad as bad:
                raise Bad(f"loops.{name}.{key}.{bad.key}", str(bad)) from None
        if carriers[0] == carriers[1]:
            where = "the world" if carriers[0] is None else "one rigid body"
            raise Bad(f"loops.{name}", f"both of its ends stand on {where}, so it can hold nothing; move one of them")
        turned = replace(loop, a=loop.b, b=loop.a)
        for other, before in seen:
            if before in (loop, turned):
                raise Bad(f"loops.{name}", f"'{name}' is the same as '{other}'; give it once")
        seen.append((name, loop))


def refuse_rigid(loops, tree, rows_of):
    """Raise Bad naming the loop that takes the last freedom.

    rows_of: Function (q) -> e, de/dq. Where loops close is looked for only if they leave nothing elsewhere:
    special sizes (planar chains apart) can move where general ones cannot.
    """
    units, rng = units_of(loops), np.random.default_rng(1)
    length = sum(float(p.length) for p in tree.pieces if p.is_rod) or 1.0
    sizes = np.array([{"1/m": 0.5 / length, "1": 0.05}.get(unit, 0.5) for unit in tree.units])

    def rows(q):
        e, E = rows_of(q)
        return np.array(e).ravel(), np.array(E)

    def stiff(E):
        return independent(E, units, 1.0).rank == tree.n

    if not stiff(rows(sizes * rng.uniform(-1, 1, tree.n))[1]):
        return
    for start in [np.zeros(tree.n), *(sizes * rng.uniform(-1, 1, (STARTS, tree.n)))]:
        q = start.copy()
        for _ in range(50):
            e, E = rows(q)
            if np.max(np.abs(e)) < CLOSED or not np.all(np.isfinite(e)):
                break
            step = np.linalg.lstsq(E, e, rcond=1e-8)[0]
            q -= step * min(1.0, 0.5 / max(np.max(np.abs(step / sizes / 2)), 1e-300))
        if np.max(np.abs(e)) < CLOSED:
            if not stiff(E):
                return
            last = next(name for name, own in slices(loops).items()
                        if independent(E[: own.stop], units[: own.stop], 1.0).rank == tree.n)  # fmt: skip
            sentence = "it leaves the robot no freedom to move; leave it out, or close it with a joint that holds less"
            raise Bad(f"loops.{last}", sentence)
