"""Materials: from the strain of a slice to its internal wrench, F = dW/dxi, and its inertia.

Linear: W = eps^T Sigma eps / 2 with eps = xi - xi_star and Sigma = diag(G Jt, E Jy, E Jz, E A, G A, G A) for a
centred section; off-centre sections couple stretch with bending (E int (stretch + z bend_y - y bend_z)^2 dA / 2).
Any other strain energy W(eps) per length is accepted; the force is its derivative, made here by CasADi.
Units: W [J/m], F = [moment N m; force N], body frame, angular first. Source: F. Renda et al., T-RO 2018;
the limited-extensibility law is that of A. Gent, Rubber Chem. Technol. 69 (1996), in bending and stretch.
"""

from collections.abc import Callable
from typing import Annotated, Any

import casadi as ca

from socontrol.model.sections import General
from socontrol.quantities import (
    Bad,
    Density,
    Modulus,
    Number,
    OneOf,
    PoissonRatio,
    Viscosity,
    is_symbolic,
    record,
)


def _shear_modulus(material):
    if material.shear_modulus is not None:
        return material.shear_modulus
    return material.young_modulus / (2 * (1 + material.poisson_ratio))


def _one_shear_law(material):
    if (material.shear_modulus is None) == (material.poisson_ratio is None):
        raise Bad("poisson_ratio", "give exactly one of poisson_ratio and shear_modulus")


def linear_stiffness(material, section):
    """Sigma [6 x 6] of the linear law with the material's E and G."""
    if isinstance(section, General):
        return ca.diag(ca.vertcat(*section.stiffness))
    m, E, G = section.moments(), material.young_modulus, _shear_modulus(material)
    rows = [
        [G * m.Jt, 0, 0, 0, G * -m.Sy, G * m.Sz],
        [0, E * m.Jy, E * -m.Jyz, E * m.Sy, 0, 0],
        [0, E * -m.Jyz, E * m.Jz, E * -m.Sz, 0, 0],
        [0, E * m.Sy, E * -m.Sz, E * m.A, 0, 0],
        [G * -m.Sy, 0, 0, 0, G * m.A, 0],
        [G * m.Sz, 0, 0, 0, 0, G * m.A],
    ]
    return ca.sparsify(ca.vertcat(*(ca.horzcat(*row) for row in rows)))


def inertia_density(material, section):
    """Spatial inertia per metre [6 x 6] of a slice: int rho [-r~ r~, r~; -r~, I] dA with r = (0, y, z)."""
    if isinstance(section, General):
        return ca.diag(ca.vertcat(*section.inertia))
    m, rho = section.moments(), material.density
    first = ca.skew(ca.vertcat(0, m.Sz, m.Sy))
    second = ca.vertcat(ca.horzcat(m.Jy + m.Jz, 0, 0), ca.horzcat(0, m.Jy, -m.Jyz), ca.horzcat(0, -m.Jyz, m.Jz))
    return ca.sparsify(rho * ca.blockcat([[second, first], [-first, m.A * ca.DM.eye(3)]]))


@record(kw_only=True)
class Linear:
    """Linear elasticity: moduli, density, and the Kelvin-Voigt viscosity."""

    young_modulus: Modulus
    density: Density
    poisson_ratio: PoissonRatio | None = None
    shear_modulus: Modulus | None = None
    viscosity: Viscosity = 0.0

    def __post_init__(self):
        _one_shear_law(self)

    def energy(self, eps, section):
        return ca.bilin(linear_stiffness(self, section), eps, eps) / 2

    def force(self, eps, section):
        return linear_stiffness(self, section) @ eps

    def stiffness(self, eps, section):
        return linear_stiffness(self, section)

    def damping(self, section):
        return viscous(self, section)


def viscous(material, section):
    """Kelvin-Voigt damping a metre [6 x 6]: viscosity diag(Jx, 3 Jy, 3 Jz, 3 A, A, A), Jx = Jy + Jz."""
    if isinstance(section, General):
        return ca.DM(6, 6)
    m = section.moments()
    return material.viscosity * ca.diag(ca.vertcat(m.Jy + m.Jz, 3 * m.Jy, 3 * m.Jz, 3 * m.A, m.A, m.A))


class _Hyperelastic:
    """Force dW/deps and tangent d2W/deps2 of a strain energy; free symbols inside W stay free."""

    def force(self, eps, section):
        return self._derivatives(eps, section)[0]

    def stiffness(self, eps, section):
        return self._derivatives(eps, section)[1]

    def damping(self, section):
        return viscous(self, section)

    def _derivatives(self, eps, section):
        e = ca.SX.sym("eps", 6)
        hessian, gradient = ca.hessian(self.energy(e, section), e)
        others = [s for s in ca.symvar(ca.veccat(gradient, hessian)) if not ca.depends_on(s, e)]
        return ca.Function("law", [e, *others], [gradient, hessian])(eps, *others)


