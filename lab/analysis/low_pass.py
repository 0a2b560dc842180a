"""Low-pass: the filter in a sensor, found in the spectrum of its output at rest, and undone.

A sensor that filters its output has less noise at short averaging times, where the Allan deviation shows
white
noise best, and correlated samples, which look like a bias that changes. Its spectrum shows the filter: white
noise, flicker, random walk and quantisation noise fall with frequency or rise, but none is flat and then
falls.
The spectrum of three axes is fitted with and without a filter by maximum likelihood (Whittle); dividing the
output by the filter leaves the noise that the sensor has before it, with the same density at low frequencies.

References
----------
P. Whittle, *Estimation and Information in Stationary Time Series*, Arkiv för Matematik 2 (1953): the
likelihood of a spectrum.
A. V. Oppenheim and R. W. Schafer, *Discrete-Time Signal Processing*, 3rd ed. (2010), chapter 7: filters whose
frequency is bent by the bilinear transform.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread


@dataclass(frozen=True)
class LowPassLimits:
    """When a low-pass is said."""

    likelihood: float = 22.0
    """Twice the growth of the log-likelihood by a filter from which it is said: chance makes 22 of one
    parameter in one case of 4·10⁵, and there are five shapes."""
    fallen: float = 0.5
    """Power near half of the sampling rate, relative to that of the white noise, from which a filter is
    said that does not explain the spectrum: its shape is another, or there is vibration besides."""
    deviance: float = 4.0
    """Deviance beyond chance, in its σ, up to which a filter explains the spectrum wholly."""
    slowest: float = 0.002
    """Smallest cut-off that is sought, in sampling rates: 2 Hz at 1 kHz."""
    fastest: float = 0.48
    """Largest one: at half of the rate, a filter shows nothing."""
    least: int = 256
    """Fewest samples in which a filter is sought."""
    kept: float = 1e-3
    """Smallest power of the filter, relative to that at low frequencies, that is fitted and undone: below,
    there may be anything."""


LIMITS = LowPassLimits()
"""The limits in use."""

_GRID = 48
"""Cut-offs that are tried before the best is refined."""
_WIDTH = 0.02
"""Relative width of the bands over which the spectrum is averaged."""
_MOST_BANDS = 400
"""Most bands up to half of the sampling rate that have the same width."""
_TAPERED = 0.1
"""Part of the record at each end that is faded out, so that the power of low frequencies does not leak."""
_FEWER = 1.0 + _TAPERED
"""Factor by which the taper reduces the independent ordinates (that of Tukey windows, to first order)."""
_TRIMMED = 32
"""Ordinates among which lines of vibration or mains are removed."""
_LINE = 8.0
"""Ordinate that is a line, in units of the mean of its neighbours: chance exceeds it once in 3,000."""
_REWEIGHTINGS = 8
"""Iterations in which the weights are adapted to the spectrum."""
_FIRST_REWEIGHTINGS = 3
"""The same for the cut-offs that are tried: enough to tell which is the best."""
_FLOOR = (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
"""Power behind the filter, relative to the noise before it, that is tried: rounding of the output. With
more of it, the spectrum is that of white noise and a bias with a correlation time."""
_BELOW_HALF = 0.4999
"""Largest frequency of the bilinear transform, whose tangent is infinite at one half."""
_NORMAL = 4
"""Ordinates of a band from which the logarithm of their mean is nearly normal."""
_SMALL = 1e-3
"""Part of the white noise that flicker and random walk have at least, where their slopes are taken."""
_PRICE = 4.0
"""Growth of the log-likelihood by which power behind the filter, and quantisation noise, have to pay:
chance makes 4 in one case of 200."""
_PENALTY = 4.0
"""Growth of the log-likelihood by which a filter has to pay before it widens the σ of white noise."""
_HIGHEST = 0.45
"""Frequency up to which the spectrum is used, in sampling rates: filters may have a zero at one half."""
_PLATEAU = 0.02
"""Frequency above which the largest power is that of white noise before a filter, in sampling rates."""
_TINY = 1e-12
"""Smallest power of a filter by which is divided: that of rounding in double precision is smaller."""
_TOP = 0.4
"""Frequency above which the power is compared with the white noise that a filter would have reduced."""
_TWICE = 0.6436
"""−3 dB frequency of two equal first-order filters, in that of one: sqrt(sqrt(2) − 1)."""


class LowPass(NamedTuple):
    """A low-pass in a sensor.

    Attributes
    ----------
    cut_off : float
        Frequency at which the power is halved [Hz].
    shape : str
        Name of the shape in `SHAPES`.
    floor : float
        Power behind the filter, relative to the noise before it.
    explains : bool
        Whether it explains the spectrum. If not, only long averaging times show the white noise.
    """

    cut_off: float
    shape: str
    floor: float
    explains: bool

    def undone(self, rates: FloatArray, dt: float) -> FloatArray:
        """Return the output (n, axes) before the filter, which passes slow changes unaltered.

        Where the filter leaves nothing, the power is that of the frequencies below.
        """
        steps = np.arange(len(rates), dtype=np.float64)[:, None]
        # The transform takes the record for periodic: a step from its end to its begin would be in all
        # frequencies.
        trend = rates[0] + (rates[-1] - rates[0]) * (steps / max(len(rates) - 1, 1))
        spectrum = np.fft.rfft(rates - trend, axis=0)
        f = np.asarray(np.fft.rfftfreq(len(rates)), dtype=np.float64)
        power = (SHAPES[self.shape](f, self.cut_off * dt) + self.floor) / (1 + self.floor)
        before = spectrum / np.sqrt(np.maximum(power, _TINY))[:, None]
        gone = power < LIMITS.kept
        if gone.any():
            below = ~gone & (f > f[gone][0] / 2)
            level = np.sqrt(np.mean(np.abs(before[below]) ** 2, axis=0))
            # Only the size is replaced: the phases stay those of the record.
            before[gone] *= level / np.maximum(np.abs(before[gone]), np.finfo(float).tiny)
        return np.asarray(np.fft.irfft(before, len(rates), axis=0) + trend)

    def shown_from(self, dt: float) -> float:
        """Return the averaging time from which the output before the filter is that of the sensor [s]."""
        f = np.linspace(0, 0.5, 501)[1:]
        gone = f[SHAPES[self.shape](f, self.cut_off * dt) + self.floor < LIMITS.kept]
        return dt / float(gone[0]) if gone.size else 0.0


def _smoothing(f: FloatArray, cut: float) -> FloatArray:
    a = np.exp(-2 * np.pi * cut)
    # |H|² of y ← a y + (1 − a) x.
    return np.asarray((1 - a) ** 2 / (1 - 2 * a * np.cos(2 * np.pi * f) + a**2))


def _butterworth_power(f: FloatArray, cut: float, order: int) -> FloatArray:
    return np.asarray(
        1 / (1 + (np.tan(np.pi * np.minimum(f, _BELOW_HALF)) / np.tan(np.pi * cut)) ** (2 * order))
    )


def _sampled_power(f: FloatArray, cut: float) -> FloatArray:
    """Return the power of an analogue Butterworth filter with that of the frequencies which fold into it."""

    def folded(f: FloatArray) -> FloatArray:
        # It falls with f⁻⁴: from beyond three sampling rates, less than a thousandth folds back.
        return np.asarray(sum(1 / (1 + ((f + k) / cut) ** 4) for k in range(-3, 4)))

    return folded(f) / folded(np.zeros(1))


SHAPES: dict[str, Callable[[FloatArray, float], FloatArray]] = {
    "exponential smoothing": _smoothing,
    "first order, bilinear": lambda f, cut: _butterworth_power(f, cut, 1),
    "exponential smoothing twice": lambda f, cut: _smoothing(f, cut / _TWICE) ** 2,
    "Butterworth, bilinear": lambda f, cut: _butterworth_power(f, cut, 2),
    "Butterworth, sampled": _sampled_power,
}
"""Power of each filter at frequencies and a cut-off in sampling rates, 1 at frequency 0."""


class Found(NamedTuple):
    """What the spectrum of a sensor at rest shows.

    Attributes
    ----------
    low_pass : LowPass or None
        The filter in the sensor; None if the spectrum shows none.
    white, white_sigma : (axes,) arrays
        White noise, before the filter if there is one, as N of `lab.analysis.allan.NoiseTerms`, and its σ;
        NaN if the spectrum is not explained.
    """

    low_pass: LowPass | None
    white: FloatArray
    white_sigma: FloatArray


class _Spectrum(NamedTuple):
    """Mean ordinates (k, axes) of bands at frequencies f (k,) in sampling rates, and their numbers."""

    f: FloatArray
    power: FloatArray
    ordinates: FloatArray


class _Fit(NamedTuple):
    cost: float
    squares: FloatArray
    shape: str = ""
    cut: float = np.nan
    floor: float = 0.0


@OneBlasThread()
def find(rates: FloatArray, dt: float) -> Found:
    """Return the low-pass in a sensor at rest, if its spectrum shows one, and its white noise.

    Parameters
    ----------
    rates : (n, axes) array
        Equally spaced output.
    dt
        Time from sample to sample [s].
    """
    white, sigma = np.full((2, rates.shape[1]), np.nan)
    alive = np.ptp(rates, axis=0) > 0
    if len(rates) < LIMITS.least or not alive.any():
        return Found(None, white, sigma)
    spectrum = _spectrum(rates[:, alive])
    best = plain = _fit_noise_terms(spectrum, np.ones_like(spectrum.f))
    fits = [_best_fit(spectrum, shape) for shape in SHAPES]
    filtered = min(fits, key=lambda one: one.cost)
    low_pass = None
    if 2 * (plain.cost - filtered.cost) / _FEWER >= LIMITS.likelihood:
        explains = _excess_deviance(spectrum, filtered) < LIMITS.deviance
        if explains or _has_fallen(spectrum, filtered):
            best = filtered
            low_pass = LowPass(best.cut / dt, best.shape, best.floor, explains)
    if _excess_deviance(spectrum, best) < LIMITS.deviance:
        white[alive] = np.sqrt(best.squares[0] * (1 + best.floor) * dt)
        sigma[alive] = white[alive] * _uncertainty(spectrum, best, [plain, *fits])
    return Found(low_pass, white, sigma)


def _has_fallen(spectrum: _Spectrum, fit: _Fit) -> bool:
    """Return whether the highest frequencies have much less power than the white noise of a fit."""
    top = spectrum.f > _TOP
    power = spectrum.power[top].mean(axis=0)
    return bool((power < LIMITS.fallen * fit.squares[0]).all())


def _spectrum(rates: FloatArray) -> _Spectrum:
    count = len(rates)
    steps = np.linspace(0.0, 1.0, count)[:, None]
    slope, level = np.polyfit(steps[:, 0], rates, 1)
    edge = np.clip(np.minimum(steps, 1 - steps) / _TAPERED, 0.0, 1.0)
    taper = np.sin(np.pi / 2 * edge) ** 2
    spectrum = np.fft.rfft((rates - level - slope * steps) * taper, axis=0)[1:]
    # What the taper leaves of white noise.
    power = np.abs(spectrum) ** 2 / np.sum(taper**2)
    f = np.arange(1, len(power) + 1) / count
    f, power = f[f < _HIGHEST], power[f < _HIGHEST]
    weight = np.ones_like(power)
    whole = len(power) // _TRIMMED * _TRIMMED
    parts = power[:whole].reshape(-1, _TRIMMED, power.shape[1])
    # Ordinates are exponentially distributed: their median is ln 2 times their mean. Lines of vibration
    # stand far above.
    weight[:whole] = (parts < _LINE / np.log(2) * np.median(parts, axis=1, keepdims=True)).reshape(whole, -1)
    # Bands of the same relative width, and further up of the same width.
    band = np.where(f < 1 / (2 * _MOST_BANDS * _WIDTH), np.log(f) / np.log1p(_WIDTH), 0.0)
    # Numbers of bands of the second kind begin at a million, where none of the first is.
    band = np.where(f < 1 / (2 * _MOST_BANDS * _WIDTH), np.floor(band), 1e6 + np.floor(f * 2 * _MOST_BANDS))
    starts = np.flatnonzero(np.append(True, np.diff(band) != 0))
    counts = np.diff(np.append(starts, len(f))).astype(np.float64)
    used = np.maximum(np.add.reduceat(weight, starts, axis=0), 1e-9)
    mean = np.add.reduceat(power * weight, starts, axis=0) / used
    centre = np.add.reduceat(f, starts) / counts
    gone = mean < LIMITS.kept * mean[centre > _PLATEAU].max(axis=0)
    return _Spectrum(centre, np.maximum(mean, 1e-300), np.where(gone | (used < 1), 0.0, used))


def _fit_noise_terms(
    spectrum: _Spectrum, gain: FloatArray, filtered: bool = False, reweightings: int = _REWEIGHTINGS
) -> _Fit:
    """Return the cost of the noise terms behind a filter, and their squares (terms, axes)."""
    f = spectrum.f
    columns = gain[:, None] * _terms(f)
    scale = np.maximum(np.max(columns, axis=0), 1e-300)
    columns = columns / scale
    cost, squares = 0.0, []
    for axis, count in zip(spectrum.power.T, spectrum.ordinates.T, strict=True):
        smooth, found = _fit_reweighted(columns[:, :-1], axis, count, reweightings)
        found = np.append(found, 0.0)
        if not filtered:  # the rounding of the output comes behind the filter
            other, more = _fit_reweighted(columns, axis, count, reweightings)
            if other < smooth - _PRICE:
                smooth, found = other, more
        cost += smooth
        squares.append(found / scale)
    return _Fit(cost, np.stack(squares, axis=1))


def _fit_reweighted(
    columns: FloatArray, power: FloatArray, count: FloatArray, reweightings: int
) -> tuple[float, FloatArray]:
    """Return the cost of the likeliest terms of a spectrum, and their squares."""
    from scipy.optimize import nnls  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    model = power.copy()
    root = np.sqrt(count)
    for _ in range(reweightings):
        weight = root / model
        found = nnls(columns * weight[:, None], power * weight, maxiter=100)[0]
        model = np.maximum(columns @ found, 1e-9 * power.max())
    # Minus the log-likelihood of exponentially distributed ordinates, without the constant (Whittle).
    return float(np.sum(count * (np.log(model) + power / model))), found


def _best_fit(spectrum: _Spectrum, shape: str) -> _Fit:
    """Return the best fit with a filter of a shape."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - takes a tenth of a second

    power = SHAPES[shape]

    def fit(cut: float, floor: float, reweightings: int = _REWEIGHTINGS) -> _Fit:
        found = _fit_noise_terms(spectrum, power(spectrum.f, cut) + floor, True, reweightings)
        return found._replace(shape=shape, cut=cut, floor=floor)

    cuts = np.geomspace(LIMITS.slowest, LIMITS.fastest, _GRID)
    costs = [fit(float(cut), _FLOOR[0], _FIRST_REWEIGHTINGS).cost for cut in cuts]
    place = int(np.argmin(costs))
    ends = float(np.log(cuts[max(place - 1, 0)])), float(np.log(cuts[min(place + 1, _GRID - 1)]))
    best = fit(float(cuts[place]), _FLOOR[0])
    for _ in range(2):  # the floor and the cut-off in turn
        best = min(
            (fit(best.cut, one) for one in _FLOOR), key=lambda one: one.cost + _PRICE * (one.floor > 0)
        )
        floor = best.floor

        def cost(log: float, floor: float = floor) -> float:
            return fit(float(np.exp(log)), floor).cost

        log = minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": 1e-3}).x
        best = fit(float(np.exp(log)), floor)
    return best


