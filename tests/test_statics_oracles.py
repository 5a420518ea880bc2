"""Rods at rest against numbers of independent codes and of closed forms.

Each reference file holds, for a cantilever under several loads, the continuous rod (spectral collocation of
the strong form) and the constant-strain rod of N = 1, 2, 4, 8 equal sections (a numpy virtual-work code, 10
Gauss points a section). Forces N along a line are signed there: a cable of tension T has N = -T, a chamber
has N = pressure x area.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots import array
from scipy.spatial.transform import Rotation

from socontrol.mechanics.actuators import Chamber, Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.routes import Converging, Helix
from socontrol.model.bodies import Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, General, Taper
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.looks import check

REFERENCE = Path(__file__).parent / "reference"
FILES = [
    "bend45_bathe_Jx_0p1406",
    "bend45_bathe_Jx_1_6",
    "follower_tip_force",
    "octopus_arm",
    "self_weight",
    "stiffflop",
    "tendon_helical",
    "tendon_straight",
    "tip_dead_load_full",
    "tip_dead_load_inextensible",
    "tip_moment_rollup",
]
EXACT = ["stiffflop", "tip_moment_rollup"]  # constant strain is the continuous answer
SLOPES = {  # numbers of sections whose errors are asymptotic
    "bend45_bathe_Jx_0p1406": (2, 4, 8),
    "bend45_bathe_Jx_1_6": (2, 4, 8),
    "follower_tip_force": (4, 8, 16),
    "octopus_arm": (8, 16, 32),
    "self_weight": (4, 8, 16),
    "tendon_helical": (8, 16, 32),
    "tendon_straight": (4, 8, 16),
    "tip_dead_load_full": (4, 8, 16),
    "tip_dead_load_inextensible": (4, 8, 16),
}
AREA = 2 * np.pi * 0.0025**2  # of a pair of chambers, in `stiffflop`
DENSITY = 1000.0  # where a file gives none, nothing has weight
ROWS = {"IKL": "inextensible_kirchhoff_love", None: "simo_reissner"}
COLUMNS = {"IKL": [0, 1, 2], None: [0, 1, 2, 3, 4, 5]}


# From a file to a robot


@cache
def oracle(name):
    return json.loads((REFERENCE / f"static_{name}.json").read_text())


def section(spec):
    shape = spec["section"]
    if shape["type"] == "circular":
        ends = Circle(radius=shape["r_base"]), Circle(radius=shape["r_tip"])
        return ends[0] if shape["r_base"] == shape["r_tip"] else Taper(start=ends[0], end=ends[1])
    E, G, A = spec["E"], spec["G"], shape["A"]
    stiffness = (G * shape["Jx"], E * shape["Jy"], E * shape["Jz"], E * A, G * A, G * A)
    return General(stiffness=stiffness, inertia=(1.0,) * 6)


def actuator(line, pulls):
    """The record of a line."""
    ends = [
        tuple((r * np.array([np.cos(line["phase"]), np.sin(line["phase"])])).tolist())
        for r in (line["r_base"], line["r_tip"])
    ]
    offset = ends[0] if ends[0] == ends[1] else Converging(start=ends[0], end=ends[1])
    if line.get("turns"):
        offset = Helix(radius=line["r_base"], end_radius=line["r_tip"], turns=line["turns"], phase=line["phase"])
    if pulls:
        return Tendon(along=("arm",), offset=offset)
    direction = {"e1": "normal", "tangent": "tangent"}[line["mode"]]
    return Chamber(along=("arm",), offset=offset, area=AREA, direction=direction)


def wrench(loads):
    """The load at the tip, if any, and the keys that hold its numbers."""
    if "tip_follower_wrench" in loads:
        twist = loads["tip_follower_wrench"]
        load = Wrench(on="arm", moment=tuple(twist[:3]), force=tuple(twist[3:]), axes="body")
        return load, ("moment", "force")
    if "tip_dead_force" in loads:
        return Wrench(on="arm", force=tuple(loads["tip_dead_force"])), ("force",)
    if "tip_dead_moment" in loads:
        return Wrench(on="arm", moment=tuple(loads["tip_dead_moment"])), ("moment",)
    return None, ()


def all_loads(name):
    return [result["loads"] for result in oracle(name)["results"]]


def rod(spec, N):
    g0 = np.array(spec.get("g0", np.eye(4)))
    rest = np.array(spec.get("xi_bar", [0, 0, 0, 1, 0, 0])) - [0, 0, 0, 1, 0, 0]
    rotation = Rotation.from_matrix(g0[:3, :3]).as_rotvec()
    modulus = {"shear_modulus": spec["G"]} if "G" in spec else {"poisson_ratio": spec["nu"]}
    return Rod(
        length=spec["L"],
        cross_section=section(spec),
        material=Linear(young_modulus=spec["E"], density=spec.get("rho", DENSITY), **modulus),
        placement=Placement(position=tuple(g0[:3, 3].tolist()), rotation=tuple(rotation.tolist())),
        strains=ROWS[spec.get("basis")],
        sections=N,
        quadrature=10 if N <= 8 else 3,  # ten are what the files used; three are enough for finer sections
        rest={"bend_z": rest[2]} if rest[2] else None,
    )


def robot_of(name, index, N):
    """The robot under the loads of one result, and the inputs."""
    spec, loads = oracle(name)["spec"], all_loads(name)[index]
    lines = loads.get("actuators", [])
    pulls = all(line["N"] <= 0 for loads in all_loads(name) for line in loads.get("actuators", []))
    load, _ = wrench(loads)
    description = Description(
        segments={"arm": rod(spec, N)},
        gravity=tuple(spec.get("gravity", (0.0, 0.0, 0.0))),
        loads={"tip": load} if load else None,
        actuators={f"line{i}": actuator(line, pulls) for i, line in enumerate(lines)} or None,
    )
    return Robot(description), np.array([line["N"] / (-1.0 if pulls else AREA) for line in lines])


@cache
def made(name, mode, N):
    """Solver and tip pose of a file's robot, its load left open, with all lines pushing along `mode`."""
    index = next(i for i in range(len(all_loads(name))) if mode_of(name, i) == mode)
    robot, _ = robot_of(name, index, N)
    _, keys = wrench(all_loads(name)[index])
    return Balance(robot, [f"loads.tip.{key}" for key in keys]), robot.functions().pose("arm")


