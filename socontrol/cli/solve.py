"""`socontrol solve`: read, solve, compare with what is expected, write the result folder, print."""

import json
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from socontrol.cli.console import console, progress
from socontrol.cli.errors import INTERRUPTED, REJECTED, USAGE, interrupted, say, told, unexpected
from socontrol.cli.interrupts import Interrupts
from socontrol.files.expectations import compare, sentences
from socontrol.files.problem_file import keeping_log, question_of, read_problem, solve
from socontrol.files.result_file import json_of, refuse_foreign, save
from socontrol.files.yaml_reader import FileError, UnreadableFile
from socontrol.programs.result import Result, Status


@dataclass(frozen=True)
class Settings:
    """What the flags say."""

    output: Path
    json: bool = False
    overrides: tuple = ()
    figures: bool = True
    verify: bool = False
    quiet: bool = False
    verbose: int = 0
    compiled: bool = False


def solve_all(problems, settings):
    """Exit code of several problems, the largest of all; with `json` their documents as one list."""
    stems = [path.stem for path in problems]
    twice = next((stem for stem in stems if stems.count(stem) > 1), None)
    if twice:
        say(f"two problems are named '{twice}' and would share a result folder; solve them with a -o each")
        return USAGE
    code, documents = 0, []
    with Interrupts() as interrupts:
        for path in problems:
            own, document = solve_one(path, settings, interrupts)
            code, documents = max(code, own), [*documents, document]
            if interrupts.seen or own == INTERRUPTED:
                code = INTERRUPTED
                break
    if settings.json:
        print_json(documents if len(problems) > 1 else documents[0])
    return code


def print_json(content):
    print(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False))


def solve_one(path, settings, interrupts):
    """(exit code, JSON document) of one problem."""

    def work():
        document = read_problem(path, settings.overrides)
        return solved(path, document, question_of(document), settings, interrupts)

    return guarded(path, work, settings.verbose)


def guarded(path, work, verbose):
    """(exit code, JSON document) that `work` returns, or those of what it raises, said in one line."""
    try:
        return work()
    except (FileError, UnreadableFile) as error:
        code = told(error)
        message = str(error)
    except BrokenPipeError:  # nobody reads on: for the whole command to end
        raise
    except (Exception, KeyboardInterrupt) as error:  # one bad problem of several must not stop the others
        if interrupted(error):
            say(f"{path}: interrupted")
            return INTERRUPTED, {"problem": str(path), "exit": INTERRUPTED, "error": "interrupted"}
        code, message = unexpected(error, verbose), f"unexpected {type(error).__name__}: {error}"
    return code, {"problem": str(path), "exit": code, "error": message}


def solved(path, document, question, settings, interrupts):
    """(exit code, JSON document) of a question, its result folder named as the file at `path`, written and printed."""
    if settings.verify and not document.data.get("expect"):
        raise document.error(("expect",), "missing key 'expect': --verify has nothing to compare with")
    folder = settings.output / path.stem
    refuse_foreign(folder)
    with progress(path.stem, interrupts.check, not settings.quiet) as show, spoken():
        result = _answer(keeping_log(question), document, show, settings.compiled)
    comparisons = compare(document, result)
    wanted = settings.figures and result.status.exit_code != INTERRUPTED  # who stops wants to wait no longer
    trouble = save(result, document, folder, comparisons, _draw if wanted else None)
    if trouble:
        say(trouble)
    code = exit_code(result, comparisons, settings.verify)
    _print(path, folder, result, comparisons, settings)
    own = {"problem": str(path), "folder": str(folder), "exit": code}
    return code, {**own, **json_of(result, document, comparisons)}


@contextmanager
def spoken():
    """While entered, warnings about the C compiler are a line on stderr each."""
    from socontrol.native.compiler import CompilerWarning

    before = warnings.showwarning

    def show(message, category, *place):
        if issubclass(category, CompilerWarning):
            say(message)
        else:
            before(message, category, *place)

    with warnings.catch_warnings():
        warnings.simplefilter("always", CompilerWarning)
        warnings.showwarning = show
        yield


def _answer(question, document, show, compiled):
    """Result of the question; Ctrl-C outside the solver gives one without numbers."""
    try:
        return solve(question, document, show, compiled)
    except (Exception, KeyboardInterrupt) as error:
        if not interrupted(error):
            raise
        status = Status("interrupted", "Stopped by the user; run again to go on.")
        return Result(name=question.name, type=document.data["type"], status=status, question=question)


def _draw(result, folder):
    from socontrol.report.plots import draw

    return draw(result, folder)


def exit_code(result, comparisons, verify):
    """The result's own code; under `verify` an expected one counts as met, and a miss is a failed verification."""
    own = result.status.exit_code
    if not verify or own == INTERRUPTED:
        return own
    if any(not comparison.met for comparison in comparisons):
        return max(own, REJECTED)
    return 0 if any(comparison.name == "exit" for comparison in comparisons) else own


def _print(path, folder, result, comparisons, settings):
    """The answer on stdout; what went wrong, and where the result is, on stderr."""
    silent = settings.quiet or settings.json
    if not silent:
        from socontrol.report.text import render

        out = console()
        render(result, out, settings.verbose)
        for met, sentence in sentences(comparisons):
            out.print(f"{'met' if met else 'MISSED':<7}{sentence}", soft_wrap=True)
    elif not result.status.solved and not any(c.name == "exit" and c.met for c in comparisons):
        say(f"{path}: {result.status.outcome}: {result.status.message}", own=False)
    if settings.verify:
        for met, sentence in sentences(comparisons):
            if not met:
                say(f"{path}: expect: {sentence}", own=False)
    if not settings.quiet:
        say(f"{folder}{'' if str(folder).endswith('/') else '/'} written")
