"""What an answer says of itself: limits found to help or not, what is no error, strains beyond a law."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from chains import four_bar
from scipy.optimize import brentq

import socontrol as so
from socontrol.cli.check import summary
from socontrol.files.expectations import Comparison, sentences
from socontrol.files.loader import FileError
from socontrol.mechanics.loops import slices
from socontrol.mechanics.robot import Robot
from socontrol.programs.postures.paths import unstable_at
from socontrol.programs.postures.statics import Statics

ROOT = Path(__file__).parent.parent
E, NECK, HAND = 1e6, 0.1, (1.0, 0.3)  # modulus, length of a flexure, of the stiff part after each


def rod(**changes):
    given = {"type": "rod", "strains": ["bend_z"], "length": NECK, "cross_section": {"type": "circle", "radius": 4e-3},
             "material": {"type": "linear", "young_modulus": E, "poisson_ratio": 0.5, "density": 1000}}  # fmt: skip
    return {**given, **changes}


def ask(robot, kind="inverse_statics", **keys):
    return so.solve(so.problem({"type": kind, "robot": {"gravity": [0, 0, 0], **robot}, **keys}))


# Limits


def two_knuckles(limit):
    """Two flexures, the second five times as soft, that one cable bends."""
    soft = 4e-3 * 5**-0.25
    ends = [{"type": "fixed", "parent": f"knuckle{k}", "tip": {"position": [size, 0, 0]}}
            for k, size in enumerate(HAND)]  # fmt: skip
    segments = {"knuckle0": rod(), "bone0": ends[0],
                "knuckle1": rod(parent="bone0", sections=4, cross_section={"type": "circle", "radius": soft}),
                "bone1": ends[1]}  # fmt: skip
    cable = {"type": "tendon", "along": list(segments), "offset": [2e-3, 0], "limits": [0, limit]}
    return {"segments": segments, "actuators": {"cable": cable}}


def tip_of_knuckles(tension):
    """x of the end: chords of two arcs and the bones after them."""
    first = tension * 2e-3 * NECK / (E * np.pi / 4 * 4e-3**4)
    both = 6 * first
    arcs = NECK * np.sin(first) / first + NECK * (np.sin(both) - np.sin(first)) / (both - first)
    return arcs + HAND[0] * np.cos(first) + HAND[1] * np.cos(both)


@pytest.mark.parametrize("limit", [0.4, 0.7])
def test_a_limit_that_helps_only_beyond_where_the_goal_is_nearest_is_found(limit):
    """The end comes nearer, goes away and comes again: where the limit stands between, it is not even reached."""
    unit = E * np.pi / 4 * 4e-3**4 / (2e-3 * NECK)  # tension that turns the first knuckle by a radian
    assert tip_of_knuckles(0.6 * unit) < 0.65 and tip_of_knuckles(1.0 * unit) > 0.85, "it goes away again"
    needed = brentq(lambda x: tip_of_knuckles(x * unit) - 0.55, 1.05, 1.4) * unit
    goal = {"tip": {"type": "point", "on": "bone1", "target": [0.55, None, None]}}
    result = ask(two_knuckles(limit * unit), goals=goal, discretisation=False, solver={"type": "ipopt", "starts": 0})
    assert result.status.outcome == "infeasible"
    (row,) = result.details["unreachable"]
    assert row["needed"] == pytest.approx(needed, rel=1e-4)


def test_limits_that_help_together_are_told_even_where_goals_ask_for_more_numbers_than_inputs():
    robot = str(ROOT / "configs/robots/parallel_soft_platform.yaml")
    goals = {"top": {"type": "point", "on": "plate", "target": [0, 0, 0.095]},
             "level": {"type": "axis", "on": "plate", "axis": [0, 0, 1], "target": [0, 0, 1]}}  # fmt: skip
    answer = so.solve(so.problem({"type": "inverse_statics", "robot": robot, "goals": goals}))
    assert not answer.status.solved and answer.status.message.count("would need") == 3
    needed = answer.details["together"]
    held = so.solve(so.problem({"type": "statics", "robot": robot, "inputs": needed})).require()
    assert set(needed) == {"p0", "p1", "p2"} and max(needed.values()) > 60e3
    assert held["plate.position"] == pytest.approx([0, 0, 0.095], abs=1e-8)


def test_what_was_not_found_is_not_said_to_be_impossible():
    goal = {"tip": {"type": "point", "on": "bone1", "target": [2.0, None, None]}}
    result = ask(two_knuckles(0.1), goals=goal, solver={"type": "ipopt", "starts": 0},
                 bounds={"inputs": {"cable": [0.05, 0.1]}})  # fmt: skip
    assert result.status.outcome == "infeasible" and "no way found by this limit alone" in result.status.message
    assert "together" not in result.status.message, "one input is no other question than it alone"


@pytest.mark.parametrize("sideways", [0.0, 0.1])
def test_numbers_that_a_plane_robot_cannot_miss_are_not_counted(sideways):
    """Two turns reach 0.3 m in their plane, x-y: a point outside asks for two numbers in it, and one across it."""
    turn = {"type": "revolute", "axis": [0, 0, 1], "stiffness": 0.1}
    segments = {"upper": {**turn, "tip": {"position": [0.2, 0, 0]}},
                "lower": {**turn, "parent": "upper", "tip": {"position": [0.1, 0, 0]}}}  # fmt: skip
    motors = {f"at_{name}": {"type": "joint_torque", "joint": name, "limits": [-9, 9]} for name in segments}
    goal = {"tip": {"type": "point", "on": "lower", "target": [0.3, 0.4, sideways]}}
    result = ask({"segments": segments, "actuators": motors}, goals=goal, solver={"type": "ipopt", "starts": 0})
    assert result.status.outcome == "infeasible"
    assert result.values["short.tip"].value == pytest.approx(np.hypot(0.2, sideways), abs=1e-6)
    assert ("3 numbers and 2 inputs" in result.status.message) == bool(sideways)
    assert ("No limit is reached" in result.status.message) == (not sideways)


# Rests


def column():
    """An upright rod under three times the force that buckles it, and two cables."""
    force = 3 * np.pi**2 / 4 * E * np.pi / 4 * 4e-3**4 / 0.1**2
    cables = {f"c{k}": {"type": "tendon", "along": ["rod"], "offset": [y, 0], "limits": [0, 5]}
              for k, y in enumerate((2e-3, -2e-3))}  # fmt: skip
    return {"segments": {"rod": rod(length=0.1, sections=2)}, "actuators": cables,
            "loads": {"weight": {"type": "wrench", "on": "rod", "force": [-force, 0, 0]}}}  # fmt: skip


def test_an_unstable_rest_is_compared_with_that_of_twice_the_sections_and_no_other():
    """Straight is straight with any number of sections; the other rests are centimetres away."""
    target = [[0, 0, 0], [0, 1e-5, 0]]
    result = ask(column(), goals={"p": {"type": "path", "on": "rod", "target": target, "axes": ["y"]}})
    assert result.status.message == "All 2 waypoints solved. Stable at none of the 2 waypoints."
    assert result.details["discretisation"]["rod"] < 1e-6


def test_waypoints_that_are_not_stable_are_told_in_runs():
    assert unstable_at([True, True]) == ""
    assert unstable_at([False, True, True, False, False, False]) == " Not stable at waypoints 1 and 4 to 6."
    assert unstable_at([k % 2 == 0 for k in range(14)]).endswith("waypoints 2, 4, 6, 8, 10 and 2 more.")


@pytest.mark.parametrize("share", [0.4, 0.7, -0.6])
def test_a_stretch_that_no_linear_law_means_is_told(share):
    pull = {"tip": {"type": "wrench", "on": "rod", "force": [share * E * np.pi * 4e-3**2, 0, 0]}}
    result = ask({"segments": {"rod": rod(strains="linear_spring")}}, "statics", loads=pull).require()
    word = "rod is stretched by 70 %" if share > 0 else "rod is shortened by 60 %"
    assert (word in result.status.message) == (abs(share) > 0.5)


# Loops


def test_the_multipliers_of_the_functions_are_the_wrench_that_results_tell():
    robot = Robot(four_bar(0.1, 0.25, 0.2, 0.22))
    result = Statics(robot=robot, name="bars", coordinates={"crank": 0.7}, discretisation=False).solve().require()
    held = result.values["holding.crank"].value
    f, own = robot.functions(), slices(robot.loops)
    (name,) = own
    still = f.forward_dynamics(result.arrays["q"], np.zeros(3), [held])
    np.testing.assert_allclose(np.array(still), 0, atol=1e-8)
    lam = np.array(f.loop_force(result.arrays["q"], np.zeros(3), [held])).ravel()
    wrench = np.array(ca.DM(robot.loops[name].Phi_perp()) @ lam[own[name]]).ravel()
    np.testing.assert_allclose(wrench, result[f"loops.{name}"], atol=1e-8)


def test_an_end_without_a_place_is_told_that_the_world_is_one():
    robot = {"segments": {"arm": {"type": "revolute", "axis": [0, 0, 1]}},
             "loops": {"wall": {"type": "revolute", "a": {"segment": "arm"}, "b": {}}}}  # fmt: skip
    with pytest.raises(FileError, match="loops.wall.b.segment: missing key 'segment' .*'world'"):
        so.problem({"type": "statics", "robot": robot})


def test_a_check_says_whether_loops_close_at_zero(tmp_path):
    bars = """
