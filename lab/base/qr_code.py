"""QR code: a text as a square of dark and light modules, and its drawing."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import groupby

QR_SIZE = 260
"""Side of the drawing [px]: a phone reads it from half a metre."""

Code = tuple[tuple[bool, ...], ...]


def qr_code(text: str) -> Code:
    """Return the QR code of a text: rows of modules, True is dark, with a quiet zone of 4 modules."""
    import segno  # noqa: PLC0415 - needed to invite phones and classes only

    code = segno.make_qr(text, error="m")
    return tuple(tuple(bool(one) for one in row) for row in code.matrix_iter(border=4))


def qr_svg(code: Sequence[Sequence[bool]], label: str) -> str:
    """Return a QR code as SVG, dark on white in both colour schemes: not every camera reads the reverse.

    Parameters
    ----------
    code
        Rows of modules, True is dark, with the quiet zone.
    label
        What it is, for those who do not see it.
    """
    path = []
    for down, row in enumerate(code):
        at = 0
        for dark, run in groupby(row):
            length = len(list(run))
            if dark:
                path.append(f"M{at} {down}h{length}v1h-{length}z")
            at += length
    side = len(code)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{QR_SIZE}" height="{QR_SIZE}" '
        f'viewBox="0 0 {side} {side}" '
        f'shape-rendering="crispEdges" role="img" aria-label="{escape(label)}">'
        f'<rect width="{side}" height="{side}" fill="#fff"/><path d="{"".join(path)}" fill="#000"/></svg>'
    )
