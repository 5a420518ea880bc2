"""Tensions of motions: inverse dynamics within limits, and the robot simulated again under what was found."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

import socontrol as so
from socontrol import cli
from socontrol.programs.tensions.tension_fit import bounded
from socontrol.programs.tensions.timed_way import Curve
from socontrol.quantities import Bad

ROOT = Path(__file__).parent.parent
LENGTH, RADIUS, OFFSET, YOUNG = 0.3, 0.01, 0.008, 1e6
BENDING = YOUNG * np.pi * RADIUS**4 / 4  # E I [N m^2]
BEAM = {  # one bend in a plane, two cables against each other
    "name": "beam",
    "gravity": [0, 0, 0],
    "segments": {
        "beam": {
            "type": "rod", "length": LENGTH, "strains": ["bend_z"],
            "cross_section": {"type": "circle", "radius": RADIUS},
            "material": {"type": "linear", "young_modulus": YOUNG, "poisson_ratio": 0.5, "density": 1000,
                         "viscosity": 2000},
        },
    },
    "actuators": {
        "left": {"type": "tendon", "along": ["beam"], "offset": [OFFSET, 0], "limits": [0, 20]},
        "right": {"type": "tendon", "along": ["beam"], "offset": [-OFFSET, 0], "limits": [0, 20]},
    },
}  # fmt: skip
BEND = "beam.0.bend_z"
PENDULUM = {  # a point of 0.5 kg, 0.4 m below its joint, with a motor
    "name": "pendulum",
    "segments": {
        "link": {"type": "revolute", "axis": [0, -1, 0], "tip": {"position": [0, 0, -0.4]},
                 "body": {"mass": 0.5, "com": [0, 0, -0.4], "inertia": [0, 0, 0]}},
    },
    "actuators": {"motor": {"type": "joint_torque", "joint": "link", "limits": [-5, 5]}},
}  # fmt: skip
SWEEP = {"type": "sinusoid", "amplitude": 1.5, "mean": 0.5, "period": 2.0, "phase": 0.3}


def motion(robot, coordinates, *, every=0.02, duration=1.0, tolerance=0.01, simulate=True, **more):
    """Result of a motion given by its coordinates; `more`: further keys of the problem."""
    own = {"every": every, "duration": duration, "tolerance": tolerance, "simulate": simulate}
    own["coordinates"] = coordinates
    return so.solve(so.problem({"type": "tensions", "robot": robot, "motion": own, **more}))


# Least squares within limits

def least_by_enumeration(R, c, lower, upper):
    """The best of all ways to put each unknown on its lower limit, its upper limit, or neither."""
    best, least = None, np.inf
    for sides in itertools.product((-1, 0, 1), repeat=c.size):
        sides = np.array(sides)
        x = np.where(sides < 0, lower, np.where(sides > 0, upper, 0.0))
        if not np.all(np.isfinite(x)):
            continue
        own = sides == 0
        if own.any():
            x[own] = np.linalg.lstsq(R[:, own], c - R[:, ~own] @ x[~own], rcond=None)[0]
        cost = np.sum((R @ x - c) ** 2)
        if np.all(x >= lower - 1e-12) and np.all(x <= upper + 1e-12) and cost < least:
            best, least = x, cost
    return best


@pytest.mark.parametrize("seed", range(40))
def test_least_squares_within_limits_are_the_best_of_all_active_sets(seed):
    rng = np.random.default_rng(seed)
    m = 1 + seed % 5
    R, c = rng.standard_normal((m, m)) * 10.0 ** rng.uniform(-2, 0, (m, 1)), rng.standard_normal(m)
    lower = np.where(rng.random(m) < 0.3, -np.inf, -rng.random(m))
    upper = np.where(rng.random(m) < 0.3, np.inf, rng.random(m))
    upper[rng.random(m) < 0.1] = 0.0
    lower[upper == 0] = 0.0
    wanted = least_by_enumeration(R, c, lower, upper)
    for start in (np.zeros(m), rng.standard_normal(m)):
        np.testing.assert_allclose(bounded(R, c, lower, upper, start), wanted, atol=1e-9, rtol=1e-9)


# Robots with as many inputs as coordinates

def test_a_motor_gives_what_newton_asks_of_a_pendulum():
    """And under straight lines between samples, T'' h^2 / 12 too flat on average, it goes off with the square of h."""
    off = []
    for every in (0.01, 0.005):
        result = motion(PENDULUM, {"link": SWEEP}, every=every, tolerance=1e-3).require()
        t = result.arrays["t"]
        angle, rate = np.pi * t + 0.3, np.pi
        q, qdd = 0.5 + 1.5 * np.sin(angle), -1.5 * rate**2 * np.sin(angle)
        torque = 0.5 * (0.4**2 * qdd + 9.81 * 0.4 * np.sin(q))
        np.testing.assert_allclose(result.arrays["q"][:, 0], q, atol=1e-12)
        np.testing.assert_allclose(result.arrays["u"][:, 0], torque, atol=1e-8)
        np.testing.assert_allclose(result.arrays["unmet"], 0, atol=1e-8)
        off.append(result["replay.tip"])
    assert 3.8 < off[0] / off[1] < 4.2 and off[1] < 5e-5


@pytest.mark.parametrize("bend", [3.0, -3.0])
def test_a_robot_that_stays_needs_the_tensions_of_its_posture(bend):
    """A cable at the distance d bends a beam by T d / (E I), to its own side: to +y by a bend about z."""
    result = motion(BEAM, {BEND: bend}, duration=0.2).require()
    tension = BENDING * abs(bend) / OFFSET
    wanted = [tension, 0] if bend > 0 else [0, tension]
    np.testing.assert_allclose(result.arrays["u"], [wanted] * len(result.arrays["t"]), atol=1e-7)
    assert result["replay.tip_share"] < 1e-6


def test_a_given_tension_is_held_and_balanced_by_the_others():
    result = motion(BEAM, {BEND: 3.0}, duration=0.2, inputs={"right": 1.5}).require()
    wanted = [BENDING * 3 / OFFSET + 1.5, 1.5]
    np.testing.assert_allclose(result.arrays["u"], [wanted] * len(result.arrays["t"]), atol=1e-7)


def test_friction_asks_for_more_where_a_cable_is_wound_in_and_for_less_where_it_is_let_out():
    """The tension T exp(-m s bend) along a beam bends it as its mean does; m = mu (l' < 0: 1, l' > 0: -1, smoothed)."""
    swing = {"type": "sinusoid", "amplitude": 6, "mean": 8, "period": 2, "phase": -np.pi / 2}
    rough = {key: {**cable, "friction": 0.2} for key, cable in BEAM["actuators"].items()}
    free, rubbed = (motion({**BEAM, "actuators": own}, {BEND: swing}, every=0.05, simulate=False, duration=2.0)
                    for own in (BEAM["actuators"], rough))  # fmt: skip
    q, qd = (rubbed.arrays[key][:, 0] for key in ("q", "qd"))
    rate = -OFFSET * LENGTH * qd  # of the length of the cable that pulls
    turn = 0.2 * -rate / np.hypot(rate, 1e-3) * q * LENGTH
    more = np.where(np.abs(turn) > 1e-9, turn / -np.expm1(-turn + (turn == 0)), 1.0)
    np.testing.assert_allclose(rubbed.arrays["u"][:, 0], free.arrays["u"][:, 0] * more, rtol=1e-6, atol=1e-7)
    assert np.ptp(more) > 0.5


def test_the_simulation_is_that_of_a_simulation_file():
    """Gauss steps under a table of the tensions end where the tensions' own simulation does."""
    swing = {"type": "sinusoid", "amplitude": 4, "period": 0.8, "phase": -np.pi / 2}
    result = motion(BEAM, {BEND: swing}, duration=0.8, tolerance=3e-4).require()
    t, first = result.arrays["t"], float(result.arrays["q"][0, 0])
    inputs = {name: {"type": "table", "times": t.tolist(), "values": u.tolist()}
              for name, u in zip(result.question.robot.inputs, result.arrays["u"].T, strict=True)}  # fmt: skip
    moved = so.solve(so.problem({"type": "simulation", "robot": BEAM, "times": t[1:].tolist(), "inputs": inputs,
                                 "start": {"coordinates": {BEND: first}},
                                 "solver": {"type": "gauss", "step": 0.005}})).require()  # fmt: skip
    gap = np.abs(moved.arrays["beam.position"] - result.arrays["replay.beam.position"])
    assert np.max(gap) < 1e-5 * LENGTH
    assert np.ptp(result.arrays["replay.q"]) > 7, "it swings"


