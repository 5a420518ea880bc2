"""The rod that speeds are measured on, and the prototype's figures they are held against.

L = 1 m, r = 20 mm, E = 1 MPa, G = E/3, 1000 kg/m^3, gravity, clamped, N sections of six strains, 5 Gauss points each.
The prototype (one core of a shared x86-64 with AVX-512, casadi 3.8.2) spent this many microseconds in the VM on the
static residual with its exact Jacobian.
"""

from socontrol.mechanics.robot import Description, Robot
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle

PROTOTYPE_US = {1: 38, 2: 98, 4: 235, 8: 621}


def robot(sections, strains="simo_reissner"):
    material = Linear(young_modulus=1e6, shear_modulus=1e6 / 3, density=1000.0, viscosity=1e4)
    rod = Rod(length=1.0, strains=strains, sections=sections, quadrature=5,
              cross_section=Circle(radius=0.02), material=material)  # fmt: skip
    return Robot(Description(name="reference rod", segments={"rod": rod}))
