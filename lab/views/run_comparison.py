"""Run comparison: the figures of some runs side by side, as a table, with the best of each in bold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lab.base.arrays import FloatArray

if TYPE_CHECKING:
    from lab.experiment.result import Result


@dataclass(frozen=True)
class Figure:
    """One figure of a run.

    Attributes
    ----------
    name, unit
        What it is.
    value
        Its value; NaN if it is unknown.
    best
        The best value: 0 for errors, 1 for ratios; None if none is.
    """

    name: str
    unit: str
    value: float
    best: float | None = 0.0


def figures_of(result: Result) -> tuple[Figure, ...]:
    """Return the figures of a run: errors, their share inside ±3σ, mean NEES and NIS over their numbers."""
    nan = float("nan")
    if result.missing_reason("errors"):
        position = velocity = attitude = np.full((1, 3), nan)
    else:
        errors = result.errors
        position, velocity, attitude = (errors[name].values for name in ("position", "velocity", "attitude"))
    horizontal = np.hypot(position[:, 0], position[:, 1])
    inside = nan if result.missing_reason("coverage") else float(result.coverage["within ±3σ [%]"].mean())
    return (
        Figure("Horizontal position, rms", "m", _rms(horizontal)),
        Figure("Horizontal position, 95 %", "m", _most(horizontal)),
        Figure("Height, rms", "m", _rms(position[:, 2])),
        Figure("Velocity, rms", "m/s", _rms(np.linalg.norm(velocity, axis=1))),
        Figure("Roll and pitch, rms", "°", _rms(np.hypot(attitude[:, 0], attitude[:, 1]))),
        Figure("Heading, rms", "°", _rms(attitude[:, 2])),
        Figure("Errors inside ±3σ", "%", inside, None),
        Figure("NEES over its number of states", "", _mean_of(result, "consistency", "nees"), 1.0),
        Figure("NIS over its number of measurements", "", _mean_of(result, "innovations", "nis"), 1.0),
    )


def _rms(values: FloatArray) -> float:
    """Return the root mean square of what is known: a reference need not have all quantities, or times."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _most(values: FloatArray) -> float:
    """Return the 95 % quantile of what is known."""
    known = values[np.isfinite(values)]
    return float(np.quantile(known, 0.95)) if known.size else float("nan")


def _mean_of(result: Result, group: str, name: str) -> float:
    """Return the mean of NEES or NIS over its degrees of freedom; NaN if it is unknown."""
    if result.missing_reason(group):
        return float("nan")
    values = getattr(result, group)[name]
    known = values.values[np.isfinite(values.values)]
    degrees = values.attrs["degrees"]
    return float(known.mean() / degrees) if known.size and degrees else float("nan")


def comparison_html(runs: Sequence[tuple[str, Result]]) -> str:
    """Return the figures of named runs as an HTML table; the first run is the one to which they compare."""
    columns = [figures_of(result) for _, result in runs]
    head = "".join(f"<th>{escape(name)}</th>" for name, _ in runs)
    rows = "".join(_row(figures) for figures in zip(*columns, strict=True))
    verdicts = "".join(f'<td class="words">{escape(result.verdict.headline)}</td>' for _, result in runs)
    return (
        f'<table><tr><th></th><th class="unit">unit</th>{head}</tr>{rows}'
        f'<tr class="group"><td>Verdict</td><td class="unit"></td>{verdicts}</tr></table>'
    )


def _row(figures: Sequence[Figure]) -> str:
    """Return a row: the value of each run, and by how much it differs from the first."""
    first, (name, unit, best) = figures[0].value, (figures[0].name, figures[0].unit, figures[0].best)
    off = [np.inf if best is None else _distance(one.value, best) for one in figures]
    least = min(off)
    cells = []
    for number, (figure, distance) in enumerate(zip(figures, off, strict=True)):
        text = "–" if not np.isfinite(figure.value) else f"{figure.value:.3g}"
        if np.isfinite(least) and distance == least and len(figures) > 1:
            text = f"<b>{text}</b>"
        if number and best == 0.0 and np.isfinite(figure.value) and first > 0:
            change = f"{100 * (figure.value / first - 1):+.0f}".replace("-", "\u2212")
            text += f' <span class="change">{change}\u2009%</span>'
        cells.append(f"<td>{text}</td>")
    return f'<tr><td>{escape(name)}</td><td class="unit">{escape(unit)}</td>{"".join(cells)}</tr>'


def _distance(value: float, best: float) -> float:
    """Return how far a value is from the best one: for ratios, by how many times."""
    if not np.isfinite(value):
        return float("inf")
    return abs(np.log(max(value, 1e-9))) if best == 1.0 else abs(value - best)
