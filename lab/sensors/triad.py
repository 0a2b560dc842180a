"""Triad: the output of the gyros or the accelerometers of a suite in a flight, with all that acts on them."""

from __future__ import annotations

from typing import NamedTuple

from lab.base.arrays import FloatArray
from lab.sensors import imu
from lab.sensors import temperature as thermal
from lab.sensors.draws import Seed
from lab.sensors.suite import SensorSuite


class Conditions(NamedTuple):
    """What acts on both triads in each sample interval.

    Attributes
    ----------
    environment : Environment
        Temperature [°C], and velocity increments with the vibration of the vehicle [m/s].
    reading : (n,) array or None
        Reading of the thermometer [°C], where the temperature is compensated.
    """

    environment: imu.Environment
    reading: FloatArray | None

    @classmethod
    def of(
        cls,
        sensors: SensorSuite,
        seed: Seed,
        time: FloatArray,
        height: FloatArray,
        dvelocity: FloatArray,
        dt: float,
    ) -> Conditions:
        """Return what acts on the triads.

        Parameters
        ----------
        sensors
            The suite.
        seed
            Seed of the run, or the stream of its draws.
        time : (n,) array
            Ends of the intervals, since the start [s].
        height : (n,) array
            Height above the start then [m].
        dvelocity : (n, 3) array
            Increments of the smooth true flight [m/s].
        dt
            Length of the intervals [s].
        """
        temperature = thermal.temperature(sensors.temperature, time, height)
        shaken = imu.with_vibration(sensors.accelerometer, seed, dvelocity, dt)
        reading = None
        if sensors.temperature.compensation:
            reading = thermal.thermometer(sensors.temperature, seed, temperature)
        return cls(imu.Environment(temperature, shaken), reading)


def output(
    errors: imu.GyroErrors | imu.AccelerometerErrors,
    dtheta: FloatArray,
    dt: float,
    draws: imu.ImuDraws,
    conditions: Conditions,
    memory: imu.Memory | None = None,
) -> imu.Measured:
    """Return the output of a triad, compensated for temperature where that is set.

    Parameters
    ----------
    errors
        Its errors, which say which triad it is.
    dtheta : (n, 3) array
        True angular increments [rad]; the velocity increments are those of the conditions.
    dt
        Length of the intervals [s].
    draws
        Unit draws for n samples.
    conditions
        What acts on it.
    memory
        As of `imu.measure`.
    """
    quantity = dtheta if isinstance(errors, imu.GyroErrors) else conditions.environment.dvelocity
    measured = imu.measure(quantity, dt, errors, draws, conditions.environment, memory)
    if conditions.reading is None:
        return measured
    return imu.compensate(measured, dt, errors, conditions.environment.temperature, conditions.reading)
