"""What the C code costs and how far it is from Python, measured with this machine's compiler where there is one."""

import re
import subprocess
import tempfile
from pathlib import Path

from socontrol.native import c_source, compiler

STACK_FLAGS = ("-std=c99", "-O0", "-fstack-usage", "-S")  # compiles fast; optimised code keeps about as much
MARGIN = 1.5  # the most that gcc -O1 to -O3, clang -O2 and gcc for a Cortex-M7 were seen to need beyond that: 1.3


def stack_bytes(header, source, prefix):
    """Bound of the stack of any call but for what libm needs, or None without a compiler that tells: MARGIN times the
    deepest chain of frames at -O0 on this machine."""
    words = compiler.command()
    if not words:
        return None
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{prefix}.h").write_text(header, encoding="utf-8")
        (Path(folder) / f"{prefix}.c").write_text(source, encoding="utf-8")
        command = [*words, *STACK_FLAGS, f"{prefix}.c", "-o", f"{prefix}.s"]
        try:
            failed = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True).returncode
        except OSError:  # it cannot be started
            return None
        usage = Path(folder) / f"{prefix}.su"
        if failed or not usage.is_file():
            return None
        frames = dict(re.findall(r"(\w+)\t(\d+)\t", usage.read_text(encoding="utf-8")))
    return round(MARGIN * _deepest({name: int(size) for name, size in frames.items()}, source))


def _deepest(frames, source):
    """Largest sum of frames along a chain of calls."""
    calls = {}
    for item in c_source.items_of(source):
        for name in item.defines & frames.keys():
            calls[name] = (item.holds & frames.keys()) - {name}
    depth = {}

    def deep(name):
        if name not in depth:
            depth[name] = frames[name]  # should code call itself: count it once
            depth[name] += max((deep(other) for other in calls.get(name, ())), default=0)
        return depth[name]

    return max(map(deep, calls), default=None)
