"""Motion under conditions c(q, t) = 0, each with a multiplier: the equation of motion with further rows.

Coordinates are joined by w [k], whose accelerations are the multipliers lam:
    r(q, q', q'', u) + P lam = 0,
    held          A q'' + A' q' - L'' - e lam = 0,        A = dc/dq, L the given part of c = l(q) - L(t)
    let go        lam = 0,
    a spring      s lam = l - L,                          s [m/N] its flexibility
so that the steps of `collocation` serve unchanged. e is far below A M^-1 P and keeps the equations regular. States are
put back onto c = 0 and c' = 0 by elastic shares: light parts, moved the most by masses' shares, would be left to swing.
Lengths of lines come first, combinations of the rows of loops (`ties`), which are held always, after them. One-sided
conditions (cables: c <= 0 <= lam) are let go where lam turns negative; where c = 0 is met again they catch
without rebound. Of conditions that depend on each other no more are held than are independent.
Source: E. Hairer, G. Wanner, 1996, sec. VII.1 (index reduction, projection); C. Glocker, F. Pfeiffer,
"Multibody Dynamics with Unilateral Contacts", 1996 (complementarity of impulses and accelerations).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from socontrol.native.buffers import Buffered
from socontrol.programs.equilibria.complementarity import complementary
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.motions.plant import Plant, Sampled

REGULAR = 1e-13  # e beside A M^-1 P
MET = 1e-15  # of the robot's length: what projection leaves; rounding often leaves more
TOUCHING = 1e-7  # of the robot's length: conditions this near are met
SLOW = 1e-9  # of the rates before a catch, or robot lengths a second: that is no rate
ROUNDS = 4  # of the projection
SINGULAR = 1e-11  # of the largest singular value: conditions that depend on each other


@dataclass(frozen=True)
class Rows:
    """Conditions at one time and state: c [k], A [k x n], c' [k], what A q'' must be to keep c'' = 0, and s [k]."""

    c: np.ndarray
    A: np.ndarray
    rate: np.ndarray
    bias: np.ndarray
    soft: np.ndarray


@dataclass(frozen=True)
class Conditions:
    """c = l(q) - L(t) [k].

    function: (q, q') -> l [k], A [k x n], A' q' [k]; lengths: histories of L; names; one_sided [k]; flexibility [k]:
    strain per N of springs, 0 of what is rigid; inputs [k]: the input that a multiplier is, with `gain` [k] (u = -lam /
    gain), or -1: it acts as A^T lam.
    """

    function: Any
    lengths: tuple
    names: tuple
    one_sided: np.ndarray
    flexibility: np.ndarray
    inputs: np.ndarray
    gain: np.ndarray


_NONE = Conditions(None, (), (), np.zeros(0, dtype=bool), np.zeros(0), np.zeros(0, dtype=int), np.zeros(0))


