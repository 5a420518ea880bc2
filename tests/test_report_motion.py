"""What is said and drawn of a motion is the motion: postures at their times, sums that add up, one scale, units."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import socontrol as so
from socontrol.cli.plot import draw_again
from socontrol.programs.result import Result, Status
from socontrol.report import motion_coordinates, motion_curves, motion_gif, motion_shapes, plots, text
from socontrol.report.motion import Motion

RUBBER = {"type": "linear", "young_modulus": 3e5, "poisson_ratio": 0.45, "density": 1000, "viscosity": 200}


def rod(parent, strains, **more):
    return {"type": "rod", "parent": parent, "length": 0.15, "strains": strains, "sections": 2, "material": RUBBER,
            "cross_section": {"type": "circle", "radius": 0.006}, **more}  # fmt: skip


def solved(robot, stop, every, **more):
    asked = {"type": "simulation", "robot": {"schema_version": 1, **robot}, "discretisation": False,
             "times": {"stop": stop, "every": every}, **more}  # fmt: skip
    return so.problem(asked).solve()


@pytest.fixture(scope="module")
def swimmer():
    """Floats in water, planar: a driven hip moves a rod."""
    body = {"mass": 0.01, "inertia": [1e-6] * 3}
    hip = {"type": "revolute", "parent": "hull", "axis": [0, 0, 1], "body": body}
    fin = rod("hip", ["bend_z"], fluid={"tangential": 0.02, "normal": 1.1})
    hull = {"type": "free", "body": {"mass": 0.3, "inertia": [2e-4] * 3}}
    robot = {"name": "swimmer", "gravity": [0, 0, 0], "segments": {"hull": hull, "hip": hip, "fin": fin}}
    drive = {"hip": {"type": "sinusoid", "amplitude": "40 deg", "period": "1 s"}}
    return solved(robot, 1.2, 0.02, loads={"water": {"type": "fluid", "density": 1000}}, coordinates=drive)


@pytest.fixture(scope="module")
def hanging():
    """A soft rod in space under its weight, a cable and a push aside."""
    robot = {"name": "arm", "segments": {"arm": rod("world", "inextensible_constant_curvature")},
             "actuators": {k: {"type": "tendon", "along": ["arm"], "offset": [y, 0], "limits": [0, 2]}
                           for k, y in (("pull", 4e-3), ("idle", -4e-3))}}  # fmt: skip
    pull = {"pull": {"type": "ramp", "to": "0.5 N", "stop": "0.1 s"}}
    return solved(robot, 0.3, 0.01, inputs=pull, loads={"wind": {"type": "wrench", "on": "arm", "force": [0, 0.01, 0]}})


NAMES = ("swimmer", "hanging")


@pytest.fixture(scope="module")
def unfinished(hanging):
    """The first 12 outputs of a motion that was stopped."""
    arrays = {name: a[:12] for name, a in hanging.arrays.items()}
    status = Status("interrupted", "Stopped by the user at t = 0.11 s; what was computed is kept.")
    return replace(hanging, status=status, arrays=arrays, details={**hanging.details, "reached": 0.11})


def words(result, verbose=0):
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    text.render(result, console, verbose)
    return console.export_text(styles=False)


# Words


@pytest.mark.parametrize("name", [*NAMES, "unfinished"])
def test_a_motion_reads_in_units_without_noise_within_a_terminal(name, request):
    result = request.getfixturevalue(name)
    said = words(result, 2)
    for part in ("radau", "steps", " s simulated in ", "x [mm]", "moved [mm]", "[deg]", "[mJ]", "unexplained by work"):
        assert part in said, part
    assert all(len(line) <= 80 and line == line.rstrip() for line in said.splitlines())
    assert "work" in said and ("water" in said) == (name == "swimmer") and "e-1" not in words(result)


def test_the_distance_said_is_that_between_first_and_last_position(hanging):
    track = hanging.arrays["arm.position"]
    assert f"{1e3 * np.linalg.norm(track[-1] - track[0]):.2f}" in words(hanging)


def test_a_floating_robot_says_that_momentum_is_impulse_and_what_is_driven(swimmer, hanging):
    said = words(swimmer)
    assert "momentum" in said and "as the impulse" in said and "hip: moved as given" in said
    assert "momentum" not in words(hanging) and "driven" not in words(hanging)


def test_an_unfinished_motion_says_how_far_it_came(unfinished, hanging):
    assert "0.11 s of 0.3 s (36.7 %)" in words(unfinished)
    assert "of 0.3 s" not in words(hanging)
    assert "interrupted at 0.11 s of 0.3 s" in motion_shapes.shapes_figure(unfinished).get_suptitle()


def test_a_motion_without_numbers_says_why_and_draws_nothing(hanging, tmp_path):
    empty = Result(name="x", type="simulation", status=Status("numerical", "Not finite; look at loads."),
                   question=hanging.question)  # fmt: skip
    assert "look at loads" in words(empty) and plots.draw(empty, tmp_path) == []


# Figures


@pytest.mark.parametrize("name", NAMES)
def test_drawn_centrelines_are_those_of_the_robot_at_the_times_of_the_colour_bar(name, request):
    result = request.getfixturevalue(name)
    motion = Motion.of(result)
    scene, colours = motion_shapes.composed(motion)
    figure = motion_shapes.shapes_figure(result)
    (bar,) = [ax for ax in figure.axes if ax.get_label() == "time"]
    ticks = bar.get_xticklabels() if bar.get_xlabel() else bar.get_yticklabels()
    assert [t.get_text() for t in ticks] == [f"{x:.3g}" for x in motion.t[motion.overlaid]]
    assert "[s]" in bar.get_xlabel() + bar.get_ylabel() and 6 <= len(motion.overlaid) <= 10
    f, segment = result.question.robot.functions(), motion.tips[0]
    for n, k in enumerate(motion.overlaid):
        (line,) = [s for s in scene.strokes if s.colour == colours(n)]
        for x in (0.0, 0.5, 1.0):  # section boundaries
            exact = np.array(f.pose(segment, x).function(motion.q[k]))[:3, 3]
            assert np.min(np.linalg.norm(line.points - exact, axis=1)) < 1e-9
    (track,) = [s for s in scene.strokes if s.layer > 3 + 2 * len(motion.overlaid)]
    np.testing.assert_allclose(track.points, result.arrays[f"{segment}.position"], atol=1e-12)


@pytest.mark.parametrize("name, count", [("swimmer", 1), ("hanging", 2)])
def test_axes_of_space_keep_one_scale_and_name_their_unit(name, count, request):
    figure = motion_shapes.shapes_figure(request.getfixturevalue(name))
    flats = [ax for ax in figure.axes if ax.get_label() == "plane"]
    assert len(flats) == count
    for ax in flats:
        assert ax.get_aspect() == 1.0 and "[mm]" in ax.get_xlabel() and "[mm]" in ax.get_ylabel()
    for space in [ax for ax in figure.axes if ax.get_label() == "space"]:
        spans = np.ptp([space.get_xlim(), space.get_ylim(), space.get_zlim()], axis=1)
        np.testing.assert_allclose(space._box_aspect / np.linalg.norm(space._box_aspect), spans / np.linalg.norm(spans))


def test_a_planar_motion_is_seen_square_to_its_plane_and_one_in_space_has_none(swimmer, hanging):
    view = Motion.of(swimmer).view
    np.testing.assert_allclose(view.across, np.eye(3)[:, :2], atol=1e-9)
    assert view.labels == ("x", "y") and Motion.of(hanging).view is None


@pytest.mark.parametrize("name", NAMES)
def test_drawn_energies_add_up_and_the_rest_is_what_work_leaves(name, request):
    result = request.getfixturevalue(name)
    held, works, rest = motion_curves.energies_figure(result).axes
    curves = {line.get_label(): line.get_ydata() for line in held.lines}
    total = curves.pop("total")
    parts = [y for label, y in curves.items() if not label.startswith("_")]
    np.testing.assert_allclose(sum(parts), total, atol=1e-6 * np.ptp(total))
    done = {line.get_label(): line.get_ydata() for line in works.lines}
    assert np.max(np.abs(done.pop("change of the total") - (total - total[0]) * _ratio(works, held))) < 1e-6
    one = {"mJ": 1e-3, "uJ": 1e-6, "nJ": 1e-9, "pJ": 1e-12}[rest.get_ylabel().split("[")[1].rstrip("]")]
    energy, work = result.arrays["energy"].sum(axis=1), result.arrays["work"].sum(axis=1)
    np.testing.assert_allclose(rest.lines[0].get_ydata() * one, energy - energy[0] - work, atol=1e-14)


def _ratio(a, b):
    ones = [{"[J]": 1.0, "[mJ]": 1e-3}[ax.get_ylabel().split()[-1]] for ax in (a, b)]
    return ones[1] / ones[0]


@pytest.mark.parametrize("name", NAMES)
def test_every_axes_of_curves_names_its_unit(name, request):
    result = request.getfixturevalue(name)
    for make in (motion_coordinates.coordinates_figure, motion_curves.energies_figure, motion_curves.histories_figure):
        for ax in make(result).axes:
            assert ax.get_label() == "sections" or "[" in ax.get_ylabel(), ax.get_ylabel()
            assert ax.get_xlabel() in ("", "time [s]")


def test_driven_joints_are_marked_and_idle_inputs_named(swimmer, hanging):
    figure = motion_coordinates.coordinates_figure(swimmer)
    labels = [t.get_text() for ax in figure.axes if ax.get_legend() for t in ax.get_legend().get_texts()]
    assert "hip (driven)" in labels and "hull.3" in labels and "hull.0" not in labels  # planar: no turn about x
    assert "stay zero left out" in figure.get_suptitle()
    assert "inputs zero throughout: idle" in motion_curves.histories_figure(hanging).get_suptitle()


def test_sixty_coordinates_need_no_sixty_legend_entries():
    robot = {"name": "comb", "gravity": [0, 0, 0], "segments": {f"rod_{k}": rod("world", "kirchhoff_love", sections=3,
             placement={"position": [0, 0.1 * k, 0]}) for k in range(5)}}  # fmt: skip
    result = solved(robot, 0.004, 0.002, solver={"type": "gauss", "step": 0.002},
                    start={"rates": {f"rod_{k}.0.bend_z": 1.0 for k in range(5)}})  # fmt: skip
    assert len(result.question.robot.coordinates) == 60
    figure = motion_coordinates.coordinates_figure(result)
    entries = [ax.get_legend().get_texts() for ax in figure.axes if ax.get_legend()]
    assert len(figure.axes) <= 4 and all(len(texts) == 5 for texts in entries)


def test_where_a_joint_is_written_anew_its_curve_has_a_gap():
    q = np.zeros((5, 6))
    q[:, 2] = 2.0, 3.0, -2.3, -1.3, -0.3
    piece = SimpleNamespace(columns=slice(0, 6), size=6)
    robot = SimpleNamespace(tree=SimpleNamespace(pieces=[piece]), coordinate_units=["rad"] * 3 + ["m"] * 3)
    motion = SimpleNamespace(t=np.arange(5.0), q=q, robot=robot, driven={})
    for i in (2, 3):
        t, values = motion_coordinates._with_gaps(motion, np.arange(5), i)
        np.testing.assert_array_equal(np.isnan(values), [False, False, True, False, False, False])
        np.testing.assert_array_equal(values[~np.isnan(values)], q[:, i])


@pytest.mark.parametrize("name", NAMES)
def test_all_figures_of_a_motion_are_small_png_files_and_no_others_are_drawn(name, request, tmp_path):
    paths = plots.draw(request.getfixturevalue(name), tmp_path)
    assert {p.stem for p in paths} == {"shapes", "coordinates", "energies", "histories"}
    for path in paths:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG") and 3_000 < len(data) < 200_000, path


# Animation


@pytest.mark.parametrize(
    "stop, every, speed", [(3.0, 0.01, 1.0), (0.02, 1e-4, 0.02), (60.0, 0.1, 10.0), (7.0, 1.0, 2.0)]
)
def test_a_film_shows_outputs_in_order_at_the_speed_it_states(stop, every, speed):
    t = np.arange(round(stop / every) + 1) * every
    film = motion_gif.film(t)
    assert film.speed == speed and len(film.indices) <= motion_gif.MOST_FRAMES
    assert film.indices[0] == 0 and film.indices[-1] == len(t) - 1 and np.all(np.diff(film.indices) > 0)
    np.testing.assert_allclose(np.r_[0, np.cumsum(film.times[:-1])], t[film.indices] / speed, atol=0.0051)


def test_the_gif_has_its_frames_and_keeps_its_limits(swimmer, tmp_path):
    from PIL import Image

    kept = np.arange(0, 61, 10)
    few = replace(swimmer, arrays={name: a[kept] for name, a in swimmer.arrays.items()})
    film = motion_gif.write_gif(few, tmp_path / "motion.gif")
    with Image.open(tmp_path / "motion.gif") as image:
        assert image.n_frames == len(film.indices) == 7 and (tmp_path / "motion.gif").stat().st_size < 1_000_000
    motion = Motion.of(few)
    whole = motion_gif._limits(motion)
    limits = [motion_gif.frame(motion, k, whole, 1.0).axes[0] for k in (0, 3, 6)]
    assert len({(*ax.get_xlim(), *ax.get_ylim(), ax.get_aspect()) for ax in limits}) == 1
    assert [t.get_text() for t in motion_gif.frame(motion, 3, whole, 0.5).texts] == [
        "t = 0.6 s   (0.5 x real time)",
        "problem",
    ]


def test_what_does_not_move_gets_no_gif_but_a_sentence(monkeypatch, capsys, tmp_path):
    still = Result(name="x", type="statics", status=Status("solved", "Solved."))
    monkeypatch.setattr("socontrol.cli.plot.load_result", lambda folder: still)
    assert draw_again(tmp_path, tmp_path, gif=True) == 2
    assert "does not move" in capsys.readouterr().err and not list(tmp_path.iterdir())
