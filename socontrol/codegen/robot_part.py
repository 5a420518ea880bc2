"""The plain functions of a robot as a part of a folder: constants, one function in C for each Entry, their checks."""

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.codegen import samples
from socontrol.codegen.catalogue import KINDS
from socontrol.codegen.ctext import comment, literal, matrix, text_literal, vector
from socontrol.codegen.part import Checks, called
from socontrol.lie import stumpff

EXACT = 1e-12  # largest difference from Python in double, over the largest number of a function
LOOSE = 1e-2  # the same in float, where no compiler is there to measure it
MARGIN = 4.0  # other compilers and libraries round otherwise: what is allowed over what is measured
WHERE = {0.0: "the base", 1.0: "the end"}
TURNS = "eval_turns"  # C name of the squared angle by which each section turns


@dataclass(frozen=True)
class RobotPart:
    """Functions of one robot. `allowed`: {Entry name: largest relative difference in float, as measured}."""

    robot: object
    entries: tuple
    real: str = "double"
    allowed: dict = field(default_factory=dict)
    codes = {}
    floats = True
    biggest_hint = "name fewer functions with --functions, or use fewer sections"

    @cached_property
    def functions(self):
        turns = {TURNS: self._turns} if self.sections else {}
        return {**turns, **{self.inner(entry): entry.by_rows for entry in self.entries}}

    def inner(self, entry):
        """C name of the code of an entry."""
        return f"eval_{entry.name}"

    @property
    def shares(self):
        """Functions that are called with the shared workspace."""
        return tuple(self.functions)

    @cached_property
    def sections(self):
        """Names of the sections of rods."""
        return self.robot.tree.sections

    @property
    def _turns(self):
        """Squared angle [rad^2] of each section of rod (q)."""
        q = ca.SX.sym("q", self.robot.n)
        squares = [ca.sumsqr(turn) for turn in self.robot.tree.turns(q)]
        return ca.Function("turns", [q], [ca.densify(ca.SX(ca.vertcat(*squares)))], ["q"], ["turns"])

    # Header

    def header(self, names):
        return "\n".join([self._constants(names), *(self._declaration(names, entry) for entry in self.entries)])

    def _constants(self, names):
        """Numbers of coordinates and inputs, and the arrays that name them."""
        robot, real = self.robot, self.real
        blocks = [_named(names, "N", "coordinates q", robot.coordinates, robot.coordinate_units)]
        blocks += [_arrays(names, "coordinate", "N", real)]
        blocks += [_named(names, "M", "inputs u", robot.inputs, robot.input_units)]
        blocks += [_arrays(names, "input", "M", real)] if robot.m else []
        if self.sections:
            size = names.macro("SECTIONS")
            blocks += [f"#define {size} {len(self.sections)}\n", comment("Sections of rods, from base to end.")]
            blocks += [f"extern const char *const {names('sections')}[{size}];\n\n"]
            blocks += [comment("Index in sections of the one that turns most at q, -1 for bad input.")]
            blocks += [f"int {names('worst_section')}({self._array('q', robot.n)});\n"]
        return "".join(blocks)

    def _declaration(self, names, entry):
        """Comment and prototype of an entry."""
        kind, wish = KINDS[entry.wish.kind], entry.wish
        place = {} if wish.X is None else {"segment": wish.segment, "X": WHERE.get(wish.X, f"X = {wish.X:g}")}
        lines = [kind.about.format(**place) if kind.place else kind.about]
        for name, (rows, columns) in entry.results.items():
            if rows * columns:
                shape = f"{rows} x {columns}, row by row" if min(rows, columns) > 1 else str(rows * columns)
                lines.append(f"    {name} [{shape}]: {kind.results[name]}")
        return comment(*lines) + self._prototype(names, entry) + ";\n"

    def _prototype(self, names, entry):
        given = [self._array(name, size) for name, size in entry.arguments.items() if size]
        found = [f"{self.real} {name}[{size}]" for name, size in _sized(entry).items()]
        return f"int {names(entry.name)}({', '.join([*given, *found])})"

    def _array(self, name, size):
        return f"const {self.real} {name}[{size}]"

    # Source

    def source(self, names, code):
        robot = self.robot
        rows = [("coordinate", "N", robot.coordinates, robot.coordinate_units, robot.joint_limits)]
        rows += [("input", "M", robot.inputs, robot.input_units, robot.input_limits)] if robot.m else []
        tables = "".join(_tables(names, *row, self.real) for row in rows)
        if self.sections:
            size = names.macro("SECTIONS")
            tables += vector(f"const char *const {names('sections')}[{size}]", map(text_literal, self.sections))
        ranged = (RANGED if self.sections else UNRANGED).format(
            ok=names.macro("OK"), bad=names.macro("BAD_INPUT"), far=names.macro("OUT_OF_RANGE"), n=names.macro("N"),
            sections=names.macro("SECTIONS"), worst_section=names("worst_section"), real=self.real,
            call=called(code, TURNS) if self.sections else "", limit=literal(stumpff.RANGE**2, self.real),
            size=robot.n, **_arrays_of_call(code, TURNS if self.sections else None),
        )  # fmt: skip
        if not self.entries:
            ranged = ranged.partition("\n/* Return code")[0] + "\n" if self.sections else ""
        return "\n".join([tables, ranged, *(self._definition(names, code, entry) for entry in self.entries)])

    def _definition(self, names, code, entry):
        """One function: check what is given, call the code, check what comes out."""
        sizes, found = code.sizes[self.inner(entry)], _sized(entry)
        arguments = ", ".join(name if size else "0" for name, size in entry.arguments.items())
        checks = [f"!all_finite({name}, {size})" for name, size in entry.arguments.items() if size and name != "q"]
        checks += [f"!{name}" for name in found]
        good = " && ".join(f"all_finite({name}, {size})" for name, size in found.items())
        return (
            f"{self._prototype(names, entry)}\n{{\n"
            f"    const casadi_real *arg[{sizes.arg}] = {{{arguments}}};\n"
            f"    casadi_real *res[{sizes.res}] = {{{', '.join(found)}}};\n"
            f"    const int code = usable(q);\n"
            f"    if (code != {names.macro('OK')}) return code;\n"
            f"    if ({' || '.join(checks)}) return {names.macro('BAD_INPUT')};\n"
            f"    if ({called(code, self.inner(entry))}) return {names.macro('FAILED')};\n"
            f"    return {good} ? {names.macro('OK')} : {names.macro('FAILED')};\n}}\n"
        )

    # Checks

    @cached_property
    def samples(self):
        """States at which the code is tried."""
        return samples.samples(self.robot, [entry.by_rows for entry in self.entries], self.real)

    def wanted(self, entry):
        """[results at each kept state: N x size] of an entry, as Python has them, row by row."""
        count = min(len(self.samples), samples.count(entry.by_rows))
        rows = [samples.results_at(entry.by_rows, self.samples, k) for k in range(count)]
        return [np.array([row[i].ravel(order="F") for row in rows]) for i in range(entry.by_rows.n_out())]

    def selftest(self, names):
        if not self.entries:
            return Checks("", ())
        used = {name: size for entry in self.entries for name, size in entry.arguments.items() if size}
        states = self.samples.values
        tables = [matrix(f"static const real given_{n}[][{s}]", states[n], self.real) for n, s in used.items()]
        tests = [self._test(names, entry) for entry in self.entries]
        calls = tuple(f"test_{entry.name}" for entry in self.entries)
        return Checks("\n".join([*tables, *tests, self._refusals(names)]), (*calls, "test_refusals"))

    def _test(self, names, entry):
        wanted, found = self.wanted(entry), _sized(entry)
        tables = [
            matrix(f"static const real wanted_{entry.name}_{name}[][{size}]", rows, self.real)
            for (name, size), rows in zip(found.items(), wanted, strict=True)
        ]
        given = [f"given_{name}[k]" for name, size in entry.arguments.items() if size]
        scales = [max(1e-300, float(np.abs(rows).max())) if np.any(rows) else 1.0 for rows in wanted]
        compared = "".join(
            f"        difference = larger(difference, worst({name}, wanted_{entry.name}_{name}[k], {size})"
            f" / {scale!r});\n"
            for (name, size), scale in zip(found.items(), scales, strict=True)
        )
        return "".join(tables) + TEST.format(
            name=entry.name, function=names(entry.name), ok=names.macro("OK"), count=len(wanted[0]), compared=compared,
            arrays="".join(f"    real {name}[{size}];\n" for name, size in found.items()),
            arguments=", ".join([*given, *found]), allowed=repr(self.allowed.get(entry.name, self._default)),
        )  # fmt: skip

    @property
    def _default(self):
        return EXACT if self.real == "double" else LOOSE

    def _refusals(self, names):
        """Null pointers, numbers that are not finite, and a section that turns too far, on the first function."""
        entry = self.entries[0]
        found, far = _sized(entry), samples.out_of_range(self.robot)
        others = [f"given_{name}[0]" for name, size in entry.arguments.items() if size and name != "q"]
        tail = ", ".join([*others, *found])
        lines = [f"    real {name}[{size}];\n" for name, size in found.items()]
        lines += [f"    real q[{self.robot.n}] = {{0}};\n", "    int missed = 0;\n"]
        call = f"{names(entry.name)}(%s, {tail})"
        lines += [f"    missed += {call % '0'} != {names.macro('BAD_INPUT')};\n"]
        lines += ["    q[0] = (real) NAN;\n", f"    missed += {call % 'q'} != {names.macro('BAD_INPUT')};\n"]
        if far is not None:
            lines += [f"    q[{i}] = {literal(x, self.real)};\n" for i, x in enumerate(far) if x or i == 0]
            index = next(k for k, piece in enumerate(p for p in self.robot.tree.pieces if p.is_rod) if _turning(piece))
            lines += [f"    missed += {call % 'q'} != {names.macro('OUT_OF_RANGE')};\n"]
            lines += [f"    missed += {names('worst_section')}(q) != {index};\n"]
        body = "".join(lines)
        last = '    return report("refusals", 1, missed, 0.5);\n'
        return f"static int test_refusals(void)\n{{\n{body}{last}}}\n"

    def example(self, names):
        if not self.entries:
            return ""
        entry = self.entries[0]
        given = [(name, size) for name, size in entry.arguments.items() if size]
        found = [*_sized(entry).items()]
        lines = [f"const {self.real} {name}[{size}] = {{0}};" for name, size in given]
        lines += [f"{self.real} {name}[{size}];" for name, size in found]
        lines += [f"int code = {names(entry.name)}({', '.join(name for name, _ in [*given, *found])});", "int k;"]
        lines += [f'printf("{entry.name} of the straight shape: code %d\\n", code);']
        for name, size in found:
            width = entry.results[name][1] if min(entry.results[name]) > 1 else 1
            lines += [f"for (k = 0; k < {size}; k++) "
                      f'printf("%12.6g%s", (double) {name}[k], (k + 1) % {width} ? " " : "\\n");']  # fmt: skip
        return "".join(f"    {line}\n" for line in lines)

    # Manifest

    def rows(self, names):
        """What a caller needs to know: the functions with arguments and results, and names."""
        robot = self.robot
        return {
            "robot": robot.name, "coordinates": list(robot.coordinates), "inputs": list(robot.inputs),
            "sections": self.sections, "last_segment": robot.segments[-1],
            "functions": [_row(names, entry) for entry in self.entries],
        }  # fmt: skip

    def manifest(self, names, code):
        content = self.rows(names)
        for row, entry in zip(content["functions"], self.entries, strict=True):
            inner = self.inner(entry)
            row.update(operations=code.operations[inner], c_bytes=code.bytes[inner])
        return content

    def static_bytes(self, code):
        return 0


