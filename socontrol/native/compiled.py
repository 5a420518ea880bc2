"""A robot's Functions as machine code: each is compiled when it is first called, and called through buffers.

Every compiled Function has one output more than the plain one, `beyond`: how many coordinates are not finite and how
many sections turn beyond the range of the series. It costs some nanoseconds in C; only where it is not 0 is the slow
check asked for its sentence.
"""

import functools
import sys
import threading
from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.lie import stumpff
from socontrol.mechanics.functions import Functions, RobotFunction
from socontrol.native import c_source, compiler
from socontrol.native.buffers import Buffered

CHAINED_BEYOND = 3  # sections of rod: longer chains are smaller and faster in C as one call a section
# Instructions of a Function. Optimising takes the compiler 0.15 to 0.35 ms each, more in long ones. Without it C is
# made in a fifth of that time and runs at half the speed, which still is five times that of the virtual machine.
OPTIMISED_UP_TO, COMPILED_UP_TO = 30_000, 400_000
HASTY = ("-O0", *compiler.FLAGS[2:])
FLOAT = np.dtype(float)
_building = threading.RLock()  # CasADi's objects may be made, or called without buffers, by one thread at a time


class Matrix(np.ndarray):
    """What a compiled Function returns: a numpy array of CasADi's shape that knows `full()`, as DM does."""

    def full(self):
        """The same numbers as a plain array."""
        return self.view(np.ndarray)


class CompiledFunctions(Functions):
    """`Functions` whose members are CompiledFunction; see there. Inverse and forward dynamics of long chains are
    made of one call a section, and so is the residual of motion."""

    def __init__(self, robot, parameters=(), chained=False):
        super().__init__(robot, parameters, chained)
        self._compiled = {}

    def __reduce__(self):
        return CompiledFunctions, (self.base, self.parameters, self.chained)

    def _function(self, *args, **named):
        with _building:
            return self._in_c(super()._function(*args, **named))

    def _moving(self, name, *how):
        return self._in_c(super()._moving(name, *how) if self._links is None else getattr(self._links, name))

    def _of_closed(self, name, k):
        return self._in_c(super()._of_closed(name, k) if self._links is None else getattr(self._links, name))

    @cached_property
    def _links(self):
        """Functions as one call a section, where that is better; else None."""
        sections = sum(piece.is_rod for piece in self.base.tree.pieces)
        return Functions(self.base, (), True) if sections > CHAINED_BEYOND and not self.parameters else None

    def _in_c(self, plain):
        if isinstance(plain, CompiledFunction):
            return plain
        if plain not in self._compiled:
            self._compiled[plain] = CompiledFunction(plain, self._beyond)
        return self._compiled[plain]

    @cached_property
    def _beyond(self):
        """Function (q [, p]) -> how many coordinates are not finite and how many sections turn too far."""
        q, p = self._q, self._p
        fine = [ca.fabs(x) <= sys.float_info.max for x in ca.vertsplit(q)]
        fine += [ca.sumsqr(turn) <= stumpff.RANGE**2 for turn in self.robot.tree.turns(q)]  # NaN is at most nothing
        return ca.Function("beyond", [q, p] if self.parameters else [q], [len(fine) - sum(fine, ca.SX(0))])


