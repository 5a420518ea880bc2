"""A drawing in space: skins, lines, marks and frames, painted into a 3D axes or into a plane of projection.

Lengths stand in metres until they are painted. Skins of one layer are sorted by depth together:
rods, links and joints hide each other rightly. Lines inside a skin are drawn over it, paler on the far side.
All axes keep one scale.
"""

from dataclasses import dataclass, field

import numpy as np

from socontrol.report import shapes

AXES = "xyz"
TRIAD = ("#D55E00", "#009E73", "#0072B2")  # x, y, z: told apart by every kind of colour vision
FITS = 4  # corrections of the size of a view: labels keep theirs, so that the first is not the last
FAR = 0.55  # share of the rod's colour in a line on its far side


@dataclass(frozen=True)
class Stroke:
    """A line [k x 3]; outward [k x 3] tells which parts look away from the viewer and fade into `behind`."""

    points: np.ndarray
    colour: object
    width: float = 1.0
    style: str = "-"
    outward: np.ndarray | None = None
    behind: str = "#ffffff"
    layer: int = 5
    rim: float = 0.9  # points by which a near run's dark edge is wider

    def parts(self, toward):
        """(points, colour, width, layer) to draw: far runs pale, near runs with a dark edge."""
        if self.outward is None:
            return [(self.points, self.colour, self.width, self.layer)]
        from matplotlib.colors import to_rgb

        facing = self.outward @ toward >= -1e-3 * np.max(np.abs(self.outward), initial=1e-12)
        pale = FAR * np.array(to_rgb(self.behind)) + (1 - FAR) * np.array(to_rgb(self.colour))
        turns = [0, *np.flatnonzero(np.diff(facing)), len(facing) - 1]
        drawn = []
        for a, b in zip(turns, turns[1:], strict=False):
            run, near = self.points[a : b + 1], facing[min(a + 1, len(facing) - 1)]
            if near:
                drawn.append((run, "#333333", self.width + self.rim, self.layer + 1))
            drawn.append((run, self.colour if near else pale, self.width, self.layer + 2 * near))
        return drawn


@dataclass(frozen=True)
class Mark:
    """A symbol at a point [3]."""

    point: np.ndarray
    colour: str
    marker: str = "o"
    size: float = 6.0
    face: str = "none"
    text: str = ""
    layer: int = 10


@dataclass
class Scene:
    """What is to be drawn, and the unit (its value in metres, its name) of the axes."""

    up: np.ndarray
    skins: list = field(default_factory=list)  # (quads [f x 4 x 3], colour, layer)
    strokes: list = field(default_factory=list)
    marks: list = field(default_factory=list)
    unit: tuple = (1e-3, "mm")

    def skin(self, quads, colour, layer=2):
        self.skins.append((quads, colour, layer))

    def stroke(self, points, colour, **look):
        self.strokes.append(Stroke(np.atleast_2d(points), colour, **look))

    def mark(self, point, colour, **look):
        self.marks.append(Mark(np.asarray(point), colour, **look))

    def triad(self, g, size, width=1.6):
        """The three axes of a frame [4 x 4]."""
        for k, colour in enumerate(TRIAD):
            self.stroke([g[:3, 3], g[:3, 3] + size * g[:3, k]], colour, width=width, layer=9)

    def arrow(self, tail, vector, colour, radius, heads=1, layer=8):
        """A solid arrow from `tail` along `vector` [3]; two heads show a moment about it."""
        tip, along = tail + vector, vector / np.linalg.norm(vector)
        head = min(5.5 * radius, 0.45 * np.linalg.norm(vector) / heads)
        self.skin(shapes.bar(tail, tip - heads * head * along, radius), colour, layer)
        for k in range(heads):
            self.skin(shapes.bar(tip - (k + 1) * head * along, tip - k * head * along, 2.4 * radius, 0.02 * radius),
                      colour, layer)  # fmt: skip

    def box(self):
        """(lower [3], upper [3]) of all there is, with room to breathe."""
        points = [quads.reshape(-1, 3) for quads, _, _ in self.skins]
        points += [s.points for s in self.strokes] + [m.point[None] for m in self.marks]
        points = np.concatenate(points)
        lower, upper = points.min(0), points.max(0)
        size = float(np.max(upper - lower)) or 1.0
        middle, half = (lower + upper) / 2, np.maximum((upper - lower) / 2, 0.14 * size) + 0.04 * size
        return middle - half, middle + half

    def settle_unit(self):
        lower, upper = self.box()
        self.unit = (1e-3, "mm") if np.max(upper - lower) < 2.0 else (1.0, "m")

    def vertical(self):
        """(axis, sign): the coordinate axis nearest to `up`, +1 if it points up."""
        axis = int(np.argmax(np.abs(self.up)))
        return axis, 1.0 if self.up[axis] >= 0 else -1.0


