"""Robots in motion: mass, velocity terms, accelerations, momentum, over every robot of the tables and every robot file.

The oracle is d'Alembert's principle in numpy. A slice or a body with the pseudo-inertia P = int r r^T dm, r = (x, y,
z, 1), on a frame g(q) along a path q(t) asks for the forces tr(dg/dq_i P g''^T) and has the energy tr(g' P g'^T) / 2.
Frames are matrix exponentials, dg/dq and g' come from complex steps, g'' from differences of g' of order ten. No twist,
no tangent map, no Newton-Euler equation enters. Generalised forces and rows of M are compared after division by
sqrt(M_ii), so that no coordinate hides behind another one's unit.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from robots import (
    BODY,
    POINTS,
    ROBOTS,
    STEP,
    TILTED,
    TIP,
    Case,
    Plain,
    array,
    bounds,
    exponential,
    fibres,
    gap,
    gauss,
    hat,
    rod,
    shifted,
    slice_at,
    vee,
)
from test_statics_terms import changed

import socontrol
from socontrol.lie.motion import Motion, MovingArc
from socontrol.mechanics import articulated, composite, floating, newton_euler
from socontrol.mechanics.actuators import JointTorque, Tendon
from socontrol.mechanics.functions import Functions
from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.loads import Distributed, Fluid, Wrench
from socontrol.mechanics.motion import Sweep
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.statics import Statics
from socontrol.model.bodies import Body
from socontrol.model.joints import Free, Helical, Prismatic, Revolute, Spherical
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, General, Hole
from socontrol.quantities import Bad

FOLDER = Path(__file__).parent.parent / "configs" / "robots"
TEN = {1: 5 / 6, 2: -5 / 21, 3: 5 / 84, 4: -5 / 504, 5: 1 / 1260}  # central differences of order ten
H = 0.03  # s, of differences in time: H^10 / 2772 and rounding / H are both below 1e-14 at a rad a second
HOLED = Circle(radius=0.011, holes=(Hole(offset=(0.005, -0.004), radius=0.003),))  # no axis of symmetry


# More robots: what the table of `robots` lacks


def eccentric():
    """Off-centre slices, one rod on another's middle, a joint at mid-rod, and a rod that stands before that joint."""
    numbers = General(
        stiffness=(0.01, 0.02, 0.03, 90.0, 40.0, 50.0), inertia=(6e-5, 2e-5, 5e-5, 0.3, 0.3, 0.3)
    )
    simo = dict(strains="simo_reissner", sections=1)
    return Description(
        segments={
            "stem": rod(cross_section=HOLED, strains="simo_reissner", sections=(0.4, 0.6)),
            "twig": rod(parent="stem", at=0.55, cross_section=numbers, length=0.12, **simo),
            "leaf": Helical(parent="twig", at=0.5, axis=(0.2, 0.4, 0.9), pitch=0.03, body=BODY, tip=TIP),
            "bud": rod(parent="leaf", at=0.0, cross_section=HOLED, length=0.1, **simo),
        },
        actuators={"cable": Tendon(along=("stem",), offset=(0.004, 0.003))},
    )


def floater():
    """A free body with a rod, a hinged link in the middle of it, and a ball joint; loads, motors and a cable."""
    hub = Body(mass=0.3, com=(0.01, -0.02, 0.015), inertia=(4e-4, 5e-4, 6e-4, 3e-5, -2e-5, 4e-5))
    return Description(
        segments={
            "hub": Free(placement=TILTED, body=hub, tip=TIP),
            "tail": rod(parent="hub", cross_section=HOLED),
            "fin": Revolute(parent="tail", at=0.5, axis=(0.1, 0.3, 1.0), body=BODY, tip=TIP),
            "head": Spherical(parent="hub", point=(0.01, 0.0, 0.02), placement=TILTED, body=BODY),
        },
        loads={
            "pull": Wrench(on="tail", force=(0.1, -0.2, 0.15), moment=(0.01, 0.0, -0.01)),
            "jet": Wrench(on="hub", force=(0.1, 0.3, 0.2), moment=(0.0, 0.02, 0.01), axes="body"),
            "wind": Distributed(on="tail", force=(0.3, 0.1, -0.2)),
        },
        actuators={
            "cable": Tendon(along=("tail",), offset=(0.004, 0.003)),
            "motor": JointTorque(joint="fin"),
            "ball": JointTorque(joint="head"),
        },
    )


