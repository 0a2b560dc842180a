"""Clock watch: whether the clock of a device goes on evenly, and what happened to it if not.

A clock that was set, began anew or turned over moves all later times by one step. The watch takes this step
off, so the samples keep their order and their intervals, and reports it once. How long no sample came, only
the arrivals show. A clock that repeats its time stamps, or runs backwards, says nothing about the intervals
any more; its samples are then timed by their number.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.data.clock.device_clock import STEP, DeviceClock

MISSING: Final = 1.5
"""Interval, in usual ones, from which a sample is missing before it: halfway between that of none missing and
that of one."""
_SOONEST: Final = 0.5
"""Interval, in usual ones, below which a clock is not even: as far from the usual one as `MISSING`."""
LARGEST_TIME: Final = 1e12
"""Largest time that is believed [s]: 30 000 years. Damaged floats hold any number."""
REMEMBERED: Final = 0.02
"""Part that a new interval has in the usual one."""
UNKNOWN_STEP: Final = 1e-3
"""Interval that is taken after a change of the clock before a usual one is known [s]: it keeps the order."""
MOST_ODD: Final = 5
"""Changes within `WITHIN` samples from which the clock is not used any more. A clock that is set, begins anew
or turns over makes one, one that repeats or runs backwards nearly as many as samples: with 2, 5 or 15, all
tests of both pass."""
WITHIN: Final = 20
"""Samples in which changes are counted, and after which a change is reported as one of its own."""
EVEN: Final = 200
"""Even intervals in a row after which a clock is used again: a second of a usual IMU."""
MOST_EVENTS: Final = 100
"""Most events that are kept."""
COMPARED: Final = 128
"""Samples with which one is compared whose time is earlier than the last: datagrams hold at most 1,400 bytes,
so this is five of them."""
_MOST_GAPS: Final = 16  # gaps into which a late datagram may fall: those of the last second of a bad network
_BEGINS: Final = 2.0
"""Largest time that a clock shows which has just begun anew [s]: devices send within it."""
_TURNS: Final = {
    2**32 * 1e-6: "32 bits of microseconds",
    2**32 * 1e-3: "32 bits of milliseconds",
    2**24 * 1e-3: "24 bits of milliseconds",
    2**16 * 1e-3: "16 bits of milliseconds",
}
"""After how long counters of microcontrollers begin again [s]."""


class ClockEvent(NamedTuple):
    """Something that happened to the clock of a device.

    Attributes
    ----------
    arrival : float
        When its samples arrived, by the host's clock [s].
    size : float
        By how much the clock was set [s]; NaN for one that is no longer used, or used again.
    text : str
        What happened, in a sentence.
    """

    arrival: float
    size: float
    text: str


class Followed(NamedTuple):
    """Times without the changes of the clock.

    Attributes
    ----------
    kept : (n,) array of bool
        Which samples are used; the others were sent twice, or came after later ones.
    device : (k,) array
        Times of the samples kept, increasing, in the clock as it was before these samples [s].
    moved : float
        By how much the clock was set within them [s].
    changed : (k,) array of bool
        Samples at which it was set.
    useless : bool
        Whether the clock is not used any more after them.
    """

    kept: Flags
    device: FloatArray
    moved: float
    changed: Flags
    useless: bool


class ClockWatch:
    """Watches the clock of one device.

    Attributes
    ----------
    last : float
        Time of the last sample kept, as the device sent it [s]; NaN before the first.
    usual : float
        Usual interval [s]; NaN while it is unknown.
    distrusted : bool
        Whether the clock is not used any more.
    repeated, backwards, jumps : int
        Samples that were sent twice; that came after later ones; and changes of the clock.
    events : deque of ClockEvent
        The last events, oldest first.
    """

    def __init__(self) -> None:
        self.last = self.usual = math.nan
        self.distrusted = False
        self.repeated = self.backwards = self.jumps = 0
        self.events: deque[ClockEvent] = deque(maxlen=MOST_EVENTS)
        self._heard = math.nan  # arrival of the last samples
        self._number = 0  # of the next sample
        self._gaps: deque[tuple[float, float]] = deque(maxlen=_MOST_GAPS)
        self._odd: deque[tuple[int, float]] = deque(maxlen=MOST_ODD)  # numbers and intervals of changes
        self._pending: list[tuple[int, ClockEvent]] = []
        self._even = 0
        self._raw = math.nan  # time of the last sample that was timed by its number
        self._untold = 0
        self._restored = False

    def new_events(self) -> list[ClockEvent]:
        """Return the events since the last call."""
        new = list(self.events)[len(self.events) - self._untold :]
        self._untold = 0
        return new

    @property
    def state(self) -> dict[str, Any]:
        """All that later times depend on; `restore` goes on from it."""
        numbers = {"last": self.last, "usual": self.usual, "heard": self._heard}
        known = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        return {**known, "distrusted": self.distrusted}

    def restore(self, state: Any) -> None:
        """Go on from a state; what is damaged in it is left out."""
        if not isinstance(state, dict):
            return
        found = []
        for name in ("last", "usual", "heard"):
            value = state.get(name)
            found.append(
                float(value) if isinstance(value, int | float) and abs(value) < LARGEST_TIME else math.nan
            )
        self.last, self.usual, self._heard = found
        self.usual = self.usual if self.usual > 0 else math.nan
        self.distrusted = state.get("distrusted") is True
        self._restored = math.isfinite(self.last)

    def forget(self) -> None:
        """Forget the last sample, as when the device was lost."""
        self.publish()
        self.last = self._heard = math.nan
        self._gaps.clear()
        self._odd.clear()

    def rebase(self, last: float, clock: DeviceClock) -> None:
        """Go on with times of another origin, in which the last sample has this time [s]."""
        clock.shift(last - self.last)
        self.last = last
        self._gaps.clear()

    def follow(self, device: FloatArray, arrival: float, clock: DeviceClock) -> Followed:
        """Return times without the changes of the clock; the mapping begins anew after a silence in one.

        Parameters
        ----------
        device : (n,) array
            Times of samples that arrived together, as the device sent them [s]; n > 0.
        arrival
            When they were there [s].
        clock
            The mapping, up to the sample before.
        """
        if self._restored:
            self._restored = False
            # Decoders that continue counters begin in another turn than when the recording began.
            if not 0 < float(device[0]) - self.last < STEP:
                usual = UNKNOWN_STEP if math.isnan(self.usual) else self.usual
                self.rebase(float(device[0]) - usual, clock)
        steps = np.diff(device, prepend=self.last)
        widest = STEP if math.isnan(self.usual) else MISSING * self.usual
        odd = ~(steps > 0) | (steps > widest)
        odd[0] &= math.isfinite(self.last)
        kept, moved, changed = np.ones(len(device), bool), np.zeros(len(device)), np.zeros(len(device), bool)
        if odd.any():
            self._sort_out(device, arrival, clock, odd, (kept, moved, changed))
        else:
            self._number += len(device)
        total = float(moved[-1])
        times = (device - moved)[kept]
        if times.size:
            self.last = float(device[kept][-1])
        silence = self._silence(times, arrival, clock) if changed.any() else 0.0
        if silence > STEP:
            clock.restart()
        self._heard = arrival
        useless = self._report(device, moved, changed, arrival, silence)
        return Followed(kept, times, total, changed[kept], useless)

    def _sort_out(
        self, device: FloatArray, arrival: float, clock: DeviceClock, odd: Flags,
        found: tuple[Flags, FloatArray, Flags],
    ) -> None:  # fmt: skip
        """Find out what each odd interval is; fill the arrays ``kept``, ``moved`` and ``changed``."""
        kept, moved, changed = found
        places = np.flatnonzero(odd)
        ends = np.append(places[1:], len(device)) - 1  # the last sample before the next odd interval
        last, total, begin = self.last, 0.0, int(places[0])
        if begin:
            last = float(device[begin - 1])
        usual = UNKNOWN_STEP if math.isnan(self.usual) else self.usual
        number = self._number
        run = dict(zip(places.tolist(), ends.tolist(), strict=True))
        for i in range(begin, len(device)):
            time = float(device[i])
            step = time - last
            moved[i] = total
            if step <= 0 and self._fills_a_gap(time):
                self.backwards += 1
                kept[i] = False
                continue
            if step <= 0 or (
                step > STEP and i in run and self._is_early(device[run[i]] - total, arrival, clock)
            ):
                total += step - usual
                moved[i], changed[i] = total, True
                self._odd.append((number + i, step))
            elif step > MISSING * usual:
                self._gaps.append((last, time))
            last = time
        self._number += len(device)

    def _fills_a_gap(self, time: float) -> bool:
        """Return whether a sample was missing at this time: a network may deliver it after later ones."""
        return any(start < time < end for start, end in self._gaps)

    @staticmethod
    def _is_early(time: float, arrival: float, clock: DeviceClock) -> bool:
        """Return whether a sample would have arrived before its time."""
        return clock.predicted(time) - arrival > STEP

    def _silence(self, times: FloatArray, arrival: float, clock: DeviceClock) -> float:
        """Return how much later than the sample before these samples came, beside their intervals [s]."""
        if not times.size or math.isnan(self._heard):
            return 0.0
        now, before = arrival - clock.predicted(float(times[-1])), self._heard - clock.predicted(math.nan)
        return now - before if math.isfinite(now - before) else 0.0

    def _report(
        self, device: FloatArray, moved: FloatArray, changed: Flags, arrival: float, silence: float
    ) -> bool:
        """Keep an event for each change, until it is clear that it is one of its own.

        Returns
        -------
        bool
            Whether the clock is not used any more.
        """
        sizes = np.diff(moved, prepend=0.0)
        first = self._number - len(device)
        for i in np.flatnonzero(changed):
            size, silence = float(sizes[i]) - (silence if silence > STEP else 0.0), 0.0
            self._pending.append((first + int(i), _event(size, float(device[i]), arrival)))
        return bool(self._pending) and self._decide(arrival)

    def _decide(self, arrival: float) -> bool:
        recent = list(self._odd)
        if len(recent) == MOST_ODD and recent[-1][0] - recent[0][0] < WITHIN:
            steps = [step for _, step in recent]
            what = "repeats its time stamps" if all(step == 0 for step in steps[-2:]) else (
                "runs backwards" if max(steps) < 0 else "jumps again and again"
            )  # fmt: skip
            self._pending.clear()
            self._odd.clear()
            self.distrusted, self._even = True, 0
            self._publish(
                ClockEvent(
                    arrival, math.nan,
                    f"The device's clock {what}; from now on, the samples are timed by their number.",
                )
            )  # fmt: skip
            return True
        while self._pending and self._number - self._pending[0][0] > WITHIN:
            self._publish(self._pending.pop(0)[1])
        return False

    def publish(self) -> None:
        """Report what waits: nothing more will decide about it."""
        for _, event in self._pending:
            self._publish(event)
        self._pending.clear()

    def _publish(self, event: ClockEvent) -> None:
        self.jumps += 1
        self._keep(event)

    def _keep(self, event: ClockEvent) -> None:
        self.events.append(event)
        self._untold = min(self._untold + 1, MOST_EVENTS)

    def runs_again(self, device: FloatArray, interval: float, arrival: float) -> bool:
        """Return whether a clock that is not used has been even for long, so it is used again from now on.

        Parameters
        ----------
        device : (n,) array
            Times of samples that are timed by their number, as the device sent them [s].
        interval
            Interval of the samples [s].
        arrival
            When they were there [s].
        """
        steps = np.diff(device, prepend=self._raw)
        self._raw = float(device[-1])
        good = (steps > _SOONEST * interval) & (steps < MISSING * interval)
        bad = np.flatnonzero(~good)
        self._even = len(steps) - int(bad[-1]) - 1 if bad.size else self._even + len(steps)
        if self._even < EVEN:
            return False
        self.distrusted = False
        text = "The device's clock runs evenly again; the samples are timed by it."
        self._keep(ClockEvent(arrival, math.nan, text))
        return True

    def gaps(self, steps: FloatArray) -> tuple[Flags, int]:
        """Return before which samples some are missing, and how many, by the usual interval.

        Parameters
        ----------
        steps : (n,) array
            Intervals before the samples [s]; NaN where they say nothing.
        """
        if math.isnan(self.usual):
            known = steps[steps > 0]
            if known.size:
                self.usual = float(np.median(known))
        gap = steps > MISSING * self.usual
        ordinary = steps[~gap & (steps > 0)]
        if ordinary.size:
            share = min(1.0, REMEMBERED * ordinary.size)
            self.usual += share * (float(ordinary.mean()) - self.usual)
        missing = 0
        if gap.any():
            missing = int(np.rint(steps[gap] / self.usual - 1).sum())
            # A pace that changed for good is no gap: the usual interval follows it slowly.
            self.usual += REMEMBERED * (float(steps[gap].min()) - self.usual)
        return np.asarray(gap), missing


def sent_again(values: FloatArray, before: FloatArray) -> NDArray[np.bool_]:
    """Return which samples have come before: the one before them again, or a copy of an earlier one.

    Parameters
    ----------
    values, before : (n, 7), (k, 7) arrays
        Times of the device, rates and forces of the new samples, and of those before them.
    """
    previous = np.concatenate((before[-1:], values[:-1]))
    again = np.asarray((values == previous).all(axis=1))
    if not (values[:, 0] < previous[:, 0]).any():
        return again
    seen = {row.tobytes() for row in before}
    for k, row in enumerate(values):
        again[k] |= row.tobytes() in seen
        seen.add(row.tobytes())
    return again


def _event(size: float, time: float, arrival: float) -> ClockEvent:
    """Return the event of a clock that was set by a size and shows a time since [s]."""
    for turn, words in _TURNS.items():
        if abs(size + turn) < STEP:
            text = f"The device's clock turned over: it went back by {turn:.3f} s, as counters of {words} do."
            return ClockEvent(arrival, size, text)
    if size < 0 and 0 <= time < _BEGINS:
        text = f"The device's clock began anew at {time:.3f} s: it went back by {-size:.3f} s."
    else:
        text = f"The device's clock was set {'forward' if size > 0 else 'back'} by {abs(size):.3f} s."
    return ClockEvent(arrival, size, f"{text} The samples go on by the times of their arrival.")
