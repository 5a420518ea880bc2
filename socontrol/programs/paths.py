"""A path of waypoints: each solved from its neighbour, in order; one Result with arrays over the waypoints."""

import time

import numpy as np

from socontrol.programs.result import Result, Status, Value


def follow(solver, progress=None):
    """Result of a path: arrays path.q [N x n], path.u [N x m], path.tip [N x 3]; stops at the first point missed."""
    name, path = solver.path
    waypoints = path.waypoints()
    began, warm, start, rows, attempts = time.perf_counter(), None, None, [], []
    last = None
    for k, waypoint in enumerate(waypoints):
        targets = {f"target.{name}": path.stop(waypoint).numbers()}
        outcome, tries = solver.find(targets, start, warm)
        attempts += [(k, a) for a in tries]
        parameters = {**solver.posture.targets(), **targets}
        last = (outcome, parameters, k)
        if not outcome.status.solved:
            break
        rows.append((outcome, parameters))
        warm, start = outcome, outcome.values
        if progress:
            progress(k + 1, len(waypoints), f"{name} {k + 1}/{len(waypoints)}")
    seconds = time.perf_counter() - began
    result = solver.result(*last_outcome(last, attempts), seconds)
    return _gathered(solver, result, rows, len(waypoints), name, path)


def last_outcome(last, attempts):
    outcome, parameters, _ = last
    return outcome, [a for _, a in attempts], parameters


def _gathered(solver, result, rows, count, name, path):
    """The last waypoint's result with arrays and worst residuals over all waypoints."""
    f, question = solver.look.functions, solver.question
    q = np.array([o.values["q"] for o, _ in rows]).reshape(len(rows), question.robot.n)
    u = np.array([o.values["u"] for o, _ in rows]).reshape(len(rows), question.robot.m)
    pose = f.pose(path.on, path.at)
    tips = np.array([np.array(pose(row))[:3, 3] for row in q]).reshape(-1, 3)
    misses, forces = [], []
    for outcome, parameters in rows:
        misses.append(np.linalg.norm(solver.posture.misses(outcome.values["q"], parameters)[name][:3]))
        if result.status.outcome != "interrupted":  # who stops wants to wait no longer
            at = outcome.values["q"], outcome.values["u"]
            forces.append(solver.look.residuals(*at, solver.posture.free)["force"].value)
    residuals = {**result.residuals}
    if rows:
        residuals[f"goals.{name}"] = Value(float(max(misses)), "m")
    if forces:
        residuals["force"] = Value(float(max(forces)), "1")
    status = result.status
    if status.solved:
        status = Status("solved", f"All {count} waypoints solved.")
    else:
        status = Status(status.outcome, f"Waypoint {len(rows) + 1} of {count}: {status.message}")
    arrays = {**result.arrays, "path.q": q, "path.u": u, "path.tip": tips, "path.target": np.array(path.waypoints()),
              "path.miss": np.array(misses)}  # fmt: skip
    details = {**result.details, "waypoints": count, "waypoints_solved": len(rows)}
    return Result(**{**vars(result), "status": status, "arrays": arrays, "residuals": residuals, "details": details})
