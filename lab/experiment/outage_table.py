"""Outage table: which error outages of GPS leave, with its own interval, sensor by sensor.

It is made by `lab.experiment.ensembles.outages`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.quantile import CONFIDENCE, QuantileInterval, quantile_interval
from lab.base.arrays import FloatArray
from lab.base.notebook_card import NotebookCard
from lab.base.plain_data import to_plain_data

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SCHEMA, VERSION = "ins-lab outages", 1
"""Name and number of the form for JSON."""
MOST = 0.95
"""Part of the outages whose errors a figure of the table bounds."""
HALF = 0.5
"""Part of them that the CEP, the circular error probable, bounds."""
NO_GAIN = 1.02
"""Ratio of two errors below which tuning is not worth a word: `identify` promises no more."""
_RADII, _ANGLES = 400, 8
"""Nodes of the normal distribution in the plane: quantiles of the radius, and angles of a quarter."""


class OutageErrors(NamedTuple):
    """Errors of n runs with an outage each, or of n outages of a log, at k times since its begin.

    Attributes
    ----------
    seeds : (n,) array
        Seeds of the runs; for a log, the number of the set of outages.
    begins : (n,) array
        Begins of the outages [s].
    horizontal, vertical : (n, k) arrays
        Sizes of the errors [m]; infinite if the filter diverged, NaN where a log has no fix to compare with.
    sigma : (n, k) array
        The filter's own σ of the horizontal position, √(σ_N² + σ_E²) [m]; for a log, that of the difference
        from the fix.
    covariance : (n, 3) array
        Variances north and east, and their covariance, at the end, according to the filter [m²]; likewise.
    """

    seeds: NDArray[np.int64]
    begins: FloatArray
    horizontal: FloatArray
    vertical: FloatArray
    sigma: FloatArray
    covariance: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[OutageErrors]) -> OutageErrors:
        """Return the errors of several sets of runs together."""
        return cls(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


class Perfect(NamedTuple):
    """What the same sensors leave with a filter that is matched to them.

    Attributes
    ----------
    most
        Horizontal error that 95 % of the outages do not exceed [m].
    basis
        Where this is from: ``"covariance"``, the linear covariance of that filter, which agrees with its
        runs; ``"ensemble"``, its runs; or ``"itself"``: the filter of the row is matched.
    """

    most: float
    basis: str


@dataclass(frozen=True, eq=False)
class OutageRow:
    """One filter with its sensors.

    Attributes
    ----------
    name : str
        Name of the card.
    grade : str
        Its grade; empty for the settings as they are.
    errors : OutageErrors or None
        Errors of its runs; None if it does not run.
    perfect : Perfect or None
        What a matched filter leaves; None while that is not computed, and for a log.
    refusal : str
        Why it does not run; empty if it does.
    """

    name: str
    grade: str
    errors: OutageErrors | None
    perfect: Perfect | None = None
    refusal: str = ""

    @cached_property
    def cep(self) -> QuantileInterval:
        """Horizontal error at the end that half of the outages do not exceed [m], with its 95 % interval."""
        return quantile_interval(self._at_end("horizontal"), HALF)

    @cached_property
    def most(self) -> QuantileInterval:
        """Horizontal error at the end that 95 % of them do not exceed [m], with its 95 % interval."""
        return quantile_interval(self._at_end("horizontal"), MOST)

    @cached_property
    def vertical(self) -> QuantileInterval:
        """Size of the vertical error at the end that 95 % of them do not exceed [m], with its interval."""
        return quantile_interval(self._at_end("vertical"), MOST)

    @cached_property
    def believed(self) -> float:
        """Horizontal error that 95 % do not exceed according to the filter's own covariance [m]."""
        return float("nan") if self.errors is None else believed_radius(self.errors.covariance, MOST)

    @property
    def runs(self) -> int:
        """Number of outages with a known error at the end."""
        return self._at_end("horizontal").size

    @property
    def honesty(self) -> str:
        """Whether the filter knows its errors: ``"yes"`` if what it believes is in the interval of `most`."""
        if not np.isfinite(self.believed) or not self.runs:
            return "unknown"
        if not np.isfinite(self.most.value):
            return "diverges"
        if self.believed > self.most.value and not np.isfinite(self.most.high):
            return "too few runs"
        if self.most.low <= self.believed <= self.most.high:
            return "yes"
        ratio = self.most.value / self.believed
        return f"errors {ratio:.2g} × larger" if ratio > 1 else f"errors {1 / ratio:.2g} × smaller"

    def decision(self, wish: float | None) -> str:
        """Return whether 95 % of the outages stay within a wish [m]: pass, fail or undecided."""
        if wish is None or not self.runs:
            return ""
        if self.most.high <= wish:
            return "pass"
        return "fail" if self.most.low > wish else "undecided"

    def is_border(self, wish: float, confidence: float) -> bool:
        """Return whether a wish [m] is inside the interval of the 95 % with another confidence."""
        interval = quantile_interval(self._at_end("horizontal"), MOST, confidence)
        return interval.low <= wish < interval.high

    def curve(self, part: float = MOST) -> FloatArray:
        """Return the horizontal error that a part of the outages does not exceed, with interval (k, 3)."""
        if self.errors is None:
            return np.zeros((0, 3))
        columns = (one[~np.isnan(one)] for one in self.errors.horizontal.T)
        return np.array([quantile_interval(one, part) for one in columns])

    def _at_end(self, name: str) -> FloatArray:
        if self.errors is None:
            return np.zeros(0)
        values: FloatArray = getattr(self.errors, name)[:, -1]
        return values[~np.isnan(values)]


