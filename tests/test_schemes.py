"""Collocation schemes and planned motions: their polynomials, the order they converge with, one motion throughout."""

from functools import cache
from math import factorial

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import spsolve

from socontrol.programs.plans.planned import Planned
from socontrol.programs.plans.schemes import scheme, slopes, through
from socontrol.programs.plans.transcription import Span, System, Transcription

KINDS = [*(("radau", s) for s in (1, 2, 3, 4, 5)), *(("lobatto", s) for s in (2, 3, 4, 5))]
INSIDE = np.array([0.0, 0.07, 0.31, 0.5, 0.83, 1.0])


# The polynomials of one interval


@pytest.mark.parametrize(("name", "points"), KINDS)
def test_a_quadrature_is_exact_to_the_degree_of_its_nodes_and_no_further(name, points):
    """Radau integrates degree 2s - 2 exactly, Lobatto 2s - 3: one less than the order; the next degree not."""
    rule = scheme(name, points)
    misses = [rule.weights @ rule.c**k - 1 / (k + 1) for k in range(rule.order + 1)]
    assert np.max(np.abs(misses[:-1])) < 1e-14
    assert abs(misses[-1]) > 1e-8
    assert rule.c[-1] == 1.0
    assert rule.shared == (rule.c[0] == 0.0) == (name == "lobatto")


@pytest.mark.parametrize(("name", "points", "A"), [
    ("radau", 1, [[1]]),
    ("radau", 2, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]]),
    ("trapezoidal", 3, [[0, 0], [1 / 2, 1 / 2]]),
    ("hermite_simpson", 3, [[0, 0, 0], [5 / 24, 1 / 3, -1 / 24], [1 / 6, 2 / 3, 1 / 6]]),
])  # fmt: skip
def test_rates_at_the_points_are_the_butcher_tables_of_the_books(name, points, A):
    """E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, tables 5.5 and 5.7."""
    rule = scheme(name, points)
    np.testing.assert_allclose(rule.rates(rule.c), A, atol=1e-15)


@pytest.mark.parametrize(("name", "points"), KINDS)
def test_rows_reproduce_polynomials_their_integrals_and_slopes(name, points):
    rule = scheme(name, points)
    a = Polynomial(np.random.default_rng(points).normal(size=points))
    first, second = a.integ(), a.integ(2)  # both 0 at 0
    for rows, exact in ((rule.values, a), (rule.rates, first), (rule.positions, second)):
        np.testing.assert_allclose(rows(INSIDE) @ a(rule.c), exact(INSIDE), atol=1e-12)


@pytest.mark.parametrize("inputs", ["points", "linear", "constant"])
@pytest.mark.parametrize("continuous", [False, True])
@pytest.mark.parametrize(("name", "points"), KINDS)
def test_inputs_are_the_polynomials_through_their_knots(name, points, continuous, inputs):
    knots = scheme(name, points).knots(inputs, continuous)
    assert knots[-1] == 1.0
    assert knots.size == {"linear": 2, "constant": 1, "points": points + (continuous and name == "radau")}[inputs]
    u = Polynomial(np.random.default_rng(points).normal(size=knots.size))
    np.testing.assert_allclose(through(knots, INSIDE) @ u(knots), u(INSIDE), atol=1e-11)
    np.testing.assert_allclose(slopes(knots, INSIDE) @ u(knots), u.deriv()(INSIDE), atol=1e-10)


# Orders of convergence: two coupled, driven and damped pendulums, the inputs given

END = 2.0  # s
FIRST = np.array([0.5, -0.3]), np.array([0.2, 0.4])
QUARTERS = np.linspace(0.0, END, 5)


def pushes(t):
    """Inputs [K x 2] at times."""
    t = np.asarray(t)
    return np.column_stack([np.cos(2 * t), 0.5 * np.sin(3 * t)])


def mass_and_force(q, v, u, functions):
    """Entries (2, c, 1) of the mass matrix and the two forces, in numpy or CasADi."""
    sin, cos = functions.sin, functions.cos
    c = 0.6 * cos(q[1] - q[0])
    one = u[0] - 9.81 * sin(q[0]) - 0.4 * v[0] ** 3 + sin(q[1] - q[0]) * v[1] ** 2
    return c, one, u[1] - 9.81 * sin(q[1]) - 0.3 * v[1]


def residual(q, v, a, u):
    c, one, two = mass_and_force(q, v, u, ca)
    return ca.vertcat(2 * a[0] + c * a[1] - one, c * a[0] + a[1] - two)


