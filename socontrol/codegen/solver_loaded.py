"""The exported solver of a folder, called from Python as a controller would call it."""

import ctypes
import operator
import weakref
from dataclasses import dataclass

import numpy as np

SCALARS = ("cost", "balance", "miss", "stationarity")
INTEGERS = ("iterations", "stable", "status", "slot", "warm")


@dataclass(frozen=True)
class Answer:
    """What a solve left: status by name (`OK`, `INFEASIBLE`, `NOT_CONVERGED`, `FAILED`), SI values, quality."""

    status: str
    inputs: np.ndarray
    coordinates: np.ndarray
    cost: float
    balance: float
    miss: float
    stationarity: float
    iterations: int
    stable: bool

    @property
    def solved(self):
        """Whether it converged."""
        return self.status == "OK"


class LoadedSolver:
    """One solver struct of a loaded library; give its slot back with `close`, or use it in a `with`. Where neither is
    done the slot is given back when the object is gone.

    `lock`: that of the library. Raises RuntimeError where every slot of the pool is taken.
    """

    def __init__(self, library, prefix, manifest, lock):
        self._library, self._prefix, self._lock = library, prefix, lock
        solver = manifest["solver"]
        self._codes = manifest["codes"]
        self._sizes = {argument["name"]: argument["size"] for argument in solver["arguments"]}
        m, n = len(solver["inputs"]), len(solver["coordinates"])
        if m:
            self._sizes |= {"inputs_lower": m, "inputs_upper": m}
        self.struct = _structure({**({"inputs": m} if m else {}), "coordinates": n}, solver["memory_doubles"])()
        self.given = _given(self._sizes)()
        self._call("defaults", self.given)
        if self._codes[self._call("init", self.struct)] != "OK":
            raise RuntimeError("every slot of the solver's pool is taken; close another solver")
        # The C code points at the struct until it is released, so the finalizer keeps it.
        self._finalizer = weakref.finalize(self, _call, library, prefix, lock, "release", self.struct)

    def solve(self, max_iterations=100, cold=False, **arguments):
        """Answer to arguments by name (SI; those not named keep their last value); `cold`: from rest.

        Raises TypeError for an unknown argument, ValueError for one of another size or for max_iterations that are no
        C int. Arguments that are answered with BAD_INPUT are not kept.
        """
        limit = _c_int("max_iterations", max_iterations)
        values = {name: self._checked(name, value) for name, value in arguments.items()}
        with self._lock:
            before = bytes(self.given)
            for name, value in values.items():
                getattr(self.given, name)[:] = value.tolist()
            if cold:
                self._call("restart", self.struct)
            code = self._call("solve", self.struct, self.given, limit)
            if self._codes[code] == "BAD_INPUT":
                ctypes.memmove(ctypes.byref(self.given), before, len(before))
            return self._answer(code)

    def _checked(self, name, value):
        if name not in self._sizes:
            raise TypeError(f"no argument '{name}'; there are {', '.join(self._sizes)}")
        value = np.asarray(value, dtype=float).ravel()
        if value.size != self._sizes[name]:
            raise ValueError(f"{name}: {value.size} numbers given, {self._sizes[name]} wanted")
        return value

    def _answer(self, code):
        found = self.struct
        return Answer(
            self._codes[code], np.array(getattr(found, "inputs", ())), np.array(found.coordinates),
            *(getattr(found, name) for name in SCALARS), found.iterations, bool(found.stable),
        )  # fmt: skip

    def close(self):
        """Give the slot back."""
        self._finalizer()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def _call(self, name, *arguments):
        return _call(self._library, self._prefix, self._lock, name, *arguments)


def _call(library, prefix, lock, name, *arguments):
    """Return code of a C function of the solver."""
    references = [a if isinstance(a, ctypes.c_int) else ctypes.byref(a) for a in arguments]
    with lock:
        return getattr(library, f"{prefix}_{name}")(*references)


def _c_int(name, number):
    """The number as a C int; raises ValueError for one that is none."""
    try:
        number = operator.index(number)
    except TypeError:
        raise ValueError(f"{name}: {number!r:.40} is given, a whole number is wanted") from None
    if ctypes.c_int(number).value != number:
        raise ValueError(f"{name}: {number} is given, which is no C int")
    return ctypes.c_int(number)


def _structure(vectors, memory):
    """The C struct of a solver."""
    double = ctypes.c_double
    rows = [(name, double * size) for name, size in vectors.items()]
    rows += [(name, double) for name in SCALARS] + [(name, ctypes.c_int) for name in INTEGERS]
    return type("Solver", (ctypes.Structure,), {"_fields_": [*rows, ("memory", double * memory)]})


def _given(sizes):
    """The C struct of the arguments."""
    rows = [(name, ctypes.c_double * size) for name, size in sizes.items()] or [("nothing", ctypes.c_double)]
    return type("Given", (ctypes.Structure,), {"_fields_": rows})
