"""Plain data to YAML 1.2 text that `yaml_reader` reads back as the same data, in the same order."""

import json
import re

WIDTH = 110  # characters; a mapping or list that fits stands on one line
PLAIN = re.compile(r"(-?[0-9.]|[A-Za-z/])[\w ./^*+-]*")  # text that needs no quotes, unless it reads as something else
WORDS = re.compile(r"(?i:null|true|false)|[-+.]?[0-9.].*|\.(?i:nan|inf)")


def yaml_text(data):
    """YAML of mappings, lists, text, numbers, true, false and null."""
    return "".join(_block(data, 0)) or "{}\n"


def _block(data, depth):
    """Lines of a mapping or list, one an entry where it does not fit on one line."""
    indent, lines = "  " * depth, []
    for key, value in data.items() if isinstance(data, dict) else ((None, item) for item in data):
        head = f"{indent}- " if key is None else f"{indent}{_scalar(key)}: "
        line = head + flow(value)
        if isinstance(value, dict | list) and value and (len(line) > WIDTH or (_deep(value) and key is not None)):
            lines += [head.rstrip() + "\n", *_block(value, depth + 1)]
        else:
            lines.append(line + "\n")
    return lines


def _deep(value):
    """Whether a mapping holds further mappings: those stand one key a line."""
    return isinstance(value, dict) and any(isinstance(item, dict) for item in value.values())


def flow(value):
    """A value on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_scalar(key)}: {flow(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    return _scalar(value)


def _scalar(value):
    if isinstance(value, str):
        text = value.rstrip()
        if text == value and PLAIN.fullmatch(text) and (not WORDS.fullmatch(text) or _is_quantity(text)):
            return text
        return json.dumps(value, ensure_ascii=False).replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return json.dumps(value)


def _is_quantity(text):
    """`50 mm`: begins as a number and is text all the same."""
    return re.fullmatch(r"-?[0-9.]+(e-?[0-9]+)? [A-Za-z][\w ./^*-]*", text) is not None
