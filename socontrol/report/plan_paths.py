"""A plan in space: the robot at several times, tracks of its ends, obstacles to scale, goals and waypoints."""

import numpy as np

from socontrol.programs.postures.goals import AxisDirection, Point, Pose, Shape
from socontrol.report import shapes, style
from socontrol.report.motion import Motion
from socontrol.report.motion_shapes import composed, drawn
from socontrol.report.obstacle_shapes import EDGE, FACE
from socontrol.report.scene import TRIAD

TOP = 60  # layer above postures and tracks
REPLAY = style.MISS


def path_figure(result):
    """Figure of a plan in space; None without numbers or without its question."""
    motion = Motion.of(result)
    if motion is None:
        return None
    scene, colours = composed(motion)
    entries = [*_obstacles(motion), *replayed(scene, motion), *_moments(scene, motion)]
    figure = drawn(motion, scene, colours)
    key(figure, entries)
    state = "" if result.status.solved else f", {result.status.outcome}"
    ends = f"end of {motion.tips[0]}" if len(motion.tips) == 1 else "the ends"
    count = len(motion.overlaid)
    style.title(figure, f"{result.name}: {count} times{state}; thin line: track of {ends}")
    return figure


def _obstacles(motion):
    """Entries of the key for obstacles."""
    from matplotlib.patches import Patch

    names = list(motion.near)
    if not names:
        return []
    word = f"obstacle {names[0]}" if len(names) == 1 else f"{len(names)} obstacles"
    entries = [(Patch(fc=FACE, ec=EDGE), word)]
    if any(one.shell is not None for one in motion.near.values()):
        entries.append((symbol(EDGE, "", ls="--", lw=0.7), "its clearance" if len(names) == 1 else "their clearances"))
    return entries


def replayed(scene, motion):
    """Add tracks of the ends when the inputs are run in a simulation; entries of the key."""
    shown = False
    for name in motion.tips:
        track = motion.result.arrays.get(f"replay.{name}.position")
        if track is not None and np.all(np.isfinite(track)):
            keep = motion.thinned()
            scene.stroke(track[keep[keep < len(track)]], REPLAY, width=1.3, style=":", layer=TOP - 1)
            shown = True
    return [(symbol(REPLAY, "", ls=":", lw=1.3), "re-simulated")] if shown else []


def _moments(scene, motion):
    """Marks of what start, waypoints and end ask for, each at the time it holds; entries of the key."""
    size = float(np.max(motion.reach[1] - motion.reach[0]))
    entries = [(symbol(style.INK, "o", ms=4.5), "start"), (symbol(style.INK, "s", ms=4.5), "end")]
    for name in motion.tips:
        for k, marker in ((0, "o"), (-1, "s")):
            scene.mark(motion.track(name)[k], style.INK, marker=marker, size=5, face="#ffffff", layer=TOP)
    colour = iter(style.GOALS * 50)
    for name, moment, time in moments(motion.result):
        k = int(np.argmin(np.abs(motion.t - time)))
        if name != "end":
            tint, marker = next(colour), "D"
            for tip in motion.tips:
                scene.mark(motion.track(tip)[k], tint, marker=marker, size=5, face="#ffffff", layer=TOP)
            entries.append((symbol(tint, marker, ms=4.5), f"waypoint {name}"))
        for goal_name, goal in (moment.goals or {}).items():
            tint = next(colour)
            _add_goal(scene, goal, motion.posed(k), tint, size)
            entries.append((symbol(tint, "+", ms=9), f"goal {goal_name}"))
    return entries


def moments(result):
    """[(name, record, time)] of waypoints and end."""
    question, stop = result.question, float(result.arrays["t"][-1])
    passed = (question.waypoints or {}).items()
    return [*((name, x, float(stop * x.share if x.time is None else x.time)) for name, x in passed),
            ("end", question.end, stop)]  # fmt: skip


def _add_goal(scene, goal, posed, colour, size):
    """A cross where a point is wanted, a frame for a pose, an arrow for a direction."""
    numbers, here = np.array(goal.numbers(), dtype=float), posed.place(goal.on, goal.at)
    points = []
    if isinstance(goal, Point):
        point = here[:3, 3].copy()
        point[goal.rows] = numbers
        points = [point]
    elif isinstance(goal, Pose):
        points = [numbers[:3]]
        axes = shapes.exponential(np.array([*numbers[3:], 0.0, 0.0, 0.0]))[:3, :3].T
        for axis, tint in zip(axes, TRIAD, strict=True):
            scene.stroke([numbers[:3], numbers[:3] + 0.14 * size * axis], tint, width=1.4, layer=TOP)
    elif isinstance(goal, AxisDirection):
        scene.arrow(here[:3, 3], 0.16 * size * numbers / np.linalg.norm(numbers), colour, 0.004 * size, layer=TOP)
    elif isinstance(goal, Shape):
        points = numbers.reshape(-1, 3)
    for point in points:
        scene.mark(point, colour, marker="+", size=11, layer=TOP + 1)


def symbol(colour, marker, **look):
    """Handle of a mark, or with `ls` of a line, for a key."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, marker=marker or None, mfc="#ffffff", **{"ls": "none", **look})


def key(figure, entries):
    """What marks mean, below the drawing."""
    owner = figure.subfigs[-1] if figure.subfigs else figure
    wide = owner.bbox.width / figure.dpi
    widest = 0.4 + 0.062 * max(len(text) for _, text in entries)  # inches
    owner.legend(*zip(*entries, strict=True), loc="outside lower center", ncols=max(1, min(5, int(wide / widest))))