# Painting in space


def paint(ax, scene, azimuth=-60.0, elevation=18.0, zoom=1.0):
    """Fill a 3D axes, seen from `azimuth`, `elevation` [deg] with what is up in the world drawn upwards."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axis, sign = scene.vertical()
    lower, upper = (b / scene.unit[0] for b in scene.box())
    ax.set_proj_type("ortho")
    ax.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=(lower[2], upper[2]))
    ax.set_box_aspect(upper - lower, zoom=zoom)
    ax.view_init(elevation * sign, azimuth, 0 if sign > 0 else 180, vertical_axis=AXES[axis])
    ax.computed_zorder = False
    toward = viewer(ax)
    for polygons, colours, layer in shaded(scene, toward):
        ax.add_collection3d(
            Poly3DCollection(
                polygons,
                facecolors=colours,
                edgecolors=colours,
                linewidths=0.3,
                zsort="average",
                zorder=layer,
            ),
            autolim=False,
        )
    for s in scene.strokes:
        for points, colour, width, layer in s.parts(toward):
            ax.plot(*(points / scene.unit[0]).T, s.style, color=colour, lw=width, zorder=layer)
    for m in scene.marks:
        ax.plot(
            *(m.point[:, None] / scene.unit[0]),
            m.marker,
            color=m.colour,
            mfc=m.face,
            ms=m.size,
            mew=1.6,
            zorder=m.layer,
        )
    _dress(ax, scene)


def fit(figure, ax, cell):
    """Zoom and shift a 3D axes to fill `cell` (left, bottom, width, height in pixels), labels included."""
    spans, zoom = np.ptp([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], axis=1), 1.0
    skins = [skin for one in figure.axes for skin in one.collections]
    for skin in skins:
        skin.set_visible(False)  # they lie inside the box, and take most of the time of a drawing
    figure.draw_without_rendering()
    layout = figure.get_layout_engine()
    figure.set_layout_engine("none")  # what stands beside keeps its place
    for _ in range(FITS):
        figure.draw_without_rendering()
        drawn = _extent(ax)
        larger = min(cell[2] / drawn.width, cell[3] / drawn.height)
        if 0.97 < larger < 1.03:
            break
        zoom *= larger
        ax.set_box_aspect(spans, zoom=zoom)
        _clear(figure, ax)
        _thin(figure, ax)
    figure.draw_without_rendering()
    drawn, at, whole = _extent(ax), ax.get_position(), ax.get_figure().bbox
    right = (cell[0] + cell[2] / 2 - (drawn.x0 + drawn.x1) / 2) / whole.width
    up = (cell[1] + cell[3] / 2 - (drawn.y0 + drawn.y1) / 2) / whole.height
    ax.set_position([at.x0 + right, at.y0 + up, at.width, at.height])
    figure.set_layout_engine(layout)
    for skin in skins:
        skin.set_visible(True)


def _extent(ax):
    """All that a 3D axes shows: the box of its limits, and labels and titles of its axes where they were drawn last."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    corners = np.array(np.meshgrid(ax.get_xlim(), ax.get_ylim(), ax.get_zlim())).reshape(3, -1)
    flat = np.column_stack(proj_transform(*corners, ax.get_proj())[:2])
    axes = [getattr(ax, f"{name}axis") for name in AXES]
    boxes = [box for axis in axes for box in [*label_boxes(axis), axis.label.get_window_extent()]]
    return Bbox.union([Bbox(np.array([flat.min(0), flat.max(0)])).transformed(ax.transData), *boxes])


