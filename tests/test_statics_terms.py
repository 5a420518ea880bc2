"""Forces of the static balance: loads, actuators, internal wrenches, and closed forms of simple rods."""

from dataclasses import fields, is_dataclass, replace
from functools import cache
from math import pi

import casadi as ca
import numpy as np
import pytest
from robots import (
    BODY,
    CASES,
    ROBOTS,
    ROD_CASES,
    RUBBER,
    Plain,
    array,
    bounds,
    functions,
    gap,
    gauss,
    robot,
    rod,
    slopes,
)

from socontrol.mechanics import internal
from socontrol.mechanics.actuators import Chamber, JointTorque, Tendon
from socontrol.mechanics.loads import Distributed, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.statics import Statics
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Annulus, Circle, Rectangle, Taper

WITHOUT_POTENTIAL = {"loaded"}  # dead moments and followers
FORCED = [case for case in CASES if case.name not in WITHOUT_POTENTIAL]
ACTUATED = [case for case in CASES if case.description.actuators]


# Loads


@pytest.mark.parametrize("case", CASES, ids=str)
def test_external_force_is_the_virtual_work_of_all_loads(case):
    force = case.functions.external_force(case.q, case.qd)
    assert gap(force, case.plain.external_force(case.q)) < 1e-11


@pytest.mark.parametrize("case", FORCED, ids=str)
def test_dead_forces_are_minus_the_slope_of_their_potential(case):
    expected = -slopes(case.plain.potential, case.q)
    assert gap(case.functions.external_force(case.q, case.qd), expected) < 1e-11


@pytest.mark.parametrize("case", CASES, ids=str)
def test_follower_loads_are_the_jacobian_transposed_times_the_wrench(case):
    name = [*case.description.segments][-1]
    wrench = dict(force=(0.2, -0.3, 0.5), moment=(0.02, 0.03, -0.01))
    pushed = case.robot.with_loads({"more": Wrench(on=name, axes="body", **wrench)})
    more = (
        Statics(pushed, ca.DM(case.q)).external_force() - Statics(case.robot, ca.DM(case.q)).external_force()
    )
    F = np.array([*wrench["moment"], *wrench["force"]])
    assert gap(more, case.plain.jacobian(case.q, name, 1.0).T @ F) < 1e-10


@pytest.mark.parametrize("case", CASES, ids=str)
def test_energy_is_that_of_fibres_and_of_weights(case):
    plain = Plain(replace(case.description, loads=None))
    kinetic, elastic, weight = array(case.functions.energy(case.q, 0 * case.q))
    assert kinetic == 0
    assert elastic == pytest.approx(plain.elastic_energy(case.q), rel=1e-11, abs=1e-14)
    assert weight == pytest.approx(plain.potential(case.q), rel=1e-11, abs=1e-14)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_elastic_force_is_the_slope_of_the_energy_of_the_fibres(case):
    expected = slopes(case.plain.elastic_energy, case.q)
    force = array(case.functions.elastic_force(case.q))
    assert np.abs(force - expected).max() < 1e-12 * max(1.0, np.abs(expected).max())


def test_springs_at_rest_and_rods_at_rest_hold_no_force():
    for name in ("revolute", "planar", "pre_curved"):
        rests = {
            "revolute": [0.3],
            "planar": [0.1, 0.02, 0.0],
            "pre_curved": [1.5, 0, 3, 0.02, 1.5, 0, -1, 0.02],
        }
        assert np.abs(array(robot(name).functions().elastic_force(np.array(rests[name])))).max() < 1e-15


# Actuators


@pytest.mark.parametrize("case", ACTUATED, ids=str)
def test_actuation_is_the_gain_times_the_slope_of_the_length(case):
    B = np.array(case.functions.actuation(case.q))
    expected = case.plain.actuation(case.q)
    assert B.shape == (case.robot.n, case.robot.m)
    for column, other in zip(B.T, expected.T, strict=True):
        assert gap(column, other) < 1e-11


