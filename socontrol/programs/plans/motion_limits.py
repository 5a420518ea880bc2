"""Limits of a motion or a path beside those of a posture: rates, of inputs and lengths too, lengths, speeds."""

from typing import Annotated, Any

from socontrol.programs.question import Raw, read
from socontrol.quantities import Bad, Either, Fraction, Unit, nearest, record

Range = Annotated[Any, Either(Raw, tuple[Raw, Raw])]


@record(kw_only=True)
class Speed:
    """The point at X of a segment moves at most at `largest` [m/s]."""

    on: str
    largest: Annotated[float, Unit("m/s", lower=0.0, exclusive=True)]
    at: Fraction = 1.0


class Ranges:
    """Limits by name: a number holds both ways, a pair is lower and upper."""

    def ranges(self, key, names, units):
        """{index: (lower, upper)} in SI of one key; raises Bad."""
        found = {}
        for name, given in (getattr(self, key) or {}).items():
            path = f"limits.{key}.{name}"
            if name not in names:
                raise Bad(path, f"the robot has no '{name}'{nearest(name, names)}")
            i = names.index(name)
            if isinstance(given, (tuple, list)):
                low, high = (read(x, units[i], path) for x in given)
            else:
                high = read(given, units[i], path)
                low = -high
            if not low < high:
                raise Bad(path, f"no value is left between {low:g} and {high:g}")
            found[i] = low, high
        return found


@record(kw_only=True)
class MotionLimits(Ranges):
    """rates: of coordinates; input_rates; lengths: of an actuator's lines together. A number holds both ways, a pair
    is lower and upper. speeds: of points, each by a name of its own."""

    rates: dict[str, Range] | None = None
    input_rates: dict[str, Range] | None = None
    lengths: dict[str, tuple[Raw, Raw]] | None = None
    speeds: dict[str, Speed] | None = None


@record(kw_only=True)
class PathLimits(Ranges):
    """input_rates, length_rates (of an actuator's lines together): from waypoint to waypoint of a path in its timing.
    A number holds both ways, a pair is lower and upper."""

    input_rates: dict[str, Range] | None = None
    length_rates: dict[str, Range] | None = None
