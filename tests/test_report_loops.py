"""Loops in figures and words: where they close and by what, how far they stay open, what they bear."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chains import four_bar
from rich.console import Console
from scipy.spatial import ConvexHull

import socontrol as so
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.loops import LOOPS, End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import Free, Revolute
from socontrol.programs.postures.statics import Statics
from socontrol.programs.result import Value
from socontrol.report import links, loop_scene, scene, shapes
from socontrol.report.portrait import robot_figure
from socontrol.report.text import render

ROBOTS = Path(__file__).parents[1] / "configs" / "robots"

AXIS = np.array([0.36, -0.48, 0.8])
GIVEN = {"spherical": {}, "fixed": {}, "helical": {"axis": tuple(AXIS), "pitch": 0.02}}
AWAY = np.array([0.03, 0.05, -0.02])
LEFT_OUT = {  # of a displacement [3]: the part that a kind lets go
    "prismatic": lambda d: AXIS * (AXIS @ d),
    "cylindrical": lambda d: AXIS * (AXIS @ d),
    "planar": lambda d: d - AXIS * (AXIS @ d),
}


def held(segment, kind):
    """Two free bodies, and a loop that joins the first to the world."""
    body = Free(stiffness=1.0, body=Body(mass=0.1))
    loop = LOOPS[kind](a=End(segment=segment), b=End(segment="world"), **GIVEN.get(kind, {"axis": tuple(AXIS)}))
    return Robot(Description(segments={segment: body, "other": body}, loops={"joint": loop})), loop


def labels(figure):
    """Texts of a figure's legends."""
    legends = [legend for part in [figure, *figure.subfigs] for legend in part.legends]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def flat(figure):
    """The axes of the figure's planes x-y."""
    every = [ax for part in figure.subfigs for ax in part.axes if ax.get_label() == "plane"]
    return [ax for ax in every if ax.get_xlabel().startswith("x") and ax.get_ylabel().startswith("y")]


@pytest.mark.parametrize("kind", LOOPS)
def test_a_loop_is_open_by_what_its_joint_does_not_let_go(kind):
    robot, loop = held("body", kind)
    freedom = np.array(loop.Phi()).reshape(6, -1)
    turned = 0.4 * freedom @ np.arange(1.0, freedom.shape[1] + 1)
    point, off, angle = loop_scene.gap(shapes.Posed(robot, [*turned, *np.zeros(6)]), loop)
    assert np.linalg.norm(off) < 1e-9 and angle < 1e-9
    if kind == "helical":
        return
    point, off, angle = loop_scene.gap(shapes.Posed(robot, [0, 0, 0, *AWAY, *np.zeros(6)]), loop)
    assert np.allclose(point, AWAY) and angle < 1e-9
    assert np.allclose(off, AWAY - LEFT_OUT.get(kind, np.zeros_like)(AWAY), atol=1e-12)


def test_a_loop_that_turned_out_of_its_axis_is_open_by_an_angle():
    robot, loop = held("body", "revolute")
    across = np.cross(AXIS, [1.0, 0.0, 0.0])
    across = 0.05 * across / np.linalg.norm(across)
    _, off, angle = loop_scene.gap(shapes.Posed(robot, [*across, *np.zeros(9)]), loop)
    assert np.linalg.norm(off) < 1e-12 and angle == pytest.approx(2 * np.tan(0.025), rel=1e-9)


def test_a_figure_marks_where_loops_close_and_names_the_kind():
    result = Statics(robot=Robot(four_bar(0.1, 0.25, 0.2, 0.22)), name="bars", coordinates={"crank": 0.7}).solve()
    figure = robot_figure(result.require())
    told = labels(figure)
    assert "revolute loop: pin" in told and "unloaded" not in told  # at rest its bars lie in a line, and open
    assert not any("open" in text for text in told)
    pin = 1e3 * np.array(result["coupler.position"])[:2]
    for ax in flat(figure):
        assert any(line.get_marker() == "o" and np.allclose(line.get_xydata(), pin) for line in ax.lines)
        assert not any(line.get_linestyle() == "--" for line in ax.lines)


def test_a_figure_draws_what_stays_open_as_a_dashed_line_with_its_size():
    result = Statics(robot=Robot(four_bar(0.1, 0.25, 0.2, 0.6)), name="bars", coordinates={"crank": 0.7}).solve()
    assert result.status.outcome == "infeasible"
    poses = (result.question.robot.functions().pose(name)(result.arrays["q"]) for name in ("coupler", "rocker"))
    ends = np.array([np.array(pose)[:2, 3] for pose in poses])
    figure = robot_figure(result)
    assert f"pin open by {1e3 * np.linalg.norm(ends[0] - ends[1]):.2f} mm" in labels(figure)
    for ax in flat(figure):
        (line,) = [line for line in ax.lines if line.get_linestyle() == "--"]
        assert np.allclose(sorted(line.get_xydata().tolist()), sorted((1e3 * ends).tolist()))


