"""A plan over time: coordinates, rates, inputs and what else it limits, one axes a unit, limits and nodes marked."""

from dataclasses import dataclass

import numpy as np

from socontrol.programs.question import read
from socontrol.report import style
from socontrol.report.motion import Motion
from socontrol.report.motion_curves import dress
from socontrol.report.plan_limits import Quantity, in_unit, quantities
from socontrol.report.plan_paths import moments

MOST_LINES = 8  # on an axes
MOST_AXES = 2  # of one quantity in one unit
MOST_ROWS = 5  # in one column
MOVES = ("coordinate", "rate", "clearance")
ALWAYS = ("coordinate", "rate", "input")  # drawn without limits, too
BEYOND, TICK = "#c9ced4", "#8a939c"


@dataclass(frozen=True)
class Strip:
    """One axes: the columns `chosen` of a quantity, all in one unit."""

    quantity: Quantity
    chosen: tuple
    unit: str


def strips_figure(result):
    """Figure of a plan over time; None without numbers. Many axes stand in two columns: what moves, what acts."""
    motion = Motion.of(result)
    if motion is None:
        return None
    rows, left_out = strips(motion)
    if not rows:
        return None
    moves = [s for s in rows if s.quantity.title in MOVES]
    acts = [s for s in rows if s.quantity.title not in MOVES]
    columns = [moves, acts] if len(rows) > MOST_ROWS and moves and acts else [rows]
    figure = style.new_figure(8.2 if len(columns) == 1 else 12.4, 1.1 + 1.4 * max(map(len, columns)))
    places, shown = figure.add_gridspec(1, len(columns)), set()
    for place, column in zip(places, columns, strict=True):
        axes = stacked(figure, place, len(column))
        for ax, strip in zip(axes, column, strict=True):
            shown |= draw_strip(ax, motion, strip)
        shown |= add_ticks(axes, motion.result.arrays.get("node.t"), "node of the mesh") | _add_waypoints(axes, motion)
    figure.legend(handles=[h for h in key() if h.get_label() in shown], loc="outside lower center", ncols=5)
    state = "" if result.status.solved else f", {result.status.outcome}"
    note = f"\nnot drawn: {left_out}" if left_out else ""
    style.title(figure, f"{result.name}: plan{state}{note}")
    return figure


def stacked(figure, place, count, heights=None):
    """`count` axes below one another in a cell of a grid, on one axis of time."""
    axes, rows = [], place.subgridspec(count, 1, height_ratios=heights)
    for r in range(count):
        axes.append(figure.add_subplot(rows[r], sharex=axes[0] if axes else None))
        axes[r].tick_params(labelbottom=r + 1 == count)
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    return axes


def strips(motion):
    """([Strip], a sentence about what is left out, empty where nothing is)."""
    rows, left_out = [], []
    for quantity in quantities(motion.result):
        strains = [k for k, unit in enumerate(quantity.units) if quantity.title in MOVES and unit.startswith("1")]
        strains = strains if len(strains) > MOST_LINES else []
        if strains and quantity.title == "coordinate":
            left_out.append(f"{len(strains)} strains (they stand in coordinates.png) and their rates")
        for unit in dict.fromkeys(quantity.units):
            chosen = [k for k, own in enumerate(quantity.units) if own == unit and k not in strains]
            if quantity.title not in ALWAYS:
                chosen = [k for k in chosen if quantity.limits(k)]
            made, less = in_parts(quantity, chosen, unit)
            rows += made
            left_out += [less] if less else []
    return rows, "; ".join(left_out)


def in_parts(quantity, chosen, unit):
    """([Strip] of the columns `chosen` of a quantity, what is left out in words, empty where nothing is)."""
    kept = _liveliest(quantity, chosen)
    parts = [kept[k : k + MOST_LINES] for k in range(0, len(kept), MOST_LINES)]
    less = f"{len(chosen) - len(kept)} {quantity.title}s that change less" if len(kept) < len(chosen) else ""
    return [Strip(quantity, tuple(part), unit) for part in parts], less


def leaves_out(result):
    """Whether strains of rods are too many for strips."""
    motion = Motion.of(result)
    return motion is not None and "strains" in strips(motion)[1]


def _liveliest(quantity, chosen):
    """Those columns that change most, as many as there is place for."""
    most = MOST_LINES * MOST_AXES
    return sorted(sorted(chosen, key=lambda k: -float(np.ptp(quantity.values[:, k])))[:most])


