"""How far more sections move the load at which a branch of equilibria loses stability."""

import numpy as np

from socontrol.programs.equilibria.branches import follow
from socontrol.programs.equilibria.critical import Finder
from socontrol.programs.equilibria.family import Family
from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.looks.answer import spread
from socontrol.programs.postures.branch_status import lost

NEARBY = 0.05  # of the range: from where the critical point is sought again


def with_doubled_sections(family, tree, look):
    """{critical_load_change: by how much the load at which stability is lost moves when every section is halved}; None
    in its place where it is not found again."""
    robot, growth, at_loss = look.robot, family.growth, lost(tree)
    fine = robot.refined(sections=2)
    if at_loss is None or fine.n == robot.n or growth.kind == "coordinate":
        return {}
    critical, first = tree.finder.found[at_loss], tree.branches[0]
    at = next(k for k, mark in first.marks.items() if mark[0] == at_loss)
    before = max((k for k in range(at) if abs(first.points[k].s - critical.point.s) > NEARBY), default=0)
    found = _again(family, fine, look, first.points[before], 2 * len(first.points))
    return {"critical_load_change": None if found is None else (found.point.s - critical.point.s) * growth.span}


def _again(family, fine, look, begin, points):
    """The Critical at which the branch of a finer robot from beside the Point `begin` loses stability, or None."""
    robot, marks = look.robot, np.zeros(look.robot.n)
    marks[~family.free] = 1.0
    _, u, p = family.given(begin.s, begin.q)
    q, free = spread(robot, fine, begin.q), spread(robot, fine, marks) == 0
    balance = balance_of(fine, parameters=look.question.varied.paths)
    start = balance.solve(u, q, p, {int(i): q[i] for i in np.flatnonzero(~free)})
    if not start.status.solved:
        return None
    other = Family(balance, family.growth, family.u, free, family.conservative)
    ahead = np.append(np.zeros(int(free.sum())), 1.0)
    first = other.point(start.q, getattr(start, "lam", np.zeros(0)), begin.s, ahead)
    if first is None:
        return None
    finder = Finder(other)
    follow(other, first, points, finder.between, lambda mark: "found" if finder.found[mark[0]].loses else None)
    return next((critical for critical in finder.found if critical.loses), None)
