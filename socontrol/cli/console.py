"""Consoles for answers (stdout) and progress (stderr), plain where NO_COLOR asks for it or nobody watches."""

import os
import sys
import time
from contextlib import contextmanager

WIDE = 100  # columns where the output is no terminal
REFRESH = 0.05  # s between two lines of progress


def console(stream=None):
    """A rich Console on stdout or another stream."""
    from rich.console import Console

    stream = stream or sys.stdout
    watched = stream.isatty()
    plain = bool(os.environ.get("NO_COLOR")) or not watched

    class Plain(Console):
        def on_broken_pipe(self):  # rich would leave with 1; who reads no further has seen enough
            raise BrokenPipeError

    return Plain(file=stream, color_system=None if plain else "auto", width=None if watched else WIDE,
                   highlight=False, markup=False)  # fmt: skip


@contextmanager
def progress(name, check, wanted=True):
    """A callback (done, total, sentence) that calls `check` and, while stderr is watched, shows a line there."""
    if not wanted or not sys.stderr.isatty():
        yield lambda done, total, sentence: check()
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console(sys.stderr), transient=True) as bar:
        task, shown = bar.add_task(f"solving {name}", total=None), [0.0]

        def show(done, total, sentence):
            check()
            bar.update(task, completed=done, total=total, description=f"solving {name}: {sentence}")
            if time.monotonic() - shown[0] > REFRESH:  # a solver in C++ leaves rich's own thread no turn
                shown[0] = time.monotonic()
                bar.refresh()

        yield show
