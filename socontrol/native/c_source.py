"""Clean C99 text of CasADi Functions, for a source file of ours or a shared library.

CasADi's generator writes a file that stands alone: exported entries, tables about names and sparsities, helpers
that may never be called. `CSource` cuts that text into its definitions, keeps what the entries reach, and makes all
of it static, so that the text can be a part of any C or C++ file. What it keeps calls nothing but <math.h> and
allocates nothing. Compilers say nothing about it under -std=c99 -Wall -Wextra -Wpedantic with one exception:
-Wno-unused-parameter, for the entries' common signature.
"""

import re
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

REALS = ("double", "float")
IDENTIFIER = re.compile(r"[A-Za-z_]\w*")
NUMBER = re.compile(r"(?<![\w.])(?:\d+\.\d*|\.\d+|\d+(?=e))(?:e[-+]?\d+)?(?![\w.])", re.IGNORECASE)
PLAIN = re.compile(r"^  (a\d+)=\((-?\w+(?:[-+*/]\w+)?)\);$", re.MULTILINE)  # a statement of one operation
LOCAL = re.compile(r"^  (?=a\d+=)", re.MULTILINE)
MATH = re.compile(
    r"\b(a?(?:sin|cos|tan)h?|atan2|exp|expm1|log|log10|log1p|sqrt|pow|fabs|fmin|fmax|floor|ceil|fmod|hypot|erf|copysign)"
    r"(?=\s?\()"
)
SILENT = "#ifndef CASADI_PRINTF\n#define CASADI_PRINTF(...) ((void) 0)\n#endif"  # a controller has no place to print
MEMORY = re.compile(r"^int casadi_f\d+_checkout\(void\)", re.MULTILINE)  # of slots in static memory
WRITTEN = {"casadi_real", "casadi_int"}  # types: said in the head
LINKED = {"CASADI_PREFIX", "CASADI_SYMBOL_EXPORT"}  # for names that other files see: here none is seen


class NotExportable(ValueError):
    """There is no C for what a Function holds; the text says what and why."""


@dataclass(frozen=True)
class Sizes:
    """Lengths of the arrays an entry is called with: pointers `arg` and `res`, integers `iw`, reals `w`."""

    arg: int
    res: int
    iw: int
    w: int


class CSource:
    """C text of {C name: casadi Function}; each becomes

        static int NAME(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem);

    text: the C99 text; it needs no other file and defines casadi_real (`real`) and casadi_int (int).
    sizes: {C name: Sizes}. operations: {C name: `operations` of its Function}.
    bytes: {C name: length of the text it reaches, what it shares with others included}; statements: {C name: {each
    definition it reaches: its lines}}, for an estimate of the compiler's time.
    An entry keeps nothing between calls: `mem` may be any number.
    Raises NotExportable, also for Functions that do keep something (nlpsol sqpmethod); ValueError for two entries of
    one name.
    """

    def __init__(self, functions, real="double"):
        if real not in REALS:
            raise ValueError(f"real '{real}' is given; double or float is wanted")
        self.real, self.functions = real, dict(functions)
        raw, entries = _generated(self.functions)
        refuse_errors(raw)
        if MEMORY.search(raw):
            raise NotExportable("a solver of CasADi's in it keeps memory of its own between calls")
        items = items_of(raw)
        self.sizes = {name: _sizes(raw, own) for name, own in entries.items()}
        inner = {name: _inner(raw, own) for name, own in entries.items()}
        owners, given = _owners(items), {f: name for name, f in inner.items()}
        items = [replace(item, text=_tidy(item.text, given, real)) for item in items]
        kept = {name: _reached(items, owners, f) for name, f in inner.items()}
        every = [items[k] for k in sorted(set().union(*kept.values()))]
        text = "\n".join(item.comment + item.text for item in every)
        self.text = f"{_head(text, real)}\n{text}\n"
        self.bytes = {name: sum(len(items[k].text) + 1 for k in own) for name, own in kept.items()}
        self.statements = {name: {k: items[k].text.count("\n") for k in own} for name, own in kept.items()}
        self.operations = {name: operations(f) for name, f in self.functions.items()}

    @property
    def workspace(self):
        """The Sizes that are large enough for every entry."""
        sizes = self.sizes.values()
        return Sizes(*(max(getattr(s, k) for s in sizes) for k in ("arg", "res", "iw", "w")))


def operations(function):
    """Operations that one call of a Function does: those of a Function it calls count at each call; solvers have 0."""
    return _own(function) + sum(operations(other) for other in _called_by(function))


def lengths(functions):
    """[instructions of its own] of each Function that `functions` reach, themselves included: what stands in the
    code, where a Function that is called several times stands once."""
    found, waiting = {}, list(functions)
    while waiting:
        function = waiting.pop()
        if hash(function) not in found:  # two objects of one Function have one hash
            found[hash(function)] = function
            waiting += _called_by(function)
    return [_own(function) for function in found.values()]


def _own(function):
    """Instructions of a Function without those of the Functions it calls."""
    return function.n_instructions() if function.is_a("SXFunction") or function.is_a("MXFunction") else 0


def _called_by(function):
    """The Functions that a Function calls, one for each call."""
    if not function.is_a("MXFunction"):
        return []
    calls = (k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CALL)
    return [function.instruction_MX(k).which_function() for k in calls]


