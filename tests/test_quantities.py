"""Fields with units: what a file may write, the SI float it becomes, and the sentence for everything else."""

import inspect
import math
import subprocess
import sys
import typing
from typing import Annotated

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socontrol import quantities, units
from socontrol.quantities import (
    KINDS,
    Area,
    Axis,
    Bad,
    Count,
    Curvature,
    Density,
    Distance,
    Flag,
    Fraction,
    Inertia,
    Length,
    Limits,
    LinearDensity,
    Metre,
    MetrePerRadian,
    NewtonMetre,
    Number,
    OneOf,
    Pascal,
    PoissonRatio,
    Position,
    Radian,
    RadianPerSecond,
    TorsionStiffness,
    Unit,
    Viscosity,
    adapter,
    fields_of,
    measure,
    record,
    unit_of,
    wanted,
)

READ = [  # field, what a file writes, SI by hand
    (Length, "50 mm", 0.05),
    (Length, "14.5 mm", 0.0145),
    (Length, "50mm", 0.05),
    (Length, " 5 µm ", 5e-6),
    (Length, "1 inch", 0.0254),
    (Length, "1.2e1 cm", 0.12),
    (Length, 3, 3.0),
    (Distance, 0, 0.0),
    (Metre, "-3 mm", -0.003),
    (Area, "19.6 mm^2", 19.6e-6),
    (Area, "19.6 mm²", 19.6e-6),
    (Area, "2 mm**2", 2e-6),
    (Pascal, "0.2 MPa", 2e5),
    (Pascal, "1 bar", 1e5),
    (Pascal, "1 N/mm^2", 1e6),
    (Radian, "-90 deg", -math.pi / 2),
    (Radian, "0.5 turn", math.pi),
    (Radian, 1.5, 1.5),
    (RadianPerSecond, "3.75 rpm", 3.75 * 2 * math.pi / 60),
    (RadianPerSecond, "2 1/s", 2.0),
    (Curvature, "20/m", 20.0),
    (Curvature, "20 1/m", 20.0),
    (Curvature, "3 rad/m", 3.0),
    (Curvature, "11/m", 11.0),
    (MetrePerRadian, "5 mm/turn", 0.005 / (2 * math.pi)),
    (NewtonMetre, "20 Nmm", 0.02),
    (NewtonMetre, "1 N*m", 1.0),
    (TorsionStiffness, "2 N m/rad", 2.0),
    (TorsionStiffness, "2 Nm", 2.0),
    (TorsionStiffness, "1 N m/deg", 180 / math.pi),
    (Density, "1.82 g/cm^3", 1820.0),
    (LinearDensity, "20 g/m", 0.02),
    (Viscosity, "300 Pa s", 300.0),
    (Number, "30 %", 0.3),
    (Fraction, 1, 1.0),
    (PoissonRatio, 0.5, 0.5),
    (Count, 4, 4),
    (Flag, False, False),
    (Position, [0, "3 mm", 1], (0.0, 0.003, 1.0)),
    (Axis, [0, 0, 2], (0.0, 0.0, 2.0)),
    (Limits[Pascal], [0, "140 kPa"], (0.0, 140e3)),
    (Limits[Pascal | None], [None, 3], (None, 3.0)),
    (Inertia, [1, 2, 3], (1.0, 2.0, 3.0)),
    (Inertia, np.eye(2 + 1), ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))),
    (Length, np.float32(0.5), 0.5),
    (Length, np.int64(2), 2.0),
    (Position, np.ones(3), (1.0, 1.0, 1.0)),
]


@pytest.mark.parametrize(("kind", "written", "si"), READ, ids=[f"{w}" for _, w, _ in READ])
def test_what_a_file_writes_becomes_si(kind, written, si):
    value = adapter(kind).validate_python(written)
    assert value == (pytest.approx(si, rel=1e-15) if isinstance(si, float) else si)
    assert type(value) is type(si)


