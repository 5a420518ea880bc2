"""Forward statics of robots with loops: the closed shape that balances inputs and loads, and what the loops bear.

    r(q, u) - E^T lam = 0,    e(q) = 0,    E = de/dq.
Loops are closed first (`closing`). Newton's method on q and lam follows, on as many combinations of rows as E has rank
there, since rows may depend on each other; at the rest found the rank is looked at again, and chosen again where it
differs. Where that fails, or ends at an unstable rest, the robot comes to rest as one that is damped and has no mass:
implicit Euler steps with growing time steps on the motions Z that E leaves, with the tangent K - sum lam_i d2e_i, each
put back onto e = 0. Rank and Z follow from the singular values of E, those of rows in metres over the robot's length;
lam is the least. Where no rest is found so either, the force is let in gradually.
Source: C. Kelley, D. Keyes, SIAM J. Numer. Anal. 35 (1998), pseudo-transient continuation.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.mechanics.loops import independent, reach, slices, units_of
from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.balance import LONGEST, TOLERANCE, Balance, Equilibrium, newton_step
from socontrol.programs.equilibria.closing import CLOSED, Assembly
from socontrol.programs.result import Status

PUTTING_BACK = 12  # iterations of closing after a step
SHARE = 5  # by which a good step shortens the damping
RESTING, BRIEFLY = 300, 60  # steps to come to rest; the same after a load step
NEWTON, HALVINGS = 25, 6  # steps of Newton's method, and of each how often it is halved
SMALLEST_STEP = 1e-3  # of the load parameter


@dataclass(frozen=True)
class ClosedEquilibrium(Equilibrium):
    """Equilibrium with the multipliers lam [k] of the loops in N and N m, the least where rows depend on each other."""

    lam: np.ndarray = None


@dataclass(frozen=True)
class _Point:
    """A closed shape q, with lam [k] and, scaled: Z [f x d], force g [d] and tangent H [d x d] on it."""

    q: np.ndarray
    lam: np.ndarray
    Z: np.ndarray
    g: np.ndarray
    H: np.ndarray

    @property
    def finite(self):
        return bool(np.all(np.isfinite(self.g)) and np.all(np.isfinite(self.H)))

    @property
    def left(self):
        """Largest scaled force."""
        return np.max(np.abs(self.g), initial=0.0)

    @property
    def stands(self):
        """Whether it is a stable or marginal rest."""
        return self.H.size == 0 or bool(np.min(np.linalg.eigvals(self.H).real) > -1e-9)


class ClosedBalance(Balance):
    """A Balance that keeps loops closed."""

    def __init__(self, robot, parameters=(), scaling=None):
        super().__init__(robot, parameters, scaling)
        functions = robot.functions(parameters)
        self._rows, self._slopes = buffered(functions.closing), buffered(functions.loop_rows)
        self.units = units_of(robot.loops)
        self.reach = reach(self.units, robot.length)

    def closing(self, q, lam=None, p=None):
        """e [k], E [k x n] and d(E^T lam)/dq [n x n]; the arrays are reused by the next call."""
        self._rows.inputs[0][:] = q
        self._rows.inputs[1][:] = 0.0 if lam is None else lam
        if self.parameters:
            self._rows.inputs[2][:] = self.defaults if p is None else p
        self._rows.run()
        (e,), E, S = self._rows.outputs
        return e, E.T, S.T

    def rows(self, q, p=None):
        """e [k] and E [k x n]; the arrays are reused by the next call."""
        self._slopes.inputs[0][:] = q
        if self.parameters:
            self._slopes.inputs[1][:] = self.defaults if p is None else p
        self._slopes.run()
        (e,), E = self._slopes.outputs
        return e, E.T

    def split(self, q, free, p=None):
        """Split of E on the free coordinates over their scales."""
        E = self.rows(q, p)[1][:, free] * self.scales.q[free]
        return independent(E, self.units, self.robot.length)

    def multipliers(self, q, u, free, p=None):
        """The least lam [k] that balance q and u best."""
        r = self.evaluate(q, u, p)[0][free] / self.scales.force[free]
        return self.least(self.split(q, free, p), r)

    def least(self, split, r):
        """The least lam [k] that bear what a Split holds of a scaled force r [f]."""
        return split.least(r) * self.scales.energy / self.reach

    def unbalanced(self, q, u, lam, p=None):
        """Residual r - E^T lam [n] and its tangent [n x n]."""
        r, K, _ = self.evaluate(q, u, p)
        _, E, S = self.closing(q, lam, p)
        return r - E.T @ lam, K - S

    def held(self, q, free):
        """What holds: slopes [rank x n] and columns [n x rank] for `stability`."""
        held = self.split(q, free).held
        slopes, columns = np.zeros((len(held), free.size)), np.zeros((free.size, len(held)))
        slopes[:, free], columns[free] = held / self.scales.q[free], (held * self.scales.force[free]).T
        return slopes, columns

    def redundant(self, q, free):
        """{loop: how many of its rows hold nothing that the rows before them do not hold}, of those that have any."""
        E, found, before = self.rows(q)[1][:, free] * self.scales.q[free], {}, 0
        for name, own in slices(self.robot.loops).items():
            rank = independent(E[: own.stop], self.units[: own.stop], self.robot.length).rank
            extra = own.stop - own.start - (rank - before)
            before = rank
            if extra:
                found[name] = extra
        return found

    def solve(self, u, q0=None, p=None, prescribed=None, max_iterations=200, settle=True):
        """Equilibrium at inputs u from q0 (default: 0); `prescribed` {index: value} locks coordinates.

        Without `settle` the one that Newton's method alone finds, stable or not.
        """
        q, free = self.started(q0, prescribed)
        return _Way(self, np.asarray(u, dtype=float), p, free, max_iterations).solve(q, settle)

    def rest_beside(self, u, q, prescribed=None, p=None):
        """As `solve`, from a closed shape q and with less effort: without load steps."""
        free = ~np.isin(np.arange(self.robot.n), list(prescribed or {}))
        return _Way(self, np.asarray(u, dtype=float), p, free, 0).solve(q)


class _Way:
    """One call of `ClosedBalance.solve`."""

    def __init__(self, balance, u, p, free, limit):
        self.balance, self.u, self.p, self.free, self.limit = balance, u, p, free, limit
        self.size, self.force = balance.scales.q[free], balance.scales.force[free]
        self.both, self.scale = np.ix_(free, free), self.size / self.force[:, None]
        self.assembly, self.steps = Assembly(balance, free, p), 0

    def solve(self, q, settle=True):
        with np.errstate(all="ignore"):
            start, error = self.assembly.assembled(q)
            if error > CLOSED:
                return self._ended(start, np.zeros(self.balance.reach.size), self.assembly.told(start))
            point, reached = self._newton(start)
            if settle and not (reached and point.stands):
                rest, settled = self._rest(start, None, RESTING if self.limit else 2 * BRIEFLY)
                point, reached = (rest, True) if settled else (point, reached)
            if settle and not reached:
                point, reached = self._load_steps(start)
        return self._ended(point.q, point.lam, None, reached)

    def _ended(self, q, lam, status, reached=False):
        residual = self.balance.unbalanced(q, self.u, lam, self.p)[0]
        residual[~self.free] = 0.0
        count, status = self.steps + self.assembly.count, status or self._status(residual, reached)
        return ClosedEquilibrium(q, residual, count, status, lam)

    def _point(self, q, offset=None):
        """The closed shape q with what pushes it, less `offset` [n]."""
        balance, free = self.balance, self.free
        split = balance.split(q, free, self.p)
        r, K, _ = balance.evaluate(q, self.u, self.p)
        r = (r - (0.0 if offset is None else offset))[free] / self.force
        lam = balance.least(split, r)
        tangent = (K - balance.closing(q, lam, self.p)[2])[self.both] * self.scale
        Z = split.left
        return _Point(q, lam, Z, Z.T @ r, Z.T @ tangent @ Z)

    def _newton(self, q):
        """(point, whether at rest) after steps of Newton's method on q and the multipliers, from a closed q."""
        balance, split = self.balance, self.balance.split(q, self.free, self.p)
        for _ in range(2):  # with the rank found at the start, and that found at the rest
            r = balance.evaluate(q, self.u, self.p)[0][self.free] / self.force
            x = _Iterate(self, q, split.held @ r / split.s, split.U.T / balance.reach).nearest()
            if not x.largest <= 1e-9:
                break
            q, before, split = x.q, split.rank, balance.split(x.q, self.free, self.p)
            if split.rank == before:
                Z, (r, tangent) = split.left, x.forces
                return _Point(q, balance.least(split, r), Z, Z.T @ r, Z.T @ tangent @ Z), x.apart <= CLOSED
        return self._point(q), False

    def _rest(self, q, offset, limit):
        """(point, whether at rest) after damped steps from a closed q."""
        x, rate = self._point(q, offset), 1.0
        for _ in range(limit):
            if not x.finite or x.left <= TOLERANCE:
                return x, x.finite
            self.steps += 1
            shift = rate + max(0.0, -1.5 * np.linalg.eigvalsh((x.H + x.H.T) / 2)[0])
            step = -x.Z @ np.linalg.solve(x.H + shift * np.eye(x.g.size), x.g)
            longest = np.max(np.abs(step))
            step *= min(1.0, LONGEST / 2 / longest)
            trial = q.copy()
            trial[self.free] = x.q[self.free] + step * self.size
            trial, error = self.assembly.closed(trial, PUTTING_BACK)
            y = self._point(trial, offset) if error <= CLOSED else None
            if y and y.finite and step @ (y.Z @ y.g) <= 0.5 * abs(step @ (x.Z @ x.g)):  # not far beyond the rest
                x, rate = y, rate / SHARE
                if longest <= 4e-16 * (1 + np.max(np.abs(x.q[self.free] / self.size))):
                    break
            elif x.left <= 1e-10 or (rate := max(4 * rate, 1e-3)) > 1e8:
                break
        return x, x.finite and x.left <= 1e-9

    def _load_steps(self, q):
        """From q, held by what it lacks, to rest, that force taken away in steps."""
        start = np.array(self.balance.evaluate(q, self.u, self.p)[0])
        point, t, step = self._point(q, start), 0.0, 0.25
        while t < 1.0 and step >= SMALLEST_STEP and self.steps < 20 * self.limit:
            target = min(1.0, t + step)
            trial, reached = self._rest(point.q, (1 - target) * start, BRIEFLY)
            if reached:
                point, t, step = trial, target, step * 2
            else:
                step /= 2
        return point, t >= 1.0

    def _status(self, residual, reached):
        if reached:
            return Status("solved", "In equilibrium, loops closed.")
        if not np.all(np.isfinite(residual)):
            return Status("numerical", "The model gave NaN or infinity on the way; lower loads or inputs.")
        sentence = "The loops close, but no rest was found: inputs or loads may drive the robot round and round, or it"
        return Status("infeasible", f"{sentence} buckles on the way; lower them, or start from a guess.")


