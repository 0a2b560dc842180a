"""Run evidence: the evidence of a run, from the results of its stages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.analysis.fix_causes import MotionAtFixes
from lab.analysis.verdicts.algorithm_verdict import algorithm_evidence
from lab.analysis.verdicts.evidence import Evidence, evidence
from lab.analysis.verdicts.true_motion import Reference
from lab.base.arrays import FloatArray
from lab.navigation.belief import bias_processes, hidden_by_fixes, of_bias_states
from lab.navigation.filters.blocks import CONSIDERED, GPS_DRIFT, LATENCY, LEVER_ARM, SCALES
from lab.navigation.solution import Fixes, Imu, Solution
from lab.run.further_truth import errors_of_states
from lab.run.run import Run


class Filtered(NamedTuple):
    """The filter's own run.

    Attributes
    ----------
    solution : Solution
        Its solution.
    motion : MotionAtFixes or None
        Motion at the offered fixes, if the solution has no velocity at all samples.
    gains : (m, states, 6) array or None
        Their gains, if it has no P after each fix.
    """

    solution: Solution
    motion: MotionAtFixes | None = None
    gains: FloatArray | None = None


def collect_evidence(run: Run, filtered: Filtered, *, explain: bool = True) -> Evidence:
    """Return the evidence of a run for each assumption of its filter; for a log, from its innovations.

    Parameters
    ----------
    run
        The run.
    filtered
        The filter's own run. A smoother changes the start and all later states, and keeps no gains,
        so the start, the gains and the innovations are those of the filter's own run.
    explain
        Whether to explain suspicious innovations, which takes several times as long as the run.
    """
    reference = None if run.missing_reason("consistency") else make_reference(run)
    if run.algorithm:
        span = float(run.time[0]), float(run.time[-1])
        return algorithm_evidence(run.solution_arrays, run.fixes.time, span, reference)
    fixes, navigator = run.fixes, run.experiment.navigator
    return evidence(
        filtered.solution,
        run.belief,
        Fixes(run.fix_validity, fixes.position, fixes.velocity_n),
        Imu(run.time, run.gyro.increments, run.accelerometer.increments),
        reference,
        aided=bool(run.aids.time.size or set(run.blocks) - {*SCALES, *CONSIDERED}),
        names=run.blocks,
        calibrating=bool({GPS_DRIFT, LEVER_ARM, LATENCY} & set(run.blocks)),
        aid_kinds=run.aids.kind,
        gate=float(navigator.gate),
        explain=explain,
        latency=run.latency,
        smoothed=run.solution_arrays if navigator.smoother else None,
        motion=filtered.motion,
        gains=filtered.gains,
    )


def make_reference(run: Run) -> Reference:
    """Return the truth of a simulated run."""
    truth, ideal = run.known_truth("evidence"), run.ideal
    assert ideal is not None
    experiment, aligned = run.experiment, run.aligned
    constants = np.diag(aligned.P) if aligned is not None and experiment.navigator.alignment else None
    drives = bias_processes(of_bias_states(experiment.sensors, experiment.navigator), constants)
    return Reference(
        truth,
        run.true_bias,
        ideal.dtheta,
        ideal.dvelocity,
        run.true_scale if run.solution_arrays.scale.size else None,
        run.imu_temperature() if experiment.sensors.temperature.profile != "none" else None,
        (run.gyro.saturated, run.accelerometer.saturated),
        drives[0],
        run.true_further() if run.solution_arrays.further.size else None,
        errors_of_states(run.simulated_settings, run.blocks, ideal),
        hidden=hidden_by_fixes(experiment.sensors),
    )
