"""A motion of tensions in space: wanted postures and tracks, and what a simulation under the tensions makes of it."""

import numpy as np

from socontrol.report import style, tension_deviation
from socontrol.report.motion import Motion
from socontrol.report.motion_shapes import composed, drawn
from socontrol.report.plan_paths import TOP, key, replayed, symbol
from socontrol.report.tracks import Track

SEEN = 0.01  # of the width of a path: smaller ways off it are drawn enlarged, too
SHOWN = 0.08  # of the width: about the largest of enlarged ones


def motion_figure(result):
    """Postures of the wanted motion over one another, tracks of the ends wanted and simulated; None without numbers."""
    motion = Motion.of(result)
    if motion is None:
        return None
    scene, colours = composed(motion)
    entries = replayed(scene, motion)
    for name in motion.tips:
        for k, marker in ((0, "o"), (-1, "s")):
            scene.mark(motion.track(name)[k], style.INK, marker=marker, size=5, face="#ffffff", layer=TOP)
    entries += [(symbol(style.INK, "o", ms=4.5), "start"), (symbol(style.INK, "s", ms=4.5), "end")]
    if "path.target" in result.arrays:
        scene.stroke(np.asarray(result.arrays["path.target"]), style.GOAL, width=1.4, layer=TOP - 2)
        entries.append((symbol(style.GOAL, "", ls="-", lw=1.4), "path"))
    figure = drawn(motion, scene, colours)
    key(figure, entries)
    state = "" if result.status.solved else f", {result.status.outcome}"
    title = f"{result.name}: {len(motion.overlaid)} times of the wanted motion{state}; thin line: its track"
    style.title(figure, title)
    return figure


def tracked_figure(result):
    """Where the tracked point was wanted and where the simulation brings it, at one scale; None without a path."""
    found = tension_deviation.of_path(result)
    if found is None or not found.distances.any():
        return None
    wanted = np.asarray(result.arrays["target"])[: len(found.t)]
    real = tension_deviation.replayed(result)[: len(found.t)]
    width, (name, _, worst) = float(np.max(np.ptp(wanted, axis=0))), found.worst
    figure = style.new_figure(5.6, 5.2)
    view = Track(figure, figure.add_gridspec(1, 1)[0], wanted)
    view.line(wanted, "-", color=style.GOAL, lw=1.6, label="wanted", zorder=2)
    if "path.target" in result.arrays:
        view.line(np.asarray(result.arrays["path.target"]), "o", color=style.GOAL, mfc="none", ms=5, mew=0.9,
                  label="waypoints", zorder=3)  # fmt: skip
    view.line(real, "--", color=style.INK, lw=1.1, label=f"{name}, simulated", zorder=4)
    if worst < SEEN * width:
        times = _round(SHOWN * width / worst)
        view.line(wanted + times * (real - wanted), ":", color=style.MISS, lw=1.1,
                  label=f"its way off, {times:g} times", zorder=3)  # fmt: skip
    view.finish()
    style.title(figure, f"{result.name}: wanted and simulated path")
    return figure


def _round(x):
    """The largest of 1, 2, 5, 10, 20 ... not above x."""
    ten = 10.0 ** np.floor(np.log10(x))
    return max(step for step in (1, 2, 5) if step * ten <= x * (1 + 1e-12)) * ten
