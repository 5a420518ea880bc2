"""Articulated bodies: accelerations from forces, in time and expression size linear in the pieces.

A piece whose base accelerates by A (angular, and linear of its origin) answers the wrench M A + P. With the sums bb,
bq, qq of what it carries, and b, p its bias wrench and force at A = qdd = 0,
    qdd = qq^-1 (f - p - bq^T A),    M = bb - bq qq^-1 bq^T,    P = b + bq qq^-1 (f - p).
Sources: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 7; F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics.composite import own_inertia
from socontrol.mechanics.motion import Sweep, is_identity, shielded
from socontrol.mechanics.newton_euler import turned
from socontrol.mechanics.slices import mirrored


def accelerations(robot, q, qd, force):
    """qdd [n] under generalised forces [n] that are not of mass, added mass, drag or lift."""
    sweep, tree = Sweep(robot, q, qd, still=True), robot.tree
    density = robot.water.density if robot.water else None
    hanging, answers = [{} for _ in tree.pieces], [None] * len(tree.pieces)
    for i in reversed(range(len(tree.pieces))):
        piece, moved = tree.pieces[i], sweep.moved[i]
        inertia = own_inertia(piece, q, density)
        sums = inertia.bb, inertia.bq, inertia.qq, moved.wrench, moved.work
        for x, (M, P) in hanging[i].items():
            pose, S, motion = moved.at[x]
            sums = shielded(_hang)(*sums, M, P, pose, S, ca.vertcat(motion.dw, motion.a))
        _refuse_massless(piece, sums[2])
        M, P, gain, start = shielded(_free)(*sums, force[piece.columns])
        answers[i] = gain, start
        if piece.parent is not None:
            if not is_identity(piece.placement):
                M, P = shielded(_placed(piece.placement))(M, P)
            there = hanging[piece.parent]
            before = there.get(piece.place, (0, 0))
            there[piece.place] = before[0] + M, before[1] + P
    return ca.vertcat(*_outward(sweep, answers))


def _outward(sweep, answers):
    """qdd of each piece, base to tip."""
    tree, bases, found = sweep.tree, [], []
    for i, piece in enumerate(tree.pieces):
        A = ca.DM(6, 1)
        if piece.parent is not None:
            pose, S, bias = sweep.moved[piece.parent].at[piece.place]
            qdd = found[piece.parent]
            there = ca.vertcat(bias.dw, bias.a)
            A = shielded(_arrive)(bases[piece.parent], qdd, pose, S, there)
            if not is_identity(piece.placement):
                A = shielded(_brought(piece.placement))(A)
        gain, start = answers[i]
        bases.append(A)
        found.append(start - gain @ A)
    return found


def _refuse_massless(piece, qq):
    """Raise ValueError where a coordinate moves nothing: no force gives it a distinct acceleration."""
    if not isinstance(qq, ca.MX) and any(ca.SX(qq[k, k]).is_zero() for k in range(piece.size)):
        raise ValueError(f"nothing that has mass moves with '{piece.segment}'; give what it moves a body with mass")


def _hang(bb, bq, qq, b, p, M, P, pose, S, bias):
    """The sums of a piece with what stands at `pose` on it; `bias`: acceleration there at A = qdd = 0, own axes."""
    back = se3.Ad_inv(pose)
    N, n = mirrored(back.T @ M @ back), turned(pose, P + M @ bias)
    NS = N @ S
    return bb + N, bq + NS, qq + mirrored(S.T @ NS), b + n, p + S.T @ n


def _free(bb, bq, qq, b, p, force):
    """M, P, qq^-1 bq^T and qq^-1 (f - p)."""
    if not qq.numel():
        return bb, b, ca.DM(0, 6), ca.DM(0, 1)
    solved = spd_solve(qq, ca.horzcat(bq.T, force - p))
    gain, start = solved[:, :6], solved[:, 6]
    return bb - mirrored(bq @ gain), b + bq @ start, gain, start


def _placed(g):
    """M and P of the frame g, seen from the frame g is given in. The centripetal part is in P: see `Sweep`."""
    back = se3.Ad_inv(g)
    return lambda M, P: (mirrored(back.T @ M @ back), turned(g, P))


def _brought(g):
    return lambda A: se3.Ad_inv(g) @ A


def _arrive(A, qdd, pose, S, bias):
    return se3.Ad_inv(pose) @ (A + S @ qdd) + bias


def spd_solve(A, B):
    """A^-1 B of a symmetric positive definite A [n x n] by L D L^T, written out."""
    n = A.rows()
    L, D, X = [[0] * n for _ in range(n)], [0] * n, [B[i, :] for i in range(n)]
    for j in range(n):
        D[j] = A[j, j] - sum((L[j][k] ** 2 * D[k] for k in range(j)), 0)
        for i in range(j + 1, n):
            L[i][j] = (A[i, j] - sum((L[i][k] * D[k] * L[j][k] for k in range(j)), 0)) / D[j]
    for i in range(n):
        X[i] = X[i] - sum((L[i][k] * X[k] for k in range(i)), 0)
    X = [X[i] / D[i] for i in range(n)]
    for i in reversed(range(n)):
        X[i] = X[i] - sum((L[k][i] * X[k] for k in range(i + 1, n)), 0)
    return ca.vertcat(*X)
