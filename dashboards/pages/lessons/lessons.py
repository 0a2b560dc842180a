"""Lessons: the list of lessons, or the open step of one, which sets the settings of the session."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import panel as pn
from bokeh.document import Document

from dashboards.classroom import catalogue
from dashboards.computing import LatestWins, Outcome, attempt
from dashboards.kept import Kept
from dashboards.pages.base import Page
from dashboards.pages.lessons.homework_part import HomeworkPart
from dashboards.pages.lessons.lesson_list import Key, LessonList
from dashboards.pages.lessons.step_view import Actions, StepView
from dashboards.query import experiment_of_query, query
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.style import whole_column
from dashboards.teaching.school_class import MOST_STEPS
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.lessons.lesson import Answer, Lesson, Step
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.figures import TimeAxis

LOOK = 2000
"""Time between two looks at the files of the teacher's folder while the page is visible [ms]."""
OLD_RESULT = "The plots are not yet those of your settings. Wait until they are drawn, then check again."
FAULT_IS_OFF = "The hidden fault is off, because the settings were reset or loaded. Start the step again."


class Asked(NamedTuple):
    """An answer that is checked in the background.

    Attributes
    ----------
    step : Step
        The step.
    answer : str, float or None
        The answer.
    result : Result or None
        The result of the student.
    place : tuple
        The lesson, and the number of the step.
    """

    step: Step
    answer: Answer
    result: Result | None
    place: tuple[Key, int]


