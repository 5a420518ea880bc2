"""A goal out of reach: the nearest reachable posture, the limits it stands on, and what each alone would have to be."""

import numpy as np

from socontrol.programs.result import Result, Status, Value
from socontrol.programs.words import pretty, would_need

PULL = 1e4  # weight of moving the limit, beside an effort of order 1: its smallest move is found, nearly
WIDER = 1e3  # a limit is let go to this many times its span, so that the program stays bounded


def explain(solver, result, outcome, parameters):
    """The result of an infeasible goal with `details["unreachable"]` and a message that names the limits."""
    posture, robot = solver.posture, solver.question.robot
    rows = []
    for limit in [] if posture.overdetermined else result.details["limits"]:
        needed = _alone(solver, limit, outcome, parameters)
        pulls = limit["kind"] == "input" and bool(robot.pulls[limit["index"]])
        known = {k: limit[k] for k in ("kind", "name", "side", "limit")}
        rows.append({**known, "needed": needed, "unit": _unit(robot, limit), "pulls": pulls})
    short = {}
    for name, miss in posture.misses(outcome.values["q"], parameters).items():
        if posture.goals[name].weight is None:
            units = np.array(posture.goals[name].units())
            short[name] = {str(unit): float(np.linalg.norm(miss[units == unit])) for unit in dict.fromkeys(units)}
    gaps = solver.look.gaps(outcome.values["q"], outcome.values["u"])
    short |= {f"lengths.{name}": {"m": gap} for name, gap in gaps.items()}
    values = {f"short.{n}": Value(x, unit) for n, by_unit in short.items() for unit, x in list(by_unit.items())[:1]}
    details = {**result.details, "unreachable": rows, "short": short}
    sentence = _too_many(short, *posture.counts) if posture.overdetermined else _sentence(short, rows)
    if all(row["needed"] is None or _pushes(row) for row in rows):
        details["together"] = together = _together(solver, result.details["limits"], outcome, parameters)
        sentence += _joint(together, rows)
    status = Status("infeasible", sentence)
    return Result(**{**vars(result), "status": status, "details": details, "values": {**result.values, **values}})


def _unit(robot, limit):
    units = robot.input_units if limit["kind"] == "input" else robot.coordinate_units
    return units[limit["index"]]


def _alone(solver, limit, outcome, parameters):
    """The value nearest its limit with which the goal is met when this limit alone is lifted; None if it is not met."""
    posture = solver.posture
    bounds = posture.limits()
    key, side = ("u", "q")[limit["kind"] == "coordinate"], limit["side"] == "upper"
    lower, upper = bounds[key]
    span = upper[limit["index"]] - lower[limit["index"]]
    span = span if np.isfinite(span) and span > 0 else max(1.0, abs(limit["limit"]))
    bounds[key][side][limit["index"]] += (1 if side else -1) * WIDER * span
    program, nlp = posture.freed.program, posture.freed
    place = program.variables[key].where.start + limit["index"]
    pull, anchor = np.zeros(program.scale.size), np.zeros(program.scale.size)
    pull[place], anchor[place] = PULL, limit["limit"] / program.scale[place]
    for start in (outcome.values, solver.rest):
        found = nlp.solve(guess=start, parameters={**parameters, "pull": pull, "anchor": anchor}, bounds=bounds)
        if found.status.outcome == "interrupted":
            raise KeyboardInterrupt
        sound = found.status.solved and not solver.look.collapsed(found.values["q"])
        if sound and solver.meets(found, parameters):
            return float(found.values[key][limit["index"]])
    return None


def _together(solver, limits, outcome, parameters):
    """{input: value} of least effort that meets the goals when the upper limits of all these inputs are lifted; {} if
    they are missed even so, None where no input is at an upper limit."""
    posture, bounds = solver.posture, solver.posture.limits()
    lifted = [limit["index"] for limit in limits if limit["kind"] == "input" and limit["side"] == "upper"]
    if not lifted:
        return None
    lower, upper = bounds["u"]
    allowed = upper.copy()
    upper[lifted] += WIDER * np.maximum(upper - lower, 1e-3 * np.max(upper - lower))[lifted]
    nlp = posture.nearest if posture.overdetermined else posture.exact
    for start in (outcome.values, solver.rest):
        found = nlp.solve(guess=start, parameters=parameters, bounds=bounds)
        if found.status.outcome == "interrupted":
            raise KeyboardInterrupt
        sound = found.status.solved and not solver.look.collapsed(found.values["q"])
        if sound and solver.meets(found, parameters):
            u = found.values["u"]
            return {posture.robot.inputs[i]: float(u[i]) for i in lifted if u[i] > allowed[i]}
    return {}


def _joint(together, rows):
    """The sentence on what all limits together would have to be."""
    if not together:
        return "" if together is None else " Higher limits of all these inputs together do not help either."
    limits = {row["name"]: row for row in rows if row["side"] == "upper"}
    told = [would_need(name, pretty(x, limits[name]["unit"]), pretty(limits[name]["limit"], limits[name]["unit"]))
            for name, x in together.items()]  # fmt: skip
    return f" Together they would do: {'; '.join(told)}."


def _misses(short):
    rows = [(name, unit, x) for name, by_unit in short.items() for unit, x in by_unit.items() if x > 1e-9]
    return " and ".join(f"{name} by {pretty(x, unit)}" for name, unit, x in rows) or "the goal"


def _too_many(short, asked, free):
    return (
        f"Out of reach: the goals ask for {asked} numbers and {free} inputs are free, the nearest posture misses"
        f" {_misses(short)}; give a goal a weight, or leave coordinates null."
    )


def _sentence(short, rows):
    text = f"Out of reach: the nearest posture misses {_misses(short)}."
    for row in rows:
        text += f" {_needed(row)}."
    return text if rows else text + " No limit is reached: the robot's geometry or load forbids it; move the goal."


def _pushes(row):
    """Whether what would be needed is a cable that pushes."""
    return row["pulls"] and row["side"] == "lower" and row["needed"] is not None and row["needed"] < 0


def _needed(row):
    """What one limit alone would have to be, in words: tensions by what the cable would need."""
    limit = pretty(row["limit"], row["unit"])
    if row["needed"] is None:
        return f"{row['name']} is at its {row['side']} limit {limit}: not by this limit alone"
    if not row["pulls"]:
        needed = pretty(row["needed"], row["unit"])
        return f"{row['name']} is at its {row['side']} limit {limit}: alone it would have to be {needed}"
    if _pushes(row):
        return f"{row['name']} is slack and would have to push with {pretty(-row['needed'], 'N')}"
    return would_need(row["name"], pretty(row["needed"], "N"), limit)
