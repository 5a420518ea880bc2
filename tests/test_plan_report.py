"""What is said and drawn of a plan is the plan: numbers in units, limits where they are, obstacles to scale."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from printed import sentence, words

import socontrol as so
from socontrol.cli.plot import draw_again
from socontrol.programs.plans.moments import End, Waypoint
from socontrol.programs.plans.motion_limits import MotionLimits, Speed
from socontrol.programs.plans.obstacles import Box, Capsule, HalfSpace, Sphere
from socontrol.programs.plans.trajectory import Trajectory
from socontrol.programs.postures import goals
from socontrol.programs.result import Result, Status, Value
from socontrol.report import motion_gif, obstacle_shapes, plan_paths, plan_strips, plots, shapes
from socontrol.report.motion import Motion
from socontrol.report.plan_csv import table
from socontrol.report.scene import Scene

STOP, COUNT = 1.5, 61
REACH = (np.array([-0.5, -0.4, -0.3]), np.array([0.6, 0.5, 0.4]))
NAMES = ("crane", "arm")


def link(parent, length):
    return {"type": "revolute", "parent": parent, "axis": [0, 1, 0], "tip": {"position": [length, 0, 0]},
            "body": {"mass": 0.5, "com": [length / 2, 0, 0], "inertia": [1e-3] * 3}}  # fmt: skip


def crane_robot():
    """Two links in the x-z plane."""
    motors = {f"m{k}": {"type": "joint_torque", "joint": j, "limits": [-4, 4]} for k, j in ((1, "upper"), (2, "fore"))}
    return so.robot({"schema_version": 1, "name": "crane", "actuators": motors,
                     "segments": {"upper": link("world", 0.5), "fore": link("upper", 0.4)}})  # fmt: skip


def arm_robot(sections=2):
    rubber = {"type": "linear", "young_modulus": 3e5, "poisson_ratio": 0.45, "density": 1000}
    rod = {"type": "rod", "length": 0.15, "strains": "inextensible_constant_curvature", "sections": sections,
           "cross_section": {"type": "circle", "radius": 0.006}, "material": rubber}  # fmt: skip
    cables = {f"t{k}": {"type": "tendon", "along": ["arm"], "offset": [y, z], "limits": [0, 2]}
              for k, (y, z) in enumerate(((4e-3, 0), (-2e-3, 3.4e-3), (-2e-3, -3.4e-3)))}  # fmt: skip
    return so.robot({"schema_version": 1, "name": "arm", "segments": {"arm": rod}, "actuators": cables})


def smooth(t):
    """From 0 to 1 at rest to rest, and its rate."""
    x = t / STOP
    return x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / STOP


def plan(question, q0, q1, u, **more):
    """Result of a motion from q0 to q1 in closed form, its inputs u [K x m] given."""
    robot, t = question.robot, np.linspace(0, STOP, COUNT)
    share, rate = smooth(t)
    q, qd = q0 + share[:, None] * (q1 - q0), rate[:, None] * (q1 - q0)
    f = robot.functions()
    arrays = {"t": t, "q": q, "qd": qd, "u": u, "ud": np.gradient(u, t, axis=0), "node.t": np.linspace(0, STOP, 13)}
    arrays["lengths"] = np.array([np.array(f.actuator_lengths(x)).ravel() for x in q])
    values = {"duration": Value(STOP, "s"), "cost": Value(0.125, "1"), "cost.effort": Value(0.1, "1"),
              "cost.smooth": Value(0.025, "1"), "replay.tip": Value(1.2e-5, "m"), "replay.tip_share": Value(8e-5, "1"),
              "replay.coordinates": Value(3e-4, "1"), "error.between": Value(3e-5, "1"),
              "mesh.intervals": Value(12, "1"), "mesh.needed": Value(31, "1")}  # fmt: skip
    for segment in robot.segments:
        poses = np.array([np.array(f.pose(segment, 1.0)(x)) for x in q])
        arrays[f"{segment}.position"] = poses[:, :3, 3]
        arrays[f"replay.{segment}.position"] = poses[:, :3, 3] + 1e-5
        values[f"{segment}.position"] = Value(poses[-1, :3, 3].tolist(), "m")
        values[f"{segment}.rotation"] = Value([0.0, 0.1, 0.0], "rad")
    arrays |= {"replay.q": q + 1e-4, "replay.qd": qd - 1e-4}
    for name, obstacle in (question.obstacles or {}).items():
        tip = arrays[f"{robot.segments[-1]}.position"].T
        arrays[f"clearance.{name}"] = np.array(obstacle.distance(tip)).ravel()
    names = {name: i for i, name in enumerate(robot.coordinates) if robot.coordinate_units[i] == "rad"}
    values |= {f"coordinates.{name}": Value(float(q[-1, i]), "rad") for name, i in names.items()}
    return Result(name=question.name, type="trajectory", question=question, arrays=arrays,
                  status=Status("solved", "Solved."), solver={"iterations": 84, "seconds": 2.31},
                  **{"values": values, "details": {"scheme": "radau 3", "stop": STOP},
                     "residuals": {"equation": Value(2e-10, "1"), "goals.tip": Value(3e-9, "m")}, **more})  # fmt: skip


@pytest.fixture(scope="module")
def crane():
    """In a plane: m1 stands on its upper limit for a third of the time, m2 does nothing."""
    obstacles = {"ball": Sphere(center=(0.2, 0.0, -0.3), radius=0.1, clearance=0.02),
                 "wall": HalfSpace(point=(1.0, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
                 "post": Capsule(from_=(-0.2, -2.0, 0.3), to=(-0.2, 2.0, 0.3), radius=0.05)}  # fmt: skip
    target = goals.Point(on="fore", target=(0.7, None, -0.4))
    question = Trajectory(
        robot=crane_robot(), name="swing", duration=STOP, obstacles=obstacles,
        waypoints={"via": Waypoint(time=0.6, coordinates={"upper": "20 deg"}, goals={"pass": target})},
        end=End(coordinates={"upper": 1.0}),
        limits=MotionLimits(rates={"upper": 2.0}, input_rates={"m1": "30 N m/s"},
                            speeds={"hand": Speed(on="fore", largest=1.5)}),
    )  # fmt: skip
    t = np.linspace(0, STOP, COUNT)
    u = np.column_stack([np.minimum(4.0, 6 * t / STOP), np.zeros(COUNT)])
    return plan(question, np.array([0.2, -0.6]), np.array([1.0, 0.5]), u)


@pytest.fixture(scope="module")
def arm():
    """In space, a cable's length limited and passed between the points."""
    obstacles = {"crate": Box(center=(0.12, 0.1, -0.05), size=(0.04, 0.05, 0.06), rotation=(0, 0.3, 0.5))}
    pose = goals.Pose(on="arm", target=goals.PoseTarget(position=(0.1, 0.03, -0.08), rotation=(0.0, 0.7, 0.3)))
    limits = MotionLimits(lengths={"t0": ("130 mm", "149 mm")})
    question = Trajectory(robot=arm_robot(), name="reach", duration=STOP, obstacles=obstacles, limits=limits,
                          end=End(goals={"tip": pose}))  # fmt: skip
    u = np.column_stack([np.linspace(0, 1.2, COUNT), np.linspace(0.5, 0.1, COUNT), np.full(COUNT, 0.3)])
    return plan(question, np.array([0.5, 0.2, 0.1, 0.0]), np.array([9.0, -6.0, 8.0, 5.0]), u)


