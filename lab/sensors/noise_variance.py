"""Noise variance: white noise of the IMU as the variance of a sample, N² f, in place of its density N."""

from __future__ import annotations

import math
from typing import Any

from lab.base.parameters.setting_kinds import AxisQuantity
from lab.base.parameters.settings import Derived, Settings
from lab.base.parameters.units import TO_SI
from lab.sensors.imu_errors import GyroErrors

NOISE_VARIANCES = ("sensors.gyro.noise_variance", "sensors.accelerometer.noise_variance")
"""Dotted paths of the variances in an experiment."""


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

    def back(value: Any) -> tuple[float, ...]:
        # Rounded, so that a value at the bounds does not exceed them.
        return tuple(float(f"{math.sqrt(number / rate) / factor:.15g}") for number in value)

    return Derived(
        AxisQuantity(
            form(density.default),
            unit=unit,
            bounds=tuple((end * factor) ** 2 * rate for end in density.bounds),
            label="Variance of a sample",
            doc="Variance of the white noise of one sample, N² f, at the IMU rate f.",
        ),
        path.replace("noise_variance", "noise_density"),
        form,
        back,
    )
