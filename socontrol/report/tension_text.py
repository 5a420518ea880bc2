"""Tensions in words, beside what every posture tells: compliance; ranges, rates, limits and slack cables on the way."""

import numpy as np
from rich.text import Text

from socontrol.report.columns import columns, line, say
from socontrol.report.inputs_text import ranges_table
from socontrol.report.plan_limits import NEAR, in_unit, told
from socontrol.report.said import counted
from socontrol.report.tension_course import Course, slack
from socontrol.report.tension_table import cables, found_from, listed, tells
from socontrol.report.units import fixed, number, percent, readable

HELD = {"tensions": "tensions held", "lengths": "lengths held"}
NOISE = 1e-9  # of the largest rate: less is none


def compliance(result, console):
    """How far the point gives way for a force: at the answer, and over all tensions that hold the goals."""
    rows, values = [], {}
    for held, label in HELD.items():
        known = [result.values.get(f"compliance.{held}{end}") for end in ("", ".least", ".greatest")]
        if known[0] is not None:
            values[label] = [1e3 * v.value if v is not None else np.nan for v in known]
    if not values:
        return
    size = max(1e-3, float(np.nanmax(list(values.values()))))
    for label, (here, least, greatest) in values.items():
        ratio = f"{greatest / least:.3g}" if np.isfinite(least) and least > 0 else ""
        cells = [fixed(x, size) if np.isfinite(x) else "" for x in (here, least, greatest)]
        rows.append([(label, "bold"), *cells, ratio])
    asked = result.question.compliance
    where = f"end of {asked.on}" if asked.at == 1 else f"{asked.on} at {asked.at:g}"
    along = ", ".join(f"{x:.3g}" for x in asked.axis)
    say(console, "compliance", f"of the {where} along [{along}] (axes of the world) in mm/N; least and greatest: "
        "the best found among the inputs that hold the goals")  # fmt: skip
    columns(console, ["", "at the answer>", "least>", "greatest>", "ratio>"], rows)
    degrees = result.details.get("compliance", {}).get("redundancy")
    if degrees is not None:
        many = f"{counted(degrees, 'independent change')} of the inputs that keep{'s' * (degrees == 1)} the goals"
        say(console, "redundancy", many if degrees else "none: the goals leave one set of inputs")
        line(console, "")


def of_path(result, console):
    """Ranges and rates along a path, limits, slack cables and where cables with friction turn."""
    course = Course.of(result)
    if course is None or not tells(result):
        return
    ranges(course, console)
    at_limits(course, console)
    _turns(result, console)
    line(console, "")


def of_simulation(result, console):
    """Cables at the end of a simulation; of inputs found from given lengths their ranges, slack ones and limits."""
    course = Course.of(result)
    given = course is not None and bool(found_from(result.question))
    if given:
        ranges_table(result, console, course.u)
        if any(key.startswith("lengths.") for key in result.values):
            line(console, Text("at the end", style="dim"))
    cables(result, console)
    if given:
        at_limits(course, console)
        line(console, "")


def ranges(course, console):
    """Ranges of lengths and largest rates of a path or a motion."""
    _lengths(course, console)
    _rates(course, console)


def at_limits(course, console):
    """Slack cables, inputs at limits and past them, and for how long."""
    _idle(course, console)
    _tight(course, console)


def _lengths(course, console):
    """Length of each cable and chamber: least, most, and the change against the straight robot."""
    rows, values = [], course.lengths
    for changes in course.changes():
        for k, (name, unit) in enumerate(zip(changes.names, changes.units, strict=True)):
            own, change = values[:, course.result.question.robot.inputs.index(name)], changes.values[:, k]
            one, shown = readable(unit, *own)
            cells = [fixed(x / one, 100.0) for x in (own.min(), own.max(), change.min(), change.max())]
            rows.append([(name, "bold"), *cells, shown])
    if rows:
        columns(console, ["length", "least>", "most>", "change, least>", "most>", ""], rows)


def _rates(course, console):
    """Largest rates, on the way to which waypoint or when, and their limits."""
    middles, found = course.rates()
    for kind in dict.fromkeys(rate.title for rate in found):
        own, when = [rate for rate in found if rate.title == kind], "at" if course.moving else "to waypoint"
        limited = any(rate.limits(k) for rate in own for k in range(len(rate.names)))
        rows = [row if limited else row[:-1] for rate in own for row in _fastest(rate, middles, course.moving)]
        columns(console, [f"largest {kind}", ">", "", f"{when}>", "limits"][: 4 + limited], rows)


