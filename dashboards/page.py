"""Page: the simulator as one page: settings, pages of plots, time cursor, messages."""

from __future__ import annotations

from functools import partial

import panel as pn
import panel_material_ui as pmui
import param

from dashboards.pages.base import Page
from dashboards.pages.time_plots import Covariance, Errors, SensorErrors
from dashboards.session import Session
from dashboards.settings_panel import SettingsPanel
from lab.result import Result
from lab.views.figures import TimeAxis

ZOOM_DEBOUNCE = 60
"""Time without a further zoom before the visible stretch is drawn anew [ms]."""

PAGES: tuple[type[Page], ...] = (Errors, Covariance, SensorErrors)


class SimulatorPage:
    """One open page; makes its session, and ends it when the browser leaves."""

    def __init__(self) -> None:
        document = pn.state.curdoc
        assert document is not None
        self.session = Session(document)
        self.axis = TimeAxis()
        self._document = document
        self._zooming = False
        self._pages: dict[int, Page] = {}
        self._settings = SettingsPanel(self.session)
        self._message = pmui.Alert(
            object="", alert_type="error", closeable=True, visible=False, margin=(6, 8)
        )
        self._tabs = pmui.Tabs(
            *((page.title, pn.Column(sizing_mode="stretch_both", margin=0)) for page in PAGES),
            dynamic=True,
            sizing_mode="stretch_both",
            margin=0,
        )
        self.session.param.watch(self._new_result, "result")
        self.session.param.watch(self._new_problem, "problem")
        self._tabs.param.watch(lambda _event: self._show(), "active")
        for edge in ("start", "end"):
            self.axis.range.on_change(edge, self._zoomed)

    def servable(self) -> None:
        """Put the page into the document of this session and compute the first result."""
        pmui.Page(
            title="INS Lab",
            sidebar=[self._settings.view],
            sidebar_width=330,
            main=[pn.Column(self._message, self._tabs, sizing_mode="stretch_both", margin=0)],
        ).servable()
        pn.state.on_session_destroyed(partial(_close, self))
        self._show()
        self.session.compute()

    def close(self) -> None:
        """End the session."""
        self.session.close()
        for page in self._pages.values():
            page.close()

    @property
    def _page(self) -> Page:
        index = self._tabs.active
        if index not in self._pages:
            self._pages[index] = PAGES[index](self.axis)
            self._tabs[index][:] = [self._pages[index].view]
        return self._pages[index]

    def _show(self) -> None:
        page = self._page
        if self.session.result is not None:
            page.show(self.session.result)

    def _new_result(self, event: param.parameterized.Event) -> None:
        result: Result = event.new
        self.axis.span(float(result.time[-1]))
        self._show()

    def _new_problem(self, event: param.parameterized.Event) -> None:
        self._message.param.update(object=event.new, visible=bool(event.new))

    def _zoomed(self, _attr: str, _old: object, _new: object) -> None:
        if not self._zooming:
            self._zooming = True
            self._document.add_timeout_callback(self._draw_window, ZOOM_DEBOUNCE)

    def _draw_window(self) -> None:
        self._zooming = False
        with pn.io.hold(self._document):
            self._show()


def _close(page: SimulatorPage, _context: object) -> None:
    page.close()