@pytest.fixture(scope="module")
def infeasible(crane):
    worst = [{"quantity": "rate of upper", "node": 7, "time": 0.875, "excess": 0.5, "unit": "rad/s"}]
    loosen = [{"quantity": "duration", "by": 0.3, "unit": "s", "share": 0.2},
              {"quantity": "input m1, upper", "by": 1.25, "unit": "N m", "share": 0.31}]  # fmt: skip
    return replace(crane, status=Status("infeasible", "No motion was found within the limits."),
                   details={**crane.details, "worst": worst, "loosen": loosen})  # fmt: skip


# Words

@pytest.mark.parametrize("name", [*NAMES, "infeasible"])
def test_a_plan_reads_in_units_within_a_terminal(name, request):
    said = words(request.getfixturevalue(name), 2)
    for part in ("radau 3, 12 intervals, 84 iterations, 2.31 s", "1.5 s", "0.125: effort 0.1, smooth 0.025", "x [mm]"):
        assert part in said, part
    assert all(len(line) <= 80 and line == line.rstrip() for line in said.splitlines())


def test_ends_inputs_and_joints_are_told_with_their_limits(crane):
    said = words(crane)
    row = next(line.split() for line in said.splitlines() if line.startswith("fore "))
    np.testing.assert_allclose([float(x) for x in row[1:4]], 1e3 * crane.arrays["fore.position"][-1], atol=0.006)
    moved = np.linalg.norm(np.subtract(*crane.arrays["fore.position"][[0, -1]]))
    assert float(row[4]) == pytest.approx(1e3 * moved, abs=0.006)
    m1 = next(line.split() for line in said.splitlines() if line.startswith("m1 "))
    assert [float(x) for x in m1[1:3]] == [0, 4] and " ".join(m1[3:10]) == "N m -4 to 4 N m"
    upper = next(line.split() for line in said.splitlines() if line.startswith("upper "))
    np.testing.assert_allclose([float(x) for x in upper[1:4]], np.degrees([1.0, 0.2, 1.0]), atol=0.006)
    assert sentence(crane, "goal") == "tip: miss 3 nm"


