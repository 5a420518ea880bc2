"""The robot of a result in space: unloaded and solved, inputs as coloured lines, goals, frames."""

import numpy as np

from socontrol.mechanics.loads import Distributed, Wrench
from socontrol.model.rods import Rod
from socontrol.programs.postures.goals import AxisDirection, Path, Point, Pose, Shape
from socontrol.report import links, loop_scene, shapes, style
from socontrol.report.ellipsoid_scene import add_ellipsoids
from socontrol.report.scene import TRIAD, Scene, fit, paint, planes, project
from socontrol.report.tension_cables import add_lines
from socontrol.report.units import miss, number, with_unit

POSES = 7  # of a robot on a path
OBLIQUE = 15.0  # deg off the axes of the world at the least: else labels of an axis seen from its end fall together
SPREAD = 7  # arrows of a distributed load


def robot_figure(result):
    """Figure in space with two projections; None without numbers to draw."""
    question, q = result.question, result.arrays.get("q")
    if q is None or np.ndim(q) > 1 or not np.all(np.isfinite(q)):
        return None
    posed = shapes.Posed(question.loaded, q)
    scene = Scene(up=_up(question.robot))
    before = _add_before(scene, result, posed)
    add_robot(scene, posed, style.SOFT, 2)
    scale, slack_ones = add_lines(scene, result, posed, _size(scene))
    size = _size(scene)
    legend = [*before, (_patch(style.SOFT, "#888888"), _solved_as(result, _on_path(result))), *slack_ones]
    legend += _add_goals(scene, result, posed, size) + _add_loads(scene, posed, size)
    legend += add_ellipsoids(scene, result, posed, size) + loop_scene.add_loops(scene, posed, size)
    for name in shapes.ends(question.robot):
        scene.triad(posed.place(name), 0.11 * size)
    scene.settle_unit()
    return _composed(scene, result, posed, scale, legend)


def _up(robot):
    g = np.array([float(x) for x in robot.description.gravity])
    return -g / np.linalg.norm(g) if np.any(g) else np.array([0, 0, 1.0])


def _size(scene):
    lower, upper = scene.box()
    return float(np.max(upper - lower))


def add_robot(scene, posed, colour, layer, pale=False, corners=None):
    """Skins of rods, links and joints, and a plate where the robot stands; `pale`: all in one colour, no plate."""
    plates, rigid = links.plates(posed), []
    for name, segment in posed.robot.tree.segments.items():
        if isinstance(segment, Rod):
            scene.skin(shapes.rod_skin(posed, name, corners), colour, layer)
            if segment.parent not in plates:
                rigid += [("link", skin) for skin in links.mount(posed, posed.robot.tree.of[name][0], posed.slim)]
        else:
            rigid += links.link_skins(posed, name, plates)
    rigid += [("link", skin) for skin in links.arms(posed, plates)]
    for part, skin in rigid:
        scene.skin(skin, colour if pale else {"link": style.LINK, "joint": style.JOINT}[part], layer)
    if not pale:
        add_plates(scene, posed, layer)


def add_plates(scene, posed, layer):
    """A plate under every piece that stands in the world."""
    for i, piece in enumerate(posed.pieces):
        if piece.parent is None and (piece.is_rod or piece.size < 6):
            g = posed.bases[i]
            radius = 1.5 * (posed.end_radius(i, 0.0) or 2 * posed.slim)
            axis = g[:3, 0] if piece.is_rod else scene.up
            shift = 0.0 if piece.is_rod else 1.9 * posed.slim
            top = g[:3, 3] - shift * axis
            scene.skin(shapes.bar(top - 0.25 * radius * axis, top, radius), style.JOINT, layer)


