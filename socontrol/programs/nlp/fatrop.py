"""Fatrop behind the same door as Ipopt: an interior-point solver that goes through the stages of a plan one by one."""

from typing import Any

import casadi as ca

from socontrol.programs.nlp.solver import captured
from socontrol.quantities import Bad, Count, Flag, PositiveNumber, record, show


@record(kw_only=True)
class Fatrop:
    """Settings of Fatrop, for plans whose limits and costs stay inside one interval each, with an exact Hessian.
    `options` go to it by their own names. It has no limit of time, and tells nothing on the way.
    """

    tolerance: PositiveNumber = 1e-8
    max_iterations: Count = 500
    keep_log: Flag = False
    options: dict[str, Any] | None = None

    def __post_init__(self):
        for name, value in (self.options or {}).items():
            if reason := _refusal(name, value):
                raise Bad(f"options.{name}", reason)

    def plugin(self, made, program):
        """Name and options of CasADi's plugin; raises Bad for a program whose parts join more than two stages."""
        own = {"tol": self.tolerance, "max_iter": self.max_iterations, "print_level": 5 if self.keep_log else 0}
        return "fatrop", {
            "structure_detection": "manual", **program.structure(), "print_time": False,
            "fatrop": {**own, **(self.options or {})},
        }  # fmt: skip

    def said(self, stats):
        """(outcome, sentence) of the solver's own statistics."""
        if stats["success"]:
            return "solved", "Solved."
        if stats["unified_return_status"] == "SOLVER_RET_LIMITED" or stats["iter_count"] >= self.max_iterations:
            return "limit", "The iteration limit was reached; raise `max_iterations` or start nearer."
        return "numerical", "Fatrop found no solution, and does not say why; solve with ipopt, which does."


def _refusal(name, value):
    """Why Fatrop would not take an option, or None."""
    x = ca.SX.sym("x")
    try:
        with captured():
            solver = ca.nlpsol("options", "fatrop", {"x": x, "f": x**2}, {"fatrop": {name: value, "print_level": 0}})
            solver(x0=1.0)
    except Exception:  # casadi raises RuntimeError and NotImplementedError, by the type of the value
        return f"Fatrop does not take {show(value)} for an option '{name}'"
    return None
