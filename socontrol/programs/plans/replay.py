"""A plan looked at again: simulated under its own inputs by another integrator and held against the plan."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from socontrol.programs.motions.charts import Charts
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.integrators import Marcher, Radau
from socontrol.programs.motions.motion_answer import ends
from socontrol.programs.motions.plant import WORKS, Plant
from socontrol.programs.motions.signals import History
from socontrol.programs.plans.plan_errors import Finer, between, needed, order, positions
from socontrol.programs.result import Status, Value

MARGIN, LOOSEST, TIGHTEST = 0.03, 1e-5, 1e-9  # tolerance of the simulation: of the error of an interval; its limits
UNBALANCED = 0.1  # of the largest force between the points of a motion without masses: more rejects it
STEPS = 1000  # of the simulation for each interval: more are a motion that runs away
UNSTABLE = 10.0  # times the way off of a body that coasts: more is worth a sentence
COARSE = 0.05  # of the speed: an interval that errs by more does not resolve what moves there
HIGH = 5  # order of the default scheme: what is below had better change to it
MOST_MORE = 10  # times as many intervals; beyond, a higher order is the better advice
LITTLE = 0.01  # of the robot's length: what moves an end less is no range of a coordinate


@dataclass(frozen=True)
class Replayed:
    """t [K], q, qd [K x n], ends {segment: [K x 3]}: as far as the simulation came; its status."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    ends: dict
    status: Status


@dataclass(frozen=True)
class Deviation:
    """Largest distance `tip` [m] of any end from the plan, its share of the robot's length, of which segment and when
    [s]; `coordinates`: largest way off of a coordinate over its own range."""

    tip: float
    share: float
    segment: str
    time: float
    coordinates: float


class Driven(Plant):
    """A robot under the inputs of a plan, those of interval `k`; coordinates {index: value} are held."""

    def __init__(self, robot, curve, held):
        jumps = History(lambda t: ca.DM(0), tuple(curve.nodes[1:-1]))
        fixed = {i: History(lambda t, value=value: ca.DM(value)) for i, value in held.items()}
        super().__init__(replace(robot, compiled=False), [jumps] * robot.m, fixed, {})
        knots = curve.knots
        self._powers = np.linalg.inv(np.vander(knots, increasing=True)) @ curve.u
        self._nodes, self._rising, self.k = curve.nodes, np.arange(knots.size), 0

    @classmethod
    def of(cls, question, curve):
        return cls(question.loaded, curve, question.named("coordinates", question.coordinates))

    def inputs(self, t):
        """u [m] of interval k at t: where it ends the inputs may jump."""
        begin, end = self._nodes[self.k : self.k + 2]
        return ((t - begin) / (end - begin)) ** self._rising @ self._powers[self.k]


class _Leaps(Marcher):
    """The march from node to node of a plan; nobody asks for its work."""

    def _leg(self, stop):
        self.plant.k = int(np.sum(np.array(self.plant.histories[0].breaks) < stop))
        super()._leg(stop)

    @property
    def _longest(self):
        return self.settings.longest_step

    def _worked(self, step, x):
        return np.zeros(len(WORKS) + 6)


def replayed(question, curve, times, tolerance=TIGHTEST, plant=None):
    """Replayed: the motion from the plan's first state under its inputs, at rising times from 0 to the duration."""
    robot = question.loaded
    plant = plant or Driven.of(question, curve)
    settings = Radau(tolerance=tolerance, longest_step=float(np.min(np.diff(curve.nodes))) / 2,
                     max_steps=STEPS * len(curve.shares))  # fmt: skip
    leaps = _Leaps(plant, settings, times, displacement_weights(robot), robot.length)
    leaps.charts = Charts(robot, range(robot.n))  # all kept, as a plan keeps them
    march = leaps.run(curve.q[0], curve.v[0])
    q = np.array(march.q)
    places = ends(robot, plant.functions, {"q": q})
    there = {segment: places[f"{segment}.position"] for segment in robot.segments}
    return Replayed(np.array(march.t), q, np.array(march.qd), there, march.status)


def deviations(question, planned, found):
    """Deviation of a Replayed from `planned`, arrays t, q and {segment}.position at the same times."""
    robot, count = question.loaded, len(found.t)
    gaps = np.array([np.linalg.norm(rows - planned[f"{segment}.position"][:count], axis=1)
                     for segment, rows in found.ends.items()])  # fmt: skip
    which, when = np.unravel_index(int(np.argmax(gaps)), gaps.shape)
    tip, weights = float(gaps[which, when]), displacement_weights(robot)
    ranges = np.maximum(np.ptp(planned["q"], axis=0), LITTLE * robot.length / np.where(weights > 0, weights, np.inf))
    off = np.max(np.abs(found.q - planned["q"][:count]), axis=0)
    share = float(np.max(off[ranges > 0] / ranges[ranges > 0], initial=0.0))
    return Deviation(tip, tip / robot.length, list(found.ends)[which], float(found.t[when]), share)


