"""Fix verdict: findings about R and the receiver from the true errors of the fixes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Finding, Weighed, Wording, judge_size
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.fix_evidence import RATIOS, TIMES, FixErrors
from lab.analysis.verdicts.pattern import AXES, channel, stretch, stretch_times
from lab.analysis.verdicts.selection import rivals, select_causes
from lab.analysis.verdicts.sums import Fit, Squares, pseudoinverse
from lab.base.arrays import FloatArray


def judge_fixes(fixes: FixErrors, sizes: FloatArray, assumed: FloatArray) -> list[Weighed]:
    """Judge R, the correlation of the fixes, latency and lever arm by the errors of the fixes.

    `sizes` are the rms of the position and the velocity innovations in their σ, `assumed` are the latency and
    the lever arm (4,) that the filter assumed.
    """
    if not fixes.count:
        return []
    apart = judge_outliers(fixes.outliers, fixes.count + fixes.outliers, FINDINGS["outliers"])
    fits = _fits(fixes)
    best = np.unravel_index(np.argmax(fits.likelihood), fits.likelihood.shape)
    time, ratio = TIMES[best[0]], RATIOS[best[1]]
    gain = float(fits.likelihood[best] - fits.likelihood[_WHITE])
    # Errors that are larger for some time are not alike, which correlation explains a little, too.
    where = stretch(fixes.in_time, 0)
    gain -= 0.0 if where is None else where.gain
    correlated = gain > limits.VERDICT.likelihood_ratio and np.sqrt(ratio) > limits.VERDICT.correlated_part
    at = best if correlated else _WHITE
    found = apart + judge_causes(Fit(fits.matrix[at], fits.vector[at], np.array(3.0 * fixes.count)), assumed)
    scales = fits.scales[at].copy()
    if correlated:
        sigma = float(np.sqrt(scales[0] * ratio * fixes.variance[:3].mean() / fixes.count))
        found.append(Weighed(gain, correlation(sigma, time, gain)))
        # If R already includes the correlated part, it is not too large.
        total = scales[0] * (1 + ratio)
        scales[0] = scales[0] if scales[0] > 1 else min(total, 1.0)
    for kind, (scale, size) in enumerate(zip(scales, sizes, strict=True)):
        found += _size(fixes, kind, float(scale), float(size), plain=kind == 1 or not correlated)
    return found


def _size(fixes: FixErrors, kind: int, scale: float, size: float, plain: bool) -> list[Weighed]:
    """Judge R of the position (0) or the velocity (1): in a stretch, in a channel, or as a whole.

    `scale` is the remaining variance relative to R, and `size` the rms of the innovations in their σ. `plain`
    is true if these errors are white; stretches and channels are searched only then.
    """
    name = ("position", "velocity")[kind]
    count = np.array(3.0 * fixes.count)
    own = slice(3 * kind, 3 * kind + 3)
    squares, capped = (
        Squares(fixes.channels.total[row, own], fixes.channels.number[row, own]) for row in (0, 1)
    )
    where = stretch(fixes.in_time, kind) if plain else None
    if where is not None:
        begin, end = stretch_times(where, fixes.span)
        return judge_size(
            where.squares,
            FINDINGS["R in a stretch"],
            f"{name} errors of the fixes from {begin:.0f} s to {end:.0f} s",
            kind=name,
            begin=begin,
            end=end,
        )
    axis = channel(squares) if plain else None
    if axis is not None and axis == channel(capped):
        one = Squares(squares.total[axis], squares.number[axis])
        return judge_size(
            one,
            FINDINGS["R of a channel"],
            f"{name} errors {AXES[axis]} of the fixes",
            rows=(3 * kind + axis, 3 * kind + axis + 1),
            kind=name,
            axis=AXES[axis],
        )
    return judge_size(
        Squares(np.array(scale) * count, count),
        FINDINGS["R of a kind"],
        f"{name} errors of the fixes",
        rows=(3 * kind, 3 * kind + 3),
        kind=name,
        size=size,
    )


_WHITE = (0, 0)
"""Place of white errors in `TIMES` and `RATIOS`."""


class _FixFits(NamedTuple):
    """Latency and lever arm fitted to the errors of the fixes, and the sizes of the remaining errors.

    There is one fit for each correlation of the position errors, at `TIMES` and `RATIOS` (t, r). `matrix` and
    `vector` are the normal equations with unit variance, `scales` (t, r, 2) the remaining variances of
    position and velocity relative to R.
    """

    matrix: FloatArray
    vector: FloatArray
    scales: FloatArray
    likelihood: FloatArray


def _fits(fixes: FixErrors) -> _FixFits:
    """Fit latency and lever arm by least squares, weighted by the sizes of the remaining errors."""
    parts = (fixes.position, fixes.velocity)
    count = 3.0 * fixes.count
    scales = np.ones((*fixes.log_determinant.shape, 2))
    for _ in range(3):
        matrix = parts[0].matrix / scales[..., 0, None, None] + parts[1].matrix / scales[..., 1, None, None]
        vector = parts[0].vector / scales[..., 0, None] + parts[1].vector / scales[..., 1, None]
        x = pseudoinverse(matrix) @ vector[..., None]
        if fixes.count < limits.VERDICT.cause_fixes:
            x = np.zeros_like(x)
        rest = [
            part.squares + ((x.mT @ part.matrix - 2 * part.vector[..., None, :]) @ x)[..., 0, 0]
            for part in parts
        ]
        scales = np.maximum(np.stack(rest, axis=-1) / count, 1e-12)
    likelihood = -0.5 * (count * np.log(scales).sum(axis=-1) + fixes.log_determinant)
    return _FixFits(matrix, vector, scales, likelihood)


_CAUSES = {"latency": (0,), "lever arm": (1, 2, 3)}
"""Regressors of each cause."""


def judge_causes(fit: Fit, assumed: FloatArray) -> list[Weighed]:
    """Judge latency and lever arm by their normal equations with unit variance.

    `assumed` are the values (4,) that the filter assumed.
    """
    found = []
    records = Fit(fit.matrix[None], fit.vector[None], fit.squares)
    chosen = select_causes(records, _CAUSES, limits.VERDICT.cause_ratio)
    if len(chosen) == 1:
        alike = rivals(records, _CAUSES, chosen[0], limits.VERDICT.cause_ratio)
        sizes = {chosen[0].name: chosen[0].estimate} | alike
        late, arm = (sizes[name][0] if name in sizes else np.zeros(1) for name in _CAUSES)
        if abs(late[0]) > limits.VERDICT.latency and np.linalg.norm(arm) > limits.VERDICT.lever_arm:
            gain = chosen[0].gain
            return [Weighed(gain, lever_arm_or_latency(arm, float(late[0]), gain, assumed))]
    for entry in chosen:
        estimate = entry.estimate[0]
        if entry.name == "latency" and abs(estimate[0]) > limits.VERDICT.latency:
            found.append(Weighed(entry.gain, latency(float(estimate[0]), entry.gain, assumed)))
        elif entry.name == "lever arm" and np.linalg.norm(estimate) > limits.VERDICT.lever_arm:
            found.append(Weighed(entry.gain, lever_arm(estimate, entry.gain, assumed)))
    return found


def latency(size: float, gain: float, assumed: FloatArray) -> Finding:
    """Return the finding of a latency [s] beyond the one the filter assumed, `assumed` (4,)."""
    statistic = f"latency {size:.3f} s, logarithm of the likelihood ratio {gain:.0f}"
    return FINDINGS["GPS latency"].finding(abs(size), statistic, **_late_fields(size, assumed))


def lever_arm(arm: FloatArray, gain: float, assumed: FloatArray) -> Finding:
    """Return the finding of a lever arm error (3,) [m] beyond the arm the filter assumed, `assumed` (4,)."""
    fields = _lever_arm_fields(arm, assumed)
    statistic = f"lever arm {fields['place']}, logarithm of the likelihood ratio {gain:.0f}"
    return FINDINGS["GPS lever arm"].finding(float(np.linalg.norm(arm)), statistic, **fields)


def lever_arm_or_latency(arm: FloatArray, late: float, gain: float, assumed: FloatArray) -> Finding:
    """Return the finding of a lever arm (3,) [m] or a latency [s], between which the flight does not decide.

    Each is what it would be alone; `assumed` is as of `latency`.
    """
    fields = _lever_arm_fields(arm, assumed) | _late_fields(late, assumed)
    statistic = (
        f"lever arm {fields['place']}, or latency {late:.3f} s, logarithm of the likelihood ratio {gain:.0f}"
    )
    row = FINDINGS["GPS lever arm or latency"]
    return row.finding(float(np.linalg.norm(arm)), statistic, **fields)


def _late_fields(size: float, assumed: FloatArray) -> dict[str, Any]:
    side = "late" if size > 0 else "early"
    return {"seconds": abs(size), "side": side, "latency": float(round(assumed[0] + size, 2))}


def _lever_arm_fields(arm: FloatArray, assumed: FloatArray) -> dict[str, Any]:
    return {
        "length": float(np.linalg.norm(arm)),
        "place": f"{arm[0]:.1f} m forward, {arm[1]:.1f} m right, {arm[2]:.1f} m down",
        "arm": [float(round(metres, 2)) for metres in assumed[1:] + arm],
    }


def judge_outliers(number: int, fixes: int, wording: Wording) -> list[Weighed]:
    """Judge used fixes that differ from their neighbours; `wording` is that of errors, or of innovations."""
    if not number:
        return []
    chance = limits.VERDICT.outlier_chance
    finding = wording.finding(
        number / fixes,
        f"{number} of {fixes} beyond the value that one Gaussian fix in {0.5 / chance:.0e} reaches",
        number=number,
        fixes=fixes,
    )
    return [Weighed(-number * float(np.log(chance)), finding)]


def correlation(sigma: float, time: float, gain: float) -> Finding:
    """Return the finding of correlated position errors with a σ [m] and a correlation time [s]."""
    return FINDINGS["GPS correlation"].finding(
        sigma, f"logarithm of the likelihood ratio {gain:.0f}", sigma=sigma, time=time
    )
