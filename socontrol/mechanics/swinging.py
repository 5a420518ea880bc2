"""How a section of rod swings: the sums over its slices that the Coriolis matrix is made of.

A mass point at r adds m J^T J' to C, with J the map from all rates to its velocity. The slices of an arc lie at
r = u phi, so that all sums follow from one table of products of weights, see `lie.motion`; rotary inertia is taken as
mass points too.
"""

from functools import lru_cache

import casadi as ca

from socontrol.lie.motion import Arc, Motion, MovingArc
from socontrol.mechanics.slices import Section, axes, moments, product, spatial


class Points(MovingArc):
    """Mass points at r = u phi of an arc that moves with its base, and sums over them; axes of the base, held still.

    With phi = (s, phi_2, phi_3) they lie on the centreline. The arc of the twist [k; e] with these weights
    differentiated in s, phi = (1, phi_1, phi_2), has them at the tips of R e. Everything follows from a table of the
    sums of m times two of the weights 1, phi [3], slope [2] and bend [2]. `sums` [8] below are one of its columns, or
    the weights of one place; `parts` the sums of the weights 1, phi, slope times f [3 x n].
    """

    def __init__(self, xi, xid, w):
        super().__init__(xi, xid, ca.DM(6, 1), Motion(w, *[ca.DM(3, 1)] * 3))
        k, p, kd, pd = xi[:3], xi[3:], xid[:3], xid[3:]
        K, Kd, W, square = ca.skew(k), ca.skew(kd), ca.skew(w), self.A((0, 0, 1))
        y, Q_rate = 2 * ca.dot(k, kd), kd @ p.T + k @ pd.T - 2 * (p @ kd.T + pd @ k.T)
        Q_rate += (ca.dot(kd, p) + ca.dot(k, pd)) * ca.DM.eye(3)
        self._slide_rates = W, W @ K + Kd, W @ square + Kd @ K + K @ Kd, y * K, y * square
        self._reach_rates = -(W @ ca.skew(p) + ca.skew(pd)), W @ self.Q + Q_rate, -y * ca.skew(p), y * self.Q
        self._kd, self._rates, self._table = kd, ca.horzcat(ca.DM(3, 1), *self._velocity), ca.DM(8, 8)

    def add(self, m, weights):
        """Add a mass at the weights 1, phi, slope, bend [8]."""
        self._table += product(m, weights)

    def columns(self):
        """The sums [8] of m times all weights times each of 1, phi, slope."""
        return ca.horzsplit(ca.tril2symm(self._table)[:, :6])

    def slide_rate(self, sums):
        """Rate of dr/dp [3 x 3]."""
        return sum(a * part for a, part in zip(ca.vertsplit(sums[1:6]), self._slide_rates, strict=True))

    def reach_rate(self, sums):
        """Rate of dr/dk [3 x 3]."""
        sweep, stretch = self._velocity
        spread = sweep[:, 1:] @ sums[4:6] + stretch @ sums[6:]
        bent = spread @ (2 * self.k).T + (self.u[:, 1:] @ sums[4:6]) @ (2 * self._kd).T
        return sum((a * part for a, part in zip(ca.vertsplit(sums[2:6]), self._reach_rates, strict=True)), bent)

    def velocity(self, sums):
        """r' [3]."""
        return self._rates @ sums[:6]

    def tangent_rate(self, at):
        """Rate of the tangent map [6 x 6], the twist about the point where the base's origin is now."""
        weights = ca.vertcat(1, at.phi, at.slope, at.bend)
        slide = self.slide_rate(weights)
        turned = ca.skew(self.velocity(weights)) @ self.A(at.phi) + ca.skew(self.position(at)) @ slide
        return ca.blockcat([[slide, ca.DM(3, 3)], [self.reach_rate(weights) + turned, slide]])

    def spread(self):
        """sum m r' r^T [3 x 3]."""
        return self._rates @ ca.horzcat(*self.columns())[:6, 1:4] @ self.u.T

    def levers(self, parts):
        """sum r x f [3 x n]."""
        return sum(ca.skew(u) @ part for u, part in zip(ca.horzsplit(self.u), parts[1:4], strict=True))

    def lever_rates(self, parts):
        """sum r' x f [3 x n]."""
        return sum(ca.skew(u) @ part for u, part in zip(ca.horzsplit(self._rates), parts, strict=True))

    def pulled(self, parts):
        """sum (dr/dk)^T f [3 x n]."""
        bent = self.u[:, 1].T @ parts[4] + self.u[:, 2].T @ parts[5]
        return ca.skew(self.p) @ parts[2] + self.Q.T @ parts[3] + 2 * self.k @ bent


