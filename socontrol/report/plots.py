"""Figures of a result as PNG files: the robot in space, inputs and their limits, track of a path, strains, motions."""

from pathlib import Path

import numpy as np

from socontrol.report import shapes, style
from socontrol.report.branch_curves import branches_figure
from socontrol.report.branch_shapes import branch_shapes_figure
from socontrol.report.fits import fit_figure
from socontrol.report.motion_coordinates import coordinates_figure
from socontrol.report.motion_curves import energies_figure, histories_figure
from socontrol.report.motion_loops import loops_figure
from socontrol.report.motion_shapes import shapes_figure
from socontrol.report.plan_paths import path_figure as plan_path_figure
from socontrol.report.plan_strips import leaves_out, strips_figure
from socontrol.report.portrait import robot_figure
from socontrol.report.tension_cables import cables_figure
from socontrol.report.tension_course import kind_of
from socontrol.report.tension_paths import motion_figure, tracked_figure
from socontrol.report.tension_strips import strips_figure as tension_strips_figure
from socontrol.report.tension_table import slack_names, tight_limits
from socontrol.report.tracks import input_rows, path_figure
from socontrol.report.units import QUANTITY, fixed, readable

LARGEST = 200_000  # bytes a file
RESOLUTIONS = (150, 120, 90, 60)  # dots an inch, taken in order until the file is small enough


def draw(result, folder):
    """Paths of the figures drawn into `folder`; none for a result without numbers or without its question."""
    import matplotlib as mpl

    if result.question is None:
        return []
    folder, paths = Path(folder), []
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.STYLE):
        for name, make in _figures(result).items():
            figure = make(result)
            if figure is not None:
                paths.append(folder / f"{name}.png")
                save(figure, paths[-1])
    return paths


def _figures(result):
    """{name: function} of what is drawn of a result."""
    if result.type == "trajectory":
        return PLAN_FIGURES
    if result.type == "continuation":
        return BRANCH_FIGURES
    return TENSION_FIGURES.get(kind_of(result), FIGURES)


def save(figure, path):
    """Write a PNG below LARGEST bytes."""
    for dots in RESOLUTIONS:
        figure.savefig(path, dpi=dots)
        if path.stat().st_size < LARGEST:
            return


def inputs_figure(result):
    """Bars of the inputs between their limits, one axes a unit; on a path their range and the last value."""
    u, robot = input_rows(result), result.question.robot
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
    style.title(figure, f"{result.name}: inputs")
    return figure


def _bars(ax, result, u, unit, chosen):
    lower, upper = result.question.input_limits()
    finite = [x for k in chosen for x in (lower[k], upper[k]) if np.isfinite(x)]
    one, name = readable(unit, *finite, *u[:, chosen].ravel())
    reached = {
        limit["name"]: "beyond limit" if limit.get("beyond", 0) > 0 else "at limit"
        for limit in tight_limits(result)
        if limit["kind"] == "input"
    }
    reached |= dict.fromkeys(slack_names(result), "slack")
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
        tint = {"slack": style.SLACK, None: None}.get(on_limit, style.MISS)
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
        ax.plot([now], [row], "o", ms=4.5, color=tint or style.BAR, zorder=5)
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
            color=tint or style.INK,
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
    style.title(figure, f"{result.name}: strains{where}{still}")
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
    "cables": cables_figure,
    "fit": fit_figure,
    "shapes": shapes_figure,
    "coordinates": coordinates_figure,
    "energies": energies_figure,
    "histories": histories_figure,
    "loops": loops_figure,
}
BRANCH_FIGURES = {"branches": branches_figure, "shapes": branch_shapes_figure}
PLAN_FIGURES = {
    "strips": strips_figure,
    "path": plan_path_figure,
    "coordinates": lambda result: coordinates_figure(result) if leaves_out(result) else None,
}
TENSION_FIGURES = {
    "path": {
        "robot": robot_figure,
        "path": lambda result: path_figure(result, inputs=False),
        "strips": tension_strips_figure,
        "strains": strains_figure,
        "cables": cables_figure,
    },
    "motion": {"shapes": motion_figure, "strips": tension_strips_figure, "path": tracked_figure,
               "coordinates": coordinates_figure, "loops": loops_figure},
}