def draw_strip(ax, motion, strip):
    """Curves of one strip over the times of `motion`; labels of the key that they use."""
    quantity, chosen, keep = strip.quantity, list(strip.chosen), motion.thinned()
    values, used = quantity.values[:, chosen], set()
    low, high = float(values.min()), float(values.max())
    ends = [x for x in (*quantity.lower[chosen], *quantity.upper[chosen]) if near(quantity, x, low, high)]
    one, name = in_unit(strip.unit, low, high, *ends)
    for n, k in enumerate(chosen):
        colour, dash = style.series(n)
        ax.plot(motion.t[keep], quantity.values[keep, k] / one, dash, color=colour, lw=1.4, label=quantity.names[k])
        if quantity.replay is not None and np.all(np.isfinite(quantity.replay)):
            ax.plot(motion.t[keep], quantity.replay[keep, k] / one, ":", color=style.INK, lw=1.4, label="_replay")
            used.add("re-simulated")
    if _add_held(ax, motion, strip, one):
        used.add("held")
    ax.set_ylabel(f"{quantity.title}\n[{name}]")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1)
    dress(ax, motion)
    return used | _add_limits(ax, strip, one, (low, high))


def near(quantity, limit, low, high):
    """Whether a limit is near enough to values from `low` to `high` to be drawn."""
    if not np.isfinite(limit):
        return False
    span = max(high - low, abs(low), abs(high))
    return low - quantity.within * span <= limit <= high + quantity.within * span


def _add_limits(ax, strip, one, values):
    """Dashed limits, in the colour of their curve where it is not that of all; beyond what is that of all: hatched."""
    quantity, chosen, shared, own = strip.quantity, list(strip.chosen), [], []
    for side, ends in ((-1, quantity.lower[chosen]), (1, quantity.upper[chosen])):
        kept = [(n, x) for n, x in enumerate(ends) if near(quantity, x, *values)]
        if kept and len({x for _, x in kept}) == 1 and len(kept) == len(chosen):
            shared.append((side, kept[0][1] / one))
        else:
            own += [(style.series(n)[0], x / one) for n, x in kept]
    for colour, x in own:
        ax.axhline(x, color=colour, lw=0.9, ls=(0, (5, 3)), label="_limit")
    for _, x in shared:
        ax.axhline(x, color=style.LIMIT, lw=0.9, ls=(0, (5, 3)), label="_limit")
    if not (own or shared):
        return set()
    low, high = (x / one for x in values)
    low, high = min([low, *(x for _, x in own + shared)]), max([high, *(x for _, x in own + shared)])
    margin = 0.1 * ((high - low) or abs(high) or 1.0)
    low, high = low - margin, high + margin
    ax.set_ylim(low, high)
    for side, x in shared:
        ax.axhspan(*((low, x) if side < 0 else (x, high)), facecolor="none", edgecolor=BEYOND, hatch="////", lw=0,
                   zorder=0.5, label="_beyond")  # fmt: skip
    return {"limit"}


def _add_held(ax, motion, strip, one):
    """Circles where waypoints and end hold what is drawn; whether there are any."""
    own = {"coordinate": "coordinates", "rate": "rates", "input": "inputs"}.get(strip.quantity.title)
    if own is None:
        return False
    held = [(time, k, getattr(moment, own, None)) for _, moment, time in moments(motion.result) for k in strip.chosen]
    found = False
    for time, k, given in held:
        name = strip.quantity.names[k]
        if given and name in given:
            value = read(given[name], strip.unit, name) / one
            ax.plot([time], [value], "o", ms=5, mfc="none", mew=1.2, color=style.GOAL, clip_on=False, zorder=6,
                    label="_held")  # fmt: skip
            found = True
    return found


def add_ticks(axes, times, label):
    """Short ticks at times, that mean `label` in the key; None: no times."""
    if times is None:
        return set()
    for ax in axes:
        ax.plot(times, np.zeros(len(times)), "|", color=TICK, ms=5, mew=0.7, transform=ax.get_xaxis_transform(),
                clip_on=False, zorder=5, label="_nodes")  # fmt: skip
    return {label}


def _add_waypoints(axes, motion):
    """A line through all axes at each waypoint, its name above."""
    found = [(name, time) for name, _, time in moments(motion.result) if name != "end"]
    for name, time in found:
        for ax in axes:
            ax.axvline(time, color=style.GOAL, lw=0.8, ls=(0, (1, 2)), zorder=1, label="_waypoint")
        axes[0].annotate(name, (time, 1.0), (0, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
                         ha="center", fontsize=7.5, color=style.GOAL)  # fmt: skip
    return set()


def key():
    """Handles that say what lines, circles and ticks of strips mean."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=style.INK, ls=":", lw=1.4, label="re-simulated"),
        Line2D([], [], color=style.LIMIT, lw=0.9, ls=(0, (5, 3)), label="limit"),
        Line2D([], [], color=style.GOAL, marker="o", mfc="none", ls="none", ms=5, label="held"),
        *(Line2D([], [], color=TICK, marker="|", ls="none", ms=6, label=x) for x in ("node of the mesh", "waypoint")),
    ]
