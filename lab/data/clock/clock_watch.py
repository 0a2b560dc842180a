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

from lab.base.arrays import Flags, FloatArray, IntArray
from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.faults import steps_from
from lab.data.clock.limits import LIMITS

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
    declared : float
        Interval at which samples are said to come, which is then the usual one [s]; NaN if nothing says it.
    distrusted : bool
        Whether the clock is not used any more.
    repeated, backwards, jumps : int
        Samples that were sent twice; that came after later ones; and changes of the clock.
    events : deque of ClockEvent
        The last events, oldest first.
    """

    def __init__(self) -> None:
        self.last = self.usual = self.declared = math.nan
        self.distrusted = False
        self.repeated = self.backwards = self.jumps = 0
        self.events: deque[ClockEvent] = deque(maxlen=LIMITS.events)
        self._heard = math.nan  # arrival of the last samples
        self._number = 0  # of the next sample
        self._gaps: deque[tuple[float, float]] = deque(maxlen=LIMITS.gaps)
        self._odd: deque[tuple[int, float]] = deque(
            maxlen=LIMITS.most_odd
        )  # numbers and intervals of changes
        self._pending: list[tuple[int, ClockEvent]] = []
        self._even = 0
        self._steps: deque[float] = deque(maxlen=LIMITS.steps)
        self._looked = 0  # samples since the steps were looked at
        self._common = math.nan  # of which the steps are multiples, where samples are lost all the time
        self._raw = math.nan  # time of the last sample that was timed by its number
        self._new: deque[ClockEvent] = deque(maxlen=LIMITS.events)
        self._restored = False

    def new_events(self) -> list[ClockEvent]:
        """Return the events since the last call."""
        new = list(self._new)
        self._new.clear()
        return new

    @property
    def state(self) -> dict[str, Any]:
        """All that later times depend on; `restore` goes on from it."""
        numbers = {"last": self.last, "usual": self.usual, "heard": self._heard, "common": self._common}
        known = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        steps = {"steps": list(self._steps), "looked": self._looked}
        return {**known, **steps, "distrusted": self.distrusted}

    def restore(self, state: Any) -> None:
        """Go on from a state; what is damaged in it is left out."""
        if not isinstance(state, dict):
            return
        self.last, self.usual, self._heard, self._common = map(
            _number, map(state.get, ("last", "usual", "heard", "common"))
        )
        self.usual = self.usual if self.usual > 0 else math.nan
        steps, looked = state.get("steps"), state.get("looked")
        known = [_number(one) for one in steps] if isinstance(steps, list) else []
        self._steps.extend(one for one in known[-LIMITS.steps :] if one > 0)
        self._looked = looked if isinstance(looked, int) and 0 <= looked < LIMITS.steps else 0
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
            if not 0 < float(device[0]) - self.last < LIMITS.step:
                self.rebase(float(device[0]) - self._interval, clock)
        steps = steps_from(self.last, device)
        # Not `steps <= 0`: a step that is NaN is odd too.
        odd = ~(steps > 0) | (
            steps > (LIMITS.step if math.isnan(self.usual) else LIMITS.missing * self.usual)
        )
        # Before the first sample of all there is no interval.
        odd[0] &= math.isfinite(self.last)
        kept, changed = np.ones(len(device), bool), np.zeros(len(device), bool)
        self._number += len(device)
        if not odd.any():
            self.last, self._heard = float(device[-1]), arrival
            return Followed(kept, device, 0.0, changed, bool(self._pending) and self._decide(arrival))
        moved = np.zeros(len(device))
        self._sort_out(device, arrival, clock, np.flatnonzero(odd), (kept, moved, changed))
        times = (device - moved)[kept]
        if times.size:
            # As the device sent it: the next step is one of its clock, whatever was taken off here.
            self.last = float(device[kept][-1])
        silence = 0.0
        if changed.any() and times.size and not math.isnan(self._heard):
            # How much later than the sample before these came, beside their intervals.
            now, before = clock.predicted(float(times[-1])), clock.predicted(math.nan)
            silence = (arrival - now) - (self._heard - before)
        if silence > LIMITS.step:
            clock.restart()
        self._heard = arrival
        # `moved` is a running total, and each event tells of its own step.
        sizes = np.diff(moved, prepend=0.0)
        for i in np.flatnonzero(changed):
            size, silence = float(sizes[i]) - (silence if silence > LIMITS.step else 0.0), 0.0
            number = self._number - len(device) + int(i)
            self._pending.append((number, _event(size, float(device[i]), arrival)))
        useless = bool(self._pending) and self._decide(arrival)
        return Followed(kept, times, float(moved[-1]), changed[kept], useless)

    @property
    def _interval(self) -> float:
        return LIMITS.unknown_step if math.isnan(self.usual) else self.usual

    def _sort_out(
        self, device: FloatArray, arrival: float, clock: DeviceClock, places: IntArray,
        found: tuple[Flags, FloatArray, Flags],
    ) -> None:  # fmt: skip
        """Find out what each odd interval is; fill the arrays ``kept``, ``moved`` and ``changed``."""
        kept, moved, changed = found
        # The last samples before the next odd intervals.
        ends = dict(zip(places.tolist(), (np.append(places[1:], len(device)) - 1).tolist(), strict=True))
        begin, total = int(places[0]), 0.0
        last = float(device[begin - 1]) if begin else self.last
        for i in range(begin, len(device)):
            time = float(device[i])
            step = time - last
            moved[i] = total
            # A network may deliver a sample that was missing after later ones.
            if step <= 0 and any(start < time < end for start, end in self._gaps):
                self.backwards += 1
                kept[i] = False
                continue
            # A clock that was set forward shows times before which its samples arrive.
            early = step > LIMITS.step and i in ends
            early = early and clock.predicted(float(device[ends[i]]) - total) - arrival > LIMITS.step
            if step <= 0 or early:
                # The usual interval is left between the two: times must go on, not repeat.
                total += step - self._interval
                moved[i], changed[i] = total, True
                self._odd.append((self._number - len(device) + i, step))
            elif step > LIMITS.missing * self._interval:
                self._gaps.append((last, time))
            last = time

    def _decide(self, arrival: float) -> bool:
        """Keep the events of changes that are of their own; return whether the clock is not used any more."""
        numbers, steps = zip(*self._odd, strict=True) if self._odd else ((), ())
        # The deque holds only as many, so a full one spans the last `most_odd` changes.
        if len(steps) == LIMITS.most_odd and numbers[-1] - numbers[0] < LIMITS.within:
            what = "repeats its time stamps" if not any(steps[-2:]) else (
                "runs backwards" if max(steps) < 0 else "jumps again and again"
            )  # fmt: skip
            self._pending.clear()
            self._odd.clear()
            self.distrusted, self._even, self.jumps = True, 0, self.jumps + 1
            self._keep(
                arrival, f"The device's clock {what}; from now on, the samples are timed by their number."
            )
            return True
        # Younger ones wait: they may turn out to be the first of a clock that is of no use.
        self._publish(self._number - LIMITS.within)
        return False

    def publish(self) -> None:
        """Report what waits: nothing more will decide about it."""
        self._publish(self._number + 1)

    def _publish(self, before: int) -> None:
        while self._pending and self._pending[0][0] < before:
            self.jumps += 1
            self._add(self._pending.pop(0)[1])

    def _keep(self, arrival: float, text: str) -> None:
        """Keep an event that changes how the samples are timed."""
        self._add(ClockEvent(arrival, math.nan, text))

    def _add(self, event: ClockEvent) -> None:
        self.events.append(event)
        self._new.append(event)

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
        good = (steps > LIMITS.soonest * interval) & (steps < LIMITS.missing * interval)
        bad = np.flatnonzero(~good)
        self._even = len(steps) - int(bad[-1]) - 1 if bad.size else self._even + len(steps)
        if self._even < LIMITS.even:
            return False
        self.distrusted = False
        self._keep(arrival, "The device's clock runs evenly again; the samples are timed by it.")
        return True

    def gaps(self, steps: FloatArray) -> tuple[Flags, int]:
        """Return before which samples some are missing, and how many, by the usual interval.

        Parameters
        ----------
        steps : (n,) array
            Intervals before the samples [s]; NaN where they say nothing.
        """
        if not math.isnan(self.declared):
            self.usual = self.declared
            gap = steps > LIMITS.missing * self.declared
            return np.asarray(gap), int(np.rint(steps[gap] / self.declared - 1).sum())
        if math.isnan(self.usual):
            known = steps[steps > 0]
            if known.size:
                self.usual = float(np.median(known))
        self._steps.extend(steps[steps > 0].tolist())
        self._looked += steps.size
        if self._looked >= LIMITS.looked:
            self._looked, self._common = 0, common_step(np.array(self._steps))
            self.usual = self.usual if math.isnan(self._common) else self._common
        # A comparison with NaN is False: without a usual interval there is no gap.
        gap = steps > LIMITS.missing * self.usual
        ordinary = steps[~gap & (steps > 0)]
        if ordinary.size:
            share = min(1.0, LIMITS.remembered * ordinary.size)
            mean = float(ordinary[0] if ordinary.size == 1 else ordinary.mean())
            self.usual += share * (mean - self.usual)
        missing = 0
        if ordinary.size < steps.size and gap.any():
            missing = int(np.rint(steps[gap] / self.usual - 1).sum())
            # A pace that changed for good is no gap: the usual interval follows it slowly.
            if math.isnan(self._common):
                self.usual += LIMITS.remembered * (float(steps[gap].min()) - self.usual)
        return np.asarray(gap), missing


def _number(value: Any) -> float:
    """Return a number of a recording, NaN if it is none that is believed."""
    return float(value) if isinstance(value, int | float) and abs(value) < LIMITS.largest else math.nan


def common_step(steps: FloatArray) -> float:
    """Return the step of which nearly all steps are multiples, some of them larger ones; NaN without one.

    Parameters
    ----------
    steps : (n,) array
        Steps of a device's clock [s].
    """
    if steps.size < LIMITS.steps / 2:
        return math.nan
    # A tenth of the steps must be single ones: this quantile is one of them, and no outlier.
    least = float(np.quantile(steps, LIMITS.single / 2))
    step = float(np.median(steps[np.abs(steps - least) < LIMITS.like * least]))
    parts = steps / step
    times = np.rint(parts)
    are_multiples = float(np.mean(np.abs(parts - times) < LIMITS.beside_step))
    single = float(np.mean(times == 1))
    is_common = are_multiples > LIMITS.regular and LIMITS.single < single < 1 - LIMITS.single
    return step if is_common else math.nan


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
        # A counter that turns over goes back, so its size is minus a turn.
        if abs(size + turn) < LIMITS.step:
            text = f"The device's clock turned over: it went back by {turn:.3f} s, as counters of {words} do."
            return ClockEvent(arrival, size, text)
    if size < 0 and 0 <= time < LIMITS.begins:
        text = f"The device's clock began anew at {time:.3f} s: it went back by {-size:.3f} s."
    else:
        text = f"The device's clock was set {'forward' if size > 0 else 'back'} by {abs(size):.3f} s."
    return ClockEvent(arrival, size, f"{text} The samples go on by the times of their arrival.")
