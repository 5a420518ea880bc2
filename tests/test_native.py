"""Functions as machine code: the same numbers as in CasADi's virtual machine, the same errors, and nothing compiled
twice. The oracle is the virtual machine, which runs the same expressions by another path."""

import copy
import json
import os
import pickle
import shutil
import stat
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import socontrol as so
from socontrol import cli
from socontrol.mechanics.actuators import Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body
from socontrol.model.joints import Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.native import c_source, compiled, compiler
from socontrol.native import cache as kept
from socontrol.native.buffers import Buffered
from socontrol.programs.postures.goals import Point
from socontrol.programs.postures.inverse_statics import InverseStatics

ROOT = Path(__file__).parent.parent
SHIPPED = sorted(path.stem for path in (ROOT / "configs/robots").glob("*.yaml") if not path.stem.endswith("_coarse"))
NAMES = ("elastic_force", "stiffness", "damping", "external_force", "mass", "coriolis", "inverse_dynamics",
         "forward_dynamics", "motion_residual", "motion_tangents", "power", "momentum", "actuation",
         "actuator_lengths", "static_residual", "static_tangent", "statics", "energy")  # fmt: skip
needs_compiler = pytest.mark.skipif(compiler.find() is None, reason="no C compiler is here; install gcc or clang")
COUNTING = 'for a in "$@"; do [ "$a" = --version ] && exec {cc} --version; done; echo x >> {count}; exec {cc} "$@"'
FINGER = """
schema_version: 1
name: finger
segments:
  knuckle: {type: revolute, axis: [0, 1, 0], stiffness: 2, body: {mass: 0.1, com: [0.1, 0, 0]},
            tip: {position: [0.2, 0, 0]}}
  pad: {type: rod, parent: knuckle, length: 0.1, strains: planar_constant_curvature,
        cross_section: {type: circle, radius: 5 mm},
        material: {type: linear, young_modulus: 1 MPa, poisson_ratio: 0.5, density: 1000, viscosity: 300}}
actuators:
  m: {type: joint_torque, joint: knuckle, limits: [-3, 3]}
"""
# Functions called often: statics; f, g and derivatives; residual, tangents and power of a motion.
COMPILED = {"hang": 1, "reach": 5, "drop": 3, "second": 0, "soft": 0}
PROBLEMS = {
    "hang": "type: statics\nrobot: finger.yaml\ninputs: {m: 0.2}\n",
    "reach": "type: inverse_statics\nrobot: finger.yaml\ngoals:\n"
    "  tip: {type: point, on: knuckle, target: [null, null, 0.02]}\n",
    "drop": "type: simulation\nrobot: finger.yaml\ntimes: {stop: 0.2 s, every: 0.05 s}\n",
    "second": "type: simulation\nrobot: finger.yaml\ntimes: {stop: 0.2 s, every: 0.05 s}\nsolver: {type: cvodes}\n",
    "soft": "type: fit\nrobot: finger.yaml\non: knuckle\nvariants:\n  own:\n    parameters:\n"
    "      knuckle.stiffness: {start: 1.5, scale: 1, lower: 0.1}\n"
    "measurements:\n  - {inputs: {m: 0.5}, position: [0.199, 0, -0.01], tilt: 3 deg, use: fit}\n",
}


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """A cache of this test run's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """An empty cache; its folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "socontrol"


@pytest.fixture
def as_new(monkeypatch):
    """A process that has warned of nothing yet."""
    compiler._warn.cache_clear()
    yield
    compiler._warn.cache_clear()


def arm(stiffness=2.0):
    return Robot(Description(segments={"arm": Revolute(axis=(0.0, 1.0, 0.0), stiffness=stiffness,
                                                      body=Body(mass=0.1, com=(0.2, 0.0, 0.0)))}))  # fmt: skip


def rod(sections=1, strains="kirchhoff_love"):
    material = Linear(young_modulus=1e6, poisson_ratio=0.5, density=1000.0, viscosity=1e3)
    piece = Rod(length=0.4, strains=strains, sections=sections, cross_section=Circle(radius=0.01), material=material)
    return Robot(Description(segments={"rod": piece}, loads={"tip": Wrench(on="rod", force=(0.0, 0.01, 0.0))}))


