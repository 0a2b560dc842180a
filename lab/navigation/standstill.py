"""Standstill: the detection of rest, and the gyro biases that the gyros then show.

At rest, only the Earth rotates the IMU, so the mean of the gyros is their bias plus the Earth's rate. Without
this information, the heading of the filter drifts with the bias, and its model, linearised along that
heading, gains information that does not exist.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 15.3
(zero angular rate updates); D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd
ed., ch. 10.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.kernels.compilation import kernel
from lab.navigation.solution import Belief, Fixes, Imu
from lab.navigation.strapdown import Vector, get, matrix, put, rotate

SPAN = 1.0
"""Time over which the gyros are averaged for one update [s]."""
SHORTEST = 10
"""Fewest consecutive seconds that count as rest; a walker pauses for less [s]."""
SLOW = 16.3
"""Largest squared GPS velocity at rest, in its σ: the 99.9 % quantile for three components."""
LEAST_SPEED = 0.05
"""Smallest σ of a GPS velocity that is assumed [m/s]."""
RATE_SPREAD = math.radians(0.3)
"""Spread of the rates of a MEMS gyro on a table at 100 Hz [rad/s]; the limit is higher if the filter assumes
more noise."""
FORCE_SPREAD = 0.15
"""Spread of the specific force of a vehicle with an idling engine [m/s²]."""
RATE_CHANGE = math.radians(0.05)
"""Largest change of the mean rate from one second to the next beyond its noise [rad/s]."""
FORCE_CHANGE = 0.05
"""Largest change of the mean specific force from rest on, beyond its noise, while no fix shows the speed
[m/s²]: a car starts with 0.5 or more, a train with 0.3."""
FORCE_STEP = 0.02
"""Largest change of the mean specific force from one second at rest to the next, beyond its noise [m/s²]: a
start or a stop shows half of its acceleration in one step. Four real logs with a rest keep all its seconds;
with 0.01, a standing person's do not count."""
NOISE_SIGMAS = 3
"""The spread that is allowed if more noise is assumed, in its σ: the assumed noise may be too small."""
CHANGE_SIGMAS = 5
"""The change allowed beside it, in σ of the difference of two means: three axes in each second of a log."""
NEAREST = 0.5
"""Part of a sample by which a time may be missed: the sample nearest to it ends it."""
GATE = 16.0
"""Largest squared mean rate, in its σ, that is used: (4 σ)²; beyond it, the vehicle turns slowly."""
_SPREAD, _CHANGE = (np.repeat(sizes, 3) for sizes in ((RATE_SPREAD, FORCE_SPREAD), (RATE_CHANGE, FORCE_STEP)))
"""Spread, and change from second to second, that rest allows of rates and specific forces (6,)."""

SUMS, SQUARES, ELAPSED, COUNT, HELD, ATTITUDE, ROOM = 0, 3, 6, 7, 8, 9, 18
"""Offsets in the workspace: sums of the rates and of their squares, time, samples, and the held attitude."""


def at_rest(imu: Imu, fixes: Fixes, belief: Belief, grid: FloatArray | None = None) -> NDArray[np.bool_]:
    """Return the mask (n,) of the samples at rest, from GPS velocities and the spread of the IMU.

    Parameters
    ----------
    imu, fixes, belief
        The measurements, and the filter's assumptions about them.
    grid : (s + 1,) array
        Times between which the seconds lie [s]; by default, they count from the first sample.
    """
    n = imu.dtheta.shape[0]
    rest = np.zeros(n, dtype=np.bool_)
    if grid is None:
        grid = imu.time[0] + SPAN * np.arange(int((imu.time[-1] - imu.time[0]) / SPAN) + 1)
    slow = _slow(grid[:-1], fixes, belief)
    for first, last in _stretches(slow):
        # A sample whose stamp is rounded to just before a second still begins it.
        edges = np.searchsorted(imu.time, grid[first : last + 1] - 1e-9)
        still = still_seconds(imu, belief, edges)
        for a, b in _stretches(still):
            rest[edges[a] : edges[b]] = True
    rest.setflags(write=False)
    return rest


class Held(NamedTuple):
    """Specific force of a vehicle at rest, and the velocity gained since.

    Attributes
    ----------
    force : (3,) array
        Mean specific force at rest [m/s²].
    gained : (3,) array
        What another specific force since then adds to the velocity [m/s].
    others : int
        Seconds since then, in which the fixes showed no speed.
    """

    force: FloatArray
    gained: FloatArray
    others: int = 0


