"""HTML frame: a whole page in a frame, displayed in a notebook or an app, or saved as a file."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path


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
