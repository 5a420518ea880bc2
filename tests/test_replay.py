"""Plans simulated again: what a replay says is the truth, and what errors are estimated are those that a motion has.

The truth is scipy's DOP853 at 1e-12 on forward dynamics, interval by interval, with the inputs of the plan.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import socontrol as so
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.motion_answer import ends
from socontrol.programs.plans import replay
from socontrol.programs.plans.plan_answer import curve_of
from socontrol.programs.plans.plan_errors import Finer, between, needed, positions
from socontrol.programs.plans.planned import Planned
from socontrol.programs.plans.schemes import scheme

SHIPPED = Path(__file__).parents[1] / "configs/robots"
ROBOTS = {
    "double_pendulum": (str(SHIPPED / "double_pendulum.yaml"), 1.5, {"upper": 2.0, "lower": 0.5}),
    "cartpole": (str(SHIPPED / "cartpole.yaml"), 2.0, {"pole": np.pi, "cart": 1.0}),
}
SLIDER = {
    "schema_version": 1, "name": "slider",
    "segments": {
        "mass": {"type": "prismatic", "axis": [0, 0, 1], "body": {"mass": 2.0}, "tip": {"position": [0, 0, 1]}},
    },
    "actuators": {"force": {"type": "joint_torque", "joint": "mass"}},
}  # fmt: skip
DISC = {  # free in its plane, with a wheel that a motor turns; the centre of mass of both is the origin
    "schema_version": 1, "name": "disc", "gravity": [0, 0, 0],
    "segments": {
        "body": {"type": "planar", "body": {"mass": 1.0, "com": [-0.05, 0, 0], "inertia": [1, 1, 1]},
                 "tip": {"position": [0.5, 0, 0]}},
        "wheel": {"type": "revolute", "axis": [0, 0, 1], "parent": "body", "body": {"mass": 0.1, "inertia": [1, 1, 1]}},
    },
    "actuators": {"motor": {"type": "joint_torque", "joint": "wheel"}},
}  # fmt: skip


def question(robot, duration, goal, intervals=10, kind="radau", points=3, **more):
    mesh = {"intervals": intervals, "scheme": kind, "points": points, **more.pop("mesh", {})}
    return so.problem({
        "schema_version": 1, "type": "trajectory", "robot": robot, "duration": duration, "mesh": mesh,
        "start": {"coordinates": dict.fromkeys(goal, 0.0)}, "end": {"coordinates": goal}, **more,
    })  # fmt: skip


@cache
def planned(name, intervals, kind="radau", points=3, **more):
    """(question, planned motion, its Result) of a rest-to-rest swing of a shipped robot."""
    asked = question(*ROBOTS[name], intervals, kind, points, **more)
    result = asked.solve()
    assert result.status.outcome in ("solved", "rejected"), result.status
    return asked, curve_of(result), result


def true_nodes(asked, curve):
    """States [N+1 x 2n] at the nodes, from the plan's first state."""
    f, n = asked.loaded.functions().forward_dynamics.function, asked.robot.n
    states = [np.concatenate([curve.q[0], curve.v[0]])]
    for k, (begin, end) in enumerate(zip(curve.nodes, curve.nodes[1:], strict=False)):
        def rhs(t, x, k=k, begin=begin, end=end):
            u = curve.inside([k], [(t - begin) / (end - begin)])[3][0]
            return np.concatenate([x[n:], np.array(f(x[:n], x[n:], u)).ravel()])

        states.append(solve_ivp(rhs, (begin, end), states[-1], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1])
    return np.array(states)


def places(asked, q):
    return positions(asked.loaded.functions(), asked.loaded)(q)


def true_tip(asked, curve):
    """Largest distance of any end from the plan at the nodes [m]."""
    q = true_nodes(asked, curve)[:, : asked.robot.n]
    return np.linalg.norm(places(asked, q) - places(asked, curve.q), axis=2).max()


def estimated(asked, curve):
    weights, functions = displacement_weights(asked.loaded), asked.loaded.functions()
    return Finer(replay.Driven.of(asked, curve), curve, weights, positions(functions, asked.loaded)).errors()


