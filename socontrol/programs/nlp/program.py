"""A nonlinear program with names: variables, parameters, constraints and costs, each declared in one call.

    minimise f(x, p)   subject to   lower <= g(x, p) <= upper,   lower <= x <= upper
Variables are scaled, x = scale * x_hat, and constraints divided by their scale; the solver sees hats only and every
answer is read back by name in SI. A constraint may bring its own tangent and curvature (exact, made by hand where
automatic differentiation would repeat a sweep for each coordinate).
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from socontrol.native.compiled import compiled

INFINITY = float("inf")


@dataclass(frozen=True)
class Variable:
    """A named block of unknowns."""

    name: str
    symbol: Any
    guess: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    unit: Any
    where: slice


@dataclass(frozen=True)
class Constraint:
    """A named block of conditions; tangent: {variable: derivative}; curvature(multipliers) -> {(a, b): block}."""

    name: str
    expression: Any
    lower: np.ndarray
    upper: np.ndarray
    scale: np.ndarray
    unit: Any
    tangent: Any
    curvature: Any
    where: slice


class Program:
    """Collects declarations; `functions` turns them into what a solver needs. preferred: options of Ipopt."""

    preferred = {}

    def __init__(self, symbol=ca.MX.sym):
        self._sym = symbol
        self.variables, self.parameters, self.constraints, self.cost = {}, {}, {}, 0

    def variable(self, name, size, *, guess=0.0, scale=1.0, lower=-INFINITY, upper=INFINITY, unit="1"):
        """A block of `size` unknowns [SI]; returns its symbol."""
        start = sum(v.guess.size for v in self.variables.values())
        hat = self._sym(name, size)
        scale = _filled(scale, size)
        blocks = [_filled(x, size) for x in (guess, lower, upper)]
        self.variables[name] = Variable(name, hat, blocks[0], scale, *blocks[1:], unit, slice(start, start + size))
        return hat * ca.DM(scale)

    def parameter(self, name, value):
        """A block of numbers that may change between solves; returns its symbol."""
        value = np.atleast_1d(np.asarray(value, dtype=float)).ravel()
        symbol = self._sym(name, value.size)
        self.parameters[name] = (symbol, value)
        return symbol

    def constrain(self, name, expression, *, lower=0.0, upper=0.0, scale=1.0, unit="1", tangent=None, curvature=None):
        """lower <= expression <= upper, every row in `unit`, divided by `scale` for the solver."""
        size = expression.numel()
        start = sum(c.lower.size for c in self.constraints.values())
        blocks = [_filled(x, size) for x in (lower, upper, scale)]
        self.constraints[name] = Constraint(
            name, expression, *blocks, unit, tangent, curvature, slice(start, start + size)
        )

    def minimize(self, expression):
        """Adds to the cost."""
        self.cost = self.cost + expression

    @property
    def x(self):
        return ca.vertcat(*(v.symbol for v in self.variables.values()))

    @property
    def p(self):
        return ca.vertcat(*(symbol for symbol, _ in self.parameters.values()))

    @property
    def scale(self):
        return np.concatenate([v.scale for v in self.variables.values()])

    def stack(self, values):
        """Scaled vector of {variable: SI values}; blocks not named take their guess."""
        values = values or {}
        parts = [
            np.broadcast_to(np.asarray(values.get(n, v.guess), dtype=float).ravel(), v.guess.shape) / v.scale
            for n, v in self.variables.items()
        ]
        return np.concatenate(parts)

    def stack_parameters(self, values):
        """Vector p of {parameter: values}; those not named keep the value they were declared with."""
        parts = [np.ravel(np.asarray(values.get(n, v), dtype=float)) for n, (_, v) in self.parameters.items()]
        return np.concatenate(parts) if parts else np.zeros(0)

    def split(self, x):
        """{variable: SI values} of a scaled vector."""
        x = np.asarray(x, dtype=float).ravel() * self.scale
        return {name: x[v.where] for name, v in self.variables.items()}

    def bounds(self, changed=None):
        """Scaled (lower, upper) of x; `changed`: {variable: (lower, upper)} in SI replaces a block's."""
        changed = changed or {}
        pairs = [changed.get(n, (v.lower, v.upper)) for n, v in self.variables.items()]
        scales = [v.scale for v in self.variables.values()]
        return tuple(
            np.concatenate([np.asarray(p[k], dtype=float) / s for p, s in zip(pairs, scales, strict=True)])
            for k in (0, 1)
        )

    def limits(self):
        """Scaled (lower, upper) of g."""
        rows = self.constraints.values()
        if not rows:
            return np.zeros(0), np.zeros(0)
        return tuple(np.concatenate([getattr(c, key) / c.scale for c in rows]) for key in ("lower", "upper"))

    def functions(self):
        """f, g, grad_f, jac_g, hess_lag as CasADi Functions in the solver's own signatures, and the nlp mapping."""
        x, p = self.x, self.p
        g = ca.vertcat(*(c.expression / ca.DM(c.scale) for c in self.constraints.values()))
        f = self.cost if isinstance(self.cost, (ca.SX, ca.MX)) else type(x)(self.cost)
        sigma, lam = self._sym("lam_f", 1), self._sym("lam_g", g.numel())
        jac = ca.sparsify(ca.vertcat(*(self._jacobian(c, x) for c in self.constraints.values())))
        hess = ca.triu(self._hessian(sigma * f, lam, x))
        return {
            "nlp": {"x": x, "p": p, "f": f, "g": g},
            "grad_f": ca.Function("nlp_grad_f", [x, p], [f, ca.gradient(f, x)], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jac], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [x, p, sigma, lam], [hess], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
            ),
        }

    @staticmethod
    def in_c(made):
        """The Functions of `functions` in machine code."""
        nlp = made["nlp"]
        x, p = (ca.MX.sym(name, nlp[name].numel()) for name in "xp")
        values = {name: ca.Function(f"nlp_{name}", [nlp["x"], nlp["p"]], [nlp[name]]) for name in "fg"}
        values = {name: compiled(function)(x, p) for name, function in values.items()}
        others = {name: compiled(made[name]) for name in ("grad_f", "jac_g", "hess_lag")}
        return {"nlp": {"x": x, "p": p, **values}, **others}

    def _jacobian(self, c, x):
        if c.tangent is None:
            return ca.jacobian(c.expression / ca.DM(c.scale), x)
        rows = c.lower.size
        blocks = [
            c.tangent[n] @ ca.diag(ca.DM(v.scale)) if n in c.tangent else ca.DM(rows, v.guess.size)
            for n, v in self.variables.items()
        ]
        return ca.diag(1 / ca.DM(c.scale)) @ ca.horzcat(*blocks)

    def _hessian(self, cost, lam, x):
        plain, total = cost, type(x)(x.numel(), x.numel())
        for c in self.constraints.values():
            weights = lam[c.where] / ca.DM(c.scale)
            if c.curvature is None:
                plain = plain + ca.dot(weights, c.expression)
            else:
                total = total + self._assemble(c.curvature(weights))
        return total + ca.hessian(plain, x)[0]

    def _assemble(self, blocks):
        rows = []
        for a, va in self.variables.items():
            row = []
            for b, vb in self.variables.items():
                block = blocks.get((a, b))
                if block is None:
                    block = blocks[b, a].T if (b, a) in blocks else ca.DM(va.guess.size, vb.guess.size)
                row.append(ca.diag(ca.DM(va.scale)) @ block @ ca.diag(ca.DM(vb.scale)))
            rows.append(ca.horzcat(*row))
        return ca.vertcat(*rows)


def _filled(value, size):
    return np.array(np.broadcast_to(np.asarray(value, dtype=float).ravel(), (size,)), dtype=float)
