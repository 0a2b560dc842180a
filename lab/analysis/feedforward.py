"""Feedforward: the error of a navigator that runs free, for the whole flight or between corrections.

The filter's model is linear in the error of the free-running navigator. Feedforward never corrects it; with a
correction period, it waits. With attitude errors of a few degrees, the neglected products, such as f φ² / 2,
are larger than the noise. The covariance then does not describe the error.

References
----------
P. S. Maybeck, *Stochastic Models, Estimation, and Control*, vol. 1, ch. 6.4 (feedforward and feedback).
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Verdict, headline, is_right
from lab.analysis.verdicts.finding_table import AID_NOISE, FINDINGS, UNEXPLAINED
from lab.analysis.verdicts.sums import Squares
from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.motion.frames import ecef
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import VEL
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.schedule import SLACK, Schedule
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.navigator import free_inertial
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Imu, Start
from lab.run.run import Run
from lab.sensors.imu_errors import OFF_DIAGONAL


class FreeRun(NamedTuple):
    """How far a navigator runs free, and how far its filter is linear.

    Attributes
    ----------
    drift : float
        Largest attitude error while it runs free, as estimated [rad]; zero if it is corrected at each fix.
    limit : float
        That up to which the filter is linear enough [rad].
    """

    drift: float
    limit: float

    @property
    def excess(self) -> float:
        """The drift as a part of the limit."""
        return self.drift / self.limit


CORRECTED = FreeRun(0.0, float(limits.VERDICT.free_attitude))
"""Of a navigator that is corrected at each fix."""


def judge(
    free: FreeRun, verdict: Verdict, navigator: NavigatorSettings, nees: Squares | None = None
) -> Verdict:
    """Return the verdict, with a free-running navigator as the cause of an inconsistency if it is.

    Beyond the linear model, nothing else can be judged, unless the errors are known and as large as the
    filter says.

    Parameters
    ----------
    free
        How far it runs free; of several runs, the farthest.
    verdict
        The verdict from the evidence.
    navigator
        The filter.
    nees
        NEES, if the truth is known.
    """
    unexplained = any(finding.quantity in UNEXPLAINED for finding in verdict.findings)
    if (
        nees is not None
        and nees.number
        and not unexplained
        and is_right(float(nees.total), float(nees.number))
    ):
        return verdict
    drift, limit = free
    waits = navigator.correction == "feedback"
    within = drift <= limit and not waits
    # A navigator off the truth is off what other sensors measure, too.
    if within and all(finding.quantity in (*UNEXPLAINED, *AID_NOISE) for finding in verdict.findings):
        limit = float(limits.VERDICT.suspected_attitude)
    if not verdict.findings or drift <= limit:
        return verdict
    degrees = np.degrees(drift)
    finding = FINDINGS["correction period" if waits else "feedforward"].finding(
        float(drift),
        f"attitude error of the free-running navigator {degrees:.3g}°, limit {np.degrees(limit):.2g}°",
        degrees=degrees,
    )
    return Verdict(headline((finding,), ""), (finding,), verdict.basis)


def remark(free: FreeRun, navigator: NavigatorSettings) -> str:
    """Return a sentence about a navigator that runs free beyond the linear model; empty if it does not."""
    drift, limit = free
    if drift <= limit:
        return ""
    reaches = f"reaches {np.degrees(drift):.3g}°"
    but = f"but the filter is linear only up to {np.degrees(limit):.2g}°: its σ may not describe its errors."
    if navigator.correction == "feedback":
        return (
            f"The attitude error between corrections (navigator.correction_period) {reaches}, {but} A period "
            "of 0 corrects at each fix."
        )
    return (
        f"Feedforward: the attitude error of the free-running navigator {reaches}, {but} "
        "navigator.correction = feedback keeps the navigator close to the truth."
    )


def _in_earth_axes(position: FloatArray, q_nb: FloatArray) -> Rotation:
    """Return attitudes in e: north at two places is not the same, least of all close to a pole."""
    C_en = Rotation.from_matrix(ecef.axes(position[:, 0], position[:, 1]))
    return C_en * Rotation.from_quat(q_nb, scalar_first=True)


def measure_free_run(run: Run) -> FreeRun:
    """Return how far the navigator of a run runs free; a user's algorithm corrects its own."""
    return CORRECTED if run.algorithm else FreeRun(largest_attitude_drift(run), attitude_limit(run))


