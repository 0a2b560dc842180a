"""Live: a stream of a sensor, shown and navigated with as it comes."""

from __future__ import annotations

from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG
from dashboards.devices import STATIONS
from dashboards.openings import end_later
from dashboards.pages.base import Page, plot_grid
from dashboards.pages.live.allan_part import AllanPart
from dashboards.pages.live.attitude_readout import AttitudeReadout
from dashboards.pages.live.attitudes_part import AttitudesPart
from dashboards.pages.live.axes_part import AxesPart
from dashboards.pages.live.errors_part import ErrorsPart
from dashboards.pages.live.inviting import Inviting, forget_phone, phone_station
from dashboards.pages.live.question_part import QuestionPart
from dashboards.pages.live.raw_part import RawPart
from dashboards.pages.live.recorder import Recorder
from dashboards.pages.live.source_fields import Chosen, SourceFields
from dashboards.pages.live.status_line import NO_SOURCE, StatusLine
from dashboards.pages.live.twin_part import TwinPart
from dashboards.pages.live.wanted import describe_difference
from dashboards.pages.live.watched import ABOVE, PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.pages.missions.job import Job
from dashboards.sending import together
from dashboards.session import Session
from dashboards.style import whole_column
from lab.data.streams.ring import Cursor
from lab.experiment.result import Result
from lab.live.live_state import HistoryCursor
from lab.live.owner import Visitor
from lab.live.station import Station
from lab.run.memory import give_back
from lab.views.figures import TimeAxis
from lab.views.live_figures import WINDOWS, LiveFigures

TICK = 50
"""Time between two updates of the plots [ms]: a third of the 150 ms from a sample to its picture."""
LOOK = 500
"""Time between two looks at what the visitor may watch and change [ms]."""
TELL = 10
"""Ticks for one update of the words."""
READ = 5
"""Ticks for one update of the large digits: four times a second can be read, and follows a hand."""
SLOWEST = 20
"""Most ticks for one update of the plots, a second: with twenty pages or more, or a browser that does not
answer, as a phone that sleeps."""
PHONE_KEY = "phone "
"""Before the number of a phone in the key of its station."""
PLOTS, ATTITUDES, ERRORS, AXES = "Plots", "Attitudes", "Errors", "Axes"
ALLAN, TWIN, RAW = "Allan", "Twin", "Raw"
"""What the page shows below the status."""
NOT_ANY_MORE = "This source is not shared with you any more. Choose another one."
"""Said to a visitor who may not watch any more."""
AWAY = 3.0
"""Length of the unplugging that a person may try [s]."""
_SMALL: dict[str, Any] = {"size": "small", "variant": "outlined", "margin": (10, 4)}


