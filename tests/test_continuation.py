"""Continuation: buckling loads, branches and snap-through against closed forms; stability against energies.

A planar rod of N straight sections of constant strain bends in angles that are linear along each section, so that the
energy of small deflections is that of linear finite elements: a mode of wave number w buckles at exactly
    P = EJ (6 / h^2) (1 - cos w h) / (2 + cos w h),    h = L / N,
and, where the rod stretches, at P (1 - P / EA) = that: the shorter rod bends less.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import socontrol as so
from socontrol.cli import run
from socontrol.files.loader import FileError
from socontrol.programs.postures.continuation import family_of
from socontrol.report.branch_shapes import LoadPath

PROBLEMS = Path(__file__).parents[1] / "problems"

L, E, WIDTH, HEIGHT = 1.0, 1e7, 0.02, 0.04
EJ, EA = E * HEIGHT * WIDTH**3 / 12, E * WIDTH * HEIGHT
RIGHT = {"position": [L, 0, 0]}
ALONG = {"axis": [1, 0, 0]}
ABOUT = {"axis": [0, 0, 1]}
WAVES = {"clamped_free": np.pi / 2, "pinned_pinned": np.pi, "clamped_clamped": 2 * np.pi}


def rod(sections, length=L, **changes):
    rubber = {"type": "linear", "young_modulus": E, "poisson_ratio": 0.3, "density": 1000}
    return {"type": "rod", "length": length, "strains": "planar_constant_curvature", "sections": sections,
            "cross_section": {"type": "rectangle", "width": WIDTH, "height": HEIGHT}, "material": rubber,
            **changes}  # fmt: skip


def push(on, force=(-1, 0, 0), **changes):
    return {"push": {"type": "wrench", "on": on, "force": list(force), **changes}}


def clamped_free(sections, **changes):
    return {"segments": {"column": rod(sections, **changes)}, "loads": push("column"), "gravity": [0, 0, 0]}


def pinned_pinned(sections, **changes):
    """Pinned at its foot, and at its head to a slider."""
    segments = {"foot": {"type": "revolute", **ABOUT}, "column": rod(sections, parent="foot", **changes),
                "head": {"type": "prismatic", **ALONG, "placement": RIGHT}}  # fmt: skip
    pin = {"type": "revolute", **ABOUT, "a": {"segment": "column"}, "b": {"segment": "head"}}
    return {"segments": segments, "loops": {"pin": pin}, "loads": push("head"), "gravity": [0, 0, 0]}


def clamped_clamped(sections):
    guide = {"type": "prismatic", **ALONG, "a": {"segment": "column"}, "b": {"segment": "world", "placement": RIGHT}}
    return {**clamped_free(sections), "loops": {"guide": guide}}


def cut_and_welded(sections):
    """The clamped column cut in the middle; the upper half rides on a joint of its own and is welded on."""
    middle = {"position": [L / 2, 0, 0]}
    segments = {"lower": rod(sections // 2, L / 2), "rider": {"type": "planar", "placement": middle},
                "upper": rod(sections // 2, L / 2, parent="rider")}  # fmt: skip
    weld = {"type": "fixed", "a": {"segment": "lower"}, "b": {"segment": "rider"}}
    return {"segments": segments, "loops": {"weld": weld}, "loads": push("upper"), "gravity": [0, 0, 0]}


COLUMNS = {"clamped_free": clamped_free, "pinned_pinned": pinned_pinned, "clamped_clamped": clamped_clamped}


def euler(w):
    return EJ * w**2


def discrete(w, sections):
    """Load at which a mode of N sections buckles, stretch counted."""
    h = L / sections
    P = EJ * 6 / h**2 * (1 - np.cos(w * h)) / (2 + np.cos(w * h))
    return EA * (1 - np.sqrt(1 - 4 * P / EA)) / 2


def ask(robot, to, vary=None, **changes):
    keys = {"type": "continuation", "robot": robot, "vary": vary or {"loads": ["push"]}, "to": to}
    return so.solve(so.problem({**keys, "branches": 0, "discretisation": False, **changes}))


@cache
def buckled():
    """The clamped column with its first bifurcation and both branches."""
    return ask(clamped_free(6), 4.0, branches=2).require()


# Columns


@pytest.mark.parametrize("kind", COLUMNS)
def test_a_column_buckles_at_the_load_of_its_sections_and_comes_to_eulers(kind):
    errors, w = [], WAVES[kind]
    for sections in (4, 8):
        result = ask(COLUMNS[kind](sections), 1.3 * euler(w)).require()
        assert result["critical_load"] == pytest.approx(discrete(w, sections), rel=1e-10)
        (critical,) = result.details["critical"]
        assert critical["kind"] == "bifurcation" and (critical["before"], critical["after"]) == (0, 1)
        load = result["critical_load"]
        errors.append(load * (1 - load / EA) / euler(w) - 1)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1) and errors[1] < 0.053


def test_a_column_has_its_higher_modes_further_on():
    result = ask(clamped_free(8), 30 * euler(np.pi / 2)).require()
    assert [result[f"critical.{k}"] for k in range(3)] == pytest.approx(
        [discrete((2 * k + 1) * np.pi / 2, 8) for k in range(3)], rel=1e-10
    )
    assert [row["after"] for row in result.details["critical"]] == [1, 2, 3]


def test_the_buckling_mode_is_the_cosine_of_its_sections():
    """Angles of the mode of a clamped column at the ends of its sections are samples of sin(pi s / 2 L)."""
    bend = buckled().arrays["critical.0.mode"][::2, 0]
    angles = np.sin(np.pi / 2 * np.arange(7) / 6)
    assert bend / bend[0] == pytest.approx(np.diff(angles) / (angles[1] - angles[0]), rel=1e-8)
    assert buckled().arrays["critical.0.mode"][1::2, 0] == pytest.approx(np.zeros(6), abs=1e-9)


def test_a_column_cut_and_welded_is_the_column():
    whole, cut = buckled(), ask(cut_and_welded(6), 4.0, branches=1).require()
    assert cut["critical_load"] == pytest.approx(whole["critical_load"], rel=1e-11)
    assert np.abs(cut["branch.1.position"]) == pytest.approx(np.abs(whole["branch.1.position"]), abs=1e-9)


def test_a_round_column_buckles_in_two_directions_at_once():
    round_one = {"strains": "kirchhoff_love", "cross_section": {"type": "circle", "radius": 0.02}}
    result = ask(clamped_free(4, **round_one), 5.0, branches=2).require()
    J, A = np.pi * 0.02**4 / 4, np.pi * 0.02**2
    load = result["critical.0"]
    P = E * J / EJ * discrete(np.pi / 2, 4) * (1 - discrete(np.pi / 2, 4) / EA)
    assert load * (1 - load / (E * A)) == pytest.approx(P, rel=1e-10)
    assert result.details["critical"][0]["modes"] == 2 and result.details["critical"][0]["after"] == 2
    y, z = result.arrays["branch.1.watch"].T[1:]  # it stays in the plane in which it buckles: turning costs nothing
    assert result.details["branches"][1]["ended"] == "end" and np.hypot(y, z)[-1] > 0.5 * L
    assert y * z[-1] - z * y[-1] == pytest.approx(0 * y, abs=1e-9)
    assert result["branch.2.position"] == pytest.approx(result["branch.1.position"] * np.array([1, -1, -1]), abs=1e-9)
    assert "in 2 modes at once: 2 of the branches that leave there are followed" in result.status.message
    assert "Branches 1 and 2 are marginal" in result.status.message  # turned about its axis it bends as well
    assert result.arrays["branch.0.stable"][0] and not result.arrays["branch.1.stable"].any()


def test_a_platform_on_three_rods_sways_to_opposite_sides_without_a_twist():
    """Two sways and a twist buckle at once; the stiffness of the twist falls at a rate of its own."""
    segments, loops, round_one = {}, {}, {"type": "circle", "radius": 0.02}
    for k, angle in enumerate(0.3 + 2 * np.pi / 3 * np.arange(3)):
        foot = {"position": [0.0, float(0.6 * np.cos(angle)), float(0.6 * np.sin(angle))]}
        segments[f"leg_{k}"] = rod(1, placement=foot, strains="kirchhoff_love", cross_section=round_one)
        at = {"segment": "plate", "placement": foot}
        loops[f"ball_{k}"] = {"type": "spherical", "a": {"segment": f"leg_{k}"}, "b": at}
    segments["plate"] = {"type": "free", "placement": RIGHT}
    robot = {"segments": segments, "loops": loops, "loads": push("plate"), "gravity": [0, 0, 0]}
    result = ask(robot, 16.0, branches=2, points=30)
    one, other = (result.arrays[f"branch.{k}.q"][-1, -6:] for k in (1, 2))
    assert result.details["critical"][0]["modes"] == 3 and np.hypot(*one[-2:]) > 0.1
    assert other[-2:] == pytest.approx(-one[-2:], abs=1e-4)
    assert [one[0], other[0]] == pytest.approx([0, 0], abs=1e-6)


@pytest.mark.parametrize("kind", ["input", "coordinate"])
def test_a_motor_buckles_a_column_by_its_force_and_by_its_way(kind):
    motor = {"actuators": {"motor": {"type": "joint_torque", "joint": "head", "limits": [-1, 1]}}, "loads": {}}
    robot = {**pinned_pinned(4), **motor}
    P = discrete(np.pi, 4)
    to, name, want = {"input": (-4.0, "motor", -P), "coordinate": (-0.001, "head", -P * L / EA)}[kind]
    result = ask(robot, to, {kind: name}).require()
    assert result["critical_load"] == pytest.approx(want, rel=1e-10)
    assert ("Beyond limits: motor passes its limit -1 N." in result.status.message) == (kind == "input")


@pytest.mark.parametrize("kind", ["loads", "input", "coordinate"])
def test_the_tangent_of_a_branch_is_its_slope(kind):
    """By differences of Newton's method, on a bent column with a loop."""
    motor = {"actuators": {"motor": {"type": "joint_torque", "joint": "head"}}}
    robot = {**pinned_pinned(3, rest={"bend_z": 0.3}), **motor}
    vary = {"loads": {"loads": ["push"]}, "input": {"input": "motor"}, "coordinate": {"coordinate": "head"}}[kind]
    to = {"loads": 1.5, "input": -1.5, "coordinate": -0.1}[kind]
    asked = {"type": "continuation", "robot": robot, "vary": vary, "to": to}
    family, _, first = family_of(so.problem(asked))
    point, _ = family.corrected(first, 0.05 * first.t)
    ahead, back = (family.corrected(point, way * 1e-4 * point.t)[0] for way in (1, -1))
    slope = family.distance(back, ahead) / 2e-4
    assert slope == pytest.approx(point.t, abs=1e-6) and np.linalg.norm(point.t) == pytest.approx(1)


