"""Values, Jacobian and Hessian of a sum of alike parts: each kind is differentiated once, mapped over its places,
and gathered.

The Hessian is exact, or that of the costs alone with squares' own second derivatives left out (Gauss-Newton).
"""

import re

import casadi as ca
import numpy as np

from socontrol.native import c_source
from socontrol.native.compiled import compiled

WORTH = 300  # instructions of a Function that are worth a call of the C compiler
EXACT = "exact"  # the other kind of Hessian: gauss_newton


class Assembly:
    """Functions of x [size] and p of a list of parts; order: the permutation of their rows."""

    def __init__(self, parts, size, order, p, hessian, in_c):
        self._made = [Derivatives(part, p, hessian, in_c) for part in parts]
        self._order, self._back = order, np.empty(order.size, dtype=int)
        self._back[order] = np.arange(order.size)
        self._x, self._p = ca.MX.sym("x", size), ca.MX.sym("p", p.numel())

    def functions(self):
        """f, g, grad_f, jac_g, hess_lag in the solver's own signatures, and the nlp mapping."""
        x, p = self._x, self._p
        sigma, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self._order.size)
        f, g = self._values()
        hessian = self._hessian(sigma, lam)
        return {
            "nlp": {"x": x, "p": p, "f": f, "g": g},
            "grad_f": ca.Function("nlp_grad_f", [x, p], [f, self._gradient()], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, self._jacobian()], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [x, p, sigma, lam], [hessian], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
            ),
        }

    def _values(self):
        f, g = ca.MX(0), []
        for one in self._made:
            cost, rows = one.values(self._x, self._p)
            f = f + cost if one.costs else f  # grad_f then asks those alone
            g.append(ca.densify(ca.vec(rows)))
        return f, ca.vertcat(*g)[self._order.tolist()] if self._order.size else ca.MX(0, 1)

    def _gradient(self):
        size, costing = self._x.numel(), [one for one in self._made if one.costs]
        if not costing:
            return ca.MX(ca.DM.zeros(size, 1))
        places = np.concatenate([one.part.where.ravel() for one in costing])
        values = ca.vertcat(*(ca.vec(one.gradients(self._x, self._p)) for one in costing))
        return ca.densify(_gathering(size, places) @ values)

    def _jacobian(self):
        rows, columns, values, first = [], [], [], 0
        for one in self._made:
            part, (r, c) = one.part, one.jacobian_pattern
            if len(r):
                at = first + np.arange(part.count)[:, None] * part.size
                rows.append(self._back[(at + np.array(r)).ravel()])
                columns.append(part.where[:, c].ravel())
                values.append(ca.vec(one.jacobians(self._x, self._p)))
            first += part.count * part.size
        return _sparse((self._order.size, self._x.numel()), rows, columns, values)

    def _hessian(self, sigma, lam):
        rows, columns, values, first = [], [], [], 0
        for one in self._made:
            part, (r, c) = one.part, one.hessian_pattern
            own = self._back[first : first + part.count * part.size]
            first += part.count * part.size
            if len(r):
                a, b = part.where[:, r].ravel(), part.where[:, c].ravel()
                rows.append(np.minimum(a, b))
                columns.append(np.maximum(a, b))
                multipliers = ca.reshape(lam[own.tolist()], part.size, part.count)
                values.append(ca.vec(one.hessians(self._x, self._p, sigma, multipliers)))
        return _sparse((self._x.numel(), self._x.numel()), rows, columns, values)


def values_of(part, p, name="values"):
    """Function of a part: cost and rows."""
    cost = part.cost + ca.sumsqr(part.squares) / 2 if part.squares.numel() else part.cost
    return ca.Function(name, [part.local, part.data, p], [ca.densify(cost), ca.densify(part.rows)])


class Derivatives:
    """Functions of one kind of part, mapped over its places."""

    def __init__(self, part, p, hessian, in_c):
        self.part = part
        x, d = part.local, part.data
        cost = part.cost + ca.sumsqr(part.squares) / 2 if part.squares.numel() else part.cost
        gradient = ca.densify(ca.gradient(cost, x))
        self.costs = not cost.is_constant()
        sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", part.size)
        derive = part.derivatives or (lambda *weights: _differentiated(part, cost, hessian, *weights))
        jacobian, whole = derive(sigma, lam)
        whole = ca.triu(ca.sparsify(whole))
        self.jacobian_pattern, self.hessian_pattern = jacobian.sparsity().get_triplet(), whole.sparsity().get_triplet()
        name = "_".join(re.findall(r"[A-Za-z0-9]+", part.name))
        make = _in_c if in_c and part.count > 1 else (lambda function: function)
        self._values = make(values_of(part, p, f"part_{name}"))
        self._gradient = make(ca.Function(f"gradient_{name}", [x, d, p], [gradient])) if self.costs else None
        self._jacobian = make(ca.Function(f"jacobian_{name}", [x, d, p], [_nonzeros(jacobian)]))
        self._hessian = make(ca.Function(f"hessian_{name}", [x, d, p, sigma, lam], [_nonzeros(whole)]))

    def _arguments(self, x):
        part = self.part
        return ca.reshape(x[part.where.ravel().tolist()], part.where.shape[1], part.count), ca.DM(part.numbers.T)

    def values(self, x, p):
        """Cost of all together, and rows [r x K]."""
        return self._map(self._values, [2], [0])(*self._arguments(x), p)

    def gradients(self, x, p):
        return self._map(self._gradient, [2])(*self._arguments(x), p)

    def jacobians(self, x, p):
        return self._map(self._jacobian, [2])(*self._arguments(x), p)

    def hessians(self, x, p, sigma, lam):
        return self._map(self._hessian, [2, 3])(*self._arguments(x), p, sigma, lam)

    def _map(self, function, reduced, summed=()):
        return function.map(f"{function.name()}_all", "serial", self.part.count, list(reduced), list(summed))


def _differentiated(part, cost, hessian, sigma, lam):
    """Jacobian of a part's rows, and the Hessian of sigma cost + lam rows or of its squares alone."""
    jacobian = ca.jacobian(part.rows, part.local)
    if hessian == EXACT:
        return jacobian, ca.hessian(sigma * cost + ca.dot(lam, part.rows), part.local)[0]
    J = ca.jacobian(part.squares, part.local)
    return jacobian, sigma * (J.T @ J + ca.hessian(part.cost, part.local)[0])


def _in_c(function):
    return compiled(function) if sum(c_source.lengths([function])) > WORTH else function


def _nonzeros(matrix):
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _gathering(size, places):
    """Matrix [size x len(places)] that adds value k to place places[k]."""
    return ca.DM(ca.Sparsity.triplet(size, len(places), places.tolist(), list(range(len(places)))), 1.0)


def _sparse(shape, rows, columns, values):
    """MX matrix of lists of values at their places; those of one place add."""
    if not rows:
        return ca.MX(*shape)
    rows, columns, values = np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values)
    keys = columns.astype(np.int64) * shape[0] + rows  # rises in the order of compressed columns
    found, place = np.unique(keys, return_inverse=True)
    pattern = ca.Sparsity.triplet(*shape, (found % shape[0]).tolist(), (found // shape[0]).tolist())
    if found.size == keys.size:
        order = np.empty(keys.size, dtype=int)
        order[place] = np.arange(keys.size)
        return ca.MX(pattern, values[order.tolist()])
    return ca.MX(pattern, _gathering(found.size, place) @ values)
