"""Verdict: in plain words, whether a filter tells the truth about itself, and if not, what is wrong.

Each statement rests on one statistic with a known distribution, and is made only if that is both beyond
doubt and large enough to matter:

- *Beyond doubt.* A χ² statistic outside its two-sided 99.8 % interval (`DOUBT`), a t-value beyond 4
  (`T_VALUE`, 1 in 16,000), three components of a lever arm together beyond χ² = 21 (`LEVER`, 1 in 10,000), a
  likelihood ratio beyond e¹⁰ (`RATIO`, since 60 pairs of time and size are tried), a fix that stands out
  from those around it as one in 5 million does (`outliers`). Together they raise less
  than one false alarm in 100 runs, most of them of P0, of which a run has but one sample.
- *Large enough.* A variance that is wrong by less than half (`MATTERS`) costs a filter next to nothing: its
  gain depends on the root of it. Nor does a latency below 10 ms, or a lever arm below 20 cm.

With the truth, every assumption has a sample of its own (`evidence`), so one wrong assumption does not
accuse another. Innovations alone cannot tell everything apart: gain too low has one face whether Q or P0 is
too small, and a P0 or Q that is too large hardly shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import chi_square_interval
from lab.analysis.evidence import RATIOS, TIMES, Evidence, Fit, FixErrors, Squares
from lab.analysis.fix_causes import CAUSES
from lab.analysis.outliers import CHANCE

FloatArray = NDArray[np.float64]

DOUBT = 0.002
"""Probability that a χ² statistic of a matched filter lies outside its interval."""
MATTERS = 1.5
"""Factor from which on a wrong variance is worth a statement."""
T_VALUE, LATENCY = 4.0, 0.01
"""From which t-value and from which size [s] on a latency is stated."""
LEVER, LEVER_ARM = 21.1, 0.2
"""From which χ² of three components and from which length [m] on a lever arm is stated."""
RATIO, CORRELATED = 10.0, 0.3
"""From which logarithm of the likelihood ratio, and from which part of the white σ on, correlation is."""
MANY_SIGMA = 4.0
"""Standard deviations from which on a correlation of the innovations is stated."""
COLOURED = 3.0
"""How many times more the position innovations have grown than those of the velocity if fixes correlate."""
NOTHING = "nothing"
"""Basis of a verdict that says only that there is none."""
FEWEST = 10
"""Fixes from which on latency and lever arm are looked for."""
EXPLAINED = 0.2
"""Part of the innovations' excess that latency and lever arm explain where they are to blame."""
ADVICE_CORRELATION = (
    "Raise R position to the variance of the correlated error times its correlation time over the period of "
    "the fixes, or use fewer fixes."
)


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes
    ----------
    quantity
        What: ``"R position"``, ``"R velocity"``, ``"Q"``, ``"Q gyro"``, ``"Q accelerometer"``, ``"P0"``,
        ``"GPS correlation"``, ``"GPS latency"``, ``"GPS lever arm"``, ``"GPS outliers"``; and
        ``"gain"``, ``"NEES"`` or ``"NIS"`` where nothing more can be said. `algorithm_verdict` has its own.
    direction
        ``"too small"``, ``"too large"`` or ``"not modelled"``.
    factor
        How many times too small or too large a variance is; of what is not modelled its size: latency [s],
        length of the lever arm [m], σ of the correlated error [m] (NaN where it cannot be known), the part of
        the fixes that are outliers.
    sentence, advice
        What is wrong and what to try, for a person.
    evidence
        The statistic it rests on.
    """

    quantity: str
    direction: str
    factor: float
    sentence: str
    advice: str
    evidence: str


@dataclass(frozen=True)
class Verdict:
    """What there is to say about a filter.

    Attributes
    ----------
    headline
        One sentence.
    findings
        What is wrong, the weightiest first; empty for a filter that is consistent.
    basis
        What it was judged by.
    """

    headline: str
    findings: tuple[Finding, ...]
    basis: str

    @property
    def consistent(self) -> bool | None:
        """Whether nothing is wrong; None if there was nothing to judge by."""
        return None if self.basis == NOTHING else not self.findings

    def __str__(self) -> str:
        return self.headline


class Weighed(NamedTuple):
    """A finding, and by how much its explanation raises the logarithm of the likelihood."""

    weight: float
    finding: Finding


def judge(evidence: Evidence) -> Verdict:
    """Return the verdict on one run, or on many whose evidence was added."""
    if not evidence.innovations.squares.number.any() and evidence.fixes is None:
        return Verdict("No verdict: no fix was used.", (), NOTHING)
    with_truth = evidence.fixes is not None
    weighed = _by_truth(evidence) if with_truth else _by_innovations(evidence)
    findings = tuple(entry.finding for entry in sorted(weighed, key=lambda entry: -entry.weight))
    runs = f"{evidence.runs} run{'s' if evidence.runs > 1 else ''}"
    basis = f"{runs}, {'errors and innovations' if with_truth else 'innovations only'}"
    return Verdict(_headline(findings, with_truth), findings, basis)


def _headline(findings: tuple[Finding, ...], with_truth: bool) -> str:
    if not findings:
        what = "errors and innovations are" if with_truth else "the innovations are white and"
        return f"Consistent: {what} as large as the filter says."
    more = len(findings) - 1
    return findings[0].sentence + (f" ({more} more)" if more else "")


def _by_truth(evidence: Evidence) -> list[Weighed]:
    assert evidence.fixes is not None
    found = _fixes(evidence.fixes, evidence)
    if evidence.noise is not None:
        found += _noise(evidence.noise)
    if evidence.start is not None:
        found += judge_size(
            evidence.start,
            "P0",
            "The error at the start is {root} × its assumed σ: P₀ about {factor} × too {wrong}.",
            "Multiply navigator.p0_scale by {multiply}, or set the initial σ that apply.",
            "start",
        )
    return found or _unexplained(evidence)


# The errors of the fixes


def _fixes(fixes: FixErrors, evidence: Evidence) -> list[Weighed]:
    """Judge R, the correlation of the fixes, latency and lever arm by the errors of the fixes."""
    if not fixes.count:
        return []
    apart = _outliers(fixes.outliers, fixes.count + fixes.outliers, "position or velocity errors")
    white = _fit(fixes, (0, 0))
    best = max(
        (_fit(fixes, at) for at in np.ndindex(len(TIMES), len(RATIOS))), key=lambda fit: fit.likelihood
    )
    time, ratio = TIMES[best.at[0]], RATIOS[best.at[1]]
    gain = best.likelihood - white.likelihood
    correlated = gain > RATIO and np.sqrt(ratio) > CORRELATED
    fit = best if correlated else white
    found = apart + _causes(fit.estimate, fit.covariance)
    sizes = np.sqrt(evidence.innovations.squares.mean.reshape(2, 3).mean(axis=1))
    scales = np.array([fit.position, fit.velocity])
    if correlated:
        sigma = float(np.sqrt(scales[0] * ratio * fixes.variance[:3].mean() / fixes.count))
        found.append(Weighed(gain, _correlation(sigma, time, gain)))
        # Who gave the filter white and correlated variance together did not make R too large.
        total = scales[0] * (1 + ratio)
        scales[0] = scales[0] if scales[0] > 1 else min(total, 1.0)
    for scale, size, kind in zip(scales, sizes, ("position", "velocity"), strict=True):
        count = np.array(3.0 * fixes.count)
        found += judge_size(
            Squares(scale * count, count),
            f"R {kind}",
            f"{kind.capitalize()} innovations {size:.2g} × as large as assumed: R {kind} about {{factor}} × "
            "too {wrong}.",
            f"Multiply the {kind} variances of navigator.r by {{multiply}}.",
            f"{kind} errors of the fixes",
        )
    return found


class _FixFit(NamedTuple):
    """Latency and lever arm fitted to the errors of the fixes, and the size of what remains.

    `position` and `velocity` are the variances that remain, in those of R; `at` is which correlation.
    """

    at: tuple[int, ...]
    estimate: FloatArray
    covariance: FloatArray
    position: float
    velocity: float
    likelihood: float


def _fit(fixes: FixErrors, at: tuple[int, ...]) -> _FixFit:
    """Fit latency and lever arm by weighted least squares, the weights being the sizes of what remains."""
    parts = (Fit(*(figure[at] for figure in fixes.position)), fixes.velocity)
    count = 3.0 * fixes.count
    scales = np.ones(2)
    for _ in range(3):
        matrix = sum(part.matrix / scale for part, scale in zip(parts, scales, strict=True))
        vector = sum(part.vector / scale for part, scale in zip(parts, scales, strict=True))
        covariance = np.asarray(np.linalg.pinv(matrix, hermitian=True), dtype=np.float64)
        x = covariance @ vector if fixes.count >= FEWEST else np.zeros(CAUSES)
        rest = [part.squares - 2 * part.vector @ x + x @ part.matrix @ x for part in parts]
        scales = np.maximum(np.array(rest) / count, 1e-12)
    likelihood = -0.5 * (count * np.log(scales).sum() + fixes.log_determinant[at])
    return _FixFit(at, x, covariance, float(scales[0]), float(scales[1]), float(likelihood))


def _causes(estimate: FloatArray, covariance: FloatArray) -> list[Weighed]:
    """Judge latency and lever arm by their estimates."""
    found = []
    t = float(estimate[0] / np.sqrt(max(covariance[0, 0], 1e-30)))
    if abs(t) > T_VALUE and abs(estimate[0]) > LATENCY:
        late = "late" if estimate[0] > 0 else "early"
        finding = Finding(
            "GPS latency",
            "not modelled",
            float(abs(estimate[0])),
            f"The fixes are {abs(estimate[0]):.2f} s {late}: their errors go with the velocity.",
            f"Move the times of the fixes by {-estimate[0]:+.2f} s.",
            f"latency {estimate[0]:.3f} s, t = {t:.1f}",
        )
        found.append(Weighed(t**2 / 2, finding))
    arm = estimate[1:]
    square = float(arm @ np.linalg.pinv(covariance[1:, 1:], hermitian=True) @ arm)
    length = float(np.linalg.norm(arm))
    if square > LEVER and length > LEVER_ARM:
        where = f"{arm[0]:.1f} m forward, {arm[1]:.1f} m right, {arm[2]:.1f} m down"
        finding = Finding(
            "GPS lever arm",
            "not modelled",
            length,
            f"The antenna is {length:.1f} m off ({where}): the errors of the fixes turn with the vehicle.",
            "Take the lever arm off the fixes: position − C_nb l, velocity − C_nb (ω × l).",
            f"lever arm {where}, χ² = {square:.0f} with 3 degrees of freedom",
        )
        found.append(Weighed(square / 2, finding))
    return found


def _outliers(number: int, fixes: int, what: str) -> list[Weighed]:
    """Judge fixes that stand out from those around them."""
    if not number:
        return []
    finding = Finding(
        "GPS outliers",
        "not modelled",
        number / fixes,
        f"{number} of {fixes} fixes have {what} no Gaussian would give: outliers, such as from multipath.",
        "Set navigator.gate to 0.999: the filter then refuses fixes that are implausible.",
        f"{number} of {fixes} beyond what one Gaussian fix in {0.5 / CHANCE:.0e} reaches",
    )
    return [Weighed(-number * float(np.log(CHANCE)), finding)]


def _correlation(sigma: float, time: float, gain: float) -> Finding:
    return Finding(
        "GPS correlation",
        "not modelled",
        sigma,
        f"The position errors of the fixes are correlated, about {sigma:.2g} m over {time:.0f} s; the filter "
        "takes them for white.",
        ADVICE_CORRELATION,
        f"logarithm of the likelihood ratio {gain:.0f}",
    )


# Sizes


def judge_size(squares: Squares, quantity: str, sentence: str, advice: str, of_what: str) -> list[Weighed]:
    """Judge a variance by the mean square of what it should be the variance of."""
    total, count = float(squares.total), float(squares.number)
    if not count or _is_right(total, count):
        return []
    ratio = max(total / count, 1e-12)
    factor, wrong = (ratio, "small") if ratio > 1 else (1 / ratio, "large")
    words = {
        "root": f"{np.sqrt(ratio):.2g}",
        "factor": f"{factor:.2g}",
        "multiply": f"{ratio:.2g}",
        "wrong": wrong,
    }
    finding = Finding(
        quantity,
        f"too {wrong}",
        factor,
        sentence.format(**words),
        advice.format(**words),
        _evidence(squares, of_what),
    )
    return [Weighed(count / 2 * (ratio - 1 - np.log(ratio)), finding)]


def _evidence(squares: Squares, of_what: str) -> str:
    total, count = float(squares.total), float(squares.number)
    low, high = (limit / count for limit in chi_square_interval(count, 1, 1 - DOUBT))
    return f"mean square of the {of_what} {total / count:.3g}, expected {low:.2f} to {high:.2f}"


def _is_right(total: float, count: float) -> bool:
    low, high = chi_square_interval(count, 1, 1 - DOUBT)
    return low <= total <= high or 1 / MATTERS < total / count < MATTERS


def _noise(noise: Squares) -> list[Weighed]:
    """Judge Q by what gyros and accelerometers add to the errors."""
    ratio = noise.mean
    sentence = (
        "Errors grow {root} × as fast as σ says: the {kind} noise, and so Q, is about {factor} × too {wrong}."
    )
    together = bool(noise.number.all()) and 0.5 < ratio[0] / max(ratio[1], 1e-12) < 2
    if together:
        return judge_size(
            Squares(noise.total.sum(), noise.number.sum()),
            "Q",
            "Errors grow {root} × as fast as σ says: Q about {factor} × too {wrong}.",
            "Multiply navigator.q_scale by {multiply}.",
            "noise of the inertial sensors",
        )
    found = []
    for index, kind in enumerate(("gyro", "accelerometer")):
        found += judge_size(
            Squares(noise.total[index], noise.number[index]),
            f"Q {kind}",
            sentence.replace("{kind}", kind),
            f"Multiply the {kind} noise in navigator.q by {{multiply}}; look for errors of the {kind}s that "
            "are no noise, such as scale factors.",
            f"noise of the {kind}s",
        )
    return found


def _unexplained(evidence: Evidence) -> list[Weighed]:
    """Say that the filter is wrong where it is, and none of the causes above explains it."""
    found = []
    for squares, name, what in (
        (evidence.nees, "NEES", "errors of the states"),
        (evidence.nis, "NIS", "innovations"),
    ):
        if squares is None or not squares.number or _is_right(float(squares.total), float(squares.number)):
            continue
        ratio = max(float(squares.mean), 1e-12)
        finding = Finding(
            name,
            "too large" if ratio > 1 else "too small",
            max(ratio, 1 / ratio),
            f"The {what} are {np.sqrt(ratio):.2g} × as large as the filter says, and neither R, Q, P₀ nor "
            "the timing or place of the fixes explains it.",
            "Look for what the filter does not model: scale factors, drifting biases, an error model that "
            "does not fit.",
            _evidence(squares, f"{what} (by {name})"),
        )
        found.append(Weighed(float(squares.number) / 2 * (ratio - 1 - np.log(ratio)), finding))
    return found


# The innovations alone


def _by_innovations(evidence: Evidence) -> list[Weighed]:
    """Judge by sizes, correlation and causes of the innovations.

    A gain too high makes innovations alternate, one too low makes them follow each other: size and sign of
    the correlation together tell R from Q (R. K. Mehra, *On the Identification of Variances and Adaptive
    Kalman Filtering*, IEEE Trans. Automatic Control 15 (1970)).
    """
    seen = evidence.innovations
    if seen.outliers:
        # Through the filter each reaches the innovations after it: what these say else is not to be trusted.
        return _outliers(seen.outliers, int(seen.squares.number[0]), "innovations")
    count = seen.squares.number.reshape(2, 3).sum(axis=1)
    power = seen.squares.total.reshape(2, 3).sum(axis=1)
    size = np.divide(power, count, out=np.ones(2), where=count > 0)
    after = seen.lagged.reshape(-1, 2, 3).sum(axis=2) / np.maximum(power, 1e-12)
    # Of white innovations each correlation has the variance 1 / count, and their sum that of all together.
    follows = after.sum(axis=0) * np.sqrt(count / after.shape[0])
    # What follows each other carries less information than the fit believes.
    inflation = max(1.0, float(size.max())) * (1 + 2 * max(0.0, float(after.sum(axis=0).max())))
    inverse = np.asarray(np.linalg.pinv(seen.fit.matrix, hermitian=True), dtype=np.float64)
    estimate = inverse @ seen.fit.vector
    low_gain = bool((follows > MANY_SIGMA).any())
    weight = float(follows.max()) ** 2 / 2
    excess = float(power.sum() - count.sum())
    if low_gain and _only_position(size) and float(seen.fit.vector @ estimate) < EXPLAINED * excess:
        return [Weighed(weight, _seen_correlation(size[0], after))]
    found = _causes(estimate, inflation * inverse) if count[0] >= 3 * FEWEST else []
    if found:
        return found
    for index, kind in enumerate(("position", "velocity")):
        grown = size[index] > 1
        if grown and (follows[index] > MANY_SIGMA or size[index] < size.max()):
            continue
        found += judge_size(
            Squares(power[index], count[index]),
            f"R {kind}",
            f"{kind.capitalize()} innovations {{root}} × as large as assumed: R {kind} about {{factor}} × "
            "too {wrong}.",
            f"Multiply the {kind} variances of navigator.r by {{multiply}}.",
            f"{kind} innovations",
        )
    if found or not low_gain:
        return found
    return [Weighed(weight, _low_gain(size, after))]


def _only_position(size: FloatArray) -> bool:
    """Say whether the innovations have grown, and those of the position far more than the others."""
    return bool(size[0] > MATTERS and size[0] - 1 > COLOURED * (size[1] - 1))


def _seen_correlation(size: float, after: FloatArray) -> Finding:
    return Finding(
        "GPS correlation",
        "not modelled",
        float("nan"),
        f"Position innovations {np.sqrt(size):.2g} × as large as assumed follow each other: the errors of "
        "the fixes are correlated, and the filter takes them for white.",
        ADVICE_CORRELATION,
        _correlations(after),
    )


def _low_gain(size: FloatArray, after: FloatArray) -> Finding:
    return Finding(
        "gain",
        "too small",
        float(size.max()),
        "The innovations follow each other: the filter corrects too little, Q or P₀ is too small.",
        "Raise navigator.q_scale, or navigator.p0_scale if it is the beginning that is wrong.",
        _correlations(after),
    )


def _correlations(after: FloatArray) -> str:
    return f"correlation from fix to fix {after[0, 0]:.2f} (position), {after[0, 1]:.2f} (velocity)"