REFUSED = [  # field, what a file writes, the sentence
    (Length, "3 kg", "3 kg is a mass; a length is wanted, e.g. '50 mm' or 0.05"),
    (Length, "90 deg", "90 deg is an angle; a length is wanted, e.g. '50 mm' or 0.05"),
    (Length, "3 K", "3 K is not a length; write e.g. '50 mm' or 0.05"),
    (Length, "-3 mm", "-3 mm is not positive"),
    (Length, 0, "0 is not positive"),
    (Distance, -1, "-1 is negative"),
    (Length, "0.05", "'0.05' is text; drop the quotes: 0.05"),
    (Length, "50 KM", "unknown unit 'KM'; did you mean 'km'?"),
    (Length, "50 foo", "unknown unit 'foo'"),
    (Area, "5 mm2", "unknown unit 'mm2'; did you mean 'mm^2'?"),
    (Metre, "11*m", "'11*m' is not a length in m, e.g. '50 mm'"),
    (Length, "long", "'long' is not a length in m, e.g. '50 mm'"),
    (Length, True, "true is given; a length in m, e.g. '50 mm' is wanted"),
    (Length, None, "nothing is given; a length in m, e.g. '50 mm' is wanted"),
    (Length, [1], "a list of 1 is given; a length in m, e.g. '50 mm' is wanted"),
    (Length, math.nan, "nan is not a finite number"),
    (Length, -math.inf, "-inf is not a finite number"),
    (Length, "1e400 m", "1e400 m is not a finite number"),
    (Length, 10**350, "a whole number of more than 40 digits is not a finite number"),
    (Length, "2 m**99", "'2 m**99' is not a length in m, e.g. '50 mm'"),
    (Length, "20 degC", "unknown unit 'degC'; did you mean 'deg'?"),
    (Number, "90 deg", "90 deg is an angle; a plain number is wanted, e.g. 0.5"),
    (Radian, "5 %", "5 % is a plain number; an angle is wanted, e.g. '90 deg' or 1.5708"),
    (RadianPerSecond, "2 Hz", "2 Hz may count turns or radians; write e.g. '2 rad/s' or '2 turn/s'"),
    (RadianPerSecond, "2 kHz", "2 kHz may count turns or radians; write e.g. '2 rad/s' or '2 turn/s'"),
    (
        NewtonMetre,
        "1 N m/rad",
        "1 N m/rad is a torsional stiffness; a moment is wanted, e.g. '20 N mm' or 0.02",
    ),
    (PoissonRatio, -1, "-1 is not above -1"),
    (PoissonRatio, 0.6, "0.6 is above 0.5"),
    (Fraction, 1.5, "1.5 is above 1"),
    (Count, 0, "0 is below 1"),
    (Count, 2.0, "2.0 is given; a whole number of at least 1 is wanted"),
    (Count, True, "true is given; a whole number of at least 1 is wanted"),
    (Position, [1, 2], "2 numbers are given; 3 are wanted"),
    (Position, [1], "1 number is given; 3 are wanted"),
    (Position, "x", "'x' is given; a list of 3 numbers is wanted"),
    (Axis, [0, 0, 0], "all numbers are zero; a direction is wanted, e.g. [1, 0, 0]"),
    (Inertia, [1, 2], "2 numbers are given; 3 or 6 are wanted"),
    (Inertia, [[1, 0, 0], [0, 1, 0]], "2 rows are given; 3 are wanted"),
    (
        Limits[Metre],
        ["3 mm", "1 mm"],
        "[3 mm, 1 mm]: the lower limit is above the upper one; write [1 mm, 3 mm]",
    ),
]


@pytest.mark.parametrize(
    ("kind", "written", "sentence"), REFUSED, ids=[f"{str(w)[:20]}" for _, w, _ in REFUSED]
)
def test_everything_else_is_refused_with_a_sentence(kind, written, sentence):
    with pytest.raises(ValueError, match="1 validation error") as caught:
        adapter(kind).validate_python(written)
    assert str(caught.value.errors()[0]["ctx"]["error"]) == sentence


