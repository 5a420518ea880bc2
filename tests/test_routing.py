"""Where lines run: helices, guide holes and straight runs; forces are the slopes of lengths, lengths those of space.

The lengths themselves are held against polygons of the numpy robot for every kind in `test_statics_terms`.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from robots import DISC, ROBOTS, RUBBER, array, gap, rod

import socontrol as so
from socontrol.files.loader import FileError
from socontrol.mechanics import routes
from socontrol.mechanics.actuators import Chamber, JointTorque, Tendon
from socontrol.mechanics.lines import NormalLine, Run
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.routes import Converging, Helix
from socontrol.model.bodies import Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.rods import Rod
from socontrol.report import shapes

CONFIGS = Path(__file__).parent.parent / "configs" / "robots"
SHIPPED = ["steel_rod_helical", "gripper_finger", "hybrid_arm_coarse"]
LINED = [
    name
    for name, description in ROBOTS.items()
    if any(not isinstance(actuator, JointTorque) for actuator in (description.actuators or {}).values())
]


@cache
def made(name):
    return Robot(ROBOTS[name]) if name in ROBOTS else so.load_robot(CONFIGS / f"{name}.yaml")


def drawn(robot, seed=0):
    """Random coordinates, sections bent by up to a radian."""
    pieces = robot.tree.pieces
    size = [0.8 / float(p.length) if unit == "1/m" else 0.1 if unit in ("1", "m") else 0.8
            for p in pieces for unit in robot.coordinate_units[p.columns]]  # fmt: skip
    return np.random.default_rng(seed).uniform(-1, 1, robot.n) * size


# Routes


@pytest.mark.parametrize(
    "kind",
    [
        routes.Parallel((0.004, -0.003)),
        Converging(start=(0.008, 0.002), end=(-0.003, 0.005)),
        Helix(radius=0.006, turns=1.7, phase=0.3),
        Helix(radius=0.006, turns=-0.6, end_radius=0.0),
    ],
)
def test_slopes_of_a_route_are_its_derivatives_along_the_way(kind):
    X, route = ca.SX.sym("X"), routes.Route(kind, 0.4)
    first = ca.jacobian(route.at(X), X) / 0.4
    both = ca.Function("both", [X], [route.slope(X) - first, route.bend(X) - ca.jacobian(first, X) / 0.4])
    for place in (0.0, 0.3, 1.0):
        for difference in both(place):
            assert np.abs(array(difference)).max() < 1e-12


def test_a_helix_winds_from_its_phase_by_its_turns_at_its_radius():
    route = routes.Route(Helix(radius=0.006, turns=0.75, phase=0.5, end_radius=0.002), 0.2)
    for X in (0.0, 0.4, 1.0):
        _, y, z = array(route.at(X))
        angle = 0.5 + 2 * np.pi * 0.75 * X
        np.testing.assert_allclose([y, z], (0.006 - 0.004 * X) * np.array([np.cos(angle), np.sin(angle)]), atol=1e-17)


# Forces are slopes of lengths


@cache
def slopes_of_lengths(name):
    q = ca.SX.sym("q", made(name).n)
    return ca.Function("slopes", [q], [ca.jacobian(made(name).functions().actuator_lengths(q), q)])


@pytest.mark.parametrize("name", [*LINED, *SHIPPED])
def test_a_force_is_its_gain_times_the_slope_of_the_length(name):
    robot = made(name)
    actuators = {k: a for k, a in robot.description.actuators.items() if not isinstance(a, JointTorque)}
    gains = {k: -1.0 if isinstance(a, Tendon) else getattr(a, "area", 1.0) for k, a in actuators.items()}
    for q in (np.zeros(robot.n), drawn(robot, 1), drawn(robot, 2)):
        B, slope = array(robot.functions().actuation(q)), array(slopes_of_lengths(name)(q))
        B, slope = B.reshape(robot.n, -1), slope.reshape(-1, robot.n)
        for k, gain in gains.items():
            column = robot.inputs.index(k)
            assert gap(B[:, column], gain * slope[column]) < 1e-12


def test_a_helix_of_no_turns_is_a_parallel_line():
    q = drawn(made("guided"), 3)
    changes = [Helix(radius=0.005, turns=0.0, phase=0.6), (0.005 * np.cos(0.6), 0.005 * np.sin(0.6))]
    found = []
    for offset in changes:
        cable = Tendon(along=("lower", "block", "hinge", "upper"), offset=offset)
        robot = Robot(replace(ROBOTS["guided"], actuators={"c": cable}))
        found.append((array(robot.functions().actuation(q)), array(robot.functions().actuator_lengths(q))))
    assert gap(found[0][0], found[1][0]) < 1e-13
    assert gap(found[0][1], found[1][1]) < 1e-13


def arm(sections=2, strains="simo_reissner", **actuators):
    own = Rod(length=0.2, cross_section=DISC, material=RUBBER, sections=sections, strains=strains)
    return Robot(Description(segments={"arm": own}, actuators=actuators, gravity=(0.0, 0.0, 0.0)))


def test_mirrored_helices_on_mirrored_arms_pull_mirrored():
    """y -> -y: angles are mirrored about 90 deg, turns change their sense, and so do twist, bend_z and shear_y."""
    right = arm(c=Tendon(along=("arm",), offset=Helix(radius=0.006, turns=0.8, phase=0.4)))
    left = arm(c=Tendon(along=("arm",), offset=Helix(radius=0.006, turns=-0.8, phase=np.pi - 0.4)))
    mirror, q = np.tile([-1, 1, -1, 1, -1, 1], 2), drawn(right, 4)
    assert gap(left.functions().actuator_lengths(mirror * q), right.functions().actuator_lengths(q)) < 1e-13
    assert gap(left.functions().actuation(mirror * q), mirror * array(right.functions().actuation(q))) < 1e-13


def test_a_helical_cable_twists_an_arm_about_the_sense_in_which_it_winds():
    """About the axis of a straight arm its moment is T r^2 w / c, w = 2 pi turns / L, c^2 = 1 + (r w)^2."""
    for turns in (1.0, -0.5):
        robot = arm(sections=1, c=Tendon(along=("arm",), offset=Helix(radius=0.006, turns=turns)))
        w = 2 * np.pi * turns / 0.2
        c = np.sqrt(1 + (0.006 * w) ** 2)
        B = array(robot.functions().actuation(np.zeros(6)))
        np.testing.assert_allclose(B[[0, 3]], [-0.2 * 0.006**2 * w / c, -0.2 / c], rtol=1e-13)
        np.testing.assert_allclose(robot.functions().actuator_lengths(np.zeros(6)), 0.2 * c, rtol=1e-13)


# Holes and straight runs


GUIDE = ((-0.01, 0.02, 0.0), (0.04, 0.03, 0.0))


def lever(holes, along=("mast", "boom")):
    """A mast on the world with holes, a boom on a hinge at its end 0.1 m up."""
    return Robot(
        Description(
            segments={
                "mast": Fixed(tip=Placement(position=(0.1, 0.0, 0.0))),
                "boom": Revolute(parent="mast", axis=(0.0, 0.0, 1.0), tip=Placement(position=(0.08, 0.0, 0.0))),
            },
            actuators={"c": Tendon(along=along, offset=(0.01, 0.0), holes=holes)},
        )
    )


@pytest.mark.parametrize("angle", [0.0, 0.7, -1.2])
def test_a_cable_runs_straight_from_hole_to_hole_and_turns_a_hinge_by_its_lever(angle):
    holes = {"mast": ((0.02, 0.01, 0.0), (0.07, 0.03, 0.0)), "boom": GUIDE}
    f = lever(holes).functions()
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = [np.array(p[:2]) for p in holes["mast"]] + [[0.1, 0.0] + R @ p[:2] for p in GUIDE]
    steps = np.diff(points, axis=0)
    np.testing.assert_allclose(f.actuator_lengths([angle]), np.linalg.norm(steps, axis=1).sum(), rtol=1e-14)
    pull = -steps[1] / np.linalg.norm(steps[1])  # on the boom's first hole, towards the mast
    r = points[2] - [0.1, 0.0]
    np.testing.assert_allclose(f.actuation([angle]), r[0] * pull[1] - r[1] * pull[0], rtol=1e-13)


def test_without_holes_a_cable_passes_the_planes_where_a_rigid_segment_begins_and_ends():
    q = [0.6]
    planes = {"mast": ((0.0, 0.01, 0.0), (0.1, 0.01, 0.0))}
    given, plain = lever(planes).functions(), lever(None).functions()
    assert gap(given.actuator_lengths(q), plain.actuator_lengths(q)) < 1e-14
    assert gap(given.actuation(q), plain.actuation(q)) < 1e-14


def test_holes_guide_a_cable_through_joints_without_a_tip():
    holes = {"mast": ((0.0, 0.02, 0.0),), "boom": ((0.0, 0.01, 0.0), (0.0, 0.03, 0.0))}
    robot = lever(holes)
    bare = {name: replace(segment, tip=Placement()) for name, segment in robot.description.segments.items()}
    f = Robot(replace(robot.description, segments=bare)).functions()
    np.testing.assert_allclose(f.actuator_lengths([0.0]), 0.01 + 0.02, rtol=1e-14)
    with pytest.raises(ValueError, match="no length through the joint 'boom'"):
        Robot(replace(lever(None).description, segments=bare))


@pytest.mark.parametrize(
    ("cable", "straight"),
    [
        ({"along": ("foot", "arm", "disc", "top")}, 0.01 + 0.2 + 2 * 0.02 + 0.1),
        ({"along": ("foot", "arm"), "to": 0.25}, 0.01 + 0.05),
        ({"along": ("arm", "disc"), "from_": 0.25}, 0.15 + 0.02),
        ({"along": ("arm", "disc", "top"), "to": 2 / 3}, 0.2 + 0.02),
        ({"along": ("arm", "disc", "top"), "from_": 0.666666667}, 0.02 + 0.1),
        ({"along": ("arm", "disc", "top", "block"), "to": 0.857142857}, 0.2 + 2 * 0.02 + 0.1),  # 0.3 of 0.35 m
        ({"along": ("top", "block"), "from_": 0.666666667}, 0.05),
    ],
)
def test_holes_in_segments_of_no_length_are_passed_where_the_line_begins_and_ends(cable, straight):
    """A hole 10 mm below the first rod and 20 mm beside the line at a disc between two rods."""
    holes = {"foot": ((-0.01, 0.005, 0.0),), "disc": ((0.0, 0.025, 0.0),)}
    kept = {name: points for name, points in holes.items() if name in cable["along"]}
    straight_on = {"sections": 1, "placement": Placement()}
    segments = {
        "foot": Revolute(axis=(0.0, 0.0, 1.0)),
        "arm": rod(parent="foot", length=0.2, **straight_on),
        "disc": Fixed(parent="arm"),
        "top": rod(parent="disc", length=0.1, **straight_on),
        "block": Fixed(parent="top", tip=Placement(position=(0.05, 0.0, 0.0))),
    }
    robot = Robot(Description(segments=segments, actuators={"c": Tendon(offset=(0.005, 0.0), holes=kept, **cable)}))
    np.testing.assert_allclose(robot.functions().actuator_lengths(np.zeros(robot.n)), straight, rtol=1e-8)


def test_rigid_blocks_and_gaps_count_in_the_length_of_a_cable():
    finger = made("gripper_finger").functions()
    np.testing.assert_allclose(finger.actuator_lengths(np.zeros(12)), 0.09, rtol=1e-14)  # 3 x 10 mm, 3 x 20 mm
    apart = Placement(position=(0.01, 0.0, 0.03))
    segments = {"low": rod(sections=1, placement=Placement()), "high": rod(parent="low", sections=1, placement=apart)}
    robot = Robot(Description(segments=segments, actuators={"c": Tendon(along=("low", "high"), offset=(0.004, 0.0))}))
    (lines,) = robot.lines
    assert [type(line) is Run for line in lines] == [False, True, False]
    np.testing.assert_allclose(robot.functions().actuator_lengths(np.zeros(8)), 0.5 + np.hypot(0.01, 0.03), rtol=1e-14)


def test_the_gap_between_rods_is_no_part_of_a_chamber():
    apart = Placement(position=(0.01, 0.0, 0.03))
    segments = {"low": rod(sections=1, placement=Placement()), "high": rod(parent="low", sections=1, placement=apart)}
    chamber = Chamber(along=("low", "high"), offset=(0.004, 0.0), area=1e-5)
    f = Robot(Description(segments=segments, actuators={"p": chamber})).functions()
    np.testing.assert_allclose(f.actuator_lengths(np.zeros(8)), 0.5, rtol=1e-14)


@pytest.mark.parametrize("path, value", [
    ("actuators.helix.offset.radius", 0.007), ("actuators.helix.offset.turns", 0.5),
    ("hinge.tip.position", (0.05, 0.01, 0.02)), ("block.placement.position", (0.01, 0.0, 0.0)),
    ("actuators.guided.holes.hinge", ((0.02, 0.001, 0.003),)),
])  # fmt: skip
def test_routes_and_holes_are_parameters(path, value):
    """A parameter gives what a robot with that value gives, with finite slopes."""
    description = ROBOTS["guided"]
    cables = {name: description.actuators[name] for name in ("helix", "guided", "wound")}
    robot = Robot(replace(description, actuators=cables))
    f, q, p = robot.functions(parameters=[path]), drawn(robot, 5), np.ravel(value)
    other = robot.with_values({path: value}).functions()
    for name in ("actuation", "actuator_lengths"):
        assert gap(getattr(f, name)(q, p), getattr(other, name)(q)) < 1e-12
        symbol = ca.SX.sym("p", p.size)
        slope = ca.Function("slope", [symbol], [ca.jacobian(getattr(f, name)(q, symbol), symbol)])(p)
        assert np.isfinite(array(slope)).all()


# Drawing


@pytest.mark.parametrize("name, tolerance", [("guided", 2e-3), ("steel_rod_helical", 2e-3), ("gripper_finger", 2e-3)])
def test_cables_are_drawn_where_they_run(name, tolerance):
    """Drawn polygons are as long as the cables, up to their corners; those of a helix keep their distance."""
    robot = made(name)
    q = drawn(robot, 6)
    posed, lengths = shapes.Posed(robot, q), array(robot.functions().actuator_lengths(q)).reshape(-1)
    for k, lines in enumerate(robot.lines):
        if isinstance(lines[0], NormalLine):
            continue
        found = sum(np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p, _, _ in shapes.cables(posed, k))
        assert found <= lengths[k] * (1 + 1e-9) and found > lengths[k] * (1 - tolerance), robot.inputs[k]
    if name == "steel_rod_helical":
        ((_, outward, _),) = shapes.cables(posed, robot.inputs.index("helix"))
        np.testing.assert_allclose(np.linalg.norm(outward, axis=1), 0.008, rtol=1e-12)


def test_a_helix_of_many_turns_in_one_section_is_drawn_round():
    robot = arm(sections=1, c=Tendon(along=("arm",), offset=Helix(radius=0.01, turns=-7.0)))
    ((points, _, _),) = shapes.cables(shapes.Posed(robot, np.zeros(6)), 0)
    length = float(robot.functions().actuator_lengths(np.zeros(6)))
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(length, rel=2e-3)


# Refusals


def described(cable, **segments):
    arm = {"type": "rod", "length": "0.2 m", "cross_section": {"type": "circle", "radius": "1 cm"},
           "material": {"type": "linear", "young_modulus": "1 MPa", "poisson_ratio": 0.5, "density": 1000}}  # fmt: skip
    block = {"type": "fixed", "parent": "arm", "tip": {"position": ["2 cm", 0, 0]}}
    cable = {"type": "tendon", "along": ["arm", "block"], "offset": ["5 mm", 0], **cable}
    return {"segments": {"arm": arm, "block": block, "spare": {"type": "fixed"}}, "actuators": {"c": cable}}


HELIX = {"type": "helix", "radius": "5 mm", "turns": 1}
REFUSED = {
    "unknown segment": ({"holes": {"blok": [[0, 0, 0]]}}, r"c\.holes\.blok", "unknown segment 'blok'.*'block'"),
    "segment beside": ({"holes": {"spare": [[0, 0, 0]]}}, r"c\.holes\.spare", "does not pass 'spare'.* arm, block"),
    "rod": ({"holes": {"arm": [[0, 0, 0]]}}, r"c\.holes\.arm", "'arm' is a rod"),
    "beyond its end": ({"to": 0.5, "holes": {"block": [[0, 0, 0]]}}, r"c\.holes\.block", "'block', which is beyond"),
    "end in a block": ({"to": 0.95}, r"c\.to", "0.95 is inside the rigid segment 'block', .* 0.909090909 to 1;"),
    "begin in a block": ({"from": 0.95, "holes": {"block": [[0, 0, 0]]}}, r"c\.from", "0.95 is inside .*'block'"),
    "no holes": ({"holes": {"block": []}}, r"c\.holes\.block", "the list is empty"),
    "two numbers": ({"holes": {"block": [[0, 0]]}}, r"c\.holes\.block\.0", "3 are wanted"),
    "no radius": ({"offset": {**HELIX, "radius": 0}}, r"c\.offset\.radius", "not positive"),
    "no turns": ({"offset": {"type": "helix", "radius": "5 mm"}}, r"c\.offset\.turns", "missing key 'turns'"),
    "unknown route": ({"offset": {**HELIX, "type": "spiral"}}, r"c\.offset\.type", "unknown route 'spiral'"),
    "negative friction": ({"friction": -0.1}, r"c\.friction", "-0.1 is negative"),
    "beyond in": ({"moving": 1.5}, r"c\.moving", "1.5 is above 1"),
    "another way": ({"moving": "up"}, r"c\.moving", "'up' .*in, out or a number from -1 to 1"),
    "no drum": ({"spool": 0}, r"c\.spool", "not positive"),
    "slack cable": ({"stiffness": "0 N"}, r"c\.stiffness", "not positive"),
    "rubs and stretches": ({"stiffness": "1 kN", "friction": 0.1}, r"c\.stiffness", "leave `friction` or `stiffness`"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_cable_can_do_is_refused_with_one_line(name):
    change, where, words = REFUSED[name]
    with pytest.raises(FileError, match=rf"actuators\.{where}: .*{words}") as caught:
        so.robot(described(change))
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_can_say_all_of_it():
    robot = so.robot(described({
        "offset": {**HELIX, "phase": "90 deg", "end_radius": 0}, "holes": {"block": [["1 cm", 0, "1 mm"]]},
        "moving": "out", "spool": "8 mm", "stiffness": "20 kN",
    }))  # fmt: skip
    cable = robot.description.actuators["c"]
    assert cable.offset == Helix(radius=0.005, turns=1.0, phase=np.pi / 2, end_radius=0.0)
    assert (cable.holes, cable.moving, cable.spool, cable.stiffness) == ({"block": ((0.01, 0, 0.001),)}, -1, 0.008, 2e4)
    assert robot.value("actuators.c.moving") == -1.0
