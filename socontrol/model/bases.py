"""Strains of a rod and the rows of the distributed joint table: which strains are free.

xi = Phi q + xi_bar with xi = [k; p] = (twist, bend_y, bend_z, stretch, shear_y, shear_z), angular first, body
frame, local x along the rod; xi_bar = e4, so that q = 0 is the straight, unstretched rod.
Source: F. Renda, L. Seneviratne, ICRA 2018; names of the rows are those of the models they hold.
"""

import casadi as ca

from socontrol.quantities import nearest

STRAINS = ("twist", "bend_y", "bend_z", "stretch", "shear_y", "shear_z")
STRAIN_UNITS = {"twist": "1/m", "bend_y": "1/m", "bend_z": "1/m", "stretch": "1", "shear_y": "1", "shear_z": "1"}
XI_BAR = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)  # strain of the straight, unstretched rod

STRAIN_SETS = {
    "linear_spring": ("stretch",),
    "planar_constant_curvature": ("bend_z", "stretch"),
    "inextensible_constant_curvature": ("bend_y", "bend_z"),
    "constant_curvature": ("bend_y", "bend_z", "stretch"),
    "inextensible_kirchhoff_love": ("twist", "bend_y", "bend_z"),
    "kirchhoff_love": ("twist", "bend_y", "bend_z", "stretch"),
    "simo_reissner": STRAINS,
}


def active_strains(strains):
    """Names of the free strains in the fixed order; `strains` is a row of STRAIN_SETS or a list of names.

    Raises ValueError with the allowed names.
    """
    if isinstance(strains, str):
        if strains not in STRAIN_SETS:
            raise ValueError(f"unknown set of strains '{strains}'{nearest(strains, STRAIN_SETS)}")
        return STRAIN_SETS[strains]
    unknown = [name for name in strains if name not in STRAINS]
    if unknown:
        raise ValueError(f"unknown strain '{unknown[0]}'{nearest(unknown[0], STRAINS)}")
    if len(set(strains)) < len(strains):
        raise ValueError("a strain is named twice")
    if not strains:
        raise ValueError("no strain is free; name at least one, or use a segment of type 'fixed'")
    return tuple(name for name in STRAINS if name in strains)


def selection(strains):
    """Phi [6 x n]: one unit column for each free strain."""
    columns = [STRAINS.index(name) for name in strains]
    return ca.DM.eye(6)[:, columns]
