"""States a plan passes through: where it begins, where it ends, and waypoints on the way."""

from typing import Annotated, Literal

from socontrol.programs.postures.goals import Goal
from socontrol.programs.question import Named
from socontrol.quantities import Bad, Flag, Unit, record

Share = Annotated[float, Unit("1", lower=0.0, upper=1.0, exclusive=True)]
Moment = Annotated[float, Unit("s", lower=0.0, exclusive=True)]


@record(kw_only=True)
class Start:
    """The state at t = 0: coordinates and rates by name, 0 where none is given.

    settled: the shape at rest under `inputs` (default: 0, or the limit nearest 0), found first; `coordinates` are then
    its guess. Without any key: settled. Continuous inputs begin at `inputs`.
    """

    coordinates: Named | None = None
    rates: Named | None = None
    settled: Flag | None = None
    inputs: Named | None = None

    @property
    def is_settled(self):
        return self.settled if self.settled is not None else not self.coordinates

    def __post_init__(self):
        if self.rates and self.is_settled:
            raise Bad("rates", "a settled shape is at rest; write `settled: false` beside coordinates and rates")


@record(kw_only=True)
class _Passed:
    """What a state has to meet: coordinates, rates and inputs by name (others are free) and goals, exact or weighted.

    velocity: `rest` holds all rates at 0 but those named in `rates`. settled: accelerations are 0 too, an equilibrium.
    """

    coordinates: Named | None = None
    goals: dict[str, Goal] | None = None
    rates: Named | None = None
    velocity: Literal["rest", "free"] = "free"
    settled: Flag = False
    inputs: Named | None = None

    def __post_init__(self):
        if self.settled and (self.velocity != "rest" or self.rates):
            raise Bad("settled", "an equilibrium is at rest; write `velocity: rest`, and no rates")
        for name, goal in (self.goals or {}).items():
            if not hasattr(goal, "miss"):
                raise Bad(f"goals.{name}", "a path is followed in time by a cost of type `tracking`; give a point here")


@record(kw_only=True)
class End(_Passed):
    """What the state at the end has to meet; at rest where nothing else is said."""

    velocity: Literal["rest", "free"] = "rest"


@record(kw_only=True)
class Waypoint(_Passed):
    """What the state has to meet at `time`, or at a `share` of the duration."""

    time: Moment | None = None
    share: Share | None = None

    def __post_init__(self):
        super().__post_init__()
        if (self.time is None) == (self.share is None):
            raise Bad("time", "give `time` or `share`, one of the two")


