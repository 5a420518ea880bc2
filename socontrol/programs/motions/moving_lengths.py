"""Inputs given by length in time: cables that motors wind, chambers that are filled, while the robot moves."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from socontrol.programs.equilibria.lengths import LengthQuestion, Routes, given_by_length, held, length_values
from socontrol.programs.motions.conditions import Conditions, Constrained
from socontrol.programs.motions.integrators import Cvodes
from socontrol.programs.motions.signals import Changing, history
from socontrol.programs.motions.ties import Ties
from socontrol.programs.result import Status, Value
from socontrol.quantities import Bad, joined, record

FITS = 1e-9  # of the robot's length: how well a start must fit given lengths
MENTIONED = 1e-3  # of the whole time: what is slack for less is not mentioned
SAMPLES = 1001  # times at which given lengths are looked at


@record(kw_only=True)
class MovingLengths(LengthQuestion):
    """A motion whose lengths, motors and volumes are values or histories (ramps and tables smoothed, as of joints)."""

    lengths: dict[str, Changing] | None = None
    motors: dict[str, Changing] | None = None
    volumes: dict[str, Changing] | None = None

    @cached_property
    def by_length(self):
        """[(Given, history of its length)] of the inputs that are given by length."""
        rows = [(row, history(row.raw, row.unit, row.path, motion=True)) for row in given_by_length(self)]
        return [(row, replace(h, value=lambda t, row=row, h=h: row.length(h.value(t)))) for row, h in rows]

    @cached_property
    def held(self):
        """Held: the inputs that are given by length, as they are at t = 0."""
        return self.held_at(0.0)

    def held_at(self, t):
        """Held: the inputs that are given by length, as they are at t."""
        rows = self.by_length
        return held(self.robot, [row for row, _ in rows], [float(h.value(t)) for _, h in rows])

    def constrained(self, plant):
        """The plant under the lengths that are given and the loops of its robot."""
        ties = Ties(plant.robot, plant.free) if plant.robot.loops else None
        if not self.by_length:
            return Constrained(plant, None, ties) if ties else plant
        held, histories = self.held, tuple(h for _, h in self.by_length)
        function = Routes(plant.robot).moving(held.index)
        own = held.names, held.pulls, held.flexibility, held.index, held.gain
        return Constrained(plant, Conditions(function, histories, *own), ties)

    def refuse_lengths(self):
        """Raise Bad where lengths do not go with the integrator, are none, or do not fit the start."""
        if not self.by_length:
            return
        if isinstance(self.solver, Cvodes):
            raise Bad("solver", "cvodes cannot hold lengths; use `radau`")
        for name in self.start.inputs or {}:
            if name in self.held.names:
                raise Bad(f"start.inputs.{name}", f"'{name}' is given by its length; leave this key out")
        for t in np.linspace(0.0, self.outputs[-1], SAMPLES):
            self.held_at(t)
        if not self.robot.loops and not self.start.settled:
            self.refuse_misfit(self.first_coordinates())

    def refuse_misfit(self, q):
        """Raise Bad where the lengths at the start q are not those that are given."""
        held, l = self.held, Routes(self.robot)(q)[0]
        gap = np.where(held.flexibility > 0, 0.0, held.gap(l, np.zeros(self.robot.m)))
        gap = np.where(held.pulls, np.minimum(gap, 0.0), gap)
        for (row, _), i, x in zip(self.by_length, held.index, gap, strict=True):
            if abs(x) > FITS * self.robot.length:
                long = f"{1e3 * l[i]:.7g} mm long at the start, but given {1e3 * (l[i] + x):.7g} mm"
                raise Bad(row.path, f"'{row.name}' is {long}; begin with `start: {{settled: true}}`")

    def with_lengths(self, result, march):
        """The result of a motion with the lengths of its lines, and for held ones how well and how long they are held.

        arrays: lengths [k x m]; details: held (names), changes (t, name, whether taut from then on), slack {name: s}.
        """
        robot, arrays = self.loaded, result.arrays
        if not robot.m or "q" not in arrays:
            return result
        t, end = arrays["t"], self.held_at(arrays["t"][-1])
        routes = robot.functions(compiled=False).actuator_lengths.function
        lengths = np.array([np.array(routes(q)).ravel() for q in (arrays["q"] if end else arrays["q"][-1:])])
        values = {key: Value(*pair) for key, pair in length_values(robot, lengths[-1], arrays["u"][-1], end).items()}
        if not end:
            return replace(result, values={**result.values, **values})
        for i, name in zip(end.index, end.names, strict=True):
            values[f"inputs.{name}"] = Value(float(arrays["u"][-1, i]), robot.input_units[i])
        gaps = np.array([self.held_at(x).gap(l, u) for x, l, u in zip(t, lengths, arrays["u"], strict=True)])
        missed = np.where(end.pulls & (arrays["u"][:, end.index] <= 0), np.minimum(gaps, 0.0), gaps)
        slack = _slack(march.changes, end.names, t[-1])
        details = {**result.details, "held": list(end.names), "changes": march.changes, "slack": slack}
        status, most = result.status, [f"{name} ({x:.3g} s)" for name, x in slack.items() if x > MENTIONED * t[-1]]
        if most:
            status = Status(status.outcome, f"{status.message} Slack for a time: {joined(most, 'and')}.")
        residuals = {**result.residuals, "lengths": Value(float(np.max(np.abs(missed))), "m")}
        return replace(result, status=status, values={**result.values, **values}, residuals=residuals, details=details,
                       arrays={**arrays, "lengths": lengths})  # fmt: skip


def _slack(changes, names, stop):
    """{name: time [s] that it was slack}, from its changes in order; all are taut before the first."""
    total, since = dict.fromkeys(names, 0.0), {}
    for t, name, taut in changes:
        if taut:
            total[name] += t - since.pop(name, t)
        else:
            since.setdefault(name, t)
    for name, t in since.items():
        total[name] += stop - t
    return total
