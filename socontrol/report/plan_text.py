"""A plan in words: what it takes and where it ends, limits it stands on, what a re-simulation says of it."""

import numpy as np
from rich.text import Text

from socontrol.programs.plans.plan_answer import PENETRATION
from socontrol.report.columns import columns, line, say
from socontrol.report.inputs_text import ranges_table
from socontrol.report.plan_limits import NEAR, at_limits, in_unit, quantities, told
from socontrol.report.said import attempts, counted, duration, headline, segments_of, tips_of
from socontrol.report.units import fixed, miss, number, percent, readable, with_unit

MOST_NAMED = 6  # limits named in a sentence
MOST_LOOSENED = 8  # rows of what to loosen
UNFINISHED = ("infeasible", "limit", "numerical")
BRIEF = 0.02  # of the time: what starts or ends at 0, or passes through it, does not stand on a limit of 0


def render(result, console, verbose=0):
    """Print a plan; `verbose` 1 adds the ends of all segments, ranges and attempts, 2 the coordinates at the end."""
    headline(result, console, _facts(result))
    _why_not(result, console)
    arrays = result.arrays
    if result.question is None or not len(arrays.get("t", ())) or not np.all(np.isfinite(arrays.get("q", np.nan))):
        return
    if result.status.outcome in UNFINISHED:
        say(console, "below", "where the solver stood when it stopped, not a motion to run", "bold yellow")
    _costs(result, console)
    _ends(result, console, verbose)
    _joints(result, console)
    _inputs(result, console)
    _obstacles(result, console)
    _speeds(result, console)
    _goals(result, console)
    _limits(result, console)
    _trust(result, console)
    attempts(result, console, verbose)
    line(console, "")
    if verbose:
        _ranges(result, console)
    if verbose > 1:
        _coordinates(result, console)


def _facts(result):
    details, solver = result.details, result.solver
    facts = ["trajectory"]
    if getattr(result.question, "quasi_static", False):
        facts.append("quasi-static")
    facts += [str(details["scheme"]).replace("_", "-")] if "scheme" in details else []
    if "mesh.intervals" in result.values:
        facts.append(counted(int(result["mesh.intervals"]), "interval"))
    facts += [counted(solver["iterations"], "iteration")] if solver.get("iterations") is not None else []
    return facts + ([duration(solver["seconds"])] if solver.get("seconds") is not None else [])


def _why_not(result, console):
    """The constraints missed most, and what to loosen, best first."""
    worst, loosen = result.details.get("worst"), result.details.get("loosen")
    if worst and not result.status.solved:
        rows = [[(str(w["quantity"]), "bold"), str(w.get("node", "")), _time(w), _amount(w["excess"], w["unit"])]
                for w in worst]  # fmt: skip
        columns(console, ["missed most", "node>", "at>", "by>"], rows)
    if loosen:
        rows = [[(f"{k + 1}  {w['quantity']}", "bold"), _amount(w["by"], w["unit"]), percent(w["share"])]
                for k, w in enumerate(loosen[:MOST_LOOSENED])]  # fmt: skip
        columns(console, ["loosen, first of all", "by>", "of its size>"], rows)


def _amount(x, unit):
    return number(x, 3) if unit == "1" else told(x, unit, 3)


def _time(row):
    return "" if row.get("time") is None else f"{number(row['time'], 3)} s"


def _costs(result, console):
    if "duration" in result.values:
        say(console, "duration", f"{number(result['duration'], 5)} s")
    parts = {k.removeprefix("cost."): v.value for k, v in result.values.items() if k.startswith("cost.")}
    if "cost" in result.values:
        shares = ", ".join(f"{name} {number(x)}" for name, x in parts.items())
        say(console, "cost", f"{number(result['cost'])}{f': {shares}' if shares else ''}")
    line(console, "")