def test_what_stands_on_a_limit_is_named_with_its_share_of_the_time(crane):
    told, _, share = sentence(crane, "at limit").partition(" (")
    assert told == "input m1, upper: 4 N m" and sentence(crane, "idle") == "m2"
    assert share.endswith(" % of the time)") and float(share.split()[0]) == pytest.approx(100 / 3, abs=1)


def test_what_is_past_a_limit_between_the_points_is_told_with_the_excess(arm):
    past = 1e3 * (arm.arrays["lengths"][:, 0].max() - 0.149)
    assert past > 0
    told = sentence(arm, "beyond limit")
    assert told.startswith("between the points: length t0, upper: 149 mm (by ") and f"{past:.4g}"[:3] in told


def test_the_clearance_told_is_that_of_the_surface_and_says_when_it_is_too_small(crane):
    gap = np.linalg.norm(crane.arrays["fore.position"] - [0.2, 0.0, -0.3], axis=1) - 0.1
    row = next(line for line in words(crane).splitlines() if line.startswith("ball"))
    assert f"{1e3 * gap.min():.4g} mm" in row and "20 mm" in row and f"{crane.arrays['t'][np.argmin(gap)]:.3g} s" in row
    assert "too close" not in row
    nearer = {**crane.arrays, "clearance.ball": crane.arrays["clearance.ball"] - (gap.min() - 0.02) - 1e-3}
    assert "too close" in words(replace(crane, arrays=nearer)) and "beyond limit" not in words(crane)


def test_the_re_simulation_and_the_mesh_it_asks_for_are_told(crane):
    told = sentence(crane, "re-simulated")
    assert told == "tip within 12 um (0.008 % of the length), coordinates within 0.03 % of their range"
    assert sentence(crane, "mesh").startswith("12 intervals; about 31 would bring the re-simulated tip within 0.1 %")
    assert sentence(crane, "equation") == "of motion, relative residual: 2e-10 at the points, 3e-05 between them"
    without = {k: v for k, v in crane.values.items() if not k.startswith("replay")}
    assert "failed" in sentence(replace(crane, values=without), "re-simulated")
    slow = replace(crane, values=without, question=replace(crane.question, quasi_static=True))
    assert "without masses" in sentence(slow, "re-simulated") and "quasi-static" in words(slow)


