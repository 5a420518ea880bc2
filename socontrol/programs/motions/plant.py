"""A robot in numbers, ready to be moved through time: residual, tangents and power behind buffers.

Coordinates are free or driven (given in time). The residual r(t, q, qd, qdd) = M qdd + C qd + ... - B u is 0 on the
free ones; on the driven ones it is the force their motors apply.
"""

import casadi as ca
import numpy as np

from socontrol.native.buffers import Buffered, buffered
from socontrol.programs.motions import signals

WORKS = ("inputs", "loads", "damping", "water", "motors")  # what does work, in the order of `Plant.power`


class Plant:
    """inputs, driven, factors: histories of all inputs, of driven coordinates {index: ...} and of loads {name: ...}."""

    def __init__(self, robot, inputs, driven, factors):
        self.robot, self.n = robot, robot.n
        self.driven = np.array(sorted(driven), dtype=int)
        self.free = np.setdiff1d(np.arange(robot.n), self.driven)
        paths, self._scaled = _load_values(robot, factors)
        self.functions = robot.functions(paths)
        f = self.functions
        self._residual = buffered(f.motion_residual)
        self._tangents = buffered(f.motion_tangents)
        self._power = buffered(f.power)
        self._inputs = Sampled(inputs)
        self._driven = Sampled([driven[i] for i in self.driven], order=2)
        self._factors = Sampled([factors[name] for name in factors])
        self.histories = [*inputs, *driven.values(), *factors.values()]
        self.led = bool(self.driven.size)  # whether motors move coordinates or lengths as given

    def inputs(self, t):
        """u [m]."""
        return self._inputs(t)[0]

    def parameters(self, t):
        """Values of the loads that change in time, as the Functions' trailing argument (none: no argument)."""
        if not self._scaled:
            return ()
        factors = self._factors(t)[0]
        return (np.concatenate([values * factors[k] for k, values in self._scaled]),)

    def place(self, t, q, qd, qdd=None):
        """Put the driven coordinates' values at t into q, qd and qdd [n each]."""
        if self.driven.size:
            q[self.driven], qd[self.driven], second = self._driven(t)
            if qdd is not None:
                qdd[self.driven] = second

    def residual(self, t, q, qd, qdd):
        """r [n]; the array is reused."""
        return self._residual(q, qd, qdd, self.inputs(t), *self.parameters(t))[0][0]

    def tangents(self, t, q, qd):
        """M, K, D [n x n each]: derivatives of r in qdd, q and qd, near rest."""
        M, K, D = self._tangents(q, qd, self.inputs(t), *self.parameters(t))
        return M.T.copy(), K.T.copy(), D.T.copy()

    def project(self, t, q, qd):
        """Put what has drifted from conditions on the motion back, in q and qd: here there are none."""

    def power(self, t, q, qd, qdd, r):
        """Power [5, W] of WORKS, and the wrench [6] on the whole robot; r [n]: the residual there."""
        power, wrench = self._power(q, qd, self.inputs(t), *self.parameters(t))
        motors = r[self.driven] @ qd[self.driven] if self.driven.size else 0.0
        return np.concatenate([power[0], [motors], wrench[0]])

    def motors(self, t, q, qd):
        """Forces of the motors on driven coordinates [d] at a state."""
        return self.residual(t, q, qd, self.acceleration(t, q, qd))[self.driven]

    def acceleration(self, t, q, qd):
        """qdd [n] at a state: of the free coordinates from r = 0, of the driven ones given."""
        qdd = np.zeros(self.n)
        self.place(t, q, qd, qdd)
        M = self.tangents(t, q, qd)[0][np.ix_(self.free, self.free)]
        qdd[self.free] -= np.linalg.solve(M, self.residual(t, q, qd, qdd)[self.free])
        return qdd

    def explicit(self):
        """The equation of motion as casadi.integrator wants it: x = free (q, qd), time start + tau span, works."""
        n, k = self.n, self.free.size
        x, tau, p = ca.MX.sym("x", 2 * k), ca.MX.sym("tau"), ca.MX.sym("p", 2)
        t, f = p[0] + tau * p[1], self.functions
        u, parameters = self._inputs.function(t), self._symbolic_parameters(t)
        given = self._driven.function(t)
        q, qd, qdd = (ca.MX(n, 1) for _ in range(3))
        for whole, own, driven in zip((q, qd, qdd), (x[:k], x[k:], None), given, strict=True):
            whole[self.driven.tolist()] = driven
            if own is not None:
                whole[self.free.tolist()] = own
        if self.driven.size:
            free = self.free.tolist()
            missing = f.motion_residual.function(q, qd, qdd, u, *parameters)
            M = f.mass.function(q, *parameters)
            own = -ca.solve(M[free, free], missing[free], "ldl")
            qdd[free] = own
            motors = ca.dot(f.motion_residual.function(q, qd, qdd, u, *parameters), qd)
        else:
            qdd, motors = f.forward_dynamics.function(q, qd, u, *parameters), ca.MX(0)
            own = qdd
        power, wrench = f.power.function(q, qd, u, *parameters)
        power = ca.vertcat(power, motors, wrench)
        return {"x": x, "t": tau, "p": p, "ode": p[1] * ca.vertcat(x[k:], own), "quad": p[1] * power}

    def _symbolic_parameters(self, t):
        if not self._scaled:
            return ()
        factors = self._factors.function(t)
        return (ca.vertcat(*(ca.DM(values) * factors[k] for k, values in self._scaled)),)


class Sampled:
    """Histories [k] and their derivatives up to `order`, as arrays; constant ones are evaluated once."""

    def __init__(self, histories, order=0):
        self.function = signals.sampled(histories, order)
        self._run, self._fixed = Buffered(self.function), None
        if all(self.function.jac_sparsity(k, 0).nnz() == 0 for k in range(order + 1)):
            self._fixed = [output[0].copy() for output in self._run(0.0)]

    def __call__(self, t):
        if self._fixed is not None:
            return self._fixed
        return [output[0].copy() for output in self._run(t)]


def _load_values(robot, factors):
    """Paths of the force and moment of each load that changes, and (index of its factor, values) for each path."""
    paths, scaled = [], []
    for k, name in enumerate(factors):
        for key in ("force", "moment"):
            paths.append(f"loads.{name}.{key}")
            scaled.append((k, np.array(robot.value(paths[-1]), dtype=float)))
    return paths, scaled
