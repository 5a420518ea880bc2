"""Flags of `socontrol plan` to the mapping of a problem file, and which flag stands behind each key of it."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields

from socontrol.files.yaml_reader import Document, FileError
from socontrol.programs.plans.obstacles import parse
from socontrol.programs.plans.plan_costs import PLAN_COSTS
from socontrol.records import file_key, joined, nearest

FREE = ("free", "null")  # words for a coordinate of a point that is not held


class BadFlag(Exception):
    """What is asked by flags and cannot be done, in one line."""


@dataclass(frozen=True, kw_only=True)
class Flags:
    """What the flags say, as text; those left out are None or empty."""

    start: str = "rest"
    to: tuple = ()
    duration: str
    avoid: tuple = ()
    via: tuple = ()
    intervals: int | None = None
    scheme: str | None = None
    points: int | None = None
    minimise: tuple = ()
    limit_rate: tuple = ()
    quasi_static: bool = False
    water: str | None = None


@dataclass(frozen=True)
class Flagged(Document):
    """A document made from flags; `flags`: {path: the flag as it was typed}."""

    flags: Mapping = field(default_factory=dict)

    def error(self, path, message):
        """A FileError in the words of the flag that stands at the path, above it or below it."""
        path = tuple(path)
        if len(path) > 1 and path[0] in self.grafts:
            return super().error(path, message)
        above = [own for own in self.flags if own == path[: len(own)]]
        below = [own for own in self.flags if own[: len(path)] == path]
        nearby = [max(above, key=len)] if above else below
        return FileError(message, file=joined(dict.fromkeys(self.flags[own] for own in nearby), "and")) if nearby \
            else super().error(path, message)  # fmt: skip


def problem_of(flags, robot):
    """(mapping without `robot`, {path: flag}) of a planned motion of this robot; raises BadFlag."""
    data, names = {"schema_version": 1, "type": "trajectory"}, {}
    span = _duration(flags.duration, data, names)
    if flags.quasi_static:
        _put(data, names, ("quasi_static",), True, "--quasi-static")
    if flags.water is not None:
        flag = f"--water {flags.water}"
        water = {"type": "fluid", "density": as_number(flags.water, flag)}
        _put(data, names, ("loads", "water"), water, flag)
    for key in ("intervals", "scheme", "points"):
        if (value := getattr(flags, key)) is not None:
            _put(data, names, ("mesh", key), value, f"--{key} {value}")
    _start(flags.start, data, names)
    for text in flags.to:
        _aim(text, f"--to {text}", ("end",), robot, data, names)
    _waypoints(flags.via, span, robot, data, names)
    _obstacles(flags.avoid, data, names)
    for text in flags.limit_rate:
        name, value = _pair(text, "--limit-rate", "INPUT=VALUE")
        key = "input_rates" if name in robot.inputs or name not in robot.coordinates else "rates"
        _put(data, names, ("limits", key, name), as_number(value, f"--limit-rate {text}"), f"--limit-rate {text}")
    for text in flags.minimise:
        _cost(text, data, names)
    return data, names


def _put(data, names, path, value, flag):
    """Set a value at a path of nested mappings; raises BadFlag where another flag has set it."""
    *parents, last = path
    for key in parents:
        data = data.setdefault(key, {})
    if last in data:
        raise BadFlag(f"{flag}: {names.get(path, 'another flag')} says this already; give one of them")
    data[last] = value
    names[path] = flag


def _pair(text, option, form):
    """(name, value) of `NAME=VALUE`."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise BadFlag(f"{option} {text}: {form} is wanted")
    return name, value


def as_number(text, flag):
    """A number, or the text as it is where it has a unit."""
    text = text.strip()
    try:
        number = float(text)
    except ValueError:
        if not text or not (text[0].isdigit() or text[0] in "+-."):
            raise BadFlag(f"{flag}: '{text}' is no number, nor one with a unit such as '50 mm'") from None
        return text
    if not math.isfinite(number):
        raise BadFlag(f"{flag}: {text} is not a finite number")
    return number


def _duration(text, data, names):
    """Put the duration; whether it is free."""
    flag = f"--duration {text}"
    shortest, dots, longest = text.partition("..")
    if not dots:
        _put(data, names, ("duration",), as_number(text, flag), flag)
        return False
    if not (shortest.strip() and longest.strip()):
        raise BadFlag(f"{flag}: SHORTEST..LONGEST is wanted, e.g. 0.5..3")
    between = {"shortest": as_number(shortest, flag), "longest": as_number(longest, flag)}
    _put(data, names, ("duration",), between, flag)
    return True


