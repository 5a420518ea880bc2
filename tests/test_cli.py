"""The command line, used as a person would: each exit code, result folders, JSON, overrides, expectations."""

import contextlib
import importlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import socontrol as so
from socontrol import cli
from socontrol.cli.kinds import distributed_rows, lumped_rows
from socontrol.files import result_file, schemas
from socontrol.files.schemas import schema_text

ROOT = Path(__file__).parent.parent
FILES = ["arrays.npz", "log.txt", "problem.resolved.yaml", "result.json"]
ARM = """
schema_version: 1
name: arm
segments:
  upper:
    type: revolute
    axis: [0, 1, 0]
    stiffness: 2
    body: {mass: 0.1, com: [0.1, 0, 0]}
    tip: {position: [0.2, 0, 0]}
  lower:
    type: revolute
    parent: upper
    axis: [0, 1, 0]
    stiffness: 1
    body: {mass: 0.1, com: [0.05, 0, 0]}
    tip: {position: [0.1, 0, 0]}
actuators:
  m0: {type: joint_torque, joint: upper, limits: [-1, 1]}
  m1: {type: joint_torque, joint: lower, limits: [-1, 1]}
"""
REACH = """
schema_version: 1
type: inverse_statics
robot: arm.yaml
goals:
  tip: {type: point, on: lower, target: [0.27, null, 0.05]}
"""
HANG = """
schema_version: 1
type: statics
robot: arm.yaml
expect:
  values.upper.position: {value: [null, 0, null], tolerance: 1e-9 mm, source: the arm is planar}
  residuals.force: {value: 0, tolerance: 1e-8, source: equilibrium}
"""
FAR = REACH.replace("[0.27, null, 0.05]", "[0.9, null, 0]") + "expect: {exit: 4}\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a robot and problems."""
    for name, text in {"arm": ARM, "reach": REACH, "hang": HANG, "far": FAR}.items():
        (tmp_path / f"{name}.yaml").write_text(text.lstrip())
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("NO_COLOR", raising=False)
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


def solve(socontrol, *arguments):
    return socontrol("solve", "--no-figures", *arguments)


# Solving

def test_a_solved_problem_prints_its_answer_and_leaves_a_folder(folder, socontrol):
    code, out, err = solve(socontrol, "reach.yaml")
    assert code == 0 and "Solved" in out and "m0" in out
    assert err == "socontrol: results/reach/ written\n"
    assert sorted(p.name for p in (folder / "results/reach").iterdir()) == FILES
    assert os.listdir(folder / "results") == ["reach"], "nothing is left beside the result"


def test_result_json_holds_what_was_found(folder, socontrol):
    solve(socontrol, "reach.yaml")
    content = json.loads((folder / "results/reach/result.json").read_text())
    assert content["schema_version"] == 1 and content["name"] == "reach" and content["type"] == "inverse_statics"
    assert content["status"]["solved"] is True and content["status"]["outcome"] == "solved"
    assert content["values"]["lower.position"]["unit"] == "m"
    np.testing.assert_allclose(np.array(content["values"]["lower.position"]["value"])[[0, 2]], [0.27, 0.05], atol=1e-9)
    assert content["residuals"]["force"]["value"] < 1e-8
    assert content["solver"]["iterations"] > 0 and content["solver"]["seconds"] > 0
    assert content["versions"].keys() == {"socontrol", "casadi", "numpy", "python"} and len(content["hash"]) == 64
    with np.load(folder / "results/reach/arrays.npz") as arrays:
        assert arrays["q"].shape == (2,) and arrays["u"].shape == (2,)
    assert "This is Ipopt version" in (folder / "results/reach/log.txt").read_text()


def test_the_resolved_problem_gives_the_same_answer(folder, socontrol):
    solve(socontrol, "reach.yaml", "--set", "robot.segments.upper.stiffness=1.9", "--set", "goals.tip.target.0=27.1 cm")
    resolved = folder / "results/reach/problem.resolved.yaml"
    assert "stiffness: 1.9" in resolved.read_text() and "27.1 cm" in resolved.read_text()
    code, out, _ = solve(socontrol, resolved, "--json", "-o", "again")
    first = json.loads((folder / "results/reach/result.json").read_text())
    second = json.loads(out)
    assert code == 0 and second["name"] == "reach"
    for key in ("values", "hash"):
        assert first[key] == second[key]


