"""What the slices of a section of rod, and the body on a joint, feel and weigh while they move.

Newton-Euler of a slice with mass m, first moment h and inertia J (body axes, about its point), dw and a as in
`lie.motion`:  force = m a + dw x h + w x (w x h),  moment = J dw + w x J w + h x a.
Added mass N = diag(Na, Nv) acts on the velocity against the water, n = v - v_water:
force = Nv n' + w x Nv n,  moment = Na dw + w x Na w + n x Nv n   (' in body axes); drag opposes n.
Sums are kernels: CasADi Functions made once for a number of Gauss points, inlined for SX, called for MX.
Sources: F. Renda et al., T-RO 2018; R. Featherstone, "Rigid Body Dynamics Algorithms", 2008.
"""

from functools import lru_cache

import casadi as ca

from socontrol.lie import se3
from socontrol.lie.motion import Arc, Collected, Motion, MovingArc, from_stack

STILL = 1e-9  # m/s, below all speeds of interest: keeps |n| smooth where the water is still
DRY = ("m", "hy", "hz", "Jxx", "Jyy", "Jzz", "Jyz")
MASSES = frozenset({"dry", "added"})
WET = ("tangential", "normal", "lift", "linear_tangential", "linear_normal", "added_y", "added_z")


def speed(n):
    """|n| [1], smooth at 0."""
    return ca.sqrt(ca.dot(n, n) + STILL**2)


def slice_data(piece, parts, water=None):
    """Table [7 or 14 x slices]: weight times what DRY and WET name, 0 for what is not among `parts`."""
    columns, count = [], {"dry": len(DRY), "drag": 5, "added": 2}
    for p in piece.slices:
        M = piece.record.inertia_density(p)
        rows = {"dry": [M[3, 3], M[0, 5], -M[0, 4], M[0, 0], M[1, 1], M[2, 2], M[1, 2]]}
        if water is not None:
            entries = piece.record.fluid_density(p, water)
            rows |= {"drag": entries[:5], "added": entries[5:]}
        entries = [e for part, row in rows.items() for e in (row if part in parts else [0] * count[part])]
        columns.append(p.weight * ca.vertcat(*entries))
    return ca.horzcat(*columns)


def shape(data):
    """Which slices all are: `round`, centred on the rod's axis with Jyy = Jzz; `centred`; or `any`."""
    if _vanishes(data[[1, 2, 6], :]):
        return "round" if _vanishes(data[4, :] - data[5, :]) else "centred"
    return "any"


def _vanishes(X):
    X = ca.SX(X)
    return X.is_constant() and float(ca.sumsqr(ca.DM(X))) == 0


def moments(row, shape):
    """m, h [3] and J [3 x 3] of a column of the table, body axes."""
    if shape != "any":
        return row[0], ca.DM(3, 1), ca.diag(row[3:6])
    J = ca.diag(row[3:6]) + row[6] * ca.DM([[0, 0, 0], [0, 0, 1], [0, 1, 0]])
    return row[0], ca.vertcat(0, row[1], row[2]), J


def axes(row, shape):
    """{axis: its rotary inertia less Jyy} of a column of the table: J = Jyy I + their sum, but for Jyz."""
    uneven = {} if shape == "round" else {2: row[5] - row[4]}
    return {0: row[3] - row[4]} | uneven


def dry_wrench(m, h, J, w, dw, a):
    """Moment and force [3 each] that accelerate a body; all in the same axes."""
    moment = J @ dw + ca.cross(w, J @ w)
    if h.nnz():
        moment += ca.cross(h, a)
        return moment, m * a + ca.cross(dw, h) + ca.cross(w, ca.cross(w, h))
    return moment, m * a


def added_wrench(Na, Nv, w, dw, n, a):
    """Moment and force [3 each] that accelerate the water along with a body, body axes; Na, Nv are diagonals [3]."""
    rate = a - ca.cross(w, n)
    moment = Na * dw + ca.cross(w, Na * w) + ca.cross(n, Nv * n)
    return moment, Nv * rate + ca.cross(w, Nv * n)


