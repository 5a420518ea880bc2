"""A goal out of reach: the nearest reachable posture, the limits it stands on, and what each alone would have to be."""

import numpy as np

from socontrol.programs.result import Result, Status, Value

PULL = 1e4  # weight of moving the limit, beside an effort of order 1: its smallest move is found, nearly
WIDER = 1e3  # a limit is let go to this many times its span, so that the program stays bounded


def explain(solver, result, outcome, parameters):
    """The result of an infeasible goal with `details["unreachable"]` and a message that names the limits."""
    posture, robot = solver.posture, solver.question.robot
    rows = []
    for limit in [] if posture.overdetermined else result.details["limits"]:
        needed = _alone(solver, limit, outcome, parameters)
        rows.append(
            {**{k: limit[k] for k in ("kind", "name", "side", "limit")}, "needed": needed, "unit": _unit(robot, limit)}
        )
    short = {}
    for name, miss in posture.misses(outcome.values["q"], parameters).items():
        if posture.goals[name].weight is None:
            units = np.array(posture.goals[name].units())
            short[name] = {str(unit): float(np.linalg.norm(miss[units == unit])) for unit in dict.fromkeys(units)}
    values = {f"short.{n}": Value(x, unit) for n, by_unit in short.items() for unit, x in list(by_unit.items())[:1]}
    details = {**result.details, "unreachable": rows, "short": short}
    sentence = _too_many(short, *posture.counts) if posture.overdetermined else _sentence(short, rows)
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
        needed = (
            "not by this limit alone"
            if row["needed"] is None
            else f"alone it would have to be {pretty(row['needed'], row['unit'])}"
        )
        text += f" {row['name']} is at its {row['side']} limit {pretty(row['limit'], row['unit'])}: {needed}."
    return text if rows else text + " No limit is reached: the robot's geometry or load forbids it; move the goal."


def pretty(x, unit):
    for base, factor, name in (
        ("Pa", 1e-3, "kPa"),
        ("m", 1e3, "mm"),
        ("N m", 1e3, "mN m"),
        ("rad", 180 / np.pi, "deg"),
    ):
        if unit == base:
            return f"{x * factor:.4g} {name}"
    return f"{x:.4g} {unit}" if unit != "1" else f"{x:.4g}"
