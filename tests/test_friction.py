"""Cables that rub: tensions by the capstan law on curves known in closed form or measured as polygons in the world.

Polygons stand on poses alone: the turn of a cable is the sum of angles between its sides, its force the virtual work
of sides that each carry their own tension.
"""

from dataclasses import replace
from functools import cache
from math import pi
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from robots import DISC, RUBBER, array, exponential, gap, hat, norm, robot, romberg, slopes

import socontrol as so
from socontrol.mechanics.actuators import Tendon
from socontrol.mechanics.friction import CREEP
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.routes import Converging, Helix
from socontrol.mechanics.statics import Statics
from socontrol.model.bodies import Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.rods import Rod
from socontrol.programs.looks import check

MU = 0.15
HELIX = Helix(radius=0.006, turns=0.7, phase=0.3, end_radius=0.004)
FINGER = Path(__file__).parent.parent / "configs" / "robots" / "guided_finger.yaml"


def arm(sections=1, strains="kirchhoff_love", quadrature=12, **cables):
    common = dict(sections=sections, strains=strains, quadrature=quadrature)
    own = Rod(length=0.2, cross_section=DISC, material=RUBBER, **common)
    return Robot(Description(segments={"arm": own}, actuators=cables, gravity=(0.0, 0.0, 0.0)))


def tendon(offset=(0.008, 0.0), along=("arm",), **more):
    return Tendon(along=along, offset=offset, **{"friction": MU, **more})


@cache
def guided(rubbing=True):
    """Rod, block with holes, hinge with a hole and rod: a helical and a converging cable, and one without friction."""
    description = robot("guided").description
    own = description.actuators
    cables = {
        "helix": replace(own["helix"], friction=MU),
        "guided": replace(own["guided"], friction=0.2, moving=-0.5),
        "part": own["part"],
    }
    if not rubbing:
        cables = {name: replace(cable, friction=0.0) for name, cable in cables.items()}
    return Robot(replace(description, actuators=cables))


@cache
def winding():
    return arm(2, "simo_reissner", c=tendon(HELIX), s=tendon(Converging(start=(0.0, 0.008), end=(0.003, 0.001))))


ROBOTS = {"guided": guided, "winding": winding}


def bent(of, seed=0):
    """Sections bent by up to a radian, stretched by up to a tenth, joints turned by up to 0.8 rad."""
    size = [0.8 / float(p.length) if unit == "1/m" else 0.1 if unit == "1" else 0.8
            for p in of.tree.pieces for unit in of.coordinate_units[p.columns]]  # fmt: skip
    return np.random.default_rng(seed).uniform(-1, 1, of.n) * size


def end_of(of, name, q):
    """Tension at a cable's end over that at its motor."""
    return float(of.functions().cable(name)(q)[1][-1])


# The capstan law


@pytest.mark.parametrize("sections", [1, 3])
@pytest.mark.parametrize("moving", [1.0, -1.0, 0.4])
def test_a_cable_once_round_an_arm_keeps_exp_of_minus_mu_two_pi_of_its_tension(sections, moving):
    of = arm(sections, c=tendon(moving=moving))
    q = np.tile([0, 0, 2 * pi / 0.2, 0.03], sections)
    assert end_of(of, "c", q) == pytest.approx(np.exp(-MU * moving * 2 * pi), rel=1e-9)


