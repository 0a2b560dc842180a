"""Foreign delay: whether the innovations of a filter that is not ours follow the motion as with late fixes.

Fixes that are late by τ are off by -τ v in position and by -τ a in velocity. What a filter leaves of that in
its innovations depends on its gains, which a log does not state. Its logged variances of the innovations and
the motion fix them but for the noise of its inertial sensors, so that a filter of the usual form, with
position, velocity and attitude, runs along the flight with several of them; the best one counts.

Most of an innovation is the noise of its own fix. It shows in the velocities of the fixes, beside a smooth
curve, so that it is taken out first; it also shows whether the log counts fix minus prediction.

An antenna that is behind where the filter takes it to be makes the same as late fixes, as long as the speed
does not change, and so does a wrong heading in an even turn. They are compared: where the motion does not
tell the antenna from a delay, the finding names both.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2:
the error model of the usual form.

H. White, *A Heteroskedasticity-Consistent Covariance Matrix Estimator*, Econometrica 48 (1980): σ of an
estimate from its residuals; here from parts of the log, since innovations depend on each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Weighed
from lab.analysis.verdicts.finding_table import FOREIGN_FINDINGS
from lab.analysis.verdicts.foreign_evidence import FEWEST, SETTLED, Measurement
from lab.base.arrays import Flags, FloatArray, of_kernel
from lab.base.numbers import format_number
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.log.filter_log import AXES, nearest
from lab.data.log.sensor_log import GnssLog
from lab.navigation.kernels.compilation import entry_kernel, kernel

ACCELEROMETERS = (0.004, 0.02, 0.1)
"""Noise of the accelerometers that is tried [m/s²/√Hz]: that of a good MEMS, to what autopilots assume."""
GYROS = (0.0, 1e-4, 7e-4, 5e-3)
"""The same of the gyros [rad/s/√Hz]; 0 for a filter that takes the attitude as known."""
SMOOTHED = 1.6
"""Half of the time over which a velocity is a parabola [s]: vehicles change their acceleration in seconds."""
NEIGHBOURS = (-1, 0, 1, 2)
"""Fixes before an innovation whose noise is taken out one by one: clocks of a log differ by a fix."""
MEMORIES = (0.5, 0.3, 0.15, 0.08, 0.04)
"""Gains of the averages of earlier noise that are taken out: what filters with these gains remember."""
LEAST_WINDOWS = 4
"""Fewest halves of that time that a log must have."""
LONGEST_STEP = 10
"""Longest time between fixes, in usual ones, in a response: fixes beside a longer gap are not judged."""
PARTS = 24
"""Parts of a log whose estimates give the σ of a delay."""
MANY = 2 * PARTS * len(MEMORIES)
"""Fewest fixes that are judged."""
FUSED_WITHIN = 1.5
"""Longest time from a fix to an innovation by which it was fused [s]: logs hold some of them only."""
LEAST_NOISE = 0.05
"""Least part of the variance of an innovation that is the measurement's own."""
CERTAIN = 5.0
"""t-value from which the sign of innovations is known."""
SLOWEST = 0.5
"""Speed below which a course is unknown [m/s]."""
START = (0.05, 0.5)
"""σ of tilts and heading at the start of the log [rad]."""
FIRST = 100.0
"""Largest variance of position and velocity at the start of the log [m²], [m²/s²]."""
UNUSED = 1e30
"""Variance of what was not fused."""
_NAMES = {"m": "position", "m/s": "velocity"}


class Delay(NamedTuple):
    """What innovations of the fixes say of their delay.

    Attributes
    ----------
    size, sigma : float
        Delay beyond that which the filter assumes, and its σ by parts of the log [s].
    growth : float
        Of the log-likelihood by it.
    along, heading : float
        The same by an antenna farther back, and by an error of the heading, in its place.
    speed : float
        Root mean square [m/s].
    number : int
        Of fixes.
    """

    size: float
    sigma: float
    growth: float
    along: float
    heading: float
    speed: float
    number: int


