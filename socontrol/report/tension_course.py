"""Cables as words and figures need them: slack ones, lengths of the straight robot, courses of tensions; all in SI.

A course is a path of postures, waypoint by waypoint or timed, or a motion: inputs and lengths row by row.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.report.plan_limits import Quantity, limits
from socontrol.report.units import QUANTITY

WITHIN = 3.0  # of the range of inputs, lengths and rates: limits further off are not drawn
SLACK = 2e-5  # of the largest tension allowed: less does not show in five digits


def tendons(robot):
    """Indices of the inputs that are tensions of cables."""
    return np.flatnonzero(robot.pulls).tolist()


def lines(robot):
    """Indices of the inputs of cables and chambers: those that have a length."""
    return [k for k, unit in enumerate(robot.input_units) if robot.pulls[k] or unit == "Pa"]


def kind_of(result):
    """posture, path or motion of a result of tensions, "" of others; a motion whose path was not solved is a path."""
    kind = result.details.get("kind", "") if result.type == "tensions" else ""
    return "path" if kind == "motion" and np.ndim(result.arrays.get("q")) == 1 else kind


def title_of(robot, k):
    """What the k-th input is: tension, pressure, torque ..."""
    return "tension" if k in tendons(robot) else QUANTITY.get(robot.input_units[k], "input")


def slack(question, u):
    """Whether each cable is slack [... x m] at inputs u [... x m]; False for what is no cable."""
    u, robot, upper = np.asarray(u, dtype=float), question.robot, question.input_limits()[1]
    chosen, found = tendons(robot), np.zeros(np.shape(u), dtype=bool)
    largest = float(np.max(np.abs(u[..., chosen]), initial=0.0))
    for k in chosen:
        found[..., k] = u[..., k] <= SLACK * (upper[k] if np.isfinite(upper[k]) and upper[k] > 0 else largest)
    return found


@dataclass(frozen=True)
class Course:
    """t [K]: times, or numbers of waypoints from 1 where there are none; u, lengths [K x m] of the robot's inputs."""

    result: object
    t: np.ndarray
    timed: bool
    u: np.ndarray
    lengths: np.ndarray | None

    @classmethod
    def of(cls, result):
        """Course of a path or a motion, None without numbers."""
        arrays, moving = result.arrays, np.ndim(result.arrays.get("q")) == 2
        u, lengths, t = (arrays.get(key if moving else f"path.{key}") for key in ("u", "lengths", "t"))
        if result.question is None or u is None or not len(u) or not np.all(np.isfinite(u)):
            return None
        u = np.reshape(u, (len(u), -1))
        timed = t is not None
        t = np.asarray(t, dtype=float)[: len(u)] if timed else np.arange(1.0, len(u) + 1)
        return cls(result, t, timed, u, None if lengths is None else np.reshape(lengths, u.shape))

    @property
    def moving(self):
        """Whether it is a motion, of samples, and not a path, of waypoints."""
        return np.ndim(self.result.arrays["q"]) == 2

    def thinned(self, count=3000):
        """Indices of at most `count` rows, first and last among them."""
        return np.unique(np.round(np.linspace(0, len(self.t) - 1, count)).astype(int))

    def tensions(self):
        """[Quantity] of the inputs, one a kind."""
        robot, ends = self.result.question.robot, self.result.question.input_limits()
        return self._by_title(lambda k: title_of(robot, k), robot.input_units, self.u, ends)

    def changes(self):
        """[Quantity] of the lengths of cables and chambers less those of the straight robot."""
        if self.lengths is None:
            return []
        question, rest = self.result.question, self.result.question.robot.straight_lengths
        ends = [end - rest for end in self._limits("lengths", question.robot.length_units)]
        return self._by_title(lambda k: "change of\nlength", question.robot.length_units, self.lengths - rest, ends,
                              lines(question.robot))  # fmt: skip

    def rates(self):
        """(Course of the middles between rows, [Quantity] of rates of inputs and of lengths on the way to each row)."""
        robot, steps = self.result.question.robot, np.diff(self.t)[:, None]
        if not self.timed or not np.all(steps > 0):
            return self, []
        units = [tuple(f"{unit}/s" for unit in own) for own in (robot.input_units, robot.length_units)]
        found = self._by_title(lambda k: f"{title_of(robot, k)} rate", units[0], np.diff(self.u, axis=0) / steps,
                               self._limits("input_rates", units[0]))  # fmt: skip
        if self.lengths is not None:
            found += self._by_title(lambda k: "length rate", units[1], np.diff(self.lengths, axis=0) / steps,
                                    self._limits("length_rates", units[1]), lines(robot))  # fmt: skip
        middles = self.t[:-1] + steps[:, 0] / 2
        return Course(self.result, middles, True, self.u[1:], None), found

    def _limits(self, key, units):
        question, known = self.result.question, getattr(self.result.question, "limits", None)
        if getattr(known, key, None) is None:
            return np.full(len(units), -np.inf), np.full(len(units), np.inf)
        return limits(question, key, question.robot.inputs, units)

    def _by_title(self, title, units, values, ends, chosen=None):
        """Columns of `values`, or the `chosen` ones, that share a title and a unit, as Quantities."""
        names, found = self.result.question.robot.inputs, {}
        for k in range(len(units)) if chosen is None else chosen:
            found.setdefault((title(k), units[k]), []).append(k)
        return [Quantity(name, tuple(names[k] for k in own), (unit,) * len(own), values[:, own],
                         *(np.asarray(end)[own] for end in ends), within=WITHIN)
                for (name, unit), own in found.items()]  # fmt: skip
