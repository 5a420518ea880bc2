"""Motions against conservation laws, closed forms, symmetry and other integrators; and what a simulation refuses."""

from functools import cache
from math import pi
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import socontrol as so
from socontrol.files.loader import FileError

ROOT = Path(__file__).parents[1]
WATER = {"water": {"type": "fluid", "density": 1000}}
OUTWARDS = -15.707963  # rest curvature of the hooks [1/m]
RADAU = {"type": "radau", "tolerance": 1e-7}
BAR = {"mass": 1.0, "com": [0.3, 0, 0], "inertia": [0.01, 0.05, 0.06]}


def simulated(robot, stop=1.0, every=None, solver=RADAU, progress=None, **more):
    times = {"stop": stop, "every": every or stop / 20}
    mapping = {"schema_version": 1, "type": "simulation", "robot": robot, "times": times, "solver": solver, **more}
    return so.problem(mapping).solve(progress=progress)


def robot_of(segments, gravity=(0, 0, 0), **more):
    return {"schema_version": 1, "name": "r", "gravity": list(gravity), "segments": segments, **more}


def values(result, name):
    return np.array(result.values[name].value)


def plain(name):
    return YAML(typ="safe").load((ROOT / "configs/robots" / f"{name}.yaml").read_text())


def rod(**more):
    """A short soft rod; undamped."""
    return {
        "type": "rod", "length": 0.3, "strains": "inextensible_kirchhoff_love", "quadrature": 4,
        "cross_section": {"type": "circle", "radius": 0.01},
        "material": {"type": "linear", "young_modulus": 3e5, "poisson_ratio": 0.5, "density": 1000},
        **more,
    }  # fmt: skip


PENDULUM = {"type": "revolute", "axis": [0, 1, 0], "body": BAR, "tip": {"position": [0.4, 0, 0]}}
SOFT = robot_of({"rod": rod()}, gravity=(0, 0, -9.81))
HYBRID = robot_of({"arm": PENDULUM, "rod": rod(parent="arm")}, gravity=(0, 0, -9.81))


# The swimmer


def swimmer(stiffer=1.0, **fluid):
    """The lophotricus with one section a filament; `fluid` replaces coefficients of its flagella."""
    robot = plain("lophotricus")
    for segment in robot["segments"].values():
        if segment["type"] == "rod":
            segment["fluid"] = {**segment["fluid"], **fluid}
            modulus = {"1 MPa": 1e6, "0.6 MPa": 6e5}[segment["material"]["young_modulus"]]
            segment["material"]["young_modulus"] = stiffer * modulus
            segment["quadrature"] = 4
        if "sections" in segment:
            segment |= {"sections": 1, "strains": "inextensible_constant_curvature"}
    return robot


@cache
def swum(rate, stop=1.0, stiffer=1.0, tolerance=1e-5, **fluid):
    return simulated(
        swimmer(stiffer, **fluid), stop, solver={"type": "radau", "tolerance": tolerance}, loads=WATER,
        coordinates={f"motor_{i}": {"type": "rate", "rate": rate} for i in range(3)},
        start={"coordinates": {f"hook_{i}.0.bend_z": OUTWARDS for i in range(3)}},
    ).require()  # fmt: skip


def test_reversed_motors_and_handedness_mirror_the_motion():
    """Seen in the mirror z -> -z the flagella 1 and 2 change places, motors turn and lift works the other way."""
    there, mirrored = swum(5.0), swum(-5.0, lift=0.1)
    assert there["shell.position"][0] > 1e-3
    np.testing.assert_allclose(mirrored["shell.position"], there["shell.position"], atol=1e-8)
    np.testing.assert_allclose(mirrored["shell.rotation"], -np.array(there["shell.rotation"]), atol=1e-7)
    for seen, own in ((0, 0), (1, 2), (2, 1)):
        ends = there.arrays[f"filament_{own}.position"] * [1, 1, -1]
        np.testing.assert_allclose(mirrored.arrays[f"filament_{seen}.position"], ends, atol=1e-7)


