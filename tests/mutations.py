"""Shipped files, damaged: what a typing mistake, a wrong unit or a broken disk make of them, and what is said then.

A file is read, one thing in it is changed, and it is written one key a line, so that the line of the change is
known. Mutations known to do harm must be reported with the changed key or its parent on its line; what else may
come out (a changed name can be a fine name) must only be answered by exit 0 or 3. Everything follows from a seed.
"""

import copy
import json
import math
import random
import re
from dataclasses import dataclass
from pathlib import Path

from socontrol.cli.check import summary
from socontrol.files import problem_file
from socontrol.files.loader import read_yaml
from socontrol.files.yaml_reader import FileError, UnreadableFile, value_at
from socontrol.units import QUANTITY

ROOT = Path(__file__).parent.parent
SHIPPED = sorted([*ROOT.glob("configs/**/*.yaml"), *ROOT.glob("problems/*.yaml")])
NAMED = {  # mappings whose keys the user chooses
    "segments", "actuators", "loads", "goals", "costs", "expect", "inputs", "coordinates", "variants", "materials",
    "parameters", "rest", "options", "fluid",
}  # fmt: skip
FREE = {"name", "source", "value", "tolerance", "options"}  # keys whose values may be (nearly) anything
POSITIVE = {
    "length", "radius", "inner_radius", "radius_y", "radius_z", "width", "height", "density", "young_modulus", "area",
    "sections", "quadrature", "mass", "max_iterations", "weight", "scale", "count", "spacing",
}  # fmt: skip
NEEDED = {
    "length", "cross_section", "material", "young_modulus", "density", "along", "offset", "area", "robot", "goals",
    "on", "target", "joint", "pitch", "mass", "radius", "segments", "measurements", "variants", "tilt",
}  # fmt: skip
FIXED_LENGTH = {"position", "rotation", "com", "axis", "point", "gravity", "force", "moment", "limits", "placement"}
REFERRED = {"parent", "on", "joint", "along"}


# Writing with known lines

def written(data):
    """(text, {path: line}) of plain data, one key a line."""
    lines, where = [], {}
    _write(data, 0, (), lines, where)
    return "\n".join(lines) + "\n", where


def _write(data, depth, path, lines, where):
    """Block style for mappings and for lists that hold some; all else on the line of its key."""
    indent = "  " * depth
    items = data.pairs if isinstance(data, Twice) else data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        lines.append(f"{indent}-" if isinstance(data, list) else f"{indent}{scalar(key)}:")
        where[*path, key] = len(lines)
        if _is_block(value):
            _write(value, depth + 1, (*path, key), lines, where)
        else:
            lines[-1] += " " + flow(value)


def _is_block(value):
    if isinstance(value, Twice):
        return True
    if isinstance(value, list):
        return any(isinstance(item, Twice) or (isinstance(item, dict) and len(item) > 1) for item in value)
    return isinstance(value, dict) and bool(value)


def flow(value):
    """A value on one line."""
    if isinstance(value, list):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{scalar(key)}: {flow(item)}' for key, item in value.items())}}}"
    return scalar(value)


def scalar(value):
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][\w ./^*-]*", value) and value.lower() not in WORDS:
        return value
    return json.dumps(value)


WORDS = {"null", "true", "false"}


class Twice:
    """A mapping that holds one key twice."""

    def __init__(self, mapping, key):
        self.pairs = [*mapping.items(), (key, mapping[key])]


# Mutations: (data, path, random) -> harmful or not; None where they do not apply

@dataclass(frozen=True)
class Mutant:
    """A damaged file: its text, what was done where, and whether that is known to do harm."""

    base: Path
    kind: str
    text: str
    path: tuple
    line: int | None
    parent_line: int | None
    harmful: bool


def put(data, path, value):
    parent = value_at(data, path[:-1])
    parent[path[-1]] = value


def by_user(path):
    """Whether the key is a name the user chose."""
    return len(path) > 1 and path[-2] in NAMED and not (len(path) > 2 and path[-3] == "guess")


def inside_free(path):
    return any(part in FREE or part == "expect" for part in path)


def is_quantity(value):
    if isinstance(value, bool):
        return False
    return isinstance(value, int | float) or (isinstance(value, str) and bool(QUANTITY.fullmatch(value)))