class _Iterate:
    """q and multipliers mu of combinations of the rows [rank x k], with their scaled residual and tangent.

    forces: scaled r [f] and d(r - E^T lam)/dq [f x f]; apart: largest scaled error of all rows.
    """

    def __init__(self, way, q, mu, rows):
        self.way, self.q, self.mu, self.rows = way, q, mu, rows
        balance, free, f = way.balance, way.free, way.size.size
        r, K, _ = balance.evaluate(q, way.u, way.p)
        e, E, S = balance.closing(q, (mu @ rows) * balance.scales.energy, way.p)
        slopes, tangent = rows @ E[:, free] * way.size, np.zeros((f + mu.size, f + mu.size))
        tangent[:f, :f] = (K - S)[way.both] * way.scale
        tangent[:f, f:], tangent[f:, :f] = -slopes.T, slopes
        self.forces, self.tangent = (r[free] / way.force, tangent[:f, :f]), tangent
        self.apart = np.max(np.abs(e / balance.reach))
        self.left = np.concatenate([self.forces[0] - mu @ slopes, rows @ e])
        self.merit, self.largest = float(self.left @ self.left), np.max(np.abs(self.left), initial=0.0)

    def nearest(self):
        """The iterate that steps end at: at rest, or where none comes nearer."""
        x = self
        for _ in range(NEWTON):
            if x.largest <= TOLERANCE or not np.isfinite(x.merit):
                break
            self.way.steps += 1
            y = x._next()
            if y is None:
                break
            x = y
        return x

    def _next(self):
        """The iterate after the longest of 1, 1/2, 1/4 ... steps that comes nearer; None where none does."""
        way, f = self.way, self.way.size.size
        step = newton_step(self.tangent, self.left)
        step *= min(1.0, LONGEST / max(np.max(np.abs(step[:f]), initial=0.0), 1e-300))
        for halving in range(HALVINGS):
            part, q = 0.5**halving, self.q.copy()
            q[way.free] += part * step[:f] * way.size
            found = _Iterate(way, q, self.mu + part * step[f:], self.rows)
            if found.merit < self.merit * (1 - 1e-4 * part):
                return found
        return None
