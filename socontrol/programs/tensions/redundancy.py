"""Postures that all meet the same conditions: where a question has more inputs than goals, and the best one of them.

With x = (q, y) the scaled unknowns of the question's program, q follows from y through the equilibrium r(q, y) = 0,
    dq = -(dr/dq)^-1 (r + dr/dy dy),
and what is left are the other conditions c(q, y) (goals, given lengths) and all limits, linear in dy. Multipliers of
loops follow from y like coordinates do, with the loops' rows beside the equilibrium. A quantity is
made small by steps of sequential quadratic programming in y, each followed by Newton steps back to the conditions, so
that every point on the way is a stable equilibrium that meets them. Source: J. Nocedal, S. Wright, "Numerical
Optimization", 2006, ch. 18 (damped BFGS: procedure 18.2).
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.native.buffers import buffered
from socontrol.programs.nlp.solver import captured

EXACT = 1e-10  # on scaled conditions: goals over the robot's length, forces over those that bend a section by a radian
SETTLED = 1e-8  # last step of Newton, scaled: what is left after it is of the size of its square
STANDING = 1e-3  # smallest eigenvalue of the scaled tangent (1: as stiff as unloaded): below it a posture buckles
FIRST, WIDEST, CLOSED, SHORTEST = 0.1, 0.5, 1e-6, 1e-9  # trust radii of the scaled inputs: first, largest, too small
SMALL, ROUNDING = 1e-11, 1e-8  # expected change of a quantity: not worth a step; not worth another try
MOST = 100  # steps
FARTHEST = 10.0  # step of Newton, scaled
RANK = 1e-9  # of the conditions' derivatives


@dataclass(frozen=True)
class Posed:
    """A posture: x; its scaled tangent dr/dq and dr/dy on the `free` coordinates, and on multipliers of loops after
    them; and, for a step dy, what q moves by, `shift + slopes dy`, and the other rows' values, `rows + tilt dy`. miss:
    largest violation of all conditions."""

    x: np.ndarray
    free: int
    tangent: np.ndarray
    drive: np.ndarray
    shift: np.ndarray
    slopes: np.ndarray
    rows: np.ndarray
    tilt: np.ndarray
    miss: float

    @cached_property
    def smallest(self):
        """Smallest eigenvalue of the tangent (real part where it is not symmetric), of the motions that loops leave:
        above 0 the posture is stable."""
        K, E = self.tangent[: self.free, : self.free], self.tangent[self.free :, : self.free]
        if len(E):
            Z = np.linalg.svd(E)[2][len(E) :].T
            K = Z.T @ K @ Z
        if not K.size:
            return np.inf
        if np.max(np.abs(K - K.T)) <= 1e-9 * np.max(np.abs(K)):
            return float(np.linalg.eigvalsh((K + K.T) / 2)[0])
        return float(np.min(np.linalg.eigvals(K).real))


class Redundancy:
    """The postures of a solved question, `parameters` its targets; `bounds`: (lower, upper) of scaled x, changeable."""

    def __init__(self, solver, parameters):
        posture, self.program = solver.posture, solver.posture.exact.program
        made, balance = posture.exact.functions, _places(self.program.constraints, "equilibrium")[posture.free]
        answers = [ca.densify(e) for e in made["jac_g"](made["nlp"]["x"], made["nlp"]["p"])]
        self._rows = buffered(ca.Function("conditions", [made["nlp"]["x"], made["nlp"]["p"]], answers))
        self.p = self.program.stack_parameters(parameters)
        shape, bearing = (_places(self.program.variables, name) for name in ("q", "lam"))
        pushing = bearing[posture.loops.index] if posture.loops else bearing
        self.coordinates = shape[posture.free]
        self.q = np.concatenate([self.coordinates, pushing])
        self.y = np.setdiff1d(np.arange(self.program.scale.size), np.concatenate([shape, bearing]))
        lower, upper = self.program.limits()
        closing = _places(self.program.constraints, "loops")
        self._balance = np.concatenate([balance, closing])
        every = np.concatenate([_places(self.program.constraints, "equilibrium"), closing])
        self._others = np.setdiff1d(np.arange(lower.size), every)
        self._limits = lower[self._others], upper[self._others]
        self.bounds = self.program.bounds(posture.limits())
        self._qp = _quadratic(self.y.size, self.q.size + self._others.size)

    def posed(self, x):
        """The posture at x, whether or not it meets the conditions; None where the model gives no numbers."""
        g, J = (np.array(a) for a in self._rows(x, self.p))
        J = J.T
        if not np.all(np.isfinite(J)) or not np.all(np.isfinite(g)):
            return None
        E, O, F, Y, g = self._balance, self._others, self.q, self.y, g.ravel()
        K, drive = J[np.ix_(E, F)], J[np.ix_(E, Y)]
        try:
            moved = -np.linalg.solve(K, np.column_stack([g[E], drive]))
        except np.linalg.LinAlgError:
            return None
        shift, slopes = moved[:, 0], moved[:, 1:]
        beyond = np.maximum(self._limits[0] - g[O], g[O] - self._limits[1])
        miss = max(np.max(np.abs(g[E]), initial=0.0), np.max(beyond, initial=0.0))
        rows, tilt = g[O] + J[np.ix_(O, F)] @ shift, J[np.ix_(O, Y)] + J[np.ix_(O, F)] @ slopes
        return Posed(x, self.coordinates.size, K, drive, shift, slopes, rows, tilt, float(miss))

    def within(self, lower=None, upper=None):
        """The same postures under narrower limits (scaled, by index of x)."""
        narrower = copy(self)
        low, high = (bound.copy() for bound in self.bounds)
        for i, value in (lower or {}).items():
            low[i] = min(max(low[i], value), high[i])
        for i, value in (upper or {}).items():
            high[i] = max(min(high[i], value), low[i])
        narrower.bounds = low, high
        return narrower

    def degrees(self, here):
        """Number of independent changes of the free inputs that keep all conditions."""
        free = (self.bounds[1] - self.bounds[0])[self.y] > 0
        held = here.tilt[self._limits[0] == self._limits[1]][:, free]
        values = np.linalg.svd(held, compute_uv=False) if held.size else np.zeros(0)
        return int(free.sum() - np.sum(values > RANK * max(np.max(values, initial=0.0), 1e-300)))

    def settled(self, x):
        """The stable posture near x, by a least change of inputs, that meets all conditions; or None."""
        x = np.clip(x, *self.bounds)
        for _ in range(25):
            here = self.posed(x)
            if here is None:
                return None
            moved = self._back(here)
            if moved is None or not np.max(np.abs(moved - x)) < FARTHEST:
                return None
            step, x = np.max(np.abs(moved - x)), moved
            if step <= SETTLED:
                here = self.posed(x)
                return here if here is not None and here.miss <= EXACT and here.smallest >= STANDING else None
        return None

    def _back(self, here):
        """x after a Newton step to the conditions: at first with the inputs on their limits left there."""
        (lower, upper), equal = self.bounds, self._limits[0] == self._limits[1]
        dy, within = np.zeros(self.y.size), ((here.x > lower) & (here.x < upper))[self.y]
        dy[within] = np.linalg.lstsq(here.tilt[equal][:, within], (self._limits[0] - here.rows)[equal], rcond=RANK)[0]
        moved = self._moved(here, dy)
        rows = here.rows + here.tilt @ dy
        inside = np.all(rows >= self._limits[0] - EXACT) and np.all(rows <= self._limits[1] + EXACT)
        if inside and np.all(moved >= lower) and np.all(moved <= upper):
            return moved
        dy, _ = self._step(here, np.eye(self.y.size), np.zeros(self.y.size), np.inf)
        return None if dy is None else np.clip(self._moved(here, dy), lower, upper)

    def least(self, here, quantity, most=MOST):
        """(posture, whether it was reached): the least `quantity` (Posed) -> (value, gradient in x), downhill from
        `here`. Not reached: steps ran out, or the way on leads where no posture is stable."""
        (value, gradient), radius, H = quantity(here), FIRST, np.eye(self.y.size)
        for _ in range(most):
            g = self._reduced(here, gradient)
            dy, lam = self._step(here, H, g, radius)
            if dy is None or radius < SHORTEST:
                return here, False
            if -(g @ dy) <= SMALL:
                return here, radius > CLOSED
            expected = -(g @ dy + dy @ H @ dy / 2)
            trial = self.settled(self._moved(here, dy))
            found = quantity(trial) if trial is not None else (np.inf, None)
            if not value - found[0] >= 1e-4 * expected:
                if expected <= ROUNDING:
                    return here, radius > CLOSED
                radius = np.max(np.abs(dy)) / 4
                continue
            s = trial.x[self.y] - here.x[self.y]
            change = self._reduced(trial, found[1]) + self._bent(trial, lam) - g - self._bent(here, lam)
            H = _updated(H, s, change)
            if value - found[0] > 0.7 * expected and np.max(np.abs(dy)) > 0.9 * radius:
                radius = min(2 * radius, WIDEST)
            here, (value, gradient) = trial, found
        return here, False

    def _reduced(self, here, gradient):
        """Gradient in y when q follows."""
        return gradient[self.y] + here.slopes.T @ gradient[self.q]

    def _bent(self, here, lam):
        """lam times the derivative of the rows of `_step` in y."""
        return here.slopes.T @ lam[: self.q.size] + here.tilt.T @ lam[self.q.size :]

    def _moved(self, here, dy):
        x = here.x.copy()
        x[self.q] += here.shift + here.slopes @ dy
        x[self.y] += dy
        return x

    def _step(self, here, H, g, radius):
        """(dy, multipliers) of the least g . dy + dy . H dy / 2 within conditions, limits and radius; (None, None)."""
        (lower, upper), x = self.bounds, here.x
        rows = np.concatenate([x[self.q] + here.shift, here.rows])
        low = np.concatenate([lower[self.q], self._limits[0]]) - rows
        high = np.concatenate([upper[self.q], self._limits[1]]) - rows
        found = self._qp(
            h=H, g=g, a=np.vstack([here.slopes, here.tilt]), lba=low, uba=high,
            lbx=np.maximum(lower[self.y] - x[self.y], -radius), ubx=np.minimum(upper[self.y] - x[self.y], radius),
        )  # fmt: skip
        dy = np.array(found["x"]).ravel()
        if not self._qp.stats()["success"] or not np.all(np.isfinite(dy)):
            return None, None
        return dy, np.array(found["lam_a"]).ravel()


def _places(declared, name):
    """Places of a variable or constraint among all; none where it is not declared."""
    where = declared[name].where if name in declared else slice(0, 0)
    return np.arange(where.start, where.stop)


def _quadratic(size, rows):
    """A solver of quadratic programs, tried once so that it has said its greeting."""
    pattern = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
    with captured():
        solver = ca.conic("redundancy", "qpoases", pattern, {"printLevel": "none", "error_on_fail": False})
        solver(h=np.eye(size))
    return solver


def _updated(H, s, change):
    """Damped BFGS update, positive definite whatever the change of gradient."""
    Hs = H @ s
    bend = s @ Hs
    if not bend > 0:
        return H
    theta = 1.0 if s @ change >= 0.2 * bend else 0.8 * bend / (bend - s @ change)
    r = theta * change + (1 - theta) * Hs
    return H - np.outer(Hs, Hs) / bend + np.outer(r, r) / (s @ r)
