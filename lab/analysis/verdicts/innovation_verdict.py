"""Innovation verdict: the findings from the innovations alone, as for a flight with unknown truth.

Each possible error is an explanation of the same innovations, and all are compared by the likelihood of the
innovations: wrong variances by `hypotheses`, errors of fixes and of inertial sensors by the filter's response
to them. If GPS and IMU explain them about equally well, the verdict names both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.analysis.fix_causes import CAUSES
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.finding import (
    LARGE,
    MATTERS,
    RATIO,
    Change,
    Finding,
    Weighed,
    interval_words,
    is_right,
    judge_size,
    mean_square,
    rounded,
    written,
    wrong_by,
)
from lab.analysis.verdicts.fix_verdict import (
    ADVICE_CORRELATION,
    LATENCY,
    LEVER_ARM,
    judge_outliers,
    latency,
    lever_arm,
)
from lab.analysis.verdicts.hypotheses import HYPOTHESES, R_CHANNELS
from lab.analysis.verdicts.imu_causes import columns
from lab.analysis.verdicts.innovation_evidence import Innovations, suspicious
from lab.analysis.verdicts.likely_factor import likely_factor
from lab.analysis.verdicts.pattern import AXES, channel, stretch, stretch_words
from lab.analysis.verdicts.selection import PRICE, estimates, gain_of
from lab.analysis.verdicts.sums import Fit, Squares
from lab.base.arrays import FloatArray

ALIKE = 0.15
"""Fraction of the gain in log-likelihood by which the best explanation must exceed that by the other
instrument, because the responses are of first order, and variances are tried in steps."""
FAR_OFF = 30.0
"""Factor on Q above which its noise is to be identified: two decades of σ² are no detail of one sensor, and R
and the drives of the biases, which one factor does not change, are then unknown too. A plain choice."""
LINEAR = 0.5
"""Largest misalignment [rad] or scale factor error [1] that is stated: responses are of first order, and at
0.5 rad the second is a tenth of it. Data with two clocks gave 350°."""
_MANOEUVRES = " Errors of the inertial sensors in manoeuvres may be the cause instead."
ADVICE_IDENTIFY = (
    "Identify the noise from the innovations: the button on the page Consistency, ins-lab identify, or "
    "result.identify(); so far off, several assumptions are wrong at once."
)
ADVICE_FILTERING = (
    "Do not lower R. Use fewer fixes, further apart than their errors are correlated: a receiver that "
    "filters its fixes repeats its errors in the next ones."
)
GPS, IMU, START, EITHER = "GPS", "IMU", "P0", "GPS or IMU"
CORRELATION = "GPS correlation"
FACTORS = np.array([hypothesis.factor for hypothesis in HYPOTHESES])
"""The factor of each hypothesis."""


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
        return bool(self.parts.size) or self.name == CORRELATION or not 1 / MATTERS < self.size < MATTERS


def judge_innovations(evidence: Evidence) -> list[Weighed]:
    """Return the findings from the innovations: for all, a stretch, a channel, or single fixes."""
    seen = evidence.innovations
    found = explanations(seen)
    apart = judge_outliers(seen.outliers, int(seen.squares.number.max()), "innovations")
    rest = float(seen.nis.total), float(seen.nis.number)
    # Outliers are reported only if the rest is right.
    if apart and is_right(*rest) and (not found or found[0].gain < apart[0].weight):
        return apart
    if found and found[0].gain > RATIO and found[0].matters:
        told = evidence.told.values.mean(axis=0)
        whose = GPS if found[0].source == GPS and _rival(found) is None else EITHER
        return _local(seen, found[0].gain, whose) or [_stated(found, seen, told)]
    # Without a comparison of explanations, as with further states, nothing speaks for the fixes.
    whose = GPS if seen.likelihoods.any() else EITHER
    return (_local(seen, 0.0, whose) or _sizes(seen)) if suspicious(seen) else []


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
        found.append(one._replace(gain=one.gain - PRICE))
    records = Fit(seen.causes.matrix[None], seen.causes.vector[None], seen.causes.squares)
    causes = {"GPS latency": [0], "GPS lever arm": [1, 2, 3]}
    causes |= {name: [CAUSES + at for at in own] for name, own in columns().items()}
    for name, own in causes.items():
        if not records.matrix[:, own, own].any():
            continue
        parts = estimates(records, own)[0]
        source = GPS if name.startswith("GPS") else IMU
        if not _matters(name, parts):
            continue
        price = PRICE * len(own)
        size = float(np.linalg.norm(parts))
        found.append(Explanation(name, source, gain_of(records, own) - price, size, parts))
    return _preferred(sorted(found, key=lambda one: -one.gain))


def _preferred(found: list[Explanation]) -> list[Explanation]:
    """Return explanations with a plain R too large before correlated fixes that explain hardly more.

    An R too large by more than `LARGE` is not plain: few fixes whose errors are correlated look like it.
    """
    best = found[0]
    plain = [one for one in found if one.name.startswith("R") and 1 / LARGE < one.size < 1]
    if best.name != CORRELATION or not plain or plain[0].gain < (1 - ALIKE) * best.gain:
        return found
    return [plain[0], *(one for one in found if one is not plain[0])]


def _matters(name: str, parts: FloatArray) -> bool:
    least = {"GPS latency": LATENCY, "GPS lever arm": LEVER_ARM}.get(name, 0.0)
    most = LINEAR if name.endswith(("misalignment", "scale factor")) else np.inf
    return bool(least < np.linalg.norm(parts) < most)


def _local(seen: Innovations, gain: float, whose: str) -> list[Weighed]:
    """Judge a stretch or a channel that is too large while the rest is right, if that explains as much.

    `whose` is ``"GPS"`` if the fixes are a more likely cause than the inertial sensors.
    """
    found = []
    for kind, name in enumerate(("position", "velocity")):
        where = stretch(seen.in_time, kind)
        if where is not None:
            words = stretch_words(where, seen.span)
            found += judge_size(
                where.squares,
                f"R {name}" if whose == GPS else EITHER,
                f"{words[0].upper()}{words[1:]} the {name} innovations are {{root}} × as large as assumed; "
                "before and after they are right.",
                "Check the receiver in that time (satellites, multipath), and outages before it."
                + ("" if whose == GPS else _MANOEUVRES),
                f"{name} innovations {words}",
            )
    if found and sum(entry.weight for entry in found) > (1 - ALIKE) * gain:
        return found
    if seen.likelihoods.any():  # then R of each channel is an explanation of its own
        return []
    for kind, name in enumerate(("position", "velocity")):
        own = slice(3 * kind, 3 * kind + 3)
        axis = channel(Squares(seen.offered.total[own], seen.offered.number[own]))
        other = slice(3 - 3 * kind, 6 - 3 * kind)
        others = float(seen.offered.total[other].sum()), float(seen.offered.number[other].sum())
        if axis is not None and (not others[1] or is_right(*others)):
            rival = "" if whose == GPS else ", or an error of the IMU shows in this direction"
            cause = f"R {name} {AXES[axis]} is about {{factor}} × too {{wrong}}{rival}."
            found = judge_size(
                Squares(seen.offered.total[own][axis], seen.offered.number[own][axis]),
                f"R {name} {AXES[axis]}" if whose == GPS else EITHER,
                f"The {name} innovations {AXES[axis]} are {{root}} × as large as assumed, the others are "
                f"right: {cause}",
                f"Multiply the variance of the {name} {AXES[axis]} in navigator.r by {{multiply}}."
                + ("" if whose == GPS else _MANOEUVRES),
                f"{name} innovations {AXES[axis]}",
                scales=("navigator.r", (3 * kind + axis, 3 * kind + axis + 1)),
            )
            if found and found[0].weight > (1 - ALIKE) * gain:
                return found
    return []


def _stated(found: list[Explanation], seen: Innovations, told: FloatArray) -> Weighed:
    """Return the finding of the best explanation, or of GPS or IMU if both explain nearly as much."""
    best = found[0]
    rival = _rival(found)
    statistic = f"logarithm of the likelihood ratio {best.gain:.0f}"
    if rival is not None:
        variance = not best.parts.size and best.source != GPS
        finding = Finding(
            EITHER,
            "not modelled",
            float("nan"),
            f"The innovations are not what the filter expects: {_words(best)} explains them, and "
            f"{_words(rival)} explains them nearly as well. They cannot tell GPS from IMU.",
            f"{f'{_gain_advice(best)} ' if variance else ''}Compare with a reference, or with another IMU "
            "or receiver. A flight with more turns shows the difference better.",
            f"{statistic}, {rival.gain:.0f} of the other",
            (_gain_change(best),) if variance else (),
        )
        return Weighed(best.gain, finding)
    return Weighed(best.gain, finding_of(found, seen, statistic, told))


def _rival(found: list[Explanation]) -> Explanation | None:
    """Return the best explanation by the other instrument if it explains nearly as much as the best."""
    best = found[0]
    rivals = [one for one in found[1:] if one.source != best.source and GPS in (one.source, best.source)]
    rival = max(rivals, key=lambda one: one.gain, default=None)
    if rival is None or rival.gain <= best.gain - max(RATIO, ALIKE * best.gain):
        return None
    return rival


def _words(one: Explanation) -> str:
    """Return an explanation as text."""
    if one.parts.size:
        unit = {"GPS latency": "s", "GPS lever arm": "m"}
        if one.name in unit:
            return f"a {one.name} of {one.size:.2g} {unit[one.name]}"
        if "scale" in one.name:
            return f"a {one.name} error of {100 * one.size:.2g} %"
        if "misalignment" in one.name:
            return f"an {one.name} of {np.degrees(one.size):.2g}°".replace("an gyro", "a gyro")
        return f"a {one.name}".replace("a acc", "an acc")
    if one.name == CORRELATION:
        return "a correlated error of the fixes"
    factor, wrong = (one.size, "small") if one.size > 1 else (1 / one.size, "large")
    return f"{one.name} {written(factor)} × too {wrong}"


def _alternative(found: list[Explanation]) -> str:
    """Return a sentence with the second explanation unless the best one is preferred to it; else nothing."""
    if len(found) < 2 or found[1].gain <= found[0].gain - RATIO:
        return ""
    return f" They cannot tell it from this: {_words(found[1])}."


def finding_of(found: list[Explanation], seen: Innovations, statistic: str, told: FloatArray) -> Finding:
    """Return the finding of the first of some explanations.

    `statistic` is its evidence, `told` are the latency and the lever arm (4,) that the filter assumed.
    """
    best = found[0]
    if best.name == "GPS latency":
        return latency(float(best.parts[0]), best.gain, told)
    if best.name == "GPS lever arm":
        return lever_arm(best.parts, best.gain, told)
    if best.name == CORRELATION:
        size = np.sqrt(seen.offered.mean[:3].mean())
        hidden = size < 1
        return Finding(
            CORRELATION,
            "not modelled",
            float("nan"),
            f"The position innovations are {written(size)} × as large as assumed and correlated in time: the "
            "errors of the fixes are correlated, and the filter assumes that they are white."
            + (
                " Innovations hide the slow part of such errors, so that R is not too large."
                if hidden
                else ""
            ),
            ADVICE_FILTERING if _filters_fixes(seen) else ADVICE_CORRELATION,
            statistic,
        )
    if best.parts.size:
        sensor = best.name.split()[0]
        return Finding(
            best.name,
            "not modelled",
            best.size,
            f"The innovations depend on the motion as errors of the {sensor}s do: {_words(best)}."
            + _alternative(found),
            *_remedy(best, sensor, statistic),
        )
    if best.name.startswith("R"):
        return _size_of_r(best, seen)
    too_small = best.size > 1
    return Finding(
        "gain",
        "too small" if too_small else "too large",
        max(best.size, 1 / best.size),
        f"The innovations {'are correlated in time' if too_small else 'alternate'}: the filter corrects too "
        f"{'little' if too_small else 'much'}. The most likely cause is {_words(best)}.",
        _gain_advice(best),
        f"{statistic}{interval_words(wrong_by(best.size, *best.interval))}",
        (_gain_change(best),),
        wrong_by(best.size, *best.interval),
    )


def _filters_fixes(seen: Innovations) -> bool:
    """Return whether correlated fixes are those of a receiver that filters them: hardly any error is white.

    Otherwise, the correlated error is a slow one beside the white errors that the filter assumes.
    """
    own = [at for at, hypothesis in enumerate(HYPOTHESES) if hypothesis.name == CORRELATION]
    return HYPOTHESES[max(own, key=lambda at: seen.likelihoods[at])].r[0] < 1


def _remedy(best: Explanation, sensor: str, statistic: str) -> tuple[str, str, tuple[Change, ...]]:
    """Return the advice for an error of inertial sensors, the statistic, and the changes of settings."""
    if "scale" not in best.name:
        return f"Calibrate the {sensor}s, or raise the {sensor} noise.", statistic, ()
    # Without their σ, P0 of the scale factors is zero, and the filter never estimates them.
    path = f"sensors.{sensor}.scale_factor_sigma"
    percent = float(f"{100 * best.size / np.sqrt(best.parts.size):.2g}")
    return (
        f"Calibrate the {sensor}s, or set navigator.states to 21, and {path} to {percent}.",
        statistic,
        (Change("navigator.states", 21), Change(path, percent)),
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


def _gain_change(best: Explanation) -> Change:
    name = f"navigator.{best.name[:2].strip().lower()}"
    rows = _ROWS.get(best.name)
    return Change(name if rows else f"{name}_scale", rounded(best.size), True, rows)


def _gain_advice(best: Explanation) -> str:
    if best.name in ("Q", "P0"):
        advice = f"Multiply navigator.{best.name.lower()}_scale by {written(best.size)}."
    else:
        matrix = "navigator.q" if best.name.startswith("Q") else "navigator.p0"
        advice = f"Multiply the {best.name[2:].strip()} variances of {matrix} by {written(best.size)}."
    return f"{ADVICE_IDENTIFY} Or: {advice}" if best.name.startswith("Q") and best.size > FAR_OFF else advice


def _size_of_r(best: Explanation, seen: Innovations) -> Finding:
    """Return the finding that R is wrong, from the size of its innovations."""
    ratio = best.size
    factor, wrong = (ratio, "small") if ratio > 1 else (1 / ratio, "large")
    channels, interval = list(R_CHANNELS[best.name]), wrong_by(ratio, *best.interval)
    if best.name == "R":
        # One of both alone would leave the fixes of the other with the wrong weight.
        squares, what, which = seen.nis, "innovations", "R of the position and the velocity"
        advice = f"Multiply navigator.r_scale by {written(ratio)}."
        change = Change("navigator.r_scale", rounded(ratio), True)
    else:
        of = best.name.removeprefix("R ")
        squares = Squares(seen.offered.total[channels].sum(), seen.offered.number[channels].sum())
        what, which = f"{of} innovations", best.name
        variances = "variances" if len(channels) > 1 else "variance"
        advice = f"Multiply the {of} {variances} of navigator.r by {written(ratio)}."
        change = Change("navigator.r", rounded(ratio), True, (channels[0], channels[-1] + 1))
    return Finding(
        best.name,
        f"too {wrong}",
        factor,
        f"The {what} are {written(float(squares.mean) ** 0.5)} × as large as assumed: {which} is "
        f"about {written(factor)} × too {wrong}.",
        advice,
        mean_square(squares, what) + interval_words(interval),
        (change,),
        interval,
    )


def _sizes(seen: Innovations) -> list[Weighed]:
    """Judge the size of the innovations if none of the tested causes explains it."""
    total, count = float(seen.nis.total), float(seen.nis.number)
    if not count or is_right(total, count):
        return []
    ratio = max(total / count, 1 / MATTERS**20)
    why = ", and none of the tested causes explains it."
    if not seen.likelihoods.any():
        why = (
            ". Their causes are not compared: the filter has further states, or measurements besides the "
            "fixes, or rounding spoils its covariance."
        )
    advice = "Look for errors that the filter does not model."
    if ratio < 1:
        advice = (
            "The assumed noise is too large. Most often it is R: multiply navigator.r_scale by "
            f"{written(ratio)}. In a filter with a state of the GPS drift, its σ "
            "(sensors.gps.correlated_sigma) may be too large instead."
        )
    return judge_size(
        seen.nis,
        "NIS",
        f"The innovations are {written(np.sqrt(ratio))} × as large as the filter says{why}",
        advice,
        "innovations (by NIS)",
    )
