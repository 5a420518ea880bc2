"""The whole solver of a `statics`, `inverse_statics` or `tensions` question as a part of a folder of C code.

The algorithm is plain C (templates/solver); this file writes what differs: sizes, limits, scales, the arguments by
name, and the CasADi Function of the rows. A solver owns nothing: its memory stands in the caller's struct, its
workspace in a static pool of slots.
"""

from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import resources

import numpy as np

from socontrol.codegen import solver_checks
from socontrol.codegen.ctext import comment, literal, vector
from socontrol.codegen.identifiers import distinct, identifier
from socontrol.programs.postures.ellipsoids import Ellipsoids
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.reduced import Reduced
from socontrol.programs.postures.statics import Statics
from socontrol.programs.questions import QUESTIONS
from socontrol.quantities import Bad

BEYOND = ("motion", "compliance", "lengths", "motors", "volumes", "timing", "together", "limits", "smoothness")
TEMPLATES = ("dense.c", "qp.c", "sqp.c", "api.c")
ROWS = "sqp_rows"  # C name of the Function of the rows
CONSTANTS = {  # of templates/solver/sqp.c
    "SQP_SINGULAR": (1e-13, "smallest pivot of the scaled tangent"),
    "SQP_SLACK": (1e-6, "of a goal: small enough that goals come first, large enough to keep the digits"),
    "SQP_SMALLEST_SLACK": (1e-10, "where goals that are nearly met close in slowly"),
    "SQP_SOFT": (1.0, "of the start whose goals harden from step to step: it follows the least cost to them"),
    "SQP_NEAR": (1e-4, "a miss below which a goal is nearly met"),
    "SQP_CENTRE": (1e3, "larger multipliers of a goal far off mean that it is out of reach, and shift no slack"),
    "SQP_FLOOR": (1e-4, "of the reduced Hessian at its start, where costs leave an input free"),
    "QP_DEPENDENT": (1e-24, "part of a row that is left across the active ones: less is rounding"),
    "SQP_LONGEST": (0.5, "scaled change of a coordinate in one step: about half a radian of a section"),
    "SQP_SHORT": (0.1, "the same where longer steps led nowhere"),
    "SQP_STEP": (1e-9, "scaled: smaller steps are none"),
    "SQP_BALANCE": (1e-10, "unbalanced force over its scale"),
    "SQP_STATIONARY": (1e-8, "scaled gradient left"),
    "SQP_MISS": (1e-10, "of the robot's length, or rad"),
    "SQP_OUT_OF_REACH": (1e-6, "a miss beyond this, where nothing moves any more, is one the limits ask for"),
    "SQP_REACH": (1e-6, "step and scaled gradient that end the search for the nearest posture"),
    "SQP_ROOM": (1e-9, "that rounding may lie beyond a limit"),
    "SQP_FAR": (1e20, "no limit"),
}
COUNTS = {"SQP_HALVINGS": (14, "of a step"), "SQP_RESTARTS": (3, "of the Hessian where no step helps"),
          "SQP_SPREAD": (2, "starts beside rest before a goal is called out of reach"),
          "SQP_PATIENCE": (30, "steps of one start, if there are as many"),
          "SQP_STRIDES": (8, "of goals that walk from rest to their place")}


def part(question):
    """SolverPart of a question; raises Bad for a question of another type or one that cannot be exported."""
    if not isinstance(question, Statics | InverseStatics) or isinstance(question, Ellipsoids):
        kind = next(name for name, cls in QUESTIONS.items() if type(question) is cls)
        sentence = "has no solver in C; statics, inverse_statics and tensions have; a robot file gives plain functions"
        raise Bad("type", f"'{kind}' {sentence}")
    _refuse_beyond_postures(question)
    try:
        return SolverPart(question, Reduced(question))
    except ValueError as error:
        if isinstance(error, Bad):
            raise
        raise Bad("robot", str(error)) from None


def _refuse_beyond_postures(question):
    """Raise Bad for what a solver of single postures would leave out without a word."""
    for known in fields(question):
        if known.name in BEYOND and getattr(question, known.name) != known.default:
            raise Bad(known.name, "a solver in C holds postures of least cost, inputs by tension; leave this key out")


