"""The robot at several points of its way as a load grows, in one view at one scale, coloured from first to last."""

from functools import cached_property

import numpy as np

from socontrol.report import shapes, style
from socontrol.report.branch_text import loads, suited
from socontrol.report.motion import LOOKED_AT, OVERLAID, Motion, centres
from socontrol.report.motion_shapes import composed, drawn

PALE = "#c9ced4"


class LoadPath(Motion):
    """The way a robot goes: the first branch, and from where it is left the branch that leaves there.

    Its time `t` is the load, in the unit of `quantity`; others: coordinates [k x n] of the branches it does not go.
    """

    def __init__(self, result):
        self.result, self.robot = result, result.question.loaded
        branches, points = result.details["branches"], []
        for k in range(len(branches)):
            q, mu = (np.asarray(result.arrays[f"branch.{k}.{key}"]) for key in ("q", "parameter"))
            points.append((q, mu))
        leaves = next((k for k, row in enumerate(branches) if row["from"] is not None), None)
        (q, mu), taken = points[0], {0}
        if leaves is not None and branches[leaves]["from"] in dict(branches[0]["critical"]):
            at, taken = dict(branches[0]["critical"])[branches[leaves]["from"]], {0, leaves}
            q, mu = (np.concatenate([a[:at], b]) for a, b in zip(points[0], points[leaves], strict=True))
        size, unit, what = loads(result)
        one, name = suited(unit, *(size * mu).tolist())
        self.q, self.t, self.quantity = q, size * mu / one, f"{what} [{name}]" if name else what
        self.others = [q[len(q) // 2 :: max(1, len(q) // 4)] for k, (q, _) in enumerate(points) if k not in taken]

    @cached_property
    def overlaid(self):
        """Indices of the postures drawn: evenly by how far the robot's centrelines have moved."""
        among = self.thinned(LOOKED_AT)
        places = [np.ravel(centres(self.posed(k))) for k in among]
        way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
        return np.unique([among[np.argmin(np.abs(way - x * way[-1]))] for x in np.linspace(0, 1, OVERLAID)])

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
    scene, colours = composed(path)
    for rows in path.others:
        for q in rows:
            posed = shapes.Posed(path.robot, q)
            for name, own in posed.robot.tree.of.items():
                if own and posed.pieces[own[0]].is_rod:
                    scene.stroke(posed.rod(name)[1][:, :3, 3], PALE, width=1.0, layer=1)
    figure = drawn(path, scene, colours)
    beside = "; pale: other branches" if path.others else ""
    style.title(figure, f"{result.name}: {len(path.overlaid)} shapes at rest; thin line: where its end goes{beside}")
    return figure