def test_reversed_motors_alone_do_not_mirror_the_motion():
    assert abs(swum(-5.0)["shell.position"][0] - swum(5.0)["shell.position"][0]) > 1e-3


def test_three_equal_flagella_do_not_drift_aside():
    positions = swum(5.0).arrays["shell.position"]
    assert np.max(np.abs(positions[:, 1:])) < 1e-8 * np.max(np.abs(positions[:, 0]))


def test_the_body_turns_against_its_motors():
    """Motors turn about -x."""
    result = swum(5.0)
    turned = np.unwrap(result.arrays["shell.rotation"][:, 0])
    assert 0.1 < turned[-1] < 5.0
    np.testing.assert_allclose(values(result, "coordinates.motor_1"), 5.0, rtol=1e-12)


def test_the_impulse_of_the_water_is_the_change_of_momentum():
    """Angular momentum about the world's origin carries the momentum that the added mass leaves in the water."""
    result = swum(5.0, tolerance=1e-7)
    change = result.arrays["momentum"] - result.arrays["momentum"][0]
    assert np.max(np.abs(change[:, 3])) > 0.01 and np.max(np.abs(change[:, 0])) > 0.01
    np.testing.assert_allclose(result.arrays["impulse"], change, atol=1e-8)


def test_without_anisotropy_and_lift_stiff_flagella_do_not_swim():
    """A rigid turn about the axis moves every point across it: drag that opposes motion alone has no thrust."""
    even = swum(3.0, 0.6, stiffer=1000.0, tangential=1.1, lift=0.0, added_mass=(0.0, 0.0))
    uneven = swum(3.0, 0.6, stiffer=1000.0)
    assert abs(even["shell.position"][0]) < 0.01 * abs(uneven["shell.position"][0])
    assert even["shell.rotation"][0] > 0.1


def test_motors_pay_for_what_the_water_takes():
    result = swum(5.0)
    energy, work = result.arrays["energy"].sum(axis=1), result.arrays["work"]
    assert work[-1, 4] > 0 > work[-1, 3]
    np.testing.assert_allclose(work.sum(axis=1), energy - energy[0], atol=1e-5 * work[-1, 4])


def rod_points():
    """(position, direction, radius, length) at Gauss points of a rigid flagellum, base at 0, along x, bent to -y."""
    x, w = np.polynomial.legendre.leggauss(12)
    x, w, k = (x + 1) / 2, w / 2, pi / 4 / 0.05
    a = k * 0.05 * x
    end = np.array([0.015 + np.sin(pi / 4) / k, (1 - np.cos(pi / 4)) / k, 0])
    along = np.array([1, 1, 0]) / 2**0.5
    hook = np.stack([0.015 + np.sin(a) / k, (1 - np.cos(a)) / k, 0 * a], 1)
    P = np.concatenate([hook, end + 0.3 * x[:, None] * along])
    T = np.concatenate([np.stack([np.cos(a), np.sin(a), 0 * a], 1), np.tile(along, (12, 1))])
    P, T = P * [1, -1, 1], T * [1, -1, 1]
    return P, T, np.concatenate([0 * x + 0.0125, 0.0125 - 0.0105 * x]), np.concatenate([0.05 * w, 0.3 * w])


