"""Ipopt behind a typed door: settings a file can hold, every outcome as a sentence, the solver's own log kept."""

import os
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np

from socontrol.native.compiled import compiled
from socontrol.programs.result import Status
from socontrol.quantities import Bad, Count, Flag, Integer, PositiveNumber, Second, record, show


@record(kw_only=True)
class Ipopt:
    """Settings of the interior-point solver. `options` go to Ipopt by their own names.

    starts: further random starts when the plain solve and the continuation fail; seed: of those starts.
    keep_log: the result carries Ipopt's own log (the command line always keeps it).
    """

    tolerance: PositiveNumber = 1e-10
    max_iterations: Count = 300
    max_seconds: Second = 60.0
    linear_solver: Literal["mumps", "spral"] = "mumps"
    starts: Integer = 4
    seed: Integer = 1
    keep_log: Flag = False
    options: dict[str, Any] | None = None

    def __post_init__(self):
        for key in ("max_seconds", "starts"):
            if getattr(self, key) < 0:
                raise Bad(key, f"{getattr(self, key)} is negative")
        for name, value in (self.options or {}).items():
            if reason := _refusal(name, value):
                raise Bad(f"options.{name}", reason)

    def plugin_options(self):
        """Options for ca.nlpsol."""
        own = {
            "tol": self.tolerance,
            "constr_viol_tol": self.tolerance,
            "dual_inf_tol": 1e-6,
            "compl_inf_tol": 1e-8,
            "max_iter": self.max_iterations,
            "max_wall_time": float(self.max_seconds) or 1e6,
            "linear_solver": self.linear_solver,
            "bound_relax_factor": 0.0,  # inputs stay inside their limits to the last digit
            "nlp_scaling_method": "none",  # variables and constraints come scaled
            "mu_init": 1e-2,
            "mumps_scaling": 0,
            "mumps_permuting_scaling": 0,
            "sb": "yes",
            "print_level": 5,
        }
        return {**own, **(self.options or {})}


def _refusal(name, value):
    """Why Ipopt would not take an option, or None."""
    if name == "linear_solver":
        return "give `linear_solver` beside `options`, not in it"
    x = ca.SX.sym("x")
    try:
        with captured():
            ca.nlpsol("options", "ipopt", {"x": x, "f": x**2}, {"ipopt": {name: value, "sb": "yes"}})
    except Exception as error:  # casadi raises RuntimeError and NotImplementedError, by the type of the value
        unknown = "No such IPOPT option" in str(error)
        return "Ipopt has no option of this name" if unknown else f"Ipopt does not take {show(value)} for this option"
    return None


SOLVERS = {"ipopt": Ipopt}

SENTENCES = {  # Ipopt's return status: (outcome, sentence)
    "Solve_Succeeded": ("solved", "Solved."),
    "Solved_To_Acceptable_Level": (
        "numerical",
        "The solver stalled near a solution, above the requested tolerance; loosen `tolerance` or rescale the problem.",
    ),
    "Infeasible_Problem_Detected": (
        "infeasible",
        "No point near the guess meets the constraints; loosen them, or start elsewhere.",
    ),
    "Search_Direction_Becomes_Too_Small": (
        "numerical",
        "The solver's steps became too small to go on; start elsewhere or loosen the tolerance.",
    ),
    "Diverging_Iterates": ("numerical", "The unknowns ran off to infinity; bound them."),
    "User_Requested_Stop": ("interrupted", "Stopped by the user; run again to go on."),
    "Feasible_Point_Found": ("solved", "A feasible point was found."),
    "Maximum_Iterations_Exceeded": (
        "limit",
        "The iteration limit was reached; raise `max_iterations` or start nearer.",
    ),
    "Restoration_Failed": ("numerical", "The solver found no way back to the constraints; start elsewhere."),
    "Error_In_Step_Computation": ("numerical", "The solver could not compute a step; start elsewhere or rescale."),
    "Maximum_CpuTime_Exceeded": ("limit", "The time limit was reached; raise `max_seconds`."),
    "Maximum_WallTime_Exceeded": ("limit", "The time limit was reached; raise `max_seconds`."),
    "Not_Enough_Degrees_Of_Freedom": (
        "infeasible",
        "More conditions than unknowns; drop a goal, give one a weight, or free an input.",
    ),
    "Invalid_Problem_Definition": ("numerical", "The problem is ill-posed; check bounds and limits."),
    "Invalid_Option": ("numerical", "Ipopt refused an option; see the log for its name."),
    "Invalid_Number_Detected": ("numerical", "The model gave NaN or infinity; bound the strains or start elsewhere."),
    "Unrecoverable_Exception": ("numerical", "Ipopt gave up with an error of its own; see the log."),
    "NonIpopt_Exception_Thrown": ("interrupted", "The solve was interrupted; run again to go on."),
    "Insufficient_Memory": ("numerical", "Out of memory; use fewer sections."),
    "Internal_Error": ("numerical", "Ipopt failed inside; see the log."),
}


@dataclass(frozen=True)
class Outcome:
    """What one call of the solver returned: status, SI values by variable, multipliers, counts."""

    status: Status
    values: dict
    x: np.ndarray
    lam_x: np.ndarray
    lam_g: np.ndarray
    cost: float
    iterations: int
    seconds: float
    violation: float
    log: str = field(default="", repr=False)


