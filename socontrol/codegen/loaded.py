"""A folder of C code, compiled and called from Python: the same names as Functions, numpy in and out."""

import ctypes
import threading

import numpy as np

from socontrol.codegen.manifest import opened
from socontrol.codegen.solver_loaded import LoadedSolver
from socontrol.native import compiler

FLAGS = ("-std=c99", "-O1", "-fPIC", "-shared")
QUICK = ("-std=c99", "-O0", "-fPIC", "-shared")
TYPES = {"double": np.float64, "float": np.float32}
ALIASES = {"statics_residual": "static_residual"}
_locks = {}  # {path of a library: its lock}: a process has each library, and so its workspace, once


def load_compiled(folder, flags=FLAGS):
    """Loaded of a folder that `socontrol codegen` wrote; its C code is compiled once and kept.

    Raises ValueError for another folder and for one whose manifest, header or source was changed since, NoCompiler or
    CompileError.
    """
    manifest, header, source = opened(folder)
    return Loaded(header, source, manifest, flags)


def joined_text(header, source, prefix):
    """The source with its header in it, to be compiled as one text."""
    return source.replace(f'#include "{prefix}.h"\n', header)


class Loaded:
    """Functions of a folder by the names that `Functions` has: f.mass(q), f.pose("arm", 0.5)(q).

    They take numpy arrays, lists or numbers and return numpy arrays of CasADi's shapes: matrices, and columns
    [n x 1]; several results as a tuple. Raises ValueError, with the section by name, for what is refused.
    """

    def __init__(self, header, source, manifest, flags=FLAGS):
        path = str(compiler.library(joined_text(header, source, manifest["prefix"]), flags=flags))
        self.manifest, self.library = manifest, ctypes.CDLL(path)
        self.lock = _locks.setdefault(path, threading.RLock())
        self._made = {self._key(row): CFunction(self, row) for row in manifest.get("functions", ())}

    @staticmethod
    def _key(row):
        return row["kind"], row["segment"], row["X"]

    def solver(self):
        """LoadedSolver in a free slot, of a folder made from a problem; see there."""
        if "solver" not in self.manifest:
            raise AttributeError("the folder has no solver; make one from a problem file")
        return LoadedSolver(self.library, self.manifest["prefix"], self.manifest, self.lock)

    def pose(self, segment=None, X=1.0):
        """World <- frame at X of a segment [4 x 4] (q); the end of the last segment where none is named."""
        return self._at("pose", segment, X)

    def jacobian(self, segment=None, X=1.0):
        """Body Jacobian [6 x n] of the frame at X of a segment (q)."""
        return self._at("jacobian", segment, X)

    def _at(self, kind, segment, X):
        return self._found(kind, self.manifest["last_segment"] if segment is None else segment, float(X))

    def _found(self, kind, segment=None, X=None):
        try:
            return self._made[kind, segment, X]
        except KeyError:
            place = "" if segment is None else f"@{segment}:{X:g}"
            have = ", ".join(k if s is None else f"{k}@{s}:{x:g}" for k, s, x in self._made) or "none"
            raise AttributeError(f"the folder has no '{kind}{place}'; it has {have}") from None

    def __getattr__(self, name):
        if name.startswith("_") or name in ("manifest", "library", "lock"):
            raise AttributeError(name)
        return self._found(ALIASES.get(name, name))

    def __dir__(self):
        return [*super().__dir__(), *(kind for kind, segment, _ in self._made if segment is None)]

    def worst_section(self, q):
        """Name of the section of rod that turns most at q.

        Raises ValueError for q of another size or with a number that is not finite, AttributeError without rods.
        """
        if not self.manifest["sections"]:
            raise AttributeError("the robot has no sections of rod")
        q = vector("worst_section", "q", q, len(self.manifest["coordinates"]), TYPES[self.manifest["real"]])
        with self.lock:
            index = getattr(self.library, f"{self.manifest['prefix']}_worst_section")(ctypes.c_void_p(q.ctypes.data))
        if index < 0:
            raise ValueError("worst_section: q holds a number that is not finite")
        return self.manifest["sections"][index]


def vector(where, name, x, size, real):
    """Numbers of an argument as a contiguous array; raises ValueError for another size."""
    x = np.ascontiguousarray(np.asarray(x, dtype=float).ravel(), dtype=real)
    if x.size != size:
        raise ValueError(f"{where}: {x.size} numbers given for {name}, {size} wanted")
    return x


class CFunction:
    """One C function over ctypes."""

    def __init__(self, owner, row):
        self.owner, self.name = owner, row["name"]
        self._type = TYPES[owner.manifest["real"]]
        self._call = getattr(owner.library, row["name"])
        self._call.restype = ctypes.c_int
        self.arguments = [(a["name"], a["size"]) for a in row["arguments"]]
        self.results = [(r["name"], (r["rows"], r["columns"])) for r in row["results"]]

    def __call__(self, *args):
        if len(args) != len(self.arguments):
            names = ", ".join(name for name, _ in self.arguments)
            raise TypeError(f"{self.name}: {len(args)} arguments given, {len(self.arguments)} wanted: {names}")
        pairs = zip(args, self.arguments, strict=True)
        given = [vector(self.name, name, x, size, self._type) for x, (name, size) in pairs]
        found = [np.empty(shape, dtype=self._type) for _, shape in self.results]
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*given, *found) if x.size]
        with self.owner.lock:
            code = self._call(*pointers)
            why = self._said(code, given) if code else None
        if why:
            raise ValueError(f"{self.name}: {why}")
        found = [x.astype(float) for x in found]
        return found[0] if len(found) == 1 else tuple(found)

    def _said(self, code, given):
        """The sentence of a return code."""
        if code == 1:
            name = next(n for (n, _), x in zip(self.arguments, given, strict=True) if not np.all(np.isfinite(x)))
            return f"{name} holds a number that is not finite"
        if code == 2:
            return f"section {self.owner.worst_section(given[0])} turns by more than 2 pi; use smaller strains"
        return "a result is not finite"


def float_errors(plan, header, source):
    """{Entry name: largest relative difference in single precision from Python} of a plan's robot part; {} without
    a compiler."""
    part, manifest = plan.parts[0], {"prefix": plan.names.prefix, "real": plan.names.real}
    rows = part.rows(plan.names)
    try:
        loaded = Loaded(header, source, {**manifest, **rows}, QUICK)
    except (compiler.NoCompiler, compiler.CompileError):
        return {}
    errors = {}
    for entry, row in zip(part.entries, rows["functions"], strict=True):
        call, wanted, worst = CFunction(loaded, row), part.wanted(entry), 0.0
        full = [i for i, (_, shape) in enumerate(call.results) if np.prod(shape)]
        for k in range(len(wanted[0])):
            found = call(*(part.samples.values[name][k] for name, _ in call.arguments))
            found = found if isinstance(found, tuple) else (found,)
            for i, rows_of in zip(full, wanted, strict=True):
                scale = np.abs(rows_of).max() or 1.0
                worst = max(worst, float(np.abs(found[i].ravel() - rows_of[k]).max() / scale))
        errors[entry.name] = worst
    return errors
