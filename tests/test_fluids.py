"""Robots in water: drag, lift, added mass and buoyancy, against sums over slices in numpy and against closed forms.

The oracle `Water` moves slices and bodies by matrix exponentials and complex steps (`robots.Plain`), puts the written
laws of `model/fluids` on them, and takes virtual work. What added mass asks for comes from Lagrange's equations.
"""

from dataclasses import replace
from functools import cache
from math import pi

import casadi as ca
import numpy as np
import pytest
from robots import STEP, TILTED, TIP, Plain, array, bounds, fibres, gap, gauss, rod, shifted, slice_at, vee
from scipy.integrate import quad
from test_dynamics_oracles import functions as stored_functions
from test_dynamics_oracles import oracle as stored
from test_dynamics_terms import HOLED, SHIPPED, H, shortened, slope

import socontrol
from socontrol.mechanics import articulated, composite, newton_euler
from socontrol.mechanics.actuators import JointTorque
from socontrol.mechanics.functions import Functions
from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.loads import Fluid, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body
from socontrol.model.fluids import BodyFluid, RodFluid, Spheroid
from socontrol.model.joints import Fixed, Free, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, Ellipse, General, Rectangle, Taper
from socontrol.quantities import Bad

DENSITY, CURRENT = 1000.0, (0.3, -0.2, 0.15)
G = 9.81
WET = RodFluid(tangential=0.02, normal=1.1, lift=-0.1, linear=(0.01, 0.03), added_mass=(0.9, 0.5))
HUB = Body(mass=0.3, com=(0.01, -0.02, 0.015), inertia=(4e-4, 5e-4, 6e-4, 3e-5, -2e-5, 4e-5), displaced_volume=2.5e-4)
EGG = BodyFluid(
    drag=(2e-6, 3e-6, 4e-6, 1e-3, 2e-3, 3e-3), linear=(1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3),
    spheroid=Spheroid(along=0.06, across=0.03),
)  # fmt: skip
PLATE = BodyFluid(drag=(1e-6, 0, 0, 0, 1e-3, 0), added_mass=(1e-5, 2e-5, 3e-5, 0.01, 0.02, 0.05))


# Robots


def fan(**water):
    """Rods of every section on each other, and a body."""
    simo = dict(strains="simo_reissner", sections=1, fluid=WET)
    numbers = General(stiffness=(0.01, 0.02, 0.03, 90.0, 40.0, 50.0), inertia=(6e-5, 2e-5, 5e-5, 0.3, 0.3, 0.3))
    cone = Taper(start=Circle(radius=0.012), end=Circle(radius=0.005))
    return Description(
        segments={
            "stem": rod(cross_section=HOLED, fluid=WET),
            "blade": rod(parent="stem", at=0.5, cross_section=Rectangle(width=0.01, height=0.02), length=0.1, **simo),
            "leaf": rod(parent="stem", cross_section=Ellipse(radius_y=0.012, radius_z=0.007), length=0.1, **simo),
            "stalk": rod(parent="leaf", at=0.4, cross_section=numbers, length=0.1, **simo),
            "tip": rod(parent="leaf", cross_section=cone, length=0.1, **simo),
            "bud": Fixed(parent="tip", body=HUB, fluid=PLATE),
        },
        loads={"water": Fluid(density=DENSITY, **water)},
    )


def swimmer(**water):
    """A free body with a tail, a fin in the middle of it, and a sail that has no mass of its own."""
    return Description(
        segments={
            "hub": Free(placement=TILTED, body=HUB, tip=TIP, fluid=EGG),
            "tail": rod(parent="hub", cross_section=HOLED, fluid=WET),
            "fin": Revolute(parent="tail", at=0.5, axis=(0.1, 0.3, 1.0), body=HUB, fluid=PLATE, tip=TIP),
            "sail": Fixed(parent="fin", placement=TILTED, fluid=replace(PLATE, linear=(0, 0, 0, 0.1, 0.2, 0.3))),
        },
        loads={"water": Fluid(density=DENSITY, **water), "pull": Wrench(on="hub", force=(0.1, 0.2, -0.1))},
        actuators={"motor": JointTorque(joint="fin")},
    )


MADE = {
    "fan": fan(),
    "fan in a current": fan(velocity=CURRENT),
    "swimmer": swimmer(),
    "swimmer in a current": swimmer(velocity=CURRENT),
}
STILL = ["fan", "swimmer"]
SHAPES = ["straight", "bent"]


@cache
def functions(name):
    return Robot(MADE[name]).functions()


@cache
def flow_alone(name):
    """Functions with drag and lift, and of the same robot without any coefficient."""
    keys = "tangential", "normal", "lift", "linear", "drag"
    return [Robot(without(MADE[name], *kept)).functions() for kept in (keys, ())]


@cache
def on_land(name):
    return Robot(dry(MADE[name])).functions()


@cache
def water(name):
    return Water(MADE[name])


