"""What a planned motion may not ask for: one line that says where, what was given and what is allowed."""

from pathlib import Path

import pytest

import socontrol as so
from socontrol.files.loader import FileError

ROBOTS = Path(__file__).parent.parent / "configs/robots"
POINT = {"type": "point", "on": "pole", "target": [0.2, None, None]}
PATH = {"type": "path", "on": "pole", "target": [[0, 0, -0.5], [0.1, 0, -0.5]]}
SPHERE = {"type": "sphere", "center": [1, 0, 0], "radius": 0.1}
FREE = {"shortest": 0.5, "longest": 2.0}
TRACK = {"type": "tracking", "on": "pole"}
ROUND = {"center": [0, 0, 0], "radius": 0.1}


def cartpole(**keys):
    """A plan of the cart-pole that is fine as it stands; None takes a key out."""
    document = {
        "type": "trajectory", "robot": str(ROBOTS / "cartpole.yaml"), "duration": 1.0,
        "start": {"coordinates": {"cart": 0.0}}, "end": {"coordinates": {"cart": 0.2}}, **keys,
    }  # fmt: skip
    return {key: value for key, value in document.items() if value is not None}


def at(**keys):
    return {"waypoints": {"via": {"time": 0.5, **keys}}}


REFUSED = {  # keys, where, words
    # duration and mesh
    "no duration": ({"duration": None}, "duration", "missing|wanted"),
    "negative duration": ({"duration": -1.0}, "duration", "-1"),
    "no time": ({"duration": 0.0}, "duration", "0"),
    "duration in metres": ({"duration": "1 m"}, "duration", "1 m is a length; a time"),
    "shortest after longest": ({"duration": {"shortest": 2.0, "longest": 1.0}}, "duration.longest", "1 s is not after"),
    "guess outside": ({"duration": {**FREE, "guess": 3.0}}, "duration.guess", r"3 s is outside \[0.5, 2\]"),
    "no shortest": ({"duration": {"longest": 2.0}}, "duration.shortest", "missing|wanted"),
    "no interval": ({"mesh": {"intervals": 0}}, "mesh.intervals", "0"),
    "half an interval": ({"mesh": {"intervals": 2.5}}, "mesh.intervals", "2.5"),
    "too many intervals": ({"mesh": {"intervals": 5001}}, "mesh.intervals", "5001 intervals; at most 5000"),
    "no scheme": ({"mesh": {"scheme": "radu"}}, "mesh.scheme", "'radu'.*did you mean 'radau'"),
    "no point": ({"mesh": {"points": 0}}, "mesh.points", "0"),
    "too many points": ({"mesh": {"points": 10}}, "mesh.points", "10 points; 'radau' has 1 to 9"),
    "one point of two": ({"mesh": {"points": 1, "scheme": "lobatto"}}, "mesh.points", "1 points; 'lobatto' has 2 to 9"),
    "shared and constant": ({"mesh": {"scheme": "lobatto", "inputs": "constant"}}, "mesh.inputs", "'lobatto'"),
    "constant and continuous": (
        {"mesh": {"inputs": "constant"}, "costs": {"r": {"type": "input_rate"}}}, "mesh.inputs", "rates"),
    "unknown key": ({"mesh": {"interval": 20}}, "mesh.interval", "did you mean 'intervals'"),
    # names
    "unknown start": ({"start": {"coordinates": {"cort": 0.0}}}, "start.coordinates.cort", "did you mean 'cart'"),
    "unknown rate": (
        {"start": {"rates": {"pol": 1.0}, "settled": False}}, "start.rates.pol", "did you mean 'pole'"),
    "unknown start input": ({"start": {"inputs": {"forc": 1.0}}}, "start.inputs.forc", "did you mean 'force'"),
    "unknown end": ({"end": {"coordinates": {"cort": 0.0}}}, "end.coordinates.cort", "did you mean 'cart'"),
    "unknown end rate": ({"end": {"rates": {"pol": 0.0}}}, "end.rates.pol", "did you mean 'pole'"),
    "unknown end input": ({"end": {"inputs": {"forc": 0.0}}}, "end.inputs.forc", "did you mean 'force'"),
    "unknown on the way": (at(coordinates={"cort": 0.0}), "waypoints.via.coordinates.cort", "did you mean 'cart'"),
    "unknown segment": ({"end": {"goals": {"tip": {**POINT, "on": "pol"}}}}, "end.goals.tip.on", "'pol'"),
    "place past the end": ({"end": {"goals": {"tip": {**POINT, "at": 1.5}}}}, "end.goals.tip.at", "1.5"),
    "unknown limit": ({"limits": {"rates": {"cort": 1.0}}}, "limits.rates.cort", "did you mean 'cart'"),
    "unknown input rate": ({"limits": {"input_rates": {"forc": 1.0}}}, "limits.input_rates.forc", "'force'"),
    "unknown cable": ({"limits": {"lengths": {"forc": [0, 1]}}}, "limits.lengths.forc", "'force'"),
    "speed of nothing": (
        {"limits": {"speeds": {"tip": {"on": "pol", "largest": 1.0}}}}, "limits.speeds.tip.on", "'pol'"),
    "unknown bound": ({"bounds": {"coordinates": {"cort": [0, 1]}}}, "bounds.coordinates.cort", "'cart'"),
    "tracking nothing": ({"costs": {"f": {**TRACK, "on": "pol", "circle": ROUND}}}, "costs.f.on", "'pol'"),
    "unknown guess": (
        {"guess": {"times": [0, 1], "coordinates": {"cort": [0, 1]}}}, "guess.coordinates.cort", "'cart'"),
    # moments
    "two times": (at(share=0.5), "waypoints.via.time", "one of the two"),
    "no time given": ({"waypoints": {"via": {"coordinates": {"cart": 0.1}}}}, "waypoints.via.time", "one of the two"),
    "after the end": (at(time=1.5), "waypoints.via.time", "not before the end"),
    "at the end": (at(time=1.0), "waypoints.via.time", "not before the end"),
    "at the beginning": (at(time=0.0), "waypoints.via.time", "0"),
    "whole share": ({"waypoints": {"via": {"share": 1.0}}}, "waypoints.via.share", "not before the end"),
    "two at once": (
        {"waypoints": {"a": {"time": 0.5}, "b": {"share": 0.5}}}, "waypoints.[ab]", "two waypoints at one time"),
    "time of a free duration": ({**at(), "duration": FREE}, "waypoints.via.time", "`share`"),
    "more waypoints than intervals": (
        {"waypoints": {"a": {"time": 0.4}, "b": {"time": 0.6}}, "mesh": {"intervals": 2}},
        "mesh.intervals", "2 intervals; 2"),
    "a path at the end": ({"end": {"goals": {"tip": PATH}}}, "end.goals.tip", "tracking"),
    "a path on the way": (at(goals={"tip": PATH}), "waypoints.via.goals.tip", "tracking"),
    "settled and moving": ({"end": {"settled": True, "rates": {"cart": 1.0}}}, "end.settled", "at rest"),
    "settled and free": ({"end": {"settled": True, "velocity": "free"}}, "end.settled", "rest"),
    "start settled and moving": ({"start": {"settled": True, "rates": {"cart": 1.0}}}, "start.rates", "at rest"),
    "unknown velocity": ({"end": {"velocity": "slow"}}, "end.velocity", "'slow'"),
    # values outside of their limits
    "start outside": ({"start": {"coordinates": {"cart": 3.0}}}, "start.coordinates.cart", r"3 .*\[-2, 2\]"),
    "end outside": ({"end": {"coordinates": {"cart": -2.5}}}, "end.coordinates.cart", r"-2.5 .*\[-2, 2\]"),
    "end outside of bounds": (
        {"end": {"coordinates": {"cart": 1.0}}, "bounds": {"coordinates": {"cart": [-0.5, 0.5]}}},
        "end.coordinates.cart", r"1 .*\[-0.5, 0.5\]"),
    "input outside": ({"end": {"inputs": {"force": 30.0}}}, "end.inputs.force", r"30 .*\[-20, 20\]"),
    "input at the start outside": (
        {"start": {"coordinates": {"cart": 0.0}, "inputs": {"force": 30.0}}},
        "start.inputs.force", r"30 .*\[-20, 20\]"),
    "input of a settled start outside": (
        {"start": {"inputs": {"force": 30.0}}}, "start.inputs.force", r"30 .*\[-20, 20\]"),
    "held input outside": ({"inputs": {"force": 30.0}}, "inputs.force", r"30 .*\[-20, 20\]"),
    "start too fast": (
        {"start": {"rates": {"cart": 3.0}, "settled": False}, "limits": {"rates": {"cart": 2.0}}},
        "start.rates.cart", "3"),
    "end too fast": (
        {"end": {"rates": {"cart": 3.0}}, "limits": {"rates": {"cart": 2.0}}}, "end.rates.cart", "3"),
    "held coordinate elsewhere at the end": (
        {"coordinates": {"cart": 0.0}, "end": {"coordinates": {"cart": 0.2}}}, "end.coordinates.cart", "0.2"),
    "held coordinate elsewhere at the start": (
        {"coordinates": {"pole": 0.0}, "start": {"coordinates": {"pole": 0.3}}}, "start.coordinates.pole", "0.3"),
    "held input elsewhere at the end": (
        {"inputs": {"force": 1.0}, "end": {"inputs": {"force": 2.0}}}, "end.inputs.force", "2"),
    "no room": ({"limits": {"rates": {"cart": [1.0, -1.0]}}}, "limits.rates.cart", "between 1 and -1"),
    "no speed": ({"limits": {"speeds": {"tip": {"on": "pole", "largest": 0}}}}, "limits.speeds.tip.largest", "0"),
    # units
    "rate in metres": ({"limits": {"rates": {"cart": "1 m"}}}, "limits.rates.cart", "1 m is a length; a speed"),
    "rate of a force": (
        {"limits": {"input_rates": {"force": "1 N"}}}, "limits.input_rates.force", "1 N is a force; a number in N/s"),
    "angle in metres": ({"end": {"coordinates": {"pole": "1 m"}}}, "end.coordinates.pole", "1 m is a length; an angle"),
    "speed in newtons": (
        {"limits": {"speeds": {"tip": {"on": "pole", "largest": "1 N"}}}},
        "limits.speeds.tip.largest", "1 N is a force; a speed"),
    # obstacles
    "no size": ({"obstacles": {"ball": {**SPHERE, "radius": 0}}}, "obstacles.ball.radius", "0"),
    "unknown kind": ({"obstacles": {"ball": {**SPHERE, "type": "ball"}}}, "obstacles.ball.type", "'ball'.*sphere"),
    "too near by nothing": ({"obstacles": {"ball": {**SPHERE, "clearance": -0.1}}}, "obstacles.ball.clearance", "-0.1"),
    # costs
    "cost of a given time": ({"costs": {"t": {"type": "time"}}}, "costs.t", "duration is given; free it"),
    "unknown cost": ({"costs": {"e": {"type": "efort"}}}, "costs.e.type", "'efort'.*'effort'"),
    "no weight": ({"costs": {"e": {"type": "effort", "weight": 0}}}, "costs.e.weight", "0"),
    "nothing to follow": ({"costs": {"f": TRACK}}, "costs.f.times", "`positions`, or a `circle`"),
    "times without places": (
        {"costs": {"f": {**TRACK, "times": [0, 1], "positions": [[0, 0, 0]]}}}, "costs.f.positions", "2 times and 1"),
    "times that fall": (
        {"costs": {"f": {**TRACK, "times": [0, 0], "positions": [[0, 0, 0], [1, 0, 0]]}}}, "costs.f.times.1", "rise"),
    "no direction": (
        {"costs": {"f": {**TRACK, "circle": {**ROUND, "start": [0, 0, 1]}}}},
        "costs.f.circle.start", "along the normal"),
    "times of a free duration": (
        {"costs": {"f": {**TRACK, "times": [0, 1], "positions": [[0, 0, 0], [1, 0, 0]]}}, "duration": FREE},
        "costs.f.times", "the duration is free"),
    # guess, outputs, replay
    "guess without times": ({"guess": {"coordinates": {"cart": [0, 1]}}}, "guess.times", "times"),
    "guess of one time": ({"guess": {"times": [0], "coordinates": {"cart": [0]}}}, "guess.times", "two or more"),
    "guess too long": (
        {"guess": {"times": [0, 1], "coordinates": {"cart": [0, 1, 2]}}},
        "guess.coordinates.cart", "3 values for 2 times"),
    "no start": ({"guess": {"starts": 0}}, "guess.starts", "0"),
    "no step": ({"outputs": {"every": 0}}, "outputs.every", "0"),
    "no tolerance": ({"replay": {"tolerance": 0}}, "replay.tolerance", "0"),
    # solvers
    "unknown solver": ({"solver": {"type": "snopt"}}, "solver.type", "'snopt'.*ipopt"),
    "unknown hessian": ({"solver": {"type": "ipopt", "hessian": "bfgs"}}, "solver.hessian", "'bfgs'"),
    "an integrator": ({"solver": {"type": "radau"}}, "solver.type", "'radau'"),
    "unknown option": ({"solver": {"type": "ipopt", "options": {"max_it": 3}}}, "solver.options.max_it", "no option"),
    "option of fatrop": (
        {"solver": {"type": "fatrop", "options": {"max_wall_time": 3}}},
        "solver.options.max_wall_time", "Fatrop does not take"),
    "type of an option of fatrop": (
        {"solver": {"type": "fatrop", "options": {"mu_init": "small"}}}, "solver.options.mu_init", "'small'"),
    "hessian of fatrop": ({"solver": {"type": "fatrop", "hessian": "exact"}}, "solver.hessian", "unknown key"),
}  # fmt: skip


