"""A sample of the random tip goals of the two-module robot; `benchmarks/reach.py` solves all of them."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
import reach

SAMPLE = range(0, 1000, 50)


@pytest.fixture(scope="module")
def two_modules():
    solver, pose = reach.prepared()
    return solver, pose, np.loadtxt(reach.GOALS, delimiter=",")


def test_drawn_tips_are_solved_from_rest_with_no_more_effort_than_was_drawn(two_modules):
    solver, pose, rows = two_modules
    largest = np.max(np.abs(solver.question.input_limits()), axis=0)
    for k in SAMPLE:
        drawn, tip = rows[k, :6], rows[k, 6:]
        outcome, _ = solver.find({"target.tip": tip})
        assert outcome.status.solved, (k, outcome.status)
        q, u = outcome.values["q"], outcome.values["u"]
        assert np.linalg.norm(np.array(pose(q))[:3, 3] - tip) < 1e-7
        assert solver.look.residuals(q, u, solver.posture.free)["force"].value < 1e-8
        assert np.sum((u / largest) ** 2) <= np.sum((drawn / largest) ** 2) * (1 + 1e-9)


def test_goals_beyond_the_workspace_are_refused_with_a_posture_no_farther_than_its_support(two_modules):
    solver, _, _ = two_modules
    rng, support, length = np.random.default_rng(5), reach.Support(two_modules[0]), two_modules[0].question.robot.length
    for share in (0.02, 0.3, 2.0):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        point = support.point(direction, rng)
        outcome, _ = solver.find({"target.tip": point + share * length * direction})
        assert outcome.status.exit_code == 4
        tip = np.array(support.tip(outcome.values["q"]))[:3, 3]
        assert np.linalg.norm(tip - point - share * length * direction) <= share * length * (1 + 1e-6)
