"""Paths of tensions: limits on rates of inputs and cable lengths, waypoints in order or in one program, friction.

The oracle is a robot of slides on springs, x = (f1 + f2) / k, whose least effort within rates is a quadratic program;
it is solved here as a least distance problem by non-negative least squares (C. Lawson, R. Hanson, "Solving Least
Squares Problems", 1974, ch. 23), which also tells when there is no answer.
"""

import json
import re
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.optimize import nnls

import socontrol as so
from socontrol import cli
from socontrol.programs.tensions.path_directions import STILL, directed

K, F = 100.0, 10.0  # N/m of each spring, N at most of each motor
CORNERS = [[0.01, 0.01, 0.05], [0.05, 0.01, 0.05], [0.05, 0.09, 0.05], [0.17, 0.09, 0.05]]  # x rises, rests, rises
SPACING, DURATION = 0.01, 2.4  # m, s: at constant speed 0.1 s from waypoint to waypoint
FORCES = K * np.concatenate([np.linspace(0.01, 0.05, 5), np.full(7, 0.05), np.linspace(0.05, 0.17, 13)])  # f1 + f2
DT = 0.1


def slides():
    """Two slides in a row along x, one along y and one along z, each on a spring with a motor that only pushes."""
    axes = {"a": [1, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0], "d": [0, 0, 1]}
    segments, motors, parent = {}, {}, "world"
    for i, (name, axis) in enumerate(axes.items()):
        segments[name] = {"type": "prismatic", "axis": axis, "stiffness": K, "parent": parent}
        motors[f"f{i + 1}"] = {"type": "joint_torque", "joint": name, "limits": ["0 N", f"{F} N"]}
        parent = name
    return {"schema_version": 1, "name": "slides", "gravity": [0, 0, 0], "segments": segments, "actuators": motors}


def push(**changes):
    """The slides along CORNERS."""
    target = {"corners": CORNERS, "spacing": SPACING, "closed": False}
    mapping = {"schema_version": 1, "type": "tensions", "robot": slides(), "discretisation": False,
               "goals": {"tip": {"type": "path", "on": "d", "target": target}},
               "timing": {"duration": DURATION, "ramp": 0}}  # fmt: skip
    return so.problem({**mapping, **changes})


def slow(rate, duration=DURATION, **changes):
    """`push` with a limit on the rate of f2 [N/s]."""
    timing = {"duration": duration, "ramp": 0}
    return push(limits={"input_rates": {"f2": rate}}, timing=timing, **changes)


def best(rate, dt=DT, smoothness=0.0):
    """f1 [K] of least effort and smoothest change with |f2'| <= rate; None where there is none.

    Least distance: of z = f1 and S = sum, |A z - b|^2 is least with G z >= h; A = Q R turns it into |w|^2.
    """
    S, count = FORCES, FORCES.size
    one, change = np.eye(count), np.diff(np.eye(count), axis=0)
    root = np.sqrt(smoothness)
    A = np.vstack([one, -one, root * change, -root * change])
    b = np.concatenate([0 * S, -S, 0 * S[1:], -root * np.diff(S)])
    G = np.vstack([one, -one, -one, one, -change, change])  # 0 <= f1 <= F, 0 <= S - f1 <= F, |change of S - f1|
    room = rate * dt
    h = np.concatenate([0 * S, -F + 0 * S, -S, S - F, -np.diff(S) - room, np.diff(S) - room])
    Q, R = np.linalg.qr(A)
    inverse, own = np.linalg.inv(R), Q.T @ b
    Gw = G @ inverse
    E = np.vstack([Gw.T, (h - Gw @ own)[None]])
    y, left = nnls(E, np.eye(count + 1)[-1], maxiter=10_000)
    if left < 1e-9:
        return None
    r = E @ y - np.eye(count + 1)[-1]
    return inverse @ (own - r[:-1] / r[-1])


def cost(u, smoothness=0.0):
    """Least-effort cost of tensions [K x m]."""
    return np.sum(u**2) / (2 * F**2) + smoothness * np.sum(np.diff(u, axis=0) ** 2) / (2 * F**2)


