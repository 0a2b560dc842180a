"""Drawn pages: the pages of a session: made when first needed, opened in or beside the tabs, and drawn."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import panel as pn
from bokeh.document import Document

from dashboards.aside import BESIDE, DOCK, SHEET, Aside, lessons_button, mission_button
from dashboards.kept import Kept
from dashboards.page_tabs import FIRST, IN_TABS, PageTabs
from dashboards.pages.base import Page
from dashboards.pages.compare import Compare
from dashboards.pages.lessons.lessons import Lessons
from dashboards.pages.missions import Missions
from dashboards.sending import together
from dashboards.session import Session
from dashboards.stage import Stage
from dashboards.teaching.large_type import LargeType
from dashboards.teaching.moment import Place
from dashboards.time_bar import TimeBar
from lab.classroom.lessons.lesson import RENAMED
from lab.experiment.result import Result
from lab.run.memory import give_back
from lab.views.figures import TimeAxis

log = logging.getLogger(__name__)

PAGES: tuple[type[Page], ...] = (*IN_TABS, Missions, Lessons)
"""The pages in the tabs, and those beside them."""

BY_TITLE = {page.title: page for page in PAGES}


class DrawnPages:
    """The pages of a session.

    Parameters
    ----------
    session
        The session, whose result they show.
    document
        Its document.
    axis
        The time axis of their plots.
    time_bar
        The bar below them, for those that show times.
    turned
        Called when another page of the tabs is open.
    turned_aside
        Called when a page beside the tabs was opened or closed.
    waits
        Returns whether the first plots must wait for their turn.

    Attributes
    ----------
    tabs : PageTabs
        The tabs.
    sheet, dock : Aside
        The missions over the tabs, and the lessons beside them.
    middle : viewable
        The open page of the tabs, and the dock.
    """

    def __init__(
        self,
        session: Session,
        document: Document,
        axis: TimeAxis,
        time_bar: TimeBar,
        turned: Callable[[], None],
        turned_aside: Callable[[], None],
        waits: Callable[[], bool],
    ) -> None:
        self._session = session
        self._document = document
        self._axis = axis
        self._time_bar = time_bar
        self._turned_aside = turned_aside
        self._waits = waits
        self._dark = False
        self._large_type = LargeType()
        self._pages: dict[type[Page], Page] = {}
        self._stage = Stage(self._pages)
        self.tabs = PageTabs(turned)
        self.sheet = Aside(Missions, mission_button(), SHEET, self._turn_aside)
        self.dock = Aside(Lessons, lessons_button(), DOCK, self._turn_aside)
        self.middle = pn.Row(
            self._stage.view, self.dock.view, sizing_mode="stretch_both", margin=0, stylesheets=[BESIDE]
        )

    @property
    def open_page(self) -> Page:
        """The open page of the tabs."""
        return self.made(self.tabs.kind)

    @property
    def lessons(self) -> Lessons | None:
        """The lessons; None as long as nobody needs them."""
        lessons = self._pages.get(Lessons)
        return lessons if isinstance(lessons, Lessons) else None

    def made(self, kind: type[Page]) -> Page:
        """Return a page; it is made when first needed."""
        if kind not in self._pages:
            page = kind(self._axis, self._session)
            page.dress(self._dark)
            page.draw_again = partial(self._draw_again, page)
            page.held = self._held
            self._pages[kind] = page
        return self._pages[kind]

    def made_lessons(self) -> Lessons:
        """Return the lessons."""
        lessons = self.made(Lessons)
        assert isinstance(lessons, Lessons)
        return lessons

    def kept(self, kept: Kept) -> Kept:
        """Return what the browser stores, with what the pages add to it."""
        compare = self._pages.get(Compare)
        if isinstance(compare, Compare):
            kept = kept._replace(compared=compare.kept())
        return self.lessons.kept(kept) if self.lessons is not None else kept

    def compare_again(self, compared: Mapping[str, Any]) -> None:
        """Compare what was compared before the connection was cut."""
        compare = self.made(Compare)
        assert isinstance(compare, Compare)
        compare.take_back(compared)

    def open(self, title: str) -> None:
        """Open a page by its title; without one, that with which a session opens."""
        kind = BY_TITLE[RENAMED.get(title, title)] if title else FIRST
        if kind is Lessons:
            self.dock.open()
        elif kind is Missions:
            self.sheet.open()
        else:
            self.sheet.close()
            self.tabs.open(kind)

    def close_aside(self) -> None:
        """Close what is open beside the tabs, the sheet first, which covers the dock."""
        (self.sheet if self.sheet.is_open else self.dock).close()

    def go_to_step(self, place: Place | None) -> Lessons | None:
        """Show a step of a lesson in the dock, or no lesson; return the lessons if they are there."""
        if place is None and self.lessons is None:
            return None
        lessons = self.made_lessons()
        is_new = place is not None and place != lessons.place
        lessons.go(place)
        if is_new:
            self.dock.open()
        return lessons

    def draw(self) -> None:
        """Draw the open pages, and lay them out afterwards, so that they arrive complete."""
        self._draw_asides()
        with self._stage.failures_shown(self.tabs.kind):
            page, result = self.open_page, self._session.result
            if self._time_bar.view.visible != page.over_time:
                self._time_bar.stop()
                self._time_bar.view.visible = page.over_time
            view = self._stage.draw(page, result, self._axis.time)
            self._large_type.dress(view)  # a browser is told of changes only on a page that it has
            if result is None and not page.is_complete:
                self._session.restore()
            self._stage.appear(page)

    def draw_if_begun(self) -> None:
        """Draw the open pages, unless the first plots must wait for their turn."""
        if not self._waits():
            self.draw()

    def draw_all_again(self) -> None:
        """Draw the open pages anew, and the others once they are opened."""
        for page in self._pages.values():
            page.forget()
        self.draw_if_begun()

    def draw_time(self, time: float) -> None:
        """Show the time under study [s] on the open page of the tabs."""
        page = self._pages.get(self.tabs.kind)
        if page is not None and self._stage.shows(page):
            with self._stage.failures_shown(self.tabs.kind):
                page.show_time(time)

    def prepare(self, result: Result) -> None:
        """Let the open page prepare a result; an error is shown when the page is drawn."""
        page = self._pages.get(self.tabs.kind)
        try:
            if page is not None and not page.missing_reason(result):
                page.prepare(result)
            if result.is_long:
                give_back()
        except Exception:
            log.exception("the page %s could not be prepared", self.tabs.kind.title)

    def dress(self, dark: bool) -> None:
        """Draw the pages in dark or light colours."""
        self._dark = dark
        for page in self._pages.values():
            page.dress(dark)

    def enlarge(self, on: bool) -> None:
        """Turn large type for a projector on or off."""
        self._large_type.on = on
        self._draw_again(self.open_page)

    def release(self) -> None:
        """Let go of the result."""
        for page in self._pages.values():
            page.release()

    def close(self) -> None:
        """End the pages."""
        self.release()
        for page in self._pages.values():
            page.close()

    def _held(self) -> list[Result | None]:
        """Return the held results in their places; that of the shown one is free."""
        shown = self._session.result
        return [None if one.result is shown else one.result for one in self._session.held]

    def _turn_aside(self, aside: Aside) -> None:
        """Show what was opened beside the tabs, or rest what was closed; the sheet would cover the dock."""
        if aside is self.dock and aside.is_open:
            self.sheet.close()
        with together(self._document):
            page = self.made(aside.kind)
            if aside.is_open:
                page.forget()
                page.appear()
            else:
                page.hide()
            if aside is self.sheet:
                below = {"visibility": "hidden" if aside.is_open else "visible"}
                for part in (self.tabs.view, self.middle, self._time_bar.view):
                    part.styles = {**part.styles, **below}
            self._draw_asides()
            self._turned_aside()

    def _draw_asides(self) -> None:
        """Draw the open pages beside the tabs."""
        for aside in (self.sheet, self.dock):
            if aside.is_open:
                with self._stage.failures_shown(aside.kind, aside.show):
                    page = self.made(aside.kind)
                    if self._session.result is not None:
                        page.show(self._session.result)
                    aside.show(page.view)
                    self._large_type.dress(page.view)

    def _draw_again(self, page: Page) -> None:
        page.forget()
        self.draw()