@pytest.mark.parametrize("case", ACTUATED, ids=str)
def test_lengths_are_those_of_polygons_or_grow_by_the_push_and_joints_give_their_coordinate(case):
    expected = []
    for a in case.description.actuators.values():
        if isinstance(a, JointTorque):
            expected += [*case.q[case.plain.columns[a.joint][0]]]
        elif isinstance(a, Tendon) or a.direction == "tangent":
            only = replace(case.description, actuators={"only": a})
            expected.append(np.abs(Plain(only).lengths(case.q)[0]) / getattr(a, "area", 1.0))
        else:
            only = Plain(replace(case.description, actuators={"only": a}))
            as_line = Plain(replace(case.description, actuators={"only": replace(a, direction="tangent")}))
            pushed = only.lengths(case.q)[0] - only.lengths(0 * case.q)[0]
            expected.append((as_line.lengths(0 * case.q)[0] + pushed) / a.area)
    assert gap(case.functions.actuator_lengths(case.q), np.array(expected)) < 1e-12


def test_a_torque_on_a_ball_is_a_moment_in_the_moving_frame():
    f = robot("spherical").functions()
    q, u = np.array([0.5, -1.1, 0.7]), np.array([0.3, 0.1, -0.2])
    plain = Plain(ROBOTS["spherical"])
    turning = plain.jacobian(q, "joint", 1.0)[
        :3
    ]  # of the end frame; the moving frame is a fixed rotation away
    R = np.linalg.inv(plain.stations(q)["joint"][1])[:3, :3] @ plain.stations(q)["joint"][2][:3, :3]
    assert gap(array(f.actuation(q)) @ u, turning.T @ R.T @ u) < 1e-13


# Residual and tangent


@pytest.mark.parametrize("case", CASES, ids=str)
def test_residual_tangent_and_actuation_are_the_same_as_DM_SX_and_MX(case):
    dm = Statics(case.robot, ca.DM(case.q), ca.DM(case.u))
    as_dm = dm.residual(), dm.tangent(), dm.actuation()
    as_mx = statics_as_mx(case.name)(case.q, case.u)
    for number, sx, mx in zip(as_dm, case.functions.statics(case.q, case.u), as_mx, strict=True):
        assert gap(sx, number) < 1e-12
        assert gap(mx, number) < 1e-12


@cache
def statics_as_mx(name):
    q, u = ca.MX.sym("q", robot(name).n), ca.MX.sym("u", robot(name).m)
    s = Statics(robot(name), q, u)
    return ca.Function("statics", [q, u], [s.residual(), s.tangent(), s.actuation()])


@cache
def tangent_by_casadi(name):
    q, u = ca.SX.sym("q", robot(name).n), ca.SX.sym("u", robot(name).m)
    return ca.Function("slope", [q, u], [ca.jacobian(functions(name).static_residual(q, u), q)])


@pytest.mark.parametrize("case", CASES, ids=str)
def test_tangent_is_the_derivative_of_the_residual(case):
    tangent = case.functions.static_tangent(case.q, case.u)
    assert gap(tangent, tangent_by_casadi(case.name)(case.q, case.u)) < 1e-11


@pytest.mark.parametrize("case", CASES, ids=str)
def test_stiffness_is_the_derivative_of_the_elastic_force_and_symmetric(case):
    q = ca.SX.sym("q", case.robot.n)
    derivative = ca.Function("slope", [q], [ca.jacobian(case.functions.elastic_force(q), q)])
    K = array(case.functions.stiffness(case.q)).reshape(case.robot.n, -1)
    assert gap(K, np.array(derivative(case.q))) < 1e-12
    assert gap(K, K.T) < 1e-14


@pytest.mark.parametrize("case", FORCED, ids=str)
def test_tangent_is_symmetric_where_all_forces_have_a_potential(case):
    assert all(load.conservative for load in case.robot.loads)
    u = case.u
    for k, name in enumerate(case.robot.inputs):  # a moment that turns with a ball has no potential
        u[k] *= "." not in name
    K = array(case.functions.static_tangent(case.q, u)).reshape(case.robot.n, -1)
    assert gap(K, K.T) < 1e-13


def test_tangent_of_followers_and_dead_moments_is_not_symmetric():
    case = next(c for c in CASES if str(c) == "loaded-bent")
    K = array(case.functions.static_tangent(case.q, case.u))
    assert gap(K, K.T) > 1e-4
    assert not all(load.conservative for load in case.robot.loads)


