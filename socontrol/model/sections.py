"""Cross-sections: what a slice of a rod contributes to stiffness and inertia.

Every kind answers `moments()` = area A, first moments Sy = int z dA and Sz = int y dA, second moments
Jy = int z^2 dA, Jz = int y^2 dA, Jyz = int y z dA, and the torsion constant Jt. Torsional *stiffness* uses Jt,
torsional *inertia* Jy + Jz: the two agree on circles only. y and z are the body axes of the slice.
Sources: torsion constants of ellipse and rectangle, S. Timoshenko, J. Goodier, "Theory of Elasticity", 1970,
secs. 106 and 109. Chamber holes lower Jt by their polar moment about the axis (exact for a coaxial hole, an
estimate elsewhere); the key `torsion_constant` overrides it.
"""

import copy
from dataclasses import fields, is_dataclass, replace
from math import pi
from typing import Annotated, Any, NamedTuple

import casadi as ca

from socontrol.quantities import (
    Bad,
    Either,
    Fraction,
    Length,
    Metre,
    Number,
    OneOf,
    SecondMoment,
    is_symbolic,
    record,
)


class Moments(NamedTuple):
    """Integrals over a slice: A [m^2], Sy Sz [m^3], Jy Jz Jyz Jt [m^4]."""

    A: Any
    Sy: Any
    Sz: Any
    Jy: Any
    Jz: Any
    Jyz: Any
    Jt: Any


@record(kw_only=True)
class Hole:
    """A round chamber or channel along the rod, cut out of the section; `offset` is its centre (y, z)."""

    offset: tuple[Metre, Metre]
    radius: Length


def _less_holes(whole, holes, torsion_constant):
    """Moments of a centred shape minus its holes (parallel-axis theorem)."""
    A, Sy, Sz, Jy, Jz, Jyz, Jt = whole
    cut_y, cut_z, cut_yz = [], [], []
    for hole in holes:
        y, z = hole.offset
        a, j = pi * hole.radius**2, pi * hole.radius**4 / 4
        A, Jy, Jz = A - a, Jy - j - a * z**2, Jz - j - a * y**2
        Jt = Jt - 2 * j - a * (y**2 + z**2)
        cut_y, cut_z, cut_yz = [*cut_y, a * z], [*cut_z, a * y], [*cut_yz, a * y * z]
    Sy, Sz, Jyz = Sy - _sum(cut_y), Sz - _sum(cut_z), Jyz - _sum(cut_yz)
    return Moments(A, Sy, Sz, Jy, Jz, Jyz, Jt if torsion_constant is None else torsion_constant)


def _sum(terms):
    """Sum of terms; 0 for what symmetric holes leave by rounding, so that a centred section is known to be centred."""
    total = sum(terms)
    numbers = not any(map(is_symbolic, terms))
    return 0 if numbers and abs(total) <= 1e-12 * sum(map(abs, terms)) else total


def _refuse_holes_outside(holes, inside, what):
    for index, hole in enumerate(holes):
        if not inside(*hole.offset, hole.radius):
            raise Bad(f"holes.{index}", f"the hole leaves {what}; move or shrink it")
        for other in holes[:index]:
            gap = (hole.offset[0] - other.offset[0]) ** 2 + (hole.offset[1] - other.offset[1]) ** 2
            if gap < (hole.radius + other.radius) ** 2 * (1 - 1e-9):
                raise Bad(f"holes.{index}", "the hole overlaps another hole; move or shrink one")


@record(kw_only=True)
class Circle:
    """A full disc."""

    radius: Length
    holes: tuple[Hole, ...] = ()
    torsion_constant: SecondMoment | None = None

    def __post_init__(self):
        _refuse_holes_outside(self.holes, lambda y, z, r: (y**2 + z**2) ** 0.5 + r <= self.radius, "the circle")

    def moments(self):
        J = pi * self.radius**4 / 4
        return _less_holes((pi * self.radius**2, 0, 0, J, J, 0, 2 * J), self.holes, self.torsion_constant)

    def outline(self):
        return [("circle", self.radius)]


