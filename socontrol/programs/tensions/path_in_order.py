"""A path in order: each waypoint from the one before it, within the limits on rates.

An input may change by its rate times the time since the waypoint before, low dt <= u - u_before <= high dt, and so may
a cable's length l(q). Each waypoint takes the least effort it can, whatever that makes of the next ones.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.programs.nlp.solver import NLP
from socontrol.programs.postures.inverse_statics import Attempt
from socontrol.programs.postures.paths import Stop, walk
from socontrol.programs.result import Status

HASTE = 1e4  # weight of the time a change takes beside an effort of order 1: nearly the shortest is found
KEPT = 5e-7  # of a limit: by so much a rate may be beyond it, for rounding
CHEAPER = 1e-6  # of a cost: a smaller difference is the solver's tolerance


def in_order(solver, pace, directions=None, progress=None, free=None):
    """Walk within the limits on rates; free: the Walk without them, if it is known."""
    if not pace.rates:
        return free or unhurried(solver, pace, directions, progress)
    if free is None and pace.closed:
        free = unhurried(solver, pace, directions, progress)
        if len(free.rows) < free.count:
            return free
    return walk(solver, InOrder(solver, pace, directions, pace.rates, free=free), progress)


def unhurried(solver, pace, directions=None, progress=None):
    """Walk without limits on rates; a closed path that ends at a lower cost than it began with is walked once more,
    from there: from rest, the first waypoint need not be met by its least effort."""
    done = walk(solver, InOrder(solver, pace, directions), progress)
    whole = len(done.rows) == done.count and pace.closed
    if whole and done.last.cost < done.rows[0][0].cost * (1 - CHEAPER):
        again = walk(solver, InOrder(solver, pace, directions, begin=done.rows[-1]), progress)
        again.attempts, again.seconds = done.attempts + again.attempts, done.seconds + again.seconds
        return again
    return done


class InOrder:
    """Finds each waypoint from the one before it within `rates`; free: the Walk without; begin: the (outcome,
    parameters) where the first is sought."""

    def __init__(self, solver, pace, directions=None, rates=(), *, free=None, begin=None):
        self.solver, self.pace, self.rates = solver, pace, rates
        self._rows = any(rate.letter == "l" for rate in rates)  # those of inputs alone are bounds
        begin = free.rows[0] if free else begin
        self._begin = begin[0] if begin else None
        self._free, self._warm, self._directions = free, None, directions
        self._ways = directions.ways(begin[1] if begin else directions.declared) if directions else {}

    @property
    def posture(self):
        """The solver's own, which may hold its loops by other rows from a waypoint on."""
        return self.solver.posture

    def __call__(self, k, targets, before):
        """(outcome, attempts, further parameters); raises Stop where rates forbid it."""
        outcome, attempts = self._found(k, {**targets, **self._ways}, before)
        if self._directions and before and outcome.status.solved:
            change = self._change(before, outcome)
            if (ways := self._directions.after(self._ways, change)) != self._ways:
                self._ways = ways
                outcome, more = self._found(k, {**targets, **ways}, before)
                attempts += more
        return outcome, attempts, self._ways

    def _change(self, before, after):
        """Change of lengths [m]."""
        return np.diff(self.pace.lengths([before.values["q"], after.values["q"]]), axis=0)[0]

    def _found(self, k, targets, before):
        if before is None or not self.rates:
            before = before or self._begin
            return self.solver.find(targets, before.values if before else None, before)
        return self._within(k, targets, before)

    def _within(self, k, targets, before):
        parameters, bounds = self._room(k, before)
        parameters |= {**self.posture.targets(), **targets}
        nlp, attempts = self._nlp, []

        def attempt(label, **how):
            outcome = nlp.solve(parameters=parameters, bounds=bounds, **how)
            attempts.append(Attempt.of(label, outcome))
            return outcome

        if self._warm is not None and self._good(outcome := attempt("neighbour", warm=self._warm), parameters):
            return self._kept(outcome), attempts
        if self._good(outcome := attempt("neighbour's posture", guess=before.values), parameters):
            return self._kept(outcome), attempts
        free, tries = self.solver.find(targets, before.values)
        attempts += tries
        if not free.status.solved:
            return free, attempts
        slow = self._slowed(k, before, free, parameters)
        attempts.append(Attempt.of("with more time", slow))
        if not self._good(slow, parameters):
            raise Stop(self._refused(k, before, free), attempts)
        if self._good(outcome := attempt("from there", guess=slow.values), parameters):
            return self._kept(outcome), attempts
        if slow.values["stretch"][0] <= 1 + KEPT:  # nothing is left between the limits: no interior to go through
            self._warm = None
            return slow, attempts
        raise Stop(self._refused(k, before, slow), attempts)

    def _good(self, outcome, parameters):
        if outcome.status.outcome == "interrupted":
            raise KeyboardInterrupt
        return outcome.status.solved and self.solver.meets(outcome, parameters)

    def _kept(self, outcome):
        self._warm = outcome
        return outcome

    @property
    def _nlp(self):
        if self._rows:
            return self._stretched
        return self.posture.nearest if self.posture.overdetermined else self.posture.exact

    @cached_property
    def _stretched(self):
        """NLP in which a change may take `stretch` times as long, at the weight `haste`."""
        program = self.posture.program(self.posture.overdetermined)
        stretch = program.variable("stretch", 1, guess=1.0, lower=1.0, upper=1.0)
        before, dt = program.parameter("before", np.zeros(len(self.rates))), program.parameter("dt", 1.0)
        q, u = (v.symbol * ca.DM(v.scale) for v in (program.variables["q"], program.variables["u"]))
        y = {"u": u, "l": self.pace.lengths_of(q)}
        change = ca.vertcat(*(y[rate.letter][rate.index] for rate in self.rates)) - before
        scale = np.array([rate.scale for rate in self.rates])
        for side, limits, lower, upper in (("high", [r.high for r in self.rates], -np.inf, 0.0),
                                           ("low", [r.low for r in self.rates], 0.0, np.inf)):  # fmt: skip
            rows = change - stretch * dt * ca.DM(limits)
            program.constrain(f"rates.{side}", rows, lower=lower, upper=upper, scale=scale)
        program.minimize(program.parameter("haste", 0.0) * (stretch - 1))
        return NLP(program, self.posture.question.solver, self.posture.robot.compiled)

    def _room(self, k, before):
        """Parameters and bounds of a waypoint whose neighbour is `before`."""
        u, dt = before.values["u"], float(self.pace.dt[k - 1])
        if self._rows:
            return {"before": self._levels(before), "dt": dt}, None
        lower, upper = (np.array(x) for x in self.posture.limits()["u"])
        for rate in self.rates:
            i = rate.index
            lower[i], upper[i] = max(lower[i], u[i] + rate.low * dt), min(upper[i], u[i] + rate.high * dt)
        return {}, {"u": (lower, upper)}

    def _levels(self, outcome):
        """Limited inputs and lengths [R] at an outcome."""
        y = {"u": outcome.values["u"], "l": np.array(self.pace.lengths_of(outcome.values["q"])).ravel()}
        return np.array([y[rate.letter][rate.index] for rate in self.rates])

    def _slowed(self, k, before, free, parameters):
        """The waypoint with as much time as it needs, nearly the least."""
        dt = float(self.pace.dt[k - 1])
        wide = {"stretch": ([1.0], [np.inf])}
        parameters = {**parameters, "before": self._levels(before), "dt": dt, "haste": HASTE}
        stretch = max(1.0, np.max(self._shares(k, before, free)))
        guess = {**free.values, "stretch": stretch if np.isfinite(stretch) else 1.0}
        return self._stretched.solve(guess=guess, parameters=parameters, bounds=wide)

    def _shares(self, k, before, outcome):
        """Of each limit [R], what the change from `before` takes."""
        dt, changes = float(self.pace.dt[k - 1]), self._levels(outcome) - self._levels(before)
        return np.array([rate.share(change, dt) for rate, change in zip(self.rates, changes, strict=True)])

    def _refused(self, k, before, outcome):
        """Status that names the rates waypoint k would need, and a duration with which the whole path is solved."""
        shares, changes = self._shares(k, before, outcome), self._levels(outcome) - self._levels(before)
        worst = [i for i in np.argsort(-shares) if shares[i] > max(1.0, 0.99 * np.max(shares))][:3]
        dt = float(self.pace.dt[k - 1])
        told = "; ".join(self.rates[i].needed(changes[i], dt) for i in worst) or "the rates leave no way to it"
        free = self._free or unhurried(self.solver, self.pace, self._directions)
        enough = enough_time(self.pace, free)
        hint = "" if self.solver.question.together else ", or try `together: true`, which sees it coming"
        return Status("infeasible", f"{told}; {enough or 'it needs more time'}{hint}.")


def enough_time(pace, free):
    """`a duration of 13.6 s would do`: for a Walk without limits on rates; nothing where it did not get to the end."""
    if len(free.rows) < free.count:
        return ""
    q, u = free.array("q", pace.robot.n), free.array("u", pace.robot.m)
    return pace.would_do(pace.strain(u, pace.lengths(q)))
