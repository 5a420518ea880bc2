"""A robot: its description (what a file says) and what follows from it (tree, loads, actuators)."""

import copy
import re
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np

from socontrol.lie import stumpff
from socontrol.mechanics import loads as load_family
from socontrol.mechanics.actuators import Actuator, Tendon
from socontrol.mechanics.friction import Capstan, Friction
from socontrol.mechanics.loads import Fluid, Load
from socontrol.mechanics.loop_checks import refuse_alike, refuse_rigid
from socontrol.mechanics.loops import Loop
from socontrol.model.joints import JOINTS
from socontrol.model.rods import Rod
from socontrol.model.tree import build
from socontrol.quantities import Acceleration, Bad, OneOf, nearest, record, show

RESERVED = {  # the first words of names in results
    "world", "inputs", "coordinates", "lengths", "motors", "volumes", "tension_end", "energy", "stability", "holding",
    "reaction", "short", "compliance", "rates", "length_rates", "replay", "ellipsoid", "loops",
    "critical", "critical_load", "branch",
}  # fmt: skip
SEGMENTS = {"rod": Rod, **JOINTS}
Segment = Annotated[Any, OneOf(SEGMENTS, what="segment")]
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")  # no dots: they separate the keys of a path and the parts of a name


@record(kw_only=True)
class Description:
    """What a robot file says. Segments stand parents first; q and u follow the order of segments and actuators."""

    segments: dict[str, Segment]
    name: str = "robot"
    gravity: Acceleration = (0.0, 0.0, -9.81)
    actuators: dict[str, Actuator] | None = None
    loads: dict[str, Load] | None = None
    loops: dict[str, Loop] | None = None
    schema_version: Literal[1] = 1

    def __post_init__(self):
        if not self.segments:
            raise Bad("segments", "a robot needs at least one segment")
        for family, members in self.families().items():
            for name in members:
                _refuse_name(f"{family}.{name}", name)
        for name in RESERVED & set(self.segments):
            raise Bad(f"segments.{name}", f"'{name}' has a meaning of its own in results; rename the segment")
        Robot(self).check()

    def families(self):
        """The named mappings a value's path may start in."""
        return {"segments": self.segments, "actuators": self.actuators or {}, "loads": self.loads or {},
                "loops": self.loops or {}}  # fmt: skip


