"""The independent look at an answer: equilibrium recomputed by another path, in numpy.

Poses come from Rodrigues' closed form with sines and cosines; the motion of each point per coordinate from the
integral of the adjoint along the rod, S(s) = int_0^s Ad(exp(sigma xi)) Phi dsigma, by Gauss quadrature; loads act
on the points one by one. None of the solver's series, moments or composite tangents is used, and rods carry twice
the Gauss points.
"""

import casadi as ca
import numpy as np

from socontrol.mechanics import elasticity
from socontrol.mechanics.loads import Field
from socontrol.model.quadrature import gauss_legendre

POINTS = 16  # Gauss points of the adjoint's integral: exact to 1e-13 for one full turn


def residual(robot, q, u, factor=2):
    """Unbalanced generalised force [n] at q, u, and its parts elastic, external, actuation [n]."""
    robot = robot.refined(factor=factor)
    q, u = np.asarray(q, dtype=float), np.asarray(u, dtype=float)
    look = _Look(robot, q)
    elastic = np.concatenate([np.array(ca.DM(elasticity.force(p, ca.DM(q)))).ravel() for p in look.pieces if p.size])
    external, actuation = look.external(), look.actuation(u)
    return elastic - external - actuation, elastic, external, actuation


class _Look:
    def __init__(self, robot, q):
        self.robot, self.q, self.pieces = robot, q, robot.tree.pieces
        self.strains = [np.array(ca.DM(p.strain(ca.DM(q)))).ravel() for p in self.pieces]
        self.Phi = [np.array(ca.DM(p.Phi)).reshape(6, p.size) for p in self.pieces]
        self.bases = []
        for piece in self.pieces:
            at = np.eye(4) if piece.parent is None else self.pose(piece.parent, piece.place)
            self.bases.append(at @ np.array(ca.DM(piece.placement)))

    def pose(self, i, x):
        return self.bases[i] @ exponential(x * float(self.pieces[i].length) * self.strains[i])

    def motion(self, i, x):
        """World twists [6 x n_i] of the place x on piece i."""
        piece, s = self.pieces[i], x * float(self.pieces[i].length)
        nodes, weights = gauss_legendre(POINTS)
        total = np.zeros((6, 6))
        for node, weight in zip(nodes, weights, strict=True):
            total += s * weight * adjoint(exponential(node * s * self.strains[i]))
        return adjoint(self.bases[i]) @ total @ self.Phi[i]

    def external(self):
        """Generalised force [n] of every single load, by the twists of the pieces that carry it."""
        Q = np.zeros(self.robot.n)
        for i, x, F in self._wrenches():
            for j, place in self.robot.tree.chain(i, x):
                if self.pieces[j].size:
                    Q[self.pieces[j].columns] += self._motion(j, place).T @ F
        return Q

    def _motion(self, j, x, cache=None):
        cache = self.__dict__.setdefault("_motions", {})
        if (j, x) not in cache:
            cache[j, x] = self.motion(j, x)
        return cache[j, x]

    def _wrenches(self):
        """(piece, x, wrench about the world's origin) of every load."""
        for load in self.robot.loads:
            force = np.array(ca.DM(ca.vertcat(*load.force) if isinstance(load.force, (list, tuple)) else load.force))
            force = force.ravel()
            if isinstance(load, Field):
                for weight, p in zip(load.weights, self.pieces[load.piece].slices, strict=True):
                    r = self.pose(load.piece, p.x)[:3, 3]
                    yield load.piece, p.x, float(weight) * np.concatenate([np.cross(r, force), force])
                continue
            g = self.pose(load.piece, load.x) @ np.array(ca.DM(load.offset))
            moment = np.zeros(3) if load.moment is None else np.array([float(m) for m in load.moment])
            if load.follower:
                force, moment = g[:3, :3] @ force, g[:3, :3] @ moment
            yield load.piece, load.x, np.concatenate([np.cross(g[:3, 3], force) + moment, force])

    def actuation(self, u):
        """B(q) u [n] from the lines' own forces at twice the Gauss points."""
        Q, q = np.zeros(self.robot.n), ca.DM(self.q)
        for value, shares in zip(u, self.robot.lines, strict=True):
            for line in shares:
                Q[self.pieces[line.piece].columns] += value * np.array(ca.DM(line.force(self.robot.tree, q))).ravel()
        return Q


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def exponential(xi):
    """exp(hat(xi)) [4 x 4] by Rodrigues' formula."""
    t, W = np.linalg.norm(xi[:3]), skew(xi[:3])
    a, b, c = (np.sin(t) / t, 2 * (np.sin(t / 2) / t) ** 2, (t - np.sin(t)) / t**3) if t > 1e-2 else _small(t)
    g = np.eye(4)
    g[:3, :3] += a * W + b * W @ W
    g[:3, 3] = xi[3:] + b * W @ xi[3:] + c * W @ W @ xi[3:]
    return g


def _small(t):
    return 1 - t**2 / 6 + t**4 / 120, 0.5 - t**2 / 24 + t**4 / 720, 1 / 6 - t**2 / 120 + t**4 / 5040


def adjoint(g):
    R = g[:3, :3]
    return np.block([[R, np.zeros((3, 3))], [skew(g[:3, 3]) @ R, R]])
