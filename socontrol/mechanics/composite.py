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
from socontrol.mechanics import slices, swinging
from socontrol.mechanics.motion import NOTHING, Sweep, basis, moved_inertia, standing_places


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
        pose, S = piece.joint_step(q[piece.columns])
        N, n = body_inertia(piece, pose, density), piece.size
        return Inertia(ca.DM(6, 6), ca.DM(6, n), ca.DM(n, n)).add(N, S)
    data = slices.slice_data(piece, slices.MASSES, density)
    kernel = slices.mass_kernel(tuple(p.x for p in piece.slices), basis(piece), slices.shape(data), density is not None)
    return Inertia(*kernel(q[piece.columns], piece.xi_bar, piece.length, data))


def body_inertia(piece, pose, density):
    """N [6 x 6] of the body on a joint, which stands at `pose` in its base."""
    body, fluid = piece.record.body, piece.record.fluid if density is not None else None
    if body is None and fluid is None:
        return ca.DM(6, 6)
    return moved(pose, slices.body_inertia(body or NOTHING, fluid, density), density)


def moved(g, N, density):
    """N [6 x 6] of the frame g, seen from the frame g is given in; without water one mass goes for all directions."""
    if density is not None:
        return moved_inertia(g, N)
    R, r, h, m = se3.rotation(g), se3.position(g), axial(N[:3, 3:]), N[3, 3]
    here = R @ h
    there = here + m * r
    J = R @ N[:3, :3] @ R.T - ca.skew(r) @ ca.skew(here) - ca.skew(there) @ ca.skew(r)
    return slices.spatial(m, there, slices.mirrored(J))


def axial(H):
    """h [3] of skew(h)."""
    return ca.vertcat(H[2, 1], H[0, 2], H[1, 0])


def inertias(robot, kin):
    """(Inertia, {x: composite N of what stands there}) of each piece, with all it carries, seen from its base."""
    tree, density = robot.tree, robot.water.density if robot.water else None
    own, carried = [None] * len(tree.pieces), [{} for _ in tree.pieces]
    for i in reversed(range(len(tree.pieces))):
        piece, here = tree.pieces[i], own_inertia(tree.pieces[i], kin.q, density)
        for x, N in carried[i].items():
            here = here.add(N, kin.step(i, x)[1])
        own[i] = here
        if piece.parent is not None:
            g, there = kin.step(piece.parent, piece.place)[0] @ piece.placement, carried[piece.parent]
            N = moved(g, here.bb, density)
            there[piece.place] = there[piece.place] + N if piece.place in there else N
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
            G = se3.coAd(kin.base(i)) @ own[i].bq
            for j, x in tree.chain(piece.parent, piece.place):
                if tree.pieces[j].size:
                    blocks[j, i] = kin.twists(j, x).T @ G
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
    parts = [se3.coAd(kin.base(i)) @ wrench for i, (_, wrench) in enumerate(_moving(robot, kin.q, qd))]
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
    """What a piece carries, seen from its base: N, B [6 x 6], G, F, D [6 x n] and own = sum J^T J' [n x n]; in axes
    held still, about a point that goes on with the velocity of the base's origin."""

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
            here = here.add(N, B, *swing.at[i][x][1:])
        sums[i] = here
        if piece.parent is not None:
            before = hanging[piece.parent].get(piece.place, (0, 0))
            there = swing.moved(*swing.stand[i], here.N, here.B)
            hanging[piece.parent][piece.place] = [x + y for x, y in zip(before, there, strict=True)]
    blocks = {}
    for i, piece in enumerate(tree.pieces):
        blocks[i, i] = sums[i].own
        if piece.parent is not None and piece.size:
            G, F, D = swing.in_world(i, sums[i])
            for j, x in tree.chain(piece.parent, piece.place):
                if tree.pieces[j].size:
                    S, rate = swing.twists(j, x)
                    blocks[j, i] = S.T @ F
                    blocks[i, j] = G.T @ rate + D.T @ S
    return assembled(tree, blocks)


