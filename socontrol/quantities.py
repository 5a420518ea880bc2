"""Unit types of file fields: what a number in a file may look like, and the SI float it becomes.

A field is annotated with its unit, `length: Length`; a file then says `50 mm` or `0.05`, Python says `0.05`.
Numbers without a unit are SI and radians. Only the standard library is imported here: pydantic and pint are
loaded by the first file that is read. Records built from Python are not checked, so that a field can hold a
symbolic value.
"""

import dataclasses
import difflib
import functools
import math
import numbers
import re
from decimal import Decimal
from typing import Annotated, Any, TypeVar

from socontrol.records import (  # noqa: F401  everyone takes records and quantities from here
    Bad,
    Either,
    OneOf,
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

T = TypeVar("T")


# Units

KINDS = {  # unit: what it measures, how a file may write it, the same in SI
    "1": ("a plain number", "0.5", "0.5"),
    "m": ("a length", "50 mm", "0.05"),
    "m^2": ("an area", "19.6 mm^2", "19.6e-6"),
    "m^3": ("a volume", "2 cm^3", "2e-6"),
    "m^4": ("a second moment of area", "120 mm^4", "1.2e-10"),
    "kg": ("a mass", "13.47 g", "0.01347"),
    "kg/m^3": ("a density", "1.82 g/cm^3", "1820"),
    "kg/m": ("a mass per length", "20 g/m", "0.02"),
    "kg m^2": ("a moment of inertia", "1 g cm^2", "1e-7"),
    "Pa": ("a pressure or modulus", "0.2 MPa", "2e5"),
    "Pa s": ("a viscosity", "300 Pa s", "300"),
    "N": ("a force", "0.3 N", "0.3"),
    "N m": ("a moment", "20 N mm", "0.02"),
    "N/m": ("a force per length", "0.1 N/m", "0.1"),
    "N m/m": ("a moment per length", "0.1 N m/m", "0.1"),
    "N m/rad": ("a torsional stiffness", "0.5 N m/rad", "0.5"),
    "N m s/rad": ("a torsional damping", "0.01 N m s/rad", "0.01"),
    "N s/m": ("a damping", "2 N s/m", "2"),
    "rad": ("an angle", "90 deg", "1.5708"),
    "rad/m": ("a curvature", "20 1/m", "20"),
    "m/rad": ("a pitch", "5 mm/turn", "0.0008"),
    "s": ("a time", "50 ms", "0.05"),
    "m/s": ("a speed", "20 mm/s", "0.02"),
    "m/s^2": ("an acceleration", "9.81 m/s^2", "9.81"),
    "rad/s": ("an angular rate", "3.75 rpm", "0.3927"),
    "rad/s^2": ("an angular acceleration", "2 rad/s^2", "2"),
}
COMMON = [
    *("mm", "cm", "m", "km", "um", "mm^2", "cm^2", "m^2", "mm^3", "cm^3", "m^3", "mm^4", "m^4", "1/m"),
    *("g", "kg", "mg", "g/cm^3", "kg/m^3", "Pa", "kPa", "MPa", "GPa", "bar"),
    *("Pa s", "N", "mN", "kN", "N m", "N mm", "N/m"),
    *("s", "ms", "min", "m/s", "mm/s", "m/s^2", "deg", "rad", "turn", "rpm", "rad/s", "deg/s"),
]

NUMBER = r"(?>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3}(?![0-9]))?)"  # atomic: 11/m stays whole
NAME = r"(?:1|%|[^\W\d]\w*|[°Ω])(?:(?:\^|\*\*)-?[0-9]|[²³⁴])?"
QUANTITY = re.compile(rf"({NUMBER})\s*((?:/\s*)?{NAME}(?:\s*[*/·]\s*{NAME}|\s+{NAME})*)?")
LONGEST = 60  # characters of a quantity; a longer one is not a quantity


@functools.cache
def registry():
    """The one pint registry, built when the first unit is read."""
    import pint

    return pint.UnitRegistry()


@functools.cache
def measure(unit):
    """(SI factor, base units but radian, exponent of radian, counts events) of a unit, or ValueError."""
    text = re.sub(r"\b([numkKM]?N)(mm|cm|m)\b", r"\1 \2", unit)  # pint takes Nm for a number of threads
    text = "1" + text if text.startswith("/") else text
    try:
        units = registry().parse_units(text)
        base = registry().Quantity(1.0, units).to_base_units()
        if registry().Quantity(0.0, units).to_base_units().magnitude != 0.0:
            raise ValueError("a unit with an offset or a logarithm")
        exponents = dict(base.unit_items())
        factors = [measure_part(name) for name, _ in registry().Quantity(1.0, units).unit_items()]
    except Exception as unknown:  # pint raises a dozen kinds, some of them from its tokenizer
        raise ValueError(f"unknown unit '{unit}'{nearest_unit(unit)}") from unknown
    radians = exponents.pop("radian", 0)
    events = any(factor == {"second": -1} for factor in factors)
    return base.magnitude, frozenset(exponents.items()), radians, events


def measure_part(name):
    """Base units of one factor of a unit: a hertz is {'second': -1}, an rpm has the radian too."""
    return dict(registry().Quantity(1.0, name).to_base_units().unit_items())


def nearest_unit(unit):
    """The common unit that was probably meant: other case first, then other spelling."""
    same = [name for name in COMMON if name.lower() == unit.lower() or name.replace("^", "") == unit]
    close = same or difflib.get_close_matches(unit, COMMON, n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


def kind_of(unit):
    """What a unit measures, `a mass`, or None."""
    _, base, radians, _ = measure(unit)
    return next((noun for text, (noun, *_) in KINDS.items() if measure(text)[1:3] == (base, radians)), None)


def scaled(number, factor):
    """number x factor, rounded once when the factor is a short decimal: 14.5 mm is the float 0.0145."""
    short = format(factor, ".12g")
    if math.isclose(float(short), factor, rel_tol=1e-15):
        return float(Decimal(number) * Decimal(short))
    return float(number) * factor


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
