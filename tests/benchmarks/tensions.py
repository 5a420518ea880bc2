"""Speed of tension problems on an octopus arm of eight inextensible sections (24 coordinates) and three cables.

    python tests/benchmarks/tensions.py [posture|path|motion]      (default all; seconds of the processor, best of five)

Posture: two coordinates of the tip, random reachable goals (seed 2026), from rest and from a neighbour 2 % of the
length away. Path: 100 waypoints round a circle of 40 mm radius (x of the tip is left free), in order. Motion: 1 s in
200 samples, tensions by inverse dynamics, and the simulation under them.
"""

import sys
import time
from pathlib import Path
from statistics import median

import numpy as np
from ruamel.yaml import YAML

import socontrol as so

ROOT = Path(__file__).parents[2]
SEED, GOALS, NEAR = 2026, 20, 0.02
CIRCLE = {"center": [0.2, 0.0, 0.01], "radius": 0.04, "normal": [1, 0, 0], "start": [0, 1, 0], "count": 99}

SMALL = [[0.2, 0.01 * float(np.cos(x)), 0.02 + 0.01 * float(np.sin(x))] for x in np.linspace(0, np.pi / 2, 7)]


def robot():
    """The three-cable arm cut into eight equal sections."""
    mapping = YAML(typ="safe").load((ROOT / "configs/robots/octopus_arm_three_cables.yaml").read_text())
    mapping["segments"]["arm"]["sections"] = 8
    return mapping


def question(**keys):
    return so.problem({"type": "tensions", "robot": robot(), "discretisation": False, **keys})


def tip(target):
    return {"tip": {"type": "point", "on": "arm", "target": [None, *map(float, target)]}}


def timed(run, times=5):
    """Least processor time of `times` runs [s], and the last answer."""
    best = np.inf
    for _ in range(times):
        began = time.process_time()
        answer = run()
        best = min(best, time.process_time() - began)
    return best, answer


def posture():
    """Cold and neighbouring solves through one prepared solver, looks at the answer included and left out."""
    solver = question(goals=tip([0.0, 0.05])).prepare()
    assert solver.question.robot.n == 24
    rng, pose = np.random.default_rng(SEED), solver.look.functions.pose("arm", 1.0)
    solver.posture.exact, solver.rest  # noqa: B018  built once
    rows = []
    for _ in range(GOALS):
        q = solver.balance.solve(0.3 * rng.random(3), solver.rest["q"]).q
        y = np.array(pose(q))[1:3, 3]
        cold, (outcome, tries) = timed(lambda y=y: solver.find({"target.tip": y}))
        beside = y * (1 - NEAR * solver.question.robot.length / np.linalg.norm(y))
        near, (other, more) = timed(lambda b=beside, o=outcome: solver.find({"target.tip": b}, o.values, o))
        whole, result = timed(lambda y=y: solver.solve({"target.tip": y}), 1)
        assert outcome.status.solved and other.status.solved and result.status.solved, (outcome.status, other.status)
        rows.append((cold, near, whole, len(tries), len(more)))
    cold, near, whole, tries, more = zip(*rows, strict=True)
    print(f"posture, {GOALS} goals: cold {1e3 * median(cold):.1f} ms ({1e3 * max(cold):.1f} at most, attempts "
          f"{max(tries)}), neighbour {1e3 * median(near):.1f} ms ({1e3 * max(near):.1f}, {max(more)}); "
          f"cold with all looks at the answer {1e3 * median(whole):.1f} ms")  # fmt: skip


def path():
    """A circle in order."""
    solver = question(goals={"tip": {"type": "path", "on": "arm", "axes": ["y", "z"], "target": CIRCLE}}).prepare()
    solver.posture.exact, solver.rest  # noqa: B018
    seconds, result = timed(solver.solve, 3)
    result.require()
    print(f"path, {len(result.arrays['path.q'])} waypoints in order: {seconds:.2f} s with a look at every waypoint")


def motion():
    """One second in 200 samples: a bend given in time, and a quarter of a circle; then the simulation under it."""
    swing = {name: {"type": "sinusoid", "amplitude": 2.0 * (k + 1), "period": 2.0, "mean": 0.0}
             for k, name in enumerate(f"arm.{i}.bend_z" for i in range(8))}  # fmt: skip
    goal = {"tip": {"type": "path", "on": "arm", "axes": ["y", "z"], "target": SMALL}}
    for what, asked in (
        ("given coordinates", question(motion={"every": 0.005, "duration": 1.0, "coordinates": swing})),
        ("a path", question(goals=goal, timing={"duration": 1.0}, motion={"every": 0.005})),
    ):
        result = asked.solve()
        clock = result.solver
        print(f"motion of {what}, 1 s in {len(result.arrays['t'])} samples: tensions {clock['tensions_seconds']:.2f} s "
              f"({clock['iterations']} passes), simulation {clock['simulation_seconds']:.2f} s, all with making the "
              f"Functions {clock['seconds']:.1f} s. {result.status.message}")  # fmt: skip


if __name__ == "__main__":
    for name in sys.argv[1:] or ("posture", "path", "motion"):
        {"posture": posture, "path": path, "motion": motion}[name]()