def test_what_the_others_change_is_fine():
    so.problem(cartpole())


@pytest.mark.parametrize("name", REFUSED)
def test_a_mistake_is_answered_in_one_line_at_its_place(name):
    keys, where, words = REFUSED[name]
    with pytest.raises(FileError, match=rf"^{where}: .*({words})") as caught:
        so.problem(cartpole(**keys))
    assert "\n" not in str(caught.value)


def test_gauss_and_newton_are_for_plans():
    goal = {"tip": {"type": "point", "on": "cap", "target": [0, 0, 0.1]}}
    document = {"type": "inverse_statics", "robot": str(ROBOTS / "stiff_flop.yaml"), "goals": goal}
    so.problem(document)
    with pytest.raises(FileError, match="^solver.hessian: 'gauss_newton' is for trajectories"):
        so.problem({**document, "solver": {"type": "ipopt", "hessian": "gauss_newton"}})
    so.problem(cartpole(solver={"type": "ipopt", "hessian": "gauss_newton"}))


def test_fatrop_is_for_plans():
    goal = {"tip": {"type": "point", "on": "cap", "target": [0, 0, 0.1]}}
    document = {"type": "inverse_statics", "robot": str(ROBOTS / "stiff_flop.yaml"), "goals": goal}
    with pytest.raises(FileError, match="^solver.type: 'fatrop'"):
        so.problem({**document, "solver": {"type": "fatrop"}})


def test_a_robot_without_actuators_cannot_be_planned():
    robot = {"schema_version": 1, "segments": {"arm": {"type": "revolute", "body": {"mass": 1}}}}
    with pytest.raises(FileError, match="^robot: .*no actuators"):
        so.problem({"type": "trajectory", "robot": robot, "duration": 1.0})
