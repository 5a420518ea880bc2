"""Compilers, checkers and the emulator: found, or the test is skipped with a sentence; in CI a missing one fails."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

PACKAGES = {  # the Debian package of each program
    "arm-none-eabi-gcc": "gcc-arm-none-eabi, libnewlib-arm-none-eabi",
    "cmake": "cmake",
    "clang": "clang, libclang-rt-dev",
    "g++": "g++",
    "gcc": "gcc, libc6-dev",
    "make": "make",
    "qemu-system-arm": "qemu-system-arm",
    "valgrind": "valgrind",
}
SECONDS = 300  # no command here takes more; one that hangs ends


def need(*programs):
    """Skip the test where a program is missing, naming it and its Debian package; fail it where CI=true."""
    missing = [program for program in programs if not shutil.which(program)]
    if not missing:
        return
    sentence = "; ".join(f"{program} is not installed (Debian: {PACKAGES[program]})" for program in missing)
    if os.environ.get("CI") == "true":
        pytest.fail(sentence)
    pytest.skip(sentence)


def call(*command, folder=None, environment=None):
    """Run a command without standard input; its CompletedProcess, with text of both outputs, whatever its exit code."""
    env = {**os.environ, "LC_ALL": "C", **(environment or {})}
    command = [str(word) for word in command]
    return subprocess.run(
        command, cwd=folder, env=env, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=SECONDS
    )


def must(*command, folder=None, environment=None):
    """Output of a command that has to end with exit code 0; the test fails with what it printed otherwise."""
    done = call(*command, folder=folder, environment=environment)
    if done.returncode:
        words = " ".join(Path(word).name if "/" in word else word for word in map(str, command))
        pytest.fail(f"exit code {done.returncode} of {words}\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
    return done.stdout
