"""Dead points: closed shapes at which loops hold less than beside them, and bear forces without bound.

There a combination w of the rows moves to second order only, w . e = v.Q v / 2 with Q = d(E^T w)/dq on the motions v
that the rows hardly hold. Near one, v.Q v / 2 + s v = 0 leads from a shape whose singular value is s to it by
v = -Q^+ s, past an error of s v / 2: where that is no more than what counts as closed, both shapes are closed alike,
and s, over which forces are divided, is an accident. Rows that depend on each other everywhere have Q = 0.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.mechanics.loops import slices
from socontrol.programs.equilibria.closing import CLOSED
from socontrol.quantities import joined

HARDLY = 1e-4  # of the largest singular value: rows below may be those of a dead point
ALIKE = 10  # times CLOSED: errors that count as closed
FLAT = 1e-6  # scaled second slope that is none
SOLVED = 1e-3  # of s: what is left of it where the way leads to a dead point
SHARE = 0.1  # of w in the rows of a loop that stands there


@dataclass(frozen=True)
class DeadPoint:
    """loops: names of those that stand at it; rows: orthonormal combinations [k x d] of rows over their reach."""

    loops: tuple
    rows: np.ndarray

    @property
    def sentence(self):
        """Which loops stand there."""
        names = joined([f"'{name}'" for name in self.loops], "and")
        return f"Loop {names} is at a dead point" if len(self.loops) == 1 else f"Loops {names} are at a dead point"

    @property
    def refusal(self):
        """What is to be said where forces would have to be balanced there."""
        fix = "choose a posture away from it, or other lengths of links"
        return f"{self.sentence}: no finite force there balances the robot; {fix}"


def dead_point(balance, q, free, p=None):
    """DeadPoint at a closed shape q of a ClosedBalance moved by the coordinates `free` [n]; None at any other."""
    own, size = np.ix_(free, free), balance.scales.q[free]
    e, E = balance.rows(q, p)
    if not E[:, free].size:
        return None
    room = max(ALIKE * CLOSED, 2 * float(np.max(np.abs(e / balance.reach))))
    U, s, Vt = np.linalg.svd(E[:, free] * size / balance.reach[:, None])
    first = int(np.sum(s > HARDLY * s[0]))
    s = np.concatenate([s, np.zeros(U.shape[1] - s.size)])
    left, found = Vt[first:].T, []
    for k in range(first, U.shape[1] if left.size else 0):
        turning = balance.closing(q, U[:, k] / balance.reach, p)[2][own] * size * size[:, None]
        if _leads(left.T @ turning @ left, k - first, s[k], room):
            found.append(U[:, k])
    if not found:
        return None
    rows = np.array(found).T
    parts = {name: np.max(np.linalg.norm(rows[part], axis=0)) for name, part in slices(balance.robot.loops).items()}
    return DeadPoint(tuple(name for name, part in parts.items() if part > SHARE), rows)


def _leads(Q, k, s, room):
    """Whether motions with second slopes Q [d x d], of which motion k has the first slope s, lead to a dead point."""
    if np.max(np.abs(Q)) <= FLAT:
        return False
    slope = np.zeros(len(Q))
    slope[k if k < slope.size else 0] = s
    step = -np.linalg.lstsq(Q, slope, rcond=FLAT)[0]
    return np.linalg.norm(Q @ step + slope) <= SOLVED * s and abs(step @ slope) / 2 <= room


def relieved(balance, q, free, lam):
    """(multipliers [k] less what rows at a dead point bear, DeadPoint); (lam, None) at any other shape, or without.

    Forces that are left unbalanced so need what no loop bears.
    """
    dead = None if lam is None else dead_point(balance, q, free)
    if dead is None:
        return lam, None
    scaled = lam * balance.reach
    return (scaled - dead.rows @ (dead.rows.T @ scaled)) / balance.reach, dead
