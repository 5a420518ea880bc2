"""Direct collocation: derivatives against CasADi's, optima against closed forms, Riccati, the cycloid and shooting."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import socontrol as so
from socontrol.native import compiler
from socontrol.programs.nlp import assembly
from socontrol.programs.nlp.parts import Parts
from socontrol.programs.nlp.solver import NLP, Ipopt
from socontrol.programs.plans.plan_costs import Effort
from socontrol.programs.plans.plan_guess import PlanGuess
from socontrol.programs.plans.schemes import scheme
from socontrol.programs.plans.trajectory import End, Mesh, Outputs, Replay, Start, Trajectory
from socontrol.programs.plans.transcription import Span, System, Transcription

ROBOTS = Path(__file__).parent.parent / "configs/robots"
PRECISE = Ipopt(tolerance=1e-11)
MESHES = [  # scheme, points, inputs, continuous
    ("radau", 1, "points", False), ("radau", 3, "points", False), ("radau", 3, "points", True),
    ("radau", 3, "linear", False), ("radau", 3, "linear", True), ("radau", 3, "constant", False),
    ("lobatto", 2, "points", True), ("lobatto", 4, "points", True), ("lobatto", 4, "linear", True),
    ("trapezoidal", 3, "points", True), ("hermite_simpson", 3, "points", True), ("hermite_simpson", 3, "linear", True),
]  # fmt: skip
RADAU, LOBATTO = ("radau", 3, "points", False), ("lobatto", 4, "points", True)
FINE = [kind for kind in MESHES if kind[1] > 2 and kind[0] != "trapezoidal" and kind[2] != "constant"]
RATED = [  # with rates of inputs
    ("radau", 3, "points", True), ("radau", 3, "linear", True), LOBATTO, ("hermite_simpson", 3, "linear", True),
]  # fmt: skip


# A program of parts, beside the same sums written out place by place


def cubic(x, y, data):
    """Two rows, a cost and a square that mix all they are given."""
    return {
        "rows": ca.vertcat(x[0] * y[0] ** 2 - data[0], ca.sin(x[1]) * x[0] + data[1] * y[0]),
        "scale": np.array([2.0, 0.5]),
        "cost": ca.exp(x[0] * y[0]) * data[0],
        "squares": ca.vertcat(x[0] - y[0] ** 2, x[1] * y[0]),
    }


def bilinear(a):
    return {"rows": a[0] * a[1]}


def priced(price):
    return lambda a: {"cost": price[0] * a[0] ** 3 * a[1] + price[1] ** 2 * a[1]}


@dataclass
class Kind:
    expression: object
    blocks: dict
    numbers: object = None
    when: object = None
    linking: bool = False


PRICES = np.array([0.7, -1.3])


def kinds(prices):
    """Parts that share places, come in no order of time, and have some or all of rows, costs, squares and data."""
    rng = np.random.default_rng(3)
    x = np.array([[0, 2], [2, 4], [0, 6], [8, 2]])
    return [
        Kind(cubic, {"x": x, "y": np.array([[1], [3], [1], [9]])}, rng.normal(size=(4, 2)), [2, 0, 1, 0]),
        Kind(bilinear, {"a": np.array([[5, 1], [7, 3]])}, None, [1, 0], True),
        Kind(priced(prices), {"a": np.array([[7, 1], [7, 1], [9, 3]])}),
    ]


def assembled():
    program = Parts()
    program.block(10, scale=np.where(np.arange(10) % 2, 3.0, 0.2))
    for k, kind in enumerate(kinds(program.parameter("prices", PRICES))):
        program.add(f"kind {k}", kind.blocks, kind.expression, numbers=kind.numbers, when=kind.when, upper=k + 1.0,
                    linking=kind.linking)  # fmt: skip
    return program


def written_out(prices=PRICES):
    """x, f, g of `assembled` as plain sums, and g's limits; rows by stage, those that link to the next first."""
    x, f, rows = ca.SX.sym("x", 10), 0, []
    si = x * ca.DM(np.where(np.arange(10) % 2, 3.0, 0.2))
    for k, kind in enumerate(kinds(prices)):
        for i in range(len(next(iter(kind.blocks.values())))):
            pieces = [si[places[i].tolist()] for places in kind.blocks.values()]
            data = [] if kind.numbers is None else [ca.DM(kind.numbers[i])]
            found = kind.expression(*pieces, *data)
            f += found.get("cost", 0) + ca.sumsqr(found.get("squares", ca.DM(0))) / 2
            stage, scale = kind.when[i] if kind.when else i, found.get("scale", np.ones(1))
            own = found.get("rows", ca.SX(0, 1)) / scale
            rows += [(stage, not kind.linking, own[j], (k + 1.0) / scale[j]) for j in range(own.numel())]
    rows.sort(key=lambda row: row[:2])
    return x, f, ca.vertcat(*(row[2] for row in rows)), np.array([row[3] for row in rows])