def slice_drag(row, n):
    """Force [3] of the water on a slice that moves at n [3] against it, body axes."""
    t, c, lift, linear_t, linear_n = (row[i] for i in range(7, 12))
    turning = ca.vertcat(t * n[0], c * n[1] + lift * n[2], c * n[2] - lift * n[1])
    return -speed(n) * turning - ca.vertcat(linear_t, linear_n, linear_n) * n


def _slice_wrench(row, shape, wet, arc, at, water):
    """Moment and force [3 each] on a slice to move it as it moves on the arc, axes of the base."""
    R, moving = arc.rotation(at), arc.motion(at)
    w, dw = moving.w, moving.dw
    if shape == "any":
        moment, force = dry_wrench(*moments(row, shape), *(R.T @ part for part in (w, dw, moving.a)))
        moment, force = R @ moment, R @ force
    else:
        moment, force = row[4] * dw, row[0] * moving.a
        for axis, inertia in axes(row, shape).items():  # the rate of e (e . w) inertia, e an axis of the slice
            e = R[:, axis]
            moment += (inertia * ca.dot(e, dw)) * e + (inertia * ca.dot(e, w)) * ca.cross(w, e)
    if wet:
        n, Nv = R.T @ (moving.v - water), ca.vertcat(0, row[12], row[13])
        turn, push = added_wrench(ca.DM(3, 1), Nv, R.T @ w, R.T @ dw, n, R.T @ moving.a)
        moment += R @ turn
        force += R @ (push - slice_drag(row, n))
    return moment, force


class Weighed:
    """Inertia of an arc with slices: bb, bq and qq [6 x 6 each] of the base's twist and the rate of xi.

    Masses are summed with products of two weights each, rotary inertias axis by axis; the rest of a slice's inertia M
    (first moment, Jyz, added mass) by the maps E_b and E from the twists to that of the slice.
    """

    def __init__(self, arc, shape, wet):
        self.arc, self.shape, self.wet = arc, shape, wet
        self._masses, self._turns, self._sums = ca.DM(6, 6), ca.DM(4, 4), [ca.DM(6, 6)] * 3

    def add(self, at, row):
        """Add the slice of a column of the table, at the place `at` belongs to."""
        arc, none = self.arc, ca.DM(3, 3)
        weights = ca.vertcat(1, at.phi, at.slope)
        self._masses += _product(row[0], weights)
        self._turns += _product(row[4], weights[:4])
        R, A = arc.rotation(at), arc.A(at.phi)
        for axis, inertia in axes(row, self.shape).items():
            e, a = R[:, axis], A[:, axis]
            turned = inertia * e
            self._sum(*(ca.diagcat(part, none) for part in (turned @ e.T, turned @ a.T, inertia * a @ a.T)))
        if self.shape != "any" and not self.wet:
            return
        _, h, J = moments(row, self.shape)
        M = spatial(0, h, J - ca.diag(ca.diag(J)))
        if self.wet:
            M = M + ca.diag(ca.vertcat(0, 0, 0, 0, row[12], row[13]))
        E = ca.blockcat([[A.T, none], [R.T @ arc.reach(at.phi, at.slope), A.T]])  # A^T = R^T A
        E_b = se3.Ad_inv(arc.pose(at))
        ME = M @ E
        self._sum(E_b.T @ M @ E_b, E_b.T @ ME, E.T @ ME)

    def _sum(self, *parts):
        self._sums = [before + part for before, part in zip(self._sums, parts, strict=True)]

    def total(self):
        """bb, bq and qq."""
        arc, eye = self.arc, ca.DM.eye(3)
        masses, turns = (ca.tril2symm(table) for table in (self._masses, self._turns))
        columns = ca.horzsplit(masses)  # one for each of the weights 1, s, phi_2, phi_3, phi_2', phi_3'
        reach = [arc.reach(column[1:4], column[4:]) for column in columns]  # sums of m weight dr/dk
        slide = [arc.A(column[1:4]) for column in columns[:4]]  # sums of m weight dr/dp
        lever = [ca.skew(u) for u in ca.horzsplit(arc.u)]  # r = sum of phi u
        second = arc.u @ masses[1:4, 1:4] @ arc.u.T
        by_k, by_p = (sum(r @ part for r, part in zip(lever, parts[1:4], strict=True)) for parts in (reach, slide))
        by_x = arc.u[:, 1].T @ reach[4] + arc.u[:, 2].T @ reach[5]
        kk = ca.skew(arc.p) @ reach[2] + arc.Q.T @ reach[3] + 2 * arc.k @ by_x + arc.squares(turns[1:, 1:])
        own = (
            spatial(masses[0, 0], arc.u @ masses[1:4, 0], (ca.trace(second) + turns[0, 0]) * eye - second),
            ca.blockcat([[by_k + arc.A(turns[1:, 0]), by_p], [reach[0], slide[0]]]),
            ca.blockcat([[kk, ca.DM(3, 3)], [arc.back(*reach[1:4]), arc.squares(masses[1:4, 1:4])]]),
        )
        bb, bq, qq = (rest + part for rest, part in zip(self._sums, own, strict=True))
        return mirrored(bb), bq, mirrored(qq)