def test_a_force_that_follows_a_head_that_cannot_turn_buckles_the_column_all_the_same():
    load = ask({**clamped_clamped(6), "loads": push("column", axes="body")}, 12.0).require()["critical_load"]
    assert load == pytest.approx(discrete(2 * np.pi, 6), rel=1e-9)


def test_what_is_unstable_at_the_beginning_loses_nothing():
    result = ask(clamped_free(6), 8.0, **{"from": 2.0}).require()
    assert result.status.message.startswith("Unstable from the beginning, factor 2")
    assert result["critical.0"] == pytest.approx(discrete(1.5 * np.pi, 6), rel=1e-10)
    assert "critical_load" not in result.values


# Beyond the first load


def elastica(load):
    """Tip (x, y) over L of the clamped elastica under `load` over the Euler load."""
    k = brentq(lambda k: (2 * ellipk(k**2) / np.pi) ** 2 - load, 1e-6, 0.999)
    return np.array([2 * ellipe(k**2) / ellipk(k**2) - 1, 2 * k / ellipk(k**2)])


@pytest.mark.parametrize("load", [1.1, 2.0])
def test_a_buckled_column_is_the_elastica_of_elliptic_integrals(load):
    errors = []
    for sections in (6, 12):
        result = ask(clamped_free(sections, strains=["bend_z"]), load * euler(np.pi / 2), branches=1).require()
        errors.append(np.max(np.abs(np.abs(result["branch.1.position"][:2]) - elastica(load))))
    assert errors[1] < 0.02 * L and errors[0] / errors[1] == pytest.approx(4, rel=0.15)


