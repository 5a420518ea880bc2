"""Which coordinates move mass: where none moves, no acceleration is distinct. And how far each moves the robot."""

import numpy as np

from socontrol.mechanics.loops import independent
from socontrol.quantities import Bad, joined

WEIGHTLESS = 1e-12  # root of an entry of M beside the largest: less is no mass
NONE = 1e-13  # of the largest inertia: less is none
SHARE = 0.1  # of a motion's largest coordinate: those that take part in it


def displacement_weights(robot):
    """[n] metres that a unit of each coordinate moves the robot's ends at q = 0; turns count a tenth of its size."""
    f, weights = robot.functions(), np.zeros(robot.n)
    for segment in robot.segments:
        J = np.array(f.jacobian(segment, 1.0).function(np.zeros(robot.n)))
        moves = np.linalg.norm(J[3:], axis=0) + 0.1 * robot.length * np.linalg.norm(J[:3], axis=0)
        weights = np.maximum(weights, moves)
    return weights


def refuse_massless(plant, closed=None):
    """Raise Bad where coordinates move no mass, so that no acceleration is distinct, naming them.

    closed: a shape with loops closed, of a robot that has any: they leave some motions, which are looked at.
    """
    rng = np.random.default_rng(0)
    scale, shared = 1 / np.maximum(displacement_weights(plant.robot), 1e-300), None
    for _ in range(3):
        q = 0.1 * rng.standard_normal(plant.n) * np.minimum(scale, 1.0) + (0.0 if closed is None else closed)
        M = plant.tangents(0.0, q, np.zeros(plant.n))[0][np.ix_(plant.free, plant.free)]
        loose = _loose(M) if closed is None else _loose_between(M, plant, q)
        shared = loose if shared is None else shared & loose
    if shared is not None and shared.any():
        names = [plant.robot.coordinates[plant.free[k]] for k in np.flatnonzero(shared)]
        fix = "give what they move a body with mass (and inertia), or drive them under `coordinates:`"
        raise Bad("robot", f"nothing that has mass moves with {joined(names, 'and')} (singular mass matrix); {fix}")


def _loose(M):
    """Which coordinates move no mass, by their mass matrix."""
    size = np.sqrt(np.maximum(np.diag(M), 0.0))
    loose = size <= WEIGHTLESS * np.max(size, initial=0.0)
    if not loose.any() and M.size:
        _, values, rows = np.linalg.svd(M / np.outer(size, size))
        loose = np.abs(rows[values <= NONE]).max(axis=0, initial=0.0) > SHARE
    return loose


def _loose_between(M, plant, q):
    """Which coordinates move, but no mass, in motions that loops leave at q."""
    size = 1 / np.maximum(displacement_weights(plant.robot)[plant.free], 1e-300)
    A = np.array(plant.functions.loop_jacobian.function(q, *plant.parameters(0.0)))[:, plant.free] * size
    units = [unit for loop in plant.robot.loops.values() for unit in loop.units]
    rank, Vt, _ = independent(A, units, plant.robot.length)
    Z = Vt[rank:].T * size[:, None]
    _, values, rows = np.linalg.svd(Z.T @ M @ Z)
    still = np.abs(Z @ rows[values <= NONE * np.max(np.diag(M) * size**2, initial=0.0)].T) / size[:, None]
    return (still / np.max(still, axis=0, initial=1e-300)).max(axis=1, initial=0.0) > SHARE
