"""Sensor evidence: the errors that a simulated IMU added to the true motion, relative to Q.

Besides its bias, a sensor adds noise and errors that depend on the motion: scale factors, misalignments, a
lag. The bias itself is a random process, or depends on time, temperature or specific force. The noise is
tested with sums over windows (`true_motion`), the bias process with the bias as visible through the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.sums import Kept, Squares, Sum
from lab.analysis.verdicts.true_motion import (
    Exact,
    Reference,
    exact_motion_in_windows,
    means_over_windows,
    window_means,
)
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.kernels.compilation import entry_kernel
from lab.navigation.solution import Belief, Imu

MOTION = ("own axis", "second axis", "third axis", "lag", "more lag", "Earth rate")
"""Regressors of the errors that depend on the motion: the rate or force of the axis itself and of the two
axes after it [1]; the effect of a first-order lag on the true one, per second, and of a longer lag [s]; what
a navigator without the rate of the Earth takes for an error, ω_ie of gyros and 2 ω_ie × v of accelerometers
[1]."""
DRIFT = ("constant", "time", "temperature", "specific force")
"""Regressors of the bias: [1], [s], [K], and the specific force of the axis [m/s²]."""
SHORT, LONG = 5e-3, 1.0
"""Smallest lag with an effect beyond the slope, and longest lag: bandwidths of 32 and 0.16 Hz [s]."""
FACTORS = np.logspace(-4, 4, 17)
"""Tried bias drives, relative to the filter's."""
LONGER = 1.3
"""The longer lag over the one that fits: its difference is the slope of the effect. A plain choice."""
UNSEEN = 0.01
"""Fraction of the drive that noise would just hide; it replaces a drive of zero."""
FEWEST = 10
"""Fewest windows beyond the regressors that show the noise: its variance is then known to 45 %."""
NEARLY_KNOWN = 0.01
"""Part of the noise through which the true bias is seen: a tenth of its σ, as by a sensor ten times better.
Without any, a drive of zero would be infinitely unlikely for rounding alone."""


SHOWN = 1e-12
"""Smallest square of a combination of causes, each of unit size, that is fitted: rounding leaves 1e-15."""
TINY = 1e-300
"""Smallest divisor."""
SLOW = 1e-6
"""Fraction of the correlation time below which a flight cannot distinguish a first-order process from a
random walk."""


@dataclass(frozen=True)
class SensorErrors(Sum):
    """The errors that gyros x, y, z and accelerometers x, y, z added, each divided by its assumed σ.

    Attributes
    ----------
    matrix : Kept
        Normal equations of the noise on `MOTION`: matrix (runs, 6, 6, 6), vector (runs, 6, 6) and squares
        (runs, 6).
    vector, squares, number : Kept
        See `matrix`; `number` is the number of windows (runs, 6), zero for axes that are assumed to be free
        of noise.
    clipped : Squares
        Squares of the windows with saturation (2,); the other figures omit these windows.
    drift_matrix : Kept
        Normal equations of bias and noise, whitened under each drive, on `DRIFT`: (runs, 6, drives, 4, 4).
        The first drive is that of the filter, the second that of a filter matched to the sensor (zero if
        unknown), the others are `FACTORS` times the filter's.
    drift_vector, drift_squares, log_determinant : Kept
        See `drift_matrix`; (runs, 6, drives, 4) and twice (runs, 6, drives).
    drive : Kept
        Drives of the filter and of the matched one, relative to the one that `FACTORS` multiply (runs, 6, 2);
        zero if there is none.
    known : Kept
        Log-likelihood of the true bias under the drive of the matched filter, minus that of a constant bias
        (runs, 6); zero where the filter has a drive, or the matched one hardly more than noise hides.
    """

    matrix: Kept
    vector: Kept
    squares: Kept
    number: Kept
    clipped: Squares
    drift_matrix: Kept
    drift_vector: Kept
    drift_squares: Kept
    log_determinant: Kept
    drive: Kept
    known: Kept


