"""Sensitivities of the inputs to goals and loads at a solution, by the implicit function theorem on the KKT system.

With the strictly active limits held, the optimality conditions F(x, lam, p) = 0 are smooth and
    [H A^T; A 0] d(x, lam)/dp = -dF/dp.
Refused where that system is singular or a limit is about to become active or inactive (its multiplier and its
distance are both near zero): there the solution has a kink and no derivative.
Source: A. Fiacco, "Introduction to Sensitivity and Stability Analysis in Nonlinear Programming", 1983, thm. 3.2.2.
"""

import casadi as ca
import numpy as np

from socontrol.programs.result import Value

CLOSE = 10.0  # times the root of the solver's tolerance: an interior point leaves distance x multiplier about there
SINGULAR = 1e-12  # reciprocal condition number of the scaled KKT matrix


class Degenerate(ValueError):
    """The solution has no derivative here; the text says why."""


def derivatives(solver, outcome, parameters):
    """{parameter: du/dp [m x size]} in SI at an outcome of the exact program; raises Degenerate."""
    nlp = solver.posture.exact
    program = nlp.program
    x, p = ca.DM(outcome.x), ca.DM(program.stack_parameters(parameters))
    H, A, dF = (np.array(M) for M in _functions(solver)(x, p, ca.DM(outcome.lam_g)))
    held = _held(program, outcome, solver)
    lower, upper = program.limits()
    rows = np.isfinite(lower) & np.isfinite(upper)
    free, size = ~held, (~held).sum()
    Af = A[rows][:, free]
    kkt = np.block([[H[np.ix_(free, free)], Af.T], [Af, np.zeros((rows.sum(), rows.sum()))]])
    right = -np.vstack([dF[: x.numel()][free], dF[x.numel() :][rows]])
    values = np.linalg.svd(kkt, compute_uv=False)
    if values[-1] < SINGULAR * values[0]:
        raise Degenerate(
            "the optimality conditions are singular here: several input sets are equally good, or none moves"
        )
    dx = np.zeros((x.numel(), p.numel()))
    dx[free] = np.linalg.solve(kkt, right)[:size]
    dx *= program.scale[:, None]
    du, result, start = dx[program.variables["u"].where], {}, 0
    for name, (_, value) in program.parameters.items():
        result[name] = du[:, start : start + value.size]
        start += value.size
    return result


def _functions(solver):
    """Function (x, p, lam_g) -> Hessian of the Lagrangian, dg/dx, and d(grad L; g)/dp, made once."""
    nlp = solver.posture.exact
    if "kkt" not in nlp.functions:
        made = nlp.functions["nlp"]
        lam = ca.SX.sym("lam", made["g"].numel())
        g_and_jac = nlp.functions["jac_g"](made["x"], made["p"])
        gradient = ca.gradient(made["f"], made["x"]) + g_and_jac[1].T @ lam
        H = nlp.functions["hess_lag"](made["x"], made["p"], 1, lam)
        dF = ca.jacobian(ca.vertcat(gradient, made["g"]), made["p"])
        nlp.functions["kkt"] = ca.Function(
            "kkt", [made["x"], made["p"], lam], [ca.triu2symm(H), g_and_jac[1], ca.densify(dF)]
        )
    return nlp.functions["kkt"]


def _held(program, outcome, solver):
    """Mask of unknowns on a strictly active limit; raises Degenerate for an undecided one."""
    lower, upper = program.bounds(solver.posture.limits())
    x, lam = outcome.x, outcome.lam_x
    fixed = upper - lower <= 0
    distance = np.minimum(np.abs(x - lower), np.abs(upper - x))
    multiplier = np.abs(lam)
    close = CLOSE * np.sqrt(solver.question.solver.tolerance)
    undecided = ~fixed & (distance < close) & (multiplier < close)
    if undecided.any():
        i = int(np.argmax(undecided))
        raise Degenerate(f"'{_name(program, solver, i)}' is just touching its limit: the answer has a kink here")
    return fixed | (multiplier > distance)


def _name(program, solver, i):
    u = program.variables["u"].where
    robot = solver.question.robot
    return robot.inputs[i - u.start] if i >= u.start else robot.coordinates[i]


def sensitivities(solver, outcome, parameters):
    """For the report: {`input/parameter`: Value}, or a sentence why there are none."""
    try:
        found = derivatives(solver, outcome, parameters)
    except Degenerate as reason:
        return f"none: {reason}"
    units = solver.question.robot.input_units
    rows = {}
    for name, matrix in found.items():
        for unit, columns in _by_unit(solver, name, matrix.shape[1]).items():
            kind = "" if len(columns) == matrix.shape[1] else {"m": ".position", "rad": ".rotation"}[unit]
            for i, symbol in enumerate(solver.question.robot.inputs):
                rows[f"{symbol}/{name}{kind}"] = Value(matrix[i, columns].tolist(), f"{units[i]}/{unit}")
    return rows


def _by_unit(solver, name, size):
    """{unit: columns} of a parameter: a pose has metres and radians, a direction three plain components."""
    goal = solver.posture.goals.get(name.removeprefix("target."))
    if goal is None:
        return {"N" if name.endswith("force") else "N m": list(range(size))}
    units = goal.units() if len(goal.units()) == size else ["1"] * size
    return {unit: [k for k in range(size) if units[k] == unit] for unit in dict.fromkeys(units)}
