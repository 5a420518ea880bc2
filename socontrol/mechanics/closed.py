"""Accelerations of a robot whose loops are closed, with masses that may vanish and rows that may depend on each other.

    M qdd = f + A^T lam,    A qdd + A' qd = 0.
Since the second line holds, M may be replaced by N = M + m A^T A, with m the robot's mass and rows in metres: N is
regular where what the loops leave has mass. With G = A N^-1 A^T, G lam = -(A qdd_0 + A' qd) is solved by (G + e)^-1
and again for what is left, which gives the least lam: rows that hold nothing of their own stay at zero.
Sources: E. Bayo et al., Comput. Methods Appl. Mech. Eng. 71 (1988), augmented form; J. Riley, Math. Tables Aids
Comput. 9 (1955), iterated regularisation.
"""

import casadi as ca

from socontrol.mechanics import articulated, composite

REGULAR = 1e-8  # e beside 1/m, the largest eigenvalue G can have
REFINED = 5  # rounds: an eigenvalue of 1e-6/m comes out to 1e-12


def accelerations(robot, kin, force, A, bias, units):
    """qdd [n] and lam [k] under generalised forces [n], with A [k x n], bias A' qd [k], units [k] of the rows.

    Raises ValueError for a coordinate that neither a mass nor a loop feels.
    """
    N, A, mass, scale = augmented(robot, kin, A, units)
    qdd, lam = answer(N, A, mass, force, bias * scale)
    return qdd, lam * scale


def augmented(robot, kin, A, units):
    """(N [n x n], rows [k x n] in metres, m, what the rows [k] were multiplied by); raises as `accelerations`."""
    scale = ca.DM([robot.length if unit == "rad" else 1.0 for unit in units])
    A = A * ca.repmat(scale, 1, robot.n)
    mass = sum((composite.own_inertia(piece, kin.q).bb[5, 5] for piece in robot.tree.pieces), ca.SX(0))
    N = ca.SX(composite.mass(robot, kin) + mass * A.T @ A)
    for name, entry in zip(robot.coordinates, ca.vertsplit(ca.diag(N)), strict=True):
        if entry.is_zero():
            raise ValueError(f"nothing that has mass moves with '{name}'; give what it moves a body with mass")
    return N, A, mass, scale


def answer(N, A, mass, force, bias):
    """qdd [n] and lam [k], rows in metres."""
    moved = articulated.spd_solve(N, ca.horzcat(A.T, force - mass * A.T @ bias))
    gives, free = moved[:, :-1], moved[:, -1]
    G, wanted, lam = A @ gives, -(A @ free + bias), ca.DM(A.rows(), 1)
    L, D = articulated.ldl(G + REGULAR / mass * ca.DM.eye(A.rows()))
    for _ in range(REFINED):
        lam += articulated.backward(L, articulated.forward(L, wanted - G @ lam) / D)
    return free + gives @ lam, lam
