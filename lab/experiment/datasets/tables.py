"""Tables: the errors of a run, also in their σ, and the whiteness of its innovations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from lab.analysis import consistency
from lab.base.arrays import FloatArray
from lab.experiment.datasets import flight
from lab.experiment.datasets.innovations import normalised
from lab.experiment.datasets.labelled import COORDINATES
from lab.run.run import Run

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def summary(run: Run) -> pd.DataFrame:
    """Return the table of the errors; see `Result.summary`."""
    import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

    columns, rows = summary_rows(run)
    return pd.DataFrame(rows, columns=columns)


def summary_rows(run: Run) -> tuple[tuple[str, ...], list[tuple[str | float, ...]]]:
    """Return the names of the columns of `summary`, and its rows."""
    moments = run.recorded is not None
    rows: list[tuple[str | float, ...]] = []
    for name, unit, column in _columns(run):
        known = column[np.isfinite(column)] if moments else column
        if not known.size:
            continue
        about = [known.mean(), known.std()] if moments else []
        size = np.abs(known, out=known)  # in place: in four hours, a vector takes 23 MB
        # Not `size @ size`: threads of BLAS for one sum take ten times as long.
        rms = np.sqrt(np.einsum("i,i->", size, size) / size.size)
        figures = [rms, size.max(), np.quantile(size, 0.95, overwrite_input=True)]
        rows.append((name, unit, *map(float, figures + about)))
    return ("quantity", "unit", "rms", "max", "95 %", *(("mean", "std") if moments else ())), rows


def _columns(run: Run) -> Iterator[tuple[str, str, FloatArray]]:
    """Iterate over all components of the errors: name, unit and values (n + 1,), which may be overwritten.

    Those of a long flight are computed one after the other: all together take ten times the memory.
    """
    for name, (dim, unit) in flight.ERRORS.items():
        errors = None if run.is_long else flight.error_of(run, name)
        for number, component in enumerate(COORDINATES[dim]):
            values = flight.error_component(run, name, number) if errors is None else errors[:, number].copy()
            yield f"{name} {component}", unit, values


def coverage(parts: Iterable[tuple[xr.Dataset, xr.Dataset]], samples: int) -> pd.DataFrame:
    """Return the table of the errors in their σ; see `Result.coverage`.

    Parameters
    ----------
    parts
        Errors and their σ, of one part of the flight after the other.
    samples
        Number of samples of all parts together.
    """
    import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

    means = np.zeros((len(flight.ERRORS), 3, 3))
    for errors, sigma in parts:
        share = errors.sizes["time"] / samples
        for number, name in enumerate(flight.ERRORS):
            values, beside = errors[name].values, sigma[name].values
            within = [100 * consistency.coverage(values, beside, factor) for factor in (1, 3)]
            means[number] += share * np.stack([np.mean(values / beside, axis=0), *within])
    rows = []
    for mean, (name, (dim, _)) in zip(means, flight.ERRORS.items(), strict=True):
        for component, figures in zip(COORDINATES[dim], mean.T, strict=True):
            rows.append((f"{name} {component}", *map(float, figures)))
    return pd.DataFrame(rows, columns=["quantity", "mean [σ]", "within ±1σ [%]", "within ±3σ [%]"])


def whiteness(found: xr.Dataset) -> pd.DataFrame:
    """Return the table of the innovations in their σ; see `Result.whiteness`; `found` are the innovations."""
    values = normalised(found)
    known = np.isfinite(values)
    count, values = np.maximum(known.sum(axis=0), 1), np.nan_to_num(values)
    table = consistency.whiteness_table(
        values.sum(axis=0) / count,
        np.sum(values**2, axis=0) / count,
        consistency.autocorrelation(values),
        len(values),
    )
    # A real receiver may leave out a channel.
    return table[known.any(axis=0)].reset_index(drop=True) if known.any() else table
