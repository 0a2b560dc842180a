"""Axis picture: the axes of the vehicle with the axes of the device that point along them, as SVG."""

from __future__ import annotations

from html import escape

from lab.views.quantities import AXIS_COLOURS

_ARROWS = {
    "forward": ((157, 86), (236, 43), (245, 41)),
    "right": ((157, 86), (240, 120), (250, 128)),
    "down": ((157, 86), (157, 180), (168, 190)),
}
"""Beginning, tip, and place of the label of the arrow of each axis of the vehicle [px]."""
_PLATE = ((82, 96), (168, 50), (232, 76), (146, 122))
"""Corners of a plate that stands for the vehicle: left rear, left front, right front, right rear [px]."""


def axis_picture(axes: tuple[str, str, str] | None, *, inverted: bool = False) -> str:
    """Return a picture of a map as SVG, in the colours of the axes on all plots; text has the page's colour.

    Parameters
    ----------
    axes
        Axes of the device that point forward, right and down, such as ``-y``; None while they are unknown.
    inverted
        Whether the device sends the negative of the specific force.
    """
    left_rear, left_front, right_front, right_rear = (f"{x},{y}" for x, y in _PLATE)
    parts = [
        f'<polygon points="{left_rear} {left_front} {right_front} {right_rear}" fill="currentColor" '
        'opacity="0.13"/>',
        f'<polyline points="{left_front} {right_front}" stroke="currentColor" stroke-width="2"/>',
    ]
    for (name, (start, tip, label)), colour, axis in zip(
        _ARROWS.items(), AXIS_COLOURS, axes or ("?", "?", "?"), strict=True
    ):
        (x0, y0), (x1, y1), (x, y) = start, tip, label
        word = f"{name} = {axis.replace('-', '−')}"
        parts.append(
            f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y1}" stroke="{colour}" stroke-width="3"/>'
            f'<circle cx="{x1}" cy="{y1}" r="5" fill="{colour}"/>'
            f'<text x="{x}" y="{y}" fill="currentColor" font-size="15">'
            f"{escape(word)}</text>"
        )
    if inverted:
        parts.append(
            '<text x="8" y="20" fill="currentColor" font-size="13">'
            "The device sends the negative force.</text>"
        )
    return (
        '<svg viewBox="0 0 360 212" role="img" aria-label="Axes of the device in the vehicle" '
        f'style="width:100%;max-width:360px;height:auto;font-family:inherit">{"".join(parts)}</svg>'
    )
