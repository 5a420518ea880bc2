"""A motion in words: how far it came, where its ends stand, where the energy went, and what is left unexplained."""

import numpy as np
from rich.text import Text

from socontrol.programs.result import Value
from socontrol.quantities import joined
from socontrol.report.columns import columns, line, say
from socontrol.report.loop_text import loops
from socontrol.report.said import counted, discretisation, duration, headline, in_units, segments_of, tips_of
from socontrol.report.tension_text import of_simulation
from socontrol.report.units import fixed, number, readable, with_unit

KINDS = ("kinetic", "elastic", "gravitational")
WORKS = {  # column of arrays["work"]: what did it
    "inputs": "inputs",
    "loads": "loads",
    "damping": "damping",
    "water": "water",
    "motors": "driven joints",
}
NOISE = 1e-9  # of the largest energy: less is rounding
ROUNDING = 1e-14  # of a sum
UNEXPLAINED = 1e-4  # of the energy that moved: more is worth a look


def render(result, console, verbose=0):
    """Print a motion; `verbose` 1 adds the ends of all segments, 2 the coordinates at the end."""
    headline(result, console, _facts(result))
    t = result.arrays.get("t")
    if t is None or not len(t):
        return
    if t[-1] < result.details.get("stop", t[-1]) * (1 - 1e-9):
        share = 100 * t[-1] / result.details["stop"]
        say(console, "reached", f"{number(t[-1])} s of {number(result.details['stop'])} s ({number(share, 3)} %); "
            "below is where it stood then", "bold yellow")  # fmt: skip
        line(console, "")
    _ends(result, console, verbose)
    _joints(result, console)
    of_simulation(result, console)
    _energies(result, console)
    what_loops_bear(result, console)
    _trust(result, console)
    if verbose > 1 and result.question is not None:
        _coordinates(result, console)


def _facts(result):
    solver, details = result.solver, result.details
    facts = ["simulation", *([details["integrator"]] if "integrator" in details else [])]
    if "steps" in solver:
        refused = f" ({solver['refused']} refused)" if solver.get("refused") else ""
        facts.append(counted(solver["steps"], "step") + refused)
    if "reached" in details and solver.get("seconds") is not None:
        facts.append(f"{number(details['reached'])} s simulated in {duration(solver['seconds'])}")
    return facts


def _ends(result, console, verbose):
    """Where the ends stand at the last time, and how far from where they began."""
    names = segments_of(result) if verbose else tips_of(result)
    if not names:
        return
    moved = {name: np.array(result[f"{name}.displacement"]) for name in names}
    one, unit = readable("m", *(x for n in names for x in (*result[f"{n}.position"], *moved[n])))
    size, rows = max(np.max(np.abs([*moved.values(), *(result[f"{n}.position"] for n in names)])) / one, 1.0), []
    for name in names:
        turned = np.degrees(result[f"{name}.rotation"])
        cells = [fixed(x / one, size) for x in (*result[f"{name}.position"], np.linalg.norm(moved[name]))]
        rows.append([(name, "bold"), *cells, "  ".join(f"{fixed(x, 100.0, 4):>6}" for x in turned)])
    heads = ["end of", *(f"{a} [{unit}]>" for a in "xyz"), f"moved [{unit}]>", "rotation vector [deg]"]
    line(console, Text(f"at {number(result.arrays['t'][-1])} s; moved: the straight way from the start", style="dim"))
    columns(console, heads, rows)


def _driven(result):
    question = result.question
    return {question.robot.coordinates[i] for i in question.driven} if question is not None else set()


def _joints(result, console):
    """Coordinates of the joints at the end, and over which range they went."""
    found = {k.removeprefix("coordinates."): v for k, v in result.values.items() if k.startswith("coordinates.")}
    if not found:
        return
    driven, histories = _driven(result), _quiet_histories(result, found)
    shown = in_units({name: Value(histories[name][-1], v.unit) for name, v in found.items()}, 5)
    rows = [[(name, "bold"), *shown[name], _range(histories[name], v.unit), "driven" * (name in driven)]
            for name, v in found.items()]  # fmt: skip
    columns(console, ["joint", "at the end>", "", "range", ""], rows)