def test_a_loaded_result_is_the_one_that_was_written(folder, socontrol):
    solve(socontrol, "reach.yaml")
    result, again = so.load_problem("reach.yaml").solve(), so.load_result("results/reach")
    assert again.values == result.values and again.status == result.status and again.residuals == result.residuals
    np.testing.assert_array_equal(again.arrays["q"], result.arrays["q"])
    assert again.question.robot.coordinates == result.question.robot.coordinates
    assert [a.outcome for a in again.details["attempts"]] == [a.outcome for a in result.details["attempts"]]
    assert again.require() is again


def test_a_file_and_python_give_the_same_answer(folder, socontrol):
    solve(socontrol, "hang.yaml")
    arm = {
        "segments": {
            "upper": {"type": "revolute", "axis": [0, 1, 0], "stiffness": 2, "body": {"mass": 0.1, "com": [0.1, 0, 0]},
                      "tip": {"position": [0.2, 0, 0]}},
            "lower": {"type": "revolute", "parent": "upper", "axis": [0, 1, 0], "stiffness": 1,
                      "body": {"mass": 0.1, "com": [0.05, 0, 0]}, "tip": {"position": [0.1, 0, 0]}},
        },
    }  # fmt: skip
    result = so.solve(so.problem({"type": "statics", "robot": arm}))
    np.testing.assert_array_equal(result.arrays["q"], so.load_result("results/hang").arrays["q"])


def test_figures_are_drawn_and_drawn_again(folder, socontrol):
    assert socontrol("solve", "reach.yaml")[0] == 0
    drawn = sorted(p.name for p in (folder / "results/reach").glob("*.png"))
    code, out, _ = socontrol("plot", "results/reach", "-o", "figures")
    assert code == 0 and drawn
    assert sorted(Path(line).name for line in out.split()) == drawn == sorted(os.listdir(folder / "figures"))


def test_figures_that_fail_do_not_cost_the_answer(folder, socontrol, monkeypatch):
    from socontrol.report import plots

    monkeypatch.setattr(plots, "draw", lambda result, folder: 1 / 0)
    code, out, err = socontrol("solve", "reach.yaml")
    assert code == 0 and "Solved" in out and "figures could not be drawn: ZeroDivisionError" in err
    assert sorted(os.listdir(folder / "results/reach")) == FILES


# Exit codes

def test_usage_errors_exit_2_and_write_nothing(folder, socontrol):
    for arguments, words in [
        (["solve"], "Missing argument"),
        (["solve", "reach.yaml", "--nonsense"], "No such option"),
        (["nonsense"], "No such command 'nonsense'"),
        (["list", "wheels"], "'wheels' is not one of 'joints'"),
        (["solve", "nowhere.yaml"], "nowhere.yaml: cannot be read: No such file or directory"),
        (["solve", "."], "not an ordinary file"),
        (["solve", "reach.yaml", "./reach.yaml"], "two problems are named 'reach'"),
        (["plot", "nowhere"], "nowhere/result.json: cannot be read"),
    ]:
        code, out, err = socontrol(*arguments)
        assert code == 2 and out == "", arguments
        assert words in err and err.count("\n") == 1, err
    assert not (folder / "results").exists()


def test_bad_files_exit_3_and_write_nothing(folder, socontrol):
    (folder / "bad.yaml").write_text(REACH.lstrip().replace("on: lower", "on: lowr"))
    code, out, err = solve(socontrol, "bad.yaml")
    assert (code, out) == (3, "")
    assert err == "bad.yaml:5: goals.tip.on: unknown segment 'lowr'; did you mean 'lower'?\n"
    (folder / "arm.yaml").write_text(ARM.lstrip().replace("mass: 0.1, com: [0.1", "mass: 0.1 m, com: [0.1"))
    code, out, err = solve(socontrol, "reach.yaml")
    assert code == 3 and err.startswith("arm.yaml:8: segments.upper.body.mass: 0.1 m is a length; a mass is wanted")
    assert not (folder / "results").exists()


