"""Speeds of statics, on one core: `pytest tests/benchmarks/test_speed.py -p no:xdist --benchmark-only`.

Figures in parentheses are the goals of this project or a peer's published one; nothing here fails on time.
"""

import time

import casadi as ca
import numpy as np
import pytest
import reach
import reference_rod

from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.programs.balance import Balance
from socontrol.programs.goals import Path
from socontrol.programs.inverse_statics import InverseStatics


@pytest.fixture(scope="module")
def two_modules():
    solver, pose = reach.prepared()
    rows = np.loadtxt(reach.GOALS, delimiter=",")[:50]
    solver.find({"target.tip": rows[0, -3:]})
    return solver, pose, rows[:, -3:]


def calibration():
    """Nanoseconds an SX multiply-add takes in the VM today (2.5-4 on the prototype's machine)."""
    x = ca.SX.sym("x")
    y = x
    for _ in range(50_000):
        y = y * x + x
    f = ca.Function("f", [x], [y])
    f(0.5)
    began = time.perf_counter()
    for _ in range(20):
        f(0.5)
    return (time.perf_counter() - began) / 20 / 1e5 * 1e9


@pytest.fixture(scope="module", autouse=True)
def _calibrated():
    print(f"\ncalibration: {calibration():.2f} ns an instruction in the VM")


def test_build(benchmark):
    """Build of the two-module inverse-statics program (at most 0.4 s; prototype 0.35 s)."""
    robot = reach.so.load_robot(reach.ROBOT)

    def build():
        return reach.prepared(robot)[0].posture.exact

    build()

    benchmark.pedantic(build, rounds=5)


def test_cold(benchmark, two_modules):
    """Tip goal from rest (at most 16 ms; prototype 18 ms)."""
    solver, _, tips = two_modules
    goals = iter(np.tile(tips, (4, 1)))
    benchmark.pedantic(lambda: solver.find({"target.tip": next(goals)}), rounds=100)


def test_from_a_neighbour(benchmark, two_modules):
    """Tip goal 1 mm from a solved one (at most 8 ms; prototype 10 ms)."""
    solver, _, tips = two_modules
    rng = np.random.default_rng(0)
    solved = [(tip, solver.find({"target.tip": tip})[0]) for tip in tips]
    rows = iter(solved * 2)

    def once():
        tip, warm = next(rows)
        step = rng.normal(size=3)
        solver.find({"target.tip": tip + 1e-3 * step / np.linalg.norm(step)}, warm=warm)

    benchmark.pedantic(once, rounds=100)


def test_hundred_waypoints(benchmark):
    """A path of 100 waypoints (at most 0.9 s)."""
    robot = reach.so.load_robot(reach.ROBOT)
    z = robot.length + 0.008  # mid-range pressures lengthen the modules
    angles = 2 * np.pi * np.arange(100) / 100
    points = tuple((0.015 * np.cos(a), 0.015 * np.sin(a), z) for a in angles)
    question = InverseStatics(robot=robot, goals={"tip": Path(on="cap", target=points)}, discretisation=False)
    solver = question.prepare()
    solver.solve().require()
    benchmark.pedantic(solver.solve, rounds=3)


def test_forward_statics_after_a_load_change(benchmark):
    """Balance re-solved after 10 % more load, 12 coordinates (at most 0.7 ms; SoRoSim publishes 32 ms for 5-12)."""
    rod = reference_rod.robot(2)
    loads = {"tip": Wrench(on="rod", force=(0.0, 0.0, -0.05))}
    balance = Balance(Robot(Description(segments=rod.description.segments, loads=loads)), ("loads.tip.force",))
    q = balance.solve([]).q
    heavier = np.array([0.0, 0.0, -0.055])
    assert balance.solve([], q, heavier).status.solved
    benchmark(lambda: balance.solve([], q, heavier))


@pytest.mark.parametrize("sections", reference_rod.PROTOTYPE_US)
def test_static_residual_and_jacobian(benchmark, sections):
    """Static residual with exact Jacobian in the VM (at most 1.1 of the prototype's 38, 98, 235, 621 us)."""
    balance = Balance(reference_rod.robot(sections))
    q = np.random.default_rng(0).normal(size=balance.robot.n) * 0.3
    balance._q[:] = q
    benchmark.extra_info["prototype_us"] = reference_rod.PROTOTYPE_US[sections]
    benchmark.extra_info["instructions"] = balance.function.n_instructions()
    benchmark(balance._run)
