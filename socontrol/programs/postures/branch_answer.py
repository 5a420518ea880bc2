"""From branches of equilibria to a Result: their values, what is looked at again, and sentences."""

from dataclasses import replace

import numpy as np

from socontrol.mechanics.loops import slices
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.branches import follow
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.critical import Finder
from socontrol.programs.equilibria.family import Family
from socontrol.programs.looks.answer import FORCE_TOLERANCE, LOOP_TOLERANCE, Look, collapsed, spread
from socontrol.programs.looks.check import Checker
from socontrol.programs.result import Status, Value
from socontrol.quantities import joined

LOOKED_AT = 5  # points of a branch, beside its critical ones
STIFFNESS_TOLERANCE = 1e-5  # recomputed stiffness of a mode at a critical point, 1 at rest: from differences
DIFFERENCE = 1e-4  # scaled amplitude of a mode for these differences
FLUTTER = "Forces that follow the robot may make it flutter, which statics cannot tell."
NEARBY = 0.05  # of the range: from where the critical point is sought again with twice the sections


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
    changed = _with_doubled_sections(family, tree, look) if look.question.discretisation else {}
    result = replace(result, values=values, arrays=arrays, residuals=residuals, details={**details, **changed})
    return replace(result, status=_status(result, family, tree, look))


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
        for k in np.unique(np.linspace(0, len(branch.points) - 1, LOOKED_AT).round().astype(int)):
            looked(branch.points[k])
    for critical in tree.finder.found:
        view, u = looked(critical.point)
        for mode in critical.modes.T:
            seen("critical", view.left(critical.point, mode, u, family.free), "1")
    return found


def _with_doubled_sections(family, tree, look):
    """{critical_load_change: by how much the load at which stability is lost moves when every section is halved}."""
    robot, growth, lost = look.robot, family.growth, _lost(tree)
    fine = robot.refined(sections=2)
    if lost is None or fine.n == robot.n or growth.kind == "coordinate":
        return {}
    critical, points = tree.finder.found[lost], tree.branches[0].points
    at = next(k for k, mark in tree.branches[0].marks.items() if mark[0] == lost)
    before = max((k for k in range(at) if abs(points[k].s - critical.point.s) > NEARBY), default=0)
    begin, marks = points[before], np.zeros(robot.n)
    marks[~family.free] = 1.0
    _, u, p = family.given(begin.s, begin.q)
    q, free = spread(robot, fine, begin.q), spread(robot, fine, marks) == 0
    balance = (ClosedBalance if family.loops else Balance)(fine, look.question.varied.paths, None)
    start = balance.solve(u, q, p, {int(i): q[i] for i in np.flatnonzero(~free)})
    if not start.status.solved:
        return {"critical_load_change": None}
    other = Family(balance, growth, family.u, free, family.conservative)
    first = other.point(start.q, getattr(start, "lam", np.zeros(0)), begin.s, np.append(np.zeros(int(free.sum())), 1.0))
    finder = Finder(other)
    follow(other, first, 2 * len(points), finder.between, lambda mark: "found" if _loses(finder.found[-1]) else None)
    found = [x for x in finder.found if _loses(x)]
    return {"critical_load_change": (found[0].point.s - critical.point.s) * growth.span if found else None}


# Values


def _loses(critical):
    """Whether stability is lost there, along the way it was passed."""
    return critical.before == 0 and critical.after > 0


def _lost(tree):
    """Index of the critical point at which the first branch loses stability, or None."""
    marks = tree.branches[0].marks
    return next((marks[k][0] for k in sorted(marks) if _loses(tree.finder.found[marks[k][0]])), None)


def _told(family, tree, look):
    """(values, arrays, details) of a tree."""
    question, growth = look.question, family.growth
    values, arrays, rows = {}, {}, []
    watched = question.watched
    pose = look.functions.pose(watched.on, watched.at).function
    for k, (branch, origin) in enumerate(zip(tree.branches, tree.origins, strict=True)):
        given = [family.given(point.s, point.q) for point in branch.points]
        places = np.array([np.array(pose(q))[:3, 3] for q, _, _ in given])
        arrays |= {f"branch.{k}.{key}": np.array(array) for key, array in {
            "parameter": [growth.at(point.s) for point in branch.points], "q": [q for q, _, _ in given],
            "stable": [point.unstable == 0 for point in branch.points], "watch": places,
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
                         "work": found.work, "eigenvalue": found.point.smallest})  # fmt: skip
    if (lost := _lost(tree)) is not None:
        values["critical_load"] = values[f"critical.{lost}"]
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
    return varied.name or f"factor on {joined([name for name, _, _ in varied.forces], 'and')}"


