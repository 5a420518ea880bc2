"""Limits lifted: with which values of one limit alone, or of several together, goals out of reach are met.

Each program starts where it ended within the limits, then at rest, then where the robot comes to rest with what stands
on its limit farther and farther beyond: from those of these shapes that are nearest to the goals. What is not found so
may still be there.
"""

import numpy as np

PULL = 1e4  # weight of moving the limit, beside an effort of order 1: its smallest move is found, nearly
WIDER = 1e3  # a limit is let go to this many times its span, so that the program stays bounded
FIRST, GROWTH = 0.25, 1.3  # of the span: the first step beyond a limit, and how each outgrows the one before
ITERATIONS = 40  # of load steps to the rest beyond


class Lifted:
    """The search from an `outcome` within the limits, at these `parameters`."""

    def __init__(self, solver, outcome, parameters):
        self.solver, self.posture, self.outcome, self.parameters = solver, solver.posture, outcome, parameters

    def alone(self, limit):
        """The value nearest its limit with which the goals are met when this limit alone is lifted; None if none is
        found."""
        posture, bounds = self.posture, self.posture.limits()
        key, side, index = ("u", "q")[limit["kind"] == "coordinate"], limit["side"] == "upper", limit["index"]
        lower, upper = bounds[key]
        span = upper[index] - lower[index]
        span = span if np.isfinite(span) and span > 0 else max(1.0, abs(limit["limit"]))
        way = (1 if side else -1) * span
        bounds[key][side][index] += WIDER * way
        further = {}
        if not posture.overdetermined:  # else what is nearest to the goals is sought, and that alone
            program = posture.freed.program
            pull, anchor = np.zeros(program.scale.size), np.zeros(program.scale.size)
            place = program.variables[key].where.start + index
            pull[place], anchor[place] = PULL, limit["limit"] / program.scale[place]
            further = {"pull": pull, "anchor": anchor}
        nlp = posture.nearest if posture.overdetermined else posture.freed
        found = self._met(nlp, bounds, {key: {index: way}}, further)
        return None if found is None else float(found[key][index])

    def together(self, indices):
        """{input: value} of least effort that meets the goals when the upper limits of the inputs `indices` are lifted,
        of those that pass theirs; {} where none is found."""
        posture, bounds = self.posture, self.posture.limits()
        lower, upper = bounds["u"]
        spans, allowed = np.maximum(upper - lower, 1e-3 * np.max(upper - lower)), upper.copy()
        upper[indices] += WIDER * spans[indices]
        nlp = posture.nearest if posture.overdetermined else posture.exact
        found = self._met(nlp, bounds, {"u": {i: spans[i] for i in indices}}, {})
        if found is None:
            return {}
        return {posture.robot.inputs[i]: float(found["u"][i]) for i in indices if found["u"][i] > allowed[i]}

    def _met(self, nlp, bounds, ways, further):
        """{variable: SI values} of the first posture found that meets the goals, or None."""
        for start in self._starts(ways):
            found = nlp.solve(guess=start, parameters={**self.parameters, **further}, bounds=bounds)
            if found.status.outcome == "interrupted":
                raise KeyboardInterrupt
            sound = found.status.solved and not self.solver.look.collapsed(found.values["q"])
            if sound and self.solver.meets(found, self.parameters):
                return found.values
        return None

    def _starts(self, ways):
        """{variable: SI values} to start from; ways {`u` or `q`: {index: step}}."""
        yield self.outcome.values
        yield self.solver.rest
        before = rising = None  # the shape before, and whether it was farther from the goals than that before it
        for shape in self._beyond(ways):
            if before is not None and rising is False and shape[0] >= before[0]:
                yield self.posture.posed(*before[1:])
            rising = None if before is None else bool(shape[0] >= before[0])
            before = shape
        if rising is False:
            yield self.posture.posed(*before[1:])

    def _beyond(self, ways):
        """(distance from the goals, q, u) of the outcome and of rests with what stands on limits ever farther beyond,
        until the robot finds no rest."""
        posture = self.posture
        q, u = (np.array(self.outcome.values[key], dtype=float) for key in ("q", "u"))
        yield self._apart(q), q, u
        width = FIRST
        while width <= WIDER:
            pushed, held = u.copy(), dict(posture.prescribed)
            for index, step in ways.get("u", {}).items():
                pushed[index] = u[index] + width * step
            for index, step in ways.get("q", {}).items():
                held[index] = self.outcome.values["q"][index] + width * step
            answer = posture.balance.solve(pushed, q, prescribed=held, max_iterations=ITERATIONS)
            if not answer.status.solved or self.solver.look.collapsed(answer.q):
                return
            q, width = answer.q, width * GROWTH
            yield self._apart(q), q, pushed

    def _apart(self, q):
        """How far q is from the goals, over their scales."""
        goals, length = self.posture.goals, self.posture.robot.length
        rows = [miss / np.array(goals[name].scales(length)) for name, miss in
                self.posture.misses(q, self.parameters).items() if goals[name].weight is None]  # fmt: skip
        return float(np.linalg.norm(np.concatenate(rows))) if rows else 0.0