class CompiledFunction(RobotFunction):
    """A robot's Function in machine code, made when first called; `.function` is the plain CasADi Function.

    Called with numbers, lists or numpy arrays it returns Matrix (several outputs: a tuple), with DM it returns DM, and
    with SX or MX, or by names of arguments, it is the plain Function, so that derivatives stay available. Where no C
    compiler works it warns once and runs in CasADi's virtual machine. Any number of threads may call it.
    """

    def __init__(self, plain, beyond):
        super().__init__(plain.function, plain._turning)
        self._plain, self._beyond, self._own = plain, beyond, threading.local()

    def __reduce__(self):
        return CompiledFunction, (self._plain, self._beyond)

    def __deepcopy__(self, memo):
        return CompiledFunction(self._plain, self._beyond)

    def __call__(self, *args, **named):
        try:
            run, shaped, results, beyond = self._own.made
        except AttributeError:
            if named or any(isinstance(a, (ca.SX, ca.MX)) for a in args):
                return self._uncompiled(args, named)
            run, shaped, results, beyond = self._made()
        exact = False
        if named or len(args) != len(shaped):
            return self._uncompiled(args, named)
        for (array, shape), value in zip(shaped, args):  # noqa: B905  `strict` costs time here
            if not (type(value) is np.ndarray and value.dtype is FLOAT and value.shape == shape):
                exact, value = exact or isinstance(value, ca.DM), _vector(value)
                if value is None or value.shape != shape:
                    return self._uncompiled(args, named)
            array[:] = value
        run()
        if beyond.item():
            self._turning.check(self.function.name(), args[0], args[-1])
        found = [ca.DM(result) for result in results] if exact else [result.copy("K") for result in results]
        return found[0] if len(found) == 1 else tuple(found)

    def buffered(self):
        """A Buffered of its own, in machine code; nothing is checked."""
        with _building:
            return Buffered(self._machine, self.function.n_out())

    def _made(self):
        """What this thread calls: run, (array, shape) of each input, outputs as CasADi shapes them, `beyond`."""
        with _building:
            buffers = Buffered(self._machine)
        results = [output.T.view(Matrix) for output in buffers.outputs[:-1]]
        shaped = [(array, array.shape) for array in buffers.inputs]
        self._own.buffers, self._own.made = buffers, (buffers.run, shaped, results, buffers.outputs[-1])
        return self._own.made

    @cached_property
    def _machine(self):
        """The Function with `beyond` beside its outputs, compiled where that can be."""
        f, q = self.function, 0
        names = [*f.name_in()], [*f.name_out(), "beyond"]
        plain = f.is_a("SXFunction")
        symbols = f.sx_in() if plain else f.mx_in()
        own = [symbols[q], *symbols[f.n_in() :], *(symbols[-1:] if self._beyond.n_in() == 2 else [])]
        outputs = f.call(symbols, True, False)
        outputs = ca.cse(outputs) if plain else outputs  # what is computed twice, up to a fifth, is computed once
        return compiled(ca.Function(f.name(), symbols, [*outputs, self._beyond(*own)], *names))

    def _uncompiled(self, args, named):
        """What the plain Function answers, or the error it raises, in the types of this one."""
        with _building:
            found = self._plain(*args, **named)
        if named or any(isinstance(a, ca.DM) for a in args):
            return found
        several = isinstance(found, (tuple, list))
        rows = [x.full().view(Matrix) if isinstance(x, ca.DM) else x for x in (found if several else [found])]
        return tuple(rows) if several else rows[0]


def _vector(value):
    """Numbers of an argument as a vector; None where they are not plain numbers."""
    try:
        value = value.full() if isinstance(value, ca.DM) else np.asarray(value)
    except Exception:  # of CasADi's symbols, among others
        return None
    return value.ravel() if value.dtype.kind in "fiub" else None


def compiled(function):
    """A CasADi Function in machine code; the Function itself where it is longer than COMPILED_UP_TO or, after a
    CompilerWarning, where it has no C or no C compiler works."""
    length = sum(c_source.lengths([function]))
    if length > COMPILED_UP_TO:
        return function
    try:
        return external(function, compiler.FLAGS if length <= OPTIMISED_UP_TO else HASTY)
    except (compiler.NoCompiler, compiler.CompileError, c_source.NotExportable) as error:
        compiler.failed(error)
        return function


def external(function, flags):
    """A CasADi Function from a shared library of its C code; raises NoCompiler, CompileError or NotExportable."""
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    text = generator.dump()
    c_source.refuse_errors(text)
    flags += ("-fstrict-aliasing",) * function.is_a("MXFunction")  # it helps calls; plain code only takes longer
    return _loaded(function.name(), str(compiler.library(text, flags=flags)))


@functools.cache
def _loaded(name, path):
    try:
        return ca.external(name, path)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1][:200]
        raise compiler.CompileError(f"the compiled {name} cannot be loaded: {reason}") from None
