"""A generated folder on this machine: built by gcc and clang, run, and its object file looked into."""

import re

from targets.tools import call, must

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
# Functions of CasADi share one signature, whether or not they need integers, reals and memory.
EXCEPTION = "-Wno-unused-parameter"
GRAPH = "-fcallgraph-info=su"  # gcc writes a .ci file beside the object file: who calls whom, and each frame
NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(([a-z,]+)\)"', re.M)
EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', re.M)


def build(compiler, folder, sources, program, flags=()):
    """Compile the sources of a folder into an executable, warnings being errors."""
    files = [folder / source for source in sources]
    must(compiler, *WARNINGS, EXCEPTION, *flags, "-I", folder, *files, "-o", program, "-lm")
    return program


def compile_only(compiler, source, target, flags=(), strict=(*WARNINGS, EXCEPTION)):
    """Compile one source into an object file, warnings being errors."""
    must(compiler, *strict, *flags, "-c", source, "-o", target)
    return target


def symbols(target, *selection):
    """Names in an object file's table: `-u` undefined, `--defined-only -g` public."""
    return {line.split()[-1] for line in must("nm", *selection, target).splitlines() if line.strip()}


def stack(target):
    """Bytes of stack of each public function of an object file compiled with GRAPH, what it calls there included.

    Functions of other files (sin, memset) count nothing. Recursion, calls through pointers and frames of unbounded
    size raise ValueError.
    """
    text = target.with_suffix(".ci").read_text()
    own, callees = {}, {}
    for name, size, kind in NODE.findall(text):
        if kind == "dynamic":
            raise ValueError(f"the frame of {name} has no bound")
        own[name] = int(size)
    for caller, callee in EDGE.findall(text):
        if callee == "__indirect_call":
            raise ValueError(f"{caller} calls through a pointer")
        callees.setdefault(caller, set()).add(callee)

    def depth(name, above=()):
        if name in above:
            raise ValueError(f"{name} calls itself")
        return own.get(name, 0) + max((depth(callee, (*above, name)) for callee in callees.get(name, ())), default=0)

    return {name: depth(name) for name in own if ":" not in name}


def heap_allocations(program):
    """Blocks that a program takes from the heap, counted by valgrind, which must find no error in it."""
    done = call("valgrind", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=all", program)
    if done.returncode:
        raise ValueError(f"exit code {done.returncode} under valgrind\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return int(re.search(r"total heap usage: ([\d,]+) allocs", done.stderr)[1].replace(",", ""))
