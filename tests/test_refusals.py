"""What a robot file may not say, and lines at the edge of what they can do."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from robots import array, gap, rod, spring

from socontrol.files.loader import FileError, validate
from socontrol.mechanics.actuators import Chamber, JointTorque, Tendon
from socontrol.mechanics.lines import Chord, line_element
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import JOINTS, Cylindrical, Fixed, Free, Prismatic, Revolute, Spherical
from socontrol.model.materials import Gent, Polynomial
from socontrol.model.sections import General, SectionTable, TableRow, Taper

ARM = Placement(position=(0.05, 0.0, 0.0))
ELASTIC = dict(young_modulus=3e5, shear_modulus=1.1e5, density=1080.0)
NUMBERS = General(stiffness=(0.01, 0.02, 0.03, 90.0, 40.0, 50.0), inertia=(1e-5, 2e-5, 3e-5, 0.3, 0.3, 0.3))
PROFILES = {
    "one section": NUMBERS,
    "taper": Taper(start=NUMBERS, end=NUMBERS),
    "table": SectionTable(table=(TableRow(at=0.0, section=NUMBERS), TableRow(at=1.0, section=NUMBERS))),
}


def chain(along, **changes):
    """A cable along some of: base rod, hinge, link without motion, tip rod; `side` stands at half of the base."""
    segments = {
        "base": rod(sections=1),
        "hinge": Revolute(parent="base", tip=ARM),
        "link": Fixed(parent="hinge", tip=ARM),
        "tip": rod(parent="link", sections=1),
        "side": rod(parent="base", at=0.5, sections=1),
        "other": rod(sections=1),
        **changes,
    }
    return Description(segments=segments, actuators={"t": Tendon(along=along, offset=(0.003, 0.0))})


def named(segment="a", actuator="t", load="w"):
    return Description(
        segments={segment: rod(sections=1)},
        actuators={actuator: Tendon(along=(segment,), offset=(0.003, 0.0))},
        loads={load: Wrench(on=segment)},
    )


TURN, SLIDE = ((-1.0, 1.0),) * 3, ((0.0, 0.1),) * 3
REFUSED = {
    "joint left out": (lambda: chain(("base", "tip")), "actuators.t.along.1", "joint 'hinge' .*; name it too"),
    "rod left out": (
        lambda: chain(("hinge", "more"), more=Revolute(parent="tip", tip=ARM)),
        "actuators.t.along.1",
        "rod 'tip' stands between 'hinge' and 'more'; name it too",
    ),
    "out of order": (lambda: chain(("hinge", "base")), "actuators.t.along.1", "'base' does not stand on the end"),
    "another root": (lambda: chain(("base", "other")), "actuators.t.along.1", "'other' does not stand on the end"),
    "half way": (lambda: chain(("base", "side")), "actuators.t.along.1", "not stand on the end .* X = 0.5"),
    "siblings": (lambda: chain(("base", "hinge", "side")), "actuators.t.along.2", "'side' does not stand on"),
    "chambers apart": (
        lambda: Description(
            segments={"a": rod(), "b": rod()},
            actuators={"p": Chamber(along=("a", "b"), offset=(0.0, 0.0), area=1e-5)},
        ),
        "actuators.p.along.1",
        "'b' does not stand on the end of 'a'",
    ),
    "limits of nothing": (lambda: Fixed(limits=()), "limits", "no coordinate to limit"),
    "limits of a link": (lambda: Fixed(limits=(0.0, 1.0)), "limits", "no coordinate to limit"),
    "five limits of six": (lambda: Free(limits=TURN + SLIDE[:2]), "limits", "5 pairs given, 6 wanted"),
    "no limits of six": (lambda: Free(limits=()), "limits", "0 pairs given, 6 wanted"),
    "no limits of one": (lambda: Revolute(limits=()), "limits", "0 pairs given, 1 wanted"),
    "no torque limits": (lambda: JointTorque(joint="a", limits=()), "limits", "empty"),
    "no tension limits": (lambda: Tendon(along=("a",), offset=(0.0, 0.0), limits=()), "limits", "empty"),
    "no chamber": (lambda: Chamber(along=("a",), offset=(), area=1.0), "offset", "empty"),
    "whole gent limit 0": (lambda: Gent(bend_limit=0, **ELASTIC), "bend_limit", "0 is no limit"),
    "negative spring": (lambda: Revolute(stiffness=-1.0), "stiffness", "stiffness of -1 is negative"),
    "negative springs": (lambda: Cylindrical(stiffness=(1.0, -2.0)), "stiffness.1", "stiffness of -2 is negative"),
    "negative dampers": (lambda: Cylindrical(damping=(-3.0, 0.0)), "damping.0", "damping of -3 is negative"),
    "skew spring": (
        lambda: Cylindrical(stiffness=((2.0, 1.0), (0.0, 2.0))),
        "stiffness",
        "not symmetric: 1 in row 1, column 2, but 0 in row 2, column 1",
    ),
    "skew part alone": (lambda: Cylindrical(damping=((0, 1.0), (-1.0, 0))), "damping", "not symmetric"),
    "indefinite spring": (
        lambda: Cylindrical(stiffness=((1.0, 2.0), (2.0, 1.0))),
        "stiffness",
        "not positive semidefinite: its smallest eigenvalue is -1",
    ),
    "coupling alone": (lambda: Cylindrical(damping=((0, 1.0), (1.0, 0))), "damping", "semidefinite"),
    "soft and indefinite": (  # the eigenvalue -3e-6 is far below the other one, 1e6
        lambda: Cylindrical(stiffness=((1e-6, 2.0), (2.0, 1e6))),
        "stiffness",
        "semidefinite",
    ),
    "negative diagonal": (lambda: Cylindrical(damping=((-1.0, 0), (0, 1.0))), "damping", "-1 on the diagonal"),
    "negative inertia": (lambda: Body(mass=1.0, inertia=(1.0, 1.0, -1.0)), "inertia", "-1 on the diagonal"),
    "thick inertia": (lambda: Body(mass=1.0, inertia=(1.0, 1.0, 2.1)), "inertia", "sum of the other two"),
    "turned inertia": (  # principal moments 0.1, 1.9 and 1
        lambda: Body(mass=1.0, inertia=(1.0, 1.0, 1.0, 0.9, 0.0, 0.0)),
        "inertia",
        "principal moments 0.1, 1, 1.9",
    ),
    "indefinite inertia": (lambda: Body(mass=1.0, inertia=(1, 1, 1, 2, 0, 0)), "inertia", "semidefinite"),
    "skew inertia": (
        lambda: Body(mass=1.0, inertia=((1.0, 0.1, 0.0), (0.2, 1.0, 0.0), (0.0, 0.0, 1.0))),
        "inertia",
        "not symmetric",
    ),
    "whole mass 0": (lambda: Body(mass=0, inertia=(1, 1, 1)), "mass", "needs a mass"),
    "world": (lambda: named(segment="world"), "segments.world", "rename the segment"),
    "dot": (lambda: named(segment="a.0"), "segments.a.0", "'a.0' is no name; use letters, digits, _ or -"),
    "space": (lambda: named(segment="a b"), "segments.a b", "use letters"),
    "digit first": (lambda: named(segment="0a"), "segments.0a", "a letter or _ first"),
    "no letter": (lambda: named(segment=""), "segments.", "use letters"),
    "line feed": (lambda: named(segment="a\n"), "segments.a\n", "use letters"),
    "accent": (lambda: named(actuator="é"), "actuators.é", "use letters"),
    "actuator with a dot": (lambda: named(actuator="m.1"), "actuators.m.1", "use letters"),
    "load with a slash": (lambda: named(load="w/1"), "loads.w/1", "use letters"),
    **{
        f"{kind.__name__} of numbers, {name}": (
            lambda kind=kind, profile=profile: rod(cross_section=profile, material=kind(**ELASTIC)),
            "material",
            f"'{kind.__name__.lower()}' needs a cross-section with a shape",
        )
        for kind in (Gent, Polynomial)
        for name, profile in PROFILES.items()
    },
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_fit_is_refused_at_its_key(name):
    make, key, sentence = REFUSED[name]
    with pytest.raises(ValueError, match=sentence) as caught:
        make()
    assert caught.value.key == key
    assert "\n" not in str(caught.value)


WELCOME = {
    "whole chain": lambda: chain(("base", "hinge", "link", "tip")),
    "links without motion may be left out": lambda: chain(("base", "hinge", "tip")),
    "two such links": lambda: chain(("base", "tip"), hinge=Fixed(parent="base"), link=Fixed(parent="hinge", at=0.0)),
    "limits of a free body": lambda: Free(limits=TURN + SLIDE),
    "gent limit": lambda: Gent(bend_limit=1, stretch_limit=None, **ELASTIC),
    "names": lambda: named("a-1", "_t", "W_2"),
    "rod of mass at its ends": lambda: Body(mass=1.0, inertia=(0.0, 1.0, 1.0)),
    "disc": lambda: Body(mass=1, inertia=(1, 1, 2)),
    "rounded spring": lambda: Spherical(stiffness=tuple((1.0, 1.0, 1.0 + 1e-12 * i) for i in range(3))),
    "full spring": lambda: Free(stiffness=spring(6), damping=spring(6)),
    "springs of very different units": lambda: Cylindrical(stiffness=((1e-6, 0.9), (0.9, 1e6))),
    "symbols": lambda: Body(mass=ca.SX.sym("m"), inertia=(ca.SX.sym("J"), 1.0, 5.0)),
    "symbolic springs": lambda: [
        Cylindrical(stiffness=(ca.SX.sym("k"), 1.0), damping=((ca.MX.sym("d"), 0.0), (0.0, 1.0))),
        Revolute(stiffness=ca.SX.sym("k")),
        Gent(bend_limit=ca.SX.sym("m"), **ELASTIC),
    ],
}


@pytest.mark.parametrize("name", WELCOME)
def test_what_fits_is_welcome(name):
    assert WELCOME[name]()


def test_empty_springs_of_a_link_have_no_entries():
    link = Fixed(stiffness=(), damping=(), rest=())
    assert link.matrix("stiffness").shape == link.matrix("damping").shape == (0, 0)
    assert Robot(Description(segments={"link": link})).joint_limits == ()


def test_limits_of_a_free_body_are_read_with_their_units():
    turn, slide = ["-90 deg", "90 deg"], ["0 mm", "100 mm"]
    read = validate(Free, {"limits": [turn] * 3 + [slide] * 3})
    assert read.limit_pairs() == ((-np.pi / 2, np.pi / 2),) * 3 + ((0.0, 0.1),) * 3
    with pytest.raises(FileError, match="limits.3.0"):
        validate(Free, {"limits": [turn] * 4 + [slide] * 2})


@pytest.mark.parametrize("kind", JOINTS)
def test_an_empty_list_of_limits_is_refused_in_files(kind):
    with pytest.raises(FileError, match="segments.a.limits"):
        validate(
            Description,
            {"segments": {"a": {"type": kind, "limits": [], **({"pitch": 1} if kind == "helical" else {})}}},
        )


# Lines of no length


def slider():
    """A cable through a prismatic joint whose two guide holes meet at q = -0.05."""
    segments = {"slide": Prismatic(tip=ARM, stiffness=10.0)}
    return Robot(Description(segments=segments, actuators={"t": Tendon(along=("slide",), offset=(0.0, 0.0))}))


def test_a_chord_of_no_length_has_a_finite_force_and_slope():
    robot, q = slider(), ca.DM([-0.05])
    ((chord,),) = robot.lines
    assert isinstance(chord, Chord)
    for value in (chord.length(robot.tree, q), chord.force(robot.tree, q), chord.gradient(robot.tree, q)):
        assert np.isfinite(array(value)).all()
    x = ca.SX.sym("q")
    slopes = ca.Function(
        "slopes", [x], [ca.jacobian(chord.length(robot.tree, x), x), ca.hessian(chord.length(robot.tree, x), x)[0]]
    )
    assert np.isfinite([float(slope) for slope in slopes(q)]).all()


@pytest.mark.parametrize("q", [-0.05, -0.05 + 3e-11, -0.05 - 1e-10, -0.02, 0.0, 0.03])
def test_the_force_of_a_chord_is_the_slope_of_its_length_down_to_no_length(q):
    robot, x = slider(), ca.SX.sym("q")
    ((chord,),) = robot.lines
    length = chord.length(robot.tree, x)
    exact = ca.Function("exact", [x], [-ca.jacobian(length, x), -ca.hessian(length, x)[0]])(q)
    given = (chord.force(robot.tree, ca.DM([q])), chord.gradient(robot.tree, ca.DM([q])))
    for value, expected, scale in zip(given, exact, (1.0, 2e10), strict=True):  # 2e10 = 1 / (1e-9 0.05 m)
        assert abs(float(value) - float(expected)) < 1e-9 * scale
    if abs(q + 0.05) > 1e-3:
        assert float(length_at(chord, robot, q)) == abs(q + 0.05)


def length_at(chord, robot, q):
    return chord.length(robot.tree, ca.DM([q]))


def test_a_line_squeezed_to_no_length_has_a_finite_force_and_slope():
    none = [0, 0, 0, 0, 0, 0]
    for value in line_element()(none, [0, 0.01, 0], [0, 0, 0]):
        assert np.isfinite(array(value)).all()
    squeezed = Robot(
        Description(segments={"rod": rod(sections=1)}, actuators={"t": Tendon(along=("rod",), offset=(0.0, 0.0))})
    )
    ((line,),) = squeezed.lines
    assert np.isfinite(array(line.wrench(squeezed.tree, ca.DM([0, 0, 0, -1]), 0.5))).all()


# Chambers that push along the normal


@pytest.mark.parametrize("q", [np.zeros(8), np.linspace(-0.8, 1.1, 8)])
def test_the_push_along_the_normal_is_the_slope_of_its_length(q):
    chamber = Chamber(along=("rod",), offset=(-0.004, 0.005), area=2e-5, direction="normal")
    robot = Robot(Description(segments={"rod": rod(rest={"bend_z": (3.0, -1.0)})}, actuators={"p": chamber}))
    of, x = robot.functions(), ca.SX.sym("q", 8)
    slope = ca.Function("slope", [x], [ca.jacobian(sum(s.length(robot.tree, x) for s in robot.lines[0]), x)])(q)
    assert gap(chamber.area * array(slope).ravel(), of.actuation(q)) < 1e-13
    tangent = Robot(replace(robot.description, actuators={"p": replace(chamber, direction="tangent")}))
    if not q.any():
        assert gap(of.actuator_lengths(q), tangent.functions().actuator_lengths(q)) < 1e-14


# Size


def test_where_a_robot_stands_is_not_part_of_its_length():
    def size(position):
        segments = {
            "arm": rod(length=0.25, placement=Placement(position=position)),
            "hinge": Revolute(parent="arm", placement=Placement(position=(0.0, 0.02, 0.0)), tip=ARM),
        }
        return Robot(Description(segments=segments)).length

    assert size((3.0, -4.0, 12.0)) == size((0.0, 0.0, 0.0)) == pytest.approx(0.25 + 0.02 + 0.05)
