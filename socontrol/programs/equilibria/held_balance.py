"""Forward statics with inputs given by length: their tensions (or pressures) are unknown beside the configuration.

The balances that know held lengths, on trees and with loops; `held_way` is how they find the answer.
"""

import numpy as np

from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.held_way import HeldWay
from socontrol.programs.equilibria.lengths import Routes

DELTA = 1e-2  # scaled compliance of the springs at first, where a section's is 1


class HeldBalance(Balance):
    """A Balance that finds q and the inputs `held`."""

    def __init__(self, robot, held, parameters=(), scaling=None):
        super().__init__(robot, parameters, scaling)
        self.at_lengths, self.routes = held, Routes(robot)
        A = np.abs(self.routes(np.zeros(robot.n))[1][held.index]) * self.scales.q
        reach = np.max(A, axis=1, initial=0.0)
        self.travel = np.where(reach > 0, reach, robot.length)  # by a scaled coordinate, at most
        self.pull = self.scales.energy / self.travel

    def solve(self, u, q0=None, p=None, prescribed=None, max_iterations=200):
        """Equilibrium at inputs u (of those held: a guess) from q0, `prescribed` coordinates locked."""
        free = np.ones(self.robot.n, dtype=bool)
        free[list(prescribed or {})] = False
        way = HeldWay(self, np.asarray(u, dtype=float).copy(), p, prescribed, free, max_iterations)
        return way.solve(q0)

    def at_inputs(self, *args):
        """Equilibrium with the inputs held as they are given; see `Balance.solve`."""
        return super().solve(*args)

    def sprung(self, lengths, before):
        """The same robot with springs about multipliers `before` in the place of what holds it at `lengths`."""
        return _Sprung(self, lengths, before)


class HeldClosedBalance(HeldBalance, ClosedBalance):
    """A HeldBalance that keeps loops closed."""

    def sprung(self, lengths, before):
        return _SprungClosed(self, lengths, before)


def balance_of(robot, held=None, parameters=()):
    """A Balance; one that holds inputs at lengths where there are any, and keeps loops closed where there are any."""
    if held:
        return (HeldClosedBalance if robot.loops else HeldBalance)(robot, held, parameters)
    return (ClosedBalance if robot.loops else Balance)(robot, parameters)


class _Springs:
    """What makes a Balance one of a robot whose held inputs are springs about multipliers `before`."""

    def __init__(self, balance, lengths, before):
        vars(self).update(vars(balance))  # one Function, one set of buffers
        self.lengths, self.before, self.delta = lengths, before, DELTA

    @property
    def softness(self):
        """Of each spring [m/N]."""
        own = self.at_lengths.flexibility * self.lengths
        return np.where(own > 0, own, self.delta * self.travel / self.pull)

    def lam(self, q):
        """Multipliers [k], which of them act, and the slopes A [k x n]."""
        held = self.at_lengths
        l, A = self.routes(q)
        own = np.where(held.flexibility > 0, 0.0, self.before)
        lam = own + (l[held.index] - self.lengths) / self.softness
        acts = ~held.pulls | (lam > 0)
        return np.where(acts, lam, 0.0), acts, A[held.index]

    def evaluate(self, q, u, p=None):
        held, (lam, acts, A) = self.at_lengths, self.lam(q)
        u = np.array(u, dtype=float)
        u[held.index] = -lam / held.gain
        r, K, B = super().evaluate(q, u, p)
        slope = (acts / self.softness)[:, None] * A
        return r, K + (B[:, held.index] / held.gain) @ slope, B


class _Sprung(_Springs, Balance):
    """Springs on a tree."""


class _SprungClosed(_Springs, ClosedBalance):
    """Springs on a robot with loops."""
