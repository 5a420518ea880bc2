"""Soft rods: strains, sections of constant strain, cross-section profile, material, rest shape."""

from math import pi
from typing import Annotated, Any, Literal

import casadi as ca

from socontrol.model.bases import STRAIN_SETS, STRAINS, XI_BAR, active_strains, selection
from socontrol.model.bodies import Placement
from socontrol.model.fluids import RodFluid
from socontrol.model.materials import NEED_SHAPE, Material, inertia_density
from socontrol.model.quadrature import gauss_legendre
from socontrol.model.sections import General, Profile, breadth, is_uniform, section_at
from socontrol.model.steps import Slice
from socontrol.quantities import (
    Bad,
    Count,
    Either,
    Fraction,
    Length,
    Number,
    PositiveNumber,
    record,
)

Strains = Annotated[Any, Either(Literal[tuple(STRAIN_SETS)], tuple[Literal[STRAINS], ...])]
Sections = Annotated[Any, Either(Count, tuple[PositiveNumber, ...])]
RestValues = Annotated[Any, Either(Number, tuple[Number, ...])]

MOST_SECTIONS = 500  # far beyond what statics gains from, long before memory runs out


@record(kw_only=True)
class Rod:
    """A rod of `sections` pieces of constant strain, base at X = 0.

    strains: a row of the distributed joint table or a list of strain names. sections: their number, or a list of
    length fractions. quadrature: Gauss points a section; against 32 of them the tip of a tapered arm with converging
    cables moves by 8e-13 of its length with 5 points and by rounding with 8, the default. rest: rest value by strain,
    a number or a list by section (an inactive strain is held at its rest value).
    """

    length: Length
    cross_section: Profile
    material: Material
    parent: str = "world"
    at: Fraction = 1.0
    placement: Placement = Placement()
    strains: Strains = "kirchhoff_love"
    sections: Sections = 1
    quadrature: Count = 8
    rest: dict[str, RestValues] | None = None
    fluid: RodFluid = RodFluid()

    def __post_init__(self):
        try:
            active_strains(self.strains)
        except ValueError as error:
            raise Bad("strains", str(error)) from None
        count = len(self.sections) if isinstance(self.sections, tuple) else self.sections
        if count > MOST_SECTIONS:
            raise Bad("sections", f"{count} sections; at most {MOST_SECTIONS}")
        if isinstance(self.sections, tuple) and abs(sum(self.sections) - 1) > 1e-9:
            raise Bad("sections", f"the fractions sum to {sum(self.sections):g}, not 1; or give the number of sections")
        if self.quadrature > 64:
            raise Bad("quadrature", f"{self.quadrature} Gauss points a section; at most 64")
        if isinstance(self.material, NEED_SHAPE) and isinstance(section_at(self.cross_section, 0.0), General):
            kind = type(self.material).__name__.lower()
            sentence = f"'{kind}' needs a cross-section with a shape, not 'general'; use a linear material"
            raise Bad("material", sentence)
        count = len(self.boundaries()) - 1
        for name, value in (self.rest or {}).items():
            if name not in STRAINS:
                raise Bad(f"rest.{name}", f"unknown strain; allowed: {', '.join(STRAINS)}")
            if isinstance(value, tuple) and len(value) != count:
                raise Bad(f"rest.{name}", f"{len(value)} values given, {count} wanted, one a section")

    def boundaries(self):
        """X of the section boundaries, 0 ... 1."""
        if isinstance(self.sections, tuple):
            ends = [sum(self.sections[: i + 1]) for i in range(len(self.sections))]
            return [0.0, *ends[:-1], 1.0]
        return [i / self.sections for i in range(self.sections + 1)]

    def active(self):
        return active_strains(self.strains)

    def Phi(self):
        return selection(self.active())

    def rest_strain(self, section):
        """xi_star - xi_bar [6] of one section."""
        values = []
        for name in STRAINS:
            value = (self.rest or {}).get(name, 0.0)
            values.append(value[section] if isinstance(value, tuple) else value)
        return ca.vertcat(*values)

    def xi_bar(self, section):
        """Strain [6] at q = 0: straight and unstretched, inactive strains at rest."""
        rest, active = self.rest_strain(section), self.active()
        return ca.vertcat(*(XI_BAR[i] + (0 if name in active else rest[i]) for i, name in enumerate(STRAINS)))

    def xi_star(self, section):
        """Strain [6] at which the rod stores no energy."""
        return ca.vertcat(*XI_BAR) + self.rest_strain(section)

    def slices(self, section, factor=1, start=0.0, stop=1.0):
        """Gauss points on the part [start, stop] (fractions) of a section; `factor` times as many as usual."""
        X0, X1 = self.boundaries()[section : section + 2]
        nodes, weights = gauss_legendre(self.quadrature * factor)
        return tuple(
            Slice(
                x=start + (stop - start) * node,
                weight=weight * (stop - start) * (X1 - X0) * self.length,
                X=X0 + (X1 - X0) * (start + (stop - start) * node),
                section=section_at(self.cross_section, X0 + (X1 - X0) * (start + (stop - start) * node)),
            )
            for node, weight in zip(nodes, weights, strict=True)
        )

    def inertia_density(self, piece_slice):
        return inertia_density(self.material, piece_slice.section)

    def displaced(self, piece_slice):
        """Area [m^2] of water that a slice displaces: that of its material, so that lumens are flooded."""
        section = piece_slice.section
        return pi * section.radius**2 if isinstance(section, General) else section.moments().A

    def fluid_density(self, piece_slice, water):
        """Drag and added-mass coefficients per length in water of this density; see `RodFluid.density`."""
        return self.fluid.density(breadth(piece_slice.section), self.displaced(piece_slice), water)

    def is_uniform(self):
        return is_uniform(self.cross_section)
