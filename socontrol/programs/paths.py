"""A path of waypoints: each solved from its neighbour, in order; one Result with arrays over the waypoints."""

import time
from dataclasses import replace

import numpy as np

from socontrol.programs.answer import FORCE_TOLERANCE
from socontrol.programs.result import Result, Status, Value


def follow(solver, progress=None):
    """Result of a path: arrays path.q [N x n], path.u [N x m], path.tip [N x 3]; stops at the first point missed."""
    name, path = solver.path
    waypoints = path.waypoints()
    began, warm, start, rows, attempts = time.perf_counter(), None, None, [], []
    for k, waypoint in enumerate(waypoints):
        targets = {f"target.{name}": path.stop(waypoint).numbers()}
        parameters = {**solver.posture.targets(), **targets}
        try:
            outcome, tries = solver.find(targets, start, warm)
        except KeyboardInterrupt:  # between two calls of the solver: keep the waypoints that are done
            if not rows:
                raise
            stopped = Status("interrupted", "Stopped by the user; what was solved is kept.")
            outcome, tries = replace(rows[-1][0], status=stopped), []
        attempts += tries
        if not outcome.status.solved:
            break
        rows.append((outcome, parameters))
        warm, start = outcome, outcome.values
        if progress:
            progress(k + 1, len(waypoints), f"{name} {k + 1}/{len(waypoints)}")
    result = solver.result(outcome, attempts, parameters, time.perf_counter() - began)
    return _gathered(solver, result, rows, len(waypoints), name, path)


class _Seen:
    """The independent look at one waypoint: unbalanced force, what is wrong with it, whether it is stable."""

    def __init__(self, solver, outcome, parameters):
        q, u = outcome.values["q"], outcome.values["u"]
        self.force = solver.look.residuals(q, u, solver.posture.free)["force"].value
        self.stable = solver.look.stability(q, u, solver.posture.free).stable
        collapsed = solver.look.collapsed(q)
        self.wrong = None
        if not self.force <= FORCE_TOLERANCE:
            self.wrong = f"the recomputed unbalanced force is {self.force:.2g} of the largest; use more Gauss points"
        elif collapsed:
            self.wrong = f"collapsed or over-bent: {', '.join(collapsed)}"
        elif not solver.meets(outcome, parameters):
            self.wrong = "the recomputed goal is missed; tighten the solver's tolerance"


def _status(last, seen, solved, count):
    """Status of the whole path: the first waypoint that fails or is rejected speaks for it."""
    for k, look in enumerate(seen):
        if look.wrong:
            return Status("rejected", f"Waypoint {k + 1} of {count}: {look.wrong}.")
    if not last.solved:
        return Status(last.outcome, f"Waypoint {solved + 1} of {count}: {last.message}")
    loose = [str(k + 1) for k, look in enumerate(seen) if not look.stable]
    unstable = f" Not stable at {', '.join(loose[:5])}{' ...' if len(loose) > 5 else ''}." if loose else ""
    return Status("solved", f"All {count} waypoints solved.{unstable}")


def _gathered(solver, result, rows, count, name, path):
    """The last waypoint's result with arrays and worst residuals over all waypoints."""
    f, question = solver.look.functions, solver.question
    q = np.array([o.values["q"] for o, _ in rows]).reshape(len(rows), question.robot.n)
    u = np.array([o.values["u"] for o, _ in rows]).reshape(len(rows), question.robot.m)
    pose = f.pose(path.on, path.at)
    tips = np.array([np.array(pose(row))[:3, 3] for row in q]).reshape(-1, 3)
    misses, seen = [], [_Seen(solver, *row) for row in rows if result.status.outcome != "interrupted"]
    for outcome, parameters in rows:
        misses.append(np.linalg.norm(solver.posture.misses(outcome.values["q"], parameters)[name][:3]))
    residuals = {**result.residuals}
    if rows:
        residuals[f"goals.{name}"] = Value(float(max(misses)), "m")
    if seen:
        residuals["force"] = Value(max(look.force for look in seen), "1")
    status = _status(result.status, seen, len(rows), count)
    arrays = {**result.arrays, "path.q": q, "path.u": u, "path.tip": tips, "path.target": np.array(path.waypoints()),
              "path.miss": np.array(misses)}  # fmt: skip
    details = {**result.details, "waypoints": count, "waypoints_solved": len(rows)}
    return Result(**{**vars(result), "status": status, "arrays": arrays, "residuals": residuals, "details": details})
