"""How a HeldBalance finds the shape and the inputs that hold lengths.

Multipliers lam [N], the tensions along the lines, enter as springs, lam = max(0, before + (l - L) / delta): the
augmented Lagrangian, whose inner equilibria the plain solver finds. Lengths far from those at rest are reached in
steps. Newton's method on q and lam together polishes, with the multipliers of loops where there are any; where lengths
depend on each other, or on loops, the least inputs are taken.
Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, sec. 17.4.
"""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.programs.equilibria.balance import LONGEST, Equilibrium
from socontrol.programs.equilibria.closing import CLOSED, Assembly
from socontrol.programs.equilibria.complementarity import least
from socontrol.programs.result import Status
from socontrol.quantities import joined

STIFFEST = 1e-6  # scaled compliance of the springs at last
SLOW = 0.2  # of the violation before: more that is left asks for stiffer springs
ROUNDS, POLISHING = 20, 8  # of the multipliers; of Newton's method after each
CLOSE = 1e-6  # scaled residual from which it must fall
MET = 1e-9  # violation that counts as none, of a cable's length
SHORTEST = 1 / 256  # step of the way from the lengths at rest to those given
MOST, CLOSING = 5, 10  # times the solver's iterations on that way; the same where loops are closed, too


@dataclass(frozen=True)
class HeldEquilibrium(Equilibrium):
    """Equilibrium, with u [m] all inputs.

    redundant: whether other inputs would hold the same posture; steepest: the largest change of an input over its size
    for a change of a length (index of that input among those held) by a metre, (place, change); lam [k]: multipliers
    of the loops, the least, None without loops.
    """

    u: np.ndarray = None
    lam: np.ndarray = None
    redundant: bool = False
    steepest: tuple = (0, 0.0)


@dataclass(frozen=True)
class _State:
    """q [n], multipliers lam [k] in N, iterations so far, whether the lengths are met, and the violation [k] in m;
    loops: multipliers of the loops."""

    q: np.ndarray
    lam: np.ndarray
    count: int
    met: bool
    missed: np.ndarray
    loops: np.ndarray


