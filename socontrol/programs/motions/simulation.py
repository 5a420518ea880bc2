"""Problem type `simulation`: inputs, loads and driven joints are given in time, the motion is found."""

import time
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.equilibria.least_energy import rest_of
from socontrol.programs.looks.answer import Look, collapsed, spread
from socontrol.programs.motions.charts import Charts
from socontrol.programs.motions.closed_start import Beginning, Begun
from socontrol.programs.motions.conditions import Constrained
from socontrol.programs.motions.cvodes import CvodesMarch
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.held_march import HeldMarcher
from socontrol.programs.motions.integrators import INTEGRATORS, Cvodes, Duration, Marcher, Radau
from socontrol.programs.motions.loop_answer import with_loops
from socontrol.programs.motions.massless import refuse_massless
from socontrol.programs.motions.motion_answer import answered
from socontrol.programs.motions.moving_lengths import MovingLengths
from socontrol.programs.motions.plant import Plant
from socontrol.programs.motions.signals import Changing, history
from socontrol.programs.question import Bounds, Guess, Named, read
from socontrol.programs.result import Result, Status
from socontrol.quantities import Bad, Either, Flag, nearest, record

MOST_OUTPUTS = 200_000
RESTING = 200  # iterations at most to the shape at rest
SAMPLES = 2001  # times at which a given motion is held against the limits of its joint


@record(kw_only=True)
class Times:
    """From 0 to `stop`, with an output `every` so often."""

    stop: Duration
    every: Duration

    def __post_init__(self):
        if self.every > self.stop:
            raise Bad("every", f"{self.every:g} s is beyond stop: {self.stop:g} s")
        if self.stop / self.every > MOST_OUTPUTS:
            raise Bad("every", f"{self.stop / self.every:.3g} outputs; at most {MOST_OUTPUTS}")

    def outputs(self):
        """Times [k] from 0 to stop."""
        count = int(np.ceil(self.stop / self.every * (1 - 1e-12)))
        return np.minimum(np.arange(count + 1) * self.every, self.stop)


@record(kw_only=True)
class Start:
    """The state at t = 0: coordinates and rates by name, 0 where none is given. `settled`: the shape at rest under
    `inputs` (default: those at t = 0) and the loads of t = 0, found first; `coordinates` are then its guess. Loops are
    closed by moving those that are not named, and where that is not enough all that are not driven."""

    coordinates: Named | None = None
    rates: Named | None = None
    settled: Flag = False
    inputs: Named | None = None

    def __post_init__(self):
        if self.inputs is not None and not self.settled:
            raise Bad("inputs", "these are for `settled: true`; the inputs of the motion stand under the top `inputs`")


