"""Unit types of file fields: what a number in a file may look like, and the SI float it becomes.

A field is annotated with its unit, `length: Length`; a file then says `50 mm` or `0.05`, Python says `0.05`.
Numbers without a unit are SI and radians. Only the standard library is imported here: pydantic and pint are
loaded by the first file that is read. Records built from Python are not checked, so that a field can hold a
symbolic value.
"""

import dataclasses
import math
import numbers
from typing import Annotated, Any, TypeVar

from socontrol.records import (  # noqa: F401  everyone takes records and quantities from here
    Bad,
    Either,
    OneOf,
    Text,
    adapter,
    affinity,
    classes,
    fields_of,
    file_key,
    is_record,
    is_symbolic,
    items_of,
    joined,
    nearest,
    other_wanted,
    parts,
    record,
    shape_of,
    shapes,
    show,
    special,
    unit_of,
    wanted,
)
from socontrol.units import KINDS, LONGEST, QUANTITY, kind_of, measure, scaled

T = TypeVar("T")
LARGEST = 1e15  # of any number in SI: moduli reach 1e12 Pa; more is a slip, and overflows in products


@dataclasses.dataclass(frozen=True)
class Unit:
    """A number in SI unit `text`. Bounds are SI; `exclusive` refuses the lower bound itself.

    Degrees and turns are read where the unit has radians in it or `angle` is set.
    """

    text: str
    lower: float | None = None
    upper: float | None = None
    exclusive: bool = False
    angle: bool = False
    shapes = frozenset({"number", "text"})

    @property
    def unit(self):
        """Unit text, '' for a plain number."""
        return "" if self.text == "1" else self.text

    @property
    def wanted(self):
        """`a length in m, e.g. '50 mm'`."""
        if self.text == "1":
            return "a number" + self.range
        noun, example = KINDS[self.text][:2] if self.text in KINDS else ("a number", f"1 {self.text}")
        return f"{noun} in {self.text}, e.g. '{example}'"

    @property
    def range(self):
        """The bounds in words, `` from 0 to 1``."""
        low = f" {'above' if self.exclusive else 'from'} {self.lower:g}" if self.lower is not None else ""
        return low + (f" up to {self.upper:g}" if self.upper is not None else "")

    def read(self, value):
        """The SI float of a number, of text with a unit, or a casadi value as it is; else ValueError."""
        if is_symbolic(value):
            return value
        if isinstance(value, str):
            number = self.converted(value.strip())
        elif isinstance(value, numbers.Real) and not isinstance(value, bool):
            number = self.float_of(value)
        else:
            raise other_wanted(value, self.wanted)
        return self.bounded(number, value)

    @staticmethod
    def float_of(value):
        """A Python or numpy number as a float."""
        try:
            return float(value)
        except OverflowError:
            return math.inf

    def converted(self, text):
        """SI float of `50 mm`."""
        match = QUANTITY.fullmatch(text) if len(text) <= LONGEST else None
        if match is None:
            raise ValueError(f"{show(text)} is not {self.wanted}")
        number, unit = match.groups()
        if unit is None:
            raise ValueError(f"'{text}' is text; drop the quotes: {number}")
        factor, base, radians, events = measure(unit)
        _, own_base, own_radians, _ = measure(self.text)
        angles = {0, own_radians} | ({1} if self.angle else set())
        if base != own_base or radians not in angles or (self.text == "rad" and radians != 1):
            kind = kind_of(unit)
            given = f"{kind}; {self.noun} is wanted," if kind else f"not {self.noun}; write"
            raise ValueError(f"{text} is {given} {self.example}")
        if events and own_radians and not radians:
            fix = f"write e.g. '{number} rad/s' or '{number} turn/s'"
            raise ValueError(f"{text} may count turns or radians; {fix}")
        return scaled(number, factor)

    @property
    def noun(self):
        """`a length`."""
        return KINDS[self.text][0] if self.text in KINDS else f"a number in {self.text}"

    @property
    def example(self):
        """`e.g. '50 mm' or 0.05`."""
        _, written, plain = KINDS.get(self.text, (None, f"1 {self.text}", "1"))
        return f"e.g. {plain}" if written == plain else f"e.g. '{written}' or {plain}"

    def bounded(self, number, given):
        """The number, if finite and within the bounds."""
        given = given.strip() if isinstance(given, str) else show(given)
        if not math.isfinite(number):
            raise ValueError(f"{given} is not a finite number")
        if abs(number) > LARGEST:
            raise ValueError(f"{given} is too large: at most {LARGEST:g} in SI")
        if self.lower is not None and (number < self.lower or (self.exclusive and number == self.lower)):
            if self.lower == 0:
                raise ValueError(f"{given} is {'not positive' if self.exclusive else 'negative'}")
            raise ValueError(f"{given} is {'not above' if self.exclusive else 'below'} {self.lower:g}")
        if self.upper is not None and number > self.upper:
            raise ValueError(f"{given} is above {self.upper:g}")
        return number

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema, handler):
        low = "exclusiveMinimum" if self.exclusive else "minimum"
        both = {low: self.lower, "maximum": self.upper}
        bounds = {key: bound for key, bound in both.items() if bound is not None}
        return {"anyOf": [{"type": "number", **bounds}, {"type": "string"}], "description": self.wanted}


@dataclasses.dataclass(frozen=True)
class Whole:
    """A whole number of at least `lower`."""

    lower: int | None = None
    shapes = frozenset({"number"})

    @property
    def wanted(self):
        return "a whole number" + (f" of at least {self.lower}" if self.lower is not None else "")

    def read(self, value):
        """The int; else ValueError."""
        if not isinstance(value, numbers.Integral) or isinstance(value, bool):
            raise other_wanted(value, self.wanted)
        if self.lower is not None and value < self.lower:
            raise ValueError(f"{show(value)} is below {self.lower}")
        return int(value)

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema, handler):
        low = {} if self.lower is None else {"minimum": self.lower}
        return {"type": "integer", **low, "description": self.wanted}


