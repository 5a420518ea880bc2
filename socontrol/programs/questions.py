"""The problem types, by the name a file gives them, and the solvers their files may name."""

import warnings
from dataclasses import replace
from typing import Annotated, Any

from socontrol.native.compiler import CompilerWarning, watched
from socontrol.programs.motions.integrators import Cvodes
from socontrol.programs.motions.simulation import Simulation
from socontrol.programs.plans.trajectory import Trajectory
from socontrol.programs.postures.continuation import Continuation
from socontrol.programs.postures.ellipsoids import Ellipsoids
from socontrol.programs.postures.fit import Fit
from socontrol.programs.postures.inverse_statics import InverseStatics
from socontrol.programs.postures.statics import Statics
from socontrol.programs.tensions.tensions import Tensions
from socontrol.quantities import OneOf

QUESTIONS = {
    "statics": Statics,
    "inverse_statics": InverseStatics,
    "simulation": Simulation,
    "trajectory": Trajectory,
    "tensions": Tensions,
    "fit": Fit,
    "ellipsoids": Ellipsoids,
    "continuation": Continuation,
}
SOLVERS = {name: solver for question in QUESTIONS.values() for name, solver in question.solvers.items()}
Solver = Annotated[Any, OneOf(SOLVERS, what="solver")]


def solve(question, progress=None, compiled=False):
    """Result of a question; `progress(done, total, sentence)` is called on long work.

    compiled: what is called often is compiled C first, which pays for many solves or long motions. Where nothing is
    called often, or no C compiler works, a CompilerWarning says so; the answer is the same, and
    `result.solver["compiled"]` is False.
    """
    reason = _uncompiled(question)
    if compiled and reason:
        warnings.warn(reason, CompilerWarning, stacklevel=2)
    if reason and question.robot.compiled:
        question = replace(question, robot=replace(question.robot, compiled=False))
    elif compiled and not reason:
        question = replace(question, robot=question.robot.in_c())

    def show(sentence):
        if progress:
            progress(0, 1, sentence)

    with watched(show) as watch:
        result = question.solve(progress=progress)
    through = question.robot.compiled and not watch.failures
    return replace(result, solver={**result.solver, "compiled": through})


def _uncompiled(question):
    """Why nothing would be gained by compiling, or None."""
    if isinstance(question, Fit):
        return "a fit solves each of its programs once, so nothing is compiled"
    if isinstance(question.solver, Cvodes):
        return "cvodes differentiates the equation of motion, which compiled C cannot be, so nothing is compiled"
    return None
