"""Small pieces of C text: literals, tables, comments."""

import numpy as np

WIDTH = 116


def literal(x, real="double"):
    """The shortest C literal of a number."""
    if not np.isfinite(x):
        return "-INFINITY" if x < 0 else "INFINITY"
    if real == "double":
        return repr(float(x))
    text = str(np.float32(x))
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def text_literal(text):
    """A C string of text; what is not plain ASCII is escaped byte by byte."""
    escaped = (chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode())
    return f'"{"".join(escaped)}"'


def comment(*lines):
    """A C comment; nothing in its lines can end it."""
    safe = [" ".join(("x" + line).split())[1:] if line[:1] != " " else line for line in lines]
    safe = [line.encode("ascii", "replace").decode().replace("*/", "* /").replace("/*", "/ *") for line in safe]
    if len(safe) == 1:
        return f"/* {safe[0]} */\n"
    return "/* " + "\n".join([safe[0], *(f" * {line}".rstrip() for line in safe[1:])]) + " */\n"


def wrapped(items, indent="    "):
    """Items with commas between them, on lines of at most WIDTH characters."""
    lines, line = [], indent
    for k, item in enumerate(items):
        word = item + ("," if k < len(items) - 1 else "")
        if len(line) + len(word) > WIDTH and line.strip():
            lines.append(line.rstrip())
            line = indent
        line += word + " "
    return "\n".join([*lines, line.rstrip()])


def vector(head, values):
    """`head = {...};` of literals."""
    return f"{head} = {{\n{wrapped(list(values))}\n}};\n"


def matrix(head, rows, real="double"):
    """`head = {{...}, ...};` of rows of numbers."""
    body = ",\n".join("    {" + wrapped([literal(x, real) for x in row], "     ").strip() + "}" for row in rows)
    return f"{head} = {{\n{body}\n}};\n"
