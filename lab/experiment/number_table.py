"""Number table: the noise of an IMU for a filter, from rest and from motion, with intervals and causes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from lab.base.parameters.units import TO_SI
from lab.base.plain_data import to_plain_data

if TYPE_CHECKING:
    from lab.experiment.experiment import Experiment

TERMS = ("white noise", "bias random walk")
"""The two terms of each triad that filters have."""
UNITS = (("°/s/√Hz", "µg/√Hz"), ("°/h/√h", "mg/√h"))
"""Unit of each term, gyros and accelerometers."""


HEADS = ("group", "term", "at rest", "in motion", "factor", "use", "unit", "one sample [SI]")
"""Headings of the table."""


class Estimate(NamedTuple):
    """A number with its 95 % interval, in its unit; a low end of 0 says that only an upper end is known."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if not self.low > 0:
            return f"at most {self.high:.3g}"
        return f"{self.value:.3g} ({self.low:.3g} to {self.high:.3g})"


UNKNOWN = "unknown"
"""What stands in place of a number that neither log shows."""


def number_text(value: float) -> str:
    """Return a number as text."""
    return UNKNOWN if math.isnan(value) else f"{value:.3g}"


@dataclass(frozen=True)
class NumberRow:
    """A term of a triad.

    Attributes
    ----------
    triad, term, unit : str
        Names of the triad and the term, and the unit of all values.
    at_rest, in_motion : Estimate or None
        From the log at rest and from the drive; None if it shows nothing of the term.
    used : float
        The number to use; NaN if neither log shows one.
    discrete : float
        The same for one sample of the drive, or of the rest without a drive: σ of a sample, or of the step of
        the bias between two [rad/s] or [m/s²].
    cause : str
        Why motion and rest differ.
    basis : str
        What the number rests on.
    """

    triad: str
    term: str
    unit: str
    at_rest: Estimate | None
    in_motion: Estimate | None
    used: float
    discrete: float
    cause: str
    basis: str

    @property
    def factor(self) -> Estimate | None:
        """Motion over rest with its 95 % interval; None if one of them is unknown."""
        one, other = self.in_motion, self.at_rest
        if one is None or other is None or not other.value > 0:
            return None
        low = one.low / other.high if other.high > 0 else 0.0
        return Estimate(one.value / other.value, low, one.high / other.low if other.low > 0 else math.inf)

    @property
    def si(self) -> float:
        """The number to use in SI units."""
        return self.used * TO_SI[self.unit]

    @property
    def one_sided(self) -> float:
        """The density of white noise as data sheets write it, √2 N; NaN for other terms."""
        return math.sqrt(2) * self.used if self.term == TERMS[0] else math.nan


@dataclass(frozen=True)
class ImuNumbers:
    """The noise of an IMU for a filter.

    Attributes
    ----------
    static, moving : str
        Where the rest and the drive are from; empty if there is none.
    rate : float
        Rate of the samples for the discrete values [Hz].
    rows : tuple of NumberRow
        White noise and random walk of gyros and accelerometers.
    motion : tuple of float
        Random walk intensities of the vehicle's angular rate [rad²/s³] and acceleration [m²/s⁵] at
        30 Hz, NaN without a drive.
    experiment : Experiment or None
        The drive with these numbers in the filter; None without a drive, and for the file of one, which is
        no mission.
    remarks : tuple of str
        What else a reader must know, each with what it rests on.
    """

    static: str
    moving: str
    rate: float
    rows: tuple[NumberRow, ...]
    motion: tuple[float, float]
    experiment: Experiment | None
    remarks: tuple[str, ...]

    @property
    def cells(self) -> tuple[tuple[str, ...], ...]:
        """The rows as texts, under `HEADS`."""
        return tuple(
            (
                row.triad,
                row.term,
                str(row.at_rest or UNKNOWN),
                str(row.in_motion or UNKNOWN),
                str(row.factor or UNKNOWN),
                number_text(row.used),
                row.unit,
                number_text(row.discrete),
            )
            for row in self.rows
        )

    @property
    def convention(self) -> str:
        """What the densities and the values of one sample are."""
        return (
            f"Densities are two-sided (N of IEEE 952); a data sheet's one-sided noise density is √2 times as "
            f"large. One sample is σ of a sample at {self.rate:.4g} Hz, or the step of the bias between two."
        )

    def row(self, triad: str, term: str) -> NumberRow:
        """Return the row of a term."""
        return next(one for one in self.rows if (one.triad, one.term) == (triad, term))

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data, which JSON can hold."""
        rows = [
            {
                "triad": row.triad,
                "term": row.term,
                "unit": row.unit,
                "at_rest": row.at_rest and row.at_rest._asdict(),
                "in_motion": row.in_motion and row.in_motion._asdict(),
                "factor": row.factor and row.factor._asdict(),
                "used": row.used,
                "one_sided": row.one_sided,
                "discrete_si": row.discrete,
                "cause": row.cause,
                "basis": row.basis,
            }
            for row in self.rows
        ]
        found: dict[str, Any] = to_plain_data(
            {
                "static": self.static or None,
                "moving": self.moving or None,
                "rate_hz": self.rate,
                "rows": rows,
                "remarks": self.remarks,
            }
        )
        return found
