"""Magnitudes of a robot's own: what a large coordinate, force, energy and input are, so that programs are well scaled.

Coordinates are scaled by 1/sqrt(K_ii) and forces by sqrt(K_ii), times the root of one energy e0: the elastic energy
of a section bent by one radian. A scaled tangent then has a unit diagonal whatever the rod's size and material.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from socontrol.mechanics import elasticity
from socontrol.mechanics.statics import Statics


@dataclass(frozen=True)
class Scales:
    """q [n], force [n] (conjugate: q * force = energy), energy [J], u [m]."""

    q: np.ndarray
    force: np.ndarray
    energy: float
    u: np.ndarray


def scales(robot):
    """Scales of a robot with numeric values, from its elastic tangent and actuation at q = 0."""
    zero = ca.DM.zeros(robot.n)
    stiffness, natural = np.zeros(robot.n), np.ones(robot.n)
    for piece in robot.tree.pieces:
        if piece.size:
            stiffness[piece.columns] = np.diag(np.array(ca.DM(elasticity.stiffness(piece, zero))))
        if piece.is_rod:
            bends = [name in ("twist", "bend_y", "bend_z") for name in piece.record.active()]
            natural[piece.columns] = np.where(bends, 1 / float(piece.length), 1.0)
    energies = stiffness * natural**2
    statics = Statics(robot, zero)
    held = np.abs(np.array(ca.DM(statics.external_force())).ravel()) * natural
    positive = energies[energies > 0]
    energy = float(np.min(positive)) if positive.size else float(np.max(held, initial=0.0)) or 1.0
    q = np.where(energies > 0, np.sqrt(energy / np.where(stiffness > 0, stiffness, 1.0)), natural)
    return Scales(q, energy / q, energy, _input_scales(robot, statics, energy, q))


def _input_scales(robot, statics, energy, q):
    B = np.abs(np.array(ca.DM(statics.actuation()))) * q[:, None]
    work = np.max(B, axis=0, initial=0.0)
    free = np.where(work > 0, energy / np.where(work > 0, work, 1.0), 1.0)
    limits = np.array(robot.input_limits).reshape(-1, 2)
    largest = np.max(np.abs(limits), axis=1, initial=0.0)
    return np.where(np.isfinite(largest) & (largest > 0), largest, free)
