"""Terms: the numbers of a calibration with their σ, and how withheld data judge them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from lab.base.arrays import FloatArray

LEVEL = 0.05
"""Probability with which a calibration that changes nothing would be taken to gain."""
FEWEST_JUDGED = 5
"""Fewest withheld values that judge: if all five of five become smaller, chance does so with 1/32."""
CONFIDENCE = 0.95
"""Probability of the intervals."""


class Term(NamedTuple):
    """A constant error of a sensor: measured = (1 + scale factor and misalignment) true + bias.

    Attributes
    ----------
    group, name, axis : str
        The sensor, such as ``"gyro"``; what it is, such as ``"misalignment"``; its axis, such as ``"xy"``,
        the part of y that x measures.
    value, sigma : float
        Its value and σ, in the unit; of a term that is not known, what the data leave of it.
    unit : str
        Unit of both.
    degrees : float
        Degrees of freedom behind σ.
    is_known : bool
        Whether the data determine it.
    """

    group: str
    name: str
    axis: str
    value: float
    sigma: float
    unit: str
    degrees: float
    is_known: bool

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the true value."""
        half = self.sigma * float(scipy.stats.t.ppf((1 + CONFIDENCE) / 2, max(self.degrees, 1.0)))
        return self.value - half, self.value + half

    def __str__(self) -> str:
        where = f"{self.group}, {self.name} {self.axis}"
        if not self.is_known:
            return f"{where}: unknown, the log does not show it"
        return f"{where}: {self.value:+.4g} ± {self.sigma:.2g} {self.unit}".replace("-", "−")


@dataclass(frozen=True)
class Judgement:
    """What withheld data say of a group of terms.

    Attributes
    ----------
    group : str
        The sensor, or the part of its terms.
    measure, unit : str
        What is compared, and its unit.
    before, after : float
        Root mean square of it in the withheld data, without and with the calibration.
    count : int
        Number of withheld values.
    p_value : float
        Probability of so clear a gain by chance alone.
    """

    group: str
    measure: str
    unit: str
    before: float
    after: float
    count: int
    p_value: float

    @property
    def gains(self) -> bool:
        """Whether the calibration makes it smaller, and not by chance."""
        return self.after < self.before and self.p_value < LEVEL

    def __str__(self) -> str:
        if self.count < FEWEST_JUDGED:
            return (
                f"The calibration of the {self.group} is refused: the log leaves {self.count} values to "
                f"judge it by ({self.measure}); accepted are at least {FEWEST_JUDGED}."
            )
        rests = (
            f"{self.measure} in withheld data: {self.before:.3g} {self.unit} before, "
            f"{self.after:.3g} {self.unit} after; {self.count} values, p {self.p_value:.1g}"
        )
        if self.gains:
            return f"The calibration of the {self.group} gains ({rests})."
        return f"The calibration of the {self.group} is refused, since it gains nothing ({rests})."


def judge(group: str, measure: str, unit: str, before: FloatArray, after: FloatArray) -> Judgement:
    """Return the judgement by values of withheld data.

    The test is the signed-rank test of Wilcoxon on the sizes, which needs no distribution of the values.

    Parameters
    ----------
    group, measure, unit
        As of `Judgement`.
    before, after : (n,) arrays
        The same values without and with the calibration.
    """
    if before.size < FEWEST_JUDGED:
        return Judgement(group, measure, unit, np.nan, np.nan, before.size, 1.0)
    gained = np.abs(before) - np.abs(after)
    p_value = float(scipy.stats.wilcoxon(gained, alternative="greater").pvalue) if gained.any() else 1.0
    sizes = [float(np.sqrt(np.mean(values**2))) for values in (before, after)]
    return Judgement(group, measure, unit, sizes[0], sizes[1], before.size, p_value)
