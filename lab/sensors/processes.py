"""Processes: random processes in time, of unit size, made from standard normal draws.

References
----------
IEEE Std 952-1997, *Specification Format Guide and Test Procedure for Single-Axis Interferometric Fiber Optic
Gyros*, annex C; N. J. Kasdin, *Discrete Simulation of Colored Noise and Stochastic Processes and 1/f^α Power
Law Noise Generation*, Proc. IEEE 83 (1995); P. D. Groves, *Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems*, 2nd ed. (cited as Groves).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from lab.base.arrays import FloatArray


def gauss_markov(
    start: FloatArray, draws: FloatArray, decay: float, before: FloatArray | None = None
) -> FloatArray:
    """Return first-order Gauss-Markov processes (n, k) of unit variance (Groves 4.19).

    The exact discretisation, started in its stationary distribution, or gone on with after its last sample.

    Parameters
    ----------
    start : (k,) array
        Standard normal draws of the first sample.
    draws : (n, k) array
        Standard normal draws that drive the others; the first row is not used.
    decay
        Correlation of one sample with the next, exp(−Δt / correlation time).
    before : (k,) array or None
        Last sample of the piece before; then `start` is not used, and the first row of `draws` is.
    """
    drive = np.sqrt(1 - decay**2) * draws
    if before is None:
        drive[:1] = start
        before = np.zeros(draws.shape[1])
    # With its full name, scipy.signal is imported only at its first use; the import takes a third of a
    # second.
    process, _ = scipy.signal.lfilter([1.0], [1.0, -decay], drive, axis=0, zi=[decay * before])
    return np.asarray(process)


def flicker(draws: FloatArray, axis: int = 0) -> FloatArray:
    """Return 1/f noise (n, 3) whose coefficient of bias instability B (IEEE 952) is 1.

    White noise integrated to order one half, (1 − z⁻¹)^(−1/2), by convolution with the coefficients of this
    filter (Kasdin, eq. 104 with α = 1). Its two-sided spectral density Δt / (2 sin π f Δt) is B² / (2π f)
    below the rate of the samples, and does not depend on that rate. The process starts from zero: the turn-on
    bias covers its past.

    Parameters
    ----------
    draws : (n, 3) array
        Standard normal draws.
    axis
        The axis of time: the last of an array (…, n), or the first.
    """
    samples = draws.shape[axis]
    if not samples:
        return draws
    size, response = _flicker_response(samples)
    spectrum = scipy.fft.rfft(draws, size, axis=axis)
    spectrum *= response if axis else response[:, None]
    whole = np.asarray(scipy.fft.irfft(spectrum, size, axis=axis))
    return whole[..., :samples] if axis else whole[:samples]


@lru_cache(maxsize=2)
def _flicker_response(samples: int) -> tuple[int, NDArray[np.complex128]]:
    """Return the length of the transform for some samples, and the spectrum of the filter of `flicker`."""
    k = np.arange(1.0, samples)
    size = int(scipy.fft.next_fast_len(2 * samples, real=True))
    response = np.concatenate(([1.0], np.cumprod((k - 0.5) / k)))
    return size, np.asarray(scipy.fft.rfft(response, size))


class Flicker:
    """The process of `flicker` piece by piece, in bounded memory.

    The coefficients of the filter are a mixture of geometric sequences (Beta integral):
    h_k = (1/π) ∫ x^(k − 1/2) (1 − x)^(−1/2) dx from 0 to 1. With x = 1 / (1 + e^(−u)), the trapezoidal rule
    converges exponentially, and each of its nodes is a recursion with one value to keep. The coefficients
    agree with those of `flicker` to 10⁻⁶ of the largest over 10⁹ samples (58 days at 200 Hz).
    """

    def __init__(self) -> None:
        x = 1 / (1 + np.exp(-_NODES))
        # 1 − x without the cancellation next to 1
        weight = _SPACING / np.pi * np.sqrt(x / (1 + np.exp(_NODES)))
        powers = x ** np.arange(_AT_ONCE + 1)[:, None]
        self._response = scipy.linalg.toeplitz(powers[:-1] @ weight, np.zeros(_AT_ONCE))
        self._shown = powers[1:] * weight
        self._decay = powers[:, :, None]
        self._into = np.ascontiguousarray(powers[-2::-1].T)
        self._values = np.zeros((x.size, 3))

    def following(self, draws: FloatArray) -> FloatArray:
        """Return the next samples (n, 3) for as many standard normal draws."""
        found = np.empty(draws.shape)
        for first in range(0, len(draws), _AT_ONCE):
            new = draws[first : first + _AT_ONCE]
            n = len(new)
            found[first : first + n] = self._shown[:n] @ self._values + self._response[:n, :n] @ new
            self._values = self._decay[n] * self._values + self._into[:, _AT_ONCE - n :] @ new
        return found


_AT_ONCE = 64
"""Samples that are computed together: more than a piece of a live flight at 200 Hz."""
_SPACING = 0.5
"""Spacing of the nodes: the error of the rule, exp(−π² / spacing), is 3·10⁻⁹."""
_NODES = np.arange(-30.0, 50.0, _SPACING)
"""Nodes u: below them x^k has no part of 10⁻⁶ in h_0, and above none in the coefficients up to k = 10⁹."""


def random_walk(draws: FloatArray, before: FloatArray | None = None) -> FloatArray:
    """Return a random walk (n, 3) that starts at zero and grows by one draw with each sample.

    Parameters
    ----------
    draws : (n, 3) array
        Standard normal draws.
    before : (3,) array or None
        Last sample of the piece before, with which it goes on.
    """
    if before is None:
        return np.cumsum(draws, axis=0)
    return np.asarray(np.cumsum(np.concatenate((before[None], draws)), axis=0)[1:])


def settled_lag(start: float, cutoff: float) -> float:
    """Return the state of a first-order lag, for `apply_lag`, in steady state.

    Parameters
    ----------
    start
        Constant input before the first interval, in units of the input.
    cutoff
        As of `apply_lag`.
    """
    return float(-np.expm1(-cutoff) / cutoff * start)


def apply_lag(inputs: FloatArray, state: float, cutoff: float) -> tuple[FloatArray, float]:
    """Return the means of a signal over each sample interval after a first-order lag, and its next state.

    Exact for a signal that is constant within the intervals, and unity for constants. A cutoff far above the
    rate of the samples changes nothing.

    Parameters
    ----------
    inputs : (n,) array
        Means of the input over each interval.
    state
        State before the first interval: that of `settled_lag`, or that after the piece of the signal before.
    cutoff
        Angular frequency at which the gain is 1/√2, times the length of the interval [rad].
    """
    decay = np.exp(-cutoff)
    # The output runs from its last value y towards x: its mean is x + (y − x) (1 − exp(−ωΔt)) / (ωΔt).
    held = -np.expm1(-cutoff) / cutoff
    output, after = scipy.signal.lfilter([1 - held, held - decay], [1.0, -decay], inputs, zi=[state])
    return np.asarray(output), float(after[0])
