"""Folders of C code: written whole or not at all, compiled as their README says, equal to Python."""

import ctypes
import json
import re
import shutil
import signal
import subprocess
import threading
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import socontrol as so
from socontrol import cli
from socontrol.codegen import budget, ctext, identifiers, measure, place
from socontrol.codegen import folder as writer
from socontrol.codegen.catalogue import KINDS, BadRequest
from socontrol.codegen.loaded import QUICK
from socontrol.native.c_source import CSource, NotExportable

ROOT = Path(__file__).parent.parent
SHIPPED = sorted(path.stem for path in (ROOT / "configs" / "robots").glob("*.yaml"))
STRICT = ["-std=c99", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-parameter"]
PLACES = "pose,pose@module:0.5,jacobian@module:0,elastic_force,static_tangent,external_force"
FILES = {"CMakeLists.txt", "README", "main.c", "manifest.json", "selftest.c"}
SMALL = """
schema_version: 1
name: "2 Arme: Ärmel & Co/ (*/)"
segments:
  left-arm: {type: revolute, axis: [0, 1, 0], stiffness: 2, body: {mass: 0.1, com: [0.1, 0, 0]}, limits: [-1, 2]}
  left_arm: {type: revolute, axis: [0, 1, 0], body: {mass: 0.1, com: [0.1, 0, 0]}, parent: left-arm}
  int: {type: prismatic, axis: [1, 0, 0], body: {mass: 0.2}, parent: left_arm}
actuators:
  "m-1": {type: joint_torque, joint: left_arm, limits: [-1, 1]}
"""
HELD = """
schema_version: 1
type: statics
robot: odd.yaml
inputs: {m-1: 0.1}
"""


def needs(tool):
    return pytest.mark.skipif(shutil.which(tool) is None, reason=f"{tool} is not installed (package {tool})")


def robot_file(name):
    return str(ROOT / "configs" / "robots" / f"{name}.yaml")


def run(command, folder):
    """Exit code and output of a command line."""
    done = subprocess.run(command, cwd=folder, shell=isinstance(command, str), capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def codegen(*arguments):
    return cli.run(["codegen", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The C code of a module with functions of every shape."""
    path = tmp_path_factory.mktemp("codegen") / "flop"
    assert codegen(robot_file("stiff_flop"), "-o", path, "--functions", PLACES) == 0
    return path


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """The C code of a small statics problem."""
    path = tmp_path_factory.mktemp("held")
    (path / "odd.yaml").write_text(SMALL.replace("0.1, 0, 0]}, limits", "0, 0, 0.1]}, limits"), encoding="utf-8")
    (path / "held.yaml").write_text(HELD)
    assert codegen(path / "held.yaml", "-o", path / "c") == 0
    return path / "c"


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    """The C code of a robot whose names are no C names."""
    path = tmp_path_factory.mktemp("odd")
    (path / "odd.yaml").write_text(SMALL, encoding="utf-8")
    assert codegen(path / "odd.yaml", "-o", path / "c", "--functions", "pose@left-arm,pose@left_arm,pose@int,mass") == 0
    return path / "c"


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text())


# Journeys


@needs("gcc")
def test_the_lines_of_the_readme_build_the_example_and_a_selftest_that_passes(folder):
    lines = re.findall(r"^    (gcc .*)$", (folder / "README").read_text(), re.MULTILINE)
    assert len(lines) == 2
    copy = folder.parent / "readme"
    shutil.copytree(folder, copy)
    for line in lines:
        code, output = run(line.replace("-O1", "-O0"), copy)
        assert code == 0, output
    assert "all checks passed" in output and "FAILED" not in output
    found = np.array(re.findall(r"-?\d+\.?\d*", run("./example", copy)[1].split("\n", 1)[1]), dtype=float).reshape(4, 4)
    straight = so.load_robot(robot_file("stiff_flop")).functions().pose("cap")(np.zeros(16)).full()
    assert np.allclose(found, straight, atol=1e-6)


@needs("cmake")
@needs("gcc")
def test_cmake_builds_and_ctest_passes(odd, tmp_path):
    code, output = run(["cmake", "-S", odd, "-B", tmp_path / "build"], tmp_path)
    assert code == 0, output
    assert run(["cmake", "--build", tmp_path / "build"], tmp_path)[0] == 0
    code, output = run(["ctest", "--test-dir", tmp_path / "build"], tmp_path)
    assert code == 0 and "100% tests passed" in output


@needs("gcc")
def test_a_selftest_fails_when_the_code_is_not_what_python_says(odd, tmp_path):
    shutil.copytree(odd, tmp_path / "c")
    name = manifest_of(odd)["prefix"]
    source = tmp_path / "c" / f"{name}.c"
    text, count = re.subn(r"(static int eval_mass\(.*\n(?:casadi_real.*\n|  .*\n)*a\d+=)([0-9.]+);", r"\1 1.5*\2;",
                          source.read_text(), count=1)  # fmt: skip
    assert count == 1
    source.write_text(text)
    code, output = run(f"gcc -std=c99 selftest.c {name}.c -lm -o selftest && ./selftest", tmp_path / "c")
    assert code == 1 and re.search(r"^mass .*FAILED", output, re.MULTILINE)


def test_printed_is_what_was_written_and_where(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(budget, "LONGEST_OWN", 5.0)  # s, less than the longest function takes
    assert codegen(robot_file("octopus_arm_water"), "-o", tmp_path / "c") == 0
    said = capsys.readouterr()
    manifest = manifest_of(tmp_path / "c")
    assert "octopus_arm_water_mass(q[15]) -> M[225]" in said.out
    assert f"{manifest['static_bytes']} bytes of static memory" in said.out
    assert re.search(r"left out: coriolis: 0.\d MB of C, about \d+ s of gcc; name it to have it", said.err)
    assert "a floating base is one joint of type 'free'" in manifest["left_out"]["floating_inverse_dynamics"]
    assert "c/ written" in said.err
    assert manifest["left_out"].keys() | {row["kind"] for row in manifest["functions"]} == KINDS.keys()


@needs("gcc")
def test_python_and_command_line_write_the_same_bytes_twice(folder, tmp_path):
    robot = so.load_robot(robot_file("stiff_flop"))
    for _ in range(2):
        so.codegen(robot, tmp_path / "flop", functions=PLACES.split(","))
        names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
        assert names >= FILES | {"stiff_flop.c", "stiff_flop.h"}
        for name in names:
            assert (tmp_path / "flop" / name).read_bytes() == (folder / name).read_bytes(), name


def test_a_problem_brings_its_solver_through_the_same_door(tmp_path, capsys):
    problem = ROOT / "problems" / "stiff_flop_reach.yaml"
    assert codegen(problem, "-o", tmp_path / "c", "--functions", "pose") == 0
    manifest = manifest_of(tmp_path / "c")
    assert manifest["prefix"] == "stiff_flop_reach" and [row["kind"] for row in manifest["functions"]] == ["pose"]
    header = (tmp_path / "c" / "stiff_flop_reach.h").read_text()
    assert "stiff_flop_reach_pose(" in header and "stiff_flop_reach_solve(" in header
    assert codegen(problem, "-o", tmp_path / "f", "--real", "float") == 2
    assert "a solver needs double precision" in capsys.readouterr().err
    assert codegen(ROOT / "problems" / "octopus_arm_release.yaml", "-o", tmp_path / "s") == 3
    assert not (tmp_path / "f").exists() and not (tmp_path / "s").exists()


# Equal to Python


def differences(robot, functions, loaded, rng):
    """{function: largest difference from Python over its largest number} at random states."""
    plain, found = robot.functions(), {}
    pieces = [piece for piece in robot.tree.pieces if piece.is_rod]
    wide = np.concatenate([np.full(p.size, 1.0 / float(p.length) if p.is_rod else 0.5) for p in robot.tree.pieces])
    for piece in pieces:
        wide[piece.columns] = np.where(np.array(piece.Phi)[:3].any(axis=0), wide[piece.columns], 0.1)
    for name in functions:
        in_c = loaded.pose() if name == "pose" else loaded.jacobian() if name == "jacobian" else getattr(loaded, name)
        made = getattr(plain, name)
        made = made(robot.segments[-1], 1.0) if KINDS[name].place else made
        gap = size = 0.0
        for share in (0.0, 1.0, 1.0):
            states = {a: share * rng.uniform(-1, 1, n) for a, n in in_c.arguments}
            states["q"] = states["q"] * wide
            given = [states[a] for a, _ in in_c.arguments]
            one, other = in_c(*given), made.function.call(given)
            one = one if isinstance(one, tuple) else (one,)
            assert [x.shape for x in one] == [x.shape for x in other]
            gap = max(gap, *(np.abs(a - b.full()).max(initial=0) for a, b in zip(one, other, strict=True)))
            size = max(size, *(np.abs(b.full()).max(initial=0) for b in other))
        found[name] = gap / (size or 1.0)
    return found


@needs("gcc")
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_in_c_equal_python(name, tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "stack_bytes", lambda *_: None)  # it takes gcc as long as the library does
    robot = so.load_robot(robot_file(name))
    wanted = ["pose", "jacobian", "external_force"]
    if robot.n <= 100:  # larger ones are of the same kinds, and take gcc longer
        wanted += ["static_residual", "stiffness", "inverse_dynamics"]
    if robot.m and robot.n <= 15:
        wanted += ["forward_dynamics", "actuation", "actuator_lengths", "momentum"]
    if robot.loops and robot.n <= 20:  # where closed chains move, in one expression or in calls
        wanted += ["loop_error", "loop_jacobian", "loop_bias", "loop_force", "forward_dynamics"]
    so.codegen(robot, tmp_path / "c", functions=wanted)
    loaded = so.load_compiled(tmp_path / "c", flags=QUICK)
    found = differences(robot, wanted, loaded, np.random.default_rng(3))
    assert max(found.values()) < 1e-12, found


@needs("gcc")
def test_free_bases_have_two_results(tmp_path):
    robot = so.load_robot(robot_file("flying_rod")).refined()
    so.codegen(robot, tmp_path / "c", functions=["floating_inverse_dynamics", "damping"])
    loaded = so.load_compiled(tmp_path / "c", flags=QUICK)
    found = differences(robot, ["floating_inverse_dynamics", "damping"], loaded, np.random.default_rng(4))
    assert max(found.values()) < 1e-12


@needs("gcc")
def test_matrices_stand_row_by_row(folder):
    loaded, q = so.load_compiled(folder, flags=QUICK), np.linspace(-4, 4, 16)
    f = so.load_robot(robot_file("stiff_flop")).functions()
    pose = f.pose("module", 0.5)(q).full()
    call, out = loaded.library.stiff_flop_pose_module_0_5, np.zeros(16)
    assert call(ctypes.c_void_p(q.ctypes.data), ctypes.c_void_p(out.ctypes.data)) == 0
    assert np.allclose(out[3::4], pose[:, 3], atol=1e-15)  # the fourth of each row: the position
    assert np.allclose(loaded.pose("module", 0.5)(q), pose, atol=1e-15)
    assert np.allclose(loaded.jacobian("module", 0)(q), f.jacobian("module", 0.0)(q).full(), atol=1e-15)


@needs("gcc")
def test_what_is_refused_in_c_is_a_sentence_in_python(folder):
    loaded, q = so.load_compiled(folder, flags=QUICK), np.zeros(16)
    q[9] = 1000.0
    with pytest.raises(ValueError, match="section module.2 turns by more than 2 pi"):
        loaded.elastic_force(q)
    q[9] = np.nan
    with pytest.raises(ValueError, match="q holds a number that is not finite"):
        loaded.elastic_force(q)
    with pytest.raises(ValueError, match="u holds a number that is not finite"):
        loaded.static_tangent(np.zeros(16), [0, np.inf, 0])
    with pytest.raises(ValueError, match="15 numbers given for q, 16 wanted"):
        loaded.elastic_force(np.zeros(15))
    with pytest.raises(TypeError, match="1 arguments given, 2 wanted: q, u"):
        loaded.static_tangent(np.zeros(16))
    with pytest.raises(AttributeError, match="the folder has no 'mass'; it has pose@cap:1, pose@module:0.5"):
        loaded.mass(np.zeros(16))
    with pytest.raises(ValueError, match="no folder of socontrol codegen"):
        so.load_compiled(folder.parent)


def alone(work):
    """Results of functions that run at the same time, each in a thread of its own."""
    found = [None] * len(work)

    def run(k):
        found[k] = work[k]()

    threads = [threading.Thread(target=run, args=(k,)) for k in range(len(work))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


@needs("gcc")
def test_threads_that_load_a_folder_each_for_itself_do_not_disturb_each_other(tmp_path):
    so.codegen(so.load_robot(robot_file("stiff_flop")), tmp_path / "c", functions=["inverse_dynamics"])
    both = [so.load_compiled(tmp_path / "c", flags=QUICK) for _ in range(2)]
    shapes, still = [np.linspace(-4, 4, 16), np.linspace(3, -1, 16)], np.zeros(16)
    wanted = [loaded.inverse_dynamics(q, still, still) for loaded, q in zip(both, shapes, strict=True)]

    def often(k):
        return [both[k].inverse_dynamics(shapes[k], still, still) for _ in range(1000)]

    for found, right in zip(alone([lambda: often(0), lambda: often(1)]), wanted, strict=True):
        assert all(np.array_equal(one, right) for one in found)


@needs("gcc")
def test_a_solver_that_nobody_holds_any_more_gives_its_slot_back(held):
    for _ in range(3):
        assert so.load_compiled(held, flags=QUICK).solver().solve().solved
    with so.load_compiled(held, flags=QUICK).solver() as first:
        with pytest.raises(RuntimeError, match="every slot of the solver's pool is taken"):
            so.load_compiled(held, flags=QUICK).solver()
        assert first.solve().solved
    first.close()
    second = so.load_compiled(held, flags=QUICK).solver()
    first.close()  # what is closed already takes no other's slot
    assert second.solve().solved


@needs("gcc")
def test_threads_that_share_a_solver_get_the_answers_to_their_own_arguments(held):
    with so.load_compiled(held, flags=QUICK).solver() as solver:
        wanted = [solver.solve(cold=True, inputs=[torque]).coordinates for torque in (0.1, -0.3)]
        assert not np.allclose(*wanted)

        def often(torque):
            return [solver.solve(cold=True, inputs=[torque]).coordinates for _ in range(500)]

        for found, right in zip(alone([lambda: often(0.1), lambda: often(-0.3)]), wanted, strict=True):
            assert all(np.array_equal(one, right) for one in found)


@needs("gcc")
def test_a_solver_forgets_arguments_that_are_refused_and_takes_only_c_ints(held):
    with so.load_compiled(held, flags=QUICK).solver() as solver:
        right = solver.solve(cold=True, inputs=[-0.3]).coordinates
        assert solver.solve(inputs=[np.nan]).status == "BAD_INPUT"
        again = solver.solve(cold=True)
        assert again.solved and np.array_equal(again.coordinates, right)
        for number in (2**32 + 5, 2**31, -(2**31) - 1, 5.5, "5"):
            with pytest.raises(ValueError, match="max_iterations: .* is given"):
                solver.solve(number)
        assert solver.solve(np.int64(100), cold=True).solved


@needs("gcc")
def test_the_section_that_turns_most_is_told_by_name(folder, odd):
    loaded, q = so.load_compiled(folder, flags=QUICK), np.zeros(16)
    q[9] = 1.0
    assert loaded.worst_section(q) == loaded.worst_section(q.tolist()) == "module.2"
    with pytest.raises(ValueError, match="q holds a number that is not finite"):
        loaded.worst_section(q * np.nan)
    with pytest.raises(ValueError, match="15 numbers given for q, 16 wanted"):
        loaded.worst_section(q[1:])
    with pytest.raises(AttributeError, match="no sections of rod"):
        so.load_compiled(odd, flags=QUICK).worst_section(np.zeros(3))


@needs("gcc")
def test_single_precision_says_how_far_it_is_from_python(tmp_path, capsys):
    args = (robot_file("stiff_flop"), "-o", tmp_path / "c", "--functions", "pose,elastic_force", "--real", "float")
    assert codegen(*args) == 0
    errors = manifest_of(tmp_path / "c")["float_error"]
    assert errors.keys() == {"pose", "elastic_force"} and all(1e-9 < e < 1e-5 for e in errors.values())
    assert f"error {errors['pose']:.1e}" in capsys.readouterr().out
    assert so.load_compiled(tmp_path / "c", flags=QUICK).worst_section([0.0] * 12 + [1.0] * 4) == "module.3"
    text = (tmp_path / "c" / "stiff_flop.c").read_text()
    assert "int stiff_flop_pose(const float q[16], float pose[16])" in text
    code, output = run(f"gcc {' '.join(STRICT)} -Wdouble-promotion -c stiff_flop.c", tmp_path / "c")
    assert code == 0, output
    assert run("gcc -std=c99 selftest.c stiff_flop.c -lm -o t && ./t", tmp_path / "c")[0] == 0


@pytest.mark.parametrize("text", ["no program", "#!/no/such/interpreter\n"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_what_no_compiler_measured_is_said(text, real, odd, tmp_path, capsys, monkeypatch):
    (tmp_path / "cc").write_text(text)
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "c", "--functions", "mass", "--real", real) == 0
    said, manifest = capsys.readouterr().err, manifest_of(tmp_path / "c")
    assert manifest["stack_bytes"] is manifest["float_error"] is None
    assert "not measured, for lack of a C compiler that works and knows -fstack-usage: the stack" in said
    assert ("the error of single precision" in said) == (real == "float")


@needs("gcc")
def test_what_was_measured_needs_no_words(odd, tmp_path, capsys):
    args = ("--functions", "mass", "--real", "float")
    assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "c", *args) == 0
    assert "not measured" not in capsys.readouterr().err


# C


@pytest.mark.parametrize("compiler", [pytest.param(name, marks=needs(name)) for name in ("gcc", "clang")])
def test_no_compiler_has_a_word_to_say(compiler, folder, odd):
    for home in (folder, odd):
        name = manifest_of(home)["prefix"]
        for file in ("selftest.c", "main.c", f"{name}.c"):
            code, output = run([compiler, *STRICT, "-fsyntax-only", file], home)
            assert code == 0 and not output, output


@needs("gcc")
@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_code_that_looks_for_infinities_refuses_compilers_that_forget_them(flag, folder):
    code, output = run(["gcc", *STRICT, flag, "-fsyntax-only", "stiff_flop.c"], folder)
    assert code == 1 and "#error" in output


def test_headers_say_which_threads_may_call(folder, held):
    shared = "share a static workspace: call them from one thread"
    assert shared in (folder / "stiff_flop.h").read_text() and shared in (held / "held.h").read_text()
    solver = "it may run in several threads, one struct each; call init\n * and release from one thread"
    assert solver in (held / "held.h").read_text() and "struct" not in (folder / "stiff_flop.h").read_text()


@needs("gcc")
def test_the_stack_is_measured_with_all_words_of_the_compiler_s_command(odd, monkeypatch):
    name = manifest_of(odd)["prefix"]
    texts = [(odd / f"{name}{end}").read_text() for end in (".h", ".c")]
    monkeypatch.setenv("CC", "gcc")
    plain = measure.stack_bytes(*texts, name)
    monkeypatch.setenv("CC", "env gcc")
    assert measure.stack_bytes(*texts, name) == plain > 0


@needs("g++")
def test_the_header_serves_cpp(odd, tmp_path):
    name = manifest_of(odd)["prefix"]
    text = f'#include "{name}.h"\nint main() {{ double q[3] = {{0}}, M[9]; return {name}_mass(q, M); }}\n'
    (tmp_path / "use.cpp").write_text(text)
    include = ["-I", str(odd), str(tmp_path / "use.cpp")]
    assert run(["gcc", "-std=c99", "-c", str(odd / f"{name}.c"), "-o", "c.o"], tmp_path)[0] == 0
    code, output = run(
        ["g++", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *include, "c.o", "-lm", "-o", "use"], tmp_path
    )
    assert code == 0, output
    assert run("./use", tmp_path)[0] == 0


@needs("gcc")
def test_names_become_legal_and_distinct(odd):
    header = (odd / f"{manifest_of(odd)['prefix']}.h").read_text()
    assert manifest_of(odd)["prefix"] == "robot_2_arme_armel_co"
    rows = [row["name"].removeprefix("robot_2_arme_armel_co_") for row in manifest_of(odd)["functions"]]
    assert rows == ["pose_left_arm", "pose_left_arm_2", "pose", "mass"]
    assert "#define ROBOT_2_ARME_ARMEL_CO_N 3" in header and header.count("*/") == header.count("/*")
    loaded = so.load_compiled(odd, flags=QUICK)
    q = [0.3, -0.2, 0.1]
    assert not np.allclose(loaded.pose("left-arm", 1.0)(q), loaded.pose("left_arm", 1.0)(q))
    assert identifiers.prefix("main") == "main_robot" and identifiers.prefix("§") == "robot"
    assert ctext.text_literal('a"\\?é') == '"a\\042\\134\\077\\303\\251"'


@needs("gcc")
@pytest.mark.parametrize("name", ["eval", "pose", "math", "string", "stdio", "stddef", "class", "wanted", "casadi"])
def test_robots_named_as_what_c_or_the_code_knows_compile(name, tmp_path):
    arm = {"type": "revolute", "axis": [0, 1, 0], "body": {"mass": 1, "com": [1, 0, 0]}}
    rod = {"type": "rod", "length": "0.1 m", "strains": "kirchhoff_love", "parent": "arm",
           "cross_section": {"type": "circle", "radius": "5 mm"},
           "material": {"type": "linear", "young_modulus": 1e6, "poisson_ratio": 0.5, "density": 1000}}  # fmt: skip
    robot = so.robot({"name": name, "segments": {"arm": arm, "rod": rod}})
    prefix = so.codegen(robot, tmp_path, functions=["pose", "mass"]).manifest["prefix"]
    command = ["gcc", *STRICT, "-I.", f"{prefix}.c", "selftest.c", "-lm", "-o", "t"]
    code, output = run(command, tmp_path)
    assert code == 0, output
    assert run("./t", tmp_path)[0] == 0


@needs("gcc")
@pytest.mark.parametrize("name", ["sqp", "qp", "lu", "cholesky", "eval"])
def test_problems_named_as_what_the_solver_holds_compile(name, held, tmp_path):
    (tmp_path / "odd.yaml").write_text((held.parent / "odd.yaml").read_text())
    (tmp_path / f"{name}.yaml").write_text(HELD)
    assert codegen(tmp_path / f"{name}.yaml", "-o", tmp_path / "c") == 0
    prefix = manifest_of(tmp_path / "c")["prefix"]
    for file in (f"{prefix}.c", "selftest.c", "main.c"):
        code, output = run(["gcc", *STRICT, "-fsyntax-only", file], tmp_path / "c")
        assert code == 0, output


def test_words_that_belong_to_others_are_no_prefix():
    for word in ("eval", "math", "sqp", "m", "int", "wchar_t", "co_await", "pthread", "nul", "install", "selftest"):
        assert identifiers.prefix(word) == f"{word}_robot"
    assert identifiers.prefix("Eval pose") == "robot_eval_pose" and identifiers.prefix("evaluation") == "evaluation"


@needs("gcc")
@needs("nm")
def test_static_and_stack_bytes_are_what_the_compiler_says(tmp_path):
    so.codegen(so.load_robot(robot_file("octopus_arm_water")), tmp_path / "c", functions=["inverse_dynamics", "mass"])
    name, manifest = "octopus_arm_water", manifest_of(tmp_path / "c")
    for level in ("-O0", "-O1"):
        command = ["gcc", "-std=c99", level, "-fno-pie", "-fstack-usage", "-c", f"{name}.c", "-o", "o.o"]
        assert run(command, tmp_path / "c")[0] == 0
        symbols = run("nm -S o.o", tmp_path / "c")[1]
        assert (
            sum(int(size, 16) for size in re.findall(r"^\w+ (\w+) [bBdD] ", symbols, re.M)) == manifest["static_bytes"]
        )
    assert manifest["static_bytes"] > 1000
    usage = next((tmp_path / "c").glob("*.su")).read_text()
    assert max(map(int, re.findall(r"\t(\d+)\t", usage))) <= manifest["stack_bytes"]
    undefined = set(re.findall(r" U (\w+)", symbols))
    assert undefined <= {"sin", "cos", "sqrt", "fabs", "exp", "log", "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}


# Refusals


def test_a_folder_that_is_not_ours_is_left_alone(folder, tmp_path, capsys):
    robot, wanted = robot_file("stiff_flop"), ("--functions", "elastic_force")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes").write_text("mine")
    assert codegen(robot, "-o", tmp_path / "mine", *wanted) == 2
    assert "holds other files than generated code" in capsys.readouterr().err
    shutil.copytree(folder, tmp_path / "c")
    (tmp_path / "c" / "controller.c").write_text("int x;")
    assert codegen(robot, "-o", tmp_path / "c", *wanted) == 2
    assert "holds 'controller.c', which was not generated" in capsys.readouterr().err
    (tmp_path / "c" / "controller.c").unlink()
    (tmp_path / "c" / "main.c").write_text("int main(void) { return 1; }")
    assert codegen(robot, "-o", tmp_path / "c", *wanted) == 2
    assert "'main.c' was changed by hand" in capsys.readouterr().err
    shutil.copy(folder / "main.c", tmp_path / "c" / "main.c")
    assert codegen(robot, "-o", tmp_path / "c", *wanted) == 0
    assert [row["kind"] for row in manifest_of(tmp_path / "c")["functions"]] == ["elastic_force"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "mine"]


DAMAGES = {
    "memory": lambda m: m["solver"].update(memory_doubles=0),
    "codes": lambda m: m["codes"].pop(),
    "seal": lambda m: m.pop("manifest_sha256"),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_manifest_that_was_changed_is_not_loaded(damage, held, tmp_path):
    shutil.copytree(held, tmp_path / "c")
    manifest = manifest_of(held)
    damage(manifest)
    (tmp_path / "c" / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match="c: 'manifest.json' was changed since it was generated"):
        so.load_compiled(tmp_path / "c")


def test_a_manifest_of_another_version_is_not_loaded(held, tmp_path):
    shutil.copytree(held, tmp_path / "c")
    (tmp_path / "c" / "manifest.json").write_text(json.dumps({**manifest_of(held), "schema_version": 2}))
    with pytest.raises(ValueError, match="has schema_version 2, 1 is wanted"):
        so.load_compiled(tmp_path / "c")


@pytest.mark.parametrize("name", ["held.c", "held.h"])
@pytest.mark.parametrize("text", ["", "int x;\n"])
def test_code_that_was_changed_is_not_loaded(name, text, held, tmp_path):
    shutil.copytree(held, tmp_path / "c")
    (tmp_path / "c" / name).write_text(text)
    with pytest.raises(ValueError, match=f"'{name}' was changed since it was generated"):
        so.load_compiled(tmp_path / "c")


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "null", "[" * 100_000, '{"generator": "socontrol"}', "\udcff", '{"generator": "socontrol", '
     '"schema_version": 1, "prefix": [], "files": 3}', "1" * 10_000],
)  # fmt: skip
def test_what_is_no_manifest_is_a_sentence(text, tmp_path):
    (tmp_path / "manifest.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ValueError, match="no folder of socontrol codegen"):
        so.load_compiled(tmp_path)
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path, "--functions", "elastic_force") == 2


@needs("cmake")
@needs("gcc")
def test_what_the_readme_builds_inside_the_folder_does_not_block_the_next_generation(odd, tmp_path, capsys):
    shutil.copytree(odd, tmp_path / "c")
    again, name = ("--functions", "mass"), manifest_of(odd)["prefix"]
    assert run(["cmake", "-S", ".", "-B", "build"], tmp_path / "c")[0] == 0
    lines = re.findall(r"^    (gcc .*) &&", (odd / "README").read_text(), re.MULTILINE)
    for line in [*lines, f"gcc -O0 -c {name}.c"]:
        assert run(line.replace("-O1", "-O0"), tmp_path / "c")[0] == 0
    assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "c", *again) == 0
    names = {path.name for path in (tmp_path / "c").iterdir()}
    assert not names & {"build", "example", "selftest", f"{name}.o"} and "manifest.json" in names
    for strange in ("build/notes", "example/notes", "mine.o"):
        path = tmp_path / "c" / strange
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
        capsys.readouterr()
        assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "c", *again) == 2
        assert f"holds '{strange.partition('/')[0]}', which was not generated" in capsys.readouterr().err
        assert path.read_text() == "mine"
        path.unlink()
        if path.parent.name != "c":
            path.parent.rmdir()


def test_ctrl_c_is_one_line_and_writes_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(writer, "CSource", lambda *args: signal.raise_signal(signal.SIGINT))
    before = signal.getsignal(signal.SIGINT)
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path / "c", "--functions", "mass") == 130
    said = capsys.readouterr().err
    assert "interrupted" in said and len(said.splitlines()) == 1 and not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGINT) is before


def test_a_disk_that_fails_half_way_leaves_the_folder_that_was_there(folder, tmp_path, capsys, monkeypatch):
    shutil.copytree(folder, tmp_path / "c")
    before = {path.name: path.read_bytes() for path in (tmp_path / "c").iterdir() if path.is_file()}

    def full(part, where):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(place, "change_places", full)
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path / "c", "--functions", "elastic_force") == 2
    assert "c: cannot be written: No space left on device" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in (tmp_path / "c").iterdir() if path.is_file()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


@pytest.mark.parametrize(
    "wanted, sentence",
    [
        ("mas", "unknown function 'mas'; did you mean 'mass'?"),
        ("pose@modul", "unknown segment 'modul'; did you mean 'module'?"),
        ("pose@module:1.5", "X = 1.5 on 'module' is outside [0, 1]"),
        ("pose@cap:half", "'half' is no number"),
        ("mass@cap", "mass is of the whole robot"),
        ("floating_inverse_dynamics", "does not apply to this robot: a floating base is one joint of type 'free'"),
        (" , ", "no function is named"),
    ],
)
def test_a_wrong_function_is_one_line_and_nothing_is_written(wanted, sentence, tmp_path, capsys):
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path / "c", "--functions", wanted) == 2
    said = capsys.readouterr().err
    assert sentence in said and len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_wrong_files_and_flags_write_nothing(tmp_path, capsys):
    assert codegen(tmp_path / "no.yaml", "-o", tmp_path / "c") == 2
    (tmp_path / "bad.yaml").write_text("segments: {arm: {type: revolut}}\n")
    assert codegen(tmp_path / "bad.yaml", "-o", tmp_path / "c") == 3
    assert "bad.yaml:1" in capsys.readouterr().err
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path / "c", "--real", "half") == 2
    assert codegen(robot_file("stiff_flop"), "-o", tmp_path / "bad.yaml") == 2
    assert not (tmp_path / "c").exists()
    fixed = {"segments": {"base": {"type": "fixed", "body": {"mass": 1}}}}
    with pytest.raises(BadRequest, match="no coordinates"):
        so.codegen(so.robot(fixed), tmp_path / "c")


def test_code_that_is_too_large_is_refused_unless_forced(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(budget, "LARGEST", 30_000)
    args = (robot_file("stiff_flop"), "-o", tmp_path / "c", "--functions", "pose,jacobian,elastic_force")
    assert codegen(*args) == 5
    said = capsys.readouterr().err
    assert "the largest function is 'jacobian@cap:1'" in said and "--functions" in said and "--force" in said
    assert not list(tmp_path.iterdir())
    assert codegen(*args, "--force") == 0
    monkeypatch.setattr(budget, "LARGEST", 1)
    robot = so.robot(
        {"segments": {"arm": {"type": "revolute", "axis": [0, 1, 0], "body": {"mass": 1, "com": [1, 0, 0]}}}}
    )
    with pytest.raises(budget.TooLarge):
        so.codegen(robot, tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_what_casadi_cannot_export_is_refused():
    x = ca.MX.sym("x")
    solver = ca.rootfinder("solver", "newton", {"x": x, "g": x**2 - 2})
    with pytest.raises(NotExportable, match="CasADi has no C for this"):
        CSource({"eval": solver})


def test_what_keeps_memory_between_calls_is_refused():
    x = ca.MX.sym("x", 2)
    quiet = {"print_header": False, "print_iteration": False, "print_time": False, "qpsol": "qrqp"}
    solver = ca.nlpsol("solver", "sqpmethod", {"x": x, "f": ca.sumsqr(x - 1)}, quiet)
    for function in (solver, ca.Function("outer", [x], [solver(x0=x)["x"]])):
        with pytest.raises(NotExportable, match="keeps memory of its own between calls"):
            CSource({"eval": function})


def test_the_same_code_in_another_real_has_another_hash(odd, tmp_path):
    wanted = ("--functions", "pose@left-arm,pose@left_arm,pose@int,mass")
    assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "d", *wanted) == 0
    assert codegen(odd.parent / "odd.yaml", "-o", tmp_path / "f", *wanted, "--real", "float") == 0
    hashes = [manifest_of(path)["hash"] for path in (odd, tmp_path / "d", tmp_path / "f")]
    assert hashes[0] == hashes[1] != hashes[2]
