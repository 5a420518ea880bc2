"""Where the unknowns of a plan stand in the vector of all of them: stage by stage, in the order of time.

Every stage is laid out alike: what its node holds, then its interval; the last has a node alone. A point that is a node
has no unknowns of its own where the node holds them.
"""

import numpy as np


class Layout:
    """Places of unknowns of N intervals: node {letter: [N+1 x size]}, point {letter: [N x s x size]}, halfway
    [N x halves x n] and, with `lead`, lead [N x m]; scale [all]: what each is over.

    held: letters that nodes hold; apart: the end of an interval is not the next node.
    """

    def __init__(self, scheme, N, scales, held, *, apart=False, halves=0, lead=False):
        self._scales, self._slots, self._stage, self._N = scales, {}, 0, N
        for letter in held:
            self._slot(("node", letter), letter)
        alone, last = self._stage, scheme.size - 1
        for i in range(scheme.size):
            for letter in "qvau":
                first, following = scheme.shared and i == 0, i == last and letter in held and not apart
                if not first and not following:
                    self._slot(("point", letter, i), letter)
        for i in range(halves):
            self._slot(("halfway", i), "q")
        if lead:
            self._slot(("lead",), "u")
        scale = np.concatenate([scales[letter] for _, letter in self._slots.values()])
        self.scale = np.resize(scale, N * self._stage + alone)
        self.node = {letter: self._places(("node", letter), N + 1) for letter in held}
        self.point = {letter: self._points(letter, scheme) for letter in "qvau"}
        rows = [self._places(("halfway", i), N) for i in range(halves)]
        self.halfway = np.stack(rows, axis=1) if rows else np.zeros((N, 0, scales["q"].size), dtype=int)
        self.lead = self._places(("lead",), N) if lead else np.zeros((0, scales["u"].size), dtype=int)

    def _slot(self, key, letter):
        self._slots[key] = self._stage, letter
        self._stage += self._scales[letter].size

    def _places(self, key, stages):
        start, letter = self._slots[key]
        return np.arange(stages)[:, None] * self._stage + start + np.arange(self._scales[letter].size)

    def _points(self, letter, scheme):
        rows = []
        for i in range(scheme.size):
            key, before = ("point", letter, i), scheme.shared and i == 0
            own = key in self._slots
            rows.append(self._places(key, self._N) if own else self.node[letter][not before :][: self._N])
        return np.stack(rows, axis=1)
