"""Cross-sections, materials, bodies, rods and the tree: what the records of a robot stand for."""

from dataclasses import replace
from math import pi

import casadi as ca
import numpy as np
import pytest
from robots import (
    BODY,
    DISC,
    RUBBER,
    TABLE,
    Plain,
    array,
    disc,
    fibres,
    gap,
    hat,
    rod,
    slice_at,
    spring,
    stiffening,
)

from socontrol.mechanics.actuators import Chamber, Converging, JointTorque, Tendon
from socontrol.mechanics.loads import Distributed, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bases import STRAIN_SETS, STRAINS, active_strains, selection
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import JOINTS, Cylindrical, Fixed, Planar, Revolute, normal_basis
from socontrol.model.materials import Energy, Gent, Linear, Polynomial, inertia_density, linear_stiffness
from socontrol.model.quadrature import gauss_legendre
from socontrol.model.sections import (
    Annulus,
    Circle,
    Ellipse,
    General,
    Hole,
    Rectangle,
    SectionTable,
    TableRow,
    Taper,
    rectangle_torsion,
    section_at,
)

SIDE = Hole(offset=(0.003, -0.006), radius=0.002)
TRIO = tuple(
    Hole(offset=(0.006 * np.cos(a), 0.006 * np.sin(a)), radius=0.002) for a in 0.3 + 2 * pi / 3 * np.arange(3)
)
SHAPES = {
    "circle": DISC,
    "circle_one_hole": Circle(radius=0.01, holes=(SIDE,)),
    "circle_three_holes": Circle(radius=0.01, holes=TRIO),
    "annulus": Annulus(inner_radius=0.003, radius=0.01),
    "annulus_one_hole": Annulus(inner_radius=0.003, radius=0.01, holes=(SIDE,)),
    "annulus_three_holes": Annulus(inner_radius=0.003, radius=0.01, holes=TRIO),
    "rectangle": Rectangle(width=0.01, height=0.02),
    "rectangle_one_hole": Rectangle(width=0.02, height=0.03, holes=(SIDE,)),
    "ellipse": Ellipse(radius_y=0.01, radius_z=0.006),
    "ellipse_one_hole": Ellipse(radius_y=0.01, radius_z=0.013, holes=(SIDE,)),
}
ELASTIC = dict(young_modulus=3e5, shear_modulus=1.1e5, density=1080.0)


def bends(kappa_y, kappa_z):
    return ca.DM([0, kappa_y, kappa_z, 0, 0, 0])


# Sections


@pytest.mark.parametrize("name", SHAPES)
def test_moments_are_sums_over_the_fibres_of_the_slice(name):
    y, z, dA = fibres(SHAPES[name])
    m = SHAPES[name].moments()
    expected = [dA.sum(), z @ dA, y @ dA, z**2 @ dA, y**2 @ dA, (y * z) @ dA]
    scale = np.array([1, 0.01, 0.01, 1e-4, 1e-4, 1e-4]) * expected[0]
    assert np.abs((np.array(m[:6], dtype=float) - expected) / scale).max() < 1e-14


@pytest.mark.parametrize("name", [name for name in SHAPES if name.startswith(("circle", "annulus"))])
def test_torsion_constant_of_round_shapes_is_their_polar_moment(name):
    y, z, dA = fibres(SHAPES[name])
    assert SHAPES[name].moments().Jt == pytest.approx((y**2 + z**2) @ dA, rel=1e-13)


def test_torsion_constant_of_an_ellipse_is_twice_the_volume_below_its_stress_function():
    """Prandtl: laplace phi = -2, phi = 0 on the rim, Jt = 2 int phi dA; phi = c (1 - y^2/a^2 - z^2/b^2)."""
    a, b = 0.01, 0.006
    y, z, dA = disc(a, b).reshape(3, -1)
    c = 2 / (2 / a**2 + 2 / b**2)
    expected = 2 * c * (1 - (y / a) ** 2 - (z / b) ** 2) @ dA
    assert SHAPES["ellipse"].moments().Jt == pytest.approx(expected, rel=1e-13)