@dataclass(frozen=True)
class SolverPart:
    """Part of a folder: struct, defaults, init, solve, restart, release. Double precision only."""

    question: object
    reduced: Reduced
    codes: dict = field(
        default_factory=lambda: {
            "NOT_CONVERGED": "the iteration limit was reached or the steps stalled; what was reached is in the struct",
            "INFEASIBLE": "no posture that meets the goals was found within the limits; the nearest is in the struct",
            "NO_SLOT": "every slot of the pool is taken; release one or define a larger _POOL",
        }
    )
    shares: tuple = ()
    floats: bool = False
    biggest_hint: str = "use fewer sections, fewer Gauss points (`quadrature`), or strains that bend only"

    @cached_property
    def functions(self):
        return {ROWS: self.reduced.function}

    @cached_property
    def fields(self):
        """[(field of _given, length, comment)] in the order of p."""
        given = self.reduced.given
        names = distinct([identifier(g.name) for g in given])
        return [
            (name, g.value.size, f"{', '.join(dict.fromkeys(g.units))}: {g.what}")
            for name, g in zip(names, given, strict=True)
        ]

    @property
    def _memory(self):
        """Doubles of sqp_memory."""
        x, u, goals = self.reduced.scale.size, self.reduced.inputs, self.reduced.counts["g"]
        return x + goals + 1 + u * u + 1

    def header(self, names):
        """Structs and functions, documented."""
        m, n, given = self.reduced.inputs, self.reduced.robot.n, names("given")
        rows = [_member(f"{name}[{size}]", about) for name, size, about in self.fields]
        if m:
            rows.append(_member(f"inputs_lower[{m}]", "least inputs, in order and units of inputs below"))
            rows.append(_member(f"inputs_upper[{m}]", "largest inputs; equal to the least: a given input"))
        members = "\n".join(rows) or _member("nothing", "this question has no arguments")
        inputs = _member(f"inputs[{m}]", _listed(self.reduced.robot.inputs, self.reduced.robot.input_units)) + "\n"
        return HEADER.format(
            macro=names.macro("POOL"), given=given, members=members, solver=names("solver"), inputs=inputs if m else "",
            n=n, memory=self._memory, defaults=names("defaults"), init=names("init"), solve=names("solve"),
            restart=names("restart"), release=names("release"), ok=names.macro("OK"), slot=names.macro("NO_SLOT"),
            not_converged=names.macro("NOT_CONVERGED"), infeasible=names.macro("INFEASIBLE"),
            bad=names.macro("BAD_INPUT"), failed=names.macro("FAILED"), title=self._title,
            length=self.reduced.robot.length,
        )  # fmt: skip

    @property
    def _title(self):
        goals = ", ".join(self.reduced.goals)
        if self.reduced.inverse:
            return f"Inverse statics: inputs of least cost that hold {goals}, within the limits."
        return "Statics: the shape at rest under given inputs and loads."

    def source(self, names, code):
        """Constants, tables, the model's door, and the algorithm."""
        texts = [self._constants(), self._tables(names), self._model(code), self._read(names)]
        for name in TEMPLATES:
            text = (resources.files("socontrol.codegen") / "templates" / "solver" / name).read_text()
            texts.append(text.replace("PREFIX_", f"{names('')}").replace("MACRO_", names.macro("")))
        answer = "for (int j = 0; j < SQP_U; j++) s->inputs[j] = w->at->x[SQP_Q + j] * sqp_scale[SQP_Q + j];"
        text = "\n".join(texts)
        return text.replace("    SQP_ANSWER\n", f"    {answer}\n" if self.reduced.inputs else "")

    def _constants(self):
        r, counts = self.reduced, self.reduced.counts
        q, u = r.robot.n, r.inputs
        bounded, goals, sides = len(self._bounded), counts["g"], counts["side"]
        variables = max(1, u + goals if u else 1)
        sizes = {
            "SQP_Q": q, "SQP_U": u, "SQP_X": q + u, "SQP_P": sum(g.value.size for g in r.given), "SQP_GOALS": goals,
            "SQP_SIDES": sides, "SQP_COST": q + goals + sides, "SQP_ROWS": sum(counts.values()),
            "SQP_HELD": len(r.held), "SQP_BOUNDED": bounded, "QP_V": variables, "QP_EQUAL": goals,
            "QP_ROWS": max(1, goals + 2 * (u + bounded + sides)),
        }  # fmt: skip
        lines = [f"enum {{ {', '.join(f'{k} = {v}' for k, v in sizes.items())} }};"]
        lines += [f"enum {{ {name} = {value} }}; /* {why} */" for name, (value, why) in COUNTS.items()]
        own = {"SQP_SMOOTH": (r.smooth, "weight of f, an elastic energy"), "SQP_LEVEL": (r.level, "of the costs")}
        constants = {**CONSTANTS, **own}
        lines += [f"#define {name} {value!r} /* {why} */" for name, (value, why) in constants.items()]
        lines.append("typedef enum { SQP_CONVERGED, SQP_NOT_CONVERGED, SQP_INFEASIBLE, SQP_NUMERICAL } sqp_status;")
        return "#include <string.h>\n\n" + "\n".join(lines) + "\n"

    @cached_property
    def _bounded(self):
        """Indices of free coordinates that have a limit."""
        r = self.reduced
        if not r.inverse:
            return []
        lower, upper = (side[: r.robot.n] for side in r.limits)
        finite = np.isfinite(lower) | np.isfinite(upper)
        return [i for i in range(r.robot.n) if finite[i] and i not in r.held]

    def _tables(self, names):
        r = self.reduced
        lower, upper = (side / r.scale for side in r.limits)
        values = [_braced(g.value) for g in r.given]
        if r.inputs:
            values += [_braced(side[r.robot.n :]) for side in r.limits]
        given = f"static const {names('given')} sqp_given = {{{', '.join(values) or '0'}}};"
        tables = [_table("sqp_lower", lower), _table("sqp_upper", upper), _table("sqp_scale", r.scale)]
        tables += [_table("sqp_rest", r.start / r.scale), _table("sqp_held", sorted(r.held) or [0], "int")]
        tables.append(_table("sqp_bounded", self._bounded or [0], "int"))
        return "\n".join([given, *tables])

    def _model(self, code):
        sizes = code.sizes[ROWS]
        return MODEL.format(rows=ROWS, arg=sizes.arg, res=sizes.res, iw=max(1, sizes.iw), w=max(1, sizes.w))

    def _read(self, names):
        r, lines, at = self.reduced, [], 0
        for name, size, _ in self.fields:
            lines.append(f"    for (int i = 0; i < {size}; i++) p[{at} + i] = given->{name}[i];")
            at += size
        if r.inputs:
            lines += [READ_LIMITS]
        text = "\n".join(lines)
        unused = "" if lines else "    (void)given;\n"
        limits = "" if r.inputs else "    (void)lower;\n    (void)upper;\n"
        finite = f"    return all_finite(p, {at});" if at else "    (void)p;\n    return 1;"
        body = f"{unused}{limits}{text}\n" if text else unused + limits
        return READ.format(given=names("given"), body=body, finite=finite)

    def selftest(self, names):
        """Answers of Ipopt, a path from neighbour to neighbour, goals out of reach, and misuse."""
        return solver_checks.checks(self, names)

    def example(self, names):
        """The question as it stands, solved."""
        r = self.reduced
        kind, size = ("input", names.macro("M")) if r.inputs else ("coordinate", names.macro("N"))
        shown = f"{names(kind + 's')}[k], solver.{kind}s[k], {names(kind + '_units')}[k]"
        lines = [
            f"static {names('solver')} solver;",
            f"{names('given')} given;",
            "int status, k;",
            f"{names('defaults')}(&given);",
            f"if ({names('init')}(&solver)) return 1;",
            f"status = {names('solve')}(&solver, &given, 200);",
            'printf("status %d after %d iterations, miss %.2g\\n", status, solver.iterations, solver.miss);',
            f'for (k = 0; k < {size}; k++) printf("%-24s%14.6g %s\\n", {shown});',
            f"{names('release')}(&solver);",
        ]
        return "".join(f"    {line}\n" for line in lines)

    def manifest(self, names, code):
        """Sizes of the problem, and its arguments."""
        r = self.reduced
        arguments = [{"name": name, "size": size, "about": about} for name, size, about in self.fields]
        return {
            "solver": {
                "type": "inverse_statics" if r.inverse else "statics", "coordinates": list(r.robot.coordinates),
                "inputs": list(r.robot.inputs) if r.inverse else [], "arguments": arguments,
                "memory_doubles": self._memory, "slot_bytes": self.slot_bytes(code), "pool": 1,
                "goals": list(r.goals),
            }
        }  # fmt: skip

    def static_bytes(self, code):
        return self.slot_bytes(code)

    def slot_bytes(self, code):
        """Bytes of one slot of the pool, on a machine with pointers of 8 bytes."""
        r, c, sizes = self.reduced, self.reduced.counts, code.sizes[ROWS]
        q, u, goals, rows = r.robot.n, r.inputs, c["g"], sum(c.values())
        x, v = q + u, max(1, u + goals if u else 1)
        k = max(1, goals + 2 * (u + len(self._bounded) + c["side"]))
        point = 2 * x + 1 + rows + rows * x
        program = 2 * v * v + 5 * v + 3 + _words(v + 2)
        reduced = q * q + q * (u + 1) + rows + (rows - q) * u + 1 + v * v + v + k * v + 2 * k
        step = 3 * u + 3 + q + 2 * goals + 1 + u * u + 1 + 2 * q + 5 + max(1, sizes.w) + _words(q + max(1, sizes.iw))
        pointers, quality, owner = 2 + 3, 4, 1
        return 8 * (2 * point + program + reduced + step + pointers + quality + owner)


