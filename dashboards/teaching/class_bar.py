"""Class bar: the line of a page in a class: that of a student, that of a teacher, or none."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn

from dashboards.kept import Kept
from dashboards.openings import end_later
from dashboards.style import plain_column
from dashboards.teaching.class_link import code_of
from dashboards.teaching.class_register import CLASSES, is_code
from dashboards.teaching.desk import Desk
from dashboards.teaching.school_class import ClassError, SchoolClass
from dashboards.teaching.student_bar import StudentBar
from dashboards.teaching.teacher import is_teacher
from dashboards.teaching.teacher_bar import TeacherBar

NO_CLASS = (
    "There is no class with this link: it has ended, or the link was mistyped. Ask your teacher for the "
    "link. Until then, the laboratory is yours."
)


class ClassBar:
    """The part of one page in a class.

    Parameters
    ----------
    desk
        The page.

    Attributes
    ----------
    view : panel.Column
        The line; empty for a visitor without a class.
    teaches : bool
        Whether the browser of the page is that of a teacher.
    problem : str
        Why the class in the address cannot be joined; empty if it can, or none is named.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._bar: StudentBar | TeacherBar | None = None
        self.teaches = False
        self.problem = ""
        self.view = plain_column(styles={"flex": "0 0 auto"}, visible=False)

    @property
    def code(self) -> str:
        """Code of the class that the page attends or leads; empty without one, or once it has ended."""
        found = None if self._bar is None else self._bar.school_class
        return "" if found is None or found.closed else found.code

    def open(self, query: str, cookies: Any, *, has_own: bool) -> None:
        """Take the place that the address of the page and the cookies of its browser say.

        Parameters
        ----------
        query
            Query of the address.
        cookies
            Cookies of the browser, by name.
        has_own
            Whether the address holds settings: then a student begins with these, and not with the teacher's.
        """
        self.teaches = teaches = is_teacher(cookies)
        code = code_of(query)
        found = CLASSES.find(code) if is_code(code) else None
        if code and found is None:
            self.problem = NO_CLASS
        if teaches and (found is None or not found.is_led):
            self._teach(found)
        elif found is not None:
            self._attend(found, follows=not has_own, may_lead=teaches)

    def acted(self) -> None:
        """Report that a person has changed what the page shows."""
        if self._bar is not None:
            self._bar.acted()

    def solved(self, lesson: tuple[str, str], step: int) -> None:
        """Report that a step of a lesson is solved."""
        if self._bar is not None:
            self._bar.solved(lesson, step)

    @property
    def follows(self) -> bool:
        """Whether the page shows what its teacher shows."""
        return isinstance(self._bar, StudentBar) and self._bar.follows

    def kept(self) -> Kept:
        """Return what the browser of a student stores."""
        return self._bar.kept() if isinstance(self._bar, StudentBar) else Kept()

    def take_back(self, kept: Kept) -> None:
        """Take what the browser of a student had stored."""
        if isinstance(self._bar, StudentBar):
            self._bar.take_back(kept)

    def close(self) -> None:
        """Leave the class."""
        if self._bar is not None:
            self._bar.close()
        self._bar = None
        CLASSES.sweep()

    def _teach(self, found: SchoolClass | None) -> None:
        bar = self._bar = TeacherBar(self._desk)
        self._place(bar.view)
        if found is not None:
            bar.lead(found)

    def _lead(self, found: SchoolClass) -> None:
        """Lead a class that this page of a teacher has followed so far."""
        if self._bar is not None and not found.closed:
            self._bar.close()
            self._teach(found)

    def _attend(self, found: SchoolClass, *, follows: bool, may_lead: bool) -> None:
        lead = partial(self._lead, found) if may_lead else None
        try:
            bar = self._bar = StudentBar(found, self._desk, follows=follows, lead=lead)
        except ClassError as error:
            self.problem = str(error)
            return
        self._place(bar.view)
        self._desk.keep(found.code, not follows)
        bar.begin()

    def _place(self, view: pn.viewable.Viewable) -> None:
        end_later(self._desk.document)
        self.view[:] = [view]
        self.view.visible = True
