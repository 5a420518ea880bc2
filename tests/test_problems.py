"""The shipped robots and problems: every file is read, every problem is solved and gives what it expects.

Expectations are compared here by hand, not by the code of the command line. The equilibria of the showcase problems
are weighed again by `robots.Plain`, which shares no formula with the library.
"""

from dataclasses import replace
from functools import cache
from math import pi
from pathlib import Path

import numpy as np
import pytest
from robots import Plain, slopes
from ruamel.yaml import YAML

import socontrol as so
from socontrol.programs.postures.inverse_statics import InverseStatics

ROOT = Path(__file__).parents[1]
PROBLEMS = {str(p.relative_to(ROOT / "problems"))[:-5]: p for p in sorted((ROOT / "problems").rglob("*.yaml"))}
CONFIGS = ROOT / "configs"
ROBOTS = {str(p.relative_to(CONFIGS / "robots"))[:-5]: p for p in sorted((CONFIGS / "robots").rglob("*.yaml"))}
SHOWCASE = [
    "elastica",
    "finray_ellipsoids",
    "finray_inverse",
    "finray_press",
    "finray_trace",
    "four_bar",
    "gripper_ellipsoids",
    "guided_finger_close",
    "hybrid_arm_reach",
    "l_beam_clamped",
    "octopus_arm_direction",
    "octopus_arm_reach",
    "octopus_brace",
    "octopus_compliance",
    "octopus_figure_eight",
    "octopus_motors",
    "octopus_reach",
    "octopus_wrap",
    "parallel_soft_platform",
    "roll_up",
    "slider_crank",
    "steel_rod_convergent",
    "steel_rod_helical",
    "steel_rod_tendons",
    "steel_rod_three_tendons",
    "stiff_flop_measured",
    "stiff_flop_mini_circle",
    "stiff_flop_mini_square",
    "stiff_flop_reach",
    "stiff_flop_two_modules_pose",
    "stiff_flop_two_modules_tip",
    "stiff_flop_under_load",
    "stiff_flop_unreachable",
    "stiff_flop_volumes",
    "tendon_closed_form",
]
WITHOUT_PLAIN = [  # no balance of the numpy robot: measured; friction; loops
    "stiff_flop_measured", "guided_finger_close", "finray_ellipsoids", "finray_inverse", "finray_press", "finray_trace",
    "four_bar", "l_beam_clamped", "parallel_soft_platform", "slider_crank",
]  # fmt: skip
ROWS = {  # of the joint table; three distributed rows have their problem among the showcases
    "lumped": ["revolute", "prismatic", "helical", "cylindrical", "planar", "spherical", "free", "fixed"],
    "distributed": ["linear_spring", "planar_constant_curvature", "constant_curvature", "simo_reissner"],
    "shown": ["inextensible_constant_curvature", "inextensible_kirchhoff_love", "kirchhoff_love"],
}
MOTIONS = [
    "finray_release",
    "flying_rod",
    "four_bar_turning",
    "gripper_finger_close",
    "hybrid_arm_drop",
    "lophotricus_sink",
    "lophotricus_straight",
    "octopus_arm_release",
    "octopus_bend_propagation",
    "octopus_three_motors",
    "slider_crank_turning",
    "steel_rod_wound",
]
PLANS = [  # at their own meshes all are solved by `python tests/benchmarks/trajectories.py problems`
    "cartpole_swing_up",
    "double_pendulum_reach",
    "finger_flick",
    "hybrid_arm_pick",
    "octopus_reach_dynamic",
    "stiff_flop_sweep",
    "swimmer_turn",
    "tip_tracking_dynamic",
]
PULLED = ["octopus_swing", "parallel_soft_platform_circle", "tip_tracking"]  # motions whose tensions are sought
GROWING = ["column_buckling", "column_buckling_clamped", "finray_buckling", "snap_through"]  # not at one posture
QUICK = ["cartpole_swing_up", "finger_flick"]  # plans that are solved here too
ROW_BY_ROW = [f"rows/{row}" for row in ROWS["lumped"] + ROWS["distributed"]]
DOCUMENTED = [*SHOWCASE, *MOTIONS, *PULLED, *PLANS, *GROWING, *ROW_BY_ROW]
ELSEWHERE = ["stiff_flop_measured", *MOTIONS, *PULLED, *PLANS, *GROWING]  # looked at by tests of their own
ANSWERED = [name for name in PROBLEMS if name not in PLANS or name in QUICK]
UNITS = {"Pa": 1.0, "kPa": 1e3, "m": 1.0, "mm": 1e-3, "N": 1.0, "rad": 1.0, "deg": pi / 180}


