"""What changes along a continuation: a factor on loads and gravity, an input, or a held coordinate."""

from dataclasses import dataclass

import numpy as np

from socontrol.mechanics.loads import is_zero
from socontrol.programs.equilibria.family import Growth
from socontrol.programs.question import read
from socontrol.programs.words import pretty
from socontrol.quantities import Bad, Flag, Fraction, joined, nearest, record

KEYS = ("force", "moment")  # of a load, what a factor multiplies


@record(kw_only=True)
class Vary:
    """What changes: a factor on the forces and moments of `loads` and on `gravity`, or the value of one `input` or one
    `coordinate`."""

    loads: tuple[str, ...] | None = None
    gravity: Flag = False
    input: str | None = None
    coordinate: str | None = None

    def __post_init__(self):
        chosen = [self.factor, self.input is not None, self.coordinate is not None]
        if sum(chosen) != 1:
            what = "nothing varies" if not any(chosen) else "two things vary"
            raise Bad("loads", f"{what}; name `loads` or `gravity` (a factor on all), one `input` or one `coordinate`")

    @property
    def factor(self):
        return bool(self.loads) or self.gravity


@record(kw_only=True)
class Watch:
    """The place whose displacement is plotted: X of a segment."""

    on: str
    at: Fraction = 1.0


@dataclass(frozen=True)
class Varied:
    """A Growth, the values [(path, numbers)] that its factor multiplies, and its name: a factor has none."""

    growth: Growth
    values: tuple = ()
    name: str = ""

    @property
    def paths(self):
        return [path for path, _ in self.values]

    def robot(self, robot, factor):
        """The robot with `factor` times what varies."""
        return robot.with_values({path: tuple(factor * x for x in numbers) for path, numbers in self.values})

    @property
    def forces(self):
        """[(load, number at factor 1, unit)] of what the factor multiplies."""
        found = []
        for path, numbers in self.values:
            load, _, key = path.removeprefix("loads.").rpartition(".")
            unit = {"force": "N", "moment": "N m"}.get(key, "m/s^2")
            found.append((load or "gravity", float(np.linalg.norm(numbers)), unit))
        return found

    @property
    def names(self):
        """Names of the loads that the factor multiplies; `gravity` is one."""
        return list(dict.fromkeys(name for name, _, _ in self.forces))

    def told(self, s):
        """`factor 2.467 (tip 0.617 N)`, `t0 at 3 N`."""
        mu = self.growth.at(s)
        if self.growth.kind != "loads":
            return f"{self.name} = {pretty(mu, self.growth.unit)}"
        forces = self.forces
        parts = joined([pretty(mu * size, unit) for _, size, unit in forces], "and")
        told = f" ({self.names[0]} {parts})" if len(self.names) == 1 else ""
        return f"factor {mu:.5g}{told}"


def varied(question):
    """Varied of a question with `vary`, `from` and `to`; raises Bad."""
    vary, robot = question.vary, question.loaded
    if vary.factor:
        values = tuple(_values(robot, vary))
        growth = {"kind": "loads", "values": np.concatenate([np.ravel(numbers) for _, numbers in values])}
        name, unit = "", "1"
    else:
        key = "input" if vary.input is not None else "coordinate"
        name, names = getattr(vary, key), getattr(robot, f"{key}s")
        if name not in names:
            raise Bad(f"vary.{key}", f"the robot has no {key} '{name}'{nearest(name, names)}")
        if name in (getattr(question, f"{key}s") or {}):
            raise Bad(f"{key}s.{name}", f"'{name}' varies from {question.from_} to {question.to}; leave it out here")
        units = robot.input_units if key == "input" else robot.coordinate_units
        values, unit = (), units[names.index(name)]
        growth = {"kind": key, "index": names.index(name)}
    start, stop = (read(raw, unit, path) for raw, path in ((question.from_, "from"), (question.to, "to")))
    if start == stop:
        raise Bad("to", f"{question.to} is where `from` begins; nothing would change")
    return Varied(Growth(start=start, stop=stop, unit=unit, **growth), values, name)


def _values(robot, vary):
    """(path, numbers) of all that one factor multiplies."""
    loads = robot.description.loads or {}
    if len(set(vary.loads or ())) < len(vary.loads or ()):
        raise Bad("vary.loads", "a load is named twice")
    for name in vary.loads or ():
        if name not in loads:
            has = nearest(name, loads) if loads else "; the robot has none: give some under `loads`"
            raise Bad("vary.loads", f"there is no load '{name}'{has}")
        keys = [key for key in KEYS if hasattr(loads[name], key)]
        if not keys:
            raise Bad("vary.loads", f"'{name}' is no force or moment that a factor could multiply")
        if all(is_zero(getattr(loads[name], key)) for key in keys):
            raise Bad("vary.loads", f"'{name}' is zero: its {joined(keys, 'and')} would stay so under any factor")
        yield from ((f"loads.{name}.{key}", getattr(loads[name], key)) for key in keys
                    if not is_zero(getattr(loads[name], key)))  # fmt: skip
    if vary.gravity:
        gravity = robot.description.gravity
        if is_zero(gravity):
            raise Bad("vary.gravity", "the robot's `gravity` is zero and would stay so under any factor")
        yield "gravity", gravity


