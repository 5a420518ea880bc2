"""Problem type `ellipsoids`: how a place on the robot moves, gives way, is driven and pushes, in every direction.

The robot comes to rest first, as in `statics`. Coordinates count as they are (rad, m, 1/m) in the kinematic and force
ellipsoids, those given among them: on a rod these change with its sections, the other two do not. Compliance and
actuation are of the robot at rest: given coordinates, held lengths and closed loops stay as they are.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from socontrol.mechanics import ellipsoids as formulas
from socontrol.mechanics.ellipsoids import RANK
from socontrol.programs.equilibria.lengths import Held, Routes
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.postures.goals import locate
from socontrol.programs.postures.statics import Statics
from socontrol.programs.result import Value
from socontrol.programs.words import pretty
from socontrol.quantities import Bad, Fraction, joined, record

KINDS = ("kinematic", "compliance", "actuation", "force")
ORDER = ("translation", "rotation")
PER_COORDINATE = {  # unit of all coordinates: units of what they move, and of the force that balances theirs, by part
    "rad": {"kinematic": ("m/rad", "1"), "force": ("1/m", "1")},
    "m": {"kinematic": ("1", "rad/m"), "force": ("1", "m")},
    "1/m": {"kinematic": ("m^2", "rad m"), "force": ("1/m^2", "1/m")},
    "1": {"kinematic": ("m", "rad"), "force": ("1/m", "1")},
}
MIXED = {"kinematic": ("m per coordinate", "rad per coordinate"),
         "force": ("N per coordinate's force", "N m per coordinate's force")}  # fmt: skip
OTHERS = {"compliance": ("m/N", "rad/(N m)"), "actuation": ("m", "rad")}


FAR = {"translation": 0.2, "rotation": 0.5}  # of the robot's length, and rad: motions that no slope tells


class Unbounded(ValueError):
    """Raised where an ellipsoid has no size; the text says why."""


@dataclass(frozen=True)
class Ellipsoid:
    """Matrix [3 x 3] in world axes; semi-axes [3] in `unit`, longest first; directions [3 x 3], a unit column each.

    The matrix of compliance maps force to displacement (moment to turn); that of the others is the square. A force of
    infinite semi-axis is one that the structure carries; it counts as 0 in the matrix of `force`.
    """

    matrix: np.ndarray
    axes: np.ndarray
    directions: np.ndarray
    unit: str


@record(kw_only=True)
class Ellipsoids(Statics):
    """In which directions does a place on the robot at rest move, give way, follow the inputs, and push?

    on, at: the place; kinds: of the ellipsoids, all that the robot has if left out. Inputs count by their limits.
    """

    on: str
    at: Fraction = 1.0
    kinds: tuple[Literal["kinematic", "compliance", "actuation", "force"], ...] | None = None

    def __post_init__(self):
        super().__post_init__()
        locate(self.robot, self)
        if self.kinds is not None and (not self.kinds or len(set(self.kinds)) < len(self.kinds)):
            raise Bad("kinds", f"name some of {joined(KINDS, 'and')}, each once")
        if "actuation" in (self.kinds or ()) and (why := no_actuation(self.robot, self.input_sizes(), self.held)):
            raise Bad("kinds", f"there is no ellipsoid of actuation: {why}")

    def input_sizes(self):
        """Largest magnitude [m] of each input within its limits."""
        return np.max(np.abs(np.array(self.input_limits()).reshape(2, -1)), axis=0)

    def solve(self, progress=None):
        result = replace(super().solve(progress), type="ellipsoids")
        return described(result) if result.status.solved else result


def described(result):
    """The Result of an equilibrium with its ellipsoids: values ellipsoid.KIND.PART.axes and .directions (a row each),
    arrays ellipsoid.KIND.PART; details: `ellipsoids` = place, kinds, notes on those it has not, and what of the
    actuation's semi-axes is `far` beyond where a slope tells the motion."""
    question, values, arrays, notes, far = result.question, {}, {}, {}, []
    locked = tuple(question.named("coordinates", question.coordinates))
    place = Place(question.loaded, result.arrays["q"], result.arrays["u"], question.on, question.at, locked,
                  question.held, question.input_sizes())  # fmt: skip
    for kind in question.kinds or KINDS:
        try:
            found = place.ellipsoids(kind)
        except Unbounded as reason:
            notes[kind] = str(reason)
            continue
        for part, ellipsoid in found.items():
            key = f"ellipsoid.{kind}.{part}"
            values[f"{key}.axes"] = Value(ellipsoid.axes.tolist(), ellipsoid.unit)
            values[f"{key}.directions"] = Value(ellipsoid.directions.T.tolist(), "1")
            arrays[key] = ellipsoid.matrix
            most = FAR[part] * (question.loaded.length if part == "translation" else 1.0)
            if kind == "actuation" and ellipsoid.axes[0] > most:
                far.append(pretty(float(ellipsoid.axes[0]), ellipsoid.unit))
    told = {"on": question.on, "at": question.at, "kinds": [k for k in KINDS if f"ellipsoid.{k}.translation" in arrays],
            "notes": notes, "far": far}  # fmt: skip
    return replace(result, values={**result.values, **values}, arrays={**result.arrays, **arrays},
                   details={**result.details, "ellipsoids": told})  # fmt: skip


