"""From a solved plan to a Result: samples, ends, costs by name, what is missed and when, clearances, speeds."""

from dataclasses import replace

import casadi as ca
import numpy as np

from socontrol.mechanics.kinematics import Kinematics
from socontrol.native.buffers import Buffered
from socontrol.programs.motions.motion_answer import ends
from socontrol.programs.plans.obstacles import clearances, moving
from socontrol.programs.plans.planned import Planned
from socontrol.programs.plans.replay import look
from socontrol.programs.plans.schemes import scheme
from socontrol.programs.postures.goals import goal_miss
from socontrol.programs.result import Result, Status, Value

PENETRATION = 1e-3  # of the robot's length between the instants that were held clear: more rejects a plan
SPEEDS = "limits.speeds."
MET = 1e-6  # of a goal's scale
FORCES = {"rad": "N m", "m": "N", "1/m": "N m^2", "1": "N m"}  # conjugate to a coordinate's unit
FINE = 10  # instants of an interval at which a plan is looked at
WORST = 5  # quantities that are named
PER_SECTION = 8  # stations of a section that are looked at afterwards


def answered(question, planner, outcome, attempts, build_seconds):
    """Result of the best outcome of a search, checked where it is solved."""
    solver = {"iterations": sum(a.iterations for a in attempts), "build_seconds": build_seconds,
              "solve_seconds": sum(a.seconds for a in attempts)}  # fmt: skip
    log = "\n".join(f"--- {a.start}: {a.outcome}, {a.iterations} iterations\n{a.log}" for a in attempts if a.log)
    mesh = question.mesh
    form = f"{mesh.scheme} {planner.scheme.size}" if mesh.scheme in ("radau", "lobatto") else mesh.scheme
    details = {"attempts": attempts, "scheme": form, "intervals": mesh.intervals}
    result = Result(name=question.name, type="trajectory", status=outcome.status, question=question, solver=solver,
                    details=details, log=log)  # fmt: skip
    if not np.all(np.isfinite(outcome.x)):
        return result
    curve = planner.transcription.planned(outcome.values)
    found = planner.program.evaluated(outcome.x)
    arrays = sampled(question, curve, question.output_times(curve.duration), planner.functions)
    arrays |= {"node.t": curve.nodes, "node.q": curve.q, "node.qd": curve.v, "knot.u": curve.u, "point.t": curve.points}
    for letter, rows in planner.transcription.at_all_points(outcome.values).items():
        arrays[f"point.{letter}"] = rows
    arrays |= {f"clearance.{name}": rows for name, rows in cleared(question, arrays["q"]).items()}
    fine = _finely(question, planner, curve)
    result = replace(
        result, arrays=arrays, values=_values(question, planner, curve, found, arrays, fine),
        residuals=_residuals(question, planner, found, curve, outcome.x),
        details={**details, "stop": curve.duration, "worst": worst(planner, found, curve)},
    )  # fmt: skip
    return _checked(question, curve, planner, result) if result.status.solved else result


def _finely(question, planner, curve):
    """q, qd, u and clearances at instants that do not depend on what is stored."""
    t = np.union1d(np.linspace(0.0, curve.duration, FINE * len(curve.shares) + 1), curve.points)
    q, v, _, u, _ = curve.at(t)
    return {"q": q, "qd": v, "u": u, **{f"clearance.{name}": rows for name, rows in cleared(question, q).items()}}


def sampled(question, curve, times, functions=None):
    """Arrays of a plan at any times: t, q, qd, qdd, u, ud, lengths of lines, ends of segments."""
    functions = functions or question.loaded.functions(compiled=False)
    q, v, a, u, ud = curve.at(times)
    lengths = Buffered(functions.actuator_lengths.function)
    arrays = {"t": np.asarray(times), "q": q, "qd": v, "qdd": a, "u": u, "ud": ud}
    arrays["lengths"] = np.array([lengths(row)[0][0].copy() for row in q])
    return arrays | ends(question.loaded, functions, arrays)


def curve_of(result):
    """Planned motion of a stored plan, to be sampled at any times."""
    question, arrays = result.question, result.arrays
    form = scheme(question.mesh.scheme, question.mesh.points)
    a = arrays["point.qdd"].reshape(len(arrays["node.t"]) - 1, form.size, -1)
    return Planned(form, float(arrays["node.t"][-1]), question.shares, arrays["node.q"], arrays["node.qd"], a,
                   arrays["knot.u"], form.knots(question.input_shape, question.continuous))  # fmt: skip


def resampled(result, times):
    """`sampled` of a stored plan at other times."""
    return sampled(result.question, curve_of(result), times)


def cleared(question, q):
    """{obstacle: least distance [K, m] of the robot's surface from it} at rows of q."""
    robot, found = question.loaded, {}
    for name, obstacle in (question.obstacles or {}).items():
        looked = moving(robot, PER_SECTION, obstacle)
        if not looked:
            continue
        x = ca.SX.sym("q", robot.n)
        rows = ca.mmin(clearances(robot, Kinematics(robot.tree, x), obstacle, looked))
        run = Buffered(ca.Function("clearance", [x], [rows]))
        found[name] = np.array([float(run(row)[0][0][0]) for row in q]) + obstacle.clearance
    return found


