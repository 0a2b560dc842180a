"""Feedforward: the error of the free-running navigator of a feedforward filter.

The filter's model is linear in the error of the free-running navigator, which is never corrected. With
attitude errors of a few degrees, the neglected products, such as f φ² / 2, are larger than the noise. The
covariance then does not describe the error.

References
----------
P. S. Maybeck, *Stochastic Models, Estimation, and Control*, vol. 1, ch. 6.4 (feedforward and feedback).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab import ecef
from lab.analysis.finding import Change, Finding, Verdict, headline
from lab.navigation.further_columns import with_blocks
from lab.navigation.navigator import freely
from lab.navigation.schedule import Schedule
from lab.navigation.solution import Imu, Start
from lab.navigation.wander_models import linear_model
from lab.run import Run

FloatArray = NDArray[np.float64]

LINEAR = np.radians(0.8)
"""Attitude error of the free-running navigator up to which the filter is linear enough [rad]. Measured on
montreal over gyros of all qualities: at 0.8° NEES is 1.4 × too large, at 1.5° 4 ×, at 7° 20 ×."""


def judge(drift: float, verdict: Verdict) -> Verdict:
    """Return the verdict, with feedforward as the cause of an inconsistency if it is.

    Beyond the linear model, nothing else can be judged.

    Parameters
    ----------
    drift
        Largest attitude error of the free-running navigator [rad], see `drift_of`.
    verdict
        The verdict from the evidence.
    """
    if not verdict.findings or drift <= LINEAR:
        return verdict
    degrees = np.degrees(drift)
    finding = Finding(
        "feedforward",
        "not modelled",
        float(drift),
        f"The attitude error of the free-running navigator reaches {degrees:.3g}°. The linear model of the "
        "feedforward filter does not hold there, so its σ does not describe its errors.",
        "Set navigator.correction to feedback.",
        f"attitude error of the free-running navigator {degrees:.3g}°, limit {np.degrees(LINEAR):g}°",
        (Change("navigator.correction", "feedback"),),
    )
    return Verdict(headline((finding,), ""), (finding,), verdict.basis)


def _in_earth_axes(position: FloatArray, q_nb: FloatArray) -> Rotation:
    """Return attitudes in e: north at two places is not the same, least of all close to a pole."""
    C_en = Rotation.from_matrix(ecef.axes(position[:, 0], position[:, 1]))
    return C_en * Rotation.from_quat(q_nb, scalar_first=True)


def drift_of(run: Run) -> float:
    """Return the largest attitude error of the free-running navigator, as estimated [rad].

    Zero for a filter that corrects its navigator, and for a user's algorithm.

    Parameters
    ----------
    run
        The run.
    """
    if run.algorithm or run.experiment.navigator.correction != "feedforward":
        return 0.0
    solution = run.solution_arrays
    bias = solution.bias[0, :3].astype(np.float64)
    start = Start(solution.position[0], solution.velocity_n[0], solution.q_nb[0], bias)
    imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
    alone = run.belief._replace(R=np.eye(6), decay=np.zeros_like(run.belief.decay))
    navigator = run.experiment.navigator
    model = with_blocks(linear_model(navigator.model, navigator.mechanization), run.blocks)
    largest = 0.0
    for first, free in freely(imu, start, alone, Schedule(feedback=False), model):
        part = slice(first, first + free.q_nb.shape[0])
        there = _in_earth_axes(solution.position[part], solution.q_nb[part])
        apart = there.inv() * _in_earth_axes(free.position, free.q_nb)
        largest = max(largest, float(apart.magnitude().max()))
    return largest
