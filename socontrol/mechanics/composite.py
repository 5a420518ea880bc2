"""Composite bodies: mass matrix, Coriolis matrix, kinetic energy and momentum, seen from the world's origin.

Seen from the world what several bodies contribute to one place simply adds. With N the inertia of all that is carried
at a place, S the world twists of a piece there, G = sum N S over what the piece itself carries,
    M_ii = sum S^T N S,     M_ji = S_j^T G_i        j nearer the base.
The Coriolis matrix of mass points with the Jacobians J [3 x n] is C = sum m J^T J': J' qd is what accelerates them at
qdd = 0. Of what is carried J = E S with E = [-r~ I], so that N = sum m E^T E and B = sum m E^T E' describe it,
    C_ji = S_j^T F_i,    C_ij = G_i^T S_j' + D_i^T S_j,    F = sum m E^T J',    D = sum m E'^T J,
where M' = C + C^T follows from N' = B + B^T. A body whose inertia is no sum of mass points, as added mass, has
B = -N ad_V - S(N V), S([m; f]) = [m~ f~; f~ 0] of its momentum.
Sources: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, sec. 6.2; F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics import slices
from socontrol.mechanics.motion import NOTHING, Sweep, basis, joint_inertia, moved_inertia, standing_places


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
    if not piece.is_rod:
        return Inertia(*joint_inertia(piece, *piece.joint_step(q[piece.columns]), density))
    data = slices.slice_data(piece, slices.MASSES, density)
    kernel = slices.mass_kernel(tuple(p.x for p in piece.slices), basis(piece), slices.shape(data), density is not None)
    return Inertia(*kernel(q[piece.columns], piece.xi_bar, piece.length, data))


def inertias(robot, kin):
    """(Inertia, composite N of all it carries) of each piece, seen from the world, tip to base."""
    tree, density = robot.tree, robot.water.density if robot.water else None
    own, carried = [None] * len(tree.pieces), [{} for _ in tree.pieces]
    for i in reversed(range(len(tree.pieces))):
        piece, base = tree.pieces[i], kin.base(i)
        alone, back = own_inertia(piece, kin.q, density), se3.Ad_inv(base)
        here = Inertia(moved_inertia(base, alone.bb), back.T @ alone.bq, alone.qq)
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
    """What a piece carries, world axes: N, B [6 x 6], G, F, D [6 x n] and own = sum J^T J' [n x n]."""

    def __init__(self, N, B, G, F, D, own):
        self.N, self.B, self.G, self.F, self.D, self.own = N, B, G, F, D, own

    def add(self, N, B, S, rate):
        """Turning with what is carried where the twists are S and their rates are `rate`."""
        F = N @ rate + B @ S
        G, D, own = self.G + N @ S, self.D + B.T @ S, self.own + S.T @ F
        return Turning(self.N + N, self.B + B, G, self.F + F, D, own)


def coriolis(robot, kin, qd):
    """C [n x n] with C qd the velocity terms of the equation of motion and M' - 2 C skew."""
    tree, swing = robot.tree, Swing(robot, kin.q, qd)
    sums, hanging = [None] * len(tree.pieces), [{} for _ in tree.pieces]
    for i in reversed(range(len(tree.pieces))):
        piece, here = tree.pieces[i], swing.own[i]
        for x, (N, B) in hanging[i].items():
            here = here.add(N, B, *swing.twists[i, x])
        sums[i] = here
        if piece.parent is not None:
            N, B = hanging[piece.parent].get(piece.place, (0, 0))
            hanging[piece.parent][piece.place] = N + here.N, B + here.B
    blocks = {}
    for i, piece in enumerate(tree.pieces):
        blocks[i, i] = sums[i].own
        if piece.parent is not None and piece.size:
            for j, x in tree.chain(piece.parent, piece.place):
                if tree.pieces[j].size:
                    S, rate = swing.twists[j, x]
                    blocks[j, i] = S.T @ sums[i].F
                    blocks[i, j] = sums[i].G.T @ rate + sums[i].D.T @ S
    return assembled(tree, blocks)


