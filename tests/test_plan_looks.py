"""What is looked at between the points and between the stations, and what a plan's verdict may not depend on."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import socontrol as so
from socontrol.files.yaml_reader import FileError

ROOT = Path(__file__).parents[1] / "configs" / "robots"
SWING = {"end": {"coordinates": {"upper": 1.0, "lower": 0.0}}, "duration": 1.5}


def asked(**keys):
    robot = so.load_robot(ROOT / "double_pendulum.yaml")
    whole = {"type": "trajectory", "robot": robot, "mesh": {"intervals": 8, "halved": False}, **SWING, **keys}
    return so.problem(whole)


def ball(radius, angle=0.5, way=0.5):
    """An obstacle that the upper link sweeps over at an angle."""
    upper = np.array(so.load_robot(ROOT / "double_pendulum.yaml").functions().pose("upper", 1.0)([angle, 0.0]))
    return {"post": {"type": "sphere", "center": (way * upper[:3, 3]).tolist(), "radius": radius}}


def nearest(result, center):
    """Least distance of a point from both links, 400 instants and 300 places each, in numpy."""
    found, robot = [], result.question.robot
    elbow, tip = (robot.functions().pose(name, 1.0) for name in ("upper", "lower"))
    for q in result.arrays["q"][:: max(1, len(result.arrays["q"]) // 400)]:
        ends = [np.zeros(3), *(np.array(pose(q))[:3, 3] for pose in (elbow, tip))]
        for a, b in zip(ends, ends[1:], strict=False):
            line = a + np.linspace(0, 1, 300)[:, None] * (b - a)
            found.append(np.min(np.linalg.norm(line - center, axis=1)))
    return min(found)


@cache
def passing(radius):
    """The plan past a ball."""
    return so.solve(asked(obstacles=ball(radius)))


def test_what_is_stored_does_not_change_the_verdict_on_obstacles():
    rows = passing(0.05), so.solve(asked(obstacles=ball(0.05), outputs={"every": 1.5}))
    assert rows[0].status.outcome == rows[1].status.outcome
    assert rows[0].values["clearance.post"] == rows[1].values["clearance.post"]


@pytest.mark.parametrize("radius", [0.015, 0.05])
def test_a_link_does_not_pass_through_a_small_ball(radius):
    result = passing(radius)
    allowed = radius - 2e-3 * result.question.robot.length
    assert not result.status.solved or nearest(result, ball(radius)["post"]["center"]) > allowed


def test_a_weighted_direction_is_not_met_by_its_opposite():
    """From a guess that ends near the opposite, the last link turns round."""
    goal = {"type": "axis", "on": "lower", "target": [0, 0, 1], "weight": 1e3}
    opposite = {"times": [0, 1.5], "coordinates": {"upper": [0, 0], "lower": [0, -1.4]}}
    result = so.solve(asked(end={"goals": {"up": goal}}, guess=opposite))
    along = np.array(result.question.robot.functions().pose("lower", 1.0)(result.arrays["q"][-1]))[:3, 0]
    assert along[2] > 0.9


def test_inputs_of_single_points_that_may_jump_are_constant_between_nodes():
    result = so.solve(asked(mesh={"intervals": 6, "scheme": "radau", "points": 1, "halved": False},
                            costs={"least": {"type": "effort"}}))  # fmt: skip
    assert result.question.input_shape == "constant"
    nodes, t, u = result.arrays["node.t"], result.arrays["t"], result.arrays["u"]
    for a, b in zip(nodes, nodes[1:], strict=False):
        inside = u[(t > a + 1e-9) & (t < b - 1e-9)]
        np.testing.assert_allclose(inside, np.broadcast_to(inside[0], inside.shape), atol=1e-9)


def test_a_goal_that_no_equilibrium_meets_is_said_to_be_one():
    result = so.solve(asked(end={"goals": {"tip": {"type": "point", "on": "lower", "target": [5.0, None, 0.0]}}}))
    assert result.status.exit_code == 4
    assert "No equilibrium was found that meets the goals of: end" in result.status.message


@pytest.mark.parametrize("keys, where", [
    ({"waypoints": {"a": {"time": 1e-6, "coordinates": {"upper": 0.0}}}}, "waypoints.a: less than 0.001"),
    ({"guess": {"starts": 2, "seed": -1}}, "guess.seed: -1 is negative"),
    ({"discretisation": True}, "discretisation: a plan has `mesh.halved`"),
])  # fmt: skip
def test_what_a_plan_cannot_do_is_refused_in_one_line(keys, where):
    with pytest.raises(FileError, match=where.replace(".", r"\.")):
        asked(**keys)
