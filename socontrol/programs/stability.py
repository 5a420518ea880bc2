"""Stability of an equilibrium: eigenvalues of the scaled tangent stiffness on the free coordinates.

Conservative loads: stable if the smallest eigenvalue of the symmetric part is positive (a minimum of the energy).
With follower loads or dead moments the tangent is not symmetric; the eigenvalue of smallest real part then tells
divergence (static instability) only, and the sentence says so: flutter needs the masses.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stability:
    """smallest: eigenvalue of the scaled tangent (1 = as stiff as the unloaded robot); sentence for the report."""

    stable: bool
    smallest: float
    conservative: bool
    sentence: str
    word: str = "stable"


def stability(tangent, scales, conservative, free=None):
    """Stability from K_tot [n x n], the coordinates' scales and whether all loads have a potential."""
    free = slice(None) if free is None else free
    K = tangent * scales.q[None, :] / scales.force[:, None]
    K = K[free][:, free]
    if not np.all(np.isfinite(K)):
        return Stability(False, float("nan"), conservative, "unknown, tangent not finite", "of unknown stability")
    if K.size == 0:
        return Stability(True, float("inf"), conservative, "stable (no free coordinate)")
    if conservative:
        smallest = float(np.linalg.eigvalsh((K + K.T) / 2)[0])
        kind = "smallest eigenvalue of the scaled tangent stiffness"
    else:
        smallest = float(np.min(np.linalg.eigvals(K).real))
        kind = "smallest real part of the scaled tangent's eigenvalues (follower load: divergence only, not flutter)"
    word = "stable" if smallest > 1e-9 else "marginal" if smallest > -1e-9 else "UNSTABLE"
    return Stability(smallest > 1e-9, smallest, conservative, f"{word}, {kind} {smallest:.3g}", word)
