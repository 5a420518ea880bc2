"""Compliance and redundancy: how far a tip gives way, how far co-contraction changes that, and what least tension is.

A hinge between two cables is known in closed form: with lengths l(theta) of its cables,
    k theta + sum T l' = 0,   K = k + sum T l'',   C = b^2 / K,   and K + sum l'^2 (EA + T) / l with lengths held.
Soft arms are looked at by statics solved again under a small force, with tensions or with lengths held.
"""

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from socontrol.mechanics.actuators import Chamber, Converging, Tendon
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.joints import Revolute
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.nlp.solver import Ipopt
from socontrol.programs.postures.goals import Point
from socontrol.programs.question import Bounds
from socontrol.programs.tensions.compliance import Compliance
from socontrol.programs.tensions.compliance_terms import Compliances
from socontrol.programs.tensions.redundancy import STANDING, Redundancy
from socontrol.programs.tensions.tensions import Tensions
from socontrol.quantities import Bad

ROOT = Path(__file__).parent.parent
HELD, ENDS = ("tensions", "lengths"), ("least", "greatest")


def asked(robot, target, compliance, **keys):
    goal = Point(on=compliance.on, target=target)
    keys = {"solver": Ipopt(starts=1), "discretisation": False, **keys}
    return Tensions(robot=robot, goals={"tip": goal}, compliance=compliance, **keys)


def ends(result, held):
    return [result[f"compliance.{held}.{end}"] for end in ENDS]


# A hinge between two cables

ARM, STRENGTH, SPRING, BEND = 0.1, 200.0, 0.05, 0.6
CABLES = {"near": 1, "far": -1}


def hinge(stiffness=SPRING, offsets=(0.02, 0.02), rigidity=STRENGTH):
    """A link along x on a hinge about z, with a cable on each side."""
    link = Revolute(axis=(0.0, 0.0, 1.0), stiffness=stiffness, tip=Placement((ARM, 0.0, 0.0)))
    cables = {
        name: Tendon(along=("link",), offset=Converging(start=(s * offsets[0], 0.0), end=(s * offsets[1], 0.0)),
                     limits=(0.0, 20.0), stiffness=rigidity)
        for name, s in CABLES.items()
    }  # fmt: skip
    return Robot(Description(segments={"link": link}, actuators=cables, gravity=(0.0, 0.0, 0.0)))


def cable(side, angle, offset=0.02):
    """Length of a hinge's cable and its two derivatives in the angle."""
    half = ARM**2 / 2 + offset**2 * (1 - np.cos(angle)) - side * offset * ARM * np.sin(angle)
    first = offset**2 * np.sin(angle) - side * offset * ARM * np.cos(angle)
    second = offset**2 * np.cos(angle) + side * offset * ARM * np.sin(angle)
    length = np.sqrt(2 * half)
    slope = first / length
    return length, slope, (second - slope**2) / length


def hinge_compliances(others, offsets=None):
    """Tension of the near cable, C with tensions held and with lengths held, at the angle BEND; `others`: {name: T}."""
    offsets = offsets or {name: 0.02 * side for name, side in CABLES.items()}
    lines = {name: cable(np.sign(offset), BEND, abs(offset)) for name, offset in offsets.items()}
    near = -(SPRING * BEND + sum(T * lines[name][1] for name, T in others.items())) / lines["near"][1]
    tensions = {"near": near, **others}
    tangent = SPRING + sum(T * lines[name][2] for name, T in tensions.items())
    held = sum((T > 0) * lines[name][1] ** 2 * (STRENGTH + T) / lines[name][0] for name, T in tensions.items())
    return near, (ARM * np.cos(BEND)) ** 2 / tangent, (ARM * np.cos(BEND)) ** 2 / (tangent + held)


@cache
def solved_hinge(held="lengths", take="least_tension"):
    compliance = Compliance(on="link", axis=(0.0, 1.0, 0.0), held=held, take=take)
    return asked(hinge(), (None, ARM * float(np.sin(BEND)), None), compliance).solve().require()


