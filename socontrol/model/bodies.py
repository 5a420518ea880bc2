"""Rigid bodies and fixed placements."""

import numbers

import casadi as ca
import numpy as np

from socontrol.lie import se3, so3
from socontrol.quantities import Bad, Inertia, Kilogram, Position, RotationVector, Volume, record

ROUNDING = 1e-9  # relative: what numbers written with ten digits leave


@record
class Placement:
    """A fixed pose: `position` [m] and `rotation` vector [rad], both in the frame it is placed on."""

    position: Position = (0.0, 0.0, 0.0)
    rotation: RotationVector = (0.0, 0.0, 0.0)

    def pose(self):
        return se3.pose(so3.exp(ca.vertcat(*self.rotation)), ca.vertcat(*self.position))


@record
class Body:
    """A rigid body in its joint's moving frame: `com` in that frame, `inertia` about com along that frame's axes.

    `inertia`: 3 numbers (xx yy zz), 6 (xx yy zz xy xz yz) or 3 x 3 [kg m^2].
    """

    mass: Kilogram
    com: Position = (0.0, 0.0, 0.0)
    inertia: Inertia = (0.0, 0.0, 0.0)
    displaced_volume: Volume = 0.0

    def __post_init__(self):
        entries = _flat(self.inertia)
        if numbers_in([self.mass, *entries]) and self.mass == 0 and any(entries):
            raise Bad("mass", "a body with inertia needs a mass above 0 kg")
        if numbers_in(entries):
            self._refuse_impossible_inertia()

    def _refuse_impossible_inertia(self):
        """Raise Bad for an inertia that no distribution of mass has, to a relative 1e-9."""
        refuse_indefinite("inertia", self._rows())
        a, b, c = np.linalg.eigvalsh(np.array(self._rows(), dtype=float))
        if not a + b >= c * (1 - ROUNDING):
            sentence = f"principal moments {a:g}, {b:g}, {c:g} kg m^2: the largest is above the sum of the other two"
            raise Bad("inertia", f"{sentence}, which no body has")

    def inertia_matrix(self):
        """J [3 x 3] about com."""
        return ca.vertcat(*(ca.horzcat(*row) for row in self._rows()))

    def _rows(self):
        J = self.inertia
        if len(J) == 6:
            xx, yy, zz, xy, xz, yz = J
            J = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        elif not isinstance(J[0], (tuple, list)):
            J = ((J[0], 0, 0), (0, J[1], 0), (0, 0, J[2]))
        return J

    def spatial_inertia(self):
        """[J - m c~ c~, m c~; -m c~, m I] at the moving frame's origin."""
        c = ca.skew(ca.vertcat(*self.com))
        return ca.blockcat(
            [[self.inertia_matrix() - self.mass * c @ c, self.mass * c], [-self.mass * c, self.mass * ca.DM.eye(3)]]
        )


def _flat(J):
    return [x for row in J for x in (row if isinstance(row, (tuple, list)) else (row,))]


def numbers_in(values):
    """Whether all values are plain numbers, which can be compared."""
    return all(isinstance(x, numbers.Real) for x in values)


def refuse_indefinite(key, rows):
    """Raise Bad unless a matrix of numbers is symmetric and positive semidefinite; symbols are not looked at.

    Rows and columns are first scaled to a unit diagonal, which changes no sign and makes N m and N comparable.
    """
    if not numbers_in(_flat(rows)):
        return
    M = np.array(rows, dtype=float)
    diagonal = np.diag(M)
    for i in np.flatnonzero(diagonal < 0):
        raise Bad(key, f"the entry {diagonal[i]:g} on the diagonal (row {i + 1}) is negative")
    scale = np.sqrt(np.maximum(diagonal, ROUNDING**2 * diagonal.max()))
    S, tolerance = (M / np.outer(scale, scale), ROUNDING) if diagonal.any() else (M, 0.0)
    for i, j in np.argwhere(~(np.abs(S - S.T) <= tolerance * np.maximum(1, np.abs(S)))):
        given = f"{M[i, j]:g} in row {i + 1}, column {j + 1}, but {M[j, i]:g} in row {j + 1}, column {i + 1}"
        raise Bad(key, f"the matrix is not symmetric: {given}")
    if not np.linalg.eigvalsh(S)[0] >= -tolerance:
        smallest = np.linalg.eigvalsh(M)[0]
        raise Bad(key, f"the matrix is not positive semidefinite: its smallest eigenvalue is {smallest:g}")
