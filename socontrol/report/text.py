"""A result in words: what came out, how far it can be trusted, and what to do when it failed."""

import numpy as np
from rich.text import Text

from socontrol.quantities import joined
from socontrol.report import (
    branch_text,
    ellipsoid_text,
    fits,
    motion_text,
    plan_text,
    tension_motion_text,
    tension_text,
)
from socontrol.report.columns import columns, line, say
from socontrol.report.inputs_text import input_values, inputs_table
from socontrol.report.loop_text import loops
from socontrol.report.said import attempts, discretisation, headline, in_units, names_cables, segments_of, tips_of
from socontrol.report.tension_course import kind_of, lines
from socontrol.report.tension_table import cables, slack_names, tells, tight_limits
from socontrol.report.units import fixed, miss, number, quiet, readable, with_unit

NOT_FOUND = "no way found by this limit alone"
TOGETHER = "Together they would do: "  # of a message about what is out of reach
MOVING = {"simulation": motion_text.render, "trajectory": plan_text.render, "continuation": branch_text.render}


def render(result, console, verbose=0):
    """Print a result; `verbose` 1 adds lengths, energies, all frames and attempts, 2 the coordinates."""
    if result.type in MOVING:
        MOVING[result.type](result, console, verbose)
        return
    if kind_of(result) == "motion":
        tension_motion_text.render(result, console, verbose)
        return
    headline(result, console)
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
    inputs_table(result, console, on_path, () if on_path else slack_names(result))
    told = set() if on_path else cables(result, console)
    (tension_text.of_path if on_path else tension_text.compliance)(result, console)
    _frames(result, console, verbose, on_path)
    _joints(result, console)
    _displaced(result, console)
    ellipsoid_text.table(result, console)
    _goals(result, console, on_path)
    _trust(result, console, verbose)
    _prescribed(result, console)
    loops(result, console)
    _sensitivities(result, console)
    if verbose:
        _more(result, console, verbose, told)


def _frames(result, console, verbose, on_path):
    told = {*tips_of(result), *(g.on for g in (getattr(result.question, "goals", None) or {}).values())}
    names = [name for name in segments_of(result) if verbose or name in told]
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
        reached = "at the last waypoint solved" if result.details.get("too_fast") else "at the last waypoint"
        missed = "nearest posture to the first waypoint out of reach"
        line(console, Text(reached if whole or result.details.get("too_fast") else missed, style="dim"))
    columns(console, ["end of", *(f"{a} [{unit}]>" for a in "xyz"), "rotation vector [deg]"], rows)


def _joints(result, console):
    """Coordinates of the joints, noise left out."""
    found = {k.removeprefix("coordinates."): v for k, v in result.values.items() if k.startswith("coordinates.")}
    if not found:
        return
    shown = in_units(found, 5)
    columns(console, ["joint", "value>", ""], [[(name, "bold"), *shown[name]] for name in found])


def _displaced(result, console):
    """Where forward statics has taken a point farthest."""
    where = result.details.get("largest_displacement")
    if where is None:
        return
    at = f"the end of {where['segment']}" if where["at"] == 1 else f"{where['segment']} at X = {where['at']:.4g}"
    far = miss(result["largest_displacement"], "m")
    say(console, "moved", f"at most {far}, {at}, from where rods are straight and joints at 0")
    line(console, "")


def _goals(result, console, on_path):
    if on_path:
        return
    found = {}
    for key, value in result.residuals.items():
        if key.startswith("goals."):
            found.setdefault(key.split(".")[1], []).append(miss(value.value, value.unit))
    asked = getattr(result.question, "goals", None) or {}
    for name, parts in found.items():
        weighted = getattr(asked.get(name), "weight", None) is not None
        label = f"{name} (weighted): left" if weighted else f"{name}: miss"
        say(console, "goal", f"{label} {' and '.join(parts)}")


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
    if "limits" in details and not (tells(result) and "path.q" in result.arrays):
        _limits(result, console)
    if "discretisation" in details:
        discretisation(result, console, "equilibrium")
    attempts(result, console, verbose)
    if any(label in details for label in ("stability", "limits", "discretisation")) or "force" in residuals:
        line(console, "")


