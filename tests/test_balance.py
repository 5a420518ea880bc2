"""Forward statics: hard loads, loads without an answer, locked coordinates, and what is said about each."""

from functools import cache

import numpy as np
import pytest
from robots import ROBOTS, array
from robots import functions as functions_of
from robots import robot as robot_of

from socontrol.mechanics.actuators import JointTorque, Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.looks import check
from socontrol.programs.postures.statics import Statics
from socontrol.programs.question import Guess
from socontrol.programs.result import OUTCOMES

E, RADIUS, LENGTH = 1e6, 0.01, 0.5
EJ = E * np.pi * RADIUS**4 / 4
EULER = np.pi**2 * EJ / (4 * LENGTH**2)  # the load that buckles a cantilever
WEIGHTLESS = (0.0, 0.0, 0.0)
UPRIGHT = Placement(rotation=(0.0, -np.pi / 2, 0.0))  # x along world z


def arm(*, sections=6, strains="inextensible_constant_curvature", placement=None, **rest):
    rod = Rod(
        length=LENGTH,
        cross_section=Circle(radius=RADIUS),
        material=Linear(young_modulus=E, poisson_ratio=0.4, density=1000.0),
        sections=sections,
        strains=strains,
        placement=placement or Placement(),
    )
    return Robot(Description(segments={"arm": rod}, **{"gravity": WEIGHTLESS, **rest}))


def pulled(force, **keys):
    return arm(loads={"tip": Wrench(on="arm", force=force)}, **keys)


def unbalanced(robot, q, u=()):
    """Recomputed force on an independent path, over the largest, in scaled rows."""
    r, *parts = (part / scales(robot).force for part in check.residual(robot, q, u))
    return np.abs(r).max() / max(np.abs(part).max() for part in parts)


def pendulum(**keys):
    """A link on a motor, hanging under gravity along -z; x along the link, horizontal at zero."""
    body, tip = Body(mass=2.0, com=(0.1, 0.0, 0.0)), Placement((0.2, 0.0, 0.0))
    link = Revolute(axis=(0.0, 1.0, 0.0), body=body, tip=tip, **keys)
    return Robot(Description(segments={"link": link}, actuators={"motor": JointTorque(joint="link")}))


def guess(**coordinates):
    return Guess(coordinates=coordinates)


def named(robot, q):
    return guess(**dict(zip(robot.coordinates, map(float, q), strict=True)))


# Hard but solvable


@pytest.mark.parametrize("parameter", [1.0, 3.0, 10.0, 30.0])
def test_a_large_dead_load_at_once_gives_what_many_small_steps_give(parameter):
    """P L^2 / EJ up to 30, where all but the clamped end is aligned with the load."""
    P = parameter * EJ / LENGTH**2
    balance = Balance(pulled((0.0, 0.0, -P)), ["loads.tip.force"])
    q = np.zeros(balance.robot.n)
    for t in np.geomspace(0.1 / parameter, 1.0, 60):
        answer = balance.solve([], q, p=[0.0, 0.0, -P * t])
        assert answer.status.solved
        q = answer.q
    at_once = balance.solve([])
    assert at_once.status.solved
    np.testing.assert_allclose(at_once.q, q, rtol=1e-8, atol=1e-8 * np.abs(q).max())
    assert unbalanced(balance.robot, at_once.q) < 1e-9


@pytest.mark.parametrize(("sections", "turns"), [(1, 0.99), (2, 1.9), (8, 4.0), (8, 7.9)])
def test_a_moment_rolls_an_arm_up_several_turns(sections, turns):
    moment = (0.0, 0.0, 2 * np.pi * turns * EJ / LENGTH)
    robot = arm(sections=sections, loads={"tip": Wrench(on="arm", moment=moment)})
    answer = Balance(robot).solve([])
    assert answer.status.solved
    np.testing.assert_allclose(answer.q[1::2], 2 * np.pi * turns / LENGTH, rtol=1e-9)


@pytest.mark.parametrize("parameter", [100.0, 1000.0])
def test_an_extreme_dead_load_may_coil_the_arm_up_but_then_is_called_unstable(parameter):
    P = parameter * EJ / LENGTH**2
    result = Statics(robot=pulled((0.0, 0.0, -P)), discretisation=False).solve()
    if result.status.solved:
        assert unbalanced(result.question.loaded, result.arrays["q"]) < 1e-9
        q = result.arrays["q"].reshape(-1, 2)
        assert np.all(np.diff(np.abs(q[:, 0])) < 0) or not result.details["stable"]


def test_a_guess_chooses_between_the_equilibria_of_a_buckled_column():
    robot = pulled((-2 * EULER, 0.0, 0.0), strains=("bend_y",))
    bent = np.linspace(6.0, 1.0, 6)
    up, down = (Statics(robot=robot, guess=named(robot, sign * bent)).solve().require() for sign in (1, -1))
    np.testing.assert_allclose(up.arrays["q"], -down.arrays["q"], atol=1e-8)
    assert np.abs(up.arrays["q"]).max() > 3
    assert up.details["stable"] and down.details["stable"]
    assert unbalanced(robot, up.arrays["q"]) < 1e-9


