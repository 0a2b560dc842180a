"""IMU: what real inertial sensors make of the true rates and specific forces (the truth side).

x_meas = (I + M) (x_true + b) + ν, then the range, applied to the increments of each sample; see Groves,
*Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 4.4, eqs.
4.16-4.18. b is the turn-on bias plus a first-order Gauss-Markov process; ν is white with the given density.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from lab.sensors.draws import unit_draws
from lab.settings import AxisQuantity, Quantity, Settings
from lab.units import si

FloatArray = NDArray[np.float64]

OFF_DIAGONAL = ("xy", "xz", "yx", "yz", "zx", "zy")


class GyroErrors(Settings):
    """Errors of the three gyros. Defaults: MEMSense AccelRate3D of the classic experiment."""

    noise_density = AxisQuantity(
        0.05,
        unit="°/s/√Hz",
        bounds=(0, 10),
        softbounds=(0, 0.5),
        step=0.001,
        label="White noise",
        doc="Density of the white rate noise (angle random walk).",
    )
    bias = AxisQuantity(
        0.0,
        unit="°/s",
        bounds=(-20, 20),
        softbounds=(-1, 1),
        step=0.01,
        label="Turn-on bias, given",
        doc="Known part of the turn-on bias; the filter is not told its value.",
    )
    bias_sigma = AxisQuantity(
        0.1,
        unit="°/s",
        bounds=(0, 20),
        softbounds=(0, 1),
        step=0.01,
        label="Turn-on bias, σ",
        doc="Standard deviation of the part of the turn-on bias that is drawn anew for each seed.",
    )
    instability = AxisQuantity(
        0.0,
        unit="°/h",
        bounds=(0, 36000),
        softbounds=(0, 360),
        step=1,
        label="Bias instability",
        doc="Standard deviation of the first-order Gauss-Markov bias.",
    )
    correlation_time = Quantity(
        300.0,
        unit="s",
        bounds=(0.1, 1e6),
        softbounds=(10, 3600),
        step=10,
        label="Correlation time",
        doc="Correlation time of the Gauss-Markov bias.",
    )
    scale_factor = AxisQuantity(
        0.0,
        unit="%",
        bounds=(-50, 50),
        softbounds=(-2, 2),
        step=0.01,
        label="Scale factor error",
        doc="Relative error of the scale factor.",
    )
    misalignment = AxisQuantity(
        0.0,
        unit="°",
        axes=OFF_DIAGONAL,
        bounds=(-20, 20),
        softbounds=(-2, 2),
        step=0.01,
        label="Misalignment",
        doc="Off-diagonal elements of M: 'xy' is what the x sensor feels of the y axis.",
    )
    range = Quantity(
        150.0,
        unit="°/s",
        bounds=(1, 10000),
        softbounds=(10, 1000),
        step=10,
        label="Range",
        doc="The output saturates beyond plus and minus this rate.",
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
        doc="Density of the white specific-force noise (velocity random walk).",
    )
    bias = AxisQuantity(
        0.0,
        unit="mg",
        bounds=(-500, 500),
        softbounds=(-20, 20),
        step=0.1,
        label="Turn-on bias, given",
        doc="Known part of the turn-on bias; the filter is not told its value.",
    )
    bias_sigma = AxisQuantity(
        2.0,
        unit="mg",
        bounds=(0, 500),
        softbounds=(0, 20),
        step=0.1,
        label="Turn-on bias, σ",
        doc="Standard deviation of the part of the turn-on bias that is drawn anew for each seed.",
    )
    instability = AxisQuantity(
        0.0,
        unit="mg",
        bounds=(0, 100),
        softbounds=(0, 2),
        step=0.01,
        label="Bias instability",
        doc="Standard deviation of the first-order Gauss-Markov bias.",
    )
    correlation_time = Quantity(
        300.0,
        unit="s",
        bounds=(0.1, 1e6),
        softbounds=(10, 3600),
        step=10,
        label="Correlation time",
        doc="Correlation time of the Gauss-Markov bias.",
    )
    scale_factor = AxisQuantity(
        0.0,
        unit="%",
        bounds=(-50, 50),
        softbounds=(-2, 2),
        step=0.01,
        label="Scale factor error",
        doc="Relative error of the scale factor.",
    )
    misalignment = AxisQuantity(
        0.0,
        unit="°",
        axes=OFF_DIAGONAL,
        bounds=(-20, 20),
        softbounds=(-2, 2),
        step=0.01,
        label="Misalignment",
        doc="Off-diagonal elements of M: 'xy' is what the x sensor feels of the y axis.",
    )
    range = Quantity(
        10.0,
        unit="g",
        bounds=(1, 1000),
        softbounds=(2, 50),
        step=1,
        label="Range",
        doc="The output saturates beyond plus and minus this specific force.",
    )


class Measured(NamedTuple):
    """What a triad of sensors put out.

    Attributes
    ----------
    increments : (n, 3) array
        Integrals of the measured quantity over each sample interval [rad] or [m/s].
    bias : (n, 3) array
        True bias in each interval [rad/s] or [m/s²].
    saturated : int
        Number of values that met the end of the range.
    """

    increments: FloatArray
    bias: FloatArray
    saturated: int


class ImuDraws(NamedTuple):
    """Unit draws of a triad: turn-on bias (3,), start (3,) and drive (n, 3) of instability, noise (n, 3)."""

    bias: FloatArray
    start: FloatArray
    drive: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, seed: int, sensor: str, samples: int, *, instability: bool) -> ImuDraws:
        """Draw for one triad, named by `sensor`; the drive of the instability only where there is one."""
        return cls(
            unit_draws(seed, f"{sensor}.bias", (3,)),
            unit_draws(seed, f"{sensor}.instability.start", (3,)),
            unit_draws(seed, f"{sensor}.instability", (samples if instability else 0, 3)),
            unit_draws(seed, f"{sensor}.noise", (samples, 3)),
        )


def measure(
    ideal: FloatArray, dt: float, errors: GyroErrors | AccelerometerErrors, draws: ImuDraws
) -> Measured:
    """Return what a triad with the given errors puts out.

    Parameters
    ----------
    ideal : (n, 3) array
        True increments over each sample interval [rad] or [m/s].
    dt
        Length of the intervals [s].
    errors
        The errors of the triad.
    draws
        Unit draws for n samples, with the drive of the instability if `errors` has any.
    """
    bias = turn_on_bias(errors, draws) + instability(errors, draws, dt)
    bias = np.broadcast_to(bias, ideal.shape)
    M = cross_coupling(errors)
    increments = (ideal + bias * dt) @ (np.eye(3) + M).T if M.any() else ideal + bias * dt
    increments += si(errors, "noise_density") * np.sqrt(dt) * draws.noise
    limit = float(si(errors, "range")) * dt
    saturated = int(np.count_nonzero(np.abs(increments) > limit))
    return Measured(np.clip(increments, -limit, limit, out=increments), bias, saturated)


def turn_on_bias(errors: GyroErrors | AccelerometerErrors, draws: ImuDraws) -> FloatArray:
    """Return the constant part of the bias (3,): given plus drawn [rad/s] or [m/s²]."""
    return si(errors, "bias") + si(errors, "bias_sigma") * draws.bias


def instability(errors: GyroErrors | AccelerometerErrors, draws: ImuDraws, dt: float) -> FloatArray:
    """Return the first-order Gauss-Markov part of the bias, (n, 3), or (3,) zeros where there is none.

    The exact discretisation, started in its stationary distribution (Groves 4.19).
    """
    sigma = si(errors, "instability")
    if not sigma.any():
        return np.zeros(3)
    decay = float(np.exp(-dt / si(errors, "correlation_time")))
    drive = np.sqrt(1 - decay**2) * draws.drive
    drive[0] = draws.start
    # By its full name: scipy.signal is imported at its first use only, which takes a third of a second.
    return sigma * scipy.signal.lfilter([1.0], [1.0, -decay], drive, axis=0)


def cross_coupling(errors: GyroErrors | AccelerometerErrors) -> FloatArray:
    """Return M (3, 3): scale factor errors on the diagonal, misalignments [rad] off it."""
    M = np.diag(si(errors, "scale_factor"))
    for name, value in zip(OFF_DIAGONAL, si(errors, "misalignment"), strict=True):
        M["xyz".index(name[0]), "xyz".index(name[1])] = value
    return M