def looked(asked, curve):
    """What `look` gives for a plan in the place of its solution."""
    class Planner:
        functions = asked.loaded.functions()

    t = asked.output_times(curve.duration)
    arrays = {"t": t, "q": curve.at(t)[0]}
    return replay.look(asked, curve, Planner, arrays | ends(asked.loaded, Planner.functions, arrays))


def by_hand(asked, duration, q, v, a, u, kind="radau", points=3):
    """A plan of constant accelerations a [n] and inputs u [m], over the question's intervals."""
    form, count = scheme(kind, points), len(asked.shares)
    t = np.linspace(0.0, duration, count + 1)[:, None]
    q, v, a, u = (np.array(x, dtype=float) for x in (q, v, a, u))
    rows = np.broadcast_to(a, (count, form.size, a.size))
    inputs = np.broadcast_to(u, (count, form.size, u.size))
    return Planned(form, duration, asked.shares, q + v * t + a * t**2 / 2, v + a * t, rows, inputs, form.c)


# The inputs a replay is driven by


@pytest.mark.parametrize("inputs", ["points", "linear", "constant"])
def test_a_replay_is_driven_by_the_inputs_of_the_plan(inputs):
    asked, curve, _ = planned_with(inputs)
    plant = replay.Driven.of(asked, curve)
    for k in range(len(curve.shares)):
        plant.k = k
        for x in (0.0, 0.3, 1.0):  # at both ends too: it is the interval that says which side of a jump is meant
            t = curve.nodes[k] + x * (curve.nodes[k + 1] - curve.nodes[k])
            assert plant.inputs(t) == pytest.approx(curve.inside([k], [x])[3][0], rel=1e-10, abs=1e-10)


@cache
def planned_with(inputs):
    asked = question(*ROBOTS["double_pendulum"], 12, mesh={"inputs": inputs}, costs={"effort": {"type": "effort"}})
    result = asked.solve()
    return asked, curve_of(result), result



# The replay and the estimate against the truth


@pytest.mark.parametrize("name, count, kind, points", [
    ("double_pendulum", 10, "radau", 3), ("double_pendulum", 20, "trapezoidal", 2), ("cartpole", 20, "radau", 3),
    ("cartpole", 40, "trapezoidal", 2), ("cartpole", 40, "hermite_simpson", 3), ("double_pendulum", 12, "lobatto", 4),
])  # fmt: skip
def test_replay_and_estimate_find_the_true_deviation(name, count, kind, points):
    asked, curve, result = planned(name, count, kind, points)
    truth = true_tip(asked, curve)
    errors = estimated(asked, curve)
    assert np.max(errors.tip) == pytest.approx(truth, rel=0.2)
    found = replay.replayed(asked, curve, curve.nodes)
    there = np.linalg.norm(places(asked, found.q) - places(asked, curve.q), axis=2).max()
    assert there == pytest.approx(truth, rel=0.01)
    assert result.values["replay.tip"].value >= 0.9 * truth
    assert result.values["error.tip"].value == pytest.approx(result.values["replay.tip"].value, rel=0.2)


def test_a_deviation_tells_which_end_is_off_how_far_and_when():
    asked, curve, _ = planned("double_pendulum", 20)
    t = asked.output_times(curve.duration)
    arrays = {"q": curve.at(t)[0] + 5.0}  # far from 0, which is no part of a range
    arrays |= ends(asked.loaded, asked.loaded.functions(), arrays)
    q, there = arrays["q"].copy(), {name: arrays[f"{name}.position"].copy() for name in asked.robot.segments}
    q[70, 1] += 0.2
    there["lower"][70] += [0.0, 0.3, 0.4]
    there["upper"][90] += 0.2
    off = replay.deviations(asked, arrays, replay.Replayed(t, q, q, there, None))
    assert (off.segment, off.time) == ("lower", t[70])
    assert off.tip == pytest.approx(0.5) and off.share == pytest.approx(0.5 / 3.0)  # links of 1 m and 2 m
    assert off.coordinates == pytest.approx(0.2 / np.ptp(curve.at(t)[0][:, 1]))