segments:
  crank: {type: revolute, axis: [0, 0, 1], tip: {position: [100 mm, 0, 0]}}
  coupler: {type: revolute, axis: [0, 0, 1], parent: crank, tip: {position: [250 mm, 0, 0]}}
  rocker: {type: revolute, axis: [0, 0, 1], placement: {position: [220 mm, 0, 0]}, tip: {position: [200 mm, 0, 0]}}
loops: {pin: {type: revolute, axis: [0, 0, 1], a: {segment: coupler}, b: {segment: rocker}}}
"""
    path = tmp_path / "bars.yaml"
    path.write_text(bars)
    assert "1 loop (open at q = 0, pin: 70 mm apart" in summary(path)
    path.write_text(bars.replace("250", "320"))
    assert summary(path).endswith("1 loop (closed at q = 0)")


# Expectations


def test_expectations_of_an_answer_that_there_is_not_share_a_line():
    missing = [Comparison(f"values.x{k}", 1.0, None, 0.1, "ours", False) for k in range(3)]
    status = Comparison("status.outcome", "solved", "infeasible", None, "ours", False)
    told = sentences([missing[0], status, *missing[1:]])
    assert [met for met, _ in told] == [False, False] and "infeasible found" in told[0][1]
    assert told[1][1] == "values.x0, values.x1 and values.x2: nothing found, since the problem is not solved"
    assert sentences([status])[0][1] == status.sentence
