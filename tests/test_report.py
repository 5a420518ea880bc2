"""The report says what the result holds, in units people read, and its figures keep one scale."""

from dataclasses import replace

import numpy as np
import pytest
import robots
from printed import words
from rich.console import Console

from socontrol.mechanics.actuators import Chamber, JointTorque
from socontrol.mechanics.lines import NormalLine
from socontrol.mechanics.loads import Distributed, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.joints import Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, Rectangle
from socontrol.programs.postures import goals, waypoints
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.statics import Statics
from socontrol.programs.result import Result, Status, Value
from socontrol.report import plots, scene, shapes, text, units
from socontrol.report.portrait import robot_figure

POSE = (0.0015, 0.001, None)


def module():
    """A short pneumatic rod with three chambers, hanging."""
    turn = [(0.008 * np.cos(a), 0.008 * np.sin(a)) for a in (0.3, 0.3 + 2 * np.pi / 3, 0.3 + 4 * np.pi / 3)]
    rod = Rod(
        length=0.05,
        sections=2,
        cross_section=Circle(radius=0.012),
        material=Linear(young_modulus=2e5, poisson_ratio=0.5, density=1000.0),
        placement=Placement(rotation=(0.0, -np.pi / 2, 0.0)),
    )
    chambers = {
        f"p{k}": Chamber(along=("module",), offset=tuple(map(float, d)), area=2e-5, limits=(0.0, 1e5))
        for k, d in enumerate(turn)
    }
    return Robot(Description(segments={"module": rod}, actuators=chambers, gravity=(0.0, 0.0, 9.81)))


def ask(goal, **more):
    return InverseStatics(robot=module(), name="finger", goals={"tip": goal}, **more).solve()


@pytest.fixture(scope="module")
def solved():
    return ask(goals.Point(on="module", target=POSE), sensitivities=True)


@pytest.fixture(scope="module")
def unreachable():
    return ask(goals.Point(on="module", target=(0.2, 0.0, 0.05)), discretisation=False)


@pytest.fixture(scope="module")
def followed():
    circle = waypoints.Circle(center=(0.0, 0.0, 0.0514), radius=0.0015, count=8)
    return ask(goals.Path(on="module", target=circle), discretisation=False)


@pytest.fixture(scope="module")
def rigid():
    arm = Revolute(axis=(0.0, 1.0, 0.0), tip=Placement(position=(0.2, 0.0, 0.0)), limits=(-2.0, 2.0))
    robot = Robot(Description(segments={"arm": arm}, actuators={"motor": JointTorque(joint="arm", limits=(-1.0, 1.0))}))
    loads = {"tip": Wrench(on="arm", force=(0.0, 0.0, -1.0))}
    return Statics(robot=robot, name="lever", loads=loads, coordinates={"arm": 0.3}).solve()


def test_a_solved_result_reads_in_engineering_units(solved):
    said = words(solved)
    first = said.splitlines()[0]
    assert first == "finger: Solved."
    for part in (
        "kPa",
        "0 to 100 kPa",
        "x [mm]",
        "rotation vector [deg]",
        "goal",
        "miss",
        "stable",
        "sections",
        "kPa/mm",
    ):
        assert part in said, part
    assert "of the largest force" in said and "iteration" in said
    assert f"{solved['inputs.p0'] / 1e3:.2f}" in said
    assert "length" not in said and "length" in words(solved, 1) and "module.0.bend_y" in words(solved, 2)


@pytest.mark.parametrize("name", ["solved", "unreachable", "followed", "rigid"])
def test_no_line_is_wider_than_a_terminal_or_ends_in_blanks(name, request):
    for line in words(request.getfixturevalue(name), 2).splitlines():
        assert len(line) <= 80 and line == line.rstrip(), line