def standing_still(
    rest: NDArray[np.bool_],
    imu: Imu,
    fixes: Fixes,
    belief: Belief,
    grid: FloatArray | None = None,
    known: list[Held | None] | None = None,
) -> tuple[NDArray[np.bool_], list[Held | None]]:
    """Return the samples (n,) in which the velocity is zero, also where no fix shows it.

    The specific force changes long before the fixes show the speed of a vehicle that begins to move. So a
    rest ends where the force changes. It goes on once the force is as before and the change has added no
    velocity, or once the fixes would show the speed that the smallest visible change gives. Without fixes, it
    lasts until the inertial sensors show vibration, rotation, or another specific force.

    Parameters
    ----------
    rest : (n,) array
        Samples at rest as fixes show it, from `at_rest`.
    imu, fixes, belief
        The measurements, and the filter's assumptions about them.
    grid : (s + 1,) array
        Times between which the seconds lie [s]; by default, they count from the first sample.
    known
        What the second value holds for the first second, if that is known.

    Returns
    -------
    mask, list of Held
        The samples, and what is held after each second; None where the vehicle may move.
    """
    if grid is None:
        grid = imu.time[0] + SPAN * np.arange(int((imu.time[-1] - imu.time[0]) / SPAN) + 1)
    found = np.zeros(rest.size, dtype=np.bool_)
    after: list[Held | None] = []
    first, last = (np.searchsorted(fixes.time, grid[:-1] + shift) for shift in (-SPAN, 2 * SPAN))
    edges = np.searchsorted(imu.time, grid - 1e-9)
    slow, still, patience = (
        _slow(grid[:-1], fixes, belief),
        still_seconds(imu, belief, edges),
        _patience(belief),
    )
    held = None
    for second, (a, b) in enumerate(itertools.pairwise(edges)):
        if second == 0 and known is not None:
            held = known[0]
            after.append(held)
            continue
        shown = bool(b > a and rest[a:b].all())
        silent = bool(b > a and still[second] and last[second] == first[second])
        dt = np.diff(imu.time[a : b + 1])[:, None]
        forces = imu.dvelocity[a:b] / dt
        if held is not None and (shown or silent or slow[second]):
            gained = held.gained + imu.dvelocity[a:b].sum(axis=0) - dt.sum() * held.force
            same = (shown or silent) and _same(forces, held.force, FORCE_STEP if shown else FORCE_CHANGE)
            if same and (held.others == 0 or np.abs(gained).max() <= LEAST_SPEED):
                found[a:b] = True
                held = Held(forces.mean(axis=0) if shown else held.force, np.zeros(3))
            elif shown and held.others >= patience:
                held = None
            else:
                held = None if silent else Held(held.force, gained, held.others + 1)
        else:
            held = None
        if held is None and shown:
            found[a:b] = True
            held = Held(forces.mean(axis=0), np.zeros(3))
        after.append(held)
    found.setflags(write=False)
    return found, after


def _same(forces: FloatArray, held: FloatArray, change: float) -> bool:
    """Return whether the mean of specific forces (k, 3) is the held one, but for a change and its noise."""
    allowed = change + CHANGE_SIGMAS * forces.std(axis=0) * math.sqrt(2 / forces.shape[0])
    return bool((np.abs(forces.mean(axis=0) - held) <= allowed).all())


def _patience(belief: Belief) -> float:
    """Return the time after which fixes show the speed of the smallest visible acceleration [s]."""
    variance = np.diagonal(belief.R, axis1=-2, axis2=-1)[..., 3:]
    sigma = math.sqrt(float(np.median(variance))) if variance.size else 0.0
    return max(SHORTEST, math.sqrt(SLOW) * max(sigma, LEAST_SPEED) / FORCE_STEP)


def _slow(seconds: FloatArray, fixes: Fixes, belief: Belief) -> NDArray[np.bool_]:
    """Return the mask of the seconds with fixes about them of which none shows a speed."""
    variance = np.diagonal(belief.fix_covariance(np.arange(fixes.time.size)), axis1=-2, axis2=-1)[..., 3:]
    squares = np.sum(fixes.velocity_n**2 / np.maximum(variance, LEAST_SPEED**2), axis=1)
    # Counted up: a fast fix lies between two places where the counts there differ.
    fast = np.concatenate(([0], np.cumsum(squares > SLOW)))
    first, last = (np.searchsorted(fixes.time, seconds + shift) for shift in (-SPAN, 2 * SPAN))
    return np.asarray((last > first) & (fast[last] == fast[first]))