def test_a_column_that_may_buckle_in_any_plane_is_called_marginal():
    robot = pulled((-2 * EULER, 0.0, 0.0))
    bent = np.outer(np.linspace(6.0, 1.0, 6), [1.0, 0.0]).ravel()
    assert "marginal" in Statics(robot=robot, guess=named(robot, bent)).solve().require().details["stability"]


# Stability


@pytest.mark.parametrize(("load", "stable"), [(0.5, True), (0.97, True), (1.05, False), (2.0, False)])
def test_a_straight_column_is_called_unstable_beyond_the_euler_load(load, stable):
    question = Statics(robot=pulled((-load * EULER, 0.0, 0.0)), discretisation=False)
    result = question.solve()
    np.testing.assert_allclose(result.arrays["q"], 0, atol=1e-12)
    assert result.status.solved
    assert result.details["stable"] == stable
    assert (result.details["stability"].startswith("unstable")) == (not stable)


def test_the_load_at_which_a_column_loses_stability_tends_to_eulers():
    """The smallest eigenvalue of the tangent is linear in the load; its zero tends to pi^2 EJ / (4 L^2)."""
    critical = []
    for sections in (4, 8, 16):
        smallest = []
        for load in (0.9 * EULER, 1.1 * EULER):
            robot = pulled((-load, 0.0, 0.0), sections=sections)
            balance = Balance(robot)
            K = np.array(balance.evaluate(np.zeros(robot.n), [])[1])
            smallest.append(np.linalg.eigvalsh((K + K.T) / 2)[0])
        critical.append(np.interp(0, smallest[::-1], [1.1, 0.9]))
    errors = np.abs(np.array(critical) - 1)
    assert errors[-1] < 2e-3
    assert 1.7 < np.log2(errors[1] / errors[2]) < 2.3


def test_a_follower_load_is_said_to_tell_divergence_only():
    load = {"tip": Wrench(on="arm", force=(-0.1 * EULER, 0.0, 0.0), axes="body")}
    result = Statics(robot=arm(loads=load), discretisation=False).solve()
    assert "not flutter" in result.details["stability"]


def test_a_pendulum_above_its_joint_is_unstable_and_below_it_stable():
    for q, stable in ((np.pi / 2, True), (-np.pi / 2, False)):
        question = Statics(robot=pendulum(), guess=guess(link=q), discretisation=False)
        result = question.solve()
        np.testing.assert_allclose(result.arrays["q"], [q], atol=1e-9)
        assert result.details["stable"] == stable


# No answer


def test_a_torque_that_gravity_cannot_hold_has_no_equilibrium_and_says_so():
    answer = Balance(pendulum()).solve([2.0 * 9.81 * 0.1 * 1.01])
    assert answer.status.outcome == "infeasible"
    assert answer.status.exit_code == 4
    assert "lower loads or inputs" in answer.status.message
    assert np.all(np.isfinite(answer.q))


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_a_torque_that_gravity_can_just_hold_has_one(share):
    """From the horizontal, where the torque of the weight has no slope; the link comes to rest below."""
    answer = Balance(pendulum()).solve([-share * 2.0 * 9.81 * 0.1])
    assert answer.status.solved
    np.testing.assert_allclose(answer.q, np.arccos(share), rtol=1e-6)


def test_a_free_joint_under_a_moment_has_no_equilibrium():
    hinge = Revolute(axis=(0.0, 1.0, 0.0), tip=Placement((0.2, 0.0, 0.0)))
    load = {"m": Wrench(on="hinge", moment=(0.0, 1.0, 0.0))}
    robot = Robot(Description(segments={"hinge": hinge}, gravity=WEIGHTLESS, loads=load))
    answer = Balance(robot).solve([])
    assert not answer.status.solved
    assert np.all(np.isfinite(answer.q))


def test_the_iteration_limit_is_named():
    answer = Balance(pendulum()).solve([5.0], max_iterations=1)
    assert answer.status.outcome == "limit"
    assert "iteration limit" in answer.status.message


def test_a_crushed_rod_is_rejected_by_name():
    """An axial thrust of 95 % of E A shortens a linear rod to a twentieth: solved, but no rod any more."""
    EA = E * np.pi * RADIUS**2
    robot = pulled((-0.95 * EA, 0.0, 0.0), strains="linear_spring", sections=1)
    result = Statics(robot=robot, discretisation=False).solve()
    assert result.status.outcome == "rejected"
    assert "arm.0" in result.status.message


@cache
def balance_of(name):
    return Balance(robot_of(name))