def _add_before(scene, result, posed):
    """The unloaded shape where its loops are closed, or for a path the robot at several of its waypoints; legend
    entries [(handle, text)]."""
    robot, path = result.question.loaded, result.arrays.get("path.q")
    if path is not None and len(path) > 1:
        last = len(path) - 1
        steps = np.unique(np.round(np.linspace(0, last, POSES + 1)).astype(int))[:-1]
        for k in steps:
            add_robot(scene, shapes.Posed(robot, path[k]), style.GHOST, 1, pale=True)
        return [(_patch(style.GHOST, "#b9c1c9"), "at other waypoints")]
    q = shapes.unloaded(robot)
    for name, value in (result.question.coordinates or {}).items():
        k = robot.coordinates.index(name)
        q[k] = posed.q[k] if value is not None else q[k]
    ghost = shapes.Posed(robot, q)
    if not loop_scene.closed(robot, ghost):
        return []
    add_robot(scene, ghost, style.GHOST, 1, pale=True)
    return [(_patch(style.GHOST, "#b9c1c9"), "unloaded")]


def _patch(colour, edge):
    from matplotlib.patches import Patch

    return Patch(fc=colour, ec=edge, lw=0.6)


def _add_goals(scene, result, posed, size):
    """Goals, and a line to each from what was reached when they differ; legend entries [(handle, text)]."""
    from matplotlib.lines import Line2D

    entries = []
    for n, (name, goal) in enumerate((getattr(result.question, "goals", None) or {}).items()):
        colour, marker = style.GOALS[n % len(style.GOALS)], style.MARKERS[n % len(style.MARKERS)]
        numbers = np.array(result.details.get("targets", {}).get(f"target.{name}", ()), dtype=float).ravel()
        if isinstance(goal, Path):
            _add_path(scene, result, goal)
            entries.append((Line2D([], [], color=style.GOAL, marker=".", lw=1), f"goal {name}: waypoints"))
            continue
        numbers = numbers if len(numbers) == len(goal.numbers()) else np.array(goal.numbers())
        here = posed.place(goal.on, goal.at)
        if isinstance(goal, AxisDirection):
            entries.append(_add_axis(scene, goal, name, numbers, here, size, colour))
            continue
        symbol = Line2D([], [], color=colour, marker=marker, mfc="none", mew=1.6, ls="none")
        entries.append((symbol, f"goal {name}"))
        missed = []
        for point, reached in _spots(scene, goal, numbers, posed, here, size, colour):
            scene.mark(point, colour, marker=marker, size=9)
            if np.linalg.norm(point - reached) > 1e-3 * size:
                scene.stroke([reached, point], style.MISS, width=1.4, layer=9)
                missed.append(float(np.linalg.norm(point - reached)))
        if missed:
            most = f"{'at most ' * (len(missed) > 1)}{miss(max(missed), 'm')}"
            entries.append((Line2D([], [], color=style.MISS, lw=1.4), f"{name} missed by {most}"))
    return entries


def _add_axis(scene, goal, name, direction, here, size, colour):
    """An arrow along the wanted direction, and a dotted one along the direction reached when they differ."""
    from matplotlib.lines import Line2D

    start, wanted = here[:3, 3], direction / np.linalg.norm(direction)
    scene.arrow(start, 0.24 * size * wanted, colour, 0.006 * size)
    reached = here[:3, :3] @ np.array(goal.axis, dtype=float)
    if np.linalg.norm(reached / np.linalg.norm(reached) - wanted) > 1e-2:
        scene.stroke([start, start + 0.2 * size * reached], colour, width=1.6, style=":", layer=9)
    return Line2D([], [], color=colour, marker=">", ms=5, lw=1.8), f"goal {name}: direction"


