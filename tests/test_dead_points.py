"""Dead points, where bars in line bear forces without bound; and what else statics with loops must not make up."""

from dataclasses import replace
from functools import cache
from math import cos, pi, sin, tan
from pathlib import Path

import numpy as np
import pytest
from chains import Z, bar, four_bar, world_wrenches

import socontrol as so
from socontrol.mechanics import loops
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.loops import End
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.bodies import Placement
from socontrol.model.rods import Rod
from socontrol.programs.postures.ellipsoids import Ellipsoids
from socontrol.programs.postures.statics import Statics
from socontrol.programs.question import Guess

WEIGHT = 0.2 * 9.81
ROBOTS = Path(__file__).parents[1] / "configs" / "robots"


def parallelogram(**changes):
    return Robot(four_bar(0.1, 0.2, 0.1, 0.2, masses=(0.2, 0.2, 0.2), **changes))


@cache
def weighing():
    return parallelogram()


def held(crank, robot=None, **changes):
    """Statics of a parallelogram whose crank is held, near the shape whose coupler stays level."""
    guess = Guess(coordinates={"coupler": -crank, "rocker": crank})
    return Statics(robot=robot or weighing(), coordinates={"crank": crank}, guess=guess, **changes)


def in_line():
    """Two bars pinned to the world exactly as far off as they reach."""
    pin = loops.Revolute(a=End(segment="coupler"), b=End(segment="world", placement=Placement((0.6, 0.0, 0.0))), axis=Z)
    segments = {"crank": bar(0.3), "coupler": bar(0.3, "crank")}
    return Robot(Description(segments=segments, gravity=(0.0, -9.81, 0.0), loops={"pin": pin}))


def told_of(result):
    assert result.status.outcome == "rejected" and "Loop 'pin' is at a dead point" in result.status.message
    return result


@pytest.mark.parametrize(("crank", "guess"), [(0.0, (0.0, 0.0)), (0.0, (0.3, -0.4)), (pi, (1e-6, 2e-6))])
def test_no_force_holds_weights_where_bars_are_in_line(crank, guess):
    near = Guess(coordinates={"coupler": crank + guess[0], "rocker": guess[1] - crank})
    result = told_of(replace(held(crank), guess=near).solve())
    assert np.max(np.abs(result.arrays["lam"])) < 10, "what is left is what the other rows bear"
    assert result.residuals["force"].value > 0.1


@pytest.mark.parametrize("bend", [0.0, 1.0])
def test_two_bars_in_line_bear_no_weight(bend):
    told_of(Statics(robot=in_line(), guess=Guess(coordinates={"crank": bend, "coupler": -2 * bend})).solve())


@pytest.mark.parametrize("crank", [1e-2, 1e-4, 2e-5, pi - 1e-3])
def test_beside_a_dead_point_the_force_is_that_of_statics(crank):
    """By moments of the level coupler and the rocker about their pins it bears W / 2 up and W cot(crank) along."""
    robot = weighing()
    result = held(crank).solve().require()
    force = world_wrenches(robot, result.arrays["q"], result.arrays["lam"])["pin"][3:]
    np.testing.assert_allclose(np.abs(force), [abs(WEIGHT / tan(crank)), WEIGHT / 2, 0.0], rtol=1e-3, atol=1e-9)


def test_a_dead_point_that_no_force_pulls_at_is_an_equilibrium_without_noise():
    along = Wrench(on="coupler", force=(3.0, 0.0, 0.0))
    level = parallelogram(gravity=(0.0, 0.0, 0.0), loads={"along": along})
    result = held(0.0, level).solve().require()
    assert np.max(np.abs(result.arrays["lam"])) < 10


def test_ellipsoids_and_inverse_statics_say_so_too():
    there = Ellipsoids(robot=weighing(), on="coupler", coordinates={"crank": 0.0})
    assert not [name for name in told_of(there.solve()).values if name.startswith("ellipsoid")]
    goals = {"tip": {"type": "point", "on": "crank", "target": [0.1, 0.0, None]}}
    told_of(so.solve(so.problem({"type": "inverse_statics", "robot": weighing(), "goals": goals})))
    goals["tip"] |= {"type": "path", "target": [[0.1 * cos(a), 0.1 * sin(a), 0.0] for a in (-0.4, 0.0)]}
    path = so.solve(so.problem({"type": "inverse_statics", "robot": weighing(), "goals": goals}))
    assert "Waypoint 2 of 2: loop 'pin' is at a dead point" in path.status.message


def test_a_motion_that_begins_at_a_dead_point_and_loses_energy_says_where_it_began():
    start = {"coordinates": {"crank": 0}, "rates": {"crank": 10}}
    asked = {"type": "simulation", "robot": weighing(), "times": {"stop": 0.3, "every": 0.1}, "start": start}
    status = so.solve(so.problem(asked)).status
    assert status.outcome == "rejected" and "At the start, loop 'pin' is at a dead point" in status.message


def test_a_guess_of_many_turns_closes_like_one_of_none():
    robot = Robot(four_bar(0.1, 0.25, 0.2, 0.22))
    far = Guess(coordinates={"coupler": 1e6, "rocker": -1e5})
    result = Statics(robot=robot, coordinates={"crank": 0.7}, guess=far).solve().require()
    assert result.residuals["loops"].value < 1e-13


def test_a_motion_settles_where_statics_comes_to_rest():
    robot = Robot(four_bar(0.1, 0.25, 0.2, 0.22))
    rest = Statics(robot=robot).solve().require()
    asked = {"type": "simulation", "robot": robot, "times": {"stop": 0.01, "every": 0.01}, "start": {"settled": True}}
    moved = so.solve(so.problem(asked)).require()
    assert rest.details["shapes"]["rests"] == 2
    np.testing.assert_allclose(moved["rocker.position"], rest["rocker.position"], atol=1e-9)


def test_the_shortest_length_told_is_no_longer_than_one_that_is_held():
    whole = so.load_robot(ROBOTS / "finray_driven.yaml").description
    coarse = {name: replace(segment, sections=2) if isinstance(segment, Rod) else segment
              for name, segment in whole.segments.items()}  # fmt: skip
    asked = Statics(robot=Robot(replace(whole, segments=coarse)), lengths={"cable": 0.1}, discretisation=False)
    asked.solve().require()
    told = replace(asked, lengths={"cable": 0.02}).solve().status.message
    assert 20 < float(told.split("the shortest found is ")[1].split(" mm")[0]) < 100
