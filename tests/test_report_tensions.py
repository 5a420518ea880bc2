"""What is said and drawn of tensions is what the result holds: cables, lengths, motors, friction, paths, motions."""

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from printed import sentence, words

import socontrol as so
from socontrol.files.result_file import save
from socontrol.mechanics.actuators import InternalMoment
from socontrol.mechanics.robot import Robot
from socontrol.programs.plans.motion_limits import PathLimits
from socontrol.programs.postures.goals import Path, Point, Shape, ShapePoint
from socontrol.programs.postures.statics import Statics
from socontrol.programs.postures.waypoints import Circle
from socontrol.programs.result import Result, Status, Value
from socontrol.programs.tensions.compliance import Compliance
from socontrol.programs.tensions.tension_motion import Motion
from socontrol.programs.tensions.tensions import Tensions
from socontrol.programs.tensions.timing import Timing
from socontrol.report import plots, style, tension_paths, tension_strips
from socontrol.report.motion_curves import histories_figure
from socontrol.report.portrait import _add_goals
from socontrol.report.scene import Scene
from socontrol.report.shapes import Posed, rod_skin
from socontrol.report.tension_cables import PARTS, add_lines, cables_figure

LENGTH, REST = 0.15, 0.15  # m, of the rod and of every line, which runs along it
NAMES = ("t0", "t1", "t2", "p0")
STOP = 2.0


def robot():
    rubber = {"type": "linear", "young_modulus": 3e5, "poisson_ratio": 0.45, "density": 1000}
    rod = {"type": "rod", "length": LENGTH, "strains": "inextensible_constant_curvature", "sections": 2,
           "cross_section": {"type": "circle", "radius": 0.006}, "material": rubber}  # fmt: skip
    cables = {f"t{k}": {"type": "tendon", "along": ["arm"], "offset": [y, z], "limits": [0, 2]}
              for k, (y, z) in enumerate(((4e-3, 0), (-2e-3, 3.4e-3), (-2e-3, -3.4e-3)))}  # fmt: skip
    cables["t0"] |= {"friction": 0.2, "spool": 0.01}
    bladder = {"type": "chamber", "along": ["arm"], "offset": [0, 0], "area": 2e-5, "limits": [-1e4, 5e4]}
    return so.robot({"schema_version": 1, "name": "arm", "segments": {"arm": rod},
                     "actuators": {**cables, "p0": bladder}})  # fmt: skip


def lengths(q):
    """Lengths [4] of lines at a distance from an inextensible rod: the rod's less offset x bend, section by section."""
    y, z = np.array([[4e-3, 0], [-2e-3, 3.4e-3], [-2e-3, -3.4e-3], [0, 0]]).T
    bend_y, bend_z = q[::2], q[1::2]
    return np.sum(LENGTH / 2 * (1 + np.outer(z, bend_y) - np.outer(y, bend_z)), axis=1)


def ends(q, f):
    return {"arm.position": np.array([np.array(f.pose("arm", 1.0)(x))[:3, 3] for x in np.atleast_2d(q)])}


Q, U = np.array([4.0, -6.0, 8.0, 3.0]), np.array([1.2, 0.0, 0.4, 2e4])


