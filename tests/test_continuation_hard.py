"""Continuation where it is hard: overconstrained linkages, forces without a potential, loads that nearly coincide."""

import numpy as np
import pytest
from scipy.optimize import brentq
from test_continuation import ABOUT, clamped_free, discrete, push, rod, truss

import socontrol as so
from socontrol.files.loader import FileError
from socontrol.programs.equilibria.branches import follow
from socontrol.programs.postures.continuation import family_of
from socontrol.programs.result import Status

ROUND = {"strains": "kirchhoff_love", "cross_section": {"type": "circle", "radius": 0.02}}
ROUND_OVER_FLAT = (np.pi * 0.02**4 / 4) / (0.04 * 0.02**3 / 12)  # of bending stiffnesses


def asked(robot, to, vary=None, **changes):
    keys = {"type": "continuation", "robot": robot, "vary": vary or {"loads": ["push"]}, "to": to, "branches": 0}
    return so.problem({**keys, "watch": {"on": next(iter(robot["segments"]))}, "discretisation": False, **changes})


def ask(*args, **changes):
    return so.solve(asked(*args, **changes))


A, B, TWIST, STIFFNESS = 0.2, 0.3, 0.6, 2.0  # m, rad, N m/rad: Bennett's condition is sin(twist) over length the same
OTHER = float(np.arcsin(B * np.sin(TWIST) / A))


def bennett():
    """Four hinges that mobility counts call a structure, three rows of the closing one depending on the rest."""

    def hinge(parent, length, twist):
        frame = {"position": [length, 0, 0], "rotation": [twist, 0, 0]}
        return {"type": "revolute", **ABOUT, "parent": parent, "placement": frame}

    segments = {"first": {"type": "revolute", **ABOUT, "stiffness": STIFFNESS, "rest": 1.0},
                "second": hinge("first", A, TWIST), "third": hinge("second", B, OTHER)}  # fmt: skip
    ends = [{"segment": "third", "placement": {"position": [A, 0, 0], "rotation": [TWIST, 0, 0]}},
            {"segment": "world", "placement": {"position": [-B, 0, 0], "rotation": [-OTHER, 0, 0]}}]  # fmt: skip
    motor = {"type": "joint_torque", "joint": "first"}
    pin = {"type": "revolute", **ABOUT, **dict(zip("ab", ends, strict=True))}
    return {"segments": segments, "loops": {"pin": pin}, "actuators": {"motor": motor}, "gravity": [0, 0, 0]}


def test_a_linkage_that_is_overconstrained_turns_as_bennetts_does():
    """tan(first / 2) tan(second / 2) = sin((b + a) / 2) / sin((b - a) / 2) with the twists a and b, third = -first."""
    product = np.sin((OTHER + TWIST) / 2) / np.sin((OTHER - TWIST) / 2)
    guess = {"first": 1.0, "second": float(2 * np.arctan(product / np.tan(0.5))), "third": -1.0}
    result = ask(bennett(), 3.0, {"input": "motor"}, guess={"coordinates": guess}, points=100).require()
    first, second, third = result.arrays["branch.0.q"].T
    assert first == pytest.approx(1 + result.arrays["branch.0.parameter"] / STIFFNESS, abs=1e-12)
    assert first[-1] == pytest.approx(2.5) and third == pytest.approx(-first, abs=1e-12)
    assert np.tan(first / 2) * np.tan(second / 2) == pytest.approx(product + 0 * first, rel=1e-11)


BESIDE = {
    "a follower force": ({"force": [-1e-3, 0, 0], "axes": "body"}, 1e-3),
    "a dead moment": ({"moment": [1e-9, 0, 0]}, 1e-9),
}


