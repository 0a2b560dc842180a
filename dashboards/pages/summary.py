"""Summary: the errors of the whole flight as a table."""

from __future__ import annotations

from collections.abc import Hashable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashboards.seen_names import as_seen
from lab.experiment.result import Result
from lab.views.ensemble_cards import scroll_box

if TYPE_CHECKING:
    import pandas as pd

TABLE_STYLE = Path(__file__).with_name("summary.css").read_text("utf-8")


def summary_html(result: Result) -> str:
    """Return the summary of a result as an HTML table.

    A sensor log has its repairs and assumptions below it, and without a reference its innovations.
    """
    known = not result.missing_reason("summary")
    table = result.summary if known else result.whiteness
    names = [name for name in table.columns if name not in {"quantity", "unit", "innovation"}]
    rows = [_row(number, row, names) for number, row in enumerate(table.to_dict("records"))]
    unit = '<th class="unit">unit</th>' if known else ""
    head = unit + "".join(f"<th>{escape(name)}</th>" for name in names)
    what = f"{result.time[-1]:.0f} s, seed {result.experiment.seed}"
    if result.recorded:
        what = f"sensor log, {result.time[0]:.0f} to {result.time[-1]:.0f} s"
    words = f"error = estimate − {result.truth_word}" if known else "innovations in their σ (navigator − fix)"
    remarks = "".join(f"<li>{escape(as_seen(remark))}</li>" for remark in result.remarks)
    below = f"<ul>{remarks}</ul>" if result.recorded else ""
    shown = f"<table><tr><th></th>{head}</tr>{''.join(rows)}</table>"
    return (
        f"<p>{escape(result.mission.title or result.mission.name)}, {what}; {words}</p>"
        f"{scroll_box(shown, 'Summary')}{below}"
    )


def summary_table(result: Result) -> pd.DataFrame:
    """Return the summary of a result as a table, for a file; without a reference, that of its innovations."""
    table = result.whiteness if result.missing_reason("summary") else result.summary
    return table.set_index(table.columns[0])


def _row(number: int, row: dict[Hashable, Any], names: list[str]) -> str:
    if "innovation" in row:
        cells = "".join(f"<td>{row[name]:.3g}</td>" for name in names)
        return f"<tr><td>{escape(row['innovation'])}</td>{cells}</tr>"
    group = ' class="group"' if number and number % 3 == 0 else ""
    cells = "".join(f"<td>{row[name]:.3f}</td>" for name in names)
    unit = f'<td class="unit">{escape(row["unit"])}</td>'
    return f"<tr{group}><td>{escape(row['quantity'])} error</td>{unit}{cells}</tr>"
