"""Result folders: result.json, arrays.npz, problem.resolved.yaml, log.txt and figures, written whole or not at all."""

import ctypes
import dataclasses
import glob
import hashlib
import json
import math
import os
import platform
import shutil
from pathlib import Path

import numpy as np

import socontrol
from socontrol.files.problem_file import load_problem
from socontrol.files.yaml_reader import FileError, UnreadableFile, one_line
from socontrol.files.yaml_writer import yaml_text
from socontrol.programs.postures.inverse_statics import Attempt
from socontrol.programs.result import Result, Status, Value
from socontrol.report.plan_csv import table

SCHEMA_VERSION = 1
AT_CWD, EXCHANGE = -100, 2  # of Linux's renameat2


# Writing

def json_of(result, document=None, comparisons=()):
    """The mapping that result.json holds: plain data, numbers that are not finite as null."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "name": result.name,
        "type": result.type,
        "status": {"solved": result.status.solved, "outcome": result.status.outcome,
                   "message": result.status.message},
        "values": result.values,
        "residuals": result.residuals,
        "solver": result.solver,
        "expect": [{**vars(c)} for c in comparisons],
        "details": result.details,
        "versions": versions(),
        "hash": digest(document),
    }  # fmt: skip
    return plain(content)


def versions():
    """Versions of what computed a result."""
    import casadi

    return {
        "socontrol": socontrol.__version__, "casadi": casadi.__version__, "numpy": np.__version__,
        "python": platform.python_version(),
    }  # fmt: skip


def digest(document):
    """Hash of the resolved problem: the same question has the same one."""
    return "" if document is None else hashlib.sha256(yaml_text(document.data).encode()).hexdigest()


def plain(value):
    """Mappings, lists, text, numbers and None of values, records and arrays."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Attempt):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.name != "log"}
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def save(result, document, folder, comparisons=(), draw=None):
    """Write a result folder in the place of an earlier one; returns a sentence if figures could not be drawn.

    Everything is written beside `folder` first and then changes places with it, so that no half is ever seen.
    Raises UnreadableFile where that is not possible.
    """
    folder = Path(folder)
    part = folder.parent / f".{folder.name}.{os.getpid()}.part"
    refuse_foreign(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        _sweep(folder)
        part.mkdir()
        try:
            trouble = _fill(part, result, document, comparisons, draw)
            change_places(part, folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {error.strerror or error}")) from None
    return trouble


def _sweep(folder):
    """Remove what killed runs have left beside the folder, and nothing of a run that still lives."""
    for part in folder.parent.glob(f".{glob.escape(folder.name)}.*.part"):
        process = part.name.split(".")[-2]
        if process == str(os.getpid()) or not _lives(process):
            shutil.rmtree(part, ignore_errors=True)


def _lives(process):
    """Whether a process may be running, by its number."""
    if os.name != "posix" or not process.isdecimal():
        return True
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def refuse_foreign(folder):
    """Raise UnreadableFile where something stands that is not a result folder, or where nothing can be written."""
    folder = Path(folder)
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise UnreadableFile(one_line(f"{folder}: a file stands here; choose another folder with -o"))
        if folder.is_dir() and any(folder.iterdir()) and not (folder / "result.json").is_file():
            raise UnreadableFile(one_line(f"{folder}: holds other files than results; choose another folder with -o"))
        standing = next(parent for parent in folder.absolute().parents if parent.exists())
    except OSError as error:
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {error.strerror or error}")) from None
    if not standing.is_dir() or not os.access(standing, os.W_OK | os.X_OK):
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {standing} is not a writable folder"))


def _fill(folder, result, document, comparisons, draw):
    """Write all files of a result; a sentence if the figures fail."""
    text = json.dumps(json_of(result, document, comparisons), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "result.json").write_text(text + "\n", encoding="utf-8")
    np.savez(folder / "arrays.npz", **result.arrays)
    if "path.u" in result.arrays:
        (folder / "path.csv").write_text(_path_table(result), encoding="utf-8")
    if result.type in ("trajectory", "tensions") and "t" in result.arrays:
        (folder / "plan.csv").write_text(table(result), encoding="utf-8")
    (folder / "problem.resolved.yaml").write_text(yaml_text(document.data), encoding="utf-8")
    (folder / "log.txt").write_text(_log(result), encoding="utf-8")
    if draw is None:
        return None
    try:
        draw(result, folder)
    except (Exception, KeyboardInterrupt) as error:  # the answer is worth more than its pictures
        return one_line(f"the figures could not be drawn: {type(error).__name__}: {error}")
    return None


def _path_table(result):
    """Inputs, position and what is known of times and lengths at each waypoint as comma-separated text, for a
    controller."""
    robot, arrays = result.question.robot, result.arrays
    inputs = [f"{name} [{unit}]" for name, unit in zip(robot.inputs, robot.input_units, strict=True)]
    head, columns = [*inputs, "x [m]", "y [m]", "z [m]"], [arrays["path.u"], arrays["path.tip"]]
    if "path.t" in arrays:
        head, columns = ["t [s]", *head], [arrays["path.t"][: len(columns[0]), None], *columns]
    if "path.lengths" in arrays:
        head += [f"length.{name} [{unit}]" for name, unit in zip(robot.inputs, robot.length_units, strict=True)]
        columns.append(arrays["path.lengths"])
    rows = [",".join(["waypoint", *head])]
    rows += [",".join([str(k + 1), *(f"{x:.12g}" for x in row)]) for k, row in enumerate(np.hstack(columns))]
    return "\n".join(rows) + "\n"


def _log(result):
    iterations = result.solver.get("iterations", 0)
    head = f"{result.name}: {result.status.outcome}: {result.status.message}\n{iterations} iterations\n"
    return head + (f"\n{result.log}" if result.log else "")


def change_places(part, folder):
    """Put the finished folder `part` where `folder` is; the old one takes its place, to be deleted."""
    if not folder.exists():
        os.rename(part, folder)
    elif not _exchanged(part, folder):
        old = part.with_suffix(".old")
        os.rename(folder, old)
        os.rename(part, folder)
        os.rename(old, part)


def _exchanged(a, b):
    """Whether the system swapped two names in one step."""
    try:
        swap = ctypes.CDLL(None).renameat2
    except (AttributeError, OSError):
        return False
    return swap(AT_CWD, os.fsencode(a), AT_CWD, os.fsencode(b), EXCHANGE) == 0


# Reading

def load_result(folder):
    """Result of a folder that `socontrol solve` wrote, its question rebuilt. Raises UnreadableFile or FileError."""
    folder = Path(folder)
    content = _json(folder / "result.json")
    try:
        with np.load(folder / "arrays.npz", allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        log = (folder / "log.txt").read_text(encoding="utf-8")
    except (OSError, ValueError, EOFError, KeyError) as error:
        raise UnreadableFile(one_line(f"{folder}: cannot be read: {error}")) from None
    question = load_problem(folder / "problem.resolved.yaml")
    try:
        return _result(content, arrays, question, log)
    except (KeyError, TypeError, AttributeError) as error:
        message = f"not a result that this version wrote ({type(error).__name__}: {error}); solve again"
        raise FileError(message, file=str(folder / "result.json")) from None


def _json(path):
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        hint = "; the folder of a result is wanted, e.g. results/stiff_flop_reach"
        raise UnreadableFile(one_line(f"{path}: cannot be read: {error.strerror}{hint}")) from None
    except ValueError as error:
        raise FileError(f"not JSON: {error}", file=str(path)) from None
    if not isinstance(content, dict) or content.get("schema_version") != SCHEMA_VERSION:
        raise FileError(f"not a result of schema_version {SCHEMA_VERSION}; solve again", file=str(path))
    return content


def _result(content, arrays, question, log):
    details = _revived(content["details"])
    if "attempts" in details:
        details["attempts"] = [Attempt(**attempt) for attempt in details["attempts"]]
    return Result(
        name=content["name"], type=content["type"], arrays=arrays, question=question, log=log, details=details,
        status=Status(content["status"]["outcome"], content["status"]["message"]),
        values=_revived(content["values"]), residuals=_revived(content["residuals"]), solver=content["solver"],
    )  # fmt: skip


def _revived(value):
    """Mappings of a value and a unit as Value again; null as NaN inside them."""
    if isinstance(value, dict):
        if value.keys() == {"value", "unit"}:
            return Value(_numbers(value["value"]), value["unit"])
        return {key: _revived(item) for key, item in value.items()}
    return [_revived(item) for item in value] if isinstance(value, list) else value


def _numbers(value):
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    return float("nan") if value is None else value
