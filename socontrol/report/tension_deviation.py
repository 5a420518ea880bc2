"""How far a motion simulated again under its tensions is from the motion that was wanted; in SI."""

from dataclasses import dataclass

import numpy as np

from socontrol.programs.postures.goals import Path
from socontrol.report import shapes


@dataclass(frozen=True)
class Deviation:
    """distances [K x j] of `names` over the times t [K] that the simulation reached."""

    t: np.ndarray
    names: tuple
    distances: np.ndarray

    @property
    def worst(self):
        """(name, time, distance) of the largest one."""
        k, j = np.unravel_index(int(np.argmax(self.distances)), self.distances.shape)
        return self.names[j], float(self.t[k]), float(self.distances[k, j])


def of_ends(result):
    """Deviation of the ends of the robot, None without a simulation."""
    arrays, robot = result.arrays, result.question.robot
    names = [name for name in shapes.ends(robot) if f"replay.{name}.position" in arrays]
    return _measured(result, {name: arrays[f"{name}.position"] for name in names},
                     {name: arrays[f"replay.{name}.position"] for name in names})  # fmt: skip


def of_path(result):
    """Deviation of the tracked point from where it was wanted, None without a path or a simulation."""
    goal, found = tracked(result), replayed(result)
    if goal is None or found is None or "target" not in result.arrays:
        return None
    name = f"end of {goal.on}" if goal.at == 1 else f"{goal.on} at {goal.at:g}"
    return _measured(result, {name: result.arrays["target"]}, {name: found})


def tracked(result):
    """The path among the goals, or None."""
    asked = (getattr(result.question, "goals", None) or {}).values()
    return next((goal for goal in asked if isinstance(goal, Path)), None)


def replayed(result):
    """Positions [K x 3] of the tracked point in the simulation, or None."""
    goal, arrays = tracked(result), result.arrays
    if goal is None or f"replay.{goal.on}.position" not in arrays:
        return None
    if goal.at == 1:
        return np.asarray(arrays[f"replay.{goal.on}.position"])
    return np.array([shapes.Posed(result.question.loaded, q).place(goal.on, goal.at)[:3, 3]
                     for q in arrays["replay.q"]])  # fmt: skip


def _measured(result, wanted, found):
    if not wanted:
        return None
    count = min(len(a) for a in (result.arrays["t"], *wanted.values(), *found.values()))
    parts = [np.linalg.norm(np.asarray(wanted[name])[:count] - np.asarray(found[name])[:count], axis=1)
             for name in wanted]  # fmt: skip
    distances = np.column_stack(parts)
    if not count or not np.all(np.isfinite(distances)):
        return None
    return Deviation(np.asarray(result.arrays["t"])[:count], tuple(wanted), distances)