def agree(functions, x, f, g, rng, p=()):
    """f, g, gradient, Jacobian and upper Hessian of `functions` are those of expressions f, g of x, at random."""
    sigma, lam = type(x).sym("sigma"), type(x).sym("lam", g.numel())
    whole = ca.triu(ca.hessian(sigma * f + ca.dot(lam, g), x)[0])
    oracle = ca.Function("oracle", [x, sigma, lam], [f, g, ca.gradient(f, x), ca.jacobian(g, x), whole]).expand()
    at, weight, multipliers = rng.uniform(0.2, 1.0, x.numel()), 0.7, rng.normal(size=g.numel())
    value, rows, gradient, jacobian, second = (np.array(ca.DM(y)) for y in oracle(at, weight, multipliers))
    found = [*functions["grad_f"](at, p), *functions["jac_g"](at, p)]
    found.append(functions["hess_lag"](at, p, weight, multipliers))
    for mine, exact in zip(found, (value, gradient, rows, jacobian, second), strict=True):
        np.testing.assert_allclose(np.array(ca.DM(mine)), exact, rtol=1e-12, atol=1e-12 * (1 + np.abs(exact).max()))


def test_a_sum_of_parts_and_its_derivatives_are_those_of_the_sum_written_out():
    program = assembled()
    agree(program.functions(), *written_out()[:3], np.random.default_rng(0), program.stack_parameters({}))
    other = np.array([2.0, 0.4])
    changed = program.stack_parameters({"prices": other})
    agree(program.functions(), *written_out(other)[:3], np.random.default_rng(0), changed)


def test_limits_and_names_of_rows_stand_in_the_order_of_the_rows():
    program, at, (x, f, g, upper) = assembled(), np.random.default_rng(1).uniform(0.2, 1.0, 10), written_out()
    np.testing.assert_allclose(program.limits(), [np.zeros(upper.size), upper])
    cost, rows = (np.array(found).ravel() for found in ca.Function("fg", [x], [f, g])(at))
    found = {part.name: (own, values) for part, own, values in program.evaluated(at)}
    assert sum(own for own, _ in found.values()) == pytest.approx(cost[0], rel=1e-13)
    named = [found[part.name][1][i, k] for part, i, k in program.rows]
    np.testing.assert_allclose(named, rows, rtol=1e-13)
    np.testing.assert_allclose(program.stack(program.split(at)), at, rtol=1e-15)


@pytest.mark.skipif(compiler.find() is None, reason="no C compiler is here; install gcc or clang")
def test_parts_in_machine_code_are_the_same(monkeypatch):
    monkeypatch.setattr(assembly, "WORTH", 0)
    agree(assembled().functions(in_c=True), *written_out()[:3], np.random.default_rng(0), PRICES)


def test_parts_at_places_of_different_scales_are_refused():
    program = Parts()
    program.block(2, scale=[1.0, 2.0])
    with pytest.raises(ValueError, match="'uneven' stand at places of different scales"):
        program.add("uneven", {"x": np.array([[0], [1]])}, lambda x: {"rows": x})


# Transcriptions of small systems


