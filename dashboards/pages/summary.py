"""Summary: the errors of the whole flight as a table."""

from __future__ import annotations

from collections.abc import Hashable
from html import escape
from typing import Any

from dashboards.seen_names import as_seen
from lab.experiment.result import Result

TABLE_STYLE = """
:host { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.5 Roboto, sans-serif; min-width: min(560px, 100%); }
th { text-align: right; font-weight: 500; opacity: .7; padding: 6px 14px;
     border-bottom: 2px solid rgba(128,128,128,.35); }
td { text-align: right; padding: 6px 14px; border-bottom: 1px solid rgba(128,128,128,.18);
     font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; padding-left: 4px; }
td.unit, th.unit, td.words, th.words { text-align: left; opacity: .7; }
td.words { min-width: 260px; }
th, td:not(.words) { white-space: nowrap; }
tr.group td { border-top: 2px solid rgba(128,128,128,.25); }
@media (max-width: 600px) { table { font-size: 13px; } th, td { padding: 6px 5px; } }
p { opacity: .75; margin: 0 0 12px; }
ul { font: 14px/1.5 Roboto, sans-serif; max-width: 900px; margin: 14px 0; padding-left: 20px; opacity: .85; }
"""


def summary_html(result: Result) -> str:
    """Return the summary of a result as an HTML table; for a log, with repairs and assumptions."""
    if result.recorded:
        return log_html(result)
    table = result.summary
    statistics = [name for name in table.columns if name not in {"quantity", "unit"}]
    head = "".join(f"<th>{escape(name)}</th>" for name in statistics)
    rows = [_row(number, row, statistics) for number, row in enumerate(table.to_dict("records"))]
    mission = escape(result.mission.title or result.mission.name)
    return (
        f"<p>{mission}, {result.time[-1]:.0f} s, seed {result.experiment.seed}; error = estimate − truth</p>"
        f'<table><tr><th></th><th class="unit">unit</th>{head}</tr>{"".join(rows)}</table>'
    )


def log_html(result: Result) -> str:
    """Return the summary of a sensor log as HTML.

    Errors against the reference, or the innovations if there is none, with repairs and assumptions.
    """
    mission = escape(result.mission.title or result.mission.name)
    remarks = "".join(f"<li>{escape(as_seen(remark))}</li>" for remark in result.remarks)
    if result.missing_reason("summary"):
        table, words = result.whiteness, "innovations in their σ (navigator − fix)"
        names = [name for name in table.columns if name != "innovation"]
        rows = [
            f"<tr><td>{escape(str(row['innovation']))}</td>"
            f"{''.join(f'<td>{row[name]:.3g}</td>' for name in names)}</tr>"
            for row in table.to_dict("records")
        ]
        head = "".join(f"<th>{escape(name)}</th>" for name in names)
    else:
        table, words = result.summary, "error = estimate − reference"
        names = [name for name in table.columns if name not in {"quantity", "unit"}]
        rows = [_row(number, row, names) for number, row in enumerate(table.to_dict("records"))]
        head = '<th class="unit">unit</th>' + "".join(f"<th>{escape(name)}</th>" for name in names)
    span = f"{result.time[0]:.0f} to {result.time[-1]:.0f} s"
    return (
        f"<p>{mission}, sensor log, {span}; {words}</p>"
        f"<table><tr><th></th>{head}</tr>{''.join(rows)}</table><ul>{remarks}</ul>"
    )


def _row(number: int, row: dict[Hashable, Any], statistics: list[str]) -> str:
    group = ' class="group"' if number and number % 3 == 0 else ""
    name, unit = escape(row["quantity"]), escape(row["unit"])
    cells = "".join(f"<td>{row[statistic]:.3f}</td>" for statistic in statistics)
    return f'<tr{group}><td>{name} error</td><td class="unit">{unit}</td>{cells}</tr>'