def test_buckled_shapes_are_stable_and_the_straight_one_is_not_beyond_its_load():
    result = buckled()
    straight = result.arrays["branch.0.parameter"] < result["critical_load"] * (1 - 1e-9)
    beyond = result.arrays["branch.0.parameter"] > result["critical_load"] * (1 + 1e-9)
    assert result.arrays["branch.0.stable"][straight].all() and not result.arrays["branch.0.stable"][beyond].any()
    assert result.arrays["branch.1.stable"][1:].all() and result.arrays["branch.2.stable"][1:].all()
    assert LoadPath(result).taken == [0, 1]  # it bends to one side
    assert result["branch.2.position"] == pytest.approx(result["branch.1.position"] * np.array([1, -1, 1]), abs=1e-9)


@pytest.mark.parametrize("branch", [0, 1])
def test_stability_is_that_of_the_energy(branch):
    """The Hessian of elastic energy less the work of the load, by differences of energies and poses."""
    result, robot = buckled(), buckled().question.robot
    f, sizes = robot.functions(), np.tile([1.0, 0.02], 6)

    def energy(q, mu):
        x = np.array(f.pose("column").function(q))[0, 3]
        return float(np.array(f.energy.function(q, np.zeros(robot.n))).ravel()[1]) + mu * x

    for k in (2, -1):
        q, mu = (result.arrays[f"branch.{branch}.{key}"][k] for key in ("q", "parameter"))
        steps = 1e-3 * np.diag(sizes)
        H = np.array([[sum(s * t * energy(q + s * a + t * b, mu) for s in (1, -1) for t in (1, -1)) for a in steps]
                      for b in steps])  # fmt: skip
        assert (np.linalg.eigvalsh(H)[0] > 0) == result.arrays[f"branch.{branch}.stable"][k]