class HeldWay:
    """One call of `HeldBalance.solve`."""

    def __init__(self, balance, u, p, prescribed, free, limit):
        self.balance, self.held = balance, balance.at_lengths
        self.u, self.p, self.prescribed, self.free, self.limit = u, p, prescribed, free, limit
        self.closed = Assembly(balance, free, p) if balance.robot.loops else None

    def solve(self, q0):
        held, start = self.held, self._start(q0)
        if self.closed:
            with np.errstate(all="ignore"):
                start, error = self.closed.assembled(start)
            if error > CLOSED:
                return self._open(start)
            q0 = start
        guess = -self.u[held.index] * held.gain
        guess = np.where(held.pulls, np.maximum(guess, 0.0), guess)
        state = self._met(self._state(start if np.any(guess) else self._slack(q0), guess, 0, held.length))
        if not state.met:
            state = self._steps(self._state(self._slack(q0), np.zeros(guess.size), state.count, held.length))
        u, more = self._least(state) if state.met else (self._inputs(state.lam), {})
        residual, lam = self._left(state.q, u)
        return HeldEquilibrium(state.q, residual, state.count, self._status(state, residual), u, lam, **more)

    def _left(self, q, u):
        """Unbalanced force [n] at q and u, and the least multipliers of the loops, None without loops."""
        balance, lam = self.balance, None
        if self.closed:
            lam = balance.multipliers(q, u, self.free, self.p)
            residual = balance.unbalanced(q, u, lam, self.p)[0]
        else:
            residual = np.array(balance.evaluate(q, u, self.p)[0])
        residual[~self.free] = 0.0
        return residual, lam

    def _open(self, q):
        """The answer where loops do not close; q is the nearest shape."""
        residual, lam = self._left(q, self.u)
        return HeldEquilibrium(q, residual, self.closed.count, self.closed.told(q), self.u, lam)

    def _slack(self, q0):
        """Coordinates at rest with the held inputs at 0: where the way begins; q0 where there is no such rest."""
        u = self.u.copy()
        u[self.held.index] = 0.0
        rest = self.balance.at_inputs(u, q0, self.p, self.prescribed, self.limit)
        return rest.q if rest.status.solved else self._start(q0)

    def _start(self, q0):
        """q0 (default: 0) with the prescribed coordinates in place."""
        q = np.zeros(self.balance.robot.n) if q0 is None else np.array(q0, dtype=float)
        for i, value in (self.prescribed or {}).items():
            q[i] = value
        return q

    def _state(self, q, lam, count, lengths, met=False, loops=None):
        """State with what each line is longer than it should be under its tension."""
        held = self.held
        over = self.balance.routes(q)[0][held.index] - lengths * (1 + held.flexibility * lam)
        missed = np.where(held.pulls, np.maximum(over, 0.0), over)
        return _State(q, lam, count, met, missed, np.zeros(0) if loops is None else loops)

    def _met(self, state):
        """The state with the given lengths met by rounds of multipliers and Newton's method, or as far as they come."""
        sprung, held = self.balance.sprung(self.held.length, state.lam), self.held
        for _ in range(ROUNDS):
            before = np.max(np.abs(state.missed) / self.balance.travel)
            state = self._round(sprung, state)
            if state is None:
                return self._state(sprung.q, sprung.before, sprung.count, held.length)
            polished = self._polished(state)
            if polished.met:
                return polished
            if np.max(np.abs(state.missed) / self.balance.travel) > SLOW * before:
                sprung.delta /= 10
                if sprung.delta < STIFFEST:
                    break
        return state

    def _round(self, sprung, state, beside=False):
        """The state after an equilibrium on springs, which gives the next multipliers; None where there is none.
        beside: one near the state, found with less effort."""
        sprung.q, sprung.before, sprung.count = state.q, state.lam, state.count
        limit = 0 if beside and self.closed else self.limit
        answer = sprung.solve(self.u, state.q, self.p, self.prescribed, limit)
        sprung.count += answer.iterations
        if not answer.status.solved:
            return None
        loops = getattr(answer, "lam", None)
        return self._state(answer.q, sprung.lam(answer.q)[0], sprung.count, sprung.lengths, loops=loops)

    def _steps(self, state):
        """From the lengths at the beginning to those given, in steps that are met as far as soft springs do."""
        held = self.held
        first = self.balance.routes(state.q)[0][held.index].copy()
        first = np.where(held.pulls, np.maximum(first, held.length), first)
        t, step, count = 0.0, 0.25, state.count
        most = count + (CLOSING if self.closed else MOST) * self.limit
        while t < 1.0 and step >= SHORTEST and count < most:
            target = min(1.0, t + step)
            sprung = self.balance.sprung(first + target * (held.length - first), state.lam)
            trial = self._round(sprung, replace(state, count=count), beside=True)
            trial = trial and self._round(sprung, trial, beside=True)
            count = sprung.count
            if trial is None:
                step /= 2
            else:
                state, t, step = trial, target, step * 2
        state = self._state(state.q, state.lam, count, held.length)
        return self._met(state) if t >= 1.0 else state

    def _polished(self, state):
        """Newton's method on q, the multipliers that act and those of loops; met where all conditions hold."""
        balance, held, s, free = self.balance, self.held, self.balance.scales, self.free
        q, lam, loops, best = state.q.copy(), state.lam.copy(), state.loops.copy(), np.inf
        for _ in range(POLISHING):
            over = balance.routes(q)[0][held.index] - held.length * (1 + held.flexibility * lam)
            acts = ~held.pulls | (lam / balance.pull + over / balance.travel > 0)
            lam = np.where(acts, lam, 0.0)
            left, system = self._system(q, lam, acts, loops)
            size = np.max(np.abs(left), initial=0.0)
            if not np.isfinite(size) or (size < CLOSE and size >= best):
                break
            best, kept = size, (q.copy(), lam.copy(), loops.copy())
            step = np.linalg.lstsq(system, -left, rcond=1e-11)[0]
            moved, pulled, pushed = np.split(step, np.cumsum([free.sum(), acts.sum()]))
            if np.max(np.abs(moved), initial=0.0) > LONGEST:
                break
            q[free] += moved * s.q[free]
            lam[acts] += pulled * balance.pull[acts]
            if self.closed:
                loops += pushed * s.energy / balance.reach
        if not best < np.inf:
            return state
        found = self._state(*kept[:2], state.count, held.length, loops=kept[2])
        pulled = np.where(held.pulls, found.lam, 0.0)
        met = best <= 1e-9 and np.all(pulled >= -1e-9 * balance.pull) and np.all(np.abs(found.missed) <= self._allowed)
        lam = np.where(held.pulls, np.maximum(found.lam, 0.0), found.lam)
        return replace(found, lam=lam, met=bool(met))

    @property
    def _allowed(self):
        """Violation [k] in m that counts as none."""
        return MET * np.maximum(self.held.length, self.balance.robot.length)

    def _system(self, q, lam, acts, loops):
        """Scaled residual with the rows of lengths that act and of loops, and its tangent."""
        balance, held, s, free = self.balance, self.held, self.balance.scales, self.free
        l, A = balance.routes(q)
        r, K, B = balance.evaluate(q, self._inputs(lam), self.p)
        own, travel, pull = held.index[acts], balance.travel[acts], balance.pull[acts]
        soft = (held.flexibility * held.length)[acts]
        rows = (l[own] - held.length[acts] - soft * lam[acts]) / travel
        A = A[own][:, free] * s.q[free] / travel[:, None]
        push = (B[:, own] / held.gain[acts] * pull)[free] / s.force[free][:, None]
        soft = np.diag(soft * pull / travel)
        if self.closed:  # rows and multipliers of loops stand after those of lengths
            e, E, S = balance.closing(q, loops, self.p)
            r, K, rows = r - E.T @ loops, K - S, np.concatenate([rows, e / balance.reach])
            slopes = E[:, free] * s.q[free] / balance.reach[:, None]
            A, push = np.vstack([A, slopes]), np.hstack([push, -slopes.T])
            soft = np.pad(soft, (0, e.size))
        K = K[np.ix_(free, free)] * s.q[free] / s.force[free][:, None]
        return np.concatenate([r[free] / s.force[free], rows]), np.block([[K, push], [A, -soft]])

    def _inputs(self, lam):
        u = self.u.copy()
        u[self.held.index] = -lam / self.held.gain
        return u

    def _least(self, state):
        """Inputs [m] at the posture found, the least that hold it, and what else there is to say of them."""
        held, s, free, u = self.held, self.balance.scales, self.free, self._inputs(state.lam)
        over = self.balance.routes(state.q)[0][held.index] - held.length
        taut = (held.flexibility == 0) & (~held.pulls | (over >= -self._allowed))
        own = held.index[taut]
        push = self.balance.evaluate(state.q, u, self.p)[2][free][:, own] * s.u[own] / s.force[free][:, None]
        if self.closed:  # what loops bear is no matter
            split = self.balance.split(state.q, free, self.p)
            push = split.left.T @ push
        values, rows = np.linalg.svd(push)[1:]
        rank = int(np.sum(values > 1e-9 * np.max(values, initial=0.0)))
        if rank == own.size:
            return u, {"steepest": self._steepest(state)}
        u[own] = s.u[own] * least(u[own] / s.u[own], rows[rank:].T, held.pulls[taut])
        return u, {"redundant": True}

    def _steepest(self, state):
        """(place, change per metre) of the length that changes an input, over its size, the most."""
        held, balance = self.held, self.balance
        acts = np.flatnonzero(~held.pulls | (state.lam > 0))
        if not acts.size:
            return 0, 0.0
        system = self._system(state.q, state.lam, acts, state.loops)[1]
        own = slice(self.free.sum(), self.free.sum() + acts.size)
        inverse = np.linalg.pinv(system, rcond=1e-13)[own, own]
        size = np.abs(held.gain[acts]) * balance.scales.u[held.index[acts]]
        changes = np.abs(inverse * (balance.pull[acts] / size)[:, None] / balance.travel[acts])
        worst = int(np.argmax(np.max(changes, axis=0)))
        return int(acts[worst]), float(np.max(changes))

    def _status(self, state, residual):
        held = self.held
        if state.met and np.max(np.abs(residual / self.balance.scales.force), initial=0.0) <= 1e-9:
            return Status("solved", "In equilibrium, loops closed." if self.closed else "In equilibrium.")
        if not np.all(np.isfinite(residual)):
            fix = "ask for lengths nearer to those at rest"
            return Status("numerical", f"The model gave NaN or infinity on the way; {fix}.")
        missed = np.flatnonzero(np.abs(state.missed) > self._allowed)
        if not missed.size:
            return Status("numerical", "The lengths are met, the forces do not balance; start from a guess.")
        names = joined([held.names[k] for k in missed], "and")
        wanted, found = (joined([f"{1e3 * x:.7g}" for x in rows[missed]], "and")
                         for rows in (held.length, held.length + state.missed))  # fmt: skip
        kind = "shortest" if np.all(state.missed[missed] > 0) else "nearest"
        stiff = ", or the cables a `stiffness`" if np.any(held.pulls[missed]) else ""
        nearest = f"the {kind} found {'is' if missed.size == 1 else 'together are'} {found} mm"
        return Status("infeasible", f"No posture holds {names} at {wanted} mm: {nearest}. Give other lengths{stiff}.")
