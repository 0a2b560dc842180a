"""Outcome card: what a notebook shows after the answer of an exercise."""

from __future__ import annotations

from html import escape

from lab.classroom.exercises.exercise import Outcome

_SIGNS = {None: ("#777", "?"), True: ("#1a8f4c", "✓"), False: ("#b3541e", "✗")}
"""Colour and sign of an outcome; both are readable on white and on black."""


def outcome_html(outcome: Outcome) -> str:
    """Return an outcome as HTML."""
    colour, sign = _SIGNS[outcome.right]
    return (
        f'<div style="border-left: 4px solid {colour}; padding: 0.3em 0.8em; max-width: 50em">'
        f'<b style="color: {colour}">{sign}</b> {escape(str(outcome))}</div>'
    )
