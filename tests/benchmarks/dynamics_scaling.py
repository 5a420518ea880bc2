"""Size and time of inverse and forward dynamics against the number of sections: table, exponents and figure.

    python tests/benchmarks/dynamics_scaling.py [FIGURE]        (default problems/gallery/dynamics_scaling.png)

The reference rod with 2 to 32 sections, six strains each. Size: instructions of the SX Function. Build: from a robot's
description to the Function, with the one kernel that all sections share made before. Evaluation: one call in CasADi's
virtual machine through `Function.buffer()`. Exponents are slopes of log against log by least squares. Times are CPU
times of this process, which a busy machine disturbs less than it does the clock on the wall.
"""

import sys
import time
from functools import cache
from pathlib import Path

import casadi as ca
import matplotlib as mpl
import numpy as np
import reference_rod
from matplotlib.ticker import NullLocator

from socontrol.mechanics.robot import Robot
from socontrol.report import style
from socontrol.report.plots import save

FIGURE = Path(__file__).parents[2] / "problems/gallery/dynamics_scaling.png"
SECTIONS = (2, 4, 8, 16, 32)
NAMES = ("inverse_dynamics", "forward_dynamics")
BUILDS, ROUNDS = 3, 7  # of all sizes and functions in turn: a spell of foreign load then spoils one round, not one row
# What the prototype (tests/benchmarks/reference_rod.py) needed, by number of sections.
PROTOTYPE_INSTRUCTIONS = {"inverse_dynamics": {1: 4300, 2: 9500, 4: 20_000, 8: 41_000, 16: 83_000}}
PROTOTYPE_US = {
    "inverse_dynamics": {1: 11, 2: 38, 4: 72, 8: 123, 16: 213},
    "forward_dynamics": {1: 35, 2: 87, 4: 179, 8: 289, 16: 597},
    "mass": {1: 12, 2: 44, 4: 107, 8: 214, 16: 659},
}
PROTOTYPE_NS = (2.5, 4.0)  # ns an instruction of `calibration` on the days these were measured


def clocked(run, least=2e-3):
    """CPU seconds of one `run()`, over as many as take `least` seconds."""
    count = 1
    while True:
        began = time.process_time()
        for _ in range(count):
            run()
        spent = time.process_time() - began
        if spent >= least:
            return spent / count
        count *= 2 if spent <= 0 else max(2, int(1.2 * least / spent))


@cache  # takes seconds to build
def calibration_run():
    """A call of 1e5 SX multiply-adds, each of which waits for the one before."""
    x = ca.SX.sym("x")
    y = x
    for _ in range(50_000):
        y = y * x + x
    return buffered(ca.Function("f", [x], [y]), [np.array([0.5])])[0]


def calibration():
    """Nanoseconds an SX multiply-add takes in the VM today."""
    return clocked(calibration_run()) / 1e5 * 1e9


def state(robot, seed=0):
    """q, qd and qdd [n each]: bent by about a third of a radian a metre, rates and accelerations of 0.3."""
    rng = np.random.default_rng(seed)
    return [rng.normal(size=robot.n) * 0.3 for _ in range(3)]


def arguments(robot, name, motion=None):
    """What the robot's Function `name` is called with, as arrays."""
    q, qd, qdd = motion or state(robot)
    return {"inverse_dynamics": [q, qd, qdd], "forward_dynamics": [q, qd, np.zeros(robot.m)], "mass": [q]}[name]


def buffered(function, values):
    """(run, result): `run()` calls a Function of one output at `values` without copies or checks."""
    keep, run = function.buffer()
    values = [np.ascontiguousarray(v, dtype=float) for v in values]
    result = np.zeros(function.size_out(0)[::-1]).T  # CasADi writes columns
    for index, value in enumerate(values):
        keep.set_arg(index, memoryview(value))
    keep.set_res(0, memoryview(result.T))
    run()

    def call(run=run, memory=(keep, values, result)):  # CasADi holds pointers only: kept alive here
        run()

    return call, result