def _product(value, weights):
    """The lower half of value weights weights^T."""
    return ca.tril((value * weights) @ weights.T)


class Points(MovingArc):
    """Mass points at r = u phi of an arc that moves with its base, and sums over them; axes of the base, held still.

    With phi = (s, phi_2, phi_3) they lie on the centreline. The arc of the twist [k; e] with these weights
    differentiated in s, phi = (1, phi_1, phi_2), has them at the tips of R e. Everything follows from a table of the
    sums of m times two of the weights 1, phi [3], slope [2] and bend [2]. `sums` [8] below are one of its columns, or
    the weights of one place; `parts` the sums of the weights 1, phi, slope times f [3 x n].
    """

    def __init__(self, xi, xid, base):
        super().__init__(xi, xid, ca.DM(6, 1), base)
        k, p, kd, pd = xi[:3], xi[3:], xid[:3], xid[3:]
        K, Kd, W, square = ca.skew(k), ca.skew(kd), ca.skew(base.w), self.A((0, 0, 1))
        y, Q_rate = 2 * ca.dot(k, kd), kd @ p.T + k @ pd.T - 2 * (p @ kd.T + pd @ k.T)
        Q_rate += (ca.dot(kd, p) + ca.dot(k, pd)) * ca.DM.eye(3)
        self._slide_rates = W, W @ K + Kd, W @ square + Kd @ K + K @ Kd, y * K, y * square
        self._reach_rates = -(W @ ca.skew(p) + ca.skew(pd)), W @ self.Q + Q_rate, -y * ca.skew(p), y * self.Q
        self._kd, self._rates, self._table = kd, ca.horzcat(base.v, *self._velocity), ca.DM(8, 8)

    def add(self, m, weights):
        """Add a mass at the weights 1, phi, slope, bend [8]."""
        self._table += _product(m, weights)

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

    def __init__(self, xi, xid, base, shape, wet):
        unit, fixed = ca.DM.eye(3), base._replace(v=ca.DM(3, 1))
        self.shape, self.wet, self.base = shape, wet, base
        self.line = Points(xi, xid, base)
        self.tips = {
            a: Points(ca.vertcat(xi[:3], unit[:, a]), ca.vertcat(xid[:3], 0, 0, 0), fixed)
            for a in ((0,) if shape == "round" else (0, 2))
        }
        self._turns, self._rest = ca.DM(8, 8), [ca.DM(6, 6)] * 4

    def add(self, at, row):
        """Add the slice of a column of the table, at the place `at` belongs to."""
        s, (_, two, three), uneven = at.phi[0], ca.vertsplit(at.phi), axes(row, self.shape)
        weights = ca.vertcat(1, at.phi, at.slope, at.bend)
        self.line.add(row[0], weights)
        self._turns += _product(row[4] + sum(uneven.values()), weights)
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
        momentum = M @ (back @ ca.vertcat(w, v))
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
            swinging(spread, line.velocity(columns[0])),
            ca.vertcat(line.levers(rates) + ca.horzcat(moment, none), rates[0]),
            ca.vertcat(line.lever_rates(places) + ca.horzcat(swing, none), ca.DM(3, 6)),
            ca.vertcat(line.pulled(rates) + ca.horzcat(own_k, none), line.back(*rates[1:4])),
        )
        return [rest + part for rest, part in zip(self._rest, own, strict=True)]


