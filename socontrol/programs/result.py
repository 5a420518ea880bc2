"""The answer to a question: status, values with units, arrays, residuals; frozen, few fields."""

from dataclasses import dataclass, field
from typing import Any

OUTCOMES = {  # outcome: exit code
    "solved": 0,
    "infeasible": 4,
    "limit": 5,
    "numerical": 6,
    "rejected": 7,
    "interrupted": 130,
}


class NotSolved(RuntimeError):
    """Raised by `Result.require` when the answer is not a solution; its text is the status message."""


@dataclass(frozen=True)
class Status:
    """outcome: a key of OUTCOMES; message: a sentence that ends in what to do next."""

    outcome: str
    message: str

    @property
    def solved(self):
        return self.outcome == "solved"

    @property
    def exit_code(self):
        return OUTCOMES[self.outcome]


@dataclass(frozen=True)
class Value:
    """A number or nested list of numbers in SI `unit`."""

    value: Any
    unit: str


@dataclass(frozen=True)
class Result:
    """values: {name: Value}; arrays: {name: numpy array}; residuals: {name: Value}; solver: iterations, seconds.

    `details` holds what the report prints beyond values: attempts, limits reached, nearest pose, stability.
    """

    name: str
    type: str
    status: Status
    values: dict = field(default_factory=dict)
    arrays: dict = field(default_factory=dict)
    residuals: dict = field(default_factory=dict)
    solver: dict = field(default_factory=dict)
    details: dict = field(default_factory=dict)
    log: str = ""
    question: Any = None

    def require(self):
        """This result if it is solved; raises NotSolved with the status message otherwise."""
        if not self.status.solved:
            raise NotSolved(f"{self.name}: {self.status.message}")
        return self

    def __getitem__(self, name):
        """The plain value of `name`, e.g. result["cap.position"]."""
        return self.values[name].value
