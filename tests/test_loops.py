"""Loops against independent codes (numpy, mpmath), differences, and laws of statics."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chains import Z, bar, flexible, four_bar, impossible_chain, oracle, random_chain, rigid_four_bar, world_wrenches

import socontrol as so
from socontrol.codegen.catalogue import entries, wishes
from socontrol.mechanics import loops
from socontrol.mechanics.loops import End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.joints import Fixed
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.looks import check
from socontrol.programs.postures.statics import Statics
from socontrol.quantities import Bad

PROBLEMS = Path(__file__).parents[1] / "problems"
FLEXIBLE = ["fourbar_flexible_coupler", "finray"]
OPEN = np.array([0.7, -0.2, 0, 0, 0, 0, 1.2])  # the branch of the flexible four-bar with its pin above the ground


def flat(x):
    return np.array(x).ravel()


@cache
def rigid():
    return Robot(rigid_four_bar())


@cache
def at_rest(name):
    """(robot, inputs, balance, answer) of a file."""
    description, u = flexible(name)
    robot = Robot(description)
    balance = ClosedBalance(robot)
    return robot, u, balance, balance.solve(u, OPEN if "coupler" in name else None)


@cache
def closed(kind):
    """A random robot that one loop of a kind closes, and a closed shape."""
    robot = Robot(random_chain(1, kind))
    return robot, ClosedBalance(robot).solve(np.zeros(0)).q


# Rows


@pytest.mark.parametrize("kind", loops.LOOPS)
def test_the_jacobian_is_the_slope_of_the_error_where_loops_are_closed(kind):
    robot, q = closed(kind)
    f = robot.functions()
    error, A, h = f.loop_error.function, np.array(f.loop_jacobian(q)), 1e-6
    assert np.max(np.abs(flat(error(q)))) < 1e-11
    differences = np.array([flat(error(q + h * e)) - flat(error(q - h * e)) for e in np.eye(robot.n)]).T / (2 * h)
    np.testing.assert_allclose(A, differences, atol=1e-8)
    assert np.linalg.matrix_rank(A, tol=1e-6) == len(robot.loops["loop0"].units)


@pytest.mark.parametrize("kind", loops.LOOPS)
def test_a_closing_joint_holds_what_it_does_not_leave(kind):
    loop = closed(kind)[0].loops["loop0"]
    held, left = np.array(loop.Phi_perp()), np.array(loop.Phi()).reshape(6, -1)
    np.testing.assert_allclose(held.T @ held, np.eye(held.shape[1]), atol=1e-14)
    assert held.shape[1] + left.shape[1] == 6 and np.max(np.abs(held.T @ left), initial=0.0) < 1e-14


@pytest.mark.parametrize("kind", ["helical", "fixed"])
def test_the_bias_is_the_rate_of_the_jacobian(kind):
    robot, q = closed(kind)
    f, qd, h = robot.functions(), np.random.default_rng(0).uniform(-1, 1, robot.n), 1e-6
    before, after = (np.array(f.loop_jacobian.function(q + s * h * qd)) @ qd for s in (-1, 1))
    np.testing.assert_allclose(flat(f.loop_bias(q, qd)), (after - before) / (2 * h), atol=1e-6)


# Motion


@pytest.mark.parametrize("row", oracle("fourbar_rigid")["results"], ids=lambda row: f"crank at {row['crank_angle']}")
def test_the_rigid_four_bar_moves_as_the_analytic_one(row):
    f, q, qd, u = rigid().functions(), np.array(row["q"]), np.array(row["qd"]), [row["crank_torque"]]
    assert np.max(np.abs(flat(f.loop_error(q)))) < 1e-12
    np.testing.assert_allclose(np.array(f.pose("rocker")(q))[:2, 3], row["pin_world"], atol=1e-12)
    np.testing.assert_allclose(flat(f.forward_dynamics(q, qd, u)), row["qdd_analytic"], rtol=1e-8)
    pin = world_wrenches(rigid(), q, flat(f.loop_force(q, qd, u)))["pin"]
    np.testing.assert_allclose(pin, [0, 0, 0, *row["lam_pin_force_on_coupler_world"], 0], atol=1e-8)


def forces_of(spec, wrenches):
    """The file's multipliers: forces in the plane, and the moment of what is welded."""
    welded = ["ang" in row for row in spec["constraints"]]
    return np.concatenate([[*w[3:5], *([w[2]] if weld else [])]
                           for w, weld in zip(wrenches.values(), welded, strict=True)])  # fmt: skip


