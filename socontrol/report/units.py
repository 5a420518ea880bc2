"""Units people read: SI numbers as kPa, mm, mN m, deg ... One unit serves a whole column or axis."""

from math import isfinite, log10, pi

READABLE = {  # SI unit: (largest value shown in it, value of one in SI, name), the last without a limit
    "m": ((10.0, 1e-3, "mm"), (None, 1.0, "m")),
    "rad": ((None, pi / 180, "deg"),),
    "Pa": ((1e7, 1e3, "kPa"), (None, 1e6, "MPa")),
    "N": ((0.5, 1e-3, "mN"), (None, 1.0, "N")),
    "N m": ((0.5, 1e-3, "mN m"), (None, 1.0, "N m")),
    "rad/(N m)": ((None, pi / 180e-3, "deg/(mN m)"),),
    "J": ((0.5, 1e-3, "mJ"), (None, 1.0, "J")),
    "m^3": ((None, 1e-6, "cm^3"),),
    "1": ((None, 1.0, ""),),
}
SMALL = {  # SI unit of a miss: (value of one in SI, name), from large to small
    "m": ((1e-3, "mm"), (1e-6, "um"), (1e-9, "nm"), (1e-12, "pm")),
    "rad": ((pi / 180, "deg"), (pi / 180e3, "mdeg"), (pi / 180e6, "udeg")),
    "J": ((1.0, "J"), (1e-3, "mJ"), (1e-6, "uJ"), (1e-9, "nJ"), (1e-12, "pJ"), (1e-15, "fJ")),
    "1": ((1.0, ""),),
}
QUANTITY = {"Pa": "pressure", "N": "force", "N m": "torque", "m": "length", "rad": "angle"}


def readable(unit, *values):
    """(value of one in SI, name) of the unit that suits the largest value; `Pa/m` by its two parts."""
    if "/" in unit and unit not in READABLE and unit != "1/m":
        above, _, below = unit.rpartition("/")
        (a, name_a), (b, name_b) = readable(above), readable(below)
        return a / b, f"{name_a}/{name_b}"
    largest = max((abs(v) for v in values if isfinite(v)), default=0.0)
    for limit, one, name in READABLE.get(unit, ((None, 1.0, unit),)):
        if limit is None or largest < limit:
            return one, name
    return 1.0, unit


def number(x, digits=4):
    """`x` with `digits` significant digits and no needless zeros; 0 for what only rounding leaves."""
    text = f"{x:.{digits}g}"
    return "0" if float(text) == 0 else text


def percent(share):
    """`0.52 %`, `31 %`."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{number(100 * share, 2)} %"


def quiet(values, noise=1e-9, beside=0.0):
    """The values with 0 for those that rounding leaves beside the largest of them and of `beside`."""
    largest = max((abs(x) for x in (*values, beside) if isfinite(x)), default=0.0)
    return [0.0 if abs(x) < noise * largest else x for x in values]


def fixed(x, size, digits=5):
    """`x` with the decimals that show `digits` digits of a number as large as `size`; for columns."""
    decimals = max(0, digits - 1 - int(log10(size))) if size >= 1 else digits - 1
    text = f"{x:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def with_unit(x, unit, digits=4):
    """`104 kPa`: the number in the unit that suits it."""
    one, name = readable(unit, x or 1.0)
    return f"{number(x / one, digits)} {name}".rstrip()


def miss(x, unit):
    """A distance that should be small: `58.93 mm`, `2.1 nm`, `below 1 pm`."""
    units = SMALL.get(unit, ((1.0, unit),))
    for one, name in units:
        if abs(x) >= one:
            return f"{number(x / one)} {name}".rstrip()
    one, name = units[-1]
    return f"{number(x, 2)}" if unit == "1" else f"below 1 {name}" if unit in SMALL else f"{number(x, 2)} {unit}"
