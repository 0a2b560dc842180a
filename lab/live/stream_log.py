"""Stream log: what the live navigator keeps of a stream, as a sensor log for the batch."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.log.auxiliary_data import AuxiliaryData, Series
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.streams.live_log import headings_of, magnetometer_of
from lab.live.live_stream import Stream


def log_of_stream(
    stream: Stream, lever_arm: FloatArray, latency: float, height_shift: float, repairs: tuple[str, ...]
) -> SensorLog:
    """Return the samples of a stream that are kept as a sensor log, whose time 0 is the first of them.

    Parameters
    ----------
    stream
        The stream.
    lever_arm : (3,) array
        From the IMU to the antenna, in b [m].
    latency
        How much later than the fixes their times are [s].
    height_shift
        What is added to a height by pressure [m]; NaN if it is unknown.
    repairs
        What was repaired, as sentences.

    Raises
    ------
    MissionError
        If nothing has come yet.
    """
    samples, fixes = stream.samples, stream.fixes
    if not len(samples):
        raise MissionError("live stream: no sample has come yet; accepted is a stream with samples")
    zero = float(samples.column("time")[0])
    time = samples.column("time") - zero
    gaps = [(max(start, zero), end) for start, end in stream.gaps if end > zero]
    heights, speeds, headings, _ = stream.readings
    barometer = odometer = None
    if len(heights) and not np.isnan(height_shift):
        barometer = Series(heights.column("time") - zero, heights.column("value") + height_shift)
    if len(speeds):
        odometer = Series(speeds.column("time") - zero, speeds.column("value").copy())
    return SensorLog(
        name="live stream",
        epoch=stream.epoch + zero,
        time=time,
        dtheta=samples.column("dtheta")[1:].copy(),
        dvelocity=samples.column("dvelocity")[1:].copy(),
        gnss=GnssLog(
            time=fixes.column("time") + latency - zero,
            position=fixes.column("position").copy(),
            velocity_n=fixes.column("velocity_n").copy(),
            position_sigma=fixes.column("position_sigma").copy(),
            velocity_sigma=fixes.column("velocity_sigma").copy(),
            lever_arm=lever_arm,
            latency=latency,
        ),
        reference=None,
        gaps=np.array(gaps).reshape(-1, 2) - zero,
        repairs=repairs,
        auxiliary=AuxiliaryData(
            magnetometer=magnetometer_of(time, samples.column("magnetic")),
            headings=headings_of(
                headings.column("time") - zero, headings.column("value"), headings.column("sigma")
            ),
            barometer=barometer,
            odometer=odometer,
        ),
    )
