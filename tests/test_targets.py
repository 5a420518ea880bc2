"""Generated C on its targets: gcc and clang at every level, C++, sanitizers, valgrind, and a bare-metal Cortex-M7.

Every test builds a folder written by the command line; the numbers its selftest compares with come from Python.
"""

import json
import re
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from targets import cortex_m7, host
from targets.tools import call, must, need

from socontrol import cli

ROOT = Path(__file__).parent.parent
ROBOTS = ROOT / "configs" / "robots"
ARM = """
schema_version: 1
name: arm
segments:
  shoulder:
    type: revolute
    axis: [0, 1, 0]
    stiffness: 0.4
    limits: [-0.8, 0.8]
    body: {mass: 0.1, com: [0.02, 0, 0], inertia: [1e-5, 1e-5, 1e-5]}
    tip: {position: [0.05, 0, 0]}
  rod:
    type: rod
    parent: shoulder
    length: 0.1
    strains: [bend_y, bend_z]
    quadrature: 2
    cross_section: {type: circle, radius: 0.01}
    material: {type: linear, young_modulus: 0.2 MPa, poisson_ratio: 0.5, density: 1000, viscosity: 100}
  cap:
    type: fixed
    parent: rod
    body: {mass: 0.01, com: [0.005, 0, 0], inertia: [1e-7, 1e-7, 1e-7]}
    tip: {position: [0.01, 0, 0]}
actuators:
  motor: {type: joint_torque, joint: shoulder, limits: [-1, 1]}
  tendon: {type: tendon, along: [rod], offset: [8 mm, 0], limits: [0, 5 N]}
  chamber: {type: chamber, along: [rod], offset: [[0, 6 mm]], area: 20 mm^2, limits: [0, 50 kPa]}
loads:
  tip: {type: wrench, on: cap, force: [0, 0.02, 0], axes: world}
"""
REACH = """
schema_version: 1
type: inverse_statics
robot: arm.yaml
goals:
  tip: {type: point, on: cap, target: [0.15, null, 0.02]}
"""
QUESTIONS = {  # folder: (robot or problem file, or the text of one, further words of the command line)
    "arm": (ARM, ()),
    "arm_float": (ARM, ("--real", "float")),
    "arm_reach": (REACH, ()),
    "two_modules": (ROOT / "problems" / "stiff_flop_two_modules_tip.yaml", ()),  # a whole inverse-statics solver
    "stiff_flop": (ROBOTS / "stiff_flop.yaml", ("--functions", "pose,jacobian,static_residual,inverse_dynamics")),
}
LIBRARY = {  # what the code may take from the C library: mathematics and moving of memory
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "pow", "sqrt"),
    *("sincos", "fabs", "fmax", "fmin", "fmod", "floor", "ceil", "copysign", "log1p", "expm1", "hypot"),
    *("memcpy", "memset", "memmove"),
}
LIBRARY |= {f"{name}f" for name in LIBRARY}
LEVELS = ["-O0", "-O1", "-O2", "-O3"]


@dataclass(frozen=True)
class Generated:
    """A generated folder: its path, the stem of its C file and its manifest."""

    path: Path
    name: str
    manifest: dict

    @property
    def source(self):
        return self.path / f"{self.name}.c"

    @property
    def selftest(self):
        return [f"{self.name}.c", "selftest.c"]


def generate(question, target):
    """Write a folder through the command line."""
    path, words = QUESTIONS[question]
    if isinstance(path, str):
        (target.parent / "arm.yaml").write_text(ARM)
        text, path = path, target.parent / f"{question}.yaml"
        path.write_text(text)
    assert cli.run(["codegen", str(path), "-o", str(target), *words]) == 0
    names = [source.stem for source in target.glob("*.c") if source.stem not in ("main", "selftest")]
    assert len(names) == 1, "one C file beside the example and the self-test"
    return Generated(target, names[0], json.loads((target / "manifest.json").read_text()))


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """A maker of folders of the table, each written once."""
    return cache(lambda question: generate(question, tmp_path_factory.mktemp(question) / "c"))


@pytest.fixture(scope="module", params=QUESTIONS)
def folder(request, generated):
    """Each folder of the table."""
    return generated(request.param)


@pytest.fixture(scope="module")
def arm(generated):
    """The smallest folder, for what is tried many times."""
    return generated("arm")