@record(kw_only=True)
class Annulus:
    """A tube: a disc with a coaxial lumen."""

    inner_radius: Length
    radius: Length
    holes: tuple[Hole, ...] = ()
    torsion_constant: SecondMoment | None = None

    def __post_init__(self):
        if self.inner_radius >= self.radius:
            raise Bad("inner_radius", f"{self.inner_radius:g} m is not below radius {self.radius:g} m; swap them?")
        _refuse_holes_outside(
            self.holes,
            lambda y, z, r: self.inner_radius <= (y**2 + z**2) ** 0.5 - r and (y**2 + z**2) ** 0.5 + r <= self.radius,
            "the wall",
        )

    def moments(self):
        J = pi * (self.radius**4 - self.inner_radius**4) / 4
        A = pi * (self.radius**2 - self.inner_radius**2)
        return _less_holes((A, 0, 0, J, J, 0, 2 * J), self.holes, self.torsion_constant)

    def outline(self):
        return [("circle", self.radius), ("circle", self.inner_radius)]


def rectangle_torsion(width, height, terms=40):
    """Jt [m^4] of a full rectangle; the series falls as (2 i + 1)^-5, so that 40 terms leave less than 1e-9."""
    a, b = ca.fmax(width, height), ca.fmin(width, height)
    series = sum(ca.tanh((2 * i + 1) * pi * a / (2 * b)) / (2 * i + 1) ** 5 for i in range(terms))
    return a * b**3 * (1 / 3 - 64 / pi**5 * b / a * series)


@record(kw_only=True)
class Rectangle:
    """A full rectangle, `width` along y and `height` along z."""

    width: Length
    height: Length
    holes: tuple[Hole, ...] = ()
    torsion_constant: SecondMoment | None = None

    def __post_init__(self):
        _refuse_holes_outside(
            self.holes,
            lambda y, z, r: abs(y) + r <= self.width / 2 and abs(z) + r <= self.height / 2,
            "the rectangle",
        )

    def moments(self):
        A, Jy, Jz = self.width * self.height, self.width * self.height**3 / 12, self.height * self.width**3 / 12
        Jt = rectangle_torsion(self.width, self.height)
        return _less_holes((A, 0, 0, Jy, Jz, 0, Jt), self.holes, self.torsion_constant)

    def outline(self):
        return [("rectangle", self.width, self.height)]


@record(kw_only=True)
class Ellipse:
    """A full ellipse with half axes `radius_y` and `radius_z`."""

    radius_y: Length
    radius_z: Length
    holes: tuple[Hole, ...] = ()
    torsion_constant: SecondMoment | None = None

    def __post_init__(self):
        _refuse_holes_outside(
            self.holes,
            lambda y, z, r: (y / max(self.radius_y - r, 1e-30)) ** 2 + (z / max(self.radius_z - r, 1e-30)) ** 2 <= 1,
            "the ellipse",
        )

    def moments(self):
        a, b = self.radius_y, self.radius_z
        Jt = pi * a**3 * b**3 / (a**2 + b**2)
        return _less_holes(
            (pi * a * b, 0, 0, pi * a * b**3 / 4, pi * b * a**3 / 4, 0, Jt), self.holes, self.torsion_constant
        )

    def outline(self):
        return [("ellipse", self.radius_y, self.radius_z)]


