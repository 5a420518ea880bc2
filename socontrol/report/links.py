"""Rigid parts of a robot as skins: bars of links, drums and sleeves of joints, arms to loops, plates of broad bodies.

A body has no shape of its own in a robot file: what is drawn joins the places where something is attached to it.
"""

import numpy as np

from socontrol.report.shapes import CORNERS, ball, bar, matrix, sweep

FLAT = 0.1  # thickness over breadth of places that a plate joins


def link_skins(posed, segment, plates):
    """[(part, skin)] of a joint: part is `link` for what is rigid and `joint` for what turns or slides."""
    i = posed.robot.tree.of[segment][0]
    piece, slim = posed.pieces[i], posed.slim
    base, moved = posed.bases[i], posed.pose(i)
    parts = [("link", plates[segment])] if segment in plates else _bars(posed, i)
    if not {segment, posed.robot.tree.segments[segment].parent} & {*plates}:
        parts += [("link", skin) for skin in mount(posed, i, _width(posed, i))]
    if piece.size:
        parts.append(("joint", _joint(piece, base, moved, slim)))
    return parts


def _bars(posed, i):
    """A bar from a joint to its tip, and a ball for a mass beside it."""
    piece, slim, moved = posed.pieces[i], posed.slim, posed.pose(i)
    end, parts = moved @ matrix(piece.end), []
    if np.linalg.norm(end[:3, 3] - moved[:3, 3]) > slim / 4:
        parts.append(("link", bar(moved[:3, 3], end[:3, 3], _width(posed, i))))
    body = piece.record.body
    if body is not None:
        com = (moved @ np.array([*map(float, body.com), 1.0]))[:3]
        span = end[:3, 3] - moved[:3, 3]
        away = np.linalg.norm(np.cross(com - moved[:3, 3], span)) / max(np.linalg.norm(span), 1e-12)
        if np.linalg.norm(span) < slim / 4 or away > slim:
            if np.linalg.norm(com - moved[:3, 3]) > slim:
                parts.append(("link", bar(moved[:3, 3], com, slim / 2)))
            parts.append(("link", ball(com, 2 * slim)))
    return parts


def _width(posed, i):
    """Radius of the bars of a joint: what is fixed to a rod goes on about as wide."""
    piece = posed.pieces[i]
    carried = posed.end_radius(piece.parent, piece.place)
    return 0.6 * carried if carried and piece.size == 0 else posed.slim


def mount(posed, i, radius):
    """Skins of the rigid part between a piece and what carries it; none where they touch."""
    piece, base = posed.pieces[i], posed.bases[i][:3, 3]
    if piece.parent is None:
        return []
    stand = posed.pose(piece.parent, piece.place)[:3, 3]
    return [bar(stand, base, radius)] if np.linalg.norm(base - stand) > posed.slim / 4 else []


def arms(posed, plates):
    """Bars from segments to the ends of loops that stand off them, but for those a plate reaches."""
    ends = (end for loop in posed.robot.loops.values() for end in (loop.a, loop.b))
    found = []
    for end in (end for end in ends if end.segment not in ("world", *plates)):
        stand, there = posed.place(end.segment, end.at)[:3, 3], loop_end(posed, end)[:3, 3]
        if np.linalg.norm(there - stand) > posed.slim / 4:
            found.append(bar(stand, there, posed.slim))
    return found


def loop_end(posed, end):
    """World <- joint frame [4 x 4] of an end of a loop."""
    own = matrix(end.placement.pose())
    return own if end.segment == "world" else posed.place(end.segment, end.at) @ own


def plates(posed):
    """{segment: skin} of the bodies that three or more attachments spread out in a plane."""
    found = {}
    for name, own in posed.robot.tree.of.items():
        if own and not posed.pieces[own[0]].is_rod and posed.pieces[own[0]].record.body is not None:
            skin = _plate(*_attached(posed, name, own[0]), posed.slim)
            found |= {name: skin} if skin is not None else {}
    return found


def _attached(posed, segment, i):
    """Points [k x 3] where a body is joined to others, and half the width [k] of what is joined there."""
    piece, places = posed.pieces[i], []
    if piece.size == 0 and piece.parent is not None:
        places.append((posed.pose(piece.parent, piece.place), posed.end_radius(piece.parent, piece.place)))
    else:
        places.append((posed.bases[i], None))
    places += [(posed.bases[j], posed.end_radius(j, 0.0)) for j, p in enumerate(posed.pieces) if p.parent == i]
    for loop in posed.robot.loops.values():
        for end, other in ((loop.a, loop.b), (loop.b, loop.a)):
            if end.segment == segment:
                frame = posed.robot.tree.locate(other.segment, other.at) if other.segment != "world" else None
                width = posed.end_radius(frame.piece, frame.x) if frame is not None else None
                places.append((loop_end(posed, end), width))
    return np.array([g[:3, 3] for g, _ in places]), np.array([width or 2 * posed.slim for _, width in places])


def _plate(points, widths, slim):
    """Skin of a plate round discs of `widths` about points; None where they do not span a plane."""
    middle = points.mean(0)
    if len(points) < 3:
        return None
    _, sizes, axes = np.linalg.svd(points - middle)
    if sizes[1] < max(slim, FLAT * sizes[0]) or (len(sizes) > 2 and sizes[2] > FLAT * sizes[1]):
        return None
    axes[2] *= np.linalg.det(axes)
    angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    discs = ((points - middle) @ axes[:2].T)[:, None] + widths[:, None, None] * ring
    frames = np.tile(np.eye(4), (2, 1, 1))
    frames[:, :3, :3] = np.column_stack([axes[2], axes[0], axes[1]])
    frames[:, :3, 3] = middle + slim / 2 * np.array([[-1.0], [1.0]]) * axes[2]
    return sweep(frames, [hull(discs.reshape(-1, 2))] * 2)


def hull(points):
    """Convex hull of points [k x 2], anticlockwise (monotone chains)."""
    chains = []
    for ordered in (sorted(map(tuple, points)), sorted(map(tuple, points), reverse=True)):
        chain = []
        for p in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains += chain[:-1]
    return np.array(chains)


def _turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _joint(piece, base, moved, slim):
    """A drum along the axis of what turns, a sleeve along what slides, a ball for several axes."""
    Phi = matrix(piece.Phi).reshape(6, piece.size)
    centre = moved[:3, 3]
    angular, linear = Phi[:3], Phi[3:]
    if piece.size == 1 and np.linalg.norm(angular) > 0:
        axis, centre = angular[:, 0], (base @ np.array([*np.cross(angular[:, 0], linear[:, 0]), 1.0]))[:3]
    elif np.linalg.matrix_rank(Phi[:3]) <= 1 and piece.size <= 2:
        axis, centre = linear[:, -1], base[:3, 3]
    else:
        return ball(centre, 1.9 * slim)
    half = base[:3, :3] @ axis * 1.8 * slim / np.linalg.norm(axis)
    return bar(centre - half, centre + half, 1.7 * slim)
