"""Small robots of every kind, and `Plain`: the same robots in numpy alone, to check the library against.

`Plain` reads the records and nothing else of the library. Exponentials are scaled and squared power series,
areas are sums over fibres, lines are polygons, and derivatives come from complex steps,
f'(q) = Im f(q + i h) / h with h = 1e-30 (W. Squire, G. Trapp, SIAM Review 40(1), 1998), good to rounding.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from math import pi

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from socontrol.mechanics.actuators import Chamber, JointTorque, Tendon
from socontrol.mechanics.loads import Distributed, Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.routes import Converging, Helix
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import (
    Cylindrical,
    Fixed,
    Free,
    Helical,
    Planar,
    Prismatic,
    Revolute,
    Spherical,
)
from socontrol.model.materials import Energy, Gent, Linear, Polynomial
from socontrol.model.rods import Rod
from socontrol.model.sections import (
    Annulus,
    Circle,
    Ellipse,
    General,
    Hole,
    Rectangle,
    SectionTable,
    TableRow,
    Taper,
)

STEP = 1e-30  # of complex steps: its square vanishes beside 1
POINTS = 10  # Gauss points a section, not the number the library uses
NAMES = ["twist", "bend_y", "bend_z", "stretch", "shear_y", "shear_z"]
ROWS = {  # columns of each distributed row, from the table of the paper (F. Renda, L. Seneviratne, ICRA 2018)
    "linear_spring": [3],
    "planar_constant_curvature": [2, 3],
    "inextensible_constant_curvature": [1, 2],
    "constant_curvature": [1, 2, 3],
    "inextensible_kirchhoff_love": [0, 1, 2],
    "kirchhoff_love": [0, 1, 2, 3],
    "simo_reissner": [0, 1, 2, 3, 4, 5],
}

# Robots

TILTED = Placement(position=(0.02, -0.03, 0.05), rotation=(0.4, -0.7, 0.3))
TIP = Placement(position=(0.06, 0.01, -0.02), rotation=(0.1, 0.5, -0.2))
BODY = Body(mass=0.05, com=(0.03, -0.01, 0.02), inertia=(3e-5, 4e-5, 5e-5, 4e-6, -3e-6, 2e-6))
RUBBER = Linear(young_modulus=4e5, poisson_ratio=0.45, density=1080.0, viscosity=300.0)
DISC = Circle(radius=0.01)
TUBE = Annulus(inner_radius=0.004, radius=0.012, holes=(Hole(offset=(0.0, 0.008), radius=0.002),))
PULL = Wrench(on="joint", force=(0.3, -0.2, 0.4))
TABLE = SectionTable(
    table=(
        TableRow(at=0.0, section=Ellipse(radius_y=0.012, radius_z=0.009)),
        TableRow(at=0.5, section=Ellipse(radius_y=0.009, radius_z=0.008)),
        TableRow(at=1.0, section=Ellipse(radius_y=0.005, radius_z=0.007)),
    )
)


def spring(n):
    """A symmetric positive definite n x n matrix, as a record holds it."""
    root = np.sin(np.arange(1.0, n * n + 1)).reshape(n, n)
    return tuple(map(tuple, (root @ root.T + np.eye(n)).tolist()))


def rod(**changes):
    common = dict(length=0.25, cross_section=DISC, material=RUBBER, placement=TILTED, sections=2)
    return Rod(**{**common, **changes})


def lumped(joint):
    return Description(
        segments={"joint": joint}, loads={"pull": PULL}, actuators={"motor": JointTorque(joint="joint")}
    )


def cable_rod(**changes):
    """A rod with a cap, a dead force on it, and a cable along the rod."""
    return Description(
        segments={"rod": rod(**changes), "cap": Fixed(parent="rod", body=BODY, tip=TIP)},
        loads={"pull": Wrench(on="cap", force=(0.05, -0.1, 0.08))},
        actuators={"cable": Tendon(along=("rod",), offset=(0.006, -0.003))},
    )


def lumped_robots():
    axis, point = (0.3, -0.5, 0.8), (0.02, 0.01, -0.03)
    common = dict(placement=TILTED, body=BODY, tip=TIP)
    joints = {
        "revolute": Revolute(axis=axis, point=point, stiffness=0.4, rest=0.3, **common),
        "prismatic": Prismatic(axis=axis, stiffness=30.0, rest=0.02, **common),
        "helical": Helical(axis=axis, point=point, pitch=0.05, stiffness=0.4, **common),
        "cylindrical": Cylindrical(axis=axis, point=point, stiffness=spring(2), damping=0.1, **common),
        "planar": Planar(
            axis=axis, point=point, stiffness=(0.4, 20.0, 30.0), rest=(0.1, 0.02, 0.0), **common
        ),
        "spherical": Spherical(point=point, stiffness=spring(3), damping=(0.1, 0.2, 0.3), **common),
        "free": Free(stiffness=spring(6), damping=spring(6), **common),
    }
    robots = {name: lumped(joint) for name, joint in joints.items()}
    robots["fixed"] = Description(
        segments={"link": Fixed(**common), "rod": rod(parent="link")},
        loads={"pull": Wrench(on="rod", force=(0.05, -0.1, 0.08))},
    )
    return robots


def branched():
    """Joints and rods on a tree with placements, one child standing at mid-rod."""
    blade = Rectangle(width=0.01, height=0.02, torsion_constant=2e-9)
    return Description(
        segments={
            "hub": Revolute(axis=(0.2, 1.0, 0.3), placement=TILTED, body=BODY, tip=TIP),
            "arm": rod(parent="hub", sections=(0.3, 0.7)),
            "claw": Revolute(axis=(0, 0, 1.0), parent="arm", at=0.4, placement=TILTED, body=BODY, tip=TIP),
            "finger": rod(parent="claw", sections=1, strains="inextensible_constant_curvature"),
            "side": Spherical(parent="hub", point=(0.01, 0.02, 0.0), placement=TILTED, body=BODY, tip=TIP),
            "wrist": Fixed(parent="arm", body=BODY, tip=TIP),
            "blade": rod(parent="wrist", sections=1, strains="simo_reissner", cross_section=blade),
        },
        loads={
            "nail": Wrench(on="finger", force=(0.05, 0.02, -0.03)),
            "wind": Distributed(on="arm", force=(0.2, -0.1, 0.3)),
            "push": Wrench(on="blade", at=0.5, force=(0.0, 0.04, 0.1)),
        },
        actuators={
            "cable": Tendon(along=("arm",), offset=(0.006, 0.004)),
            "motor": JointTorque(joint="side"),
            "bend": Tendon(along=("claw", "finger"), offset=(0.007, 0.0)),
        },
    )


def threaded():
    """Converging cables through a rod, a hinge with a tip and a second rod."""
    chain = ("lower", "hinge", "upper")
    return Description(
        segments={
            "lower": rod(strains="simo_reissner"),
            "hinge": Revolute(
                axis=(0, 0, 1.0), parent="lower", stiffness=0.2, tip=Placement(position=(0.03, 0, 0))
            ),
            "upper": rod(parent="hinge", sections=1, length=0.15),
        },
        actuators={
            "far": Tendon(along=chain, offset=Converging(start=(0.008, 0.002), end=(-0.003, 0.005))),
            "part": Tendon(
                along=chain, offset=Converging(start=(0.0, 0.008), end=(0.006, 0.0)), from_=0.1, to=0.8
            ),
            "short": Tendon(along=("upper",), offset=(0.004, 0.004), to=0.7),
            "hinge": JointTorque(joint="hinge"),
        },
    )


def guided():
    """Helical cables and a helical chamber, through a block and a hinge with guide holes, placements between them."""
    helix = Helix(radius=0.006, turns=0.9, phase=0.4, end_radius=0.003)
    off = Placement(position=(0.004, 0.001, -0.002), rotation=(0.2, 0.1, -0.3))
    chain = ("lower", "block", "hinge", "upper")
    guides = {"block": ((0.005, 0.004, 0.003), (0.02, -0.002, 0.005)), "hinge": ((0.01, 0.002, 0.006),)}
    return Description(
        segments={
            "lower": rod(sections=1, strains="simo_reissner", quadrature=10),
            "block": Fixed(parent="lower", placement=off, tip=TIP),
            "hinge": Revolute(axis=(0.1, 1.0, 0.2), parent="block", placement=off, stiffness=0.2, tip=TIP),
            "upper": rod(parent="hinge", sections=1, length=0.1, placement=off, quadrature=10),
        },
        actuators={
            "helix": Tendon(along=chain, offset=helix),
            "guided": Tendon(along=chain, offset=Converging(start=(0.008, 0.002), end=(-0.003, 0.005)), holes=guides),
            "part": Tendon(along=chain, offset=helix, from_=0.2, to=0.9, holes={"hinge": ((0.01, 0.0, 0.0),)}),
            "wound": Chamber(along=("lower",), offset=Helix(radius=0.005, turns=-0.8), area=2e-5),
            "level": Chamber(along=("upper",), offset=helix, area=2e-5, direction="normal"),
        },
    )


def chambers():
    pair = ((0.006, 0.003), (0.006, -0.003))
    return Description(
        segments={"rod": rod(strains="simo_reissner")},
        actuators={
            "tangent": Chamber(along=("rod",), offset=pair, area=2e-5),
            "normal": Chamber(along=("rod",), offset=(-0.004, 0.005), area=2e-5, direction="normal"),
            "cone": Chamber(
                along=("rod",), offset=Converging(start=(0.008, 0.0), end=(0.002, 0.001)), area=2e-5
            ),
        },
    )


def loaded():
    """Dead and follower wrenches, with moments, at points and along rods."""
    push = dict(force=(0.02, 0.05, -0.03), moment=(0.001, -0.002, 0.003))
    flow = dict(force=(0.1, -0.2, 0.3), moment=(0.01, -0.02, 0.015))
    return Description(
        segments={
            "lower": rod(strains="simo_reissner"),
            "ball": Spherical(parent="lower", at=0.6, stiffness=0.3, tip=TIP, body=BODY),
            "upper": rod(parent="ball", sections=1),
        },
        loads={
            "dead": Wrench(on="upper", **push),
            "follower": Wrench(on="lower", at=0.7, axes="body", **push),
            "tip_follower": Wrench(on="ball", axes="body", **push),
            "flow": Distributed(on="lower", **flow),
            "jets": Distributed(on="upper", axes="body", **flow),
            "even": Distributed(on="upper", force=(0.1, 0.0, 0.2)),
        },
    )


def two_roots():
    return Description(
        segments={
            "left": rod(sections=1),
            "right": rod(
                sections=1, strains=("bend_z", "shear_y"), placement=Placement(position=(0, 0.1, 0))
            ),
            "knob": Revolute(axis=(0, 1.0, 0), parent="right", body=BODY),
        },
        gravity=(1.0, -2.0, 9.0),
    )


def stiffening(eps, section):
    """A strain energy [J/m] that couples twist, bending and stretch."""
    bend = eps[0] ** 2 + eps[1] ** 2 + 2 * eps[2] ** 2
    return (
        0.004 * bend
        + 1e-6 * bend**2
        + 60 * eps[3] ** 2 * (1 + 0.01 * bend)
        + 20 * eps[4] ** 2
        + 30 * eps[5] ** 2
    )


def special_rods():
    taper = Taper(start=Circle(radius=0.012), end=Circle(radius=0.005))
    trio = tuple(
        Hole(offset=(0.007 * np.cos(a), 0.007 * np.sin(a)), radius=0.002) for a in 2 * pi / 3 * np.arange(3)
    )
    elastic = dict(young_modulus=4e5, shear_modulus=1.5e5, density=1080.0)
    numbers = General(
        stiffness=(0.01, 0.02, 0.03, 90.0, 40.0, 50.0), inertia=(1e-5, 2e-5, 3e-5, 0.3, 0.3, 0.3)
    )
    simo = dict(strains="simo_reissner")
    return {
        "taper": cable_rod(cross_section=taper, **simo),
        "table": cable_rod(cross_section=TABLE, sections=2, **simo),
        "centred_holes": cable_rod(
            cross_section=Annulus(inner_radius=0.003, radius=0.012, holes=trio), **simo
        ),
        "off_centre_hole": cable_rod(cross_section=TUBE, **simo),
        "general": cable_rod(cross_section=numbers, **simo),
        "pre_curved": cable_rod(rest={"bend_z": (3.0, -1.0), "twist": 1.5, "stretch": 0.02}),
        "pre_curved_locked": cable_rod(
            strains=("bend_y",), rest={"bend_z": 4.0, "bend_y": 2.0, "shear_z": 0.05}
        ),
        "polynomial": cable_rod(
            material=Polynomial(bend=(3.0, 40.0), stretch=(0.5, -0.2), coupling=-0.7, **elastic), **simo
        ),
        "gent": cable_rod(material=Gent(bend_limit=0.02, stretch_limit=-0.5, **elastic), **simo),
        "energy": cable_rod(material=Energy(W=stiffening, density=1000.0), **simo),
    }


LUMPED = lumped_robots()
DISTRIBUTED = {row: cable_rod(strains=row) for row in ROWS}
ROBOTS = {
    **LUMPED,
    **DISTRIBUTED,
    **special_rods(),
    "branched": branched(),
    "threaded": threaded(),
    "guided": guided(),
    "chambers": chambers(),
    "loaded": loaded(),
    "two_roots": two_roots(),
}
SHAPES = ("straight", "bent")


@dataclass(frozen=True)
class Case:
    """One robot at one shape: `q`, velocities `qd` and inputs `u` are numbers of its own."""

    name: str
    shape: str

    @property
    def description(self):
        return ROBOTS[self.name]

    @cached_property
    def robot(self):
        return robot(self.name)

    @property
    def functions(self):
        return functions(self.name)

    @cached_property
    def plain(self):
        return Plain(self.description)

    @cached_property
    def _numbers(self):
        rng = np.random.default_rng(sum(map(ord, self.name)))
        n = self.plain.n
        return (
            self.plain.scales * rng.uniform(-1, 1, n),
            rng.normal(size=n),
            rng.uniform(0.2, 1.0, self.robot.m),
        )

    @property
    def q(self):
        return self._numbers[0] * (self.shape == "bent")

    @property
    def qd(self):
        return self._numbers[1]

    @property
    def u(self):
        """Newtons on cables and joints, pressures of kilopascals in chambers."""
        return self._numbers[2] * np.array([1e4 if unit == "Pa" else 1.0 for unit in self.robot.input_units])

    def __str__(self):
        return f"{self.name}-{self.shape}"


def gap(a, b):
    """Largest difference of two arrays beside the largest entry of the second."""
    a, b = array(a), array(b)
    b = b.reshape(a.shape) if a.size == b.size else b
    assert a.shape == b.shape
    return np.abs(a - b).max(initial=0) / max(np.abs(b).max(initial=0), 1e-12)


def array(x):
    """Numbers of casadi or numpy as an array; columns as vectors."""
    x = np.array(ca.DM(x)) if isinstance(x, (ca.DM, ca.SX, ca.MX)) else np.asarray(x, dtype=float)
    return x[:, 0] if x.ndim == 2 and x.shape[1] == 1 else x


CASES = [Case(name, shape) for name in ROBOTS for shape in SHAPES]
ROD_CASES = [case for case in CASES if any(isinstance(s, Rod) for s in case.description.segments.values())]


@cache
def robot(name):
    return Robot(ROBOTS[name])


@cache
def functions(name):
    return robot(name).functions()


# The same robots in numpy


def hat(xi):
    """[... 4 x 4] of twists [... 6], angular first."""
    xi = np.asarray(xi)
    out = np.zeros((*xi.shape[:-1], 4, 4), dtype=xi.dtype)
    k, p = xi[..., :3], xi[..., 3:]
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = k[..., 0], k[..., 1], k[..., 2]
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -k[..., 0], -k[..., 1], -k[..., 2]
    out[..., :3, 3] = p
    return out


def vee(X):
    return np.stack([X[..., 2, 1], X[..., 0, 2], X[..., 1, 0], *np.moveaxis(X[..., :3, 3], -1, 0)], axis=-1)


def exponential(X, halvings=6):
    """Matrix exponential of X [... k x k], real or complex, for entries up to about 20."""
    small = X / 2**halvings
    eye = np.eye(X.shape[-1])
    total = eye + 0 * X
    for i in reversed(range(1, 16)):
        total = eye + small @ total / i
    for _ in range(halvings):
        total = total @ total
    return total


def placed(placement):
    g = np.eye(4)
    g[:3, :3] = Rotation.from_rotvec(np.array(placement.rotation, dtype=float)).as_matrix()
    g[:3, 3] = placement.position
    return g


def point(y, z):
    return np.array([0.0, y, z, 1.0])


def gauss(a, b, count=POINTS):
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (a + b) / 2 + (b - a) / 2 * nodes, (b - a) / 2 * weights


def slopes(function, q):
    """d(function)/dq [n x ...] of a function that takes q [... n], by complex steps."""
    q = np.asarray(q, dtype=float)
    return np.imag(function(q + 1j * STEP * np.eye(q.size))) / STEP


def fibres(section):
    """(y, z, dA) of fibres whose sums integrate cubic polynomials over a slice; holes count negative."""
    if isinstance(section, Rectangle):
        y, wy = gauss(-section.width / 2, section.width / 2, 4)
        z, wz = gauss(-section.height / 2, section.height / 2, 4)
        parts = [np.stack([*np.meshgrid(y, z), np.outer(wz, wy)])]
    elif isinstance(section, Ellipse):
        parts = [disc(section.radius_y, section.radius_z)]
    else:
        parts = [disc(section.radius, section.radius)]
    if isinstance(section, Annulus):
        parts.append(disc(section.inner_radius, section.inner_radius, sign=-1))
    parts += [disc(hole.radius, hole.radius, hole.offset, -1) for hole in section.holes]
    return np.concatenate([part.reshape(3, -1) for part in parts], axis=1)


def disc(radius_y, radius_z, centre=(0.0, 0.0), sign=1):
    r, w = gauss(0, 1, 6)
    angle = 2 * pi * np.arange(12) / 12
    y, z = np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle))
    dA = sign * radius_y * radius_z * np.outer(w * r, np.full(12, 2 * pi / 12))
    return np.stack([centre[0] + radius_y * y, centre[1] + radius_z * z, dA])


def slice_at(profile, X):
    """The section of a profile at X, its numbers interpolated by hand."""
    if isinstance(profile, Taper):
        return mixed(profile.start, profile.end, X)
    if isinstance(profile, SectionTable):
        places = [row.at for row in profile.table]
        i = min(np.searchsorted(places, X, side="right") - 1, len(places) - 2)
        share = (X - places[i]) / (places[i + 1] - places[i])
        return mixed(profile.table[i].section, profile.table[i + 1].section, share)
    return profile


def mixed(a, b, X):
    if isinstance(a, Ellipse):
        y, z = ((1 - X) * getattr(a, k) + X * getattr(b, k) for k in ("radius_y", "radius_z"))
        return Ellipse(radius_y=y, radius_z=z)
    return Circle(radius=(1 - X) * a.radius + X * b.radius)


def energy_density(material, section, eps):
    """W [...] in J/m of strains [... 6] away from rest, summed over fibres where the law is linear."""
    if isinstance(material, Energy):
        return material.W(np.moveaxis(eps, -1, 0), section)
    if isinstance(section, General):
        return (np.array(section.stiffness) * eps**2).sum(-1) / 2
    y, z, dA = fibres(section)
    kx, ky, kz, px, py, pz = (eps[..., i, None] for i in range(6))
    E, G = material.young_modulus, material.shear_modulus
    G = E / (2 * (1 + material.poisson_ratio)) if G is None else G
    shear = (dA * ((py - kx * z) ** 2 + (pz + kx * y) ** 2)).sum(-1) * G / 2
    shear = shear + G / 2 * warping(section, (dA * (y**2 + z**2)).sum()) * eps[..., 0] ** 2
    if isinstance(material, Linear):
        return (dA * (px + ky * z - kz * y) ** 2).sum(-1) * E / 2 + shear
    bend = (dA * (ky * z - kz * y) ** 2).sum(-1) * E / 2
    stretch = E * dA.sum() / 2 * eps[..., 3] ** 2
    size = 2 * bend / (E * dA.sum())
    if isinstance(material, Polynomial):
        bend = bend * (1 + material.coupling * eps[..., 3] + series(material.bend, size))
        return bend + stretch * (1 + series(material.stretch, eps[..., 3])) + shear
    return (
        limited(bend, size, material.bend_limit)
        + limited(stretch, eps[..., 3] ** 2, material.stretch_limit)
        + shear
    )


def warping(section, polar):
    """Torsion constant less the polar moment: zero for round shapes with round holes; of full shapes else."""
    if section.torsion_constant is not None:
        return section.torsion_constant - polar
    if isinstance(section, Ellipse):
        a, b = section.radius_y, section.radius_z
        return pi * a**3 * b**3 / (a**2 + b**2) - pi * a * b * (a**2 + b**2) / 4
    if isinstance(section, Rectangle) and not section.holes:
        return rectangle_torsion(section.width, section.height) - polar
    return 0.0


@cache
def rectangle_torsion(a, b):
    """Torsion constant of a full rectangle from Prandtl's stress function as a double sine series (L. Navier)."""
    m = np.arange(1.0, 1600.0, 2)[:, None]
    n = m.T
    return 256 * a**3 * b**3 / pi**6 * (1 / (m**2 * n**2 * (m**2 * b**2 + n**2 * a**2))).sum()


