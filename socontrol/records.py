"""Records that a file can fill, the families they form, and the sentences about what does not fit.

A record is a frozen dataclass whose fields are annotated; `OneOf` chooses one of a family by its `type`,
`Either` one of several forms by the shape of what is given. Only the standard library is imported here:
pydantic is loaded by the first file that is read. Records built from Python are not checked, so that a field
can hold a symbolic value.
"""

import dataclasses
import difflib
import functools
import numbers
import typing
from collections.abc import Mapping
from typing import Annotated, Literal


class Bad(ValueError):
    """A check over several fields failed; `raise Bad("radius", "radius 0.004 is ...")` points at a key."""

    def __init__(self, key, sentence):
        super().__init__(sentence)
        self.key = key


def file_key(name):
    """The key of a field in a file: its name, without the underscore that Python needs in `from_`."""
    return name.rstrip("_")


@typing.dataclass_transform(frozen_default=True)
def record(cls=None, /, **options):
    """`dataclass(frozen=True)` that a file can fill: keys the class does not have are refused."""
    if cls is None:
        return functools.partial(record, **options)
    cls.__pydantic_config__ = {
        "extra": "forbid",
        "arbitrary_types_allowed": True,
        "alias_generator": file_key,
    }
    return dataclasses.dataclass(frozen=True, **options)(cls)


def is_record(annotation):
    """Whether this is a class made by `record`."""
    return isinstance(annotation, type) and "__pydantic_config__" in vars(annotation)


@functools.cache
def fields_of(cls):
    """File keys of a record, each with its annotation."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return {file_key(f.name): hints[f.name] for f in dataclasses.fields(cls) if f.init}


@functools.cache
def adapter(annotation):
    """The pydantic TypeAdapter of a record or annotation, built once."""
    from pydantic import TypeAdapter

    return TypeAdapter(annotation)


# Sentences

def show(value):
    """A short name for what was given: `'abc'`, `true`, `a list of 3`, `a mapping`."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a whole number of more than 40 digits"
    text = repr(value) if isinstance(value, str | numbers.Number) else type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."


def other_wanted(value, what):
    """The ValueError for something of the wrong kind."""
    return ValueError(f"{show(value)} is given; {what} {'are' if what[0].isdigit() else 'is'} wanted")


def joined(names, word="or"):
    """`a, b or c`."""
    *head, last = [str(name) for name in names] or ["nothing"]
    return f"{', '.join(head)} {word} {last}" if head else last


def nearest(name, allowed):
    """`; did you mean 'length'?` or, when nothing is near, the list of what is allowed."""
    allowed = [str(a) for a in allowed]
    close = difflib.get_close_matches(str(name), allowed, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; allowed: {', '.join(allowed)}" if allowed else ""


def is_symbolic(value):
    """A casadi value, which Python code may place where a file has a number."""
    return type(value).__module__.partition(".")[0] == "casadi"


# Families and forms

@dataclasses.dataclass(frozen=True)
class Text:
    """Metadata of a text: what is `wanted`, in words."""

    wanted: str


@dataclasses.dataclass(frozen=True, eq=False)
class OneOf:
    """A mapping whose `type` names a record of `table`; its other keys fill that record."""

    table: Mapping
    what: str = "kind"
    key: str = "type"
    also: tuple = ()  # classes that only Python can give

    @property
    def wanted(self):
        article = "an" if self.what[0] in "aeiou" else "a"
        return f"{article} {self.what}: a mapping with '{self.key}' {joined(self.table)}"

    def choose(self, value):
        """The record class that `type` names; ValueError if there is none."""
        if not isinstance(value, Mapping):
            raise other_wanted(value, self.wanted)
        if self.key not in value:
            raise Bad(self.key, f"missing key '{self.key}' ({self.what}: {joined(self.table)})")
        name = value[self.key]
        if not isinstance(name, str):
            raise Bad(self.key, f"{show(name)} is given; text is wanted: {joined(self.table)}")
        if name not in self.table:
            raise Bad(self.key, f"unknown {self.what} {show(name)}{nearest(name, self.table)}")
        return self.table[name]

    def read(self, value):
        """An instance of the record that `type` names; an instance of the family as it is."""
        if isinstance(value, (*self.table.values(), *self.also)):
            return value
        cls = self.choose(value)
        return adapter(cls).validate_python({k: v for k, v in value.items() if k != self.key})

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        for cls in self.table.values():
            if not is_record(cls):
                raise TypeError(f"{cls!r} in the table of {self.what} is not a record")
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema, handler):
        return {"oneOf": [self.json_of(name, cls, handler) for name, cls in self.table.items()]}

    def json_of(self, name, cls, handler):
        """JSON Schema of one record with its type key."""
        own = handler.resolve_ref_schema(handler(adapter(cls).core_schema))
        keys = {self.key: {"const": name, "type": "string"}, **own.get("properties", {})}
        return {**own, "properties": keys, "required": [self.key, *own.get("required", [])]}