def test_torsion_constant_of_a_rectangle_is_that_of_its_stress_function():
    """Ritz: phi = sum c_ij cos(i pi y/a) cos(j pi z/b) over odd i, j minimises int |grad phi|^2/2 - 2 phi."""
    width, height = 0.012, 0.02
    odd = np.arange(1, 2000, 2)
    i, j = np.meshgrid(odd, odd)
    signs = (-1.0) ** ((i + j) // 2 - 1)
    mean = 4 * width * height / (pi**2 * i * j) * signs  # int cos cos dA
    c = 2 * mean / ((pi * i / width) ** 2 + (pi * j / height) ** 2) / (width * height / 4)
    assert rectangle_torsion(width, height) == pytest.approx(2 * (c * mean).sum(), rel=1e-8)


@pytest.mark.parametrize(
    "ratio, k", [(1, 0.1406), (1.5, 0.196), (2, 0.229), (3, 0.263), (5, 0.291), (10, 0.312)]
)
def test_torsion_constants_of_rectangles_are_those_of_the_table(ratio, k):
    """k = Jt/(a b^3): S. Timoshenko, J. Goodier, Theory of Elasticity, 1970, sec. 109."""
    assert rectangle_torsion(0.01, 0.01 * ratio) == pytest.approx(k * ratio * 0.01**4, rel=3e-3)
    assert rectangle_torsion(0.01 * ratio, 0.01) == rectangle_torsion(0.01, 0.01 * ratio)


def test_a_given_torsion_constant_counts_and_changes_nothing_else():
    given = replace(SHAPES["rectangle"], torsion_constant=1e-9).moments()
    assert given == SHAPES["rectangle"].moments()._replace(Jt=1e-9)


@pytest.mark.parametrize("name", ["circle_three_holes", "annulus_three_holes"])
def test_three_even_holes_leave_a_centred_isotropic_section(name):
    m = SHAPES[name].moments()
    assert (m.Sy, m.Sz, m.Jyz) == (0, 0, 0)
    assert m.Jy == pytest.approx(m.Jz, rel=1e-13)


@pytest.mark.parametrize("name", SHAPES)
def test_stiffness_is_the_second_derivative_of_the_energy_of_the_fibres(name):
    """W = int E (p + z k_y - y k_z)^2/2 + G |shear|^2/2 dA, the twist's own share corrected to Jt."""
    E, G = 3e5, 1.1e5
    y, z, dA = fibres(SHAPES[name])
    o = 0 * y
    axial = np.array([o, z, -y, 1 + o, o, o])
    shear_y, shear_z = np.array([-z, o, o, o, 1 + o, o]), np.array([y, o, o, o, o, 1 + o])
    expected = E * (axial * dA) @ axial.T + G * ((shear_y * dA) @ shear_y.T + (shear_z * dA) @ shear_z.T)
    expected[0, 0] = G * SHAPES[name].moments().Jt
    Sigma = array(linear_stiffness(Linear(**ELASTIC), SHAPES[name]))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((Sigma - expected) / scale).max() < 1e-13
    assert np.linalg.eigvalsh(Sigma / scale).min() > 0


@pytest.mark.parametrize("name", SHAPES)
def test_inertia_density_is_that_of_the_fibres(name):
    """Twice the kinetic energy a metre, eta^T M eta = int rho |v + w x r|^2 dA."""
    M = array(inertia_density(Linear(**ELASTIC), SHAPES[name]))
    expected = np.zeros((6, 6))
    for y, z, dA in fibres(SHAPES[name]).T:
        velocity = np.hstack([-hat(np.array([0, y, z, 0, 0, 0]))[:3, :3], np.eye(3)])
        expected += 1080.0 * dA * velocity.T @ velocity
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((M - expected) / scale).max() < 1e-13


def test_the_stiffness_of_a_ten_millimetre_rubber_disc():
    m = DISC.moments()
    np.testing.assert_allclose(
        [m.A, m.Jy, m.Jz, m.Jt], [pi * 1e-4, pi / 4 * 1e-8, pi / 4 * 1e-8, pi / 2 * 1e-8]
    )
    Sigma = np.diag(
        array(linear_stiffness(Linear(young_modulus=110e3, poisson_ratio=0.0, density=1.0), DISC))
    )
    EJ, EA = 110e3 * pi / 4 * 1e-8, 110e3 * pi * 1e-4
    np.testing.assert_allclose(Sigma, [EJ, EJ, EJ, EA, EA / 2, EA / 2], rtol=1e-14)  # nu = 0: G = E/2


def test_general_sections_are_their_numbers():
    section = General(stiffness=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0), inertia=(0.1, 0.2, 0.3, 0.4, 0.4, 0.4))
    np.testing.assert_array_equal(array(linear_stiffness(RUBBER, section)), np.diag([1, 2, 3, 4, 5, 6]))
    np.testing.assert_array_equal(
        array(inertia_density(RUBBER, section)), np.diag([0.1, 0.2, 0.3, 0.4, 0.4, 0.4])
    )


