"""Obstacles: signed distances against numpy, their derivatives everywhere, and the balls a body is made of."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from robots import ROBOTS, RUBBER, Plain, robot
from scipy.spatial.transform import Rotation

import socontrol as so
from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.joints import Prismatic, Revolute
from socontrol.model.rods import Rod
from socontrol.model.sections import Annulus, Circle, Ellipse, Rectangle
from socontrol.programs.plans.obstacles import (
    FLAGS,
    OBSTACLES,
    Box,
    Capsule,
    HalfSpace,
    Obstacle,
    Sphere,
    Station,
    clearances,
    outer_radius,
    parse,
    stations,
)
from socontrol.quantities import Bad, adapter

CASES = {
    "sphere": Sphere(center=(0.1, -0.2, 0.3), radius=0.05),
    "capsule": Capsule(from_=(0.1, 0.0, 0.2), to=(-0.1, 0.2, 0.25), radius=0.03),
    "short capsule": Capsule(from_=(0.1, 0.0, 0.2), to=(0.1, 0.0, 0.2), radius=0.03),
    "box": Box(center=(0.2, 0.1, -0.1), size=(0.1, 0.2, 0.3), rotation=(0.4, -0.7, 0.3)),
    "plate": Box(center=(0.2, 0.1, -0.1), size=(0.4, 0.002, 0.3), rotation=(2.0, 0.1, -1.0)),
    "half_space": HalfSpace(point=(0.0, 0.1, 0.2), normal=(1.0, -2.0, 4.0)),
}
SIZE = {
    "sphere": 0.05, "capsule": 0.03, "short capsule": 0.03, "box": 0.1, "plate": 0.002, "half_space": 0.0,
}  # fmt: skip
TYPES = {"SX": ca.SX, "MX": ca.MX}
each_case = pytest.mark.parametrize("name", CASES)


def core(o, p):
    """Nearest points [k x 3] to p on what a round obstacle has its radius about, else of the body itself."""
    if isinstance(o, Sphere):
        return np.broadcast_to(o.center, p.shape)
    if isinstance(o, Capsule):
        along = np.subtract(o.to, o.from_)
        share = np.clip((p - o.from_) @ along / max(along @ along, 1e-300), 0, 1)
        return o.from_ + share[:, None] * along
    R = Rotation.from_rotvec(o.rotation).as_matrix()
    half = np.array(o.size) / 2
    return o.center + np.clip((p - o.center) @ R, -half, half) @ R.T


def truth(o, p):
    """Signed distances of p [k x 3] in numpy, with all their kinks."""
    if isinstance(o, HalfSpace):
        return (p - o.point) @ np.array(o.normal) / np.linalg.norm(o.normal)
    d = np.linalg.norm(p - core(o, p), axis=1)
    if not isinstance(o, Box):
        return d - o.radius
    walls = np.array(o.size) / 2 - np.abs((p - o.center) @ Rotation.from_rotvec(o.rotation).as_matrix())
    return np.where(d > 1e-12, d, -np.min(walls, axis=1))


def surface(o, count=120):
    """Points [k x 3] all over the surface of a sphere or box."""
    rng = np.random.default_rng(3)
    if isinstance(o, Sphere):
        v = rng.normal(size=(count**2, 3))
        return o.center + o.radius * v / np.linalg.norm(v, axis=1)[:, None]
    a, b = (x.ravel() for x in np.meshgrid(*[np.linspace(-0.5, 0.5, count)] * 2))
    faces = [np.insert(np.column_stack([a, b]), k, side, axis=1) for k in range(3) for side in (-0.5, 0.5)]
    return o.center + (np.concatenate(faces) * o.size) @ Rotation.from_rotvec(o.rotation).as_matrix().T


def around(o, count=400, seed=1):
    """Points [k x 3] round an obstacle, about half of them within twice its extent."""
    if isinstance(o, HalfSpace):
        middle, extent = np.array(o.point), 0.3
    elif isinstance(o, Capsule):
        middle, extent = (np.array(o.from_) + o.to) / 2, np.linalg.norm(np.subtract(o.from_, o.to)) / 2 + o.radius
    else:
        middle, extent = np.array(o.center), o.radius if isinstance(o, Sphere) else np.linalg.norm(o.size) / 2
    rng = np.random.default_rng(seed)
    return middle + extent * rng.normal(size=(count, 3)) * rng.choice([0.4, 1, 5], size=(count, 1))


def special(o):
    """Points at which an exact signed distance has kinks: centres, axes, medial planes, faces, edges, corners."""
    if isinstance(o, HalfSpace):
        return np.array([o.point])
    if isinstance(o, Sphere):
        return np.array([o.center, np.add(o.center, [o.radius, 0, 0]), np.add(o.center, [1e-9, 0, 0])])
    if isinstance(o, Capsule):
        shares = np.array([-0.1, 0, 1e-9, 0.3, 0.5, 1, 1.2])[:, None]
        on_axis = np.array(o.from_) + shares * np.subtract(o.to, o.from_)
        along = np.subtract(o.to, o.from_)
        across = np.cross(along, [0, 0, 1.0])
        across = o.radius * (across / np.linalg.norm(across) if np.any(across) else np.array([1.0, 0, 0]))
        return np.concatenate([on_axis, on_axis + across])
    grid = np.stack(np.meshgrid(*[[-1.3, -1, 0, 0.4, 1, 1.3]] * 3), axis=-1).reshape(-1, 3)  # in half sides
    equal = (np.array(o.size) / 2 - 0.3 * min(o.size)) / (np.array(o.size) / 2)  # as far from all three faces
    local = np.concatenate([grid, [equal]]) * np.array(o.size) / 2
    return o.center + local @ Rotation.from_rotvec(o.rotation).as_matrix().T


def distances(o, p):
    return np.array(o.distance(ca.DM(p.T))).ravel()


def derivatives(o, p, kind=ca.SX):
    """Gradients [k x 3] and Hessians [k x 3 x 3] of the distance at p [k x 3]."""
    x = kind.sym("p", 3)
    H, g = ca.hessian(o.distance(x), x)
    g, H = ca.Function("d", [x], [ca.densify(g), ca.densify(H)]).map(len(p))(p.T)
    return np.array(g).T, np.array(H).T.reshape(-1, 3, 3)


def test_every_kind_is_looked_at():
    assert {type(o) for o in CASES.values()} == set(OBSTACLES.values())
    assert set(FLAGS) == set(OBSTACLES)


# Distances


@each_case
def test_outside_the_distance_is_true_to_1e_4_of_the_size_and_never_above_the_truth(name):
    o = CASES[name]
    p = np.concatenate([around(o, 2000), special(o)])
    true = truth(o, p)
    outside = true > 1e-9
    error = distances(o, p) - true
    assert np.sum(outside) > 500
    assert np.max(error[outside]) <= 1e-14
    assert np.min(error[outside]) >= -1e-4 * SIZE[name] - 1e-14


@each_case
def test_inside_the_distance_is_negative_and_near_the_truth(name):
    o = CASES[name]
    p = around(o, 4000)
    true = truth(o, p)
    inside = true < -1e-4 * SIZE[name]
    assert np.sum(inside) > 10
    assert np.all(distances(o, p[inside]) < 0)
    assert np.max(np.abs(distances(o, p[inside]) - true[inside])) <= 0.01 * SIZE[name] + 1e-9


@pytest.mark.parametrize("name", ["sphere", "box"])
def test_the_distance_is_that_to_the_nearest_of_many_points_of_the_surface(name):
    o = CASES[name]
    p, skin = around(o, 60), surface(o)
    nearest = np.array([np.min(np.linalg.norm(skin - x, axis=1)) for x in p])
    coarse = 0.01 * max(o.size) if name == "box" else 0.05 * o.radius
    d = np.abs(distances(o, p))
    assert np.all(d <= nearest + 0.01 * SIZE[name])
    assert np.all(d >= nearest - coarse)


@each_case
def test_a_turned_and_shifted_obstacle_is_as_far_from_the_turned_and_shifted_point(name):
    o, p = CASES[name], around(CASES[name])
    turn, shift = Rotation.from_rotvec([0.5, -1.1, 0.8]), np.array([0.3, -0.4, 0.2])

    def moved(x):
        return tuple(turn.apply(x) + shift)

    keys = {key: moved(getattr(o, key)) for key in ("center", "from_", "to", "point") if hasattr(o, key)}
    if isinstance(o, Box):
        keys["rotation"] = tuple((turn * Rotation.from_rotvec(o.rotation)).as_rotvec())
    if isinstance(o, HalfSpace):
        keys["normal"] = tuple(turn.apply(o.normal))
    there = distances(replace(o, **keys), turn.apply(p) + shift)
    assert np.allclose(there, distances(o, p), rtol=0, atol=1e-12)


@each_case
@pytest.mark.parametrize("kind", TYPES)
def test_symbols_columns_and_single_points_give_the_same_distances(name, kind):
    o, p = CASES[name], np.concatenate([around(CASES[name], 20), special(CASES[name])])
    x = TYPES[kind].sym("p", 3, len(p))
    columns = np.array(ca.Function("d", [x], [o.distance(x)])(p.T)).ravel()
    x = TYPES[kind].sym("p", 3)
    assert o.distance(x).shape == (1, 1)
    single = ca.Function("d", [x], [o.distance(x)])
    assert np.array_equal(columns, distances(o, p))
    assert np.allclose([float(single(x)) for x in p], columns, rtol=0, atol=1e-15)


# Derivatives


@each_case
@pytest.mark.parametrize("kind", TYPES)
def test_value_and_both_derivatives_are_finite_where_an_exact_distance_has_kinks(name, kind):
    p = np.concatenate([special(CASES[name]), 1e4 * np.eye(3), -1e9 * np.eye(3)])
    assert np.all(np.isfinite(distances(CASES[name], p)))
    assert all(np.all(np.isfinite(values)) for values in derivatives(CASES[name], p, TYPES[kind]))


@each_case
def test_derivatives_are_those_of_differences(name):
    o, size = CASES[name], SIZE[name] or 1
    p, h = np.concatenate([around(o, 100), special(o)]), 1e-6 * size
    g, H = derivatives(o, p)
    steps = h * np.eye(3)
    slope = np.column_stack([(distances(o, p + e) - distances(o, p - e)) / (2 * h) for e in steps])
    bend = np.stack([(derivatives(o, p + e)[0] - derivatives(o, p - e)[0]) / (2 * h) for e in steps], axis=2)
    assert np.allclose(g, slope, rtol=0, atol=1e-4 if isinstance(o, Box) else 1e-6)
    assert np.all(np.abs(H - bend) <= 3e-4 * np.max(np.abs(H), axis=(1, 2), keepdims=True) + 1e-4 / size)


@each_case
def test_the_way_out_is_a_unit_vector_from_the_nearest_point(name):
    o, p = CASES[name], around(CASES[name])
    p = p[truth(o, p) > 0.05 * SIZE[name] + 1e-6]
    away = np.tile(o.normal, (len(p), 1)) if isinstance(o, HalfSpace) else p - core(o, p)
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    assert np.allclose(derivatives(o, p)[0], unit, rtol=0, atol=2e-3)


# Files and flags


@pytest.mark.parametrize(
    "text, record",
    [
        ("sphere:0.05,0,0.05,0.01", Sphere(center=(0.05, 0, 0.05), radius=0.01)),
        (" sphere : 50 mm, 0, .05, 1e-2 ", Sphere(center=(0.05, 0, 0.05), radius=0.01)),
        ("capsule:0,0,0,0,0,20 cm,5 mm", Capsule(from_=(0, 0, 0), to=(0, 0, 0.2), radius=0.005)),
        ("box:0,0,-1,1,2,30mm", Box(center=(0, 0, -1), size=(1, 2, 0.03))),
        ("half_space:0,0,-10 mm,0,0,1", HalfSpace(point=(0, 0, -0.01), normal=(0, 0, 1))),
    ],
)
def test_a_flag_says_what_a_file_would(text, record):
    assert adapter(Obstacle).validate_python(parse(text)) == record


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("spere:1,2,3,4", "'spere:1,2,3,4': unknown obstacle 'spere'; did you mean 'sphere'?"),
        ("", "'': unknown obstacle ''; allowed: sphere, capsule, box, half_space"),
        ("0,0,1,2", "unknown obstacle '0,0,1,2'; allowed: sphere, capsule, box, half_space"),
        ("sphere", "'sphere': 0 given; sphere takes 4 numbers: center x,y,z, radius"),
        ("sphere:1,2", "'sphere:1,2': 2 given; sphere takes 4 numbers: center x,y,z, radius"),
        ("box:1,2,3,4,5,6,7", "7 given; box takes 6 numbers: center x,y,z, size x,y,z"),
        ("capsule:1,2,,4,5,6,7", "'' is not a number; capsule takes 7 numbers: from x,y,z, to x,y,z, radius"),
        ("sphere:1,2,nan,4", "'nan' is not a number; sphere takes 4"),
        ("sphere:1,2,3," + "9" * 1000 + "x", "is not a number; sphere takes 4"),
    ],
)
def test_a_flag_that_does_not_fit_is_answered_in_one_line(text, sentence):
    with pytest.raises(ValueError) as error:
        parse(text)
    assert sentence in str(error.value)
    assert len(str(error.value)) < 200
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "mapping, sentence",
    [
        ({"type": "sphere", "center": [0, 0, 0], "radius": 0}, "0 is not positive"),
        ({"type": "sphere", "center": [0, 0, 0], "radius": 1e-200}, "1e-200 m is too small for an obstacle"),
        ({"type": "sphere", "center": [0, 0], "radius": 1}, "2 numbers are given; 3 are wanted"),
        ({"type": "box", "center": [0, 0, 0], "size": [1, 0, 1]}, "0 is not positive"),
        ({"type": "box", "center": [0, 0, 0], "size": [1, 1e-12, 1]}, "1e-12 m is too small for an obstacle"),
        ({"type": "half_space", "point": [0, 0, 0], "normal": [0, 0, 0]}, "all numbers are zero"),
        ({"type": "sphere", "center": [0, 0, 0], "radius": 1, "clearance": -1}, "-1 is negative"),
        ({"type": "wall"}, "unknown obstacle 'wall'; allowed: sphere, capsule, box, half_space"),
    ],
)
def test_nonsense_is_refused(mapping, sentence):
    with pytest.raises(ValueError) as error:
        adapter(Obstacle).validate_python(mapping)
    assert sentence in str(error.value)


def test_nonsense_from_python_is_refused_too():
    with pytest.raises(Bad, match="-1 m is too small"):
        Sphere(center=(0, 0, 0), radius=-1)
    with pytest.raises(Bad, match="all numbers are zero"):
        HalfSpace(point=(0, 0, 0), normal=(0, 0, 0))


# The body


@pytest.fixture(scope="module")
def octopus():
    return so.load_robot("configs/robots/octopus_arm.yaml")


def test_stations_cover_a_tapered_arm_with_its_radius(octopus):
    rows = stations(octopus)
    X = np.array([s.X for s in rows])
    assert {s.segment for s in rows} == {"arm"}
    assert X[0] == 0
    assert X[-1] == 1
    bounds = np.cumsum([0, 0.18, 0.17, 0.15, 0.12, 0.1, 0.09, 0.07, 0.06, 0.04, 0.02])
    assert all(np.min(np.abs(X - b)) < 1e-12 for b in bounds)
    radii = 0.01 - 0.008 * X  # 10 mm at the base, 2 mm at the tip
    assert np.allclose([s.radius for s in rows], radii, rtol=0, atol=1e-15)
    gaps = 0.245 * np.diff(X)
    assert np.all(gaps > 0)
    assert np.all(gaps <= np.maximum(radii[1:], 0.245 / 30) + 1e-12)
    inner = np.searchsorted(X, bounds[1:] - 1e-12) - np.searchsorted(X, bounds[:-1] + 1e-12)
    assert np.all(inner >= 2)
    assert np.max(0.245 * np.diff([s.X for s in stations(octopus, per_section=6)])) <= np.max(gaps) / 2 + 1e-12


def test_a_ball_as_thick_as_the_arm_sinks_in_between_two_stations_by_what_the_text_says():
    r, bar = 0.01, Rod(length=0.3, cross_section=Circle(radius=0.01), material=RUBBER)
    arm = Robot(Description(segments={"arm": bar}))
    rows, kin = stations(arm), Kinematics(arm.tree, ca.DM(arm.n, 1))
    h = 0.3 * np.max(np.diff([s.X for s in rows]))
    assert h == pytest.approx(r)
    depths = np.linspace(0, 0.08 * r, 33)
    sunk = 0.0
    for x in np.linspace(0.1, 0.1 + h, 9):  # along the straight arm
        free = [
            float(ca.mmin(clearances(arm, kin, Sphere(center=(x, 0, 2 * r - depth), radius=r), rows))) >= 0
            for depth in depths
        ]
        sunk = max([sunk, *depths[np.array(free)]])
    assert 0.05 * r < sunk <= 2 * r - np.sqrt(4 * r**2 - h**2 / 4) < 0.065 * r


def test_a_station_is_named_by_segment_and_place(octopus):
    assert Station("arm", 0.6, 0.01).name == "arm at 0.6"
    names = [s.name for s in stations(octopus)]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", ["branched", "threaded", "taper", "two_roots", "free", "prismatic", "table"])
@pytest.mark.parametrize("kind", ["DM", *TYPES])
def test_clearances_are_distances_of_the_places_less_the_radius_and_the_clearance(name, kind):
    plain, arm = Plain(ROBOTS[name]), robot(name)
    rows, q = stations(arm), plain.scales * np.sin(np.arange(1.0, plain.n + 1))
    frames = plain.stations(q)
    places = []
    for s in rows:
        if isinstance(plain.segments[s.segment], Rod):
            places.append(plain.frame(q, s.segment, s.X)[:3, 3])
        else:
            moving, end = (g[:3, 3] for g in frames[s.segment][1:])
            places.append(moving + s.X * (end - moving))
    o = Box(center=(0.1, 0.2, 0.1), size=(0.1, 0.1, 0.2), clearance=0.007)
    wanted = truth(o, np.array(places)) - [s.radius for s in rows] - 0.007
    if kind == "DM":
        found = clearances(arm, Kinematics(arm.tree, ca.DM(q)), o, rows)
    else:
        x = TYPES[kind].sym("q", arm.n)
        found = ca.Function("c", [x], [clearances(arm, Kinematics(arm.tree, x), o, rows)])(q)
    assert found.shape == (len(rows), 1)
    assert np.allclose(np.array(found).ravel(), wanted, rtol=0, atol=1e-5)


def test_of_stations_in_one_place_the_thickest_stays():
    hybrid = so.load_robot("configs/robots/hybrid_arm.yaml")
    by_name = {s.name: s for s in stations(hybrid)}
    assert "upper at 1" in by_name or "fore at 0" in by_name
    assert not {"upper at 1", "fore at 0"} <= set(by_name)  # the elbow
    assert "fore at 1" not in by_name  # the soft link begins there
    assert by_name["soft at 0"].radius == 0.02
    gaps = np.diff([s.X for s in by_name.values() if s.segment == "fore"])
    assert np.max(gaps) * 0.3 <= hybrid.length / 30 + 1e-12


def test_held_stations_are_those_that_no_coordinate_moves():
    arm = Rod(length=0.2, cross_section=Circle(radius=0.01), material=RUBBER)
    standing = Robot(Description(segments={"arm": arm}))
    assert [s.name for s in stations(standing) if s.held] == ["arm at 0"]
    swinging = Robot(Description(segments={"hub": Revolute(), "arm": replace(arm, parent="hub")}))
    assert [s.name for s in stations(swinging) if s.held] == ["arm at 0"]  # the hub turns about this point
    sliding = Robot(Description(segments={"cart": Prismatic(), "arm": replace(arm, parent="cart")}))
    assert not [s.name for s in stations(sliding) if s.held]


@pytest.mark.parametrize(
    "section, radius",
    [
        (Circle(radius=0.01), 0.01),
        (Annulus(inner_radius=0.004, radius=0.012), 0.012),
        (Ellipse(radius_y=0.003, radius_z=0.008), 0.008),
        (Rectangle(width=0.006, height=0.008), 0.005),
    ],
)
def test_the_radius_of_a_station_holds_the_whole_cross_section(section, radius):
    assert outer_radius(section) == pytest.approx(radius)


def test_a_robot_without_stations_has_no_clearances(octopus):
    kin = Kinematics(octopus.tree, ca.SX.sym("q", octopus.n))
    assert clearances(octopus, kin, CASES["sphere"], []).shape == (0, 1)
