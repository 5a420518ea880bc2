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
from socontrol.lie.motion import Arc, Collected, MovingArc, from_stack

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


def is_plain(data):
    """Whether all slices are centred on the rod's axis: no first moment, no Jyz."""
    off = ca.SX(data[[1, 2, 6], :])
    return off.is_constant() and float(ca.sumsqr(ca.DM(off))) == 0


def moments(row, plain):
    """m, h [3] and J [3 x 3] of a column of the table, body axes."""
    h = ca.DM(3, 1) if plain else ca.vertcat(0, row[1], row[2])
    J = ca.diag(row[3:6])
    if not plain:
        J = J + row[6] * ca.DM([[0, 0, 0], [0, 0, 1], [0, 1, 0]])
    return row[0], h, J


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


def _slice_wrench(row, plain, wet, R, moving, water):
    """Moment and force [3 each] on a slice to move it so, axes of the base."""
    m, h, J = moments(row, plain)
    w, dw = R.T @ moving.w, R.T @ moving.dw
    if plain:
        moment, force = dry_wrench(m, h, J, w, dw, moving.a)
    else:
        moment, force = dry_wrench(m, h, J, w, dw, R.T @ moving.a)
        force = R @ force
    if wet:
        n = R.T @ (moving.v - water)
        Nv = ca.vertcat(0, row[12], row[13])
        turn, push = added_wrench(ca.DM(3, 1), Nv, w, dw, n, R.T @ moving.a)
        moment += turn
        force += R @ (push - slice_drag(row, n))
    return R @ moment, force


@lru_cache(maxsize=256)
def motion_kernel(nodes, places, plain, wet):
    """Function (xi, xid, xidd, base motion [12], length, data, water velocity) -> wrench, work, then for each place
    pose, T [6 x 6] and motion [12] in the place's axes. `nodes`, `places`: fractions of the length."""
    xi, xid, xidd = (ca.SX.sym(name, 6) for name in ("xi", "xid", "xidd"))
    base, length, water = ca.SX.sym("base", 12), ca.SX.sym("length"), ca.SX.sym("water", 3)
    data = ca.SX.sym("data", len(DRY) + len(WET) * wet, len(nodes))
    arc = MovingArc(xi, xid, xidd, from_stack(base))
    sums = Collected(arc)
    for i, x in enumerate(nodes):
        at = arc.weights(x * length, x)
        sums.add(at, *_slice_wrench(data[:, i], plain, wet, at.R, arc.motion(at), water))
    outputs = [sums.wrench(), sums.work()]
    for x in places:
        at = arc.weights(x * length, x)
        there = ca.vertcat(*(at.R.T @ part for part in arc.motion(at)))
        outputs += [arc.pose(at), arc.tangent(at), there]
    names = ["wrench", "work", *(f"{what}{i}" for i in range(len(places)) for what in ("pose", "T", "motion"))]
    inputs = [xi, xid, xidd, base, length, data, water]
    return ca.Function("section_motion", inputs, outputs, _names(inputs), names)


def _names(inputs):
    return [s.name() if s.numel() == 1 else s[0].name().rpartition("_")[0] for s in inputs]


def mirrored(X):
    """A symmetric matrix from its lower half, so that the upper one is not computed."""
    return ca.tril2symm(ca.tril(X))


def spatial(m, h, J):
    """[J, skew(h); -skew(h), m I] [6 x 6]."""
    H = ca.skew(h) if h.nnz() else ca.DM(3, 3)
    return ca.blockcat([[J, H], [-H, m * ca.DM.eye(3)]])


@lru_cache(maxsize=256)
def mass_kernel(nodes, plain, wet):
    """Function (xi, length, data) -> sums over the slices of E_b^T M E_b, E_b^T M E and E^T M E [6 x 6 each]: E gives a
    slice's body twist from the rate of xi, E_b from the base's twist."""
    xi, length = ca.SX.sym("xi", 6), ca.SX.sym("length")
    data = ca.SX.sym("data", len(DRY) + len(WET) * wet, len(nodes))
    arc, sums, none = Arc(xi), [ca.DM(6, 6)] * 3, ca.DM(3, 3)
    for i, x in enumerate(nodes):
        row, at = data[:, i], arc.weights(x * length, x)
        M = spatial(*moments(row, plain))
        if wet:
            M = M + ca.diagcat(none, ca.diag(ca.vertcat(0, row[12], row[13])))
        back = ca.DM.eye(3) if plain and not wet else at.R.T  # an isotropic mass needs no turning
        E = ca.blockcat([[at.A.T, none], [back @ arc.reach(at), back @ at.A]])  # A^T = R^T A
        E_b = ca.blockcat([[at.R.T, none], [-(back @ ca.skew(arc.position(at))), back]])
        ME = M @ E
        for k, part in enumerate((E_b.T @ M @ E_b, E_b.T @ ME, E.T @ ME)):
            sums[k] = sums[k] + part
    sums = [mirrored(sums[0]), sums[1], mirrored(sums[2])]
    return ca.Function("section_mass", [xi, length, data], sums,
                       ["xi", "length", "data"], ["bb", "bq", "qq"])  # fmt: skip


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
