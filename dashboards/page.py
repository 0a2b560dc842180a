"""Page: the simulator as one page: settings, pages of plots, time cursor, messages."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import panel as pn
import param
from bokeh.events import DocumentReady
from panel_material_ui.template.base import Page as MaterialPage

from dashboards.address import Address, Shown
from dashboards.browser import Browser
from dashboards.browser_scripts import add_browser_scripts
from dashboards.drawn_pages import BY_TITLE, DrawnPages
from dashboards.exchange import Files
from dashboards.history import State
from dashboards.holding import Holding
from dashboards.kept import Change, Keeping, Kept
from dashboards.notice import Notice
from dashboards.openings import Openings
from dashboards.page_tabs import FIRST
from dashboards.page_template import page_frame
from dashboards.pages.lessons.lessons import Lessons
from dashboards.pages.missions import Missions
from dashboards.process_place import STREAMS, is_first
from dashboards.progress import ProgressText
from dashboards.query import VARIANCE, View, query, with_settings_of
from dashboards.seen_names import as_seen
from dashboards.sending import together
from dashboards.session import Session
from dashboards.settings_panel import SettingsPanel
from dashboards.share import Share
from dashboards.shortcuts import Shortcuts
from dashboards.stage import LINKED
from dashboards.style import FRAME, plain_column
from dashboards.teaching.bar_style import flash
from dashboards.teaching.class_bar import ClassBar
from dashboards.teaching.desk import Desk
from dashboards.teaching.moment import Moment, Place
from dashboards.time_bar import TimeBar
from dashboards.verdict_chip import VerdictChip
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.live.owner import Visitor
from lab.missions import Mission, missions
from lab.views.figures import TimeAxis

ZOOM_DEBOUNCE = 60
"""Quiet time after a zoom before the visible stretch is redrawn [ms]."""

HALF_STEP = 1e-3
"""Least distance of the next fix from the cursor [s]."""


class SimulatorPage:
    """One open page: creates its session, and ends it when the browser disconnects."""

    def __init__(self) -> None:
        document = pn.state.curdoc
        assert document is not None
        self.session = Session(document)
        self.axis = TimeAxis(hover=False)
        self._document = document
        self._browser = Browser(document)
        self._zooming, self._had_sidebar = False, True
        self._epoch = 0.0
        self._time_bar = TimeBar(self.axis, document, self._follow, self._add_outage, self.session)
        self._settings: SettingsPanel | None = None
        self._files: Files | None = None
        self._sidebar = plain_column()
        self._steps: list[Callable[[], None]] = []
        self._openings = Openings.of(document)
        self._closed = False
        self._progress = ProgressText(self.session)
        self._message = Notice(closeable=True, margin=(6, 8))
        self._reminder: Notice | None = None
        self._reminded = ""
        self._waiting_time: float | None = None
        self._waiting_beside = ""
        self._waiting_zoom: tuple[float, float] | None = None
        self._taken: Experiment | None = None
        self.pages = DrawnPages(
            self.session,
            document,
            self.axis,
            self._time_bar,
            self._turn,
            self._turn_aside,
            lambda: self.pages.draw in self._steps,
        )
        self._unheard: tuple[Change, ...] = ()
        self._address = Address(
            self.session,
            document,
            Shown(
                tuple(BY_TITLE),
                self._shown_view,
                self._place,
                self._restore,
                Keeping(self._kept, self._restore_kept),
            ),
        )
        self._class = ClassBar(self._desk())
        self._main = pn.Column(
            self.pages.tabs.view,
            self._class.view,
            self._message.view,
            self.pages.middle,
            self._time_bar.view,
            self.pages.sheet.view,
            sizing_mode="stretch_both",
            margin=0,
            stylesheets=[FRAME],
        )
        self._chip = VerdictChip(self.session, document, self._main)
        self._holding = Holding(self.session, self._address.bar)
        self._shortcuts = Shortcuts(
            self._address.bar,
            {
                "close": lambda _number: self.pages.close_aside(),
                "play": lambda _number: self._time_bar.toggle(),
                "step": self._step_to_fix,
                **{title: partial(self._open_linked, title) for title in LINKED},
            },
        )
        self._main.append(self._shortcuts.list)
        self._share = Share(
            self.session, self._address, self._main, lambda: (self.pages.open_page, self.axis.window)
        )
        self._listen()

    def _listen(self) -> None:
        """Follow the session, the tabs and the visible stretch of time."""
        self._time_bar.tools.param.watch(partial(self._share.give_samples, self.axis), "asked")
        self.session.prepare = self.pages.prepare
        self.session.go = self._open_page_at
        self.session.remind = self._remind
        self.session.acted = self._note_action
        self.session.visitor = self._visitor
        self.session.solved = self._class.solved
        self.session.keep = self._address.update
        self.session.param.watch(self._new_result, "result")
        self.session.param.watch(self._new_problem, "problem")
        self.session.param.watch(lambda _event: self._show_held(), "held")
        for edge in ("start", "end"):
            self.axis.range.on_change(edge, self._follow_zoom)

    def servable(self) -> None:
        """Put the page into the document of this session and compute the first result.

        A page alone is shown with its plots, and gets its settings once they are painted. While other pages
        are open or waiting, the page gets its frame first, then its plots and its settings part by part, so
        that no other session waits for all of it.
        """
        self._steps += [self.pages.draw, self._add_settings, self._add_files]
        view = self._address.view
        self._waiting_time, self._waiting_zoom, self.session.runs = view.time or None, view.zoom, view.runs
        self.session.shows_sigmas = view.noise != VARIANCE
        if view.tab in (Missions.title, Lessons.title):
            self._waiting_beside = view.tab
        else:
            self.pages.open(view.tab)
        self._waiting_beside = view.beside or self._waiting_beside
        self._address.read()
        if self._is_alone:
            if self._openings is not None:
                self.session.take_at_hand()
            self._steps.pop(0)()
        while self._steps and self._openings is None:
            self._steps.pop(0)()
        # The garbage of an ended page is found from these; Panel drops the second one with the document.
        self._view, self._known_to_panel = self._frame(), pn.state.browser_info
        self._view.param.watch(self._apply_theme, "dark_theme")
        if self._view.dark_theme:
            self._apply_theme()
        self._view.servable()
        pn.state.on_session_destroyed(partial(_close, self))
        add_browser_scripts(self._document)
        # A browser ignores changes that arrive before the requested document.
        self._document.on_event(DocumentReady, lambda _event: self._is_ready())
        chosen = missions().get(self.session.experiment.mission)
        if chosen is not None:
            self._name(chosen)
        if self.session.homework is not None:
            self.pages.made(Lessons)  # it reminds of the homework on all pages
            self.pages.dock.open()
        has_own = self.session.homework is not None or query(self.session.experiment) != ""
        self._class.open(self._address.query, pn.state.cookies, has_own=has_own)
        if self._class.problem:
            self.session.problem = "\n\n".join(filter(None, (self._class.problem, self.session.problem)))
        self._address.begin()

    def _desk(self) -> Desk:
        return Desk(
            session=self.session,
            document=self._document,
            page=lambda: self.pages.tabs.kind.title,
            time=lambda: self.axis.time,
            place=self._place,
            show=self._show_of_class,
            keep=self._address.keep_class,
            href=lambda: self._address.href,
            enlarge=self._enlarge_type,
            flash=lambda paths: flash(self._settings.views(paths)) if self._settings else None,
        )

    def _visitor(self) -> Visitor:
        return self._browser.visitor(self._class.code, teaches=self._class.teaches)

    def _place(self) -> Place | None:
        return self.pages.lessons.place if self.pages.lessons is not None else None

    def _shown_view(self) -> View:
        """Return what the page shows of its result, or will show once it is there."""
        time = self.axis.time if self._waiting_time is None else self._waiting_time
        start, end = self.axis.window
        zoom = None if start <= 0 and end >= self.axis.duration else (start, end)
        tab = "" if self.pages.tabs.kind is FIRST else self.pages.tabs.kind.title
        is_open = [one.kind.title for one in (self.pages.sheet, self.pages.dock) if one.is_open]
        beside = is_open[0] if is_open else self._waiting_beside
        noise = "" if self.session.shows_sigmas else VARIANCE
        return View(tab, time, self._waiting_zoom or zoom, self.session.runs, beside, noise)

    def _kept(self) -> Kept:
        """Return what the browser stores of the page besides its address."""
        kept = self._class.kept()
        return self.pages.kept(kept)

    def _restore_kept(self, kept: Kept, is_same: bool) -> None:
        """Show what the browser had stored; the open step belongs to the address of then."""
        self._class.take_back(kept)
        self._unheard = kept.unheard
        self._repeat()
        if kept.compared and is_same:
            self.pages.compare_again(kept.compared)
        if kept.solved or kept.typed or (kept.place and is_same):
            lessons = self.pages.made_lessons()
            lessons.take_back(kept)
            if kept.place and is_same and not self._class.follows:
                self._restore_place(lessons, kept)

    def _repeat(self) -> None:
        """Change the settings that the server had not heard when the connection was cut, if they are here."""
        if self._settings is not None:
            unheard, self._unheard = self._unheard, ()
            for change in unheard:
                self._settings.repeat(*change)

    def _restore_place(self, lessons: Lessons, kept: Kept) -> None:
        was_open = self.pages.dock.is_open or self._address.view.beside == Lessons.title
        state = self._address.state(hidden=lessons.fault_of(kept) if kept.hides else "")
        self._address.bring_back(state._replace(place=kept.place))
        if not was_open:
            self.pages.dock.close()

    def _show_of_class(self, moment: Moment) -> None:
        """Show what another page of the class shows."""
        with self._address.of_a_class():
            self._show_moment(moment)
            self._address.notes.take_given(moment.notes)

    def _restore(self, state: State, experiment: Experiment) -> None:
        """Show a state of the history with its settings; time, visible stretch and number of runs stay."""
        lessons = self.pages.go_to_step(state.place)
        begun = lessons.hiding(state.hidden) if lessons is not None and state.hidden else None
        if begun is not None:
            experiment = with_settings_of(begun, experiment)
        tab, time = state.tab or FIRST.title, self._shown_view().time
        self._show_moment(Moment(experiment, tab, time, state.place))

    def _show_moment(self, moment: Moment) -> None:
        """Show what a page shows: settings, step of a lesson, tab and time."""
        experiment = moment.experiment
        with together(self._document):
            lessons = self.pages.go_to_step(moment.place)
            hides = lessons is not None and lessons.hiding(experiment.hidden) is not None
            if experiment.hidden and not hides:  # its lesson is not there any more
                experiment = Experiment().update(experiment.to_dict())
            if moment.experiment is not self._taken:
                if not moment.has_settings_of(self.session.experiment):
                    self._accept(experiment.copy(), moment)
                self._taken = moment.experiment
            self.pages.open(moment.page)
            if moment.time != self._shown_view().time:
                self._time_bar.go(moment.time)

    def _accept(self, experiment: Experiment, moment: Moment) -> None:
        """Take settings over; the time waits for their result, which may be of a longer flight."""
        self._waiting_time = moment.time
        try:
            self.session.accept(experiment, moment.result)
        except SettingError as error:
            self.session.problem = str(error)

    def _enlarge_type(self, on: bool) -> None:
        """Turn large type for a projector on, which also closes the settings, or off."""
        if on:
            self._had_sidebar = self._view.sidebar_open
        self._view.sidebar_open = self._had_sidebar and not on
        self.pages.enlarge(on)

    def _frame(self) -> MaterialPage:
        return page_frame(
            header=[
                self.pages.sheet.button,
                self._chip.view,
                self._progress.view,
                self._address.bar,
                self._holding.button,
                self._share.view,
                self.pages.dock.button,
                self._shortcuts.button,
            ],
            sidebar=self._sidebar,
            main=self._main,
        )

    def _is_ready(self) -> None:
        """Open what a link opens beside the tabs, whose parts ask the server as they appear; go on."""
        title, self._waiting_beside = self._waiting_beside, ""
        if title:
            self.pages.open(title)
        self._request_next_step()

    def _request_next_step(self) -> None:
        """Request the turn for the next step of the opening."""
        if self._steps and self._openings is not None:
            self._openings.later(self._document, self._take_step)

    def _take_step(self) -> None:
        """Run the next step of the opening: one message, after one search for new models.

        A page alone runs all steps that are left: its browser lays the page out once for them.
        """
        if self._closed or not self._steps:
            return
        try:
            with together(self._document), self._document.models.freeze():
                self._steps.pop(0)()
                while self._steps and self._is_alone:
                    self._steps.pop(0)()
        finally:
            self._request_next_step()

    @property
    def _is_alone(self) -> bool:
        """Whether no other page is open in a browser or waiting for its turn."""
        return self._openings is None or not self._openings.is_crowded(self._document)

    def _apply_theme(self, *_events: param.parameterized.Event) -> None:
        self.pages.dress(bool(self._view.dark_theme))

    def _add_settings(self) -> None:
        self._settings = SettingsPanel(self.session, self._steps.append)
        self._sidebar.append(self._settings.view)
        self._repeat()

    def _add_files(self) -> None:
        self._files = Files(self.session, self._address.held)
        self._sidebar.append(self._files.view)

    def close(self) -> None:
        """End the session."""
        self._closed = True
        self._time_bar.close()
        self._class.close()
        self._chip.close()
        self._share.close()
        self._address.held.close()
        self.session.close()
        if self._files is not None:
            self._files.close()
        self.pages.close()

    def _note_action(self) -> None:
        """Note that settings or the step of a lesson were changed, by a person or for a class."""
        self._taken = None
        self._address.moved()
        self._class.acted()

    def _turn(self) -> None:
        """Show the page of a tab that was opened, by a person or for a class."""
        if self.pages.tabs.kind.title == STREAMS and not is_first():
            self._address.moved()
            self._address.move()
            return
        with together(self._document):  # what a page sends as it appears must not overtake the page
            self.pages.draw_if_begun()
        self._address.moved()
        self._class.acted()

    def _turn_aside(self) -> None:
        self._show_reminder()
        self._address.update()

    def _show_held(self) -> None:
        """Draw the held results on the page that is open, and on the others once they are opened."""
        with together(self._document):
            if self._holding.bar not in self._main.objects:
                self._main.insert(self._main.objects.index(self.pages.middle), self._holding.bar)
            self.pages.draw_all_again()

    def _name(self, mission: Mission) -> None:
        """Write the title of a mission on the button that opens the missions."""
        self.pages.sheet.button.label = mission.title or mission.name

    def _new_result(self, event: param.parameterized.Event) -> None:
        result: Result | None = event.new
        if result is None:
            self.pages.release()
            return
        self._epoch = result.epoch
        self.pages.tabs.dim(result)
        self._name(result.mission)
        self.axis.span(float(result.time[-1]))
        outages = result.experiment.sensors.gps.outages
        self.axis.show_outages([(start - result.epoch, end - result.epoch) for start, end in outages])
        self._time_bar.span()
        if self._waiting_zoom is not None:
            self.axis.show(*self._waiting_zoom)
            self._waiting_zoom = None
        if self._waiting_time is not None:
            self._time_bar.go(self._waiting_time)
            self._waiting_time = None
        self.pages.draw_if_begun()

    def _add_outage(self, start: float, end: float) -> None:
        """Add a GPS outage at times of the plots."""
        self.session.take_gps_away(start + self._epoch, end + self._epoch)

    def _open_page_at(self, title: str | None, time: float | None) -> None:
        """Open a page, and move the cursor to a time; see `Session`."""
        self.pages.open(self.pages.tabs.kind.title if title is None else title)
        if time is not None:
            self._time_bar.go(time - self._epoch)

    def _step_to_fix(self, by: int) -> None:
        """Move the cursor to the next fix, or to the one before."""
        result = self.session.result
        if result is None or not self._time_bar.view.visible:
            return
        times: FloatArray = result.gps["time_gps"].values
        index = int(np.searchsorted(times, self.axis.time + by * HALF_STEP)) - (by < 0)
        if 0 <= index < len(times):
            self._time_bar.go(float(times[index]))

    def _open_linked(self, title: str, _number: int) -> None:
        """Open a page by a link in a sentence."""
        self.pages.open(title)

    def _remind(self, sentence: str) -> None:
        """Show a sentence above all pages but the lessons, until it is empty."""
        self._reminded = sentence
        self._show_reminder()

    def _show_reminder(self) -> None:
        words = "" if self.pages.dock.is_open else self._reminded
        if self._reminder is None:
            if not words:
                return
            self._reminder = Notice(margin=(6, 8))
            self._main.insert(2, self._reminder.view)
        if words != self._reminder.text:
            self._reminder.say(words, "info")

    def _follow(self, time: float) -> None:
        if not self._time_bar.plays:
            self._address.update()
        self.pages.draw_time(time)

    def _new_problem(self, event: param.parameterized.Event) -> None:
        self._message.say(as_seen(event.new))

    def _follow_zoom(self, _attr: str, _old: object, _new: object) -> None:
        self._address.update()
        if not self._zooming:
            self._zooming = True
            self._document.add_timeout_callback(self._draw_window, ZOOM_DEBOUNCE)

    def _draw_window(self) -> None:
        self._zooming = False
        with together(self._document):
            self.pages.draw_if_begun()


def _close(page: SimulatorPage, _context: object) -> None:
    page.close()
    if page._openings is not None:
        page._openings.let_go(page, page._document)
