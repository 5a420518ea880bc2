"""A result in words: what came out, how far it can be trusted, and what to do when it failed."""

import textwrap

import numpy as np
from rich.text import Text

from socontrol.report import fits
from socontrol.report.columns import columns, line, say
from socontrol.report.units import fixed, miss, number, quiet, readable, with_unit

TITLES = {"statics": "statics", "inverse_statics": "inverse statics", "fit": "fit to measurements"}
BAR = 10  # characters


def render(result, console, verbose=0):
    """Print a result; `verbose` 1 adds lengths, energies, all frames and attempts, 2 the coordinates."""
    _headline(result, console)
    if result.details.get("fits"):
        fits.render(result, console, verbose)
        return
    q = result.arrays.get("q")
    if q is None or not np.all(np.isfinite(q)):
        _trust(result, console, verbose)
        return
    _unreachable(result, console)
    on_path = "path.q" in result.arrays
    if on_path:
        _path(result, console)
    _inputs(result, console, on_path)
    _frames(result, console, verbose, on_path)
    _joints(result, console)
    _goals(result, console, on_path)
    _trust(result, console, verbose)
    _prescribed(result, console)
    _sensitivities(result, console)
    if verbose:
        _more(result, console, verbose)


def _headline(result, console):
    tone = "bold green" if result.status.solved else "bold red"
    message = result.status.message
    if result.details.get("unreachable"):
        message = message.partition(". ")[0].rstrip(".") + "."  # the table below says the rest
    for k, part in enumerate(textwrap.wrap(f"{result.name}: {message}", console.width, break_long_words=False)):
        text = Text(part, style=tone)
        if k == 0 and part.startswith(f"{result.name}:"):
            text.stylize("default", 0, len(result.name) + 1)
        line(console, text)
    count, seconds = result.solver.get("iterations"), result.solver.get("seconds")
    facts = [TITLES.get(result.type, result.type)]
    facts += [f"{count} iteration{'s' * (count != 1)}"] if count is not None else []
    facts += [_seconds(seconds)] if seconds is not None else []
    line(console, Text(", ".join(facts), style="dim"))
    line(console, "")


def _seconds(t):
    return f"{t * 1e3:.3g} ms" if t < 1 else f"{t:.3g} s"


def _limits(result):
    """(lower [m], upper [m]) in SI: the question's; the robot knows none without it."""
    if result.question is None:
        return None
    return result.question.input_limits()


def _input_values(result):
    """[(name, SI value, unit)]."""
    return [
        (key.removeprefix("inputs."), v.value, v.unit) for key, v in result.values.items() if key.startswith("inputs.")
    ]


def _inputs(result, console, on_path):
    values = _input_values(result)
    if not values:
        return
    lower, upper = _limits(result) or ([-np.inf] * len(values), [np.inf] * len(values))
    path = np.asarray(result.arrays.get("path.u", ()))
    ranges = on_path and len(path)
    scales, rows = _scales(values, lower, upper), []
    for k, (name, value, unit) in enumerate(values):
        one, shown = readable(unit, scales[unit])
        low, high = (path[:, k].min(), path[:, k].max()) if ranges else (value, value)
        numbers = [fixed(x / one, scales[unit] / one) for x in ((low, high) if ranges else (value,))]
        rows.append(
            [
                (name, "bold"),
                *numbers,
                shown,
                _span(lower[k], upper[k], one, shown),
                _bar(console, low, high, lower[k], upper[k]),
            ]
        )
    columns(console, ["input", *(["from>", "to>"] if ranges else ["value>"]), "", "limits", ""], rows)


def _scales(rows, lower, upper):
    """Largest value or limit of all inputs of a unit, so that they read in one unit."""
    scales = {}
    for (_, value, unit), *ends in zip(rows, lower, upper, strict=True):
        finite = [abs(x) for x in (value, *ends) if np.isfinite(x)]
        scales[unit] = max(scales.get(unit, 0.0), *finite)
    return scales


