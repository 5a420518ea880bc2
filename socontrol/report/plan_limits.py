"""Everything a plan keeps within limits, over time and in SI: what the words and the strips of a plan are made of."""

from dataclasses import dataclass

import numpy as np

from socontrol.report.units import number, readable

WITHIN = 1.0  # of the range of coordinates and rates
NEAR = 1e-4  # of the range: closer to a limit is on it, past it by more is beyond


@dataclass(frozen=True)
class Quantity:
    """values [K x j] of `names` in `units` at the output times, lower and upper [j]; replay [K x j]: re-simulated.

    within: limits further off than so many times the range of the values are not worth drawing.
    """

    title: str
    names: tuple
    units: tuple
    values: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    replay: np.ndarray | None = None
    within: float = np.inf

    def limits(self, k):
        """Finite limits of the k-th: none, one or two."""
        return [float(x) for x in (self.lower[k], self.upper[k]) if np.isfinite(x)]

    def room(self, k):
        """Size of the range of the k-th, for what counts as near."""
        ends = [abs(x) for x in self.limits(k)]
        span = self.upper[k] - self.lower[k]
        return span if np.isfinite(span) else max([*ends, float(np.ptp(self.values[:, k])), 1e-300])


def quantities(result):
    """The Quantities of a plan that it has any of."""
    arrays, question = result.arrays, result.question
    robot, u = question.robot, arrays["u"].reshape(len(arrays["t"]), -1)
    turns = tuple(f"{unit}/s" for unit in robot.coordinate_units)
    pulls = tuple(f"{unit}/s" for unit in robot.input_units)
    replayed = [arrays.get(key) for key in ("replay.q", "replay.qd")]
    bounded, rates = question.coordinate_limits(), limits(question, "rates", robot.coordinates, turns)
    found = [
        Quantity("coordinate", robot.coordinates, robot.coordinate_units, arrays["q"], *bounded, replayed[0], WITHIN),
        Quantity("rate", robot.coordinates, turns, arrays["qd"], *rates, replayed[1], WITHIN),
        Quantity("input", robot.inputs, robot.input_units, u, *question.input_limits()),
    ]
    more = (("input rate", pulls, "ud", "input_rates"), ("length", robot.length_units, "lengths", "lengths"))
    for title, units, array, key in more:
        if array in arrays:
            ends = limits(question, key, robot.inputs, units)
            found.append(Quantity(title, robot.inputs, units, arrays[array].reshape(u.shape), *ends))
    found.append(_clearances(question, arrays))
    return [x for x in found if x.names]


def limits(question, key, names, units):
    """(lower, upper) of `names` from the question's limits of this key, infinite where there are none."""
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for k, ends in question.limits.ranges(key, names, units).items():
        lower[k], upper[k] = ends
    return lower, upper


def _clearances(question, arrays):
    """Least distances of the surface to the obstacles, at least the clearance asked for."""
    known = (question.obstacles or {}).items()
    asked = {name: float(x.clearance) for name, x in known if f"clearance.{name}" in arrays}
    lower = np.array(list(asked.values()))
    values = np.array([arrays[f"clearance.{name}"] for name in asked]).T
    return Quantity("clearance", tuple(asked), ("m",) * len(asked), values, lower, np.full(len(asked), np.inf))


@dataclass(frozen=True)
class AtLimit:
    """The k-th of a Quantity on its `lower` or `upper` limit for a `share` of the time, or past it by `beyond`."""

    quantity: Quantity
    k: int
    side: str
    limit: float
    share: float
    beyond: float


def at_limits(quantity, t):
    """AtLimit of all that touch a limit, those that pass it first, then by how long; what is held fixed is left out."""
    found, weights = [], spans(t)
    for k in range(len(quantity.names)):
        room = quantity.room(k)
        if not quantity.upper[k] > quantity.lower[k]:
            continue
        for side, limit, sign in (("lower", quantity.lower[k], -1), ("upper", quantity.upper[k], 1)):
            past = sign * (quantity.values[:, k] - limit)
            if np.isfinite(limit) and np.max(past) > -NEAR * room:
                share, beyond = float(weights @ (past > -NEAR * room)), float(np.max(past))
                found.append(AtLimit(quantity, k, side, float(limit), share, beyond if beyond > NEAR * room else 0.0))
    return sorted(found, key=lambda x: (-x.beyond, -x.share))


def spans(t):
    """Share [K] of the time that each output stands for."""
    if len(t) < 2 or not t[-1] > t[0]:
        return np.full(len(t), 1.0 / len(t))
    steps = np.diff(t) / (t[-1] - t[0])
    return 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))


def in_unit(unit, *values):
    """(value of one in SI, name) of the unit that suits the largest value, of rates too; pure numbers in %."""
    if unit.startswith("1/m"):
        return 1.0, "1/(m s)" if unit == "1/m/s" else unit
    above, slash, below = unit.partition("/")
    one, name = (0.01, "%") if above == "1" else readable(above, *values)
    return one, f"{name}{slash}{below}"


def told(x, unit, digits=4):
    """`20 N m/s`: the number in the unit that suits it; 0 alone where nothing is."""
    one, name = in_unit(unit, x)
    return f"{number(x / one, digits)} {name}" if x else "0"
