"""The robot at several points of its way as a load grows, in one view at one scale, numbered and coloured in order."""

from functools import cached_property

import numpy as np

from socontrol.quantities import joined
from socontrol.report import loop_scene, shapes, style
from socontrol.report.branch_text import loads, standing, suited
from socontrol.report.motion import LOOKED_AT, OVERLAID, Motion, centres, time_colours
from socontrol.report.motion_shapes import add_posture, drawn
from socontrol.report.portrait import add_plates
from socontrol.report.scene import Scene
from socontrol.report.units import number

PALE = "#c9ced4"
MARKS = {"unstable": "*", "marginal": "'"}
APART = 8.0  # points between the numbers of two shapes: nearer ones are left out


class LoadPath(Motion):
    """The way a robot goes: the first branch, and from where it is left a branch that is not unstable all along.

    Its time `t` is the load, in the unit of `quantity`; words: what each point is called; watched: positions [k x 3] of
    the place that is watched; taken: the branches it goes; others: coordinates [k x n] of those it does not go.
    """

    def __init__(self, result):
        self.result, self.robot = result, result.question.loaded
        count, self.taken, stop = len(result.details["branches"]), [0], None
        words = [standing(result, k) for k in range(count)]
        first = dict(result.details["branches"][0]["critical"])
        for k, row in list(enumerate(result.details["branches"]))[1:]:
            if row["from"] in first and set(words[k][1:]) - {"unstable"}:
                self.taken, stop = [0, k], first[row["from"]]
                break

        def along(rows):
            return np.concatenate([rows(0)[:stop], *(rows(k) for k in self.taken[1:])])

        def array(key):
            return along(lambda k: np.asarray(result.arrays[f"branch.{k}.{key}"]))

        size, unit, what = loads(result)
        load = size * array("parameter")
        one, name = suited(unit, *load.tolist())
        self.q, self.t, self.watched = array("q"), load / one, array("watch")
        self.words, self._what = along(lambda k: np.array(words[k])), f"{what} [{name}]" if name else what
        rows = [np.asarray(result.arrays[f"branch.{k}.q"]) for k in range(count) if k not in self.taken]
        self.others = [q[len(q) // 2 :: max(1, len(q) // 4)] for q in rows]

    @cached_property
    def overlaid(self):
        """Indices of the postures drawn: evenly by how far the robot's centrelines have moved."""
        among = self.thinned(LOOKED_AT)
        places = [np.ravel(centres(self.posed(k))) for k in among]
        way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
        return np.unique([among[np.argmin(np.abs(way - x * way[-1]))] for x in np.linspace(0, 1, OVERLAID)])

    @property
    def quantity(self):
        """What the labels tell, and what their marks mean."""
        seen = [f"{mark} {word}" for word, mark in MARKS.items() if word in self.words[self.overlaid]]
        return ", ".join([self._what, *seen])

    @property
    def labels(self):
        """`2: 1.33`, with a mark where the shape is not stable."""
        rows = enumerate(zip(self.t[self.overlaid], self.words[self.overlaid], strict=True), 1)
        return [f"{n}: {number(x, 3)}{MARKS.get(word, '')}" for n, (x, word) in rows]

    @cached_property
    def _tracks(self):
        posed = [self.posed(k) for k in range(len(self.q))]
        return {name: np.array([one.place(name)[:3, 3] for one in posed]) for name in self.tips}

    def track(self, segment):
        """Positions [k x 3] of a segment's end at all points of the way."""
        return self._tracks[segment]

    @cached_property
    def places(self):
        """Centrelines and joints [j x 3] of the way and of the other branches."""
        beside = [centres(shapes.Posed(self.robot, q)) for rows in self.others for q in rows]
        return [*(centres(self.posed(k)) for k in self.overlaid), *beside]


def branch_shapes_figure(result):
    """Shapes along the way; None without branches."""
    if not result.details.get("branches"):
        return None
    path = LoadPath(result)
    scene, colours = _composed(path)
    figure = drawn(path, scene, colours)
    if path.view is not None:
        _numbered(figure, path, scene.unit[0])
    one = len(path.taken) == 1
    what = f"branch{'es' * (not one)} {joined([str(k) for k in path.taken], 'and')}"
    dashed = "; dashed: unstable" if "unstable" in path.words[path.overlaid] and _rods(path.posed(0)) else ""
    beside = "; pale: other branches" if path.others else ""
    style.title(figure, f"{result.name}: {len(path.overlaid)} shapes along {what}{dashed}{beside}")
    return figure


def _composed(path):
    """(scene, colours): shapes in their colours, unstable ones of rods dashed, other branches pale."""
    scene, colours = Scene(up=path.up), time_colours(len(path.overlaid))
    for n, k in enumerate(path.overlaid):
        posed, layer = path.posed(k), 3 + 2 * n
        if path.words[k] == "unstable" and (rods := _rods(posed)):
            for line in rods:
                scene.stroke(line, colours(n), width=1.6, style="--", layer=layer)
        else:
            add_posture(scene, posed, colours(n), layer)
    top = 2 * len(path.overlaid) + 5
    add_plates(scene, path.posed(0), 1)
    for name in path.tips:
        if np.max(np.ptp(path.track(name), axis=0)) > 1e-6 * path.robot.length:
            scene.stroke(path.track(name), style.INK, width=0.7, layer=top)
    loop_scene.add_loops(scene, path.posed(path.overlaid[-1]), path.robot.length, top)
    for q in (q for rows in path.others for q in rows):
        for line in _rods(shapes.Posed(path.robot, q)):
            scene.stroke(line, PALE, width=1.0, layer=1)
    scene.settle_unit()
    return scene, colours


def _rods(posed):
    """Centrelines [k x 3] of all rods."""
    tree = posed.robot.tree.of
    return [posed.rod(name)[1][:, :3, 3] for name, own in tree.items() if own and posed.pieces[own[0]].is_rod]


def _numbered(figure, path, one):
    """The number of each shape at the place that is watched; one: metres of a unit of the axes."""
    ax = next(ax for ax in figure.axes if ax.get_label() == "plane")
    figure.draw_without_rendering()
    shown = []
    for n, point in enumerate(path.watched[path.overlaid] @ path.view.across / one, 1):
        at = ax.transData.transform(point) * 72 / figure.dpi
        if all(np.linalg.norm(at - other) > APART for other in shown):
            shown.append(at)
            ax.text(*point, str(n), fontsize=6.5, ha="center", va="center", color=style.INK, zorder=99,
                    bbox={"boxstyle": "circle,pad=0.15", "fc": "#ffffff", "ec": "none", "alpha": 0.8})  # fmt: skip
