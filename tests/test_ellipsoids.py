"""Ellipsoids of a place on a robot: against closed forms of arms and mechanisms, and against statics solved again."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from printed import words

import socontrol as so
from socontrol.files.loader import FileError
from socontrol.mechanics import ellipsoids as formulas
from socontrol.programs.postures.ellipsoids import KINDS

L1, L2, TURNS = 0.5, 0.3, (0.4, 0.9)
SPRINGS = (2.0, 0.7)  # N m/rad
SLOPES = np.array(  # of the tip of a planar arm with two turning joints, in their angles
    [[-L1 * np.sin(0.4) - L2 * np.sin(1.3), -L2 * np.sin(1.3)], [L1 * np.cos(0.4) + L2 * np.cos(1.3), L2 * np.cos(1.3)]]
)
ROD = {"type": "rod", "length": 0.25, "strains": "kirchhoff_love", "sections": 2,
       "cross_section": {"type": "circle", "radius": 0.01},
       "material": {"type": "linear", "young_modulus": 110e3, "poisson_ratio": 0.3, "density": 1080}}  # fmt: skip
FORCE = {"tip": {"type": "wrench", "on": "arm", "force": [1e-3, 2e-3, -1e-3]}}
FOLLOWER = {"tip": {"type": "wrench", "on": "arm", "force": [0, 4e-3, 2e-3], "moment": [0, 0, 1e-4], "axes": "body"}}


def two_turns(stiffness=SPRINGS, rest=TURNS):
    """Two links of L1 and L2 that turn about z, springs at rest at TURNS."""
    links = {"upper": L1, "lower": L2}
    segments = {
        name: {"type": "revolute", "axis": [0, 0, 1], "parent": parent, "tip": {"position": [length, 0, 0]},
               "stiffness": k, "rest": angle}
        for (name, length), parent, k, angle in zip(links.items(), ("world", "upper"), stiffness, rest, strict=True)
    }  # fmt: skip
    motors = {f"at_{name}": {"type": "joint_torque", "joint": name, "limits": [-1, 1]} for name in links}
    return {"gravity": [0, 0, 0], "segments": segments, "actuators": motors}


def arm(**of_cable):
    """A rod under its weight with three cables."""
    cables = {
        f"c{k}": {"type": "tendon", "along": ["arm"], "limits": [0, f"{k + 1} N"], **of_cable,
                  "offset": [8e-3 * float(np.cos(2.1 * k)), 8e-3 * float(np.sin(2.1 * k))]}
        for k in range(3)
    }  # fmt: skip
    return {"gravity": [0, 0, -0.5], "segments": {"arm": ROD}, "actuators": cables}


def parallelogram(stiffness=(0.5, 0.3, 0.2), rest=(0.5, -0.5, 0.5), ground=0.3):
    """Two cranks of 0.2 m, 0.3 m apart on the coupler; so far apart on the `ground` they stay parallel."""
    turn = {"type": "revolute", "axis": [0, 0, 1]}
    parts = {"crank": ("world", 0.2), "coupler": ("crank", 0.3), "rocker": ("coupler", -0.2)}
    segments = {
        name: {**turn, "parent": parent, "tip": {"position": [length, 0, 0]}, "stiffness": k, "rest": angle}
        for (name, (parent, length)), k, angle in zip(parts.items(), stiffness, rest, strict=True)
    }
    foot = {"segment": "world", "placement": {"position": [ground, 0, 0]}}
    loop = {"type": "revolute", "axis": [0, 0, 1], "a": {"segment": "rocker"}, "b": foot}
    motor = {"motor": {"type": "joint_torque", "joint": "crank", "limits": [-2, 2]}}
    return {"gravity": [0, 0, 0], "segments": segments, "loops": {"foot": loop}, "actuators": motor}


def ask(robot, kind="ellipsoids", **keys):
    return so.solve(so.problem({"type": kind, "robot": robot, "discretisation": False, **keys})).require()


def axes(result, kind, part="translation"):
    return np.array(result[f"ellipsoid.{kind}.{part}.axes"])


def motion(robot, on, keys, changed):
    """Displacement and turn [6] (turn first, world axes) of the end of `on` between two answers, by differences."""
    plus, minus = (ask(robot, "statics", **{**keys, **changed(sign)}) for sign in (1, -1))
    pose = plus.question.robot.functions().pose(on).function
    g, h = (np.array(pose(result.arrays["q"])) for result in (plus, minus))
    R = (g[:3, :3] - h[:3, :3]) @ (g[:3, :3] + h[:3, :3]).T / 2  # skew but for second order
    turn = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return np.concatenate([turn, g[:3, 3] - h[:3, 3]]) / 2


# Closed forms


def test_the_rigid_arm_has_the_textbook_ellipsoids():
    """Yoshikawa: semi-axes are the singular values of J, their product l1 l2 |sin q2|; those of force are inverse."""
    result = ask(two_turns(), on="lower")
    values = np.linalg.svd(SLOPES, compute_uv=False)
    np.testing.assert_allclose(axes(result, "kinematic"), [*values, 0], atol=1e-14)
    assert np.prod(axes(result, "kinematic")[:2]) == pytest.approx(L1 * L2 * np.sin(0.9), rel=1e-12)
    np.testing.assert_allclose(axes(result, "force"), [np.inf, 1 / values[1], 1 / values[0]], rtol=1e-12)
    np.testing.assert_allclose(result["ellipsoid.force.translation.directions"][0], [0, 0, 1], atol=1e-12)
    for kind, M in (("kinematic", SLOPES @ SLOPES.T), ("force", np.linalg.inv(SLOPES @ SLOPES.T))):
        np.testing.assert_allclose(result.arrays[f"ellipsoid.{kind}.translation"][:2, :2], M, rtol=1e-12)
    np.testing.assert_allclose(axes(result, "kinematic", "rotation"), [np.sqrt(2), 0, 0], atol=1e-14)
    assert result.values["ellipsoid.kinematic.translation.axes"].unit == "m/rad"


def test_joint_springs_give_way_through_the_slopes_of_the_arm():
    """C = J diag(1/k) J^T; of motors that are limited to 1 N m, J diag(1/k)^2 J^T."""
    result, S = ask(two_turns(), on="lower"), SLOPES / SPRINGS
    np.testing.assert_allclose(result.arrays["ellipsoid.compliance.translation"][:2, :2], S @ SLOPES.T, rtol=1e-12)
    np.testing.assert_allclose(result.arrays["ellipsoid.actuation.translation"][:2, :2], S @ S.T, rtol=1e-12)
    turns = result.arrays["ellipsoid.compliance.rotation"]
    np.testing.assert_allclose(turns, np.diag([0, 0, sum(1 / k for k in SPRINGS)]), atol=1e-14)


def test_a_stretched_arm_carries_what_pulls_along_it():
    found = so.ellipsoids(so.robot(two_turns(rest=(0, 0))), [0.0, 0.0])["force"]["translation"]
    assert np.isinf(found.axes).tolist() == [True, True, False]
    assert found.axes[2] == pytest.approx(1 / np.hypot(L1 + L2, L2), rel=1e-12)
    np.testing.assert_allclose(found.directions[:, 2], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("modulus", [1e7, 1e11])
def test_soft_links_add_their_bending_and_stretching_to_the_rigid_arm(modulus):
    """C - J diag(1/k) J^T = sum of w w^T l/(E J) + t t^T l/(E A) over sections along t, w across the way to the tip:
    in the rigid limit nothing."""
    robot, soft, place = two_turns(), np.zeros((2, 2)), np.zeros(2)
    tip = L1 * direction(0.4) + L2 * direction(1.3)
    for name, length in (("upper", L1), ("lower", L2)):
        robot["segments"][name]["tip"] = {"position": [0, 0, 0]}
        material = {**ROD["material"], "young_modulus": modulus}
        robot["segments"][f"{name}_rod"] = {**ROD, "parent": name, "length": length, "material": material}
    robot["segments"]["lower"]["parent"] = "upper_rod"
    robot["segments"] = {name: robot["segments"][name] for name in ("upper", "upper_rod", "lower", "lower_rod")}
    for length, turn in ((L1, 0.4), (L2, 1.3)):
        t = direction(turn)
        for X in (0.25, 0.75):
            w = np.array([[0, -1], [1, 0]]) @ (tip - place - X * length * t)
            soft += length / 2 / modulus * (np.outer(w, w) / (np.pi * 1e-8 / 4) + np.outer(t, t) / (np.pi * 1e-4))
        place = place + length * t
    C = ask(robot, on="lower_rod", kinds=["compliance"]).arrays["ellipsoid.compliance.translation"][:2, :2]
    np.testing.assert_allclose(C, (SLOPES / SPRINGS) @ SLOPES.T + soft, rtol=1e-10)
    assert (np.max(soft) < 1e-3 * np.max(C)) == (modulus > 1e10)


def direction(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def test_the_coupler_of_a_parallelogram_moves_on_a_circle_without_turning():
    """q = (t, -t, t): a unit of q is t = 1/sqrt(3); all springs give way together, l^2/1 N m across the crank."""
    result = ask(parallelogram(), on="coupler")
    np.testing.assert_allclose(axes(result, "kinematic"), [0.2 / np.sqrt(3), 0, 0], atol=1e-12)
    np.testing.assert_allclose(axes(result, "kinematic", "rotation"), 0, atol=1e-12)
    across = np.array([-np.sin(0.5), np.cos(0.5), 0])
    C = 0.04 * np.outer(across, across)
    np.testing.assert_allclose(result.arrays["ellipsoid.compliance.translation"], C, atol=1e-10)
    np.testing.assert_allclose(result.arrays["ellipsoid.actuation.translation"], 4 * C, atol=1e-10)


def test_symbols_give_what_numbers_give():
    rng = np.random.default_rng(3)
    J, K, H, Z = (rng.standard_normal(shape) for shape in ((6, 5), (5, 5), (5, 2), (5, 4)))
    K, Z = K @ K.T + np.eye(5), np.linalg.qr(Z)[0]
    s = [ca.SX.sym(name, *x.shape) for name, x in zip("JKHZ", (J, K, H, Z), strict=True)]
    made = [formulas.kinematic(s[0], s[3]), formulas.compliance(s[0], s[1], s[3]), formulas.actuation(*s)]
    made.append(formulas.force(formulas.block(made[0], "rotation")))
    found = [np.array(x) for x in ca.Function("f", s, made)(J, K, H, Z)]
    S = Z @ np.linalg.inv(Z.T @ K @ Z) @ Z.T
    wanted = [J @ Z @ Z.T @ J.T, J @ S @ J.T, J @ S @ H @ H.T @ S @ J.T, np.linalg.inv((J @ Z @ Z.T @ J.T)[:3, :3])]
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


def bridge():
    """Two rods that stand 0.2 m apart and turn out of one plane, their ends joined by a ball; a cable bends one."""
    rods = {
        name: {**ROD, "sections": 1, "strains": "kirchhoff_love",
               "placement": {"position": [x, 0, 0], "rotation": [0, -1.2 if x == 0 else -1.9, 0]}}
        for name, x in (("left", 0.0), ("right", 0.2))
    }  # fmt: skip
    ball = {"type": "spherical", "a": {"segment": "left"}, "b": {"segment": "right"}}
    cable = {"type": "tendon", "along": ["left"], "offset": [6e-3, 4e-3], "limits": [0, 2]}
    return {"gravity": [0, 3, -5], "segments": rods, "actuators": {"c0": cable}, "loops": {"ball": ball}}


# Statics solved again

CABLES = {"c0": 0.3, "c1": 0.1, "c2": 0.2}
RESTS = {  # name: (robot, place, further keys)
    "weight and cables": (arm, "arm", {"inputs": CABLES}),
    "dead load": (arm, "arm", {"inputs": CABLES, "loads": FORCE}),
    "follower load": (arm, "arm", {"inputs": CABLES, "loads": FOLLOWER}),
    "held length": (arm, "arm", {"lengths": {"c0": 0.22}, "inputs": {"c1": 0.1}, "loads": FOLLOWER}),
    "slack cable": (arm, "arm", {"lengths": {"c0": 0.22, "c1": 0.3}}),
    "stretching cable": (lambda: arm(stiffness=20), "arm", {"lengths": {"c0": 0.22}}),
    "locked joint": (two_turns, "lower", {"coordinates": {"upper": 0.7}}),
    "rubbing cable": (lambda: arm(friction=0.3), "arm", {"lengths": {"c0": 0.22}}),
    "strained loop": (lambda: parallelogram((1.0, 0.5, 0.3), (0.9, 0.2, 0.1), ground=0.25), "coupler",
                      {"guess": {"coordinates": {"crank": 0.8, "coupler": -0.6, "rocker": 0.8}}}),
    "loop in space": (bridge, "right", {"inputs": {"c0": 0.5}, "guess": {"coordinates": {"left.0.bend_y": 0.01}},
                                        "loads": {"side": {"type": "wrench", "on": "left", "force": [0, 0.02, 0]}}}),
    "length held in a loop": (bridge, "left", {"lengths": {"c0": 0.23},
                                               "guess": {"coordinates": {"left.0.bend_y": 0.01}}}),
}


@cache
def rest(name):
    robot, on, keys = RESTS[name]
    return ask(robot(), on=on, **keys)


@pytest.mark.parametrize("name", RESTS)
def test_the_compliance_is_how_far_statics_moves_under_a_small_wrench(name):
    robot, on, keys = RESTS[name]
    e = np.array([1, 2, -2]) / 3
    for part, key, own in (("translation", "force", slice(3, 6)), ("rotation", "moment", slice(0, 3))):
        C = rest(name).arrays[f"ellipsoid.compliance.{part}"]
        step = 2e-4 / max(np.max(np.abs(C)) / (0.25 if part == "translation" else 1.0), 0.2)

        def push(sign, key=key, step=step):
            probe = {"type": "wrench", "on": on, key: (sign * step * e).tolist()}
            return {"loads": {**keys.get("loads", {}), "probe": probe}}

        moved = motion(robot(), on, keys, push)[own] / step
        np.testing.assert_allclose(C @ e, moved, atol=1e-5 * np.max(np.abs(C)) + 1e-9)


@pytest.mark.parametrize("name", ["dead load", "follower load", "strained loop", "loop in space"])
def test_the_actuation_is_how_far_statics_moves_for_changed_inputs(name):
    robot, on, keys = RESTS[name]
    result, columns = rest(name), []
    known = result.question.robot
    for i, (input_name, (_, size)) in enumerate(zip(known.inputs, known.input_limits, strict=True)):

        def push(sign, i=i, input_name=input_name, size=size):
            return {"inputs": {**keys.get("inputs", {}), input_name: result.arrays["u"][i] + sign * 1e-4 * size}}

        columns.append(motion(robot(), on, keys, push) / 1e-4)
    for part, own in (("translation", slice(3, 6)), ("rotation", slice(0, 3))):
        F, M = np.column_stack(columns)[own], result.arrays[f"ellipsoid.actuation.{part}"]
        np.testing.assert_allclose(M, F @ F.T, atol=1e-5 * np.max(np.abs(M)) + 1e-15)


def test_a_follower_load_makes_the_compliance_unsymmetric_and_dead_loads_do_not():
    for name, apart in (("dead load", False), ("follower load", True)):
        C = rest(name).arrays["ellipsoid.compliance.translation"]
        assert (np.max(np.abs(C - C.T)) > 1e-4 * np.max(np.abs(C))) == apart


# What is asked, and told


def test_the_function_for_any_posture_gives_what_the_problem_gives():
    result = rest("dead load")
    found = so.ellipsoids(result.question.loaded, result.arrays["q"], result.arrays["u"])
    assert list(found) == list(KINDS)
    for kind, parts in found.items():
        for part, one in parts.items():
            np.testing.assert_allclose(one.matrix, result.arrays[f"ellipsoid.{kind}.{part}"], rtol=1e-12)


def test_what_a_robot_has_not_is_told_and_refused_when_asked_for():
    result = rest("held length")
    assert result.details["ellipsoids"]["notes"] == {"actuation": "c0 is held by length, not driven"}
    loose = so.robot(two_turns(stiffness=(0, 0)))
    assert set(so.ellipsoids(loose, TURNS)) == {"kinematic", "force"}
    with pytest.raises(ValueError, match="nothing holds"):
        so.ellipsoids(loose, TURNS, kinds=["compliance"])
    with pytest.raises(ValueError, match="no kind of ellipsoid"):
        so.ellipsoids(loose, TURNS, kinds=["dynamic"])


REFUSED = {
    "unknown segment": ({"on": "hand"}, "on: .*hand"),
    "kind twice": ({"kinds": ["force", "force"]}, "kinds: .*each once"),
    "no kind": ({"kinds": []}, "kinds: .*each once"),
    "unknown kind": ({"kinds": ["dynamic"]}, "kinds.0"),
    "held": ({"lengths": {"c0": 0.2}, "kinds": ["actuation"]}, "kinds: .*c0 is held by length"),
    "between sections": ({"at": 1.5}, "at: "),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_question_that_cannot_be_meant_is_refused(name):
    keys, sentence = REFUSED[name]
    with pytest.raises(FileError, match=sentence):
        so.problem({"type": "ellipsoids", "robot": arm(), "on": "arm", **keys})


def test_inputs_without_limits_have_no_size():
    robot = two_turns()
    del robot["actuators"]["at_lower"]["limits"]
    with pytest.raises(FileError, match="'at_lower' has no limits"):
        so.problem({"type": "ellipsoids", "robot": robot, "on": "lower", "kinds": ["actuation"]})
    bounded = ask(robot, on="lower", bounds={"inputs": {"at_lower": [-1, 0.5]}})
    np.testing.assert_allclose(axes(bounded, "actuation"), axes(ask(two_turns(), on="lower"), "actuation"), rtol=1e-12)


def test_a_solver_in_c_is_of_statics_alone(tmp_path):
    question = so.problem({"type": "ellipsoids", "robot": arm(), "on": "arm"})
    with pytest.raises(ValueError, match="'ellipsoids' has no solver in C"):
        so.codegen(question, tmp_path / "code")


ASKED = """\
type: ellipsoids
robot: arm.yaml
on: lower
"""


def test_the_report_prints_and_draws_them_from_a_stored_result_too(tmp_path, capsys, monkeypatch):
    from ruamel.yaml import YAML

    from socontrol.cli import run

    monkeypatch.chdir(tmp_path)
    YAML().dump(two_turns(), tmp_path / "arm.yaml")
    (tmp_path / "reach.yaml").write_text(ASKED)
    assert run(["solve", "reach.yaml"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    sizes = np.linalg.svd(SLOPES, compute_uv=False) * 1e3 * np.pi / 180
    told = next(row for row in rows if row[:2] == ["kinematic", "translation"])
    assert [float(x) for x in told[2:5]] == pytest.approx([*sizes, 0], rel=1e-3) and told[5] == "mm/deg"
    assert next(row for row in rows if row[:2] == ["force", "translation"])[2] == "rigid"
    stored = so.load_result(tmp_path / "results" / "reach")
    drawn = [texts(result) for result in (stored, so.solve(so.load_problem(tmp_path / "reach.yaml")))]
    assert drawn[0] == drawn[1] and any("dotted: rigid" in text for text in drawn[0])
    assert (tmp_path / "results" / "reach" / "robot.png").exists()


@pytest.mark.parametrize("share", [0.02, 0.5])
def test_motions_that_no_slope_tells_are_called_an_extrapolation(share):
    """Motors that turn their springs by half a radian, and by a twenty-fifth of that."""
    limits = {f"at_{name}": [-share * k, share * k] for name, k in zip(("upper", "lower"), SPRINGS, strict=True)}
    result = ask(two_turns(), on="lower", bounds={"inputs": limits}, kinds=["actuation"])
    turned = axes(result, "actuation", "rotation")[0]
    assert turned == pytest.approx(share * np.sqrt(2), rel=1e-9)
    told = f"{np.degrees(turned):.4g} deg from here along a straight line"
    assert (told in " ".join(words(result).split())) == (share == 0.5)


def texts(result):
    """Legend of a result's robot figure."""
    from socontrol.report.portrait import robot_figure

    figure = robot_figure(result)
    legends = [legend for part in (figure, *figure.subfigs) for legend in part.legends]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def test_an_ellipsoid_is_drawn_to_the_scale_its_legend_states():
    from socontrol.report import shapes
    from socontrol.report.ellipsoid_scene import add_ellipsoids
    from socontrol.report.scene import Scene

    result = ask(two_turns(), on="lower", kinds=["compliance"])
    scene, posed = Scene(up=np.array([0, 0, 1.0])), shapes.Posed(result.question.loaded, result.arrays["q"])
    ((_, text),) = add_ellipsoids(scene, result, posed, 1.0)
    C = result.arrays["ellipsoid.compliance.translation"]
    points = np.concatenate([stroke.points for stroke in scene.strokes]) - posed.place("lower")[:3, 3]
    farthest = np.max(np.linalg.norm(points, axis=1))
    number, unit, *_ = text.removeprefix("compliance: ").split()
    one = {"mm/N": 1e-3, "m/N": 1.0, "mm/mN": 1.0}[unit]
    assert float(number) * one == pytest.approx(np.linalg.norm(C, 2), rel=1e-2)
    assert text.endswith(f"drawn as {1e3 * farthest:.2g} mm")
