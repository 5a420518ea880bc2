"""YAML 1.2 to plain data with line numbers.

Only plain data is read: mappings with text keys, lists, text, numbers, true, false, null. Tags, merge keys,
several documents and anything unbounded (size, depth, aliases that multiply) are refused. Each mistake is one
line, `file:line: path: what was given, what is allowed, nearest fix`.
"""

import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from socontrol.quantities import nearest, show

MAX_BYTES = 1_000_000  # a robot is a few kB; more is a wrong file
MAX_DEPTH = 40
MAX_NODES = 10_000  # counted after aliases are written out
MAX_KEYS = 8  # of the path to something nested too deep
MAX_SHOWN = 5  # errors printed at once

UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
}
HINTS = {  # what ruamel.yaml says: what to do about it
    "mapping values are not allowed here": "check the indentation, or quote a text that holds ': '",
    "could not find expected ':'": "a key wants ': ' after it",
    "'\\t' that cannot start": "indent with spaces, not with tabs",
    "'%' that cannot start": "put the text in quotes",
    "'@' that cannot start": "put the text in quotes",
    "found unexpected end of stream": "a quote is not closed",
}


class UnreadableFile(Exception):
    """The path cannot be opened or is no ordinary file."""


class FileError(Exception):
    """What is wrong in a file, in one line; `others` holds further mistakes of the same file."""

    def __init__(self, message, *, file=None, line=None, path="", others=()):
        self.message, self.file, self.line, self.path, self.others = message, file, line, path, tuple(others)
        super().__init__(str(self))

    def __str__(self):
        place = f"{self.file}:{self.line}" if self.file and self.line else self.file
        return one_line(": ".join(str(part) for part in (place, self.path, self.message) if part))

    def lines(self):
        """All mistakes by line, at most five of them, then how many more there are."""
        errors = [self, *self.others]
        more = len(errors) - MAX_SHOWN
        return [str(e) for e in errors[:MAX_SHOWN]] + ([f"... and {more} more"] if more > 0 else [])


def one_line(text):
    """The text with everything that is not printable escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def dotted(path):
    """`segments.arm.offset.1`."""
    return ".".join(map(str, path))


@dataclass(frozen=True)
class Document:
    """Plain data and where it stands: lines of keys and values by path, paths that `--set` replaced.

    grafts: {key: Document} of files that stand in the place of a path to them.
    """

    data: Any
    file: str | None = None
    keys: Mapping = field(default_factory=dict)
    values: Mapping = field(default_factory=dict)
    overrides: tuple = ()
    grafts: Mapping = field(default_factory=dict)

    def grafted(self, key, document):
        """This document with another one's data at a top-level key; errors in there name the other file."""
        return replace(self, data={**self.data, key: document.data}, grafts={**self.grafts, key: document})

    def line(self, path):
        """Line of a path: a scalar's own, a mapping's or list's key; a missing key has its parent's."""
        while path and path not in self.values:
            path = path[:-1]
        own = self.values.get(path)
        return self.keys.get(path, own) if isinstance(value_at(self.data, path), Mapping | list) else own

    def error(self, path, message):
        """A FileError at a path (tuple of keys and indices)."""
        path = tuple(path)
        for replaced in reversed(self.overrides):
            if path[:len(replaced)] == replaced:
                inner = dotted(path) if path != replaced else ""
                return FileError(message, file=f"--set {dotted(replaced)}", path=inner)
        if len(path) > 1 and path[0] in self.grafts:
            return self.grafts[path[0]].error(path[1:], message)
        return FileError(message, file=self.file, line=self.line(path), path=dotted(path))


def keys_in(data, text):
    """Path of dotted text: `loads.tip.force`; keys that hold dots themselves are found, unknown ones kept."""
    names, path = text.split("."), ()
    while names:
        runs = [".".join(names[:count]) for count in range(len(names), 0, -1)]
        known = isinstance(data, Mapping)
        part = next((run for run in runs if known and run in data), names[0])
        names = names[part.count(".") + 1 :]
        part = int(part) if isinstance(data, list | tuple) and part.isdecimal() else part
        path, data = (*path, part), value_at(data, (part,))
    return path


