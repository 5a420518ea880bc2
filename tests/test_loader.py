"""Reading files: every mistake is one line with file, line, path and the fix; nothing else ever escapes."""

import json
import os
from dataclasses import field
from typing import Annotated, Any, Literal

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socontrol.files.loader import (
    MAX_BYTES,
    Document,
    FileError,
    UnreadableFile,
    json_schema,
    override,
    parse,
    read_yaml,
    validate,
)
from socontrol.files.yaml_writer import yaml_text
from socontrol.quantities import (
    Area,
    Bad,
    Count,
    Either,
    Flag,
    Length,
    Limits,
    Metre,
    Number,
    OneOf,
    Pair,
    Pascal,
    Position,
    RadianPerSecond,
    record,
)

Strain = Literal["twist", "bend_y", "bend_z"]


@record
class Hole:
    """A hole of a section."""

    offset: Pair[Metre]
    radius: Length


@record
class Circle:
    """A disc."""

    radius: Length
    holes: tuple[Hole, ...] = ()


@record
class Annulus:
    """A ring."""

    radius: Length
    inner_radius: Length

    def __post_init__(self):
        if self.inner_radius >= self.radius:
            raise Bad("inner_radius", f"inner_radius {self.inner_radius} is not below radius {self.radius}")


SECTIONS = {"circle": Circle, "annulus": Annulus}
Section = Annotated[Any, OneOf(SECTIONS, "cross-section")]


@record
class Taper:
    """A section that changes from start to end."""

    start: Section
    end: Section


@record
class Rod:
    """A soft rod."""

    length: Length
    cross_section: Annotated[Any, Either(Section, Taper)]
    placement: Position = (0.0, 0.0, 0.0)
    sections: Annotated[Any, Either(Count, tuple[Number, ...])] = 1
    strains: Annotated[Any, Either(Literal["kirchhoff_love", "simo_reissner"], tuple[Strain, ...])] = (
        "kirchhoff_love"
    )
    rest: dict[Strain, Number] = field(default_factory=dict)
    rate: RadianPerSecond | None = None
    visible: Flag = True
    parent: str = "world"

    def __post_init__(self):
        if self.parent == "nowhere":
            raise ValueError("parent nowhere is no place")


@record
class Chamber:
    """A pressure chamber."""

    area: Area
    limits: Limits[Pascal] | None = None
    from_: Number = 0.0


@record
class Robot:
    """A toy robot."""

    name: str
    segments: dict[str, Annotated[Any, OneOf({"rod": Rod}, "segment")]]
    actuators: dict[str, Annotated[Any, OneOf({"chamber": Chamber}, "actuator")]] = field(
        default_factory=dict
    )


GOOD = """\
name: toy
segments:
  arm:
    type: rod
    length: 50 mm
    cross_section:
      type: annulus
      radius: 12.5 mm
      inner_radius: 4.5 mm
    placement: [0, 0, 1 cm]
  tip:
    type: rod
    length: 0.1
    cross_section:
      start: {type: circle, radius: 5 mm}
      end:
        type: circle
        radius: 2 mm
        holes:
          - {offset: [0, 1 mm], radius: 0.5 mm}
          - offset: [0, -1 mm]
            radius: 0.5 mm
actuators:
  p1: {type: chamber, area: 19.6 mm^2, limits: [0, 140 kPa]}
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Reads a text or bytes as the file `r.yaml` into a Robot."""
    monkeypatch.chdir(tmp_path)

    def load(content):
        path = tmp_path / "r.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        document = read_yaml("r.yaml")
        return validate(Robot, document.data, document)

    return load


def complaint(load, content):
    """The lines of the error that a content gives."""
    with pytest.raises(FileError) as caught:
        load(content)
    return caught.value.lines()