def test_viscous_damping_is_one_for_twist_and_shear_and_three_for_bending_and_stretch():
    y, z, dA = fibres(SHAPES["ellipse"])
    Jy, Jz, A = z**2 @ dA, y**2 @ dA, dA.sum()
    D = array(Linear(**ELASTIC, viscosity=300.0).damping(SHAPES["ellipse"]))
    np.testing.assert_allclose(D, 300 * np.diag([Jy + Jz, 3 * Jy, 3 * Jz, 3 * A, A, A]), rtol=1e-13)


def test_damping_of_a_robot_is_the_sum_over_rods_and_joints():
    segments = {
        "ball": JOINTS["spherical"](damping=(0.1, 0.2, 0.3)),
        "rod": rod(parent="ball", strains=("stretch",)),
    }
    D = array(Robot(Description(segments=segments)).functions().damping(np.zeros(5)))
    stretch = 300 * 3 * pi * 1e-4 * 0.125
    np.testing.assert_allclose(D, np.diag([0.1, 0.2, 0.3, stretch, stretch]), rtol=1e-13)


# Profiles


@pytest.mark.parametrize("X", [0.0, 0.2, 0.5, 0.77, 1.0])
def test_profiles_are_linear_between_their_sections(X):
    taper = Taper(
        start=Annulus(inner_radius=0.002, radius=0.01), end=Annulus(inner_radius=0.001, radius=0.004)
    )
    here = section_at(taper, X)
    assert here.radius == pytest.approx(0.01 - 0.006 * X, rel=1e-15)
    assert here.inner_radius == pytest.approx(0.002 - 0.001 * X, rel=1e-15)
    row, other = section_at(TABLE, X), slice_at(TABLE, X)
    assert row.radius_y == pytest.approx(other.radius_y, rel=1e-14)
    assert row.radius_z == pytest.approx(np.interp(X, [0, 0.5, 1], [0.009, 0.008, 0.007]), rel=1e-14)
    assert section_at(DISC, X) is DISC


def test_holes_taper_with_their_section():
    holes = [(Hole(offset=(0.006, 0.0), radius=0.002),), (Hole(offset=(0.002, 0.001), radius=0.001),)]
    taper = Taper(start=Circle(radius=0.01, holes=holes[0]), end=Circle(radius=0.004, holes=holes[1]))
    middle = Circle(radius=0.007, holes=(Hole(offset=(0.004, 0.0005), radius=0.0015),))
    np.testing.assert_allclose(section_at(taper, 0.5).moments(), middle.moments(), rtol=1e-13)


def test_the_volume_of_a_cone_is_met_by_its_quadrature():
    cone = rod(
        cross_section=Taper(start=Circle(radius=0.012), end=Circle(radius=0.003)), sections=(0.2, 0.5, 0.3)
    )
    slices = [p for i in range(3) for p in cone.slices(i)]
    volume = sum(p.weight * p.section.moments().A for p in slices)
    assert volume == pytest.approx(pi * 0.25 / 3 * (0.012**2 + 0.012 * 0.003 + 0.003**2), rel=1e-14)
    assert [p.X for p in slices] == sorted(p.X for p in slices)
    assert sum(p.weight for p in cone.slices(1, start=0.25, stop=0.75)) == pytest.approx(0.0625)


