"""Inputs given by length: cables wound by motors, cables and chambers held, chambers filled with a volume.

An input whose lines have the length l(q) and that is given a length L obeys, with E A the cable's own stiffness,
    cable     0 <= T  perp  L + T L / (E A) - l(q) >= 0,       chamber   l(q) = L;
a motor's angle gives L = l(0) - radius angle, a volume L = volume / area. The unknown T (or pressure) is the input's.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from socontrol.mechanics.actuators import Chamber, Tendon
from socontrol.native.buffers import Buffered
from socontrol.programs.question import Named, Question, read
from socontrol.quantities import Bad, nearest, record

KEYS = ("lengths", "motors", "volumes")
SLACK = 1e-9  # of an input's size: a cable that pulls less holds nothing


@dataclass(frozen=True)
class Given:
    """One input given by `key`: the length is start + slope * what is given, which is in `unit`."""

    index: int
    name: str
    key: str
    raw: Any
    unit: str
    start: float
    slope: float

    @property
    def path(self):
        return f"{self.key}.{self.name}"

    def length(self, value):
        """Length [m] that a value in `unit` makes."""
        return self.start + self.slope * value


@dataclass(frozen=True)
class Held:
    """Inputs [k] held at lengths: index, name, length L [m] without tension, flexibility 1/(E A) [1/N], gain [N per
    unit of input: -1 of cables, the area of chambers], and whether they only pull. u is the tension at the motor."""

    index: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    names: tuple = ()
    length: np.ndarray = field(default_factory=lambda: np.zeros(0))
    flexibility: np.ndarray = field(default_factory=lambda: np.zeros(0))
    gain: np.ndarray = field(default_factory=lambda: np.zeros(0))
    pulls: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __bool__(self):
        return bool(self.names)

    def without(self, dropped):
        """The same without the inputs of indices `dropped`."""
        kept = ~np.isin(self.index, list(dropped))
        names = tuple(name for name, keep in zip(self.names, kept, strict=True) if keep)
        rest = (getattr(self, key)[kept] for key in ("length", "flexibility", "gain", "pulls"))
        return Held(self.index[kept], names, *rest)

    def slack(self, u, sizes):
        """Which cables [k] pull nothing at inputs u [m], whose sizes are given [m]."""
        return self.pulls & (np.abs(u[self.index]) <= SLACK * sizes[self.index])

    def holding(self, A, B, slack):
        """What the lengths hold with: stiffness [n x n] of cables that stretch, which are springs; slopes [r x n] and
        pushes [n x r] of those that do not. A [m x n]: slopes of all lengths, B [n x m] of the forces; slack [k]."""
        springs = ~slack & (self.flexibility > 0)
        own, soft = self.index[springs], (self.gain * self.flexibility * self.length)[springs]
        rigid = self.index[~slack & (self.flexibility == 0)]
        return (B[:, own] / soft) @ A[own], A[rigid], B[:, rigid]

    def gap(self, l, u):
        """L + u L / (E A) - l [k]: what a cable is too long by; l, u: of all inputs [m] or [m x 1] symbols."""
        own = self.index.tolist()
        return self.length * (1 + self.flexibility * u[own]) - l[own]


def given_by_length(question):
    """[Given] of all inputs that a question gives by length, in order of the inputs; raises Bad."""
    robot, found = question.robot, {}
    actuators, zero = robot.description.actuators or {}, None
    for key in KEYS:
        for name, raw in (getattr(question, key) or {}).items():
            if name not in robot.inputs:
                raise Bad(f"{key}.{name}", f"the robot has no input '{name}'{nearest(name, robot.inputs)}")
            index = robot.inputs.index(name)
            other = found[index].key if index in found else "inputs" if name in (question.inputs or {}) else None
            if other:
                raise Bad(f"{key}.{name}", f"'{name}' is given under `{other}` already; give it once")
            if zero is None:
                zero = robot.straight_lengths
            found[index] = Given(index, name, key, raw, *_rule(key, name, actuators.get(name), zero[index]))
    return [found[i] for i in sorted(found)]


def _rule(key, name, actuator, straight):
    """(unit, start, slope) of what is given under a key; raises Bad where the actuator knows no such thing."""
    if not isinstance(actuator, Tendon | Chamber):
        fix = "hold or drive its joint under `coordinates`" if hasattr(actuator, "joint") else "give its value"
        raise Bad(f"{key}.{name}", f"'{name}' is no cable and no chamber, so it has no length; {fix}")
    if key == "motors":
        if getattr(actuator, "spool", None) is None:
            raise Bad(f"motors.{name}", f"'{name}' has no `spool`; add the radius of its motor's drum to the robot")
        return "rad", straight, -float(actuator.spool)
    if key == "volumes":
        if not isinstance(actuator, Chamber):
            raise Bad(f"volumes.{name}", f"'{name}' is a cable; give its length, or the angle of its motor")
        return "m^3", 0.0, 1 / float(actuator.area)
    return "m", 0.0, 1.0


def held(robot, rows, lengths):
    """Held of the rows of `given_by_length` at lengths [k]; raises Bad for a length that is none."""
    for row, length in zip(rows, lengths, strict=True):
        if not length > 0:
            what = "winds in all of the cable" if row.key == "motors" else "is no length that could be held"
            raise Bad(row.path, f"this {what}: {length:g} m would be left")
    actuators = [(robot.description.actuators or {})[row.name] for row in rows]
    stiffness = [getattr(a, "stiffness", None) for a in actuators]
    return Held(
        np.array([row.index for row in rows], dtype=int),
        tuple(row.name for row in rows),
        np.array(lengths, dtype=float),
        np.array([0.0 if EA is None else 1 / float(EA) for EA in stiffness]),
        np.array([float(getattr(a, "area", -1.0)) for a in actuators]),
        np.array([isinstance(a, Tendon) for a in actuators], dtype=bool),
    )


class Routes:
    """Lengths l [m] of a robot's lines at q, and their slopes A = dl/dq [m x n]."""

    def __init__(self, robot):
        q = ca.SX.sym("q", robot.n)
        lengths = robot.functions(compiled=False).actuator_lengths.function(q)
        self.function = ca.Function("routes", [q], [ca.densify(lengths), ca.densify(ca.jacobian(lengths, q))])
        self._run = Buffered(self.function)

    def moving(self, index):
        """Function (q, qd) -> l [k], A [k x n] and A' qd [k] of the inputs of an index."""
        n = self.function.numel_in(0)
        q, qd, own = ca.SX.sym("q", n), ca.SX.sym("qd", n), list(map(int, index))
        l, A = (x[own, :] for x in self.function(q))
        turning = ca.jtimes(A @ qd, q, qd)
        return ca.Function("routes_moving", [q, qd], [ca.densify(x) for x in (l, A, turning)])

    def __call__(self, q):
        l, A = self._run(q)
        return l[0], A.T