def crawler():
    """A free tree of lumped joints, each with a motor but the free one."""
    common = dict(body=BODY, tip=TIP, placement=TILTED)
    joints = {
        "hub": Free(**common),
        "arm": Revolute(parent="hub", axis=(0.3, -0.2, 1.0), damping=0.01, **common),
        "drill": Helical(parent="arm", axis=(1.0, 0.2, 0.1), pitch=0.05, stiffness=0.2, **common),
        "ball": Spherical(parent="hub", point=(0.02, 0.01, 0.03), stiffness=0.1, **common),
        "piston": Prismatic(parent="ball", axis=(0.1, 1.0, -0.3), stiffness=20.0, **common),
    }
    motors = {f"{name}_motor": JointTorque(joint=name) for name in list(joints)[1:]}
    return Description(segments=joints, actuators=motors)


EXTRA = {"eccentric": eccentric(), "floater": floater(), "crawler": crawler()}
SHIPPED = {str(p.relative_to(FOLDER)): p for p in sorted(FOLDER.rglob("*.yaml"))}
TABLE = {**ROBOTS, **EXTRA}


@cache
def described(name):
    """A robot on dry land (`test_fluids` takes them into the water), its rods of few sections: more cost time only.

    Cables do not rub: the friction of a motion is that of its rates (`test_friction`). Loops are open (`test_loops`).
    """
    if name in TABLE:
        return TABLE[name]
    description = socontrol.load_robot(SHIPPED[name]).description
    loads = {key: load for key, load in (description.loads or {}).items() if not isinstance(load, Fluid)}
    cables = {k: replace(a, friction=0.0) if isinstance(a, Tendon) else a
              for k, a in (description.actuators or {}).items()}  # fmt: skip
    segments = {k: shortened(s) for k, s in description.segments.items()}
    return replace(description, loads=loads, segments=segments, actuators=cables, loops=None)


def shortened(s):
    by_section = isinstance(s, Rod) and any(isinstance(v, tuple) for v in [s.sections, *(s.rest or {}).values()])
    if by_section or not isinstance(s, Rod):
        return s
    return replace(s, sections=min(s.sections, 2))


@cache
def functions(name):
    return Robot(described(name)).functions()


@dataclass(frozen=True)
class Moving(Case):
    """A `Case` with rates, accelerations, and the oracle's numbers. Its tips turn by a rad a second or so."""

    @property
    def description(self):
        return described(self.name)

    @property
    def robot(self):
        return self.functions.robot

    @property
    def functions(self):
        return functions(self.name)

    @cached_property
    def plain(self):
        return Plain(self.description)

    @cached_property
    def _rates(self):
        rng = np.random.default_rng(1 + sum(map(ord, self.name)))
        n = self.plain.n
        return [np.array(self.plain.scales) * rng.normal(size=n) / np.sqrt(n) for _ in range(4)]

    @property
    def qd(self):
        return self._rates[0]

    @property
    def qdd(self):
        return 3 * self._rates[1]

    @cached_property
    def masses(self):
        return Masses(self.plain)

    @cached_property
    def slopes(self):
        """dg/dq of all masses."""
        return self.masses.slopes(self.q)

    @cached_property
    def mass(self):
        return array(self.functions.mass(self.q)).reshape(self.plain.n, self.plain.n)

    @cached_property
    def scale(self):
        """1 / sqrt(M_ii)."""
        return 1 / np.sqrt(np.diag(self.mass))


CASES = [Moving(name, shape) for name in (*TABLE, *SHIPPED) for shape in ("straight", "bent")]
SMALL = [case for case in CASES if case.name in TABLE]
DISTINCT = ("free", "branched", "eccentric", "crawler", "off_centre_hole")  # every kind of piece, place and section
FREE = [case for case in CASES if case.name in ("floater", "crawler")]


# The oracle


class Masses:
    """Slices and bodies of a robot: pseudo-inertias P [k x 4 x 4] and the frames they stand on."""

    def __init__(self, plain):
        self.plain, self.P = plain, []
        for s in plain.segments.values():
            if isinstance(s, Rod):
                edges = bounds(s)
                for a, b in zip(edges, edges[1:], strict=False):
                    nodes = zip(*gauss(a, b, points(s)), strict=True)
                    self.P += [w * s.length * slice_pseudo_inertia(s, X) for X, w in nodes]
            elif s.body is not None:
                self.P.append(body_pseudo_inertia(s.body))
        self.P = np.array(self.P).reshape(-1, 4, 4)

    def frames(self, q):
        """[k x ... x 4 x 4] at q [... n]."""
        q, out = np.asarray(q), []
        stations = self.plain.stations(q)
        for name, s in self.plain.segments.items():
            if isinstance(s, Rod):
                for i, part in enumerate(np.diff(bounds(s))):
                    xi = self.plain.strain(q, name, i) * part * s.length
                    x, _ = gauss(0, 1, points(s))
                    steps = exponential(hat(x.reshape(-1, *[1] * xi.ndim) * xi), halvings=4)
                    out += list(stations[name][i] @ steps)
            elif s.body is not None:
                out.append(stations[name][1])
        return np.array(out).reshape(-1, *q.shape[:-1], 4, 4)

    def slopes(self, q):
        """dg/dq [k x n x 4 x 4]."""
        n = self.plain.n
        return np.imag(self.frames(np.asarray(q) + 1j * STEP * np.eye(n))) / STEP

    def rates(self, q, qd):
        """dg/dt [k x ... x 4 x 4]."""
        return np.imag(self.frames(np.asarray(q) + 1j * STEP * np.asarray(qd))) / STEP

    def mass(self, dg):
        return np.tensordot(dg @ self.P[:, None], dg, axes=((0, 2, 3), (0, 2, 3)))

    def inertial_force(self, dg, q, qd, qdd):
        """[n] by d'Alembert's principle, dg/dq given."""

        def velocity(t):
            t = np.asarray(t)[:, None]
            return self.rates(q + t * qd + t**2 / 2 * qdd, qd + t * qdd)

        return np.einsum("kiab,kab->i", dg, in_time(velocity) @ self.P)

    def kinetic_energy(self, q, qd):
        v = self.rates(q, qd)
        return np.einsum("kab,kbc,kac->", v, self.P, v) / 2

    def momentum(self, q, qd):
        """[6] angular about the world's origin, and linear: sum r x r' dm and sum r' dm."""
        S = np.einsum("kab,kbc,kdc->ad", self.frames(q), self.P, self.rates(q, qd))  # int r r'^T dm
        return np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0], *S[3, :3]])


