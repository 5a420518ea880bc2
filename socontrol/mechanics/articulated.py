"""Articulated bodies: accelerations from forces, in time and expression size linear in the pieces.

A piece whose base accelerates by A (angular, and linear of its origin) answers the wrench M A + P. With the sums bb,
bq, qq of what it carries, and b, p its bias wrench and force at A = qdd = 0,
    qdd = qq^-1 (f - p - bq^T A),    M = bb - bq qq^-1 bq^T,    P = b + bq qq^-1 (f - p).
Weights follow from a world that falls up: the bases of roots accelerate by -gravity.
Sources: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 7; F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics.motion import Sweep, is_identity, moved_inertia, shielded, turned
from socontrol.mechanics.slices import mirrored


def accelerations(robot, q, qd, force, gravity=None):
    """qdd [n] under generalised forces [n] that are not of mass, added mass, drag, lift, or weights under `gravity`."""
    sweep, tree = Sweep(robot, q, qd, still=True, gravity=gravity), robot.tree
    hanging, answers = [{} for _ in tree.pieces], [None] * len(tree.pieces)
    for i in reversed(range(len(tree.pieces))):
        piece, moved = tree.pieces[i], sweep.moved[i]
        sums = *moved.inertia, moved.wrench, moved.work
        for x, (M, P) in hanging[i].items():
            pose, S, motion = moved.at[x]
            sums = shielded(_hang)(*sums, M, P, pose, S, motion.stacked())
        _refuse_massless(piece, sums[2])
        M, P, *answers[i] = shielded(_free)(*sums, force[piece.columns])
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
        if piece.parent is None:
            A = sweep.root(piece)
        else:
            pose, S, bias = sweep.moved[piece.parent].at[piece.place]
            A = shielded(_arrive)(bases[piece.parent], found[piece.parent], pose, S, bias.stacked())
            if not is_identity(piece.placement):
                A = shielded(_brought(piece.placement))(A)
        bases.append(A)
        found.append(shielded(_answer)(A, *answers[i]))
    return found


def _refuse_massless(piece, qq):
    """Raise ValueError where a coordinate moves nothing: no force gives it a distinct acceleration."""
    if not isinstance(qq, ca.MX) and any(ca.SX(qq[k, k]).is_zero() for k in range(piece.size)):
        raise ValueError(f"nothing that has mass moves with '{piece.segment}'; give what it moves a body with mass")


def _hang(bb, bq, qq, b, p, M, P, pose, S, bias):
    """The sums of a piece with what stands at `pose` on it; `bias`: motion there at A = qdd = 0, own axes."""
    N, n = moved_inertia(pose, M), turned(pose, P + M @ bias[6:])
    NS = N @ S
    return bb + N, bq + NS, qq + mirrored(S.T @ NS), b + n, p + S.T @ n


def _free(bb, bq, qq, b, p, force):
    """M, P of a piece whose coordinates answer, and how they do: L, Y and z with L^T qdd = z - Y A.

    With qq = L D L^T:  Y = (L D)^-1 bq^T,  z = (L D)^-1 (f - p).
    """
    if not qq.numel():
        return bb, b, ca.DM(0, 0), ca.DM(0, 6), ca.DM(0, 1)
    L, D = ldl(qq)
    half = forward(L, ca.horzcat(bq.T, force - p))
    solved = half / ca.repmat(D, 1, 7)
    Y, z = solved[:, :6], solved[:, 6]
    return bb - mirrored(half[:, :6].T @ Y), b + half[:, :6].T @ z, L, Y, z


def _answer(A, L, Y, z):
    """qdd [n]: L^T qdd = z - Y A."""
    return backward(L, z - Y @ A)


def _placed(g):
    """M and P of the frame g, seen from the frame g is given in. The centripetal part is in P: see `Sweep`."""
    return lambda M, P: (moved_inertia(g, M), turned(g, P))


def _brought(g):
    return lambda A: se3.Ad_inv(g) @ A


def _arrive(A, qdd, pose, S, bias):
    R, r = se3.rotation(pose), se3.position(pose)
    here = A + S @ qdd
    return ca.vertcat(R.T @ here[:3], R.T @ (here[3:] + ca.cross(here[:3], r))) + bias[6:]


def ldl(A):
    """(L, D) of a symmetric positive definite A [n x n] = L diag(D) L^T, L with a diagonal of ones; written out."""
    n = A.rows()
    L, D = [[0] * n for _ in range(n)], [0] * n
    for j in range(n):
        scaled = [L[j][k] * D[k] for k in range(j)]
        D[j] = A[j, j] - sum((L[j][k] * scaled[k] for k in range(j)), 0)
        L[j][j], inverse = 1, 1 / D[j]
        for i in range(j + 1, n):
            L[i][j] = (A[i, j] - sum((L[i][k] * scaled[k] for k in range(j)), 0)) * inverse
    return ca.blockcat(L), ca.vertcat(*D)


def forward(L, B):
    """L^-1 B of a lower triangular L with a diagonal of ones."""
    X = []
    for i in range(L.rows()):
        X.append(B[i, :] - sum((L[i, k] * X[k] for k in range(i)), 0))
    return ca.vertcat(*X)


def backward(L, b):
    """L^-T b of a lower triangular L with a diagonal of ones."""
    n = L.rows()
    X = [b[i, :] for i in range(n)]
    for i in reversed(range(n)):
        X[i] = X[i] - sum((L[k, i] * X[k] for k in range(i + 1, n)), 0)
    return ca.vertcat(*X)


def spd_solve(A, B):
    """A^-1 B of a symmetric positive definite A [n x n]."""
    L, D = ldl(A)
    return backward(L, forward(L, B) / ca.repmat(D, 1, B.columns()))
