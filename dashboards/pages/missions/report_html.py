"""Report html: the rows of an import report, besides its verdict, as a table in groups."""

from __future__ import annotations

from html import escape
from itertools import groupby

from lab.importing.import_report import ImportReport
from lab.logs.sensor_log import SensorLog

REPORT_STYLE = """
table { border-collapse: collapse; font: 13px/1.5 Roboto, sans-serif; width: 100%; }
th { text-align: left; font-weight: 500; padding: 10px 8px 2px 0;
     border-bottom: 1px solid rgba(128,128,128,.35); }
td { padding: 2px 10px 2px 0; vertical-align: top; overflow-wrap: anywhere; }
td:first-child { opacity: .7; white-space: nowrap; width: 1%; }
"""


def report_html(report: ImportReport) -> str:
    """Return the rows of a report as an HTML table."""
    parts = []
    for group, rows in groupby(report.rows, key=lambda row: row.group):
        parts.append(f'<tr><th colspan="2">{escape(group)}</th></tr>')
        # The note about the command line's --unit is omitted.
        kept = (row for row in rows if row.name or group != "Units")
        parts += [f"<tr><td>{escape(row.name)}</td><td>{escape(row.value)}</td></tr>" for row in kept]
    return f"<table>{''.join(parts)}</table>"


def log_html(log: SensorLog | None, refused: str) -> str:
    """Return how the IMU and GPS data of a file were read as a log, or why they were not; else nothing."""
    if log is None and not refused:
        return ""
    rows = [refused] if log is None else list(log.repairs)
    cells = "".join(
        f'<tr><td style="white-space: normal; opacity: 1">{escape(row)}</td></tr>' for row in rows
    )
    return f"<table><tr><th>As a sensor log{' it is refused' if log is None else ''}</th></tr>{cells}</table>"
