"""The exported inverse-statics solver of the two-module robot against Ipopt: the table, by one command.

    python tests/benchmarks/exported_solver.py [REACHABLE] [UNREACHABLE] [FOLDER]    (default 500 200, temporary)

Reachable goals stand in tests/reference/two_module_goals.csv (seed 2026). Unreachable: beyond the workspace's
support, see reach.py. Warm: tips of equilibria along straight ways between random pressures, in twenty steps each.
Times are those of the whole call through ctypes, compiled with the flags printed.
"""

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import reach

import socontrol as so
from socontrol.codegen import loaded
from socontrol.native import compiler

STEPS = 20
SEED = 7


def timed(solver, **how):
    """(answer, microseconds) of a solve."""
    began = time.perf_counter()
    answer = solver.solve(**how)
    return answer, (time.perf_counter() - began) * 1e6


def told(name, rows, extra=""):
    """One line of the table: statuses, iterations, times."""
    statuses = ", ".join(f"{count} {status}" for status, count in Counter(a.status for a, _ in rows).items())
    steps, times = [a.iterations for a, _ in rows], [t for _, t in rows]
    print(
        f"{name:<13}{statuses}; iterations median {np.median(steps):.0f}, at most {max(steps)};"
        f" time median {np.median(times):.0f} us, fastest {min(times):.0f} us{extra}"
    )


def reachable(solver, python, goals):
    """Cold solves against Ipopt's; returns the number of those that are not the same answer."""
    span, rows, apart = python.balance.scales.u, [], []
    for goal in goals:
        answer, took = timed(solver, cold=True, target_tip=goal)
        outcome, _ = python.find({"target.tip": goal})
        rows.append((answer, took))
        apart.append(float(np.max(np.abs(answer.inputs - outcome.values["u"]) / span)))
    same = sum(a.solved and d <= 1e-7 for (a, _), d in zip(rows, apart, strict=True))
    told("reachable", rows, f"; as Ipopt's within 1e-7: {same} of {len(rows)}, worst {max(apart):.2g}")
    return len(rows) - same


def warm(solver, python, pose, ways=15):
    """Solves along paths, each from its neighbour; returns the number of failures."""
    rng, rows = np.random.default_rng(SEED), []
    lower, upper = python.question.input_limits()
    u = lower + (upper - lower) * rng.random(lower.size)
    q = python.rest["q"]
    for _ in range(ways):
        end = lower + (upper - lower) * rng.random(lower.size)
        for k in range(STEPS):
            v = u + (end - u) * (k + 1) / STEPS
            q = python.balance.solve(v, q).q
            rows.append(timed(solver, cold=not rows, target_tip=np.array(pose(q))[:3, 3]))
        u = end
    told("warm path", rows[1:])
    return sum(not a.solved for a, _ in rows)


def unreachable(solver, python, pose, count):
    """Goals out of reach; returns how many are called solved, or not infeasible."""
    support, rng, rows, excess = reach.Support(python), np.random.default_rng(reach.SEED + 1), [], []
    for _ in range(count):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        point, beyond = support.point(direction, rng, starts=3), python.question.robot.length * rng.uniform(0.02, 2.0)
        goal = point + beyond * direction
        answer, took = timed(solver, cold=True, target_tip=goal)
        rows.append((answer, took))
        excess.append(np.linalg.norm(np.array(pose(answer.coordinates))[:3, 3] - goal) / beyond - 1)
    told("unreachable", rows, f"; nearest posture farther than the support by at most {max(excess):.2g}")
    return sum(a.status != "INFEASIBLE" for a, _ in rows)


def main(arguments):
    counts = [int(a) for a in arguments if a.isdigit()]
    folder = next((Path(a) for a in arguments if not a.isdigit()), None)
    python, pose = reach.prepared()
    with tempfile.TemporaryDirectory() as scratch:
        where = folder or Path(scratch) / "two_modules"
        so.codegen(python.question, where)
        library = so.load_compiled(where)
        print(f"compiled with {' '.join([*compiler.command(), *loaded.FLAGS])}")
        with library.solver() as solver:
            goals = np.loadtxt(reach.GOALS, delimiter=",")[: counts[0] if counts else 500, 6:9]
            bad = reachable(solver, python, goals) > 0.01 * len(goals)
            bad += warm(solver, python, pose)
            return min(1, bad + unreachable(solver, python, pose, counts[1] if len(counts) > 1 else 200))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
