"""What an answer prints, as plain text."""

from rich.console import Console

from socontrol.report import text


def words(result, verbose=0):
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    text.render(result, console, verbose)
    return console.export_text(styles=False)


def sentence(result, label):
    """What is said behind a label, its lines joined."""
    lines = words(result).splitlines()
    first = next(k for k, x in enumerate(lines) if x.startswith(label))
    more = next((k for k, x in enumerate(lines[first + 1 :], first + 1) if not x.startswith(" ")), len(lines))
    return " ".join(x[13:] for x in lines[first:more]).strip()
