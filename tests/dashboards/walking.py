"""A walk over the pages of the simulator, as a server makes them, without a browser."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
from bokeh.document import Document
from bokeh.models import DataRange1d, FixedTicker, LogScale
from bokeh.plotting import figure
from bokeh.server.callbacks import NextTickCallback
from panel.io.state import set_curdoc
from tornado.web import Application

from dashboards import viser_proxy
from dashboards.aside import Aside
from dashboards.computing import Outcome, run
from dashboards.drawn_pages import PAGES
from dashboards.page import SimulatorPage
from dashboards.pages.base import Page
from dashboards.pages.computed import ComputedPage
from dashboards.upload import Upload
from dashboards.upstream.server import speed_up
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

PATIENCE = 600.0
"""Longest time a page may take to work out what it shows [s]; the first time its kernels are compiled."""
PAUSE = 0.005
"""Time between two looks whether a page has worked out what it shows [s]: a loop that only looks takes a
processor, and the interpreter from the thread that works."""
TITLES = tuple(page.title for page in PAGES)


def send(upload: Upload, path: Path) -> None:
    """Send a file as a browser does, in one piece."""
    upload._process_chunk({"name": path.name, "chunk": 1, "data": path.read_bytes()})
    upload._flush_buffer()


class Walk:
    """One open page of the simulator, whose tabs are opened one after the other.

    Attributes
    ----------
    page : SimulatorPage
        What a browser would be shown.
    """

    def __init__(self) -> None:
        speed_up()
        self._document = Document()
        with set_curdoc(self._document):
            self.page = SimulatorPage()

    def run(self, experiment: Experiment) -> Outcome:
        """Run an experiment as the session does, and show its result."""
        outcome = run(experiment, None, self.page.pages.prepare)
        if outcome.result is not None:
            self.show(outcome.result)
        return outcome

    def show(self, result: Result) -> None:
        """Have a result arrive."""
        with set_curdoc(self._document):
            self.page.session.result = result
        self.settle()

    def open(self, title: str) -> None:
        """Open a page, in a tab or beside the tabs, and wait until it shows what it has to show."""
        with set_curdoc(self._document):
            self.page.pages.dock.close()
            self.page.pages.open(title)
            if not self._stage.objects:  # the page that opens first, which a server shows
                self.page.pages.draw()
        self.settle()

    def ask(self, what: str, position: int = 0) -> dict[str, Any]:
        """Undo, redo, or visit an entry of the browser's history; return what the browser is sent."""
        bar = self.page._address.bar
        with set_curdoc(self._document):
            bar.asked = [*bar.asked, [len(bar.asked) + 1, what, position]]
        return self.sent()

    def sent(self) -> dict[str, Any]:
        """Write the address, and return what the browser is sent of it and of the history."""
        self.page._address._write()
        return self.page._address.bar.shown

    def wait(self, happened: Callable[[], bool]) -> None:
        """Let the work of other threads arrive until something has happened."""
        until = time.monotonic() + PATIENCE
        while not happened():
            assert time.monotonic() < until
            time.sleep(PAUSE)
            self.settle()
        self.settle()

    def settle(self) -> None:
        """Do what the document was asked to do later, until nothing is worked on any more."""
        until = time.monotonic() + PATIENCE
        while True:
            # In this order: what is delivered just before the work ends is still seen.
            busy = isinstance(self.shown, ComputedPage) and self.shown._work.busy
            waiting = [one for one in self._document.session_callbacks if isinstance(one, NextTickCallback)]
            for one in waiting:
                callback = one.callback  # a callback that was removed refers to nothing
                self._document.remove_next_tick_callback(one)
                with set_curdoc(self._document):
                    callback()
            if not waiting and not busy:
                return
            if not waiting:
                time.sleep(PAUSE)
            assert time.monotonic() < until, f"{self.title} is still worked on"

    @property
    def title(self) -> str:
        """Title of the page that is open."""
        return self._kind.title

    @property
    def _aside(self) -> Aside | None:
        """The page beside the tabs that is open."""
        return next((one for one in (self.page.pages.sheet, self.page.pages.dock) if one.is_open), None)

    @property
    def _kind(self) -> type[Page]:
        return self.page.pages.tabs.kind if self._aside is None else self._aside.kind

    @property
    def _stage(self) -> pn.Column:
        return self.page.pages._stage.view if self._aside is None else self._aside._place

    @property
    def shown(self) -> Page:
        """The page that is open."""
        return self.page.pages.made(self._kind)

    @property
    def reason(self) -> str:
        """Why the page has nothing to show; empty if it has."""
        return str(self.page.pages._stage._reason.text) if self._aside is None else ""

    def text(self) -> str:
        """Return all that is written on the page, without markup."""
        panes = [pane for part in self._stage for pane in part.select(pn.pane.HTML)]
        return unescape(re.sub(r"<[^>]*>", " ", " ".join(str(pane.object) for pane in panes)))

    def figures(self) -> list[figure]:
        """Return the figures of the page that are not hidden."""
        panes = [pane for part in self._stage for pane in part.select(pn.pane.Bokeh)]
        return [pane.object for pane in panes if pane.object.visible]

    def complaints(self) -> list[str]:
        """Return what is wrong with the page that is open: nothing, if all is well."""
        found = []
        (view,) = self._stage.objects
        if view is getattr(self.page.pages._stage._failures.get(self._kind), "view", None):
            return [self.text()]
        if view is not (self.page.pages._stage._reason.view if self.reason else self.shown.view):
            found.append("shows what is not this page")
        if self.reason and not re.search(r"[a-z]{3}.*\.$", self.reason):
            found.append(f"gives no reason: {self.reason!r}")
        if match := re.search(r".{0,60}\b(nan|inf|failed|could not|Traceback)\b.{0,80}", self.text()):
            found.append(f"says {match[0]!r}")
        if isinstance(self.shown, ComputedPage) and not self.reason and not str(self.shown.words.object):
            found.append("says nothing about what it works out")
        if self.refused and "accepted" not in self.text():
            found.append(f"does not say what is accepted: {self.text()!r}")
        figures = [] if self.reason or self.refused else self.figures()
        return found + [line for fig in figures for line in _odd_axes(fig)]

    @property
    def refused(self) -> bool:
        """Whether the page could not work out what it shows, and says why in place of it."""
        shown = self.shown
        return isinstance(shown, ComputedPage) and shown._wanted is not None and shown._content is None


