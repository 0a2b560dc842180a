"""Teacher bar: a line above all tabs of a teacher's page: a class, its link, and who has solved what."""

from __future__ import annotations

import asyncio
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.classroom import catalogue
from dashboards.pages.missions.entry_fields import WRAP
from dashboards.sending import together
from dashboards.style import plain_column, plain_row, wide_html
from dashboards.teaching.bar_style import BAR, BUTTON, TOGGLE, WORDS
from dashboards.teaching.class_link import class_link
from dashboards.teaching.class_register import CLASSES
from dashboards.teaching.class_view import STYLE, invitation_html, line_html, students_html
from dashboards.teaching.desk import Desk
from dashboards.teaching.large_type import FACTOR
from dashboards.teaching.moment import Moment
from dashboards.teaching.school_class import ClassError, SchoolClass, Seat
from lab.classroom.lessons.lesson import Lesson

UPDATE = 250
"""Time between two looks at what the teacher's page shows [ms]: a class sees at most four moments a second,
and the last one in any case."""
COUNT = 8
"""Looks after which the students are counted again without any news: a connection may be lost."""
NO_CLASS = "You are a teacher on this server. Students follow this page once you start a class."
LOST = "Another page of a teacher leads the class now."
ENDED = "The class has ended: it was open for too long, or without its teacher."


