"""Inverse statics: goals and costs of every kind, limits, unreachable goals, and laws every answer obeys.

Every answer is looked at in numpy: poses from matrix exponentials, and the total energy, whose slope is zero
and which rises in every direction around a stable answer.
"""

from functools import cache

import numpy as np
import pytest
from arms import PRESSURE, PULL, frame, hand, module, potential, slope, two_modules, unbalanced
from robots import Plain
from scipy.spatial.transform import Rotation

from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.postures.costs import COSTS, Effort, Reference, StrainEnergy
from socontrol.programs.postures.goals import (
    GOALS,
    AxisDirection,
    Curvature,
    CurvaturePoint,
    Path,
    Point,
    Pose,
    PoseTarget,
    Shape,
    ShapePoint,
)
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.waypoints import Circle, FigureEight, Polygon
from socontrol.programs.question import Bounds, Guess
from socontrol.quantities import Bad

SHARES = (0.5, 0.2, 0.1, 0.3, 0.1, 0.4)  # of the full pressure


def ask(robot, goals, **keys):
    return InverseStatics(robot=robot, goals=goals, **{"discretisation": False, **keys})


def forward(robot, u, **keys):
    answer = Balance(robot).solve(u, **keys)
    assert answer.status.solved
    return answer.q


@cache
def tip_of(shape, *shares):
    """(robot, u, q, tip pose) of inputs at these shares of the full pressure."""
    robot = {"one": module, "two": two_modules}[shape]()
    u = PRESSURE * np.array(shares)
    q = forward(robot, u)
    return robot, u, q, frame(robot, q, "cap")


def target_pose(g):
    rotation = Rotation.from_matrix(g[:3, :3]).as_rotvec()
    return PoseTarget(position=tuple(g[:3, 3].tolist()), rotation=tuple(rotation.tolist()))


def point(g, **keys):
    return Point(on="cap", target=tuple(g[:3, 3].tolist()), **keys)


def assert_trustworthy(result):
    """Solved, within limits, balanced on independent paths, and, where called stable, of least energy."""
    result.require()
    robot, q, u = result.question.loaded, result.arrays["q"], result.arrays["u"]
    lower, upper = result.question.input_limits()
    span = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    assert np.all(u >= lower - 1e-8 * span) and np.all(u <= upper + 1e-8 * span)
    lower, upper = result.question.coordinate_limits()
    assert np.all(q >= lower - 1e-8) and np.all(q <= upper + 1e-8)
    if result.question.coordinates:
        return
    assert unbalanced(robot, q, u) < 1e-8
    if any(unit == "N m" for unit in robot.input_units):
        return
    assert slope(robot, q, u) < 1e-6
    energy, s = potential(robot, u), scales(robot).q
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(20, len(q))) * s * 1e-3
    around = energy(q + steps) + energy(q - steps) - 2 * energy(q)
    if result.details["stable"]:
        assert np.all(around > 0)
    else:
        assert np.any(around < 0)


# Goals


def full_point():
    robot, _, _, g = tip_of("one", 0.6, 0.1, 0.3)
    return robot, {"tip": point(g)}


def partial_point():
    return module(), {"tip": Point(on="cap", target=(None, 0.006, -0.004))}


def inner_point():
    robot, _, q, _ = tip_of("two", *SHARES)
    place = frame(robot, q, "high", 0.3)[:3, 3]
    return robot, {"mid": Point(on="high", at=0.3, target=tuple(place.tolist()))}


def pose():
    robot, _, _, g = tip_of("two", *SHARES)
    return robot, {"tip": Pose(on="cap", target=target_pose(g))}


def axis():
    return module(), {"look": AxisDirection(on="cap", target=(1.0, 0.2, -0.3))}


def side_axis():
    goal = AxisDirection(on="high", at=0.5, axis=(0.0, 1.0, 0.0), target=(0.3, 1.0, 0.1))
    return two_modules(), {"look": goal}


def shape():
    robot, _, q, _ = tip_of("two", *SHARES)
    aside = 1e-3 * np.sin([1, 2, 3])
    places = [(X, frame(robot, q, "high", X)[:3, 3] + aside) for X in (0.25, 0.5, 1.0)]
    points = tuple(ShapePoint(at=X, position=tuple(place.tolist())) for X, place in places)
    return robot, {"line": Shape(on="high", target=points, weight=1e4)}


