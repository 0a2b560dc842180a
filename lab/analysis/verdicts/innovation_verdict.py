"""Innovation verdict: the findings from the innovations alone, as for a flight with unknown truth.

Each possible error is an explanation of the same innovations, and all are compared by the likelihood of the
innovations: wrong variances by `hypotheses`, errors of fixes and of inertial sensors by the filter's response
to them. If GPS and IMU explain them about equally well, the verdict names both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lab.analysis.fix_causes import CAUSES
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.finding import (
    Advice,
    Finding,
    Weighed,
    interval_words,
    is_right,
    judge_size,
    mean_square,
    wrong_direction,
    wrong_factor_interval,
)
from lab.analysis.verdicts.finding_table import (
    CORRELATION,
    EITHER,
    EXPLANATIONS,
    FINDINGS,
    VARIANCE,
)
from lab.analysis.verdicts.fix_verdict import judge_outliers, latency, lever_arm, lever_arm_or_latency
from lab.analysis.verdicts.hypotheses import HYPOTHESES, R_CHANNELS
from lab.analysis.verdicts.imu_causes import columns
from lab.analysis.verdicts.innovation_evidence import LAGS, Innovations, is_suspicious
from lab.analysis.verdicts.likely_factor import likely_factor
from lab.analysis.verdicts.pattern import AXES, channel, stretch, stretch_times
from lab.analysis.verdicts.selection import estimates, likelihood_gain
from lab.analysis.verdicts.sums import Fit, Squares
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number, round_digits

GPS, IMU, START = "GPS", "IMU", "P0"
FACTORS = np.array([hypothesis.factor for hypothesis in HYPOTHESES])
"""The factor of each hypothesis."""
DECAY = 1e-9, 0.98
"""Smallest and largest decay over the lags: innovations that hardly decay say no more than 400 fixes."""


class Explanation(NamedTuple):
    """A possible error, and its gain in log-likelihood.

    Attributes
    ----------
    size : float
        Factor on a variance, or norm of `parts`.
    parts : array
        The sizes of an error; empty for a variance.
    interval : (float, float)
        95 % interval of the factor on a variance.
    """

    name: str
    source: str
    gain: float
    size: float
    parts: FloatArray = np.zeros(0)
    interval: tuple[float, float] = (0.0, np.inf)

    @property
    def matters(self) -> bool:
        """Whether it is large enough to be reported."""
        return (
            bool(self.parts.size)
            or self.name == CORRELATION
            or not 1 / limits.VERDICT.wrong_factor < self.size < limits.VERDICT.wrong_factor
        )


def judge_innovations(evidence: Evidence) -> list[Weighed]:
    """Return the findings from the innovations: for all, a stretch, a channel, or single fixes."""
    seen = evidence.innovations
    found = explanations(seen)
    number = int(seen.squares.number.max())
    apart = judge_outliers(seen.outliers, number, FINDINGS["outliers, by innovations"])
    rest = float(seen.nis.total), float(seen.nis.number)
    # Outliers are reported only if the rest is right.
    if apart and is_right(*rest) and (not found or found[0].gain < apart[0].weight):
        return apart
    if found and found[0].gain > limits.VERDICT.likelihood_ratio and found[0].matters:
        assumed = evidence.assumed.values.mean(axis=0)
        whose = GPS if found[0].source == GPS and _rival(found) is None else EITHER
        return _local(seen, found[0].gain, whose) or [_state_explanation(found, seen, assumed)]
    # Without a comparison of explanations, as with further states, nothing speaks for the fixes.
    whose = GPS if seen.likelihoods.any() else EITHER
    return (_local(seen, 0.0, whose) or _sizes(seen)) if is_suspicious(seen) else []


def explanations(seen: Innovations) -> list[Explanation]:
    """Return the explanations of the innovations, the best first, minus the price of their parameters."""
    found = []
    for name in dict.fromkeys(hypothesis.name for hypothesis in HYPOTHESES[1:]):
        own = [at for at, hypothesis in enumerate(HYPOTHESES) if hypothesis.name == name]
        if name in R_CHANNELS and not seen.offered.number[list(R_CHANNELS[name])].any():
            continue  # the receiver of a log may not measure all channels
        source = GPS if name.startswith(("R", "GPS")) else START if name.startswith("P0") else IMU
        if name == CORRELATION:
            at = max(own, key=lambda at: seen.likelihoods[at])
            one = Explanation(name, source, float(seen.likelihoods[at]), HYPOTHESES[at].factor)
        else:
            likely = likely_factor(FACTORS[[0, *own]], seen.likelihoods[[0, *own]])
            interval = likely.low, likely.high
            one = Explanation(name, source, likely.gain, likely.factor, interval=interval)
        found.append(one._replace(gain=one.gain - limits.VERDICT.price))
    records = Fit(seen.causes.matrix[None], seen.causes.vector[None], seen.causes.squares)
    causes = {"GPS latency": [0], "GPS lever arm": [1, 2, 3]}
    causes |= {name: [CAUSES + at for at in own] for name, own in columns().items()}
    for name, own in causes.items():
        if not records.matrix[:, own, own].any():
            continue
        parts = estimates(records, own)[0]
        source = GPS if name.startswith("GPS") else IMU
        if not _cause_matters(name, parts):
            continue
        price = limits.VERDICT.price * len(own)
        size = float(np.linalg.norm(parts))
        found.append(Explanation(name, source, likelihood_gain(records, own) - price, size, parts))
    return _order_explanations(sorted(found, key=lambda one: -one.gain))


def _order_explanations(found: list[Explanation]) -> list[Explanation]:
    """Return explanations with a plain R too large before correlated fixes that explain hardly more.

    An R too large by more than `LARGE` is not plain: few fixes whose errors are correlated look like it.
    """
    best = found[0]
    plain = [
        one for one in found if one.name.startswith("R") and 1 / limits.VERDICT.large_factor < one.size < 1
    ]
    if best.name != CORRELATION or not plain or plain[0].gain < (1 - limits.VERDICT.alike_part) * best.gain:
        return found
    return [plain[0], *(one for one in found if one is not plain[0])]


def _cause_matters(name: str, parts: FloatArray) -> bool:
    least = {"GPS latency": limits.VERDICT.latency, "GPS lever arm": limits.VERDICT.lever_arm}.get(name, 0.0)
    most = limits.VERDICT.first_order if name.endswith(("misalignment", "scale factor")) else np.inf
    return bool(least < np.linalg.norm(parts) < most)


def _local(seen: Innovations, gain: float, whose: str) -> list[Weighed]:
    """Judge a stretch or a channel that is too large while the rest is right, if that explains as much.

    `whose` is ``"GPS"`` if the fixes are a more likely cause than the inertial sensors.
    """
    found = []
    for kind, name in enumerate(("position", "velocity")):
        where = stretch(seen.in_time, kind)
        if where is not None:
            begin, end = stretch_times(where, seen.span)
            found += judge_size(
                where.squares,
                FINDINGS["R in a stretch, by innovations" if whose == GPS else "GPS or IMU in a stretch"],
                f"{name} innovations from {begin:.0f} s to {end:.0f} s",
                kind=name,
                begin=begin,
                end=end,
            )
    if found and sum(entry.weight for entry in found) > (1 - limits.VERDICT.alike_part) * gain:
        return found
    if seen.likelihoods.any():  # then R of each channel is an explanation of its own
        return []
    for kind, name in enumerate(("position", "velocity")):
        own = slice(3 * kind, 3 * kind + 3)
        axis = channel(Squares(seen.offered.total[own], seen.offered.number[own]))
        other = slice(3 - 3 * kind, 6 - 3 * kind)
        others = float(seen.offered.total[other].sum()), float(seen.offered.number[other].sum())
        if axis is not None and (not others[1] or is_right(*others)):
            found = judge_size(
                Squares(seen.offered.total[own][axis], seen.offered.number[own][axis]),
                FINDINGS["R of a channel, by innovations" if whose == GPS else "GPS or IMU in a channel"],
                f"{name} innovations {AXES[axis]}",
                rows=(3 * kind + axis, 3 * kind + axis + 1),
                kind=name,
                axis=AXES[axis],
            )
            if found and found[0].weight > (1 - limits.VERDICT.alike_part) * gain:
                return found
    return []


def _state_explanation(found: list[Explanation], seen: Innovations, assumed: FloatArray) -> Weighed:
    """Return the finding of the best explanation, or of GPS or IMU if both explain nearly as much."""
    best = found[0]
    rival = _rival(found)
    statistic = f"logarithm of the likelihood ratio {best.gain:.0f}"
    if rival is not None:
        wording = FINDINGS["GPS or IMU"]
        if not best.parts.size and best.source != GPS:
            wording = wording.with_advice(*_gain_advice(best), ADVICE["compare"])
        finding = wording.finding(
            float("nan"),
            f"{statistic}, {rival.gain:.0f} of the other",
            None,
            _ROWS.get(best.name),
            explanation=_describe(best),
            rival=_describe(rival),
            **_gain_fields(best),
        )
        return Weighed(best.gain, finding)
    return Weighed(best.gain, make_finding(found, seen, statistic, assumed))


def _rival(found: list[Explanation]) -> Explanation | None:
    """Return the best explanation by the other instrument if it explains nearly as much as the best."""
    best = found[0]
    rivals = [one for one in found[1:] if one.source != best.source and GPS in (one.source, best.source)]
    rival = max(rivals, key=lambda one: one.gain, default=None)
    if rival is None or rival.gain <= best.gain - max(
        limits.VERDICT.likelihood_ratio, limits.VERDICT.alike_part * best.gain
    ):
        return None
    return rival


def _describe(one: Explanation) -> str:
    """Return an explanation as text."""
    if one.name in EXPLANATIONS:
        sizes = (one.size, 100 * one.size, float(np.degrees(one.size)))
        size, percent, degrees = map(format_number, sizes)
        return EXPLANATIONS[one.name].format(size=size, percent=percent, degrees=degrees)
    factor = format_number(max(one.size, 1 / one.size))
    return VARIANCE.format(variance=one.name, factor=factor, direction=wrong_direction(one.size))


_PLACE_AND_TIME = ("GPS lever arm", "GPS latency")
"""Explanations that a flight tells apart by its turns and by changes of its speed."""


def make_finding(found: list[Explanation], seen: Innovations, statistic: str, assumed: FloatArray) -> Finding:
    """Return the finding of the first of some explanations.

    `statistic` is its evidence, `assumed` are the latency and the lever arm (4,) that the filter assumed.
    """
    best = found[0]
    if best.name in _PLACE_AND_TIME:
        return _of_place_or_time(found, assumed)
    if best.name == CORRELATION:
        size = np.sqrt(seen.offered.mean[:3].mean())
        wording = FINDINGS["hidden GPS correlation" if size < 1 else "GPS correlation, by innovations"]
        if _filters_fixes(seen):
            wording = wording.with_advice(ADVICE["use fewer fixes"])
        return wording.finding(float("nan"), statistic, size=float(size), number=_lasting_fixes(seen))
    if best.parts.size:
        return _of_motion(found, statistic)
    if best.name.startswith("R"):
        return _size_of_r(best, seen)
    interval = wrong_factor_interval(best.size, *best.interval)
    wording = FINDINGS["low gain" if best.size > 1 else "high gain"].with_advice(*_gain_advice(best))
    return wording.finding(
        max(best.size, 1 / best.size),
        f"{statistic}{interval_words(interval)}",
        interval,
        _ROWS.get(best.name),
        direction=wrong_direction(best.size),
        explanation=_describe(best),
        **_gain_fields(best),
    )


def _of_place_or_time(found: list[Explanation], assumed: FloatArray) -> Finding:
    """Return the finding of a lever arm or a latency, or of both where the second explains as much."""
    best = found[0]
    least = max(best.gain - limits.VERDICT.likelihood_ratio, limits.VERDICT.likelihood_ratio)
    parts = {one.name: one.parts for one in found if one.name in _PLACE_AND_TIME and one.gain >= least}
    if len(parts) == len(_PLACE_AND_TIME):
        arm, late = (parts[name] for name in _PLACE_AND_TIME)
        return lever_arm_or_latency(arm, float(late[0]), best.gain, assumed)
    if best.name == "GPS latency":
        return latency(float(best.parts[0]), best.gain, assumed)
    return lever_arm(best.parts, best.gain, assumed)


def _filters_fixes(seen: Innovations) -> bool:
    """Return whether correlated fixes are those of a receiver that filters them: hardly any error is white.

    Otherwise, the correlated error is a slow one beside the white errors that the filter assumes.
    """
    own = [at for at, hypothesis in enumerate(HYPOTHESES) if hypothesis.name == CORRELATION]
    return HYPOTHESES[max(own, key=lambda at: seen.likelihoods[at])].r[0] < 1


def _lasting_fixes(seen: Innovations) -> int:
    """Return for how many fixes an error of the position lasts, by the decay of its innovations.

    After that many fixes, two correlation times, e⁻² of the correlation is left. Nine flights with errors of
    1 m over 10 s to 200 s, at 5 Hz, give 25 to 45; NEES falls from 4 to 16 times its degrees of freedom to
    0.8 to 2.1 with so many fixes, and to 0.9 to 1.9 with so large an R.
    """
    lagged = seen.follows[:, :3].sum(axis=1)
    decay = lagged[-1] / lagged[0] if lagged[0] > 0 else 0.0
    per_fix = np.clip(decay, *DECAY) ** (1 / (LAGS - 1))
    return max(2, int(round_digits(np.ceil(-2 / np.log(per_fix)))))


def _of_motion(found: list[Explanation], statistic: str) -> Finding:
    """Return the finding of an error of inertial sensors, with the second explanation if it is as likely."""
    best, rival = found[0], found[1] if len(found) > 1 else None
    alone = rival is None or rival.gain <= best.gain - limits.VERDICT.likelihood_ratio
    wording = FINDINGS["error in motion" if alone else "ambiguous error in motion"]
    if "scale" in best.name:
        # Without their σ, P0 of the scale factors is zero, and the filter never estimates them.
        wording = wording.with_advice(ADVICE["estimate scale factors"])
    return wording.finding(
        best.size,
        statistic,
        cause=best.name,
        sensor=best.name.split()[0],
        explanation=_describe(best),
        rival="" if rival is None else _describe(rival),
        percent=round_digits(100 * best.size / float(np.sqrt(best.parts.size))),
    )


_ROWS = {  # first and one past the last index of the affected values of the belief
    "P0 position": (0, 3),
    "P0 velocity": (3, 6),
    "Q gyro": (0, 3),
    "Q accelerometer": (3, 6),
    "Q gyro bias": (6, 9),
    "Q accelerometer bias": (9, 12),
    "P0 attitude": (6, 9),
    "P0 gyro bias": (9, 12),
    "P0 accelerometer bias": (12, 15),
}


def _gain_advice(best: Explanation) -> list[Advice]:
    advice = [ADVICE["scale variances" if best.name in _ROWS else "scale a matrix"]]
    is_far_off = best.name.startswith("Q") and best.size > limits.VERDICT.far_off_factor
    return [*advice, ADVICE["identify"]] if is_far_off else advice


def _gain_fields(best: Explanation) -> dict[str, Any]:
    matrix, _, block = best.name.partition(" ")
    return {"matrix": matrix.lower(), "block": block, "multiply": best.size}


def _size_of_r(best: Explanation, seen: Innovations) -> Finding:
    """Return the finding that R is wrong, from the size of its innovations."""
    ratio, factor = best.size, max(best.size, 1 / best.size)
    channels, interval = list(R_CHANNELS[best.name]), wrong_factor_interval(ratio, *best.interval)
    if best.name == "R":
        # One of both alone would leave the fixes of the other with the wrong weight.
        row, kind, what, squares = "R", "", "innovations", seen.nis
    else:
        row, kind = "R of a kind" if len(channels) > 1 else "R of one channel", best.name.removeprefix("R ")
        squares = Squares(seen.offered.total[channels].sum(), seen.offered.number[channels].sum())
        what = f"{kind} innovations"
    return FINDINGS[row].finding(
        factor,
        mean_square(squares, what) + interval_words(interval),
        interval,
        None if row == "R" else (channels[0], channels[-1] + 1),
        kind=kind,
        size=float(squares.mean) ** 0.5,
        factor=factor,
        multiply=ratio,
        direction=wrong_direction(ratio),
    )


def _sizes(seen: Innovations) -> list[Weighed]:
    """Judge the size of the innovations if none of the tested causes explains it."""
    total, count = float(seen.nis.total), float(seen.nis.number)
    if not count or is_right(total, count):
        return []
    ratio = max(total / count, 1 / limits.VERDICT.wrong_factor**20)
    wording = FINDINGS["NIS" if seen.likelihoods.any() else "NIS, causes not compared"]
    if ratio < 1:
        wording = wording.with_advice(ADVICE["lower R"])
    return judge_size(seen.nis, wording, "innovations (by NIS)", size=ratio**0.5, scale=ratio)
