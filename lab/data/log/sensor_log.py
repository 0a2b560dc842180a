"""Sensor log: the recording of an IMU and a GPS receiver on a vehicle, repaired where possible.

Time counts from the first usable sample of the IMU. Polled devices repeat samples: a row with the six values
of the row before is dropped, and the next row's interval reaches back to the last one kept. Short gaps of the
IMU are filled with rates that change linearly from one side to the other; longer ones break the log into
pieces (`lab.data.log.log_section`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.clock.faults import UsualInterval, equal_runs, filled, over_rollovers
from lab.data.clock.limits import LIMITS
from lab.data.log.auxiliary_data import AuxiliaryData, Reference
from lab.data.log.log_remarks import clock_text, constant_axes_remarks, coverage_remarks, span_text
from lab.data.log.spikes import spikes

MIN_OVERLAP = 5.0
"""Shortest time in which both the IMU and the receiver recorded [s]."""
MIN_IMU_SAMPLES = 10
"""Fewest samples of the IMU in a log, or in the stretch of it that is navigated."""
MAX_LEVER_ARM = 100.0
"""Largest component of a lever arm [m]: longer than an airliner's fuselage, far shorter than one in mm."""
SIGMAS = (1e-6, 1e6)
"""σ of a fix that are believed [m], [m/s]: receivers write 0 or a huge number for one they do not know."""

_MOVING = 0.5
"""Speed from which two fixes cannot be equal [m/s]: loggers write the latest fix again, and receivers that
lose the signal freeze. A receiver that holds its position has no speed. At 10 Hz it moves by 5 cm, five steps
of 10⁻⁷°."""
SINCE_1970 = 1e9
"""Time from which it counts from 1970 and not from switching on [s]: of 2001, or of 32 years without a
restart."""
_HOUR = 3600.0
"""[s]."""
_ZONE, _MAX_ZONE = _HOUR / 2, 14 * _HOUR
"""Step between time zones, but for three of 15 minutes, and the largest difference from UTC [s]."""
_SAME_START = 300.0
"""Largest time between the starts of sensors that were switched on together [s]."""
_MAX_FILLED = 10
"""Most samples that gaps are filled with, for each there is: a file must not ask for more memory than it is
large."""


