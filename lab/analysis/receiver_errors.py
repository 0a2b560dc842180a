"""Receiver errors: what a receiver's fixes are worth, from the fixes alone.

Neighbouring fixes and the velocities between them show white errors; fixes some time apart show errors that
change slowly. A filter with the states position, velocity, acceleration and slow error predicts each fix from
those before it, and the sizes of the errors are those that make its innovations most likely. The motion is a
random walk of the acceleration, whose size is found with them.

References
----------
F. C. Schweppe, *Evaluation of Likelihood Functions for Gaussian Signals*, IEEE Transactions on Information
Theory 11 (1965): the likelihood of innovations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from lab.analysis.verdicts.finding import is_right
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.kernels.compilation import entry_kernel, kernel

FEWEST = 60
"""Fewest fixes of a kind whose errors are estimated: σ of the white part is then known within 10 %."""
OUTLIER = 5.0
"""Innovation in its σ from which a component of a fix is an outlier: chance makes one of 1.7 million."""
MOST_OUTLIERS = 0.05
"""Part of the components above which apparent outliers show that the model does not fit; none is left out."""
SLOW_GAIN = 8.0
"""Growth of the log-likelihood by which a slow error must pay for its σ and τ: chance gains 8 of two
parameters in one case of 3,000."""
LONGEST_PART = 0.5
"""Longest correlation time, in lengths of the log: slower errors look like the true position."""
SLOW_STARTS = (1.0, -0.5, -2.0)
"""Logarithms of τ in `TAU` from which the search for a slow error begins, too."""
MOTION_STARTS = (1.5, -4.0)
"""Logarithms of the motion [m²/s⁵] from which the search begins: of a car or an aeroplane, and of one at
rest."""
MEDIAN = 0.6745
"""Median size of a normal error, in its σ."""
LEAST_FACTOR = 1e-3
"""Smallest factor from which the search begins."""
TAU = 30.0
"""Correlation time from which the search begins [s]."""
ROUNDED = 12**-0.5
"""σ of rounding, in its step."""
MEMORIES = (3.0, 5.0, 8.0, 12.0, 20.0, 40.0, 80.0)
"""Fixes over which a σ that follows the innovations averages their squares. The longest is also right for a
receiver that stays: of 60 such ones with 500 fixes of two components, it has NIS of 0.9 to 1.1 in the second
half in all, and the sizes of the first half in 77 %, as their own chance allows."""
MEMORY_GAIN = 8.0
"""Growth of the log-likelihood by which a shorter memory than the longest must pay; see `SLOW_GAIN`."""
LEAST_SQUARE = 1e-3
"""Smallest mean square of innovations that it follows: where a receiver repeats itself, they vanish."""
VELOCITY_SIGMA, POSITION_SIGMA = 0.1, 1.0
"""σ that the factors refer to where a receiver claims none [m/s], [m]."""
SHORTEST = 1.0
"""Shortest correlation time of a slow error [s]: faster ones are white, or motion."""
STARTING = 4
"""Fixes that start the filter, and do not count: they show position, velocity and acceleration."""
FAST, FASTEST = 12.0, 1e4
"""Largest logarithm of a factor in the search, and largest motion [m²/s⁵]."""
CONVERGED = 1e-3
"""Change of the log-likelihood and of the logarithms at which the search ends."""
FORBIDDEN = 1e100
"""Cost of sizes that are not allowed; their differences must be numbers."""


class FixSeries(NamedTuple):
    """Fixes along one axis or several, in metres.

    Attributes
    ----------
    time : (m,) array
        Times [s].
    position, velocity : (m, axes) arrays
        [m], [m/s]; NaN where not measured.
    position_sigma, velocity_sigma : (m, axes) arrays
        σ that the receiver claims, or NaN.
    kind : (m,) array
        Number of the kind of each fix, from 0 without gaps.
    rounded : (float, float)
        σ of the rounding of position [m] and velocity [m/s], below which no white error shows.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    position_sigma: FloatArray
    velocity_sigma: FloatArray
    kind: NDArray[np.intp]
    rounded: tuple[float, float] = (0.0, 0.0)

    def rows(self, rows: slice) -> FixSeries:
        """Return some of the fixes."""
        return FixSeries(
            self.time[rows],
            self.position[rows],
            self.velocity[rows],
            self.position_sigma[rows],
            self.velocity_sigma[rows],
            self.kind[rows],
            self.rounded,
        )

    def along(self, axes: slice) -> FixSeries:
        """Return the fixes along some axes."""
        return FixSeries(
            self.time,
            self.position[:, axes],
            self.velocity[:, axes],
            self.position_sigma[:, axes],
            self.velocity_sigma[:, axes],
            self.kind,
            self.rounded,
        )


