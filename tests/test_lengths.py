"""Inputs given by length, at rest and in motion: closed forms, the way back from tensions, and other integrators."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from robots import ROBOTS
from robots import robot as robot_of
from scipy.integrate import solve_ivp

import socontrol as so
from socontrol.files.loader import FileError
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.complementarity import complementary, least
from socontrol.programs.equilibria.held_balance import HeldBalance
from socontrol.programs.equilibria.lengths import Held, Routes, given_by_length, held
from socontrol.programs.motions.conditions import Conditions, Constrained
from socontrol.programs.motions.held_march import HeldMarcher
from socontrol.programs.motions.integrators import Radau
from socontrol.programs.motions.plant import Plant
from socontrol.programs.motions.signals import History

E, RADIUS, LENGTH, Y = 110e3, 0.01, 0.25, 0.008
AREA, INERTIA = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4
GIVES = 1 / (E * AREA) + Y**2 / (E * INERTIA)  # shortening of a cable's route per length and newton
CABLES = {f"c{i}": [Y * float(np.cos(a)), Y * float(np.sin(a))] for i, a in enumerate(2 * np.pi * np.arange(3) / 3)}


def arm(cables=("c0",), strains="kirchhoff_love", gravity=(0, 0, 0), sections=1, viscosity=300, **of_cable):
    rod = {
        "type": "rod", "length": LENGTH, "strains": strains, "sections": sections,
        "cross_section": {"type": "circle", "radius": RADIUS},
        "material": {"type": "linear", "young_modulus": E, "poisson_ratio": 0, "density": 1080, "viscosity": viscosity},
    }  # fmt: skip
    lines = {name: {"type": "tendon", "along": ["arm"], "offset": CABLES[name], **of_cable} for name in cables}
    return so.robot({"name": "r", "gravity": list(gravity), "segments": {"arm": rod}, "actuators": lines})


def at_rest(robot, **more):
    return so.solve(so.problem({"type": "statics", "robot": robot, "discretisation": False, **more}))


def moved(robot, stop, every, solver="radau", tolerance=1e-6, **more):
    settings = {"type": solver, **({"tolerance": tolerance} if solver == "radau" else {"step": every / 4})}
    times = {"stop": stop, "every": every}
    return so.solve(so.problem({"type": "simulation", "robot": robot, "times": times, "solver": settings, **more}))


def ramp(first, last, stop):
    return {"type": "ramp", "from": first, "to": last, "stop": stop}


def tensions(result):
    return {key[7:]: v.value for key, v in result.values.items() if key.startswith("inputs.")}


# At rest


@pytest.mark.parametrize("length", [0.249, 0.19])
def test_the_tension_of_a_wound_cable_is_that_of_the_closed_form(length):
    """Curvature T y/(E J) and stretch 1 - T/(E A): l = L (1 - T (1/(E A) + y^2/(E J)))."""
    result = at_rest(arm(), lengths={"c0": length}).require()
    np.testing.assert_allclose(result["inputs.c0"], (1 - length / LENGTH) / GIVES, rtol=1e-9)
    assert result["lengths.c0"] == pytest.approx(length, abs=1e-12)


def test_a_cable_that_stretches_pulls_less():
    """L0 (1 + T/EA) = L (1 - T gives)."""
    for EA in (10.0, 1e3, 20e3):
        result = at_rest(arm(stiffness=EA), lengths={"c0": 0.23}).require()
        np.testing.assert_allclose(result["inputs.c0"], (LENGTH - 0.23) / (0.23 / EA + LENGTH * GIVES), rtol=1e-9)
        np.testing.assert_allclose(result["lengths.c0"], 0.23 * (1 + result["inputs.c0"] / EA), rtol=1e-12)


@cache
def shared(name):
    if name in ROBOTS:
        return robot_of(name)
    return so.load_robot(f"configs/robots/{name}.yaml")


def lines_of(robot):
    """Names of cables and chambers."""
    return [name for name, a in robot.description.actuators.items() if a.unit in ("N", "Pa")]


LINED = ["threaded", "guided", "chambers", "octopus_arm", "stiff_flop", "guided_finger"]


@pytest.mark.parametrize("name", LINED)
def test_the_lengths_of_an_answer_ask_for_its_tensions_again(name):
    """Any routing, chambers and friction: forward with inputs, back with the lengths found."""
    robot, rng = shared(name), np.random.default_rng(2)
    plain, names = Balance(robot), lines_of(robot)
    u = np.array([0.3 * min(size, 1e5) for size in plain.scales.u]) * rng.uniform(0.3, 1, robot.m)
    there = plain.solve(u)
    assert there.status.solved
    lengths, index = Routes(robot)(there.q)[0].copy(), [robot.inputs.index(n) for n in names]

    class Asked:
        inputs = motors = volumes = None

    Asked.robot, Asked.lengths = robot, dict(zip(names, lengths[index], strict=True))
    guess = u.copy()
    guess[index] = 0.0
    back = HeldBalance(robot, held(robot, given_by_length(Asked), lengths[index])).solve(guess)
    assert back.status.solved, back.status.message
    np.testing.assert_allclose(back.q / plain.scales.q, there.q / plain.scales.q, atol=1e-9)
    if not back.redundant:
        np.testing.assert_allclose(back.u / plain.scales.u, u / plain.scales.u, atol=1e-7)


def test_a_cable_that_is_too_long_is_slack():
    robot = arm(("c0", "c1"), "inextensible_constant_curvature", gravity=(0, 0, -1))
    alone = at_rest(robot, lengths={"c0": 0.24}).require()
    route = alone["lengths.c1"]
    for extra, is_slack in ((2e-3, True), (-2e-3, False)):
        result = at_rest(robot, lengths={"c0": 0.24, "c1": route + extra}).require()
        assert (result["inputs.c1"] == 0) is is_slack
        assert ("Slack: c1" in result.status.message) is is_slack
        assert result["lengths.c1"] == pytest.approx(route + min(extra, 0), abs=1e-12)
        if is_slack:
            np.testing.assert_allclose(result.arrays["q"], alone.arrays["q"], rtol=1e-9, atol=1e-12)


def test_of_lengths_that_depend_on_each_other_the_least_tensions_are_taken():
    """On an inextensible arm l0 + l1 + l2 = 3 L, and (1, 1, 1) does nothing: the least is 0 somewhere."""
    robot = arm(tuple(CABLES), "inextensible_constant_curvature", sections=2)
    there = at_rest(robot, inputs={"c0": 0.5, "c1": 0.9, "c2": 0.2}).require()
    lengths, far = {name: there[f"lengths.{name}"] for name in CABLES}, dict.fromkeys(CABLES, 1.5)
    result = at_rest(robot, lengths=lengths, guess={"inputs": far}).require()
    assert "depend on each other" in result.status.message
    found = np.array(list(tensions(result).values()))
    np.testing.assert_allclose(found, [0.3, 0.7, 0.0], atol=1e-8)
    np.testing.assert_allclose(result.arrays["q"], there.arrays["q"], atol=1e-8)


@pytest.mark.parametrize("stiffness", [None, 500.0])
def test_lengths_that_contradict_each_other_have_no_answer_unless_cables_stretch(stiffness):
    robot = arm(tuple(CABLES), "inextensible_constant_curvature", **({"stiffness": stiffness} if stiffness else {}))
    result = at_rest(robot, lengths=dict.fromkeys(CABLES, 0.24))
    if stiffness:
        strain = LENGTH / 0.24 - 1
        np.testing.assert_allclose(list(tensions(result.require()).values()), stiffness * strain, rtol=1e-9)
    else:
        assert result.status.exit_code == 4
        assert "c0, c1 and c2 at 240, 240 and 240 mm" in result.status.message


def test_angles_and_volumes_are_lengths():
    robot = arm(tuple(CABLES), spool=0.01)
    angles = {"c0": 1.0, "c1": 0.4, "c2": 0.2}
    wound = at_rest(robot, motors={"c0": 1.0, "c1": "0.4 rad", "c2": 0.2}).require()
    same = at_rest(robot, lengths={name: LENGTH - 0.01 * x for name, x in angles.items()}).require()
    np.testing.assert_allclose(wound.arrays["u"], same.arrays["u"], rtol=1e-9)
    for name, x in angles.items():
        assert wound[f"motors.{name}"] == pytest.approx(x, abs=1e-9)
    flop = shared("stiff_flop")
    filled = at_rest(flop, volumes={"p1": "2.2 cm^3"}).require()
    long = at_rest(flop, lengths={"p1": 2.2e-6 / 19.635e-6}).require()
    assert filled["volumes.p1"] == pytest.approx(2.2e-6, rel=1e-12)
    assert filled["inputs.p1"] == pytest.approx(long["inputs.p1"], rel=1e-9) and filled["inputs.p0"] == 0


def test_held_lengths_steady_what_given_tensions_do_not():
    """A mass leans on a hinge against a cable: the cable's length holds it, a given tension would let it fall."""
    link = {"type": "revolute", "axis": [0, 1, 0], "body": {"mass": 1, "com": [0.3, 0, 0]},
            "placement": {"rotation": [0, "-90 deg", 0]}, "tip": {"position": [0.3, 0, 0]}}  # fmt: skip
    cables = {f"c{i}": {"type": "tendon", "along": ["link"], "offset": [0, z], "limits": [0, 50]}
              for i, z in enumerate((0.05, -0.05))}  # fmt: skip
    robot = so.robot({"name": "r", "segments": {"link": link}, "actuators": cables})
    near = {"inputs": {"c1": 10}, "coordinates": {"link": -0.2}}
    held = at_rest(robot, lengths={"c1": 0.31}, guess=near).require()
    assert abs(held["coordinates.link"]) < 0.5
    assert held.details["stable"] and held["inputs.c1"] > 0
    angle = {"coordinates": {"link": held["coordinates.link"]}}
    pulled = at_rest(robot, inputs={"c1": held["inputs.c1"]}, guess=angle).require()
    assert pulled["coordinates.link"] == pytest.approx(held["coordinates.link"]) and not pulled.details["stable"]