def _add_loads(scene, posed, size):
    """Applied forces and moments at the posture drawn; legend entries [(handle, text)]."""
    from matplotlib.lines import Line2D

    loads = {name: load for name, load in (posed.robot.description.loads or {}).items() if _told(load)}
    largest = {  # by kind: so that arrows of one kind compare
        (kind, key): max((_norm(load, key) for load in loads.values() if isinstance(load, kind)), default=0.0)
        for kind in (Wrench, Distributed)
        for key in ("force", "moment")
    }
    entries = []
    for n, (name, load) in enumerate(loads.items()):
        colour, spread = style.LOADS[n % len(style.LOADS)], isinstance(load, Distributed)
        frames = posed.rod(load.on)[1] if spread else [posed.place(load.on, load.at)]
        frames = [frames[k] for k in np.linspace(0, len(frames) - 1, SPREAD).round().astype(int)] if spread else frames
        for key, unit, heads in (("force", "N", 1), ("moment", "N m", 2)):
            if not _norm(load, key):
                continue
            share = _norm(load, key) / largest[Distributed if spread else Wrench, key]
            length = (0.1 if spread else 0.24) * size * (0.5 + 0.5 * share)
            for g in frames:
                R = g[:3, :3] if load.axes == "body" else np.eye(3)
                along = R @ np.array(getattr(load, key), dtype=float) / _norm(load, key)
                scene.arrow(g[:3, 3], length * along, colour, (0.003 if spread else 0.006) * size, heads)
            # the double arrow of a moment: it turns about the arrow, right-handed
            marker = ">" if heads == 1 else r"$\gg$"
            handle = Line2D([], [], color=colour, marker=marker, ms=5 if heads == 1 else 8, lw=1.8)
            size_of = _norm(load, key)
            value = f"{number(size_of, 3)} {unit}" if size_of >= 0.1 else with_unit(size_of, unit, 3)
            entries.append((handle, f"load {name} {value}{'/m' if spread else ''}"))
    return entries


def _told(load):
    """Whether a load is of a kind that can be drawn, in plain numbers."""
    kind = isinstance(load, Wrench | Distributed)
    return kind and all(isinstance(x, int | float) for x in (*load.force, *load.moment))


def _norm(load, key):
    return float(np.linalg.norm(getattr(load, key)))


def _spots(scene, goal, numbers, posed, here, size, colour):
    """(target, reached) points of a goal; what else shows it is added to the scene."""
    if isinstance(goal, Point):
        point = here[:3, 3].copy()
        point[goal.rows] = numbers
        for k in set(range(3)) - set(goal.rows):
            e = np.eye(3)[k] * 0.12 * size
            scene.stroke([point - e, point + e], colour, width=1.0, style=":", layer=9)
        return [(point, here[:3, 3])]
    if isinstance(goal, Pose):
        g = np.eye(4)
        g[:3, :3], g[:3, 3] = _rotation(numbers[3:]), numbers[:3]
        scene.triad(g, 0.16 * size, width=0.9)
        return [(g[:3, 3], here[:3, 3])]
    if isinstance(goal, Shape):
        points = numbers.reshape(-1, 3)
        return [(p, posed.place(goal.on, s.at)[:3, 3]) for p, s in zip(points, goal.target, strict=True)]
    return []


def _rotation(vector):
    return shapes.exponential(np.concatenate([vector, np.zeros(3)]))[:3, :3]


def _add_path(scene, result, goal):
    points = np.array(result.arrays.get("path.target", goal.waypoints()))
    scene.stroke(points, style.GOAL, width=1.6, layer=9)
    track = result.arrays.get("path.tip")
    solved = 0 if track is None else len(track)
    if solved < len(points):
        scene.mark(points[solved], style.MISS, marker="X", size=8)


def _composed(scene, result, posed, scale, legend):
    """The figure: space on the left, two projections on the right, keys below."""
    lower, upper = scene.box()
    span, shown = upper - lower, planes(scene)
    (i, k), (j, m) = shown
    beside = k == m and span[i] + span[j] < 2.4 * span[k]
    figure = style.new_figure(9.2, 4.4 if beside else 5.2)
    left, right = figure.subfigures(1, 2, width_ratios=[1, 1.1] if beside else [1.35, 1])
    ratios = (
        {"width_ratios": [span[i], span[j]]} if beside else {"height_ratios": [span[k] / span[i], span[m] / span[j]]}
    )
    panels = right.subplots(*((1, 2) if beside else (2, 1)), gridspec_kw=ratios)
    for panel, plane in zip(panels, shown, strict=True):
        panel.set_label("plane")
        project(panel, scene, plane)
        _add_gravity(panel, result.question.robot, plane)
    space = left.add_axes([0.0, 0.1, 1.0, 0.9], projection="3d", label="space")
    paint(space, scene, _azimuth(scene, posed), 18.0)
    if scale is not None:
        _add_scale(left, left.add_axes([0.2, 0.1, 0.6, 0.022], label="scale"), scale)
    _add_legend(right, legend)
    style.title(figure, f"{result.name}: {_title(result)}")
    box, foot = left.bbox, 0.17 if scale is not None else 0.02
    fit(figure, space, (0.02 * box.width, foot * box.height, 0.96 * box.width, (0.93 - foot) * box.height))
    return figure


