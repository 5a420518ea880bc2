"""What surrounding water does to a segment: coefficients of drag, lift and added mass, per rod or per body.

Rod of radius r, per length: force = -rho r |n| D n - diag(linear) n with D = [C_t 0 0; 0 C_n C_l; 0 -C_l C_n] and n the
velocity of its centreline against the water; added mass diag(0, c_y, c_z) rho A. Body: wrench = -rho |n| diag(drag)
[w; n] - diag(linear) [w; n] at its centre of mass; added mass given, or that of a spheroid. All in body axes.
Sources: F. Renda, L. Seneviratne, ICRA 2018; spheroids: H. Lamb, "Hydrodynamics", 1932, secs. 114-115.
"""

from math import atan, log, pi, sqrt
from typing import Annotated

import casadi as ca

from socontrol.quantities import Bad, Length, Number, Unit, is_symbolic, record

Coefficient = Annotated[float, Unit("1", lower=0)]
PerLength = Annotated[float, Unit("Pa s", lower=0)]
AT_REST = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@record(kw_only=True)
class RodFluid:
    """Coefficients along a rod: `tangential`, `normal`, `lift` [1] (lift: + drives against y where the rod slides
    along +z; its sign follows the handedness of the surface), `linear` (tangential, normal) [N s/m^2],
    `added_mass` (y, z) over rho A [1]."""

    tangential: Coefficient = 0.0
    normal: Coefficient = 0.0
    lift: Number = 0.0
    linear: tuple[PerLength, PerLength] = (0.0, 0.0)
    added_mass: tuple[Coefficient, Coefficient] = (0.0, 0.0)

    def density(self, radius, area, water):
        """The coefficients times what they refer to, per length of a rod in water of density `water`."""
        squared = [water * radius * c for c in (self.tangential, self.normal, self.lift)]
        return [*squared, *self.linear, *(water * area * c for c in self.added_mass)]


@record(kw_only=True)
class Spheroid:
    """Half axes `along` x and `across` it."""

    along: Length
    across: Length

    def __post_init__(self):
        if not (is_symbolic(self.along) or is_symbolic(self.across)) and not 1e-5 < self.along / self.across < 1e5:
            given = f"{self.along:g} m along and {self.across:g} m across"
            raise Bad("across", f"{given}: a needle or a sheet, no spheroid")

    def added(self, water):
        """Added inertia [3, kg m^2] and mass [3, kg] about the centre; raises ValueError for axes that are symbols.

        alpha = 2 b^2 int_0^1 t^2 / (a^2 + (b^2 - a^2) t^2) dt, alpha + 2 beta = 2.
        """
        a, b = self.along, self.across
        if is_symbolic(a) or is_symbolic(b):
            raise ValueError("the half axes of a spheroid must be numbers: which formula holds depends on them")
        mass, alpha = 4 / 3 * pi * water * a * b**2, _alpha(a, b)
        beta = 1 - alpha / 2
        turning = 2 * (a**2 - b**2) + (a**2 + b**2) * (alpha - beta)
        spin = mass / 5 * (a**2 - b**2) ** 2 * (beta - alpha) / turning if abs(a - b) > 1e-9 * a else 0.0
        side = mass * beta / (2 - beta)
        return ca.vertcat(0, spin, spin), ca.vertcat(mass * alpha / (2 - alpha), side, side)


def _alpha(a, b):
    """Lamb's alpha_0 of a spheroid with half axes a along and b across: 2/3 for a sphere."""
    d = 1 - (b / a) ** 2  # e^2 of a prolate spheroid, negative for an oblate one
    if abs(d) < 0.02:  # 2 (1 - d) sum d^i / (2 i + 3), 12 terms leave 0.02^12
        return 2 * (1 - d) * sum(d**i / (2 * i + 3) for i in range(12))
    e = sqrt(abs(d))
    arc = log((1 + e) / (1 - e)) / 2 if d > 0 else atan(e)
    return 2 * (1 - d) / d * (arc / e - 1)


@record(kw_only=True)
class BodyFluid:
    """Coefficients of a body: `drag` (three about, three along the axes) [m^4 per rad, m^2], `linear` [N m s, N s/m],
    `added_mass` [kg m^2, kg], or the `spheroid` whose added mass it has."""

    drag: tuple[Coefficient, Coefficient, Coefficient, Coefficient, Coefficient, Coefficient] = AT_REST
    linear: tuple[Coefficient, Coefficient, Coefficient, Coefficient, Coefficient, Coefficient] = AT_REST
    added_mass: tuple[Coefficient, Coefficient, Coefficient, Coefficient, Coefficient, Coefficient] | None = None
    spheroid: Spheroid | None = None

    def __post_init__(self):
        if self.added_mass is not None and self.spheroid is not None:
            raise Bad("added_mass", "give added_mass or spheroid, not both")

    def added(self, water):
        """Added inertia [3] and mass [3] in water of this density; `added_mass` is taken as given."""
        if self.spheroid is not None:
            return self.spheroid.added(water)
        numbers = ca.vertcat(*(self.added_mass or AT_REST))
        return numbers[:3], numbers[3:]

    def drag_wrench(self, water, w, n, speed):
        """Moment and force [3 each] of the water, body axes; w turns, n moves against the water at |n| = speed."""
        drag, linear = ca.vertcat(*self.drag), ca.vertcat(*self.linear)
        gains = -(water * speed * drag + linear)
        return gains[:3] * w, gains[3:] * n
