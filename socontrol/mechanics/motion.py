"""The sweep from base to tip: how every piece moves, what that asks for, and where its children stand.

Each piece is looked at from its own base. Given the motion of the base and q, qd, qdd of the piece, `Moved` holds the
wrench that its own mass and water ask for (about the base's origin), the work of that wrench on the piece's
coordinates, and for each place where something stands the pose, the twists S [6 x n] and the motion there.
Source: F. Renda, L. Seneviratne, ICRA 2018; R. Featherstone, "Rigid Body Dynamics Algorithms", 2008.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from socontrol.lie import se3
from socontrol.lie.motion import Motion, from_stack, rest
from socontrol.mechanics import slices
from socontrol.model.bodies import Body

PARTS = frozenset({"dry", "added", "drag"})  # what asks for wrenches: mass, added mass, drag and lift
NOTHING = Body(0.0)


@dataclass(frozen=True)
class Moved:
    """wrench [6] and work [n_i] of a piece's own mass and water; at: {x: (pose [4 x 4], S [6 x n_i], Motion)}.

    Wrench and S are seen from the base, the Motion at x in the axes there.
    """

    wrench: Any
    work: Any
    at: dict


class Sweep:
    """A robot's pieces in motion at q, qd, qdd [n each].

    still: each piece by itself, what it stands on and its own coordinates without acceleration: the bias that
    articulated bodies start from. current: whether the water moves.
    """

    def __init__(self, robot, q, qd, qdd=None, still=False, parts=PARTS, current=True):
        self.robot, self.tree, self.q, self.qd = robot, robot.tree, q, qd
        self.qdd = ca.DM(robot.n, 1) if qdd is None else qdd
        self._still, self._parts = still, parts
        self.density = robot.water.density if robot.water else None
        self._wet = self.density is not None and bool(parts - {"dry"})
        self._water = ca.vertcat(*robot.water.velocity) if self._wet and current else ca.DM(3, 1)
        self.places = standing_places(robot.tree)
        self.bases, self.moved = [], []
        for i, piece in enumerate(robot.tree.pieces):
            base, water = self._base(piece)
            self.bases.append((base, water))
            arrive = self._section if piece.is_rod else self._joint
            self.moved.append(arrive(piece, base, water, sorted(self.places[i])))

    def _base(self, piece):
        """Motion of a piece's base and the velocity of the water, both in the axes of the base."""
        g = piece.placement
        if piece.parent is None:
            return rest(), se3.rotation(g).T @ self._water
        pose, _, motion = self.moved[piece.parent].at[piece.place]
        water = se3.rotation(g).T @ (se3.rotation(pose).T @ self.bases[piece.parent][1])
        if self._still:
            motion = motion._replace(dw=ca.DM(3, 1), a=ca.DM(3, 1))
        if is_identity(g):
            return motion, water
        moved = shielded(lambda stack: from_stack(stack).moved(g).stacked())(motion.stacked())
        return from_stack(moved), water

    def _rates(self, piece):
        return self.qd[piece.columns], self.qdd[piece.columns]

    def _section(self, piece, base, water, places):
        data = slices.slice_data(piece, self._parts, self.density if self._wet else None)
        nodes = tuple(p.x for p in piece.slices)
        kernel = slices.motion_kernel(nodes, tuple(places), slices.is_plain(data), self._wet)
        xid, xidd = (piece.Phi @ rate for rate in self._rates(piece))
        outputs = kernel(piece.strain(self.q), xid, xidd, base.stacked(), piece.length, data, water)
        wrench, work, *there = outputs
        at = {
            x: (there[3 * k], there[3 * k + 1] @ piece.Phi, from_stack(there[3 * k + 2])) for k, x in enumerate(places)
        }
        return Moved(wrench, piece.Phi.T @ work, at)

    def _joint(self, piece, base, water, places):
        body, fluid = piece.record.body, piece.record.fluid if self._wet else None

        def moved(q, qd, qdd, stack, water):
            base = from_stack(stack)
            pose, S = piece.joint_step(q)
            motion = joint_motion(base, pose, S @ qd, S @ qdd + piece.twist_rate(q, qd))
            flow = se3.rotation(pose).T @ water
            F = ca.DM(6, 1)
            if body is not None or fluid is not None:
                F = slices.body_wrench(body or NOTHING, fluid, motion, flow, self.density, self._parts)
            F = se3.coAd(pose) @ F
            return F, S.T @ F, pose, S, motion.stacked()

        rates = self._rates(piece)
        wrench, work, pose, S, end = shielded(moved)(self.q[piece.columns], *rates, base.stacked(), water)
        at = {1.0: (pose, S, from_stack(end))}
        if 0.0 in places:
            at[0.0] = ca.DM.eye(4), ca.DM(6, piece.size), base
        return Moved(wrench, work, at)


def joint_motion(base, pose, twist, rate):
    """Motion at `pose` in its axes, moving by `twist` [6] with `rate` [6] about the origin of a moving `base`."""
    R, r = se3.rotation(pose), se3.position(pose)
    turn, turning = twist[:3], rate[:3]
    slide = twist[3:] + ca.cross(turn, r)
    sliding = rate[3:] + ca.cross(turning, r) + ca.cross(turn, slide)
    w, v, dw, a = base
    carried = a + ca.cross(dw, r) + ca.cross(w, ca.cross(w, r) + 2 * slide) + sliding
    parts = (w + turn, v + ca.cross(w, r) + slide, dw + ca.cross(w, turn) + turning, carried)
    return Motion(*(R.T @ part for part in parts))


def standing_places(tree):
    """For each piece the set of x where other pieces stand."""
    places = [set() for _ in tree.pieces]
    for piece in tree.pieces:
        if piece.parent is not None:
            places[piece.parent].add(piece.place)
    return places


def is_identity(g):
    """Whether a placement [4 x 4] moves nothing."""
    g = ca.SX(g)
    return g.is_constant() and not np.any(np.array(ca.DM(g)) - np.eye(4))


def shielded(compute):
    """`compute`, as one SX Function where it is called with MX: many small operations become one node.

    Functions without a closure are made once for each pattern of arguments, so that all sections share them.
    """

    def call(*args):
        if not any(isinstance(a, ca.MX) for a in args):
            return compute(*args)
        patterns = tuple(_pattern(a) for a in args)
        make = _glue if compute.__closure__ is None else _glue.__wrapped__
        return make(compute, patterns)(*args)

    return call


def _pattern(argument):
    """Size and nonzeros of an argument, as a key."""
    sparsity = argument.sparsity()
    return (*argument.shape, tuple(sparsity.colind()), tuple(sparsity.row()))


@lru_cache(maxsize=1024)
def _glue(compute, patterns):
    symbols = [ca.SX.sym(f"x{k}", ca.Sparsity(*map(_listed, pattern))) for k, pattern in enumerate(patterns)]
    results = compute(*symbols)
    results = results if isinstance(results, tuple) else (results,)
    name = compute.__name__.strip("_<>") or "glue"
    return ca.Function(name, symbols, [ca.SX(r) for r in results])


def _listed(entry):
    return list(entry) if isinstance(entry, tuple) else entry
