"""An arc exp(s xi) whose twist xi(t) changes while its base moves: what every place on it does, and what it feels.

With xi = [k; p], x = k.k and phi_n(s) = s^n c_n(s^2 x) (Stumpff functions c_n) the arc has
    r(s) = sum_n phi_n u_n,   u = (p, k x p, k k.p),      rotation rate sum_n phi_n t_n,  t = (kd, k x kd, k k.kd)
so position, velocity and acceleration of a place are sums of few vectors, the same for the whole arc, with weights
that depend on the place: phi_n and their derivatives phi_n', phi_n'' in x. Forces are collected with the same weights
and projected once. This makes a quadrature node cost a few weighted sums, not products of 6 x 6 matrices.
All vectors are seen from the base of the arc. Source of the kinematics: F. Renda et al., T-RO 2018.
"""

from functools import lru_cache
from math import factorial, pi
from typing import Any, NamedTuple

import casadi as ca

from socontrol.lie import se3, so3, stumpff

ROUNDING = 1e-16  # of the first term that a shortened series drops


class Motion(NamedTuple):
    """How a frame moves, in its own axes: w, v angular and linear velocity [3]; dw, a their rates [3].

    `a` is the acceleration of the frame's origin against an inertial frame, not the rate of the components of v.
    """

    w: Any
    v: Any
    dw: Any
    a: Any

    def moved(self, g):
        """Motion of a frame fixed at g [4 x 4] in this one."""
        R, r = se3.rotation(g), se3.position(g)
        v, a = self.v + ca.cross(self.w, r), self.a + ca.cross(self.dw, r) + ca.cross(self.w, ca.cross(self.w, r))
        return Motion(*(R.T @ part for part in (self.w, v, self.dw, a)))

    def twist(self):
        return ca.vertcat(self.w, self.v)

    def stacked(self):
        return ca.vertcat(*self)


def rest():
    """The motion of the world."""
    return Motion(*(ca.DM(3, 1) for _ in range(4)))


def from_stack(column):
    """Motion of its stacked components [12]."""
    return Motion(column[:3], column[3:6], column[6:9], column[9:])


@lru_cache(maxsize=4096)
def terms_up_to(fraction):
    """Terms that the series of c_6 and c_7 need for angles up to `fraction` of the range; c_0 = ... - x^3 c_6."""
    largest = (fraction * 2 * pi) ** 2
    return next(n for n in range(3, 40) if largest ** (n + 3) / factorial(2 * n + 6) < ROUNDING)


class Weights:
    """phi, phi' and phi'' [3 each] and the rotation at s, a `fraction` of the arc of curvature vector k."""

    def __init__(self, k, s, fraction):
        x = ca.dot(k, k)
        c = stumpff.series(s**2 * x, terms_up_to(fraction), top=7)
        slope = stumpff.slopes(c)
        bend = stumpff.slopes(slope)
        self.phi = ca.vertcat(*(s**n * c[n] for n in (1, 2, 3)))
        self.slope = ca.vertcat(*(s ** (n + 2) * slope[n] for n in (1, 2, 3)))
        self.bend = ca.vertcat(*(s ** (n + 4) * bend[n] for n in (1, 2, 3)))
        diagonal, off = so3.outer(k)
        self.R = so3.assemble(c[0] + s**2 * c[2] * diagonal, s**2 * c[2] * off, s * c[1] * k)
        self.A = so3.assemble(self.phi[0] + self.phi[2] * diagonal, self.phi[2] * off, self.phi[1] * k)


def _fan(k, p):
    """[p, k x p, k k.p] as columns [3 x 3]."""
    return ca.horzcat(p, ca.cross(k, p), k * ca.dot(k, p))


def _fan_rate(k, kd, p, pd):
    along = ca.dot(kd, p) + ca.dot(k, pd)
    return ca.horzcat(pd, ca.cross(kd, p) + ca.cross(k, pd), kd * ca.dot(k, p) + k * along)


def _fan_second(k, kd, kdd, p, pd, pdd):
    along = ca.dot(kd, p) + ca.dot(k, pd)
    second = ca.dot(kdd, p) + 2 * ca.dot(kd, pd) + ca.dot(k, pdd)
    turning = ca.cross(kdd, p) + 2 * ca.cross(kd, pd) + ca.cross(k, pdd)
    return ca.horzcat(pdd, turning, kdd * ca.dot(k, p) + 2 * kd * along + k * second)


