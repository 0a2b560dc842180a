"""Run comparison: the figures of some runs as a table, a row each, with the best of each column in bold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lab.analysis.errors import outage_ends
from lab.base.arrays import FloatArray
from lab.experiment.datasets.flight import error_component
from lab.views.ensemble_cards import SIGNS, scroll_box

if TYPE_CHECKING:
    import pandas as pd

    from lab.analysis.verdicts.verdict import Verdict
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result


@dataclass(frozen=True)
class Column:
    """A figure that runs have.

    Attributes
    ----------
    name, unit
        What it is.
    best
        The best value: 0 for errors, 1 for ratios; None if none is.
    """

    name: str
    unit: str
    best: float | None = 0.0

    @property
    def heading(self) -> str:
        """Its name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


COLUMNS = (
    Column("Horizontal, rms", "m"),
    Column("Horizontal, 95 %", "m"),
    Column("Horizontal, end of outages", "m"),
    Column("Height, rms", "m"),
    Column("Velocity, rms", "m/s"),
    Column("Roll and pitch, rms", "°"),
    Column("Heading, rms", "°"),
    Column("Inside ±3σ", "%", None),
    Column("NEES per state", "", 1.0),
    Column("NIS per measured value", "", 1.0),
)
"""The columns of the table, in order."""
(
    RMS_POSITION,
    MOST_POSITION,
    OUTAGE_END,
    RMS_HEIGHT,
    RMS_VELOCITY,
    RMS_LEVEL,
    RMS_HEADING,
    INSIDE,
    NEES,
    NIS,
) = COLUMNS
UNKNOWN = "It is unknown."
NO_OUTAGE = "There is no GPS outage."


