"""Inputs of motions of robots with loops: closed forms, other equations of the same motion, and the robot uncut."""

from functools import cache

import numpy as np
import pytest
from test_inverse_loops import arch
from test_simulation_loops import OPEN, TURN, FourBar, SliderCrank, hung, plain, simulated, slope

import socontrol as so
from socontrol.mechanics.loads import Wrench
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.postures.goals import Point
from socontrol.programs.tensions.closed_motion import Closing
from socontrol.programs.tensions.tension_fit import Fitter, Tracked
from socontrol.programs.tensions.tension_replay import Pulled
from socontrol.programs.tensions.wanted_motion import Wanted

STRETCHED = {"rod": -0.3, "piston": 0.27}  # the branch of the slider-crank with its piston in front
AXIAL = 0.5e6 * np.pi * (10e-3**2 - 7e-3**2)  # of a bellows of the platform [N]
AREA, LEG, PLATE = 153.9e-6, 1080 * np.pi * (10e-3**2 - 7e-3**2) * 0.08, 0.06  # m^2, kg, kg
VISCOUS = 3 * 500 * np.pi * (10e-3**2 - 7e-3**2)  # N s: traction of a rate of stretch


def motion(robot, given=None, every=0.02, duration=1.0, simulate=False, guess=None, tolerance=0.01, **more):
    """Result of a motion, `given` by coordinates or by further keys of the problem; guess: of coordinates."""
    own = {"every": every, "simulate": simulate, "tolerance": tolerance}
    if given is not None:
        own |= {"coordinates": given, "duration": duration}
    if guess:
        more["guess"] = {"coordinates": guess}
    asked = {"schema_version": 1, "type": "tensions", "robot": robot, "discretisation": False, "motion": own, **more}
    return so.problem(asked).solve()


def closed(result):
    """Asserts that a motion is held with its loops closed in positions and rates, and returns it."""
    result.require()
    assert result.residuals["loops"].value < 1e-11 and result.residuals["loops.rate"].value < 1e-10
    return result


def wave(amplitude, mean=0.0, period=1.0):
    return {"type": "sinusoid", "amplitude": amplitude, "mean": mean, "period": period}


def turning(chain, t, rate, second):
    """What turns the crank of a chain of one angle t, at its rate and second derivative."""
    return chain.inertia_of(t) * second + slope(chain.inertia_of, t) * rate**2 / 2 + slope(chain.potential, t)


# One angle


@cache
def four_bar():
    return so.robot(plain("four_bar"))


@cache
def cranked():
    swing = wave(0.8, 0.7)
    return closed(motion(four_bar(), {"crank": swing}, guess=OPEN, simulate=True, every=0.01, duration=0.5))


@pytest.mark.parametrize("name", ["four_bar", "slider_crank"])
def test_a_motor_gives_what_the_equation_of_one_angle_asks_for(name):
    if name == "four_bar":
        chain, mean, result = FourBar(), 0.7, cranked()
    else:
        chain, mean = SliderCrank(), 1.0
        result = closed(motion(plain(name), {"crank": wave(0.8, mean)}, guess=STRETCHED))
    t = result.arrays["t"]
    angle = mean + 0.8 * np.sin(TURN * t)
    rate, second = 0.8 * TURN * np.cos(TURN * t), -0.8 * TURN**2 * np.sin(TURN * t)
    wanted = np.array([turning(chain, *row) for row in zip(angle, rate, second, strict=True)])
    np.testing.assert_allclose(result.arrays["q"][:, 0], angle, atol=1e-12)
    np.testing.assert_allclose(result.arrays["u"][:, 0], wanted, atol=2e-7 * np.max(np.abs(wanted)))
    assert result["motion.unmet"] < 1e-6 and np.ptp(wanted) > 0.5


def test_coordinates_that_are_not_given_go_where_circles_meet_and_move_with_them():
    arrays, chain = cranked().arrays, FourBar()
    crank, rate = arrays["q"][:, 0], arrays["qd"][:, 0]
    p, s = np.array([chain.angles(x) for x in crank]).T
    np.testing.assert_allclose(arrays["q"][:, 1:], np.column_stack([p - crank, s]), atol=1e-11)
    dp, ds = np.array([chain.rates(x) for x in crank]).T
    np.testing.assert_allclose(arrays["qd"][:, 1:], np.column_stack([dp - 1, ds]) * rate[:, None], atol=1e-9)
    bent = np.array([slope(lambda x: np.array(chain.rates(x)), x) for x in crank])
    second = np.column_stack([dp, ds]) * arrays["qdd"][:, :1] + bent * rate[:, None] ** 2
    np.testing.assert_allclose(arrays["qdd"][:, 1:] + [1, 0] * arrays["qdd"][:, :1], second, atol=1e-5)