def test_an_infeasible_plan_names_the_worst_and_what_to_loosen_first(infeasible, crane):
    lines = words(infeasible).splitlines()
    assert next(x for x in lines if x.startswith("rate of upper")).split()[3:] == ["7", "0.875", "s", "28.6", "deg/s"]
    ranked = [x.split("  ") for x in lines if x[:3] in ("1  ", "2  ")]
    assert [x[1] for x in ranked] == ["duration", "input m1, upper"]
    assert [" ".join(x[2:]).split() for x in ranked] == [["0.3", "s", "20", "%"], ["1.25", "N", "m", "31", "%"]]
    assert "not a motion to run" in sentence(infeasible, "below") and "not a motion" not in words(crane)


def test_a_plan_without_numbers_says_why_and_draws_nothing(crane, tmp_path):
    empty = Result(name="x", type="trajectory", question=crane.question, status=Status("numerical", "Not finite."))
    assert "Not finite" in words(empty) and plots.draw(empty, tmp_path) == []


# Table for a controller

@pytest.mark.parametrize("name", NAMES)
def test_the_table_reads_back_bit_for_bit_under_its_names(name, request):
    result = request.getfixturevalue(name)
    rows = list(csv.reader(table(result).splitlines()))
    read, robot = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True)), result.question.robot
    assert np.array_equal(read.pop("t"), result.arrays["t"])
    for key, prefix, names in (("u", "u", robot.inputs), ("q", "q", robot.coordinates), ("qd", "qd", robot.coordinates),
                               ("lengths", "length", robot.inputs)):  # fmt: skip
        for k, column in enumerate(names):
            assert np.array_equal(read.pop(f"{prefix}.{column}"), result.arrays[key][:, k])
    assert not read


# Strips

ONES = {"deg": np.pi / 180, "deg/s": np.pi / 180, "N m": 1.0, "N": 1.0, "mm": 1e-3, "1/m": 1.0, "1/(m s)": 1.0}


def axes_of(result):
    """{(title, unit): axes}."""
    figure = plan_strips.strips_figure(result)
    return {tuple(ax.get_ylabel().rstrip("]").split("\n[")): ax for ax in figure.axes}


def lines_of(ax, label):
    return [line for line in ax.lines if line.get_label() == label]


@pytest.mark.parametrize("name", NAMES)
def test_every_strip_shows_its_rows_of_the_plan_in_its_unit(name, request):
    result = request.getfixturevalue(name)
    robot, rows = result.question.robot, {"coordinate": "q", "rate": "qd", "input": "u", "length": "lengths"}
    axes = axes_of(result)
    assert {title for title, _ in axes} >= {"coordinate", "rate", "input", "clearance"}
    for (title, unit), ax in axes.items():
        for line in (x for x in ax.lines if title in rows and not x.get_label().startswith("_")):
            k = (robot.coordinates if rows[title][0] == "q" else robot.inputs).index(line.get_label())
            np.testing.assert_allclose(line.get_ydata() * ONES[unit], result.arrays[rows[title]][:, k], atol=1e-12)
        (nodes,) = lines_of(ax, "_nodes")
        np.testing.assert_array_equal(nodes.get_xdata(), result.arrays["node.t"])
    for key, title in (("replay.q", "coordinate"), ("replay.qd", "rate")):
        (ax, unit) = next((ax, unit) for (own, unit), ax in axes.items() if own == title)
        drawn = np.array([line.get_ydata() for line in lines_of(ax, "_replay")]).T * ONES[unit]
        np.testing.assert_allclose(drawn, result.arrays[key], atol=1e-12)


