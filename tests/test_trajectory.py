"""Plans of whole robots, beside statics, geometry and closed forms written out here in numpy."""

from pathlib import Path

import numpy as np
import pytest

import socontrol as so
from socontrol.native import compiler
from socontrol.programs.plans.plan_answer import resampled
from socontrol.programs.plans.plan_costs import PLAN_COSTS

ROBOTS = Path(__file__).parent.parent / "configs/robots"
CART, POLE, ARM, G = 1.0, 0.3, 0.5, 9.81  # kg, kg, m, m/s^2: configs/robots/cartpole.yaml
FORCE, SHOULDER, ELBOW = 20.0, 20.0, 15.0  # N, N m, N m: largest inputs
FREE = {"shortest": 0.1, "longest": 3.0, "guess": 1.0}
TIME, EFFORT = {"time": {"type": "time"}}, {"effort": {"type": "effort"}}
PRECISE = {"type": "ipopt", "tolerance": 1e-9, "max_iterations": 500}


def asked(robot, *, intervals=6, mesh=None, **keys):
    """Question of a plan on a coarse mesh, not simulated again."""
    if isinstance(robot, str):
        robot = str(ROBOTS / f"{robot}.yaml")
    costs = {**EFFORT, "rate": {"type": "input_rate", "weight": 0.1}}
    usual = {"replay": {"active": False}, "solver": PRECISE, "costs": costs}
    mesh = {"intervals": intervals, "inputs": "linear", "halved": False, **(mesh or {})}
    return so.problem({"type": "trajectory", "robot": robot, **usual, **keys, "mesh": mesh})


def plan(robot, **keys):
    return so.solve(asked(robot, **keys)).require()


def tip(on, *target, **keys):
    return {"tip": {"type": "point", "on": on, "target": list(target), **keys}}


def cart(way=0.5, **keys):
    """Keys of a cart-pole that goes a way from rest to rest, the pole hanging at both ends."""
    start = {"coordinates": {"cart": 0.0}, "settled": False}
    return {"duration": 1.0, "start": start, "end": {"coordinates": {"cart": way, "pole": 0.0}}, **keys}


def swing(**keys):
    """Keys of a double pendulum that is raised from hanging down."""
    return {"duration": 1.2, "end": {"coordinates": {"upper": 0.8, "lower": -0.5}}, **keys}


def close(**keys):
    """Keys of a finger that is closed by its cable."""
    return {"duration": 0.3, "end": {"goals": tip("block_2", None, 0.05, None)}, **keys}


def reach(x=0.02, **keys):
    """Keys of two pneumatic modules whose tip goes aside."""
    return {"duration": 0.4, "intervals": 4, "end": {"goals": tip("cap", x, None, None)}, **keys}


BALL = {"ball": {"type": "sphere", "center": [0.75, 0.0, -3.2], "radius": 0.65}}  # the least effort leads through it


# Geometry and statics of the double pendulum: links of 1 m and 2 m, 1 kg each at half of them


def links(q, shares):
    """Points [K x 2 links x len(shares) x 3] on both links at shares of their lengths."""
    a, b = q[:, 0, None], q.sum(axis=1)[:, None]
    upper = np.stack([np.sin(a) * shares, 0 * a * shares, -np.cos(a) * shares], axis=-1)
    lower = np.stack([np.sin(b) * 2 * shares, 0 * b * shares, -np.cos(b) * 2 * shares], axis=-1)
    return np.stack([upper, upper[:, -1:] / shares[-1] + lower], axis=1)


def ends(q):
    """Ends [K x 3] of the lower link."""
    return links(q, np.array([1.0]))[:, 1, 0]


def holding(q):
    """Torques [K x 2] that hold it still against its weight."""
    elbow = G * np.sin(q.sum(axis=1))
    return np.column_stack([elbow + 2 * G * np.sin(q[:, 0]) - G * 0.5 * np.sin(q[:, 0]), elbow])


# What to loosen


STRETCHED = {"duration": {"shortest": 0.1, "longest": 5.0, "guess": 1.0}, "costs": TIME}


def roof(z):
    return {"roof": {"type": "half_space", "point": [0, 0, z], "normal": [0, 0, -1]}}


