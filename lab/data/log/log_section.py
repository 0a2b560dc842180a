"""Log section: the stretch of a log that is navigated: between two times and without a break of the IMU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.clock.limits import LIMITS
from lab.data.log.log_remarks import clock_text, span_text
from lab.data.log.sensor_log import MIN_IMU_SAMPLES, MIN_OVERLAP, SensorLog

_LISTED = 5
"""Most stretches that a remark lists."""
_ROUNDING = 1e-6
"""Rounding of time stamps [s]: Unix time in doubles has 0.2 µs."""


def cut_section(log: SensorLog, start: float | None = None, end: float | None = None) -> SensorLog:
    """Return the longest stretch of a log between two times that the IMU recorded without a break.

    Parameters
    ----------
    log
        The log.
    start, end
        First and last time, in the clock of its file [s]; None for the whole log.

    Returns
    -------
    SensorLog
        Its time counts from its own first sample, its `epoch` is that of the file's clock. The log itself if
        nothing is left out.

    Raises
    ------
    MissionError
        If the times are not in order, or IMU and receiver have too little in common between them.
    """
    low = log.time[0] if start is None else start - log.epoch
    high = log.time[-1] if end is None else end - log.epoch
    _check(log, start, end)
    spans = np.column_stack(
        (np.append(log.time[0], log.breaks[:, 1]), np.append(log.breaks[:, 0], log.time[-1]))
    )
    spans = np.column_stack((np.maximum(spans[:, 0], low), np.minimum(spans[:, 1], high)))
    if len(spans) == 1 and spans[0, 0] <= log.time[0] and spans[0, 1] >= log.time[-1]:
        return log
    common = _common(log, spans)
    best = int(np.argmax(common))
    if common[best] < MIN_OVERLAP:
        raise MissionError(
            f"{log.name}: {_describe_span(log, start, end)} IMU and GPS have no stretch of "
            f"{MIN_OVERLAP:g} s in "
            f"common without a break of the IMU; accepted are times within {clock_text(log.epoch)} to "
            f"{clock_text(log.epoch + log.duration)} s of the file's clock"
        )
    usable = np.flatnonzero(common >= MIN_OVERLAP)
    return _cut_span(
        log, spans[best], _remarks(log, spans, best, usable, start is not None or end is not None)
    )


def _check(log: SensorLog, start: float | None, end: float | None) -> None:
    if start is not None and end is not None and start >= end:
        raise MissionError(
            f"{log.name}: the stretch from {clock_text(start)} to {clock_text(end)} s ends before it begins; "
            "accepted is an end after the start"
        )


def _common(log: SensorLog, spans: FloatArray) -> FloatArray:
    """Return how long IMU and receiver recorded together in each span [s]; 0 where either has too little."""
    times = log.gnss.time - log.gnss.latency
    edges = np.stack((spans[:, 0] - _ROUNDING, spans[:, 1] + _ROUNDING))
    first, last = np.searchsorted(times, edges)
    samples = np.diff(np.searchsorted(log.time, edges), axis=0)[0]
    enough = (last - first >= 2) & (samples >= MIN_IMU_SAMPLES)
    return np.where(enough, times[last - 1] - times[np.minimum(first, times.size - 1)], 0.0)


def _cut_span(log: SensorLog, span: FloatArray, remarks: tuple[str, ...]) -> SensorLog:
    first, last = np.searchsorted(log.time, (span[0] - _ROUNDING, span[1] + _ROUNDING))
    time = log.time[first:last]
    zero = float(time[0])
    gnss = log.gnss
    # The fix before gives the position at the start.
    valid = gnss.time - gnss.latency
    rows = slice(
        max(0, int(np.searchsorted(valid, zero)) - 1), int(np.searchsorted(valid, time[-1], "right"))
    )
    gaps = log.gaps[(log.gaps[:, 0] >= zero - _ROUNDING) & (log.gaps[:, 1] <= time[-1] + _ROUNDING)]
    return replace(
        log,
        epoch=log.epoch + zero,
        time=time - zero,
        dtheta=log.dtheta[first : last - 1],
        dvelocity=log.dvelocity[first : last - 1],
        gnss=gnss.rows(rows, zero),
        reference=None if log.reference is None else log.reference.later(-zero),
        gaps=gaps - zero,
        breaks=np.empty((0, 2)),
        auxiliary=log.auxiliary.later(-zero),
        repairs=(*log.repairs, *remarks),
    )


def _remarks(
    log: SensorLog, spans: FloatArray, best: int, usable: NDArray[np.intp], asked: bool
) -> tuple[str, ...]:
    clock = spans + log.epoch
    taken = span_text(clock[best])
    if len(spans) == 1:
        return (f"The navigated part is {taken} of the file's clock, as requested.",)
    longest = float(np.diff(log.breaks, axis=1).max())
    count = "1 gap" if len(log.breaks) == 1 else f"{len(log.breaks)} gaps"
    asked_for = " of the requested stretch" if asked else ""
    text = (
        f"The IMU has {count} of more than {LIMITS.longest_filled:g} s, up to {longest:.4g} s long: only the "
        f"longest piece{asked_for} is navigated, {taken} of the file's clock."
    )
    others = [
        f"{clock_text(clock[i, 0])} to {clock_text(clock[i, 1])} s" for i in usable.tolist() if i != best
    ]
    if others:
        more = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
        text += f" Other pieces, for --from and --to: {', '.join(others[:_LISTED])}{more}."
    return (text,)


def _describe_span(log: SensorLog, start: float | None, end: float | None) -> str:
    first = log.epoch if start is None else start
    last = log.epoch + log.duration if end is None else end
    return f"from {clock_text(first)} to {clock_text(last)} s"