def value_at(data, path):
    """The value at a path, or None."""
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


# Reading

@dataclass
class Node:
    """One YAML value: a scalar, a list of nodes, or a dict of key to (line of the key, node)."""

    value: Any
    line: int


class Builder:
    """Builds nodes from YAML events; remembers anchors and counts nodes."""

    def __init__(self, text):
        from ruamel.yaml import YAML

        self.events = YAML(typ="safe", pure=True).parse(text)
        self.anchors, self.open, self.count, self.keys = {}, set(), 0, []

    def document(self):
        """The node of the only document, or None if there is none."""
        self.next()
        start = self.next()
        if is_event(start, "StreamEnd"):
            return None
        if start.version not in (None, (1, 2)):
            asked = ".".join(map(str, start.version))
            raise self.wrong(start, f"YAML {asked} is asked for; YAML 1.2 is read")
        node = self.node(self.next(), 1)
        self.next()
        if not is_event(again := self.next(), "StreamEnd"):
            raise self.wrong(again, "a second document starts here; one file holds one document")
        return node

    def next(self):
        """The next event."""
        try:
            return next(self.events)
        except Exception as error:  # ruamel.yaml lets ValueError and more through on odd bytes
            raise syntax_error(error) from None

    @staticmethod
    def wrong(event, message):
        """A FileError at an event's line."""
        return FileError(message, line=event.start_mark.line + 1)

    def node(self, event, depth):
        """The node that starts with this event."""
        self.count += 1
        if self.count > MAX_NODES:
            raise self.wrong(event, f"more than {MAX_NODES} values; is this the right file?")
        if depth > MAX_DEPTH:
            error = self.wrong(event, f"nested more than {MAX_DEPTH} deep")
            raise FileError(error.message, line=error.line, path=dotted(self.keys[:MAX_KEYS]))
        if is_event(event, "Alias"):
            return self.alias(event)
        if event.tag is not None:
            raise self.wrong(event, f"tag {event.tag} is not read; write plain values")
        if event.anchor is None:
            return self.content(event, depth)
        self.open.add(event.anchor)
        node = self.anchors[event.anchor] = self.content(event, depth)
        self.open.discard(event.anchor)
        return node

    def alias(self, event):
        """The node an alias stands for."""
        if event.anchor in self.open:
            raise self.wrong(event, f"*{event.anchor} stands inside &{event.anchor}; it would never end")
        if event.anchor not in self.anchors:
            raise self.wrong(event, f"unknown alias *{event.anchor}{nearest(event.anchor, self.anchors)}")
        return self.anchors[event.anchor]

    def content(self, event, depth):
        """A scalar, a list or a mapping."""
        line = event.start_mark.line + 1
        if is_event(event, "SequenceStart"):
            items = []
            while not is_event(item := self.next(), "SequenceEnd"):
                items.append(self.node(item, depth + 1))
            return Node(items, line)
        if is_event(event, "MappingStart"):
            return Node(self.mapping(depth), line)
        return Node(self.scalar(event), line)

    def mapping(self, depth):
        """Key to (line of the key, node)."""
        entries = {}
        while not is_event(event := self.next(), "MappingEnd"):
            key, line = self.key(event), event.start_mark.line + 1
            if key in entries:
                raise self.wrong(event, f"key '{key}' stands twice: here and on line {entries[key][0]}")
            self.keys.append(key)
            entries[key] = (line, self.node(self.next(), depth + 1))
            self.keys.pop()
        return entries

    def key(self, event):
        """The text of a key."""
        if not is_event(event, "Scalar") or event.tag is not None or event.anchor is not None:
            raise self.wrong(event, "a key is plain text")
        key = self.scalar(event)
        if event.value == "<<" and event.style is None:
            raise self.wrong(event, "merge key '<<' is not read; write the keys out")
        if not isinstance(key, str):
            raise self.wrong(event, f"key {show(key)} is not text; write it in quotes")
        if not key.strip() or not key.isprintable():
            raise self.wrong(event, f"key {show(key)} is not a name")
        return key

    def scalar(self, event):
        """Python value of a scalar by the core schema of YAML 1.2."""
        text = event.value
        if UNPRINTABLE.search(text):
            raise self.wrong(event, f"control character in {show(text)}")
        if event.style is not None:
            return text
        if text in WORDS:
            return WORDS[text]
        if INTEGER.fullmatch(text):
            return self.integer(event)
        return float(text) if FLOAT.fullmatch(text) else text

    def integer(self, event):
        """An int of a sane length: Python refuses thousands of digits."""
        text = event.value
        if len(text) > 40:
            raise self.wrong(event, f"{text[:20]}... has {len(text)} digits")
        return int(text, 0 if text[:2] in ("0o", "0x") else 10)