# Limits

SWAY = {"type": "sinusoid", "amplitude": 10, "period": 20, "phase": 0.0}  # slow: statics


def test_a_limit_in_the_way_is_named_with_what_would_be_needed_and_when():
    """The most a bend of 10 / m takes is E I 10 / d at a quarter of the period; the limit is half of that."""
    most = BENDING * 10 / OFFSET
    bounds = {"inputs": {"left": [0, most / 2]}}
    result = motion(BEAM, {BEND: SWAY}, every=0.1, duration=10, bounds=bounds)
    assert result.status.outcome == "infeasible", result.status.message
    found = re.search(r"left would need ([\d.]+) N at t = ([\d.]+) s, its limit is ([\d.]+) N", result.status.message)
    needed, when, limit = map(float, found.groups())
    assert needed == pytest.approx(most, rel=5e-3) and when == pytest.approx(5, abs=0.2)
    assert limit == pytest.approx(most / 2, rel=5e-3)
    u = result.arrays["u"]
    assert u.min() >= 0 and u[:, 0].max() <= most / 2 and np.sum(u[:, 0] == most / 2) > 10


def test_a_single_cable_cannot_push():
    single = {**BEAM, "actuators": {"left": BEAM["actuators"]["left"]}}
    result = motion(single, {BEND: {**SWAY, "amplitude": -10}}, every=0.1, duration=10)
    assert result.status.outcome == "infeasible"
    assert re.search(r"left is slack at t = [\d.]+ s and would have to push with [\d.]+ N", result.status.message)


