"""The rest of least energy among those that several closed shapes lead to.

Where forces have a potential V, r = dV/dq, two rests differ by V(q1) - V(q0) = int r dq along any way between them: the
straight one here, by Gauss quadrature.
"""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.model.quadrature import gauss_legendre
from socontrol.programs.equilibria.balance import Equilibrium
from socontrol.programs.equilibria.closing import CLOSED, Assembly, unwound
from socontrol.programs.equilibria.stability import stability

SHAPES = 4  # random closed shapes to start from, beside the first
POINTS = 24  # of the quadrature: exact to 1e-9 where joints turn by pi
LOWER = 1e-6  # of the robot's own energy: rests that are less apart are one, as where a joint has turned once more


@dataclass(frozen=True)
class _Rest:
    """An equilibrium, whether it is stable, and V there over V at the first rest in J."""

    answer: Equilibrium
    stands: bool
    above: float


def rest_of(balance, u, q0, prescribed, limit, *, guessed, p=None):
    """(equilibrium of a Balance at inputs u, {}), from q0 or, unless it is `guessed` how loops close and they may do so
    in several ways, (the one of least energy, {`tried`: shapes, `rests`: that differ})."""
    if guessed or not balance.robot.loops or not _undecided(balance, prescribed, p):
        return balance.solve(u, q0, p, prescribed, limit), {}
    answer, tried = _least_rest(balance, u, prescribed, limit, p)
    if tried["rests"] > 1:
        message = f"{answer.status.message} Of {tried['rests']} rests found it has the least energy"
        answer = replace(answer, status=replace(answer.status, message=f"{message}; a `guess` leads to others."))
    return answer, tried


def _undecided(balance, prescribed, p):
    """Whether the robot's own shape leaves open how loops close: at 0, but for what is prescribed, they are not."""
    return bool(np.max(np.abs(balance.rows(_placed(balance, prescribed), p)[0] / balance.reach), initial=0.0) > CLOSED)


def _least_rest(balance, u, prescribed, limit, p):
    """As `rest_of`; the rest nearest to 0 comes first. Of the stable rests, else of all, that of least V is taken."""
    start = _placed(balance, prescribed)
    free = ~np.isin(np.arange(start.size), list(prescribed))

    def stands(answer):
        tangent = balance.unbalanced(answer.q, u, answer.lam, p)[1]
        return stability(tangent, balance.scales, True, free, balance.held(answer.q, free)).stable

    nearest = balance.solve(u, start, p, prescribed, limit)
    rests, tried, rng = [], 1, np.random.default_rng(2)
    if nearest.status.solved:
        rests.append(_Rest(nearest, stands(nearest), 0.0))
    assembly = Assembly(balance, free, p)
    for _ in range(SHAPES):
        shape, error = assembly.shaken(start, rng)
        if error > CLOSED:
            continue
        tried += 1
        answer = balance.rest_beside(u, unwound(balance.robot, shape, free), prescribed, p)
        if not answer.status.solved:
            continue
        above = _difference(balance, rests[0].answer.q, answer.q, u, p) if rests else 0.0
        if all(abs(above - rest.above) > LOWER * balance.scales.energy for rest in rests):
            rests.append(_Rest(answer, stands(answer), above))
    best = min(rests, key=lambda rest: (not rest.stands, rest.above), default=None)
    return best.answer if best else nearest, {"tried": tried, "rests": len(rests)}


def _placed(balance, prescribed):
    """0 but for the prescribed coordinates [n]."""
    q = np.zeros(balance.robot.n)
    q[list(prescribed)] = list(prescribed.values())
    return q


def _difference(balance, q0, q1, u, p):
    """V(q1) - V(q0) in J."""
    places, weights = gauss_legendre(POINTS)
    ways = zip(places, weights, strict=True)
    forces = [w * np.array(balance.evaluate(q0 + x * (q1 - q0), u, p)[0]) for x, w in ways]
    return float(sum(forces) @ (q1 - q0))