def largest_attitude_drift(run: Run) -> float:
    """Return the largest attitude error of the navigator while it runs free, as estimated [rad].

    Zero for a filter that corrects its navigator at each measurement, and for a user's algorithm.

    Parameters
    ----------
    run
        The run.
    """
    navigator = run.experiment.navigator
    if run.algorithm or (navigator.correction == "feedback" and not navigator.correction_period):
        return 0.0
    ends = [*find_corrections(run), run.time.size - 1]
    return max(_drift_between(run, first, last) for first, last in pairwise(ends) if first < last)


def attitude_limit(run: Run) -> float:
    """Return the attitude error of a free-running navigator up to which the filter is linear enough [rad]."""
    navigator, R = run.experiment.navigator, run.solution_arrays.fix_R
    if navigator.correction != "feedback" or not navigator.correction_period or not R.size:
        return float(limits.VERDICT.free_attitude)
    sigma = np.sqrt(np.median(np.diagonal(R, axis1=1, axis2=2)[:, VEL]))
    return float(
        np.sqrt(
            2 * limits.VERDICT.correction_sigmas * sigma / (STANDARD_GRAVITY * navigator.correction_period)
        )
    )


def find_corrections(run: Run) -> list[int]:
    """Return the first sample, and those at which the navigator was corrected."""
    navigator, solution = run.experiment.navigator, run.solution_arrays
    found = [0]
    if navigator.correction != "feedback":
        return found
    used = np.unique(np.concatenate((solution.fix_sample, solution.aid_sample)))
    period = float(navigator.correction_period) - SLACK
    for sample in used[used > 0].tolist():
        if run.time[sample] - run.time[found[-1]] >= period:
            found.append(sample)
    return found


def _given_start(run: Run, otherwise: Start) -> Start:
    """Return the start that the filter was given, if the run has it."""
    if run.aligned is not None:
        return run.aligned.start
    return run.recorded.alignment.start if run.recorded is not None else otherwise


def _drift_between(run: Run, first: int, last: int) -> float:
    """Return the largest attitude error of a navigator that runs free from one sample to another [rad]."""
    solution, navigator = run.solution_arrays, run.experiment.navigator
    estimates = np.concatenate((solution.scale[first], solution.further[first])).astype(np.float64)
    start = Start(
        solution.position[first],
        solution.velocity_n[first],
        solution.q_nb[first],
        solution.bias[first, :3].astype(np.float64),
    )
    if first == 0:
        # A smoothed solution begins close to the truth, but its navigator began where the filter did.
        start, estimates = _given_start(run, start), np.zeros_like(estimates)
    bias, mixing = start.gyro_bias.astype(np.float64), np.eye(3)
    for name, elements in (
        (blocks.GYRO_SCALE, [(i, i) for i in range(3)]),
        (blocks.GYRO_MISALIGNMENT, [("xyz".index(pair[0]), "xyz".index(pair[1])) for pair in OFF_DIAGONAL]),
    ):
        if name in run.blocks:
            at = blocks.first_state(run.blocks, name) - blocks.CORE
            for k, place in enumerate(elements):
                mixing[place] += estimates[at + k]
    if blocks.GYRO_DRIFT in run.blocks:
        at = blocks.first_state(run.blocks, blocks.GYRO_DRIFT) - blocks.CORE
        bias = bias + estimates[at : at + 3]
    gyro, accelerometer = run.gyro.increments[first:last], run.accelerometer.increments[first:last]
    unmixed_bias = np.asarray(np.linalg.solve(mixing, bias), dtype=np.float64)
    unmixed = np.asarray(np.linalg.solve(mixing, gyro.T).T, dtype=np.float64)
    if blocks.GYRO_G in run.blocks:
        at = blocks.first_state(run.blocks, blocks.GYRO_G) - blocks.CORE
        unmixed = unmixed - estimates[at : at + 3] * accelerometer
    imu = Imu(run.time[first : last + 1], unmixed, accelerometer)
    alone = run.belief._replace(R=np.eye(6), decay=np.zeros_like(run.belief.decay))
    model = with_blocks(linear_model(navigator.model, navigator.mechanization), run.blocks)
    largest = 0.0
    for begin, free in free_inertial(
        imu, start._replace(gyro_bias=unmixed_bias), alone, Schedule(feedback=False), model
    ):
        part = slice(first + begin, first + begin + free.q_nb.shape[0])
        there = _in_earth_axes(solution.position[part], solution.q_nb[part])
        apart = there.inv() * _in_earth_axes(free.position, free.q_nb)
        largest = max(largest, float(apart.magnitude().max()))
    return largest