def mode_of(name, index):
    return next((line["mode"] for line in all_loads(name)[index].get("actuators", [])), None)


@cache
def solved(name, index, N):
    """(equilibrium, tip pose) of one result of a file at N sections."""
    balance, pose = made(name, mode_of(name, index), N)
    robot, u = robot_of(name, index, N)
    load, keys = wrench(all_loads(name)[index])
    answer = balance.solve(u, p=np.concatenate([getattr(load, key) for key in keys]) if keys else None)
    return answer, array(pose(answer.q))


def results(names=FILES, sections=("1", "2", "4", "8")):
    """(file, index of the result, N) for every equilibrium the files hold."""
    return [
        (name, i, int(N))
        for name in names
        for i, result in enumerate(oracle(name)["results"])
        for N in sections
        if N in result["pcs"]
    ]


def cases(part, excluded=False):
    """(file, index of the result) of files whose name holds `part`, or of the others."""
    return [(name, i) for name, i, _ in results(SLOPES, ("8",)) if (part in name) != excluded]


def deviations(name, q):
    """Strains [N x active] beyond the rest strain, as the files hold them."""
    rest = np.array(oracle(name)["spec"].get("xi_bar", [0, 0, 0, 1, 0, 0])) - [0, 0, 0, 1, 0, 0]
    columns = COLUMNS[oracle(name)["spec"].get("basis")]
    return q.reshape(-1, len(columns)) - rest[columns]


