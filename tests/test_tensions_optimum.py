"""Least tension is least: answers are held against active sets tried one by one, and against statics solved again."""

import itertools
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

import socontrol as so
from socontrol.programs.equilibria.balance import Balance

ROOT = Path(__file__).parent.parent
LIMIT = 0.265  # N


def active_sets(B, f, limit):
    """The least |T| with B T = f and 0 <= T <= limit: every choice of tensions at 0, at the limit and between."""
    found = []
    for choice in itertools.product((0.0, None, limit), repeat=B.shape[1]):
        T = np.array([0.0 if x is None else x for x in choice])
        free = np.array([x is None for x in choice])
        T[free] = np.linalg.lstsq(B[:, free], f - B @ T, rcond=None)[0]
        inside = np.all((T >= -1e-12) & (limit + 1e-12 >= T))
        if inside and np.allclose(B @ T, f, atol=1e-12 * np.abs(B).max()):
            found.append(T)
    return min(found, key=np.linalg.norm)


def test_six_parallel_cables_share_a_bend_as_the_least_of_all_active_sets_has_it():
    """An arc of two curvatures: the tip fixes the shape, B(q) T = f(q) is left, and 3^6 active sets are few."""
    angles, radii = np.radians(10 + 60 * np.arange(6)), 8e-3 * np.array([1, 0.8, 1.1, 0.9, 1, 0.7])
    cables = {
        f"c{k}": {"type": "tendon", "along": ["arm"], "offset": [r * np.cos(a), r * np.sin(a)], "limits": [0, LIMIT]}
        for k, (a, r) in enumerate(zip(angles, radii, strict=True))
    }
    rod = {"type": "rod", "length": 0.25, "strains": "inextensible_constant_curvature", "sections": 1,
           "cross_section": {"type": "circle", "radius": 0.01},
           "material": {"type": "linear", "young_modulus": 1.1e5, "poisson_ratio": 0, "density": 1080}}  # fmt: skip
    robot = {"name": "arc", "gravity": [0, 0, -0.5], "segments": {"arm": rod}, "actuators": cables}
    goal = {"type": "point", "on": "arm", "target": [None, 0.06, 0.04]}
    result = so.solve(so.problem({"type": "tensions", "robot": robot, "goals": {"tip": goal}})).require()
    q, T, f = result.arrays["q"], result.arrays["u"], so.robot(robot).functions()
    B, passive = np.array(f.actuation(q)), np.array(f.static_residual(q, np.zeros(6))).ravel()
    expected = active_sets(B, passive, LIMIT)
    assert np.max(expected) == LIMIT and np.min(expected) == 0.0  # limits matter here
    assert np.allclose(T, expected, atol=1e-7)


def test_six_cables_of_an_arm_meet_the_conditions_of_an_optimum_by_statics_solved_again():
    """Along every change of tensions that keeps the goal the effort is stationary, and slack cables would add to it."""
    octopus = YAML(typ="safe").load((ROOT / "configs" / "robots" / "octopus_arm.yaml").read_text())
    octopus["segments"]["arm"]["sections"] = 2  # the short cables end between them
    goal = {"type": "point", "on": "arm", "target": [None, 0.08, 0.05]}
    tight = {"type": "ipopt", "tolerance": 1e-12, "options": {"compl_inf_tol": 1e-12}}
    asked = {"type": "tensions", "robot": octopus, "goals": {"tip": goal}, "solver": tight, "discretisation": False}
    question = so.problem(asked)
    result = so.solve(question).require()
    q, T, robot = result.arrays["q"], result.arrays["u"], question.robot
    balance, pose = Balance(robot), robot.functions().pose("arm", 1.0).function

    def tip(T):
        return np.array(pose(balance.solve(T, q).q))[1:3, 3]

    def slope(e):
        return (8 * (tip(T + e) - tip(T - e)) - (tip(T + 2 * e) - tip(T - 2 * e))) / 12 / np.max(e)

    slopes = np.array([slope(e) for e in 3e-4 * np.eye(6)])
    pulls = T > 1e-6
    assert 2 < pulls.sum() < 6  # more cables than goals pull, and some are slack
    prices, *_ = np.linalg.lstsq(slopes[pulls], T[pulls], rcond=None)
    missing = T - slopes @ prices
    assert np.max(np.abs(missing[pulls])) < 1e-7 * np.max(T)
    assert np.all(missing[~pulls] > 1e-3 * np.max(T))
