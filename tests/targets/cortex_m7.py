"""A generated folder on a bare-metal Cortex-M7: built with newlib, run in QEMU's mps2-an500, sized and measured.

    code, output, sizes = run(folder, ["stiff_flop.c", "selftest.c"])
"""

import re
import tempfile
from pathlib import Path

from targets.tools import call, must

import socontrol

BOARD = Path(socontrol.__file__).parent / "codegen" / "templates" / "cortex_m7"
HERE = Path(__file__).parent
CPU = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
COMPILE = (*CPU, "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-parameter")
LINK = ("--specs=rdimon.specs", "-nostartfiles", "-T", BOARD / "mps2_an500.ld", "-Wl,--gc-sections")
EMULATOR = (  # -icount: each instruction takes a nanosecond of the board's clock, so that time counts instructions
    *("qemu-system-arm", "-M", "mps2-an500", "-display", "none", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native", "-icount", "shift=0"),
)
STACK_LINE = re.compile(r"^stack used (\d+) bytes\n", re.M)
PROTOTYPE = re.compile(r"^int (\w+)\(([^)]*\w\[[^)]*)\);", re.M)
ARGUMENT = re.compile(r"(const )?(double|float) \w+\[(\w+)\]")


def run(folder, sources, defines=(), flags=("-O1",)):
    """Build the sources with each of `defines` (NAME or NAME=VALUE) and run the program: (exit code, output, sizes).

    Sizes are bytes: {"text", "data", "bss"} of the whole program, its C library included, "stack" used by `main` and
    what it calls, painted and read back at its end, and by source {"NAME.c": {"text", "data", "bss"}}.
    Exit code 125 is a processor fault.
    """
    with tempfile.TemporaryDirectory() as scratch:
        program, sizes = build(folder, sources, defines, flags, Path(scratch))
        done = call(*EMULATOR, "-kernel", program)
    line = STACK_LINE.search(done.stdout)
    sizes["stack"] = int(line[1]) if line else None
    return done.returncode, STACK_LINE.sub("", done.stdout) + done.stderr, sizes


def measure(folder, source, flags=("-O1",)):
    """{function: {"code", "instructions", "stack"}} of one call, at zeros, of each function in the source's header.

    Instructions are those QEMU executes, libm's included, to 40; the stack is in bytes, libm's included.
    """
    header = Path(folder, source).with_suffix(".h")
    calls, arrays = [], []
    for name, arguments in PROTOTYPE.findall(header.read_text()):
        places = []
        for const, kind, size in ARGUMENT.findall(arguments):
            places.append(f"a{len(arrays)}")
            arrays.append(f"static {const}{kind} a{len(arrays)}[{size}];")
        calls.append(f'    MEASURE("{name}", {name}({", ".join(places)}));')
    lines = ['#include "measure.h"', f'#include "{header.name}"', *arrays]
    lines += ["int main(void) {", *calls, "    return 0;", "}"]
    with tempfile.TemporaryDirectory() as scratch:
        main = Path(scratch, "measure.c")
        main.write_text("\n".join(lines) + "\n")
        code, output, _ = run(folder, [source, main], flags=flags)
    if code:
        raise ValueError(f"exit code {code}\n{output}")
    rows = [line.split() for line in output.splitlines()]
    return {name: dict(zip(("code", "instructions", "stack"), map(int, row), strict=True)) for name, *row in rows}


def build(folder, sources, defines, flags, scratch):
    """(Executable, sizes as in `run` without the stack) of the sources, with a report of the stack linked in."""
    options = [*COMPILE, *flags, *(f"-D{name}" for name in defines), "-I", folder, "-I", HERE]
    objects = []
    for source in [*(Path(folder) / source for source in sources), HERE / "stack_report.c", BOARD / "startup.c"]:
        objects.append(scratch / f"{source.stem}.o")
        must("arm-none-eabi-gcc", *options, "-c", source, "-o", objects[-1])
    program = scratch / "program.elf"
    must("arm-none-eabi-gcc", *CPU, *flags, *LINK, *objects, "-o", program, "-lm")
    by_source = {Path(source).name: size(target) for source, target in zip(sources, objects, strict=False)}
    return program, {**size(program), **by_source}


def size(target):
    """{"text", "data", "bss"} of an object file or program, in bytes."""
    figures = must("arm-none-eabi-size", target).splitlines()[1].split()
    return dict(zip(("text", "data", "bss"), map(int, figures[:3]), strict=True))
