"""Costs of a plan: each record adds parts to a transcription, made dimensionless by the robot's own magnitudes."""

from typing import Annotated, Any

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.programs.postures.goals import locate
from socontrol.programs.postures.waypoints import around
from socontrol.quantities import (
    Axis,
    Bad,
    Fraction,
    Length,
    Number,
    OneOf,
    Position,
    PositiveNumber,
    Second,
    record,
)


@record(kw_only=True)
class Effort:
    """Half the integral in time of the sum of squared inputs, each over its largest limit [s]."""

    weight: PositiveNumber = 1.0
    continuous = False

    def add(self, name, plan):
        scale, weight = ca.DM(plan.scales.u), self.weight

        def squares(q, v, a, u, T, data):
            return {"squares": ca.sqrt(weight * T * data[-1]) * u / scale}

        plan.transcription.at_points(name, squares, weights=True)


@record(kw_only=True)
class Time:
    """The duration [s]."""

    weight: PositiveNumber = 1.0
    continuous = False

    def add(self, name, plan):
        weight = self.weight
        plan.transcription.at_node(name, -1, lambda T: {"cost": weight * T}, letters="T")


@record(kw_only=True)
class InputRate:
    """Half the integral of squared rates of the inputs, each over its largest limit in the (guessed) duration [s]."""

    weight: PositiveNumber = 1.0
    continuous = True

    def add(self, name, plan):
        scale, weight = ca.DM(plan.scales.u) / plan.transcription.span.guess, self.weight

        def squares(ud, T, share):
            return {"squares": ca.sqrt(weight * T * share) * ud / scale}

        plan.transcription.input_rates(name, squares)


@record(kw_only=True)
class Smoothness:
    """Half the integral of squared accelerations, each over its scale (that of a swing once in the duration) [s]."""

    weight: PositiveNumber = 1.0
    continuous = False

    def add(self, name, plan):
        scale, weight = ca.DM(plan.transcription.scales["a"]), self.weight

        def squares(q, v, a, u, T, data):
            return {"squares": ca.sqrt(weight * T * data[-1]) * a / scale}

        plan.transcription.at_points(name, squares, weights=True)


@record(kw_only=True)
class Round:
    """A circle, run through at an even pace: `turns` from the direction nearest `start`."""

    center: Position
    radius: Length
    normal: Axis = (0.0, 0.0, 1.0)
    start: Axis = (1.0, 0.0, 0.0)
    turns: Number = 1.0

    def at(self, shares):
        """Positions [K x 3] at shares of the duration."""
        return around(self, 2 * np.pi * self.turns * np.asarray(shares))


@record(kw_only=True)
class Tracking:
    """Half the integral of the squared distance of a point from a moving target, over the robot's length [s].

    The target: `positions` at rising `times` (straight between them; in a file: `file`, comma-separated with columns
    t, x, y, z), or a `circle`. `lead_in`: this long at the beginning the distance does not count.
    """

    on: str
    at: Fraction = 1.0
    times: tuple[Second, ...] | None = None
    positions: tuple[Position, ...] | None = None
    circle: Round | None = None
    file: str | None = None
    lead_in: Second = 0.0
    weight: PositiveNumber = 1.0
    continuous = False

    def __post_init__(self):
        if self.file is not None:
            raise Bad("file", "a file is read with the problem that names it; from Python give times and positions")
        if (self.circle is None) == (self.times is None):
            raise Bad("times", "give `times` and `positions`, or a `circle`")
        if self.times is not None and (len(self.times) < 2 or len(self.times) != len(self.positions or ())):
            count = len(self.positions or ())
            raise Bad("positions", f"{len(self.times)} times and {count} positions; give two or more of both")
        for k, (a, b) in enumerate(zip(self.times or (), (self.times or ())[1:], strict=False), start=1):
            if not a < b:
                raise Bad(f"times.{k}", f"{b:g} s does not come after {a:g} s; times must rise")
        try:
            if self.circle is not None:
                self.circle.at([0.0])
        except Bad as bad:
            raise Bad(f"circle.{bad.key}", str(bad)) from None

    def target(self, shares, duration):
        """Positions [K x 3] at shares of the duration."""
        if self.circle is not None:
            return self.circle.at(shares)
        t, given = np.asarray(shares) * duration, np.array(self.positions)
        return np.column_stack([np.interp(t, self.times, given[:, i]) for i in range(3)])

    def add(self, name, plan):
        robot, transcription = plan.robot, plan.transcription
        frame, weight, length = locate(robot, self), self.weight, robot.length
        def squares(q, v, a, u, T, data):
            away = se3.position(plan.kinematics(q).frame_pose(frame)) - data[:3]
            return {"squares": ca.sqrt(weight * T * data[4]) * data[3] * away / length}

        shares = np.concatenate([[0.0], np.cumsum(transcription.shares)[:-1]])
        shares = (shares[:, None] + transcription.shares[:, None] * transcription.scheme.c).ravel()
        counts = (shares * transcription.span.guess >= self.lead_in).astype(float)
        numbers = np.column_stack([self.target(shares, transcription.span.guess), counts])
        transcription.at_points(name, squares, weights=True, numbers=numbers)


PLAN_COSTS = {
    "effort": Effort,
    "time": Time,
    "input_rate": InputRate,
    "tracking": Tracking,
    "smoothness": Smoothness,
}
PlanCost = Annotated[Any, OneOf(PLAN_COSTS, what="cost of a plan")]