def _span(lower, upper, one, unit):
    low, high = (number(x / one) for x in (lower, upper))
    if np.isfinite(lower) and np.isfinite(upper):
        return f"{low} to {high} {unit}"
    if np.isfinite(upper):
        return f"at most {high} {unit}"
    return f"at least {low} {unit}" if np.isfinite(lower) else "none"


def _bar(console, low, high, lower, upper):
    """Where the value (or its range) stands between its limits: a bar, and its share of the limit."""
    if not np.isfinite(upper - lower) or upper <= lower:
        return ""
    full, empty = ("#", ".") if console.options.ascii_only else ("\u2588", "\u2591")
    signed = lower < 0 < upper
    shares = [(x / upper if x >= 0 else -x / lower) if signed else (x - lower) / (upper - lower) for x in (low, high)]
    percent = " to ".join(dict.fromkeys(f"{100 * s:.0f}".replace("-0", "0") for s in shares))
    if signed:
        half = BAR // 2
        left, right = (int(round(half * max(0.0, s))) for s in (-shares[0], shares[1]))
        bar = empty * (half - left) + full * left + "|" + full * right + empty * (half - right)
    else:
        first, last = (int(round(BAR * float(np.clip(s, 0, 1)))) for s in shares)
        first = 0 if low == high else min(first, BAR - 1)
        last = last if low == high else max(last, first + 1)
        bar = empty * first + full * (last - first) + empty * (BAR - last)
    return f"{bar} {percent} %"


def _segments(result):
    return [key.removesuffix(".position") for key in result.values if key.endswith(".position")]


def _tips(result):
    """Segments that carry nothing; the last one when the question is not at hand."""
    names = _segments(result)
    if result.question is None:
        return names[-1:]
    carried = {segment.parent for segment in result.question.robot.description.segments.values()}
    return [name for name in names if name not in carried]


def _frames(result, console, verbose, on_path):
    told = {*_tips(result), *(g.on for g in (getattr(result.question, "goals", None) or {}).values())}
    names = [name for name in _segments(result) if verbose or name in told]
    if not names:
        return
    one, unit = readable("m", *(x for n in names for x in result[f"{n}.position"]))
    rows = []
    for name in names:
        position, rotation = result[f"{name}.position"], np.degrees(result[f"{name}.rotation"])
        rows.append(
            [
                (name, "bold"),
                *(fixed(x / one, 100.0, 6) for x in position),
                "  ".join(f"{fixed(x, 100.0):>7}" for x in rotation),
            ]
        )
    if on_path:
        whole = result.details.get("waypoints_solved") == result.details.get("waypoints")
        line(
            console,
            Text(
                "at the last waypoint" if whole else "nearest posture to the first waypoint out of reach",
                style="dim",
            ),
        )
    columns(console, ["end of", *(f"{a} [{unit}]>" for a in "xyz"), "rotation vector [deg]"], rows)


def _joints(result, console):
    """Coordinates of the joints, noise left out."""
    found = {k.removeprefix("coordinates."): v for k, v in result.values.items() if k.startswith("coordinates.")}
    if not found:
        return
    shown = _shown(found, 5)
    columns(console, ["joint", "value>", ""], [[(name, "bold"), *shown[name]] for name in found])


def _shown(values, digits=4):
    """{name: [number, unit]} of scalar Values; those of a unit share its reading, and noise beside the largest is 0."""
    shown = {}
    for unit in dict.fromkeys(v.unit for v in values.values()):
        names = [name for name, v in values.items() if v.unit == unit]
        numbers = quiet([values[name].value for name in names])
        one, name_of_unit = readable(unit, *numbers)
        shown |= {name: [number(x / one, digits), name_of_unit] for name, x in zip(names, numbers, strict=True)}
    return shown