class Live(PartOfWatched, Page):
    """Streams: rates, forces, attitude, position and innovations as they come."""

    title = "Live"
    contents = "the streams and their plots"
    over_time = False
    depends_on_window = False

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        self._document = pn.state.curdoc
        self._cursors: tuple[int, HistoryCursor, Cursor] = (0, HistoryCursor(), Cursor())
        self._periodic: Any = None
        self._looking: Any = None
        self._ticks = 0
        self._told = self._read = 0  # ticks of the last updates of the words and of the large digits
        self._begun = 0  # how often the station had begun when the plots did
        self._waited = 0  # ticks for the browser to draw the last update
        self._visible = False
        self._closed = False
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the choice of a source, its state, and the plots."""
        self._fields = SourceFields(self._session)
        self._connect = pmui.Button(label="Connect", icon="sensors", color="primary", margin=(10, 4))
        self._connect.on_click(lambda _event: self._toggle())
        self._pause = pmui.Button(label="Pause", icon="pause", disabled=True, **_SMALL)
        self._pause.on_click(lambda _event: self._stop_or_go())
        self._unplug = pmui.Button(label=f"Unplug for {AWAY:g} s", icon="power_off", visible=False, **_SMALL)
        self._unplug.on_click(lambda _event: self._pull_plug())
        self._share = pmui.Switch(label="Share with the class", visible=False, margin=(14, 8), align="center")
        self._share.param.watch(lambda event: self._share_or_not(event.new), "value")
        self._window = pmui.Select(
            label="Shown",
            options=list(WINDOWS),
            value="20 s",
            size="small",
            margin=(8, 4),
            **layout_width(110),
        )
        self._window.param.watch(lambda event: self._widen(event.new), "value")
        self._readout = AttitudeReadout()
        self._status = StatusLine()
        self._job = Job()
        self._recorder = Recorder(self._session)
        self._inviting = Inviting()
        self._figures = LiveFigures()
        self._plots = plot_grid(self._figures.figures, 3, 205, beside=ABOVE)
        self._errors = ErrorsPart(WINDOWS["20 s"])
        self._attitudes = AttitudesPart(WINDOWS["20 s"], self._fill_again)
        self._axes, self._allan = AxesPart(), AllanPart(self._session)
        self._twin = TwinPart(self._session, lambda: self._allan.card)
        self._question = QuestionPart(self._keep_answer)
        self._parts: dict[str, Any] = {
            ATTITUDES: self._attitudes,
            ERRORS: self._errors,
            AXES: self._axes,
            ALLAN: self._allan,
            TWIN: self._twin,
            RAW: RawPart(),
        }
        self._choice = pmui.RadioButtonGroup(
            options=[PLOTS, *self._parts], value=PLOTS, size="small", margin=(10, 4), color="primary"
        )
        self._choice.param.watch(lambda _event: self._turn(), "value")
        self._stage = whole_column(self._plots)
        return whole_column(
            self._readout.view,
            self._status.view,
            self._status.details,
            self._question.view,
            self._fields.view,
            fields_row(*self._buttons(), *self._recorder.widgets, self._choice),
            self._job.view,
            self._inviting.view,
            self._recorder.view,
            self._stage,
            margin=(8, 8, 12, 8),
        )

    def _buttons(self) -> list[pn.viewable.Viewable]:
        return [self._connect, self._pause, self._unplug, self._share, self._window]

    def draw(self, result: Result) -> None:
        """Nothing: the stream does not depend on results."""

    def appear(self) -> None:
        """Begin to follow the stream."""
        self._visible = True
        self._fields.refresh()
        self._look_repeatedly()
        self._recorder.offer.follow()
        self._turn()

    def hide(self) -> None:
        """Stop following the stream, which goes on."""
        self._visible = False
        self._recorder.offer.rest()
        self._unwatch()
        self._look_repeatedly()
        self._stage[:] = []  # `appear` fills the plots before a browser has them

    def close(self) -> None:
        """Stop watching; the source ends with the last page that watches it."""
        self._closed = True
        self._periodic = self._looking = None  # they have ended with their document
        self._job.close()
        self._recorder.close()
        self._inviting.close()
        for part in self._parts.values():
            part.close()
        self._leave_station()

    def _turn(self) -> None:
        """Show the chosen part.

        Its plots are filled before they are laid out, and both are sent as one message: a browser that gets
        rows of a plot that it does not have yet drops them.
        """
        assert self._document is not None
        with together(self._document):
            if self._choice.value in (PLOTS, ATTITUDES, ERRORS) and self._station is not None:
                self._begin_anew()
            else:
                self._tell_part()
            # A hand-made message may contain any value.
            part = self._parts.get(str(self._choice.value))
            view = self._plots if part is None else part.view
            if self._stage.objects != [view]:
                self._stage[:] = [view]

    def _tell_part(self) -> None:
        """Renew the chosen part."""
        if part := self._parts.get(str(self._choice.value)):
            part.tell()

    def _show_parts_of(self, watched: Watched | None) -> None:
        for part in (*self._parts.values(), self._question):
            part.watch(watched)

    def _look_repeatedly(self) -> None:
        """Look at offers and rights now and then while the page is visible or watches, and else no more."""
        assert self._document is not None
        wanted = (self._visible or self._watched is not None) and not self._closed
        if wanted and self._looking is None:
            self._looking = self._document.add_periodic_callback(self._look, LOOK)
        elif not wanted and self._looking is not None:
            self._document.remove_periodic_callback(self._looking)
            self._looking = None

    def _look(self) -> None:
        """Follow what the visitor may do: a class begins and ends, an owner shares or does not."""
        if self._watched is None:
            self._fields.follow()
        elif self._watched.station is None:
            self._stop_watching()
        else:
            self._show_rights()
            if self._periodic is None:  # hidden or paused: a recording that ends all the same is not left
                self._recorder.tell(self._watched.station.status)

    def _show_rights(self) -> None:
        """Offer what the visitor may do with the source, and nothing else."""
        watched, station = self._watched, self._station
        plugged = station is not None and station.source.device is not None
        self._unplug.visible = plugged and watched is not None and watched.may_change
        self._share.visible = station is not None and watched is not None and watched.may_share
        if watched is not None and self._share.value != watched.is_shared:
            self._share.value = watched.is_shared
        self._axes.tell_rights()

    def _share_or_not(self, shared: Any) -> None:
        if self._watched is not None:
            self._watched.share(shared is True)  # a hand-made message may contain any value

    def _stop_watching(self) -> None:
        """Stop watching, because the visitor may not any more; what was drawn is removed."""
        assert self._document is not None
        with together(self._document):
            self._disconnect(NOT_ANY_MORE)
            self._figures.clear()

    def _toggle(self) -> None:
        if self._job.busy:
            return
        if self._watched is not None:
            self._disconnect("Disconnected.")
            return
        if self._inviting.waiting:
            self._inviting.end()
            self._invite_no_more(NO_SOURCE)
            return
        self._job.say("")
        self._recorder.clear()
        try:
            if self._fields.wants_phone:
                self._fields.settings()
                STATIONS.check_place(self._session.visitor())
                self._inviting.begin(
                    self._phone_came, lambda: self._invite_no_more("The invitation has expired.")
                )
                self._connect.label = "Cancel"
                self._status.say("Waiting for the phone that scans the code.")
                return
            chosen = self._fields.chosen()
        except ValueError as error:
            self._job.say(str(error))
            return
        self._start(chosen)

    def _invite_no_more(self, sentence: str) -> None:
        """Show that no phone is waited for."""
        self._connect.label = "Connect"
        self._status.say(sentence)

    def _phone_came(self, key: int, name: str) -> None:
        """Connect a phone that has scanned the QR code; if that is not possible, the phone is told."""
        self._invite_no_more(NO_SOURCE)
        try:
            experiment = self._fields.settings()
        except ValueError as error:
            self._job.say(str(error))
            forget_phone(key)
            return
        self._start(
            Chosen(
                f"{PHONE_KEY}{key}",
                lambda: phone_station(key, name, experiment.sensors, experiment.navigator),
                phone=key,
            )
        )

    def _start(self, chosen: Chosen) -> None:
        watcher = object()  # another for each connection: an earlier one may not have left yet
        visitor = self._session.visitor()
        self._job.start(
            "Connecting",
            lambda _progress: self._open_station(chosen, watcher, visitor),
            lambda opened: self._show_station(watcher, *opened),
        )

    def _open_station(
        self, chosen: Chosen, watcher: object, visitor: Visitor
    ) -> tuple[str, Station, list[str]]:
        """Return what `Chosen.open_station` does; in a thread."""
        try:
            key, station, differences = chosen.open_station(watcher, visitor)
            if differences and STATIONS.watchers(key) == 1:  # the others have just left
                _release_station(key, watcher)
                key, station, differences = chosen.open_station(watcher, visitor)
        except ValueError:
            if chosen.phone is not None:
                forget_phone(chosen.phone)
            raise
        if self._closed:  # meanwhile: nobody would leave it
            _release_station(key, watcher)
        return key, station, differences

    def _show_station(self, watcher: object, key: str, station: Station, differences: list[str]) -> None:
        if differences:
            others = STATIONS.watchers(key) - 1
            LONG.submit(_release_station, key, watcher)
            self._fields.offer_to_watch(key)
            self._job.say(describe_difference(station.name, differences, others), "warning")
            return
        self._watched = watched = Watched(key, watcher, station, self._session.visitor)
        assert self._document is not None
        end_later(self._document)
        self._connect.param.update(label="Disconnect", icon="sensors_off", color="default")
        self._pause.param.update(disabled=False, label="Pause", icon="pause")
        self._fields.view.visible = False  # they have no effect until the next source
        self._recorder.watch(watched)
        self._show_parts_of(watched)
        self._show_rights()
        self._look_repeatedly()
        self._begin_anew()

    def _disconnect(self, sentence: str) -> None:
        self._unwatch()
        self._recorder.watch(None)
        self._show_parts_of(None)
        self._leave_station()
        self._connect.param.update(label="Connect", icon="sensors", color="primary")
        self._pause.param.update(disabled=True, label="Pause", icon="pause")
        self._show_rights()
        self._look_repeatedly()
        self._fields.view.visible = True
        self._readout.clear()
        self._status.say(sentence)
        self._fields.refresh()

    def _leave_station(self) -> None:
        watched, self._watched = self._watched, None
        if watched is not None:
            # The last one who leaves waits for threads to end.
            LONG.submit(_release_station, watched.key, watched.watcher)

    def _begin_anew(self) -> None:
        """Fill the plots with what the station still has, and follow it."""
        assert self._document is not None
        self._unwatch()
        self._begun = 0 if self._station is None else self._station.begun
        self._cursors = (0, HistoryCursor(), Cursor())
        with together(self._document):
            self._figures.clear()
            self._errors.begin_anew()
            self._attitudes.begin_anew()
            self._advance()
        self._report()
        if self._visible and self._pause.label == "Pause":
            self._periodic = self._document.add_periodic_callback(self._refresh_page, TICK)

    def _unwatch(self) -> None:
        if self._periodic is not None and self._document is not None:
            self._document.remove_periodic_callback(self._periodic)
        self._periodic = None

    def _stop_or_go(self) -> None:
        """Pause the plots, or go on and catch up; the stream does not stop."""
        if self._pause.label == "Pause":
            self._unwatch()
            assert self._document is not None
            with together(self._document):  # the plots stand still once the button says so
                self._advance()
                self._pause.param.update(label="Go on", icon="play_arrow")
        else:
            self._pause.param.update(label="Pause", icon="pause")
            self._begin_anew()

    def _refresh_page(self) -> None:
        assert self._document is not None
        watched = self._watched
        if watched is None or watched.station is None:
            self._look()
            return
        self._ticks += 1
        if watched.station.begun != self._begun:
            self._begin_anew()
            return
        # Many who watch share the work of one: their pages take turns.
        turn = min(STATIONS.watchers(watched.key), SLOWEST)
        if self._ticks % max(turn, 1):
            return
        # A browser that is behind gets the next update later: updates that wait would only delay newer ones.
        parts: dict[str, ErrorsPart | AttitudesPart] = {ERRORS: self._errors, ATTITUDES: self._attitudes}
        taken = parts.get(str(self._choice.value), self._figures).taken
        self._waited = 0 if taken else self._waited + turn
        if 0 < self._waited < SLOWEST:
            return
        self._waited = 0
        with together(self._document):
            words = self._ticks - self._told >= TELL
            self._advance(whole=turn > 1, words=words)
            if words:
                self._told = self._ticks
                self._report()
            elif self._ticks - self._read >= READ:
                self._read = self._ticks
                self._readout.show(watched.station.state)

    def _advance(self, *, whole: bool = True, words: bool = True) -> None:
        """Append what came since the last tick to the plots that are shown.

        Parameters
        ----------
        whole, words
            Whether all plots, and numbers in words, are renewed.
        """
        station = self._station
        if station is None or self._choice.value == ERRORS:
            self._errors.advance()
            return
        if self._choice.value == ATTITUDES:
            self._attitudes.advance()
            return
        if self._choice.value != PLOTS:
            return
        thinned, history, ring = self._cursors
        thinned, rows = station.thinned.since(thinned)
        read = station.source.fixes_since(ring)
        self._figures.add_samples(rows, station.zero)
        told = station.history(history)
        if told is not None:
            history, shown = told
            self._figures.add_history(shown, station.zero)
        self._cursors = thinned, history, read.cursor
        self._figures.add_fixes(read.fix)
        self._figures.show(station.state, station.newest - station.zero, whole=whole, words=words)

    def _report(self) -> None:
        station = self._station
        if station is not None:
            status = station.status
            self._read = self._ticks
            self._readout.show(station.state, status.state)
            self._status.show(status, station.state, station.verdict, station.failure, station.name)
            self._recorder.tell(status)
            self._question.tell(status)
            self._tell_part()

    def _keep_answer(self, option: str, text: str) -> None:
        """Keep what was said of the source, for the next time that it is connected."""
        if self._station is not None:
            self._fields.keep(self._station.name, option, text)
            self._report()

    def _widen(self, name: str) -> None:
        window = WINDOWS.get(name, WINDOWS["20 s"])
        self._figures.widen(window)
        self._errors.widen(window)
        self._attitudes.widen(window)
        if self._station is not None:
            self._begin_anew()

    def _fill_again(self) -> None:
        if self._station is not None:
            self._begin_anew()

    def _pull_plug(self) -> None:
        watched, station = self._watched, self._station
        device = station.source.device if station is not None else None
        if device is not None and watched is not None and watched.may_change:
            device.unplug(AWAY)  # the device plugs itself in again: this page may be closed before


def _release_station(key: str, watcher: object) -> None:
    """Stop watching, and give the memory back; a phone that nobody watches any more is told."""
    ended = STATIONS.leave(key, watcher)
    give_back()
    if ended and key.startswith(PHONE_KEY):
        forget_phone(int(key.removeprefix(PHONE_KEY)))
