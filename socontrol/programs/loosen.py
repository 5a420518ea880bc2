"""What to loosen where no motion meets all limits: every limit gives way, and as little as possible in all."""

from dataclasses import replace

import numpy as np

from socontrol.programs.plan_guess import FINE, Course
from socontrol.programs.planner import Planner
from socontrol.programs.solver import NLP, Ipopt

GIVEN_WAY = 1e-5  # of a limit's size: less is rounding


def loosened(question, start, curve, progress=None):
    """(rows, curve, outcome): what gives way, most first, and the motion then; rows None where that fails as well.

    Rows are {quantity, by, unit, share, cost}: the limit, how far it moves, that over its size, and what that costs.
    """
    settings = question.solver if isinstance(question.solver, Ipopt) else Ipopt(tolerance=1e-8)
    question = replace(question, solver=replace(settings, hessian="exact"))
    planner = Planner(question, start, loose=True)
    nlp = NLP(planner.program, question.solver, question.loaded.compiled, progress)
    shares = np.linspace(0.0, 1.0, FINE + 1)
    q, _, _, u, _ = curve.at(shares * curve.duration)
    outcome = nlp.solve(Course(shares, q, u, curve.duration).fill(planner.transcription))
    if not outcome.status.solved:
        return None, None, outcome
    found = planner.transcription.planned(outcome.values)
    rows = []
    for limit in planner.loose:
        by = float(outcome.values[limit.place])
        if by > GIVEN_WAY * limit.size:
            rows.append({"quantity": limit.name, "by": by, "unit": limit.unit, "share": by / limit.size,
                         "cost": limit.cost * by / limit.size})  # fmt: skip
    return sorted(rows, key=lambda row: -row["cost"]), found, outcome
