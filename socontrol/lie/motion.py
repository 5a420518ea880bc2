"""An arc exp(s xi) whose twist xi(t) changes while its base moves: what every place on it does, and what it feels.

With xi = [k; p], K = skew(k), x = k.k and phi_n(s) = s^n c_n(s^2 x) (Stumpff functions c_n) the arc has
    A(s) = s I + phi_2 K + phi_3 K^2,     r(s) = A p,     rotation rate A kd,     R(s) = I + A K
so position, velocity and acceleration of a place are sums of few vectors, the same for the whole arc, with weights
that depend on the place: s, phi_2, phi_3 and their derivatives in x. Forces are collected with the same weights and
projected once (and masses with products of two weights). This makes a quadrature node cost a few weighted sums, not
products of 6 x 6 matrices.
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
    return Motion(*(ca.DM.zeros(3, 1) for _ in range(4)))


def from_stack(column):
    """Motion of its stacked components [12]."""
    return Motion(*ca.vertsplit(column, 3))  # what `stacked` undoes without a trace


@lru_cache(maxsize=4096)
def terms_up_to(fraction):
    """Terms that the series of c_6 and c_7 need for angles up to `fraction` of the range; c_0 = ... - x^3 c_6."""
    largest = (fraction * 2 * pi) ** 2
    return next(n for n in range(3, 40) if largest ** (n + 3) / factorial(2 * n + 6) < ROUNDING)


class Weights:
    """At s, a `fraction` of the arc of curvature vector k: phi = (s, phi_2, phi_3), slope and bend [2 each] the first
    and second derivatives of phi_2 and phi_3 in x, turn = phi_1."""

    def __init__(self, k, s, fraction):
        x = ca.dot(k, k)
        c = stumpff.series(s**2 * x, terms_up_to(fraction), top=7)
        slope = stumpff.slopes(c)
        bend = stumpff.slopes(slope)
        self.turn = s * c[1]
        self.phi = ca.vertcat(s, s**2 * c[2], s**3 * c[3])
        self.slope = ca.vertcat(*(s ** (n + 2) * slope[n] for n in (2, 3)))
        self.bend = ca.vertcat(*(s ** (n + 4) * bend[n] for n in (2, 3)))


def _fan(k, p):
    """[p, k x p, k x (k x p)] as columns [3 x 3]."""
    once = ca.cross(k, p)
    return ca.horzcat(p, once, ca.cross(k, once))


def _fan_rate(k, kd, p, pd):
    once = ca.cross(kd, p) + ca.cross(k, pd)
    return ca.horzcat(pd, once, ca.cross(kd, ca.cross(k, p)) + ca.cross(k, once))


def _fan_second(k, kd, kdd, p, pd, pdd):
    once, rate = ca.cross(k, p), ca.cross(kd, p) + ca.cross(k, pd)
    second = ca.cross(kdd, p) + 2 * ca.cross(kd, pd) + ca.cross(k, pdd)
    return ca.horzcat(pdd, second, ca.cross(kdd, once) + 2 * ca.cross(kd, rate) + ca.cross(k, second))


class Arc:
    """Geometry of exp(s xi): position, rotation and the maps from the rate of xi to motion, at any s."""

    def __init__(self, xi):
        self.k, self.p = xi[:3], xi[3:]
        self.u = _fan(self.k, self.p)
        self._outer = so3.outer(self.k)
        self.x = ca.sum1(self._outer[0])
        self.Q = self.k @ self.p.T - 2 * self.p @ self.k.T + ca.dot(self.k, self.p) * ca.DM.eye(3)

    def weights(self, s, fraction):
        return Weights(self.k, s, fraction)

    def position(self, at):
        """r [3]."""
        return self.u @ at.phi

    def rotation(self, at):
        """R [3 x 3]."""
        diagonal, off = self._outer
        return so3.assemble(1 + at.phi[1] * (diagonal - self.x), at.phi[1] * off, at.turn * self.k)

    def pose(self, at):
        return se3.pose(self.rotation(at), self.position(at))

    def A(self, phi):
        """phi[0] I + phi[1] K + phi[2] K^2 [3 x 3], of the weights `phi` of a place or of their sums."""
        diagonal, off = self._outer
        return so3.assemble(phi[0] + phi[2] * (diagonal - self.x), phi[2] * off, phi[1] * self.k)

    def back(self, *sums):
        """sum of A^T f [3 x n] from the sums of s f, phi_2 f and phi_3 f [3 x n each] over places."""
        K = ca.skew(self.k)
        return sums[0] - K @ (sums[1] - K @ sums[2])

    def squares(self, P):
        """sum of A^T A = A A^T [3 x 3] from the sums P [3 x 3] of the products of s, phi_2 and phi_3 over places."""
        return self.A((P[0, 0], 0, 2 * P[2, 0] - P[1, 1] - self.x * P[2, 2]))

    def reach(self, phi, slope):
        """dr/dk [3 x 3], of the weights of a place or of their sums; dr/dp is `A`."""
        bent = self.u[:, 1:] @ slope
        return phi[2] * self.Q - phi[1] * ca.skew(self.p) + bent @ (2 * self.k).T

    def tangent(self, at):
        """T [6 x 6]: the twist about the base's origin that the rate of xi gives at s, s tangent(s xi)."""
        A = self.A(at.phi)
        turned = self.reach(at.phi, at.slope) + ca.skew(self.position(at)) @ A
        return ca.blockcat([[A, ca.DM(3, 3)], [turned, A]])


class MovingArc(Arc):
    """An arc with the rates of its twist, on a base with a `Motion`."""

    def __init__(self, xi, xid, xidd, base):
        super().__init__(xi)
        k, p, (kd, pd), (kdd, pdd) = self.k, self.p, (xid[:3], xid[3:]), (xidd[:3], xidd[3:])
        y, yd = 2 * ca.dot(k, kd), 2 * (ca.dot(kd, kd) + ca.dot(k, kdd))
        u, ud, udd = self.u, _fan_rate(k, kd, p, pd), _fan_second(k, kd, kdd, p, pd, pdd)
        t, td = _fan(k, kd), _fan_rate(k, kd, kd, kdd)
        W = ca.skew(base.w)
        sweep, bent = ud + W @ u, u[:, 1:]
        self.base = base
        self._velocity = sweep, y * bent
        self._acceleration = (
            udd + 2 * (W @ ud) + (ca.skew(base.dw) + W @ W) @ u, 2 * y * sweep[:, 1:] + yd * bent, y**2 * bent
        )  # fmt: skip
        self._spin, self._spin_rate = t, (td + W @ t, y * t[:, 1:])

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
        self._forces, self._slopes, self._moments = ca.DM(3, 3), ca.DM(3, 2), ca.DM(3, 3)

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
        arc, F = self.arc, self._forces
        by_x = ca.dot(arc.u[:, 1:], self._slopes)
        by_k = arc.back(*ca.horzsplit(self._moments)) + ca.cross(arc.p, F[:, 1]) + arc.Q.T @ F[:, 2]
        return ca.vertcat(by_k + 2 * arc.k * by_x, arc.back(*ca.horzsplit(F)))