def test_tension_falls_with_every_turn_between_holes_and_across_a_hinge():
    """A polygon in space: 1 N at the motor, what exp(-mu angle) leaves at each corner."""
    low, high = ((0.01, 0.0, 0.02), (0.05, 0.02, 0.01)), ((0.02, 0.01, 0.0), (0.06, -0.02, 0.03), (0.08, 0.0, 0.0))
    of = Robot(
        Description(
            segments={
                "low": Fixed(placement=Placement(rotation=(0.3, 0.1, 0.2)), tip=Placement(position=(0.1, 0.0, 0.0))),
                "high": Revolute(parent="low", axis=(0.0, 0.0, 1.0), tip=Placement(position=(0.1, 0.0, 0.0))),
            },
            actuators={"c": tendon(along=("low", "high"), holes={"low": low, "high": high})},
        )
    )
    for angle in (0.0, 0.9):
        c, s = np.cos(angle), np.sin(angle)
        turned = [np.array([0.1 + c * x - s * y, s * x + c * y, z]) for x, y, z in high]
        steps = np.diff([*map(np.array, low), *turned], axis=0)
        steps /= np.linalg.norm(steps, axis=1)[:, None]
        angles = np.arccos((steps[:-1] * steps[1:]).sum(1))
        ratios = array(of.functions().cable("c")([angle])[1])
        np.testing.assert_allclose(ratios[1::2], np.exp(-MU * np.cumsum([0, *angles])), rtol=1e-9)


def curve(q, X):
    """World points [k x ... x 3] of the helical cable of an arm of one section, also beyond its ends; q [... 4]."""
    xi = np.concatenate([q, 0 * q[..., :2]], axis=-1) + [0, 0, 0, 1, 0, 0]
    angle, radius = HELIX.phase + 2 * pi * HELIX.turns * X, HELIX.radius + X * (HELIX.end_radius - HELIX.radius)
    places = zip(X, radius * np.cos(angle), radius * np.sin(angle), strict=True)
    return np.array([(exponential(hat(0.2 * x * xi)) @ [0, y, z, 1])[..., :3] for x, y, z in places])


def corners(points):
    """Angle [rad] at each inner point of a polygon."""
    sides = np.diff(points, axis=0)
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    away, along = (np.linalg.norm(sides[1:] + sign * sides[:-1], axis=1) for sign in (-1, 1))
    return 2 * np.arctan2(away, along)


@pytest.mark.parametrize("shape", [(0.0, 0.0, 0.0), (0.6, -1.1, 0.9)])
def test_a_helical_cable_turns_as_its_polygon_in_the_world_does(shape):
    of, q = arm(quadrature=24, c=tendon(HELIX)), np.array([*np.array(shape) / 0.2, 0.05])
    turns = [corners(curve(q, (np.arange(-1, N + 1) + 0.5) / N)).sum() for N in (16, 32, 64, 128)]
    assert end_of(of, "c", q) == pytest.approx(np.exp(-MU * romberg(turns)), rel=1e-9)
    length, s = array(of.functions().actuator_lengths(q))[0], array(of.functions().cable("c")(q)[0])
    assert s[-1] == pytest.approx(length, rel=1e-12) and s[0] == 0


def test_the_force_of_a_cable_that_rubs_is_the_virtual_work_of_sides_of_different_tension():
    of = arm(quadrature=24, c=tendon(HELIX, friction=0.5))
    q, columns = np.array([2.0, -5.0, 4.0, 0.05]), []
    for N in (32, 64, 128):
        angles = corners(curve(q, np.arange(-1, N + 1) / N))  # at 0, 1/N ... 1 - 1/N
        tension = np.exp(-0.5 * (np.cumsum(angles) - angles[0] / 2))  # at the middle of each side
        X = np.arange(N + 1) / N
        columns.append(-slopes(lambda q, X=X, T=tension: T @ norm(np.diff(curve(q, X), axis=0)), q))
    assert gap(of.functions().actuation(q), romberg(columns)) < 1e-8


def test_what_an_arm_carries_inside_is_the_tension_left_there():
    of = arm(2, c=tendon(HELIX))
    q, f = bent(of), of.functions()
    for X in (0.0, 0.5, 0.8, 1.0):
        inside = array(f.internal_wrench("arm", X)(q, [2.0]))
        ratio = np.linalg.norm(inside[3:]) / 2
        if X in (0.0, 1.0):
            assert ratio == pytest.approx(array(f.cable("c")(q)[1])[-1 if X else 0], rel=1e-12)
    s, ratios = map(array, f.cable("c")(q))
    assert np.all(np.diff(s) >= 0) and np.all(np.diff(ratios) <= 0) and ratios[0] == 1


