"""Plain data of a file to records: fill a record, say what is wrong where, replace single values (`--set`).

Each mistake is one line, `file:line: path: what was given, what is allowed, nearest fix`.
"""

import typing
from collections.abc import Mapping
from dataclasses import replace

from socontrol.files.yaml_reader import (  # noqa: F401  readers and writers of files take these from here
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    Document,
    FileError,
    UnreadableFile,
    dotted,
    keys_in,
    parse,
    read_yaml,
    value_at,
)
from socontrol.quantities import (
    Bad,
    Either,
    OneOf,
    adapter,
    fields_of,
    is_record,
    items_of,
    joined,
    nearest,
    parts,
    show,
    special,
    wanted,
)


def validate(annotation, data, where=None, path=()):
    """An instance of a record (or what an annotation makes) from plain data.

    `where` is the Document that holds the data at `path`; without it errors carry the path alone.
    Raises FileError.
    """
    from pydantic import ValidationError

    where = where or Document(None)
    try:
        return adapter(annotation).validate_python(data)
    except ArithmeticError as error:  # of 1e300 m and the like
        raise where.error(path, f"numbers too large or too small to compute with ({error})") from None
    except ValidationError as invalid:
        found = invalid.errors(include_url=False)
    mistakes = dict(mistake(annotation, data, error) for error in found)  # one at each path
    errors = [where.error((*path, *inner), message) for inner, message in mistakes.items()]
    raise gathered(errors)


def gathered(errors):
    """The first of several FileErrors, by line, with the others in it."""
    first, *others = sorted(errors, key=lambda e: (e.line is None, e.line or 0))
    return FileError(first.message, file=first.file, line=first.line, path=first.path, others=others)


def mistake(annotation, data, error):
    """(path, sentence) of one pydantic error."""
    path, parent, own = trace(annotation, data, error["loc"])
    kind, given = error["type"], error["input"]
    if error["loc"][-1:] == ("[key]",):  # pydantic's own mark of a key it refuses
        own = typing.get_args(parts(parent)[0])[0]
    if kind == "missing":
        return path, f"missing key '{path[-1]}' ({wanted(own)})"
    if kind == "unexpected_keyword_argument":
        return path, unknown_key(path[-1], parent, value_at(data, path[:-1]))
    if kind in ("value_error", "assertion_error"):
        reason = error["ctx"]["error"]
        inner = keys_in(value_at(data, path), reason.key) if isinstance(reason, Bad) else ()
        return (*path, *inner), str(reason)
    if kind == "literal_error":
        names = typing.get_args(parts(formed(own, given))[0])
        return path, f"{show(given)} is not known here{nearest(given, names)}"
    if own is not None and not kind.startswith("too_"):
        return path, f"{show(given)} is given; {wanted(own)} is wanted"
    return path, error["msg"][:1].lower() + error["msg"][1:]


def unknown_key(key, parent, mapping):
    """Sentence about a key that the record chosen by `parent` does not have."""
    family, cls = special(formed(parent, mapping), OneOf), settled(parent, mapping)
    allowed = fields_of(cls) if is_record(cls) else {}
    holders = [name for name, other in family.table.items() if key in fields_of(other)] if family else []
    if holders:
        return f"unknown key '{key}' for {family.key} '{mapping[family.key]}'; {joined(holders)} has it"
    return f"unknown key '{key}'{nearest(key, allowed) or '; no keys are allowed'}"


def trace(annotation, data, loc):
    """(path, annotation of its parent, its own annotation) of a pydantic location.

    Parts that pydantic adds for itself, such as the branch of a union, are left out.
    """
    path, parent, own = [], None, annotation
    for part in loc:
        child = child_of(own, data, part)
        given = isinstance(part, int) or (isinstance(data, Mapping) and part in data)
        if child is None and not given:
            continue
        path.append(part)
        parent, own, data = own, child, value_at(data, (part,))
    return tuple(path), parent, own


def child_of(annotation, data, part):
    """Annotation of a key or an item, or None."""
    bare = settled(annotation, data)
    if is_record(bare):
        return fields_of(bare).get(part)
    args = typing.get_args(bare)
    if typing.get_origin(bare) is tuple and isinstance(part, int) and Ellipsis not in args:
        return args[part] if part < len(args) else None
    return items_of(bare) if typing.get_origin(bare) is dict or isinstance(part, int) else None


def settled(annotation, data):
    """The record class or bare type that this data fills, its form and kind chosen; None if none fits."""
    annotation = formed(annotation, data)
    family = special(annotation, OneOf)
    try:
        return family.choose(data) if family else parts(annotation)[0]
    except ValueError:
        return None


def formed(annotation, data):
    """The annotation whose form this data has; None if it has none."""
    while either := special(annotation, Either):
        try:
            annotation = either.choose(data)
        except ValueError:
            return None
    return annotation


def json_schema(annotation):
    """JSON Schema of a record, units in its descriptions."""
    return adapter(annotation).json_schema()


# --set

def override(document, text):
    """The document with one value replaced, `segments.arm.length=60 mm`; VALUE is YAML, its path must exist.

    Only the last key may be new. Later errors name the `--set` instead of a line.
    """
    name, equals, value = text.partition("=")
    flag = f"--set {name.strip()}"
    if not equals or not name.strip() or not value.strip():
        raise FileError(f"'{text}' is given; a.b=VALUE is wanted", file="--set")
    path = existing(document.data, name.strip().split("."), flag)
    try:
        new = parse(value).data
    except FileError as error:
        raise FileError(error.message, file=flag) from None

    def kept(lines):
        return {p: line for p, line in lines.items() if p[:len(path)] != path}

    data = replaced(document.data, path, new)
    return replace(document, data=data, keys=kept(document.keys), values=kept(document.values),
                   overrides=(*document.overrides, path))


def existing(data, names, flag):
    """Path of dotted names in the data; keys that hold dots themselves are found."""
    path = ()
    while names:
        if isinstance(data, list):
            part, names = index_of(data, names[0], path, flag), names[1:]
        elif isinstance(data, Mapping):
            part, names = key_of(data, names, path, flag)
        else:
            raise FileError(f"{dotted(path)} is {show(data)}, not a mapping or list", file=flag)
        path, data = (*path, part), value_at(data, (part,))
    return path


def index_of(items, name, path, flag):
    """Index of an item that the list has."""
    if name.isascii() and name.isdigit() and len(name) < 6 and int(name) < len(items):
        return int(name)
    raise FileError(f"'{name}' is not an item of {dotted(path)}, {show(items)} (the first is 0)", file=flag)


def key_of(mapping, names, path, flag):
    """(key, names left): the longest run of names that is a key, or a new last key."""
    for count in range(len(names), 0, -1):
        if ".".join(names[:count]) in mapping:
            return ".".join(names[:count]), names[count:]
    if len(names) == 1 and names[0].strip():
        return names[0], []
    where = dotted(path) or "the file"
    raise FileError(f"no key '{names[0]}' in {where}{nearest(names[0], mapping)}", file=flag)


def replaced(data, path, new):
    """A copy of the data along the path, with the new value at its end."""
    if not path:
        return new
    head, *rest = path
    if isinstance(data, list):
        return [replaced(item, rest, new) if i == head else item for i, item in enumerate(data)]
    return {**data, head: replaced(data.get(head), rest, new)}
