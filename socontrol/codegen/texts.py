"""The files of a folder as texts, from its parts."""

import json
import string
from importlib import resources

import socontrol
from socontrol.codegen import budget
from socontrol.codegen.ctext import comment

BOARD = "cortex_m7"  # templates of a bare-metal board, copied as they are
SHARED = "Functions share a static workspace: call them from one thread, not from an interrupt of one another."
WITH_SLOTS = """Plain functions share a static workspace: call them from one thread, not from an interrupt of one
 * another. A solver's solve works in the slot of its struct: it may run in several threads, one struct each; call init
 * and release from one thread."""
BOARDS = """
or for a Cortex-M7 (the lines are in cortex_m7/toolchain.cmake), which ctest runs in QEMU.
"""


def header(folder):
    """NAME.h."""
    names = folder.names
    parts = "\n".join(part.header(names) for part in folder.parts)
    rows = folder.codes
    width = max(len(names.macro(code)) for code in rows)
    codes = [
        f"    {names.macro(code):<{width}} = {k}{',' * (k < len(rows) - 1)} {comment(text).rstrip()}"
        for k, (code, text) in enumerate(rows.items())
    ]
    slots = any(part.functions and not part.shares for part in folder.parts)  # workspaces beside the shared one
    return _filled("header.h", folder, declarations=parts, codes="\n".join(codes), ok=names.macro("OK"),
                   guard=f"{names.prefix}_H".upper(), threads=WITH_SLOTS if slots else SHARED)  # fmt: skip


def source(folder, code):
    """NAME.c."""
    definitions = "\n".join(part.source(folder.names, code) for part in folder.parts)
    return _filled("source.c", folder, casadi=code.text, workspace=_workspace(folder, code), definitions=definitions)


def _workspace(folder, code):
    iw, w = workspace(folder, code)
    lines = [f"static casadi_int integers[{iw}];\n"] if iw else []
    lines += [f"static casadi_real reals[{w}];\n"] if w else []
    return "".join(lines) and "/* The workspace that all functions share. */\n" + "".join(lines) + "\n"


def workspace(folder, code):
    """Lengths of the shared workspace: integers, reals."""
    sizes = [code.sizes[name] for part in folder.parts for name in part.shares]
    return max((s.iw for s in sizes), default=0), max((s.w for s in sizes), default=0)


def selftest(folder):
    """selftest.c."""
    checks = [part.selftest(folder.names) for part in folder.parts]
    calls = "".join(f"    failed += {call}();\n" for check in checks for call in check.calls)
    return _filled("selftest.c", folder, checks="\n".join(check.text for check in checks), calls=calls.rstrip("\n"))


def example(folder):
    """main.c."""
    examples = [part.example(folder.names) for part in folder.parts]
    blocks = ["    {\n" + "".join(f"    {line}\n" for line in e.splitlines()) + "    }\n" for e in examples if e]
    return _filled("main.c", folder, examples="".join(blocks))


def readme(folder, code, static, stack):
    """README."""
    told = f" and at most {stack} of stack" if stack else ""
    seconds = f"{max(1, budget.total_seconds(code)):.0f}"
    other = BOARDS if boards() else ""
    return _filled("README", folder, seconds=seconds, static=str(static), stack=told, boards=other)


def cmake(folder):
    """CMakeLists.txt."""
    return _filled("CMakeLists.txt", folder)


def boards():
    """{path in the folder: text} of the board's files."""
    home = resources.files("socontrol.codegen") / "templates" / BOARD
    if not home.is_dir():
        return {}
    files = sorted((f for f in home.iterdir() if f.is_file()), key=lambda f: f.name)
    return {f"{BOARD}/{f.name}": f.read_text(encoding="utf-8") for f in files}


def manifest(content):
    """manifest.json."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _filled(template, folder, **values):
    text = (resources.files("socontrol.codegen") / "templates" / "folder" / template).read_text(encoding="utf-8")
    title = comment(folder.title).strip().removeprefix("/* ").removesuffix(" */")
    return string.Template(text).substitute(
        prefix=folder.names.prefix, real=folder.names.real, title=title, version=socontrol.__version__, **values
    )
