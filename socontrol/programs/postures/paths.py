"""A path of waypoints: each solved from its neighbour, in order; one Result with arrays over the waypoints."""

import copy
import time
from dataclasses import dataclass, field, replace

import numpy as np

from socontrol.programs.equilibria.dead_points import relieved
from socontrol.programs.looks.answer import FORCE_TOLERANCE, LOOP_TOLERANCE
from socontrol.programs.result import Status, Value
from socontrol.quantities import joined

MOST_TOLD = 5  # runs of waypoints in a sentence
CLOSED = 1e-6  # of its length: a path that ends this near to its beginning is closed


def shares(waypoints):
    """Share [K] of the way done at each waypoint, from 0 to 1, by straight lines between them."""
    way = _way(waypoints)
    return way / way[-1] if way[-1] > 0 else np.linspace(0.0, 1.0, way.size)


def is_closed(waypoints):
    """Whether a path [K x 3] comes back to its beginning."""
    points = np.asarray(waypoints, dtype=float)
    return bool(np.linalg.norm(points[-1] - points[0]) <= CLOSED * _way(points)[-1])


def _way(waypoints):
    """Way [K, m] from the first waypoint to each, by straight lines."""
    steps = np.linalg.norm(np.diff(np.asarray(waypoints, dtype=float), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass
class Walk:
    """Waypoints solved so far. rows: (outcome, parameters) of each; last: outcome of the last one tried.

    stopped: why it went no further, where that is no outcome of a posture.
    """

    count: int
    rows: list = field(default_factory=list)
    last: object = None
    parameters: dict = field(default_factory=dict)
    attempts: list = field(default_factory=list)
    seconds: float = 0.0
    stopped: Status | None = None

    def array(self, key, size):
        """Values [K x size] of a variable."""
        return np.array([outcome.values[key] for outcome, _ in self.rows]).reshape(len(self.rows), size)


def follow(solver, progress=None):
    """Result of a path: arrays path.q [N x n], path.u [N x m], path.tip [N x 3]; stops at the first point missed."""

    def find(k, targets, before):
        return *solver.find(targets, before.values if before else None, before), {}

    return gathered(solver, walk(solver, find, progress))


def walk(solver, find, progress=None):
    """Walk along the solver's path; find(k, targets, outcome before) -> (outcome, attempts, further parameters).

    find may raise Stop.
    """
    name, path = solver.path
    waypoints = path.waypoints()
    began, done = time.perf_counter(), Walk(len(waypoints))
    for k, waypoint in enumerate(waypoints):
        targets = {f"target.{name}": path.stop(waypoint).numbers()}
        try:
            done.last, tries, further = find(k, targets, done.rows[-1][0] if done.rows else None)
        except Stop as stop:
            sentence = f"Waypoint {k + 1} of {len(waypoints)}: {stop.status.message}"
            done.stopped, tries = replace(stop.status, message=sentence), stop.attempts
        except KeyboardInterrupt:  # between two calls of the solver: keep the waypoints that are done
            if not done.rows:
                raise
            done.last, tries = _interrupted(done.rows[-1][0]), []
        done.attempts += tries
        if done.stopped:
            break
        done.parameters = {**solver.posture.targets(), **targets, **further}
        if not done.last.status.solved:
            break
        done.rows.append((done.last, done.parameters))
        if progress:
            progress(k + 1, len(waypoints), f"{name} {k + 1}/{len(waypoints)}")
    done.seconds = time.perf_counter() - began
    return done


class Stop(Exception):
    """A waypoint is not solved, and not because it is out of reach."""

    def __init__(self, status, attempts):
        super().__init__(status.message)
        self.status, self.attempts = status, attempts


def _interrupted(outcome):
    return replace(outcome, status=Status("interrupted", "Stopped by the user; what was solved is kept."))


class Seen:
    """The independent look at one waypoint: unbalanced force, open loops, what is wrong, whether it is stable."""

    def __init__(self, solver, outcome, parameters, look):
        arrays, _ = solver.posture.told(outcome)
        q, u, lam, free = arrays["q"], arrays["u"], arrays.get("lam"), solver.posture.free
        lam, dead = relieved(look.balance, q, free, lam)
        found = look.residuals(q, u, free, lam)
        self.lam, self.force, self.open = lam, found["force"].value, found["loops"].value if "loops" in found else 0.0
        self.stable = look.stability(q, u, free, lam).stable
        collapsed = look.collapsed(q)
        self.wrong = None
        if dead and not self.force <= FORCE_TOLERANCE:
            self.wrong = f"{dead.refusal[0].lower()}{dead.refusal[1:]}"
        elif not self.force <= FORCE_TOLERANCE:
            self.wrong = f"the recomputed unbalanced force is {self.force:.2g} of the largest; use more Gauss points"
        elif not self.open <= LOOP_TOLERANCE:
            self.wrong = f"a recomputed loop is {self.open:.2g} m or rad open; give a guess"
        elif collapsed:
            self.wrong = f"collapsed or over-bent: {', '.join(collapsed)}"
        elif not solver.meets(outcome, parameters):
            self.wrong = "the recomputed goal is missed; tighten the solver's tolerance"


def _status(done, last, seen):
    """Status of the whole path: the first waypoint that fails or is rejected speaks for it."""
    count = done.count
    for k, look in enumerate(seen):
        if look.wrong:
            return Status("rejected", f"Waypoint {k + 1} of {count}: {look.wrong}.")
    if done.stopped:
        return done.stopped
    if not last.solved:
        return Status(last.outcome, f"Waypoint {len(done.rows) + 1} of {count}: {last.message}")
    return Status("solved", f"All {count} waypoints solved.{unstable_at([look.stable for look in seen])}")


def unstable_at(stable):
    """` Not stable at waypoints 3 to 7 and 9.`: where the waypoints [K] are not, nothing where all are."""
    loose, runs = [k + 1 for k, stands in enumerate(stable) if not stands], []
    if not loose:
        return ""
    if len(loose) == len(stable):
        return f" Stable at none of the {len(stable)} waypoints."
    for k in loose:
        runs[-1:] = [(runs[-1][0], k)] if runs and runs[-1][1] == k - 1 else [*runs[-1:], (k, k)]
    told = [f"{a} to {b}" if b > a else f"{a}" for a, b in runs[:MOST_TOLD]]
    others = sum(b - a + 1 for a, b in runs[MOST_TOLD:])
    told += [f"{others} more"] if others else []
    return f" Not stable at waypoint{'s' * (len(loose) > 1)} {joined(told, 'and')}."


def gathered(solver, done, look_at=None):
    """Result of a Walk: that of its last waypoint with arrays and worst residuals over all of them.

    look_at(parameters) -> Look, where it is not the same for all.
    """
    (name, path), question, rows = solver.path, solver.question, done.rows
    look_at = look_at or (lambda parameters: solver.look)
    outcome, parameters = rows[-1] if done.stopped else (done.last, done.parameters)
    if look_at(parameters) is not solver.look:
        solver = copy.copy(solver)
        solver.look = look_at(parameters)
    result = solver.result(outcome, done.attempts, parameters, done.seconds)
    q, u = done.array("q", question.robot.n), done.array("u", question.robot.m)
    pose = solver.look.functions.pose(path.on, path.at)
    tips = np.array([np.array(pose(row))[:3, 3] for row in q]).reshape(-1, 3)
    looked = result.status.outcome != "interrupted"
    seen = [Seen(solver, *row, look_at(row[1])) for row in rows] if looked else []
    misses = [np.linalg.norm(solver.posture.misses(row, own)[name][:3]) for row, (_, own) in zip(q, rows, strict=True)]
    residuals = {**result.residuals}
    if rows:
        residuals[f"goals.{name}"] = Value(float(max(misses)), "m")
    if seen:
        residuals["force"] = Value(max(look.force for look in seen), "1")
    if seen and question.robot.loops:
        residuals["loops"] = Value(max(look.open for look in seen), "m, rad")
    status = _status(done, result.status, seen)
    arrays = {**result.arrays, "path.q": q, "path.u": u, "path.tip": tips,
              "path.target": path.beside(path.waypoints(), tips), "path.miss": np.array(misses)}  # fmt: skip
    if seen and question.robot.loops:
        arrays["path.lam"] = np.array([look.lam for look in seen])
    details = {**result.details, "waypoints": done.count, "waypoints_solved": len(rows),
               "too_fast": done.stopped is not None and done.stopped.outcome == "infeasible"}  # fmt: skip
    return replace(result, status=status, arrays=arrays, residuals=residuals, details=details)