@pytest.fixture(scope="module")
def posture():
    goals = {"tip": Point(on="arm", target=(0.1, 0.05, 0.0))}
    question = Tensions(robot=robot(), name="hold", goals=goals, compliance=Compliance(on="arm", axis=(0, 0, 1.0)))
    l = lengths(Q)
    values = {f"inputs.{name}": Value(float(x), unit)
              for name, x, unit in zip(NAMES, U, question.robot.input_units, strict=True)}  # fmt: skip
    values |= {f"lengths.{name}": Value(float(x), "m") for name, x in zip(NAMES, l, strict=True)}
    values |= {"motors.t0": Value((REST - l[0]) / 0.01, "rad"), "tension_end.t0": Value(0.9, "N")}
    values |= {"volumes.p0": Value(2e-5 * l[3], "m^3"), "arm.position": Value([0.1, 0.0, 0.0], "m")}
    values |= {"arm.rotation": Value([0.0, 0.0, 0.0], "rad"), "compliance.tensions": Value(2e-3, "m/N")}
    values |= {"compliance.tensions.least": Value(1.6e-3, "m/N"), "compliance.tensions.greatest": Value(4e-3, "m/N")}
    values |= {f"compliance.lengths{end}": Value(x, "m/N")
               for end, x in (("", 5e-4), (".least", 4e-4), (".greatest", 5e-4))}  # fmt: skip
    s = np.linspace(0, l[0], 9)
    arrays = {"q": Q, "u": U, "cable.t0.s": s, "cable.t0.tension": 1.2 * np.exp(-0.2 * s / s[-1] * np.log(4 / 3) * 5)}
    limits = [{"kind": "input", "name": name, "side": "lower", "limit": 0.0, "index": k, "beyond": 0.0}
              for k, name in ((1, "t1"),)]  # fmt: skip
    details = {"kind": "posture", "limits": limits, "compliance": {"redundancy": 2}}
    return Result(name="hold", type="tensions", status=Status("solved", "Solved."), values=values, arrays=arrays,
                  residuals={"goals.tip": Value(3.2e-3, "m")}, details=details, question=question)  # fmt: skip


def inputs(t):
    """u [K x 4] over a period: t0 on its limit of 2 N for a third, t1 slack for a half, t2 slack throughout."""
    x = np.pi * t / STOP
    zero = np.zeros(t.size)
    return np.column_stack([np.minimum(2.0, 4 * np.sin(x) ** 2), np.maximum(0, np.sin(2 * x)), zero, 1e4 + zero])


CIRCLE = Circle(center=(0.13, 0.0, 0.0), radius=0.03, normal=(1.0, 0.0, 0.0), start=(0.0, 1.0, 0.0), count=24)


def circled(angles):
    return np.column_stack([0.13 + 0 * angles, 0.03 * np.cos(angles), 0.03 * np.sin(angles)])


@pytest.fixture(scope="module")
def path():
    """25 waypoints in equal times: t0 comes back on its way."""
    limits = PathLimits(input_rates={"t0": 20.0}, length_rates={"t0": "5 mm/s", "t1": "8 mm/s"})
    goals = {"tip": Path(on="arm", target=CIRCLE)}
    question = Tensions(robot=robot(), name="round", goals=goals, timing=Timing(duration=STOP, ramp=0.0), limits=limits)
    t = np.linspace(0, STOP, 25)
    turn = 2 * np.pi * t / STOP
    q = np.column_stack([4 * np.cos(turn), 6 * np.sin(turn), 5 * np.cos(turn), 2 * np.sin(turn)])
    arrays = {"q": q[-1], "u": inputs(t)[-1], "path.q": q, "path.u": inputs(t), "path.t": t, "path.tip": circled(turn),
              "path.target": circled(turn), "path.miss": np.zeros(25)}  # fmt: skip
    arrays["path.lengths"] = np.array([lengths(x) for x in q])
    values = {f"inputs.{name}": Value(float(x), unit)
              for name, x, unit in zip(NAMES, arrays["u"], question.robot.input_units, strict=True)}  # fmt: skip
    details = {"kind": "path", "waypoints": 25, "waypoints_solved": 25, "limits": []}
    return Result(name="round", type="tensions", status=Status("solved", "All solved."), arrays=arrays, values=values,
                  residuals={"force": Value(1e-12, "1")}, details=details, question=question)  # fmt: skip