@record(kw_only=True)
class LengthQuestion(Question):
    """A question that knows inputs given by length.

    lengths: of cables and chambers along their routes; motors: angles of the drums (`spool`), 0 where the robot is
    straight, positive winds in; volumes: of chambers. An input is given one way only.
    """

    lengths: Named | None = None
    motors: Named | None = None
    volumes: Named | None = None

    def read_given(self):
        super().read_given()
        self.held  # noqa: B018  reads and checks

    @cached_property
    def held(self):
        """Held: the inputs that are given by length."""
        rows = given_by_length(self)
        return held(self.robot, rows, [row.length(read(row.raw, row.unit, row.path)) for row in rows])


def length_values(robot, l, u, held=None):
    """{name: (number, unit)} of lengths, chambers' volumes and, where a cable has a spool, angles of motors.

    l, u [m]: lengths and inputs. An angle counts the cable without its stretch; a slack one is as long as it is held.
    """
    loose = dict(zip(held.names, held.length, strict=True)) if held else {}
    values = {f"lengths.{name}": (float(x), unit)
              for name, x, unit in zip(robot.inputs, l, robot.length_units, strict=True)}  # fmt: skip
    actuators = robot.description.actuators or {}
    wound = [i for i, name in enumerate(robot.inputs) if getattr(actuators.get(name), "spool", None) is not None]
    zero = robot.straight_lengths if wound else None
    for i in wound:
        name, cable = robot.inputs[i], actuators[robot.inputs[i]]
        own = l[i] / (1 + max(0.0, u[i]) / cable.stiffness) if cable.stiffness else l[i]
        values[f"motors.{name}"] = float((zero[i] - loose.get(name, own)) / cable.spool), "rad"
    for i, name in enumerate(robot.inputs):
        if isinstance(actuators.get(name), Chamber):
            values[f"volumes.{name}"] = float(actuators[name].area * l[i]), "m^3"
    return values
