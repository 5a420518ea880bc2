"""Composite bodies: mass matrix, Coriolis matrix, kinetic energy and momentum, seen from the world's origin.

Seen from the world what several bodies contribute to one place simply adds. With N the inertia of all that is carried
at a place, S the world twists of a piece there, G = sum N S over what the piece itself carries,
    M_ii = sum S^T N S,     M_ji = S_j^T G_i        j nearer the base.
C follows the same way from B = N ad_V + S(N V), S([m; f]) = [m~ f~; f~ 0] of the momentum, and the rates of S:
    C = sum J^T (N (J' - ad_V J) - S(N V) J),     M' - 2 C skew.
Sources: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, sec. 6.2; F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics import slices
from socontrol.mechanics.motion import NOTHING, Sweep


class Inertia:
    """What a piece weighs while its base and its coordinates move, seen from its base: bb, bq [6 x n], qq [n x n]."""

    def __init__(self, bb, bq, qq):
        self.bb, self.bq, self.qq = bb, bq, qq

    def add(self, N, S):
        """Add a body of inertia N [6 x 6], seen from the base, that moves with the twists S."""
        NS = N @ S
        return Inertia(self.bb + N, self.bq + NS, self.qq + slices.mirrored(S.T @ NS))


def own_inertia(piece, q, density=None):
    """Inertia of one piece alone; `density` of the water whose added mass joins."""
    if piece.is_rod:
        data = slices.slice_data(piece, slices.MASSES, density)
        kernel = slices.mass_kernel(tuple(p.x for p in piece.slices), slices.is_plain(data), density is not None)
        bb, bq, qq = kernel(piece.strain(q), piece.length, data)
        return Inertia(bb, bq @ piece.Phi, piece.Phi.T @ qq @ piece.Phi)
    n = piece.size
    empty = Inertia(ca.DM(6, 6), ca.DM(6, n), ca.DM(n, n))
    if piece.record.body is None and (piece.record.fluid is None or density is None):
        return empty
    M = slices.body_inertia(piece.record.body or NOTHING, piece.record.fluid, density)
    g, S = piece.joint_step(q[piece.columns])
    return empty.add(moved_inertia(g, M), S)


def moved_inertia(g, M):
    """Ad_g^-T M Ad_g^-1: an inertia [6 x 6] given at the frame g, seen from the frame of g's coordinates."""
    back = se3.Ad_inv(g)
    return slices.mirrored(back.T @ M @ back)


def inertias(robot, kin):
    """(Inertia, composite N of all it carries) of each piece, seen from the world, tip to base."""
    tree, density = robot.tree, robot.water.density if robot.water else None
    own, carried = [None] * len(tree.pieces), [{} for _ in tree.pieces]
    for i in reversed(range(len(tree.pieces))):
        piece, base = tree.pieces[i], kin.base(i)
        alone, back = own_inertia(piece, kin.q, density), se3.Ad_inv(base)
        here = Inertia(slices.mirrored(back.T @ alone.bb @ back), back.T @ alone.bq, alone.qq)
        for x, N in carried[i].items():
            here = here.add(N, kin.twists(i, x))
        own[i] = here
        if piece.parent is not None:
            there = carried[piece.parent]
            there[piece.place] = there[piece.place] + here.bb if piece.place in there else here.bb
    return own, carried


def mass(robot, kin):
    """M [n x n], symmetric positive definite where every coordinate moves mass."""
    tree = robot.tree
    own, _ = inertias(robot, kin)
    blocks = {}
    for i, piece in enumerate(tree.pieces):
        if not piece.size:
            continue
        blocks[i, i] = own[i].qq
        if piece.parent is not None:
            for j, x in tree.chain(piece.parent, piece.place):
                if tree.pieces[j].size:
                    blocks[j, i] = kin.twists(j, x).T @ own[i].bq
                    blocks[i, j] = blocks[j, i].T
    return assembled(tree, blocks)


def assembled(tree, blocks):
    """[n x n] of blocks {(i, j): [n_i x n_j]}."""
    sizes, count = [piece.size for piece in tree.pieces], len(tree.pieces)
    rows = [ca.horzcat(*(blocks.get((i, j), ca.DM(sizes[i], sizes[j])) for j in range(count))) for i in range(count)]
    return ca.vertcat(*rows)


def kinetic_energy(robot, q, qd):
    """[J], with the energy of added mass, linear in the pieces."""
    return sum((energy for energy, _ in _moving(robot, q, qd)), ca.DM(0))


def momentum(robot, kin, qd):
    """[6] angular momentum about the world's origin and linear momentum, world axes, with that of added mass."""
    parts = [
        se3.coAd(kin.base(i)) @ wrench for i, (_, wrench) in enumerate(_moving(robot, kin.q, qd))
    ]
    return sum(parts, ca.DM(6, 1))