@pytest.fixture(scope="module")
def motion(path):
    """The path in time, simulated: the tip is 2 mm off at 0.5 s, by a bump of 0.2 s."""
    question = replace(path.question, name="swing", motion=Motion(every=0.01), limits=PathLimits())
    f, t = question.robot.functions(compiled=False), np.linspace(0, STOP, 201)
    turn = 2 * np.pi * t / STOP
    q = np.column_stack([4 * np.cos(turn), 6 * np.sin(turn), 5 * np.cos(turn), 2 * np.sin(turn)])
    tips, bump = ends(q, f)["arm.position"], 2e-3 * np.exp(-(((t - 0.5) / 0.1) ** 2))
    arrays = {"t": t, "q": q, "qd": 0 * q, "qdd": 0 * q, "u": inputs(t), "lengths": np.array([lengths(x) for x in q])}
    arrays |= {key: path.arrays[key] for key in ("path.target", "path.t")} | {"target": tips - [1e-4, 0, 0]}
    arrays |= {"unmet": 0 * q, "arm.position": tips, "replay.q": q}
    arrays["replay.arm.position"] = tips + bump[:, None] * [0, 0, 1]
    values = {"replay.tip": Value(2e-3, "m"), "replay.tip_share": Value(2e-3 / LENGTH, "1"),
              "motion.unmet": Value(0.034, "1"), "replay.path": Value(2.0025e-3, "m")}  # fmt: skip
    return Result(name="swing", type="tensions", status=Status("solved", "Held."), arrays=arrays, values=values,
                  details={"kind": "motion"}, question=question)  # fmt: skip


def row(result, head, name):
    """Words of a table's row, the table found by the head of its first column."""
    lines = iter(words(result).splitlines())
    next(x for x in lines if x.startswith(head))
    return next(x for x in lines if x.startswith(f"{name} ")).split()


# Words: a posture

@pytest.mark.parametrize("name", ["posture", "path", "motion"])
def test_tensions_read_within_a_terminal(name, request):
    for line in words(request.getfixturevalue(name), 2).splitlines():
        assert len(line) <= 80 and line == line.rstrip()


def test_a_slack_cable_is_called_slack_and_stands_on_no_limit(posture):
    assert row(posture, "input", "t1")[-1] == "slack" and row(posture, "input", "t0")[-2:] == ["60", "%"]
    assert sentence(posture, "at limit") == "none" and sentence(posture, "goal") == "tip: miss 3.2 mm"


def test_cables_are_told_with_lengths_motors_and_far_ends(posture):
    l = lengths(Q)
    t0, t2, p0 = (row(posture, head, name) for head, name in (("cable", "t0"), ("cable", "t2"), ("chamber", "p0")))
    wanted = [1e3 * l[0], 1e3 * (l[0] - REST), np.degrees((REST - l[0]) / 0.01), 0.9]
    np.testing.assert_allclose([float(x) for x in t0[1:]], wanted, atol=0.006)
    np.testing.assert_allclose([float(x) for x in t2[1:]], [1e3 * l[2], 1e3 * (l[2] - REST)], atol=0.006)
    np.testing.assert_allclose([float(x) for x in p0[1:]], [1e3 * l[3], 0.0, 1e6 * 2e-5 * l[3]], atol=0.006)
    head = next(line for line in words(posture).splitlines() if line.startswith("cable"))
    assert head.split("  ") == ["cable", "length [mm]", "change [mm]", "motor [deg]", "at far end [N]"]


def test_compliances_stand_beside_their_ranges(posture):
    assert row(posture, "compliance", "tensions held")[2:] == ["2.0000", "1.6000", "4.0000", "2.5"]
    assert row(posture, "compliance", "lengths held")[2:] == ["0.5000", "0.4000", "0.5000", "1.25"]
    told = "of the end of arm along [0, 0, 1] (axes of the world) in mm/N; least and greatest"
    assert sentence(posture, "compliance").startswith(told)
    assert sentence(posture, "redundancy") == "2 independent changes of the inputs that keep the goals"
    alone = replace(posture, details={**posture.details, "compliance": {"redundancy": 0}})
    assert sentence(alone, "redundancy").startswith("none")


