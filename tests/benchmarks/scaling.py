"""Time of inverse statics against the number of sections: table, fitted exponent and figure.

    python tests/benchmarks/scaling.py [FIGURE]        (default results/scaling.png)

Two modules with 1 to 16 sections each; cold solves of 20 stored goals' neighbours; medians.
"""

import sys
import time
from pathlib import Path

import numpy as np
import reach

from socontrol.mechanics.robot import Robot
from socontrol.model.rods import Rod
from socontrol.programs.postures.goals import Point
from socontrol.programs.postures.inverse_statics import InverseStatics

SECTIONS = (1, 2, 4, 8, 16)


def measured(sections, tips):
    """(build s, cold s, warm s, statics evaluation s) at `sections` a module."""
    base = reach.so.load_robot(reach.ROBOT)
    changes = {f"{n}.sections": sections for n, s in base.description.segments.items() if isinstance(s, Rod)}
    robot = Robot(base.with_values(changes).description)
    began = time.perf_counter()
    question = InverseStatics(robot=robot, goals={"tip": Point(on="cap", target=tuple(tips[0]))}, discretisation=False)
    solver = question.prepare()
    solver.posture.exact  # noqa: B018
    build, cold, warm = time.perf_counter() - began, [], []
    solver.find({})
    for tip in tips:
        began = time.perf_counter()
        outcome, _ = solver.find({"target.tip": tip})
        cold.append(time.perf_counter() - began)
        assert outcome.status.solved, outcome.status
        began = time.perf_counter()
        solver.find({"target.tip": tip + 5e-4}, warm=outcome)
        warm.append(time.perf_counter() - began)
    single = []
    for _ in range(200):
        began = time.perf_counter()
        solver.balance._run()
        single.append(time.perf_counter() - began)
    return build, np.median(cold), np.median(warm), np.median(single)


def main(path):
    solver, pose = reach.prepared()
    lower, upper = solver.question.input_limits()
    rng, tips = np.random.default_rng(3), []
    for _ in range(20):  # mid-range pressures: reachable at every number of sections
        u = lower + (upper - lower) * rng.uniform(0.2, 0.6, lower.size)
        tips.append(np.array(pose(solver.balance.solve(u, solver.rest["q"]).q))[:3, 3])
    rows = np.array([measured(n, tips) for n in SECTIONS])
    print("sections a module   build s   cold ms   warm ms   residual + Jacobian us")
    for n, (build, cold, warm, statics) in zip(SECTIONS, rows, strict=True):
        print(f"{n:17d} {build:9.2f} {cold * 1e3:9.1f} {warm * 1e3:9.1f} {statics * 1e6:12.0f}")
    x = np.log(SECTIONS)
    exponents = [np.polyfit(x[1:], np.log(rows[1:, k]), 1)[0] for k in range(4)]
    print(
        "fitted exponent from 2 on: "
        + ", ".join(
            f"{name} {e:.2f}"
            for name, e in zip(("build", "cold", "warm", "residual + Jacobian"), exponents, strict=True)
        )
    )
    _draw(rows, exponents, path)


def _draw(rows, exponents, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    names = ("build", "cold solve", "warm solve", "residual + Jacobian")
    for name, marker, column, e in zip(names, "os^d", rows.T, exponents, strict=True):
        axes.loglog(SECTIONS, column * 1e3, marker=marker, label=f"{name} (exponent {e:.2f})")
    axes.set(xlabel="sections a module [1]", ylabel="time [ms]", xticks=SECTIONS, xticklabels=SECTIONS)
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=2)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    print(f"figure: {path}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "results/scaling.png")
