"""How a point of a robot in equilibrium gives way to a small force, and how that changes with posture and tensions.

With b = d(a . position)/dq for a unit direction a, K = dr/dq the tangent of the static residual and dr/du = -B,
    tensions held:  C_T = b . delta,  K delta = b;
    lengths held:   C_L = b . delta,  K delta - B t = b,  l_q delta = D t,
with t the change of tensions, l_q the slope of the lengths of taut cables (and of chambers, whose volume is held), D
the cable's own compliance L/EA, L its unstretched length. Slack cables hold nothing: t = 0. While tensions are sought,
a cable counts by w = T / (T + soft), so that nothing jumps where it goes slack:
    w l_q delta = (w D + (1 - w) D0) t,    D0 the robot's own compliance along the cable.
Derivatives come from the adjoint of these equations. Shapes and inputs are over their scales here, t too.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.mechanics.actuators import Chamber
from socontrol.mechanics.kinematics import Kinematics
from socontrol.native.buffers import buffered
from socontrol.programs.postures.goals import locate
from socontrol.programs.postures.waypoints import unit

TAUT = 1e-6  # of an input's scale: less tension than this is none
FLOOR = 1e-12  # of length^2 / energy: less compliance than this is none
RANK = 1e-10  # of the cables' compliances: cables that hold the same motion hold it once


@dataclass(frozen=True)
class Moved:
    """What 1 N along the axis does: shape delta [f], inputs t [m], both adjoints, compliance [m/N], and the slopes
    [m] of the compliance in the weights."""

    delta: np.ndarray
    t: np.ndarray
    delta_adjoint: np.ndarray
    t_adjoint: np.ndarray
    compliance: float
    by_weight: np.ndarray


class Compliances:
    """The compliances at X = `record.at` of `record.on` along `record.axis`, at postures of a `redundancy`.

    level: what counts as a middling compliance, that of the posture `here` with tensions held.
    """

    def __init__(self, solver, redundancy, record, here):
        self.robot, self._scales = solver.posture.robot, solver.posture.scales
        self._posture, self._redundancy = solver.posture, redundancy
        self._frame, self._axis = locate(self.robot, record), unit(record.axis)
        self.q, self.u = redundancy.q, np.arange(redundancy.program.scale.size)[redundancy.program.variables["u"].where]
        self._inputs = np.searchsorted(redundancy.y, self.u)
        self.cables, kinds = self.robot.pulls, self.robot.input_actuators
        self._chambers = np.array([isinstance(kind, Chamber) for kind in kinds], dtype=float)
        self._rigidity = [getattr(kind, "stiffness", None) for kind in kinds]
        self.floor = FLOOR * self.robot.length**2 / self._scales.energy
        self.level = max(abs(self.at(here).compliance), self.floor)

    def taut(self, here):
        """Weights [m]: 1 for what holds its length at this posture, taut cables and chambers, else 0."""
        return np.where(self.cables, here.x[self.u] > TAUT, self._chambers).astype(float)

    def weights(self, here, soft):
        """Weights [m] T / (T + soft), and their derivative in the inputs."""
        pull = np.maximum(here.x[self.u], 0.0)
        return np.where(self.cables, pull / (pull + soft), self._chambers), self.cables * soft / (pull + soft) ** 2

    def at(self, here, weights=None):
        """What 1 N does with tensions held, or with lengths held by `weights` [m]."""
        b, slopes, own = (np.array(a.T) for a in self._measures(here.x))
        b, slopes, own = b[self.q, 0], slopes[:, self.q], own[:, 0]
        K, drive, none = here.tangent, here.drive[:, self._inputs], np.zeros(own.size)
        delta, back = np.linalg.solve(K, b / self._scales.energy), np.linalg.solve(K.T, b)
        if weights is None:
            return Moved(delta, none, back, none, float(b @ delta), none)
        through, soft = np.linalg.solve(K, drive), self._along
        N = weights[:, None] * (slopes @ through) + np.diag(weights * own + (1 - weights) * soft)
        inverse = np.linalg.pinv(N, rcond=RANK)
        t, t_back = inverse @ (weights * (slopes @ delta)), inverse.T @ (drive.T @ back)
        delta, back = delta - through @ t, back - np.linalg.solve(K.T, slopes.T @ (weights * t_back))
        return Moved(delta, t, back, t_back, float(b @ delta), t_back * (t * (own - soft) - slopes @ delta))

    def both(self, here):
        """(C_T, C_L) [m/N] at a posture; 0 where it is rounding alone."""
        found = self.at(here).compliance, self.at(here, self.taut(here)).compliance
        return tuple(0.0 if abs(compliance) < self.floor else compliance for compliance in found)

    def gradient(self, here, moved, weights=None):
        """d(compliance)/dx [size of x], the weights as they are."""
        way, back = np.zeros((2, here.x.size))
        way[self.q], way[self.u], back[self.q] = moved.delta, moved.t, moved.delta_adjoint
        weights = np.zeros(moved.t.size) if weights is None else weights
        (slope,) = self._slope(here.x, self._redundancy.p, way, back, moved.t_adjoint, weights)
        return slope.ravel().copy()

    def tensions_held(self, sign):
        """The quantity sign asinh(C_T / level): (posture) -> (value, gradient in x)."""

        def quantity(here):
            moved = self.at(here)
            return self._graded(sign, moved, lambda: self.gradient(here, moved))

        return quantity

    def lengths_held(self, sign, weights=None, soft=None):
        """The quantity sign asinh(C_L / level) with `weights` [m] that stay, or those of `soft` (of inputs' scales)."""

        def quantity(here):
            w, change = (weights, 0.0) if soft is None else self.weights(here, soft)
            moved = self.at(here, w)

            def gradient():
                slope = self.gradient(here, moved, w)
                slope[self.u] += moved.by_weight * change
                return slope

            return self._graded(sign, moved, gradient)

        return quantity

    def _graded(self, sign, moved, gradient):
        share = moved.compliance / self.level
        return sign * np.arcsinh(share), sign * gradient() / (self.level * np.hypot(1.0, share))

    @cached_property
    def _along(self):
        """D0 [m]: how far each actuator's length gives way to its own scale of force, at q = 0."""
        balance, scales = self._posture.balance, self._scales
        free, zero = self._posture.free, np.zeros(self._redundancy.program.scale.size)
        _, K, B = balance.evaluate(np.zeros(self.robot.n), np.zeros(self.robot.m))
        K = (K * scales.q / scales.force[:, None])[free][:, free]
        drive = (B * scales.u / scales.force[:, None])[free]
        slopes = self._measures(zero)[1].T[:, self._redundancy.coordinates]
        return np.maximum(np.abs(np.sum(slopes.T * np.linalg.lstsq(K, drive, rcond=None)[0], axis=0)), 1e-300)

    @cached_property
    def _terms(self):
        """x, and at x: the position along the axis [m], lengths [m], and the cables' own L/EA over u's scales [m]."""
        program, s = self._redundancy.program, self._scales
        x = self._posture.exact.functions["nlp"]["x"]
        q, u = x[program.variables["q"].where] * ca.DM(s.q), x[program.variables["u"].where] * ca.DM(s.u)
        place = se3.position(Kinematics(self.robot.tree, q).frame_pose(self._frame))
        lengths = ca.densify(ca.SX(self.robot.functions(compiled=False).actuator_lengths.function(q)))
        own = [
            0 if rigidity is None else float(s.u[i]) * lengths[i] / (rigidity + u[i])
            for i, rigidity in enumerate(self._rigidity)
        ]
        return x, ca.dot(ca.DM(self._axis), place), lengths, ca.vertcat(*own)

    @cached_property
    def _measures(self):
        """Function (x) -> b [size of x], slopes of the lengths [m x size of x], own compliances [m]."""
        x, place, lengths, own = self._terms
        answers = [ca.gradient(place, x), ca.jacobian(lengths, x), own]
        return buffered(ca.Function("measures", [x], [ca.densify(ca.SX(a)) for a in answers]))

    @cached_property
    def _slope(self):
        """Function (x, p, change of x, its adjoint, adjoint of t, weights) -> d(compliance)/dx."""
        x, place, lengths, own = self._terms
        made, where = self._posture.exact.functions["nlp"], self._redundancy.program.variables
        residual = made["g"][self._redundancy.program.constraints["equilibrium"].where]
        way, back = ca.SX.sym("way", x.numel()), ca.SX.sym("back", x.numel())
        t_back, weights = ca.SX.sym("t_back", self.robot.m), ca.SX.sym("weights", self.robot.m)
        rows = ca.dot(back[where["q"].where], ca.jtimes(residual, x, way))
        if "loops" in self._redundancy.program.constraints:
            loops = made["g"][self._redundancy.program.constraints["loops"].where]
            bearing = self.q[self._redundancy.coordinates.size :].tolist()
            rows += ca.dot(back[bearing], ca.jtimes(loops, x, way))
        stretched = ca.jtimes(lengths, x, way) - own * way[where["u"].where]
        change = ca.jtimes(place, x, way + back / self._scales.energy) - rows - ca.dot(t_back * weights, stretched)
        arguments = [x, made["p"], way, back, t_back, weights]
        return buffered(ca.Function("slope", arguments, [ca.densify(ca.gradient(change, x))]))
