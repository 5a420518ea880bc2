"""Tensions along a path or in a motion: strips of inputs, lengths, their rates and the way off the wanted motion."""

from dataclasses import replace

import numpy as np

from socontrol.report import style, tension_deviation
from socontrol.report.plan_limits import Quantity, told
from socontrol.report.plan_strips import add_ticks, draw_strip, in_parts, key, near, stacked
from socontrol.report.tension_course import Course

HIGH = {"tension": 1.9, "pressure": 1.9}  # inches of an axes; the others: PLAIN
PLAIN = 1.35
SAME = 1e-9  # of the last time: times this close are one


def strips_figure(result):
    """Figure of a path or a motion; None without numbers."""
    course = Course.of(result)
    if course is None:
        return None
    rows, left_out = _rows(course)
    heights = [HIGH.get(strip.quantity.title, PLAIN) for _, strip in rows]
    figure = style.new_figure(8.2, 1.1 + sum(heights))
    place, shown = figure.add_gridspec(1, 1)[0], set()
    axes = stacked(figure, place, len(rows), heights)
    for ax, (axis, strip) in zip(axes, rows, strict=True):
        shown |= draw_strip(ax, axis, strip)
    _dress(axes, course)
    shown |= add_ticks(axes, _waypoints(course), "waypoint")
    figure.legend(handles=[h for h in key() if h.get_label() in shown], loc="outside lower center", ncols=4)
    state = "" if result.status.solved else f", {result.status.outcome}"
    note = f"\nnot drawn: {'; '.join(left_out)}" if left_out else ""
    what = "a motion" if course.moving else "a path"
    style.title(figure, f"{result.name}: tensions of {what}{state}{note}")
    return figure


def _waypoints(course):
    """Times of the waypoints as far as there is a course, None without times."""
    times = course.result.arrays.get("path.t") if course.timed else None
    return None if times is None else np.asarray(times)[np.asarray(times) <= course.t[-1] + SAME * abs(course.t[-1])]


def _rows(course):
    """([(Course of the axis, Strip)], what is left out)."""
    found = [(course, x) for x in (*course.tensions(), *course.changes())]
    rates = [x for x in course.rates()[1] if not course.moving or any(x.limits(k) for k in range(len(x.names)))]
    found += [_stairs(course, x) for x in rates] + _off(course)
    rows, left_out = [], []
    for axis, quantity in found:
        strips, less = in_parts(quantity, list(range(len(quantity.names))), quantity.units[0])
        rows += [(axis, strip) for strip in strips]
        left_out += [less] if less else []
        left_out += [x for strip in strips for x in _far(strip)]
    return rows, left_out


def _far(strip):
    """[the limits of a strip that are too far off to be drawn, in words], or []."""
    quantity, values = strip.quantity, strip.quantity.values[:, list(strip.chosen)]
    reach = float(np.min(values)), float(np.max(values))
    ends = sorted({x for k in strip.chosen for x in quantity.limits(k) if not near(quantity, x, *reach)})
    if not ends:
        return []
    shown = " to ".join(told(x, strip.unit) for x in dict.fromkeys((ends[0], ends[-1])))
    return [f"limit{'s' * (len(ends) > 1)} of {' '.join(quantity.title.split())}, {shown}"]


def _stairs(course, rate):
    """(Course of the axis, a rate as it is: constant between two rows, so that each value stands at both)."""
    ends = Course(course.result, np.repeat(course.t, 2)[1:-1], True, np.repeat(course.u, 2, axis=0)[1:-1], None)
    return ends, replace(rate, values=np.repeat(rate.values, 2, axis=0))


def _off(course):
    """How far the simulation is off the wanted motion, and off the timed path; both are one for an only tracked end."""
    if not course.moving:
        return []
    rows, result = [], course.result
    ends, path = tension_deviation.of_ends(result), tension_deviation.of_path(result)
    if ends is not None and path is not None and path.names == tuple(f"end of {name}" for name in ends.names):
        ends = None
    for title, found in (("off the\nmotion", ends), ("off the\npath", path)):
        if found is not None:
            free, count = np.full(len(found.names), np.inf), len(found.t)
            quantity = Quantity(title, found.names, ("m",) * len(found.names), found.distances, -free, free)
            rows.append((Course(result, found.t, True, course.u[:count], None), quantity))
    return rows


def _dress(axes, course):
    """One axis for all: time, or waypoints."""
    axes[-1].set_xlabel("time [s]" if course.timed else "waypoint")
    if course.t[-1] > course.t[0]:
        axes[0].set_xlim(course.t[0], course.t[-1])
    if not course.timed:
        axes[-1].xaxis.get_major_locator().set_params(integer=True)
