"""How far a point gives way, and what redundant tensions make of it: where more cables pull than goals ask for, all
tensions that meet the goals within the limits are equally right, and co-contraction decides how soft the robot is."""

import time
from dataclasses import replace
from typing import Literal

import numpy as np

from socontrol.programs.nlp.solver import Outcome
from socontrol.programs.postures.goals import locate
from socontrol.programs.result import Status, Value
from socontrol.programs.tensions.compliance_range import GREATEST, LEAST, LENGTHS, TENSIONS, Range
from socontrol.programs.tensions.redundancy import STANDING
from socontrol.quantities import Axis, Bad, Fraction, record

HELD = {"tensions": TENSIONS, "lengths": LENGTHS}
ENDS = {"least": LEAST, "greatest": GREATEST}


@record(kw_only=True)
class Compliance:
    """How far the point at X of a segment gives way along `axis` (world) for a force along it, with tensions held and
    with cable lengths held; `take`: the answer among redundant tensions, by the compliance with these `held`."""

    on: str
    axis: Axis
    at: Fraction = 1.0
    held: Literal["tensions", "lengths"] = "lengths"
    take: Literal["least_tension", "least", "greatest"] = "least_tension"

    def check(self, question):
        """Raises Bad where the point is not on the robot, or `take` does not go with the question's other keys."""
        try:
            locate(question.robot, self)
        except Bad as bad:
            raise Bad(f"compliance.{bad.key}", str(bad)) from None
        for name, goal in question.goals.items():
            if goal.weight is not None:
                told = f"goal '{name}' has a weight, so that it is no condition that redundant tensions could keep"
                raise Bad("compliance", f"{told}; leave the weight, or compliance, out")
        if self.take != "least_tension" and question.sensitivities:
            raise Bad("sensitivities", f"they are of least cost, and `take: {self.take}` is asked; leave one out")


def braced(solver, result):
    """The Result of a posture with the compliances at its answer and their ranges; by `take`, at other tensions.

    values: compliance.tensions and .lengths [m/N], each with .least and .greatest, the best found; arrays under the
    same names: the inputs [m] there. details["compliance"]: redundancy (independent changes of the inputs that keep
    the goals), starts, taut {name: cables that are taut}, notes (sentences about ends that were not reached).
    """
    began, asked, program = time.perf_counter(), solver.question.compliance, solver.posture.exact.program
    parameters = result.details["targets"]
    at = program.stack(solver.posture.posed(result.arrays["q"], result.arrays["u"]))
    search = Range(solver, asked, parameters, at)
    ends = search.ends()
    here, arrays = search.answer, {}
    if not ends and (here is None or asked.take != "least_tension"):
        return _without(result, asked, here)
    if asked.take != "least_tension":
        here = ends[HELD[asked.held], ENDS[asked.take]]
        result = _moved(solver, result, here, search, parameters)
    values, taut = {}, {"": search.taut(here)}
    for held, which in HELD.items():
        values[f"compliance.{held}"] = Value(here.both[which], "m/N")
        for name, sign in ENDS.items() if ends else ():
            key, end = f"compliance.{held}.{name}", ends[which, sign]
            values[key] = Value(end.both[which], "m/N")
            arrays[key], taut[key] = program.split(end.here.x)["u"], search.taut(end)
    notes = _notes(search, ends)
    found = {"redundancy": search.degrees, "starts": len(search.starts), "taut": taut, "notes": notes}
    status = result.status
    if notes and status.solved:
        status = Status("solved", " ".join([status.message, *notes]))
    seconds = {**result.solver, "seconds": result.solver["seconds"] + time.perf_counter() - began}
    return replace(
        result, status=status, values={**result.values, **values}, arrays={**result.arrays, **arrays}, solver=seconds,
        details={**result.details, "compliance": found},
    )  # fmt: skip


def _without(result, asked, here):
    """The Result of least tension where its compliance cannot be told, or not the one that is asked for."""
    why = "nothing holds the point at these tensions" if here is None else "the posture is not stable at these tensions"
    if asked.take == "least_tension":
        sentence = f"{result.status.message} Its compliance has no bound: {why}; `bounds: inputs` keep cables taut."
        return replace(result, status=Status("solved", sentence))
    sentence = f"{why}, so that the {asked.take} compliance cannot be sought from there"
    fix = "keep cables taut by `bounds: inputs`, or take: least_tension"
    return replace(result, status=Status("infeasible", f"{sentence[0].upper()}{sentence[1:]}; {fix}."))


def _moved(solver, result, end, search, parameters):
    """The Result at the inputs of an end, looked at like any other."""
    program, size = search.redundancy.program, end.here.x.size
    asked, count = solver.question.compliance, len(search.starts)
    taken = f"Solved; the {asked.take} compliance with {asked.held} held is the best of searches from {count} starts."
    outcome = Outcome(
        Status("solved", taken), program.split(end.here.x), end.here.x, np.zeros(size), np.zeros(0), 0.0, 0, 0.0,
        end.here.miss,
    )  # fmt: skip
    return solver.result(outcome, result.details["attempts"], parameters, result.solver["seconds"])


def _notes(search, ends):
    """Sentences on ends that no search came to, and on why there are none."""
    if not ends:
        return ["The compliances have no range: the posture is not stable at these tensions."]
    notes = []
    for held, which in HELD.items():
        for name, sign in ENDS.items() if search.degrees else ():
            end = ends[which, sign]
            if end.here.smallest < 2 * STANDING:
                notes.append(f"The {name} compliance with {held} held is where the robot begins to buckle.")
            elif end.of != (which, sign):
                notes.append(f"The {name} compliance with {held} held may lie further: the search stopped on its way.")
    return notes
