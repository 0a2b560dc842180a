"""Finding: one wrong assumption of a filter, in plain words, with advice.

Each finding is based on one statistic with a known distribution. It is made only if the deviation is both
significant and large enough to matter (see `verdict`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from string import Formatter
from typing import ClassVar, NamedTuple

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.sums import Squares
from lab.base.notebook_card import NotebookCard
from lab.base.numbers import format_number, round_digits

WITHHELD = "No advice:"
"""Beginning of advice that was tried, and made something worse or nothing better."""
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


class Advice(NamedTuple):
    """Advice of the table of findings: its text, and the changes of settings that it names.

    In both, names in braces are fields. The value of a change may be one: ``"{multiply}"``.
    """

    text: str
    changes: tuple[Change, ...] = ()

    def filled(self, **fields: object) -> Advice:
        """Return the advice with its fields filled."""
        return Advice(_fill_text(self.text, fields), tuple(_fill_change(one, fields) for one in self.changes))


@dataclass(frozen=True)
class Wording:
    """A row of the table of findings: how one finding is worded, with names of fields in braces.

    Attributes
    ----------
    quantity, sentence
        As of `Finding`.
    advice, changes
        The advice that it has unless it is given another, as of `Advice`.
    """

    quantity: str
    sentence: str
    advice: str = ""
    changes: tuple[Change, ...] = ()

    def with_advice(self, *parts: Advice) -> Wording:
        """Return the row with other advice: the sentences and the changes of all parts."""
        text = " ".join(part.text for part in parts)
        return replace(self, advice=text, changes=tuple(one for part in parts for one in part.changes))

    def finding(
        self,
        size: float,
        evidence: str,
        interval: tuple[float, float] | None = None,
        rows: tuple[int, int] | None = None,
        /,
        direction: str = "not modelled",
        **fields: object,
    ) -> Finding:
        """Return the finding, with its fields filled.

        Parameters
        ----------
        size, evidence, interval, direction
            As of `Finding`, `size` as its `factor`.
        rows
            The rows of the matrix that the changes multiply, as of `Change`.
        **fields
            What the names in braces stand for. Numbers without a format are rounded to two digits.
        """
        fields["direction"] = direction
        changes = (one._replace(rows=rows) if one.times else one for one in self.changes)
        advice = Advice(self.advice, tuple(changes)).filled(**fields)
        quantity, sentence = (_fill_text(text, fields) for text in (self.quantity, self.sentence))
        text, done = advice
        return Finding(quantity, direction, size, sentence, text, evidence, done, interval)


class _Fields(Formatter):
    """Fills fields; a number without a format is written as people write it."""

    def format_field(self, value: object, format_spec: str) -> str:
        if isinstance(value, float) and not format_spec:
            return format_number(value)
        return str(super().format_field(value, format_spec))


_FIELDS = _Fields()


def _fill_text(text: str, fields: dict[str, object]) -> str:
    return _FIELDS.vformat(text, (), fields)


def _fill_change(change: Change, fields: dict[str, object]) -> Change:
    """Return a change of a row of the table, with its fields filled; a factor is rounded to two digits."""
    value = change.value
    if isinstance(value, str) and value.startswith("{"):
        value = fields[value[1:-1]]
        value = round_digits(value) if change.times and isinstance(value, float) else value
    return change._replace(path=_fill_text(change.path, fields), value=value)


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
    note
        What a consistent filter knows to be wrong with its data: it stands first in the headline.
    together
        Whether the advice on all findings was tried in one run: what helped is all of it.
    """

    CARD: ClassVar[str] = "verdict"

    headline: str
    findings: tuple[Finding, ...]
    basis: str
    suggestions: tuple[Suggestion, ...] = ()
    note: Finding | None = None
    together: bool = False

    @property
    def consistent(self) -> bool | None:
        """Whether nothing is wrong; None if there was no evidence."""
        return None if self.basis == NOTHING else not self.findings

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes of settings of the first advice that has any; of tried advice, only what helped has.

        Those of all findings, if they were tried together.
        """
        if self.together:
            return tuple(change for one in self.findings for change in one.changes)
        named: tuple[Finding | Suggestion, ...] = (*self.findings, *self.suggestions)
        return next((one.changes for one in named if one.changes), ())

    def __str__(self) -> str:
        return self.headline

    def __repr__(self) -> str:
        found = [f"- {one.sentence} {one.counsel}".rstrip() for one in self.findings]
        found += [f"- {one.sentence} {one.counsel}" for one in self.suggestions]
        found += [f"- {self.note.counsel}"] if self.note else []
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
    wording: Wording,
    of_what: str,
    doubt: float | None = None,
    rows: tuple[int, int] | None = None,
    **fields: object,
) -> list[Weighed]:
    """Judge a variance by the mean square of the values that should have this variance.

    The fields ``root``, ``factor``, ``multiply`` and ``direction`` are filled here, the others of the row of
    the table by `fields`. `rows` are those of the matrix that the advice multiplies by the mean square.
    """
    total, count = float(squares.total), float(squares.number)
    # Values that are all zero are of errors that are not simulated: no factor describes their variance.
    if not total or is_right(total, count, doubt):
        return []
    ratio = max(total / count, 1e-12)
    factor = max(ratio, 1 / ratio)
    fewest, most = chi_square_interval(count, 1, limits.VERDICT.confidence)
    interval = wrong_factor_interval(ratio, total / most, total / fewest)
    finding = wording.finding(
        factor,
        f"{mean_square(squares, of_what, doubt)}{interval_words(interval)}",
        interval,
        rows,
        root=float(np.sqrt(ratio)),
        factor=factor,
        multiply=ratio,
        direction=wrong_direction(ratio),
        **fields,
    )
    return [Weighed(size_weight(total, count), finding)]


def wrong_direction(ratio: float) -> str:
    """Return the direction in which a variance is wrong, given the true one over the assumed one."""
    return "too small" if ratio > 1 else "too large"


def size_weight(total: float, count: float) -> float:
    """Return the gain in log-likelihood if the variance equals the mean square."""
    ratio = max(total / count, 1e-12)
    return float(count / 2 * (ratio - 1 - np.log(ratio)))


def wrong_factor_interval(ratio: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of the factor by which a variance is too small or too large.

    `low` and `high` are the interval of `ratio`, the true variance over the assumed one.
    """
    return (low, high) if ratio > 1 else (1 / high, 1 / low if low else np.inf)