def _ends(result, console, verbose):
    """Where the ends stand at the end, and how far from where they began."""
    names = segments_of(result) if verbose else tips_of(result)
    if not names:
        return
    moved = {n: float(np.linalg.norm(np.diff(result.arrays[f"{n}.position"][[0, -1]], axis=0))) for n in names}
    one, unit = readable("m", *moved.values(), *(x for n in names for x in result[f"{n}.position"]))
    rows = []
    for name in names:
        turned = "  ".join(f"{fixed(x, 100.0, 4):>6}" for x in np.degrees(result[f"{name}.rotation"]))
        lengths = [fixed(x / one, 100.0) for x in (*result[f"{name}.position"], moved[name])]
        rows.append([(name, "bold"), *lengths, turned])
    line(console, Text(f"at {number(result.arrays['t'][-1])} s; moved: the straight way from the start", style="dim"))
    heads = ["end of", *(f"{a} [{unit}]>" for a in "xyz"), f"moved [{unit}]>", "rotation vector [deg]"]
    columns(console, heads, rows)


def _joints(result, console):
    """Coordinates of the joints at the end, and over which range they went."""
    found = [k.removeprefix("coordinates.") for k in result.values if k.startswith("coordinates.")]
    every = quantities(result)[0]
    if found:
        columns(console, ["joint", "at the end>", "least>", "most>", "", "limits"],
                [_ranged(every, every.names.index(name), end=True) for name in found])  # fmt: skip


def _ranged(quantity, k, end=False):
    """Cells: name, with `end` the last value, the range, their unit, limits."""
    values, unit = quantity.values[:, k], quantity.units[k]
    low, high = float(values.min()), float(values.max())
    one, name = in_unit(unit, low, high, *quantity.limits(k))
    size = max(abs(x) for x in (low, high, *quantity.limits(k), one)) / one
    shown = [fixed(x / one, size) for x in ((values[-1], low, high) if end else (low, high))]
    ends = [number(x / one) if np.isfinite(x) else "none" for x in (quantity.lower[k], quantity.upper[k])]
    limits = f"{ends[0]} to {ends[1]} {name}" if quantity.limits(k) else ""
    return [(quantity.names[k], "bold"), *shown, name, limits]


def _inputs(result, console):
    """The range of each input within its limits."""
    ranges_table(result, console, result.arrays.get("u", ()))


def _obstacles(result, console):
    """The least clearance of each obstacle, when, and what was asked for."""
    rows, t = [], result.arrays["t"]
    for x in (x for x in quantities(result) if x.title == "clearance"):
        for k, name in enumerate(x.names):
            least, asked = int(np.argmin(x.values[:, k])), x.lower[k]
            value = float(x.values[least, k])
            near = max(NEAR * x.room(k), PENETRATION * result.question.loaded.length)
            state = "too close" if value < asked - near else "on its clearance" if value < asked + near else ""
            shown = f"{'-' * (value < 0)}{miss(abs(value), 'm')}"
            rows.append([(name, "bold"), shown, told(asked, "m"), f"{number(t[least], 3)} s",
                         (state, "bold yellow" if state == "too close" else "")])  # fmt: skip
    if rows:
        columns(console, ["obstacle", "least clearance>", "asked for>", "at>", ""], rows)


def _speeds(result, console):
    asked = result.question.limits.speeds or {}
    for key, v in result.values.items():
        if key.startswith("speed."):
            name = key.removeprefix("speed.")
            of = f", at most {with_unit(float(asked[name].largest), 'm/s')} allowed" if name in asked else ""
            say(console, "speed", f"{name}: up to {with_unit(v.value, v.unit)}{of}")


def _goals(result, console):
    found = {}
    for key, v in result.residuals.items():
        if key.startswith("goals."):
            name = key.removeprefix("goals.").removesuffix(f".{v.unit}")
            found.setdefault(name, []).append(miss(v.value, v.unit))
    for name, parts in found.items():
        say(console, "goal", f"{name}: miss {' and '.join(parts)}")