def test_a_motion_that_inputs_cannot_hold_is_not_called_solved():
    """A beam that bends both ways, its cables in one plane only: the other bend is not to be had."""
    both = {**BEAM, "segments": {"beam": {**BEAM["segments"]["beam"], "strains": ["bend_y", "bend_z"]}}}
    result = motion(both, {"beam.0.bend_y": {**SWAY, "amplitude": 5}}, every=0.1, duration=10)
    assert result.status.outcome == "rejected" and "No inputs give 1 of the largest force" in result.status.message
    assert result["replay.tip_share"] > 0.5 and result["motion.unmet"] == pytest.approx(1, abs=1e-6)


# Symmetry

ARM = "configs/robots/octopus_arm_water_coarse.yaml"


def test_mirrored_motions_take_mirrored_tensions():
    """c0 stands on top, c1 and c2 mirror each other across the vertical plane."""
    found = []
    for side in (1, -1):
        bends = {"arm.0.bend_y": 1.36, "arm.1.bend_y": 0.65, "arm.2.bend_y": -3}
        for k, size in enumerate((1.57, 6.53, 37.5)):
            bends[f"arm.{k}.bend_z"] = {"type": "ramp", "to": side * size, "start": 0.1, "stop": 2}
        loads = {"water": {"type": "fluid", "density": 1022}}
        found.append(motion(str(ROOT / ARM), bends, every=0.1, duration=2.5, simulate=False, loads=loads).arrays["u"])
    np.testing.assert_allclose(found[0][:, [0, 2, 1]], found[1], atol=1e-8)
    assert np.ptp(found[0][:, 2]) > 0.05 and found[0].min() >= 0


# Paths in time

