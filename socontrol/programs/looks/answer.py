"""From (q, u) to a Result: poses, lengths, energies, limits, and the looks that make the answer trustworthy."""

from functools import cached_property

import casadi as ca
import numpy as np

from socontrol.lie import so3
from socontrol.mechanics.elasticity import deviation
from socontrol.mechanics.lines import Torque
from socontrol.mechanics.loops import slices
from socontrol.model.materials import Linear
from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.equilibria.lengths import Held, Routes, length_values
from socontrol.programs.equilibria.stability import stability
from socontrol.programs.looks import check, displacement
from socontrol.programs.result import Value

FORCE_TOLERANCE = 1e-8  # recomputed unbalanced force over the largest elastic (or external) force
LOOP_TOLERANCE = 1e-9  # recomputed error of a loop, m or rad
LENGTH_TOLERANCE = 1e-6  # recomputed miss of a held length over the robot's length
SMALLEST_FORCE = 1e-4  # of what bends a section by a radian: smaller largest forces count as that, not as noise
SMALLEST_SOUGHT = 1e-2  # the same of optimised postures, whose solver stops at a scaled residual of 1e-10
STRETCHED = 0.5  # stretch beyond which a linear law is no law of a material
CRUSHED = -0.9  # stretch: less than a tenth of the length is left
ACTIVE = 1e-6  # of the limits' span: closer counts as on the limit