@pytest.mark.parametrize("count", [1, 2, 5, 8, 20])
def test_gauss_points_integrate_polynomials_of_their_degree(count):
    nodes, weights = map(np.array, gauss_legendre(count))
    for degree in range(2 * count):
        assert weights @ nodes**degree == pytest.approx(1 / (degree + 1), rel=1e-13)


# Materials


def random_strain(size=1.0):
    rng = np.random.default_rng(3)
    return size * rng.uniform(-1, 1, 6) * [20, 20, 20, 0.2, 0.2, 0.2]


@pytest.mark.parametrize("name", SHAPES)
def test_a_quadratic_energy_is_the_linear_law(name):
    linear, section, eps = Linear(**ELASTIC), SHAPES[name], ca.DM(random_strain())
    Sigma = ca.DM(array(linear_stiffness(linear, section)))
    quadratic = Energy(W=lambda e, section: ca.bilin(Sigma, e, e) / 2, density=1080.0)
    assert gap(quadratic.force(eps, section), linear.force(eps, section)) < 1e-12
    assert gap(quadratic.stiffness(eps, section), linear.stiffness(eps, section)) < 1e-12
    assert float(quadratic.energy(eps, section)) == pytest.approx(
        float(linear.energy(eps, section)), rel=1e-12
    )


@pytest.mark.parametrize("law", [Polynomial, Gent])
@pytest.mark.parametrize("name", SHAPES)
def test_a_nonlinear_law_without_coefficients_is_the_linear_one(name, law):
    eps, linear = ca.DM(random_strain()), Linear(**ELASTIC)
    assert gap(law(**ELASTIC).force(eps, SHAPES[name]), linear.force(eps, SHAPES[name])) < 1e-13
    assert gap(law(**ELASTIC).stiffness(eps, SHAPES[name]), linear.stiffness(eps, SHAPES[name])) < 1e-13


@pytest.mark.parametrize("k", [0.0, 0.5, 5.0, 30.0])
def test_moment_of_a_polynomial_law_in_pure_bending(k):
    """M = dW/dk of W = E J k^2/2 (1 + b1 w + b2 w^2), w = k^2 J/A: M = E J k (1 + 2 b1 w + 3 b2 w^2)."""
    b1, b2 = 3.0, -20.0
    m = SHAPES["ellipse"].moments()
    material = Polynomial(bend=(b1, b2), **ELASTIC)
    for i, J in ((1, m.Jy), (2, m.Jz)):
        w = k**2 * J / m.A
        moment = 3e5 * J * k * (1 + 2 * b1 * w + 3 * b2 * w**2)
        force = array(material.force(bends(*(k * np.eye(2)[i - 1])), SHAPES["ellipse"]))
        assert force[i] == pytest.approx(moment, rel=1e-12, abs=1e-15)
        assert np.abs(np.delete(force, i)).max() < 1e-15


@pytest.mark.parametrize("limit", [0.02, -0.02])
@pytest.mark.parametrize("share", [0.0, 1e-6, 0.049, 0.051, 0.5, 0.95])
def test_moment_of_a_gent_law_in_pure_bending(share, limit):
    """M = E J k/(1 - w/m), on both sides of the switch to the series of the logarithm."""
    m = DISC.moments()
    k = np.sqrt(share * 0.02 * m.A / m.Jy)
    law = Gent(bend_limit=limit, **ELASTIC)
    x = share * np.sign(limit)
    assert array(law.force(bends(k, 0), DISC))[1] == pytest.approx(3e5 * m.Jy * k / (1 - x), rel=1e-12)
    tangent = 3e5 * m.Jy * ((1 - x) + 2 * x) / (1 - x) ** 2
    assert array(law.stiffness(bends(k, 0), DISC))[1, 1] == pytest.approx(tangent, rel=1e-10)