def _azimuth(scene, posed):
    """A view 60 deg off the direction in which the robot reaches out sideways, and along no axis of the world."""
    v = scene.vertical()[0]
    tips = [posed.place(name)[:3, 3] for name in shapes.ends(posed.robot)]
    reach = max((t - posed.bases[0][:3, 3] for t in tips), key=np.linalg.norm)
    a, b = reach[(v + 1) % 3], reach[(v + 2) % 3]
    if np.hypot(a, b) < 0.05 * np.linalg.norm(reach):
        return -60.0
    wanted = float(np.degrees(np.arctan2(b, a)) - 60.0)
    square = 90.0 * round(wanted / 90.0)
    return square + float(np.copysign(max(OBLIQUE, abs(wanted - square)), wanted - square))


def _add_gravity(ax, robot, plane):
    """An arrow that shows where things fall, where the plane can show it."""
    g = np.array([float(x) for x in robot.description.gravity])[list(plane)]
    if np.linalg.norm(g) < 1e-9:
        return
    x, y = 22 * g / np.linalg.norm(g) * np.array([1 - 2 * ax.xaxis_inverted(), 1 - 2 * ax.yaxis_inverted()])
    ax.annotate(
        "g",
        (1.04, 0.9),
        (-x, -y),
        xycoords="axes fraction",
        textcoords="offset points",
        annotation_clip=False,
        ha="center",
        va="center",
        fontsize=8.5,
        color=style.INK,
        arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.0, "shrinkA": 1, "shrinkB": 0},
    )


def _add_scale(figure, ax, scale):
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(scale.norm, scale.cmap), cax=ax, orientation="horizontal")
    limits = f" (limits up to {number(scale.largest)} {scale.name})" if scale.cut else ""
    bar.set_label(f"{scale.kind} [{scale.name}]{limits}" if scale.unit else f"{scale.kind}, {scale.name}")
    bar.outline.set_linewidth(0.4)


def _add_legend(figure, entries):
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    frame = tuple(Line2D([], [], color=colour, lw=1.8) for colour in TRIAD)
    handles = [
        *entries[:14],
        (frame, "axes x, y, z of a frame"),
    ]
    widest = 0.4 + 0.058 * max(len(text) for _, text in handles)  # inches
    figure.legend(
        *zip(*handles, strict=True),
        loc="outside lower right",
        ncols=max(1, min(4, int(figure.bbox.width / figure.dpi / widest))),
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.2)},
    )


def _title(result):
    if "path.q" not in result.arrays:
        return _solved_as(result, False)
    solved = result.details.get("waypoints_solved", len(result.arrays["path.q"]))
    count = result.details.get("waypoints", solved)
    if solved == count:
        return f"{count} waypoints solved, drawn at the last"
    shown = "nearest posture to the next" if result.status.outcome == "infeasible" else "drawn at the last solved"
    return f"{solved} of {count} waypoints solved, {shown}"


def _on_path(result):
    return "path.q" in result.arrays and len(result.arrays["path.q"]) > 1


def _solved_as(result, on_path):
    if result.status.outcome == "infeasible":
        return "nearest posture"
    return "at the last waypoint" if on_path else "solved" if result.status.solved else result.status.outcome