class AxisErrors(NamedTuple):
    """The errors of a receiver along one axis, or two alike.

    Attributes
    ----------
    white : (kinds,) array
        Factor on the claimed σ of the position, of each kind; σ itself [m] if none is claimed.
    velocity : float
        The same for the velocity, of all kinds [m/s]; NaN without velocities.
    slow, tau : float
        σ [m] and correlation time [s] of the slow error; 0 and NaN if the fixes show none.
    motion : float
        Intensity of the random walk of the acceleration [m²/s⁵].
    likelihood : float
        Log-likelihood.
    """

    white: FloatArray
    velocity: float
    slow: float
    tau: float
    motion: float
    likelihood: float


class Predicted(NamedTuple):
    """Each fix as those before it predict it.

    Attributes
    ----------
    innovation, sigma : (m, axes, 2) arrays
        Position and velocity: fix minus prediction and its σ; NaN where not measured.
    outlier : (m, axes, 2) array
        Components that were left out.
    nis : (m,) array
        Sum of the squares of the components in their σ, decorrelated, without outliers.
    degrees : (m,) array
        Their number.
    likelihood : float
        Sum of the log-likelihoods.
    """

    innovation: FloatArray
    sigma: FloatArray
    outlier: NDArray[np.bool_]
    nis: FloatArray
    degrees: FloatArray
    likelihood: float


def fit(fixes: FixSeries) -> AxisErrors:
    """Return the most likely errors of a receiver along the axes of the fixes, all alike.

    Parameters
    ----------
    fixes
        The fixes; each kind should have at least `FEWEST`.
    """
    kinds = int(fixes.kind.max()) + 1
    has_velocity = bool(np.isfinite(fixes.velocity).any())
    scale = float(np.nanmedian(_claimed_sigma(fixes.position_sigma, POSITION_SIGMA)))
    fast = float(np.nanmedian(_claimed_sigma(fixes.velocity_sigma, VELOCITY_SIGMA)))
    longest = max(LONGEST_PART * float(np.ptp(fixes.time)), 2 * SHORTEST)
    first = _initial_factors(fixes, kinds, has_velocity=has_velocity)

    # x: logarithms of a factor for each kind, of velocity, of the motion, and of σ and τ of a slow error.
    def errors(x: FloatArray, *, slow: bool) -> AxisErrors:
        # A factor on the claimed σ, below which rounding leaves nothing.
        size = scale * math.exp(x[-2]) if slow else 0.0
        tau = TAU * math.exp(x[-1]) if slow else math.nan
        motion = math.exp(x[kinds + 1])
        white = np.maximum(np.exp(x[:kinds]), fixes.rounded[0] / scale)
        return AxisErrors(white, max(math.exp(x[kinds]), fixes.rounded[1] / fast), size, tau, motion, 0.0)

    def cost(x: FloatArray, slow: bool, outlier: NDArray[np.bool_]) -> float:
        # The simplex may wander off, where `exp` overflows.
        x = np.clip(x, -FAST, FAST)
        one = errors(x, slow=slow)
        if one.motion > FASTEST or (slow and not SHORTEST < one.tau < longest):
            return FORBIDDEN
        return -predict(fixes, one, outlier).likelihood

    outlier = np.zeros((*fixes.position.shape, 2), np.bool_)
    starts = [np.append(first, motion) for motion in MOTION_STARTS]
    # The second round is without the outliers that the first one shows.
    for _ in range(2):
        best, place = _search(cost, starts, outlier, errors)
        starts = [place]
        outlier = drop_outliers(fixes, best).outlier
        if not outlier.any():
            break
    return best if has_velocity else best._replace(velocity=math.nan)


