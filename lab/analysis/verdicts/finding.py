"""Finding: one wrong assumption of a filter, in plain words, with advice.

Each finding is based on one statistic with a known distribution. It is made only if the deviation is both
significant and large enough to matter (see `verdict`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts.sums import Squares
from lab.base.notebook_card import NotebookCard

DOUBT = 0.002
"""Probability that a χ² statistic of a matched filter lies outside its interval."""
MATTERS = 1.5
"""Smallest factor of a wrong variance that is reported. In the steady state of filters of a random walk and
of a constant velocity, an R that is wrong by it makes σ of the error at most 1.3 % larger; a factor of 3, up
to 10 %."""
LARGE = 30.0
"""Factor on a variance from which it is tried before it is stated: noise 5 times larger than a data sheet or
a calibration at rest says is rare, and an error of the data needs such factors."""
CONFIDENCE = 0.95
"""Probability that the interval of a factor contains it. A convention."""
MANY_SIGMA = 4.0
"""Smallest correlation of the innovations that is reported, in its standard deviations."""
WITHHELD = "No advice:"
"""Beginning of advice that was tried, and made something worse or nothing better."""
RATIO = 10.0
"""Smallest logarithm of the likelihood ratio at which one explanation is preferred to another."""
NOTHING = "nothing"
"""Basis of a verdict without evidence."""


class Change(NamedTuple):
    """A change of a setting that a finding advises.

    Attributes
    ----------
    path : str
        The setting.
    value : object
        New value, or factor.
    times : bool
        Whether `value` is a factor.
    rows : tuple of int or None
        First changed row of a matrix, and the one after the last.
    """

    path: str
    value: object
    times: bool = False
    rows: tuple[int, int] | None = None


@dataclass(frozen=True)
class Finding:
    """One wrong assumption.

    Attributes
    ----------
    quantity
        The wrong quantity: an assumption of the filter (``"R"``, ``"R position"``, ``"R velocity down"``,
        ``"Q"``, ``"Q gyro"``, ``"Q accelerometer bias"``, ``"P0"``, ``"P0 attitude"``); an unmodelled error
        (``"GPS latency"``, ``"GPS lever arm"``, ``"GPS correlation"``, ``"GPS outliers"``, ``"gyro scale
        factor"``, ``"accelerometer misalignment"``); ``"gate"`` if it rejects good fixes; ``"gain"``,
        ``"NEES"`` or ``"NIS"`` if the cause is unknown. `algorithm_verdict` has its own.
    direction
        ``"too small"``, ``"too large"``, ``"not modelled"`` or ``"rejected"``.
    factor
        Factor by which a variance is too small or too large. For an unmodelled error, its size: latency [s],
        length of the lever arm [m], σ of the correlated error [m], scale factor error [1], misalignment [rad]
        (NaN if unknown), fraction of the fixes that are outliers or were rejected.
    sentence, advice
        The error and the advice, as text.
    evidence
        The statistic behind the finding.
    changes
        The changes of settings that the advice names, which can be tried; may be empty.
    interval
        95 % interval of `factor`, if it is that of a variance; None if it is not known.
    """

    quantity: str
    direction: str
    factor: float
    sentence: str
    advice: str
    evidence: str
    changes: tuple[Change, ...] = ()
    interval: tuple[float, float] | None = None

    @property
    def counsel(self) -> str:
        """The advice as displayed: what to try, or why there is none; empty if that is said already."""
        shown = not self.advice or self.advice.startswith(WITHHELD)
        return self.advice if shown else f"Try: {self.advice}"


@dataclass(frozen=True)
class Suggestion:
    """What a filter may use besides, and does not: nothing is wrong without it.

    Attributes
    ----------
    sentence, advice
        What shows that it may be used, and the advice with what it brought when it was tried.
    changes
        The changes of settings that the advice names.
    """

    sentence: str
    advice: str
    changes: tuple[Change, ...]

    @property
    def counsel(self) -> str:
        """The advice as displayed."""
        return f"Try: {self.advice}"


@dataclass(frozen=True, repr=False)
class Verdict(NotebookCard):
    """The verdict on a filter.

    Attributes
    ----------
    headline
        One sentence.
    findings
        The findings by weight; empty for a consistent filter.
    basis
        The evidence used.
    suggestions
        What a filter may use besides, whether it is consistent or not; only of a verdict whose advice was
        tried.
    """

    CARD: ClassVar[str] = "verdict"

    headline: str
    findings: tuple[Finding, ...]
    basis: str
    suggestions: tuple[Suggestion, ...] = ()

    @property
    def consistent(self) -> bool | None:
        """Whether nothing is wrong; None if there was no evidence."""
        return None if self.basis == NOTHING else not self.findings

    def __str__(self) -> str:
        return self.headline

    def __repr__(self) -> str:
        found = [f"- {one.sentence} {one.counsel}".rstrip() for one in self.findings]
        found += [f"- {one.sentence} {one.counsel}" for one in self.suggestions]
        return "\n".join((f"Verdict by {self.basis}: {self.headline}", *found))


class Weighed(NamedTuple):
    """A finding, and the gain in log-likelihood of its explanation."""

    weight: float
    finding: Finding


def headline(findings: tuple[Finding, ...], otherwise: str) -> str:
    """Return the first finding's sentence and the number of further ones, or the text for no findings."""
    if not findings:
        return otherwise
    more = len(findings) - 1
    return findings[0].sentence + (f" ({more} more)" if more else "")


def sorted_findings(weighed: list[Weighed]) -> tuple[Finding, ...]:
    """Return findings by weight, the largest first."""
    return tuple(entry.finding for entry in sorted(weighed, key=lambda entry: -entry.weight))


def judge_size(
    squares: Squares,
    quantity: str,
    sentence: str,
    advice: str,
    of_what: str,
    doubt: float = DOUBT,
    scales: tuple[str, tuple[int, int] | None] | None = None,
) -> list[Weighed]:
    """Judge a variance by the mean square of the values that should have this variance.

    `scales` is the setting, and the rows of it, that the advice multiplies by the mean square.
    """
    total, count = float(squares.total), float(squares.number)
    if not count or is_right(total, count, doubt):
        return []
    ratio = max(total / count, 1e-12)
    factor, wrong = (ratio, "small") if ratio > 1 else (1 / ratio, "large")
    words = {
        "root": written(np.sqrt(ratio)),
        "factor": written(factor),
        "multiply": written(ratio),
        "wrong": wrong,
    }
    fewest, most = chi_square_interval(count, 1, CONFIDENCE)
    interval = wrong_by(ratio, total / most, total / fewest)
    finding = Finding(
        quantity,
        f"too {wrong}",
        factor,
        sentence.format(**words),
        advice.format(**words),
        f"{mean_square(squares, of_what, doubt)}{interval_words(interval)}",
        () if scales is None else (Change(scales[0], rounded(ratio), True, scales[1]),),
        interval,
    )
    return [Weighed(size_weight(total, count), finding)]


def size_weight(total: float, count: float) -> float:
    """Return the gain in log-likelihood if the variance equals the mean square."""
    ratio = max(total / count, 1e-12)
    return float(count / 2 * (ratio - 1 - np.log(ratio)))


def written(number: float, digits: int = 2) -> str:
    """Return a number, rounded to some digits, as people write it: 9800, and not 9.8e+03."""
    return np.format_float_positional(rounded(number, digits), trim="-")


def rounded(number: float, digits: int = 2) -> float:
    """Return a number, rounded to some digits."""
    return float(f"{number:.{digits}g}")


def wrong_by(ratio: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of the factor by which a variance is too small or too large.

    `low` and `high` are the interval of `ratio`, the true variance over the assumed one.
    """
    return (low, high) if ratio > 1 else (1 / high, 1 / low if low else np.inf)


def interval_words(interval: tuple[float, float] | None) -> str:
    """Return the 95 % interval of a factor, as text that follows a statistic; empty if it is not known."""
    if interval is None:
        return ""
    low, high = interval
    ends = f"{written(low)} to {written(high)}" if np.isfinite(high) else f"at least {written(low)}"
    return f"; 95 % interval of the factor {ends}"


def mean_square(squares: Squares, of_what: str, doubt: float = DOUBT) -> str:
    """Return a mean square and its expected interval as text."""
    total, count = float(squares.total), float(squares.number)
    low, high = (limit / count for limit in chi_square_interval(count, 1, 1 - doubt))
    return f"mean square of the {of_what} {written(total / count, 3)}, expected {low:.2f} to {high:.2f}"


def is_right(total: float, count: float, doubt: float = DOUBT) -> bool:
    """Return whether a sum of `count` squares is compatible with unit variance, or close enough to it."""
    low, high = chi_square_interval(count, 1, 1 - doubt)
    return low <= total <= high or 1 / MATTERS < total / count < MATTERS
