"""IMU: what a real inertial sensor makes of the true rates and specific forces (the truth side)."""

from __future__ import annotations

from lab.settings import AxisQuantity, Quantity, Settings

OFF_DIAGONAL = ("xy", "xz", "yx", "yz", "zx", "zy")


class GyroErrors(Settings):
    """Errors of the three gyros. Defaults: MEMSense AccelRate3D of the classic experiment."""

    noise_density = AxisQuantity(
        0.05, unit="°/s/√Hz", bounds=(0, 10), softbounds=(0, 0.5), step=0.001, label="White noise",
        doc="Density of the white rate noise (angle random walk).",
    )
    bias = AxisQuantity(
        0.0, unit="°/s", bounds=(-20, 20), softbounds=(-1, 1), step=0.01, label="Turn-on bias, given",
        doc="Known part of the turn-on bias; the filter is not told its value.",
    )
    bias_sigma = AxisQuantity(
        0.1, unit="°/s", bounds=(0, 20), softbounds=(0, 1), step=0.01, label="Turn-on bias, σ",
        doc="Standard deviation of the part of the turn-on bias that is drawn anew for each seed.",
    )
    instability = AxisQuantity(
        0.0, unit="°/h", bounds=(0, 36000), softbounds=(0, 360), step=1, label="Bias instability",
        doc="Standard deviation of the first-order Gauss-Markov bias.",
    )
    correlation_time = Quantity(
        300.0, unit="s", bounds=(0.1, 1e6), softbounds=(10, 3600), step=10, label="Correlation time",
        doc="Correlation time of the Gauss-Markov bias.",
    )
    scale_factor = AxisQuantity(
        0.0, unit="%", bounds=(-50, 50), softbounds=(-2, 2), step=0.01, label="Scale factor error",
        doc="Relative error of the scale factor.",
    )
    misalignment = AxisQuantity(
        0.0, unit="°", axes=OFF_DIAGONAL, bounds=(-20, 20), softbounds=(-2, 2), step=0.01, label="Misalignment",
        doc="Off-diagonal elements of M: 'xy' is what the x sensor feels of the y axis.",
    )
    range = Quantity(
        150.0, unit="°/s", bounds=(1, 10000), softbounds=(10, 1000), step=10, label="Range",
        doc="The output saturates beyond plus and minus this rate.",
    )


class AccelerometerErrors(Settings):
    """Errors of the three accelerometers. Defaults: MEMSense AccelRate3D of the classic experiment."""

    noise_density = AxisQuantity(
        (35.0, 65.0, 35.0), unit="µg/√Hz", bounds=(0, 10000), softbounds=(0, 500), step=1, label="White noise",
        doc="Density of the white specific-force noise (velocity random walk).",
    )
    bias = AxisQuantity(
        0.0, unit="mg", bounds=(-500, 500), softbounds=(-20, 20), step=0.1, label="Turn-on bias, given",
        doc="Known part of the turn-on bias; the filter is not told its value.",
    )
    bias_sigma = AxisQuantity(
        2.0, unit="mg", bounds=(0, 500), softbounds=(0, 20), step=0.1, label="Turn-on bias, σ",
        doc="Standard deviation of the part of the turn-on bias that is drawn anew for each seed.",
    )
    instability = AxisQuantity(
        0.0, unit="mg", bounds=(0, 100), softbounds=(0, 2), step=0.01, label="Bias instability",
        doc="Standard deviation of the first-order Gauss-Markov bias.",
    )
    correlation_time = Quantity(
        300.0, unit="s", bounds=(0.1, 1e6), softbounds=(10, 3600), step=10, label="Correlation time",
        doc="Correlation time of the Gauss-Markov bias.",
    )
    scale_factor = AxisQuantity(
        0.0, unit="%", bounds=(-50, 50), softbounds=(-2, 2), step=0.01, label="Scale factor error",
        doc="Relative error of the scale factor.",
    )
    misalignment = AxisQuantity(
        0.0, unit="°", axes=OFF_DIAGONAL, bounds=(-20, 20), softbounds=(-2, 2), step=0.01, label="Misalignment",
        doc="Off-diagonal elements of M: 'xy' is what the x sensor feels of the y axis.",
    )
    range = Quantity(
        10.0, unit="g", bounds=(1, 1000), softbounds=(2, 50), step=1, label="Range",
        doc="The output saturates beyond plus and minus this specific force.",
    )
