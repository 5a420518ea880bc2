"""Coordinates that nothing holds: directions in which a robot's static forces do not change, whatever its posture.

Statics has one answer only where the tangent dr/dq is regular. A direction v with dr/dq v = 0 at every posture
(a joint without stiffness that no load acts on, or that a constant load pushes) leaves it without one. Loops and inputs
held at lengths leave fewer motions: the tangent is looked at on those, at closed shapes, what loops bear counted.
"""

import numpy as np

from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.closing import CLOSED, Assembly
from socontrol.programs.equilibria.lengths import Routes

SAMPLES = 3  # postures; a tangent that is singular at random ones is singular everywhere
RANK = 1e-12  # singular value over the largest one that counts as zero
HELD_RANK = 1e-9  # the same on the motions that loops and lengths leave, which are known less well


def unheld(question):
    """Names of the free coordinates that no force holds; empty where forward statics can have an answer."""
    robot = question.loaded
    free = np.ones(robot.n, dtype=bool)
    free[list(getattr(question, "locked", None) or question.named("coordinates", question.coordinates))] = False
    if not any(_loose(piece, free) for piece in robot.tree.pieces):
        return []
    given, rng = question.first_coordinates(), np.random.default_rng(0)
    tangents, shared = _Tangents(question, free), free.copy()
    for _ in range(SAMPLES):
        found = tangents(np.where(free, 0.3 * rng.standard_normal(robot.n), given))
        if found is None:
            return []
        shared[free] &= _null(*found)
        if not shared.any():
            return []
    return [name for name, is_null in zip(robot.coordinates, shared, strict=True) if is_null]


class _Tangents:
    """Tangents of one question's robot on its free coordinates, and the rows that hold them."""

    def __init__(self, question, free):
        self.robot, self.free = question.loaded, free
        self.u = getattr(question, "acting", question.vector("inputs", question.inputs))
        self.held = getattr(question, "held", None)
        if self.robot.loops:
            self.balance = ClosedBalance(self.robot)
            self.assembly = Assembly(self.balance, free)

    def __call__(self, q):
        """Tangent [f x f] and rows [k x f] at q, at the closed shape nearest to it; None where loops do not close."""
        rows, free = np.zeros((0, self.robot.n)), self.free
        if self.robot.loops:
            q, error = self.assembly.assembled(q)
            if error > CLOSED:
                return None
            K = self.balance.unbalanced(q, self.u, self.balance.multipliers(q, self.u, free))[1]
            rows = self.balance.held(q, free)[0]
        else:
            K = np.array(self.robot.functions().static_tangent.function(q, self.u))
        if self.held:
            rows = np.vstack([rows, Routes(self.robot)(q)[1][self.held.index]])
        return K[np.ix_(free, free)], rows[:, free]


def _loose(piece, free):
    """Whether a piece is a joint whose springs leave a free coordinate without stiffness."""
    if piece.is_rod or not piece.size or not free[piece.columns].any():
        return False
    stiffness = np.array(piece.record.matrix("stiffness"), dtype=float).reshape(piece.size, piece.size)
    return np.linalg.matrix_rank(stiffness) < piece.size


def _null(K, rows):
    """Mask of the coordinates that move in the null space of K on the motions that rows [k x f] leave."""
    size = np.sqrt(np.maximum(np.abs(K).max(axis=0), np.abs(K).max(axis=1)))
    size[size == 0] = 1.0
    Z, rank = np.eye(size.size), RANK
    if rows.size:
        _, values, left = np.linalg.svd(rows / size / np.maximum(np.linalg.norm(rows / size, axis=1), 1e-300)[:, None])
        Z, rank = left[int(np.sum(values > HELD_RANK)) :].T, HELD_RANK
    _, values, left = np.linalg.svd(Z.T @ (K / size / size[:, None]) @ Z)
    null = left[values <= rank * max(np.max(values, initial=0.0), 1e-300)] @ Z.T
    return np.abs(null).max(axis=0, initial=0.0) > 1e-3