def slope(t, y):
    c, one, two = mass_and_force(y[:2], y[2:], pushes([t])[0], np)
    return np.concatenate([y[2:], np.linalg.solve([[2, c], [c, 1]], [one, two])])


@cache
def exact(times):
    """q, v at times by an explicit method of order 8 that stops at each of them."""
    rows, t, y = [], 0.0, np.concatenate(FIRST)
    for stop in times:
        if stop > t:
            y = solve_ivp(slope, (t, stop), y, method="DOP853", rtol=2.3e-14, atol=1e-15).y[:, -1]
            t = stop
        rows.append(y)
    return np.array(rows)


def driven(name, points, intervals, continuous=False):
    """The motion that meets equation and defects, by Newton's method: as many of them as unknowns."""
    ones = np.ones(2)
    t = Transcription(System(residual, ones, ones, ones), scheme(name, points), np.full(intervals, 1 / intervals),
                      Span.fixed(END), continuous=continuous)  # fmt: skip
    rows = [lambda x, row=row: np.tile(row, (np.size(x), 1)) for row in (*FIRST, np.zeros(2))]
    x = t.filled(*rows, lambda x: pushes(END * np.asarray(x)), END)
    t.hold("q", t.node["q"][0], FIRST[0], FIRST[0])
    t.hold("v", t.node["v"][0], FIRST[1], FIRST[1])
    for places in (t.point["u"], *([t.node["u"]] if "u" in t.node else [])):
        t.hold("u", places, x[places], x[places])
    lower, upper = t.program.bounds()
    free, jacobian = np.flatnonzero(lower < upper), t.program.functions()["jac_g"]
    z = np.clip(t.program.stack(x), lower, upper)
    for _ in range(50):
        g, J = jacobian(z, [])
        step = spsolve(J.sparse().tocsc()[:, free], -np.array(g).ravel())
        z[free] += step
        if np.max(np.abs(step)) < 1e-13:
            return t.planned(t.program.split(z))
    raise AssertionError("no motion")


def errors(name, points, intervals, times, continuous=False):
    q, v, *_ = driven(name, points, intervals, continuous).at(times)
    y = exact(tuple(times))
    return np.max(np.abs(q - y[:, :2])), np.max(np.abs(v - y[:, 2:]))


ORDERS = [  # scheme, points, meshes, order of q and v at the nodes
    ("radau", 1, (128, 256, 512), 1),
    ("radau", 2, (32, 64, 128), 3),
    ("radau", 3, (16, 32, 64), 5),
    ("radau", 4, (16, 32), 7),
    ("lobatto", 2, (64, 128), 2),
    ("lobatto", 3, (16, 32, 64), 4),
    ("lobatto", 4, (16, 32, 64), 6),
    ("trapezoidal", 3, (64, 128), 2),
    ("hermite_simpson", 3, (16, 32, 64), 4),
]


@pytest.mark.parametrize(("name", "points", "meshes", "order"), ORDERS)
def test_nodes_converge_with_the_order_of_the_scheme(name, points, meshes, order):
    """q and v alike: also with one Radau point, where a step of q is a power better than one of v, whose error it takes
    over."""
    found = np.log([errors(name, points, n, QUARTERS) for n in meshes])
    fitted = -np.polyfit(np.log(meshes), found, 1)[0]
    assert scheme(name, points).order == order
    np.testing.assert_allclose(fitted, order, atol=0.12 + 0.03 * order)


@pytest.mark.parametrize(("name", "points", "meshes"), [("radau", 4, (16, 32, 64)), ("lobatto", 4, (16, 32, 64))])
def test_between_the_points_rates_are_of_order_s_plus_1_and_coordinates_of_one_more(name, points, meshes):
    """A first-order scheme on (q, v) gives both a polynomial of degree s, so s + 1 for either; here q has one more."""
    found = np.log([errors(name, points, n, (np.arange(n) + 0.3) * END / n) for n in meshes])
    fitted = -np.polyfit(np.log(meshes), found, 1)[0]
    np.testing.assert_allclose(fitted, [points + 2, points + 1], atol=0.4)


