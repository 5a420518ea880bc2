"""Limits that hold, or that give way: then each has an unknown by which it does, and these are what is made small."""

from dataclasses import dataclass

import numpy as np

# What giving way by a limit's own size costs: what stands around can be moved, what is asked for is the last to go.
CHEAP, PLAIN, DEAR = 0.5, 1.0, 100.0


@dataclass(frozen=True)
class Loose:
    """A limit that gives way: its name, unit, the place of the unknown in x, what counts as one, what that costs."""

    name: str
    unit: str
    place: int
    size: float
    cost: float = PLAIN


class Giving:
    """Adds limits to a transcription. gives: whether they give way; `loose`: those that do."""

    def __init__(self, transcription, gives):
        self._transcription, self._program, self.gives, self.loose = transcription, transcription.program, gives, []

    def range(self, name, unit, letter, i, low, high, fixed=False):
        """low <= component i of a letter <= high, at all nodes and points."""
        places, size = self._transcription.places(letter)[:, i], size_of(low, high)
        if not self.gives or fixed:
            self._transcription.hold(letter, places, low, high)
        else:
            for side, limit, sign in (("lower", low, 1), ("upper", high, -1)):
                if np.isfinite(limit):
                    slack = self.slack(f"{name} ({side} limit)", unit, size)
                    lower, upper = (limit, np.inf) if sign > 0 else (-np.inf, limit)
                    blocks = {"x": places[:, None], "s": np.full((places.size, 1), slack)}
                    rows = lambda x, s, sign=sign: {"rows": x + sign * s, "scale": size}  # noqa: E731
                    self._program.add(f"{name}.{side}", blocks, rows, lower=lower, upper=upper)

    def slack(self, name, unit, size, cost=PLAIN):
        """Place of an unknown >= 0 by which a limit gives way, at a `cost` for its `size`."""
        place = int(self._program.block(1, scale=size, lower=0.0, guess=0.01 * size)[0])
        self._program.add(f"loose.{name}", {"s": np.array([[place]])}, lambda s: {"cost": cost * s / size})
        self.loose.append(Loose(name, unit, place, size, cost))
        return place

    def rows(self, name, unit, blocks, expression, low, high, size, when, cost=PLAIN, numbers=None):
        """low <= expression <= high at many places; gives way where limits do. `numbers` go to it as last argument."""
        if not self.gives:
            self._program.add(name, blocks, lambda *x: {"rows": expression(*x), "scale": size, "units": unit},
                             lower=low, upper=high, when=when, numbers=numbers)  # fmt: skip
            return
        slack, count = self.slack(name, unit, size, cost), len(next(iter(blocks.values())))
        blocks = {"slack": np.full((count, 1), slack), **blocks}
        sides = [(low, np.inf, 1)] * bool(np.isfinite(low)) + [(-np.inf, high, -1)] * bool(np.isfinite(high))
        for lower, upper, sign in sides:
            self._program.add(name, blocks, lambda s, *x, sign=sign: {"rows": expression(*x) + sign * s, "scale": size},
                             lower=lower, upper=upper, when=when, numbers=numbers)  # fmt: skip

    def met(self, name, unit, place, value, size, k):
        """One coordinate has a value at node k."""
        if self.gives:
            self.rows(name, unit, {"x": np.array([[place]])}, lambda x: x, value, value, size, [k], DEAR)
        else:
            self._transcription.hold("q", place, value, value)


def size_of(low, high):
    """Size of a range: its larger finite end."""
    both = [abs(x) for x in (low, high) if np.isfinite(x) and x]
    return max(both, default=1.0)