@pytest.fixture(scope="module")
def platform():
    robot = so.load_robot(ROBOTS / "parallel_soft_platform.yaml")
    return Statics(robot=robot, name="platform", inputs=dict.fromkeys(robot.inputs, 2e4), discretisation=False).solve()


def words(result):
    console = Console(file=io.StringIO(), width=120)
    render(result, console)
    return console.file.getvalue()


def loop_rows(said):
    """Numbers of the table of loops, by loop."""
    rows = [line.split() for line in said.split("loop, on a by b")[1].split("\n\n")[0].splitlines()[1:]]
    return {row[0]: row[1:] for row in rows}


def test_what_loops_bear_by_rounding_reads_as_zero_beside_what_they_bear_and_the_loads(platform):
    noise = [3e-18, -5e-18, 1e-18]
    borne = {"loops.glue_1": Value([*noise, 0.476, 1e-16, 0.0], "N m, N"),
             "loops.glue_2": Value([*noise, 1e-15, 2e-9, 0.0], "N m, N")}  # fmt: skip
    rows = loop_rows(words(replace(platform, values={**platform.values, **borne})))
    assert rows == {"glue_1": ["476", "0", "0"] + ["0"] * 3, "glue_2": ["0", "2e-06", "0"] + ["0"] * 3}
    borne["loops.glue_1"] = Value([*noise, 1e-15, 0.0, 0.0], "N m, N")
    pressed = replace(platform.question, loads={"weight": Wrench(on="plate", force=(0.0, 0.0, -300.0))})
    rows = loop_rows(words(replace(platform, question=pressed, values={**platform.values, **borne})))
    assert all(x == "0" for row in rows.values() for x in row)


def test_forward_statics_tells_what_has_moved_most(platform):
    assert platform.details["largest_displacement"]["at"] == 1
    moved = 1e3 * platform["largest_displacement"]
    where = platform.details["largest_displacement"]["segment"]
    assert f"at most {moved:.4g} mm, the end of {where}, from" in words(platform)
    half = {**platform.details, "largest_displacement": {"segment": "leg_0", "at": 0.25}}
    assert "leg_0 at X = 0.25, from" in words(replace(platform, details=half))


def test_a_plate_reaches_all_that_is_joined_to_it(platform):
    posed = shapes.Posed(platform.question.robot, platform.arrays["q"])
    ((name, skin),) = links.plates(posed).items()
    corners = skin.reshape(-1, 3)
    assert name == "plate"
    for leg in ("leg_0", "leg_1", "leg_2"):
        top = posed.place(leg)
        away = top[:3, 3] - posed.place("plate")[:3, 3]
        edge = top[:3, 3] + 0.01 * away / np.linalg.norm(away)  # the leg's radius further out
        assert np.min(np.linalg.norm(corners - edge, axis=1)) < posed.slim
    bars = shapes.Posed(Robot(four_bar(0.1, 0.25, 0.2, 0.22)), np.zeros(3))
    assert not links.plates(bars) and not links.arms(bars, {})


def test_hulls_are_those_of_qhull():
    points = np.random.default_rng(3).normal(size=(60, 2))
    found = links.hull(np.concatenate([points, points[:5]]))
    expected = points[ConvexHull(points).vertices]  # anticlockwise, too
    first = int(np.argmin(np.linalg.norm(expected - found[0], axis=1)))
    np.testing.assert_array_equal(found, np.roll(expected, -first, axis=0))


@pytest.mark.parametrize(("name", "tips"), [("finray_driven", ["back"]), ("parallel_soft_platform", ["plate"]),
                                            ("slider_crank", ["piston"]), ("l_beam", ["second"])])  # fmt: skip
def test_links_between_loops_are_no_tips(name, tips):
    assert shapes.ends(so.load_robot(ROBOTS / f"{name}.yaml")) == tips


def test_labels_in_space_keep_clear_of_the_planes_and_of_the_colours(platform):
    figure = robot_figure(platform)
    (space,), (colours,) = ([ax for ax in figure.axes if ax.get_label() == label] for label in ("space", "scale"))
    figure.draw_without_rendering()
    axes = [getattr(space, f"{name}axis") for name in "xyz"]
    boxes = [box for axis in axes for box in [*scene.label_boxes(axis), axis.label.get_window_extent()]]
    left, top = figure.subfigs[0].bbox, colours.get_window_extent().y1
    assert len(boxes) >= 9
    assert all(left.x0 <= box.x0 and box.x1 <= left.x1 and top <= box.y0 for box in boxes)


@pytest.mark.parametrize("degrees", [60.0, 149.0, -121.0])
def test_no_axis_of_the_ground_is_seen_from_its_end(degrees):
    along = Placement(rotation=(0.0, 0.0, np.radians(degrees)))
    bar = Revolute(axis=(0.0, 0.0, 1.0), stiffness=1.0, placement=along, tip=Placement((0.2, 0.0, 0.0)))
    result = Statics(robot=Robot(Description(segments={"bar": bar})), name="bar").solve()
    (space,) = [ax for ax in robot_figure(result).axes if ax.get_label() == "space"]
    assert abs((space.azim + 45) % 90 - 45) > 10
