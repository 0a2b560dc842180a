"""Velocity matching: the attitude with which the increments of an IMU agree with the velocities of fixes.

Over a short window the velocity is v(t) = v₀ + C_nb₀ ∫ C_b₀b (f − b_a) dt + g t with C_b₀b from the gyros,
for any vehicle in any attitude. Attitude, gyro bias, initial velocity and the lag of the
fixes' clock are fitted by least squares from several headings; their covariance shows how observable they
are. M. Wu, X. Pan, *Velocity/Position Integration Formula*, IEEE Trans. AES 49 (2013), in its iterated form
with biases. Left out: Earth rate and transport rate, 0.1° in a window.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple, cast

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray, interpolate_columns, of_kernel, running_sums
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks import limits

Arrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

WINDOW = 20.0
"""Length of a window [s]: long enough for a manoeuvre, short enough for a bias to be constant."""
GYRO_BIAS_SIGMA = np.radians(5.0)
"""σ of an unknown gyro bias: consumer parts are off by a few °/s [rad/s]."""
LAG_SIGMA = 2.0
"""Prior σ of a fitted lag, large compared with real receivers [s]."""

_STEP = 0.05
"""Length of the steps to which samples are summed [s]."""
_FORCE_BIAS_SIGMA = 0.3
"""σ of the bias of a consumer accelerometer [m/s²]."""
_MODEL_SIGMA = 0.1
"""σ of unmodelled errors: scale factors, coning between steps, vibration [m/s]."""
_HEADINGS = np.radians([0.0, 90.0, 180.0, 270.0])
"""Headings from which the fit starts [rad]: it converges from within 45°. Where the velocity changes faster
than by gravity, they are turns about the mean force."""
_ROUGH, _FINE = 3, 8
"""Most rounds of the fit from each start, and from the best of them. A plain choice."""
_VELOCITY = slice(9, 12)
"""Place of the initial velocity among the unknowns."""
_SETTLED = 1e-8
"""Sum of squares by which a round moves the residuals, in σ, below which it is the last: no unknown has then
moved by more than 1e-4 of its σ."""
_MAX_TURN = 0.5
"""σ of the rotation of one round [rad]: without it, a fit that begins far from the truth diverges."""
_MAX_CHANGE = 1e4
"""Largest change of an unknown in a round: numbers of no physics stay numbers."""
_MAX_FITTED_LAG = 4.0
"""Largest lag of the fit [s]: beyond the searched offsets, so that the fit does not end at one of them."""
_UNKNOWN_VARIANCE = 1e6
"""Variance of unknowns that cannot be fitted."""
_RIDGE = 1e-9
"""Term added to the scaled normal matrix: an unobservable unknown has a σ of 3e4 times its scale."""
_FITTED = 9
"""Unknowns taken off the number of residuals: rotation, gyro bias and initial velocity. With σ of 0.1 m/s the
windows of the shipped missions determine 10 to 13 of the thirteen, which makes a misfit over 60 residuals
up to 8 % too small."""
_G = np.array([0.0, 0.0, STANDARD_GRAVITY])
"""Gravity in n [m/s²]: over a window its deviations are part of an accelerometer's bias."""


class Window(NamedTuple):
    """The data of an IMU and a receiver in a window.

    Attributes
    ----------
    time : (k + 1,) array
        Ends of the steps, the first from which attitude counts [s].
    dtheta, dvelocity : (k, 3) arrays
        Increments of the IMU [rad], [m/s], in b.
    at : (m,) array
        Times of the fixes [s].
    velocity_n : (m, 3) array
        Their velocities; NaN where not measured [m/s].
    sigma : (m, 3) array
        σ of these [m/s].
    """

    time: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    at: FloatArray
    velocity_n: FloatArray
    sigma: FloatArray


class Match(NamedTuple):
    """The result of a match.

    Attributes
    ----------
    C_nb : Rotation
        Attitude at the start of the window.
    heading_sigma : float
        σ of its rotation about the vertical [rad].
    gyro_bias, gyro_bias_sigma : (3,) arrays
        Gyro bias and its σ [rad/s].
    lag, lag_sigma : float
        How much later than the fixes' stamps the IMU measured the same; 0 where it was not fitted [s].
    misfit : float
        Mean square of the residuals in their σ: near 1, or less, if the fit explains the motion.
    cost : float
        Sum of squares that was made least.
    """

    C_nb: Rotation
    heading_sigma: float
    gyro_bias: FloatArray
    gyro_bias_sigma: FloatArray
    lag: float
    lag_sigma: float
    misfit: float
    cost: float


