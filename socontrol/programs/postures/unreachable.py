"""A goal out of reach: the nearest reachable posture, the limits it stands on, and what each alone would have to be."""

import numpy as np

from socontrol.programs.postures.lifted import Lifted
from socontrol.programs.result import Result, Status, Value
from socontrol.programs.words import pretty, would_need

MOST = 4  # inputs whose limits are lifted, one after the other, where none is reached
SAME = 1e-7  # of the robot's length, or radians: goals whose numbers change less are not moved


def explain(solver, result, outcome, parameters):
    """The result of an infeasible goal with `details["unreachable"]` and a message that names the limits."""
    posture, robot, search = solver.posture, solver.question.robot, Lifted(solver, outcome, parameters)
    too_many = posture.overdetermined and counted(solver, outcome, parameters) > posture.counts[1]
    rows = []
    for limit in [] if too_many else result.details["limits"] or _others(solver):
        needed = search.alone(limit)
        if not limit.get("reached", True) and (needed is None or needed <= limit["limit"]):
            continue
        pulls = limit["kind"] == "input" and bool(robot.pulls[limit["index"]])
        known = {k: limit[k] for k in ("kind", "name", "side", "limit")} | {"reached": limit.get("reached", True)}
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
    sentence = _too_many(short, *posture.counts) if too_many else _sentence(short, rows)
    if all(row["needed"] is None or _pushes(row) for row in rows):
        details["together"] = together = _together(search, result.details["limits"], rows)
        if together:  # as many numbers as they are, limits alone forbid them
            sentence = f"Out of reach: the nearest posture misses {_misses(short)}."
        sentence += _joint(together, result.details["limits"], robot)
    status = Status("infeasible", sentence)
    return Result(**{**vars(result), "status": status, "details": details, "values": {**result.values, **values}})


def _others(solver):
    """Upper limits of the free inputs, where the nearest posture stands on none: what is nearer may be beyond them."""
    lower, upper = solver.posture.limits()["u"]
    free = np.flatnonzero((lower < upper) & np.isfinite(upper))
    names = solver.question.robot.inputs
    return [{"kind": "input", "name": names[i], "side": "upper", "limit": float(upper[i]), "index": int(i),
             "reached": False} for i in free[:MOST]]  # fmt: skip


def _unit(robot, limit):
    units = robot.input_units if limit["kind"] == "input" else robot.coordinate_units
    return units[limit["index"]]


def _together(search, limits, rows):
    """What `Lifted.together` finds for the inputs at an upper limit; None where there is none, or one already tried."""
    lifted = [limit["index"] for limit in limits if limit["kind"] == "input" and limit["side"] == "upper"]
    return search.together(lifted) if lifted and (len(lifted) > 1 or not rows) else None


def counted(solver, outcome, parameters):
    """How many numbers the unweighted goals ask for that depend neither on each other nor on what the robot is: of a
    robot in a plane, those in it. All of them where what it misses is what no inputs change."""
    posture, length = solver.posture, solver.question.robot.length
    goals = {name: goal for name, goal in posture.goals.items() if goal.weight is None}
    scale = np.concatenate([np.array(goal.scales(length)) for goal in goals.values()])

    def missed(q):
        found = posture.misses(q, parameters)
        return np.concatenate([found[name] for name in goals]) / scale

    here, rng = missed(outcome.values["q"]), np.random.default_rng(solver.question.solver.seed)
    shapes = [solver.rest["q"]]
    for _ in range(here.size + 1):
        answer = solver.balance.solve(solver.random_inputs(rng), solver.rest["q"], prescribed=posture.prescribed)
        shapes += [answer.q] if answer.status.solved else []
    U, s, _ = np.linalg.svd(np.array([missed(q) - here for q in shapes]).T)
    rank = int(np.sum(s > SAME * max(1.0, s[0])))
    return rank if np.linalg.norm(U[:, rank:].T @ here) <= SAME else here.size


def _joint(together, limits, robot):
    """The sentence on what all limits together would have to be."""
    if not together:
        return "" if together is None else " Nor was a way found by higher limits of all these inputs together."
    known = {row["name"]: row for row in limits if row["kind"] == "input" and row["side"] == "upper"}
    told = []
    for name, needed in together.items():
        unit = _unit(robot, known[name])
        told.append(would_need(name, pretty(needed, unit), pretty(known[name]["limit"], unit)))
    return f" Together they would do: {'; '.join(told)}."


def _misses(short):
    rows = [(name, unit, x) for name, by_unit in short.items() for unit, x in by_unit.items() if x > 1e-9]
    return " and ".join(f"{name} by {pretty(x, unit)}" for name, unit, x in rows) or "the goal"


def _too_many(short, asked, free):
    numbers = "1 number" if asked == 1 else f"{asked} numbers"
    inputs = "1 input is" if free == 1 else f"{free} inputs are"
    return (
        f"Out of reach: the goals ask for {numbers} and {inputs} free, the nearest posture misses {_misses(short)};"
        " give a goal a weight, or leave coordinates null."
    )


def _sentence(short, rows):
    text = f"Out of reach: the nearest posture misses {_misses(short)}."
    for row in rows:
        text += f" {_needed(row)}."
    none = " No limit is reached: the robot's geometry or load seems to forbid it; move the goal."
    return text if rows else text + none


def _pushes(row):
    """Whether what would be needed is a cable that pushes."""
    return row["pulls"] and row["side"] == "lower" and row["needed"] is not None and row["needed"] < 0


def _needed(row):
    """What one limit alone would have to be, in words: tensions by what the cable would need."""
    limit = pretty(row["limit"], row["unit"])
    if row["needed"] is None:
        return f"{row['name']} is at its {row['side']} limit {limit}: no way found by this limit alone"
    if not row["pulls"] and row["reached"]:
        needed = pretty(row["needed"], row["unit"])
        return f"{row['name']} is at its {row['side']} limit {limit}: alone it would have to be {needed}"
    if _pushes(row):
        return f"{row['name']} is slack and would have to push with {pretty(-row['needed'], 'N')}"
    return would_need(row["name"], pretty(row["needed"], row["unit"]), limit)
