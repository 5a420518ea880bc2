"""Recursive Newton-Euler: generalised forces from motion, in time and expression size linear in the pieces.

One sweep base to tip moves the pieces (`motion`), one sweep tip to base adds what their masses and the water ask for:
    F_i = own wrench + sum coAd(g) F_child,     Q_i = own work + sum S^T coAd(g) F_child.
Source: F. Renda, L. Seneviratne, ICRA 2018; R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 5.
"""

import casadi as ca

from socontrol.mechanics.motion import PARTS, Sweep, is_identity, shielded, turned


def inertial_force(robot, q, qd, qdd, parts=PARTS, current=True, gravity=None):
    """M qdd + C qd [n], less the forces of the water (drag, lift) among `parts` and the weights under `gravity`."""
    return project(Sweep(robot, q, qd, qdd, parts=parts, current=current, gravity=gravity))


def water_force(robot, q, qd):
    """Generalised force [n] of drag and lift, and of the added mass in as much as the water moves."""
    return _of_water(robot, q, qd, project, ca.DM(robot.n, 1))


def water_wrench(robot, q, qd):
    """Wrench [6] of the same about the world's origin, on the whole robot."""
    return _of_water(robot, q, qd, total, ca.DM(6, 1))


def _of_water(robot, q, qd, gathered, nothing):
    if robot.water is None:
        return nothing

    def asked(part, current=True):
        return gathered(Sweep(robot, q, qd, parts=frozenset({part}), current=current))

    force = -asked("drag")
    return force + asked("added", current=False) - asked("added") if moves(robot.water) else force


def moves(water):
    """Whether the water has a velocity that is not plainly zero."""
    return not all(isinstance(v, (int, float)) and v == 0 for v in water.velocity)


def project(sweep):
    """Generalised forces [n] of the wrenches of a sweep, gathered tip to base."""
    return ca.vertcat(*_gathered(sweep)[0])


def total(sweep):
    """Wrench [6] about the world's origin of a whole sweep."""
    roots = _gathered(sweep)[1]
    return sum(roots, ca.DM(6, 1))


def _gathered(sweep):
    """Generalised force of each piece, and what each root asks of the world, seen from there."""
    tree, roots = sweep.tree, []
    hanging = [{} for _ in tree.pieces]  # x: wrench of what stands there, in the frame at x
    forces = [None] * len(tree.pieces)
    for i in reversed(range(len(tree.pieces))):
        piece, moved = tree.pieces[i], sweep.moved[i]
        F, Q = moved.wrench, moved.work
        for x, carried in hanging[i].items():
            pose, S, _ = moved.at[x]
            F, Q = shielded(_add)(F, Q, carried, pose, S)
        forces[i] = Q
        F = F if is_identity(piece.placement) else shielded(_placed(piece.placement))(F)
        if piece.parent is None:
            roots.append(F)
        else:
            there = hanging[piece.parent]
            there[piece.place] = there[piece.place] + F if piece.place in there else F
    return forces, roots


def _add(F, Q, carried, pose, S):
    at_base = turned(pose, carried)
    return F + at_base, Q + S.T @ at_base


def _placed(pose):
    return lambda F: turned(pose, F)
