"""Speeds of statics and dynamics, on one core: `pytest tests/benchmarks/test_speed.py -p no:xdist --benchmark-only`.

Figures in parentheses are the goals of this project or a peer's published one; nothing here fails on time.
"""

import time

import numpy as np
import pytest
import reach
import reference_rod
from dynamics_scaling import (
    PROTOTYPE_INSTRUCTIONS,
    PROTOTYPE_NS,
    PROTOTYPE_US,
    arguments,
    buffered,
    calibration,
    clocked,
)

from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.postures.goals import Path
from socontrol.programs.postures.inverse_statics import InverseStatics


@pytest.fixture(scope="module", params=[False, True], ids=["vm", "compiled"])
def two_modules(request):
    robot = reach.so.load_robot(reach.ROBOT)
    solver, pose = reach.prepared(robot.in_c() if request.param else robot)
    rows = np.loadtxt(reach.GOALS, delimiter=",")[:50]
    solver.find({"target.tip": rows[0, -3:]})
    return solver, pose, rows[:, -3:]


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
    """Tip goal from rest (at most 16 ms; prototype 18 ms); compiled a fifth less, the rest is Ipopt's own."""
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


@pytest.mark.parametrize("compiled", [False, True], ids=["vm", "compiled"])
def test_forward_statics_after_a_load_change(benchmark, compiled):
    """Balance re-solved after 10 % more load, 12 coordinates (at most 0.7 ms, compiled 0.3 ms; SoRoSim publishes 32 ms
    for 5 to 12)."""
    rod = reference_rod.robot(2)
    loads = {"tip": Wrench(on="rod", force=(0.0, 0.0, -0.05))}
    robot = Robot(Description(segments=rod.description.segments, loads=loads), compiled=compiled)
    balance = Balance(robot, ("loads.tip.force",))
    q = balance.solve([]).q
    heavier = np.array([0.0, 0.0, -0.055])
    assert balance.solve([], q, heavier).status.solved
    benchmark(lambda: balance.solve([], q, heavier))


@pytest.mark.parametrize("name", ["mass", "energy", "motion_tangents"])
def test_a_compiled_call(benchmark, name):
    """A compiled Function of one section with arrays (at most 5 us more than its C, which `run_us` says)."""
    function = getattr(reference_rod.robot(1).functions(compiled=True), name)
    values = [np.full(function.numel_in(i), 0.1) for i in range(function.n_in())]
    function(*values)
    buffers = function.buffered()
    buffers(*values)
    benchmark.extra_info["run_us"] = round(clocked(buffers.run) * 1e6, 2)
    benchmark(lambda: function(*values))


@pytest.mark.parametrize("sections", reference_rod.PROTOTYPE_US)
def test_static_residual_and_jacobian(benchmark, sections):
    """Static residual with exact Jacobian in the VM (at most 1.1 of the prototype's 38, 98, 235, 621 us)."""
    balance = Balance(reference_rod.robot(sections))
    q = np.random.default_rng(0).normal(size=balance.robot.n) * 0.3
    balance._q[:] = q
    benchmark.extra_info["prototype_us"] = reference_rod.PROTOTYPE_US[sections]
    benchmark.extra_info["instructions"] = balance.function.n_instructions()
    benchmark(balance._run)


@pytest.fixture(scope="module")
def dynamics_table(request):
    """Collects (name, sections, instructions, seconds, calibration ns), and prints them at the end."""
    rows = []
    yield rows
    if not rows:
        return
    capture = request.config.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():  # a table is for reading, not for failures only
        heads = f"{'N':>4s}{'instructions':>14s}{'prototype':>11s}{'us':>9s}{'prototype':>11s}"
        print(f"\n\n{'dynamics in the VM':18s}{heads}{'us / ns':>9s}{'prototype':>17s}{'ns today':>10s}")
        for row in rows:
            print(_line(*row))
        low, high = PROTOTYPE_NS
        print(f"us / ns: time over calibration, in thousands of its instructions; prototype: {low:g} to {high:g} ns")


def _line(name, sections, instructions, seconds, ns):
    us, size = PROTOTYPE_US[name][sections], PROTOTYPE_INSTRUCTIONS.get(name, {}).get(sections, "-")
    relative = f"{us / PROTOTYPE_NS[1]:.1f} to {us / PROTOTYPE_NS[0]:.1f}"
    return (
        f"{name.replace('_', ' '):18s}{sections:4d}{instructions:14d}{size:>11}{seconds * 1e6:9.1f}{us:11d}"
        f"{seconds * 1e6 / ns:9.1f}{relative:>17s}{ns:10.2f}"
    )


@pytest.mark.benchmark(timer=time.process_time)  # as the calibration: other work on the machine does not count
@pytest.mark.parametrize("sections", (1, 2, 4, 8, 16))
@pytest.mark.parametrize("name", PROTOTYPE_US)
def test_dynamics(benchmark, dynamics_table, name, sections):
    """One call in the VM (at most 1.1 of the prototype's time at equal calibration, and its instructions)."""
    robot = reference_rod.robot(sections)
    function = getattr(robot.functions(), name).function
    run, result = buffered(function, arguments(robot, name))
    assert np.all(np.isfinite(result))
    before = calibration()
    benchmark.pedantic(run, rounds=15, iterations=max(1, 400_000 // function.n_instructions()), warmup_rounds=2)
    ns = (before + calibration()) / 2  # of the same moment: the load of a shared machine comes and goes
    benchmark.extra_info |= {"instructions": function.n_instructions(), "calibration_ns": ns}
    benchmark.extra_info["prototype_us"] = PROTOTYPE_US[name][sections]
    if benchmark.stats:  # none under --benchmark-disable
        dynamics_table.append((name, sections, function.n_instructions(), benchmark.stats.stats.median, ns))