def motion(name, shape):
    """q, qd, qdd; tips turn by a rad a second or so."""
    scales = np.array(water(name).plain.scales)
    rng = np.random.default_rng(11)
    q, qd, qdd = (scales * rng.normal(size=scales.size) for _ in range(3))
    return q / 2 * (shape == "bent"), qd / np.sqrt(scales.size), qdd


def scale(M):
    return 1 / np.sqrt(np.diag(M))


def without(description, *keys):
    """The same robot with no coefficients but `keys` of its fluids."""
    segments = {}
    for name, s in description.segments.items():
        fluid = type(s.fluid)(**{k: getattr(s.fluid, k) for k in keys if hasattr(s.fluid, k)}) if s.fluid else None
        segments[name] = replace(s, fluid=fluid)
    return replace(description, segments=segments)


def dry(description):
    loads = {key: load for key, load in description.loads.items() if not isinstance(load, Fluid)}
    return replace(description, loads=loads)


# The oracle


class Water:
    """The laws of `model/fluids` on slices and bodies."""

    def __init__(self, description, density=DENSITY, points=None):
        self.plain, self.density, self._points = Plain(description), density, points

    def places(self):
        """(segment, X or None, weight [m], RodFluid or BodyFluid, radius, area)."""
        for name, s in self.plain.segments.items():
            if isinstance(s, Rod):
                edges = bounds(s)
                for a, b in zip(edges, edges[1:], strict=False):
                    for X, w in zip(*gauss(a, b, self._points or s.quadrature), strict=True):
                        yield name, X, w * s.length, s.fluid, *outline(slice_at(s.cross_section, X))
            elif s.fluid is not None:
                yield name, None, 1.0, s.fluid, None, None

    def frame(self, q, name, X, stations):
        """Where a slice or a centre of mass is [... 4 x 4]."""
        if X is not None:
            return self.plain.frame(q, name, X, stations)
        body = self.plain.segments[name].body
        return stations[name][1] @ shifted(body.com if body else (0, 0, 0))

    def moved(self, q, qd):
        """For each place: R, body twist [6], and body Jacobian [6 x n]."""
        q, qd = np.asarray(q, dtype=float), np.asarray(qd, dtype=float)
        directions = q + 1j * STEP * np.vstack([qd, np.eye(q.size)])
        stations = self.plain.stations(directions)
        for place in self.places():
            g = self.frame(directions, *place[:2], stations)
            twists = vee(np.linalg.inv(np.real(g[0])) @ np.imag(g) / STEP)
            yield place, np.real(g[0, :3, :3]), np.real(g[0, :3, 3]), twists[0], twists[1:].T

    def drag(self, q, qd, current=(0, 0, 0)):
        """Generalised force [n] of drag and lift."""
        total = np.zeros(self.plain.n)
        for (_, X, weight, fluid, radius, _), R, _, twist, J in self.moved(q, qd):
            w, n = twist[:3], twist[3:] - R.T @ current
            if X is None:
                gains = self.density * np.linalg.norm(n) * np.array(fluid.drag) + fluid.linear
                total -= J.T @ (gains * np.concatenate([w, n]))
                continue
            C_t, C_n, C_l = fluid.tangential, fluid.normal, fluid.lift
            D = np.array([[C_t, 0, 0], [0, C_n, C_l], [0, -C_l, C_n]])
            linear = np.array([fluid.linear[0], fluid.linear[1], fluid.linear[1]])
            force = -self.density * radius * np.linalg.norm(n) * D @ n - linear * n
            total += weight * J[3:].T @ force
        return total

    def added(self, place):
        """Diagonal [6] of what a place's water weighs."""
        _, X, weight, fluid, _, area = place
        if X is not None:
            c_y, c_z = fluid.added_mass
            return weight * self.density * area * np.array([0, 0, 0, 0, c_y, c_z])
        if fluid.spheroid is not None:
            return lamb(fluid.spheroid.along, fluid.spheroid.across, self.density)
        return np.array(fluid.added_mass or np.zeros(6))

    def added_mass(self, q):
        """[n x n]."""
        return sum(J.T * self.added(place) @ J for place, _, _, _, J in self.moved(q, 0 * np.asarray(q)))

    def momentum(self, q, qd):
        """[6] of the water that moves along, about the world's origin."""
        total = np.zeros(6)
        for place, R, r, twist, _ in self.moved(q, qd):
            p = self.added(place) * twist
            total += np.concatenate([R @ p[:3] + np.cross(r, R @ p[3:]), R @ p[3:]])
        return total


def outline(section):
    """Radius that water sees, and area that displaces it."""
    if isinstance(section, General):
        return section.radius, pi * section.radius**2
    area = fibres(section)[2].sum()
    if isinstance(section, Rectangle):
        return np.sqrt(section.width * section.height / pi), area
    if isinstance(section, Ellipse):
        return np.sqrt(section.radius_y * section.radius_z), area
    return section.radius, area