class Either:
    """One of several forms, chosen by the shape of what is given: text, number, list, list of lists, mapping.

    Of several mapping forms the one that shares most keys is taken, so that errors speak of one form only.
    """

    def __init__(self, *forms):
        self.forms = forms

    @property
    def wanted(self):
        return joined(wanted(form) for form in self.forms)

    def choose(self, value):
        """The form whose shape fits; ValueError if none does."""
        fitting = [form for form in self.forms if shape_of(value) in shapes(form)]
        if not fitting:
            lists = isinstance(value, list | tuple)
            fitting = [form for form in self.forms if lists and shapes(form) & {1, 2, 3}]
        if not fitting:
            raise other_wanted(value, self.wanted)
        return max(fitting, key=lambda form: affinity(form, value))

    def read(self, value):
        """The value as the chosen form reads it; casadi values and built records as they are."""
        if is_symbolic(value) or any(isinstance(value, classes(form)) for form in self.forms):
            return value
        if type(value).__module__ == "numpy":
            value = value.tolist()
        return adapter(self.choose(value)).validate_python(value)

    def __get_pydantic_core_schema__(self, source, handler):
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema, handler):
        from pydantic_core import core_schema

        return handler(core_schema.union_schema([adapter(form).core_schema for form in self.forms]))


# Looking at annotations

def parts(annotation):
    """(bare type, metadata) of an annotation; `X | None` counts as X."""
    if typing.get_origin(annotation) is Annotated:
        bare, *metadata = typing.get_args(annotation)
        inner, more = parts(bare)
        return inner, (*more, *metadata)
    args = [a for a in typing.get_args(annotation) if a is not type(None)]
    if type(None) in typing.get_args(annotation) and len(args) == 1:
        return parts(args[0])
    return annotation, ()


def special(annotation, kind):
    """The metadata of this kind (`Unit`, `OneOf`, `Either` ...) in an annotation, or None."""
    return next((m for m in parts(annotation)[1] if isinstance(m, kind)), None)


def items_of(annotation):
    """Annotation of a list's items (the first one's for a tuple) or of a dict's values, else None."""
    bare, _ = parts(annotation)
    args = typing.get_args(bare)
    if typing.get_origin(bare) is dict:
        return args[1]
    return args[0] if typing.get_origin(bare) in (list, tuple) and args else None


def shape_of(value):
    """`text`, `number`, `mapping`, `none`, or the depth of a list."""
    if isinstance(value, list | tuple):
        inner = shape_of(value[0]) if value else None
        return 1 + inner if isinstance(inner, int) else 1
    if value is None:
        return "none"
    if isinstance(value, Mapping):
        return "mapping"
    return "text" if isinstance(value, str) else "number"


def shapes(form):
    """The shapes of input that a form reads, as `shape_of` names them."""
    bare, _ = parts(form)
    either = special(form, Either)
    if either:
        return set().union(*(shapes(f) for f in either.forms))
    if special(form, OneOf) or is_record(bare) or dict in (bare, typing.get_origin(bare)):
        return {"mapping"}
    own = next((m.shapes for m in parts(form)[1] if hasattr(m, "shapes")), None)
    if own or bare is bool:
        return own or {"number"}
    if typing.get_origin(bare) in (list, tuple):
        inner = shapes(items_of(form))
        return {1 + s if isinstance(s, int) else 1 for s in inner}
    return {"text"} if bare is str or typing.get_origin(bare) is Literal else {"number", "text"}


def affinity(form, value):
    """How well a fitting form matches: shared keys of a mapping, a named text before any other text."""
    bare, family = parts(form)[0], special(form, OneOf)
    if isinstance(value, str):
        return int(typing.get_origin(bare) is Literal and value in typing.get_args(bare))
    if isinstance(value, Mapping) and (family or is_record(bare)):
        return len(set(value) & ({family.key} if family else set(fields_of(bare))))
    return 0


def classes(form):
    """The record classes a form may become."""
    family, either = special(form, OneOf), special(form, Either)
    if either:
        return tuple(cls for f in either.forms for cls in classes(f))
    if family:
        return tuple(family.table.values())
    return (parts(form)[0],) if is_record(parts(form)[0]) else ()


def unit_of(annotation):
    """Unit text of a field: `m` for a Length and for a Position; '' where there is none."""
    unit = next((m.unit for m in parts(annotation)[1] if hasattr(m, "unit")), None)
    either = special(annotation, Either)
    if unit is not None:
        return unit
    if either:
        return next(filter(None, map(unit_of, either.forms)), "")
    inner = items_of(annotation)
    return unit_of(inner) if inner is not None else ""


def wanted(annotation):
    """What a field takes, in words: `a length in m, e.g. '50 mm'`, `3 numbers in m`."""
    bare, metadata = parts(annotation)
    unit = f" in {unit_of(annotation)}" if unit_of(annotation) else ""
    for m in metadata:
        if hasattr(m, "wanted"):
            return m.wanted + (unit if getattr(m, "takes_unit", False) else "")
    if typing.get_origin(bare) is Literal:
        return joined(typing.get_args(bare))
    if is_record(bare):
        return f"a mapping with {joined(fields_of(bare), 'and')}"
    if typing.get_origin(bare) in (list, tuple):
        return f"a list, each {wanted(items_of(annotation))}"
    names = {str: "text", bool: "true or false", int: "a whole number", float: "a number"}
    return names.get(bare, "a mapping" if dict in (bare, typing.get_origin(bare)) else "a value")
