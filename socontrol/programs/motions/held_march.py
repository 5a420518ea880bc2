"""The march through time of a plant under conditions: steps end where a condition lets go or is met again."""

import numpy as np

from socontrol.programs.motions.integrators import Marcher, Stop
from socontrol.programs.motions.plant import WORKS

LOOKS = 16  # places inside a step at which one-sided conditions are looked at
HALVINGS = 40  # of the place where one changes
TRIES = 6  # to end a step there
NEAR = 1e-3  # of the step: how near counts
PULLED, TOUCHED = 1e-7, 1e-10  # of an input's size, of the robot's length: less is not seen
INSTANT = 1e-5  # of the whole time: what a cable would be slack for less is no slack
DEAD = 1e-3  # of what the loops' rows hold at most: what the weakest holds where steps fail at a dead point
TORN = 1e-7  # of the robot's length: a condition that is not met


class HeldMarcher(Marcher):
    """A `Marcher` of a `Constrained` plant."""

    def __init__(self, plant, settings, times, weights, length):
        weights = np.concatenate([weights, np.zeros(plant.k)])
        super().__init__(plant, settings, times, weights, length)
        self._happens = ()
        self._room = np.full(plant.k, TOUCHED * length)  # c beyond which a condition that is not held is broken

    def run(self, q, qd, progress=None):
        return super().run(self.plant.extended(q), self.plant.extended(qd), progress)

    def _prepare(self):
        self.plant.regularise(0.0, self.q, self.qd)
        self._switch(())
        self.work[:] = 0.0

    def _keep(self, t, q, qd, work):
        n = self.plant.robot.n
        super()._keep(t, q[:n], qd[:n], work)
        rows = zip((self.march.u, self.march.motors, self.march.lam), self.plant.forces(t, q, qd), strict=True)
        for kept, found in rows:
            kept.append(found)

    def _leg(self, stop):
        if self.t > 0:
            self._switch(())
        super()._leg(stop)

    def _switch(self, touched):
        """Decide what is held from now on; what is caught costs kinetic energy."""
        plant, before = self.plant, self.plant.held.copy()
        self.work[WORKS.index("inputs")] += plant.met_again(
            self.t, self.q, self.qd, touched, INSTANT * self.times[-1]
        )
        plant.project(self.t, self.q, self.qd)
        rate = plant.rows(self.t, self.q, self.qd).rate
        for k in touched:
            if not plant.held[k] and rate[k] > -TOUCHED * self.length:  # others hold it, or contradict it
                if self._room[k] >= TORN * self.length:
                    self._torn(k, self._room[k])
                self._room[k] = TORN * self.length
        for k in np.flatnonzero(plant.held[: plant.m] != before[: plant.m]):
            self.march.changes.append((float(self.t), plant.names[k], bool(plant.held[k])))

    def _step(self, h):
        """A step that ends, if not before, where one-sided conditions change."""
        last, taken, self._happens = self._last, self.march.steps, ()
        h, follow = super()._step(h)
        for _ in range(TRIES):
            x, which = self._change(h)
            if x is None:
                break
            self._happens = which
            if x > 1 - NEAR:
                break
            self._last = last
            h, _ = super()._step(x * h)
        self.march.steps = taken + 1
        return h, follow

    def _accept(self, t):
        happens = self._happens
        super()._accept(t)
        self._refuse_torn()
        chosen = self.plant.choose(t, self.q)
        if chosen:
            self.plant.project(t, self.q, self.qd)
        if len(happens):
            self._switch([k for k in happens if not self.plant.held[k]])
        if chosen or len(happens):
            self._last, self._acceleration = None, self._begin()
            self.steps.forget()

    def _shorter(self, h, factor):
        try:
            return super()._shorter(h, factor)
        except Stop:
            if not (self.plant.ties and self.plant.led and self.plant.ties.share < DEAD):
                raise
        fix = "turn back before, or drive another joint"
        sentence = f"At t = {self.t:.6g} s what is driven comes to a dead point, beyond which the loops do not follow"
        raise Stop("infeasible", f"{sentence}; {fix}.")

    def _refuse_torn(self):
        """Raise Stop where what is held is not met."""
        plant = self.plant
        c = np.where(plant.held & plant.rigid, plant.rows(self.t, self.q, self.qd).c, 0.0)[: plant.m]
        worst = int(np.argmax(np.abs(c))) if plant.m else -1
        if plant.m and not abs(c[worst]) <= TORN * self.length:
            self._torn(worst, c[worst])
        if plant.ties:
            name, apart, told = plant.ties.opened(self.q[: plant.robot.n])
            if not apart <= TORN:
                why = f"no shape nearby keeps loop '{name}' closed: it is {told} open"
                fix = "what is driven asks for more than the loops leave" if plant.led else "take shorter steps"
                raise Stop("infeasible" if plant.led else "numerical", f"At t = {self.t:.6g} s {why}; {fix}.")

    def _torn(self, k, c):
        fix = "give other lengths, or the cables a `stiffness`"
        sentence = f"no posture nearby holds {self.plant.names[k]}: it is {1e3 * c:.2g} mm off"
        raise Stop("infeasible", f"At t = {self.t:.6g} s {sentence}; {fix}.")

    def _change(self, h):
        """(fraction of the last step at which one-sided conditions first change, which), or (None, ())."""
        places = np.arange(1, LOOKS + 1) / LOOKS
        if not self.plant.one_sided.any():
            return None, ()
        low, wrong = 0.0, ()
        for x in places:
            wrong = self._wrong(x, h)
            if wrong.size:
                break
            low = x
        else:
            return None, ()
        high = x
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            found = self._wrong(middle, h)
            low, high, wrong = (low, middle, found) if found.size else (middle, high, wrong)
        return high, wrong

    def _wrong(self, x, h):
        """Conditions that are held with lam < 0, or not held with c > 0, at the fraction x of the last step."""
        step, plant = self._last, self.plant
        lam = (self.steps.table.extended(np.array([x])) @ step.a)[0, -plant.k :]
        past = plant.held & (lam < -PULLED * plant.sizes)
        if not plant.held.all():
            q, v = self.q.copy(), self.qd.copy()
            q[self.free], v[self.free] = self.steps.end(step, self._before[1], self._before[0], x)
            past |= ~plant.held & (plant.rows(self.t + x * h, q, v).c > self._room)
        return np.flatnonzero(plant.one_sided & past)
