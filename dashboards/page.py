"""Page: the simulator as one page: settings, pages of plots, time cursor, messages."""

from __future__ import annotations

from functools import partial

import panel as pn
import panel_material_ui as pmui
import param
from panel_material_ui.template.base import Page as MaterialPage
from param.parameterized import edit_constant

from dashboards.exchange import Address, Files
from dashboards.pages.base import Page
from dashboards.pages.ground_track import GroundTrack
from dashboards.pages.innovations import Innovations
from dashboards.pages.summary import Summary
from dashboards.pages.time_plots import Covariance, Errors, Height, SensorErrors
from dashboards.pages.view_3d import View3D
from dashboards.progress import Progress
from dashboards.session import Session
from dashboards.settings_panel import SettingsPanel
from dashboards.style import DRESS, FRAME, STAGE, THEME
from dashboards.time_bar import TimeBar
from lab.result import Result
from lab.views.figures import TimeAxis

ZOOM_DEBOUNCE = 60
"""Time without a further zoom before the visible stretch is drawn anew [ms]."""

READY_WITHIN = 4000
"""How long a browser may take to say that it is ready [ms]."""

SETTLED = 1500
"""Time after which a page that was announced as ready has surely been laid out [ms]."""

PAGES: tuple[type[Page], ...] = (
    Errors,
    Covariance,
    Innovations,
    SensorErrors,
    GroundTrack,
    Height,
    View3D,
    Summary,
)


class SimulatorPage:
    """One open page; makes its session, and ends it when the browser leaves."""

    def __init__(self) -> None:
        document = pn.state.curdoc
        assert document is not None
        self.session = Session(document)
        self._on_phone = "Mobi" in pn.state.headers.get("User-Agent", "")
        self.axis = TimeAxis(touch=self._on_phone)
        self._document = document
        self._zooming = False
        self._pages: dict[int, Page] = {}
        self._settings = SettingsPanel(self.session)
        self._time_bar = TimeBar(self.axis, document, self._follow)
        self._files = Files(self.session)
        self._address = Address(self.session, document)
        self._progress = Progress(self.session)
        self._message = pmui.Alert(object="", severity="error", closeable=True, visible=False, margin=(6, 8))
        self._tabs = pmui.Tabs(
            *((page.title, pn.Spacer(height=0)) for page in PAGES),
            sizing_mode="stretch_width",
            height=48,
            margin=0,
            styles={"flex": "0 0 48px"},
        )
        self._stage = pn.Column(sizing_mode="stretch_both", margin=0, stylesheets=[STAGE])
        self.session.prepare = self._prepare
        self.session.param.watch(self._new_result, "result")
        self.session.param.watch(self._new_problem, "problem")
        self._tabs.param.watch(lambda _event: self._show(), "active")
        for edge in ("start", "end"):
            self.axis.range.on_change(edge, self._zoomed)

    def servable(self) -> None:
        """Put the page into the document of this session and compute the first result."""
        frame = MaterialPage(
            title="INS Lab",
            header=[self._progress.view],
            sidebar=[self._settings.view, self._files.view],
            sidebar_width=330,
            sidebar_open=not self._on_phone,
            main=[
                pn.Column(
                    self._tabs,
                    self._message,
                    self._stage,
                    self._time_bar.view,
                    sizing_mode="stretch_both",
                    margin=0,
                    stylesheets=[FRAME],
                )
            ],
            theme_config=THEME,
            sx=DRESS,
            busy_indicator=None,
        )
        # Linked to the busy state, the frame would walk through all models of the page twice for each event.
        with edit_constant(frame):
            frame.busy = False
        frame.servable()
        pn.state.on_session_destroyed(partial(_close, self))
        pn.state.onload(self._ready)
        self._document.add_timeout_callback(self._ready_late, READY_WITHIN)
        self._show()
        self._address.read()

    def _ready(self) -> None:
        """Begin to change the page; what a browser still busy with its first layout lost is sent again."""
        self.session.open()
        self._document.add_timeout_callback(self._resend, SETTLED)

    def _ready_late(self) -> None:
        """Do without the browser's word that it is ready, which can be lost."""
        if self.session.is_open:
            return
        if self.session.connected:
            self._ready()
        else:
            self._document.add_timeout_callback(self._ready_late, READY_WITHIN)

    def _resend(self) -> None:
        if self.session.result is not None:
            with pn.io.hold(self._document):
                self.axis.resend()
                self._page.resend()

    def close(self) -> None:
        """End the session."""
        self.session.close()
        self._time_bar.stop()
        for page in self._pages.values():
            page.close()

    @property
    def _page(self) -> Page:
        index = self._tabs.active
        if index not in self._pages:
            self._pages[index] = PAGES[index](self.axis)
        return self._pages[index]

    def _show(self) -> None:
        """Draw the page that is chosen; it is laid out afterwards, so that it arrives complete."""
        page = self._page
        if self.session.result is not None:
            page.show(self.session.result)
            page.show_time(self.axis.time)
        if self._stage.objects != [page.view]:
            self._stage[:] = [page.view]

    def _prepare(self, result: Result) -> None:
        page = self._pages.get(self._tabs.active)
        if page is not None:
            page.prepare(result)

    def _new_result(self, event: param.parameterized.Event) -> None:
        result: Result = event.new
        self.axis.span(float(result.time[-1]))
        self._time_bar.span()
        self._show()

    def _follow(self, time: float) -> None:
        self._page.show_time(time)

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
