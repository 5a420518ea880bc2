"""Every shipped robot and every statics problem as C: the self-tests of their folders, by one command.

    python tests/benchmarks/selftests.py [FILE ...]    (default: configs/robots/*.yaml, and statics in problems/)

Compiles each folder with the C compiler at -O1 and runs its self-test, whose numbers come from Python: bytes of C,
seconds of the compiler, functions left out by default, the worst difference.
"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import socontrol as so
from socontrol.codegen.budget import TooLarge
from socontrol.native import compiler

ROOT = Path(__file__).parents[2]
RESULT = re.compile(r"difference\s+(\S+), allowed\s+(\S+): (\w+)")


def files():
    """Robots, and problems of the types that are exported."""
    robots = sorted((ROOT / "configs" / "robots").glob("*.yaml"))
    problems = sorted((ROOT / "problems").glob("*.yaml"))
    return robots + [p for p in problems if re.search(r"^type: (inverse_)?statics$", p.read_text(), re.MULTILINE)]


def tried(path, folder):
    """(whether all checks passed, line of the table) of one file."""
    began = time.perf_counter()
    try:
        written = so.codegen(path, folder)
    except TooLarge as error:
        return False, f"refused: {error}"
    made = time.perf_counter() - began
    name, out = written.manifest["prefix"], folder / "selftest"
    began = time.perf_counter()
    command = [compiler.find(), "-std=c99", "-O1", f"{name}.c", "selftest.c", "-lm", "-o", str(out)]
    subprocess.run(command, cwd=folder, check=True)
    compiled = time.perf_counter() - began
    done = subprocess.run([str(out)], capture_output=True, text=True)
    worst = max(float(d) for d, allowed, _ in RESULT.findall(done.stdout) if float(allowed) < 1e-6)
    left = f"; left out: {', '.join(written.manifest['left_out'])}" if written.manifest["left_out"] else ""
    size = written.manifest["c_bytes"] / 1e3
    said = "passed" if done.returncode == 0 else f"FAILED\n{done.stdout}"
    times = f"{size:7.0f} kB, written in {made:4.1f} s, gcc {compiled:5.1f} s"
    return done.returncode == 0, f"{times}, worst {worst:.1e}, {said}{left}"


def main(arguments):
    failed = 0
    for path in map(Path, arguments or files()):
        with tempfile.TemporaryDirectory() as scratch:
            good, line = tried(path, Path(scratch) / "c")
        failed += not good
        print(f"{path.parent.name}/{path.stem:<30}{line}", flush=True)
    return min(1, failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