@pytest.mark.parametrize("stretch", [-0.3, -0.01, 0.0, 0.2])
def test_pull_of_the_nonlinear_laws_in_pure_stretch(stretch):
    EA, e = 3e5 * pi * 1e-4, ca.DM([0, 0, 0, stretch, 0, 0])
    polynomial = Polynomial(stretch=(0.4, 2.0), **ELASTIC)
    pull = (
        EA * stretch * (1 + 1.5 * 0.4 * stretch + 2 * 2.0 * stretch**2)
    )  # d/de of e^2/2 (1 + a1 e + a2 e^2)
    assert array(polynomial.force(e, DISC))[3] == pytest.approx(pull, rel=1e-12)
    gent = Gent(stretch_limit=0.5, **ELASTIC)
    assert array(gent.force(e, DISC))[3] == pytest.approx(EA * stretch / (1 - stretch**2 / 0.5), rel=1e-12)


def law_energy(law, section):
    """dW/deps_i by differences of the law's own energy: (eps, i, h) -> number."""
    eps = ca.SX.sym("eps", 6)
    W = ca.Function("W", [eps], [law.energy(eps, section)])

    def slope(e, i, h):
        step = h * np.eye(6)[i]
        return float((8 * (W(e + step) - W(e - step)) - (W(e + 2 * step) - W(e - 2 * step))) / (12 * h))

    return slope


LAWS = {
    "linear": Linear(**ELASTIC),
    "polynomial": Polynomial(bend=(2.0, 5.0), stretch=(0.3, -1.0), coupling=-0.8, **ELASTIC),
    "gent": Gent(bend_limit=0.1, stretch_limit=-0.3, **ELASTIC),
    "energy": Energy(W=stiffening, density=1.0),
}


@pytest.mark.parametrize("size", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("name", LAWS)
def test_force_and_stiffness_of_every_law_are_differences_of_its_energy(name, size):
    law, e = LAWS[name], random_strain(size)
    slope, scale = law_energy(law, DISC), np.array([1.0, 1, 1, 0.01, 0.01, 0.01])
    force, K = array(law.force(ca.DM(e), DISC)), array(law.stiffness(ca.DM(e), DISC))
    expected = np.array([slope(e, i, 1e-2 * scale[i]) for i in range(6)])
    np.testing.assert_allclose(force * scale, expected * scale, rtol=1e-6, atol=1e-8)
    step = 1e-4 * scale
    columns = [
        (array(law.force(ca.DM(e + step * d), DISC)) - array(law.force(ca.DM(e - step * d), DISC)))
        / (2 * step[i])
        for i, d in enumerate(np.eye(6))
    ]
    assert (
        np.abs((K - np.array(columns)) * np.outer(scale, scale)).max()
        < 1e-6 * np.abs(K * np.outer(scale, scale)).max()
    )
    assert gap(K, K.T) < 1e-15


@pytest.mark.parametrize("number", [ca.SX, ca.MX])
@pytest.mark.parametrize("name", LAWS)
def test_laws_are_the_same_as_DM_SX_and_MX_and_smooth_at_rest(name, number):
    eps = number.sym("eps", 6)
    law = LAWS[name]
    force = law.force(eps, DISC)
    both = ca.Function("both", [eps], [force, law.stiffness(eps, DISC), ca.jacobian(force, eps)])
    for e in (np.zeros(6), random_strain()):
        got, K, slope = both(e)
        assert gap(got, law.force(ca.DM(e), DISC)) < 1e-14
        assert gap(K, law.stiffness(ca.DM(e), DISC)) < 1e-14
        assert gap(slope, K) < 1e-12


def test_positive_coefficients_stiffen_and_negative_ones_soften():
    bend, linear = bends(20.0, 10.0), array(Linear(**ELASTIC).force(bends(20.0, 10.0), DISC))
    for law, sign in (
        (Polynomial(bend=(1.0,), **ELASTIC), 1),
        (Polynomial(bend=(-1.0,), **ELASTIC), -1),
        (Gent(bend_limit=0.1, **ELASTIC), 1),
        (Gent(bend_limit=-0.1, **ELASTIC), -1),
    ):
        moment = array(law.force(bend, DISC))
        assert np.sign((moment - linear)[1:3] @ linear[1:3]) == sign
    stretched = bend + ca.DM([0, 0, 0, 0.2, 0, 0])
    softer = array(Polynomial(coupling=-0.5, **ELASTIC).force(stretched, DISC))
    np.testing.assert_allclose(softer[1:3], 0.9 * linear[1:3], rtol=1e-12)


def test_moduli_are_linked_by_poisson_ratio():
    by_ratio = Linear(young_modulus=3e5, poisson_ratio=0.5, density=1.0)
    by_modulus = Linear(young_modulus=3e5, shear_modulus=1e5, density=1.0)
    assert gap(linear_stiffness(by_ratio, DISC), linear_stiffness(by_modulus, DISC)) < 1e-15


# Strains, joints, bodies


def test_the_rows_of_strains_are_those_of_the_table():
    assert len(STRAIN_SETS) == 7
    for name, columns in {"kirchhoff_love": [0, 1, 2, 3], "planar_constant_curvature": [2, 3]}.items():
        np.testing.assert_array_equal(array(selection(active_strains(name))), np.eye(6)[:, columns])
    assert active_strains(("shear_z", "twist")) == ("twist", "shear_z")
    assert active_strains("simo_reissner") == STRAINS


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.3, -0.5, 0.8), (1e-5, 0, -1), (1e-20, 0, -1), (0, 2, -3)]
)
def test_translations_of_a_planar_joint_lie_across_its_normal_right_handed(axis):
    n = np.array(axis) / np.linalg.norm(axis)
    across = array(normal_basis(axis))
    frame = np.column_stack([across, n])
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_a_planar_joint_moves_along_its_own_axes():
    np.testing.assert_allclose(array(Planar().Phi())[:, 1:], np.eye(6)[:, 3:5], atol=0)