class Look:
    """Values and residuals of one posture of a robot; Functions are made once for repeated use."""

    def __init__(self, question, balance):
        self.question, self.balance, self.robot = question, balance, question.loaded
        self.held = getattr(question, "held", Held())
        self.functions = self.robot.functions(compiled=False)  # each is called once or twice

    @cached_property
    def _checker(self):
        return check.Checker(self.robot)

    def values(self, q, u, lam=None):
        """{name: Value} of inputs, coordinates, end poses, cable lengths, energies and what loops bear."""
        robot, f, values = self.robot, self.functions, {}
        for name, unit, x in zip(robot.inputs, robot.input_units, u, strict=True):
            values[f"inputs.{name}"] = Value(float(x), unit)
        for piece in robot.tree.pieces:
            if not piece.is_rod:
                for i in range(piece.columns.start, piece.columns.stop):
                    values[f"coordinates.{robot.coordinates[i]}"] = Value(float(q[i]), robot.coordinate_units[i])
        for segment in robot.segments:
            g = np.array(f.pose(segment, 1.0).function(q))
            values[f"{segment}.position"] = Value(g[:3, 3].tolist(), "m")
            values[f"{segment}.rotation"] = Value(rotation_vector(g[:3, :3]).tolist(), "rad")
        lengths = np.array(f.actuator_lengths.function(q)).ravel()
        for name, (x, unit) in length_values(robot, lengths, u, self.held).items():
            values[name] = Value(x, unit)
        for segment, wrench in self._checker.reactions(q, lam).items():
            values[f"reaction.{segment}"] = Value(wrench.tolist(), "N m, N")
        for name, wrench in self.loop_wrenches(lam).items():
            values[f"loops.{name}"] = Value(wrench.tolist(), "N m, N")
        _, elastic, gravitational = np.array(f.energy.function(q, np.zeros(robot.n))).ravel()
        values["energy.elastic"] = Value(float(elastic), "J")
        values["energy.gravitational"] = Value(float(gravitational), "J")
        for name, (_, tension) in self.cables(q, u).items():
            values[f"tension_end.{name}"] = Value(float(tension[-1]), "N")
        return values

    def displacement(self, q, prescribed):
        """(displacement [m], segment, X) of what has moved most from where the robot stands with rods straight and
        joints at 0, but for those prescribed; None without rods, or where that shape leaves loops open."""
        start = np.zeros(self.robot.n)
        start[list(prescribed)] = np.asarray(q)[list(prescribed)]
        rods = any(piece.is_rod for piece in self.robot.tree.pieces)
        if not rods or np.max(np.abs(self._checker.loop_error(start)), initial=0.0) > LOOP_TOLERANCE:
            return None
        return displacement.largest(self._checker, start, q)

    def loop_wrenches(self, lam):
        """{loop: wrench [moment; force] on a by b, in the joint frame of b}."""
        rows = slices(self.robot.loops).items() if lam is not None else ()
        return {name: np.array(ca.DM(self.robot.loops[name].Phi_perp())) @ lam[own] for name, own in rows}

    def cables(self, q, u):
        """{name: (places s [m] along the cable from its motor, tension [N] there)} of cables with friction."""
        found = {}
        for i, name in enumerate(self.robot.inputs):
            if getattr(self.robot.input_actuators[i], "friction", 0):
                s, ratio = (np.array(x).ravel() for x in self.functions.cable(name).function(q))
                found[name] = s, u[i] * ratio
        return found

    def unbalanced(self, q, u, lam=None):
        """Residual [n] and tangent [n x n], those of the loops' multipliers counted."""
        if lam is not None:
            return self.balance.unbalanced(q, u, lam)
        r, tangent, _ = self.balance.evaluate(q, u)
        return np.array(r), np.array(tangent)

    def residuals(self, q, u, free, lam=None):
        """Recomputed unbalanced force beside the largest force, on the free coordinates; scaled by sqrt(K)."""
        r, elastic, external, actuation = self._checker(q, u, lam)
        scale = self.balance.scales.force
        parts = np.concatenate([np.abs(p / scale)[free] for p in (elastic, external, actuation)])
        least = SMALLEST_SOUGHT if self.question.optimises else SMALLEST_FORCE
        largest = max(float(np.max(parts, initial=0.0)), least)
        worst = float(np.max(np.abs(r / scale)[free], initial=0.0))
        own = np.abs(self.unbalanced(q, u, lam)[0] / scale)[free]
        found = {
            "force": Value(worst / largest, "1"),
            "solver_force": Value(float(np.max(own, initial=0.0)) / largest, "1"),
        }
        if lam is not None:
            found["loops"] = Value(float(np.max(np.abs(self._checker.loop_error(q)))), "m, rad")
        return {**found, "lengths": Value(self.missed(q, u), "m")} if self.held else found

    def missed(self, q, u):
        """Largest miss of the held lengths [m], recomputed with twice the Gauss points: 0 = T or 0 = gap of cables."""
        fine = self.robot.refined(factor=2).functions(compiled=False).actuator_lengths.function
        gap = self.held.gap(np.array(fine(q)).ravel(), u)
        slack = self.held.pulls & (u[self.held.index] <= 0)
        return float(np.max(np.where(slack, np.maximum(-gap, 0.0), np.abs(gap))))

    def gaps(self, q, u):
        """{name: miss [m]} of the held lengths that are not met."""
        if not self.held:
            return {}
        lengths = np.array(self.functions.actuator_lengths.function(q)).ravel()
        rows = zip(self.held.names, np.abs(self.held.gap(lengths, u)), strict=True)
        return {name: float(gap) for name, gap in rows if not gap <= LENGTH_TOLERANCE * self.robot.length}

    def met(self, residuals):
        """Whether the held lengths are met, as far as twice the Gauss points can tell."""
        return not self.held or residuals["lengths"].value <= LENGTH_TOLERANCE * self.robot.length

    def slack(self, u):
        """Names of the held cables that pull nothing."""
        loose = self.held.slack(u, self.balance.scales.u)
        return [name for name, is_loose in zip(self.held.names, loose, strict=True) if is_loose]

    def conservative(self, u):
        """Whether all loads and inputs that act have a potential."""
        tree = self.robot.tree
        return self.balance.conservative and all(
            line.conservative or (isinstance(line, Torque) and tree.pieces[line.piece].is_screw)
            for value, shares in zip(u, self.robot.lines, strict=True)
            for line in shares
            if value
        )

    def stability(self, q, u, free, lam=None):
        """Stability at (q, u) on the free coordinates; loops and held lengths leave the motions that keep them."""
        tangent, B = self.unbalanced(q, u, lam)[1], np.array(self.balance.evaluate(q, u)[2])
        conservative = self.conservative(u)
        rows = None if lam is None else self.balance.held(q, free)
        if self.held:
            slack = self.held.slack(u, self.balance.scales.u)
            springs, slopes, pushes = self.held.holding(Routes(self.robot)(q)[1], B, slack)
            tangent = tangent + springs
            rows = (slopes, pushes) if rows is None else (np.vstack([rows[0], slopes]), np.hstack([rows[1], pushes]))
        return stability(tangent, self.balance.scales, conservative, free, rows)

    def limits_reached(self, q, u):
        """Rows (kind, name, side, limit, index, beyond) of what is on or past a limit; given values only if past."""
        rows, question = [], self.question
        for key, x, (lower, upper) in (
            ("inputs", u, question.input_limits()),
            ("coordinates", q, question.coordinate_limits(strains=question.optimises)),
        ):
            given, names = question.named(key, getattr(question, key)), getattr(self.robot, key)
            if key == "inputs":  # held ones go where their lengths take them
                given = {*given, *self.held.index}
            for i, name in enumerate(names):
                span = upper[i] - lower[i] if np.isfinite(upper[i] - lower[i]) else max(1.0, abs(x[i]))
                for side, limit, gap in (("lower", lower[i], x[i] - lower[i]), ("upper", upper[i], upper[i] - x[i])):
                    if gap < -ACTIVE * span or (i not in given and span > 0 and gap <= ACTIVE * span):
                        beyond = max(0.0, float(-gap)) if gap < -ACTIVE * span else 0.0
                        row = {"kind": key[:-1], "name": name, "side": side, "limit": float(limit), "index": i}
                        rows.append({**row, "beyond": beyond})
        return rows

    def doubled(self, q, u, prescribed, stable=True):
        """Change of each end frame's position when every section is halved, in metres; None when that fails.

        What is not `stable` is not left for another rest.
        """
        fine = self.robot.refined(sections=2)
        if fine.n == self.robot.n:
            return {}
        balance = balance_of(fine, self.held)
        start = spread(self.robot, fine, q)
        marks = np.zeros(self.robot.n)
        marks[list(prescribed)] = 1.0
        held = {int(i): start[i] for i in np.flatnonzero(spread(self.robot, fine, marks))}
        answer = balance.solve(u, start, prescribed=held, **({} if stable or self.held else {"settle": False}))
        if not answer.status.solved:
            return None
        f = fine.functions()
        changes = {}
        for segment in self.robot.segments:
            before = np.array(self.functions.pose(segment, 1.0).function(q))[:3, 3]
            changes[segment] = float(np.linalg.norm(np.array(f.pose(segment, 1.0).function(answer.q))[:3, 3] - before))
        return changes

    def collapsed(self, q):
        return collapsed(self.robot, q)


