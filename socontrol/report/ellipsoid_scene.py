"""Ellipsoids of translation in a drawing: their three principal ellipses and semi-axes at their place, each kind to a
scale of its own that the legend states."""

import numpy as np

from socontrol.report import style
from socontrol.report.ellipsoid_text import of_kind
from socontrol.report.units import number, readable, with_unit

SHARE = 0.2  # of the drawing's size: the longest semi-axis of the kind drawn largest
SMALLER = 0.8  # each further kind beside the one before, so that they can be told apart
CORNERS = 72


def add_ellipsoids(scene, result, posed, size):
    """Add the ellipsoids of a result; legend entries [(handle, text)]."""
    from matplotlib.lines import Line2D

    told, entries = result.details.get("ellipsoids"), []
    if not told:
        return entries
    centre = posed.place(told["on"], told["at"])[:3, 3]
    for k, kind in enumerate(told["kinds"]):
        axes, directions, unit = of_kind(result, kind, "translation")
        finite = axes[np.isfinite(axes)]
        longest = float(np.max(finite, initial=0.0))
        if not longest > 0:
            continue
        colour = style.GOALS[k % len(style.GOALS)]
        drawn = SHARE * SMALLER**k * size
        _add(scene, centre, axes, directions, drawn / longest, {"colour": colour, "layer": 8, "width": 1.3})
        one, name = readable(unit, longest)
        stiff = "; dotted: rigid" if np.isinf(axes).any() else ""
        scale = f"{number(longest / one, 3)} {name}".rstrip() + f" drawn as {with_unit(drawn, 'm', 2)}"
        entries.append((Line2D([], [], color=colour, lw=1.5), f"{kind}: {scale}{stiff}"))
    return entries


def _add(scene, centre, axes, directions, factor, look):
    """Ellipses in the planes of two finite axes each, the semi-axes, and dotted lines along infinite ones."""
    around = np.linspace(0, 2 * np.pi, CORNERS + 1)[:, None]
    longest = factor * np.max(axes[np.isfinite(axes)])
    arms = [factor * s * d if np.isfinite(s) else None for s, d in zip(axes, directions, strict=True)]
    for i in range(3):
        a, b = (arms[j] for j in range(3) if j != i)
        if a is not None and b is not None:
            scene.stroke(centre + np.cos(around) * a + np.sin(around) * b, **look)
        if arms[i] is None:
            end = longest * directions[i]
            scene.stroke([centre - end, centre + end], **{**look, "style": ":"})
        else:
            scene.stroke([centre - arms[i], centre + arms[i]], **{**look, "width": 0.7})