def test_limits_are_dashed_where_they_are_and_hatched_beyond_where_all_share_them(crane, arm):
    def levels(ax):
        return sorted(line.get_ydata()[0] for line in lines_of(ax, "_limit"))

    axes = axes_of(crane)
    np.testing.assert_allclose(levels(axes["input", "N m"]), [-4, 4])
    np.testing.assert_allclose(levels(axes["rate", "deg/s"]), np.degrees([2]))  # of one curve; the other end is far
    np.testing.assert_allclose(levels(axes["input rate", "N m/s"]), [-30, 30])
    hatched = {key: [p for p in ax.patches if p.get_label() == "_beyond"] for key, ax in axes.items()}
    assert len(hatched["input", "N m"]) == 2 and not hatched["rate", "deg/s"]
    spans = sorted((p.get_y(), p.get_y() + p.get_height()) for p in hatched["input", "N m"])
    assert spans[0][1] == -4 and spans[1][0] == 4
    np.testing.assert_allclose(levels(axes_of(arm)["length", "mm"]), [130, 149])
    assert ("length", "mm") not in axes and ("input rate", "N/s") not in axes_of(arm)  # not limited


def test_what_waypoints_and_end_hold_is_circled_at_its_time(crane):
    held = lines_of(axes_of(crane)["coordinate", "deg"], "_held")
    spots = sorted((line.get_xdata()[0], line.get_ydata()[0]) for line in held)
    np.testing.assert_allclose(spots, [(0.6, 20.0), (STOP, np.degrees(1.0))])
    assert all(lines_of(ax, "_waypoint")[0].get_xdata()[0] == 0.6 for ax in axes_of(crane).values())


def test_many_strains_are_left_to_their_own_figure(tmp_path):
    robot = arm_robot(sections=6)
    question = Trajectory(robot=robot, name="long", duration=STOP)
    result = plan(question, np.zeros(12), np.linspace(1, 9, 12), np.zeros((COUNT, 3)))
    figure = plan_strips.strips_figure(result)
    assert "12 strains" in figure.get_suptitle() and "coordinates.png" in figure.get_suptitle()
    assert all(len(ax.get_legend().get_texts()) <= 8 for ax in figure.axes)
    assert {path.stem for path in plots.draw(result, tmp_path)} == {"strips", "path", "coordinates"}


# Obstacles

KINDS = {
    "sphere": Sphere(center=(0.1, 0.2, 0.0), radius=0.2),
    "capsule": Capsule(from_=(-0.3, 0.0, 0.1), to=(0.2, 0.3, 0.3), radius=0.1),
    "point": Capsule(from_=(0.0, 0.0, 0.1), to=(0.0, 0.0, 0.1), radius=0.1),
    "box": Box(center=(0.1, 0.1, 0.0), size=(0.2, 0.3, 0.4), rotation=(0.3, -0.2, 0.5)),
    "half_space": HalfSpace(point=(0.0, 0.0, -0.35), normal=(0.1, 0.0, 1.0)),
}


def volume(polygons):
    """Of a closed skin, by the divergence theorem over triangles; positive when corners turn outwards."""
    return sum(float(np.linalg.det([p[0], p[k], p[k + 1]])) / 6 for p in polygons for k in range(1, len(p) - 1))


@pytest.mark.parametrize("kind", KINDS)
def test_the_skin_drawn_lies_on_the_obstacle(kind):
    skin = obstacle_shapes.body(KINDS[kind], REACH)
    gaps = np.array(KINDS[kind].distance(np.concatenate(skin).T)).ravel()
    deepest = obstacle_shapes.SLAB * 1.1 if kind == "half_space" else 0.0  # the largest side of what is reached: 1.1 m
    assert np.max(np.abs(gaps - np.clip(gaps, -deepest, 0))) < 1e-3 and np.sum(np.abs(gaps) < 1e-3) > 3
    grown = np.concatenate(obstacle_shapes.body(KINDS[kind], REACH, 0.05))
    assert np.max(np.array(KINDS[kind].distance(grown.T))) == pytest.approx(0.05, abs=2e-3)