@pytest.mark.parametrize("name", [name for name in ROBOTS if ROBOTS[name].loads])
def test_heavy_inputs_end_in_an_equilibrium_or_in_words_never_in_nan(name):
    balance, rng = balance_of(name), np.random.default_rng(1)
    size = np.where([unit == "Pa" for unit in balance.robot.input_units], 1e6, 30.0)
    for strength in (0.1, 1.0, 10.0):
        u = strength * size * rng.uniform(0, 1, balance.robot.m)
        answer = balance.solve(u)
        assert answer.status.outcome in OUTCOMES
        if answer.status.solved:
            assert np.all(np.isfinite(answer.q))
            r = array(functions_of(name).static_residual.function(answer.q, u)) / balance.scales.force
            B = array(functions_of(name).actuation.function(answer.q)).reshape(balance.robot.n, -1)
            assert np.abs(r).max() < 1e-8 * max(1, np.abs(B @ u / balance.scales.force).max())
        else:
            assert len(answer.status.message) > 20


# Locked coordinates


def test_a_locked_joint_is_held_by_the_torque_a_motor_would_need():
    robot = pendulum(stiffness=0.5, rest=0.2)
    result = Statics(robot=robot, coordinates={"link": 0.7}).solve().require()
    holding = result["holding.link"]
    assert result.values["holding.link"].unit == "N m"
    np.testing.assert_allclose(holding, 0.5 * (0.7 - 0.2) - 2.0 * 9.81 * 0.1 * np.cos(0.7), rtol=1e-12)
    free = Statics(robot=robot, inputs={"motor": holding}, guess=guess(link=0.6)).solve().require()
    np.testing.assert_allclose(free.arrays["q"], [0.7], rtol=1e-10)


def test_locking_part_of_an_equilibrium_where_it_stands_needs_no_force():
    robot = pulled((0.01, 0.0, -0.05))
    free = Statics(robot=robot).solve().require()
    held = {name: float(x) for name, x in zip(robot.coordinates[:3], free.arrays["q"], strict=False)}
    locked = Statics(robot=robot, coordinates=held).solve().require()
    np.testing.assert_allclose(locked.arrays["q"], free.arrays["q"], rtol=1e-9, atol=1e-12)
    for name in held:
        assert abs(locked[f"holding.{name}"]) < 1e-10


def test_energy_falls_along_the_holding_force_that_is_let_go():
    """dE/dq of the locked coordinate is its holding force, the others following."""
    robot = arm(
        loads={"tip": Wrench(on="arm", force=(0.01, 0.0, -0.05))},
        actuators={"t": Tendon(along=("arm",), offset=(0.006, 0.0))},
    )
    name, h, f = robot.coordinates[4], 1e-4, robot.functions()

    def locked(value):
        return Statics(robot=robot, coordinates={name: value}, inputs={"t": 0.4}).solve()

    def potential(value):
        q = locked(value).require().arrays["q"]
        tip = array(f.pose("arm")(q))[:3, 3]
        return array(f.energy(q, 0 * q))[1] - tip @ [0.01, 0.0, -0.05] + 0.4 * array(f.actuator_lengths(q))[0]

    held = locked(0.9).require()[f"holding.{name}"]
    np.testing.assert_allclose(held, (potential(0.9 + h) - potential(0.9 - h)) / (2 * h), rtol=1e-6)


def test_a_robot_with_every_coordinate_locked_is_at_rest_wherever_it_is_put():
    robot = pulled((0.0, 0.0, -0.05), sections=2)
    held = dict(zip(robot.coordinates, (0.3, -0.2, 0.1, 0.4), strict=True))
    result = Statics(robot=robot, coordinates=held).solve().require()
    np.testing.assert_array_equal(result.arrays["q"], list(held.values()))
    assert result.solver["iterations"] == 0
    assert "no free coordinate" in result.details["stability"]
    r = array(robot.functions().static_residual(result.arrays["q"], []))
    np.testing.assert_allclose([result[f"holding.{name}"] for name in held], r, rtol=1e-12)
    answer = Balance(robot).solve([], prescribed=dict(enumerate(held.values())))
    np.testing.assert_array_equal(answer.residual, 0)  # what a lock carries is not unbalanced


def test_a_robot_without_coordinates_is_at_rest():
    robot = Robot(Description(segments={"post": Fixed(body=Body(mass=1.0), tip=Placement((0.0, 0.0, 0.3)))}))
    result = Statics(robot=robot).solve().require()
    np.testing.assert_allclose(result["post.position"], [0, 0, 0.3])


@pytest.mark.parametrize("name", ["fixed", "general", "energy", "two_roots", "free"])
def test_an_equilibrium_does_not_depend_on_where_the_search_starts(name):
    """For moderate inputs, that leave one stable equilibrium."""
    balance = balance_of(name)
    u = 0.05 * np.ones(balance.robot.m)
    rest = balance.solve(u)
    near = balance.solve(u, rest.q + 0.05 * balance.scales.q * np.sin(np.arange(balance.robot.n)))
    assert rest.status.solved and near.status.solved
    np.testing.assert_allclose(near.q / balance.scales.q, rest.q / balance.scales.q, rtol=0, atol=1e-9)