def label_boxes(axis):
    """Where the labels of a 3D axis were drawn last; `get_ticklabels` would put them back into two dimensions."""
    return [tick.label1.get_window_extent() for tick in axis.get_major_ticks(len(axis.get_majorticklocs()))]


def _clear(figure, ax):
    """Move the labels of an upright axis away until none lies on its line."""
    for _ in range(6):
        figure.draw_without_rendering()
        moved = False
        for name in AXES:
            axis = getattr(ax, f"{name}axis")
            line = axis.line.get_window_extent()
            touching = any(box.overlaps(line.padded(3.0)) for box in label_boxes(axis))
            if line.width < 2.0 and touching:
                ax.tick_params(name, pad=axis.get_major_ticks()[0].get_pad() + 3.0)
                axis.labelpad += 5.0
                moved = True
        if not moved:
            return


def _thin(figure, ax):
    """Take ticks away and move the titles of axes out until no two labels touch."""
    counts = {name: len(getattr(ax, f"get_{name}ticks")()) for name in AXES}
    for _ in range(8):
        figure.draw_without_rendering()
        boxes = [(name, k, box) for name in AXES for k, box in enumerate(label_boxes(getattr(ax, f"{name}axis")))]
        titles = [(name, -1, getattr(ax, f"{name}axis").label.get_window_extent()) for name in AXES]
        hits = [
            (a, b)
            for n, a in enumerate(boxes)
            for b in [*boxes[n + 1 :], *titles]
            if a[2].padded(1.5).overlaps(b[2].padded(1.5))
        ]
        if not hits:
            return
        for name in {a[0] for a, b in hits if a[0] == b[0] and b[1] >= 0 and counts[a[0]] > 1}:
            counts[name] -= 1
            _tick(ax, name, counts[name])
        for name in {b[0] for _, b in hits if b[1] < 0}:
            getattr(ax, f"{name}axis").labelpad += 3.0
        for a, b in hits:
            if a[0] != b[0] and b[1] >= 0:
                name, k, _ = max((x for x in (a, b) if x[1] >= 0), key=lambda x: counts[x[0]])
                ticks = list(getattr(ax, f"get_{name}ticks")())
                if len(ticks) > 1 and len(ticks) == counts[name]:
                    ticks.pop(k)
                    counts[name] -= 1
                    getattr(ax, f"set_{name}ticks")(ticks)


def _tick(ax, name, count):
    """At most `count` round ticks on an axis, clear of its ends."""
    from matplotlib.ticker import MaxNLocator

    low, high = sorted(getattr(ax, f"get_{name}lim")())
    clear = 0.06 * (high - low)
    for n in range(count + 2, 0, -1):
        ticks = MaxNLocator(n, steps=[1, 2, 5, 10]).tick_values(low, high)
        ticks = ticks[(ticks > low + clear) & (ticks < high - clear)]
        if len(ticks) <= count:
            break
    if len(ticks) == 0 or len(ticks) > count:
        ticks = ticks[len(ticks) // 2 :][:1] if len(ticks) else np.array([(low + high) / 2]).round()
    getattr(ax, f"set_{name}ticks")(ticks)


def viewer(ax):
    """Unit vector [3] from the scene to the eye, in data axes of equal scale."""
    far, near = (_unprojected(ax, z) for z in (0.0, -1.0))
    toward = near - far
    return toward / np.linalg.norm(toward)


def _unprojected(ax, depth):
    point = np.linalg.inv(ax.get_proj()) @ np.array([0, 0, depth, 1.0])
    return point[:3] / point[3]


def _dress(ax, scene):
    lower, upper = (b / scene.unit[0] for b in scene.box())
    size = float(np.max(upper - lower))
    for name, span in zip(AXES, upper - lower, strict=True):
        axis = getattr(ax, f"{name}axis")
        _tick(ax, name, max(3, round(5 * span / size)))
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color="#dfe3e8", linewidth=0.5)  # no public way to set it
        axis.line.set_color("#9aa3ad")
        upright = AXES[scene.vertical()[0]] == name  # its labels stand beside it: wide ones further away
        wide = max(0, max(len(f"{t:g}") for t in getattr(ax, f"get_{name}ticks")()) - 2) if upright else 0
        getattr(ax, f"set_{name}label")(f"{name} [{scene.unit[1]}]", labelpad=7 + 4 * wide)
        ax.tick_params(name, pad=1.5 + 3.6 * wide, labelsize=7, colors="#444444")