def is_event(event, kind):
    """Whether an event is of a kind, `Scalar`, `MappingEnd` ..."""
    return type(event).__name__ == kind + "Event"


def syntax_error(error):
    """FileError of what ruamel.yaml raises."""
    problem = str(getattr(error, "problem", None) or error).split("\n", 1)[0]
    context = getattr(error, "context", None)
    hint = next((f"; {fix}" for words, fix in HINTS.items() if words in problem), "")
    begun = "end of stream" in problem or "could not find" in problem  # the line where it began says more
    mark = (getattr(error, "context_mark", None) if begun else None) or getattr(error, "problem_mark", None)
    line = mark.line + 1 if mark else None
    return FileError(f"not YAML: {f'{context}, ' if context else ''}{problem}{hint}", line=line)


def expanded(node, document, path=()):
    """Plain data of a node with aliases written out; enters the lines of values and keys into `document`."""
    if len(document.values) >= MAX_NODES:
        raise FileError(f"more than {MAX_NODES} values when aliases are written out", line=node.line)
    if len(path) >= MAX_DEPTH:
        raise FileError(f"nested more than {MAX_DEPTH} deep when aliases are written out", line=node.line)
    document.values[path] = node.line
    if isinstance(node.value, list):
        return [expanded(item, document, (*path, i)) for i, item in enumerate(node.value)]
    if isinstance(node.value, dict):
        document.keys.update({(*path, key): line for key, (line, _) in node.value.items()})
        return {key: expanded(item, document, (*path, key)) for key, (_, item) in node.value.items()}
    return node.value


def parse(text, file=None):
    """Document of a YAML text; its data may be any value, None for an empty text."""
    lines = Document(None, file)
    try:
        bad = UNPRINTABLE.search(text)
        if bad:
            line = text.count("\n", 0, bad.start()) + 1
            raise FileError(f"control character U+{ord(bad[0]):04X}", line=line)
        node = Builder(text).document()
        return replace(lines, data=expanded(node, lines) if node else None)
    except FileError as error:
        raise FileError(error.message, file=file, line=error.line, path=error.path) from None


def read_yaml(path):
    """Document of a YAML file whose top level is a mapping; UnreadableFile or FileError if it is not that."""
    file = str(path)
    document = parse(text_of(read_bytes(path), file), file)
    if isinstance(document.data, dict):
        return document
    given = "the file is empty" if document.data is None else f"{show(document.data)} is given"
    raise FileError(f"{given}; a mapping of keys to values is wanted", file=file, line=1)


def read_bytes(path):
    """The bytes of an ordinary file, not more than are allowed."""
    try:
        if not stat.S_ISREG(Path(path).stat().st_mode):
            raise UnreadableFile(one_line(f"{path}: not an ordinary file; the path of a YAML file is wanted"))
        with Path(path).open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreadableFile(one_line(f"{path}: cannot be read: {reason}")) from None
    if len(data) > MAX_BYTES:
        raise FileError("more than 1 MB; is this the right file?", file=str(path), line=1)
    return data


def text_of(data, file):
    """UTF-8 text of bytes, without a byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"byte 0x{data[error.start]:02X} is not UTF-8; save the file as UTF-8"
        raise FileError(message, file=file, line=line) from None