def test_what_is_not_a_terminal_gets_no_colour(solved):
    import io

    plain, bright = io.StringIO(), io.StringIO()
    text.render(solved, Console(file=plain, width=80))
    text.render(solved, Console(file=bright, width=80, force_terminal=True, color_system="standard", no_color=False))
    assert "\x1b" not in plain.getvalue() and "\x1b" in bright.getvalue()


def test_an_unreachable_goal_names_each_active_limit_and_what_it_would_have_to_be(unreachable):
    said = words(unreachable)
    assert said.startswith("finger: Out of reach: the nearest posture misses tip by ")
    assert "alone it would have to be" in said and "no way found by this limit alone" in said
    for row in unreachable.details["unreachable"]:
        assert row["name"] in said
    assert "attempts" in said and "continuation" in words(unreachable, 1)


def test_a_path_gives_waypoints_worst_miss_and_ranges(followed):
    said = words(followed)
    assert "9 of 9 waypoints solved" in said and "worst miss" in said and "worst force" in said
    assert "least" in said and " to " in said and "at the last waypoint" in said


def test_a_held_coordinate_shows_its_holding_force(rigid):
    said = words(rigid)
    row = said.split("held coordinate")[1].splitlines()[1]
    assert "mN m" in row and row.endswith("torque, beside the 0 N m of motor")


def test_a_result_without_numbers_still_says_why():
    status = Status("numerical", "The residual is not finite; start elsewhere.")
    empty = Result(name="x", type="statics", status=status, solver={"iterations": 0, "seconds": 0.1})
    assert "start elsewhere" in words(empty)
    assert plots.draw(empty, "nowhere") == []


def test_a_result_read_back_without_its_question_can_be_printed(solved):
    said = words(replace(solved, question=None), 2)
    assert "kPa" in said and "module" in said


@pytest.mark.parametrize(
    "x, unit, shown",
    [
        (0.058934, "m", "58.93 mm"),
        (2.1e-9, "m", "2.1 nm"),
        (0.0, "m", "below 1 pm"),
        (np.pi, "rad", "180 deg"),
    ],
)
def test_misses_read_in_the_unit_that_suits_them(x, unit, shown):
    assert units.miss(x, unit) == shown


@pytest.mark.parametrize(
    "x, unit, shown",
    [
        (1.04e5, "Pa", "104 kPa"),
        (0.02, "N m", "20 mN m"),
        (3.0, "N", "3 N"),
        (0, "Pa", "0 kPa"),
        (2.0, "1/m", "2 1/m"),
    ],
)
def test_values_read_in_engineering_units(x, unit, shown):
    assert units.with_unit(x, unit) == shown


def test_compound_units_are_read_part_by_part():
    assert units.readable("Pa/m") == (1e6, "kPa/mm")


# Figures


def assert_one_scale(figure):
    """Every axes of space shows all its directions at one scale and names their unit."""
    (space,) = [ax for ax in figure.axes if ax.get_label() == "space"]
    spans = np.ptp([space.get_xlim(), space.get_ylim(), space.get_zlim()], axis=1)
    np.testing.assert_allclose(space._box_aspect / np.linalg.norm(space._box_aspect), spans / np.linalg.norm(spans))
    for name in "xyz":
        assert getattr(space, f"get_{name}label")() in (f"{name} [mm]", f"{name} [m]")
    flats = [ax for ax in figure.axes if ax.get_label() == "plane"]
    assert len(flats) == 2
    for ax in flats:
        assert ax.get_aspect() == 1.0 and "[m" in ax.get_xlabel() and "[m" in ax.get_ylabel()


@pytest.mark.parametrize("name, wanted", [
    ("unreachable", {"robot", "inputs", "strains"}), ("followed", {"robot", "inputs", "path", "strains"}),
])  # fmt: skip
def test_figures_are_small_png_files(name, wanted, request, tmp_path):
    paths = plots.draw(request.getfixturevalue(name), tmp_path / "figures")
    assert {p.stem for p in paths} == wanted
    for path in paths:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG") and 3_000 < len(data) < 200_000, path