@dataclass(frozen=True)
class Assessment:
    """What is known of a run, or of many runs of one experiment.

    Attributes
    ----------
    values : mapping of Column to float
        The figures; what is unknown is missing.
    spread : mapping of Column to float
        Of many runs, the standard deviation of a figure from run to run.
    verdict : str
        The verdict, or why there is no run.
    consistent : bool or None
        Whether the filter is consistent; None if that is unknown.
    why_unknown : str
        Why errors are unknown; empty if they are known.
    remark : str
        A word beside the name, such as how many runs are done.
    """

    values: Mapping[Column, float] = field(default_factory=dict)
    spread: Mapping[Column, float] = field(default_factory=dict)
    verdict: str = ""
    consistent: bool | None = None
    why_unknown: str = ""
    remark: str = ""


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes
    ----------
    name, group
        Its name, and the heading that it stands under.
    found
        What is known; None for nothing yet.
    is_many
        Whether it is about many runs.
    differs
        In which settings it differs from the run to which errors are compared.
    """

    name: str
    group: str = ""
    found: Assessment | None = None
    is_many: bool = False
    differs: str = ""


def assess(result: Result) -> Assessment:
    """Return the figures of a run: errors, their share inside ±3σ, mean NEES and NIS over their numbers."""
    values = {
        NEES: mean_over_degrees(result, "consistency", "nees"),
        NIS: mean_over_degrees(result, "innovations", "nis"),
    }
    why = result.missing_reason("errors")
    if not why:
        values |= _errors(result)
    if not result.missing_reason("coverage"):
        values[INSIDE] = float(result.coverage["within ±3σ [%]"].mean())
    return Assessment(_known_values(values), {}, *_in_words(result.verdict), why)


def _errors(result: Result) -> dict[Column, float]:
    """Return the figures of the errors; those of a long flight are computed one component at a time."""

    def of(name: str, component: int) -> FloatArray:
        if result.is_long:
            return error_component(result, name, component)
        found: FloatArray = result.errors[name].values[:, component]
        return found

    east_north = [of("position", axis) for axis in (0, 1)]
    horizontal = np.hypot(*east_north)
    ends = outage_ends(result.time, result.experiment.sensors.gps.outages, result.epoch)
    velocity, level = (
        _root_sum([_rms(of(name, axis)) for axis in axes])
        for name, axes in (("velocity", (0, 1, 2)), ("attitude", (0, 1)))
    )
    return {
        RMS_POSITION: _rms(horizontal),
        MOST_POSITION: _known_quantile(horizontal),
        OUTAGE_END: _rms(horizontal[ends]),
        RMS_HEIGHT: _rms(of("position", 2)),
        RMS_VELOCITY: velocity,
        RMS_LEVEL: level,
        RMS_HEADING: _rms(of("attitude", 2)),
    }


def assess_seeds(runs: Ensemble, wanted: int) -> Assessment:
    """Return the means of the figures of many runs, and their standard deviations from run to run.

    Parameters
    ----------
    runs
        The runs that are done.
    wanted
        Number of runs that are wanted.
    """
    rms = runs.rms
    each = {
        RMS_POSITION: np.hypot(rms[:, 0], rms[:, 1]),
        MOST_POSITION: runs.most,
        OUTAGE_END: runs.horizontal_at_outage_ends,
        RMS_HEIGHT: rms[:, 2],
        RMS_VELOCITY: np.linalg.norm(rms[:, 3:6], axis=1),
        RMS_LEVEL: np.hypot(rms[:, 6], rms[:, 7]),
        RMS_HEADING: rms[:, 8],
        NEES: runs.mean_nees / (runs.degrees or np.nan),
        NIS: runs.mean_nis / (runs.nis_degrees or np.nan),
    }
    many = len(runs.seeds) > 1
    values = {column: float(figures.mean()) for column, figures in each.items()}
    values[INSIDE] = float(runs.coverage["within ±3σ [%]"].mean())
    done = len(runs.seeds) + len(runs.diverged)
    remark = f"{done} of {wanted} seeds" if done < wanted else ""
    lost = f"{len(runs.diverged)} diverged" if runs.diverged else ""
    return Assessment(
        _known_values(values),
        {column: float(figures.std(ddof=1)) for column, figures in each.items()} if many else {},
        *_in_words(runs.verdict),
        remark=", ".join(filter(None, (remark, lost))),
    )


def _in_words(verdict: Verdict) -> tuple[str, bool | None]:
    return verdict.headline, verdict.consistent


def _known_values(values: Mapping[Column, float]) -> dict[Column, float]:
    return {column: value for column, value in values.items() if np.isfinite(value)}


def _rms(values: FloatArray) -> float:
    """Return the root mean square of what is known: a reference need not have all quantities, or times."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _root_sum(values: Sequence[float]) -> float:
    """Return the length of a vector whose components have these lengths."""
    return float(np.sqrt(np.sum(np.square(values))))


def _known_quantile(values: FloatArray) -> float:
    """Return the 95 % quantile of what is known."""
    known = values[np.isfinite(values)]
    return float(np.quantile(known, 0.95)) if known.size else float("nan")


def mean_over_degrees(result: Result, group: str, name: str) -> float:
    """Return the mean of NEES or NIS over its degrees of freedom; NaN if it is unknown."""
    if result.missing_reason(group):
        return float("nan")
    values = getattr(result, group)[name]
    known = values.values[np.isfinite(values.values)]
    degrees = values.attrs["degrees"]
    return float(known.mean() / degrees) if known.size and degrees else float("nan")


