"""Poses and twists of a tree of pieces at q, seen from the world.

    g_w,base(i) = g_w,parent(x) placement_i,   S_w(i, x) = Ad(g_w,base(i)) S_i(x)   [6 x n_i]

S_w(i, x) qd_i is the twist, about the world's origin, that q_i gives to everything carried at x on piece i or
beyond. Body Jacobian of a frame g: J = Ad(g)^-1 [S_w of the chain], eta = J qd (body frame, angular first).
Source: F. Renda, L. Seneviratne, ICRA 2018.
"""

import casadi as ca

from socontrol.lie import se3


class Kinematics:
    """Steps and poses at one q; each is formed once and shared by all who ask."""

    def __init__(self, tree, q):
        self.tree, self.q = tree, q
        self._steps, self._twists, self._bases = {}, {}, []
        for piece in tree.pieces:
            at = ca.DM.eye(4) if piece.parent is None else self.pose(piece.parent, piece.place)
            self._bases.append(at @ piece.placement)

    def step(self, i, x=1.0):
        """g [4 x 4] and S [6 x n_i] from the base of piece i to x, seen from that base."""
        if (i, x) not in self._steps:
            self._steps[i, x] = self.tree.pieces[i].step(self.q, x)
        return self._steps[i, x]

    def base(self, i):
        """g_w,base [4 x 4] of piece i."""
        return self._bases[i]

    def pose(self, i, x=1.0):
        """World <- frame at x of piece i [4 x 4]."""
        return self._bases[i] @ self.step(i, x)[0]

    def frame_pose(self, frame):
        """World <- frame [4 x 4]."""
        return self.pose(frame.piece, frame.x) @ frame.offset

    def twists(self, i, x=1.0):
        """S_w [6 x n_i]: world twists that the coordinates of piece i give at x and beyond."""
        if (i, x) not in self._twists:
            self._twists[i, x] = se3.Ad(self._bases[i]) @ self.step(i, x)[1]
        return self._twists[i, x]

    def jacobian(self, frame):
        """Body Jacobian [6 x n] of a frame."""
        columns = {i: self.twists(i, x) for i, x in self.tree.chain(frame.piece, frame.x)}
        blocks = [columns.get(i, ca.DM(6, piece.size)) for i, piece in enumerate(self.tree.pieces)]
        return se3.Ad_inv(self.frame_pose(frame)) @ ca.horzcat(*blocks)
