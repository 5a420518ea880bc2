"""A robot under tensions in time: the numbers its inputs are found from, and the motion simulated again under them."""

import casadi as ca
import numpy as np

from socontrol.native.buffers import buffered
from socontrol.programs.motions.charts import Charts
from socontrol.programs.motions.conditions import Constrained
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.held_march import HeldMarcher
from socontrol.programs.motions.integrators import Marcher, Radau
from socontrol.programs.motions.motion_answer import ends
from socontrol.programs.motions.plant import WORKS, Plant
from socontrol.programs.motions.signals import History
from socontrol.programs.motions.ties import Ties
from socontrol.programs.plans.replay import Replayed

SHARE, LOOSEST, TIGHTEST = 0.01, 1e-4, 1e-10  # tolerance of a step: of that of the motion; its limits
STEPS = 1000  # for each sample: more are a motion that runs away


class _Played:
    """Inputs that go in straight lines through samples."""

    def play(self, times, u):
        """From now on the inputs are u [K x m] at times [K]."""
        self._times, self._u = times, u
        self._slopes = np.diff(u, axis=0) / np.diff(times)[:, None]

    def inputs(self, t):
        k = min(max(int(np.searchsorted(self._times, t, side="right")) - 1, 0), len(self._times) - 2)
        return self._u[k] + (t - self._times[k]) * self._slopes[k]


class Pulled(_Played, Plant):
    """A robot whose inputs go in straight lines through samples; coordinates {index: value} are held."""

    def __init__(self, robot, held):
        fixed = {i: History(lambda t, value=value: ca.DM(value)) for i, value in held.items()}
        super().__init__(robot, [History(lambda t: ca.DM(0))] * robot.m, fixed, {})
        self._actuation = None if robot.friction else buffered(self.functions.actuation)
        self.play(np.array([0.0, 1.0]), np.zeros((2, robot.m)))

    def missing(self, q, qd, qdd, u):
        """tau - B u [n] of a motion under inputs u; the array is reused."""
        return self._residual(q, qd, qdd, u)[0][0]

    def columns(self, q, qd, qdd, size):
        """B [n x m]; where cables rub their forces depend on qd too, and are told by inputs of `size` [m]."""
        if self._actuation is not None:
            return self._actuation(q)[0].T
        tau = self.missing(q, qd, qdd, 0 * size).copy()
        return np.column_stack([tau - self.missing(q, qd, qdd, u) for u in np.diag(size)]) / size

    def yielding(self, q, qd, u):
        """M, K, D [n x n each] at a state under inputs u."""
        M, K, D = self._tangents(q, qd, u)
        return M.T, K.T, D.T


class _PulledClosed(_Played, Constrained):
    """A Pulled whose loops stay closed."""


class _Unasked(Marcher):
    """A march of which nobody asks the work."""

    def _worked(self, step, x):
        return np.zeros(len(WORKS) + 6)


class _UnaskedClosed(HeldMarcher):
    """The same of a robot with loops, of which nobody asks the forces either."""

    _worked = _Unasked._worked

    def _keep(self, t, q, qd, work):
        n = self.plant.robot.n
        self.march.keep(t, q[:n], qd[:n], work)


def simulated(plant, motion, u, tolerance, progress=None):
    """Replayed: from the beginning of a motion under inputs u [K x m], recorded at its times [K], loops kept closed;
    tolerance: of the motion, of the robot's length."""
    times, kind = motion.t, _Unasked
    plant.play(times, u)
    if plant.robot.loops:
        plant, kind = _PulledClosed(plant, None, Ties(plant.robot, plant.free)), _UnaskedClosed
    robot, every = plant.robot, float(times[1] - times[0])
    settings = Radau(tolerance=float(np.clip(SHARE * tolerance, TIGHTEST, LOOSEST)), longest_step=every,
                     first_step=every, max_steps=STEPS * len(times))  # fmt: skip
    march = kind(plant, settings, times, displacement_weights(robot), robot.length)
    march.charts = Charts(robot, range(robot.n))  # all kept, as the wanted motion keeps them
    march = march.run(motion.q[0], motion.qd[0], progress)
    q = np.array(march.q)
    places = ends(robot, plant.functions, {"q": q})
    there = {segment: places[f"{segment}.position"] for segment in robot.segments}
    return Replayed(np.array(march.t), q, np.array(march.qd), there, march.status)
