"""Plans on the command line: problems from flags and files, what is written, and what is said of mistakes."""

import csv
import json
import os
import pty
import re
import subprocess
import sys

import numpy as np
import pytest

import socontrol as so
from socontrol import cli
from socontrol.files.plan_files import MOST_NUMBERS
from socontrol.files.yaml_reader import parse

ARM = """
schema_version: 1
name: arm
segments:
  upper:
    type: revolute
    axis: [0, 1, 0]
    stiffness: 2
    damping: 0.05
    body: {mass: 0.1, com: [0.1, 0, 0], inertia: [0, 1e-3, 1e-3]}
    tip: {position: [0.2, 0, 0]}
  lower:
    type: revolute
    parent: upper
    axis: [0, 1, 0]
    stiffness: 1
    damping: 0.05
    body: {mass: 0.1, com: [0.05, 0, 0], inertia: [0, 1e-3, 1e-3]}
    tip: {position: [0.1, 0, 0]}
actuators:
  m0: {type: joint_torque, joint: upper, limits: [-3, 3]}
  m1: {type: joint_torque, joint: lower, limits: [-3, 3]}
"""
TURN = """
schema_version: 1
type: trajectory
robot: arm.yaml
duration: 1
mesh: {intervals: 16}
end: {coordinates: {upper: 0.5, lower: 0}}
"""
REACH = ("--to", "tip=0.25,null,0.08", "--duration", "0.6", "--intervals", "16", "--minimise", "smoothness=2")
BALL = "sphere:0.31,0,0.01,30 mm"  # across the way of the arm's end


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a robot and a problem."""
    (tmp_path / "arm.yaml").write_text(ARM.lstrip())
    (tmp_path / "turn.yaml").write_text(TURN.lstrip())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def socontrol(capfd):
    """Runs a command in this process: (exit code, stdout, stderr)."""

    def command(*arguments):
        capfd.readouterr()
        code = cli.run([str(a) for a in arguments])
        out, err = capfd.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return command


def plan(socontrol, *arguments):
    return socontrol("plan", "arm.yaml", "--no-figures", *arguments)


# Plans from flags

def test_a_plan_from_flags_goes_where_it_was_sent_and_leaves_a_folder(folder, socontrol):
    code, out, err = plan(socontrol, *REACH)
    assert code == 0 and "Solved" in out and err == "socontrol: results/arm_plan/ written\n"
    result = so.load_result("results/arm_plan").require()
    end = result.arrays["lower.position"][-1]
    np.testing.assert_allclose(end[[0, 2]], [0.25, 0.08], atol=1e-6)
    np.testing.assert_allclose(result.arrays["qd"][-1], 0, atol=1e-5)
    assert result.arrays["t"][-1] == 0.6 and result.type == "trajectory"
    assert {"plan.csv", "arrays.npz", "result.json"} <= set(os.listdir("results/arm_plan"))


def test_the_table_for_a_controller_holds_the_stored_plan_to_the_last_digit(folder, socontrol):
    plan(socontrol, *REACH)
    arrays = so.load_result("results/arm_plan").arrays
    with open("results/arm_plan/plan.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    for name, column in {"t": arrays["t"], "q.lower": arrays["q"][:, 1], "u.m0": arrays["u"][:, 0]}.items():
        assert [float(row[name]) for row in rows] == column.tolist()


def test_an_obstacle_of_a_flag_is_kept_clear_of(folder, socontrol):
    plan(socontrol, *REACH, "--name", "free")
    code, _, _ = plan(socontrol, *REACH, "--avoid", BALL, "--name", "clear")
    assert code == 0

    def gap(name):
        tip = so.load_result(f"results/{name}").arrays["lower.position"]
        return np.min(np.linalg.norm(tip - [0.31, 0, 0.01], axis=1)) - 0.03

    assert gap("free") < -0.01 and gap("clear") > -2e-4


def test_the_saved_file_is_the_same_question(folder, socontrol):
    (folder / "plans").mkdir()
    flags = ("--avoid", BALL, "--via", "50%:upper=0.1", "--limit-rate", "m0=40 N*m/s",
             "--from", "upper=0.05,lower=2 deg", "--scheme", "lobatto", "--points", "3")  # fmt: skip
    code, out, err = plan(socontrol, *REACH, *flags, "--save", "plans/reach.yaml", "--json")
    first = json.loads(out)
    assert code == 0 and "plans/reach.yaml written" in err and first["folder"] == "results/reach"
    assert parse((folder / "plans/reach.yaml").read_text()).data["robot"] == "../arm.yaml"
    code, out, _ = socontrol("solve", "plans/reach.yaml", "--json", "--no-figures", "-o", "again")
    second = json.loads(out)
    assert code == 0 and second["hash"] == first["hash"] and second["name"] == "reach"
    assert second["values"]["cost"] == first["values"]["cost"]


def test_flags_say_what_a_file_says(folder, socontrol):
    flags = ("--to", "upper=0.5", "--to", "tip=0.1,free,50 mm", "--duration", "0.5 s..3", "--quasi-static",
             "--via", "20%:lower=1 deg", "--via", "20%:tip=1,2,3", "--via", "0.4%:upper=0", "--limit-rate", "lower=3",
             "--avoid", "sphere:1,1,1,1", "--avoid", "sphere:2,2,2,1",
             "--minimise", "time=2", "--minimise", "effort", "--water", "1 g/cm^3")  # fmt: skip
    code, out, err = plan(socontrol, *flags, "--dry-run", "--name", "far")
    assert (code, err) == (0, "") and not (folder / "results").exists()
    tip = {"type": "point", "on": "lower"}
    assert parse(out).data == {
        "name": "far", "schema_version": 1, "type": "trajectory", "robot": "arm.yaml",
        "duration": {"shortest": "0.5 s", "longest": 3.0}, "quasi_static": True,
        "loads": {"water": {"type": "fluid", "density": "1 g/cm^3"}}, "start": {"settled": True},
        "end": {"coordinates": {"upper": 0.5}, "goals": {"tip": {**tip, "target": [0.1, None, "50 mm"]}}},
        "waypoints": {
            "via_1": {"share": 0.2, "coordinates": {"lower": "1 deg"}, "goals": {"tip": {**tip, "target": [1, 2, 3]}}},
            "via_2": {"share": 0.004, "coordinates": {"upper": 0}},
        },
        "obstacles": {"sphere": {"type": "sphere", "center": [1, 1, 1], "radius": 1},
                      "sphere_2": {"type": "sphere", "center": [2, 2, 2], "radius": 1}},
        "limits": {"rates": {"lower": 3}},
        "costs": {"time": {"type": "time", "weight": 2}, "effort": {"type": "effort"}},
    }  # fmt: skip


def test_a_dry_run_writes_the_file_alone_and_asks_before_it_replaces_one(folder, socontrol):
    before = sorted(os.listdir(folder))
    save = (*REACH, "--save", "reach.yaml", "--dry-run")
    code, out, err = plan(socontrol, *save)
    assert (code, out, err) == (0, "", "socontrol: reach.yaml written\n")
    assert sorted(os.listdir(folder)) == sorted([*before, "reach.yaml"])
    text = (folder / "reach.yaml").read_text()
    code, _, err = plan(socontrol, *save, "--scheme", "lobatto")
    assert code == 2 and err == "socontrol: --save reach.yaml: exists and is not overwritten; --force replaces a file\n"
    assert (folder / "reach.yaml").read_text() == text
    assert plan(socontrol, *save, "--scheme", "lobatto", "--force")[0] == 0
    assert "scheme: lobatto" in (folder / "reach.yaml").read_text()
    assert socontrol("check", "reach.yaml")[0] == 0


USAGE = [  # flags beside --duration 1 (where they give none): the line on stderr
    (["--to", "tip=0.3,0"], "--to tip=0.3,0: 2 numbers are given; three are a point of a segment, one is a coordinate"),
    (["--to", "tip"], "--to tip: NAME=X,Y,Z of a segment, or NAME=VALUE of a coordinate, is wanted"),
    (["--to", "tip=0.3,a,0"], "--to tip=0.3,a,0: 'a' is no number, nor one with a unit such as '50 mm'"),
    (["--to", "tip=0.3,nan,0"], "--to tip=0.3,nan,0: nan is not a finite number"),
    (["--to", "upper=1", "--to", "upper=2"], "--to upper=2: --to upper=1 says this already; give one of them"),
    (["--duration", "1.."], "--duration 1..: SHORTEST..LONGEST is wanted, e.g. 0.5..3"),
    (["--duration", "1..3", "--via", "1:upper=0"],
     "--via 1:upper=0: the duration is free, so give a share of it, e.g. --via 50%:upper=0"),
    (["--via", "upper=0"], "--via upper=0: TIME:NAME=X,Y,Z is wanted, the time in seconds or as a share such as 50%"),
    (["--via", "120%:upper=0"], "--via 120%:upper=0: 120% is no share between 0% and 100%"),
    (["--avoid", "sphre:1,1,1,1"], "--avoid: 'sphre:1,1,1,1': unknown obstacle 'sphre'; did you mean 'sphere'?"),
    (["--avoid", "sphere:1,1"], "--avoid: 'sphere:1,1': 2 given; sphere takes 4 numbers: center x,y,z, radius"),
    (["--minimise", "tme"], "--minimise tme: unknown cost 'tme'; did you mean 'time'?"),
    (["--minimise", "tracking"], "--minimise tracking: a cost of type tracking needs on as well; "
     "write it into the file that --save makes"),
    (["--limit-rate", "m0"], "--limit-rate m0: INPUT=VALUE is wanted"),
    (["--from", "upper"], "--from upper: `rest`, or NAME=VALUE of coordinates with commas between them, is wanted"),
    (["--name", "a/b"], "--name a/b: a name of a result folder is wanted, without slashes"),
    (["--save", "nowhere/x.yaml"], "--save nowhere/x.yaml: there is no folder nowhere"),
]  # fmt: skip


@pytest.mark.parametrize("flags, line", USAGE, ids=[" ".join(flags) for flags, _ in USAGE])
def test_a_flag_of_the_wrong_form_exits_2_and_is_named(folder, socontrol, flags, line):
    given = [*flags, *([] if "--to" in flags else ["--to", "upper=1"])]
    given += [] if "--duration" in flags else ["--duration", "1"]
    before = sorted(os.listdir(folder))
    code, out, err = plan(socontrol, *given)
    assert (code, out, err) == (2, "", f"socontrol: {line}\n")
    assert sorted(os.listdir(folder)) == before


CONTENT = [  # what a file could say as well: the line on stderr
    (["--to", "lowr=0.3,0,1"], "--to lowr=0.3,0,1: unknown segment 'lowr'; did you mean 'lower'?"),
    (["--to", "uper=1"], "--to uper=1: the robot has no coordinate 'uper'; did you mean 'upper'?"),
    (["--to", "upper=1 kg"], "--to upper=1 kg: 1 kg is a mass; an angle is wanted, e.g. '90 deg' or 1.5708"),
    (["--duration", "-1"], "--duration -1: -1.0 is below "),
    (["--duration", "3..1"], "--duration 3..1: 1 s is not after shortest: 3 s"),
    (["--via", "1:upper=0"], "--via 1:upper=0: it is not before the end; what holds there stands under `end`"),
    (["--via", "0.5:lowr=0"], "--via 0.5:lowr=0: the robot has no coordinate 'lowr'; did you mean 'lower'?"),
    (["--avoid", "sphere:1,1,1,-1"], "--avoid sphere:1,1,1,-1: -1.0 is not positive"),
    (["--scheme", "rado"], "--scheme rado: 'rado' is not known here; did you mean 'radau'?"),
    (["--points", "99"], "--points 99: 99 points; 'radau' has 1 to "),
    (["--minimise", "time"], "--minimise time: the duration is given; free it"),
    (["--limit-rate", "m9=1"], "--limit-rate m9=1: the robot has no 'm9'; allowed: m0, m1"),
    (["--from", "uper=1"], "--from uper=1: the robot has no coordinate 'uper'; did you mean 'upper'?"),
]


@pytest.mark.parametrize("flags, line", CONTENT, ids=[" ".join(flags) for flags, _ in CONTENT])
def test_a_mistake_that_a_file_could_hold_exits_3_in_the_words_of_the_flag(folder, socontrol, flags, line):
    given = [*flags, *([] if "--to" in flags else ["--to", "upper=1"])]
    given += [] if "--duration" in flags else ["--duration", "1"]
    code, out, err = plan(socontrol, *given, "--save", "new.yaml")
    assert (code, out) == (3, "") and err.count("\n") == 1
    assert err.startswith(line), err
    assert not (folder / "new.yaml").exists() and not (folder / "results").exists()


def test_mistakes_of_the_robot_are_those_of_its_file(folder, socontrol):
    (folder / "arm.yaml").write_text(ARM.lstrip().replace("stiffness: 2", "stifness: 2"))
    code, out, err = plan(socontrol, *REACH)
    assert (code, out) == (3, "") and err.startswith("arm.yaml:7: segments.upper.stifness: unknown key 'stifness'")
    code, _, err = socontrol("plan", "turn.yaml", *REACH)
    assert code == 3 and err.startswith("turn.yaml:3: robot: this is a problem file; `socontrol solve` answers it")
    code, out, err = socontrol("plan", "nowhere.yaml", *REACH, "--json")
    assert code == 2 and json.loads(out)["exit"] == 2 and err.startswith("nowhere.yaml: cannot be read")


# Guesses and targets from files

def guessed(folder, socontrol, text, *more):
    """(exit code, stdout, stderr) of `check` of a problem whose guess is a file with this text."""
    (folder / "way.csv").write_text(text)
    (folder / "turn.yaml").write_text(TURN.lstrip() + "guess: {file: way.csv}\n")
    return socontrol("check", "turn.yaml", *more)


SHEETS = {  # a text of a table: what is wrong with it
    "time,upper\n0,0\n1,1\n": "'way.csv' has no column 't' of the time; it has time and upper",
    "t,upper,lowr\n0,0,0\n1,1,1\n": "'way.csv' has a column 'lowr' that is no coordinate or input; did you mean 'low",
    "t,q.uper\n0,0\n1,1\n": "'way.csv' has a coordinate 'uper', which this robot lacks; did you mean 'upper'?",
    "t,upper\n0,0\n1,1\n1,2\n": "way.csv:4: 1 s does not come after 1 s; times must rise",
    "t,upper\n0,0\n1,nan\n": "way.csv:3: nan in column 'upper' is not a finite number",
    "t,upper\n0,0\n1\n": "way.csv:3: no number in column 'upper'",
    "t,upper\n0,0\n\n1,x\n": "way.csv:4: no number in column 'upper'",
    "t,upper,q.upper\n0,0,0\n1,1,1\n": "'way.csv' has coordinate 'upper' in two columns",
    "t\n0\n1\n": "'way.csv' has no column of a coordinate or an input",
    "t,upper\n0,0\n": "'way.csv' has 1 row of numbers; two are wanted",
    "": "'way.csv' has no column 't' of the time; it has none",
}


@pytest.mark.parametrize("text, sentence", SHEETS.items())
def test_a_table_that_cannot_be_a_guess_is_refused_in_one_line(folder, socontrol, text, sentence):
    code, out, err = guessed(folder, socontrol, text)
    assert (code, out) == (3, "") and err.count("\n") == 1
    assert err.startswith(f"turn.yaml:7: guess.file: {sentence}"), err


@pytest.mark.parametrize("text", [
    "t,upper,m1\n0,0.1,1\n1,0.3,2\n",
    "u.m1, t ,length.m0,q.upper,qd.upper\n1,0,7,0.1,7\n2,1,7,0.3,7\n\n",
])  # fmt: skip
def test_a_table_becomes_the_guess_by_its_names_in_any_order(folder, socontrol, text):
    assert guessed(folder, socontrol, text)[0] == 0
    guess = so.load_problem("turn.yaml").guess
    assert guess.times == (0.0, 1.0) and guess.coordinates == {"upper": (0.1, 0.3)} and guess.inputs == {"m1": (1, 2)}
    mapping = {**parse(TURN).data, "guess": {"file": "way.csv"}}
    assert so.problem(mapping).guess == guess


def test_a_result_and_its_table_are_the_same_guess(folder, socontrol):
    plan(socontrol, *REACH)
    guesses = []
    for file in ("results/arm_plan", "results/arm_plan/plan.csv"):
        (folder / "turn.yaml").write_text(TURN.lstrip() + f"guess: {{file: {file}}}\n")
        guesses.append(so.load_problem("turn.yaml").guess)
    assert guesses[0] == guesses[1]
    arrays = so.load_result("results/arm_plan").arrays
    np.testing.assert_allclose(guesses[0].times, arrays["t"], rtol=1e-11)
    np.testing.assert_allclose(guesses[0].coordinates["lower"], arrays["q"][:, 1], rtol=1e-11)
    np.testing.assert_allclose(guesses[0].inputs["m0"], arrays["u"][:, 0], rtol=1e-11)


def test_a_search_that_begins_at_the_answer_is_short(folder, socontrol):
    cold = json.loads(plan(socontrol, *REACH, "--save", "reach.yaml", "--json")[1])
    warm = socontrol("solve", "reach.yaml", "--no-figures", "--json", "-o", "warm", "--set",
                     "guess={file: results/reach}")  # fmt: skip
    warm = json.loads(warm[1])
    assert warm["exit"] == 0 and warm["solver"]["iterations"] < cold["solver"]["iterations"]
    assert warm["values"]["cost"]["value"] == pytest.approx(cold["values"]["cost"]["value"], rel=1e-5)
    assert "guess" in (folder / "warm/reach/problem.resolved.yaml").read_text()
    assert so.load_result("warm/reach").question.guess.times, "the guess stands in the resolved problem"


def test_a_result_of_another_robot_is_refused_by_name(folder, socontrol):
    plan(socontrol, *REACH)
    (folder / "arm.yaml").write_text(ARM.lstrip().replace("lower", "fore").replace("m1", "elbow"))
    code, _, err = socontrol("check", "turn.yaml", "--set", "guess={file: results/arm_plan}")
    assert code == 3
    sentence = "'results/arm_plan' has a coordinate 'lower', which this robot lacks; allowed: upper, fore"
    assert err == f"--set guess: guess.file: {sentence}\n"


@pytest.mark.parametrize("file, words", [
    ("nowhere.csv", "cannot read 'nowhere.csv' beside this file: No such file or directory"),
    ("results", "'results' is not a result folder that can be read: no file arrays.npz"),
    ("results/hang", "'results/hang' holds no motion (no t); a plan or a simulation is wanted"),
    ("3", "3 is given; a path is wanted"),
    ("arm.yaml, times: [0, 1]", "the file gives the times; leave this key or `file` out"),
])  # fmt: skip
def test_a_guess_that_is_no_motion_is_refused(folder, socontrol, file, words):
    (folder / "hang.yaml").write_text("schema_version: 1\ntype: statics\nrobot: arm.yaml\n")
    assert socontrol("solve", "hang.yaml", "--no-figures", "-q")[0] == 0
    (folder / "turn.yaml").write_text(TURN.lstrip() + f"guess: {{file: {file}}}\n")
    code, out, err = socontrol("check", "turn.yaml")
    assert (code, out) == (3, "") and words in err and err.count("\n") == 1, err


def test_a_simulation_can_be_the_guess(folder, socontrol):
    text = "schema_version: 1\ntype: simulation\nrobot: arm.yaml\ntimes: {stop: 0.2, every: 0.05}\n"
    (folder / "swing.yaml").write_text(text)
    assert socontrol("solve", "swing.yaml", "--no-figures", "-q")[0] == 0
    (folder / "turn.yaml").write_text(TURN.lstrip() + "guess: {file: results/swing}\n")
    guess = so.load_problem("turn.yaml").guess
    arrays = so.load_result("results/swing").arrays
    np.testing.assert_allclose(guess.coordinates["upper"], arrays["q"][:, 0], rtol=1e-11)


def test_a_long_motion_is_thinned_between_its_ends_so_that_the_result_can_be_read_again(folder, socontrol):
    t = np.linspace(0, 1, 5001)
    rows = "\n".join(f"{x!r},{x**2!r},{x!r}" for x in t.tolist())
    assert guessed(folder, socontrol, f"t,upper,lower\n{rows}\n")[0] == 0
    guess = so.load_problem("turn.yaml").guess
    kept = len(guess.times)
    assert guess.times[0] == 0 and guess.times[-1] == 1 and 3 * kept <= MOST_NUMBERS < 3 * (kept + 1)
    np.testing.assert_allclose(guess.coordinates["upper"], np.array(guess.times) ** 2, rtol=1e-10)
    assert max(np.diff(guess.times)) < 2.2 / kept, "evenly"
    assert socontrol("solve", "turn.yaml", "--no-figures", "-q")[0] == 0
    assert so.load_result("results/turn").question.guess == guess


def test_positions_to_follow_come_from_a_table(folder, socontrol):
    (folder / "way.csv").write_text("t,x,y,z\n0,0.3,0,0\n0.5,0.29,0,-0.02\n1,0.25,0,0.08\n")
    follow = "costs:\n  follow: {type: tracking, on: lower, file: way.csv}\n"
    (folder / "turn.yaml").write_text(TURN.lstrip() + follow)
    cost = so.load_problem("turn.yaml").costs["follow"]
    assert cost.times == (0, 0.5, 1) and cost.positions[1] == (0.29, 0, -0.02) and cost.file is None
    for text, words in {
        "t,x,y\n0,0,0\n": "'way.csv' has no column 'z'; t, x, y and z are wanted (s, m)",
        "t,x,y,z\n0,0,0,0\n0,0,0,0\n": "way.csv:3: 0 s does not come after 0 s; times must rise",
        "t,x,y,z\n0,0,inf,0\n": "way.csv:2: inf in column 'y' is not a finite number",
    }.items():
        (folder / "way.csv").write_text(text)
        code, _, err = socontrol("check", "turn.yaml")
        assert (code, err) == (3, f"turn.yaml:8: costs.follow.file: {words}\n")
    (folder / "turn.yaml").write_text(TURN.lstrip() + follow.replace("way.csv", "way.csv, times: [0, 1]"))
    code, _, err = socontrol("check", "turn.yaml")
    assert code == 3 and "costs.follow.times: the file gives the times; leave this key or `file` out" in err


# Other commands

def test_check_says_where_a_plan_goes(folder, socontrol):
    ball = "obstacles: {ball: {type: sphere, center: [1, 1, 1], radius: 0.1}}\n"
    (folder / "turn.yaml").write_text(TURN.lstrip() + "waypoints: {via: {time: 0.5}}\n" + ball)
    _, out, err = socontrol("check", "turn.yaml")
    parts = "robot arm: 2 segments, 2 coordinates, 2 inputs; to upper and lower, past via, around ball"
    assert (out, err) == (f"turn.yaml: problem turn (trajectory): {parts}\n", "")


def test_a_stored_plan_is_written_at_any_rate(folder, socontrol):
    plan(socontrol, *REACH)
    code, out, err = socontrol("plot", "results/arm_plan", "--csv", "fine.csv", "--every", "1ms")
    assert (code, out, err) == (0, "fine.csv\n", "")
    with open("fine.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    t = np.array([float(row["t"]) for row in rows])
    np.testing.assert_allclose(t, np.arange(601) * 1e-3, atol=1e-12)
    q, qd, u = (np.array([float(row[name]) for row in rows]) for name in ("q.upper", "qd.upper", "u.m0"))
    arrays = so.load_result("results/arm_plan").arrays
    same = np.searchsorted(t, arrays["t"] - 1e-9)
    shared = np.abs(t[same] - arrays["t"]) < 1e-9
    assert shared.sum() > 100
    np.testing.assert_allclose(q[same][shared], arrays["q"][shared, 0], atol=1e-9)
    np.testing.assert_allclose(u[same][shared], arrays["u"][shared, 0], atol=1e-6)
    np.testing.assert_allclose(np.gradient(q, t)[5:-5], qd[5:-5], atol=1e-3 * np.max(np.abs(qd)))


@pytest.mark.parametrize("flags, words", [
    (["--csv", "x.csv", "--every", "0"], "--every 0: 0.0 is not positive"),
    (["--csv", "x.csv", "--every", "5 mm"], "--every 5 mm: 5 mm is a length; a time is wanted"),
    (["--csv", "x.csv", "--every", "1e-9"], "--every 1e-9: more than 200000 rows; take a longer time"),
    (["--every", "1 ms"], "--every goes with --csv FILE"),
    (["--csv", "nowhere/x.csv"], "nowhere/x.csv: cannot be written: No such file or directory"),
])  # fmt: skip
def test_a_table_that_cannot_be_written_exits_2(folder, socontrol, flags, words):
    plan(socontrol, *REACH)
    code, out, err = socontrol("plot", "results/arm_plan", *flags)
    assert (code, out) == (2, "") and words in err and err.count("\n") == 1, err
    assert not (folder / "x.csv").exists()


def test_only_plans_become_tables(folder, socontrol):
    (folder / "hang.yaml").write_text("schema_version: 1\ntype: statics\nrobot: arm.yaml\n")
    socontrol("solve", "hang.yaml", "--no-figures", "-q")
    code, _, err = socontrol("plot", "results/hang", "--csv", "x.csv")
    assert code == 2 and "a result of type statics is no plan; --csv wants one of type trajectory" in err


LONG_CALL = """
import ctypes
from socontrol.cli.console import progress
from socontrol.programs.nlp.solver import captured
with progress("x", lambda: None) as show, captured() as log:
    for k in range(1, 9):
        ctypes.PyDLL(None).usleep(120_000)  # as a solver in C++: no other Python thread has its turn
        with log.outside():
            show(0, 0, f"iteration {k}")
"""


def test_a_terminal_sees_the_iterations_while_the_solver_runs():
    main, child = pty.openpty()
    running = subprocess.Popen([sys.executable, "-c", LONG_CALL], stdout=child, stderr=child)
    os.close(child)
    text = b""
    while True:
        try:
            block = os.read(main, 4096)
        except OSError:
            break
        text += block
        if not block:
            break
    os.close(main)
    assert running.wait() == 0
    seen = {int(k) for k in re.findall(r"iteration (\d+)", text.decode())}
    assert seen == set(range(1, 9))