def test_a_good_file_becomes_records(load):
    robot = load(GOOD)
    arm, tip = robot.segments["arm"], robot.segments["tip"]
    assert arm == Rod(0.05, Annulus(0.0125, 0.0045), (0.0, 0.0, 0.01))
    holes = (Hole((0.0, 0.001), 0.0005), Hole((0.0, -0.001), 0.0005))
    assert tip == Rod(0.1, Taper(Circle(0.005), Circle(0.002, holes)))
    assert robot.actuators["p1"] == Chamber(19.6e-6, (0.0, 140e3))


MISTAKES = [  # text of the good file, what replaces it, the error line
    (
        "length: 50 mm",
        "lenght: 50 mm",
        [
            "r.yaml:3: segments.arm.length: missing key 'length' (a length in m, e.g. '50 mm')",
            "r.yaml:5: segments.arm.lenght: unknown key 'lenght'; did you mean 'length'?",
        ],
    ),
    (
        "    length: 50 mm\n",
        "",
        ["r.yaml:3: segments.arm.length: missing key 'length' (a length in m, e.g. '50 mm')"],
    ),
    (
        "length: 50 mm",
        "length: 3 kg",
        ["r.yaml:5: segments.arm.length: 3 kg is a mass; a length is wanted, e.g. '50 mm' or 0.05"],
    ),
    ("length: 50 mm", "length: -3 mm", ["r.yaml:5: segments.arm.length: -3 mm is not positive"]),
    (
        "length: 50 mm",
        "length: '0.05'",
        ["r.yaml:5: segments.arm.length: '0.05' is text; drop the quotes: 0.05"],
    ),
    ("length: 50 mm", "length: .nan", ["r.yaml:5: segments.arm.length: nan is not a finite number"]),
    (
        "length: 50 mm",
        "length: true",
        ["r.yaml:5: segments.arm.length: true is given; a length in m, e.g. '50 mm' is wanted"],
    ),
    (
        "length: 50 mm",
        "length: 50 KM",
        ["r.yaml:5: segments.arm.length: unknown unit 'KM'; did you mean 'km'?"],
    ),
    ("[0, 0, 1 cm]", "[0, 1 cm]", ["r.yaml:10: segments.arm.placement: 2 numbers are given; 3 are wanted"]),
    (
        "[0, 0, 1 cm]",
        "[0, 0, 1 Pa]",
        [
            (
                "r.yaml:10: segments.arm.placement.2: 1 Pa is a pressure or modulus; a length is "
                "wanted, e.g. '50 mm' or 0.05"
            )
        ],
    ),
    (
        "[0, 0, 1 cm]",
        "[0, 0,\n      90 deg]",
        ["r.yaml:11: segments.arm.placement.2: 90 deg is an angle; a length is wanted, e.g. '50 mm' or 0.05"],
    ),
    (
        "[0, 0, 1 cm]",
        "1 cm",
        ["r.yaml:10: segments.arm.placement: '1 cm' is given; a list of 3 numbers is wanted"],
    ),
    (
        "type: annulus",
        "type: anulus",
        [
            (
                "r.yaml:7: segments.arm.cross_section.type: unknown cross-section 'anulus'; did you "
                "mean 'annulus'?"
            )
        ],
    ),
    (
        "type: annulus",
        "type: square",
        [
            (
                "r.yaml:7: segments.arm.cross_section.type: unknown cross-section 'square'; allowed: "
                "circle, annulus"
            )
        ],
    ),
    (
        "      type: annulus\n",
        "",
        ["r.yaml:6: segments.arm.cross_section.type: missing key 'type' (cross-section: circle or annulus)"],
    ),
    (
        "type: annulus",
        "type: circle",
        [
            (
                "r.yaml:9: segments.arm.cross_section.inner_radius: unknown key 'inner_radius' for "
                "type 'circle'; "
                "annulus has it"
            )
        ],
    ),
    (
        "inner_radius: 4.5 mm",
        "inner_radius: 20 mm",
        ["r.yaml:9: segments.arm.cross_section.inner_radius: inner_radius 0.02 is not below radius 0.0125"],
    ),
    ("placement:", "parent: nowhere #", ["r.yaml:3: segments.arm: parent nowhere is no place"]),
    ("placement: [0, 0, 1 cm]", "sections: 0", ["r.yaml:10: segments.arm.sections: 0 is below 1"]),
    (
        "placement: [0, 0, 1 cm]",
        "sections: [0.5, 1 m]",
        ["r.yaml:10: segments.arm.sections.1: 1 m is a length; a plain number is wanted, e.g. 0.5"],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "sections: {a: 1}",
        [
            (
                "r.yaml:10: segments.arm.sections: a mapping is given; a whole number of at least 1 "
                "or a list, "
                "each a number is wanted"
            )
        ],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "strains: kirchhof_love",
        [
            (
                "r.yaml:10: segments.arm.strains: 'kirchhof_love' is not known here; did you mean "
                "'kirchhoff_love'?"
            )
        ],
    ),
    (
        "placement: [0, 0, 1 cm]",
        'größe: "a\\nb"',
        [
            (
                "r.yaml:10: segments.arm.größe: unknown key 'größe'; allowed: length, cross_section, "
                "placement, sections, "
                "strains, rest, rate, visible, parent"
            )
        ],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "strains: [twist, bendy]",
        ["r.yaml:10: segments.arm.strains.1: 'bendy' is not known here; did you mean 'bend_y'?"],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "rest: {bend_x: 0}",
        ["r.yaml:10: segments.arm.rest.bend_x: 'bend_x' is not known here; did you mean 'bend_z'?"],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "rate: 2 Hz",
        ["r.yaml:10: segments.arm.rate: 2 Hz may count turns or radians; write e.g. '2 rad/s' or '2 turn/s'"],
    ),
    (
        "placement: [0, 0, 1 cm]",
        "visible: yes",
        ["r.yaml:10: segments.arm.visible: 'yes' is given; true or false is wanted"],
    ),
    ("placement: [0, 0, 1 cm]", "parent: 3", ["r.yaml:10: segments.arm.parent: 3 is given; text is wanted"]),
    (
        "start: {type: circle, radius: 5 mm}",
        "strat: {type: circle, radius: 5 mm}",
        [
            (
                "r.yaml:14: segments.tip.cross_section.start: missing key 'start' (a cross-section: "
                "a mapping with 'type' "
                "circle or annulus)"
            ),
            "r.yaml:15: segments.tip.cross_section.strat: unknown key 'strat'; did you mean 'start'?",
        ],
    ),
    (
        "radius: 2 mm",
        "radius: 2 N",
        [
            (
                "r.yaml:18: segments.tip.cross_section.end.radius: 2 N is a force; a length is wanted, "
                "e.g. '50 mm' or 0.05"
            )
        ],
    ),
    (
        "- {offset: [0, 1 mm], radius: 0.5 mm}",
        "- {offset: [0, 1 mm]}",
        [
            (
                "r.yaml:20: segments.tip.cross_section.end.holes.0.radius: missing key 'radius' (a "
                "length in m, "
                "e.g. '50 mm')"
            )
        ],
    ),
    (
        "offset: [0, -1 mm]",
        "offset: [0, 1, 2]",
        ["r.yaml:21: segments.tip.cross_section.end.holes.1.offset: 3 numbers are given; 2 are wanted"],
    ),
    (
        "offset: [0, -1 mm]",
        "offset: [0, 1 s]",
        [
            (
                "r.yaml:21: segments.tip.cross_section.end.holes.1.offset.1: 1 s is a time; a "
                "length is wanted, "
                "e.g. '50 mm' or 0.05"
            )
        ],
    ),
    (
        "[0, 140 kPa]",
        "[140 kPa, 0]",
        [
            (
                "r.yaml:24: actuators.p1.limits: [140 kPa, 0]: the lower limit is above the upper one; "
                "write [0, 140 kPa]"
            )
        ],
    ),
    (
        "limits: [0",
        "to: 1, limits: [0",
        ["r.yaml:24: actuators.p1.to: unknown key 'to'; allowed: area, limits, from"],
    ),
    (
        "  p1: {",
        "  p1: 3 #",
        ["r.yaml:24: actuators.p1: 3 is given; an actuator: a mapping with 'type' chamber is wanted"],
    ),
    ("name: toy\n", "", ["r.yaml:1: name: missing key 'name' (text)"]),
    (
        "actuators:\n",
        "actuators: 3\nx:\n",
        [
            "r.yaml:23: actuators: 3 is given; a mapping is wanted",
            "r.yaml:24: x: unknown key 'x'; allowed: name, segments, actuators",
        ],
    ),
]


