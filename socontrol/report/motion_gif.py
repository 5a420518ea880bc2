"""A motion as an animated GIF: one scale, limits that hold for the whole motion, the time in a corner.

Only outputs of the simulation are shown, none made up between them; how long each stays on the screen follows from
its time, in steps of 10 ms as the format has them.
"""

import io
from dataclasses import dataclass

import numpy as np

from socontrol.report import loop_scene, style
from socontrol.report.motion import Motion
from socontrol.report.motion_shapes import add_posture, extent, flat, frame_of
from socontrol.report.obstacle_shapes import add_obstacles
from socontrol.report.portrait import add_plates
from socontrol.report.scene import Scene, planes, project

MOST_FRAMES = 150
FRAME = 0.04  # s on the screen, at least: viewers slow down shorter ones
SHORTEST, LONGEST = 1.0, 6.0  # s on the screen that need neither slow motion nor quick motion
NICE = tuple(m * 10.0**e for e in range(-6, 7) for m in (1, 2, 5))
LARGEST = 1_000_000  # bytes
RESOLUTIONS = (80, 60, 45, 32)  # dots an inch, taken in order until the file is small enough
PROBES = 6  # frames whose size tells that of all
COLOURS, CORNERS = 64, 12
BODY = "#4f86b5"


@dataclass(frozen=True)
class Film:
    """indices: outputs shown; times [s] on the screen of each; speed: seconds of the motion in a second of the film."""

    indices: np.ndarray
    times: np.ndarray
    speed: float


def film(t):
    """The Film of outputs at times t [k]: in real time where that takes 1 to 6 s."""
    span = float(t[-1] - t[0])
    speed = 1.0
    if span > LONGEST:
        speed = next(s for s in NICE if span / s <= LONGEST)
    elif 0 < span < SHORTEST:
        speed = next((s for s in reversed(NICE) if span / s >= SHORTEST), NICE[0])
    wanted = np.arange(t[0], t[-1] + 1e-9 * span, FRAME * speed) if span > 0 else t[:1]
    indices = np.unique([int(np.argmin(np.abs(t - x))) for x in wanted[: MOST_FRAMES - 1]] + [len(t) - 1])
    begin = np.round((t[indices] - t[0]) / speed * 100) / 100
    return Film(indices, np.maximum(np.append(np.diff(begin), 1.0), 0.02), speed)