class TeacherBar:
    """The line of one page of a teacher.

    Parameters
    ----------
    desk
        The page.

    Attributes
    ----------
    view : panel.Column
        The line, and the students below it.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._seat = Seat(self._notify, desk.is_present)
        self._class: SchoolClass | None = None
        self._moment: Moment | None = None
        self._news, self._looks = True, 0
        self._offered: list[tuple[str, bool]] = []
        self._closed = False
        self._words = pn.pane.HTML(NO_CLASS, margin=(8, 8), align="center", stylesheets=[WORDS])
        self._start = pmui.Button(label="Start a class", icon="groups", **BUTTON | {"variant": "contained"})
        self._start.on_click(lambda _event: self.start())
        self._offers = pn.Row(margin=0, align="center", stylesheets=[WRAP])
        self._link = self._button("Link", "qr_code_2", self.invite)
        self._students = self._toggle("Students", "checklist")
        self._names = self._toggle("Names", "badge")
        self._large = self._toggle("Projector", "present_to_all")
        self._end = self._button("Close the class", "close", self.end)
        for toggle in (self._students, self._names):
            toggle.param.watch(lambda _event: self._count(), "value")
        self._large.param.watch(lambda event: self._enlarge(event.new), "value")
        self._list = pn.pane.HTML("", margin=(4, 12), visible=False, stylesheets=[STYLE])
        self._invitation = wide_html(margin=0, stylesheets=[STYLE])
        self._dialog = pmui.Dialog(
            self._invitation,
            title="Open this link to follow",
            width_option="md",
            show_close_button=True,
            close_on_click=True,
        )
        line = plain_row(
            self._words,
            self._start,
            self._offers,
            self._link,
            self._students,
            self._names,
            self._large,
            self._end,
            stylesheets=[WRAP, BAR],
        )
        self.view = plain_column(line, self._list, self._dialog, styles={"flex": "0 0 auto"})
        self._lay_out()
        desk.document.add_periodic_callback(self._look, UPDATE)

    @property
    def school_class(self) -> SchoolClass | None:
        """The class that the page leads; None without one."""
        return self._class

    def start(self) -> None:
        """Open a class, lead it, and show its link."""
        try:
            opened = CLASSES.open()
        except ClassError as error:
            self._desk.session.problem = str(error)
            return
        self.lead(opened)
        self.invite()

    def lead(self, school_class: SchoolClass) -> None:
        """Lead a class on from what it was shown last."""
        self._class = school_class
        school_class.lead(self._seat)
        self._moment, self._news = school_class.moment, True
        if self._moment is not None:
            self._desk.show(self._moment)
        self._desk.keep(school_class.code, True)
        self._lay_out()

    def invite(self) -> None:
        """Show link and QR code."""
        if self._class is not None:
            self._invitation.object = invitation_html(class_link(self._desk.href(), self._class.code))
            self._dialog.open = True

    def end(self) -> None:
        """Close the class: all its pages go on by themselves."""
        if self._class is not None:
            ended, self._class = self._class, None
            CLASSES.close(ended)
            self._leave(NO_CLASS)

    def close(self) -> None:
        """Give up the lead; the class goes on for a while, for a teacher who comes back."""
        self._closed = True
        if self._class is not None:
            self._class.leave(self._seat)
        self._class = self._moment = None

    def acted(self) -> None:
        """Do nothing: what a teacher does is seen at the next look."""

    def solved(self, _lesson: tuple[str, str], _step: int) -> None:
        """Do nothing: a teacher is not counted."""

    def _notify(self) -> None:
        self._news = True

    def _look(self) -> None:
        """Show the class what has changed, and count the students."""
        if self._closed:
            return
        self._looks += 1
        if self._class is None:
            if self._looks % COUNT == 0:
                self._offer()
            return
        if not self._class.is_led_by(self._seat):
            text = ENDED if self._class.closed else LOST
            self._class = None
            self._leave(text)
            return
        moment = self._desk.settled(self._moment)
        if moment is not None and moment != self._moment:
            self._news = self._news or self._moment is None or moment.place != self._moment.place
            self._moment = moment
            served = self._desk.document.session_context is not None
            self._class.show(self._seat, moment, asyncio.get_running_loop() if served else None)
        if self._news or self._looks % COUNT == 0:
            self._count()

    def _leave(self, text: str) -> None:
        self._moment = None
        self._large.value = self._dialog.open = False
        self._words.object = text
        self._desk.keep("", True)
        self._lay_out()

    def _lay_out(self) -> None:
        """Show the buttons of a teacher with a class, or of one without."""
        leads = self._class is not None
        with together(self._desk.document):
            self._start.visible = not leads
            for one in (self._link, self._students, self._names, self._large, self._end):
                one.visible = leads
            self._offer()
            self._count()

    def _offer(self) -> None:
        """Offer to lead the classes that are open on the server."""
        found = CLASSES.classes() if self._class is None else []
        offered = [(one.code, one.is_led) for one in found]
        if offered == self._offered:
            return
        self._offered = offered
        words = [("Take over" if is_led else "Go on with", code) for code, is_led in offered]
        self._offers[:] = [
            self._button(f"{word} class {code}", "groups", lambda one=one: self._lead_again(one))
            for (word, code), one in zip(words, found, strict=True)
        ]

    def _lead_again(self, school_class: SchoolClass) -> None:
        if not school_class.closed:
            self.lead(school_class)

    def _count(self) -> None:
        """Show how many students are here, and what they have solved."""
        self._news = False
        if self._class is None:
            self._list.visible = False
            return
        place = None if self._moment is None else self._moment.place
        lesson: Lesson | None = catalogue().find(*place[0]) if place is not None else None
        tally = self._class.tally(place[0] if place is not None else None)
        step = min(place[1], len(lesson.steps) - 1) if place is not None and lesson is not None else 0
        large = bool(self._large.value)
        names = bool(self._names.value) and not large
        with together(self._desk.document):
            self._words.object = line_html(self._class.code, tally, lesson, step)
            self._names.visible = not large
            self._list.visible = bool(self._students.value) or names
            if self._list.visible:
                self._list.object = students_html(tally, lesson, with_names=names)

    def _enlarge(self, on: bool) -> None:
        """Turn large type on or off; names are not projected."""
        self._desk.enlarge(bool(on))
        for text in (self._words, self._list):
            text.styles = {"zoom": str(FACTOR)} if on else {}
        self._count()

    def _button(self, label: str, icon: str, act: Any) -> pmui.Button:
        button = pmui.Button(label=label, icon=icon, **BUTTON)
        button.on_click(lambda _event: act())
        return button

    def _toggle(self, label: str, icon: str) -> pmui.Toggle:
        return pmui.Toggle(label=label, icon=icon, sx=TOGGLE, **BUTTON)