def test_skins_are_closed_and_of_the_obstacles_volume():
    sizes = {"sphere": 4 / 3 * np.pi * 0.2**3, "box": 0.2 * 0.3 * 0.4, "point": 4 / 3 * np.pi * 0.1**3}
    sizes["capsule"] = np.pi * 0.1**2 * np.linalg.norm([0.5, 0.3, 0.2]) + sizes["point"]
    for kind, size in sizes.items():
        assert volume(obstacle_shapes.body(KINDS[kind], REACH)) == pytest.approx(size, rel=0.03), kind


def test_an_obstacle_larger_than_what_is_shown_is_cut_and_closed():
    slab = obstacle_shapes.block(np.eye(4), (4.0, 0.2, 4.0))
    kept = obstacle_shapes.cut(slab, np.array([-0.5, -1.0, -0.25]), np.array([0.5, 1.0, 0.5]))
    assert volume(kept) == pytest.approx(1.0 * 0.2 * 0.75)
    points = np.concatenate(kept)
    np.testing.assert_allclose([points.min(0), points.max(0)], [[-0.5, -0.1, -0.25], [0.5, 0.1, 0.5]])
    assert obstacle_shapes.cut(slab, np.array([5.0, 5, 5]), np.array([6.0, 6, 6])) == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("toward", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.3, -0.5, 0.8)])
def test_an_outline_surrounds_what_it_outlines(kind, toward):
    toward = np.array(toward) / np.linalg.norm(toward)
    points = np.concatenate(obstacle_shapes.body(KINDS[kind], REACH))
    ring = obstacle_shapes.outline(points, toward)
    np.testing.assert_array_equal(ring[0], ring[-1])
    for a, b in zip(ring, ring[1:], strict=False):
        left = (np.cross(b - a, points - a) @ toward) / np.linalg.norm(b - a)
        assert np.min(left) > -1e-7  # all to the left of each edge: convex, and anticlockwise


def test_points_that_rounding_alone_tells_apart_do_not_break_an_outline():
    side = np.linspace(-0.5, 0.5, 7)
    square = np.array([[x, y, z] for x in side for y in side for z in (0.0, 0.3)])
    for seed in range(5):
        noise = 1e-15 * np.random.default_rng(seed).standard_normal(square.shape)
        ring = obstacle_shapes.outline(square + noise, (0, 0, 1))
        area = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:], strict=False)) / 2
        assert area == pytest.approx(1.0)


def test_a_plan_is_seen_in_its_plane_only_where_obstacles_show_their_true_distance(crane):
    def view(**obstacles):
        return Motion.of(replace(crane, question=replace(crane.question, obstacles=obstacles))).view

    assert Motion.of(crane).view.labels == ("x", "z")
    assert view(box=Box(center=(0.2, 0.0, 0.2), size=(0.1, 0.1, 0.1), rotation=(0.0, 0.4, 0.0))) is not None
    assert view(box=Box(center=(0.2, 0.0, 0.2), size=(0.1, 0.1, 0.1), rotation=(0.4, 0.0, 0.0))) is None
    assert view(ball=Sphere(center=(0.2, 0.08, 0.2), radius=0.1)) is None
    assert view(post=Capsule(from_=(0.2, 0.1, 0.2), to=(0.2, 1.0, 0.2), radius=0.05)) is None  # ends before the plane


# Path

def strokes(scene, kind):
    return [s for s in scene.strokes if isinstance(s, kind)]


