"""Tensions of a motion: inverse dynamics within limits, and the motion simulated again under them.

    r(q, q', q'', u) = A^T lam,    e(q) = 0,
the second line and lam where loops close the robot: the wanted motion is put onto closed loops first.
"""

import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from socontrol.native.buffers import buffered
from socontrol.programs.equilibria.scaling import scales
from socontrol.programs.looks.answer import SMALLEST_FORCE
from socontrol.programs.motions.displacements import displacement_weights
from socontrol.programs.motions.massless import refuse_massless
from socontrol.programs.motions.motion_answer import ends
from socontrol.programs.plans.replay import deviations
from socontrol.programs.postures.goals import Path, Point
from socontrol.programs.result import Result, Status, Value
from socontrol.programs.tensions.closed_motion import Closing, bearing, of_coordinates
from socontrol.programs.tensions.pace import Pace
from socontrol.programs.tensions.tension_fit import Fitter, Tracked
from socontrol.programs.tensions.tension_passes import PASSES, Hurry, needed, passed, sampled
from socontrol.programs.tensions.tension_replay import Pulled, simulated
from socontrol.programs.tensions.tension_verdict import PART, Stray, fastest, judged, too_fast
from socontrol.programs.tensions.timed_way import Way
from socontrol.programs.tensions.wanted_motion import Motion, Wanted, of_histories
from socontrol.quantities import Bad

__all__ = ["Motion", "driven"]
LOOKS = 200  # samples at which a given motion is held against what a section can turn


@dataclass(frozen=True)
class Course:
    """What is asked: the wanted motion, what is tracked on it, inputs at about its beginning; of a robot with loops
    its Closing; of a path its Way, its name, and the Result of its waypoints at rest."""

    wanted: Wanted
    tracked: Tracked
    near: np.ndarray
    loops: Closing | None = None
    way: Any = None
    name: str = ""
    before: Result | None = None


def driven(question, progress=None):
    """Result of a motion: tensions at every sample, and the robot simulated under them."""
    began = time.perf_counter()
    course = _of_path(question, progress) if question.has_path else _of_coordinates(question)
    if isinstance(course, Result):
        return course
    drive = Drive(question, course)
    status = drive.run(progress)
    result = Result(
        name=question.name, type=question.asked, status=status, question=question, arrays=drive.arrays,
        values=drive.values, details=drive.details, log=course.before.log if course.before else "",
        solver={"iterations": drive.passes, "seconds": time.perf_counter() - began, **drive.clock},
    )  # fmt: skip
    return bearing(result, course.loops, drive.plant) if course.loops else result


def _of_coordinates(question):
    """Course of coordinates given in time, loops closed by the others; all ends of the robot are tracked."""
    robot = question.loaded
    histories, held, t = question.motion.read(question)
    motion = Wanted(t, *of_histories(robot, histories, held, t), np.zeros((len(t), 0)), np.zeros((len(t), robot.m)))
    loops = Closing.of(question)
    if loops:
        motion, status = of_coordinates(question, loops, motion, list(histories))
        if status is not None:
            return Result(name=question.name, type=question.asked, status=status, question=question)
    _refuse_beyond(question, motion)
    there = ends(robot, robot.functions(), {"q": motion.q})
    targets = np.column_stack([there[f"{segment}.position"] for segment in robot.segments])
    goals = {segment: Point(on=segment, target=(0.0, 0.0, 0.0)) for segment in robot.segments}
    return Course(replace(motion, targets=targets), Tracked(robot, goals), np.zeros(robot.m), loops)


def _refuse_beyond(question, motion):
    """Raise Bad for a given motion that leaves the limits of a joint, or what a section can turn."""
    robot, (lower, upper) = question.loaded, question.coordinate_limits(strains=False)
    room = 1e-9 * np.maximum(1.0, np.abs(motion.q))
    for k, i in np.argwhere((motion.q < lower - room) | (motion.q > upper + room))[:1]:
        between = f"[{lower[i]:g}, {upper[i]:g}]"
        told = f"{motion.q[k, i]:.6g} at t = {motion.t[k]:g} s is outside the limits of the joint, {between}"
        name = robot.coordinates[i]
        if name not in question.motion.coordinates:
            raise Bad("motion.coordinates", f"closed, the loops put {name} where it cannot be: {told}")
        raise Bad(f"motion.coordinates.{name}", told)
    for k in np.unique(np.linspace(0, len(motion.t) - 1, LOOKS).astype(int)):
        if over := robot.overstrained(motion.q[k]):
            told = f"section {over[0]} would turn too far at t = {motion.t[k]:g} s; a section holds for up to 2 pi"
            raise Bad("motion.coordinates", told)


