"""Problem type `statics`: inputs and loads are given, the configuration is found."""

import time

import numpy as np

from socontrol.programs.answer import FORCE_TOLERANCE, Look
from socontrol.programs.balance import Balance
from socontrol.programs.question import Question
from socontrol.programs.result import Result, Status, Value
from socontrol.quantities import record


@record(kw_only=True)
class Statics(Question):
    """Where does the robot come to rest under these inputs and loads?"""

    def prepare(self):
        return StaticsSolver(self)

    def solve(self, progress=None):
        return self.prepare().solve()


class StaticsSolver:
    """One robot made ready for repeated forward statics."""

    def __init__(self, question):
        self.question = question
        self.balance = Balance(question.loaded)
        self.look = Look(question, self.balance)
        self.prescribed = question.named("coordinates", question.coordinates)
        self.free = np.ones(question.robot.n, dtype=bool)
        self.free[list(self.prescribed)] = False

    def solve(self):
        """The equilibrium as a Result, looked at again on an independent path."""
        question = self.question
        u = question.vector("inputs", question.inputs)
        q0 = question.vector("coordinates", question.guess.coordinates, "guess.coordinates")
        began = time.perf_counter()
        limit = question.solver.max_iterations
        answer = self.balance.solve(u, q0, prescribed=self.prescribed, max_iterations=limit)
        seconds = time.perf_counter() - began
        result = Result(
            name=question.name, type="statics", status=answer.status, question=question,
            arrays={"q": answer.q, "u": u}, solver={"iterations": answer.iterations, "seconds": seconds},
        )  # fmt: skip
        return looked_at(result, self.look, self.free, self.prescribed) if answer.status.solved else result


def looked_at(result, look, free, prescribed, residuals=None):
    """The result with values, residuals, stability, discretisation; rejected if the recomputed force is too large."""
    q, u = result.arrays["q"], result.arrays["u"]
    residuals = {**(residuals or {}), **look.residuals(q, u, free)}
    status, collapsed = result.status, look.collapsed(q)
    judged = status.outcome in ("solved", "infeasible")  # else what stopped the solver stays the status
    if judged and not residuals["force"].value <= FORCE_TOLERANCE:
        status = Status(
            "rejected",
            f"The recomputed unbalanced force is {residuals['force'].value:.2g} of the largest force, above"
            f" {FORCE_TOLERANCE:g}; use more Gauss points (`quadrature`) or sections.",
        )
    elif judged and collapsed:
        status = Status(
            "rejected", f"Collapsed or over-bent: {', '.join(collapsed)}; bound the strains or use more sections."
        )
    stable = look.stability(q, u, free)
    if status.solved and not stable.stable:
        status = Status(
            "solved", f"{status.message} The equilibrium is {stable.word}: a disturbance may carry it away."
        )
    limits = look.limits_reached(q, u)
    past = [row["name"] for row in limits if row["beyond"]]
    if status.solved and past:
        status = Status("solved", f"{status.message} Beyond its limits: {', '.join(past)}.")
    details = {**result.details, "stability": stable.sentence, "stable": stable.stable,
               "limits": limits}  # fmt: skip
    values = {**result.values, **look.values(q, u)}
    values["stability.smallest_eigenvalue"] = Value(stable.smallest, "1")
    if prescribed:
        r = np.array(look.balance.evaluate(q, u)[0])
        units = {"rad": "N m", "m": "N"}
        for i in prescribed:
            name, unit = look.robot.coordinates[i], look.robot.coordinate_units[i]
            values[f"holding.{name}"] = Value(float(r[i]), units.get(unit, "conjugate"))
    if look.question.discretisation and status.solved:
        details["discretisation"] = look.doubled(q, u, prescribed)
    return Result(**{**vars(result), "status": status, "values": values, "residuals": residuals, "details": details})
