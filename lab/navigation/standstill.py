"""Standstill: when a vehicle stands still, and what its gyros then say of their biases.

At rest only the Earth turns the IMU, so that the mean of the gyros is their bias and the Earth's rate. A
filter that does not use this lets its heading drift with the bias, and its model, linearised along that
heading, shows information that is not there.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 15.3
(zero angular rate updates); D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd
ed., ch. 10.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from lab.navigation import strapdown
from lab.navigation.compilation import kernel
from lab.navigation.solution import Belief, Fixes, Imu
from lab.navigation.strapdown import Vector, get, matrix, put, rotate

FloatArray = NDArray[np.float64]

SPAN = 1.0
"""Time over which the gyros are averaged for one update [s]."""
SHORTEST = 10
"""Seconds in a row that look like rest before any of them counts; a walker pauses for less [s]."""
SLOW = 16.3
"""Largest square of a GPS velocity in its σ at rest: what 99.9 % of three components stay below."""
LEAST_SPEED = 0.05
"""σ below which the noise of a GPS velocity is not trusted [m/s]."""
RATE_SPREAD = math.radians(0.3)
"""Spread of the rates of a MEMS gyro on a table at 100 Hz; more is allowed if more is assumed [rad/s]."""
FORCE_SPREAD = 0.15
"""Spread of the specific force of a vehicle whose engine is idling [m/s²]."""
RATE_CHANGE = math.radians(0.05)
"""Change of the mean rate from one second to the next beyond its noise [rad/s]."""
NOISE_SIGMAS = 3
"""The spread that is allowed if more noise is assumed, in its σ: the assumed noise may be too small."""
CHANGE_SIGMAS = 5
"""The change allowed beside it, in σ of the difference of two means: three axes in each second of a log."""
NEAREST = 0.5
"""Part of a sample by which a time may be missed: the sample nearest to it ends it."""
GATE = 16.0
"""Largest square of a mean rate in its σ that is used: 4 σ, beyond which the vehicle turns slowly."""

SUMS, SQUARES, ELAPSED, COUNT, HELD, ATTITUDE, ROOM = 0, 3, 6, 7, 8, 9, 18
"""Where sums of the rates, of their squares, time and samples are kept, whether an attitude is, and which."""


def at_rest(imu: Imu, fixes: Fixes, belief: Belief) -> NDArray[np.bool_]:
    """Return in which samples (n,) the vehicle stands still, by GPS velocities and the spread of the IMU.

    Parameters
    ----------
    imu, fixes, belief
        The measurements, and what the filter assumes of them.
    """
    n = imu.dtheta.shape[0]
    rest = np.zeros(n, dtype=np.bool_)
    seconds = int((imu.time[-1] - imu.time[0]) / SPAN)
    slow = _slow(imu.time[0] + SPAN * np.arange(seconds), fixes, belief)
    for first, last in _stretches(slow):
        edges = np.searchsorted(imu.time, imu.time[0] + SPAN * np.arange(first, last + 1) - 1e-9)
        still = _still(imu, belief, edges)
        for a, b in _stretches(still):
            rest[edges[a] : edges[b]] = True
    rest.setflags(write=False)
    return rest


def _slow(seconds: FloatArray, fixes: Fixes, belief: Belief) -> NDArray[np.bool_]:
    """Return which seconds have fixes about them, and none that shows a speed."""
    variance = np.diagonal(belief.fix_covariance(np.arange(fixes.time.size)), axis1=-2, axis2=-1)[..., 3:]
    squares = np.sum(fixes.velocity_n**2 / np.maximum(variance, LEAST_SPEED**2), axis=1)
    fast = np.concatenate(([0], np.cumsum(squares > SLOW)))
    first, last = (np.searchsorted(fixes.time, seconds + shift) for shift in (-SPAN, 2 * SPAN))
    return np.asarray((last > first) & (fast[last] == fast[first]))


def _still(imu: Imu, belief: Belief, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return in which seconds between the samples `edges` the IMU shows neither shaking nor turning."""
    still = np.zeros(edges.size - 1, dtype=np.bool_)
    mean_before = None
    for second, (a, b) in enumerate(itertools.pairwise(edges)):
        if b - a < 2:
            mean_before = None
            continue
        dt = np.diff(imu.time[a : b + 1])[:, None]
        rates, forces = imu.dtheta[a:b] / dt, imu.dvelocity[a:b] / dt
        assumed = NOISE_SIGMAS * np.sqrt(belief.noise[:6] / dt.mean())
        spread = rates.std(axis=0)
        steady = (spread <= np.maximum(RATE_SPREAD, assumed[:3])).all()
        steady &= (forces.std(axis=0) <= np.maximum(FORCE_SPREAD, assumed[3:])).all()
        mean = rates.mean(axis=0)
        if mean_before is not None:
            allowed = RATE_CHANGE + CHANGE_SIGMAS * spread * math.sqrt(2 / (b - a))
            steady &= (np.abs(mean - mean_before) <= allowed).all()
        still[second], mean_before = steady, mean
    return still


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the stretches (first, end) of at least `SHORTEST` flags that are set."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= SHORTEST]


