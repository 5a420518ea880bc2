"""What a problem file expects of its answer: checked for its form when the file is read, compared when it is solved.

`expect: {values.cap.position: {value, tolerance, source}}`, likewise `residuals.NAME`; `status.outcome: {value,
source}`; `exit: 4`. Values and tolerances are SI numbers or text with a unit; null in a list is not compared.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socontrol.files.loader import validate
from socontrol.programs.question import Expectation, read
from socontrol.programs.result import OUTCOMES
from socontrol.quantities import Bad, joined, nearest, record, show
from socontrol.units import QUANTITY

FORMS = ("values.NAME", "residuals.NAME", "status.outcome", "exit")


@record(kw_only=True)
class ExpectedOutcome:
    """How the solve should end, and why that is known."""

    value: str
    source: str


@dataclass(frozen=True)
class Comparison:
    """One expectation beside what was found; `found` is None where the answer has no such value."""

    name: str
    expected: Any
    found: Any
    tolerance: Any
    source: str
    met: bool
    unit: str = ""

    @property
    def sentence(self):
        """`values.tip.position: 0.0181 found, 0.018 within 1e-05 m expected (closed form)`."""
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        within = f" within {_words(self.tolerance)}" if self.tolerance is not None else ""
        source = f" ({self.source})" if self.source else ""
        found = "nothing" if self.found is None else _words(self.found)
        return f"{self.name}: {found} found, {_words(self.expected)}{within}{unit} expected{source}"


def _words(value):
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_words, value))}]"
    return "any" if value is None else f"{value:.8g}" if isinstance(value, float) else str(value)


def check_expectations(document):
    """Raise FileError unless every entry of `expect` has a form that can be compared."""
    expect = document.data.get("expect")
    for key, given in (expect if isinstance(expect, Mapping) else {}).items():
        path = ("expect", key)
        if key == "exit":
            codes = sorted(OUTCOMES.values())
            if isinstance(given, bool) or given not in codes:
                raise document.error(path, f"{show(given)} is given; an exit code is wanted: {joined(codes)}")
        elif key == "status.outcome":
            entry = validate(ExpectedOutcome, given, document, path)
            if entry.value not in OUTCOMES:
                near = nearest(entry.value, OUTCOMES)
                raise document.error((*path, "value"), f"unknown outcome '{entry.value}'{near}")
        elif key.partition(".")[0] in ("values", "residuals") and key.partition(".")[2]:
            entry = validate(Expectation, given, document, path)
            _check_numbers(entry.value, document, (*path, "value"))
            if isinstance(entry.tolerance, list):
                raise document.error((*path, "tolerance"), "a list is given; one number or text with a unit is wanted")
            _check_numbers(entry.tolerance, document, (*path, "tolerance"))
            if not isinstance(entry.tolerance, str) and entry.tolerance < 0:
                raise document.error((*path, "tolerance"), f"{entry.tolerance} is negative")
        else:
            raise document.error(path, f"unknown key '{key}'{nearest(key, FORMS)}")


def _check_numbers(value, document, path):
    if isinstance(value, list | tuple):
        for i, item in enumerate(value):
            if item is not None:
                _check_numbers(item, document, (*path, i))
    elif isinstance(value, bool) or not isinstance(value, int | float | str):
        raise document.error(path, f"{show(value)} is given; a number, text with a unit, or a list of them is wanted")
    elif isinstance(value, str) and not QUANTITY.fullmatch(value.strip()):
        raise document.error(path, f"{show(value)} is not a number with a unit, e.g. '12 mm'")
    elif not isinstance(value, str) and not math.isfinite(value):
        raise document.error(path, f"{value} is not a finite number")


def sentences(comparisons):
    """[(whether it is met, sentence)] of each; those that were not computed share one."""
    told = [(c.met, c.sentence) for c in comparisons if c.found is not None]
    missing = [c.name for c in comparisons if c.found is None]
    if len(missing) < 2:
        return told + [(c.met, c.sentence) for c in comparisons if c.found is None]
    return [*told, (False, f"{joined(missing, 'and')}: nothing found, since the problem is not solved")]


def compare(document, result):
    """Comparisons of a result with its document's `expect`; raises FileError for a value that no answer has."""
    comparisons = []
    for key, given in (document.data.get("expect") or {}).items():
        if key == "exit":
            found = result.status.exit_code
            comparisons.append(Comparison(key, given, found, None, "", found == given))
        elif key == "status.outcome":
            found = result.status.outcome
            comparisons.append(Comparison(key, given["value"], found, None, given["source"], found == given["value"]))
        else:
            comparisons.append(_numbers(document, result, key, given))
    return comparisons


def _numbers(document, result, key, given):
    """Comparison of one value or residual."""
    family, _, name = key.partition(".")
    found = getattr(result, family).get(name)
    if found is None:
        if result.status.solved:
            message = f"the answer has no '{name}'{nearest(name, getattr(result, family))}"
            raise document.error(("expect", key), message)
        return Comparison(key, given["value"], None, given["tolerance"], given["source"], False)
    path = ("expect", key)
    try:
        tolerance = read(given["tolerance"], found.unit, "tolerance")
        expected = _si(given["value"], found.unit)
        met = _within(found.value, expected, tolerance)
    except Bad as bad:
        raise document.error((*path, bad.key), str(bad)) from None
    return Comparison(key, expected, found.value, tolerance, given["source"], met, found.unit)


def _si(value, unit):
    if isinstance(value, list | tuple):
        return [_si(item, unit) for item in value]
    return None if value is None else read(value, unit, "value")


def _within(found, expected, tolerance):
    """Whether every number is within the tolerance; raises Bad where the shapes differ."""
    if isinstance(expected, list) != isinstance(found, list | tuple) and expected is not None:
        raise Bad("value", f"{show(expected)} is given; the answer has {show(found)}")
    if isinstance(expected, list):
        if len(expected) != len(found):
            raise Bad("value", f"{show(expected)} is given; the answer has {show(found)}")
        return all(_within(a, b, tolerance) for a, b in zip(found, expected, strict=True))
    return expected is None or (math.isfinite(found) and abs(found - expected) <= tolerance)