def interval_words(interval: tuple[float, float] | None) -> str:
    """Return the 95 % interval of a factor, as text that follows a statistic; empty if it is not known."""
    if interval is None:
        return ""
    low, high = interval
    ends = (
        f"{format_number(low)} to {format_number(high)}"
        if np.isfinite(high)
        else f"at least {format_number(low)}"
    )
    return f"; 95 % interval of the factor {ends}"


def mean_square(squares: Squares, of_what: str, doubt: float | None = None) -> str:
    """Return a mean square and its expected interval as text."""
    total, count = float(squares.total), float(squares.number)
    low, high = (limit / count for limit in chi_square_interval(count, 1, 1 - _describe_doubt(doubt)))
    found = f"normalised mean square of the {of_what} {format_number(total / count, 3)}"
    return f"{found}; a matched filter gives {low:.2f} to {high:.2f}"


def _describe_doubt(given: float | None) -> float:
    return limits.VERDICT.doubt if given is None else given


def is_right(total: float, count: float, doubt: float | None = None) -> bool:
    """Return whether a sum of `count` squares is compatible with unit variance, or close enough to it."""
    low, high = chi_square_interval(count, 1, 1 - _describe_doubt(doubt))
    return (
        low <= total <= high or 1 / limits.VERDICT.wrong_factor < total / count < limits.VERDICT.wrong_factor
    )