def curvature():
    robot, _, q, _ = tip_of("one", 0.6, 0.1, 0.3)
    names = robot.coordinates
    bends = {bend: float(q[names.index(f"low.1.{bend}")]) for bend in ("bend_y", "bend_z")}
    return robot, {"bend": Curvature(on="low", target=(CurvaturePoint(at=0.75, **bends),))}


def several():
    robot, _, q, g = tip_of("two", *SHARES)
    return robot, {
        "tip": point(g),
        "look": AxisDirection(on="cap", target=tuple(g[:3, 0].tolist())),
        "near": Point(on="low", target=(0.05, None, None), weight=0.1),
    }


def path():
    robot, _, _, g = tip_of("two", *SHARES)
    points = tuple(tuple((g[:3, 3] + [0, y, 0]).tolist()) for y in (0, 1e-3))
    return robot, {"trip": Path(on="cap", target=points)}


QUESTIONS = {
    "full_point": full_point,
    "partial_point": partial_point,
    "inner_point": inner_point,
    "pose": pose,
    "axis": axis,
    "side_axis": side_axis,
    "shape": shape,
    "curvature": curvature,
    "several": several,
    "path": path,
}


@cache
def answered(name):
    robot, goals = QUESTIONS[name]()
    return ask(robot, goals).solve()


def missed(goal, robot, q):
    """Largest miss of a goal in metres or radians, in numpy."""
    if isinstance(goal, Shape):
        return max(np.linalg.norm(frame(robot, q, goal.on, p.at)[:3, 3] - p.position) for p in goal.target)
    if isinstance(goal, Curvature):
        names = robot.coordinates
        return max(abs(q[names.index("low.1.bend_y")] - goal.target[0].bend_y),
                   abs(q[names.index("low.1.bend_z")] - goal.target[0].bend_z))  # fmt: skip
    if isinstance(goal, Path):
        return np.linalg.norm(frame(robot, q, goal.on, goal.at)[:3, 3] - goal.waypoints()[-1])
    g = frame(robot, q, goal.on, goal.at)
    if isinstance(goal, Point):
        return max(abs(g[i, 3] - x) for i, x in enumerate(goal.target) if x is not None)
    if isinstance(goal, Pose):
        turn = Rotation.from_rotvec(goal.target.rotation).inv() * Rotation.from_matrix(g[:3, :3])
        return max(np.abs(g[:3, 3] - goal.target.position).max(), turn.magnitude())
    direction, wanted = g[:3, :3] @ goal.axis, np.array(goal.target) / np.linalg.norm(goal.target)
    return np.linalg.norm(direction - wanted)


def test_every_kind_of_goal_and_cost_is_asked_for():
    asked = {type(goal) for name in QUESTIONS for goal in QUESTIONS[name]()[1].values()}
    assert asked == set(GOALS.values())
    assert {type(cost) for cost in PRICES.values()} == set(COSTS.values())


@pytest.mark.parametrize("name", QUESTIONS)
def test_goals_without_a_weight_are_met(name):
    result = answered(name)
    assert_trustworthy(result)
    for goal in result.question.goals.values():
        if goal.weight is None:
            robot = result.question.loaded
            assert missed(goal, robot, result.arrays["q"]) < 1e-7 * robot.length


@pytest.mark.parametrize("name", ["shape", "several"])
def test_weighted_goals_stand_at_a_minimum_of_miss_and_effort(name):
    """No feasible neighbour is better: other inputs held where they are, one moved, the goals met again."""
    result = answered(name)
    robot, goals = QUESTIONS[name]()
    weighted = {n: goal for n, goal in goals.items() if goal.weight is not None}

    def miss(goal, q):
        """Sum of squares [m^2]."""
        if isinstance(goal, Point):
            return (frame(robot, q, goal.on, goal.at)[0, 3] - goal.target[0]) ** 2
        return sum(((frame(robot, q, goal.on, p.at)[:3, 3] - p.position) ** 2).sum() for p in goal.target)

    def price(q, u):
        misses = sum(goal.weight * miss(goal, q) for goal in weighted.values())
        return misses / robot.length**2 / 2 + ((u / PRESSURE) ** 2).sum() / 2

    least = price(result.arrays["q"], result.arrays["u"])
    for i, change in ((0, 2e-3), (4, -2e-3)):
        u = result.arrays["u"][i] + change * PRESSURE
        other = ask(robot, goals, inputs={robot.inputs[i]: float(np.clip(u, 0, PRESSURE))}).solve().require()
        assert price(other.arrays["q"], other.arrays["u"]) >= least - 1e-9


