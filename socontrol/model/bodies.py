"""Rigid bodies and fixed placements."""

import casadi as ca

from socontrol.lie import se3, so3
from socontrol.quantities import Bad, Inertia, Kilogram, Position, RotationVector, Volume, record


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
        if isinstance(self.mass, float) and self.mass == 0 and any(_flat(self.inertia)):
            raise Bad("mass", "a body with inertia needs a mass above 0 kg")

    def inertia_matrix(self):
        """J [3 x 3] about com."""
        J = self.inertia
        if len(J) == 6:
            xx, yy, zz, xy, xz, yz = J
            J = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        elif not isinstance(J[0], (tuple, list)):
            J = ((J[0], 0, 0), (0, J[1], 0), (0, 0, J[2]))
        return ca.vertcat(*(ca.horzcat(*row) for row in J))

    def spatial_inertia(self):
        """[J - m c~ c~, m c~; -m c~, m I] at the moving frame's origin."""
        c = ca.skew(ca.vertcat(*self.com))
        return ca.blockcat(
            [[self.inertia_matrix() - self.mass * c @ c, self.mass * c], [-self.mass * c, self.mass * ca.DM.eye(3)]]
        )


def _flat(J):
    return [x for row in J for x in (row if isinstance(row, (tuple, list)) else (row,))]