def test_stiff_flagella_move_the_shell_as_rigid_ones_do():
    """Momentum along and about the axis of three-fold symmetry, in numpy alone: two equations for two speeds."""
    rate, stop, rho = 3.0, 0.6, 1000.0
    P, T, r, w = rod_points()
    e, base, R = np.array([1.0, 0, 0]), np.array([-0.0779422863, 0.045, 0]), 0.09
    front, side = pi * R**2, (pi + 4) * R**2
    flip = Rotation.from_rotvec([0, 0, pi]).as_matrix()

    def placed(angle):
        M = Rotation.from_rotvec([-angle, 0, 0]).as_matrix() @ flip
        return P @ M.T, T @ M.T

    def velocity(rel, U, spin):
        return U * e + spin * np.cross(e, base + rel) - rate * np.cross(e, rel)

    def momentum(angle, U, spin):
        """Of all three along x and about x, with the added mass 0.6 rho A across; the spread of the mass over the
        section turns with the section."""
        rel, t = placed(angle)
        v, A = velocity(rel, U, spin), (pi * r**2 * w)[:, None]
        p = rho * A * (v + 0.6 * (v - (v * t).sum(1)[:, None] * t))
        W = spin - rate
        J = rho * (pi * r**4 / 4 * w)[:, None] * (W * e + (W * e * t).sum(1)[:, None] * t)  # Jx = 2 Jy
        about = np.cross(base + rel, p) + J
        return np.array([3 * p.sum(0)[0] + 3.818 * U, 3 * about.sum(0)[0] + 0.013 * spin])

    def water(angle, U, spin):
        rel, t = placed(angle)
        v = velocity(rel, U, spin)
        along = (v * t).sum(1)[:, None] * t
        size = (rho * r * w * np.linalg.norm(v, axis=1))[:, None]
        f = -size * (0.02 * along + 1.1 * (v - along) + 0.1 * np.cross(t, v))  # lift -0.1
        shell = -rho * abs(U) * np.array([front / 2 * U, 2.5 * side * R**3 / 2 * spin])
        return np.array([3 * f.sum(0)[0], 3 * np.cross(base + rel, f).sum(0)[0]]) + shell

    def speeds(angle, p):
        zero = momentum(angle, 0.0, 0.0)
        M = np.stack([momentum(angle, 1.0, 0.0) - zero, momentum(angle, 0.0, 1.0) - zero], 1)
        return np.linalg.solve(M, p - zero)

    def rates(t, x):
        U, spin = speeds(rate * t, x[:2])
        return [*water(rate * t, U, spin), U, spin]

    moved = solve_ivp(rates, (0, stop), [*momentum(0.0, 0.0, 0.0), 0, 0], rtol=1e-8, atol=1e-12).y[2:, -1]
    result = swum(rate, stop, stiffer=1000.0)
    found = np.array([result["shell.position"][0], result["shell.rotation"][0]])
    np.testing.assert_allclose(found, moved, rtol=0.005)


def test_the_sunken_swimmer_meets_its_force_balance():
    """Drag law summed in numpy over poses alone: at terminal speed it carries weight less buoyancy, to 1 %."""
    robot = swimmer()
    robot["segments"]["shell"]["body"]["displaced_volume"] = 3.818 / 1100
    for segment in robot["segments"].values():
        if segment["type"] == "rod":
            segment["material"]["density"] = 1100
    down = {"shell.1": pi / 2, **{f"hook_{i}.0.bend_z": OUTWARDS for i in range(3)}}
    still = {f"motor_{i}": 0.0 for i in range(3)}
    result = simulated(robot, 5.0, 0.05, {"type": "radau", "tolerance": 1e-5}, loads=WATER, coordinates=still,
                       start={"coordinates": down}).require()  # fmt: skip
    z, f, q = result.arrays["shell.position"][:, 2], result.question.robot.functions(), result.arrays["q"][-1]
    v = np.array([0, 0, (z[-1] - z[-2]) / 0.05])
    lift, (x, w) = 0.0, np.polynomial.legendre.leggauss(12)
    x, w = (x + 1) / 2, w / 2
    for i in range(3):
        for name, length, tip in ((f"hook_{i}", 0.05, 0.0125), (f"filament_{i}", 0.3, 0.002)):
            for X, share in zip(x, w, strict=True):
                R = np.array(f.pose(name, X)(q))[:3, :3]
                n, r = R.T @ v, 0.0125 + (tip - 0.0125) * X
                D = np.array([[0.02, 0, 0], [0, 1.1, -0.1], [0, 0.1, 1.1]])
                lift += (R @ (-1000 * r * np.linalg.norm(n) * D @ n))[2] * length * share
    lift += 1000 * v[2] ** 2 * pi * 0.09**2 / 2  # head first
    volume = 3 * pi * (0.0125**2 * 0.05 + 0.1 * (0.0125**2 + 0.0125 * 0.002 + 0.002**2))
    assert lift == pytest.approx((3.818 + 1100 * volume) * (1 - 1000 / 1100) * 9.81, rel=0.01)