class YesNo:
    """`true` or `false` and nothing that merely resembles them."""

    wanted = "true or false"

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        return core_schema.bool_schema(strict=True)


# Lists

class Check:
    """Metadata that looks at a list before (`before`) and after (`after`) its items are read."""

    def before(self, value):
        return value

    def after(self, value, given):
        return value

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        def read(value, inner):
            if is_symbolic(value):
                return value
            given = self.before(value.tolist() if type(value).__module__ == "numpy" else value)
            return self.after(inner(given), given)

        return core_schema.no_info_wrap_validator_function(read, handler(source))


class Numbers(Check):
    """A list of so many numbers: `Numbers(3)`, or `Numbers(3, 6)` for either. `nonzero` refuses all zeros."""

    takes_unit = True  # its sentence ends in the unit of its items

    def __init__(self, *counts, nonzero=False, what="numbers"):
        self.counts, self.nonzero, self.what = counts, nonzero, what

    @property
    def wanted(self):
        return f"{joined(self.counts)} {self.what}"

    def before(self, value):
        if not isinstance(value, list | tuple):
            raise other_wanted(value, f"a list of {self.wanted}")
        if len(value) not in self.counts:
            given = f"{len(value)} {self.what} are" if len(value) != 1 else f"1 {self.what.rstrip('s')} is"
            raise ValueError(f"{given} given; {joined(self.counts)} are wanted")
        return value

    def after(self, value, given):
        if self.nonzero and not any(is_symbolic(x) or x != 0 for x in value):
            raise ValueError("all numbers are zero; a direction is wanted, e.g. [1, 0, 0]")
        return value


class Ordered(Check):
    """Two values, the lower one first; equal ones are allowed; null is an open end where items allow it."""

    def after(self, value, given):
        lower, upper = value
        if any(is_symbolic(x) or x is None for x in value) or lower <= upper:
            return value
        low, high = (x if isinstance(x, str) else show(x) for x in given)
        raise ValueError(f"[{low}, {high}]: the lower limit is above the upper one; write [{high}, {low}]")


# The types of fields

Number = Annotated[float, Unit("1")]
PositiveNumber = Annotated[float, Unit("1", lower=0, exclusive=True)]
NonNegativeNumber = Annotated[float, Unit("1", lower=0)]
Fraction = Annotated[float, Unit("1", lower=0, upper=1)]
PoissonRatio = Annotated[float, Unit("1", lower=-1, upper=0.5, exclusive=True)]
Integer = Annotated[int, Whole()]
Count = Annotated[int, Whole(1)]
Flag = Annotated[bool, YesNo()]

Metre = Annotated[float, Unit("m")]
Length = Annotated[float, Unit("m", lower=0, exclusive=True)]
Distance = Annotated[float, Unit("m", lower=0)]
Area = Annotated[float, Unit("m^2", lower=0, exclusive=True)]
SecondMoment = Annotated[float, Unit("m^4", lower=0, exclusive=True)]
Volume = Annotated[float, Unit("m^3", lower=0)]
Curvature = Annotated[float, Unit("rad/m")]
Radian = Annotated[float, Unit("rad")]
MetrePerRadian = Annotated[float, Unit("m/rad")]

Kilogram = Annotated[float, Unit("kg", lower=0)]
Mass = Annotated[float, Unit("kg", lower=0, exclusive=True)]
Density = Annotated[float, Unit("kg/m^3", lower=0, exclusive=True)]
LinearDensity = Annotated[float, Unit("kg/m", lower=0)]
Modulus = Annotated[float, Unit("Pa", lower=0, exclusive=True)]
Viscosity = Annotated[float, Unit("Pa s", lower=0)]

Pascal = Annotated[float, Unit("Pa")]
Newton = Annotated[float, Unit("N")]
NewtonMetre = Annotated[float, Unit("N m")]
NewtonPerMetre = Annotated[float, Unit("N/m")]
NewtonMetrePerMetre = Annotated[float, Unit("N m/m")]
TorsionStiffness = Annotated[float, Unit("N m/rad", lower=0)]
AxialStiffness = Annotated[float, Unit("N/m", lower=0)]
TorsionDamping = Annotated[float, Unit("N m s/rad", lower=0)]
AxialDamping = Annotated[float, Unit("N s/m", lower=0)]

Second = Annotated[float, Unit("s")]
MetrePerSecond = Annotated[float, Unit("m/s")]
MetrePerSecond2 = Annotated[float, Unit("m/s^2")]
RadianPerSecond = Annotated[float, Unit("rad/s")]
RadianPerSecond2 = Annotated[float, Unit("rad/s^2")]

Pair = Annotated[tuple[T, T], Numbers(2)]
Triple = Annotated[tuple[T, T, T], Numbers(3)]
Limits = Annotated[tuple[T, T], Numbers(2), Ordered()]

Position = Triple[Metre]
RotationVector = Triple[Radian]
Forces = Triple[Newton]
Moments = Triple[NewtonMetre]
Velocity = Triple[MetrePerSecond]
Acceleration = Triple[MetrePerSecond2]
Axis = Annotated[tuple[Number, Number, Number], Numbers(3, nonzero=True)]

InertiaNumber = Annotated[float, Unit("kg m^2")]
Inertia = Annotated[Any, Either(
    Annotated[tuple[InertiaNumber, ...], Numbers(3, 6)],
    Annotated[tuple[Triple[InertiaNumber], ...], Numbers(3, what="rows")],
)]