# Painting in a plane


def project(ax, scene, plane):
    """Fill an axes with the scene seen square to a plane (two axis indices); up is drawn upwards."""
    from matplotlib.collections import PolyCollection

    i, j = plane
    axis, sign = scene.vertical()
    flip = axis == j and sign < 0
    k = 3 - i - j
    toward = np.eye(3)[k] * np.linalg.det(np.eye(3)[[i, j, k]]) * (-1 if flip else 1)
    lower, upper = (b / scene.unit[0] for b in scene.box())
    for polygons, colours, layer in shaded(scene, toward):
        order = np.argsort(polygons.mean(1) @ toward)
        flat, colours = polygons[order][:, :, [i, j]], colours[order]
        ax.add_collection(PolyCollection(flat, facecolors=colours, edgecolors=colours, lw=0.3, zorder=layer))
    for s in scene.strokes:
        for points, colour, width, layer in s.parts(toward):
            x, y = (points / scene.unit[0]).T[[i, j]]
            ax.plot(x, y, s.style, color=colour, lw=0.8 * width, zorder=layer)
    for m in scene.marks:
        x, y = (m.point / scene.unit[0])[[i, j]]
        ax.plot([x], [y], m.marker, color=m.colour, mfc=m.face, ms=0.85 * m.size, mew=1.4, zorder=m.layer)
    ax.set(xlim=(lower[i], upper[i]), ylim=(lower[j], upper[j])[:: -1 if flip else 1])
    ax.set(xlabel=f"{AXES[i]} [{scene.unit[1]}]", ylabel=f"{AXES[j]} [{scene.unit[1]}]")
    ax.set_aspect("equal")
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.set_axisbelow(True)


def planes(scene):
    """The two coordinate planes to show: those with the vertical axis, unless the ground plan says more."""
    lower, upper = scene.box()
    span, v = upper - lower, scene.vertical()[0]
    sides = [i for i in range(3) if i != v]
    upright = [(i, v) for i in sides]
    areas = [span[i] * span[v] for i in sides]
    ground = span[sides[0]] * span[sides[1]]
    if ground > 1.5 * min(areas):
        return [upright[int(np.argmax(areas))], (sides[0], sides[1])]
    return upright


# Light


def shaded(scene, toward):
    """(polygons, colours, layer) by layer, in the scene's unit; light falls over the viewer's shoulder."""
    from matplotlib.colors import to_rgb

    side = np.cross(scene.up, toward)
    light = 0.75 * toward + 0.6 * scene.up - 0.35 * side
    light /= np.linalg.norm(light)
    painted = []
    for layer in sorted({layer for _, _, layer in scene.skins}):
        skins = [(quads, colour) for quads, colour, own in scene.skins if own == layer]
        quads = np.concatenate([q for q, _ in skins])
        base = np.concatenate([np.tile(to_rgb(colour), (len(q), 1)) for q, colour in skins])
        n = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
        thin = np.linalg.norm(n, axis=1) < 1e-14
        n[thin] = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])[thin]
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
        seen = n @ toward > -0.02
        glow = np.maximum(0.0, n @ light)[:, None]
        colours = np.clip(base * (0.57 + 0.41 * glow) + 0.05 * glow**16, 0, 1)
        painted.append((quads[seen] / scene.unit[0], colours[seen], layer))
    return painted
