"""What an answer is called: solved only what was verified, out of reach only what is not met, limits by their side."""

import numpy as np
import pytest

import socontrol as so
from socontrol.files.loader import FileError

ARM = {
    "gravity": [0, 0, 0],
    "segments": {
        "arm": {
            "type": "rod",
            "length": "250 mm",
            "sections": 2,
            "cross_section": {"type": "circle", "radius": "10 mm"},
            "material": {"type": "linear", "young_modulus": "110 kPa", "poisson_ratio": 0.5, "density": 1080},
        }
    },
    "actuators": {
        f"t{k}": {
            "type": "tendon",
            "along": ["arm"],
            "offset": [8e-3 * np.cos(angle), 8e-3 * np.sin(angle)],
            "limits": [0, "4 N"],
        }
        for k, angle in enumerate((0, 2.1, 4.2))
    },
}


def ask(robot=ARM, kind="inverse_statics", **keys):
    return so.solve(so.problem({"type": kind, "robot": robot, "discretisation": False, **keys}))


def point(*target, **keys):
    return {"type": "point", "on": "arm", "target": list(target), **keys}


def tip_axis(result):
    return np.array(result.question.robot.functions().pose("arm")(result.arrays["q"]))[:3, 0]


def test_an_axis_that_points_the_opposite_way_has_not_met_its_goal():
    result = ask(goals={"a": {"type": "axis", "on": "arm", "target": [-1, 0, 0]}})
    cosine = float(tip_axis(result) @ [-1, 0, 0])
    assert result.status.solved == (cosine > 1 - 1e-9)
    assert result.residuals["goals.a"].value == pytest.approx(np.arccos(np.clip(cosine, -1, 1)), abs=1e-6)


def test_the_miss_of_an_axis_out_of_reach_is_the_angle_between_the_directions():
    weak = {**ARM, "actuators": {"t0": {**ARM["actuators"]["t0"], "limits": [0, "0.2 N"]}}}
    result = ask(weak, goals={"a": {"type": "axis", "on": "arm", "target": [0, -1, 0]}})
    assert result.status.exit_code == 4
    assert result.residuals["goals.a"].value == pytest.approx(np.arccos(tip_axis(result) @ [0, -1, 0]), abs=1e-9)


def test_redundant_goals_that_are_met_are_solved():
    result = ask(goals={"a": point(0.2, 0.05, 0), "b": point(0.2, 0.05, 0)})
    assert result.status.solved
    assert max(result.residuals["goals.a"].value, result.residuals["goals.b"].value) < 1e-7


def test_more_numbers_asked_than_inputs_free_are_counted_in_the_sentence():
    pose = {"type": "pose", "on": "arm", "target": {"position": [0.2, 0.05, 0], "rotation": [0, 0, 0.5]}}
    result = ask(goals={"a": pose})
    assert result.status.exit_code == 4
    assert "6 numbers and 3 inputs" in result.status.message


def test_every_waypoint_of_a_path_is_looked_at():
    coarse = {**ARM["segments"]["arm"], "quadrature": 1, "placement": {"rotation": [0, "90 deg", 0]}}
    hanging = {**ARM, "gravity": [0, 0, -9.81], "segments": {"arm": coarse}}
    targets = [[0.02, 0, -0.23], [0.03, 0, -0.23], [0.04, 0, -0.23]]
    result = ask(hanging, goals={"p": {"type": "path", "on": "arm", "target": targets}})
    assert result.status.outcome == "rejected"
    assert result.status.message.startswith("Waypoint 1 of 3")


def test_a_force_free_rod_rests_in_its_precurved_shape():
    bent = {**ARM, "segments": {"arm": {**ARM["segments"]["arm"], "rest": {"bend_y": 5, "bend_z": 1.1}}}}
    result = ask(bent, "statics")
    assert result.status.solved
    assert result.arrays["q"][[1, 2]] == pytest.approx([5, 1.1], abs=1e-12)


def test_a_given_input_past_its_limit_is_named_in_statics_and_refused_where_limits_rule():
    result = ask(kind="statics", inputs={"t0": "5 N"})
    assert "Beyond its limits: t0" in result.status.message
    row = next(row for row in result.details["limits"] if row["name"] == "t0")
    assert row["beyond"] == pytest.approx(1.0)
    with pytest.raises(FileError, match="inputs.t0: .*outside its limits"):
        ask(goals={"a": point(0.2, 0.05, 0)}, inputs={"t0": "-3 N"})


def test_the_nearest_posture_does_not_listen_to_weighted_goals():
    far = point(0.0, 0.2, 0.3)
    alone = ask(goals={"far": far})
    beside = ask(goals={"far": far, "soft": {**point(0.25, 0, 0, weight=100), "at": 0.5}})
    assert alone.status.exit_code == beside.status.exit_code == 4
    assert beside.residuals["goals.far"].value == pytest.approx(alone.residuals["goals.far"].value, rel=1e-4)


def test_where_the_base_stands_does_not_change_the_answer():
    moved = {**ARM, "segments": {"arm": {**ARM["segments"]["arm"], "placement": {"position": [100, 0, 0]}}}}
    here = ask(goals={"a": {**point(0.15, 0.1, 0.05), "weight": 50}})
    there = ask(moved, goals={"a": {**point(100.15, 0.1, 0.05), "weight": 50}})
    assert there.arrays["u"] == pytest.approx(here.arrays["u"], abs=1e-7)


def test_a_frictionless_pendulum_hangs():
    body = {"mass": 0.1, "com": [0.1, 0, 0], "inertia": [1e-3, 1e-3, 1e-3]}
    result = ask({"segments": {"j": {"type": "revolute", "axis": [0, 1, 0], "body": body}}}, "statics")
    assert result.status.solved
    assert result.arrays["q"] == pytest.approx([np.pi / 2], abs=1e-9)
