"""Sample times: the resolution of a recording's time stamps, and the times at which its samples were taken.

A stamp may be rounded (to a millisecond, or to the 55.5 ms of an old timer), or late because the computer was
busy. A sample stamped wrongly by δ lies off the curve by δ times the velocity, along the path only: the curve
through its neighbours shows δ.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.data.rebuild.raw_flight import JUDGED_SAMPLES
from lab.data.rebuild.smoothing import WIDEST_STEPS, smoothing_spline

LEAST_SPEED = 2.0
"""Speed below which positions show little of time errors [m/s]."""
LIVELINESS = 1.0
"""Density of the acceleration along the path that counts as motion [(m/s²)²/Hz]."""

MAX_ROUNDING_OFF = 0.55
"""How far a stamp may lie from an even clock that was rounded, in steps of its resolution: rounding alone
moves it by 0.5. At half it, the stamps of a timer of 55.6 ms are not repaired."""
_FINEST = 1e-6
"""Smallest resolution that is reported, and step that is one [s]: no recorder's clock is finer."""
_DIGITS_OF_DOUBLES = 4e-15
"""Rounding of a large stamp, relative to it: eighteen times the spacing of doubles."""
_LEAST_ROUNDING = 1e-9
"""Rounding of a small stamp [s]."""
_MAX_OFF_DECIMAL = 0.01
"""How far stamps may lie off a decimal grid, in its steps."""
_SHORT_STEP = 0.02
"""Quantile of the steps that is a first guess of the tick: the very shortest may be jitter."""
_ON_TICKS = 0.95
"""Part of the steps that has to lie on multiples of the tick."""
_MAX_OFF_TICK = 0.03
"""How far off a multiple that is, in ticks: steps that are no multiples lie evenly, up to 0.5."""
_MIN_TICK = 1e-4
"""Finest tick that is searched among the steps [s]: a tick that is not a decimal fraction is that of a coarse
timer."""
_MAX_OFF_EVEN = 0.5
"""How far a stamp may lie from an even clock, in steps of it: beyond, it would be another sample's."""
_TICKS_PER_STEP = 20
"""Ticks in a step from which on the median step is the step: with fewer it is rounded itself."""
_MAX_STEP = 1.5
"""Longest step that counts in the mean of single ones, over the median: one left-out sample makes two."""
_MAX_DRIFT = 0.02
"""How far the counted steps may drift from the stamps, relative to their number; two steps are always
allowed."""
_ROUNDS = 3
"""Rounds of fitting a step or the times, each on what the one before found. A plain choice: the tests pass
from 2 to 6."""
_LEAST_SMOOTHING = 1e-9
"""Least λ [s³]: of positions with σ = 0.03 mm."""
_LEAST_STEP = 0.05
"""Shortest step between repaired times, relative to that between their stamps."""
_DRAWING_BACK = 8
"""Rounds in which times that would not increase are drawn half back to their stamps, before they are given
up."""


def resolution(time: FloatArray) -> float:
    """Return the spacing of the grid that time stamps lie on [s], zero where it is below 1 µs.

    Parameters
    ----------
    time : (n,) array
        Increasing stamps [s].
    """
    steps = np.diff(time[:JUDGED_SAMPLES])
    steps[steps < _FINEST] = 0.0
    if not steps.any():
        return 0.0
    rounding = max(_DIGITS_OF_DOUBLES * float(np.abs(time).max()), _LEAST_ROUNDING)
    for decimals in range(7):
        tick = 10.0**-decimals
        whole = np.round(time[:JUDGED_SAMPLES] / tick)
        if np.abs(time[:JUDGED_SAMPLES] - whole * tick).max() < max(_MAX_OFF_DECIMAL * tick, rounding):
            # Not every decimal is used: stamps to 20 ms have two decimals as well.
            return float(tick * np.gcd.reduce(np.diff(whole).astype(np.int64)))
    return _common_tick(steps)


def _common_tick(steps: FloatArray) -> float:
    """Return the length of which all steps are multiples, if they are several ones; zero if there is none."""
    tick = float(np.quantile(steps[steps > 0], _SHORT_STEP))
    for _ in range(_ROUNDS):
        multiple = np.where(steps > 0, np.maximum(np.round(steps / tick), 1), 0)
        tick = float(steps @ multiple / (multiple @ multiple))
    off = np.abs(steps - multiple * tick)
    on_ticks = np.quantile(off, _ON_TICKS) < _MAX_OFF_TICK * tick
    is_grid = len(np.unique(multiple)) > 1 and on_ticks and tick > _MIN_TICK
    return tick if is_grid else 0.0


def regular(stamps: FloatArray, tick: float) -> FloatArray | None:
    """Return the evenly spaced times of which stamps are a rounded or disturbed copy, with samples left out.

    Parameters
    ----------
    stamps : (n,) array
        Stamps that do not decrease [s]; where many repeat, no sample is taken to be left out.
    tick
        Resolution of the stamps [s].

    Returns
    -------
    (n,) array or None
        None where the stamps follow no even spacing, being off by half of it and by more than the resolution.
    """
    time = distribute_stamps(stamps, tick)
    if time[-1] <= time[0]:
        return None
    count = np.arange(len(time), dtype=np.float64) if time is not stamps else _counts(time, tick)
    if count is None:
        return None
    middle, centre = count.mean(), time.mean()
    step = float((count - middle) @ (time - centre) / ((count - middle) @ (count - middle)))
    even = centre + step * (count - middle)
    off = stamps - even
    # Centred, so that the largest deviation is as small as it can be.
    even += (off.max() + off.min()) / 2
    return even if np.ptp(off) / 2 < max(_MAX_OFF_EVEN * step, MAX_ROUNDING_OFF * tick) else None


