"""The robot at several times of a motion, in one view at one scale, coloured by time, and the tracks of its ends."""

import numpy as np

from socontrol.report import loop_scene, style
from socontrol.report.motion import Motion, time_colours
from socontrol.report.obstacle_shapes import add_obstacles
from socontrol.report.portrait import add_plates, add_robot
from socontrol.report.scene import Scene, fit, paint, planes, project, shaded

WIDEST, HIGHEST = 8.6, 6.0  # inches
THIN = 1.1  # points: rods thinner than this on paper are drawn as lines


def shapes_figure(result):
    """Figure of a motion's postures; None for anything but a simulation with numbers."""
    motion = Motion.of(result)
    if motion is None:
        return None
    figure = drawn(motion, *composed(motion))
    ends = motion.tips
    what = f"track of the end{'s' * (len(ends) > 1)} of {', '.join(ends[:3])}{' ...' if len(ends) > 3 else ''}"
    title = f"{result.name}: {len(motion.overlaid)} times{motion.ending()}; thin line: {what}"
    style.title(figure, title)
    return figure


def drawn(motion, scene, colours):
    """Figure of a composed scene: in the plane of the motion, or in space with two projections beside."""
    draw = _spatial if motion.view is None else _planar
    figure, owner, place = draw(motion, scene)
    _time_bar(owner, place, motion, colours)
    return figure


def composed(motion):
    """(scene, colours): postures in the colour of their time, later ones over earlier ones, tracks and obstacles."""
    scene, colours = Scene(up=motion.up), time_colours(len(motion.overlaid))
    for n, k in enumerate(motion.overlaid):
        add_posture(scene, motion.posed(k), colours(n), layer=3 + 2 * n)
    add_plates(scene, motion.posed(0), 1)
    top = 2 * len(motion.overlaid) + 5
    for name in motion.tips:
        track = motion.track(name)[motion.thinned()]
        if np.max(np.ptp(track, axis=0)) > 1e-6 * motion.robot.length:
            scene.stroke(track, style.INK, width=0.7, layer=top)
    loop_scene.add_loops(scene, motion.posed(motion.overlaid[-1]), motion.robot.length, top)
    add_obstacles(scene, motion, top)
    scene.settle_unit()
    return scene, colours


def add_posture(scene, posed, colour, layer, corners=None):
    """One posture in one colour; its rods' centrelines as lines, too, so that slender ones can be seen."""
    add_robot(scene, posed, colour, layer, pale=True, corners=corners)
    for name, indices in posed.robot.tree.of.items():
        if indices and posed.pieces[indices[0]].is_rod:
            scene.stroke(posed.rod(name)[1][:, :3, 3], colour, width=THIN, layer=layer - 1)


def flat(ax, scene, view, box):
    """Fill an axes with the scene seen square to any plane; `box`: (lower [2], upper [2]) in metres."""
    from matplotlib.collections import PolyCollection

    one, unit = scene.unit
    for polygons, tints, layer in shaded(scene, view.toward):
        order = np.argsort(polygons.mean(1) @ view.toward)
        polygons = (polygons @ view.across)[order]
        ax.add_collection(PolyCollection(polygons, facecolors=tints[order], edgecolors=tints[order], lw=0.3,
                                         zorder=layer), autolim=False)  # fmt: skip
    for s in scene.strokes:
        for points, colour, width, layer in s.parts(view.toward):
            ax.plot(*(points @ view.across / one).T, s.style, color=colour, lw=width, zorder=layer)
    for m in scene.marks:
        ax.plot(*(m.point @ view.across / one)[:, None], m.marker, color=m.colour, mfc=m.face, ms=m.size, mew=1.4,
                zorder=m.layer)  # fmt: skip
    lower, upper = box
    ax.set(xlim=(lower[0] / one, upper[0] / one), ylim=(lower[1] / one, upper[1] / one))
    ax.set(xlabel=f"{view.labels[0]} [{unit}]", ylabel=f"{view.labels[1]} [{unit}]")
    ax.set_aspect("equal")
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.set_axisbelow(True)