@pytest.mark.parametrize("name", ROBOTS["loaded"].loads)
def test_tangent_of_each_load_alone_is_the_derivative_of_its_force(name):
    """Also of dead moments, whose tangent is not symmetric without any follower beside them."""
    case = next(c for c in CASES if str(c) == "loaded-bent")
    only = Robot(
        replace(case.description, loads={name: case.description.loads[name]}, gravity=(0.0, 0.0, 0.0))
    )
    q = ca.SX.sym("q", only.n)
    s = Statics(only, q, ca.SX(0, 1))
    both = ca.Function("both", [q], [s.tangent() - s.stiffness(), -ca.jacobian(s.external_force(), q)])
    tangent, expected = map(np.array, both(case.q))
    assert gap(tangent, expected) < 1e-11
    assert (gap(expected, expected.T) < 1e-11) == (name == "even")


@pytest.mark.parametrize("case", ACTUATED, ids=str)
def test_actuation_gradient_is_the_derivative_of_the_virtual_work_of_each_input(case):
    q, lam = ca.SX.sym("q", case.robot.n), ca.SX.sym("lam", case.robot.n)
    s = Statics(case.robot, q, ca.SX.sym("u", case.robot.m))
    work = s.actuation().T @ lam
    both = ca.Function("both", [q, lam], [s.actuation_gradient(lam), ca.jacobian(work, q).T])
    ours, expected = both(case.q, case.qd)
    assert np.abs(np.array(ours - expected)).max() < 1e-11 * max(0.01, np.abs(np.array(expected)).max())


# Wrenches inside


def breaks(description, name):
    """X on a rod where loads, children, lines or sections begin or end."""
    s = description.segments[name]
    X = {*bounds(s)}
    X |= {child.at for child in description.segments.values() if child.parent == name}
    X |= {
        load.at for load in (description.loads or {}).values() if isinstance(load, Wrench) and load.on == name
    }
    for a in (description.actuators or {}).values():
        if isinstance(a, Tendon) and name in a.along:
            sizes = [
                t.length if isinstance(t, Rod) else np.linalg.norm(t.tip.position)
                for t in map(description.segments.get, a.along)
            ]
            first = sum(sizes[: a.along.index(name)]) / sum(sizes)
            share = s.length / sum(sizes)
            X |= {(end - first) / share for end in (a.from_, a.to) if first < end < first + share}
    return sorted(X)


@pytest.mark.parametrize("case", [case for case in ROD_CASES if case.shape == "bent"], ids=str)
def test_residual_of_a_rod_is_its_law_less_the_wrench_that_balance_asks_for(case):
    """Weighted residual of one section: r = int Phi^T (F_law(xi) - F_balance(X)) ds, at any q."""
    s = Statics(case.robot, ca.DM(case.q), ca.DM(case.u))
    missing = case.plain.external_force(case.q) + case.plain.actuation(case.q) @ case.u
    for name, record in case.description.segments.items():
        if not isinstance(record, Rod):
            continue
        edges = breaks(case.description, name)
        for i, (low, high) in enumerate(zip(bounds(record), bounds(record)[1:], strict=False)):
            total = np.zeros(6)
            for a, b in zip(edges, edges[1:], strict=False):
                if low <= a and b <= high:
                    for X, w in zip(*gauss(a, b, 8), strict=True):
                        total += w * record.length * array(internal.wrench(s, name, X))
            piece = case.robot.tree.pieces[case.robot.tree.of[name][i]]
            rows = array(piece.Phi.T @ total).reshape(-1)
            assert np.abs(rows - missing[piece.columns]).max() < 1e-9 * np.abs(missing).max(), (name, i)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_reactions_of_the_roots_and_all_loads_sum_to_nothing(case):
    total = case.plain.total_push(case.q)
    size = np.abs(total).max()
    for name, segment in case.description.segments.items():
        if segment.parent == "world":
            m, f = np.split(array(case.functions.reaction(name)(case.q)), 2)
            base = case.plain.stations(case.q)[name][0]
            R, r = base[:3, :3], base[:3, 3]
            total += np.concatenate([R @ m + np.cross(r, R @ f), R @ f])
    assert np.abs(total).max() < 1e-9 * size


STRAIGHT = {"strains": "simo_reissner", "placement": Placement(), "length": 0.4, "sections": 2}