def built(robot, name):
    """The robot's Function `name`, and CPU seconds to build it: median of BUILDS."""
    spent = []
    for _ in range(BUILDS):
        began = time.process_time()
        function = getattr(Robot(robot.description).functions(), name).function
        spent.append(time.process_time() - began)
    return function, float(np.median(spent))


def measured():
    """{name: array of rows (instructions, build s, evaluation s)} by SECTIONS, and ns an instruction."""
    sizes, build, runs = {}, {}, {}
    for n in SECTIONS:
        for name in NAMES:
            robot = reference_rod.robot(n)
            function, build[name, n] = built(robot, name)
            sizes[name, n] = function.n_instructions()
            runs[name, n], result = buffered(function, arguments(robot, name))
            assert np.all(np.isfinite(result))
    rounds = {key: [] for key in runs}
    calibrations = []
    for _ in range(ROUNDS):
        calibrations.append(calibration())
        for key, run in runs.items():
            rounds[key].append(clocked(run))
    rows = {
        name: np.array([(sizes[name, n], build[name, n], np.median(rounds[name, n])) for n in SECTIONS])
        for name in NAMES
    }
    return rows, float(np.median(calibrations))


def exponents(rows):
    """Slope of log against log of each column."""
    x = np.log(SECTIONS)
    return [float(np.polyfit(x, np.log(column), 1)[0]) for column in rows.T]


def main(path=FIGURE):
    for name in NAMES:  # makes the kernel, which else the first row would pay for
        built(reference_rod.robot(2), name)
    rows, ns = measured()
    print(f"median of {ROUNDS} rounds, CPU time; calibration {ns:.2f} ns an instruction (prototype 2.5 to 4)")
    print(f"{'':18s}{'sections':>9s}{'instructions':>14s}{'build ms':>10s}{'evaluation us':>15s}{'ns each':>9s}")
    slopes = {}
    for name in NAMES:
        for n, (size, build, evaluation) in zip(SECTIONS, rows[name], strict=True):
            print(
                f"{name.replace('_', ' '):18s}{n:9d}{size:14.0f}{build * 1e3:10.0f}{evaluation * 1e6:15.1f}"
                f"{evaluation * 1e9 / size:9.2f}"
            )
        slopes[name] = exponents(rows[name])
        print(f"{'':18s}{'exponent':>9s}{slopes[name][0]:14.2f}{slopes[name][1]:10.2f}{slopes[name][2]:15.2f}")
    with mpl.rc_context(style.STYLE):
        _draw(rows, slopes, path)
    print(f"figure: {path}")


def _draw(rows, slopes, path):
    figure = style.new_figure(7.4, 3.6)
    left, middle, right = figure.subplots(1, 3)
    columns = (
        (left, 1, "size [instructions]"),
        (middle, 1e3, "time to build [ms]"),
        (right, 1e6, "time of one evaluation [µs]"),
    )
    for k, (ax, unit, label) in enumerate(columns):
        for name, marker, colour in zip(NAMES, "os", (style.series(0)[0], style.series(1)[0]), strict=True):
            text = f"{name.split('_')[0]}: exponent {slopes[name][k]:.2f}"
            ax.loglog(SECTIONS, rows[name][:, k] * unit, marker + "-", color=colour, lw=1.4, ms=5, label=text)
        ax.set_xlabel("sections of six strains [1]")
        ax.set_ylabel(label)
        ax.set_xticks(SECTIONS, [str(n) for n in SECTIONS])
        ax.xaxis.set_minor_locator(NullLocator())  # log axes label theirs over ours
        ax.grid(color="#e6e9ed", lw=0.5)
        ax.legend(title="dynamics", loc="upper left")
        low, high = ax.get_ylim()
        ax.set_ylim(low, high * (high / low) ** 0.25)  # room for the legend
    save(figure, Path(path))


if __name__ == "__main__":
    main(*sys.argv[1:2])