LINKS = {  # a slide, two links across it, a motor each
    "name": "links",
    "gravity": [0, 0, 0],
    "segments": {
        "slide": {"type": "prismatic", "axis": [0, 0, 1], "stiffness": 100, "damping": 2,
                  "body": {"mass": 0.2, "com": [0, 0, 0], "inertia": [0, 0, 0]}},
        "upper": {"type": "revolute", "parent": "slide", "axis": [0, 0, 1], "stiffness": 5, "damping": 0.1,
                  "tip": {"position": [0.3, 0, 0]},
                  "body": {"mass": 0.3, "com": [0.15, 0, 0], "inertia": [0, 0.01, 0.01]}},
        "lower": {"type": "revolute", "parent": "upper", "axis": [0, 0, 1], "stiffness": 5, "damping": 0.1,
                  "tip": {"position": [0.2, 0, 0]},
                  "body": {"mass": 0.2, "com": [0.1, 0, 0], "inertia": [0, 0.01, 0.01]}},
    },
    "actuators": {name: {"type": "joint_torque", "joint": name, "limits": [-50, 50]}
                  for name in ("slide", "upper", "lower")},
}  # fmt: skip
ROUND = {"type": "path", "on": "lower", "target": {"center": [0.32, 0.1, 0], "radius": 0.05, "count": 24}}
RUN = {"type": "tensions", "robot": LINKS, "goals": {"tip": ROUND}, "timing": {"duration": 2, "ramp": 0.5},
       "guess": {"coordinates": {"upper": -0.3, "lower": 1.0}},
       "motion": {"every": 0.01, "tolerance": 1e-3}}  # fmt: skip


def test_a_path_is_run_through_at_constant_speed_between_the_ramps_and_met():
    result = so.solve(so.problem(RUN)).require()
    t, a, timing = result.arrays["t"], result.arrays, result.question.timing
    speed = 2 * np.pi * 0.05 / (2 - 0.5)
    rates = np.linalg.norm(np.gradient(a["lower.position"], t, axis=0), axis=1)
    np.testing.assert_allclose(rates[(t > 0.52) & (t < 1.48)], speed, rtol=2e-3)
    angle = 2 * np.pi * timing.share(t)[0]
    circle = np.array([0.32, 0.1, 0]) + 0.05 * np.column_stack([np.cos(angle), np.sin(angle), 0 * t])
    np.testing.assert_allclose(a["target"], circle, atol=2e-5)
    np.testing.assert_allclose(a["lower.position"], a["target"], atol=1e-7)
    np.testing.assert_allclose(a["qd"][[0, -1]], 0, atol=1e-7)
    np.testing.assert_allclose(a["u"][0], a["path.u"][0], atol=1e-6)
    np.testing.assert_allclose(np.gradient(a["q"], t, axis=0)[2:-2], a["qd"][2:-2], atol=3e-3 * np.max(np.abs(a["qd"])))
    assert result["replay.path"] < 1e-4 * 0.5 and result["motion.unmet"] < 1e-6
    fastest = np.max(np.abs(np.diff(a["u"], axis=0)), axis=0) / 0.01
    found = [result[f"rates.{name}"] for name in result.question.robot.inputs]
    np.testing.assert_allclose(found, fastest, rtol=1e-9)


def test_a_path_too_fast_for_the_rates_of_its_inputs_says_so():
    """Links with hardly a spring: at rest the torques hardly change, in motion masses ask for all of it."""
    loose = {**LINKS, "segments": {name: {**own, "stiffness": own["stiffness"] / 100}
                                   for name, own in LINKS["segments"].items()}}  # fmt: skip
    asked = {**RUN, "robot": loose, "motion": {"every": 0.02, "simulate": False}}
    free = so.solve(so.problem(asked)).require()
    still = np.max(np.abs(np.diff(free.arrays["path.u"], axis=0) / np.diff(free.arrays["path.t"])[:, None]))
    fastest = free["rates.upper"]
    assert 2 * still < fastest
    held = so.solve(so.problem({**asked, "limits": {"input_rates": {"upper": fastest / 2}}}))
    assert held.status.outcome == "infeasible" and "upper would need" in held.status.message
    assert so.solve(so.problem({**asked, "limits": {"input_rates": {"upper": fastest * 1.01}}})).status.solved


