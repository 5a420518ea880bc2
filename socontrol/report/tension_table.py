"""Cables and chambers of one posture in a table: lengths, angles of motors, far ends, volumes; how they were given."""

import numpy as np

from socontrol.report.columns import columns, line, say
from socontrol.report.tension_course import slack, tendons
from socontrol.report.units import fixed, readable

GIVEN = {"lengths": "length", "motors": "motor angle", "volumes": "volume"}  # key of a question: what it gives
TOLD_FIRST = 8  # names in a sentence; the rest is counted


def found_from(question):
    """{input: by what it was given} of the inputs that were found from lengths, motor angles or volumes."""
    return {name: what for key, what in GIVEN.items() for name in (getattr(question, key, None) or {})}


def tells(result):
    """Whether there is more to tell than inputs: of cables, of a question of tensions, of given volumes."""
    if result.question is None or not result.question.robot.m:
        return False
    return bool(tendons(result.question.robot)) or result.type == "tensions" or bool(found_from(result.question))


def slack_names(result):
    """Names of slack cables of a posture."""
    u = result.arrays.get("u")
    if u is None or np.ndim(u) != 1 or not tells(result):
        return []
    return [name for name, none in zip(result.question.robot.inputs, slack(result.question, u), strict=True) if none]


def tight_limits(result):
    """Rows of details["limits"] without those of slack cables: to be slack is no limit of a cable."""
    idle = slack_names(result)
    return [row for row in result.details.get("limits") or ()
            if not (row["kind"] == "input" and row["side"] == "lower" and row["name"] in idle)]  # fmt: skip


def cables(result, console):
    """Print tables of cables and of chambers, and which inputs were found from what; names of what is told."""
    if not tells(result):
        return set()
    robot = result.question.robot
    pulled = [robot.inputs[k] for k in tendons(robot)]
    filled = [name for name, unit in zip(robot.inputs, robot.input_units, strict=True) if unit == "Pa"]
    rest = dict(zip(robot.inputs, robot.straight_lengths, strict=True))
    told = {*_table(result, console, "cable", pulled, rest), *_table(result, console, "chamber", filled, rest)}
    said_of_given(result, console)
    return told


def _table(result, console, label, names, rest):
    """Length, change against the straight robot, and what else is known of `names`; the names."""
    names = [name for name in names if f"lengths.{name}" in result.values]
    if not names:
        return []
    lengths = np.array([result[f"lengths.{name}"] for name in names])
    cells = {"length": (lengths, "m"), "change": (lengths - [rest[name] for name in names], "m")}
    for key, head in (("motors", "motor"), ("volumes", "volume"), ("tension_end", "at far end")):
        known = [result.values.get(f"{key}.{name}") for name in names]
        if any(known):
            unit = next(v.unit for v in known if v)
            cells[head] = (np.array([np.nan if v is None else v.value for v in known]), unit)
    loose = _loose(result)
    if any(name in loose for name in names):
        cells["loose by"] = np.array([loose.get(name, np.nan) for name in names]), "m"
    heads, shown = [label], [[(name, "bold")] for name in names]
    for head, (values, unit) in cells.items():
        size = float(np.nanmax(np.abs(values)))
        one, name_of_unit = readable(unit, size)
        heads.append(f"{head} [{name_of_unit}]>")
        for row, x in zip(shown, values, strict=True):
            row.append(fixed(x / one, max(size / one, 1.0), 5 if head == "length" else 4) if np.isfinite(x) else "")
    columns(console, heads, shown)
    return names


def _loose(result):
    """{name: m} by which slack cables are longer than their way, of those given by length."""
    held, idle = getattr(result.question, "held", None), slack_names(result)
    known = zip(getattr(held, "names", ()), getattr(held, "length", ()), strict=True)
    return {name: float(x) - result[f"lengths.{name}"] for name, x in known if name in idle}


def said_of_given(result, console):
    """Which inputs were found from lengths, motor angles or volumes."""
    by = {}
    for name, what in found_from(result.question).items():
        by.setdefault(what, []).append(name)
    if by:
        parts = [f"{listed(names)} from {'its' if len(names) == 1 else 'their'} {what}{'s' * (len(names) > 1)}"
                 for what, names in by.items()]  # fmt: skip
        say(console, "found", "; ".join(parts))
        line(console, "")


def listed(names, most=TOLD_FIRST):
    """`c0, c1 and 3 more`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