# Without friction, and other directions


def test_no_friction_or_no_moving_is_the_frictionless_cable():
    plain, q = guided(rubbing=False), bent(guided())
    expected = array(plain.functions().actuation(q))
    names = [f"actuators.{cable}.{key}" for key in ("moving", "friction") for cable in ("helix", "guided")]
    f = guided().functions(parameters=names)
    np.testing.assert_array_equal(f.defaults, [1.0, -0.5, MU, 0.2])
    for p in ([0, 0, MU, 0.2], [1, -0.5, 0, 0]):
        assert gap(f.actuation(q, p), expected) < 1e-13
    assert gap(f.actuation(q, f.defaults), guided().functions().actuation(q)) < 1e-15
    assert gap(f.actuation(q, f.defaults), expected) > 0.01
    assert not plain.friction and np.ptp(array(plain.functions().cable("part")(q)[1])) == 0


def test_mirrored_arms_lose_the_same_tension():
    """y -> -y, as in the routing's own test."""
    right = arm(2, "simo_reissner", c=tendon(Helix(radius=0.006, turns=0.8, phase=0.4)))
    left = arm(2, "simo_reissner", c=tendon(Helix(radius=0.006, turns=-0.8, phase=pi - 0.4)))
    mirror, q = np.tile([-1, 1, -1, 1, -1, 1], 2), bent(right, 4)
    assert gap(left.functions().cable("c")(mirror * q)[1], right.functions().cable("c")(q)[1]) < 1e-12
    assert gap(left.functions().actuation(mirror * q), mirror * array(right.functions().actuation(q))) < 1e-12


def test_a_name_that_is_no_cable_is_refused():
    with pytest.raises(ValueError, match="'arm' is no cable"):
        guided().functions().cable("arm")


# The independent look


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_the_independent_look_finds_the_same_forces(name, seed):
    of = ROBOTS[name]()
    q, u = np.zeros(of.n) if seed is None else bent(of, seed), np.linspace(1.0, 2.0, of.m)
    actuation = check.residual(of, q, u)[3]
    assert gap(actuation, array(of.functions().actuation(q)) @ u) < 1e-9


# Derivatives


@pytest.mark.parametrize("name", ROBOTS)
def test_tangents_are_the_derivatives_of_the_forces_and_finite_where_all_is_straight(name):
    of = ROBOTS[name]()
    q, u, lam = ca.SX.sym("q", of.n), ca.SX.sym("u", of.m), ca.SX.sym("lam", of.n)
    s = Statics(of, q, u)
    force = s.actuation() @ u
    work = s.actuation().T @ lam
    pairs = [s.actuation_tangent(), ca.jacobian(force, q), s.actuation_gradient(lam), ca.jacobian(work, q).T]
    found = ca.Function("found", [q, u, lam], pairs)
    for x in (np.zeros(of.n), bent(of, 3)):
        tangent, slope, gradient, own = found(x, np.linspace(1, 2, of.m), np.cos(np.arange(of.n)))
        assert np.isfinite(array(slope)).all()
        assert gap(tangent, slope) < 1e-12 and gap(gradient, own) < 1e-12
    second = ca.Function("second", [q, u, lam], [ca.jacobian(s.actuation_tangent().T @ lam, q)])
    assert np.isfinite(array(second(np.zeros(of.n), np.ones(of.m), np.ones(of.n)))).all()
    assert not s.conservative_actuation


def test_a_tangent_with_friction_couples_a_section_to_those_before_it_only():
    of = arm(3, c=tendon())
    tangent = array(Statics(of, ca.DM(bent(of)), ca.DM([1.0])).actuation_tangent())
    blocks = np.abs(tangent).reshape(3, 4, 3, 4).max((1, 3))
    assert np.all(blocks[np.triu_indices(3, 1)] == 0) and np.all(blocks[np.tril_indices(3)] > 0)