def test_a_column_that_is_not_straight_does_not_buckle_but_comes_near():
    """Without a bifurcation its deflection follows the perfect column's, the nearer the less it is bent."""
    perfect, gaps = buckled()["branch.1.position"], []
    for bend in (0.08, 0.02):
        result = ask(clamped_free(6, rest={"bend_z": bend}), 4.0).require()
        assert not result.details["critical"] and result.arrays["branch.0.stable"].all()
        gaps.append(np.linalg.norm(np.abs(result["branch.0.position"]) - np.abs(perfect)))
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.1) and gaps[1] < 0.01


def test_a_force_that_follows_the_column_does_not_buckle_it():
    """Beck's column has no other shape at rest under any force; it flutters, which statics cannot tell."""
    robot = {**clamped_free(6), "loads": push("column", axes="body")}
    result = ask(robot, 30 * euler(np.pi / 2)).require()
    assert not result.details["critical"] and "critical_load" not in result.values
    assert "Does not diverge" in result.status.message and "flutter" in result.status.message


# Snap-through


K, B, L0 = 500.0, 0.3, np.hypot(0.3, 0.1)  # N/m of a bar, half the span, length of a bar without force
TILT = np.arctan2(0.1, B)


def truss(**changes):
    """Two springs that slide on bars, pinned to the ground and to each other."""
    segments = {}
    for name, x, angle in (("left", -B, TILT), ("right", B, np.pi - TILT)):
        foot = {"position": [x, 0, 0], "rotation": [0, 0, float(angle)]}
        segments[name] = {"type": "revolute", **ABOUT, "placement": foot}
        segments[f"{name}_bar"] = {"type": "prismatic", **ALONG, "parent": name, "stiffness": K,
                                   "placement": {"position": [float(L0), 0, 0]}}  # fmt: skip
    pin = {"type": "revolute", **ABOUT, "a": {"segment": "left_bar"}, "b": {"segment": "right_bar"}}
    robot = {"segments": segments, "loops": {"apex": pin}, "loads": push("right_bar", [0, -1, 0]), "gravity": [0, 0, 0]}
    return {**robot, **changes}


