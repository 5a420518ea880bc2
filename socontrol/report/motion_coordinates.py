"""Coordinates of a motion over time: joints by unit, strains by rod and coloured along it."""

import numpy as np

from socontrol.model.bases import STRAIN_UNITS, STRAINS
from socontrol.model.rods import Rod
from socontrol.report import style
from socontrol.report.motion import Motion
from socontrol.report.motion_curves import dress
from socontrol.report.motion_text import NOISE
from socontrol.report.units import QUANTITY, readable

MOST_RODS = 3  # with a column of axes each; more share their axes, coloured by rod


def coordinates_figure(result):
    """Coordinates over time: joints by unit, strains by rod, coloured along the rod; None without a motion."""
    motion = Motion.of(result)
    if motion is None or not motion.robot.n:
        return None
    from matplotlib.ticker import MaxNLocator

    joints, rods = _joint_groups(motion), _rod_groups(motion)
    if len(rods) > 3 and all(len(row) == 1 for row in rods):  # two columns, not one tower
        rods = [sum(rods[k : k + 2], []) for k in range(0, len(rods), 2)]
    columns = max([1, *(len(row) for row in rods)])
    rows = len(joints) + len(rods)
    if not rows:
        return None
    figure = style.new_figure(max(6.8, 1.4 + 3.1 * columns), 0.8 + 1.75 * rows)
    grid, shared = figure.add_gridspec(rows, columns), None
    for r, (unit, chosen) in enumerate(joints.items()):
        shared = figure.add_subplot(grid[r, :], sharex=shared)
        _joint_curves(shared, motion, unit, chosen)
    lines = []
    for r, row in enumerate(rods, start=len(joints)):
        for c, (title, strain, chosen) in enumerate(row):
            shared = figure.add_subplot(grid[r, c], sharex=shared)
            lines.append(_strain_curves(shared, motion, title, strain, chosen))
    for n, ax in enumerate(figure.axes):
        last = n + columns >= len(figure.axes) or not rods
        ax.tick_params(labelbottom=last or (columns > 1 and n == len(joints) - 1))
        ax.set_xlabel("time [s]" if last and (rods or n + 1 == len(joints)) else "")
        ax.xaxis.set_major_locator(MaxNLocator(7 if columns == 1 else 5, steps=[1, 2, 5, 10]))
    _section_bar(figure, lines)
    zero = " (those that stay zero left out)" if _still(motion) else ""
    style.title(figure, f"{result.name}: coordinates{motion.ending()}{zero}")
    return figure


def _joint_groups(motion):
    """{unit: columns of q} of the coordinates of joints, without those that stay zero but for rounding."""
    groups = {}
    for i in _lumped(motion):
        unit = motion.robot.coordinate_units[i]
        least = NOISE * (motion.robot.length if unit == "m" else 1.0)
        if i in motion.driven or np.max(np.abs(motion.q[:, i])) > least:
            groups.setdefault(unit, []).append(i)
    return groups


def _lumped(motion):
    """Columns of q that are coordinates of joints."""
    pieces = (piece for piece in motion.robot.tree.pieces if not piece.is_rod)
    return [i for piece in pieces for i in range(*_span(piece.columns))]


def _moves(motion, chosen):
    """Whether any of these columns of q differs from 0 by more than rounding beside the strains of the robot."""
    rods = [i for p in motion.robot.tree.pieces if p.is_rod for i in range(*_span(p.columns))]
    largest = float(np.max(np.abs(motion.q[:, rods]), initial=0.0))
    return bool(np.max(np.abs(motion.q[:, chosen]), initial=0.0) > NOISE * largest)


def _strain(name):
    last = name.rpartition(".")[2]
    return last if last in STRAINS else None


def _columns_of(motion, rod, strain):
    """Columns of q of one strain of a rod, from base to tip."""
    indices = (i for k in motion.robot.tree.of[rod] for i in range(*_span(motion.robot.tree.pieces[k].columns)))
    return [i for i in indices if _strain(motion.robot.coordinates[i]) == strain]


def _span(columns):
    return columns.start, columns.stop


def _rods(motion):
    return [name for name, segment in motion.robot.tree.segments.items() if isinstance(segment, Rod)]