def _initial_factors(fixes: FixSeries, kinds: int, *, has_velocity: bool) -> FloatArray:
    """Return the logarithms of the factors of position, kind by kind, and velocity from second differences.

    What two neighbouring fixes differ by beyond the mean of their velocities has the variance
    2 σ_p² + Δt² σ_v²/2; second differences of the velocities have 6 σ_v². Motion adds to both.
    """
    dt = np.diff(fixes.time)[:, None]
    own = _claimed_sigma(fixes.velocity_sigma, VELOCITY_SIGMA)
    fast = np.full(1, 1.0)
    if has_velocity:
        fast = np.abs(np.diff(fixes.velocity, 2, axis=0) / own[1:-1]) / math.sqrt(6)
        apart = np.diff(fixes.position, axis=0) - dt * (fixes.velocity[1:] + fixes.velocity[:-1]) / 2
        fall = math.sqrt(2)
    if not has_velocity or not np.isfinite(apart).any():
        apart, fall = np.diff(fixes.position, 2, axis=0), math.sqrt(6)
    relative = np.abs(apart) / (fall * _claimed_sigma(fixes.position_sigma, POSITION_SIGMA)[-len(apart) :])
    kind = fixes.kind[-len(apart) :]
    sizes = [np.nanmedian(relative[kind == one]) if (kind == one).any() else 1.0 for one in range(kinds)]
    sizes.append(np.nanmedian(fast) if has_velocity else MEDIAN)
    return np.log(np.maximum(np.array(sizes) / MEDIAN, LEAST_FACTOR))


def with_motion(fixes: FixSeries, errors: AxisErrors) -> AxisErrors:
    """Return the errors with the motion that is most likely in some fixes, which is not the receiver's."""

    def cost(logarithm: float) -> float:
        return -drop_outliers(fixes, errors._replace(motion=math.exp(logarithm))).likelihood

    found = scipy.optimize.minimize_scalar(cost, bounds=(-FAST, math.log(FASTEST)), method="bounded")
    return errors._replace(motion=math.exp(float(found.x)))


def _search(
    cost: Callable[[FloatArray, bool, NDArray[np.bool_]], float],
    starts: Sequence[FloatArray],
    outlier: NDArray[np.bool_],
    errors: Callable[..., AxisErrors],
) -> tuple[AxisErrors, FloatArray]:
    """Return the most likely errors, with a slow one if it pays, and the place of those without."""
    plain = [_minimize_cost(lambda x: cost(x, False, outlier), start) for start in starts]
    place, without = min(plain, key=lambda one: one[1])
    found = [
        _minimize_cost(lambda x: cost(x, True, outlier), np.append(place, [float(place[0]), begin]))
        for begin in SLOW_STARTS
    ]
    slow = min(found, key=lambda one: one[1])
    is_slow = without - slow[1] > SLOW_GAIN
    best, least = slow if is_slow else (place, without)
    chosen = errors(np.clip(best, -FAST, FAST), slow=is_slow)
    return chosen._replace(likelihood=-least), place


def rounding(values: FloatArray) -> float:
    """Return σ of the rounding of numbers (m, axes): that of the least step between neighbours."""
    steps = np.abs(np.diff(values, axis=0))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return ROUNDED * float(steps.min()) if steps.size else 0.0


def _minimize_cost(cost: Callable[[FloatArray], float], start: FloatArray) -> tuple[FloatArray, float]:
    """Return the place of the least cost, and the cost there."""
    found = scipy.optimize.minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "xatol": CONVERGED,
            "fatol": CONVERGED,
            "maxiter": 150 * start.size,
            "adaptive": True,
            "initial_simplex": np.vstack([start, *(start + np.eye(start.size))]),
        },
    )
    return np.asarray(found.x), float(found.fun)


