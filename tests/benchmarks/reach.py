"""Random reachable and unreachable tip goals of the two-module robot: the table, by one command.

    python tests/benchmarks/reach.py [REACHABLE] [UNREACHABLE]        (default 1000 200)

Reachable: tips of equilibria at pressures drawn uniformly over the whole range; each is solved from rest, never from
the drawn pressures. Unreachable: beyond the workspace's support in a random direction (the largest projection of the
tip, from ten starts), by 2 % to 200 % of the robot's length. The goals stand in tests/reference/two_module_goals.csv
(made by `--write`, seed 2026).
"""

import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np

import socontrol as so
from socontrol.lie import se3
from socontrol.programs.nlp.program import Program
from socontrol.programs.nlp.solver import NLP
from socontrol.programs.postures.goals import Point
from socontrol.programs.postures.inverse_statics import InverseStatics

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "configs/robots/stiff_flop_two_modules.yaml"
GOALS = ROOT / "tests/reference/two_module_goals.csv"
SEED = 2026


def prepared(robot=None):
    """The inverse-statics solver of the robot for tip goals, and the tip's pose Function."""
    robot = robot or so.load_robot(ROBOT)
    tip = robot.segments[-1]
    question = InverseStatics(
        robot=robot, goals={"tip": Point(on=tip, target=(0.0, 0.0, robot.length))}, discretisation=False
    )
    solver = question.prepare()
    return solver, solver.look.functions.pose(tip).function


def draw(solver, pose, count, rng):
    """(pressures, tips) of random equilibria."""
    lower, upper = solver.question.input_limits()
    rows = []
    while len(rows) < count:
        u = lower + (upper - lower) * rng.random(lower.size)
        answer = solver.balance.solve(u, solver.rest["q"])
        if answer.status.solved:
            rows.append(np.concatenate([u, np.array(pose(answer.q))[:3, 3]]))
    return np.array(rows)


class Support:
    """The largest projection of the tip on a direction, over inputs within limits and equilibria."""

    def __init__(self, solver):
        self.solver, posture = solver, solver.posture
        program = Program(ca.SX.sym)
        s, limits = solver.balance.scales, posture.limits()
        robot = posture.robot
        q = program.variable("q", robot.n, scale=s.q, lower=limits["q"][0], upper=limits["q"][1])
        u = program.variable("u", robot.m, scale=s.u, lower=limits["u"][0], upper=limits["u"][1])
        residual, tangent, actuation = solver.balance.function(q, u)
        program.constrain("equilibrium", residual, scale=s.force, tangent={"q": tangent, "u": -actuation})
        direction = program.parameter("direction", np.zeros(3))
        tip = se3.position(robot.functions().pose(robot.segments[-1]).function(q))
        program.minimize(-ca.dot(direction, tip) / robot.length)
        self.nlp, self.tip = NLP(program, solver.question.solver), robot.functions().pose(robot.segments[-1]).function

    def point(self, direction, rng, starts=10):
        """Support point [3] in a direction."""
        lower, upper = self.solver.question.input_limits()
        best = None
        for _ in range(starts):
            u = lower + (upper - lower) * rng.random(lower.size)
            q = self.solver.balance.solve(u, self.solver.rest["q"]).q
            outcome = self.nlp.solve(guess={"q": q, "u": u}, parameters={"direction": direction})
            if outcome.status.solved and (best is None or outcome.cost < best.cost):
                best = outcome
        return np.array(self.tip(best.values["q"]))[:3, 3]


def reachable(solver, pose, rows):
    """One line of the table for each property of the reachable goals; returns the number of failures."""
    m = solver.question.robot.m
    span = np.maximum(*np.abs(solver.question.input_limits()))
    failed, worse, residuals, misses, iterations, seconds, attempts = [], [], [], [], [], [], []
    for k, row in enumerate(rows):
        u, tip = row[:m], row[m:]
        began = time.perf_counter()
        outcome, tries = solver.find({"target.tip": tip})
        seconds.append(time.perf_counter() - began)
        iterations.append(sum(a.iterations for a in tries))
        attempts.append(len(tries))
        if not outcome.status.solved:
            failed.append(k)
            continue
        q, found = outcome.values["q"], outcome.values["u"]
        residuals.append(solver.look.residuals(q, found, solver.posture.free)["force"].value)
        misses.append(np.linalg.norm(np.array(pose(q))[:3, 3] - tip))
        if np.sum((found / span) ** 2) > np.sum((u / span) ** 2) * (1 + 1e-9):
            worse.append(k)
    print(f"reachable goals                {len(rows)}, solved {len(rows) - len(failed)} {failed or ''}")
    print(f"recomputed force residual      at most {max(residuals):.2g} of the largest force")
    print(f"position error                 at most {max(misses):.2g} m")
    print(f"effort above the drawn one     {len(worse)} {worse or ''}")
    print(f"iterations                     median {np.median(iterations):.0f}, at most {max(iterations)}")
    print(f"attempts                       more than one: {sum(a > 1 for a in attempts)}")
    print(
        f"time                           median {np.median(seconds) * 1e3:.1f} ms, at most {max(seconds) * 1e3:.1f} ms"
    )
    return len(failed) + len(worse) + (max(residuals) > 1e-8) + (max(misses) > 1e-7)


def unreachable(solver, count, rng):
    """Goals beyond the support: all must be refused, with a nearest posture no farther than the support point."""
    support, length = Support(solver), solver.question.robot.length
    solved, farther, seconds, gaps = [], [], [], []
    for k in range(count):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        point = support.point(direction, rng)
        beyond = length * rng.uniform(0.02, 2.0)
        began = time.perf_counter()
        outcome, _ = solver.find({"target.tip": point + beyond * direction})
        seconds.append(time.perf_counter() - began)
        if outcome.status.exit_code != 4:
            solved.append((k, outcome.status.outcome))
            continue
        tip = np.array(support.tip(outcome.values["q"]))[:3, 3]
        gap = np.linalg.norm(tip - point - beyond * direction)
        gaps.append(gap / beyond - 1)
        if gap > beyond * (1 + 1e-6):
            farther.append((k, round(float(gap / beyond - 1), 6)))
    print(f"unreachable goals              {count}, refused with exit 4: {count - len(solved)} {solved or ''}")
    print(
        f"nearest farther than support   {len(farther)} {farther or ''}; worst excess {max(gaps):.2g} of the distance"
    )
    print(
        f"time                           median {np.median(seconds) * 1e3:.0f} ms, at most {max(seconds) * 1e3:.0f} ms"
    )
    return len(solved) + len(farther)


def main(arguments):
    counts = [int(a) for a in arguments if a.isdigit()]
    solver, pose = prepared()
    if "--write" in arguments:
        rows = draw(solver, pose, 1000, np.random.default_rng(SEED))
        header = f"seed {SEED}: {', '.join(solver.question.robot.inputs)} [Pa], x, y, z of the tip [m]"
        np.savetxt(GOALS, rows, delimiter=",", fmt="%.9g", header=header)
        return 0
    rows = np.loadtxt(GOALS, delimiter=",")[: counts[0] if counts else 1000]
    print(f"{ROBOT.stem}: {solver.question.robot.n} coordinates, {solver.question.robot.m} inputs")
    bad = reachable(solver, pose, rows)
    return min(1, bad + unreachable(solver, counts[1] if len(counts) > 1 else 200, np.random.default_rng(SEED + 1)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