def held_out(torque=20.0):
    """The upper link held at 0.5 rad, the lower one in line with it, by a shoulder of so much torque."""
    bounds = {"inputs": {"shoulder": [-torque, torque]}}
    return swing(end={"coordinates": {"upper": 0.5, "lower": 0.0}, "settled": True}, bounds=bounds)


def upright(z):
    return cart(0.0, duration=1.5, end={"coordinates": {"cart": 0.0, "pole": np.pi}}, obstacles=roof(z))


def quickest(**keys):
    """Least duration under the same limits."""
    return lambda: plan("cartpole", **{**keys, **STRETCHED})["duration"] - keys["duration"]


SHORT = cart(duration=0.4, costs=EFFORT)
SLOW = cart(limits={"rates": {"cart": 0.5}}, costs=EFFORT)
STEADY = cart(limits={"input_rates": {"force": 40.0}}, start={"coordinates": {"cart": 0.0}, "inputs": {"force": 0.0}})
BOUND = cart(duration=1.5, bounds={"coordinates": {"cart": [-1, 0.4]}},
             end={"coordinates": {"pole": 0.0}, "goals": tip("pole", 0.5, None, None)})  # fmt: skip
HIGH, FAR = {"goals": tip("pole", None, None, 0.6)}, {"goals": tip("lower", 3.2, None, 0.0)}
NEVER = {  # robot, keys, what has to give way first, by how much
    "too short": ("cartpole", SHORT, "duration", quickest(**SHORT)),
    "too slow": ("cartpole", SLOW, "duration", quickest(**SLOW)),
    "input too slow": ("cartpole", STEADY, "duration", quickest(**STEADY)),
    "past a bound": ("cartpole", BOUND, "coordinates.cart (upper limit)", lambda: 0.1),
    "pole too short": ("cartpole", cart(end=HIGH), "end.goals.tip", lambda: 0.1),
    "links too short": ("double_pendulum", swing(end=FAR), "end.goals.tip", None),
}  # fmt: skip
YIELDING = {  # robot, keys that have given way by so much, what gives way, how much it has to
    "obstacle": ("cartpole", lambda by: upright(0.4 + by), "obstacles.roof", 0.1),
    "torque": ("double_pendulum", lambda by: held_out(10.0 + by), "inputs.shoulder (upper limit)",
               holding(np.array([[0.5, 0.0]]))[0, 0] - 10.0),
    "length": ("gripper_finger_planar", lambda by: close(limits={"lengths": {"cable": [0.088 - by, 0.1]}}),
               "limits.lengths.cable", None),
}  # fmt: skip


def first_to_yield(result, quantity):
    """Amount by which the first in the list has to give way, once all that is said of it is looked at."""
    assert result.status.outcome == "infeasible" and result.status.exit_code == 4
    first = result.details["loosen"][0]
    assert first["quantity"] == quantity
    assert f"{quantity} would have to" in result.status.message
    assert f"by {first['by']:.3g} {first['unit']}" in result.status.message
    assert result.details["worst"]
    return first["by"]


@pytest.mark.parametrize("name", NEVER)
def test_what_cannot_be_done_is_infeasible_and_the_first_to_give_way_is_named(name):
    robot, keys, quantity, by = NEVER[name]
    found = first_to_yield(so.solve(asked(robot, **keys)), quantity)
    assert by is None or found == pytest.approx(by(), rel=1e-3)


@pytest.mark.parametrize("name", YIELDING)
def test_giving_way_by_a_hundredth_more_is_enough_and_a_tenth_less_is_not(name):
    robot, keys, quantity, by = YIELDING[name]
    found = first_to_yield(so.solve(asked(robot, **keys(0.0))), quantity)
    assert by is None or found == pytest.approx(by, rel=1e-3)
    assert so.solve(asked(robot, **keys(1.01 * found))).status.solved
    assert so.solve(asked(robot, **keys(0.9 * found))).status.outcome == "infeasible"


# Two solvers, two Hessians, machine code