@pytest.mark.parametrize("name", FLEXIBLE)
def test_flexible_chains_accelerate_as_the_independent_code_says(name):
    robot, u = at_rest(name)[:2]
    robot, row = Robot(replace(robot.description, loads=None)), oracle(name)["constrained_forward_dynamics"]
    f, state = robot.functions(), (np.array(row["q"]), np.array(row["qd"]), u)
    qdd, wanted = flat(f.forward_dynamics(*state)), np.array(row["qdd"])
    assert np.max(np.abs(qdd - wanted)) < 1e-9 * np.max(np.abs(wanted))
    found = forces_of(oracle(name), world_wrenches(robot, state[0], flat(f.loop_force(*state))))
    assert np.max(np.abs(found - row["lam"])) < 1e-8 * np.max(np.abs(row["lam"]))


def test_rows_held_twice_change_no_acceleration_and_share_the_force():
    pin = rigid().loops["pin"]
    again = Robot(replace(rigid().description, loops={"pin": pin, "ball": loops.Spherical(a=pin.a, b=pin.b)}))
    row = oracle("fourbar_rigid")["results"][0]
    state = np.array(row["q"]), np.array(row["qd"]), [row["crank_torque"]]
    one, two = rigid().functions(), again.functions()
    np.testing.assert_allclose(flat(two.forward_dynamics(*state)), flat(one.forward_dynamics(*state)), rtol=1e-9)
    alone = flat(one.loop_force(*state))
    shares = flat(two.loop_force(*state))
    np.testing.assert_allclose(shares[2:5], alone[2:5] / 2, atol=1e-8)
    np.testing.assert_allclose(shares[5:8], alone[2:5] / 2, atol=1e-8)


# Rest


@pytest.mark.parametrize("name", FLEXIBLE)
def test_flexible_chains_rest_where_the_independent_code_says(name):
    robot, _, balance, answer = at_rest(name)
    wanted = oracle(name)["static_equilibrium"]
    assert answer.status.solved, answer.status.message
    assert np.max(np.abs(answer.q - wanted["q"])) < 1e-7 * np.max(np.abs(wanted["q"]))
    forces = forces_of(oracle(name), world_wrenches(robot, answer.q, answer.lam))
    assert np.max(np.abs(forces - wanted["lam"])) < 1e-6 * np.max(np.abs(wanted["lam"]))
    assert set(balance.redundant(answer.q, np.ones(robot.n, dtype=bool)).values()) == {3}, "rows across the plane"


@pytest.mark.parametrize("name", FLEXIBLE)
def test_the_look_on_another_path_balances_with_the_multipliers_alone(name):
    robot, u, _, answer = at_rest(name)
    looker, largest = check.Checker(robot), np.max(np.abs(check.Checker(robot)(answer.q, u)[1]))
    assert np.max(np.abs(looker(answer.q, u, answer.lam)[0])) < 1e-9 * largest
    assert np.max(np.abs(looker(answer.q, u, 1.001 * answer.lam)[0])) > 1e-6 * largest
    assert np.max(np.abs(looker.loop_error(answer.q))) < 1e-11
    assert np.max(np.abs(looker.loop_error(answer.q + 1e-6))) > 1e-9


def test_a_pressed_fin_ray_bends_towards_what_presses_it():
    pressed = so.load_problem(PROBLEMS / "finray_press.yaml")
    assert pressed.loads["object"].force[0] > 0, "the object stands on the left"
    tips = [question.solve().require()["front.position"][0] for question in (pressed, replace(pressed, loads=None))]
    assert tips[0] < tips[1] - 0.5e-3


def hanging(count=4, gravity=(0.0, -9.81, 0.0)):
    """A chain of bars from the world to the world, its ends closer than it is long."""
    segments = {f"bar{k}": bar(0.1, f"bar{k - 1}" if k else "world") for k in range(count)}
    far = End(segment="world", placement=Placement((0.08 * count, 0.0, 0.0)))
    pin = loops.Revolute(a=End(segment=f"bar{count - 1}"), b=far, axis=Z)
    return Robot(Description(segments=segments, gravity=gravity, loops={"pin": pin}))


def test_a_hanging_chain_is_carried_by_both_its_ends():
    result = Statics(robot=hanging()).solve().require()
    carried = np.array(result["reaction.bar0"])[3:] + np.array(result["loops.pin"])[3:]  # axes of the world
    np.testing.assert_allclose(carried, [0.0, 4 * 0.2 * 9.81, 0.0], atol=1e-9)
    assert result.details["stable"]


def test_what_hangs_stably_stands_unstably():
    robot = Robot(four_bar(0.1, 0.25, 0.2, 0.22))
    rest = Statics(robot=robot).solve().require()
    guess = dict(zip(robot.coordinates, rest.arrays["q"].tolist(), strict=True))
    upside = Robot(four_bar(0.1, 0.25, 0.2, 0.22, gravity=(0.0, 9.81, 0.0)))
    turned = so.solve(Statics(robot=upside, guess=replace(Statics(robot=robot).guess, coordinates=guess)))
    assert rest.details["stable"] and not turned.details["stable"]
    smallest = [x["stability.smallest_eigenvalue"] for x in (rest, turned)]
    assert smallest[0] == pytest.approx(-smallest[1], rel=1e-6)