class _Windows(NamedTuple):
    """The errors of the six axes of some runs, averaged over windows of a length [s]."""

    window: float
    noise: FloatArray  # (runs, 6, windows) error besides the bias
    bias: FloatArray  # likewise
    motion: FloatArray  # (1 or runs, 6, windows, 6) MOTION: of all runs, or of each
    drift: FloatArray  # (6, windows, 4) DRIFT
    lags: FloatArray  # (runs, 6) lag of the fourth regressor [s]; zero where it is the slope
    clipped: NDArray[np.bool_]  # (runs, 6, windows)


def sensor_errors(
    belief: Belief,
    imu: Imu,
    reference: Reference,
    true: tuple[Exact, Exact] | None = None,
    measured: tuple[FloatArray, FloatArray] | None = None,
) -> SensorErrors:
    """Return the errors that the sensors of a run added.

    Parameters
    ----------
    belief
        The filter's assumptions about the sensors.
    imu
        Output of the sensors.
    reference
        True values.
    true
        The true motion as from `exact_motion_in_windows`, which is that of all runs of a flight.
    measured
        The mean increments (windows, 6) in the windows of both, as from `window_means`; by default, from the
        output of the sensors.
    """
    short, long = true or exact_motion_in_windows(reference, imu.time)
    if measured is None:
        first = _measured_means(imu, short)
        measured = first, first if long is short else _measured_means(imu, long)
    means = measured[0][None], measured[1][None]
    return sensor_errors_abreast(belief, [imu], [reference], (short, long), means)[0]


def sensor_errors_abreast(
    belief: Belief,
    imus: Sequence[Imu],
    references: Sequence[Reference],
    true: tuple[Exact, Exact],
    measured: tuple[FloatArray, FloatArray],
) -> list[SensorErrors]:
    """Return the errors that the sensors of some runs added, whose matched filters are the same.

    Parameters
    ----------
    belief
        The assumptions of all filters about the sensors.
    imus, references
        Output of the sensors and true values of each run.
    true
        As from `exact_motion_in_windows`.
    measured
        The mean increments (runs, windows, 6) in the windows of both.
    """
    short, long = true
    axes = np.flatnonzero(belief.noise[:6] > 0)
    seen = _windows(imus, references, short, measured[0])
    wide = seen if long is short else _windows(imus, references, long, measured[1], seen.lags)
    root = np.sqrt(np.where(belief.noise[:6] > 0, belief.noise[:6], 1.0) / seen.window)
    noise, motion = seen.noise / root[:, None], seen.motion / root[:, None, None]
    kept = ~seen.clipped
    number = kept.sum(axis=2).astype(np.float64)
    lost = np.sum(np.where(kept, 0.0, noise**2), axis=2)
    if not kept.all():
        noise, motion = np.where(kept, noise, 0.0), np.where(kept[..., None], motion, 0.0)
    across = np.swapaxes(motion, -1, -2)
    matrix, vector = across @ motion, (across @ noise[..., None])[..., 0]
    spread = _least_squares(matrix, vector)
    left = np.sum((noise - (motion @ spread[..., None])[..., 0]) ** 2, axis=2)
    free = number - np.count_nonzero(np.diagonal(matrix, axis1=-2, axis2=-1), axis=-1)
    # Few windows are left of an axis that is saturated most of the time: the regressors take their noise.
    rest = np.where(free >= FEWEST, np.maximum(left / np.maximum(free, 1.0), 1e-12), 1.0)
    squares = np.sum(noise**2, axis=2)
    judged = np.isin(np.arange(6), axes)
    runs, drives, terms = len(references), FACTORS.size + 2, len(DRIFT)
    parts = [np.zeros((runs, 6, *size)) for size in ((2,), (drives, terms, terms), (drives, terms))]
    parts += [np.zeros((runs, 6, *size)) for size in ((drives,), (drives,), ())]
    matched, hidden = (
        np.zeros(6) if values is None else values
        for values in (references[0].bias_drive, references[0].hidden)
    )
    for axis in axes.tolist():
        found = _drift(wide, belief, axis, float(matched[axis]), float(hidden[axis]), rest, spread)
        for part, values in zip(parts, found, strict=True):
            part[:, axis] = values
    drive, drift_matrix, drift_vector, drift_squares, determinant, known = parts
    matrix = np.broadcast_to(matrix, (runs, *matrix.shape[1:])) * judged[:, None, None]
    vector, squares, number = vector * judged[:, None], squares * judged, number * judged
    lost, away = (lost * judged).reshape(runs, 2, 3).sum(axis=2), (~kept).sum(axis=2) * judged
    kept_of_runs = {
        "matrix": matrix,
        "vector": vector,
        "squares": squares,
        "number": number,
        "drift_matrix": drift_matrix,
        "drift_vector": drift_vector,
        "drift_squares": drift_squares,
        "log_determinant": determinant,
        "drive": drive,
        "known": known,
    }
    return [
        SensorErrors(
            clipped=Squares(lost[run], away[run].reshape(2, 3).sum(axis=1).astype(np.float64)),
            **{name: Kept(values[run : run + 1]) for name, values in kept_of_runs.items()},
        )
        for run in range(runs)
    ]