def test_inputs_and_forces_of_loops_are_those_of_a_simulation_of_the_same_motion():
    """All coordinates are given, each by a spline through its outputs: the loops close by moving all a little."""
    torque = {"type": "sinusoid", "amplitude": 0.4, "mean": 0.3, "period": 0.5}
    moved = simulated(four_bar(), 0.25, 2e-3, start={"coordinates": {"crank": 0.7}}, inputs={"motor": torque})
    arrays = moved.require().arrays
    times = {"times": arrays["t"].tolist()}
    given = {name: {"type": "table", **times, "values": x.tolist()}
             for name, x in zip(("crank", "coupler", "rocker"), arrays["q"].T, strict=True)}  # fmt: skip
    result = closed(motion(four_bar(), given, every=2e-3, duration=0.25))
    own, inner = result.arrays, slice(5, -5)  # a spline's second derivatives are worse at its ends
    np.testing.assert_allclose(own["q"], arrays["q"], atol=1e-7)
    np.testing.assert_allclose(own["u"][inner], arrays["u"][inner], atol=3e-4)
    np.testing.assert_allclose(own["lam"][inner], arrays["lam"][inner], atol=1e-3 * np.max(np.abs(arrays["lam"])))
    assert np.ptp(arrays["u"]) > 0.3 and result.details["redundant_rows"] == {"pin": 3}


def test_under_straight_lines_between_samples_it_goes_off_with_the_square_of_their_distance():
    half = closed(motion(four_bar(), {"crank": wave(0.8, 0.7)}, 0.005, 0.5, guess=OPEN, simulate=True))
    assert 3.8 < cranked()["replay.tip"] / half["replay.tip"] < 4.2 and half["replay.tip_share"] < 2e-3
    np.testing.assert_allclose(half.arrays["replay.q"][0], half.arrays["q"][0], atol=0)
    assert np.ptp(half.arrays["replay.q"][:, 0]) > 0.7


def test_the_same_loop_twice_takes_the_same_torque_and_shares_what_is_borne():
    robot = plain("four_bar")
    robot["loops"]["ball"] = {**{k: robot["loops"]["pin"][k] for k in "ab"}, "type": "spherical"}
    twice = closed(motion(robot, {"crank": wave(0.8, 0.7)}, guess=OPEN, every=0.01, duration=0.1))
    once, count = cranked().arrays, len(twice.arrays["t"])
    np.testing.assert_allclose(twice.arrays["u"], once["u"][:count], atol=1e-7)
    half = once["loops.pin"][:count] / 2
    for name in ("pin", "ball"):
        np.testing.assert_allclose(twice.arrays[f"loops.{name}"], half, atol=1e-6 * np.max(np.abs(half)))
    np.testing.assert_array_equal(twice["loops.pin"], twice.arrays["loops.pin"][-1])


def test_a_limit_in_the_way_is_named():
    most = np.max(cranked().arrays["u"])
    limited = {"bounds": {"inputs": {"motor": [-10, most / 2]}}}
    swing = {"crank": wave(0.8, 0.7)}
    result = motion(four_bar(), swing, 0.01, 0.5, guess=OPEN, **limited)
    assert result.status.outcome == "infeasible" and "motor would need" in result.status.message


# Soft chains


def welded(cut):
    """Two soft rods end to end without weight, their seam part of the tree or a weld; a cable in each."""
    robot = hung(cut, strains=["bend_z"]) | {"gravity": [0, 0, 0]}
    robot["actuators"] = {rod: {"type": "tendon", "along": [rod], "offset": [0.008, 0], "limits": [0, 20]}
                          for rod in ("near", "far")}  # fmt: skip
    return robot


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
def test_a_rod_cut_in_two_and_welded_takes_the_tensions_of_the_whole(held):
    """Also with a coordinate that is held; the free body between its halves is moved by the weld alone."""
    bends = {"far.0.bend_z": wave(2.0, 4.0)} | ({} if held else {"near.0.bend_z": wave(-2.0, 5.0)})
    more = {"coordinates": {"near.0.bend_z": 4.0}} if held else {}
    whole, cut = (motion(welded(cut), bends, duration=0.4, **more) for cut in (False, True))
    np.testing.assert_allclose(closed(cut).arrays["u"], whole.require().arrays["u"], atol=1e-10)
    np.testing.assert_allclose(cut.arrays["far.position"], whole.arrays["far.position"], atol=1e-12)
    assert np.min(np.ptp(whole.arrays["u"], axis=0)[held:]) > 0.2 and np.min(whole.arrays["u"][:, held:]) > 0.1


def test_a_slow_motion_between_two_waypoints_is_at_rest_all_the_way():
    """Statics under the tensions of each sample comes to the sample; straight lines between postures open the loop."""
    way = {"type": "path", "on": "left", "axes": ["x"], "target": [[-0.006, 0, 0], [0.006, 0, 0]]}
    result = closed(motion(arch(), goals={"crown": way}, timing={"duration": 1e4}, every=1e3))
    arrays, balance = result.arrays, ClosedBalance(arch())
    for q, u in zip(arrays["q"], arrays["u"], strict=True):
        np.testing.assert_allclose(balance.solve(u, q0=arrays["q"][0]).q, q, atol=1e-4 * np.max(np.abs(q)))
    lam = balance.solve(arrays["u"][5]).lam
    np.testing.assert_allclose(arrays["lam"][5], lam, atol=1e-4 * np.max(np.abs(lam)))
    e = balance.closing((arrays["q"][0] + arrays["q"][-1]) / 2)[0]
    assert np.max(np.abs(e)) > 5e-5 and np.ptp(arrays["left.position"][:, 0]) > 0.011


