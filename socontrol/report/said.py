"""What all printed answers share: the first sentence, ends worth a row, numbers of one unit side by side."""

import textwrap

from rich.text import Text

from socontrol.report.columns import columns, line, say
from socontrol.report.units import miss, number, quiet, readable

TITLES = {"inverse_statics": "inverse statics", "fit": "fit to measurements",
          "ellipsoids": "ellipsoids of a posture at rest"}  # fmt: skip
WHOLE = ("together", "with more time")  # starts of attempts at all waypoints of a path
KINDS = {"posture": "tensions of a posture", "path": "tensions along a path", "motion": "tensions of a motion"}


def headline(result, console, facts=None):
    """The status sentence, and under it what was asked and what it took (`facts` [text])."""
    tone = "bold green" if result.status.solved else "bold red"
    message = result.status.message
    if result.details.get("unreachable") and not names_cables(result):
        message = message.partition(". ")[0].rstrip(".") + "."  # the table below says the rest
    for k, part in enumerate(textwrap.wrap(f"{result.name}: {message}", console.width, break_long_words=False)):
        text = Text(part, style=tone)
        if k == 0 and part.startswith(f"{result.name}:"):
            text.stylize("default", 0, len(result.name) + 1)
        line(console, text)
    line(console, Text(", ".join(facts or _facts(result)), style="dim"))
    line(console, "")


def names_cables(result):
    """Whether a limit that keeps a goal out of reach is that of a cable: the message says what the cable would need."""
    return any(row.get("pulls") for row in result.details.get("unreachable") or ())


def _facts(result):
    count, seconds = result.solver.get("iterations"), result.solver.get("seconds")
    facts = [KINDS.get(result.details.get("kind"), TITLES.get(result.type, result.type))]
    facts += [counted(count, "iteration")] if count is not None else []
    return facts + ([duration(seconds)] if seconds is not None else [])


def counted(count, noun):
    """`1 step`, `12 steps`."""
    return f"{count} {noun}{'s' * (count != 1)}"


def duration(t):
    """Seconds of the clock: `65.9 ms`, `7.77 s`."""
    return f"{t * 1e3:.3g} ms" if t < 1 else f"{t:.3g} s"


def segments_of(result):
    """Names of the segments whose ends the result knows."""
    return [key.removesuffix(".position") for key in result.values if key.endswith(".position")]


def tips_of(result):
    """Segments that carry nothing; the last one when the question is not at hand."""
    names = segments_of(result)
    if result.question is None:
        return names[-1:]
    carried = {segment.parent for segment in result.question.robot.description.segments.values()}
    return [name for name in names if name not in carried]


def in_units(values, digits=4):
    """{name: [number, unit]} of scalar Values; those of a unit share its reading, and noise beside the largest is 0."""
    shown = {}
    for unit in dict.fromkeys(v.unit for v in values.values()):
        names = [name for name, v in values.items() if v.unit == unit]
        numbers = quiet([values[name].value for name in names])
        one, name_of_unit = readable(unit, *numbers)
        shown |= {name: [number(x / one, digits), name_of_unit] for name, x in zip(names, numbers, strict=True)}
    return shown


def discretisation(result, console, sought):
    """How far twice the sections would move the ends; `sought`: what the second solve looks for."""
    changes = result.details["discretisation"]
    if changes is None:
        sentence = f"with twice the sections no {sought} was found: the discretisation error is unknown"
        say(console, "sections", sentence, "bold yellow")
    elif changes:
        tips = [name for name in tips_of(result) if name in changes] or list(changes)
        moved = ", ".join(f"{name} by {miss(changes[name], 'm')}" for name in tips)
        say(console, "sections", f"twice as many would move {moved}")


def attempts(result, console, verbose):
    """How many attempts it took where one was not enough; `verbose`: each of them."""
    made = result.details.get("attempts", ())
    if len(made) < 2:
        return
    say(console, "attempts", _told(result, made))
    if verbose:
        rows = [[_field(a, "start"), _field(a, "outcome"), str(_field(a, "iterations")), duration(_field(a, "seconds"))]
                for a in made]  # fmt: skip
        line(console, "")
        columns(console, ["attempt", "outcome", "iterations>", "time>"], rows)


def _told(result, made):
    """Attempts in one sentence; those at all waypoints together are told apart from their guesses."""
    whole = [a for a in made if _field(a, "start") in WHOLE] if "path.q" in result.arrays else []
    if whole and _solved(whole):
        return f"{len(whole)} at all waypoints together, guessed from {len(made) - len(whole)} waypoint by waypoint"
    last = "" if "path.q" in result.arrays else f"; the last: {_field(made[-1], 'start')}"
    return f"{len(made)}, of which {_solved(made)} solved their step{last}"


def _solved(made):
    return sum(_field(a, "outcome") == "solved" for a in made)


def _field(attempt, key):
    return attempt[key] if isinstance(attempt, dict) else getattr(attempt, key)
