"""Static interval: mean rate and specific force of a device at rest, and the net angle of a turn by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.analysis.rest import OFF_GRAVITY
from lab.base.arrays import FloatArray
from lab.base.parameters.counted import count_noun
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.streams.live_log import usable_imu
from lab.motion.frames import earth

HELD: Final = 2.0
"""Time for which a device must be still [s]: a mean over it has a tenth of the noise of a consumer sensor."""
BLOCK: Final = 0.25
"""Time over which samples are averaged before they are compared [s]: it averages noise out, and hands shake
slower."""
_EACH: Final = 4
"""Fewest samples of a block, on average: their mean has half the noise of a sample."""
_SHORT: Final = 1e-3
"""Part of `HELD` by which a stretch may be too short, besides an interval: time stamps rounded to 1 ms at
both ends."""
RATE_CHANGE: Final = math.radians(3.0)
"""Largest change of the mean rate between blocks of a still device [rad/s]. The noise of a consumer card
makes 0.3 °/s of it, a calm hand 1 °/s, a slow turn by hand 20 °/s."""
FORCE_CHANGE: Final = 0.5
"""Largest change of the mean specific force between blocks of a still device [m/s²]: as in
`lab.analysis.rest`; a tilt of 3°."""
OTHER_FACE: Final = math.radians(45.0)
"""Angle between the specific force of a still stretch and that of the last block from which the device shows
another face [rad]. The jolt of a pressed button averages out within a block."""
TURNED: Final = math.radians(30.0)
"""Smallest net angle of a turn [rad]: a gyro bias of 1 °/s makes 6° in a turn of 6 s."""


class AxisCheckError(ValueError):
    """A stretch of samples cannot be used, or the stretches contradict each other; the message says why."""


@dataclass(frozen=True, eq=False)
class StaticInterval:
    """Means over a stretch in which a device was still, in the axes of the device.

    Attributes
    ----------
    rate, rate_sigma : (3,) arrays
        Mean rate and the σ of its noise [rad/s].
    force, force_sigma : (3,) arrays
        Mean specific force and the σ of its noise [m/s²].
    duration : float
        Length of the stretch [s].
    """

    rate: FloatArray
    rate_sigma: FloatArray
    force: FloatArray
    force_sigma: FloatArray
    duration: float

    @property
    def gyro_bias_sigma(self) -> FloatArray:
        """σ (3,) of the mean rate as a gyro bias [rad/s].

        The gyros also measure the Earth's rate. Its direction in the device is unknown, so each axis has the
        Earth's rate/√3 as a further σ.
        """
        return np.asarray(np.hypot(self.rate_sigma, earth.RATE / math.sqrt(3)))

    @property
    def gyro_sentence(self) -> str:
        """The gyro biases in words, in the axes of the device."""
        bias, sigma = np.degrees(self.rate), np.degrees(self.gyro_bias_sigma)
        axes = ", ".join(f"{axis} {b:+.4f} ± {s:.4f}" for axis, b, s in zip("xyz", bias, sigma, strict=True))
        axes = axes.replace("-", "−")
        return (
            f"Gyro biases of the device's axes: {axes} °/s (1 σ, with {math.degrees(earth.RATE):.4f} °/s of "
            "the Earth's rate in an unknown direction)."
        )


def static_interval(rows: NDArray[np.void]) -> StaticInterval:
    """Return the means over the last `HELD` seconds in which a device was still.

    Parameters
    ----------
    rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples in the axes of the device.

    Raises
    ------
    AxisCheckError
        If the device was not still for so long or was turned to another face after it, or if its specific
        force is not that of gravity.
    """
    rows = rows[usable_imu(rows)]
    time = rows["time"]
    count = round(HELD / BLOCK)
    if rows.size < _EACH * count or time[-1] - time[0] < HELD * (1 - _SHORT) - np.median(np.diff(time)):
        raise AxisCheckError(
            f"{count_noun(rows.size, 'sample')} came, too few; accepted are {HELD:g} s, with "
            f"{_EACH / BLOCK:g} "
            "samples a second or more"
        )
    values = np.concatenate((rows["rate"], rows["force"]), axis=1)
    step = float(time[-1] - time[0]) / (rows.size - 1)
    size = max(round(BLOCK / step), 1)
    blocks = rows.size // size
    count = min(count, blocks)
    values = values[rows.size - blocks * size :]
    means = values.reshape(blocks, size, 6).mean(axis=1)
    windows = np.lib.stride_tricks.sliding_window_view(means, count, axis=0)
    change = np.ptp(windows, axis=2)
    rate_change, force_change = change[:, :3].max(axis=1), change[:, 3:].max(axis=1)
    still = np.flatnonzero((rate_change <= RATE_CHANGE) & (force_change <= FORCE_CHANGE))
    if not still.size:
        raise AxisCheckError(
            f"The device was not still for {HELD:g} s: its rate changed by {np.degrees(rate_change[-1]):.1f} "
            f"°/s and its specific force by {force_change[-1]:.2f} m/s²; accepted are "
            f"{np.degrees(RATE_CHANGE):g} °/s and {FORCE_CHANGE:g} m/s²"
        )
    first = int(still[-1])
    kept = values[first * size : (first + count) * size]
    mean = kept.mean(axis=0)
    sigma = np.std(means[first : first + count], axis=0, ddof=1) / math.sqrt(count)
    force = float(np.linalg.norm(mean[3:]))
    now = means[-1, 3:]
    if now @ mean[3:] < math.cos(OTHER_FACE) * force * np.linalg.norm(now):
        raise AxisCheckError(
            f"The device was turned less than {HELD:g} s ago; accepted are {HELD:g} s of stillness in the "
            "new position"
        )
    if abs(force / STANDARD_GRAVITY - 1) > OFF_GRAVITY:
        hint = "; this looks like g" if abs(force - 1) < OFF_GRAVITY else ""
        raise AxisCheckError(
            f"The mean specific force is {force:.2f} m/s²{hint}; accepted is that of a still device, "
            f"{STANDARD_GRAVITY:.1f} m/s² within {100 * OFF_GRAVITY:g} %"
        )
    return StaticInterval(mean[:3], sigma[:3], mean[3:], sigma[3:], count * size * step)


def net_turn(rows: NDArray[np.void], bias: FloatArray | None = None) -> FloatArray:
    """Return the net angle (3,) of a turn about one axis, in the axes of the device [rad].

    Parameters
    ----------
    rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples of the whole turn, in the axes of the device.
    bias : (3,) array
        Gyro biases in the axes of the device, from a stretch at rest; zero if they are left out [rad/s].

    Raises
    ------
    AxisCheckError
        If the net angle is below `TURNED`.
    """
    rows = rows[usable_imu(rows)]
    if rows.size < 2:
        raise AxisCheckError(f"{count_noun(rows.size, 'sample')} came, too few; accepted is the whole turn")
    rates = rows["rate"] - (np.zeros(3) if bias is None else bias)
    angle = np.trapezoid(rates, rows["time"], axis=0)
    size = float(np.linalg.norm(angle))
    if size < TURNED:
        raise AxisCheckError(
            f"The device ended {np.degrees(size):.0f}° from where it began; accepted is a turn by "
            f"{np.degrees(TURNED):g}° or more, without the way back"
        )
    return np.asarray(angle)