def test_the_tangent_is_the_curvature_of_the_energy_of_closed_shapes():
    robot = Robot(four_bar(0.1, 0.25, 0.2, 0.22))
    balance, f, h = ClosedBalance(robot), robot.functions(), 1e-3
    rest = balance.solve([0.0])
    shapes = [balance.solve([0.0], rest.q, prescribed={0: rest.q[0] + k * h}).q for k in (-1, 0, 1)]
    low, mid, high = (flat(f.energy(q, np.zeros(3)))[2] for q in shapes)
    z = (shapes[2] - shapes[0]) / (2 * h)
    curvature = z @ balance.unbalanced(rest.q, [0.0], rest.lam)[1] @ z
    assert (low - 2 * mid + high) / h**2 == pytest.approx(curvature, rel=1e-4)


@pytest.mark.parametrize("seed", range(8))
def test_random_chains_come_to_rest_from_an_open_guess(seed):
    robot = Robot(random_chain(seed))
    balance = ClosedBalance(robot)
    assert np.max(np.abs(balance.closing(np.zeros(robot.n))[0])) > 1e-2
    answer = balance.solve(np.zeros(0))
    assert answer.status.solved and np.max(np.abs(balance.closing(answer.q)[0])) < 1e-10
    r, *parts = check.Checker(robot)(answer.q, np.zeros(0), answer.lam)
    scale = balance.scales.force
    assert np.max(np.abs(r / scale)) < 1e-8 * max(np.max(np.abs(part / scale)) for part in parts)


@pytest.mark.parametrize("seed", range(4))
def test_a_loop_that_cannot_close_is_named_with_its_gap(seed):
    description, gap = impossible_chain(seed)
    result = Statics(robot=Robot(description)).solve()
    assert result.status.outcome == "infeasible"
    assert f"'far' cannot close: at the nearest found its ends stay {1e3 * gap:.3g}"[:-1] in result.status.message


# Refusals

COUPLER, ROCKER = End(segment="coupler"), End(segment="rocker")
PIN = loops.Revolute(a=COUPLER, b=ROCKER, axis=Z)
WELD = loops.Fixed(a=End(segment="crank", placement=Placement((-0.1, 0.0, 0.0))), b=End(segment="world"))
REFUSED = {
    "unknown segment": ({"pin": replace(PIN, a=End(segment="cupler"))}, "loops.pin.a.segment", "mean 'coupler'"),
    "place on a joint": ({"pin": replace(PIN, b=End(segment="rocker", at=0.5))}, "loops.pin.b.at", "a joint has only"),
    "end to itself": ({"pin": replace(PIN, b=COUPLER)}, "loops.pin", "one rigid body"),
    "fixed child": ({"pin": replace(PIN, b=End(segment="hook"))}, "loops.pin", "one rigid body"),
    "world to world": ({"pin": replace(PIN, a=End(segment="world"), b=End(segment="world"))}, "loops.pin", "the world"),
    "no freedom": ({"pin": PIN, "weld": WELD}, "loops.weld", "no freedom"),
    "twice": ({"pin": PIN, "bolt": PIN}, "loops.bolt", "the same as 'pin'"),
    "twice, turned": ({"pin": PIN, "bolt": replace(PIN, a=ROCKER, b=COUPLER)}, "loops.bolt", "the same as 'pin'"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_loops_that_cannot_be_meant_are_refused_by_name(case):
    given, key, told = REFUSED[case]
    base = four_bar(0.1, 0.25, 0.2, 0.22)
    with pytest.raises(Bad, match=told) as refusal:
        replace(base, segments={**base.segments, "hook": Fixed(parent="coupler")}, loops=given)
    assert refusal.value.key == key


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("simulation", {"times": {"stop": 1, "every": 0.1}}),
        ("inverse_statics", {"goals": {"tip": {"type": "point", "on": "rocker", "target": [0.3, 0.2, 0]}}}),
        ("tensions", {"goals": {"tip": {"type": "point", "on": "rocker", "target": [0.3, 0.2, 0]}}}),
        ("trajectory", {"duration": 1}),
    ],
)
def test_problem_types_that_know_no_loops_say_so(kind, more):
    with pytest.raises(so.FileError, match=f"it has loops, which `{kind}` does not know yet"):
        so.problem({"type": kind, "robot": rigid(), **more})


# C


def test_functions_of_loops_are_offered_for_c_where_there_are_loops():
    names = ["loop_error", "loop_jacobian", "loop_bias", "loop_force", "forward_dynamics"]
    found, missing = entries(rigid(), wishes(rigid(), names))
    assert [e.wish.kind for e in found] == names and not missing
    tree = Robot(replace(rigid().description, loops=None))
    assert entries(tree, wishes(tree, ["loop_error"])) == ((), {"loop_error": "the robot has no loops"})
