"""Intake: rows of an IMU as they arrive, repaired as a sensor log is, but without knowledge of the future.

The same rules as in `lab.data.log.sensor_log` apply: a row that repeats the six values of the row before is
dropped and the next interval reaches back, a row with a spike is dropped as if it were lost, short gaps are
filled linearly, longer ones break the stream. A row with the values of the row before waits until the
repetition ends or is too long for a polled sensor, at most four rows; at a jump, it waits for eight at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.clock.faults import UsualInterval, equal_runs, filled, increasing
from lab.data.clock.limits import LIMITS
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.log.spikes import StreamSpikes
from lab.data.streams.live_log import usable_imu

MOST_FILLED: Final = 10_000
"""Most samples that fill a gap: those of the longest gap at 5 kHz. A wrong clock could ask for any number."""
BACK_ROWS: Final = 50
"""Refused rows without a good one between from which the clock has stepped back: single ones are errors."""


class Increments(NamedTuple):
    """Increments of the IMU, ready for the navigator.

    Attributes
    ----------
    time : (n,) array
        Ends of the intervals, in the clock of the rows [s].
    values : (n, 6) array
        Integrals of angular rate [rad] and specific force [m/s] over each interval, in b.
    magnetic : (n, 3) array
        Magnetic field in b [T]; NaN where unknown.
    gaps : tuple of (start, end)
        Gaps that were filled [s].
    begins : bool
        Whether these rows begin a new stream, after a break: the first row is then only its start.
    """

    time: FloatArray
    values: FloatArray
    magnetic: FloatArray
    gaps: tuple[tuple[float, float], ...]
    begins: bool


class Counts(NamedTuple):
    """Numbers of rows and what became of them.

    Attributes
    ----------
    used, unusable, late, repeated, spikes : int
        Rows used; without finite time, rate or force; not later than the row before; repeating its values;
        with a spike.
    gaps, filled, breaks : int
        Gaps that were filled, the samples that fill them, and gaps too long for that.
    """

    used: int = 0
    unusable: int = 0
    late: int = 0
    repeated: int = 0
    spikes: int = 0
    gaps: int = 0
    filled: int = 0
    breaks: int = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the rows."""
        found = []
        if self.spikes:
            found.append(
                f"{count_noun(self.spikes, 'sample')} of the IMU with a spike, far beyond the others near, "
                f"{was_or_were(self.spikes)} dropped."
            )
        if self.gaps:
            found.append(
                f"{count_noun(self.gaps, 'gap')} of the IMU {was_or_were(self.gaps)} filled linearly with "
                f"{count_noun(self.filled, 'sample')}; the filter got large variances there."
            )
        return tuple(found)


