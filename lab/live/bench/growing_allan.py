"""Growing Allan: the Allan deviation of a device at rest, as its samples come, in bounded memory."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.analysis import allan
from lab.analysis.rest import OFF_GRAVITY, Record
from lab.base.arrays import FloatArray
from lab.base.parameters.counted import count_noun, was_or_were
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.streams.live_log import usable_imu
from lab.sensors.suite import TRIADS

_FIRST_ROOM: Final = 2**10
"""Samples for which there is room at first; the room doubles."""
LEAST_BLOCK: Final = 4
"""Fewest samples of a block of which a mean and a spread are compared."""
LEAST_CLUSTERS: Final = 3
"""Fewest averaging times in a record whose deviation reaches one; the grid of times may need more."""
ROOM: Final = 2**18
"""Samples that are kept: 22 minutes at 200 Hz, in 13 MB. Then pairs are averaged."""
FIRST: Final = 64
"""Intervals from which the usual interval is found."""
GAP: Final = 1.5
"""Interval from which samples are missing, in usual ones: as in `lab.analysis.rest`."""
LONGEST_GAP: Final = 1.0
"""Longest gap that is filled with the sample behind it [s]; after a longer one, the record begins again."""
MOST_FILLED: Final = 5000
"""Most samples that fill a gap: those of `LONGEST_GAP` at 5 kHz. A clock that runs wrong could ask for any
number."""
SECOND: Final = 1.0
"""Time over which samples are averaged to see whether the device moved [s]."""
RATE_MOVED: Final = math.radians(0.2)
"""Least change of the mean rate between seconds that counts as moved [rad/s]: the white noise of a consumer
gyro, 0.03 °/s/√Hz, makes 0.04 °/s of it."""
FORCE_MOVED: Final = 0.1
"""Least change of the mean specific force between seconds that counts as moved [m/s²]: the white noise of a
consumer accelerometer, 300 µg/√Hz, makes 0.004 m/s², a tilt of 1° makes 0.17 m/s²."""
SPREAD_MOVED: Final = 5.0
"""Growth of the spread within a second that counts as moved: a knock at the table."""
LEAST_SPREAD: Final = math.radians(0.2), 0.02
"""Spread of rates [rad/s] and specific forces [m/s²] below which no growth counts: people walk by."""
NOISE_SIGMAS: Final = 6.0
"""Change between seconds that counts as moved, in σ of the white noise in their spread: once in 10⁸."""
MOST_TILTED: Final = 0.5
"""Largest change of the specific force since the beginning of a record [m/s²]: as in `lab.analysis.rest`."""
LEAST_FOR_CARD: Final = 300.0
"""Shortest record for a card [s]: the bias instability of MEMS sensors shows at 10 to 100 s, and a deviation
reaches a third of its record."""


class GrowingAllan:
    """The record of a device at rest; it begins again when the device moves.

    Parameters
    ----------
    room
        Samples that are kept, an even number.

    Attributes
    ----------
    dt : float
        Time from kept sample to kept sample [s]; NaN until it is known.
    filled : int
        Samples that were missing and filled.
    restarts : int
        How often the record has begun again.
    why : str
        Why it has begun again the last time; empty if it has not.
    """

    def __init__(self, room: int = ROOM) -> None:
        self._room = room
        self._values = np.empty((0, 6))  # grows by doubling up to the room
        self.restarts, self.why = 0, ""
        self.dt = self._step = math.nan
        self._waiting: NDArray[np.void] = np.empty(0, TIMED_IMU)
        self._begin()

    def __len__(self) -> int:
        return self._count

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return 0.0 if math.isnan(self.dt) else self._count * self.dt

    def add(self, rows: NDArray[np.void]) -> None:
        """Take samples.

        Parameters
        ----------
        rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
            Samples in the order of their times, each after those before.
        """
        rows = rows[usable_imu(rows)]
        rows = np.concatenate((self._waiting, rows))
        if math.isnan(self._step):
            if rows.size <= FIRST:
                self._waiting = rows
                return
            steps = np.diff(rows["time"])
            self._step = self.dt = float(np.median(steps[steps > 0])) if (steps > 0).any() else math.nan
            if math.isnan(self._step):
                return
        self._waiting = rows[:0]
        while rows.size:
            rows = self._add_until_moved(rows)

    def records(self) -> dict[str, Record]:
        """Return the records of gyros and accelerometers, for `lab.analysis.rest.card_of`: copies."""
        values = self._values[: self._count].copy()
        return {triad: Record(values[:, 3 * k : 3 * k + 3], self.dt) for k, triad in enumerate(TRIADS)}

    def time_to(self, tau: float) -> float:
        """Return the time after which the deviation reaches an averaging time; zero if it does [s].

        Parameters
        ----------
        tau
            Averaging time [s].
        """
        if math.isnan(self.dt):
            return math.nan
        length = max(round(tau / self.dt), 1)
        low, high = max(LEAST_CLUSTERS * length, allan.MIN_SAMPLES), 4 * length + allan.MIN_SAMPLES
        while not _reaches_length(high, length):
            high *= 2
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if _reaches_length(middle, length) else (middle, high)
        return max(high - self._count, 0) * self.dt

    @property
    def sentence(self) -> str:
        """The state in words."""
        if not self._count:
            return f"Waiting for samples of a device at rest. {self.why}".rstrip()
        values = count_noun(self._count, "value")
        text = f"A record of {self.duration:.0f} s, {values} with {1 / self.dt:.4g} Hz."
        if self._halved:
            text += f" {2**self._halved} samples are averaged to one value, so that the memory stays bounded."
        if self.filled:
            missing = count_noun(self.filled, "missing sample")
            text += f" {missing} {was_or_were(self.filled)} filled with the next one."
        return f"{text} {self.why}".rstrip()

    def _begin(self) -> None:
        self._count = self._halved = self.filled = 0
        self._step = self.dt = math.nan
        self._clock = self._start = math.nan  # times of the last and the first sample
        self._samples = 0  # since the first
        self._waiting = np.empty(0, TIMED_IMU)
        self._odd = np.empty((0, 6))  # samples that are not yet averaged to a value
        self._block = np.empty((0, 6))  # samples of the second that is not over
        self._first: FloatArray | None = None  # means of the first second
        self._before: FloatArray | None = None  # means of the last second
        self._usual: FloatArray | None = None  # spread of a second

    def _begin_again(self, why: str) -> None:
        elapsed = self.duration
        self._begin()
        self.restarts += 1
        self.why = f"{why} after {elapsed:.0f} s, so the record began again."

    def _add_until_moved(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Add rows up to the first at which the record begins again; return those after it."""
        time = rows["time"]
        before = self._clock if math.isfinite(self._clock) else time[0] - self._step
        steps = np.diff(time, prepend=before)
        breaks = np.flatnonzero((steps > min(LONGEST_GAP, MOST_FILLED * self._step)) | (steps <= 0))
        part = rows[: breaks[0]] if breaks.size else rows
        if part.size:
            end = self._describe_motion(part)
            if end is not None:
                self._begin_again(end)
                return rows[part.size :]
            self._keep(part, steps[: part.size])
        if breaks.size:
            late = steps[breaks[0]] <= 0
            if late and time[breaks[0]] > before - LONGEST_GAP:  # a repeated row
                return np.delete(rows, np.s_[: breaks[0] + 1])
            self._begin_again("The clock was set back" if late else f"{steps[breaks[0]]:.1f} s are missing")
            self._waiting = rows[breaks[0] :]
            return rows[:0]
        return rows[:0]

    def _keep(self, rows: NDArray[np.void], steps: FloatArray) -> None:
        """Append values, with missing samples filled."""
        self._start = float(rows["time"][0]) if math.isnan(self._start) else self._start
        self._clock = float(rows["time"][-1])
        values = np.concatenate((rows["rate"], rows["force"]), axis=1)
        missing = np.where(steps > GAP * self._step, np.round(steps / self._step) - 1, 0).astype(int)
        if missing.any():
            values = np.repeat(values, missing + 1, axis=0)
            self.filled += int(missing.sum())
        self._samples += len(values)
        if self._samples > 1 and self._clock > self._start:
            self._step = (self._clock - self._start) / (self._samples - 1)
        values = np.concatenate((self._odd, values))
        while True:
            each = 2**self._halved
            whole = min(len(values) // each, self._room - self._count)
            self._append(values[: whole * each].reshape(whole, each, 6).mean(axis=1))
            values = values[whole * each :]
            if self._count < self._room:
                break
            half = self._room // 2
            self._values[:half] = self._values.reshape(half, 2, 6).mean(axis=1)
            self._count, self._halved = half, self._halved + 1
        self._odd = values
        self.dt = self._step * 2**self._halved

    def _append(self, values: FloatArray) -> None:
        end = self._count + len(values)
        if end > len(self._values):
            larger = np.empty((min(max(2 * len(self._values), end, _FIRST_ROOM), self._room), 6))
            larger[: self._count] = self._values[: self._count]
            self._values = larger
        self._values[self._count : end] = values
        self._count = end

    def _describe_motion(self, rows: NDArray[np.void]) -> str | None:
        """Return how the device moved in the seconds that these rows end; None if it did not."""
        values = np.concatenate((self._block, np.concatenate((rows["rate"], rows["force"]), axis=1)))
        size = max(round(SECOND / self._step), LEAST_BLOCK)
        whole = len(values) // size
        self._block = values[whole * size :]
        if not whole:
            return None
        blocks = values[: whole * size].reshape(whole, size, 6)
        means, spreads = blocks.mean(axis=1), blocks.std(axis=1)
        if self._first is None or self._before is None or self._usual is None:
            self._first, self._before, self._usual = means[0], means[0], spreads[0]
            size_of_force = float(np.linalg.norm(means[0, 3:]))
            if abs(size_of_force / STANDARD_GRAVITY - 1) > OFF_GRAVITY:
                return (
                    f"The specific force is {size_of_force:.2f} m/s², which is not that of a device at rest,"
                )
        change = np.abs(np.diff(means, axis=0, prepend=self._before[None]))
        tilted = np.abs(means[:, 3:] - self._first[3:]).max()
        floor = np.repeat(LEAST_SPREAD, 3)
        shaken = (spreads > np.maximum(SPREAD_MOVED * self._usual, floor)).any()
        self._before, self._usual = means[-1], np.minimum(self._usual, np.median(spreads, axis=0))
        noise = NOISE_SIGMAS * math.sqrt(2 / size) * self._usual
        moved = change > np.maximum(np.repeat((RATE_MOVED, FORCE_MOVED), 3), noise)
        if moved[:, :3].any():
            return f"The device moved (its rate changed by {math.degrees(change[:, :3].max()):.2f} °/s)"
        if moved[:, 3:].any() or tilted > MOST_TILTED:
            most = max(change[:, 3:].max(), tilted)
            return f"The device moved (its specific force changed by {most:.2f} m/s²)"
        return "The device was shaken" if shaken else None


def _reaches_length(samples: int, length: int) -> bool:
    """Return whether the deviation of a record reaches an averaging length in samples."""
    return bool(allan.cluster_lengths(samples)[-1] >= length)