@pytest.fixture(scope="module", params=["arm", "arm_reach"])
def small(request, generated):
    """Functions, and a solver, that compile at once: for what is tried at every level."""
    return generated(request.param)


@cache
def library(compiler, source, level="-O1"):
    """Object file of a generated source, compiled once; gcc writes its call graph beside it."""
    flags = (level, host.GRAPH) if compiler == "gcc" else (level,)
    return host.compile_only(compiler, source, source.parent.parent / f"{source.stem}-{compiler}{level}.o", flags)


# Compilers

@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_self_test_passes_at_every_level_of_every_compiler(small, tmp_path, compiler, level):
    need(compiler)
    files = ["selftest.c", library(compiler, small.source, level)]
    must(host.build(compiler, small.path, files, tmp_path / "selftest"))


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_self_test_of_every_folder_passes(folder, tmp_path, compiler):
    need(compiler)
    files = ["selftest.c", library(compiler, folder.source)]
    must(host.build(compiler, folder.path, files, tmp_path / "selftest"))


@pytest.mark.parametrize("standard", ["c11", "c17"])
def test_later_standards_take_the_source_too(folder, tmp_path, standard):
    need("gcc")
    host.compile_only("gcc", folder.source, tmp_path / "x.o", (f"-std={standard}", "-fsyntax-only"))


def test_a_wrong_number_fails_the_self_test(arm, tmp_path):
    need("gcc")
    spoil(arm, tmp_path)
    done = call(host.build("gcc", tmp_path, arm.selftest, tmp_path / "selftest", ("-O0",)))
    assert done.returncode == 1


def spoil(generated, target):
    """Copy a folder with one sine of its code turned into a cosine."""
    for path in generated.path.glob("*.[ch]"):
        shutil.copy(path, target)
    text = generated.source.read_text()
    assert re.search(r"\bsin\(", text)
    (target / generated.source.name).write_text(re.sub(r"\bsin\(", "cos(", text, count=1))


def test_source_and_header_compile_as_cpp(folder, tmp_path):
    need("g++")
    strict = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", host.EXCEPTION, "-std=c++11", "-x", "c++")
    host.compile_only("g++", folder.source, tmp_path / "library.o", strict=strict)
    user = tmp_path / "user.cpp"
    user.write_text(f'#include "{folder.name}.h"\n#include "{folder.name}.h"\nint main() {{ return 0; }}\n')
    host.compile_only("g++", user, tmp_path / "user.o", ("-I", folder.path), strict=strict)


def test_a_cpp_program_calls_the_c_library(arm, tmp_path):
    need("g++", "gcc")
    user = tmp_path / "user.cpp"
    user.write_text(
        f'#include "{arm.name}.h"\n#include <cmath>\nint main() {{\n'
        "    double q[ARM_N] = {0}, pose[16];\n"
        "    if (arm_pose(q, pose) != ARM_OK) return 1;\n"
        "    return std::fabs(pose[3] - 0.16) < 1e-12 ? 0 : 2;\n}\n"
    )
    files = [user, library("gcc", arm.source)]
    must("g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-I", arm.path, *files, "-o", tmp_path / "user")
    must(tmp_path / "user")


def test_two_robots_live_in_one_program(arm, tmp_path):
    need("gcc")
    other = tmp_path / "other.yaml"
    other.write_text(ARM.replace("name: arm", "name: other"))
    assert cli.run(["codegen", str(other), "-o", str(tmp_path / "c"), "--functions", "pose,mass"]) == 0
    main = tmp_path / "user.c"
    main.write_text('#include "arm.h"\n#include "other.h"\nint main(void) { return ARM_N != OTHER_N; }\n')
    sources = [library("gcc", arm.source), tmp_path / "c" / "other.c", main]
    headers = ("-I", arm.path, "-I", tmp_path / "c")
    must("gcc", *host.WARNINGS, host.EXCEPTION, *headers, *sources, "-o", tmp_path / "user", "-lm")
    must(tmp_path / "user")


# Memory

SANITIZERS = [
    ("gcc", "address,undefined"),
    ("clang", "address,undefined"),
    ("clang", "memory"),
]


@pytest.mark.parametrize(("compiler", "checks"), SANITIZERS, ids=lambda word: word)
def test_sanitizers_find_nothing(small, tmp_path, compiler, checks):
    need(compiler)
    flags = ("-O1", "-g", f"-fsanitize={checks}", "-fno-sanitize-recover=all")
    must(host.build(compiler, small.path, small.selftest, tmp_path / "selftest", flags))