def error_of_tip(name, index, N):
    """Distance of our tip from the continuous one."""
    tip = np.array(oracle(name)["results"][index]["continuous"]["tip_position"])
    return np.linalg.norm(solved(name, index, N)[1][:3, 3] - tip)


# Constant strain at the same number of sections


@pytest.mark.parametrize(("name", "index", "N"), results())
def test_strains_are_those_of_an_independent_constant_strain_code(name, index, N):
    answer, _ = solved(name, index, N)
    expected = np.array(oracle(name)["results"][index]["pcs"][str(N)]["q"])
    tolerance = oracle(name)["tolerance"]["pcs_same_N_rel"]
    assert answer.status.solved
    ours = deviations(name, answer.q)
    for columns in (slice(0, 3), slice(3, 6)):  # curvatures, and numbers without a unit
        if expected[:, columns].size:
            size = np.abs(expected[:, columns]).max()
            np.testing.assert_allclose(ours[:, columns], expected[:, columns], rtol=0, atol=tolerance * size)


@pytest.mark.parametrize(("name", "index", "N"), results())
def test_tips_are_those_of_an_independent_constant_strain_code(name, index, N):
    _, g = solved(name, index, N)
    spec, expected = oracle(name)["spec"], np.array(oracle(name)["results"][index]["pcs"][str(N)]["tip_pose"])
    tolerance = oracle(name)["tolerance"]["pcs_same_N_rel"]
    np.testing.assert_allclose(g[:3, :3], expected[:3, :3], rtol=0, atol=tolerance)
    np.testing.assert_allclose(g[:3, 3], expected[:3, 3], rtol=0, atol=tolerance * spec["L"])


@pytest.mark.parametrize(("name", "index", "N"), results(sections=("2",)))
def test_answers_balance_on_the_independent_path_too(name, index, N):
    robot, u = robot_of(name, index, N)
    answer, _ = solved(name, index, N)
    r, *parts = check.residual(robot, answer.q, u)
    assert np.abs(r).max() < 1e-10 * max(np.abs(part).max(initial=0) for part in parts)


# The continuous rod


@pytest.mark.parametrize(("name", "index", "N"), results(EXACT))
def test_constant_strain_is_exact_where_the_rod_bends_evenly(name, index, N):
    tolerance = oracle(name)["tolerance"]["continuous_abs_over_L"] * oracle(name)["spec"]["L"]
    assert error_of_tip(name, index, N) < tolerance


@pytest.mark.parametrize(("name", "index"), cases("octopus_arm", excluded=True))
def test_the_continuous_rod_is_approached_at_second_order(name, index):
    N = SLOPES[name]
    errors = [error_of_tip(name, index, n) for n in N]
    slope = -np.polyfit(np.log(N), np.log(errors), 1)[0]
    assert 1.8 < slope < 2.2
    assert errors[-1] < errors[-2] / 3.6


@pytest.mark.parametrize("index", [0, 1])  # the third load curls it up more than so few sections can follow
def test_the_tapered_arm_approaches_the_continuous_one_at_second_order_late(index):
    """Its thin end curls up, so that eight sections are still a coarse view of it."""
    errors = [error_of_tip("octopus_arm", index, n) for n in (8, 16, 32)]
    slope = np.log2(errors[1] / errors[2])
    assert 1.8 < slope < 2.2
    assert errors[0] < 0.01 * oracle("octopus_arm")["spec"]["L"]


@pytest.mark.parametrize(("name", "index", "N"), results(SLOPES))
def test_errors_against_the_continuous_rod_are_those_of_the_file(name, index, N):
    expected = oracle(name)["results"][index]["pcs_tip_position_error_vs_continuous"][str(N)]
    tolerance = oracle(name)["tolerance"]["continuous_abs_over_L"] * oracle(name)["spec"]["L"]
    assert abs(error_of_tip(name, index, N) - expected) < tolerance