def predict(fixes: FixSeries, errors: AxisErrors, outlier: NDArray[np.bool_] | None = None) -> Predicted:
    """Return each fix as those before it predict it.

    Parameters
    ----------
    fixes
        The fixes.
    errors
        The errors.
    outlier : (m, axes, 2) array
        Components to leave out; by default those beyond `OUTLIER`.
    """
    count, axes = fixes.position.shape
    white = errors.white[fixes.kind][:, None] * _claimed_sigma(fixes.position_sigma, POSITION_SIGMA)
    fast = (1.0 if math.isnan(errors.velocity) else errors.velocity) * _claimed_sigma(
        fixes.velocity_sigma, VELOCITY_SIGMA
    )
    seen = np.full((count, axes, 2), np.nan)
    sizes, nis, degrees = np.full((count, axes, 2), np.nan), np.zeros(count), np.zeros(count)
    left = np.zeros((count, axes, 2), np.bool_) if outlier is None else outlier.copy()
    tau = errors.tau if errors.slow > 0 else TAU
    numbers = np.array([errors.slow, tau, errors.motion, OUTLIER if outlier is None else math.inf])
    steps = np.append(0.0, np.diff(fixes.time))
    likelihood = 0.0
    for axis in range(axes):
        likelihood += _follow(
            steps,
            of_kernel(fixes.position[:, axis] - np.nanmedian(fixes.position[:, axis])),
            of_kernel(fixes.velocity[:, axis]),
            of_kernel(white[:, axis]),
            of_kernel(fast[:, axis]),
            numbers,
            left[:, axis],
            seen[:, axis],
            sizes[:, axis],
            nis,
            degrees,
        )
    return Predicted(seen, sizes, left, nis, degrees, likelihood)


def drop_outliers(fixes: FixSeries, errors: AxisErrors) -> Predicted:
    """Return the predictions without outliers; with too many of them, none is one."""
    found = predict(fixes, errors)
    if found.outlier.mean() <= MOST_OUTLIERS:
        return found
    return predict(fixes, errors, np.zeros_like(found.outlier))


def quarters(squares: FloatArray, degrees: FloatArray) -> tuple[tuple[float, float], bool]:
    """Return the smallest and the largest mean square in four parts, and whether they differ beyond chance.

    Parameters
    ----------
    squares, degrees : (m,) arrays
        NIS of each fix, and the number of its components. With fewer than `FEWEST` in a part, or none that
        differs from its prediction, nothing is known.
    """
    parts = list(zip(*(np.array_split(one, 4) for one in (squares, degrees)), strict=True))
    numbers = [float(own.sum()) for _, own in parts]
    if min(numbers) < FEWEST or not squares.any():
        return (math.nan, math.nan), False
    found = [float(values.sum()) / number for (values, _), number in zip(parts, numbers, strict=True)]
    mean = float(squares.sum()) / sum(numbers)
    apart = [not is_right(one / mean * number, number) for one, number in zip(found, numbers, strict=True)]
    return (min(found), max(found)), any(apart)


def expected_squares(squares: FloatArray, degrees: FloatArray, memory: float) -> FloatArray:
    """Return the mean square (m,) that is expected of each fix by those before it.

    Parameters
    ----------
    squares, degrees : (m,) arrays
        NIS of each fix, and the number of its components.
    memory
        Number of fixes over which the squares are averaged, with weights that fall exponentially.
    """
    gain = 1 / memory
    # Clipped, so that one outlier does not open the gate for those after it.
    found = np.clip(squares / np.maximum(degrees, 1), LEAST_SQUARE, OUTLIER**2)
    found = np.where(degrees > 0, found, 1.0)
    # m ← m + (x − m) / memory, from 1 on.
    mean, _ = scipy.signal.lfilter([gain], [1.0, gain - 1.0], found, zi=np.array([1.0 - gain]))
    return np.concatenate(([1.0], mean[:-1]))


def fit_memory(squares: FloatArray, degrees: FloatArray) -> tuple[float, float]:
    """Return memory and scale of a σ that follows the innovations; see `expected_squares`.

    The squares of these fixes are one on average in what is expected of them, times the scale. It stands for
    the chance of an average over few fixes, whose inverse is too large on average. The memory is the one
    that makes them most likely.

    Parameters
    ----------
    squares, degrees : (m,) arrays
        NIS of each fix, and the number of its components.
    """

    def tried(memory: float) -> tuple[float, float, float]:
        expected = expected_squares(squares, degrees, memory)
        scale = float(np.sum(squares / expected) / degrees.sum())
        likelihood = -0.5 * float(np.sum(degrees * np.log(scale * expected)) + degrees.sum())
        return likelihood, memory, scale

    longest = tried(MEMORIES[-1])
    best = max(tried(memory) for memory in MEMORIES)
    return best[1:] if best[0] > longest[0] + MEMORY_GAIN else longest[1:]


