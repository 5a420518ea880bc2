"""Wrenches inside a robot in equilibrium, and the potential energy of its weight.

    F_elastic(X) = F_carried(X) + F_actuation(X),
in the body frame at X, with F_carried the wrench of all loads beyond X (so a pull at the tip is tension, +) and
F_actuation = sum u_a gain [d x t; t], less what friction takes on the way. Source: F. Renda et al., T-RO 2018.
"""

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.mechanics import recursions
from socontrol.mechanics.loads import Field, PointLoad
from socontrol.model.quadrature import gauss_legendre


def carried_beyond(statics, piece, x):
    """Wrench [6] about the world's origin of all loads at and beyond x of a piece."""
    kin, (places, fields) = statics.kin, statics.carried
    F = ca.DM(6, 1)
    for place, here in places[piece].items():
        if place >= x:
            F += here.F
    for field in fields[piece]:
        F += _part(kin, piece, field, x)
    return F + _spread_correction(statics, piece, x)


def _spread_correction(statics, i, x):
    """What loads spread over piece i carry beyond x, less what their quadrature points beyond x carry."""
    F, slices = ca.DM(6, 1), statics.kin.tree.pieces[i].slices
    spread = [p for p in statics.robot.loads if isinstance(p, PointLoad) and p.spread and p.piece == i]
    if x == 0 or not spread:
        return F
    nodes = [p.x for p in slices]
    shares = dict(zip(nodes, _shares(nodes, x), strict=True))
    for load in spread:
        F += (shares[load.x] - (load.x >= x)) * load.wrench(statics.kin)[0]
    return F


def _shares(nodes, x):
    """int_x^1 l_k / int_0^1 l_k of the Lagrange polynomials l_k through Gauss points `nodes` on [0, 1]."""
    points, weights = gauss_legendre(len(nodes))
    y = x + (1 - x) * np.array(points)
    shares = []
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        basis = np.prod((y[:, None] - others) / (node - others), axis=1)
        shares.append(float((1 - x) * basis @ weights / weights[k]))
    return shares


def _part(kin, i, field, x):
    """The share of a force field beyond x, on Gauss points of its own."""
    if x == 0:
        return recursions.field_wrench(kin, i, field)[0]
    piece = kin.tree.pieces[i]
    density = [w / p.weight for w, p in zip(field.weights, piece.slices, strict=True)]
    F = ca.DM(6, 1)
    for p in piece.record.slices(piece.index, 1, x, 1.0):
        force = _between(piece.slices, density, p.X) * p.weight * field.force
        F += ca.vertcat(ca.cross(se3.position(kin.pose(i, p.x)), force), force)
    return F


def _between(slices, values, X):
    """Polynomial through the values on the slices, at X (Lagrange)."""
    total = 0
    for i, a in enumerate(slices):
        basis = 1.0
        for j, b in enumerate(slices):
            if i != j:
                basis *= (X - b.X) / (a.X - b.X)
        total += basis * values[i]
    return total


def wrench(statics, segment, X):
    """Elastic wrench [6] at X of a rod, body frame there."""
    robot, tree, q = statics.robot, statics.robot.tree, statics.q
    frame = tree.locate(segment, X)
    piece = tree.pieces[frame.piece]
    if not piece.is_rod:
        raise ValueError(f"'{segment}' is a joint; it has a reaction, rods have internal wrenches")
    F = recursions.pulled(statics.kin.pose(frame.piece, frame.x), carried_beyond(statics, frame.piece, frame.x))
    for k, shares in enumerate(robot.lines):
        for line in shares:
            if line.piece == frame.piece:
                F += statics.u[k] * robot.friction.ratio(k, line, q, frame.x) * line.wrench(tree, q, frame.x)
    return F


def reaction(statics, segment):
    """Wrench [6] on a segment from what carries it (structure and cables together), at its base, in its frame."""
    i = statics.robot.tree.of[segment][0]
    return -recursions.pulled(statics.kin.base(i), carried_beyond(statics, i, 0))


def gravitational_energy(robot, kin):
    """-sum m g . r [J], less that of displaced water; zero with all mass at the world's origin."""
    total = ca.DM(0)
    for load in robot.weights:
        if isinstance(load, Field):
            total -= ca.dot(recursions.weighted_position(kin, load.piece, load), load.force)
        else:
            g = kin.pose(load.piece, load.x) @ load.offset
            total -= ca.dot(ca.vertcat(*load.force), se3.position(g))
    return total
