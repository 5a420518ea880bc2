"""SO(3) and SE(3) against identities, matrix exponentials, quadrature and seventy-digit numbers."""

import json
from fractions import Fraction
from functools import cache
from math import factorial, inf, isinf, pi
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from socontrol.lie import se3, so3, stumpff
from socontrol.lie.screws import screw, screw_system

ORACLE = json.loads((Path(__file__).parent / "reference" / "lie_se3.json").read_text())
CASES = ORACLE["cases"]
CASE_NAMES = [case["label"] for case in CASES]

NUMBERS = {"DM": ca.DM, "SX": ca.SX, "MX": ca.MX}
SYMBOLS = {"SX": ca.SX, "MX": ca.MX}
COEFFICIENTS = {"series": stumpff.series, "switched": stumpff.switched}

LOG_SWITCH = 2 * np.arctan(np.sqrt(so3.NEAR))
SMALL = [0.0, 1e-12, 1e-8, 1e-6, 1e-4, 1e-2, 0.3]
SWITCH_SIDES = [np.sqrt(stumpff.SWITCH) - 1e-9, np.sqrt(stumpff.SWITCH) + 1e-9]
UP_TO_PI = [*SMALL, LOG_SWITCH - 1e-9, LOG_SWITCH + 1e-9, 1.0, 2.0, 2.2, 3.0]
UP_TO_RANGE = [*SMALL, 1.0, 3.0, *SWITCH_SIDES, 5.0, 2 * pi - 1e-6, 2 * pi]
ANY_ANGLE = [*UP_TO_RANGE, 7.0, 10.0]

HALF_TURN_AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 1, 1), (-3, 1, 2), (0, 1e-9, 1)]

fast = settings(max_examples=30, deadline=None, derandomize=True)
unit_box = st.floats(-1, 1, allow_subnormal=False)
vectors = st.tuples(unit_box, unit_box, unit_box).map(np.array)
twists = st.tuples(*[unit_box] * 6).map(lambda x: 2 * np.array(x))
poses = twists.map(lambda x: placed(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]))


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def hat(xi):
    return np.block([[skew(xi[:3]), np.reshape(xi[3:], (3, 1))], [np.zeros((1, 4))]])


