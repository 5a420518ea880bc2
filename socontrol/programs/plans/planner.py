"""A trajectory question as a program: transcription, limits, moments, obstacles and costs.

Every limit has a name. Where `loose` is set, a limit that a user could change has an unknown of its own by which it
gives way, and the sum of all of them, each over its size, is what is made small: it tells what to loosen.
"""

import casadi as ca
import numpy as np

from socontrol.mechanics.kinematics import Kinematics
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.motions.charts import is_singular, turning
from socontrol.programs.nlp.fatrop import Fatrop
from socontrol.programs.plans.giving import CHEAP, Giving, size_of
from socontrol.programs.plans.obstacles import clearances, moving
from socontrol.programs.plans.passages import Passages
from socontrol.programs.plans.schemes import scheme
from socontrol.programs.plans.transcription import Span, System, Transcription
from socontrol.programs.postures.goals import locate
from socontrol.quantities import Bad

CHART = 0.9 * 2 * np.pi  # |turn| of a joint whose coordinates are singular a full turn away
STRETCH = 20.0  # durations at most, where the duration may give way
TEMPO = 6.0  # a swing there and back in the whole duration has an angular rate of about this over the duration
CALM = 1e-3  # root of the weight of accelerations where masses do not matter
PER_SECTION = 2  # stations of a section that are held clear of obstacles