def _least_squares(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solution of normal equations (…, p, p), (…, p), without what their causes do not show."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    per = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    values, along = np.linalg.eigh(matrix * per[..., :, None] * per[..., None, :])
    weight = np.divide(1, values, out=np.zeros_like(values), where=values > SHOWN)
    parts = np.swapaxes(along, -1, -2) @ (per * vector)[..., None]
    return np.asarray(per * (along @ (weight[..., None] * parts))[..., 0])


class _Sums(NamedTuple):
    """What the sensors of a run added, averaged over windows: (windows, 6) each."""

    noise: FloatArray  # besides the bias
    bias: FloatArray


def _measured_means(imu: Imu, true: Exact) -> FloatArray:
    return np.concatenate([window_means(values, true) for values in (imu.dtheta, imu.dvelocity)], axis=1)


def _sums(reference: Reference, true: Exact, measured: FloatArray) -> _Sums:
    """Return what the sensors of a run added, given the means (windows, 6) of their output."""
    noise, biases = measured / true.dt, np.empty(true.moved.shape)
    for sensor in range(2):
        own = slice(3 * sensor, 3 * sensor + 3)
        moved = true.moved[:, own]
        biases[:, own] = window_means(reference.bias[1:, own], true)
        noise[:, own] -= moved + biases[:, own]
        if reference.of_states is not None:
            noise[:, own] -= window_means(reference.of_states[:, own], true)
        if reference.scale is not None:  # scale factors are states, with known true values
            scale = reference.scale[1:, own]
            if scale.strides[0] == 0:
                noise[:, own] -= scale[:1] * moved
                continue
            exact = (reference.dtheta, reference.dvelocity)[sensor]

            def by_scale(part: slice, scale: FloatArray = scale, exact: FloatArray = exact) -> FloatArray:
                return np.asarray(scale[part] * (exact[part].astype(np.float64) / true.dt))

            noise[:, own] -= means_over_windows(by_scale, true.moved.shape[0], true.width)
    return _Sums(noise, biases)


def _windows(
    imus: Sequence[Imu],
    references: Sequence[Reference],
    true: Exact,
    measured: FloatArray,
    lags: FloatArray | None = None,
) -> _Windows:
    """Return the errors of the axes, given the means (runs, windows, 6) of the output of the sensors.

    The `lags` (runs, 6) are those that fit the errors, or those given: what is fitted to the regressors of
    some windows is taken from the errors of others, so they must be regressors of the same lag.
    """
    count, width, dt = true.moved.shape[0], true.width, true.dt
    sums = [_sums(reference, true, means) for reference, means in zip(references, measured, strict=True)]
    noise, bias = (np.stack([one[part].T for one in sums]) for part in range(2))
    sensors, own = np.divmod(np.arange(6), 3)
    motion = np.zeros((1, 6, count, len(MOTION)))
    for column in range(3):
        motion[0, ..., column] = true.moved[:, 3 * sensors + (own + column) % 3].T
    motion[0, ..., 3], motion[0, ..., 5] = true.fall.T, true.earth.T
    if lags is None:
        centred = true.fall.T - true.fall.mean(axis=0)[:, None]
        late = np.sum(centred * noise, axis=2) >= SHORT * np.maximum(np.sum(centred**2, axis=1), TINY)
        lags = np.where(late, np.inf, 0.0)
    if lags.any():
        motion = np.tile(motion, (len(references), 1, 1, 1))
        lags = lags.copy()
    for run, axis in np.argwhere(lags).tolist():
        increments = (references[run].dtheta, references[run].dvelocity)[axis // 3]
        values = of_kernel(increments[: count * width, axis % 3] / dt)
        if np.isinf(lags[run, axis]):
            lags[run, axis] = _fit_lag(values, noise[run, axis], true.fall[:, axis], dt)
        for column, times in ((3, 1.0), (4, LONGER)):
            motion[run, axis, :, column] = _lag_effect(values, times * lags[run, axis], count, dt)
    drift = np.zeros((6, count, len(DRIFT)))
    drift[..., 0], drift[..., 1] = 1.0, (np.arange(count) + 0.5) * width * dt
    drift[..., 2], drift[:3, :, 3] = true.temperature, true.moved[:, 3:].T
    clipped = np.zeros(noise.shape, dtype=np.bool_)
    for run, (imu, reference) in enumerate(zip(imus, references, strict=True)):
        for sensor, increments in enumerate((imu.dtheta, imu.dvelocity)):
            if reference.saturated[sensor]:
                size = np.abs(increments[: count * width])
                at_end = (size >= np.abs(increments).max() * (1 - 1e-9)).reshape(count, width, 3)
                clipped[run, 3 * sensor : 3 * sensor + 3] = at_end.any(axis=1).T
    return _Windows(width * dt, noise, bias, motion, drift, lags, clipped)


def _fit_lag(values: FloatArray, added: FloatArray, fall: FloatArray, dt: float) -> float:
    """Return the first-order lag of values that fits the `added` errors [s].

    A lag beyond `SHORT` has effects beyond the slope, minus which is `fall` in each window.
    """
    lag = _fit_factor(fall, added)
    for _ in range(3):
        lag = float(np.clip(lag, SHORT, LONG))
        lag = _fit_factor(_lag_effect(values, lag, fall.size, dt), added)
    return float(np.clip(lag, SHORT, LONG))


def _lag_effect(values: FloatArray, lag: float, windows: int, dt: float) -> FloatArray:
    """Return the effect of a first-order lag on values as means over windows, per second of lag."""
    means = np.empty(windows)
    _lagged_means(values, float(np.exp(-dt / lag)), means)
    return means / lag


@entry_kernel
def _lagged_means(values: FloatArray, forget: float, means: FloatArray) -> None:
    """Write by how much values (n,) after a first-order lag exceed those before it, as means over windows."""
    width, slow = values.size // means.size, values[0]
    for window in range(means.size):
        total = 0.0
        for k in range(window * width, (window + 1) * width):
            slow = forget * slow + (1 - forget) * values[k]
            total += slow - values[k]
        means[window] = total / width


def _fit_factor(effect: FloatArray, added: FloatArray) -> float:
    """Return the fitted factor of an effect, next to a constant."""
    centred = effect - effect.mean()
    return float(centred @ added / max(centred @ centred, TINY))


def _drift(
    seen: _Windows,
    belief: Belief,
    axis: int,
    matched: float,
    period: float,
    rest: FloatArray,
    spread: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the figures of `SensorErrors` on the bias of an axis, from its drives on, for each run.

    `matched` is the drive of a filter matched to the sensor, which does not follow changes with a period
    below `period` [s]; `rest` (runs, 6) the variance of the noise relative to the assumed one, `spread`
    (runs, 6, 6) the errors that depend on the motion.
    """
    count = seen.noise.shape[2]
    density = belief.noise[axis] * rest[:, axis]
    drive, decay = float(belief.noise[6 + axis]), float(belief.decay[axis])
    # Over T, a drive K² adds K² T / 3 to the variance of a mean, and white noise N² / T.
    hidden = 3 * density / (seen.window * count) ** 2
    base = np.maximum(drive, UNSEEN * hidden)
    power, basis = spectrum(count, seen.window, decay, period)
    # Saturated windows contain no information about the bias.
    apart = seen.noise[:, axis] - (seen.motion[:, axis] @ spread[:, axis, :, None])[..., 0]
    values = np.where(seen.clipped[:, axis], 0.0, apart) + seen.bias[:, axis]
    # One product for each run, whose bits then do not depend on those beside it.
    values = (values[:, None] @ basis)[:, 0]
    causes = basis.T @ seen.drift[axis]
    white = density / seen.window
    own = np.stack(np.broadcast_arrays(drive, matched * np.ones_like(base)), axis=1)
    tried = np.concatenate((own, base[:, None] * FACTORS), axis=1)
    variance = white[:, None, None] + tried[..., None] * power
    weight = 1 / variance
    walk = np.zeros_like(base)
    if drive == 0 and matched > 0:
        known = _walk(seen.bias[:, axis] @ basis, basis.sum(axis=0), NEARLY_KNOWN * white, matched * power)
        walk = np.where(matched > limits.VERDICT.drive_factor * hidden, known, 0.0)
    products = (causes[:, :, None] * causes[:, None, :]).reshape(len(causes), -1)
    return (
        own / base[:, None],
        (weight @ products).reshape(*tried.shape, len(DRIFT), len(DRIFT)),
        weight @ (causes * values[..., None]),
        (weight @ (values**2)[..., None])[..., 0],
        np.log(variance / white[:, None, None]).sum(axis=2),
        walk,
    )


def _walk(bias: FloatArray, constant: FloatArray, white: FloatArray, power: FloatArray) -> FloatArray:
    """Return the log-likelihood (runs,) of true biases that walk, minus that of constant ones.

    Parameters
    ----------
    bias : (runs, k) array
        True biases, in the eigenvectors of `spectrum`.
    constant : (k,) array
        A constant bias in them.
    white : (runs,) array
        Variance of the noise through which they are seen.
    power : (k,) array
        Variances of the walk.
    """

    def likelihood(variance: FloatArray) -> FloatArray:
        weight = 1 / variance
        by_constant = np.sum(weight * bias * constant, axis=1) ** 2 / np.sum(weight * constant**2, axis=1)
        return np.asarray(0.5 * (by_constant - np.sum(weight * bias**2 - np.log(weight), axis=1)))

    seen = np.broadcast_to(white[:, None], bias.shape)
    return likelihood(seen + power) - likelihood(seen)


@lru_cache(maxsize=32)
def spectrum(count: int, window: float, decay: float, period: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (k,) and eigenvectors (m, k) of the growth of a process of unit drive.

    The process is stationary, of first order, and averaged over windows. The covariance of its growth until t
    and until t' is (exp(−λ|t − t'|) + 1 − exp(−λt) − exp(−λt')) / 2λ; for a random walk, it is the smaller of
    t and t'.

    Parameters
    ----------
    count, window
        Number and length [s] of the windows.
    decay
        Decay rate λ of the process [1/s].
    period
        Shortest period of the eigenvectors that are returned [s]; the slowest always is.
    """
    t, turns = (np.arange(count) + 0.5) * window, decay * window
    if decay * t[-1] < SLOW:
        # Means of a walk over windows: min(t, s) of different ones, t − w / 6 of one with itself.
        covariance = np.minimum(t[:, None], t) - window / 6 * np.eye(count)
    else:
        mean = np.sinh(turns / 2) / (turns / 2)
        at_start = mean * np.exp(-decay * t)
        apart = mean**2 * np.exp(-decay * np.abs(t[:, None] - t))
        np.fill_diagonal(apart, 2 * (turns + np.expm1(-turns)) / turns**2)
        covariance = (apart + 1 - at_start[:, None] - at_start) / (2 * decay)
    power, basis = np.linalg.eigh(covariance)
    power = np.maximum(power, 0)
    # A sine of the period T is integrated to (T / 2π)² of its variance.
    slow = power * window >= (period / (2 * np.pi)) ** 2
    slow[-1] = True
    return power[slow], basis[:, slow]
