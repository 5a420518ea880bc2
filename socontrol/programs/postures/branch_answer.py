"""From branches of equilibria to a Result: their values, and what is looked at again."""

from dataclasses import replace

import numpy as np

from socontrol.mechanics.loops import slices
from socontrol.programs.equilibria.stability import called
from socontrol.programs.looks.answer import Look
from socontrol.programs.looks.check import Checker
from socontrol.programs.looks.displacement import largest
from socontrol.programs.postures.branch_sections import with_doubled_sections
from socontrol.programs.postures.branch_status import lost, status_of
from socontrol.programs.postures.varying import Watch
from socontrol.programs.result import Value
from socontrol.quantities import joined

LOOKED_AT = 5  # points of a branch, beside its critical ones
DIFFERENCE = 1e-4  # scaled amplitude of a mode for these differences
FARTHER = 1 + 1e-6  # times as far: a place that moves more than another, rounding aside


class _Mixed:
    """The Checker of a robot whose loads are `factor` times as large: forces are linear in it."""

    def __init__(self, none, once, factor):
        self.none, self.once, self.factor, self.loop_error = none, once, factor, once.loop_error

    def __call__(self, q, u, lam=None):
        none, once = self.none(q, u, lam), self.once(q, u, lam)
        return tuple(a + self.factor * (b - a) for a, b in zip(none, once, strict=True))


class LookAt(Look):
    """The Look at a robot whose loads are those at s; checkers: of it without what varies and with it once, or one."""

    def __init__(self, look, varied, checkers, s):
        super().__init__(look.question, look.balance)
        growth = varied.growth
        self._checker = _Mixed(*checkers, growth.at(s)) if varied.values else checkers[0]
        self.p = growth.at(s) * growth.values if varied.values else None

    def unbalanced(self, q, u, lam=None):
        if lam is not None:
            return self.balance.unbalanced(q, u, lam, self.p)
        r, tangent, _ = self.balance.evaluate(q, u, self.p)
        return np.array(r), np.array(tangent)

    def left(self, point, mode, u, free):
        """Stiffness of a mode [n] (largest scaled entry 1) on what loops leave free, by differences of the force."""
        step, lam, scales = DIFFERENCE * mode, point.lam if point.lam.size else None, self.balance.scales
        sides = [self._checker(point.q + side * step, u, lam)[0] for side in (1, -1)]
        change = ((sides[0] - sides[1]) / scales.force)[free] / (2 * DIFFERENCE)
        return float(np.max(np.abs(point.Z.T @ change), initial=0.0))


def answered(result, family, tree, look):
    """The Result of a tree of branches."""
    residuals = _residuals(family, tree, look)
    values, arrays, details = _told(family, tree, look)
    changed = with_doubled_sections(family, tree, look) if look.question.discretisation else {}
    result = replace(result, values=values, arrays=arrays, residuals=residuals, details={**details, **changed})
    return replace(result, status=status_of(result, family, tree, look))


# Looks


def _residuals(family, tree, look):
    """Largest recomputed residuals at some points of all branches, the critical ones among them."""
    varied, found = look.question.varied, {}
    checkers = [Checker(varied.robot(look.robot, factor)) for factor in ((0.0, 1.0) if varied.values else (0.0,))]

    def seen(name, value, unit):
        found[name] = Value(max(value, found[name].value) if name in found else value, unit)

    def looked(point):
        view, (q, u, _) = LookAt(look, varied, checkers, point.s), family.given(point.s, point.q)
        for name, value in view.residuals(q, u, family.free, point.lam if family.loops else None).items():
            seen(name, value.value, value.unit)
        return view, u

    for branch in tree.branches:
        for k in _spread_over(branch):
            looked(branch.points[k])
    for critical in tree.finder.found:
        view, u = looked(critical.point)
        for mode in critical.modes.T:
            seen("critical", view.left(critical.point, mode, u, family.free), "1")
    return found


def _spread_over(branch):
    """Indices of LOOKED_AT points of a branch, the first and the last among them."""
    return np.unique(np.linspace(0, len(branch.points) - 1, LOOKED_AT).round().astype(int))


# Values


def _watched(family, tree, look):
    """The Watch asked for, else the place that moves farthest from where the first branch begins."""
    if look.question.watch:
        return look.question.watch
    checker, best, watch = Checker(look.robot), 0.0, None
    start = family.given(tree.branches[0].points[0].s, tree.branches[0].points[0].q)[0]
    for branch in tree.branches:
        for point in (branch.points[k] for k in _spread_over(branch)):
            moved, on, at = largest(checker, start, family.given(point.s, point.q)[0])
            if watch is None or moved > FARTHER * best:
                best, watch = moved, Watch(on=on, at=round(at, 2))
    return watch


def _told(family, tree, look):
    """(values, arrays, details) of a tree."""
    question, growth = look.question, family.growth
    values, arrays, rows = {}, {}, []
    watched = _watched(family, tree, look)
    pose = look.functions.pose(watched.on, watched.at).function
    for k, (branch, origin) in enumerate(zip(tree.branches, tree.origins, strict=True)):
        given = [family.given(point.s, point.q) for point in branch.points]
        places = np.array([np.array(pose(q))[:3, 3] for q, _, _ in given])
        arrays |= {f"branch.{k}.{key}": np.array(array) for key, array in {
            "parameter": [growth.at(point.s) for point in branch.points], "q": [q for q, _, _ in given],
            "stable": [called(point.smallest) == "stable" for point in branch.points], "watch": places,
            "smallest_eigenvalue": [point.smallest for point in branch.points],
        }.items()}  # fmt: skip
        if family.loops:
            arrays[f"branch.{k}.lam"] = np.array([point.lam for point in branch.points])
        values[f"branch.{k}.end"] = Value(float(growth.at(branch.points[-1].s)), growth.unit)
        values[f"branch.{k}.position"] = Value(places[-1].tolist(), "m")
        rows.append({"from": origin, "ended": branch.ended, "points": len(branch.points),
                     "critical": [[mark[0], index] for index, mark in sorted(branch.marks.items())]})  # fmt: skip
    critical = []
    for k, found in enumerate(tree.finder.found):
        values[f"critical.{k}"] = Value(float(growth.at(found.point.s)), growth.unit)
        arrays |= {f"critical.{k}.mode": found.modes, f"critical.{k}.q": family.given(found.point.s, found.point.q)[0]}
        on = next(n for n, branch in enumerate(tree.branches) if k in [mark[0] for mark in branch.marks.values()])
        critical.append({"kind": found.kind, "branch": on, "told": question.varied.told(found.point.s),
                         "before": found.before, "after": found.after, "modes": found.modes.shape[1],
                         "work": found.work, "eigenvalue": found.eigenvalue})  # fmt: skip
    if (at_loss := lost(tree)) is not None:
        values["critical_load"] = values[f"critical.{at_loss}"]
    redundant = _redundant(family, tree) if family.loops else {}
    details = {"branches": rows, "critical": critical, "conservative": family.conservative, "unit": growth.unit,
               "varies": _varies(question), "forces": question.varied.forces,
               "watch": {"on": watched.on, "at": watched.at}, **redundant}  # fmt: skip
    return values, arrays, details


def _redundant(family, tree):
    first = tree.branches[0].points[0]
    return {"redundant_rows": family.balance.redundant(family.given(first.s, first.q)[0], family.free),
            "loops": list(slices(family.balance.robot.loops))}  # fmt: skip


def _varies(question):
    """`factor on tip`, `c1`."""
    varied = question.varied
    return varied.name or f"factor on {joined(varied.names, 'and')}"