def test_bodies_are_heavy_about_their_frame_as_points_are():
    """[J - m c~ c~, m c~; -m c~, m I]: twice the kinetic energy of the body's points."""
    rng = np.random.default_rng(5)
    points, masses = rng.normal(size=(8, 3)), rng.uniform(0.1, 1, 8)
    com = masses @ points / masses.sum()
    J = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points - com, strict=True))
    expected = np.zeros((6, 6))
    for m, r in zip(masses, points, strict=True):
        velocity = np.hstack([-hat(np.array([*r, 0, 0, 0]))[:3, :3], np.eye(3)])
        expected += m * velocity.T @ velocity
    six = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    for inertia in (tuple(map(tuple, J)), six):
        body = Body(mass=masses.sum(), com=tuple(com), inertia=inertia)
        assert gap(body.spatial_inertia(), expected) < 1e-14
    assert gap(Body(mass=1.0, inertia=(1.0, 2.0, 3.0)).inertia_matrix(), np.diag([1.0, 2, 3])) == 0


def test_stiffness_is_a_number_a_list_or_a_matrix():
    joint = JOINTS["spherical"]
    np.testing.assert_array_equal(array(joint(stiffness=2.0).matrix("stiffness")), 2 * np.eye(3))
    np.testing.assert_array_equal(array(joint(damping=(1.0, 2.0, 3.0)).matrix("damping")), np.diag([1, 2, 3]))
    np.testing.assert_array_equal(array(joint(stiffness=spring(3)).matrix("stiffness")), spring(3))


