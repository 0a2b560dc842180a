"""Notebook card: the display of an object in a notebook, drawn by a registered function.

Objects must not import their views: an object names its card, and `lab.views.cards` registers the function
that draws it.
"""

from __future__ import annotations

from typing import ClassVar

from lab.base.registry import find, names


class NotebookCard:
    """Base class of objects that Jupyter shows as a card; a subclass names the card in `CARD`."""

    CARD: ClassVar[str]

    def __dir__(self) -> list[str]:
        # Completion lists what one asks of the object; its card is drawn by Jupyter.
        return [name for name in super().__dir__() if name != "CARD"]

    def _repr_html_(self) -> str | None:
        """Return the card as HTML; None if no function is registered, so that Jupyter shows the text."""
        if self.CARD not in names("card"):
            return None
        card: str = find("card", self.CARD)(self)
        return card
