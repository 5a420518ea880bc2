"""Where a motion of a robot with loops begins: given coordinates and rates, moved as little as closes the loops.

What is driven stays; what the file names stays where the loops can close so, else what it names last is moved, too, one
after the other. Changes are scaled by each coordinate's own magnitude.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from socontrol.mechanics.loops import loop_of
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.closing import CLOSED, ITERATIONS, Assembly
from socontrol.programs.result import Status
from socontrol.quantities import joined

MOVED = 1e-9  # of a coordinate's magnitude: less is no change
FOLLOWED = 1e-9  # of the largest rate: what is left of A qd


@dataclass(frozen=True)
class Begun:
    """q, qd [n each]; status: why there is no start, else None; moved {coordinate: by how much}, and of those that the
    file names the ones that could not stay (`let_go`); redundant {loop: rows that hold nothing of their own}; balance:
    the ClosedBalance that closed the loops, None without."""

    q: np.ndarray
    qd: np.ndarray
    status: Status | None = None
    moved: dict = field(default_factory=dict)
    let_go: tuple = ()
    redundant: dict = field(default_factory=dict)
    balance: ClosedBalance | None = None

    @property
    def sentence(self):
        """What is to be said of named coordinates that could not stay, else nothing."""
        if not self.let_go:
            return ""
        return f" Loops do not close with {joined(self.let_go, 'and')} as given: moved as little as closes them."


class Beginning:
    """Closes the loops of a robot for starts in which the coordinates `driven` [n] stay."""

    def __init__(self, robot, driven, parameters=(), p=None):
        self.robot, self.driven, self.p = robot, driven, p
        self.balance = ClosedBalance(replace(robot, compiled=False), parameters)

    def begun(self, q, qd, kept, rates_kept):
        """Begun nearest to q and qd; kept, rates_kept: indices of what the file names, in its order."""
        balance, free, size = self.balance, ~self.driven, self.balance.scales.q
        found, status = self._closed(q, kept)
        if status is not None:
            return Begun(found, qd, status)
        moved = np.abs(found - q) > MOVED * size
        for count in range(len(rates_kept), -1, -1):
            rates, status = self._following(found, qd, self._free(rates_kept[:count]))
            if status is None:
                break
        let_go = [self.robot.coordinates[i] for i in kept if moved[i]]
        past = np.abs(rates - qd) > MOVED * np.maximum(size, np.abs(qd))
        let_go += [f"the rate of {self.robot.coordinates[i]}" for i in rates_kept if past[i]]
        changes = {self.robot.coordinates[i]: float(found[i] - q[i]) for i in np.flatnonzero(moved)}
        redundant = balance.redundant(found, free)
        return Begun(found, rates, status or self._beyond(found), changes, tuple(let_go), redundant, balance)

    def _closed(self, q, kept):
        """(the closed shape nearest to q, None), else (the nearest found, status)."""
        for count in range(len(kept), -1, -1):
            assembly, whole = Assembly(self.balance, self._free(kept[:count]), self.p), count in (0, len(kept))
            with np.errstate(all="ignore"):
                found, error = assembly.assembled(q) if whole else assembly.closed(q, ITERATIONS)
            if error <= CLOSED:
                return found, None
        return found, assembly.told(found)

    def _free(self, kept):
        free = ~self.driven
        free[list(kept)] = False
        return free

    def _following(self, q, qd, free):
        """(rates nearest to qd that keep loops closed, None), else (the nearest, status)."""
        A = self.balance.rows(q, self.p)[1] / self.balance.reach[:, None]
        size = self.balance.scales.q[free]
        rates, largest = qd.copy(), np.max(np.abs(A * qd), initial=0.0)
        rates[free] -= size * np.linalg.lstsq(A[:, free] * size, A @ qd, rcond=FOLLOWED)[0]
        left = np.abs(A @ rates)
        if np.all(left <= FOLLOWED * largest):
            return rates, None
        name = loop_of(self.robot.loops, int(np.argmax(left)))
        sentence = f"Loop '{name}' does not let the driven joints move so at the start; give other histories"
        return rates, Status("infeasible", f"{sentence}, or begin away from a dead point.")

    def _beyond(self, q):
        """Status where the closed shape is beyond a joint's limits, else None."""
        for name, x, (lower, upper) in zip(self.robot.coordinates, q, self.robot.joint_limits, strict=True):
            if not lower - 1e-9 <= x <= upper + 1e-9:
                sentence = f"Closed as near to the start as can be, loops put {name} at {x:.6g}, outside its limits"
                fix = "give `start.coordinates` near a shape within them"
                return Status("infeasible", f"{sentence} [{lower:g}, {upper:g}]; {fix}.")
        return None