def renamed(data, path, rng):
    """A key with a typing mistake."""
    key = path[-1]
    if not isinstance(key, str) or len(key) < 3:
        return None
    at = rng.randrange(1, len(key))
    head, letter, tail = key[:at], key[at], key[at + 1 :]
    wrong = rng.choice([head + tail, head + 2 * letter + tail, key.upper(), key + "s", "x" + key])
    parent = value_at(data, path[:-1])
    if wrong in parent or wrong == key:
        return None
    entries = [(wrong if k == key else k, v) for k, v in parent.items()]
    parent.clear()
    parent.update(entries)
    return not by_user(path) and not inside_free(path), (*path[:-1], wrong)


def deleted(data, path, rng):
    """A key or an item left out."""
    del value_at(data, path[:-1])[path[-1]]
    return path[-1] in NEEDED and not by_user(path) and not inside_free(path), path[:-1]


def retyped(data, path, rng):
    """Something of another type."""
    value = value_at(data, path)
    others = [{}, {"a": 1}, [], [[1]], "abc", True, 3.5, None, [None], ""]
    put(data, path, rng.choice(others))
    new = value_at(data, path)
    clash = is_quantity(value) and not is_quantity(new) and new is not None
    return clash and not isinstance(new, list) and not inside_free(path), path


def misunited(data, path, rng):
    """A number with a unit that cannot be meant."""
    if not is_quantity(value_at(data, path)) or path[-1] == "schema_version":
        return None
    put(data, path, rng.choice(["3 candela", "5 kelvin", "7 furlongs/fortnight^3", "2 volt", "1 mole"]))
    return not inside_free(path), path


def negative(data, path, rng):
    """A negative number."""
    value = value_at(data, path)
    if not is_quantity(value):
        return None
    put(data, path, f"-{value}" if isinstance(value, str) else -value)
    zero = isinstance(value, int | float) and value == 0
    return path[-1] in POSITIVE and not zero and not by_user(path) and not inside_free(path), path


def not_finite(data, path, rng):
    """NaN or infinity."""
    if not is_quantity(value_at(data, path)):
        return None
    put(data, path, rng.choice([float("nan"), float("inf"), -float("inf"), 1e400, "1e999 m"]))
    return not inside_free(path), path


def huge(data, path, rng):
    """A number beyond all sense; it may be read, it must not break anything."""
    if not is_quantity(value_at(data, path)):
        return None
    put(data, path, rng.choice([10**9, 1e300, 10**30, 1e-300, 0, "1e200 m", -1e200]))
    return False, path


def doubled(data, path, rng):
    """A key that stands twice."""
    if not isinstance(path[-1], str):
        return None
    twice = Twice(value_at(data, path[:-1]), path[-1])
    if len(path) == 1:
        return True, path, twice
    put(data, path[:-1], twice)
    return True, path


def swapped(data, path, rng):
    """A list backwards."""
    value = value_at(data, path)
    if not isinstance(value, list) or value == value[::-1]:
        return None
    put(data, path, value[::-1])
    pair = len(value) == 2 and all(map(is_quantity, value))
    return path[-1] == "limits" and pair and not by_user(path), path


def shortened(data, path, rng):
    """A list one shorter or longer."""
    value = value_at(data, path)
    if not isinstance(value, list) or not value:
        return None
    put(data, path, value[:-1] if rng.random() < 0.5 else [*value, value[-1]])
    return path[-1] in FIXED_LENGTH and not by_user(path) and not inside_free(path), path


def nested(data, path, rng):
    """Brackets without end."""
    value = 1
    for _ in range(rng.choice([39, 50, 200])):
        value = [value]
    put(data, path, value)
    return not inside_free(path), path


def misreferred(data, path, rng):
    """A name that nothing has."""
    value, key = value_at(data, path), path[-1] if isinstance(path[-1], str) else path[-2]
    if key not in REFERRED and key != "type" or not isinstance(value, str) or inside_free(path):
        return None
    put(data, path, value + "q")
    return True, path


STRUCTURED = [renamed, deleted, retyped, misunited, negative, not_finite, huge, doubled, swapped, shortened, nested,
              misreferred]  # fmt: skip


