"""Loops in a drawing: a symbol by kind where each closes, and a dashed line across what stays open."""

import numpy as np

from socontrol.mechanics.loops import LOOPS
from socontrol.report import style
from socontrol.report.links import loop_end
from socontrol.report.shapes import matrix
from socontrol.report.units import miss

OPEN = 1e-3  # of the drawing's size, or rad: less is closed
SYMBOLS = {  # kind: (marker, whether it is filled); what turns is round
    "revolute": ("o", False),
    "prismatic": ("s", False),
    "helical": ("h", False),
    "cylindrical": ("p", False),
    "planar": ("d", False),
    "spherical": ("o", True),
    "fixed": ("X", True),
}
NAMED = 3  # loops of one kind whose names a legend has room for


def add_loops(scene, posed, size, layer=10):
    """Add the loops of a robot; legend entries [(handle, text)]."""
    from matplotlib.lines import Line2D

    entries, by_kind = [], {}
    for name, loop in posed.robot.loops.items():
        point, off, angle = gap(posed, loop)
        kind = next(kind for kind, record in LOOPS.items() if type(loop) is record)
        by_kind.setdefault(kind, []).append(name)
        _mark(scene, point, kind, layer)
        if np.linalg.norm(off) > OPEN * size:
            scene.stroke([point - off, point], style.LOOP, width=1.6, style="--", layer=layer)
            _mark(scene, point - off, kind, layer)
            line = Line2D([], [], color=style.LOOP, lw=1.6, ls="--")
            entries.append((line, f"{name} open by {miss(float(np.linalg.norm(off)), 'm')}"))
        elif angle > OPEN:
            entries.append((Line2D([], [], ls="none"), f"{name} open by {miss(angle, 'rad')}"))
    told = [(_symbol(kind), f"{kind} loop: {_listed(names)}") for kind, names in by_kind.items()]
    return told + entries


def closed(robot, posed):
    """Whether every loop is closed, to the eye."""
    found = [gap(posed, loop) for loop in robot.loops.values()]
    return all(np.linalg.norm(off) <= OPEN * robot.length and angle <= OPEN for _, off, angle in found)


def gap(posed, loop):
    """Where `a` of a loop is [3], how far that is from where the joint lets it be [3], world; and the angle [rad]."""
    g_a, g_b = (loop_end(posed, end) for end in (loop.a, loop.b))
    g = np.linalg.inv(g_b) @ g_a
    rows, units = matrix(loop.rows(g[:3, :3], g[:3, 3])).ravel(), np.array(loop.units)
    ways = matrix(loop.Phi_perp())[3:, units == "m"]
    off = ways / np.linalg.norm(ways, axis=0) @ rows[units == "m"]
    return g_a[:3, 3], g_b[:3, :3] @ off, float(np.linalg.norm(rows[units == "rad"]))


def _look(kind):
    marker, filled = SYMBOLS[kind]
    return {"marker": marker, "face": style.LOOP if filled else "#ffffff"}


def _mark(scene, point, kind, layer):
    look = _look(kind)
    scene.mark(point, "#ffffff", size=7.0, layer=layer, marker=look["marker"], face="#ffffff")  # seen on dark skins
    scene.mark(point, style.LOOP, size=5.0, layer=layer, **look)


def _symbol(kind):
    from matplotlib.lines import Line2D

    look = _look(kind)
    return Line2D([], [], color=style.LOOP, marker=look["marker"], mfc=look["face"], mew=1.4, ms=5, ls="none")


def _listed(names):
    return ", ".join(names) if len(names) <= NAMED else f"{names[0]} to {names[-1]}"