def _generated(functions):
    """CasADi's own text, and the name in it of each entry."""
    generator, entries, seen = ca.CodeGenerator("code", {"casadi_int": "int", "include_math": True}), {}, set()
    for name, function in functions.items():
        if not re.fullmatch(r"[A-Za-z]\w*", name) or name.startswith("casadi"):
            raise ValueError(f"'{name}' is no C name for an entry")
        if function.name() in seen:  # the generator tells Functions by their own names
            symbols = function.mx_in()
            function = ca.Function(name, symbols, function.call(symbols), function.name_in(), function.name_out())
        if function.name() in seen:
            raise ValueError(f"two Functions are named '{name}'")
        seen.add(function.name())
        entries[name] = function.name()
        generator.add(function)
    return generator.dump(), entries


def refuse_errors(text):
    """Raise NotExportable where the generator has written down that it could not."""
    _, found, rest = text.partition("#error ")
    if found:
        raise NotExportable(f"CasADi has no C for this: {rest.splitlines()[0].strip()}")


def _inner(text, name):
    """The static function that an exported entry calls."""
    start = text.rindex(f" int {name}(")
    return re.search(r"return (\w+)\(", text[start : start + 500])[1]


def _sizes(text, name):
    """Sizes as the generated code itself tells them: they can differ from those of CasADi's machine."""
    start = text.rindex(f" int {name}_work(")
    body = text[start : start + 1000]
    return Sizes(*(int(re.search(rf"\*sz_{key} = (\d+);", body)[1]) for key in ("arg", "res", "iw", "w")))


# Definitions


@dataclass(frozen=True)
class Item:
    """One definition or directive at the top level: comment, text, what it defines, the identifiers it holds."""

    comment: str
    text: str
    defines: frozenset
    holds: frozenset


def items_of(text):
    """Items of C text in which every definition begins in the first column."""
    lines, items, comment, i = text.split("\n"), [], "", 0
    while i < len(lines):
        start, line = i, lines[i]
        i += 1
        if not line.strip():
            continue
        if line.startswith("/*"):
            while "*/" not in lines[i - 1]:
                i += 1
            comment = "\n".join(lines[start:i]) + "\n"
            continue
        if line.startswith("#"):
            i = _end_of_directive(lines, start)
            items += _directive("\n".join(lines[start:i]))
        else:
            i = _end_of_definition(lines, start)
            if not line.startswith("CASADI_SYMBOL_EXPORT"):  # about an entry: versions, names, sparsities
                items.append(_definition("\n".join(lines[start:i]), comment))
        comment = ""
    return items


def _end_of_directive(lines, i):
    """Line after a directive; a condition ends with its #endif."""
    depth = 0
    while True:
        word = lines[i].strip()
        depth += word.startswith("#if") - word.startswith("#endif")
        i += 1
        if depth == 0 and not word.endswith("\\"):
            return i


def _end_of_definition(lines, i):
    """Line after a function, struct, enum, declaration or table."""
    depth = 0
    while True:
        line = lines[i]
        depth += line.count("{") - line.count("}")
        i += 1
        if depth == 0 and line.rstrip().endswith((";", "}")):
            return i


def _directive(text):
    """The Item of a macro, unless it is one about types, linkage or prefixes."""
    found = frozenset(re.findall(r"#\s*define (\w+)", text))
    if found & (WRITTEN | LINKED) or "CASADI_PREFIX(" in text:
        return []
    return [Item("", SILENT if "CASADI_PRINTF" in found else text, found, frozenset(IDENTIFIER.findall(text)))]


def _definition(text, comment):
    head = re.split(r"[{=;]", text, maxsplit=1)[0]
    if head.startswith("typedef"):
        names = IDENTIFIER.findall(text)[1:]  # an enum: its name and its constants
    elif "(" in head:
        names = IDENTIFIER.findall(head.split("(")[0])[-1:]
    else:
        names = IDENTIFIER.findall(head.split("[")[0])[-1:]
    return Item(comment, _static(text), frozenset(names), frozenset(IDENTIFIER.findall(text)))


def _owners(items):
    """{name: indices of the items that define it}."""
    owners = {}
    for k, item in enumerate(items):
        for name in item.defines:
            owners.setdefault(name, []).append(k)
    return owners


def _reached(items, owners, root):
    """Indices of the items that a name reaches."""
    kept, seen, waiting = set(), {root}, [root]
    while waiting:
        for k in owners.get(waiting.pop(), ()):
            if k not in kept:
                kept.add(k)
                new = [name for name in items[k].holds if name in owners and name not in seen]
                seen.update(new)
                waiting += new
    return kept


def _static(text):
    """A definition with internal linkage."""
    return text if re.match(r"static |struct \w+ \{|typedef ", text) else f"static {text}"


def _head(text, real):
    """Includes and types."""
    includes = "#include <math.h>\n" + "#include <stddef.h>\n" * ("size_t" in text)
    return f"{includes}\n#define casadi_real {real}\n#define casadi_int int\n"


def _tidy(text, names, real):
    """The text with the entries' own names, without needless parentheses, with short numbers of the type `real`."""
    text = re.sub(r"\bcasadi_f\d+(?=\b|_)", lambda m: names.get(m[0], m[0]), text)
    text = LOCAL.sub("", PLAIN.sub(r"  \1=\2;", text))
    if real == "double":
        return NUMBER.sub(_shortest, text)
    return MATH.sub(r"\1f", NUMBER.sub(_single, text))


def _shortest(match):
    """The shortest literal of the same double."""
    return repr(float(match[0]))


def _single(match):
    """The shortest literal of the nearest float."""
    value = np.float32(float(match[0]))
    return f"{value!s}f" if not np.isinf(value) else "HUGE_VALF"
