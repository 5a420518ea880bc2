"""One look for all figures: fonts, colours that every kind of colour vision tells apart."""

import textwrap

import numpy as np

from socontrol.report.units import readable

SOFT, GHOST, LINK, JOINT = "#b9d3e8", "#e2e2e2", "#aab2ba", "#5d6873"
GOAL, MISS, BAR, LIMIT, INK = "#7B3294", "#D55E00", "#0072B2", "#222222", "#333333"
LOOP = "#1d2733"  # where a loop closes
GOALS = (GOAL, "#D6278A", "#1B7F8C", "#8C6D31")  # colours of several goals, none of them a frame's
MARKERS = ("o", "s", "D", "^", "v", "P")
LOADS = ("#111111", "#4F6D8F", "#6B4A2B")
# Okabe and Ito's, then two more
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31", "#555555")
DASHES = ("-", "--", "-.", ":")
LITTLE = 0.5  # of the limit: tensions below are coloured by their own range
SLACK = "#7f8790"
LETTERS = 13  # an inch of a title
STYLE = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#555555",
    "xtick.color": INK,
    "ytick.color": INK,
    "mathtext.default": "regular",
}


def series(k):
    """(colour, dash) of the k-th curve; no two of the first 32 agree."""
    return SERIES[k % len(SERIES)], DASHES[k // len(SERIES) % len(DASHES)]


def new_figure(width, height):
    """A Figure outside pyplot, so that drawing leaves nothing behind and needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def title(figure, text):
    """A title at the left of a Figure, its lines broken where the figure ends."""
    most = int(figure.get_figwidth() * LETTERS)
    lines = [part for line in text.split("\n") for part in textwrap.wrap(line, most, break_long_words=False)]
    figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=10)


def ramp():
    """Colours from idle (pale) to the limit (dark red)."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["YlOrRd"](np.linspace(0.22, 1.0, 128)), "inputs")


class InputScale:
    """The colour of each input: by value when all of `chosen` share a unit, else by share of the limits.

    cables: all are tensions; where these stay far below their limits, the colours end at the largest one.
    """

    def __init__(self, question, u, chosen, cables=False):
        from matplotlib.colors import Normalize

        robot = question.robot
        lower, upper = limits = question.input_limits()
        values = np.atleast_2d(u)
        units = {robot.input_units[k] for k in chosen}
        self.bounds = [self._ends(lower[k], upper[k], values[:, k]) for k in range(robot.m)]
        low = min((self.bounds[k][0] for k in chosen), default=0.0)
        high = max((self.bounds[k][1] for k in chosen), default=1.0)
        largest = max((float(np.max(np.abs(values[:, k]))) for k in chosen), default=0.0)
        self.kind, self.cut = ("tension" if cables else "input"), cables and 0 < largest < LITTLE * high
        limit = high
        low, high = (0.0, largest) if self.cut else (low, high)
        self.unit = units.pop() if len(units) == 1 else None
        self.one, self.name = readable(self.unit, low, limit) if self.unit else (0.01, "% of the range")
        self.norm = Normalize(low / self.one, high / self.one) if self.unit else Normalize(0, 100)
        self.largest, self.cmap, self.limits = limit / self.one, ramp(), limits

    @staticmethod
    def _ends(lower, upper, values):
        low = lower if np.isfinite(lower) else min(0.0, float(values.min()))
        high = upper if np.isfinite(upper) else max(0.0, float(values.max()))
        return (low, high) if high > low else (low, low + 1.0)

    def colour(self, k, value):
        low, high = self.bounds[k]
        shown = value if self.unit else (value - low) / (high - low)
        return self.cmap(self.norm(shown / self.one))