@pytest.mark.parametrize("kind, points, count, order", [
    ("trapezoidal", 2, 40, 2), ("radau", 2, 40, 3), ("radau", 3, 40, 5), ("hermite_simpson", 3, 60, 4),
])  # fmt: skip
def test_the_deviation_falls_with_the_order_of_the_scheme(kind, points, count, order):
    coarse, fine = (planned("double_pendulum", n, kind, points)[2].values for n in (count, 2 * count))
    for name in ("replay.tip", "error.tip"):
        assert np.log2(coarse[name].value / fine[name].value) == pytest.approx(order, abs=0.75)


@pytest.mark.parametrize("name, count, kind", [("double_pendulum", 40, "trapezoidal"), ("cartpole", 10, "radau")])
def test_as_many_intervals_as_needed_do(name, count, kind):
    coarse = planned(name, count, kind)[2]
    assert coarse.status.outcome == "rejected" and coarse.status.exit_code == 7
    wanted = coarse.values["mesh.needed"].value
    assert f"`intervals` of the mesh to about {wanted}," in coarse.status.message
    fine = planned(name, wanted, kind)[2]
    assert fine.status.solved
    assert fine.values["replay.tip_share"].value > 1e-6  # not many more than needed


def test_intervals_needed_follow_from_order_and_tolerance():
    _, curve, _ = planned("double_pendulum", 40, "trapezoidal", 2)
    assert needed(curve, 4e-2, 1e-4) == pytest.approx(1.1 * 40 * 20, abs=1)  # order 2: a 400th of the error


# Plans whose truth is known


@pytest.mark.parametrize("kind, points", [("radau", 1), ("radau", 3), ("trapezoidal", 2), ("lobatto", 5)])
def test_a_fall_is_exact_in_every_scheme(kind, points):
    asked = question(SLIDER, 1.5, {"mass": -1.0}, 4, kind, points)
    curve = by_hand(asked, 1.5, [0.0], [2.0], [-9.81], [0.0], kind, points)
    arrays, values, note = looked(asked, curve)
    assert note is None and values["mesh.needed"].value == 1
    assert max(values[name].value for name in ("replay.tip", "error.tip", "error.between")) < 1e-9
    t = asked.output_times(1.5)
    assert arrays["replay.q"][:, 0] == pytest.approx(2 * t - 9.81 * t**2 / 2, abs=1e-9)
    assert arrays["replay.mass.position"][:, 2] == pytest.approx(1 + 2 * t - 9.81 * t**2 / 2, abs=1e-9)


def test_a_force_that_the_plan_forgets_is_the_residual_between_its_points():
    asked = question(SLIDER, 1.0, {"mass": -1.0}, 4)
    curve = by_hand(asked, 1.0, [0.0], [0.0], [-9.81], [5.0])
    t, share = between(asked, curve, asked.loaded.functions(), displacement_weights(asked.loaded))
    assert share == pytest.approx(np.full(40, 5.0 / (2 * 9.81)), rel=1e-9)  # weight and inertia are the largest
    assert t == pytest.approx((np.arange(40) + 0.5) / 40)
    arrays, values, note = looked(asked, curve)
    assert values["replay.tip"].value == pytest.approx(5.0 / 2 / 2)  # u/m t^2/2
    assert values["error.tip"].value == pytest.approx(5.0 / 2 / 2)
    assert note.outcome == "rejected" and "the end of mass is 1.25 m off at t = 1 s" in note.message
    assert estimated(asked, curve).growth == pytest.approx(1.0)  # a body that coasts, and all errors one way


@pytest.mark.parametrize("v, a, largest", [(2.0, 0.0, 200.0), (0.0, 3.0, 100 * 3.0)])
def test_forces_of_rates_and_of_inertia_are_compared_with(v, a, largest):
    damped = {**SLIDER["segments"]["mass"], "damping": 100.0, "body": {"mass": 2.0 if v else 100.0}}
    asked = question({**SLIDER, "gravity": [0, 0, 0], "segments": {"mass": damped}}, 0.01, {"mass": 2.0}, 4)
    curve = by_hand(asked, 0.01, [0.0], [v], [a], [7.0])
    _, share = between(asked, curve, asked.loaded.functions(), displacement_weights(asked.loaded))
    assert share == pytest.approx(np.full(40, 1 - 7.0 / largest), rel=0.02)  # a little damping comes up


