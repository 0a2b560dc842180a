"""Stream statistics: spectra, Allan deviations, innovations and drift of a stream, for the twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from lab.analysis import allan
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import held_out, outages
from lab.base.arrays import FloatArray
from lab.data.log.sensor_log import SensorLog
from lab.live.live_verdict import run_batch
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import TRIADS, SensorSuite

Average = Literal["mean", "median"]
"""How the spectra of pieces are averaged."""
LEAST_HZ: Final = 20.0
"""Lowest frequency at which noise is compared [Hz]. The mission Montréal has motion up to 15 Hz:
at 12.5 Hz, it is 28 times the noise of the default accelerometers."""
SEGMENT: Final = 2.0
"""Length of the pieces whose spectra are averaged [s]: lines 0.5 Hz apart are told apart."""
HIGHEST: Final = 0.98
"""End of the frequencies at which noise is compared, as a part of the highest: the median of the pieces there
is a third of that of white noise, since its density has one degree of freedom instead of two."""
LEAST_LINES: Final = 4
"""Fewest frequencies with a level of noise: in a minute at 100 Hz, its logarithm then has a σ of 0.04."""
NEIGHBOURS: Final = 15
"""Frequencies whose median a line must exceed: 7 Hz, over which the spectrum of a motion changes little."""
LEAST_FIXES: Final = 20
"""Fewest fixes for a comparison of innovations."""
SETTLING: Final = 20.0
"""Time after the start in which no fixes are withheld [s]: the filter still finds biases and heading."""
LEAST_OUTAGES: Final = 3
"""Fewest outages for a comparison of the drift: one or two depend on a single bias."""
AVERAGED: Final = (1.0, 10.0, 100.0)
"""Averaging times at which Allan deviations at rest are compared [s]."""
CLUSTERS: Final = 20
"""Fewest averaging times in a record: the deviation of white noise then has a spread of about 16 %."""


@dataclass(frozen=True)
class Spectrum:
    """Spectra of a stream: frequencies (k,) [Hz], and one-sided densities (k, 3) of each triad, SI units."""

    frequency: FloatArray
    density: dict[str, FloatArray]


@dataclass(frozen=True)
class StreamStatistics:
    """What is compared of a stream.

    Attributes
    ----------
    sizes : dict of float
        By name, quantities of size: their logarithms.
    correlation : float
        Correlation of successive innovations; NaN without enough fixes.
    spectrum : Spectrum
        Spectra.
    allan : dict of AllanDeviation
        Allan deviations of both triads, of motion and noise together.
    """

    sizes: dict[str, float]
    correlation: float
    spectrum: Spectrum
    allan: dict[str, allan.AllanDeviation]


def of_rest(rates: Mapping[str, FloatArray], dt: float) -> StreamStatistics:
    """Return the statistics of a record at rest: noise, lines and Allan deviations.

    Parameters
    ----------
    rates : mapping of (n, 3) arrays
        Rates [rad/s] and specific forces [m/s²], by triad.
    dt
        Time from sample to sample [s].
    """
    found = _of_rates(rates, dt)
    for triad, curve in found.allan.items():
        for tau in AVERAGED:
            if curve.tau[0] <= tau <= curve.samples * dt / CLUSTERS:
                at = [np.interp(np.log(tau), np.log(curve.tau), np.log(axis)) for axis in curve.deviation.T]
                found.sizes[f"{triad} deviation over {tau:g} s"] = float(np.mean(at))
    return found


def of_log(log: SensorLog, sensors: SensorSuite, navigator: NavigatorSettings) -> StreamStatistics:
    """Return the statistics of a stream with fixes: noise, lines, innovations, and drift across outages.

    Parameters
    ----------
    log
        The stream.
    sensors, navigator
        The assumptions of the filter.

    Raises
    ------
    MissionError, SettingError, ValueError
        If the stream cannot be navigated.
    """
    dt = float(np.median(np.diff(log.time)))
    found = _of_rates(dict(zip(TRIADS, log.rates, strict=True)), dt)
    result = run_batch(log, sensors, navigator)
    solution = result.solution_arrays
    used = solution.fix_sample >= 0
    correlation = float("nan")
    if used.sum() >= LEAST_FIXES:
        spread = np.sqrt(np.diagonal(solution.innovation_covariance[used], axis1=1, axis2=2))
        normed = solution.innovation[used] / spread
        found.sizes["innovation size"] = float(np.log(np.mean(normed**2)) / 2)
        correlation = float(np.sum(normed[1:] * normed[:-1]) / np.sum(normed**2))
    again = subject(result)
    masks = outages(again.stamps, again.span[0] + SETTLING, again.span[1])
    if len(masks) >= LEAST_OUTAGES:
        none = np.zeros(again.stamps.size, np.bool_)
        found.sizes["drift"] = float(np.log(held_out(again, result.experiment, masks, none).position_error))
    return StreamStatistics(found.sizes, correlation, found.spectrum, found.allan)


def _of_rates(rates: Mapping[str, FloatArray], dt: float) -> StreamStatistics:
    """Return noise and lines of both triads, with spectra and Allan deviations."""
    from scipy import ndimage  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    spectrum = compute_spectrum(rates, dt)
    sizes = {}
    high = (spectrum.frequency >= LEAST_HZ) & (spectrum.frequency < HIGHEST * spectrum.frequency[-1])
    for triad, density in spectrum.density.items():
        if high.sum() < LEAST_LINES:
            continue
        level = np.median(density[high], axis=0)
        sizes[f"{triad} noise"] = float(np.mean(np.log(level)) / 2)
        around = ndimage.median_filter(density, size=(NEIGHBOURS, 1), mode="nearest")
        sizes[f"{triad} line"] = float(np.log((density[high] / around[high]).max()))
    deviations = {triad: allan.deviation(values, dt) for triad, values in rates.items()}
    return StreamStatistics(sizes, float("nan"), spectrum, deviations)


def compute_spectrum(rates: Mapping[str, FloatArray], dt: float, average: Average = "median") -> Spectrum:
    """Return the spectra of samples (n, 3) of each triad in SI units.

    Parameters
    ----------
    rates, dt
        As of `of_rest`.
    average
        Of the pieces: the median, which no bump changes, or the mean, which has the power of steady lines.
    """
    from scipy import signal  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    densities = {}
    for triad, values in rates.items():
        frequency, densities[triad] = signal.welch(
            values, 1 / dt, nperseg=min(round(SEGMENT / dt), len(values)), axis=0, average=average
        )
    return Spectrum(frequency, densities)
