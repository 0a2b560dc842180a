"""Receiver report: what the fixes of a receiver are worth, as rows of figures and in sentences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from lab.analysis.receiver_errors import FEWEST
from lab.base.plain_data import to_plain_data
from lab.experiment.experiment import Experiment

ALL = "all"
"""Kind of fixes whose receiver does not say it."""
FITS = (0.9, 1.1)
"""NIS per component of the other half between which the sizes are confirmed."""
HONEST = 1.5
"""Ratio of the true σ to the claimed one, or its inverse, up to which a claim is called right."""
ALLOWED = 1.05
"""Largest growth of the error of withheld fixes with which the found sizes are recommended."""


class KindRow(NamedTuple):
    """The errors of one kind of fixes along one axis.

    Attributes
    ----------
    kind, axis : str
        Kind of fixes; horizontal (each of two axes) or vertical.
    fixes : int
        Number of fixes.
    claimed : float
        Median of the σ that the receiver claims [m]; NaN if none.
    white, slow, tau : float
        σ of the white part [m], σ [m] and correlation time [s] of the slow part.
    outliers : int
        Number of outliers.
    nis : float
        Mean square of the second half's innovations in their σ, fitted on the first; NaN with fewer fixes
        than `FEWEST` in each.
    basis : str
        What the figures rest on.
    quarters : (float, float)
        Smallest and largest of the same mean square in the quarters of the second half; NaN with fewer
        components than `FEWEST` in one of them.
    varies : bool
        Whether the quarters differ beyond chance.
    following, memory : float
        The same as `nis`, with a σ that follows the innovations of so many fixes before.
    """

    kind: str
    axis: str
    fixes: int
    claimed: float
    white: float
    slow: float
    tau: float
    outliers: int
    nis: float
    basis: str
    quarters: tuple[float, float] = (math.nan, math.nan)
    varies: bool = False
    following: float = math.nan
    memory: float = math.nan

    @property
    def sigma(self) -> float:
        """σ of white and slow part together [m]."""
        return math.hypot(self.white, self.slow)

    @property
    def times(self) -> float:
        """The true σ over the claimed one; NaN if none is claimed."""
        return self.sigma / self.claimed


@dataclass(frozen=True)
class ReceiverReport:
    """What the fixes of a receiver are worth.

    Attributes
    ----------
    source : str
        The mission or file.
    rows : tuple of KindRow
        The errors by kind and axis.
    velocity : (float, float)
        Claimed and found σ of a velocity component [m/s]; NaN if unknown.
    by_satellites : tuple
        Number of satellites from and to, number of fixes, root mean square of their innovations in σ.
    sentences : tuple of str
        What the figures say, each with what it rests on.
    experiment : Experiment or None
        The log with the found sizes in the filter; None for fixes without an IMU.
    before, after : float
        Error of fixes withheld for 10 s with the filter as it was and with the found sizes [m]; NaN without
        an IMU.
    """

    source: str
    rows: tuple[KindRow, ...]
    velocity: tuple[float, float]
    by_satellites: tuple[tuple[int, int, int, float], ...]
    sentences: tuple[str, ...]
    experiment: Experiment | None
    before: float
    after: float

    @property
    def recommended(self) -> bool:
        """Whether positions across outages are not worse with the found sizes."""
        return self.after <= ALLOWED * self.before

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data, which JSON can hold."""
        found: dict[str, Any] = to_plain_data(
            {
                "source": self.source,
                "rows": [
                    {**row._asdict(), "sigma": row.sigma, "times_claimed": row.times} for row in self.rows
                ],
                "velocity_sigma_claimed": self.velocity[0],
                "velocity_sigma": self.velocity[1],
                "by_satellites": self.by_satellites,
                "sentences": self.sentences,
                "withheld_error_before_m": self.before,
                "withheld_error_after_m": self.after,
                "recommended": self.recommended if self.experiment is not None else None,
            }
        )
        return found


def row_sentence(row: KindRow) -> str:
    """Return what a row says, in one sentence, with what it rests on."""
    which = f"{row.axis} position" + ("" if row.kind == ALL else f", {row.kind} fixes")
    if math.isnan(row.white):
        few = f"{row.fixes} {row.kind} fixes are too few to show their errors: accepted are {FEWEST}."
        same = f"The {which} is the same in all {row.fixes} fixes: nothing in it was measured."
        return few if row.fixes < FEWEST else same
    parts = f"white {metres(row.white)}"
    if row.slow > 0:
        parts += f" and slow {metres(row.slow)} with a correlation time of {row.tau:.0f} s"
    shown = f"({parts}; {row.fixes} fixes: {row.basis})"
    if math.isnan(row.claimed):
        return f"The receiver claims no σ for the {which}; its errors are {metres(row.sigma)} {shown}."
    claim = f"The receiver claims {metres(row.claimed)} for the {which}, and its errors are"
    if row.white > HONEST * row.claimed:
        return (
            f"{claim} {metres(row.sigma)}: the claimed σ is {row.times:.3g} times too small, and a filter "
            f"that believes it trusts the fixes too much {shown}."
        )
    if row.times > HONEST:
        return (
            f"{claim} {metres(row.sigma)}, {row.times:.3g} times as large: a slow part comes on top of what "
            f"it claims, which no R describes and a state of the filter does {shown}."
        )
    if row.times < 1 / HONEST:
        return (
            f"{claim} {metres(row.sigma)} from fix to fix and over minutes, {1 / row.times:.3g} times less "
            f"{shown}; errors that last longer than the log do not show."
        )
    return f"{claim} {metres(row.sigma)} {shown}: the claim is right."


def sentence_on_halves(row: KindRow) -> str:
    """Return how the sizes of the first half predict the second."""
    said = "confirms them"
    if not FITS[0] <= row.nis <= FITS[1]:
        said = "does not confirm them"
        if row.varies:
            said += ": the errors change within minutes, as those of a receiver that filters its output do"
        elif not math.isnan(row.quarters[0]):
            said += ": the receiver changed from one half to the other"
    low, high = row.quarters
    within = "" if math.isnan(low) else f"; {low:.2f} to {high:.2f} in its quarters"
    follows = ""
    if math.isfinite(row.memory):
        follows = (
            f" With a σ that follows the innovations of the last {row.memory:.0f} fixes: {row.following:.2f}."
        )
    return (
        f"Sizes found in the first half, judged by the second with its own motion ({row.axis}, {row.kind}): "
        f"NIS per component {row.nis:.2f}, which {said} ({FITS[0]} to {FITS[1]} does{within}).{follows}"
    )


def advice_on(before: float, after: float) -> str:
    """Return whether the found sizes help, from the errors of withheld fixes without and with them [m]."""
    if not math.isfinite(before):
        return "The log is too short for outages: whether the found sizes help is not known."
    figures = f"fixes withheld for 10 s: error {before:.3g} m before, {after:.3g} m after"
    if after <= ALLOWED * before:
        return f"With the found sizes in the filter, positions across outages are not worse ({figures})."
    return f"Do not use the found sizes in the filter: positions across outages are worse ({figures})."


def metres(value: float) -> str:
    """Return a length in the unit that reads best."""
    unit, scale = ("m", 1) if value >= 1 else ("cm", 100) if value >= 0.01 else ("mm", 1000)
    return f"{scale * value:.2g} {unit}"