def test_what_cables_would_need_is_said_and_no_cable_is_told_to_push(posture):
    """The message names them; no table gives a tension below 0, and no limit is said not to be reached."""
    known = {"kind": "input", "unit": "N", "pulls": True}
    rows = [{**known, "name": "t0", "side": "upper", "limit": 2.0, "needed": 63.0},
            {**known, "name": "t1", "side": "lower", "limit": 0.0, "needed": -0.1096}]  # fmt: skip
    message = ("Out of reach: the nearest posture misses tip by 7 mm. t0 would need 63 N, its limit is 2 N. "
               "t1 is slack and would have to push with 0.1096 N.")  # fmt: skip
    far = replace(posture, status=Status("infeasible", message), details={**posture.details, "unreachable": rows})
    said = " ".join(words(far).split())
    assert said.startswith(f"hold: {message}")
    assert "alone it would have to be" not in said and "-109.6" not in said and "at limit" not in said
    filled = [{**rows[0], "name": "p0", "pulls": False, "unit": "Pa", "limit": 5e4, "needed": None}]
    together = f"{message.partition('. ')[0]}. Together they would do: p0 would need 70 kPa, its limit is 50 kPa."
    other = replace(far, status=Status("infeasible", together), details={"unreachable": filled})
    assert "no way found by this limit alone" in words(other)
    assert sentence(other, "together") == "p0 would need 70 kPa, its limit is 50 kPa"


def test_bars_show_what_does_not_read_as_nothing(path):
    """A block at least from 1 % on, one value or a range; none for 0 %."""
    for share, top, wanted in ((0.04, 0.04, 1), (0.0, 0.03, 1), (0.0, 0.0, 0), (0.5, 1.0, 5), (1.0, 1.0, 10)):
        u = np.tile(U, (25, 1))
        u[:, 0] = 2.0 * np.linspace(share, top, 25)
        told = " ".join(row(replace(path, arrays={**path.arrays, "path.u": u}), "input", "t0"))
        assert told.count("\u2588") == wanted, told


def test_attempts_at_all_waypoints_together_are_told_from_their_guesses(path):
    made = [{"start": "rest", "outcome": "solved", "iterations": 3, "seconds": 0.1}] * 5
    made += [{**made[0], "start": "together"}]
    result = replace(path, details={**path.details, "attempts": made})
    assert sentence(result, "attempts") == "1 at all waypoints together, guessed from 5 waypoint by waypoint"


def test_statics_with_given_tensions_tells_its_cables_and_calls_the_slack_one_slack():
    result = Statics(robot=robot(), name="pulled", inputs={"t0": 0.5, "t2": 0.3}, discretisation=False).solve()
    assert row(result, "cable", "t2")[0] == "t2" and row(result, "input", "t1")[-1] == "slack"
    assert sentence(result, "at limit") == "none"


def test_what_an_internal_moment_turns_is_no_length(path):
    description = path.question.robot.description
    muscle = {"muscle": InternalMoment(along=("arm",), strain="bend_z", stations=2)}
    more = Robot(replace(description, actuators={**description.actuators, **muscle}))
    assert more.inputs[-2:] == ("muscle.0", "muscle.1")
    arrays = {**path.arrays, **{key: np.column_stack([path.arrays[key], np.ones((25, 2)) * np.arange(25)[:, None]])
                                for key in ("path.u", "path.lengths")}}  # fmt: skip
    values = {**path.values, "lengths.muscle.0": Value(1.0, "rad")}
    values |= {f"inputs.{name}": Value(24.0, "N m") for name in more.inputs[-2:]}
    result = replace(path, arrays=arrays, values=values, question=replace(path.question, robot=more))
    for head in ("length ", "largest length"):
        table = words(result).partition(f"\n{head}")[2].partition("\n\n")[0]
        assert "t0" in table and "muscle" not in table
    told = words(result, 1)
    assert told.count("muscle.0") == 2  # its range and its rate, as an input
    for (title, unit), ax in strips(result).items():
        assert "length" not in title or not {"muscle.0", "muscle.1"} & set(drawn(ax, unit))


def test_statics_of_given_lengths_says_what_was_found_and_how_loose_a_slack_cable_is():
    given = {"t0": lengths(Q)[0], "t1": 0.16}
    result = Statics(robot=robot(), name="held", lengths=given, volumes={"p0": 2e-5 * REST},
                     discretisation=False).solve().require()  # fmt: skip
    assert sentence(result, "found") == "t0, t1 from their lengths; p0 from its volume"
    t1 = row(result, "cable", "t1")
    assert row(result, "input", "t1")[-1] == "slack" and float(t1[1]) + float(t1[-1]) == pytest.approx(160, abs=0.006)


