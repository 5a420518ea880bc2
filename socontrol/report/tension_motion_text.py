"""Tensions of a motion in words: ranges and limits, the force they leave unmet, what a simulation under them does."""

import numpy as np

from socontrol.report import tension_deviation
from socontrol.report.columns import line, say
from socontrol.report.inputs_text import ranges_table
from socontrol.report.motion_text import what_loops_bear
from socontrol.report.said import attempts, headline
from socontrol.report.tension_course import Course
from socontrol.report.tension_text import at_limits, ranges
from socontrol.report.units import number, percent

UNMET = 0.01  # of the largest force: more is worth a look


def render(result, console, verbose=0):
    """Print the tensions of a motion; `verbose` 1 adds the attempts."""
    headline(result, console)
    course = Course.of(result)
    if course is None:
        return
    count, stop = len(course.t), float(course.t[-1])
    say(console, "duration", f"{number(stop, 5)} s in {count} samples")
    line(console, "")
    ranges_table(result, console, course.u)
    ranges(course, console)
    at_limits(course, console)
    _unmet(result, console)
    _simulated(result, console)
    if result.question.robot.loops:
        line(console, "")
        what_loops_bear(result, console)
    attempts(result, console, verbose)
    line(console, "")


def _unmet(result, console):
    value = result.values.get("motion.unmet")
    if value is not None:
        text = f"{percent(value.value)} of the largest force at most that the motion asks for and no tension gives"
        say(console, "unmet", text, "bold yellow" if value.value > UNMET else "")


def _simulated(result, console):
    """How far the simulation strays from the motion, when, and beside what."""
    ends = tension_deviation.of_ends(result)
    if "replay.tip" not in result.values or ends is None:
        asked = getattr(result.question.motion, "simulate", True)
        say(console, "simulated", "the simulation failed" if asked else "not asked for", "bold yellow" * asked)
        return
    name, time, _ = ends.worst
    text = f"the end of {name} within {_metres(result['replay.tip'])} of the motion"
    if "replay.tip_share" in result.values:
        text += f" ({percent(result['replay.tip_share'])} of the robot's length)"
    say(console, "simulated", f"{text}, furthest at {number(time, 3)} s")
    path = tension_deviation.of_path(result)
    if "replay.path" in result.values and path is not None:
        size = float(np.max(np.ptp(result.arrays["target"], axis=0)))
        share = f" ({percent(result['replay.path'] / size)} of its width)" if size > 0 else ""
        say(console, "", f"the {path.worst[0]} within {_metres(result['replay.path'])} of the timed path{share}, "
            f"furthest at {number(path.worst[1], 3)} s")  # fmt: skip


def _metres(x):
    """`0.07 mm`: with unit and digits of the first sentence."""
    return f"{number(1e3 * x, 3)} mm" if x < 1 else f"{number(x, 3)} m"
