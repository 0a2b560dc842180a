"""Overview: at a glance where the flight went, how good its navigation is, and what to do next."""

from __future__ import annotations

from html import escape
from typing import NamedTuple
from urllib.parse import parse_qsl, urlencode

import panel as pn
import param
from bokeh.models.tickers import BasicTicker

from dashboards.history import change_in_words
from dashboards.overview_head import OverviewHead, TrackSwitch
from dashboards.pages.base import AROUND, NARROW, Page
from dashboards.pages.computed import ComputedPage
from dashboards.pages.log_checks import LogChecks
from dashboards.pages.view_3d import View3D
from dashboards.query import query
from dashboards.session import OUTAGES, Session
from dashboards.settings_panel import may_change
from dashboards.widgets import SETTING
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.figures import TimeAxis
from lab.views.overview import BY_INNOVATIONS, OVERVIEW, Number, describe_run, key_figures
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import TimePlot
from lab.views.track import TrackFigure

Q_SCALE = "navigator.q_scale"
OUTAGE = 20.0
"""Length of the outage of the first button, in the middle of the flight [s]."""
FOOLED = 0.1
"""By what the second button multiplies Q."""
MOST_SETTINGS = 6
"""Most settings that differ from the defaults and are named."""

_TRACK = 2
"""Number of the track among the parts of the page."""
LEAST = 125
"""Least height of a plot [px]."""

_GRID = f"""
:host {{
  display: grid !important; gap: 8px; min-height: calc(var(--print-height, 100vh) - {AROUND}px) !important;
  height: auto !important; grid-template-columns: minmax(0, 5fr) minmax(0, 6fr);
  grid-template-rows: max-content max-content minmax({3 * LEAST + 16}px, 3fr) minmax({LEAST}px, 1fr);
  grid-template-areas: "head head" "words words" "track plots" "nis nis" "checks checks";
  grid-auto-rows: max-content;
}}
:host > .head {{ grid-area: head; }}
:host > .words {{ grid-area: words; }}
:host > .track {{ grid-area: track; }}
:host > .switch {{ grid-area: track; place-self: start; margin-left: 190px !important; z-index: 2; }}
:host > .in-3d {{ grid-area: track; padding-top: 24px; }}
:host > .plots {{ grid-area: plots; }}
:host > .nis {{ grid-area: nis; }}
:host > .checks {{ grid-area: checks; }}
.scroll-button {{ display: none !important; }}
@container stage (max-width: {NARROW}px) {{
  :host {{
    grid-template-columns: minmax(0, 1fr); grid-template-rows: max-content max-content 560px 380px 180px;
    grid-template-areas: "head" "words" "plots" "track" "nis" "checks";
  }}
}}
"""
_PLOTS = ":host { display: flex; flex-direction: column; gap: 8px; min-height: 0 !important; }"
_IN_3D = """
:host { display: flex !important; flex-direction: column; height: auto !important; min-height: 0 !important; }
:host > .frame { flex: 1 1 auto !important; min-height: 200px !important; }
"""
_WORDS = "p { margin: 0; font: 13px/1.4 Roboto, sans-serif; opacity: .8; }"


class _Beside3D(View3D):
    """The flight in three dimensions, in the place of the track."""

    # A narrow frame would have the controls of a phone over the scene: it is made smaller instead.
    frame_style = """
    :host { position: relative; }
    iframe { border: 0; position: absolute; inset: 0; width: 100%; height: 100%; border-radius: 6px; }
    @container stage (max-width: 1300px) {
      iframe { width: 166.7%; height: 166.7%; transform: scale(0.6); transform-origin: 0 0; }
    }
    """


class _Content(NamedTuple):
    """What is computed for a result."""

    sentences: str
    numbers: list[Number]


