"""Trajectory planning: what it costs beside CasADi written by hand and beside other tools, and how it grows.

    python tests/benchmarks/trajectories.py cartpole       (beside hand-written CasADi, rockit and do-mpc)
    python tests/benchmarks/trajectories.py rod            (the reference rod, in the virtual machine and compiled)
    python tests/benchmarks/trajectories.py build          (time to build against the number of intervals)
    python tests/benchmarks/trajectories.py problems       (every shipped problem of this type)
    python tests/benchmarks/trajectories.py doubled        (each of them again with twice the intervals)

Times are CPU times of this process, which a busy machine disturbs less than it does the clock on the wall. The other
tools are optional: pip install -e '.[peers]'. In parentheses: the goals of this project.
"""

import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np
import reference_rod
from cartpole import POINTS, SWING, WAY, by_do_mpc, by_hand, by_rockit, spent
from dynamics_scaling import calibration

import socontrol as so
from socontrol.files.loader import read_yaml
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.nlp.solver import NLP, Ipopt
from socontrol.programs.plans.plan_costs import Effort
from socontrol.programs.plans.plan_guess import PlanGuess
from socontrol.programs.plans.planner import Planner
from socontrol.programs.plans.schemes import scheme
from socontrol.programs.plans.trajectory import End, Mesh, Replay, Start, Trajectory
from socontrol.programs.plans.transcription import Span, System, Transcription

ROOT = Path(__file__).parents[2]
INTERVALS = 200
MESHES = (20, 40, 80, 160, 320)
ROUNDS = 3  # of all rows in turn; the quickest of each counts, for other work on the machine only adds
SECONDS = {"vm": 2.0, "compiled": 0.6}
LONGEST = 60.0  # s of a shipped problem


# Cart-pole swing-up, 200 intervals, 3 Radau points


def question(intervals):
    return Trajectory(
        robot=so.load_robot(ROOT / "configs/robots/cartpole.yaml"), duration=SWING,
        mesh=Mesh(intervals=intervals, points=POINTS, inputs="points"), costs={"effort": Effort()},
        start=Start(coordinates={"cart": 0.0, "pole": 0.0}), end=End(coordinates={"cart": WAY, "pole": np.pi}),
        replay=Replay(active=False),
    )  # fmt: skip


def line(x):
    """q [K x 2] straight from start to end at shares of the duration."""
    return np.outer(x, [WAY, np.pi])


def zeros(n):
    return lambda x: np.zeros((np.size(x), n))


def ours(asked):
    """(build s, solve s, cost, iterations) of the planner and its solver."""
    rest = np.zeros(2), np.zeros(2), np.full(1, np.nan)
    planner, first = spent(lambda: Planner(asked, rest))
    nlp, second = spent(lambda: NLP(planner.program, asked.solver))
    start = planner.transcription.filled(line, zeros(2), zeros(2), zeros(1), SWING)
    outcome, solve = spent(lambda: nlp.solve(start))
    assert outcome.status.solved, outcome.status
    return first + second, solve, outcome.cost, outcome.iterations