def _start(text, data, names):
    flag = f"--from {text}"
    if text.strip() == "rest":
        _put(data, names, ("start",), {"settled": True}, flag)
        return
    coordinates = {}
    for part in text.split(","):
        name, value = _pair(part, "--from", "`rest`, or NAME=VALUE of coordinates with commas between them,")
        if name in coordinates:
            raise BadFlag(f"{flag}: '{name}' is given twice")
        coordinates[name] = as_number(value, flag)
    _put(data, names, ("start",), {"coordinates": coordinates, "settled": False}, flag)


def _aim(text, flag, path, robot, data, names):
    """Put a point of a segment or a coordinate of `NAME=X,Y,Z` or `NAME=VALUE` under a path."""
    name, value = _pair(text, flag[: flag.index(" ")], "NAME=X,Y,Z of a segment, or NAME=VALUE of a coordinate,")
    entries = value.split(",")
    if len(entries) == 1:
        _put(data, names, (*path, "coordinates", name), as_number(value, flag), flag)
        return
    if len(entries) != 3:
        form = "three are a point of a segment, one is a coordinate"
        raise BadFlag(f"{flag}: {len(entries)} numbers are given; {form}")
    target = [None if entry.strip() in FREE else as_number(entry, flag) for entry in entries]
    goal = {"type": "point", "on": _segment(name, robot), "target": target}
    _put(data, names, (*path, "goals", name), goal, flag)


def _segment(name, robot):
    """The segment of a name; `tip`: the last one that carries no other, where no segment has this name."""
    if name != "tip" or name in robot.segments:
        return name
    parents = {getattr(record, "parent", None) for record in robot.description.segments.values()}
    return [segment for segment in robot.segments if segment not in parents][-1]


def _waypoints(texts, span, robot, data, names):
    """Put the waypoints; those of the same time are one."""
    known = {}
    for text in texts:
        flag = f"--via {text}"
        when, colon, aim = (part.strip() for part in text.partition(":"))
        if not (when and colon and aim):
            raise BadFlag(f"{flag}: TIME:NAME=X,Y,Z is wanted, the time in seconds or as a share such as 50%")
        if when not in known:
            known[when] = f"via_{len(known) + 1}"
            _put(data, names, ("waypoints", known[when]), _when(when, span, flag, aim), flag)
        _aim(aim, flag, ("waypoints", known[when]), robot, data, names)


def _when(text, span, flag, aim):
    """{"time": s} or {"share": 0 to 1}."""
    if text.endswith("%"):
        share = as_number(text[:-1], flag)
        if not isinstance(share, float) or not 0 < share < 100:
            raise BadFlag(f"{flag}: {text} is no share between 0% and 100%")
        return {"share": share / 100}
    if span:
        raise BadFlag(f"{flag}: the duration is free, so give a share of it, e.g. --via 50%:{aim}")
    return {"time": as_number(text, flag)}


def _obstacles(texts, data, names):
    for text in texts:
        flag = f"--avoid {text}"
        try:
            obstacle = parse(text)
        except ValueError as error:
            raise BadFlag(f"--avoid: {error}") from None
        kind, known = obstacle["type"], data.get("obstacles", {})
        count = sum(other["type"] == kind for other in known.values())
        _put(data, names, ("obstacles", f"{kind}_{count + 1}" if count else kind), obstacle, flag)


def _cost(text, data, names):
    flag = f"--minimise {text}"
    name, equals, weight = (part.strip() for part in text.partition("="))
    if name not in PLAN_COSTS:
        raise BadFlag(f"{flag}: unknown cost '{name}'{nearest(name, PLAN_COSTS)}")
    needed = [file_key(f.name) for f in fields(PLAN_COSTS[name])
              if f.init and f.default is MISSING and f.default_factory is MISSING]  # fmt: skip
    if needed:
        fix = "write it into the file that --save makes"
        raise BadFlag(f"{flag}: a cost of type {name} needs {joined(needed, 'and')} as well; {fix}")
    if equals and not weight:
        raise BadFlag(f"{flag}: {name}=WEIGHT is wanted")
    entry = {"type": name, **({"weight": as_number(weight, flag)} if equals else {})}
    _put(data, names, ("costs", name), entry, flag)