def pendulums(q, v, a, u):
    """Two coupled pendulums, one motor."""
    c = 0.4 * ca.cos(q[0] - q[1])
    return ca.vertcat(2 * a[0] + c * a[1] + ca.sin(q[0]) * v[1] ** 2 - u[0], c * a[0] + a[1] + ca.sin(q[1]) + v[1] ** 3)


def pushed(q, v, a, u):
    """A mass of one on a line."""
    return a - u


def transcribed(kind, span, *, residual=pushed, sizes=(1, 1), intervals=20, **keys):
    name, points, inputs, continuous = kind
    n, m = sizes
    system = System(residual, np.ones(n), np.ones(m), np.ones(n))
    shares = np.full(intervals, 1 / intervals) if np.isscalar(intervals) else intervals
    return Transcription(system, scheme(name, points), shares, span, inputs=inputs, continuous=continuous,
                         **keys)  # fmt: skip


def quadratic(q, v, a, u, T, data):
    return {"squares": ca.sqrt(T * data[-1]) * ca.vertcat(q, v, u)}


def squared_rate(ud, T, share):
    return {"squares": ca.sqrt(T * share) * ud}


def effort(q, v, a, u, T, data):
    return {"squares": ca.sqrt(T * data[-1]) * u}


def duration(T):
    return {"cost": T}


def rest_to_rest(t, distance=1.0):
    """Hold both ends of the pushed mass at rest."""
    for k, place in ((0, 0.0), (-1, distance)):
        t.hold("q", t.node["q"][k], place, place)
        t.hold("v", t.node["v"][k], 0.0, 0.0)


def best(t, guess=None, settings=PRECISE):
    """Optimal plan and cost, from coordinates that go straight from 0 to 1."""
    zero, line = (lambda x: np.zeros((np.size(x), t.system.n))), (lambda x: np.tile(x, (t.system.n, 1)).T)
    still = lambda x: np.full((np.size(x), t.system.m), 0.1)  # noqa: E731
    outcome = NLP(t.program, settings).solve(t.filled(*(guess or (line, zero, zero, still)), t.span.guess))
    assert outcome.status.solved, outcome.status
    return t.planned(outcome.values), outcome


@pytest.mark.parametrize("staged", [False, True], ids=["", "staged"])
@pytest.mark.parametrize("span", [Span.fixed(1.3), Span(1.3, 0.5, 3.0)], ids=["fixed", "free"])
@pytest.mark.parametrize("kind", MESHES, ids=str)
def test_derivatives_of_a_transcription_are_those_of_its_expressions(kind, span, staged):
    t = transcribed(kind, span, residual=pendulums, sizes=(2, 1), intervals=np.array([0.2, 0.5, 0.3]), staged=staged,
                    halfway=True)  # fmt: skip
    t.at_points("cost", quadratic, weights=True)
    t.at_points("limit", lambda q, v, a, u, T, data: {"rows": q[0] * v[1] + u[0] ** 2 * T}, lower=-1.0)
    t.at_node("end", -1, lambda q, v: {"rows": ca.sin(q[0]) * v[1], "cost": ca.exp(q[1])})
    if t.continuous and kind[2] != "constant":
        t.input_rates("rate", squared_rate)
    if span.free:
        t.at_node("time", -1, lambda T: {"cost": T**2}, letters="T")
    functions = t.program.functions()
    agree(functions, *plain(functions), np.random.default_rng(1))


def plain(functions):
    """x, f, g of a program without parameters, as expressions of x alone."""
    nlp = functions["nlp"]
    x = ca.MX.sym("x", nlp["x"].numel())
    f, g = ca.Function("fg", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])(x, ca.DM.zeros(0, 1))
    return x, f, g


@pytest.mark.parametrize("kind", MESHES, ids=str)
def test_limits_everywhere_hold_at_all_nodes_points_and_knots(kind):
    t = transcribed(kind, Span.fixed(1.3), intervals=3)
    for letter, places in (("u", t.input_knots()), ("u", t.point["u"]), ("q", t.node["q"]), ("q", t.point["q"])):
        t.everywhere(letter, [-1.0], [2.0])
        np.testing.assert_array_equal(t.program.lower[places], -1.0)
        np.testing.assert_array_equal(t.program.upper[places], 2.0)


