"""Reading intake: readings besides fixes as they arrive, appended to a stream once there is one."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.data.clock.reading_times import NO_READINGS
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.log.pressure_height import Heights
from lab.data.streams.live_log import usable_imu
from lab.live.live_aids import LiveAids
from lab.live.live_stream import Stream

EARLY: Final = 10_000
"""Headings and speeds that wait for the first sample, or for the next that are processed."""


class ReadingIntake:
    """The readings of one source."""

    def __init__(self) -> None:
        self.heights = Heights()
        """The heights by pressure."""
        self._rows = np.empty(0, TIMED_IMU)  # before the first stream
        self._early = NO_READINGS

    def arrive(self, readings: NDArray[np.void]) -> None:
        """Keep headings and speeds (k,) of `lab.data.clock.timed_samples.TIMED_READING` until `take`."""
        if readings.size:
            self._early = np.concatenate((self._early, readings))[-EARLY:]

    def take_rows(self, rows: NDArray[np.void], stream: Stream, aids: LiveAids) -> None:
        """Append the heights by pressure and the magnetic fields of rows of the IMU that arrived."""
        self._rows = np.concatenate((self._rows, rows[usable_imu(rows)]))
        if np.isnan(stream.epoch):
            return
        aids.take_fields(self._rows["time"] - stream.epoch, self._rows["magnetic"])
        time, height = self.heights.take(self._rows)
        self._rows = self._rows[:0]
        aids.take_heights(time - stream.epoch, height)

    def take(self, stream: Stream, aids: LiveAids) -> None:
        """Append the headings and speeds that arrived, and tell the filter how far to return for them."""
        if np.isnan(stream.epoch) or not self._early.size:
            return
        reach = -np.inf if stream.filter is None else stream.filter.reach
        earliest = aids.take(self._early, stream.epoch, reach)
        self._early = NO_READINGS
        if stream.filter is not None and np.isfinite(earliest):
            stream.filter.changed_readings(earliest)

    def begin(self, first: tuple[float, float] | None, stream: Stream, aids: LiveAids) -> None:
        """Begin heights by pressure and the declination at the first fix.

        Parameters
        ----------
        first
            Time stamp [s] and height [m] of the first fix that was used; None before there is one.
        stream, aids
            The stream and its measurements.
        """
        readings, epoch = stream.readings.height, stream.epoch
        if len(readings) and first is not None and stream.now + epoch >= first[0]:
            self.heights.begin_at(*first, readings.column("time") + epoch, readings.column("value"))
        aids.shift = self.heights.shift
        if stream.fixes.end and not stream.fixes.first:
            aids.begin_at(stream.fixes.column("position")[0])