def series(coefficients, x):
    return sum(c * x ** (i + 1) for i, c in enumerate(coefficients))


def limited(energy, size, limit):
    """energy * (-ln(1 - x)/x), x = size/limit, as a long power series."""
    return energy * sum((size / limit) ** i / (i + 1) for i in range(200))


class Plain:
    """A robot in numpy. Functions take coordinates q [... n] and return arrays with the same leading axes."""

    def __init__(self, description):
        self.robot = description
        self.segments = description.segments
        self.columns, self.scales = {}, []
        for name, s in self.segments.items():
            self.columns[name] = [self._next(scales) for scales in self._scales(s)]

    def _scales(self, s):
        """Size of each coordinate in a bent shape, by section."""
        if isinstance(s, Rod):
            sizes = [
                [1.2 / part / s.length if i < 3 else 0.1 for i in active(s)] for part in np.diff(bounds(s))
            ]
            return sizes
        return [[1.0 if unit == "rad" else 0.1 for unit, _ in s.units]]

    def _next(self, scales):
        start = len(self.scales)
        self.scales = [*self.scales, *scales]
        return slice(start, start + len(scales))

    @property
    def n(self):
        return len(self.scales)

    def strain(self, q, name, i):
        """xi [... 6] of a section of rod."""
        s = self.segments[name]
        xi = np.zeros((*q.shape[:-1], 6), dtype=q.dtype) + [0, 0, 0, 1, 0, 0]
        free = active(s)
        xi = xi + np.where(np.isin(np.arange(6), free), 0.0, rest(s, i))
        xi[..., free] += q[..., self.columns[name][i]]
        return xi

    def stations(self, q):
        """{segment: [... 4 x 4]}: each section's base and the end of a rod; base, moving, end of a joint."""
        q, out = np.asarray(q), {}
        for name, s in self.segments.items():
            stand = np.eye(4) if s.parent == "world" else self.frame(q, s.parent, s.at, out)
            frames = [stand @ placed(s.placement) + np.zeros((*q.shape[:-1], 4, 4), dtype=q.dtype)]
            if isinstance(s, Rod):
                for i, part in enumerate(np.diff(bounds(s))):
                    frames.append(frames[-1] @ exponential(hat(self.strain(q, name, i) * part * s.length)))
            else:
                frames.append(frames[-1] @ exponential(hat(q[..., self.columns[name][0]] @ basis(s).T)))
                frames.append(frames[-1] @ placed(s.tip))
            out[name] = frames
        return out

    def frame(self, q, name, X, stations=None):
        """World <- frame at X of a segment [... 4 x 4]."""
        frames = (stations or self.stations(q))[name]
        s = self.segments[name]
        if not isinstance(s, Rod):
            return frames[0] if X == 0 else frames[-1]
        i, share = section_of(s, X)
        return frames[i] @ exponential(hat(self.strain(q, name, i) * share * s.length))

    def jacobian(self, q, name, X):
        """Body Jacobian [6 x n]: columns (g^-1 dg/dq)^vee."""
        g = self.frame(np.asarray(q, dtype=float), name, X)
        return vee(np.linalg.inv(g) @ slopes(lambda q: self.frame(q, name, X), q)).T

    # loads

    def pushes(self, q, gravity=True):
        """(frame [... 4 x 4], force, moment, follower) of gravity and all loads, rods in Gauss points."""
        q, out = np.asarray(q), []
        stations = self.stations(q)
        for name, s in self.segments.items():
            if gravity and isinstance(s, Rod):
                for X, w in self._places(s):
                    mass, centre = line_density(s, X)
                    g = self.frame(q, name, X, stations) @ shifted((0, *centre))
                    out.append((g, w * mass * np.array(self.robot.gravity), np.zeros(3), False))
            elif gravity and s.body is not None:
                g = stations[name][1] @ shifted(s.body.com)
                out.append((g, s.body.mass * np.array(self.robot.gravity), np.zeros(3), False))
        for load in (self.robot.loads or {}).values():
            places = (
                self._places(self.segments[load.on]) if isinstance(load, Distributed) else [(load.at, 1.0)]
            )
            for X, w in places:
                g = self.frame(q, load.on, X, stations)
                out.append((g, w * np.array(load.force), w * np.array(load.moment), load.axes == "body"))
        return out

    def _places(self, s):
        """(X, weight [m]) of Gauss points along a rod."""
        edges = bounds(s)
        for a, b in zip(edges, edges[1:], strict=False):
            for X, w in zip(*gauss(a, b), strict=True):
                yield X, w * s.length

    def external_force(self, q):
        """Virtual work of all pushes [n]: force times the motion of its point, moment times its turning."""
        q = np.asarray(q, dtype=float)
        total = np.zeros(self.n)
        for g, force, moment, follower in self.pushes(q + 1j * STEP * np.eye(self.n)):
            dg, R = np.imag(g) / STEP, np.real(g[0, :3, :3]) if self.n else np.eye(3)
            turn = vee(dg @ np.linalg.inv(np.real(g)))[..., :3]
            if follower:
                force, moment = R @ force, R @ moment
            total += dg[..., :3, 3] @ force + turn @ moment
        return total

    def potential(self, q):
        """-sum of forces times their points [...]: the energy of dead forces."""
        return -sum(g[..., :3, 3] @ force for g, force, _, _ in self.pushes(q))

    def total_push(self, q):
        """Sum of all pushes as one wrench [moment; force] about the world's origin."""
        total = np.zeros(6)
        for g, force, moment, follower in self.pushes(np.asarray(q, dtype=float)):
            R = g[:3, :3] if follower else np.eye(3)
            total += np.concatenate([np.cross(g[:3, 3], R @ force) + R @ moment, R @ force])
        return total

    # elasticity

    def elastic_energy(self, q):
        """[...] in J, by fibres and Gauss points on rods."""
        q = np.asarray(q)
        total = np.zeros(q.shape[:-1], dtype=q.dtype)
        for name, s in self.segments.items():
            if isinstance(s, Rod):
                edges = bounds(s)
                for i in range(len(edges) - 1):
                    eps = self.strain(q, name, i) - [0, 0, 0, 1, 0, 0] - rest(s, i)
                    for X, w in zip(*gauss(edges[i], edges[i + 1]), strict=True):
                        section = slice_at(s.cross_section, X)
                        total = total + w * s.length * energy_density(s.material, section, eps)
            elif s.units:
                away = q[..., self.columns[name][0]] - np.array(s.rest)
                K = np.array(s.stiffness)
                K = K * np.eye(len(s.units)) if K.ndim == 0 else np.diag(K) if K.ndim == 1 else K
                total = total + (away @ K * away).sum(-1) / 2
        return total

    # lines

    def length(self, q, along, offset, span=(0.0, 1.0), normal=False, holes=None, corners=16):
        """Length [...] of a line along the segments: polygons of ever more corners in rods, straight from hole to hole.

        `normal`: instead the sum of its steps along the section normals, that of a chamber pushing along e1.
        """
        q = np.asarray(q)
        stations = self.stations(q)
        sizes = [self._extent(name) for name in along]
        done, total, here = np.cumsum([0, *sizes]) / sum(sizes), 0, None
        for name, first, last in zip(along, done, done[1:], strict=False):
            s = self.segments[name]
            if isinstance(s, Rod):
                edges = first + (last - first) * np.array(bounds(s))
                for i in range(len(edges) - 1):
                    a, b = edges[i : i + 2].clip(*span)
                    if b > a:
                        part, begin, here_after = self._section_length(
                            q, name, i, stations, offset, (first, last), (a, b), normal, corners
                        )
                        total = total + part + (0 if here is None or normal else norm(begin - here))
                        here = here_after
            elif span[0] < last and span[1] > first:
                for point in self._holes(stations[name], offset, first, last, (holes or {}).get(name)):
                    total, here = total + (0 if here is None else norm(point - here)), point
        return total

    def _holes(self, frames, offset, first, last, given):
        """Points [... 3] of the holes of a joint, whose base, moving and end frame are given."""
        places = [(frames[1], p) for p in given or ()]
        places = places or [(frames[0], (0, *offset(first))), (frames[2], (0, *offset(last)))]
        return [(g @ np.array([*p, 1.0]))[..., :3] for g, p in places]

    def _extent(self, name):
        s = self.segments[name]
        return s.length if isinstance(s, Rod) else np.linalg.norm(s.tip.position)

    def _section_length(self, q, name, i, stations, offset, whole, part, normal, corners):
        s, xi = self.segments[name], self.strain(q, name, i)
        X = part[0] + (part[1] - part[0]) * np.arange(2 * corners + 1) / (2 * corners)
        own = (X - whole[0]) / (whole[1] - whole[0]) - bounds(s)[i]
        frames = stations[name][i] @ np.stack([exponential(hat(xi * x * s.length)) for x in own])
        places = np.stack([g @ point(*offset(x)) for g, x in zip(frames, X, strict=True)])[..., :3]
        sums = []
        for stride in [2 * corners // 2**k for k in range(int(np.log2(corners)) + 1)]:
            steps = np.diff(places[::stride], axis=0)
            if normal:
                sums.append((frames[stride // 2 :: stride, ..., :3, 0] * steps).sum((0, -1)))
            else:
                sums.append(norm(steps).sum(0))
        return romberg(sums), places[0], places[-1]

    def lengths(self, q):
        """Gain times length [...] of each tendon and chamber, projected length where it pushes along e1."""
        out = []
        for a in (self.robot.actuators or {}).values():
            if isinstance(a, Tendon):
                span, corners = (a.from_, a.to), corners_of(a.offset)
                out.append(-self.length(q, a.along, routing(a.offset), span, holes=a.holes, corners=corners))
            elif isinstance(a, Chamber):
                offsets = (
                    a.offset
                    if isinstance(a.offset, tuple) and isinstance(a.offset[0], tuple)
                    else (a.offset,)
                )
                normal = a.direction == "normal"
                ways = (self.length(q, a.along, routing(o), normal=normal, corners=corners_of(o)) for o in offsets)
                out.append(a.area * sum(ways))
        return out

    def actuation(self, q):
        """B [n x m]: slopes of gain times length; motors push on the moving frame, at the joint's point."""
        lines = iter(slopes(lambda q: np.stack(self.lengths(q), axis=-1), q).T if self.lengths(q) else ())
        columns = []
        for a in (self.robot.actuators or {}).values():
            columns += self._motor(q, a.joint) if isinstance(a, JointTorque) else [next(lines)]
        return np.array(columns).reshape(-1, self.n).T

    def _motor(self, q, name):
        s = self.segments[name]
        at = shifted(getattr(s, "point", (0, 0, 0)))
        g = self.stations(np.asarray(q, dtype=float))[name][1] @ at
        dg = slopes(lambda q: self.stations(q)[name][1] @ at, q)
        base = self.stations(np.asarray(q, dtype=float))[name][0]
        dbase = slopes(lambda q: self.stations(q)[name][0], q)
        carried = dbase @ np.linalg.inv(base) @ g  # motion of the same frame if the joint were locked
        motion = vee(np.linalg.inv(g) @ (dg - carried))
        turn_or_slide = np.linalg.inv(shifted_Ad(at)) @ basis(s)
        return list((motion @ turn_or_slide / (turn_or_slide[:3] ** 2 + turn_or_slide[3:] ** 2).sum(0)).T)


def active(s):
    return ROWS[s.strains] if isinstance(s.strains, str) else sorted(NAMES.index(name) for name in s.strains)


def bounds(s):
    parts = s.sections if isinstance(s.sections, tuple) else [1 / s.sections] * s.sections
    return [0.0, *np.cumsum(parts)[:-1].tolist(), 1.0]


def section_of(s, X):
    """(section, way into it as a fraction of the rod) of X on a rod."""
    edges = bounds(s)
    i = max(int(np.searchsorted(edges, X)) - 1, 0)
    return i, X - edges[i]


def rest(s, i):
    values = [(s.rest or {}).get(name, 0.0) for name in NAMES]
    return np.array([value[i] if isinstance(value, tuple) else value for value in values])


def line_density(s, X):
    """Mass per metre and centroid (y, z) of a rod at X."""
    section = slice_at(s.cross_section, X)
    if isinstance(section, General):
        return section.inertia[3], (0.0, 0.0)
    y, z, dA = fibres(section)
    return s.material.density * dA.sum(), (y @ dA / dA.sum(), z @ dA / dA.sum())


def basis(s):
    """Unit twists [6 x n] of a joint: velocity -a x p of the origin for a turn about a through p."""
    if not s.units:
        return np.zeros((6, 0))
    a = np.array(getattr(s, "axis", (1.0, 0, 0)), dtype=float)
    a, p, none = a / np.linalg.norm(a), np.array(getattr(s, "point", (0.0, 0, 0))), np.zeros(3)
    turn = np.concatenate([a, -np.cross(a, p)])
    slide = np.concatenate([none, a])
    if isinstance(s, Revolute):
        return turn[:, None]
    if isinstance(s, Prismatic):
        return slide[:, None]
    if isinstance(s, Helical):
        return (turn + s.pitch * slide)[:, None]
    if isinstance(s, Cylindrical):
        return np.stack([turn, slide], axis=1)
    if isinstance(s, Planar):
        across = smallest_turn(a)[:, :2]
        return np.column_stack([turn, np.vstack([np.zeros((3, 2)), across])])
    if isinstance(s, Spherical):
        return np.stack([np.concatenate([e, -np.cross(e, p)]) for e in np.eye(3)], axis=1)
    return np.eye(6)


def smallest_turn(a):
    """R [3 x 3] that takes e3 to a about the axis at right angles to both."""
    across = np.cross([0, 0, 1.0], a)
    angle = np.arctan2(np.linalg.norm(across), a[2])
    return Rotation.from_rotvec(angle * across / max(np.linalg.norm(across), 1e-300)).as_matrix()


def shifted(position):
    g = np.eye(4)
    g[:3, 3] = position
    return g


def shifted_Ad(g):
    """Ad [6 x 6] of a pure shift."""
    out = np.eye(6)
    out[3:, :3] = hat(np.concatenate([g[:3, 3], np.zeros(3)]))[:3, :3]
    return out


def routing(offset):
    """(y, z) of a line as a function of the way along it."""
    if isinstance(offset, Converging):
        return lambda X: tuple((1 - X) * a + X * b for a, b in zip(offset.start, offset.end, strict=True))
    if isinstance(offset, Helix):
        end = offset.radius if offset.end_radius is None else offset.end_radius
        turn = lambda X: np.exp(1j * (offset.phase + 2 * pi * offset.turns * X)) * ((1 - X) * offset.radius + X * end)  # noqa: E731
        return lambda X: (turn(X).real, turn(X).imag)
    return lambda X: offset


def corners_of(offset):
    """Corners of the finest polygon along a line: a helix winds within a section."""
    return 64 if isinstance(offset, Helix) else 16


def norm(x):
    """Length over the last axis, without a complex conjugate."""
    return np.sqrt((x**2).sum(-1))


def romberg(sums):
    """Limit of sums over steps h, h/2, h/4, ... whose error is a series in h^2."""
    for k in range(1, len(sums)):
        sums = [fine + (fine - rough) / (4**k - 1) for rough, fine in zip(sums, sums[1:], strict=False)]
    return sums[0]