def test_a_robot_file_is_no_problem_and_says_so(folder, socontrol):
    code, _, err = solve(socontrol, "arm.yaml")
    sentence = "this is a robot; a problem file asks something of one (`robot: PATH`)"
    assert (code, err) == (3, f"arm.yaml:3: segments: {sentence}\n")


def test_a_joint_that_nothing_holds_is_a_bad_file(folder, socontrol):
    (folder / "arm.yaml").write_text(ARM.replace("[0, 1, 0]\n    stiffness: 2", "[0, 0, 1]").lstrip())
    (folder / "hang.yaml").write_text(HANG.replace("type: statics", "type: statics\ninputs: {m0: 0.1}").lstrip())
    code, _, err = solve(socontrol, "hang.yaml")
    assert code == 3 and "hang.yaml:2: type: nothing holds upper, so" in err
    assert solve(socontrol, "hang.yaml", "--set", "coordinates={upper: 0.1}")[0] == 0, "unless it is held"


def test_an_unreachable_goal_exits_4_with_the_nearest_posture(folder, socontrol):
    code, out, err = solve(socontrol, "far.yaml")
    assert code == 4 and "Out of reach" in out
    result = so.load_result("results/far")
    assert result.status.outcome == "infeasible" and np.all(np.isfinite(result.arrays["q"]))
    with pytest.raises(so.NotSolved, match="Out of reach"):
        result.require()


def test_a_limit_exits_5(folder, socontrol):
    code, out, _ = solve(socontrol, "reach.yaml", "--set", "solver={type: ipopt, max_iterations: 1, starts: 0}")
    assert code == 5 and "raise `max_iterations`" in out
    assert json.loads((folder / "results/reach/result.json").read_text())["status"]["outcome"] == "limit"


@pytest.fixture
def broken_solver(monkeypatch):
    """A solver that gives up at once, without numbers."""
    from socontrol.programs.nlp.solver import NLP

    monkeypatch.setattr(NLP, "solve", lambda self, **how: self._failed("the solver gave up", 0.0))


def test_a_numerical_failure_exits_6(folder, socontrol, broken_solver):
    code, _, err = solve(socontrol, "reach.yaml", "-q")
    assert code == 6 and "reach.yaml: numerical: " in err and err.count("\n") == 1
    assert np.all(np.isnan(so.load_result("results/reach").arrays["q"]))


@pytest.mark.parametrize("option, words", [
    ("nonsense: 3", "options.nonsense: Ipopt has no option of this name"),
    ("tol: -1.0", "options.tol: Ipopt does not take -1.0 for this option"),
    ("mu_init: [1, 2]", "options.mu_init: Ipopt does not take a list of 2"),
    ("linear_solver: ma57", "options.linear_solver: give `linear_solver` beside `options`"),
])  # fmt: skip
def test_options_that_ipopt_refuses_are_a_bad_file(folder, socontrol, option, words):
    (folder / "reach.yaml").write_text(REACH.lstrip() + f"solver:\n  type: ipopt\n  options:\n    {option}\n")
    for command in ("check", "solve"):
        code, out, err = socontrol(command, "reach.yaml")
        assert (code, out) == (3, "") and err.startswith(f"reach.yaml:9: solver.{words}"), err


def test_an_answer_that_fails_its_own_check_exits_7(folder, socontrol, monkeypatch):
    from socontrol.programs.looks import answer

    monkeypatch.setattr(answer.Look, "collapsed", lambda self, q: ["module.0 (stretch -0.95)"])
    code, out, _ = solve(socontrol, "reach.yaml")
    assert code == 7 and "Collapsed" in out
    assert so.load_result("results/reach").status.outcome == "rejected"


def test_an_unexpected_error_exits_1_in_one_line_and_shows_its_traceback_on_demand(folder, capfd, monkeypatch):
    command = importlib.import_module("socontrol.cli.solve")
    monkeypatch.setattr(command, "compare", lambda document, result: 1 / 0)
    assert cli.run(["solve", "reach.yaml", "--no-figures"]) == 1
    err = capfd.readouterr().err
    assert err == "socontrol: unexpected ZeroDivisionError: division by zero; run with -v for the traceback\n"
    assert cli.run(["solve", "reach.yaml", "--no-figures", "-v"]) == 1
    assert "Traceback" in capfd.readouterr().err