def _moving(robot, q, qd):
    """(kinetic energy, momentum [6] seen from its base) of each piece."""
    sweep = Sweep(robot, q, qd, parts=frozenset())
    density = robot.water.density if robot.water else None
    for piece, (base, _) in zip(robot.tree.pieces, sweep.bases, strict=True):
        alone, V, rate = own_inertia(piece, q, density), base.twist(), qd[piece.columns]
        p, own = alone.bb @ V + alone.bq @ rate, alone.bq.T @ V + alone.qq @ rate
        yield (ca.dot(V, p) + ca.dot(rate, own)) / 2, p


# Coriolis matrix

class Turning:
    """Sums over what a piece carries, world axes: N, B [6 x 6]; by its own twists S: NS', BS [6 x n] and
    S^T N, S^T B [n x 6], S^T (N S' - B S) [n x n]."""

    def __init__(self, n):
        self.N, self.B, self.F = ca.DM(6, 6), ca.DM(6, 6), ca.DM(6, n)
        self.SN, self.SB, self.own = ca.DM(n, 6), ca.DM(n, 6), ca.DM(n, n)

    def add(self, N, B, S, rate):
        F = N @ rate - B @ S
        self.N, self.B, self.F = self.N + N, self.B + B, self.F + F
        self.SN, self.SB, self.own = self.SN + S.T @ N, self.SB + S.T @ B, self.own + S.T @ F


def coriolis(robot, kin, qd):
    """C [n x n] with C qd the velocity terms of the equation of motion and M' - 2 C skew."""
    tree, rates = robot.tree, Rates(kin, qd)
    sums, hanging = [Turning(piece.size) for piece in tree.pieces], [{} for _ in tree.pieces]
    for i in reversed(range(len(tree.pieces))):
        piece = tree.pieces[i]
        for x, M in point_masses(robot, i):
            N = moved_inertia(kin.pose(i, x), M)
            V = rates.twist(i, x)
            sums[i].add(N, N @ se3.ad(V) + gyroscopic(N @ V), kin.twists(i, x), rates.twists(i, x))
        for x, (N, B) in hanging[i].items():
            sums[i].add(N, B, kin.twists(i, x), rates.twists(i, x))
        if piece.parent is not None:
            N, B = hanging[piece.parent].get(piece.place, (0, 0))
            hanging[piece.parent][piece.place] = N + sums[i].N, B + sums[i].B
    blocks = {}
    for i, piece in enumerate(tree.pieces):
        blocks[i, i] = sums[i].own
        if piece.parent is not None and piece.size:
            for j, x in tree.chain(piece.parent, piece.place):
                if tree.pieces[j].size:
                    S, rate = kin.twists(j, x), rates.twists(j, x)
                    blocks[j, i] = S.T @ sums[i].F
                    blocks[i, j] = sums[i].SN @ rate - sums[i].SB @ S
    return assembled(tree, blocks)


def gyroscopic(momentum):
    """S [6 x 6], skew, of a momentum [m; f]: coad_V p = -S(p) V."""
    m, f = ca.skew(momentum[:3]), ca.skew(momentum[3:])
    return ca.blockcat([[m, f], [f, ca.DM(3, 3)]])


def point_masses(robot, i):
    """(x, M [6 x 6] in the body axes there) of the slices or the body of piece i, added mass included."""
    piece, density = robot.tree.pieces[i], robot.water.density if robot.water else None
    if piece.is_rod:
        for p in piece.slices:
            M = piece.record.inertia_density(p)
            if density is not None:
                M = M + ca.diag(ca.vertcat(0, 0, 0, 0, *piece.record.fluid_density(p, density)[5:]))
            yield p.x, p.weight * M
    elif piece.record.body is not None or (piece.record.fluid is not None and density is not None):
        yield 1.0, slices.body_inertia(piece.record.body or NOTHING, piece.record.fluid, density)


class Rates:
    """World twists of places, and the time derivatives of the world twists S of their pieces."""

    def __init__(self, kin, qd):
        self.kin, self.qd = kin, qd
        self._bases = []
        for piece in kin.tree.pieces:
            still = piece.parent is None
            self._bases.append(ca.DM(6, 1) if still else self.twist(piece.parent, piece.place))

    def twist(self, i, x):
        """World twist [6] of the place x on piece i."""
        return self._bases[i] + self.kin.twists(i, x) @ self.qd[self.kin.tree.pieces[i].columns]

    def twists(self, i, x):
        """dS/dt [6 x n_i]: S is carried by the base and changes with the piece's own strain."""
        piece, S = self.kin.tree.pieces[i], self.kin.twists(i, x)
        own = piece.twists_rate(self.kin.q, self.qd, x)
        return se3.ad(self._bases[i]) @ S + se3.Ad(self.kin.base(i)) @ own
