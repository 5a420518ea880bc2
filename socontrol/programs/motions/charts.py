"""Re-charting: joints in exponential coordinates (planar, spherical, free) are singular a full turn away.

Past half a turn the same pose is written by the coordinates of the shorter way, q <- log of the same g, and the rates
by those of the same twist, S(q) qd unchanged. Springs, dampers, limits and motors act on the coordinates themselves, so
joints that have them keep their chart. Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca
import numpy as np

from socontrol.lie import se3

NEAR = 0.02  # rad short of a full turn: there the map from rates to motion loses two digits


class Charts:
    """The joints of a robot that can be written anew, and how; `driven`: coordinates that a motor moves."""

    def __init__(self, robot, driven=()):
        held = set(map(int, driven))
        singular = [piece for piece in robot.tree.pieces if is_singular(piece)]
        own = [held.isdisjoint(range(p.columns.start, p.columns.stop)) and is_bare(p) for p in singular]
        self._rows = [_Chart(p) for p, renewable in zip(singular, own, strict=True) if renewable]
        self._kept = [p for p, renewable in zip(singular, own, strict=True) if not renewable]

    def __bool__(self):
        return bool(self._rows)

    def renewed(self, q, qd):
        """Whether any joint was past half a turn; its coordinates in q and qd are then changed in place."""
        return any([row.renew(q, qd) for row in self._rows])

    def stuck(self, q):
        """Name of a joint that keeps its chart and is nearly a full turn away, or None."""
        for piece in self._kept:
            if np.linalg.norm(turning(piece) @ q[piece.columns]) > 2 * np.pi - NEAR:
                return piece.segment
        return None


def is_singular(piece):
    """Whether a joint's coordinates are singular a full turn away: turns and slides that do not commute."""
    cylindrical = piece.size == 2
    return not piece.is_rod and piece.size > 1 and not cylindrical and bool(np.any(turning(piece)))


def is_bare(piece):
    """Whether nothing acts on a joint's coordinates themselves: no spring, damper or limit."""
    matrices = [np.array(ca.DM(piece.record.matrix(key))) for key in ("stiffness", "damping")]
    return piece.record.limits is None and not any(map(np.any, matrices))


def turning(piece):
    return np.array(ca.DM(piece.Phi))[:3]


class _Chart:
    def __init__(self, piece):
        self.columns, n = piece.columns, piece.size
        self._turning = turning(piece)
        q = ca.SX.sym("q", n)
        pose, S = piece.joint_step(q)
        new = ca.DM(np.linalg.pinv(np.array(ca.DM(piece.Phi)))) @ se3.log(pose)
        self._pose = ca.Function("chart", [q], [ca.densify(new)])
        self._twists = ca.Function("twists", [q], [ca.densify(S)])

    def renew(self, q, qd):
        """Whether the joint was past half a turn; q and qd are then changed in place."""
        own = q[self.columns]
        if np.linalg.norm(self._turning @ own) <= np.pi:
            return False
        new = np.array(self._pose(own)).ravel()
        before, after = (np.array(self._twists(x)) for x in (own, new))
        qd[self.columns] = np.linalg.lstsq(after, before @ qd[self.columns], rcond=None)[0]
        q[self.columns] = new
        return True
