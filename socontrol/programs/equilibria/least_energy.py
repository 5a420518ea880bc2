"""The rest of least energy among those that several closed shapes lead to.

Where forces have a potential V, r = dV/dq, two rests differ by V(q1) - V(q0) = int r dq along any way between them: the
straight one here, by Gauss quadrature.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.model.joints import Revolute
from socontrol.model.quadrature import gauss_legendre
from socontrol.programs.equilibria.balance import Equilibrium
from socontrol.programs.equilibria.closing import CLOSED, Assembly

SHAPES = 4  # random closed shapes to start from, beside the first
POINTS = 24  # of the quadrature: exact to 1e-9 where joints turn by pi
LOWER = 1e-6  # of the robot's own energy: rests that are less apart are one, as where a joint has turned once more


@dataclass(frozen=True)
class _Rest:
    """An equilibrium, whether it is stable, and V there over V at the first rest in J."""

    answer: Equilibrium
    stands: bool
    above: float


def undecided(balance, prescribed):
    """Whether the robot's own shape leaves open how loops close: at 0, but for what is prescribed, they are not."""
    return bool(np.max(np.abs(balance.rows(_placed(balance, prescribed))[0] / balance.reach), initial=0.0) > CLOSED)


def least_rest(balance, u, prescribed, stands, limit):
    """(answer, {`tried`: shapes, `rests`: that differ}) of a ClosedBalance at inputs u; the nearest to 0 comes first.

    stands: function of an answer, whether it is stable. Of the stable rests, else of all, that of least V is taken.
    """
    start = _placed(balance, prescribed)
    nearest = balance.solve(u, start, prescribed=prescribed, max_iterations=limit)
    rests, tried, rng = [], 1, np.random.default_rng(2)
    if nearest.status.solved:
        rests.append(_Rest(nearest, stands(nearest), 0.0))
    assembly = Assembly(balance, ~np.isin(np.arange(start.size), list(prescribed)))
    for _ in range(SHAPES):
        shape, error = assembly.shaken(start, rng)
        if error > CLOSED:
            continue
        tried += 1
        answer = balance.rest_beside(u, _unwound(balance.robot, shape), prescribed)
        if not answer.status.solved:
            continue
        above = _difference(balance, rests[0].answer.q, answer.q, u) if rests else 0.0
        if all(abs(above - rest.above) > LOWER * balance.scales.energy for rest in rests):
            rests.append(_Rest(answer, stands(answer), above))
    best = min(rests, key=lambda rest: (not rest.stands, rest.above), default=None)
    return best.answer if best else nearest, {"tried": tried, "rests": len(rests)}


def _placed(balance, prescribed):
    """0 but for the prescribed coordinates [n]."""
    q = np.zeros(balance.robot.n)
    q[list(prescribed)] = list(prescribed.values())
    return q


def _unwound(robot, q):
    """The same shape with revolute joints within half a turn of 0."""
    q = q.copy()
    for piece in robot.tree.pieces:
        if isinstance(piece.record, Revolute):
            q[piece.columns] -= 2 * np.pi * np.round(q[piece.columns] / (2 * np.pi))
    return q


def _difference(balance, q0, q1, u):
    """V(q1) - V(q0) in J."""
    places, weights = gauss_legendre(POINTS)
    forces = [w * np.array(balance.evaluate(q0 + x * (q1 - q0), u)[0]) for x, w in zip(places, weights, strict=True)]
    return float(sum(forces) @ (q1 - q0))
