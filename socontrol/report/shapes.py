"""Where everything of a robot stands, in numbers: frames along rods, skins, lines of tendons and chambers.

Plain numpy: poses by Rodrigues' closed form, one a station. A skin is an array of quads [f x 4 x 3], world,
in metres, corners anticlockwise seen from outside; triangles repeat their last corner.
"""

from functools import cached_property
from math import pi

import casadi as ca
import numpy as np

from socontrol.mechanics.lines import Chord, RodLine, Run
from socontrol.model.rods import Rod
from socontrol.model.sections import section_at

STATIONS = 36  # along a rod
CORNERS = 28  # of a round outline
WINDING = 0.2  # rad about the axis from point to point of a line that is drawn
SLIM = 0.013  # radius of a bar that stands for a rigid link, over the robot's length


class Posed:
    """A robot at q: strains and base frames of its pieces, and from them any place."""

    def __init__(self, robot, q):
        self.robot, self.q, self.pieces = robot, np.asarray(q, dtype=float).ravel(), robot.tree.pieces
        column = ca.DM(self.q)
        self.strains = [np.array(ca.DM(p.strain(column))).ravel() for p in self.pieces]
        self.bases = []
        for piece in self.pieces:
            at = np.eye(4) if piece.parent is None else self.pose(piece.parent, piece.place)
            self.bases.append(at @ matrix(piece.placement))

    def pose(self, i, x=1.0):
        """World <- frame at x of piece i [4 x 4]."""
        return self.bases[i] @ exponential(x * float(self.pieces[i].length) * self.strains[i])

    def place(self, segment, X=1.0):
        """World <- frame at X of a segment [4 x 4]."""
        frame = self.robot.tree.locate(segment, X)
        return self.pose(frame.piece, frame.x) @ matrix(frame.offset)

    def rod(self, segment):
        """X [k] and frames [k x 4 x 4] along a rod; section boundaries are among them."""
        indices = self.robot.tree.of[segment]
        count = max(3, -(-STATIONS // len(indices)))
        bounds, X, frames = self.robot.tree.segments[segment].boundaries(), [], []
        for k, i in enumerate(indices):
            for x in np.linspace(0, 1, count + 1)[k > 0 :]:
                X.append(bounds[k] + x * (bounds[k + 1] - bounds[k]))
                frames.append(self.pose(i, x))
        return np.array(X), np.array(frames)

    def end_radius(self, i, x):
        """Half the width of the rod at x of piece i, None for a joint."""
        if i is None or not self.pieces[i].is_rod:
            return None
        piece = self.pieces[i]
        bounds = piece.record.boundaries()
        X = bounds[piece.index] + x * (bounds[piece.index + 1] - bounds[piece.index])
        return float(np.max(np.abs(outline(section_at(piece.record.cross_section, X)))))

    @cached_property
    def slim(self):
        """Radius of a rigid link's bar: it also stays below the thickness of the rods."""
        widths = [self.end_radius(i, 0.0) for i, piece in enumerate(self.pieces) if piece.is_rod]
        return min([SLIM * self.robot.length, *(0.6 * w for w in widths)])


def exponential(xi):
    """exp(xi) [4 x 4] of a twist [angular; linear], by Rodrigues' formula; a series below 1e-2 rad."""
    w, v = xi[:3], xi[3:]
    t, W = np.sqrt(w @ w), np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    if t > 1e-2:
        a, b, c = np.sin(t) / t, 2 * (np.sin(t / 2) / t) ** 2, (t - np.sin(t)) / t**3
    else:
        a, b, c = 1 - t**2 / 6 + t**4 / 120, 0.5 - t**2 / 24 + t**4 / 720, 1 / 6 - t**2 / 120 + t**4 / 5040
    g = np.eye(4)
    g[:3, :3] += a * W + b * W @ W
    g[:3, 3] = v + b * W @ v + c * W @ W @ v
    return g


def matrix(M):
    """A numeric CasADi matrix as numpy."""
    return np.array(ca.DM(M).full())


def unloaded(robot):
    """Coordinates [n] at which no rod and no joint spring stores energy; 0 where nothing says."""
    q = np.zeros(robot.n)
    for piece in robot.tree.pieces:
        if piece.is_rod:
            q[piece.columns] = (matrix(piece.Phi).T @ matrix(piece.xi_star - piece.xi_bar)).ravel()
        elif piece.size:
            q[piece.columns] = matrix(piece.record.rest_coordinates()).ravel()
    return q


def ends(robot):
    """Names of the tips: segments that carry nothing, and of these, where loops close a robot, those that no loop
    holds at their end; without such rods before links, and one of two links that a loop joins."""
    carried = {segment.parent for segment in robot.tree.segments.values()}
    tips = [name for name in robot.segments if name not in carried]
    closing = [end for loop in robot.loops.values() for end in (loop.a, loop.b) if _at_end(end)]
    held, first = {end.segment for end in closing}, {loop.a.segment for loop in robot.loops.values()}
    rods = [name for name in tips if isinstance(robot.tree.segments[name], Rod)]
    wanted = ([name for name in tips if name not in held], rods, [name for name in tips if name not in first], tips)
    return next(names for names in wanted if names) if held else tips


def _at_end(end):
    return end.at == 1 and np.allclose(matrix(end.placement.pose())[:3, 3], 0.0, rtol=0, atol=1e-9)


def outline(section, corners=CORNERS):
    """Outer edge of a cross-section: (y, z) [k x 2], once round, not closed."""
    kind, *sizes = section.outline()[0]
    if kind == "rectangle":
        w, h = float(sizes[0]) / 2, float(sizes[1]) / 2
        return np.array([[w, h], [-w, h], [-w, -h], [w, -h]])
    angles = 2 * pi * (np.arange(corners) + 0.5) / corners
    return np.column_stack([np.cos(angles), np.sin(angles)]) * np.array([float(s) for s in (sizes * 2)[:2]])


def sweep(frames, outlines):
    """Skin of outlines [k x j x 2] carried along frames [k x 4 x 4], closed at both ends."""
    rings = np.stack([g[:3, 3] + o @ g[:3, 1:3].T for g, o in zip(frames, outlines, strict=True)])
    here, there = rings[:-1], rings[1:]
    sides = np.stack([here, np.roll(here, -1, 1), np.roll(there, -1, 1), there], 2).reshape(-1, 4, 3)
    return np.concatenate([sides, _lid(rings[0][::-1]), _lid(rings[-1])])


def _lid(ring):
    """A fan [j x 4 x 3] that closes a ring [j x 3]."""
    centre, after = np.broadcast_to(ring.mean(0), ring.shape), np.roll(ring, -1, 0)
    return np.stack([centre, ring, after, after], 1)


def bar(a, b, *radii):
    """Skin of a round bar from a to b [3]; several radii are spread along it."""
    along = (b - a) / np.linalg.norm(b - a)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    frames = np.tile(np.eye(4), (max(2, len(radii)), 1, 1))
    frames[:, :3, :3] = np.column_stack([along, across, np.cross(along, across)])
    frames[:, :3, 3] = a + np.linspace(0, 1, len(frames))[:, None] * (b - a)
    radii = radii if len(radii) > 1 else radii * 2
    angles = 2 * pi * np.arange(CORNERS) / CORNERS
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    return sweep(frames, [r * ring for r in radii])


def ball(centre, radius):
    """Skin of a sphere."""
    angles = np.linspace(0, pi, 13)
    frames = np.tile(np.eye(4), (len(angles), 1, 1))
    frames[:, :3, 3] = centre
    frames[:, 0, 3] -= radius * np.cos(angles)
    around = 2 * pi * np.arange(CORNERS) / CORNERS
    ring = radius * np.column_stack([np.cos(around), np.sin(around)])
    return sweep(frames, [max(np.sin(a), 1e-6) * ring for a in angles])


def rod_skin(posed, segment, corners=None):
    """Skin of a rod, its outline swept and tapered."""
    X, frames = posed.rod(segment)
    profile = posed.robot.tree.segments[segment].cross_section
    return sweep(frames, [outline(section_at(profile, x), corners or CORNERS) for x in X])


def cables(posed, index):
    """[(points [k x 3], outward [k x 3], is_chamber)] of an input's lines; outward: off the centreline."""
    runs = []
    for share in posed.robot.lines[index]:
        if isinstance(share, RodLine):
            points, outward = _along(posed, share)
        elif isinstance(share, (Chord, Run)):
            points = _straight(posed, share)
            outward = np.zeros_like(points)
        else:
            continue
        chamber = float(share.gain) > 0
        goes_on = runs and (not chamber or np.allclose(runs[-1][0][-1], points[0], rtol=0, atol=1e-9))
        if goes_on:  # a cable is one, through rigid parts too; a chamber's sections are one where they touch
            before, looks, _ = runs.pop()
            points, outward = np.concatenate([before, points]), np.concatenate([looks, outward])
        runs.append((points, outward, chamber))
    return runs


def _straight(posed, share):
    """Both ends [2 x 3] of a straight run."""
    base, moved = posed.bases[share.piece], posed.pose(share.piece)
    frames = (base, moved) if isinstance(share, Chord) else (moved if share.moved else base,) * 2
    holes = (matrix(share.start).ravel(), matrix(share.stop).ravel())
    return np.array([g[:3, :3] @ p + g[:3, 3] for g, p in zip(frames, holes, strict=True)])


def _along(posed, share):
    """Points [k x 3] of a line through a section, close enough for its own turns, and how far off the axis they lie."""
    turns = abs(float(getattr(share.route.route.kind, "turns", 0.0)) * (share.route.last - share.route.first))
    x = np.linspace(*share.part, 1 + max(12, int(2 * pi * turns / WINDING)))
    offsets = np.array([matrix(share.route.at(float(k))).ravel() for k in x])
    frames = np.array([posed.pose(share.piece, float(k)) for k in x])
    outward = np.einsum("kij,kj->ki", frames[:, :3, :3], offsets)
    return frames[:, :3, 3] + outward, outward


def strain_rows(robot, q):
    """[(rod, s [k + 1], strains [k x 6])]: section boundaries [m], strains from straight of each rod."""
    posed, rows = Posed(robot, q), []
    straight = np.array([0, 0, 0, 1.0, 0, 0])
    for name, segment in robot.tree.segments.items():
        if isinstance(segment, Rod):
            bounds = np.array(segment.boundaries()) * float(segment.length)
            rows.append((name, bounds, np.array([posed.strains[i] - straight for i in robot.tree.of[name]])))
    return rows
