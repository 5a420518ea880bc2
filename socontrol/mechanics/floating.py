"""Floating-base inverse dynamics: joint accelerations are given, the base answers, and no wrench acts on it.

With qdd_0 of the free joint unknown and its force zero, M_00 qdd_0 = -Q_0 at qdd_0 = 0: one sweep for Q_0, one pass
for the composite inertia M_00, one sweep for the joint forces.
Source: F. Renda, L. Seneviratne, ICRA 2018; R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, sec. 9.5.
"""

import casadi as ca

from socontrol.mechanics.articulated import spd_solve
from socontrol.mechanics.composite import inertias
from socontrol.mechanics.newton_euler import inertial_force
from socontrol.model.joints import Free


def base_piece(tree):
    """The free joint that carries the whole robot; raises ValueError where there is none."""
    roots = [piece for piece in tree.pieces if piece.parent is None or (piece.parent == 0 and piece.place == 0)]
    if len(roots) != 1 or not isinstance(roots[0].record, Free):
        names = ", ".join(piece.segment for piece in roots)
        raise ValueError(f"a floating base is one joint of type 'free' that carries all others; here: {names}")
    return roots[0]


def inverse_dynamics(robot, kin, qd, joints, other):
    """(accelerations of the base's coordinates [6], forces of all other coordinates [n - 6]).

    joints: accelerations of all other coordinates, in their order; other [n]: forces that do not depend on
    accelerations, on the side of M qdd.
    """
    base = base_piece(robot.tree).columns  # the root stands first: columns 0 ... 5
    still = inertial_force(robot, kin.q, qd, ca.vertcat(ca.DM(6, 1), joints)) + other
    M = inertias(robot, kin)[0][0].qq
    qdd = -spd_solve(M, still[base])
    total = inertial_force(robot, kin.q, qd, ca.vertcat(qdd, joints)) + other
    return qdd, total[base.stop :]
