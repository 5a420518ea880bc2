"""Problem type `fit`: which parameters make the robot's equilibria meet measured ones, tested on measurements held out.

For each variant of the robot (say, each material law) and each factor on the measured inputs:
    minimise over parameters theta and q_k   sum_k |position miss / scale|^2 + (tilt miss / scale)^2
    subject to r(q_k, factor u_k; theta) = 0 for every measurement k that is used for fitting;
then the equilibria of all measurements are solved anew with the fitted parameters and compared.
"""

import time
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.mechanics.robot import Robot
from socontrol.model.materials import Material
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.nlp.program import Program
from socontrol.programs.nlp.solver import NLP
from socontrol.programs.postures.goals import locate
from socontrol.programs.question import Named, Question
from socontrol.programs.result import Result, Status, Value
from socontrol.quantities import (
    Bad,
    Either,
    Fraction,
    Length,
    Number,
    Position,
    PositiveNumber,
    Radian,
    record,
)


@record(kw_only=True)
class Measurement:
    """Inputs and where the frame then stood; `tilt`: angle between its x axis and that of the straight robot.

    use: `fit` or `test`.
    """

    inputs: Named
    position: Position
    tilt: Radian
    use: Literal["fit", "test"] = "test"


@record(kw_only=True)
class FreeParameter:
    """Starting value(s) in SI, the size of a large change, and bounds."""

    start: Annotated[Any, Either(Number, tuple[Number, ...])]
    scale: PositiveNumber
    lower: Number | None = None
    upper: Number | None = None


@record(kw_only=True)
class Variant:
    """A version of the robot: materials by segment that replace the file's, and the parameters to fit, by path."""

    parameters: dict[str, FreeParameter]
    materials: dict[str, Material] | None = None


@record(kw_only=True)
class Scale:
    """What counts as one unit of miss."""

    position: Length = 1e-3
    tilt: Annotated[float, Radian] = float(np.pi / 90)


@record(kw_only=True)
class Fit(Question):
    """Which parameters of the robot fit measured equilibria, tested on measurements held out?

    on, at: the measured frame; factors: the measured inputs are multiplied by each in turn.
    """

    on: str
    measurements: tuple[Measurement, ...]
    variants: dict[str, Variant]
    at: Fraction = 1.0
    factors: tuple[PositiveNumber, ...] = (1.0,)
    scale: Scale = Scale()

    def __post_init__(self):
        super().__post_init__()
        locate(self.robot, self)
        for k, row in enumerate(self.measurements):
            self.named("inputs", row.inputs, f"measurements.{k}.inputs")
        if not any(row.use == "fit" for row in self.measurements):
            raise Bad("measurements", "none has `use: fit`; name the measurements to fit")
        for name in self.variants:
            self.variant(name)

    def variant(self, name):
        """Robot of a variant at its starting parameters; raises Bad."""
        variant, robot = self.variants[name], self.loaded
        for segment, material in (variant.materials or {}).items():
            try:
                robot = robot.with_values({f"{segment}.material": material})
            except ValueError as error:
                raise Bad(f"variants.{name}.materials.{segment}", str(error)) from None
        return started(robot, name, variant)

    def solve(self, progress=None):
        return solve(self, progress)


def started(robot, name, variant):
    values = {}
    for path, free in variant.parameters.items():
        try:
            old = robot.value(path)
        except ValueError as error:
            raise Bad(f"variants.{name}.parameters.{path}", str(error)) from None
        if isinstance(old, (tuple, list)) != isinstance(free.start, tuple):
            raise Bad(f"variants.{name}.parameters.{path}.start", "its shape differs from the value it replaces")
        values[path] = free.start
    return Robot(robot.with_values(values).description, robot.factor)


def solve(question, progress=None):
    """Result with fitted parameters, errors a measurement, and rms over fit and test measurements."""
    began, values, arrays, details, statuses, count = time.perf_counter(), {}, {}, {}, [], 0
    logs = []
    cases = [(name, factor) for name in question.variants for factor in question.factors]
    for k, (name, factor) in enumerate(cases):
        label = f"{name}.{factor:g}"
        balance = Balance(question.variant(name), tuple(question.variants[name].parameters))
        outcome = _fitted(question, name, factor, balance)
        logs.append(outcome.log)
        if outcome.status.outcome == "interrupted":
            raise KeyboardInterrupt
        count += outcome.iterations
        if not outcome.status.solved:
            statuses.append(Status(outcome.status.outcome, f"{label}: {outcome.status.message}"))
            continue
        rows = _compared(question, balance, factor, outcome.values["theta"])
        statuses.append(rows["status"])
        if not rows["status"].solved:
            statuses[-1] = Status(rows["status"].outcome, f"{label}: {rows['status'].message}")
            continue
        details[label] = {"parameters": _by_path(question, name, outcome.values["theta"])}
        for key in ("position", "tilt", "tilt_error", "position_error"):
            arrays[f"{label}.{key}"] = rows[key]
        values |= _summary(question, label, rows)
        for path, fitted in details[label]["parameters"].items():
            values[f"{label}.{path}"] = Value(fitted, "")
        if progress:
            progress(k + 1, len(cases), label)
    values |= _ratios(question, values)
    failed = next((s for s in statuses if not s.solved), None)
    status = failed or Status("solved", f"{len(cases)} fits solved; every equilibrium solved anew.")
    return Result(
        name=question.name, type="fit", status=status, values=values, arrays=arrays, question=question,
        log="\n".join(filter(None, logs)), details={"fits": details},
        solver={"iterations": count, "seconds": time.perf_counter() - began},
    )  # fmt: skip


