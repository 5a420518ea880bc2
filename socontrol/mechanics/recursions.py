"""Sweeps over the tree: generalised forces of loads and their exact tangent, tip to base.

Seen from the world's origin wrenches of carried things simply add. With F the wrench of all loads carried at a
place x of piece i, D = dF/ds its change for a rigid world twist s of that place, C(F) s = coad_s F, and S the world
twists of the piece's coordinates there,
    Q_i = S^T F
    dQ_i/dq_j = S_i^T (D - C(F)) S_j      j nearer the base
    dQ_j/dq_i = S_j^T D S_i
    dQ_i/dq_i = d(S^T F)/dq at fixed F + S^T D S
so residual and tangent cost one sweep and one product for each pair of pieces on a common branch, not one
derivative sweep a coordinate. This is the composite-body idea (R. Featherstone, "Rigid Body Dynamics Algorithms",
2008, sec. 6.2) on the twists of F. Renda, L. Seneviratne, ICRA 2018.
"""

from collections import defaultdict

import casadi as ca

from socontrol.lie import se3
from socontrol.mechanics.loads import Field, dead, turned


class Carried:
    """Wrench F [6] and tangent D [6 x 6] of what hangs at one place."""

    def __init__(self):
        self.F, self.D = ca.DM(6, 1), ca.DM(6, 6)

    def add(self, F, D):
        self.F, self.D = self.F + F, self.D + D


def carried(kin, loads):
    """For each piece: its places {x: Carried} and force fields [(weights, force, first moment, total weight)]."""
    tree = kin.tree
    places = [defaultdict(Carried) for _ in tree.pieces]
    fields = [[] for _ in tree.pieces]
    for load in loads:
        if isinstance(load, Field):
            fields[load.piece].append(load)
        else:
            places[load.piece][load.x].add(*load.wrench(kin))
    return gathered(kin, places, fields)


def gathered(kin, places, fields):
    """Places and fields of each piece, with what the pieces on it carry added where they stand."""
    tree = kin.tree
    for i in reversed(range(len(tree.pieces))):
        piece, total = tree.pieces[i], Carried()
        for here in places[i].values():
            total.add(here.F, here.D)
        for field in fields[i]:
            total.add(*field_wrench(kin, i, field))
        if piece.parent is not None:
            places[piece.parent][piece.place].add(total.F, total.D)
    return places, fields


def weighted_position(kin, i, field):
    """sum w r [3] of a field, world frame."""
    base, local = kin.base(i), kin.tree.pieces[i].first_moment(kin.q, field.moments)
    return field.weight * se3.position(base) + se3.rotation(base) @ local


def field_wrench(kin, i, field):
    """F [6] of a field about the world's origin and its change dF/ds [6 x 6] with a rigid world twist s."""
    position = weighted_position(kin, i, field)
    F = ca.vertcat(ca.cross(position, field.force), field.weight * field.force)
    return F, dead(position, field.force, field.weight)


def total(kin, places, fields):
    """Wrench [6] about the world's origin of all that is `carried` by the roots."""
    F = ca.DM(6, 1)
    for i, piece in enumerate(kin.tree.pieces):
        if piece.parent is None:
            F += sum((here.F for here in places[i].values()), ca.DM(6, 1))
            F += sum((field_wrench(kin, i, field)[0] for field in fields[i]), ca.DM(6, 1))
    return F


def external_force(kin, places, fields):
    """Generalised force Q [n] of what is `carried`."""
    return ca.vertcat(*(_own_force(kin, i, places[i], fields[i]) for i in range(len(places))))


def _own_force(kin, i, places, fields):
    piece, base = kin.tree.pieces[i], kin.base(i)
    Q = ca.DM(piece.size, 1)
    if piece.size == 0:
        return Q
    for x, here in places.items():
        Q += kin.step(i, x)[1].T @ pulled(base, here.F)
    for field in fields:
        Q += piece.force_potential(kin.q, field.moments, se3.rotation(base).T @ field.force)[0]
    return Q


def pulled(base, F):
    """The wrench F [6], given at the world's origin, in the frame `base`: Ad_base^T F."""
    R, r = se3.rotation(base), se3.position(base)
    return ca.vertcat(R.T @ (F[:3] - ca.cross(r, F[3:])), R.T @ F[3:])


def external_tangent(kin, places, fields, symmetric=False):
    """dQ/dq [n x n], exact for dead and follower loads; `symmetric`: all of them have a potential."""
    tree = kin.tree
    count = len(tree.pieces)
    blocks = {}
    for i, piece in enumerate(tree.pieces):
        if piece.size == 0:
            continue
        own, below, above = _own_tangent(kin, i, places[i], fields[i])
        blocks[i, i] = own
        if piece.parent is None:
            continue
        for j, x in tree.chain(piece.parent, piece.place):
            if tree.pieces[j].size:
                S = kin.twists(j, x)
                blocks[j, i] = S.T @ above
                blocks[i, j] = blocks[j, i].T if symmetric else below @ S
    sizes = [piece.size for piece in tree.pieces]
    rows = [ca.horzcat(*(blocks.get((i, j), ca.DM(sizes[i], sizes[j])) for j in range(count))) for i in range(count)]
    return ca.vertcat(*rows)


def _own_tangent(kin, i, places, fields):
    """dQ_i/dq_i, S^T (D - C) [n_i x 6] and D S [6 x n_i] of one piece."""
    piece, base = kin.tree.pieces[i], kin.base(i)
    own, below, above = ca.DM(piece.size, piece.size), ca.DM(piece.size, 6), ca.DM(6, piece.size)
    for x, here in places.items():
        S = kin.twists(i, x)
        DS = here.D @ S
        own += piece.wrench_gradient(kin.q, x, pulled(base, here.F)) + S.T @ DS
        below += S.T @ (here.D - turned(here.F))
        above += DS
    for field in fields:
        R = se3.rotation(base)
        own += piece.force_potential(kin.q, field.moments, R.T @ field.force)[1]
        DS = ca.vertcat(-(ca.skew(field.force) @ R @ piece.moment_jacobian(kin.q, field.moments)), ca.DM(3, piece.size))
        below += DS.T
        above += DS
    return own, below, above