def _goals(result, console, on_path):
    if on_path:
        return
    found = {}
    for key, value in result.residuals.items():
        if key.startswith("goals."):
            found.setdefault(key.split(".")[1], []).append(miss(value.value, value.unit))
    for name, parts in found.items():
        say(console, "goal", f"{name}: miss {' and '.join(parts)}")


def _trust(result, console, verbose):
    """What was looked at again: force, stability, limits, discretisation, attempts."""
    details, residuals = result.details, result.residuals
    if "force" in residuals:
        own = residuals.get("solver_force")
        text = f"recomputed, unbalanced {residuals['force'].value:.1e} of the largest force"
        say(
            console,
            "forces",
            text + (f" (solver's own {own.value:.1e})" if own is not None and verbose else ""),
        )
    if "stability" in details:
        say(console, "stability", details["stability"], "" if details.get("stable", True) else "bold yellow")
    if details.get("limits") and not details.get("unreachable"):
        past = [limit for limit in details["limits"] if limit.get("beyond", 0) > 0]
        for label, rows in (("at limit", [x for x in details["limits"] if x not in past]), ("beyond limit", past)):
            if rows:
                style = "bold yellow" if label == "beyond limit" else ""
                say(console, label, "; ".join(_limit(result, row) for row in rows), style)
    elif details.get("limits") == []:
        say(console, "at limit", "none")
    if "discretisation" in details:
        _discretisation(result, console)
    attempts = details.get("attempts", ())
    if len(attempts) > 1:
        _attempts(result, console, attempts, verbose)
    if any(label in details for label in ("stability", "limits", "discretisation")) or "force" in residuals:
        line(console, "")


def _limit(result, limit):
    unit = _unit_of(result, limit)
    beyond = limit.get("beyond", 0)
    past = f" by {with_unit(beyond, unit)}" if beyond > 0 else ""
    return f"{limit['name']} {limit['side']}, {with_unit(limit['limit'], unit)}{past}"


def _unit_of(result, limit):
    if limit["kind"] == "input":
        return next((unit for name, _, unit in _input_values(result) if name == limit["name"]), "1")
    return "1" if result.question is None else result.question.robot.coordinate_units[limit["index"]]


def _discretisation(result, console):
    changes = result.details["discretisation"]
    if changes is None:
        say(
            console,
            "sections",
            "with twice the sections no equilibrium was found: the discretisation error is unknown",
            "bold yellow",
        )
    elif changes:
        tips = [name for name in _tips(result) if name in changes] or list(changes)
        moved = ", ".join(f"{name} by {miss(changes[name], 'm')}" for name in tips)
        say(console, "sections", f"twice as many would move {moved}")


def _field(attempt, key):
    return attempt[key] if isinstance(attempt, dict) else getattr(attempt, key)


def _attempts(result, console, attempts, verbose):
    solved = sum(_field(a, "outcome") == "solved" for a in attempts)
    last = attempts[-1]
    text = f"{len(attempts)}, of which {solved} solved their step"
    say(
        console,
        "attempts",
        text + (f"; the last: {_field(last, 'start')}" if "path.q" not in result.arrays else ""),
    )
    if verbose:
        rows = [
            [
                _field(a, "start"),
                _field(a, "outcome"),
                str(_field(a, "iterations")),
                _seconds(_field(a, "seconds")),
            ]
            for a in attempts
        ]
        line(console, "")
        columns(console, ["attempt", "outcome", "iterations>", "time>"], rows)


def _unreachable(result, console):
    """What each limit the nearest posture stands on would have to be alone."""
    rows = result.details.get("unreachable")
    if rows:
        columns(
            console,
            ["active limit", "side", "stands at>", "alone it would have to be"],
            [
                [
                    (row["name"], "bold"),
                    row["side"],
                    with_unit(row["limit"], row["unit"]),
                    "not by this limit alone" if row["needed"] is None else with_unit(row["needed"], row["unit"]),
                ]
                for row in rows
            ],
        )


