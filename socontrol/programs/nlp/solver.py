"""Ipopt behind a typed door: settings a file can hold, every outcome as a sentence, the solver's own log kept."""

import os
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np

from socontrol.programs.result import Status
from socontrol.quantities import Bad, Count, Flag, Integer, PositiveNumber, Second, record, show


@record(kw_only=True)
class Ipopt:
    """Settings of the interior-point solver. `options` go to Ipopt by their own names.

    starts: further random starts when the plain solve and the continuation fail; seed: of those starts.
    hessian: of plans, exact or gauss_newton (of squared costs alone: cheaper to evaluate, never indefinite; a cost of
    time is no square).
    keep_log: the result carries Ipopt's own log (the command line always keeps it).
    """

    tolerance: PositiveNumber = 1e-10
    max_iterations: Count = 300
    max_seconds: Second = 60.0
    linear_solver: Literal["mumps", "spral"] = "mumps"
    starts: Integer = 4
    seed: Integer = 1
    hessian: Literal["exact", "gauss_newton"] = "exact"
    keep_log: Flag = False
    options: dict[str, Any] | None = None

    def __post_init__(self):
        for key in ("max_seconds", "starts"):
            if getattr(self, key) < 0:
                raise Bad(key, f"{getattr(self, key)} is negative")
        for name, value in (self.options or {}).items():
            if reason := refused(name, value):
                raise Bad(f"options.{name}", reason)

    def plugin(self, made, program):
        """Name and options of CasADi's plugin for a program and its Functions `made`."""
        return "ipopt", {
            "ipopt": {**self._options(), **program.preferred, **(self.options or {})},
            "print_time": False,
            "calc_lam_p": False,
            "no_nlp_grad": True,  # for calc_lam_p only, and machine code has no derivatives of its own
            "grad_f": made["grad_f"],
            "jac_g": made["jac_g"],
            "hess_lag": made["hess_lag"],
        }

    def _options(self):
        return {
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
            "print_level": 5 if self.keep_log else 0,
        }

    @staticmethod
    def said(stats):
        """(outcome, sentence) of the solver's own statistics."""
        return SENTENCES.get(stats["return_status"], ("numerical", f"Ipopt: {stats['return_status']}."))


def refused(name, value):
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
TELLING = 0.1  # s between two sentences on a solve under way

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

    def __init__(self, program, settings, in_c=False, progress=None):
        began = time.perf_counter()
        self.program, self.settings = program, settings
        self.functions = made = program.functions()
        if in_c:
            made = program.in_c(made)
        self._nlp = made["nlp"]
        self._name, self._plugin = settings.plugin(made, program)
        if progress:
            self._watch = _Iterations(self._nlp, program.limits(), progress)
            self._plugin["iteration_callback"] = self._watch
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
            self._solvers[warm] = ca.nlpsol("solver", self._name, self._nlp, plugin)
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
            arguments["x0"] = np.clip(program.stack(guess), lbx, ubx)
        began = time.perf_counter()
        solver = self._solver(warm is not None)
        try:
            with captured(self.settings.keep_log) as log:
                if hasattr(self, "_watch"):
                    self._watch.begin(log)
                answer = solver(**arguments)
        except RuntimeError as error:
            return self._failed(str(error), time.perf_counter() - began)
        return self._outcome(solver, answer, (lbg, ubg), time.perf_counter() - began, log())

    def _outcome(self, solver, answer, limits, seconds, log):
        stats = solver.stats()
        outcome, sentence = self.settings.said(stats)
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


class _Iterations(ca.Callback):
    """Tells of every iteration of a solve: its number, the largest violation (scaled) and the cost."""

    def __init__(self, nlp, limits, progress):
        super().__init__()
        self._sizes = {"x": nlp["x"].numel(), "f": 1, "g": nlp["g"].numel(), "lam_x": nlp["x"].numel(),
                       "lam_g": nlp["g"].numel(), "lam_p": nlp["p"].numel()}  # fmt: skip
        self._limits, self._progress = limits, progress
        self.construct("iterations", {})

    def begin(self, log):
        """A new solve, whose output goes to `log`."""
        self._count, self._told, self._log = 0, 0.0, log

    def get_n_in(self):
        return len(self._sizes)

    def get_n_out(self):
        return 1

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, found):
        now = time.perf_counter()
        if now - self._told > TELLING:
            g, (lower, upper) = np.array(found[2]).ravel(), self._limits
            violation = float(np.max(np.maximum(lower - g, g - upper), initial=0.0))
            sentence = f"iteration {self._count}, violation {violation:.1e}, objective {float(found[1]):.5g}"
            with self._log.outside():
                self._progress(0, 1, sentence)
            self._told = now
        self._count += 1
        return [0]


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
        return self

    def __call__(self):
        return self._text

    @contextmanager
    def outside(self):
        """While entered, Python's own stdout and stderr are those of before."""
        if not self.active:
            yield
            return
        inside = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = self._own, self._errors
        try:
            yield
        finally:
            sys.stdout, sys.stderr = inside

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