def test_a_missing_tool_exits_8(socontrol, monkeypatch):
    doctor = importlib.import_module("socontrol.cli.doctor")
    code, out, _ = socontrol("doctor")
    assert code == 0 and "ipopt with mumps" in out and "MISSING" not in out
    monkeypatch.setattr(doctor, "NEEDED", ("casadi", "no-such-package"))
    monkeypatch.setattr(doctor, "_tried", lambda name: "not usable (numerical)")
    code, out, err = socontrol("doctor")
    assert code == 8 and "no-such-package" in out
    assert "missing: no-such-package, ipopt with mumps;" in err, "the solver that is not needed may be missing"


def test_ctrl_c_exits_130_with_a_result_folder(folder):
    circle = "{center: [0.2, 0, 0], radius: 0.05, normal: [0, 1, 0], count: 9000}"
    path = f"{{type: path, on: lower, target: {circle}, weight: 1}}"
    (folder / "long.yaml").write_text(REACH.lstrip().split("goals:")[0] + "goals:\n  tip: " + path)
    command = [sys.executable, "-c", "from socontrol.cli import main; main()", "solve", "long.yaml", "--no-figures"]
    for wait in (4, 12, 36):  # a slow machine may still be reading the file when it is interrupted
        running = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        time.sleep(wait)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
        assert running.returncode == 130 and "Traceback" not in out + err
        if (folder / "results").exists():
            break
    content = json.loads((folder / "results/long/result.json").read_text())
    assert content["status"]["outcome"] == "interrupted"


def test_ctrl_c_that_compiled_code_swallows_is_noticed(folder, socontrol, monkeypatch):
    from socontrol.programs.postures.inverse_statics import InverseStatics

    def swallowed(self, progress=None):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        progress(1, 9, "one of many")
        raise AssertionError("the run went on")

    monkeypatch.setattr(InverseStatics, "solve", swallowed)
    before = signal.getsignal(signal.SIGINT)
    assert solve(socontrol, "reach.yaml", "far.yaml")[0] == 130
    assert os.listdir(folder / "results") == ["reach"] and signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemError("an error with Ctrl-C behind it")])
def test_ctrl_c_outside_the_solver_is_an_interruption_too(folder, socontrol, monkeypatch, error):
    from socontrol.programs.postures.inverse_statics import InverseStatics

    def stop(self, progress=None):
        raise error from KeyboardInterrupt()

    monkeypatch.setattr(InverseStatics, "solve", stop)
    code, out, _ = solve(socontrol, "reach.yaml", "far.yaml", "--json")
    assert code == 130 and len(json.loads(out)) == 1, "what is left is not begun"
    assert so.load_result("results/reach").status.outcome == "interrupted"


# Several problems, JSON

def test_of_several_problems_the_largest_code_counts(folder, socontrol):
    code, out, err = solve(socontrol, "reach.yaml", "far.yaml", "nowhere.yaml", "--json")
    documents = json.loads(out)
    assert code == 4 and [d["exit"] for d in documents] == [0, 4, 2]
    assert [d["problem"] for d in documents] == ["reach.yaml", "far.yaml", "nowhere.yaml"]
    assert documents[0]["status"]["solved"] and "error" in documents[2]
    assert sorted(os.listdir(folder / "results")) == ["far", "reach"]


def test_json_is_one_document_and_all_else_is_on_stderr(folder, socontrol):
    code, out, err = solve(socontrol, "reach.yaml", "--json", "-v", "--set", "goals.tip.target=[0.9, null, 0]")
    document = json.loads(out)
    assert code == 4 and document["status"]["outcome"] == "infeasible" and document["folder"] == "results/reach"
    assert "reach.yaml: infeasible: Out of reach" in err
    code, out, err = solve(socontrol, "nowhere.yaml", "--json")
    assert code == 2 and json.loads(out)["exit"] == 2 and err.count("\n") == 1


def test_json_has_no_nan(folder, socontrol, broken_solver):
    code, out, _ = solve(socontrol, "reach.yaml", "--json")
    json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert code == 6


def test_quiet_prints_nothing_on_success(folder, socontrol):
    assert solve(socontrol, "reach.yaml", "-q") == (0, "", "")


def test_verbose_prints_more(folder, socontrol):
    plain, more, all_ = (solve(socontrol, "reach.yaml", *flags)[1] for flags in ([], ["-v"], ["-vv"]))
    assert len(plain) < len(more) < len(all_)