def _fastest(rate, middles, moving):
    """Cells of each column of a rate: name, largest value (what is at a limit, first), unit, when, limits."""
    one, unit = in_unit(rate.units[0], *np.abs(rate.values).ravel())
    size, rows = max(1.0, float(np.max(np.abs(rate.values))) / one), []
    for k, name in enumerate(rate.names):
        gaps = np.minimum(rate.upper[k] - rate.values[:, k], rate.values[:, k] - rate.lower[k])
        gap, near = float(np.min(gaps)), NEAR * rate.room(k)
        worst = int(np.argmin(gaps) if gap <= near else np.argmax(np.abs(rate.values[:, k])))
        at = f"{number(middles.t[worst], 3)} s" if moving else str(worst + 2)
        ends = [number(x / one) for x in (rate.lower[k], rate.upper[k])]
        allowed = f"{ends[0]} to {ends[1]} {unit}" if rate.limits(k) else ""
        allowed += ", passed" if gap < -near else ", reached" if gap <= near else ""
        largest = float(rate.values[worst, k]) / one
        at = at if abs(largest) > NOISE * size else ""
        rows.append([(name, "bold"), fixed(largest, size, 4), unit, at, allowed])
    return rows


def _idle(course, console):
    """How long each cable is slack."""
    names, none = course.result.question.robot.inputs, slack(course.result.question, course.u)
    _say_of_spans(course, console, "slack", [(names[k], none[:, k]) for k in range(len(names))])


def _tight(course, console):
    """Inputs at or past their limits, for how long; a slack cable is at none."""
    found, past = [], []
    for quantity in course.tensions():
        for k, name in enumerate(quantity.names):
            unit, room, pulls = quantity.units[k], NEAR * quantity.room(k), quantity.title == "tension"
            for limit, sign in ((quantity.lower[k], -1), (quantity.upper[k], 1)):
                excess = sign * (quantity.values[:, k] - limit)
                if not (pulls and sign < 0 and limit <= 0):  # of a cable: it is slack
                    found.append((f"{name} at {told(limit, unit)}", excess > -room))
                if np.max(excess) > room:
                    past.append(f"{name} past {told(limit, unit)} by {told(float(np.max(excess)), unit)}")
    if not _say_of_spans(course, console, "at limit", found) and not course.result.details.get("unreachable"):
        say(console, "at limit", "none")
    if past:
        say(console, "beyond limit", listed(past), "bold yellow")


def _say_of_spans(course, console, label, found):
    """Say of (what, mask [K]) for how long each mask is true; whether any is."""
    always = [what for what, mask in found if np.all(mask)]
    some = [(what, mask) for what, mask in found if np.any(mask) and not np.all(mask)]
    if course.moving:
        parts = [f"{what} for {_time(course, mask)}" for what, mask in some]
    else:
        parts = [f"{what} ({int(np.sum(mask))} of {len(mask)} waypoints)" for what, mask in some]
    parts = [f"{', '.join(always)} throughout"] * bool(always) + parts
    if parts:
        say(console, label, listed(parts))
    return bool(parts)


def _time(course, mask):
    """`0.24 s (12 %)`."""
    time = float(0.5 * np.sum(np.diff(course.t) * (mask[:-1].astype(float) + mask[1:])))
    return f"{number(time, 3)} s ({percent(time / (course.t[-1] - course.t[0]))})"


def _turns(result, console):
    """Where cables with friction turn, and where friction holds them."""
    turned, held = (result.details.get(key) for key in ("directions", "undecided"))
    if turned is None:
        return
    some = [name for name in turned if turned[name]]
    say(console, "turns", _at_waypoints(turned, "on the way to") if some else "none: every cable keeps its direction")
    if held:
        where = _at_waypoints(held, "at")
        say(console, "undecided", f"{where}: friction holds it there, its tension is between those of both directions")


def _at_waypoints(found, how):
    """`c0 on the way to waypoints 7, 9; c1 ...` of {name: waypoints}."""
    parts = [f"{name} {how} waypoint{'s' * (len(own) > 1)} {listed([str(k) for k in own])}"
             for name, own in found.items() if own]  # fmt: skip
    return "; ".join(parts)
