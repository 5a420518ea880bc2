"""Which coordinates move mass: where none moves, no acceleration is distinct."""

import numpy as np

from socontrol.mechanics.loops import independent
from socontrol.programs.equilibria.closing import CLOSED, ITERATIONS, Assembly
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.quantities import Bad, joined

WEIGHTLESS = 1e-12  # root of an entry of M beside the largest: less is no mass
NONE = 1e-13  # of the largest inertia: less is none
SHARE = 0.1  # of a motion's largest coordinate: those that take part in it


def refuse_massless(plant, closed=None, balance=None):
    """Raise Bad where coordinates move no mass, so that no acceleration is distinct, naming them.

    closed: of a robot with loops, a shape with them closed, near which its ClosedBalance finds others; loops leave some
    motions, which are looked at.
    """
    rng = np.random.default_rng(0)
    scale, shared = 1 / np.maximum(displacement_weights(plant.robot), 1e-300), None
    for _ in range(3):
        q = 0.1 * rng.standard_normal(plant.n) * np.minimum(scale, 1.0)
        if balance is not None:
            q = _closed(balance, plant, closed, q)
        M = plant.tangents(0.0, q, np.zeros(plant.n))[0][np.ix_(plant.free, plant.free)]
        loose = _loose(M) if balance is None else _loose_between(M, balance, q, scale, plant.free)
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


def _closed(balance, plant, q, change):
    """A closed shape about as far from the closed shape q as `change`; q itself where loops do not close there."""
    found, error = Assembly(balance, np.isin(np.arange(plant.n), plant.free)).closed(q + change, ITERATIONS)
    return found if error <= CLOSED else q


def _loose_between(M, balance, q, scale, free):
    """Which of the free coordinates move, but no mass, in motions that loops leave at a closed shape q."""
    size, robot = scale[free], balance.robot
    Z = independent(balance.rows(q)[1][:, free] * size, balance.units, robot.length).left * size[:, None]
    _, values, rows = np.linalg.svd(Z.T @ M @ Z)
    still = np.abs(Z @ rows[values <= NONE * np.max(np.diag(M) * size**2, initial=0.0)].T) / size[:, None]
    return (still / np.max(still, axis=0, initial=1e-300)).max(axis=1, initial=0.0) > SHARE
