"""The solver in C: its quadratic program, its answers against Python's solvers, and that it never claims too much."""

import ctypes
import json
import re
import shutil
import subprocess
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import socontrol as so
from socontrol import cli
from socontrol.codegen import measure, solver_checks
from socontrol.codegen.solver import CONSTANTS
from socontrol.mechanics.robot import Robot
from socontrol.native import compiler
from socontrol.programs.postures.reduced import Reduced

ROOT = Path(__file__).parent.parent
GOALS = np.loadtxt(ROOT / "tests" / "reference" / "two_module_goals.csv", delimiter=",")
TRIALS = 4
QUICK = ("-std=c99", "-O0", "-fPIC", "-shared")  # long straight code takes -O1 ten times as long
SHIPPED = [  # statics and inverse statics that compile in a few seconds
    "elastica",
    "roll_up",
    "steel_rod_tendons",
    "steel_rod_three_tendons",
    "stiff_flop_mini_circle",
    "stiff_flop_reach",
    "stiff_flop_two_modules_pose",
    "stiff_flop_under_load",
    "stiff_flop_unreachable",
    "tendon_closed_form",
]
pytestmark = pytest.mark.skipif(compiler.find() is None, reason="no C compiler is installed (Debian package gcc)")


def problem(name):
    return ROOT / "problems" / f"{name}.yaml"


@pytest.fixture(scope="module", autouse=True)
def few_trials():
    """Self-tests of few answers, no stack measured: `test_targets` runs them whole, and the tests here ask for more."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver_checks, "COLD", TRIALS)
        patch.setattr(solver_checks, "WARM", TRIALS)
        patch.setattr(measure, "stack_bytes", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A maker of loaded folders by problem name, each written once through the command line."""
    made, base = {}, tmp_path_factory.mktemp("solvers")

    def load(name):
        if name not in made:
            assert cli.run(["codegen", str(problem(name)), "-o", str(base / name)]) == 0
            made[name] = so.load_compiled(base / name, flags=QUICK)
        return made[name]

    load.base = base
    return load


@pytest.fixture(scope="module")
def modules(exported):
    """The exported solver of the two modules' tip, and Python's."""
    question = so.load_problem(problem("stiff_flop_two_modules_tip"))
    with exported("stiff_flop_two_modules_tip").solver() as solver:
        yield solver, question.prepare()


# The quadratic program

@pytest.fixture(scope="module")
def program():
    """qp_solve for 5 unknowns, 2 equalities and 9 inequalities."""
    folder = resources.files("socontrol.codegen") / "templates" / "solver"
    sizes = "enum { QP_V = 5, QP_EQUAL = 2, QP_ROWS = 11 };\n"
    constant = "".join(f"#define {name} {CONSTANTS[name][0]!r}\n" for name in ("SQP_SINGULAR", "QP_DEPENDENT"))
    body = "".join((folder / name).read_text() for name in ("dense.c", "qp.c"))
    door = "int solve(double *G, double *a, double *C, double *b, double *x, double *y) { static qp_state q;"
    door += " int ok = qp_solve(&q, G, a, C, b, y); for (int i = 0; i < 5; i++) x[i] = q.x[i]; return ok; }\n"
    unused = "void unused(void) { (void) lu_factor; (void) lu_solve; (void) lu_solve_transposed; }\n"
    text = "#include <math.h>\n#include <string.h>\n" + sizes + constant + body + door + unused
    return ctypes.CDLL(str(compiler.library(text, flags=QUICK))).solve


def called(program, G, a, C, b):
    """(solved, x, y) of a quadratic program."""
    arrays = [np.ascontiguousarray(x, dtype=float).copy() for x in (G, a, C, b)] + [np.zeros(5), np.zeros(11)]
    ok = program(*(x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in arrays))
    return bool(ok), arrays[4], arrays[5]


