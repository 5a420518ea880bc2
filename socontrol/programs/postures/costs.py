"""Costs of a posture: each record gives a dimensionless expression of (q, u), scaled by the robot's own magnitudes.

A cost that is half a sum of squares has `rows`, what is squared.
"""

from typing import Annotated, Any

import casadi as ca
import numpy as np

from socontrol.quantities import Bad, OneOf, PositiveNumber, Unit, nearest, record


@record(kw_only=True)
class Effort:
    """Half the sum of squared inputs, each over its largest limit."""

    weight: PositiveNumber = 1.0

    def rows(self, posture):
        return ca.sqrt(self.weight) * posture.u / ca.DM(posture.u_scale)

    def expression(self, posture):
        return ca.sumsqr(self.rows(posture)) / 2


@record(kw_only=True)
class Reference:
    """Half the squared distance to given coordinates and inputs (by name), each over its scale."""

    coordinates: dict[str, Any] | None = None
    inputs: dict[str, Any] | None = None
    weight: PositiveNumber = 1.0

    def __post_init__(self):
        if not self.coordinates and not self.inputs:
            raise Bad("coordinates", "no reference is given; name coordinates or inputs")

    def expression(self, posture):
        return ca.sumsqr(self.rows(posture)) / 2

    def rows(self, posture):
        rows, robot = [], posture.robot
        for key, names, units, x, scale in (
            ("coordinates", robot.coordinates, robot.coordinate_units, posture.q, posture.q_scale),
            ("inputs", robot.inputs, robot.input_units, posture.u, posture.u_scale),
        ):
            for name, value in (getattr(self, key) or {}).items():
                if name not in names:
                    raise Bad(f"{key}.{name}", f"the robot has no '{name}'{nearest(name, names)}")
                i = names.index(name)
                try:
                    number = Unit(units[i], angle=units[i] == "rad").read(value)
                except ValueError as error:
                    raise Bad(f"{key}.{name}", str(error)) from None
                rows.append((x[i] - number) / float(np.asarray(scale)[i]))
        return ca.sqrt(self.weight) * ca.vertcat(*rows)


@record(kw_only=True)
class StrainEnergy:
    """Elastic energy over the robot's energy scale."""

    weight: PositiveNumber = 1.0

    def expression(self, posture):
        return self.weight * posture.elastic_energy() / posture.energy_scale


COSTS = {"effort": Effort, "reference": Reference, "strain_energy": StrainEnergy}
Cost = Annotated[Any, OneOf(COSTS, what="cost")]
