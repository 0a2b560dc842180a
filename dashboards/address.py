"""Address: the address of a page and the history of its browser: both follow what the page shows."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

import panel as pn
import param
from bokeh.document import Document
from bokeh.events import DocumentReady
from panel.custom import JSComponent

from dashboards.classroom import shelf
from dashboards.ending import before_the_end
from dashboards.held_links import HeldLinks
from dashboards.history import History, State
from dashboards.kept import Keeping, brought_back
from dashboards.notes import Notes, query_of_notes
from dashboards.query import (
    HOMEWORK,
    THEME,
    View,
    experiment_of_query,
    homework_of_query,
    query,
    query_of_view,
    view_of_query,
)
from dashboards.session import Glide, Session
from dashboards.teaching.class_link import FIELD
from dashboards.teaching.moment import Place
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.missions import MissionError, missions

SOON, PERIOD = 50, 500
"""Time until a change is in the address, so that a reload keeps it, and the same while a setting changes all
the time, as with a slider [ms]."""
AT_ONCE, OF_LATE = 8, 10.0
"""Most updates within a time [s] before they become rare: more changes are those of a slider, and a browser
accepts a hundred entries in its history in 30 s."""
AFTER = 50
"""Time from a question to its answer [ms]: as long as Panel waits before it handles a change."""
LONGEST = 8192
"""Longest query with held results [characters]: servers and mail programs cut longer addresses."""
OF_A_CLASS = Glide("class", 0)
"""All that a page takes over from a class is one change."""


_STYLE = """
div { display: flex; }
button { width: 36px; height: 36px; padding: 6px; border: 0; border-radius: 50%;
         background: none; color: #ffffff; cursor: pointer; }
button:hover { background: rgba(255, 255, 255, .12); }
button:focus-visible { outline: 2px solid #ffffff; outline-offset: -2px; }
button:disabled { opacity: .4; background: none; cursor: default; }
svg { display: block; width: 24px; height: 24px; fill: currentColor; }
@media (max-width: 480px) {
  :host { width: 60px !important; flex-basis: 60px !important; }
  button { width: 30px; padding: 6px 3px; }
}
"""


class Shown(NamedTuple):
    """Ways to what a page shows.

    Attributes
    ----------
    tabs : collection of str
        Titles of the tabs.
    view : callable
        Returns what the page shows of its result.
    place : callable
        Returns the open step of a lesson; None without one.
    restore : callable
        Makes the page show a state of its history, with an experiment that has its settings.
    keeping : Keeping
        Ways to what the browser stores besides the address.
    """

    tabs: Collection[str]
    view: Callable[[], View]
    place: Callable[[], Place | None]
    restore: Callable[[State, Experiment], None]
    keeping: Keeping


class HistoryBar(JSComponent):
    """Two buttons and the keys of the page; the history of the browser follows what is shown."""

    shown: dict[str, Any] = param.Dict(
        {"pushed": [], "position": 0, "search": "", "oldest": 0, "undone": "", "redone": ""}
        | {"undos": 0, "beyond": 0, "count": 0, "moves": False},
        doc="Number and query of new entries, number and query of the present one, number of the oldest one, "
        "names of what undo and redo change, how many undos were asked for, for how many of them this page "
        "has nothing, a count, and whether the page is then loaded again.",
    )
    kept: str = param.String("", doc="What the browser stores besides the address.")
    brought: str = param.String("", doc="What it had stored, and whether the address is that of then.")
    asked: list[Any] = param.List([], doc="The last wishes: the number of each, what, and a number with it.")
    question: int = param.Integer(0, doc="Number of the last question whether all before it has been heard.")
    answered: int = param.Integer(0, doc="The last question that was answered.")

    _esm = Path(__file__).with_name("history_bar.js")
    _stylesheets = [_STYLE]  # noqa: RUF012 - Panel's own

    def __init__(self, **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self._acts: list[Callable[[str, int], None]] = []
        self._heard = 0  # number of the last wish
        self.param.watch(self._follow_wishes, "asked")
        self.param.watch(self._answer_question, "question")

    def hear(self, act: Callable[[str, int], None]) -> None:
        """Call a function with each wish ("undo", "tab", ...) and the number that belongs to it."""
        self._acts.append(act)

    def _answer_question(self, event: param.parameterized.Event) -> None:
        """Answer in a later turn: what changed before the question may have its own turn still ahead."""
        document = pn.state.curdoc
        assert document is not None
        document.add_timeout_callback(lambda: setattr(self, "answered", event.new), AFTER)

    def _follow_wishes(self, event: param.parameterized.Event) -> None:
        """Do what was asked since the last time: several wishes may arrive at once."""
        for wish in event.new:
            match wish:
                # The browser sends its last wishes again with each new one; anything of another form is from
                # no page of ours.
                case [int(count), str(what), int(number)] if count > self._heard:
                    self._heard = count
                    for act in self._acts:
                        act(what, number)


class Address:
    """Keeps the settings and the view of a page in its address, and its changes in a history.

    Parameters
    ----------
    session
        The session, whose changes of settings are recorded.
    document
        Its document.
    shown
        What the page shows.

    Attributes
    ----------
    bar : HistoryBar
        The buttons Undo and Redo, to place on the page.
    held : HeldLinks
        The held results in the address.
    notes : Notes
        The notes in the address.
    search : str
        The query in the address, with its question mark; empty without one.
    """

    def __init__(self, session: Session, document: Document, shown: Shown) -> None:
        self._session = session
        self._document = document
        self._shown = shown
        self._location = pn.state.location
        self.search = str(self._location.search) if self._location is not None else ""
        self.bar = HistoryBar(margin=(6, 0), width=76, height=36)
        self.bar.hear(self._act)
        self.bar.param.watch(self._take_brought, "brought")
        self.held = HeldLinks(session, document)
        self.notes = Notes(session)
        self._history = History(self.state())
        self._undos = self._beyond = 0  # undos asked for, and those of them that lead past the first state
        self._waits = False  # for the next update
        self._moves = False  # to another process of the server
        self._walking = self._has_brought = False
        self._of_a_class: Glide | None = None
        self._updates: deque[float] = deque(maxlen=AT_ONCE)
        """When the last updates were [s]."""
        self._code, self._keeps_settings = "", True
        self._theme = ""
        session.record = self._record
        watched = ["result", "runs", "held", "notes", "shows_sigmas"]
        session.param.watch(lambda _event: self.update(), watched)
        # A browser ignores changes that arrive before the requested document.
        document.on_event(DocumentReady, lambda _event: self.update())
        before_the_end(document, self._write)

    @property
    def query(self) -> str:
        """The query of the address."""
        return self.search.removeprefix("?")

    @property
    def href(self) -> str:
        """The address with which the page was opened; empty without a browser."""
        return str(self._location.href) if self._location is not None else ""

    @property
    def view(self) -> View:
        """What the page shows according to its address."""
        return view_of_query(self.query, self._shown.tabs)[0]

    def keep_class(self, code: str, keeps_settings: bool) -> None:
        """Keep the code of a class in the address, none if it is empty, and the settings beside it or not."""
        if (code, keeps_settings) != (self._code, self._keeps_settings):
            self._code, self._keeps_settings = code, keeps_settings
            self.update()

    def read(self) -> None:
        """Apply the settings in the address; report those that are not accepted."""
        theme = re.search(rf"(?:^|&){THEME}=(dark|default)(?:&|$)", self.query)
        self._theme = theme[1] if theme else ""
        name, rest = homework_of_query(self.query)
        trial, problems = experiment_of_query(rest)
        problems += view_of_query(rest, self._shown.tabs)[1] + self.held.take_link(rest, LONGEST)
        if name:
            self._session.homework = shelf().find(name)
            if self._session.homework is None:
                problems.append(f"There is no homework {name[:40]!r} on this server. Ask your teacher.")
            else:
                trial = self._session.homework.taking(trial)
                self._session.go("Lessons", None)
        try:
            self._session.accept(trial)
        except SettingError as error:  # there is no such mission: the rest of the link is taken
            problems.append(str(error))
            trial.mission = self._session.experiment.mission
            self._session.accept(trial)
        problems += self.notes.bring(rest)
        self._session.problem = "\n\n".join(problems)

    def begin(self) -> None:
        """Begin the history with what the page shows."""
        self._history = History(self.state())
        self.update()

    @contextmanager
    def of_a_class(self) -> Iterator[None]:
        """Record what is changed inside as taken over from a class."""
        before, self._of_a_class = self._of_a_class, OF_A_CLASS
        try:
            yield
        finally:
            self._of_a_class = before

    def moved(self) -> None:
        """Take notice of another tab, or another step of a lesson, which is no change of the experiment."""
        place, tab = self._shown.place(), self._shown.view().tab
        self._history.amend(self._history.present._replace(tab=tab, place=place))
        self.update()

    def move(self) -> None:
        """Have the browser load the page again: its address belongs to another process of the server."""
        self._moves = True
        self.update()

    def bring_back(self, state: State) -> None:
        """Show a state that the page had before it was loaded again; it is no change."""
        self._restore(state)
        self.update()

    def update(self) -> None:
        """Write what the page shows into the address, soon."""
        if not self._waits:
            self._waits = True
            of_late = [one for one in self._updates if time.monotonic() - one < OF_LATE]
            # Browsers refuse addresses that change too often: a slider makes tens of updates a second.
            due = SOON if len(of_late) < AT_ONCE else PERIOD
            self._document.add_timeout_callback(self._write, due)

    def state(self, hidden: str = "") -> State:
        """Return what the page shows; what is hidden may be named, as `Experiment.hidden` does."""
        experiment = self._session.experiment
        notes = query_of_notes(self._session.notes, experiment.mission)
        hidden = hidden or experiment.hidden
        return State(query(experiment), hidden, self._shown.view().tab, self._shown.place(), notes)

    def _record(self, called: str, glide: Glide | None) -> None:
        """Note a change of settings in the history."""
        if not self._walking:
            self._history.record(self.state(), called, glide or self._of_a_class)

    def _take_brought(self, event: param.parameterized.Event) -> None:
        """Take what the browser had stored, once."""
        if self._has_brought:
            return
        self._has_brought = True
        kept, is_same = brought_back(event.new)
        self._shown.keeping.take(kept, is_same)
        self.update()

    def _act(self, what: str, position: int) -> None:
        """Do what a person asked for; an entry of the browser's history is named by its number."""
        steps = {"undo": self._history.position - 1, "redo": self._history.position + 1, "visit": position}
        if what not in steps:  # a key that is no matter of the history
            return
        if what == "undo":
            self._undos += 1
            # Nothing of this page is left to undo: the browser goes back to what it showed before.
            self._beyond += self._history.position == 0
        state = self._history.visit(steps[what])
        if state is not None:
            self._restore(state)
        self.update()

    def _restore(self, state: State) -> None:
        """Show a state of the history; a mission that is gone is replaced by the present one."""
        experiment, _ = experiment_of_query(state.settings)
        mission = experiment.mission
        gone = mission not in missions() and not self._is_back(mission)
        if gone:
            experiment.mission = self._session.experiment.mission
        # What the restored state changes in the session is not recorded as a new change.
        self._walking = True
        try:
            self._shown.restore(state, experiment)
        finally:
            self._walking = False
        # The notes belong to the mission: those of one that is gone stay away.
        if not gone:
            self.notes.bring(state.notes)
        self._history.amend(self.state())
        if gone:
            self._session.problem = f"The mission {mission!r} is not there any more. All else is restored."

    def _is_back(self, mission: str) -> bool:
        """Bring a mission back that was deleted on this page; return whether it is there again."""
        try:
            return self._session.bring_back(mission)
        except MissionError:  # another one has its place
            return False

    def _write(self) -> None:
        self._waits = False
        self._updates.append(time.monotonic())
        history = self._history
        history.sigmas = self._session.shows_sigmas
        self.search = self._search(history.present)
        self.bar.kept = self._shown.keeping.parts().text
        self.bar.shown = {
            "pushed": [[number, self._search(made)] for number, made in history.take_new()],
            "position": history.position,
            "search": self.search,
            "oldest": history.oldest,
            "undone": history.undone,
            "redone": history.redone,
            "undos": self._undos,
            "beyond": self._beyond,
            "count": self.bar.shown["count"] + 1,
            "moves": self._moves,
        }

    def _search(self, state: State) -> str:
        """Return the query of a state in an address, with its question mark."""
        others = {FIELD: self._code, HOMEWORK: self._homework(state), THEME: self._theme}
        if not self._keeps_settings:
            return _joined(_named(others))
        return self._join_query(_named(others), state.settings, state.notes, self._view(state))

    @property
    def link(self) -> str:
        """The query of a link for others: without class and theme, and without the seed of what is hidden."""
        state = self._history.present
        parts = state.settings.split("&")
        if state.hidden:
            parts = [part for part in parts if not part.startswith("seed=")]
        return self._join_query(
            _named({HOMEWORK: self._homework(state)}), *parts, state.notes, self._view(state)
        )

    @property
    def lacks_held(self) -> bool:
        """Whether the held results do not fit into the address."""
        held = self.held.query
        return bool(held) and held not in self.link

    def _homework(self, state: State) -> str:
        homework = self._session.homework
        is_on = homework is not None and state.hidden == homework.scenario.key
        return homework.link if homework is not None and is_on else ""

    def _view(self, state: State) -> str:
        return query_of_view(self._shown.view()._replace(tab=state.tab))

    def _join_query(self, *parts: str) -> str:
        """Join parts of a query; the held results are in it if there is room for all of them."""
        whole = _joined(*parts, self.held.query)
        return whole if len(whole) <= LONGEST else _joined(*parts)


def _named(others: Mapping[str, str]) -> str:
    return urlencode({name: value for name, value in others.items() if value})


def _joined(*parts: str) -> str:
    text = "&".join(part for part in parts if part)
    return f"?{text}" if text else ""
