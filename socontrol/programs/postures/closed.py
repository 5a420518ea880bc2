"""Loops in the program of a posture: which rows of e(q) = 0 are asked for, and the multipliers lam [k] on them.

Rows that depend on others at a closed shape would leave a program without a solution for its multipliers, so they are
left out and their multipliers are zero; at its answer all rows are looked at. Multipliers told are the least that push
alike.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.mechanics.loops import chosen
from socontrol.programs.equilibria.closing import ITERATIONS, Assembly

HELD = 1e-8  # scaled error of rows that were left out, beyond which they are not held by the others


class ClosedRows:
    """The loops of a ClosedBalance, moved by the coordinates that are `free` [n]; `index`: rows that hold them at q."""

    def __init__(self, balance, free, q):
        self.balance, self.free = balance, free
        self.index = chosen(self._slopes(q), balance.units, balance.robot.length)
        self.reach, self.units = balance.reach[self.index], tuple(balance.units[i] for i in self.index)

    @cached_property
    def scale(self):
        """Magnitude of the multipliers [k], N or N m."""
        return self.balance.scales.energy / self.balance.reach

    def limits(self):
        """(lower [k], upper [k]) of the multipliers: none but of rows that are left out, which are 0."""
        upper = np.zeros(self.balance.reach.size)
        upper[self.index] = np.inf
        return -upper, upper

    def _slopes(self, q):
        """E [k x f], coordinates over their scales; the rows' own units."""
        return self.balance.closing(q)[1][:, self.free] * self.balance.scales.q[self.free]

    def joined(self, program, residual, tangent, curvature):
        """(residual, tangent, curvature) of the equilibrium with the multipliers, which join the program like the rows.

        The residual less E^T lam, E = de/dq of the rows asked for; as second derivative of lam . e the tangent, and as
        those of lam . E mu in q and in lam the curvature along mu, change.
        """
        lower, upper = self.limits()
        lam = program.variable("lam", upper.size, scale=self.scale, lower=lower, upper=upper)[self.index.tolist()]
        q, bearing = (program.variables[name] for name in ("q", "lam"))
        hat, size = q.symbol, ca.DM(q.scale)
        f = self.balance.robot.functions(compiled=False)
        e = f.loop_error.function(hat * size)[self.index.tolist()]
        E = ca.jacobian(e, hat) @ ca.diag(1 / size)
        turning, push = ca.hessian(ca.dot(lam, e), hat)
        turning, push = ca.diag(1 / size) @ turning @ ca.diag(1 / size), push / size
        program.constrain("loops", e, scale=self.reach, unit=self.units, tangent={"q": E})
        asked = ca.DM(np.eye(upper.size)[self.index])

        def bent(mu):
            both = ca.vertcat(hat, bearing.symbol)
            pushed = ca.dot(lam, ca.jtimes(e, hat, mu / size))
            scale = ca.diag(1 / ca.DM(np.concatenate([q.scale, bearing.scale])))
            H, blocks, n = scale @ ca.hessian(pushed, both)[0] @ scale, curvature(mu), hat.numel()
            return {**blocks, ("q", "q"): blocks["q", "q"] - H[:n, :n], ("q", "lam"): -H[:n, n:]}

        return residual - push, {"q": tangent["q"] - turning, "u": tangent["u"], "lam": -(E.T @ asked)}, bent

    def pushing(self, q, u):
        """Multipliers [k] of the rows asked for that balance q and u best."""
        lam, s = np.zeros(self.balance.reach.size), self.balance.scales
        slopes = self._slopes(q)[self.index] / self.reach[:, None]
        missing = self.balance.evaluate(q, u)[0][self.free] / s.force[self.free]
        lam[self.index] = np.linalg.lstsq(slopes.T, missing, rcond=None)[0] * self.scale[self.index]
        return lam

    def least(self, q, lam):
        """The least multipliers [k] that push as lam does."""
        U = self.balance.split(q, self.free).U
        return U @ (U.T @ (lam / self.scale)) * self.scale

    def bear(self, lam):
        """Whether multipliers [k] stand on the rows asked for alone."""
        return not np.any(np.delete(lam, self.index))

    def error(self, q):
        """Largest scaled error of all rows at q."""
        return float(np.max(np.abs(self.balance.closing(q)[0] / self.balance.reach)))

    def hold(self, q):
        """Whether the rows asked for hold all of them at q, and do not depend on each other there."""
        slopes, length = self._slopes(q), self.balance.robot.length
        alone = chosen(slopes[self.index], self.units, length).size == self.index.size
        return alone and self.error(q) <= HELD and chosen(slopes, self.balance.units, length).size == self.index.size

    def elsewhere(self, q):
        """The same loops with the rows that hold them at the closed shape nearest to q."""
        return ClosedRows(self.balance, self.free, Assembly(self.balance, self.free).closed(q, ITERATIONS)[0])

    def told(self, q):
        """Status of loops that are open at q."""
        return Assembly(self.balance, self.free).told(q)