# Sentences


def _status(result, family, tree, look):
    worst, question = result.residuals, look.question
    if not worst["force"].value <= FORCE_TOLERANCE:
        told = f"The recomputed unbalanced force is {worst['force'].value:.2g} of the largest force, above"
        return Status("rejected", f"{told} {FORCE_TOLERANCE:g}; use more Gauss points (`quadrature`) or sections.")
    if family.loops and not worst["loops"].value <= LOOP_TOLERANCE:
        return Status("rejected", f"A recomputed loop is {worst['loops'].value:.2g} m or rad open; give a guess.")
    if "critical" in worst and not worst["critical"].value <= STIFFNESS_TOLERANCE:
        told = f"The recomputed stiffness of a mode at a critical point is {worst['critical'].value:.2g}, not 0"
        return Status("rejected", f"{told}; use more Gauss points (`quadrature`) or sections.")
    for k, branch in enumerate(tree.branches):
        for point in branch.points:
            if rods := collapsed(look.robot, family.given(point.s, point.q)[0]):
                where = f"Branch {k}: from {question.varied.told(point.s)} on"
                told = f"{where} these are collapsed or over-bent: {', '.join(rods)}; end before, or use more sections."
                return Status("rejected", told)
    outcome, told = _ends(tree, question)
    sentences = [_first(family, tree, question), *told, *_beyond(family, tree, look)]
    return Status(outcome, " ".join(sentences))


def _first(family, tree, question):
    """What the first branch does."""
    told, first = question.varied.told, tree.branches[0]
    lost = _lost(tree)
    flutter = "" if family.conservative else f" {FLUTTER}"
    if first.points[0].unstable:
        return f"Unstable from the beginning, {told(0.0)}.{flutter}"
    if lost is not None:
        critical = tree.finder.found[lost]
        if critical.kind == "bifurcation":
            return f"Buckles at {told(critical.point.s)}.{flutter}"
        return f"Snaps at {told(critical.point.s)}, where the branch turns back.{flutter}"
    end = max(first.points, key=lambda point: point.s)
    state = "Stable" if family.conservative else "Does not diverge"
    return f"{state} up to {told(end.s)}.{flutter}"


def _ends(tree, question):
    """(outcome, [sentence]) of branches that did not come to an end of their own."""
    told, outcome = [], "solved"
    for k, branch in enumerate(tree.branches):
        where = f"Branch {k} stops at {question.varied.told(branch.points[-1].s)}"
        if branch.ended == "points":
            outcome = "limit" if outcome == "solved" else outcome
            told.append(f"{where} after {len(branch.points)} points; raise `points`.")
        elif branch.ended == "strains":
            outcome = "numerical"
            told.append(f"{where}, where a section would turn by more than 2 pi; use more sections, or end before.")
        elif branch.ended == "lost":
            outcome = "numerical"
            told.append(f"{where}: no next point was found; give joints stiffness, or end before.")
    if tree.barren:
        outcome = "numerical"
        names = joined([f"critical.{k}" for k in dict.fromkeys(tree.barren)], "and")
        told.append(f"No step onto another branch was found from {names}.")
    return outcome, told


def _beyond(family, tree, look):
    """Where the first branch passes limits of inputs and coordinates first."""
    passed = {}
    for point in tree.branches[0].points:
        q, u, _ = family.given(point.s, point.q)
        for row in look.limits_reached(q, u):
            if row["beyond"] and row["name"] not in passed:
                passed[row["name"]] = look.question.varied.told(point.s)
    return [f"Beyond its limits: {', '.join(f'{name} from {at} on' for name, at in passed.items())}."] if passed else []