class Overview(ComputedPage):
    """The track, the errors and NIS, six figures, and the settings that differ from the defaults.

    Of a log without reference, the innovations take the place of the errors. The plots are drawn at once, and
    the figures follow.
    """

    title = "Overview"
    contents = "the track, the errors and the innovations of this flight"
    depends_on_window = True

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        super().__init__(axis)
        session.param.watch(lambda _event: self._paint_again(), "shows_sigmas")

    def make(self) -> pn.viewable.Viewable:
        """Return the layout with the plots for known errors."""
        self._head = OverviewHead(self._pressed, css_classes=["head"], margin=0, tags=[SETTING])
        self._track = TrackFigure()
        self._track.figure.update(min_height=LEAST, css_classes=["track"])
        self._figures: dict[tuple[TimePlot, ...], TimeFigures] = {}
        self._shown = OVERVIEW
        self._checks: LogChecks | None = None
        self._scene: View3D | None = None
        self._dark = False
        self._switch = TrackSwitch(css_classes=["switch"], margin=0)  # type: ignore[no-untyped-call]
        self._switch.param.watch(self._switched, "is_3d")
        self.words.param.update(css_classes=["words"], margin=(0, 4), stylesheets=[_WORDS])
        return pn.Column(*self._parts(), sizing_mode="stretch_both", stylesheets=[_GRID], margin=(6, 8))

    def _drawn_by(self, plots: tuple[TimePlot, ...]) -> TimeFigures:
        """Return the figures of some plots; they are made when first shown."""
        if plots not in self._figures:
            self._figures[plots] = TimeFigures(plots, self.axis, buckets=500)
            for fig in self._figures[plots].figures:
                fig.min_height = LEAST
                if isinstance(fig.yaxis[0].ticker, BasicTicker):
                    fig.yaxis[0].ticker.desired_num_ticks = 4
        return self._figures[plots]

    def _parts(self) -> list[pn.viewable.Viewable]:
        """Return the parts of the page in reading order."""
        *beside, nis = self._drawn_by(self._shown).figures
        nis.css_classes = ["nis"]
        *panes, below = (pn.pane.Bokeh(fig, sizing_mode="stretch_both", margin=0) for fig in (*beside, nis))
        plots = pn.Column(
            *panes, sizing_mode="stretch_both", margin=0, css_classes=["plots"], stylesheets=[_PLOTS]
        )
        parts = [self._head, self.words, self._seen_track(), self._switch, plots, below]
        if self._shown is BY_INNOVATIONS:
            if self._checks is None:
                self._checks = LogChecks(self.axis, lambda: self._session.go("Verdict", None))
                self._checks.view.css_classes = ["checks"]
            parts.append(self._checks.view)
        return parts

    def _seen_track(self) -> pn.viewable.Viewable:
        """Return the track, or the flight in three dimensions."""
        if self._scene is not None:
            return self._scene.view
        return pn.pane.Bokeh(self._track.figure, sizing_mode="stretch_both", margin=0)

    def _switched(self, event: param.parameterized.Event) -> None:
        """Show the flight in three dimensions, of which nothing is kept once the track is shown again."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None
        if event.new:
            self._scene = _Beside3D(self.axis)
            self._scene.dress(self._dark)
            self._scene.draw_again = self.draw_again
            self._scene.held = self.held
            self._scene.view.param.update(css_classes=["in-3d"], stylesheets=[_IN_3D])
        self.view[_TRACK] = self._seen_track()
        self.draw_again()

    def prepare(self, result: Result) -> None:
        """Compute the data of the plots, if the result needs no others."""
        if self._scene is not None:
            self._scene.prepare(result)
        if _plots_of(result) == self._shown:
            self._drawn_by(self._shown).prepare(result)

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time, and compute its figures."""
        shown, self._shown = self._shown, _plots_of(result)
        self._drawn_by(self._shown).show(result, self.held())
        if self._scene is None:
            self._track.show(result, self.axis.time, self.held())
        else:
            self._scene.show(result)
        if shown != self._shown:
            self.view[:] = self._parts()
        super().draw(result)
        if self._checks is not None:
            if self._shown is BY_INNOVATIONS:
                self._checks.show(result)
            else:
                self._checks.hide()
                self._checks.release()

    def say(self, text: str) -> None:
        """Show a problem; the figures of the result before stay until the new ones are there."""
        if text != self.working:
            super().say(text)

    def work_out(self, result: Result, _progress: Progress) -> _Content:
        """Compute the figures."""
        return _Content(describe_run(result), key_figures(result))

    def clear(self) -> None:
        """Show no figures."""
        self._head.fill("", [], [])

    def paint(self, result: Result, content: _Content) -> str:
        """Show the figures; return the settings that differ."""
        numbers = [(one.page, one.value, one.label, one.step) for one in content.numbers]
        keyed = [(f"{number} {page}", *rest) for number, (page, *rest) in enumerate(numbers)]
        self._head.fill(content.sentences, self._actions(), keyed)
        return settings_html(result.experiment, self._session.shows_sigmas)

    def _paint_again(self) -> None:
        if self._content is not None:
            self._paint(*self._content)

    def release(self) -> None:
        """Refer to no result any more; what is drawn stays."""
        super().release()
        self._track.release()
        for part in self._further:
            part.release()

    @property
    def _further(self) -> list[Page]:
        """The parts that are pages themselves."""
        return [part for part in (self._checks, self._scene) if part is not None]

    def forget(self) -> None:
        """Redraw at the next occasion, with all parts."""
        super().forget()
        for part in self._further:
            part.forget()

    def dress(self, dark: bool) -> None:
        """Follow the theme, which the scene does not by itself."""
        self._dark = dark
        if self._scene is not None:
            self._scene.dress(dark)

    def hide(self) -> None:
        """End the checks that nobody waits for."""
        if self._checks is not None:
            self._checks.hide()

    def close(self) -> None:
        """End all work."""
        super().close()
        for part in self._further:
            part.close()

    def show_time(self, time: float) -> None:
        """Mark the aircraft."""
        if self._scene is None:
            self._track.show_time(time)
        else:
            self._scene.show_time(time)

    def _actions(self) -> list[tuple[str, str]]:
        """Return the buttons, without those whose settings a homework locks."""
        experiment, offered = self._session.experiment, []
        for key, label, path in (
            ("outage", f"Take away GPS for {OUTAGE:g} s", OUTAGES),
            ("fool", f"Fool the filter (Q × {FOOLED:g})", Q_SCALE),
        ):
            if may_change(experiment, path):
                offered.append((key, label))
        if not experiment.hidden:
            offered.append(("lesson", "A first lesson"))
        return offered

    def _pressed(self, key: str) -> None:
        """Do what a button says, unless it is not offered."""
        offered = {one for one, _label in self._actions()}
        page = key.partition(" ")[2]
        if key == "lesson" and key in offered:
            self._session.go("Lessons", None)
        elif key == "fool" and key in offered:
            self._session.change_shown(Q_SCALE, FOOLED * self._session.experiment.get(Q_SCALE))
        elif key == "outage" and key in offered and self._wanted is not None:
            middle = self._wanted.epoch + float(self._wanted.time[0] + self._wanted.time[-1]) / 2
            self._session.take_gps_away(middle - OUTAGE / 2, middle + OUTAGE / 2)
        elif page and self._content is not None and page in {one.page for one in self._content[1].numbers}:
            self._session.go(page, None)


def _plots_of(result: Result) -> tuple[TimePlot, ...]:
    return BY_INNOVATIONS if result.missing_reason("errors") else OVERVIEW


def settings_html(experiment: Experiment, sigmas: bool) -> str:
    """Return which settings differ from the defaults, from what to what, as their fields show it."""
    changed = [one for one in parse_qsl(query(experiment)) if one[0] != "mission"]
    if not changed:
        return "All settings have their defaults."
    named = [change_in_words("", urlencode([one]), sigmas) for one in changed[:MOST_SETTINGS]]
    more = [f"{len(changed) - MOST_SETTINGS} more"] if len(changed) > MOST_SETTINGS else []
    return f"<b>Settings that differ:</b> {escape('; '.join([*named, *more]))}"
