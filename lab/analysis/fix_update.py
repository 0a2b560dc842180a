"""Fix update: one update of the filter by a fix, in numbers: P, H, R, S, gain and correction.

A run keeps of each fix its innovation, S, H, R, and P afterwards. P before comes from the filter itself,
which navigates the flight again with this one fix withheld: it has a σ so large that it changes nothing. So
all corrections, gates and error models are those of the run.

Which directions of the error the flight so far has shown is measured as Ham and Brown do: by the eigenvalues
of P relative to P0. The root of an eigenvalue is σ now over σ at the start, along its eigenvector; near one,
nothing has been learnt there.

References
----------
F. M. Ham, R. G. Brown, *Observability, eigenvalues, and Kalman filtering*, IEEE Trans. AES 19 (1983);
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5;
A. Gelb (ed.), *Applied Optimal Estimation*, ch. 4.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.analysis.consistency import normalised_squares
from lab.analysis.fix_causes import hold_heading
from lab.analysis.identification.renavigation import sensor_data_of_run
from lab.base.arrays import FloatArray
from lab.base.histories import SINGLE
from lab.navigation import navigator as linear
from lab.navigation.belief import assumed_latency, schedule_filter
from lab.navigation.filters import unscented
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.log_navigation import navigate_log
from lab.navigation.model_choice import chosen_model
from lab.run.run import ResultError, Run

REJECTED, USED, RECOVERED = "rejected", "used", "recovered"
"""What the filter did with a fix."""
WITHHELD = 1e9
"""σ of each measurement of a withheld fix [m], [m/s]: its gain is below the rounding of P."""
_SAME = 0.5
"""Part of an IMU step by which a time may be before a fix that it means."""
_AFTER = 5.0
"""Time after a fix up to which the filter runs again [s]: the rates about a fix are means over 0.1 s."""
_ROUNDING = 1e-9  # of time stamps [s]
DOWN = np.array([0.0, 0.0, 1.0])
"""The vertical among attitude errors about north, east, down."""


class FixUpdate(NamedTuple):
    """The update of n states by r = 6 numbers: position, then velocity, north, east, down; in SI units.

    Attributes
    ----------
    fix : int
        Number of the fix in the run.
    outcome : str
        `USED`, `REJECTED`, or `RECOVERED` if the filter took itself to be wrong and raised P before.
    before, after : (n, n) arrays
        P before and after the fix.
    H : (r, n) array
        Measurement matrix.
    R : (r, r) array
        Covariance of the fix as used: divided by the weight of a robust update.
    S : (r, r) array
        Covariance of the innovation, by which the fix was judged.
    gain : (n, r) array
        Gain K; zero if the fix was rejected.
    innovation : (r,) array
        Navigator minus fix; NaN where the receiver measures nothing.
    correction : (n,) array
        Estimated error K y, which the navigator was corrected by.
    nis : float
        Normalised innovation squared.
    start : (n, n) array
        P at the start of the flight.
    held : bool
        Whether heading and vertical gyro bias kept their estimates, because the fix shows them at most by
        chance.
    """

    fix: int
    outcome: str
    before: FloatArray
    after: FloatArray
    H: FloatArray
    R: FloatArray
    S: FloatArray
    gain: FloatArray
    innovation: FloatArray
    correction: FloatArray
    nis: float
    start: FloatArray
    held: bool


def reason_without_updates(run: Run) -> str:
    """Return, in a sentence, why the updates of a run cannot be shown; empty if they can."""
    navigator = run.experiment.navigator
    if run.experiment.hidden:
        return "Some settings of this run are hidden, and P, H and K of its filter would show them."
    if run.algorithm:
        return (
            f"{run.algorithm}: your own algorithm does not say how it uses a fix; the lab's navigator does."
        )
    if run.recorded and navigator.smoother:
        return (
            "The solution of this log is smoothed over all fixes at once. Without navigator.smoother, the "
            "update by each fix is known."
        )
    if run.time.size > SINGLE and (run.recorded or navigator.model == "nonlinear"):
        return (
            "This flight is too long for its filter to run again for each fix; navigator.log_from and "
            "navigator.log_to choose a part of a log."
        )
    if not run.fixes.time.size:
        return "There are no GPS fixes in this flight, so the filter updates nothing by them."
    return ""


def find_last_fix(run: Run, time: float) -> int:
    """Return the number of the last fix at a time or before [s]; −1 before the first."""
    slack = _SAME * float(run.time[1] - run.time[0])
    return int(np.searchsorted(run.fixes.time, time + slack, side="right")) - 1


def fix_update(run: Run, fix: int) -> FixUpdate:
    """Return the update of a run by a fix, given by its number.

    The filter runs again up to this fix. Errors are in the coordinates in which every filter outputs them
    (`lab.navigation.filters.error_models.STATES`).

    Raises
    ------
    ResultError
        If the updates of the run are unknown (`reason_without_updates`), or the filter was not given the fix.
    """
    reason = reason_without_updates(run)
    if reason:
        raise ResultError(reason)
    solution, navigator = run.solution_arrays, run.experiment.navigator
    rejected, recovered = bool(solution.fix_rejected[fix]), bool(solution.fix_recovered[fix])
    if solution.fix_sample[fix] < 0 and not rejected:
        raise ResultError(
            f"The filter was not given the fix at {run.fixes.time[fix]:.6g} s: it is outside the IMU "
            "data; accepted is a fix during them."
        )
    H, R, S = solution.fix_H[fix], solution.fix_R[fix], solution.innovation_covariance[fix]
    innovation = solution.innovation[fix]
    known, held = np.nan_to_num(innovation), solution.fix_held[fix]
    before = covariance_before(run, fix)
    if rejected:
        outcome, K, after = REJECTED, np.zeros_like(H.T), before
    elif recovered:
        if navigator.smoother:
            raise ResultError(
                "The filter raised P at this fix, and a smoothed solution does not keep by how much; "
                "accepted is another fix."
            )
        outcome, after = RECOVERED, solution.fix_covariance[fix]
        K = np.linalg.solve(R, H @ after).T  # Gelb 4.2-16b, whatever P was raised to
    else:
        outcome = USED
        K = np.linalg.solve(H @ before @ H.T + R, H @ before).T
        hold_heading(K[None], np.arange(1), DOWN, held[None])
        after = joseph(before, K, H, R) if navigator.smoother else solution.fix_covariance[fix]
    nis = float(normalised_squares(known[None], S[None])[0])
    return FixUpdate(
        fix, outcome, before, after, H, R, S, K, innovation, K @ known, nis, run.belief.P0, bool(held.any())
    )


def joseph(P: FloatArray, K: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Return (I − K H) P (I − K H)ᵀ + K R Kᵀ, the covariance after an update with any gain."""
    kept = np.eye(P.shape[0]) - K @ H
    return np.asarray(kept @ P @ kept.T + K @ R @ K.T)