ALIASES = {
    name: kind
    for name, kind in vars(quantities).items()
    if typing.get_origin(kind) is Annotated and name not in ("Pair", "Triple", "Limits")
}


@pytest.mark.parametrize("name", ALIASES)
def test_every_alias_has_a_unit_that_pint_knows_and_words(name):
    unit = unit_of(ALIASES[name])
    assert measure(unit or "1")[0] == 1.0, "an SI unit has factor one"
    assert unit in KINDS or not unit
    assert wanted(ALIASES[name])


@pytest.mark.parametrize("text", KINDS)
def test_the_examples_of_a_unit_are_read_by_it_and_agree(text):
    _, written, plain = KINDS[text]
    if written != plain:
        assert Unit(text).read(written) == pytest.approx(float(plain), rel=0.01)


@pytest.mark.parametrize("value", [ca.SX.sym("x"), ca.MX.sym("x"), ca.DM(3)])
def test_casadi_values_pass_as_they_are(value):
    assert adapter(Length).validate_python(value) is value
    assert adapter(Position).validate_python([value, 1, 2])[0] is value
    assert adapter(Axis).validate_python(value) is value
    assert adapter(Inertia).validate_python(value) is value


@record
class Wheel:
    """A record with a key that Python reserves."""

    radius: Length
    from_: Number = 0.0

    def __post_init__(self):
        if self.from_ == 1:
            raise Bad("from", "from 1 leaves nothing")


def test_python_builds_records_unchecked_and_frozen():
    symbol = ca.SX.sym("r")
    wheel = Wheel(symbol)
    assert wheel.radius is symbol
    with pytest.raises(AttributeError):
        wheel.radius = 1


def test_a_record_names_its_file_keys():
    assert fields_of(Wheel) == {"radius": Length, "from": Number}
    assert adapter(Wheel).validate_python({"radius": 1, "from": "50 %"}) == Wheel(1.0, 0.5)


def test_a_family_takes_records_only():
    with pytest.raises(TypeError, match="not a record"):
        adapter(Annotated[typing.Any, OneOf({"x": int}, "thing")])


def test_units_are_found_through_lists_and_options():
    assert [
        unit_of(a)
        for a in (Length, Position, Length | None, tuple[Pascal, ...], Inertia, str, Limits[Pascal])
    ] == ["m", "m", "m", "Pa", "kg m^2", "", "Pa"]


def test_importing_the_types_loads_neither_pydantic_nor_pint():
    code = (
        "import sys, socontrol.quantities; print([m for m in ('pydantic', 'pint', 'numpy') if m "
        "in sys.modules])"
    )
    out = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=inspect.getfile(quantities).rsplit("socontrol", 1)[0],
    )
    assert out.stdout.strip() == "[]"


@settings(max_examples=500, deadline=None, derandomize=True, database=None)
@given(
    text=st.one_of(
        st.text(max_size=20), st.from_regex(r"-?[0-9]{1,3} ?[a-zA-Z%/*^ 0-9²°]{0,12}", fullmatch=True)
    ),
    unit=st.sampled_from(sorted(KINDS)),
)
def test_text_becomes_a_finite_float_or_one_sentence(text, unit):
    try:
        assert math.isfinite(Unit(unit).read(text))
    except ValueError as error:
        assert str(error)


SYMBOL = st.tuples(st.sampled_from([" ", "*", "/", " / "]), st.sampled_from(sorted(units.SYMBOLS)),
                   st.sampled_from(["", "^2", "^-1", "^3"]))  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.lists(SYMBOL, min_size=1, max_size=4))
def test_usual_symbols_mean_what_pint_says_they_mean(factors):
    text = "".join(separator * (i > 0) + name + power for i, (separator, name, power) in enumerate(factors))
    own = units.usual(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(units, "usual", lambda unit: None)
        scale, *dimension = units.measure.__wrapped__(text)
    assert math.isclose(own[0], scale, rel_tol=1e-12), text
    assert list(own[1:]) == dimension, text