def cantilever(loads, gravity=(0.0, 0.0, 0.0), tip_mass=None, actuators=None, **changes):
    segments = {"rod": rod(**{**STRAIGHT, **changes})}
    if tip_mass:
        segments["cap"] = Fixed(parent="rod", body=Body(mass=tip_mass, com=(0.05, 0.0, 0.0)))
    return Robot(Description(segments=segments, loads=loads, gravity=gravity, actuators=actuators))


def inside(of, X, q=None, u=()):
    q = np.zeros(of.n) if q is None else q
    return array(of.functions().internal_wrench("rod", X)(q, np.array(u)))


@pytest.mark.parametrize("X", [0.0, 0.2, 0.5, 0.75, 1.0])
def test_a_tip_force_bends_a_cantilever_by_force_times_the_way_to_the_tip(X):
    wrench = inside(cantilever({"tip": Wrench(on="rod", force=(0.0, 2.0, 3.0))}), X)
    left = 0.4 * (1 - X)
    np.testing.assert_allclose(wrench, [0, -3.0 * left, 2.0 * left, 0, 2.0, 3.0], atol=1e-14)


@pytest.mark.parametrize("X", [0.0, 0.3, 1.0])
def test_a_pull_at_the_tip_is_tension_everywhere_and_a_cable_is_compression(X):
    pulled = cantilever({"tip": Wrench(on="rod", force=(2.0, 0.0, 0.0))})
    np.testing.assert_allclose(inside(pulled, X), [0, 0, 0, 2.0, 0, 0], atol=1e-15)
    tied = cantilever(None, actuators={"cable": Tendon(along=("rod",), offset=(0.006, 0.0))})
    np.testing.assert_allclose(inside(tied, X, u=[2.0]), [0, 0, 0.012, -2.0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("X", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_a_level_rod_carries_the_weight_of_what_lies_beyond(X):
    level = cantilever(None, gravity=(0.0, 0.0, -10.0), tip_mass=0.02)
    line, left = 1080.0 * pi * 0.01**2 * 10.0, 0.4 * (1 - X)
    moment = line * left**2 / 2 + 0.2 * (left + 0.05)
    np.testing.assert_allclose(
        inside(level, X), [0, moment, 0, 0, 0, -line * left - 0.2], rtol=1e-11, atol=1e-13
    )


@pytest.mark.parametrize("X", [0.0, 0.2, 0.65, 1.0])
def test_a_tapered_level_rod_carries_the_weight_of_what_lies_beyond(X):
    cone = Taper(start=Circle(radius=0.012), end=Circle(radius=0.004))
    level = cantilever(None, gravity=(0.0, 0.0, -10.0), cross_section=cone)
    x, w = gauss(X, 1.0)
    line = 1080.0 * 10.0 * pi * (0.012 - 0.008 * x) ** 2 * 0.4
    expected = [0, (line * (x - X) * 0.4) @ w, 0, 0, 0, -line @ w]
    np.testing.assert_allclose(inside(level, X), expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("axes", ["world", "body"])
@pytest.mark.parametrize("X", [0.0, 0.07, 0.5, 0.81, 1.0])
def test_spread_forces_and_moments_add_up_beyond_the_place(X, axes):
    flow = Distributed(on="rod", force=(0.5, 1.0, -2.0), moment=(0.3, 0.1, 0.2), axes=axes)
    left = 0.4 * (1 - X)
    expected = [0.3 * left, 0.1 * left + left**2, 0.2 * left + left**2 / 2, 0.5 * left, left, -2 * left]
    np.testing.assert_allclose(inside(cantilever({"flow": flow}), X), expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("X", [0.0, 0.24, 0.5, 0.9])
def test_a_bent_rod_carries_a_tip_force_with_its_lever_arm(X):
    """A quarter circle of radius 2 L/pi in the plane z = 0."""
    k = pi / 2 / 0.4
    q = np.tile([0, 0, k, 0, 0, 0], 2)
    wrench = inside(cantilever({"tip": Wrench(on="rod", force=(0.0, 0.0, 1.5))}), X, q)
    a = pi / 2 * X
    tip, here = np.array([1.0, 1.0]) / k, np.array([np.sin(a), 1 - np.cos(a)]) / k
    arm = tip - here
    world = np.array([arm[1] * 1.5, -arm[0] * 1.5])
    expected = [world @ [np.cos(a), np.sin(a)], world @ [-np.sin(a), np.cos(a)], 0, 0, 0, 1.5]
    np.testing.assert_allclose(wrench, expected, atol=1e-13)


def test_a_point_load_acts_below_its_place_only():
    nailed = cantilever({"nail": Wrench(on="rod", at=0.6, force=(0.0, 1.0, 0.0))})
    assert inside(nailed, 0.59)[4] == pytest.approx(1.0)
    assert inside(nailed, 0.61)[4] == 0


# Closed forms


SOFT = Linear(young_modulus=110e3, poisson_ratio=0.0, density=1080.0)
E_A, E_J = 110e3 * pi * 0.01**2, 110e3 * pi * 0.01**4 / 4


def octopus_arm(actuators=None, loads=None, strains="kirchhoff_love", sections=1):
    """The arm of F. Renda et al., T-RO 2018: E 110 kPa, radius 10 mm, length 0.25 m; no gravity."""
    arm = Rod(
        length=0.25, cross_section=Circle(radius=0.01), material=SOFT, strains=strains, sections=sections
    )
    return Robot(Description(segments={"arm": arm}, actuators=actuators, loads=loads, gravity=(0, 0, 0)))


def test_a_straight_tendon_bends_towards_itself_by_T_y_over_E_J():
    arm = octopus_arm({"cable": Tendon(along=("arm",), offset=(0.008, 0.0))})
    f, T = arm.functions(), 1.0
    kappa, stretch = T * 0.008 / E_J, -T / E_A
    q = np.array([0, 0, kappa, stretch])
    assert (kappa, 1 + stretch) == (pytest.approx(9.25992396, abs=5e-9), pytest.approx(0.97106274, abs=5e-9))
    assert np.abs(array(f.static_residual(q, [T]))).max() < 1e-15
    np.testing.assert_allclose(array(f.pose("arm")(q))[:2, 3], [0.07714459, 0.17590141], atol=5e-9)
    np.testing.assert_allclose(
        array(f.internal_wrench("arm", 0.3)(q, [T])), [0, 0, 0.008, -1, 0, 0], atol=1e-15
    )


def test_an_inextensible_arm_under_the_same_tendon_ends_where_a_circle_does():
    arm = octopus_arm(
        {"cable": Tendon(along=("arm",), offset=(0.008, 0.0))}, strains="inextensible_kirchhoff_love"
    )
    q = np.array([0, 0, 0.008 / E_J])
    assert np.abs(array(arm.functions().static_residual(q, [1.0]))).max() < 1e-15
    np.testing.assert_allclose(
        array(arm.functions().pose("arm")(q))[:2, 3], [0.07944346, 0.18114320], atol=5e-9
    )


@pytest.mark.parametrize("direction", ["tangent", "normal"])
def test_a_chamber_bends_away_from_itself_and_lengthens(direction):
    arm = octopus_arm({"p": Chamber(along=("arm",), offset=(0.008, 0.0), area=1e-5, direction=direction)})
    kappa, stretch = -0.2 * 0.008 / E_J, 0.2 / E_A
    assert (kappa, 1 + stretch) == (pytest.approx(-1.85198479, abs=5e-9), pytest.approx(1.00578745, abs=5e-9))
    assert np.abs(array(arm.functions().static_residual([0, 0, kappa, stretch], [20e3]))).max() < 1e-15


def test_an_end_moment_of_two_pi_E_J_over_L_closes_a_circle():
    moment = Wrench(on="arm", moment=(0.0, 0.0, 2 * pi * E_J / 0.25), axes="body")
    f = octopus_arm(loads={"end": moment}, strains="inextensible_kirchhoff_love", sections=2).functions()
    q = np.tile([0, 0, 2 * pi / 0.25], 2)
    assert np.abs(array(f.static_residual(q, []))).max() < 1e-14
    assert gap(f.pose("arm")(q), np.eye(4)) < 1e-13


def solved(of, q, u=(), steps=60):
    """Newton's method with the step halved until the residual falls."""
    f = of.functions()
    for _ in range(steps):
        r, K, _ = map(np.array, f.statics(q, np.array(u)))
        step = np.linalg.solve(K, r)[:, 0]
        if np.abs(step).max() < 1e-12 * max(1.0, np.abs(q).max()):
            return q - step
        while np.linalg.norm(array(f.static_residual(q - step, np.array(u)))) > np.linalg.norm(r):
            step = step / 2
        q = q - step
    raise AssertionError("no equilibrium found")


def test_constant_strain_sections_meet_the_elastica_at_second_order():
    """Each minimises E J/2 int k^2 - F y over plane arcs; elliptic integrals give the limit 0.05703533 m."""
    load, found = {"tip": Wrench(on="arm", force=(0.0, 0.01, 0.0))}, []
    for count in (1, 2, 4, 8, 16):
        arm = octopus_arm(loads=load, strains=("bend_z",), sections=count)
        q = solved(arm, np.zeros(count))
        np.testing.assert_allclose(E_J * 0.25 / count * q, 0.01 * slopes(height_of_arcs, q), rtol=1e-9)
        found.append(array(arm.functions().pose("arm")(q))[1, 3])
        assert found[-1] == pytest.approx(height_of_arcs(q), abs=1e-13)
    np.testing.assert_allclose(found[:2], [0.04338658, 0.05368724], atol=5e-9)
    order = -np.polyfit(np.log([4, 8, 16]), np.log(0.05703533 - np.array(found[2:])), 1)[0]
    assert order == pytest.approx(2.0, abs=0.02)


def height_of_arcs(q):
    """y [...] of the end of a planar chain of arcs of curvatures q [... N], 0.25 m long."""
    h = 0.25 / q.shape[-1]
    angle = np.cumsum(q * h, axis=-1)
    return ((np.cos(angle - q * h) - np.cos(angle)) / q).sum(-1)


def test_a_stiff_rod_tends_to_a_rigid_link_at_order_one_in_its_compliance():
    load = {"tip": Wrench(on="cap", force=(1.0, -2.0, 0.5))}
    hinge = Revolute(axis=(0.2, 1.0, 0.4), stiffness=5.0, placement=Placement(rotation=(0.3, 0.1, -0.4)))

    def arm(middle):
        cap = Fixed(parent="middle", body=BODY)
        return Robot(Description(segments={"hinge": hinge, "middle": middle, "cap": cap}, loads=load))

    density = 1080.0
    mass = density * pi * 0.01**2 * 0.25
    link = Fixed(
        parent="hinge", tip=Placement(position=(0.25, 0, 0)), body=Body(mass=mass, com=(0.125, 0, 0))
    )
    rigid = arm(link)
    target = array(rigid.functions().pose("cap")(solved(rigid, np.zeros(1))))
    moduli, errors = [1e9, 1e10, 1e11], []
    for E in moduli:
        material = Linear(young_modulus=E, poisson_ratio=0.3, density=density)
        soft = arm(rod(parent="hinge", placement=Placement(), strains="simo_reissner", material=material))
        pose = array(soft.functions().pose("cap")(solved(soft, np.zeros(13))))
        errors.append(np.abs(pose - target).max())
    assert -np.polyfit(np.log(moduli), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.01)
    assert errors[-1] < 1e-4


def test_more_gauss_points_change_nothing_that_is_smooth():
    case = next(c for c in CASES if str(c) == "threaded-bent")
    fine = Statics(Robot(case.description, factor=2), ca.DM(case.q), ca.DM(case.u))
    assert gap(fine.residual(), case.functions.static_residual(case.q, case.u)) < 1e-10


@pytest.mark.parametrize("sections", [2, (0.3, 0.7)])
def test_more_sections_of_the_same_strain_are_the_same_rod(sections):
    case = next(c for c in CASES if str(c) == "pre_curved-bent")
    uneven = changed(case.description, ["segments", "rod", "sections"], sections)
    coarse, fine = Robot(uneven), Robot(uneven).refined(sections=2)
    halves = np.concatenate([np.tile(part, 2) for part in np.split(case.q, 2)])
    pair = np.kron(np.eye(2), np.kron(np.ones((1, 2)), np.eye(4)))  # sums the two halves of each section
    assert gap(fine.functions().pose("cap")(halves), coarse.functions().pose("cap")(case.q)) < 1e-13
    summed = pair @ array(fine.functions().static_residual(halves, case.u))
    assert gap(summed, coarse.functions().static_residual(case.q, case.u)) < 1e-12


# Parameters


def changed(node, keys, value):
    """A copy of nested records with another value at `keys`, built by their constructors."""
    if not keys:
        return value
    key, *others = keys
    if isinstance(node, dict):
        return {**node, key: changed(node[key], others, value)}
    assert is_dataclass(node) and key in {f.name for f in fields(node)}
    return replace(node, **{key: changed(getattr(node, key), others, value)})


def rebuilt(description, path, value):
    keys = path.split(".")
    return Robot(
        changed(
            description, keys if keys[0] in ("loads", "actuators", "gravity") else ["segments", *keys], value
        )
    )


def shaped(cross_section):
    return replace(ROBOTS["simo_reissner"], segments={"rod": rod(cross_section=cross_section)}, loads=None)


SQUARE = shaped(Rectangle(width=0.01, height=0.014))
CONE = shaped(
    Taper(start=Annulus(inner_radius=0.004, radius=0.012), end=Annulus(inner_radius=0.002, radius=0.006))
)
CABLES = ROBOTS["threaded"].actuators
THROUGH = replace(ROBOTS["threaded"], actuators={name: CABLES[name] for name in ("far", "short")})
PARAMETERS = [
    ("simo_reissner", "rod.material.young_modulus", 5e5),
    ("simo_reissner", "rod.material.poisson_ratio", 0.3),
    ("simo_reissner", "rod.material.density", 1500.0),
    ("simo_reissner", "rod.length", 0.3),
    ("simo_reissner", "rod.cross_section.radius", 0.011),
    ("simo_reissner", "rod.placement.position", (0.1, 0.2, 0.3)),
    ("simo_reissner", "rod.placement.rotation", (0.1, 0.2, 0.3)),
    ("simo_reissner", "cap.body.mass", 0.1),
    ("simo_reissner", "cap.body.com", (0.01, 0.02, -0.01)),
    ("simo_reissner", "cap.tip.position", (0.1, 0.2, 0.3)),
    ("simo_reissner", "loads.pull.force", (1.0, 2.0, 3.0)),
    ("simo_reissner", "actuators.cable.offset", (-0.004, 0.005)),
    ("simo_reissner", "gravity", (1.0, 2.0, 3.0)),
    ("off_centre_hole", "rod.cross_section.radius", 0.013),
    ("off_centre_hole", "rod.cross_section.inner_radius", 0.005),
    ("taper", "rod.cross_section.start.radius", 0.013),
    ("taper", "rod.cross_section.end.radius", 0.004),
    ("square", "rod.cross_section.width", 0.02),
    ("square", "rod.cross_section.height", 0.012),
    ("cone", "rod.cross_section.start.radius", 0.013),
    ("cone", "rod.cross_section.end.inner_radius", 0.003),
    ("general", "rod.cross_section.stiffness", (0.02, 0.01, 0.04, 80.0, 50.0, 60.0)),
    ("pre_curved", "rod.rest.bend_z", (1.0, 2.0)),
    ("polynomial", "rod.material.bend", (1.0, 20.0)),
    ("polynomial", "rod.material.coupling", 0.4),
    ("gent", "rod.material.bend_limit", 0.03),
    ("gent", "rod.material.shear_modulus", 2e5),
    ("chambers", "actuators.tangent.offset", ((0.005, 0.002), (0.004, -0.002))),
    ("chambers", "actuators.normal.area", 3e-5),
    ("chambers", "actuators.cone.offset.start", (0.005, 0.003)),
    ("loaded", "loads.jets.force", (0.3, 0.2, 0.1)),
    ("loaded", "loads.flow.moment", (0.03, 0.02, 0.01)),
    ("loaded", "loads.dead.moment", (0.03, 0.02, 0.01)),
    ("loaded", "ball.stiffness", 0.5),
    ("revolute", "joint.axis", (0.2, 0.4, -0.4)),
    ("revolute", "joint.point", (0.05, 0.02, 0.01)),
    ("revolute", "joint.rest", 0.7),
    ("helical", "joint.pitch", 0.08),
    ("spherical", "joint.stiffness", ((2.0, 0.1, 0.2), (0.1, 3.0, 0.3), (0.2, 0.3, 4.0))),
    ("planar", "joint.stiffness", (0.5, 10.0, 15.0)),
    ("planar", "joint.rest", (0.3, 0.0, 0.1)),
    ("through", "hinge.tip.position", (0.04, 0.01, 0.0)),
    ("through", "lower.length", 0.3),
]


def described(name):
    return {"square": SQUARE, "cone": CONE, "through": THROUGH}.get(name) or ROBOTS[name]


@pytest.mark.parametrize("name, path, value", PARAMETERS, ids=[f"{n}-{p}" for n, p, _ in PARAMETERS])
def test_a_parameter_gives_what_a_rebuilt_robot_gives_and_so_does_its_slope(name, path, value):
    description = described(name)
    original = Robot(description)
    case = next((c for c in CASES if c.name == name and c.shape == "bent"), None)
    q = case.q if case else np.linspace(-0.3, 0.4, original.n)
    u = case.u if case else np.linspace(0.3, 0.5, original.m)

    last = [*description.segments][-1]

    def answers(of):
        s = Statics(of, ca.DM(q), ca.DM(u))
        return array(ca.veccat(s.residual(), s.kin.frame_pose(of.tree.locate(last))))

    def parametric(p):
        return ca.veccat(f.static_residual(q, u, p), f.pose(last)(q, p))

    f, p = original.functions(parameters=[path]), np.ravel(value)
    expected = answers(rebuilt(description, path, value))
    assert gap(parametric(f.defaults), answers(original)) < 1e-12
    assert gap(parametric(p), expected) < 1e-12
    assert np.shape(original.value(path)) == np.shape(value)

    symbol = ca.SX.sym("p", p.size)
    slope = ca.Function("slope", [symbol], [ca.jacobian(parametric(symbol), symbol)])(p)
    direction = np.where(p == 0, np.abs(p).max() / 10, p) * (1 + np.cos(np.arange(p.size)) / 3)
    if np.ndim(value) == 2:  # a stiffness stays symmetric
        square = direction.reshape(np.shape(value))
        direction = ((square + square.T) / 2).ravel()
    h = 1e-4
    above, below = (answers(rebuilt(description, path, reshaped(p + k * direction, value))) for k in (h, -h))
    difference = (above - below) / (2 * h)
    assert np.abs(array(slope @ direction) - difference).max() < 1e-6 * np.abs(difference).max()
    assert np.abs(difference).max() > 1e-7


def reshaped(p, value):
    """Numbers p in the nested tuples of `value`."""
    if np.ndim(value) == 0:
        return float(p[0])
    lists = p.reshape(np.shape(value)).tolist()
    return tuple(map(tuple, lists)) if np.ndim(value) == 2 else tuple(lists)


def test_lengths_along_a_cable_that_begins_on_the_way_are_no_parameters():
    f = robot("threaded").functions(parameters=["hinge.tip.position"])
    with pytest.raises(ValueError, match="lengths along a cable .* must be numbers"):
        _ = f.actuation


def test_several_parameters_stack_in_the_order_they_are_named():
    paths = ["rod.material.young_modulus", "loads.pull.force", "rod.length"]
    f = robot("kirchhoff_love").functions(parameters=paths)
    np.testing.assert_array_equal(f.defaults, [4e5, 0.05, -0.1, 0.08, 0.25])
    other = robot("kirchhoff_love").with_values(dict(zip(paths, [5e5, (0.1, 0.2, 0.3), 0.3], strict=True)))
    q, u = 0.1 * np.ones(8), np.array([0.5])
    p = [5e5, 0.1, 0.2, 0.3, 0.3]
    assert gap(f.static_residual(q, u, p), other.functions().static_residual(q, u)) < 1e-13
    assert gap(f.pose("cap")(q, p), other.functions().pose("cap")(q)) < 1e-14
    assert gap(f.external_force(q, q, p), other.functions().external_force(q, q)) < 1e-13


@pytest.mark.parametrize(
    "path, sentence",
    [
        ("rod.lenght", "lenght.*did you mean 'length'"),
        ("loads.push.force", "loads.push"),
        ("arm.length", "no value"),
    ],
)
def test_a_path_to_nothing_is_refused(path, sentence):
    with pytest.raises(ValueError, match=sentence):
        robot("kirchhoff_love").value(path)


def test_values_of_a_path_are_those_of_the_records():
    of = robot("kirchhoff_love")
    assert of.value("rod.material.young_modulus") == RUBBER.young_modulus
    assert of.value("gravity") == (0.0, 0.0, -9.81)
    assert of.value("segments.cap.body.mass") == BODY.mass
    assert of.with_values({"rod.length": 0.5}).value("rod.length") == 0.5
    assert of.value("rod.length") == 0.25