def test_an_axis_goal_is_not_met_by_the_opposite_direction():
    goal = AxisDirection(on="cap", target=(-1.0, 0.0, 0.0))
    result = ask(module(), {"look": goal}, solver=Ipopt(starts=0)).solve()
    assert not result.status.solved or frame(result.question.robot, result.arrays["q"], "cap")[0, 0] < -0.99


@pytest.mark.parametrize("target", [(1.0, -0.3, 0.1), (1.0, 0.2, -0.3), (1.0, 0.3, 0.3)])
def test_a_prepared_question_meets_other_directions_than_the_declared_one(target):
    wanted = np.array(target) / np.linalg.norm(target)
    result = _solver_axis().solve({"target.look": wanted}).require()
    np.testing.assert_allclose(frame(module(), result.arrays["q"], "cap")[:3, 0], wanted, rtol=0, atol=1e-7)


@cache
def _solver_axis():
    return ask(module(), {"look": AxisDirection(on="cap", target=(1.0, 0.2, -0.3))}).prepare()


# Costs


PRICES = {
    "effort": Effort(),
    "reference": Reference(inputs={"low_up": 60e3, "high_left": 30e3}, coordinates={"low.0.bend_y": 2.0}),
    "strain_energy": StrainEnergy(),
}


def price(robot, cost, q, u):
    """The cost as its docstring says, in numpy."""
    if isinstance(cost, Effort):
        return ((u / PRESSURE) ** 2).sum() / 2
    if isinstance(cost, Reference):
        misses = [(u[robot.inputs.index(n)] - x) / PRESSURE for n, x in cost.inputs.items()]
        for name, x in cost.coordinates.items():
            i = robot.coordinates.index(name)
            misses.append((q[i] - x) / scales(robot).q[i])
        return np.square(misses).sum() / 2
    return Plain(robot.description).elastic_energy(q) / scales(robot).energy


@pytest.mark.parametrize("kind", PRICES)
def test_the_answer_costs_no_more_than_its_neighbours_that_meet_the_goal(kind):
    """Six inputs for three coordinates of the tip: three of them are drawn, the others found."""
    robot, _, _, g = tip_of("two", *SHARES)
    best = ask(robot, {"tip": point(g)}, costs={"c": PRICES[kind]}).solve()
    assert_trustworthy(best)
    least = price(robot, PRICES[kind], best.arrays["q"], best.arrays["u"])
    rng = np.random.default_rng(3)
    for size in (0.003, 0.03, 0.1):
        chosen = rng.choice(6, size=3, replace=False)
        u = np.clip(best.arrays["u"][chosen] + size * PRESSURE * rng.uniform(-1, 1, 3), 0, PRESSURE)
        held = {robot.inputs[i]: float(x) for i, x in zip(chosen, u, strict=True)}
        other = ask(robot, {"tip": point(g)}, inputs=held, solver=Ipopt(starts=0)).solve()
        if other.status.solved:
            assert price(robot, PRICES[kind], other.arrays["q"], other.arrays["u"]) >= least - 1e-9


def test_costs_pull_the_answer_in_different_directions():
    robot, _, _, g = tip_of("two", *SHARES)
    answers = {kind: ask(robot, {"tip": point(g)}, costs={"c": PRICES[kind]}).solve() for kind in PRICES}
    for kind, cost in PRICES.items():
        if kind != "strain_energy":
            found = {k: answer.require().arrays for k, answer in answers.items()}
            prices = {k: price(robot, cost, x["q"], x["u"]) for k, x in found.items()}
            assert min(prices, key=prices.get) == kind
            assert sorted(prices.values())[1] > prices[kind] + 1e-4


def test_a_reference_that_meets_the_goal_is_the_answer():
    robot, u, q, g = tip_of("two", *SHARES)
    reference = Reference(inputs=dict(zip(robot.inputs, u.tolist(), strict=True)))
    result = ask(robot, {"tip": point(g)}, costs={"c": reference}).solve().require()
    np.testing.assert_allclose(result.arrays["u"], u, rtol=0, atol=1e-5 * PRESSURE)
    np.testing.assert_allclose(result.arrays["q"] / scales(robot).q, q / scales(robot).q, rtol=0, atol=1e-5)


