"""Sensor stream: the sensors of a suite on a flight that comes piece by piece.

The models are those of the batch; their draws and processes go on from piece to piece, so pieces joined are
what the batch computes for the same seed: the same bits, but for the flicker, which agrees to 10⁻⁶.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.truth.growing_trajectory import FlownPiece
from lab.sensors import gps, imu
from lab.sensors.draws import DrawStream
from lab.sensors.imu_draws import ImuDrawStream
from lab.sensors.suite import SensorSuite
from lab.sensors.triad import Conditions, output


class Sensed(NamedTuple):
    """What the sensors measure in a piece of a flight.

    Attributes
    ----------
    time : (n,) array
        Ends of the sample intervals, on the grid of the IMU [s].
    gyro, accelerometer : Measured
        Output of the triads in these intervals.
    fixes : GpsFixes
        Fixes within the piece.
    """

    time: FloatArray
    gyro: imu.Measured
    accelerometer: imu.Measured
    fixes: gps.GpsFixes


class SensorStream:
    """Sensors that are switched on at time 0 of the grid, or with the first piece.

    Parameters
    ----------
    sensors
        Their errors.
    seed
        Of all random numbers.
    rate
        Rate of the IMU [Hz].
    """

    def __init__(self, sensors: SensorSuite, seed: int, rate: float) -> None:
        self._sensors, self._rate = sensors, rate
        self._draws = DrawStream(seed)
        self._triads = {
            name: ImuDrawStream(
                seed,
                name,
                instability=any(errors.instability),
                flicker=any(errors.flicker),
                walk=any(errors.rate_random_walk),
            )
            for name, errors in (("gyro", sensors.gyro), ("accelerometer", sensors.accelerometer))
        }
        self._memories = {name: imu.Memory() for name in self._triads}
        self._receiver = gps.Memory()
        self._height: float | None = None  # at the start

    def break_off(self) -> None:
        """Forget the motion before a jump, which no lag goes on with; the errors of the sensors go on."""
        for memory in self._memories.values():
            memory.lag.clear()

    def sensed(self, piece: FlownPiece) -> Sensed:
        """Return what is measured in a piece, which follows the one before or comes after a break."""
        dt = 1 / self._rate
        part = slice(piece.begin - piece.first, piece.end - piece.first)
        ideal = piece.trajectory.increments()
        dtheta, dvelocity = ideal.dtheta[part], ideal.dvelocity[part]
        time = np.arange(piece.begin + 1, piece.end + 1) / self._rate
        height = piece.trajectory.at(piece.trajectory.time[piece.begin - piece.first : part.stop + 1]).height
        if self._height is None:
            self._height = float(height[0])
        conditions = Conditions.of(self._sensors, self._draws, time, height[1:] - self._height, dvelocity, dt)
        gyro, accelerometer = (
            output(
                errors,
                dtheta,
                dt,
                self._triads[name].following(len(dtheta)),
                conditions,
                self._memories[name],
            )
            for name, errors in (
                ("gyro", self._sensors.gyro),
                ("accelerometer", self._sensors.accelerometer),
            )
        )
        return Sensed(time, gyro, accelerometer, self._fixes(piece))

    def _fixes(self, piece: FlownPiece) -> gps.GpsFixes:
        """Return the fixes within a piece."""
        errors = self._sensors.gps
        period = errors.period
        # As in `gps.fix_times`: fixes are at whole periods, and a rounded time does not lose one.
        first, last = (int(number / self._rate / period + 1e-9) for number in (piece.begin, piece.end))
        times = period * np.arange(first + 1.0, last + 1)
        truth = piece.trajectory.at(piece.since(times))
        seen = None
        if errors.latency or any(errors.lever_arm):
            seen = gps.antenna(piece.trajectory, errors, piece.since(times))
        draws = gps.GpsDraws.of(self._draws, times.size)
        return gps.measure(replace(truth, time=times), errors, draws, seen, self._receiver)
