"""Obstacles as figures need them: closed skins cut to what is worth seeing, and their outline in every view.

All obstacles are convex, so that a skin is a list of convex polygons [k x 3], anticlockwise seen from outside, a cut
leaves one polygon to close, and the outline in a view is the convex hull of what is projected.
"""

from dataclasses import dataclass

import numpy as np

from socontrol.programs.plans.obstacles import Box, Capsule, HalfSpace, Sphere
from socontrol.report import shapes

FACE, EDGE = "#ddd3c4", "#7a6a55"
MARGIN = 0.5  # of the motion's size: how far around it obstacles are shown
SLAB = 0.03  # of the motion's size: thickness of the plate that stands for a half-space
AROUND = 0.12  # of the motion's size: how far around it that plate reaches
OUT_OF_PLANE = 2e-3  # of the motion's size: an outline off the section in the plane by more needs a view in space


@dataclass(frozen=True)
class Silhouette:
    """The outline of points [k x 3], drawn as a line in any view: what it surrounds stays seen."""

    points: np.ndarray
    colour: str = EDGE
    width: float = 1.0
    style: str = "-"
    layer: int = 5

    def parts(self, toward):
        """(points, colour, width, layer) to draw, seen from `toward`."""
        return [(outline(self.points, toward), self.colour, self.width, self.layer)]


def outline(points, toward):
    """Those of points [k x 3] that surround the others seen from `toward`, once round anticlockwise and closed."""
    right = np.cross(toward, np.eye(3)[np.argmin(np.abs(toward))])
    flat = points @ np.column_stack([right, np.cross(toward, right)])
    flat = np.round((flat - flat.min(0)) / (np.max(np.ptp(flat, axis=0)) or 1.0), 9)  # rounding must not sort
    order = np.lexsort((flat[:, 1], flat[:, 0]))
    chains = [_chain(flat, run) for run in (order, order[::-1])]
    return points[[*chains[0][:-1], *chains[1]]]


def _chain(flat, order):
    """One side of the hull of points [k x 2], sorted along x."""
    kept = []
    for k in order:
        while len(kept) > 1:
            (ax, ay), (bx, by) = flat[kept[-1]] - flat[kept[-2]], flat[k] - flat[kept[-2]]
            if ax * by - ay * bx > 1e-12:
                break
            kept.pop()
        kept.append(k)
    return kept


# Skins

