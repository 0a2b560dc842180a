"""Airspeed: the true airspeed by a pitot tube, and the wind in which the vehicle flies.

The wind is level. Its components to the north and to the east are each a constant and a first-order
Gauss-Markov process. True airspeed is the magnitude of the velocity minus the wind: a pitot tube shows it
within 1 % up to some 15° of angle of attack and side slip.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6.2
and 16.2; W. Gracey, *Measurement of Aircraft Speed and Altitude*, NASA RP-1046 (1980), ch. 3 and 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_kinds import Quantity
from lab.base.parameters.units import si
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import processes, readings
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.readings import AidSensor, measure

__all__ = ["AirspeedErrors", "measure", "wind_at"]

_STEP = 1.0
"""Spacing of the samples of the wind [s]: the shortest correlation time."""


class AirspeedErrors(AidSensor):
    """Errors and timing of an airspeed sensor, and the wind.

    Defaults: a light aeroplane in a breeze. The noise includes gusts.
    """

    NAME = "airspeed"
    UNUSED = "below sensors.airspeed.slowest"
    fitted = readings.fitted(
        "an airspeed sensor. A filter that uses it has states for the wind to the north and to the east, and "
        "for the scale factor of the sensor."
    )
    period = readings.period(1.0)
    noise = readings.noise(1.0, unit="m/s", bounds=(1e-3, 100), softbounds=(0.1, 5), step=0.1)
    scale_factor_sigma = readings.scale_factor_sigma("airspeed")
    slowest = Quantity(
        20.0,
        unit="m/s",
        bounds=(0, 1000),
        softbounds=(0, 50),
        step=1,
        label="Slowest airspeed used",
        doc="The filter ignores readings below it. The pressure grows with the square of the speed, and a "
        "wind that is not small compared with the speed makes the airspeed far from linear.",
    )
    wind_sigma = Quantity(
        3.0,
        unit="m/s",
        bounds=(0, 100),
        softbounds=(0, 20),
        step=0.5,
        label="Wind, σ",
        doc="Standard deviation of the constant part of the wind, to the north and to the east, drawn anew "
        "for each seed.",
    )
    wind_drift_sigma = Quantity(
        1.0,
        unit="m/s",
        bounds=(0, 50),
        softbounds=(0, 5),
        step=0.1,
        label="Change of the wind, σ",
        doc="Standard deviation of the slow part of the wind, to the north and to the east, a first-order "
        "Gauss-Markov process.",
    )
    correlation_time = readings.correlation_time(300.0)
    outages = readings.outages()

    def truth(self, trajectory: Trajectory, seed: Seed, times: FloatArray) -> FloatArray:
        """Return the true airspeeds (a,) at times (a,) [m/s]."""
        through_air = trajectory.at(times).velocity_n.copy()
        through_air[:, :2] -= wind_at(self, seed, times)
        return np.asarray(np.linalg.norm(through_air, axis=1))

    def usable(self, value: FloatArray) -> NDArray[np.bool_]:
        """Return the mask (a,) of the airspeeds that are not below the slowest one that a filter uses."""
        return value >= float(si(self, "slowest"))


def wind_at(errors: AirspeedErrors, seed: Seed, time: FloatArray) -> FloatArray:
    """Return the true wind (n, 2) to the north and to the east at some times [m/s].

    Parameters
    ----------
    errors
        The wind.
    seed
        Seed of the run.
    time : (n,) array
        Times, not decreasing [s].
    """
    constant = float(si(errors, "wind_sigma")) * unit_draws(seed, "wind.constant", (2,))
    drift = float(si(errors, "wind_drift_sigma"))
    if not drift or not time.size:
        return np.broadcast_to(constant, (time.size, 2))
    samples = np.arange(int(np.ceil(time[-1] / _STEP)) + 1)
    draws = unit_draws(seed, "wind.drift", (samples.size, 2))
    slow = processes.gauss_markov(draws[0], draws, float(np.exp(-_STEP / errors.correlation_time)))
    return constant + drift * np.stack([np.interp(time, _STEP * samples, one) for one in slow.T], axis=-1)
