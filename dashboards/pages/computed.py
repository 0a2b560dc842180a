"""Computed: pages with slow content: computed in a thread, drawn when ready."""

from __future__ import annotations

import logging
import time
from abc import abstractmethod
from functools import partial
from html import escape
from typing import Any

import panel as pn

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.pages.base import Page, drawing_error
from dashboards.sending import together, turns_of_page
from dashboards.style import wide_html
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.run.memory import give_back, large_blocks_given_back
from lab.views.figures import TimeAxis

log = logging.getLogger(__name__)

TELL = 0.25
"""Time between two progress messages [s]."""

_STYLE = "p { margin: 0; opacity: .75; font: 14px/1.5 Roboto, sans-serif; }"


class ComputedPage(Page):
    """A page that shows its progress, or an error, in a line above its content.

    One computation runs at a time. A newer result ends it when it next reports its progress. Of the results
    that arrive meanwhile, only the newest is used.
    """

    depends_on_window = False
    working = "Computing …"
    """Text shown while the content is computed."""

    def __init__(self, axis: TimeAxis, _session: object = None) -> None:
        self._document = pn.state.curdoc
        self._wanted: Result | None = None
        self._content: tuple[Result, Any] | None = None
        self._later = turns_of_page()
        self._work = LatestWins(self._attempt, self._arrive, LONG, at_once=True, turn=self._later)
        self._told = 0.0
        self.words = wide_html(margin=(10, 20, 2, 20), stylesheets=[_STYLE])
        super().__init__(axis)

    @abstractmethod
    def work_out(self, result: Result, progress: Progress) -> Any:
        """Return the content that `paint` draws for a result; called in a thread.

        Work that takes seconds reports its progress, with a phrase and the fraction done; it may be ended
        there.
        """

    @abstractmethod
    def paint(self, result: Result, content: Any) -> str:
        """Draw the computed content, and return the line above it (HTML)."""

    @abstractmethod
    def clear(self) -> None:
        """Clear the content: the newest result has nothing to show."""

    def draw(self, result: Result) -> None:
        """Start the computation for a result; the content follows."""
        if result is self._wanted and self._work.busy:
            return
        self._wanted = result
        if self._content is not None and self._content[0] is result:
            self._paint(*self._content)
            return
        self.say(self.working)
        self._work.submit(result)

    def release(self) -> None:
        """Refer to no result any more, and end the computation."""
        super().release()
        self._work.cancel()
        self._wanted = self._content = None

    def say(self, text: str) -> None:
        """Show a text in the line above the content."""
        self.words.object = f"<p>{escape(text)}</p>"

    def appear(self) -> None:
        """Let the computation go before those of pages that nobody sees."""
        self._work.is_seen = True

    def hide(self) -> None:
        """Let the computations of pages that somebody sees go before this one."""
        self._work.is_seen = False

    def close(self) -> None:
        """End the computation, and draw no more."""
        self._wanted = self._content = None
        self._work.close()

    def _attempt(self, result: Result, progress: Progress) -> Outcome:
        def tell(stage: str, fraction: float) -> None:
            progress(stage, fraction)
            if time.monotonic() - self._told > TELL:
                self._told = time.monotonic()
                self._later(partial(self._report, result, stage))

        with large_blocks_given_back(result.time.size):
            outcome = attempt(lambda: self.work_out(result, tell))
        if result.is_long:
            give_back()
        return outcome

    def _report(self, result: Result, stage: str) -> None:
        if result is self._wanted:
            self.say(f"{self.working} {stage}")

    def _arrive(self, result: Result, outcome: Outcome) -> None:
        if result is not self._wanted:
            return
        assert self._document is not None
        with together(self._document):
            if outcome.problem:
                self._content = None
                self.clear()
                self.say(outcome.problem)
            else:
                self._paint(result, outcome.result)

    def _paint(self, result: Result, content: Any) -> None:
        self._content = result, content
        try:
            self.words.object = f"<p>{self.paint(result, content)}</p>"
        except Exception as error:
            log.exception("the page %s could not be drawn", self.title)
            self._content = None
            self.clear()
            self.say(drawing_error(self.title, error))
