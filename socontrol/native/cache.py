"""Shared libraries kept on disk, found again by the hash of all that they were made of.

A library's file name holds its key and the hash of its own bytes, so that a damaged one is seen before it is loaded.
"""

import contextlib
import hashlib
import os
import platform
import shutil
import tempfile
import time
from functools import cache
from pathlib import Path

LARGEST = 500e6  # bytes of all libraries together; those not used for longest go first
ABANDONED = 86_400.0  # seconds after which an unfinished compilation belongs to nobody
PART = ".part-"  # what folders of unfinished compilations begin with


def key(*parts):
    """Name of what is made of these texts."""
    return hashlib.sha256("\0".join(f"{len(part)}:{part}" for part in parts).encode()).hexdigest()[:40]


def machine(native):
    """What code runs on; `native`: code made for this very processor runs on equal ones only."""
    return f"{platform.system()} {platform.machine()} {_processor() if native else ''}"


@cache
def _processor():
    """Text that differs where the instructions of processors do: Linux lists them, else the machine's own name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    told = [line for line in lines if line.split(":")[0].strip() in ("flags", "Features", "model name", "CPU part")]
    return "\n".join(dict.fromkeys(told)) or platform.node()


def folder():
    """The cache folder, made if need be; a private one of this process where that cannot be written."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        path = (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "socontrol"
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(path, os.W_OK | os.X_OK):
            return path
    except (OSError, RuntimeError):  # RuntimeError: no home folder is known
        pass
    return Path(_temporary().name)


@cache
def _temporary():
    return tempfile.TemporaryDirectory(prefix="socontrol-")


def found(name, inside):
    """Path of a sound library of this key in a folder, or None; damaged ones are removed."""
    for path in sorted(inside.glob(f"{name}-*.so")):
        with contextlib.suppress(OSError):
            if digest(path.read_bytes()) == path.stem.removeprefix(f"{name}-"):
                os.utime(path)  # used today
                return path
            path.unlink()
    return None


def digest(content):
    return hashlib.sha256(content).hexdigest()[:16]


def keep(name, inside, make):
    """Path of the library that `make(folder)` writes and returns, moved into the cache whole or not at all."""
    part = Path(tempfile.mkdtemp(prefix=PART, dir=inside))
    try:
        made = make(part)
        content = made.read_bytes()
        path = inside / f"{name}-{digest(content)}.so"
        os.replace(made, path)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    _shrink(inside, path, LARGEST - len(content))
    return path


def _shrink(inside, newest, room):
    """Remove the libraries that were not used for longest until the rest fits, and what killed processes left."""
    now, rows = time.time(), []
    for path in inside.iterdir():
        with contextlib.suppress(OSError):  # another process may be doing the same
            status = path.stat()
            if path.name.startswith(PART) and now - status.st_mtime > ABANDONED:
                shutil.rmtree(path, ignore_errors=True)
            elif path.suffix == ".so" and path != newest:
                rows.append((status.st_mtime, status.st_size, path))
    for _, size, path in sorted(rows, reverse=True):
        room -= size
        if room < 0:
            with contextlib.suppress(OSError):
                path.unlink()
