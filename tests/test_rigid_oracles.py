"""Trees of rigid bodies against Pinocchio: poses, body Jacobians, weights.

The numbers come from Pinocchio 4.1 (and agree with a second numpy code to 1e-11); each file says how.
Coordinates of joints with several degrees of freedom are exponential there and here; `quasi_velocity` blocks
use the joint's body twist nu instead, eta = B nu with nu = D(q) qd, so that J_quasi D = J.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots import array
from scipy.spatial.transform import Rotation

from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import JOINTS

REFERENCE = Path(__file__).parent / "reference"
FILES = ["rigid_serial_3R", "rigid_branched_1dof", "rigid_freeflyer_multi"]


@cache
def oracle(name):
    return json.loads((REFERENCE / f"{name}.json").read_text())


@cache
def functions(name):
    """Functions of the tree of a file, its bodies named as there."""
    bodies = oracle(name)["bodies"]
    segments = {}
    for body in bodies:
        keys = {key: body["joint"][key] for key in ("axis", "pitch") if key in body["joint"]}
        segments[body["name"]] = JOINTS[body["joint"]["type"]](
            parent="world" if body["parent"] < 0 else bodies[body["parent"]]["name"],
            placement=placement(np.array(body["T_parent_joint"])),
            body=Body(mass=body["mass"], com=tuple(body["com"]), inertia=tuple(map(tuple, body["I_com"]))),
            **keys,
        )
    return Robot(Description(segments=segments, gravity=tuple(oracle(name)["gravity"]))).functions()


def placement(g):
    rotation = Rotation.from_matrix(g[:3, :3]).as_rotvec()
    return Placement(position=tuple(g[:3, 3].tolist()), rotation=tuple(rotation.tolist()))


def states(name):
    return [(np.array(state["q"]), state["outputs"]) for state in oracle(name)["states"]]


def assert_close(name, value, expected):
    tolerance = oracle(name)["tolerance"]
    np.testing.assert_allclose(value, expected, rtol=tolerance["rel"], atol=tolerance["abs"])


@pytest.mark.parametrize("name", FILES)
def test_the_tree_has_the_coordinates_of_the_file(name):
    assert functions(name).robot.n == oracle(name)["nv"]


@pytest.mark.parametrize("name", FILES)
def test_basis_of_every_joint_is_that_of_the_file(name):
    for piece, body in zip(functions(name).robot.tree.pieces, oracle(name)["bodies"], strict=True):
        np.testing.assert_allclose(np.array(piece.Phi.full()), body["joint"]["B"], rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", FILES)
def test_poses_agree_with_pinocchio(name):
    for q, outputs in states(name):
        for body, expected in zip(oracle(name)["bodies"], outputs["body_pose"], strict=True):
            assert_close(name, array(functions(name).pose(body["name"])(q)), expected)


@pytest.mark.parametrize("name", FILES)
def test_jacobians_in_exponential_coordinates_agree_with_pinocchio(name):
    for q, outputs in states(name):
        expected = outputs["exponential_coordinates"]["J_body"]
        for body, J in zip(oracle(name)["bodies"], expected, strict=True):
            assert_close(name, array(functions(name).jacobian(body["name"])(q)), J)


@pytest.mark.parametrize("name", FILES)
def test_jacobians_of_quasi_velocities_agree_with_pinocchio(name):
    for q, outputs in states(name):
        D = np.array(outputs["exponential_coordinates"]["D"])
        for body, J in zip(oracle(name)["bodies"], outputs["quasi_velocity"]["J_body"], strict=True):
            assert_close(name, array(functions(name).jacobian(body["name"])(q)) @ np.linalg.inv(D), J)


@pytest.mark.parametrize("name", FILES)
def test_body_twists_agree_with_pinocchio(name):
    for state in oracle(name)["states"]:
        for body, expected in zip(oracle(name)["bodies"], state["outputs"]["body_twist"], strict=True):
            J = array(functions(name).jacobian(body["name"])(state["q"]))
            assert_close(name, J @ np.array(state["qd"]), expected)


@pytest.mark.parametrize("name", FILES)
def test_weights_agree_with_pinocchio(name):
    for q, outputs in states(name):
        force = array(functions(name).external_force(q, np.zeros_like(q)))
        assert_close(name, -force, outputs["exponential_coordinates"]["gravity_term"])
        assert_close(name, array(functions(name).energy(q, 0 * np.asarray(q)))[2], outputs["potential_energy"])


@pytest.mark.parametrize("name", FILES)
def test_internal_forces_of_a_rigid_tree_are_its_springs_alone(name):
    for q, _ in states(name):
        assert np.abs(array(functions(name).elastic_force(q))).max() == 0
