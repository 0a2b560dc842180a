"""Lane evidence: the evidence of runs abreast, whose arrays are as large as each other, computed together.

The figures are those of `evidence`, and most functions are its own. A single run spends most of the time of
its evidence between some hundred small arrays; eight together spend it once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.analysis.consistency import whitened
from lab.analysis.fix_causes import CAUSES, MotionAtFixes, error_per_cause, gains, respond, transitions
from lab.analysis.verdicts.aid_verdict import aid_squares
from lab.analysis.verdicts.evidence import (
    Evidence,
    Usage,
    linearity_abreast,
    series_between,
    series_of_states,
    start_squares,
)
from lab.analysis.verdicts.fix_evidence import fix_errors_abreast
from lab.analysis.verdicts.hypotheses import HYPOTHESES
from lab.analysis.verdicts.innovation_evidence import (
    REGRESSORS,
    Innovations,
    nis_means,
    normalised,
    sizes,
)
from lab.analysis.verdicts.pattern import bin_squares
from lab.analysis.verdicts.run_means import RunMeans, run_means
from lab.analysis.verdicts.sensor_evidence import SensorErrors
from lab.analysis.verdicts.sums import Fit, Kept, Squares, normal_equations
from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import NO_AIDS
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.solution import Belief, Fixes, Solution


class Abreast(NamedTuple):
    """What filters with the same assumptions did abreast: all used each of m fixes, none of them an outlier.

    Attributes
    ----------
    solutions : sequence of Solution
        Their solutions at some samples.
    belief : Belief
        Their assumptions.
    fixes : sequence of Fixes
        Their fixes, at the filters' times of validity.
    sampled : (m,) array
        Times of the samples at which they were used [s].
    motion : MotionAtFixes
        Motion at the fixes, (runs, m, …) each.
    start : (runs, n) array
        Errors of all states at the start.
    x, nees, nis : (runs, m, n), (runs, m), (runs, m) arrays
        Errors after the fixes, and their normalised squares.
    seconds, between : (k,), (runs, k) arrays
        Times of `evidence.between_fixes` [s], and NEES of the position there.
    sensors : sequence of SensorErrors
        Errors of the sensors.
    names : tuple of str
        The further blocks of the filters.
    gate, latency : float
        As of `evidence.evidence`.
    """

    solutions: Sequence[Solution]
    belief: Belief
    fixes: Sequence[Fixes]
    sampled: FloatArray
    motion: MotionAtFixes
    start: FloatArray
    x: FloatArray
    nees: FloatArray
    nis: FloatArray
    seconds: FloatArray
    between: FloatArray
    sensors: Sequence[SensorErrors]
    names: tuple[str, ...]
    gate: float
    latency: float


def uncertain_states(solution: Solution) -> bytes:
    """Return which states have a variance, a byte each; empty for a filter that is judged alone.

    That is one that did not use each fix, or whose variances or innovations are none at some fixes. Runs with
    the same states can be judged abreast.
    """
    some = np.diagonal(solution.fix_covariance, axis1=1, axis2=2) > 0
    S = np.diagonal(solution.innovation_covariance, axis1=1, axis2=2)
    regular = (
        (solution.fix_sample >= 0).all()
        and np.isfinite(solution.innovation).all()
        and (S > 0).all()
        and (some == some[:1]).all()
    )
    return some[0].tobytes() if regular else b""


@OneBlasThread()
def evidence_abreast(runs: Abreast, truth: Truth) -> list[Evidence | None]:
    """Return the evidence of each run, whose suspicious innovations are not explained.

    None stands for a run that must be judged alone: for an outlier or a long latency of its fixes, or for a
    covariance that rounding has spoilt.

    Parameters
    ----------
    runs
        The runs.
    truth
        The flight of all.
    """
    solution, times = runs.solutions[0], runs.fixes[0].time
    P = np.stack([one.fix_covariance for one in runs.solutions])
    causes = error_per_cause(runs.motion)
    innovations = _innovations(runs, causes, (float(truth.time[0]), float(truth.time[-1])))
    if innovations is None or not (np.isfinite(runs.nees).all() and np.isfinite(runs.between).all()):
        return [None] * len(P)
    positions, velocities = (
        np.stack([getattr(one, name) for one in runs.fixes]) for name in ("position", "velocity_n")
    )
    series = series_of_states(runs.sampled, runs.x, P, solution, runs.nees)
    states = run_means(
        [*series, series_between(runs.seconds, runs.between, 3)],
        (float(truth.time[0]), float(truth.time[-1])),
    )
    count = times.size
    parts = zip(
        innovations,
        fix_errors_abreast(runs.belief, times, positions, velocities, causes, truth),
        runs.sensors,
        start_squares(runs.belief, runs.start, scaled=solution.scale.shape[1] > 0),
        _split_runs(states),
        linearity_abreast(runs.belief, P, runs.motion.force_n, runs.motion.C_nb),
        strict=True,
    )
    assumed = np.append(runs.latency, runs.belief.lever_arm)[None]
    return [
        None
        if of_fixes is None
        else Evidence(
            1,
            of_innovations,
            Usage(count, count, 0, (1 - runs.gate) * count if runs.gate else 0.0),
            Kept(assumed),
            of_fixes,
            of_sensors,
            of_start,
            of_states,
            linearity,
            aid_squares(solution, NO_AIDS.kind, runs.gate),
        )
        for of_innovations, of_fixes, of_sensors, of_start, of_states, linearity in parts
    ]


def _split_runs(means: RunMeans) -> list[RunMeans]:
    """Return the means of each run."""
    return [
        RunMeans(
            means.figures, *(Kept(part.values[run : run + 1]) for part in (means.means, means.independent))
        )
        for run in range(means.runs)
    ]


def _innovations(runs: Abreast, causes: FloatArray, span: tuple[float, float]) -> list[Innovations] | None:
    """Return the statistics of the innovations; None if a covariance is not positive definite."""
    times, count = runs.fixes[0].time, len(runs.solutions)
    nu, S = (
        np.stack([getattr(one, name) for one in runs.solutions])
        for name in ("innovation", "innovation_covariance")
    )
    relative = normalised(nu, S)
    squares, sums, lagged = sizes(relative)
    in_time = bin_squares(relative, times, span)
    known = np.ones(nu.shape[1:], dtype=np.bool_)
    means = _split_runs(nis_means(times, nu, S, known, span))
    answer = _answers(runs, causes)
    both = np.concatenate((answer, nu[..., None]), axis=-1).reshape(-1, MEASUREMENTS, CAUSES + 1)
    white = whitened(both, S.reshape(-1, MEASUREMENTS, MEASUREMENTS))
    if white is None or not np.isfinite(runs.nis).all():
        return None
    white = white.reshape(count, -1, MEASUREMENTS, CAUSES + 1)
    fit = normal_equations(white[..., :-1], white[..., -1])
    matrix, vector = np.zeros((count, REGRESSORS, REGRESSORS)), np.zeros((count, REGRESSORS))
    matrix[:, :CAUSES, :CAUSES], vector[:, :CAUSES] = fit.matrix, fit.vector
    total, number = runs.nis.sum(axis=1), float(known.sum())
    return [
        Innovations(
            squares=Squares(squares.total[run], squares.number),
            sums=sums[run],
            lagged=lagged[run],
            offered=Squares(squares.total[run], squares.number),
            follows=lagged[run],
            in_time=Squares(*(part[run] for part in in_time)),
            span=Kept(np.array([span])),
            nis=Squares(np.array(total[run]), np.array(number)),
            causes=Fit(matrix[run], vector[run], np.array(fit.squares[run])),
            likelihoods=np.zeros(len(HYPOTHESES)),
            outliers=0,
            refused=0,
            means=means[run],
        )
        for run in range(count)
    ]


def _answers(runs: Abreast, causes: FloatArray) -> FloatArray:
    """Return the response of the innovations (runs, m, 6, CAUSES) to the causes: `fix_causes.response`."""
    n, every = runs.solutions[0].states, np.arange(runs.sampled.size)
    parts = MotionAtFixes(*(part[:, :-1].reshape(-1, *part.shape[2:]) for part in runs.motion))
    dt = np.tile(np.diff(runs.sampled), len(causes))
    moves = transitions(parts, dt, n, runs.names).reshape(len(causes), -1, n, n)
    nothing = np.zeros((every.size, n, CAUSES))
    # The first step ends at the first fix; before it, there is no error.
    begin = np.eye(n)[None], nothing[:1]
    return np.stack(
        [
            respond(gains(one, every), one.fix_H, (begin, (move, nothing[1:])), fixes)
            for one, move, fixes in zip(runs.solutions, moves, causes, strict=True)
        ]
    )