def placed(R, r):
    return np.block([[R, np.reshape(r, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def ad(xi):
    return np.block([[skew(xi[:3]), np.zeros((3, 3))], [skew(xi[3:]), skew(xi[:3])]])


def array(x):
    return np.array(ca.DM(x))


def twist(angle, seed=0):
    """A twist of the given rotation angle in a random direction."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=3)
    return np.concatenate([angle * w / np.linalg.norm(w), rng.uniform(-1, 1, 3)])


def gap(a, b):
    """Largest difference relative to max(1, largest entry of b)."""
    a, b = array(a), np.reshape(b, array(a).shape)
    return np.abs(a - b).max() / max(1.0, np.abs(b).max())


def evaluate(function, x, number):
    """function at x, as number type DM, SX or MX."""
    if number == "DM":
        return array(function(ca.DM(x)))
    symbol = NUMBERS[number].sym("x", np.size(x))
    return array(ca.Function("f", [symbol], [function(symbol)])(x))


def slopes(function, x, a, b, number):
    """First derivative along a, along b, and the mixed second derivative of function at x, by casadi."""
    kind = SYMBOLS[number]
    s, t = kind.sym("s"), kind.sym("t")
    value = function(x + s * ca.DM(a) + t * ca.DM(b))
    along_a = ca.jacobian(ca.vec(value), s)
    along_b = ca.jacobian(ca.vec(value), t)
    results = [ca.reshape(d, value.shape) for d in (along_a, along_b, ca.jacobian(along_a, t))]
    return [array(d) for d in ca.Function("f", [s, t], results)(0, 0)]


def expm_slopes(X, E, F):
    """e^X and its derivatives along E, F and both: one exponential over numbers with e^2 = f^2 = 0."""
    n, Z = len(X), np.zeros_like(X)
    big = expm(np.block([[X, E, F, Z], [Z, X, Z, F], [Z, Z, X, E], [Z, Z, Z, X]]))
    return [big[:n, k * n : (k + 1) * n] for k in range(4)]


def tangent_block(xi, corner):
    """[ad corner; 0 0] [12 x 12]: with corner = I, int_0^1 exp(s ad) ds is the upper right block of exp."""
    return np.block([[ad(xi), corner], [np.zeros((6, 12))]])


# Stumpff functions


@cache
def exact_stumpff(k, x, order=0, terms=45):
    """order-th derivative of c_k at the double x, summed in rational arithmetic."""
    x, total = Fraction(x), Fraction(0)
    for i in range(order, terms):
        power = i - order
        total += Fraction((-1) ** i * factorial(i), factorial(power) * factorial(2 * i + k)) * x**power
    return float(total)


@pytest.mark.parametrize("name", COEFFICIENTS)
@pytest.mark.parametrize("number", NUMBERS)
def test_stumpff_functions_equal_their_rational_sums(name, number):
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        values = evaluate(lambda x: ca.vertcat(*COEFFICIENTS[name](x)), t * t, number).ravel()
        exact = [exact_stumpff(k, t * t) for k in range(6)]
        np.testing.assert_allclose(values, exact, rtol=0, atol=1e-13, err_msg=f"t = {t}")


@pytest.mark.parametrize("name", COEFFICIENTS)
@pytest.mark.parametrize("number", SYMBOLS)
def test_stumpff_slopes_and_curvatures_are_exact_at_zero_and_beside_the_switch(name, number):
    x = SYMBOLS[number].sym("x")
    value = ca.vertcat(*COEFFICIENTS[name](x))
    slope = ca.jacobian(value, x)
    both = ca.Function("f", [x], [slope, ca.jacobian(slope, x)])
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        for order, got in zip((1, 2), both(t * t), strict=True):
            exact = [exact_stumpff(k, t * t, order) for k in range(6)]
            np.testing.assert_allclose(array(got).ravel(), exact, rtol=0, atol=1e-13, err_msg=f"t = {t}")


def test_stumpff_slope_is_a_combination_of_the_next_two():
    x = ca.SX.sym("x")
    c = stumpff.series(x)
    claim = ca.vertcat(*[ca.jacobian(c[k], x) + (c[k + 1] - k * c[k + 2]) / 2 for k in range(4)])
    residual = ca.Function("f", [x], [claim])
    assert all(gap(residual(t * t), np.zeros(4)) < 1e-13 for t in UP_TO_RANGE)


def test_switched_stumpff_functions_stay_finite_at_huge_arguments():
    x = ca.SX.sym("x")
    c = ca.vertcat(*stumpff.switched(x))
    slope = ca.jacobian(c, x)
    values = ca.Function("f", [x], [c, slope, ca.jacobian(slope, x)])(1e30)
    assert all(np.isfinite(array(v)).all() for v in values)


# Adjoints


@fast
@given(poses, twists)
def test_Ad_is_conjugation_and_coAd_its_inverse_transpose(g, xi):
    conjugated = array(se3.vee(ca.DM(g @ hat(xi) @ np.linalg.inv(g)))).ravel()
    g = ca.DM(g)
    assert gap(se3.Ad(g) @ xi, conjugated) < 1e-14
    assert gap(se3.Ad_inv(g) @ se3.Ad(g), np.eye(6)) < 1e-14
    assert gap(se3.Ad_inv(g), array(se3.Ad(se3.inverse(g)))) < 1e-14
    assert gap(se3.coAd(g), np.linalg.inv(array(se3.Ad(g))).T) < 1e-14
    assert gap(se3.coAd(g), array(se3.Ad_inv(g)).T) < 1e-14


@fast
@given(twists, twists)
def test_ad_is_the_bracket_and_coad_its_negative_transpose(a, b):
    bracket = hat(a) @ hat(b) - hat(b) @ hat(a)
    assert gap(se3.hat(se3.ad(ca.DM(a)) @ b), bracket) < 1e-15
    assert gap(se3.coad(ca.DM(a)), -array(se3.ad(ca.DM(a))).T) == 0
    assert gap(se3.vee(se3.hat(ca.DM(a))), a) == 0
    assert gap(se3.hat(ca.DM(a)), hat(a)) == 0


@fast
@given(twists, twists, st.floats(0.1, 5), vectors)
def test_M_eta_dot_plus_coad_M_eta_is_newton_euler(eta, eta_dot, m, corner):
    J = np.eye(3) + np.outer(corner, corner)
    M = np.block([[J, np.zeros((3, 3))], [np.zeros((3, 3)), m * np.eye(3)]])
    (w, v), (w_dot, v_dot) = np.split(eta, 2), np.split(eta_dot, 2)
    newton_euler = np.concatenate([J @ w_dot + np.cross(w, J @ w), m * (v_dot + np.cross(w, v))])
    assert gap(M @ eta_dot + se3.coad(ca.DM(eta)) @ (M @ eta), newton_euler) < 1e-14


@fast
@given(poses, poses, vectors)
def test_poses_compose_invert_and_carry_points(g_wb, g_bc, x):
    a, b = ca.DM(g_wb), ca.DM(g_bc)
    assert gap(se3.inverse(a) @ a, np.eye(4)) < 1e-14
    assert gap(se3.pose(se3.rotation(a), se3.position(a)), g_wb) == 0
    assert gap(se3.transform(a @ b, ca.DM(x)), (g_wb @ g_bc @ np.append(x, 1))[:3]) < 1e-14
    assert gap(se3.Ad(a @ b), array(se3.Ad(a) @ se3.Ad(b))) < 1e-14


# Exponential and tangent map


@pytest.mark.parametrize("case", CASES, ids=CASE_NAMES)
def test_exp_and_tangent_agree_with_seventy_digit_values(case):
    xi, X, tolerance = np.array(case["xi"]), case["X"], ORACLE["tolerance"]
    g, T = se3.exp_and_tangent(ca.DM(X * xi), stumpff.switched)
    body = X * se3.tangent(ca.DM(-X * xi), stumpff.switched)
    assert gap(g, case["g"]) < tolerance["g"]
    assert gap(X * T, case["T"]) < tolerance["T"]
    assert gap(body, case["AdInv_T"]) < tolerance["AdInv_T"]
    assert gap(body @ case["xi_dot"], case["body_twist_of_xi_dot"]) < tolerance["AdInv_T"]
    assert gap(se3.Ad(g), case["Ad_g"]) < tolerance["g"]
    assert gap(se3.Ad_inv(g), case["Ad_g_inv"]) < tolerance["g"]
    assert gap(se3.ad(ca.DM(xi)), case["ad_xi"]) == 0
    if float(case["theta_times_X"]) <= stumpff.RANGE:
        g, T = se3.exp_and_tangent(ca.DM(X * xi))
        assert gap(g, case["g"]) < tolerance["g"]
        assert gap(X * T, case["T"]) < tolerance["T"]


@pytest.mark.parametrize("number", SYMBOLS)
def test_rate_of_the_tangent_map_agrees_with_seventy_digit_values(number):
    symbol, rate, X = (SYMBOLS[number].sym(*name) for name in (("xi", 6), ("xi_dot", 6), ("X",)))
    T = X * se3.tangent(X * symbol, stumpff.switched)
    T_dot = ca.Function("f", [symbol, rate, X], [ca.jtimes(ca.vec(T), symbol, rate)])
    for case in CASES:
        got = ca.reshape(T_dot(case["xi"], case["xi_dot"], case["X"]), 6, 6)
        assert gap(got, case["Tdot"]) < ORACLE["tolerance"]["Tdot"], case["label"]


@pytest.mark.parametrize("case", [c for c in CASES if "T_inverse" in c], ids=lambda c: c["label"])
def test_tangent_inverse_and_log_agree_with_seventy_digit_values(case):
    got = se3.tangent_inverse(ca.DM(case["X"] * np.array(case["xi"]))) / case["X"]
    assert gap(got, case["T_inverse"]) < ORACLE["tolerance"]["T_inverse"]
    assert gap(se3.log(ca.DM(case["g"])), case["log_g"]) < 1e-9


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("name", COEFFICIENTS)
def test_exp_is_the_matrix_exponential(name, number):
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        x = twist(t)
        assert gap(evaluate(lambda x: se3.exp(x, COEFFICIENTS[name]), x, number), expm(hat(x))) < 2e-13
        R = evaluate(lambda w: so3.exp(w, COEFFICIENTS[name]), x[:3], number)
        assert gap(R, Rotation.from_rotvec(x[:3]).as_matrix()) < 2e-13


@cache
def integral_of_the_adjoint(angle):
    """int_0^1 exp(s ad) ds of twist(angle), by Gauss-Legendre quadrature of order 40."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    return sum(w / 2 * expm((s + 1) / 2 * ad(twist(angle))) for s, w in zip(nodes, weights, strict=True))


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("name", COEFFICIENTS)
def test_tangent_is_the_integral_of_the_adjoint(name, number):
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        got = evaluate(lambda x: se3.tangent(x, COEFFICIENTS[name]), twist(t), number)
        assert gap(got, integral_of_the_adjoint(t)) < 2e-13


@pytest.mark.parametrize("angle", [0.5, 1.0, 2.0, 3.0, 5.0, 6.0])
def test_tangent_equals_the_published_closed_form(angle):
    x = twist(angle)
    a, t, c, s = ad(x), angle, np.cos(angle), np.sin(angle)
    T = np.eye(6) + (4 - 4 * c - t * s) / (2 * t**2) * a + (4 * t - 5 * s + t * c) / (2 * t**3) * a @ a
    T += (2 - 2 * c - t * s) / (2 * t**4) * a @ a @ a + (2 * t - 3 * s + t * c) / (2 * t**5) * a @ a @ a @ a
    assert gap(se3.tangent(ca.DM(x)), T) < 1e-13


@fast
@given(twists)
def test_lower_block_of_the_tangent_is_barfoots_polynomial(x):
    W, V = skew(x[:3]), skew(x[3:])
    c2, c3, c4, c5 = (exact_stumpff(k, float(x[:3] @ x[:3])) for k in range(2, 6))
    Q = V / 2 + c3 * (W @ V + V @ W + W @ V @ W) + c4 * (W @ W @ V + V @ W @ W - 3 * W @ V @ W)
    Q += (c4 - 3 * c5) / 2 * (W @ V @ W @ W + W @ W @ V @ W)
    A = np.eye(3) + c2 * W + c3 * W @ W
    assert gap(se3.tangent(ca.DM(x)), np.block([[A, np.zeros((3, 3))], [Q, A]])) < 1e-14


@pytest.mark.parametrize("number", SYMBOLS)
@pytest.mark.parametrize("name", COEFFICIENTS)
def test_first_and_second_derivatives_of_exp_are_right_at_and_around_zero(name, number):
    a, b = twist(0.8, seed=1), twist(1.1, seed=2)
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        x = twist(t)
        got = slopes(lambda x: se3.exp(x, COEFFICIENTS[name]), x, a, b, number)
        for ours, exact in zip(got, expm_slopes(hat(x), hat(a), hat(b))[1:], strict=True):
            assert gap(ours, exact) < 1e-12, f"angle {t}"


@pytest.mark.parametrize("number", SYMBOLS)
@pytest.mark.parametrize("name", COEFFICIENTS)
def test_first_and_second_derivatives_of_tangent_are_right_at_and_around_zero(name, number):
    a, b = twist(0.8, seed=1), twist(1.1, seed=2)
    one, zero = np.eye(6), np.zeros((6, 6))
    for t in UP_TO_RANGE if name == "series" else ANY_ANGLE:
        x = twist(t)
        got = slopes(lambda x: se3.tangent(x, COEFFICIENTS[name]), x, a, b, number)
        exact = expm_slopes(tangent_block(x, one), tangent_block(a, zero), tangent_block(b, zero))
        for ours, block in zip(got, exact[1:], strict=True):
            assert gap(ours, block[:6, 6:]) < 1e-12, f"angle {t}"


def test_slope_of_the_rotation_agrees_with_finite_differences():
    h, a = 1e-3, twist(1.0, seed=3)
    for t in [0.0, 1e-8, 1e-4, 1.0, *SWITCH_SIDES, 9.0]:
        x = twist(t)
        stencil = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
        by_four = sum(weight * expm(hat(x + k * h * a)) for k, weight in stencil.items())
        got, *_ = slopes(lambda w: so3.exp(w), x[:3], a[:3], a[:3], "SX")
        assert gap(got, by_four[:3, :3] / h) < 1e-10


@pytest.mark.parametrize("angle", UP_TO_RANGE)
def test_tangent_of_minus_Omega_gives_the_body_twist_of_the_moving_pose(angle):
    x, x_dot = twist(angle), twist(1.0, seed=4)
    g_dot = expm_slopes(hat(x), hat(x_dot), hat(x_dot))[1]
    body = array(se3.vee(ca.DM(expm(-hat(x)) @ g_dot))).ravel()
    assert gap(se3.tangent(ca.DM(-x)) @ x_dot, body) < 2e-13
    assert gap(se3.Ad_inv(se3.exp(ca.DM(x))) @ se3.tangent(ca.DM(x)) @ x_dot, body) < 2e-13


@pytest.mark.parametrize("angle", [*UP_TO_PI, 5.0, 6.0])
def test_tangent_inverse_is_the_inverse(angle):
    x = ca.DM(twist(angle))
    assert gap(se3.tangent_inverse(x), np.linalg.inv(array(se3.tangent(x)))) < 1e-11


def test_structurally_empty_twists_are_served():
    assert gap(se3.exp(ca.DM(6, 1)), np.eye(4)) == 0
    assert gap(se3.tangent(ca.DM(6, 1)), np.eye(6)) == 0
    assert gap(se3.log(ca.DM.eye(4)), np.zeros(6)) == 0


# Logarithm


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("angle", [*UP_TO_PI, pi - 1e-2, pi - 1e-4, pi - 1e-6])
def test_log_undoes_the_matrix_exponential(angle, number):
    for seed in range(5):
        x = twist(angle, seed)
        g = expm(hat(x))
        flat = g.ravel(order="F")
        assert gap(evaluate(lambda g: se3.log(ca.reshape(g, 4, 4)), flat, number), x) < 1e-9
        w = evaluate(lambda g: so3.log(ca.reshape(g, 4, 4)[:3, :3]), flat, number)
        assert gap(w, x[:3]) < 1e-9
        assert np.abs(w.ravel() - x[:3]).max() < 1e-15 + 1e-9 * angle


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", HALF_TURN_AXES)
def test_log_has_no_lost_axis_at_half_a_turn(axis, sign):
    n = sign * np.array(axis) / np.linalg.norm(axis)
    for angle in (2 * pi / 3, pi - 1e-3, pi - 1e-6):
        R = Rotation.from_rotvec(angle * n).as_matrix()
        assert gap(so3.log(ca.DM(R)), angle * n) < 1e-9
    half_turn = array(so3.log(ca.DM(2 * np.outer(n, n) - np.eye(3)))).ravel()
    assert min(gap(half_turn, pi * n), gap(half_turn, -pi * n)) < 1e-9


@fast
@given(vectors)
def test_log_agrees_with_scipy_rotations(v):
    w = 3.1 * v / max(1.0, np.linalg.norm(v))
    assert gap(so3.log(ca.DM(Rotation.from_rotvec(w).as_matrix())), w) < 1e-12


@pytest.mark.parametrize("number", SYMBOLS)
def test_log_of_exp_is_the_identity_with_its_first_and_second_derivatives(number):
    a, b = twist(0.8, seed=1), twist(1.1, seed=2)
    for t in [*UP_TO_PI, pi - 1e-2]:
        along_a, along_b, mixed = slopes(lambda x: se3.log(se3.exp(x)), twist(t), a, b, number)
        assert gap(along_a, a) < 1e-11, f"angle {t}"
        assert gap(along_b, b) < 1e-11, f"angle {t}"
        assert gap(mixed, np.zeros(6)) < 1e-10, f"angle {t}"


# Screws


@pytest.mark.parametrize("case", CASES, ids=CASE_NAMES)
def test_screws_agree_with_seventy_digit_values(case):
    got, exact = screw(case["xi"], case["X"]), case["screw"]
    direction = np.array(exact["axis_direction"])
    np.testing.assert_allclose(got.axis_direction, direction / (np.linalg.norm(direction) or 1), atol=1e-14)
    if exact["pitch"] == "inf":
        assert isinf(got.pitch)
        assert got.magnitude == pytest.approx(case["X"] * np.linalg.norm(case["xi"][3:]), rel=1e-14)
    else:
        scale = max(1.0, np.linalg.norm(exact["axis_point"]))
        assert got.pitch == pytest.approx(exact["pitch"], rel=1e-12, abs=1e-15 * scale)
        np.testing.assert_allclose(got.axis_point, exact["axis_point"], atol=1e-14 * scale)
        assert got.magnitude == pytest.approx(exact["magnitude"], rel=1e-14)


@fast
@given(twists, st.floats(0.1, 2))
def test_points_of_the_axis_slide_along_it_by_pitch_times_magnitude(xi, X):
    if np.linalg.norm(xi[:3]) < 0.05:
        return
    s = screw(ca.DM(xi), X)
    g = expm(X * hat(xi))
    moved = (g @ np.append(s.axis_point + 0.7 * s.axis_direction, 1))[:3]
    advance = moved - s.axis_point - 0.7 * s.axis_direction
    assert gap(advance, s.pitch * s.magnitude * s.axis_direction) < 1e-10
    assert abs(s.axis_point @ s.axis_direction) < 1e-9 * (1 + np.linalg.norm(s.axis_point))


def columns(*axes):
    return np.eye(6)[:, [axis - 1 for axis in axes]]


NOTHING, STRAIGHT = np.zeros(6), np.eye(6)[3]
SYSTEMS = {
    "fixed": (np.zeros((6, 0)), NOTHING, "{0}", 0),
    "revolute": (columns(1), NOTHING, "so(2)", 1),
    "prismatic": (columns(4), NOTHING, "R", 1),
    "helical": (columns(1) + 0.01 * columns(4), NOTHING, "h_p", 1),
    "cylindrical": (columns(1, 4), NOTHING, "so(2) x R", 2),
    "planar": (columns(3, 4, 5), NOTHING, "se(2)", 3),
    "spherical": (columns(1, 2, 3), NOTHING, "so(3)", 3),
    "free": (np.eye(6), NOTHING, "se(3)", 6),
    "linear spring": (columns(4), STRAIGHT, "R", 1),
    "planar constant curvature": (columns(3, 4), STRAIGHT, "span B", 2),
    "inextensible constant curvature": (columns(2, 3), STRAIGHT, "span{B, xi_bar}", 3),
    "constant curvature": (columns(2, 3, 4), STRAIGHT, "span B", 3),
    "inextensible Kirchhoff-Love": (columns(1, 2, 3), STRAIGHT, "span{B, xi_bar}", 4),
    "Kirchhoff-Love": (columns(1, 2, 3, 4), STRAIGHT, "span B", 4),
    "Simo-Reissner": (np.eye(6), STRAIGHT, "se(3)", 6),
    "planar screw motion": (columns(3, 4, 5) + 0.1 * columns(6, 1, 1) * [1, 0, 0], NOTHING, "span B", 3),
    "two slides": (columns(4, 5), NOTHING, "span B", 2),
}


@pytest.mark.parametrize("kind", SYSTEMS)
def test_screw_systems_are_those_of_the_published_table_in_every_frame(kind):
    Phi, xi_bar, name, order = SYSTEMS[kind]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        g = np.eye(4) if seed == 0 else expm(hat(rng.uniform(-2, 2, 6)))
        Ad = array(se3.Ad(ca.DM(g)))
        mix = rng.uniform(-1, 1, (Phi.shape[1],) * 2) + 3 * np.eye(Phi.shape[1])
        got = screw_system(Ad @ Phi @ mix, Ad @ xi_bar)
        assert (got.name, got.order) == (name, order), f"frame {seed}"


def test_screw_systems_are_recognised_on_a_far_axis():
    g = se3.pose(ca.DM.eye(3), ca.DM([300, -200, 100]))
    for kind in ("revolute", "prismatic", "helical", "cylindrical", "planar"):
        Phi, xi_bar, name, _ = SYSTEMS[kind]
        assert screw_system(se3.Ad(g) @ Phi, xi_bar).name == name


def test_dependent_columns_do_not_raise_the_order():
    assert screw_system(np.column_stack([columns(1), 1e3 * columns(1)]), 5 * columns(1)).order == 1
    assert screw(NOTHING).pitch == inf