@pytest.mark.parametrize(
    ("good", "bad", "lines"), MISTAKES, ids=[m[1].strip()[:30] or m[0] for m in MISTAKES]
)
def test_a_mistake_gives_its_line(load, good, bad, lines):
    assert GOOD.count(good) == 1 or good in ("[0, 0, 1 cm]",)
    assert complaint(load, GOOD.replace(good, bad)) == lines


def test_at_most_five_mistakes_are_shown_by_line(load):
    lines = complaint(
        load,
        GOOD.replace("type: rod\n", "type: rod\n    " + ", ".join("abcd") + ": 0\n")
        .replace("mm", "kg")
        .replace("cm", "kg"),
    )
    assert len(lines) == 6
    assert lines[-1].startswith("... and ")
    numbers = [int(line.split(":")[1]) for line in lines[:5]]
    assert numbers == sorted(numbers)


REFUSED = {  # content: the error line
    "": "r.yaml:1: the file is empty; a mapping of keys to values is wanted",
    "# only a comment\n": "r.yaml:1: the file is empty; a mapping of keys to values is wanted",
    "---\n": "r.yaml:1: the file is empty; a mapping of keys to values is wanted",
    "- 1\n- 2\n": "r.yaml:1: a list of 2 is given; a mapping of keys to values is wanted",
    "a: 1\nb: 2\na: 3\n": "r.yaml:3: key 'a' stands twice: here and on line 1",
    "a: 1\n---\nb: 2\n": "r.yaml:2: a second document starts here; one file holds one document",
    "%YAML 1.1\n---\na: 1\n": "r.yaml:2: YAML 1.1 is asked for; YAML 1.2 is read",
    "a: !!python/object:os.system {}\n": (
        "r.yaml:1: tag tag:yaml.org,2002:python/object:os.system is not read; write plain values"
    ),
    "a: !foo 1\n": "r.yaml:1: tag !foo is not read; write plain values",
    "b: &b {x: 1}\na:\n  <<: *b\n": "r.yaml:3: merge key '<<' is not read; write the keys out",
    "a: &a [1, *a]\n": "r.yaml:1: *a stands inside &a; it would never end",
    "base: &base 1\na: *bse\n": "r.yaml:2: unknown alias *bse; did you mean 'base'?",
    "1: x\n": "r.yaml:1: key 1 is not text; write it in quotes",
    "true: x\n": "r.yaml:1: key true is not text; write it in quotes",
    "~: x\n": "r.yaml:1: key nothing is not text; write it in quotes",
    "? [a]\n: x\n": "r.yaml:1: a key is plain text",
    "'': x\n": "r.yaml:1: key '' is not a name",
    "a: 1\n\tb: 2\n": "r.yaml:2: not YAML: while scanning for the next token, found character '\\t' "
    "that cannot start "
    "any token; indent with spaces, not with tabs",
    "a: 1\n b: 2\n": "r.yaml:2: not YAML: mapping values are not allowed here; check the "
    "indentation, or quote a "
    "text that holds ': '",
    "a: [1, 2\nb: 3\n": "r.yaml:2: not YAML: while parsing a flow sequence, expected ',' or ']', but got ':'",
    "a: 1\nb: 'x\nc: 2\n": "r.yaml:2: not YAML: while scanning a quoted scalar, found unexpected "
    "end of stream; "
    "a quote is not closed",
    "a: x\0y\n": "r.yaml:1: control character U+0000",
    "a: 1\nb: \x1b[31m\n": "r.yaml:2: control character U+001B",
    'a: "\\e[31m"\n': "r.yaml:1: control character in '\\x1b[31m'",
    'a: "\\uD800"\n': "r.yaml:1: control character in '\\ud800'",
    "a: " + "9" * 5000: "r.yaml:1: 99999999999999999999... has 5000 digits",
    "a: " + "[" * 45 + "]" * 45: "r.yaml:1: a: nested more than 40 deep",
    "\n".join(
        f"k{i}: 1" for i in range(10_000)
    ): "r.yaml:10000: more than 10000 values; is this the right file?",
    "a: &a [1,1,1,1,1,1,1,1,1,1]\n"
    + "".join(
        f"{new}: &{new} [{','.join([f'*{old}'] * 10)}]\n"
        for old, new in zip("abcdefg", "bcdefgh", strict=True)
    ): "r.yaml:1: more than 10000 values when aliases are written out",
    "a: &a0 [1]\n"
    + "".join(
        f"k{i}: &a{i + 1} [*a{i}]\n" for i in range(60)
    ): "r.yaml:1: nested more than 40 deep when aliases are written out",
}