def write_gif(result, path, progress=None):
    """Write the GIF of a result that moves; the Film shown, or None where there is no motion."""
    import matplotlib as mpl

    motion = Motion.of(result)
    if motion is None:
        return None
    shown = film(motion.t)
    with mpl.rc_context(style.STYLE):
        whole, few = _limits(motion), shown.indices[:: max(1, len(shown.indices) // PROBES)]
        for dots in RESOLUTIONS:
            share = len(_gif(list(_images(motion, few, whole, shown.speed, dots)), [FRAME] * len(few))) / len(few)
            if share * len(shown.indices) > 0.9 * LARGEST and dots != RESOLUTIONS[-1]:
                continue
            images = list(_images(motion, shown.indices, whole, shown.speed, dots, progress))
            data = _gif(images, shown.times)
            if len(data) < LARGEST:
                break
    path.write_bytes(data)
    return shown


def _images(motion, indices, whole, speed, dots, progress=None):
    """Frames as images of one size."""
    from PIL import Image

    for n, k in enumerate(indices):
        if progress is not None:
            progress(n + 1, len(indices), f"frame {n + 1} of {len(indices)}")
        data = io.BytesIO()
        frame(motion, k, whole, speed).savefig(data, dpi=dots)
        yield Image.open(data).convert("RGB")


def _gif(images, times):
    """Bytes of a GIF: images in the colours of the one in the middle, each for its time [s]."""
    from PIL import Image

    palette = images[len(images) // 2].quantize(COLOURS)
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    data = io.BytesIO()
    small[0].save(data, "GIF", save_all=True, append_images=small[1:], loop=0, optimize=False,
                  duration=[int(round(1000 * x)) for x in times])  # fmt: skip
    return data.getvalue()


def _limits(motion):
    """Scene of the whole motion in outline, for limits, planes and the unit: skins of some postures and all tracks."""
    whole = Scene(up=motion.up)
    for k in motion.thinned(24):
        add_posture(whole, motion.posed(k), BODY, 3, corners=CORNERS)
    add_plates(whole, motion.posed(0), 1)
    for name in motion.tips:
        whole.stroke(motion.track(name)[motion.thinned()], style.INK)
    for points in motion.places:
        whole.stroke(points, style.INK)
    add_obstacles(whole, motion, 10)
    whole.settle_unit()
    return whole


def frame(motion, k, whole, speed):
    """Figure of one output, in the limits of the scene `whole`."""
    scene = Scene(up=motion.up, unit=whole.unit)
    add_plates(scene, motion.posed(0), 1)
    posed = motion.posed(k)
    add_posture(scene, posed, BODY, 3, corners=CORNERS)
    loop_scene.add_loops(scene, posed, motion.robot.length)
    for name in motion.tips:
        scene.stroke(motion.track(name)[: k + 1], style.MISS, width=0.8, layer=9)
    add_obstacles(scene, motion, 10)
    draw = _plane if motion.view is not None else _planes
    figure = draw(motion, scene, whole)
    rate = "" if speed == 1 else f"   ({speed:g} x real time)"
    figure.text(0.99, 0.985, f"t = {motion.t[k]:.{_decimals(motion.t)}f} s{rate}", ha="right", va="top", fontsize=9)
    figure.text(0.01, 0.985, motion.result.name, ha="left", va="top", fontsize=9)
    return figure


def _decimals(t):
    """Digits behind the point that tell outputs apart."""
    step = float(np.min(np.diff(t))) if len(t) > 1 else 1.0
    return next((d for d in range(9) if abs(round(step, d) - step) < 0.01 * step), 9)


def _fixed(figure, *cells):
    """Axes at fixed places (left, bottom, width, height), so that no frame shifts; `plane` is their label."""
    figure.set_layout_engine("none")
    return [figure.add_axes(cell, label="plane") for cell in cells]


def _plane(motion, scene, whole):
    box = frame_of(extent(whole) @ motion.view.across)
    width, height = box[1] - box[0]
    scale = min(5.2 / width, 4.0 / height)
    w, h = max(scale * width, 2.6) + 0.9, scale * height + 0.95
    figure = style.new_figure(w, h)
    (ax,) = _fixed(figure, (0.75 / w, 0.55 / h, 1 - 0.9 / w, 1 - 0.95 / h))
    flat(ax, scene, motion.view, box)
    return figure


def _planes(motion, scene, whole):
    """Two projections beside each other, on one scale."""
    lower, upper = whole.box()
    span, shown = upper - lower, planes(whole)
    scale = min(6.2 / sum(span[i] for i, _ in shown), 3.6 / max(span[j] for _, j in shown))
    w = scale * sum(span[i] for i, _ in shown) + 1.9
    h = scale * max(span[j] for _, j in shown) + 0.95
    figure = style.new_figure(w, h)
    first = scale * span[shown[0][0]]
    cells = [(x / w, 0.55 / h, scale * span[i] / w, scale * span[j] / h)
             for x, (i, j) in zip((0.75, first + 1.65), shown, strict=True)]  # fmt: skip
    for ax, plane in zip(_fixed(figure, *cells), shown, strict=True):
        project(ax, scene, plane)
        i, j = plane
        ax.set_xlim(lower[i] / whole.unit[0], upper[i] / whole.unit[0])
        low, high = lower[j] / whole.unit[0], upper[j] / whole.unit[0]
        ax.set_ylim(*((high, low) if ax.yaxis_inverted() else (low, high)))
    return figure
