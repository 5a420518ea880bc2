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
    help="Statics, motions and plans of robots made of rigid links, soft rods or both, from YAML files.",
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
    routes = "routes"
    loops = "loops"
    goals = "goals"
    costs = "costs"
    plan_costs = "plan_costs"
    obstacles = "obstacles"
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
def plan(
    robot: Annotated[Path, typer.Argument(help="A robot file.", show_default=False)],
    to: Annotated[
        list[str],
        typer.Option(metavar="NAME=X,Y,Z", help="Where the end of a segment (or `tip`) goes, or COORDINATE=VALUE."),
    ],
    duration: Annotated[str, typer.Option(metavar="TIME", help="Seconds, or SHORTEST..LONGEST where it is free.")],
    start: Annotated[str, typer.Option("--from", metavar="rest|NAME=VALUE,..", help="Shape at the start.")] = "rest",
    via: Annotated[
        list[str] | None,
        typer.Option(metavar="TIME:NAME=X,Y,Z", help="Where it passes; TIME in seconds, or a share such as 50%."),
    ] = None,
    avoid: Annotated[
        list[str] | None, typer.Option(metavar="KIND:NUMBERS", help="Obstacle, e.g. sphere:X,Y,Z,RADIUS.")
    ] = None,
    minimise: Annotated[
        list[str] | None, typer.Option(metavar="COST[=WEIGHT]", help="effort (the default), time, input_rate ...")
    ] = None,
    limit_rate: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Largest rate of an input or a coordinate.")
    ] = None,
    quasi_static: Annotated[bool, typer.Option("--quasi-static", help="Equilibrium at all times, no masses.")] = False,
    water: Annotated[
        str | None, typer.Option(metavar="DENSITY", help="Under water of this density, at rest; default: in air.")
    ] = None,
    intervals: Annotated[int | None, typer.Option(help="Intervals of the mesh.", show_default=False)] = None,
    scheme: Annotated[str | None, typer.Option(help="radau, lobatto ...", show_default=False)] = None,
    points: Annotated[int | None, typer.Option(help="Points in an interval.", show_default=False)] = None,
    name: Annotated[str | None, typer.Option(help="Name of the problem; without --save, of its folder too.")] = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the problem file too.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file of --save.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Solve nothing; without --save print the file.")] = False,
    output: Output = Path("results"),
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")] = False,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Draw nothing.")] = False,
    compiled: Annotated[bool, typer.Option("--compiled", help="Through compiled C: for long work.")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    verbose: Verbose = 0,
):
    """Plan a motion of a robot and write a result folder."""
    from socontrol.cli.plan import Saving, plan_motion
    from socontrol.cli.plan_flags import Flags
    from socontrol.cli.solve import Settings

    flags = Flags(
        start=start, to=tuple(to), duration=duration, avoid=tuple(avoid or ()), via=tuple(via or ()),
        intervals=intervals, scheme=scheme, points=points, minimise=tuple(minimise or ()),
        limit_rate=tuple(limit_rate or ()), quasi_static=quasi_static, water=water,
    )  # fmt: skip
    settings = Settings(output, json, (), not no_figures, False, quiet, verbose, compiled)
    return plan_motion(robot, flags, Saving(save, name, force, dry_run), settings)


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
    gif: Annotated[bool, typer.Option("--gif", help="Write motion.gif of a motion, and no figures.")] = False,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write a planned motion as a table, and no figures.")
    ] = None,
    every: Annotated[
        str | None, typer.Option("--every", metavar="TIME", help="With --csv: time between rows, e.g. 5ms.")
    ] = None,
    verbose: Verbose = 0,
):
    """Draw the figures of a result again, or its motion, or write a plan as a table."""
    if csv or every:
        from socontrol.cli.plan_table import write_table

        if not csv or gif or output:
            raise typer.BadParameter("--every goes with --csv FILE; --csv goes without --gif and --output")
        return write_table(result, csv, every)
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