class Planner:
    """Expressions and program of one question. start: (q, v, u) at t = 0, u NaN where it may be any."""

    def __init__(self, question, start, *, loose=False):
        self.question, self.robot, self.start = question, question.loaded, start
        self.scales = scales(self.robot)
        self.functions = self.robot.functions(compiled=False)
        self.scheme = scheme(question.mesh.scheme, question.mesh.points)
        staged = isinstance(question.solver, Fatrop)
        hessian = getattr(question.solver, "hessian", "exact")
        span = question.span
        if loose:
            span = Span(span.guess, span.shortest, STRETCH * span.longest)
        self.transcription = Transcription(
            self._system(), self.scheme, question.shares, span, inputs=question.input_shape,
            continuous=question.continuous, staged=staged,
            hessian=hessian, tempo=span.guess / TEMPO if question.scaled else 1.0, halfway=bool(question.obstacles),
        )  # fmt: skip
        self.giving = Giving(self.transcription, loose)
        if loose:
            self._stretched()
        self._hold_given()
        self._limits()
        Passages(question, self.transcription, self.giving, self.scales.q).hold(start)
        self._charts()
        self._obstacles()
        self._costs()
        self._refuse_contradictions()

    @property
    def program(self):
        return self.transcription.program

    def kinematics(self, q):
        return Kinematics(self.robot.tree, q)

    def _system(self):
        n, m, question = self.robot.n, self.robot.m, self.question
        missing, free = self.functions.motion_residual.function, np.flatnonzero(question.free)
        still = question.quasi_static

        def residual(q, v, a, u):
            zero = ca.DM.zeros(n)
            return missing(q, zero, zero, u)[free.tolist()] if still else missing(q, v, a, u)[free.tolist()]

        s = self.scales
        if not question.scaled:
            return System(residual, np.ones(n), np.ones(m), np.ones(free.size))
        return System(residual, s.q, s.u, s.force[free])

    def _hold_given(self):
        """Coordinates and inputs that are given for the whole time."""
        t, question = self.transcription, self.question
        for i, value in question.named("coordinates", question.coordinates).items():
            for letter, number in (("q", value), ("v", 0.0), ("a", 0.0)):
                t.hold(letter, t.places(letter)[:, i], number, number)
        for i, value in question.named("inputs", question.inputs).items():
            t.hold("u", t.places("u")[:, i], value, value)

    def _limits(self):
        question, robot = self.question, self.robot
        rates = question.limits.ranges("rates", robot.coordinates, [f"{u}/s" for u in robot.coordinate_units])
        rows = [("coordinates", "q", robot.coordinates, robot.coordinate_units, question.coordinate_limits()),
                ("inputs", "u", robot.inputs, robot.input_units, question.input_limits())]  # fmt: skip
        for key, letter, names, units, (lower, upper) in rows:
            for i in np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)):
                own = names[i] in (getattr(question.bounds, key) or {})
                fixed = key == "coordinates" and not own and self.robot.joint_limits[i] == (-np.inf, np.inf)
                self.giving.range(f"{key}.{names[i]}", units[i], letter, i, lower[i], upper[i], fixed)
        for i, (low, high) in rates.items():
            name, unit = f"limits.rates.{robot.coordinates[i]}", f"{robot.coordinate_units[i]}/s"
            self.giving.range(name, unit, "v", i, low, high)
        self._input_rates()
        self._lengths()
        self._speeds()

    def _stretched(self):
        """The longest duration gives way."""
        longest, places = self.question.span.longest, {"T": self.transcription.node["T"][-1:]}
        self.giving.rows("duration", "s", places, lambda T: T, -np.inf, longest, longest, [self.transcription.N])

    def _input_rates(self):
        question, robot, t = self.question, self.robot, self.transcription
        units = [f"{u}/s" for u in robot.input_units]
        for i, (low, high) in question.limits.ranges("input_rates", robot.inputs, units).items():
            blocks, numbers, when, rate = t.rates_of_inputs()
            name, one = f"limits.input_rates.{robot.inputs[i]}", lambda *x, i=i, rate=rate: rate(*x)[i]
            self.giving.rows(name, units[i], blocks, one, low, high, size_of(low, high), when, numbers=numbers)

    def _lengths(self):
        robot = self.robot
        found = self.question.limits.ranges("lengths", robot.inputs, robot.length_units)
        if not found:
            return
        lengths, indices = self.functions.actuator_lengths.function, list(found)
        places, when = self._instants()
        for i in indices:
            low, high = found[i]
            name, one = f"limits.lengths.{robot.inputs[i]}", lambda q, i=i: lengths(q)[i]
            self.giving.rows(name, robot.length_units[i], {"q": places}, one, low, high, robot.length, when)

    def _instants(self):
        """Places [K x n] of q at all nodes and points, each once, and the intervals they belong to."""
        t = self.transcription
        points = t.point["q"].reshape(-1, t.system.n)
        when = np.repeat(np.arange(t.N), self.scheme.size)
        places = np.vstack([t.node["q"], points])
        when = np.concatenate([np.arange(t.N + 1), when])
        _, first = np.unique(places[:, 0], return_index=True)
        return places[first], when[first]

    def _speeds(self):
        t = self.transcription
        for name, speed in (self.question.limits.speeds or {}).items():
            frame = locate(self.robot, speed)

            def squared(q, v, frame=frame, largest=speed.largest):
                moves = self.kinematics(q).jacobian(frame)[3:, :] @ v
                return ca.sumsqr(moves) / largest**2

            first = 1 if self.scheme.shared else 0
            blocks = {x: np.vstack([t.point[x][:, first:].reshape(-1, t.system.n)]) for x in "qv"}
            when = np.repeat(np.arange(t.N), self.scheme.size - first)
            self.giving.rows(f"limits.speeds.{name}", "1", blocks, squared, -np.inf, 1.0, 1.0, when)

    def _charts(self):
        """Joints in exponential coordinates stay well inside the turn where these are singular."""
        places, when = self._instants()
        for piece in self.robot.tree.pieces:
            if is_singular(piece):
                phi = ca.DM(turning(piece))
                own = places[:, piece.columns]
                rows = lambda q, phi=phi: {"rows": ca.sumsqr(phi @ q) / CHART**2}  # noqa: E731
                self.program.add(f"chart of {piece.segment}", {"q": own}, rows, lower=-np.inf, upper=1.0, when=when)

    def _obstacles(self):
        obstacles = self.question.obstacles or {}
        if not obstacles:
            return
        t = self.transcription
        places, when = self._instants()
        between = t.halfway.reshape(-1, t.system.n)
        whens = np.repeat(np.arange(t.N), t.halfway.shape[1])
        places, when = np.vstack([places[1:], between]), np.concatenate([when[1:], whens])
        for name, obstacle in obstacles.items():
            looked = moving(self.robot, PER_SECTION, obstacle)
            if not looked:
                continue

            def clear(q, obstacle=obstacle, looked=looked):
                return clearances(self.robot, self.kinematics(q), obstacle, looked)

            size = self.robot.length
            self.giving.rows(f"obstacles.{name}", "m", {"q": places}, clear, 0.0, np.inf, size, when, CHEAP)

    def _costs(self):
        t = self.transcription
        if self.question.quasi_static:  # only q is determined at the points: the smoothest way between them
            scale = ca.DM(t.scales["a"])
            calm = lambda q, v, a, u, T, data: {"squares": CALM * ca.sqrt(T * data[-1]) * a / scale}  # noqa: E731
            t.at_points("calm", calm, weights=True)
        if self.giving.gives:
            return
        for name, cost in self.question.all_costs.items():
            cost.add(f"costs.{name}", self)


    def _refuse_contradictions(self):
        """Raise Bad where given values and limits leave nothing for an unknown."""
        t, robot = self.transcription, self.robot
        crossed = self.program.lower > self.program.upper + 1e-9 * np.abs(self.program.upper)
        rows = (("q", robot.coordinates, "coordinate"), ("v", robot.coordinates, "rate of coordinate"),
                ("u", robot.inputs, "input"))  # fmt: skip
        for letter, names, what in rows:
            places = t.places(letter)
            k, i = (index[:1] for index in np.nonzero(crossed[places]))
            if k.size:
                at, name = places[k[0], i[0]], names[i[0]]
                low, high = self.program.lower[at], self.program.upper[at]
                told = f"{what} '{name}' has to be at least {low:.6g} and at most {high:.6g} (SI) at one time"
                raise Bad("limits", f"{told}; what is given at start, waypoints or end contradicts a limit")
