"""Curves of a motion over time: energies and works, inputs and the way of the ends."""

import numpy as np

from socontrol.report import style
from socontrol.report.motion import Motion
from socontrol.report.motion_text import KINDS, NOISE, WORKS
from socontrol.report.units import QUANTITY, SMALL, readable


def dress(ax, motion, level=True):
    """What all axes over time share: limits, a line at 0 (`level`), a grid."""
    if motion.t[-1] > motion.t[0]:
        ax.set_xlim(motion.t[0], motion.t[-1])
    if level:
        ax.axhline(0, color="#999999", lw=0.7, zorder=1)
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.set_axisbelow(True)
    ax.margins(y=0.1)


def energies_figure(result):
    """What the robot holds, what was done to it, and the rest that neither explains; None without a motion."""
    motion = Motion.of(result)
    if motion is None:
        return None
    energy, work = result.arrays["energy"], result.arrays["work"]
    held = energy - [0.0, 0.0, energy[0, 2]]
    total = held.sum(axis=1)
    largest = float(max(np.max(np.abs(held)), np.max(np.abs(work))))
    if not largest > 0:
        return None
    shown = [k for k in range(work.shape[1]) if np.max(np.abs(work[:, k])) > NOISE * largest]
    figure = style.new_figure(7.2, 5.4 if shown else 3.9)
    axes = figure.subplots(2 + bool(shown), 1, sharex=True, height_ratios=[2] * (1 + bool(shown)) + [1])
    keep, t = motion.thinned(), motion.t[motion.thinned()]
    one, unit = readable("J", largest)
    for k, name in enumerate(KINDS):
        if np.max(np.abs(held[:, k])) > NOISE * largest:
            label = "gravitational,\nfrom the start" if name == "gravitational" else name
            axes[0].plot(t, held[keep, k] / one, color=style.SERIES[k], lw=1.3, label=label)
    axes[0].plot(t, total[keep] / one, "--", color=style.INK, lw=1.3, label="total")
    axes[0].set_ylabel(f"energy [{unit}]")
    for n, k in enumerate(shown):
        label = "work of " + tuple(WORKS.values())[k]
        axes[1].plot(t, work[keep, k] / one, color=style.SERIES[3 + n], lw=1.3, label=label)
    if shown:
        axes[1].plot(t, (total - total[0])[keep] / one, "--", color=style.INK, lw=1.3, label="change of the total")
        axes[1].set_ylabel(f"work done [{unit}]")
    _unexplained(axes[-1], t, (total - total[0] - work.sum(axis=1))[keep])
    for ax in axes:
        dress(ax, motion)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    style.title(figure, f"{result.name}: energies and works{motion.ending()}")
    return figure


def _unexplained(ax, t, rest):
    """The rest on its own scale, in the unit that suits it."""
    size = float(np.max(np.abs(rest)))
    one, unit = next(((one, unit) for one, unit in SMALL["J"] if size >= one), SMALL["J"][-1])
    ax.plot(t, rest / one, color=style.MISS, lw=1.1, label="change less work")
    ax.set_ylabel(f"unexplained [{unit}]")
    if not size > 0:
        ax.set_ylim(-1, 1)