@pytest.mark.parametrize("name", ["solved", "unreachable", "followed", "rigid"])
def test_every_axes_names_its_unit(name, request):
    result = request.getfixturevalue(name)
    for make in (plots.inputs_figure, plots.path_figure, plots.strains_figure):
        figure = make(result)
        for ax in figure.axes if figure is not None else ():
            labels = [ax.get_xlabel(), ax.get_ylabel()]
            assert any("[" in label for label in labels), labels
            assert all("[" in label for label in labels if label not in ("", "waypoint")), labels


def test_the_track_of_a_path_keeps_one_scale(followed):
    assert plots.path_figure(followed).axes[0].get_aspect() == 1.0


@pytest.fixture(scope="module")
def loaded():
    rod = Rod(length=0.3, sections=2, cross_section=Circle(radius=0.01), material=robots.RUBBER)
    loads = {
        "wind": Distributed(on="rod", force=(0.0, 0.2, 0.0)),
        "tip": Wrench(on="rod", force=(0.0, 0.0, 0.3), moment=(0.0, 0.0, 0.002), axes="body"),
    }
    result = plain_result(Description(segments={"rod": rod}, gravity=(0.0, 0.0, 0.0)))
    question = Statics(robot=result.question.robot, name="robot", loads=loads)
    return replace(result, question=question)


def _legend(figure):
    return [t.get_text() for sub in (figure, *figure.subfigs) for key in sub.legends for t in key.get_texts()]


def test_applied_loads_are_drawn_and_named(loaded):
    said = _legend(robot_figure(loaded))
    assert {"load wind 0.2 N/m", "load tip 0.3 N", "load tip 2 mN m"} <= set(said)


def test_labels_of_ticks_in_space_do_not_touch(loaded):
    figure = robot_figure(loaded)
    (space,) = [ax for ax in figure.axes if ax.get_label() == "space"]
    figure.draw_without_rendering()
    boxes = [box for name in "xyz" for box in scene.label_boxes(getattr(space, f"{name}axis"))]
    assert len(boxes) >= 3
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[k + 1 :])


def test_a_path_met_to_rounding_says_so_instead_of_drawing_noise(followed):
    exact = replace(followed, arrays={**followed.arrays, "path.miss": np.full(9, 1e-15)})
    missed = replace(followed, arrays={**followed.arrays, "path.miss": np.r_[np.full(8, 1e-15), 1e-6]})
    figure, other = plots.path_figure(exact), plots.path_figure(missed)
    assert "all misses below 1 nm" in figure.get_suptitle() and len(figure.axes) == len(other.axes) - 1
    assert "miss" not in other.get_suptitle() and other.axes[-1].get_ylabel() == "miss [um]"


def test_strains_that_vanish_are_named_not_drawn(loaded):
    rod = Rod(length=0.3, sections=2, cross_section=Circle(radius=0.01), material=robots.RUBBER)
    result = plain_result(Description(segments={"rod": rod}), bent=False)
    q = np.where([name.endswith("bend_y") for name in result.question.robot.coordinates], 2.0, 1e-14)
    figure = plots.strains_figure(replace(result, arrays={**result.arrays, "q": q}))
    assert [t.get_text() for ax in figure.axes for t in ax.get_legend().get_texts()] == ["bend y"]
    assert "zero everywhere: twist, bend z" in figure.get_suptitle()


def test_a_limit_that_is_passed_is_not_called_reached(solved):
    row = {"kind": "input", "name": "p0", "side": "upper", "limit": 1e5, "index": 0, "beyond": 3e3}
    said = words(replace(solved, details={**solved.details, "limits": [row]}))
    assert "beyond limit p0 upper, 100 kPa by 3 kPa" in said and "at limit" not in said


