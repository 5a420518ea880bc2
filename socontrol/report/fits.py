"""Fits to measurements, in words and as a figure: parameters, errors on fitted and held-out measurements."""

import numpy as np
from rich.text import Text

from socontrol.report import style
from socontrol.report.columns import columns, line
from socontrol.report.units import number

MISSES = (  # key, title, value of one in SI, unit
    ("position", "tip", 1e-3, "mm"),
    ("tilt", "tilt", np.pi / 180, "deg"),
)


def render(result, console, verbose=0):
    """Print the fits side by side; `verbose` adds the errors of each measurement."""
    labels = list(result.details["fits"])
    rows = []
    for label in labels:
        row = [(label, "bold")]
        for use in ("fit", "test"):
            for key, _, one, _ in MISSES:
                value = result.values.get(f"{label}.rms.{use}.{key}")
                row.append("" if value is None else number(value.value / one, 3))
        ratios = [result.values.get(f"{label}.ratio.test.{key}") for key, *_ in MISSES]
        rows.append([*row, *("" if r is None else number(r.value, 3) for r in ratios)])
    caption = "rms errors, tip [mm] and tilt [deg]; ratio: on test, over the first variant's"
    line(console, Text(caption, style="dim"))
    heads = [f"{use} {title}>" for use in ("fit", "test", "ratio") for _, title, *_ in MISSES]
    columns(console, ["variant.factor", *heads], rows)
    parameters = [
        [(label, "bold"), path, ", ".join(number(x, 6) for x in np.ravel(value))]
        for label in labels
        for path, value in result.details["fits"][label]["parameters"].items()
    ]
    columns(console, ["variant.factor", "parameter", "value [SI]"], parameters)
    if verbose:
        _each(result, console, labels)


def _each(result, console, labels):
    measurements = result.question.measurements if result.question is not None else None
    for key, title, one, unit in MISSES:
        errors = np.array([result.arrays[f"{label}.{key}_error"] for label in labels]) / one
        rows = []
        for k in range(errors.shape[1]):
            use = measurements[k].use if measurements else ""
            rows.append([str(k + 1), use, *(number(x, 3) for x in errors[:, k])])
        line(console, Text(f"{title} error of each measurement [{unit}]", style="dim"))
        columns(console, ["measurement>", "use", *(f"{label}>" for label in labels)], rows)


def fit_figure(result):
    """Errors of each measurement under each fit, side by side; None for anything but fits."""
    labels = list(result.details.get("fits", ()))
    if not labels:
        return None
    figure = style.new_figure(8.2, 4.6)
    axes = figure.subplots(2, 1, sharex=True)
    measurements = result.question.measurements
    for ax, (key, title, one, unit) in zip(axes, MISSES, strict=True):
        width = 0.8 / len(labels)
        for n, label in enumerate(labels):
            errors = np.abs(result.arrays[f"{label}.{key}_error"]) / one
            at = np.arange(len(errors)) + (n - (len(labels) - 1) / 2) * width
            ax.bar(at, errors, width * 0.9, color=style.series(n)[0], label=label)
        for k, row in enumerate(measurements):
            if row.use == "fit":
                ax.axvspan(k - 0.5, k + 0.5, color="#f0f2f4", zorder=0, label="fitted" if k == 0 else None)
        ax.set_ylabel(f"{title} error [{unit}]")
        ax.grid(axis="y", color="#e6e9ed", lw=0.5)
        ax.set_axisbelow(True)
    axes[1].set_xticks(range(len(measurements)), [_name(row) for row in measurements], rotation=25, ha="right")
    axes[1].set_xlim(-0.5, len(measurements) - 0.5)
    axes[1].set_xlabel("measured inputs")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names))
    style.title(figure, f"{result.name}: errors by variant and factor on the inputs")
    return figure


def _name(row):
    return ", ".join(f"{name} {value}" for name, value in row.inputs.items())