def greedy(rate):
    """f2 [K] of the slides in order, until no value is left: what f1 cannot, f2 has to, within its rate."""
    f2 = [FORCES[0] / 2]
    for S in FORCES[1:]:
        low, high = max(f2[-1] - rate * DT, S - F, 0.0), min(f2[-1] + rate * DT, S, F)
        if low > high:
            break
        f2.append(min(max(S / 2, low), high))
    return np.array(f2)


# In order and together, against quadratic programs


@pytest.mark.parametrize("smoothness", [0.0, 3.0])
def test_together_is_the_least_effort_within_the_rates(smoothness):
    f1 = best(2.6, smoothness=smoothness)
    result = slow(2.6, together=True, smoothness=smoothness).solve().require()
    np.testing.assert_allclose(result.arrays["path.u"][:, 0], f1, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.arrays["path.u"][:, 1], FORCES - f1, rtol=0, atol=1e-6)
    assert result["rates.f2"] == pytest.approx(2.6, abs=1e-7)
    np.testing.assert_allclose(result.arrays["path.t"], DT * np.arange(FORCES.size), atol=1e-9)


def test_in_order_each_waypoint_takes_the_least_effort_its_rate_allows():
    result = slow(4.1).solve().require()
    np.testing.assert_allclose(result.arrays["path.u"][:, 1], greedy(4.1), rtol=0, atol=1e-7)
    together = slow(4.1, together=True).solve().require()
    assert cost(together.arrays["path.u"]) < cost(result.arrays["path.u"]) - 1e-4  # it sees the second rise coming


def test_together_solves_what_in_order_runs_into():
    reached = greedy(2.6)
    stopped = slow(2.6).solve()
    assert stopped.status.outcome == "infeasible" and stopped.details["waypoints_solved"] == reached.size == 23
    np.testing.assert_allclose(stopped.arrays["path.u"][:, 1], reached, rtol=0, atol=1e-7)
    # f1 is at its 10 N, so all of 1 N in 0.1 s but what f1 has left is f2's; in order alone f2 rises by 5 N/s
    sentence = stopped.status.message
    needed = (FORCES[23] - F - reached[-1]) / DT
    assert sentence.startswith(f"Waypoint 24 of 25: f2 would need {needed:.4g} N/s, its limit is 2.6 N/s;")
    assert "a duration of 4.62 s would do" in sentence and "together" in sentence
    assert slow(2.6, duration=4.62).solve().status.solved
    assert slow(2.6, together=True).solve().status.solved


def test_where_no_way_is_fast_enough_the_shortest_duration_is_told():
    assert best(1.0) is None
    result = slow(1.0, together=True).solve()
    assert result.status.outcome == "infeasible"
    # f2 begins at no more than 1 N and has to be 7 N at the end: 6 N at 1 N/s
    assert best(1.0, dt=0.99 * 6 / 24) is None and best(1.0, dt=1.01 * 6 / 24) is not None
    told = float(re.search(r"a duration of ([\d.]+) s would do", result.status.message)[1])
    assert 6.0 <= told <= 6.06
    assert re.search(r"f2 would need 2\.5\d* N/s, its limit is 1 N/s", result.status.message)
    assert slow(1.0, duration=told, together=True).solve().status.solved
    assert slow(1.0, duration=0.99 * told, together=True).solve().status.outcome == "infeasible"


