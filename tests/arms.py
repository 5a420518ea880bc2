"""Small actuated robots for inverse statics, in any units, and looks at answers in numpy."""

import numpy as np
from robots import Plain, slopes

from socontrol.mechanics.actuators import Chamber, JointTorque, Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Body, Placement
from socontrol.model.joints import Fixed, Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Annulus, Circle
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.looks import check

ANGLES = {"up": 90.0, "left": 210.0, "right": -30.0}  # mirroring y exchanges the last two
PRESSURE = 140e3


def chamber(along, angle, length, pressure, limits):
    t = np.radians(angle)
    return Chamber(
        along=(along,),
        offset=(8.5e-3 * length * float(np.cos(t)), 8.5e-3 * length * float(np.sin(t))),
        area=4e-5 * length**2,
        limits=tuple(pressure * p for p in limits),
    )


def modules(names=("low",), *, length=1.0, force=1.0, limits=(0.0, PRESSURE), sections=2, **changes):
    """Pneumatic modules in a row and a cap; `length`, `force`: a metre and a newton in other units."""
    pressure = force / length**2
    material = Linear(
        young_modulus=0.2e6 * pressure, poisson_ratio=0.5, density=1820.0 * force / length**3, viscosity=300.0
    )
    segments, parent = {}, "world"
    for name in names:
        segments[name] = Rod(
            parent=parent,
            length=0.05 * length,
            cross_section=Annulus(inner_radius=4.5e-3 * length, radius=12.5e-3 * length),
            material=material,
            sections=sections,
            quadrature=5,
            placement=changes.pop("placement", Placement()) if parent == "world" else Placement(),
        )
        parent = name
    cap = Body(mass=0.0135 * force, com=(7.25e-3 * length, 0.0, 0.0))
    segments["cap"] = Fixed(parent=parent, body=cap, tip=Placement((14.5e-3 * length, 0.0, 0.0)))
    actuators = {
        f"{name}_{side}": chamber(name, angle + 60 * k, length, pressure, limits)
        for k, name in enumerate(names)
        for side, angle in ANGLES.items()
    }
    return Description(segments=segments, **{"actuators": actuators, "gravity": (0.0, 0.0, -9.81), **changes})


def module(**changes):
    """One module: three inputs for three coordinates of the tip."""
    return Robot(modules(**changes))


def two_modules(**changes):
    """Six inputs, enough for a whole pose."""
    return Robot(modules(("low", "high"), **{"sections": 1, **changes}))


def hand(*, limits=(-1.2, 1.2), torque=(-3.0, 3.0)):
    """Two links on motors and a soft finger with two cables, all in the plane of x and z."""
    down, body = (0.0, 1.0, 0.0), Body(mass=0.3, com=(0.1, 0.0, 0.0))
    finger = Rod(
        parent="fore",
        length=0.15,
        cross_section=Circle(radius=0.008),
        material=Linear(young_modulus=0.6e6, poisson_ratio=0.45, density=1100.0),
        strains=("bend_y", "stretch"),
        sections=2,
        quadrature=5,
    )
    tip = Placement((0.2, 0.0, 0.0))
    return Robot(
        Description(
            segments={
                "upper": Revolute(axis=down, stiffness=2.0, limits=limits, body=body, tip=tip),
                "fore": Revolute(parent="upper", axis=down, stiffness=2.0, limits=limits, body=body, tip=tip),
                "finger": finger,
            },
            actuators={
                "shoulder": JointTorque(joint="upper", limits=torque),
                "elbow": JointTorque(joint="fore", limits=torque),
                "top": Tendon(along=("finger",), offset=(0.0, 0.006), limits=(0.0, 8.0)),
                "bottom": Tendon(along=("finger",), offset=(0.0, -0.006), limits=(0.0, 8.0)),
            },
        )
    )


PULL = {"pull": Wrench(on="cap", force=(0.02, 0.05, -0.1))}


def unbalanced(robot, q, u):
    """Recomputed unbalanced force over the largest, in scaled rows."""
    r, *parts = (part / scales(robot).force for part in check.residual(robot, q, u))
    return np.abs(r).max() / max(np.abs(part).max() for part in parts)


def potential(robot, u):
    """Total energy [J] as a function of q [... n], in numpy: rods, weights, dead loads and working inputs."""
    plain = Plain(robot.description)

    def energy(q):
        work = sum(x * y for x, y in zip(u, plain.lengths(q), strict=True))
        return plain.elastic_energy(q) + plain.potential(q) - work

    return energy


def slope(robot, q, u):
    """Gradient of the total energy [n], each over its scale, beside the largest elastic part."""
    force = scales(robot).force
    elastic = np.abs(slopes(Plain(robot.description).elastic_energy, q) / force).max()
    return np.abs(slopes(potential(robot, u), q) / force).max() / elastic


def frame(robot, q, segment, X=1.0):
    """World <- frame [4 x 4] by matrix exponentials."""
    return Plain(robot.description).frame(np.asarray(q, dtype=float), segment, X)
