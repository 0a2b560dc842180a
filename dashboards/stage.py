"""Stage: where the page of the open tab stands, or a sentence if it cannot be drawn."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import panel as pn

from dashboards.notice import Notice
from dashboards.pages.base import Page, drawing_error
from dashboards.pages.consistency import Consistency
from dashboards.pages.innovations import Innovations
from dashboards.style import STAGE
from lab.experiment.result import Result
from lab.run.memory import give_back

log = logging.getLogger(__name__)

LINKED = (Innovations.title, Consistency.title)
"""Pages that show a log without reference: links in the sentence on a page that has nothing to show."""


class Stage:
    """The place of one page after the other.

    Parameters
    ----------
    pages
        The pages that are made so far.
    """

    def __init__(self, pages: Mapping[type[Page], Page]) -> None:
        self._pages = pages
        self._reason = Notice(margin=(16, 20), links=LINKED)
        self._failures: dict[type[Page], Notice] = {}
        self._visible: Page | None = None
        self.view = pn.Column(name="page stage", sizing_mode="stretch_both", margin=0, stylesheets=[STAGE])

    def shows(self, page: Page) -> bool:
        """Return whether the plots of a page stand here."""
        return bool(self.view.objects == [page.view])

    def draw(self, page: Page, result: Result | None, time: float) -> pn.viewable.Viewable:
        """Draw a page, and lay it out afterwards, so that it arrives complete; return what stands here.

        Parameters
        ----------
        page
            The page.
        result
            What it shows; None while there is no result.
        time
            The time under study [s].
        """
        reason = page.missing_reason(result) if result is not None else ""
        self._reason.say(reason, "info")
        if result is not None and not reason:
            if not self.shows(page):
                page.forget()
            page.show(result)
            if result.is_long:
                give_back()
            page.show_time(time)
        view = self._reason.view if reason else page.view  # a page may have changed its plots
        self._put(view, type(page))
        return view

    def appear(self, page: Page) -> None:
        """Tell a page that it is seen now, and the one before that it is not."""
        if page is not self._visible:
            if self._visible is not None:
                self._visible.hide()
            self._visible = page
            page.appear()

    def _put(self, view: pn.viewable.Viewable, kind: type[Page]) -> None:
        """Lay a page out; the browser is told first which: the same sentence may stand in its place."""
        if self.view.tags != [kind.title]:
            self.view.tags = [kind.title]
        if self.view.objects != [view]:
            self.view[:] = [view]

    @contextmanager
    def failures_shown(
        self, kind: type[Page], place: Callable[[pn.viewable.Viewable], None] | None = None
    ) -> Iterator[None]:
        """Show an error in place of a page that could not be drawn, never the plots of another page.

        Parameters
        ----------
        kind
            What page is drawn.
        place
            Lays the error out if the page stands elsewhere.
        """
        try:
            yield
        except Exception as error:
            log.exception("the page %s could not be drawn", kind.title)
            page = self._pages.get(kind)
            if page is not None:
                page.forget()
            failure = self._failures.setdefault(kind, Notice())
            failure.say(drawing_error(kind.title, error))
            if place is None:
                self._put(failure.view, kind)
            else:
                place(failure.view)