def ellipsoids(robot, q, u=(), on=None, *, at=1.0, kinds=None):
    """{kind: {`translation`, `rotation`: Ellipsoid}} of the frame at X = `at` of segment `on` (default: the last one)
    of a robot at q [n], u [m], which need not be at rest; without `kinds`, those that it has.

    Raises ValueError for a kind that it has not, or a place that is none.
    """
    on = robot.segments[-1] if on is None else on
    if unknown := [kind for kind in kinds or () if kind not in KINDS]:
        raise ValueError(f"'{unknown[0]}' is no kind of ellipsoid; there are {joined(KINDS, 'and')}")
    place, found = Place(robot, q, u if len(u) else np.zeros(robot.m), on, at), {}
    for kind in kinds or KINDS:
        try:
            found[kind] = place.ellipsoids(kind)
        except Unbounded:
            if kinds is not None:
                raise
    return found


def no_actuation(robot, sizes, held):
    """Why inputs drive no place, or None; sizes [m]: their largest magnitudes, infinite where there is no limit."""
    if not robot.m:
        return "the robot has no inputs"
    if held:
        return f"{joined(held.names, 'and')} {'is' if len(held.names) == 1 else 'are'} held by length, not driven"
    free = [name for name, size in zip(robot.inputs, sizes, strict=True) if not np.isfinite(size)]
    return f"'{free[0]}' has no limits to count it by; give them under `bounds: inputs`" if free else None


