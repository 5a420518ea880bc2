"""Where a robot is displaced most: how far points of its segments have moved."""

import numpy as np

POINTS = 16  # parts of a section: between them less than 1/8 POINTS^2 of its bend is overlooked


def largest(checker, start, q):
    """(displacement [m], segment, X) of the point that q [n] takes farthest from where `start` [n] has it: of the
    centre lines of rods and the end frames of joints."""
    before, after, best = checker.look(start), checker.look(q), (0.0, checker.pieces[0].segment, 0.0)
    for i, piece in enumerate(checker.pieces):
        x = np.linspace(0, 1, POINTS + 1) if piece.is_rod else np.ones(1)
        here, there = ((look.poses(i, x) @ checker.ends[i])[:, :3, 3] for look in (before, after))
        moved = np.linalg.norm(there - here, axis=1)
        k = int(np.argmax(moved))
        if moved[k] > best[0] * (1 + 1e-12):
            best = float(moved[k]), piece.segment, _place(piece, float(x[k]))
    return best


def _place(piece, x):
    """X on the segment of a place x on one of its pieces."""
    if not piece.is_rod:
        return 1.0
    first, last = piece.record.boundaries()[piece.index : piece.index + 2]
    return float(first + (last - first) * x)