def test_valgrind_finds_nothing_and_the_heap_holds_the_output_buffer_alone(small, tmp_path):
    need("gcc", "valgrind")
    files = ["selftest.c", library("gcc", small.source)]
    assert host.heap_allocations(host.build("gcc", small.path, files, tmp_path / "selftest")) <= 1


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_object_needs_the_mathematics_library_alone(folder, compiler):
    need(compiler)
    target = library(compiler, folder.source)
    assert host.symbols(target, "-u") <= LIBRARY
    public = host.symbols(target, "--defined-only", "-g")
    assert public and all(name.startswith(f"{folder.name}_") for name in public)


@pytest.mark.parametrize("level", LEVELS)
def test_the_stack_is_bounded_by_the_manifest(small, level):
    need("gcc")
    assert max(host.stack(library("gcc", small.source, level)).values()) <= small.manifest["stack_bytes"]


# A Cortex-M7 without an operating system

def test_the_self_test_passes_on_a_cortex_m7(folder):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    code, output, sizes = cortex_m7.run(folder.path, folder.selftest)
    assert code == 0, output
    flash, memory = sizes["text"] + sizes["data"], sizes["data"] + sizes["bss"] + sizes["stack"]
    if "solver" in folder.manifest:  # for two modules
        assert flash < 512 * 1024 and memory < 256 * 1024
        assert sizes[folder.source.name]["bss"] <= folder.manifest["static_bytes"]  # pointers are half as wide here
    assert flash < 2**21 and memory < 2**20  # an STM32H743: 2 MB and 1 MB


def test_a_wrong_number_fails_on_a_cortex_m7(arm, tmp_path):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    spoil(arm, tmp_path)
    assert cortex_m7.run(tmp_path, arm.selftest, flags=("-O0",))[0] == 1


def test_a_fault_on_the_cortex_m7_is_told(tmp_path):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    (tmp_path / "fault.c").write_text("int main(void) { return *(volatile int *)0xF0000000u; }\n")
    assert cortex_m7.run(tmp_path, ["fault.c"])[0] == 125


def test_the_example_prints_the_same_numbers_on_both_machines(arm, tmp_path):
    need("gcc", "arm-none-eabi-gcc", "qemu-system-arm")
    sources = [arm.source.name, "main.c"]
    code, output, _ = cortex_m7.run(arm.path, sources)
    here = must(host.build("gcc", arm.path, ["main.c", library("gcc", arm.source)], tmp_path / "example"))
    assert code == 0 and numbers(output) == pytest.approx(numbers(here), rel=1e-12, abs=1e-15)
    assert 0.16 in [round(value, 12) for value in numbers(here)], "the straight arm is 0.16 m long"


def numbers(text):
    """Every number of a text."""
    return [float(word) for word in re.findall(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)]


def test_single_precision_calls_nothing_of_double_precision(generated, tmp_path):
    need("arm-none-eabi-gcc")
    single = generated("arm_float")
    flags = ("-O1", "-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard")  # doubles would be emulated
    names = host.symbols(host.compile_only("arm-none-eabi-gcc", single.source, tmp_path / "library.o", flags), "-u")
    assert names and all(name.endswith("f") or name.startswith("mem") for name in names), names


def test_calls_on_the_cortex_m7_stay_within_the_bound_of_its_stack(arm, tmp_path):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    flags = ("-O1", host.GRAPH, *cortex_m7.CPU)
    bound = host.stack(host.compile_only("arm-none-eabi-gcc", arm.source, tmp_path / "library.o", flags))
    measured = cortex_m7.measure(arm.path, arm.source.name)
    assert measured.keys() == bound.keys()
    for name, figures in measured.items():
        assert figures["code"] == 0 and 0 < figures["stack"] <= bound[name] + 256, name  # libm takes up to 256


def test_cmake_builds_and_tests_for_the_cortex_m7(arm, tmp_path):
    need("cmake", "make", "arm-none-eabi-gcc", "qemu-system-arm")
    toolchain = arm.path / "cortex_m7" / "toolchain.cmake"
    must("cmake", "-S", arm.path, "-B", tmp_path, f"-DCMAKE_TOOLCHAIN_FILE={toolchain}")
    must("cmake", "--build", tmp_path)
    output = must("ctest", "--test-dir", tmp_path, "--output-on-failure")
    assert "100% tests passed" in output