class Place:
    """A frame of a robot at one (q, u): its Jacobian in world axes, the tangent, and what is held.

    locked: indices of coordinates that stay; held: inputs at lengths; sizes [m]: what counts as 1 of each input.
    """

    def __init__(self, robot, q, u, on, at=1.0, locked=(), held=None, sizes=None):
        self.robot, self.locked, self.held = robot, list(locked), held or Held()
        self.q, self.u = np.asarray(q, dtype=float).ravel(), np.asarray(u, dtype=float).ravel()
        f = robot.functions(compiled=False)
        g, J = (np.array(x.function(self.q)) for x in (f.pose(on, at), f.jacobian(on, at)))
        self.J, self.position = np.array(formulas.in_world(ca.DM(g), ca.DM(J))), g[:3, 3]
        if sizes is None:
            limits = np.array(robot.input_limits, dtype=float).reshape(-1, 2)
            sizes = np.max(np.abs(limits), axis=1)
        self.sizes, self.functions = sizes, f

    def ellipsoids(self, kind):
        """{part: Ellipsoid} of a kind; raises Unbounded."""
        return {part: self._of(kind, part) for part in ORDER}

    def _of(self, kind, part):
        unit, other = self._units(kind)[ORDER.index(part)], next(name for name in ORDER if name != part)
        per = self.robot.length if part == "translation" else 1 / self.robot.length
        if kind == "compliance":
            C, C_other = (np.array(formulas.block(self._compliance, name)) for name in (part, other))
            return Ellipsoid(C, *formulas.principal(C, np.linalg.norm(C_other) * per**2), unit)
        whole = self._driven if kind == "actuation" else self._moved
        F, F_other = (np.array(formulas.rows(whole, name)) for name in (part, other))
        axes, directions = formulas.principal(F, np.linalg.norm(F_other) * per)
        if kind != "force":
            return Ellipsoid(np.array(formulas.square(F)), axes, directions, unit)
        inverse, directions = 1 / np.where(axes > 0, axes, np.nan)[::-1], directions[:, ::-1]
        M = (directions * np.nan_to_num(inverse) ** 2) @ directions.T
        return Ellipsoid(M, np.nan_to_num(inverse, nan=np.inf), directions, unit)

    def _units(self, kind):
        if kind in OTHERS:
            return OTHERS[kind]
        units = set(self.robot.coordinate_units)
        return PER_COORDINATE.get(units.pop() if len(units) == 1 else "", MIXED)[kind]

    @cached_property
    def _moved(self):
        return formulas.moved(self.J, formulas.null_space(self._loops[0], np.ones(self.robot.n)))

    @cached_property
    def _compliance(self):
        K, _, Z, W = self._balance
        return formulas.compliance(ca.DM(self.J), K, Z, W)

    @cached_property
    def _driven(self):
        if why := no_actuation(self.robot, self.sizes, self.held):
            raise Unbounded(why)
        K, H, Z, W = self._balance
        return formulas.driven(ca.DM(self.J), K, H, Z, W)

    @cached_property
    def _loops(self):
        """A(q) [r x n] of the closed loops, and what their forces add to the tangent [n x n]."""
        n = self.robot.n
        if not getattr(self.robot, "loops", None):
            return np.zeros((0, n)), np.zeros((n, n))
        A = np.array(self.functions.loop_jacobian.function(self.q))
        r = np.array(self.functions.static_residual.function(self.q, self.u)).ravel()
        free = np.setdiff1d(np.arange(n), self.locked)
        lam = np.linalg.lstsq(A[:, free].T, r[free], rcond=RANK)[0]
        return A, -np.array(self.functions.closing.function(self.q, lam)[2])

    @cached_property
    def _balance(self):
        """K, H times the inputs' sizes, Z and W in numbers; raises Unbounded where nothing holds the robot."""
        _, K, B = (np.array(x) for x in self.functions.statics.function(self.q, self.u))
        (A, change), scale = self._loops, scales(self.robot)
        locked = np.eye(self.robot.n)[self.locked]
        K, still, pushes = self._with_lengths(K + change, B, scale.u)
        Z = formulas.null_space(np.vstack([A, locked, still]), scale.q)
        W = formulas.null_space(np.vstack([A, locked, pushes]), scale.q)
        W = W if W.shape == Z.shape else Z  # some push changes no length: as if all were held by their own slopes
        values = np.linalg.svd(W.T @ K @ Z, compute_uv=False) if Z.size else np.ones(1)
        if not np.all(np.isfinite(values)) or values[-1] <= RANK * max(scale.energy, values[0]):
            raise Unbounded("the robot has a motion that nothing holds at this posture; give joints `stiffness`")
        return ca.DM(K), ca.DM(B * np.where(np.isfinite(self.sizes), self.sizes, 0.0)), ca.DM(Z), ca.DM(W)

    def _with_lengths(self, K, B, sizes):
        """The tangent with held cables that stretch as springs; slopes and pushes [k x n] of those that do not."""
        if not self.held:
            return K, np.zeros((0, self.robot.n)), np.zeros((0, self.robot.n))
        A = Routes(self.robot)(self.q)[1]
        springs, slopes, pushes = self.held.holding(A, B, self.held.slack(self.u, sizes))
        return K + springs, slopes, pushes.T