def still_seconds(imu: Imu, belief: Belief, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the mask (s,) of the seconds without vibration, rotation, and a change of the specific force.

    Parameters
    ----------
    imu, belief
        The measurements, and the filter's assumptions about them.
    edges : (s + 1,) array
        Samples between which the seconds lie.
    """
    still = np.zeros(edges.size - 1, dtype=np.bool_)
    before = None
    for second, (a, b) in enumerate(itertools.pairwise(edges)):
        if b - a < 2:
            before = None
            continue
        dt = np.diff(imu.time[a : b + 1])[:, None]
        both = np.hstack((imu.dtheta[a:b], imu.dvelocity[a:b])) / dt
        spread, mean = both.std(axis=0), both.mean(axis=0)
        steady = (spread <= np.maximum(_SPREAD, NOISE_SIGMAS * np.sqrt(belief.noise[:6] / dt.mean()))).all()
        if before is not None:
            allowed = _CHANGE + CHANGE_SIGMAS * spread * math.sqrt(2 / (b - a))
            steady &= (np.abs(mean - before) <= allowed).all()
        still[second], before = steady, mean
    return still


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the stretches (first, end) of at least `SHORTEST` consecutive true flags."""
    # Between the added False, flags change an even number of times: begin, end, begin, end.
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= SHORTEST]


@kernel
def hold_attitude(state: FloatArray, sums: FloatArray, rest: bool) -> None:
    """Hold the attitude of the linearisation constant during a rest.

    At rest, the heading is observable only through the Earth's rate. A model linearised along a varying
    estimate gains information about the heading that does not exist (G. P. Huang, A. I. Mourikis, S. I.
    Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*, Int. J. Robotics
    Research 29 (2010): first-estimates Jacobian).

    Parameters
    ----------
    state
        The navigator after a step; the error model reads its `C_NB` and `FORCE_N`.
    sums
        Workspace with the held attitude.
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
    """Add the rates of a sample at rest, including the estimated biases; return whether an update is due."""
    bias = strapdown.bias_taken(state, strapdown.GYRO_BIAS, strapdown.GYRO_SCALE)
    for i in range(3):
        rate = state[strapdown.PREVIOUS_DTHETA + i] / dt + bias[i]
        sums[SUMS + i] += rate
        sums[SQUARES + i] += rate * rate
    sums[ELAPSED] += dt
    sums[COUNT] += 1
    return bool(sums[ELAPSED] >= SPAN - NEAREST * dt)


@kernel
def predict_rest(
    state: FloatArray, frame_rate: Vector, noise: FloatArray, sums: FloatArray, H: FloatArray
) -> float:
    """Return the measurement of an update at rest in its σ, write its row of H, and start new sums.

    The measurement is the navigator's rate about the vertical minus that of the Earth: −d δb / (1 + s) +
    (ω_ie × φ)_D plus noise, with d the vertical in b. The noise is that of the gyros over the time, or that
    shown by their samples if larger. The level rates are not used: the fixes show the tilt, which contains
    the same gyro noise, and using both would count it twice.

    Parameters
    ----------
    state
        The navigator.
    frame_rate
        The Earth's rate in the navigation frame [rad/s].
    noise : (12,) array
        Densities of the process noise.
    sums
        Sums of the rates, as for `gather_rest`.
    H : (6,) array
        Receives the row of H for the attitude error in the navigation frame and the gyro biases.
    """
    at = strapdown.Q_NB
    C = matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    back = (C[0][0], C[1][0], C[2][0]), (C[0][1], C[1][1], C[2][1]), (C[0][2], C[1][2], C[2][2])
    turned = rotate(back, frame_rate)
    down = get(sums, ATTITUDE + 6)
    count = sums[COUNT]
    bias = strapdown.bias_taken(state, strapdown.GYRO_BIAS, strapdown.GYRO_SCALE)
    per = strapdown.per_scale(state, strapdown.GYRO_SCALE)
    # The variance is divided by: gyros without noise, too, must have some.
    rate, variance = 0.0, 1e-18
    for i in range(3):
        mean = sums[SUMS + i] / count
        # Rounding may make the difference of two nearly equal squares negative.
        shown = max(0.0, sums[SQUARES + i] / count - mean * mean) / count
        rate += down[i] * (mean - bias[i] - turned[i])
        variance += down[i] * down[i] * max(noise[i] / sums[ELAPSED], shown)
    per_sigma = 1 / math.sqrt(variance)
    H[0], H[1], H[2] = -frame_rate[1] * per_sigma, frame_rate[0] * per_sigma, 0.0
    for i in range(3):
        H[3 + i] = -down[i] * per[i] * per_sigma
    # All but the held attitude, which lasts for the whole rest.
    for i in range(HELD):
        sums[i] = 0.0
    return rate * per_sigma
