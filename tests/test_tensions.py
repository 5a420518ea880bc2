"""Tensions that hold postures: symmetries, slack, best fits, limits by name, and what a file may ask.

Arms are small and in the air: three cables 120 deg apart, or pairs opposite to each other, on a rod without twist.
"""

import copy
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import socontrol as so
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.words import pretty
from socontrol.quantities import Bad

LENGTH, LIMIT = 0.25, 2.0
THIRD = np.radians(120)


def tendon(angle, radius=8e-3, **keys):
    """A converging cable at an angle round the arm."""
    start = [radius * np.cos(angle), radius * np.sin(angle)]
    return {"type": "tendon", "along": ["arm"], "offset": {"start": start, "end": [x / 4 for x in start]},
            "limits": [0, LIMIT], **keys}  # fmt: skip


def arm(actuators, **keys):
    """An inextensible tapered arm along world x, in weightlessness unless `gravity` is given."""
    sections = {"start": {"type": "circle", "radius": 0.01}, "end": {"type": "circle", "radius": 0.004}}
    rod = {"type": "rod", "length": LENGTH, "strains": "inextensible_kirchhoff_love", "sections": 3,
           "cross_section": sections,
           "material": {"type": "linear", "young_modulus": 1.1e5, "poisson_ratio": 0, "density": 1080}}  # fmt: skip
    return {"name": "arm", "gravity": [0, 0, 0], "segments": {"arm": rod}, "actuators": actuators, **keys}


def three(**keys):
    return arm({f"c{k}": tendon(np.pi / 2 + k * THIRD) for k in range(3)}, **keys)


def asked(robot, goals, **keys):
    return so.problem({"type": "tensions", "robot": robot, "goals": goals, "discretisation": False, **keys})


def tip(*target):
    return {"tip": {"type": "point", "on": "arm", "target": list(target)}}


def place(robot, u):
    """Tip of the equilibrium at tensions u."""
    robot = so.robot(robot)
    answer = Balance(robot).solve(np.array(u, dtype=float))
    assert answer.status.solved
    return np.array(robot.functions().pose("arm", 1.0)(answer.q))[:3, 3]


# Symmetries

def test_a_turn_of_the_target_by_a_third_permutes_the_tensions():
    target = np.array([0.0, 0.03, 0.06])
    tensions = []
    for k in range(3):
        y, z = Rotation.from_rotvec([k * THIRD, 0, 0]).apply(target)[1:]
        result = asked(three(), tip(None, float(y), float(z))).solve().require()
        tensions.append(result.arrays["u"])
    for k in range(3):
        np.testing.assert_allclose(np.roll(tensions[0], k), tensions[k], rtol=0, atol=1e-8 * LIMIT)
    assert np.ptp(tensions[0]) > 0.05  # or a permutation would say nothing


def test_a_mirrored_target_has_mirrored_tensions_under_weight():
    robot = three(gravity=[0, 0, -1.0])
    left, right = (asked(robot, tip(None, y, 0.05)).solve().require().arrays["u"] for y in (0.03, -0.03))
    np.testing.assert_allclose(right, left[[0, 2, 1]], rtol=0, atol=1e-8 * LIMIT)
    middle = asked(robot, tip(None, 0.0, 0.05)).solve().require().arrays["u"]
    assert abs(middle[1] - middle[2]) < 1e-8 * LIMIT and not np.isclose(left[1], left[2], atol=1e-3)


@pytest.mark.parametrize("angles", [(0, np.pi), (0.7, 0.7 + np.pi), (np.pi / 2, np.pi / 2 + THIRD, np.pi / 2 - THIRD)])
@pytest.mark.parametrize("tension", [0.1, 1.0, 5.0])
def test_equal_tensions_of_a_symmetric_set_leave_a_straight_inextensible_arm_straight(angles, tension):
    robot = so.robot(arm({f"c{k}": tendon(angle, limits=[0, 10]) for k, angle in enumerate(angles)}))
    force = robot.functions().static_residual(np.zeros(robot.n), np.full(robot.m, tension))
    assert np.max(np.abs(np.array(force))) < 1e-15
    alone = robot.functions().static_residual(np.zeros(robot.n), tension * np.eye(robot.m)[0])
    assert np.max(np.abs(np.array(alone))) > 1e-5 * tension


# Cables pull only

def test_cables_without_limits_do_not_push():
    robot = arm({name: tendon(angle) for name, angle in (("up", np.pi / 2), ("down", -np.pi / 2))})
    for actuator in robot["actuators"].values():
        del actuator["limits"]
    result = asked(robot, tip(None, None, 0.06)).solve().require()
    up, down = result.arrays["u"]
    assert up > 0.01 and 0 <= down < 1e-8
    assert so.robot(robot).input_limits[1][0] == -np.inf  # the file says nothing: the type of the problem does


