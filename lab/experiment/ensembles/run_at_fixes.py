"""Run at fixes: what an ensemble takes from one run, at the fixes and for the whole flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.budget import believed_sigma
from lab.analysis.consistency import find_uncertain_states, normalised_squares
from lab.analysis.errors import choose_path_samples, compute_errors, error_state, outage_ends
from lab.analysis.feedforward import CORRECTED, FreeRun
from lab.analysis.fix_causes import of_fixes
from lab.analysis.verdicts.evidence import Evidence, position_nees, whole_seconds
from lab.analysis.verdicts.innovation_evidence import Innovations, normalised, sizes
from lab.analysis.verdicts.run_evidence import collect_evidence, make_reference
from lab.analysis.verdicts.sums import Squares, Sum
from lab.base.arrays import FloatArray
from lab.experiment.result import Result
from lab.navigation.filters.kalman import MEASUREMENTS

WIDE = 9
"""Errors of position, velocity and attitude: the `QUANTITIES` of an ensemble."""


@dataclass(frozen=True)
class ChannelSums(Sum):
    """Sums over the innovations in their σ of each channel; see `Innovations`.

    Attributes
    ----------
    squares : Squares
        Squares of each channel (6,).
    sums : (6,) array
        Sums of each channel.
    lagged : (lags, 6) array
        Sums of products with later innovations.
    """

    squares: Squares
    sums: FloatArray
    lagged: FloatArray

    @classmethod
    def of(cls, innovations: Innovations) -> ChannelSums:
        """Return the sums in the evidence of a run."""
        return cls(innovations.squares, innovations.sums, innovations.lagged)

    @classmethod
    def of_used(cls, innovation: FloatArray, covariance: FloatArray) -> list[ChannelSums]:
        """Return the sums of the used fixes of some runs; NaN is unknown.

        Parameters
        ----------
        innovation, covariance : (runs, m, 6), (runs, m, 6, 6) arrays
            Innovations and their covariances.
        """
        number = np.isfinite(innovation).sum(axis=1).astype(np.float64)
        squares, sums, lagged = sizes(normalised(np.nan_to_num(innovation), covariance))
        return [
            cls(Squares(total, known), whole, later)
            for total, known, whole, later in zip(squares.total, number, sums, lagged, strict=True)
        ]


WITHOUT_ENDS = np.full((2, 9), np.nan, dtype=np.float32)
"""What `rms_at_ends` returns of a flight without outages."""


def quantile_of_horizontal(horizontal: FloatArray) -> float:
    """Return the 95 % quantile of a horizontal error (n,); NaN if it is unknown."""
    known = horizontal[np.isfinite(horizontal)]
    if not known.size:
        return float("nan")
    # Of thousands of runs, `numpy.quantile` takes a tenth of the time of their figures.
    place = 0.95 * (known.size - 1)
    low, high = int(place), min(int(place) + 1, known.size - 1)
    ordered = np.partition(known, (low, high))
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))


def rms_at_ends(error: FloatArray, sigma: FloatArray) -> NDArray[Any]:
    """Return the root mean square (2, 9) of errors (k, 9), and of σ of the filter; NaN if unknown.

    It is in single precision, because it is kept of each of many runs.
    """
    both = np.stack((error, sigma))
    known = np.isfinite(both)
    count, square = known.sum(axis=1), np.sum(both**2, axis=1, where=known)
    mean = np.divide(square, count, out=np.full(count.shape, np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean), dtype=np.float32)


class RunAtFixes(NamedTuple):
    """The values of one run: at the m fixes that it used, at k times between them, and for the whole run.

    Attributes
    ----------
    time, nees, nis : (m,) arrays
        Times of the fixes [s], NEES and NIS.
    grid, between : (k,) arrays
        Times between the fixes [s], and NEES of the position there.
    between_degrees, degrees, nis_degrees : int
        Degrees of freedom of `between`, `nees` and `nis`.
    error, sigma : (m, 9) arrays
        Errors after the fixes, and their σ, in the order of `ensemble.QUANTITIES` and in `ensemble.UNITS`.
    rms, largest : (9,) arrays
        Root mean square and largest size of the errors along the flight.
    most : float
        95 % quantile of the horizontal error along the flight [m]; NaN if unknown.
    at_outage_ends : (2, 9) array
        Root mean square of the errors, and of their σ, over the ends of the GPS outages; NaN if unknown, or
        without an outage.
    innovations : ChannelSums
        Sums of the innovations.
    span : tuple of float
        Start and end of the flight [s].
    evidence : Evidence or None
        Evidence of the run; None for one that is not judged.
    free : FreeRun
        How far its navigator runs free.
    seconds : float
        Computing time of the navigator [s].
    algorithm : str
        Name of the user's own navigator; empty for those of the lab.
    """

    time: FloatArray
    nees: FloatArray
    nis: FloatArray
    grid: FloatArray
    between: FloatArray
    between_degrees: int
    error: FloatArray
    sigma: FloatArray
    rms: FloatArray
    largest: FloatArray
    most: float
    at_outage_ends: NDArray[Any]
    degrees: int
    nis_degrees: int
    innovations: ChannelSums
    span: tuple[float, float]
    evidence: Evidence | None
    free: FreeRun
    seconds: float
    algorithm: str


def figures_of_run(run: RunAtFixes, sigma: FloatArray) -> FloatArray:
    """Return the figures of a run that a sweep keeps.

    These are rms, largest size and rms σ of nine errors, NEES and NIS with their degrees of freedom, and the
    95 % of the horizontal error.

    Parameters
    ----------
    run
        The run.
    sigma : (l, 9) array
        σ of the filter along the path.
    """
    tests = [
        number
        for values, degrees in ((run.nees, run.degrees), (run.nis, run.nis_degrees))
        for number in (mean_of_known(values), float(degrees) if degrees else np.nan)
    ]
    return np.concatenate((run.rms, run.largest, np.sqrt(np.mean(sigma**2, axis=0)), tests, [run.most]))


def figures_of_result(result: Result) -> FloatArray:
    """Return the figures of a run that was done alone; see `figures_of_run`."""
    path = choose_path_samples(result.time, float(result.experiment.sensors.gps.period))
    return figures_of_run(keep_values(result, judged=False), believed_sigma(result, path)[:, :WIDE])


def mean_of_known(values: FloatArray) -> float:
    """Return the mean of the known values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def keep_values(result: Result, *, explain: bool = True, judged: bool = True) -> RunAtFixes:
    """Return the kept values of a result; unknown values of a log are NaN.

    `judged` is true if the evidence is wanted, and `explain` if suspicious innovations are to be explained.
    """
    solution = result.solution_arrays
    used = np.flatnonzero(solution.fix_sample >= 0)
    at = solution.fix_sample[used]

    grid, apart, apart_degrees = _figures_between_fixes(result)
    error, sigma = _errors(result, at)
    rms, largest, most, at_outage_ends = _sizes(result)
    nees, degrees = _nees(result, at, of_fixes(solution.fix_covariance, used))
    nu = solution.innovation
    measured = np.isfinite(nu).sum(axis=1)
    found = collect_evidence(result, result.filtered, explain=explain) if judged else None
    S = solution.innovation_covariance[used]
    return RunAtFixes(
        time=result.fixes.time[used],
        nees=nees,
        nis=normalised_squares(np.nan_to_num(nu[used]), S),
        grid=grid,
        between=apart,
        between_degrees=apart_degrees,
        error=error,
        sigma=sigma,
        rms=rms,
        largest=largest,
        most=most,
        at_outage_ends=at_outage_ends,
        degrees=degrees,
        nis_degrees=int(measured.max()) if measured.any() else MEASUREMENTS,
        innovations=ChannelSums.of_used(nu[None, used], S[None])[0]
        if found is None
        else ChannelSums.of(found.innovations),
        span=(float(result.time[0]), float(result.time[-1])),
        evidence=found,
        free=result.free_run if judged else CORRECTED,
        seconds=result.seconds,
        algorithm=result.algorithm,
    )


