"""The README's loop of computed torque with PD, taken from the README itself, on a rigid, a soft and a hybrid robot.

With u from inverse dynamics the error obeys e'' + 40 e' + 400 e = 0, whatever the robot: a double pole at -20 1/s. From
e(0) = e0, e'(0) = 0 it is e0 (1 + 20 t) exp(-20 t): 0.7358 e0 after 0.05 s, 9e-4 e0 after 0.5 s.
"""

import re
from pathlib import Path

import numpy as np
import pytest

import socontrol as so

README = (Path(__file__).parent.parent / "README.md").read_text()
BODY = {"mass": 0.5, "com": [0.1, 0, 0], "inertia": [1e-3, 2e-3, 2e-3]}
LINK = {"axis": [0, 1, 0], "body": BODY, "tip": {"position": [0.3, 0, 0]}, "damping": 0.05}
ROD = {"type": "rod", "length": 0.2, "strains": ["bend_y", "bend_z"], "sections": 1,
       "cross_section": {"type": "circle", "radius": 0.01},
       "material": {"type": "linear", "young_modulus": 1e5, "poisson_ratio": 0.5, "density": 1000,
                    "viscosity": 100}}  # fmt: skip


def motor(joint):
    return {"type": "joint_torque", "joint": joint}


def muscle(rod, strain):
    return {"type": "internal_moment", "along": [rod], "strain": strain}


ROBOTS = {
    "rigid": (
        {"upper": {"type": "revolute", **LINK}, "lower": {"type": "revolute", "parent": "upper", **LINK}},
        {"m0": motor("upper"), "m1": motor("lower")},
    ),
    "soft": ({"rod": ROD}, {"y": muscle("rod", "bend_y"), "z": muscle("rod", "bend_z")}),
    "hybrid": (
        {"arm": {"type": "revolute", **LINK}, "rod": {"parent": "arm", **ROD}},
        {"m": motor("arm"), "y": muscle("rod", "bend_y"), "z": muscle("rod", "bend_z")},
    ),
}


def track():
    """The function printed in the README."""
    text = next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "def track" in block)
    names = {"np": np}
    exec(text, names)
    return names["track"]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_loop_of_the_readme_tracks(name):
    segments, actuators = ROBOTS[name]
    robot = so.robot({"segments": segments, "actuators": actuators})
    scale = np.array([1.0 if unit == "rad" else 3.0 for unit in robot.coordinate_units])

    def q_of(t):
        return scale * np.cos(2 * t), -2 * scale * np.sin(2 * t), -4 * scale * np.cos(2 * t)

    errors, h = np.array(track()(robot, q_of, stop=0.5)), 1e-3
    t = h * np.arange(1, errors.size + 1)
    closed = 0.1 * scale.max() * (1 + 20 * t) * np.exp(-20 * t)
    assert np.max(np.abs(errors - closed)) < 0.03 * closed[0]  # first-order steps of 1 ms at 20 1/s: 20 h and more
    assert errors[-1] < 0.02 * errors[0]
