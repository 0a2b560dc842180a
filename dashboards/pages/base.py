"""Base: the base class of pages: made when first shown, redrawn only while visible."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import inf
from typing import TYPE_CHECKING, ClassVar
from weakref import ref

import panel as pn
from bokeh.plotting import figure

from dashboards.style import whole_column
from lab.experiment.result import Result
from lab.views.figures import TimeAxis

if TYPE_CHECKING:
    import pandas as pd

GAP = 8
AROUND = 184
"""Height of header, tabs, legend and time bar together [px]."""
NARROW = 700
"""Width of the place of a page below which its plots are in one column [px]."""


class Page(ABC):
    """One page of the laboratory.

    Parameters
    ----------
    axis
        The time axis that all pages share.
    session
        The session, whose settings the page changes or whose results it compares; most pages need only the
        results that they show.

    Attributes
    ----------
    draw_again : callable
        Redraws the page after a choice on it. The code that shows the page sets it; before, it does nothing.
    held : callable
        Returns the results that are drawn beside the shown one, each in its place; set likewise.
    """

    title: str
    contents: ClassVar[str]
    """What is on it, as a browser says until it has come; of a page beside the tabs, it says nothing."""
    depends_on_window = True
    over_time: ClassVar[bool] = True
    """Whether it follows the time cursor, so that the time bar stands below it."""
    seen: ClassVar[tuple[str, ...]] = ("errors", "sigma")
    """Datasets of a result, over the same times, in the file of what is seen."""

    def __init__(self, axis: TimeAxis, _session: object = None) -> None:
        self.axis = axis
        self.held: Callable[[], Sequence[Result | None]] = tuple
        self.draw_again: Callable[[], None] = lambda: None
        self._drawn: tuple[ref[Result], tuple[float, float]] | None = None
        self.view = self.make()

    @abstractmethod
    def make(self) -> pn.viewable.Viewable:
        """Return the layout, made once, without any data."""

    @classmethod
    def missing_reason(cls, result: Result) -> str:
        """Return, in a sentence, why a result has nothing to show; empty if it has."""
        return ""

    def prepare(self, result: Result) -> None:  # noqa: B027 - most pages have nothing to do
        """Compute the content of this page for a result; called in a thread of the pool."""

    @abstractmethod
    def draw(self, result: Result) -> None:
        """Draw a result."""

    def show(self, result: Result) -> None:
        """Draw a result if the page is not up to date."""
        state = (ref(result), self.axis.window if self.depends_on_window else (0.0, 0.0))
        if state != self._drawn:
            self._drawn = state
            self.draw(result)

    def table(self, _result: Result) -> pd.DataFrame | None:
        """Return the table that is on it, for the file of what is seen; None for the datasets `seen`."""
        return None

    def forget(self) -> None:
        """Redraw at the next occasion, because a browser drops the content of a hidden page."""
        self._drawn = None

    def release(self) -> None:
        """Refer to no result any more, because its memory is needed; what is drawn stays."""
        self._drawn = None

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result."""
        return False

    def show_time(self, time: float) -> None:  # noqa: B027 - most pages have nothing to do
        """Follow the time cursor."""

    def appear(self) -> None:  # noqa: B027 - most pages have nothing to do
        """Begin what goes on while the page is visible."""

    def hide(self) -> None:  # noqa: B027 - most pages have nothing to do
        """Stop what goes on while the page is visible."""

    def dress(self, dark: bool) -> None:  # noqa: B027 - most pages are dressed by the frame
        """Follow the theme of the frame, dark or light."""

    def close(self) -> None:  # noqa: B027 - most pages have nothing to do
        """Release resources that are not freed automatically."""


class OwnPage(Page):
    """A page with content of its own, such as what it finds in a visitor's file; it shows no result."""

    depends_on_window = False
    over_time = False

    def draw(self, _result: Result) -> None:
        """Do nothing."""

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result: it needs none."""
        return True


def drawing_error(title: str, error: Exception) -> str:
    """Return the message about a page that could not be drawn."""
    return (
        f"The page {title} could not be drawn ({type(error).__name__}: {error}). This is a fault of the "
        "program; its log says where. The result is there: look at the other pages, or change the settings."
    )


def plot_grid(
    figures: Sequence[figure], columns: int, least: int = 150, *, beside: float = 0
) -> pn.viewable.Viewable:
    """Lay figures out in a grid that fills the window, in one column where they have little room.

    Parameters
    ----------
    figures
        In reading order.
    columns
        Columns on a wide window.
    least
        Least height of a row [px].
    beside
        Height of what else the page has [px]: the rows share the rest of the window. Infinite where the page
        is longer than any window; then they have their least height.
    """
    fill = beside == 0
    rows = -(-len(figures) // columns)
    taken = AROUND + GAP * rows + beside
    share = (
        f"max({least}px, calc((var(--print-height, 100vh) - {taken}px) / {rows}))"
        if beside < inf
        else f"{least}px"
    )
    free = "" if fill else " height: auto !important; flex: 0 0 auto !important;"
    # As its least height, Panel sets that of all figures in one column: one could scroll far below them.
    grid = f"""
    :host {{
      display: grid !important; gap: {GAP}px; min-height: 0 !important;{free}
      grid-template-columns: repeat({columns}, minmax(0, 1fr));
      grid-auto-rows: {share};
    }}
    .scroll-button {{ display: none !important; }}  /* Panel's own, which would take a row */
    @media screen {{
      @container stage (max-width: {NARROW}px) {{
        :host {{ grid-template-columns: minmax(0, 1fr); grid-auto-rows: {least + 30}px; }}
      }}
    }}
    @media print {{
      :host {{ grid-template-columns: var(--print-columns, repeat({columns}, minmax(0, 1fr))); }}
      :host > * {{ break-inside: avoid; }}
    }}
    """
    panes = [pn.pane.Bokeh(fig, sizing_mode="stretch_both", margin=0) for fig in figures]
    if columns > 1 and len(figures) % columns == 1:
        panes[-1].styles = {"grid-column": "1 / -1"}
    # With an explicit height, Panel does not stretch the column along with its figures; the browser uses the
    # height of the rows.
    sizing = {"sizing_mode": "stretch_both"} if fill else {"sizing_mode": "stretch_width", "height": least}
    return pn.Column(*panes, **sizing, stylesheets=[grid], margin=(6, 8))


def make_hideable(grid: pn.viewable.Viewable) -> pn.Column:
    """Return a column around a grid of plots, hidden at first: the style of a grid alone keeps it visible."""
    return whole_column(grid, visible=False)