def test_limits_below_zero_are_cut_and_what_is_left_must_hold_something():
    robot = three()
    robot["actuators"]["c1"]["limits"] = [-1, 1]
    lower, upper = asked(robot, tip(None, None, 0.05)).input_limits()
    assert list(lower) == [0, 0, 0] and list(upper) == [2, 1, 2]
    robot["actuators"]["c1"]["limits"] = [-2, -1]
    with pytest.raises((Bad, so.FileError), match="a cable only pulls"):
        asked(robot, tip(None, None, 0.05))


# Best fits

def test_the_best_fit_of_a_shape_is_least_by_statics_solved_again_and_its_remainder_is_named():
    """Where tensions are between their limits the cost is stationary; a slack cable would add to it."""
    robot = three()
    points = [{"at": X, "position": [X * LENGTH * 0.9, 0.02 * X, 0.2 * X**2 * LENGTH]} for X in (0.4, 0.7, 1.0)]
    shape = {"line": {"type": "shape", "on": "arm", "target": points, "weight": 1}}
    weight = 1e-2
    result = asked(robot, shape, costs={"effort": {"type": "effort", "weight": weight}}).solve().require()
    model = so.robot(robot)
    balance, poses = Balance(model), [model.functions().pose("arm", p["at"]).function for p in points]
    u, near = result.arrays["u"], result.arrays["q"]

    def misses(u):
        q = balance.solve(u, near).q
        return np.array([np.array(g(q))[:3, 3] - p["position"] for g, p in zip(poses, points, strict=True)])

    def cost(u):
        return np.sum(misses(u) ** 2) / LENGTH**2 / 2 + weight * np.sum((u / LIMIT) ** 2) / 2

    def slope(e):
        return (8 * (cost(u + e) - cost(u - e)) - cost(u + 2 * e) + cost(u - 2 * e)) / 12 / np.max(e)

    slopes, pulls = np.array([slope(e) for e in 1e-3 * np.eye(3)]), u > 1e-6
    assert pulls.any() and np.all(u < LIMIT - 1e-3)
    effort = weight * np.max(u) / LIMIT**2  # slope of one of the two parts that cancel
    assert np.max(np.abs(slopes[pulls])) < 1e-4 * effort and np.all(slopes[~pulls] > 1e-2 * effort)
    assert all(min(cost(u + e), cost(u - e)) > cost(u) for e in 1e-2 * np.eye(3)[pulls])
    left = np.linalg.norm(misses(u), axis=1)
    assert result.residuals["goals.line"].value == pytest.approx(np.linalg.norm(left), rel=1e-6)
    k = int(np.argmax(left))
    told = f"line missed by {pretty(np.linalg.norm(left), 'm')} in all, at most by {pretty(left[k], 'm')}"
    assert f"{told} at X = {points[k]['at']:g}" in result.status.message


def test_a_curvature_of_a_uniform_arm_is_held_by_the_tension_of_the_closed_form():
    """One cable at offset d on an inextensible rod: kappa = T d / (E J)."""
    robot = arm({"up": {"type": "tendon", "along": ["arm"], "offset": [6e-3, 0], "limits": [0, LIMIT]}})
    robot["segments"]["arm"]["cross_section"] = {"type": "circle", "radius": 0.01}
    goal = {"bend": {"type": "curvature", "on": "arm", "target": [{"at": 0.5, "bend_z": 4.0}]}}
    result = asked(robot, goal).solve().require()
    assert result["inputs.up"] == pytest.approx(4.0 * 1.1e5 * np.pi * 0.01**4 / 4 / 6e-3, rel=1e-9)


@pytest.mark.parametrize(("goal", "told"), [
    ({"target": [{"at": 0.5, "stretch": 1}]}, "stretch"),
    ({"target": [{"at": 0.5}]}, "no strain is given"),
    ({"target": []}, "no point is given"),
    ({"target": [{"at": 0.5, "twist": 1}]}, "held straight in twist; it has bend_y and bend_z"),
])  # fmt: skip
def test_a_curvature_that_cannot_be_asked_for_is_refused(goal, told):
    robot = three()
    robot["segments"]["arm"]["strains"] = "inextensible_constant_curvature"
    with pytest.raises((Bad, so.FileError), match=told):
        asked(robot, {"bend": {"type": "curvature", "on": "arm", **goal}}).solve()


# Limits by name

def test_a_small_limit_is_named_with_the_tension_the_cable_would_need():
    """The tension said is enough, and 2 % less of the gap is not."""
    wanted = place(three(), [0.3, 0.0, 0.1])
    goal = tip(None, float(wanted[1]), float(wanted[2]))

    def limited(limit):
        robot = copy.deepcopy(three())
        robot["actuators"]["c0"]["limits"] = [0, limit]
        return asked(robot, goal, solver={"type": "ipopt", "starts": 0}).solve()

    result = limited(0.2)
    assert result.status.exit_code == 4
    found = re.search(r"c0 would need ([\d.]+) N, its limit is 0.2 N", result.status.message)
    needed = float(found[1])
    assert limited(needed * 1.001).status.solved
    assert limited(0.2 + 0.98 * (needed - 0.2)).status.exit_code == 4


