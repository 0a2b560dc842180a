"""Sweep card: a sweep in Jupyter: the errors for each combination of values, as a table."""

from __future__ import annotations

from html import escape

import numpy as np

from lab.experiment.sweep import Sweep
from lab.views.mission_card import title_of
from lab.views.sweep_plot import BAND, DEFAULT, Panel, labelled, panel, tests

ROWS = 30
"""Largest number of combinations in the table; the dataset has all."""
_LEFT = 'style="text-align:left"'


def sweep_html(sweep: Sweep) -> str:
    """Return a sweep as HTML."""
    data, dims = sweep.dataset, sweep.dims
    panels = [panel(data, name) for name in DEFAULT]
    panels += tests(data)
    heads = [labelled(data[dim].attrs["long_name"], data[dim].attrs["units"]) for dim in dims]
    heads += [labelled(one.title, one.unit) for one in panels]
    sizes = [data.sizes[dim] for dim in dims]
    rows = []
    for at in list(np.ndindex(*sizes))[:ROWS]:
        place = dict(zip(dims, at, strict=True))
        cells = [str(data[dim].values[index]) for dim, index in place.items()]
        rows.append((*cells, *(cell(one, place) for one in panels)))
    head = "".join(f"<th {_LEFT}>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td {_LEFT}>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
    more = f"<p>The first {ROWS} of {np.prod(sizes)} combinations.</p>" if np.prod(sizes) > ROWS else ""
    refused = "".join(f"<li>{escape(reason)}</li>" for reason in sweep.refused)
    return (
        f"<h4>{escape(title_of(sweep.mission))}, {np.prod(sizes):.0f} combinations of values, "
        f"{data.sizes['seed']} seeds each</h4>"
        f'<div style="overflow-x:auto"><table><tr>{head}</tr>{body}</table></div>{more}'
        "<p>The value over all seeds; in brackets, 90 % of the runs are between these.</p>"
        f"{f'<ul>{refused}</ul>' if refused else ''}"
    )


def cell(one: Panel, place: dict[str, int]) -> str:
    """Return the value of a panel over the seeds, with the band of the runs."""
    runs = one.runs.isel(place)
    if not np.isfinite(runs).any():
        return "unknown"
    middle = np.sqrt((runs**2).mean()) if one.unit else runs.mean()
    low, high = (float(runs.quantile(edge)) for edge in BAND)
    return f"{float(middle):.3g} ({low:.3g} to {high:.3g})"
