"""What a folder of C code is made of: parts, each with its functions, declarations, definitions and checks.

All parts of a folder share one header, one source, one self-test, one example and one manifest. The writer joins the
CasADi Functions of all parts into one clean C text, in which each becomes

    static int NAME(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem);

and puts below it what parts may use: `int all_finite(const casadi_real* x, int n)` (1 where x is no null pointer and
holds n finite numbers) and one workspace `integers` and `reals`, as large as the largest Function in the parts'
`shares` needs; `called(code, NAME)` is the text of a call with it. `casadi_real` is the header's double or float.
"""

from dataclasses import dataclass
from typing import Protocol

CODES = {  # what every function returns, by macro name; a part adds its own
    "OK": "done",
    "BAD_INPUT": "a null pointer, or a number that is not finite",
    "OUT_OF_RANGE": "a section of rod turns by more than 2 pi; see worst_section",
    "FAILED": "a result is not finite",
}


@dataclass(frozen=True)
class Names:
    """C names of a folder: `names("pose")` is stiff_flop_pose, `names.macro("OK")` is STIFF_FLOP_OK."""

    prefix: str
    real: str = "double"

    def __call__(self, name):
        return f"{self.prefix}_{name}"

    def macro(self, name):
        return f"{self.prefix}_{name}".upper()


@dataclass(frozen=True)
class Checks:
    """Part of selftest.c: `text` defines `static int NAME(void)` for each of `calls`, which are run in that order.

    Each prints one line and returns 0 where it passed, 1 where not. `text` may use <math.h>, <stdio.h> and <string.h>,
    `real` (double or float), `double worst(const real *got, const real *wanted, int n)` (largest difference, infinite
    where a number is not finite), `double larger(double a, double b)` and `int report(const char *name, int vectors,
    double difference, double allowed)` (prints the line, returns 0 or 1).
    """

    text: str
    calls: tuple


class Part(Protocol):
    """One part of a folder. Every text is whole lines of C99; `code` is the CSource of all parts together."""

    functions: dict  # {C name: ca.Function}: static entries for `source`; C names are unique over all parts
    shares: tuple  # those of them that are called with the shared workspace
    codes: dict  # {macro name: sentence}: return codes beside CODES
    floats: bool  # whether it works in single precision
    biggest_hint: str  # what to do when its code is too large, as the end of a sentence

    def header(self, names):
        """Declarations with their comments; they stand inside extern "C"."""

    def source(self, names, code):
        """Definitions, below the CasADi code, the workspace and `all_finite`."""

    def selftest(self, names):
        """Checks of this part."""

    def example(self, names):
        """Statements of main.c's main, in a block of their own (<stdio.h> is there), or ''."""

    def manifest(self, names, code):
        """{key: plain data} that joins manifest.json."""

    def static_bytes(self, code):
        """Bytes of the part's own static variables that are not const, beside the workspace."""


@dataclass(frozen=True)
class Folder:
    """What becomes a folder: names, what it is about, and its parts."""

    names: Names
    title: str  # one line about what this is, for comments
    parts: tuple

    @property
    def codes(self):
        """{macro name: sentence} of all return codes, numbered from 0."""
        return {code: text for table in (CODES, *(part.codes for part in self.parts)) for code, text in table.items()}


def called(code, name):
    """`NAME(arg, res, integers, reals, 0)`, with null pointers for what the Function does not use."""
    sizes = code.sizes[name]
    return f"{name}(arg, res, {'integers' if sizes.iw else '0'}, {'reals' if sizes.w else '0'}, 0)"
