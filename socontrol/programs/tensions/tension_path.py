"""A path of postures with limits on the rates of inputs and cable lengths, in order or in one program."""

from dataclasses import replace

import numpy as np

from socontrol.programs.postures.paths import gathered
from socontrol.programs.result import Status
from socontrol.programs.tensions.pace import Pace
from socontrol.programs.tensions.path_directions import directed
from socontrol.programs.tensions.path_in_order import KEPT, in_order
from socontrol.programs.tensions.path_together import together


def followed(solver, progress=None):
    """Result of a path: the arrays of `paths.gathered`, path.lengths, path.t where it has a timing, and rates."""
    pace = Pace(solver.question, solver.path[1], solver.look.functions)
    solver, directions = directed(solver)
    done = (together if solver.question.together else in_order)(solver, pace, directions, progress)
    if directions is None:
        return paced(gathered(solver, done), pace)
    result = paced(gathered(solver, done, lambda parameters: directions.look(solver.balance, parameters)), pace)
    return rubbed(result, directions, directions.table(done.rows))


def rubbed(result, directions, table):
    """The result with path.moving [K x m], `details["directions"]` {cable: waypoints to which its direction changes}
    and `details["undecided"]` {cable: waypoints}."""
    turns = {directions.question.robot.inputs[i]: (np.flatnonzero(np.diff(table[:, i])) + 2).tolist()
             for i in directions.paths}  # fmt: skip
    undecided = directions.undecided(table, result.arrays["path.lengths"])
    details = {**result.details, "directions": turns, "undecided": undecided}
    return replace(result, arrays={**result.arrays, "path.moving": table}, details=details)


def paced(result, pace):
    """The result with lengths, times and rates; rejected where a limit on rates is not kept."""
    q, u = result.arrays["path.q"], result.arrays["path.u"]
    lengths, status = pace.lengths(q), result.status
    arrays = {**result.arrays, "path.lengths": lengths} | ({} if pace.t is None else {"path.t": pace.t})
    if status.solved and pace.rates:
        strain = pace.strain(u, lengths)
        if np.max(strain, initial=0.0) > 1 + 2 * KEPT:
            status = Status("rejected", f"Too fast: {pace.binding(u, lengths, np.max(strain))}.")
        else:
            status = Status("solved", status.message + pace.fastest(u, lengths))
    return replace(result, status=status, arrays=arrays, values={**result.values, **pace.values(u, lengths)})