@pytest.mark.parametrize("content", REFUSED, ids=[repr(c[:18]) for c in REFUSED])
def test_what_is_not_plain_yaml_is_refused_in_one_line(load, content):
    assert complaint(load, content) == [REFUSED[content]]


def test_bytes_that_are_not_utf8_name_their_line(load):
    assert complaint(load, b"a: 1\nb: \xff\n") == ["r.yaml:2: byte 0xFF is not UTF-8; save the file as UTF-8"]


def test_more_than_a_megabyte_is_refused_and_a_megabyte_is_read(load):
    assert complaint(load, "#" * (MAX_BYTES + 1)) == ["r.yaml:1: more than 1 MB; is this the right file?"]
    assert complaint(load, "#" * MAX_BYTES)[0].startswith("r.yaml:1: the file is empty")


def test_a_path_that_cannot_be_opened_is_another_error(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, reason in {
        tmp_path / "none.yaml": "cannot be read: No such file",
        tmp_path: "not an ordinary file",
        tmp_path / "pipe": "not an ordinary file",
        "a\0b": "cannot be read",
        "x" * 5000: "cannot be read",
    }.items():
        with pytest.raises(UnreadableFile, match=reason) as caught:
            read_yaml(path)
        assert "\n" not in str(caught.value)


NUMBERS = {
    "1e3": 1000.0,
    "1e-3": 0.001,
    "2.5e-3": 0.0025,
    "+1.5E+2": 150.0,
    "-.5": -0.5,
    "5.": 5.0,
    "-3": -3,
    "010": 10,
    "0x1F": 31,
    "0o17": 15,
    "1_000": "1_000",
    "1:30": "1:30",
    "2024-01-01": "2024-01-01",
    ".5e1": 5.0,
    "-.inf": -1e999,
    "yes": "yes",
    "on": "on",
    "NO": "NO",
    "True": True,
    "null": None,
    "~": None,
    "''": "",
    "'1'": "1",
    "0b1": "0b1",
}


@pytest.mark.parametrize("text", NUMBERS)
def test_plain_scalars_follow_the_core_schema_of_yaml_1_2(tmp_path, text):
    (tmp_path / "r.yaml").write_text(f"a: {text}\n")
    value = read_yaml(tmp_path / "r.yaml").data["a"]
    assert value == NUMBERS[text]
    assert type(value) is type(NUMBERS[text])


def test_aliases_are_copies_and_point_to_where_they_are_written(load):
    text = "x: &v {type: rod, length: 1 kg}\nname: a\nsegments:\n  arm: *v\n"
    assert (
        "r.yaml:1: segments.arm.length: 1 kg is a mass; a length is wanted, e.g. '50 mm' or 0.05"
        in complaint(load, text)
    )


def test_a_python_mapping_gives_the_same_records_and_errors_without_a_line():
    section = Circle(0.01)
    rod = validate(Rod, {"length": 0.1, "cross_section": section})
    assert rod.cross_section is section
    assert validate(Robot, {"name": "a", "segments": {"r": rod}}).segments["r"] is rod
    with pytest.raises(FileError) as caught:
        validate(Rod, {"length": -1, "cross_section": section}, path=("segments", "arm"))
    assert str(caught.value) == "segments.arm.length: -1 is not positive"
    assert (caught.value.file, caught.value.line) == (None, None)


def test_casadi_values_pass_from_python():
    length, y = ca.SX.sym("l"), ca.SX.sym("y")
    rod = validate(Rod, {"length": length, "cross_section": Circle(ca.MX.sym("r")), "placement": [0, y, 1]})
    assert rod.length is length
    assert rod.placement[1] is y


def test_a_set_replaces_a_value_and_later_errors_name_it(load):
    load(GOOD)
    document = read_yaml("r.yaml")

    def after(*settings):
        new = document
        for text in settings:
            new = override(new, text)
        return validate(Robot, new.data, new)

    assert after("segments.arm.length=60 mm").segments["arm"].length == 0.06
    assert after("segments.arm.placement.0 = 1e-3").segments["arm"].placement == (0.001, 0.0, 0.01)
    assert after("actuators.p1.limits=[1, 2 kPa]", "actuators.p1.from=0.5").actuators["p1"].from_ == 0.5
    assert after("segments.arm.cross_section={type: circle, radius: 1}").segments[
        "arm"
    ].cross_section == Circle(1.0)
    assert document.data["segments"]["arm"]["length"] == "50 mm"
    with pytest.raises(FileError) as caught:
        after("segments.arm.length=3 kg")
    assert str(caught.value) == (
        "--set segments.arm.length: 3 kg is a mass; a length is wanted, "
        "e.g. '50 mm' or 0.05"
    )
    with pytest.raises(FileError, match="--set segments.arm.size: unknown key 'size'"):
        after("segments.arm.size=3")
    with pytest.raises(FileError, match="^--set segments.arm: segments.arm.cross_section: missing key"):
        after("segments.arm={type: rod, length: 1}")


SETTINGS = {
    "segments.arm.length": "--set: 'segments.arm.length' is given; a.b=VALUE is wanted",
    "=3": "--set: '=3' is given; a.b=VALUE is wanted",
    "name=": "--set: 'name=' is given; a.b=VALUE is wanted",
    "segments.amr.length=3": "--set segments.amr.length: no key 'amr' in segments; did you mean 'arm'?",
    "segments.arm.length.x=3": (
        "--set segments.arm.length.x: segments.arm.length is '50 mm', not a mapping or list"
    ),
    "segments.arm.placement.3=1": (
        "--set segments.arm.placement.3: '3' is not an item of "
        "segments.arm.placement, a list of 3 (the first is 0)"
    ),
    "name=[1": (
        "--set name: not YAML: while parsing a flow sequence, expected ',' or ']', but got '<stream end>'"
    ),
    "name=*x": "--set name: unknown alias *x",
    "a..b=1": "--set a..b: no key 'a' in the file; allowed: name, segments, actuators",
}


@pytest.mark.parametrize("text", SETTINGS)
def test_a_bad_set_says_what_is_wrong_with_it(load, text):
    load(GOOD)
    with pytest.raises(FileError) as caught:
        override(read_yaml("r.yaml"), text)
    assert str(caught.value) == SETTINGS[text]


def test_a_set_finds_keys_that_hold_dots():
    document = Document({"expect": {"values.tip.position": {"value": 1}}})
    assert override(document, "expect.values.tip.position.value=2").data == {
        "expect": {"values.tip.position": {"value": 2}}
    }


def test_the_json_schema_names_keys_kinds_and_units():
    schema = json_schema(Robot)
    text = json.dumps(schema)
    assert "a length in m, e.g. '50 mm'" in text
    rod = schema["properties"]["segments"]["additionalProperties"]["oneOf"][0]
    assert rod["properties"]["type"]["const"] == "rod"
    assert rod["required"][:2] == ["type", "length"]
    assert rod["additionalProperties"] is False
    section = rod["properties"]["cross_section"]["anyOf"][0]["oneOf"]
    assert [s["properties"]["type"]["const"] for s in section] == ["circle", "annulus"]
    assert "from" in text
    assert "from_" not in text
    references = {part.split('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert references <= set(schema["$defs"])


def only_file_errors(path, content):
    """Reads and fills a content; nothing but a FileError of printable lines may come out."""
    path.write_bytes(content)
    try:
        document = read_yaml(path)
        validate(Robot, document.data, document)
    except FileError as error:
        assert all(line.isprintable() for line in error.lines())


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(content=st.binary(max_size=60))
def test_only_a_file_error_comes_out_of_any_bytes(tmp_path_factory, content):
    only_file_errors(tmp_path_factory.getbasetemp() / "fuzz.yaml", content)


PIECES = [
    "a",
    ": ",
    "\n",
    "  ",
    "- ",
    "[",
    "]",
    "{",
    "}",
    ",",
    "'",
    '"',
    "#",
    "&a ",
    "*a",
    "!",
    "!!int ",
    "|",
    ">",
    "? ",
    "<<",
    "---",
    "...",
    "%YAML 1.2",
    "\t",
    "1e3",
    ".nan",
    "\\",
    "\\U00110000",
    "~",
    "@",
    "é",
    "\u2028",
    "\r",
    "type",
]


@settings(max_examples=400, deadline=None, derandomize=True, database=None)
@given(content=st.lists(st.sampled_from(PIECES), max_size=30).map("".join))
def test_only_a_file_error_comes_out_of_any_yaml(tmp_path_factory, content):
    only_file_errors(tmp_path_factory.getbasetemp() / "fuzz.yaml", content.encode())


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_only_a_file_error_comes_out_of_a_damaged_robot(tmp_path_factory, data):
    lines = GOOD.split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(lines) - 1))
        key = lines[i].partition(":")[0]
        value = data.draw(
            st.sampled_from(
                [
                    "{}",
                    "[]",
                    "3",
                    "-1 m",
                    "[[1]]",
                    "[1, a]",
                    "~",
                    "true",
                    "{type: rod}",
                    "x",
                    "{start: 3}",
                    "[{}]",
                    "0.5",
                    "1e400 m",
                    "5 %",
                    "{type: [1]}",
                    "{a: 1}",
                ]
            )
        )
        lines[i] = data.draw(
            st.sampled_from([f"{key}: {value}", lines[i] + "x", lines[i][:-1], "", lines[i][1:]])
        )
    only_file_errors(tmp_path_factory.getbasetemp() / "fuzz.yaml", "\n".join(lines).encode())


SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**9), 10**9), st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufeff\ufffe\uffff")),
    st.sampled_from(["null", "1e3", "0x1f", "yes", "~", "", "- a", "a: b", "<<", "2 mm", "1.5", ".nan", "# a"]),
)  # fmt: skip
KEYS = st.from_regex(r"[A-Za-z][A-Za-z0-9_.]{0,9}", fullmatch=True) | st.sampled_from(["null", "1", "no", "a b"])
PLAIN = st.dictionaries(KEYS, st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4), max_leaves=12,
), min_size=1, max_size=5)  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(PLAIN)
def test_written_yaml_reads_back_as_the_same_data_in_the_same_order(data):
    again = parse(yaml_text(data)).data
    assert again == data and list(again) == list(data)
    assert repr(again) == repr(data), "types and the order of inner keys too"
