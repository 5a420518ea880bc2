"""One simulated second of the reference rod: CPU time and error by integrator and tolerance.

    python tests/benchmarks/simulate.py [SECTIONS]

The rod (reference_rod.py) starts horizontal and straight and falls. Errors are the largest distance of its tip, at 20
times, from a run with a tolerance of 1e-9 of the same robot, in metres (its length is 1 m). CPU time is that of the
march alone, without building Functions, the smallest of several rounds; `calibration` as in dynamics_scaling.py.
"""

import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # CPU time of one core; the matrices are small

import numpy as np
from dynamics_scaling import calibration
from reference_rod import robot

from socontrol.programs.motions.charts import Charts
from socontrol.programs.motions.cvodes import CvodesMarch
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.integrators import Cvodes, Gauss, Marcher, Radau
from socontrol.programs.motions.plant import Plant

TIMES = np.linspace(0.0, 1.0, 21)
PROTOTYPE = "the prototype's implicit steps of 10 ms: 0.070 s with 2.7e-3 at 4 sections"
SETTINGS = (
    *(Radau(tolerance=tolerance) for tolerance in (1e-1, 3e-2, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)),
    *(Gauss(step=step, stages=stages) for step, stages in ((0.01, 1), (0.01, 2), (0.005, 3))),
    *(Cvodes(tolerance=tolerance) for tolerance in (1e-4, 1e-6, 1e-8)),
)


def march(plant, settings):
    """(March, CPU seconds) of one run."""
    rest, began = np.zeros(plant.n), time.process_time()
    if isinstance(settings, Cvodes):
        done = CvodesMarch(plant, settings, TIMES, Charts(plant.robot)).run(rest, rest)
    else:
        weights = displacement_weights(plant.robot)
        began = time.process_time()
        done = Marcher(plant, settings, TIMES, weights, plant.robot.length).run(rest, rest)
    return done, time.process_time() - began


def main(sections=4, rounds=5):
    plant = Plant(robot(sections), [], {}, {})
    tip = plant.functions.pose("rod", 1.0).function

    def track(done):
        return np.array([np.array(tip(q))[:3, 3] for q in done.q])

    reference = track(march(plant, Radau(tolerance=1e-9))[0])
    print(f"{sections} sections, {plant.n} coordinates; {PROTOTYPE}")
    print(f"{'integrator':36s}{'steps':>7s}{'CPU s':>9s}{'error m':>11s}{'ns/instruction':>16s}")
    for settings in SETTINGS:
        runs = [march(plant, settings) for _ in range(1 if isinstance(settings, Cvodes) else rounds)]
        done, seconds = runs[0][0], min(seconds for _, seconds in runs)
        name = f"{type(settings).__name__.lower()} {getattr(settings, 'step', '')} tolerance {settings.tolerance:g}"
        error = np.max(np.linalg.norm(track(done) - reference, axis=1)) if done.status.solved else np.nan
        print(f"{name:36s}{done.steps:7d}{seconds:9.3f}{error:11.1e}{calibration():16.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