def test_a_simulation_of_given_lengths_tells_ranges_and_slack_cables(motion, path):
    arrays = {key: motion.arrays[key] for key in ("t", "q", "u")} | {"energy": np.zeros((201, 3))}
    question = SimpleNamespace(**{key: getattr(path.question, key) for key in ("robot", "input_limits")}, driven={},
                               lengths={"t0": 0.1}, motors=None, volumes=None)  # fmt: skip
    result = Result(name="wind", type="simulation", status=Status("solved", "Simulated."), question=question,
                    arrays=arrays | {"work": np.zeros((201, 5))})  # fmt: skip
    assert sentence(result, "found") == "t0 from its length"
    assert sentence(result, "slack").startswith("t2 throughout")
    assert row(result, "input", "t0")[1:4] == ["0.0000", "2.0000", "N"]
    question.loaded, more = question.robot, {key: motion.arrays[key] for key in ("arm.position", "lengths")}
    held = replace(result, arrays={**result.arrays, **more}, details={"held": ["t0"]})
    (ax,) = [ax for ax in histories_figure(held).axes if ax.get_ylabel() == "length [mm]"]
    ((_, y),) = drawn(ax, "mm").values()
    np.testing.assert_allclose(y, motion.arrays["lengths"][:, 0], atol=1e-12)


def test_a_simulation_of_given_tensions_tells_its_cables(motion):
    values = {"lengths.t0": Value(0.14, "m"), "lengths.p0": Value(0.15, "m"), "volumes.p0": Value(3e-6, "m^3")}
    arrays = {key: motion.arrays[key] for key in ("t", "q", "u")} | {"energy": np.zeros((201, 3))}
    question = SimpleNamespace(robot=motion.question.robot, input_limits=motion.question.input_limits, driven={})
    result = Result(name="pulled", type="simulation", status=Status("solved", "Simulated."), question=question,
                    arrays=arrays | {"work": np.zeros((201, 5))}, values=values)  # fmt: skip
    assert row(result, "cable", "t0") == ["t0", "140.00", "-10.000"]
    assert row(result, "chamber", "p0")[-1] == "3.000" and "found" not in words(result)


# Words: paths and motions

def test_ranges_rates_and_limits_of_a_path_are_told_with_waypoints(path):
    u, l, t = (path.arrays[f"path.{key}"] for key in ("u", "lengths", "t"))
    told = row(path, "length ", "t0")
    wanted = 1e3 * np.array([l[:, 0].min(), l[:, 0].max(), l[:, 0].min() - REST, l[:, 0].max() - REST])
    np.testing.assert_allclose([float(x) for x in told[1:5]], wanted, atol=0.006)
    for head, values, one, limit in (("largest tension", u, 1.0, "-20 to 20 N/s"),
                                     ("largest length", l, 1e-3, "-5 to 5 mm/s, passed")):  # fmt: skip
        rates = np.diff(values[:, 0]) / np.diff(t) / one
        told = row(path, head, "t0")
        assert abs(float(told[1])) == pytest.approx(np.max(np.abs(rates)), rel=2e-3) and " ".join(told[4:]) == limit
        assert rates[int(told[3]) - 2] == pytest.approx(float(told[1]), rel=2e-3)
    slower = replace(path.question, limits=PathLimits(length_rates={"t0": float(np.max(np.abs(rates)) * 1e-3)}))
    assert row(replace(path, question=slower), "largest length", "t0")[-1] == "reached"
    for side in (-1, 1):  # what is at its limit is told with its sign, and not what is larger on the other side
        reached = float(np.max(side * rates)) * 1e-3
        ends = (-0.1, reached) if side > 0 else (-reached, 0.1)
        told = row(replace(path, question=replace(path.question, limits=PathLimits(length_rates={"t0": ends}))),
                   "largest length", "t0")  # fmt: skip
        assert float(told[1]) == pytest.approx(side * reached * 1e3, rel=2e-3) and told[-1] == "reached"
    u0, u1 = u[:, 0], u[:, 1]
    assert sentence(path, "at limit") == f"t0 at 2 N ({np.sum(u0 > 2 - 1e-9)} of 25 waypoints)"
    assert sentence(path, "slack").startswith("t2 throughout, t0 (")
    assert f"t1 ({np.sum(u1 < 2e-6)} of 25 waypoints)" in sentence(path, "slack")