# Overrides

@pytest.mark.parametrize("text, sentence", [
    ("goals.tip", "--set: 'goals.tip' is given; a.b=VALUE is wanted"),
    ("goals.top.on=lower", "--set goals.top.on: no key 'top' in goals; did you mean 'tip'?"),
    ("goals.tip.at=2 kg", "--set goals.tip.at: 2 kg is a mass; a plain number is wanted"),
    ("robot.segments.upper.stiffness=-1", "--set robot.segments.upper.stiffness: -1 is negative"),
    ("robot=leg.yaml", "--set robot: cannot read 'leg.yaml' beside this file"),
    ("goals.tip.at=[1", "--set goals.tip.at: not YAML: "),
])  # fmt: skip
def test_a_bad_override_is_named(folder, socontrol, text, sentence):
    code, _, err = solve(socontrol, "reach.yaml", "--set", text)
    assert code == 3 and err.startswith(sentence), err
    assert not (folder / "results").exists()


def test_an_override_may_name_another_robot(folder, socontrol):
    (folder / "strong.yaml").write_text(ARM.replace("name: arm", "name: strong").lstrip())
    assert solve(socontrol, "reach.yaml", "--set", "robot=strong.yaml")[0] == 0
    assert so.load_result("results/reach").question.robot.name == "strong"


# Expectations

def test_expectations_are_printed_and_verified(folder, socontrol):
    code, out, _ = solve(socontrol, "hang.yaml", "--verify")
    assert code == 0 and out.count("\nmet ") + out.startswith("met ") == 2
    code, out, err = solve(socontrol, "hang.yaml", "--verify", "--set", "expect.residuals.force.value=1")
    assert code == 7 and "MISSED residuals.force: " in out
    miss = r"^hang.yaml: expect: residuals.force: \S+ found, 1 within 1e-08 expected \(equilibrium\)$"
    assert re.search(miss, err, re.M)
    code, out, err = solve(socontrol, "hang.yaml", "--set", "expect.residuals.force.value=1")
    assert code == 0 and "MISSED" in out and "expect" not in err, "without --verify a miss is only printed"
    assert json.loads((folder / "results/hang/result.json").read_text())["expect"][1]["met"] is False


def test_an_expected_exit_counts_as_met(folder, socontrol):
    assert solve(socontrol, "far.yaml", "--verify")[0] == 0
    assert solve(socontrol, "far.yaml")[0] == 4
    code, _, err = solve(socontrol, "reach.yaml", "--verify", "--set", "expect={exit: 4}")
    assert code == 7 and "reach.yaml: expect: exit: 0 found, 4 expected" in err
    outcome = "expect={status.outcome: {value: infeasible, source: out of reach}}"
    assert solve(socontrol, "far.yaml", "--verify", "--set", outcome)[0] == 4, "the outcome is met, the goal is not"


def test_values_may_carry_units_and_are_compared_number_by_number(folder, socontrol):
    good = "{value: [270 mm, null, 5 cm], tolerance: 1 um, source: the goal}"
    bad = good.replace("5 cm", "4 cm")
    for entry, code in ((good, 0), (bad, 7)):
        expect = f"expect={{values.lower.position: {entry}}}"
        assert solve(socontrol, "reach.yaml", "--verify", "--set", expect)[0] == code


@pytest.mark.parametrize("expect, words", [
    ("{values.lowr.position: {value: 1, tolerance: 1, source: x}}", "the answer has no 'lowr.position'; did you mean"),
    ("{value.lower: {value: 1, tolerance: 1, source: x}}", "unknown key 'value.lower'"),
    ("{values.a: {value: 1, source: x}}", "missing key 'tolerance'"),
    ("{values.a: {value: 1, tolerance: -1, source: x}}", "-1 is negative"),
    ("{values.a: {value: {}, tolerance: 1, source: x}}", "a mapping is given; a number"),
    ("{exit: 9}", "9 is given; an exit code is wanted: 0, 4, 5, 6, 7 or 130"),
    ("{status.outcome: {value: fine, source: x}}", "unknown outcome 'fine'"),
    ("{values.lower.position: {value: 1, tolerance: 1, source: x}}", "1.0 is given; the answer has a list of 3"),
    ("{values.lower.position: {value: [1, 2], tolerance: 1, source: x}}", "a list of 2 is given; the answer has"),
    ("{values.lower.position: {value: [1 kg, 2, 3], tolerance: 1, source: x}}", "1 kg is a mass; a length is wanted"),
])  # fmt: skip
def test_an_expectation_that_cannot_be_compared_is_a_bad_file(folder, socontrol, expect, words):
    code, _, err = solve(socontrol, "reach.yaml", "--verify", "--set", f"expect={expect}")
    assert code == 3 and words in err, err
    assert not (folder / "results").exists()


