"""Problem files: a question, the robot and solver it refers to by relative path, and what it should answer."""

import os
from dataclasses import replace
from pathlib import Path

from socontrol.files.csv_reader import read_sheet, short
from socontrol.files.expectations import check_expectations
from socontrol.files.loader import (
    Document,
    FileError,
    UnreadableFile,
    gathered,
    keys_in,
    override,
    read_yaml,
    unknown_key,
    validate,
)
from socontrol.files.plan_files import motions_inlined
from socontrol.files.robot_file import robot_of
from socontrol.mechanics.robot import Robot
from socontrol.programs import questions
from socontrol.programs.equilibria.singular import unheld
from socontrol.programs.postures.continuation import Continuation
from socontrol.programs.postures.statics import Statics
from socontrol.programs.questions import QUESTIONS, SOLVERS, Solver
from socontrol.quantities import Bad, fields_of, joined, nearest, show

REFERENCES = ("robot", "solver")  # keys that may hold the path of a file instead of a mapping
HISTORIES = (  # paths of mappings whose values may stand in comma-separated files
    ("inputs",), ("coordinates",), ("lengths",), ("motors",), ("volumes",), ("load_factors",),
    ("motion", "coordinates"),
)  # fmt: skip


def load_problem(path, overrides=()):
    """Question of a YAML file; `overrides`: texts `a.b=VALUE`. Raises UnreadableFile or FileError."""
    return question_of(read_problem(path, overrides))


def problem(mapping, folder="."):
    """Question of a mapping with the keys of a problem file; paths in it are relative to `folder`."""
    document = tabled(inlined(Document({"name": "problem", **mapping}), Path(folder)), Path(folder))
    return question_of(motions_inlined(document, Path(folder), names_of))


def read_problem(path, overrides=()):
    """Document of a problem file with its robot and solver inline and overrides applied, but not yet checked.

    An override may reach into the robot (`robot.segments.arm.length=60 mm`) or name another file (`robot=...`).
    """
    return resolved(read_yaml(path), path, overrides)


def resolved(document, path, overrides=()):
    """The document read from `path` with a name, its robot and solver inline, and overrides applied."""
    document = named(document, Path(path).stem)
    whole = [text for text in overrides if text.partition("=")[0].strip() in REFERENCES]
    for text in whole:
        document = override(document, text)
    document = tabled(inlined(document, Path(path).parent), Path(path).parent)
    for text in overrides:
        document = override(_opened(document, text), text) if text not in whole else document
    return motions_inlined(document, Path(path).parent, names_of)


def _opened(document, text):
    """The document with what an override reaches into; FileError where it means a key of the robot."""
    head = text.split(".")[0].split("=")[0].strip()
    if head == "solver" and "solver" not in document.data:
        kind = QUESTIONS.get(str(document.data.get("type")), QUESTIONS["statics"])
        return replace(document, data={**document.data, "solver": {"type": next(iter(kind.solvers))}})
    robot = document.data.get("robot")
    if head not in document.data and isinstance(robot, dict) and head in robot:
        raise FileError(f"'{head}' is a key of the robot; write robot.{text.strip()}", file="--set")
    return document


def named(document, name):
    """The document with a name, the file's own if it has one."""
    return replace(document, data={"name": name, **document.data})


def inlined(document, folder):
    """The document with the files its robot and solver stand in, in their place."""
    for key in REFERENCES:
        given = document.data.get(key)
        if isinstance(given, str):
            document = document.grafted(key, _referred(document, key, given, folder))
    return document


def tabled(document, folder):
    """The document with the columns of comma-separated files in the place of the tables that name them."""
    for path in HISTORIES:
        given = document.data
        for key in path:
            given = given.get(key) if isinstance(given, dict) else None
        for name, entry in (given.items() if isinstance(given, dict) else ()):
            if isinstance(entry, dict) and entry.get("type") == "table" and "file" in entry:
                filled = {**entry, **columns_of(document, (*path, name), entry, folder)}
                filled = {k: v for k, v in filled.items() if k not in ("file", "column")}
                document = replace(document, data=_put(document.data, (*path, name), filled))
    return document


def _put(data, path, value):
    """The mapping with another value at a path of keys."""
    key, *rest = path
    return {**data, key: _put(data[key], rest, value) if rest else value}


def names_of(document):
    """Names of coordinates and inputs of the robot inside a document; raises FileError."""
    robot = _robot(document)
    return {"coordinates": robot.coordinates, "inputs": robot.inputs}


