"""Writes the folder of C code of a robot or of a problem, whole or not at all."""

import dataclasses
import json
import re
from dataclasses import replace
from pathlib import Path

import socontrol
from socontrol.codegen import budget, measure, texts
from socontrol.codegen.catalogue import KINDS, BadRequest, entries, wishes
from socontrol.codegen.identifiers import prefix
from socontrol.codegen.loaded import float_errors
from socontrol.codegen.manifest import MANIFEST, SCHEMA_VERSION, sealed, sha256
from socontrol.codegen.part import Folder, Names
from socontrol.codegen.place import put, refuse_foreign
from socontrol.codegen.robot_part import MARGIN, RobotPart
from socontrol.files.loader import override
from socontrol.files.problem_file import question_of, resolved
from socontrol.files.robot_file import robot_of
from socontrol.files.yaml_reader import read_yaml
from socontrol.mechanics.robot import Robot
from socontrol.native.c_source import REALS, CSource, NotExportable


@dataclasses.dataclass(frozen=True)
class Written:
    """What was written: the folder, its manifest, and {function: how large it is} of what was left out for its size."""

    path: Path
    manifest: dict
    too_large: dict


def write(subject, folder, functions=None, *, real="double", force=False, overrides=()):
    """Write the folder of C code of a Robot, a question, or the path of a file of one; returns Written.

    functions: names as in --functions (`mass`, `pose@arm:0.5`); None: all that apply to a robot and are not too
    large, none for a problem, whose solver is written. force: go beyond the budgets of size and time.
    Nothing is written where an error is raised: UnreadableFile or FileError about files and the folder, BadRequest
    about functions and real, TooLarge, NotExportable; Bad for a question whose solver has no C form.
    """
    if real not in REALS:
        raise BadRequest(f"real '{real}' is given; double or float is wanted")
    refuse_foreign(folder)
    if isinstance(subject, str | Path):
        subject = read_subject(subject, overrides)
    robot, solver = (subject, None) if isinstance(subject, Robot) else _asked(subject, real)
    names = Names(prefix(subject.name), real)
    part, missing, large = _robot_part(robot, functions, real, force, solver)
    parts = (part, solver) if solver else (part,)
    plan = Folder(names, _title(subject, robot, solver), parts)
    code = _code(plan)
    if not force:
        budget.check(code, _largest_part(parts, code).biggest_hint, lambda name: _said(part, name))
    files, manifest = _files(plan, code, {**missing, **large}, digest(subject, plan))
    put(files, Path(folder))
    return Written(Path(folder), manifest, large)


def read_subject(path, overrides=()):
    """Robot or question of a file."""
    document = read_yaml(path)
    if "segments" not in document.data:
        return question_of(resolved(document, path, overrides))
    for text in overrides:
        document = override(document, text)
    return robot_of(document)


def _asked(question, real):
    """Robot of a question, with its loads, and the part that solves it."""
    from socontrol.codegen import solver

    part = solver.part(question)
    if real == "float" and not part.floats:
        raise BadRequest("a solver needs double precision; --real float is for the functions of a robot file")
    return question.robot.with_loads(getattr(question, "loads", None)), part


def _robot_part(robot, functions, real, force, solver):
    """RobotPart of the functions asked for, {function: why it does not apply}, {function: how large} if left out."""
    if not robot.n:
        raise BadRequest("the robot has no coordinates, so there is nothing to compute")
    if functions is None and solver:
        return RobotPart(robot, (), real), {}, {}
    wanted = wishes(robot, KINDS if functions is None else functions)
    found, missing = entries(robot, wanted)
    if functions is not None:
        if missing:
            text, why = next(iter(missing.items()))
            raise BadRequest(f"'{text}' does not apply to this robot: {why}")
        return RobotPart(robot, found, real), {}, {}
    large = {} if force else budget.left_out(found)
    kept = tuple(entry for entry in found if entry not in large)
    return RobotPart(robot, kept, real), missing, {entry.wish.text: why for entry, why in large.items()}


def _code(plan):
    """The CSource of all parts."""
    functions = {name: f for part in plan.parts for name, f in part.functions.items()}
    try:
        return CSource(functions, plan.names.real)
    except NotExportable as error:
        raise NotExportable(f"{error}; name other functions with --functions") from None


def _largest_part(parts, code):
    name, _ = budget.largest(code)
    return next(part for part in parts if name in part.functions)


def _said(part, name):
    """A function as a user calls it."""
    return next((entry.wish.text for entry in part.entries if part.inner(entry) == name), name)


def _title(subject, robot, solver):
    counts = f"{len(robot.segments)} segments, {robot.n} coordinates, {robot.m} inputs"
    return f"{subject.name}: {f'solver of a problem of robot {robot.name}, ' if solver else ''}{counts}"


# Files


def _files(plan, code, left_out, key):
    """({path: text} of the folder, manifest)."""
    head, source = texts.header(plan), texts.source(plan, code)
    errors = {}
    if plan.names.real == "float":
        errors = float_errors(plan, head, source)
        allowed = {name: MARGIN * error for name, error in errors.items()}
        part = replace(plan.parts[0], allowed=allowed)
        plan = replace(plan, parts=(part, *plan.parts[1:]))
    name, stack = plan.names.prefix, measure.stack_bytes(head, source, plan.names.prefix)
    static = static_bytes(plan, code)
    files = {
        f"{name}.h": head, f"{name}.c": source, "selftest.c": texts.selftest(plan), "main.c": texts.example(plan),
        "CMakeLists.txt": texts.cmake(plan), "README": texts.readme(plan, code, static, stack), **texts.boards(),
    }  # fmt: skip
    manifest = {
        "schema_version": SCHEMA_VERSION, "generator": "socontrol", "name": plan.title.partition(":")[0],
        "prefix": name, "real": plan.names.real, "hash": key, "versions": _versions(),
        "codes": list(plan.codes), "left_out": left_out, "c_bytes": len(source.encode()), "static_bytes": static,
        "stack_bytes": stack,
        "stack_rule": f"{measure.MARGIN:g} times the frames at -O0",
        "compile_seconds": round(budget.total_seconds(code), 1),
        "float_error": errors or None,
    }  # fmt: skip
    for part in plan.parts:
        manifest.update(part.manifest(plan.names, code))
    manifest = sealed({**manifest, "files": {path: sha256(text) for path, text in files.items()}})
    return {**files, MANIFEST: texts.manifest(manifest)}, manifest


def static_bytes(plan, code):
    """Bytes of static variables that are not const."""
    iw, w = texts.workspace(plan, code)
    real = 4 if plan.names.real == "float" else 8
    return 4 * iw + real * w + sum(part.static_bytes(code) for part in plan.parts)


def _versions():
    import casadi

    return {"socontrol": socontrol.__version__, "casadi": casadi.__version__}


def digest(subject, plan):
    """Hash of the description of a robot or question, and of what was asked for."""
    asked = [plan.names.real, *(list(part.functions) for part in plan.parts)]
    text = json.dumps([_described(subject), asked], sort_keys=True)
    return sha256(text)


def _described(value):
    """Plain data of a record: its class by name, its fields; code by its name, not by where it stands in memory."""
    if isinstance(value, Robot):
        value = value.description
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _described(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, **fields}
    if isinstance(value, dict):
        return {str(key): _described(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_described(item) for item in value]
    plain = value is None or isinstance(value, bool | int | float | str)
    return value if plain else re.sub(r" at 0x\w+", "", str(value))
