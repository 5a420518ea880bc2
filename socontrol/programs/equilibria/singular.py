"""Coordinates that nothing holds: directions in which a robot's static forces do not change, whatever its posture.

Statics has one answer only where the tangent dr/dq is regular. A direction v with dr/dq v = 0 at every posture
(a joint without stiffness that no load acts on, or that a constant load pushes) leaves it without one.
"""

import numpy as np

SAMPLES = 3  # postures; a tangent that is singular at random ones is singular everywhere
RANK = 1e-12  # singular value over the largest one that counts as zero


def unheld(question):
    """Names of the free coordinates that no force holds; empty where forward statics can have an answer."""
    robot = question.loaded
    free = np.ones(robot.n, dtype=bool)
    free[list(question.named("coordinates", question.coordinates))] = False
    if not any(_loose(piece, free) for piece in robot.tree.pieces):
        return []
    tangent, u = robot.functions().static_tangent.function, question.vector("inputs", question.inputs)
    rng, shared = np.random.default_rng(0), free.copy()
    for _ in range(SAMPLES):
        K = np.array(tangent(0.3 * rng.standard_normal(robot.n), u))[np.ix_(free, free)]
        shared[free] &= _null(K)
        if not shared.any():
            return []
    return [name for name, is_null in zip(robot.coordinates, shared, strict=True) if is_null]


def _loose(piece, free):
    """Whether a piece is a joint whose springs leave a free coordinate without stiffness."""
    if piece.is_rod or not piece.size or not free[piece.columns].any():
        return False
    stiffness = np.array(piece.record.matrix("stiffness"), dtype=float).reshape(piece.size, piece.size)
    return np.linalg.matrix_rank(stiffness) < piece.size


def _null(K):
    """Mask of the coordinates that the null space of K moves."""
    size = np.sqrt(np.maximum(np.abs(K).max(axis=0), np.abs(K).max(axis=1)))
    size[size == 0] = 1.0
    _, values, rows = np.linalg.svd(K / size / size[:, None])
    null = rows[values <= RANK * max(values[0], 1e-300)]
    return np.abs(null).max(axis=0, initial=0.0) > 1e-3