class Intake:
    """The repair of the rows of one IMU."""

    def __init__(self) -> None:
        self.counts = Counts()
        self._usual = UsualInterval()
        self._last = np.empty(0, TIMED_IMU)  # the last row used
        self._tail = np.empty(0, TIMED_IMU)  # rows of equal values at the end; the first was passed on
        self._long = False  # whether these are too many for a polled sensor
        self._spikes = StreamSpikes()
        self._jumping = np.empty(0, TIMED_IMU)  # rows that may have a spike
        self._dropped = np.empty(0)  # times of spikes after the last row used
        self._waiting = np.empty(0, TIMED_IMU)  # rows before the usual interval is known
        self._back = 0  # rows refused since the last good one

    def accept(self, rows: NDArray[np.void]) -> Iterator[Increments]:
        """Yield the increments that follow from new rows; one element for each unbroken stream.

        Parameters
        ----------
        rows : (n,) array of `TIMED_IMU`
            Rows in the order of their arrival.
        """
        rows = self._usable_rows(np.asarray(rows))
        # Rows that stay behind for so long are no late ones: the clock itself began anew.
        if self._back >= BACK_ROWS:
            self.restart()
        rows = self._without_repeats(self._increasing(rows))
        yield from self._iterate_timely(self._without_spikes(rows, self._spikes.accept(_values(rows))))

    def _iterate_timely(self, rows: NDArray[np.void]) -> Iterator[Increments]:
        """Yield increments from the row before on, once the usual interval is known."""
        if np.isnan(self._usual.now):
            rows = self._waiting = np.concatenate((self._waiting, rows))
            if rows.size <= LIMITS.first_intervals:
                return
            self._waiting = rows[:0]
        yield from self._join_rows(rows)

    def finish(self) -> Iterator[Increments]:
        """Yield what still waits, after the last row of the stream: nothing more will decide about it."""
        self._count(repeated=max(0, self._tail.size - 1))
        self._tail = self._tail[:1]
        rows = self._without_spikes(self._tail[:0], self._spikes.finish())
        rows, self._waiting = np.concatenate((self._waiting, rows)), self._waiting[:0]
        if rows.size > 1 or self._last.size:
            yield from self._join_rows(rows)

    def _usable_rows(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        good = usable_imu(rows)
        self._count(unusable=int((~good).sum()))
        return rows if good.all() else np.asarray(rows[good])

    def _newest(self) -> float:
        """Return the time of the last row accepted [s]."""
        for part in (self._tail, self._jumping, self._waiting, self._last):
            if part.size:
                return float(part["time"][-1])
        return -np.inf

    def _increasing(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Drop the rows that are not later than all before; begin again if that happens to all of them."""
        if not rows.size:
            return rows
        good = increasing(rows["time"], self._newest())
        if good.all():
            self._back = 0
            return rows
        self._count(late=int((~good).sum()))
        # Only those since the last good row count as in a row.
        after = int(np.flatnonzero(good)[-1]) + 1 if good.any() else 0
        self._back = int((~good[after:]).sum()) + (0 if good.any() else self._back)
        return rows[good]

    def restart(self) -> None:
        """Forget what came: the next rows begin a new stream."""
        self._last = self._tail = self._jumping = self._waiting = self._last[:0]
        self._spikes, self._dropped = StreamSpikes(), np.empty(0)
        self._long, self._back = False, 0

    def _without_repeats(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Drop a few repeated values in a row; the last row's values may still be repeated."""
        if not rows.size:
            return rows
        before, rows = self._tail.size, np.concatenate((self._tail, rows))
        start, runs = equal_runs(_values(rows))
        if self._long and before:
            # The run at the begin was found too long in the piece before; what is left of it here says
            # nothing of its length.
            runs[start == 0] = LIMITS.polled + 1
        dropped = (start < np.arange(start.size)) & (runs <= LIMITS.polled)
        last = int(start[-1])
        self._long = bool(runs[-1] > LIMITS.polled)
        # Of a run that is too long, all have been passed on; one row is kept to compare the next with.
        self._tail = rows[-1:] if self._long else rows[last:]
        if not self._long:
            dropped[last:] = False
        self._count(repeated=int(dropped.sum()))
        passed = ~dropped
        passed[: min(before, 1)] = False  # passed on before
        if not self._long:
            passed[last + 1 :] = False  # undecided
        return rows[passed]

    def _without_spikes(self, rows: NDArray[np.void], spiky: NDArray[np.bool_]) -> NDArray[np.void]:
        """Drop spikes among the rows that are decided, the first ones of those that wait and of new ones."""
        if self._jumping.size:
            rows = np.concatenate((self._jumping, rows))
        self._jumping = rows[spiky.size :]
        rows = rows[: spiky.size]
        if not spiky.any():
            return rows
        self._count(spikes=int(spiky.sum()))
        self._dropped = np.append(self._dropped, rows["time"][spiky])
        return np.asarray(rows[~spiky])

    def _join_rows(self, rows: NDArray[np.void]) -> Iterator[Increments]:
        """Yield increments from the row before on, split where samples are missing for too long."""
        if not rows.size:
            return
        rows = np.concatenate((self._last, rows))
        time = rows["time"]
        dt = np.diff(time)
        begins = not self._last.size
        self._last = rows[-1:]
        usual = self._usual.accept(dt)
        wide = dt > LIMITS.filled * usual
        if self._dropped.size:
            # A dropped spike leaves a hole too, though the interval may be below the limit of a gap.
            wide |= np.diff(np.searchsorted(self._dropped, time)) > 0
            self._dropped = self._dropped[self._dropped > time[-1]]
        broken = np.flatnonzero(wide & ((dt > LIMITS.longest_filled) | (dt > MOST_FILLED * usual)))
        self._count(used=rows.size - (not begins), breaks=broken.size)
        first = 0
        for end in (*(broken + 1).tolist(), rows.size):
            # One row alone has no increment; a stream that begins with one still says where it begins.
            if end - first > 1 or begins:
                inner = slice(first, end - 1)
                yield self._make_increments(rows[first:end], usual[inner], wide[inner], begins=begins)
            first, begins = end, True

    def _make_increments(
        self, rows: NDArray[np.void], usual: FloatArray, wide: NDArray[np.bool_], *, begins: bool
    ) -> Increments:
        """Return the increments between rows without a break."""
        time = rows["time"]
        values = _values(rows)
        magnetic = rows["magnetic"]
        at = np.flatnonzero(wide)
        gaps = tuple((float(time[i]), float(time[i + 1])) for i in at)
        if at.size:
            times, values = filled(time, values, usual, at)
            # The field is not interpolated: what was not measured stays unknown.
            field = np.full((times.size, 3), np.nan)
            field[np.searchsorted(times, time)] = magnetic
            self._count(gaps=at.size, filled=times.size - time.size)
            time, magnetic = times, field
        increments = np.zeros_like(values)
        # A sample stands for the interval that ends with it.
        increments[1:] = values[1:] * np.diff(time)[:, None]
        kept = slice(0 if begins else 1, None)
        return Increments(time[kept], increments[kept], magnetic[kept], gaps, begins)

    def _count(self, **more: int) -> None:
        if any(more.values()):
            self.counts = self.counts._replace(
                **{name: getattr(self.counts, name) + int(value) for name, value in more.items()}
            )


def _values(rows: NDArray[np.void]) -> FloatArray:
    """Return angular rates and specific forces (n, 6) of rows."""
    return np.concatenate((rows["rate"], rows["force"]), axis=1)
