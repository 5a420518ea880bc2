"""The least and the greatest compliance among all tensions that meet a question's conditions.

Each end is the best of local searches from several starts: the answer of least tension, and postures near random inputs
within the limits. With lengths held the compliance jumps where a cable goes slack: cables count gradually at first.
Then the stiffest posture keeps every cable taut that can be, if barely; for the softest those that came near slack are
let go, and any other in turn if that is softer.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from socontrol.programs.tensions.compliance_terms import Compliances
from socontrol.programs.tensions.redundancy import Redundancy

SOFT = 1e-2  # of an input's scale: tension at which a cable counts half while slack ones are sought
CLOSE = 1e-3  # of an input's scale: less tension than this may as well be none
KEPT = 1e-5  # of an input's scale: tension of a cable that is just taut
LOOSE = 1e-6  # smallest eigenvalue of the scaled tangent: what inputs that should be 0 leave of it
EQUAL, SOFTER = 1e-9, 1e-6  # of a compliance: ends that are one; worth another round
NEARING = 8  # steps towards random inputs: a start, not an optimum
TENSIONS, LENGTHS = 0, 1  # which of the two compliances
LEAST, GREATEST = 1, -1
WANTED = [(held, sign) for held in (TENSIONS, LENGTHS) for sign in (LEAST, GREATEST)]


@dataclass(frozen=True)
class End:
    """A posture, its compliances (C_T, C_L) [m/N], and the (held, sign) whose search came to its end there."""

    here: Any
    both: tuple
    of: tuple | None = None


class Range:
    """The compliances of `record` over all tensions that meet the conditions of a solved posture x (scaled)."""

    def __init__(self, solver, record, parameters, x):
        self.solver, self.parameters = solver, parameters
        self.redundancy = Redundancy(solver, parameters)
        self.answer, self.degrees, self._found = None, 0, []  # the answer stays None where nothing holds the robot
        if (here := self.redundancy.posed(x)) is not None and abs(here.smallest) > LOOSE:
            self.compliances = Compliances(solver, self.redundancy, record, here)
            self.answer, self.degrees = self._end(here), self.redundancy.degrees(here)

    def ends(self):
        """{(held, end): End}, each the best found; empty where no posture is stable."""
        self._found = [self._end(here) for here in self.starts]
        if not self._found:
            return {}
        for held, sign in WANTED if self.degrees else ():
            for start in self.starts:
                self._search(held, sign, start)
        if self.degrees:
            self._loosen(self._best(LENGTHS, GREATEST))
            for held, sign in WANTED:  # what was found on the way to another end may be better
                if (best := self._best(held, sign)).of != (held, sign):
                    self._search(held, sign, best.here, as_slack=True)
        return {(held, sign): self._best(held, sign) for held, sign in WANTED}

    def taut(self, end):
        """Names of the inputs that hold their length there: taut cables, and chambers."""
        weights = self.compliances.taut(end.here)
        return [name for name, weight in zip(self.solver.question.robot.inputs, weights, strict=True) if weight]

    @cached_property
    def starts(self):
        """Stable postures that meet the conditions: the answer, those nearest random inputs, and from other shapes."""
        if self.answer is None:
            return []
        rng, question = np.random.default_rng(self.solver.question.solver.seed), self.solver.question
        lower, upper = (np.clip(bound[self.redundancy.y], -1.0, 1.0) for bound in self.redundancy.bounds)
        shapes = [here] if (here := self.redundancy.settled(self.answer.here.x)) else []
        found = list(shapes)
        for _ in range(question.solver.starts if self.degrees else 0):
            wanted = lower + (upper - lower) * rng.random(lower.size)
            other = self._elsewhere(wanted)
            if other is not None and all(np.max(np.abs(other.x - here.x)) > CLOSE for here in shapes):
                shapes.append(other)
                found.append(other)
            found += [self._towards(here, wanted) for here in shapes]
        return found

    def _elsewhere(self, wanted):
        """A posture of least cost that meets the conditions, found from the shape at these inputs (scaled); or None."""
        posture, program = self.solver.posture, self.redundancy.program
        x = self.answer.here.x.copy()
        x[self.redundancy.y] = wanted
        u = program.split(x)["u"]
        q = posture.balance.solve(u, prescribed=posture.prescribed).q
        if not np.all(np.isfinite(q)):
            return None
        outcome = posture.exact.solve(guess=posture.posed(q, u), parameters=self.parameters)
        if outcome.status.outcome == "interrupted":
            raise KeyboardInterrupt
        return self.redundancy.settled(outcome.x) if outcome.status.solved else None

    def _towards(self, here, wanted):
        """The posture nearest these inputs, or on the way there."""

        def distance(there):
            gradient = np.zeros(there.x.size)
            gradient[self.redundancy.y] = away = there.x[self.redundancy.y] - wanted
            return away @ away / 2, gradient

        return self.redundancy.least(here, distance, NEARING)[0]

    def _end(self, here, of=None):
        return End(here, self.compliances.both(here), of)

    def _best(self, held, sign):
        """The best found; among equals one that a search came to."""
        best = min(self._found, key=lambda end: sign * end.both[held])
        close = EQUAL * abs(best.both[held]) + self.compliances.floor
        equals = (end for end in self._found if abs(end.both[held] - best.both[held]) <= close)
        return next((end for end in equals if end.of == (held, sign)), best)

    def _search(self, held, sign, start, as_slack=False):
        """Keeps the end found from a start; `as_slack`: the cables slack there are slack at the end."""
        if held == TENSIONS:
            found = self.redundancy.least(start, self.compliances.tensions_held(sign))
        elif as_slack:
            found = self._counted(start, KEPT, sign)
        else:
            near, _ = self.redundancy.least(start, self.compliances.lengths_held(sign, soft=SOFT))
            found = (sign == LEAST and self._counted(near, 0.0, sign)) or self._counted(near, CLOSE, sign)
        if found:
            self._keep(held, sign, *found)

    def _keep(self, held, sign, here, reached):
        self._found.append(self._end(here, (held, sign) if reached else None))

    def _counted(self, here, least, sign):
        """End of the compliance with lengths held from `here`, its cables below `least` at no tension and slack, the
        others kept taut; None where that cannot be."""
        u = self.compliances.u[self.compliances.cables]
        slack = u[here.x[u] < least]
        narrower = self.redundancy.within(dict.fromkeys(np.setdiff1d(u, slack), KEPT), dict.fromkeys(slack, 0.0))
        here = narrower.settled(here.x)
        if here is None:
            return None
        return narrower.least(here, self.compliances.lengths_held(sign, weights=self.compliances.taut(here)))

    def _loosen(self, best):
        """Lets one more cable go at a time for as long as that makes the softest posture softer."""
        for i in self.compliances.u[self.compliances.cables]:
            if best.here.x[i] < CLOSE:
                continue

            def tension(here, i=i):
                return here.x[i], np.eye(here.x.size)[i]

            low, _ = self.redundancy.least(best.here, tension)
            found = self._counted(low, CLOSE, GREATEST) if low.x[i] < CLOSE else None
            if found:
                self._keep(LENGTHS, GREATEST, *found)
        if (better := self._best(LENGTHS, GREATEST)).both[LENGTHS] > (1 + SOFTER) * best.both[LENGTHS]:
            self._loosen(better)
