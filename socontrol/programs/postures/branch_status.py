"""What branches of equilibria mean, in sentences: where stability is lost, why a branch ends, what it passes."""

import numpy as np

from socontrol.programs.equilibria.stability import called_along
from socontrol.programs.looks.answer import FORCE_TOLERANCE, LOOP_TOLERANCE, collapsed
from socontrol.programs.result import Status
from socontrol.programs.words import pretty
from socontrol.quantities import joined

STIFFNESS_TOLERANCE = 1e-5  # recomputed stiffness of a mode at a critical point, 1 at rest: from differences
FLUTTER = (
    "Some forces have no potential (as those that follow the robot, moments, friction): it may flutter, which statics"
    " cannot tell."
)


def lost(tree, k=0):
    """Index of the critical point at which branch k loses stability, or None; one that another branch had, too, and at
    which this one ends, does not count."""
    marks = tree.branches[k].marks
    passed = (marks[i][0] for i in sorted(marks) if not marks[i][1])
    return next((index for index in passed if tree.finder.found[index].loses), None)


def unexplained(tree):
    """The first unstable Point of the first branch where no critical point says why, or None."""
    points = tree.branches[0].points
    if points[0].unstable or lost(tree) is not None:
        return None
    return next((point for point in points if point.unstable), None)


def called(tree, k):
    """What the points of branch k are called: stable, marginal, unstable."""
    branch, leaves = tree.branches[k], [] if tree.origins[k] is None else [0]
    return called_along([point.smallest for point in branch.points], [*leaves, *branch.marks])


def status_of(result, family, tree, look):
    """Status of a continuation: rejected where a look found something wrong, else what the branches do."""
    question = look.question
    if wrong := _wrong(result, family, tree, look):
        return Status("rejected", wrong)
    outcome, ends = _ends(tree, question)
    parts = [_first(family, tree, question), *_secondary(tree, question), *_marginal(tree), *ends]
    return Status(outcome, " ".join([*parts, *_beyond(family, tree, look)]))


def _wrong(result, family, tree, look):
    """Why the branches are not accepted, or None."""
    worst, more = result.residuals, "use more Gauss points (`quadrature`) or sections."
    if not worst["force"].value <= FORCE_TOLERANCE:
        told = f"The recomputed unbalanced force is {worst['force'].value:.2g} of the largest force, above"
        return f"{told} {FORCE_TOLERANCE:g}; {more}"
    if family.loops and not worst["loops"].value <= LOOP_TOLERANCE:
        return f"A recomputed loop is {worst['loops'].value:.2g} m or rad open; give a guess."
    if "critical" in worst and not worst["critical"].value <= STIFFNESS_TOLERANCE:
        return f"The recomputed stiffness of a mode at a critical point is {worst['critical'].value:.2g}, not 0; {more}"
    for k, branch in enumerate(tree.branches):
        for point in branch.points:
            if rods := collapsed(look.robot, family.given(point.s, point.q)[0]):
                where = f"Branch {k}: from {look.question.varied.told(point.s)} on"
                return f"{where} these are collapsed or over-bent: {', '.join(rods)}; end before, or use more sections."
    return None


def _first(family, tree, question):
    """What the first branch does."""
    told, first = question.varied.told, tree.branches[0]
    flutter = "" if family.conservative else f" {FLUTTER}"
    if first.points[0].unstable:
        return f"Unstable from the beginning, {told(0.0)}.{flutter}"
    if (at_loss := lost(tree)) is not None:
        critical = tree.finder.found[at_loss]
        where = told(critical.point.s)
        if critical.kind == "bifurcation":
            return f"Buckles at {where}{_at_once(tree, at_loss)}.{flutter}"
        return f"Snaps at {where}, where the branch turns back.{flutter}"
    if (unstable := unexplained(tree)) is not None:
        if unstable.flutters:
            why = "two motions drive each other (flutter), and no other equilibrium leaves there"
            return f"Unstable from about {told(unstable.s)} on: {why}."
        return f"Stability is lost before {told(unstable.s)}, but no critical point was found there.{flutter}"
    end, words = told(max(point.s for point in first.points)), called(tree, 0)
    if _turns(first):
        ended = "There it turns back, though no motion loses its stiffness: loops are at the end of their way."
        flutter = f" {ended}{flutter}"
    if not family.conservative:
        return f"Does not diverge up to {end}.{flutter}"
    if words[0] == "marginal" and "marginal" not in words[1:]:
        return f"Marginal at the beginning, {told(0.0)}, and stable from there up to {end}.{flutter}"
    return f"{'Marginal' if 'marginal' in words else 'Stable'} up to {end}.{flutter}"