def test_cables_with_friction_tell_where_they_turn(path):
    turned = replace(path, details={**path.details, "directions": {"t0": [7, 19]}, "undecided": {"t0": [8]}})
    assert sentence(turned, "turns") == "t0 on the way to waypoints 7, 19"
    assert sentence(turned, "undecided").startswith("t0 at waypoint 8: friction holds it")
    straight = replace(path, details={**path.details, "directions": {"t0": []}, "undecided": {}})
    assert sentence(straight, "turns").startswith("none") and "undecided" not in words(straight)
    assert "turns" not in words(path)


def test_a_motion_tells_limits_in_time_what_is_unmet_and_where_its_simulation_strays(motion):
    assert sentence(motion, "duration") == "2 s in 201 samples"
    share = np.mean(motion.arrays["u"][:, 0] >= 2)
    told = sentence(motion, "at limit")
    assert told.startswith("t0 at 2 N for ") and float(told.split()[5]) == pytest.approx(STOP * share, abs=0.02)
    assert sentence(motion, "unmet").startswith("3.4 % of the largest force at most")
    simulated = sentence(motion, "simulated")
    assert "end of arm within 2 mm of the motion (1.3 % of the robot's length), furthest at 0.5 s" in simulated
    width = np.ptp(motion.arrays["target"], axis=0).max()
    assert f"within 2 mm of the timed path ({100 * 2.0025e-3 / width:.2g} % of its width)" in simulated
    without = {k: v for k, v in motion.arrays.items() if not k.startswith("replay")}
    assert sentence(replace(motion, arrays=without), "simulated") == "the simulation failed"


def test_a_motion_whose_path_is_out_of_reach_is_told_as_the_path_it_is(path):
    result = replace(path, details={**path.details, "kind": "motion"}, status=Status("infeasible", "Out of reach."))
    assert "25 of 25 waypoints" in words(result) and "samples" not in words(result)
    assert plots._figures(result) == plots._figures(path) and {"path", "strips"} <= set(plots._figures(path))


# Figures

ONES = {"N": 1.0, "mN": 1e-3, "kPa": 1e3, "mm": 1e-3, "N/s": 1.0, "kPa/s": 1e3, "mm/s": 1e-3}


def strips(result):
    """{(title, unit): axes}."""
    axes = tension_strips.strips_figure(result).axes
    return {(" ".join(label.split("\n")[:-1]), label.rstrip("]").split("[")[1]): ax
            for ax in axes for label in [ax.get_ylabel()]}  # fmt: skip


def drawn(ax, unit):
    """{label: (x, y in SI)} of the curves of an axes."""
    return {line.get_label(): (line.get_xdata(), line.get_ydata() * ONES[unit])
            for line in ax.lines if not line.get_label().startswith("_")}  # fmt: skip


@pytest.mark.parametrize("name", ["path", "motion"])
def test_strips_show_inputs_and_changes_of_length(name, request):
    result = request.getfixturevalue(name)
    key = "path." * (name == "path")
    t, u, l = (result.arrays[key + x] for x in ("t", "u", "lengths"))
    axes, seen = strips(result), set()
    for title, unit, values in (("tension", "N", u), ("pressure", "kPa", u), ("change of length", "mm", l - REST)):
        for label, (x, y) in drawn(axes[title, unit], unit).items():
            np.testing.assert_allclose(y, values[:, NAMES.index(label)], atol=1e-12)
            np.testing.assert_array_equal(x, t)
            seen.add((title, label))
    assert len(seen) == 8
    levels = {line.get_ydata()[0] for line in axes["tension", "N"].lines if line.get_label() == "_limit"}
    assert levels == {0.0, 2.0} and sum(p.get_label() == "_beyond" for p in axes["tension", "N"].patches) == 2


