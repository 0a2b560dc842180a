"""Notebook card: the display of an object in a notebook, drawn by a registered function.

Objects must not import their views: an object names its card, and `lab.views.cards` registers the function
that draws it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
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


@dataclass(frozen=True, repr=False)
class HtmlFrame:
    """A page that needs no server.

    Attributes
    ----------
    page : str
        HTML of the whole page, with its scripts and data.
    title : str
        What is in the frame, for screen readers.
    height : int
        Height of the frame [px]; it is as wide as the notebook.
    """

    page: str
    title: str
    height: int

    def save(self, path: str | Path) -> None:
        """Write the page to a file, which any browser opens without a server.

        Parameters
        ----------
        path
            Name of the file, such as ``"flight.html"``; an existing file is overwritten.
        """
        Path(path).write_text(self.page, encoding="utf-8")

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.page)}" title="{escape(self.title)}" allow="fullscreen" '
            f'style="border:0;width:100%;height:{self.height}px;display:block"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<{self.title}: {len(self.page) / 1e6:.1f} MB of HTML; .save(path) writes it to a file>"
