"""Attitude comparison: attitudes of the navigator, of one's own algorithms, of the device, and the true one.

All are compared at the same times, 20 a second. What comes more than two seconds after the samples counts as
missing there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.streams.ring import Cursor
from lab.data.streams.rolling import Rolling
from lab.live.beside.own_algorithm import OwnAlgorithm
from lab.live.live_history import RATE
from lab.live.live_state import HistoryCursor
from lab.live.station import Station
from lab.motion.frames.rotation import euler_from_quaternion, quaternion_from_euler, wrap

if TYPE_CHECKING:
    import xarray as xr

OURS, DEVICE, TRUTH = "INS Lab", "the device itself", "truth"
"""Names of the attitudes besides those of algorithms."""
KEPT: Final = 12_000
"""Rows that are kept: ten minutes."""
_HOLD: Final = 2.0
"""Longest time for which a row waits for attitudes that come later [s]: an algorithm that is not said to be
behind comes within half of it."""
_JOINED: Final = 0.5
"""Longest time between two attitudes that are joined [s]: five times that between two readings at 10 Hz."""
STEEP: Final = np.radians(80.0)
"""Pitch from which roll and heading are not compared [rad]: they are amplified there by 1/cos 80° = 6."""


class Difference(NamedTuple):
    """How two attitudes differ.

    Attributes
    ----------
    first, second : str
        Names of the attitudes; differences are the first minus the second.
    seconds : float
        Time over which both are known [s].
    tilt : float
        RMS of the angle between what both call down [rad].
    roll, pitch : float
        RMS of the differences [rad]; of times with a pitch below `STEEP` in both.
    heading_offset, heading : float
        Mean difference of the headings, and RMS about it [rad]. A heading that nothing shows has any offset.
    """

    first: str
    second: str
    seconds: float
    tilt: float
    roll: float
    pitch: float
    heading_offset: float
    heading: float

    def __str__(self) -> str:
        values = np.degrees([self.tilt, self.roll, self.pitch, self.heading_offset, self.heading])
        cells = "".join(f"{value:10.2f}" if np.isfinite(value) else f"{'-':>10}" for value in values)
        return f"{self.first + ' - ' + self.second:<34}{self.seconds:8.1f}{cells}"


HEAD: Final = (
    f"{'DIFFERENCE':<34}{'TIME [s]':>8}{'TILT':>10}{'ROLL':>10}{'PITCH':>10}{'HEADING':>10}{'ABOUT IT':>10}\n"
    f"{'':<34}{'':>8}{'rms [deg]':>10}{'rms [deg]':>10}{'rms [deg]':>10}{'mean[deg]':>10}{'rms [deg]':>10}"
)
"""Head of a table of differences."""


class AttitudeComparison:
    """Attitudes of one station, side by side; used by one thread.

    Parameters
    ----------
    station
        The station.
    algorithms
        Algorithms that follow its source.

    Attributes
    ----------
    names : tuple of str
        Names of the attitudes: ours, those of the algorithms, that of the device, and the truth.
    """

    def __init__(self, station: Station, algorithms: Sequence[OwnAlgorithm] = ()) -> None:
        self._station, self._algorithms = station, tuple(algorithms)
        self._truth = station.source.truth
        self.names = (OURS, *(one.name for one in self._algorithms), DEVICE, TRUTH)
        self._rows = Rolling({"time": (), "q_nb": (len(self.names), 4)})
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._begun = self._station.begun
        self._history, self._ring = HistoryCursor(), Cursor()
        self._numbers = [0] * len(self._algorithms)
        self._next = -np.inf  # number of the next row: its time by the rate
        self._parts = [_Attitudes() for _ in self.names[:-1]]
        self._rows.forget(self._rows.end)

    @property
    def known(self) -> tuple[str, ...]:
        """The names of those attitudes of which any row is kept."""
        any_row = np.isfinite(self._rows.column("q_nb")[..., 0]).any(axis=0)
        return tuple(name for name, known in zip(self.names, any_row, strict=True) if known)

    def advance(self, finish: bool = False) -> tuple[FloatArray, FloatArray]:
        """Take what came since the last time.

        Parameters
        ----------
        finish
            Whether nothing more comes: no row waits any longer.

        Returns
        -------
        time : (n,) array
            Times of new rows, in the clock of the computer [s].
        euler : (n, s, 3) array
            Roll, pitch, heading [rad] of each of `names`; NaN where it is not known.
        """
        if self._station.begun != self._begun:
            self._begin_anew()
        self._take()
        newest = self._station.newest
        awaited = [
            self._parts[0].reached,
            self._parts[-1].reached,
            *(one.reached for one in self._algorithms),
        ]
        last = newest if finish else min(newest, max(min(awaited), newest - _HOLD))
        # Rows are numbered by the clock, and more than are kept are not made up for.
        begin = max(self._next, np.ceil(self._station.zero * RATE), np.floor(newest * RATE) - KEPT)
        count = int(max(np.floor(last * RATE) + 1 - begin, 0)) if newest else 0
        time = (begin + np.arange(count)) / RATE
        self._next = begin + count
        rows = self._join_attitudes(time)
        self._rows.append(time=time, q_nb=rows)
        self._rows.forget(self._rows.end - KEPT)
        return time, _euler(rows)

    def differences(self, seconds: float = np.inf) -> list[Difference]:
        """Return how the attitudes that are known differ, over the last seconds.

        With a truth, each is compared with it; else those of algorithms and of the device with ours and with
        each other.
        """
        time, q_nb = self._rows.column("time"), self._rows.column("q_nb")
        recent = time > (time[-1] - seconds if time.size else 0.0)
        known = self.known
        pairs = [(name, TRUTH) for name in known if name != TRUTH] if TRUTH in known else []
        rest = [name for name in known if name not in (TRUTH, OURS)]
        pairs += [(name, OURS) for name in rest if OURS in known]
        pairs += [(rest[i], rest[j]) for i in range(len(rest)) for j in range(i + 1, len(rest))]
        return [
            _difference(pair, time[recent], *(q_nb[recent, self.names.index(name)] for name in pair))
            for pair in pairs
        ]

    def dataset(self) -> xr.Dataset:
        """Return the attitudes that are kept as a dataset: roll, pitch and heading [°] over time [s]."""
        import xarray as xr  # noqa: PLC0415 - the page does without it

        known = self.known
        q_nb = self._rows.column("q_nb")[:, [self.names.index(name) for name in known]]
        time = self._rows.column("time")
        return xr.Dataset(
            {"attitude": (("time", "estimate", "axis"), np.degrees(_euler(q_nb)), {"units": "degree"})},
            {
                "time": ("time", time - (time[0] if time.size else 0.0), {"units": "s"}),
                "estimate": list(known),
                "axis": ["roll", "pitch", "heading"],
            },
        )

    def _take(self) -> None:
        """Take the attitudes that came since the last time."""
        told = self._station.history(self._history)
        if told is not None:
            self._history, history = told
            self._parts[0].add(history.time, quaternion_from_euler(history.euler))
        for number, one in enumerate(self._algorithms):
            self._numbers[number], time, q_nb = one.since(self._numbers[number])
            self._parts[number + 1].add(time, q_nb)
        end = self._station.source.end
        read = self._station.source.since(Cursor(end.imu, end.fix, self._ring.reading))
        self._ring = read.cursor
        readings = read.reading[np.isfinite(read.reading["attitude"]).all(axis=1)]
        self._parts[-1].add(readings["time"], readings["attitude"])

    def _join_attitudes(self, time: FloatArray) -> FloatArray:
        """Return the attitudes (n, s, 4) of all at some times of ours."""
        rows = np.full((time.size, len(self.names), 4), np.nan)
        for number, one in enumerate(self._parts):
            rows[:, number] = one.at(time)
            one.forget_before(time)
        if self._truth is not None and time.size:
            euler = self._truth.at(time).euler
            known = np.isfinite(euler).all(axis=1)
            rows[known, -1] = quaternion_from_euler(euler[known])
        return rows


class _Attitudes:
    """Attitudes of one source that are not compared yet, in the order of their times."""

    def __init__(self) -> None:
        self.time, self.q_nb = np.zeros(0), np.zeros((0, 4))

    @property
    def reached(self) -> float:
        """Time up to which they are known [s]; infinite before there are any."""
        return float(self.time[-1]) if self.time.size else float(np.inf)

    def add(self, time: FloatArray, q_nb: FloatArray) -> None:
        self.time = np.concatenate((self.time, time))
        self.q_nb = np.concatenate((self.q_nb, q_nb))

    def forget(self, count: int) -> None:
        self.time, self.q_nb = self.time[count:], self.q_nb[count:]

    def forget_before(self, time: FloatArray) -> None:
        """Forget what is older than the last of some times, but for one row to join with."""
        if time.size:
            self.forget(max(int(np.searchsorted(self.time, time[-1], side="right")) - 1, 0))

    def at(self, time: FloatArray) -> FloatArray:
        """Return attitudes (n, 4) at some times, between the rows on both sides; NaN without them."""
        found = np.full((time.size, 4), np.nan)
        if not self.time.size:
            return found
        after = np.searchsorted(self.time, time, side="left")
        exact = (after < self.time.size) & (self.time[np.minimum(after, self.time.size - 1)] == time)
        found[exact] = self.q_nb[after[exact]]
        between = ~exact & (after > 0) & (after < self.time.size)
        k = after[between]
        length = self.time[k] - self.time[k - 1]
        one, two = self.q_nb[k - 1], self.q_nb[k]
        # Both signs are the same attitude. The chord errs by 1e-4 rad over a turn of 0.2 rad.
        two = two * np.where(np.sum(one * two, axis=1) < 0, -1.0, 1.0)[:, None]
        part = ((time[between] - self.time[k - 1]) / length)[:, None]
        mean = (1 - part) * one + part * two
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        mean[length > _JOINED] = np.nan
        found[between] = mean
        return found


def _euler(q_nb: FloatArray) -> FloatArray:
    """Return roll, pitch, heading (..., 3) of attitudes (..., 4); NaN of those that are not known."""
    found = np.full((*q_nb.shape[:-1], 3), np.nan)
    known = np.isfinite(q_nb).all(axis=-1)
    if known.any():
        found[known] = euler_from_quaternion(q_nb[known])
    return found


def _difference(pair: tuple[str, str], time: FloatArray, one: FloatArray, two: FloatArray) -> Difference:
    both = np.isfinite(one[:, 0]) & np.isfinite(two[:, 0])
    time, one, two = time[both], one[both], two[both]
    steps = np.diff(time)
    # A gap is no time over which both are known.
    seconds = float(steps[steps < _JOINED].sum())
    if time.size < 2:
        return Difference(*pair, seconds, *([np.nan] * 5))
    # Sine and cosine: of an angle of 1e-4 rad, the cosine alone keeps half of the digits.
    cosine = np.sum(_down_in_body(one) * _down_in_body(two), axis=1)
    sine = np.linalg.norm(np.cross(_down_in_body(one), _down_in_body(two)), axis=1)
    first, second = euler_from_quaternion(one), euler_from_quaternion(two)
    flat = np.maximum(np.abs(first[:, 1]), np.abs(second[:, 1])) < STEEP
    angles = np.asarray(wrap(first[flat] - second[flat]))
    if not angles.size:
        return Difference(*pair, seconds, _rms(np.arctan2(sine, cosine)), *([np.nan] * 4))
    # On the circle, where 359° and 1° have the mean 0°.
    offset = float(np.angle(np.mean(np.exp(1j * angles[:, 2]))))
    about = np.asarray(wrap(angles[:, 2] - offset))
    return Difference(
        *pair,
        seconds,
        _rms(np.arctan2(sine, cosine)),
        _rms(angles[:, 0]),
        _rms(angles[:, 1]),
        offset,
        _rms(about),
    )


def _down_in_body(q_nb: FloatArray) -> FloatArray:
    """Return the direction down (n, 3) in the axes of the vehicle: the last row of C_nb."""
    w, x, y, z = q_nb.T
    return np.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), axis=-1)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