def _rod_groups(motion):
    """Rows of [(title, strain, {rod: columns of q})], one row a strain; strains that stay zero are left out."""
    rows = []
    for strain in dict.fromkeys(filter(None, map(_strain, motion.robot.coordinates))):
        chosen = {rod: _columns_of(motion, rod, strain) for rod in _rods(motion)}
        chosen = {rod: own for rod, own in chosen.items() if own}
        if not _moves(motion, [i for own in chosen.values() for i in own]):
            continue
        if len(chosen) > MOST_RODS:
            rows.append([("", strain, chosen)])
        else:
            rows.append([(rod, strain, {rod: own}) for rod, own in chosen.items()])
    return rows


def _still(motion):
    """Whether any coordinate is left out."""
    strains = set(filter(None, map(_strain, motion.robot.coordinates)))
    drawn = sum(map(len, _joint_groups(motion).values()))
    return len(_rod_groups(motion)) < len(strains) or drawn < len(_lumped(motion))


def _with_gaps(motion, keep, i):
    """Times and values of a joint's coordinate, with a gap where its pose was written by other coordinates.

    A joint's turn is then the same less a full one: its coordinates jump by about 2 pi from one output to the next.
    """
    t, values = motion.t[keep], motion.q[keep, i]
    piece = next(p for p in motion.robot.tree.pieces if p.columns.start <= i < p.columns.stop)
    turns = [k for k in range(piece.columns.start, piece.columns.stop) if motion.robot.coordinate_units[k] == "rad"]
    if piece.size < 3 or not turns or i in motion.driven:
        return t, values
    jumps = np.flatnonzero(np.linalg.norm(np.diff(motion.q[keep][:, turns], axis=0), axis=1) > np.pi) + 1
    return np.insert(t, jumps, np.nan), np.insert(values, jumps, np.nan)


def _joint_curves(ax, motion, unit, chosen):
    keep = motion.thinned()
    one, name = readable(unit, *motion.q[:, chosen].ravel())
    driven = motion.driven
    for n, i in enumerate(chosen):
        colour, dash = style.series(n)
        t, values = _with_gaps(motion, keep, i)
        label = motion.robot.coordinates[i] + (" (driven)" if i in driven else "")
        ax.plot(t, values / one, dash, color=colour, lw=2.2 if i in driven else 1.3, label=label)
    ax.set_ylabel(f"joint {QUANTITY.get(unit, 'coordinate')} [{name}]")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(chosen) - 1) // 9)
    dress(ax, motion)


def _strain_curves(ax, motion, title, strain, chosen):
    """One strain over time; returns whether its colours run along the rod."""
    from matplotlib import colormaps

    keep, driven = motion.thinned(), motion.driven
    unit = STRAIN_UNITS[strain]
    unit, one = ("%", 0.01) if unit == "1" else (unit, 1.0)
    shades = colormaps["plasma"]
    for r, (rod, own) in enumerate(chosen.items()):
        for k, i in enumerate(own):
            colour = shades(0.88 * k / max(1, len(own) - 1)) if len(chosen) == 1 else style.series(r)[0]
            ax.plot(motion.t[keep], motion.q[keep, i] / one, "-", color=colour, lw=2.2 if i in driven else 1.1,
                    label=rod if k == 0 and len(chosen) > 1 else None)  # fmt: skip
    ax.set_ylabel(f"{strain.replace('_', ' ')} [{unit}]")
    if title:
        ax.set_title(title, loc="left", fontsize=8.5)
    if len(chosen) > 1:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(chosen) - 1) // 9)
    dress(ax, motion)
    return len(chosen) == 1 and max(map(len, chosen.values())) > 1


def _section_bar(figure, along):
    """What the colours of sections mean, where any axes uses them."""
    if not any(along):
        return
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    shades = ListedColormap(colormaps["plasma"](np.linspace(0, 0.88, 128)))
    rods = [ax for ax in figure.axes if not ax.get_ylabel().startswith("joint")]
    bar = figure.colorbar(ScalarMappable(Normalize(0, 1), shades), ax=rods, location="right", aspect=30, pad=0.02)
    bar.set_ticks([0, 1], labels=["base", "tip"])
    bar.set_label("section", labelpad=-14)
    bar.ax.set_label("sections")
    bar.outline.set_linewidth(0.4)