@dataclass(frozen=True)
class Robot:
    """The tree of pieces with loads and actuators.

    factor: multiplies the Gauss points of every rod; compiled: `functions()` are compiled C where nothing else is said.
    """

    description: Description
    factor: int = 1
    compiled: bool = False

    @cached_property
    def tree(self):
        try:
            return build(self.description.segments, self.factor)
        except Bad as bad:
            raise Bad(f"segments.{bad.key}", str(bad)) from None

    @cached_property
    def water(self):
        """The Fluid load around the robot, or None."""
        names = [name for name, load in (self.description.loads or {}).items() if isinstance(load, Fluid)]
        if len(names) > 1:
            raise Bad(f"loads.{names[1]}", f"the robot is in the fluid '{names[0]}' already; give one")
        return self.description.loads[names[0]] if names else None

    @cached_property
    def weights(self):
        """Weights of rods and bodies, less buoyancy, as point wrenches and force fields."""
        return load_family.gravity(self.tree, self.description.gravity, self.water.density if self.water else 0)

    @cached_property
    def applied(self):
        """Point wrenches and force fields of all loads."""
        resolved = []
        for name, load in (self.description.loads or {}).items():
            resolved += _at(f"loads.{name}", load.resolve, self.tree)
        return resolved

    @cached_property
    def loads(self):
        """Weights and all loads."""
        return [*self.weights, *self.applied]

    @cached_property
    def lines(self):
        """For each input, the shares of its lines in the pieces."""
        return [lines for _, lines in self._resolved]

    @cached_property
    def _resolved(self):
        """(actuator, lines) of each input."""
        resolved = []
        for name, actuator in (self.description.actuators or {}).items():
            resolved += [(actuator, lines) for lines in _at(f"actuators.{name}", actuator.resolve, self.tree)]
        return resolved

    @cached_property
    def friction(self):
        """The cables that rub, by input."""
        capstans = {
            k: Capstan(tuple(lines), actuator.friction, actuator.moving)
            for k, (actuator, lines) in enumerate(self._resolved)
            if isinstance(actuator, Tendon) and actuator.rubs
        }
        return Friction(self.tree, capstans)

    def check(self):
        """Raise Bad, pointing at the key, when segments, loads and actuators do not fit together."""
        refuse_alike(self.loops, self.tree)
        if self.loops:
            refuse_rigid(self.loops, self.tree, self.functions(compiled=False).loop_rows.function)
        return self.n, self.loads, self.lines

    @property
    def loops(self):
        """The closing joints {name: record}."""
        return self.description.loops or {}

    @property
    def name(self):
        return self.description.name

    @property
    def n(self):
        """Number of coordinates."""
        return self.tree.n

    @property
    def m(self):
        """Number of inputs."""
        return len(self.lines)

    @property
    def segments(self):
        """Names of the segments in file order."""
        return tuple(self.description.segments)

    @property
    def coordinates(self):
        """Names of q in order: `joint`, `joint.0`, `rod.section.strain`."""
        return self.tree.coordinates

    @property
    def coordinate_units(self):
        return self.tree.units

    @cached_property
    def inputs(self):
        """Names of u in order."""
        return tuple(name for name, _, _, _ in self._inputs)

    @cached_property
    def input_units(self):
        return tuple(unit for _, unit, _, _ in self._inputs)

    @cached_property
    def input_actuators(self):
        """The actuator's record behind each input."""
        return tuple(actuator for actuator, _ in self._resolved)

    @cached_property
    def pulls(self):
        """Mask [m] of the inputs that are tensions of cables."""
        return np.array([isinstance(actuator, Tendon) for actuator in self.input_actuators], dtype=bool)

    @property
    def length_units(self):
        """Of what `actuator_lengths` gives: m of lines and slides, rad of turns."""
        return tuple("rad" if unit == "N m" else "m" for unit in self.input_units)

    @cached_property
    def input_limits(self):
        """(lower, upper) of each input, infinite where none is given."""
        return tuple((lower, upper) for _, _, lower, upper in self._inputs)

    @cached_property
    def _inputs(self):
        rows = []
        for name, actuator in (self.description.actuators or {}).items():
            degrees = len(actuator.resolve(self.tree))
            for k in range(degrees):
                limits = actuator.limits
                if limits is not None and isinstance(limits[0], (tuple, list)):
                    limits = limits[k]
                lower, upper = (-float("inf"), float("inf")) if limits is None else limits
                rows.append((name if degrees == 1 else f"{name}.{k}", self._unit(actuator, k), lower, upper))
        return tuple(rows)

    def _unit(self, actuator, degree):
        if hasattr(actuator, "joint"):
            return self.description.segments[actuator.joint].units[degree][1]
        return actuator.unit

    @cached_property
    def straight_lengths(self):
        """What `actuator_lengths` gives at q = 0 [m]."""
        lengths = self.functions(compiled=False).actuator_lengths.function
        return np.array(lengths(np.zeros(self.n))).ravel()

    @cached_property
    def joint_limits(self):
        """(lower, upper) of each coordinate from its joint's limits, infinite where none is given."""
        rows = []
        for piece in self.tree.pieces:
            limits = None if piece.is_rod or piece.record.limits is None else piece.record.limit_pairs()
            rows += limits or [(-float("inf"), float("inf"))] * piece.size
        return tuple(rows)

    @cached_property
    def length(self):
        """Sum of rod lengths, joint tips and placements [m]: the size of the robot, for scaling.

        Placements of roots do not count: where the robot stands in the world is not its size.
        """
        total = 0.0
        for piece in self.tree.pieces:
            own = piece.parent is not None and piece.index == 0  # `piece.placement` holds the parent's tip as well
            offsets = [piece.end[:3, 3]] + [piece.record.placement.pose()[:3, 3]] * own
            total += float(piece.length) * piece.is_rod + sum(float(ca.norm_2(x)) for x in offsets)
        return total or 1.0

    def refined(self, sections=1, factor=1):
        """The same robot with `sections` times as many sections a rod and `factor` times the Gauss points, uncompiled:
        it is asked once or twice, to check."""
        segments = {
            name: _changed(s, "sections", _split(s.sections, sections)) if isinstance(s, Rod) else s
            for name, s in self.description.segments.items()
        }
        segments = {
            name: _changed(s, "rest", _repeat(s.rest, sections)) if isinstance(s, Rod) else s
            for name, s in segments.items()
        }
        return Robot(_changed(self.description, "segments", segments), self.factor * factor)

    def with_loads(self, loads):
        """The same robot with further named loads."""
        if not loads:
            return self
        loads = {**(self.description.loads or {}), **loads}
        return replace(self, description=_changed(self.description, "loads", loads))

    def in_c(self):
        """The same robot whose `functions()` are compiled C; see `functions`."""
        return replace(self, compiled=True)

    def value(self, path):
        """The value at a dotted path such as `module.material.young_modulus` or `loads.tip.force`."""
        node = self.description
        for key in self._keys(path):
            node = node[key] if isinstance(node, dict) else getattr(node, key)
        return node

    def with_values(self, values):
        """The same robot with values (numbers or CasADi symbols) at dotted paths; nothing is checked."""
        description = self.description
        for path, value in values.items():
            description = _set(description, self._keys(path), value)
        return replace(self, description=description)

    def _keys(self, path):
        """Keys from the description to a value; raises ValueError with what stands there instead."""
        keys = path.split(".")
        if keys[0] in self.description.segments and keys[0] not in ("loads", "actuators", "gravity"):
            keys = ["segments", *keys]
        node = self.description
        for depth, key in enumerate(keys):
            names = (
                list(node) if isinstance(node, dict) else [f.name for f in fields(node)] if is_dataclass(node) else []
            )
            if key not in names:
                raise ValueError(f"no value at '{path}': '{'.'.join(keys[: depth + 1])}'{nearest(key, names)}")
            node = node[key] if isinstance(node, dict) else getattr(node, key)
        return keys

    def overstrained(self, q):
        """Names of rod sections bent or twisted past the range |k| length <= 2 pi of the series, for numeric q."""
        names, slope, offset = self._turns
        turns = (slope @ np.asarray(q, dtype=float).ravel() + offset).reshape(-1, 3)
        angles = np.linalg.norm(turns, axis=1)
        return [f"{names[k]} ({angles[k]:.3g} rad)" for k in np.flatnonzero(~(angles <= stumpff.RANGE))]

    @cached_property
    def _turns(self):
        """Names of the sections of rods, slope [3 k x n] and offset [3 k] of the vectors by which they turn [rad]."""
        rods = [piece for piece in self.tree.pieces if piece.is_rod]
        slope, offset = np.zeros((3 * len(rods), self.n)), np.zeros(3 * len(rods))
        for k, piece in enumerate(rods):
            length, own = float(piece.length), slice(3 * k, 3 * k + 3)
            slope[own, piece.columns] = length * np.array(ca.DM(piece.Phi))[:3]
            offset[own] = length * np.array(ca.DM(piece.xi_bar))[:3, 0]
        return [f"{piece.segment}.{piece.index}" for piece in rods], slope, offset

    def functions(self, parameters=(), chained=False, compiled=None):
        """Named CasADi Functions of this robot; `parameters`: paths of values that become a trailing argument;
        `chained`: dynamics as one call a section; `compiled` (default: as the robot): machine code, made by the C
        compiler when a Function is first called and kept for later, that returns numpy arrays."""
        if self.compiled if compiled is None else compiled:
            from socontrol.native.compiled import CompiledFunctions as Functions
        else:
            from socontrol.mechanics.functions import Functions

        return Functions(self, tuple(parameters), chained)


def _refuse_name(path, name):
    if not (isinstance(name, str) and NAME.fullmatch(name)):
        raise Bad(path, f"{show(name)} is no name; use letters, digits, _ or -, a letter or _ first")


def _at(path, resolve, tree):
    try:
        return resolve(tree)
    except Bad as bad:
        raise Bad(f"{path}.{bad.key}", str(bad)) from None


def _changed(record, key, value):
    """A copy of a frozen record with one field changed, without its checks (which need numbers)."""
    other = copy.copy(record)
    object.__setattr__(other, key, value)
    return other


def _set(node, keys, value):
    if not keys:
        return value
    key, rest = keys[0], keys[1:]
    if isinstance(node, dict):
        return {**node, key: _set(node[key], rest, value)}
    return _changed(node, key, _set(getattr(node, key), rest, value))


def _split(sections, times):
    if isinstance(sections, tuple):
        return tuple(part / times for part in sections for _ in range(times))
    return sections * times


def _repeat(rest, times):
    if rest is None:
        return None
    return {k: tuple(x for x in v for _ in range(times)) if isinstance(v, tuple) else v for k, v in rest.items()}
