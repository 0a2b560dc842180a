"""Identification: sensor parameters from innovations, with error bars, and their effect on predictions.

It contains the parameters and the errors of withheld fixes, both before and after, and the settings and the
card with the new parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from scipy import special

from lab.sensors.cards import Card
from lab.sensors.datum import DENSITY, TWO_SIDED, Datum
from lab.sensors.suite import SensorSuite

if TYPE_CHECKING:
    import pandas as pd

ChosenBy = Literal["next fixes", "outages", "factors"]

INSIDE = 0.85
"""Fraction of the NIS in their 95 % intervals below which the reason is reported."""
ALLOWED = 1.05
"""Largest factor by which the error of withheld fixes may grow, by chance, if their likelihood improves."""
BY_CHANCE = 0.05
"""Chance of a growth that counts as one although there is none. A convention."""


class Row(NamedTuple):
    """A parameter, before and after.

    Attributes
    ----------
    parameter, unit : str
        Name and unit; the unit is empty for a factor.
    before, after : float
        Assumed value and identified value; equal if the log does not show the parameter.
    sigma : float
        Standard deviation of `after` beside the other values; NaN if the log does not show the parameter.
    low, high : float
        95 % interval, whatever other noise may be; it starts at 0 if the log only shows that the parameter is
        at most `high`. Noise that the log does not show has one, too; other parameters then have NaN.
    observable : bool
        Whether the log shows the parameter.
    applied : bool
        Whether the settings take the new value over: the log refutes the assumed one beside the other values,
        or the verdict advises it.
    """

    parameter: str
    unit: str
    before: float
    after: float
    sigma: float
    low: float
    high: float
    observable: bool
    applied: bool

    @property
    def words(self) -> str:
        """The information in the log, as text."""
        if not self.observable:
            most = f", at most {self.high:.3g}" if math.isfinite(self.high) else ""
            return "chosen as a whole" if self.applied else f"not observable in this flight{most}"
        words = f"at most {self.high:.3g}" if self.low == 0 else f"{self.low:.4g} to {self.high:.4g}"
        return words if self.applied else f"{words}: not changed"


class HeldOut(NamedTuple):
    """The accuracy with which a filter predicts withheld fixes.

    Attributes
    ----------
    fixes : int
        How many.
    position_error, velocity_error : float
        Root mean square, all components together [m], [m/s]; NaN if not measured.
    in_sigma : float
        Root mean square of each component in its σ: 1 for a consistent filter.
    log_likelihood : float
        Mean log-likelihood of a fix.
    by_outage : tuple of float
        Mean square error of the positions in each outage [m²].
    """

    fixes: int
    position_error: float
    velocity_error: float
    in_sigma: float
    log_likelihood: float
    by_outage: tuple[float, ...]


def predicts_better(before: HeldOut, after: HeldOut, *, white: bool = False) -> bool:
    """Return whether withheld fixes are more likely than before, and their error no larger.

    Parameters
    ----------
    before, after
        The predictions of the same fixes.
    white
        Whether the innovations are white, so that the model explains all that the log shows. Then only an
        error that grows by more than the outages themselves scatter counts: the true noise often loses
        against wrong noise in five outages.
    """
    if not after.log_likelihood > before.log_likelihood:
        return False
    if white:
        return not _error_grows(before, after)
    return not after.position_error > ALLOWED * before.position_error


def _error_grows(before: HeldOut, after: HeldOut) -> bool:
    """Return whether the error in the outages grows, by a paired t-test."""
    growth = np.subtract(after.by_outage, before.by_outage)
    if growth.size < 2:
        return False
    scatter = float(np.std(growth, ddof=1)) / math.sqrt(growth.size)
    return bool(growth.mean() > special.stdtrit(growth.size - 1, 1 - BY_CHANCE) * scatter)


@dataclass(frozen=True, eq=False)
class Identification:
    """The result of an identification from the innovations of a run.

    Attributes
    ----------
    mission : str
        Mission of the innovations.
    rows : tuple of Row
        The parameters.
    before, after : HeldOut
        Prediction of fixes that were withheld for `withheld` seconds every `every` seconds.
    withheld, every : float
        Lengths of these times [s].
    inside : (float, float)
        Fraction of the NIS in their 95 % intervals, before and after; each fix is predicted from all before
        it.
    white : bool
        Whether the innovations are white with the new parameters; if not, the intervals allow for their
        correlation.
    spread : str
        Remaining problem of the spread of the innovations; empty if there is none.
    chosen_by : {"next fixes", "outages", "factors"}
        Criterion of the choice: the likelihood of each next fix; the likelihood of fixes across other outages
        than those judged; or, if no parameters predict withheld fixes better, one factor on R and one on Q by
        the error of these fixes.
    outliers : int
        Number of fixes omitted as outliers.
    fixes : int
        Number of used fixes.
    changes : mapping
        Settings with the new parameters, nested by group.
    changes_of : callable
        Returns the settings with the new values of some parameters only, given their names.
    at_bounds : tuple of str
        Names of the parameters at a bound: of R, or of a setting.
    cure : str
        The setting that the verdict advises, from which the search began; empty if it is of no parameter.
    seconds : float
        Computing time [s].
    """

    mission: str
    rows: tuple[Row, ...]
    before: HeldOut
    after: HeldOut
    withheld: float
    every: float
    inside: tuple[float, float]
    white: bool
    spread: str
    chosen_by: ChosenBy
    outliers: int
    fixes: int
    changes: Mapping[str, Any]
    changes_of: Callable[[Collection[str]], Mapping[str, Any]] = field(repr=False)
    cure: str
    at_bounds: tuple[str, ...]
    seconds: float

    @property
    def applied(self) -> tuple[str, ...]:
        """Names of the parameters that the settings change."""
        return tuple(row.parameter for row in self.rows if row.applied)

    @property
    def recommended(self) -> bool:
        """Whether withheld fixes are predicted better than before."""
        return predicts_better(self.before, self.after, white=self.white)

    @property
    def table(self) -> pd.DataFrame:
        """The rows as a table."""
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        return pd.DataFrame(self.rows, columns=list(Row._fields))

    @property
    def sentence(self) -> str:
        """The result in a few sentences."""
        word = "better" if self.recommended else "no better"
        grown = self.recommended and self.after.position_error > self.before.position_error
        text = (
            f"Fixes withheld for {self.withheld:g} s are predicted {word}: error "
            f"{self.before.position_error:.3g} m before, {self.after.position_error:.3g} m after"
            f"{', which is within chance' * grown}; in its σ "
            f"{self.before.in_sigma:.3g} before, {self.after.in_sigma:.3g} after. NIS in its 95 % interval: "
            f"{100 * self.inside[0]:.0f} % of the fixes before, {100 * self.inside[1]:.0f} % after."
        )
        advice = "Apply the settings." if self.recommended else "Do not change the settings."
        return f"{text} {advice}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reliability of the result."""
        remarks = [
            "Errors that neighbouring fixes share, such as those of the atmosphere, show neither in "
            "innovations nor in withheld fixes: R is that of the rest, and the position may err by more than "
            "its σ."
        ]
        if self.at_bounds:
            remarks.append(
                f"At a bound: {', '.join(self.at_bounds)}. The innovations ask for values beyond what is "
                "accepted, so that something else is wrong, or the fixes share a part of their errors."
            )
        if self.cure:
            remarks.append(
                f"The advice of the verdict comes first: {self.cure}. The other parameters change only where "
                "their intervals exclude what is then assumed, beyond what chance does to one of them."
            )
        if not self.white:
            remarks.append(
                "The innovations are not white: no values of these parameters explain them. They have "
                "another cause, such as correlated errors of the fixes."
                + ("" if self.chosen_by == "factors" else " The intervals allow for that.")
            )
        if self.inside[1] < INSIDE and self.spread:
            remarks.append(self.spread)
        if self.chosen_by == "outages":
            remarks.append(
                "The values are those that predict fixes across outages best: the likelihood of the next fix "
                "alone leads to a filter that follows correlated errors of the fixes."
            )
        if self.chosen_by == "factors":
            remarks.append(
                "No values of the parameters predict withheld fixes better, but one factor on R and one on "
                "Q do. These factors are a remedy, not a property of the sensors. Each outage is judged "
                "with the factors that the other outages choose."
            )
        if self.outliers:
            remarks.append(
                f"{self.outliers} fixes were omitted as outliers; a gate or a robust update handles them "
                "(navigator.gate, navigator.robust)."
            )
        return tuple(remarks)

    def settings(self, parameters: Collection[str] | None = None) -> dict[str, Any]:
        """Return the settings, for ``experiment.update(identification.settings())``.

        Parameters
        ----------
        parameters
            Names of those that change, out of `applied`; by default, all of them.
        """
        every = parameters is None or set(parameters) == set(self.applied)
        changes = self.changes if every else self.changes_of(parameters or ())
        return {group: dict(values) for group, values in changes.items()}

    def card(self, name: str) -> Card:
        """Return a card of the sensors, with the parameters that the log shows and the assumed noise.

        For a simulated run, too, these are the identified parameters, not the simulated ones.

        Parameters
        ----------
        name
            Name of the card.
        """
        groups: dict[str, dict[str, Datum]] = {}
        where = f"Innovations of {self.mission}: {self.fixes} fixes, maximum likelihood"
        suite = SensorSuite().groups()
        for group, terms in self.changes.get("sensors", {}).items():
            for term, value in terms.items():
                unit = suite[group].param[term].unit
                density = TWO_SIDED if term == DENSITY else ""
                numbers = np.atleast_1d(np.asarray(value, dtype=np.float64))
                if term == "vibration_density":
                    continue
                datum = Datum(tuple(float(f"{number:.4g}") for number in numbers), unit, where, density)
                groups.setdefault(group, {})[term] = datum
        return Card(
            name=name,
            maker="",
            grade="own",
            note="Identified in this vehicle, its vibration included.",
            terms=groups,
        )

    def __repr__(self) -> str:
        table = self.table.to_string(index=False, float_format=lambda value: f"{value:.4g}")
        return "\n".join((f"Identification of {self.mission}:", table, self.sentence, *self.remarks))
