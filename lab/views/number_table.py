"""Number table: the noise of an IMU for a filter as HTML: numbers, causes, remarks, lines for programs."""

from __future__ import annotations

from html import escape

from lab.experiment.number_table import HEADS, UNKNOWN, ImuNumbers


def numbers_html(found: ImuNumbers) -> str:
    """Return the table of terms, what each number rests on, and the remarks."""
    heads = "".join(f"<th>{escape(head)}</th>" for head in ("", *HEADS[2:]))
    rows = "".join(
        f"<tr><td>{escape(triad)}, {escape(term)}</td>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for triad, term, *cells in found.cells
    )
    why = "".join(
        f"<li><b>{escape(row.triad)}, {escape(row.term)}</b>: {escape(row.basis)}. Cause of the factor: "
        f"{escape(row.cause)}</li>"
        for row in found.rows
    )
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in found.remarks)
    return (
        f"<p>At rest: {escape(found.static or UNKNOWN)}. In motion: {escape(found.moving or UNKNOWN)}. "
        f"Intervals are 95 % intervals.</p><table><tr>{heads}</tr>{rows}</table>"
        f"<p>{escape(found.convention)}</p><ul>{why}{remarks}</ul>"
    )


def lines_html(lines: str) -> str:
    """Return lines of a configuration, ready to be copied."""
    return f"<pre>{escape(lines)}</pre>"
