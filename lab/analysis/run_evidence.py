"""Run evidence: the evidence of a result, put together from what its stages computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.analysis.algorithm_verdict import algorithm_evidence
from lab.analysis.evidence import Evidence, evidence
from lab.analysis.sensor_evidence import Reference
from lab.navigation.belief import assumed_latency, bias_processes
from lab.navigation.solution import Fixes, Imu

if TYPE_CHECKING:
    from lab.result import Result


def evidence_of(result: Result, *, explain: bool = True) -> Evidence:
    """Return what a run says for and against each assumption of its filter; of a log its innovations.

    Parameters
    ----------
    result
        The run.
    explain
        Whether suspicious innovations are explained, which takes several times as long as the run.
    """
    reference = None if result.recorded else reference_of(result)
    if result.algorithm:
        return algorithm_evidence(result.solution_arrays, reference)
    fixes, navigator = result.fixes, result.experiment.navigator
    return evidence(
        filtered(result).solution_arrays,
        result.belief,
        Fixes(result.fix_validity, fixes.position, fixes.velocity_n),
        Imu(result.time, result.gyro.increments, result.accelerometer.increments),
        reference,
        gate=float(navigator.gate),
        explain=explain,
        latency=_latency(result),
        smoothed=result.solution_arrays if navigator.smoother else None,
    )


def _latency(result: Result) -> float:
    """Return the latency that the filter was told [s]."""
    own = (
        result.experiment.sensors.gps.latency if result.recorded is None else result.recorded.log.gnss.latency
    )
    return assumed_latency(result.experiment.navigator, float(own))


def reference_of(result: Result) -> Reference:
    """Return the truth of a simulated run."""
    truth, ideal = result.known_truth("evidence"), result.ideal
    assert ideal is not None
    experiment, aligned = result.experiment, result.aligned
    constants = np.diag(aligned.P) if aligned is not None and experiment.navigator.alignment else None
    return Reference(
        truth,
        result.true_bias,
        ideal.dtheta,
        ideal.dvelocity,
        result.true_scale if result.solution_arrays.scale.size else None,
        result.temperature["true"].values if result.has_temperature else None,
        (result.gyro.saturated, result.accelerometer.saturated),
        bias_processes(experiment.sensors, constants)[0],
    )


def filtered(result: Result) -> Result:
    """Return the run of the filter alone where a smoother worked on it; otherwise the run itself.

    The smoother moves the start and every state after it, and keeps no gain, so that the start, the gains and
    the innovations are judged by the filter's own run.
    """
    if result.algorithm or not result.experiment.navigator.smoother:
        return result
    alone = result.experiment.copy()
    alone.set("navigator.smoother", False)
    return alone.run()
