"""Robots with loops: those of the reference files, planar chains of bars, and random ones."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

import socontrol as so
from socontrol.mechanics import loops
from socontrol.mechanics.actuators import JointTorque
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.loops import End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import JOINTS, Prismatic, Revolute, Spherical
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle, Taper
from socontrol.programs.postures.statics import Statics
from socontrol.quantities import Bad

REFERENCE = Path(__file__).parent / "reference"
Z = (0.0, 0.0, 1.0)
ROWS = ["linear_spring", "planar_constant_curvature", "inextensible_constant_curvature", "constant_curvature",
        "inextensible_kirchhoff_love", "kirchhoff_love", "simo_reissner"]  # fmt: skip


@cache
def oracle(name):
    return json.loads((REFERENCE / f"closed_{name}.json").read_text())


def bar(length, parent="world", position=(0.0, 0.0, 0.0), mass=0.2, **changes):
    """A slender bar along x that turns about z."""
    inertia = mass * length**2 / 12
    body = Body(mass=mass, com=(length / 2, 0.0, 0.0), inertia=(inertia / 2, inertia, inertia))
    return Revolute(parent=parent, axis=Z, placement=Placement(position), tip=Placement((length, 0.0, 0.0)), body=body,
                    **changes)  # fmt: skip


def four_bar(a, b, c, d, masses=(0.2, 0.5, 0.4), **changes):
    """Crank a, coupler b, rocker c on a ground of d; a pin closes it."""
    segments = {"crank": bar(a, mass=masses[0]), "coupler": bar(b, "crank", mass=masses[1]),
                "rocker": bar(c, position=(d, 0.0, 0.0), mass=masses[2])}  # fmt: skip
    pin = loops.Revolute(a=End(segment="coupler"), b=End(segment="rocker"), axis=Z)
    given = {"gravity": (0.0, -9.81, 0.0), "loops": {"pin": pin}, "actuators": {"motor": JointTorque(joint="crank")}}
    return Description(segments=segments, **{**given, **changes})


def rigid_four_bar():
    given = oracle("fourbar_rigid")["inputs"]
    return four_bar(*(given[k] for k in "abcd"), masses=given["masses"], gravity=(0.0, -given["g"], 0.0))


def flexible(name):
    """The robot of a file of flexible chains, and its inputs."""
    spec = oracle(name)
    names = [f"e{k}" for k in range(len(spec["elements"]))]
    segments = {name: _element(names, element) for name, element in zip(names, spec["elements"], strict=True)}
    closing = {f"pin{k}": _closing(names, row) for k, row in enumerate(spec["constraints"])}
    loads = {f"push{k}": Wrench(on=names[row["element"]], force=tuple(row["force_world"]))
             for k, row in enumerate(spec["point_forces"])}  # fmt: skip
    driven = [k for k, tau in enumerate(spec["tau"]) if tau]  # joints come first in the files that drive any
    actuators = {f"motor{k}": JointTorque(joint=names[k]) for k in driven}
    description = Description(segments=segments, gravity=tuple(spec["gravity"]), actuators=actuators, loads=loads,
                              loops=closing)  # fmt: skip
    return description, np.array([spec["tau"][k] for k in driven])


def _placement(g):
    g = np.array(g)
    return Placement(tuple(g[:3, 3].tolist()), tuple(Rotation.from_matrix(g[:3, :3]).as_rotvec().tolist()))


def _element(names, spec):
    stands = {"parent": "world" if spec["parent"] < 0 else names[spec["parent"]], "placement": _placement(spec["g0"])}
    if spec["type"] == "section":
        circles = [Circle(radius=spec[k]) for k in ("r_base", "r_tip")]
        material = Linear(young_modulus=spec["E"], poisson_ratio=spec["nu"], density=spec["rho"], viscosity=spec["eta"])
        return Rod(length=spec["L"], cross_section=Taper(start=circles[0], end=circles[1]), material=material,
                   strains="planar_constant_curvature", quadrature=10, **stands)  # fmt: skip
    body = spec["body"]
    turned = body["I_com"][2][2]  # the only entry that counts in the plane
    body = Body(mass=body["mass"], com=tuple(body["com"]), inertia=(turned,) * 3) if body["mass"] else None
    return Revolute(axis=Z, stiffness=spec["stiffness"][0], damping=spec["damping"][0], body=body, **stands)


def _closing(names, row):
    ends = {key: End(segment=names[row[key][0]], placement=Placement(tuple(row[key][1]))) for key in ("a", "b")}
    if "ang" not in row:
        return loops.Revolute(axis=Z, **ends)
    turned = Placement(tuple(row["b"][1]), (0.0, 0.0, row["ang"]))
    return loops.Fixed(a=ends["a"], b=End(segment=names[row["b"][0]], placement=turned))


def world_wrenches(robot, q, lam):
    """{loop: wrench [6] on a by b, about b's joint frame, world axes}."""
    found, f = {}, robot.functions(compiled=False)
    for name, own in loops.slices(robot.loops).items():
        loop = robot.loops[name]
        wrench = np.array(ca.DM(loop.Phi_perp())) @ np.asarray(lam)[own]
        g = np.array(ca.DM(loop.b.placement.pose()))
        if loop.b.segment != "world":
            g = np.array(f.pose(loop.b.segment, loop.b.at).function(q)) @ g
        found[name] = np.concatenate([g[:3, :3] @ wrench[:3], g[:3, :3] @ wrench[3:]])
    return found


def random_chain(seed, kind=None):
    """A robot of two branches of joints and rods whose loop can close: b stands where a is at a hidden shape.

    Weights, springs and a cross force push it; from q = 0 its ends are apart. Two loops in every third.
    """
    rng = np.random.default_rng(seed)
    segments, ends = {}, []
    for branch in "ab":
        parent, soft = "world", rng.random() < 0.5
        for k in range(rng.integers(3, 5)):
            name = f"{branch}{k}"
            segments[name] = _random_rod(rng, parent) if soft and k % 2 else _random_joint(rng, parent)
            parent = name
        ends.append(parent)
    kinds = [kind or str(rng.choice(list(loops.LOOPS)))] + ["spherical"] * (seed % 3 == 0)
    pairs = [((ends[0], 1.0), (ends[1], 1.0)), (("a1", 1.0), ("b1", 1.0))][: len(kinds)]
    found = _closed(rng, segments, kinds, pairs, ends[0])
    return found or random_chain(seed + 1000, kind)  # no freedom is left


def wide_chain(seed):
    """A robot of two to four branches, which may stand on the first, of joints of every kind and rods of every row of
    strains, tapered ones among them; one to three loops of any kind join them, rods also at their middle, or the world.
    Weights, springs and a cross force push it; from q = 0 its ends are apart."""
    rng = np.random.default_rng(10_000 + seed)
    segments, ends = {}, []
    for branch in "abcd"[: rng.integers(2, 5)]:
        parent = ends[0] if ends and rng.random() < 0.2 else "world"
        for k in range(rng.integers(2, 4)):
            name = f"{branch}{k}"
            segments[name] = _any_rod(rng, parent) if rng.random() < 0.5 else _any_joint(rng, parent)
            parent = name
        ends.append(parent)
    count = min(int(rng.integers(1, 4)), len(ends) - 1 + int(rng.random() < 0.3))
    kinds = [str(rng.choice(list(loops.LOOPS))) for _ in range(count)]
    places = [*(_place(rng, segments, end) for end in ends), ("world", 1.0)]
    pairs = list(zip(places, places[1:], strict=False))[:count]
    found = _closed(rng, segments, kinds, pairs, ends[0])
    return found or wide_chain(seed + 1000)


def _place(rng, segments, name):
    """A segment and X: its end, or the middle of a rod."""
    return name, 0.5 if isinstance(segments[name], Rod) and rng.random() < 0.3 else 1.0


def _closed(rng, segments, kinds, pairs, pushed):
    """The segments with loops of the kinds that close at a hidden shape; None where they leave no freedom."""
    loads = {"push": Wrench(on=pushed, force=tuple(rng.uniform(-0.5, 0.5, 3).tolist()))}
    tree = Robot(Description(segments=segments))
    sizes = np.array([{"rad": 1.0, "m": 0.02, "1/m": 3.0}.get(unit, 0.02) for unit in tree.coordinate_units])
    q, f = rng.uniform(-1, 1, tree.n) * sizes, tree.functions()
    closing = {}
    for k, (kind, (a, b)) in enumerate(zip(kinds, pairs, strict=True)):
        at_a, at_b = (np.eye(4) if on == "world" else np.array(f.pose(on, X).function(q)) for on, X in (a, b))
        there = np.linalg.solve(at_b, at_a)
        axis = {} if kind in ("spherical", "fixed") else {"axis": tuple(rng.uniform(-1, 1, 3).tolist())}
        pitch = {"pitch": 0.01} if kind == "helical" else {}
        joined = End(segment=b[0], at=b[1], placement=_placement(there))
        closing[f"loop{k}"] = loops.LOOPS[kind](a=End(segment=a[0], at=a[1]), b=joined, **axis, **pitch)
    try:
        return replace(tree.description, loops=closing, loads=loads)
    except Bad:
        return None


def _random_joint(rng, parent):
    axis, length = tuple(rng.uniform(-1, 1, 3).tolist()), rng.uniform(0.08, 0.2)
    body = Body(mass=0.1, com=(length / 2, 0.0, 0.0), inertia=(1e-4, 1e-4, 1e-4))
    common = {"parent": parent, "tip": Placement((length, 0.0, 0.0)), "body": body}
    if parent == "world":
        common["placement"] = Placement(tuple(rng.uniform(-0.1, 0.1, 3).tolist()))
    kind = rng.choice(["revolute", "spherical", "prismatic"], p=[0.4, 0.4, 0.2])
    if kind == "spherical":
        return Spherical(stiffness=(0.02,) * 3, **common)
    return Revolute(axis=axis, **common) if kind == "revolute" else Prismatic(axis=axis, stiffness=200.0, **common)


def _random_rod(rng, parent):
    return Rod(parent=parent, length=rng.uniform(0.08, 0.2), cross_section=Circle(radius=0.004), sections=2,
               material=Linear(young_modulus=1e6, poisson_ratio=0.45, density=1000.0))  # fmt: skip


def _any_joint(rng, parent):
    kind = str(rng.choice(["revolute", "prismatic", "helical", "cylindrical", "planar", "spherical", "free"]))
    record, length = JOINTS[kind], rng.uniform(0.08, 0.2)
    freedoms = len(record.units)
    soft = [0.02 if unit == "rad" else 200.0 for unit, _ in record.units]
    body = Body(mass=0.1, com=(length / 2, 0.0, 0.0), inertia=(1e-4, 1e-4, 1e-4))
    more = {} if kind in ("spherical", "free") else {"axis": tuple(rng.uniform(-1, 1, 3).tolist())}
    if kind == "helical":
        more["pitch"] = 0.02
    if kind != "revolute":  # which its weight or a loop holds
        more["stiffness"] = tuple(soft) if freedoms > 1 else soft[0]
    placement = Placement(tuple(rng.uniform(-0.1, 0.1, 3).tolist())) if parent == "world" else Placement()
    return record(parent=parent, tip=Placement((length, 0.0, 0.0)), body=body, placement=placement, **more)


def _any_rod(rng, parent):
    start = float(rng.uniform(0.003, 0.006))
    section = Circle(radius=start)
    if rng.random() < 0.3:
        section = Taper(start=section, end=Circle(radius=0.6 * start))
    turned = Placement((0.0, 0.0, 0.0), tuple(rng.uniform(-0.5, 0.5, 3).tolist()))
    return Rod(parent=parent, length=float(rng.uniform(0.08, 0.25)), cross_section=section, placement=turned,
               sections=int(rng.integers(1, 5)), strains=str(rng.choice(ROWS)),
               material=Linear(young_modulus=1e6, poisson_ratio=0.45, density=1000.0))  # fmt: skip


def impossible_chain(seed):
    """A planar chain of three to five bars with a pin further away than they reach, and by how much."""
    rng = np.random.default_rng(seed)
    lengths, gap = rng.uniform(0.05, 0.3, rng.integers(3, 6)), rng.uniform(0.01, 0.5)
    segments, parent = {}, "world"
    for k, length in enumerate(lengths):
        segments[f"bar{k}"] = bar(float(length), parent)
        parent = f"bar{k}"
    angle, reach = rng.uniform(0, 2 * np.pi), float(np.sum(lengths)) + gap
    ground = Placement((reach * np.cos(angle), reach * np.sin(angle), 0.0))
    pin = loops.Revolute(a=End(segment=parent), b=End(segment="world", placement=ground), axis=Z)
    return Description(segments=segments, loops={"far": pin}), gap


L_BEAM_TORSION = {"b^4/6": 0.05**4 / 6, "Saint-Venant": None}  # m^4; None: as the square has


def l_beam_displacement(sections, torsion):
    """Largest displacement [m] of the clamped L under its weight, `sections` a bar."""
    robot = so.load_robot(Path(__file__).parents[1] / "configs" / "robots" / "l_beam.yaml")
    bars = {
        name: replace(bar, sections=sections, cross_section=replace(bar.cross_section, torsion_constant=torsion))
        for name, bar in robot.description.segments.items()
    }
    result = Statics(robot=Robot(replace(robot.description, segments=bars)), discretisation=False).solve().require()
    return result["largest_displacement"]