def frame_of(points, least=0.22):
    """(lower [2], upper [2]) around points [k x 2], with room to breathe and no side below `least` of the other."""
    lower, upper = points.min(0), points.max(0)
    size = float(np.max(upper - lower)) or 1.0
    middle, half = (lower + upper) / 2, np.maximum((upper - lower) / 2, 0.5 * least * size) + 0.05 * size
    return middle - half, middle + half


def extent(scene):
    """All points [k x 3] of a scene."""
    lines = [s.points for s in scene.strokes] + [m.point[None] for m in scene.marks]
    return np.concatenate([*(q.reshape(-1, 3) for q, _, _ in scene.skins), *lines])


def _planar(motion, scene):
    """One large view in the plane of motion; the place of the time bar is right of it or below."""
    box = frame_of(extent(scene) @ motion.view.across)
    width, height = box[1] - box[0]
    scale = min((WIDEST - 1.6) / width, (HIGHEST - 1.1) / height)
    wide = width > 1.4 * height
    figure = style.new_figure(max(5.6, scale * width + (0.9 if wide else 1.9)), scale * height + (1.7 if wide else 1.0))
    ax = figure.add_subplot(label="plane")
    flat(ax, scene, motion.view, box)
    _gravity(ax, motion)
    side = "bottom" if wide else "right"
    return figure, figure, {"ax": ax, "location": side, "aspect": 40, "shrink": 0.8, "pad": 0.02}


def _gravity(ax, motion):
    g = -motion.up @ motion.view.across
    if not np.any([float(x) for x in motion.robot.description.gravity]) or np.linalg.norm(g) < 0.3:
        return
    x, y = 22 * g / np.linalg.norm(g)
    ax.annotate("g", (0.97, 0.9), (-x, -y), xycoords="axes fraction", textcoords="offset points", ha="center",
                va="center", fontsize=8.5, color=style.INK, zorder=99,
                arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.0, "shrinkA": 1})  # fmt: skip


def _spatial(motion, scene):
    """Space on the left, two projections on the right."""
    lower, upper = scene.box()
    span, shown = upper - lower, planes(scene)
    (i, k), (j, m) = shown
    beside = k == m and span[i] + span[j] < 1.6 * span[k]
    tall = 4.2 * span[k] / (span[i] + span[j]) if beside else 3.6 * (span[k] / span[i] + span[m] / span[j])
    figure = style.new_figure(9.2, float(np.clip(tall + (1.0 if beside else 1.5), 3.8, 5.6)))
    left, right = figure.subfigures(1, 2, width_ratios=[1, 1.1] if beside else [1.35, 1])
    ratios = (
        {"width_ratios": [span[i], span[j]]} if beside else {"height_ratios": [span[k] / span[i], span[m] / span[j]]}
    )
    panels = right.subplots(*((1, 2) if beside else (2, 1)), gridspec_kw=ratios)
    for panel, plane in zip(panels, shown, strict=True):
        panel.set_label("plane")
        project(panel, scene, plane)
    space = left.add_axes([0.0, 0.1, 1.0, 0.9], projection="3d", label="space")
    v = scene.vertical()[0]
    away = motion.track(motion.tips[0]).mean(0) - motion.posed(0).bases[0][:3, 3]
    a, b = away[(v + 1) % 3], away[(v + 2) % 3]
    flat_reach = np.hypot(a, b) > 0.05 * motion.robot.length
    paint(space, scene, float(np.degrees(np.arctan2(b, a)) - 60) if flat_reach else -60.0, 18.0)
    box = left.bbox
    fit(figure, space, (0.02 * box.width, 0.21 * box.height, 0.96 * box.width, 0.72 * box.height))
    return figure, left, {"cax": left.add_axes([0.15, 0.1, 0.7, 0.022]), "location": "bottom"}


def _time_bar(figure, place, motion, colours):
    """The colour of each time drawn, a box each."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    count = len(motion.overlaid)
    norm = BoundaryNorm(np.arange(count + 1), count)
    bar = figure.colorbar(ScalarMappable(norm, colours), spacing="uniform", **place)
    bar.ax.set_label("time")
    bar.set_ticks(np.arange(count) + 0.5, labels=motion.labels)
    bar.ax.tick_params(which="both", length=0)
    bar.set_label(motion.quantity)
    bar.outline.set_linewidth(0.4)
