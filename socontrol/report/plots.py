"""Figures of a result as PNG files: the robot in space, inputs and their limits, track of a path, strains, motions."""

from pathlib import Path

import numpy as np

from socontrol.programs import goals
from socontrol.report import shapes, style
from socontrol.report.fits import fit_figure
from socontrol.report.motion_coordinates import coordinates_figure
from socontrol.report.motion_curves import energies_figure, histories_figure
from socontrol.report.motion_shapes import shapes_figure
from socontrol.report.plan_paths import path_figure as plan_path_figure
from socontrol.report.plan_strips import leaves_out, strips_figure
from socontrol.report.portrait import robot_figure
from socontrol.report.units import fixed, readable

LARGEST = 200_000  # bytes a file
NOISE = 1e-9  # m, of a miss: smaller ones are not told apart
RESOLUTIONS = (150, 120, 90, 60)  # dots an inch, taken in order until the file is small enough


def draw(result, folder):
    """Paths of the figures drawn into `folder`; none for a result without numbers or without its question."""
    import matplotlib as mpl

    if result.question is None:
        return []
    folder, paths = Path(folder), []
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.STYLE):
        for name, make in (PLAN_FIGURES if result.type == "trajectory" else FIGURES).items():
            figure = make(result)
            if figure is not None:
                paths.append(folder / f"{name}.png")
                save(figure, paths[-1])
    return paths


def save(figure, path):
    """Write a PNG below LARGEST bytes."""
    for dots in RESOLUTIONS:
        figure.savefig(path, dpi=dots)
        if path.stat().st_size < LARGEST:
            return


def _inputs(result):
    """Values [k x m] of all waypoints, or [1 x m]; None without inputs or without numbers."""
    u = result.arrays.get("path.u")
    u = result.arrays.get("u") if u is None or not len(u) else u
    if u is None or result.type == "simulation" or result.question.robot.m == 0 or not np.all(np.isfinite(u)):
        return None
    return np.atleast_2d(u)


def inputs_figure(result):
    """Bars of the inputs between their limits, one axes a unit; on a path their range and the last value."""
    u, robot = _inputs(result), result.question.robot
    if u is None:
        return None
    groups = {
        unit: [k for k in range(robot.m) if robot.input_units[k] == unit] for unit in dict.fromkeys(robot.input_units)
    }
    rows = [len(g) for g in groups.values()]
    figure = style.new_figure(6.4, 1.0 + sum(0.26 * r + 0.55 for r in rows))
    axes = np.ravel(
        figure.subplots(len(groups), 1, gridspec_kw={"height_ratios": [r + 1 for r in rows]}, squeeze=False)
    )
    for ax, (unit, chosen) in zip(axes, groups.items(), strict=True):
        _bars(ax, result, u, unit, chosen)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    figure.suptitle(f"{result.name}: inputs", x=0.01, ha="left", fontsize=10)
    return figure


def _bars(ax, result, u, unit, chosen):
    lower, upper = result.question.input_limits()
    finite = [x for k in chosen for x in (lower[k], upper[k]) if np.isfinite(x)]
    one, name = readable(unit, *finite, *u[:, chosen].ravel())
    reached = {
        limit["name"]: "beyond limit" if limit.get("beyond", 0) > 0 else "at limit"
        for limit in result.details.get("limits", ())
        if limit["kind"] == "input"
    }
    size = max([abs(x) for x in finite] + [float(np.max(np.abs(u[:, chosen]))), 1e-300]) / one
    for row, k in enumerate(chosen):
        first, last, now = u[:, k].min() / one, u[:, k].max() / one, u[-1, k] / one
        ends = [x / one if np.isfinite(x) else None for x in (lower[k], upper[k])]
        if None not in ends:
            ax.barh(
                row,
                ends[1] - ends[0],
                left=ends[0],
                height=0.62,
                color="#eef1f4",
                label="within the limits" if row == 0 else None,
            )
        on_limit = reached.get(result.question.robot.inputs[k])
        if len(u) > 1:
            ax.barh(
                row,
                last - first,
                left=first,
                height=0.4,
                color=style.BAR,
                alpha=0.45,
                label="range over the path" if row == 0 else None,
            )
        else:
            ax.barh(row, now, height=0.4, color=style.BAR)
        ax.plot([now], [row], "o", ms=4.5, color=style.MISS if on_limit else style.BAR, zorder=5)
        for end in ends:
            if end is not None:
                ax.plot([end, end], [row - 0.36, row + 0.36], color=style.LIMIT, lw=1.6, zorder=4)
        far = max(e for e in (*ends, last, 0.0) if e is not None)
        ax.annotate(
            f"{fixed(now, size, 4)}{f' ({on_limit})' if on_limit else ''}",
            (far, row),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            color=style.MISS if on_limit else style.INK,
        )
    ax.plot([], [], color=style.LIMIT, lw=1.6, label="limit")
    ax.plot([], [], "o", ms=4.5, color=style.BAR, label="last waypoint" if len(u) > 1 else "value")
    ax.axvline(0, color="#777777", lw=0.7)
    ax.set_yticks(range(len(chosen)), [result.question.robot.inputs[k] for k in chosen])
    ax.set_ylim(len(chosen) - 0.4, -0.6)
    ax.set_xlabel(f"{QUANTITY.get(unit, 'input')} [{name}]")
    left, right = ax.dataLim.intervalx
    right = right if right > left else left + 1.0  # no limit and no value to span an axis
    ax.set_xlim(left - (0.16 if left < 0 else 0.015) * (right - left), right + 0.22 * (right - left))
    ax.tick_params(axis="y", length=0)


QUANTITY = {"Pa": "pressure", "N": "force", "N m": "torque", "m": "length", "rad": "angle"}


