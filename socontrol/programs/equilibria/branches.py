"""Branches of equilibria: followed point by point as one parameter changes, past points where they turn back.

From each point the tangent leads ahead by a step, and Newton's method back to the branch (`family`). Steps grow where
it is quick and shrink where the branch turns, where more than one motion loses its stiffness, or where stability
changes and no critical point is found in between: that is another branch, which comes near where robots are nearly
symmetric.
Source: E. Allgower, K. Georg, "Numerical Continuation Methods", 1990, ch. 2, 6.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.programs.equilibria.family import Point

LONGEST, FIRST, SHORTEST = 0.04, 0.02, 1e-7  # steps: of scaled coordinates (1: a section bent by a radian) and of s
TURNED = 0.95  # cosine between tangents that follow each other: the branch is drawn by its points
ASIDE = 0.5  # of a step: further from the predicted point may be another branch
FINEST = 1e-4  # step from which on motions may lose their stiffness several at once, or without a point that says why
QUICK, SLOW = 4, 6  # iterations of Newton's method: longer steps up to the first, shorter ones beyond the other
LOWEST = -1.0  # of s: a branch that turns back is followed as far to the other side
HOME = 0.2  # of the longest step, from the first point: the branch has closed


@dataclass(frozen=True)
class Branch:
    """Points along a branch and why it ends: `end`, `back` (as far to the other side), `points`, `closed`, `strains`,
    `lost`, `meets` or `found`; marks: indices of the points at which stability or direction changes, by place."""

    points: list[Point]
    ended: str
    marks: dict


def follow(family, start, points, mark=None, stop=lambda found: None):
    """Branch from a Point along its tangent, with at most `points` points.

    mark(a, b): [(Point, what it is)] to be put between neighbours; stop(what): why to end there, or None.
    """
    found, marks, step, last = [start], {}, FIRST, start
    while len(found) < points:
        ahead, count = family.corrected(last, step * last.t)
        if ahead is not None and not _near(family, last, ahead, step):
            ahead = None
        ends = [s for s in (1.0, LOWEST) if ahead and ((ahead.s - s) * (last.s - s) < 0 or ahead.s == s)]
        if ends:
            ahead = family.at(last, ahead, ends[0])
        if ahead is None:
            step /= 2
            if step < SHORTEST:
                return Branch(found, _why(family, last), marks)
            continue
        marked = mark(last, ahead) if mark else []
        if mark and not marked and ahead.unstable != last.unstable and step > FINEST:  # not without a critical point
            step /= 2
            continue
        for point, what in marked:
            marks[len(found)] = what
            found.append(point)
        if reasons := [reason for _, what in marked if (reason := stop(what))]:
            return Branch(found, reasons[0], marks)
        found.append(ahead)
        if ends:
            return Branch(found, "end" if ends[0] == 1.0 else "back", marks)
        if len(found) > 10 and np.linalg.norm(family.distance(start, ahead)) < HOME * LONGEST and ahead.t @ start.t > 0:
            return Branch(found, "closed", marks)
        last = ahead
        step = min(LONGEST, step * (1.5 if count <= QUICK else 1.0 if count <= SLOW else 0.7))
    return Branch(found, "points", marks)


def _near(family, a, b, step):
    """Whether b is the next point of the branch of a, and not one of another branch."""
    gone = family.distance(a, b)
    aside = np.linalg.norm(gone - step * a.t)
    return a.t @ b.t >= TURNED and aside <= ASIDE * step and (abs(a.unstable - b.unstable) <= 1 or step < FINEST)


def _why(family, last):
    """Why no further point was found."""
    q = last.q.copy()
    q[family.free] += LONGEST * last.t[:-1] * family.size
    return "strains" if family.balance.robot.overstrained(q) else "lost"