def comparison_frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Return rows as a table, for a file: figures, of many runs their standard deviations, and verdicts."""
    import pandas as pd  # noqa: PLC0415 - takes half a second

    found = [row.found or Assessment() for row in rows]
    table: dict[str, list[object]] = {"Of": [row.group for row in rows]}
    for column in _known_columns(rows):
        table[column.heading] = [one.values.get(column, np.nan) for one in found]
        if any(column in one.spread for one in found):
            spread = replace(column, name=f"{column.name}, standard deviation")
            table[spread.heading] = [one.spread.get(column, np.nan) for one in found]
    table["Verdict"] = [one.verdict for one in found]
    return pd.DataFrame(table, index=pd.Index([row.name for row in rows], name="Run"))


def _known_columns(rows: Sequence[Row]) -> list[Column]:
    """Return the figures that any row has."""
    return [
        column
        for column in COLUMNS
        if any(row.found is not None and column in row.found.values for row in rows)
    ]


def comparison_html(rows: Sequence[Row], baseline: str = "") -> str:
    """Return rows as an HTML table, with the best of each column in bold.

    Parameters
    ----------
    rows
        The rows.
    baseline
        Name of the row to which errors are compared in percent; by default the first.
    """
    columns = _known_columns(rows)
    heads = "".join(f"<th>{escape(column.heading)}</th>" for column in columns)
    body, group = [], ""
    for row in rows:
        if row.group and row.group != group:
            body.append(f'<tr class="group"><th colspan="{len(columns) + 2}">{escape(row.group)}</th></tr>')
        group = row.group
        # Means over seeds are compared to each other: one run differs from them by chance.
        peers = [one for one in rows if one.is_many == row.is_many]
        against = next((one for one in peers if one.name == baseline), peers[0])
        best = {
            column: _best_value([one.found for one in peers if one.found is not None], column)
            for column in columns
        }
        cells = _cells(row.found, against.found, best)
        remark = row.found.remark if row.found is not None else ""
        words = filter(None, (remark, row.differs))
        note = "".join(f' <span class="change">{escape(one)}</span>' for one in words)
        body.append(f"<tr><td>{escape(row.name)}{note}</td>{cells}</tr>")
    reasons = {row.found.why_unknown: row.name for row in reversed(rows) if row.found is not None}
    notes = "".join(
        f"<p>{escape(name)}: {escape(reason)}</p>" for reason, name in reversed(reasons.items()) if reason
    )
    table = f'<table><tr><th></th>{heads}<th class="words">Verdict</th></tr>{"".join(body)}</table>'
    return f"{scroll_box(table, 'Comparison')}{notes}"


def _cells(
    found: Assessment | None,
    against: Assessment | None,
    best: Mapping[Column, str],
) -> str:
    """Return the cells of a row behind its name."""
    if found is None or not found.values:
        words = "computing …" if found is None else found.verdict
        return f'<td class="words" colspan="{len(best) + 1}">{escape(words)}</td>'
    cells = []
    for column, text_of_best in best.items():
        if column not in found.values:
            why = found.why_unknown or (NO_OUTAGE if column is OUTAGE_END else UNKNOWN)
            cells.append(f'<td title="{escape(why)}">–</td>')
            continue
        value, spread = found.values[column], found.spread.get(column, 0.0)
        text = f"{value:.3g}"
        if text == text_of_best:
            text = f"<b>{text}</b>"
        if spread:
            text += f' <span class="change">±\u2009{spread:.2g}</span>'
        first = 0.0 if against is None else against.values.get(column, 0.0)
        if found is not against and column.best == 0.0 and first > 0:
            change = f"{100 * (value / first - 1):+.0f}".replace("-", "\u2212")
            change = "0" if change[1:] == "0" else change
            text += f'<br><span class="change">{change}\u2009%</span>'
        cells.append(f"<td>{text}</td>")
    colour, sign = SIGNS[found.consistent]
    words = found.verdict.partition(":")[0] if found.consistent else found.verdict
    mark = f'<span style="color:{colour}">{sign}</span>'
    return f'{"".join(cells)}<td class="words" title="{escape(found.verdict)}">{mark} {escape(words)}</td>'


def _best_value(found: Sequence[Assessment], column: Column) -> str:
    """Return the best value of a column as it is written; empty if all are written alike, or none is best."""
    values = [one.values[column] for one in found if column in one.values]
    texts = {f"{value:.3g}": value for value in values}
    if column.best is None or len(texts) < 2:
        return ""
    # A ratio is as good as the factor by which it is off is small.
    is_ratio = column.best == 1.0
    return min(texts, key=lambda text: abs(np.log(max(texts[text], 1e-9))) if is_ratio else abs(texts[text]))
