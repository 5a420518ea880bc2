"""The problem types, by the name a file gives them."""

from socontrol.programs.fit import Fit
from socontrol.programs.inverse_statics import InverseStatics
from socontrol.programs.statics import Statics

QUESTIONS = {"statics": Statics, "inverse_statics": InverseStatics, "fit": Fit}


def solve(question, progress=None):
    """Result of a question; `progress(done, total, sentence)` is called on long work."""
    return question.solve(progress=progress)
