"""Gains: the measurements that a filter used, with their rows of H and gains on errors in Earth-fixed axes.

References
----------
A. Gelb (ed.), *Applied Optimal Estimation*, ch. 4.2.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.analysis.error_sources import GPS_POSITION, GPS_VELOCITY, SENSOR_CHANNELS, WIND
from lab.analysis.errors import output_map
from lab.analysis.fix_causes import hold_heading
from lab.analysis.transition import NAV
from lab.base.arrays import FloatArray
from lab.motion.frames import ecef
from lab.motion.frames.rotation import left_jacobian
from lab.navigation.aids import AIRSPEED, SENSORS
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ATT, MODELS, POS, VEL
from lab.run.run import Run

INTERVAL = 1.0
"""Longest time between two epochs of a budget [s]."""
ROUNDS = 20
"""Most rounds in which a correction is found from the covariance after it; 3 are usual."""
SETTLED = 1e-9
"""Error of such a correction that is none [rad]."""
STEP = 1e-6
"""Step of the numerical derivative by such a correction [rad]."""
_TOGETHER = 32
"""Epochs whose uses are computed together: with 52 states, their matrices take 3 MB."""


class Epochs(NamedTuple):
    """Epochs of a flight, in order.

    Attributes
    ----------
    sample : (e,) array
        IMU samples.
    fix, aid : (e,) arrays
        The fix, or the measurement of the aids, that was used at each, or −1.
    shown : (e,) array
        Whether it is the last of a sample whose errors are in the budget: not where only aids were used,
        because there may be many.
    """

    sample: NDArray[np.int64]
    fix: NDArray[np.int64]
    aid: NDArray[np.int64]
    shown: NDArray[np.bool_]


def choose_epochs(run: Run) -> Epochs:
    """Return the epochs: start, used measurements, end, and samples between, none far from the next.

    At one sample, the filter uses fixes after other measurements.
    """
    end, solution = run.time.size - 1, run.solution_arrays
    fixes, aids = np.flatnonzero(solution.fix_sample >= 0), np.flatnonzero(solution.aid_sample >= 0)
    at_fix, at_aid = solution.fix_sample[fixes], solution.aid_sample[aids]
    grid = np.append(np.arange(0, end, max(1, round(INTERVAL / usual_step(run)))), end)
    grid = np.setdiff1d(grid, at_fix)
    sample = np.concatenate((at_aid, at_fix, grid))
    # Stable: at one sample, the aids stay before the fix, as the filter takes them.
    order = np.argsort(sample, kind="stable")
    sample = sample[order]
    fix, aid = np.full((2, sample.size), -1)
    # In the order of `sample` before it is sorted.
    aid[: aids.size], fix[aids.size : aids.size + fixes.size] = aids, fixes
    # Of the rows of one sample only the last is shown, after all its measurements.
    last = np.append(np.diff(sample) > 0, True)
    return Epochs(sample, fix[order], aid[order], last & np.isin(sample, np.concatenate((at_fix, grid))))


def usual_step(run: Run) -> float:
    """Return the usual time from IMU sample to IMU sample [s]."""
    return float(np.median(np.diff(run.time))) if run.ideal is None else run.ideal.dt


class Update(NamedTuple):
    """The use of a measurement by a filter with n states: of a fix, r = 6, or another one, r = 1.

    Attributes
    ----------
    H : (r, n) array
        Measurement matrix, for errors in e.
    K : (n, r) array
        Gain on errors in e.
    noise : dict
        By the channel of an error of the measurement, its effect (r, 3) on the measured numbers.
    turn : (3,) array
        Correction of the attitude, in e, by half of which the errors turn (`strapdown.reset_rate`) [rad].
    """

    H: FloatArray
    K: FloatArray
    noise: dict[int, FloatArray]
    turn: FloatArray


def is_corrected(run: Run) -> bool:
    """Return whether the filter corrects its navigator."""
    return bool(run.experiment.navigator.correction == "feedback")


def iterate_updates(run: Run, epochs: Epochs, place: FloatArray) -> Iterator[Update | None]:
    """Yield the use of the measurement at each epoch; None where there is none.

    Parameters
    ----------
    run
        The run.
    epochs
        Its epochs.
    place : (e, 2) array
        True latitude and longitude at each [rad].
    """
    for some in _parts(epochs.sample):
        part = Epochs(epochs.sample[some], epochs.fix[some], epochs.aid[some], epochs.shown[some])
        solution = run.solution_arrays
        maps = output_map(solution.position[part.sample], solution.velocity_n[part.sample])
        at_fix, at_aid = part.fix >= 0, part.aid >= 0
        if at_aid.any():
            maps[at_aid] = _maps_before(run, part.aid[at_aid])
        fixes = iter(_fix_updates(run, part.fix[at_fix], maps[at_fix], place[some][at_fix]))
        for fix, aid, here in zip(part.fix, part.aid, maps, strict=True):
            yield next(fixes) if fix >= 0 else _aid_update(run, int(aid), here) if aid >= 0 else None


def _parts(samples: NDArray[np.int64]) -> Iterator[slice]:
    """Iterate over parts of the epochs, given their samples; all epochs of a sample are in one part."""
    begins = np.append(np.flatnonzero(np.diff(samples, prepend=-1) > 0), samples.size)
    cuts = np.unique(begins[np.searchsorted(begins, np.arange(0, samples.size, _TOGETHER))])
    for first, last in pairwise(np.union1d(cuts, samples.size).tolist()):
        yield slice(first, last)


def _maps_before(run: Run, aids: NDArray[np.int64]) -> FloatArray:
    """Return `output_map` (m, 9, 9) of the estimates before some measurements of the aids.

    Those of one sample follow one another, and each corrects the navigator before the next; a fix comes after
    them. Near a pole, north is another one after each correction.
    """
    solution = run.solution_arrays
    samples = solution.aid_sample[aids]
    before = samples - 1
    there = solution.position[before]
    velocity_e = np.einsum("nij,nj->ni", ecef.axes(*there[:, :2].T), solution.velocity_n[before])
    step = (run.time[samples] - run.time[before])[:, None]
    # The estimate before the corrections is not kept; that of one sample earlier, moved on, is close.
    r_e = ecef.position(there) + step * velocity_e
    maps = _output_map_at(r_e, velocity_e)
    x = solution.aid_gain[aids, :NAV] * solution.aid_innovation[aids, None]
    number = np.arange(aids.size) - np.searchsorted(samples, samples)  # within the sample
    for rank in range(1, int(number.max(initial=0)) + 1):
        now = np.flatnonzero(number == rank)
        # The measurement before, of the same sample, was the row before: its correction is done when this
        # one is used.
        x_e = np.linalg.solve(maps[now - 1], x[now - 1, :, None])[..., 0]
        r_e[now] = r_e[now - 1] - x_e[:, POS]
        velocity_e[now] = velocity_e[now - 1] - x_e[:, VEL]
        maps[now] = _output_map_at(r_e[now], velocity_e[now])
    return maps


def _output_map_at(r_e: FloatArray, velocity_e: FloatArray) -> FloatArray:
    """Return `output_map` (m, 9, 9) at positions and velocities (m, 3) in e."""
    here = ecef.geodetic(r_e)
    return output_map(here, np.einsum("nji,nj->ni", ecef.axes(*here[:, :2].T), velocity_e))


def _fix_updates(run: Run, fixes: NDArray[np.int64], maps: FloatArray, place: FloatArray) -> list[Update]:
    """Return the uses of fixes (m,), with the maps of their estimates (m, 9, 9) and true places (m, 2)."""
    solution = run.solution_arrays
    # The filter's H is for errors along the axes of the fix, its P⁺ for output errors at its estimate.
    C_fe = ecef.axes(*run.fixes.position[fixes, :2].T).mT
    H = solution.fix_H[fixes]
    for block in (POS, VEL, ATT):
        H[..., block] = H[..., block] @ C_fe
    back = np.tile(np.eye(solution.states), (fixes.size, 1, 1))
    back[:, :NAV, :NAV] = np.linalg.inv(maps)
    P = back @ solution.fix_covariance[fixes] @ back.mT
    innovation = np.nan_to_num(solution.innovation[fixes])[..., None]
    weighted = H.mT @ np.linalg.inv(solution.fix_R[fixes])
    vertical, held = C_fe.mT[:, :, 2], solution.fix_held[fixes]
    in_body = MODELS[run.experiment.navigator.model].in_body and is_corrected(run)
    if in_body:
        about = vertical * held.any(axis=1, keepdims=True)
        P = _before_turns(P, weighted @ innovation, about, _unmeasured_turns(run, fixes))
    # K = P⁺ Hᵀ R⁻¹, even if P⁺ and R are wrong (Gelb 4.2-16b), except along what was held.
    K = P @ weighted
    hold_heading(K, np.arange(fixes.size), vertical, held)
    turn = is_corrected(run) * (K[:, ATT] @ innovation)[..., 0]
    if in_body:  # the correction is the group's exponential
        # `stack` refuses an empty list.
        bent = np.stack([left_jacobian(one) for one in turn]) if fixes.size else np.zeros((0, 3, 3))
        K[:, POS], K[:, VEL] = bent @ K[:, POS], bent @ K[:, VEL]
    # Errors of a fix are along north, east and down of the true place.
    turned = C_fe @ ecef.axes(*place.T)
    none = np.zeros_like(turned)
    position, velocity = np.concatenate((turned, none), axis=1), np.concatenate((none, turned), axis=1)
    return [
        Update(H[k], K[k], {GPS_POSITION: position[k], GPS_VELOCITY: velocity[k]}, turn[k])
        for k in range(fixes.size)
    ]


def _unmeasured_turns(run: Run, fixes: NDArray[np.int64]) -> FloatArray:
    """Return by how much the attitude changed in e at fixes (m, 3), less what the gyros measured [rad]."""
    solution, sample = run.solution_arrays, run.solution_arrays.fix_sample[fixes]
    after, before = (
        Rotation.from_quat(solution.q_nb[at], scalar_first=True) for at in (sample, np.maximum(sample - 1, 0))
    )
    measured = Rotation.from_rotvec(run.gyro.increments[np.maximum(sample - 1, 0)])
    turn = (after * (before * measured).inv()).as_rotvec()
    return np.asarray(np.einsum("mij,mj->mi", ecef.axes(*solution.position[sample, :2].T), turn))


def _before_turns(P: FloatArray, pull: FloatArray, held: FloatArray, turn: FloatArray) -> FloatArray:
    """Return covariances (m, n, n), given after corrections of a filter in the body frame, along axes before.

    A correction turns the body, and with it the errors that the filter has along its axes. With a heading
    that is uncertain by a radian, one degree decides what tilts and heading have in common.

    Parameters
    ----------
    P : (m, n, n) array
        Covariances along the axes after the corrections.
    pull : (m, n, 1) array
        Hᵀ R⁻¹ times the innovation.
    held : (m, 3) array
        The direction about which a correction left the attitude as it was; zero for none.
    turn : (m, 3) array
        The corrections of the attitude, nearly.
    """

    def axes_before(turn: FloatArray) -> FloatArray:
        back = np.tile(np.eye(P.shape[1]), (len(P), 1, 1))
        back[:, POS, POS] = back[:, VEL, VEL] = back[:, ATT, ATT] = Rotation.from_rotvec(-turn).as_matrix()
        return back

    def missing(turn: FloatArray) -> FloatArray:
        back = axes_before(turn)
        found = (back @ (P @ (back.mT @ pull)))[:, ATT, 0]
        return np.asarray(found - held * np.sum(held * found, axis=1, keepdims=True) - turn)

    for _ in range(ROUNDS):  # of Newton's method
        left = missing(turn)
        if np.abs(left).max(initial=0.0) < SETTLED:
            break
        slopes = [(missing(turn + STEP * axis) - left) / STEP for axis in np.eye(3)]
        turn = turn - np.linalg.solve(np.stack(slopes, axis=-1), left[..., None])[..., 0]
    back = axes_before(turn)
    return np.asarray(back @ P @ back.mT)


def _aid_update(run: Run, aid: int, here: FloatArray) -> Update:
    """Return the use of a measurement of the aids, with the map (9, 9) of its estimate."""
    solution, kind = run.solution_arrays, int(run.aids.kind[aid])
    H, K = solution.aid_H[aid].copy(), solution.aid_gain[aid].copy()
    H[:NAV] = H[:NAV] @ here
    K[:NAV] = np.linalg.solve(here, K[:NAV])
    sensor = SENSORS.get(kind)
    noise = {SENSOR_CHANNELS[sensor]: np.array([[1.0, 0.0, 0.0]])} if sensor else {}
    if kind == AIRSPEED:  # a change of the wind changes what is measured as H says
        # Its two components act through H of the wind's states; the third one of c is not used.
        noise[WIND] = np.append(H[blocks.find_states(run.blocks, blocks.WIND)], 0.0)[None]
    turn = is_corrected(run) * K[ATT] * solution.aid_innovation[aid]
    return Update(H[None], K[:, None], noise, turn)