def points(s):
    """Gauss points a section: more than the library's, but for rods whose file asks for so few that it would show."""
    return POINTS if s.quadrature >= 8 else s.quadrature


def in_time(function, h=H):
    """Slope at 0 of a function of times [m], whose answer has the time as second axis."""
    steps = np.array([*TEN, *(-k for k in TEN)], dtype=float)
    weights = np.array([*TEN.values(), *(-c for c in TEN.values())])
    return np.einsum("t,kt...->k...", weights, function(h * steps)) / h


def slope(function, h=H):
    """Slope at 0 of a function of one number."""
    return sum(c * (array(function(k * h)) - array(function(-k * h))) for k, c in TEN.items()) / h


def slice_pseudo_inertia(s, X):
    section = slice_at(s.cross_section, X)
    if isinstance(section, General):
        return pseudo_inertia(np.diag(section.inertia[:3]), section.inertia[3], np.zeros(3))
    y, z, dA = fibres(section)
    r = np.stack([0 * y, y, z, 1 + 0 * y])
    return s.material.density * (r * dA) @ r.T


def body_pseudo_inertia(body):
    J = np.array(body.inertia, dtype=float)
    if J.size == 3:
        J = np.diag(J)
    elif J.size == 6:
        xx, yy, zz, xy, xz, yz = J
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    at = shifted(body.com)
    return at @ pseudo_inertia(J, body.mass, np.zeros(3)) @ at.T


def pseudo_inertia(J, mass, com):
    P = np.zeros((4, 4))
    P[:3, :3] = np.trace(J) / 2 * np.eye(3) - J
    P[3, 3] = mass
    return P


def test_the_oracle_knows_a_spinning_top():
    """Energy and momentum of a body that turns about its axis, by hand."""
    top = Description(segments={"top": Revolute(axis=(0, 0, 1.0), body=Body(2.0, (0.5, 0, 0), (1.0, 2.0, 2.5)))})
    masses = Masses(Plain(top))
    assert masses.mass(masses.slopes([0.7]))[0, 0] == pytest.approx(2.5 + 2.0 * 0.25, rel=1e-14)
    spin = masses.momentum(np.zeros(1), np.array([3.0]))
    np.testing.assert_allclose(spin, [0, 0, 9.0, 0, 3.0, 0], atol=1e-14)
    motion = np.array([0.7]), np.ones(1), np.array([2.0])
    np.testing.assert_allclose(masses.inertial_force(masses.slopes([0.7]), *motion), [6.0], rtol=1e-12)


# Inside one piece (T10)