def window_of(log: Arrays, start: float, margin: float = 0.0) -> Window | None:
    """Return the window that starts at a time; None if too little is in it.

    Parameters
    ----------
    log
        Time, dtheta, dvelocity, at, velocity_n, sigma, as of `Window`, of the whole log.
    start
        Start of the window [s].
    margin
        How far from its ends fixes keep, so that their clock may be moved [s].
    """
    time, dtheta, dvelocity, at, velocity_n, sigma = log
    ends = np.arange(start, min(start + WINDOW, time[-1]) + 1e-9, _STEP)
    fixes = (at >= start + margin) & (at <= ends[-1] - margin) if ends.size > 1 else np.zeros(at.size, bool)
    fixes &= np.isfinite(velocity_n[:, :2]).all(axis=1)
    if fixes.sum() < limits.LOG.match_fixes:
        return None
    first, last = np.searchsorted(time, (ends[0], ends[-1]))
    part = slice(max(0, int(first) - 1), min(int(last) + 2, time.size))
    turned, gained = (
        _diff_sums(ends, time[part], values[part.start : part.stop - 1]) for values in (dtheta, dvelocity)
    )
    return Window(ends, turned, gained, at[fixes], velocity_n[fixes], sigma[fixes])


def choose_liveliest(log: Arrays, count: int, margin: float = 0.0) -> list[Window]:
    """Return the windows in which the velocity changes most, in falling order.

    Parameters
    ----------
    log
        Time, dtheta, dvelocity, at, velocity_n, sigma, as of `Window`, of the whole log.
    count
        Most windows that are returned.
    margin
        As of `window_of`.
    """
    found = sorted(measure_liveliness(log, margin), key=lambda one: -one[0])
    windows = [window_of(log, start, margin) for _, start in found[:count]]
    return [window for window in windows if window is not None]


def measure_liveliness(log: Arrays, margin: float = 0.0) -> list[tuple[float, float]]:
    """Return liveliness and start [s] of the windows in which the velocity changes by more than its noise.

    Parameters
    ----------
    log, margin
        As of `choose_liveliest`.
    """
    time, _, _, at, velocity_n, sigma = log
    level = velocity_n[:, :2]
    rows = np.isfinite(level).all(axis=1)
    at, level, noise = at[rows], level[rows], sigma[rows, :2].max(axis=1)
    found = []
    for start in np.arange(time[0], max(time[-1] - WINDOW / 2, time[0] + 1e-9), WINDOW):
        first, last = np.searchsorted(at, (start + margin, min(start + WINDOW, time[-1]) - margin))
        if last - first >= limits.LOG.match_fixes:
            part = level[first:last] - level[first:last].mean(axis=0)
            since = at[first:last] - at[first:last].mean()
            slope = since @ part / max(float(since @ since), 1e-12)
            spread = float(np.std(part - since[:, None] * slope))
            if spread > max(
                limits.LOG.liveliness, limits.LOG.liveliness_noise * float(np.median(noise[first:last]))
            ):
                found.append((spread, float(start)))
    return found


def match(
    window: Window,
    gyro_bias: FloatArray | None = None,
    gyro_bias_sigma: FloatArray | float = GYRO_BIAS_SIGMA,
    lags: Sequence[float] = (),
) -> Match:
    """Return the match of a window.

    Parameters
    ----------
    window
        The window.
    gyro_bias, gyro_bias_sigma : (3,) arrays
        Prior gyro bias and its σ [rad/s].
    lags
        Lags from which the lag is fitted too [s]; without any it is 0.
    """
    bias = np.zeros(3) if gyro_bias is None else gyro_bias
    prior = np.concatenate((bias, np.zeros(3)))
    prior_sigma = np.concatenate((np.broadcast_to(gyro_bias_sigma, 3), np.full(3, _FORCE_BIAS_SIGMA)))
    starts = [
        _fit_window(window, C_nb, prior, prior_sigma, lag, _ROUGH, bool(lags))
        for C_nb in _starting_rotations(window, bias)
        for lag in (lags or (0.0,))
    ]
    best = min(starts, key=lambda one: one[0])
    cost, C_nb, found, lag, covariance, misfit = _fit_window(
        window, best[1], prior, prior_sigma, best[3], _FINE, bool(lags), best[2]
    )
    sigma = np.sqrt(np.diagonal(covariance) * max(1.0, misfit))
    return Match(
        Rotation.from_matrix(C_nb),
        float(sigma[2]),
        found[:3],
        sigma[3:6],
        lag,
        float(sigma[12]),
        misfit,
        cost,
    )


def steps(time: FloatArray, increments: FloatArray, start: float, end: float) -> FloatArray:
    """Return increments (n, 3) of the IMU brought together to steps (k, 3) from a start to an end [s]."""
    ends = np.append(np.arange(start, end - 1e-9, _STEP), end)
    return _diff_sums(ends, time, increments)


