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

from socontrol.programs.motions.collocation import Steps
from socontrol.programs.motions.integrators import MOST_STAGES, SLOWEST

FRACTIONS = (np.arange(10) + 0.5) / 10  # of an interval: where the equation of motion is looked at between the points
PIECES = (2, 4, 8, 16, 32, 64)  # steps of the finer formula in an interval: the first number that converges
EXACT = 1e-8  # of the speed: the finer formula solves its equations to a hundredth of it
SMALL = 1e-4  # of the robot's length and speed: differences are linear so far, and rounding is far below
ROOM = 1.1  # times the intervals that would do if errors fell exactly with the order
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
    """Estimated. local [N]: error of each interval, over the robot's length and speed; tip [N]: largest way off of any
    end in each [m]; growth: of errors, beside a body that coasts; worst: index of the coordinate that errs most in an
    interval, and when [s]."""

    local: np.ndarray
    tip: np.ndarray
    growth: float
    worst: tuple

    @property
    def largest(self):
        """Largest way off of any end [m]."""
        return float(np.max(self.tip))


def needed(curve, off, allowed):
    """Intervals that bring the way off to what is allowed [m each]."""
    return max(1, int(np.ceil(ROOM * len(curve.shares) * (off / allowed) ** (1 / order(curve.scheme)))))


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
        E, local, off, tip = np.zeros((2, self.plant.free.size)), [], 0.0, []
        for k in range(len(self.curve.shares)):
            found = self._passed(k, E)
            if found is None:
                return None
            own, E, inside = found
            off = max(off, float(np.max(np.abs(E[0]) * self.weights)))
            local.append(own)
            tip.append(self._tip(k, *inside))
        local = np.array(local)
        coasting = self._coasting(local)
        growth = off / coasting if coasting > 0 else 0.0
        return Errors(np.array([self._size(error) for error in local]), np.array(tip), growth, self._worst(local))

    def _passed(self, k, E):
        """Over interval k, with an error E where it begins: its own error, the error where it ends, and (fractions,
        errors of q) inside; None without convergence."""
        x, size = np.array([self._q[k], self._v[k]]), self._size(E)
        factor = SMALL / size if size > 0 else 1.0
        for pieces in PIECES:
            found = self._steps_over(k, x, pieces)
            beside = self._steps_over(k, x + factor * E, pieces) if found and size > 0 else found
            if beside is None:
                continue
            (end, at, q), (moved, _, aside) = found, beside
            own = end - np.array([self._q[k + 1], self._v[k + 1]])
            inside = q - self.curve.inside(np.full(at.size, k), at)[0][:, self.plant.free] + (aside - q) / factor
            return own, own + (moved - end) / factor, (at, inside)
        return None

    def _steps_over(self, k, x, pieces):
        """From a state [2 x n_f]: that at the end of interval k, and fractions and q at the nodes of the steps."""
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

    def _tip(self, k, x, errors):
        """Largest way off [m] of any end for errors of q [J x n_f] at fractions x of interval k, to first order."""
        size = self._size(np.array([np.max(np.abs(errors), axis=0), np.zeros(errors.shape[1])]))
        factor = SMALL / size if size > 0 else 1.0
        plan = self.curve.inside(np.full(x.size, k), x)[0]
        beside = plan.copy()
        beside[:, self.plant.free] += factor * errors
        return float(np.linalg.norm(self._positions(beside) - self._positions(plan), axis=2).max() / factor)

    def _size(self, E):
        """Of an error of q and v: over the robot's length and speed."""
        q, v = np.max(np.abs(E) * self.weights, axis=1, initial=0.0)
        return float(max(q / self.length, v / self.speed))

    def _worst(self, local):
        shares = np.max(np.abs(local) * self.weights / np.array([[self.length], [self.speed]]), axis=1)
        k, i = np.unravel_index(int(np.argmax(shares)), shares.shape)
        return int(self.plant.free[i]), float(self.curve.nodes[k + 1])

    def _coasting(self, local):
        """Way off [m] where errors of position stay and those of speed go on."""
        q, v = np.max(np.abs(local) * self.weights, axis=2, initial=0.0).T
        return float(np.sum(q + (self.curve.duration - self.curve.nodes[1:]) * v))


def positions(functions, robot):
    """Function of rows of q [K x n]: positions [K x ends x 3] of all segments' ends."""
    q = ca.MX.sym("q", robot.n)
    rows = [functions.pose(segment, 1.0).function(q)[:3, 3] for segment in robot.segments]
    function = ca.Function("positions", [q], [ca.vertcat(*rows)])
    return lambda q: np.array(function.map(len(q))(ca.DM(q.T))).T.reshape(len(q), -1, 3)