@pytest.mark.parametrize("size", [0.0, 1e-6, 1.0, 4.0, 6.28])  # rad, up to the range of the series
@pytest.mark.parametrize("s", [0.1, 1.0])
def test_motion_on_an_arc_whose_base_moves_is_the_slope_of_its_pose(size, s):
    rng = np.random.default_rng(3)
    xi, xid, xidd = (rng.normal(size=6) for _ in range(3))
    xi[:3] *= size / np.linalg.norm(xi[:3])
    w, v, dw, a = (rng.normal(size=3) for _ in range(4))

    def pose(t):
        """Seen from the base at t = 0, which turns by w, dw and slides by v, a."""
        t = np.asarray(t)[..., None]
        turn = hat(np.concatenate([w * t + dw * t**2 / 2, 0 * t * w], axis=-1))
        base = exponential(turn)  # of a rotation vector w t + dw t^2/2: rate w, acceleration dw at t = 0
        base[..., :3, 3] = v * t + a * t**2 / 2
        return base @ exponential(hat(s * (xi + t * xid + t**2 / 2 * xidd)))

    at_rest = pose(np.zeros(1))[0]
    velocity = np.imag(pose(np.array([1j * STEP])))[0] / STEP
    acceleration = in_time(lambda t: np.imag(pose(t + 1j * STEP))[None] / STEP)[0]
    R = at_rest[:3, :3]
    turn = velocity[:3, :3] @ R.T
    turning = acceleration[:3, :3] @ R.T - turn @ turn  # rate of the spin: R'' R^T = W' + W W

    arc = MovingArc(ca.DM(xi), ca.DM(xid), ca.DM(xidd), Motion(*map(ca.DM, (w, v, dw, a))))
    at = arc.weights(s, 1.0)
    moving = arc.motion(at)
    assert gap(arc.pose(at), at_rest) < 1e-13
    assert gap(moving.w, [turn[2, 1], turn[0, 2], turn[1, 0]]) < 1e-13
    assert gap(moving.v, velocity[:3, 3]) < 1e-13
    assert gap(moving.dw, [turning[2, 1], turning[0, 2], turning[1, 0]]) < 1e-11
    assert gap(moving.a, acceleration[:3, 3]) < 1e-11


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_twists_and_accelerations_where_others_stand_are_slopes_of_the_pose(case):
    """eta and its rate, in body axes, on the pieces that carry others."""
    sweep = Sweep(case.robot, *map(ca.DM, (case.q, case.qd, case.qdd)))
    q, qd, qdd = case.q, case.qd, case.qdd
    for i, piece in enumerate(case.robot.tree.pieces):
        for x in sweep.places[i]:
            if not piece.is_rod and x == 0:
                continue

            def twist(t, piece=piece, x=x):
                """[6 x m] at the times t [m]: (g^-1 g')^vee."""
                t = np.asarray(t)[:, None]
                at = q + t * qd + t**2 / 2 * qdd + 1j * STEP * (qd + t * qdd)
                frames = case.plain.stations(at)[piece.segment]
                g = frames[1]
                if piece.is_rod:
                    xi = case.plain.strain(at, piece.segment, piece.index) * piece.length * x
                    g = frames[piece.index] @ exponential(hat(xi))
                return vee(np.linalg.inv(np.real(g)) @ np.imag(g) / STEP).T

            motion = sweep.moved[i].at[x][2]
            w, v, dw, a = (array(part) for part in motion)
            eta = twist(np.zeros(1))[:, 0]
            expected = in_time(twist)
            assert gap(np.concatenate([w, v]), eta) < 1e-11, piece.segment
            rate = np.concatenate([dw, a - np.cross(w, v)])  # a is that of the origin in space
            assert gap(rate, expected) < 1e-9, piece.segment


# Mass (T13)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_mass_is_the_sum_over_slices_and_bodies(case):
    M = case.mass * np.outer(case.scale, case.scale)
    expected = case.masses.mass(case.slopes) * np.outer(case.scale, case.scale)
    assert np.abs(M - expected).max() < 1e-11
    assert np.abs(M - M.T).max() < 1e-12  # diagonal blocks are summed both ways
    assert np.linalg.eigvalsh(M)[0] > 0


def test_three_different_masses_a_metre_are_refused():
    """A slice has one mass whichever way it moves; three would have no Newton-Euler equation of their own."""
    with pytest.raises(Bad, match="one mass"):
        General(stiffness=(0.01, 0.02, 0.03, 90.0, 40.0, 50.0), inertia=(6e-5, 2e-5, 5e-5, 0.3, 0.2, 0.4))


def test_a_joint_that_carries_no_mass_has_none():
    bare = Description(segments={"hinge": Revolute(body=BODY), "bare": Revolute(parent="hinge", axis=(0, 1.0, 0))})
    M = array(Robot(bare).functions().mass([0.3, 0.4]))
    assert M[0, 0] > 0
    np.testing.assert_array_equal([M[0, 1], M[1, 0], M[1, 1]], 0)


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_kinetic_energy_is_that_of_the_moving_slices_and_half_qd_M_qd(case):
    kinetic = array(case.functions.energy(case.q, case.qd))[0]
    assert kinetic == pytest.approx(case.masses.kinetic_energy(case.q, case.qd), rel=1e-11)
    assert kinetic == pytest.approx(case.qd @ case.mass @ case.qd / 2, rel=1e-11)


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_momentum_is_the_sum_over_slices_and_bodies(case):
    momentum = array(case.functions.momentum(case.q, case.qd))
    assert gap(momentum, case.masses.momentum(case.q, case.qd)) < 1e-11


# Velocity terms (T13)