class Swing:
    """Pieces in motion. Of each piece `own` is its Turning alone; stand: pose [4 x 4] and velocity [3] of its base seen
    from its parent's; at: {x: pose, S and dS/dt [6 x n_i]} where others stand, seen from its base; bases: pose and
    velocity of its base in the world. Velocities in axes held still, against the base of what they are seen from."""

    def __init__(self, robot, q, qd):
        self.q, self.qd, self.density = q, qd, robot.water.density if robot.water else None
        self.tree, self._in_world = robot.tree, {}
        self.own, self.stand, self.at, self.bases, turns = [], [], [], [], []
        for piece, places in zip(robot.tree.pieces, standing_places(robot.tree), strict=True):
            g, r_rate, w = piece.placement, ca.DM(3, 1), ca.DM(3, 1)
            base = g, r_rate
            if piece.parent is not None:
                pose, S, _ = self.at[piece.parent][piece.place]
                V = ca.vertcat(turns[piece.parent], ca.DM(3, 1)) + S @ qd[robot.tree.pieces[piece.parent].columns]
                g = pose @ g
                r_rate, w = V[3:] + ca.cross(V[:3], se3.position(g)), se3.rotation(g).T @ V[:3]
                outer, rate = self.bases[piece.parent]
                base = outer @ g, rate + se3.rotation(outer) @ r_rate
            twist = ca.vertcat(w, se3.rotation(base[0]).T @ base[1])
            own, at = (self._section if piece.is_rod else self._joint)(piece, twist, sorted(places))
            for known, new in zip(
                (self.own, self.stand, self.at, self.bases, turns), (own, (g, r_rate), at, base, w), strict=True
            ):
                known.append(new)

    def _section(self, piece, twist, places):
        data = slices.slice_data(piece, slices.MASSES, self.density)
        nodes, wet = tuple(p.x for p in piece.slices), self.density is not None
        kernel = swinging.coriolis_kernel(nodes, tuple(places), basis(piece), slices.shape(data), wet)
        rate = self.qd[piece.columns]
        N, G, B, F, D, own, *there = kernel(self.q[piece.columns], rate, twist, piece.xi_bar, piece.length, data)
        return Turning(N, B, G, F, D, own), {x: there[3 * k : 3 * k + 3] for k, x in enumerate(places)}

    def _joint(self, piece, twist, places):
        n, turn = piece.size, ca.vertcat(twist[:3], ca.DM(3, 1))
        pose, S = piece.joint_step(self.q[piece.columns])
        rate = se3.ad(turn) @ S + piece.twists_rate(self.q, self.qd, 1.0)
        nothing = ca.DM(6, n)
        turning = Turning(ca.DM(6, 6), ca.DM(6, 6), nothing, nothing, nothing, ca.DM(n, n))
        N = body_inertia(piece, pose, self.density)
        if N.nnz():
            turning = turning.add(N, self._turned(N, turn + S @ self.qd[piece.columns], twist), S, rate)
        at = {0.0: (ca.DM.eye(4), nothing, nothing), 1.0: (pose, S, rate)}
        return turning, {x: at[x] for x in places}

    def _turned(self, N, V, twist):
        """B [6 x 6] of a body of inertia N that moves with the twist V against the origin of a base with `twist`."""
        if self.density is not None:  # the momentum of added mass counts the velocity of the base, too
            return -(N @ se3.ad(V)) - gyroscopic(N @ (V + ca.vertcat(ca.DM(3, 1), twist[3:])))
        w, v, m, h = V[:3], V[3:], N[3, 3], axial(N[:3, 3:])
        second = ca.trace(N[:3, :3]) / 2 * ca.DM.eye(3) - N[:3, :3]
        return swinging.swung(ca.skew(w) @ second + v @ h.T, ca.cross(w, h) + m * v)

    def moved(self, g, r_rate, N, B):
        """N and B of what stands at the frame g, which goes with the velocity r_rate, seen from the frame of g."""
        N = moved(g, N, self.density)
        return N, moved_rate(g, B) - ca.horzcat(N[:, 3:] @ ca.skew(r_rate), ca.DM(6, 3))

    def in_world(self, i, turning):
        """G, F and D [6 x n_i] of piece i, seen from the world."""
        base, velocity = self.bases[i]
        G, F, D = (se3.coAd(base) @ part for part in (turning.G, turning.F, turning.D))
        return G, F, D + ca.vertcat(ca.skew(velocity) @ G[3:, :], ca.DM(3, turning.G.columns()))

    def twists(self, j, x):
        """S and dS/dt [6 x n_j] of the place x on piece j, seen from the world."""
        if (j, x) not in self._in_world:
            (base, velocity), (_, S, rate) = self.bases[j], self.at[j][x]
            S, rate = se3.Ad(base) @ S, se3.Ad(base) @ rate
            swept = ca.vertcat(ca.DM(3, S.columns()), ca.skew(velocity) @ S[:3, :])
            self._in_world[j, x] = S, rate + swept
        return self._in_world[j, x]


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