class Lessons(Page):
    """The lessons of the server, one of which may be open."""

    title = "Lessons"
    depends_on_window = False

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        self._document: Document | None = pn.state.curdoc
        self._catalogue = catalogue()
        self._seen = self._catalogue.version
        self._lesson: Lesson | None = None
        self._key: Key = ("", "")
        self._number = 0
        self._own: Experiment | None = None  # the settings of before the lesson, which its end gives back
        self._begun: set[tuple[Key, int]] = set()
        self._solved: dict[Key, set[int]] = {}
        self._looking: Any = None
        self._judging: LatestWins[Asked] = LatestWins(self._judge, self._deliver)
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the list of lessons."""
        self._list = LessonList(self._open)
        self._homework = HomeworkPart(self._session, self._homework_changed)
        self._step = StepView(Actions(self._apply, self._look, self._ask, self._turn, self._close_lesson))
        self._stage = whole_column()
        self._lay_out()
        return self._stage

    def draw(self, result: Result) -> None:
        """Do nothing: the page shows no result."""

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result: it needs none."""
        return True

    def appear(self) -> None:
        """Look for changes of the teacher's files while the page is visible."""
        self._refresh()
        if self._looking is None and self._document is not None:
            self._looking = self._document.add_periodic_callback(self._refresh, LOOK)

    def hide(self) -> None:
        """Look no more."""
        if self._looking is not None and self._document is not None:
            self._document.remove_periodic_callback(self._looking)
        self._looking = None

    def close(self) -> None:
        """End the page; its periodic callback has ended with its document."""
        self._looking = None
        self._judging.close()
        self._homework.end()

    @property
    def place(self) -> tuple[Key, int] | None:
        """The open lesson, and the number of its step from 0; None while the list is shown."""
        return None if self._lesson is None else (self._key, self._number)

    def go(self, place: tuple[Key, int] | None) -> None:
        """Open a step of a lesson, or the list, without applying settings: whoever calls this brings them."""
        if place == self.place:
            return
        key, number = place or (("", ""), 0)
        lesson = self._catalogue.find(*key) if place else None
        if lesson is not None:
            self._key, self._number = key, min(max(number, 0), len(lesson.steps) - 1)
            self._begun.add((self._key, self._number))
            self._own = self._own or self._session.experiment.copy()
        else:
            self._own = None
        self._lesson = lesson
        self._lay_out()

    def hiding(self, hidden: str) -> Experiment | None:
        """Return a new experiment of the open lesson or homework; None if it does not hide this."""
        if self._lesson is not None and self._lesson.fault and FAULTS[self._lesson.fault].title == hidden:
            return FaultyExperiment(FAULTS[self._lesson.fault])
        homework = self._homework.open
        if homework is not None and homework.scenario.key == hidden:
            return HiddenExperiment(homework.scenario)
        return None

    def kept(self, kept: Kept) -> Kept:
        """Return what the browser stores, with the open step, the solved ones, and a homework."""
        solved = {key: tuple(sorted(steps)) for key, steps in self._solved.items() if steps}
        hides = self._lesson is not None and bool(self._session.experiment.hidden)
        before = None if self._own is None or self._own.hidden else query(self._own)
        kept = kept._replace(place=self.place, hides=hides, solved=solved, typed=self._homework.typed)
        return kept._replace(before=before if self._lesson is not None else None)

    def take_back(self, kept: Kept) -> None:
        """Take the solved steps that the browser had stored, and what was typed into the homework."""
        for key, steps in kept.solved.items():
            lesson = self._catalogue.find(*key)
            known = [] if lesson is None else [step for step in steps if step < len(lesson.steps)]
            if known:
                self._solved.setdefault(key, set()).update(known)
            for step in known:
                self._session.solved(key, step)
        if kept.place is not None:
            key, number = kept.place
            self._begun |= {(key, step) for step in range(min(number + 1, MOST_STEPS))}
            self._own = None if kept.before is None else experiment_of_query(kept.before)[0]
        self._homework.take_back(kept.typed)
        self._lay_out()

    def fault_of(self, kept: Kept) -> str:
        """Return the title of the fault that the kept lesson hides; empty without one."""
        lesson = self._catalogue.find(*kept.place[0]) if kept.place is not None else None
        return FAULTS[lesson.fault].title if lesson is not None and lesson.fault else ""

    def _refresh(self) -> None:
        """Show what has changed in the files."""
        self._catalogue.refresh()
        if self._homework.has_changed() and self._lesson is None:
            self._lay_out()
        if self._catalogue.version == self._seen:
            return
        self._seen = self._catalogue.version
        if self._lesson is not None:
            found = self._catalogue.find(*self._key)
            if found is self._lesson:
                return
            self._lesson = found
            self._begun = {place for place in self._begun if place[0] != self._key}
            self._solved.pop(self._key, None)
            self._number = min(self._number, len(found.steps) - 1) if found else 0
        self._lay_out()

    def _lay_out(self) -> None:
        """Show the open step, or the homework, or the list.

        A teacher may open a lesson while a student who follows has a homework open: it comes back afterwards.
        """
        views: list[pn.viewable.Viewable]
        if self._lesson is not None:
            self._step.show(
                self._lesson, self._number, self._done, has_next=self._catalogue.after(self._key) is not None
            )
            views = [self._step.view]
            where = f"{self._lesson.title}, step {self._number + 1} of {len(self._lesson.steps)}"
            title = self._lesson.steps[self._number].title
            self._session.remind(f"{where}: {title}. It is among the Lessons.")
        elif self._homework.open is not None:
            views = [self._homework.view]
            self._session.remind(self._homework.reminder)
        else:
            self._list.show(self._catalogue.entries, self._solved)
            self._homework.show_list()
            views = [self._homework.list_view, self._list.view]
            self._session.remind("")
        if self._stage.objects != views:
            self._stage[:] = views

    @property
    def _done(self) -> set[int]:
        return self._solved.setdefault(self._key, set())

    def _open(self, key: Key) -> None:
        if self._lesson is None:
            self._own = self._session.experiment.copy()
        self._lesson = self._catalogue.find(*key)
        if self._lesson is None:
            return
        self._key, self._number = key, 0
        self._begun = {place for place in self._begun if place[0] != key}
        self._lay_out()
        self._begin()
        self._session.acted()

    def _close_lesson(self) -> None:
        """Go back to the list, and to the settings of before the lesson, which hide no fault."""
        own, self._own, self._lesson = self._own, None, None
        self._lay_out()
        try:
            if own is not None:
                self._session.accept(own, called="Own settings after the lesson")
        except SettingError as error:  # the mission is not there any more
            self._session.problem = str(error)
        self._turn_faults_off()
        self._session.acted()

    def _homework_changed(self) -> None:
        """Show a homework that was opened, or the list after it was closed."""
        self._lay_out()
        if self._homework.open is None:
            self._turn_faults_off()

    def _turn_faults_off(self) -> None:
        """Turn off whatever is hidden."""
        if self._session.experiment.hidden:
            plain = Experiment().update(self._session.experiment.to_dict())
            self._session.accept(plain, called="What was hidden is off")

    def _turn(self, by: int) -> None:
        if self._lesson is not None and self._number + by == len(self._lesson.steps):
            following = self._catalogue.after(self._key)
            if following is not None:
                self._open(following)
        elif self._lesson is not None and 0 <= self._number + by < len(self._lesson.steps):
            self._number += by
            self._lay_out()
            self._begin()
            self._session.acted()

    def _begin(self) -> None:
        """Apply the settings of a step when it is opened for the first time."""
        assert self._lesson is not None
        place = self._key, self._number
        has_own = self._lesson.steps[self._number].settings is not None
        if place not in self._begun and (has_own or self._number == 0):
            self._apply()
        self._begun.add(place)

    def _apply(self) -> None:
        if self._lesson is None:
            return
        try:
            experiment = self._lesson.experiment(self._lesson.steps[self._number])
            self._session.accept(experiment, called=f"{self._lesson.title}, step {self._number + 1}")
        except SettingError as error:
            self._step.warn(str(error))

    def _look(self) -> None:
        if self._lesson is not None:
            step = self._lesson.steps[self._number]
            self._session.go(step.page, step.time)

    def _ask(self, answer: Answer) -> None:
        """Check an answer; the verdict of a result takes a second, so this is done in the background."""
        if self._lesson is None:
            return
        step, result = self._lesson.steps[self._number], self._session.result
        if step.check is not None and result is not None:
            hidden = FAULTS[self._lesson.fault].title if self._lesson.fault else ""
            if self._session.experiment.hidden != hidden:
                self._step.warn(FAULT_IS_OFF)
                return
            if result.experiment.hidden != hidden or result.experiment.to_dict() != self._wanted:
                self._step.warn(OLD_RESULT)
                return
        self._judging.submit(Asked(step, answer, result, (self._key, self._number)))

    @property
    def _wanted(self) -> dict[str, Any]:
        return self._session.experiment.to_dict()

    def _judge(self, asked: Asked, _progress: Progress) -> Outcome:
        return attempt(lambda: asked.step.judge(asked.answer, asked.result))

    def _deliver(self, asked: Asked, outcome: Outcome) -> None:
        if self._document is not None:
            soon(self._document, partial(self._arrive, asked.place, outcome))

    def _arrive(self, place: tuple[Key, int], outcome: Outcome) -> None:
        """Show what there is to say of an answer, unless another step is open now."""
        if self._lesson is None or place != (self._key, self._number):
            return
        if outcome.result is None:
            self._step.warn(outcome.problem)
            return
        if outcome.result.right:
            self._done.add(self._number)
            self._session.solved(self._key, self._number)
            self._step.show_progress(self._lesson, self._number, self._done)
            self._session.keep()
        self._step.say(outcome.result)