def swinging(spread, momentum):
    """B = sum m E^T E' [6 x 6], E = [-r~ I], of mass points with the sums of m r' r^T [3 x 3] and m r' [3]."""
    none = ca.DM(3, 3)
    return ca.blockcat([[ca.trace(spread) * ca.DM.eye(3) - spread, none], [-ca.skew(momentum), none]])


class Section:
    """A section of rod by itself: its symbols, its arc and its slices. `basis`: rows of Phi; `nodes`: fractions."""

    def __init__(self, nodes, basis, shape, wet):
        Phi = ca.DM(basis)
        n = Phi.columns()
        self.q, self.qd, self.qdd = (ca.SX.sym(name, n) for name in ("q", "qd", "qdd"))
        self.base, self.water, self.xi_bar = ca.SX.sym("base", 12), ca.SX.sym("water", 3), ca.SX.sym("xi_bar", 6)
        self.twist, self.centripetal = ca.SX.sym("twist", 6), ca.SX.sym("centripetal", 3)
        self.length, self.data = ca.SX.sym("length"), ca.SX.sym("data", len(DRY) + len(WET) * wet, len(nodes))
        self.constants = [self.xi_bar, self.length, self.data]
        self.nodes, self.Phi, self.shape, self.wet = nodes, Phi, shape, wet
        self.xi = self.xi_bar + Phi @ self.q

    def moving(self):
        """The arc in motion."""
        return MovingArc(self.xi, self.Phi @ self.qd, self.Phi @ self.qdd, from_stack(self.base))

    def still(self):
        """The arc in motion, with no acceleration of its coordinates or of its base but `centripetal`."""
        w, v = ca.vertsplit(self.twist, 3)
        return MovingArc(self.xi, self.Phi @ self.qd, ca.DM(6, 1), Motion(w, v, ca.DM(3, 1), self.centripetal))

    def slices(self, arc):
        """(weights, column of the table) of each slice."""
        return [(arc.weights(x * self.length, x), self.data[:, i]) for i, x in enumerate(self.nodes)]

    def asked(self, arc, slices):
        """Wrench [6] and work [n] of the slices of a moving arc."""
        sums = Collected(arc)
        for at, row in slices:
            sums.add(at, *_slice_wrench(row, self.shape, self.wet, arc, at, self.water))
        return sums.wrench(), self.Phi.T @ sums.work()

    def weighed(self, arc, slices):
        """bb [6 x 6], bq [6 x n], qq [n x n]."""
        sums = Weighed(arc, self.shape, self.wet)
        for at, row in slices:
            sums.add(at, row)
        bb, bq, qq = sums.total()
        return bb, bq @ self.Phi, mirrored(self.Phi.T @ qq @ self.Phi)

    def there(self, arc, x):
        """Pose, S [6 x n] and motion [12] in the place's axes."""
        at = arc.weights(x * self.length, x)
        pose, motion = arc.pose(at), arc.motion(at)
        return pose, arc.tangent(at) @ self.Phi, ca.vertcat(*(se3.rotation(pose).T @ part for part in motion))


