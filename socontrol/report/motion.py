"""A motion as figures need it: which outputs to draw, tracks of the ends, the plane it stays in, colours in time."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from socontrol.report import shapes
from socontrol.report.obstacle_shapes import drawn, shows_in_plane
from socontrol.report.units import number

MOVING = ("simulation", "trajectory", "tensions")  # types whose results can be motions
OVERLAID = 8  # postures drawn over one another
LOOKED_AT = 40  # outputs that are looked at to find the plane and the limits of a motion
FLAT = 1e-3  # thickness over size of what counts as a plane
MOST_POINTS = 3000  # of a drawn curve


@dataclass(frozen=True)
class View:
    """Seen square to a plane: `across` [3 x 2] to the right and up, `labels` of both, `toward` [3] the eye."""

    across: np.ndarray
    labels: tuple

    @property
    def toward(self):
        return np.cross(*self.across.T)


class Motion:
    """The recorded motion of the result of a simulation or of a plan."""

    quantity = "time [s]"  # of t

    def __init__(self, result):
        self.result, self.robot = result, result.question.loaded
        self.t, self.q = np.asarray(result.arrays["t"]), np.asarray(result.arrays["q"])

    @classmethod
    def of(cls, result):
        """Motion of a result, None where it has none to draw."""
        q = result.arrays.get("q")
        if result.type not in MOVING or result.question is None or q is None or "t" not in result.arrays:
            return None
        return cls(result) if np.ndim(q) == 2 and len(q) and np.all(np.isfinite(q)) else None

    @cached_property
    def overlaid(self):
        """Indices of the outputs drawn over one another: by the way of the ends, and a third by the clock."""
        ways = [np.linalg.norm(np.diff(self.track(name), axis=0), axis=1) for name in self.tips]
        way, clock = np.r_[0.0, np.cumsum(np.sum(ways, axis=0))], self.t - self.t[0]
        share = clock / max(clock[-1], 1e-300)
        if way[-1] > 1e-9 * self.robot.length:
            share = share / 3 + way / way[-1] * 2 / 3
        return np.unique([int(np.argmin(np.abs(share - x))) for x in np.linspace(0, 1, OVERLAID)])

    @property
    def labels(self):
        """What the colour of each overlaid output stands for."""
        return [number(x, 3) for x in self.t[self.overlaid]]

    def thinned(self, count=MOST_POINTS):
        """Indices of at most `count` outputs, first and last among them."""
        return np.unique(np.round(np.linspace(0, len(self.t) - 1, count)).astype(int))

    def posed(self, k):
        return shapes.Posed(self.robot, self.q[k])

    @cached_property
    def tips(self):
        return shapes.ends(self.robot)

    def track(self, segment):
        """Positions [k x 3] of a segment's end at all outputs."""
        return np.asarray(self.result.arrays[f"{segment}.position"])

    @cached_property
    def places(self):
        """Centrelines and joints [j x 3] at outputs spread over the whole motion, one array each."""
        return [centres(self.posed(k)) for k in self.thinned(LOOKED_AT)]

    @cached_property
    def up(self):
        g = np.array([float(x) for x in self.robot.description.gravity])
        return -g / np.linalg.norm(g) if np.any(g) else np.array([0, 0, 1.0])

    @property
    def driven(self):
        """{index: history} of the coordinates that motors move as given."""
        return getattr(self.result.question, "driven", {})

    @cached_property
    def obstacles(self):
        """{name: obstacle} that the motion keeps out of."""
        return getattr(self.result.question, "obstacles", None) or {}

    @cached_property
    def near(self):
        """{name: Drawn obstacle} of those near enough to be seen."""
        made = {name: drawn(obstacle, self.reach) for name, obstacle in self.obstacles.items()}
        return {name: one for name, one in made.items() if one is not None}

    @cached_property
    def reach(self):
        """(lower [3], upper [3]) of all places and tracks."""
        points = np.concatenate([*self.places, *(self.track(name) for name in self.tips)])
        return points.min(0), points.max(0)

    @cached_property
    def view(self):
        """The View square to the plane in which everything moves; None where there is none, or where an obstacle would
        look nearer in it than it is."""
        points = np.concatenate([*self.places, *(self.track(name) for name in self.tips)])
        view, origin = self._square_to(points), points.mean(0)
        if view is None or all(shows_in_plane(x, self.reach, view.toward, origin) for x in self.obstacles.values()):
            return view
        return None

    def _square_to(self, points):
        """View square to the plane that holds points [k x 3]; None where there is none."""
        centred = points - points.mean(0)
        size, rows = np.linalg.svd(centred, full_matrices=False)[1:]
        if size[2] > FLAT * size[0]:
            return None
        if size[1] <= FLAT * size[0]:  # on a line: any plane through it
            side = np.cross(rows[0], self.up)
            normal = side if np.linalg.norm(side) > 0.1 else np.cross(rows[0], np.eye(3)[np.argmin(np.abs(rows[0]))])
        else:
            normal = rows[2]
        return self._upright(normal / np.linalg.norm(normal))

    def _upright(self, normal):
        """View along `normal`, what is up drawn upwards; of a level plane: x to the right."""
        k = int(np.argmax(np.abs(normal)))
        if abs(normal[k]) > 1 - 1e-6:
            normal = np.eye(3)[k]
        if abs(normal @ self.up) > 0.9:
            normal = normal * np.sign(normal @ self.up)
            right = np.eye(3)[0] - normal[0] * normal
        else:
            right = np.cross(self.up, normal)
            right = right * np.sign(right[int(np.argmax(np.abs(right)))])  # along a world axis where one is near
        right = right / np.linalg.norm(right)
        above = np.cross(normal, right)
        if above @ self.up < -1e-9:
            above = -above
        return View(np.column_stack([right, above]), (_name(right, "across"), _name(above, "upwards")))

    def ending(self):
        """`, stopped at 0.3 s of 1 s` where it did not reach its end, else nothing."""
        stop = self.result.details.get("stop", self.t[-1])
        if self.t[-1] >= stop * (1 - 1e-9):
            return ""
        return f", {self.result.status.outcome} at {self.t[-1]:.4g} s of {stop:.4g} s"


def _name(direction, otherwise):
    """`x` or `-x` of a coordinate axis, else what it is in the plane."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) > 1 - 1e-6:
        return ("" if direction[k] > 0 else "-") + "xyz"[k]
    return f"{otherwise}, in the plane of motion"


def centres(posed):
    """Points [j x 3] on the centrelines of rods and at the frames of joints."""
    rods = [posed.rod(name)[1][:, :3, 3] for name in posed.robot.segments if posed.robot.tree.of[name]
            and posed.pieces[posed.robot.tree.of[name][0]].is_rod]  # fmt: skip
    others = [g[:3, 3] for i, g in enumerate(posed.bases)]
    others += [posed.place(name)[:3, 3] for name in posed.robot.segments]
    return np.concatenate([*rods, np.array(others)])


def time_colours(count):
    """Colour map of `count` colours: pale at the first time, dark at the last; legible on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0.9, 0.0, count)), "time")
