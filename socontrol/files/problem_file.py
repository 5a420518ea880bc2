"""Problem files: a question, the robot and solver it refers to by relative path, and what it should answer."""

import os
from dataclasses import replace
from pathlib import Path

from socontrol.files.loader import Document, FileError, UnreadableFile, override, read_yaml, validate
from socontrol.files.robot_file import load_robot, robot_of
from socontrol.mechanics.robot import Robot
from socontrol.programs.questions import QUESTIONS
from socontrol.programs.solver import Ipopt, Solver
from socontrol.quantities import joined, nearest, show

LATER = {  # problem types of the file format that this version does not answer
    "simulation": "the robot's motion in time",
    "trajectory": "planned motions",
    "tensions": "optimised tendon tensions",
}


def load_problem(path, overrides=()):
    """Question of a YAML file; `overrides`: texts `a.b=VALUE`. Raises UnreadableFile or FileError."""
    document = read_yaml(path)
    for text in overrides:
        document = override(document, text)
    return problem_of(document, Path(path).stem, Path(path).parent)


def problem(mapping, folder="."):
    """Question of a mapping with the keys of a problem file; paths in it are relative to `folder`."""
    return problem_of(Document(mapping), "problem", Path(folder))


def problem_of(document, name, folder):
    data = document.data
    cls = _kind(document)
    filled = {key: value for key, value in data.items() if key != "type"}
    filled.setdefault("name", name)
    filled["robot"] = _robot(document, folder)
    filled["solver"] = _solver(document, folder)
    return validate(cls, filled, document)


def _kind(document):
    data = document.data
    if "type" not in data:
        raise document.error(("type",), f"missing key 'type' ({joined(QUESTIONS)})")
    kind = data["type"]
    if isinstance(kind, str) and kind in LATER:
        raise document.error(
            ("type",), f"'{kind}' ({LATER[kind]}) is not built yet; this version answers {joined(QUESTIONS, 'and')}"
        )
    if not isinstance(kind, str) or kind not in QUESTIONS:
        raise document.error(("type",), f"unknown problem type {show(kind)}{nearest(kind, QUESTIONS)}")
    return QUESTIONS[kind]


def _robot(document, folder):
    if "robot" not in document.data:
        raise document.error(("robot",), "missing key 'robot' (a path such as ../configs/robots/stiff_flop.yaml)")
    given = document.data["robot"]
    if isinstance(given, Robot):
        return given
    if isinstance(given, dict):
        return robot_of(document, ("robot",))
    return _referred(document, "robot", given, folder, load_robot)


def _solver(document, folder):
    given = document.data.get("solver")
    if given is None:
        return Ipopt()
    if isinstance(given, (dict, Ipopt)):
        return validate(Solver, given, document, ("solver",))
    return _referred(document, "solver", given, folder, load_solver)


def load_solver(path):
    """Solver settings of a YAML file."""
    document = read_yaml(path)
    data = {key: value for key, value in document.data.items() if key != "schema_version"}
    return validate(Solver, data, document)


def _referred(document, key, given, folder, load):
    if not isinstance(given, str):
        raise document.error((key,), f"{show(given)} is given; a path or a mapping is wanted")
    path = folder / given
    try:
        return load(path)
    except UnreadableFile as error:
        near = nearest(path.name, sorted(os.listdir(path.parent)) if path.parent.is_dir() else [])
        raise document.error((key,), f"cannot read '{given}' beside this file{near}") from error
    except RecursionError:
        raise document.error((key,), f"'{given}' cannot be read") from None


def with_solver(question, **changes):
    """The question with some solver settings changed."""
    return replace(question, solver=replace(question.solver, **changes))


__all__ = ["FileError", "load_problem", "load_solver", "problem"]
