"""Costs of a posture: each record gives a dimensionless expression of (q, u), scaled by the robot's own magnitudes."""

from typing import Annotated, Any

import casadi as ca
import numpy as np

from socontrol.quantities import Bad, Number, OneOf, PositiveNumber, nearest, record


@record(kw_only=True)
class Effort:
    """Half the sum of squared inputs, each over its largest limit."""

    weight: PositiveNumber = 1.0

    def expression(self, posture):
        scaled = posture.u / ca.DM(posture.u_scale)
        return self.weight * ca.sumsqr(scaled) / 2


@record(kw_only=True)
class Reference:
    """Half the squared distance to given coordinates and inputs (SI, by name), each over its scale."""

    coordinates: dict[str, Number] | None = None
    inputs: dict[str, Number] | None = None
    weight: PositiveNumber = 1.0

    def __post_init__(self):
        if not self.coordinates and not self.inputs:
            raise Bad("coordinates", "no reference is given; name coordinates or inputs")

    def expression(self, posture):
        total = 0
        for key, names, x, scale in (
            ("coordinates", posture.robot.coordinates, posture.q, posture.q_scale),
            ("inputs", posture.robot.inputs, posture.u, posture.u_scale),
        ):
            for name, value in (getattr(self, key) or {}).items():
                if name not in names:
                    raise Bad(f"{key}.{name}", f"the robot has no '{name}'{nearest(name, names)}")
                i = names.index(name)
                total += ((x[i] - value) / float(np.asarray(scale)[i])) ** 2 / 2
        return self.weight * total


@record(kw_only=True)
class StrainEnergy:
    """Elastic energy over the robot's energy scale."""

    weight: PositiveNumber = 1.0

    def expression(self, posture):
        return self.weight * posture.elastic_energy() / posture.energy_scale


COSTS = {"effort": Effort, "reference": Reference, "strain_energy": StrainEnergy}
Cost = Annotated[Any, OneOf(COSTS, what="cost")]