@record(kw_only=True)
class Simulation(MovingLengths):
    """How does the robot move? `inputs` and `coordinates` (driven joints) by name, values or histories; so are the
    `lengths`, `motors` and `volumes` of inputs that are given by length; `load_factors`: what multiplies a load's force
    and moment in time. `solver`: an integrator."""

    times: Annotated[Any, Either(Times, tuple[Duration, ...])]
    solver: Any = Radau()
    start: Start = Start()
    inputs: dict[str, Changing] | None = None
    coordinates: dict[str, Changing] | None = None
    load_factors: dict[str, Changing] | None = None
    discretisation: Flag = False
    solvers = INTEGRATORS
    knows_loops = True

    def read_given(self):
        """Raise Bad unless names, units and times of what is given fit the robot."""
        self.named("coordinates", self.start.coordinates, "start.coordinates")
        self.named("inputs", self.start.inputs, "start.inputs")
        self._rates()
        if self.guess != Guess():
            raise Bad("guess", "a motion has a start, not a guess; write `start:`")
        if self.bounds != Bounds():
            raise Bad("bounds", "a motion goes where it goes; bounds are for optimisation (a joint's `limits` stop it)")
        self._refuse_start_of_driven()
        if names := collapsed(self.robot, self.first_coordinates()):
            raise Bad("start.coordinates", f"section {names[0]} is collapsed or turns too far at the start")
        if isinstance(self.solver, Cvodes) and len(self.driven) == self.robot.n:
            raise Bad("solver", "all coordinates are driven, so nothing is left to integrate; use `radau`")
        if isinstance(self.solver, Cvodes) and self.robot.loops:
            raise Bad("solver", "cvodes would let the loops drift open; use `radau`")
        self._refuse_early_ends()
        self._refuse_beyond_limits()
        self.refuse_lengths()

    def first_coordinates(self):
        """q [n] at t = 0 as the file gives it."""
        q = self.vector("coordinates", self.start.coordinates, "start.coordinates")
        for i, given in self.driven.items():
            q[i] = float(given.value(0.0))
        return q

    def _rates(self):
        """qd [n] at t = 0."""
        units, qd = self.robot.coordinate_units, np.zeros(self.robot.n)
        for name, raw in (self.start.rates or {}).items():
            i = self._index("coordinates", name, f"start.rates.{name}")
            qd[i] = read(raw, f"{units[i]}/s", f"start.rates.{name}")
        return qd

    def _index(self, key, name, path):
        """Place of an input or coordinate by name; raises Bad at `path`."""
        names = getattr(self.robot, key)
        if name not in names:
            raise Bad(path, f"the robot has no {key[:-1]} '{name}'{nearest(name, names)}")
        return names.index(name)

    @cached_property
    def outputs(self):
        """Times [k] at which the motion is wanted, the first 0."""
        if isinstance(self.times, Times):
            return self.times.outputs()
        if not self.times:
            raise Bad("times", "the list is empty; give `stop` and `every`, or times")
        for k, (a, b) in enumerate(zip((0.0, *self.times), self.times, strict=False)):
            if not b > a:
                raise Bad(f"times.{k}", f"{b:g} s does not come after {a:g} s; times must rise")
        return np.array([0.0, *self.times])

    @cached_property
    def _inputs(self):
        """History of every input."""
        given, robot = dict(self.inputs or {}), self.robot
        for name in given:
            self._index("inputs", name, f"inputs.{name}")
        return [history(given.get(name, 0.0), unit, f"inputs.{name}")
                for name, unit in zip(robot.inputs, robot.input_units, strict=True)]  # fmt: skip

    @cached_property
    def driven(self):
        """{index: history} of the coordinates that motors move as given."""
        robot, found = self.robot, {}
        for name, given in (self.coordinates or {}).items():
            i = self._index("coordinates", name, f"coordinates.{name}")
            found[i] = history(given, robot.coordinate_units[i], f"coordinates.{name}", motion=True)
        return found

    @cached_property
    def factors(self):
        """{name: history} of the loads that change in time."""
        loads, found = self.loaded.description.loads or {}, {}
        for name, given in (self.load_factors or {}).items():
            if name not in loads:
                raise Bad(f"load_factors.{name}", f"there is no load '{name}'{nearest(name, loads)}")
            if not hasattr(loads[name], "force"):
                raise Bad(f"load_factors.{name}", f"'{name}' is no force or moment that a factor could multiply")
            found[name] = history(given, "1", f"load_factors.{name}")
        return found

    def _refuse_early_ends(self):
        stop, robot = self.outputs[-1], self.robot
        rows = [(f"inputs.{name}", h) for name, h in zip(robot.inputs, self._inputs, strict=True)]
        rows += [(f"coordinates.{robot.coordinates[i]}", h) for i, h in self.driven.items()]
        rows += [(f"load_factors.{name}", h) for name, h in self.factors.items()]
        rows += [(row.path, h) for row, h in self.by_length]
        for path, given in rows:
            if given.end < stop * (1 - 1e-9):
                raise Bad(f"{path}.times", f"the table ends at {given.end:g} s, before the motion does, at {stop:g} s")
            if given.start > 0:
                raise Bad(f"{path}.times", f"the table begins at {given.start:g} s, after the motion does, at 0 s")

    def _refuse_start_of_driven(self):
        for key in ("coordinates", "rates"):
            for name in getattr(self.start, key) or {}:
                if name in (self.coordinates or {}):
                    raise Bad(f"start.{key}.{name}", f"'{name}' is driven; its history under `coordinates` says this")

    def _refuse_beyond_limits(self):
        """Raise Bad for a given motion that leaves the limits of its joint, and for a start outside of them."""
        lower, upper = self.coordinate_limits(strains=False)
        for i in self.named("coordinates", self.start.coordinates, "start.coordinates"):
            name, value = self.robot.coordinates[i], self.first_coordinates()[i]
            if not lower[i] - 1e-9 <= value <= upper[i] + 1e-9:
                between = f"[{lower[i]:g}, {upper[i]:g}]"
                raise Bad(f"start.coordinates.{name}", f"{value:g} is outside the limits of the joint, {between}")
        t = np.linspace(0.0, self.outputs[-1], SAMPLES)
        for i, given in self.driven.items():
            name, unit = self.robot.coordinates[i], self.robot.coordinate_units[i]
            values = np.array([float(given.value(x)) for x in np.union1d(t, [b for b in given.breaks if b <= t[-1]])])
            for value, limit, beyond in ((values.min(), lower[i], -1), (values.max(), upper[i], 1)):
                if beyond * (value - limit) > 1e-9 * max(1.0, abs(limit)):
                    side = "above" if beyond > 0 else "below"
                    sentence = f"the motion reaches {value:.6g} {unit}, {side} the joint's limit of {limit:.6g} {unit}"
                    raise Bad(f"coordinates.{name}", sentence)

    def solve(self, progress=None):
        """The motion as a Result, its energies held against the work done."""
        began, robot = time.perf_counter(), self.loaded
        plant = Plant(robot, self._inputs, self.driven, self.factors)
        begun = self._begun(plant, self.first_coordinates(), self._rates())
        if begun.status is not None:
            return Result(name=self.name, type="simulation", status=begun.status, question=self)
        refuse_massless(plant, begun.q, begun.balance)
        if robot.loops and self.by_length and not self.start.settled:
            self.refuse_misfit(begun.q)
        plant = self.constrained(plant)
        march = self._march(plant, begun.q, begun.qd, progress)
        try:
            result = self.with_lengths(answered(self, plant, march, time.perf_counter() - began), march)
            result = with_loops(result, plant, march, begun)
        except KeyboardInterrupt:
            status = Status("interrupted", "Stopped by the user after the motion; its states alone are kept.")
            arrays = {key: np.array(getattr(march, key)) for key in ("t", "q", "qd")}
            return Result(name=self.name, type="simulation", status=status, question=self, arrays=arrays)
        if self.discretisation and result.status.solved:
            changes = self._doubled(result, progress)
            result = replace(result, details={**result.details, "discretisation": changes})
        return result

    def _march(self, plant, q, qd, progress):
        if isinstance(self.solver, Cvodes):
            return CvodesMarch(plant, self.solver, self.outputs, Charts(plant.robot, plant.driven)).run(q, qd, progress)
        weights = displacement_weights(plant.robot)
        kind = HeldMarcher if isinstance(plant, Constrained) else Marcher
        return kind(plant, self.solver, self.outputs, weights, plant.robot.length).run(q, qd, progress)

    def _begun(self, plant, q, qd):
        """Begun: the state at t = 0 for one that is given, at rest if asked for, loops closed."""
        robot, paths = plant.robot, plant.functions.parameters
        parameters = plant.parameters(0.0)
        p = parameters[0] if parameters else None
        if self.start.settled:
            q, status = self._settled(plant, q, p)
            if status is not None:
                return Begun(q, qd, status)
        if not robot.loops:
            return Begun(q, qd)
        driven = np.zeros(robot.n, dtype=bool)
        driven[plant.driven] = True
        named = {} if self.start.settled else self.start.coordinates
        kept = [[robot.coordinates.index(name) for name in given or {} if name in robot.coordinates]
                for given in (named, self.start.rates)]  # fmt: skip
        plant.place(0.0, q, qd)
        return Beginning(robot, driven, paths, p).begun(q, qd, *kept)

    def _settled(self, plant, q, p):
        """(q [n] at rest at t = 0, None), or (q, status) where no rest shape is found."""
        u = self.vector("inputs", self.start.inputs, "start.inputs") if self.start.inputs else plant.inputs(0.0)
        robot, paths = replace(plant.robot, compiled=False), plant.functions.parameters  # solved once
        balance = balance_of(robot, self.held, paths)
        guessed = bool(self.held or self.start.coordinates) or not Look(self, balance).conservative(u)
        prescribed = {int(i): q[i] for i in plant.driven}
        answer = rest_of(balance, u, q, prescribed, RESTING, guessed=guessed, p=p)[0]
        if answer.status.solved:
            return answer.q, None
        return q, Status(answer.status.outcome, f"No shape at rest to start from. {answer.status.message}")

    def _doubled(self, result, progress):
        """Largest change in time of each end's position when every section is halved, in metres; None if that fails."""
        robot, fine = self.loaded, self.loaded.refined(sections=2)
        if fine.n == robot.n:
            return {}
        driven = {}
        for i, given in self.driven.items():
            marks = np.zeros(robot.n)
            marks[i] = 1.0
            driven |= {int(k): given for k in np.flatnonzero(spread(robot, fine, marks))}
        plant = Plant(fine, self._inputs, driven, self.factors)
        begun = self._begun(plant, *(spread(robot, fine, result.arrays[key][0]) for key in ("q", "qd")))
        if begun.status is not None:
            return None
        march = self._march(self.constrained(plant), begun.q, begun.qd, progress)
        if not march.status.solved:
            return None
        changes = {}
        for segment in robot.segments:
            pose = fine.functions().pose(segment, 1.0).function
            there = np.array([np.array(pose(x))[:3, 3] for x in march.q])
            changes[segment] = float(np.max(np.linalg.norm(there - result.arrays[f"{segment}.position"], axis=1)))
        return changes
