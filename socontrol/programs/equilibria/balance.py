"""Forward statics: the configuration that balances given inputs and loads, by scaled Newton steps.

Solves r(q) = 0 with exact tangents. Each step is shortened until the scaled residual falls; when that fails the
unbalanced force is let in gradually, H(q, t) = r(q) - (1 - t) r(q0), with t from 0 to 1 (load steps).
"""

from dataclasses import dataclass

import numpy as np

from socontrol.mechanics.loads import Wrench, is_zero
from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.result import Status

TOLERANCE = 1e-12  # on the scaled residual, beside the rounding error of the largest elastic force
LONGEST = 2.0  # largest scaled coordinate change of one step: about two radians of a section
SMALLEST_STEP = 1e-4  # of the load parameter


@dataclass(frozen=True)
class Equilibrium:
    """q [n], residual [n] in SI, iterations, status."""

    q: np.ndarray
    residual: np.ndarray
    iterations: int
    status: Status


class Balance:
    """A robot's statics Function behind buffers, with its scales; solves for q at any (u, p)."""

    def __init__(self, robot, parameters=(), scaling=None):
        self.robot, self.parameters = robot, tuple(parameters)
        self.conservative = all(load.conservative for load in robot.loads)
        functions = robot.functions(parameters)
        self.defaults = functions.defaults
        self.function = functions.statics.function
        self.scales = scaling or scales(robot)
        self._buffers = buffered(functions.statics)
        self._q, self._u, self._p = (*self._buffers.inputs, np.array(self.defaults))[:3]
        (self._r,), self._K, self._B = self._buffers.outputs
        self._run = self._buffers.run

    def evaluate(self, q, u, p=None):
        """Residual [n], tangent [n x n] and actuation [n x m] (SI); the arrays are reused by the next call."""
        self._q[:], self._u[:] = q, u
        self._p[:] = self.defaults if p is None else p
        self._run()
        return self._r, self._K.T, self._B.T

    def started(self, q0, prescribed):
        """(q [n] to begin from, mask [n] of what is free); `prescribed` {index: value}."""
        q = np.zeros(self.robot.n) if q0 is None else np.array(q0, dtype=float)
        free = np.ones(q.size, dtype=bool)
        for index, value in (prescribed or {}).items():
            q[index], free[index] = value, False
        return q, free

    def solve(self, u, q0=None, p=None, prescribed=None, max_iterations=200, settle=True):
        """Equilibrium at inputs u from q0 (default: 0); `prescribed` {index: value} locks coordinates.

        Without `settle` the one that Newton's method alone finds, stable or not.
        """
        q, free = self.started(q0, prescribed)
        u = np.asarray(u, dtype=float)
        solution, count, reached = self._newton(q, u, p, free, None, 40)
        if settle and not (reached and self._stands(solution, u, p, free)):
            rest, more, settled = self._settle(q, u, p, free, 60)
            if settled:
                solution, count, reached = rest, count + more, True
        if settle and not reached:
            solution, more, reached = self._load_steps(q, u, p, free, max_iterations - count)
            count += more
        residual = np.array(self.evaluate(solution, u, p)[0])
        residual[~free] = 0.0
        return Equilibrium(solution, residual, count, _status(reached, residual, count, max_iterations))

    def _newton(self, q, u, p, free, offset, limit):
        """Damped Newton steps on r(q) - offset; returns (q, iterations, converged)."""
        size, force = self.scales.q[free], self.scales.force[free]
        q = q.copy()
        with np.errstate(all="ignore"):
            r, K, merit = self._scaled(q, u, p, free, offset, size, force)
            for count in range(limit):
                if not np.isfinite(merit):
                    return q, count, False
                step = newton_step(K, r)
                step *= min(1.0, LONGEST / max(np.max(np.abs(step), initial=0.0), 1e-300))
                if np.max(np.abs(r), initial=0.0) <= TOLERANCE or np.max(np.abs(step), initial=0.0) <= 4e-16 * (
                    1 + np.max(np.abs(q[free] / size), initial=0.0)
                ):
                    return q, count, bool(np.max(np.abs(r), initial=0.0) <= 1e-9)
                q, r, K, merit, moved = self._search(q, step, (u, p, free, offset, size, force), r, K, merit)
                if not moved:
                    return q, count + 1, bool(np.max(np.abs(r), initial=0.0) <= 1e-9)
        return q, limit, False

    def _stands(self, q, u, p, free):
        """Whether an equilibrium is stable or marginal."""
        _, K, _ = self._scaled(q, u, p, free, None, self.scales.q[free], self.scales.force[free])
        return K.size == 0 or bool(np.min(np.linalg.eigvals(K).real) > -1e-9)

    def _settle(self, q, u, p, free, limit):
        """Implicit Euler steps of q' = -r with growing time steps: as a damped robot without mass comes to rest.

        Source: C. Kelley, D. Keyes, SIAM J. Numer. Anal. 35 (1998), pseudo-transient continuation.
        """
        size, force = self.scales.q[free], self.scales.force[free]
        rate, q = 1.0, q.copy()
        r, K, _ = self._scaled(q, u, p, free, None, size, force)
        for count in range(limit):
            if not np.all(np.isfinite(K)) or np.max(np.abs(r), initial=0.0) <= TOLERANCE:
                return q, count, bool(np.all(np.isfinite(K)))
            shift = rate + max(0.0, -1.5 * np.linalg.eigvalsh((K + K.T) / 2)[0])
            step = -np.linalg.solve(K + shift * np.eye(r.size), r)
            longest = np.max(np.abs(step))
            step *= min(1.0, LONGEST / 2 / longest)
            trial = q.copy()
            trial[free] += step * size
            r1, K1, merit = self._scaled(trial, u, p, free, None, size, force)
            if np.isfinite(merit) and step @ r1 <= 0.5 * abs(step @ r):  # not far beyond the rest along this step
                q, r, K, rate = trial, r1, K1, rate / 3
                if longest <= 4e-16 * (1 + np.max(np.abs(q[free] / size))):
                    return q, count, bool(np.max(np.abs(r)) <= 1e-9)
            else:
                rate = max(4 * rate, 1e-3)
                if rate > 1e8:
                    return q, count, False
        return q, limit, False

    def _search(self, q, step, args, r, K, merit):
        """The longest of 1, 1/2, 1/4 ... steps that lowers the merit."""
        free, size = args[2], args[4]
        for halving in range(12):
            trial = q.copy()
            trial[free] += 0.5**halving * step * size
            r1, K1, merit1 = self._scaled(trial, *args)
            if merit1 < merit * (1 - 1e-4 * 0.5**halving):
                return trial, r1, K1, merit1, True
        return q, r, K, merit, False

    def _scaled(self, q, u, p, free, offset, size, force):
        r, K, _ = self.evaluate(q, u, p)
        r = (r - (0.0 if offset is None else offset))[free] / force
        return r, K[np.ix_(free, free)] * size[None, :] / force[:, None], float(np.dot(r, r))

    def _load_steps(self, q, u, p, free, limit):
        start = np.array(self.evaluate(q, u, p)[0])
        t, step, count, fast = 0.0, 0.25, 0, 0
        while t < 1.0 and count < limit:
            target = min(1.0, t + step)
            trial, used, reached = self._newton(q, u, p, free, (1 - target) * start, 25)
            count += used
            if reached:
                q, t, fast = trial, target, fast + 1
                step = step * 2 if fast >= 2 else step
            else:
                step, fast = step / 2, 0
                if step < SMALLEST_STEP:
                    break
        return q, count, t >= 1.0


def load_parameters(robot):
    """Paths of the point loads' forces and moments that are not zero."""
    return [
        f"loads.{name}.{key}"
        for name, load in (robot.description.loads or {}).items()
        if isinstance(load, Wrench)
        for key in ("force", "moment")
        if not is_zero(getattr(load, key))
    ]


def newton_step(K, r):
    """Newton step -K^-1 r; where K is singular, least squares, and downhill along the force they leave."""
    try:
        return -np.linalg.solve(K, r)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(K, r, rcond=1e-12)[0]
        return -(step + r - K @ step)


def _status(reached, residual, count, limit):
    if reached:
        return Status("solved", "In equilibrium.")
    if not np.all(np.isfinite(residual)):
        return Status("numerical", "The model gave NaN or infinity on the way; lower loads or inputs.")
    if count >= limit:
        sentence = "No equilibrium within the iteration limit; raise the solver's `max_iterations` or lower the loads."
        return Status("limit", sentence)
    return Status(
        "infeasible", "No equilibrium was found by load steps: the robot may buckle on the way; lower loads or inputs."
    )