def hinge_grid():
    far = np.linspace(0.0, 20.0, 4001)
    near, *found = hinge_compliances({"far": far})
    return np.array(found).T[near <= 20.0], far[near <= 20.0]


@pytest.mark.parametrize("which", [0, 1], ids=HELD)
def test_compliances_of_a_hinge_between_two_cables_are_those_of_the_closed_form(which):
    """At least tension the far cable is slack and holds nothing; anywhere else both do."""
    result, (grid, _) = solved_hinge(), hinge_grid()
    assert result["inputs.far"] == pytest.approx(0.0, abs=1e-6)
    assert result.details["compliance"]["taut"][""] == ["near"]
    assert result[f"compliance.{HELD[which]}"] == pytest.approx(hinge_compliances({"far": 0.0})[1 + which], rel=1e-6)
    assert ends(result, HELD[which]) == pytest.approx([grid[:, which].min(), grid[:, which].max()], rel=2e-4)
    assert np.ptp(grid[:, which]) > 0.1 * grid[:, which].min()
    assert result.details["compliance"]["redundancy"] == 1 and not result.details["compliance"]["notes"]


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("take", ENDS)
def test_the_answer_taken_is_the_end_asked_for(held, take):
    result, (grid, far) = solved_hinge(held, take), hinge_grid()
    column = grid[:, HELD.index(held)]
    assert result[f"compliance.{held}"] == result[f"compliance.{held}.{take}"]
    place = {"least": np.argmin, "greatest": np.argmax}[take](column)
    assert result["inputs.far"] == pytest.approx(far[place], abs=1e-2)
    assert np.allclose(result.arrays[f"compliance.{held}.{take}"], result.arrays["u"], atol=1e-12)
    assert result["link.position"][1] == pytest.approx(ARM * np.sin(BEND), abs=1e-9)
    assert f"the {take} compliance with {held} held" in result.status.message


def test_the_range_of_four_cables_is_that_of_a_grid_over_three_tensions_slack_ones_among_them():
    """Softest with the near cable alone, though least tension is shared with another one that pulls the same way."""
    offsets = {"near": 0.02, "far": -0.02, "high": 0.03, "low": -0.035}
    cables = {
        name: Tendon(along=("link",), offset=(offset, 0.0), limits=(0.0, 10.0), stiffness=STRENGTH)
        for name, offset in offsets.items()
    }
    robot = Robot(replace(hinge().description, actuators=cables))
    compliance = Compliance(on="link", axis=(0.0, 1.0, 0.0))
    result = asked(robot, (None, ARM * float(np.sin(BEND)), None), compliance).solve().require()
    tensions = np.meshgrid(*[[0.0, 1e-4, *np.linspace(0.25, 10.0, 40)]] * 3, indexing="ij")
    near, *grids = hinge_compliances(dict(zip(["far", "high", "low"], tensions, strict=True)), offsets)
    assert result.details["compliance"]["redundancy"] == 3 and len(result.details["compliance"]["taut"][""]) == 2
    for held, grid in zip(HELD, grids, strict=True):
        grid = grid[(near >= 0) & (near <= 10.0)]
        low, high = ends(result, held)
        assert low <= grid.min() and high >= grid.max() * (1 - 1e-9)
        assert [low, high] == pytest.approx([grid.min(), grid.max()], rel=1e-2)


def test_softening_cables_end_where_the_hinge_begins_to_buckle():
    """Cables that converge towards the tip push it aside: K = k + 2 T l'' falls to nothing within the limits."""
    compliance = Compliance(on="link", axis=(0.0, 1.0, 0.0), held="tensions", take="greatest")
    soft, start, stop = 0.02, 0.02, 0.005
    result = asked(hinge(soft, (start, stop), None), (None, 0.0, None), compliance).solve().require()
    length = np.hypot(ARM, start - stop)
    bend = (start * stop - (start * ARM / length) ** 2) / length
    assert np.allclose(result.arrays["u"], -soft * (1 - STANDING) / 2 / bend, rtol=1e-3)
    assert result["compliance.tensions.greatest"] == pytest.approx(ARM**2 / soft / STANDING, rel=0.1)
    assert result["compliance.tensions.least"] == pytest.approx(ARM**2 / soft, rel=1e-6)
    assert "begins to buckle" in result.status.message
    assert result["compliance.lengths"] == 0.0  # one hinge, two cables that do not stretch