def test_a_quadratic_program_ends_at_a_point_that_meets_the_conditions_of_its_minimum_or_has_no_point(program):
    rng, solved = np.random.default_rng(3), 0
    for _ in range(400):
        half, C = rng.normal(size=(5, 5)), rng.normal(size=(11, 5))
        G, a, b = half.T @ half + 0.1 * np.eye(5), rng.normal(size=5), rng.normal(size=11)
        ok, x, y = called(program, G, a, C, b)
        feasible = linprog(np.zeros(5), -C[2:], -b[2:], C[:2], b[:2], bounds=[(None, None)] * 5).status == 0
        assert ok == feasible
        if ok:
            solved += 1
            gap = C @ x - b
            assert np.max(np.abs(G @ x + a - C.T @ y)) < 1e-7
            assert np.max(np.abs(gap[:2])) < 1e-8 and np.min(gap[2:]) > -1e-8
            assert np.min(y[2:]) >= 0 and np.max(np.abs(y[2:] * gap[2:])) < 1e-6
    assert 100 < solved < 390


@pytest.mark.parametrize("root", [1e-3, 1e-5])  # of the weight of a slack
def test_a_quadratic_program_with_slacks_for_its_equalities_always_has_a_point(program, root):
    rng = np.random.default_rng(4)
    for _ in range(200):
        a, slopes, low = np.append(rng.normal(size=3), [0, 0]), rng.normal(size=(2, 3)), -rng.random(3)
        slopes[1] += 10 * slopes[0]
        box = np.vstack([np.eye(3, 5), -np.eye(3, 5), np.zeros((3, 5))])
        C = np.vstack([np.hstack([slopes, -root * np.eye(2)]), box])
        b = np.concatenate([3 * rng.normal(size=2), low, -1 + 0 * low, [-1e20] * 3])
        G = np.diag([1e-4, 1.0, 1.0, 1.0, 1.0])
        ok, x, y = called(program, G, a, C, b)
        gap = C @ x - b
        size = 1 + np.max(np.abs(y))
        assert ok and np.max(np.abs(gap[:2])) < 1e-8 * (1 + np.max(np.abs(b[:2]))) and np.min(gap[2:]) > -1e-8
        assert np.max(np.abs(G @ x + a - C.T @ y)) < 1e-7 * size and np.min(y[2:]) >= 0
        assert np.max(np.abs(y[2:8] * gap[2:8])) < 1e-7 * size


def test_a_quadratic_program_that_is_not_convex_is_refused(program):
    assert not called(program, -np.eye(5), np.ones(5), np.eye(11, 5), np.zeros(11))[0]


# Answers

@pytest.mark.parametrize("name", SHIPPED)
def test_the_exported_solver_of_a_shipped_problem_gives_its_answer(exported, name):
    question = so.load_problem(problem(name))
    wanted, reduced = so.solve(question), Reduced(question)
    with exported(name).solver() as solver:
        answer = solver.solve(max_iterations=200)
    assert answer.status == {"solved": "OK", "infeasible": "INFEASIBLE"}[wanted.status.outcome]
    q, u = (wanted.arrays[key][0] if wanted.arrays[key].ndim == 2 else wanted.arrays[key] for key in "qu")
    assert np.max(np.abs(answer.coordinates - q) / reduced.scales.q) < 1e-7
    if reduced.inverse:
        assert np.max(np.abs(answer.inputs - u) / reduced.scales.u) < 1e-7


def test_random_reachable_goals_are_solved_from_rest_as_ipopt_does(modules):
    solver, python = modules
    for goal in GOALS[::40, 6:9]:
        answer, outcome = solver.solve(cold=True, target_tip=goal), python.find({"target.tip": goal})[0]
        assert answer.solved and answer.miss < 1e-9 and answer.balance < 1e-9
        assert np.max(np.abs(answer.inputs - outcome.values["u"]) / python.balance.scales.u) < 1e-7


