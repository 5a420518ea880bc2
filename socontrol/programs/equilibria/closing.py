"""Closing loops: the shape nearest to a guess, by the scaled change of its coordinates, at which e(q) = 0.

Levenberg-Marquardt steps whose damping falls with the square of the error, so that rows may depend on each other; where
the guess does not lead to a closed shape, random ones are tried. Joints that a guess has turned so often that their
angles are rounded to more than an error are first turned back by whole turns, which changes no shape.
Source: J. Fan, Y. Yuan, Computing 74 (2005).
"""

import numpy as np

from socontrol.mechanics.loops import slices, units_of
from socontrol.model.joints import Revolute
from socontrol.programs.equilibria.balance import LONGEST
from socontrol.programs.result import Status
from socontrol.quantities import joined

CLOSED = 1e-12  # scaled error that counts as none
ROUNDING = 1e-14  # that no step takes away
FAR = ROUNDING / np.finfo(float).eps  # angle in rad that is itself rounded to as much
ITERATIONS, NEAREST = 100, 1000  # from a guess; to tell the gap that is left
STARTS = 16  # random shapes to close from


def gaps(robot, e):
    """{loop: `3.2 mm apart and 4 deg askew`} of the loops that rows e [k] leave open."""
    found, units = {}, np.array(units_of(robot.loops), dtype=object)
    for name, own in slices(robot.loops).items():
        turned = units[own] == "rad"
        apart, askew = np.linalg.norm(e[own][~turned]), np.linalg.norm(e[own][turned])
        told = [f"{1e3 * apart:.4g} mm apart"] * bool(apart > CLOSED * robot.length)
        told += [f"{np.degrees(askew):.4g} deg askew"] * bool(askew > CLOSED)
        if told:
            found[name] = joined(told, "and")
    return found


def unwound(robot, q, free, beyond=np.pi, sprung=True):
    """The same shape [n] with free revolute joints without limits that are `beyond` [rad] turned to within half a turn
    of 0; those with springs, too, if `sprung`."""
    q = q.copy()
    for piece in robot.tree.pieces:
        i, joint = piece.columns, piece.record
        if not isinstance(joint, Revolute) or joint.limits or not free[i].all() or abs(q[i][0]) <= beyond:
            continue
        if sprung or not np.any(np.array(joint.matrix("stiffness"), dtype=float)):
            q[i] -= 2 * np.pi * np.round(q[i] / (2 * np.pi))
    return q


class Assembly:
    """The loops of a ClosedBalance, closed by the coordinates that are `free` [n]; `count`: iterations so far."""

    def __init__(self, balance, free, p=None):
        self.balance, self.free, self.p, self.size, self.count = balance, free, p, balance.scales.q[free], 0

    def assembled(self, q):
        """The closed shape nearest to q, else from random shapes; (q, scaled error), the least error where all fail."""
        q = unwound(self.balance.robot, q, self.free, FAR, sprung=False)
        best, least = self.closed(q, ITERATIONS)
        rng = np.random.default_rng(1)
        for _ in range(STARTS if least > CLOSED else 0):
            found, error = self.shaken(q, rng)
            if error < least:
                best, least = found, error
            if least <= CLOSED:
                break
        return (best, least) if least <= CLOSED else self.closed(best, NEAREST)

    def shaken(self, q, rng):
        """As `closed` from a random shape about q: joints anywhere, rods bent by up to a radian a section."""
        q, length = q.copy(), self.balance.robot.length
        for piece in self.balance.robot.tree.pieces:
            bend = 1 / float(piece.length)
            for i in range(piece.columns.start, piece.columns.stop):
                reach = {"rad": np.pi, "m": length / 2, "1/m": bend}.get(self.balance.robot.coordinate_units[i], 0.0)
                q[i] += reach * rng.uniform(-1, 1) * self.free[i]
        return self.closed(q, ITERATIONS)

    def _error(self, q):
        e, E = self.balance.rows(q, self.p)
        return e / self.balance.reach, E[:, self.free] * self.size / self.balance.reach[:, None]

    def closed(self, q, limit):
        """(q, largest scaled error) after damped least-squares steps from q to e = 0."""
        q, damping = q.copy(), 1.0
        e, E = self._error(q)
        for _ in range(limit):
            self.count += 1
            size = float(np.linalg.norm(e))
            if not np.isfinite(size) or size <= ROUNDING or not E.size:
                break
            U, s, Vt = np.linalg.svd(E, full_matrices=False)
            step = -Vt.T @ (s / (s**2 + damping * size * min(size, 1.0)) * (U.T @ e))
            step *= min(1.0, LONGEST / 2 / max(np.max(np.abs(step)), 1e-300))
            trial = q.copy()
            trial[self.free] += step * self.size
            if np.array_equal(trial, q):
                break
            e1, E1 = self._error(trial)
            if np.linalg.norm(e1) < size * (1 - 1e-9) and not self.balance.robot.overstrained(trial):
                q, e, E, damping = trial, e1, E1, max(damping / 4, 1e-4)
            elif size < CLOSED / 10 or (damping := 4 * damping) > 1e12:
                break
        error = np.max(np.abs(e), initial=0.0)
        return q, error if np.isfinite(error) else np.inf

    def told(self, q):
        """Status of the loops that are open at q, the nearest found."""
        e, names, told = np.array(self.balance.rows(q, self.p)[0]), [], []
        if not np.all(np.isfinite(e)):
            return Status("numerical", "The model gave NaN or infinity while loops were closed; start from a guess.")
        for name, gap in gaps(self.balance.robot, e).items():
            names.append(f"'{name}'")
            told.append(gap)
        if len(names) == 1:
            sentence = f"Loop {names[0]} cannot close: at the nearest found its ends stay {told[0]}"
        else:
            each = joined([f"{gap} ({name})" for name, gap in zip(names, told, strict=True)], "and")
            sentence = f"Loops cannot close together: at the nearest found their ends stay {each}"
        held = ", or what is held" if not np.all(self.free) else ""
        return Status("infeasible", f"{sentence}; change lengths or placements{held}, or start from a guess.")