@pytest.mark.parametrize("kind", BESIDE)
def test_two_motions_that_a_force_without_potential_loses_at_once_are_found(kind):
    """A little of either hardly moves the load at which a round column buckles in two directions."""
    load, change = BESIDE[kind]
    robot = clamped_free(4, **ROUND)
    robot["loads"]["beside"] = {"type": "wrench", "on": "column", **load}
    result = ask(robot, 5.0).require()
    P, A = ROUND_OVER_FLAT * discrete(np.pi / 2, 4), np.pi * 0.02**2
    assert result["critical_load"] == pytest.approx(P, rel=2 * change + P / (1e7 * A))
    (critical,) = result.details["critical"]
    assert not result.details["conservative"] and (critical["before"], critical["after"]) == (0, 2)


def test_motions_that_drive_each_other_are_said_to():
    """A moment about its axis, which does not turn with it, lets a round column flutter where it would buckle."""
    robot = clamped_free(4, **ROUND)
    robot["loads"]["beside"] = {"type": "wrench", "on": "column", "moment": [0.05, 0, 0]}
    result = ask(robot, 5.0).require()
    assert result.status.message.startswith("Unstable from about factor 3.14") and "flutter" in result.status.message
    assert not result.details["critical"] and "critical_load" not in result.values
    stable, load = result.arrays["branch.0.stable"], result.arrays["branch.0.parameter"]
    assert np.array_equal(stable, load < load[~stable][0]) and not stable[-1]


def test_stability_that_is_lost_unseen_is_not_called_solved(monkeypatch):
    from socontrol.programs.equilibria.critical import Finder

    monkeypatch.setattr(Finder, "_root", lambda *args: None)
    result = ask(clamped_free(3), 4.0)
    assert result.status.outcome == "numerical"
    assert result.status.message.startswith("Stability is lost before factor 0.673")


def columns(length):
    """Two columns beside each other, the second of another length."""
    bent = {"strains": ["bend_z"]}
    segments = {"one": rod(3, **bent), "two": rod(3, length, placement={"position": [0, 1, 0]}, **bent)}
    loads = {name: push(name)["push"] for name in segments}
    return {"segments": segments, "loads": loads, "gravity": [0, 0, 0]}


@pytest.mark.parametrize("shorter", [2e-4, 5e-5, 1e-7])
def test_columns_that_buckle_nearly_at_once_are_told_apart(shorter):
    """The load of each goes with one over the square of its length, whether the other has buckled or not."""
    robot = columns(1 + shorter)
    result = ask(robot, 3.0, {"loads": ["one", "two"]}, branches=2).require()
    own = [result[f"critical.{k}"] for k in range(len(result.details["critical"]))]
    P = discrete_inextensible()
    assert own[:2] == pytest.approx([P / (1 + shorter) ** 2, P], rel=1e-10)  # of the straight ones
    assert own[2:] == pytest.approx([P, P], rel=1e-10)  # with the longer one bent to either side
    rows = result.details["critical"]
    assert [(row["branch"], row["before"], row["after"]) for row in rows] == [
        (0, 0, 1),
        (0, 1, 2),
        (1, 0, 1),
        (2, 0, 1),
    ]
    assert [row["eigenvalue"] for row in rows] == pytest.approx([0] * 4, abs=1e-9)


def discrete_inextensible():
    """Load of three sections that only bend."""
    return so.solve(asked(clamped_free(3, strains=["bend_z"]), 3.0)).require()["critical_load"]


def test_higher_modes_are_told_by_the_stiffness_that_vanishes():
    result = ask(clamped_free(4), 18.0).require()
    rows = result.details["critical"]
    assert [(row["before"], row["after"]) for row in rows] == [(0, 1), (1, 2), (2, 3)][: len(rows)] and len(rows) >= 2
    assert [row["eigenvalue"] for row in rows] == pytest.approx([0] * len(rows), abs=1e-9)
    assert result.arrays["branch.0.smallest_eigenvalue"][-1] < -1  # which is another