def look(question, curve, planner, arrays):
    """(arrays, values, note) to join the Result of a plan; note: a Status that takes its place, or None."""
    try:
        return _looked(question, curve, planner.functions, arrays)
    except KeyboardInterrupt:
        return {}, {}, Status("interrupted", "Stopped by the user; the plan is kept, but was not simulated again.")


def _looked(question, curve, functions, arrays):
    robot, t = question.loaded, arrays["t"]
    weights = displacement_weights(robot)
    when, share = between(question, curve, functions, weights)
    more, values = {"error.t": when, "error.share": share}, {"error.between": Value(float(np.max(share)), "1")}
    if question.quasi_static:
        return more, values, _loose(float(np.max(share)))
    if not question.replay.active or not question.free.any():
        return more, values, None
    plant = Driven.of(question, curve)
    errors = Finer(plant, curve, weights, positions(functions, robot)).errors()
    times = np.union1d(t, curve.nodes)
    found = replayed(question, curve, times, _tolerance(errors), plant)
    planned = {"t": times, "q": curve.at(times)[0]}
    off = deviations(question, planned | ends(robot, functions, planned), found)
    if errors is not None:
        values["error.tip"] = Value(float(errors.largest), "m")
    values["mesh.needed"] = Value(_needed(question, curve, errors, off), "1")
    note = _note(question, curve, errors, found, off)
    if found.status.solved:
        kept = np.searchsorted(times, t)
        more |= {"replay.q": found.q[kept], "replay.qd": found.qd[kept]}
        more |= {f"replay.{segment}.position": rows[kept] for segment, rows in found.ends.items()}
        values |= {"replay.tip": Value(off.tip, "m"), "replay.tip_share": Value(off.share, "1"),
                   "replay.coordinates": Value(off.coordinates, "1")}  # fmt: skip
    return more, values, note


def _loose(share):
    """Status of a quasi-static plan that is no equilibrium between the points, or None."""
    if share <= UNBALANCED:
        return None
    told = f"Between the points {share:.2g} of the largest force is not balanced: there it is no equilibrium"
    return Status("rejected", f"{told}; take more intervals.")


def _tolerance(errors):
    return TIGHTEST if errors is None else float(np.clip(MARGIN * np.max(errors.local), TIGHTEST, LOOSEST))


def _needed(question, curve, errors, off):
    """Intervals that would keep the way off within the tolerance, as seen or as estimated."""
    allowed = question.replay.tolerance * question.loaded.length
    return needed(curve, max(off.tip, errors.largest if errors else 0.0), allowed)


def _note(question, curve, errors, found, off):
    """Status of a plan that the robot would not follow; None for one that it would."""
    if found.status.outcome == "interrupted":
        return Status("interrupted", "Stopped by the user; the plan is kept, but was not simulated to its end.")
    where, tolerance = f"the end of {off.segment} is {off.tip:.3g} m off", question.replay.tolerance
    told = f"Simulated again under its own inputs, {where} at t = {off.time:.4g} s"
    if not found.status.solved:
        told = f"{told}, and {found.t[-1]:.4g} s is as far as the simulation gets"
        told += f". {found.status.message[:-1]}" if found.status.outcome == "numerical" else ""
    elif off.share <= tolerance:
        return None
    else:
        told = f"{told}: {off.share:.2g} of the robot's length, more than `replay.tolerance` of {tolerance:g}"
    return Status("rejected", f"{told}. {_reasons(question, errors)}{_advice(question, curve, errors, off)}")


def _reasons(question, errors):
    """Sentences on what makes it hard to follow this plan, as far as that can be seen."""
    told = ""
    if errors is not None and errors.growth > UNSTABLE:
        told += f"Without feedback this motion is unstable: errors grow {errors.growth:.0f}-fold. "
    if errors is not None and np.max(errors.local) > COARSE:
        i, t = errors.worst
        told += f"Near t = {t:.4g} s {question.robot.coordinates[i]} moves faster than the mesh resolves. "
    return told


def _advice(question, curve, errors, off):
    count = _needed(question, curve, errors, off)
    low = curve.scheme.shared and order(curve.scheme) < HIGH
    higher = "`scheme: radau`" if low else "more `points`"
    if len(curve.shares) < count <= MOST_MORE * len(curve.shares):
        return f"Set `intervals` of the mesh to about {count}, or take {higher}."
    return f"Take more `intervals` in the mesh, and {higher}."
