"""Named CasADi Functions of a robot. The only place of this floor where symbols are made."""

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from socontrol.lie import screws, stumpff
from socontrol.mechanics import articulated, closed, composite, floating, friction, internal, newton_euler
from socontrol.mechanics.actuators import Tendon
from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.loops import Loops
from socontrol.mechanics.statics import Statics


class RobotFunction:
    """A CasADi Function that refuses strains out of the range of the exponential's series.

    Takes numpy, DM, SX or MX and returns what CasADi returns; `.function` is the Function itself.
    """

    def __init__(self, function, turning):
        self.function, self._turning = function, turning

    def __call__(self, *args, **named):
        if args and not any(isinstance(a, (ca.SX, ca.MX)) for a in args):
            self._turning.check(self.function.name(), args[0], args[-1])
        return self.function(*args, **named)

    def __getattr__(self, name):
        if name in ("function", "_turning"):  # not yet made: while being copied or unpickled
            raise AttributeError(name)
        return getattr(self.function, name)

    def __repr__(self):
        return repr(self.function)


class Turning:
    """How far each section of rod turns at numeric q (and p); more than the series holds for is an error."""

    def __init__(self, tree, q, p):
        self.coordinates, self.names, self._count = tree.coordinates, tree.sections, p.numel()
        turns = ca.SX(ca.vertcat(*tree.turns(q)))
        if self._count:
            self._turns = ca.Function("turns", [q, p], [turns])
            return
        slope = ca.Function("turns", [q], [ca.jacobian(turns, q), ca.substitute(turns, q, ca.DM.zeros(q.numel()))])
        matrix, self._offset = (np.array(x.full()) for x in slope(0))
        self._matrix, self._offset = matrix, self._offset.ravel()

    def check(self, name, q, p):
        """Raise ValueError naming the section or coordinate, at numeric q and parameters p."""
        q = np.asarray(q, dtype=float).ravel()
        if q.size != len(self.coordinates):
            raise ValueError(f"{name}: {q.size} coordinates given, {len(self.coordinates)} wanted")
        if not np.all(np.isfinite(q)):
            first = int(np.argmin(np.isfinite(q)))
            raise ValueError(f"{name}: coordinate {self.coordinates[first]} is {q[first]}")
        if not self.names:
            return
        turns = np.array(self._turns(q, p)).ravel() if self._count else self._matrix @ q + self._offset
        angles = np.linalg.norm(turns.reshape(-1, 3), axis=1)
        if not np.all(angles <= stumpff.RANGE):
            worst = int(np.argmax(angles))
            raise ValueError(
                f"{name}: section {self.names[worst]} turns by {angles[worst]:.3g} rad; a section holds for"
                f" up to 2 pi: use more sections or smaller strains"
            )


