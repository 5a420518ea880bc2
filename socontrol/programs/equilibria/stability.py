"""Stability of an equilibrium: eigenvalues of the scaled tangent stiffness on the free coordinates.

Conservative loads: stable if the smallest eigenvalue of the symmetric part is positive (a minimum of the energy).
With follower loads or dead moments the tangent is not symmetric; the eigenvalue of smallest real part then tells
divergence (static instability) only, and the sentence says so: flutter needs the masses.

Held lengths leave the motions that do not change them, the null space Z of their slopes A = dl/dq; what they push with,
in the space of B, does no harm: the eigenvalues are those of (W^T Z)^-1 W^T K Z, with W the null space of B^T.
"""

from dataclasses import dataclass

import numpy as np

MARGINAL = 1e-9  # eigenvalue, of a stiffness that is 1 at rest: nearer to zero its sign may be rounding


@dataclass(frozen=True)
class Stability:
    """smallest: eigenvalue of the scaled tangent (1 = as stiff as the unloaded robot); sentence for the report."""

    stable: bool
    smallest: float
    conservative: bool
    sentence: str
    word: str = "stable"


def stability(tangent, scales, conservative, free=None, held=None):
    """Stability from K_tot [n x n], the coordinates' scales and whether all loads have a potential.

    held: slopes A [k x n] of lengths that cannot change, and the columns [n x k] of the inputs that hold them.
    """
    free = slice(None) if free is None else free
    K = tangent * scales.q[None, :] / scales.force[:, None]
    K = K[free][:, free]
    if held is not None and len(held[0]):
        K = _moving(K, held[0][:, free] * scales.q[free], held[1][free] / scales.force[free][:, None])
    if not np.all(np.isfinite(K)):
        return Stability(False, float("nan"), conservative, "unknown, tangent not finite", "of unknown stability")
    if K.size == 0:
        return Stability(True, float("inf"), conservative, "stable (no free coordinate)")
    smallest = float(eigenvalues(K, conservative)[0])
    if conservative:
        kind = "smallest eigenvalue of the scaled tangent stiffness"
    else:
        kind = "smallest real part of the scaled tangent's eigenvalues"
        kind += " (some forces have no potential: divergence only, not flutter)"
    word = called(smallest)
    return Stability(smallest > MARGINAL, smallest, conservative, f"{word}, {kind} {smallest:.3g}", word)


def called(smallest):
    """`stable`, `marginal` (some motion neither returns nor grows) or `unstable`, by the smallest eigenvalue."""
    return "stable" if smallest > MARGINAL else "marginal" if smallest >= -MARGINAL else "unstable"


def called_along(smallest, critical):
    """What the points of a branch are called; those at indices `critical` as their neighbours."""
    words = [called(x) for x in smallest]
    for k in sorted(critical):
        words[k] = words[k - 1] if k else words[min(1, len(words) - 1)]
    return words


def eigenvalues(K, conservative):
    """Eigenvalues, ascending, of the symmetric part of K [d x d]; not conservative: the real parts of those of K."""
    return np.linalg.eigvalsh((K + K.T) / 2) if conservative else np.sort(np.linalg.eigvals(K).real)


def _moving(K, A, B):
    """K on the motions that keep the lengths of slopes A, pushed by columns B."""
    Z, W = _null(A), _null(B.T)
    if Z.shape != W.shape:  # some push does not change any length: as if all were held by their own slopes
        W = Z
    return np.linalg.solve(W.T @ Z, W.T @ K @ Z)


def _null(A):
    """Orthonormal columns of the null space of A."""
    size = np.maximum(np.linalg.norm(A, axis=1), 1e-300)
    values, rows = np.linalg.svd(A / size[:, None])[1:]
    return rows[int(np.sum(values > 1e-9)) :].T