def fix_delay(judged: Sequence[Measurement], gnss: GnssLog, epoch: float) -> Delay | None:
    """Return what the innovations of the fixes say of their delay; None if the log does not show it.

    Parameters
    ----------
    judged
        Innovations of the measurements of a filter.
    gnss
        The fixes of the same log.
    epoch
        Time of the log at their time zero [s].
    """
    velocity = np.asarray(gnss.velocity_n)
    fine = np.isfinite(velocity).all(axis=1)
    at, velocity = (gnss.time - gnss.latency + epoch)[fine], velocity[fine]
    if len(at) < MANY:
        return None
    period = float(np.median(np.diff(at)))
    width = max(2, round(SMOOTHED / period)) if period > 0 else len(at)
    if width > len(at) // LEAST_WINDOWS:
        return None  # damaged times, or too few fixes
    nu, variance = _on_fixes(judged, at, period)
    smooth = scipy.signal.savgol_filter(velocity, 2 * width + 1, 2, axis=0)
    acceleration = scipy.signal.savgol_filter(velocity, 2 * width + 1, 2, deriv=1, delta=period, axis=0)
    noise = _noise(velocity - smooth)
    step = np.append(np.diff(at), period)
    whole = ~scipy.ndimage.binary_dilation(np.abs(step - period) > period / 2, iterations=width)
    whole[: max(SETTLED, width)] = whole[-width:] = False
    rows = [whole & np.isfinite(nu[:, one]) for one in range(6)]
    used = [one for one in range(6) if rows[one].sum() > MANY and np.ptp(nu[rows[one], one]) > 0]
    sign = _sign(noise, nu, rows, used)
    if not sign:
        return None
    bases = [np.linalg.qr(noise[one % 3][rows[one]])[0] for one in range(6)]
    left = [_remove_basis(bases[one], sign * nu[rows[one], one]) for one in used]
    sizes = [float(np.std(one)) for one in left]
    if not min(sizes) > 0:
        return None
    y = np.concatenate([one / size for one, size in zip(left, sizes, strict=True)])
    part = np.concatenate([np.flatnonzero(rows[one]) for one in used]) * PARTS // len(at)
    errors = _errors(smooth, acceleration, period, width)
    best, heading = None, 0.0
    for densities in product(ACCELEROMETERS, GYROS):
        found = np.empty_like(errors)
        _respond(
            of_kernel(acceleration), of_kernel(np.clip(step, 0, LONGEST_STEP * period)), of_kernel(variance),
            errors, np.array([*densities, *(START if densities[1] else (0.0, 0.0))]), found,
        )  # fmt: skip
        found /= np.sqrt(variance)[:, :, None]
        x = np.concatenate([
            _remove_basis(bases[one], found[rows[one], one]) / size
            for one, size in zip(used, sizes, strict=True)
        ])  # fmt: skip
        late, along, turned = (_fit_response(one, y, part) for one in x.T)
        heading = max(heading, turned[2])
        if late[2] > (0.0 if best is None else best.growth):
            speed = float(np.sqrt(np.mean(np.sum(smooth**2, axis=1))))
            best = Delay(*late, along[2], 0.0, speed, int(whole.sum()))
    return None if best is None else best._replace(heading=heading)


