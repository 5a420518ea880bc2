"""Small problems with signs: linear complementarity, and the least of what is not negative."""

import numpy as np

REGULAR = 1e-12  # beside the largest diagonal entry: makes a semidefinite matrix definite while a basis is sought
REFINED = 3  # rounds that take its share out of the answer again


def complementary(G, b, one_sided):
    """x [k] with 0 <= x  perp  G x - b >= 0 where `one_sided`, G x = b elsewhere.

    Least-index pivoting, finite for definite G. Source: K. Murty, "Linear Complementarity", 1988, sec. 4.1.
    """
    basis, x = ~one_sided, np.zeros(b.size)
    size = np.max(np.abs(np.diag(G)), initial=0.0) or 1.0
    regular, room = G + REGULAR * size * np.eye(b.size), 1e-12 * np.max(np.abs(b), initial=0.0)
    for _ in range(2 ** min(b.size, 10) * (b.size + 1)):
        own = np.ix_(basis, basis)
        x = np.zeros(b.size)
        for _ in range(REFINED if basis.any() else 0):
            x[basis] += np.linalg.solve(regular[own], b[basis] - G[own] @ x[basis])
        wrong = one_sided & np.where(basis, x < -1e-12 * np.max(np.abs(x), initial=0.0), regular @ x - b < -room)
        if not wrong.any():
            break
        basis[np.argmax(wrong)] ^= True
    return np.where(one_sided, np.maximum(x, 0.0), x)


def least(x, null, positive):
    """The smallest x + null z [k] with what is `positive` not below 0; null [k x d] has orthonormal columns.

    Source: C. Lawson, R. Hanson, "Solving Least Squares Problems", 1974, ch. 23 (least distances).
    """
    base, own = x - null @ (null.T @ x), null[positive]
    pushed = np.zeros(x.size)
    pushed[positive] = complementary(own @ own.T, -base[positive], np.ones(len(own), dtype=bool))
    zero = pushed > 1e-9 * np.max(pushed, initial=0.0)
    z = np.linalg.lstsq(null[zero], -base[zero], rcond=1e-10)[0] if zero.any() else np.zeros(null.shape[1])
    found = base + null @ z
    return np.where(positive, np.maximum(found, 0.0), found)
