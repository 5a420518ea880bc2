"""Problem type `trajectory`: which motion and inputs do this, within the limits, at the least cost?"""

import time
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from socontrol.programs.motions.integrators import Duration
from socontrol.programs.nlp.fatrop import Fatrop
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.plans.moments import End, Start, Waypoint
from socontrol.programs.plans.motion_limits import MotionLimits
from socontrol.programs.plans.obstacles import Obstacle
from socontrol.programs.plans.plan_costs import Effort, InputRate, PlanCost, Time
from socontrol.programs.plans.plan_guess import PlanGuess
from socontrol.programs.plans.plan_settings import FreeDuration, Mesh, Outputs, Replay
from socontrol.programs.plans.planning import plan
from socontrol.programs.plans.transcription import Span
from socontrol.programs.postures.goals import locate
from socontrol.programs.question import Question, read
from socontrol.quantities import Bad, Either, Flag, nearest, record

SAMPLES, MOST_SAMPLES = 200, 100_000
SHORTEST_LEG = 1e-3  # between two waypoints, of the duration
RATE = 0.1  # weight of the rates of inputs beside their effort where no cost is asked for


@record(kw_only=True)
class Trajectory(Question):
    """Which motion and inputs do this, within the limits, at the least cost?

    quasi_static: an equilibrium at every instant, for motions so slow that masses do not matter.
    scaled: unknowns and equations are scaled by the robot's own magnitudes.
    """

    duration: Annotated[Any, Either(Duration, FreeDuration)]
    mesh: Mesh = Mesh()
    start: Start = Start()
    end: End = End()
    waypoints: dict[str, Waypoint] | None = None
    obstacles: dict[str, Obstacle] | None = None
    limits: MotionLimits = MotionLimits()
    costs: dict[str, PlanCost] | None = None
    guess: PlanGuess = PlanGuess()
    outputs: Outputs | None = None
    replay: Replay = Replay()
    quasi_static: Flag = False
    scaled: Flag = True
    solver: Any = Ipopt(tolerance=1e-8, max_iterations=500)
    discretisation: Flag = False
    solvers = {"ipopt": Ipopt, "fatrop": Fatrop}
    optimises = True
    hessians = ("exact", "gauss_newton")

    def __post_init__(self):
        super().__post_init__()
        if self.discretisation:
            raise Bad("discretisation", "a plan has `mesh.halved`, which solves again with half the intervals")
        if not self.robot.m:
            raise Bad("robot", "the robot has no actuators, so nothing can be planned; add `actuators:` to its file")
        if self.continuous and self.mesh.inputs == "constant":
            raise Bad("mesh.inputs", "constant inputs have no rates: use linear, or give `costs` without input_rate")
        self.moments  # noqa: B018  refuses what cannot be
        self._refuse_unknown()
        self._refuse_outside()

    def read_given(self):
        self.named("coordinates", self.coordinates)
        self.named("inputs", self.inputs)
        self.named("coordinates", self.start.coordinates, "start.coordinates")
        self.named("inputs", self.start.inputs, "start.inputs")
        self.rates(self.start.rates, "start.rates")
        self.guess.check(self.robot)

    def first_coordinates(self):
        """q [n] at t = 0 as the file gives it."""
        q = self.vector("coordinates", self.start.coordinates, "start.coordinates")
        for i, value in self.named("coordinates", self.coordinates).items():
            q[i] = value
        return q

    def rates(self, values, path):
        """{index: SI value} of rates by name of a coordinate."""
        found, names = {}, self.robot.coordinates
        for name, raw in (values or {}).items():
            if name not in names:
                raise Bad(f"{path}.{name}", f"the robot has no coordinate '{name}'{nearest(name, names)}")
            i = names.index(name)
            found[i] = read(raw, f"{self.robot.coordinate_units[i]}/s", f"{path}.{name}")
        return found

    @cached_property
    def span(self):
        if not isinstance(self.duration, FreeDuration):
            return Span.fixed(self.duration)
        given = self.duration
        return Span(given.guess or np.sqrt(given.shortest * given.longest), given.shortest, given.longest)

    @cached_property
    def _passages(self):
        """(share of the duration, name) of the waypoints, in order of time."""
        rows = []
        for name, waypoint in (self.waypoints or {}).items():
            if waypoint.time is not None and self.span.free:
                raise Bad(f"waypoints.{name}.time", "the duration is free; give `share`, a part of it")
            share = waypoint.share if waypoint.share is not None else waypoint.time / self.span.guess
            if not share < 1 - 1e-9:
                raise Bad(f"waypoints.{name}.time" if waypoint.time else f"waypoints.{name}.share",
                          "it is not before the end; what holds there stands under `end`")  # fmt: skip
            rows.append((share, name))
        rows.sort()
        for (a, _), (b, name) in zip(rows, rows[1:], strict=False):
            if b - a < 1e-9:
                raise Bad(f"waypoints.{name}", "two waypoints at one time; join them")
        ends = [(0.0, "start"), *rows, (1.0, "end")]
        for (a, before), (b, after) in zip(ends, ends[1:], strict=False):
            if b - a < SHORTEST_LEG:
                name = after if after in (self.waypoints or {}) else before
                told = f"less than {SHORTEST_LEG:g} of the duration lies between {before} and {after}"
                raise Bad(f"waypoints.{name}", f"{told}; move them apart")
        if len(rows) >= self.mesh.intervals:
            raise Bad("mesh.intervals", f"{self.mesh.intervals} intervals; {len(rows)} waypoints want more")
        return rows

    @cached_property
    def _legs(self):
        """Intervals of each leg between waypoints: as alike in length as their number allows."""
        ends = np.array([0.0, *(share for share, _ in self._passages), 1.0])
        lengths, counts = np.diff(ends), np.ones(ends.size - 1, dtype=int)
        while counts.sum() < self.mesh.intervals:
            counts[np.argmax(lengths / counts)] += 1
        return lengths, counts

    @cached_property
    def shares(self):
        """Parts [N] of the duration: the intervals, with a node at every waypoint."""
        return np.concatenate([np.full(count, length / count) for length, count in zip(*self._legs, strict=True)])

    @cached_property
    def moments(self):
        """(path, node, record) of the waypoints and the end."""
        nodes = np.cumsum(self._legs[1])
        rows = [(f"waypoints.{name}", int(k), self.waypoints[name])
                for (_, name), k in zip(self._passages, nodes[:-1], strict=True)]  # fmt: skip
        return [*rows, ("end", int(nodes[-1]), self.end)]

    @property
    def all_costs(self):
        """By name; where none is asked for, effort and rates of inputs: effort alone lets robots swing at the end."""
        return self.costs or {"effort": Effort(), "rate": InputRate(weight=RATE)}

    @property
    def input_shape(self):
        """Of inputs in an interval; with one point that jump at nodes there is nothing a slope could come from."""
        alone = self.mesh.scheme == "radau" and self.mesh.points == 1 and not self.continuous
        return "constant" if self.mesh.inputs == "linear" and alone else self.mesh.inputs

    @property
    def continuous(self):
        """Whether inputs have rates, so that they may not jump."""
        return bool(self.limits.input_rates) or any(cost.continuous for cost in self.all_costs.values())

    @cached_property
    def free(self):
        """Mask [n] of coordinates that are not given for the whole time."""
        mask = np.ones(self.robot.n, dtype=bool)
        mask[list(self.named("coordinates", self.coordinates))] = False
        return mask

    def output_times(self, duration):
        """Times [K] of what is stored."""
        if self.outputs is None:
            return np.linspace(0.0, duration, SAMPLES + 1)
        count = min(int(np.ceil(duration / self.outputs.every * (1 - 1e-9))), MOST_SAMPLES)
        return np.minimum(np.arange(count + 1) * self.outputs.every, duration)

    def _refuse_unknown(self):
        """Raise Bad for names and places the robot does not have."""
        robot = self.robot
        for path, _, moment in self.moments:
            for key in ("coordinates", "inputs"):
                self.named(key, getattr(moment, key), f"{path}.{key}")
            self.rates(moment.rates, f"{path}.rates")
            for name, goal in (moment.goals or {}).items():
                _located(robot, goal, f"{path}.goals.{name}")
        for name, speed in (self.limits.speeds or {}).items():
            _located(robot, speed, f"limits.speeds.{name}")
        for name, cost in self.all_costs.items():
            if hasattr(cost, "on"):
                _located(robot, cost, f"costs.{name}")
            if isinstance(cost, Time) and not self.span.free:
                raise Bad(f"costs.{name}", "the duration is given; free it: `duration: {shortest: ..., longest: ...}`")
        for key, names, units in (("rates", robot.coordinates, robot.coordinate_units),
                                  ("input_rates", robot.inputs, robot.input_units)):  # fmt: skip
            self.limits.ranges(key, names, [f"{unit}/s" for unit in units])
        if self.quasi_static:
            for path, holder in [("start", self.start), *((path, moment) for path, _, moment in self.moments)]:
                if holder.rates:
                    raise Bad(f"{path}.rates", "a quasi-static motion has no rates of its own; leave them out")
        for name, cost in self.all_costs.items():
            times, stop = getattr(cost, "times", None), self.span.guess
            if times and self.span.free:
                raise Bad(f"costs.{name}.times", "the duration is free; give a `circle`, or a duration")
            if times and not times[0] <= 0 <= stop <= times[-1] * (1 + 1e-9):
                told = f"the table goes from {times[0]:g} to {times[-1]:g} s, the motion from 0 to {stop:g} s"
                raise Bad(f"costs.{name}.times", told)
        self.limits.ranges("lengths", robot.inputs, robot.length_units)

    def _refuse_outside(self):
        """Raise Bad for given values outside of their limits."""
        (low, high), (least, most) = self.coordinate_limits(), self.input_limits()
        rows = [("start", self.start), *((path, moment) for path, _, moment in self.moments), ("", self)]
        for path, holder in rows:
            for key, lower, upper in (("coordinates", low, high), ("inputs", least, most)):
                if path == "start" and key == "coordinates" and self.start.is_settled:
                    continue  # a guess
                where = f"{path}.{key}".lstrip(".")
                for i, value in self.named(key, getattr(holder, key), where).items():
                    if not lower[i] - 1e-9 <= value <= upper[i] + 1e-9:
                        name, between = getattr(self.robot, key)[i], f"[{lower[i]:g}, {upper[i]:g}] (SI)"
                        raise Bad(f"{where}.{name}", f"{value:g} is outside its limits {between}")

        for path, holder in rows[:-1]:
            for key in ("coordinates", "inputs"):
                held = self.named(key, getattr(self, key))
                for i, value in self.named(key, getattr(holder, key), f"{path}.{key}").items():
                    if i in held and abs(value - held[i]) > 1e-9 * max(1.0, abs(value)):
                        told = f"{value:g} is given, but `{key}` holds it at {held[i]:g} the whole time (SI)"
                        raise Bad(f"{path}.{key}.{getattr(self.robot, key)[i]}", told)
        units = [f"{unit}/s" for unit in self.robot.coordinate_units]
        limits = self.limits.ranges("rates", self.robot.coordinates, units)
        for path, holder in rows[:-1]:
            for i, value in self.rates(holder.rates, f"{path}.rates").items():
                lowest, highest = limits.get(i, (-np.inf, np.inf))
                if not lowest - 1e-9 <= value <= highest + 1e-9:
                    name = self.robot.coordinates[i]
                    raise Bad(f"{path}.rates.{name}", f"{value:g} is outside its limits [{lowest:g}, {highest:g}] (SI)")

    def solve(self, progress=None):
        began = time.perf_counter()
        result = plan(self, progress)
        return replace(result, solver={**result.solver, "seconds": time.perf_counter() - began})


def _located(robot, record, path):
    try:
        locate(robot, record)
    except Bad as bad:
        raise Bad(f"{path}.{bad.key}", str(bad)) from None