BOTH, LOBATTO = {**TIME, **EFFORT}, {"scheme": "lobatto", "points": 4}
VIA, NEAR = {"via": {"time": 0.5, "goals": tip("lower", 0.6, None, None)}}, tip("lower", 1.5, None, -2.0, weight=10.0)
STAGED = {
    "cart-pole": ("cartpole", cart()),
    "free duration": ("cartpole", cart(duration=FREE, costs=BOTH)),
    "rates of inputs": ("cartpole", cart(limits={"input_rates": {"force": 90.0}})),
    "obstacle": ("double_pendulum", swing(obstacles=BALL)),
    "waypoint": ("double_pendulum", swing(waypoints=VIA)),
    "inputs constant": ("double_pendulum", swing(mesh={"inputs": "constant"}, costs=EFFORT)),
    "lobatto": ("double_pendulum", swing(mesh=LOBATTO, duration=FREE, costs=BOTH)),
    "weighted goal": ("double_pendulum", swing(end={"goals": NEAR})),
    "modules": ("stiff_flop_two_modules_coarse", reach(duration=0.3)),
}


@pytest.mark.parametrize("name", STAGED)
def test_fatrop_and_ipopt_find_one_plan(name):
    robot, keys = STAGED[name]
    flat = 1e-4 if name == "modules" else 1e-6  # six inputs for one goal: many ways cost nearly the same
    mine, other = plan(robot, **keys), plan(robot, **{**keys, "solver": {"type": "fatrop", "tolerance": 1e-9}})
    assert other["cost"] == pytest.approx(mine["cost"], rel=1e-6)
    assert other["duration"] == pytest.approx(mine["duration"], rel=1e-6)
    q = mine.arrays["point.q"]
    np.testing.assert_allclose(other.arrays["point.q"], q, atol=flat * np.abs(q).max())


GAUSS_NEWTON = {**PRECISE, "hessian": "gauss_newton"}
SHORTLY = {"double_pendulum": swing(), "gripper_finger_planar": close()}


@pytest.mark.parametrize("robot, keys", SHORTLY.items(), ids=SHORTLY)
def test_both_hessians_lead_to_one_optimum(robot, keys):
    exact, newton = plan(robot, **keys), plan(robot, **{**keys, "solver": GAUSS_NEWTON})
    assert newton["cost"] == pytest.approx(exact["cost"], rel=1e-8)
    np.testing.assert_allclose(newton.arrays["point.q"], exact.arrays["point.q"], atol=1e-5)


@pytest.mark.skipif(compiler.find() is None, reason="no C compiler is here; install gcc or clang")
def test_machine_code_finds_the_same_plan():
    question = asked("cartpole", **cart())
    own, compiled = so.solve(question), so.solve(question, compiled=True)
    assert compiled.solver["compiled"] and not own.solver["compiled"]
    np.testing.assert_allclose(compiled.arrays["q"], own.arrays["q"], atol=1e-9)


# Moments


