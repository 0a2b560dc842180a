"""Barometer: height from the pressure of the air, with a bias that is the weather's.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
6.2.1.
"""

from __future__ import annotations

from lab.base.parameters.settings import Settings
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import readings
from lab.sensors.draws import Seed
from lab.sensors.readings import Readings, read, reading_times, slow_error


class BarometerErrors(Settings):
    """Errors and timing of a barometer. Defaults: a MEMS sensor, whose zero is set at the start."""

    fitted = readings.fitted(
        "a barometer. It measures the height above the ellipsoid; the difference from the height by pressure "
        "is its bias. A filter that uses it has a state for the bias."
    )
    period = readings.period(1.0)
    noise = readings.noise(0.3, unit="m", bounds=(1e-6, 1e3), softbounds=(0.01, 5), step=0.01)
    bias_sigma = readings.bias_sigma(5.0, unit="m", bounds=(0, 1e4), softbounds=(0, 100), step=0.5)
    drift_sigma = readings.drift_sigma(2.0, unit="m", bounds=(0, 1e3), softbounds=(0, 20), step=0.1)
    correlation_time = readings.correlation_time(1800.0)
    outages = readings.outages()


def measure(trajectory: Trajectory, errors: BarometerErrors, seed: Seed) -> Readings:
    """Return the readings of a barometer: heights [m].

    Parameters
    ----------
    trajectory
        The flight.
    errors
        Errors and timing.
    seed
        Seed of the run.
    """
    times = reading_times(errors.period, trajectory.duration)
    bias = slow_error(errors, seed, "barometer", times)
    height = trajectory.at(times).height
    return read(seed, "barometer", times, height, bias, errors.noise, errors.outages)
