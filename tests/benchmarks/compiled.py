"""Functions of the reference rod in C against CasADi's virtual machine (VM), and rigid chains against Pinocchio.

    python tests/benchmarks/compiled.py [--portable | --local] [FUNCTION ... | peers]

For each function and number of sections: one call in the VM, and from C made of the one expression (plain) and of one
Function a section (chained), by gcc with portable and with local flags; size of the C text and of the library, CPU
seconds of gcc. Every compiled value is held against the VM's. All calls go through `Function.buffer()`. Times are CPU
times of this process, the least of ROUNDS rounds through all runs of a row: ratios of one row belong to one moment.
Beside them stand the prototype's times and ratios (reference_rod.py). Peers: pip install -e '.[peers]'.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import peers
import reference_rod
from dynamics_scaling import calibration, clocked, state

from socontrol.native.buffers import Buffered

# Without -fexpensive-optimizations gcc contracts nothing to fused multiply-adds; the rest of -O2 gains nothing more.
# Without -fstrict-aliasing chained forms read pointers again after each store (a fifth slower); on one Function of
# 35 000 instructions it takes gcc four times as long and gains a tenth.
PLAIN_FLAGS = {"portable": ("-O1",), "local": ("-O1", "-march=native", "-fexpensive-optimizations")}
CHAINED_FLAGS = {**PLAIN_FLAGS, "local": (*PLAIN_FLAGS["local"], "-fstrict-aliasing")}
FLAGS = {"plain": PLAIN_FLAGS, "chained": CHAINED_FLAGS}
ROUNDS = 9
TOLERANCE = 1e-12  # of the largest entry
LARGEST_PLAIN = 25_000  # instructions, where a chained form exists: above, gcc takes over 10 s
# {function: {sections: (us in C, ratio of VM to C)}} of the prototype
GOALS = {
    "inverse_dynamics": {1: (1.3, 7.6), 2: (3.0, 11.4), 4: (6.2, 10.4), 8: (13.7, 8.1), 16: (24, 8.0)},
    "forward_dynamics": {1: (2.9, 10.9), 2: (9.1, 8.6), 4: (13.6, 11.8), 8: (30, 8.7), 16: (68, 7.9)},
    "mass": {1: (1.8, 6.0), 2: (4.6, 8.6), 4: (9.6, 10), 8: (23, 8.4)},
    "statics": {1: (2.8, 12.2), 2: (7.5, 11.7), 4: (21, 10), 8: (86, 6.5)},
}
CHAINED = ("inverse_dynamics", "forward_dynamics")
JOINTS = (7, 20, 50)


def called(function, values):
    """Buffered form of a Function that was called with values once: `run()` evaluates it again."""
    call = Buffered(function)
    call(*values)
    return call


def largest_gap(call, other):
    """Largest difference of a call's outputs from another's, over the largest entry of each of these."""
    pairs = zip(call.outputs, other.outputs, strict=True)
    return max((np.max(np.abs(a - b)) / np.max(np.abs(b)) for a, b in pairs if b.size), default=0.0)


class Compiler:
    """gcc in a folder of its own."""

    def __init__(self, folder):
        self.folder, self.count = Path(folder), 0

    def __call__(self, function, flags):
        """(external Function, kB of C, kB of the library, CPU s of gcc)."""
        self.count += 1
        source = self.folder / f"f{self.count}.c"
        code = ca.CodeGenerator(source.name, {"with_header": False})
        code.add(function)
        code.generate(f"{self.folder}/")
        began = os.times()
        subprocess.run(["gcc", *flags, "-fPIC", "-shared", source, "-o", source.with_suffix(".so")], check=True)
        ended = os.times()
        spent = sum(getattr(ended, k) - getattr(began, k) for k in ("children_user", "children_system"))
        sizes = (path.stat().st_size / 1e3 for path in (source, source.with_suffix(".so")))
        return ca.external(function.name(), str(source.with_suffix(".so"))), *sizes, spent


def least(runs):
    """{key: least CPU s of one run} over ROUNDS rounds through all `runs` {key: callable}."""
    rounds = [{key: clocked(run) for key, run in runs.items()} for _ in range(ROUNDS)]
    return {key: min(spent[key] for spent in rounds) for key in runs}


def arguments(robot, name):
    q, qd, qdd = state(robot)
    u = np.zeros(robot.m)
    return {"inverse_dynamics": [q, qd, qdd], "forward_dynamics": [q, qd, u], "mass": [q], "statics": [q, u]}[name]


def forms(robot, name):
    """{form: Function} that are worth compiling; the first entry is what the VM runs."""
    plain = getattr(robot.functions(), name).function
    found = {"VM": plain}
    if name not in CHAINED or plain.n_instructions() <= LARGEST_PLAIN:
        found["plain"] = plain
    if name in CHAINED:
        found["chained"] = getattr(robot.functions(chained=True), name).function
    return found


def rod(name, sections, compiler, labels):
    """Print the rows of one function and size; whether all values agree."""
    robot = reference_rod.robot(sections)
    made, good = forms(robot, name), True
    values, vm = arguments(robot, name), made.pop("VM")
    calls, facts = {"VM": called(vm, values)}, {}
    for label in labels:
        for form, function in made.items():
            external, *facts[label, form] = compiler(function, FLAGS[form][label])
            calls[label, form] = called(external, values)
    times = least({key: call.run for key, call in calls.items()})
    wanted, ratio = GOALS[name][sections]
    head = f"{name.replace('_', ' '):17s}{sections:3d}{vm.n_instructions():8d}{times['VM'] * 1e6:8.1f}"
    for key, (text, library, spent) in facts.items():
        gap, us = largest_gap(calls[key], calls["VM"]), times[key] * 1e6
        good &= gap <= TOLERANCE
        line = f"{head}  {key[0]:9s}{key[1]:8s}{us:8.2f}{wanted:7.1f}{times['VM'] / times[key]:7.1f}{ratio:7.1f}"
        verdict = "" if gap <= TOLERANCE else "  DIFFERS"
        print(f"{line}{text:8.0f}{library:8.0f}{spent:7.1f}{gap:10.0e}{verdict}", flush=True)
    return good


def chains(compiler, labels):
    """Inverse dynamics of chains of revolute joints beside pin.rnea from Python; whether all values agree."""
    import pinocchio as pin

    good = True
    print(f"\nchain of N revolute joints, inverse dynamics [us]\n{'N':>4s}{'pin.rnea':>10s}", end="")
    print("".join(f"{label:>12s}{'pin / C':>9s}{'gap':>8s}" for label in labels))
    for n in JOINTS:
        robot = peers.our_chain(n)
        values = state(robot, seed=n)
        function = robot.functions().inverse_dynamics.function
        calls = {label: called(compiler(function, PLAIN_FLAGS[label])[0], values) for label in labels}
        model, data = peers.their_chain(n)
        runs = {label: call.run for label, call in calls.items()}
        runs["pin"] = lambda model=model, data=data, values=values: pin.rnea(model, data, *values)
        theirs, times = runs["pin"](), least(runs)
        row = f"{n:4d}{times['pin'] * 1e6:10.2f}"
        for label, call in calls.items():
            gap = peers.difference(call.outputs[0].ravel(), theirs)
            good &= gap <= peers.TOLERANCE["Pinocchio"]
            row += f"{times[label] * 1e6:12.2f}{times['pin'] / times[label]:9.2f}{gap:8.0e}"
        print(row, flush=True)
    return good


def soromox(compiler, labels, sections=16):
    """Forward dynamics of the rod beside SoRoMoX; whether the values agree."""
    robot = reference_rod.robot(sections)
    values = arguments(robot, "forward_dynamics")
    function = robot.functions(chained=True).forward_dynamics.function
    calls = {label: called(compiler(function, CHAINED_FLAGS[label])[0], values) for label in labels}
    y = np.concatenate(values[:2])
    forward = peers.soromox_forward(sections)
    theirs = np.array(forward(y))[robot.n :]
    times = least({**{label: call.run for label, call in calls.items()}, "soromox": peers.on_device(forward, y)})
    print(f"\nreference rod, {sections} sections, forward dynamics: SoRoMoX {times['soromox'] * 1e6:.0f} us;", end=" ")
    rows = (f"{k} {times[k] * 1e6:.1f} us, {times['soromox'] / times[k]:.0f} times as fast" for k in calls)
    print("; ".join(rows))
    gaps = [peers.difference(call.outputs[0].ravel(), theirs) for call in calls.values()]
    print(f"largest difference {max(gaps):.0e} (SoRoMoX's Gauss weights hold 5e-8)")
    return max(gaps) <= peers.TOLERANCE["SoRoMoX"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    choice = parser.add_mutually_exclusive_group()
    for label in PLAIN_FLAGS:
        choice.add_argument(f"--{label}", action="store_true", help=f"only {' '.join(PLAIN_FLAGS[label])}")
    parser.add_argument("what", nargs="*", help=f"some of {', '.join(GOALS)}, peers; default all")
    given = parser.parse_args()
    what = given.what or [*GOALS, "peers"]
    if unknown := set(what) - {*GOALS, "peers"}:
        parser.error(f"unknown: {', '.join(unknown)}; allowed: {', '.join(GOALS)}, peers")
    labels = [label for label in PLAIN_FLAGS if getattr(given, label)] or [*PLAIN_FLAGS]
    for form, flags in FLAGS.items():
        print("; ".join(f"{form}, {label}: gcc {' '.join(flags[label])}" for label in labels))
    print(f"calibration: {calibration():.2f} ns an SX instruction in the VM; goal: prototype, at 2.5 to 4 ns\n")
    head = f"{'function':17s}{'N':>3s}{'instr.':>8s}{'VM us':>8s}  {'flags':9s}{'form':8s}{'us':>8s}{'goal':>7s}"
    print(f"{head}{'VM / C':>7s}{'goal':>7s}{'C kB':>8s}{'.so kB':>8s}{'gcc s':>7s}{'gap':>10s}")
    good, report = True, peers.Report()
    with tempfile.TemporaryDirectory() as folder:
        compiler = Compiler(folder)
        for name in (name for name in GOALS if name in what):
            for sections in GOALS[name]:
                good &= rod(name, sections, compiler, labels)
        if "peers" in what and report.has("Pinocchio"):
            good &= chains(compiler, labels)
        if "peers" in what and report.has("SoRoMoX"):
            good &= soromox(compiler, labels)
    print(f"\ncalibration: {calibration():.2f} ns{'' if good else '; SOME VALUES DIFFER'}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