def test_what_inputs_leave_unmet_displaces_as_statics_says():
    """An arch bears a load; inputs a little off displace it along its loops, the force that these bear turning."""
    robot = arch(loads={"snow": Wrench(on="left", force=(0.02, -0.3, 0.0))})
    balance, u, more = ClosedBalance(robot), np.array([0.6, 0.4]), np.array([1e-3, -2e-3])
    q, one, two = (balance.solve(own).q for own in (u, u + more, u - more))
    still = np.zeros((2, q.size))
    wanted = Wanted(np.array([0.0, 1.0]), still + q, still, still, np.zeros((2, 3)), np.tile(u, (2, 1)))
    free, given = np.ones(q.size, dtype=bool), (u + more, u + more)
    tracked = Tracked(robot, {"crown": Point(on="left", target=(0.0, 0.0, 0.0))})
    fit = Fitter(Pulled(robot, {}), tracked, given, (-u, u), 1e3, Closing(balance, free)).fit(wanted, 0, u)
    np.testing.assert_allclose(fit.dq, (one - two) / 2, atol=1e-4 * np.max(np.abs(one - two)))
    assert np.max(np.abs(one - q)) > 1e-3


# The platform


def lifted(duration, every):
    goals = {"plate": {"type": "path", "on": "plate", "target": [[0, 0, 0.082], [0, 0, 0.084], [0, 0, 0.086]]},
             "level": {"type": "axis", "on": "plate", "axis": [0, 0, 1], "target": [0, 0, 1]}}  # fmt: skip
    return motion(plain("parallel_soft_platform"), goals=goals, timing={"duration": duration, "ramp": duration / 2},
                  every=every)  # fmt: skip


def test_a_platform_lifted_straight_takes_equal_pressures_as_newton_says():
    """Pressure carries stretch, its rate, a third of the plate, half a bellows' weight and a third of its inertia."""
    result = closed(lifted(0.3, 0.01))
    t, u = result.arrays["t"], result.arrays["u"]
    share, rate, second = result.question.timing.share(t)
    s, v, a = 0.002 + 0.004 * share, 0.004 * rate, 0.004 * second
    still = AXIAL * s / 0.08 + (PLATE / 3 + LEG / 2) * 9.81
    moving = VISCOUS * v / 0.08 + (PLATE + LEG) / 3 * a
    assert np.max(np.abs(moving)) > 5e-3
    np.testing.assert_allclose(u * AREA, np.tile((still + moving)[:, None], 3), atol=0.02 * np.max(np.abs(moving)))
    np.testing.assert_allclose(u, np.tile(u[:, :1], 3), rtol=1e-6)
    np.testing.assert_allclose(result.arrays["plate.position"][:, 2], 0.08 + s, atol=1e-6)
    np.testing.assert_allclose(u[[0, -1]], result.arrays["path.u"][[0, -1]], rtol=1e-5)
    lam = result.arrays["loops.glue_1"][:, 3]  # along the bellows: a third of the plate, and what moves it
    np.testing.assert_allclose(lam, PLATE / 3 * (9.81 + a), atol=0.02 * PLATE * np.max(np.abs(a)))


# Refusals


def test_given_coordinates_that_open_the_loops_are_told():
    rocker = {"rocker": {"type": "rate", "rate": 1.0, "from": 1.18458791415}}
    result = motion(four_bar(), rocker, duration=1.3, guess={"crank": 0.7, "coupler": -0.2}, tolerance=1e-3)
    assert result.status.outcome == "infeasible" and not result.arrays
    a, b, c, d = FourBar.a, FourBar.b, FourBar.c, FourBar.d
    folded = np.arccos(((b - a) ** 2 - c**2 - d**2) / (2 * c * d))  # crank and coupler in one line
    first = np.ceil((folded - 1.18458791415) / 0.02) * 0.02
    assert f"At t = {first:.4g} s: Loops do not close with rocker at" in result.status.message


def test_loops_that_cannot_close_are_told_by_name_and_gap():
    robot = plain("four_bar")
    robot["segments"]["rocker"]["placement"]["position"] = [0.7, 0, 0]
    result = motion(robot, {"crank": 0.7})
    assert result.status.outcome == "infeasible" and "Loop 'pin' cannot close" in result.status.message


def test_a_joint_that_loops_put_beyond_its_limits_is_told():
    robot = plain("four_bar")
    robot["segments"]["rocker"]["limits"] = [0.0, 1.2]
    with pytest.raises(so.quantities.Bad, match="the loops put rocker where it cannot be: 1.2.*outside the limits"):
        motion(robot, {"crank": wave(0.8, 0.7)}, guess=OPEN)
