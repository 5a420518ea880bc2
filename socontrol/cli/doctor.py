"""`socontrol doctor`: is everything here that a solve needs? Each solver is tried on a tiny real problem."""

import os
import platform
import sys
from importlib import metadata

from socontrol.cli.errors import MISSING_TOOL, say

NEEDED = ("casadi", "numpy", "pydantic", "ruamel.yaml", "pint", "typer", "rich", "matplotlib")
OLDEST = (3, 11)
SOLVERS = {"mumps": True, "spral": False}  # linear solver of Ipopt: whether a solve needs it by default
SPRAL_NEEDS = {"OMP_CANCELLATION": "TRUE", "OMP_PROC_BIND": "TRUE"}  # else SPRAL refuses to factorise


def examine():
    """Print a line for each thing; exit code 8 if a needed one is missing."""
    import socontrol

    missing = []
    _line(f"socontrol {socontrol.__version__}", "ok")
    fine = sys.version_info[:2] >= OLDEST
    _line(f"python {platform.python_version()}", "ok" if fine else f"{OLDEST[0]}.{OLDEST[1]} or newer is needed")
    missing += [] if fine else ["python"]
    for name in NEEDED:
        version = _version(name)
        _line(f"{name} {version or ''}".strip(), "ok" if version else "MISSING")
        missing += [] if version else [name]
    for name, needed in SOLVERS.items() if _version("casadi") and _version("numpy") else ():
        trouble = _tried(name)
        _line(f"ipopt with {name}", trouble or "ok, solved x = 1 on (x - 1)^2")
        missing += [f"ipopt with {name}"] if trouble and needed else []
    _compiler()
    if missing:
        say(f"missing: {', '.join(missing)}; pip install --force-reinstall socontrol brings them")
        return MISSING_TOOL
    return 0


def _line(what, found):
    print(f"{what:<26}{found}")


def _compiler():
    """A line about the C compiler, which nothing needs but the wish for compiled C."""
    from socontrol.native import compiler

    try:
        compiler.library("int answer(void) { return 42; }")
        _line(f"C compiler {compiler.find()}", "ok, for --compiled")
    except compiler.NoCompiler as error:
        _line("C compiler", f"optional, for --compiled: {error}")
    except compiler.CompileError as error:
        _line(f"C compiler {compiler.find()}", f"not usable, optional, for --compiled: {error}")


def _version(package):
    """Version of an installed package, or None."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _tried(linear_solver):
    """What is wrong with Ipopt on this linear solver, or None: minimise (x - 1)^2 under x >= 0."""
    try:
        import casadi as ca

        from socontrol.programs.nlp.program import Program
        from socontrol.programs.nlp.solver import NLP, Ipopt

        program = Program(ca.SX.sym)
        x = program.variable("x", 1, lower=0.0)
        program.constrain("bounded", x, lower=-10.0, upper=10.0)
        program.minimize((x - 1) ** 2)
        outcome = NLP(program, Ipopt(linear_solver=linear_solver, tolerance=1e-8, keep_log=True)).solve()
    except Exception as error:  # whatever a broken installation raises
        return f"not usable: {type(error).__name__}: {' '.join(str(error).split())[:90]}"
    if outcome.status.solved and abs(outcome.values["x"][0] - 1) < 1e-6:
        return None
    unset = [f"{name}={value}" for name, value in SPRAL_NEEDS.items() if os.environ.get(name, "").upper() != value]
    hint = f"; set {' '.join(unset)}" if linear_solver == "spral" and unset else ""
    return f"not usable ({outcome.status.outcome}){hint}"