def test_a_plan_with_tampered_inputs_is_rejected():
    asked, curve, result = planned("double_pendulum", 20)
    assert result.status.solved
    _, values, note = looked(asked, replace(curve, u=1.05 * curve.u))
    assert note.outcome == "rejected" and values["replay.tip"].value > 50 * result.values["replay.tip"].value


def test_an_unstable_motion_is_called_so():
    upright = {"coordinates": {"pole": np.pi}}
    asked = question(ROBOTS["cartpole"][0], 3.0, {"pole": np.pi, "cart": 1.0}, 6, start=upright)
    curve = curve_of(asked.solve())
    _, values, note = looked(asked, curve)
    assert "unstable" in note.message
    hanging = question(ROBOTS["cartpole"][0], 3.0, {"pole": 0.0, "cart": 1.0}, 6)
    note = looked(hanging, curve_of(hanging.solve()))[2]
    assert note is None or "unstable" not in note.message


def test_given_coordinates_stay_given():
    asked = question(ROBOTS["double_pendulum"][0], 1.0, {"lower": 1.0}, 20, coordinates={"upper": 0.4})
    result = asked.solve().require()
    assert np.all(result.arrays["replay.q"][:, 0] == 0.4) and np.all(result.arrays["replay.qd"][:, 0] == 0.0)
    assert result.arrays["replay.q"][:, 1] == pytest.approx(result.arrays["q"][:, 1], abs=1e-4)


def test_a_replay_keeps_the_coordinates_of_the_plan_past_half_a_turn():
    asked = question(DISC, 1.0, {"wheel": 0.0}, 5)
    rates = np.zeros(4)
    turning = int(np.argmax(np.abs(np.array(asked.loaded.functions().jacobian("body", 1.0)(np.zeros(4)))[2, :3])))
    rates[turning] = 1.6 * np.pi
    curve = by_hand(asked, 1.0, np.zeros(4), rates, np.zeros(4), [0.0])
    arrays, values, note = looked(asked, curve)
    assert note is None and values["replay.coordinates"].value < 1e-6
    assert arrays["replay.q"][-1, turning] == pytest.approx(1.6 * np.pi)


# What is not replayed


@pytest.mark.parametrize("excess, largest", [(1.0, 2 * 9.81 + 1.0), (-1.0, 2 * 9.81)])  # the input, the weight
def test_equilibria_are_not_simulated_but_looked_at_between_the_nodes(excess, largest):
    asked = question(SLIDER, 1.0, {"mass": 1.0}, 4, quasi_static=True)
    arrays, values, note = looked(asked, by_hand(asked, 1.0, [0.0], [1.0], [1.0], [2 * 9.81 + excess]))
    assert note is None and set(arrays) == {"error.t", "error.share"} and set(values) == {"error.between"}
    assert values["error.between"].value == pytest.approx(1.0 / largest)


def test_what_is_no_equilibrium_between_the_nodes_is_rejected():
    asked = question(SLIDER, 1.0, {"mass": 1.0}, 4, quasi_static=True)
    _, values, note = looked(asked, by_hand(asked, 1.0, [0.0], [1.0], [1.0], [2 * 9.81 + 3.0]))
    assert values["error.between"].value == pytest.approx(3.0 / (2 * 9.81 + 3.0))
    assert note.outcome == "rejected" and "more intervals" in note.message


def test_a_replay_can_be_switched_off():
    asked, curve, _ = planned("double_pendulum", 20)
    arrays, values, note = looked(replace(asked, replay=replace(asked.replay, active=False)), curve)
    assert note is None and set(values) == {"error.between"}


def test_a_plan_that_cannot_be_simulated_is_rejected(monkeypatch):
    asked, curve, _ = planned("double_pendulum", 20)
    monkeypatch.setattr(replay, "STEPS", 1)
    arrays, values, note = looked(asked, curve)
    assert note.outcome == "rejected" and "is as far as the simulation gets" in note.message
    assert not any(name.startswith("replay.") for name in [*arrays, *values])


def test_an_interrupted_replay_says_so(monkeypatch):
    asked, curve, _ = planned("double_pendulum", 20)

    def pressed(*_):
        raise KeyboardInterrupt

    for owner, name in ((replay._Leaps, "_leg"), (Finer, "errors")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, pressed)
            assert looked(asked, curve)[2].outcome == "interrupted"
