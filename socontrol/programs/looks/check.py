"""The independent look at an answer: equilibrium recomputed by another path, in numpy.

Poses come from Rodrigues' closed form with sines and cosines; the motion of each point per coordinate from the
integral of the adjoint along the rod, S(s) = int_0^s Ad(exp(sigma xi)) Phi dsigma, by Gauss quadrature; loads act
on the points one by one. None of the solver's series, moments or composite tangents is used, and rods carry twice
the Gauss points. Loops push both their ends with the wrench of their multipliers, as loads do.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.mechanics import elasticity
from socontrol.mechanics.loads import Field
from socontrol.mechanics.loops import slices
from socontrol.programs.looks.check_lines import lines_of
from socontrol.programs.looks.check_poses import adjoints, exponentials, moved, numeric


def residual(robot, q, u, factor=2):
    """Unbalanced generalised force [n] at q, u, and its parts elastic, external, actuation [n]."""
    return Checker(robot, factor)(q, u)


class Checker:
    """The numbers of one robot, with `factor` times the Gauss points, ready to look at many postures."""

    def __init__(self, robot, factor=2):
        self.robot = robot.refined(factor=factor)
        self.pieces = self.robot.tree.pieces
        self.Phi = [numeric(p.Phi).reshape(6, p.size) for p in self.pieces]
        self.xi_bar = [numeric(p.xi_bar).ravel() for p in self.pieces]
        self.lengths = [float(p.length) for p in self.pieces]
        self.placements = [numeric(p.placement) for p in self.pieces]
        self.ends = [numeric(p.end) for p in self.pieces]
        self.loads = [_Load(load, self.pieces) for load in self.robot.loads]
        water = self.robot.water
        if water is not None and any(water.velocity):
            rows = [_Current(i, piece, water) for i, piece in enumerate(self.pieces)]
            self.loads += [row for row in rows if row.x.size]
        self.lines = lines_of(self.robot)
        self.loops = {name: _Loop(loop, self.robot.tree) for name, loop in self.robot.loops.items()}

    def __call__(self, q, u, lam=None):
        """(unbalanced, elastic, external with that of loops, actuation) generalised forces [n] each."""
        q, u = np.asarray(q, dtype=float).ravel(), np.asarray(u, dtype=float).ravel()
        look = _Look(self, q, lam)
        elastic = np.array(self._elastic(q)).ravel()
        external, actuation = look.external(), look.actuation(u)
        return elastic - external - actuation, elastic, external, actuation

    def look(self, q):
        """Poses of all places at q [n]."""
        return _Look(self, np.asarray(q, dtype=float).ravel())

    def loop_error(self, q):
        """e [k] of all loops from poses of its own."""
        look = _Look(self, np.asarray(q, dtype=float).ravel())
        return np.concatenate([loop.error(look) for loop in self.loops.values()] or [np.zeros(0)])

    def reactions(self, q, lam=None):
        """{segment: wrench [6] on it from what carries it, base frame} for joints and world-standing rods."""
        look, found = _Look(self, np.asarray(q, dtype=float).ravel(), lam), {}
        look.external()
        for i, piece in enumerate(self.pieces):
            if piece.index == 0 and (piece.parent is None or not piece.is_rod):
                found[piece.segment] = -adjoints(look.bases[i][None])[0].T @ look.carried[i]
        return found

    @cached_property
    def _elastic(self):
        q = ca.SX.sym("q", self.robot.n)
        parts = [elasticity.force(piece, q) for piece in self.pieces if piece.size]
        return ca.Function("elastic", [q], [ca.densify(ca.SX(ca.vertcat(*parts)))])


class _Load:
    """One load in numbers: places x, dead or follower wrench [moment; force] at each, offset pose."""

    def __init__(self, load, pieces):
        self.piece, self.follower, self.offset = load.piece, False, np.eye(4)
        force = np.array([float(f) for f in ca.vertsplit(ca.DM(ca.vertcat(*_entries(load.force))))])
        if isinstance(load, Field):
            self.x = np.array([p.x for p in pieces[load.piece].slices])
            self.force = np.array([float(w) for w in load.weights])[:, None] * force
            self.moment = np.zeros_like(self.force)
            return
        self.x, self.force, self.follower = np.array([load.x]), force[None, :], load.follower
        self.moment = np.zeros((1, 3)) if load.moment is None else np.array([[float(m) for m in load.moment]])
        self.offset = numeric(load.offset)

    def wrenches(self, poses):
        """[k x 6] about the world's origin, from the poses [k x 4 x 4] of its places."""
        g = poses @ self.offset
        force, moment = self.force, self.moment
        if self.follower:
            force = np.einsum("kij,kj->ki", g[:, :3, :3], force)
            moment = np.einsum("kij,kj->ki", g[:, :3, :3], moment)
        r = g[:, :3, 3]
        turned = r[:, [1, 2, 0]] * force[:, [2, 0, 1]] - r[:, [2, 0, 1]] * force[:, [1, 2, 0]]
        return np.hstack([turned + moment, force])


