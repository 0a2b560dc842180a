"""Notebook card: what an object shows of itself in a notebook, drawn by whoever registered for it.

What is shown lies below what draws it: the object says which card it has, and `lab.views.cards` who draws it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

_DRAWERS: dict[str, Callable[[Any], str]] = {}


def register(card: str, draw: Callable[[Any], str]) -> None:
    """Register what draws a card.

    Parameters
    ----------
    card
        Name of the card, the `CARD` of what it shows.
    draw
        Returns the HTML of what it is given.
    """
    _DRAWERS[card] = draw


class NotebookCard:
    """What Jupyter shows as a card; a subclass names the card in `CARD`."""

    CARD: ClassVar[str]

    def _repr_html_(self) -> str | None:
        """Return the card as HTML; None, for which Jupyter shows the text, where nobody draws it."""
        draw = _DRAWERS.get(self.CARD)
        return draw(self) if draw else None
