"""State advice: the settings that give a filter states for the error that a finding names.

The filter of a simulated run assumes the errors that are simulated, so the setting of the filter is all that
changes: the truth of a run that follows advice stays the same. The filter of a log assumes what its settings
say of the sensors, so their sizes, from the innovations, are a part of the advice.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lab.analysis.fix_causes import gains
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import ADVICE, KEEP_R
from lab.analysis.verdicts.finding import Change, Finding, Verdict
from lab.analysis.verdicts.finding_table import CORRELATION, SENSORS
from lab.analysis.verdicts.innovation_evidence import Record, normalised, offered
from lab.analysis.verdicts.outliers import NEIGHBOURS, outliers
from lab.analysis.verdicts.receiver_drift import ReceiverDrift, likely_drift
from lab.analysis.verdicts.trial import Repeatable
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number, round_digits
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.navigation.filters.blocks import CORE
from lab.navigation.solution import Fixes, Imu
from lab.run.experiment_settings import ExperimentSettings


class States(NamedTuple):
    """States for an error.

    Attributes
    ----------
    switch, size : str
        Setting of the filter that adds the states, and setting of the sensors with their σ.
    words : str
        What they estimate.
    unit : float
        Unit of `size` in SI units.
    parts : int
        Number of the parts whose norm the innovations give.
    """

    switch: str
    size: str
    words: str
    unit: float
    parts: int


SCALED = 21
"""Number of states of a filter with scale factors."""
_SCALES = tuple(f"{kind} scale factor" for kind in SENSORS)
_DEGREE = np.pi / 180
"""One degree [rad]: the unit of these settings."""
_STATES = {
    CORRELATION: States(
        "navigator.estimate_gps_drift",
        "sensors.gps.correlated_sigma",
        "the slow error of the receiver",
        1.0,
        1,
    ),
    "gyro g-sensitivity": States(
        "navigator.estimate_g_sensitivity",
        "sensors.gyro.g_sensitivity",
        "what the gyros feel of the specific force",
        _DEGREE / STANDARD_GRAVITY,
        3,
    ),
    **{
        f"{kind} misalignment": States(
            "navigator.estimate_misalignments",
            f"sensors.{kind}.misalignment",
            "the misalignments",
            _DEGREE,
            6,
        )
        for kind in SENSORS
    },
}
"""The states by the name of the error in a finding."""
_TIME = "sensors.gps.correlation_time"


def advise_simulated(verdict: Verdict, experiment: ExperimentSettings, P0: FloatArray | None) -> Verdict:
    """Return a verdict on simulated runs, with the settings of the filter that add states.

    An error whose size is zero in the settings, as one that is hidden in a homework, keeps its advice.

    Parameters
    ----------
    verdict
        The verdict.
    experiment
        The settings of the runs.
    P0 : (n, n) array or None
        Initial covariance of their filter; None if each run has its own, as after an alignment.
    """
    scales = _sigmas_of_scales(verdict, experiment)

    def advised(finding: Finding) -> Finding:
        if finding.quantity in _SCALES and scales:
            return (
                replace(finding, changes=()) if P0 is None else _with_scales(finding, experiment, P0, scales)
            )
        states = _states(finding, experiment)
        if states is None or not np.any(experiment.get(states.size)):
            return finding
        return _change_advice(finding, states)

    return _replace_findings(verdict, [advised(one) for one in verdict.findings])


def advise_log(verdict: Verdict, run: Repeatable) -> Verdict:
    """Return a verdict on the innovations of a log, with the settings that add states."""

    def advised(finding: Finding) -> Finding:
        states = _states(finding, run.experiment)
        if states is None:
            return finding
        if finding.quantity != CORRELATION:
            size = round_digits(finding.factor / np.sqrt(states.parts) / states.unit)
            return _change_advice(finding, states, (Change(states.size, size),))
        drift = _drift(run)
        if drift is None:
            return finding
        size, time = round_digits(drift.sigma), round_digits(drift.time)
        changes = [Change(states.size, size), Change(_TIME, time)]
        if drift.white != 1:
            horizontal, vertical, velocity = run.experiment.navigator.r_factors
            factors = [round_digits(drift.white * horizontal), round_digits(drift.white * vertical), velocity]
            changes.append(Change("navigator.r_factors", factors))
        return _change_advice(finding, states, tuple(changes))

    return _replace_findings(verdict, [advised(one) for one in verdict.findings])


def _sigmas_of_scales(verdict: Verdict, experiment: ExperimentSettings) -> dict[str, float]:
    """Return σ of the scale factors [%] by their setting that findings advise and the settings leave zero."""
    changes = [change for one in verdict.findings if one.quantity in _SCALES for change in one.changes]
    return {
        change.path: float(change.value)
        for change in changes
        if isinstance(change.value, float) and not np.any(experiment.get(change.path))
    }


def _with_scales(
    finding: Finding, experiment: ExperimentSettings, P0: FloatArray, sigmas: dict[str, float]
) -> Finding:
    """Return a finding about scale factors that gives the filter their σ, and not the sensors.

    With σ as a setting of the sensors, the simulated scale factors would change.
    """
    navigator = experiment.navigator
    whole = np.zeros((SCALED, SCALED))
    whole[:CORE, :CORE] = P0[:CORE, :CORE] / navigator.p0_scale
    words = []
    for at, kind in enumerate(SENSORS):
        path = f"sensors.{kind}.scale_factor_sigma"
        sigma = np.broadcast_to(np.asarray(experiment.get(path), dtype=np.float64), 3)
        if path in sigmas:
            sigma = np.full(3, sigmas[path])
            words.append(f"{format_number(sigmas[path])} % of the {kind}s")
        states = np.arange(CORE + 3 * at, CORE + 3 * at + 3)
        whole[states, states] = (sigma / 100) ** 2 / navigator.p0_scale
    diagonal = np.diag(whole)
    value = diagonal if np.array_equal(whole, np.diag(diagonal)) else whole
    advice = ADVICE["set P0 of scale factors"].filled(sigmas=" and ".join(words), p0=value.tolist())
    return replace(finding, advice=advice.text, changes=advice.changes)


def _states(finding: Finding, experiment: ExperimentSettings) -> States | None:
    """Return the states for the error of a finding; None if there are none, or the filter has them.

    A receiver that filters its fixes has no slow error: its errors are correlated instead of white, and not
    beside white ones.
    """
    states = _STATES.get(finding.quantity)
    if states is None or finding.advice.startswith(KEEP_R) or experiment.get(states.switch):
        return None
    return states


def _change_advice(finding: Finding, states: States, changes: tuple[Change, ...] = ()) -> Finding:
    settings = ", ".join(f"{one.path} to {_text(one.value)}" for one in changes)
    row = "estimate with settings" if changes else "estimate"
    advice = ADVICE[row].filled(switch=states.switch, settings=settings, states=states.words)
    return replace(finding, advice=advice.text, changes=(*advice.changes, *changes))


def _text(value: object) -> str:
    return format_number(value) if isinstance(value, float) else str(value)


def _replace_findings(verdict: Verdict, findings: list[Finding]) -> Verdict:
    """Return a verdict with other advice; the same object if none is other."""
    same = all(one is other for one, other in zip(findings, verdict.findings, strict=True))
    return verdict if same else replace(verdict, findings=tuple(findings))


def _drift(run: Repeatable) -> ReceiverDrift | None:
    """Return the slow error of the receiver of a log; None without a likely one."""
    filtered = run.filtered
    solution = filtered.solution
    imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
    fixes = Fixes(run.fix_validity, run.fixes.position, run.fixes.velocity_n)
    seen, samples = offered(solution, fixes, imu)
    innovation = np.nan_to_num(solution.innovation[seen])
    covariance = solution.innovation_covariance[seen]
    K = gains(solution, seen) if filtered.gains is None else filtered.gains
    record = Record(solution, run.belief, imu, run.blocks, seen, samples, innovation, covariance, K)
    found = likely_drift(record, outliers(normalised(innovation, covariance), settled=NEIGHBOURS // 2))
    return None if found is None or found.gain < limits.VERDICT.likelihood_ratio else found