def rounded(a, b, radius, corners=shapes.CORNERS):
    """Polygons of all within `radius` of the line from a to b [3]; of a sphere where these are one point."""
    along = np.asarray(b, dtype=float) - a
    length = float(np.linalg.norm(along))
    along = along / length if length > 0 else np.array([0, 0, 1.0])
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    quarter = np.linspace(0, np.pi / 2, corners // 4 + 1)
    angles = np.concatenate([quarter - np.pi / 2, quarter[length == 0 :]])
    shifts = np.concatenate([np.zeros(len(quarter)), np.full(len(angles) - len(quarter), length)])
    frames = np.tile(np.eye(4), (len(angles), 1, 1))
    frames[:, :3, :3] = np.column_stack([along, across, np.cross(along, across)])
    frames[:, :3, 3] = a + (shifts + radius * np.sin(angles))[:, None] * along
    turns = 2 * np.pi * np.arange(corners) / corners
    ring = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    return list(shapes.sweep(frames, [max(np.cos(x), 1e-6) * ring for x in angles]))


def block(g, size):
    """Polygons of a box of sides `size` [3] in the middle of a frame [4 x 4]."""
    faces = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for side in (-1, 1):
            corners = np.zeros((4, 3))
            corners[:, k] = side
            corners[:, i], corners[:, j] = (-1, 1, 1, -1), (-side, -side, side, side)
            faces.append(g[:3, 3] + (corners * np.asarray(size) / 2) @ g[:3, :3].T)
    return faces


def _sphere(obstacle, grown, reach):
    return rounded(obstacle.center, obstacle.center, obstacle.radius + grown, _corners(obstacle.radius, reach))


def _capsule(obstacle, grown, reach):
    return rounded(obstacle.from_, obstacle.to, obstacle.radius + grown, _corners(obstacle.radius, reach))


def _corners(radius, reach):
    """More of them where little is seen of what is round."""
    return shapes.CORNERS * int(np.clip(round(radius / float(np.max(reach[1] - reach[0]))), 1, 5))


def _box(obstacle, grown, reach):
    g = shapes.exponential(np.array([*obstacle.rotation, 0.0, 0.0, 0.0], dtype=float))
    g[:3, 3] = obstacle.center
    if not grown:
        return block(g, obstacle.size)
    corners = np.unique(np.concatenate(block(g, obstacle.size)).round(15), axis=0)
    near = np.unique(np.concatenate(rounded(np.zeros(3), np.zeros(3), grown, corners=16)), axis=0)
    return [(corners[:, None] + near).reshape(-1, 3)]  # enough for an outline


def _half_space(obstacle, grown, reach):
    """A plate on the side that is kept out of, a bit larger than the motion."""
    lower, upper = reach
    size = float(np.max(upper - lower))
    n = np.array(obstacle.normal, dtype=float) / np.linalg.norm(obstacle.normal)
    middle, across = (lower + upper) / 2, np.linalg.svd(n[None])[2][1]
    surface = middle - n * (n @ (middle - np.array(obstacle.point, dtype=float)))
    thick, g = SLAB * size, np.eye(4)
    g[:3, :3], g[:3, 3] = np.column_stack([n, across, np.cross(n, across)]), surface + n * (grown - thick) / 2
    around = AROUND * size
    ends = np.array([lower - around, upper + around, surface - thick, surface + thick])
    return cut(block(g, (thick + grown, 4 * size, 4 * size)), ends.min(0), ends.max(0))


SKINS = {Sphere: _sphere, Capsule: _capsule, Box: _box, HalfSpace: _half_space}


def body(obstacle, reach, grown=0.0):
    """Polygons of an obstacle, all sides moved out by `grown`, as far as it is near `reach` (lower, upper [3])."""
    lower, upper = reach
    margin = MARGIN * float(np.max(upper - lower))
    return cut(SKINS[type(obstacle)](obstacle, grown, reach), lower - margin, upper + margin)


def cut(polygons, lower, upper):
    """What of a convex skin lies in a box, closed again."""
    for k in range(3):
        for sign, bound in ((-1, -lower[k]), (1, upper[k])):
            if polygons and max(float(np.max(sign * p[:, k])) for p in polygons) > bound:
                polygons = _cut(polygons, sign * np.eye(3)[k], bound)
    return polygons


def _cut(polygons, n, bound):
    """What of a convex skin lies where n x <= bound, and the polygon that closes it."""
    kept, rim = [], []
    for p in polygons:
        height, corners = p @ n - bound, []
        for a, b, x, y in zip(p, np.roll(p, -1, 0), height, np.roll(height, -1), strict=True):
            corners += [a] if x <= 0 else []
            if x * y < 0:
                rim.append(a + x / (x - y) * (b - a))
                corners.append(rim[-1])
        if len(corners) > 2:
            kept.append(np.array(corners))
    if len(rim) > 2:
        rim = np.array(rim)
        kept.append(outline(rim, n)[:-1])
    return kept


def quads(polygons):
    """Convex polygons as quads [f x 4 x 3], triangles with their last corner twice."""
    four = [p for p in polygons if len(p) == 4]
    others = [np.stack([p[0], p[k], p[k + 1], p[k + 1]]) for p in polygons if len(p) != 4 for k in range(1, len(p) - 1)]
    return np.array(four + others)


# Scenes

@dataclass(frozen=True)
class Drawn:
    """faces [f x 4 x 3] of an obstacle; edges, shell [k x 3]: what its outline and that at its clearance surround."""

    faces: np.ndarray
    edges: np.ndarray
    shell: np.ndarray | None


def drawn(obstacle, reach):
    """Drawn obstacle as far as it is near `reach`, else None."""
    skin = body(obstacle, reach)
    if not skin:
        return None
    shell = body(obstacle, reach, float(obstacle.clearance)) if obstacle.clearance > 0 else None
    return Drawn(quads(skin), np.concatenate(skin), np.concatenate(shell) if shell else None)


def add_obstacles(scene, motion, top):
    """Obstacles that stand near a motion: a skin behind the robot, an outline over it, dashed at their clearance."""
    for one in motion.near.values():
        scene.skin(one.faces, FACE, 1)
        scene.strokes.append(Silhouette(one.edges, layer=top))
        if one.shell is not None:
            scene.strokes.append(Silhouette(one.shell, width=0.7, style="--", layer=top))


def shows_in_plane(obstacle, reach, normal, origin):
    """Whether the outline seen along `normal` is the section of the plane through `origin`, so that gaps are true."""
    skin = body(obstacle, reach)
    if not skin:
        return True
    points = np.concatenate(skin)
    within = points - ((points - origin) @ normal)[:, None] * normal
    gaps = np.array(obstacle.distance(within.T))
    return bool(np.max(gaps) <= OUT_OF_PLANE * float(np.max(reach[1] - reach[0])))