def _turns(branch):
    """Whether the parameter turns back where no critical point is, as that of a crank driven to a dead point."""
    ahead = [point.t[-1] > 0 for point in branch.points]
    turns = (k for k in range(len(ahead) - 1) if ahead[k] != ahead[k + 1])
    return any(not {k, k + 1} & branch.marks.keys() for k in turns)


def _at_once(tree, index):
    """That several modes lose their stiffness at a critical point, of which more branches leave than are followed."""
    count, followed = tree.finder.found[index].modes.shape[1], tree.origins.count(index)
    if count < 2:
        return ""
    more = f": {followed} of the branches that leave there {'is' if followed == 1 else 'are'} followed"
    return f" in {count} modes at once{more if followed else ''}"


def _secondary(tree, question):
    """Where other branches that begin stable lose it."""
    places = {}
    for k in range(1, len(tree.branches)):
        if (at_loss := lost(tree, k)) is not None and called(tree, k)[0] != "unstable":
            critical = tree.finder.found[at_loss]
            places.setdefault((critical.kind, question.varied.told(critical.point.s)), []).append(k)
    told = []
    for (kind, where), branches in places.items():
        one = len(branches) == 1
        how = "snap" if kind == "limit point" else "buckle"
        told.append(f"{_named(branches)} {how}{'s' * one} at {where}.")
    return told


def _marginal(tree):
    """Branches along which some motion costs nothing."""
    branches = [k for k in range(len(tree.branches)) if "marginal" in called(tree, k)[1:]]
    if not branches:
        return []
    return [f"{_named(branches)} {'is' if len(branches) == 1 else 'are'} marginal: some motion there costs nothing."]


def _named(branches):
    """`Branch 1`, `Branches 1 and 2`."""
    return f"Branch{'es' * (len(branches) > 1)} {joined([str(k) for k in branches], 'and')}"


def _ends(tree, question):
    """(outcome, [sentence]) of branches that did not come to an end of their own."""
    unstable = unexplained(tree)
    told, outcome = [], "solved" if unstable is None or unstable.flutters else "numerical"
    for k, branch in enumerate(tree.branches):
        where = f"Branch {k} stops at {question.varied.told(branch.points[-1].s)}"
        if branch.ended == "points":
            outcome = "limit" if outcome == "solved" else outcome
            told.append(f"{where} after {len(branch.points)} point{'s' * (len(branch.points) > 1)}; raise `points`.")
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
    varied, robot, passed, before = look.question.varied, look.robot, {}, None
    for point in tree.branches[0].points:
        q, u, _ = family.given(point.s, point.q)
        for row in look.limits_reached(q, u):
            if not row["beyond"] or row["name"] in passed:
                continue
            kind, i, limit = row["kind"], row["index"], row["limit"]
            told = f"{row['name']} passes its limit {pretty(limit, getattr(robot, f'{kind}_units')[i])}"
            if row["name"] != varied.name:
                told += f" at about {varied.told(_when(kind, i, limit, before, (point.s, q, u)))}"
            passed[row["name"]] = told
        before = point.s, q, u
    return [f"Beyond limits: {joined(list(passed.values()), 'and')}."] if passed else []


def _when(kind, i, limit, before, after):
    """s at which the i-th input or coordinate passes its limit between two (s, q, u), on a line between them."""
    if before is None:
        return after[0]
    which = 2 if kind == "input" else 1
    return float(np.interp(0.0, *zip(*sorted((x[which][i] - limit, x[0]) for x in (before, after)), strict=True)))
