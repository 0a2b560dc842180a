"""Processes: random processes in time, of unit size, made from standard normal draws.

References
----------
IEEE Std 952-1997, *Specification Format Guide and Test Procedure for Single-Axis Interferometric Fiber Optic
Gyros*, annex C; N. J. Kasdin, *Discrete Simulation of Colored Noise and Stochastic Processes and 1/f^α Power
Law Noise Generation*, Proc. IEEE 83 (1995); P. D. Groves, *Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems*, 2nd ed. (cited as Groves).
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def gauss_markov(start: FloatArray, draws: FloatArray, decay: float) -> FloatArray:
    """Return a first-order Gauss-Markov process (n, 3) of unit variance (Groves 4.19).

    The exact discretisation, started in its stationary distribution.

    Parameters
    ----------
    start : (3,) array
        Standard normal draws of the first sample.
    draws : (n, 3) array
        Standard normal draws that drive the others; the first row is not used.
    decay
        Correlation of one sample with the next, exp(−Δt / correlation time).
    """
    drive = np.sqrt(1 - decay**2) * draws
    drive[:1] = start
    # With its full name, scipy.signal is imported only at its first use; the import takes a third of a
    # second.
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -decay], drive, axis=0))


def flicker(draws: FloatArray) -> FloatArray:
    """Return 1/f noise (n, 3) whose coefficient of bias instability B (IEEE 952) is 1.

    White noise integrated to order one half, (1 − z⁻¹)^(−1/2), by convolution with the coefficients of this
    filter (Kasdin, eq. 104 with α = 1). Its two-sided spectral density Δt / (2 sin π f Δt) is B² / (2π f)
    below the rate of the samples, and does not depend on that rate. The process starts from zero: the turn-on
    bias covers its past.

    Parameters
    ----------
    draws : (n, 3) array
        Standard normal draws.
    """
    samples = draws.shape[0]
    if not samples:
        return draws
    k = np.arange(1.0, samples)
    response = np.concatenate(([1.0], np.cumprod((k - 0.5) / k)))
    size = scipy.fft.next_fast_len(2 * samples, real=True)
    spectrum = scipy.fft.rfft(draws, size, axis=0) * scipy.fft.rfft(response, size)[:, None]
    return np.asarray(scipy.fft.irfft(spectrum, size, axis=0)[:samples])


def random_walk(draws: FloatArray) -> FloatArray:
    """Return a random walk (n, 3) that starts at zero and grows by one draw with each sample.

    Parameters
    ----------
    draws : (n, 3) array
        Standard normal draws.
    """
    return np.cumsum(draws, axis=0)


def first_order_lag(inputs: FloatArray, start: float, cutoff: float) -> FloatArray:
    """Return the means of a signal over each sample interval after a first-order lag.

    Exact for a signal that is constant within the intervals, and unity for constants. A cutoff far above the
    rate of the samples changes nothing.

    Parameters
    ----------
    inputs : (n,) array
        Means of the input over each interval.
    start
        Constant input before the first interval, at which the lag is in steady state, in units of the input.
    cutoff
        Angular frequency at which the gain is 1/√2, times the length of the interval [rad].
    """
    decay = np.exp(-cutoff)
    # The output runs from its last value y towards x: its mean is x + (y − x) (1 − exp(−ωΔt)) / (ωΔt).
    held = -np.expm1(-cutoff) / cutoff
    before = held - decay
    output, _ = scipy.signal.lfilter([1 - held, before], [1.0, -decay], inputs, zi=[held * start])
    return np.asarray(output)
