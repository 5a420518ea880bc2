"""Closed chains in numpy alone: `Plain` with loops, whose rows and forces share no formula with the library."""

import numpy as np
from robots import Plain, placed, slopes


class Closed(Plain):
    """A `Plain` robot with welds and pins."""

    def error(self, q):
        """Rows [... k] that are zero where the loops are closed: three turns of a weld, two of a pin, three gaps."""
        q = np.asarray(q)
        stations, rows = self.stations(q), []
        for loop in self.robot.loops.values():
            a, b = (self._end(q, end, stations) for end in (loop.a, loop.b))
            Ra, Rb = a[..., :3, :3], b[..., :3, :3]
            if hasattr(loop, "axis"):
                axis = np.array(loop.axis) / np.linalg.norm(loop.axis)
                across = np.linalg.svd(axis[None])[2][1:]
                rows += [((Ra @ axis) * (Rb @ w)).sum(-1) for w in across]
            else:
                turn = np.swapaxes(Rb, -1, -2) @ Ra
                rows += [turn[..., i, j] - turn[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2))]
            rows += list(np.moveaxis(a[..., :3, 3] - b[..., :3, 3], -1, 0))
        return np.stack(rows, axis=-1)

    def _end(self, q, end, stations):
        stand = np.eye(4) if end.segment == "world" else self.frame(q, end.segment, end.at, stations)
        return stand @ placed(end.placement)

    def moving(self, q):
        """Basis [n x d] of the motions that keep the loops closed."""
        s, rows = np.linalg.svd(slopes(self.error, q).T)[1:]
        return rows[int(np.sum(s > 1e-7 * s[0])) :].T

    def forces(self, q):
        """Along these motions: elastic and external force [d] and that of each input [d x m]."""
        Z = self.moving(q)
        return Z.T @ slopes(self.elastic_energy, q), Z.T @ self.external_force(q), Z.T @ self.actuation(q)
