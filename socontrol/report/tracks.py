"""The way of the point that follows a path: its track on the waypoints, its misses, the inputs along the way."""

import numpy as np

from socontrol.programs.postures import goals
from socontrol.report import style
from socontrol.report.units import QUANTITY, readable

NOISE = 1e-9  # m, of a miss: smaller ones are not told apart


def input_rows(result):
    """Values [k x m] of all waypoints, or [1 x m]; None without inputs or without numbers."""
    u = result.arrays.get("path.u")
    u = result.arrays.get("u") if u is None or not len(u) else u
    if u is None or result.type == "simulation" or result.question.robot.m == 0 or not np.all(np.isfinite(u)):
        return None
    return np.atleast_2d(u)


def path_figure(result, inputs=True):
    """The tip's track on the waypoints, its miss, and `inputs` along the way; None without a path."""
    target = result.arrays.get("path.target")
    if target is None or not len(result.arrays.get("path.tip", ())):
        return None
    u, robot = input_rows(result) if inputs else None, result.question.robot
    units = list(dict.fromkeys(robot.input_units)) if u is not None else []
    misses = np.asarray(result.arrays["path.miss"])
    shows = bool(np.any(misses >= NOISE))
    figure = style.new_figure(9.2 if units or shows else 5.0, 4.6)
    heights = [2] * len(units) + [1] * shows
    grid = figure.add_gridspec(max(1, len(heights)), 2 if heights else 1,
                               width_ratios=[1, 1.15] if heights else None, height_ratios=heights or None)  # fmt: skip
    _track(figure, grid[:, 0], np.asarray(target), result.arrays["path.tip"], _followed(result))
    shared = None
    for row, unit in enumerate(units):
        shared = figure.add_subplot(grid[row, 1], sharex=shared)
        _input_curves(shared, result, u, unit)
    if shows:
        shared = figure.add_subplot(grid[-1, 1], sharex=shared)
        _misses(shared, misses)
    if shared is not None:
        shared.tick_params(labelbottom=True)
        shared.set_xlabel("waypoint")
        shared.set_xlim(0.5, len(target) + 0.5)
        shared.xaxis.get_major_locator().set_params(integer=True)
    small = "" if shows or not len(misses) else ", all misses below 1 nm"
    style.title(figure, f"{result.name}: {len(result.arrays['path.tip'])} of {len(target)} waypoints solved{small}")
    return figure


def _followed(result):
    """What follows the path: the name of the goal's segment, and where on it unless at its end."""
    asked = (getattr(result.question, "goals", None) or {}).values()
    goal = next((g for g in asked if isinstance(g, goals.Path)), None)
    if goal is None:
        return "tip"
    return f"end of {goal.on}" if goal.at == 1 else f"{goal.on} at {goal.at:g}"


def _track(figure, place, target, tip, name_of_tip):
    view = Track(figure, place, target)
    view.line(target, "-", color=style.GOAL, lw=1.0, zorder=2)
    view.line(target, "o", color=style.GOAL, mfc="none", ms=6, mew=1.1, label="waypoints", zorder=3)
    view.line(tip, ".", color=style.INK, ms=4.5, label=name_of_tip, zorder=4)
    if len(tip) < len(target):
        view.line(target[[len(tip)]], "X", color=style.MISS, ms=8, label="first out of reach", zorder=5)
    view.finish()


class Track:
    """Axes at one scale that show points near a path [k x 3]: square to its plane, or in space where it has none."""

    def __init__(self, figure, place, path):
        self.one, self.unit = readable("m", float(np.max(np.ptp(path, axis=0))))
        self.flat = _plane(path)
        self.ax = figure.add_subplot(place, label="track", projection="3d" if self.flat is None else None)

    def line(self, points, look, **more):
        if self.flat is not None:
            centre, across, _ = self.flat
            points = (points - centre) @ across
        self.ax.plot(*(points / self.one).T, look, **more)

    def finish(self):
        """Labels, one scale, grid and key."""
        labels = ("x", "y", "z") if self.flat is None else self.flat[2]
        for axis, label in zip("xyz", labels, strict=False):
            getattr(self.ax, f"set_{axis}label")(f"{label} [{self.unit}]")
        self.ax.set_aspect("equal", adjustable="datalim" if self.flat is not None else None)
        self.ax.grid(color="#e6e9ed", lw=0.5)
        self.ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=3)


def _plane(points):
    """(origin [3], directions [3 x 2], labels) of the plane that holds all points; None if there is none."""
    centre = points.mean(0)
    _, sizes, rows = np.linalg.svd(points - centre)
    if len(sizes) > 2 and sizes[2] > 1e-6 * sizes[0]:
        return None
    k = int(np.argmax(np.abs(rows[2])))
    if abs(rows[2][k]) > 1 - 1e-9:
        i, j = [a for a in range(3) if a != k]
        return np.zeros(3), np.eye(3)[:, [i, j]], ("xyz"[i], "xyz"[j])
    return centre, rows[:2].T, ("along the path's plane", "across, in the plane")


def _input_curves(ax, result, u, unit):
    robot, (lower, upper) = result.question.robot, result.question.input_limits()
    chosen = [k for k in range(robot.m) if robot.input_units[k] == unit]
    ends = {x for k in chosen for x in (lower[k], upper[k]) if np.isfinite(x)}
    one, name = readable(unit, *u[:, chosen].ravel(), *ends)
    for n, k in enumerate(chosen):
        colour, dash = style.series(n)
        ax.plot(np.arange(1, len(u) + 1), u[:, k] / one, dash, color=colour, lw=1.3, label=robot.inputs[k])
    for n, end in enumerate(sorted(ends)):
        ax.axhline(end / one, color=style.LIMIT, lw=0.9, ls=(0, (5, 3)), label="limit" if n == 0 else None)
    ax.set_ylabel(f"{QUANTITY.get(unit, 'input')} [{name}]")
    ax.tick_params(labelbottom=False)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 if len(chosen) < 10 else 2)


def _misses(ax, misses):
    """Misses on a log scale; those below NOISE are left out and said to be."""
    from matplotlib.ticker import LogLocator, NullLocator

    seen = misses >= NOISE
    drawn = np.where(seen, misses * 1e6, np.nan)
    ax.semilogy(np.arange(1, len(misses) + 1), drawn, ".-", color=style.INK, lw=0.8, ms=4)
    if not np.all(seen):
        ax.set_title("not drawn: below 1 nm", fontsize=7.5, loc="right", pad=2)
    shown = misses[seen] * 1e6
    middle = np.sqrt(shown.min() * shown.max())
    ax.set_ylim(min(shown.min() / 3, middle / 30), max(shown.max() * 3, middle * 30))
    ax.yaxis.set_major_locator(LogLocator(numticks=4))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel("miss [um]")
    ax.grid(color="#e6e9ed", lw=0.5)