def _nees(result: Result, at: NDArray[np.int64], P: FloatArray) -> tuple[FloatArray, int]:
    """Return NEES at samples (m,) with covariances P (m, n, n), and its degrees of freedom."""
    if result.missing_reason("consistency"):
        return np.full(at.size, np.nan), 0
    true = make_reference(result)
    x = error_state(result.solution_arrays, at, true.truth, true.bias, true.scale, true.further)
    return normalised_squares(x, P), int(find_uncertain_states(P).size) if P.size else 0


def _figures_between_fixes(result: Result) -> tuple[FloatArray, FloatArray, int]:
    """Return times between the fixes, NEES of the position there, and its degrees of freedom."""
    if result.missing_reason("consistency"):
        return np.zeros(0), np.zeros(0), 0
    at = np.maximum(whole_seconds(result.time) - 1, 1)
    nees, degrees = position_nees(result.solution_arrays, at, make_reference(result))
    return result.time[at], nees, degrees


def _errors(result: Result, at: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Return errors and their σ (m, 9) at samples (m,)."""
    sigma = believed_sigma(result, at)[:, :WIDE]
    return np.full((at.size, WIDE), np.nan) if result.missing_reason("errors") else _errors_at_samples(
        result, at
    ), sigma


def _sizes(result: Result) -> tuple[FloatArray, FloatArray, float, NDArray[Any]]:
    """Return figures of the errors known along the path, and at the ends of outages.

    These are `rms`, `largest`, `most` and `at_outage_ends` of `RunAtFixes`.
    """
    gps, time = result.experiment.sensors.gps, result.time
    at_ends = rms_at_ends(*_errors(result, outage_ends(time, gps.outages, result.epoch)))
    if result.missing_reason("errors"):
        return np.full(WIDE, np.nan), np.full(WIDE, np.nan), np.nan, at_ends
    along = _errors_at_samples(result, choose_path_samples(time, float(gps.period)))
    known = np.isfinite(along)
    count = known.sum(axis=0)
    square = np.sum(along**2, axis=0, where=known)
    rms = np.sqrt(np.divide(square, count, out=np.full(WIDE, np.nan), where=count > 0))
    largest = np.max(np.abs(along), axis=0, where=known, initial=0.0)
    most = quantile_of_horizontal(np.hypot(*along[:, :2].T))
    return np.asarray(rms), np.where(count > 0, largest, np.nan), most, at_ends


def _errors_at_samples(result: Result, at: NDArray[np.int64]) -> FloatArray:
    """Return the errors (m, 9) at samples (m,)."""
    solution = result.solution_arrays
    truth = result.known_truth("errors").taken(at)
    return compute_errors(solution.position[at], solution.velocity_n[at], solution.q_nb[at], truth)