def _diff_sums(ends: FloatArray, time: FloatArray, increments: FloatArray) -> FloatArray:
    """Return what increments between some times add up to between others."""
    return np.diff(interpolate_columns(ends, time, running_sums(increments)), axis=0)


def _starting_rotations(window: Window, bias: FloatArray) -> list[FloatArray]:
    """Return rotation matrices that take the sum of the forces to the change of velocity, less gravity.

    The rotation about that vector is arbitrary. It is nearly vertical but for fast, strong manoeuvres.
    """
    first, last = window.at[0], window.at[-1]
    inside = np.flatnonzero((window.time >= first) & (window.time <= last))
    total = np.zeros(3)
    if inside.size:
        begin, end = inside[[0, -1]]
        sums = _sums(window, np.eye(3), np.append(bias, np.zeros(3)))[:, :3]
        total = sums[end] - sums[begin] - _G * (window.time[end] - window.time[begin])
    gained = np.nan_to_num(window.velocity_n[-1] - window.velocity_n[0]) - _G * (last - first)
    # Without a force there is nothing to align: level, with each heading.
    if not (np.linalg.norm(total) > 0 and np.isfinite(total).all()):
        return list(Rotation.from_rotvec(_HEADINGS[:, None] * [0.0, 0.0, 1.0]).as_matrix())
    axis = gained / np.linalg.norm(gained)
    C = Rotation.align_vectors([axis], [total / np.linalg.norm(total)])[0].as_matrix()
    return list(Rotation.from_rotvec(-_HEADINGS[:, None] * axis).as_matrix() @ C)


def _fit_window(
    window: Window,
    C_nb: FloatArray,
    prior: FloatArray,
    prior_sigma: FloatArray,
    lag: float,
    rounds: int,
    fit_lag: bool,
    found: FloatArray | None = None,
) -> tuple[float, FloatArray, FloatArray, float, FloatArray, float]:
    """Return cost, C_nb, biases (6,), lag, covariance (13, 13) and misfit after some rounds.

    Unknowns: rotation in n, gyro bias, accelerometer bias, initial velocity, lag.
    """
    found = prior.copy() if found is None else found
    known = np.isfinite(window.velocity_n)
    weight = 1 / np.sqrt(np.where(known, window.sigma, 1.0) ** 2 + _MODEL_SIGMA**2)
    seen, count = np.where(known, window.velocity_n, 0.0), int(known.sum())
    # Infinite: nothing is known of attitude and velocity before.
    loose = np.concatenate((np.full(3, np.inf), prior_sigma, np.full(3, np.inf), [LAG_SIGMA]))
    damped = np.diag(np.concatenate((np.full(3, 1 / _MAX_TURN), 1 / loose[3:])))
    derivatives = np.zeros((len(seen), 3, 13))
    derivatives[:, :, _VELOCITY] = np.eye(3)
    design, residual = np.zeros((count + 13, 13)), np.zeros(count + 13)
    for _ in range(rounds + 1):
        gained, derivatives[:, :, :3], derivatives[:, :, 3:6], derivatives[:, :, 6:9], by_lag = _model(
            window, C_nb, found, lag
        )
        if fit_lag:
            derivatives[:, :, 12] = by_lag
        design[:count] = (derivatives * weight[:, :, None])[known]
        design[count:] = damped
        residual[:count] = ((seen - gained) * weight)[known]
        off = np.concatenate((np.zeros(3), prior - found, np.zeros(3), [-lag]))
        residual[count:] = damped @ off
        if not (np.isfinite(design).all() and np.isfinite(residual).all()):
            return np.inf, C_nb, prior, 0.0, np.eye(13) * _UNKNOWN_VARIANCE, np.inf
        # Impossible numbers of a damaged file may lead anywhere, but must stay finite.
        change = np.clip(np.linalg.lstsq(design, residual, rcond=1e-12)[0], -_MAX_CHANGE, _MAX_CHANGE)
        left = residual - design @ change
        C_nb = Rotation.from_rotvec(change[:3]).as_matrix() @ C_nb
        found = found + change[3:9]
        lag = min(max(lag + float(change[12]), -_MAX_FITTED_LAG), _MAX_FITTED_LAG)
        change[_VELOCITY] = 0.0  # found anew in each round
        moved = design @ change
        if moved @ moved < _SETTLED:
            break
    # Scaled, since its unknowns have units of many sizes; a heading that nothing shows is unknown.
    scale = np.array([1.0] * 3 + [0.01] * 3 + [0.1] * 3 + [1.0] * 4)
    # The rows below the measurements: the damping of a step gives way to what was known before.
    design[count:] = np.diag(1 / loose)
    scaled = design * scale
    ridge = np.eye(13) * _RIDGE
    covariance = np.linalg.inv(scaled.T @ scaled + ridge) * np.outer(scale, scale)
    cost = float(left @ left)
    return cost, C_nb, found, lag, covariance, cost / max(1, count - _FITTED)


