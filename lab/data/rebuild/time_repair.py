"""Time repair: from the recorded time stamps to the times at which the samples were taken.

The source's own clock is kept. Repeated, rounded or jittery stamps are re-estimated from the stamps and the
motion; the report states what was changed and by how much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MAX_DURATION, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.checks.likeness import rms
from lab.data.clock.faults import usual_step
from lab.data.rebuild import row_repair
from lab.data.rebuild import sample_times as clock
from lab.data.rebuild.derived_motion import SmoothAxes
from lab.data.rebuild.raw_flight import Dropped, RawFlight

AS_RECORDED, REPAIRED = "as recorded", "repaired"
TIME_STAMPS = (REPAIRED, AS_RECORDED)
"""The choices for time stamps."""

_MIN_REPEATED_PART = 0.05
"""Part of the stamps that has to repeat before repeats are spread: fewer are single mistakes and left out.
At twice it, the stamps of a timer of 55.6 ms are not repaired; at half they are."""
_MIN_NEW_STAMP = 1e-6
"""Step of the stamps below which one repeats that before [s]: the finest that any recorder writes."""
_MIN_GAP_STEPS = 5
"""Usual steps that are bridged, whatever `longest_gap` says: a slow recording has long steps."""
_STAMP_ROUNDING = 1e-9
"""Rounding of a time stamp next to that of a reset [s]."""
_MIN_STEP = 1e-7
"""Shortest step between repaired times that is accepted [s]: splines through closer ones lose their
digits."""
_GAP_STEPS = 3
"""Usual steps beyond which a pause is counted as a gap."""
_MAX_ROUGHER_IF_ROUNDED = 1.3
"""How much rougher an even spacing may make the motion that explains the stamps by their rounding alone."""
_MAX_BETTER = 0.8
"""Ratio of what neighbours do not explain, after over before, that one quantity has to fall below for a
repair to count. Noise alone gives 1. The tests pass at half and at twice it."""
_MAX_WORSE = 1.1
"""The same ratio that no quantity may exceed. The tests pass at half and at twice it."""
_MIN_ALONG = 2.0
"""Error of the positions along the path over that across it, from which wrong times are suspected: noise of
positions is alike in both. The tests pass at half and at twice it."""
_COARSE_TICK = 0.02
"""Resolution of stamps, in usual steps, above which the resolution bounds their error; finer stamps
jitter."""
_MAX_JITTER = 0.5
"""How wrong jittering stamps may be, in usual steps: beyond, samples would change places."""
_OUTLIERS = 5
"""Multiple of the median miss at which a miss is cut, so that a few jumps do not decide."""
_UNCHANGED, _UNCHANGED_PART = 2e-9, 1e-12
"""Difference from the stamps that is their rounding [s], and that as a part of their length."""
_SMOOTH_ENOUGH = {"position": 1e-3, "velocity": 1e-4, "attitude": 1e-5}
"""Roughness below which a motion is not judged [m], [m/s], [1], so that rounding does not decide. The
tests pass at half and at twice it."""


@dataclass(frozen=True, eq=False)
class RepairedFlight:
    """The samples of one unbroken flight, at increasing times from 0.

    Attributes
    ----------
    raw : RawFlight
        The samples; its `dropped` and `remarks` are those of the file.
    started : float
        The source's clock at the first of them [s].
    tick : float
        Resolution of the stamps [s]; zero where finer than 1 µs.
    method : str
        "as recorded"; "spread" for repeated stamps spread evenly; "even" for the even spacing that the
        stamps are a rounded or jittering copy of; "by motion" for times estimated from the displacements
        between the samples.
    step : float
        The even spacing [s], zero for another method.
    moved_rms, moved_max : float
        How far stamps were moved [s].
    calmed : float
        Ratio of the roughness of the motion, after over before.
    dropped : tuple of Dropped
        Samples left out, each reason with the time of the first; row numbers count what was left by then.
    cuts : tuple of (float, float)
        Clock before and after each gap or jump at which the recording was cut [s].
    gaps : int
        Pauses of more than three usual steps that were bridged.
    longest_gap : float
        Longest pause that was bridged [s].
    bridging : tuple of Bridging
        By which longer one most, and nearly all, of the samples would be kept.
    """

    raw: RawFlight
    started: float
    tick: float
    method: str
    step: float
    moved_rms: float
    moved_max: float
    calmed: float
    dropped: tuple[Dropped, ...]
    cuts: tuple[tuple[float, float], ...]
    gaps: int
    longest_gap: float = 0.0
    bridging: tuple[row_repair.Bridging, ...] = ()


def repair(raw: RawFlight, time_stamps: str = REPAIRED, longest_gap: float = 2.0) -> RepairedFlight:
    """Return the longest unbroken stretch of a recording with its time stamps repaired.

    Parameters
    ----------
    raw
        A flight as read.
    time_stamps
        "repaired", or "as recorded", which only leaves out samples whose stamp does not increase.
    longest_gap
        Longest pause between samples that is bridged [s].

    Raises
    ------
    MissionError
        If too few samples are left, or the flight is too long.
    """
    reported = len(raw.dropped)
    raw = row_repair.drop_repeated(row_repair.drop_null_island(row_repair.drop_impossible(raw)))
    raw, breaks = row_repair.in_order(raw)
    if not len(breaks):
        raw = row_repair.with_jumps(row_repair.without_spikes(row_repair.drop_stale(raw)))
    resets = np.array([reset.time for reset in raw.resets])
    after = np.searchsorted(np.maximum.accumulate(raw.time), resets - _STAMP_ROUNDING)
    breaks = np.unique(np.concatenate((breaks, after[(after > 0) & (after < len(raw.time))])))
    bridged = max(longest_gap, _MIN_GAP_STEPS * usual_step(raw.time))
    jumps = row_repair.jumps_between(raw, breaks)
    more = row_repair.bridge_gaps(raw, jumps, bridged)
    raw, cuts = row_repair.longest_stretch(raw, jumps, bridged)
    raw = _keep_one_per_stamp(raw, time_stamps)
    _check(raw)
    started = float(raw.time[0])
    stamps = raw.time - started
    tick = clock.resolution(raw.time)
    method, times = AS_RECORDED, stamps
    calmed = 1.0
    if time_stamps == REPAIRED:
        method, times, calmed = _choose_repair(raw, stamps, clock.distribute_stamps(stamps, tick), tick)
    times = _of_the_same_length(times - times[0], stamps, tick)
    if np.diff(times).min() < _MIN_STEP:
        raise MissionError(
            f"the samples lie too close together, {len(times)} in {stamps[-1]:.3g} s; accepted are at least "
            "0.1 µs from one to the next. Another unit of time is given with --unit COLUMN=UNIT"
        )
    moved = times - stamps
    # The median is rounded to the tick; a whole number of steps in the whole length is not.
    step = float(times[-1] / round(times[-1] / np.median(np.diff(times)))) if method == "even" else 0.0
    steps = np.diff(times)
    return RepairedFlight(
        raw=replace(raw, time=times, dropped=raw.dropped[:reported]),
        started=started,
        tick=tick,
        method=method,
        step=step,
        moved_rms=float(np.std(moved)),
        moved_max=float(np.abs(moved - np.mean(moved)).max()),
        calmed=calmed,
        dropped=raw.dropped[reported:],
        cuts=cuts,
        gaps=int(np.count_nonzero(steps > _GAP_STEPS * np.median(steps))),
        longest_gap=bridged,
        bridging=more,
    )


def _of_the_same_length(times: FloatArray, stamps: FloatArray, tick: float) -> FloatArray:
    """Return times stretched, if need be, to last as long as the stamps within one step of them."""
    step = max(tick, float(np.median(np.diff(times))))
    longer = float(times[-1] - stamps[-1])
    return times if abs(longer) <= step else times * ((stamps[-1] + np.sign(longer) * step) / times[-1])


def _keep_one_per_stamp(raw: RawFlight, time_stamps: str) -> RawFlight:
    """Return the samples with one for each stamp, unless many share theirs and can be spread."""
    again = np.concatenate(([False], np.diff(raw.time) < _MIN_NEW_STAMP))
    if not again.any():
        return raw
    if time_stamps == REPAIRED and again.mean() > _MIN_REPEATED_PART and again.sum() < len(again) - 1:
        # Stamps that repeat but for rounding become equal, and are spread with the others.
        last = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        return replace(raw, time=raw.time[last])
    return row_repair.drop_samples(raw, again, "the time stamp of the row before")


def _check(raw: RawFlight) -> None:
    if len(raw.time) < MIN_SAMPLES or not raw.time[-1] > raw.time[0]:
        raise MissionError(
            f"only {len(raw.time)} samples with times of their own; accepted are at least {MIN_SAMPLES}"
        )
    if raw.time[-1] - raw.time[0] > MAX_DURATION:
        raise MissionError(
            f"the recording lasts {raw.time[-1] - raw.time[0]:.6g} s; accepted are flights up to "
            f"{MAX_DURATION:g} s. If its time is in milliseconds, say so with --unit COLUMN=ms"
        )


def _choose_repair(
    raw: RawFlight, stamps: FloatArray, spread: FloatArray, tick: float
) -> tuple[str, FloatArray, float]:
    """Return the repair that the motion supports: its name, its times, and the ratio of roughness."""
    method = AS_RECORDED if spread is stamps else "spread"
    if len(stamps) < 2 * MIN_SAMPLES:
        return method, spread, 1.0
    even = clock.regular(stamps, tick)
    if even is not None and np.abs(even - spread).max() <= _UNCHANGED + _UNCHANGED_PART * stamps[-1]:
        return method, spread, 1.0
    evidence = _evidence(raw)
    before = _roughness(spread, evidence)
    if even is not None:
        ratios = _ratios(before, _roughness(even, evidence))
        is_rounding = np.abs(even - stamps).max() <= clock.MAX_ROUNDING_OFF * tick
        if (is_rounding and max(ratios, default=1.0) < _MAX_ROUGHER_IF_ROUNDED) or _supports_stamps(ratios):
            return "even", even, min(ratios, default=1.0)
    if "position" not in evidence or not _errors_lie_along_path(spread, evidence["position"]):
        return method, spread, 1.0
    usual = float(np.median(np.diff(spread)))
    limit = (
        tick + float(np.abs(spread - stamps).max()) if tick > _COARSE_TICK * usual else _MAX_JITTER * usual
    )
    times = clock.by_motion(spread, evidence["position"], limit)
    after = _roughness(times, evidence)
    # These times come from the positions: the other quantities, where there are any, have to support them.
    judges = {name: error for name, error in before.items() if name != "position"} or before
    ratios = _ratios(judges, after)
    return ("by motion", times, min(ratios)) if _supports_stamps(ratios) else (method, spread, 1.0)


def _evidence(raw: RawFlight) -> dict[str, FloatArray]:
    """Return the quantities by which times are judged, in Cartesian components without jumps."""
    evidence: dict[str, FloatArray] = {}
    position, places = raw.position, row_repair.positions_in_ecef(raw)
    if position is None or places is None:
        position = np.zeros((len(raw.time), 3))
    else:
        evidence["position"] = places - places[0]
    axes = SmoothAxes(position[:, 0])
    if raw.velocity_n is not None:
        evidence["velocity"] = axes.vectors(raw.velocity_n, position)
    if raw.euler is not None:
        evidence["attitude"] = axes.attitudes(raw.euler, position)
    return evidence


def _roughness(times: FloatArray, evidence: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the rms difference of the samples from what their neighbours predict."""
    found = {}
    for name, values in evidence.items():
        miss = np.linalg.norm(clock.prediction_error(times, values), axis=1)
        found[name] = float(rms(np.minimum(miss, _OUTLIERS * np.median(miss)))) + _SMOOTH_ENOUGH[name]
    return found


def _ratios(before: Mapping[str, float], after: Mapping[str, float]) -> list[float]:
    return [after[name] / error for name, error in before.items()]


def _supports_stamps(ratios: list[float]) -> bool:
    return bool(ratios) and min(ratios) < _MAX_BETTER and max(ratios) < _MAX_WORSE


def _errors_lie_along_path(times: FloatArray, places: FloatArray) -> bool:
    """Return whether the errors of positions against their neighbours lie mainly along the path."""
    error = clock.prediction_error(times, places)
    displacement = places[3:-1] - places[1:-3]
    length = np.linalg.norm(displacement, axis=1)
    moving = length > clock.LEAST_SPEED * (times[3:-1] - times[1:-3])
    if moving.sum() < MIN_SAMPLES:
        return False
    along = np.sum(error * displacement, axis=1)[moving] / length[moving]
    # Two components are across, and one is along: hence the half.
    across = np.sqrt(np.maximum(np.sum(error[moving] ** 2, axis=1) - along**2, 0) / 2)
    return bool(np.median(np.abs(along)) > _MIN_ALONG * np.median(across))