def finger():
    """A joint that carries a rod with a cable."""
    pad = Rod(parent="arm", length=0.1, strains="planar_constant_curvature", cross_section=Circle(radius=0.005),
              material=Linear(young_modulus=1e6, poisson_ratio=0.5, density=1000.0, viscosity=1e3))  # fmt: skip
    segments = {**arm().description.segments, "pad": pad}
    cable = Tendon(along=("pad",), offset=(0.004, 0.0), limits=(0.0, 10.0))
    return Robot(Description(segments=segments, actuators={"cable": cable}))


@cache
def shortened(name):
    """A shipped robot with one section a rod, so that it compiles soon; a coarse one is then that which it is of."""
    robot = so.load_robot(ROOT / f"configs/robots/{name}.yaml")
    sections = 3 if name == "column_guided" else 1  # two conditions hold its bending: fewer could not move
    segments = {
        key: replace(s, sections=sections, rest=None) if isinstance(s, Rod) else s
        for key, s in robot.description.segments.items()
    }
    return Robot(replace(robot.description, segments=segments))


def arguments(function, seed=0):
    rng = np.random.default_rng(seed)
    return [0.2 * rng.normal(size=function.numel_in(i)) for i in range(function.n_in())]


def gap(a, b):
    """Largest difference over the largest number, over all outputs."""
    worst = 0.0
    for x, y in zip(a if isinstance(a, tuple) else [a], b if isinstance(b, tuple) else [b], strict=True):
        x, y = np.array(x), np.array(y)
        assert x.shape == y.shape and np.all(np.isfinite(y))
        worst = max(worst, np.max(np.abs(x - y), initial=0.0) / max(np.max(np.abs(y), initial=0.0), 1e-300))
    return worst


def members(functions):
    """{name: Function} of every kind a robot has."""
    found = {name: getattr(functions, name) for name in NAMES}
    robot = functions.base
    for segment in robot.segments:
        found[f"jacobian {segment}"] = functions.jacobian(segment, 1.0)
        if isinstance(robot.description.segments[segment], Rod):
            found[f"pose {segment}"] = functions.pose(segment, 0.7)
            found[f"internal_wrench {segment}"] = functions.internal_wrench(segment, 0.5)
    found |= {f"reaction {s.segment}": functions.reaction(s.segment) for s in robot.tree.pieces if s.parent is None}
    return found


def script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@pytest.fixture
def counted(tmp_path, monkeypatch):
    """How many times the compiler has run."""
    count = tmp_path / "count"
    monkeypatch.setenv("CC", script(tmp_path / "cc", COUNTING.format(cc=compiler.find(), count=count)))
    return lambda: len(count.read_text().split()) if count.exists() else 0


# Numbers

@needs_compiler
@pytest.mark.parametrize("robot", [arm(), rod(1, "constant_curvature"), finger()], ids=lambda r: "-".join(r.segments))
def test_every_function_gives_the_virtual_machine_s_numbers(robot):
    plain, c = members(robot.functions()), members(robot.functions(compiled=True))
    assert plain.keys() == c.keys()
    for name, function in plain.items():
        x = arguments(function.function)
        assert gap(c[name](*x), function(*x)) <= 1e-12, name
        assert c[name]._machine.is_a("External"), name


@needs_compiler
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_give_the_virtual_machine_s_numbers(name, monkeypatch):
    monkeypatch.setattr(compiled, "OPTIMISED_UP_TO", 0)  # functions of all kinds are optimised in the test before
    robot = shortened(name)
    for key in ("inverse_dynamics", "statics"):
        plain, c = getattr(robot.functions(), key), getattr(robot.functions(compiled=True), key)
        x = arguments(plain.function)
        assert gap(c(*x), plain(*x)) <= 1e-12, key


@needs_compiler
def test_long_chains_are_compiled_as_one_call_a_section():
    robot = rod(compiled.CHAINED_BEYOND + 1)
    plain, c = robot.functions(), robot.functions(compiled=True)
    for name in ("inverse_dynamics", "forward_dynamics"):
        x = arguments(getattr(plain, name).function)
        assert gap(getattr(c, name)(*x), getattr(plain, name)(*x)) <= 1e-12
        assert getattr(c, name).function.is_a("MXFunction")
        assert getattr(rod(1).functions(compiled=True), name).function.is_a("SXFunction")


@needs_compiler
def test_functions_too_long_to_optimise_are_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(compiled, "OPTIMISED_UP_TO", 10)
    plain, c = rod().functions().mass, rod().functions(compiled=True).mass
    x = arguments(plain.function)
    assert gap(c(*x), plain(*x)) <= 1e-12 and c._machine.is_a("External")
    monkeypatch.setattr(compiled, "COMPILED_UP_TO", 10)
    c = rod().functions(compiled=True).mass
    assert gap(c(*x), plain(*x)) == 0 and c._machine.is_a("SXFunction")


