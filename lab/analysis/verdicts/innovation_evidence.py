"""Innovation evidence: sizes and correlations of the innovations, and the fit of each cause to them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency
from lab.analysis.fix_causes import CAUSES, MotionAtFixes, error_per_cause, gains, matrices, respond, response
from lab.analysis.verdicts import hypotheses, limits
from lab.analysis.verdicts.finding import is_right
from lab.analysis.verdicts.imu_causes import Steps, columns, steps, steps_in_parts
from lab.analysis.verdicts.outliers import NEIGHBOURS, largest_square, outliers, stands_out
from lab.analysis.verdicts.pattern import BINS, bin_squares
from lab.analysis.verdicts.run_means import ALL, NIS, Figure, RunMeans, Series, run_means
from lab.analysis.verdicts.selection import likelihood_gain
from lab.analysis.verdicts.sums import Fit, Kept, Squares, Sum, normal_equations
from lab.base.arrays import Flags, FloatArray
from lab.navigation.filters import blocks
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import SLACK
from lab.navigation.solution import Belief, Fixes, Imu, Solution

LAGS = 5
"""Number of lags of the autocorrelation of the innovations."""
REGRESSORS = CAUSES + sum(len(own) for own in columns().values())
"""Regressors of all causes: those of the fixes first, then those of the inertial sensors."""
PASSES = 4
"""Number of searches for outliers, each in the innovations without the outliers found before."""
MEDIAN_SQUARE = 5.35
"""Median of χ² with six degrees of freedom, the components of a fix."""
FIGURES = 5
"""Parts of `doubt` of `limits` for each of seven figures, six channels and NIS, which depend on each other. A
plain choice."""
LONGEST = 2000
"""Number of fixes of a run for the tests of hypotheses; longer records use the first ones, to bound the
time."""


@dataclass(frozen=True)
class Innovations(Sum):
    """Statistics of the innovations divided by their σ; channels are position, then velocity, N, E, D.

    Attributes
    ----------
    squares : Squares
        Squares of each channel (6,), of the used fixes.
    sums : (6,) array
        Sums of each channel.
    lagged : (LAGS, 6) array
        Sums of products with the innovations one or more fixes later.
    offered : Squares
        Squares of each channel (6,), of all offered fixes except outliers, in the form they would have
        without these outliers.
    follows : (LAGS, 6) array
        Sums of products of `offered`, as `lagged`.
    in_time : Squares
        Squares of these, of position and velocity in each part of the flight (2, 2, BINS).
    span : Kept
        Start and end of each flight [s].
    nis : Squares
        NIS of all offered fixes except outliers.
    causes : Fit
        Fit of these innovations, whitened, to the filter's response to latency and lever arm; suspicious ones
        are also fitted to errors of the inertial sensors (`REGRESSORS`).
    likelihoods : array
        Log-likelihood of each of `hypotheses.HYPOTHESES`, -inf of one that cannot be computed; zero if the
        innovations are not suspicious, or none can be computed.
    outliers, refused : int
        Numbers of non-Gaussian fixes, among the used and among the rejected ones.
    means : RunMeans
        Mean NIS of these, of the whole fix, its position and its velocity.
    """

    squares: Squares
    sums: FloatArray
    lagged: FloatArray
    offered: Squares
    follows: FloatArray
    in_time: Squares
    span: Kept
    nis: Squares
    causes: Fit
    likelihoods: FloatArray
    outliers: int
    refused: int
    means: RunMeans


def offered(solution: Solution, fixes: Fixes, imu: Imu) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of the fixes that the filter used or rejected, and their samples."""
    seen = np.flatnonzero((solution.fix_sample >= 0) | solution.fix_rejected)
    used = solution.fix_sample[seen]
    step = imu.step
    at = np.searchsorted(imu.time, fixes.time[seen] - SLACK * step)
    return seen, np.where(used >= 0, used, np.minimum(at, imu.time.size - 1)).astype(np.intp)