def _odd_axes(fig: figure) -> Iterator[str]:
    """Say which axes of a figure cannot be drawn, or hold no tick."""
    name = getattr(fig.title, "text", fig.title)
    for axis, scale, where in (
        (fig.x_range, fig.x_scale, "abscissa"),
        (fig.y_range, fig.y_scale, "ordinate"),
    ):
        if isinstance(axis, DataRange1d):  # follows the data in the browser
            continue
        start, end = axis.start, axis.end
        # Of a stream, the time before now is drawn, which falls from left to right.
        rising = start < end if axis.name != "live ages" else start > end
        if not (np.isfinite([start, end]).all() and rising):
            yield f"{name}: {where} from {start} to {end}"
        elif isinstance(scale, LogScale) and start <= 0:
            yield f"{name}: logarithmic {where} from {start}"
    ticker = fig.yaxis[0].ticker
    if isinstance(ticker, FixedTicker) and not 2 <= len(ticker.ticks) <= 16:
        yield f"{name}: {len(ticker.ticks)} ticks"


@contextmanager
def walking(monkeypatch) -> Iterator[Walk]:
    """Open the simulator; only the way of the 3-D view through a web server is missing."""
    application = Application()
    monkeypatch.setattr(viser_proxy, "web_application", lambda _document: application)
    walk = Walk()
    try:
        yield walk
    finally:
        walk.page.close()