def test_two_small_limits_are_named_together():
    wanted = place(three(), [0.3, 0.0, 0.25])
    robot = three()
    for name in ("c0", "c2"):
        robot["actuators"][name]["limits"] = [0, 0.15]
    goal = tip(None, float(wanted[1]), float(wanted[2]))
    result = asked(robot, goal, solver={"type": "ipopt", "starts": 0}).solve()
    assert result.status.exit_code == 4
    together = result.details["together"]
    assert set(together) == {"c0", "c2"}
    for name, needed in together.items():
        assert f"{name} would need {pretty(needed, 'N')}, its limit is 0.15 N" in result.status.message
        robot["actuators"][name]["limits"] = [0, needed * 1.001]
    assert asked(robot, goal).solve().status.solved


def test_limits_of_the_problem_are_quoted_and_motors_that_push_are_no_cables():
    """A slide that pushes at most 0.1 N against a spring of 10 N/m, told to go to -20 mm and to 20 mm."""
    slide = {"type": "prismatic", "stiffness": 10.0, "body": {"mass": 0.1}}
    robot = {"gravity": [0, 0, 0], "segments": {"arm": slide},
             "actuators": {"m": {"type": "joint_torque", "joint": "arm", "limits": ["0 N", "1 N"]}}}  # fmt: skip
    keys = {"bounds": {"inputs": {"m": [0, 0.1]}}, "solver": {"type": "ipopt", "starts": 0}}
    back = asked(robot, tip(-0.02, None, None), **keys).solve()
    assert "m is at its lower limit 0 N: alone it would have to be -0.2 N" in back.status.message
    ahead = asked(robot, tip(0.02, None, None), **keys).solve()
    assert "m is at its upper limit 0.1 N: alone it would have to be 0.2 N" in ahead.status.message


# Lengths as conditions

def test_lengths_of_an_answer_given_as_conditions_give_its_tensions_back():
    """Two coordinates and one length leave no choice on an arm that pulling shortens: effort decides nothing."""
    u, soft = [0.2, 0.05, 0.1], three()
    soft["segments"]["arm"]["strains"] = "kirchhoff_love"
    wanted, robot = place(soft, u), so.robot(soft)
    q = Balance(robot).solve(np.array(u)).q
    lengths = np.array(robot.functions().actuator_lengths(q)).ravel()
    goal = tip(None, float(wanted[1]), float(wanted[2]))
    result = asked(soft, goal, lengths={"c1": float(lengths[1])}).solve().require()
    np.testing.assert_allclose(result.arrays["u"], u, rtol=0, atol=1e-5)
    least = asked(soft, goal).solve().require()
    assert abs(least.arrays["u"][1]) < 1e-6 and least["lengths.c1"] != pytest.approx(lengths[1], abs=1e-6)


def test_a_length_that_cannot_be_held_beside_the_goal_is_out_of_reach():
    keys = {"solver": {"type": "ipopt", "starts": 0}}
    result = asked(three(), tip(None, 0.0, 0.03), lengths={"c0": 0.2}, **keys).solve()
    assert result.status.exit_code == 4
    assert result.values["short.tip"].value > 1e-3 or result.values["short.lengths.c0"].value > 1e-3


def test_what_no_tension_holds_is_said():
    result = asked(three(), tip(0.4, None, None), solver={"type": "ipopt", "starts": 0}).solve()
    assert result.status.exit_code == 4
    assert result.values["short.tip"].value == pytest.approx(0.4 - LENGTH, abs=1e-6)


# Keys

CIRCLE = {"trip": {"type": "path", "on": "arm", "target": {"center": [0.2, 0, 0], "radius": 0.02, "normal": [1, 0, 0],
                                                            "start": [0, 1, 0], "count": 4}}}  # fmt: skip


@pytest.mark.parametrize(("goals", "keys", "told"), [
    (tip(None, 0.01, None), {"timing": {"duration": 1}}, "timing: it belongs to a path"),
    (tip(None, 0.01, None), {"together": True}, "together: it belongs to a path"),
    (tip(None, 0.01, None), {"limits": {"input_rates": {"c0": 1}}}, "limits: it belongs to a path"),
    (CIRCLE, {"compliance": {"on": "arm", "axis": [0, 0, 1]}}, "compliance: it is asked of a posture"),
    (CIRCLE, {"smoothness": 1.0}, "smoothness: it needs `together: true`"),
    (CIRCLE, {"smoothness": -1.0, "together": True}, "smoothness: -1 is negative"),
    (CIRCLE, {"motion": {"every": 0.01}}, "timing: missing key 'timing'"),
    (CIRCLE, {"timing": {"duration": 1, "ramp": 0.6}}, r"timing.ramp: 0.6 s is given; from 0 to half the duration"),
    ({}, {}, "goals: no goal is given"),
])  # fmt: skip
def test_keys_of_another_kind_are_refused_by_name(goals, keys, told):
    with pytest.raises((Bad, so.FileError), match=told):
        asked(three(), goals, **keys)


def test_a_robot_without_actuators_is_refused():
    with pytest.raises((Bad, so.FileError), match="no actuators"):
        asked(arm({}), tip(None, 0.01, None))