def test_a_posture_that_is_not_stable_has_no_range_and_is_not_taken_for_one():
    compliance = Compliance(on="link", axis=(0.0, 1.0, 0.0))
    keys = {"inputs": {"near": 8.0, "far": 8.0}}
    robot, target = hinge(0.02, (0.02, 0.005)), (None, 0.0, None)
    result = asked(robot, target, compliance, **keys).solve().require()
    assert "no range" in result.status.message and "compliance.tensions.least" not in result.values
    assert result["compliance.tensions"] < 0 < result["compliance.lengths"]
    taken = Compliance(on="link", axis=(0.0, 1.0, 0.0), take="greatest")
    result = asked(robot, target, taken, **keys).solve()
    assert result.status.outcome == "infeasible" and "take: least_tension" in result.status.message


def test_a_loose_hinge_has_a_compliance_once_its_cables_are_kept_taut():
    """Without spring, weight and tension nothing holds it; with tension K = 2 T l'', l'' = offset^2 / length."""
    diverging, target = hinge(0.0, (0.01, 0.03), None), (None, 0.0, None)
    compliance = Compliance(on="link", axis=(0.0, 1.0, 0.0), take="greatest")
    result = asked(diverging, target, replace(compliance, take="least_tension")).solve().require()
    assert "nothing holds the point" in result.status.message and "compliance.tensions" not in result.values
    assert asked(diverging, target, compliance).solve().status.outcome == "infeasible"
    bounds = Bounds(inputs={"near": (2.0, 20.0), "far": (2.0, 20.0)})
    result = asked(diverging, target, replace(compliance, held="tensions"), bounds=bounds).solve().require()
    length = np.hypot(ARM, 0.02)
    bend = (0.01 * 0.03 - (0.01 * ARM / length) ** 2) / length
    assert ends(result, "tensions") == pytest.approx([ARM**2 / 40 / bend, ARM**2 / 4 / bend], rel=1e-6)


def test_without_redundancy_both_ends_are_the_answer():
    result = asked(
        hinge(), (None, ARM * float(np.sin(BEND)), None), Compliance(on="link", axis=(0.0, 1.0, 0.0)),
        inputs={"far": 3.0},
    ).solve().require()  # fmt: skip
    assert result.details["compliance"]["redundancy"] == 0
    for which, held in enumerate(HELD):
        expected = hinge_compliances({"far": 3.0})[1 + which]
        assert [result[f"compliance.{held}"], *ends(result, held)] == pytest.approx([expected] * 3, rel=1e-6)


@pytest.mark.parametrize(("keys", "more", "where"), [
    ({"on": "lever"}, {}, "compliance.on"),
    ({"on": "link", "take": "least"}, {"sensitivities": True}, "sensitivities"),
])  # fmt: skip
def test_what_cannot_be_asked_is_refused(keys, more, where):
    with pytest.raises(Bad) as caught:
        asked(hinge(), (None, 0.0, None), Compliance(**{"axis": (0.0, 1.0, 0.0), **keys}), **more) if keys[
            "on"
        ] == "link" else Tensions(
            robot=hinge(), goals={"tip": Point(on="link", target=(None, 0.0, None))},
            compliance=Compliance(axis=(0.0, 1.0, 0.0), **keys),
        )  # fmt: skip
    assert caught.value.key == where


# Soft arms, by statics solved again

PUSH = 1e-5  # N