def _ratios(question, values):
    """rms on the test measurements over that of the first variant: below 1 is better."""
    first, *others = question.variants
    ratios = {}
    for name in others:
        for factor in question.factors:
            for key in ("position", "tilt"):
                own, base = (values.get(f"{v}.{factor:g}.rms.test.{key}") for v in (name, first))
                if own and base and base.value > 0:
                    ratios[f"{name}.{factor:g}.ratio.test.{key}"] = Value(own.value / base.value, "1")
    return ratios


def _by_path(question, name, theta):
    found, start = {}, 0
    for path, free in question.variants[name].parameters.items():
        size = len(free.start) if isinstance(free.start, tuple) else 1
        part = theta[start : start + size]
        found[path] = part.tolist() if isinstance(free.start, tuple) else float(part[0])
        start += size
    return found


def _inputs(question, row, factor):
    u = np.zeros(question.robot.m)
    for i, value in question.named("inputs", row.inputs).items():
        u[i] = value * factor
    return u


def _fitted(question, name, factor, balance):
    """Outcome of the fitting program."""
    robot, scales = balance.robot, balance.scales
    functions = robot.functions(balance.parameters)
    pose = functions.pose(question.on, question.at).function
    program = Program(ca.SX.sym)
    free = question.variants[name].parameters.values()
    starts = [np.atleast_1d(f.start) for f in free]

    def bound(f, value, default):
        return np.full(np.atleast_1d(f.start).size, default if value is None else value)

    theta = program.variable(
        "theta", sum(s.size for s in starts), guess=np.concatenate(starts),
        scale=np.concatenate([np.full(s.size, f.scale) for s, f in zip(starts, free, strict=True)]),
        lower=np.concatenate([bound(f, f.lower, -np.inf) for f in free]),
        upper=np.concatenate([bound(f, f.upper, np.inf) for f in free]),
    )  # fmt: skip
    axis = se3.rotation(pose(np.zeros(robot.n), np.concatenate(starts)))[:, 0]
    q0 = balance.solve(np.zeros(robot.m)).q
    for k, row in enumerate(question.measurements):
        if row.use != "fit":
            continue
        u = _inputs(question, row, factor)
        guess = balance.solve(u, q0)
        q = program.variable(f"q{k}", robot.n, guess=guess.q if guess.status.solved else q0, scale=scales.q)
        residual, tangent, _ = balance.function(q, u, theta)
        slope = ca.jacobian(residual, program.variables["theta"].symbol) @ ca.diag(
            1 / ca.DM(program.variables["theta"].scale)
        )
        program.constrain(f"equilibrium.{k}", residual, scale=scales.force, tangent={f"q{k}": tangent, "theta": slope})
        g = pose(q, theta)
        tilt = _angle(se3.rotation(g)[:, 0], axis)
        program.minimize(ca.sumsqr((se3.position(g) - ca.DM(row.position)) / question.scale.position) / 2)
        program.minimize(((tilt - row.tilt) / question.scale.tilt) ** 2 / 2)
    return NLP(program, question.solver).solve()


def _angle(a, b):
    """Angle [rad] between unit vectors, smooth to 1e-9 rad where they agree."""
    return ca.atan2(ca.sqrt(ca.sumsqr(ca.cross(a, b)) + 1e-18), ca.dot(a, b))


def _compared(question, balance, factor, theta):
    """Equilibria of all measurements at theta, with the misses against the measured positions and tilts."""
    functions = balance.robot.functions(balance.parameters)
    pose = functions.pose(question.on, question.at).function
    axis = np.array(pose(np.zeros(balance.robot.n), theta))[:3, 0]
    positions, tilts, status = [], [], Status("solved", "")
    for row in question.measurements:
        answer = balance.solve(_inputs(question, row, factor), np.zeros(balance.robot.n), p=theta)
        if not answer.status.solved:
            status = answer.status
        g = np.array(pose(answer.q, theta))
        positions.append(g[:3, 3])
        tilts.append(float(_angle(ca.DM(g[:3, 0]), ca.DM(axis))))
    positions, tilts = np.array(positions), np.array(tilts)
    measured = np.array([row.position for row in question.measurements])
    tilt = np.array([row.tilt for row in question.measurements])
    return {
        "status": status, "position": positions, "tilt": tilts, "tilt_error": tilts - tilt,
        "position_error": np.linalg.norm(positions - measured, axis=1),
    }  # fmt: skip


def _summary(question, label, rows):
    values = {}
    for use in ("fit", "test"):
        chosen = [k for k, row in enumerate(question.measurements) if row.use == use]
        if chosen:
            for key, unit in (("position_error", "m"), ("tilt_error", "rad")):
                rms = float(np.sqrt(np.mean(rows[key][chosen] ** 2)))
                values[f"{label}.rms.{use}.{key.removesuffix('_error')}"] = Value(rms, unit)
    return values