@pytest.mark.parametrize("side", [1e-3, 1e-4, 1e-5, 1e-6])
def test_a_slight_push_aside_bends_the_branch_to_its_side(side):
    """An upright pendulum on a spring k: k a = P sin a + side cos a. The branch comes near that of the other side,
    which is unstable and straight ahead."""
    upright = {"type": "revolute", **ABOUT, "stiffness": STIFFNESS, "tip": {"position": [1, 0, 0]}}
    loads = {**push("p"), "side": {"type": "wrench", "on": "p", "force": [0, side, 0]}}
    result = ask({"segments": {"p": upright}, "loads": loads, "gravity": [0, 0, 0]}, 5.0).require()
    bent = brentq(lambda a: STIFFNESS * a - 5 * np.sin(a) - side * np.cos(a), 1.0, 3.0)
    assert result.arrays["branch.0.q"][-1] == pytest.approx([bent], abs=1e-9)
    assert result.arrays["branch.0.stable"].all() and "critical_load" not in result.values


def test_a_crank_that_is_driven_to_the_end_of_its_way_is_said_to_turn_back():
    """Coupler and rocker in line, 0.24 m from pin to pin: cos a = (0.2^2 + 0.22^2 - 0.24^2) / (2 0.2 0.22)."""

    def bar(length, **changes):
        body = {"mass": 0.4, "com": [length / 2, 0, 0]}
        return {"type": "revolute", **ABOUT, "body": body, "tip": {"position": [length, 0, 0]}, **changes}

    segments = {"crank": bar(0.2), "coupler": bar(0.12, parent="crank"),
                "rocker": bar(0.12, placement={"position": [0.22, 0, 0]})}  # fmt: skip
    pin = {"type": "revolute", **ABOUT, "a": {"segment": "coupler"}, "b": {"segment": "rocker"}}
    guess = {"coordinates": {"coupler": 0.3, "rocker": 2.0}}
    robot = {"segments": segments, "loops": {"pin": pin}, "gravity": [0, -9.81, 0]}
    result = ask(robot, 2.5, {"coordinate": "crank"}, **{"from": 0.5}, guess=guess, points=60)
    farthest = np.arccos((0.2**2 + 0.22**2 - 0.24**2) / (2 * 0.2 * 0.22))
    assert farthest - 1e-3 < np.max(result.arrays["branch.0.parameter"]) <= farthest + 1e-9
    assert "There it turns back" in result.status.message


def test_a_column_on_a_swivel_is_held_by_nothing_about_its_axis():
    swivel = {"type": "revolute", "axis": [1, 0, 0]}
    robot = {"segments": {"swivel": swivel, "column": rod(2, parent="swivel", **ROUND)}, "loads": push("column")}
    with pytest.raises(FileError, match="nothing holds swivel"):
        ask({**robot, "gravity": [0, 0, 0]}, 2.0)


def test_a_hinge_that_only_what_varies_holds_is_marginal_at_its_beginning():
    hinge = {"type": "revolute", **ABOUT, "body": {"mass": 1}, "tip": {"position": [1, 0, 0]}}
    result = ask({"segments": {"hinge": hinge}, "loads": push("hinge", [1, 0, 0]), "gravity": [0, 0, 0]}, 2.0).require()
    assert result.status.message.startswith("Marginal at the beginning, factor 0")
    assert not result.arrays["branch.0.stable"][0] and result.arrays["branch.0.stable"][1:].all()


def test_a_range_whose_end_is_not_reached_is_not_called_ended(monkeypatch):
    family, _, first = family_of(asked(truss(), 1.0))
    monkeypatch.setattr(family, "at", lambda a, b, s: None)
    branch = follow(family, first, 100)
    assert branch.ended == "lost" and branch.points[-1].s < 1


def test_a_beginning_without_finite_numbers_is_numerical(monkeypatch):
    from socontrol.programs.equilibria.family import Family

    monkeypatch.setattr(Family, "point", lambda *args: None)
    status = ask(clamped_free(2), 1.0).status
    assert status == Status(
        "numerical", "At the beginning, factor 0 (push 0 N): The model gives NaN or infinity; begin elsewhere."
    )