# Given values and bounds


def test_given_inputs_are_kept():
    robot, _, _, g = tip_of("two", *SHARES)
    result = ask(robot, {"tip": point(g)}, inputs={"low_left": 40e3, "high_up": 20e3}).solve()
    assert_trustworthy(result)
    assert result["inputs.low_left"] == pytest.approx(40e3, abs=1e-6)
    assert result["inputs.high_up"] == pytest.approx(20e3, abs=1e-6)


def test_a_given_coordinate_is_kept_and_its_holding_force_is_what_is_missing():
    robot = hand()
    goal = {"tip": Point(on="finger", target=(0.45, None, -0.2))}
    result = ask(robot, goal, coordinates={"fore": 0.4}, inputs={"elbow": 0.0}).solve()
    assert_trustworthy(result)
    assert result.arrays["q"][1] == pytest.approx(0.4, abs=1e-12)
    motors = {**{n: float(x) for n, x in zip(robot.inputs, result.arrays["u"], strict=True)}}
    motors["elbow"] = result["holding.fore"]
    q = forward(robot, np.array(list(motors.values())), q0=result.arrays["q"] + 0.01 * scales(robot).q)
    np.testing.assert_allclose(q / scales(robot).q, result.arrays["q"] / scales(robot).q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(frame(robot, q, "finger")[[0, 2], 3], [0.45, -0.2], rtol=0, atol=1e-7)


def test_bounds_of_the_problem_hold_beside_the_robot_s():
    robot, _, _, g = tip_of("two", *SHARES)
    free = ask(robot, {"tip": point(g)}).solve().require()
    top = max(robot.inputs, key=lambda n: free[f"inputs.{n}"])
    lid = 0.9 * free[f"inputs.{top}"]
    bounded = ask(robot, {"tip": point(g)}, bounds=Bounds(inputs={top: (0.0, lid)})).solve()
    assert_trustworthy(bounded)
    assert bounded[f"inputs.{top}"] == pytest.approx(lid, rel=1e-5)
    assert any(row["name"] == top and row["side"] == "upper" for row in bounded.details["limits"])
    efforts = [((r.arrays["u"] / PRESSURE) ** 2).sum() for r in (free, bounded)]
    assert efforts[1] > efforts[0]


def test_bounds_of_a_coordinate_hold():
    robot = hand()
    goal = {"tip": Point(on="finger", target=(0.45, None, -0.2))}
    free = ask(robot, goal).solve().require()
    lid = free.arrays["q"][0] - 0.02
    bounded = ask(robot, goal, bounds=Bounds(coordinates={"upper": (-1.0, float(lid))})).solve()
    assert_trustworthy(bounded)
    assert bounded.arrays["q"][0] == pytest.approx(lid, abs=1e-7)
    assert "upper" in [row["name"] for row in bounded.details["limits"]]


def test_bounds_wider_than_the_robot_s_change_nothing():
    wide = Bounds(inputs={n: (-1e9, 1e9) for n in module().inputs})
    result = ask(module(), {"tip": Point(on="cap", target=FAR["aside"])}, bounds=wide).solve()
    assert result.status.exit_code == 4
    expected = unreached("aside").arrays["u"]
    np.testing.assert_allclose(result.arrays["u"], expected, rtol=0, atol=1e-6 * PRESSURE)


@pytest.mark.parametrize(
    ("keys", "path", "hint"),
    [
        ({"goals": {}}, "goals", "at least one"),
        ({"goals": {"tip": Point(on="cup", target=(0, 0, 0))}}, "goals.tip.on", "did you mean 'cap'"),
        ({"goals": {"tip": Point(on="cap", at=0.5, target=(0, 0, 0))}}, "goals.tip.at", "0.5"),
        ({"inputs": {"low_u": 1.0}}, "inputs.low_u", "did you mean 'low_up'"),
        ({"bounds": Bounds(inputs={"low_up": (5.0, 1.0)})}, "bounds.inputs.low_up", "no value is left"),
    ],
)
def test_questions_that_make_no_sense_are_refused_with_a_path(keys, path, hint):
    goals = {"tip": Point(on="cap", target=(0.06, 0.0, 0.0))}
    with pytest.raises(Bad) as refused:
        ask(module(), **{"goals": goals, **keys})
    assert refused.value.key == path
    assert hint in str(refused.value)


# There and back


@pytest.mark.parametrize("seed", range(4))
def test_inputs_that_determine_the_tip_are_found_again(seed):
    """Three pressures for three coordinates, from rest and without knowing them."""
    shares = np.random.default_rng(seed).uniform(0.02, 0.98, 3)
    robot, u, q, g = tip_of("one", *shares)
    result = _solver_one().solve({"target.tip": g[:3, 3]})
    result.require()
    np.testing.assert_allclose(result.arrays["u"], u, rtol=0, atol=1e-6 * PRESSURE)
    np.testing.assert_allclose(result.arrays["q"] / scales(robot).q, q / scales(robot).q, rtol=0, atol=1e-6)


@cache
def _solver_one():
    return ask(module(), {"tip": Point(on="cap", target=(0.06, 0.0, 0.0))}).prepare()


@cache
def _solver_two():
    return ask(two_modules(), {"tip": Point(on="cap", target=(0.11, 0.0, 0.0))}).prepare()


@pytest.mark.parametrize("seed", range(4))
def test_a_redundant_robot_reaches_its_own_tips_with_no_more_effort(seed):
    shares = np.random.default_rng(seed).uniform(0.0, 1.0, 6)
    robot, u, _, g = tip_of("two", *shares)
    result = _solver_two().solve({"target.tip": g[:3, 3]})
    assert_trustworthy(result)
    assert np.linalg.norm(frame(robot, result.arrays["q"], "cap")[:3, 3] - g[:3, 3]) < 1e-7
    assert (result.arrays["u"] ** 2).sum() <= (u**2).sum() * (1 + 1e-9)


def test_a_load_on_the_tip_is_carried():
    robot = module()
    goals = {"tip": point(tip_of("one", 0.5, 0.3, 0.4)[3])}
    bare, loaded = ask(robot, goals).solve(), ask(robot, goals, loads=PULL).solve()
    assert_trustworthy(loaded)
    assert np.abs(loaded.arrays["u"] - bare.arrays["u"]).max() > 1e3


# Paths


def middle():
    """Tip at half pressure everywhere, from where it can go anywhere."""
    return tip_of("two", *[0.5] * 6)[3][:3, 3]


def circle(count):
    along, side = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    return Circle(center=tuple(middle()), radius=0.004, normal=along, start=side, count=count)


def around(*offsets):
    return tuple(tuple((middle() + offset).tolist()) for offset in offsets)


TRIPS = {
    "circle": lambda: circle(6),
    "eight": lambda: FigureEight(
        center=tuple(middle()), width=8e-3, height=4e-3, normal=(1.0, 0.0, 0.0), start=(0.0, 1.0, 0.0), count=6
    ),
    "polygon": lambda: Polygon(corners=around([0, 4e-3, 0], [0, -4e-3, 0], [0, 0, -6e-3]), spacing=0.005),
    "points": lambda: around([0, 0, -2e-3], [1e-3, 2e-3, -2e-3], [1e-3, 4e-3, 0]),
}


@pytest.mark.parametrize("name", TRIPS)
def test_a_path_from_neighbour_to_neighbour_equals_cold_solves(name):
    robot = two_modules()
    trip = Path(on="cap", target=TRIPS[name]())
    result = ask(robot, {"trip": trip}).solve().require()
    arrays = result.arrays
    assert len(arrays["path.u"]) == len(trip.waypoints()) == result.details["waypoints"]
    for waypoint, q, u in zip(trip.waypoints(), arrays["path.q"], arrays["path.u"], strict=True):
        cold = _solver_two().solve({"target.tip": waypoint}).require()
        np.testing.assert_allclose(u, cold.arrays["u"], rtol=0, atol=1e-5 * PRESSURE)
        assert np.linalg.norm(frame(robot, q, "cap")[:3, 3] - waypoint) < 1e-7 * robot.length
    assert result.residuals["goals.trip"].value < 1e-7 * robot.length
    assert result.residuals["force"].value < 1e-8


def test_a_closed_path_returns_to_its_first_inputs():
    u = ask(two_modules(), {"trip": Path(on="cap", target=circle(5))}).solve().require().arrays["path.u"]
    np.testing.assert_allclose(u[-1], u[0], rtol=0, atol=1e-6 * PRESSURE)


def test_a_path_with_an_orientation_holds_it():
    robot, _, _, g = tip_of("two", *[0.5] * 6)
    rotation = target_pose(g).rotation
    points = around([0, 0, 0], [2e-4, 0, 0], [5e-4, 0, 0])
    result = ask(robot, {"trip": Path(on="cap", target=points, orientation=rotation)}).solve().require()
    for q, p in zip(result.arrays["path.q"], points, strict=True):
        reached = frame(robot, q, "cap")
        np.testing.assert_allclose(reached[:3, :3], g[:3, :3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(reached[:3, 3], p, rtol=0, atol=1e-7)


def test_a_path_that_leaves_the_workspace_stops_there_and_says_where():
    points = around([0, 0, 0], [0, 0, -2e-3], [0, 0.1, 0], [0, 0, 0])
    result = ask(two_modules(), {"trip": Path(on="cap", target=points)}, solver=Ipopt(starts=1)).solve()
    assert result.status.exit_code == 4
    assert result.status.message.startswith("Waypoint 3 of 4")
    assert len(result.arrays["path.u"]) == 2
    np.testing.assert_allclose(result.arrays["path.tip"], points[:2], rtol=0, atol=1e-7)


# Out of reach


FAR = {
    "ahead": (0.12, 0.0, 0.0),
    "aside": (0.05, 0.05, 0.0),
    "just": (0.066, 0.025, 0.0),
    "behind": (-0.05, 0.0, 0.02),
}


@cache
def unreached(name):
    return ask(module(), {"tip": Point(on="cap", target=FAR[name])}).solve()


@cache
def reachable():
    """Fifty tips of random pressures, and the corners of the box of pressures."""
    robot, rng = module(), np.random.default_rng(8)
    balance = Balance(robot)
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    tips = []
    for u in PRESSURE * np.vstack([rng.uniform(0, 1, (50, 3)), corners]):
        answer = balance.solve(u)
        assert answer.status.solved
        tips.append(frame(robot, answer.q, "cap")[:3, 3])
    return np.array(tips)


@pytest.mark.parametrize("name", FAR)
def test_a_goal_out_of_reach_gives_the_nearest_pose_and_exit_4(name):
    result = unreached(name)
    assert result.status.outcome == "infeasible"
    assert result.status.exit_code == 4
    assert "Out of reach" in result.status.message
    robot, q, u = result.question.loaded, result.arrays["q"], result.arrays["u"]
    assert unbalanced(robot, q, u) < 1e-8
    distance = np.linalg.norm(frame(robot, q, "cap")[:3, 3] - FAR[name])
    assert distance == pytest.approx(result.values["short.tip"].value, rel=1e-9)
    assert np.all(np.linalg.norm(reachable() - FAR[name], axis=1) > distance - 1e-9)
    assert np.all(u > -1e-6 * PRESSURE) and np.all(u < (1 + 1e-6) * PRESSURE)


@pytest.mark.parametrize("name", FAR)
def test_the_nearest_pose_is_a_local_minimum_of_the_distance(name):
    """Projected slope: no input off its limit can bring the tip nearer."""
    result = unreached(name)
    robot, u, q = result.question.loaded, result.arrays["u"], result.arrays["q"]
    balance, distances = Balance(robot), []
    limits = {(row["name"], row["side"]) for row in result.details["unreachable"]}
    here = np.linalg.norm(frame(robot, q, "cap")[:3, 3] - FAR[name])
    for i, input_ in enumerate(robot.inputs):
        for side, step in (("upper", 1e-3), ("lower", -1e-3)):
            if (input_, side) not in limits:
                answer = balance.solve(u + step * PRESSURE * np.eye(3)[i], q)
                distances.append(np.linalg.norm(frame(robot, answer.q, "cap")[:3, 3] - FAR[name]))
    assert np.all(np.array(distances) > here - 1e-9)


def with_limit(robot, name, side, limit):
    """The robot with one limit of one input moved."""
    limits = list(robot.value(f"actuators.{name}.limits"))
    limits[side == "upper"] = limit
    return Robot(robot.with_values({f"actuators.{name}.limits": tuple(limits)}).description)


def rows():
    return [(name, i) for name in FAR for i in range(3)]


@pytest.mark.parametrize(("name", "i"), rows())
def test_a_limit_moved_as_far_as_said_makes_the_goal_reachable_and_no_less_does(name, i):
    rows = unreached(name).details["unreachable"]
    if i >= len(rows):
        return
    row, robot = rows[i], module()
    goal = {"tip": Point(on="cap", target=FAR[name])}
    if row["needed"] is None:
        sign = 1 if row["side"] == "upper" else -1
        lifted = with_limit(robot, row["name"], row["side"], sign * 30 * PRESSURE)
        assert not ask(lifted, goal, solver=Ipopt(starts=0)).solve().status.solved
        return
    gap = row["needed"] - row["limit"]
    enough = with_limit(robot, row["name"], row["side"], row["limit"] + 1.001 * gap)
    assert_trustworthy(ask(enough, goal).solve())
    short = with_limit(robot, row["name"], row["side"], row["limit"] + 0.98 * gap)
    assert ask(short, goal, solver=Ipopt(starts=0)).solve().status.exit_code == 4


def test_sentences_say_each_case():
    messages = " ".join(unreached(name).status.message for name in FAR)
    assert "no way found by this limit alone" in messages
    assert "alone it would have to be" in messages
    assert "limit 140 kPa" in messages
    assert "mm" in messages


def test_a_joint_limit_is_named_with_where_it_would_have_to_be():
    robot = hand(limits=(-0.3, 0.3), torque=(-50.0, 50.0))
    angles = np.cumsum([0.8, 0.5])
    x, z = 0.2 * np.cos(angles).sum(), -0.2 * np.sin(angles).sum()
    goal = {"tip": Point(on="finger", at=0.0, target=(float(x), None, float(z)))}  # end of the second link
    result = ask(robot, goal).solve()
    assert result.status.exit_code == 4
    by_name = {row["name"]: row for row in result.details["unreachable"]}
    assert by_name["fore"]["kind"] == "coordinate" or by_name["upper"]["kind"] == "coordinate"
    for row in by_name.values():
        if row["kind"] == "coordinate" and row["needed"] is not None:
            limits = (-0.3, row["needed"] + 1e-6) if row["side"] == "upper" else (row["needed"] - 1e-6, 0.3)
            moved = Robot(robot.with_values({f"{row['name']}.limits": limits}).description)
            assert_trustworthy(ask(moved, goal).solve())
    assert "deg" in result.status.message


def test_a_goal_beyond_all_geometry_names_no_limit():
    robot = hand(limits=(-3.0, 3.0), torque=(-1e3, 1e3))
    result = ask(robot, {"tip": Point(on="finger", at=0.0, target=(2.0, None, 0.0))}).solve()
    assert result.status.exit_code == 4
    assert "No limit is reached" in result.status.message
    assert result.values["short.tip"].value == pytest.approx(2.0 - 2 * 0.2, abs=1e-6)  # links stretched out


def test_a_goal_out_of_the_plane_of_a_plane_robot_is_out_of_reach():
    goal = {"tip": Point(on="finger", target=(None, 0.1, None))}
    result = ask(hand(), goal, solver=Ipopt(starts=1)).solve()
    assert result.status.exit_code == 4
    assert result.values["short.tip"].value == pytest.approx(0.1, abs=1e-9)


def test_a_solve_from_a_far_guess_still_ends_at_the_answer():
    robot, goals = QUESTIONS["full_point"]()
    start = Guess(inputs={"low_up": 0.0, "low_left": PRESSURE, "low_right": PRESSURE})
    result = ask(robot, goals, guess=start).solve().require()
    expected = answered("full_point").arrays["u"]
    np.testing.assert_allclose(result.arrays["u"], expected, rtol=0, atol=1e-5 * PRESSURE)


# Laws


ROTATION = Rotation.from_rotvec([0.7, -1.1, 0.4])
SHIFT = np.array([0.3, -0.2, 0.5])


def moved(vector, free=False):
    return tuple((ROTATION.apply(vector) + (0 if free else SHIFT)).tolist())


def test_inputs_do_not_change_when_robot_gravity_loads_and_goal_turn_together():
    loaded = two_modules().with_loads(PULL)
    g, force = frame(loaded, forward(loaded, PRESSURE * np.array(SHARES)), "cap"), PULL["pull"].force
    here = ask(two_modules(), {"tip": Pose(on="cap", target=target_pose(g))}, loads=PULL).solve().require()
    placement = Placement(position=tuple(SHIFT.tolist()), rotation=tuple(ROTATION.as_rotvec().tolist()))
    there = two_modules(placement=placement, gravity=moved((0.0, 0.0, -9.81), free=True))
    G = np.eye(4)
    G[:3, :3], G[:3, 3] = ROTATION.as_matrix(), SHIFT
    load = {"pull": Wrench(on="cap", force=moved(force, free=True))}
    turned = ask(there, {"tip": Pose(on="cap", target=target_pose(G @ g))}, loads=load).solve().require()
    np.testing.assert_allclose(turned.arrays["u"], here.arrays["u"], rtol=0, atol=1e-6 * PRESSURE)
    s = scales(two_modules()).q
    np.testing.assert_allclose(turned.arrays["q"] / s, here.arrays["q"] / s, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("length", "force"), [(1e3, 1.0), (1e3, 1e3), (1 / 0.0254, 1 / 4.448), (0.01, 1e-4)])
def test_inputs_are_the_same_pressures_in_any_units(length, force):
    """Millimetres, millinewtons, inches and pounds: pressures scale by force over length squared."""
    g = tip_of("two", *SHARES)[3]
    si = _solver_two().solve({"target.tip": g[:3, 3]}).require()
    pressure = force / length**2
    robot = two_modules(length=length, force=force)
    other = ask(robot, {"tip": Point(on="cap", target=tuple((length * g[:3, 3]).tolist()))}).solve().require()
    np.testing.assert_allclose(other.arrays["u"] / pressure, si.arrays["u"], rtol=0, atol=1e-6 * PRESSURE)
    bend = np.array([unit == "1/m" for unit in robot.coordinate_units])
    s = scales(two_modules()).q
    q = other.arrays["q"] * np.where(bend, length, 1.0)
    np.testing.assert_allclose(q / s, si.arrays["q"] / s, rtol=0, atol=1e-6)
    assert other.details["stable"] == si.details["stable"]
    eigenvalue = "stability.smallest_eigenvalue"
    assert other[eigenvalue] == pytest.approx(si[eigenvalue], rel=1e-6)


def test_forward_statics_does_not_depend_on_units_either():
    u = PRESSURE * np.array(SHARES)
    q = forward(two_modules(), u)
    mm = two_modules(length=1e3)
    bend = np.array([unit == "1/m" for unit in mm.coordinate_units])
    np.testing.assert_allclose(forward(mm, u * 1e-6) * np.where(bend, 1e3, 1.0), q, rtol=1e-9, atol=1e-9)


def test_relabelled_actuators_give_the_permuted_answer():
    g = tip_of("two", *SHARES)[3]
    robot = two_modules()
    order = [3, 0, 5, 1, 4, 2]
    names = [robot.inputs[i] for i in order]
    actuators = {name: robot.description.actuators[name] for name in names}
    other = Robot(Description(**{**vars(robot.description), "actuators": actuators}))
    first, second = (ask(r, {"tip": point(g)}).solve().require() for r in (robot, other))
    assert other.inputs == tuple(names)
    np.testing.assert_allclose(second.arrays["u"], first.arrays["u"][order], rtol=0, atol=1e-6 * PRESSURE)


def test_a_mirrored_goal_exchanges_the_mirrored_chambers():
    """Weight lies in the mirror plane y = 0; left and right change places, up stays."""
    g = tip_of("one", 0.6, 0.1, 0.3)[3]
    one = _solver_one().solve({"target.tip": g[:3, 3]}).require()
    other = _solver_one().solve({"target.tip": g[:3, 3] * [1, -1, 1]}).require()
    up, left, right = one.arrays["u"]
    np.testing.assert_allclose(other.arrays["u"], [up, right, left], rtol=0, atol=1e-6 * PRESSURE)


def test_a_goal_in_the_mirror_plane_needs_equal_mirrored_pressures():
    g = tip_of("one", 0.6, 0.2, 0.2)[3]
    assert abs(g[1, 3]) < 1e-12
    up, left, right = _solver_one().solve({"target.tip": g[:3, 3]}).require().arrays["u"]
    assert left == pytest.approx(right, abs=1e-6 * PRESSURE)
    assert up == pytest.approx(0.6 * PRESSURE, abs=1e-6 * PRESSURE)


def test_the_same_question_gives_the_same_numbers_twice():
    robot, goals = QUESTIONS["pose"]()
    again = ask(robot, goals).solve()
    np.testing.assert_array_equal(again.arrays["u"], answered("pose").arrays["u"])
    np.testing.assert_array_equal(again.arrays["q"], answered("pose").arrays["q"])
