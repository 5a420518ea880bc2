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
    """wrench [6] and work [n_i] of a piece's own mass and water; at: {x: (pose [4 x 4], S [6 x n_i], Motion)};
    inertia: bb [6 x 6], bq [6 x n_i], qq [n_i x n_i] of its mass and added mass, where asked for.

    Wrench, S and inertia are seen from the base, the Motion at x in the axes there.
    """

    wrench: Any
    work: Any
    at: dict
    inertia: tuple = ()


class Sweep:
    """A robot's pieces in motion at q, qd, qdd [n each].

    still: each piece by itself, what it stands on and its own coordinates without acceleration: the bias that
    articulated bodies start from, with their inertia. current: whether the water moves. gravity: acceleration [3] that
    the world falls with, so that masses weigh.
    """

    def __init__(self, robot, q, qd, qdd=None, still=False, parts=PARTS, current=True, gravity=None):
        self.robot, self.tree, self.q, self.qd = robot, robot.tree, q, qd
        self.qdd = ca.DM.zeros(robot.n, 1) if qdd is None else qdd
        self._still, self._parts = still, parts
        self.density = robot.water.density if robot.water else None
        self._wet = self.density is not None and bool(parts - {"dry"})
        self._water = ca.vertcat(*robot.water.velocity) if self._wet and current else ca.DM.zeros(3, 1)
        self.gravity = ca.DM.zeros(3, 1) if gravity is None else ca.vertcat(*gravity)
        self.places = standing_places(robot.tree)
        self.bases, self.moved = [], []
        for i, piece in enumerate(robot.tree.pieces):
            base, water = self._base(piece)
            self.bases.append((base, water))
            arrive = self._section if piece.is_rod else self._joint
            self.moved.append(arrive(piece, base, water, sorted(self.places[i])))

    def root(self, piece):
        """Acceleration [6] of the base of a root: the world falls up."""
        return ca.vertcat(ca.DM.zeros(3, 1), -(se3.rotation(piece.placement).T @ self.gravity))

    def _base(self, piece):
        """Motion of a piece's base and the velocity of the water, both in the axes of the base."""
        g = piece.placement
        if piece.parent is None:
            return rest()._replace(a=self.root(piece)[3:]), se3.rotation(g).T @ self._water
        pose, _, motion = self.moved[piece.parent].at[piece.place]
        water = self._water
        if self._wet:
            water = se3.rotation(g).T @ (se3.rotation(pose).T @ self.bases[piece.parent][1])
        if is_identity(g):
            return motion, water
        return from_stack(shielded(self._placed(g))(motion.stacked())), water

    def _placed(self, g):
        def placed(stack):
            motion = from_stack(stack)
            return (motion._replace(dw=ca.DM(3, 1), a=ca.DM(3, 1)) if self._still else motion).moved(g).stacked()

        return placed

    def _state(self, piece, base):
        """Coordinates, rates, and what accelerates of a piece: base motion [12] and coordinates; if all stand still,
        base twist [6] and what the placement on a turning base adds, its centripetal acceleration [3]."""
        q, qd, qdd = (x[piece.columns] for x in (self.q, self.qd, self.qdd))
        if not self._still:
            return q, qd, base.stacked(), qdd
        centripetal = piece.parent is not None and not is_identity(piece.placement)
        return q, qd, base.stacked()[:6], base.a if centripetal else ca.DM.zeros(3, 1)

    def _section(self, piece, base, water, places):
        data = ca.densify(slices.slice_data(piece, self._parts, self.density if self._wet else None))
        nodes, kind = tuple(p.x for p in piece.slices), (basis(piece), slices.shape(data), self._wet)
        if isinstance(self.q, ca.MX):
            places = sorted({*places, 1.0})  # so that the last section is like the others
        kernel = (slices.bias_kernel if self._still else slices.motion_kernel)(nodes, tuple(places), *kind)
        outputs = kernel(*self._state(piece, base), water, piece.xi_bar, piece.length, data)
        inertia, outputs = (outputs[:3], outputs[3:]) if self._still else ((), outputs)
        wrench, work, *there = outputs
        at = {x: (*there[3 * k : 3 * k + 2], from_stack(there[3 * k + 2])) for k, x in enumerate(places)}
        return Moved(wrench, work, at, inertia)

    def _joint(self, piece, base, water, places):
        body, fluid = piece.record.body, piece.record.fluid if self._wet else None

        def moved(q, qd, base, last, water):
            if self._still:
                base, qdd = Motion(*ca.vertsplit(base, 3), ca.DM(3, 1), last), ca.DM(piece.size, 1)
            else:
                base, qdd = from_stack(base), last
            pose, S = piece.joint_step(q)
            motion = joint_motion(base, pose, S @ qd, S @ qdd + piece.twist_rate(q, qd))
            flow = se3.rotation(pose).T @ water
            F = ca.DM(6, 1)
            if body is not None or fluid is not None:
                F = slices.body_wrench(body or NOTHING, fluid, motion, flow, self.density, self._parts)
            F = turned(pose, F)
            inertia = joint_inertia(piece, pose, S, self.density) if self._still else ()
            return F, S.T @ F, pose, S, motion.stacked(), *inertia

        state = self._state(piece, base)
        wrench, work, pose, S, end, *inertia = shielded(moved)(*state, water)
        at = {1.0: (pose, S, from_stack(end))}
        if 0.0 in places:
            start = base._replace(dw=ca.DM.zeros(3, 1), a=state[-1]) if self._still else base
            at[0.0] = ca.DM.eye(4), ca.DM(6, piece.size), start
        return Moved(wrench, work, at, inertia)


def basis(piece):
    """Phi of a section of rod, as a key."""
    return tuple(map(tuple, np.array(ca.DM(piece.Phi))))


def joint_inertia(piece, pose, S, density):
    """bb [6 x 6], bq [6 x n], qq [n x n] of the body on a joint; `density` of the water whose added mass joins."""
    body, n = piece.record.body, piece.size
    if body is None and (piece.record.fluid is None or density is None):
        return ca.DM(6, 6), ca.DM(6, n), ca.DM(n, n)
    N = moved_inertia(pose, slices.body_inertia(body or NOTHING, piece.record.fluid, density))
    NS = N @ S
    return N, NS, slices.mirrored(S.T @ NS)


def moved_inertia(g, M):
    """Ad_g^-T M Ad_g^-1: an inertia [6 x 6] given at the frame g, seen from the frame of g's coordinates."""
    R, lever = se3.rotation(g), ca.skew(se3.position(g))
    J, H, m = (R @ part @ R.T for part in (M[:3, :3], M[:3, 3:], slices.mirrored(M[3:, 3:])))
    moved = H + lever @ m
    return slices.mirrored(ca.blockcat([[J + lever @ H.T - moved @ lever, ca.DM(3, 3)], [moved.T, m]]))


def turned(pose, F):
    """coAd(pose) F: the wrench F [6] of the frame `pose`, seen from the frame it is given in."""
    R, r = se3.rotation(pose), se3.position(pose)
    force = R @ F[3:]
    return ca.vertcat(R @ F[:3] + ca.cross(r, force), force)


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