def _limits(result, console):
    """What stands on a limit and for how long; what passes one between the points; inputs that stay 0."""
    kept = [x for x in quantities(result) if x.title != "clearance"]
    idle = [x.names[k] for x in kept if x.title == "input" for k in range(len(x.names)) if not np.any(x.values[:, k])]
    rows = [row for x in kept for row in at_limits(x, result.arrays["t"]) if x.names[row.k] not in idle]
    past = [row for row in rows if row.beyond > 0]
    on = [row for row in rows if not row.beyond and (row.limit or row.share > BRIEF)]
    on.sort(key=lambda row: -row.share)
    if past:
        by = _named(past, lambda row: f"by {told(row.beyond, row.quantity.units[row.k])}")
        where = "" if result.status.outcome in UNFINISHED else "between the points: "
        say(console, "beyond limit", where + by, "bold yellow")
    if on:
        say(console, "at limit", _named(on, lambda row: f"{percent(row.share)} of the time"))
    elif not past and any(x.limits(k) for x in kept for k in range(len(x.names))):
        say(console, "at limit", "none")
    if idle:
        say(console, "idle inputs", ", ".join(idle[:MOST_NAMED]) + _more(len(idle), ", "))


def _named(rows, why):
    """`input p1, upper: 140 kPa (31 % of the time); ... and 3 more`."""
    parts = []
    for row in rows[:MOST_NAMED]:
        name, unit = row.quantity.names[row.k], row.quantity.units[row.k]
        parts.append(f"{row.quantity.title} {name}, {row.side}: {told(row.limit, unit)} ({why(row)})")
    return "; ".join(parts) + _more(len(rows), "; ")


def _more(count, join):
    return f"{join}and {count - MOST_NAMED} more" if count > MOST_NAMED else ""


def _trust(result, console):
    """What the re-simulation says, the equation of motion between the points, and intervals that would do."""
    values, residuals = result.values, result.residuals
    replay = result.question.replay
    if "replay.tip" in values:
        share = result["replay.tip_share"]
        text = f"tip within {miss(result['replay.tip'], 'm')} ({percent(share)} of the length)"
        if "replay.coordinates" in values:
            text += f", coordinates within {percent(result['replay.coordinates'])} of their range"
        say(console, "re-simulated", text, "bold yellow" if share > replay.tolerance else "")
    elif result.question.quasi_static:
        say(console, "re-simulated", "not: equilibria without masses, to be run slowly")
    elif not replay.active:
        say(console, "re-simulated", "not asked for")
    elif result.status.outcome in ("solved", "rejected"):
        say(console, "re-simulated", "no: the simulation under the planned inputs failed", "bold yellow")
    places = [(residuals.get("equation"), "at the points"), (values.get("error.between"), "between them")]
    known = [f"{number(v.value, 2)} {where}" for v, where in places if v is not None]
    if known:
        say(console, "equation", f"of motion, relative residual: {', '.join(known)}")
    _mesh(result, console, replay.tolerance)


def _mesh(result, console, tolerance):
    values = result.values
    halved = result.details.get("halved")
    if halved is not None:
        change = halved["cost_change"]
        share = None if change is None else percent(change / max(abs(result["cost"]), 1e-300))
        known = f"change the cost by {share}" if share else "do not lead to a plan: what the mesh costs is unknown"
        say(console, "cost", f"half the intervals, {halved['intervals']}, {known}")
    if "mesh.needed" not in values or not np.isfinite(result["mesh.needed"]):
        return
    have, need = int(result["mesh.intervals"]), int(result["mesh.needed"])
    goal = f"the re-simulated tip within {percent(tolerance)} of the length"
    if need > have:
        say(console, "mesh", f"{counted(have, 'interval')}; about {need} would bring {goal}", "bold yellow")
    else:
        say(console, "mesh", f"{counted(have, 'interval')}; about {need} would do for {goal}")


def _ranges(result, console):
    """Ranges of rates, input rates and lengths of lines; those of strains are left out."""
    for quantity in quantities(result):
        if quantity.title in ("rate", "input rate", "length"):
            rows = [_ranged(quantity, k) for k, unit in enumerate(quantity.units) if not unit.startswith("1/")]
            if rows:
                columns(console, [quantity.title, "least>", "most>", "", "limits"], rows)


def _coordinates(result, console):
    robot, q = result.question.robot, result.arrays["q"][-1]
    rows = [[(name, "bold"), f"{x:.6g}", unit if unit != "1" else ""]
            for name, unit, x in zip(robot.coordinates, robot.coordinate_units, q, strict=True)]  # fmt: skip
    columns(console, ["coordinate at the end", "value>", "unit"], rows)