def finger(load=None, **cable):
    """A planar rod between two converging cables, bent by its weight and a load."""
    rod = Rod(
        length=0.2,
        cross_section=Circle(radius=0.008),
        material=Linear(young_modulus=2e6, poisson_ratio=0.45, density=1080.0),
        strains=("bend_z", "stretch"),
        sections=2,
        quadrature=4,
    )
    cables = {
        name: Tendon(along=("rod",), offset=Converging(start=(s * 0.007, 0.0), end=(s * 0.003, 0.0)),
                     limits=(0.0, 6.0), **cable)
        for name, s in CABLES.items()
    }  # fmt: skip
    push = Wrench(on="rod", force=(0.0, 1e-30, 0.0))  # a parameter of the statics below, none at first
    loads = {"hand": load or Wrench(on="rod", force=(0.0, 0.02, 0.0)), "push": push}
    return Robot(Description(segments={"rod": rod}, actuators=cables, loads=loads, gravity=(0.0, -9.81, 0.0)))


class Pushed:
    """Equilibria of a robot under a further force on its tip, with tensions held or lengths held."""

    def __init__(self, robot, segment, axis):
        self.robot, self.axis = robot, np.array(axis)
        self.balance = Balance(robot, ["loads.push.force"])
        f = robot.functions()
        self.lengths = lambda q: np.array(f.actuator_lengths.function(q)).ravel()
        self.place = lambda q: np.array(f.pose(segment).function(q))[:3, 3]

    def slopes(self, q):
        step = 1e-6 * self.balance.scales.q
        rows = [(self.lengths(q + e) - self.lengths(q - e)) for e in np.diag(step)]
        return np.array(rows).T / 2 / step

    def held(self, q, u, taut, push):
        """(q, u) under a push with the lengths of `taut` inputs held at those of the start, by Newton's method."""
        length, u, n = self.lengths(q)[taut], u.copy(), q.size
        cables = [(self.robot.description.actuators or {})[self.robot.inputs[i]] for i in taut]
        soft = np.array([1 / c.stiffness if getattr(c, "stiffness", None) else 0.0 for c in cables])
        free = length / (1 + soft * u[taut])  # unstretched
        slopes = self.slopes(q)[taut]
        for _ in range(30):
            r, K, B = (np.array(x) for x in self.balance.evaluate(q, u, push * self.axis))
            gap = self.lengths(q)[taut] - free * (1 + soft * u[taut])
            matrix = np.block([[K, -B[:, taut]], [slopes, -np.diag(free * soft)]])
            size = np.concatenate([self.balance.scales.q, self.balance.scales.u[taut]])
            rows = np.concatenate([self.balance.scales.force, np.full(len(taut), 1e-3)])
            scaled, missing = matrix * size / rows[:, None], np.concatenate([r, gap]) / rows
            step = size * np.linalg.lstsq(scaled, missing, rcond=1e-13)[0]
            q, u[taut] = q - step[:n], u[taut] - step[n:]
            if np.max(np.abs(step / size)) < 1e-13:
                break
        return q

    def compliances(self, q, u):
        """C_T and C_L as quotients of displacement and force."""
        taut, moved = np.flatnonzero(u > 1e-6 * self.balance.scales.u), [[], []]
        for push in (PUSH, -PUSH):
            moved[0].append(self.place(self.balance.solve(u, q, push * self.axis).q))
            moved[1].append(self.place(self.held(q, u, taut, push)))
        return [(m[0] - m[1]) @ self.axis / 2 / PUSH for m in moved]


@cache
def solved_finger(**keys):
    load = Wrench(on="rod", force=(0.0, 0.02, 0.01), axes="body") if keys.pop("follower", False) else None
    robot = finger(load, **keys)
    q = Balance(robot).solve(np.array([2.0, 0.3])).q
    height = float(np.array(robot.functions().pose("rod")(q))[1, 3])
    compliance = Compliance(on="rod", axis=(0.0, 1.0, 0.0))
    return asked(robot, (None, height, None), compliance).solve().require()


