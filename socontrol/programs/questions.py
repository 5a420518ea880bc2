"""The problem types, by the name a file gives them, and the solvers their files may name."""

from typing import Annotated, Any

from socontrol.programs.fit import Fit
from socontrol.programs.inverse_statics import InverseStatics
from socontrol.programs.simulation import Simulation
from socontrol.programs.statics import Statics
from socontrol.quantities import OneOf

QUESTIONS = {"statics": Statics, "inverse_statics": InverseStatics, "simulation": Simulation, "fit": Fit}
SOLVERS = {name: solver for question in QUESTIONS.values() for name, solver in question.solvers.items()}
Solver = Annotated[Any, OneOf(SOLVERS, what="solver")]


def solve(question, progress=None):
    """Result of a question; `progress(done, total, sentence)` is called on long work."""
    return question.solve(progress=progress)