def inertial(case, *motion):
    """M qdd + C qd from the public inverse dynamics, and the rounding that its other terms leave."""
    f, (q, qd, _) = case.functions, motion
    others = [array(f.elastic_force(q)), array(f.damping(q)).reshape(len(q), -1) @ qd, -array(f.external_force(q, qd))]
    rest = sum(np.abs(case.scale * part).max() for part in others)
    return array(f.inverse_dynamics(*motion)) - sum(others), 1e-14 * rest


@pytest.mark.parametrize("case", CASES, ids=str)
def test_inverse_dynamics_are_those_of_d_Alembert(case):
    motion = case.q, case.qd, case.qdd
    force, rounding = inertial(case, *motion)
    expected = case.scale * case.masses.inertial_force(case.slopes, *motion)
    assert np.abs(case.scale * force - expected).max() < 1e-11 * np.abs(expected).max() + rounding


@pytest.mark.parametrize("case", CASES, ids=str)
def test_C_qd_are_the_velocity_terms_of_d_Alembert(case):
    C = array(case.functions.coriolis(case.q, case.qd)).reshape(case.plain.n, -1)
    expected = case.masses.inertial_force(case.slopes, case.q, case.qd, 0 * case.qd)
    size = np.abs(case.scale * (case.mass @ case.qdd)).max()  # C qd alone may vanish: a slide, a turn about an axis
    assert np.abs(case.scale * (C @ case.qd - expected)).max() < 1e-11 * size


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_rate_of_M_is_C_plus_its_transpose(case):
    n, f = case.plain.n, case.functions
    C = array(f.coriolis(case.q, case.qd)).reshape(n, n)
    rate = slope(lambda t: array(f.mass(case.q + t * case.qd)).reshape(n, n))
    scale = np.outer(case.scale, case.scale)
    assert np.abs(scale * (rate - C - C.T)).max() < 1e-11 * max(1, np.abs(scale * C).max())


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_C_qd_are_the_velocity_terms_of_Lagrange(case):
    """M' qd - d(qd M qd / 2)/dq, with the derivatives of M by differences."""
    n, mass = case.plain.n, case.functions.mass.function
    steps = H * np.array([*TEN, *(-k for k in TEN)])
    sizes = np.array(case.plain.scales)
    shifts = np.concatenate([np.outer(steps, row) for row in np.diag(sizes)])
    M = np.array(mass(ca.DM(case.q[:, None] + shifts.T))).reshape(n, -1, n).transpose(1, 0, 2)
    weights = np.array([*TEN.values(), *(-c for c in TEN.values())]) / H
    dM = np.einsum("t,ktij->kij", weights, M.reshape(n, len(steps), n, n)) / sizes[:, None, None]  # dM/dq_k
    expected = np.einsum("kij,k,j->i", dM, case.qd, case.qd) - np.einsum("kij,i,j->k", dM, case.qd, case.qd) / 2
    C = array(case.functions.coriolis(case.q, case.qd)).reshape(n, n)
    size = np.abs(case.scale * (case.mass @ case.qdd)).max()
    assert np.abs(case.scale * (C @ case.qd - expected)).max() < 1e-10 * size


# Forward dynamics (T14)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_articulated_bodies_are_the_inverse_of_newton_euler(case):
    f, q, qd, u = case.functions, case.q, case.qd, case.u
    qdd = array(f.forward_dynamics(q, qd, u))
    Bu = array(f.actuation(q)).reshape(case.plain.n, -1) @ u
    left = case.scale * (array(f.inverse_dynamics(q, qd, qdd)) - Bu)
    size = np.abs(case.scale * Bu).max() + np.abs(case.scale * (case.mass @ qdd)).max()
    assert np.abs(left).max() <= 1e-11 * size  # both 0 where nothing pushes


@pytest.mark.parametrize("case", CASES, ids=str)
def test_articulated_bodies_are_the_dense_solution(case):
    f, q, qd, u = case.functions, case.q, case.qd, case.u
    free = array(f.actuation(q)).reshape(case.plain.n, -1) @ u - array(f.inverse_dynamics(q, qd, 0 * q))
    scaled = case.mass * np.outer(case.scale, case.scale)
    expected = case.scale * np.linalg.solve(scaled, case.scale * free)
    qdd = array(f.forward_dynamics(q, qd, u))
    rounding = 1e-15 * np.linalg.cond(scaled)  # what either way of solving may lose
    assert np.abs((qdd - expected) / case.scale).max() < 20 * rounding * np.abs(expected / case.scale).max() + 1e-12


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_energy_changes_by_the_power_of_inputs_loads_and_dampers(case):
    """Whatever the accelerations: tau is what they ask for."""
    f, (q, qd, qdd) = case.functions, (case.q, case.qd, case.qdd)
    rate = slope(lambda t: f.energy(q + t * qd + t**2 / 2 * qdd, qd + t * qdd))
    plain = Plain(replace(case.description, gravity=(0.0, 0.0, 0.0)))
    power = [
        qd @ array(f.inverse_dynamics(q, qd, qdd)),
        qd @ plain.external_force(q),
        -qd @ array(f.damping(q)).reshape(case.plain.n, -1) @ qd,
    ]
    assert abs(rate.sum() - sum(power)) < 1e-10 * np.abs([*rate, *power]).max()