def scrambled(text, rng):
    """Damage to the bytes: nothing is known of what it means."""
    kind = rng.choice(["bytes", "cut", "swap", "tab", "quote", "colon", "anchor", "repeat", "indent"])
    lines, at = text.split("\n"), rng.randrange(len(text))
    row = rng.randrange(len(lines))
    if kind == "bytes":
        noise = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 6)))
        return kind, text[:at].encode() + noise + text[at:].encode()
    if kind == "cut":
        return kind, text[:at].encode()
    if kind == "repeat":
        return kind, (text[:at] * rng.choice([2, 5])).encode()
    if kind == "swap":
        other = rng.randrange(len(lines))
        lines[row], lines[other] = lines[other], lines[row]
    elif kind == "indent":
        lines[row] = " " + lines[row]
    else:
        mark = {"tab": "\t", "quote": rng.choice("'\"`"), "colon": rng.choice([": ", "#", " - ", "? ", "| "]),
                "anchor": rng.choice(["&a ", "*a ", "!!python/object ", "<<: ", "--- ", "%TAG "])}[kind]  # fmt: skip
        column = rng.randrange(len(lines[row]) + 1)
        lines[row] = lines[row][:column] + mark + lines[row][column:]
    return kind, "\n".join(lines).encode()


def paths(data, prefix=()):
    """Every path in plain data."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*prefix, key)
        if isinstance(value, dict | list):
            yield from paths(value, (*prefix, key))


def mutant(bases, seed):
    """The mutant of a seed; `bases`: {path: plain data}."""
    rng = random.Random(seed)
    while True:
        base = rng.choice(sorted(bases))
        data = copy.deepcopy(bases[base])
        if rng.random() < 0.2:
            kind, text = scrambled(written(data)[0], rng)
            return Mutant(base, kind, text, (), None, None, False)
        path, change = rng.choice(list(paths(data))), rng.choice(STRUCTURED)
        done = change(data, path, rng)
        if done is None:
            continue
        harmful, at, *whole = done
        text, where = written(whole[0] if whole else data)
        places = [where.get(at[:length]) for length in range(len(at), 0, -1)]
        known = [line for line in places if line] or [1]
        return Mutant(base, change.__name__, text.encode(), at, known[0], known[min(1, len(known) - 1)], harmful)


# Judging

@dataclass(frozen=True)
class Verdict:
    """code: 0 sound, 3 refused, 1 anything else; named: the changed key or its parent, on its line."""

    mutant: Mutant
    code: int
    lines: tuple
    named: bool


def judged(m, folder):
    """What `socontrol check` says of a mutant, written beside its base's references."""
    path = folder / "mutant.yaml"
    path.write_bytes(m.text)
    try:
        summary(path)
        return Verdict(m, 0, (), False)
    except (FileError, UnreadableFile) as error:
        lines = tuple(error.lines()) if isinstance(error, FileError) else (str(error),)
    except Exception as error:  # the very thing that must not happen
        return Verdict(m, 1, (f"{type(error).__name__}: {error}",), False)
    return Verdict(m, 3, lines, any(names(line, m) for line in lines))


def names(line, m):
    """Whether a line of an error stands at the change or its parent and speaks of one of them."""
    match = re.match(r".*?mutant\.yaml:(\d+): (.*)", line)
    if not match or int(match[1]) not in (m.line, m.parent_line):
        return False
    keys = [str(part) for part in m.path[-2:]] or ["mutant.yaml"]
    return any(key in match[2] for key in keys) or len(m.path) < 2


def bases():
    """{path: plain data} of the shipped files, with references made absolute."""
    found = {}
    for path in SHIPPED:
        data = read_yaml(path).data
        for key in ("robot", "solver"):
            if isinstance(data.get(key), str):
                data[key] = str((path.parent / data[key]).resolve())
        for given in (data.get("inputs") or {}).values():
            if isinstance(given, dict) and isinstance(given.get("file"), str):
                given["file"] = str((path.parent / given["file"]).resolve())
        found[path] = data
    return found


class Remembered:
    """Keeps the robots and documents that problem files refer to, so that only the mutant is read anew."""

    def __init__(self, patch):
        read, build, documents, robots = problem_file._referred, problem_file._robot, {}, {}

        def referred(document, key, given, folder):
            if given not in documents:
                documents[given] = read(document, key, given, folder)
            return documents[given]

        def robot(document, cls):
            graft = document.grafts.get("robot")
            if graft is None:
                return build(document, cls)
            if graft.file not in robots:
                robots[graft.file] = build(document, cls)
            return robots[graft.file]

        patch.setattr(problem_file, "_referred", referred)
        patch.setattr(problem_file, "_robot", robot)