def covariance_before(run: Run, fix: int) -> FloatArray:
    """Return P (n, n) before a fix: the filter navigates the flight again, and the fix changes nothing."""
    navigator, sensors = run.experiment.navigator, run.experiment.sensors
    if run.recorded is not None:
        log = run.recorded.log
        stamps = log.gnss.time - assumed_latency(navigator, log.gnss.latency)
        row = int(np.searchsorted(stamps, run.fixes.time[fix] - _ROUNDING))
        outages = [(start - log.epoch, end - log.epoch) for start, end in sensors.gps.outages]
        again = navigate_log(
            log,
            sensors,
            navigator,
            outages,
            np.arange(stamps.size) == row,
            run.recorded.alignment,
            rests_of_all=True,
        )
        return np.asarray(again.solution.fix_covariance[fix])
    assert run.aligned is not None  # of a simulated run
    assert run.ideal is not None
    imu, fixes = sensor_data_of_run(run)
    R = np.broadcast_to(run.belief.R, (fixes.time.size, MEASUREMENTS, MEASUREMENTS)).copy()
    R[fix] += WITHHELD**2 * np.eye(MEASUREMENTS)
    schedule = schedule_filter(navigator, run.ideal.dt, imu.dtheta.shape[0])
    end = int(np.searchsorted(imu.time, fixes.time[fix] + _AFTER))
    imu = imu.until(min(end, imu.dtheta.shape[0]))
    given = fixes, run.aligned.start, run.belief._replace(R=R), schedule
    if navigator.model == "nonlinear":
        imu = imu._replace(dtheta=np.asarray(imu.dtheta, float), dvelocity=np.asarray(imu.dvelocity, float))
        solution = unscented.navigate(imu, *given, aids=run.aids, names=run.blocks)
    else:
        model = chosen_model(navigator, sensors)
        solution = linear.navigate_to_fixes(imu, *given, model, run.aids, lambda _piece, _written: None)
    return np.asarray(solution.fix_covariance[fix])


def directions(P: FloatArray, P0: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far σ has come from its start along the directions that separate best, least reduced first.

    Parameters
    ----------
    P, P0 : (n, n) arrays
        Covariance now, and at the start.

    Returns
    -------
    (k,) array
        σ now over σ at the start along each direction; k is the number of states that were uncertain.
    (k, n) array
        The directions, one in each row: each state in its σ at the start; the squares have the sum one.
    """
    used = np.diagonal(P0) > 0
    sigma = np.sqrt(np.diagonal(P0)[used])
    scale = np.outer(sigma, sigma)
    start, now = P0[np.ix_(used, used)] / scale, P[np.ix_(used, used)] / scale
    values, vectors = np.linalg.eigh(start)
    # A P0 that is singular knows some combination for certain, which stays out.
    root = vectors[:, values > _ROUNDING] * np.sqrt(values[values > _ROUNDING])
    back = np.linalg.pinv(root)
    squares, along = np.linalg.eigh(back @ now @ back.T)
    rows = (root @ along).T
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    found = np.zeros((squares.size, used.size))
    found[:, used] = rows
    return np.sqrt(np.maximum(squares[::-1], 0.0)), found[::-1]
