"""The command line. Commands load what they need when they run, so that `socontrol --help` answers at once.

Exit codes: 0 solved, 1 unexpected, 2 usage or path, 3 bad file, 4 infeasible, 5 limit, 6 numerical,
7 verification failed, 8 missing tool, 130 interrupted; of several problems the largest.
"""

import errno
import os
import sys
import warnings
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="socontrol",
    help="Inverse statics of robots made of rigid links, soft rods or both, from YAML files.",
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
Files = Annotated[list[Path], typer.Argument(help="YAML files.", show_default=False)]
Problems = Annotated[list[Path], typer.Argument(help="Problem files.", show_default=False)]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="a.b=VALUE", help="Replace a value of the file, or of the robot or solver it names."),
]
Verbose = Annotated[
    int,
    typer.Option("-v", "--verbose", count=True, show_default=False, help="Print more (-vv: all), and tracebacks."),
]
Output = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results, one folder a problem.")]


class Family(StrEnum):
    """What `list` can show."""

    joints = "joints"
    rods = "rods"
    sections = "sections"
    materials = "materials"
    loads = "loads"
    actuators = "actuators"
    goals = "goals"
    costs = "costs"
    histories = "histories"
    solvers = "solvers"
    problems = "problems"


class FileKind(StrEnum):
    """Files that have a schema."""

    robot = "robot"
    problem = "problem"


class Real(StrEnum):
    """Types of numbers in C."""

    double = "double"
    float = "float"


def version(wanted: bool):
    if wanted:
        import socontrol

        print(f"socontrol {socontrol.__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version.")
    ] = False,
):
    pass


@app.command()
def solve(
    problems: Problems,
    output: Output = Path("results"),
    json: Annotated[bool, typer.Option("--json", help="Print results as one JSON document.")] = False,
    set_: Overrides = None,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Draw nothing.")] = False,
    verify: Annotated[bool, typer.Option("--verify", help="Fail (7) where `expect:` is missed.")] = False,
    compiled: Annotated[bool, typer.Option("--compiled", help="Through compiled C: for long work.")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    verbose: Verbose = 0,
):
    """Solve problems and write a result folder for each."""
    from socontrol.cli.solve import Settings, solve_all

    settings = Settings(output, json, tuple(set_ or ()), not no_figures, verify, quiet, verbose, compiled)
    return solve_all(problems, settings)


@app.command()
def check(files: Files, set_: Overrides = None, verbose: Verbose = 0):
    """Say whether robot, problem and solver files are sound."""
    from socontrol.cli.check import check_all

    return check_all(files, tuple(set_ or ()))


@app.command("list")
def list_(kind: Annotated[Family | None, typer.Argument(help="Default: all.", show_default=False)] = None):
    """Show the kinds of joints, sections, loads, goals ..."""
    from socontrol.cli.kinds import show_family

    return show_family(kind.value if kind else None)


@app.command()
def schema(kind: Annotated[FileKind, typer.Argument(help="Kind of file.", show_default=False)]):
    """Print the JSON Schema of a kind of file, for editors."""
    from socontrol.files.schemas import schema_text

    print(schema_text(kind.value), end="")
    return 0


@app.command()
def codegen(
    file: Annotated[Path, typer.Argument(help="A robot or problem file.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the C code.", show_default=False)],
    functions: Annotated[
        str | None,
        typer.Option(help="Names with commas between them: mass, pose, pose@SEGMENT:X ... (a robot's default: all)."),
    ] = None,
    real: Annotated[Real, typer.Option(help="Type of the numbers; float for a robot's functions only.")] = Real.double,
    force: Annotated[bool, typer.Option("--force", help="Write code beyond the budgets of size and time.")] = False,
    set_: Overrides = None,
    verbose: Verbose = 0,
):
    """Write a folder of C code for a controller."""
    from socontrol.cli.codegen import export

    return export(file, output, functions, real.value, force, tuple(set_ or ()))


@app.command()
def plot(
    result: Annotated[Path, typer.Argument(help="A result folder.", show_default=False)],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for the figures.")] = None,
    gif: Annotated[bool, typer.Option("--gif", help="Write motion.gif of a simulation, and no figures.")] = False,
    verbose: Verbose = 0,
):
    """Draw the figures of a result again, or its motion."""
    from socontrol.cli.plot import draw_again

    return draw_again(result, output or result, gif)


@app.command()
def new(folder: Annotated[Path, typer.Argument(help="Where to write.")] = Path(".")):
    """Write a robot and a problem to start from."""
    from socontrol.cli.new import write_starter

    return write_starter(folder)


@app.command()
def doctor():
    """Check packages and solvers, by a tiny solve each."""
    from socontrol.cli.doctor import examine

    return examine()


def main(arguments=None):
    """Run the command line and leave with its exit code; every error is one line on stderr."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        getattr(sys, name).reconfigure(errors="replace")  # an old terminal may not have every sign
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments):
    """Exit code of one command."""
    from socontrol.cli.errors import interrupted, say, unexpected

    warnings.filterwarnings("ignore", category=RuntimeWarning)  # overflow on the way; what comes out is checked
    try:
        code = app(args=list(arguments) or ["--help"], prog_name="socontrol", standalone_mode=False)
        sys.stdout.flush()
        return code or 0
    except BrokenPipeError:  # what reads our output has gone: say nothing more
        sys.stdout = None
        return 0
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            say("the output cannot be written: no space left")
            return 2
        if interrupted(error):
            say("interrupted")
            return 130
        if hasattr(error, "format_message"):  # a mistake in the usage, in typer's own words
            say(error.format_message().replace("Value error, ", "").rstrip(".") + "; see socontrol --help")
            return 2
        return unexpected(error, bool({"-v", "-vv", "--verbose"} & set(arguments)))
