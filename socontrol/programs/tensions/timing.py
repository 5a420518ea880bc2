"""When a path is where: constant speed along it, rising from rest and falling to rest smoothly."""

import numpy as np

from socontrol.programs.motions.integrators import Duration
from socontrol.quantities import Bad, Second, record

SHARE = 0.1  # of the duration: the ramp where none is given


@record(kw_only=True)
class Timing:
    """The whole way takes `duration`; speed rises over the first `ramp` (default: a tenth of the duration) and falls
    over the last, without a jump of acceleration or of its rate. A ramp of 0 is constant speed throughout."""

    duration: Duration
    ramp: Second | None = None

    def __post_init__(self):
        if not 0 <= self.rise <= self.duration / 2:
            raise Bad("ramp", f"{self.rise:g} s is given; from 0 to half the duration, {self.duration / 2:g} s")

    @property
    def rise(self):
        """Length of the ramp [s]."""
        return SHARE * self.duration if self.ramp is None else self.ramp

    def share(self, t):
        """Share of the way at t [K], from 0 to 1, and its first and second derivative [1/s, 1/s^2]."""
        t = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        back = t > self.duration / 2
        own = np.where(back, self.duration - t, t)  # the way out is the way in, seen backwards
        top, rise = 1 / (self.duration - self.rise), self.rise
        if rise == 0:
            share, speed, change = own * top, np.full(own.shape, top), np.zeros(own.shape)
        else:
            x = np.minimum(own / rise, 1.0)
            share = top * (rise * x**4 * (2.5 - 3 * x + x**2) + np.maximum(own - rise, 0.0))
            speed = top * x**3 * (10 - 15 * x + 6 * x**2)
            change = top / rise * 30 * x**2 * (1 - x) ** 2
        return np.where(back, 1 - share, share), speed, np.where(back, -change, change)

    def when(self, share):
        """Times [K] at which the shares [K] of the way, from 0 to 1, are done."""
        share = np.asarray(share, dtype=float)
        low, high = np.zeros(share.shape), np.full(share.shape, self.duration)
        for _ in range(60):  # halving: share(t) rises
            middle = (low + high) / 2
            before = self.share(middle)[0] < share
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return np.where(share <= 0, 0.0, np.where(share >= 1, self.duration, (low + high) / 2))
