"""Sensitivities of the inputs: against answers solved again nearby, and refused where there is a kink."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import PRESSURE, PULL, frame, hand, module, two_modules

from socontrol.mechanics.robot import Description, Robot
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.postures.costs import Effort, Reference, StrainEnergy
from socontrol.programs.postures.goals import AxisDirection, Point
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.sensitivity import Degenerate, derivatives

# central differences of order 6
SIX_POINTS = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
PRECISE = Ipopt(tolerance=1e-13)


def ask(robot, goals, **keys):
    return InverseStatics(robot=robot, goals=goals, **{"discretisation": False, "solver": PRECISE, **keys})


def tip_of(robot, shares, segment="cap"):
    answer = Balance(robot).solve(PRESSURE * np.array(shares))
    return frame(robot, answer.q, segment)


def point(g, **keys):
    return Point(on="cap", target=tuple(g[:3, 3].tolist()), **keys)


def determined():
    """As many inputs as goals, none on a limit."""
    return ask(module(), {"tip": point(tip_of(module(), (0.6, 0.3, 0.4)))})


def determined_under_load():
    robot = module().with_loads(PULL)
    return ask(module(), {"tip": point(tip_of(robot, (0.6, 0.3, 0.4)))}, loads=PULL)


def redundant():
    """More inputs than goals; least effort leaves none on a limit."""
    return ask(two_modules(), {"tip": point(tip_of(two_modules(), [0.5] * 6))}, loads=PULL)


def on_limits():
    """Least effort leaves some inputs at zero pressure."""
    g = tip_of(two_modules().with_loads(PULL), (0.9, 0.0, 0.1, 0.0, 0.0, 0.9))
    return ask(two_modules(), {"tip": point(g)}, loads=PULL)


def partial():
    return ask(module(), {"tip": Point(on="cap", target=(None, 0.004, -0.004))}, loads=PULL)


def direction():
    return ask(two_modules(), {"look": AxisDirection(on="cap", target=(1.0, 0.3, -0.2))}, loads=PULL)


def weighted():
    goals = {
        "tip": Point(on="cap", target=(0.118, 0.008, -0.006), weight=1e3),
        "look": AxisDirection(on="cap", target=(1.0, 0.1, -0.1)),
    }
    return ask(two_modules(), goals)


def other_costs():
    near = Reference(inputs={"low_up": 30e3})
    costs = {"calm": StrainEnergy(weight=0.3), "near": near, "low": Effort(weight=0.5)}
    return ask(two_modules(), {"tip": point(tip_of(two_modules(), [0.5] * 6))}, costs=costs)


def given():
    """One input given, one coordinate held."""
    goal = {"tip": Point(on="finger", target=(0.45, None, -0.2))}
    return ask(hand(), goal, coordinates={"fore": 0.4}, inputs={"elbow": 0.0})


PLAIN = (determined, redundant, on_limits, partial, direction)
QUESTIONS = {f.__name__: f for f in (*PLAIN, determined_under_load, weighted, other_costs, given)}


@cache
def answered(name):
    solver = QUESTIONS[name]().prepare()
    outcome, _ = solver.find({})
    assert outcome.status.solved
    return solver, outcome


def directions(name):
    """(parameter, number, step) of every parameter of a question."""
    solver, _ = answered(name)
    for parameter, (_, value) in solver.posture.exact.program.parameters.items():
        for k in range(value.size):
            angle = isinstance(solver.posture.goals.get(parameter.removeprefix("target.")), AxisDirection)
            yield parameter, k, 2e-3 if angle or parameter.startswith("loads") else 1e-4


@pytest.mark.parametrize("name", QUESTIONS)
def test_sensitivities_are_differences_of_answers_solved_again(name):
    solver, outcome = answered(name)
    values = {p: value for p, (_, value) in solver.posture.exact.program.parameters.items()}
    found = derivatives(solver, outcome, values)
    assert set(found) == set(values)
    largest = {p: np.abs(matrix).max() for p, matrix in found.items()}
    for parameter, k, step in directions(name):
        total = 0
        for j, weight in SIX_POINTS.items():
            changed = values[parameter] + j * step * np.eye(values[parameter].size)[k]
            near, _ = solver.find({parameter: changed}, start=outcome.values)
            assert near.status.solved
            total = total + weight * near.values["u"] / step
        np.testing.assert_allclose(found[parameter][:, k], total, rtol=0, atol=1e-6 * largest[parameter])


def test_some_of_these_answers_stand_on_limits_and_some_do_not():
    lowest = {name: answered(name)[1].values["u"].min() / PRESSURE for name in ("redundant", "on_limits")}
    assert lowest["redundant"] > 0.01
    assert lowest["on_limits"] < 1e-6


def test_an_input_on_its_limit_does_not_move():
    solver, outcome = answered("on_limits")
    found = derivatives(solver, outcome, {})
    held = outcome.values["u"] < 1e-6 * PRESSURE
    for matrix in found.values():
        np.testing.assert_array_equal(matrix[held], 0)
        assert np.all(np.abs(matrix[~held]).max(axis=1) > 0)


def test_a_given_input_does_not_move():
    solver, outcome = answered("given")
    found = derivatives(solver, outcome, {})
    i = solver.question.robot.inputs.index("elbow")
    np.testing.assert_array_equal(found["target.tip"][i], 0)


def test_sensitivities_of_the_tip_to_its_own_goal_are_the_identity():
    """du/dgoal, then the forward compliance dx/du: together the tip follows its goal."""
    solver, outcome = answered("determined")
    du = derivatives(solver, outcome, {})["target.tip"]
    robot, u = solver.question.robot, outcome.values["u"]
    balance, columns = Balance(robot), []
    for i in range(3):
        total = 0
        for j, weight in SIX_POINTS.items():
            q = balance.solve(u + 200.0 * j * np.eye(3)[i], outcome.values["q"]).q
            total = total + weight * frame(robot, q, "cap")[:3, 3] / 200.0
        columns.append(total)
    np.testing.assert_allclose(np.column_stack(columns) @ du, np.eye(3), rtol=0, atol=1e-6)


def test_results_carry_sensitivities_with_units_when_asked():
    question = determined_under_load()
    result = replace(question, sensitivities=True).solve().require()
    rows = result.details["sensitivities"]
    assert rows["low_up/target.tip"].unit == "Pa/m"
    assert rows["low_up/loads.pull.force"].unit == "Pa/N"
    solver, outcome = answered("determined_under_load")
    expected = derivatives(solver, outcome, {})["target.tip"][0]
    np.testing.assert_allclose(rows["low_up/target.tip"].value, expected, rtol=1e-6)


# Refused


def touching(offset=0.0):
    """The wished inputs meet the goal, one `offset` pascals above its limit: nothing presses on it."""
    robot = two_modules()
    u = PRESSURE * np.array([0.5, 0.3, 0.4, 0.3, 0.4, 0.0])
    u[5] = offset
    answer = Balance(robot).solve(u)
    wish = Reference(inputs=dict(zip(robot.inputs, u.tolist(), strict=True)))
    return ask(robot, {"tip": point(frame(robot, answer.q, "cap"))}, costs={"wish": wish})


@pytest.mark.parametrize("settings", [Ipopt(), PRECISE])
def test_a_limit_that_is_just_touched_is_refused_by_name(settings):
    solver = replace(touching(), solver=settings).prepare()
    outcome, _ = solver.find({})
    assert outcome.status.solved
    with pytest.raises(Degenerate, match="high_right"):
        derivatives(solver, outcome, {})


def test_the_answer_has_a_kink_where_a_limit_is_just_touched():
    """Slopes to the two sides differ, so that any single number would be wrong."""
    solver = touching().prepare()
    outcome, _ = solver.find({})
    here, slopes = solver.posture.targets()["target.tip"], []
    for step in (1e-4, -1e-4):
        near, _ = solver.find({"target.tip": np.array(here) + [0, step, 0]}, start=outcome.values)
        assert near.status.solved
        slopes.append((near.values["u"] - outcome.values["u"])[5] / step)
    assert abs(slopes[0] - slopes[1]) > 0.1 * np.abs(slopes).max()


def test_a_limit_clear_of_the_answer_is_no_reason_to_refuse():
    solver = touching(offset=500.0).prepare()
    outcome, _ = solver.find({})
    derivatives(solver, outcome, {})


def test_inputs_that_do_the_same_are_refused_where_no_cost_tells_them_apart():
    one = module().description
    twin = {**one.actuators, "twin": one.actuators["low_up"]}
    robot = Robot(Description(**{**vars(one), "actuators": twin}))
    goal = {"tip": point(tip_of(module(), (0.6, 0.3, 0.4)))}
    indifferent = {"wish": Reference(coordinates={"low.0.twist": 0.0})}
    solver = ask(robot, goal, costs=indifferent).prepare()
    outcome, _ = solver.find({})
    assert outcome.status.solved
    with pytest.raises(Degenerate, match="singular"):
        derivatives(solver, outcome, {})
    solver = ask(robot, goal).prepare()  # least effort shares the work evenly
    outcome, _ = solver.find({})
    found = derivatives(solver, outcome, {})["target.tip"]
    np.testing.assert_allclose(found[0], found[3], rtol=1e-6)


def test_a_determined_answer_on_a_limit_is_refused():
    """Three inputs, three goals, one input at zero: a nearby goal on the wrong side is out of reach."""
    solver = ask(module(), {"tip": point(tip_of(module(), (0.6, 0.0, 0.4)))}).prepare()
    outcome, _ = solver.find({})
    if outcome.status.solved:
        with pytest.raises(Degenerate):
            derivatives(solver, outcome, {})


def test_results_say_why_there_are_no_sensitivities():
    question = touching()
    result = replace(question, sensitivities=True).solve().require()
    assert result.details["sensitivities"].startswith("none: ")
    assert "high_right" in result.details["sensitivities"]
