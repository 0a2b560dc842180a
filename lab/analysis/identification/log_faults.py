"""Log faults: what may be wrong with a sensor log as a whole, and the log as it would be without.

Each fault has a physical size, or none to choose: an axis has the wrong sign or it has not. So a fault that
makes a log consistent explains it better than noise of any size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.verdicts.finding import Finding, Verdict
from lab.analysis.verdicts.finding_table import FINDINGS, SENSORS
from lab.base.arrays import FloatArray
from lab.data.checks.full_scale import full_scales
from lab.data.checks.imu_axes import NAMES, SAME, ImuAxes, iterate_signed_axes, level
from lab.data.clock.faults import UsualInterval
from lab.data.clock.limits import LIMITS
from lab.data.log.sensor_log import SensorLog

_WORTH = 0.05
"""Part of the time that is lost from which that may be what is wrong: a few samples are one manoeuvre."""


class LogFault(NamedTuple):
    """A fault of a log.

    Attributes
    ----------
    finding
        The finding, with the changes of settings that mend the fault too, before anything is tried.
    mended
        The log without it.
    """

    finding: Finding
    mended: SensorLog


def iterate_faults(log: SensorLog) -> Iterator[LogFault]:
    """Yield the faults that a log may have, but for those of its clock and its ranges."""
    yield from _of_axes(log)
    yield from _of_losses(log)
    yield from _of_headings(log)


def with_axes(log: SensorLog, axes: ImuAxes) -> SensorLog:
    """Return a log whose IMU has other axes."""
    return replace(log, dtheta=log.dtheta @ axes.gyros.T, dvelocity=log.dvelocity @ axes.forces.T)


def with_clock(log: SensorLog, late: float, rate: float) -> SensorLog:
    """Return a log whose IMU is timed by the clock of the receiver.

    Parameters
    ----------
    log
        The log.
    late
        Lateness of the stamps of the fixes at time 0 of the log [s].
    rate
        How much faster the clock of the IMU runs than that of the receiver.
    """
    shown = 1 / (1 + rate)  # rates are measured, so increments are as long as their intervals
    gnss = replace(log.gnss, time=(log.gnss.time - late))
    return replace(
        log,
        time=log.time * shown,
        dtheta=log.dtheta * shown,
        dvelocity=log.dvelocity * shown,
        gnss=gnss,
        gaps=log.gaps * shown,
        breaks=log.breaks * shown,
        reference=None,
    )


def _of_axes(log: SensorLog) -> Iterator[LogFault]:
    """Yield gyros, accelerometers or both with another order or other signs of their axes.

    Gravity shows the vertical accelerometer when a log is read.
    """
    for matrix in iterate_signed_axes(range(3)):
        if not np.array_equal(matrix, SAME) and not _is_cyclic(matrix):
            axes = ImuAxes(matrix, SAME)
            yield LogFault(_of_matrix("gyro", matrix, axes), with_axes(log, axes))
    for matrix in level():
        axes = ImuAxes(SAME, matrix)
        yield LogFault(_of_matrix("accelerometer", matrix, axes), with_axes(log, axes))
        both = ImuAxes(matrix, matrix)
        if np.linalg.det(matrix) < 0:
            row = "left-handed axes"
        elif log.auxiliary.headings is not None:
            continue  # the headings are then off by as much, and this is said of them
        else:
            row = "turned axes"
        which = _of_matrix("axis of gyros and accelerometers", matrix, both).sentence
        finding = FINDINGS[row].finding(float("nan"), "", which=which, remedy=both.remedy)
        yield LogFault(finding, with_axes(log, both))


def _is_cyclic(matrix: FloatArray) -> bool:
    """Return whether all three axes have another place; such logs contradict gravity or the course."""
    return not np.diag(matrix).any()


def _of_matrix(sensor: str, matrix: FloatArray, axes: ImuAxes) -> Finding:
    """Return the finding about which axes have the wrong sign or are exchanged."""
    moved = [NAMES[axis] for axis in range(3) if not matrix[axis, axis]]
    minus = [NAMES[axis] for axis in range(3) if matrix[axis].sum() < 0]
    row = {0: "", 1: "wrong sign"}.get(len(minus), "wrong signs")
    if moved:
        row = f"axes exchanged, {row}" if row else "axes exchanged"
    first, second = moved or ("", "")
    return FINDINGS[row].finding(
        float("nan"),
        "",
        sensor=sensor,
        first=first,
        second=second,
        axes=" and the ".join(minus),
        remedy=axes.remedy,
    )


def iterate_range_faults(log: SensorLog) -> Iterator[tuple[int, LogFault]]:
    """Yield the sensors at the end of their range, 0 for gyros and 1 for accelerometers, with the fault.

    What they moved by beyond it is unknown, so there is no log without the fault: it is this one, to be tried
    with less trust in the sensor.
    """
    scales = full_scales(np.concatenate(log.rates, axis=1))
    for sensor, kind in enumerate(SENSORS):
        words = "; ".join(one.words for one in scales if one.axis // 3 == sensor)
        if words:
            yield (
                sensor,
                LogFault(
                    FINDINGS["end of the range"].finding(float("nan"), "", sensor=kind, ranges=words), log
                ),
            )


def _of_losses(log: SensorLog) -> Iterator[LogFault]:
    """Yield lost samples: what the IMU moved by in long intervals is not what its samples show."""
    dt = np.diff(log.time)
    usual = UsualInterval().accept(dt)
    long = dt > LIMITS.missing * usual
    start, end = log.gaps.T  # filled at the usual interval; the sample at the end is there
    ends = np.clip(np.searchsorted(log.time, end) - 1, 0, dt.size - 1)
    filled = np.maximum(end - start - usual[ends], 0)
    lost = float((dt - usual)[long].sum() + filled.sum()) / log.duration
    if lost < _WORTH:
        return
    finding = FINDINGS["losses"].finding(float("nan"), "", percent=100 * lost)
    yield LogFault(finding, _mask_motion(log, long))


def name_lost_samples(verdict: Verdict, log: SensorLog) -> Verdict:
    """Return a verdict that names lost samples first, where the filter allows for them and is consistent."""
    losses = next(_of_losses(log), None) if verdict.consistent else None
    if losses is None:
        return verdict
    return replace(verdict, headline=f"{losses.finding.sentence} {verdict.headline}", note=losses.finding)


def _mask_motion(log: SensorLog, which: NDArray[np.bool_]) -> SensorLog:
    """Return a log that does not know the motion in some intervals (n,), as in gaps that were filled."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], which, [False])).astype(np.int8)))
    spans = np.stack((log.time[edges[::2]], log.time[edges[1::2]]), axis=-1)
    joined = np.concatenate((log.gaps, spans))
    return replace(log, gaps=joined[np.argsort(joined[:, 0], kind="stable")])


def _of_headings(log: SensorLog) -> Iterator[LogFault]:
    """Yield headings that are off by a quarter or half a turn, as of antennas mounted so."""
    headings = log.auxiliary.headings
    if headings is None:
        return
    for degrees in (180, 90, -90):
        turned = replace(headings, heading=headings.heading - np.radians(degrees))
        finding = FINDINGS["headings"].finding(float("nan"), "", degrees=degrees, back=-degrees)
        yield LogFault(finding, replace(log, auxiliary=replace(log.auxiliary, headings=turned)))
