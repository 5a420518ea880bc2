"""Cables and chambers in a drawing, coloured by their inputs; the tension along cables that rub, in its own figure."""

import numpy as np

from socontrol.report import shapes, style
from socontrol.report.tension_course import slack, tendons
from socontrol.report.tension_table import tells
from socontrol.report.units import readable

DRAWN = 260  # points, about the size of a drawing in space
OUTSIDE = 1.3  # of the rods' radius: a cable further off runs beside the robot and is never behind its surface
PARTS = 24  # of one colour each, of a cable whose tension changes along it


def add_lines(scene, result, posed, size):
    """Add the tendons and chambers of a robot `size` metres large; the scale of their colours, or None without any,
    and legend entries."""
    robot, u = result.question.robot, result.arrays["u"]
    lines = {k: shapes.cables(posed, k) for k in range(robot.m)}
    chosen = [k for k in lines if lines[k]]
    if not chosen:
        return None, []
    scale = style.InputScale(result.question, u, chosen, cables=set(chosen) <= set(tendons(robot)))
    idle = slack(result.question, u) & tells(result)
    radii = [posed.end_radius(i, 0.0) for i, piece in enumerate(posed.pieces) if piece.is_rod] or [np.inf]
    slim, usual = (DRAWN * 2 * f(radii) / size for f in (min, np.median))  # points
    for k in chosen:
        for points, outward, chamber in lines[k]:
            if chamber:
                look = {"width": min(3.4, 0.1 * slim)}
            elif idle[k]:
                look = {"width": 0.5, "rim": 0.4, "style": "--"}
            else:
                look = {"width": float(np.clip(0.13 * usual, 0.8, 2.4)), "rim": 0.6}
            if not chamber and np.max(np.linalg.norm(outward, axis=1)) > OUTSIDE * max(radii):
                outward = np.zeros_like(outward)
            for part, value in [(slice(None), 0.0)] if idle[k] else along(result, k, points):
                colour = style.SLACK if idle[k] else scale.colour(k, value)
                scene.stroke(points[part], colour, outward=outward[part], behind=style.SOFT, **look)
    return scale, [(_slack_symbol(), "slack cable")] * bool(np.any(idle))


def _slack_symbol():
    from matplotlib.lines import Line2D

    return Line2D([], [], color=style.SLACK, ls="--", lw=1.0)


def rubbing(result):
    """{name: (s [k] m along the cable, tension [k] N)} of the cables with friction."""
    arrays, names = result.arrays, () if result.question is None else result.question.robot.inputs
    found = {name: (arrays.get(f"cable.{name}.s"), arrays.get(f"cable.{name}.tension")) for name in names}
    return {name: (np.ravel(s), np.ravel(T)) for name, (s, T) in found.items() if s is not None and T is not None}


def along(result, k, points):
    """[(slice, tension)] of a line's points [j x 3]: one part, or PARTS of them where friction changes the tension."""
    name, known = result.question.robot.inputs[k], rubbing(result)
    if name not in known or len(points) < 3:
        return [(slice(None), result.arrays["u"][k])]
    s, tension = known[name]
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    cuts = np.unique(np.round(np.linspace(0, len(points) - 1, PARTS + 1)).astype(int))
    middles = np.interp((way[cuts[:-1]] + way[cuts[1:]]) / (2 * way[-1]), s / s[-1], tension)
    return [(slice(a, b + 1), T) for a, b, T in zip(cuts, cuts[1:], middles, strict=False)]


def cables_figure(result):
    """Tension against the way along each cable with friction, base to tip; None without any."""
    known = {name: pair for name, pair in rubbing(result).items() if np.all(np.isfinite(np.r_[pair]))}
    if not known:
        return None
    figure = style.new_figure(5.6, 3.4)
    ax = figure.subplots()
    longest, strongest = (max(float(np.max(pair[i])) for pair in known.values()) for i in (0, 1))
    (one, unit), (force, unit_of_force) = readable("m", longest), readable("N", strongest)
    for n, (name, (s, tension)) in enumerate(known.items()):
        colour, dash = style.series(n)
        ax.plot(s / one, tension / force, dash, color=colour, lw=1.5, label=name)
    ax.set(xlabel=f"along the cable from its motor [{unit}]", ylabel=f"tension [{unit_of_force}]")
    ax.set_xlim(0, longest / one)
    ax.set_ylim(0, 1.06 * strongest / force if strongest > 0 else 1)
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(known) - 1) // 12)
    where = " at the last waypoint" if "path.q" in result.arrays else ""
    style.title(figure, f"{result.name}: tension along the cables{where}")
    return figure