def _row(names, entry):
    wish = entry.wish
    return {
        "name": names(entry.name), "kind": wish.kind, "segment": wish.segment, "X": wish.X,
        "arguments": [{"name": n, "size": s} for n, s in entry.arguments.items()],
        "results": [{"name": n, "rows": r, "columns": c} for n, (r, c) in entry.results.items()],
    }  # fmt: skip


def _sized(entry):
    """{C name: length} of the results that are not empty."""
    return {name: rows * columns for name, (rows, columns) in entry.results.items() if rows * columns}


def _turning(piece):
    return np.any(np.array(piece.Phi)[:3] != 0)


def _named(names, macro, what, words, units):
    """`#define N 16` below a comment that names each."""
    rows = [f"    {k:>3}  {word:<28} {unit}" for k, (word, unit) in enumerate(zip(words, units, strict=True))]
    head = f"The {len(words)} {what}, with their units:" if words else f"No {what}."
    return comment(head, *rows) + f"#define {names.macro(macro)} {len(words)}\n"


def _arrays(names, noun, macro, real):
    size = names.macro(macro)
    return (
        f"extern const char *const {names(noun + 's')}[{size}];\n"
        f"extern const char *const {names(noun + '_units')}[{size}];\n"
        f"extern const {real} {names(noun + '_limits')}[{size}][2]; /* infinite where there is none */\n\n"
    )