def _of_path(question, progress):
    """Course of a path in its timing, its waypoints solved at rest first; their Result where that fails."""
    asked = replace(question, motion=None, discretisation=False)
    solver = asked.prepare()
    before = solver.solve(progress=progress)
    if not before.status.solved:
        return replace(before, question=question)
    robot = question.loaded
    name, path = next((name, goal) for name, goal in question.goals.items() if isinstance(goal, Path))
    waypoints = path.waypoints()
    way = Way(waypoints, before.arrays["path.q"], scales(robot).q)
    others = {n: goal for n, goal in question.goals.items() if n != name and goal.weight is None}
    numbers = [x for goal in others.values() for x in goal.numbers()]
    t = question.motion.samples(question.timing.duration)
    places = way.place(question.timing.share(t)[0])
    targets = np.array([[*path.stop(tuple(place)).numbers(), *numbers] for place in places])
    tracked = Tracked(robot, {name: path.stop(waypoints[0]), **others})
    u, when = (before.arrays[key] for key in ("path.u", "path.t"))
    rest = np.column_stack([np.interp(t, when, own) for own in u.T])
    motion, status = Wanted(t, *way.timed(question.timing, t), targets, rest), None
    if loops := Closing.of(question, solver.balance):
        motion, status = loops.closed(motion)
    if status is not None:
        return replace(before, question=question, status=status)
    return Course(motion, tracked, u[0], loops, way, name, before)


