"""What to loosen where no motion meets all limits: every limit gives way, and as little as possible in all."""

from dataclasses import replace

from socontrol.programs.nlp.solver import NLP, Ipopt
from socontrol.programs.plans.plan_answer import SPEEDS, faster
from socontrol.programs.plans.planner import Planner

GIVEN_WAY = 1e-5  # of a limit's size: less is rounding


def loosened(question, start, courses, progress=None):
    """(rows, curve, outcome): what gives way, most first, and the motion then; rows None where that fails as well.

    Searched from each of the `courses`; the least that gives way counts.

    Rows are {quantity, by, unit, share, cost}: the limit, how far it moves, that over its size, and what that costs.
    """
    settings = question.solver if isinstance(question.solver, Ipopt) else Ipopt(tolerance=1e-8)
    question = replace(question, solver=replace(settings, hessian="exact"))
    planner = Planner(question, start, loose=True)
    nlp = NLP(planner.program, question.solver, question.loaded.compiled, progress)
    outcomes = [nlp.solve(course.fill(planner.transcription)) for course in courses]
    outcome = min(outcomes, key=lambda one: (not one.status.solved, one.cost))
    if not outcome.status.solved:
        return None, None, outcome
    found = planner.transcription.planned(outcome.values)
    rows = []
    for limit in planner.giving.loose:
        by = float(outcome.values[limit.place])
        share, unit = by / limit.size, limit.unit
        if limit.name.startswith(SPEEDS):
            by, unit = faster(question, limit.name, by), "m/s"
        if share > GIVEN_WAY:
            row = {"quantity": limit.name, "by": float(by), "unit": unit, "share": float(share)}
            rows.append({**row, "cost": float(limit.cost * share)})
    return sorted(rows, key=lambda row: -row["cost"]), found, outcome