# In motion


@pytest.mark.parametrize("name", ROBOTS)
def test_in_motion_the_direction_is_that_of_the_cable_s_own_rate(name):
    of = ROBOTS[name]()
    q, qd = bent(of, 5), 0.01 * bent(of, 6)
    rates = rate(of, q, qd)
    moving = -rates / np.sqrt(rates**2 + CREEP**2)
    rubbing = [of.inputs[k] for k in of.friction.inputs]
    f = of.functions(parameters=[f"actuators.{name}.moving" for name in rubbing])
    B = f.actuation(q, moving[list(of.friction.inputs)])
    u = np.linspace(1.0, 2.0, of.m)
    moved = of.functions().motion_residual
    driving = array(moved(q, qd, 0 * q, 0 * u)) - array(moved(q, qd, 0 * q, u))
    qdd = array(of.functions().forward_dynamics(q, qd, u))
    assert gap(of.functions().inverse_dynamics(q, qd, qdd), driving) < 1e-9
    assert gap(of.functions(chained=True).forward_dynamics(q, qd, u), qdd) < 1e-10
    assert gap(driving, array(B) @ u) < 1e-10
    power = array(of.functions().power(q, qd, u)[0])
    assert power[0] == pytest.approx(driving @ qd, rel=1e-12)


def rate(of, q, qd):
    """Rates [m/s] of all lengths, by central differences."""
    ahead, back = (array(of.functions().actuator_lengths(q + h * qd)) for h in (1e-4, -1e-4))
    return (ahead - back) / 2e-4


def test_tangents_of_a_motion_hold_the_drag_of_friction():
    of = winding()
    q, qd, u = bent(of, 5), 0.01 * bent(of, 6), np.array([1.0, 2.0])
    x, v = ca.SX.sym("x", of.n), ca.SX.sym("v", of.n)
    s = Statics(of, x, ca.SX(u), v)
    force = s.actuation() @ u
    pairs = [s.actuation_tangent(), ca.jacobian(force, x), -s.actuation_damping(), ca.jacobian(force, v)]
    tangent, slope, drag, own = ca.Function("found", [x, v], pairs)(q, qd)
    assert gap(tangent, slope) < 1e-11 and gap(drag, own) < 1e-11 and np.abs(array(own)).max() > 1e-4
    damping = array(of.functions().motion_tangents(q, qd, u)[2]) - array(of.functions().damping(q))
    assert gap(damping, -array(own)) < 1e-9


@pytest.mark.parametrize("speed", [-0.2, 0.2])
def test_friction_takes_power_from_an_arm_that_curls_and_uncurls(speed):
    of, plain = arm(2, c=tendon()), arm(2, c=tendon(friction=0.0))
    q, qd = np.tile([0, 0, 6.0, 0.0], 2), np.tile([0, 0, 6.0 * speed, 0.0], 2)
    given, free = (array(x.functions().power(q, qd, [1.0])[0])[0] for x in (of, plain))
    turn, pull = 6.0 * 0.2, -6.0 * speed * 0.008 * 0.2  # rad, m/s
    moving = -pull / np.hypot(pull, CREEP)
    z = MU * moving * turn
    assert free == pytest.approx(-pull, rel=1e-12) and given < free
    assert given == pytest.approx(-pull * (1 - np.exp(-z)) / z, rel=1e-9)


def test_the_energy_of_a_motion_with_friction_is_explained_by_its_work():
    pull = {"type": "table", "times": [0, 0.1, 0.2, 0.3], "values": [0, 0.8, 0.2, 0.5]}
    asked = {"schema_version": 1, "type": "simulation", "robot": str(FINGER), "inputs": {"cable": pull},
             "times": {"stop": 0.3, "every": "50 ms"}, "solver": {"type": "radau"}}  # fmt: skip
    result = so.solve(so.problem(asked)).require()
    assert result.residuals["energy"].value < 1e-5
    assert result.arrays["work"][-1, 0] > 0
