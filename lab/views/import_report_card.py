"""Import report card: the report on an imported flight as HTML, for a notebook and for the page."""

from __future__ import annotations

from html import escape
from itertools import groupby

from lab.data.log.log_section import piece
from lab.data.log.sensor_log import SensorLog
from lab.data.rebuild.import_report import ImportReport

REPORT_STYLE = """
table { border-collapse: collapse; font: 13px/1.5 Roboto, sans-serif; width: 100%; }
th { text-align: left; font-weight: 500; padding: 10px 8px 2px 0;
     border-bottom: 1px solid rgba(128,128,128,.35); }
td { padding: 2px 10px 2px 0; vertical-align: top; overflow-wrap: anywhere; }
td:first-child { opacity: .7; white-space: nowrap; width: 1%; }
"""
"""Style of the tables on a page."""
_LEFT = ' style="text-align: left; vertical-align: top"'
"""Attribute of cells in a notebook, which aligns them to the right by itself."""


def import_report_html(report: ImportReport) -> str:
    """Return a report as HTML: the verdict with its reasons, and the rows."""
    reasons = "".join(f"<li>{escape(sentence)}</li>" for sentence in report.reasons)
    verdict = f"<p>Verdict: <b>{escape(report.verdict)}</b></p><ul>{reasons}</ul>"
    return verdict + rows_html(report, _LEFT)


def rows_html(report: ImportReport, attribute: str = "") -> str:
    """Return the rows of a report as an HTML table in groups, whose cells have an attribute."""
    parts = []
    for group, rows in groupby(report.rows, key=lambda row: row.group):
        parts.append(f'<tr><th colspan="2"{attribute}>{escape(group)}</th></tr>')
        # The note about the command line's --unit is omitted.
        kept = (row for row in rows if row.name or group != "Units")
        parts += [
            f"<tr><td{attribute}>{escape(row.name)}</td><td{attribute}>{escape(row.value)}</td></tr>"
            for row in kept
        ]
    return f"<table>{''.join(parts)}</table>"


def read_log_html(log: SensorLog | None, refused: str) -> str:
    """Return how the IMU and GPS data of a file were read as a log, or why they were not; else nothing."""
    if log is None and not refused:
        return ""
    rows = [refused] if log is None else piece(log).repairs
    cells = "".join(
        f'<tr><td style="white-space: normal; opacity: 1">{escape(row)}</td></tr>' for row in rows
    )
    return f"<table><tr><th>As a sensor log{' it is refused' if log is None else ''}</th></tr>{cells}</table>"