def histories_figure(result):
    """Inputs, given lengths and driven joints over time, the way of the ends beside; None unless any of them moves."""
    motion = Motion.of(result)
    if motion is None:
        return None
    u, robot = np.asarray(result.arrays["u"]).reshape(len(motion.t), -1), motion.robot
    used = [k for k in range(robot.m) if np.any(u[:, k])]
    units = list(dict.fromkeys(robot.input_units[k] for k in used))
    driven, given = result.question.driven, _given_lengths(result)
    if not any(np.ptp(u[:, k]) > 0 for k in used) and not driven and not given:
        return None
    kinds = list(dict.fromkeys(robot.coordinate_units[i] for i in driven))
    motors = _motor_forces(result)
    rows = len(units) + len(kinds) + len(motors) + bool(given)
    figure = style.new_figure(9.4, max(4.2, 0.9 + 1.7 * rows))
    left, right = figure.subfigures(1, 2, width_ratios=[1.15, 1])
    axes = np.ravel(left.subplots(rows, 1, sharex=True, squeeze=False))
    for ax, unit in zip(axes, units, strict=False):
        curves = {robot.inputs[k]: u[:, k] for k in used if robot.input_units[k] == unit}
        _curves(ax, motion, curves, unit, f"input {QUANTITY.get(unit, '')}".strip())
    for ax, unit in zip(axes[len(units) :], kinds, strict=False):
        curves = {robot.coordinates[i]: motion.q[:, i] for i in driven if robot.coordinate_units[i] == unit}
        _curves(ax, motion, curves, unit, f"driven {QUANTITY.get(unit, '')}".strip())
    for ax, (unit, curves) in zip(axes[len(units) + len(kinds) :], motors.items(), strict=False):
        _curves(ax, motion, curves, unit, f"motor {QUANTITY.get(unit, 'force')}")
    if given:
        _curves(axes[-1], motion, given, "m", "length", level=False)
    axes[-1].set_xlabel("time [s]")
    _tip_ways(right, motion)
    idle = [name for k, name in enumerate(robot.inputs) if k not in used]
    still = f"; inputs zero throughout: {', '.join(idle[:8])}{' ...' if len(idle) > 8 else ''}" if idle else ""
    style.title(figure, f"{result.name}: inputs and ends{motion.ending()}{still}")
    return figure


def _motor_forces(result):
    """{unit: {coordinate: force [k]}} of the motors that move driven joints; those of strains are left out."""
    robot, found = result.question.robot, {}
    for i in result.question.driven:
        name, unit = robot.coordinates[i], {"rad": "N m", "m": "N"}.get(robot.coordinate_units[i])
        if unit and f"holding.{name}" in result.arrays:
            found.setdefault(unit, {})[name] = np.asarray(result.arrays[f"holding.{name}"])
    return found


def _given_lengths(result):
    """{name: lengths [k]} along the route of the inputs that are given by length, motor angle or volume."""
    names, lengths = result.details.get("held") or (), result.arrays.get("lengths")
    if lengths is None:
        return {}
    return {name: np.asarray(lengths)[:, result.question.robot.inputs.index(name)] for name in names}


def _curves(ax, motion, curves, unit, title, level=True):
    """Curves of one unit; `level`: with a line at 0."""
    keep = motion.thinned()
    one, name = readable(unit, *(x for values in curves.values() for x in (values.min(), values.max())))
    for n, (label, values) in enumerate(curves.items()):
        colour, dash = style.series(n)
        ax.plot(motion.t[keep], values[keep] / one, dash, color=colour, lw=1.4, label=label)
    ax.set_ylabel(f"{title} [{name}]")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(curves) - 1) // 10)
    dress(ax, motion, level)


def _tip_ways(figure, motion):
    """x, y, z of the ends over time, one axes a direction, on one scale."""
    keep = motion.thinned()
    tracks = {name: motion.track(name)[keep] for name in motion.tips[: len(style.SERIES)]}
    one, unit = readable("m", *(x for track in tracks.values() for x in (track.min(), track.max())))
    axes = figure.subplots(3, 1, sharex=True)
    span = 1.15 * max(float(np.max(np.ptp(track[:, k]))) for track in tracks.values() for k in range(3)) / one
    for k, ax in enumerate(axes):
        for n, (name, track) in enumerate(tracks.items()):
            ax.plot(motion.t[keep], track[:, k] / one, color=style.SERIES[n], lw=1.3, label=name)
        low, high = ax.get_ylim()
        own = max(span, high - low) or 1.0
        dress(ax, motion)
        ax.set_ylim((low + high - own) / 2, (low + high + own) / 2)
        ax.set_ylabel(f"{'xyz'[k]} [{unit}]")
    axes[0].set_title(f"end of {motion.tips[0]}" if len(tracks) == 1 else "ends", loc="left", fontsize=8.5)
    if len(tracks) > 1:
        axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlabel("time [s]")