def innovations(
    solution: Solution,
    belief: Belief,
    fixes: Fixes,
    imu: Imu,
    motion: MotionAtFixes,
    *,
    explain: bool = True,
    aided: bool = False,
    names: tuple[str, ...] | None = None,
    gained: FloatArray | None = None,
) -> Innovations:
    """Return the statistics of the innovations of a run.

    The parameters are those of `evidence.evidence`, with the motion at the fixes that were `offered`, and
    their gains as `gained`.
    """
    seen, samples = offered(solution, fixes, imu)
    used = solution.fix_sample[seen] >= 0
    known = np.isfinite(solution.innovation[seen])
    nu, S = np.nan_to_num(solution.innovation[seen]), solution.innovation_covariance[seen]
    relative = normalised(nu, S)
    squares, sums, lagged = sizes(relative[used])
    K = gains(solution, seen) if gained is None else gained
    names = blocks.SCALES[: 2 * (solution.states > blocks.CORE)] if names is None else names
    record = Record(solution, belief, imu, names, seen, samples, nu, S, K)
    apart = outliers(relative, settled=NEIGHBOURS // 2)
    if not aided:  # what the filter would be without the outliers is not modelled here
        # Nor is it known where rounding spoils its covariance.
        with contextlib.suppress(np.linalg.LinAlgError):
            record, apart = _without_outliers(record, known, relative, apart)
    nu, S = record.innovation, record.covariance
    span = float(imu.time[0]), float(imu.time[-1])
    values = np.where(known & ~apart[:, None], normalised(nu, S), np.nan)
    nis = consistency.normalised_squares(nu[~apart], S[~apart])
    found = Innovations(
        squares=Squares(squares.total, known[used].sum(axis=0).astype(np.float64)),
        sums=sums,
        lagged=lagged,
        offered=Squares(np.nansum(values**2, axis=0), np.isfinite(values).sum(axis=0).astype(np.float64)),
        follows=sizes(np.nan_to_num(values))[2],
        in_time=bin_squares(values, fixes.time[seen], span),
        span=Kept(np.array([span])),
        nis=Squares(np.array(nis.sum()), np.array(float(known[~apart].sum()))),
        causes=_empty_fit(),
        likelihoods=np.zeros(len(hypotheses.HYPOTHESES)),
        outliers=int(np.sum(apart & used)),
        refused=int(np.sum(apart & ~used)),
        means=nis_means(fixes.time[seen][~apart], nu[~apart], S[~apart], known[~apart], span),
    )
    if aided or not seen.size:
        return found
    try:
        return _explain_innovations(found, record, motion, apart, explain)
    except np.linalg.LinAlgError:  # causes that cannot be compared are withheld
        return found


def _without_outliers(
    record: Record, known: NDArray[np.bool_], relative: FloatArray, apart: NDArray[np.bool_]
) -> tuple[Record, NDArray[np.bool_]]:
    """Return a record as it would be without outliers, and the mask (m,) of these fixes.

    `apart` masks those that differ from their neighbours in the innovations of the filter itself.

    Through the filter, each outlier affects the innovations after it, which can hide other outliers. So a
    filter that rejects them searches for them, if all other innovations are then right; otherwise they are
    searched one after the other.
    """
    limit = _limit(relative)
    if not apart.any() and not _exceeds(relative, limit):
        return record, apart
    refused = record.tried(np.zeros_like(apart), hypotheses.HYPOTHESES[:1], limit=limit).skipped
    if 0 < refused.mean() <= limits.VERDICT.outlying_fixes and not _are_clustered(
        record.imu.time[record.samples], refused
    ):
        without = record.without(refused, known)
        rest = consistency.normalised_squares(without.innovation[~refused], without.covariance[~refused])
        if is_right(float(rest.sum()), float(known[~refused].sum())):
            return without, refused
    for _ in range(PASSES if apart.any() else 0):
        record = record.without(apart, known)
        before, apart = apart, outliers(normalised(record.innovation, record.covariance))
        if not (apart & ~before).any():
            return record, before
        apart |= before
    return (record.without(apart, known) if apart.any() else record), apart


def may_have_outliers(nu: FloatArray, S: FloatArray) -> Flags:
    """Return whether each run may have outliers, given innovations (runs, m, 6) and S (runs, m, 6, 6)."""
    relative = normalised(np.nan_to_num(nu), S)
    beyond = [_exceeds(own, _limit(own)) for own in relative]
    return stands_out(relative, settled=NEIGHBOURS // 2) | beyond


def _limit(relative: FloatArray) -> float:
    """Return the square of three components beyond which an innovation may be an outlier."""
    if not relative.size:
        return largest_square()
    # Where all are too large alike, R or Q is wrong, and no fix is an outlier for it.
    usual = float(np.median(np.sum(relative**2, axis=1), axis=0)) / MEDIAN_SQUARE
    return largest_square() * max(usual, 1.0)


def _exceeds(relative: FloatArray, limit: float) -> bool:
    """Return whether a position or a velocity innovation exceeds the limit."""
    return bool((np.sum(relative.reshape(-1, 2, 3) ** 2, axis=2) > limit).any())


def _are_clustered(times: FloatArray, which: NDArray[np.bool_]) -> bool:
    """Return whether some fixes are closer together than chance puts them one time in 1,000."""
    n, length = int(which.sum()), max(float(np.ptp(times)), 1e-9)
    part = float(np.ptp(times[which])) / length
    # Distribution of the range of n numbers at random in (0, 1).
    return bool(n > 1 and n * part ** (n - 1) - (n - 1) * part**n < limits.VERDICT.cluster_chance)


def normalised(nu: FloatArray, S: FloatArray) -> FloatArray:
    """Return innovations (…, 6) divided by their σ, from their covariances (…, 6, 6)."""
    return np.asarray(nu / np.sqrt(np.diagonal(S, axis1=-2, axis2=-1)))


class Record(NamedTuple):
    """The m fixes offered to a filter, their effects, and their places in the flight."""

    solution: Solution
    belief: Belief
    imu: Imu
    names: tuple[str, ...]
    seen: NDArray[np.intp]
    samples: NDArray[np.intp]
    innovation: FloatArray
    covariance: FloatArray
    gains: FloatArray

    def steps(self, *, forced: bool = True) -> Iterator[Steps]:
        """Iterate over the propagation of the error; see `imu_causes.steps_in_parts`."""
        return steps_in_parts(self.solution, self.belief, self.imu, self.samples, self.names, forced=forced)

    def without(self, skipped: NDArray[np.bool_], known: NDArray[np.bool_]) -> Record:
        """Return the record as it would be if the filter had not used some fixes; `known` masks values."""
        found = self.tried(skipped, hypotheses.HYPOTHESES[:1])
        return self._replace(
            innovation=found.innovation * known, covariance=found.covariance, gains=found.gains
        )

    def cut(self, count: int) -> Record:
        """Return the record with the first fixes only."""
        return self._replace(
            seen=self.seen[:count],
            samples=self.samples[:count],
            innovation=self.innovation[:count],
            covariance=self.covariance[:count],
            gains=self.gains[:count],
        )

    def tried(
        self,
        skipped: NDArray[np.bool_],
        tried: Sequence[hypotheses.Hypothesis],
        ahead: Iterable[Steps] = (),
        limit: float = np.inf,
    ) -> hypotheses.Outcome:
        """Return the likelihood of the innovations under some hypotheses, without skipped fixes."""
        H, R = matrices(self.solution, self.belief, self.seen)
        return hypotheses.likelihoods(
            self.innovation,
            np.einsum("mij,mj->mi", self.gains, self.innovation),
            ahead or self.steps(forced=False),
            H,
            R,
            self.belief.P0,
            np.append(self.imu.time[0], self.imu.time[self.samples]),
            skipped,
            tried,
            limit,
        )


def none_given(squares: Squares, sums: FloatArray, lagged: FloatArray, means: RunMeans) -> Innovations:
    """Return the statistics of sizes and correlations only, as for a user's algorithm."""
    empty = Squares(np.zeros((2, 2, BINS)), np.zeros((2, 2, BINS)))
    nothing = Squares(np.zeros(()), np.zeros(()))
    likelihoods = np.zeros(len(hypotheses.HYPOTHESES))
    span = Kept(np.zeros((1, 2)))
    return Innovations(
        squares,
        sums,
        lagged,
        squares,
        lagged,
        empty,
        span,
        nothing,
        _empty_fit(),
        likelihoods,
        outliers=0,
        refused=0,
        means=means,
    )


def nis_means(
    time: FloatArray, nu: FloatArray, S: FloatArray, known: NDArray[np.bool_], span: tuple[float, float]
) -> RunMeans:
    """Return mean NIS of a run, or of each of some runs: of whole fixes, and of the kinds of innovation.

    Parameters
    ----------
    time : (m,) array
        Times of the fixes [s].
    nu, S : (…, m, 6) and (…, m, 6, 6) arrays
        Innovations, zero where nothing is measured, and their covariances.
    known : (m, 6) array
        Mask of what is measured.
    span
        Start and end of the flight [s].
    """

    def series(group: str, own: slice) -> Series:
        width = own.stop - own.start
        nis = consistency.normalised_squares(
            nu[..., own].reshape(-1, width), S[..., own, own].reshape(-1, width, width)
        ).reshape(nu.shape[:-1])
        degrees = known[:, own].sum(axis=1).astype(np.float64)
        return Series(Figure(NIS, group), time, nis, degrees, 0.0, quartered=group == ALL)

    kinds = (ALL, slice(0, 6)), ("position", slice(0, 3)), ("velocity", slice(3, 6))
    return run_means([series(group, own) for group, own in kinds], span)


def _empty_fit() -> Fit:
    return Fit(np.zeros((REGRESSORS, REGRESSORS)), np.zeros(REGRESSORS), np.zeros(()))


def _explain_innovations(
    found: Innovations, record: Record, motion: MotionAtFixes, apart: NDArray[np.bool_], explain: bool
) -> Innovations:
    """Return the same with the fit of causes and, for suspicious innovations, of hypotheses."""
    solution, belief, imu, names, seen, samples, nu, S, _ = record
    causes = error_per_cause(motion)
    kept = ~apart
    answer = response(record.gains, solution, belief, seen, samples, imu.time, motion, causes, names)
    fit = _fit(answer[kept], nu[kept], S[kept])
    whole = _empty_fit()
    whole.matrix[:CAUSES, :CAUSES], whole.vector[:CAUSES] = fit.matrix, fit.vector
    part = replace(found, causes=whole._replace(squares=fit.squares))
    if not explain or not needs_explanation(part):
        return part
    record, kept, causes = record.cut(LONGEST), kept[:LONGEST], causes[:LONGEST]
    # The steps of a long flight take 50 MB, so they are computed part by part, and twice.
    all_of_them = (
        [steps(solution, belief, imu, record.samples, record.names)]
        if record.seen.size < LONGEST
        else list[Steps]()
    )
    answer = _response_to_all(record, all_of_them or record.steps(), causes)
    return replace(
        found,
        causes=_fit(answer[kept], record.innovation[kept], record.covariance[kept]),
        likelihoods=record.tried(~kept, hypotheses.HYPOTHESES, all_of_them).likelihoods,
    )


def _response_to_all(record: Record, ahead: Iterable[Steps], causes: FloatArray) -> FloatArray:
    """Return the response of the innovations (m, 6, REGRESSORS) to the causes of fixes and of sensors."""
    by_fixes = np.zeros((*causes.shape[:2], REGRESSORS))
    by_fixes[:, :, :CAUSES] = causes
    wider = (0, 0), (0, 0), (CAUSES, 0)
    onwards = ((part.transition, np.pad(part.forced, wider)) for part in ahead)
    return respond(record.gains, matrices(record.solution, record.belief, record.seen)[0], onwards, by_fixes)


def _fit(answer: FloatArray, nu: FloatArray, S: FloatArray) -> Fit:
    """Return the normal equations of whitened innovations on the responses to causes.

    Raises
    ------
    LinAlgError
        If a covariance S is not positive definite, because rounding has spoilt it.
    """
    white = consistency.whitened(np.concatenate((answer, nu[..., None]), axis=2), S)
    if white is None:
        raise np.linalg.LinAlgError("a covariance of the innovations is not positive definite")
    return normal_equations(white[..., :-1], white[..., -1])


def needs_explanation(found: Innovations) -> bool:
    """Return whether innovations are suspicious, or latency and lever arm may explain a part of them."""
    fit = Fit(found.causes.matrix[None], found.causes.vector[None], found.causes.squares)
    return is_suspicious(found) or likelihood_gain(fit, range(CAUSES)) >= limits.VERDICT.suspicious_ratio


def is_suspicious(found: Innovations) -> bool:
    """Return whether innovations are too large, too small or correlated, beyond chance."""
    for squares in (found.offered, found.nis):
        for total, count in zip(np.atleast_1d(squares.total), np.atleast_1d(squares.number), strict=True):
            if count:
                low, high = consistency.chi_square_interval(
                    float(count), 1, 1 - limits.VERDICT.doubt / FIGURES
                )
                if not low <= total <= high:
                    return True
    after = found.follows / np.maximum(found.offered.total, 1e-12)
    count = np.maximum(found.offered.number, 1.0)
    return bool(
        (
            # Each correlation of m white values has σ 1/√m, and the sum of k of them √(k/m).
            np.abs(after.sum(axis=0)) * np.sqrt(count / after.shape[0]) > limits.VERDICT.correlation_sigmas
        ).any()
        or (np.abs(after[0]) * np.sqrt(count) > limits.VERDICT.correlation_sigmas).any()
    )


def sizes(normalised: FloatArray) -> tuple[Squares, FloatArray, FloatArray]:
    """Return squares, sums (…, 6) and lagged products (…, LAGS, 6) of innovations (…, m, 6) in their σ."""
    m = normalised.shape[-2]
    lagged = np.stack(
        [
            np.einsum("...mc,...mc->...c", normalised[..., k:, :], normalised[..., : max(m - k, 0), :])
            for k in range(1 + LAGS)
        ],
        axis=-2,
    )
    count = np.full(MEASUREMENTS, float(m))
    return Squares(lagged[..., 0, :], count), normalised.sum(axis=-2), lagged[..., 1:, :]
