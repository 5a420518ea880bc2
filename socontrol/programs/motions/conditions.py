"""Motion under conditions c(q, t) = 0, each with a multiplier: the equation of motion with further rows.

Coordinates are joined by w [k], whose accelerations are the multipliers lam:
    r(q, q', q'', u) + P lam = 0,
    held          A q'' + A' q' - L'' - e lam = 0,        A = dc/dq, L the given part of c = l(q) - L(t)
    let go        lam = 0,
    a spring      s lam = l - L,                          s [m/N] its flexibility
so that the steps of `collocation` serve unchanged. e is far below A M^-1 P and keeps the equations regular. States are
put back onto c = 0 and c' = 0 by elastic shares: light parts, moved the most by masses' shares, would be left to swing.
One-sided conditions (cables: c <= 0 <= lam) are let go where lam turns negative; where c = 0 is met again they catch
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
MET = 1e-12  # of the robot's length: what projection leaves
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


class Constrained(Plant):
    """A plant that moves under conditions: n + k coordinates, of which `held` [k] of the conditions act."""

    def __init__(self, plant, conditions):
        vars(self).update(vars(plant))
        self.conditions, self.k = conditions, len(conditions.names)
        self.n = self.robot.n + self.k
        self.free = np.concatenate([plant.free, np.arange(self.robot.n, self.n)])
        self.moving = plant.free
        self._rows, self._given = Buffered(conditions.function), Sampled(conditions.lengths, order=2)
        self.histories, self.led = [*plant.histories, *conditions.lengths], True
        self.rigid = conditions.flexibility == 0
        self.held, self._lam = np.ones(self.k, dtype=bool), np.zeros(self.k)
        self._by_input = conditions.inputs >= 0
        self._soft = scales(self.robot).q ** 2
        self.sizes = np.ones(self.k)  # of multipliers
        self.sizes[self._by_input] = (np.abs(conditions.gain) * scales(self.robot).u[conditions.inputs])[self._by_input]
        self._extended, self._regular = np.zeros(self.n), np.zeros(self.k)

    def extended(self, x):
        """Coordinates or rates [n + k] with w = 0."""
        return np.concatenate([x, np.zeros(self.k)])

    def rows(self, t, q, qd):
        """Rows at a state [n or n + k]."""
        n = self.robot.n
        l, A, turning = self._rows(q[:n], qd[:n])
        L, rate, second = self._given(t)
        A = A.T.copy()
        return Rows(l[0] - L, A, A @ qd[:n] - rate, turning[0] - second, self.conditions.flexibility * L)

    def driving(self, t, lam):
        """u [m] under multipliers lam."""
        u, own = self.inputs(t).copy(), self._by_input
        u[self.conditions.inputs[own]] = -lam[own] / self.conditions.gain[own]
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
        return np.concatenate([power[0], [motors], wrench[0]])

    def acceleration(self, t, q, qd):
        qdd = super().acceleration(t, q, qd)
        self._lam = qdd[self.robot.n :].copy()
        return qdd

    def inputs_at(self, t, q, qd):
        """u [m] at a state [n + k], with the multipliers of what is held now."""
        return self.driving(t, self.acceleration(t, q, qd)[self.robot.n :])

    def mobility(self, t, q, qd, rows):
        """M^-1 P [n x k] on the coordinates that move, and A M^-1 P [k x k]."""
        n, moving = self.robot.n, self.moving
        M = self._tangents(q[:n], qd[:n], self.driving(t, self._lam), *self.parameters(t))[0].T
        gives = np.zeros((n, self.k))
        gives[moving] = np.linalg.solve(M[np.ix_(moving, moving)], self.pushes(t, q, qd, rows)[moving])
        return gives, rows.A @ gives

    def regularise(self, t, q, qd):
        """Set e from the state at the start."""
        self._regular = REGULAR * np.abs(np.diag(self.mobility(t, q, qd, self.rows(t, q, qd))[1]))

    def project(self, t, q, qd):
        """Put q and qd back onto the rigid conditions that are held."""
        n, own = self.robot.n, np.flatnonzero(self.held & self.rigid)
        if not own.size:
            return
        rows = self.rows(t, q, qd)
        gives = np.zeros((n, own.size))
        gives[self.moving] = (self._soft[:, None] * rows.A[own].T)[self.moving]
        G = rows.A[own] @ gives
        for _ in range(ROUNDS):
            if np.max(np.abs(rows.c[own])) <= MET * self.robot.length:
                break
            q[:n] -= gives @ np.linalg.lstsq(G, rows.c[own], rcond=SINGULAR)[0]
            rows = self.rows(t, q, qd)
        qd[:n] -= gives @ np.linalg.lstsq(G, rows.rate[own], rcond=SINGULAR)[0]

    def met_again(self, t, q, qd, touched=(), instant=0.0):
        """Decide which conditions act from this state on; qd changes where one catches. The work of catching [J].

        touched: conditions known to be met, however nearly; instant [s]: what would be let go for less is held.
        """
        rows, sided, n = self.rows(t, q, qd), self.conditions.one_sided, self.robot.n
        gives, G = self.mobility(t, q, qd, rows)
        near = ~sided | (rows.c >= -TOUCHING * self.robot.length)
        near[list(touched)] = True
        hard, before = np.flatnonzero(near & self.rigid), qd[:n].copy()
        impulse = complementary(G[np.ix_(hard, hard)], rows.rate[hard], sided[hard])
        qd[:n] -= gives[:, hard] @ impulse
        rest = rows.rate - G[:, hard] @ impulse
        self.held = near & ~self.rigid & ((rows.c > 0) | (rest > 0))
        drawn = self._drawn(t, q, qd)
        slow = SLOW * max(np.max(np.abs(rows.rate), initial=0.0), self.robot.length)
        back = (rest >= -slow) | (-2 * rest < instant * drawn)
        own = self._needed(hard[~sided[hard] | back[hard]], G, drawn)
        self.held[own] = True
        qd[:n] -= gives[:, own] @ np.linalg.lstsq(G[np.ix_(own, own)], rest[own], rcond=SINGULAR)[0]
        M = self._tangents(q[:n], qd[:n], self.driving(t, self._lam), *self.parameters(t))[0].T
        return float((qd[:n] - before) @ M @ (qd[:n] + before) / 2)

    def _drawn(self, t, q, qd):
        """c'' [k] with the multipliers of springs alone."""
        qdd, rows = self.acceleration(t, q, qd), self.rows(t, q, qd)
        return rows.A @ qdd[: self.robot.n] + rows.bias

    def _needed(self, staying, G, drawn):
        """Of the rigid conditions that are met and stay so, those to hold: no more than are independent."""
        G, drawn, sided = G[np.ix_(staying, staying)], drawn[staying], self.conditions.one_sided[staying]
        lam = complementary(G, drawn, sided)
        tight = G @ lam - drawn <= 1e-9 * np.max(np.abs(drawn), initial=0.0)
        kept = list(np.flatnonzero(~sided | (lam > 0)))
        for j in np.flatnonzero(tight & sided & (lam <= 0)):
            if np.linalg.matrix_rank(G[np.ix_([*kept, j], [*kept, j])], tol=1e-9 * np.max(np.diag(G))) > len(kept):
                kept.append(j)
        return staying[kept]
