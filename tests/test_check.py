"""The independent look at an answer: agrees with the solver where the solver is right, and only there."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots import CASES, Plain, array, gap, slopes
from robots import functions as functions_of

from socontrol.files.robot_file import load_robot
from socontrol.lie import arcs, stumpff
from socontrol.mechanics.actuators import JointTorque
from socontrol.mechanics.robot import Robot
from socontrol.model.steps import Piece
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.looks import check
from socontrol.programs.looks.answer import FORCE_TOLERANCE
from socontrol.programs.postures.statics import Statics

SHIPPED = Path(__file__).parent.parent / "configs" / "robots"
NAMES = ["stiff_flop_two_modules", "octopus_arm", "hybrid_arm"]  # chambers; taper and cables; joints too


@cache
def shipped(name):
    return load_robot(SHIPPED / f"{name}.yaml")


@cache
def functions(name):
    return shipped(name).functions()


def drawn(name, seed):
    """Random coordinates, sections bent by up to a radian, and inputs within the limits."""
    robot, rng = shipped(name), np.random.default_rng(seed)
    sizes = {"rad": 1.0, "1": 0.1}
    lengths = [float(p.length) for p in robot.tree.pieces for _ in range(p.size)]
    size = [sizes.get(unit, 1 / length) for unit, length in zip(robot.coordinate_units, lengths, strict=True)]
    lower, upper = np.array(robot.input_limits).T
    return rng.uniform(-1, 1, robot.n) * size, rng.uniform(lower, upper)


def parts_of(robot, q, u):
    """Unbalanced force and the largest of its parts, each row over its own scale."""
    r, *parts = (part / scale(robot) for part in check.residual(robot, q, u))
    return r, max(np.abs(part).max(initial=0) for part in parts)


def scale(robot):
    return scales(robot).force


def uneven(robot):
    return np.array(robot.input_limits)[:, 1] * np.linspace(0.05, 0.3, robot.m)


@cache
def resting(name):
    """Inputs well inside their limits, all different, and the equilibrium there."""
    u = uneven(shipped(name))
    answer = Balance(shipped(name)).solve(u)
    assert answer.status.solved
    return answer.q, u


# It agrees with a solver that is right


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_recomputed_force_is_the_solver_s_own_at_any_shape(name, seed):
    q, u = drawn(name, seed)
    r, largest = parts_of(shipped(name), q, u)
    own = array(functions(name).static_residual(q, u)) / scale(shipped(name))
    assert np.abs(r - own).max() < 1e-9 * largest


@pytest.mark.parametrize("case", CASES, ids=str)
def test_recomputed_force_is_that_of_every_kind_of_robot(case):
    r, largest = parts_of(case.robot, case.q, case.u)
    own = array(functions_of(case.name).static_residual(case.q, case.u)) / scale(case.robot)
    assert np.abs(r - own).max(initial=0) <= 1e-9 * largest


@pytest.mark.parametrize("name", NAMES)
def test_parts_of_the_recomputed_force_are_those_of_the_functions(name):
    q, u = drawn(name, 7)
    _, elastic, external, actuation = check.residual(shipped(name), q, u)
    f = functions(name)
    assert gap(elastic, f.elastic_force(q)) < 1e-9
    assert gap(external, f.external_force(q, np.zeros_like(q))) < 1e-9
    assert gap(actuation, array(f.actuation(q)) @ u) < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_recomputed_force_is_the_slope_of_energies_summed_in_numpy(name):
    """Fibres, polygons and matrix exponentials of a third code, that shares nothing with the other two."""
    q, u = drawn(name, 3)
    plain = Plain(shipped(name).description)
    stored = slopes(lambda q: plain.elastic_energy(q) + plain.potential(q), q)
    r, largest = parts_of(shipped(name), q, u)
    other = (stored - plain.actuation(q) @ u) / scale(shipped(name))
    assert np.abs(r - other).max() < 1e-7 * largest


# It finds what is wrong


@pytest.mark.parametrize("name", NAMES)
def test_a_solved_answer_balances_and_a_shifted_one_does_not(name):
    q, u = resting(name)
    r, largest = parts_of(shipped(name), q, u)
    assert np.abs(r).max() < FORCE_TOLERANCE * largest
    for i in (0, -1):
        moved = q.copy()
        moved[i] += 1e-6 * scales(shipped(name)).q[i]
        r, largest = parts_of(shipped(name), moved, u)
        assert np.abs(r).max() > FORCE_TOLERANCE * largest


@pytest.mark.parametrize("name", NAMES)
def test_a_shifted_input_does_not_balance(name):
    q, u = resting(name)
    for i in (0, -1):
        r, largest = parts_of(shipped(name), q, u + 1e-5 * np.abs(u).max() * np.eye(len(u))[i])
        assert np.abs(r).max() > FORCE_TOLERANCE * largest


def test_an_answer_that_does_not_balance_is_rejected_whatever_the_solver_says(monkeypatch):
    question = Statics(robot=shipped("octopus_arm"), inputs={"long_0": 0.5}, discretisation=False)
    assert question.solve().status.solved
    solve = Balance.solve

    def wrong(self, *args, **keys):
        answer = solve(self, *args, **keys)
        answer.q[0] += 1e-3
        return answer

    monkeypatch.setattr(Balance, "solve", wrong)
    result = question.solve()
    assert result.status.outcome == "rejected"
    assert result.status.exit_code == 7
    assert "unbalanced force" in result.status.message


# It shares no formula of motion with the solver


def fooled(name):
    """Unbalanced over largest force at the equilibrium of the solver: as it sees it, and as the look does."""
    robot = Robot(shipped(name).description)
    u = uneven(robot)
    balance = Balance(robot)
    answer = balance.solve(u)
    r, largest = parts_of(robot, answer.q, u)
    return np.abs(balance.evaluate(answer.q, u)[0] / scale(robot)).max() / largest, np.abs(r).max() / largest


@pytest.fixture
def fresh():
    """No Function made before or during this test is kept."""
    caches = (arcs._moment_functions, arcs._tangent_gradient, arcs._step)
    for made in caches:
        made.cache_clear()
    yield
    for made in caches:
        made.cache_clear()


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_series_for_weights_fools_the_solver_alone(name, monkeypatch, fresh):
    q, u = drawn(name, 11)
    before = check.residual(shipped(name), q, u)[0]
    weighted = arcs._weighted
    monkeypatch.setattr(arcs, "_weighted", lambda *args, **keys: 1.01 * weighted(*args, **keys))
    solver, look = fooled(name)
    assert solver < FORCE_TOLERANCE < look
    np.testing.assert_array_equal(check.residual(Robot(shipped(name).description), q, u)[0], before)


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_series_for_motion_fools_the_solver_alone(name, monkeypatch, fresh):
    q, u = drawn(name, 11)
    before = check.residual(shipped(name), q, u)[0]

    def wrong(x, *args, **keys):
        one, *others = stumpff.series(x, *args, **keys)
        return one, *(1.01 * c for c in others)

    monkeypatch.setattr(Piece, "coefficients", lambda self: wrong)
    solver, look = fooled(name)
    assert solver < FORCE_TOLERANCE < look
    np.testing.assert_array_equal(check.residual(Robot(shipped(name).description), q, u)[0], before)


def test_exponentials_of_the_look_turn_like_sines_and_cosines():
    rng = np.random.default_rng(5)
    for size in (0, 1e-8, 9.99e-3, 1.01e-2, 1.0, 6.2):
        axis = rng.normal(size=3)
        xi = np.concatenate([size * axis / np.linalg.norm(axis), rng.normal(size=3)])
        g, half = check.exponentials(xi, np.array([1.0, 0.5]))
        np.testing.assert_allclose(g, half @ half, rtol=0, atol=1e-13)
        np.testing.assert_allclose(g[:3, :3] @ g[:3, :3].T, np.eye(3), rtol=0, atol=1e-13)
        np.testing.assert_allclose(np.trace(g[:3, :3]), 1 + 2 * np.cos(size), rtol=0, atol=1e-13)


def test_a_motor_is_seen_by_the_look():
    """Drive torque of the shoulder enters its own row alone."""
    robot = shipped("hybrid_arm")
    i = robot.inputs.index("shoulder")
    assert isinstance(robot.description.actuators["shoulder"], JointTorque)
    u = np.zeros(robot.m)
    u[i] = 2.0
    _, _, _, actuation = check.residual(robot, np.zeros(robot.n), u)
    expected = np.zeros(robot.n)
    expected[robot.coordinates.index("upper")] = 2.0
    np.testing.assert_allclose(actuation, expected, rtol=0, atol=1e-14)