def test_what_has_no_c_stays_as_it_is_after_a_warning(as_new):
    x = ca.MX.sym("x")
    plain = ca.rootfinder("plain", "newton", {"x": x, "g": x**2 - 2})
    with pytest.warns(compiler.CompilerWarning, match="CasADi has no C for this.*virtual machine"):
        assert compiled.compiled(plain) is plain


def test_a_function_that_is_called_several_times_stands_once_and_runs_each_time():
    x, y = ca.SX.sym("x"), ca.MX.sym("y", 3)
    inner, other = (ca.Function("inner", [x], [f(x)]) for f in (ca.sin, lambda x: ca.sin(x) ** 2 + 1))
    outer = ca.Function("outer", [y], [inner(y[0]) + inner(y[1]) + other(y[2])])
    own, n, m = outer.n_instructions(), inner.n_instructions(), other.n_instructions()
    assert sorted(c_source.lengths([outer])) == sorted([own, n, m])
    assert c_source.operations(outer) == own + 2 * n + m


@needs_compiler
def test_parameters_are_an_argument_and_count_for_the_range():
    f, plain = (rod().functions(["rod.length"], compiled=on) for on in (True, False))
    q = [0.1, 0.2, 0.3, 0.4]
    assert gap(f.mass(q, 0.5), plain.mass(q, 0.5)) <= 1e-12 and gap(f.mass(q, [0.5]), plain.mass(q, 0.5)) <= 1e-12
    for function in (f.mass, plain.mass):
        with pytest.raises(ValueError, match=r"mass: section rod\.0 turns by 11\.\d+ rad"):
            function(q, 30.0)
        with pytest.raises(ValueError, match="turns by nan rad"):
            function(q, np.nan)


# Types

@needs_compiler
def test_numbers_give_arrays_of_casadi_s_shape_and_dm_gives_dm():
    f, q = rod().functions(compiled=True), np.full(4, 0.1)
    for given in (q, list(q), tuple(q), q[:, None], q[None, :], q.astype(np.float32).astype(float), f.mass(q)[:, 0]):
        assert type(f.energy(given, q)) is compiled.Matrix and f.energy(given, q).shape == (3, 1)
    assert gap(f.mass(np.ones(4, dtype=int)), f.mass(np.ones(4))) == 0
    assert type(f.mass(q).full()) is np.ndarray and f.mass(q).shape == (4, 4)
    assert isinstance(f.statics(q, []), tuple) and [x.shape for x in f.statics(q, [])] == [(4, 1), (4, 4), (4, 0)]
    assert isinstance(f.mass(ca.DM(q)), ca.DM) and gap(f.mass(ca.DM(q)), f.mass(q)) == 0
    assert isinstance(f.inverse_dynamics(q, ca.DM(q), q), ca.DM)
    assert gap(f.inverse_dynamics(q, 0, 0), f.inverse_dynamics(q, 0 * q, 0 * q)) == 0
    assert gap(f.mass(q=q)["out"], f.mass(q)) <= 1e-12


@needs_compiler
def test_an_answer_is_kept_when_the_next_one_is_asked_for():
    mass, q = rod().functions(compiled=True).mass, np.full(4, 0.1)
    first = mass(q)
    before = first.copy()
    mass(2 * q)
    assert np.array_equal(first, before)


@needs_compiler
@pytest.mark.parametrize("symbol", [ca.SX, ca.MX])
def test_symbols_leave_derivatives_available(symbol):
    f, q = rod().functions(compiled=True), symbol.sym("q", 4)
    slope = ca.Function("slope", [q], [ca.jacobian(f.energy(q, 0)[1], q)])
    x = np.array([0.3, -0.2, 0.1, 0.05])
    assert gap(np.array(slope(x)).ravel(), f.elastic_force(x).ravel()) < 1e-12


WRONG = ([1.0, 2.0], 1.0, np.zeros((4, 2)), [0, 0, np.nan, 0], [0, np.inf, 0, 0], [0, 0, 50.0, 0], "text",
         [0, 1j, 0, 0], None)  # fmt: skip