STROKE = {  # a small circle across a soft arm, slow in the water: at rest its tensions are smooth
    "type": "tensions", "robot": str(ROOT / ARM), "loads": {"water": {"type": "fluid", "density": 1022}},
    "goals": {"tip": {"type": "path", "on": "arm", "axes": ["y", "z"],
                      "target": {"center": [0.2, 0, 0.03], "radius": 0.01, "normal": [1, 0, 0], "start": [0, 1, 0],
                                 "count": 24}}},
    "timing": {"duration": 8}, "motion": {"every": 0.05, "tolerance": 0.02},
}  # fmt: skip


def rates(t, u):
    """Largest rates [m] of inputs u [K x m] at times t [K]."""
    return np.max(np.abs(np.diff(u, axis=0) / np.diff(t)[:, None]), axis=0)


@pytest.mark.parametrize("every", [0.05, 0.02])
def test_a_slow_motion_takes_tensions_as_calm_as_those_at_rest(every):
    asked = {**STROKE, "motion": {"every": every, "tolerance": 0.02, "simulate": False}}
    a = so.solve(so.problem(asked)).require().arrays
    still = rates(a["path.t"], a["path.u"])
    assert np.all(rates(a["t"], a["u"]) < 3 * np.max(still)), (rates(a["t"], a["u"]), still)
    at_rest = np.column_stack([np.interp(a["t"], a["path.t"], u) for u in a["path.u"].T])
    np.testing.assert_allclose(a["u"], at_rest, atol=0.2 * np.max(at_rest))


def test_rates_of_inputs_hold_from_sample_to_sample():
    """Limits a tenth above what the waypoints take at rest, below what the same motion takes without them."""
    quick = {**STROKE, "timing": {"duration": 4}, "motion": {"every": 0.02, "tolerance": 0.05, "simulate": False}}
    free = so.solve(so.problem(quick)).require()
    still = rates(free.arrays["path.t"], free.arrays["path.u"])
    limits = {"input_rates": dict(zip(free.question.robot.inputs, (1.1 * still).tolist(), strict=True))}
    held = so.solve(so.problem({**quick, "limits": limits})).require()
    assert np.all(rates(held.arrays["t"], held.arrays["u"]) <= 1.1 * still * (1 + 1e-9))
    assert np.any(rates(free.arrays["t"], free.arrays["u"]) > 1.2 * still), "without limits it is faster"


def test_a_motion_beyond_its_tolerance_is_not_solved_and_says_what_to_raise():
    swing = {"type": "sinusoid", "amplitude": 4, "period": 0.8, "phase": -np.pi / 2}
    off = motion(BEAM, {BEND: swing}, duration=0.8).require()["replay.tip_share"]
    status = motion(BEAM, {BEND: swing}, duration=0.8, tolerance=off / 2).status
    assert status.outcome == "rejected" and status.exit_code == 7
    assert "raise `motion.tolerance` if that is good enough, or ask for a slower motion" in status.message


@pytest.mark.parametrize("count", [4, 5, 12])
def test_a_closed_curve_knows_no_beginning(count):
    """A spline through a circle's points: the same from any of them on, and near the circle by the fourth order."""
    turn = 2 * np.pi * np.arange(count + 1) / count
    rows = [np.column_stack([np.cos(turn + shift), np.sin(turn + shift)]) for shift in (0, turn[1])]
    x = np.linspace(0, 1, 50)
    curves = [Curve(np.linspace(0, 1, count + 1), own, closed=True)(x) for own in rows]
    R = np.array([[np.cos(turn[1]), -np.sin(turn[1])], [np.sin(turn[1]), np.cos(turn[1])]])
    for first, second in zip(*curves, strict=True):
        np.testing.assert_allclose(first @ R.T, second, atol=1e-6 * np.max(np.abs(first)))
    angle = 2 * np.pi * x
    assert np.max(np.abs(curves[0][0] - np.column_stack([np.cos(angle), np.sin(angle)]))) < 1.2 * turn[1] ** 4 / 100
    np.testing.assert_allclose(curves[0][1][0], curves[0][1][-1], atol=1e-5)


# Files and commands

