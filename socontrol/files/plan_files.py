"""Files that a question of motion names: an earlier motion (a plan's guess, or what tensions shall make), and
positions in time to follow.

What they hold takes their place in the document, so that a resolved problem needs no other file.
"""

import zipfile
from dataclasses import replace

import numpy as np

from socontrol.files.csv_reader import read_sheet, short
from socontrol.files.yaml_reader import FileError, UnreadableFile, one_line, read_yaml
from socontrol.quantities import nearest, show

MOST_NUMBERS = 4000  # of a motion: longer ones are thinned, for a file holds at most 10 000 values
MOST_POSITIONS = 1500  # to follow, for the same reason
DIGITS = 12  # of the numbers of a motion
KEYS = ("coordinates", "inputs")
OTHERS = ("qd.", "qdd.", "ud.", "length.")  # beginnings of further columns that `plan.csv` has


def motions_inlined(document, folder, names_of):
    """The document of a motion with the files of its guess, its costs or its wanted motion read.

    names_of(document): {"coordinates": names, "inputs": names} of the robot inside a document; FileError where that
    is no robot. Raises FileError.
    """
    key = {"trajectory": "guess", "tensions": "motion"}.get(str(document.data.get("type")))
    if key is None:
        return document
    entry = document.data.get(key)
    if isinstance(entry, dict) and entry.get("file") is not None:
        try:
            names = names_of(document)
        except FileError:  # of the robot, which is said when the question is read
            return document
        given = _motion(document, key, folder, names, names_of)
        document = replace(document, data={**document.data, key: given})
    if key == "motion":
        return document
    costs = document.data.get("costs")
    for name, entry in (costs.items() if isinstance(costs, dict) else ()):
        if isinstance(entry, dict) and entry.get("type") == "tracking" and entry.get("file") is not None:
            given = _tracking(document, name, entry, folder)
            document = replace(document, data={**document.data, "costs": {**document.data["costs"], name: given}})
    return document


# Motions

def _motion(document, own, folder, names, names_of):
    """Mapping of the key `own` of the document without `file`: its times, coordinates and, for a guess, inputs."""
    entry, keys = document.data[own], KEYS if own == "guess" else KEYS[:1]
    _refuse_both(document, (own,), entry, ("times", *KEYS))
    path, file = (own, "file"), entry["file"]
    if isinstance(file, str) and (folder / file).is_dir():
        times, columns = _folder_columns(document, path, file, short(folder / file), names_of)
    else:
        times, columns = _sheet_columns(read_sheet(document, path, file, folder), names)
    if len(times) < 2:
        raise document.error(path, f"'{file}' has {len(times)} row{'s' * (len(times) != 1)} of numbers; two are wanted")
    for key, name in columns:
        if key in keys and name not in names[key]:
            near = nearest(name, names[key])
            raise document.error(path, f"'{file}' has a {key[:-1]} '{name}', which this robot lacks{near}")
    columns = {(key, name): values for (key, name), values in columns.items() if key in keys}
    if not columns:
        raise document.error(path, f"'{file}' has no column of a coordinate")
    kept = _thinned(len(times), 1 + len(columns))
    given = {"times": _rounded(times, kept)}
    for key in keys:
        given[key] = {name: _rounded(values, kept) for (kind, name), values in columns.items() if kind == key}
    return {**{key: value for key, value in entry.items() if key != "file"}, **given}


def _refuse_both(document, path, entry, keys):
    for key in keys:
        if entry.get(key):
            raise document.error((*path, key), f"the file gives the {key}; leave this key or `file` out")