@needs_compiler
@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize("given", WRONG, ids=str)
def test_what_does_not_fit_is_refused_in_the_same_words(given):
    said = []
    for function in (rod().functions().mass, rod().functions(compiled=True).mass):
        with pytest.raises(Exception) as error:
            function(given)
        said.append((type(error.value), str(error.value)))
    assert said[0] == said[1]


@needs_compiler
def test_a_wrong_number_of_arguments_and_wrong_further_ones_are_refused():
    f, q = rod().functions(compiled=True), np.zeros(4)
    with pytest.raises(RuntimeError, match="Incorrect number of inputs: Expected 2, got 3"):
        f.external_force(q, q, q)
    with pytest.raises(RuntimeError):
        f.external_force(q, np.zeros(3))


@needs_compiler
def test_the_range_ends_where_the_virtual_machine_s_does():
    f, plain = rod().functions(compiled=True).mass, rod().functions().mass
    for turn in (2 * np.pi * (1 - 1e-9), -2 * np.pi * (1 - 1e-9)):
        assert gap(f([0, turn / 0.4, 0, 0]), plain([0, turn / 0.4, 0, 0])) <= 1e-12
    for function in (f, plain):
        with pytest.raises(ValueError, match="2 pi"):
            function([0, 2 * np.pi * 1.01 / 0.4, 0, 0])


# Buffers, copies and threads

@needs_compiler
def test_buffers_hold_the_function_s_own_outputs():
    f, x = rod().functions(compiled=True).motion_tangents, [np.full(4, 0.1), np.full(4, 0.2), np.zeros(0)]
    buffers, plain = f.buffered(), Buffered(f.function)
    assert len(buffers(*x)) == len(plain(*x)) == 3
    assert gap(tuple(buffers.outputs), tuple(plain.outputs)) <= 1e-12


@needs_compiler
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_and_pickles_work_as_the_original(again):
    f, q = rod().functions(compiled=True), np.full(4, 0.1)
    before = f.mass(q)
    for mass in (again(f.mass), again(f).mass):
        assert gap(mass(q), before) == 0 and type(mass(q)) is compiled.Matrix
        with pytest.raises(ValueError, match="twist is nan"):
            mass(q * np.nan)
    robot = again(rod().in_c())
    assert robot.compiled and gap(robot.functions().mass(q), before) == 0