# Free robots


@pytest.mark.parametrize("case", FREE, ids=str)
def test_momentum_changes_by_the_wrench_of_weights_and_loads(case):
    """Whatever the joints do: the base moves as no wrench on it asks."""
    f, q, qd, joints = case.functions, case.q, case.qd, case.qdd[6:]
    qdd = np.concatenate([array(f.floating_inverse_dynamics(q, qd, joints)[0]), joints])
    rate = slope(lambda t: f.momentum(q + t * qd + t**2 / 2 * qdd, qd + t * qdd), h=H / 5)  # falls, turns faster
    assert gap(rate, case.plain.total_push(q)) < 1e-9


@pytest.mark.parametrize("case", FREE, ids=str)
def test_floating_inverse_dynamics_leave_no_wrench_on_the_base(case):
    f, q, qd, joints = case.functions, case.q, case.qd, case.qdd[6:]
    base, forces = (array(x) for x in f.floating_inverse_dynamics(q, qd, joints))
    tau = array(f.inverse_dynamics(q, qd, np.concatenate([base, joints])))
    assert np.abs(tau[:6]).max() < 1e-11 * np.abs(case.mass[:6] @ np.concatenate([base, joints])).max()
    assert gap(forces, tau[6:]) < 1e-11


@pytest.mark.parametrize("case", FREE, ids=str)
def test_forward_dynamics_under_the_forces_found_give_the_base_its_acceleration(case):
    f, q, qd, joints = case.functions, case.q, case.qd, case.qdd[6:]
    base, forces = (array(x) for x in f.floating_inverse_dynamics(q, qd, joints))
    wanted = np.concatenate([base, joints])
    if case.name == "crawler":
        B = array(f.actuation(q))
        assert np.abs(B[:6]).max() == 0
        qdd = array(f.forward_dynamics(q, qd, np.linalg.solve(B[6:], forces)))
    else:  # rods have no motor of each coordinate
        force = np.concatenate([np.zeros(6), forces]) - array(f.inverse_dynamics(q, qd, 0 * q)) + 0 * q
        force += array(newton_euler.inertial_force(case.robot, *map(ca.DM, (q, qd, 0 * q))))
        qdd = array(articulated.accelerations(case.robot, *map(ca.DM, (q, qd, force))))
    assert gap(qdd / case.plain.scales, wanted / case.plain.scales) < 1e-10


@pytest.mark.parametrize("name", [name for name in (*TABLE, *SHIPPED)])
def test_floating_inverse_dynamics_want_one_free_joint_that_carries_all(name):
    roots = [s for s in described(name).segments.values() if s.parent == "world"]
    if len(roots) == 1 and isinstance(roots[0], Free):
        assert floating.base_piece(functions(name).robot.tree).columns == slice(0, 6)
        return
    with pytest.raises(ValueError, match="one joint of type 'free'"):
        _ = functions(name).floating_inverse_dynamics


def test_a_free_joint_beside_another_root_is_no_floating_base():
    pair = Description(segments={"a": Free(body=BODY), "b": Revolute(body=BODY)})
    with pytest.raises(ValueError, match="here: a, b"):
        _ = Robot(pair).functions().floating_inverse_dynamics


def test_a_lone_free_body_falls():
    """Without joints; at rest, off its exponential's origin: every point accelerates by gravity."""
    f = Robot(Description(segments={"body": Free(body=BODY, placement=TILTED)})).functions()
    q = np.array([0.4, -0.3, 0.8, 0.1, 0.2, -0.1])
    base, forces = f.floating_inverse_dynamics(q, np.zeros(6), np.zeros(0))
    assert forces.numel() == 0
    twist = array(f.jacobian("body")(q)) @ array(base)
    R = array(f.pose("body")(q))[:3, :3]
    np.testing.assert_allclose(twist, [0, 0, 0, *(R.T @ [0, 0, -9.81])], atol=1e-12)


# Kinds of numbers, and derivatives


def all_terms(robot, q, qd, qdd, u):
    kin, s = Kinematics(robot.tree, q), Statics(robot, q, u)
    force = s.actuation() @ u
    return [
        composite.mass(robot, kin),
        composite.coriolis(robot, kin, qd),
        composite.kinetic_energy(robot, q, qd),
        composite.momentum(robot, kin, qd),
        newton_euler.inertial_force(robot, q, qd, qdd),
        articulated.accelerations(robot, q, qd, force),
    ]


