"""Finding: one thing that is wrong with what a filter assumes, in plain words, and what to try.

Each finding rests on one statistic with a known distribution, and is made only if that is both beyond doubt
and large enough to matter (see `verdict`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.sums import Squares

DOUBT = 0.002
"""Probability that a χ² statistic of a matched filter lies outside its interval."""
MATTERS = 1.5
"""Factor from which on a wrong variance is worth a statement."""
MANY_SIGMA = 4.0
"""Standard deviations from which on a correlation of the innovations is stated."""
WITHHELD = "No advice:"
"""How advice begins that was tried and made something worse."""
RATIO = 10.0
"""Logarithm of the likelihood ratio from which on one explanation is preferred to another."""
NOTHING = "nothing"
"""Basis of a verdict that says only that there is none."""


class Change(NamedTuple):
    """A change of a setting that a finding advises.

    Attributes
    ----------
    path : str
        The setting.
    value : object
        What it is set to; or what it is multiplied by.
    times : bool
        Whether it is multiplied.
    rows : tuple of int or None
        First row that is changed of a matrix, and the one after the last.
    """

    path: str
    value: object
    times: bool = False
    rows: tuple[int, int] | None = None


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes
    ----------
    quantity
        What: an assumption of the filter (``"R position"``, ``"R velocity down"``, ``"Q"``, ``"Q gyro"``,
        ``"Q accelerometer bias"``, ``"P0"``, ``"P0 attitude"``); an error nobody told it of (``"GPS
        latency"``, ``"GPS lever arm"``, ``"GPS correlation"``, ``"GPS outliers"``, ``"gyro scale factor"``,
        ``"accelerometer misalignment"``); ``"gate"`` where it rejects good fixes; ``"gain"``, ``"NEES"`` or
        ``"NIS"`` where nothing more can be said. `algorithm_verdict` has its own.
    direction
        ``"too small"``, ``"too large"``, ``"not modelled"`` or ``"rejected"``.
    factor
        How many times too small or too large a variance is; of what is not modelled its size: latency [s],
        length of the lever arm [m], σ of the correlated error [m], a scale factor error [1], a misalignment
        [rad] (NaN where it cannot be known), the part of the fixes that are outliers or were rejected.
    sentence, advice
        What is wrong and what to try, for a person.
    evidence
        The statistic it rests on.
    changes
        The settings that the advice changes, which can be tried; empty where it names none.
    """

    quantity: str
    direction: str
    factor: float
    sentence: str
    advice: str
    evidence: str
    changes: tuple[Change, ...] = ()

    @property
    def counsel(self) -> str:
        """The advice as it is said: to be tried, or why there is none."""
        return self.advice if self.advice.startswith(WITHHELD) else f"Try: {self.advice}"


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


def headline(findings: tuple[Finding, ...], otherwise: str) -> str:
    """Return the first finding's sentence and how many more there are, or what is said without any."""
    if not findings:
        return otherwise
    more = len(findings) - 1
    return findings[0].sentence + (f" ({more} more)" if more else "")


def sorted_findings(weighed: list[Weighed]) -> tuple[Finding, ...]:
    """Return findings, the weightiest first."""
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
    """Judge a variance by the mean square of what it should be the variance of.

    `scales` is the setting, and the rows of it, that the advice multiplies by the mean square.
    """
    total, count = float(squares.total), float(squares.number)
    if not count or is_right(total, count, doubt):
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
        mean_square(squares, of_what, doubt),
        () if scales is None else (Change(scales[0], float(f"{ratio:.2g}"), True, scales[1]),),
    )
    return [Weighed(size_weight(total, count), finding)]


def size_weight(total: float, count: float) -> float:
    """Return by how much a variance of the mean square raises the logarithm of the likelihood."""
    ratio = max(total / count, 1e-12)
    return float(count / 2 * (ratio - 1 - np.log(ratio)))


def mean_square(squares: Squares, of_what: str, doubt: float = DOUBT) -> str:
    """Return a mean square and where it should lie, in words."""
    total, count = float(squares.total), float(squares.number)
    low, high = (limit / count for limit in chi_square_interval(count, 1, 1 - doubt))
    return f"mean square of the {of_what} {total / count:.3g}, expected {low:.2f} to {high:.2f}"


def is_right(total: float, count: float, doubt: float = DOUBT) -> bool:
    """Return whether a sum of `count` squares may be of unit variance, or is close enough to it."""
    low, high = chi_square_interval(count, 1, 1 - doubt)
    return low <= total <= high or 1 / MATTERS < total / count < MATTERS