KINDS = {"plain": {}, "elastic": {"stiffness": 50.0}, "rubbing": {"friction": 0.2}, "follower": {"follower": True}}


@pytest.mark.parametrize("keys", KINDS.values(), ids=KINDS)
def test_compliances_are_the_tips_displacement_per_force(keys):
    """At least tension and at every end, whatever is taut there."""
    result = solved_finger(**keys)
    pushed = Pushed(result.question.loaded, "rod", (0.0, 1.0, 0.0))
    for held, end in itertools.product(HELD, ENDS):
        u = result.arrays[f"compliance.{held}.{end}"]
        q = pushed.balance.solve(u, result.arrays["q"]).q
        found = pushed.compliances(q, u)[HELD.index(held)]
        assert found == pytest.approx(result[f"compliance.{held}.{end}"], rel=1e-5)
    found = pushed.compliances(result.arrays["q"], result.arrays["u"])
    assert found == pytest.approx([result[f"compliance.{held}"] for held in HELD], rel=1e-5)


def test_the_range_is_that_of_a_grid_over_all_tensions_that_hold_the_tip():
    result = solved_finger()
    pushed, height = Pushed(result.question.loaded, "rod", (0.0, 1.0, 0.0)), result["rod.position"][1]
    rows, far, q = [], 0.0, result.arrays["q"]
    for near in np.linspace(result["inputs.near"], 6.0, 30):
        for _ in range(20):  # secant steps to the tension of the other cable
            q = pushed.balance.solve(np.array([near, far]), q).q
            ahead = pushed.balance.solve(np.array([near, far + 1e-4]), q).q
            step = (pushed.place(q)[1] - height) / (pushed.place(ahead) - pushed.place(q))[1] * 1e-4
            far -= step
            if abs(step) < 1e-9:
                break
        assert -1e-6 < far < 6.0
        rows.append(pushed.compliances(q, np.array([near, max(far, 0.0)])))
    rows = np.array(rows)
    for which, held in enumerate(HELD):
        assert ends(result, held) == pytest.approx([rows[:, which].min(), rows[:, which].max()], rel=1e-4)


# Derivatives


def test_derivatives_of_both_compliances_are_their_quotients_of_differences():
    """With a cable that rubs, an elastic one, a chamber and a follower load; at weights between slack and taut."""
    robot = finger(Wrench(on="rod", force=(0.0, 0.02, 0.01), axes="body"), stiffness=50.0)
    air, (rubbing, elastic) = Chamber(along=("rod",), offset=(0.002, 0.0), area=2e-5), robot.inputs
    cables = robot.description.actuators
    rubs = replace(cables[rubbing], stiffness=None, friction=0.2)
    actuators = {rubbing: rubs, elastic: cables[elastic], "air": air}
    robot = Robot(replace(robot.description, actuators=actuators))
    compliance = Compliance(on="rod", axis=(0.3, 1.0, 0.0), at=0.8)
    question = asked(robot, (None, 0.05, None), compliance)
    solver = question.prepare()
    redundancy = Redundancy(solver, solver.posture.targets())
    x = redundancy.program.stack({"q": 0.3 * solver.balance.scales.q, "u": [1.5, 0.4, 3e3]})
    compliances = Compliances(solver, redundancy, compliance, redundancy.posed(x))
    weights = np.array([0.3, 0.9, 1.0])
    weighed, soft = compliances.lengths_held(-1, weights=weights), compliances.lengths_held(1, soft=0.1)
    for quantity in (compliances.tensions_held(1), weighed, soft):
        steps = 1e-6 * np.eye(x.size)
        quotients = [
            (quantity(redundancy.posed(x + e))[0] - quantity(redundancy.posed(x - e))[0]) / 2e-6 for e in steps
        ]
        slope = quantity(redundancy.posed(x))[1]
        assert np.allclose(slope, quotients, atol=1e-8 + 1e-7 * np.abs(slope).max())
        assert np.abs(slope).max() > 1e-2