class Swing:
    """Pieces in motion, world axes: twists {(piece, x): S and dS/dt [6 x n_i]} where others stand, and the Turning of
    each piece alone."""

    def __init__(self, robot, q, qd):
        self.q, self.qd, self.density = q, qd, robot.water.density if robot.water else None
        self.twists, self.own = {}, []
        places, poses, moving = standing_places(robot.tree), {}, {}
        for i, piece in enumerate(robot.tree.pieces):
            stand = piece.parent, piece.place
            base = piece.placement if piece.parent is None else poses[stand] @ piece.placement
            V = moving.get(stand, ca.DM(6, 1))
            turning, there = (self._section if piece.is_rod else self._joint)(piece, base, V, sorted(places[i]))
            self.own.append(turning)
            for x, (pose, S, rate) in there.items():
                poses[i, x], self.twists[i, x] = base @ pose, (se3.Ad(base) @ S, se3.Ad(base) @ rate)
                moving[i, x] = V + self.twists[i, x][0] @ qd[piece.columns]

    def _section(self, piece, base, V, places):
        data = slices.slice_data(piece, slices.MASSES, self.density)
        nodes, wet = tuple(p.x for p in piece.slices), self.density is not None
        kernel = slices.coriolis_kernel(nodes, tuple(places), basis(piece), slices.shape(data), wet)
        still, rate = se3.Ad_inv(base) @ V, self.qd[piece.columns]
        N, G, B, F, D, own, *there = kernel(self.q[piece.columns], rate, still, piece.xi_bar, piece.length, data)
        G, F, D = (se3.coAd(base) @ part for part in (G, F, D))
        turning = Turning(self._moved(base, N), moved_rate(base, B), G, F, D, own)
        return turning, {x: there[3 * k : 3 * k + 3] for k, x in enumerate(places)}

    def _moved(self, g, N):
        return moved_solid(g, N) if self.density is None else moved_inertia(g, N)

    def _joint(self, piece, base, V, places):
        n, still = piece.size, se3.Ad_inv(base) @ V
        pose, S = piece.joint_step(self.q[piece.columns])
        rate = se3.ad(still) @ S + piece.twists_rate(self.q, self.qd, 1.0)
        nothing = ca.DM(6, n)
        turning = Turning(ca.DM(6, 6), ca.DM(6, 6), nothing, nothing, nothing, ca.DM(n, n))
        body, fluid = piece.record.body, piece.record.fluid
        if body is not None or (fluid is not None and self.density is not None):
            world = se3.Ad(base)
            S_w, rate_w = world @ S, world @ rate
            N = self._moved(base @ pose, slices.body_inertia(body or NOTHING, fluid, self.density))
            turning = turning.add(N, self._turned(N, V + S_w @ self.qd[piece.columns]), S_w, rate_w)
        at = {0.0: (ca.DM.eye(4), nothing, nothing), 1.0: (pose, S, rate)}
        return turning, {x: at[x] for x in places}

    def _turned(self, N, V):
        """B [6 x 6] of a body of inertia N that moves with the twist V."""
        if self.density is not None:
            return -(N @ se3.ad(V)) - gyroscopic(N @ V)
        w, v, m, h = V[:3], V[3:], N[3, 3], axial(N[:3, 3:])
        second = ca.trace(N[:3, :3]) / 2 * ca.DM.eye(3) - N[:3, :3]
        return slices.swinging(ca.skew(w) @ second + v @ h.T, ca.cross(w, h) + m * v)


def axial(H):
    """h [3] of skew(h)."""
    return ca.vertcat(H[2, 1], H[0, 2], H[1, 0])


def moved_solid(g, N):
    """`moved_inertia` of a body with one mass for all directions."""
    R, r, h, m = se3.rotation(g), se3.position(g), axial(N[:3, 3:]), N[3, 3]
    turned = R @ h
    moved = turned + m * r
    J = slices.mirrored(R @ N[:3, :3] @ R.T - ca.skew(r) @ ca.skew(turned) - ca.skew(moved) @ ca.skew(r))
    return slices.spatial(m, moved, J)


def moved_rate(g, B):
    """Ad_g^-T B Ad_g^-1 of any B [6 x 6]."""
    R, lever = se3.rotation(g), ca.skew(se3.position(g))
    a, b, c, d = (R @ part @ R.T for part in (B[:3, :3], B[:3, 3:], B[3:, :3], B[3:, 3:]))
    b = b + lever @ d
    return ca.blockcat([[a + lever @ c - b @ lever, b], [c - d @ lever, d]])


def gyroscopic(momentum):
    """S [6 x 6], skew, of a momentum [m; f]: coad_V p = -S(p) V."""
    m, f = ca.skew(momentum[:3]), ca.skew(momentum[3:])
    return ca.blockcat([[m, f], [f, ca.DM(3, 3)]])