@pytest.mark.parametrize("case", [case for case in SMALL if case.shape == "bent" and case.name in DISTINCT], ids=str)
def test_terms_are_the_same_as_DM_SX_and_MX(case):
    numbers = case.q, case.qd, case.qdd, case.u
    as_dm = all_terms(case.robot, *map(ca.DM, numbers))
    f = case.functions
    functions_of_sx = [
        f.mass(case.q), f.coriolis(case.q, case.qd), f.energy(case.q, case.qd)[0], f.momentum(case.q, case.qd)
    ]  # fmt: skip
    symbols = [ca.MX.sym(name, len(x)) for name, x in zip(("q", "qd", "qdd", "u"), numbers, strict=True)]
    as_mx = ca.Function("terms", symbols, [ca.MX(x) for x in all_terms(case.robot, *symbols)])(*numbers)
    for dm, mx in zip(as_dm, as_mx, strict=True):
        assert gap(ca.densify(mx), ca.densify(dm)) < 1e-11
    for dm, sx in zip(as_dm, functions_of_sx, strict=False):
        assert gap(sx, ca.densify(dm)) < 1e-11


@pytest.mark.parametrize("case", [case for case in CASES if case.shape == "bent"], ids=str)
def test_one_call_a_section_gives_the_same_motion(case):
    one, chained = case.functions, case.robot.functions(chained=True)
    q, qd, qdd, u = case.q, case.qd, case.qdd, case.u
    for name, given in (("inverse_dynamics", (q, qd, qdd)), ("forward_dynamics", (q, qd, u))):
        assert gap(getattr(chained, name)(*given), getattr(one, name)(*given)) < 1e-11, name
    assert gap(chained.motion_residual(q, qd, qdd, u), one.motion_residual(q, qd, qdd, u)) < 1e-11


@cache
def directional(name):
    """(x, v) -> slope of tau along v, x = [q, qd, qdd]; (y, e) -> qdd, its slope and that of B u, y = [q, qd, u]."""
    f = functions(name)
    n, m = f.robot.n, f.robot.m
    x, v = ca.SX.sym("x", 3 * n), ca.SX.sym("v", 3 * n)
    along = ca.Function("along", [x, v], [ca.jtimes(f.inverse_dynamics.function(*ca.vertsplit(x, n)), x, v)])
    y, e = ca.SX.sym("y", 2 * n + m), ca.SX.sym("e", 2 * n + m)
    q, qd, u = y[:n], y[n : 2 * n], y[2 * n :]
    qdd, pull = f.forward_dynamics.function(q, qd, u), f.actuation.function(q) @ u
    return along, ca.Function("rates", [y, e], [qdd, ca.jtimes(qdd, y, e), ca.jtimes(pull, y, e)])


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_slopes_of_inverse_and_forward_dynamics_are_their_differences(case):
    """Along one direction that moves all arguments at once; straight rods have their own branch of the series.

    Those of the inverse by differences; those of the forward dynamics undo them: ID(q, qd, FD(q, qd, u)) = B u.
    """
    f, n, d = case.functions, case.plain.n, np.concatenate(case._rates[1:])
    along, rates = directional(case.name)
    x = np.concatenate([case.q, case.qd, case.qdd])
    expected = case.scale * slope(lambda t: f.inverse_dynamics(*np.split(x + t * d, 3)))
    level = np.abs(case.scale * array(f.inverse_dynamics(*np.split(x, 3)))).max()  # rounding of the differences
    error = np.abs(case.scale * array(along(x, d)) - expected).max()
    assert error < 1e-10 * np.abs(expected).max() + 1e-14 * level / H

    e = np.concatenate([d[: 2 * n], case.u / 3])
    qdd, rate, pull = (array(part) for part in rates(np.concatenate([case.q, case.qd, case.u]), e))
    left = array(along(np.concatenate([case.q, case.qd, qdd]), np.concatenate([d[: 2 * n], rate]))) - pull
    size = np.abs(case.scale * (case.mass @ rate)).max() + np.abs(case.scale * (case.mass @ qdd)).max()
    assert np.abs(case.scale * left).max() < 1e-10 * size