def test_a_path_is_followed_from_neighbour_to_neighbour_in_fewer_steps(modules):
    solver, _ = modules
    circle = [(0.02 * np.cos(t), 0.02 * np.sin(t), 0.125) for t in np.linspace(0, 2 * np.pi, 60)]
    cold = [solver.solve(cold=True, target_tip=point) for point in circle]
    warm = [solver.solve(target_tip=point) for point in circle]
    assert all(a.solved for a in [*cold, *warm])
    assert np.mean([a.iterations for a in warm[1:]]) < 0.7 * np.mean([a.iterations for a in cold])
    assert max(np.max(np.abs(a.inputs - b.inputs)) for a, b in zip(cold, warm, strict=True)) < 1e-7 * 140e3


def test_goals_out_of_reach_are_called_infeasible_and_answered_by_the_nearest_posture(modules):
    solver, python = modules
    pose = python.question.robot.functions().pose("cap").function
    for goal in [(0.2, 0, 0.1), (0, -0.15, 0.2), (0, 0, 0.4), (-0.1, 0.1, -0.3)]:
        answer = solver.solve(cold=True, target_tip=goal)
        near = python.posture.nearest.solve(guess=python.rest, parameters={"target.tip": goal})
        ours, theirs = (np.linalg.norm(np.array(pose(q))[:3, 3] - goal) for q in (answer.coordinates, near.values["q"]))
        assert answer.status == "INFEASIBLE" and ours < theirs * (1 + 1e-6)


def test_loads_are_arguments(exported):
    wanted = so.solve(so.load_problem(problem("stiff_flop_under_load")))
    path = next(iter(so.load_problem(problem("stiff_flop_under_load")).loads))
    changed = so.load_problem(problem("stiff_flop_under_load"))
    force = np.array(changed.loaded.value(f"loads.{path}.force")) * 0.5
    other = Reduced(changed)
    q = other.balance.solve(wanted.arrays["u"], p=np.concatenate([force]))
    with exported("stiff_flop_under_load").solver() as solver:
        heavy = solver.solve().inputs
        light = solver.solve(**{f"loads_{path}_force": force})
        named = {f"loads.{path}.force": force}
    outcome = changed.prepare().posture.exact.solve(guess=changed.prepare().rest, parameters=named)
    assert q.status.solved and light.solved and np.max(np.abs(light.inputs - heavy)) > 1.0
    assert np.max(np.abs(light.inputs - outcome.values["u"])) < 1e-7 * 140e3


def test_inputs_held_by_equal_limits_stay_there(modules):
    solver, python = modules
    lower, upper = np.zeros(6), np.full(6, 140e3)
    lower[2] = upper[2] = 60e3
    answer = solver.solve(cold=True, target_tip=(0.01, -0.015, 0.124), inputs_lower=lower, inputs_upper=upper)
    bounds, parameters = {"u": (lower, upper), "q": python.posture.limits()["q"]}, {"target.tip": (0.01, -0.015, 0.124)}
    outcome = python.posture.exact.solve(guess=python.rest, bounds=bounds, parameters=parameters)
    solver.solve(cold=True, inputs_lower=np.zeros(6), inputs_upper=np.full(6, 140e3))
    assert answer.solved and answer.inputs[2] == pytest.approx(60e3, rel=1e-12)
    assert np.max(np.abs(answer.inputs - outcome.values["u"])) < 1e-7 * 140e3


COSTS = {
    "heavy effort": {"effort": {"type": "effort", "weight": 1000.0}},
    "strain energy": {"energy": {"type": "strain_energy"}},
    "both": {"energy": {"type": "strain_energy", "weight": 5.0}, "effort": {"type": "effort", "weight": 0.1}},
    "reference": {"near": {"type": "reference", "inputs": {"p0": "100 kPa", "p2": "20 kPa"}, "weight": 2.0}},
}