def plain(path):
    """The data of a YAML file."""
    return YAML(typ="safe").load(path.read_text())


def si(value):
    """Numbers of an expectation: `12 mm`, 0.012, null (any) or lists of them."""
    if isinstance(value, list):
        return [si(item) for item in value]
    if isinstance(value, str):
        number, unit = value.split()
        return float(number) * UNITS[unit]
    return float("nan") if value is None else float(value)


@cache
def solved(name):
    return so.solve(so.load_problem(PROBLEMS[name]))


def test_problems_are_those_of_the_list():
    assert sorted(PROBLEMS) == sorted(DOCUMENTED)


@pytest.mark.parametrize("name", ANSWERED)
def test_a_problem_gives_what_it_expects(name):
    expect, result = plain(PROBLEMS[name])["expect"], solved(name)
    assert result.status.exit_code == expect.pop("exit", 0), result.status.message
    outcome = expect.pop("status.outcome", None)
    assert outcome is None or result.status.outcome == outcome["value"]
    for key, wanted in expect.items():
        family, _, value = key.partition(".")
        found, target = np.array(getattr(result, family)[value].value, dtype=float), np.array(si(wanted["value"]))
        assert found.shape == target.shape, key
        miss = np.abs(found - target)[np.isfinite(target)]
        assert np.all(miss <= si(wanted["tolerance"])), f"{key}: {found} found, {target} expected"


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_problem_rests_on_more_than_an_earlier_run(name):
    expect = plain(PROBLEMS[name])["expect"]
    sources = [e["source"] for key, e in expect.items() if key != "exit"]
    assert sources and all(sources)
    assert any(not source.startswith("regression") for source in sources)


@pytest.mark.parametrize("name", QUICK)
def test_twice_the_intervals_change_the_cost_by_no_more_than_is_said(name):
    result = solved(name)
    mesh = replace(result.question.mesh, intervals=2 * result.question.mesh.intervals, halved=False)
    finer = so.solve(replace(result.question, mesh=mesh)).require()
    assert abs(finer["cost"] - result["cost"]) <= result["mesh.cost_change"]


def test_a_plan_is_what_the_robot_does_under_the_table_of_its_inputs():
    """In the simulation of another file, driven by what a plan stores for a controller; its inputs do not jump."""
    result = solved("finger_flick")
    robot, t = result.question.robot, result.arrays["t"]
    columns = zip(robot.inputs, result.arrays["u"].T.tolist(), strict=True)
    inputs = {key: {"type": "table", "times": t.tolist(), "values": values} for key, values in columns}
    first = dict(zip(robot.coordinates, result.arrays["q"][0].tolist(), strict=True))
    asked = {"type": "simulation", "robot": robot, "times": t[1:].tolist(), "inputs": inputs}
    moved = so.solve(so.problem({**asked, "start": {"coordinates": first}})).require()
    for segment in robot.segments:
        gaps = moved.arrays[f"{segment}.position"] - result.arrays[f"{segment}.position"]
        assert np.max(np.linalg.norm(gaps, axis=1)) < 1e-3 * robot.length


@pytest.mark.parametrize("name", [n for n in PROBLEMS if n not in ELSEWHERE])
def test_an_answer_is_stable_within_limits_and_fine_enough(name):
    result = solved(name)
    question, u = result.question, result.arrays.get("path.u", result.arrays["u"])
    lower, upper = question.input_limits()
    assert np.all(u >= lower) and np.all(u <= upper)
    assert result.details["stable"], result.details["stability"]
    assert result.residuals["force"].value < 1e-8
    changes = result.details.get("discretisation") or {}
    assert all(change < 0.02 * question.robot.length for change in changes.values())
    if isinstance(question, InverseStatics) and result.status.solved:
        exact = [name for name, goal in question.goals.items() if goal.weight is None]
        goals = [value.value for key, value in result.residuals.items() if key.split(".")[1:2] in [[x] for x in exact]]
        assert len(goals) >= len(exact) and max(goals, default=0.0) < 1e-7