def test_verify_needs_expectations(folder, socontrol):
    code, _, err = solve(socontrol, "reach.yaml", "--verify")
    assert code == 3 and "--verify has nothing to compare with" in err


# Folders

def test_a_result_is_replaced_whole(folder, socontrol):
    solve(socontrol, "reach.yaml")
    (folder / "results/reach/old.txt").write_text("of the run before")
    solve(socontrol, "reach.yaml")
    assert sorted(os.listdir(folder / "results/reach")) == FILES and os.listdir(folder / "results") == ["reach"]


@pytest.mark.parametrize("swap", [True, False], ids=["exchanged", "renamed"])
@pytest.mark.parametrize("step", ["json_of", "yaml_text", "_log", "change_places"])
def test_a_run_stopped_while_it_writes_leaves_the_old_result(folder, socontrol, monkeypatch, step, swap):
    assert solve(socontrol, "reach.yaml")[0] == 0
    before = (folder / "results/reach/result.json").read_text()

    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(result_file, step, stop)
    monkeypatch.setattr(result_file, "_exchanged", result_file._exchanged if swap else lambda a, b: False)
    assert solve(socontrol, "reach.yaml")[0] == 130
    assert (folder / "results/reach/result.json").read_text() == before
    assert os.listdir(folder / "results") == ["reach"]


def test_a_result_is_replaced_where_names_cannot_be_exchanged(folder, socontrol, monkeypatch):
    monkeypatch.setattr(result_file, "_exchanged", lambda a, b: False)
    for _ in range(2):
        assert solve(socontrol, "reach.yaml")[0] == 0
        assert os.listdir(folder / "results") == ["reach"]


KILLED = """
import os, signal
from socontrol import cli
from socontrol.files import result_file
def killed(*arguments):
    os.kill(os.getpid(), signal.SIGKILL)
result_file.{step} = killed
cli.run(["solve", "reach.yaml", "--no-figures", "-q"])
"""


@pytest.mark.parametrize("step", ["_log", "change_places"])
def test_a_killed_run_leaves_the_old_result_whole(folder, socontrol, step):
    solve(socontrol, "reach.yaml")
    before = (folder / "results/reach/result.json").read_text()
    done = subprocess.run([sys.executable, "-c", KILLED.format(step=step)], cwd=folder)
    assert done.returncode == -signal.SIGKILL
    assert (folder / "results/reach/result.json").read_text() == before
    assert len(os.listdir(folder / "results")) == 2, "what it had begun is left"
    assert solve(socontrol, "reach.yaml")[0] == 0
    assert os.listdir(folder / "results") == ["reach"], "until the next run clears it away"


def test_other_peoples_folders_are_left_alone(folder, socontrol):
    (folder / "results/reach").mkdir(parents=True)
    (folder / "results/reach/thesis.tex").write_text("three years of work")
    code, _, err = solve(socontrol, "reach.yaml")
    assert code == 2 and "results/reach: holds other files than results" in err
    assert (folder / "results/reach/thesis.tex").exists()
    (folder / "results/far").symlink_to(folder)
    assert solve(socontrol, "far.yaml")[0] == 2


def test_a_place_that_cannot_be_written_is_refused_before_solving(folder, socontrol, monkeypatch):
    code, out, err = solve(socontrol, "reach.yaml", "-o", "arm.yaml")
    assert code == 2 and out == "" and "arm.yaml is not a writable folder" in err
    monkeypatch.setattr(os, "access", lambda path, mode: mode == os.R_OK)
    code, out, err = solve(socontrol, "reach.yaml", "-o", "elsewhere")
    assert code == 2 and "cannot be written" in err and not (folder / "elsewhere").exists()


