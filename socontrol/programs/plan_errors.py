"""How well a plan meets the equation of motion between its points, and how far a true motion would end up beside it.

Over interval k the plan goes from x_k = (q_k, v_k) to x_(k+1); a finer formula from x_k gets to f_k(x_k). The error of
the interval is l_k = f_k(x_k) - x_(k+1), and how far a true motion from the plan's start is beside the plan follows to
first order, without another solution:
    E_0 = 0,    E_(k+1) = l_k + (df_k/dx) E_k,
the second term as a difference of two integrations. E falls with N^-p, p the order of the scheme, which tells how many
intervals N keep it small.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from socontrol.programs.collocation import Steps
from socontrol.programs.integrators import MOST_STAGES, SLOWEST

FRACTIONS = (np.arange(10) + 0.5) / 10  # of an interval: where the equation of motion is looked at between the points
PIECES = (2, 4, 8, 16, 32, 64)  # steps of the finer formula in an interval: the first number that converges
EXACT = 1e-8  # of the speed: the finer formula solves its equations to a hundredth of it
SMALL = 1e-4  # of the robot's length and speed: differences are linear so far, and rounding is far below
WEAK = 1e-3  # of the largest force: less on a coordinate is no force to compare with


def order(scheme):
    """Power of an interval's length with which positions err, inside of it too: there they are the double integral of a
    polynomial through `size` points."""
    return min(scheme.order, scheme.size + 2)


def between(question, curve, functions, weights):
    """(t [K], share [K]): residual of the equation of motion between the points, over the largest force on the way.

    Of each free coordinate; forces are those of inertia, of the rates, of the shape at rest, and of the inputs. Weights
    [n]: metres that a unit of each coordinate moves the robot's ends.
    """
    k = np.repeat(np.arange(len(curve.shares)), FRACTIONS.size)
    x = np.tile(FRACTIONS, len(curve.shares))
    q, v, a, u, _ = curve.inside(k, x)
    v, a = (np.zeros_like(q),) * 2 if question.quasi_static else (v, a)
    missing = functions.motion_residual.function
    zero, off = np.zeros_like(q), np.zeros_like(u)
    states = (q, v, a, u), (q, v, a, off), (q, v, zero, off), (q, zero, zero, off)
    rows = [_rows(missing, *state) for state in states]
    forces = [rows[0] - rows[1], rows[1] - rows[2], rows[2] - rows[3], rows[3]]
    free = question.free & (weights > 0)
    arms = weights[free]  # a force on a coordinate over its arm is a force at the ends
    largest = np.max([np.max(np.abs(force[:, free]), axis=0, initial=0.0) for force in forces], axis=0) / arms
    largest = np.maximum(largest, WEAK * np.max(largest, initial=0.0))
    share = np.abs(rows[0][:, free]) / arms / np.where(largest > 0, largest, 1.0)
    return curve.nodes[k] + x * np.diff(curve.nodes)[k], np.max(share, axis=1, initial=0.0)


def _rows(function, *given):
    """Rows [K x n] of a Function of columns."""
    return np.array(function.map(given[0].shape[0])(*(ca.DM(rows.T) for rows in given))).T


@dataclass(frozen=True)
class Errors:
    """Estimated. local [N]: error of each interval, over the robot's length and speed; tip [N+1]: way off of any end at
    the nodes [m]; within: largest error inside an interval [m]; growth: of errors, beside a body that coasts."""

    local: np.ndarray
    tip: np.ndarray
    within: float
    growth: float

    @property
    def largest(self):
        """Largest way off of any end [m]."""
        return float(np.max(self.tip)) + self.within


def needed(curve, off, allowed):
    """Intervals that bring the way off to what is allowed [m each]."""
    return max(1, int(np.ceil(len(curve.shares) * (off / allowed) ** (1 / order(curve.scheme)))))


class Finer:
    """The motion of a plant over single intervals of its plan, by a formula of higher order in several steps.

    speed [m/s]: largest on the way; states are the free coordinates and their rates.
    """

    def __init__(self, plant, curve, weights, positions):
        self.plant, self.curve, self.weights, self._positions = plant, curve, weights[plant.free], positions
        self.length, free = plant.robot.length, plant.free
        self.speed = max(float(np.max(np.abs(curve.v) * weights)), SLOWEST * self.length / curve.duration)
        stages = min(max(curve.scheme.size + 1, 3), MOST_STAGES)
        self._steps = Steps(plant, "radau", stages, weights, EXACT)
        self._q, self._v, self._a = curve.q[:, free], curve.v[:, free], curve.a[:, :, free]

    def errors(self):
        """Errors; None where an interval is too long for the finer formula to converge."""
        count, free = len(self.curve.shares), self.plant.free
        E, states, local, inner = np.zeros((2, free.size)), [np.zeros((2, free.size))], [], []
        for k in range(count):
            x = np.array([self._q[k], self._v[k]])
            pieces, found = self._over(k, x)
            shifted, factor = None, 0.0
            if found is not None and np.any(E):
                factor = SMALL / self._size(E)
                shifted = self._steps_over(k, x + factor * E, pieces)
            if found is None or (factor and shifted is None):
                return None
            end, *rows = found
            local.append(end - np.array([self._q[k + 1], self._v[k + 1]]))
            inner.append(self._inside(k, *rows))
            E = local[-1] + ((shifted[0] - end) / factor if factor else 0.0)
            states.append(E)
        tip, local = self._tips(np.array(states)), np.array(local)
        coasting = self._coasting(local)
        off = max(float(np.max(np.abs(state[0]) * self.weights, initial=0.0)) for state in states)
        sizes = np.array([self._size(error) for error in local])
        return Errors(sizes, tip, max(inner), off / coasting if coasting > 0 else 0.0)

    def _over(self, k, x):
        for pieces in PIECES:
            found = self._steps_over(k, x, pieces)
            if found is not None:
                return pieces, found
        return PIECES[-1], None

    def _steps_over(self, k, x, pieces):
        """From a state [2 x n_f]: the state at the end of interval k, and fractions and q at the steps' nodes."""
        plant, curve, steps, (q, v) = self.plant, self.curve, self._steps, x
        plant.k, h = k, (curve.nodes[k + 1] - curve.nodes[k]) / pieces
        whole, rates, fractions, rows = curve.q[k].copy(), np.zeros(plant.n), [], []
        for piece in range(pieces):
            t, at = curve.nodes[k] + piece * h, (piece + steps.table.c) / pieces
            whole[plant.free], rates[plant.free] = q, v
            steps.refresh(t, whole, rates)
            step = steps.take(t, q, v, h, curve.scheme.values(at) @ self._a[k], self.speed)
            if step is None:
                return None
            fractions.append(at)
            rows.append(step.q)
            q, v = steps.end(step, v, q)
        return np.array([q, v]), np.concatenate(fractions), np.vstack(rows)

    def _inside(self, k, x, q):
        """Largest distance [m] of any end from the plan inside an interval."""
        plan = self.curve.inside(np.full(x.size, k), x)[0]
        beside = plan.copy()
        beside[:, self.plant.free] = q
        return _farthest(self._positions(beside) - self._positions(plan)).max()

    def _tips(self, states):
        """Way off [N+1] of any end for errors at the nodes, to first order."""
        sizes = np.array([self._size(E) for E in states])
        factors = np.where(sizes > 0, SMALL / np.where(sizes > 0, sizes, 1.0), 1.0)
        beside = self.curve.q.copy()
        beside[:, self.plant.free] += factors[:, None] * states[:, 0]
        return _farthest(self._positions(beside) - self._positions(self.curve.q)) / factors

    def _size(self, E):
        """Of an error of q and v: over the robot's length and speed."""
        q, v = np.max(np.abs(E) * self.weights, axis=1, initial=0.0)
        return float(max(q / self.length, v / self.speed))

    def _coasting(self, local):
        """Way off [m] where errors of position stay and those of speed go on."""
        q, v = np.max(np.abs(local) * self.weights, axis=2, initial=0.0).T
        return float(np.sum(q + (self.curve.duration - self.curve.nodes[1:]) * v))


def _farthest(gaps):
    """Largest length [K] of gaps [K x ends x 3]."""
    return np.linalg.norm(gaps, axis=2).max(axis=1, initial=0.0)


def positions(functions, robot):
    """Function of rows of q [K x n]: positions [K x ends x 3] of all segments' ends."""
    q = ca.MX.sym("q", robot.n)
    rows = [functions.pose(segment, 1.0).function(q)[:3, 3] for segment in robot.segments]
    function = ca.Function("positions", [q], [ca.vertcat(*rows)])
    return lambda q: np.array(function.map(len(q))(ca.DM(q.T))).T.reshape(len(q), -1, 3)
