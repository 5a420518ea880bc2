"""Balance of a robot at rest: residual, tangent, and the second derivatives an optimiser needs.

    r(q, u) = f_elastic(q) - Q_loads(q) - B(q) u,    K_tot = dr/dq,
all assembled piece by piece: elasticity and actuation are local to a piece, loads come from the sweep.
"""

from functools import cached_property

import casadi as ca

from socontrol.mechanics import elasticity, newton_euler, recursions
from socontrol.mechanics.kinematics import Kinematics


class Statics:
    """The expressions of one robot at one (q, u); sweeps are made once."""

    def __init__(self, robot, q, u=None):
        self.robot, self.q, self.u = robot, q, u
        self.kin = Kinematics(robot.tree, q)

    @cached_property
    def carried(self):
        """Wrenches of the loads at each place and the force fields on each piece."""
        return recursions.carried(self.kin, self.robot.loads)

    def elastic_force(self):
        return self._stack(lambda piece: elasticity.force(piece, self.q))

    def stiffness(self):
        return self._diagonal(lambda piece: elasticity.stiffness(piece, self.q))

    def damping(self):
        return self._diagonal(lambda piece: elasticity.damping(piece, self.q))

    def elastic_energy(self):
        return sum((elasticity.energy(piece, self.q) for piece in self.robot.tree.pieces), ca.DM(0))

    def weights_and_loads(self):
        """Generalised force [n] of weight, buoyancy and loads."""
        return recursions.external_force(self.kin, *self.carried)

    def applied_force(self):
        """Generalised force [n] of loads alone."""
        return recursions.external_force(self.kin, *recursions.carried(self.kin, self.robot.applied))

    def carried_wrench(self):
        """Wrench [6] of weight, buoyancy and loads on the whole robot, about the world's origin."""
        return recursions.total(self.kin, *self.carried)

    def external_force(self):
        """`weights_and_loads`, and what moving water does to the robot at rest."""
        return self.weights_and_loads() + self._flow if self.in_current else self.weights_and_loads()

    @property
    def in_current(self):
        """Whether the robot stands in moving water."""
        return self.robot.water is not None and newton_euler.moves(self.robot.water)

    @cached_property
    def _flow(self):
        return newton_euler.water_force(self.robot, self.q, ca.DM(self.robot.n, 1))

    def actuation(self):
        """B(q) [n x m]."""
        return self._columns

    @cached_property
    def _columns(self):
        tree, columns = self.robot.tree, []
        for shares in self.robot.lines:
            parts = [ca.DM(piece.size, 1) for piece in tree.pieces]
            for line in shares:
                parts[line.piece] += line.force(tree, self.q)
            columns.append(ca.vertcat(*parts))
        return ca.horzcat(*columns) if columns else ca.DM(tree.n, 0)

    @cached_property
    def _gradients(self):
        """For each input, (piece, d(force)/dq [n_i x n_i]) of its lines."""
        return [
            [(line.piece, line.gradient(self.robot.tree, self.q)) for line in shares] for shares in self.robot.lines
        ]

    def actuation_tangent(self):
        """d(B(q) u)/dq [n x n], one block a piece."""
        parts = [ca.DM(piece.size, piece.size) for piece in self.robot.tree.pieces]
        for k, shares in enumerate(self._gradients):
            for piece, gradient in shares:
                parts[piece] += self.u[k] * gradient
        return ca.diagcat(*parts)

    def actuation_gradient(self, lam):
        """Column a: d(lam . B_a)/dq [n x m]."""
        tree, columns = self.robot.tree, []
        for shares in self._gradients:
            parts = [ca.DM(piece.size, 1) for piece in tree.pieces]
            for piece, gradient in shares:
                parts[piece] += gradient.T @ lam[tree.pieces[piece].columns]
            columns.append(ca.vertcat(*parts))
        return ca.horzcat(*columns) if columns else ca.DM(tree.n, 0)

    @property
    def conservative_actuation(self):
        """Whether every input works along a length: tau = u d(length)/dq, so that d(B u)/dq is symmetric."""
        return all(line.conservative for shares in self.robot.lines for line in shares)

    def residual(self):
        return self.elastic_force() - self.external_force() - self.actuation() @ self.u

    def tangent(self):
        conservative = all(load.conservative for load in self.robot.loads)
        loads = recursions.external_tangent(self.kin, *self.carried, symmetric=conservative)
        if self.in_current:
            loads += ca.jacobian(self._flow, self.q)
        return self.stiffness() - loads - self.actuation_tangent()

    def _stack(self, of):
        return ca.vertcat(*(of(piece) if piece.size else ca.DM(0, 1) for piece in self.robot.tree.pieces))

    def _diagonal(self, of):
        return ca.diagcat(*(of(piece) if piece.size else ca.DM(0, 0) for piece in self.robot.tree.pieces))