@pytest.mark.parametrize("together", [False, True])
def test_a_rate_of_length_counts_like_that_of_the_force_on_its_spring(together):
    rate = 2.6 if together else 4.1
    force = slow(rate, together=together).solve().require()
    length = push(limits={"length_rates": {"f2": rate / K}}, together=together).solve().require()
    np.testing.assert_allclose(length.arrays["path.u"], force.arrays["path.u"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(length.arrays["path.lengths"], length.arrays["path.q"], rtol=0, atol=1e-12)
    assert length["length_rates.f2"] == pytest.approx(rate / K, rel=1e-7)
    stopped = push(limits={"length_rates": {"f2": 0.02}}).solve()
    assert stopped.status.outcome == "infeasible" and "f2 would need" in stopped.status.message
    assert "mm/s, its limit is 20 mm/s" in stopped.status.message


def test_the_ways_of_a_pair_of_limits_are_told_apart():
    pair = push(limits={"input_rates": {"f2": [-0.5, 5.1]}}).solve().require()
    plain = push().solve().require()
    np.testing.assert_allclose(pair.arrays["path.u"], plain.arrays["path.u"], rtol=0, atol=1e-6)
    assert not push(limits={"input_rates": {"f2": [-5.1, 0.5]}}).solve().status.solved


def test_a_ramp_of_its_own_takes_more_than_the_share_of_the_duration():
    timing = {"duration": DURATION, "ramp": 1.0}
    stopped = push(limits={"input_rates": {"f2": 2.6}}, timing=timing).solve()
    told = float(re.search(r"a duration of ([\d.]+) s would do", stopped.status.message)[1])
    enough = push(timing={**timing, "duration": told}).solve().require()  # its least effort just meets the limit
    assert 0.99 * 2.6 <= enough["rates.f2"] <= 2.6


# Cables


def arm(sections=(0.5, 0.5), **friction):
    """The octopus arm in fewer sections, with friction by cable."""
    path = Path(__file__).parents[1] / "configs/robots/octopus_arm.yaml"
    robot = YAML(typ="safe").load(path.read_text())
    robot["segments"]["arm"]["sections"] = list(sections)
    for name, mu in friction.items():
        robot["actuators"][name]["friction"] = mu
    return robot


def eight(side=1, **changes):
    target = {"center": [0.19, 0, 0.1], "width": 0.1, "height": 0.04, "normal": [side, 0, 0], "start": [0, side, 0],
              "count": 8}  # fmt: skip
    goals = {"tip": {"type": "path", "on": "arm", "target": target}}
    mapping = {"schema_version": 1, "type": "tensions", "robot": arm(), "discretisation": False, "goals": goals,
               "timing": {"duration": 8}}  # fmt: skip
    return so.problem({**mapping, **changes})


@cache
def plain():
    return eight().solve().require()


def test_a_closed_path_returns_to_the_tensions_and_mirrors():
    u = plain().arrays["path.u"]
    np.testing.assert_allclose(u[0], u[-1], rtol=0, atol=1e-7)
    other = eight(side=-1).solve().require().arrays["path.u"]
    np.testing.assert_allclose(other, u[:, [0, 2, 1, 3, 5, 4]], rtol=0, atol=1e-6)


def test_limits_that_do_not_bind_change_nothing():
    u = plain().arrays["path.u"]
    generous = {"input_rates": {"short_1": "1 N/s"}, "length_rates": {"long_1": "50 mm/s"}}
    for together in (False, True):
        result = eight(limits=generous, together=together).solve().require()
        np.testing.assert_allclose(result.arrays["path.u"], u, rtol=0, atol=1e-6)


def test_rates_of_cables_stay_within_their_limits():
    fast = plain()
    limits = {"input_rates": {"short_1": 0.7 * fast["rates.short_1"]},
              "length_rates": {"long_1": 0.97 * fast["length_rates.long_1"]}}  # fmt: skip
    result = eight(limits=limits, together=True).solve().require()
    a = result.arrays
    f = result.question.robot.functions()
    lengths = np.array([np.array(f.actuator_lengths(q)).ravel() for q in a["path.q"]])
    pull, wind = (np.abs(np.diff(rows, axis=0)) / np.diff(a["path.t"])[:, None] for rows in (a["path.u"], lengths))
    assert np.max(pull[:, 4]) <= limits["input_rates"]["short_1"] + 1e-8
    assert np.max(wind[:, 1]) <= limits["length_rates"]["long_1"] + 1e-8
    assert result["rates.short_1"] == np.max(pull[:, 4]) and result["length_rates.long_1"] == np.max(wind[:, 1])
    assert np.min(a["path.u"]) >= 0 and np.max(a["path.miss"]) < 1e-8
    effort = [np.sum(u**2) for u in (fast.arrays["path.u"], a["path.u"])]
    assert effort[0] < effort[1]


# Friction


def test_cables_that_rub_do_so_against_their_motion():
    robot = arm(long_0=0.2, short_1=0.1)
    target = {"center": [0.19, 0, 0.06], "radius": 0.02, "normal": [1, 0, 0], "start": [0, 1, 0], "count": 8}
    goals = {"tip": {"type": "path", "on": "arm", "target": target}}
    result = eight(robot=robot, goals=goals, together=True).solve().require()
    a, rubbing = result.arrays, [0, 4]
    change, moving = np.diff(a["path.lengths"], axis=0), a["path.moving"]
    assert np.all(np.isnan(np.delete(moving, rubbing, axis=1)))
    against = change[:, rubbing] * moving[1:, rubbing] > STILL * 0.245
    undecided = result.details["undecided"]
    for i, column in zip(rubbing, against.T, strict=True):
        assert (np.flatnonzero(column) + 2).tolist() == undecided.get(result.question.robot.inputs[i], [])
    assert np.sum(against) < 4 and len(np.unique(moving[:, rubbing])) == 2
    own = so.robot(robot)
    f = own.functions(parameters=["actuators.long_0.moving", "actuators.short_1.moving"])
    for q, u, way in zip(a["path.q"], a["path.u"], moving[:, rubbing], strict=True):
        forces = [np.array(f.static_residual(q, u, way)).ravel(), np.array(f.elastic_force(q, way)).ravel()]
        assert np.max(np.abs(forces[0])) < 1e-7 * np.max(np.abs(forces[1]))


def test_the_curvature_of_a_program_knows_which_way_a_cable_moves():
    robot, target = arm(sections=(1.0,), long_0=0.3), [0.2, 0, 0.05]
    question = eight(robot=robot, goals={"tip": {"type": "point", "on": "arm", "target": target}}, timing=None)
    solver = directed(question.prepare())[0]
    made = solver.posture.program().functions()
    nlp, rng = made["nlp"], np.random.default_rng(5)
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", nlp["g"].numel())
    whole = ca.hessian(sigma * nlp["f"] + ca.dot(lam, nlp["g"]), nlp["x"])[0]
    exact = ca.Function("exact", [nlp["x"], nlp["p"], sigma, lam], [ca.triu(whole)])
    for way in (1.0, -1.0):
        numbers = solver.posture.program().stack_parameters({"actuators.long_0.moving": [way]})
        point = rng.random(nlp["x"].numel()), numbers, 0.7, rng.normal(size=lam.numel())
        np.testing.assert_allclose(made["hess_lag"](*point).full(), exact(*point).full(), rtol=1e-9, atol=1e-9)


# What cannot be, and the command line


@pytest.mark.parametrize(
    ("keys", "path", "hint"),
    [
        ({"limits": {"input_rates": {"f2": 1}}, "timing": None}, "limits.input_rates.f2", "timing"),
        ({"limits": {"input_rates": {"f9": 1}}}, "limits.input_rates.f9", "no 'f9'"),
        ({"limits": {"length_rates": {"f2": [0.1, 0.2]}}}, "limits.length_rates.f2", "no way to stay"),
        ({"limits": {"length_rates": {"f2": "1 N/s"}}}, "limits.length_rates.f2", "m/s"),
        ({"together": True, "sensitivities": True}, "sensitivities", "together"),
    ],
)
def test_limits_that_make_no_sense_are_refused(keys, path, hint):
    with pytest.raises(so.FileError, match=f"{re.escape(path)}.*{hint}"):
        push(**keys)


def test_a_path_that_is_too_fast_ends_with_exit_code_4_and_together_with_0(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    target = {"corners": CORNERS, "spacing": SPACING, "closed": False}
    problem = {"schema_version": 1, "type": "tensions", "robot": "slides.yaml",
               "goals": {"tip": {"type": "path", "on": "d", "target": target}},
               "limits": {"input_rates": {"f2": "2.6 N/s"}},
               "timing": {"duration": f"{DURATION} s", "ramp": 0}}  # fmt: skip
    for name, mapping in (("slides", slides()), ("push", problem)):
        with open(f"{name}.yaml", "w") as file:
            YAML().dump(mapping, file)
    assert cli.run(["solve", "push.yaml", "--no-figures", "-q"]) == 4
    assert "Waypoint 24 of 25: f2 would need" in "".join(capfd.readouterr()).replace("\n", " ")
    assert cli.run(["solve", "push.yaml", "--no-figures", "--json", "--set", "together=true"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["values"]["rates.f2"]["value"] == pytest.approx(2.6, abs=1e-7)
    assert so.load_result("results/push").arrays["path.u"].shape == (25, 4)
