"""Friction of cables against what guides them: the tension falls as the cable turns.

    T(s) = T_motor exp(-mu moving theta(s)),
theta the turn of the cable's tangent from its motor on, kinks included, and moving = 1 while the cable is pulled in,
-1 while it is let out. Inside a section, with v = p + k x d + d' along the cable and t = v / |v|,
    dtheta/ds = |(I - t t^T)(k x d' + d'' + k x v)| / |v|.
Turns have a floor, x -> x^2 / sqrt(x^2 + TURN_FLOOR^2), that keeps them smooth where a cable is straight. The force is
    tau = -int exp(-mu moving theta) Phi^T E^T t ds   for unit input,
so that what one section does depends on all before it. In motion moving = -l' / sqrt(l'^2 + CREEP^2), l the length.
Source of the law: L. Euler, J. Eytelwein (capstan equation).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.mechanics.courses import body
from socontrol.mechanics.lines import Chord, RodLine, line_element
from socontrol.model.quadrature import gauss_legendre

TURN_FLOOR = 1e-5  # rad: a turn of 0.1 rad is 5e-10 rad too small, none by more than 3e-6 rad
CREEP = 1e-3  # m/s: friction takes its full size well above this rate of the cable
POINTS = 8  # Gauss points of the mean of exp(-z x) over a section, 1e-10 at z = 2 pi
INSIDE = (0.25, 0.5, 0.75)  # x of the stations inside a section


@lru_cache(maxsize=1)
def turning_element():
    """Function (xi, d', d'', |v|, t) -> (dtheta/ds)^2 [rad^2/m^2], made once and inlined."""
    xi, slope, bend, t = ca.SX.sym("xi", 6), ca.SX.sym("slope", 3), ca.SX.sym("bend", 3), ca.SX.sym("t", 3)
    size = ca.SX.sym("size")
    change = ca.cross(xi[:3], slope) + bend + size * ca.cross(xi[:3], t)
    across = (change - t * ca.dot(t, change)) / size
    return ca.Function("turning_element", [xi, slope, bend, size, t], [ca.dot(across, across)])


def floored(square, floor=TURN_FLOOR):
    """x^2 / sqrt(x^2 + floor^2) of x^2: x without its corner at 0."""
    return square / ca.sqrt(square + floor**2)


def kink(a, b):
    """Angle [rad] between the unit vectors a and b [3], floored."""
    turn = ca.cross(a, b)
    angle = ca.atan2(ca.sqrt(ca.dot(turn, turn) + TURN_FLOOR**2), ca.dot(a, b))
    return angle - TURN_FLOOR**2 / angle


@lru_cache(maxsize=64)
def running(count, places=None):
    """Weights [places x count] of int_0^x f at the Gauss points, or at `places` x in [0, 1], from f at the points."""
    nodes = np.array(gauss_legendre(count)[0])
    x = nodes if places is None else np.array(places)
    values = np.polynomial.legendre.legvander(2 * nodes - 1, count - 1)
    integrals = [np.polynomial.legendre.legint(row, lbnd=-1) for row in np.eye(count)]
    totals = np.stack([np.polynomial.legendre.legval(2 * x - 1, integral) for integral in integrals], axis=1) / 2
    return totals @ np.linalg.inv(values)


class Turned:
    """One share of a cable at q: its turn, and forces and tensions along it for unit tension at its start."""

    def __init__(self, tree, line, q):
        self.tree, self.line, self.q, self.piece = tree, line, q, tree.pieces[line.piece]
        self.wraps = isinstance(line, RodLine)
        if not self.wraps:
            return
        span, xi = line.part[1] - line.part[0], self.piece.strain(q)
        self.size, self._even, self.count = span * self.piece.length, line.route.parallel, len(line.nodes)
        self.speeds, self.pulls, self.rates = [], [], []
        for node, (_, d, slope) in zip(gauss_legendre(self.count)[0], line.nodes, strict=True):
            bend = ca.DM(3, 1) if self._even else line.route.bend(line.part[0] + span * node)
            size, pull, _ = line_element()(xi, d, slope)
            square = turning_element()(xi, slope, bend, size, pull[3:])
            self.speeds.append(size)
            self.pulls.append(pull)
            self.rates.append(floored(square, TURN_FLOOR / self.size))

    @cached_property
    def turn(self):
        """theta [rad] from its start to its end."""
        if not self.wraps:
            return ca.DM(0)
        return self.size * sum(w * rate for w, rate in zip(gauss_legendre(self.count)[1], self.rates, strict=True))

    def turns(self, places):
        """theta [rad] from its start to x in [0, 1] of what it covers, for each of `places`; None: its Gauss points."""
        return [self.size * total for total in self._summed(self.rates, places)]

    def lengths(self, places):
        """Length [m] from its start to each of `places`."""
        return [self.size * total for total in self._summed(self.speeds, places)]

    def _summed(self, values, places=None):
        rows = running(self.count, places)
        return [sum(float(w) * value for w, value in zip(row, values, strict=True)) for row in rows]

    def force(self, z):
        """Generalised force [n_i], z = mu moving; without friction that of the line."""
        if not self.wraps:
            return self.line.force(self.tree, self.q)
        if self._even:
            nodes, weights = gauss_legendre(POINTS)
            pull = sum(w * ca.exp(-z * self.turn * x) for x, w in zip(nodes, weights, strict=True)) * self.pulls[0]
        else:
            decay = [ca.exp(-z * theta) for theta in self.turns(None)]
            weights = gauss_legendre(self.count)[1]
            pull = sum(w * e * F for w, e, F in zip(weights, decay, self.pulls, strict=True))
        return self.line.gain * self.size * (self.piece.Phi.T @ pull)

    @cached_property
    def ends(self):
        """Direction [3] where it begins and where it ends, with the frames (piece, at x = 1) they are seen from."""
        i, line = self.line.piece, self.line
        if self.wraps:
            first, last = (line.direction(self.tree, self.q, x) for x in line.part)
            return (first, (i, False)), (last, (i, True))
        if isinstance(line, Chord):
            first, last = line.directions(self.tree, self.q)
            return (first, (i, False)), (last, (i, True))
        return ((line.direction(), (i, line.moved)),) * 2


@dataclass(frozen=True)
class Capstan:
    """One cable that rubs: its lines in order, coefficient mu and direction of moving at rest."""

    lines: tuple
    mu: Any
    moving: Any

    def column(self, tree, q, moving):
        """[n] generalised force for unit tension at the motor."""
        parts = [ca.DM(piece.size, 1) for piece in tree.pieces]
        for share, theta in self.shares(tree, q):
            parts[share.line.piece] += ca.exp(-self.mu * moving * theta) * share.force(self.mu * moving)
        return ca.vertcat(*parts)

    def shares(self, tree, q):
        """(Turned, theta where it begins) of each line from the motor on."""
        theta, before = ca.DM(0), None
        for line in self.lines:
            share = Turned(tree, line, q)
            if before is not None:
                theta = theta + kink(_seen(tree, before, share.ends[0][1]), share.ends[0][0])
            yield share, theta
            theta, before = theta + share.turn, share.ends[1]

    def direction(self, tree, q, qd):
        """moving in motion: -l' / sqrt(l'^2 + CREEP^2)."""
        rate = sum(ca.dot(line.force(tree, q), qd[tree.pieces[line.piece].columns]) / line.gain for line in self.lines)
        return -rate / ca.sqrt(rate**2 + CREEP**2)


def stations(tree, lines, q, mu=0.0, moving=1.0):
    """(s [k, m] along a cable at q, tension over that at the motor [k]) where its shares begin and end and inside."""
    s, ratios, here = [], [], ca.DM(0)
    for share, theta in Capstan(tuple(lines), mu, moving).shares(tree, q):
        if share.wraps:
            places = (0.0, *INSIDE, 1.0)
            along, turns = share.lengths(places), share.turns(places)
        else:
            along, turns = (0, share.line.length(tree, q)), (0, 0)
        s += [here + way for way in along]
        ratios += [ca.exp(-mu * moving * (theta + turn)) for turn in turns]
        here = s[-1]
    return ca.vertcat(*s), ca.vertcat(*ratios)


def _seen(tree, end, frame):
    """A direction [3] given as (direction, frame), in another frame of the same rigid body."""
    t, own = end
    if own == frame:
        return t
    for (i, moved), there in ((own, True), (frame, False)):
        g, _ = body(tree, i, moved)
        if g is not None:
            R = se3.rotation(g)
            t = (R if there else R.T) @ t
    return t


class Friction:
    """The cables of a robot that rub, {input: Capstan}: columns of B and their exact derivatives.

    Derivatives need symbols, so each expression is a Function made once, called with whatever q is. Those in motion
    follow by the chain rule from the columns as functions of q and of the directions of moving.
    """

    def __init__(self, tree, capstans):
        self.tree, self.capstans = tree, capstans
        sizes = {"q": tree.n, "qd": tree.n, "u": len(capstans), "lam": tree.n, "moving": len(capstans)}
        self._symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        self._made = {}

    def __bool__(self):
        return bool(self.capstans)

    @property
    def inputs(self):
        """Indices of the inputs that rub, rising."""
        return tuple(self.capstans)

    def by_input(self, columns):
        """{input: its column}."""
        return dict(zip(self.inputs, ca.horzsplit(columns), strict=True))

    def columns(self, q, qd=None):
        """[n x k] columns of B of these inputs, at rest or in motion."""
        return self._call("columns", lambda: self._columns, q, qd)

    def slope(self, q, u, qd=None):
        """d(B u)/dq [n x n], u [k] of these inputs, at rest or in motion."""
        own = self._call("slope", lambda: self._derivative("q"), q, qd, u)
        return own if qd is None else own + self._turned("q", q, u, qd)

    def drag(self, q, u, qd):
        """d(B u)/dqd [n x n] in motion."""
        return self._turned("qd", q, u, qd)

    def gradient(self, q, lam):
        """Column a: d(lam . B_a)/dq [n x k], at rest."""
        q_symbol, lam_symbol = self._symbols["q"], self._symbols["lam"]
        return self._call("gradient", lambda: ca.jacobian(self._columns.T @ lam_symbol, q_symbol).T, q, lam=lam)

    def ratio(self, k, line, q, x):
        """Tension of input k at x of one of its lines, on a rod, over that at the motor, at rest."""
        capstan = self.capstans.get(k)
        if capstan is None or not isinstance(line, RodLine) or not line.part[0] <= x <= line.part[1]:
            return 1
        share, theta = next(found for found in capstan.shares(self.tree, q) if found[0].line is line)
        inner = (x - line.part[0]) / (line.part[1] - line.part[0])
        return ca.exp(-capstan.mu * capstan.moving * (theta + share.turns((inner,))[0]))

    @cached_property
    def _columns(self):
        """[n x k] of the symbols q and moving."""
        directions = ca.vertsplit(self._symbols["moving"])
        rows = zip(self.capstans.values(), directions, strict=True)
        return ca.SX(ca.horzcat(*(c.column(self.tree, self._symbols["q"], moving) for c, moving in rows)))

    def _turned(self, key, q, u, qd):
        """d(B u)/dmoving dmoving/d(q or qd) [n x n]."""
        across = self._call("across", lambda: self._derivative("moving"), q, qd, u)
        turning = self._call(f"turning_{key}", lambda: ca.jacobian(self._directions, self._symbols[key]), q, qd)
        return across @ turning

    def _derivative(self, key):
        """d(B u)/d(q or moving) of the symbols."""
        return ca.jacobian(self._columns @ self._symbols["u"], self._symbols[key])

    @cached_property
    def _directions(self):
        """Directions of moving [k] of the symbols q and qd."""
        q, qd = self._symbols["q"], self._symbols["qd"]
        return ca.vertcat(*(c.direction(self.tree, q, qd) for c in self.capstans.values()))

    def _call(self, name, expression, q, qd=None, u=None, lam=None):
        """The value of an expression of the symbols; `moving` is that at rest, or in motion where qd is given."""
        if name == "directions":
            moving = None
        elif qd is None:
            moving = ca.vertcat(*(c.moving for c in self.capstans.values()))
        else:
            moving = self._call("directions", lambda: self._directions, q, qd)
        if name not in self._made:
            result, own = ca.densify(ca.SX(expression())), [*self._symbols.values()]
            free = [x for x in ca.symvar(result) if not any(ca.depends_on(y, x) for y in own)]
            self._made[name] = ca.Function(name, [*own, *free], [result]), free
        function, free = self._made[name]
        return function(*(0 if x is None else x for x in (q, qd, u, lam, moving)), *free)
