"""Page tabs: the tabs of the laboratory; some have parts, and each part is a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import chain

import panel as pn
import panel_material_ui as pmui
import param
from panel.custom import JSComponent

from dashboards.pages.allan import Allan
from dashboards.pages.base import Page
from dashboards.pages.budget import Budget
from dashboards.pages.calibrate import Calibrate
from dashboards.pages.compare import Compare
from dashboards.pages.consistency import Consistency
from dashboards.pages.flight import FlightPlots
from dashboards.pages.ground_track import GroundTrack
from dashboards.pages.innovations import Innovations
from dashboards.pages.live import Live
from dashboards.pages.microscope import Microscope
from dashboards.pages.numbers import Numbers
from dashboards.pages.other_filters import OtherFilters
from dashboards.pages.overview import Overview
from dashboards.pages.sensor_cards import SensorCards
from dashboards.pages.time_plots import Covariance, Errors, SensorErrors
from dashboards.pages.view_3d import View3D
from dashboards.style import ON_SCREEN, plain_row
from dashboards.titled import Tabs
from lab.experiment.result import Result

TABS: dict[str, tuple[type[Page], ...]] = {
    "Overview": (Overview,),
    "Flight": (FlightPlots, GroundTrack, View3D),
    "Errors": (Errors, Covariance),
    "Filter": (Consistency, Innovations, SensorErrors, Budget, Microscope, OtherFilters),
    "Sensors": (SensorCards, Allan, Numbers, Calibrate),
    "Compare": (Compare,),
    "Live": (Live,),
}
"""The pages of each tab, by what is written on it."""
FIRST: type[Page] = Overview
"""The page that opens first."""
IN_TABS = tuple(chain.from_iterable(TABS.values()))

_NOTHING = {"& button[data-nothing]": {"fontStyle": "italic", "opacity": 0.92, "fontWeight": 300}}
"""As far as letters may be dimmed that must still be read."""
_TAB = {"minWidth": "0", "padding": "12px 12px", "letterSpacing": "0"}
_EDGE = "1px solid rgba(128, 128, 128, .35) !important"
"""Left edge of a part on a phone, where it may be the first of a second row."""
_PART = {
    "& button": {
        **{"whiteSpace": "nowrap", "padding": "3px 12px"},
        "@media (max-width: 480px)": {"padding": "3px 7px", "width": "auto", "borderLeft": _EDGE},
    },
    "@media (max-width: 480px)": {"flexWrap": "wrap", "maxWidth": "calc(100vw - 24px)"},
    **_NOTHING,
}
_ROW = """
:host { flex: 0 0 auto !important; flex-wrap: wrap; justify-content: space-between; align-items: center; }
"""
"""The parts stand at the right of the tabs, or below them where both do not fit."""
_MARKS = """
export function render({model, el}) {
  const seen = new WeakSet()
  const mark = () => {
    const {host} = el.getRootNode()
    for (const {shadowRoot} of host?.getRootNode().querySelectorAll("*") ?? []) {
      if (!shadowRoot || shadowRoot === host.shadowRoot) continue
      if (!seen.has(shadowRoot)) {
        new MutationObserver(mark).observe(shadowRoot, {childList: true, subtree: true})
        seen.add(shadowRoot)
      }
      for (const one of shadowRoot.querySelectorAll("button")) {
        const kind = one.getAttribute("role") === "tab" ? "tab" : "button"
        const reason = model.reasons[kind]?.[one.textContent.trim()]
        for (const name of ["title", "aria-description", "data-nothing"]) {
          if (reason) one.setAttribute(name, reason)
          else one.removeAttribute(name)
        }
      }
    }
  }
  model.on("reasons", mark)
  requestAnimationFrame(mark)
  return document.createElement("span")
}
"""


class Marks(JSComponent):
    """The reasons why tabs and parts have nothing to show; the browser writes them at their buttons."""

    reasons: dict[str, dict[str, str]] = param.Dict(
        {}, doc="By the role of a button and what is written on it."
    )

    _esm = _MARKS


class PageTabs:
    """The tabs, and the parts of the open tab.

    Parameters
    ----------
    turned
        Called when another page is open, chosen by a person or by `open`.

    Attributes
    ----------
    view : viewable
        The tabs, and beside them the parts.
    kind : type of Page
        The open page.
    """

    def __init__(self, turned: Callable[[], None]) -> None:
        self.kind = FIRST
        self._turned = turned
        self._silent = False
        self._titles = tuple(TABS)
        self._reasons: dict[type[Page], str] = {}
        self._marks: Marks | None = None
        self._last = {tab: pages[0] for tab, pages in TABS.items()}
        tab = self._find_tab(FIRST)
        self._tabs = Tabs(
            *((title, pn.Spacer(height=0)) for title in TABS),
            name="page tabs",
            active=self._titles.index(tab),
            height=48,
            margin=0,
            styles={"flex": "0 1 auto", "min-width": "0", "max-width": "100%"},
            sx={"& .MuiTab-root": _TAB, **_NOTHING},
        )
        self._parts = pmui.RadioButtonGroup(
            css_classes=["page-parts"],
            options=[page.title for page in TABS[tab]],
            value=FIRST.title,
            size="small",
            color="primary",
            margin=(6, 12),
            sx=_PART,
            visible=len(TABS[tab]) > 1,
        )
        self._tabs.param.watch(self._tab_chosen, "active")
        self._parts.param.watch(self._part_chosen, "value")
        self.view = plain_row(self._tabs, self._parts, stylesheets=[_ROW, ON_SCREEN])

    def open(self, kind: type[Page]) -> None:
        """Open a page, and with it its tab."""
        if kind is self.kind:
            return
        tab = self._find_tab(kind)
        self.kind = self._last[tab] = kind
        with self._pause_events():
            self._tabs.active = self._titles.index(tab)
            self._parts.param.update(
                options=[page.title for page in TABS[tab]], value=kind.title, visible=len(TABS[tab]) > 1
            )
            self._mark()
        self._turned()

    def dim(self, result: Result) -> None:
        """Dim the tabs and parts that have nothing to show of a result; their reasons are their tooltips."""
        self._reasons = {}
        for kind in IN_TABS:
            with suppress(Exception):  # the page says in its place that it fails
                if reason := kind.missing_reason(result):
                    self._reasons[kind] = reason
        self._mark()

    def _mark(self) -> None:
        """Mark the tabs whose page would have nothing to show, and the parts of the open one."""
        if self._marks is None:
            if not self._reasons:
                return
            self._marks = Marks(margin=0, styles={"display": "none"})  # type: ignore[no-untyped-call]
            self.view.append(self._marks)
        opened = {"tab": self._last, "button": {one.title: one for one in TABS[self._find_tab(self.kind)]}}
        self._marks.reasons = {
            role: {title: self._reasons[kind] for title, kind in kinds.items() if kind in self._reasons}
            for role, kinds in opened.items()
        }

    def _tab_chosen(self, event: param.parameterized.Event) -> None:
        if not self._silent:
            self.open(self._last[self._titles[event.new]])

    def _part_chosen(self, event: param.parameterized.Event) -> None:
        if self._silent:
            return
        here = {page.title: page for page in TABS[self._find_tab(self.kind)]}
        self.open(here.get(event.new, self.kind))  # a hand-made message may contain any value

    @staticmethod
    def _find_tab(kind: type[Page]) -> str:
        return next(tab for tab, pages in TABS.items() if kind in pages)

    @contextmanager
    def _pause_events(self) -> Iterator[None]:
        self._silent = True
        try:
            yield
        finally:
            self._silent = False