def path_figure(result):
    """The tip's track on the waypoints, its miss, and the inputs along the way; None without a path."""
    target = result.arrays.get("path.target")
    if target is None or not len(result.arrays.get("path.tip", ())):
        return None
    u, robot = _inputs(result), result.question.robot
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
    figure.suptitle(
        f"{result.name}: {len(result.arrays['path.tip'])} of {len(target)} waypoints solved{small}",
        x=0.01,
        ha="left",
        fontsize=10,
    )
    return figure


def _followed(result):
    """What follows the path: the name of the goal's segment, and where on it unless at its end."""
    asked = (getattr(result.question, "goals", None) or {}).values()
    goal = next((g for g in asked if isinstance(g, goals.Path)), None)
    if goal is None:
        return "tip"
    return f"end of {goal.on}" if goal.at == 1 else f"{goal.on} at {goal.at:g}"


def _track(figure, place, target, tip, name_of_tip):
    one, name = readable("m", float(np.max(np.ptp(target, axis=0))))
    flat = _plane(target)
    if flat is None:
        ax = figure.add_subplot(place, projection="3d", label="track")
        goal, track, labels = target, tip, ("x", "y", "z")
    else:
        ax = figure.add_subplot(place, label="track")
        centre, across, labels = flat
        goal, track = (target - centre) @ across, (tip - centre) @ across
    ax.plot(*(goal / one).T, "-", color=style.GOAL, lw=1.0, zorder=2)
    ax.plot(*(goal / one).T, "o", color=style.GOAL, mfc="none", ms=6, mew=1.1, label="waypoints", zorder=3)
    ax.plot(*(track / one).T, ".", color=style.INK, ms=4.5, label=name_of_tip, zorder=4)
    if len(track) < len(goal):
        ax.plot(
            *(goal[len(track)] / one)[:, None],
            "X",
            color=style.MISS,
            ms=8,
            label="first out of reach",
            zorder=5,
        )
    for axis, label in zip("xyz", labels, strict=False):
        getattr(ax, f"set_{axis}label")(f"{label} [{name}]")
    ax.set_aspect("equal", adjustable="datalim" if flat is not None else None)
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=3)


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


def strains_figure(result):
    """Strains of all rods against arc length, section by section; None without rods."""
    q, robot = result.arrays.get("q"), result.question.robot
    if q is None or np.ndim(q) > 1 or not np.all(np.isfinite(q)):
        return None
    rows = shapes.strain_rows(robot, q)
    zero = _zero(rows)
    groups = [(*g[:2], [c for c in g[2] if not zero[c]], g[3]) for g in STRAIN_GROUPS]
    groups = [g for g in groups if g[2]]
    if not groups:
        return None
    figure = style.new_figure(6.8, 0.7 + 1.75 * len(groups))
    axes = np.ravel(figure.subplots(len(groups), 1, sharex=True, squeeze=False))
    longest = sum(s[-1] for _, s, _ in rows)
    one, name = readable("m", longest)
    for ax, (title, unit, columns, factor) in zip(axes, groups, strict=True):
        _steps(ax, rows, columns, factor, one)
        ax.set_ylabel(f"{title} [{unit}]")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlabel(f"arc length, rod after rod [{name}]" if len(rows) > 1 else f"arc length [{name}]")
    axes[0].set_xlim(0, longest / one)
    where = " at the last waypoint" if "path.q" in result.arrays else ""
    still = [label for label, none in zip(LABELS, zero, strict=True) if none]
    still = f"\nzero everywhere: {', '.join(still)}" if still else ""
    figure.suptitle(f"{result.name}: strains{where}{still}", x=0.01, ha="left", fontsize=10)
    return figure


STRAIN_GROUPS = (  # title, unit, rows of xi, shown per SI
    ("curvature", "1/m", (0, 1, 2), 1.0),
    ("stretch", "%", (3,), 100.0),
    ("shear", "%", (4, 5), 100.0),
)
LABELS = ("twist", "bend y", "bend z", "stretch", "shear y", "shear z")


def _zero(rows):
    """For each strain whether it is zero everywhere, but for rounding."""
    if not rows:
        return [True] * len(LABELS)
    longest = sum(s[-1] for _, s, _ in rows)
    sizes = np.array([np.max(np.abs(strains), axis=0) for _, _, strains in rows]).max(0)
    sizes[:3] *= longest
    return sizes <= 1e-9 * max(1e-3, float(np.max(sizes)))


def _steps(ax, rows, columns, factor, one):
    begin = 0.0
    for r, (rod, s, strains) in enumerate(rows):
        for c in columns:
            colour, dash = style.series(c % 3)
            ax.stairs(
                factor * strains[:, c],
                (begin + s) / one,
                baseline=None,
                color=colour,
                ls=dash,
                lw=1.6,
                label=LABELS[c] if r == 0 else None,
            )
        if len(rows) > 1:
            ax.axvline(begin / one, color="#999999", lw=0.7, ls=":")
            ax.annotate(
                rod,
                (begin / one, 1.0),
                (3, 1),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                fontsize=7.5,
                color="#555555",
            )
        begin += s[-1]
    ax.axhline(0, color="#999999", lw=0.7)
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.set_axisbelow(True)
    ax.margins(y=0.12)


FIGURES = {
    "robot": robot_figure,
    "inputs": inputs_figure,
    "path": path_figure,
    "strains": strains_figure,
    "fit": fit_figure,
    "shapes": shapes_figure,
    "coordinates": coordinates_figure,
    "energies": energies_figure,
    "histories": histories_figure,
}
PLAN_FIGURES = {
    "strips": strips_figure,
    "path": plan_path_figure,
    "coordinates": lambda result: coordinates_figure(result) if leaves_out(result) else None,
}