def _words(count):
    """Doubles that hold this many ints."""
    return (count + 1) // 2


def _member(name, about):
    return f"    double {name}; {comment(about).rstrip()}"


def _listed(names, units):
    return ", ".join(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))


def _braced(values):
    return "{" + ", ".join(map(literal, values)) + "}"


def _table(name, values, kind="double"):
    entries = [str(int(v)) if kind == "int" else literal(v) for v in values]
    return vector(f"static const {kind} {name}[{len(entries)}]", entries)


HEADER = """\
/* {title}

   Slots of working memory: as many solvers can be at work at a time. For more, define {macro} in the
   whole build (-D{macro}=2 on every line); manifest.json tells the bytes of a slot. */
#ifndef {macro}
#define {macro} 1
#endif

/* What is given, SI. */
typedef struct {{
{members}
}} {given};

/* A solver: answer, quality, and what its next start knows. {init} fills it; leave slot, warm and memory alone.
   After BAD_INPUT the last answer stands. A converged answer may be unstable: look at `stable`. */
typedef struct {{
{inputs}    double coordinates[{n}]; /* in the order above */
    double cost;         /* as in the problem file */
    double balance;      /* largest unbalanced force, over the scale of its coordinate */
    double miss;         /* largest miss of a goal: over the robot's length ({length:.6g} m), or rad */
    double stationarity; /* largest entry of the scaled gradient that multipliers leave */
    int iterations, stable; /* stable: the tangent stiffness is positive definite there */
    int status;          /* what solve returned last */
    int slot, warm;
    double memory[{memory}];
}} {solver};

/* The values of the problem file. */
void {defaults}({given} *given);

/* Takes a slot; the solver starts from rest. {ok} or {slot}.
   A slot that the same struct had before is used again. */
int {init}({solver} *solver);

/* Solves, from the last answer if that converged, else (or if that fails) from rest and further starts, in at most
   max_iterations steps of all starts together, which bounds the time: warm steps along a path take few, goals out of
   reach may take all.
   {ok}: converged, and seen afresh (balance, goals, limits, stationarity).
   {infeasible}: the nearest posture found is in the struct.
   {not_converged}: the last point is in the struct, no answer.
   {failed}, {bad}: nothing to be used. */
int {solve}({solver} *solver, const {given} *given, int max_iterations);

/* The next solve starts from rest. */
int {restart}({solver} *solver);

/* Gives the slot back. */
int {release}({solver} *solver);
"""