def test_joints_and_segments_of_goals_stand_in_the_normal_output(rigid, solved):
    said = words(rigid).split("joint")[1]
    assert "arm" in said and f"{np.degrees(0.3):.3f} deg" in " ".join(said.split())
    goal = goals.Point(on="module", target=POSE)
    assert "module" in words(replace(solved, question=replace(solved.question, goals={"tip": goal})))


def test_rounding_beside_the_largest_reads_as_zero():
    assert units.quiet([1.0, 1e-12, -3e-3]) == [1.0, 0.0, -3e-3]


def plain_result(description, bent=True):
    """A result at a bent shape, not an equilibrium: only its picture matters."""
    robot = Robot(description)
    q = 0.2 * np.sin(np.arange(robot.n) + 1.0) * bent
    question = Statics(robot=robot, name="robot")
    return Result(name="robot", type="statics", status=Status("solved", "Solved."), question=question,
                  arrays={"q": q, "u": np.zeros(robot.m)}, values={"robot.x": Value(0.0, "m")})  # fmt: skip


PORTRAITS = (
    "revolute",
    "helical",
    "free",
    "planar",
    "kirchhoff_love",
    "branched",
    "threaded",
    "chambers",
    "two_roots",
)


@pytest.mark.parametrize("name", PORTRAITS)
def test_every_kind_of_robot_can_be_drawn_to_one_scale(name):
    assert_one_scale(robot_figure(plain_result(robots.ROBOTS[name])))


def test_a_robot_without_inputs_can_be_drawn(tmp_path):
    rod = Rod(length=0.3, cross_section=Rectangle(width=0.02, height=0.01), material=robots.RUBBER)
    paths = plots.draw(plain_result(Description(segments={"rod": rod})), tmp_path)
    assert {p.stem for p in paths} == {"robot", "strains"}


@pytest.mark.parametrize(
    "name", ["branched", "threaded", "tapered"] if "tapered" in robots.ROBOTS else ["branched", "threaded"]
)
def test_drawn_places_are_those_of_the_robot(name):
    result = plain_result(robots.ROBOTS[name])
    robot, q = result.question.robot, result.arrays["q"]
    posed, f = shapes.Posed(robot, q), robot.functions()
    for segment in robot.segments:
        np.testing.assert_allclose(posed.place(segment), np.array(f.pose(segment)(q)), atol=1e-12)


@pytest.mark.parametrize("name", ["threaded", "chambers"])
def test_drawn_cables_change_their_length_as_the_actuators_say(name):
    """Fixed stretches, from one rigid placement to the next, are drawn but not counted: only changes are compared.

    A chamber that pushes along the normal counts its length along the normal, not along the line drawn.
    """
    result = plain_result(robots.ROBOTS[name])
    robot, changes = result.question.robot, []
    lines = [
        k
        for k in range(robot.m)
        if shapes.cables(shapes.Posed(robot, np.zeros(robot.n)), k)
        and not any(isinstance(share, NormalLine) for share in robot.lines[k])
    ]
    for q in (np.zeros(robot.n), result.arrays["q"]):
        drawn = [_drawn_length(shapes.Posed(robot, q), k) for k in lines]
        changes.append(np.array(robot.functions().actuator_lengths(q)).ravel()[lines] - drawn)
    np.testing.assert_allclose(changes[0], changes[1], rtol=0, atol=1e-4)
    assert lines


def _drawn_length(posed, k):
    return sum(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points, _, _ in shapes.cables(posed, k))


def test_skins_face_outwards():
    frames = np.tile(np.eye(4), (3, 1, 1))
    frames[:, 0, 3] = 0, 1, 2
    quads = shapes.sweep(frames, [shapes.outline(Circle(radius=0.5))] * 3)
    n = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    assert np.all(np.einsum("ij,ij->i", n, quads.mean(1) - [1.0, 0, 0]) > -1e-12)
    volume = np.einsum("ij,ij->i", quads[:, 0], n).sum() / 6
    assert abs(volume - np.pi * 0.25 * 2) < 0.02 * np.pi
