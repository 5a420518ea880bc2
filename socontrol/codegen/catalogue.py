"""The functions of a robot that have a C form: their names, arguments and results."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from socontrol.codegen.identifiers import distinct, identifier
from socontrol.mechanics.functions import Functions
from socontrol.native.compiled import CHAINED_BEYOND
from socontrol.quantities import nearest


class BadRequest(ValueError):
    """A function that is not there, or not for this robot; the text says which are."""


@dataclass(frozen=True)
class Kind:
    """A function of Functions: what it gives, and the C names of its results with what they hold."""

    about: str
    results: dict
    place: bool = False  # whether it is a function of a place on the robot
    inputs: bool = False  # whether it means nothing without inputs
    loops: bool = False  # whether it means nothing without loops


FORCE, SQUARE = "J per unit of the coordinate", "J per unit of both coordinates"
KINDS = {
    "pose": Kind("Pose [4 x 4], world <- frame at {X} of {segment}.", {"pose": "m, and 1"}, place=True),
    "jacobian": Kind(
        "Body Jacobian [6 x n] of the frame at {X} of {segment}: twist = J qd, angular part first, in its own axes.",
        {"J": "rad, then m, per unit of the coordinate"}, place=True,
    ),
    "mass": Kind("Mass matrix M [n x n], with added mass of water.", {"M": "J s^2 per unit of both coordinates"}),
    "coriolis": Kind("C [n x n]: C qd are the forces of Coriolis; M' - 2 C is skew.", {"C": "J s per unit of both"}),
    "stiffness": Kind("Tangent [n x n] of the elastic force.", {"K": SQUARE}),
    "damping": Kind("Damping matrix [n x n] of materials and joints.", {"D": "J s per unit of both"}),
    "elastic_force": Kind("Elastic force [n] of rods, joint springs and stops.", {"force": FORCE}),
    "external_force": Kind("Force [n] of gravity, buoyancy, loads, and the water's drag and lift.", {"force": FORCE}),
    "actuation": Kind("B [n x m], tau = B u.", {"B": "J per unit of coordinate and input"}, inputs=True),
    "actuator_lengths": Kind("Length of each actuator's lines.", {"lengths": "m; rad"}, inputs=True),
    "inverse_dynamics": Kind(
        "Forces [n] that motion takes: M qdd + C qd + elastic + D qd - external.", {"tau": FORCE}
    ),
    "forward_dynamics": Kind(
        "Accelerations [n] under inputs, loops kept closed.", {"qdd": "unit of the coordinate per s^2"}
    ),
    "loop_error": Kind("Error [k] of all loops in file order, zero when closed.", {"e": "rad; m"}, loops=True),
    "loop_jacobian": Kind(
        "A [k x n] of the loops: A qd = 0 is what they leave.", {"A": "rad; m, per unit of the coordinate"}, loops=True
    ),
    "loop_bias": Kind("A' qd [k]: A qdd + A' qd = 0 keeps loops closed.", {"bias": "rad/s^2; m/s^2"}, loops=True),
    "loop_force": Kind("Multipliers [k] of the loops in motion, the least.", {"lam": "N m; N"}, loops=True),
    "floating_inverse_dynamics": Kind(
        "Accelerations of the free base's coordinates [6] and forces of all others [n - 6], no wrench on the base.",
        {"qdd_base": "rad/s^2, then m/s^2", "forces": FORCE},
    ),
    "static_residual": Kind("Force left over at rest [n]: elastic - external - B u.", {"residual": FORCE}),
    "static_tangent": Kind("Derivative [n x n] of static_residual in q.", {"tangent": SQUARE}),
    "energy": Kind("Kinetic, elastic and gravitational energy [3].", {"energy": "J"}),
    "momentum": Kind(
        "Angular momentum about the world's origin and linear momentum [6], world axes.",
        {"momentum": "kg m^2/s; kg m/s"},
    ),
}  # fmt: skip
ALIASES = {"statics_residual": "static_residual"}
CHAINED = ("inverse_dynamics", "forward_dynamics", "loop_force")


@dataclass(frozen=True)
class Wish:
    """One function asked for: kind, and segment and X where it is one of a place."""

    kind: str
    segment: str | None = None
    X: float | None = None

    @property
    def text(self):
        """As it is written in --functions."""
        return self.kind if self.segment is None else f"{self.kind}@{self.segment}:{self.X:g}"


def wishes(robot, texts):
    """Wishes of texts such as `mass`, `pose`, `pose@arm:0.5`; all kinds where none are given. Raises BadRequest."""
    found = dict.fromkeys(_wish(robot, text.strip()) for text in texts)
    if not found:
        raise BadRequest(f"no function is named; allowed: {', '.join(KINDS)}")
    return list(found)


def _wish(robot, text):
    name, _, place = text.partition("@")
    kind = ALIASES.get(name, name)
    if kind not in KINDS:
        raise BadRequest(f"unknown function '{name}'{nearest(name, [*KINDS, *ALIASES])}")
    if not KINDS[kind].place:
        if place or "@" in text:
            raise BadRequest(f"'{text}': {kind} is of the whole robot; leave out what follows {kind}")
        return Wish(kind)
    segment, _, X = place.partition(":")
    if "@" not in text:
        segment = robot.segments[-1]
    try:
        X = float(X) if X else 1.0
    except ValueError:
        raise BadRequest(f"'{text}': '{X}' is no number; write {kind}@SEGMENT:X with X from 0 to 1") from None
    try:
        robot.tree.locate(segment, X)
    except ValueError as error:
        raise BadRequest(f"'{text}': {error}") from None
    return Wish(kind, segment, X)


@dataclass(frozen=True, eq=False)
class Entry:
    """One function in C: its name there, without the prefix, and the Function behind it."""

    name: str
    wish: Wish
    function: ca.Function  # as Python has it, column by column

    @cached_property
    def arguments(self):
        """{name: length}, empty ones too."""
        return {self.function.name_in(k): self.function.numel_in(k) for k in range(self.function.n_in())}

    @cached_property
    def results(self):
        """{name: (rows, columns)}, empty ones too."""
        return {name: self.function.size_out(k) for k, name in enumerate(KINDS[self.wish.kind].results)}

    @cached_property
    def by_rows(self):
        """The Function with matrices transposed, so that its numbers stand row by row, and without empty results."""
        f, kept = self.function, [k for k in range(self.function.n_out()) if self.function.numel_out(k)]
        plain = f.is_a("SXFunction")
        symbols = f.sx_in() if plain else f.mx_in()
        results = f.call(symbols, plain, False)
        turned = [results[k].T if min(f.size_out(k)) > 1 else results[k] for k in kept]
        turned = ca.cse(turned) if plain else turned  # what is computed twice, up to a fifth, is computed once
        return ca.Function(f.name(), symbols, turned, f.name_in(), [f.name_out(k) for k in kept])


def entries(robot, wanted):
    """(Entries, {text: why not}) of wishes; a wish that does not apply to the robot is in the second."""
    plain, found, missing = Functions(robot), {}, {}
    long = sum(piece.is_rod for piece in robot.tree.pieces) > CHAINED_BEYOND
    chained = Functions(robot, chained=True) if long else plain
    for wish in wanted:
        try:
            found[wish] = _function(robot, chained if wish.kind in CHAINED else plain, wish)
        except ValueError as error:
            missing[wish.text] = str(error)
    names = distinct(_name(robot, wish) for wish in found)
    return tuple(Entry(n, w, f) for n, (w, f) in zip(names, found.items(), strict=True)), missing


def _function(robot, functions, wish):
    """The casadi Function; ValueError where the robot has none."""
    if KINDS[wish.kind].inputs and not robot.m:
        raise ValueError("the robot has no inputs")
    if KINDS[wish.kind].loops and not robot.loops:
        raise ValueError("the robot has no loops")
    made = getattr(functions, wish.kind)
    return (made(wish.segment, wish.X) if wish.segment is not None else made).function


def _name(robot, wish):
    """`mass`; `pose` of the end of the last segment; `pose_arm_0_5` of another place."""
    if wish.segment is None or (wish.segment, wish.X) == (robot.segments[-1], 1.0):
        return wish.kind
    place = "" if wish.X == 1 else f"_{wish.X:g}"
    return f"{wish.kind}_{identifier(wish.segment)}{identifier(place) and '_' + identifier(place)}"