# What is conserved

GAUSS = {"type": "gauss", "step": 0.005}


@pytest.mark.parametrize("robot", [SOFT, HYBRID], ids=["soft", "hybrid"])
def test_gauss_keeps_the_energy_of_undamped_pendulums(robot):
    """Over 10 s, many swings."""
    result = simulated(robot, 10.0, 0.05, GAUSS).require()
    energy = result.arrays["energy"]
    assert np.max(np.abs(energy.sum(1) - energy[0].sum())) < 1e-6 * np.max(energy[:, 0])
    assert np.max(energy[:, 1]) > 5e-4 * np.max(energy[:, 0])  # it does bend


def test_a_floating_robot_keeps_its_momentum():
    robot = robot_of({"float": {"type": "free", "body": BAR}, "rod": rod(parent="float")})
    rates = {"float.0": 1.0, "float.1": 2.0, "float.2": -1.5, "float.3": 0.3, "rod.0.bend_z": 5.0}
    for solver in (GAUSS, {"type": "radau", "tolerance": 1e-9}):
        momentum = simulated(robot, 1.0, solver=solver, start={"rates": rates}).require().arrays["momentum"]
        np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(momentum), 1)), atol=1e-9)


def test_the_impulse_of_a_history_is_its_integral():
    """Force along x as a triangle at the end of a floating bar: momentum is int F dt; nothing turns about x."""
    robot = robot_of({"float": {"type": "free", "body": BAR, "tip": {"position": [0, 0.2, 0.1]}}})
    loads = {"kick": {"type": "wrench", "on": "float", "force": [2, 0, 0], "moment": [0, 0, 0]}}
    table = {"type": "table", "times": [0, 0.5, 1, 2], "values": [0, 1, 0, 0]}
    result = simulated(robot, 2.0, 0.05, loads=loads, load_factors={"kick": table}).require()
    np.testing.assert_allclose(values(result, "momentum")[[0, 3, 4, 5]], [0, 1, 0, 0], atol=1e-8)
    np.testing.assert_allclose(result.arrays["impulse"], result.arrays["momentum"], atol=1e-7)
    late = result.arrays["momentum"][result.arrays["t"] >= 1]
    np.testing.assert_allclose(late, np.tile(late[0], (len(late), 1)), atol=1e-7)


@pytest.mark.parametrize("robot", [SOFT, HYBRID], ids=["soft", "hybrid"])
def test_radau_and_cvodes_agree(robot):
    ours = simulated(robot, 0.3, solver={"type": "radau", "tolerance": 1e-8}).require()
    theirs = simulated(robot, 0.3, solver={"type": "cvodes", "tolerance": 1e-10}).require()
    np.testing.assert_allclose(ours.arrays["rod.position"], theirs.arrays["rod.position"], atol=1e-7)


def test_a_motor_that_drives_a_pendulum_does_the_work_by_hand():
    """Change of kinetic and gravitational energy, by hand; steps are short since no free coordinate asks for any."""
    robot = robot_of({"arm": PENDULUM}, gravity=(0, 0, -9.81))
    ramp, solver = {"type": "ramp", "to": 1.0, "stop": 0.5, "smooth": True}, {**RADAU, "longest_step": 0.01}
    inertia = 0.05 + 0.3**2  # about +y: the bar, along x, goes down
    for stop, angle, rate in ((0.5, 1.0, 0.0), (0.25, 0.5, 30 * 0.5**4 / 0.5)):
        result = simulated(robot, stop, solver=solver, coordinates={"arm": ramp}).require()
        work = inertia * rate**2 / 2 - 9.81 * 0.3 * np.sin(angle)
        assert values(result, "work.motors") == pytest.approx(work, rel=1e-6)