def test_small_problems_of_the_least_equal_the_best_of_all_active_sets():
    rng = np.random.default_rng(3)
    for k, d in product((2, 3, 5), (1, 2)):
        null = np.linalg.qr(rng.standard_normal((k, d)))[0]
        x = np.abs(rng.standard_normal(k))
        best = min(_feasible(x, null), key=np.linalg.norm)
        np.testing.assert_allclose(least(x, null, np.ones(k, dtype=bool)), best, atol=1e-10)
        A = rng.standard_normal((k, k))
        G, b = A @ A.T + 0.1 * np.eye(k), rng.standard_normal(k)
        z = complementary(G, b, np.ones(k, dtype=bool))
        w = G @ z - b
        assert np.all(z >= 0) and np.all(w >= -1e-9) and abs(z @ w) < 1e-9


def _feasible(x, null):
    """Points x + null z >= 0 with as many zeros as some active set, nearest to 0 within it."""
    for zeros in product((False, True), repeat=x.size):
        rows = np.array(zeros)
        base = x - null @ (null.T @ x)
        z = np.linalg.lstsq(null[rows], -base[rows], rcond=None)[0] if rows.any() else np.zeros(null.shape[1])
        y = base + null @ z
        if np.all(y >= -1e-10):
            yield y


SPOOL = {"spool": 0.01}
BAD = {
    "twice": ({"lengths": {"c0": 0.24}, "inputs": {"c0": 1}}, "'c0' is given under `inputs` already"),
    "thrice": ({"lengths": {"c0": 0.24}, "motors": {"c0": 1}}, "motors.c0: 'c0' is given under `lengths` already"),
    "unknown": ({"lengths": {"cO": 0.24}}, "no input 'cO'"),
    "a cable has no volume": ({"volumes": {"c0": 1e-6}}, "'c0' is a cable"),
    "none": ({"lengths": {"c0": 0}}, "lengths.c0"),
    "all": ({"motors": {"c0": "30 turn"}}, "winds in all of the cable"),
    "a unit": ({"motors": {"c0": "1 N"}}, "1 N is a force"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_a_length_is_refused_in_one_line(name):
    asked, sentence = BAD[name]
    with pytest.raises(FileError, match=".*") as caught:
        at_rest(arm(**SPOOL), **asked)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


# In motion


def lift(**of_cable):
    """A mass of 2 kg that slides down, along x, on a cable through holes 0.1 m apart; its length is 0.1 m + q."""
    slide = {"type": "prismatic", "axis": [1, 0, 0], "body": {"mass": 2.0}, "tip": {"position": [0.1, 0, 0]}}
    cable = {"type": "tendon", "along": ["slide"], "offset": [0, 0], "limits": [0, 100], **of_cable}
    return so.robot({"name": "r", "gravity": [10, 0, 0], "segments": {"slide": slide}, "actuators": {"c0": cable}})


def test_a_falling_mass_is_caught_by_its_cable():
    """q = g t^2 / 2 until the cable is taut at 0.2 m, then it hangs: T = m g; what falls is lost."""
    result = moved(lift(), 0.5, 0.01, lengths={"c0": 0.3}).require()
    t, q, T = result.arrays["t"], result.arrays["q"][:, 0], result.arrays["u"][:, 0]
    np.testing.assert_allclose(q, np.minimum(5 * t**2, 0.2), atol=1e-9)
    np.testing.assert_allclose(T, np.where(t > 0.2, 20.0, 0.0), atol=1e-7)
    np.testing.assert_allclose(result.arrays["qd"][t > 0.2], 0, atol=1e-9)
    assert result["work.inputs"] == pytest.approx(-2 * 10 * 0.2, rel=1e-6)
    assert result.details["slack"]["c0"] == pytest.approx(0.2, abs=1e-6)
    assert "Slack for a time: c0" in result.status.message


def test_a_mass_that_is_let_down_faster_than_it_falls_is_slack_for_a_while():
    """T = m (g - L'') while taut; slack from L'' = g until the fall from there meets L(t) again."""
    result = moved(lift(), 1.0, 0.005, lengths={"c0": {"type": "sinusoid", "mean": 0.5, "amplitude": 0.3, "period": 1,
                                                       "phase": "-90 deg"}},
                   start={"coordinates": {"slide": 0.1}}).require()  # fmt: skip
    t, q, T = result.arrays["t"], result.arrays["q"][:, 0], result.arrays["u"][:, 0]
    w = 2 * np.pi
    L, second = 0.5 - 0.3 * np.cos(w * t), 0.3 * w**2 * np.cos(w * t)
    fall, taut = 0.2 + 5 * t**2, T > 0  # slack at once: L'' = 0.3 w^2 > g
    caught = t[taut][0]
    before, late = t < caught, fall > L + 1e-4
    np.testing.assert_allclose((q + 0.1)[before], fall[before], atol=1e-8)
    assert caught == pytest.approx(t[late & (t > 0.1)][0], abs=0.006)
    np.testing.assert_allclose((q + 0.1)[taut], L[taut], atol=1e-9)
    np.testing.assert_allclose(T[taut], 2 * (10 - second[taut]), atol=1e-5)
    assert np.all(q + 0.1 <= L + 1e-9) and np.all(T >= -1e-5)
    assert sum(taut for _, _, taut in result.details["changes"]) < len(result.details["changes"])


@cache
def wound(solver="radau", stiffness=None, tolerance=1e-7):
    robot = arm(("c0", "c1"), "inextensible_constant_curvature", (0, 0, -1), 2, viscosity=3000,
                **({"stiffness": stiffness} if stiffness else {}))  # fmt: skip
    swing = {"type": "sinusoid", "mean": 0.248, "amplitude": 0.001, "period": 1, "phase": "90 deg"}  # at rest at first
    asked = {"c0": ramp(0.245, 0.235, 0.5), "c1": swing}
    result = moved(robot, 1.0, 0.02, solver, tolerance, lengths=asked, start={"settled": True})
    return result.require()


def test_a_wound_arm_keeps_its_lengths_and_pays_for_them():
    result = wound()
    assert max(r.residuals["lengths"].value for r in (result, wound(tolerance=1e-3))) < 1e-10
    assert result.residuals["energy"].value < 1e-6
    t, T, l = (result.arrays[key] for key in ("t", "u", "lengths"))
    fine = np.linspace(0, 1, 2001)
    x = np.minimum(fine / 0.5, 1)
    rates = np.stack([-0.01 / 0.5 * 30 * (x * (1 - x)) ** 2 * (fine < 0.5), -0.002 * np.pi * np.sin(2 * np.pi * fine)])
    paid = -sum(np.trapezoid(np.interp(fine, t, T[:, k]) * rates[k], fine) for k in range(2))
    assert np.all(T > 0)
    assert result["work.inputs"] == pytest.approx(paid, rel=2e-3)
    np.testing.assert_allclose(l[-1], [0.235, 0.249], atol=1e-9)


def test_two_integrators_agree_on_tensions():
    a, b = wound(), wound("gauss")
    np.testing.assert_allclose(a.arrays["u"], b.arrays["u"], atol=1e-4 * np.max(a.arrays["u"]))
    np.testing.assert_allclose(a.arrays["arm.position"], b.arrays["arm.position"], atol=1e-7)


def test_stiff_cables_tend_to_cables_that_do_not_stretch():
    """The way off is their stretch, as 1/EA."""
    rigid = wound().arrays["arm.position"]
    off = [np.max(np.abs(wound(stiffness=EA).arrays["arm.position"] - rigid)) for EA in (1e3, 1e4)]
    assert 5 < off[0] / off[1] < 20 and off[1] < 2e-3


def test_a_wound_arm_comes_to_rest_where_statics_says():
    robot = arm(tuple(CABLES), gravity=(0, 0, -1), sections=2, viscosity=30e3, spool=0.01)
    motors = {"c0": ramp(0, 1.2, 0.4), "c1": ramp(0, 0.3, 0.4), "c2": 0.1}
    start = {"settled": True}
    moving = moved(robot, 8.0, 0.1, tolerance=1e-4, motors=motors, start=start).require()
    resting = at_rest(robot, motors={"c0": 1.2, "c1": 0.3, "c2": 0.1}).require()
    np.testing.assert_allclose(moving.arrays["u"][-1], resting.arrays["u"], atol=1e-5)
    np.testing.assert_allclose(moving["arm.position"], resting["arm.position"], atol=1e-6)
    for name in ("motors.c0", "lengths.c1", "inputs.c2"):
        assert moving[name] == pytest.approx(resting[name], abs=1e-5)


def double_pendulum():
    """Two links with a cable over both."""
    body, tip = {"mass": 0.5, "com": [0.2, 0, 0], "inertia": [0.001, 0.004, 0.004]}, {"position": [0.3, 0, 0]}
    link = {"type": "revolute", "axis": [0, 1, 0], "body": body, "tip": tip, "damping": 0.02}
    cable = {"type": "tendon", "along": ["a", "b"], "offset": [0, -0.05], "limits": [0, 100]}
    segments = {"a": link, "b": {**link, "parent": "a"}}
    return so.robot({"name": "r", "segments": segments, "actuators": {"c0": cable}})


def test_a_held_cable_moves_links_as_multipliers_do_in_another_integrator():
    """M q'' + h = -A^T T, A q'' + A' q' = L'': solved at each call of an explicit integrator; A by differences."""
    robot = double_pendulum()
    f, n = robot.functions(), robot.n

    def route(q):
        return float(f.actuator_lengths(q))

    def slopes(q, h=1e-5):
        return np.array([(route(q + h * e) - route(q - h * e)) / (2 * h) for e in np.eye(n)])

    q0 = np.array([0.3, 0.2])
    first = route(q0)

    def accelerations(t, x):
        q, v = x[:n], x[n:]
        A, h = slopes(q), 1e-5
        turning = (slopes(q + h * v) - slopes(q - h * v)) @ v / (2 * h)
        matrix = np.block([[f.mass(q).full(), A[:, None]], [A[None, :], np.zeros((1, 1))]])
        right = np.concatenate([-f.inverse_dynamics(q, v, np.zeros(n)).full().ravel(), [-0.05 * np.cos(t) - turning]])
        return np.linalg.solve(matrix, right)

    history = {"type": "sinusoid", "mean": first - 0.05, "amplitude": 0.05, "period": 2 * np.pi, "phase": np.pi / 2}
    result = moved(robot, 0.1, 0.01, tolerance=1e-9, start={"coordinates": {"a": q0[0], "b": q0[1]}},
                   lengths={"c0": history}).require()  # fmt: skip
    other = solve_ivp(lambda t, x: np.concatenate([x[n:], accelerations(t, x)[:n]]), (0, 0.1), [*q0, 0, 0],
                      t_eval=result.arrays["t"], rtol=1e-8, atol=1e-10)  # fmt: skip
    T = [accelerations(t, x)[n] for t, x in zip(other.t, other.y.T, strict=True)]
    assert np.min(T) > 0
    np.testing.assert_allclose(result.arrays["q"], other.y[:n].T, atol=1e-6)
    np.testing.assert_allclose(result.arrays["u"][:, 0], T, rtol=1e-4)


def test_conditions_need_not_be_cables():
    """Two links tied by q0 + q1 = 0: one coordinate s, (1, -1) . inverse_dynamics = 0."""
    import casadi as ca

    robot = double_pendulum()
    f, z = robot.functions(), np.array([1.0, -1.0])
    q, qd = ca.SX.sym("q", 2), ca.SX.sym("qd", 2)
    tied = ca.Function("tied", [q, qd], [q[0] + q[1], ca.DM.ones(1, 2), ca.DM(1, 1)])
    one = np.ones(1)
    conditions = Conditions(tied, (History(lambda t: ca.DM(0)),), ("tie",), np.zeros(1, dtype=bool), 0 * one,
                            np.array([-1]), one)  # fmt: skip
    plant = Plant(robot, [History(lambda t: ca.DM(0))], {}, {})
    times = np.linspace(0, 0.5, 11)
    plant = Constrained(plant, conditions)
    march = HeldMarcher(plant, Radau(tolerance=1e-9), times, np.full(2, 0.3), 0.6)
    found = march.run(0.4 * z, np.zeros(2))
    assert found.status.solved
    state = 0.0, plant.extended(0.4 * z), np.zeros(3)
    assert np.max(np.abs(plant.residual(*state, plant.acceleration(*state)))) < 1e-9

    def reduced(t, x):
        rest, mass = (f.inverse_dynamics(z * x[0], z * x[1], a).full().ravel() for a in (np.zeros(2), z))
        return [x[1], -(z @ rest) / (z @ (mass - rest))]

    other = solve_ivp(reduced, (0, 0.5), [0.4, 0.0], t_eval=times, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(np.array(found.q), np.outer(other.y[0], z), atol=1e-7)


@pytest.mark.parametrize("what", ["start", "cvodes", "inputs", "length"])
def test_a_motion_that_cannot_hold_its_lengths_is_refused_in_one_line(what):
    more = {
        "start": ({"lengths": {"c0": 0.24}}, "'c0' is 250 mm long at the start, but given 240 mm"),
        "cvodes": ({"lengths": {"c0": 0.26}, "solver": {"type": "cvodes"}}, "cvodes cannot hold lengths"),
        "inputs": ({"lengths": {"c0": 0.24}, "start": {"settled": True, "inputs": {"c0": 1}}}, "given by its length"),
        "length": ({"lengths": {"c0": ramp(0.25, -0.1, 0.5)}}, "is no length"),
    }[what]
    asked = {"type": "simulation", "robot": arm(), "times": {"stop": 1, "every": 0.1}, **more[0]}
    with pytest.raises(FileError) as caught:
        so.problem(asked)
    assert more[1] in str(caught.value) and "\n" not in str(caught.value)


def test_lengths_that_contradict_each_other_stop_a_motion_in_a_sentence():
    robot = arm(tuple(CABLES), "inextensible_constant_curvature")
    result = moved(robot, 0.5, 0.05, lengths={name: ramp(LENGTH, LENGTH - 0.01, 0.5) for name in CABLES})
    assert result.status.exit_code == 4 and "no posture nearby holds c" in result.status.message
    assert result.arrays["t"][-1] < 0.1


def test_held_without_some_is_the_rest():
    length, one = np.array([0.24, 0.23]), np.ones(2)
    both = Held(np.array([0, 2]), ("c0", "c2"), length, 0 * one, -one, one > 0)
    last = both.without([0])
    assert last.names == ("c2",) and not both.without([0, 2])
    l = Routes(arm(tuple(CABLES)))(np.zeros(4))[0]
    np.testing.assert_allclose(last.gap(l, np.zeros(3)), [0.23 - LENGTH])