@needs_compiler
def test_threads_share_a_function():
    f = rod().functions(compiled=True).inverse_dynamics
    shapes = np.random.default_rng(0).normal(size=(8, 4))
    wanted = [np.array(rod().functions().inverse_dynamics(q, q, q)) for q in shapes]
    found, wrong = threading.Barrier(len(shapes)), []

    def work(q, tau):
        found.wait()
        for _ in range(2000):
            if gap(f(q, q, q), tau) > 1e-12:
                wrong.append(q)
        try:
            f([1.0, 2.0], q, q)  # the slow way, by many at a time
        except ValueError:
            return
        wrong.append("refused")

    threads = [threading.Thread(target=work, args=pair) for pair in zip(shapes, wanted, strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


# The robot and its problems

def test_a_robot_in_c_stays_one_and_a_refined_one_does_not():
    robot = rod().in_c()
    assert robot.compiled and robot != rod() and robot.n == rod().n
    assert robot.with_values({"rod.length": 0.3}).compiled
    assert robot.with_loads({"other": Wrench(on="rod", force=(0, 0, 1))}).compiled
    assert not robot.refined(sections=2).compiled
    assert isinstance(robot.functions(), compiled.CompiledFunctions)
    assert not isinstance(robot.functions(compiled=False), compiled.CompiledFunctions)


@needs_compiler
def test_ipopt_takes_the_same_iterations_through_c():
    robot = shortened("stiff_flop")
    goals, answers = {"tip": Point(on="cap", target=(0.01, 0.0, robot.length + 0.005))}, []
    for own in (robot, robot.in_c()):
        solver = InverseStatics(robot=own, goals=goals).prepare()
        answers.append(solver.find({})[0])
    assert all(solver.posture.exact._plugin[key].is_a("External") for key in ("grad_f", "jac_g", "hess_lag"))
    plain, c = answers
    assert plain.status.solved and plain.iterations == c.iterations
    assert np.max(np.abs(plain.x - c.x)) <= 1e-10 and np.max(np.abs(plain.lam_g - c.lam_g)) <= 1e-8


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a robot and a problem of each type."""
    (tmp_path / "finger.yaml").write_text(FINGER.lstrip())
    for name, text in PROBLEMS.items():
        (tmp_path / f"{name}.yaml").write_text(f"schema_version: 1\n{text}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capfd, *arguments):
    """(exit code, stdout, stderr) of a command in this process."""
    capfd.readouterr()
    code = cli.run([str(a) for a in arguments])
    return code, *capfd.readouterr()


def numbers(path):
    content = json.loads((path / "result.json").read_text())
    with np.load(path / "arrays.npz") as arrays:
        return content["solver"], content["values"], {name: arrays[name] for name in arrays.files}


@needs_compiler
@pytest.mark.parametrize("name", PROBLEMS)
def test_solve_compiled_answers_as_without(name, folder, capfd, fresh, counted):
    runs = [run(capfd, "solve", f"{name}.yaml", "--no-figures", "-o", o, *flags)
            for o, flags in (("vm", ()), ("c", ("--compiled",)))]  # fmt: skip
    assert [code for code, _, _ in runs] == [0, 0] and counted() == COMPILED[name]
    assert ("nothing is compiled" in runs[1][2]) == (COMPILED[name] == 0)
    (solver, values, arrays), (own, found, other) = numbers(folder / "vm" / name), numbers(folder / "c" / name)
    assert own["compiled"] is (COMPILED[name] > 0) and solver["compiled"] is False
    assert own["iterations"] == solver["iterations"]
    assert values.keys() == found.keys() and arrays.keys() == other.keys()
    for key, array in arrays.items():
        np.testing.assert_allclose(other[key], array, rtol=1e-9, atol=1e-12, err_msg=key)


@needs_compiler
def test_the_public_solve_takes_compiled(folder):
    problem = so.load_problem("hang.yaml")
    plain, c = so.solve(problem), so.solve(problem, compiled=True)
    assert c.solver["compiled"] and not plain.solver["compiled"]
    np.testing.assert_allclose(c.arrays["q"], plain.arrays["q"], rtol=1e-12)


# Without a compiler that works

def test_without_a_compiler_one_sentence_is_said_and_the_answer_is_the_same(folder, capfd, monkeypatch, as_new):
    monkeypatch.setenv("CC", "no-such-compiler")
    code, _, err = run(capfd, "solve", "hang.yaml", "reach.yaml", "--no-figures", "--compiled")
    said = [line for line in err.splitlines() if "written" not in line]
    assert code == 0 and said == [
        "socontrol: the C compiler that CC names, 'no-such-compiler', is not found; "
        "CasADi's virtual machine is used instead: same answers, slower"
    ]
    for name in ("hang", "reach"):
        assert numbers(folder / "results" / name)[0]["compiled"] is False


def test_without_a_compiler_functions_warn_once_and_answer_alike(monkeypatch, as_new):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert compiler.find() is None
    with pytest.raises(compiler.NoCompiler, match="no-such-compiler"):
        compiler.library("int one(void) { return 1; }")
    f, q = arm().functions(compiled=True), [0.3]
    with pytest.warns(compiler.CompilerWarning, match="virtual machine is used instead"):
        M = f.mass(q)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tau = f.inverse_dynamics(q, q, q)
    assert type(M) is compiled.Matrix and gap(M, arm().functions().mass(q)) == 0
    assert gap(tau, arm().functions().inverse_dynamics(q, q, q)) == 0
    with pytest.raises(ValueError, match="arm is nan"):
        f.mass([np.nan])


def test_nothing_is_found_on_an_empty_path(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(compiler.NoCompiler, match=r"no C compiler is found \(cc, gcc, clang\); install gcc or clang"):
        compiler.library("int one(void) { return 1; }")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("echo 'cc1: out of luck' >&2; exit 1", "failed: cc1: out of luck"),
        ("exit 3", "failed: exit code 3"),
        ("exit 0", "wrote nothing"),
        ('while [ "$1" != -o ]; do shift; done; echo rubbish > "$2"', "cannot be loaded"),
    ],
)
def test_a_broken_compiler_is_told_of_and_the_answer_is_the_same(text, message, tmp_path, monkeypatch, fresh, as_new):
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    with pytest.warns(compiler.CompilerWarning, match=message):
        M = arm().functions(compiled=True).mass([0.3])
    assert gap(M, arm().functions().mass([0.3])) == 0
    assert not list(fresh.glob(".part-*"))


@needs_compiler
def test_a_compiler_that_does_not_know_this_processor_is_asked_without(tmp_path, monkeypatch, fresh):
    refuse = 'for a in "$@"; do [ "$a" = -march=native ] && echo unknown >&2 && exit 1; done'
    monkeypatch.setenv("CC", script(tmp_path / "cc", f'{refuse}\nexec {compiler.find()} "$@"'))
    assert compiler.library("int one(void) { return 1; }").is_file()


@pytest.mark.skipif(os.name != "posix", reason="ends a process as POSIX systems do")
def test_ctrl_c_ends_the_compiler_too(tmp_path, monkeypatch, fresh):
    began, pid = time.monotonic(), tmp_path / "pid"
    wait = f'[ "$1" = --version ] && exit 0; echo $$ > {pid}; sleep 60'
    monkeypatch.setenv("CC", script(tmp_path / "cc", wait))

    def check(sentence):
        if pid.exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), compiler.watched(check):
        compiler.library("int one(void) { return 1; }")
    assert time.monotonic() - began < 30 and not list(fresh.glob(".part-*"))
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


# The cache

ONCE = """
import socontrol as so
f = so.load_robot({robot!r}).functions(compiled=True)
print(f.mass([0.1, 0.2, 0.3])[0, 0], f.energy([0.1, 0.2, 0.3], [0, 0, 0])[1, 0])
"""


def process(folder):
    code = ONCE.format(robot=str(folder / "finger.yaml"))
    return subprocess.Popen([sys.executable, "-c", code], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@needs_compiler
def test_a_second_process_compiles_nothing(folder, fresh, counted):
    first, err = process(folder).communicate()
    assert counted() == 2, err.decode()
    second, err = process(folder).communicate()
    assert first == second and first and counted() == 2 and not err


@needs_compiler
def test_processes_that_compile_the_same_at_once_do_not_disturb_each_other(folder, fresh, counted):
    said = {running.communicate() for running in [process(folder) for _ in range(4)]}
    assert len(said) == 1 and b"" in next(iter(said))
    assert len(list(fresh.iterdir())) == 2 and all(path.suffix == ".so" for path in fresh.iterdir())


@needs_compiler
@pytest.mark.parametrize("damage", [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:-1] + b"?"])
def test_a_damaged_library_is_compiled_anew(damage, fresh, counted):
    text = "int one(void) { return 1; }"
    path = compiler.library(text)
    sound = path.read_bytes()
    assert compiler.library(text) == path and counted() == 1
    path.write_bytes(damage(sound))
    assert kept.digest(compiler.library(text).read_bytes()) in compiler.library(text).name
    assert counted() == 2 and len(list(fresh.iterdir())) == 1


@needs_compiler
def test_text_flags_and_compiler_make_the_key(fresh, counted, tmp_path, monkeypatch):
    text = "int one(void) { return 1; }"
    paths = {compiler.library(text), compiler.library(text + "\n")}
    paths |= {compiler.library(text, flags=(*compiler.FLAGS, "-DX"))}
    shutil.copy(tmp_path / "cc", tmp_path / "other")
    monkeypatch.setenv("CC", str(tmp_path / "other"))
    assert len(paths | {compiler.library(text)}) == 4 == counted()


@needs_compiler
def test_the_cache_forgets_what_was_not_used_for_longest(fresh, monkeypatch):
    paths = [compiler.library(f"int number(void) {{ return {k}; }}") for k in range(4)]
    for k, path in enumerate(paths):
        os.utime(path, (k + 1e9, k + 1e9))
    compiler.library("int number(void) { return 0; }")  # used again
    monkeypatch.setattr(kept, "LARGEST", 3.5 * paths[0].stat().st_size)
    newest = compiler.library("int number(void) { return 4; }")
    assert {p for p in fresh.iterdir()} == {paths[0], paths[3], newest}


@needs_compiler
def test_a_cache_that_cannot_be_written_is_replaced(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    path = compiler.library("int one(void) { return 1; }")
    assert path.is_file() and "/dev/null" not in str(path)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", "/dev/null")
    assert compiler.library("int one(void) { return 1; }").parent == path.parent


def test_what_a_killed_process_left_is_swept_when_it_is_old(tmp_path):
    for name, age in (("old", 2 * kept.ABANDONED), ("young", 0)):
        part = tmp_path / f"{kept.PART}{name}"
        part.mkdir()
        os.utime(part, (time.time() - age,) * 2)
    newest = tmp_path / "x.so"
    newest.write_bytes(b"")
    kept._shrink(tmp_path, newest, kept.LARGEST)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{kept.PART}young", "x.so"]