@pytest.mark.parametrize("case", [c for c in SMALL if c.name in ("pre_curved_locked", "crawler")], ids=str)
def test_jacobians_of_inverse_and_forward_dynamics_are_their_differences(case):
    """Column by column: no entry hides behind another one."""
    f = case.functions
    for function, last in ((f.inverse_dynamics, case.qdd), (f.forward_dynamics, case.u)):
        at, ends = [case.q, case.qd, last], np.cumsum([0, case.plain.n, case.plain.n])
        symbols = [ca.SX.sym(f"x{i}", len(x)) for i, x in enumerate(at)]
        J = ca.Function("J", symbols, [ca.densify(ca.jacobian(function.function(*symbols), ca.vertcat(*symbols)))])
        J = array(J(*at)).reshape(case.plain.n, -1)
        weight = case.scale if function is f.inverse_dynamics else 1 / case.scale
        for which, (x, start) in enumerate(zip(at, ends, strict=True)):
            for k in range(len(x)):
                size = 1.0 if which == 2 and function is f.forward_dynamics else case.plain.scales[k]

                def moved(t, which=which, k=k, size=size, at=at, function=function):
                    there = [part + (t * size * np.eye(len(part))[k] if i == which else 0) for i, part in enumerate(at)]
                    return function(*there)

                expected, value = weight * slope(moved), weight * J[:, start + k] * size
                level = np.abs(weight * array(function(*at))).max()
                assert np.abs(value - expected).max() < 1e-8 * np.abs(expected).max() + 1e-13 * level / H


# Parameters


PARAMETERS = [
    ("floater", "gravity", (1.0, -2.0, 3.0)),
    ("floater", "hub.body.mass", 0.5),
    ("floater", "hub.body.com", (0.02, 0.01, -0.03)),
    ("floater", "hub.body.inertia", (5e-4, 6e-4, 7e-4, 4e-5, 3e-5, -2e-5)),
    ("floater", "hub.placement.rotation", (0.3, 0.2, -0.5)),
    ("floater", "tail.material.density", 1400.0),
    ("floater", "tail.length", 0.3),
    ("floater", "tail.cross_section.radius", 0.012),
    ("floater", "tail.placement.position", (0.02, 0.03, -0.01)),
    ("floater", "fin.axis", (0.5, 0.1, 0.6)),
    ("floater", "fin.body.mass", 0.07),
    ("simo_reissner", "rod.material.density", 1500.0),
    ("simo_reissner", "rod.material.viscosity", 500.0),
    ("general", "rod.cross_section.inertia", (2e-5, 3e-5, 4e-5, 0.4, 0.4, 0.4)),
    ("crawler", "drill.pitch", 0.02),
    ("crawler", "ball.tip.position", (0.01, 0.02, 0.07)),
]


def rebuilt(description, values):
    for path, value in values.items():
        keys = path.split(".")
        description = changed(description, keys if keys[0] == "gravity" else ["segments", *keys], value)
    return Robot(description).functions()


@pytest.mark.parametrize("name", sorted({name for name, _, _ in PARAMETERS}))
def test_parameters_move_the_robot_as_a_rebuilt_one(name):
    case = Moving(name, "bent")
    values = {path: value for of, path, value in PARAMETERS if of == name}
    parametric = Functions(Robot(case.description), list(values))
    other, p = rebuilt(case.description, values), np.concatenate([np.ravel(v) for v in values.values()])
    q, qd, qdd, u = case.q, case.qd, case.qdd, case.u
    terms = {
        "inverse_dynamics": (q, qd, qdd), "forward_dynamics": (q, qd, u), "mass": (q,), "coriolis": (q, qd),
        "momentum": (q, qd), "energy": (q, qd),
    }  # fmt: skip
    if name in ("floater", "crawler"):
        terms["floating_inverse_dynamics"] = q, qd, qdd[6:]
    for term, at in terms.items():
        for of, numbers in ((case.functions, parametric.defaults), (other, p)):
            answers = getattr(parametric, term)(*at, numbers), getattr(of, term)(*at)
            for ours, expected in zip(*map(parts, answers), strict=True):
                assert gap(ours, expected) < 1e-11, term
    start = 0
    for path, value in values.items():  # each of them matters
        one = parametric.defaults.copy()
        one[start : start + np.size(value)] = np.ravel(value)
        start += np.size(value)
        ours = parametric.inverse_dynamics(q, qd, qdd, one)
        assert gap(ours, case.functions.inverse_dynamics(q, qd, qdd)) > 1e-6, path


def parts(answer):
    return answer if isinstance(answer, (tuple, list)) else [answer]


@pytest.mark.parametrize("path", ["tail.length"])
def test_the_slope_by_a_parameter_is_the_difference_of_rebuilt_robots(path):
    case = Moving("floater", "bent")
    f = Functions(Robot(case.description), [path])
    p, q = ca.SX.sym("p", 1), ca.DM(case.q)
    at = q, ca.DM(case.qd), ca.DM(case.u)
    exact = ca.Function("slope", [p], [ca.jacobian(f.forward_dynamics.function(*at, p), p)])(f.defaults)

    def other(t):
        return rebuilt(case.description, {path: float(f.defaults[0] * (1 + t))}).forward_dynamics(*at)

    h = 0.01
    expected = sum(c * array(other(k * h) - other(-k * h)) for k, c in {1: 2 / 3, 2: -1 / 12}.items()) / h
    assert gap(array(exact) * f.defaults, expected) < 1e-6