@pytest.mark.parametrize("kind", MESHES, ids=str)
def test_gauss_newton_is_exact_where_rows_are_linear_and_costs_are_squares(kind):
    span, rng, found = Span.fixed(1.3), np.random.default_rng(2), []
    for hessian in ("exact", "gauss_newton"):
        t = transcribed(kind, span, intervals=4, hessian=hessian)
        t.at_points("cost", quadratic, weights=True)
        found.append(t.program.functions()["hess_lag"])
    x, lam = rng.normal(size=t.program.scale.size), rng.normal(size=t.program.order.size)
    exact, newton = (np.array(ca.DM(hessian(x, [], 0.6, lam))) for hessian in found)
    np.testing.assert_allclose(newton, exact, atol=1e-13)
    assert np.abs(exact).max() > 1e-3


def test_gauss_newton_leaves_out_what_curves_the_rows_and_the_squares():
    """Half the square of sin(x) has the curvature cos^2 - sin^2; Gauss and Newton keep the first; rows none."""
    program = Parts("gauss_newton")
    program.add("wave", {"x": program.block(1)[None]}, lambda x: {"squares": ca.sin(x), "rows": x**2})
    found = float(program.functions()["hess_lag"](0.4, [], 2.0, 5.0))
    assert found == pytest.approx(2.0 * np.cos(0.4) ** 2, rel=1e-14)


# Closed forms


