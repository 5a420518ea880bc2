"""What all questions about a robot share: the robot, loads, given values, bounds, guess, and what is expected."""

from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np

from socontrol.mechanics.loads import Load
from socontrol.mechanics.robot import Robot
from socontrol.model.bases import STRAINS
from socontrol.programs.nlp.solver import SOLVERS, Ipopt
from socontrol.quantities import Bad, Flag, Number, PositiveNumber, Unit, nearest, record

Raw = Annotated[Any, "a number in SI, or text with a unit"]
Named = dict[str, Raw]


@record(kw_only=True)
class Expectation:
    """A value this problem should give: `value` within `tolerance`, and where it comes from."""

    value: Any
    tolerance: Raw
    source: str


@record(kw_only=True)
class StrainBounds:
    """Bounds of every rod in an optimisation; `bend`: of |twist| and |bend| x section length [rad]."""

    bend: Annotated[float, Unit("rad", lower=0, exclusive=True)] = float(np.pi)
    stretch: tuple[Number, Number] = (-0.8, 4.0)
    shear: PositiveNumber = 1.0


@record(kw_only=True)
class Bounds:
    """Limits of this problem, beside the robot's own: by name of input or coordinate, and of strains."""

    inputs: dict[str, tuple[Raw, Raw]] | None = None
    coordinates: dict[str, tuple[Raw, Raw]] | None = None
    strains: StrainBounds = StrainBounds()


@record(kw_only=True)
class Guess:
    """Where a solver starts: coordinates and inputs by name; those not named start at 0."""

    inputs: Named | None = None
    coordinates: Named | None = None


@record(kw_only=True)
class Question:
    """Keys every problem type knows.

    inputs, coordinates: given values by name (given coordinates are held, as by a locked motor). discretisation:
    solve again with doubled sections and print the change.
    """

    robot: Any
    name: str = "problem"
    solver: Any = Ipopt()
    loads: dict[str, Load] | None = None
    inputs: Named | None = None
    coordinates: Named | None = None
    bounds: Bounds = Bounds()
    guess: Guess = Guess()
    discretisation: Flag = True
    expect: dict[str, Any] | None = None
    schema_version: Literal[1] = 1
    solvers = SOLVERS  # those that answer this type
    hessians = ("exact",)  # of Ipopt
    knows_loops = False  # whether robots may have loops
    optimises = False  # whether strain bounds apply: forward statics goes where the loads take it

    def __post_init__(self):
        if not isinstance(self.robot, Robot):
            raise Bad("robot", "a path of a robot file or a mapping that describes one is wanted")
        if self.robot.loops and not self.knows_loops:
            kind = "".join(f"_{c.lower()}" if c.isupper() else c for c in type(self).__name__).lstrip("_")
            raise Bad("robot", f"it has loops, which `{kind}` does not know yet")
        if (hessian := getattr(self.solver, "hessian", "exact")) not in self.hessians:
            raise Bad("solver.hessian", f"'{hessian}' is for trajectories; here it is exact, leave this key out")
        self.loaded.check()
        self.input_limits()
        self.coordinate_limits()
        self.read_given()
        if over := self.robot.overstrained(self.first_coordinates()):
            raise Bad("coordinates", f"section {over[0]} would turn too far; a section holds for up to 2 pi")

    def read_given(self):
        """Raise Bad unless the names and units of given values and of the guess fit the robot."""
        for key in ("inputs", "coordinates"):
            self.named(key, getattr(self, key))
            self.named(key, getattr(self.guess, key), f"guess.{key}")

    def first_coordinates(self):
        """Given coordinates [n], 0 where none is given."""
        return self.vector("coordinates", self.coordinates)

    @cached_property
    def loaded(self):
        """The robot with the problem's loads."""
        for name in self.loads or {}:
            if name in (self.robot.description.loads or {}):
                raise Bad(f"loads.{name}", "the robot has a load of this name; rename one")
        return self.robot.with_loads(self.loads)

    def named(self, key, values, path=None):
        """{index: SI value} of values by name of an input or coordinate (`key`); raises Bad."""
        names = getattr(self.robot, key)
        units = self.robot.input_units if key == "inputs" else self.robot.coordinate_units
        found = {}
        for name, raw in (values or {}).items():
            if name not in names:
                raise Bad(f"{path or key}.{name}", f"the robot has no {key[:-1]} '{name}'{nearest(name, names)}")
            i = names.index(name)
            found[i] = read(raw, units[i], f"{path or key}.{name}")
        return found

    def vector(self, key, values, path=None):
        """Values by name as a vector in SI, 0 where none is given."""
        result = np.zeros(len(getattr(self.robot, key)))
        for index, value in self.named(key, values, path).items():
            result[index] = value
        return result

    def input_limits(self):
        """(lower [m], upper [m]): the robot's, tightened by the problem's."""
        limits = np.array(self.robot.input_limits, dtype=float).reshape(-1, 2)
        return self._tightened("inputs", limits[:, 0], limits[:, 1])

    def coordinate_limits(self, strains=True):
        """(lower [n], upper [n]) of coordinates: joint limits, the problem's own, and with `strains` those of rods."""
        limits = np.array(self.robot.joint_limits, dtype=float).reshape(-1, 2)
        lower, upper = limits[:, 0].copy(), limits[:, 1].copy()
        for piece in self.robot.tree.pieces:
            if piece.is_rod and strains:
                rows = [self._strain_limit(s, float(piece.length)) for s in piece.record.active()]
                lower[piece.columns], upper[piece.columns] = np.array(rows).T
        return self._tightened("coordinates", lower, upper)

    def _strain_limit(self, strain, length):
        bounds = self.bounds.strains
        if STRAINS.index(strain) < 3:
            return -bounds.bend / length, bounds.bend / length
        return bounds.stretch if strain == "stretch" else (-bounds.shear, bounds.shear)

    def _tightened(self, key, lower, upper):
        lower, upper = lower.copy(), upper.copy()
        for end, side in ((lower, 0), (upper, 1)):
            pairs = {
                name: pair[side] for name, pair in (getattr(self.bounds, key) or {}).items() if pair[side] is not None
            }
            for i, value in self.named(key, pairs, f"bounds.{key}").items():
                end[i] = max(end[i], value) if side == 0 else min(end[i], value)
        names = getattr(self.robot, key)
        for i, name in enumerate(names):
            if lower[i] > upper[i]:
                raise Bad(f"bounds.{key}.{name}", f"no value is left between {lower[i]:g} and {upper[i]:g}")
        return lower, upper


def read(raw, unit, path):
    """SI number of a raw value in `unit`; raises Bad at `path`."""
    try:
        return Unit(unit, angle=unit == "rad").read(raw)
    except ValueError as error:
        raise Bad(path, str(error)) from None
