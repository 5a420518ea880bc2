"""Problem type `statics`: inputs, or lengths of their lines, and loads are given, the configuration is found."""

import time
from dataclasses import replace

import numpy as np

from socontrol.programs.equilibria.dead_points import relieved
from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.equilibria.least_energy import rest_of
from socontrol.programs.equilibria.lengths import LengthQuestion
from socontrol.programs.looks.answer import FORCE_TOLERANCE, LOOP_TOLERANCE, Look, overstretched
from socontrol.programs.result import Result, Status, Value
from socontrol.quantities import joined, record


@record(kw_only=True)
class Statics(LengthQuestion):
    """Where does the robot come to rest under these inputs, lengths and loads?"""

    knows_loops = True

    def prepare(self):
        return StaticsSolver(self)

    def solve(self, progress=None):
        return self.prepare().solve()


class StaticsSolver:
    """One robot made ready for repeated forward statics."""

    def __init__(self, question):
        self.question = question
        self.balance = balance_of(question.loaded, question.held)
        self.look = Look(question, self.balance)
        self.prescribed = question.named("coordinates", question.coordinates)
        self.free = np.ones(question.robot.n, dtype=bool)
        self.free[list(self.prescribed)] = False

    def solve(self):
        """The equilibrium as a Result, looked at again on an independent path."""
        question = self.question
        guess = question.vector("inputs", question.guess.inputs, "guess.inputs")
        u = np.zeros(guess.size)
        u[question.held.index] = guess[question.held.index]
        for i, value in question.named("inputs", question.inputs).items():
            u[i] = value
        q0 = question.vector("coordinates", question.guess.coordinates, "guess.coordinates")
        began = time.perf_counter()
        limit = question.solver.max_iterations
        answer, tried = self._answer(u, q0, limit)
        seconds = time.perf_counter() - began
        u = getattr(answer, "u", u)
        result = Result(
            name=question.name, type="statics", status=answer.status, question=question,
            arrays={"q": answer.q, "u": u}, solver={"iterations": answer.iterations, "seconds": seconds},
        )  # fmt: skip
        if question.robot.loops:
            redundant = self.balance.redundant(answer.q, self.free)
            details = {"redundant_rows": redundant, **({"shapes": tried} if tried else {})}
            result = replace(result, arrays={**result.arrays, "lam": answer.lam}, details=details)
        if not answer.status.solved:
            return result
        result = looked_at(result, self.look, self.free, self.prescribed)
        return self._told_of_lengths(result, answer) if question.held else result

    def _answer(self, u, q0, limit):
        """(equilibrium, what was tried of rests where loops may close in several ways); see `rest_of`."""
        question = self.question
        guessed = bool(question.held or question.guess.coordinates) or not self.look.conservative(u)
        return rest_of(self.balance, u, q0, self.prescribed, limit, guessed=guessed)

    def _told_of_lengths(self, result, answer):
        """The result with what its lengths leave open: slack cables, and tensions that they do not decide."""
        slack, told = self.look.slack(answer.u), ""
        if slack:
            told = f" Slack: {joined(slack, 'and')}."
        if answer.redundant:
            told += " These lengths depend on each other: other inputs would hold them too; the least are taken."
        place, change = answer.steepest
        if 1e-5 * self.look.robot.length * change > 1:
            name, i = self.question.held.names[place], self.question.held.index[place]
            most, unit = 1e-6 * change * self.balance.scales.u[i], self.question.robot.input_units[i]
            told += (f" These lengths nearly depend on each other: {name} longer by 1 um changes an input by {most:.2g}"
                     f" {unit}; give cables their `stiffness`.")  # fmt: skip
        details = {**result.details, "held": list(self.question.held.names), "slack": slack,
                   "redundant": answer.redundant}  # fmt: skip
        status = replace(result.status, message=f"{result.status.message}{told}")
        return replace(result, status=status, details=details)


def looked_at(result, look, free, prescribed, residuals=None):
    """The result with values, residuals, stability, discretisation; rejected if the recomputed force is too large."""
    q, u, lam = result.arrays["q"], result.arrays["u"], result.arrays.get("lam")
    lam, dead = relieved(look.balance, q, free, lam)
    if dead:
        result = replace(result, arrays={**result.arrays, "lam": lam})
    residuals = {**(residuals or {}), **look.residuals(q, u, free, lam)}
    status, collapsed = result.status, look.collapsed(q)
    judged = status.outcome in ("solved", "infeasible")  # else what stopped the solver stays the status
    if judged and dead and not residuals["force"].value <= FORCE_TOLERANCE:
        status = Status("rejected", f"{dead.refusal}.")
    elif judged and not residuals["force"].value <= FORCE_TOLERANCE:
        status = Status(
            "rejected",
            f"The recomputed unbalanced force is {residuals['force'].value:.2g} of the largest force, above"
            f" {FORCE_TOLERANCE:g}; use more Gauss points (`quadrature`) or sections.",
        )
    elif judged and lam is not None and not residuals["loops"].value <= LOOP_TOLERANCE:
        status = Status("rejected", f"A recomputed loop is {residuals['loops'].value:.2g} m or rad open; give a guess.")
    elif status.solved and not look.met(residuals):
        status = Status(
            "rejected",
            f"The recomputed lengths are {1e3 * residuals['lengths'].value:.2g} mm off; use more Gauss points.",
        )
    elif judged and collapsed:
        status = Status(
            "rejected", f"Collapsed or over-bent: {', '.join(collapsed)}; bound the strains or use more sections."
        )
    stable = look.stability(q, u, free, lam)
    if status.solved and not stable.stable:
        status = Status(
            "solved", f"{status.message} The equilibrium is {stable.word}: a disturbance may carry it away."
        )
    if status.solved and (stretched := overstretched(look.robot, q)):
        told = joined([f"{name} is {'stretched' if x > 0 else 'shortened'} by {100 * abs(x):.0f} %"
                       for name, x in stretched.items()], "and")  # fmt: skip
        status = Status("solved", f"{status.message} {told}, farther than a linear law holds.")
    limits = look.limits_reached(q, u)
    past = [row["name"] for row in limits if row["beyond"]]
    if status.solved and past:
        status = Status("solved", f"{status.message} Beyond its limits: {', '.join(past)}.")
    details = {**result.details, "stability": stable.sentence, "stable": stable.stable,
               "limits": limits}  # fmt: skip
    values = {**result.values, **look.values(q, u, lam)}
    values["stability.smallest_eigenvalue"] = Value(stable.smallest, "1")
    if not look.question.optimises and (moved := look.displacement(q, prescribed)):
        values["largest_displacement"] = Value(moved[0], "m")
        details["largest_displacement"] = {"segment": moved[1], "at": moved[2]}
    if prescribed:
        r = look.unbalanced(q, u, lam)[0]
        units = {"rad": "N m", "m": "N"}
        for i in prescribed:
            name, unit = look.robot.coordinates[i], look.robot.coordinate_units[i]
            values[f"holding.{name}"] = Value(float(r[i]), units.get(unit, "conjugate"))
    if look.question.discretisation and status.solved:
        details["discretisation"] = look.doubled(q, u, prescribed, stable.stable)
    along = look.cables(q, u)
    arrays = {**result.arrays, **{f"cable.{name}.s": s for name, (s, _) in along.items()},
              **{f"cable.{name}.tension": tension for name, (_, tension) in along.items()}}  # fmt: skip
    return replace(result, status=status, values=values, arrays=arrays, residuals=residuals, details=details)
