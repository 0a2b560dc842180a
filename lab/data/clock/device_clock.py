"""Device clock: times of a device's clock as times of the host's.

Bytes arrive late by a delay that varies, but never early, so the least delay within a second shows the offset
of the two clocks. A loop of second order follows offset and drift: intervals between samples change by parts
in a million only, whatever single arrivals do. How late the first samples were, the first second shows; the
mapping makes up for that at `ClockLimits.made_up`, and takes it for no drift. It depends on the times alone,
so a replay gives the same bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.clock.limits import LIMITS

_OLDER = 7
"""Values of a state in recordings from before the beginning could be late."""


class DeviceClock:
    """Maps the times of one clock of a device.

    Parameters
    ----------
    counted
        Whether the times are numbers of samples, some of which may be missing unseen.

    Attributes
    ----------
    drift : float
        How much faster the device's clock runs than the host's, as a part of 1.
    drift_sigma : float
        σ of the drift, from how the least delays scatter; infinite before there are enough.
    steps : int
        How often the mapping began anew.
    """

    def __init__(self, *, counted: bool = False) -> None:
        self.counted = counted
        self.drift = 0.0
        self.drift_sigma = math.inf
        self.steps = 0
        self._looks = 0  # least delays since the mapping began
        self._scatter = 0.0  # mean square of them [s²]
        self._device = math.nan  # of the last sample
        self._host = math.nan
        self._begun = math.nan
        self._pace = 1.0  # of the host's clock against the device's
        self._slope = 0.0  # of it, that of the drift
        self._least = math.inf
        self._look_ends = math.inf
        self._owed = math.nan  # what is to be made up for a late beginning, NaN before that is known [s]

    @property
    def offset(self) -> float:
        """Host's time minus the device's, at the last sample [s]; NaN before the first."""
        return self._host - self._device

    @property
    def state(self) -> list[float | None]:
        """All that the mapping depends on; `restored` goes on from it."""
        return [value if math.isfinite(value) else None for value in self._values()]

    def _values(self) -> tuple[float, ...]:
        return (
            self._device, self._host, self._begun, self._pace, self._slope, self._least, self._look_ends,
            self._owed,
        )  # fmt: skip

    @classmethod
    def restored(cls, state: Any) -> DeviceClock:
        """Return the clock that had a `state`; a new one if this is none, as in a damaged recording."""
        clock = cls()
        usual = clock._values()
        if not isinstance(state, list) or len(state) not in (_OLDER, len(usual)):
            return clock
        state = [*state, *usual[len(state) :]]
        try:
            given = [known if one is None else float(one) for one, known in zip(state, usual, strict=True)]
        except (TypeError, ValueError, OverflowError):
            return clock
        pace, slope = given[3:5]
        if not (abs(slope) <= LIMITS.drift and abs(pace - 1) <= LIMITS.drift + LIMITS.slew):
            return clock
        clock._device, clock._host, clock._begun, clock._pace, clock._slope = given[:5]
        clock._least, clock._look_ends = given[5:7]
        # A recording may be damaged: no value of it takes the mapping beyond what `_follow` itself allows.
        clock._owed = min(max(given[7], -LIMITS.step), 0.0) if math.isfinite(given[7]) else math.nan
        clock.drift = 1 / (1 + slope) - 1
        return clock

    def restart(self) -> None:
        """Forget the offset, as when the device was lost; the drift stays."""
        self._device = math.nan

    def forget_drift(self) -> None:
        """Forget the drift: the next times are of another unit."""
        self._slope, self._pace = 0.0, 1.0

    def shift(self, step: float) -> None:
        """Go on with a clock that was set by a step [s]: the mapping of its new times is that of the old."""
        self._device += step

    def predicted(self, device: float) -> float:
        """Return the host's time for a time of the device, or for its last with NaN [s]; NaN before one."""
        if math.isnan(device):
            return self._host
        step = device - self._device
        return self._host + self._pace * step + float(self._recovered_delay(np.array(step)))

    def _recovered_delay(self, steps: FloatArray) -> FloatArray:
        """Return how much earlier times are than by the pace alone, for a late beginning; at most 0 [s]."""
        owed = 0.0 if math.isnan(self._owed) else self._owed
        return np.asarray(np.maximum(owed, -LIMITS.made_up * np.maximum(steps, 0.0)))

    def mapped(self, device: FloatArray, arrival: float) -> tuple[FloatArray, bool]:
        """Return times of the host for times of the device, and whether the mapping began anew.

        Parameters
        ----------
        device : (n,) array
            Times of samples that arrived together, increasing [s]; n > 0.
        arrival
            When they were there [s].
        """
        last = float(device[-1])
        step = last - self._device
        if not 0.0 < step < LIMITS.forward:
            return self._anchor_mapping(device, arrival), True
        steps = device - self._device
        made_up = self._recovered_delay(steps)
        times = self._host + self._pace * steps + made_up
        late = arrival - float(times[-1])
        # Earlier than it can have been sent: the clock was set forward. In small steps, the loop follows by
        # itself.
        if late < -LIMITS.step and step > LIMITS.step:
            return self._anchor_mapping(device, arrival), True
        self._device, self._host = last, float(times[-1])
        if not math.isnan(self._owed):
            self._owed -= float(made_up[-1])
            late -= self._owed
        # Only the least delay of a look counts: transport can delay a sample, and never bring it early.
        self._least = min(self._least, late)
        if arrival >= self._look_ends + LIMITS.look:  # a silence: what was held back comes late
            self._look_ends = arrival + LIMITS.look
        elif arrival >= self._look_ends:
            # A counter of samples that were lost on the way falls behind for good: no drift makes up for
            # that.
            if self.counted and self._least > LIMITS.step:
                return self._anchor_mapping(device, arrival), True
            self._follow(arrival)
        return times, False

    def _anchor_mapping(self, device: FloatArray, arrival: float) -> FloatArray:
        """Begin the mapping with these samples: the last of them has no delay."""
        self.steps += 1
        last = float(device[-1])
        # Before the last of them by their own distances, at the pace that is known so far.
        times = arrival + (1 + self._slope) * (device - last)
        self._device, self._host, self._begun = last, arrival, arrival
        self._pace = 1 + self._slope
        self._least, self._look_ends = math.inf, arrival + LIMITS.look
        self._looks, self._scatter, self.drift_sigma, self._owed = 0, 0.0, math.inf, math.nan
        return times

    def _follow(self, arrival: float) -> None:
        """Correct pace and drift by the least delay of the time that ended."""
        least = self._least
        if math.isnan(self._owed):
            self._owed = 0.0
            if -LIMITS.step < least < 0:  # nothing comes early: the beginning was late
                self._owed, least = least, 0.0
        # The loop is fast while little is known, and slows down as 2 / t to average over all that came.
        band = max(LIMITS.slowest, min(LIMITS.fastest, 2 / max(arrival - self._begun, LIMITS.look)))
        # 2 ζ ω with the damping ζ = 1/√2; the drift below has the other gain, ω² of a look.
        slew = min(max(math.sqrt(2) * band * least, -LIMITS.slew), LIMITS.slew)
        if abs(least) < LIMITS.step:
            self._slope = min(max(self._slope + band**2 * least * LIMITS.look, -LIMITS.drift), LIMITS.drift)
        elif least > 0:  # a network that is slow is no drift
            slew = 0.0
        self._pace = 1 + self._slope + slew
        # The slope is the host's time for the device's; the drift is the other way round.
        self.drift = 1 / (1 + self._slope) - 1
        self._judge(least, band)
        self._least, self._look_ends = math.inf, arrival + LIMITS.look

    def _judge(self, least: float, band: float) -> None:
        """Take the σ of the drift from the scatter of the least delays that the loop remembers.

        White delays of variance s² make a variance of the slope of look·band³·s²/(2√2) in a loop with a
        damping of 1/√2: Gardner, Phaselock Techniques, on the noise of the integrator.
        """
        self._looks += 1
        # The mean of all at first, then of as many as the loop itself remembers.
        self._scatter += max(1 / self._looks, band * LIMITS.look) * (least**2 - self._scatter)
        if self._looks >= LIMITS.fewest_delays:
            self.drift_sigma = LIMITS.narrowed * math.sqrt(
                LIMITS.look * band**3 * self._scatter / (2 * math.sqrt(2))
            )