def _quiet_histories(result, found):
    """{name: values [k]} of coordinates, 0 where they are noise beside the largest of their unit."""
    if result.question is None:
        return {name: np.array([v.value]) for name, v in found.items()}
    names = result.question.robot.coordinates
    histories = {name: result.arrays["q"][:, names.index(name)] for name in found}
    for unit in {v.unit for v in found.values()}:
        largest = max(float(np.max(np.abs(histories[name]))) for name, v in found.items() if v.unit == unit)
        for name in (name for name, v in found.items() if v.unit == unit):
            histories[name] = np.where(np.abs(histories[name]) < NOISE * largest, 0.0, histories[name])
    return histories


def _range(values, unit):
    """`-20 to 45 deg`."""
    low, high = float(values.min()), float(values.max())
    one, shown = readable(unit, low, high)
    if high > low:
        return f"{number(low / one)} to {number(high / one)} {shown}"
    return "at rest" if len(values) > 1 else ""


def _energies(result, console):
    """Two columns of facts: what the robot holds, and who gave or took it; rows of noise are left out."""
    energy, work = result.arrays["energy"], result.arrays["work"]
    largest = max(float(np.max(np.ptp(energy, axis=0))), float(np.max(energy[:, 0])), float(np.max(np.abs(work))))
    if not largest > 0:
        say(console, "energy", "nothing moves")
        return
    one, unit = readable("J", largest)
    rows = []
    for k, name in enumerate(KINDS):
        e = energy[:, k] - (energy[0, k] if name == "gravitational" else 0.0)
        if np.max(np.abs(e)) > NOISE * largest:
            cells = [fixed(x / one, largest / one, 4) for x in (e[0], e[-1], e.max())]
            rows.append([(name, "bold"), *cells])
    columns(console, [f"energy [{unit}]", "at the start>", "at the end>", "largest>"], rows)
    rows = [
        [(label, "bold"), fixed(work[-1, k] / one, largest / one, 4)]
        for k, label in enumerate(WORKS.values())
        if np.max(np.abs(work[:, k])) > NOISE * largest
    ]
    if rows:
        columns(console, ["work of", f"done [{unit}]>"], rows)


def _trust(result, console):
    """How much of the energy and of the momentum is explained by what acted."""
    drift, left = result.values.get("energy.drift"), result.residuals.get("energy")
    if drift is not None and np.any(result.arrays["energy"]):
        text = f"{_share(drift.value)} of the largest kinetic energy unexplained by work"
        if left is not None:
            text += f" ({_share(left.value)} of the energy that moved)"
        say(console, "energy", text, "bold yellow" if left is not None and left.value > UNEXPLAINED else "")
    if _floats(result):
        _momentum(result, console)
    driven = _driven(result)
    if driven:
        names = sorted(driven)
        some = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
        say(console, "driven", f"{some}: moved as given, by motors whose work is counted{_motors(result, names)}")
    if "discretisation" in result.details:
        discretisation(result, console, "motion")
    line(console, "")


def what_loops_bear(result, console):
    """What loops bear at the end, how far they drifted, how they were closed, and where forces have no bound."""
    if "loops" not in result.residuals:
        return
    loops(result, console)
    rate = result.residuals["loops.rate"].value
    say(console, "", f"At all outputs their ends part by {rate:.1e} m/s or rad/s at the most.")
    moved = result.details.get("start") or {}
    if moved:
        say(console, "start", f"loops closed by moving {_moved(result, moved)}")
    times = result.details.get("singular") or []
    if times:
        some = ", ".join(number(t) for t in times[:5]) + (f" and {len(times) - 5} more" if len(times) > 5 else "")
        say(console, "dead points", f"at {some} s: there rows of loops depend on each other, and the forces of loops "
            "can grow without bound", "bold yellow")  # fmt: skip