def collapsed(robot, q):
    """Rods that are nearly crushed (stretch below CRUSHED) or leave the series' range, by name."""
    names, q = list(robot.overstrained(q)), np.asarray(q, dtype=float)
    for piece in robot.tree.pieces:
        if piece.is_rod and "stretch" in piece.record.active():
            stretch = float(q[piece.columns][piece.record.active().index("stretch")])
            if not stretch >= CRUSHED:
                names.append(f"{piece.segment}.{piece.index} (stretch {stretch:.2g})")
    return names


def overstretched(robot, q):
    """{segment: stretch} of rods of a linear law that are stretched or shortened by more than STRETCHED, the most."""
    found, q = {}, np.asarray(q, dtype=float)
    for piece in robot.tree.pieces:
        if piece.is_rod and isinstance(piece.record.material, Linear) and piece.size:
            stretch = float(ca.DM(deviation(piece, q))[3])
            if abs(stretch) > max(STRETCHED, abs(found.get(piece.segment, 0.0))):
                found[piece.segment] = stretch
    return found


def spread(robot, fine, q):
    """Coordinates of the refined robot that hold the same shape."""
    start = np.zeros(fine.n)
    for segment in robot.segments:
        coarse = robot.tree.of[segment]
        for k, i in enumerate(fine.tree.of[segment]):
            source = robot.tree.pieces[coarse[k * len(coarse) // len(fine.tree.of[segment])]]
            start[fine.tree.pieces[i].columns] = np.asarray(q)[source.columns]
    return start


def rotation_vector(R):
    """Rotation vector [3] of R, in numpy, any angle up to pi."""
    return np.array(so3.log(ca.DM(R))).ravel()
