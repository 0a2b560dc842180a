"""Vibration: what a vehicle shakes an IMU with, from the spectrum of its output in motion.

An IMU in a vehicle has more noise than on a table. Vibration is one cause, and the spectrum shows it: its
size, and the frequency of an engine or a rotor.

References
----------
P. D. Welch, *The Use of Fast Fourier Transform for the Estimation of Power Spectra*, IEEE Transactions on
Audio and Electroacoustics 15 (1967): averages of the spectra of overlapping segments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from lab.base.arrays import FloatArray

SLOWEST = 5.0
"""Lowest frequency that counts as vibration [Hz]: vehicles turn and accelerate more slowly."""
LEAST_BAND = 2.0
"""Least ratio of half of the sampling rate to `SLOWEST` at which vibration is looked for."""
SEGMENT = 512
"""Samples in a segment: at 100 Hz, a line is known within 0.2 Hz."""
LINE = 5.0
"""Power of a line in that of the median of the frequencies within `BESIDE`: chance makes 2 of the 20 or more
segments of a minute."""
BESIDE = 24
"""Frequencies on each side of one with which it is compared."""
WIDTH = 2
"""Frequencies on each side of a line over which the window spreads it."""
LINE_PART = 0.1
"""Least part of the power above `SLOWEST` that a line must hold to be named."""
LARGER = 2.0
"""Ratio of the vibration in motion to that at rest from which it is said to be a cause."""


class Vibration(NamedTuple):
    """The vibration in the output of a triad.

    Attributes
    ----------
    rms : float
        Root mean square above `SLOWEST`, of the three axes together [rad/s] or [m/s²].
    highest : float
        Half of the sampling rate [Hz]; faster vibration shows at lower frequencies.
    line : float
        Frequency of the strongest line [Hz]; NaN if none is strong enough.
    part : float
        Part of the power that the line holds.
    """

    rms: float
    highest: float
    line: float
    part: float


def vibration(rates: FloatArray, dt: float) -> Vibration | None:
    """Return the vibration in the output of a triad; None if its samples are too slow to show it.

    Parameters
    ----------
    rates : (n, 3) array
        Rates [rad/s] or specific forces [m/s²], evenly spaced.
    dt
        Time from sample to sample [s].
    """
    highest = 0.5 / dt
    if highest < LEAST_BAND * SLOWEST or len(rates) < SEGMENT:
        return None
    frequencies, spectra = scipy.signal.welch(rates, 1 / dt, "hann", SEGMENT, axis=0)
    power = spectra.sum(axis=1)
    fast = frequencies >= SLOWEST
    frequencies, power, step = frequencies[fast], power[fast], frequencies[1] - frequencies[0]
    whole = float(power.sum())
    if not whole > 0:
        return Vibration(0.0, highest, np.nan, 0.0)
    # The mirrored ends give the first and the last frequencies neighbours on both sides.
    mirrored = np.pad(power, BESIDE, mode="reflect" if power.size > BESIDE else "wrap")
    windows = np.lib.stride_tricks.sliding_window_view(mirrored, 2 * BESIDE + 1)
    at = int(np.argmax(power / np.maximum(np.median(windows, axis=1), np.finfo(float).tiny)))
    near = power[max(at - WIDTH, 0) : at + WIDTH + 1]
    part = float(near.sum()) / whole
    is_line = bool(power[at] > LINE * np.median(windows[at])) and part >= LINE_PART
    line = float(frequencies[at]) if is_line else np.nan
    return Vibration(float(np.sqrt(whole * step)), highest, line, part if is_line else 0.0)
