"""IMU clock: samples get times of the host, by the clock or the counter of the device, or by their number."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, IntArray
from lab.data.clock.clock_watch import ClockWatch, sent_again
from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.faults import steps_from
from lab.data.clock.limits import LIMITS

BY_NUMBERS = "by the number of samples"
"""How samples are timed that nothing numbers or times: which of them are missing does not show."""

Rows = NDArray[np.void]

COUNTED = 2.0
"""Time over which the rate of a device without a clock is taken [s]."""

_NEXT = 0.05
"""Part of the usual interval by which the next sample of a counter that turns over may miss it: then it came
late, and nothing is missing. Samples that are missing leave any part of a turn, of 21 intervals, so this is
wrong in one of 200 short silences."""


class ImuClock:
    """Times the samples of one IMU.

    Attributes
    ----------
    clock : DeviceClock
        The mapping from the device's clock to the host's.
    watch : ClockWatch
        What happened to the device's clock.
    rate : float
        Rate by which samples are counted [Hz]; 0 if their clock is used, or it is not known yet.
    counted : int
        Samples that were timed by their number.
    missing : int
        Samples that the clock or the counter shows to be missing.
    timing : str
        How samples are timed, in words.

    Parameters
    ----------
    rate
        Of a device without a clock [Hz]; 0 to find out.
    put
        Takes rows, their times (n,) [s], the time of their arrival [s], and which of them follow a gap, and
        returns the timed rows.
    none
        What stands for no rows.
    """

    def __init__(
        self,
        rate: float,
        put: Callable[[Rows, FloatArray, float, NDArray[np.bool_]], Rows],
        none: Rows,
    ) -> None:
        self.rate = rate
        self.timing = ""
        self.missing = 0
        self.counted = 0
        self.clock = DeviceClock()
        self.watch = ClockWatch()
        self._put, self._none = put, none
        self._given_rate = rate > 0
        self.watch.declared = 1 / rate if rate > 0 else np.nan
        self._has_counter = self._counting = False
        self._waiting: list[tuple[float, Rows]] = []
        self._values: FloatArray | None = None  # times, rates and forces of the last samples
        self._paced: deque[tuple[float, int]] = deque()  # arrivals and numbers of the last samples
        self._rebase = False  # whether times by number begin, or get another rate
        self._pace = Pace()
        self._number = -1  # of the last sample, by the counter of the device
        self._last_arrival = np.nan
        self._wrapped = 0.0

    def restart(self) -> None:
        """Forget the mapping: the device was lost."""
        self._waiting.clear()
        self.clock.restart()
        self.watch.forget()
        self._paced.clear()
        self._pace, self._number = Pace(), -1
        self._last_arrival, self._wrapped = np.nan, 0.0

    @property
    def pace(self) -> list[float | None]:
        """All that a change of the measured rate depends on; `restore` goes on from it."""
        return [] if self._given_rate else self._pace.state

    def restore(self, counted: Any, pace: Any) -> None:
        """Go on with a number of samples, and with what shows their rate; what is damaged is left out."""
        if isinstance(counted, int) and 0 <= counted < 2**53:
            self.counted = counted
        known = Pace.restored(pace)
        if known is not None:
            self._pace, self._given_rate = known, False
            self.watch.declared = np.nan

    def scale_rates(self, factor: float) -> None:
        """Compare the next samples with those before, whose rates had another unit."""
        if self._values is not None:
            self._values[:, 1:4] *= factor

    def timed(self, rows: Rows, arrival: float, wrap_period: float) -> Rows:
        """Return the timed rows of samples that arrived.

        Parameters
        ----------
        rows : (n,) array of `lab.data.protocols.samples.IMU`
            The samples.
        arrival
            When they arrived [s].
        wrap_period
            Time after which the device's clock starts again [s].
        """
        if not len(rows):
            return self._none
        if np.isfinite(rows["time"][-1]):
            device = self._unwrap_times(rows["time"], arrival, wrap_period)
            rows, device = self._drop_repeated(rows, device, arrival)
            if not len(rows):
                return self._none
            if not self.watch.distrusted:
                self.timing = "by the clock of the device"
                return self._by_clock(rows, device, arrival)
        numbers = self.counted + np.arange(len(rows), dtype=float)
        self.counted += len(rows)
        if self.rate == 0.0:
            return self._measure_rate(rows, arrival)
        return self._by_count(rows, numbers, arrival)

    def _drop_repeated(self, rows: Rows, device: FloatArray, arrival: float) -> tuple[Rows, FloatArray]:
        """Return samples without those that were sent twice; see whether a bad clock runs evenly again."""
        values = np.concatenate((device[:, None], rows["rate"], rows["force"]), axis=1)
        before = np.full((1, 7), np.nan) if self._values is None else self._values
        fresh = ~sent_again(values, before)
        is_fresh = bool(fresh.all())
        self._values = np.concatenate((before, values if is_fresh else values[fresh]))[-LIMITS.compared :]
        if not is_fresh:
            self.watch.repeated += int((~fresh).sum())
            rows, device = rows[fresh], device[fresh]
        passed = self._paced[-1][1] if self._paced else 0
        self._paced.append((arrival, passed + len(rows)))
        while arrival - self._paced[0][0] > 2 * COUNTED:
            self._paced.popleft()
        waits = not self.watch.distrusted or not self.rate or not len(device)
        if not waits and self.watch.runs_again(device, 1 / self.rate, arrival):
            self.watch.rebase(float(device[0]) - 1 / self.rate, self.clock)
            self.clock.counted = False
            self.rate = self.rate if self._given_rate else 0.0
        return rows, device

    def _unwrap_times(self, device: FloatArray, arrival: float, period: float) -> FloatArray:
        """Return times of the device's clock with the turns that it made in a silence."""
        # The first time of all gives NaN, which every comparison below refuses.
        silence = arrival - self._last_arrival
        self._last_arrival = arrival
        step = (float(device[0]) + self._wrapped - self.watch.last) % period
        # The counter goes on as if nothing had passed: the host was late, and the device did not pause.
        stalled = abs(step - self.watch.usual) < _NEXT * self.watch.usual and silence < 2 * period
        if np.isfinite(period) and silence > period / 2 and not stalled:
            missed = self.watch.last + silence - (float(device[-1]) + self._wrapped)
            self._wrapped += period * round(missed / period)
        return device + self._wrapped

    def _measure_rate(self, rows: Rows, arrival: float) -> Rows:
        """Keep samples until their nominal rate is known, then time them."""
        self._waiting.append((arrival, np.array(rows)))
        begin, first = self._waiting[0]
        if arrival - begin < COUNTED:
            return self._none
        counts = np.concatenate([part["count"] for _, part in self._waiting])
        # A counter that stands still or runs backwards is none.
        self._has_counter = bool(counts.min() >= 0 and (np.diff(counts) > 0).all())
        # The samples of the first arrival were made before it: time counts from there, and they do not.
        passed = counts[-1] - first["count"][-1] if self._has_counter else len(counts) - len(first)
        self.rate = nominal_rate(max(float(passed), 1.0) / (arrival - begin))
        self.counted = 0
        held, self._waiting = self._waiting, []
        parts = []
        for when, part in held:
            numbers = self.counted + np.arange(len(part), dtype=float)
            self.counted += len(part)
            parts.append(self._by_count(part, numbers, when))
        return np.concatenate(parts)

    def _by_count(self, rows: Rows, numbers: FloatArray, arrival: float) -> Rows:
        """Time samples by the counter of the device, or by their numbers, at the nominal rate."""
        if self._given_rate and not self._counting:
            self._has_counter = bool((rows["count"] >= 0).all()) and not self.watch.distrusted
        self._counting = True
        counter = "by the counter of the device" if self._has_counter else BY_NUMBERS
        self.clock.counted = not self._has_counter
        count = rows["count"].astype(float) if self._has_counter else numbers
        rate = self.rate if self._given_rate else self._pace.judged(float(count[-1]), self.rate, arrival)
        if rate != self.rate:
            self.rate, self._rebase = rate, True
            self.clock.forget_drift()
        if self._rebase:
            self.watch.rebase((float(count[0]) - 1) / self.rate, self.clock)
            self._rebase = False
        self.timing = f"{counter} at {self.rate:g} Hz, {'given' if self._given_rate else 'measured'}"
        return self._by_clock(rows, count / self.rate, arrival)

    def _by_clock(self, rows: Rows, device: FloatArray, arrival: float) -> Rows:
        """Map times of the device to those of the host; drop what was sent twice, or came after later."""
        known = np.isfinite(device)
        if not known.all():
            rows, device = rows[known], device[known]
        if not len(rows):
            return self._none
        begun, last = np.isfinite(self.clock.offset), self.watch.last
        followed = self.watch.follow(device, arrival, self.clock)
        rows, device = rows if followed.kept.all() else rows[followed.kept], followed.device
        if not len(rows):
            return self._none
        steps = steps_from(last, device)
        times, anew = self.clock.mapped(device, arrival)
        steps[followed.changed] = np.nan  # the clock was set: no sample is missing
        gap, missing = self.watch.gaps(steps)
        self.missing += self._missing_numbers(rows["count"], missing)
        if anew and begun:
            gap[0] = True
        # After the mapping: it was that of the times without the step, and the next ones have it.
        self.clock.shift(followed.moved)
        if followed.useless:
            self._begin_to_count(arrival)
        return self._put(rows, times, arrival, gap)

    def _missing_numbers(self, count: IntArray, otherwise: int) -> int:
        """Return how many numbers the counter of the device left out; what the clock shows without one."""
        before, self._number = self._number, int(count[-1])
        steps = np.diff(count, prepend=before)
        if before < 0 or not (steps.min() > 0 and steps.max() < _LEAP):
            return otherwise
        return int(steps.sum()) - steps.size

    def _begin_to_count(self, arrival: float) -> None:
        """Time samples by their number from now on, at the rate so far if it is known."""
        self.counted, self._rebase, self._counting, self._has_counter = 0, True, True, False
        if self.rate or not self._paced or arrival - self._paced[0][0] < COUNTED:
            return
        begin, first = self._paced[0]
        measured = (self._paced[-1][1] - first) / (arrival - begin)
        # The clock that is given up may still have told the rate; the arrivals alone know it to a percent.
        usual = 1 / self.watch.usual
        self.rate = nominal_rate(usual if abs(usual / measured - 1) < NEAR else measured)