@pytest.mark.parametrize("index", range(6))
def test_the_elastica_of_elliptic_integrals_is_approached_by_extrapolation(index):
    result = oracle("tip_dead_load_inextensible")["results"][index]
    exact = result["elastica_elliptic_integrals"]
    tips = [solved("tip_dead_load_inextensible", index, N)[1][:3, 3] for N in (4, 8, 16)]
    once = [b + (b - a) / 3 for a, b in zip(tips, tips[1:], strict=False)]
    tip = once[1] + (once[1] - once[0]) / 15
    np.testing.assert_allclose(tip, [exact["x_over_L"], 0, -exact["deflection_over_L"]], rtol=0, atol=2e-4)


@pytest.mark.parametrize("index", range(3))
def test_the_continuous_rod_with_a_helical_tendon_is_reached_by_extrapolation(index):
    spec, result = oracle("tendon_helical")["spec"], oracle("tendon_helical")["results"][index]
    tips = [solved("tendon_helical", index, N)[1] for N in (8, 16, 32)]
    once = [b + (b - a) / 3 for a, b in zip(tips, tips[1:], strict=False)]
    g = once[1] + (once[1] - once[0]) / 15
    exact = np.array(result["continuous"]["tip_pose"])
    np.testing.assert_allclose(g[:3, 3], exact[:3, 3], rtol=0, atol=1e-7 * spec["L"])  # 2e-4 L with 32 sections
    np.testing.assert_allclose(g[:3, :3], exact[:3, :3], rtol=0, atol=2e-7)


@pytest.mark.parametrize(("name", "index"), cases("bend45"))
def test_internal_force_and_moment_at_the_base_carry_the_load(name, index):
    """The force holds for any number of sections; the moment as nearly as the tip stands where it should."""
    robot, u = robot_of(name, index, 8)
    answer, _ = solved(name, index, 8)
    continuous = oracle(name)["results"][index]["continuous"]
    F = array(robot.functions().internal_wrench("arm", 0.0)(answer.q, u))
    force, moment = (np.array(continuous[f"base_total_internal_{key}_world"]) for key in ("force", "moment"))
    np.testing.assert_allclose(F[3:], force, rtol=0, atol=1e-9 * np.linalg.norm(force))
    np.testing.assert_allclose(F[:3], moment, rtol=0, atol=0.01 * np.linalg.norm(moment))


# Closed forms: a silicone arm, E = 110 kPa, radius 10 mm, length 0.25 m

ARM = dict(length=0.25, cross_section=Circle(radius=0.01), quadrature=10)
SILICONE = Linear(young_modulus=110e3, poisson_ratio=0.0, density=DENSITY)
WEIGHTLESS = (0.0, 0.0, 0.0)


def arm(strains, *, sections=1, actuators=None, loads=None):
    rod = Rod(material=SILICONE, strains=strains, sections=sections, **ARM)
    return Robot(Description(segments={"arm": rod}, gravity=WEIGHTLESS, actuators=actuators, loads=loads))


def pose_at_rest(robot, u=()):
    answer = Balance(robot).solve(u)
    assert answer.status.solved
    return answer.q, array(robot.functions().pose("arm")(answer.q))


@pytest.mark.parametrize(
    ("strains", "tip"),
    [
        ("kirchhoff_love", (0.07714459, 0.17590141)),
        ("inextensible_kirchhoff_love", (0.07944346, 0.18114320)),
    ],
)
@pytest.mark.parametrize("sections", [1, 3])
def test_a_straight_tendon_bends_an_arm_into_a_known_arc(strains, tip, sections):
    robot = arm(strains, sections=sections, actuators={"t": Tendon(along=("arm",), offset=(0.008, 0.0))})
    q, g = pose_at_rest(robot, [1.0])
    strain = q.reshape(sections, -1)
    np.testing.assert_allclose(strain[:, 2], 9.25992396, rtol=1e-8)
    np.testing.assert_allclose(g[:2, 3], tip, rtol=0, atol=1e-8)
    if strains == "kirchhoff_love":
        np.testing.assert_allclose(1 + strain[:, 3], 0.97106274, rtol=1e-8)


