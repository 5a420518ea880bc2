"""All waypoints of a path in one program: least effort of all, with limits on the rates between them.

    minimise   sum_k cost(q_k, u_k) + smoothness sum_k |(u_(k+1) - u_k) / u_scale|^2 / 2
    subject to each posture's own conditions,   low dt <= y_(k+1) - y_k <= high dt  for limited y: u or l(q)
A posture is differentiated once and mapped over the waypoints, so that building does not grow with them.
"""

import time
from dataclasses import replace

import casadi as ca
import numpy as np

from socontrol.programs.nlp.parts import Part, Parts
from socontrol.programs.nlp.solver import NLP
from socontrol.programs.postures.inverse_statics import Attempt
from socontrol.programs.postures.paths import Walk
from socontrol.programs.result import Status
from socontrol.programs.tensions.path_in_order import HASTE, enough_time, in_order, unhurried

ROUNDING = 1e-9  # of a cost: a smaller difference is rounding
BINDING = 1e-3  # of the rate a slowed path needs: so near it a limit counts as what holds it up


def together(solver, pace, directions=None, progress=None):
    """Walk through all waypoints at once; never at a higher cost than in order, where that is possible."""
    began = time.perf_counter()
    free = unhurried(solver, pace, directions, progress)
    if len(free.rows) < free.count:
        return free
    ordered = in_order(solver, pace, directions, free=free)
    if ordered.last.status.outcome == "interrupted":
        return ordered
    attempts = free.attempts + (ordered.attempts if ordered is not free else [])
    search = _Search(solver, pace, free, ordered, Walk(free.count, attempts=attempts), progress)
    done = search.run([own for _, own in free.rows])
    turned = _turned(directions, pace, done)
    if done.stopped is None and turned != search.parameters:
        done = search.run(turned)
    done.last, done.parameters = done.rows[-1]
    done.seconds = time.perf_counter() - began
    return done


def _turned(directions, pace, done):
    """Parameters of the waypoints with the directions that cables moved in."""
    parameters = [own for _, own in done.rows]
    if directions is None:
        return parameters
    changes = np.diff(pace.lengths(done.array("q", pace.robot.n)), axis=0)
    for k, change in enumerate(changes, start=1):
        parameters[k] = {**parameters[k], **directions.after(directions.ways(parameters[k - 1]), change)}
    return parameters


class _Search:
    """Fills a Walk with the best answer for all waypoints, or with the nearest to one and why it is none."""

    def __init__(self, solver, pace, free, ordered, done, progress):
        self.solver, self.pace, self.free, self.ordered = solver, pace, free, ordered
        self.done, self.progress = done, progress

    def run(self, parameters):
        """The Walk, for the parameters [K mappings] of the waypoints."""
        self.parameters, self.whole = parameters, Together(self.solver, self.pace, parameters)
        complete = len(self.ordered.rows) == self.free.count
        outcome, rows = self._solved(self.whole, self.free.array)
        interrupted = outcome.status.outcome == "interrupted"
        if complete and not interrupted and (rows is None or self._above(outcome)):
            outcome, rows = self._solved(self.whole, self.ordered.array)
        if rows is None and not complete and not interrupted:
            return self._slowed(outcome)
        if rows is None:
            return self._ended((self.ordered if complete else self.free).rows, outcome.status)
        if complete and self._above(outcome):
            return self._ended(self.ordered.rows)
        return self._ended(zip(rows, self.parameters, strict=True))

    def _above(self, outcome):
        """Whether the waypoints in order cost less."""
        return outcome.cost > self.whole.cost(self.ordered.array) * (1 + ROUNDING)

    def _solved(self, whole, array):
        """(outcome, outcomes of the waypoints or None) from the arrays of a start."""
        outcome, rows = whole.solve(array, self.progress)
        self.done.attempts.append(Attempt.of("together" if whole is self.whole else "with more time", outcome))
        met = outcome.status.solved and all(map(self.solver.meets, rows, self.parameters))
        return outcome, rows if met else None

    def _ended(self, rows, status=None):
        self.done.rows = list(rows)
        if status is not None:
            sentence = f"All waypoints together: {status.message} Those returned were found in order."
            self.done.stopped = Status(status.outcome, sentence)
        return self.done

    def _slowed(self, outcome):
        """The waypoints with as much time as they need, nearly the least; if that is what they have, once more."""
        whole = Together(self.solver, self.pace, self.parameters, stretched=True)
        slow, rows = self._solved(whole, self.free.array)
        if rows is None:
            enough = enough_time(self.pace, self.free)
            done = self._ended(self.free.rows, outcome.status)
            if outcome.status.outcome == "infeasible" and enough:
                done.stopped = Status("infeasible", f"{_PLAIN.format(count=done.count)}; {enough}.")
            return done
        array, stretch = _arrays(rows), float(slow.values[whole.stretch][0])
        if stretch < 1 + BINDING:
            _, found = self._solved(self.whole, array)
            if found is not None:
                return self._ended(zip(found, self.parameters, strict=True))
        done = self._ended(zip(rows, self.parameters, strict=True))
        binding = self.pace.binding(array("u"), self.pace.lengths(array("q")), stretch * (1 - BINDING))
        enough = self.pace.would_do(np.full(done.count - 1, stretch))
        done.stopped = Status("infeasible", f"{_PLAIN.format(count=done.count)}: {binding}; {enough}.")
        return done


