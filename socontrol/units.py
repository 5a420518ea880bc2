"""Units of text such as `50 mm`: their SI factor and dimension, what they measure, and the nearest usual one.

Usual symbols are known here; pint, which knows all others, is loaded when the first of those is read.
"""

import difflib
import functools
import math
import re
from decimal import Decimal

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

BASES = ("meter", "kilogram", "second")  # as pint calls them
SYMBOLS = {  # the usual symbols: SI factor; exponents of metre, kilogram, second, radian
    "1": (1.0, 0, 0, 0, 0),
    **{"um": (1e-6, 1, 0, 0, 0), "cm": (1e-2, 1, 0, 0, 0)},
    **{f"{prefix}m": (x, 1, 0, 0, 0) for prefix, x in (("", 1.0), ("m", 1e-3), ("k", 1e3))},
    **{f"{prefix}g": (x, 0, 1, 0, 0) for prefix, x in (("", 1e-3), ("m", 1e-6), ("k", 1.0))},
    **{f"{prefix}N": (x, 1, 1, -2, 0) for prefix, x in (("", 1.0), ("m", 1e-3), ("k", 1e3))},
    **{f"{prefix}Pa": (x, -1, 1, -2, 0) for prefix, x in (("", 1.0), ("k", 1e3), ("M", 1e6), ("G", 1e9))},
    "bar": (1e5, -1, 1, -2, 0),
    **{"s": (1.0, 0, 0, 1, 0), "ms": (1e-3, 0, 0, 1, 0), "min": (60.0, 0, 0, 1, 0)},
    **{"rad": (1.0, 0, 0, 0, 1), "deg": (math.pi / 180, 0, 0, 0, 1), "turn": (2 * math.pi, 0, 0, 0, 1)},
    "rpm": (2 * math.pi / 60, 0, 0, -1, 1),
}
FACTOR = re.compile(r"(\s*[*/]\s*|\s+|^)([A-Za-z]+|1)(?:\^(-?[0-9]))?")


def usual(unit):
    """`measure` of products and quotients of usual symbols, else None: pint takes half a second to start."""
    factor, powers, end = 1.0, [0, 0, 0, 0], 0
    while end < len(unit):
        match = FACTOR.match(unit, end)
        if match is None or match[2] not in SYMBOLS:
            return None
        power = int(match[3] or 1) * (-1 if "/" in match[1] else 1)
        value, *exponents = SYMBOLS[match[2]]
        factor *= value**power
        powers = [a + power * b for a, b in zip(powers, exponents, strict=True)]
        end = match.end()
    *powers, radians = powers
    return factor, frozenset((name, x) for name, x in zip(BASES, powers, strict=True) if x), radians, False


@functools.cache
def registry():
    """The one pint registry, built when the first unit is read."""
    import pint

    return pint.UnitRegistry()


@functools.cache
def measure(unit):
    """(SI factor, base units but radian, exponent of radian, counts events) of a unit, or ValueError."""
    if known := usual(unit):
        return known
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