def test_rates_of_a_path_are_steps_from_waypoint_to_waypoint_with_their_limits(path):
    t, l = path.arrays["path.t"], path.arrays["path.lengths"]
    ax = strips(path)["length rate", "mm/s"]
    x, y = drawn(ax, "mm/s")["t1"]
    np.testing.assert_allclose(y, np.repeat(np.diff(l[:, 1]) / np.diff(t), 2), atol=1e-12)
    np.testing.assert_array_equal(x, np.repeat(t, 2)[1:-1])
    assert sorted(line.get_ydata()[0] for line in ax.lines if line.get_label() == "_limit") == [-8, -5, 5, 8]


def test_limits_too_far_off_to_be_drawn_are_told(path):
    little = replace(path, arrays={**path.arrays, "path.u": 0.05 * path.arrays["path.u"]})
    figure = tension_strips.strips_figure(little)
    assert "not drawn: limit of tension, 2 N" in figure.get_suptitle()
    assert "tension," not in tension_strips.strips_figure(path).get_suptitle()
    assert not [line for line in figure.axes[0].lines if line.get_label() == "_limit" and line.get_ydata()[0] == 2]


def test_a_path_that_stops_is_drawn_as_far_as_it_came(path, tmp_path, recwarn):
    """Waypoints beyond it would stand far outside of the figure: nothing is left of its axes."""
    part = {k: path.arrays[k][:2] for k in ("path.q", "path.u", "path.lengths", "path.tip", "path.miss")}
    figure = tension_strips.strips_figure(replace(path, arrays={**path.arrays, **part}))
    figure.savefig(tmp_path / "strips.png", dpi=40)
    assert not [w for w in recwarn if "layout" in str(w.message)]
    (ticks,) = [line for line in figure.axes[0].lines if line.get_label() == "_nodes"]
    np.testing.assert_array_equal(ticks.get_xdata(), path.arrays["path.t"][:2])


def test_titles_end_within_their_figure(path):
    named = replace(path, name="a_name_as_long_as_one_likes")
    for figure in (plots.path_figure(named, inputs=False), tension_strips.strips_figure(named)):
        figure.draw_without_rendering()
        box = figure._suptitle.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.width


def test_points_of_a_shape_that_are_missed_take_one_row_of_the_key(posture):
    goal = Shape(on="arm", target=tuple(ShapePoint(at=x, position=(0.15 * x, 0.0, 0.05)) for x in (0.4, 0.7, 1.0)))
    question = replace(posture.question, goals={"wrap": goal}, compliance=None)
    entries = _add_goals(Scene(up=np.array([0, 0, 1.0])), replace(posture, question=question),
                         Posed(question.robot, np.zeros(4)), LENGTH)  # fmt: skip
    assert [label for _, label in entries] == ["goal wrap", "wrap missed by at most 50 mm"]


def test_strips_of_a_motion_show_how_far_its_simulation_strays(motion):
    """Off the path where its only end is tracked, else off the motion."""
    free = replace(motion, arrays={k: v for k, v in motion.arrays.items() if k != "target"})
    for result, title, key in ((motion, "off the path", "target"), (free, "off the motion", "arm.position")):
        axes, way = strips(result), motion.arrays["replay.arm.position"] - motion.arrays[key]
        ((_, y),) = drawn(axes[title, "mm"], "mm").values()
        np.testing.assert_allclose(y, np.linalg.norm(way, axis=1), atol=1e-15)
        assert sum(title.startswith("off") for title, _ in axes) == 1


def test_waypoints_without_times_are_counted(path):
    arrays = {k: v for k, v in path.arrays.items() if k != "path.t"}
    figure = tension_strips.strips_figure(replace(path, arrays=arrays))
    assert figure.axes[-1].get_xlabel() == "waypoint" and len(figure.axes) == 3  # no rates
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xdata(), np.arange(1, 26))


