"""Notebook card: the display of an object in a notebook, drawn by a registered function.

Objects must not import their views: an object names its card, and `lab.views.cards` registers the function
that draws it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

_DRAWERS: dict[str, Callable[[Any], str]] = {}


def register(card: str, draw: Callable[[Any], str]) -> None:
    """Register the function that draws a card.

    Parameters
    ----------
    card
        Name of the card: the `CARD` of its objects.
    draw
        Returns the HTML of an object.
    """
    _DRAWERS[card] = draw


class NotebookCard:
    """Base class of objects that Jupyter shows as a card; a subclass names the card in `CARD`."""

    CARD: ClassVar[str]

    def _repr_html_(self) -> str | None:
        """Return the card as HTML; None if no function is registered, so that Jupyter shows the text."""
        draw = _DRAWERS.get(self.CARD)
        return draw(self) if draw else None
