"""IMU errors: the settings of the errors of gyros and accelerometers.

Coefficients N, B and K are those of IEEE Std 952-1997, annex C. White noise may also be given as the variance
of a sample, N² f, in place of its density N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lab.base.parameters.setting_kinds import AxisQuantity, Quantity
from lab.base.parameters.settings import Derived, Settings
from lab.base.parameters.units import TO_SI

NOISE_VARIANCES = ("sensors.gyro.noise_variance", "sensors.accelerometer.noise_variance")
"""Dotted paths of the variances in an experiment."""
OFF_DIAGONAL = ("xy", "xz", "yx", "yz", "zx", "zy")


# Common declarations of both triads: the same texts, and for pure numbers and times the same values.


def _bias(**size: Any) -> AxisQuantity:
    doc = "Known part of the turn-on bias; the filter does not know its value."
    return AxisQuantity(0.0, label="Turn-on bias, given", doc=doc, **size)


def _bias_sigma(default: float, **size: Any) -> AxisQuantity:
    doc = "Standard deviation of the part of the turn-on bias that is drawn anew for each seed."
    return AxisQuantity(default, label="Turn-on bias, σ", doc=doc, **size)


def _instability(**size: Any) -> AxisQuantity:
    doc = "Standard deviation of the first-order Gauss-Markov bias."
    return AxisQuantity(0.0, label="Bias instability", doc=doc, **size)


def _correlation_time() -> Quantity:
    return Quantity(
        300.0,
        unit="s",
        bounds=(0.1, 1e6),
        softbounds=(10, 3600),
        step=10,
        label="Correlation time",
        doc="Correlation time of the Gauss-Markov bias.",
    )


def _flicker(**size: Any) -> AxisQuantity:
    doc = "Coefficient B of a true 1/f bias instability; the floor of the Allan deviation is 0.664 B."
    return AxisQuantity(0.0, label="Flicker", doc=doc, **size)


def _rate_random_walk(label: str, **size: Any) -> AxisQuantity:
    doc = "Coefficient K of a bias that walks randomly; the Allan deviation rises with K √(τ / 3)."
    return AxisQuantity(0.0, label=label, doc=doc, **size)


def _scale_factor() -> AxisQuantity:
    return AxisQuantity(
        0.0,
        unit="%",
        bounds=(-50, 50),
        softbounds=(-2, 2),
        step=0.01,
        label="Scale factor error",
        doc="Relative error of the scale factor.",
    )


def _scale_factor_sigma() -> AxisQuantity:
    return AxisQuantity(
        0.0,
        unit="%",
        bounds=(0, 50),
        softbounds=(0, 2),
        step=0.01,
        label="Scale factor error, σ",
        doc="Standard deviation of the part of the scale factor error that is drawn anew for each seed.",
    )


def _misalignment() -> AxisQuantity:
    return AxisQuantity(
        0.0,
        unit="°",
        axes=OFF_DIAGONAL,
        bounds=(-20, 20),
        softbounds=(-2, 2),
        step=0.01,
        label="Misalignment",
        doc="Off-diagonal elements of M: 'xy' is the part of the y axis that the x sensor measures.",
    )


def _bias_temperature(**size: Any) -> AxisQuantity:
    doc = "Change of the bias with temperature, from 25 °C on (see sensors.temperature)."
    return AxisQuantity(0.0, label="Bias, temperature", doc=doc, **size)


def _scale_temperature() -> AxisQuantity:
    return AxisQuantity(
        0.0,
        unit="%/K",
        bounds=(-0.1, 0.1),
        softbounds=(-0.05, 0.05),
        step=0.001,
        label="Scale factor, temperature",
        doc="Change of the scale factor with temperature, from 25 °C on (see sensors.temperature).",
    )


def _bandwidth() -> AxisQuantity:
    return AxisQuantity(
        0.0,
        unit="Hz",
        bounds=(0, 10000),
        softbounds=(0, 500),
        step=1,
        label="Bandwidth",
        doc="Frequency at which a first-order lag reduces the output to 1/√2; 0 for no lag.",
    )


class GyroErrors(Settings):
    """Errors of the three gyros. Defaults: MEMSense AccelRate3D of the classic experiment."""

    noise_density = AxisQuantity(
        0.05,
        unit="°/s/√Hz",
        bounds=(0, 10),
        softbounds=(0, 0.5),
        step=0.001,
        label="White noise",
        doc="Random noise of each sample, which integrates to a drifting angle: N of IEEE 952, the root of "
        "the two-sided density. Typical MEMS: 0.003 to 0.05 °/s/√Hz. An angle random walk in °/√h is 60 N; a "
        "data sheet's one-sided density is √2 N. Given as noise_variance it is the variance N² f of a sample "
        "at the IMU rate f.",
    )
    bias = _bias(unit="°/s", bounds=(-20, 20), softbounds=(-1, 1), step=0.01)
    bias_sigma = _bias_sigma(0.1, unit="°/s", bounds=(0, 20), softbounds=(0, 1), step=0.01)
    instability = _instability(unit="°/h", bounds=(0, 36000), softbounds=(0, 360), step=1)
    correlation_time = _correlation_time()
    flicker = _flicker(unit="°/h", bounds=(0, 36000), softbounds=(0, 100), step=0.1)
    rate_random_walk = _rate_random_walk(
        "Rate random walk", unit="°/h/√h", bounds=(0, 36000), softbounds=(0, 100), step=0.1
    )
    scale_factor = _scale_factor()
    scale_factor_sigma = _scale_factor_sigma()
    misalignment = _misalignment()
    g_sensitivity = AxisQuantity(
        0.0,
        unit="°/s/g",
        bounds=(-10, 10),
        softbounds=(-0.2, 0.2),
        step=0.001,
        label="g-sensitivity",
        doc="Bias from the specific force along the axis of the gyro.",
    )
    bias_temperature = _bias_temperature(unit="°/s/K", bounds=(-1, 1), softbounds=(-0.02, 0.02), step=0.0001)
    scale_temperature = _scale_temperature()
    bandwidth = _bandwidth()
    range = Quantity(
        150.0,
        unit="°/s",
        bounds=(1, 10000),
        softbounds=(10, 1000),
        step=10,
        label="Range",
        doc="The output saturates beyond plus and minus this rate.",
    )
    quantisation = AxisQuantity(
        0.0,
        unit="°/s",
        bounds=(0, 100),
        softbounds=(0, 0.1),
        step=0.001,
        label="Quantisation",
        doc="Step of the output: the mean rate of each sample is rounded to it.",
    )


class AccelerometerErrors(Settings):
    """Errors of the three accelerometers. Defaults: MEMSense AccelRate3D of the classic experiment."""

    noise_density = AxisQuantity(
        (35.0, 65.0, 35.0),
        unit="µg/√Hz",
        bounds=(0, 10000),
        softbounds=(0, 500),
        step=1,
        label="White noise",
        doc="Random noise of each sample, which integrates to a drifting velocity: N of IEEE 952, the root "
        "of the two-sided density. A data sheet's one-sided density is √2 N. Given as noise_variance it is "
        "the variance N² f of a sample at the IMU rate f.",
    )
    bias = _bias(unit="mg", bounds=(-500, 500), softbounds=(-20, 20), step=0.1)
    bias_sigma = _bias_sigma(2.0, unit="mg", bounds=(0, 500), softbounds=(0, 20), step=0.1)
    instability = _instability(unit="mg", bounds=(0, 100), softbounds=(0, 2), step=0.01)
    correlation_time = _correlation_time()
    flicker = _flicker(unit="mg", bounds=(0, 100), softbounds=(0, 2), step=0.001)
    rate_random_walk = _rate_random_walk(
        "Bias random walk", unit="mg/√h", bounds=(0, 1000), softbounds=(0, 10), step=0.01
    )
    scale_factor = _scale_factor()
    scale_factor_sigma = _scale_factor_sigma()
    misalignment = _misalignment()
    bias_temperature = _bias_temperature(unit="mg/K", bounds=(-50, 50), softbounds=(-1, 1), step=0.001)
    scale_temperature = _scale_temperature()
    vibration_density = AxisQuantity(
        0.0,
        unit="µg/√Hz",
        bounds=(0, 1e6),
        softbounds=(0, 1000),
        step=1,
        label="Vibration",
        doc="Density of the vehicle's vibration, white in the band of the sensor: real specific force, "
        "which the accelerometers measure and the true flight omits.",
    )
    bandwidth = _bandwidth()
    range = Quantity(
        10.0,
        unit="g",
        bounds=(1, 1000),
        softbounds=(2, 50),
        step=1,
        label="Range",
        doc="The output saturates beyond plus and minus this specific force.",
    )
    quantisation = AxisQuantity(
        0.0,
        unit="mg",
        bounds=(0, 1000),
        softbounds=(0, 10),
        step=0.01,
        label="Quantisation",
        doc="Step of the output: the mean specific force of each sample is rounded to it.",
    )


def noise_variance(errors: Settings, path: str, rate: float) -> Derived:
    """Return the variance of a sample as another form of a noise density.

    Means over a sample interval 1 / f of white noise with the density N have the variance N² f (P. D. Groves,
    *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eq. 4.15).

    Parameters
    ----------
    errors
        The errors of the triad, which declare the density.
    path
        Dotted path of the variance.
    rate
        Rate f of the samples [Hz].
    """
    density = errors.param["noise_density"]
    unit = "(°/s)²" if isinstance(errors, GyroErrors) else "(m/s²)²"
    factor = TO_SI[density.unit] / math.sqrt(TO_SI[unit])

    def form(value: Any) -> tuple[float, ...]:
        return tuple((number * factor) ** 2 * rate for number in value)

    def convert_back(value: Any) -> tuple[float, ...]:
        # Rounded, so that a value at the bounds does not exceed them.
        return tuple(float(f"{math.sqrt(number / rate) / factor:.15g}") for number in value)

    return Derived(
        AxisQuantity(
            form(density.default),
            unit=unit,
            bounds=tuple((end * factor) ** 2 * rate for end in density.bounds),
            label="Variance per sample",
            doc="Variance of the white noise of one sample, N² f, at the IMU rate f.",
        ),
        path.replace("noise_variance", "noise_density"),
        form,
        convert_back,
    )


@dataclass(frozen=True)
class SensorNoise:
    """White noise of an IMU.

    Attributes
    ----------
    name : str
        Name of the IMU.
    gyro : float
        Density of the angular rate's noise, root mean square of the three axes [rad/s/√Hz].
    accelerometer : float
        Density of the specific force's noise, likewise [m/s²/√Hz].
    """

    name: str
    gyro: float
    accelerometer: float
