"""Puts a folder of C code where it belongs: written beside, then renamed; only a folder of our own is replaced."""

import hashlib
import json
import os
import re
import shutil
from pathlib import Path

from socontrol.codegen.manifest import MANIFEST, ODD
from socontrol.files.result_file import change_places
from socontrol.files.yaml_reader import UnreadableFile, one_line

BUILT = re.compile(r"(example|selftest)(\.exe)?|[^/]+\.o")  # files that compilers make of the folder's own


def refuse_foreign(folder):
    """Raise UnreadableFile where something stands that was not generated, or where nothing can be written."""
    folder = Path(folder)
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise UnreadableFile(one_line(f"{folder}: a file stands here; choose another folder with -o"))
        if folder.is_dir() and any(folder.iterdir()):
            _refuse_strangers(folder)
        standing = next(parent for parent in folder.absolute().parents if parent.exists())
    except OSError as error:
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {error.strerror or error}")) from None
    if not standing.is_dir() or not os.access(standing, os.W_OK | os.X_OK):
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {standing} is not a writable folder"))


def _refuse_strangers(folder):
    """Raise UnreadableFile that names a file which was not generated, or was changed since."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        known = dict(content["files"]) if content.get("generator") == "socontrol" else {}
    except ODD:
        known = {}
    if not known:
        raise _refused(folder, "holds other files than generated code; choose another folder with -o")
    built = {path for path in folder.iterdir() if _is_built(path, known)}
    for path in sorted(folder.rglob("*")):
        if path in built or not built.isdisjoint(path.parents):
            continue
        name = path.relative_to(folder).as_posix()
        ours = path.is_dir() and not path.is_symlink() and any(k.startswith(f"{name}/") for k in known)
        if name == MANIFEST or ours:
            continue
        if name not in known:
            raise _refused(folder, f"holds '{name}', which was not generated; move it or choose another folder")
        if path.is_symlink() or hashlib.sha256(path.read_bytes()).hexdigest() != known[name]:
            raise _refused(folder, f"'{name}' was changed by hand; move it or choose another folder")


def _is_built(path, known):
    """Whether a path is what the lines of the folder's README make: a program, an object file, CMake's folder."""
    if path.is_symlink():
        return False
    if path.is_dir():
        return path.name.startswith("build") and (path / "CMakeCache.txt").is_file()
    object_of = path.suffix != ".o" or path.with_suffix(".c").name in known
    return path.name not in known and bool(BUILT.fullmatch(path.name)) and object_of


def _refused(folder, why):
    return UnreadableFile(one_line(f"{folder}: {why}"))


def put(files, folder):
    """Write {path: text} as a folder, in the place of an earlier one; raises UnreadableFile where that fails."""
    part = folder.parent / f".{folder.name}.{os.getpid()}.part"
    refuse_foreign(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            for name, text in files.items():
                (part / name).parent.mkdir(parents=True, exist_ok=True)
                (part / name).write_text(text, encoding="utf-8", newline="\n")
            change_places(part, folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise UnreadableFile(one_line(f"{folder}: cannot be written: {error.strerror or error}")) from None
