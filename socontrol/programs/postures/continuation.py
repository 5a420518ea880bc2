"""Problem type `continuation`: how the robot at rest changes with one parameter, where it turns back and buckles."""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from socontrol.programs.equilibria.branches import follow
from socontrol.programs.equilibria.critical import Finder
from socontrol.programs.equilibria.family import Family
from socontrol.programs.equilibria.held_balance import balance_of
from socontrol.programs.looks.answer import Look
from socontrol.programs.postures.branch_answer import answered
from socontrol.programs.postures.goals import locate
from socontrol.programs.postures.varying import Vary, Watch, varied
from socontrol.programs.question import Question, Raw
from socontrol.programs.result import Result, Status
from socontrol.quantities import Bad, Count, Integer, record


@record(kw_only=True)
class Continuation(Question):
    """How does the equilibrium change as a load grows, and where does it turn back or buckle?

    vary: what grows, `from` one value `to` another; branches: how many are followed of those that leave from
    bifurcations, in the order in which these are found (two along each mode); points: at most so many on a branch;
    watch: the place whose displacement is plotted (default: the one that moves farthest). A branch that turns back ends
    as far below `from` as `to` is above it.
    """

    vary: Vary
    to: Raw
    from_: Raw = 0.0
    branches: Integer = 2
    points: Count = 200
    watch: Watch | None = None
    knows_loops = True

    def read_given(self):
        super().read_given()
        if self.branches < 0:
            raise Bad("branches", f"{self.branches} is negative")
        if self.varied.growth.kind == "coordinate":
            self.coordinate_limits()
        if not np.any(self.free):
            raise Bad("coordinates", "every coordinate is given, so that no equilibrium is sought")
        if self.watch is not None:
            try:
                locate(self.robot, self.watch)
            except Bad as bad:
                raise Bad(f"watch.{bad.key}", str(bad)) from None

    @cached_property
    def varied(self):
        """Varied: what changes, read and checked."""
        return varied(self)

    @cached_property
    def locked(self):
        """{index: value} of the coordinates that are held, the one that varies among them at its beginning."""
        growth, locked = self.varied.growth, dict(self.named("coordinates", self.coordinates))
        return {**locked, growth.index: growth.start} if growth.kind == "coordinate" else locked

    @property
    def acting(self):
        """Inputs [m], one that varies at an end of its range where it is not zero."""
        growth, u = self.varied.growth, self.vector("inputs", self.inputs)
        if growth.kind == "input":
            u[growth.index] = growth.stop or growth.start
        return u

    @property
    def free(self):
        """Mask [n] of the coordinates that equilibrium decides."""
        return ~np.isin(np.arange(self.robot.n), list(self.locked))

    def solve(self, progress=None):
        return _Search(self, progress).solve()


@dataclass
class Tree:
    """Branches found, each with the index of the critical point it leaves from (None: the first), the Finder of
    critical points, and bifurcations from which no branch could be reached."""

    finder: Finder
    branches: list = field(default_factory=list)
    origins: list = field(default_factory=list)
    barren: list = field(default_factory=list)

    def add(self, branch, origin=None):
        self.branches.append(branch)
        self.origins.append(origin)


def family_of(question):
    """(Family of the equilibria that a Continuation asks for, the equilibrium at the beginning, its Point; None where
    there is no equilibrium, or where numbers are not finite)."""
    growth, balance = question.varied.growth, balance_of(question.loaded, parameters=question.varied.paths)
    u = question.vector("inputs", question.inputs)
    p = growth.start * growth.values if growth.kind == "loads" else None
    if growth.kind == "input":
        u[growth.index] = growth.start
    q0 = question.vector("coordinates", question.guess.coordinates, "guess.coordinates")
    start = balance.solve(u, q0, p, question.locked, question.solver.max_iterations)
    family = Family(balance, growth, u, question.free, Look(question, balance).conservative(question.acting))
    if not start.status.solved:
        return family, start, None
    lam = getattr(start, "lam", np.zeros(0))
    return family, start, family.point(start.q, lam, 0.0, np.append(np.zeros(family.size.size), 1.0))


class _Search:
    """One call of `Continuation.solve`."""

    def __init__(self, question, progress):
        self.question, self.progress = question, progress or (lambda done, total, sentence: None)

    def solve(self):
        began, question = time.perf_counter(), self.question
        family, start, first = family_of(question)
        result = Result(name=question.name, type="continuation", status=start.status, question=question)
        if first is None:
            solved = start.status.solved  # at rest, but its tangent is not finite
            told = "The model gives NaN or infinity; begin elsewhere." if solved else start.status.message
            told = f"At the beginning, {question.varied.told(0.0)}: {told}"
            status = Status("numerical" if solved else start.status.outcome, told)
            solver = {"iterations": start.iterations, "seconds": time.perf_counter() - began}
            return replace(result, status=status, solver=solver)
        tree = Tree(Finder(family))
        self.progress(0, 1 + question.branches, "the first branch")
        tree.add(follow(family, first, question.points, tree.finder.between))
        self._others(tree)
        solver = {"iterations": start.iterations + family.count, "seconds": time.perf_counter() - began}
        return answered(replace(result, solver=solver), family, tree, Look(question, family.balance))

    def _others(self, tree):
        """Branches from the bifurcations found so far, and from those found on these."""
        finder, wanted, k = tree.finder, self.question.branches, 0
        while k < len(finder.found) and len(tree.branches) <= wanted:
            critical = finder.found[k]
            for way in finder.ways(critical) if critical.kind == "bifurcation" else ():
                if len(tree.branches) > wanted:
                    break
                self.progress(len(tree.branches), 1 + wanted, f"branch {len(tree.branches)}")
                branch = finder.switched(critical, way, self.question.points)
                if branch is None:
                    tree.barren.append(k)
                else:
                    tree.add(branch, k)
            k += 1