@pytest.mark.parametrize("costs", COSTS.values(), ids=COSTS)
def test_other_costs_are_those_of_python_and_their_size_does_not_matter(tmp_path, costs):
    robot = so.load_robot(ROOT / "configs" / "robots" / "stiff_flop.yaml")
    goal = {"type": "point", "on": "cap", "target": [0.01, None, None]}  # one number for three pressures
    question = so.problem({"type": "inverse_statics", "robot": robot, "goals": {"tip": goal}, "costs": costs})
    python = question.prepare()
    so.codegen(question, tmp_path / "c")
    with so.load_compiled(tmp_path / "c", flags=QUICK).solver() as solver:
        for target in (0.01, -0.004, 0.016):
            answer, outcome = solver.solve(cold=True, target_tip=target), python.find({"target.tip": [target]})[0]
            assert answer.solved and outcome.status.solved
            assert answer.cost == pytest.approx(outcome.cost, rel=1e-8)
            assert np.max(np.abs(answer.inputs - outcome.values["u"])) < 1e-6 * 140e3


LIMB = {
    "name": "limb",
    "segments": {
        "shoulder": {"type": "revolute", "axis": [0, 1, 0], "stiffness": 0.4, "limits": [-0.3, 0.6],
                     "body": {"mass": 0.1, "com": [0.02, 0, 0]}, "tip": {"position": [0.05, 0, 0]}},
        "rod": {"type": "rod", "parent": "shoulder", "length": 0.2, "strains": ["bend_y", "bend_z"], "sections": 2,
                "cross_section": {"type": "circle", "radius": 0.01},
                "material": {"type": "linear", "young_modulus": "0.2 MPa", "poisson_ratio": 0.5, "density": 1000}},
    },
    "actuators": {
        "motor": {"type": "joint_torque", "joint": "shoulder", "limits": [-1, 1]},
        **{f"t{k}": {"type": "tendon", "along": ["rod"], "offset": offset, "limits": [0, 3]}
           for k, offset in enumerate([[0.008, 0], [0, 0.008], [-0.008, 0], [0, -0.008]])},
    },
}  # fmt: skip
ASKED = {
    "point": {"type": "point", "on": "rod", "target": [0.15, None, 0.02]},  # y is free, and rest symmetric in it
    "axis": {"type": "axis", "on": "rod", "target": [1, 0, 0.2]},
}


@pytest.mark.parametrize("goal", ASKED.values(), ids=ASKED)
def test_nothing_that_python_finds_is_called_out_of_reach_and_limits_of_coordinates_hold(tmp_path, goal):
    question = so.problem({"type": "inverse_statics", "robot": so.robot(LIMB), "goals": {"tip": goal}})
    python, rng, solved = question.prepare(), np.random.default_rng(0), 0
    so.codegen(question, tmp_path / "c")
    with so.load_compiled(tmp_path / "c").solver() as solver:
        for _ in range(60):
            u = np.append(rng.uniform(-0.3, 0.3), rng.uniform(0, 1, 4))
            q = python.balance.solve(u, python.rest["q"]).q
            target = python.posture.goals["tip"].reached(python.look.functions, q)
            outcome, answer = python.find({"target.tip": target})[0], solver.solve(200, cold=True, target_tip=target)
            solved += outcome.status.solved
            assert answer.solved or not outcome.status.solved
            if answer.solved:
                assert -0.3 - 1e-8 <= answer.coordinates[0] <= 0.6 + 1e-8
                assert answer.cost <= outcome.cost * (1 + 1e-6) + 1e-9 or not outcome.status.solved
    assert solved > 30


def test_stability_is_that_of_what_is_not_held(tmp_path):
    body, tip = {"mass": 1, "com": [0.1, 0, 0]}, {"position": [0.2, 0, 0]}
    arm = {"type": "revolute", "axis": [0, 1, 0], "body": body, "tip": tip}
    limbs = {"a": {**arm, "stiffness": 0.001}, "b": {**arm, "parent": "a", "stiffness": 3}}
    for held in ({"a": 1.2}, {"a": 0.3, "b": -2.0}, {"b": 0.5}):
        question = so.problem({"type": "statics", "robot": so.robot({"segments": limbs}), "coordinates": held,
                               "guess": {"coordinates": {"a": -1.6}}})  # fmt: skip
        so.codegen(question, tmp_path / "c")
        with so.load_compiled(tmp_path / "c").solver() as solver:
            answer = solver.solve()
        result = so.solve(question)
        assert answer.solved and answer.stable == result.details["stable"]
        assert np.max(np.abs(answer.coordinates - result.arrays["q"])) < 1e-7


