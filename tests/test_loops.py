"""Loops against independent codes (numpy, mpmath), differences, and laws of statics."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from chains import (
    L_BEAM_TORSION,
    Z,
    bar,
    flexible,
    four_bar,
    impossible_chain,
    l_beam_displacement,
    oracle,
    random_chain,
    rigid_four_bar,
    wide_chain,
    world_wrenches,
)

import socontrol as so
from socontrol.codegen.catalogue import entries, wishes
from socontrol.mechanics import loops
from socontrol.mechanics.actuators import Tendon
from socontrol.mechanics.loops import End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.joints import Fixed
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.equilibria.closing import Assembly
from socontrol.programs.equilibria.least_energy import rest_of
from socontrol.programs.looks import check
from socontrol.programs.postures.statics import Statics
from socontrol.programs.question import Guess
from socontrol.quantities import Bad

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
    """A random robot that one loop of a kind closes, a closed shape, and its Functions."""
    robot = Robot(random_chain(1, kind))
    balance = ClosedBalance(robot)
    return robot, Assembly(balance, np.ones(robot.n, dtype=bool)).assembled(np.zeros(robot.n))[0], robot.functions()


# Rows


@pytest.mark.parametrize("kind", loops.LOOPS)
def test_the_jacobian_is_the_slope_of_the_error_where_loops_are_closed(kind):
    robot, q, f = closed(kind)
    error, A, h = f.loop_error.function, np.array(f.loop_jacobian(q)), 1e-6
    assert np.max(np.abs(flat(error(q)))) < 1e-11
    differences = np.array([flat(error(q + h * e)) - flat(error(q - h * e)) for e in np.eye(robot.n)]).T / (2 * h)
    np.testing.assert_allclose(A, differences, atol=1e-8)
    assert np.linalg.matrix_rank(A, tol=1e-6) == len(robot.loops["loop0"].units)


@pytest.mark.parametrize("kind", loops.LOOPS)
def test_slopes_of_the_error_are_its_differences_where_loops_are_open_too(kind):
    robot, q, f = closed(kind)
    rng, h = np.random.default_rng(2), 1e-6
    q = q + 0.2 * rng.standard_normal(robot.n)
    lam = rng.standard_normal(len(robot.loops["loop0"].units))
    error, E, S = (np.array(x) for x in f.closing.function(q, lam))
    sides = [[[np.array(x) for x in f.loop_rows.function(q + s * h * e)] for e in np.eye(robot.n)] for s in (1, -1)]
    np.testing.assert_array_equal(error, np.array(f.loop_error.function(q)))
    np.testing.assert_allclose(E, np.hstack([a[0] - b[0] for a, b in zip(*sides, strict=True)]) / (2 * h), atol=1e-8)
    turned = [(a[1] - b[1]).T @ lam for a, b in zip(*sides, strict=True)]
    np.testing.assert_allclose(S, np.array(turned).T / (2 * h), atol=1e-8)


@pytest.mark.parametrize("kind", loops.LOOPS)
def test_a_closing_joint_holds_what_it_does_not_leave(kind):
    loop = closed(kind)[0].loops["loop0"]
    held, left = np.array(loop.Phi_perp()), np.array(loop.Phi()).reshape(6, -1)
    np.testing.assert_allclose(held.T @ held, np.eye(held.shape[1]), atol=1e-14)
    assert held.shape[1] + left.shape[1] == 6 and np.max(np.abs(held.T @ left), initial=0.0) < 1e-14


@pytest.mark.parametrize("kind", ["helical", "fixed"])
def test_the_bias_is_the_rate_of_the_jacobian(kind):
    robot, q, f = closed(kind)
    qd, h = np.random.default_rng(0).uniform(-1, 1, robot.n), 1e-6
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
    robot, _, _, answer = at_rest("finray")
    assert robot.description.loads["push0"].force[0] > 0, "what presses stands on the left"
    tip = np.array(robot.functions().pose("e3")(answer.q))[0, 3]
    assert tip < -0.5e-3, "unpressed, its ribs lean on each other at x = 0"


def cabled(**of_cable):
    """An arch of two soft ribs that lean on each other, with a cable along the inner side of each."""
    common = {"length": 0.2, "cross_section": Circle(radius=5e-3), "sections": 2, "strains": ("bend_z", "stretch"),
              "material": Linear(young_modulus=4e6, poisson_ratio=0.45, density=1150.0)}  # fmt: skip
    ribs = {name: Rod(placement=Placement((x, 0.0, 0.0), (0.0, 0.0, turn)), **common)
            for name, x, turn in (("front", 0.0, np.pi / 3), ("back", 0.2, 2 * np.pi / 3))}  # fmt: skip
    pin = loops.Revolute(a=End(segment="front"), b=End(segment="back"), axis=Z)
    cables = {f"c_{rib}": Tendon(along=(rib,), offset=(side, 0.0), **of_cable)
              for rib, side in (("front", -4e-3), ("back", 4e-3))}  # fmt: skip
    return Robot(Description(segments=ribs, actuators=cables, loops={"pin": pin}, gravity=(0.0, -9.81, 0.0)))


@pytest.mark.parametrize("of_cable", [{}, {"stiffness": 200.0}], ids=["rigid", "stretching"])
def test_lengths_that_tensions_give_ask_for_the_same_tensions(of_cable):
    robot = cabled(**of_cable)
    pulled = Statics(robot=robot, inputs={"c_front": 2.0, "c_back": 0.5}, discretisation=False).solve().require()
    stretch = {name: 1 + T / of_cable.get("stiffness", np.inf) for name, T in (("c_front", 2.0), ("c_back", 0.5))}
    lengths = {name: pulled[f"lengths.{name}"] / stretch[name] for name in stretch}
    for given in ({"lengths": lengths}, {"lengths": {"c_front": lengths["c_front"]}, "inputs": {"c_back": 0.5}}):
        held = Statics(robot=robot, **given, discretisation=False).solve().require()
        np.testing.assert_allclose(held.arrays["u"], [2.0, 0.5], rtol=1e-8)
        np.testing.assert_allclose(held.arrays["q"], pulled.arrays["q"], atol=1e-8)
        np.testing.assert_allclose(held.arrays["lam"], pulled.arrays["lam"], atol=1e-8)
        assert held["stability.smallest_eigenvalue"] > pulled["stability.smallest_eigenvalue"], "cables held stiffen"


def test_a_cable_that_is_too_long_for_a_closed_chain_is_slack():
    robot = cabled()
    held = Statics(robot=robot, lengths={"c_front": 0.198, "c_back": 0.3}, discretisation=False).solve().require()
    alone = Statics(robot=robot, lengths={"c_front": 0.198}, discretisation=False).solve().require()
    assert held.details["slack"] == ["c_back"] and held.arrays["u"][1] == 0.0
    np.testing.assert_allclose(held.arrays["q"], alone.arrays["q"], atol=1e-9)


def test_a_cable_across_what_loops_and_a_locked_crank_leave_rigid_is_told_and_pulls_nothing():
    given = four_bar(0.1, 0.25, 0.2, 0.22)
    robot = Robot(replace(given, actuators={"c": Tendon(along=("crank", "coupler"), offset=(0.01, 0.0))}))
    keys = {"robot": robot, "coordinates": {"crank": 0.7}, "guess": Guess(coordinates={"coupler": -0.2, "rocker": 1.2})}
    length = Statics(**keys).solve().require()["lengths.c"]
    held = Statics(**keys, lengths={"c": length}).solve().require()
    assert held.details["redundant"] and held.arrays["u"] == pytest.approx([0.0], abs=1e-9)
    assert not Statics(**keys, lengths={"c": 0.9 * length}).solve().status.solved


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


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("chain", [random_chain, wide_chain])
def test_random_chains_come_to_rest_from_an_open_guess(chain, seed):
    robot = Robot(chain(seed))
    balance = ClosedBalance(robot)
    assert np.max(np.abs(balance.closing(np.zeros(robot.n))[0])) > 1e-2
    answer = balance.solve(np.zeros(0))
    assert answer.status.solved and np.max(np.abs(balance.closing(answer.q)[0])) < 1e-10
    r, *parts = check.Checker(robot)(answer.q, np.zeros(0), answer.lam)
    scale = balance.scales.force
    assert np.max(np.abs(r / scale)) < 1e-8 * max(np.max(np.abs(part / scale)) for part in parts)


def test_a_rest_is_found_again_in_a_step_or_two_and_after_a_small_change_in_four():
    robot, u, balance, answer = at_rest("finray")
    assert balance.solve(u, answer.q).iterations <= 2
    moved = ClosedBalance(robot, ["loads.push0.force"])
    near = moved.solve(u, answer.q, 1.03 * moved.defaults)
    assert near.status.solved and near.iterations <= 5
    far = moved.solve(u, None, 1.03 * moved.defaults)
    np.testing.assert_allclose(near.q, far.q, atol=1e-9)
    np.testing.assert_allclose(near.lam, far.lam, atol=1e-9)


def test_where_loops_close_in_two_ways_the_rest_of_least_energy_is_taken_unless_a_guess_says_otherwise():
    """Two circles meet above and below the ground: weights at their bars' middles are lower below."""
    given = four_bar(0.1, 0.25, 0.2, 0.22, gravity=(0.0, 9.81, 0.0))
    held = {"robot": Robot(given), "coordinates": {"crank": 1.0}, "discretisation": False}
    least = Statics(**held).solve().require()
    assert least.details["shapes"]["rests"] == 2 and "Of 2 rests" in least.status.message
    other = Statics(**held, guess=Guess(coordinates={"coupler": -2.0, "rocker": -2.0})).solve().require()
    assert "shapes" not in other.details
    assert least["rocker.position"][1] > 0 > other["rocker.position"][1], "this weight acts upwards"
    upright = Statics(**{**held, "robot": Robot(replace(given, gravity=(0.0, -9.81, 0.0)))}).solve().require()
    np.testing.assert_allclose(upright["rocker.position"], other["rocker.position"], atol=1e-9)