class NLP:
    """A program made ready for repeated solves: built once, called with new parameters, bounds and starts.

    `functions` are the program's own; with `in_c` Ipopt calls them as machine code.
    """

    def __init__(self, program, settings, in_c=False):
        began = time.perf_counter()
        self.program, self.settings, quiet = program, settings, not settings.keep_log
        self.functions = program.functions()
        made = _in_c(self.functions) if in_c else self.functions
        self._nlp, own = made["nlp"], settings.plugin_options()
        if quiet:
            own["print_level"] = 0
        self._plugin = {
            "ipopt": own,
            "print_time": False,
            "calc_lam_p": False,
            "no_nlp_grad": True,  # for calc_lam_p only, and machine code has no derivatives of its own
            "grad_f": made["grad_f"],
            "jac_g": made["jac_g"],
            "hess_lag": made["hess_lag"],
        }
        self._solvers = {}
        self._solver(False)
        self.build_seconds = time.perf_counter() - began

    def _solver(self, warm):
        if warm not in self._solvers:
            plugin = dict(self._plugin)
            if warm:
                plugin["ipopt"] = {
                    **plugin["ipopt"],
                    "warm_start_init_point": "yes",
                    "mu_init": 1e-6,
                    "warm_start_bound_push": 1e-9,
                    "warm_start_bound_frac": 1e-9,
                    "warm_start_slack_bound_push": 1e-9,
                    "warm_start_mult_bound_push": 1e-9,
                }
            self._solvers[warm] = ca.nlpsol("solver", "ipopt", self._nlp, plugin)
        return self._solvers[warm]

    def solve(self, guess=None, parameters=None, bounds=None, warm=None):
        """One call of the solver from {variable: SI guess}, or from an earlier Outcome `warm` with its multipliers."""
        program = self.program
        lbx, ubx = program.bounds(bounds)
        lbg, ubg = program.limits()
        arguments = {"p": program.stack_parameters(parameters or {}), "lbx": lbx, "ubx": ubx, "lbg": lbg, "ubg": ubg}
        if warm is not None:
            arguments |= {"x0": np.clip(warm.x, lbx, ubx), "lam_x0": warm.lam_x, "lam_g0": warm.lam_g}
        else:
            arguments["x0"] = np.clip(program.stack(guess or {}), lbx, ubx)
        began = time.perf_counter()
        solver = self._solver(warm is not None)
        try:
            with captured(self.settings.keep_log) as log:
                answer = solver(**arguments)
        except RuntimeError as error:
            return self._failed(str(error), time.perf_counter() - began)
        return self._outcome(solver, answer, (lbg, ubg), time.perf_counter() - began, log())

    def _outcome(self, solver, answer, limits, seconds, log):
        stats = solver.stats()
        outcome, sentence = SENTENCES.get(stats["return_status"], ("numerical", f"Ipopt: {stats['return_status']}."))
        x, g = (np.array(answer[k]).ravel() for k in ("x", "g"))
        miss = np.maximum(limits[0] - g, g - limits[1])
        violation = float(np.max(miss, initial=0.0)) if np.all(np.isfinite(x)) else float("nan")
        if outcome == "solved" and not violation <= 1e3 * self.settings.tolerance:
            outcome, sentence = "numerical", f"The solver stopped with constraints missed by {violation:.2g} (scaled)."
        return Outcome(
            Status(outcome, sentence), self.program.split(x), x, np.array(answer["lam_x"]).ravel(),
            np.array(answer["lam_g"]).ravel(), float(answer["f"]), _count(stats), seconds, violation, log,
        )  # fmt: skip

    def _failed(self, text, seconds):
        line = text.strip().splitlines()[-1][:200]
        x = np.full(self.program.scale.size, np.nan)
        empty = np.zeros(0)
        status = Status("numerical", f"The solver refused the problem: {line}")
        return Outcome(status, self.program.split(x), x, empty, empty, np.nan, 0, seconds, np.nan, text)


def _in_c(made):
    """The Functions of a program in machine code."""
    nlp = made["nlp"]
    x, p = (ca.MX.sym(name, nlp[name].numel()) for name in "xp")
    values = {name: ca.Function(f"nlp_{name}", [nlp["x"], nlp["p"]], [nlp[name]]) for name in "fg"}
    values = {name: compiled(function)(x, p) for name, function in values.items()}
    others = {name: compiled(made[name]) for name in ("grad_f", "jac_g", "hess_lag")}
    return {"nlp": {"x": x, "p": p, **values}, **others}


def _count(stats):
    """Iterations of a solve; where Ipopt refused to begin, CasADi leaves the number unset."""
    return 0 if stats["return_status"] == "Not_Enough_Degrees_Of_Freedom" else max(0, int(stats["iter_count"]))


_CAPTURING = threading.RLock()  # descriptor 1 belongs to the whole process


class captured:
    """Redirects file descriptor 1 and sys.stdout to a file while the solver runs: CasADi writes to either."""

    def __init__(self, active=True):
        self.active = active

    def __enter__(self):
        self._text = ""
        if self.active:
            _CAPTURING.acquire()
            self._file = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
            self._own = sys.stdout
            self._own.flush()
            self._saved = os.dup(1)
            os.dup2(self._file.fileno(), 1)
            sys.stdout = self._file
            self._errors, sys.stderr = sys.stderr, self._file  # CasADi's warnings belong to the log
        return lambda: self._text

    def __exit__(self, *error):
        if self.active:
            self._file.flush()
            sys.stdout, sys.stderr = self._own, self._errors
            os.dup2(self._saved, 1)
            os.close(self._saved)
            self._file.seek(0)
            self._text = self._file.read()
            self._file.close()
            _CAPTURING.release()
        return False
