"""A nonlinear program that is a sum of alike parts: the same small Function at many places of one long vector.

    minimise sum_i f_i(x[where_i], d_i, p)   subject to   lower_i <= g_i(x[where_i], d_i, p) <= upper_i
Each kind of part is differentiated once, as SX of its few unknowns, and mapped over its places; values, Jacobian and
Hessian of the whole are then only gathered, so that building does not grow with the number of places. Unknowns are
scaled, x = scale * x_hat, and rows come scaled.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from socontrol.programs.nlp.assembly import EXACT, Assembly, values_of
from socontrol.quantities import Bad


@dataclass(frozen=True)
class Part:
    """One kind of part. local [L], data [d], p: symbols; rows [r]; cost: a scalar; squares: half their sum joins it.

    where [K x L]: places in x; numbers [K x d]; lower, upper [K x r]; scale [r]: SI per scaled row; units [r];
    when [K]: interval or node, for the order of rows; linking: rows that join one stage to the next; derivatives:
    (sigma, lam) -> Jacobian of the rows and upper half of the Hessian, where they are not left to differentiation.
    """

    name: str
    local: ca.SX
    data: ca.SX
    rows: ca.SX
    cost: ca.SX
    squares: ca.SX
    where: np.ndarray
    numbers: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    scale: np.ndarray
    units: tuple
    when: np.ndarray
    linking: bool = False
    derivatives: Any = None

    @property
    def count(self):
        return self.where.shape[0]

    @property
    def size(self):
        return self.rows.numel()


class Parts:
    """Collects blocks of unknowns and parts; `functions` gives what a solver needs, as a Program does."""

    preferred = {"mu_strategy": "adaptive"}  # a fifth to a half fewer iterations on the shipped plans

    def __init__(self, hessian=EXACT):
        self.parts, self.parameters, self.hessian = [], {}, hessian
        self.states = np.zeros((0, 0), dtype=int)  # places [stages x size] of what one stage hands to the next
        self._arrays = {name: np.zeros(0) for name in ("scale", "lower", "upper", "guess")}
        self._further = {name: [] for name in self._arrays}
        self._size = 0

    def block(self, size, *, scale=1.0, lower=-np.inf, upper=np.inf, guess=0.0):
        """Places [size] of further unknowns in x (SI)."""
        for name, value in (("scale", scale), ("lower", lower), ("upper", upper), ("guess", guess)):
            self._further[name].append(_filled(value, size))
        self._size += size
        return np.arange(self._size - size, self._size)

    def _array(self, name):
        if self._further[name]:
            self._arrays[name] = np.concatenate([self._arrays[name], *self._further[name]])
            self._further[name] = []
        return self._arrays[name]

    @property
    def scale(self):
        """Of all unknowns [nx], SI; so are `lower`, `upper` and `guess`, which may be changed in place."""
        return self._array("scale")

    @property
    def lower(self):
        return self._array("lower")

    @property
    def upper(self):
        return self._array("upper")

    @property
    def guess(self):
        return self._array("guess")

    def parameter(self, name, value):
        """A block of numbers that may change between solves; returns its symbol."""
        value = np.atleast_1d(np.asarray(value, dtype=float)).ravel()
        symbol = ca.SX.sym(name, value.size)
        self.parameters[name] = (symbol, value)
        return symbol

    def add(self, name, blocks, expression, *, numbers=None, lower=0.0, upper=0.0, when=None, linking=False,
            hats=False):  # fmt: skip
        """Parts of one kind at K places. blocks: {letter: places in x [K x size]}; expression(*SI symbols, data) gives
        a mapping with any of rows, scale, units, cost, squares; numbers [K x d] are its data, if any. hats: it is given
        the scaled unknowns themselves."""
        where = np.hstack([np.atleast_2d(b) for b in blocks.values()])
        count = where.shape[0]
        if not count:
            return
        sizes = [np.atleast_2d(b).shape[1] for b in blocks.values()]
        local = ca.SX.sym(name, where.shape[1])
        scale = self.scale[where]
        if np.ptp(scale, axis=0).any():
            raise ValueError(f"parts '{name}' stand at places of different scales")
        if np.any(np.diff(np.sort(where, axis=1), axis=1) == 0):
            raise ValueError(f"parts '{name}' name one place twice")
        pieces = ca.vertsplit(local if hats else local * ca.DM(scale[0]), np.cumsum([0, *sizes]).tolist())
        numbers = np.zeros((count, 0)) if numbers is None else np.asarray(numbers, dtype=float).reshape(count, -1)
        data = ca.SX.sym("data", numbers.shape[1])
        found = expression(*pieces, data) if numbers.shape[1] else expression(*pieces)
        rows = ca.densify(ca.SX(found.get("rows", ca.SX(0, 1))))
        shape = count, rows.numel()
        own = _filled(found.get("scale", 1.0), rows.numel())
        lower, upper = (np.broadcast_to(np.asarray(x, dtype=float), shape) / own for x in (lower, upper))
        units = found.get("units", "1")
        units = (units,) * rows.numel() if isinstance(units, str) else tuple(units)
        squares = ca.densify(ca.SX(found.get("squares", ca.SX(0, 1))))
        when = np.arange(count) if when is None else np.asarray(when)
        self.parts.append(Part(
            name, local, data, rows / ca.DM(own), ca.SX(found.get("cost", 0.0)), squares, where, numbers,
            lower, upper, own, units, when, linking,
        ))  # fmt: skip

    def stack(self, values):
        """Scaled vector of SI values x [nx]; the blocks' own guess where none are given."""
        return (self.guess if values is None else np.asarray(values, dtype=float)) / self.scale

    def split(self, x):
        """SI values of a scaled vector."""
        return np.asarray(x, dtype=float).ravel() * self.scale

    def stack_parameters(self, values):
        """Vector p of {parameter: values}; those not named keep the value they were declared with."""
        parts = [np.ravel(np.asarray(values.get(n, v), dtype=float)) for n, (_, v) in self.parameters.items()]
        return np.concatenate(parts) if parts else np.zeros(0)

    def bounds(self, changed=None):
        """Scaled (lower, upper) of x; `changed`: the same in SI instead."""
        lower, upper = changed or (self.lower, self.upper)
        return lower / self.scale, upper / self.scale

    @cached_property
    def order(self):
        """Permutation of rows: by stage, at each the rows that link it to the next first."""
        keys = [np.repeat(np.column_stack([p.when, np.full(p.count, 0 if p.linking else 1)]), p.size, axis=0)
                for p in self.parts]  # fmt: skip
        keys = np.concatenate(keys) if keys else np.zeros((0, 2))
        return np.lexsort((np.arange(len(keys)), keys[:, 1], keys[:, 0]))

    def limits(self):
        """Scaled (lower, upper) of g."""
        flat = [np.concatenate([getattr(p, key).ravel() for p in self.parts]) for key in ("lower", "upper")]
        return tuple(x[self.order] for x in flat)

    @cached_property
    def rows(self):
        """(part, instance, row) of each row of g."""
        every = [(p, i, k) for p in self.parts for i in range(p.count) for k in range(p.size)]
        return [every[j] for j in self.order]

    def structure(self):
        """N, and the states, controls and rows of every stage, for a solver that goes through them one by one.

        Raises Bad where a part joins more than its own stage, naming it.
        """
        firsts, (stages, nx) = self.states[:, 0], self.states.shape
        stage = np.searchsorted(firsts, np.arange(self.scale.size), side="right") - 1
        rows = np.zeros(stages, dtype=int)
        for part in self.parts:
            own = stage[part.where] - part.when[:, None]
            if np.any(own < 0) or np.any(own > part.linking):
                sentence = f"'fatrop' goes from interval to interval, and '{part.name}' joins several; use ipopt"
                raise Bad("solver", sentence)
            if not part.linking:
                np.add.at(rows, part.when, part.size)
        controls = np.diff([*firsts, self.scale.size]) - nx
        return {"N": stages - 1, "nx": [nx] * stages, "nu": controls.tolist(), "ng": rows.tolist()}

    def functions(self, in_c=False):
        """f, g, grad_f, jac_g, hess_lag as CasADi Functions in the solver's own signatures, and the nlp mapping."""
        return Assembly(self.parts, self.scale.size, self.order, self.p, self.hessian, in_c).functions()

    def in_c(self, made):
        """The Functions of `functions` with what is evaluated at every place in machine code."""
        return self.functions(in_c=True)

    def evaluated(self, x, parameters=None):
        """[(part, its cost, its scaled rows [K x r])] at a scaled vector."""
        p, rows = self.stack_parameters(parameters or {}), []
        for part in self.parts:
            cost, g = values_of(part, self.p)(np.asarray(x)[part.where].T, part.numbers.T, p)
            rows.append((part, float(np.sum(np.array(cost))), np.array(g).reshape(part.size, part.count).T))
        return rows

    @property
    def p(self):
        """Symbols of all parameters."""
        return ca.vertcat(*(symbol for symbol, _ in self.parameters.values())) if self.parameters else ca.SX(0, 1)


def _filled(value, size):
    value = np.asarray(value, dtype=float).ravel()
    return np.full(size, value[0]) if value.size == 1 else np.array(np.broadcast_to(value, (size,)))