def columns_of(document, path, entry, folder):
    """times and values of a table's `file` and `column`; the first column of the file is the time."""
    file, column = entry["file"], entry.get("column")
    for key in ("times", "values"):
        if key in entry:
            raise document.error((*path, key), f"the file gives the {key}; leave this key out")
    sheet = read_sheet(document, (*path, "file"), file, folder)
    heads = sheet.heads[1:]
    if column is None:
        raise sheet.refuse(f"give `column` beside the file: {joined(heads) or 'it has none'}")
    if column not in heads:
        sentence = f"'{file}' has no column {show(column)}{nearest(str(column), heads)}"
        raise document.error((*path, "column" if "column" in entry else "file"), sentence)
    picked, times, values = sheet.heads.index(column, 1), [], []
    for line, cells in sheet.rows:
        try:
            times.append(float(cells[0]))
            values.append(float(cells[picked]))
        except (ValueError, IndexError):
            raise sheet.refuse(f"{file}:{line}: no number in column '{column}' or the first") from None
    return {"times": times, "values": values}


def question_of(document):
    """Question of a document without references; raises FileError."""
    data, cls = document.data, _kind(document)
    filled = {key: value for key, value in data.items() if key != "type"}
    errors = [document.error((key,), unknown_key(key, cls, data)) for key in filled if key not in fields_of(cls)]
    for key, read in (("robot", _robot), ("solver", _solver)):
        try:
            filled[key] = read(document, cls)
        except FileError as error:
            errors.append(error)
    if errors:
        raise gathered(errors)
    question = validate(cls, filled, document)
    check_expectations(document)
    if isinstance(question, Statics | Continuation) and (loose := unheld(question)):
        fix = "give them stiffness, a load that holds them, or a value under `coordinates:`"
        raise document.error(("type",), f"nothing holds {joined(loose, 'and')}, so no equilibrium is distinct; {fix}")
    return question


def solve(question, document, progress=None, compiled=False):
    """Result of a question; a mistake that shows only now is a FileError of the document it was read from."""
    try:
        return questions.solve(question, progress, compiled)
    except Bad as bad:
        raise document.error(keys_in(document.data, bad.key), str(bad)) from None


def _kind(document):
    data = document.data
    if "type" not in data and "segments" in data:
        raise document.error(("segments",), "this is a robot; a problem file asks something of one (`robot: PATH`)")
    if "type" not in data:
        raise document.error(("type",), f"missing key 'type' ({joined(QUESTIONS)})")
    kind = data["type"]
    if not isinstance(kind, str) or kind not in QUESTIONS:
        raise document.error(("type",), f"unknown problem type {show(kind)}{nearest(kind, QUESTIONS)}")
    return QUESTIONS[kind]


def _robot(document, cls=None):
    if "robot" not in document.data:
        example = "a path such as ../configs/robots/stiff_flop.yaml, or a mapping"
        raise document.error(("robot",), f"missing key 'robot' ({example})")
    given = document.data["robot"]
    if isinstance(given, Robot):
        return given
    if not isinstance(given, dict):
        raise document.error(("robot",), f"{show(given)} is given; a path or a mapping is wanted")
    return robot_of(document, ("robot",))


def _solver(document, cls):
    given = document.data.get("solver")
    if given is None:
        return cls.solver
    if not isinstance(given, (dict, *SOLVERS.values())):
        raise document.error(("solver",), f"{show(given)} is given; a path or a mapping is wanted")
    solver = solver_of(document, ("solver",)) if isinstance(given, dict) else given
    if not isinstance(solver, tuple(cls.solvers.values())):
        name = next(name for name, kind in SOLVERS.items() if isinstance(solver, kind))
        kind = next(name for name, question in QUESTIONS.items() if question is cls)
        wanted = f"'{name}' does not solve problems of type '{kind}'; {joined(cls.solvers)} does"
        raise document.error(("solver", "type") if isinstance(given, dict) else ("solver",), wanted)
    return solver


def solver_of(document, path=()):
    """Solver settings of (a part of) a document."""
    data = document.data
    for key in path:
        data = data[key]
    if "schema_version" in data and data["schema_version"] != 1:
        raise document.error((*path, "schema_version"), f"{show(data['schema_version'])} is given; 1 is wanted")
    return validate(Solver, {key: value for key, value in data.items() if key != "schema_version"}, document, path)


def load_solver(path):
    """Solver settings of a YAML file."""
    return solver_of(read_yaml(path))


def _referred(document, key, given, folder):
    """Document of the file that a key names."""
    try:
        return read_yaml(short(folder / given))
    except UnreadableFile as error:
        raise document.error((key,), f"cannot read '{given}' beside this file{_near(folder / given)}") from error


def _near(path):
    """The nearest file name in the folder of a path, or '' if that cannot be read."""
    try:
        return nearest(path.name, sorted(name for name in os.listdir(path.parent) if name.endswith(".yaml")))
    except (OSError, ValueError):
        return ""


def keeping_log(question):
    """The question with its solver's own log kept, where that has one."""
    if not hasattr(question.solver, "keep_log"):
        return question
    return replace(question, solver=replace(question.solver, keep_log=True))


__all__ = ["FileError", "load_problem", "load_solver", "problem"]