@lru_cache(maxsize=256)
def motion_kernel(nodes, places, *kind):
    """Function (q, qd, base motion [12], qdd, water velocity, xi_bar, length, data) -> wrench, work, then for each of
    `places` pose, S and motion. Here and below `kind` is basis, shape, wet: see `Section`."""
    section = Section(nodes, *kind)
    arc = section.moving()
    outputs = [*section.asked(arc, section.slices(arc)), *(part for x in places for part in section.there(arc, x))]
    inputs = [section.q, section.qd, section.base, section.qdd, section.water, *section.constants]
    return ca.Function("section_motion", inputs, ca.cse(outputs))


@lru_cache(maxsize=256)
def bias_kernel(nodes, places, *kind):
    """The same without accelerations, with the masses: (q, qd, base twist [6], acceleration [3], water
    velocity, xi_bar, length, data) -> bb, bq, qq, wrench, work, pose, ..."""
    section = Section(nodes, *kind)
    arc = section.still()
    slices = section.slices(arc)
    outputs = [*map(ca.densify, section.weighed(arc, slices)), *section.asked(arc, slices)]
    outputs += [part for x in places for part in section.there(arc, x)]
    inputs = [section.q, section.qd, section.twist, section.centripetal, section.water, *section.constants]
    return ca.Function("section_bias", inputs, ca.cse(outputs))


@lru_cache(maxsize=256)
def mass_kernel(nodes, *kind):
    """Function (q, xi_bar, length, data) -> bb, bq, qq of a section."""
    section = Section(nodes, *kind)
    arc = Arc(section.xi)
    outputs = ca.cse([*section.weighed(arc, section.slices(arc))])
    return ca.Function("section_mass", [section.q, *section.constants], outputs)


@lru_cache(maxsize=256)
def coriolis_kernel(nodes, places, *kind):
    """Function (q, qd, base twist [6], xi_bar, length, data) -> bb, bq, and B, F, D, own of `Swung` for q; then for each
    of `places` pose, S [6 x n] and its rate in axes held still."""
    section = Section(nodes, *kind)
    w, v = ca.vertsplit(section.twist, 3)
    base, Phi, xid = Motion(w, v, ca.DM(3, 1), ca.DM(3, 1)), section.Phi, section.Phi @ section.qd
    arc, sums = Arc(section.xi), Swung(section.xi, xid, base, section.shape, section.wet)
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


def mirrored(X):
    """A symmetric matrix from its lower half, so that the upper one is not computed."""
    return ca.tril2symm(ca.tril(X))


def spatial(m, h, J):
    """[J, skew(h); -skew(h), m I] [6 x 6]."""
    H = ca.skew(h) if h.nnz() else ca.DM(3, 3)
    return ca.blockcat([[J, H], [-H, m * ca.DM.eye(3)]])


def body_wrench(body, fluid, moving, water, density, parts):
    """[moment; force] [6] about the moving frame's origin, in its axes, that moves a body so; see `motion.PARTS`."""
    c, moment, force = ca.vertcat(*body.com), ca.DM(3, 1), ca.DM(3, 1)
    w, dw = moving.w, moving.dw
    at_com = moving.moved(se3.pose(ca.DM.eye(3), c))
    if "dry" in parts:
        moment, force = dry_wrench(body.mass, ca.DM(3, 1), body.inertia_matrix(), w, dw, at_com.a)
    n = at_com.v - water
    if fluid is not None and density is not None and "added" in parts:
        turn, push = added_wrench(*fluid.added(density), w, dw, n, at_com.a)
        moment, force = moment + turn, force + push
    if fluid is not None and density is not None and "drag" in parts:
        turn, push = fluid.drag_wrench(density, w, n, speed(n))
        moment, force = moment - turn, force - push
    return ca.vertcat(moment + ca.cross(c, force), force)


def body_inertia(body, fluid, density):
    """M [6 x 6] at the moving frame's origin, added mass included."""
    M = body.spatial_inertia()
    if fluid is None or density is None:
        return M
    there = se3.Ad_inv(se3.pose(ca.DM.eye(3), ca.vertcat(*body.com)))
    return M + there.T @ ca.diag(ca.vertcat(*fluid.added(density))) @ there