def swing():
    """Build and solve, beside the same program by hand (at most 1.2 times), rockit (20 times) and do-mpc (10 times)."""
    asked = question(INTERVALS)
    transcription = Planner(asked, (np.zeros(2), np.zeros(2), np.full(1, np.nan))).transcription
    sizes = {**transcription.scales, "force": transcription.system.force}
    plain = {"q": np.ones(2), "v": np.ones(2), "a": np.ones(2), "u": np.ones(1), "force": np.ones(2)}
    rows = {"socontrol": lambda: ours(asked),
            "by hand": lambda: by_hand(INTERVALS, sizes, asked.solver),
            "by hand, unscaled": lambda: by_hand(INTERVALS, plain, asked.solver)}  # fmt: skip
    for name, module, run in (("rockit", "rockit", by_rockit), ("do-mpc", "do_mpc", by_do_mpc)):
        if find_spec(module):
            rows[name] = lambda run=run: run(INTERVALS)
        else:
            print(f"{name} is not installed, its row is left out: pip install -e '.[peers]'")
    found = {name: [] for name in rows}
    for k in range(ROUNDS):
        for name, run in rows.items():
            if not k or name in list(rows)[:3]:  # the others take long, and are far off
                found[name].append(run())
    print(f"cart-pole swing-up, {INTERVALS} intervals, {POINTS} Radau points")
    print(f"{'':20s}{'build s':>9s}{'solve s':>9s}{'iterations':>12s}{'ms each':>9s}{'cost':>12s}{'times ours':>12s}")
    own = None
    for name, runs in found.items():
        build, solve, cost, count = min(runs, key=lambda row: row[0] + row[1])
        own = own or build + solve
        print(f"{name:20s}{build:9.3f}{solve:9.3f}{count:12d}{solve / count * 1e3:9.2f}{cost:12.8f}"
              f"{(build + solve) / own:12.2f}")  # fmt: skip
    mine, other = (found[name][0][2] for name in list(found)[:2])
    if abs(mine / other - 1) > 1e-6:
        print("BY HAND IT IS ANOTHER PROBLEM: the costs differ")
        return 1


# The reference rod, every strain driven, from rest to a curvature of 1 in 1 s


def rod_problem(sections, intervals, target):
    """Transcription of three strains a section, bent and twisted within half a turn a section, and a start. Inputs are
    over what holds the rod out straight: 20 times what bends a section by a radian."""
    robot = reference_rod.robot(sections, "inextensible_kirchhoff_love")
    own, forces, zero = scales(robot), robot.functions().inverse_dynamics.function, np.zeros(robot.n)
    held = np.maximum(own.force, np.max(np.abs(np.array(forces(zero, zero, zero)))))
    system = System(lambda q, v, a, u: forces(q, v, a) - u, own.q, held, own.force)
    t = Transcription(system, scheme("radau", POINTS), np.full(intervals, 1 / intervals), Span.fixed(1.0), tempo=1 / 6)
    goal = np.tile(target, sections)
    t.everywhere("q", np.full(robot.n, -np.pi * sections), np.full(robot.n, np.pi * sections))
    for k, place in ((0, zero), (-1, goal)):
        t.hold("q", t.node["q"][k], place, place)
        t.hold("v", t.node["v"][k], zero, zero)

    def effort(q, v, a, u, T, data):
        return {"squares": ca.sqrt(T * data[-1]) * u / ca.DM(held)}

    t.at_points("effort", effort, weights=True)
    return t, t.filled(lambda x: np.outer(x, goal), *(zeros(robot.n),) * 3, 1.0)


def rod():
    """20 intervals: at most 2 s in the virtual machine (VM), 0.6 s compiled, for one section."""
    print(f"reference rod, twist and two bends a section, {MESHES[0]} intervals, {POINTS} Radau points")
    print(f"{'':38s}{'build s':>9s}{'solve s':>9s}{'goal s':>8s}{'iterations':>12s}{'ms each':>9s}{'cost':>12s}")
    for sections, target, what in ((1, (0, 1, 0), "one bend of 1/m"), (1, (1, 1, 1), "all of 1/m"),
                                   (2, (1, 1, 1), "all of 1/m")):  # fmt: skip
        for kind in ("vm", "compiled"):
            settings = Ipopt(tolerance=1e-8, max_iterations=500)
            (t, start), first = spent(lambda s=sections, x=target: rod_problem(s, MESHES[0], x))
            nlp, second = spent(lambda t=t, kind=kind, s=settings: NLP(t.program, s, kind == "compiled"))
            outcome, seconds = spent(lambda nlp=nlp, start=start: nlp.solve(start))
            goal = f"{SECONDS[kind]:.1f}" if sections == 1 else "-"
            print(f"{f'{sections} sections, to {what}, {kind}':38s}{first + second:9.2f}{seconds:9.2f}{goal:>8s}"
                  f"{outcome.iterations:12d}{seconds / max(1, outcome.iterations) * 1e3:9.1f}{outcome.cost:12.6f}"
                  f"{'' if outcome.status.solved else '  ' + outcome.status.message}")  # fmt: skip
    print("build: of the compiled rows without the compiler's time, which is another process; C is kept between runs")