class Arc:
    """Geometry of exp(s xi): position, rotation and the maps from the rate of xi to motion, at any s."""

    def __init__(self, xi):
        self.k, self.p = xi[:3], xi[3:]
        self.u = _fan(self.k, self.p)

    def weights(self, s, fraction):
        return Weights(self.k, s, fraction)

    def position(self, at):
        """r [3]."""
        return self.u @ at.phi

    def pose(self, at):
        return se3.pose(at.R, self.position(at))

    def reach(self, at):
        """dr/dk [3 x 3]; dr/dp is `at.A`, and so is the map from kd to the rotation rate."""
        k, p = self.k, self.p
        twisted = at.phi[2] * ca.dot(k, p) * ca.DM.eye(3) + at.phi[2] * k @ p.T - at.phi[1] * ca.skew(p)
        return twisted + (self.u @ at.slope) @ (2 * k).T

    def tangent(self, at):
        """T [6 x 6]: the twist about the base's origin that the rate of xi gives at s, s tangent(s xi)."""
        return ca.blockcat([[at.A, ca.DM(3, 3)], [self.reach(at) + ca.skew(self.position(at)) @ at.A, at.A]])


class MovingArc(Arc):
    """An arc with the rates of its twist, on a base with a `Motion`."""

    def __init__(self, xi, xid, xidd, base):
        super().__init__(xi)
        k, p, (kd, pd), (kdd, pdd) = self.k, self.p, (xid[:3], xid[3:]), (xidd[:3], xidd[3:])
        y, yd = 2 * ca.dot(k, kd), 2 * (ca.dot(kd, kd) + ca.dot(k, kdd))
        u, ud, udd = self.u, _fan_rate(k, kd, p, pd), _fan_second(k, kd, kdd, p, pd, pdd)
        t, td = _fan(k, kd), _fan_rate(k, kd, kd, kdd)
        W = ca.skew(base.w)
        sweep = ud + W @ u
        self.base = base
        self._velocity = sweep, y * u
        self._acceleration = (
            udd + 2 * (W @ ud) + (ca.skew(base.dw) + W @ W) @ u, 2 * y * sweep + yd * u, y**2 * u
        )  # fmt: skip
        self._spin, self._spin_rate = t, (td + W @ t, y * t)

    def motion(self, at):
        """Motion at s, in the axes of the base."""
        rate, slope = self._spin_rate
        accelerations = self._acceleration
        return Motion(
            w=self.base.w + self._spin @ at.phi,
            v=self.base.v + self._velocity[0] @ at.phi + self._velocity[1] @ at.slope,
            dw=self.base.dw + rate @ at.phi + slope @ at.slope,
            a=self.base.a + accelerations[0] @ at.phi + accelerations[1] @ at.slope + accelerations[2] @ at.bend,
        )


class Collected:
    """Wrenches on an arc: their sum about the base's origin, and their work on the rate of xi."""

    def __init__(self, arc):
        self.arc, self.force, self.moment = arc, ca.DM(3, 1), ca.DM(3, 1)
        self._forces, self._slopes, self._moments = ca.DM(3, 3), ca.DM(3, 3), ca.DM(3, 3)

    def add(self, at, moment, force):
        """A moment [3] and a force [3], axes of the base, at the place `at` belongs to."""
        self.force += force
        self.moment += moment + ca.cross(self.arc.position(at), force)
        self._forces += force @ at.phi.T
        self._slopes += force @ at.slope.T
        self._moments += moment @ at.phi.T

    def wrench(self):
        """[moment; force] [6] about the base's origin."""
        return ca.vertcat(self.moment, self.force)

    def work(self):
        """Q [6] with Q . xid = power of the wrenches when only xi changes."""
        k, p, F, M = self.arc.k, self.arc.p, self._forces, self._moments
        by_p = F[:, 0] - ca.cross(k, F[:, 1]) + k * ca.dot(k, F[:, 2])
        by_k = M[:, 0] - ca.cross(k, M[:, 1]) + k * ca.dot(k, M[:, 2])
        by_k += ca.cross(p, F[:, 1]) + F[:, 2] * ca.dot(k, p) + p * ca.dot(k, F[:, 2])
        by_x = ca.dot(self.arc.u, self._slopes)
        return ca.vertcat(by_k + 2 * k * by_x, by_p)