def _tables(names, noun, macro, words, units, limits, real):
    size = names.macro(macro)
    return (
        vector(f"const char *const {names(noun + 's')}[{size}]", map(text_literal, words))
        + vector(f"const char *const {names(noun + '_units')}[{size}]", map(text_literal, units))
        + matrix(f"const {real} {names(noun + '_limits')}[{size}][2]", limits, real)
    )


def _arrays_of_call(code, name):
    return {} if name is None else {"arg": code.sizes[name].arg, "res": code.sizes[name].res}


RANGED = """/* Index of the section that turns most, its squared angle in *largest. */
static int turned(const {real} *q, {real} *largest)
{{
    {real} turns[{sections}];
    const {real} *arg[{arg}] = {{q}};
    {real} *res[{res}] = {{turns}};
    int k, worst = 0;
    {call};
    for (k = 1; k < {sections}; k++)
        if (!(turns[k] <= turns[worst])) worst = k;
    *largest = turns[worst];
    return worst;
}}

int {worst_section}(const {real} q[{size}])
{{
    {real} largest;
    return all_finite(q, {n}) ? turned(q, &largest) : -1;
}}

/* Return code of coordinates q. */
static int usable(const {real} *q)
{{
    {real} largest;
    if (!all_finite(q, {n})) return {bad};
    turned(q, &largest);
    return largest <= {limit} ? {ok} : {far};
}}
"""
UNRANGED = """/* Return code of coordinates q. */
static int usable(const {real} *q)
{{
    return all_finite(q, {n}) ? {ok} : {bad};
}}
"""
TEST = """static int test_{name}(void)
{{
{arrays}    double difference = 0.0;
    int k;
    for (k = 0; k < {count}; k++) {{
        if ({function}({arguments}) != {ok}) return report("{name}", {count}, INFINITY, {allowed});
{compared}    }}
    return report("{name}", {count}, difference, {allowed});
}}
"""
