"""Balance of a robot at rest: residual, tangent, and the second derivatives an optimiser needs.

    r(q, u) = f_elastic(q) - Q_loads(q) - B(q) u,    K_tot = dr/dq,
all assembled piece by piece: elasticity and actuation are local to a piece, loads come from the sweep.
"""

from functools import cached_property

import casadi as ca

from socontrol.mechanics import elasticity, newton_euler, recursions
from socontrol.mechanics.kinematics import Kinematics


class Statics:
    """The expressions of one robot at one (q, u); sweeps are made once. qd: rates, for the friction of cables alone."""

    def __init__(self, robot, q, u=None, qd=None):
        self.robot, self.q, self.u, self.qd = robot, q, u, qd
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
        for k, shares in enumerate(self.robot.lines):
            if k in self._rubbed:
                columns.append(self._rubbed[k])
                continue
            parts = [ca.DM(piece.size, 1) for piece in tree.pieces]
            for line in shares:
                parts[line.piece] += line.force(tree, self.q)
            columns.append(ca.vertcat(*parts))
        return ca.horzcat(*columns) if columns else ca.DM(tree.n, 0)

    @cached_property
    def _rubbed(self):
        """{input: its column} of cables with friction."""
        friction = self.robot.friction
        return friction.by_input(friction.columns(self.q, self.qd)) if friction else {}

    @cached_property
    def _gradients(self):
        """{input: (piece, d(force)/dq [n_i x n_i]) of its lines}, without friction."""
        return {
            k: [(line.piece, line.gradient(self.robot.tree, self.q)) for line in shares]
            for k, shares in enumerate(self.robot.lines)
            if k not in self.robot.friction.inputs
        }

    def actuation_tangent(self):
        """d(B(q) u)/dq [n x n], one block a piece; of cables with friction all blocks of the pieces before."""
        parts = [ca.DM(piece.size, piece.size) for piece in self.robot.tree.pieces]
        for k, shares in self._gradients.items():
            for piece, gradient in shares:
                parts[piece] += self.u[k] * gradient
        local, friction = ca.diagcat(*parts), self.robot.friction
        return local + friction.slope(self.q, self._rubbing_inputs(), self.qd) if friction else local

    def actuation_damping(self):
        """-d(B u)/dqd [n x n]: of friction in motion."""
        return -self.robot.friction.drag(self.q, self._rubbing_inputs(), self.qd)

    def _rubbing_inputs(self):
        return ca.vertcat(*(self.u[k] for k in self.robot.friction.inputs))

    def actuation_gradient(self, lam):
        """Column a: d(lam . B_a)/dq [n x m]."""
        tree, columns, friction = self.robot.tree, [], self.robot.friction
        rubbed = friction.by_input(friction.gradient(self.q, lam)) if friction else {}
        for k in range(self.robot.m):
            if k in rubbed:
                columns.append(rubbed[k])
                continue
            parts = [ca.DM(piece.size, 1) for piece in tree.pieces]
            for piece, gradient in self._gradients[k]:
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