@pytest.mark.parametrize("name", [name for name in SHOWCASE if name not in WITHOUT_PLAIN])
def test_an_answer_balances_in_the_plain_numpy_robot(name):
    result = solved(name)
    robot, q, u = Plain(result.question.loaded.description), result.arrays["q"], result.arrays["u"]
    terms = np.array([slopes(robot.elastic_energy, q), -robot.external_force(q), -robot.actuation(q) @ u])
    units = np.array(result.question.robot.coordinate_units)
    for unit in set(units):
        group = terms[:, units == unit]
        assert np.max(np.abs(group.sum(0))) < 1e-8 * np.max(np.abs(group)), unit


def test_every_robot_is_asked_something():
    used = {(PROBLEMS[n].parent / plain(PROBLEMS[n])["robot"]).resolve() for n in PROBLEMS}
    assert used == {path.resolve() for path in ROBOTS.values()}


def test_every_row_of_the_joint_table_has_a_robot():
    rows = [f"rows/{row}" for kind in ROWS.values() for row in kind]
    assert sorted(rows) == sorted(name for name in ROBOTS if name.startswith("rows/"))
    for row in rows:
        kinds = {s.strains if hasattr(s, "strains") else type(s).__name__.lower()
                 for s in so.load_robot(ROBOTS[row]).description.segments.values()}  # fmt: skip
        assert row.removeprefix("rows/") in kinds


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("shape", ["straight", "bent"])
def test_a_robot_has_a_finite_residual(name, shape):
    residual = functions(name).static_residual
    robot = so.load_robot(ROBOTS[name])
    rng = np.random.default_rng(1)
    bent = {"1/m": 5.0, "1": 0.1, "rad": 0.5, "m": 0.05}  # sizes of random coordinates
    longest = max([float(piece.length) for piece in robot.tree.pieces if piece.is_rod], default=0.0)
    bent["1/m"] = min(5.0, 3.0 / max(longest, 1e-9))  # a section holds for 2 pi
    q = np.array([bent[unit] for unit in robot.coordinate_units]) * rng.uniform(-1, 1, robot.n) * (shape == "bent")
    u = np.array([min(abs(upper), 1e5) for _, upper in robot.input_limits]) / 2
    assert np.all(np.isfinite(np.array(residual(q, u))))


@cache
def functions(name):
    return so.load_robot(ROBOTS[name]).functions()


@pytest.mark.parametrize("name", sorted(p.stem for p in (CONFIGS / "solvers").glob("*.yaml")))
def test_a_solver_file_is_read(name):
    from socontrol.files.problem_file import load_solver

    largest = {"radau": 1e-6}.get(name, 1e-8)  # of one step's speed; of a converged equation
    assert load_solver(CONFIGS / "solvers" / f"{name}.yaml").tolerance <= largest


# What the numbers say about the machines


def test_inflating_a_pair_bends_the_module_as_measured():
    """S.M.H. Sadati, TMTDyn (2019): pressure in kPa, (x, y) of the tip in mm; 5/4 is the factor of his figures."""
    measured = {"p0": (35.7, (0.04, -9.25)), "p1": (27.0, (-5.12, 3.08)), "p2": (36.1, (7.73, 4.18))}
    for pair, (pressure, tip) in measured.items():
        problem = so.problem(
            {
                "schema_version": 1, "type": "statics", "discretisation": False,
                "robot": str(ROBOTS["stiff_flop"]), "inputs": {pair: 1250 * pressure},
            }
        )  # fmt: skip
        found = np.array(so.solve(problem)["cap.position"])[:2] * 1e3
        assert np.linalg.norm(found - tip) < 0.25 * np.linalg.norm(tip)


def test_weights_are_the_published_ones():
    from socontrol.model.rods import Rod

    def mass(name, segment):
        rod = so.load_robot(ROBOTS[name]).description.segments[segment]
        assert isinstance(rod, Rod)
        return rod.length * rod.material.density * rod.cross_section.moments().A

    assert mass("stiff_flop_mini", "first") == pytest.approx(0.010, rel=1e-4)
    assert mass("stiff_flop_mini", "second") == pytest.approx(0.010, rel=1e-4)