@dataclass(frozen=True, eq=False, repr=False)
class OutageTable(NotebookCard):
    """What outages of GPS leave, a row for each sensor.

    Attributes
    ----------
    mission : str
        The mission.
    seconds : float
        Length of the outages [s].
    wish : float or None
        Horizontal error that 95 % of the outages shall not exceed [m].
    since : (k,) array
        Times since the begin of an outage at which errors are known; the last is its end [s].
    rows : tuple of OutageRow
        The rows, in the order in which they were asked for.
    fix_sigma : float
        σ of the withheld fixes with which a log's errors are compared, √(σ_N² + σ_E²) [m]; zero for a
        simulated mission, whose truth is known.
    ended : str
        What ended the work before all runs were done, such as a cluster that was lost; empty if nothing did.
    """

    CARD: ClassVar[str] = "outages"

    mission: str
    seconds: float
    wish: float | None
    since: FloatArray
    rows: tuple[OutageRow, ...]
    fix_sigma: float = 0.0
    ended: str = ""

    @property
    def is_log(self) -> bool:
        """Whether the errors are differences from withheld fixes of a log."""
        return self.fix_sigma > 0

    @property
    def tuning(self) -> str:
        """One sentence: whether tuning or the sensors limit the errors."""
        known = [row for row in self.rows if row.runs]
        if not known:
            return ""
        if self.is_log:
            return _tuning_of_log(known[0])
        compared = [(row, row.perfect) for row in known if row.perfect is not None]
        if not compared:
            return ""
        gains = [(row.most.value / perfect.most, row, perfect) for row, perfect in compared]
        gain, row, perfect = max(gains, key=lambda one: one[0])
        several = f"{row.name}: " if len(compared) > 1 else ""
        if all(one.basis == "itself" for _, one in compared):
            who = "Each filter is" if len(compared) > 1 else "The filter is"
            worst = "" if len(compared) > 1 else f"{_metres(row.most.value)} (95 %). "
            return f"{worst}{who} matched to its sensors: better tuning gains nothing, better sensors do."
        figures = (
            f"{several}{_metres(perfect.most)} (95 %) with a perfect filter, "
            f"{_metres(row.most.value)} with yours"
        )
        basis = "its linear covariance" if perfect.basis == "covariance" else "an ensemble of it"
        said = f"better tuning can gain up to a factor {gain:.2g}"
        if gain < NO_GAIN or row.most.low <= perfect.most:
            said = f"tuning gains nothing beyond the chance of {row.runs} runs"
        return f"{figures}: {said}. The perfect filter's figure is from {basis}."

    def to_frame(self) -> pd.DataFrame:
        """Return the table of the figures, a row for each sensor."""
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        return pd.DataFrame([self.figures(row) for row in self.rows])

    def figures(self, row: OutageRow) -> dict[str, Any]:
        """Return the figures of a row by name; what is unknown is NaN."""
        found: dict[str, Any] = {
            "card": row.name,
            "grade": row.grade,
            "runs": row.runs,
            "cep_m": row.cep.value,
            "horizontal_95_m": row.most.value,
            "from_m": row.most.low,
            "to_m": row.most.high,
            "vertical_95_m": row.vertical.value,
            "filter_95_m": row.believed,
            "honest": row.honesty,
            "result": row.decision(self.wish),
        }
        if row.perfect is not None:
            found |= {"perfect_95_m": row.perfect.most, "perfect_from": row.perfect.basis}
        return found | ({"refusal": row.refusal} if row.refusal else {})

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, which JSON can hold; ends of intervals may be None."""
        found: dict[str, Any] = to_plain_data(
            {
                "schema": SCHEMA,
                "schema_version": VERSION,
                "mission": self.mission,
                "seconds": self.seconds,
                "wish_m": self.wish,
                "fix_sigma_m": self.fix_sigma if self.is_log else None,
                "rows": [self.figures(row) for row in self.rows],
                "tuning": self.tuning,
                "remarks": self.remarks,
            }
        )
        return found

    def cells(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return the titles of the columns, and the texts of each row: what a table shows to a person."""
        titles = ("card", "grade", "runs", "CEP [m]", "95 % [m]", "its interval", "vertical 95 % [m]")
        titles += (
            "filter's 95 % [m]",
            "honest",
            *(() if self.wish is None else (f"within {self.wish:g} m",)),
        )
        return titles, [self._row_cells(row, len(titles)) for row in self.rows]

    def _row_cells(self, row: OutageRow, width: int) -> tuple[str, ...]:
        if not row.runs:
            missing = f"Does not run: {row.refusal}" if row.refusal else "…"
            return (row.name, row.grade, *("–",) * (width - 3), missing)
        high = digits(row.most.high) if np.isfinite(row.most.high) else "?"
        figures = (
            digits(row.cep.value),
            digits(row.most.value),
            f"{digits(row.most.low)} to {high}",
            digits(row.vertical.value),
            digits(row.believed),
            row.honesty,
        )
        wished = () if self.wish is None else (row.decision(self.wish),)
        return (row.name, row.grade, str(row.runs), *figures, *wished)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the table must know besides."""
        found = [self.ended] if self.ended else []
        if self.is_log:
            found.append(
                "The errors are differences from withheld fixes, whose own σ is "
                f"{digits(self.fix_sigma)} m (horizontal), as the filter assumes it."
            )
        few = [row for row in self.rows if row.runs and not np.isfinite(row.most.high)]
        if any(np.isfinite(row.most.value) for row in few):
            found.append(
                f"A question mark: too few runs for an upper end. {fewest_values(MOST)} give one; "
                "without it, no "
                "sensor passes."
            )
        if any(np.isinf(row.most.value) for row in self.rows):
            found.append("Runs that diverge have infinite errors.")
        return tuple(found)

    @cached_property
    def dataset(self) -> xr.Dataset:
        """Errors of all runs over the time since the begin, and the curves of the 95 % with their interval.

        Dimensions: ``card``, ``run``, ``since``. Rows with fewer runs than others end with NaN.
        """
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        known = [row for row in self.rows if row.errors is not None]
        most = max((len(row.errors.seeds) for row in known if row.errors), default=0)

        def filled(name: str) -> FloatArray:
            return np.array([_fill_rows(getattr(row.errors, name), most) for row in known])

        each, run = ("card", "run", "since"), ("card", "run")
        curves = np.array([row.curve() for row in known]).reshape(len(known), self.since.size, 3)
        metres = {"units": "m"}
        variables: dict[str, Any] = {
            "horizontal": (each, filled("horizontal"), {"long_name": "horizontal error", **metres}),
            "vertical": (each, filled("vertical"), {"long_name": "vertical error", **metres}),
            "sigma": (each, filled("sigma"), {"long_name": "horizontal σ of the filter", **metres}),
            "begin": (run, filled("begins"), {"long_name": "begin of the outage", "units": "s"}),
            "seed": (run, filled("seeds"), {"long_name": "seed"}),
        }
        for at, (name, words) in enumerate(
            (("", "of the outages within"), ("_low", "low end"), ("_high", "high end"))
        ):
            about = {"long_name": f"95 %, {words}", **metres}
            variables[f"horizontal_95{name}"] = (("card", "since"), curves[..., at], about)
        coords = {
            "card": [row.name for row in known],
            "since": ("since", self.since, {"long_name": "time since the begin", "units": "s"}),
        }
        return xr.Dataset(variables, coords, {"mission": self.mission, "seconds": self.seconds})

    def __repr__(self) -> str:
        frame = self.to_frame().to_string(index=False, float_format=lambda value: f"{value:.3g}")
        return f"Outages of {self.seconds:g} s, {self.mission}\n{frame}\n{self.tuning}"


def digits(value: float) -> str:
    """Return a number with three digits; what is infinite or unknown as a word."""
    if np.isnan(value):
        return "unknown"
    return "∞" if np.isinf(value) else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def fewest_values(part: float) -> int:
    """Return the number of values from which on a quantile has an upper end with a confidence of 95 %."""
    return int(np.ceil(np.log((1 - CONFIDENCE) / 2) / np.log(part)))


def believed_radius(covariance: FloatArray, part: float) -> float:
    """Return the radius that holds a part of plane normal errors with covariances drawn from some.

    Parameters
    ----------
    covariance : (n, 3) array
        Variances along two axes, and their covariance [m²].
    part
        The part.
    """
    known = covariance[np.isfinite(covariance).all(axis=1)]
    if not known.size:
        return float("nan")
    first, second, mixed = known.T
    middle, half = (first + second) / 2, np.hypot((first - second) / 2, mixed)
    angles = (np.arange(_ANGLES) + 0.5) / _ANGLES * np.pi / 2
    ranks = (np.arange(_RADII) + 0.5) / _RADII
    along = np.outer(middle + half, np.cos(angles) ** 2)
    across = np.outer(np.maximum(middle - half, 0), np.sin(angles) ** 2)
    # The square of the radius of two standard normal numbers is exponential.
    squares = (along + across)[..., None] * (-2 * np.log1p(-ranks))
    return float(np.sqrt(np.quantile(squares, part, method="hazen")))


def _tuning_of_log(row: OutageRow) -> str:
    """Return what the outages of a log say about tuning: the true motion and the true noise are unknown."""
    figures = f"{_metres(row.most.value)} (95 %) from the withheld fixes with this filter"
    unknown = "How far a perfect filter would be is unknown for a log; `ins-lab identify` finds better noise."
    believed = f"which itself expects {_metres(row.believed)}"
    if row.honesty.startswith("errors"):
        return f"{figures}, {believed}: its assumptions do not fit. {unknown}"
    return f"{figures}, {believed}. {unknown}"


def _metres(value: float) -> str:
    return f"{digits(value)} m"


def _fill_rows(values: NDArray[Any], rows: int) -> FloatArray:
    """Return values with NaN after their last row."""
    out = np.full((rows, *values.shape[1:]), np.nan)
    out[: len(values)] = values
    return out
