"""From a march through time to a Result: states, ends, energies, and the look that makes it trustworthy.

The energy at each output, computed by another path than the steps, is held against the work that inputs, loads,
damping, water and motors have done: what appears or vanishes beside it is the error of the integration.
"""

import casadi as ca
import numpy as np

from socontrol.lie import so3
from socontrol.programs.motions.plant import WORKS, Buffered
from socontrol.programs.result import Result, Status, Value

BALANCE = 1e-3  # unexplained energy over the largest energy that moved: more rejects a solution
ROUNDING = 1e-12  # of the energies summed: cancellation, not motion


def answered(question, plant, march, seconds):
    """Result of what a march has recorded, all of it or a part."""
    robot, t = plant.robot, np.array(march.t)
    arrays = {"t": t, "q": np.array(march.q), "qd": np.array(march.qd)}
    arrays["u"] = np.array(march.u or [plant.inputs(x) for x in t])
    arrays |= _holding(plant, march, arrays)
    work = np.array(march.work)
    arrays["work"], arrays["impulse"] = work[:, : len(WORKS)], work[:, len(WORKS) :]
    arrays |= _energies(plant, arrays) | ends(robot, robot.functions(), arrays)
    lost, moved = _unexplained(arrays, _borne(plant, march))
    residuals = {"energy": Value(_share(lost, moved), "1")}
    status, values = _told_of_limits(question, march.status, arrays), {}
    if not all(np.all(np.isfinite(a)) for a in arrays.values()):
        status = Status("numerical", "The motion holds numbers that are not finite; look at loads and inputs.")
        arrays = {}
    else:
        values = _values(robot, arrays, lost)
    if status.solved and residuals["energy"].value > BALANCE:
        lost = f"Of the energy that moved {residuals['energy'].value:.2g} is not explained by work, above {BALANCE:g}"
        key = "longest_step" if plant.driven.size and question.solver.type == "radau" else "tolerance` or `step"
        status = Status("rejected", f"{lost}; lower the integrator's `{key}`.")
    solver = {"iterations": march.iterations, "seconds": seconds, "steps": march.steps, "refused": march.refused}
    details = {"integrator": question.solver.type, "reached": float(t[-1]),
               "stop": float(question.outputs[-1])}  # fmt: skip
    return Result(name=question.name, type="simulation", status=status, question=question, arrays=arrays,
                  values=values, residuals=residuals, solver=solver, details=details)  # fmt: skip


def _told_of_limits(question, status, arrays):
    """The status, with the names of inputs that were given beyond their limits."""
    lower, upper = question.input_limits()
    u, room = arrays["u"], 1e-9 * np.maximum(1.0, np.abs(arrays["u"]))
    past = np.any((u < lower - room) | (u > upper + room), axis=0)
    names = [name for name, is_past in zip(question.robot.inputs, past, strict=True) if is_past]
    return Status(status.outcome, f"{status.message} Beyond their limits: {', '.join(names)}.") if names else status


def _holding(plant, march, arrays):
    """{holding.NAME: force [k] of the motor} of driven coordinates."""
    if not plant.driven.size:
        return {}
    states = zip(arrays["t"], arrays["q"], arrays["qd"], strict=True)
    rows = np.array(march.motors or [plant.motors(t, q.copy(), qd.copy()) for t, q, qd in states])
    return {f"holding.{plant.robot.coordinates[i]}": rows[:, k] for k, i in enumerate(plant.driven)}


def _energies(plant, arrays):
    """Kinetic, elastic and gravitational energy [k x 3], and momentum about the world's origin [k x 6]."""
    energy, momentum = (Buffered(f.function) for f in (plant.functions.energy, plant.functions.momentum))
    rows, momenta = [], []
    for t, q, qd in zip(arrays["t"], arrays["q"], arrays["qd"], strict=True):
        parameters = plant.parameters(t)
        rows.append(energy(q, qd, *parameters)[0][0].copy())
        momenta.append(momentum(q, qd, *parameters)[0][0].copy())
    return {"energy": np.array(rows), "momentum": np.array(momenta)}