class Functions:
    """Functions of q [n], u [m] and, with parameters, a trailing p; see each one for shape and unit.

    Angular first, body frame, SI. `p` stacks the parameters in the order they were named; `defaults` [p] holds
    the robot's own values. `chained`: inverse and forward dynamics call one Function a section (MX) in the place of one
    expression (SX): compiled code is smaller and, for many sections, faster; CasADi's own machine runs SX faster.
    """

    def __init__(self, robot, parameters=(), chained=False):
        self.base, self.parameters, self.chained = robot, parameters, chained
        values = {path: np.ravel(np.array(robot.value(path), dtype=float)) for path in parameters}
        self.defaults = np.concatenate([*values.values()]) if values else np.zeros(0)
        self._p = ca.SX.sym("p", len(self.defaults))
        self._q = ca.SX.sym("q", robot.n)
        self._qd = ca.SX.sym("qd", robot.n)
        self._u = ca.SX.sym("u", robot.m)
        self._qdd = ca.SX.sym("qdd", robot.n)
        self._qdd_joints = ca.SX.sym("qdd_joints", max(0, robot.n - 6))
        self._lam = ca.SX.sym("lam", sum(len(loop.units) for loop in robot.loops.values()))
        pieces = ca.vertsplit(self._p, np.cumsum([0, *(v.size for v in values.values())]).tolist()) if values else []
        self.robot = robot.with_values(
            {path: _like(robot.value(path), symbol) for path, symbol in zip(values, pieces, strict=True)}
        )
        self._made = {}

    def _function(self, name, arguments, expression, outputs=None, place=None):
        key = name, place  # names of two places can agree: they hold six digits of X and plain letters
        if key not in self._made:
            symbols = {"q": self._q, "qd": self._qd, "u": self._u, "qdd": self._qdd, "p": self._p,
                       "lam": self._lam}  # fmt: skip
            symbols["qdd_joints"] = self._qdd_joints
            names = [*arguments, "p"] if self.parameters else list(arguments)
            results = expression()
            results = results if isinstance(results, (list, tuple)) else [results]
            results = [ca.densify(ca.SX(r)) for r in results]
            function = ca.Function(name, [symbols[n] for n in names], results, names, outputs or ["out"])
            self._made[key] = RobotFunction(function, self._turning)
        return self._made[key]

    def _at(self, kind, segment, X, arguments, expression):
        """Function of a place."""
        return self._function(_name(kind, segment, X), arguments, expression, place=(segment, X))

    @cached_property
    def _turning(self):
        return Turning(self.robot.tree, self._q, self._p)

    @cached_property
    def _kin(self):
        return Kinematics(self.robot.tree, self._q)

    @cached_property
    def _statics(self):
        return Statics(self.robot, self._q, self._u)

    @cached_property
    def _driven(self):
        """The statics whose cables rub as they move."""
        return Statics(self.robot, self._q, self._u, self._qd) if self.robot.friction else self._statics

    def pose(self, segment, X=1.0):
        """World <- frame at X of a segment [4 x 4] (q)."""
        frame = self.robot.tree.locate(segment, X)
        return self._at("pose", segment, X, "q", lambda: self._kin.frame_pose(frame))

    def jacobian(self, segment, X=1.0):
        """Body Jacobian [6 x n] of the frame at X of a segment (q)."""
        frame = self.robot.tree.locate(segment, X)
        return self._at("jacobian", segment, X, "q", lambda: self._kin.jacobian(frame))

    @property
    def elastic_force(self):
        """Elastic force [n] of rods and joint springs (q)."""
        return self._function("elastic_force", "q", self._statics.elastic_force)

    @property
    def stiffness(self):
        """Tangent [n x n] of the elastic force (q)."""
        return self._function("stiffness", "q", self._statics.stiffness)

    @property
    def damping(self):
        """Kelvin-Voigt and joint damping [n x n] (q)."""
        return self._function("damping", "q", self._statics.damping)

    @property
    def external_force(self):
        """Generalised force [n] of gravity, buoyancy, loads, and the water's drag and lift (q, qd)."""
        return self._function("external_force", ("q", "qd"), self._external)

    def _external(self):
        return self._statics.weights_and_loads() + newton_euler.water_force(self.robot, self._q, self._qd)

    @property
    def mass(self):
        """M [n x n], with added mass (q)."""
        return self._function("mass", "q", lambda: composite.mass(self.robot, self._kin))

    @property
    def coriolis(self):
        """C [n x n], M' - 2 C skew (q, qd)."""
        return self._function("coriolis", ("q", "qd"), lambda: composite.coriolis(self.robot, self._kin, self._qd))

    @property
    def inverse_dynamics(self):
        """tau [n] = M qdd + C qd + elastic + damping qd - external, without loops (q, qd, qdd)."""

        def forces(robot, q, qd, qdd, still, gravity):
            return newton_euler.inertial_force(robot, q, qd, qdd, gravity=gravity) + still(q, qd)

        return self._moving("inverse_dynamics", ("q", "qd", "qdd"), forces)

    def _moving(self, name, arguments, compute):
        """Function of motion: compute(robot, q, qd, further arguments, still, gravity) with still(q, qd) what masses do
        not count in, and `gravity` what the masses shall weigh by themselves; None: `still` holds their weight."""
        gravity = self.robot.description.gravity if self.robot.water is None else None  # no added mass from falling
        if not self.chained:
            symbols = [getattr(self, f"_{a}") for a in arguments]
            return self._function(
                name, arguments, lambda: compute(self.robot, *symbols, lambda q, qd: self._unmoved(gravity), gravity)
            )

        def linked(*symbols):
            still = ca.Function("still", [self._q, self._qd], [ca.densify(ca.SX(self._unmoved(gravity)))])
            return compute(self.robot, *symbols, still, gravity)

        return self._linked(name, arguments, linked)

    def _linked(self, name, arguments, compute):
        """Function of compute(*symbols), in MX: a chain of calls."""
        if name not in self._made:
            if self.parameters:
                raise ValueError("chained functions take no parameters; leave `chained` or `parameters` out")
            symbols = [ca.MX.sym(a, getattr(self, f"_{a}").numel()) for a in arguments]
            function = ca.Function(name, symbols, [compute(*symbols)], list(arguments), ["out"])
            self._made[name] = RobotFunction(function, self._turning)
        return self._made[name]

    def _unmoved(self, gravity):
        """Elastic + damping qd - loads [n], less the weights unless masses weigh by themselves under `gravity`."""
        s = self._statics
        carried = s.weights_and_loads() if gravity is None else s.applied_force()
        return s.elastic_force() + s.damping() @ self._qd - carried

    @property
    def floating_inverse_dynamics(self):
        """Accelerations of a free base's coordinates [6] and the forces of all others [n - 6], no wrench on the base.

        (q, qd, qdd_joints [n - 6]). Raises ValueError unless one free joint carries the robot, and with loops, whose
        forces no accelerations decide.
        """
        floating.base_piece(self.robot.tree)
        self._refuse_loops("floating_inverse_dynamics", "use forward_dynamics")

        def answers():
            other = self._unmoved(None)
            return list(floating.inverse_dynamics(self.robot, self._kin, self._qd, self._qdd_joints, other))

        arguments = ("q", "qd", "qdd_joints")
        return self._function("floating_inverse_dynamics", arguments, answers, ["qdd_base", "forces"])

    @property
    def forward_dynamics(self):
        """qdd [n] by articulated bodies; loops stay closed, by least multipliers (q, qd, u)."""
        if self.robot.loops:
            return self._of_closed("forward_dynamics", 0)

        def answer(robot, q, qd, u, still, gravity):
            return articulated.accelerations(robot, q, qd, self._driving(q, qd, u) - still(q, qd), gravity)

        return self._moving("forward_dynamics", ("q", "qd", "u"), answer)

    @cached_property
    def _loops(self):
        return Loops(self.robot.loops, self._kin)

    @cached_property
    def _closed(self):
        """qdd [n] and multipliers [k] of motion with closed loops."""
        gravity = self.robot.description.gravity if self.robot.water is None else None
        still = ca.DM.zeros(self.robot.n)
        missing = newton_euler.inertial_force(self.robot, self._q, self._qd, still, gravity=gravity)
        force = self._driven.actuation() @ self._u - missing - self._unmoved(gravity)
        rows = self._loops.jacobian(), self._turned_rows(), self._loops.units
        return closed.accelerations(self.robot, self._kin, force, *rows)

    def _of_closed(self, name, k):
        """Function of the k-th of what `_closed` gives (q, qd, u)."""
        arguments = ("q", "qd", "u")
        if not self.chained:
            return self._function(name, arguments, lambda: self._closed[k])
        return self._linked(name, arguments, lambda *symbols: self._closed_links(*symbols)[k])

    def _closed_links(self, q, qd, u):
        """qdd [n] and multipliers [k] as calls: of inverse dynamics, of masses and rows, and of what solves."""
        masses, solved, scale = self._closed_blocks
        force = self._driving(q, qd, u) - self.inverse_dynamics.function(q, qd, ca.DM.zeros(self.robot.n))
        qdd, lam = solved(*masses(q), force, self.loop_bias.function(q, qd) * scale)
        return qdd, lam * scale

    @cached_property
    def _closed_blocks(self):
        """Functions (q) -> masses and rows, and (those, force, bias) -> answer; what the rows are multiplied by."""
        N, A, mass, scale = closed.augmented(self.robot, self._kin, self._loops.jacobian(), self._loops.units)
        given = [ca.sparsify(ca.SX(x)) for x in (N, A, mass)]  # zeros save most of the answer of a planar robot
        symbols = [ca.SX.sym(name, x.sparsity()) for name, x in zip(("N", "A", "m"), given, strict=True)]
        symbols += [ca.SX.sym("force", self.robot.n), ca.SX.sym("bias", A.rows())]
        masses = ca.Function("masses_and_rows", [self._q], ca.cse(given))
        return masses, ca.Function("closed_answer", symbols, ca.cse(list(closed.answer(*symbols)))), scale

    def _turned_rows(self):
        return ca.jtimes(self._loops.jacobian() @ self._qd, self._q, self._qd)

    @property
    def loop_error(self):
        """e [k] of all loops in file order, zero when they are closed; m and rad (q)."""
        return self._function("loop_error", "q", self._loops.error)

    @property
    def loop_jacobian(self):
        """A [k x n]: A qd = 0 is what closed loops leave, and A^T lam their force (q)."""
        return self._function("loop_jacobian", "q", self._loops.jacobian)

    @property
    def loop_bias(self):
        """A' qd [k]: A qdd + A' qd = 0 keeps loops closed (q, qd)."""
        return self._function("loop_bias", ("q", "qd"), self._turned_rows)

    @property
    def loop_force(self):
        """Multipliers lam [k] of the loops in motion, the least where rows depend on each other; N and N m (q, qd, u).

        Their order is that of `loop_error`: loops in file order (`slices(robot.loops)` of mechanics.loops), of each the
        rows that its joint holds, turns first. A^T lam pushes the coordinates, M qdd + ... = tau + A^T lam. With the
        `own` rows of a loop, Phi_perp() @ lam[own] of its record `robot.loops[name]` is the wrench [moment; force] on
        what stands on a by what stands on b, in b's joint frame: what results call `loops.NAME`.
        """
        return self._of_closed("loop_force", 1)

    @property
    def loop_rows(self):
        """e [k] and its derivative E [k x n]; E is A where e = 0 (q)."""
        return self._function("loop_rows", "q", lambda: [self._loops.error(), self._loops.slope()], ["error", "slope"])

    @property
    def loop_motion(self):
        """e [k], A [k x n] and A' qd [k] of all loops in one Function (q, qd)."""

        def rows():
            return [self._loops.error(), self._loops.jacobian(), self._turned_rows()]

        return self._function("loop_motion", ("q", "qd"), rows, ["error", "jacobian", "bias"])

    @property
    def closing(self):
        """e [k], its derivative E [k x n], and d(E^T lam)/dq [n x n]; E is A where e = 0 (q, lam)."""

        def rows():
            return [self._loops.error(), self._loops.slope(), self._loops.turning(self._lam)]

        return self._function("closing", ("q", "lam"), rows, ["error", "slope", "turning"])

    def _driving(self, q, qd, u):
        """B u [n]."""
        driving = self._driven.actuation() @ self._u
        if not self.chained:
            return driving
        return ca.Function("driving", [self._q, self._qd, self._u], [ca.densify(driving)])(q, qd, u)

    @property
    def motion_residual(self):
        """inverse_dynamics - B u [n]: what is missing for motion under inputs u (q, qd, qdd, u)."""

        def missing(robot, q, qd, qdd, u, still, gravity):
            inertial = newton_euler.inertial_force(robot, q, qd, qdd, gravity=gravity)
            return inertial + still(q, qd) - self._driving(q, qd, u)

        return self._moving("motion_residual", ("q", "qd", "qdd", "u"), missing)

    @property
    def motion_tangents(self):
        """Derivatives of `motion_residual` in qdd, exact: M, and near rest in q and in qd [n x n each] (q, qd, u).

        Terms that are quadratic in the rates count for the water only; they are small over a step of an integrator.
        """

        def tangents():
            s, damping = self._driven, self._statics.damping()
            if self.robot.friction:
                damping = damping + s.actuation_damping()
            if self.robot.water is not None:
                damping = damping - ca.jacobian(newton_euler.water_force(self.robot, self._q, self._qd), self._qd)
            return [composite.mass(self.robot, self._kin), s.tangent(), damping]

        return self._function("motion_tangents", ("q", "qd", "u"), tangents, ["mass", "stiffness", "damping"])

    @property
    def power(self):
        """Power [4, W] of inputs, loads, damping and water, and the wrench [6] on the whole robot about the world's
        origin of weight, loads and water (q, qd, u)."""

        def powers():
            s, qd = self._statics, self._qd
            water = newton_euler.water_force(self.robot, self._q, qd)
            forces = (self._driven.actuation() @ self._u, s.applied_force(), -s.damping() @ qd, water)
            wrench = s.carried_wrench() + newton_euler.water_wrench(self.robot, self._q, qd)
            return [ca.vertcat(*(ca.dot(force, qd) for force in forces)), wrench]

        return self._function("power", ("q", "qd", "u"), powers, ["power", "wrench"])

    @property
    def momentum(self):
        """Angular momentum about the world's origin and linear momentum [6], world axes (q, qd)."""
        return self._function("momentum", ("q", "qd"), lambda: composite.momentum(self.robot, self._kin, self._qd))

    @property
    def actuation(self):
        """B [n x m], tau = B u (q)."""
        return self._function("actuation", "q", self._statics.actuation)

    @property
    def actuator_lengths(self):
        """Length [m] of each actuator's lines, summed over lines that share an input; a joint's coordinate (q)."""

        def lengths():
            tree = self.robot.tree
            rows = [sum((line.length(tree, self._q) for line in shares), ca.SX(0)) for shares in self.robot.lines]
            return ca.vertcat(*rows) if rows else ca.DM(0, 1)

        return self._function("actuator_lengths", "q", lengths)

    def cable(self, name):
        """(s [m] along a cable from its motor, tension over that at the motor) where its straight runs and sections
        begin and end, and inside (q). Raises ValueError for what is no cable."""
        actuator = (self.robot.description.actuators or {}).get(name)
        if not isinstance(actuator, Tendon):
            raise ValueError(f"'{name}' is no cable of the robot")
        lines = self.robot.lines[self.robot.inputs.index(name)]

        def found():
            return list(friction.stations(self.robot.tree, lines, self._q, actuator.friction, actuator.moving))

        return self._function(f"cable_{name}".replace("-", "_"), "q", found, ["s", "ratio"], place=name)

    @property
    def static_residual(self):
        """Elastic - external - B u [n] (q, u)."""
        return self._function("static_residual", "qu", self._statics.residual)

    @property
    def static_tangent(self):
        """d(static_residual)/dq [n x n] (q, u)."""
        return self._function("static_tangent", "qu", self._statics.tangent)

    @property
    def statics(self):
        """Residual [n], its tangent [n x n] and B [n x m] in one Function (q, u)."""
        s = self._statics
        return self._function(
            "statics", "qu", lambda: [s.residual(), s.tangent(), s.actuation()], ["residual", "tangent", "actuation"]
        )

    @property
    def energy(self):
        """Kinetic, elastic and gravitational energy [3] in J (q, qd)."""

        def energies():
            kinetic = composite.kinetic_energy(self.robot, self._q, self._qd)
            gravitational = internal.gravitational_energy(self.robot, self._kin)
            return ca.vertcat(kinetic, self._statics.elastic_energy(), gravitational)

        return self._function("energy", ("q", "qd"), energies)

    def internal_wrench(self, segment, X):
        """Elastic wrench [moment; force] at X of a rod that equilibrium asks for, body frame (q, u).

        Raises ValueError with loops.
        """
        self._refuse_loops("internal_wrench", "what they bear is in the answer of statics (`loops.NAME`)")
        return self._at("internal_wrench", segment, X, "qu", lambda: internal.wrench(self._statics, segment, X))

    def reaction(self, segment):
        """Wrench [6] on a segment from what carries it, structure and cables together, at its base, base frame (q).

        Raises ValueError with loops.
        """
        self._refuse_loops("reaction", "the answer of statics has it (`reaction.NAME`)")
        return self._at("reaction", segment, 0, "q", lambda: internal.reaction(self._statics, segment))

    def _refuse_loops(self, name, instead):
        """Raise ValueError where loops push, too, with forces that the arguments do not hold."""
        if self.robot.loops:
            raise ValueError(f"{name} does not know what loops bear ({', '.join(self.robot.loops)}): {instead}")

    def screw(self, segment, section=0):
        """Function of numeric q that gives pitch, axis and magnitude of a section's or joint's screw."""
        piece = self.base.tree.pieces[self.base.tree.of[segment][section]]
        return lambda q: screws.screw(np.array(ca.DM(piece.strain(ca.DM(q)))).ravel(), float(piece.length))


def _like(value, symbol):
    """The symbol in the shape of the value it replaces."""
    if not isinstance(value, (tuple, list)):
        return symbol
    if isinstance(value[0], (tuple, list)):
        width = len(value[0])
        return tuple(tuple(symbol[i * width + j] for j in range(width)) for i in range(len(value)))
    return tuple(symbol[i] for i in range(len(value)))


@lru_cache(maxsize=4096)
def _name(kind, segment, X):
    """A legal CasADi name for a Function of a place."""
    text = f"{kind}_{segment}_{X:g}".replace(".", "_").replace("-", "m").replace("+", "")
    text = "".join(c if c.isalnum() and c.isascii() else "_" for c in text)
    while "__" in text:
        text = text.replace("__", "_")
    return text.strip("_")
