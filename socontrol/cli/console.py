"""Consoles for answers (stdout) and progress (stderr), plain where NO_COLOR asks for it or nobody watches."""

import os
import sys
from contextlib import contextmanager

WIDE = 100  # columns where the output is no terminal


def console(stream=None):
    """A rich Console on stdout or another stream."""
    from rich.console import Console

    stream = stream or sys.stdout
    watched = stream.isatty()
    plain = bool(os.environ.get("NO_COLOR")) or not watched
    return Console(file=stream, color_system=None if plain else "auto", width=None if watched else WIDE,
                   highlight=False, markup=False)  # fmt: skip


@contextmanager
def progress(name, wanted=True):
    """A callback (done, total, sentence) that shows a bar on stderr while it is watched, else None."""
    if not wanted or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task(f"solving {name}", total=None)

        def show(done, total, sentence):
            bar.update(task, completed=done, total=total, description=f"solving {name}: {sentence}")

        yield show
