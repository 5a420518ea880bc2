"""Re-charting: joints in exponential coordinates (planar, spherical, free) are singular a full turn away.

Past half a turn the same pose is written by the coordinates of the shorter way, q <- log of the same g, and the rates
by those of the same twist, S(q) qd unchanged. Springs and limits act on the coordinates themselves, so joints that
have them keep their chart. Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca
import numpy as np

from socontrol.lie import se3


class Charts:
    """The joints of a robot that can be written anew, and how."""

    def __init__(self, robot):
        self._rows = [_Chart(piece) for piece in robot.tree.pieces if can_turn(piece)]

    def __bool__(self):
        return bool(self._rows)

    def renewed(self, q, qd):
        """Whether any joint was past half a turn; its coordinates in q and qd are then changed in place."""
        return any([row.renew(q, qd) for row in self._rows])


def can_turn(piece):
    """Whether a joint's coordinates have a singularity and nothing depends on which of them are used."""
    if piece.is_rod or piece.size < 2 or piece.record.limits is not None:
        return False
    turning = np.array(ca.DM(piece.Phi))[:3]
    free = not np.any(np.array(ca.DM(piece.record.matrix("stiffness"))))
    abelian = piece.size == 2  # cylindrical: turn and slide do not mix
    return free and not abelian and bool(np.any(turning))


class _Chart:
    def __init__(self, piece):
        self.columns, n = piece.columns, piece.size
        self._turning = np.array(ca.DM(piece.Phi))[:3]
        q = ca.SX.sym("q", n)
        pose, S = piece.joint_step(q)
        new = ca.DM(np.linalg.pinv(np.array(ca.DM(piece.Phi)))) @ se3.log(pose)
        self._pose = ca.Function("chart", [q], [ca.densify(new)])
        self._twists = ca.Function("twists", [q], [ca.densify(S)])

    def renew(self, q, qd):
        own = q[self.columns]
        if np.linalg.norm(self._turning @ own) <= np.pi:
            return False
        new = np.array(self._pose(own)).ravel()
        before, after = (np.array(self._twists(x)) for x in (own, new))
        qd[self.columns] = np.linalg.lstsq(after, before @ qd[self.columns], rcond=None)[0]
        q[self.columns] = new
        return True