def _moved(result, moved):
    """`coupler by -11.2 deg and rocker by 67.9 deg`; strains of rods by rod, and what that takes."""
    robot, told, rods = result.question.robot, [], {}
    units = dict(zip(robot.coordinates, robot.coordinate_units, strict=True))
    for name, change in moved.items():
        rod = next((s for s in robot.segments if name.startswith(f"{s}.") and units[name] in ("1/m", "1")), None)
        if rod is None:
            told.append(f"{name} by {with_unit(change, units[name], 3)}")
        else:
            rods.setdefault(rod, {}).setdefault(units[name], []).append(abs(change))
    for rod, own in rods.items():
        sizes = {unit: max(changes) for unit, changes in own.items()}
        most = [f"{100 * x:.3g} %" if unit == "1" else with_unit(x, unit, 3) for unit, x in sizes.items()]
        told.append(f"{counted(sum(map(len, own.values())), 'strain')} of {rod} (up to {joined(most, 'and')})")
    if not rods or "energy" not in result.arrays:
        return joined(told, "and")
    held = with_unit(float(result.arrays["energy"][0, 1]), "J", 3)
    return f"{joined(told, 'and')}: rods and springs begin with {held}; `start: {{settled: true}}` begins at rest"


def _motors(result, names):
    """`; crank asks for -5.5 N m at the end, 6.4 N m at the most` of joints that are driven, three at the most."""
    units, told = {"rad": "N m", "m": "N"}, []
    robot = result.question.robot
    for name in names[:3]:
        unit, force = units.get(robot.coordinate_units[robot.coordinates.index(name)]), f"holding.{name}"
        if unit and force in result.arrays:
            most = float(np.max(np.abs(result.arrays[force])))
            told.append(f"{name} asks for {with_unit(result[force], unit, 3)} at the end, {with_unit(most, unit, 3)} at"
                        " the most")  # fmt: skip
    return "; " + joined(told, "and") if told else ""


def _share(x):
    """`2.6e-07`, `nothing` for what only rounding leaves."""
    return f"{x:.1e}" if x > ROUNDING else "nothing"


def _floats(result):
    """Whether the robot's roots are free, and no loop holds it to the world: the recorded impulse is then all."""
    if result.question is None or "momentum" not in result.arrays:
        return False
    robot = result.question.robot
    held = any("world" in (loop.a.segment, loop.b.segment) for loop in robot.loops.values())
    return not held and all(p.size == 6 and not p.is_rod for p in robot.tree.pieces if p.parent is None)


def _momentum(result, console):
    momentum, impulse = result.arrays["momentum"], result.arrays["impulse"]
    change = momentum - momentum[0]
    rounding = NOISE * result.question.robot.length * float(np.max(np.abs(np.r_[momentum, impulse][:, 3:])))
    for label, part, unit in (("momentum", slice(3, 6), "N s"), ("turning", slice(0, 3), "N m s")):
        sizes = [float(np.max(np.linalg.norm(a[:, part], axis=1))) for a in (momentum, change, impulse)]
        left = float(np.max(np.linalg.norm((change - impulse)[:, part], axis=1)))
        if not max(sizes) > (rounding if label == "turning" else 0.0):
            say(console, label, "none, and none is given")
            continue
        end = with_unit(float(np.linalg.norm(change[-1, part])), unit, 3)
        stays = max(sizes[1:]) <= 1e-7 * sizes[0]
        told = f"stays {with_unit(sizes[0], unit, 3)}" if stays else f"changed by {end}"
        given = "nothing acts from outside" if sizes[2] <= NOISE * max(sizes) else "as the impulse of what acts"
        say(console, label, f"{told}, {given}; {_share(left / max(sizes))} of the largest unexplained")


def _coordinates(result, console):
    robot, q = result.question.robot, result.arrays["q"][-1]
    rows = [[(name, "bold"), f"{x:.6g}", unit if unit != "1" else ""]
            for name, unit, x in zip(robot.coordinates, robot.coordinate_units, q, strict=True)]  # fmt: skip
    line(console, "")
    columns(console, ["coordinate at the end", "value>", "unit"], rows)