@pytest.mark.parametrize("intervals", [2, 20])
@pytest.mark.parametrize("inputs", ["points", "linear", "constant"])
def test_the_least_time_of_a_mass_is_reached_by_full_force_there_and_back(inputs, intervals):
    """One metre from rest to rest with at most 1 N on 1 kg: 2 s, +1 N for the first half, -1 N for the second."""
    t = transcribed(("radau", 3, inputs, False), Span(1.5, 0.1, 10.0), intervals=intervals)
    t.everywhere("u", [-1.0], [1.0])
    rest_to_rest(t)
    t.at_node("time", -1, duration, letters="T")
    plan, _ = best(t)
    assert plan.duration == pytest.approx(2.0, rel=1e-8)
    forces = plan.u[:, :, 0]
    np.testing.assert_allclose(forces - np.repeat([[1], [-1]], intervals // 2, axis=0), 0.0, atol=1e-6)
    times = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(plan.at(times)[0][:, 0], times**2 / 2, atol=1e-7)


def test_a_continuous_force_takes_longer_by_one_interval_s_turn_of_it():
    """Trapezoids, 4 intervals of h = T/4: +1 N for h, down to -1 N over 2 h in the middle, -1 N for h. Its way is
    h^2 (1/2 + 4/3 + 1/2) + ... = 11/3 h^2 by integration, so that h = (3/11)^(1/2)."""
    t = transcribed(("lobatto", 2, "points", True), Span(2.0, 0.1, 10.0), intervals=4)
    t.everywhere("u", [-1.0], [1.0])
    rest_to_rest(t)
    t.at_node("time", -1, duration, letters="T")
    plan, _ = best(t)
    assert plan.duration == pytest.approx(4 * np.sqrt(3 / 11), rel=1e-8)


@pytest.mark.parametrize("kind", RATED, ids=str)
def test_the_least_time_with_limited_force_and_rate_of_force(kind):
    """1 N at most, 4 N/s at most, force 0 at both ends: t = 1/4 s up, 1/4 s held, 1/2 s over to the other side, and
    back; the way is (t + t)(2 t + t) = 3/8 m in 6 t = 3/2 s."""
    t = transcribed(kind, Span(2.0, 0.1, 10.0), intervals=6)
    t.everywhere("u", [-1.0], [1.0])
    rest_to_rest(t, 0.375)
    t.hold("u", t.node["u"][[0, -1]], 0.0, 0.0)
    t.input_rates("rates", lambda ud, T, share: {"rows": ud}, lower=-4.0, upper=4.0)
    t.at_node("time", -1, duration, letters="T")
    plan, _ = best(t)
    assert plan.duration == pytest.approx(1.5, rel=1e-8)
    np.testing.assert_allclose(plan.v[:, 0] * 8, [0, 1, 3, 4, 3, 1, 0], atol=1e-6)
    np.testing.assert_allclose(plan.q[:, 0] * 96, [0, 1, 7, 18, 29, 35, 36], atol=1e-6)
    if kind[2] == "linear":  # others keep within the limits at their points, and may pass them between
        np.testing.assert_allclose(plan.at(plan.nodes)[3][:, 0], [0, 1, 1, 0, -1, -1, 0], atol=1e-6)


@pytest.mark.parametrize("kind", FINE, ids=str)
def test_the_least_effort_of_a_mass_is_a_force_linear_in_time(kind):
    """Half the integral of u^2 from rest to rest over D = 1 in T: 6 D^2/T^3, u = 6 D/T^2 (1 - 2 t/T). Nothing looks at
    the value a continuous input has at t = 0 in the Radau scheme."""
    t = transcribed(kind, Span.fixed(1.3), intervals=np.array([0.1, 0.4, 0.2, 0.3]))
    rest_to_rest(t)
    t.at_points("effort", effort, weights=True)
    plan, outcome = best(t)
    times = np.linspace(0, 1.3, 14)
    assert outcome.cost == pytest.approx(6 / 1.3**3, rel=1e-9)
    points = slice(2, None) if kind == ("radau", 3, "points", True) else slice(None)
    np.testing.assert_allclose(plan.at(times)[3][points, 0], 6 / 1.3**2 * (1 - 2 * times[points] / 1.3), atol=1e-7)


def test_the_least_effort_of_forces_held_for_an_interval_is_a_least_norm():
    """N forces u with sum u = 0 and h^2 sum (N - k - 1/2) u_k = 1: the shortest such vector."""
    count, h = 5, 1.3 / 5
    rows = np.array([np.ones(count), h**2 * (count - np.arange(count) - 0.5)])
    forces = np.linalg.pinv(rows) @ [0.0, 1.0]
    t = transcribed(("radau", 3, "constant", False), Span.fixed(1.3), intervals=count)
    rest_to_rest(t)
    t.at_points("effort", effort, weights=True)
    plan, outcome = best(t)
    np.testing.assert_allclose(plan.u[:, 0, 0], forces, atol=1e-8)
    assert outcome.cost == pytest.approx(h * forces @ forces / 2, rel=1e-10)


@pytest.mark.parametrize("kind", FINE, ids=str)
@pytest.mark.parametrize("staged", [False, True], ids=["", "staged"])
def test_the_best_duration_weighs_time_against_effort(kind, staged):
    """The least of T + 6/T^3 is where T^4 = 18."""
    t = transcribed(kind, Span(1.0, 0.2, 9.0), intervals=5, staged=staged)
    rest_to_rest(t)
    t.at_points("effort", effort, weights=True)
    t.at_node("time", -1, duration, letters="T")
    plan, outcome = best(t)
    assert plan.duration == pytest.approx(18**0.25, rel=1e-7)
    assert outcome.cost == pytest.approx(18**0.25 + 6 / 18**0.75, rel=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in RATED if kind[2] == "points"], ids=str)
def test_the_least_rate_of_force_is_the_motion_of_least_jerk(kind):
    """q = D (10 x^3 - 15 x^4 + 6 x^5), x = t/T: half the integral of q'''^2 is 360 D^2/T^5. The force is cubic: at the
    nodes both schemes are exact for it."""
    t = transcribed(kind, Span.fixed(1.3), intervals=4)
    rest_to_rest(t)
    t.hold("u", t.node["u"][[0, -1]], 0.0, 0.0)
    t.input_rates("rate", squared_rate)
    plan, outcome = best(t)
    x = np.linspace(0, 1, 5)
    assert outcome.cost == pytest.approx(360 / 1.3**5, rel=1e-9)
    np.testing.assert_allclose(plan.at(1.3 * x)[0][:, 0], 10 * x**3 - 15 * x**4 + 6 * x**5, atol=1e-8)
    np.testing.assert_allclose(plan.at(1.3 * x)[4][:, 0], (60 - 360 * x + 360 * x**2) / 1.3**3, atol=1e-4)


@pytest.mark.parametrize("kind", MESHES, ids=str)
def test_places_half_way_between_the_points_lie_on_the_plan(kind):
    t = transcribed(kind, Span(1.0, 0.2, 9.0), intervals=np.array([0.3, 0.5, 0.2]), halfway=True)
    rest_to_rest(t)
    t.at_points("effort", effort, weights=True)
    t.at_node("time", -1, duration, letters="T")
    plan, outcome = best(t)
    stops = np.unique([0.0, *plan.scheme.c])
    fractions = (stops[1:] + stops[:-1]) / 2
    times = plan.nodes[:3, None] + np.diff(plan.nodes)[:, None] * fractions
    found = outcome.values[t.halfway][..., 0]
    np.testing.assert_allclose(found.ravel(), plan.at(times.ravel())[0][:, 0], atol=1e-11)


# Linear-quadratic: the Riccati equation


def regulated(T, first, times):
    """Cost of the pushed mass with half the integral of q^2 + v^2 + u^2 from `first`, and the best u [K] at times.

    P' = -A'P - P A + P B B'P - I, P(T) = 0: from the exponential of the Hamiltonian matrix; cost x'P x/2, u = -B'P x.
    """
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    hamiltonian = np.block([[A, -B @ B.T], [-np.eye(2), -A.T]])
    back = expm(-T * hamiltonian)
    P = back[2:, :2] @ np.linalg.inv(back[:2, :2])
    state = np.concatenate([first, P @ first])
    return first @ P @ first / 2, np.array([-(expm(t * hamiltonian) @ state)[3] for t in times])


@pytest.mark.parametrize(("kind", "intervals", "cost", "force"), [
    (RADAU, 20, 1e-9, 2e-5), (("radau", 3, "points", True), 20, 1e-9, 2e-5),
    (("radau", 2, "points", False), 40, 1e-6, 5e-4), (LOBATTO, 20, 1e-9, 2e-5),
    (("hermite_simpson", 3, "points", True), 40, 1e-6, 5e-4), (("trapezoidal", 2, "points", True), 160, 1e-4, 1e-2),
    (("radau", 3, "linear", True), 40, 1e-6, 5e-4), (("radau", 3, "constant", False), 160, 1e-4, 2e-2),
], ids=str)  # fmt: skip
def test_a_regulator_is_that_of_the_riccati_equation(kind, intervals, cost, force):
    """`cost` relative, `force` [N] at the points."""
    first, T = np.array([1.0, -0.4]), 2.0
    t = transcribed(kind, Span.fixed(T), intervals=intervals)
    t.hold("q", t.node["q"][0], first[0], first[0])
    t.hold("v", t.node["v"][0], first[1], first[1])
    t.at_points("cost", quadratic, weights=True)
    plan, outcome = best(t)
    exact = regulated(T, first, plan.points)
    assert outcome.cost == pytest.approx(exact[0], rel=cost)
    found = outcome.values[t.point["u"]].ravel()
    np.testing.assert_allclose(found, exact[1], atol=force)


# Brachistochrone: a bead on a wire without friction


def bead(q, v, a, u):
    """q: x, depth and way along the wire, which descends at the angle u from the vertical."""
    return ca.vertcat(v[0] - v[2] * ca.sin(u), v[1] - v[2] * ca.cos(u), a[2] - 9.81 * ca.cos(u))


def cycloid(x, depth):
    """Least time from rest at the origin: R (p - sin p), R (1 - cos p) with p = (g/R)^(1/2) t; the angle is p/2."""
    end = brentq(lambda p: (p - np.sin(p)) / (1 - np.cos(p)) - x / depth, 1e-3, 2 * np.pi - 1e-3, xtol=1e-14)
    radius = depth / (1 - np.cos(end))
    return end * np.sqrt(radius / 9.81), end / 2


@pytest.mark.parametrize("kind", [RADAU, ("radau", 3, "linear", False)], ids=str)
def test_the_quickest_descent_is_the_cycloid(kind):
    time, last = cycloid(2.0, 1.0)
    t = transcribed(kind, Span(1.0, 0.3, 3.0), residual=bead, sizes=(3, 1), intervals=20)
    t.hold("q", t.node["q"][0], 0.0, 0.0)
    t.hold("v", t.node["v"][0], 0.0, 0.0)
    t.hold("q", t.node["q"][-1][:2], [2.0, 1.0], [2.0, 1.0])
    t.everywhere("u", [-0.1], [np.pi])
    t.at_node("time", -1, duration, letters="T")
    line = lambda x: np.outer(x, [2.0, 1.0, 2.2])  # noqa: E731
    ramp, ones = (lambda x: np.outer(x, [1.0])), (lambda x: np.ones((np.size(x), 3)))
    plan, _ = best(t, (line, line, ones, ramp))
    assert plan.duration == pytest.approx(time, rel=1e-8)
    inside = np.linspace(0.1, 0.95, 9)
    np.testing.assert_allclose(plan.at(inside * plan.duration)[3][:, 0], inside * last, atol=1e-4)


# Cart-pole swing-up (M. Kelly, SIAM Review 59 (2017)): multiple shooting on equations of motion of its own


CART, POLE, LONG, G, SWING, FORCE, WAY = 1.0, 0.3, 0.5, 9.81, 2.0, 20.0, 1.0  # kg, kg, m, m/s^2, s, N, m


def cartpole_slope(y, u):
    """[x', p', x'', p'']: p from hanging down; sec. 6 of the paper."""
    p, s, c = y[3], ca.sin(y[1]), ca.cos(y[1])
    below = CART + POLE * s**2
    x = (LONG * POLE * s * p**2 + u + POLE * G * c * s) / below
    turn = -(LONG * POLE * c * s * p**2 + u * c + (CART + POLE) * G * s) / (LONG * below)
    return ca.vertcat(y[2], p, x, turn)


def one_shot(h, steps=4):
    """(y, u0, u1) -> state after h with a force linear in time, by RK4."""
    y, u0, u1 = ca.SX.sym("y", 4), ca.SX.sym("u0"), ca.SX.sym("u1")
    state, d = y, h / steps
    for k in range(steps):
        u = [u0 + (u1 - u0) * (k + x) / steps for x in (0, 0.5, 1)]
        k1 = cartpole_slope(state, u[0])
        k2 = cartpole_slope(state + d / 2 * k1, u[1])
        k3 = cartpole_slope(state + d / 2 * k2, u[1])
        k4 = cartpole_slope(state + d * k3, u[2])
        state = state + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("shot", [y, u0, u1], [state])


def shooting(count):
    """Integral of force^2 [N^2 s] at its least, force linear in each of `count` parts of the swing."""
    h, ends = SWING / count, (np.zeros(4), np.array([WAY, np.pi, 0.0, 0.0]))
    y, u = ca.MX.sym("y", 4, count + 1), ca.MX.sym("u", 1, count + 1)
    a, b = u[:, :-1], u[:, 1:]
    f = h / 3 * ca.sum2(a**2 + a * b + b**2)
    g = ca.vec(one_shot(h).map(count)(y[:, :-1], a, b) - y[:, 1:])
    lower = np.concatenate([np.tile([-2.0, -np.inf, -np.inf, -np.inf], count + 1), np.full(count + 1, -FORCE)])
    upper = -lower
    for at, end in ((0, ends[0]), (4 * count, ends[1])):
        lower[at : at + 4] = upper[at : at + 4] = end
    guess = np.concatenate([np.linspace(*ends, count + 1).ravel(), np.zeros(count + 1)])
    options = {"ipopt": {"tol": 1e-11, "print_level": 0, "sb": "yes"}, "print_time": False}
    solver = ca.nlpsol("shooting", "ipopt", {"x": ca.veccat(y, u), "f": f, "g": g}, options)
    answer = solver(x0=guess, lbx=lower, ubx=upper, lbg=0, ubg=0)
    assert solver.stats()["success"]
    return float(answer["f"])


@cache
def swing_up(intervals, *kind, scaled=True):
    """Plan of the cart-pole, from the robot's file; the search begins as that of `shooting`."""
    named = dict(zip(("scheme", "points", "inputs"), kind or ("radau", 3, "points"), strict=True))
    question = Trajectory(
        robot=so.load_robot(ROBOTS / "cartpole.yaml"), duration=SWING, mesh=Mesh(intervals=intervals, **named),
        start=Start(coordinates={"cart": 0.0, "pole": 0.0}), end=End(coordinates={"cart": WAY, "pole": np.pi}),
        guess=PlanGuess(times=(0.0, SWING), coordinates={"cart": (0.0, WAY), "pole": (0.0, np.pi)}),
        costs={"effort": Effort(weight=2 * FORCE**2)}, scaled=scaled, replay=Replay(active=False),
        outputs=Outputs(every=1e-3),
    )  # fmt: skip
    return question.solve().require()


@cache
def swing_up_by_shooting():
    coarse, middle, fine = (shooting(count) for count in (50, 100, 200))
    assert (coarse - middle) / (middle - fine) == pytest.approx(16, rel=0.15)  # lines for a smooth force: order 4
    return fine + (fine - middle) / 15


def test_the_cartpole_s_effort_is_the_limit_of_multiple_shooting():
    limit = swing_up_by_shooting()
    assert swing_up(50).values["cost"].value == pytest.approx(limit, rel=1e-6)
    assert swing_up(100).values["cost"].value == pytest.approx(limit, rel=1e-7)


@pytest.mark.parametrize(("kind", "tolerance"), [
    (("hermite_simpson", 3, "points"), 2e-5), (("trapezoidal", 3, "points"), 3e-3), (("lobatto", 4, "points"), 1e-6),
    (("radau", 3, "linear"), 1e-4), (("radau", 3, "constant"), 3e-2),
], ids=str)  # fmt: skip
def test_other_schemes_find_the_same_swing(kind, tolerance):
    assert swing_up(50, *kind).values["cost"].value == pytest.approx(swing_up_by_shooting(), rel=tolerance)


def test_the_planned_force_swings_the_pole_up():
    """The stored inputs, straight between samples, drive the test's own equations of motion to the goal."""
    arrays = swing_up(100).arrays
    forces = lambda t: np.interp(t, arrays["t"], arrays["u"][:, 0])  # noqa: E731
    slope = lambda t, y: np.array(ca.DM(cartpole_slope(ca.DM(y), forces(t)))).ravel()  # noqa: E731
    end = solve_ivp(slope, (0.0, SWING), np.zeros(4), rtol=1e-8, atol=1e-8, max_step=0.02).y[:, -1]
    np.testing.assert_allclose(end, [WAY, np.pi, 0.0, 0.0], atol=5e-3)


# Scales change the way to an answer, not the answer


def test_an_unscaled_program_has_the_same_optimum_on_the_cartpole():
    scaled, plain = (swing_up(50, scaled=s).values["cost"].value for s in (True, False))
    assert plain == pytest.approx(scaled, rel=1e-6)


def test_an_unscaled_program_has_the_same_optimum_on_the_double_pendulum():
    found = []
    for scaled in (True, False):
        question = Trajectory(
            robot=so.load_robot(ROBOTS / "double_pendulum.yaml"), duration=1.5, mesh=Mesh(intervals=10),
            end=End(coordinates={"upper": 0.8, "lower": -0.5}), scaled=scaled, replay=Replay(active=False),
        )  # fmt: skip
        found.append(question.solve().require().values["cost"].value)
    assert found[1] == pytest.approx(found[0], rel=1e-6)