def test_waypoints_are_met_at_their_times_on_legs_of_any_length():
    goal, still = {"goals": tip("lower", 0.8, None, None)}, {"coordinates": {"upper": 0.9}, "velocity": "rest"}
    plan_ = plan("double_pendulum", intervals=9, **swing(
        waypoints={"still": {"time": 0.95, **still}, "via": {"time": 0.4, **goal, "rates": {"lower": 1.5}}},
        end={"coordinates": {"lower": -0.5}, "rates": {"upper": 0.5}},
    ))  # fmt: skip
    t, q, qd = (plan_.arrays[f"node.{x}"] for x in ("t", "q", "qd"))
    via, still = (int(np.argmin(np.abs(t - time))) for time in (0.4, 0.95))
    np.testing.assert_allclose(t[[0, via, still, -1]], [0.0, 0.4, 0.95, 1.2], atol=1e-12)
    assert ends(q[[via]])[0, 0] == pytest.approx(0.8, abs=1e-7)
    assert qd[via, 1] == pytest.approx(1.5, abs=1e-9) and abs(qd[via, 0]) > 0.01
    assert q[still, 0] == pytest.approx(0.9, abs=1e-9)
    np.testing.assert_allclose(qd[[still, -1]], [[0, 0], [0.5, 0]], atol=1e-9)
    assert q[-1, 1] == pytest.approx(-0.5, abs=1e-9)
    np.testing.assert_allclose(q[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(plan_.arrays["lower.position"], ends(plan_.arrays["q"]), atol=1e-12)


def test_a_share_of_a_free_duration_is_that_share_of_what_is_found():
    way = {"via": {"share": 0.3, "coordinates": {"cart": 0.3}}}
    found = plan("cartpole", **cart(duration=FREE, costs={**TIME, **EFFORT}, waypoints=way))
    t, q = found.arrays["t"], found.arrays["q"]
    assert 0.1 < found["duration"] < 3.0
    assert np.interp(0.3 * found["duration"], t, q[:, 0]) == pytest.approx(0.3, abs=1e-4)


def test_a_settled_end_is_an_equilibrium_and_one_at_rest_alone_is_not():
    for settled in (False, True):
        keys = swing(end={"goals": tip("lower", 1.5, None, None), "settled": settled})
        arrays = plan("double_pendulum", **keys).arrays
        last = {x: arrays[x][-1] for x in ("q", "qd", "qdd", "u")}
        np.testing.assert_allclose(last["qd"], 0.0, atol=1e-9)
        off = np.abs(last["u"] - holding(last["q"][None])[0]).max()
        assert (off < 1e-6) == settled and (np.abs(last["qdd"]).max() < 1e-8) == settled


def test_inputs_begin_and_end_where_they_are_given():
    keys = cart(start={"coordinates": {"cart": 0.0}, "inputs": {"force": 7.0}}, intervals=12)
    keys["end"] = {**keys["end"], "inputs": {"force": -3.0}}
    u = plan("cartpole", **keys).arrays["u"][:, 0]
    np.testing.assert_allclose(u[[0, -1]], [7.0, -3.0], atol=1e-6)


def test_the_start_is_the_rest_shape_under_its_inputs():
    """A level finger without weight: 7 mm times the pull, over the stiffness of a flexure, E w^3 t/12, is its bend."""
    u = 0.3
    q = plan("gripper_finger_planar", **close(start={"inputs": {"cable": u}})).arrays["q"][0]
    np.testing.assert_allclose(np.abs(q), 7e-3 * u / (1e6 * 15e-3 * 5e-3**3 / 12), rtol=1e-6)


def test_exact_goals_are_met_and_weighted_ones_are_weighed():
    target, keys = np.array([1.5, 0.0, -2.0]), {"costs": EFFORT}
    exact = plan("double_pendulum", **swing(end={"goals": tip("lower", 1.5, None, -2.0)}, **keys))
    np.testing.assert_allclose(ends(exact.arrays["q"][-1:])[0], target, atol=1e-7)
    misses, efforts = [], []
    for weight in (0.1, 1.0, 10.0):
        found = plan("double_pendulum", **swing(end={"goals": tip("lower", 1.5, None, -2.0, weight=weight)}, **keys))
        misses.append(np.linalg.norm(ends(found.arrays["q"][-1:])[0] - target))
        efforts.append(found["cost.effort"])
        assert found.residuals["goals.tip"].value == pytest.approx(misses[-1], abs=1e-12)
        assert found["cost"] == pytest.approx(efforts[-1] + weight * (misses[-1] / 3.0) ** 2 / 2, rel=1e-9)
    assert misses[0] > misses[1] > misses[2] > 1e-4
    assert efforts[0] < efforts[1] < efforts[2] < exact["cost.effort"]


# Limits, looked at where the plan was not held to them


def test_limits_are_reached_and_hold_between_the_points_too():
    every = {"outputs": {"every": 5e-4}, "duration": 1.0, "intervals": 8}
    limits = {"rates": {"upper": 1.95}, "input_rates": {"shoulder": 70, "elbow": [-24, 30]}}
    bounds = {"coordinates": {"lower": [-0.9, None]}, "inputs": {"elbow": [-7, 15]}}
    kept = plan("double_pendulum", **swing(**every, limits=limits, bounds=bounds))
    loose = plan("double_pendulum", **swing(**every))
    for arrays, within in ((kept.arrays, True), (loose.arrays, False)):
        (q, qd, u), ud = (arrays[x] for x in ("q", "qd", "u")), np.diff(arrays["u"], axis=0) / 5e-4
        over = [-0.9 - q[:, 1].min(), qd[:, 0].max() - 1.95, -7 - u[:, 1].min()]
        over += [ud[:, 0].max() - 70, -24 - ud[:, 1].min()]
        # inputs are straight in an interval: no more than at its ends; coordinates and rates are polynomials
        assert (np.array(over) < [1e-3, 2e-2, 1e-6, 1e-3, 1e-3]).all() == within
    assert kept["cost"] > loose["cost"]


def test_a_cable_keeps_its_length():
    """Of a level finger: that of blocks and flexures, 20 and 10 mm each, less 7 mm times the bend of each flexure."""
    lengths = []
    for limits in ({}, {"lengths": {"cable": ["83 mm", "85.5 mm"]}}):
        start, end = {"inputs": {"cable": 0.5}}, {"goals": tip("block_2", None, 0.05, None), "velocity": "free"}
        arrays = plan("gripper_finger_planar", **close(limits=limits, start=start, end=end)).arrays
        lengths.append(0.09 - 7e-3 * np.abs(arrays["q"].sum(axis=1)) * 0.01)
        np.testing.assert_allclose(arrays["lengths"][:, 0], lengths[-1], rtol=1e-6)
    assert lengths[0].max() > 86e-3 and lengths[1].max() == pytest.approx(85.5e-3, abs=1e-5)


def test_a_body_keeps_out_of_an_obstacle_that_is_in_its_way():
    free, kept = plan("double_pendulum", **swing()), plan("double_pendulum", obstacles=BALL, **swing())
    center, radius = np.array(BALL["ball"]["center"]), BALL["ball"]["radius"]
    for result, inside in ((free, 0.1), (kept, 0.002)):
        gaps = np.linalg.norm(links(result.arrays["q"], np.linspace(0.005, 1, 200)) - center, axis=-1) - radius
        assert gaps.min() == pytest.approx(-inside, abs=1e-3)
    np.testing.assert_allclose(kept.arrays["clearance.ball"], gaps.min(axis=(1, 2)), atol=2e-3)
    assert kept["clearance.ball"] == pytest.approx(gaps.min(), abs=5e-4)
    assert kept["cost"] > free["cost"]


LOCKED = {"coordinates": {"pole": 0.0}, "costs": TIME, "duration": FREE, "intervals": 4}  # one mass on a line


def locked(way, **keys):
    start = {"coordinates": {"cart": 0.0}}
    return plan("cartpole", **{**LOCKED, "start": start, "end": {"coordinates": {"cart": way}}, **keys})


@pytest.mark.parametrize("inputs", ["linear", "constant", "points"])
def test_a_mass_takes_the_least_time_by_full_force_there_and_back(inputs):
    """T = 2 (m d/F)^(1/2)."""
    found = locked(1.0, mesh={"inputs": inputs})
    assert found["duration"] == pytest.approx(2 * np.sqrt((CART + POLE) / FORCE), rel=1e-6)
    np.testing.assert_allclose(found.arrays["point.u"][:, 0], np.repeat([FORCE, -FORCE], 6), rtol=1e-4)


LIMITED = {
    "of a coordinate": lambda v: {"rates": {"cart": [-1.0, v]}},
    "of a point": lambda v: {"speeds": {"cart": {"on": "pole", "largest": v}}},
}


@pytest.mark.parametrize("limit", LIMITED)
def test_a_mass_of_limited_speed_coasts(limit):
    """d = 1 m: a quarter of the time up to v = (d F/3 m)^(1/2), half of it at v, a quarter down."""
    v = np.sqrt(FORCE / 3 / (CART + POLE))
    found = locked(1.0, limits=LIMITED[limit](v))
    assert found["duration"] == pytest.approx(4 * v * (CART + POLE) / FORCE, rel=1e-6)
    np.testing.assert_allclose(found.arrays["node.qd"][:, 0], [0, v, v, v, 0], atol=1e-5)
    if limit == "of a point":
        assert found["speed.cart"] == pytest.approx(v, rel=1e-6)


def test_a_finger_closes_faster_the_harder_its_cable_may_pull():
    times = []
    for most in (0.6, 1.0):
        keys = close(end={"goals": tip("block_2", None, 0.04, None)}, duration={**FREE, "shortest": 0.01, "guess": 0.2})
        found = plan("gripper_finger_planar", **keys, costs=TIME, bounds={"inputs": {"cable": [0, most]}})
        times.append(found["duration"])
        assert found.arrays["point.u"][0, 0] == pytest.approx(most, rel=1e-4)
    assert times[0] > 1.1 * times[1]


# Without masses


def test_a_quasi_static_plan_is_in_balance_at_every_instant():
    for intervals in (6, 20):
        arrays = plan("double_pendulum", intervals=intervals, **swing(quasi_static=True)).arrays
        np.testing.assert_allclose(arrays["point.u"], holding(arrays["point.q"]), atol=1e-6)
        np.testing.assert_allclose(arrays["u"], holding(arrays["q"]), atol=0.3)  # N m, of 17: between the points


def test_a_quasi_static_path_does_not_depend_on_its_duration():
    keys = close(quasi_static=True, costs={"rate": {"type": "input_rate"}})
    once, twice = (plan("gripper_finger_planar", **{**keys, "duration": T}) for T in (1.0, 2.0))
    np.testing.assert_allclose(twice.arrays["point.q"], once.arrays["point.q"], atol=1e-5)
    assert twice["cost"] == pytest.approx(2 * once["cost"], rel=1e-6)  # the time integral of squares of T du/dt


# Costs


def integral(rows, t):
    """Half the integral of squares, trapezoids over 4000 samples."""
    return np.trapezoid((rows**2).sum(axis=1), t) / 2


def circle(t):
    angle = 2 * np.pi * t / 1.2
    return np.array([1.0, 0.0, -2.0]) + 0.3 * np.column_stack([np.cos(angle), 0 * t, -np.sin(angle)])


ROUND = {"center": [1.0, 0.0, -2.0], "radius": 0.3, "normal": [0, 1, 0]}
LARGEST = np.array([SHOULDER, ELBOW])
COSTS = {  # keys of a cost, the same from the arrays of a plan
    "effort": ({}, lambda a: integral(a["u"] / LARGEST, a["t"])),
    "input_rate": ({}, lambda a: integral(a["ud"] * 1.2 / LARGEST, a["t"])),
    "smoothness": ({}, lambda a: integral(a["qdd"] / (6.0 / 1.2) ** 2, a["t"])),
    "tracking": ({"on": "lower", "circle": ROUND}, lambda a: integral((ends(a["q"]) - circle(a["t"])) / 3.0, a["t"])),
    "time": ({}, lambda a: a["t"][-1]),
}


@pytest.mark.parametrize("kind", PLAN_COSTS)
def test_a_cost_is_the_integral_it_says(kind):
    given, measured = COSTS[kind]
    span = {"duration": {"shortest": 1.0, "longest": 1.2, "guess": 1.2}} if kind == "time" else {}
    costs = {"own": {"type": kind, "weight": 0.7, **given}, "effort": {"type": "effort", "weight": 1e-3}}
    found = plan("double_pendulum", **swing(costs=costs, intervals=10, outputs={"every": 3e-4}, **span))
    assert found["cost.own"] == pytest.approx(0.7 * measured(found.arrays), rel=1e-3)
    assert found["cost"] == pytest.approx(found["cost.own"] + found["cost.effort"], rel=1e-12)


# Where a search begins


def as_guess(result, robot):
    arrays, shares = result.arrays, slice(None, None, 4)
    columns = {"coordinates": (robot.coordinates, "q"), "inputs": (robot.inputs, "u")}
    given = {key: {name: arrays[x][shares, i].tolist() for i, name in enumerate(names)}
             for key, (names, x) in columns.items()}  # fmt: skip
    return {"times": arrays["t"][shares].tolist(), **given}


def test_a_search_from_the_answer_is_short_and_finds_it_again():
    first = plan("double_pendulum", **swing())
    again = plan("double_pendulum", **swing(guess=as_guess(first, first.question.robot)))
    assert again["cost"] == pytest.approx(first["cost"], rel=1e-8)
    assert again.solver["iterations"] < 0.7 * first.solver["iterations"]


def test_more_starts_find_a_better_way_up():
    """Raised to the level, the lower link may swing there or be lifted."""
    level = swing(duration=1.5, intervals=10, end={"coordinates": {"upper": np.pi / 2, "lower": 0.0}})
    one, four = (plan("double_pendulum", **level, guess={"starts": starts}) for starts in (1, 4))
    assert len(one.details["attempts"]) == 1 and len(four.details["attempts"]) == 4
    assert four["cost"] < 0.98 * one["cost"]


# Symmetry, units, names, resampling


def test_a_plan_to_the_left_is_the_mirror_image_of_one_to_the_right():
    left, right = (plan("cartpole", **cart(way)) for way in (-0.5, 0.5))
    for x in ("q", "qd", "u"):
        np.testing.assert_allclose(left.arrays[x], -right.arrays[x], atol=1e-7 * np.abs(right.arrays[x]).max())


def test_mirrored_goals_of_modules_exchange_mirrored_chambers():
    """The chambers p1 and p2 are images of each other in the plane x = 0."""
    there, back = (plan("stiff_flop_two_modules_coarse", **reach(x)) for x in (0.02, -0.02))
    assert back["cost"] == pytest.approx(there["cost"], rel=1e-8)
    u = there.arrays["u"]
    np.testing.assert_allclose(back.arrays["u"], u[:, [0, 2, 1, 3, 5, 4]], atol=1e-5 * u.max())
    assert np.abs(u[:, 1] - u[:, 2]).max() > 0.1 * u.max()


def pendulum(length=1.0, force=1.0, names=("upper", "lower"), motors=("shoulder", "elbow")):
    """Mapping of the double pendulum's robot in units of 1/length metres and 1/force newtons, names as given."""
    mass, inertia, torque, segments, parent = force / length, force * length, force * length, {}, "world"
    for name, size, own in zip(names, (1.0, 2.0), (0.083, 0.33), strict=True):
        body = {"mass": mass, "com": [0, 0, -size * length / 2], "inertia": [own * inertia, own * inertia, 0]}
        segments[name] = {"type": "revolute", "parent": parent, "axis": [0, -1, 0], "body": body,
                          "tip": {"position": [0, 0, -size * length]}}  # fmt: skip
        parent = name
    joints = dict(zip(("shoulder", "elbow"), names, strict=True))
    limits = {"shoulder": SHOULDER * torque, "elbow": ELBOW * torque}
    order = {own: motor for own, motor in zip(("shoulder", "elbow"), motors, strict=True)}
    if motors[0] > motors[1]:
        order = dict(reversed(order.items()))
    actuators = {motor: {"type": "joint_torque", "joint": joints[own], "limits": [-limits[own], limits[own]]}
                 for own, motor in order.items()}  # fmt: skip
    return {"schema_version": 1, "gravity": [0, 0, -G * length], "segments": segments, "actuators": actuators}


def test_the_units_of_length_and_force_do_not_matter():
    goal = {"goals": tip("lower", 1.2, None, -2.6), "velocity": "rest"}
    other = {"goals": tip("lower", 1.2e3, None, -2.6e3)}
    mine, theirs = plan(pendulum(), **swing(end=goal)), plan(pendulum(1e3, 1.0), **swing(end=other))
    np.testing.assert_allclose(theirs.arrays["q"], mine.arrays["q"], atol=1e-6)
    np.testing.assert_allclose(theirs.arrays["u"] / 1e3, mine.arrays["u"], atol=1e-5)
    assert theirs["cost"] == pytest.approx(mine["cost"], rel=1e-8)


def test_names_and_the_order_of_motors_do_not_matter():
    own = plan("double_pendulum", **swing()).arrays
    named = pendulum(names=("thigh", "calf"), motors=("second", "first"))
    other = plan(named, **swing(end={"coordinates": {"thigh": 0.8, "calf": -0.5}}))
    assert list(other.question.robot.inputs) == ["first", "second"]
    np.testing.assert_allclose(other.arrays["q"], own["q"], atol=1e-7)
    np.testing.assert_allclose(other.arrays["u"][:, ::-1], own["u"], atol=1e-5)


def test_a_plan_sampled_again_is_the_plan():
    result = plan("double_pendulum", **swing(waypoints={"via": {"time": 0.5, "coordinates": {"upper": 0.6}}}))
    again = resampled(result, result.arrays["t"][50:150:7])
    for name in ("t", "q", "qd", "qdd", "u", "ud", "lower.position"):
        np.testing.assert_allclose(again[name], result.arrays[name][50:150:7], rtol=1e-12, atol=1e-12)
