"""Errors on stderr, each in one line, and the exit codes they mean."""

import sys

UNEXPECTED, USAGE, BAD_FILE, REJECTED, MISSING_TOOL, INTERRUPTED = 1, 2, 3, 7, 8, 130


def say(message, own=True):
    """One line on stderr; `own`: said by socontrol itself, not about a line of a file."""
    print("socontrol: " * own + " ".join(str(message).split()), file=sys.stderr, flush=True)


def unexpected(error, verbose):
    """Exit code 1 and one line about an error that no input should cause; with `verbose` its traceback."""
    if verbose:
        import traceback

        traceback.print_exception(error)
    hint = "" if verbose else "; run with -v for the traceback"
    say(f"unexpected {type(error).__name__}: {error}{hint}")
    return UNEXPECTED


def interrupted(error):
    """Whether Ctrl-C is behind an error: compiled code may turn KeyboardInterrupt into errors of its own."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def told(error):
    """Exit code of an unreadable path or a bad file, after its lines are said."""
    lines = error.lines() if hasattr(error, "lines") else [str(error)]
    for line in lines:
        say(line, own=False)
    return BAD_FILE if hasattr(error, "lines") else USAGE