def _thinned(rows, columns):
    """Rows that are kept: all, or as many as fit, evenly from the first to the last."""
    most = max(2, MOST_NUMBERS // columns)
    return np.arange(rows) if rows <= most else np.unique(np.round(np.linspace(0, rows - 1, most)).astype(int))


def _rounded(values, kept):
    return [float(f"{values[k]:.{DIGITS}g}") for k in kept]


def _sheet_columns(sheet, names):
    """(times, {(key, name): numbers}) of comma-separated text."""
    times, columns = sheet.times(), {}
    for head in sheet.heads:
        if head == "t" or _is_other(head, names):
            continue
        key, name = _meaning(sheet, head, names)
        if (key, name) in columns:
            raise sheet.refuse(f"'{sheet.file}' has {key[:-1]} '{name}' in two columns")
        columns[key, name] = sheet.column(head)
    if not columns:
        raise sheet.refuse(f"'{sheet.file}' has no column of a coordinate or an input")
    return times, columns


def _is_other(head, names):
    """Whether a column is one that a plan's table has beside coordinates and inputs."""
    return head.startswith(OTHERS) and head not in (*names["coordinates"], *names["inputs"])


def _meaning(sheet, head, names):
    """(key, name) of a column by its head: `NAME`, `q.NAME` or `u.NAME`."""
    found = [(key, head) for key in KEYS if head in names[key]]
    for letter, key in (("q.", "coordinates"), ("u.", "inputs")):
        if not found and head.startswith(letter):
            return key, head[len(letter) :]  # another robot's is told from this one's by the caller
    if len(found) > 1:
        raise sheet.refuse(f"'{head}' is a coordinate and an input; name the column q.{head} or u.{head}")
    if not found:
        near = nearest(head, [name for key in KEYS for name in names[key]])
        raise sheet.refuse(f"'{sheet.file}' has a column {show(head)} that is no coordinate or input{near}")
    return found[0]


def _folder_columns(document, path, file, folder, names_of):
    """(times, {(key, name): numbers}) of a result folder, of a plan, a simulation or tensions of a motion."""
    try:
        with np.load(folder / "arrays.npz", allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in ("t", "q", "u") if name in stored.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        why = "no file arrays.npz" if isinstance(error, FileNotFoundError) else str(error)
        raise document.error(path, f"'{file}' is not a result folder that can be read: {why}") from None
    if missing := {"t", "q", "u"} - arrays.keys():
        what = " and ".join(sorted(missing))
        raise document.error(path, f"'{file}' holds no motion (no {what}); a plan or a simulation is wanted")
    try:
        names = names_of(read_yaml(folder / "problem.resolved.yaml"))
    except (FileError, UnreadableFile) as error:
        raise document.error(path, one_line(f"'{file}' does not say which robot moved: {error}")) from None
    _refuse_shapes(document, path, file, arrays, names)
    columns = {}
    for key, letter in zip(KEYS, "qu", strict=True):
        columns |= {(key, name): arrays[letter][:, i] for i, name in enumerate(names[key])}
    return arrays["t"], columns


def _refuse_shapes(document, path, file, arrays, names):
    """Raise FileError unless arrays are finite numbers at rising times, as many as names."""
    t = arrays["t"]
    shapes = {"t": t.shape, "q": (t.size, len(names["coordinates"])), "u": (t.size, len(names["inputs"]))}
    for name, shape in shapes.items():
        array = arrays[name]
        if array.ndim != len(shape) or array.shape != shape or array.dtype.kind != "f":
            raise document.error(path, f"'{file}': {name} is not an array {list(shape)} of numbers")
        if not np.all(np.isfinite(array)):
            raise document.error(path, f"'{file}': {name} holds numbers that are not finite")
    if np.any(np.diff(t) <= 0):
        raise document.error(path, f"'{file}': its times do not rise")


# Costs

def _tracking(document, name, entry, folder):
    """Mapping of a tracking cost without `file`: its times and positions."""
    path = ("costs", name)
    _refuse_both(document, path, entry, ("times", "positions"))
    sheet = read_sheet(document, (*path, "file"), entry["file"], folder)
    times = sheet.times()
    for head in "xyz":
        if head not in sheet.heads:
            raise sheet.refuse(f"'{sheet.file}' has no column '{head}'; t, x, y and z are wanted (s, m)")
    if len(times) > MOST_POSITIONS:
        raise sheet.refuse(f"'{sheet.file}' has {len(times)} rows; at most {MOST_POSITIONS}")
    positions = [list(row) for row in zip(*(sheet.column(head) for head in "xyz"), strict=True)]
    return {**{k: v for k, v in entry.items() if k != "file"}, "times": times, "positions": positions}
