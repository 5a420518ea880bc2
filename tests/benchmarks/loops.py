"""Robots with loops: how many of 300 random ones come to rest from an open guess; how 50 impossible ones are refused.

    python tests/benchmarks/loops.py [COUNT]
"""

import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from chains import impossible_chain, random_chain

from socontrol.mechanics.robot import Robot
from socontrol.programs.equilibria.closed_balance import ClosedBalance


def rests(seed):
    """(outcome, kinds of its loops, loop error, seconds, iterations) of one random robot."""
    robot = Robot(random_chain(seed))
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


def main(count=300):
    outcomes, errors, times = Counter(), [], []
    for seed in range(count):
        outcome, kinds, error, seconds, iterations = rests(seed)
        outcomes[outcome] += 1
        times.append(seconds)
        if outcome == "solved":
            errors.append(error)
        else:
            print(f"seed {seed}: {outcome}, {kinds}, {iterations} iterations, {seconds:.2f} s")
    print(f"{outcomes['solved']} of {count} at rest; largest loop error {max(errors):.1e};"
          f" median {1e3 * np.median(times):.0f} ms, longest {max(times):.2f} s")  # fmt: skip
    right = 0
    for seed in range(50):
        status, gap = refusal(seed)
        right += status.message.startswith(f"Loop 'far' cannot close: at the nearest found its ends stay {gap:.4g} mm")
    print(f"{right} of 50 impossible ones refused, loop and gap named")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