def test_a_disk_that_fills_up_is_said_in_one_line(folder, socontrol, monkeypatch):
    def full(*arguments, **more):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    code, _, err = solve(socontrol, "reach.yaml")
    assert code == 2 and err == "results/reach: cannot be written: No space left on device\n"
    assert os.listdir(folder / "results") == []


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_result_folder_is_refused_in_one_line(folder, socontrol, name):
    solve(socontrol, "reach.yaml")
    (folder / "results/reach" / name).write_bytes(b"\xff\x00 not this")
    code, _, err = socontrol("plot", "results/reach")
    assert code in (2, 3) and err.count("\n") == 1 and "results/reach" in err


# Look of the output

def shown_on_a_terminal(arguments, folder, **environment):
    """What a command writes when its stdout and stderr are a terminal."""
    main, child = pty.openpty()
    command = [sys.executable, "-c", "from socontrol.cli import main; main()", *arguments]
    own = {**os.environ, "TERM": "xterm-256color", **environment}
    running = subprocess.Popen(command, cwd=folder, stdout=child, stderr=child, env=own)
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
    running.wait()
    os.close(main)
    return text.decode()


def test_a_terminal_sees_colours_unless_no_color_is_set(folder):
    arguments = ["solve", "reach.yaml", "--no-figures"]
    assert "\x1b[1;32m" in shown_on_a_terminal(arguments, folder)
    plain = shown_on_a_terminal(arguments, folder, NO_COLOR="1")
    assert "Solved" in plain and not re.search(r"\x1b\[[0-9;]*m", plain)


def test_a_stream_without_every_sign_is_no_error(folder):
    command = [sys.executable, "-c", "from socontrol.cli import main; main()", "solve", "reach.yaml", "--no-figures"]
    own = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, cwd=folder, env=own, capture_output=True, text=True)
    assert done.returncode == 0 and "Solved" in done.stdout


def test_a_pipe_sees_no_escapes_and_no_progress(folder, socontrol):
    assert "\x1b" not in "".join(map(str, solve(socontrol, "reach.yaml", "-vv")))


# The other commands

def test_new_writes_files_that_solve(folder, socontrol):
    code, out, _ = socontrol("new", "fresh")
    assert code == 0 and out.split() == ["fresh/robot.yaml", "fresh/problem.yaml"]
    assert socontrol("check", "fresh/robot.yaml", "fresh/problem.yaml")[0] == 0
    assert solve(socontrol, "fresh/problem.yaml")[0] == 0
    code, out, err = socontrol("new", "fresh")
    assert (code, out) == (2, "") and "is not overwritten" in err
    (folder / "half").mkdir()
    (folder / "half/problem.yaml").write_text("mine")
    assert socontrol("new", "half")[0] == 2 and os.listdir(folder / "half") == ["problem.yaml"]


ROBOTS = sorted(ROOT.glob("configs/robots/**/*.yaml"))
SOLVERS = sorted(ROOT.glob("configs/solvers/*.yaml"))
PROBLEMS = sorted(ROOT.glob("problems/*.yaml"))


@pytest.mark.parametrize("path", [*ROBOTS, *SOLVERS, *PROBLEMS], ids=lambda p: p.stem)
def test_every_shipped_file_is_sound(socontrol, path):
    code, out, err = socontrol("check", path)
    assert code == 0 and err == "" and out.count("\n") == 1


def test_check_tells_what_a_file_is(folder, socontrol):
    (folder / "solver.yaml").write_text("type: ipopt\ntolerance: 1e-9\n")
    _, out, _ = socontrol("check", "arm.yaml", "reach.yaml", "solver.yaml")
    assert out.splitlines() == [
        "arm.yaml: robot arm: 2 segments, 2 coordinates, 2 inputs",
        "reach.yaml: problem reach (inverse_statics): robot arm: 2 segments, 2 coordinates, 2 inputs; goal tip",
        "solver.yaml: solver ipopt: tolerance 1e-09",
    ]
    code, out, err = socontrol("check", "arm.yaml", "--set", "segments.lower.parent=upr")
    assert code == 3 and out == "" and "did you mean 'upper'?" in err