# Turns without end


def test_a_spinning_top_precesses_as_the_closed_form_says():
    """Free symmetric body, L fixed: R(t) = exp(t L/J_t) R exp(t spin (1 - J_x/J_t) e_x), many turns long."""
    Jx, Jt, w = 0.02, 0.05, np.array([20.0, 3.0, 1.0])
    robot = robot_of({"top": {"type": "free", "body": {"mass": 1.0, "inertia": [Jx, Jt, Jt]}}})
    rates = {f"top.{i}": float(w[i]) for i in range(3)} | {"top.3": 0.5}
    result = simulated(robot, 3.0, 0.1, {"type": "radau", "tolerance": 1e-9}, start={"rates": rates}).require()
    L, slip = np.array([Jx * w[0], Jt * w[1], Jt * w[2]]), w[0] * (1 - Jx / Jt)
    momenta = result.arrays["momentum"]
    np.testing.assert_allclose(momenta, np.tile([*L, 0.5, 0, 0], (len(momenta), 1)), atol=1e-7)
    for t, turned in zip(result.arrays["t"], result.arrays["top.rotation"], strict=True):
        wanted = Rotation.from_rotvec(t * L / Jt) * Rotation.from_rotvec([t * slip, 0, 0])
        assert (wanted.inv() * Rotation.from_rotvec(turned)).magnitude() < 1e-6
    assert np.max(np.linalg.norm(result.arrays["q"][:, :3], axis=1)) < 2 * pi < t * np.linalg.norm(L) / Jt


def test_a_spherical_pendulum_goes_over_the_top_like_a_revolute_one():
    """The revolute joint needs no charts; both start with the rates that carry them round."""
    arm = {"body": BAR, "tip": {"position": [0.4, 0, 0]}}
    one = robot_of({"arm": {"type": "revolute", "axis": [0, 1, 0], **arm}}, gravity=(0, 0, -9.81))
    three = robot_of({"arm": {"type": "spherical", **arm}}, gravity=(0, 0, -9.81))
    solver = {"type": "radau", "tolerance": 1e-9}
    plane = simulated(one, 1.5, 0.05, solver, start={"rates": {"arm": 12.0}}).require()
    ball = simulated(three, 1.5, 0.05, solver, start={"rates": {"arm.1": 12.0}}).require()
    assert plane.arrays["q"][-1, 0] > 2 * pi
    np.testing.assert_allclose(ball.arrays["arm.position"], plane.arrays["arm.position"], atol=1e-6)


def test_a_planar_joint_turns_on_beyond_half_a_turn():
    """No force: the centre of mass goes straight, the angle grows evenly."""
    robot = robot_of({"puck": {"type": "planar", "body": {"mass": 1.0, "inertia": [1, 1, 1]}}})
    rates = {"puck.0": 4.0, "puck.1": 0.3, "puck.2": -0.2}
    result = simulated(robot, 4.0, 0.1, {"type": "radau", "tolerance": 1e-9}, start={"rates": rates}).require()
    t = result.arrays["t"]
    np.testing.assert_allclose(result.arrays["puck.position"], np.outer(t, [0.3, -0.2, 0]), atol=1e-6)
    turned = Rotation.from_rotvec(result.arrays["puck.rotation"]) * Rotation.from_rotvec(np.outer(-4 * t, [0, 0, 1]))
    assert np.max(turned.magnitude()) < 1e-6


# Where a motion ends early