@dataclass(frozen=True, eq=False, repr=False)
class GnssLog:
    """The fixes of a receiver with its own time stamps: of the antenna, and late by the latency.

    Attributes
    ----------
    time : (m,) array
        Time stamps, increasing [s].
    position : (m, 3) array
        Latitude, longitude [rad], height [m] of the antenna.
    velocity_n : (m, 3) array
        Velocity of the antenna north, east, down [m/s]; NaN in a column that the receiver does not have.
    position_sigma, velocity_sigma : (m, 3) arrays
        Its own σ, north, east, down [m], [m/s]; NaN in a column it does not have.
    lever_arm : (3,) array
        From the IMU to the antenna, in b [m].
    latency : float
        Time stamp minus time of validity [s].
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    position_sigma: FloatArray
    velocity_sigma: FloatArray
    lever_arm: FloatArray
    latency: float

    def rows(self, rows: Flags | slice, zero: float = 0.0) -> GnssLog:
        """Return some of the fixes, their stamps counted from a time [s]."""
        arrays = ("position", "velocity_n", "position_sigma", "velocity_sigma")
        some = {name: getattr(self, name)[rows] for name in arrays}
        return replace(self, time=self.time[rows] - zero, **some)


@dataclass(frozen=True, eq=False, repr=False)
class SensorLog:
    """An IMU and a GPS receiver recorded together.

    Attributes
    ----------
    name : str
        Its source, for messages.
    epoch : float
        The recorder's time at time 0 [s].
    time : (n + 1,) array
        Ends of the sample intervals, from 0; they need not be equally long [s].
    dtheta, dvelocity : (n, 3) arrays
        Integrals of angular rate [rad] and specific force [m/s] over each interval, in b: forward, right,
        down.
    gnss : GnssLog
        The fixes, their stamps counted from the same 0.
    reference : Reference or None
        A better solution, if there is one; with the same time 0.
    gaps, breaks : (g, 2) arrays
        Start and end of the gaps of the IMU that were filled, and of those too long for that [s]. In a break
        there is one interval without increments, which must not be navigated.
    auxiliary : AuxiliaryData
        Further data: vehicle, magnetometer, headings, other solutions; with the same time 0.
    repairs : tuple of str
        The report on repairs and missing data.
    """

    name: str
    epoch: float
    time: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    gnss: GnssLog
    reference: Reference | None
    gaps: FloatArray
    repairs: tuple[str, ...]
    breaks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    auxiliary: AuxiliaryData = field(default_factory=AuxiliaryData)

    @property
    def duration(self) -> float:
        """Time from the first sample of the IMU to the last [s]."""
        return float(self.time[-1])

    @property
    def rates(self) -> tuple[FloatArray, FloatArray]:
        """Mean angular rate [rad/s] and specific force [m/s²] over each interval, (n, 3) each, in b."""
        dt = np.diff(self.time)[:, None]
        return self.dtheta / dt, self.dvelocity / dt

    def __repr__(self) -> str:
        n, m = len(self.dtheta), len(self.gnss.time)
        return f"<SensorLog {self.name}: {n} samples of the IMU in {self.duration:.1f} s, {m} fixes>"


def believed_sigma(values: FloatArray) -> FloatArray:
    """Return σ of a receiver [m], [m/s]; NaN where they lie outside `SIGMAS`, which says that it has none."""
    return np.where((values > SIGMAS[0]) & (values < SIGMAS[1]), values, np.nan)


def repair_log(
    name: str,
    time: FloatArray,
    samples: FloatArray,
    gnss: GnssLog,
    reference: Reference | None = None,
    *,
    increments: bool = False,
    auxiliary: AuxiliaryData | None = None,
    find_spikes: Callable[[FloatArray], NDArray[np.bool_]] = spikes,
) -> SensorLog:
    """Return the log of raw rows, repaired.

    Parameters
    ----------
    name
        The source of the rows, for messages.
    time : (n,) array
        Time stamps of the IMU; each row is of the interval that ends with it [s].
    samples : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²], in b; or with `increments` their integrals over the
        interval [rad], [m/s]. A row with NaN is dropped, and leaves a gap.
    gnss, reference
        The fixes and, if there is one, a better solution, with time stamps of the same clock. A fix with NaN
        in its position is dropped.
    increments
        Whether the samples are increments.
    auxiliary
        Auxiliary data, stamped by the same clock.
    find_spikes
        Which samples are spikes, as `lab.data.log.spikes.spikes`.

    Raises
    ------
    MissionError
        If time runs backwards, or the IMU and the receiver have recorded less than `MIN_OVERLAP` together.
    """
    repairs: list[str] = []
    _check_order(name, "IMU", time)
    stamps, remark = over_rollovers(gnss.time, time)
    if remark:
        gnss, repairs = replace(gnss, time=stamps), [remark]
    _check_order(name, "GPS", gnss.time)
    time, samples, lost = _usable_samples(time, samples, increments, find_spikes, repairs)
    gnss_rows = _usable_fixes(gnss, repairs)
    _check_overlap(name, time, gnss.time[gnss_rows] - gnss.latency)
    # Increments begin at the sample before, or at a lost one.
    latest = np.append(-np.inf, lost)[np.searchsorted(lost, time[1:])]
    dt, since = np.diff(time), time[1:] - np.maximum(time[:-1], latest)
    rates = samples[1:] / since[:, None] if increments else samples[1:]
    rates = np.concatenate((samples[:1] / np.median(dt) if increments else samples[:1], rates))
    stamps, usual = time, UsualInterval().accept(dt)
    wide = (dt > LIMITS.filled * usual) | (since < dt)
    time, rates, gaps, breaks = _without_gaps(name, time, rates, usual, wide, repairs)
    values = rates[1:] * np.diff(time)[:, None]
    if increments:
        # Increments of a gap are unknown; the others keep every bit.
        whole = ~wide
        values[np.searchsorted(time, stamps[1:][whole]) - 1] = samples[1:][whole]
    values[np.searchsorted(time, breaks[:, 1]) - 1] = 0.0
    epoch = float(time[0])
    fixes = gnss.rows(gnss_rows, epoch)
    repairs += coverage_remarks(stamps, gnss.time[gnss_rows] - gnss.latency)
    repairs += constant_axes_remarks(name, samples, fixes.position)
    _report_missing(fixes, repairs)
    return SensorLog(
        name=name,
        epoch=epoch,
        time=time - epoch,
        dtheta=np.ascontiguousarray(values[:, :3]),
        dvelocity=np.ascontiguousarray(values[:, 3:]),
        gnss=fixes,
        reference=None if reference is None else reference.later(-epoch),
        gaps=gaps - epoch,
        repairs=tuple(repairs),
        breaks=breaks - epoch,
        auxiliary=AuxiliaryData() if auxiliary is None else auxiliary.later(-epoch),
    )


def _check_order(name: str, what: str, time: FloatArray) -> None:
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        row = int(back[0]) + 1
        raise MissionError(
            f"{name}: the time of the {what} runs backwards, from {time[row - 1]:.12g} s to "
            f"{time[row]:.12g} s; accepted is time that increases from row to row (a time that repeats is "
            "repaired)"
        )


def _usable_samples(
    time: FloatArray,
    samples: FloatArray,
    increments: bool,
    find_spikes: Callable[[FloatArray], NDArray[np.bool_]],
    repairs: list[str],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the samples that are known, new and no spikes: time, values, and the time of those lost."""
    known = np.isfinite(samples).all(axis=1)
    _report_repairs(repairs, int((~known).sum()), "IMU sample with an unknown value was dropped")
    lost, time, samples = time[~known], time[known], samples[known]
    time, samples = _without_repeats(time, samples, increments, repairs)
    spiky = find_spikes(_rates(time, samples) if increments else samples)
    _report_repairs(
        repairs, int(spiky.sum()), "IMU sample with a spike, far beyond the others near, was dropped"
    )
    return time[~spiky], samples[~spiky], np.sort(np.append(lost, time[spiky]))