def _counts(time: FloatArray, tick: float) -> FloatArray | None:
    """Return how many even steps after the first each sample is, following the stamps."""
    steps = np.diff(time)
    step = float(np.median(steps))
    if step < _TICKS_PER_STEP * tick:  # the median is rounded itself
        step = float(np.mean(steps[steps < _MAX_STEP * step + tick]))
    for _ in range(_ROUNDS):
        if not step > 0:
            return None
        count = running_sums(np.maximum(np.round(steps / step), 1))
        # Steps rounded one by one may drift; the whole may not.
        if abs(count[-1] * step - (time[-1] - time[0])) > max(_MAX_DRIFT * count[-1], 2) * step:
            return None
        step = float((time[-1] - time[0]) / count[-1])
    return count


def distribute_stamps(stamps: FloatArray, tick: float) -> FloatArray:
    """Return stamps with those that repeat spread evenly up to the next, or over one tick if that is later.

    Parameters
    ----------
    stamps : (n,) array
        Stamps that do not decrease [s].
    tick
        Resolution of the stamps, 0 if not known [s].
    """
    starts = np.flatnonzero(np.concatenate(([True], np.diff(stamps) > 0)))
    if len(starts) == len(stamps) or len(starts) < 2:
        return stamps
    gaps = np.diff(stamps[starts])
    reach = np.minimum(np.append(gaps, np.inf), tick or float(np.median(gaps)))
    alike = np.diff(np.append(starts, len(stamps)))
    part = (np.arange(len(stamps)) - np.repeat(starts, alike)) / np.repeat(alike, alike)
    return np.asarray(stamps + part * np.repeat(reach, alike))


def by_motion(time: FloatArray, place: FloatArray, limit: float) -> FloatArray:
    """Return the times at which positions were taken, estimated from the displacements between them.

    Stamps wrong by up to `limit` put the samples off by σ = v · limit / √12 along the path. The speed
    changes by white acceleration of the density `LIVELINESS`; then the smoothing spline with λ = σ² /
    density is the most likely path, and the distance of a sample from it, along it, is a time error.

    Parameters
    ----------
    time : (n,) array
        Increasing stamps [s].
    place : (n, 3) array
        Positions in Cartesian axes [m].
    limit
        Largest error of a stamp [s].

    Returns
    -------
    (n,) array
        Increasing times, none further than `limit` from its stamp.
    """
    steps = np.diff(time)
    speed = float(np.sqrt(np.mean(np.sum(np.diff(place, axis=0) ** 2, axis=1))) / np.mean(steps))
    # Times that are wrong by up to half a limit to either side have a σ of limit / √12.
    smoothing = (speed * limit) ** 2 / 12 / LIVELINESS
    smoothing = min(max(smoothing, _LEAST_SMOOTHING), WIDEST_STEPS**4 * float(np.mean(steps)) ** 3)
    times = time
    for _ in range(_ROUNDS):
        curve = smoothing_spline(times, place, smoothing)
        velocity = curve(times, 1)
        # In slow motion the noise of the positions would count as a time error: it is faded out.
        late = np.sum((place - curve(times)) * velocity, axis=1) / (
            np.sum(velocity**2, axis=1) + LEAST_SPEED**2
        )
        times = _increasing(time + np.clip(times + late - time, -limit, limit), time)
    return times


def _increasing(times: FloatArray, stamps: FloatArray) -> FloatArray:
    """Return increasing times; times that do not increase are moved towards increasing stamps."""
    least = _LEAST_STEP * np.diff(stamps)
    for _ in range(_DRAWING_BACK):
        short = np.diff(times) < least
        if not short.any():
            return times
        held = np.concatenate((short, [False])) | np.concatenate(([False], short))
        times = np.where(held, (times + stamps) / 2, times)
    return np.asarray(times if (np.diff(times) > 0).all() else stamps)


def prediction_error(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return samples minus the cubic through two neighbours on each side, (n − 4, m).

    Small for smooth motion sampled densely; noise of the samples appears √1.94 times as large.

    Parameters
    ----------
    time : (n,) array
        Increasing times, at least five [s].
    values : (n, m) array
        Samples.
    """
    middle = time[2:-2]
    count = len(middle)
    near = [time[start : start + count] - middle for start in (0, 1, 3, 4)]
    predicted = np.zeros_like(values[2:-2])
    for i, start in enumerate((0, 1, 3, 4)):
        weight = np.ones(count)
        for j in range(4):
            if j != i:
                weight *= near[j] / (near[j] - near[i])
        predicted += weight[:, None] * values[start : start + count]
    return np.asarray(values[2:-2] - predicted)