def test_the_simulated_path_is_drawn_beside_the_wanted_one_to_one_scale(motion):
    (ax,) = tension_paths.tracked_figure(motion).axes
    curves = {line.get_label(): line for line in ax.lines}
    wanted, real = motion.arrays["target"], motion.arrays["replay.arm.position"]
    shown = np.array([curves["wanted"].get_xydata(), curves["end of arm, simulated"].get_xydata()])
    if curves["wanted"].axes.name == "3d":
        shown = np.array([np.array(curves[x].get_data_3d()).T for x in ("wanted", "end of arm, simulated")])
    np.testing.assert_allclose(shown * 1e-3, [wanted, real], atol=1e-12)


def test_slack_cables_are_dashed_and_the_others_coloured_by_their_tension_along_the_way(posture):
    scene, posed = Scene(up=np.array([0, 0, 1.0])), Posed(posture.question.robot, Q)
    scene.skin(rod_skin(posed, "arm"), style.SOFT)
    scale, legend = add_lines(scene, posture, posed, LENGTH)
    assert [label for _, label in legend] == ["slack cable"]
    dashed = [s for s in scene.strokes if s.style == "--"]
    np.testing.assert_allclose([s.points[0] for s in dashed], [[0, -2e-3, 3.4e-3]], atol=1e-12)
    rubs = scene.strokes[:PARTS]
    way = np.cumsum([0.0, *(np.sum(np.linalg.norm(np.diff(s.points, axis=0), axis=1)) for s in rubs)])
    s, tension = posture.arrays["cable.t0.s"], posture.arrays["cable.t0.tension"]
    wanted = [scale.colour(0, np.interp(x, s, tension)) for x in (way[1:] + way[:-1]) / 2]
    np.testing.assert_allclose([x.colour for x in rubs], wanted, atol=0.02)
    assert len({x.colour for x in rubs}) > 5


def test_the_tension_along_a_cable_is_drawn_over_its_length(posture, path):
    s, tension = posture.arrays["cable.t0.s"], 0.1 * posture.arrays["cable.t0.tension"]
    (ax,) = cables_figure(replace(posture, arrays={**posture.arrays, "cable.t0.tension": tension})).axes
    assert ax.get_ylabel() == "tension [mN]" and ax.get_xlabel().endswith("[mm]")
    ((x, y),) = drawn(ax, "mN").values()
    np.testing.assert_allclose([x * 1e-3, y], [s, tension])
    assert cables_figure(path) is None


@pytest.mark.parametrize("name, stems", [("posture", {"robot", "inputs", "strains", "cables"}),
                                         ("motion", {"shapes", "strips", "path", "coordinates"})])  # fmt: skip
def test_figures_of_tensions_are_small_png_files(name, stems, request, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "RESOLUTIONS", (60,))
    paths = plots.draw(request.getfixturevalue(name), tmp_path)
    assert {p.stem for p in paths} == stems
    assert all(p.read_bytes().startswith(b"\x89PNG") and p.stat().st_size < 200_000 for p in paths)


@pytest.mark.parametrize("name, file", [("path", "path.csv"), ("motion", "plan.csv")])
def test_a_table_for_a_controller_holds_times_tensions_and_lengths(name, file, request, tmp_path):
    result, key = request.getfixturevalue(name), "path." * (name == "path")
    save(result, SimpleNamespace(data={}), tmp_path / "out")
    rows = list(csv.reader((tmp_path / "out" / file).read_text().splitlines()))
    head = [x.partition(" [")[0].removeprefix("u.") for x in rows[0]]
    read = dict(zip(head, np.array(rows[1:], dtype=float).T, strict=True))
    np.testing.assert_allclose(read["t"], result.arrays[key + "t"], atol=1e-12)
    for k, column in enumerate(NAMES):
        np.testing.assert_allclose(read[column], result.arrays[key + "u"][:, k], rtol=1e-11)
        np.testing.assert_allclose(read[f"length.{column}"], result.arrays[key + "lengths"][:, k], rtol=1e-11)