def _claimed_sigma(sigma: FloatArray, otherwise: float) -> FloatArray:
    """Return σ of fixes; where a receiver claims none, the one that factors refer to."""
    return np.asarray(np.where(np.isfinite(sigma), sigma, otherwise))


@kernel
def _move(
    x: FloatArray, P: FloatArray, F: FloatArray, work: FloatArray, dt: float, numbers: FloatArray
) -> None:
    """Move estimate and covariance on by a step [s], with the noise of the motion and of the slow error."""
    slow, tau, motion = numbers[0], numbers[1], numbers[2]
    decay = np.exp(-dt / tau)
    F[0, 1], F[0, 2], F[1, 2], F[3, 3] = dt, 0.5 * dt * dt, dt, decay
    for i in range(4):
        for j in range(4):
            work[i, j] = 0.0
            for m in range(4):
                work[i, j] += F[i, m] * P[m, j]
    x[0] += dt * x[1] + 0.5 * dt * dt * x[2]
    x[1] += dt * x[2]
    x[3] *= decay
    for i in range(4):
        for j in range(4):
            P[i, j] = 0.0
            for m in range(4):
                P[i, j] += work[i, m] * F[j, m]
    # White jerk, integrated exactly to acceleration, velocity and position.
    P[0, 0] += motion * dt**5 / 20
    P[0, 1] += motion * dt**4 / 8
    P[1, 0] = P[0, 1]
    P[0, 2] += motion * dt**3 / 6
    P[2, 0] = P[0, 2]
    P[1, 1] += motion * dt**3 / 3
    P[1, 2] += motion * dt**2 / 2
    P[2, 1] = P[1, 2]
    P[2, 2] += motion * dt
    P[3, 3] += slow * slow * (1 - decay * decay)


@entry_kernel
def _follow(
    steps: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    white: FloatArray,
    fast: FloatArray,
    numbers: FloatArray,
    left: NDArray[np.bool_],
    seen: FloatArray,
    sizes: FloatArray,
    nis: FloatArray,
    degrees: FloatArray,
) -> float:
    """Filter the fixes along an axis, and return the log-likelihood of all but the first few."""
    slow, gate = numbers[0], numbers[3]
    x, P, F = np.zeros(4), np.zeros((4, 4)), np.eye(4)
    work, column = np.zeros((4, 4)), np.zeros(4)
    x[0] = position[0]
    # Unknown: 10 km, 100 m/s, 10 m/s²; the slow error is in its steady state.
    P[0, 0], P[1, 1], P[2, 2], P[3, 3] = 1e8, 1e4, 1e2, slow * slow
    total = 0.0
    for k in range(position.size):
        if steps[k] > 0:
            _move(x, P, F, work, steps[k], numbers)
        for part in range(2):
            value = position[k] if part == 0 else velocity[k]
            if not np.isfinite(value):
                continue
            r = white[k] if part == 0 else fast[k]
            # The slow error is one of positions only.
            share = 1.0 if part == 0 else 0.0
            S = r * r
            for i in range(4):
                column[i] = P[i, part] + share * P[i, 3]
            S += column[part] + share * column[3]
            residual = value - x[part] - share * x[3]
            seen[k, part], sizes[k, part] = residual, np.sqrt(S)
            if k >= STARTING and residual * residual > gate * gate * S:
                left[k, part] = True
            if left[k, part]:
                continue
            if k >= STARTING:
                total -= 0.5 * (residual * residual / S + np.log(S))
                nis[k] += residual * residual / S
                degrees[k] += 1
            for i in range(4):
                x[i] += column[i] / S * residual
            for i in range(4):
                for j in range(i + 1):
                    P[i, j] -= column[i] * column[j] / S
                    P[j, i] = P[i, j]
    return total