def test_a_straight_chamber_bends_an_arm_the_other_way():
    chamber = Chamber(along=("arm",), offset=(0.008, 0.0), area=1e-5)
    q, _ = pose_at_rest(arm("kirchhoff_love", actuators={"p": chamber}), [20e3])
    np.testing.assert_allclose(q[2], -1.85198479, rtol=1e-8)
    np.testing.assert_allclose(1 + q[3], 1.00578745, rtol=1e-8)


@pytest.mark.parametrize("sections", [1, 2, 4, 8, 16])
def test_a_dead_load_bends_an_arm_as_the_least_energy_of_plane_arcs(sections):
    robot = arm(("bend_z",), sections=sections, loads={"tip": Wrench(on="arm", force=(0.0, 0.01, 0.0))})
    q, g = pose_at_rest(robot)
    J, h = np.pi * 0.01**4 / 4, 0.25 / sections

    def height(kappa):
        """Tip of arcs of curvature kappa, one after the other."""
        turn = np.concatenate([[0], np.cumsum(kappa * h)])
        return ((np.cos(turn[:-1]) - np.cos(turn[1:])) / kappa).sum()

    lift = [np.imag(height(q + 1e-30j * e)) / 1e-30 for e in np.eye(sections)]
    np.testing.assert_allclose(110e3 * J * h * q, 0.01 * np.array(lift), rtol=1e-10)
    np.testing.assert_allclose(g[1, 3], height(q), rtol=1e-12)
    heights = {1: 0.0433865758, 2: 0.0536872343, 4: 0.0562027157, 8: 0.0568274567, 16: 0.0569833792}
    np.testing.assert_allclose(g[1, 3], heights[sections], rtol=0, atol=1e-10)


def test_distance_to_the_elastica_falls_at_second_order():
    N, errors = (2, 4, 8, 16), []
    for n in N:
        robot = arm(("bend_z",), sections=n, loads={"tip": Wrench(on="arm", force=(0.0, 0.01, 0.0))})
        _, g = pose_at_rest(robot)
        errors.append(np.linalg.norm(g[:2, 3] - [0.24204856, 0.05703533]))
    assert 1.8 < -np.polyfit(np.log(N), np.log(errors), 1)[0] < 2.2


@pytest.mark.parametrize("strains", ["planar_constant_curvature", "kirchhoff_love", "simo_reissner"])
@pytest.mark.parametrize("sections", [1, 2, 5])
@pytest.mark.parametrize("axes", ["world", "body"])
def test_a_moment_of_two_pi_EJ_over_L_closes_a_circle(strains, sections, axes):
    J = np.pi * 0.01**4 / 4
    moment = (0.0, 0.0, 2 * np.pi * 110e3 * J / 0.25)
    robot = arm(strains, sections=sections, loads={"tip": Wrench(on="arm", moment=moment, axes=axes)})
    _, g = pose_at_rest(robot)
    np.testing.assert_allclose(g, np.eye(4), rtol=0, atol=1e-9)


def test_a_joint_in_front_of_the_arm_turns_until_its_spring_carries_the_moment():
    """M = K theta at the hinge, M = E J kappa in the rod."""
    J, M, K = np.pi * 0.01**4 / 4, 2e-3, 5e-3
    segments = {
        "hinge": Revolute(axis=(0.0, 0.0, 1.0), stiffness=K),
        "arm": Rod(material=SILICONE, parent="hinge", strains="kirchhoff_love", **ARM),
        "cap": Fixed(parent="arm", tip=Placement(position=(0.02, 0.0, 0.0))),
    }
    load = {"tip": Wrench(on="cap", moment=(0.0, 0.0, M))}
    answer = Balance(Robot(Description(segments=segments, gravity=WEIGHTLESS, loads=load))).solve([])
    np.testing.assert_allclose(answer.q, [M / K, 0, 0, M / (110e3 * J), 0], rtol=1e-10, atol=1e-12)