def test_a_statics_solver_finds_the_shape_under_other_inputs(exported):
    question = so.load_problem(problem("tendon_closed_form"))
    python, rng = question.prepare(), np.random.default_rng(1)
    with exported("tendon_closed_form").solver() as solver:
        for _ in range(5):
            u = question.vector("inputs", question.inputs) * rng.uniform(0.2, 1.0, question.robot.m)
            answer = solver.solve(cold=True, inputs=u)
            assert answer.solved and answer.stable
            assert np.max(np.abs(answer.coordinates - python.balance.solve(u).q)) < 1e-7


# Statuses

def test_a_number_that_is_none_limits_that_cross_and_a_negative_count_are_bad_input(modules):
    solver, _ = modules
    good = dict(target_tip=(0.01, 0, 0.125), inputs_lower=np.zeros(6), inputs_upper=np.full(6, 140e3))
    for bad in (dict(target_tip=(np.nan, 0, 0.1)), dict(inputs_lower=np.full(6, 1e6)), dict(inputs_upper=[np.nan] * 6)):
        assert solver.solve(**{**good, **bad}).status == "BAD_INPUT"
    assert solver.solve(max_iterations=-1, **good).status == "BAD_INPUT"
    assert solver.solve(**good).solved


def test_too_few_iterations_are_not_called_solved(modules):
    solver, _ = modules
    for limit in range(4):
        answer = solver.solve(max_iterations=limit, cold=True, target_tip=(0.01, -0.015, 0.124))
        assert answer.status == "NOT_CONVERGED" and answer.iterations == limit
    assert solver.solve(max_iterations=100, cold=True).solved


def test_a_claim_holds_in_python_whatever_the_target(modules):
    solver, python = modules
    rng, solved = np.random.default_rng(5), 0
    lower, upper = python.question.input_limits()
    for _ in range(60):
        goal = np.array([0, 0, 0.125]) + 0.04 * rng.normal(size=3)
        answer = solver.solve(target_tip=goal)
        solved += answer.solved
        if answer.solved:
            misses = python.posture.misses(answer.coordinates, {"target.tip": goal})["tip"]
            force = python.look.residuals(answer.coordinates, answer.inputs, python.posture.free)["force"].value
            assert np.linalg.norm(misses) < 1e-9 and force < 1e-9
            assert np.all(answer.inputs >= lower - 1e-3) and np.all(answer.inputs <= upper + 1e-3)
    assert 3 < solved < 57


def test_every_solver_takes_a_slot_and_gives_it_back(exported):
    library = exported("stiff_flop_reach")
    with library.solver() as first:
        with pytest.raises(RuntimeError, match="every slot"):
            library.solver()
        assert first.solve().solved
        first._call("init", first.struct)  # anew in its own slot
        assert first.solve().solved
    with library.solver() as second:
        assert second.solve().solved
        second.close()
        assert second.solve().status == "BAD_INPUT"  # without a slot


def test_more_slots_are_a_constant_of_the_build(exported):
    exported("stiff_flop_reach")
    library = so.load_compiled(exported.base / "stiff_flop_reach", flags=(*QUICK, "-DSTIFF_FLOP_REACH_POOL=2"))
    with library.solver() as first, library.solver() as second:
        a = first.solve(target_tip=(0.010, 0.008, 0.068))
        b = second.solve(target_tip=(0.002, -0.004, 0.069))
        assert a.solved and b.solved and first.solve(target_tip=(0.010, 0.008, 0.068)).iterations < a.iterations


# Folders