def _model(
    window: Window, C_nb: FloatArray, bias: FloatArray, lag: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the velocity gained until each fix (m, 3), and its derivatives by the unknowns."""
    sums = _sums(window, C_nb, bias)
    at = window.at + lag
    place = np.clip(np.searchsorted(window.time, at, side="right") - 1, 0, len(window.time) - 2)
    dt = window.time[place + 1] - window.time[place]
    step = sums[place + 1] - sums[place]
    here = sums[place] + ((at - window.time[place]) / dt)[:, None] * step
    by_rotation, by_gyro, swing = np.split(here[:, 3:].reshape(-1, 9, 3), 3, axis=1)
    # A lag moves the time of comparison: the derivative is the acceleration there.
    return here[:, :3], -by_rotation, by_gyro, -swing, step[:, :3] / dt[:, None]


def _sums(window: Window, C_nb: FloatArray, bias: FloatArray) -> FloatArray:
    """Return the sums of `_sum_steps`."""
    sums = np.zeros((len(window.time), 30))
    given = (window.time, window.dtheta, window.dvelocity, C_nb, bias)
    _compiled_sums()(*map(of_kernel, given), sums)
    return sums


@cache
def _compiled_sums() -> Callable[..., None]:
    """Return `_sum_steps` compiled, which takes a fiftieth of what NumPy needs for as many short arrays."""
    from lab.base.compiling.compiled_cache import compile_cached  # noqa: PLC0415 - loads the compiler

    options = {"nopython": True, "error_model": "numpy", "nogil": True, "_nrt": False}
    return cast(Callable[..., None], compile_cached(_sum_steps, options))


def _sum_steps(
    time: FloatArray,
    dtheta: FloatArray,
    dvelocity: FloatArray,
    C_nb: FloatArray,
    bias: FloatArray,
    sums: FloatArray,
) -> None:
    """Fill sums (k + 1, 30), the first of which are zeros, with those until the end of each step.

    They are velocity, and ∫ [f ×] dt, ∫ [f ×] ∫ C dt dt and ∫ C dt by rows, of f and C in n.
    """
    a, b, c, d = 1.0, 0.0, 0.0, 0.0  # the quaternion of C_b0b
    for k in range(len(dtheta)):
        dt = time[k + 1] - time[k]
        x = 0.5 * (dtheta[k, 0] - bias[0] * dt)
        y = 0.5 * (dtheta[k, 1] - bias[1] * dt)
        z = 0.5 * (dtheta[k, 2] - bias[2] * dt)
        half = 0.5 * math.sqrt(x * x + y * y + z * z)
        by = 0.5 * (math.sin(half) / half if half > 0.0 else 1.0)
        w, x, y, z = math.cos(half), by * x, by * y, by * z
        # The attitude in the middle of each step; a whole step is twice the half.
        e, f, g, h = (
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        )
        a, b, c, d = (
            e * w - f * x - g * y - h * z,
            e * x + f * w + g * z - h * y,
            e * y - f * z + g * w + h * x,
            e * z + f * y - g * x + h * w,
        )
        before, after = sums[k], sums[k + 1]
        for i in range(3):
            p, q, r = C_nb[i, 0], C_nb[i, 1], C_nb[i, 2]
            C = (
                p * (1 - 2 * (g * g + h * h)) + q * 2 * (f * g + e * h) + r * 2 * (f * h - e * g),
                p * 2 * (f * g - e * h) + q * (1 - 2 * (f * f + h * h)) + r * 2 * (g * h + e * f),
                p * 2 * (f * h + e * g) + q * 2 * (g * h - e * f) + r * (1 - 2 * (f * f + g * g)),
            )
            after[i] = 0.0
            for j in range(3):
                after[i] += C[j] * (dvelocity[k, j] - bias[3 + j] * dt)
                after[21 + 3 * i + j] = before[21 + 3 * i + j] + C[j] * dt
        for i in range(3):
            j, n = (i + 1) % 3, (i + 2) % 3
            after[3 + 4 * i] = before[3 + 4 * i]
            after[3 + 3 * i + j] = before[3 + 3 * i + j] - after[n]
            after[3 + 3 * i + n] = before[3 + 3 * i + n] + after[j]
            for m in range(3):
                # Up to the middle of each step: a gyro bias turns all later attitudes by ∫ C dt.
                swing_j = 0.5 * (before[21 + 3 * j + m] + after[21 + 3 * j + m])
                swing_n = 0.5 * (before[21 + 3 * n + m] + after[21 + 3 * n + m])
                after[12 + 3 * i + m] = before[12 + 3 * i + m] + after[j] * swing_n - after[n] * swing_j
        for i in range(3):
            after[i] += before[i]
        after[2] += STANDARD_GRAVITY * dt