def force(y):
    """Downward force that holds the apex at height y, by Hooke's law."""
    length = np.hypot(B, y)
    return 2 * K * (L0 - length) * y / length


def test_a_shallow_truss_snaps_where_its_force_is_largest():
    result = ask(truss(), 20.0, watch={"on": "left_bar"}).require()
    assert result.details["redundant_rows"] == {"apex": 3}
    length = (L0 * B**2) ** (1 / 3)  # dP/dy = 0
    top = np.sqrt(length**2 - B**2)
    assert [result["critical.0"], result["critical.1"]] == pytest.approx([force(top), force(-top)], rel=1e-10)
    assert result["critical_load"] == result["critical.0"]
    assert [row["kind"] for row in result.details["critical"]] == ["limit point"] * 2
    y = result.arrays["branch.0.watch"][:, 1]
    assert result.arrays["branch.0.parameter"] == pytest.approx(force(y), abs=1e-9 * K)
    assert np.all(np.diff(y) < 0) and y[-1] < -0.1  # all the way down
    clear = np.abs(np.abs(y) - top) > 1e-6
    assert np.array_equal(result.arrays["branch.0.stable"][clear], np.abs(y[clear]) > top)


def test_a_steep_truss_leaves_sideways_before_it_snaps():
    """Sideways the stiffness 2 K (1 - L0 y^2 / l^3) is lost first; seen from there the other branch is unstable."""
    y0, b = 0.3, 0.1
    robot, tilt, free = truss(), np.arctan2(0.3, 0.1), np.hypot(0.3, 0.1)
    for name, x, angle in (("left", -b, tilt), ("right", b, np.pi - tilt)):
        robot["segments"][name]["placement"] = {"position": [x, 0, 0], "rotation": [0, 0, float(angle)]}
        robot["segments"][f"{name}_bar"]["placement"] = {"position": [float(free), 0, 0]}
    result = ask(robot, 50.0, watch={"on": "left_bar"}, branches=1, points=60)
    y = brentq(lambda y: 1 - free * y**2 / np.hypot(b, y) ** 3, 0.2, y0)
    load = 2 * K * (free - np.hypot(b, y)) * y / np.hypot(b, y)
    assert result["critical.0"] == pytest.approx(load, rel=1e-10)
    assert result.details["critical"][0]["kind"] == "bifurcation"
    x, y = result.arrays["branch.1.watch"].T[:2]
    assert np.max(np.abs(x)) > 0.01
    left, right = np.hypot(x + b, y), np.hypot(x - b, y)
    assert K * (free - left) * (x + b) / left + K * (free - right) * (x - b) / right == pytest.approx(0 * x, abs=1e-7)
    down = K * (free - left) * y / left + K * (free - right) * y / right
    assert down == pytest.approx(result.arrays["branch.1.parameter"], abs=1e-7)


def test_weight_bends_a_tall_column():
    """Greenhill's column of uniform weight: q L^3 = 7.8373 EJ (first zero of the Bessel function J_-1/3)."""
    tall = {**clamped_free(8, strains=["bend_z"]), "loads": {}, "gravity": [-9.81, 0, 0]}
    result = ask(tall, 12.0, {"gravity": True}).require()
    weight = 1000 * WIDTH * HEIGHT * 9.81
    assert result["critical_load"] * weight * L**3 / EJ == pytest.approx(7.8373, rel=0.01)


