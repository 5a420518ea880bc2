"""What is said of tensions for a motion: held or not, and which limit is in the way."""

from dataclasses import dataclass

import numpy as np

from socontrol.programs.result import Status

PART = 0.5  # of the tolerance: limits that displace the robot by so much are in the way
LITTLE = 1e-3  # of the largest force: unmet forces below that are not what leads a robot astray
KEPT = 1e-6  # of a limit on rates: by so much the change between samples may be beyond it


@dataclass(frozen=True)
class Stray:
    """How far the robot is from the wanted motion: `largest` [m], of what, when [s]; allowed [m]; from the simulation
    or, without one, from what the inputs leave unmet."""

    largest: float
    what: str
    time: float
    allowed: float
    simulated: bool = True

    @property
    def sentence(self):
        how = "Simulated under these inputs" if self.simulated else "By what these inputs leave unmet"
        return f"{how}, {self.what} is {_metres(self.largest)} off at most, at t = {self.time:.4g} s"


def _metres(x):
    return f"{1e3 * x:.3g} mm" if x < 1 else f"{x:.3g} m"


def judged(question, stray, replay, unmet, need):
    """Status of tensions. replay: Status of the simulation, None without one; unmet: force that is unmet over the
    largest; need(): Need of a limit or Hurry of a rate, or None."""
    if replay is not None and replay.outcome == "interrupted":
        return Status("interrupted", "Stopped by the user; the tensions are kept, the simulation was not ended.")
    wild = replay is not None and not replay.solved
    if not wild and stray.largest <= stray.allowed:
        return Status("solved", f"Held. {stray.sentence}.")
    found = need()
    if found is not None and found.moved > PART * stray.allowed:
        return Status("infeasible", f"The limits do not allow this motion: {found.sentence}. {stray.sentence}.")
    if wild:
        return Status("rejected", f"Simulated under these inputs, it does not come to its end. {replay.message}")
    told = f"{stray.sentence}, beyond `motion.tolerance` ({question.motion.tolerance:g} of the robot's length)"
    fix = "raise `motion.tolerance` if that is good enough, or ask for a slower motion"
    if unmet > LITTLE:
        return Status("rejected", f"Not held. {told}. No inputs give {unmet:.2g} of the largest force: {fix}.")
    return Status("rejected", f"Not held. {told}. What little is unmet grows: {fix}, or take samples more often.")


def fastest(pace, u, lengths):
    """`c1 would need 3.4 N/s at t = 2 s, its limit is 2 N/s`: the rate of inputs u or lengths [K x m] furthest beyond
    its limit in a Pace; nothing where none is."""
    dt, worst, told = np.diff(pace.t), 1 + KEPT, ""
    for rate, change in zip(pace.rates, pace.changes(u, lengths), strict=True):
        share = rate.share(change, dt)
        k = int(np.argmax(share))
        if share[k] > worst:
            worst, told = share[k], f"{rate.needed(change[k], dt[k])} (at t = {pace.t[k]:.4g} s)"
    return told


def too_fast(pace, u, lengths):
    """Status where rates of inputs or lengths [K x m] are beyond the limits of a Pace, or None."""
    told = fastest(pace, u, lengths)
    if not told:
        return None
    return Status("infeasible", f"The motion is too fast for its limits: {told}; raise the duration or the limit.")
