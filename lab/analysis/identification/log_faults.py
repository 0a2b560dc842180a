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

from lab.analysis.verdicts.finding import Change
from lab.analysis.verdicts.finding_names import ACCEL_AXES, GYRO_AXES, HEADINGS, IMU_AXES, LOSSES
from lab.base.arrays import FloatArray
from lab.data.checks.full_scale import full_scales
from lab.data.checks.imu_axes import NAMES, SAME, ImuAxes, level, signed
from lab.data.clock.usual_interval import UsualInterval
from lab.data.log.sensor_log import SensorLog

_LOST = 1.5
"""Interval in usual ones from which a sample is lost in it: halfway between one and two."""
_WORTH = 0.05
"""Part of the time that is lost from which that may be what is wrong: a few samples are one manoeuvre."""


class LogFault(NamedTuple):
    """A fault of a log.

    Attributes
    ----------
    quantity
        What a finding calls it.
    sentence, advice
        The fault and the advice, as text.
    mended
        The log without it.
    changes
        Changes of settings that mend it, too.
    """

    quantity: str
    sentence: str
    advice: str
    mended: SensorLog
    changes: tuple[Change, ...] = ()


def faults_of(log: SensorLog) -> Iterator[LogFault]:
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
    for matrix in signed(range(3)):
        if not np.array_equal(matrix, SAME) and not _is_cyclic(matrix):
            axes = ImuAxes(matrix, SAME)
            yield LogFault(GYRO_AXES, _axes_words("gyro", matrix), axes.remedy, with_axes(log, axes))
    for matrix in level():
        axes = ImuAxes(SAME, matrix)
        yield LogFault(ACCEL_AXES, _axes_words("accelerometer", matrix), axes.remedy, with_axes(log, axes))
        both = ImuAxes(matrix, matrix)
        if np.linalg.det(matrix) < 0:
            words = f"The axes of the IMU are left-handed: {_axes_words('axis', matrix, both=True)}"
        elif log.auxiliary.headings is not None:
            continue  # the headings are then off by as much, and this is said of them
        else:
            words = (
                "The IMU is turned about the vertical against the axes that the log states: "
                f"{_axes_words('axis', matrix, both=True)}"
            )
        yield LogFault(IMU_AXES, words, both.remedy, with_axes(log, both))


def _is_cyclic(matrix: FloatArray) -> bool:
    """Return whether all three axes have another place; such logs contradict gravity or the course."""
    return not np.diag(matrix).any()


def _axes_words(sensor: str, matrix: FloatArray, *, both: bool = False) -> str:
    """Return which axes have the wrong sign or are exchanged, as a sentence."""
    moved = [axis for axis in range(3) if not matrix[axis, axis]]
    minus = [NAMES[axis] for axis in range(3) if matrix[axis].sum() < 0]
    plural = f"{sensor}s" if sensor != "axis" else "axes"
    of = " of gyros and accelerometers" if both else ""
    found = []
    if moved:
        first, second = (NAMES[axis] for axis in moved)
        found.append(f"the {first} and the {second} {sensor}{of} are exchanged")
    if minus:
        names = " and the ".join(minus)
        have = "have the wrong signs" if len(minus) > 1 or both else "has the wrong sign"
        what = f"{names} {plural if both else sensor}{of}"
        found.append(f"{'then ' if moved else ''}the {what} {have}")
    words = ", and ".join(found)
    return f"{words}." if both else f"{words[0].upper()}{words[1:]}."


def ranges_of(log: SensorLog) -> Iterator[tuple[int, LogFault]]:
    """Yield the sensors at the end of their range, 0 for gyros and 1 for accelerometers, with the fault.

    What they moved by beyond it is unknown, so there is no log without the fault: it is this one, to be tried
    with less trust in the sensor.
    """
    scales = full_scales(np.concatenate(log.rates, axis=1))
    for sensor, kind in enumerate(("gyro", "accelerometer")):
        words = "; ".join(one.words for one in scales if one.axis // 3 == sensor)
        if words:
            yield (
                sensor,
                LogFault(
                    f"{kind} range",
                    f"The {kind}s are at the end of their range: {words}. What goes beyond it is cut off.",
                    f"Set the range of the {kind}s larger, or use {kind}s with a larger range.",
                    log,
                ),
            )


def _of_losses(log: SensorLog) -> Iterator[LogFault]:
    """Yield lost samples: what the IMU moved by in long intervals is not what its samples show."""
    dt = np.diff(log.time)
    usual = UsualInterval().take(dt)
    long = dt > _LOST * usual
    at, filled = log.time[1:], np.zeros(dt.size, np.bool_)
    for start, end in log.gaps:
        filled |= (at > start + 1e-9) & (at <= end + 1e-9)
    lost = float((dt - usual)[long].sum() + dt[filled].sum()) / log.duration
    if lost < _WORTH:
        return
    yield LogFault(
        LOSSES,
        f"{100 * lost:.2g} % of the samples of the IMU are lost: its motion in the meantime is unknown.",
        "Find out where samples are lost (bus, logger, link), or lower the rate so that none is.",
        _unknown(log, long),
    )


def _unknown(log: SensorLog, which: NDArray[np.bool_]) -> SensorLog:
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
        yield LogFault(
            HEADINGS,
            f"The headings of the log are off by {degrees}°: turned so, they and the motion agree.",
            "Check how the antennas, or the sensor of the heading, and the IMU are mounted, and turn the "
            f"headings by {-degrees}°.",
            replace(log, auxiliary=replace(log.auxiliary, headings=turned)),
        )