def arch(sections=6, angle=0.7):
    """An arc clamped at both ends, pushed down at its crown."""
    R = L / angle
    curved = rod(sections, strains=["bend_z"], rest={"bend_z": -1 / R}, placement={"rotation": [0, 0, angle / 2]})
    foot = {"position": [float(2 * R * np.sin(angle / 2)), 0, 0], "rotation": [0, 0, -angle / 2]}
    clamp = {"type": "fixed", "a": {"segment": "arch"}, "b": {"segment": "world", "placement": foot}}
    loads = push("arch", [0, -1, 0], at=0.5)
    return {"segments": {"arch": curved}, "loops": {"clamp": clamp}, "loads": loads, "gravity": [0, 0, 0]}


def test_branches_of_an_arch_that_lean_to_either_side_are_mirror_images_and_end_where_they_join():
    result = ask(arch(), 40.0, watch={"on": "arch", "at": 0.5}, branches=2).require()
    path = LoadPath(result)  # the branches that lean are unstable: the arch that is drawn goes on to where it snapped
    assert path.taken == [0] and path.q[-1] == pytest.approx(result.arrays["branch.0.q"][-1])
    assert [label.partition(":")[0] for label in path.labels] == list("12345678") and path.labels[3].endswith("*")
    kinds = [row["kind"] for row in result.details["critical"]]
    assert kinds == ["bifurcation", "limit point", "limit point", "bifurcation"]  # leans, would snap
    rows = result.details["branches"]
    assert [row["from"] for row in rows] == [None, 0, 0] and [row["ended"] for row in rows] == ["end", "meets", "meets"]
    assert rows[1]["critical"][-1][0] == rows[2]["critical"][-1][0] == 3
    crown = [result.arrays[f"branch.{k}.watch"] - result.arrays["branch.0.watch"][0] for k in (1, 2)]
    loads = [result.arrays[f"branch.{k}.parameter"] for k in (1, 2)]
    for axis, sign in ((0, -1), (1, 1)):
        mirrored = np.interp(-loads[0], -loads[1], sign * crown[1][:, axis])
        assert crown[0][:, axis] == pytest.approx(mirrored, abs=1e-4 * L)
    assert np.max(np.abs(crown[0][:, 0])) > 0.005 * L


def test_the_place_that_moves_farthest_is_watched_where_none_is_named():
    result = ask(clamped_clamped(4), 1.4 * euler(2 * np.pi), branches=1).require()
    pose = result.question.robot.functions().pose
    ends = [result.arrays["branch.0.q"][0], result.arrays["branch.1.q"][-1]]
    places = np.linspace(0, 1, 101)
    moved = [np.linalg.norm(np.subtract(*(np.array(pose("column", x).function(q))[:3, 3] for q in ends)))
             for x in places]  # fmt: skip
    assert result.details["watch"]["at"] == pytest.approx(places[np.argmax(moved)], abs=0.02)


def test_a_moment_in_space_beside_a_force_is_no_force_that_follows():
    """A load of both is told with its units; a moment in space has no potential."""
    result = ask({**clamped_free(3), "loads": push("column", moment=[0, 0, 1e-3])}, 1.0).require()
    assert "(push 1 N and 1 mN m). Some forces have no potential (as those that follow the robot, moments" in (
        result.status.message
    )
    assert result.details["varies"] == "factor on push"


# What is refused, and the command line


def swivelling():
    """A column on a hinge, pushed along itself whatever way it points."""
    segments = {"foot": {"type": "revolute", **ABOUT}, "column": rod(2, parent="foot")}
    return {"segments": segments, "loads": push("column", axes="body"), "gravity": [0, 0, 0]}