class _Current:
    """Moving water on a piece at rest: drag, lift, and the turning moment of added mass, by body axes at each place."""

    def __init__(self, i, piece, water):
        self.piece, self.velocity, self.body = i, np.array(water.velocity, dtype=float), None
        record, self.offset, self.density = piece.record, np.eye(4), float(water.density)
        self.x = np.array([p.x for p in piece.slices])
        self.data = np.array([np.array(p.weight * ca.vertcat(*record.fluid_density(p, self.density))).ravel()
                              for p in piece.slices], dtype=float)  # fmt: skip
        if not piece.is_rod and record.fluid is not None:
            self.x, self.body = np.array([1.0]), record.fluid
            self.offset[:3, 3] = record.body.com if record.body is not None else 0.0

    def wrenches(self, poses):
        """[k x 6] about the world's origin."""
        rows = []
        for k, g in enumerate(poses @ self.offset):
            n = -g[:3, :3].T @ self.velocity
            if self.body is None:
                t, c, lift, linear_t, linear_n, ay, az = self.data[k]
                added = np.array([0.0, ay, az])
                turning = np.array([t * n[0], c * n[1] + lift * n[2], c * n[2] - lift * n[1]])
                force = -np.linalg.norm(n) * turning - np.array([linear_t, linear_n, linear_n]) * n
            else:
                added = numeric(self.body.added(self.density)[1]).ravel()
                speed = self.density * np.linalg.norm(n)
                force = -(speed * np.array(self.body.drag[3:]) + np.array(self.body.linear[3:])) * n
            force, moment = g[:3, :3] @ force, -(g[:3, :3] @ np.cross(n, added * n))
            rows.append(np.concatenate([np.cross(g[:3, 3], force) + moment, force]))
        return np.array(rows)


class _Loop:
    """One loop in numbers: the places of its ends, and the wrench of its multipliers."""

    def __init__(self, loop, tree):
        self.loop, self.held = loop, numeric(loop.Phi_perp())
        self.ends = [_End(end.locate(tree), end.placement) for end in (loop.a, loop.b)]

    def error(self, look):
        a, b = (end.pose(look) for end in self.ends)
        turned = b[:3, :3].T
        return numeric(self.loop.rows(ca.DM(turned @ a[:3, :3]), ca.DM(turned @ (a[:3, 3] - b[:3, 3])))).ravel()

    def wrenches(self, look, lam):
        """(piece, place, wrench [6] about the world's origin) on what a stands on, and the opposite on that of b."""
        g, wrench = self.ends[1].pose(look), self.held @ lam
        force = g[:3, :3] @ wrench[3:]
        W = np.concatenate([g[:3, :3] @ wrench[:3] + np.cross(g[:3, 3], force), force])
        rows = zip(self.ends, (W, -W), strict=True)
        return [(end.frame.piece, end.frame.x, wrench) for end, wrench in rows if end.frame is not None]


class _End:
    """Frame of an end (None: the world) and the joint frame's pose there."""

    def __init__(self, frame, placement):
        self.frame, self.offset = frame, numeric(placement.pose())
        if frame is not None:
            self.offset = numeric(frame.offset) @ self.offset

    def pose(self, look):
        on = np.eye(4) if self.frame is None else look.poses(self.frame.piece, np.array([self.frame.x]))[0]
        return on @ self.offset


class _Look:
    """Poses of one posture, and the forces that act there; lam: multipliers of loops."""

    def __init__(self, numbers, q, lam=None):
        self.numbers, self.q, self.pieces, self.bases, self.strains = numbers, q, numbers.pieces, [], []
        self.lam = lam
        for i, piece in enumerate(self.pieces):
            self.strains.append(numbers.xi_bar[i] + numbers.Phi[i] @ q[piece.columns])
            at = np.eye(4) if piece.parent is None else self.poses(piece.parent, np.array([piece.place]))[0]
            self.bases.append(at @ numbers.placements[i])

    def poses(self, i, x):
        """World <- frames at places x [k] of piece i [k x 4 x 4]."""
        return self.bases[i] @ exponentials(self.strains[i], x * self.numbers.lengths[i])

    def motions(self, i, x):
        """World twists [k x 6 x n_i] that the coordinates of piece i give at places x [k]."""
        local = moved(self.strains[i], x * self.numbers.lengths[i])
        return adjoints(self.bases[i][None])[0] @ local @ self.numbers.Phi[i]

    def external(self):
        """Generalised force [n] of all loads: wrenches gathered tip to base, each piece moved by its own twists."""
        Q, self.carried = np.zeros(self.numbers.robot.n), [np.zeros(6) for _ in self.pieces]
        hanging = [[] for _ in self.pieces]  # (place, wrench) of what stands on a piece
        for load in self.numbers.loads:
            F = load.wrenches(self.poses(load.piece, load.x))
            hanging[load.piece] += list(zip(load.x, F, strict=True))
        for name, own in slices(self.numbers.robot.loops).items() if self.lam is not None else ():
            for piece, x, wrench in self.numbers.loops[name].wrenches(self, self.lam[own]):
                hanging[piece].append((x, wrench))
        for i in reversed(range(len(self.pieces))):
            piece = self.pieces[i]
            if hanging[i]:
                x = np.array([place for place, _ in hanging[i]])
                F = np.array([wrench for _, wrench in hanging[i]])
                if piece.size:
                    Q[piece.columns] = np.einsum("kij,ki->j", self.motions(i, x), F)
                self.carried[i] = F.sum(axis=0)
            if piece.parent is not None:
                hanging[piece.parent].append((piece.place, self.carried[i]))
        return Q

    def actuation(self, u):
        """B(q) u [n] from the lines' own forces."""
        Q = np.zeros(self.numbers.robot.n)
        for value, lines in zip(u, self.numbers.lines, strict=True):
            for piece, force in lines(self):
                Q[self.pieces[piece].columns] += value * force
        return Q


def _entries(force):
    return force if isinstance(force, (list, tuple)) else [force]
