"""What the loops of a moving robot bear over time: forces and moments on `a` by `b`, in the joint frame of `b`."""

import numpy as np

from socontrol.report import style
from socontrol.report.motion import Motion
from socontrol.report.motion_curves import dress
from socontrol.report.motion_text import NOISE
from socontrol.report.units import readable

MOST = 6  # loops drawn, those that bear most
PARTS = (("force", "N", slice(3, 6)), ("moment", "N m", slice(0, 3)))
USUAL = 0.98  # share of the outputs that sets the limits of the axes where dead points let forces grow
ROOM = 1.3


def loops_figure(result):
    """Axes for the force and the moment of each loop that bears one; None without loops, or where they bear nothing."""
    motion = Motion.of(result)
    if motion is None:
        return None
    found = _quiet({name: np.asarray(result.arrays[f"loops.{name}"]) for name in motion.robot.loops
                    if f"loops.{name}" in result.arrays})  # fmt: skip
    shown = sorted(found, key=lambda name: -_largest(found[name][:, 3:]))[:MOST]
    panels = [(name, part) for name in found if name in shown for part in PARTS if np.any(found[name][:, part[2]])]
    if not panels:
        return None
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure = style.new_figure(1.6 + 3.7 * columns, 0.9 + 1.6 * rows)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for ax, (name, (what, unit, own)) in zip(axes.flat, panels, strict=False):
        _curves(ax, motion, found[name][:, own], (what, unit), name, result.details.get("singular") or ())
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    for column in axes.T:
        last = [ax for ax in column if ax.axison][-1]
        last.set_xlabel("time [s]")
        last.tick_params(labelbottom=True)
    lines = {line.get_label(): line for ax in axes.flat for line in ax.lines if line.get_label() in "xyz"}
    figure.legend([lines[axis] for axis in sorted(lines)], sorted(lines), loc="outside lower center", ncols=4)
    left = f", {len(found) - len(shown)} more bear less" if len(shown) < len(found) else ""
    title = f"{result.name}: what loops bear, on a by b in the joint frame of b{left}{motion.ending()}"
    style.title(figure, title)
    return figure


def _largest(values):
    return float(np.max(np.abs(values), initial=0.0))


def _quiet(found):
    """Wrenches by loop, each component 0 where it is noise beside the largest number of all."""
    least = NOISE * max(map(_largest, found.values()), default=0.0)
    return {name: np.where(np.max(np.abs(wrench), axis=0) > least, wrench, 0.0) for name, wrench in found.items()}


def _curves(ax, motion, values, part, name, singular):
    keep, (what, unit) = motion.thinned(), part
    size = np.max(np.abs(values), axis=1)
    usual = float(np.quantile(size, USUAL)) if len(singular) else float(np.max(size))
    one, shown = readable(unit, usual)
    for k, axis in enumerate("xyz"):
        if not np.any(values[:, k]):
            continue
        ax.plot(motion.t[keep], values[keep, k] / one, color=style.SERIES[k], lw=1.2, label=axis)
    for t in singular:
        ax.axvline(t, color="#999999", lw=0.7, ls=":")
    dress(ax, motion)
    if len(singular) and usual > 0:
        ax.set_ylim(-ROOM * usual / one, ROOM * usual / one)
    ax.set_ylabel(f"{what} [{shown}]")
    ax.set_title(name, loc="left", fontsize=8.5)
