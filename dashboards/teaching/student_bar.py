"""Student bar: a line above all tabs of a student's page: follow the teacher, wander off, and return.

A page that follows shows what the teacher shows. Whoever changes a setting, opens another tab or turns a step
wanders off. Returning takes one click, and what the student had is kept for the way back.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextvars import Context
from html import escape
from typing import NamedTuple
from urllib.parse import parse_qsl, urlencode

import panel as pn
import panel_material_ui as pmui

from dashboards.history import change_in_words
from dashboards.kept import Kept, Own
from dashboards.pages.missions.entry_fields import WRAP
from dashboards.query import experiment_of_query, query
from dashboards.sending import soon, together
from dashboards.style import TOOLTIP, plain_row
from dashboards.teaching.bar_style import BAR, BUTTON, WORDS
from dashboards.teaching.desk import Desk
from dashboards.teaching.moment import Moment
from dashboards.teaching.school_class import SchoolClass, Seat

FOLLOWING = "You follow your teacher."
KEPT = "You follow your teacher. Your own settings are kept."
WAITING = "Your teacher has not shown anything yet."
AWAY = "Your teacher has left. This page goes on following once your teacher is back."
OWN_WAY = "You are exploring. Your teacher continues."
ENDED = "The class has ended. Your page stays as it is."
QUIET = 3.0
"""Longest time between two changes of the same settings that are named as one [s]: a slider moves."""


class _Told(NamedTuple):
    """What the teacher changed last: the settings, from what to what, and when [s]."""

    paths: list[str]
    before: dict[str, str]
    after: dict[str, str]
    at: float


class StudentBar:
    """The line of one page in a class.

    Parameters
    ----------
    school_class
        The class, which has not ended.
    desk
        The page.
    follows
        Whether the page begins with what the teacher shows; otherwise with its own settings.
    lead
        Called to lead the class from this page; None for a student.

    Attributes
    ----------
    view : panel.Row
        The line.

    Raises
    ------
    ClassError
        If the class is full.
    """

    def __init__(
        self,
        school_class: SchoolClass,
        desk: Desk,
        *,
        follows: bool,
        lead: Callable[[], None] | None = None,
    ) -> None:
        self._class: SchoolClass | None = school_class
        self._desk = desk
        self._seat = Seat(self._notify, desk.is_present)
        self._seat.follows = follows
        self._own: Moment | None = None
        self._showing = self._called = False
        self._told: _Told | None = None
        self._seen: dict[str, str] | None = None
        school_class.join(self._seat)
        self._words = pn.pane.HTML("", margin=(8, 8), align="center", stylesheets=[WORDS])
        self._turn = pmui.Button(label="", icon="directions_walk", **BUTTON)
        self._turn.on_click(lambda _event: self.wander() if self._seat.follows else self.follow())
        self._back = pmui.Button(label="Back to my own", icon="undo", visible=False, **BUTTON)
        self._back.on_click(lambda _event: self.back())
        self._lead = pmui.Button(label="Lead the class", icon="groups", visible=lead is not None, **BUTTON)
        if lead is not None:
            self._lead.on_click(lambda _event: lead())
        self._badge = pmui.ToggleIcon(
            icon="badge",
            size="1.3em",
            margin=(2, 4),
            align="center",
            description="Give the teacher your name (optional).",
            stylesheets=[TOOLTIP],
        )
        self._name = pmui.TextInput(
            label="Your name, for the teacher only",
            size="small",
            variant="outlined",
            width=250,
            margin=(8, 8),
            align="center",
            visible=False,
        )
        self._badge.param.watch(lambda event: self._name.param.update(visible=bool(event.new)), "value")
        self._name.param.watch(lambda event: self._call(event.new), "value")
        self.view = plain_row(
            self._words, self._turn, self._back, self._lead, self._badge, self._name, stylesheets=[WRAP, BAR]
        )
        self._lay_out()

    @property
    def school_class(self) -> SchoolClass | None:
        """The class; None once it has ended, or the page has left it."""
        return self._class

    @property
    def follows(self) -> bool:
        """Whether the page follows."""
        return self._class is not None and self._seat.follows

    def begin(self) -> None:
        """Show what the teacher shows now, to a page that follows from the start."""
        if self.follows:
            self._see()

    def follow(self) -> None:
        """Return to the teacher; settings of one's own are kept."""
        if self._class is None:
            return
        moment = self._class.moment
        own = self._desk.own()
        if moment is not None and not moment.has_settings_of(own.experiment):
            self._own = own
        self._seat.follows = True
        self._see()
        self._changed()

    def wander(self) -> None:
        """Follow no longer; the page stays as it is."""
        if self.follows:
            self._seat.follows = False
            self._told = self._seen = None
            self._changed()

    def back(self) -> None:
        """Follow no longer, and take the own settings up where they were left."""
        own, self._own = self._own, None
        self._seat.follows = False
        if own is not None:
            self._show(own)
        self._changed()

    def acted(self) -> None:
        """Wander off, because a person has changed what the page shows."""
        if not self._showing:
            self.wander()

    def solved(self, lesson: tuple[str, str], step: int) -> None:
        """Count a step that the student has solved."""
        if self._class is not None:
            self._seat.solve(lesson, step)
            self._class.changed()

    def kept(self) -> Kept:
        """Return the typed name and the own settings, which the browser stores."""
        own = self._own
        settings = None if own is None else Own(query(own.experiment), own.page, own.time)
        return Kept(name=self._seat.name, own=settings)

    def take_back(self, kept: Kept) -> None:
        """Take the name and the own settings that the browser had stored."""
        if kept.name:
            self._name.value = kept.name
        if kept.own is not None and self._own is None:
            experiment, _ = experiment_of_query(kept.own.settings)
            self._own = Moment(experiment, kept.own.page, kept.own.time)
        self._lay_out()

    def close(self) -> None:
        """Give up the seat, and refer to the class no longer."""
        if self._class is not None:
            self._class.leave(self._seat)
        self._class = self._own = None

    def _call(self, typed: object) -> None:
        """Take a name; a hand-made message may contain anything."""
        if self._class is not None and isinstance(typed, str):
            self._seat.call(typed)
            if typed != self._seat.name:
                self._name.value = self._seat.name
            self._class.changed()

    def _notify(self) -> None:
        """Ask for a turn of this page's document; of several moments before it, the last one is shown."""
        if not self._called:
            self._called = True
            # In an empty context, because that of the caller may refer to another document.
            Context().run(soon, self._desk.document, self._arrive)

    def _arrive(self) -> None:
        self._called = False
        if self._class is None:
            return
        if self._class.closed:
            self._class = self._own = None
            self._lay_out()
            self._desk.keep("", True)
        elif self._seat.follows:
            self._see()

    def _see(self) -> None:
        assert self._class is not None
        moment = self._class.moment
        if moment is not None:
            self._show(moment)
            self._tell()
        self._lay_out()

    def _show(self, moment: Moment) -> None:
        self._showing = True
        try:
            self._desk.show(moment)
        finally:
            self._showing = False

    def _tell(self) -> None:
        """Note what the teacher has changed since what this page saw before, and make it flash."""
        before, after = self._seen, self._settings()
        self._seen = after
        if before is None:
            return
        paths = [path for path in before | after if before.get(path) != after.get(path)]
        if paths:
            now, told = time.monotonic(), self._told
            if told is not None and told.paths == paths and now - told.at < QUIET:  # one motion of a slider
                before = told.before
            self._told = _Told(paths, before, after, now)
            with together(self._desk.document):
                self._desk.flash(paths)

    def _settings(self) -> dict[str, str]:
        """Return the settings of the page that differ from the defaults; a seed may be hidden."""
        experiment = self._desk.session.experiment
        found = dict(parse_qsl(query(experiment)))
        return {path: text for path, text in found.items() if path != "seed" or not experiment.hidden}

    def _changed(self) -> None:
        self._lay_out()
        if self._class is not None:
            self._desk.keep(self._class.code, not self._seat.follows)
            self._class.changed()

    def _lay_out(self) -> None:
        ended, follows = self._class is None, self._seat.follows
        if self._class is None:
            text = ENDED
        elif not follows:
            text = OWN_WAY
        elif self._class.moment is None:
            text = WAITING
        elif not self._class.has_leader:
            text = AWAY
        else:
            text = KEPT if self._own is not None else FOLLOWING
            if self._told is not None:
                told, sigmas = self._told, self._desk.session.shows_sigmas
                changed = change_in_words(urlencode(told.before), urlencode(told.after), sigmas)
                text = f"{text} Changed: {changed}"
        with together(self._desk.document):
            if self._words.object != escape(text):
                self._words.object = escape(text)
                self._turn.param.update(
                    label="Explore on my own" if follows else "Return to the teacher",
                    icon="directions_walk" if follows else "school",
                    variant="outlined" if follows else "contained",
                    visible=not ended,
                )
            self._back.visible = not ended and follows and self._own is not None
            if ended:
                self._name.visible = self._badge.visible = self._lead.visible = False
