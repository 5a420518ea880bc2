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
        self._masses += product(row[0], weights)
        self._turns += product(row[4], weights[:4])
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


def product(value, weights):
    """The lower half of value weights weights^T."""
    return ca.tril((value * weights) @ weights.T)


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
