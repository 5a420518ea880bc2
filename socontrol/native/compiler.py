"""The C compiler of this machine: $CC, or the first of CANDIDATES, and shared libraries made by it from text."""

import contextlib
import os
import shlex
import shutil
import subprocess
import warnings
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from socontrol.native import cache as kept

CANDIDATES = ("cc", "gcc", "clang")
NATIVE = "-march=native"
# The second makes gcc fuse products and sums where the processor can, which nearly doubles the speed; answers then
# differ from those of the virtual machine in the last digits. -O2 takes twice as long to compile and gains nothing.
FLAGS = ("-O1", "-fexpensive-optimizations", "-fPIC", "-shared", NATIVE)
LOOK = 0.1  # seconds between looks at Ctrl-C and the progress line while the compiler runs
LINES, WIDTH = 3, 200  # of a compiler's message that are passed on


class NoCompiler(RuntimeError):
    """There is no C compiler; the text is a sentence for users."""


class CompileError(RuntimeError):
    """The C compiler failed; the text holds the first lines of its message."""


class CompilerWarning(UserWarning):
    """The C compiler is missing or fails, so that CasADi's virtual machine is used."""


_watching = ContextVar("watching", default=None)


@dataclass
class Watch:
    """What is told of compilations: `show(sentence)` when one begins and every LOOK seconds (it may raise);
    `failures`: sentences about those that failed."""

    show: Any
    failures: list = field(default_factory=list)


@contextlib.contextmanager
def watched(show=None):
    """While entered, compilations are told to a Watch."""
    watch = Watch(show or (lambda sentence: None))
    token = _watching.set(watch)
    try:
        yield watch
    finally:
        _watching.reset(token)


def failed(error):
    """Say in a CompilerWarning, once a process, that the virtual machine stands in for what failed to compile."""
    sentence = f"{error}; CasADi's virtual machine is used instead: same answers, slower"
    if watch := _watching.get():
        watch.failures.append(sentence)
    _warn(sentence)


@cache
def _warn(sentence):
    warnings.warn(sentence, CompilerWarning, stacklevel=4)


def find():
    """Path of the C compiler, or None."""
    found = command()
    return found[0] if found else None


def command():
    """The C compiler's path and the words that $CC may give with it; empty where there is none."""
    try:
        given = shlex.split(os.environ.get("CC", ""))
    except ValueError:
        return ()
    for name in given[:1] or CANDIDATES:
        path = shutil.which(name)
        if path:
            return (path, *given[1:])
    return ()


def version():
    """What the C compiler calls itself, one line; raises NoCompiler."""
    return _version(_needed())


def library(text, *, flags=FLAGS):
    """Path of a shared library of C text, made once and kept; raises NoCompiler or CompileError."""
    words = _needed()
    name = kept.key(text, *flags, *words, _version(words), kept.machine(NATIVE in flags))
    folder = kept.folder()
    try:
        return kept.found(name, folder) or kept.keep(name, folder, lambda part: _compiled(words, text, flags, part))
    except OSError as error:
        raise CompileError(f"nothing can be kept in {folder}: {error.strerror or error}") from None


def _needed():
    if words := command():
        return words
    if os.environ.get("CC"):
        missing = f"the C compiler that CC names, '{os.environ['CC']}', is not found"
    else:
        missing = f"no C compiler is found ({', '.join(CANDIDATES)}); install gcc or clang"
    raise NoCompiler(missing)


@cache
def _version(command):
    try:
        done = subprocess.run(
            [*command, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace"
        )
    except OSError:
        return "of unknown version"
    return (done.stdout.strip().splitlines() or ["of unknown version"])[0]


def _compiled(command, text, flags, folder):
    """Path of a library compiled in a folder; without NATIVE where the compiler does not know it."""
    source, made = folder / "code.c", folder / "code.so"
    source.write_text(text, encoding="utf-8")
    arguments = [str(source), "-o", str(made), "-lm"]
    try:
        trouble = _run([*command, *flags, *arguments])
        if trouble and NATIVE in flags:
            others = [flag for flag in flags if flag != NATIVE]
            trouble = _run([*command, *others, *arguments]) and trouble
    except OSError as error:  # it cannot be started
        trouble = str(error.strerror or error)
    if not trouble and not made.is_file():
        trouble = "it said nothing and wrote nothing"
    if trouble:
        raise CompileError(f"{Path(command[0]).name} failed: {trouble}")
    return made


def _run(command):
    """What the compiler says where it fails, or ''. Ctrl-C and what `watched` shows may end it early."""
    watch = _watching.get()
    show = watch.show if watch else lambda sentence: None
    show("compiling C")
    # In a session of its own, so that Ctrl-C reaches this process alone, which then ends the compiler.
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        while True:
            try:
                said = process.communicate(timeout=LOOK)[1]
                break
            except subprocess.TimeoutExpired:
                show("compiling C")
    except BaseException:
        _end(process)
        raise
    if process.returncode == 0:
        return ""
    lines = [line.strip()[:WIDTH] for line in said.decode(errors="replace").splitlines() if line.strip()]
    return "; ".join(lines[:LINES]) or f"exit code {process.returncode}"


def _end(process):
    """End the compiler and the programs it has started."""
    with contextlib.suppress(OSError):
        os.killpg(process.pid, 9)
    process.communicate()