def test_limits_stand_beside_their_coordinates_and_inputs():
    segments = {
        "hinge": Revolute(limits=(-1.0, 2.0)),
        "slide": Cylindrical(parent="hinge", limits=((-1.0, 1.0), (0.0, 0.1))),
        "rod": rod(parent="slide", sections=1, strains=("stretch",)),
    }
    actuators = {
        "pull": Tendon(along=("rod",), offset=(0.005, 0.0), limits=(0.0, 10.0)),
        "drive": JointTorque(joint="slide", limits=((-2.0, 2.0), (-3.0, 3.0))),
        "blow": Chamber(along=("rod",), offset=(0.0, 0.0), area=1e-5),
    }
    of = Robot(Description(segments=segments, actuators=actuators))
    everything = (-float("inf"), float("inf"))
    assert of.joint_limits == ((-1.0, 2.0), (-1.0, 1.0), (0.0, 0.1), everything)
    assert of.inputs == ("pull", "drive.0", "drive.1", "blow")
    assert of.input_units == ("N", "N m", "N", "Pa")
    assert of.input_limits == ((0.0, 10.0), (-2.0, 2.0), (-3.0, 3.0), everything)


def test_boundaries_follow_the_fractions():
    assert rod(sections=(0.2, 0.5, 0.3)).boundaries() == pytest.approx([0, 0.2, 0.7, 1])
    assert rod(sections=4).boundaries() == [0, 0.25, 0.5, 0.75, 1.0]


def test_bodies_and_springs_of_the_oracle_are_those_of_the_records():
    plain = Plain(Description(segments={"link": Fixed(body=BODY)}))
    (frame, force, moment, follower), *others = plain.pushes(np.zeros(0))
    assert not others and not follower and not moment.any()
    np.testing.assert_allclose(force, [0, 0, -0.05 * 9.81])
    np.testing.assert_allclose(frame[:3, 3], BODY.com)


# Refusals: which key, and what is wrong with it

