"""`socontrol check`: which kind of file it is, and whether it is sound."""

from dataclasses import fields

import numpy as np

from socontrol.cli.errors import told
from socontrol.files.loader import override
from socontrol.files.problem_file import question_of, resolved, solver_of
from socontrol.files.robot_file import robot_of
from socontrol.files.yaml_reader import FileError, UnreadableFile, read_yaml
from socontrol.mechanics.robot import Description
from socontrol.programs.equilibria.closing import gaps
from socontrol.programs.plans.trajectory import Trajectory
from socontrol.programs.question import Question
from socontrol.programs.questions import QUESTIONS, SOLVERS
from socontrol.quantities import joined


def check_all(files, overrides=()):
    """Exit code of several files, one line each."""
    code = 0
    for path in files:
        try:
            print(f"{path}: {summary(path, overrides)}")
        except (FileError, UnreadableFile) as error:
            code = max(code, told(error))
    return code


def summary(path, overrides=()):
    """`robot stiff_flop: 2 segments, 16 coordinates, 3 inputs`. Raises UnreadableFile or FileError."""
    document = read_yaml(path)
    kind = kind_of(document.data)
    if kind == "problem":
        document = resolved(document, path, overrides)
        question = question_of(document)
        kind = document.data["type"]
        return f"problem {question.name} ({kind}): {_robot(question.robot)}{_asked(question)}"
    for text in overrides:
        document = override(document, text)
    if kind == "solver":
        solver = solver_of(document)
        return f"solver {document.data['type']}: tolerance {solver.tolerance:g}"
    return _robot(robot_of(document))


def kind_of(data):
    """`robot`, `problem` or `solver`: what the keys of a file say."""
    kind = data.get("type")
    if "segments" in data:
        return "robot"
    if "robot" in data or (isinstance(kind, str) and kind in QUESTIONS):
        return "problem"
    if isinstance(kind, str) and kind in SOLVERS:
        return "solver"
    records = {"robot": [Description], "problem": [Question, *QUESTIONS.values()], "solver": list(SOLVERS.values())}
    shared = {
        name: len(set(data) & {field.name for cls in classes for field in fields(cls)})
        for name, classes in records.items()
    }
    return max(shared, key=shared.get)


def _robot(robot):
    parts = [(len(robot.segments), "segment"), (robot.n, "coordinate"), (robot.m, "input")]
    parts += [(len(robot.loops), "loop")] * bool(robot.loops)
    said = ", ".join(f"{count} {noun}{'s' * (count != 1)}" for count, noun in parts)
    return f"robot {robot.name}: {said}{_open(robot)}"


def _open(robot):
    """` (closed at q = 0)`, or which loops are open there and by how much; nothing without loops."""
    if not robot.loops:
        return ""
    e = np.array(robot.functions(compiled=False).loop_error.function(np.zeros(robot.n))).ravel()
    told = "; ".join(f"{name}: {gap}" for name, gap in gaps(robot, e).items())
    return f" (open at q = 0, {told}; solvers close them first)" if told else " (closed at q = 0)"


def _asked(question):
    """`; goal tip`, of a plan `; to tip, past via, around ball`."""
    if isinstance(question, Trajectory):
        end = question.end
        ways = [("to", [*(end.coordinates or {}), *(end.goals or {})]), ("past", question.waypoints),
                ("around", question.obstacles)]  # fmt: skip
        said = ", ".join(f"{word} {joined(names, 'and')}" for word, names in ways if names)
        return f"; {said}" if said else ""
    goals = getattr(question, "goals", None)
    if not goals:
        return ""
    return f"; goal{'s' * (len(goals) != 1)} {', '.join(goals)}"