class Swung:
    """B [6 x 6], F, D [6 x 6 each] and own [6 x 6] of a moving arc with slices, for the base's twist and the rate of
    xi: sums of m E^T E', E^T g', E'^T g and g^T g' with E and g the maps from these rates to the velocity of a point.

    Rotary inertia J = Jyy I + sum d e e^T is that of Jyy + sum d for any axis, which turns with A, less mass points d
    at the tips of e. What is left of a slice's inertia M is no sum of points, see `_add_rest`.
    """

    def __init__(self, xi, xid, twist, shape, wet):
        unit, w = ca.DM.eye(3), twist[:3]
        self.shape, self.wet, self.line, self._going = shape, wet, Points(xi, xid, w), twist[3:]
        self.tips = {
            a: Points(ca.vertcat(xi[:3], unit[:, a]), ca.vertcat(xid[:3], 0, 0, 0), w)
            for a in ((0,) if shape == "round" else (0, 2))
        }
        self._turns, self._rest = ca.DM(8, 8), [ca.DM(6, 6)] * 4

    def add(self, at, row):
        """Add the slice of a column of the table, at the place `at` belongs to."""
        s, (_, two, three), uneven = at.phi[0], ca.vertsplit(at.phi), axes(row, self.shape)
        weights = ca.vertcat(1, at.phi, at.slope, at.bend)
        self.line.add(row[0], weights)
        self._turns += product(row[4] + sum(uneven.values()), weights)
        slope, bend = (three - s * two) / 2, (at.slope[1] - s * at.slope[0]) / 2  # of phi_1
        tip = ca.vertcat(1, 1, at.turn, two, slope, at.slope[0], bend, at.bend[0])
        for axis, inertia in uneven.items():
            self.tips[axis].add(-inertia, tip)
        if self.shape == "any" or self.wet:
            self._add_rest(at, row, weights)

    def _add_rest(self, at, row, weights):
        """J^T (M J' - S(M V) J) in the axes of the slice, whose twist is V and twists J for all rates [6 x 12]."""
        line, none, unit = self.line, ca.DM(3, 3), ca.DM.eye(3)
        _, h, J = moments(row, self.shape)
        M = spatial(0, h, J - ca.diag(ca.diag(J)))
        if self.wet:
            M = M + ca.diag(ca.vertcat(0, 0, 0, 0, row[12], row[13]))
        R, A, r = line.rotation(at), line.A(at.phi), line.position(at)
        w, v, A_rate = line.motion(at).w, line.velocity(weights), line.slide_rate(weights)
        reach = line.reach(at.phi, at.slope)
        turn, go = ca.horzcat(unit, none, A, none), ca.horzcat(-ca.skew(r), unit, reach, A)
        turn_rate = ca.horzcat(none, none, A_rate, none)
        go_rate = ca.horzcat(-ca.skew(v), none, line.reach_rate(weights), A_rate)
        W, back = ca.skew(w), ca.diagcat(R.T, R.T)
        rates = back @ ca.vertcat(turn_rate - W @ turn, go_rate - W @ go)
        momentum = M @ (back @ ca.vertcat(w, self._going + v))
        m, f = ca.skew(R @ momentum[:3]), ca.skew(R @ momentum[3:])
        wrench = back.T @ (M @ rates) - ca.vertcat(m @ turn + f @ go, f @ turn)
        moment, force = wrench[:3, :], wrench[3:, :]
        by_base = ca.vertcat(moment + ca.skew(r) @ force, force)
        by_own = ca.vertcat(A.T @ moment + reach.T @ force, A.T @ force)
        parts = by_base[:, :6], by_base[:, 6:], by_own[:, :6].T, by_own[:, 6:]
        self._rest = [before + part for before, part in zip(self._rest, parts, strict=True)]

    def total(self):
        """B, F, D and own."""
        line, none = self.line, ca.DM(3, 3)
        columns = line.columns()
        places = [ca.horzcat(line.reach(c[1:4], c[4:6]), line.A(c[1:4])) for c in columns]
        rates = [ca.horzcat(line.reach_rate(c), line.slide_rate(c)) for c in columns]
        turns = [line.slide_rate(c) for c in ca.horzsplit(ca.tril2symm(self._turns)[:, :4])]
        spread, moment, swing = line.spread(), turns[0], none
        own_k = line.back(*turns[1:])
        for tip in self.tips.values():
            columns_e = tip.columns()
            rates_e = [tip.reach_rate(c) for c in columns_e]
            spread += tip.spread()
            moment += tip.levers(rates_e)
            swing += tip.lever_rates([tip.reach(c[1:4], c[4:6]) for c in columns_e])
            own_k += tip.pulled(rates_e)
        own = (
            swung(spread, line.velocity(columns[0])),
            ca.vertcat(line.levers(rates) + ca.horzcat(moment, none), rates[0]),
            ca.vertcat(line.lever_rates(places) + ca.horzcat(swing, none), ca.DM(3, 6)),
            ca.vertcat(line.pulled(rates) + ca.horzcat(own_k, none), line.back(*rates[1:4])),
        )
        return [rest + part for rest, part in zip(self._rest, own, strict=True)]


def swung(spread, momentum):
    """B = sum m E^T E' [6 x 6], E = [-r~ I], of mass points with the sums of m r' r^T [3 x 3] and m r' [3]."""
    none = ca.DM(3, 3)
    return ca.blockcat([[ca.trace(spread) * ca.DM.eye(3) - spread, none], [-ca.skew(momentum), none]])


@lru_cache(maxsize=256)
def coriolis_kernel(nodes, places, *kind):
    """Function (q, qd, base twist [6], xi_bar, length, data) -> bb, bq; B, F, D, own of `Swung` for q; then for each
    of `places` pose, S [6 x n] and its rate in axes held still, about a point that goes on with the base's origin."""
    section = Section(nodes, *kind)
    Phi, arc = section.Phi, Arc(section.xi)
    sums = Swung(section.xi, Phi @ section.qd, section.twist, section.shape, section.wet)
    slices = section.slices(arc)
    for at, row in slices:
        sums.add(at, row)
    B, F, D, own = sums.total()
    outputs = [*section.weighed(arc, slices)[:2], B, F @ Phi, D @ Phi, Phi.T @ own @ Phi]
    for x in places:
        at = arc.weights(x * section.length, x)
        outputs += [arc.pose(at), arc.tangent(at) @ Phi, sums.line.tangent_rate(at) @ Phi]
    inputs = [section.q, section.qd, section.twist, *section.constants]
    return ca.Function("section_coriolis", inputs, ca.cse(outputs))