def lamb(a, b, density):
    """Diagonal [6] of a spheroid's added mass by the integrals of H. Lamb, "Hydrodynamics", 1932, secs. 114, 115."""
    def integral(power_a, power_b):
        """a b^2 int_0^inf (a^2 + s)^-p_a (b^2 + s)^-p_b ds, with s = b^2 (1/t^2 - 1)."""
        def f(t):
            return (a**2 + b**2 * (1 / t**2 - 1)) ** -power_a * (b**2 / t**2) ** -power_b * 2 * b**2 / t**3

        return a * b**2 * quad(f, 0, 1, epsabs=0, epsrel=1e-12)[0]

    alpha, beta = integral(1.5, 1), integral(0.5, 2)
    mass = 4 / 3 * pi * density * a * b**2
    if a == b:
        spin = 0.0
    else:
        square, total = a**2 - b**2, a**2 + b**2
        spin = mass / 5 * square**2 * (beta - alpha) / (2 * square + total * (alpha - beta))
    along, side = alpha / (2 - alpha), beta / (2 - beta)
    return np.array([0, spin, spin, mass * along, mass * side, mass * side])


# Drag and lift


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", MADE)
def test_drag_and_lift_are_the_sum_over_slices(name, shape):
    q, qd, _ = motion(name, shape)
    current = np.array(MADE[name].loads["water"].velocity)
    f, still = flow_alone(name)
    ours = array(f.external_force(q, qd)) - array(still.external_force(q, qd))
    assert gap(ours, water(name).drag(q, qd, current)) < 1e-11


def test_eight_points_a_section_are_enough_for_drag():
    """|n| has corners where it vanishes, so that the sums converge slowly there; forty points are the limit."""
    q, qd, _ = motion("swimmer", "bent")
    fine = Water(MADE["swimmer"], points=40)
    assert gap(water("swimmer").drag(q, qd), fine.drag(q, qd)) < 1e-4


def test_stored_forces_of_the_flagella_are_found_a_second_time():
    f, _, _ = stored_functions("hybrid_floating_flagella_fluid")
    again = Water(f.robot.description)
    for state in stored("hybrid_floating_flagella_fluid")["states"]:
        force, M = again.drag(state["q"], state["qd"]), again.added_mass(state["q"])
        assert gap(force, state["fluid_generalized_force"]) < 1e-11
        land = array(Robot(dry(f.robot.description)).functions().mass(state["q"]))
        assert gap(land + M, state["M"]) < 1e-11


def towed(fluid, direction, speed=0.7, body=None, length=0.3, radius=0.01):
    """Generalised force [6] on a straight rod or a body that slides along `direction`, weightless."""
    segments = {"carrier": Free(body=body or Body(0.1), fluid=None if isinstance(fluid, RodFluid) else fluid)}
    if isinstance(fluid, RodFluid):
        material = Linear(young_modulus=1e6, poisson_ratio=0.5, density=1000.0)
        segments["rod"] = Rod(
            parent="carrier", length=length, cross_section=Circle(radius=radius), material=material, fluid=fluid
        )
    loads = {"water": Fluid(density=DENSITY)}
    f = Robot(Description(segments=segments, gravity=(0.0, 0.0, 0.0), loads=loads)).functions()
    qd = np.zeros(f.robot.n)
    qd[3:6] = speed * np.array(direction) / np.linalg.norm(direction)
    return array(f.external_force(np.zeros(f.robot.n), qd)), qd


