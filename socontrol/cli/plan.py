"""`socontrol plan`: a planned motion asked by flags, written as a problem file on request, solved as `solve` does."""

import os
from dataclasses import dataclass
from pathlib import Path

from socontrol.cli.errors import INTERRUPTED, USAGE, say
from socontrol.cli.interrupts import Interrupts
from socontrol.cli.plan_flags import BadFlag, Flagged, problem_of
from socontrol.cli.solve import guarded, print_json, solved
from socontrol.cli.writing import write_whole
from socontrol.files.problem_file import question_of
from socontrol.files.result_file import plain
from socontrol.files.robot_file import robot_of
from socontrol.files.yaml_reader import read_yaml
from socontrol.files.yaml_writer import yaml_text


@dataclass(frozen=True)
class Saving:
    """Where the problem file goes, if anywhere; `name`: of the problem; `dry`: nothing is solved."""

    file: Path | None = None
    name: str | None = None
    force: bool = False
    dry: bool = False


def plan_motion(robot, flags, saving, settings):
    """Exit code of one planned motion of the robot file at `robot`."""
    name = saving.name or (saving.file.stem if saving.file else f"{robot.stem}_plan")
    with Interrupts() as interrupts:

        def work():
            try:
                return _planned(robot, flags, name, saving, settings, interrupts)
            except BadFlag as error:
                say(error)
                return USAGE, {"problem": name, "exit": USAGE, "error": str(error)}

        code, content = guarded(saving.file or name, work, settings.verbose)
    if settings.json:
        print_json(content)
    return INTERRUPTED if interrupts.seen else code


def _refuse(name, saving):
    """Raise BadFlag for a name that is none, and for a file that would be overwritten."""
    if name in ("", ".", "..") or not name.isprintable() or set(name) & set("/\\"):
        raise BadFlag(f"--name {name}: a name of a result folder is wanted, without slashes")
    if saving.file and saving.file.exists() and not (saving.force and saving.file.is_file()):
        raise BadFlag(f"--save {saving.file}: exists and is not overwritten; --force replaces a file")
    if saving.file and not saving.file.absolute().parent.is_dir():
        raise BadFlag(f"--save {saving.file}: there is no folder {saving.file.parent}")


def _planned(path, flags, name, saving, settings, interrupts):
    """(exit code, JSON document)."""
    _refuse(name, saving)
    document = read_yaml(path)
    if "robot" in document.data and "segments" not in document.data:
        raise document.error(("robot",), "this is a problem file; `socontrol solve` answers it, `plan` wants a robot")
    data, flagged = problem_of(flags, robot_of(document))
    data = _referring(data, path, saving.file)
    whole = Flagged({"name": name, **data}, flags=flagged).grafted("robot", document)
    question = question_of(whole)
    text = yaml_text(data if saving.file and saving.file.stem == name else {"name": name, **data})
    if saving.file:
        write_whole(saving.file, f"# Run with: socontrol solve {saving.file.name}\n{text}")
        if not settings.quiet:
            say(f"{saving.file} written")
    if not saving.dry:
        return solved(saving.file or Path(name), whole, question, settings, interrupts)
    if not (saving.file or settings.json or settings.quiet):
        print(text, end="")
    return 0, {"problem": str(saving.file or name), "exit": 0, "asked": plain(whole.data)}


def _referring(data, robot, file):
    """The mapping with its robot as a path, relative to the folder of the file or to this one."""
    folder = file.absolute().parent.resolve() if file else Path.cwd()
    path = os.path.relpath(robot.absolute().parent.resolve() / robot.name, folder)
    head = {key: data[key] for key in ("schema_version", "type")}
    return {**head, "robot": Path(path).as_posix(), **{key: value for key, value in data.items() if key not in head}}