class _Measures:
    """Energies and dimensionless sizes of bending and stretch that the named nonlinear laws are written in."""

    def __init__(self, material, eps, section):
        if isinstance(section, General):
            raise ValueError("a nonlinear material needs a section with a shape, not 'general'")
        Sigma = linear_stiffness(material, section)
        m = section.moments()
        bend = ca.vertcat(0, eps[1:3], 0, 0, 0)
        self.bend_energy = ca.bilin(Sigma, bend, bend) / 2
        self.stretch_energy = Sigma[3, 3] * eps[3] ** 2 / 2
        self.linear_energy = ca.bilin(Sigma, eps, eps) / 2 - self.bend_energy - self.stretch_energy
        self.bend = (m.Jy * eps[1] ** 2 + m.Jz * eps[2] ** 2) / m.A  # (curvature x radius of gyration)^2
        self.stretch = eps[3]


@record(kw_only=True)
class Polynomial(_Hyperelastic):
    """Bending and stretch energies of the linear law times a polynomial that stiffens or softens them.

    W = W_rest + W_bend (1 + b1 w + b2 w^2 + ...) + W_stretch (1 + a1 e + a2 e^2 + ...), w = (curvature x radius of
    gyration)^2, e = stretch; `bend` = [b1, b2, ...], `stretch` = [a1, ...], `coupling` c adds c e W_bend:
    bending softens (c < 0) or stiffens where the rod is stretched.
    """

    young_modulus: Modulus
    density: Density
    poisson_ratio: PoissonRatio | None = None
    shear_modulus: Modulus | None = None
    viscosity: Viscosity = 0.0
    bend: tuple[Number, ...] = ()
    stretch: tuple[Number, ...] = ()
    coupling: Number = 0.0

    def __post_init__(self):
        _one_shear_law(self)

    def energy(self, eps, section):
        s = _Measures(self, eps, section)
        bend = 1 + self.coupling * s.stretch + sum(b * s.bend ** (i + 1) for i, b in enumerate(self.bend))
        stretch = 1 + sum(a * s.stretch ** (i + 1) for i, a in enumerate(self.stretch))
        return s.linear_energy + s.bend_energy * bend + s.stretch_energy * stretch


@record(kw_only=True)
class Gent(_Hyperelastic):
    """Gent-like energy in bending and in stretch: W = -W_lin m/w ln(1 - w/m), with w the squared strain measure.

    `bend_limit` m > 0: the moment grows without bound as w -> m; m < 0: it softens. w = (curvature x radius of
    gyration)^2 for bending, stretch^2 for stretch. No limit: linear. The moment is E J k / (1 - w/m).
    """

    young_modulus: Modulus
    density: Density
    poisson_ratio: PoissonRatio | None = None
    shear_modulus: Modulus | None = None
    viscosity: Viscosity = 0.0
    bend_limit: Number | None = None
    stretch_limit: Number | None = None

    def __post_init__(self):
        _one_shear_law(self)
        for key in ("bend_limit", "stretch_limit"):
            limit = getattr(self, key)
            if not is_symbolic(limit) and limit == 0:
                raise Bad(key, "0 is no limit; leave the key out for a linear law")

    def energy(self, eps, section):
        s = _Measures(self, eps, section)
        bend = s.bend_energy * _gent_factor(s.bend, self.bend_limit)
        stretch = s.stretch_energy * _gent_factor(s.stretch**2, self.stretch_limit)
        return s.linear_energy + bend + stretch


def _gent_factor(w, limit):
    """-ln(1 - x)/x with x = w/limit, by its series near 0 where the quotient is 0/0."""
    if limit is None:
        return 1
    x = w / limit
    near = ca.fabs(x) < 0.05  # 12 terms there leave 0.05^12 / 13 = 2e-17
    safe = ca.if_else(near, 0.5, x)
    series = sum(x**i / (i + 1) for i in range(12))
    return ca.if_else(near, series, -ca.log(1 - safe) / safe)


@record(kw_only=True)
class Energy(_Hyperelastic):
    """Any strain energy from Python: `W(eps, section)` returns J/m as a CasADi expression of the six strains."""

    W: Callable
    density: Density
    viscosity: Viscosity = 0.0

    def energy(self, eps, section):
        return self.W(eps, section)


MATERIALS = {"linear": Linear, "polynomial": Polynomial, "gent": Gent}
NEED_SHAPE = (Polynomial, Gent)  # written in the section's radii of gyration, which `general` does not have
Material = Annotated[Any, OneOf(MATERIALS, what="material", also=(Energy,))]