# Time to build against the number of intervals


def build():
    """CPU s to build (exponent 1 or less: linear in the intervals)."""
    asked = {n: question(n) for n in MESHES}
    rest = np.zeros(2), np.zeros(2), np.full(1, np.nan)
    rows = {"cart-pole": lambda n: NLP(Planner(asked[n], rest).program, asked[n].solver),
            "reference rod": lambda n: NLP(rod_problem(1, n, (0, 1, 0))[0].program, Ipopt())}  # fmt: skip
    print(f"{'':16s}" + "".join(f"{f'N = {n}':>10s}" for n in MESHES) + f"{'exponent':>10s}{'s + ms an interval':>22s}")
    for name, run in rows.items():
        run(MESHES[0])
        times = [min(spent(lambda n=n, run=run: run(n))[1] for _ in range(ROUNDS)) for n in MESHES]
        exponent = np.polyfit(np.log(MESHES), np.log(times), 1)[0]
        each, once = np.polyfit(MESHES, times, 1)
        row = "".join(f"{x:10.3f}" for x in times)
        print(f"{name:16s}{row}{exponent:10.2f}{once:12.3f} + {each * 1e3:5.2f}")


# Shipped problems


def problems():
    """CPU s of each, its own checks included (at most 60 s)."""
    late = 0
    for path in sorted((ROOT / "problems").glob("*.yaml")):
        if read_yaml(path).data.get("type") == "trajectory":
            began, result = time.perf_counter(), None
            result, seconds = spent(lambda path=path: so.solve(so.load_problem(path)))
            late += seconds > LONGEST
            print(f"{path.stem:40s}{seconds:8.1f} s{time.perf_counter() - began:8.1f} s on the wall  "
                  f"{result.status.outcome}, {result.solver.get('iterations', 0)} iterations")  # fmt: skip
    print(f"{late} of them take longer than {LONGEST:.0f} s")
    return late


def same(result):
    """Guess of a plan's own motion, to stay with its local optimum."""
    robot, arrays = result.question.robot, result.arrays
    q, u = (dict(zip(names, map(tuple, arrays[key].T.tolist()), strict=True))
            for key, names in (("q", robot.coordinates), ("u", robot.inputs)))  # fmt: skip
    return PlanGuess(times=tuple(arrays["t"].tolist()), coordinates=q, inputs=u)


def doubled():
    """How far twice the intervals change the cost of every shipped plan, beside what half of them did (at most it)."""
    beyond = 0
    for path in sorted((ROOT / "problems").glob("*.yaml")):
        if read_yaml(path).data.get("type") == "trajectory":
            asked = so.load_problem(path)
            mesh = replace(asked.mesh, intervals=2 * asked.mesh.intervals, halved=False)
            said = so.solve(asked)
            finer = so.solve(replace(asked, mesh=mesh, replay=Replay(active=False), guess=same(said)))
            change, told = abs(finer["cost"] - said["cost"]), said["mesh.cost_change"]
            beyond += not change <= told
            print(f"{path.stem:40s}cost {said['cost']:.6g}, told {told:.2g}, changed {change:.2g}  "
                  f"re-simulated tip {100 * said['replay.tip_share']:.2g} % of the length")  # fmt: skip
    return beyond


WHAT = {"doubled": doubled, "cartpole": swing, "rod": rod, "build": build, "problems": problems}


def main(what="cartpole"):
    if what not in WHAT:
        print(f"'{what}' is none of: {', '.join(WHAT)}", file=sys.stderr)
        return 2
    print(f"calibration: {calibration():.2f} ns an instruction in CasADi's virtual machine")
    return int(bool(WHAT[what]()))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
