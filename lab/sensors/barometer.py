"""Barometer: height from the pressure of the air, with a bias that is the weather's.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
6.2.1.
"""

from __future__ import annotations

from lab.base.arrays import FloatArray
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import readings
from lab.sensors.draws import Seed
from lab.sensors.readings import AidSensor, measure

__all__ = ["BarometerErrors", "measure"]


class BarometerErrors(AidSensor):
    """Errors and timing of a barometer. Defaults: a MEMS sensor, whose zero is set at the start."""

    NAME = "barometer"
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

    def truth(self, trajectory: Trajectory, seed: Seed, times: FloatArray) -> FloatArray:
        """Return the true heights (a,) at times (a,) [m]."""
        return trajectory.at(times).height