_LEAP = 10_000
"""Numbers left out by the counter of a device from which it began anew: a minute at 160 Hz."""


class Pace:
    """Judges the rate by which samples are counted: how late they are must not grow or shrink steadily.

    A sketch that waits 100 ms between samples sends 9.7 a second, and the oscillators of MEMS are 1 or 2 %
    off. Where samples are lost, those after them are late at once.
    """

    def __init__(self) -> None:
        self._heard = math.nan  # last arrival
        self._begin(math.nan, math.nan)

    def _begin(self, arrival: float, number: float) -> None:
        self._begun, self._first = arrival, number
        self._least, self._ends = math.inf, arrival + LIMITS.look  # least delay of a look, and its end
        self._looked = self._base = math.nan  # end of the first look, and its least delay
        self._before = math.nan  # least delay of the last look
        self._largest = 0.0  # change from look to look

    @property
    def state(self) -> list[float | None]:
        """All that it depends on."""
        return [value if math.isfinite(value) else None for value in vars(self).values()]

    @classmethod
    def restored(cls, state: Any) -> Pace | None:
        """Return what had a state; None if this is none, as in a damaged or older recording."""
        new = cls()
        if not isinstance(state, list) or len(state) != len(vars(new)):
            return None
        for name, value in zip(vars(new), state, strict=True):
            if isinstance(value, int | float) and abs(value) < LIMITS.largest:
                setattr(new, name, float(value))
        return new

    def judged(self, number: float, rate: float, arrival: float) -> float:
        """Return the rate of samples [Hz], another one where the delays contradict it.

        Parameters
        ----------
        number
            Of the last sample.
        rate
            The rate so far [Hz].
        arrival
            When it arrived [s].
        """
        if not arrival - self._heard < max(LIMITS.step, LIMITS.filled / rate):
            self._begin(arrival, number)  # in a silence, samples may be lost
        self._heard = arrival
        self._least = min(self._least, arrival - self._begun - (number - self._first) / rate)
        if arrival < self._ends:
            return rate
        least, self._least, self._ends = self._least, math.inf, arrival + LIMITS.look
        if math.isnan(self._base):
            self._looked, self._base, self._before = arrival, least, least
            return rate
        self._largest = max(self._largest, abs(least - self._before))
        self._before = least
        grown, since = least - self._base, arrival - self._looked
        if since < COUNTED or not 2 * self._largest < abs(grown) > LIMITS.step:
            return rate
        self._begin(arrival, number)
        # Delays that grow mean that samples come later than counted: the true rate is lower.
        return nominal_rate(rate * (1 - grown / since), LIMITS.step / since / 2)


USUAL_RATES = (
    1, 2, 4, 5, 8, 10, 20, 25, 40, 50, 60, 100, 104, 119, 120, 125, 128, 150, 160, 200, 208, 238, 240, 250,
    256, 300, 400, 416, 476, 500, 512, 600, 800, 833, 952, 1000, 1024, 1125, 1600, 2000,
)  # fmt: skip
"""Rates that devices are set to [Hz]."""
NEAR = 0.03
"""Largest part by which a measured rate may differ from a usual one: over `COUNTED`, at 50 Hz, one sample."""


def nominal_rate(measured: float, near: float = NEAR) -> float:
    """Return the usual rate next to a measured one [Hz], or the measured one if none is near."""
    best = min(USUAL_RATES, key=lambda rate: abs(rate / measured - 1)) if measured > 0 else 0
    return float(best) if best and abs(best / measured - 1) <= near else measured