def _values(question, planner, curve, found, arrays, fine):
    robot, values = question.loaded, {"duration": Value(curve.duration, "s")}
    costs = {part.name: cost for part, cost, _ in found if part.name.startswith(("costs.", "end.goals", "waypoints."))}
    values["cost"] = Value(float(sum(costs.values())), "1")
    named = {name.removeprefix("costs."): cost for name, cost in costs.items() if name.startswith("costs.")}
    values |= {f"cost.{name}": Value(cost, "1") for name, cost in named.items()}
    for segment in robot.segments:
        values[f"{segment}.position"] = Value(arrays[f"{segment}.position"][-1].tolist(), "m")
        values[f"{segment}.rotation"] = Value(arrays[f"{segment}.rotation"][-1].tolist(), "rad")
    for piece in robot.tree.pieces:
        if not piece.is_rod:
            for i in range(piece.columns.start, piece.columns.stop):
                last = Value(float(arrays["q"][-1, i]), robot.coordinate_units[i])
                values[f"coordinates.{robot.coordinates[i]}"] = last
    for i, name in enumerate(robot.inputs):
        largest = fine["u"][np.argmax(np.abs(fine["u"][:, i])), i]
        values[f"inputs.{name}.largest"] = Value(float(largest), robot.input_units[i])
    for name in (name for name in question.obstacles or {} if f"clearance.{name}" in fine):
        values[f"clearance.{name}"] = Value(float(np.min(fine[f"clearance.{name}"])), "m")
    for name, speed in (question.limits.speeds or {}).items():
        values[f"speed.{name}"] = Value(_fastest(planner.functions, speed, fine), "m/s")
    values["mesh.intervals"] = Value(len(curve.shares), "1")
    return values


def _fastest(functions, speed, arrays):
    J = Buffered(functions.jacobian(speed.on, speed.at).function)
    rows = zip(arrays["q"], arrays["qd"], strict=True)
    return float(max(np.linalg.norm(J(q)[0][:, 3:].T @ v) for q, v in rows))  # buffers hold columns


def _residuals(question, planner, found, curve, x):
    """Largest scaled misses of the equation of motion, of the defects and of limits; goals in SI."""
    lower, upper = planner.program.bounds()
    rows = {"equation": 0.0, "defects": 0.0, "limits": float(np.max(np.maximum(lower - x, x - upper), initial=0.0))}
    for part, _, g in found:
        if not part.size:
            continue
        miss = float(np.max(np.maximum(part.lower - g, g - part.upper), initial=0.0))
        kind = {"equation of motion": "equation", "defects": "defects", "links": "defects", "between": "defects"}
        key = kind.get(part.name, "limits")
        rows[key] = max(rows[key], miss)
    residuals = {name: Value(miss, "1") for name, miss in rows.items()}
    for path, k, moment in question.moments:
        for name, goal in (moment.goals or {}).items():
            key = f"goals.{name}" if path == "end" else f"goals.{path.split('.')[1]}.{name}"
            miss = goal_miss(goal, question.loaded, curve.q[k])
            units = np.array(goal.units())
            for unit in dict.fromkeys(units):
                own = key if unit == units[0] else f"{key}.{unit}"
                residuals[own] = Value(float(np.linalg.norm(miss[units == unit])), str(unit))
    return residuals


def worst(planner, found, curve):
    """What is missed most, at most one row a quantity: quantity, node, time, excess in its unit."""
    rows = []
    for part, _, g in found:
        if not part.size:
            continue
        miss = np.maximum(part.lower - g, g - part.upper)
        i, k = np.unravel_index(int(np.argmax(miss)), miss.shape)
        if miss[i, k] > MET:
            node = int(part.when[i])
            name, unit = _named(planner.question, part, int(k))
            excess = float(miss[i, k] * part.scale[k])
            if name.startswith(SPEEDS):
                excess, unit = faster(planner.question, name, excess), "m/s"
            row = {"quantity": name, "node": node, "time": float(curve.nodes[node]), "excess": excess, "unit": unit}
            rows.append((miss[i, k], row))
    return [row for _, row in sorted(rows, key=lambda pair: -pair[0])[:WORST]]


def _named(question, part, row):
    """What a row of a part is about, and its unit."""
    robot = question.loaded
    if part.name == "equation of motion":
        i = int(np.flatnonzero(question.free)[row])
        return f"force on {robot.coordinates[i]}", FORCES.get(robot.coordinate_units[i], "conjugate")
    if part.name == "defects":
        half, i = divmod(row, part.size // 2)
        unit = robot.coordinate_units[i % robot.n]
        return f"{'rate' if half else 'motion'} of {robot.coordinates[i % robot.n]}", f"{unit}/s" if half else unit
    return part.name, part.units[row]


def faster(question, name, ratio):
    """m/s by which a limit of speed `name` is passed, from what its squared ratio to the limit is above 1."""
    largest = question.limits.speeds[name.removeprefix(SPEEDS)].largest
    return largest * (np.sqrt(1 + ratio) - 1)


def _checked(question, curve, planner, result):
    """The result after an independent look: it is rejected where the replay or an obstacle says so."""
    arrays, values, note = look(question, curve, planner, result.arrays)
    result = replace(result, arrays={**result.arrays, **arrays}, values={**result.values, **values})
    for name, obstacle in (question.obstacles or {}).items():
        if f"clearance.{name}" not in result.values:
            continue
        short = obstacle.clearance - result.values[f"clearance.{name}"].value
        if short > PENETRATION * question.loaded.length:
            told = f"Between the points the robot comes {short * 1e3:.2g} mm too near to '{name}'"
            note = note or Status("rejected", f"{told}; take more intervals.")
    misses = [n for n, goal in (question.end.goals or {}).items() if goal.weight is not None]
    if note is None and misses:
        rows = {n: result.residuals[f"goals.{n}"] for n in misses}
        told = ", ".join(f"{n} missed by {row.value:.3g} {row.unit}" for n, row in rows.items())
        return replace(result, status=Status("solved", f"Solved; weighted goal {told}."))
    return result if note is None else replace(result, status=note)
