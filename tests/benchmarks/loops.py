"""Robots with loops: how fast a fin-ray finger comes to rest, beside a tree of as many coordinates; how many of 300
random ones of two sorts come to rest from an open guess; how 50 impossible ones are refused.

    python tests/benchmarks/loops.py [COUNT]
"""

import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from chains import impossible_chain, random_chain, wide_chain

import socontrol as so
from socontrol.mechanics.robot import Robot
from socontrol.programs.equilibria.balance import Balance
from socontrol.programs.equilibria.closed_balance import ClosedBalance

PROBLEM = Path(__file__).parents[2] / "problems" / "finray_press.yaml"
PUSH = ["loads.object.force"]
REPEATED = 40  # solves of each sort


def tree_alike(robot):
    """The same robot without its loops, the struts held by springs."""
    segments = {name: replace(s, stiffness=0.01) if name.startswith("strut") else s
                for name, s in robot.description.segments.items()}  # fmt: skip
    return Robot(replace(robot.description, segments=segments, loops=None))


def speed():
    """Prints ms of cold and warm statics with and without loops, the two by turns."""
    robot = so.load_problem(PROBLEM).loaded
    pair = [kind(one, PUSH) for kind, one in ((ClosedBalance, robot), (Balance, tree_alike(robot)))]
    rests = [balance.solve(np.zeros(0)).q for balance in pair]
    for name, warm, load in (("cold", False, 1.0), ("from the answer", True, 1.0), ("after 3 % more load", True, 1.03)):
        times = np.zeros((REPEATED, 2))
        for row in times:
            for k, (balance, rest) in enumerate(zip(pair, rests, strict=True)):
                began = time.process_time()
                answer = balance.solve(np.zeros(0), rest if warm else None, load * balance.defaults)
                row[k] = time.process_time() - began
                assert answer.status.solved
        loops, tree = 1e3 * np.median(times, axis=0)
        print(f"{name}: {loops:.2f} ms with loops, {tree:.2f} ms without, ratio {loops / tree:.1f};"
              f" {robot.n} coordinates each")  # fmt: skip


def rests(chain, seed):
    """(outcome, kinds of its loops, loop error, seconds, iterations) of one random robot."""
    robot = Robot(chain(seed))
    balance = ClosedBalance(robot)
    began = time.perf_counter()
    answer = balance.solve(np.zeros(robot.m))
    seconds = time.perf_counter() - began
    error = float(np.max(np.abs(balance.closing(answer.q)[0])))
    kinds = "+".join(type(loop).__name__ for loop in robot.loops.values())
    return answer.status.outcome, kinds, error, seconds, answer.iterations


def refusal(seed):
    """(sentence, gap in mm) of one impossible robot."""
    description, gap = impossible_chain(seed)
    robot = Robot(description)
    return ClosedBalance(robot).solve(np.zeros(robot.m)).status, 1e3 * gap


def count_rests(chain, count):
    """Prints how many of `count` random robots come to rest."""
    outcomes, errors, times = Counter(), [], []
    for seed in range(count):
        outcome, kinds, error, seconds, iterations = rests(chain, seed)
        outcomes[outcome] += 1
        times.append(seconds)
        if outcome == "solved":
            errors.append(error)
        else:
            print(f"seed {seed}: {outcome}, {kinds}, {iterations} iterations, {seconds:.2f} s")
    print(f"{chain.__name__}: {outcomes['solved']} of {count} at rest; largest loop error {max(errors):.1e};"
          f" median {1e3 * np.median(times):.0f} ms, longest {max(times):.2f} s")  # fmt: skip


def main(count=300):
    speed()
    for chain in (random_chain, wide_chain):
        count_rests(chain, count)
    right = 0
    for seed in range(50):
        status, gap = refusal(seed)
        right += status.message.startswith(f"Loop 'far' cannot close: at the nearest found its ends stay {gap:.4g} mm")
    print(f"{right} of 50 impossible ones refused, loop and gap named")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
