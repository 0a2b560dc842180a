"""Live intake: fixes and other readings as they arrive, as the filter uses them.

Fixes are checked and given their covariance; other readings are appended to a stream once there is one.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.clock.faults import increasing
from lab.data.clock.timed_samples import NO_READINGS, TIMED_FIX, TIMED_IMU
from lab.data.log.pressure_height import Heights
from lab.data.log.sensor_log import GnssLog
from lab.data.streams.live_log import make_gnss_log, usable_fixes, usable_imu
from lab.live.live_aids import LiveAids
from lab.live.live_stream import Stream
from lab.navigation.log_navigation import used_fixes
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief

EARLY_READINGS: Final = 10_000
"""Headings and speeds that wait for the first sample, or for the next that are processed."""
DATED: Final = (86400.0 * 366, 4_102_444_800.0)
"""UTC that counts from 1970, to the end of 2099 [s]: without a date it is a time of day."""
EARLY: Final = 100
"""Fixes that wait for the first sample of the IMU."""
_COLUMNS: Final = ("time", "position", "velocity_n", "position_sigma", "velocity_sigma")


class FixIntake:
    """The check of the fixes of one receiver.

    Parameters
    ----------
    assumed
        The filter's assumptions, with the covariance of a fix that has no σ.
    navigator
        The settings of the filter.
    latency
        How much later than the fixes their times are [s].
    """

    def __init__(self, assumed: Belief, navigator: NavigatorSettings, latency: float) -> None:
        self._assumed, self._navigator, self._latency = assumed, navigator, latency
        self._early = np.empty(0, TIMED_FIX)
        self.first: tuple[float, float] | None = None
        """Time stamp [s] and height [m] of the first fix that was used."""
        self.refused = 0
        """Fixes that were not used."""
        self.above_sea = False
        """Whether the receiver gives its height above sea level."""
        self.utc_offset = np.nan
        """UTC of the last fix with a date, minus the clock of the host [s]."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the fixes."""
        found = []
        if self.refused:
            found.append(
                f"{count_noun(self.refused, 'fix')} {was_or_were(self.refused)} not used: without a "
                "position in three "
                "dimensions, not in order, or too late."
            )
        if self.above_sea:
            found.append(
                "The receiver gives its height above sea level; it is used as height above the ellipsoid."
            )
        return tuple(found)

    def early(self, stream: Stream) -> None:
        """Append the fixes that came before the first sample of a stream."""
        rows, self._early = self._early, self._early[:0]
        self.accept(stream, rows)

    def accept(self, stream: Stream, rows: NDArray[np.void]) -> None:
        """Append fixes to a stream.

        Parameters
        ----------
        stream
            The stream.
        rows : (m,) array of `TIMED_FIX`
            Fixes in the order of their arrival.
        """
        if np.isnan(stream.epoch):
            self._early = np.concatenate((self._early, rows))[-EARLY:]
            return
        good = usable_fixes(rows)
        # In the order of `repaired` and `navigate_log`: another one would round otherwise.
        time = rows["time"] - stream.epoch - self._latency
        earliest = float(stream.fixes.column("time")[-1]) if len(stream.fixes) else -np.inf
        if stream.filter is not None:
            earliest = max(earliest, stream.filter.reach)
        good &= increasing(np.where(good, time, np.nan), earliest)
        self.refused += int((~good).sum())
        rows = rows[good]
        if not rows.size:
            return
        if self.first is None:
            self.first = float(rows["time"][0]), float(rows["height"][0])
        self.above_sea |= bool((rows["sea_level"] == 1).any())
        dated = rows[(rows["utc"] > DATED[0]) & (rows["utc"] < DATED[1])]
        if dated.size:
            self.utc_offset = float(dated["utc"][-1] - dated["time"][-1])
        gnss = make_gnss_log(rows)
        start = stream.fixes.end
        measured = 6 - np.isnan(gnss.velocity_n).sum(axis=1)
        columns = {name: getattr(gnss, name) for name in _COLUMNS[1:]}
        stream.fixes.append(time=time[good], measured=measured, **columns)
        self._write_fixes(stream, start)

    def _write_fixes(self, stream: Stream, start: int) -> None:
        """Write the fixes as the filter uses them.

        A velocity that is not measured follows from the positions before and after, so that of the fix before
        the first new one changes too.
        """
        rows, end = stream.fixes.rows, stream.fixes.end
        first, changed = max(start - 2, stream.fixes.first), max(start - 1, stream.fixes.first)
        values = [rows(name, first, end) for name in _COLUMNS]
        if end - first == 1:  # a difference of positions needs two
            values = [np.repeat(part, 2, axis=0) for part in values]
            values[0][1] += 1.0
        time, position, velocity_n, position_sigma, velocity_sigma = values
        window = GnssLog(time, position, velocity_n, position_sigma, velocity_sigma, np.zeros(3), 0.0)
        known, R, variances = used_fixes(window, self._assumed, self._navigator)
        old = rows("known_velocity", changed, start).copy()
        for name, all_values in (("known_velocity", known.velocity_n), ("R", R), ("variances", variances)):
            rows(name, changed, end)[:] = all_values[changed - first : end - first]
        if stream.filter is not None:
            # If the velocity of the fix before has not changed, nothing before the first new fix is stale.
            same = np.array_equal(old, rows("known_velocity", changed, start))
            from_here = start if same or changed < stream.first_fix else changed
            stream.filter.changed_fixes(from_here, end)


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
            self._early = np.concatenate((self._early, readings))[-EARLY_READINGS:]

    def append_rows(self, rows: NDArray[np.void], stream: Stream, aids: LiveAids) -> None:
        """Append the heights by pressure and the magnetic fields of rows of the IMU that arrived."""
        self._rows = np.concatenate((self._rows, rows[usable_imu(rows)]))
        if np.isnan(stream.epoch):
            return
        aids.append_fields(self._rows["time"] - stream.epoch, self._rows["magnetic"])
        time, height = self.heights.accept(self._rows)
        self._rows = self._rows[:0]
        aids.append_heights(time - stream.epoch, height)

    def accept(self, stream: Stream, aids: LiveAids) -> None:
        """Append the headings and speeds that arrived, and tell the filter how far to return for them."""
        if np.isnan(stream.epoch) or not self._early.size:
            return
        reach = -np.inf if stream.filter is None else stream.filter.reach
        earliest = aids.accept(self._early, stream.epoch, reach)
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
        readings, epoch = stream.readings["height"], stream.epoch
        if len(readings) and first is not None and stream.now + epoch >= first[0]:
            self.heights.begin_at(*first, readings.column("time") + epoch, readings.column("value"))
        aids.shift = self.heights.shift
        if stream.fixes.end and not stream.fixes.first:
            aids.begin_at(stream.fixes.column("position")[0])