@pytest.mark.parametrize("name, flats", [("crane", 1), ("arm", 2)])
def test_the_path_keeps_one_scale_and_shows_obstacles_in_every_view(name, flats, request):
    result = request.getfixturevalue(name)
    figure = plan_paths.path_figure(result)
    planes = [ax for ax in figure.axes if ax.get_label() == "plane"]
    assert len(planes) == flats
    for ax in planes:
        assert ax.get_aspect() == 1.0 and all("m]" in label for label in (ax.get_xlabel(), ax.get_ylabel()))
    drawn = [ax for ax in figure.axes if ax.get_label() in ("plane", "space")]
    for ax in drawn:
        edges = [line for line in ax.lines if line.get_color() == obstacle_shapes.EDGE]
        shells = [x for x in result.question.obstacles.values() if x.clearance]
        assert len(edges) == len(result.question.obstacles) + len(shells)


def test_a_sphere_is_drawn_as_a_circle_of_its_size_and_its_clearance_around_it(crane):
    (ax,) = [ax for ax in plan_paths.path_figure(crane).axes if ax.get_label() == "plane"]
    one = {"mm": 1e-3, "m": 1.0}[ax.get_xlabel().split("[")[1].rstrip("]")]
    radii = []
    for line in (x for x in ax.lines if x.get_color() == obstacle_shapes.EDGE):
        away = np.hypot(*(line.get_xydata() * one - [0.2, -0.3]).T)
        radii += [away.mean()] if np.ptp(away) < 1e-3 else []
    np.testing.assert_allclose(sorted(radii), [0.1, 0.12], atol=1e-3)


def test_marks_stand_where_plan_and_goals_are(crane, arm):
    scene = Scene(up=np.array([0, 0, 1.0]))
    plan_paths._moments(scene, Motion.of(crane))
    track, marks = crane.arrays["fore.position"], {m.marker: m.point for m in scene.marks}
    np.testing.assert_allclose(marks["o"], track[0])
    np.testing.assert_allclose(marks["s"], track[-1])
    np.testing.assert_allclose(marks["D"], track[np.argmin(np.abs(crane.arrays["t"] - 0.6))])
    np.testing.assert_allclose(marks["+"][[0, 2]], [0.7, -0.4])
    scene = Scene(up=np.array([0, 0, 1.0]))
    plan_paths._moments(scene, Motion.of(arm))
    np.testing.assert_allclose([m.point for m in scene.marks if m.marker == "+"], [[0.1, 0.03, -0.08]])
    axes = np.array([np.diff(s.points, axis=0)[0] for s in scene.strokes])
    R = shapes.exponential(np.array([0.0, 0.7, 0.3, 0, 0, 0]))[:3, :3]
    np.testing.assert_allclose(axes / np.linalg.norm(axes, axis=1)[:, None], R.T, atol=1e-12)


def test_the_key_of_the_path_says_what_each_mark_means(crane):
    figure = plan_paths.path_figure(crane)
    said = {t.get_text() for legend in figure.legends for t in legend.get_texts()}
    wanted = {"3 obstacles", "their clearances", "re-simulated", "start", "end", "waypoint via", "goal pass"}
    assert said == wanted


@pytest.mark.parametrize("name", NAMES)
def test_figures_of_a_plan_are_small_png_files_and_no_others(name, request, tmp_path):
    paths = plots.draw(request.getfixturevalue(name), tmp_path)
    assert {p.stem for p in paths} == {"strips", "path"}
    for path in paths:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG") and 3_000 < len(data) < 200_000, path


def test_the_film_of_a_plan_shows_its_obstacles(arm, crane, monkeypatch, tmp_path):
    motion = Motion.of(crane)
    figure = motion_gif.frame(motion, 3, motion_gif._limits(motion), 1.0)
    edges = [line for line in figure.axes[0].lines if line.get_color() == obstacle_shapes.EDGE]
    assert len(edges) == 4  # three obstacles, one clearance
    few = replace(arm, arrays={k: a[::20] for k, a in arm.arrays.items() if len(a) == COUNT})
    monkeypatch.setattr("socontrol.cli.plot.load_result", lambda folder: few)
    assert draw_again(tmp_path, tmp_path, gif=True) == 0 and (tmp_path / "motion.gif").read_bytes()[:3] == b"GIF"