class Drive:
    """One motion on its way to arrays, values and details."""

    def __init__(self, question, course):
        self.question, self.course, self.robot = question, course, question.loaded
        held = question.named("coordinates", question.coordinates)
        self.plant = Pulled(self.robot, held)
        self.weights = displacement_weights(self.robot)
        self.passes, self.details, self.values, self.clock = 0, {}, {}, {}
        wanted = course.wanted
        self.arrays = {"t": wanted.t, "q": wanted.q, "qd": wanted.qd, "qdd": wanted.qdd}
        if course.before is not None:
            self.arrays |= {k: v for k, v in course.before.arrays.items() if k.startswith("path.")}
            self.details = {k: course.before.details[k] for k in ("attempts", "waypoints", "waypoints_solved")}

    def run(self, progress):
        """Status; arrays, values and details are filled as far as it came."""
        question, course, simulate = self.question, self.course, self.question.motion.simulate
        if simulate:
            closed = (course.wanted.q[0], course.loops.balance) if course.loops else ()
            refuse_massless(self.plant, *closed)
        fitter = self._fitter(self._rates())
        try:
            most = PASSES if course.way else 1  # what is given stays as it is given
            with self._timed("tensions"):
                found = passed(fitter, course.wanted, course.near, self.weights, self.robot.length, most, progress)
            self.passes = found.count
            motion = found.followed if course.way else found.wanted
            self._describe(motion, found.last.u)
            stray, replay = self._displaced(found, motion), None
            if simulate:
                with self._timed("simulation"):
                    replay = simulated(self.plant, motion, found.last.u, question.motion.tolerance, progress)
                stray = self._deviated(replay) if replay.status.solved else stray
            status = judged(question, stray, replay.status if replay else None, self.values["motion.unmet"].value,
                            lambda: self._in_the_way(found, stray.allowed))  # fmt: skip
            if course.way is None:
                return status
            pace = self._pace()
            self.values |= pace.values(found.last.u, self.arrays["lengths"])
            fast = too_fast(pace, found.last.u, self.arrays["lengths"])
            return fast if fast and status.solved else status
        except KeyboardInterrupt:
            return Status("interrupted", "Stopped by the user; what was computed is kept.")

    @contextmanager
    def _timed(self, what):
        """Seconds of what is done inside, without making Functions, join the clock."""
        began = time.perf_counter()
        yield
        self.clock[f"{what}_seconds"] = time.perf_counter() - began

    def _limits(self):
        """(lower [m], upper [m]) with given inputs held."""
        lower, upper = self.question.input_limits()
        for i, value in self.question.named("inputs", self.question.inputs).items():
            lower[i] = upper[i] = value
        return lower, upper

    def _pace(self):
        """Pace of the path, in the samples of the motion."""
        pace = Pace(self.question, self._path, self.plant.functions)
        pace.t = self.course.wanted.t
        return pace

    def _rates(self):
        """(low [m], high [m]) of the rates of inputs, where they are limited."""
        high = np.full(self.robot.m, np.inf)
        low = -high
        for rate in self._pace().rates if self.course.way else ():
            if rate.letter == "u":
                low[rate.index], high[rate.index] = rate.low, rate.high
        return low, high

    def _fitter(self, rates):
        wanted = self.course.wanted
        return Fitter(self.plant, self.course.tracked, self._limits(), rates, float(wanted.t[-1]), self.course.loops)

    def _in_the_way(self, found, allowed):
        """Need or Hurry of an input whose limits lead the robot astray, None where none do; allowed [m]."""
        low, high = self._rates()
        fitter, samples = self._fitter((np.full_like(low, -np.inf), np.full_like(high, np.inf))), found.first
        if np.any(np.isfinite(low)):
            samples = sampled(fitter, found.wanted, samples.u[0])
            moved = float(np.max(np.abs(samples.dq - found.first.dq) * self.weights, initial=0.0))
            sentence = fastest(self._pace(), samples.u, self.arrays["lengths"])
            if sentence and moved > PART * allowed:
                return Hurry(sentence, moved)
        return needed(fitter, found.wanted, samples, self.weights)

    def _describe(self, motion, u):
        """Arrays of a motion under inputs u [K x m], and the largest force they leave unmet."""
        robot, plant, course = self.robot, self.plant, self.course
        there = ends(robot, plant.functions, {"q": motion.q})
        lengths = buffered(plant.functions.actuator_lengths)
        self.arrays |= {
            "q": motion.q, "qd": motion.qd, "qdd": motion.qdd, "u": u,
            "lengths": np.array([lengths(q)[0][0].copy() for q in motion.q]),
            **{f"{segment}.position": there[f"{segment}.position"] for segment in robot.segments},
        }  # fmt: skip
        unmet, largest, force, lam = np.zeros(motion.q.shape), SMALLEST_FORCE, scales(robot).force, []
        for k, own in enumerate(u):
            pushed, missed = self._left(motion, k, own)
            wanted = self._left(motion, k, 0 * own)[1]
            unmet[k, plant.free] = -missed
            largest = max(largest, float(np.max(np.abs(wanted) / force[plant.free], initial=0.0)))
            lam.append(pushed)
        self.arrays["unmet"] = unmet
        if course.loops:
            self.arrays["lam"] = np.array(lam)
        self.values["motion.unmet"] = Value(float(np.max(np.abs(unmet) / force, initial=0.0)) / largest, "1")
        if course.way is not None:
            path, places = self._path, course.way.place(self.question.timing.share(motion.t)[0])
            self.arrays["target"] = path.beside(places, self._tips(motion.q))

    def _left(self, motion, k, u):
        """lam of loops at sample k of a motion under inputs u [m], None without loops, and the force missing [n_f]."""
        missing, loops = self.plant.missing(*motion.state(k), u), self.course.loops
        return loops.shared(motion.q[k], missing) if loops else (None, missing[self.plant.free].copy())

    @property
    def _path(self):
        return self.question.goals[self.course.name]

    def _tips(self, rows):
        """Places [K x 3] of the tracked point at coordinates [K x n]."""
        pose = self.plant.functions.pose(self._path.on, self._path.at).function
        return np.array([np.array(pose(q))[:3, 3] for q in rows])

    def _stray(self, largest, what, time, simulated):
        allowed = self.question.motion.tolerance * self.robot.length
        return Stray(float(largest), what, float(time), allowed, simulated)

    def _displaced(self, found, motion):
        """Stray by what is left unmet, to first order."""
        gaps = np.max(np.abs(found.followed.q + found.last.dq - motion.q) * self.weights, axis=1, initial=0.0)
        if self.course.way is not None:
            missed = found.last.miss[:, : len(self._path.axes)]
            gaps = np.maximum(gaps, np.linalg.norm(missed, axis=1) * self.robot.length)
        k = int(np.argmax(gaps))
        return self._stray(gaps[k], "the robot", motion.t[k], False)

    def _deviated(self, replay):
        """Stray of the simulation, which joins arrays and values."""
        arrays, values = self.arrays, self.values
        arrays |= {"replay.q": replay.q, "replay.qd": replay.qd}
        arrays |= {f"replay.{segment}.position": rows for segment, rows in replay.ends.items()}
        off = deviations(self.question, arrays, replay)
        for segment, rows in replay.ends.items():
            gap = np.linalg.norm(rows - arrays[f"{segment}.position"], axis=1)
            values[f"replay.{segment}"] = Value(float(np.max(gap)), "m")
        values |= {"replay.tip": Value(off.tip, "m"), "replay.tip_share": Value(off.share, "1")}
        stray = self._stray(off.tip, f"the end of {off.segment}", off.time, True)
        if self.course.way is None:
            return stray
        axes = ["xyz".index(axis) for axis in self._path.axes]
        gaps = np.linalg.norm((self._tips(replay.q) - arrays["target"])[:, axes], axis=1)
        k = int(np.argmax(gaps))
        values["replay.path"] = Value(float(gaps[k]), "m")
        return self._stray(gaps[k], self.course.name, replay.t[k], True) if gaps[k] > stray.largest else stray