def _path(result, console):
    arrays, details = result.arrays, result.details
    solved, count = (
        details.get("waypoints_solved", len(arrays["path.q"])),
        details.get("waypoints", len(arrays["path.q"])),
    )
    say(console, "path", f"{solved} of {count} waypoints solved")
    if len(arrays["path.miss"]):
        worst = int(np.argmax(arrays["path.miss"]))
        say(console, "worst miss", f"{miss(float(arrays['path.miss'][worst]), 'm')} at waypoint {worst + 1}")
        say(console, "worst force", f"{result.residuals['force'].value:.1e} of the largest force, recomputed")
    line(console, "")


def _prescribed(result, console):
    holding = {k.removeprefix("holding."): v for k, v in result.values.items() if k.startswith("holding.")}
    if not holding:
        return
    rows = [
        [(name, "bold"), " ".join((x, "(SI, strain's conjugate)" if unit == "conjugate" else unit)).rstrip()]
        for name, (x, unit) in _shown(holding).items()
    ]
    columns(console, ["held coordinate", "holding force"], rows)


def _sensitivities(result, console):
    found = result.details.get("sensitivities")
    if not found:
        return
    if isinstance(found, str):
        say(console, "sensitivity", found)
        return
    by_parameter = {}
    for key, v in found.items():
        name, _, parameter = key.partition("/")
        by_parameter.setdefault(parameter, []).append((name, np.ravel(v.value), v.unit))
    for parameter, entries in by_parameter.items():
        rows = []
        for name, values, unit in entries:
            one, shown = readable(unit)
            rows.append([(name, "bold"), *(number(x / one) for x in quiet(values)), shown])
        line(console, Text(f"change of the inputs with {parameter}", style="dim"))
        parts = _components(result, parameter, len(entries[0][1]))
        columns(console, ["input", *(f"{c}>" for c in parts), ""], rows)


def _components(result, parameter, count):
    """Names of a parameter's numbers."""
    goal = (getattr(result.question, "goals", None) or {}).get(parameter.removeprefix("target."))
    rows = getattr(goal, "rows", range(3))
    return ["xyz"[i] for i in rows] if len(rows) == count else [str(i + 1) for i in range(count)]


def _more(result, console, verbose):
    lengths = {k.removeprefix("lengths."): v for k, v in result.values.items() if k.startswith("lengths.")}
    if lengths:
        shown, counts = _shown(lengths, 6), _line_counts(result)
        rows = [
            [(name, "bold"), *shown[name], f"sum of {counts[name]} lines" if counts.get(name, 1) > 1 else ""]
            for name in lengths
        ]
        columns(console, ["line or joint", "length>", "", ""], rows)
    energies = {k.removeprefix("energy."): v for k, v in result.values.items() if k.startswith("energy.")}
    if energies:
        rows = _shown(energies).items()
        say(console, "energy", ", ".join(f"{k} {x} {unit}" for k, (x, unit) in rows))
        line(console, "")
    if verbose > 1 and result.question is not None:
        robot = result.question.robot
        rows = [
            [(name, "bold"), f"{x:.6g}", unit if unit != "1" else ""]
            for name, unit, x in zip(robot.coordinates, robot.coordinate_units, _quiet_by(robot, result), strict=True)
        ]
        if rows:
            columns(console, ["coordinate", "value>", "unit"], rows)


def _quiet_by(robot, result):
    """Coordinates without what is noise beside the largest of their unit."""
    q, units = np.array(result.arrays["q"], dtype=float), np.array(robot.coordinate_units)
    for unit in set(robot.coordinate_units):
        q[units == unit] = quiet(q[units == unit])
    return q


def _line_counts(result):
    """{input: number of its lines}: several chambers share a pressure."""
    if result.question is None:
        return {}
    actuators = result.question.robot.description.actuators or {}
    return {name: len(actuator.offsets()) for name, actuator in actuators.items() if hasattr(actuator, "offsets")}
