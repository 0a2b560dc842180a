"""Rest recording: gyros and accelerometers of an IMU at rest, out of any file, on an even clock.

A recording of hours has lost samples, stamps that jitter, a driver that reads faster than the sensor
measures, and somebody who knocks at the table. What is left out is reported, and what cannot be mended is
refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.allan import MIN_SAMPLES
from lab.analysis.rest_samples import Samples, imu_samples
from lab.base.arrays import Flags, FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun
from lab.data.clock.faults import set_backs
from lab.data.sheets.sheet_imu import in_order


@dataclass(frozen=True)
class RestLimits:
    """What a recording at rest may contain."""

    longest_gap: float = 10.0
    """Longest gap whose ends are put together [s]: the bias of MEMS sensors changes in minutes. After a
    longer one, the longest piece is taken."""
    missing: float = 0.05
    """Largest part of the samples that may be missing. Samples that follow one another across a gap keep
    white noise as it is, and move the averaging times by that part."""
    lost: float = 1.75
    """Step, in usual intervals, from which a sample may be lost: stamps jitter by steps of 0.5 to 1.6."""
    shift: float = 0.5
    """Part of such a step by which the stamps behind it are late on average: those that jitter come back."""
    window: int = 64
    """Steps over which the interval is measured: bursts of a USB driver have up to 16 samples."""
    rate_change: float = 0.3
    """Change of the interval that ends a piece: bursts of 16 samples change that of a window by 0.25."""
    held: float = 0.02
    """Part of the rows that repeat all axes of the one before, beyond chance, from which they are no
    samples."""
    outlier: float = 10.0
    """Change of a mean from block to block, in its σ, that no noise makes: a knock or a turn."""
    margin: float = 1.0
    """Time that is left out beside a knock [s]."""
    moved: float = 0.5
    """Largest part of a recording with knocks and turns."""
    unsteady: float = np.radians(0.5)
    """σ of the change of a rate from second to second that is no rest [rad/s]: white noise of 0.1 °/s/√Hz
    makes 0.14 °/s."""
    tilted: float = 0.5
    """Largest change of the specific force over a record at rest, between means over a hundredth of it
    [m/s²]."""


LIMITS = RestLimits()
"""The limits in use."""

_BLOCKS = (0.0, 0.1, 1.0, 10.0)
"""Lengths of the blocks whose means are compared [s]; 0 for single samples."""
_FEWEST_BLOCKS = 20
"""Fewest blocks whose changes show a σ."""
_NAMED_PLACES = 3
"""Most places of knocks that are named."""
_PARTS, _SAMPLES_PER_PART = 100, 4
"""Most parts of a record whose means are compared, and fewest samples of each, which average out noise."""
_UNEVEN, _JITTERS = 0.25, 0.1
"""Deviation of a step from the usual one, and part of the steps with it, from which stamps jitter."""
_ALIVE = 0.999
"""Part of the rows that repeat the one before, on an axis that measures."""
_FEWEST_WINDOWS = 4
"""Fewest windows in which a rate and its changes are looked for."""
_SIGMAS_OF_MOST = 1.28
"""σ within which `_MOST` of normal errors are."""
_TWO_IN_THREE, _MOST = 0.683, 0.8
"""Parts of normal errors within one σ and 1.28 σ; a fifth of a recording may be motion."""


class Record(NamedTuple):
    """The output of a triad at rest.

    Attributes
    ----------
    rates : (n, 3) array
        Rates [rad/s] or specific forces [m/s²].
    dt : float
        Time from sample to sample [s].
    """

    rates: FloatArray
    dt: float

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return len(self.rates) * self.dt


class RestRecords(dict[str, Record]):
    """The records of a file, by triad: gyros, accelerometers or both.

    Attributes
    ----------
    remarks : tuple of str
        What was left out, and why.
    """

    def __init__(self, records: Mapping[str, Record], remarks: Sequence[str] = ()) -> None:
        super().__init__(records)
        self.remarks = tuple(remarks)


class _Even(NamedTuple):
    """Samples of a triad that follow one another, when they were taken, and a report."""

    record: Record
    time: FloatArray
    remarks: list[str]


def read_log(
    paths: Path | str | Sequence[Path], units: Mapping[str, str] | None = None, rate: float = 0.0
) -> RestRecords:
    """Read a recording of an IMU at rest: a csv, a log of an autopilot, or the bytes of a device.

    Gyros alone, or accelerometers alone, are enough.

    Parameters
    ----------
    paths
        The file, or the tables of one recording.
    units
        What a person says of columns, as of `lab.missions.flight_import.read_log`.
    rate
        Samples per second of a text without times [Hz]; 0 where it has some.

    Raises
    ------
    MissionError
        If a file cannot be read or has no IMU, too much of it is missing, or the IMU was not at rest.
    """
    files = [Path(paths)] if isinstance(paths, Path | str) else [Path(path) for path in paths]
    where = str(files[0]) if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"
    try:
        return of_samples(*imu_samples(files, units or {}, rate))
    except MissionError as error:
        text = str(error)
        raise MissionError(text if str(files[0]) in text else f"{where}: {text}") from error


def of_samples(samples: Mapping[str, Samples], remarks: Sequence[str] = ()) -> RestRecords:
    """Return the records of samples at rest, by triad; see `read_log`.

    Parameters
    ----------
    samples
        The samples of each triad.
    remarks
        What is already reported about them.

    Raises
    ------
    MissionError
        If too much is missing, or the IMU was not at rest.
    """
    even = {triad: _resample_evenly(triad, *found) for triad, found in samples.items()}
    said = list(remarks)
    for one in even.values():
        said += [remark for remark in one.remarks if remark not in said]
    records, more = _cut_disturbances(even)
    for triad, record in records.items():
        _check_rest(triad, record)
    return RestRecords(records, [*said, *more])


def _resample_evenly(triad: str, time: FloatArray, values: FloatArray) -> _Even:
    """Return the samples of a triad with equal steps in time."""
    known = np.isfinite(values).all(axis=1) & np.isfinite(time)
    remarks = []
    if not known.all():
        count = int((~known).sum())
        remarks.append(
            f"{count_noun(count, 'row')} without a number {'is' if count == 1 else 'are'} left out."
        )
    time, values = time[known], values[known]
    if len(time) < MIN_SAMPLES:
        raise MissionError(f"{len(time)} samples; accepted are at least {MIN_SAMPLES}")
    fresh, remark_of_polling = _find_new_samples(values)
    if remark_of_polling:
        rate = float(fresh.sum() / max(np.ptp(time), 1e-9))
        remarks.append(f"{remark_of_polling} The {triad}s measure {rate:.4g} times a second.")
        time, values = time[fresh], values[fresh]
    for row, size in set_backs(time):
        remarks.append(
            f"The clock was set back by {size:.3f} s at {time[row - 1] - time[0]:.2f} s; the samples go on."
        )
        time = np.append(time[:row], time[row:] + size)
    rows, time, more = in_order(time, f"{triad}s")
    values, remarks = values[rows], [*remarks, *more]
    first, last, remark = _find_longest_stretch(time)
    if remark:
        remarks.append(remark)
    time, values = time[first:last], values[first:last]
    if len(time) < MIN_SAMPLES:
        raise MissionError(f"{len(time)} samples in the longest piece; accepted are at least {MIN_SAMPLES}")
    span = float(np.sum(np.clip(np.diff(time), 0.0, None)))
    lost, gaps = _lost(time, polled=bool(remark_of_polling))
    if lost > LIMITS.missing * len(time):
        raise MissionError(
            f"{lost} of {lost + len(time)} samples are missing, in {count_noun(gaps, 'gap')}; accepted are "
            f"recordings of which at most {100 * LIMITS.missing:g} % are missing"
        )
    if lost:
        remarks.append(
            f"{count_noun(lost, 'sample')} in {count_noun(gaps, 'gap')} {'is' if lost == 1 else 'are'} "
            "missing: "
            "the samples beside are taken as neighbours."
        )
    dt = span / (len(time) - 1 + lost)
    if not dt > 0:
        raise MissionError("the time stamps do not go on")
    uneven = np.abs(np.diff(time) / dt - 1) > _UNEVEN
    if uneven.mean() > _JITTERS:
        remarks.append(f"The time stamps jitter: the samples are taken as {dt:.4g} s apart.")
    return _Even(Record(values, dt), time, remarks)


def _find_new_samples(values: FloatArray) -> tuple[Flags, str]:
    """Return which samples are new, if a driver repeats the last one while the sensor has no other.

    Axes that are equal by chance, as numbers of few steps are, are so independently of each other.
    """
    same = values[1:] == values[:-1]
    alive = same.mean(axis=0) < _ALIVE
    rates, all_same = same[:, alive].mean(axis=0), same.all(axis=1)
    together = float(all_same.mean())
    every = np.ones(len(values), bool)
    if alive.sum() < 2 or together < LIMITS.held:
        return every, ""
    # h of the rows are held; the axes of others agree by chance: (r - h)/(1 - h) = Π (rᵢ - h)/(1 - h).
    h = np.linspace(0.0, together, 1000, endpoint=False)
    chance = np.prod((rates[:, None] - h) / (1 - h), axis=0)
    held = float(h[np.argmin(np.abs((together - h) / (1 - h) - chance))])
    if held < LIMITS.held or held < together / 2:
        return every, ""
    return np.append(True, ~all_same), f"{int(all_same.sum())} rows repeat the one before and are left out."


def _find_longest_stretch(time: FloatArray) -> tuple[int, int, str]:
    """Return the rows from which to which the clock goes on with one rate for longest, and a remark."""
    steps = np.diff(time)
    breaks = np.flatnonzero((steps > LIMITS.longest_gap) | (steps < -LIMITS.longest_gap)) + 1
    size = 4 * LIMITS.window
    changes = []
    for first, last in zip(np.append(0, breaks), np.append(breaks, len(time)), strict=True):
        blocks = (last - first) // size
        if blocks < _FEWEST_WINDOWS:
            continue
        inside = time[first : first + blocks * size].reshape(blocks, size)
        each = np.median(np.diff(inside[:, :: LIMITS.window], axis=1), axis=1) / LIMITS.window
        jumps = np.abs(np.diff(each)) > LIMITS.rate_change * each[:-1]
        settled = np.flatnonzero(jumps) + 1
        changes += [first + int(one) * size for one in settled]
    ends = np.unique(np.concatenate(([0], breaks, changes, [len(time)]))).astype(int)
    place = int(np.argmax(np.diff(ends)))
    first, last = int(ends[place]), int(ends[place + 1])
    if ends.size == 2:
        return first, last, ""
    return (
        first,
        last,
        (
            f"The clock jumps or changes its rate {count_noun(ends.size - 2, 'time')}: the longest piece, "
            f"{time[last - 1] - time[first]:.0f} s from {time[first]:.9g} s, is used."
        ),
    )


def _lost(time: FloatArray, polled: bool) -> tuple[int, int]:
    """Return how many samples are missing between others, and in how many gaps.

    Samples of a driver that polls have the stamps of its clock, and steps of one and of several of its
    intervals.
    """
    window = min(LIMITS.window, len(time) // _FEWEST_WINDOWS)
    usual = float(np.median(time[window:] - time[:-window])) / window
    steps = np.diff(time)
    near = (steps > usual / 2) & (steps < 2 * usual - usual / 2)
    if not polled and near.mean() > 1 / 2:  # no bursts: lost samples do not lengthen the usual step
        usual = float(np.median(steps[near]))
    places = np.flatnonzero(steps > (LIMITS.lost + polled) * usual)
    late = time - usual * np.arange(len(time))
    sums = running_sums(late - late[0])
    # Compared are the stamps up to the next long step on both sides.
    before = np.maximum(places - window + 1, np.append(0, places[:-1] + 1)) if places.size else places
    after = np.minimum(places + 1 + window, np.append(places[1:] + 1, len(time))) if places.size else places
    left = (sums[places + 1] - sums[before]) / (places + 1 - before)
    right = (sums[after] - sums[places + 1]) / (after - places - 1)
    extra = steps[places] / usual - 1
    shift = (right - left) / usual
    real = shift > LIMITS.shift * extra
    return int(np.round(extra[real]).sum()), int(real.sum())


def _cut_disturbances(even: Mapping[str, _Even]) -> tuple[dict[str, Record], list[str]]:
    """Return the records without knocks and turns, which both triads show at one time, and a report."""
    spans = [span for one in even.values() for span in _disturbances(one)]
    if not spans:
        return {triad: one.record for triad, one in even.items()}, []
    spans = _merge_spans(spans)
    left_out = sum(end - begin for begin, end in spans)
    duration = max(one.record.duration for one in even.values())
    if left_out > LIMITS.moved * duration:
        raise MissionError(
            f"the IMU was knocked or turned during {left_out:.0f} of {duration:.0f} s; accepted is a "
            f"record at rest"
        )
    origin = min(float(one.time[0]) for one in even.values())
    places = ", ".join(f"{max(begin - origin, 0.0):.1f} s" for begin, _ in spans[:_NAMED_PLACES])
    more = "" if len(spans) <= _NAMED_PLACES else f" and {len(spans) - _NAMED_PLACES} more"
    remarks = [
        f"The IMU was knocked or turned at {places}{more} after the start: {left_out:.1f} s are left out."
    ]
    records = {}
    for triad, one in even.items():
        rows = _at_one_level(one, spans)
        records[triad] = Record(one.record.rates[rows], one.record.dt)
        kept = len(rows) * one.record.dt
        if kept < one.record.duration - left_out - LIMITS.margin:
            remarks.append(f"The level of the {triad}s changed with that: the longest {kept:.0f} s are used.")
    return records, remarks


def _merge_spans(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if merged and begin <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((begin, end))
    return merged


def _disturbances(one: _Even) -> list[tuple[float, float]]:
    """Return when means change from block to block as noise does not, with a margin [s]."""
    rates, dt = one.record
    spans = []
    for length in _BLOCKS:
        size = max(round(length / dt), 1)
        blocks = len(rates) // size
        if blocks < _FEWEST_BLOCKS or (length and size == 1):
            continue
        means = rates[: blocks * size].reshape(blocks, size, 3).mean(axis=1)
        change = np.abs(np.diff(means, axis=0))
        far = (change > LIMITS.outlier * _sigma(change, rates)).any(axis=1)
        for block in np.flatnonzero(far).tolist():
            begin, end = one.time[block * size], one.time[min((block + 2) * size, len(rates)) - 1]
            spans.append((float(begin) - LIMITS.margin, float(end) + LIMITS.margin))
    return spans


def _sigma(change: FloatArray, rates: FloatArray) -> FloatArray:
    """Return σ of changes (k, axes), little affected by outliers, and not below that of rounding."""
    robust = np.maximum(
        np.quantile(change, _TWO_IN_THREE, axis=0), np.quantile(change, _MOST, axis=0) / _SIGMAS_OF_MOST
    )
    steps = np.abs(np.diff(rates[: 10 * _PARTS], axis=0))
    least = np.min(np.where(steps > 0, steps, np.inf), axis=0)
    return np.maximum(robust, np.where(np.isfinite(least), least / 3, 0.0))


def _at_one_level(one: _Even, spans: Sequence[tuple[float, float]]) -> NDArray[np.intp]:
    """Return the rows outside of spans: the longest piece, with those beside that go on at its level."""
    free = np.ones(len(one.time), bool)
    for begin, end in spans:
        free &= (one.time < begin) | (one.time > end)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], free, [0]))))
    pieces = [np.arange(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not pieces:
        raise MissionError("the IMU was knocked or turned all the time; accepted is a record at rest")
    rates, dt = one.record
    size = max(round(LIMITS.margin / dt), _SAMPLES_PER_PART)
    longest = int(np.argmax([len(piece) for piece in pieces]))
    kept = [pieces[longest]]
    blocks = len(pieces[longest]) // size
    if blocks < _FEWEST_BLOCKS:
        return np.asarray(kept[0])
    means = rates[pieces[longest]][: blocks * size].reshape(blocks, size, 3).mean(axis=1)
    sigma = _sigma(np.abs(np.diff(means, axis=0)), rates)
    for piece in pieces[longest + 1 :]:
        if _goes_on(rates[kept[-1][-size:]], rates[piece[:size]], sigma):
            kept.append(piece)
    for piece in pieces[:longest][::-1]:
        if _goes_on(rates[kept[0][:size]], rates[piece[-size:]], sigma):
            kept.insert(0, piece)
    return np.concatenate(kept)


def _goes_on(before: FloatArray, after: FloatArray, sigma: FloatArray) -> bool:
    """Return whether the means of both differ as noise does; a short piece is as good as a knock."""
    if len(after) < len(before):
        return False
    return bool((np.abs(after.mean(axis=0) - before.mean(axis=0)) < LIMITS.outlier / 2 * sigma).all())


def _check_rest(triad: str, record: Record) -> None:
    """Raise `MissionError` if this is not the output of a body at rest."""
    rates, dt = record
    if len(rates) < MIN_SAMPLES:
        raise MissionError(f"{len(rates)} samples at rest; accepted are at least {MIN_SAMPLES}")
    if triad == "gyro":
        size = max(round(1 / dt), 1)
        blocks = len(rates) // size
        if blocks >= _FEWEST_BLOCKS:
            means = rates[: blocks * size].reshape(blocks, size, 3).mean(axis=1)
            change = float(_sigma(np.abs(np.diff(means, axis=0)), rates).max())
            if change > LIMITS.unsteady:
                raise MissionError(
                    f"the rates change by {np.degrees(change):.3g} °/s from second to second; accepted is a "
                    "record at rest"
                )
        return
    parts = min(_PARTS, len(rates) // _SAMPLES_PER_PART)
    means = np.stack([part.mean(axis=0) for part in np.array_split(rates, parts)])
    change = float(np.ptp(means, axis=0).max())
    if change > LIMITS.tilted:
        raise MissionError(f"the specific force changes by {change:.3g} m/s²; accepted is a record at rest")