def test_the_selftest_of_a_solver_passes_and_its_static_bytes_are_those_of_the_manifest(exported, tmp_path):
    exported("stiff_flop_reach")
    folder = exported.base / "stiff_flop_reach"
    strict = ["-std=c99", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-parameter"]
    names = [str(folder / f"{name}.c") for name in ("stiff_flop_reach", "selftest")]
    subprocess.run([compiler.find(), *strict, *names, "-lm", "-o", str(tmp_path / "selftest")], check=True)
    done = subprocess.run([str(tmp_path / "selftest")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(f"{TRIALS} of {TRIALS} solved") == 2 and "2 of 2 called infeasible" in done.stdout
    if shutil.which("nm"):
        subprocess.run([compiler.find(), "-fno-pie", "-c", names[0], "-o", str(tmp_path / "code.o")], check=True)
        table = subprocess.run(["nm", "-S", str(tmp_path / "code.o")], capture_output=True, text=True, check=True)
        bytes_ = sum(int(size, 16) for size in re.findall(r"^\w+ (\w+) [bBdD] ", table.stdout, re.MULTILINE))
        assert bytes_ == json.loads((folder / "manifest.json").read_text())["static_bytes"]


def test_a_selftest_fails_where_the_code_is_wrong(exported, tmp_path):
    exported("tendon_closed_form")
    folder = shutil.copytree(exported.base / "tendon_closed_form", tmp_path / "broken")
    source = folder / "tendon_closed_form.c"
    text = source.read_text()
    broken = text.replace("Wi[SQP_U] = -at->rows[i];", "Wi[SQP_U] = -0.9 * at->rows[i] + 1e-3;")
    assert broken != text
    source.write_text(broken)
    names = [str(source), str(folder / "selftest.c")]
    subprocess.run([compiler.find(), "-std=c99", *names, "-lm", "-o", str(tmp_path / "selftest")], check=True)
    assert subprocess.run([str(tmp_path / "selftest")], capture_output=True).returncode == 1


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["flying_rod"], 3, ["simulation", "statics, inverse_statics and tensions"]),
        (["four_bar"], 3, ["robot", "loops", "a robot file gives plain functions"]),
        (["stiff_flop_reach", "--real", "float"], 2, ["double precision", "robot file"]),
    ],
)
def test_what_has_no_solver_in_c_is_refused_with_a_reason(tmp_path, capsys, arguments, code, words):
    name, *flags = arguments
    assert cli.run(["codegen", str(problem(name)), "-o", str(tmp_path / "out"), *flags]) == code
    said = capsys.readouterr().err
    assert all(word in said for word in words) and len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_inverse_statics_of_loops_are_refused_too(tmp_path, capsys):
    asked = {"type": "inverse_statics", "robot": str(ROOT / "configs" / "robots" / "four_bar.yaml"),
             "goals": {"tip": {"type": "point", "on": "coupler", "target": [0.3, None, None]}}}  # fmt: skip
    (tmp_path / "asked.yaml").write_text(json.dumps({"schema_version": 1, **asked}))
    assert cli.run(["codegen", str(tmp_path / "asked.yaml"), "-o", str(tmp_path / "out")]) == 3
    said = capsys.readouterr().err
    assert "it has loops" in said and len(said.strip().splitlines()) == 1 and not (tmp_path / "out").exists()


def test_a_joint_that_nothing_pulls_back_is_refused_by_name(tmp_path):
    limb = {"type": "revolute", "axis": [0, 0, 1], "tip": {"position": [0.2, 0, 0]}}
    motor = {"type": "joint_torque", "joint": "arm", "limits": [-1, 1]}
    robot = so.robot({"name": "free_arm", "segments": {"arm": limb}, "actuators": {"motor": motor}})
    assert isinstance(robot, Robot)
    goal = {"type": "point", "on": "arm", "target": [0.0, 0.2, None]}
    question = so.problem({"type": "inverse_statics", "robot": robot, "goals": {"tip": goal}})
    with pytest.raises(ValueError, match="does not fix coordinate arm"):
        so.codegen(question, tmp_path / "out")
    assert not (tmp_path / "out").exists()