@pytest.mark.parametrize("points", [1, 3])
def test_continuous_inputs_that_are_given_lead_to_the_same_motion(points):
    """The equation of motion sees them at the points only."""
    plain, continuous = (driven("radau", points, 8, c) for c in (False, True))
    np.testing.assert_allclose(continuous.q, plain.q, atol=1e-12)
    assert continuous.u.shape[1] == plain.u.shape[1] + 1
    np.testing.assert_allclose(continuous.u[:, 0], pushes(continuous.nodes[:-1]), atol=1e-12)


# A planned motion is one motion

PLANS = [  # scheme, points, inputs, continuous
    *((*kind, "points", False) for kind in KINDS if kind[0] == "radau"), *((*kind, "points", True) for kind in KINDS),
    ("radau", 3, "linear", True), ("radau", 3, "linear", False), ("radau", 3, "constant", False),
    ("lobatto", 4, "linear", True),
]  # fmt: skip


@cache
def planned(name, points, inputs, continuous):
    """A motion of three uneven intervals with random accelerations and inputs, and nodes that follow from them."""
    rng, rule, shares = np.random.default_rng(points), scheme(name, points), np.array([0.2, 0.5, 0.3])
    h, knots = 1.7 * shares, rule.knots(inputs, continuous)
    a, u = rng.normal(size=(3, points, 2)), rng.normal(size=(3, knots.size, 2))
    if continuous:
        u[1:, 0] = u[:-1, -1]
    q, v = [rng.normal(size=2)], [rng.normal(size=2)]
    for k in range(3):
        curves = [Polynomial(np.polyfit(rule.c, a[k, :, i], points - 1)[::-1]) for i in range(2)]
        q.append(q[-1] + h[k] * v[-1] + h[k] ** 2 * np.array([curve.integ(2)(1.0) for curve in curves]))
        v.append(v[-1] + h[k] * np.array([curve.integ()(1.0) for curve in curves]))
    return Planned(rule, 1.7, shares, np.array(q), np.array(v), a, u, knots)


def derivative(function, t, step):
    """Five-point differences, exact for polynomials up to degree 4 and good to step^4 beyond."""
    weights = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
    return sum(weight * function(t + k * step) for k, weight in weights.items()) / step


@pytest.mark.parametrize(("name", "points", "inputs", "continuous"), PLANS)
def test_the_rates_of_a_plan_are_derivatives_of_what_they_are_rates_of(name, points, inputs, continuous):
    plan, t = planned(name, points, inputs, continuous), np.array([0.11, 0.3, 0.62, 0.9, 1.05, 1.3, 1.6])
    for of, rate in ((0, 1), (1, 2), (3, 4)):
        moved = derivative(lambda t, of=of: plan.at(t)[of], t, 1e-3)
        np.testing.assert_allclose(plan.at(t)[rate], moved, atol=1e-7 * factorial(points))


@pytest.mark.parametrize(("name", "points", "inputs", "continuous"), PLANS)
def test_coordinates_rates_and_continuous_inputs_do_not_jump_at_nodes(name, points, inputs, continuous):
    plan = planned(name, points, inputs, continuous)
    inner, tiny = plan.nodes[1:-1], 1e-12
    before, after = plan.at(inner), plan.at(inner + tiny)
    for k in (0, 1, *((3,) if continuous else ())):
        np.testing.assert_allclose(before[k], after[k], atol=1e-9)
    np.testing.assert_allclose(plan.at(plan.nodes)[0], plan.q, atol=1e-13)
    np.testing.assert_allclose(plan.at(plan.nodes)[1], plan.v, atol=1e-13)
    np.testing.assert_allclose(plan.nodes, 1.7 * np.array([0, 0.2, 0.7, 1.0]), atol=1e-15)


@pytest.mark.parametrize(("name", "points", "inputs", "continuous"), PLANS)
def test_the_points_of_a_plan_have_the_accelerations_and_inputs_it_was_made_of(name, points, inputs, continuous):
    plan = planned(name, points, inputs, continuous)
    every = np.arange(3)
    a = plan.inside(np.repeat(every, points), np.tile(plan.scheme.c, 3))[2]
    u = plan.inside(np.repeat(every, plan.knots.size), np.tile(plan.knots, 3))[3]
    np.testing.assert_allclose(a, plan.a.reshape(-1, 2), atol=1e-12)
    np.testing.assert_allclose(u, plan.u.reshape(-1, 2), atol=1e-12)
    times = [start + length * c for start, length in zip(plan.nodes, np.diff(plan.nodes), strict=False)
             for c in plan.scheme.c]  # fmt: skip
    np.testing.assert_allclose(plan.points, times, atol=1e-14)