MODEL = """\
/* Rows, slopes (row-major), f and its gradient at x; 0 where that fails or a section turns by more than 2 pi. */
static int sqp_model(const double *x, const double *p, double *rows, double *J, double *f, double *df,
                     double *reals, int *integers)
{{
    const double *arg[{arg}];
    double *res[{res}], beyond = 0;
    memset(arg, 0, sizeof arg);
    memset(res, 0, sizeof res);
    arg[0] = x;
    arg[1] = p;
    res[0] = rows;
    res[1] = J;
    res[2] = f;
    res[3] = df;
    res[4] = &beyond;
    return {rows}(arg, res, integers, reals, 0) == 0 && beyond <= 1;
}}
enum {{ SQP_REALS = {w}, SQP_INTEGERS = {iw} }};
"""

READ_LIMITS = """\
    for (int j = 0; j < SQP_U; j++) {
        const double low = given->inputs_lower[j] / sqp_scale[SQP_Q + j];
        const double high = given->inputs_upper[j] / sqp_scale[SQP_Q + j];
        if (!(low <= high && low < SQP_FAR && high > -SQP_FAR)) return 0;
        lower[SQP_Q + j] = low;
        upper[SQP_Q + j] = high;
    }"""

READ = """\
/* Arguments into p and limits; 0 where one is not a number. */
static int sqp_read(const {given} *given, double *p, double *lower, double *upper)
{{
{body}{finite}
}}
"""