def test_the_joint_table_is_the_published_one():
    """F. Renda, L. Seneviratne, ICRA 2018, table of lumped and distributed joints."""
    lumped = {r.name: (r.B, r.dof, r.system, r.order) for r in lumped_rows() if r.name != "fixed"}
    assert lumped == {
        "revolute": ("e1", 1, "so(2)", 1),
        "prismatic": ("e4", 1, "R", 1),
        "helical": ("e1 + p e4", 1, "h_p", 1),
        "cylindrical": ("[e1 e4]", 2, "so(2) x R", 2),
        "planar": ("[e3 e4 e5]", 3, "se(2)", 3),
        "spherical": ("[e1 e2 e3]", 3, "so(3)", 3),
        "free": ("I6", 6, "se(3)", 6),
    }
    distributed = {r.name: (r.B, r.xi_bar, r.dof, r.system, r.order) for r in distributed_rows()}
    assert distributed == {
        "linear_spring": ("e4", "e4", 1, "R", 1),
        "planar_constant_curvature": ("[e3 e4]", "e4", 2, "span B", 2),
        "inextensible_constant_curvature": ("[e2 e3]", "e4", 2, "span{B, xi_bar}", 3),
        "constant_curvature": ("[e2 e3 e4]", "e4", 3, "span B", 3),
        "inextensible_kirchhoff_love": ("[e1 e2 e3]", "e4", 3, "span{B, xi_bar}", 4),
        "kirchhoff_love": ("[e1 e2 e3 e4]", "e4", 4, "span B", 4),
        "simo_reissner": ("I6", "e4", 6, "se(3)", 6),
    }


def test_list_shows_every_kind_of_every_family(socontrol):
    from socontrol.cli.kinds import FAMILIES

    assert {f.value for f in cli.Family} == set(FAMILIES)
    _, overview, _ = socontrol("list")
    for family, (table, _) in FAMILIES.items():
        code, out, _ = socontrol("list", family)
        assert code == 0 and family in overview
        for name in table:
            assert re.search(rf"^{name}\s", out, re.M), f"{family}: {name}"


SCHEMAS = {"robot": "configs/robot.schema.json", "problem": "problems/problem.schema.json"}


@pytest.mark.parametrize("kind, path", SCHEMAS.items())
def test_the_schema_is_up_to_date(socontrol, kind, path):
    code, out, _ = socontrol("schema", kind)
    assert code == 0 and out == schema_text(kind)
    assert (ROOT / path).read_text() == out, f"run: socontrol schema {kind} > {path}"


def spread(node, definitions):
    """A schema with every reference written out."""
    if isinstance(node, list):
        return [spread(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        return spread(definitions[node["$ref"].removeprefix("#/$defs/")], definitions)
    return {key: spread(value, definitions) for key, value in node.items() if key not in ("$defs", "$schema")}


@pytest.mark.parametrize("kind", SCHEMAS)
def test_parts_named_once_in_a_schema_mean_what_they_meant(kind):
    whole, short = schemas.SCHEMAS[kind](), schemas.schema(kind)
    assert spread(short, short["$defs"]) == spread(whole, whole["$defs"])
    assert len(json.dumps(short)) < 0.6 * len(json.dumps(schemas.SCHEMAS[kind]()))


@pytest.mark.parametrize("path", [*ROBOTS, *PROBLEMS], ids=lambda p: p.stem)
def test_shipped_files_name_their_schema(path):
    first = path.read_text().splitlines()[0]
    match = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", first)
    kind = "problem" if path.parent.name == "problems" else "robot"
    assert match and (path.parent / match[1]).resolve().name == f"{kind}.schema.json"
    assert (path.parent / match[1]).resolve().is_file()


def test_version_and_help_load_nothing_heavy():
    code = (
        "import sys; from socontrol.cli import run; run(['--version']); run(['--help']);"
        "print([m for m in ('casadi', 'numpy', 'matplotlib', 'pydantic', 'pint', 'ruamel.yaml') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"socontrol {so.__version__}\n") and done.stdout.endswith("\n[]\n")


def test_check_needs_neither_matplotlib_nor_pint(folder):
    code = (
        "import sys; from socontrol.cli import run; run(['check', 'reach.yaml']);"
        "print([m for m in ('matplotlib', 'pint') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("\n[]\n")