def ends(robot, functions, arrays):
    """Pose of every segment's end: position [k x 3] and rotation vector [k x 3]."""
    q = ca.MX.sym("q", robot.n)
    poses = [functions.pose(segment, 1.0).function(q) for segment in robot.segments]
    rows = Buffered(ca.Function("ends", [q], [ca.vertcat(*(ca.vec(g[:3, :]) for g in poses))]))
    g = np.array([rows(x)[0][0].copy() for x in arrays["q"]]).reshape(len(arrays["q"]), -1, 4, 3)
    vectors = Buffered(_rotation_vector())
    found = {}
    for k, segment in enumerate(robot.segments):
        found[f"{segment}.position"] = g[:, k, 3]
        found[f"{segment}.rotation"] = np.array([vectors(R.ravel())[0][0].copy() for R in g[:, k, :3]])
    return found


def _rotation_vector():
    R = ca.SX.sym("R", 3, 3)
    return ca.Function("rotation_vector", [R], [so3.log(R)])


def _borne(plant, march):
    """What loops mostly bear at the most, times the length over which they are closed but for rounding [J]."""
    if not march.lam or not np.size(march.lam[0]):
        return 0.0
    return float(np.median(np.max(np.abs(march.lam) * plant.ties.reach, axis=1)))


def _unexplained(arrays, borne):
    """Largest |change of energy - work| [J], 0 where it is rounding, and the largest energy that moved [J]."""
    energy, work = arrays["energy"], arrays["work"]
    lost = float(np.max(np.abs(energy.sum(axis=1) - energy[0].sum() - work.sum(axis=1))))
    moved = max(float(np.max(np.ptp(energy, axis=0))), float(np.max(energy[:, 0])), float(np.max(np.abs(work))))
    size = float(np.max(np.abs(energy))) + float(np.max(np.abs(work))) + borne
    return (0.0 if lost <= ROUNDING * size else lost), moved


def _share(part, whole):
    return part / whole if part > 0 and whole > 0 else 0.0


def _values(robot, arrays, lost):
    """What there is to say at the end, and of the whole way; lost: energy that no work explains [J]."""
    t, q = arrays["t"], arrays["q"]
    values = {"time": Value(float(t[-1]), "s")}
    for piece in robot.tree.pieces:
        if not piece.is_rod:
            for i in range(piece.columns.start, piece.columns.stop):
                values[f"coordinates.{robot.coordinates[i]}"] = Value(float(q[-1, i]), robot.coordinate_units[i])
    for i, unit in enumerate(robot.coordinate_units):
        holding = arrays.get(f"holding.{robot.coordinates[i]}")
        if holding is not None:
            unit = {"rad": "N m", "m": "N"}.get(unit, "conjugate")
            values[f"holding.{robot.coordinates[i]}"] = Value(float(holding[-1]), unit)
    for segment in robot.segments:
        positions = arrays[f"{segment}.position"]
        values[f"{segment}.position"] = Value(positions[-1].tolist(), "m")
        values[f"{segment}.rotation"] = Value(arrays[f"{segment}.rotation"][-1].tolist(), "rad")
        values[f"{segment}.displacement"] = Value((positions[-1] - positions[0]).tolist(), "m")
    for k, name in enumerate(("kinetic", "elastic", "gravitational")):
        values[f"energy.{name}"] = Value(float(arrays["energy"][-1, k]), "J")
    values["energy.largest_kinetic"] = Value(float(np.max(arrays["energy"][:, 0])), "J")
    for k, name in enumerate(WORKS):
        values[f"work.{name}"] = Value(float(arrays["work"][-1, k]), "J")
    largest = float(np.max(arrays["energy"][:, 0]))
    values["energy.drift"] = Value(_share(lost, largest), "1")
    values["momentum"] = Value(arrays["momentum"][-1].tolist(), "N m s, N s")
    values["impulse"] = Value(arrays["impulse"][-1].tolist(), "N m s, N s")
    return values