_PLAIN = "No inputs were found that hold all {count} waypoints within the limits on rates"


def _arrays(rows):
    """Function of a letter -> [K x size] of outcomes."""
    return lambda key, size=None: np.array([outcome.values[key] for outcome in rows])


class Together:
    """The program of all waypoints of `parameters` [K mappings]; `stretched`: changes may take longer, as little as
    can be."""

    def __init__(self, solver, pace, parameters, stretched=False):
        self.solver, self.pace, self.parameters = solver, pace, parameters
        posture = solver.posture
        own = posture.nearest if posture.overdetermined else posture.exact
        self.single = own.program
        self.program = Parts()
        self.program.preferred = {"mu_init": 1e-3}  # so as not to leave the branch of the start
        self.where = self._postures(own.functions)
        self.stretch = self.program.block(1, lower=1.0, upper=np.inf, guess=1.0) if stretched else None
        self._smooth()
        self._rates()

    @property
    def count(self):
        return len(self.parameters)

    def places(self, name):
        """Places [K x size] of a variable."""
        return self.where[:, self.single.variables[name].where]

    def _postures(self, made):
        single, nlp, limits = self.single, made["nlp"], self.single.limits()
        lower, upper = (bound * single.scale for bound in single.bounds())
        numbers = np.array([single.stack_parameters(p) for p in self.parameters])
        where = self.program.block(self.count * single.scale.size, scale=np.tile(single.scale, self.count),
                                   lower=np.tile(lower, self.count), upper=np.tile(upper, self.count))  # fmt: skip
        where = where.reshape(self.count, -1)

        def derivatives(sigma, lam):
            hessian = made["hess_lag"](nlp["x"], nlp["p"], sigma, lam)
            return made["jac_g"](nlp["x"], nlp["p"])[1], hessian

        rows = [(np.ones(c.scale.size), c.unit) for c in single.constraints.values()]
        units = [u for one, unit in rows for u in ([unit] * one.size if isinstance(unit, str) else unit)]
        scale = np.concatenate([c.scale for c in single.constraints.values()])
        self.program.parts.append(Part(
            "postures", nlp["x"], nlp["p"], nlp["g"], nlp["f"], ca.SX(0, 1), where, numbers,
            *(np.tile(limit, (self.count, 1)) for limit in limits), scale, tuple(units), np.arange(self.count),
            derivatives=derivatives,
        ))  # fmt: skip
        return where

    def _smooth(self):
        weight, u = getattr(self.solver.question, "smoothness", 0.0), self.places("u")
        if weight:
            scale = ca.DM(self.solver.balance.scales.u)
            change = lambda a, b: {"cost": weight * ca.sumsqr((b - a) / scale) / 2}  # noqa: E731
            self.program.add("smoothness", {"before": u[:-1], "after": u[1:]}, change)

    def _rates(self):
        lengths = self.pace.lengths_of
        for rate in self.pace.rates:
            i = rate.index
            y = {"u": lambda x: x, "l": lambda q, i=i: lengths(q)[i]}[rate.letter]
            places = self.places("u")[:, i : i + 1] if rate.letter == "u" else self.places("q")
            blocks, name = {"before": places[:-1], "after": places[1:]}, f"rates.{rate.letter}.{rate.name}"
            limits = self.pace.dt[:, None] * np.array([rate.low, rate.high])
            if self.stretch is None:
                rows = lambda a, b, y=y, rate=rate: {"rows": y(b) - y(a), "scale": rate.scale}  # noqa: E731
                self.program.add(name, blocks, rows, lower=limits[:, :1], upper=limits[:, 1:])
                continue

            def sides(a, b, stretch, limits, y=y, rate=rate):
                return {"rows": y(b) - y(a) - stretch * limits, "scale": rate.scale}

            blocks["stretch"] = np.full((self.count - 1, 1), self.stretch[0])
            self.program.add(name, blocks, sides, numbers=limits, lower=[0.0, -np.inf], upper=[np.inf, 0.0])
        if self.stretch is not None:
            self.program.add("haste", {"s": self.stretch[None]}, lambda s: {"cost": HASTE * self.count * s})

    def solve(self, array, progress=None):
        """(outcome, outcomes of the waypoints) from array(letter, size): postures q [K x n] and inputs u [K x m]."""
        x = self._filled(array)
        if self.stretch is not None:
            worst = np.max(self.pace.strain(x[self.places("u")], self.pace.lengths(x[self.places("q")])), initial=1.0)
            x[self.stretch] = worst if np.isfinite(worst) else 1.0
        question = self.solver.question
        outcome = NLP(self.program, question.solver, question.loaded.compiled, progress).solve(x)
        rows = [self._single(outcome, k) for k in range(self.count)] if np.all(np.isfinite(outcome.x)) else []
        return outcome, rows

    def _filled(self, array):
        x = self.program.guess.copy()
        for name, own in self.single.variables.items():
            x[self.places(name)] = array(name, own.guess.size)
        return x

    def _single(self, outcome, k):
        values = {name: outcome.values[self.places(name)[k]] for name in self.single.variables}
        return replace(outcome, values=values, x=outcome.x[self.where[k]], lam_x=outcome.lam_x[self.where[k]], log="")

    def cost(self, array):
        """Cost of postures and inputs that need not come from here."""
        return sum(cost for _, cost, _ in self.program.evaluated(self._filled(array) / self.program.scale))
