"""Lines and torques in numpy for the independent look: forces of single shares, and of whole cables that rub.

The turn of a cable is taken from its directions in the world: their slope along a section by differentiating the
polynomial through them, and the angle from one straight run to the next.
"""

import numpy as np
from numpy.polynomial import legendre

from socontrol.mechanics.friction import TURN_FLOOR
from socontrol.mechanics.lines import Bending, Chord, NormalLine, RodLine, Run
from socontrol.model.quadrature import gauss_legendre
from socontrol.programs.looks.check_poses import adjoints, exponentials, moved, numeric, skew

ALONG = 20  # points of a section where a rubbing cable is looked at, or as many as the line has nodes


def lines_of(robot):
    """For each input a function of a look that gives (piece, generalised force) for unit input."""
    pieces, capstans = robot.tree.pieces, robot.friction.capstans
    return [
        Cable(shares, pieces, capstans[k]) if k in capstans else Lines(shares, pieces)
        for k, shares in enumerate(robot.lines)
    ]


class Lines:
    """Shares that work each by itself."""

    def __init__(self, shares, pieces):
        self.lines = [Line(share, pieces) for share in shares if not isinstance(share, Run)]

    def __call__(self, look):
        return [(line.piece, line.force(look)) for line in self.lines]


class Line:
    """One share of an actuator in numbers; `force` gives its generalised force for unit input."""

    def __init__(self, line, pieces):
        self.kind, self.piece, self.gain = type(line), line.piece, float(line.gain)
        if isinstance(line, RodLine):
            self.weights = np.array([float(w) for w, _, _ in line.nodes])
            self.E = np.array([np.hstack([-skew(numeric(d).ravel()), np.eye(3)]) for _, d, _ in line.nodes])
            self.slopes = np.array([numeric(slope).ravel() for _, _, slope in line.nodes])
        elif isinstance(line, Chord):
            self.start, self.stop = numeric(line.start).ravel(), numeric(line.stop).ravel()
        elif isinstance(line, Bending):
            self.constant = float(line.weight) * numeric(pieces[line.piece].Phi)[line.strain]
        else:
            Phi = numeric(pieces[line.piece].Phi)
            self.wrench = (Phi @ np.linalg.inv(Phi.T @ Phi))[:, line.degree]

    def force(self, look):
        if self.kind is Bending:
            return self.gain * self.constant
        Phi, xi = look.numbers.Phi[self.piece], look.strains[self.piece]
        if issubclass(self.kind, RodLine):
            v = self.E @ xi + self.slopes
            if self.kind is NormalLine:
                v = np.tile([1.0, 0, 0], (len(v), 1))
            t = v / np.sqrt((v * v).sum(axis=1))[:, None]
            return self.gain * (Phi.T @ np.einsum("p,pij,pi->j", self.weights, self.E, t))
        g = exponentials(xi, np.array([1.0]))[0]
        S = moved(xi, np.array([1.0]))[0] @ Phi
        if self.kind is Chord:
            y = g[:3, :3] @ self.stop + g[:3, 3]
            t = (y - self.start) / np.linalg.norm(y - self.start)
            return self.gain * (S.T @ np.concatenate([np.cross(y, t), t]))
        return self.gain * (np.linalg.solve(adjoints(g[None])[0], S).T @ self.wrench)


class Cable:
    """A cable that rubs: shares in order, each pulled by what friction leaves of the tension."""

    def __init__(self, shares, pieces, capstan):
        self.z = float(capstan.mu) * float(capstan.moving)
        self.shares = [(_Wound if isinstance(share, RodLine) else _Straight)(share, pieces) for share in shares]

    def __call__(self, look):
        theta, before, found = 0.0, None, []
        for share in self.shares:
            first, last, turn, force = share.look(look, self.z)
            if before is not None:
                theta += floored(2 * np.arctan2(np.linalg.norm(before - first), np.linalg.norm(before + first)))
            found.append((share.piece, np.exp(-self.z * theta) * force))
            theta, before = theta + turn, last
        return found


def floored(angle, floor=TURN_FLOOR):
    """Turns as the model counts them, smooth where a cable is straight."""
    return angle**2 / np.hypot(angle, floor)


class _Straight:
    """A run from hole to hole."""

    def __init__(self, share, pieces):
        self.piece, self.fixed = share.piece, isinstance(share, Run)
        self.line = None if self.fixed else Line(share, pieces)
        self.at_end = self.fixed and share.moved
        self.start, self.stop = numeric(share.start).ravel(), numeric(share.stop).ravel()

    def look(self, look, z):
        """(direction where it begins, where it ends, world; turn; generalised force at the tension where it begins)."""
        base = look.bases[self.piece]
        ends = base @ exponentials(look.strains[self.piece], np.array([1.0]))[0]
        first, last = (ends if self.at_end else base), (base if self.fixed and not self.at_end else ends)
        span = (last @ [*self.stop, 1.0] - first @ [*self.start, 1.0])[:3]
        t = span / np.linalg.norm(span)
        return t, t, 0.0, np.zeros(look.pieces[self.piece].size) if self.fixed else self.line.force(look)


class _Wound:
    """A line through a section of rod."""

    def __init__(self, share, pieces):
        self.piece, self.gain, part = share.piece, float(share.gain), share.part
        count = max(ALONG, len(share.nodes))
        nodes, weights = (np.array(x) for x in gauss_legendre(count))
        places = [*(part[0] + (part[1] - part[0]) * nodes), *part]
        d = [numeric(share.route.at(float(x))).ravel() for x in places]
        self.E = np.array([np.hstack([-skew(y), np.eye(3)]) for y in d])
        self.slopes = np.array([numeric(share.route.slope(float(x))).ravel() for x in places])
        length = float(pieces[self.piece].length)
        self.size, self.s, self.weights = (part[1] - part[0]) * length, np.array(places) * length, weights
        table = legendre.legvander(2 * nodes - 1, count - 1)
        slope, running = (
            np.stack([legendre.legval(2 * nodes - 1, rule(row)) for row in np.eye(count)], axis=1)
            for rule in (legendre.legder, lambda row: legendre.legint(row, lbnd=-1))
        )
        self.derive, self.integrate = 2 * slope @ np.linalg.inv(table), running @ np.linalg.inv(table) / 2

    def look(self, look, z):
        """As of a straight run; the turn and the force of what lies between."""
        v = self.E @ look.strains[self.piece] + self.slopes
        t = v / np.linalg.norm(v, axis=1)[:, None]
        world = np.einsum("kij,kj->ki", exponentials(look.strains[self.piece], self.s)[:, :3, :3], t)
        world = world @ look.bases[self.piece][:3, :3].T
        rates = floored(np.linalg.norm(self.derive @ world[:-2], axis=1))
        decay = self.size * self.weights * np.exp(-z * (self.integrate @ rates))
        force = self.gain * (look.numbers.Phi[self.piece].T @ np.einsum("p,pij,pi->j", decay, self.E[:-2], t[:-2]))
        return world[-2], world[-1], float(self.weights @ rates), force
