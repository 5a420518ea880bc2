"""SUNDIALS' CVODES, through CasADi, on the explicit form qdd = M^-1 (B u - rest): the second opinion."""

import time

import casadi as ca
import numpy as np

from socontrol.programs.motions.integrators import March, Stop, legs, refuse_singular
from socontrol.programs.motions.plant import WORKS
from socontrol.programs.nlp.solver import captured

LEG = 50  # outputs at most between looks at the clock and at Ctrl-C


class CvodesMarch:
    """Marches like `integrators.Marcher`; the integrator itself starts anew where a history jumps or a chart ends."""

    def __init__(self, plant, settings, times, charts):
        self.plant, self.settings, self.times, self.charts = plant, settings, times, charts
        self.march, self._built = March(), {}
        self._rates = plant.explicit()

    def run(self, q, qd, progress=None):
        """March; what stops it, Ctrl-C included, is in its status and keeps what was recorded."""
        self._show = show = progress or (lambda done, total, sentence: None)
        free, march = self.plant.free, self.march
        q, qd, work, t = q.copy(), qd.copy(), np.zeros(len(WORKS) + 6), 0.0
        self.plant.place(0.0, q, qd)
        march.keep(0.0, q, qd, work)
        began = time.perf_counter()
        with march.guarded():
            for stop in legs(self.plant, self.times, every=1 if self.charts else LEG):
                show(t, self.times[-1], f"t = {t:.3g} of {self.times[-1]:g} s")
                if time.perf_counter() - began > self.settings.max_seconds:
                    raise Stop("limit", f"The clock stopped at t = {t:.6g} s; raise `max_seconds`.")
                wanted = [x for x in self.times if t < x <= stop]
                marks = np.array(sorted({*wanted, stop}))
                for part, states, spent in self._parts(t, marks, q, qd):
                    for k, mark in enumerate(part):
                        q[free], qd[free] = np.split(states[:, k], 2)
                        self.plant.place(mark, q, qd)
                        refuse_singular(self.plant.robot, self.charts, mark, q)
                        if mark in wanted:
                            march.keep(mark, q, qd, work + spent[:, k])
                    work = work + spent[:, -1]
                t = stop
                self.charts.renewed(q, qd)
        return march

    def _parts(self, start, marks, q, qd):
        """(marks, states, works) of a whole leg, or mark by mark where that fails, so that what lies before is kept.

        q and qd are the state at the last mark that was taken.
        """
        free = self.plant.free
        try:
            whole = self._leg(start, marks, np.concatenate([q[free], qd[free]]))
        except Stop:
            if marks.size == 1:
                raise
        else:
            yield marks, *whole
            return
        for mark in marks:
            yield [mark], *self._leg(start, np.array([mark]), np.concatenate([q[free], qd[free]]))
            start = mark

    def _leg(self, start, marks, state):
        """States and works at the marks after `start`."""
        span = marks[-1] - start
        grid = tuple(np.round((marks - start) / span, 12))
        if grid not in self._built:
            options = {"reltol": self.settings.tolerance, "abstol": 1e-3 * self.settings.tolerance,
                       "max_num_steps": self.settings.max_steps, "quad_err_con": False}  # fmt: skip
            self._built[grid] = ca.integrator("motion", "cvodes", self._rates, 0.0, list(grid), options)
        integrator = self._built[grid]
        try:
            with captured():
                answer = integrator(x0=state, p=[start, span])
        except KeyboardInterrupt:
            raise
        except Exception as error:
            self._show(start, self.times[-1], "")  # raises where Ctrl-C was swallowed by the compiled code
            if "KeyboardInterrupt" in str(error):
                raise KeyboardInterrupt from None
            limit = "TOO_MUCH_WORK" in str(error)
            fix = "raise `max_steps`" if limit else "look at loads and inputs there, or use the integrator `radau`"
            outcome = "limit" if limit else "numerical"
            between = f"between t = {start:.6g} and {marks[-1]:.6g} s"
            raise Stop(outcome, f"SUNDIALS gave up {between}; what lies before is kept; {fix}.") from None
        self.march.steps += int(integrator.stats().get("nsteps", 0))
        return np.array(answer["xf"]), np.array(answer["qf"])