@record(kw_only=True)
class General:
    """Six stiffness and six inertia numbers, in the order of the strains; the material's moduli are not used.

    `stiffness`: N m^2 (twist, bend_y, bend_z), then N (stretch, shear_y, shear_z). `inertia` a metre:
    kg m (about x, y, z), then kg/m three times.
    """

    stiffness: tuple[Number, Number, Number, Number, Number, Number]
    inertia: tuple[Number, Number, Number, Number, Number, Number]
    radius: Length = 0.005  # drawn, and what water sees

    def __post_init__(self):
        for key in ("stiffness", "inertia"):
            for index, value in enumerate(getattr(self, key)):
                if not is_symbolic(value) and value <= 0:
                    raise Bad(f"{key}.{index}", f"{value:g} is not positive")
        masses = self.inertia[3:]
        if not any(map(is_symbolic, masses)) and any(m != masses[0] for m in masses):
            given = ", ".join(f"{m:g}" for m in masses)
            raise Bad("inertia", f"a metre has one mass; the last three numbers are {given}")

    def outline(self):
        return [("circle", self.radius)]


SECTIONS = {"circle": Circle, "annulus": Annulus, "rectangle": Rectangle, "ellipse": Ellipse, "general": General}
Section = Annotated[Any, OneOf(SECTIONS, what="cross-section")]


@record(kw_only=True)
class Taper:
    """The section changes linearly from `start` (X = 0) to `end` (X = 1); both of one kind."""

    start: Section
    end: Section

    def __post_init__(self):
        _same_kind(self.start, self.end, "end")

    def at(self, X):
        return _between(self.start, self.end, X)


@record(kw_only=True)
class TableRow:
    """One line of a section table: `section` at X in [0, 1]."""

    at: Fraction
    section: Section


@record(kw_only=True)
class SectionTable:
    """Sections at given X, linear in between; the first row stands at 0, the last at 1."""

    table: tuple[TableRow, ...]

    def __post_init__(self):
        stations = [row.at for row in self.table]
        if len(stations) < 2 or stations[0] != 0 or stations[-1] != 1:
            raise Bad("table", "the first row must stand at 0 and the last at 1")
        if any(b <= a for a, b in zip(stations, stations[1:], strict=False)):
            raise Bad("table", f"the rows must stand in rising order, not {stations}")
        for row in self.table[1:]:
            _same_kind(self.table[0].section, row.section, "table")

    def at(self, X):
        for left, right in zip(self.table, self.table[1:], strict=False):
            if right.at >= X:
                return _between(left.section, right.section, (X - left.at) / (right.at - left.at))
        return self.table[-1].section


def _same_kind(a, b, key):
    if type(a) is not type(b):
        raise Bad(key, f"a {type(b).__name__.lower()} cannot follow a {type(a).__name__.lower()}; use one kind")
    if len(getattr(a, "holes", ())) != len(getattr(b, "holes", ())):
        raise Bad(key, "both ends need the same number of holes")
    if (getattr(a, "torsion_constant", None) is None) != (getattr(b, "torsion_constant", None) is None):
        raise Bad(key, "torsion_constant is given at one end only; give it at both or at neither")


def _between(a, b, X):
    """Linear interpolation of every number of two records of one kind."""
    if is_dataclass(a):
        values = {f.name: _between(getattr(a, f.name), getattr(b, f.name), X) for f in fields(a)}
        if not any(map(is_symbolic, values.values())):
            return replace(a, **values)
        other = copy.copy(a)  # without the checks of the constructor, which need numbers
        for name, value in values.items():
            object.__setattr__(other, name, value)
        return other
    if isinstance(a, tuple):
        return tuple(_between(x, y, X) for x, y in zip(a, b, strict=True))
    return a if a is None else (1 - X) * a + X * b


Profile = Annotated[Any, Either(Section, Taper, SectionTable)]


def breadth(section):
    """Radius [m] by which water sees a section: its own, or that of the circle of the same outline's area."""
    if isinstance(section, Rectangle):
        return ca.sqrt(section.width * section.height / pi)
    if isinstance(section, Ellipse):
        return ca.sqrt(section.radius_y * section.radius_z)
    return section.radius


def is_uniform(profile):
    return not isinstance(profile, (Taper, SectionTable))


def section_at(profile, X):
    """The section of a profile (one section, a Taper or a SectionTable) at X in [0, 1]."""
    return profile if is_uniform(profile) else profile.at(X)