@kernel
def hold_attitude(state: FloatArray, sums: FloatArray, rest: bool) -> None:
    """Hold the attitude along which the error model is linearised for as long as a rest lasts.

    At rest the heading is not observable but through the Earth's rate. Linearised along an estimate that
    varies, the model shows information about it that is not there (G. P. Huang, A. I. Mourikis, S. I.
    Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*, Int. J. Robotics
    Research 29 (2010): first-estimates Jacobian).

    Parameters
    ----------
    state
        The navigator after a step; its `C_NB` and `FORCE_N` are what the error model reads.
    sums
        Workspace, with the attitude held.
    rest
        Whether the vehicle stands still in this sample.
    """
    if not rest:
        for i in range(sums.size):
            sums[i] = 0.0
        return
    if sums[HELD] == 0.0:
        sums[HELD] = 1.0
        for i in range(9):
            sums[ATTITUDE + i] = state[strapdown.C_NB + i]
    x, y, z = get(state, strapdown.PREVIOUS_DVELOCITY)
    for i in range(3):
        a, b, c = get(sums, ATTITUDE + 3 * i)
        put(state, strapdown.C_NB + 3 * i, (a, b, c))
        state[strapdown.FORCE_N + i] = (a * x + b * y + c * z) * state[strapdown.PER_STEP]


@kernel
def gather_rest(state: FloatArray, sums: FloatArray, dt: float) -> bool:
    """Add the rates of a sample at rest, the estimated biases in them; return whether an update is due."""
    for i in range(3):
        rate = state[strapdown.PREVIOUS_DTHETA + i] / dt + state[strapdown.GYRO_BIAS + i]
        sums[SUMS + i] += rate
        sums[SQUARES + i] += rate * rate
    sums[ELAPSED] += dt
    sums[COUNT] += 1
    return bool(sums[ELAPSED] >= SPAN - NEAREST * dt)


@kernel
def see_rest(
    state: FloatArray, frame_rate: Vector, noise: FloatArray, sums: FloatArray, H: FloatArray
) -> float:
    """Return what an update at rest measures, in its σ, write what it sees, and start new sums.

    Rate about the vertical of the navigator minus that of the Earth: −d δb + (ω_ie × φ)_D and noise, with d
    the vertical in b; the noise is that of the gyros over the time, or what their samples show if more.
    The level rates are left to the tilt, which the fixes show: it has the same noise of the gyros, and both
    together would count it twice.

    Parameters
    ----------
    state
        The navigator.
    frame_rate
        The Earth's rate in the navigation frame [rad/s].
    noise : (12,) array
        Densities of the process noise.
    sums
        Of the rates, as of `gather_rest`.
    H : (6,) array
        Receives how the attitude error, in the navigation frame, and the gyro biases are seen.
    """
    at = strapdown.Q_NB
    C = matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    back = (C[0][0], C[1][0], C[2][0]), (C[0][1], C[1][1], C[2][1]), (C[0][2], C[1][2], C[2][2])
    turned = rotate(back, frame_rate)
    down = get(sums, ATTITUDE + 6)
    count = sums[COUNT]
    rate, variance = 0.0, 1e-18
    for i in range(3):
        mean = sums[SUMS + i] / count
        shown = max(0.0, sums[SQUARES + i] / count - mean * mean) / count
        rate += down[i] * (mean - state[strapdown.GYRO_BIAS + i] - turned[i])
        variance += down[i] * down[i] * max(noise[i] / sums[ELAPSED], shown)
    per_sigma = 1 / math.sqrt(variance)
    H[0], H[1], H[2] = -frame_rate[1] * per_sigma, frame_rate[0] * per_sigma, 0.0
    for i in range(3):
        H[3 + i] = -down[i] * per_sigma
    for i in range(HELD):
        sums[i] = 0.0
    return rate * per_sigma
