"""Events: what happens in a flight and when: manoeuvres, rest, missing or rejected fixes, saturation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.observability import KINDS, manoeuvres
from lab.base.arrays import FloatArray
from lab.run.run import Run
from lab.sensors.imu import Measured

OUTAGE: Final = "outage"
REJECTED: Final = "rejected"
SATURATED: Final = "saturated"
FAULTS: Final = (OUTAGE, REJECTED, SATURATED)
SEVERAL: Final = {OUTAGE: "outages", REJECTED: "rejected fixes", SATURATED: "saturated sensors"}
"""Names of several events that are one in a drawing."""
QUIET: Final = KINDS[-1]
"""The kind of manoeuvre that is no event: nothing happens."""
MISSING = 2.5
"""Time between two fixes, in their median distance, from which fixes are missing: one may be late."""
JOINED = 1.0
"""Time within which a saturated sensor counts as saturated all the time [s]."""
AT_LIMIT = 1 - 1e-6
"""Part of the largest output from which an output is at the end of its range; single precision resolves
1e-7."""
SMALLEST = 1 / 2000
"""Part of the flight below which two events of one kind become one: a lane has fewer pixels."""


class Event(NamedTuple):
    """Something that happens in a flight.

    Attributes
    ----------
    kind : str
        `OUTAGE`, `REJECTED`, `SATURATED`, or a kind of manoeuvre (`lab.analysis.observability.KINDS`).
    start, end : float
        Its stretch of time, in the clock of the IMU samples [s]; the same for a single fix.
    words : str
        Its name.
    """

    kind: str
    start: float
    end: float
    words: str


def events(run: Run) -> list[Event]:
    """Return the events of a run, those of each kind in their order of time.

    All are taken from the run alone: a log has those of its data, and the manoeuvres of its estimated flight.
    """
    found = [
        Event(one.kind, one.start, one.end, one.name) for one in manoeuvres(run.flown) if one.kind != QUIET
    ]
    return [*found, *_outages(run), *_rejection_events(run), *_saturation_events(run)]


def _outages(run: Run) -> Iterator[Event]:
    """Iterate over the outages that are set, and other stretches without fixes, as of a log."""
    start, end = float(run.time[0]), float(run.time[-1])
    epoch = 0.0 if run.recorded is None else run.recorded.log.epoch
    set_ones = [
        (max(one - epoch, start), min(other - epoch, end))
        for one, other in run.experiment.sensors.gps.outages
    ]
    gaps = _gaps(run.fixes.time, start, end)
    missing = [gap for gap in gaps if not any(gap[0] < other and one < gap[1] for one, other in set_ones)]
    for first, last in sorted([*set_ones, *missing]):
        if first < last:
            yield Event(OUTAGE, first, last, "outage" if (first, last) in set_ones else "no GPS fix")


def _gaps(times: FloatArray, start: float, end: float) -> list[tuple[float, float]]:
    """Return the stretches between two fixes, or before the first or after the last, that are too long."""
    if not times.size:
        return [(start, end)]
    edges = np.concatenate(([start], times, [end]))
    return [
        (float(edges[at]), float(edges[at + 1]))
        for at in np.flatnonzero(np.diff(edges) > _longest_gap(times))
    ]


def _longest_gap(times: FloatArray) -> float:
    """Return the longest time between two fixes without any missing [s]."""
    return MISSING * float(np.median(np.diff(times))) if times.size > 1 else np.inf


def _rejection_events(run: Run) -> Iterator[Event]:
    """Iterate over the fixes that the gate rejected; those in a row, with none missing, are one event."""
    times, rejected = run.fixes.time, np.asarray(run.solution_arrays.fix_rejected, dtype=bool)
    breaks = np.flatnonzero((np.diff(times) > _longest_gap(times)) | (np.diff(rejected) != 0)) + 1
    for row in np.split(np.arange(times.size), breaks):
        if row.size and rejected[row[0]]:
            words = "rejected fix" if row.size == 1 else f"{row.size} rejected fixes"
            yield Event(REJECTED, float(times[row[0]]), float(times[row[-1]]), words)


def _saturation_events(run: Run) -> Iterator[Event]:
    """Iterate over the stretches of time in which an axis of a sensor is at the end of its range."""
    for name, measured in (("gyros", run.gyro), ("accelerometers", run.accelerometer)):
        if not measured.saturated:
            continue
        ends = run.time[1:][_at_limit(measured)]
        breaks = np.flatnonzero(np.diff(ends) > JOINED)
        for first, last in zip(np.append(0, breaks + 1), np.append(breaks, ends.size - 1), strict=True):
            yield Event(SATURATED, float(ends[first]), float(ends[last]), f"saturated {name}")


def _at_limit(measured: Measured) -> NDArray[np.bool_]:
    """Return in which samples (n,) an axis is at the end of the range, which the largest output has."""
    sizes = np.abs(measured.increments)
    return np.asarray((sizes >= AT_LIMIT * sizes.max()).any(axis=1))


def merge_close_events(found: list[Event], duration: float) -> list[Event]:
    """Return events as a lane has room for: faults that nearly touch are one, brief manoeuvres are omitted.

    Parameters
    ----------
    found
        From `events`.
    duration
        Length of the flight [s].
    """
    least, kept = SMALLEST * duration, list[Event]()
    for one in found:
        before = kept[-1] if kept else None
        if one.kind not in FAULTS:
            kept += [one] if one.end - one.start >= least else []
        elif before is not None and before.kind == one.kind and 0 <= one.start - before.end <= least:
            kept[-1] = Event(one.kind, before.start, one.end, SEVERAL[one.kind])
        else:
            kept.append(one)
    return kept
