"""True motion: the truth of a simulated run, and its means over the windows in which sensors are tested.

The noise of a sensor is tested with sums over windows of `WINDOW`, its bias with longer ones on long flights.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.rotation import C_nb_from_euler
from lab.motion.truth.trajectory import Truth

AT_ONCE = 2**16
"""Number of samples that are averaged in one block."""
WINDOW = 1.0
"""Summation time of the sensors' noise [s]."""
LONGEST = 256
"""Most windows for the test of a bias process; longer flights have longer windows."""
ENDS = 20
"""Samples of a window for each at either end by which its slope is taken: 5 % of it, so that their mean is
calmer than one sample and still at the end."""
TURNING = 0.5
"""Time between the attitudes with which the rate of the Earth is averaged over a window [s]: at 20 °/s, a
turn of 10°, whose chord is 0.1 % shorter than its arc."""


class Reference(NamedTuple):
    """The truth of a simulated run.

    Attributes
    ----------
    truth : Truth
        Truth at all samples.
    bias : (n + 1, 6) array
        True gyro and accelerometer biases at all samples [rad/s], [m/s²].
    dtheta, dvelocity : (n, 3) arrays
        True increments [rad], [m/s].
    scale : (n + 1, 6) array
        True scale factor errors of gyros and accelerometers; needed for filters with 21 states only.
    temperature : (n,) array
        Temperature of the IMU in each interval [°C]; None if constant.
    saturated : (2,) tuple
        Numbers of saturated values of gyros and of accelerometers.
    bias_drive : (6,) array
        Drive of the gyro and accelerometer biases [rad²/s³], [(m/s²)²/s] in a filter matched to the sensors;
        None if unknown.
    hidden : (6,) array
        Longest period of changes of the biases that a matched filter does not follow, because the fixes hide
        them (`belief.hidden_by_fixes`) [s]; None if it follows all.
    further : (n + 1, k) array
        True values of the further states of the filter (`navigation.blocks`), if it has any.
    of_states : (n, 6) array
        What the errors of the IMU for which the filter has further states, such as misalignments, add to the
        output of gyros and accelerometers [rad/s], [m/s²]; None if it has none.
    flight : Truth
        Truth at all samples, if `truth` has some of them only; None if it has all.
    """

    truth: Truth
    bias: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    scale: FloatArray | None = None
    temperature: FloatArray | None = None
    saturated: tuple[int, int] = (0, 0)
    bias_drive: FloatArray | None = None
    further: FloatArray | None = None
    of_states: FloatArray | None = None
    flight: Truth | None = None
    hidden: FloatArray | None = None

    @property
    def whole(self) -> Truth:
        """The truth at all samples, between which it may be interpolated."""
        return self.truth if self.flight is None else self.flight


class Exact(NamedTuple):
    """The true motion, averaged over windows.

    Attributes
    ----------
    dt : float
        Time between samples [s].
    width : int
        Number of samples in a window.
    moved : (windows, 6) array
        Mean rates and specific forces [rad/s], [m/s²].
    fall : (windows, 6) array
        What they lose per second, by the samples at the ends of each window.
    temperature : (windows,) array
        Mean temperature [°C]; zero if it is constant.
    earth : (windows, 6) array
        Mean rate of the Earth [rad/s] and its Coriolis acceleration 2 ω_ie × v [m/s²], in b.
    """

    dt: float
    width: int
    moved: FloatArray
    fall: FloatArray
    temperature: FloatArray
    earth: FloatArray


def exact_motion_in_windows(reference: Reference, time: FloatArray) -> tuple[Exact, Exact]:
    """Return the true motion in the windows of the tests of the noise, and of the bias; see `exact`."""
    window = max(WINDOW, float(time[-1] - time[0]) / LONGEST)
    short = exact(reference, time)
    return short, short if window == WINDOW else exact(reference, time, window)


def exact(reference: Reference, time: FloatArray, window: float = 0.0) -> Exact:
    """Return the true motion, averaged over windows.

    Parameters
    ----------
    reference
        The truth; its biases and scale factors have no effect.
    time : (n + 1,) array
        Times of the IMU samples [s].
    window
        Length of the windows [s]; 0 for that of the test of the noise.
    """
    dt, samples = float(time[-1] - time[0]) / (time.size - 1), reference.dtheta.shape[0]
    width = min(max(1, round((window or WINDOW) / dt)), samples)
    count, few = samples // width, max(1, width // ENDS)
    moved, fall = np.empty((count, 6)), np.empty((count, 6))
    for sensor, true in enumerate((reference.dtheta, reference.dvelocity)):
        own = slice(3 * sensor, 3 * sensor + 3)
        moved[:, own] = means_over_windows(true.__getitem__, count, width) / dt
        first, last = (
            np.mean([true[at : count * width : width] for at in ends], axis=0, dtype=np.float64) / dt
            for ends in (range(few), range(width - few, width))
        )
        fall[:, own] = (first - last) / (width * dt)
    temperature = reference.temperature
    warm = (
        np.zeros(count) if temperature is None else means_over_windows(temperature.__getitem__, count, width)
    )
    return Exact(dt, width, moved, fall, warm, _of_earth(reference.whole, count, width, dt))


def _of_earth(truth: Truth, count: int, width: int, dt: float) -> FloatArray:
    """Return rate and Coriolis acceleration of the Earth in b, averaged over windows (count, 6)."""
    steps = max(1, round(width * dt / TURNING))
    at = np.round(np.arange(count * steps + 1) * (width / steps)).astype(np.int64)
    C_nb = C_nb_from_euler(truth.euler[at])
    sine, cosine = np.sin(truth.latitude[at]), np.cos(truth.latitude[at])
    omega_ie_n = earth.RATE * np.stack((cosine, np.zeros_like(sine), -sine), axis=-1)
    coriolis_n = 2 * np.cross(omega_ie_n, truth.velocity_n[at])
    both = np.concatenate([np.einsum("kji,kj->ki", C_nb, one) for one in (omega_ie_n, coriolis_n)], axis=1)
    return np.asarray((0.5 * (both[1:] + both[:-1])).reshape(count, steps, 6).mean(axis=1))


def means_over_windows(values: Callable[[slice], FloatArray], count: int, width: int) -> FloatArray:
    """Return the means over `count` windows of values, which are computed in blocks of samples.

    Constant ones are not summed.
    """
    means, at_once = [], max(AT_ONCE // width, 1)
    for first in range(0, count, at_once):
        last = min(first + at_once, count)
        part = values(slice(first * width, last * width))
        if part.strides[0] == 0:
            means.append(np.asarray(part[::width], dtype=np.float64))
            continue
        # Ten times faster than the mean of an array (windows, width, 3), whose inner loop has three rounds.
        starts = np.arange(0, part.shape[0], width)
        means.append(np.add.reduceat(part, starts, axis=0, dtype=np.float64) / width)
    return np.concatenate(means)


def window_means(values: FloatArray, true: Exact) -> FloatArray:
    """Return the means (windows, …) of values (n, …) in the windows of the true motion."""
    return means_over_windows(values.__getitem__, true.moved.shape[0], true.width)