REFUSED = {
    "an unknown load": ({"vary": {"loads": ["tip"]}}, "there is no load 'tip'"),
    "no load at all": ({"robot": {**clamped_free(2), "loads": {}}}, "there is no load 'push'; the robot has none"),
    "nothing that varies": ({"vary": {}}, "nothing varies; name"),
    "two things": ({"vary": {"loads": ["push"], "input": "motor"}}, "two things vary"),
    "an unknown input": ({"vary": {"input": "motor"}}, "no input 'motor'"),
    "an unknown coordinate": ({"vary": {"coordinate": "hip"}}, "no coordinate 'hip'"),
    "a coordinate that is given": (
        {"vary": {"coordinate": "column.0.stretch"}, "coordinates": {"column.0.stretch": 0.1}}, "leave it out here"),
    "no range": ({"from": 2, "to": 2}, "to: 2 is where `from` begins"),
    "a factor with a unit": ({"to": "2 N"}, "to: 2 N is"),
    "no weight": ({"vary": {"gravity": True}}, "`gravity` is zero"),
    "water": (
        {"loads": {"sea": {"type": "fluid", "density": 1000}}, "vary": {"loads": ["sea"]}}, "is no force or moment"),
    "a zero force": (
        {"loads": {"none": {"type": "wrench", "on": "column"}}, "vary": {"loads": ["none"]}}, "'none' is zero"),
    "fewer than no branches": ({"branches": -1}, "branches: -1 is negative"),
    "an unknown place": ({"watch": {"on": "colum"}}, "watch.on: "),
    "lengths": ({"lengths": {"c": 1}}, "unknown key 'lengths'"),
    "a joint that nothing holds": ({"robot": swivelling()}, "nothing holds foot, so no equilibrium is distinct"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_question_that_cannot_be_meant_is_refused_in_one_line(name):
    keys, sentence = REFUSED[name]
    with pytest.raises(FileError, match=sentence) as error:
        so.problem({"type": "continuation", "robot": clamped_free(2), "vary": {"loads": ["push"]}, "to": 2, **keys})
    assert len(error.value.lines()) == 1


def test_a_solver_in_c_is_of_statics_alone(tmp_path):
    with pytest.raises(ValueError, match="'continuation' has no solver in C"):
        so.codegen(buckled().question, tmp_path / "code")


def test_a_beginning_without_equilibrium_is_said_to_be_one():
    far = {"segment": "world", "placement": {"position": [0, 9, 0]}}
    pin = {"type": "spherical", "a": {"segment": "column"}, "b": far}
    result = ask({**clamped_free(2, strains=["bend_z"]), "loops": {"pin": pin}}, 1.0)
    assert result.status.exit_code == 4 and result.status.message.startswith("At the beginning, factor 0")


def test_the_command_line_solves_verifies_draws_and_stops_at_limits(tmp_path, capsys, monkeypatch):
    from socontrol.report.branch_curves import branches_figure

    monkeypatch.chdir(tmp_path)
    file = str(PROBLEMS / "snap_through.yaml")
    assert run(["solve", file, "--verify", "--no-figures"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["critical.0", "limit", "point", "branch", "0", "2.02735", "2.0274", "N", "0", "->", "1", "1"] in rows
    folder = tmp_path / "results" / "snap_through"
    stored = so.load_result(folder)
    lines = branches_figure(stored).axes[0].lines
    solid, dashed = ([line for line in lines if line.get_linestyle() == look] for look in ("-", "--"))
    assert len(solid) == 2 and len(dashed) == 1  # up to the first limit point and from the second; between
    assert max(solid[0].get_ydata()) == pytest.approx(stored["critical.0"])
    assert min(dashed[0].get_ydata()) == pytest.approx(stored["critical.1"])
    assert run(["plot", str(folder), "-o", "again"]) == 0
    assert {path.name for path in (tmp_path / "again").glob("*.png")} == {"branches.png", "shapes.png"}
    capsys.readouterr()
    assert run(["solve", file, "--json", "--no-figures", "--set", "points=5", "-o", "short"]) == 5
    told = json.loads(capsys.readouterr().out)
    assert told["status"]["outcome"] == "limit" and "after 5 points; raise `points`" in told["status"]["message"]
    assert run(["solve", file, "--set", "to=0"]) == 3
    assert "to: 0 is where `from` begins" in capsys.readouterr().err
