"""Direct collocation of r(q, v, a, u) = 0: unknowns in the order of time, and the parts that join them.

Unknowns are q, v at the nodes and q, v, a, u at the points of every interval, so that the equation of motion is met as
it stands, without an inverse of the mass matrix. Where the scheme's last point is a node its q and v are that node's,
unless `staged` keeps them apart, as a solver wants that goes through the stages one by one. A continuous input has a
value at every node. A free duration is an unknown at every node, equal to the one before. `halfway`: q is an unknown
between the points too, for what has to be looked at there. Inputs go through their values at the `points`, or are
`linear` or `constant` in an interval, so that they stay between their values at its ends.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from socontrol.programs.nlp.assembly import EXACT
from socontrol.programs.nlp.parts import Parts
from socontrol.programs.plans.layout import Layout
from socontrol.programs.plans.planned import Planned
from socontrol.programs.plans.schemes import Scheme, slopes


@dataclass(frozen=True)
class System:
    """residual(q, v, a, u): SX [rows] in the unit of `force` [rows]; q [n], u [m]: magnitudes of the unknowns."""

    residual: Any
    q: np.ndarray
    u: np.ndarray
    force: np.ndarray

    @property
    def n(self):
        return self.q.size

    @property
    def m(self):
        return self.u.size


@dataclass(frozen=True)
class Span:
    """Duration [s]; free between `shortest` and `longest` where they differ."""

    guess: float
    shortest: float
    longest: float

    @classmethod
    def fixed(cls, duration):
        return cls(duration, duration, duration)

    @property
    def free(self):
        return self.longest > self.shortest


class Transcription:
    """Places of all unknowns and the parts every plan has. shares [N]: of the duration, adding up to 1."""

    def __init__(
        self, system: System, scheme: Scheme, shares, span: Span, *, inputs="points", continuous=False,
        staged=False, hessian=EXACT, tempo=None, halfway=False,
    ):  # fmt: skip
        self.system, self.scheme, self.shares, self.span = system, scheme, np.asarray(shares, dtype=float), span
        self.inputs, self.continuous, self.staged = inputs, continuous or scheme.shared, staged
        self.program, self._fractions = Parts(hessian), self._halves() if halfway else np.zeros(0)
        tempo = tempo or span.guess
        self.scales = {"q": system.q, "v": system.q / tempo, "a": system.q / tempo**2, "u": system.u,
                       "T": np.array([span.guess])}  # fmt: skip
        self._place()
        self._equation()
        self._defects()
        self._tied()
        self._shaped()
        if staged or span.free:
            self._links()

    @property
    def N(self):
        return self.shares.size

    def _place(self):
        """self.node[letter] [N+1 x size], self.point[letter] [N x s x size], self.halfway, self.lead: places in x."""
        held = ["q", "v", *["a"] * self.scheme.shared, *["u"] * self.continuous, *["T"] * self.span.free]
        own_lead = self.inputs == "linear" and not self.continuous
        layout = Layout(self.scheme, self.N, self.scales, held, apart=self.staged, halves=self._fractions.size,
                        lead=own_lead)  # fmt: skip
        self.program.block(layout.scale.size, scale=layout.scale)
        self.node, self.point, self.halfway, self.lead = layout.node, layout.point, layout.halfway, layout.lead
        if self.inputs == "linear" and self.continuous:
            self.lead = self.node["u"][:-1]
        self.program.states = np.hstack(list(self.node.values()))
        if self.span.free:
            self.program.guess[self.node["T"]] = self.span.guess
            self.hold("T", self.node["T"], self.span.shortest, self.span.longest)

    def duration_at(self, nodes):
        """{letter: places} of the duration for parts at nodes: nothing where it is fixed."""
        return {"T": self.node["T"][nodes]} if self.span.free else {}

    def duration(self, found):
        """SX of the duration from what a part was given beside its other unknowns."""
        return found[0] if self.span.free else ca.SX(self.span.guess)

    def _equation(self):
        system = self.system

        def missing(q, v, a, u):
            return {"rows": system.residual(q, v, a, u), "scale": system.force, "units": "scaled"}

        first = 1 if self.scheme.shared else 0
        blocks = {x: self._flat(self.point[x][:, first:]) for x in "qvau"}
        when = np.repeat(np.arange(self.N), self.scheme.size - first)
        if first:
            blocks = {x: np.vstack([self.point[x][:1, 0], rows]) for x, rows in blocks.items()}
            when = np.concatenate([[0], when])
        self.program.add("equation of motion", blocks, missing, when=when)

    @staticmethod
    def _flat(places):
        return places.reshape(-1, places.shape[-1])

    def _defects(self):
        scheme, n = self.scheme, self.system.n
        first = 1 if scheme.shared else 0
        rates, positions = scheme.rates(scheme.c)[first:], scheme.positions(scheme.c)[first:]
        c, count = scheme.c[first:], scheme.size - first
        units = self.scales["q"], self.scales["v"]

        def defects(q, v, points_q, points_v, a, *rest):
            h = rest[-1] * self.duration(rest)
            a = ca.reshape(a, n, scheme.size)
            gap_v = ca.reshape(points_v, n, count) - ca.repmat(v, 1, count) - h * (a @ ca.DM(rates.T))
            gap_q = ca.reshape(points_q, n, count) - ca.repmat(q, 1, count)
            gap_q = gap_q - h * v @ ca.DM(c).T - h**2 * (a @ ca.DM(positions.T))
            scale = [np.tile(unit, count) for unit in units]
            return {"rows": ca.vertcat(ca.vec(gap_q), ca.vec(gap_v)), "scale": np.concatenate(scale)}

        flat = {x: self.point[x][:, first:].reshape(self.N, -1) for x in "qv"}
        blocks = {"q": self.node["q"][:-1], "v": self.node["v"][:-1], "qs": flat["q"], "vs": flat["v"],
                  "as": self.point["a"].reshape(self.N, -1), **self.duration_at(slice(0, self.N))}  # fmt: skip
        self.program.add("defects", blocks, defects, numbers=self.shares[:, None], linking=not self.staged)

    def _links(self):
        """From the end of an interval to the node after it; the duration from node to node."""
        letters = [x for x in self.node if x != "T"] if self.staged else []
        here = [self.point[x][:, -1] for x in letters] + ([self.node["T"][:-1]] if self.span.free else [])
        there = [self.node[x][1:] for x in letters] + ([self.node["T"][1:]] if self.span.free else [])
        blocks = {"here": np.hstack(here), "there": np.hstack(there)}
        rows = lambda here, there: {"rows": there - here}  # noqa: E731  scaled alike: their slopes are 1 to the last digit
        self.program.add("links", blocks, rows, linking=True, hats=True)

    def at_points(self, name, expression, *, weights=False, **limits):
        """Parts at every point: expression(q, v, a, u, T, data); data ends with the quadrature weight, of the whole."""
        first = 1 if self.scheme.shared and not weights else 0
        blocks = {x: self._flat(self.point[x][:, first:]) for x in "qvau"}
        when = np.repeat(np.arange(self.N), self.scheme.size - first)
        blocks |= self.duration_at(when)
        numbers = (self.shares[:, None] * self.scheme.weights[None, first:]).reshape(-1, 1)
        extra = limits.pop("numbers", None)
        numbers = numbers if extra is None else np.hstack([extra, numbers])

        def part(q, v, a, u, *rest):
            return expression(q, v, a, u, self.duration(rest), rest[-1])

        self.program.add(name, blocks, part, numbers=numbers, when=when, **limits)

    def _halves(self):
        """Fractions half way between neighbouring points."""
        c = np.unique([0.0, *self.scheme.c])
        return (c[1:] + c[:-1]) / 2

    def _tied(self):
        """The unknowns half way between points are the coordinates there."""
        scheme, n, fractions = self.scheme, self.system.n, self._fractions

        def tied(place, q, v, a, *rest):
            data, T = rest[-1], self.duration(rest)
            h, x, weights = data[0] * T, data[1], data[2:]
            own = q + h * x * v + h**2 * (ca.reshape(a, n, scheme.size) @ weights)
            return {"rows": place - own, "scale": self.scales["q"]}

        when = np.repeat(np.arange(self.N), fractions.size)
        blocks = {"place": self.halfway.reshape(-1, n), "q": self.node["q"][when], "v": self.node["v"][when],
                  "a": self.point["a"].reshape(self.N, -1)[when], **self.duration_at(when)}  # fmt: skip
        numbers = np.tile(np.column_stack([fractions, scheme.positions(fractions)]), (self.N, 1))
        self.program.add("between", blocks, tied, numbers=np.column_stack([self.shares[when], numbers]), when=when)

    def _shaped(self):
        """Inputs that are linear or constant in an interval: the points follow from its ends."""
        if self.inputs == "points":
            return
        first, m = int(self.scheme.shared), self.system.m
        c = self.scheme.c[first:-1] if self.inputs == "linear" else np.ones(self.scheme.size - 1 - first)
        if not c.size:
            return
        last, points = self.point["u"][:, -1], self.point["u"][:, first:-1].reshape(self.N, -1)
        lead = self.lead if self.inputs == "linear" else np.zeros((self.N, 0), dtype=int)

        def off(points, last, *lead):
            ways = last @ ca.DM(c).T + (lead[0] @ ca.DM(1 - c).T if lead else 0)
            return {"rows": points - ca.vec(ways), "scale": np.tile(self.scales["u"], c.size)}

        blocks = {"points": points, "last": last, **({"lead": lead} if m and lead.size else {})}
        self.program.add("inputs", blocks, off)

    def rates_of_inputs(self):
        """Of a continuous input where its rate may differ: blocks, numbers, intervals, and the expression of ud [m]."""
        scheme, m, knots = self.scheme, self.system.m, self.knots
        fractions, weights = (scheme.c, scheme.weights) if self.inputs == "points" else (np.array([0.5]), np.ones(1))

        def rate(u, *rest):
            data, T = rest[-1], self.duration(rest)
            return ca.reshape(u, m, -1) @ data[1:-1] / (data[0] * T)

        when = np.repeat(np.arange(self.N), fractions.size)
        weights = (self.shares[:, None] * weights).reshape(-1, 1)
        numbers = np.hstack([self.shares[when][:, None], np.tile(slopes(knots, fractions), (self.N, 1)), weights])
        return {"u": self.input_knots().reshape(self.N, -1)[when], **self.duration_at(when)}, numbers, when, rate

    def input_rates(self, name, expression, **limits):
        """Parts at every point of a continuous input: expression(ud, T, weight [1/s of the whole])."""
        blocks, numbers, when, rate = self.rates_of_inputs()

        def part(u, *rest):
            return expression(rate(u, *rest), self.duration(rest), rest[-1][-1])

        self.program.add(name, blocks, part, numbers=numbers, when=when, **limits)

    def at_node(self, name, k, expression, letters="qv", **limits):
        """A part at one node: expression(*unknowns of `letters`)."""
        blocks = {x: self.node[x][k : k + 1 or None] for x in letters}
        self.program.add(name, blocks, expression, when=[k % (self.N + 1)], **limits)

    def hold(self, letter, places, lower, upper):
        """Limits (SI) of unknowns at places."""
        places = np.asarray(places)
        for own, value, best in ((self.program.lower, lower, np.maximum), (self.program.upper, upper, np.minimum)):
            own[places] = best(own[places], value)

    def everywhere(self, letter, lower, upper):
        """Limits (SI) of a letter at all nodes and points."""
        self.hold(letter, self.places(letter), np.asarray(lower, dtype=float), np.asarray(upper, dtype=float))

    def places(self, letter):
        """Places [K x size] of a letter at all nodes and points, each once, in the order of x."""
        rows = [self._flat(self.point[letter])]
        rows += [self.node[letter]] if letter in self.node else []
        rows += [self.lead] if letter == "u" else []
        return np.unique(np.vstack(rows), axis=0)

    @property
    def knots(self):
        """Fractions [p] whose values make the inputs of an interval."""
        return self.scheme.knots(self.inputs, self.continuous)

    def input_knots(self):
        """Places [N x p x m] of what makes the polynomials of the inputs."""
        if self.inputs == "linear":
            return np.stack([self.lead, self.point["u"][:, -1]], axis=1)
        if self.inputs == "constant":
            return self.point["u"][:, -1:]
        if not self.continuous or self.scheme.shared:
            return self.point["u"]
        return np.concatenate([self.node["u"][:-1, None], self.point["u"]], axis=1)

    def filled(self, q, v, a, u, duration):
        """x [SI] from functions of the share of the duration, each giving rows."""
        x = self.program.guess.copy()
        nodes = np.concatenate([[0.0], np.cumsum(self.shares)])
        points = (nodes[:-1, None] + self.shares[:, None] * self.scheme.c).ravel()
        if self._fractions.size:
            x[self._flat(self.halfway)] = q((nodes[:-1, None] + self.shares[:, None] * self._fractions).ravel())
        for letter, function in (("q", q), ("v", v), ("a", a), ("u", u)):
            x[self._flat(self.point[letter])] = function(points)
            if letter in self.node:
                x[self.node[letter]] = function(nodes)
        if self.lead.size:
            x[self.lead] = u(nodes[:-1])
        if self.span.free:
            x[self.node["T"]] = duration
        return x

    def at_all_points(self, x):
        """{q, qd, qdd, u}: rows [N s x size] of SI values x."""
        names = {"q": "q", "v": "qd", "a": "qdd", "u": "u"}
        return {name: x[self._flat(self.point[letter])] for letter, name in names.items()}

    def planned(self, x):
        """Planned motion of SI values x."""
        duration = float(x[self.node["T"][0, 0]]) if self.span.free else self.span.guess
        return Planned(self.scheme, duration, self.shares, x[self.node["q"]], x[self.node["v"]], x[self.point["a"]],
                       x[self.input_knots()], self.knots)  # fmt: skip
