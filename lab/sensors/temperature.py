"""Temperature: the temperature of the IMU over the mission, and its thermometer.

All temperatures are in degrees Celsius; the sensors' coefficients refer to `REFERENCE`.
"""

from __future__ import annotations

import numpy as np
import param

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_kinds import Quantity
from lab.base.parameters.settings import Settings
from lab.base.parameters.units import si
from lab.sensors.draws import Seed, unit_draws

REFERENCE = 25.0
"""Temperature of calibration, and of an IMU without a temperature profile [°C]."""


class TemperatureSettings(Settings):
    """Temperature of the IMU, and whether its effect is compensated."""

    profile = param.Selector(
        default="none",
        objects=["none", "constant", "warm_up", "climb"],
        label="Temperature profile",
        doc="none: 25 °C, the temperature of calibration. constant. warm_up: an exponential rise from the "
        "time of switching on. climb: falls with height.",
    )
    start = Quantity(
        25.0,
        unit="°C",
        bounds=(-100, 200),
        softbounds=(-40, 85),
        step=1,
        label="Temperature at the start",
        doc="Temperature of the IMU when the mission starts, in every profile but none.",
    )
    warm_up_rise = Quantity(
        20.0,
        unit="K",
        bounds=(-200, 200),
        softbounds=(0, 50),
        step=1,
        label="Warm-up, rise",
        doc="Final rise of the temperature, in the profile warm_up.",
    )
    warm_up_time = Quantity(
        300.0,
        unit="s",
        bounds=(0.1, 1e6),
        softbounds=(10, 3600),
        step=10,
        label="Warm-up, time constant",
        doc="Time of the first 63 % of the rise, in the profile warm_up.",
    )
    lapse_rate = Quantity(
        6.5,
        unit="K/km",
        bounds=(-20, 20),
        softbounds=(0, 10),
        step=0.1,
        label="Lapse rate",
        doc="Decrease of the temperature with height above the start, in the profile climb.",
    )
    compensation = param.Boolean(
        default=False,
        label="Compensation",
        doc="Correct the output of the IMU by its known temperature coefficients and a thermometer.",
    )
    thermometer_sigma = Quantity(
        0.0,
        unit="K",
        bounds=(0, 20),
        softbounds=(0, 2),
        step=0.01,
        label="Thermometer, σ",
        doc="White noise of the thermometer, drawn anew for each IMU sample; used by the compensation.",
    )


def temperature(settings: TemperatureSettings, time: FloatArray, height: FloatArray) -> FloatArray:
    """Return the temperature of the IMU (n,) [°C].

    Parameters
    ----------
    settings
        The profile.
    time : (n,) array
        Time since the start [s].
    height : (n,) array
        Height above the start [m].
    """
    start = si(settings, "start")
    if settings.profile == "warm_up":
        return np.asarray(
            start - si(settings, "warm_up_rise") * np.expm1(-time / si(settings, "warm_up_time"))
        )
    if settings.profile == "climb":
        return np.asarray(start - si(settings, "lapse_rate") * height)
    return np.full(time.shape, start if settings.profile == "constant" else REFERENCE)


def thermometer(settings: TemperatureSettings, seed: Seed, temperature: FloatArray) -> FloatArray:
    """Return the reading of the thermometer (n,) [°C].

    Parameters
    ----------
    settings
        The thermometer's noise.
    seed
        Seed of the run, or the stream of its draws.
    temperature : (n,) array
        True temperature [°C].
    """
    sigma = si(settings, "thermometer_sigma")
    if not sigma:
        return temperature
    return np.asarray(temperature + sigma * unit_draws(seed, "thermometer", temperature.shape))