@pytest.mark.parametrize("solver", [RADAU, GAUSS], ids=["radau", "gauss"])
def test_an_interrupted_motion_keeps_its_part(solver):
    def press(done, total, sentence):
        if done > 0.5 * total:
            raise KeyboardInterrupt

    result = simulated(SOFT, 1.0, solver=solver, progress=press)
    assert result.status.outcome == "interrupted" and "t = " in result.status.message
    assert 2 <= len(result.arrays["t"]) < 21 and result.arrays["t"][-1] < 1.0
    whole = simulated(SOFT, 1.0, solver=solver)
    part = slice(len(result.arrays["t"]))
    np.testing.assert_allclose(result.arrays["q"], whole.arrays["q"][part], atol=1e-9)


def test_too_few_steps_end_at_a_limit():
    result = simulated(SOFT, 1.0, solver={"type": "radau", "tolerance": 1e-7, "max_steps": 5})
    assert result.status.outcome == "limit" and result.status.exit_code == 5
    assert "max_steps" in result.status.message


def test_steps_that_are_too_long_say_when():
    result = simulated(SOFT, 1.0, 1.0, {"type": "gauss", "step": 1.0})
    assert result.status.outcome == "numerical" and result.status.exit_code == 6
    assert "At t = 0 s" in result.status.message and "step" in result.status.message


