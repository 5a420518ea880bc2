"""Robots in motion against numbers of independent codes and of closed forms.

`rigid_*`: Pinocchio 4.1. `dyn_*` and `hybrid_*`: a numpy tree code with ten Gauss points a section, whose trajectories
come from scipy's DOP853. `hybrid_floating_flagella_fluid` has one implementation behind it; `test_fluids` derives its
terms a second time. Cantilevers: characteristic equations of T. C. Huang, J. Appl. Mech. 28 (1961), solved here.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots import array
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from test_rigid_oracles import FILES as RIGID
from test_rigid_oracles import assert_close
from test_rigid_oracles import functions as rigid_functions
from test_rigid_oracles import oracle as rigid_oracle

from socontrol.mechanics.actuators import JointTorque, Tendon
from socontrol.mechanics.loads import Fluid, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.fluids import RodFluid
from socontrol.model.joints import Fixed, Free, Prismatic, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, Taper

REFERENCE = Path(__file__).parent / "reference"
RODS = ["dyn_rod_N1_SR", "dyn_rod_N2_IKL", "dyn_rod_N2_SR", "dyn_rod_N4_IKL", "dyn_rod_N4_SR", "dyn_rod_settling"]
HYBRIDS = [
    "hybrid_floating_flagella_fluid",
    "hybrid_floating_flagella_vacuum",
    "hybrid_revolute_soft_tipbody",
    "hybrid_two_branch_gripper",
]
ROWS = {"SR": "simo_reissner", "KL": "kirchhoff_love", "IKL": "inextensible_kirchhoff_love"}
SAMPLES = 2  # of the 21 or 31 stored along a trajectory: beyond, time is spent and nothing new is tested


# Trees of rigid bodies. Their files give all terms by the rates qd of exponential coordinates and by quasi-velocities
# nu = D(q) qd; forces pull back as D^T, and nu' = D qdd + D' qd.


@cache
def pushed(name):
    """Functions of a tree with a motor on each joint and a wrench on each body, the wrenches left open."""
    base = rigid_functions(name).base.description
    some = dict(force=(1.0, 1.0, 1.0), moment=(1.0, 1.0, 1.0), axes="body")
    description = Description(
        segments=base.segments,
        gravity=base.gravity,
        loads={f"on_{s}": Wrench(on=s, **some) for s in base.segments},
        actuators={f"motor_{s}": JointTorque(joint=s) for s in base.segments},
    )
    return Robot(description).functions(
        parameters=[f"loads.on_{s}.{key}" for s in base.segments for key in ("moment", "force")]
    )


def rigid_states(name):
    for state in rigid_oracle(name)["states"]:
        outputs = state["outputs"]
        yield state, outputs["exponential_coordinates"], outputs["quasi_velocity"]


@pytest.mark.parametrize("name", RIGID)
def test_mass_matrices_agree_with_pinocchio(name):
    for state, ours, quasi in rigid_states(name):
        M, D = array(rigid_functions(name).mass(state["q"])), np.array(ours["D"])
        assert_close(name, M, ours["M"])
        assert_close(name, M, D.T @ quasi["M"] @ D)


@pytest.mark.parametrize("name", RIGID)
def test_velocity_terms_agree_with_pinocchio(name):
    f = rigid_functions(name)
    for state, ours, quasi in rigid_states(name):
        q, qd, D = state["q"], np.array(state["qd"]), np.array(ours["D"])
        velocity = array(f.coriolis(q, qd)) @ qd
        bias = array(f.inverse_dynamics(q, qd, 0 * qd))
        assert_close(name, velocity, ours["coriolis_term"])
        assert_close(name, bias, ours["bias"])
        turning = np.array(quasi["M"]) @ np.array(ours["Ddot"]) @ qd
        assert_close(name, velocity, D.T @ (quasi["coriolis_term"] + turning))
        assert_close(name, bias, D.T @ (quasi["bias"] + turning))


@pytest.mark.parametrize("name", RIGID)
def test_inverse_dynamics_agree_with_pinocchio(name):
    for state, ours, quasi in rigid_states(name):
        motion, D = (state["q"], state["qd"], state["qdd"]), np.array(ours["D"])
        alone = array(rigid_functions(name).inverse_dynamics(*motion))
        pushes = np.ravel(state["body_wrench_ext"])
        under_wrenches = array(pushed(name).inverse_dynamics(*motion, pushes))
        for tau, key in ((alone, "rnea_no_ext"), (under_wrenches, "rnea_with_ext")):
            assert_close(name, tau, ours[key])
            assert_close(name, tau, D.T @ quasi[key])


@pytest.mark.parametrize("name", RIGID)
def test_forward_dynamics_agree_with_pinocchio(name):
    f = pushed(name)
    for state, ours, quasi in rigid_states(name):
        q, qd, pushes = state["q"], np.array(state["qd"]), np.ravel(state["body_wrench_ext"])
        B, D = array(f.actuation(q, pushes)).reshape(len(q), -1), np.array(ours["D"])
        qdd = array(f.forward_dynamics(q, qd, np.linalg.solve(B, ours["tau_in"]), pushes))
        assert_close(name, qdd, ours["aba_qdd_with_ext"])
        qdd = array(f.forward_dynamics(q, qd, np.linalg.solve(B, D.T @ quasi["tau_in"]), pushes))
        assert_close(name, D @ qdd + np.array(ours["Ddot"]) @ qd, quasi["aba_nudot_with_ext"])


@pytest.mark.parametrize("name", RIGID)
def test_kinetic_energy_agrees_with_pinocchio(name):
    for state in rigid_oracle(name)["states"]:
        kinetic = array(rigid_functions(name).energy(state["q"], state["qd"]))[0]
        assert_close(name, kinetic, state["outputs"]["kinetic_energy"])


@pytest.mark.parametrize("name", RIGID)
def test_floating_inverse_dynamics_agree_with_pinocchio(name):
    """The base's acceleration is found where Pinocchio's wrench on the base is zero."""
    f = rigid_functions(name)
    if name != "rigid_freeflyer_multi":
        with pytest.raises(ValueError, match="free"):
            _ = f.floating_inverse_dynamics
        return
    for state, ours, _ in rigid_states(name):
        qdd = np.array(state["qdd"])
        base, forces = (array(x) for x in f.floating_inverse_dynamics(state["q"], state["qd"], qdd[6:]))
        M, bias = np.array(ours["M"]), np.array(ours["bias"])
        expected = -np.linalg.solve(M[:6, :6], bias[:6] + M[:6, 6:] @ qdd[6:])
        assert_close(name, base, expected)
        assert_close(name, forces, M[6:] @ np.concatenate([expected, qdd[6:]]) + bias[6:])


# Rods and hybrids


@cache
def oracle(name):
    return json.loads((REFERENCE / f"{name}.json").read_text())


def placement(element):
    g = np.array(element.get("g0", np.eye(4)))
    rotation = Rotation.from_matrix(g[:3, :3]).as_rotvec()
    return Placement(position=tuple(g[:3, 3].tolist()), rotation=tuple(rotation.tolist()))


def body(numbers):
    return Body(
        mass=numbers["mass"],
        com=tuple(map(float, numbers["com"])),
        inertia=tuple(map(tuple, numbers["I_com"])),
        displaced_volume=numbers.get("displaced_volume", 0.0),
    )


def joint(element, parent):
    B = np.array(element["B"])
    common = dict(parent=parent, placement=placement(element), body=body(element["tip_body"]))
    if B.shape[1] == 6:
        return Free(**common)
    common |= {key: element[key][0] for key in ("stiffness", "damping") if key in element}
    kind = Revolute if B[:3].any() else Prismatic
    return kind(axis=tuple((B[:3, 0] + B[3:, 0]).tolist()), **common)


def soft(sections, parent, water, undamped):
    """One rod of the sections of a file that follow each other."""
    first, last = sections[0], sections[-1]
    fluid = RodFluid()
    if water:
        fluid = RodFluid(
            tangential=water["C_t"], normal=water["C_n"], linear=(water["c_t"], water["c_n"]),
            added_mass=(water["C_a"], water["C_a"]),
        )  # fmt: skip
    return Rod(
        parent=parent,
        placement=placement(first),
        length=sum(s["L"] for s in sections),
        cross_section=Taper(start=Circle(radius=first["r_base"]), end=Circle(radius=last["r_tip"])),
        material=Linear(
            young_modulus=first["E"],
            poisson_ratio=first["nu"],
            density=first["rho"],
            viscosity=0.0 if undamped else first["eta"],
        ),
        strains=ROWS[first["basis"]],
        sections=len(sections),
        quadrature=10,  # what the files used
        fluid=fluid,
    )


def chains(elements):
    """(indices of elements that become one segment): joints alone, sections that continue each other together."""
    rows = []
    for i, element in enumerate(elements):
        if element["type"] == "section" and rows and rows[-1][-1] == element["parent"] and "g0" not in element:
            rows[-1].append(i)
        else:
            rows.append([i])
    return rows


@cache
def functions(name, undamped=False):
    """(Functions, u, {element: (segment, X)}) of the robot of a file."""
    file = oracle(name)
    elements, water, segments, where = file["elements"], file["fluid"], {}, {}
    for row in chains(elements):
        parent = where[elements[row[0]]["parent"]][0] if elements[row[0]]["parent"] >= 0 else "world"
        segment = f"e{row[0]}"
        where |= {i: (segment, (k + 1) / len(row)) for k, i in enumerate(row)}
        if elements[row[0]]["type"] == "joint":
            segments[segment] = joint(elements[row[0]], parent)
            continue
        segments[segment] = soft([elements[i] for i in row], parent, water, undamped)
        if "tip_body" in elements[row[-1]]:
            segments[f"{segment}_tip"] = Fixed(parent=segment, body=body(elements[row[-1]]["tip_body"]))
    actuators, u = {}, []
    for k, line in enumerate(file["actuators"]):
        offset = (line["r"] * np.cos(line["phase"]), line["r"] * np.sin(line["phase"]))
        actuators[f"cable{k}"] = Tendon(along=(where[line["elements"][0]][0],), offset=tuple(map(float, offset)))
        u.append(line["T"])
    if any(file["tau"]):
        assert not any(file["tau"][1:])  # one motor, on the first joint
        actuators["motor"] = JointTorque(joint="e0")
        u.append(file["tau"][0])
    description = Description(
        segments=segments,
        gravity=tuple(map(float, file["gravity"])),
        actuators=actuators or None,
        loads={"water": Fluid(density=water["rho_w"])} if water else None,
    )
    return Robot(description).functions(), np.array(u), where


def states(name):
    f, u, where = functions(name)
    for state in oracle(name)["states"]:
        yield f, u, where, state, np.array(state["q"]), np.array(state["qd"])


def assert_terms(name, value, expected):
    """Equal within the tolerance of the file, relative to the largest entry."""
    value, expected = array(value), np.array(expected)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(value, expected, rtol=0, atol=oracle(name)["tolerance"]["terms_rel"] * scale + 1e-16)


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_mass_matrices_agree_with_the_tree_code(name):
    for f, _, _, state, q, _ in states(name):
        assert_terms(name, f.mass(q), state["M"])


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_velocity_terms_agree_with_the_tree_code(name):
    for f, _, _, state, q, qd in states(name):
        assert_terms(name, array(f.coriolis(q, qd)) @ qd, state["C_qd"])
        inertial = array(f.inverse_dynamics(q, qd, 0 * q) - f.elastic_force(q)) - array(f.damping(q)) @ qd
        at_rest = array(f.inverse_dynamics(q, 0 * q, 0 * q) - f.elastic_force(q))
        flow = np.array(state["fluid_generalized_force"])
        lost = 1e-14 * np.abs(at_rest).max()  # by the differences, beside terms that can be smaller
        assert np.abs(inertial - at_rest + flow - state["C_qd"]).max() <= lost + 1e-9 * max(
            np.abs(state["C_qd"]).max(), np.abs(flow).max()
        )


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_external_and_cable_forces_agree_with_the_tree_code(name):
    for f, u, _, state, q, qd in states(name):
        still = array(f.external_force(q, 0 * q))
        moving = array(f.external_force(q, qd))
        assert_terms(name, still, state["gravity_generalized_force"])
        total = np.array(state["gravity_generalized_force"]) + state["fluid_generalized_force"]
        assert_terms(name, moving, total)
        if oracle(name)["actuators"]:
            count = len(oracle(name)["actuators"])
            pulls = array(f.actuation(q)).reshape(len(q), -1)[:, :count] @ u[:count]
            assert_terms(name, pulls, state["cable_generalized_force"])


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_stiffness_and_damping_agree_with_the_tree_code(name):
    for f, _, _, _, q, _ in states(name):
        assert_terms(name, f.stiffness(q), oracle(name)["K"])
        assert_terms(name, f.damping(q), oracle(name)["D"])


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_accelerations_agree_with_the_tree_code(name):
    for f, u, _, state, q, qd in states(name):
        assert_terms(name, f.forward_dynamics(q, qd, u), state["qdd"])


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_motion_of_the_last_element_agrees_with_the_tree_code(name):
    for f, _, where, state, q, _ in states(name):
        for element, (segment, X) in where.items():
            assert_terms(name, f.pose(segment, X)(q), state["end_poses"][element])
        last = where[len(where) - 1]
        assert_terms(name, f.jacobian(*last)(q), state["end_J_last_element"])


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_energies_agree_with_the_tree_code(name):
    for f, _, _, state, q, qd in states(name):
        kinetic, elastic, weight = array(f.energy(q, qd))
        assert kinetic == pytest.approx(state["kinetic_energy"], rel=1e-9)
        assert elastic == pytest.approx(state["elastic_energy"], rel=1e-9)
        assert weight == pytest.approx(state["potential_gravity"], rel=1e-9, abs=1e-15)


TRAJECTORIES = [(name, k) for name in RODS + HYBRIDS for k in range(len(oracle(name)["trajectories"]))]


@pytest.mark.parametrize("name, k", TRAJECTORIES)
def test_the_first_samples_of_trajectories_are_those_of_the_tree_code(name, k):
    path = oracle(name)["trajectories"][k]
    f, u, _ = functions(name, path["undamped"])
    u = u * path["with_actuation"]
    accelerations, n = f.forward_dynamics.function, f.robot.n

    def rate(_, y):
        return np.concatenate([y[n:], np.ravel(accelerations(y[:n], y[n:], u))])

    t, start = path["t"][:SAMPLES], np.concatenate([path["q0"], path["qd0"]])
    run = solve_ivp(rate, (t[0], t[-1]), start, t_eval=t, method="DOP853", rtol=1e-9, atol=1e-9)
    q, qd = run.y[:n].T, run.y[n:].T
    for ours, key in ((q, "q"), (qd, "qd")):
        stored = np.array(path[key])
        assert np.abs(ours - stored[:SAMPLES]).max() < 1e-6 * np.ptp(stored)
        assert np.abs(stored[SAMPLES - 1] - stored[0]).max() > 1e-3 * np.ptp(stored)  # it went somewhere


@pytest.mark.parametrize("name", RODS + HYBRIDS)
def test_stored_energies_are_those_of_the_stored_motion(name):
    for path in oracle(name)["trajectories"]:
        f, _, _ = functions(name, path["undamped"])
        for q, qd, expected in zip(path["q"], path["qd"], path["total_energy"], strict=True):
            parts = array(f.energy(q, qd))
            assert abs(parts.sum() - expected) <= 1e-9 * max(np.abs(parts).max(), abs(expected)), q


def test_momentum_is_conserved_along_the_stored_motion_in_vacuum():
    """Cables pull within the robot; the trajectories were integrated to 1e-9."""
    f, _, _ = functions("hybrid_floating_flagella_vacuum")
    for path in oracle("hybrid_floating_flagella_vacuum")["trajectories"]:
        momenta = np.array([array(f.momentum(q, qd)) for q, qd in zip(path["q"], path["qd"], strict=True)])
        for part in (momenta[:, :3], momenta[:, 3:]):
            assert np.ptp(part, axis=0).max() < 1e-7 * np.abs(part[0]).max()
        assert np.ptp(np.array(path["qd"]), axis=0).max() > 0.1


def test_the_settling_rod_settles_where_statics_says():
    f, u, _ = functions("dyn_rod_settling")
    equilibrium = oracle("dyn_rod_settling")["static_equilibrium"]
    q = np.array(equilibrium["q"])
    weight = np.abs(array(f.external_force(q, 0 * q))).max()
    assert np.abs(array(f.inverse_dynamics(q, 0 * q, 0 * q))).max() < 1e-12 * weight
    assert_terms("dyn_rod_settling", f.pose("e0")(q), equilibrium["tip_pose"])


# Cantilevers


CANTILEVER = oracle("dyn_natural_frequencies")
SECTIONS = (4, 8, 16)  # N = 2 is not asymptotic yet


@cache
def frequencies(N, row):
    """Angular frequencies [rad/s] of the straight cantilever of N sections, from its stiffness and mass."""
    given = CANTILEVER["inputs"]
    rod = Rod(
        length=given["L"],
        cross_section=Circle(radius=given["r"]),
        material=Linear(young_modulus=given["E"], poisson_ratio=given["nu"], density=given["rho"]),
        strains=ROWS[row],
        sections=N,
        quadrature=4,  # exact: the integrands are of degree six at most, along a straight section
    )
    f = Robot(Description(segments={"rod": rod}, gravity=(0.0, 0.0, 0.0))).functions()
    q = np.zeros(f.robot.n)
    return np.sqrt(eigh(array(f.stiffness(q)), array(f.mass(q)), eigvals_only=True))


@pytest.mark.parametrize("key", CANTILEVER["pcs"])
def test_frequencies_of_constant_strain_rods_agree_with_the_tree_code(key):
    N, row = key[1:].split("_")
    expected = np.array(CANTILEVER["pcs"][key])
    ours = frequencies(int(N), row)[: len(expected)]
    np.testing.assert_allclose(ours, expected, rtol=CANTILEVER["tolerance"]["pcs_rel"])


def beam(shear):
    """Bending frequencies [rad/s] of a cantilever with rotary inertia, and shear of factor 1 or none (Rayleigh)."""
    given = CANTILEVER["inputs"]
    L, r, E, rho = (given[key] for key in ("L", "r", "E", "rho"))
    A, I, G = np.pi * r**2, np.pi * r**4 / 4, E / (2 * (1 + given["nu"]))
    turn, give = I / (A * L**2), E * I / (A * G * L**2) * shear
    unit = np.sqrt(E * I / (rho * A)) / L**2

    def characteristic(b):
        root = np.sqrt((turn - give) ** 2 + 4 / b**2)
        a, c = b * np.sqrt((root - turn - give) / 2), b * np.sqrt((root + turn + give) / 2)
        mixed = b * (turn + give) / np.sqrt(1 - b**2 * turn * give)
        # divided by cosh a, which grows without a root
        return 2 / np.cosh(a) + (b**2 * (turn - give) ** 2 + 2) * np.cos(c) - mixed * np.tanh(a) * np.sin(c)

    grid = np.linspace(0.5, 150.0, 1500)
    values = [characteristic(b) for b in grid]
    changes = [i for i in range(len(grid) - 1) if values[i] * values[i + 1] < 0]
    return unit * np.array([brentq(characteristic, grid[i], grid[i + 1], xtol=1e-13) for i in changes])


def test_the_characteristic_equation_agrees_with_collocation():
    expected = CANTILEVER["timoshenko_kappa1"]
    np.testing.assert_allclose(beam(shear=1)[: len(expected)], expected, rtol=2e-8)  # what is left of the lowest there


@pytest.mark.parametrize("row, shear", [("SR", 1), ("IKL", 0)])
@pytest.mark.parametrize("mode", [0, 1, 2])
def test_bending_frequencies_tend_to_those_of_the_beam_at_order_two(row, shear, mode):
    exact = beam(shear)[mode]
    errors = []
    for N in SECTIONS:
        bending = frequencies(N, row)
        pairs = bending[:-1][np.diff(bending) < 1e-6 * bending[:-1]]  # in y and in z alike; the others are single
        errors.append(abs(pairs[mode] - exact) / exact)
    order = -np.diff(np.log(errors)) / np.log(2)
    assert order[-1] == pytest.approx(2.0, abs=(0.01, 0.05, 0.1)[mode])  # modes of finer shape are asymptotic later
    assert errors[-1] < (8e-4, 6e-3, 1.5e-2)[mode]


@pytest.mark.parametrize("kind", ["axial", "torsion"])
def test_axial_and_torsional_frequencies_tend_to_those_of_the_bar_at_order_two(kind):
    given = CANTILEVER["inputs"]
    modulus = given["E"] if kind == "axial" else given["E"] / (2 * (1 + given["nu"]))
    exact = np.pi / 2 / given["L"] * np.sqrt(modulus / given["rho"])
    assert exact == pytest.approx(CANTILEVER[kind][0], rel=1e-12)
    errors = [np.abs(frequencies(N, "SR") - exact).min() / exact for N in SECTIONS]
    assert -np.diff(np.log(errors))[-1] / np.log(2) == pytest.approx(2.0, abs=0.01)