def _gain(f: FloatArray, fit: _Fit) -> FloatArray:
    return SHAPES[fit.shape](f, fit.cut) + fit.floor if fit.shape else np.ones_like(f)


def _model(spectrum: _Spectrum, fit: _Fit) -> FloatArray:
    return np.asarray(_gain(spectrum.f, fit)[:, None] * (_terms(spectrum.f) @ fit.squares))


def _terms(f: FloatArray) -> FloatArray:
    """Return the spectra (k, 4) of white noise, flicker, random walk and quantisation noise."""
    return np.column_stack((np.ones_like(f), 1 / f, 1 / f**2, np.sin(np.pi * f) ** 2))


def _excess_deviance(spectrum: _Spectrum, fit: _Fit) -> float:
    """Return by how much the deviance of a fit exceeds that of chance, in σ of chance."""
    ratio = spectrum.power / np.maximum(_model(spectrum, fit), 1e-300)
    large = spectrum.ordinates >= _NORMAL
    deviance = 2 * np.sum((spectrum.ordinates * (ratio - 1 - np.log(ratio)))[large]) / _FEWER
    degrees = float(large.sum())
    return float((deviance - degrees) / np.sqrt(2 * max(degrees, 1.0)))


def _uncertainty(spectrum: _Spectrum, best: _Fit, fits: list[_Fit]) -> FloatArray:
    """Return the relative σ (axes,) of white noise: by the Fisher information, and by other shapes."""
    axes = spectrum.power.shape[1]
    model = _model(spectrum, best)
    moved = best.cut * 0.999
    by_cut = np.zeros_like(model)
    if best.shape:
        by_cut = np.log(model / _model(spectrum, best._replace(cut=moved))) / np.log(best.cut / moved)
    terms = _gain(spectrum.f, best)[:, None] * _terms(spectrum.f)[:, :-1]
    count = terms.shape[1]
    shown = np.zeros((axes * count + 1, axes * count + 1))
    for axis in range(axes):
        rows = np.r_[axis * count : (axis + 1) * count, axes * count]
        size = np.maximum(best.squares[:count, axis], _SMALL * best.squares[0, axis])
        slopes = np.column_stack((terms * size / model[:, axis, None], by_cut[:, axis]))
        weighted = slopes * spectrum.ordinates[:, axis, None] / _FEWER
        shown[np.ix_(rows, rows)] += slopes.T @ weighted
    variance = np.diag(np.linalg.pinv(shown))[: axes * count : count]
    shape = np.zeros(axes)
    for one in fits:
        # As likely as the best with a parameter more, even if too unlikely to be said.
        chance = min(
            1.0, np.exp((best.cost - one.cost) / _FEWER - _PENALTY * (bool(one.shape) - bool(best.shape)))
        )
        apart = np.log(np.maximum(one.squares[0], 1e-300) / np.maximum(best.squares[0], 1e-300))
        shape = np.maximum(shape, chance * np.minimum(np.abs(apart), 1.0) ** 2)
    return np.asarray(np.sqrt(variance + shape) / 2)