@pytest.mark.parametrize("direction, coefficient", [((1, 0, 0), 0.02), ((0, 1, 0), 1.1), ((0, 0, -1), 1.1)])
def test_a_sliding_rod_feels_drag_against_its_motion(direction, coefficient):
    force, qd = towed(RodFluid(tangential=0.02, normal=1.1), direction)
    expected = -DENSITY * 0.01 * 0.3 * coefficient * 0.7 * qd[3:6]
    np.testing.assert_allclose(force[3:6], expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(force[:3], np.cross([0.15, 0, 0], expected), rtol=1e-12, atol=1e-15)


def test_positive_lift_drives_against_y_where_the_rod_slides_along_z():
    force, _ = towed(RodFluid(lift=0.3), (0, 0, 1))
    np.testing.assert_allclose(force[3:6], [0, -DENSITY * 0.01 * 0.3 * 0.3 * 0.49, 0], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", STILL)
def test_lift_does_no_work_and_is_as_large_as_drag_of_its_coefficient(name):
    q, qd, _ = motion(name, "bent")
    bare = replace(without(MADE[name]), gravity=(0.0, 0.0, 0.0))

    def force(**changes):
        segments = {k: replace(s, fluid=RodFluid(**changes)) for k, s in bare.segments.items() if isinstance(s, Rod)}
        of = replace(bare, segments={**bare.segments, **segments}, loads={"water": bare.loads["water"]})
        return array(Robot(of).functions().external_force(q, qd))

    lift, drag = force(lift=0.4), force(normal=0.4)
    assert abs(lift @ qd) < 1e-13 * np.abs(lift) @ np.abs(qd)
    assert drag @ qd < -1e-3 * np.abs(drag) @ np.abs(qd)
    side, _ = towed(RodFluid(lift=0.4), (0, 1, 1))
    along, _ = towed(RodFluid(normal=0.4), (0, 1, 1))
    assert np.linalg.norm(side[3:6]) == pytest.approx(np.linalg.norm(along[3:6]), rel=1e-12)
    assert abs(side[3:6] @ along[3:6]) < 1e-13


@pytest.mark.parametrize("name", STILL)
def test_at_rest_the_slope_of_drag_is_the_linear_one(name):
    """|n| is smooth at 0: its slopes are finite, and what the square law leaves is 1e-9 m/s times it."""
    q = motion(name, "bent")[0]
    symbol = ca.SX.sym("qd", q.size)
    external = functions(name).external_force.function(ca.DM(q), symbol)
    slope_at_rest = array(ca.Function("slope", [symbol], [ca.densify(ca.jacobian(external, symbol))])(0 * q))
    only = Robot(replace(without(MADE[name], "linear"), gravity=(0.0, 0.0, 0.0))).functions()
    at_rest = array(only.external_force(q, 0 * q))
    columns = np.array([array(only.external_force(q, e)) - at_rest for e in np.eye(q.size)])
    assert gap(slope_at_rest, columns.T) < 1e-6


# Added mass


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", MADE)
def test_added_mass_raises_M_by_that_of_its_places(name, shape):
    q, _, _ = motion(name, shape)
    M = array(functions(name).mass(q))
    land = array(on_land(name).mass(q))
    s = np.outer(scale(M), scale(M))
    assert np.abs(s * (M - land - water(name).added_mass(q))).max() < 1e-11
    assert np.abs(s * (M - M.T)).max() < 1e-12
    assert np.linalg.eigvalsh(s * M)[0] > 0
    assert np.abs(s * (M - land)).max() > 0.1


def test_a_rod_that_swings_in_water_has_a_third_of_its_water_at_its_end():
    def swing(added):
        arm = Rod(
            parent="hinge", length=0.4, cross_section=Circle(radius=0.01), fluid=RodFluid(added_mass=added),
            material=Linear(young_modulus=1e6, poisson_ratio=0.5, density=1000.0),
        )  # fmt: skip
        segments = {"hinge": Revolute(axis=(0, 0, 1.0)), "arm": arm}
        loads = {"water": Fluid(density=DENSITY)}
        return array(Robot(Description(segments=segments, loads=loads)).functions().mass(np.zeros(5)))[0, 0]

    assert swing((0.8, 0.3)) - swing((0, 0.3)) == pytest.approx(0.8 * DENSITY * pi * 1e-4 * 0.4**3 / 3, rel=1e-12)
    assert swing((0, 0.3)) == swing((0, 0))  # z does not move


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", STILL)
def test_the_rate_of_M_in_water_is_C_plus_its_transpose(name, shape):
    q, qd, _ = motion(name, shape)
    f, M = functions(name), array(functions(name).mass(q))
    C = array(f.coriolis(q, qd))
    rate = slope(lambda t: f.mass(q + t * qd))
    s = np.outer(scale(M), scale(M))
    assert np.abs(s * (rate - C - C.T)).max() < 1e-11 * np.abs(s * C).max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", STILL)
def test_inertial_forces_in_water_are_those_of_lagrange(name, shape):
    """M qdd + M' qd - d(qd M qd / 2)/dq, with the derivatives of M by differences; and C qd is the same."""
    q, qd, qdd = motion(name, shape)
    f, mass = functions(name), functions(name).mass
    M, n = array(mass(q)), q.size
    rate = slope(lambda t: mass(q + t * qd))
    gradient = [
        array(slope(lambda t, e=e: np.array([qd @ array(mass(q + t * e)) @ qd / 2]))).item()
        for e in np.diag(water(name).plain.scales)
    ] / np.array(water(name).plain.scales)
    expected = M @ qdd + rate @ qd - gradient
    others = array(f.elastic_force(q)) + array(f.damping(q)).reshape(n, n) @ qd - array(f.external_force(q, qd))
    ours = array(f.inverse_dynamics(q, qd, qdd)) - others
    s = scale(M)
    assert np.abs(s * (ours - expected)).max() < 1e-11 * np.abs(s * expected).max() + 1e-14 * np.abs(s * others).max()
    assert np.abs(s * (array(f.coriolis(q, qd)) @ qd - rate @ qd + gradient)).max() < 1e-11 * np.abs(s * expected).max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", STILL)
def test_energy_and_momentum_in_water_have_the_water_that_moves_along(name, shape):
    q, qd, qdd = motion(name, shape)
    f, land = functions(name), on_land(name)
    kinetic = array(f.energy(q, qd))[0]
    assert kinetic == pytest.approx(qd @ array(f.mass(q)) @ qd / 2, rel=1e-11)
    more = array(f.momentum(q, qd)) - array(land.momentum(q, qd))
    assert gap(more, water(name).momentum(q, qd)) < 1e-11
    rate = slope(lambda t: f.energy(q + t * qd + t**2 / 2 * qdd, qd + t * qdd)).sum()
    lost = array(f.damping(q)).reshape(q.size, -1) @ qd - water(name).drag(q, qd)
    pull = Plain(replace(dry(MADE[name]), gravity=(0.0, 0.0, 0.0))).external_force(q)
    power = qd @ array(f.inverse_dynamics(q, qd, qdd)) - qd @ lost + qd @ pull
    assert rate == pytest.approx(power, rel=1e-10)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", MADE)
def test_articulated_bodies_in_water_are_the_inverse_of_newton_euler(name, shape):
    q, qd, _ = motion(name, shape)
    f, M = functions(name), array(functions(name).mass(q))
    u = np.full(f.robot.m, 0.3)
    qdd = array(f.forward_dynamics(q, qd, u))
    Bu = array(f.actuation(q)).reshape(q.size, -1) @ u
    s = scale(M)
    assert np.abs(s * (array(f.inverse_dynamics(q, qd, qdd)) - Bu)).max() < 1e-11 * np.abs(s * (M @ qdd)).max()
    more = array(f.inverse_dynamics(q, qd, qdd)) - array(f.inverse_dynamics(q, qd, 0 * q))
    assert np.abs(s * (more - M @ qdd)).max() < 1e-11 * np.abs(s * (M @ qdd)).max()


WATERBORNE = [
    name for name in SHIPPED if any(s.fluid not in (None, RodFluid()) for s in socontrol.load_robot(
        SHIPPED[name]).description.segments.values())
]  # fmt: skip


@pytest.mark.parametrize("name", WATERBORNE)
def test_shipped_robots_obey_the_laws_in_a_current(name):
    description = socontrol.load_robot(SHIPPED[name]).description
    segments = {k: shortened(s) for k, s in description.segments.items()}
    loads = {k: v for k, v in (description.loads or {}).items() if not isinstance(v, Fluid)}
    wet = replace(description, segments=segments, loads={**loads, "sea": Fluid(density=DENSITY, velocity=CURRENT)})
    f, oracle = Robot(wet).functions(), Water(wet)
    rng, scales = np.random.default_rng(2), np.array(oracle.plain.scales)
    q, qd = (scales * rng.normal(size=scales.size) / np.sqrt(scales.size) for _ in range(2))
    M, C = array(f.mass(q)), array(f.coriolis(q, qd))
    s = scale(M)
    rate = slope(lambda t: f.mass(q + t * qd))
    assert np.abs(np.outer(s, s) * (rate - C - C.T)).max() < 1e-10 * np.abs(np.outer(s, s) * C).max()
    land = array(Robot(replace(wet, loads=loads)).functions().mass(q))
    assert np.abs(np.outer(s, s) * (M - land - oracle.added_mass(q))).max() < 1e-10
    qdd = array(f.forward_dynamics(q, qd, np.zeros(f.robot.m)))
    left = s * array(f.inverse_dynamics(q, qd, qdd))
    assert np.abs(left).max() < 1e-10 * np.abs(s * (M @ qdd)).max()


# Spheroids


TABLE = {  # a/b: k along, k across, k turning, three digits (H. Lamb, "Hydrodynamics", 1932, sec. 115)
    1.5: (0.305, 0.621, 0.094), 2.0: (0.209, 0.702, 0.240), 3.99: (0.082, 0.860, 0.608), 4.99: (0.059, 0.895, 0.701),
    9.97: (0.021, 0.960, 0.883),
}  # fmt: skip


def spheroid(a, b=1.0):
    """Added inertia and mass [6] in water of density 1."""
    return np.concatenate([array(part) for part in Spheroid(along=a, across=b).added(1.0)])


@pytest.mark.parametrize("ratio", TABLE)
def test_coefficients_of_prolate_spheroids_are_those_of_lambs_table(ratio):
    """Computed by hand a century ago, up to 0.0022 off his own integrals, which the next test takes to ten digits."""
    mass, entries = 4 / 3 * pi * ratio, spheroid(ratio)
    displaced = np.array([mass, mass, mass * (ratio**2 + 1) / 5])
    np.testing.assert_allclose(entries[[3, 4, 2]] / displaced, TABLE[ratio], atol=2.5e-3)


@pytest.mark.parametrize("ratio", [0.05, 0.3, 0.9, 0.985, 0.99, 0.995, 1.005, 1.01, 1.0102, 1.02, 2, 5, 10, 50])
def test_coefficients_of_spheroids_are_lambs_integrals(ratio):
    """On both sides of the switch to a series near the sphere; turning is the square of a small number there."""
    expected = lamb(ratio * 0.7, 0.7, 1.0)
    ours = spheroid(ratio * 0.7, 0.7)
    np.testing.assert_allclose(ours[3:], expected[3:], rtol=1e-10)
    np.testing.assert_allclose(ours[:3], expected[:3], rtol=1e-7 if abs(ratio - 1) < 0.1 else 1e-9)


def test_a_sphere_carries_half_its_water_and_turns_freely():
    np.testing.assert_allclose(spheroid(0.3, 0.3), [0, 0, 0, *[2 / 3 * pi * 0.3**3] * 3], rtol=1e-14)


@pytest.mark.parametrize("nearly", [1 - 1e-12, 1 - 1e-8, 1 - 1e-4, 1 + 1e-4, 1 + 1e-8, 1 + 1e-12])
def test_coefficients_are_continuous_at_the_sphere(nearly):
    away = spheroid(nearly) - spheroid(1.0)
    assert np.abs(away).max() < 10 * abs(nearly - 1) + 1e-14
    assert np.all(away[:3] >= 0) and np.abs(away[:3]).max() < abs(nearly - 1) ** 2 * 2 + 1e-20


def test_a_flat_spheroid_tends_to_the_disc():
    """8/3 rho b^3 along the axis and 16/45 rho b^5 about a diameter (H. Lamb, 1932), to first order in a."""
    errors = [np.abs(spheroid(a)[[3, 2]] / [8 / 3, 16 / 45] - 1).max() for a in (1e-3, 1e-4)]
    assert errors[0] < 3e-3 and errors[1] < errors[0] / 8


def test_added_mass_and_a_spheroid_exclude_each_other():
    with pytest.raises(Bad, match="not both"):
        BodyFluid(added_mass=(0.0,) * 6, spheroid=Spheroid(along=1.0, across=1.0))


# Buoyancy


def submerged(water_density, rod_density, body_mass, volume):
    """A cantilever with a body at its end."""
    material = Linear(young_modulus=2e5, poisson_ratio=0.5, density=rod_density)
    arm = rod(material=material, cross_section=HOLED, strains="simo_reissner")
    body = Body(mass=body_mass, com=(0.01, 0.02, 0.0), displaced_volume=volume)
    loads = {"water": Fluid(density=water_density)} if water_density else None
    return Robot(Description(segments={"arm": arm, "cap": Fixed(parent="arm", body=body)}, loads=loads))


def equilibrium(robot, steps=40):
    """Newton's method, weight by weight."""
    f, q = robot.functions(), np.zeros(robot.n)
    for _ in range(steps):
        step = np.linalg.solve(array(f.static_tangent(q, [])), array(f.static_residual(q, [])))
        q = q - step * min(1, 3 / np.abs(step).max())
    assert np.abs(step).max() < 1e-10
    return q


def test_a_submerged_cantilever_rests_as_a_lighter_one():
    q = equilibrium(submerged(DENSITY, 1300.0, 0.05, 3e-5))
    np.testing.assert_allclose(q, equilibrium(submerged(None, 300.0, 0.02, 0.0)), atol=1e-9)
    assert np.abs(q).max() > 0.5
    afloat = equilibrium(submerged(DENSITY, 1000.0, 0.03, 3e-5))
    np.testing.assert_allclose(afloat, 0, atol=1e-12)


@pytest.mark.parametrize("name", STILL)
def test_weight_in_water_is_the_slope_of_its_energy(name):
    q, _, _ = motion(name, "bent")
    f = Robot(replace(MADE[name], loads={"water": MADE[name].loads["water"]})).functions()
    slopes_of_energy = [slope(lambda t, e=e: f.energy(q + t * e, 0 * q))[2] for e in np.eye(q.size)]
    assert gap(f.external_force(q, 0 * q), -np.array(slopes_of_energy)) < 1e-10


def test_a_body_of_its_waters_weight_neither_sinks_nor_rises():
    body = Body(mass=0.2, com=(0.01, 0.0, 0.02), displaced_volume=0.2 / DENSITY)
    f = Robot(Description(segments={"fish": Free(body=body)}, loads={"water": Fluid(density=DENSITY)})).functions()
    q = np.array([0.3, -0.2, 0.5, 0.1, 0.0, 0.2])
    np.testing.assert_allclose(array(f.external_force(q, 0 * q)), 0, atol=1e-15)
    assert abs(array(f.energy(q, 0 * q))[2]) < 1e-15


# Moving water


def carried_along(f, q, qd, qdd, velocity):
    """(qd, qdd) of a free robot whose every point moves by `velocity` [3] more, and accelerates no differently."""
    jacobian, n = f.jacobian("hub", 1.0), q.size
    J = array(jacobian(q))[:, :6]
    g, twist = array(f.pose("hub")(q)), array(jacobian(q)) @ qd
    more = np.concatenate([np.zeros(3), g[:3, :3].T @ velocity])
    rate = np.concatenate([np.zeros(3), -np.cross(twist[:3], more[3:])])  # of `more`, which stands still in space
    other = qd + np.concatenate([np.linalg.solve(J, more), np.zeros(n - 6)])
    bias = slope(lambda t: array(jacobian(q + t * qd))[:, :6]) @ qd[:6]
    other_bias = slope(lambda t: array(jacobian(q + t * other))[:, :6]) @ other[:6]
    base = np.linalg.solve(J, rate + bias - other_bias)
    return other, qdd + np.concatenate([base, np.zeros(n - 6)])


@pytest.mark.parametrize("shape", SHAPES)
def test_only_the_motion_against_the_water_counts(shape):
    """Galilei: the whole robot and the water move by one velocity more, and all forces stay."""
    q, qd, qdd = motion("swimmer", shape)
    still, flowing = functions("swimmer"), functions("swimmer in a current")
    in_still = array(still.inverse_dynamics(q, qd, qdd))
    in_flow = array(flowing.inverse_dynamics(q, *carried_along(still, q, qd, qdd, np.array(CURRENT))))
    assert gap(in_flow, in_still) < 1e-10
    assert gap(flowing.inverse_dynamics(q, qd, qdd), in_still) > 1e-3


def test_what_drifts_with_the_water_feels_its_weight_alone():
    q, _, _ = motion("swimmer", "bent")
    qd, _ = carried_along(functions("swimmer"), q, 0 * q, 0 * q, np.array(CURRENT))
    drifting = array(functions("swimmer in a current").external_force(q, qd))
    rest = array(functions("swimmer").external_force(q, 0 * q))
    # added mass in a current: its terms C qd are those of the velocity against the water, which is none
    in_motion = array(functions("swimmer").coriolis(q, qd)) @ qd
    land = array(on_land("swimmer").coriolis(q, qd)) @ qd
    assert gap(drifting, rest + in_motion - land) < 1e-10


def test_a_current_pushes_as_towing_against_it_does():
    q, _, _ = motion("swimmer", "bent")
    still, flowing = (flow_alone(name)[0] for name in ("swimmer", "swimmer in a current"))
    towing, _ = carried_along(still, q, 0 * q, 0 * q, -np.array(CURRENT))
    assert gap(flowing.external_force(q, 0 * q), still.external_force(q, towing)) < 1e-11


def test_statics_in_a_current_have_its_push_and_their_tangent_is_its_slope():
    f = functions("fan in a current")
    q, _, _ = motion("fan in a current", "bent")
    residual = array(f.static_residual(q, []))
    assert gap(residual, array(f.inverse_dynamics(q, 0 * q, 0 * q))) < 1e-12
    direction = np.array(water("fan").plain.scales) * np.cos(np.arange(q.size))
    expected = slope(lambda t: f.static_residual(q + t * direction, []), h=H / 10)
    assert gap(array(f.static_tangent(q, [])) @ direction, expected) < 1e-8


# Falling and rising


def sphere(mass, radius, **fluid):
    volume = 4 / 3 * pi * radius**3
    body = Body(mass=mass, inertia=(0.4 * mass * radius**2,) * 3, displaced_volume=volume)
    ball = Free(body=body, fluid=BodyFluid(**fluid), placement=TILTED)
    return Robot(Description(segments={"ball": ball}, loads={"water": Fluid(density=DENSITY)})).functions()


def test_a_sphere_falls_at_the_speed_where_drag_is_its_weight_in_water():
    radius, mass, C_d = 0.03, 0.2, 0.47
    push = C_d / 2 * pi * radius**2
    f = sphere(mass, radius, drag=(0, 0, 0, push, push, push), added_mass=(0, 0, 0, 0.05, 0.05, 0.05))
    speed = np.sqrt((mass - DENSITY * 4 / 3 * pi * radius**3) * G / (DENSITY * push))
    q = np.zeros(6)
    R = array(f.pose("ball")(q))[:3, :3]
    down = np.linalg.solve(array(f.jacobian("ball")(q)), [0, 0, 0, *(R.T @ [0, 0, -speed])])
    np.testing.assert_allclose(array(f.external_force(q, down)), 0, atol=1e-12 * mass * G)
    np.testing.assert_allclose(array(f.forward_dynamics(q, down, [])), 0, atol=1e-11)
    faster = array(f.jacobian("ball")(q)) @ array(f.forward_dynamics(q, 1.1 * down, []))
    assert (R @ faster[3:])[2] > 0.1  # it is slowed down


def test_a_rod_falls_broadside_at_the_speed_where_drag_is_its_weight_in_water():
    radius, length, density, C_n = 0.01, 0.4, 1300.0, 1.1
    stick = Rod(
        parent="carrier", length=length, cross_section=Circle(radius=radius), fluid=RodFluid(normal=C_n),
        material=Linear(young_modulus=1e6, poisson_ratio=0.5, density=density),
    )  # fmt: skip
    robot = Robot(Description(segments={"carrier": Free(), "stick": stick}, loads={"water": Fluid(density=DENSITY)}))
    speed = np.sqrt((density - DENSITY) * pi * radius * G / (DENSITY * C_n))
    qd = np.zeros(robot.n)
    qd[5] = -speed
    f = robot.functions()
    weight = (density - DENSITY) * pi * radius**2 * length * G
    np.testing.assert_allclose(array(f.external_force(0 * qd, qd)), 0, atol=1e-12 * weight)
    np.testing.assert_allclose(array(f.external_force(0 * qd, 0 * qd))[5], -weight, rtol=1e-12)


def test_a_released_sphere_rises_with_half_its_water():
    radius, mass = 0.05, 0.1
    f = sphere(mass, radius, spheroid=Spheroid(along=radius, across=radius))
    water_mass = DENSITY * 4 / 3 * pi * radius**3
    q = np.array([0.3, 0.5, -0.4, 0.1, 0.2, 0.0])
    qdd = array(f.forward_dynamics(q, 0 * q, []))
    R = array(f.pose("ball")(q))[:3, :3]
    rise = array(f.jacobian("ball")(q)) @ qdd
    expected = (water_mass - mass) * G / (mass + water_mass / 2)
    np.testing.assert_allclose(R @ rise[3:], [0, 0, expected], atol=1e-12 * expected)


def test_a_spheroid_across_the_stream_turns_broadside():
    """Munk's moment: (N_x - N_y) v_x v_y about z, the sign of which turns a slender body across its path."""
    fluid = BodyFluid(spheroid=Spheroid(along=0.2, across=0.05))
    egg = Free(body=Body(mass=1.0, inertia=(0.1, 0.1, 0.1)), fluid=fluid)
    loads = {"water": Fluid(density=DENSITY)}
    f = Robot(Description(segments={"egg": egg}, gravity=(0.0, 0.0, 0.0), loads=loads)).functions()
    N = lamb(0.2, 0.05, DENSITY)
    qd = np.array([0, 0, 0, 0.5, 0.2, 0])
    turning = array(f.forward_dynamics(np.zeros(6), qd, []))[:3]
    np.testing.assert_allclose(turning, [0, 0, (N[3] - N[4]) * 0.1 / (0.1 + N[2])], rtol=1e-12, atol=1e-15)
    assert turning[2] < 0  # nose at +x, drifting to +y: it turns away from its path


# Kinds of numbers, and parameters


@pytest.mark.parametrize("name", ["swimmer in a current"])
def test_terms_in_water_are_the_same_as_DM_SX_and_MX(name):
    q, qd, qdd = motion(name, "bent")
    robot = functions(name).robot

    def terms(q, qd, qdd):
        kin = Kinematics(robot.tree, q)
        return [
            composite.mass(robot, kin), composite.coriolis(robot, kin, qd), newton_euler.water_force(robot, q, qd),
            newton_euler.inertial_force(robot, q, qd, qdd), articulated.accelerations(robot, q, qd, 0 * qdd),
        ]  # fmt: skip

    numbers = terms(*map(ca.DM, (q, qd, qdd)))
    for kind in (ca.SX, ca.MX):
        symbols = [kind.sym(name, q.size) for name in ("q", "qd", "qdd")]
        answers = ca.Function("terms", symbols, [kind(x) for x in terms(*symbols)])(q, qd, qdd)
        for answer, number in zip(answers, numbers, strict=True):
            assert gap(ca.densify(answer), ca.densify(number)) < 1e-11


PARAMETERS = {
    "loads.water.velocity": (0.1, 0.3, -0.2),
    "hub.body.displaced_volume": 3e-4,
    "hub.fluid.drag": (3e-6, 2e-6, 1e-6, 2e-3, 1e-3, 4e-3),
    "tail.fluid.normal": 0.8,
    "tail.fluid.lift": 0.2,
    "tail.fluid.added_mass": (0.4, 0.7),
    "tail.cross_section.radius": 0.012,
    "fin.fluid.added_mass": (2e-5, 1e-5, 2e-5, 0.02, 0.03, 0.04),
}


@pytest.mark.parametrize(
    "name",
    [
        "fan",
        "swimmer",
    ],
)
def test_the_density_of_the_water_may_be_a_parameter(name):
    path, (q, qd, qdd) = "loads.water.density", motion(name, "bent")
    f, other = Functions(Robot(MADE[name]), [path]), Robot(MADE[name]).with_values({path: 1100.0}).functions()
    assert gap(f.inverse_dynamics(q, qd, qdd, [1100.0]), other.inverse_dynamics(q, qd, qdd)) < 1e-11
    assert gap(f.mass(q, [1100.0]), other.mass(q)) < 1e-11


def test_parameters_of_the_water_act_as_in_a_rebuilt_robot():
    original = Robot(MADE["swimmer in a current"])
    f, (q, qd, qdd) = Functions(original, list(PARAMETERS)), motion("swimmer", "bent")
    start = 0
    for path, value in PARAMETERS.items():
        p = f.defaults.copy()
        p[start : start + np.size(value)] = np.ravel(value)
        start += np.size(value)
        other = original.with_values({path: value}).functions()
        assert gap(f.inverse_dynamics(q, qd, qdd, p), other.inverse_dynamics(q, qd, qdd)) < 1e-11, path
        assert gap(f.external_force(q, qd, p), other.external_force(q, qd)) < 1e-11, path
        assert gap(f.mass(q, p), other.mass(q)) < 1e-11, path
        assert gap(f.inverse_dynamics(q, qd, qdd, p), f.inverse_dynamics(q, qd, qdd, f.defaults)) > 1e-6, path