class Constrained(Plant):
    """A plant that moves under conditions: n + k coordinates, of which `held` [k] of the conditions act.

    conditions: on lengths, or None; ties: those of loops, or None.
    """

    def __init__(self, plant, conditions, ties=None):
        vars(self).update(vars(plant))
        self.ties, self.moving, n = ties, plant.free, self.robot.n
        own = conditions or _NONE
        self.names, self.m = own.names, len(own.names)
        self.k, more = self.m + (ties.k if ties else 0), ties.k if ties else 0
        self.n, self.free = n + self.k, np.concatenate([plant.free, np.arange(n, n + self.k)])
        self._rows = Buffered(own.function) if self.m else None
        self._given = Sampled(own.lengths, order=2)
        self.histories, self.led = [*plant.histories, *own.lengths], plant.led or bool(self.m)
        self._flexibility, self._gain, self._inputs_of = own.flexibility, own.gain, own.inputs
        self.one_sided = np.concatenate([own.one_sided, np.zeros(more, dtype=bool)])
        self.rigid = np.concatenate([own.flexibility == 0, np.ones(more, dtype=bool)])
        self._by_input = np.concatenate([own.inputs >= 0, np.zeros(more, dtype=bool)])
        self.held, self._lam = np.ones(self.k, dtype=bool), np.zeros(self.k)
        self._soft, self._regular = scales(self.robot).q ** 2, np.zeros(self.k)
        self.sizes = np.ones(self.k)  # of multipliers
        by = own.inputs >= 0
        self.sizes[: self.m][by] = np.abs(own.gain[by]) * scales(self.robot).u[own.inputs[by]]
        self._extended = np.zeros(self.n)

    def extended(self, x):
        """Coordinates or rates [n + k] with w = 0."""
        return np.concatenate([x, np.zeros(self.k)])

    def rows(self, t, q, qd):
        """Rows at a state [n or n + k]."""
        n, found = self.robot.n, []
        q, qd = q[:n], qd[:n]
        if self.m:
            l, A, turning = self._rows(q, qd)
            (L, rate, second), A = self._given(t), A.T.copy()
            found.append((l[0] - L, A, A @ qd - rate, turning[0] - second, self._flexibility * L))
        if self.ties:
            found.append(self.ties.rows(q, qd))
        return Rows(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def driving(self, t, lam):
        """u [m] under multipliers lam."""
        u, own = self.inputs(t).copy(), self._inputs_of >= 0
        u[self._inputs_of[own]] = -lam[: self.m][own] / self._gain[own]
        return u

    def residual(self, t, q, qd, qdd):
        n, lam = self.robot.n, qdd[self.robot.n :]
        r, rows = self._extended, self.rows(t, q, qd)
        r[:n] = self._residual(q[:n], qd[:n], qdd[:n], self.driving(t, lam), *self.parameters(t))[0][0]
        r[:n] += rows.A[~self._by_input].T @ lam[~self._by_input]
        hard = rows.A @ qdd[:n] + rows.bias - self._regular * lam
        law = np.where(self.rigid, hard, rows.soft * lam - rows.c)
        r[n:] = np.where(self.held, law, lam)
        self._lam = lam.copy()
        return r

    def tangents(self, t, q, qd):
        n, rows = self.robot.n, self.rows(t, q, qd)
        q, qd = q[:n], qd[:n]
        M, K, D = (x.T for x in self._tangents(q, qd, self.driving(t, self._lam), *self.parameters(t)))
        P, corner = self.pushes(t, q, qd, rows), np.diag(np.where(self.rigid, -self._regular, rows.soft))
        hard, soft = self.held & self.rigid, self.held & ~self.rigid
        corner[~self.held] = np.eye(self.k)[~self.held]
        Ms = np.block([[M, P], [np.where(hard[:, None], rows.A, 0.0), corner]])
        Ks, Ds = np.zeros((self.n, self.n)), np.zeros((self.n, self.n))
        Ks[:n, :n], Ds[:n, :n], Ks[n:, :n] = K, D, np.where(soft[:, None], -rows.A, 0.0)
        if self.ties:
            Ks[:n, :n] += self.ties.turning(q, self._lam[self.m :])
        return Ms, Ks, Ds

    def pushes(self, t, q, qd, rows):
        """P [n x k]: what multipliers add to the residual."""
        n, P, still = self.robot.n, rows.A.T.copy(), np.zeros(self.robot.n)
        none, parameters = np.zeros(self.k), self.parameters(t)
        base = self._residual(q[:n], qd[:n], still, self.driving(t, none), *parameters)[0][0].copy()
        for j in np.flatnonzero(self._by_input):
            one = none.copy()
            one[j] = 1.0
            P[:, j] = self._residual(q[:n], qd[:n], still, self.driving(t, one), *parameters)[0][0] - base
        return P

    def power(self, t, q, qd, qdd, r):
        n, u = self.robot.n, self.driving(t, qdd[self.robot.n :])
        power, wrench = self._power(q[:n], qd[:n], u, *self.parameters(t))
        motors = r[self.driven] @ qd[self.driven] if self.driven.size else 0.0
        if self.driven.size and self.ties:  # loops do no work: near dead points their forces would bring rounding alone
            motors = r[:n] @ qd[:n] - qdd[n + self.m :] @ self.ties.rows(q[:n], qd[:n])[2]
        return np.concatenate([power[0], [motors], wrench[0]])

    def acceleration(self, t, q, qd):
        qdd = super().acceleration(t, q, qd)
        self._lam = qdd[self.robot.n :].copy()
        return qdd

    def forces(self, t, q, qd):
        """u, forces of motors and lam of loops (the least) at a state [n + k], with what is held now."""
        qdd, n = self.acceleration(t, q, qd), self.robot.n
        lam, motors = qdd[n:], self.residual(t, q, qd, qdd)[self.driven]
        if not self.ties:
            return self.driving(t, lam), motors, lam[:0]
        lam, change = self.ties.least(q[:n], lam[self.m :])
        return self.driving(t, qdd[n:]), motors + change[self.driven], lam

    def mobility(self, t, q, qd, rows):
        """How rates of the coordinates answer to impulses of lengths, loops held [n x m], and their slopes [m x m]."""
        n, moving, m = self.robot.n, self.moving, self.m
        M = self._tangents(q[:n], qd[:n], self.driving(t, self._lam), *self.parameters(t))[0].T
        system, A = M[np.ix_(moving, moving)], rows.A[m:][self.held[m:]][:, moving]
        if A.size:
            system = np.block([[system, A.T], [A, -np.diag(self._regular[m:][self.held[m:]])]])
        pushes, gives = self.pushes(t, q, qd, rows)[moving, :m], np.zeros((n, m))
        pushes = np.concatenate([pushes, np.zeros((A.shape[0], m))])
        gives[moving] = np.linalg.solve(system, pushes)[: moving.size]
        return gives, rows.A[:m] @ gives

    def regularise(self, t, q, qd):
        """Set e, and which combinations of the loops' rows act, from the state at the start."""
        n, moving = self.robot.n, self.moving
        if self.ties:
            self.choose(t, q)
            M = self._tangents(q[:n], qd[:n], self.driving(t, self._lam), *self.parameters(t))[0].T
            A = self.rows(t, q, qd).A[self.m :, moving]
            size = np.sum(A**2) / max(np.trace(M[np.ix_(moving, moving)]), 1e-300)
            self._regular[self.m :] = REGULAR * size
        self._regular[: self.m] = REGULAR * np.abs(np.diag(self.mobility(t, q, qd, self.rows(t, q, qd))[1]))

    def choose(self, t, q):
        """Whether other combinations of the loops' rows act from q on, since those before no longer hold all."""
        if not self.ties or not self.ties.choose(t, q[: self.robot.n]):
            return False
        self.held[self.m :], self._lam[self.m :] = np.arange(self.ties.k) < self.ties.rank, 0.0
        return True

    def project(self, t, q, qd):
        """Put q and qd back onto the rigid conditions that are held."""
        n, own = self.robot.n, np.flatnonzero(self.held & self.rigid)
        if not own.size:
            return
        rows = self.rows(t, q, qd)
        gives = np.zeros((n, own.size))
        gives[self.moving] = (self._soft[:, None] * rows.A[own].T)[self.moving]
        G = rows.A[own] @ gives
        before = np.inf
        for _ in range(ROUNDS):
            left = np.max(np.abs(rows.c[own]))
            if left <= MET * self.robot.length or left > before / 2:
                break
            before = left
            q[:n] -= gives @ np.linalg.lstsq(G, rows.c[own], rcond=SINGULAR)[0]
            rows = self.rows(t, q, qd)
        qd[:n] -= gives @ np.linalg.lstsq(G, rows.rate[own], rcond=SINGULAR)[0]

    def met_again(self, t, q, qd, touched=(), instant=0.0):
        """Decide which lengths act from this state on; qd changes where one catches. The work of catching [J].

        touched: conditions known to be met, however nearly; instant [s]: what would be let go for less is held.
        """
        m, n = self.m, self.robot.n
        if not m:
            return 0.0
        rows, sided, rigid = self.rows(t, q, qd), self.one_sided[:m], self.rigid[:m]
        gives, G = self.mobility(t, q, qd, rows)
        near = ~sided | (rows.c[:m] >= -TOUCHING * self.robot.length)
        near[list(touched)] = True
        hard, before = np.flatnonzero(near & rigid), qd[:n].copy()
        impulse = complementary(G[np.ix_(hard, hard)], rows.rate[hard], sided[hard])
        qd[:n] -= gives[:, hard] @ impulse
        rest = rows.rate[:m] - G[:, hard] @ impulse
        self.held[:m] = near & ~rigid & ((rows.c[:m] > 0) | (rest > 0))
        drawn = self._drawn(t, q, qd)
        slow = SLOW * max(np.max(np.abs(rows.rate[:m]), initial=0.0), self.robot.length)
        back = (rest >= -slow) | (-2 * rest < instant * drawn)
        own = self._needed(hard[~sided[hard] | back[hard]], G, drawn)
        self.held[own] = True
        qd[:n] -= gives[:, own] @ np.linalg.lstsq(G[np.ix_(own, own)], rest[own], rcond=SINGULAR)[0]
        M = self._tangents(q[:n], qd[:n], self.driving(t, self._lam), *self.parameters(t))[0].T
        return float((qd[:n] - before) @ M @ (qd[:n] + before) / 2)

    def _drawn(self, t, q, qd):
        """c'' [m] of lengths with the multipliers of springs and loops alone."""
        qdd, rows = self.acceleration(t, q, qd), self.rows(t, q, qd)
        return (rows.A @ qdd[: self.robot.n] + rows.bias)[: self.m]

    def _needed(self, staying, G, drawn):
        """Of the rigid conditions that are met and stay so, those to hold: no more than are independent."""
        G, drawn, sided = G[np.ix_(staying, staying)], drawn[staying], self.one_sided[staying]
        lam = complementary(G, drawn, sided)
        tight = G @ lam - drawn <= 1e-9 * np.max(np.abs(drawn), initial=0.0)
        kept = list(np.flatnonzero(~sided | (lam > 0)))
        for j in np.flatnonzero(tight & sided & (lam <= 0)):
            if np.linalg.matrix_rank(G[np.ix_([*kept, j], [*kept, j])], tol=1e-9 * np.max(np.diag(G))) > len(kept):
                kept.append(j)
        return staying[kept]