def _on_fixes(judged: Sequence[Measurement], at: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Return normalised innovations (m, 6) of position and velocity at the fixes, and their variances.

    An innovation that was not logged is NaN, and the variance of one that was not fused is beyond any other.
    """
    nu, variance = np.full((len(at), 6), np.nan), np.full((len(at), 6), UNUSED)
    for one in judged:
        innovations = one.innovations
        name = _NAMES.get(innovations.unit)
        if name is None or not innovations.name.startswith(("GPS", name)) or one.count < FEWEST:
            continue
        rows, back = nearest(at, innovations.time), nearest(innovations.time, at)
        own = np.abs(at[rows] - innovations.time) < period
        fused = np.abs(innovations.time[back] - at) < max(FUSED_WITHIN, period)
        for column, axis in enumerate(innovations.axes):
            if axis not in AXES:
                continue
            place = AXES.index(axis) + 3 * (name == "velocity")
            values, normalised = innovations.values[:, column], innovations.normalised[:, column]
            with np.errstate(invalid="ignore", divide="ignore"):
                squares = (values / normalised) ** 2
            known = np.isfinite(squares) & (squares > 0)
            if known.sum() < FEWEST:
                continue
            squares = np.where(known, squares, np.median(squares[known]))
            nu[rows[own], place] = normalised[own]
            variance[fused, place] = squares[back[fused]]
    return nu, variance


def _noise(deviations: FloatArray) -> list[FloatArray]:
    """Return what the noise of the fixes near an innovation and before may add to it, for each axis."""
    earlier = np.roll(deviations, 1, axis=0)
    columns = [np.roll(deviations, back, axis=0) for back in NEIGHBOURS]
    columns += [scipy.signal.lfilter([gain], [1.0, gain - 1.0], earlier, axis=0) for gain in MEMORIES]
    return [np.column_stack([one[:, axis] for one in columns]) for axis in range(3)]


def _remove_basis(basis: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(values - basis @ (basis.T @ values))


def _sign(noise: list[FloatArray], nu: FloatArray, rows: list[Flags], used: list[int]) -> int:
    """Return 1 if innovations are fix minus prediction, -1 for the opposite, and 0 if that is unknown."""
    found = 0.0
    for one in used:
        if one < len(AXES):
            continue  # a position has another noise than a velocity
        own, values = noise[one % 3][rows[one]][:, : len(NEIGHBOURS)], nu[rows[one], one]
        scale = np.linalg.norm(own, axis=0) * np.linalg.norm(values)
        if (scale > 0).all():
            alike = (own.T @ values) / scale * np.sqrt(len(values))
            found += float(alike[np.argmax(np.abs(alike))])
    return 0 if abs(found) < CERTAIN else int(np.sign(found))


def _errors(smooth: FloatArray, acceleration: FloatArray, period: float, width: int) -> FloatArray:
    """Return the errors (m, 6, 3) of fixes late by 1 s, of an antenna as far back, and of right fixes."""
    speed = np.linalg.norm(smooth, axis=1, keepdims=True)
    course = smooth / np.maximum(speed, SLOWEST) * np.sqrt(np.mean(speed**2))
    turning = scipy.signal.savgol_filter(course, 2 * width + 1, 2, deriv=1, delta=period, axis=0)
    late, back = np.hstack((smooth, acceleration)), np.hstack((course, turning))
    return np.ascontiguousarray(-np.stack((late, back, np.zeros_like(late)), axis=2))


def _fit_response(x: FloatArray, y: FloatArray, part: FloatArray) -> tuple[float, float, float]:
    """Return a multiple of a response, its σ by parts of the log, and the growth of the log-likelihood."""
    square = float(x @ x)
    if not 0 < square < np.inf:
        return 0.0, np.inf, 0.0
    size = float(x @ y / square)
    left = y - size * x
    # By parts: what a filter leaves is not white, so that σ by single values would be too small.
    gradients = np.bincount(part, x * left, PARTS)
    growth = y.size / 2 * float(np.log((y @ y) / max(float(left @ left), 1e-300)))
    return size, float(np.linalg.norm(gradients)) / square, growth


@kernel
def _correct(
    x: FloatArray, P: FloatArray, i: int, variance: float, errors: FloatArray, column: FloatArray
) -> None:
    """Correct the responses x (9, k) and P by component i of a fix with errors (k,)."""
    # A logged variance may be below ours, and P would become negative: a part is always noise.
    total = max(variance, P[i, i] / (1 - LEAST_NOISE))
    for j in range(9):
        column[j] = P[j, i]
    for m in range(errors.size):
        nu = (errors[m] - x[i, m]) / total
        for j in range(9):
            x[j, m] += column[j] * nu
    for j in range(9):
        for m in range(9):
            P[j, m] -= column[j] * column[m] / total


@kernel
def _times(F: FloatArray, values: FloatArray, work: FloatArray) -> None:
    """Write F times values (9, k) over them."""
    for m in range(values.shape[1]):
        for i in range(9):
            work[i] = 0.0
            for j in range(9):
                work[i] += F[i, j] * values[j, m]
        for i in range(9):
            values[i, m] = work[i]


@entry_kernel
def _respond(
    acceleration: FloatArray,
    step: FloatArray,
    variance: FloatArray,
    errors: FloatArray,
    numbers: FloatArray,
    found: FloatArray,
) -> None:
    """Write what errors (m, 6, k) of fixes leave in the innovations of a filter of the usual form.

    `numbers` are the noise of accelerometers and gyros, and σ of tilts and heading at the start. The last
    errors have an error of the heading of 1 rad beside them.
    """
    P, F, x, work = np.zeros((9, 9)), np.eye(9), np.zeros((9, errors.shape[2])), np.zeros(9)
    for i in range(3):
        P[i, i], P[3 + i, 3 + i] = min(variance[0, i], FIRST), min(variance[0, 3 + i], FIRST)
        P[6 + i, 6 + i] = numbers[3 if i == 2 else 2] ** 2
    for k in range(step.size):
        found[k] = errors[k] - x[:6]
        for i in range(6):
            if variance[k, i] < UNUSED:
                _correct(x, P, i, variance[k, i], errors[k, i], work)
        dt = step[k]
        f, g = acceleration[k, 0] * dt, acceleration[k, 1] * dt
        h = (acceleration[k, 2] - STANDARD_GRAVITY) * dt
        F[3, 7], F[3, 8], F[4, 6] = -h, g, h
        F[4, 8], F[5, 6], F[5, 7] = -f, -g, f
        for i in range(3):
            F[i, 3 + i] = dt
            # What a tilt adds to the velocity over a step acts on the position for half of it.
            F[i, 6:] = 0.5 * dt * F[3 + i, 6:]
        _times(F, x, work)
        x[3, -1] += g  # what an error of the heading makes of the acceleration
        x[4, -1] -= f
        _times(F, P, work)
        # F (F P)ᵀ, written through the transpose, is F P Fᵀ.
        _times(F, P.T, work)
        for i in range(3):
            P[3 + i, 3 + i] += numbers[0] ** 2 * dt
            P[6 + i, 6 + i] += numbers[1] ** 2 * dt


def of_delay(judged: Sequence[Measurement], gnss: GnssLog, epoch: float) -> list[Weighed]:
    """Return the finding that fixes are later or earlier than the filter assumes, if innovations show it."""
    found = fix_delay(judged, gnss, epoch)
    allowed = limits.VERDICT
    if found is None or not allowed.foreign_delay <= abs(found.size) <= allowed.longest_delay:
        return []
    least = max(allowed.delay_gain, allowed.delay_over_heading * found.heading)
    if abs(found.size) < allowed.delay_sigmas * found.sigma or found.growth < least:
        return []
    sources = ", ".join(one.innovations.source for one in judged if one.innovations.unit in _NAMES)
    evidence = (
        f"{format_number(found.size)} ± {format_number(found.sigma)} s by the velocities of the fixes; "
        "growth of the "
        f"log-likelihood {found.growth:.0f}, by an antenna farther back {found.along:.0f}, by a wrong "
        f"heading {found.heading:.0f}; {found.number} fixes ({sources})"
    )
    alike = " at one speed" if found.along > allowed.delay_part * found.growth else ""
    size = abs(found.size)
    finding = FOREIGN_FINDINGS[("late" if found.size > 0 else "early") + alike].finding(
        found.size, evidence, size=format_number(size), way=format_number(size * found.speed)
    )
    return [Weighed(float("inf"), finding)]  # it stands before what it explains