def _limits(result, console):
    """What stands on a limit or past one; of what is out of reach, the message or a table says it."""
    limits = tight_limits(result)
    if result.details.get("unreachable"):
        return
    if limits:
        past = [limit for limit in limits if limit.get("beyond", 0) > 0]
        for label, rows in (("at limit", [x for x in limits if x not in past]), ("beyond limit", past)):
            if rows:
                style = "bold yellow" if label == "beyond limit" else ""
                say(console, label, "; ".join(_limit(result, row) for row in rows), style)
    else:
        say(console, "at limit", "none")


def _limit(result, limit):
    unit = _unit_of(result, limit)
    beyond = limit.get("beyond", 0)
    past = f" by {with_unit(beyond, unit)}" if beyond > 0 else ""
    return f"{limit['name']} {limit['side']}, {with_unit(limit['limit'], unit)}{past}"


def _unit_of(result, limit):
    if limit["kind"] == "input":
        return next((unit for name, _, unit in input_values(result) if name == limit["name"]), "1")
    return "1" if result.question is None else result.question.robot.coordinate_units[limit["index"]]


def _unreachable(result, console):
    """What each limit the nearest posture stands on would have to be alone; the headline says it where cables are."""
    rows = result.details.get("unreachable")
    if rows and not names_cables(result):
        columns(
            console,
            ["limit", "side", "stands at>", "alone it would have to be"],
            [
                [
                    (row["name"], "bold"),
                    row["side"],
                    with_unit(row["limit"], row["unit"]),
                    NOT_FOUND if row["needed"] is None else with_unit(row["needed"], row["unit"]),
                ]
                for row in rows
            ],
        )
        more = result.status.message.partition(TOGETHER)[2]
        if more:
            say(console, "together", more.removesuffix("."))
            line(console, "")


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
        [(name, "bold"), " ".join((x, "(SI, strain's conjugate)" if unit == "conjugate" else unit)).rstrip(),
         _beside(result, name, holding[name].unit)]
        for name, (x, unit) in in_units(holding).items()
    ]  # fmt: skip
    columns(console, ["held coordinate", "held by", ""], rows)


def _beside(result, coordinate, unit):
    """`torque, beside the 0 of motor`: what holds a coordinate, and what an input gives it anyway."""
    word = {"N m": "torque", "N": "force"}.get(unit, "")
    inputs = {name: value for name, value, _ in input_values(result)}
    driving = [] if result.question is None else [
        f"the {with_unit(inputs[name], unit)} of {name}"
        for name, actuator in zip(result.question.robot.inputs, result.question.robot.input_actuators, strict=True)
        if getattr(actuator, "joint", None) == coordinate and name in inputs
    ]  # fmt: skip
    return f"{word}, beside {joined(driving, 'and')}" if driving else word


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


def _more(result, console, verbose, told):
    lengths = {k.removeprefix("lengths."): v for k, v in result.values.items() if k.startswith("lengths.")}
    lengths = {name: v for name, v in lengths.items() if name not in told and _has_length(result, name)}
    if lengths:
        shown, counts = in_units(lengths, 6), _line_counts(result)
        rows = [
            [(name, "bold"), *shown[name], f"sum of {counts[name]} lines" if counts.get(name, 1) > 1 else ""]
            for name in lengths
        ]
        columns(console, ["line or joint", "length>", "", ""], rows)
    energies = {k.removeprefix("energy."): v for k, v in result.values.items() if k.startswith("energy.")}
    if energies:
        rows = in_units(energies).items()
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


def _has_length(result, name):
    """Whether an input is a line or a joint; what an internal moment turns is no length."""
    if result.question is None or name not in result.question.robot.inputs:
        return True
    actuator = result.question.robot.input_actuators[result.question.robot.inputs.index(name)]
    return hasattr(actuator, "joint") or result.question.robot.inputs.index(name) in lines(result.question.robot)


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
