"""Motions of robots with loops against closed forms, other equations of the same motion, and laws."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from printed import words
from ruamel.yaml import YAML
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import socontrol as so
from socontrol.cli import app
from socontrol.files.loader import FileError
from socontrol.quantities import Bad
from socontrol.report.motion_loops import loops_figure

ROOT = Path(__file__).parents[1]
G, TURN = 9.81, 2 * np.pi
OPEN = {"coupler": -0.2, "rocker": 1.2}  # the branch of the four-bar with its pin above the ground
FINE = {"type": "radau", "tolerance": 1e-7}


def simulated(robot, stop=1.0, every=None, solver=FINE, **more):
    times = {"stop": stop, "every": every or stop / 20}
    mapping = {"schema_version": 1, "type": "simulation", "robot": robot, "times": times, "solver": solver, **more}
    return so.problem(mapping).solve()


def plain(name):
    return YAML(typ="safe").load((ROOT / "configs/robots" / f"{name}.yaml").read_text())


def robot_of(segments, loops=None, gravity=(0, -G, 0), **more):
    loops = {"loops": loops} if loops else {}
    return {"schema_version": 1, "name": "r", "gravity": list(gravity), "segments": segments, **loops, **more}


def bar(length, parent="world", x=0.0, mass=0.2, **more):
    inertia = mass * length**2 / 12
    body = {"mass": mass, "com": [length / 2, 0, 0], "inertia": [1e-6, inertia, inertia]}
    placed = {"placement": {"position": [x, 0, 0]}}
    return {"type": "revolute", "axis": [0, 0, 1], "parent": parent, **placed, "body": body,
            "tip": {"position": [length, 0, 0]}, **more}  # fmt: skip


def pin(a, b, **more):
    return {"type": "revolute", "axis": [0, 0, 1], "a": {"segment": a}, "b": {"segment": b}, **more}


def closed(result):
    """Asserts that a motion was solved with its loops closed in positions and rates, and returns it."""
    result.require()
    assert result.residuals["loops"].value < 1e-9 and result.residuals["loops.rate"].value < 1e-9
    return result


def lossless(result, tolerance=1e-4):
    """Asserts that loops did no work."""
    energy, work = result.arrays["energy"].sum(axis=1), result.arrays["work"].sum(axis=1)
    left = np.abs(energy - energy[0] - work)
    assert np.max(left) < tolerance * np.max(result.arrays["energy"][:, 0])
    return result


# The four-bar and the slider-crank, by one angle


class FourBar:
    """configs/robots/four_bar.yaml by complex numbers: its pin is where two circles meet."""

    a, b, c, d = 0.1, 0.25, 0.2, 0.22
    m, inertia = (0.2, 0.5, 0.4), (1.666667e-4, 2.604167e-3, 1.333333e-3)

    def angles(self, t):
        """Of coupler and rocker."""
        P = self.a * np.exp(1j * t)
        D = self.d - P
        x = (abs(D) ** 2 + self.b**2 - self.c**2) / (2 * abs(D))
        pin = P + D / abs(D) * (x + 1j * np.sqrt(self.b**2 - x**2))
        return np.angle(pin - P), np.angle(pin - self.d)

    def rates(self, t):
        """Of coupler and rocker, for a crank at 1 rad/s."""
        p, s = self.angles(t)
        A = [[-self.b * np.sin(p), self.c * np.sin(s)], [self.b * np.cos(p), -self.c * np.cos(s)]]
        return np.linalg.solve(A, [self.a * np.sin(t), -self.a * np.cos(t)])

    def inertia_of(self, t):
        (p, _), (dp, ds) = self.angles(t), self.rates(t)
        speed = abs(self.a * np.exp(1j * t) + self.b / 2 * np.exp(1j * p) * dp)
        return (self.m[0] * (self.a / 2) ** 2 + self.inertia[0] + self.m[1] * speed**2 + self.inertia[1] * dp**2
                + (self.m[2] * (self.c / 2) ** 2 + self.inertia[2]) * ds**2)  # fmt: skip

    def potential(self, t):
        p, s = self.angles(t)
        heights = (self.a / 2 * np.sin(t), self.a * np.sin(t) + self.b / 2 * np.sin(p), self.c / 2 * np.sin(s))
        return G * np.dot(self.m, heights)


class SliderCrank:
    """configs/robots/slider_crank.yaml."""

    a, b = 0.08, 0.24

    def reach(self, t):
        return self.a * np.cos(t) + np.sqrt(self.b**2 - (self.a * np.sin(t)) ** 2)

    def inertia_of(self, t):
        root = np.sqrt(self.b**2 - (self.a * np.sin(t)) ** 2)
        dp = -self.a * np.cos(t) / root
        dx = -self.a * np.sin(t) * (1 + self.a * np.cos(t) / root)
        middle = np.array([-self.a * np.sin(t) + self.a / 2 * np.sin(t) * dp, self.a / 2 * np.cos(t)])
        return 0.3 * (self.a / 2) ** 2 + 1.6e-4 + 0.4 * middle @ middle + 1.92e-3 * dp**2 + 0.5 * dx**2

    def potential(self, t):
        return 0.35 * G * self.a * np.sin(t) + 500 * (self.reach(t) - 0.2) ** 2


def slope(f, t, h=1e-3):
    """Central differences of order 6."""
    return sum(w * (f(t + k * h) - f(t - k * h)) for k, w in ((1, 45), (2, -9), (3, 1))) / (60 * h)


def torque(chain, t, rate):
    """What turns a crank at a constant rate."""
    return slope(chain.inertia_of, t) * rate**2 / 2 + slope(chain.potential, t)


def test_a_driven_four_bar_follows_the_circles_and_its_motor_what_one_angle_asks_for():
    driven = {"crank": {"type": "rate", "rate": TURN, "from": 0.7}}
    result = closed(simulated(plain("four_bar"), 1.0, 0.02, {"type": "radau"}, start={"coordinates": OPEN},
                              coordinates=driven))  # fmt: skip
    chain, t = FourBar(), 0.7 + TURN * result.arrays["t"]
    q = result.arrays["q"]
    p, s = np.array([chain.angles(x) for x in t]).T
    np.testing.assert_allclose(np.exp(1j * (q[:, 0] + q[:, 1])), np.exp(1j * p), atol=1e-11)
    np.testing.assert_allclose(np.exp(1j * q[:, 2]), np.exp(1j * s), atol=1e-11)
    wanted = np.array([torque(chain, x, TURN) for x in t[::10]])
    np.testing.assert_allclose(result.arrays["holding.crank"][::10], wanted, atol=1e-9 * np.max(np.abs(wanted)))
    assert result["holding.crank"] == result.arrays["holding.crank"][-1]
    assert result.details["redundant_rows"] == {"pin": 3} and not result.details["singular"]


def test_a_driven_slider_crank_moves_its_piston_in_closed_form():
    start = {"coordinates": {"rod": -0.3, "piston": 0.27}}
    result = lossless(closed(simulated(plain("slider_crank"), 1.0, 0.02, {"type": "radau"}, start=start,
                                    coordinates={"crank": {"type": "rate", "rate": TURN, "from": 1.0}})))  # fmt: skip
    t = 1.0 + TURN * result.arrays["t"]
    np.testing.assert_allclose(result.arrays["q"][:, 2], SliderCrank().reach(t), atol=1e-12)
    wanted = [torque(SliderCrank(), x, TURN) for x in t[::10]]
    np.testing.assert_allclose(result.arrays["holding.crank"][::10], wanted, atol=1e-9 * np.max(np.abs(wanted)))


@pytest.mark.parametrize(("name", "chain", "rate"), [("four_bar", FourBar(), 14.0), ("slider_crank", SliderCrank(), 5)])
def test_free_chains_move_as_the_equation_of_their_one_angle_says(name, chain, rate):
    def equation(t, y):
        turned = slope(chain.inertia_of, y[0]) * y[1] ** 2 / 2 + slope(chain.potential, y[0])
        return [y[1], -turned / chain.inertia_of(y[0])]

    start = {"coordinates": {"crank": 0.7}, "rates": {"crank": rate}}
    result = lossless(closed(simulated(plain(name), 0.3, start=start)), 1e-6)
    wanted = solve_ivp(equation, (0, 0.3), [0.7, rate], "DOP853", result.arrays["t"], rtol=1e-9, atol=1e-9).y
    np.testing.assert_allclose(result.arrays["q"][:, 0], wanted[0], atol=1e-5)
    np.testing.assert_allclose(result.arrays["qd"][:, 0], wanted[1], atol=1e-4 * np.max(np.abs(wanted[1])))


def test_a_torque_turns_the_chain_as_it_turns_its_one_angle():
    result = closed(simulated(plain("four_bar"), 2e-3, 1e-3, start={"coordinates": {"crank": 0.7}},
                              inputs={"motor": 2.0}))  # fmt: skip
    chain = FourBar()
    wanted = (2.0 - slope(chain.potential, 0.7)) / chain.inertia_of(0.7)
    f = so.robot(plain("four_bar")).functions()
    q, qd, u = (result.arrays[key][0] for key in ("q", "qd", "u"))
    np.testing.assert_allclose(np.array(f.forward_dynamics(q, qd, u))[0], wanted, rtol=1e-8)
    np.testing.assert_allclose(result.arrays["q"][-1, 0] - 0.7, wanted * 2e-3**2 / 2, rtol=1e-2)


# Other ways to say the same


def rod(length, **more):
    circle = {"type": "circle", "radius": 0.01}
    material = {"type": "linear", "young_modulus": 3e5, "poisson_ratio": 0.5, "density": 1000, "viscosity": 300}
    return {"type": "rod", "length": length, "strains": "inextensible_kirchhoff_love", "sections": 1, "quadrature": 4,
            "cross_section": circle, "material": material, **more}  # fmt: skip


def hung(cut, **more):
    """Two soft rods end to end that hang sideways, their seam part of the tree or a weld; a cable runs in the first."""
    cable = {"actuators": {"cable": {"type": "tendon", "along": ["near"], "offset": [0.008, 0]}}}
    near, far = rod(0.15, **more), rod(0.15, **more)
    if not cut:
        return robot_of({"near": near, "far": far | {"parent": "near"}}, **cable)
    hand = {"type": "free", "placement": {"position": [0.15, 0, 0]}}
    weld = {"type": "fixed", "a": {"segment": "hand"}, "b": {"segment": "near"}}
    return robot_of({"near": near, "hand": hand, "far": far | {"parent": "hand"}}, {"weld": weld}, **cable)


WOUND = {"type": "ramp", "from": 0.15, "to": 0.148, "stop": 0.1}


@pytest.mark.parametrize("length", [WOUND, 0.1503], ids=["wound", "caught"])
def test_a_rod_cut_in_two_and_welded_moves_as_the_whole(length):
    """While its cable is wound in, and with a cable that is slack until it catches the falling rod."""
    more = {"lengths": {"cable": length}}
    whole, cut = simulated(hung(False), 0.2, **more), closed(simulated(hung(True), 0.2, **more))
    there, here = whole.arrays["far.position"], cut.arrays["far.position"]
    assert np.ptp(there[:, 1]) > 0.05
    np.testing.assert_allclose(here, there, atol=1e-6)
    tension = whole.arrays["u"]
    np.testing.assert_allclose(cut.arrays["u"], tension, atol=1e-4 * np.max(tension))
    assert cut.details["redundant_rows"] == {}
    assert cut.residuals["lengths"].value < 1e-9 and np.max(tension) > 0.5
    assert len(cut.details["changes"]) == len(whole.details["changes"])


def bennett():
    """Four hinges in space, lengths and twists of opposite links alike, and the tangent of half its second angle times
    that of half its first: overconstrained, as it moves although six rows hold four hinges. At 0 it is one line."""
    a, b, twist = 0.2, 0.3, 0.6
    other = float(np.arcsin(b * np.sin(twist) / a))
    segments = {f"link{k}": {**bar(length, f"link{k - 1}" if k else "world"),
                             "tip": {"position": [length, 0, 0], "rotation": [turn, 0, 0]}}
                for k, (length, turn) in enumerate(((a, twist), (b, other)) * 2)}  # fmt: skip
    weld = {"type": "fixed", "a": {"segment": "link3"}, "b": {"segment": "world"}}
    product = np.sin((other + twist) / 2) / np.sin((other - twist) / 2)
    return robot_of(segments, {"weld": weld}), product


def test_an_overconstrained_linkage_moves_as_its_one_angle_says():
    robot, product = bennett()
    start = {"coordinates": {"link0": 1.0, "link1": 2 * np.arctan(product / np.tan(0.5))}}
    result = lossless(closed(simulated(robot, 0.2, solver={"type": "radau"}, start=start)))
    q = result.arrays["q"]
    assert np.ptp(q[:, 0]) > 0.2 and not result.details["singular"]
    np.testing.assert_allclose(np.tan(q[:, 0] / 2) * np.tan(q[:, 1] / 2), product, rtol=1e-9)
    np.testing.assert_allclose(np.exp(1j * q[:, 2:]), np.exp(-1j * q[:, :2]), atol=1e-9)


@cache
def swung():
    return closed(simulated(plain("four_bar"), 0.3, start={"coordinates": {"crank": 0.7}}))


def test_the_same_loop_twice_moves_the_same_and_shares_what_is_borne():
    robot = plain("four_bar")
    robot["loops"]["ball"] = {**{k: robot["loops"]["pin"][k] for k in "ab"}, "type": "spherical"}
    twice = closed(simulated(robot, 0.3, start={"coordinates": {"crank": 0.7}}))
    np.testing.assert_allclose(twice.arrays["q"], swung().arrays["q"], atol=1e-9)
    for name in ("pin", "ball"):
        half = swung().arrays["loops.pin"] / 2
        np.testing.assert_allclose(twice.arrays[f"loops.{name}"], half, atol=1e-8 * np.max(np.abs(half)))
    assert twice.details["redundant_rows"] == {"pin": 3, "ball": 3}


@pytest.mark.parametrize("k", [0, 7])
def test_multipliers_are_those_of_the_accelerations(k):
    f, arrays = so.robot(plain("four_bar")).functions(), swung().arrays
    lam = np.array(f.loop_force(*(arrays[key][k] for key in ("q", "qd", "u")))).ravel()
    np.testing.assert_allclose(arrays["lam"][k], lam, atol=1e-7 * np.max(np.abs(lam)))
    np.testing.assert_array_equal(arrays["loops.pin"][k, 3:], arrays["lam"][k, 2:])


def test_what_has_no_mass_moves_with_the_loops():
    """A coupler without mass between two equal cranks: pendulums of the same swing, one of them pulled along."""
    segments = {"crank": bar(0.1, mass=0.6), "coupler": {**bar(0.25, "crank")}, "rocker": bar(0.1, x=0.25, mass=0.6)}
    del segments["coupler"]["body"]
    start = {"coordinates": {"crank": -1.0, "coupler": 1.0, "rocker": -1.0}}
    result = closed(simulated(robot_of(segments, {"pin": pin("coupler", "rocker")}), 0.5, start=start))
    single = simulated(robot_of({"crank": bar(0.1, mass=0.6)}), 0.5, start={"coordinates": {"crank": -1.0}})
    np.testing.assert_allclose(result.arrays["q"][:, 2], single.arrays["q"][:, 0], atol=1e-6)
    assert np.max(np.abs(result.arrays["lam"])) < 1e-5


def test_a_screw_that_closes_a_loop_is_a_screw():
    """A nut slides on the axis of a spindle; the thread turns the spindle as the nut falls."""
    inertia, mass, pitch = 2e-4, 0.5, 0.02
    segments = {"spindle": {"type": "revolute", "axis": [0, 0, 1],
                            "body": {"mass": 1, "inertia": [inertia, inertia, inertia]}},
                "nut": {"type": "prismatic", "axis": [0, 0, 1], "body": {"mass": mass}}}  # fmt: skip
    thread = {**pin("nut", "spindle"), "type": "helical", "pitch": pitch}
    result = closed(simulated(robot_of(segments, {"thread": thread}, (0, 0, -G)), 1.0))
    t, q = result.arrays["t"], result.arrays["q"]
    fall = mass * G / (mass + inertia / pitch**2) * t**2 / 2
    np.testing.assert_allclose(q[:, 1], -fall, atol=1e-9)
    np.testing.assert_allclose(q[:, 0], fall / pitch, atol=1e-7)
    assert q[-1, 0] > 3 * TURN
    wrench = result.arrays["loops.thread"][-1]
    np.testing.assert_allclose(wrench[5], mass * (G - mass * G / (mass + inertia / pitch**2)), rtol=1e-9)


# Rest


def finray():
    """The fin-ray finger with ribs of two sections and much damping, pressed."""
    robot = plain("finray")
    for name in ("front", "back"):
        robot["segments"][name]["sections"] = 2
        robot["segments"][name]["material"]["viscosity"] = 4e4
    return robot | {"loads": {"press": {"type": "wrench", "on": "front", "at": 0.5, "force": [0.3, 0, 0]}}}


def test_a_finray_finger_with_much_damping_settles_where_statics_puts_it_and_bears_as_much():
    moved = closed(simulated(finray(), 2.0, 0.5, {"type": "radau"}))
    asked = {"schema_version": 1, "type": "statics", "robot": finray(), "discretisation": False}
    rest = so.problem(asked).solve().require()
    assert np.linalg.norm(moved["front.displacement"]) > 2e-4
    np.testing.assert_allclose(moved["front.position"], rest["front.position"], atol=1e-7)
    lam = rest.arrays["lam"]
    np.testing.assert_allclose(moved.arrays["lam"][-1], lam, atol=1e-3 * np.max(np.abs(lam)))


def test_a_chain_at_rest_on_its_cable_stays_at_rest():
    """Welded as uncut: at the same place, under the same tension, which stays."""
    asked = {"start": {"settled": True}, "lengths": {"cable": 0.148}, "solver": {"type": "radau"}}
    whole, cut = (simulated(hung(cut, strains=["bend_z"]), 0.02, **asked) for cut in (False, True))
    tension = closed(cut).arrays["u"]
    assert tension[0, 0] > 0.5
    np.testing.assert_allclose(tension, np.full(tension.shape, whole.arrays["u"][0, 0]), rtol=1e-5)
    np.testing.assert_allclose(cut.arrays["far.position"], np.tile(whole["far.position"], (len(tension), 1)), atol=1e-6)


# Where rows come to depend on each other


PARALLEL = robot_of({"crank": bar(0.1), "coupler": bar(0.25, "crank", mass=0.5), "rocker": bar(0.1, x=0.25, mass=0.4)},
                    {"pin": pin("coupler", "rocker")})  # fmt: skip
SLANTED = {"crank": 0.7, "coupler": -0.7, "rocker": 0.7}


@pytest.mark.parametrize("driven", [True, False])
def test_a_parallelogram_passes_its_dead_points_and_says_so(driven):
    start = {"coordinates": {k: v for k, v in SLANTED.items() if not (driven and k == "crank")}}
    more = {"coordinates": {"crank": {"type": "rate", "rate": 2.0, "from": 0.7}}} if driven else {}
    if not driven:
        start["rates"] = {"crank": 23.7}
    result = lossless(closed(simulated(PARALLEL, 2.0 if driven else 0.5, 0.05, {"type": "radau"}, start=start, **more)))
    q = result.arrays["q"]
    np.testing.assert_allclose(q[:, 1:], q[:, :1] * [-1, 1], atol=1e-8)
    passed = np.count_nonzero(np.diff(np.floor(q[:, 0] / np.pi)))
    assert passed >= 1 and len(result.details["singular"]) == passed
    if driven:
        np.testing.assert_allclose(result.details["singular"][0], (np.pi - 0.7) / 2, atol=0.05)
        lever = 0.05 * 0.2 + 0.1 * 0.5 + 0.05 * 0.4
        np.testing.assert_allclose(result.arrays["holding.crank"], lever * G * np.cos(q[:, 0]), atol=1e-7)
    assert "dead points" in words(result)


def test_a_driven_rocker_stops_at_its_dead_point():
    coupler, rocker = FourBar().angles(2.5)
    result = simulated(plain("four_bar"), 3.0, solver={"type": "radau"},
                       start={"coordinates": {"crank": 2.5, "coupler": coupler - 2.5}},
                       coordinates={"rocker": {"type": "rate", "rate": 1.0, "from": rocker}})  # fmt: skip
    a, b, c, d = FourBar.a, FourBar.b, FourBar.c, FourBar.d
    folded = np.arccos(((b - a) ** 2 - c**2 - d**2) / (2 * c * d))  # crank and coupler in one line
    assert result.status.outcome == "infeasible" and "dead point" in result.status.message
    reached = float(re.search(r"t = ([0-9.]+) s", result.status.message)[1])
    np.testing.assert_allclose(reached, folded - rocker, atol=1e-4)


# Starts


def test_a_start_is_closed_with_what_is_named_kept():
    arrays = swung().arrays
    p, s = FourBar().angles(0.7)
    np.testing.assert_allclose(arrays["q"][0], [0.7, p - 0.7, s], atol=1e-11)
    assert swung().details["start"] == pytest.approx({"coupler": p - 0.7, "rocker": s})
    told = words(swung())
    assert "loops closed by moving coupler by -11.2 deg and rocker by 67.9 deg" in " ".join(told.split())
    assert "3 of pin" in told


def test_what_is_named_last_gives_way_where_loops_do_not_close():
    start = {"coordinates": {"crank": 0.7, "coupler": -0.21, "rocker": 1.2}, "rates": {"crank": 1.0, "rocker": 3.0}}
    result = closed(simulated(plain("four_bar"), 0.02, start=start))
    p, s = FourBar().angles(0.7)
    np.testing.assert_allclose(result.arrays["q"][0], [0.7, p - 0.7, s], atol=1e-11)
    dp, ds = FourBar().rates(0.7)
    np.testing.assert_allclose(result.arrays["qd"][0], [1.0, dp - 1.0, ds], atol=1e-10)
    assert "with coupler, rocker and the rate of rocker as given" in result.status.message


def test_a_start_that_bends_rods_says_how_much_and_what_that_takes():
    ball = {"type": "spherical", "a": {"segment": "arm"},
            "b": {"segment": "world", "placement": {"position": [0.148, 0.01, 0]}}}  # fmt: skip
    arm = rod(0.15, strains=["bend_z", "stretch"], sections=2)
    result = closed(simulated(robot_of({"arm": arm}, {"ball": ball}), 1e-3, 1e-3, {"type": "radau"}))
    (bend, stretch), told = np.abs(result.arrays["q"][0]).reshape(2, 2).max(axis=0), " ".join(words(result).split())
    held = 1e3 * 0.075 * 3e5 * np.pi * 1e-8 / 2 * np.sum(result.arrays["q"][0].reshape(2, 2) ** 2 @ [0.25, 1e4])
    assert f"moving 4 strains of arm (up to {bend:.3g} 1/m and {100 * stretch:.3g} %)" in told
    assert f"rods and springs begin with {held:.3g} mJ" in told and "`start: {settled: true}` begins at rest" in told


def test_loops_that_cannot_close_are_told_by_name_and_gap():
    robot = plain("four_bar")
    robot["segments"]["rocker"]["placement"]["position"] = [0.7, 0, 0]
    result = simulated(robot)
    assert result.status.outcome == "infeasible" and "Loop 'pin' cannot close" in result.status.message
    assert "150 mm apart" in result.status.message


def test_motors_that_contradict_each_other_are_told():
    p, s = FourBar().angles(0.7)
    driven = {"crank": {"type": "rate", "rate": 1.0, "from": 0.7}, "rocker": {"type": "rate", "rate": 1.0, "from": s}}
    result = simulated(plain("four_bar"), start={"coordinates": {"coupler": p - 0.7}}, coordinates=driven)
    assert result.status.outcome == "infeasible" and "'pin'" in result.status.message


def test_what_does_not_go_with_loops_is_refused_in_a_line():
    with pytest.raises(FileError, match="cvodes would let the loops drift open"):
        simulated(plain("four_bar"), solver={"type": "cvodes"})
    robot = plain("four_bar")
    for segment in robot["segments"].values():
        del segment["body"]
    with pytest.raises(Bad, match="nothing that has mass moves with crank"):
        simulated(robot, start={"coordinates": {"crank": 0.7}})
    robot = bennett()[0]  # open it has no motion left, closed it has one
    for segment in robot["segments"].values():
        del segment["body"]
    with pytest.raises(Bad, match="nothing that has mass moves with link0, link1, link2 and link3"):
        simulated(robot, start={"coordinates": {"link0": 1.0, "link1": 2.0}})
    floating = robot_of({"base": {"type": "free", "body": {"mass": 1.0, "inertia": [1, 1, 1]}},
                         "a": bar(0.1, "base"), "b": bar(0.1, "base", x=0.1)}, {"pin": pin("a", "b")})  # fmt: skip
    f = so.robot(floating).functions()
    for ask in (lambda: f.floating_inverse_dynamics, lambda: f.reaction("a"), lambda: f.internal_wrench("a", 0.5)):
        with pytest.raises(ValueError, match=r"does not know what loops bear \(pin\)"):
            ask()


# The journey


def test_a_slider_crank_is_solved_verified_and_drawn(tmp_path):
    """A whole turn ends as ten do."""
    problem = str(ROOT / "problems/slider_crank_turning.yaml")
    given = ["--no-figures", "--verify", "--set", "times.stop=1"]
    found = CliRunner().invoke(app, ["solve", problem, "-o", str(tmp_path), *given])
    assert found.exit_code == 0, found.output
    kept = so.load_result(tmp_path / "slider_crank_turning")
    assert kept.arrays["lam"].shape == (51, 5) and kept.arrays["loops.gudgeon"].shape == (51, 6)
    assert kept.details["redundant_rows"] == {"gudgeon": 3}
    drawn = [line.get_ydata() for ax in loops_figure(kept).axes for line in ax.get_lines()]
    assert any(np.ptp(y) == pytest.approx(np.ptp(kept.arrays["loops.gudgeon"][:, 3])) for y in drawn if len(y) == 51)
