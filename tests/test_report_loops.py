"""Loops in figures: where they close and by what, and how far they stay open."""

import numpy as np
import pytest
from chains import four_bar

from socontrol.mechanics.loops import LOOPS, End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body
from socontrol.model.joints import Free
from socontrol.programs.postures.statics import Statics
from socontrol.report import loop_scene, shapes
from socontrol.report.portrait import robot_figure

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
