"""Which way cables with friction move along a path: the direction they had to move to get where they are.

A cable that grew shorter on the way to a waypoint was pulled in there (moving = 1), one that grew longer was let out
(-1), and one that stood still keeps the direction it had.
"""

import copy
from dataclasses import replace

import numpy as np

from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.looks.answer import Look
from socontrol.programs.postures.posture import Posture

STILL = 1e-9  # of the robot's length: a cable whose length changes by less does not move


def directed(solver):
    """(solver whose programs take the directions as parameters, Directions); (solver, None) without friction."""
    directions = Directions(solver.question)
    if not directions.paths:
        return solver, None
    own, robot = copy.copy(solver), solver.question.loaded
    parameters = [*solver.balance.parameters, *directions.paths.values()]
    own.balance = balance_of(replace(robot, compiled=False), parameters=parameters)
    own.posture = Posture(solver.question, solver.posture.goals, own.balance)
    own.look = directions.look(own.balance, directions.declared)
    return own, directions


class Directions:
    """paths: {input: path of its `moving`} of the cables that rub; declared: {path: number} as the file says."""

    def __init__(self, question):
        self.question, robot = question, question.loaded
        self.paths = {i: f"actuators.{name}.moving" for i, name in enumerate(robot.inputs)
                      if getattr(robot.input_actuators[i], "rubs", False)}  # fmt: skip
        self.declared = {path: float(robot.value(path)) for path in self.paths.values()}
        self._looks = {}

    def after(self, ways, change):
        """{path: direction} after lengths changed by `change` [m], with the directions `ways` before."""
        found, still = dict(ways), STILL * self.question.robot.length
        for i, path in self.paths.items():
            if abs(change[i]) > still:
                found[path] = -float(np.sign(change[i]))
        return found

    def ways(self, parameters):
        """{path: direction} among the parameters of a waypoint."""
        return {path: parameters[path] for path in self.declared}

    def table(self, rows):
        """[K x m] of the (outcome, parameters) of waypoints: direction of each input, NaN where nothing rubs."""
        found = np.full((len(rows), self.question.robot.m), np.nan)
        for k, (_, parameters) in enumerate(rows):
            for i, path in self.paths.items():
                found[k, i] = parameters[path]
        return found

    def undecided(self, table, lengths):
        """{input: waypoints} where a cable moved against the direction that its friction was reckoned with: friction
        holds it there, and its tension is between that of either direction."""
        found, still = {}, STILL * self.question.robot.length
        for i in self.paths:
            against = np.diff(lengths[:, i]) * table[1:, i] > still
            if against.any():
                found[self.question.robot.inputs[i]] = (np.flatnonzero(against) + 2).tolist()
        return found

    def look(self, balance, parameters):
        """Look at postures with the directions among `parameters`."""
        ways = self.ways(parameters)
        key = tuple(ways.values())
        if key not in self._looks:
            question = replace(self.question, robot=self.question.robot.with_values(ways))
            self._looks[key] = Look(question, _Held(balance, ways))
        return self._looks[key]


class _Held:
    """A Balance whose parameters are held at {path: value}."""

    def __init__(self, balance, values):
        self._balance, self.scales, self.conservative = balance, balance.scales, balance.conservative
        values = [np.ravel(values.get(path, balance.robot.value(path))) for path in balance.parameters]
        self._p = np.concatenate(values).astype(float)

    def evaluate(self, q, u, p=None):
        return self._balance.evaluate(q, u, self._p)

    def unbalanced(self, q, u, lam, p=None):
        return self._balance.unbalanced(q, u, lam, self._p)

    def held(self, q, free):
        return self._balance.held(q, free)
