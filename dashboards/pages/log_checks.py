"""Log checks: the part of the Overview of a log without reference, which is judged by itself."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from weakref import ref

import panel as pn
import panel_material_ui as pmui
from bokeh.models.tickers import BasicTicker

from dashboards.pages.base import NARROW
from dashboards.pages.computed import ComputedPage
from dashboards.plot_tools import SETTLED
from dashboards.seen_names import as_seen
from dashboards.style import plain_column, plain_row
from lab.analysis.cross_checks import CrossChecks, cross_checks
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.views.figures import TimeAxis
from lab.views.overview import CROSS_CHECKS, checks_in_words
from lab.views.time_figures import TimeFigures

LEAST = 150
"""Least height of a plot [px]."""
_ROW = f"""
:host {{ display: grid !important; gap: 8px; height: auto !important; min-height: 0 !important;
         grid-template-columns: repeat(3, minmax(0, 1fr)); grid-auto-rows: {LEAST}px; }}
.scroll-button {{ display: none !important; }}
@container stage (max-width: {NARROW}px) {{ :host {{ grid-template-columns: minmax(0, 1fr); }} }}
"""
_LINE = """
:host { flex-wrap: wrap; align-items: center; }
:host > :first-child { flex: 1 1 300px; }
"""


class LogChecks(ComputedPage):
    """Two sentences and three plots, computed after the rest of the page, and a way to identify the noise.

    Parameters
    ----------
    axis
        The time axis.
    identify
        Opens the identification.
    """

    title = "Overview"
    depends_on_window = True
    working = "Judging the log by itself …"

    def __init__(self, axis: TimeAxis, identify: Callable[[], None]) -> None:
        self._identify = identify
        self._next: ref[Result] | None = None
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the sentences with the button, and the plots below them."""
        self._figures = TimeFigures(CROSS_CHECKS, self.axis, buckets=350)
        for fig in self._figures.figures:
            fig.min_height = LEAST
            if isinstance(fig.yaxis[0].ticker, BasicTicker):
                fig.yaxis[0].ticker.desired_num_ticks = 4
        panes = [pn.pane.Bokeh(fig, sizing_mode="stretch_both", margin=0) for fig in self._figures.figures]
        button = pmui.Button(label="Identify noise …", size="small", variant="outlined", margin=(4, 8))
        button.on_click(lambda _event: self._identify())
        self.words.param.update(margin=(2, 8))
        self._plots = plain_column(*panes, stylesheets=[_ROW], visible=False)
        return plain_column(plain_row(self.words, button, stylesheets=[_LINE]), self._plots)

    def draw(self, result: Result) -> None:
        """Begin the checks of a result, unless they take too much memory, or its filter is not known."""
        reason = "this log is too long" if result.is_long else ""
        reason = reason or ("the navigator is an algorithm of your own" if result.algorithm else "")
        self._next = wanted = None if reason else ref(result)
        if wanted is None:
            self.release()
            self.clear()
            self.say(f"Fixes are not withheld, because {reason}.")
        elif self._content is not None and self._content[0] is result:
            super().draw(result)
        else:
            self.say(self.working)
            assert self._document is not None
            self._document.add_timeout_callback(lambda: self.begin(wanted), SETTLED)

    def begin(self, wanted: ref[Result]) -> None:
        """Begin the checks of a result, unless another one has come meanwhile, or another page is open."""
        result = wanted()
        if result is not None and self._next is wanted:
            super().draw(result)

    def hide(self) -> None:
        """End the work that nobody waits for."""
        self._next = None
        if self._work.busy:
            self.release()

    def work_out(self, result: Result, progress: Progress) -> CrossChecks:
        """Withhold fixes, and smooth."""
        return cross_checks(result, progress)

    def clear(self) -> None:
        """Show no plots."""
        self._plots.visible = False

    def paint(self, _result: Result, found: CrossChecks) -> str:
        """Draw the checks; return what they say."""
        self._figures.show(found)  # type: ignore[arg-type]  # it has what the plots read
        self._plots.visible = True
        return escape(as_seen(checks_in_words(found)))
