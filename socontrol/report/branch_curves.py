"""Branches of equilibria as curves: the load over a displacement, solid where stable, and the critical points."""

import numpy as np

from socontrol.report import style
from socontrol.report.branch_text import loads, place_of, standing, suited
from socontrol.report.units import number, readable

KINDS = {"bifurcation": "o", "limit point": "D"}
LINES = {"stable": ("-", 1.8), "marginal": ((0, (1, 1)), 1.8), "unstable": ((0, (4, 2)), 1.2)}  # dashes and width
CROWDED = 0.1, 0.05  # of the width and height: a label nearer to another one is left out
APART = 10.0  # times the distance between branches counts beside the way of the place in the choice of an axis
STILL = 1e-9  # of the largest displacement: no displacement


def branches_figure(result):
    """The load over the displacement of the place that is watched; None without branches."""
    count = len(result.details.get("branches") or ())
    if not count:
        return None
    axis, displaced, one, unit = _displacements(result, count)
    size, of_load, what = loads(result)
    load = [size * np.asarray(result.arrays[f"branch.{k}.parameter"]) for k in range(count)]
    force, name = suited(of_load, *(float(x) for y in load for x in (np.min(y), np.max(y))))
    figure = style.new_figure(6.4, 4.6)
    ax = figure.add_subplot()
    words = [standing(result, k) for k in range(count)]
    for k in range(count):
        _curve(ax, displaced[k] / one, load[k] / force, np.array(words[k]), style.series(k)[0])
    _criticals(ax, result, [x / one for x in displaced], [y / force for y in load], name)
    ax.set_xlabel(f"displacement of {place_of(result)} along {'xyz'[axis]} [{unit}]")
    ax.set_ylabel(f"{what} [{name}]" if name else what)
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.set_axisbelow(True)
    ax.margins(x=0.1, y=0.1)
    _key(figure, result, [word for word in LINES if any(word in row for row in words)])
    style.title(figure, f"{result.name}: equilibria under {what}")
    return figure


def _displacements(result, count):
    """(axis along which the place moves most and branches lie apart, displacements along it of each branch, unit)."""
    start = result.arrays["branch.0.watch"][0]
    moved = [np.asarray(result.arrays[f"branch.{k}.watch"]) - start for k in range(count)]
    spans = np.ptp(np.concatenate(moved), axis=0)
    means = np.array([np.mean(x, axis=0) for x in moved])
    axis = int(np.argmax(spans + APART * np.ptp(means, axis=0)))
    one, unit = readable("m", float(spans[axis]))
    return axis, [np.where(np.abs(x[:, axis]) < STILL * spans[axis], 0.0, x[:, axis]) for x in moved], one, unit


def _curve(ax, x, y, words, colour):
    """A branch in runs of points of one word, each with its line; neighbours share the critical point between them."""
    turns = [0, *(np.flatnonzero(words[1:] != words[:-1]) + 1).tolist(), len(words)]
    for first, last in zip(turns, turns[1:], strict=False):
        own, (dashes, width) = slice(max(0, first - 1), last), LINES[words[first]]
        ax.plot(x[own], y[own], color=colour, ls=dashes, lw=width, zorder=2 if words[first] == "unstable" else 3)


def _criticals(ax, result, x, y, unit):
    """Markers and loads of the critical points, on the branch where they were found."""
    room, told = [share * np.ptp(np.concatenate(of)) for share, of in zip(CROWDED, (x, y), strict=True)], []
    for k, row in enumerate(result.details["critical"]):
        at = dict(result.details["branches"][row["branch"]]["critical"])[k]
        here, load = x[row["branch"]][at], y[row["branch"]][at]
        ax.plot([here], [load], KINDS[row["kind"]], color=style.MISS, mfc="#ffffff", mew=1.4, ms=6, zorder=6)
        if all(abs(here - a) > room[0] or abs(load - b) > room[1] for a, b in told):
            told.append((here, load))
            turns = row["kind"] == "limit point"
            away = (0, 11 if row["before"] < row["after"] else -11) if turns else (9, -10)
            ax.annotate(f"{number(load)} {unit}".rstrip(), (here, load), away, textcoords="offset points", va="center",
                        ha="center" if turns else "left", fontsize=7.5, color=style.INK, zorder=7)  # fmt: skip


def _key(figure, result, words):
    """The legend: branches, what their points are called, kinds of critical points."""
    from matplotlib.lines import Line2D

    count = len(result.details["branches"])
    handles = [Line2D([], [], color=style.series(k)[0], lw=1.8, label=f"branch {k}") for k in range(count)]
    handles += [Line2D([], [], color="#555555", ls=LINES[word][0], lw=LINES[word][1], label=word) for word in words]
    for kind in dict.fromkeys(row["kind"] for row in result.details["critical"]):
        handles.append(Line2D([], [], color=style.MISS, marker=KINDS[kind], mfc="#ffffff", mew=1.4, ms=6, ls="",
                              label=kind))  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles) if len(handles) < 7 else 4)
