"""Implicit Runge-Kutta steps by collocation for r(t, q, qd, qdd) = 0: Radau IIA for stiff robots, Gauss for energies.

With accelerations a_i at the nodes c_i of a step h,  qd_i = v + h A a,  q_i = q + h c v + h^2 A^2 a  and r = 0 at each
node. Newton's matrix M + h A D + h^2 A^2 K is split by the eigenvalues of A into one matrix [n x n] each.
Radau IIA with three nodes: order 5, L-stable, error estimate of order 3. Gauss with s nodes: order 2 s, symplectic.
Source: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, secs. IV.5 and IV.8.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

NEWTON = 0.01  # of the tolerance: what is left of the equations of a step
ITERATIONS = 12


@dataclass(frozen=True)
class Tableau:
    """Nodes c [s], A [s x s] = W diag(values) W^-1, its square, and the polynomials int l_j (rows, rising powers)."""

    c: np.ndarray
    A: np.ndarray
    AA: np.ndarray
    integrals: np.ndarray
    W: np.ndarray
    W_inverse: np.ndarray
    values: np.ndarray

    def weights(self, x):
        """int_0^x l_j [s] of the Lagrange polynomials of the nodes."""
        return self.integrals @ x ** np.arange(1, self.c.size + 1)

    def extended(self, x):
        """l_j(x) [len(x) x s]: from the accelerations of one step to those of the next."""
        return np.vander(x, self.c.size, increasing=True) @ (self.integrals * np.arange(1, self.c.size + 1)).T


@lru_cache(maxsize=8)
def tableau(scheme, stages):
    """Tableau of `radau` or `legendre` collocation."""
    c = np.array(ca.collocation_points(stages, scheme))
    coefficients = np.linalg.inv(np.vander(c, increasing=True)).T  # l_j = sum_k [j, k] x^k
    integrals = coefficients / np.arange(1, stages + 1)
    A = np.vander(c, stages, increasing=True) * c[:, None] @ integrals.T
    values, W = np.linalg.eig(A)
    return Tableau(c, A, A @ A, integrals, W, np.linalg.inv(W), values)


@dataclass
class Step:
    """A step that solved its equations: accelerations [s x n], states at the nodes, iterations, contraction."""

    h: float
    a: np.ndarray
    q: np.ndarray
    v: np.ndarray
    iterations: int
    contraction: float
    power: np.ndarray | None = None


class Steps:
    """Steps of one plant. `weights` [n]: metres that a unit of each coordinate moves the robot, to compare errors."""

    def __init__(self, plant, scheme, stages, weights, tolerance):
        self.plant, self.table, self.tolerance = plant, tableau(scheme, stages), tolerance
        self.free, self.weights = plant.free, weights[plant.free]
        self._matrices, self._inverses = None, None
        n = plant.n
        self._q, self._v, self._a = np.zeros(n), np.zeros(n), np.zeros(n)
        values = self.table.values
        self._kept = [k for k, x in enumerate(values) if x.imag >= -1e-14]  # one of each conjugate pair

    @property
    def has_tangents(self):
        return self._matrices is not None

    def forget(self):
        """Drop the tangents: the coordinates mean something else now."""
        self._matrices, self._inverses = None, None

    def power(self, t, step):
        """`Plant.power` at the nodes of a step from t [s x 11]."""
        rows = []
        for i, x in enumerate(self.table.c):
            r = self.node(t + x * step.h, step.q[i], step.v[i], step.a[i])
            rows.append(self.plant.power(t + x * step.h, self._q, self._v, self._a, r))
        return np.array(rows)

    def refresh(self, t, q, v):
        """New tangents at a state."""
        grid = np.ix_(self.free, self.free)
        self._matrices = [matrix[grid] for matrix in self.plant.tangents(t, q, v)]
        self._inverses = None

    def prepare(self, h):
        """Factors of Newton's matrices for steps of length h."""
        if self._inverses is not None and self._inverses[0] == h:
            return
        M, K, D = self._matrices
        found = []
        for k in self._kept:
            x = h * self.table.values[k]
            x = x.real if abs(x.imag) < 1e-14 * abs(x) else x
            found.append((k, np.linalg.inv(M + x * D + x * x * K)))
        self._inverses = h, found

    def node(self, t, q, v, a):
        """Residual [n] with the free parts q, v, a and the driven ones at t."""
        self._q[self.free], self._v[self.free], self._a[self.free] = q, v, a
        self.plant.place(t, self._q, self._v, self._a)
        return self.plant.residual(t, self._q, self._v, self._a)

    def take(self, t, q, v, h, guess, speed):
        """Step from q, v (free parts) with accelerations `guess` [s x n_f] to start from; None without convergence.

        speed: largest weighted speed so far [m/s].
        """
        table, a, before, contraction = self.table, guess.copy(), None, 0.0
        R = np.empty_like(a)
        try:
            self.prepare(h)
        except np.linalg.LinAlgError:
            return None
        for count in range(1, ITERATIONS + 1):
            V = v + h * (table.A @ a)
            Q = q + h * table.c[:, None] * v + h * h * (table.AA @ a)
            for i, x in enumerate(table.c):
                R[i] = self.node(t + x * h, Q[i], V[i], a[i])[self.free]
            delta = self._solved(R)
            a -= delta
            size = h * float(np.max(np.abs(delta) * self.weights, initial=0.0))
            fast = max(speed, float(np.max(np.abs(V) * self.weights, initial=0.0)))
            if not np.isfinite(size):
                return None
            if before is not None:
                contraction = size / before if before > 0 else 0.0
                if contraction >= 1 and size > 1e-13 * fast:
                    return None
            share = contraction / (1 - contraction) if 0 < contraction < 1 else 1.0
            before = size
            if size * share <= NEWTON * self.tolerance * fast or size <= 1e-14 * fast or fast == 0:
                V = v + h * (table.A @ a)
                Q = q + h * table.c[:, None] * v + h * h * (table.AA @ a)
                return Step(h, a, Q, V, count, contraction)
        return None

    def _solved(self, R):
        table, total = self.table, np.zeros(R.shape)
        Z = table.W_inverse @ R
        for k, inverse in self._inverses[1]:
            if np.isrealobj(inverse):
                total += np.outer(table.W[:, k].real, inverse @ Z[k].real)
            else:
                total += 2 * np.outer(table.W[:, k], inverse @ Z[k]).real
        return total

    def end(self, step, v, q, x=1.0):
        """Free parts of q and v at the fraction x of a step."""
        weights = self.table.weights(x)
        return q + step.h * (weights @ step.v), v + step.h * (weights @ step.a)

    def extrapolated(self, step, h):
        """Guess of the next step's accelerations."""
        return self.table.extended(1 + self.table.c * h / step.h) @ step.a

    def error(self, step, v, a0):
        """Estimated error of a Radau step (free q, free v), from the acceleration a0 at its beginning."""
        gamma, e = self._embedded
        h, (M, K, _) = step.h, self._matrices
        rough_v = h * (gamma * a0 + e @ step.a)
        rough_q = h * (gamma * v + e @ step.v)
        inverse = next(G for _, G in self._inverses[1] if np.isrealobj(G))
        fine_v = inverse @ (M @ rough_v - h * gamma * (K @ rough_q))
        return rough_q + h * gamma * fine_v, fine_v

    @property
    def _embedded(self):
        """Weight of the beginning and differences e [3] between a formula of order 3 and the step's own."""
        gamma = float(next(x.real for x in self.table.values if abs(x.imag) < 1e-12))
        c, b = self.table.c, self.table.A[-1]
        moments = 1 / np.arange(1, 4) - gamma * np.array([1.0, 0.0, 0.0])
        return gamma, np.linalg.solve(np.vander(c, increasing=True).T, moments) - b