HOLE = Hole(offset=(0.009, 0.0), radius=0.002)
ONE_ROD = {"rod": rod()}
REFUSED = {
    "hole outside": (lambda: Circle(radius=0.01, holes=(HOLE,)), "holes.0", "leaves the circle"),
    "hole in the lumen": (
        lambda: Annulus(inner_radius=0.006, radius=0.012, holes=(replace(HOLE, offset=(0.007, 0.0)),)),
        "holes.0",
        "leaves the wall",
    ),
    "holes overlap": (
        lambda: Circle(radius=0.02, holes=(HOLE, replace(HOLE, radius=0.001))),
        "holes.1",
        "overlaps",
    ),
    "lumen too wide": (lambda: Annulus(inner_radius=0.02, radius=0.01), "inner_radius", "not below radius"),
    "negative number": (
        lambda: General(stiffness=(1, 1, 1, 0, 1, 1), inertia=(1,) * 6),
        "stiffness.3",
        "not positive",
    ),
    "taper of two kinds": (
        lambda: Taper(start=DISC, end=SHAPES["ellipse"]),
        "end",
        "ellipse cannot follow a circle",
    ),
    "taper loses a hole": (
        lambda: Taper(start=SHAPES["circle_one_hole"], end=DISC),
        "end",
        "same number of holes",
    ),
    "taper loses Jt": (
        lambda: Taper(start=replace(DISC, torsion_constant=1e-9), end=DISC),
        "end",
        "at one end only",
    ),
    "table not from 0": (
        lambda: SectionTable(table=(TableRow(at=0.1, section=DISC),) * 2),
        "table",
        "first row",
    ),
    "table falls": (
        lambda: SectionTable(table=tuple(TableRow(at=X, section=DISC) for X in (0.0, 0.6, 0.5, 1.0))),
        "table",
        "rising order",
    ),
    "two shear laws": (
        lambda: Linear(young_modulus=1.0, poisson_ratio=0.3, shear_modulus=1.0, density=1.0),
        "poisson_ratio",
        "exactly one",
    ),
    "no shear law": (lambda: Gent(young_modulus=1.0, density=1.0), "poisson_ratio", "exactly one"),
    "gent limit 0": (lambda: Gent(bend_limit=0.0, **ELASTIC), "bend_limit", "0 is no limit"),
    "unknown strain": (
        lambda: rod(strains=("bend_x",)),
        "strains",
        "did you mean 'bend_y'|did you mean 'bend_z'",
    ),
    "no strain": (lambda: rod(strains=()), "strains", "no strain is free"),
    "fractions": (lambda: rod(sections=(0.5, 0.6)), "sections", "sum to 1.1"),
    "rest by section": (
        lambda: rod(rest={"bend_z": (1.0, 2.0, 3.0)}),
        "rest.bend_z",
        "3 values given, 2 wanted",
    ),
    "rest of nothing": (lambda: rod(rest={"bend": 1.0}), "rest.bend", "unknown strain"),
    "stiffness of three": (
        lambda: Cylindrical(stiffness=(1.0, 2.0, 3.0)),
        "stiffness",
        "3 entries given, 2 wanted",
    ),
    "limits of one": (lambda: Cylindrical(limits=((0.0, 1.0),)), "limits", "1 pairs given, 2 wanted"),
    "inertia without mass": (lambda: Body(mass=0.0, inertia=(1.0, 1.0, 1.0)), "mass", "needs a mass"),
    "nothing": (lambda: Description(segments={}), "segments", "at least one"),
    "late parent": (
        lambda: Description(segments={"a": rod(parent="b"), "b": rod()}),
        "segments.a.parent",
        "stands after 'a'",
    ),
    "own parent": (
        lambda: Description(segments={"a": rod(parent="a")}),
        "segments.a.parent",
        "its own parent",
    ),
    "unknown parent": (
        lambda: Description(segments={"a": rod(parent="wrld")}),
        "segments.a.parent",
        "did you mean 'world'",
    ),
    "half a joint": (
        lambda: Description(segments={"a": Revolute(), "b": rod(parent="a", at=0.5)}),
        "segments.b.at",
        "only 0",
    ),
    "load on nothing": (
        lambda: Description(segments=ONE_ROD, loads={"w": Wrench(on="rd")}),
        "loads.w.on",
        "did you mean 'rod'",
    ),
    "spread on a joint": (
        lambda: Description(segments={"a": Revolute()}, loads={"w": Distributed(on="a")}),
        "loads.w.on",
        "needs a rod",
    ),
    "cable along nothing": (
        lambda: Description(
            segments=ONE_ROD, actuators={"t": Tendon(along=("rod", "arm"), offset=(0.0, 0.0))}
        ),
        "actuators.t.along.1",
        "unknown segment 'arm'",
    ),
    "cable along no segment": (lambda: Tendon(along=(), offset=(0.0, 0.0)), "along", "no segment"),
    "cable twice": (lambda: Tendon(along=("a", "a"), offset=(0.0, 0.0)), "along", "twice"),
    "cable backwards": (
        lambda: Tendon(along=("a",), offset=(0.0, 0.0), from_=0.5, to=0.5),
        "from",
        "not below",
    ),
    "cable of no length": (
        lambda: Description(
            segments={"a": Revolute(), "rod": rod(parent="a")},
            actuators={"t": Tendon(along=("a", "rod"), offset=(0.0, 0.0))},
        ),
        "actuators.t.along",
        "no length through the joint 'a'",
    ),
    "chamber in a joint": (
        lambda: Description(
            segments={"a": Revolute(tip=Placement(position=(0.1, 0, 0)))},
            actuators={"p": Chamber(along=("a",), offset=Converging(start=(0, 0), end=(0, 0.1)), area=1.0)},
        ),
        "actuators.p.along",
        "a chamber runs along rods only",
    ),
    "torque on a rod": (
        lambda: Description(segments=ONE_ROD, actuators={"m": JointTorque(joint="rod")}),
        "actuators.m.joint",
        "no joint coordinate",
    ),
    "limits of a ball": (
        lambda: Description(
            segments={"a": JOINTS["spherical"]()},
            actuators={"m": JointTorque(joint="a", limits=((0.0, 1.0), (0.0, 1.0)))},
        ),
        "actuators.m.limits",
        "2 pairs given, 3 wanted",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_fit_is_refused_at_its_key(name):
    make, key, sentence = REFUSED[name]
    with pytest.raises(ValueError, match=sentence) as caught:
        make()
    assert caught.value.key == key
    assert "\n" not in str(caught.value)
