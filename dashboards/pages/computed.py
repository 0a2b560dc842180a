"""Computed: pages whose content takes a while: worked out in a thread of the pool, drawn when it is there."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from html import escape
from typing import Any

import panel as pn

from dashboards.computing import POOL
from dashboards.pages.base import Page
from dashboards.sending import together
from lab.missions import MissionError
from lab.result import Result
from lab.settings import SettingError
from lab.views.figures import TimeAxis

_STYLE = "p { margin: 0; opacity: .75; font: 14px/1.5 Roboto, sans-serif; }"


class ComputedPage(Page):
    """A page that says what it works on, and what was wrong, in a line above its content.

    One computation runs at a time; of the results that come meanwhile only the newest is looked at.
    """

    depends_on_window = False
    working = "Computing …"
    """What is said while the content is worked out."""

    def __init__(self, axis: TimeAxis) -> None:
        self._document = pn.state.curdoc
        self._wanted: Result | None = None
        self._running = self._closed = False
        self.words = pn.pane.HTML(
            "", sizing_mode="stretch_width", margin=(10, 20, 2, 20), stylesheets=[_STYLE]
        )
        super().__init__(axis)

    @abstractmethod
    def work_out(self, result: Result) -> Any:
        """Return what `paint` draws of a result; called in a thread of the pool."""

    @abstractmethod
    def paint(self, result: Result, content: Any) -> str:
        """Draw what has been worked out, and return the line above it (HTML)."""

    def draw(self, result: Result) -> None:
        """Have a result worked out; the content follows."""
        self._wanted = result
        if not self._running:
            self._start(result)

    def close(self) -> None:
        """Draw nothing more."""
        self._closed, self._wanted = True, None

    def _start(self, result: Result) -> None:
        self._running = True
        self.words.object = f"<p>{self.working}</p>"
        POOL.submit(self._run, result)

    def _run(self, result: Result) -> None:
        try:
            content = self.work_out(result)
        except (SettingError, MissionError, ValueError) as error:
            content = error
        if not self._closed and self._document is not None:
            self._document.add_next_tick_callback(partial(self._arrive, result, content))

    def _arrive(self, result: Result, content: Any) -> None:
        self._running = False
        if self._wanted is None:
            return
        if result is not self._wanted:
            self._start(self._wanted)
            return
        assert self._document is not None
        with together(self._document):
            if isinstance(content, Exception):
                self.words.object = f"<p>{escape(str(content))}</p>"
            else:
                self.words.object = f"<p>{self.paint(result, content)}</p>"