def _without_repeats(
    time: FloatArray, samples: FloatArray, increments: bool, repairs: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Drop rows with the time, or the very values, of the row before."""
    kept = np.append(True, np.diff(time) > 0)[: time.size]
    _report_repairs(repairs, int((~kept).sum()), "IMU sample with the time of the one before was dropped")
    time, samples = time[kept], samples[kept]
    if increments:  # two equal increments are two movements
        return time, samples
    start, length = equal_runs(samples)
    # A sensor that shows one value for longer is at rest, or stuck, and not polled too fast.
    kept = (start == np.arange(time.size)) | (length > LIMITS.polled)
    _report_repairs(
        repairs, int((~kept).sum()), "IMU sample that repeats the values of the one before was dropped"
    )
    return time[kept], samples[kept]


def _rates(time: FloatArray, increments: FloatArray) -> FloatArray:
    """Return increments as rates; those over very short intervals as if these were usual."""
    dt = np.diff(time)
    usual = float(np.median(dt)) if dt.size else 1.0
    return np.asarray(increments / np.append(usual, np.maximum(dt, usual))[: time.size, None])


def _usable_fixes(gnss: GnssLog, repairs: list[str]) -> NDArray[np.bool_]:
    """Return which fixes (m,) are measurements: neither zeros of a receiver without a fix, nor repeated."""
    rows = np.append(True, np.diff(gnss.time) > 0)[: gnss.time.size]
    _report_repairs(repairs, int((~rows).sum()), "GPS fix with the time of the one before was dropped")
    unknown = ~np.isfinite(gnss.position).all(axis=1)
    _report_repairs(repairs, int((rows & unknown).sum()), "GPS fix without a position was dropped")
    rows &= ~unknown
    empty = np.asarray(rows & (gnss.position[:, :2] == 0).all(axis=1))
    _report_repairs(repairs, int(empty.sum()), "GPS fix at latitude 0, longitude 0 was dropped")
    at = np.flatnonzero(rows & ~empty)
    values = np.concatenate((gnss.position[at], gnss.velocity_n[at]), axis=1)
    moving = np.linalg.norm(gnss.velocity_n[at, :2], axis=1) > _MOVING
    same = ((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))).all(axis=1)
    repeated = at[1:][same & moving[1:]]
    _report_repairs(
        repairs, repeated.size, "GPS fix in motion that repeats the values of the one before was dropped"
    )
    rows &= ~empty
    rows[repeated] = False
    return rows


def _check_overlap(name: str, imu: FloatArray, gnss: FloatArray) -> None:
    if imu.size and not gnss.size:
        raise MissionError(
            f"{name}: it has an IMU ({span_text(imu)}) and no fix of a receiver; accepted are both"
        )
    both = min(imu[-1], gnss[-1]) - max(imu[0], gnss[0]) if imu.size and gnss.size else 0.0
    if both < MIN_OVERLAP:
        raise MissionError(
            f"{name}: the IMU ({span_text(imu)}) and the GPS ({span_text(gnss)}) have less than "
            f"{MIN_OVERLAP:g} s in common; accepted are logs of one clock, recorded "
            f"together{_clock_hint(imu, gnss)}"
        )


def _clock_hint(imu: FloatArray, gnss: FloatArray) -> str:
    """Return how two clocks without a time in common may differ; empty if nothing is known."""
    if not imu.size or not gnss.size:
        return ""
    if (imu[0] > SINCE_1970) != (gnss[0] > SINCE_1970):
        first = "IMU" if imu[0] > SINCE_1970 else "GPS"
        return f". The clock of the {first} counts from 1970, and the other one does not"
    apart = float(imu[0] - gnss[0])
    zone = round(apart / _ZONE) * _ZONE
    if 0 < abs(zone) <= _MAX_ZONE and abs(apart - zone) < _SAME_START:
        return f". They start about {zone / _HOUR:+g} h apart: one of the clocks may be local time"
    return ""


def _without_gaps(
    name: str,
    time: FloatArray,
    rates: FloatArray,
    usual: FloatArray,
    wide: NDArray[np.bool_],
    repairs: list[str],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Fill short gaps with samples at the usual spacing; return gaps filled and breaks left, too."""
    dt = np.diff(time)
    at = np.flatnonzero(wide & (dt <= LIMITS.longest_filled))
    broken = np.flatnonzero(wide & (dt > LIMITS.longest_filled))
    breaks = np.stack((time[broken], time[broken + 1]), axis=-1)
    if not at.size:
        return time, rates, np.empty((0, 2)), breaks
    if (dt[at] / usual[at]).sum() > _MAX_FILLED * time.size:
        raise MissionError(
            f"{name}: samples of the IMU are usually {np.median(usual):.3g} s apart, but {at.size} gaps last "
            f"{dt[at].sum():.3g} s in all; accepted are gaps of up to {_MAX_FILLED} times as many samples "
            "as there are"
        )
    times, rates = filled(time, rates, usual, at)
    count = "1 gap" if at.size == 1 else f"{at.size} gaps"
    longest = int(at[np.argmax(dt[at])])
    repairs.append(
        f"{count} of the IMU, {dt[at].sum():.3g} s in all and up to {dt[at].max():.3g} s long, filled by "
        "linear interpolation; the filter gets large variances there. The longest is from "
        f"{clock_text(time[longest])} to {clock_text(time[longest + 1])} s of the file's clock."
    )
    return times, rates, np.stack((time[at], time[at + 1]), axis=-1), breaks


def _report_missing(gnss: GnssLog, repairs: list[str]) -> None:
    unknown = np.isnan(gnss.velocity_n)
    if unknown[:, :2].any(axis=1).all():
        repairs.append("The GPS has no velocity: only its positions are used.")
    elif unknown[:, 2].all():
        repairs.append("The GPS has no vertical velocity: the filter uses the two horizontal ones.")
    _report_some(repairs, unknown, "no velocity, or not all of it: the filter uses the rest")
    missing = []
    measured = np.asarray(~unknown.all(axis=0), dtype=bool)
    for word, vertical, sigma, known in (
        ("position", "height", gnss.position_sigma, np.ones(3, dtype=bool)),
        ("velocity", "vertical velocity", gnss.velocity_sigma, measured),
    ):
        lacking = np.asarray(known & np.isnan(sigma).all(axis=0), dtype=bool)
        if lacking[:2].any():
            missing.append(word if lacking[2] or not known[2] else f"horizontal {word}")
        elif lacking[2]:
            missing.append(vertical)
        _report_some(repairs, np.isnan(sigma), f"no σ of the {word}: the variance of the settings is used")
    if missing:
        repairs.append(
            f"The GPS gives no σ of its {' and '.join(missing)}: the variances of the settings are used."
        )


def _report_some(repairs: list[str], unknown: NDArray[np.bool_], what: str) -> None:
    """Report how many fixes lack a value (m, 3) that others have."""
    count = int((unknown & ~unknown.all(axis=0)).any(axis=1).sum())
    if count:
        repairs.append(f"{count} of {len(unknown)} fixes {'has' if count == 1 else 'have'} {what}.")


def _report_repairs(repairs: list[str], count: int, what: str) -> None:
    """Report a number of repairs in one sentence, given for one."""
    if count == 1:
        repairs.append(f"1 {what}.")
    elif count:
        plural = what.replace("sample", "samples", 1).replace("fix ", "fixes ", 1).replace("was", "were")
        repairs.append(f"{count} {plural.replace('repeats', 'repeat').replace('of the one', 'of those')}.")
