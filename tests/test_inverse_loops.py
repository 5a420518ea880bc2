"""Inverse statics and tensions of robots with loops: against numpy robots, the same robot without loops, and laws."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from chains import Z, four_bar, impossible_chain
from closed_plain import Closed
from scipy.optimize import minimize

import socontrol as so
from socontrol.mechanics import loops
from socontrol.mechanics.actuators import JointTorque, Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.loops import End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.joints import Free
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.programs.equilibria.closed_balance import ClosedBalance
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.plans.motion_limits import PathLimits
from socontrol.programs.postures.goals import AxisDirection, Point
from socontrol.programs.postures.goals import Path as Way
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.sensitivity import derivatives
from socontrol.programs.postures.statics import Statics
from socontrol.programs.question import Bounds, StrainBounds
from socontrol.programs.tensions.compliance import Compliance
from socontrol.programs.tensions.compliance_terms import Compliances
from socontrol.programs.tensions.redundancy import Redundancy
from socontrol.programs.tensions.tensions import Tensions
from socontrol.programs.tensions.timing import Timing

ROOT = Path(__file__).parents[1]
PRECISE = Ipopt(tolerance=1e-13)
SOFT = Linear(young_modulus=1e6, poisson_ratio=0.45, density=1100.0)


def ask(robot, goals, kind=InverseStatics, **keys):
    return kind(robot=robot, goals=goals, **{"discretisation": False, "solver": PRECISE, **keys})


def arch(**changes):
    """Two soft legs in the upright plane that lean on each other, welded at the crown; a cable in each."""
    legs = {name: Rod(length=0.1, placement=Placement((x, 0.0, 0.0), (0.0, 0.0, turn)), material=SOFT, sections=2,
                      strains="planar_constant_curvature", cross_section=Circle(radius=0.005))
            for name, x, turn in (("left", -0.04, 1.2), ("right", 0.04, np.pi - 1.2))}  # fmt: skip
    turned = Placement(rotation=(0.0, 0.0, 2.4 - np.pi))
    crown = loops.Fixed(a=End(segment="left"), b=End(segment="right", placement=turned))
    cables = {"west": Tendon(along=("left",), offset=(0.003, 0.0), limits=(0.0, 5.0)),
              "east": Tendon(along=("right",), offset=(0.003, 0.0), limits=(0.0, 5.0))}  # fmt: skip
    given = {"gravity": (0.0, -9.81, 0.0), "loops": {"crown": crown}, "actuators": cables,
             "loads": {"snow": Wrench(on="left", force=(0.02, -0.05, 0.0))}}  # fmt: skip
    return Robot(Description(segments=legs, **{**given, **changes}))


@cache
def platform():
    return so.load_robot(ROOT / "configs" / "robots" / "parallel_soft_platform.yaml")


@cache
def tilted():
    """The platform carries a payload and is turned a few degrees: question and answer."""
    payload = {"payload": Wrench(on="plate", force=(0.3, -0.1, -0.5), moment=(0.0, 0.004, 0.0))}
    goals = {"height": Point(on="plate", target=(None, None, 0.084)),
             "look": AxisDirection(on="plate", axis=Z, target=(0.06, 0.04, 1.0))}  # fmt: skip
    question = ask(platform(), goals, loads=payload)
    return question, question.solve().require()


@cache
def pushed_arch():
    question = ask(arch(), {"crown": Point(on="left", target=(0.006, None, None))}, Tensions)
    return question, question.solve().require()


ANSWERS = {"platform": tilted, "arch": pushed_arch}


# Answers


@pytest.mark.parametrize("name", ANSWERS)
def test_the_inputs_found_hold_the_posture_in_a_numpy_robot(name):
    question, result = ANSWERS[name]()
    plain, q, u = Closed(question.loaded.description), result.arrays["q"], result.arrays["u"]
    assert np.max(np.abs(plain.error(q))) < 1e-10
    elastic, external, B = plain.forces(q)
    left, largest = (np.max(np.abs(x)) for x in (elastic - external - B @ u, elastic))
    assert left < 1e-9 * largest and np.max(np.abs(elastic - external - 1.001 * B @ u)) > 1e-5 * largest


@pytest.mark.parametrize("name", ANSWERS)
def test_forward_statics_comes_to_the_goal(name):
    question, result = ANSWERS[name]()
    again = ClosedBalance(question.loaded).solve(result.arrays["u"])
    assert again.status.solved
    np.testing.assert_allclose(again.q, result.arrays["q"], atol=1e-8 * np.max(np.abs(again.q)))
    np.testing.assert_allclose(again.lam, result.arrays["lam"], atol=1e-7 * np.max(np.abs(again.lam)))


def four_cables():
    """The arch with a cable on either side of each leg, under a load that bends it."""
    sides = {"west": ("left", 0.003), "core": ("left", -0.003), "heart": ("right", -0.003), "east": ("right", 0.003)}
    cables = {name: Tendon(along=(leg,), offset=(y, 0.0), limits=(0.0, 5.0)) for name, (leg, y) in sides.items()}
    return arch(actuators=cables, loads={"gale": Wrench(on="left", at=0.5, force=(0.2, -0.1, 0.0))})


def test_least_effort_is_what_another_optimiser_finds():
    """SLSQP on the four tensions, the crown by forward statics at each trial."""
    robot = four_cables()
    balance, pose = ClosedBalance(robot), robot.functions().pose("left").function
    goal = np.array(pose(balance.solve([2.0, 1.0, 1.0, 0.5]).q))[:2, 3]
    result = ask(robot, {"crown": Point(on="left", target=(*goal.tolist(), None))}).solve().require()

    def missed(shares):
        return (np.array(pose(balance.solve(5.0 * shares, result.arrays["q"]).q))[:2, 3] - goal) * 100

    found = minimize(lambda x: x @ x / 2, 0.2 * np.ones(4), jac=lambda x: x, method="SLSQP", bounds=[(0, 1)] * 4,
                     constraints={"type": "eq", "fun": missed}, options={"ftol": 1e-13})  # fmt: skip
    assert found.success and np.sum(found.x > 1e-3) > 2, "a choice is left, and more pull than goals ask for"
    np.testing.assert_allclose(result.arrays["u"], 5.0 * found.x, atol=1e-4)


def test_a_circle_about_the_axis_of_the_platform_asks_of_each_bellows_the_same_a_third_later():
    way = {"target": {"center": [0, 0, 0.085], "radius": 0.003, "count": 6}}
    question = so.problem({"type": "tensions", "robot": platform(), "discretisation": False,
                           "goals": {"tip": {"type": "path", "on": "plate", **way}}})  # fmt: skip
    result = question.solve().require()
    u, lam = result.arrays["path.u"][:6], result.arrays["path.lam"]
    assert np.ptp(u) > 1e4
    for k in (1, 2):
        np.testing.assert_allclose(np.roll(u[:, k], -2 * k), u[:, 0], rtol=1e-7)
    assert result.residuals["loops"].value < 1e-10 and lam.shape == (7, 12)
    np.testing.assert_allclose(lam[6], lam[0], atol=1e-7 * np.max(np.abs(lam)))


def test_all_waypoints_together_cost_no_more_than_in_order_and_keep_the_loops():
    way = Way(on="left", target=tuple((x, 0, 0) for x in (-0.002, 0.002, 0.005)), axes=("x",))
    keys = {"timing": Timing(duration=2.0), "limits": PathLimits(input_rates={"west": 6.0, "east": 6.0})}
    ordered = ask(arch(), {"crown": way}, Tensions, **keys).solve().require()
    whole = ask(arch(), {"crown": way}, Tensions, **keys, together=True).solve().require()
    efforts = [np.sum(r.arrays["path.u"] ** 2) for r in (whole, ordered)]
    assert efforts[0] <= efforts[1] * (1 + 1e-9)
    assert max(r.residuals["loops"].value for r in (whole, ordered)) < 1e-10
    assert whole.arrays["path.lam"].shape == (3, 6)


def test_a_length_that_is_given_is_held_and_statics_by_lengths_comes_back():
    goal = {"crown": Point(on="left", target=(0.004, None, None))}
    question = ask(arch(), goal, Tensions, lengths={"west": 0.0985})
    result = question.solve().require()
    assert result["lengths.west"] == pytest.approx(0.0985, abs=1e-10) and result["inputs.west"] > 0.1
    lengths = {name: result[f"lengths.{name}"] for name in question.robot.inputs}
    back = Statics(robot=question.robot, lengths=lengths, discretisation=False).solve().require()
    np.testing.assert_allclose(back.arrays["u"], result.arrays["u"], atol=1e-6)


# The same robot otherwise


def rod(**changes):
    common = {"length": 0.06, "material": SOFT, "cross_section": Circle(radius=0.006), "strains": "kirchhoff_love"}
    return Rod(**{**common, **changes})


def cables(segment, to=1.0):
    angles = 2 * np.pi * np.arange(3) / 3
    return {f"c{k}": Tendon(along=(segment,), offset=(0.005 * np.cos(a), 0.005 * np.sin(a)), to=to, limits=(0.0, 10.0))
            for k, a in enumerate(angles)}  # fmt: skip


def whole():
    return Robot(Description(segments={"arm": rod(length=0.12, sections=2)}, actuators=cables("arm", 0.5)))


def cut():
    """The same rod in two, the outer half on a free joint of the world, welded to the inner."""
    halves = {"arm": rod(), "loose": Free(), "rest": rod(parent="loose")}
    weld = loops.Fixed(a=End(segment="arm"), b=End(segment="loose"))
    return Robot(Description(segments=halves, actuators=cables("arm"), loops={"weld": weld}))


@cache
def held_tip(name):
    """(solver, outcome, derivatives of the inputs) of a tip held under a load."""
    robot, tip = (whole(), "arm") if name == "whole" else (cut(), "rest")
    loads = {"weight": Wrench(on=tip, force=(0.0, 0.02, -0.05))}
    solver = ask(robot, {"tip": Point(on=tip, target=(0.113, 0.02, -0.025))}, loads=loads).prepare()
    outcome, _ = solver.find({})
    assert outcome.status.solved
    values = {path: value for path, (_, value) in solver.posture.exact.program.parameters.items()}
    return solver, outcome, derivatives(solver, outcome, values)


def test_a_rod_cut_and_welded_is_held_by_the_inputs_of_the_whole_one():
    (_, one, slopes), (_, two, others) = held_tip("whole"), held_tip("cut")
    assert np.min(one.values["u"]) > 0.1
    np.testing.assert_allclose(two.values["u"], one.values["u"], rtol=1e-9)
    for path, slope in slopes.items():  # of goal and load
        np.testing.assert_allclose(others[path], slope, atol=1e-8 * np.max(np.abs(slope)))


def test_loops_that_hold_the_same_twice_change_no_input_and_share_the_force():
    question, once = pushed_arch()
    crown = question.robot.loops["crown"]
    pin = loops.Revolute(a=crown.a, b=crown.b, axis=Z)
    robot = Robot(replace(question.robot.description, loops={"crown": crown, "pin": pin}))
    twice = replace(question, robot=robot).solve().require()
    np.testing.assert_allclose(twice.arrays["u"], once.arrays["u"], atol=1e-9)
    assert twice.details["redundant_rows"] == {"crown": 3, "pin": 5}
    alone = np.array(once["loops.crown"])
    for name in ("crown", "pin"):
        np.testing.assert_allclose(twice[f"loops.{name}"][3:], alone[3:] / 2, atol=1e-9 * np.max(np.abs(alone)))


def test_a_chain_that_rests_where_its_rows_depend_on_each_other_is_closed_where_it_goes():
    """A parallelogram that rests in one line: there only one of two rows across is its own."""
    robot = Robot(four_bar(0.1, 0.25, 0.1, 0.25, gravity=(0.0, 0.0, 0.0)))
    springs = {"crank": replace(robot.description.segments["crank"], stiffness=0.5)}
    robot = Robot(replace(robot.description, segments={**robot.description.segments, **springs}))
    question = ask(robot, {"lift": Point(on="crank", target=(None, 0.06, None))})
    assert question.prepare().posture.loops.index.size == 1
    result = question.solve().require()
    assert result.residuals["loops"].value < 1e-10
    assert result["inputs.motor"] == pytest.approx(0.5 * np.arcsin(0.6), rel=1e-9)


def test_an_answer_with_other_rows_of_the_loops_is_no_warm_start():
    goal = {"lift": Point(on="crank", target=(None, 0.06, None))}
    solver = ask(Robot(four_bar(0.1, 0.25, 0.2, 0.22)), goal).prepare()
    answer, index = solver.find({})[0], solver.posture.loops.index
    assert answer.status.solved and solver.find({}, warm=answer)[1][0].start == "neighbour"
    lam = np.zeros(5)
    lam[np.setdiff1d(np.arange(5), index)[: index.size]] = answer.values["lam"][index]
    other = replace(answer, values={**answer.values, "lam": lam})
    assert solver.find({}, warm=other)[1][0].start == "rest"


# Slopes and compliance


@pytest.mark.parametrize("axes", ["world", "body"])
def test_the_programs_own_slopes_are_those_of_its_rows(axes):
    """First and second derivatives that are made by hand, of shapes that need not be closed or in equilibrium."""
    robot = arch(loads={"push": Wrench(on="left", at=0.5, force=(0.2, -0.1, 0.0), axes=axes)})
    posture = ask(robot, {"crown": Point(on="left", target=(0.1, None, None))}).prepare().posture
    made, rng = posture.exact.functions, np.random.default_rng(0)
    (x, p, f, g), mu = (made["nlp"][key] for key in "xpfg"), ca.SX.sym("mu", made["nlp"]["g"].numel())
    plain = ca.Function("plain", [x, p, mu], [ca.jacobian(g, x), ca.hessian(f + ca.dot(mu, g), x)[0]])
    at, weights = 0.3 * rng.standard_normal(x.numel()), rng.standard_normal(mu.numel())
    numbers = posture.exact.program.stack_parameters({})
    found = made["jac_g"](at, numbers)[1], ca.triu2symm(made["hess_lag"](at, numbers, 1, weights))
    for own, wanted in zip(found, plain(at, numbers, weights), strict=True):
        assert float(ca.norm_inf(ca.vec(own - wanted))) < 1e-12 * float(ca.norm_inf(wanted))


def test_sensitivities_are_differences_of_answers_solved_again():
    question, result = tilted()
    solver = question.prepare()
    outcome, _ = solver.find({})
    values = {path: value for path, (_, value) in solver.posture.exact.program.parameters.items()}
    found = derivatives(solver, outcome, values)
    for path, k, step in (("target.height", 0, 1e-4), ("target.look", 1, 1e-3), ("loads.payload.force", 0, 1e-2)):
        change = step * np.eye(values[path].size)[k]
        low, high = (solver.find({path: values[path] + s * change}, outcome.values)[0].values["u"] for s in (-1, 1))
        assert np.max(np.abs(found[path][:, k] - (high - low) / (2 * step))) < 1e-4 * np.max(np.abs(found[path]))


def test_the_stiffest_tensions_give_way_as_statics_solved_again_says():
    goal, asked = {"crown": Point(on="left", target=(0.004, None, None))}, ((0.6, -0.8, 0.0), 0.5)
    aside = Compliance(on="left", axis=asked[0], at=asked[1], held="tensions", take="least")
    question = ask(four_cables(), goal, Tensions, compliance=aside, solver=Ipopt(starts=0))
    result = question.solve().require()
    plain = replace(question, compliance=None).solve().require()

    def given_way(q, u):
        ways, h = [], 1e-3
        for sign in (-1, 1):
            push = Wrench(on="left", at=asked[1], force=tuple(sign * h * x for x in asked[0]))
            robot = question.robot.with_loads({"push": push})
            pose = robot.functions().pose("left", asked[1]).function
            ways.append(np.array(asked[0]) @ np.array(pose(ClosedBalance(robot).solve(u, q).q))[:3, 3])
        return (ways[1] - ways[0]) / (2 * h)

    stiff, loose = (given_way(r.arrays["q"], r.arrays["u"]) for r in (result, plain))
    assert result["compliance.tensions"] == pytest.approx(stiff, rel=1e-4)
    assert result["compliance.tensions.least"] == pytest.approx(stiff, rel=1e-4) and stiff < 0.99 * loose
    assert result.residuals["goals.crown"].value < 1e-9


def test_compliances_of_closed_chains_change_as_their_gradients_say():
    asked = Compliance(on="left", axis=(0.6, -0.8, 0.0), at=0.5)
    question = ask(four_cables(), {"crown": Point(on="left", target=(0.004, 0.0900, None))}, Tensions)
    solver = question.prepare()
    outcome, attempts = solver.find({})
    family = Redundancy(solver, solver.posture.targets())
    here = family.posed(outcome.x)
    seen = solver.result(outcome, attempts, solver.posture.targets(), 0.0)
    assert here.smallest == pytest.approx(seen["stability.smallest_eigenvalue"], rel=1e-9)
    compliances, way = Compliances(solver, family, asked, here), np.array([0.5, -0.3, 0.4, 0.2])

    def moved(h):
        x = here.x.copy()
        x[family.y] += h * way
        for _ in range(6):
            x[family.q] += family.posed(x).shift
        return family.posed(x)

    for quantity in (compliances.tensions_held(1), compliances.lengths_held(1, weights=np.ones(4))):
        slope = quantity(here)[1]
        slope = (slope[family.y] + here.slopes.T @ slope[family.q]) @ way
        low, high = (quantity(moved(h))[0] for h in (-1e-4, 1e-4))
        assert slope == pytest.approx((high - low) / 2e-4, rel=1e-5) and abs(slope) > 1e-3


# What is out of reach, and what is not known


def test_a_goal_out_of_reach_names_the_limits_and_leaves_the_loops_closed():
    question, answer = pushed_arch()
    bounds = Bounds(inputs={"east": (0.0, 4.0)})
    result = replace(question, bounds=bounds, solver=Ipopt(starts=0)).solve()
    assert result.status.outcome == "infeasible"
    assert "east would need 4.981 N, its limit is 4 N" in result.status.message
    needed = {row["name"]: row["needed"] for row in result.details["unreachable"]}
    assert needed["east"] == pytest.approx(answer["inputs.east"], rel=1e-3)
    assert result.residuals["loops"].value < 1e-10


@pytest.mark.parametrize("path", [False, True])
def test_loops_that_cannot_close_are_told_before_any_goal(path):
    description, gap = impossible_chain(2)
    robot = Robot(replace(description, actuators={"motor": JointTorque(joint="bar0")}))
    at = Point(on="bar0", target=(0.01, 0.0, None))
    goal = Way(on="bar0", target=((0.01, 0, 0), (0.0, 0.01, 0)), axes=("x", "y")) if path else at
    result = ask(robot, {"tip": goal}).solve()
    assert result.status.outcome == "infeasible"
    assert f"Loop 'far' cannot close: at the nearest found its ends stay {1e3 * gap:.3g}"[:-1] in result.status.message
    assert "reach" not in result.status.message


def test_loops_that_cannot_close_within_the_limits_are_told_so():
    straight = Bounds(strains=StrainBounds(bend=0.01, stretch=(-0.01, 0.01)))
    goal = {"crown": Point(on="left", target=(0.0, None, None))}
    question = ask(arch(), goal, bounds=straight, solver=Ipopt(starts=0))
    result = question.solve()
    assert result.status.outcome == "infeasible"
    assert "Within the limits, loop 'crown' cannot close: at the nearest found its ends" in result.status.message