def test_a_shape_that_is_closed_as_drawn_is_not_looked_for_elsewhere():
    robot, u, balance, _ = at_rest("finray")
    answer, tried = rest_of(balance, u, np.zeros(robot.n), {}, 200, guessed=False)
    assert answer.status.solved and not tried


def test_the_clamped_l_sags_as_its_strong_form_says_in_the_limit_of_many_sections():
    """Errors fall as 1/sections^2; 0.1248 m is an independent solution, shear included, to 4 digits."""
    coarse, fine = (l_beam_displacement(count, L_BEAM_TORSION["Saint-Venant"]) for count in (2, 4))
    assert fine + (fine - coarse) / 3 == pytest.approx(0.1248, abs=2e-4)


def test_a_joint_without_springs_is_held_by_loops_that_springs_hold():
    robot = four_bar(0.1, 0.25, 0.2, 0.22, gravity=(0.0, 0.0, 0.0))
    crank = replace(robot.segments["crank"], stiffness=0.3)
    sprung = Robot(replace(robot, segments={**robot.segments, "crank": crank}))
    assert so.solve(so.problem({"type": "statics", "robot": sprung})).status.solved
    with pytest.raises(so.FileError, match="nothing holds crank, coupler and rocker"):
        so.problem({"type": "statics", "robot": Robot(robot)})


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