PROBLEM = """schema_version: 1
type: tensions
robot: beam.yaml
motion: {every: 20 ms, file: way.csv}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a beam, a motion in a table, and the question of its tensions."""
    (tmp_path / "beam.yaml").write_text(json.dumps({"schema_version": 1, **BEAM}))  # YAML too
    t = np.linspace(0, 1, 41)
    rows = [f"{x:.6g},{4 * x**3 * (10 - 15 * x + 6 * x * x):.9g}" for x in t]
    (tmp_path / "way.csv").write_text("\n".join([f"t,{BEND}", *rows]) + "\n")
    (tmp_path / "turn.yaml").write_text(PROBLEM)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_motion_of_a_table_is_answered_and_its_result_is_a_motion_again(folder, capfd):
    assert cli.run(["solve", "turn.yaml", "--json", "--no-figures"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["values"]["replay.tip"]["value"] < 0.01 * LENGTH
    first = so.load_result("results/turn")
    assert first.details["kind"] == "motion" and first.arrays["t"][-1] == 1.0
    assert first.arrays["u"][-1] == pytest.approx([BENDING * 4 / OFFSET, 0], abs=0.02)
    assert cli.run(["solve", "turn.yaml", "-o", "again", "--no-figures", "--set", "motion.file=results/turn"]) == 0
    second = so.load_result("again/turn")
    np.testing.assert_allclose(second.arrays["q"], first.arrays["q"], atol=1e-8)
    assert cli.run(["solve", "results/turn/problem.resolved.yaml", "-o", "third", "--no-figures"]) == 0


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("{every: 0.1, coordinates: {beam.0.bend_z: 1}}", "motion.duration: missing key 'duration'"),
        ("{every: 0.1, duration: 1, coordinates: {beam.bend: 1}}", "motion.coordinates.beam.bend: the robot has"),
        ("{every: 0.1, coordinates: {beam.0.bend_z: [1, 2, 3, 4]}}", "motion.times: a list of coordinates is given"),
        ("{every: 0.1, times: [0, 1, 2], coordinates: {beam.0.bend_z: [1, 2]}}", "3 times and 2 values"),
        ("{every: 2, duration: 1, coordinates: {beam.0.bend_z: 1}}", "motion.every: 2 s is beyond the duration, 1 s"),
        ("{every: 1 us, duration: 1, coordinates: {beam.0.bend_z: 1}}", "motion.every: 1000000 samples; at most"),
        ("{every: 0.1, file: way.csv, times: [0, 1]}", "motion.times: the file gives the times"),
        ("{every: 0.1, file: gone.csv}", "motion.file: cannot read 'gone.csv'"),
        ("{every: 0.1, duration: 2, file: way.csv}", "motion.duration: 2 s is given, but the coordinates end at 1 s"),
        ("{every: 0.1}", "goals: no goal is given"),
    ],
)
def test_a_motion_that_makes_no_sense_is_refused_in_one_line(folder, capfd, line, sentence):
    (folder / "turn.yaml").write_text(PROBLEM.replace("{every: 20 ms, file: way.csv}", line))
    assert cli.run(["solve", "turn.yaml"]) == 3
    err = capfd.readouterr().err
    assert sentence in err and err.count("\n") == 1 and err.startswith("turn.yaml:"), err
    assert not (folder / "results").exists()


def test_a_motion_past_a_joint_limit_is_refused():
    segment = {**PENDULUM["segments"]["link"], "limits": [-1, 1]}
    with pytest.raises(Bad, match="at t = 0.02 s is outside the limits of the joint, ") as refused:
        motion({**PENDULUM, "segments": {"link": segment}}, {"link": SWEEP})
    assert refused.value.key == "motion.coordinates.link"


def test_what_is_done_when_the_user_stops_is_kept():
    def stop(done, total, sentence):
        if "t =" in sentence:
            raise KeyboardInterrupt

    asked = {"type": "tensions", "robot": BEAM, "motion": {"every": 0.02, "duration": 1, "coordinates": {BEND: SWAY}}}
    result = so.solve(so.problem(asked), progress=stop)
    assert result.status.exit_code == 130
    assert result.arrays["u"].shape == (51, 2) and "replay.q" not in result.arrays
