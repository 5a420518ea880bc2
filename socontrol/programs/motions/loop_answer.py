"""What a motion says of its loops: multipliers, the wrench each bears, and how far they drifted open, recomputed."""

from dataclasses import replace

import casadi as ca
import numpy as np

from socontrol.mechanics.loops import slices
from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.dead_points import dead_point
from socontrol.programs.looks.answer import LOOP_TOLERANCE
from socontrol.programs.looks.check import Checker
from socontrol.programs.result import Status, Value

LOOKED_AT = 200  # outputs at which loops are looked at with poses of another path


def with_loops(result, plant, march, begun):
    """The result of a motion with what it has to say of loops.

    arrays: lam [t x k] and, by loop, the wrench [t x 6] on a by b in b's joint frame; residuals: loops (largest |e|, by
    another path at some outputs) and loops.rate (largest |A qd|); details: redundant_rows, start (how far coordinates
    were moved to close the loops), singular (times at which rows that else are independent came to depend).
    """
    robot, arrays = plant.robot, result.arrays
    if not robot.loops or "q" not in arrays:
        return result
    lam = np.array(march.lam)
    wrenches = {f"loops.{name}": lam[:, own] @ np.array(ca.DM(robot.loops[name].Phi_perp())).T
                for name, own in slices(robot.loops).items()}  # fmt: skip
    values = {name: Value(wrench[-1].tolist(), "N m, N") for name, wrench in wrenches.items()}
    open_by, rate = _drift(robot, arrays)
    residuals = {"loops": Value(open_by, "m, rad"), "loops.rate": Value(rate, "m/s, rad/s")}
    status = replace(result.status, message=f"{result.status.message}{begun.sentence}")
    if status.solved and not open_by <= LOOP_TOLERANCE:
        status = Status("rejected", f"A recomputed loop is {open_by:.2g} m or rad open; use more Gauss points.")
    if result.status.outcome == "rejected" and (dead := _dead_at_start(plant, begun)):
        fix = "where it may go on in several ways: begin away from it"
        status = Status("rejected", f"{status.message} At the start, {dead[0].lower()}{dead[1:]}, {fix}.")
    details = {"redundant_rows": begun.redundant, "start": begun.moved, "singular": plant.ties.singular}
    return replace(result, status=status, values={**result.values, **values},
                   residuals={**result.residuals, **residuals}, details={**result.details, **details},
                   arrays={**arrays, "lam": lam, **wrenches})  # fmt: skip


def _dead_at_start(plant, begun):
    """Which loops begin at a dead point, in words, None where none does."""
    free = ~np.isin(np.arange(plant.robot.n), plant.driven)
    dead = dead_point(begun.balance, begun.q, free) if begun.balance else None
    return dead.sentence if dead else None


def _drift(robot, arrays):
    """Largest |e|, recomputed by another path at some outputs and by the model's own at all, and largest |A qd|."""
    checker, rows = Checker(robot), buffered(robot.functions().loop_motion)
    some = np.unique(np.linspace(0, len(arrays["q"]) - 1, LOOKED_AT).astype(int))
    open_by, rate = max(float(np.max(np.abs(checker.loop_error(arrays["q"][k])))) for k in some), 0.0
    for q, qd in zip(arrays["q"], arrays["qd"], strict=True):
        e, A, _ = rows(q, qd)
        open_by, rate = max(open_by, float(np.max(np.abs(e)))), max(rate, float(np.max(np.abs(A.T @ qd))))
    return open_by, rate