ARM = robot_of({"arm": {**PENDULUM, "limits": [-1, 1]}}, actuators={"motor": {"type": "joint_torque", "joint": "arm"}})
SHORT = {"type": "table", "times": [0, 0.5], "values": [0, 1]}
MOTION = {"type": "table", "times": [0, 0.1, 0.3, 0.5], "values": [0, 0.1, 0.3, 0.5]}
REFUSED = {
    "input's table ends": ({"inputs": {"motor": SHORT}}, "inputs.motor.*ends at 0.5 s"),
    "motion's table ends": ({"coordinates": {"arm": MOTION}}, "coordinates.arm.*ends at 0.5 s"),
    "motion's table is too short": ({"coordinates": {"arm": SHORT}}, "coordinates.arm.*four or more times"),
    "start of a driven joint": (
        {"coordinates": {"arm": 0}, "start": {"rates": {"arm": 1}}},
        "start.rates.arm.*driven",
    ),
    "a guess": ({"guess": {"coordinates": {"arm": 1}}}, "guess.*start"),
    "start beyond limits": ({"start": {"coordinates": {"arm": 3}}}, "start.coordinates.arm.*outside the limits"),
    "beyond limits": (
        {"coordinates": {"arm": {"type": "ramp", "to": 2, "stop": 1}}},
        "coordinates.arm.*reaches 2 rad, above .*limit.* 1 rad",
    ),
    "unknown input": ({"inputs": {"moter": 1}}, "no input 'moter'.*motor"),
    "unknown coordinate": ({"coordinates": {"amr": 1}}, "no coordinate 'amr'.*arm"),
    "unknown start": ({"start": {"coordinates": {"amr": 1}}}, "no coordinate 'amr'"),
    "unknown rate": ({"start": {"rates": {"amr": 1}}}, "no coordinate 'amr'.*arm"),
    "unknown load": ({"load_factors": {"kick": 1}}, "no load 'kick'"),
    "a jump of a joint": ({"coordinates": {"arm": {"type": "rate", "rate": 0.1, "start": 0.5}}}, "jump to its rate"),
    "times that fall": ({"times": [0.2, 0.1]}, "times must rise"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_motion_that_cannot_be_meant_is_refused_in_one_line(name):
    changes, sentence = REFUSED[name]
    base = {"schema_version": 1, "type": "simulation", "robot": ARM, "times": {"stop": 1, "every": 0.1}}
    with pytest.raises(FileError, match=sentence) as caught:
        so.problem({**base, **changes})
    assert len(str(caught.value).splitlines()) == 1


def test_a_joint_without_mass_is_named():
    robot = robot_of({"float": {"type": "free"}, "arm": {"type": "revolute", "parent": "float"}})
    with pytest.raises(ValueError, match="nothing that has mass moves with .*(singular mass matrix)"):
        simulated(robot, 1.0)


TABLES = {
    "no file": ("nowhere.csv", "a", "cannot read 'nowhere.csv'"),
    "no column": ("t.csv", "b", "has no column 'b'.*"),
    "no number": ("t.csv", "c", "t.csv:3: no number in column 'c'"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_cannot_be_read_is_refused_in_one_line(name, tmp_path):
    (tmp_path / "t.csv").write_text("time,a,c\n0,1,2\n1,2,x\n")
    file, column, sentence = TABLES[name]
    base = {"schema_version": 1, "type": "simulation", "robot": ARM, "times": {"stop": 1, "every": 0.1}}
    with pytest.raises(FileError, match=sentence) as caught:
        so.problem({**base, "inputs": {"motor": {"type": "table", "file": file, "column": column}}}, tmp_path)
    assert len(str(caught.value).splitlines()) == 1


def test_a_table_from_a_file_is_the_table_itself(tmp_path):
    (tmp_path / "t.csv").write_text("time,a\n0,0\n0.4,2\n1,1\n")
    base = {"schema_version": 1, "type": "simulation", "robot": ARM, "times": {"stop": 1, "every": 0.1}}
    written = {"type": "table", "times": [0, 0.4, 1], "values": [0, 2, 1]}
    read = {"type": "table", "file": "t.csv", "column": "a"}
    ours, theirs = (so.problem({**base, "inputs": {"motor": x}}, tmp_path).solve() for x in (read, written))
    np.testing.assert_array_equal(ours.arrays["q"], theirs.arrays["q"])
    np.testing.assert_allclose(ours.arrays["u"][:, 0], np.interp(ours.arrays["t"], [0, 0.4, 1], [0, 2, 1]), atol=1e-12)


@pytest.mark.parametrize("rows", [4, 11])
def test_a_table_moves_a_joint_at_the_rate_of_its_spline_at_both_ends(rows):
    """A cubic through points of a cubic is that cubic: t - t^3 / 3 has the rates 1 and 0 at 0 and 1."""
    times = np.linspace(0, 1, rows)
    table = {"type": "table", "times": times.tolist(), "values": (times - times**3 / 3).tolist()}
    result = simulated(robot_of({"arm": PENDULUM}), 1.0, 0.1, coordinates={"arm": table}).require()
    np.testing.assert_allclose(result.arrays["qd"][:, 0], 1 - result.arrays["t"] ** 2, atol=1e-9)


def test_a_settled_robot_stays_and_is_solved():
    """Nothing moves, so nothing but rounding is left of the energies: no share of it may reject the answer."""
    result = simulated(SOFT, 0.5, 0.1, start={"settled": True}).require()
    np.testing.assert_allclose(result.arrays["q"], np.tile(result.arrays["q"][0], (6, 1)), atol=1e-9)


def test_a_joint_that_a_motor_turns_keeps_its_chart():
    """A planar joint whose turn is driven cannot be written anew; a full turn away it says so."""
    planar = robot_of({"p": {"type": "planar", "body": BAR}})
    drive = {"coordinates": {"p.0": {"type": "rate", "rate": 4}}}
    half = simulated(planar, 1.0, 0.1, **drive).require()
    np.testing.assert_allclose(half.arrays["q"][:, 0], 4 * half.arrays["t"], atol=1e-12)
    result = simulated(planar, 2.0, 0.1, **drive)
    assert result.status.outcome == "numerical" and "joint p is nearly a full turn away" in result.status.message
    assert len(result.arrays["t"]) > 10


def test_crushed_rods_are_named():
    robot = robot_of({"rod": {**rod(), "strains": ["stretch"]}})
    loads = {"push": {"type": "wrench", "on": "rod", "force": [-1e5, 0, 0], "axes": "body"}}
    result = simulated(robot, 0.5, 0.1, loads=loads)
    assert result.status.outcome == "numerical" and "rod.0" in result.status.message


def test_doubled_sections_move_the_ends_little():
    result = simulated(SOFT, 0.2, 0.1, discretisation=True).require()
    changes = result.details["discretisation"]
    assert 0 < changes["rod"] < 0.05
