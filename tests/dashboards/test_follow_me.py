"""Follow me: pages of students and of a teacher, as a server makes them, without a browser."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from hashlib import sha256
from types import SimpleNamespace
from typing import Any

import panel_material_ui as pmui
import pytest
from panel.io.state import set_curdoc
from walking import PATIENCE, PAUSE, Walk, walking

from dashboards.openings import may_not_end
from dashboards.pages.lessons.lessons import Lessons
from dashboards.teaching import teacher
from dashboards.teaching.class_bar import NO_CLASS
from dashboards.teaching.class_register import CLASSES
from dashboards.teaching.school_class import SchoolClass
from dashboards.teaching.student_bar import AWAY, ENDED, FOLLOWING, KEPT, OWN_WAY, StudentBar
from dashboards.teaching.teacher_bar import TeacherBar
from lab.classroom.gallery.faults import FAULTS
from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE

FLIGHT = {"mission": "los_angeles", "trajectory": {"imu_rate": 20}}
NOISE = "navigator.q_scale"


class Room:
    """A teacher's page that leads a class, and pages of students, as many as a test opens."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        token = teacher.new_token()
        teacher.admit_holders(5006, [sha256(token.encode()).digest()])
        self._cookies = {teacher.cookie_name(): token}
        self.teacher = self.page("", self._cookies)
        self.lead.start()
        self.code = self.school_class.code
        self.teacher.page._view = SimpleNamespace(sidebar_open=True)  # the frame, which a server makes
        self.teacher.run(Experiment().update(FLIGHT))
        self.look()

    def page(self, query: str, cookies: dict[str, str] | None = None, *, has_own: bool = False) -> Walk:
        """Open a page at an address."""
        patch = self._stack.enter_context(pytest.MonkeyPatch.context())
        walk = self._stack.enter_context(walking(patch))
        walk.page.session._browser_ready = True
        with set_curdoc(walk._document):
            walk.page.pages.draw()
            walk.page._class.open(query, cookies or {}, has_own=has_own)
        return walk

    def student(self, *, has_own: bool = False) -> Walk:
        """Open the link for students."""
        walk = self.page(f"class={self.code}", has_own=has_own)
        settle(walk)
        return walk

    def teacher_again(self) -> Walk:
        """Open the page of the teacher again, as when it is reloaded."""
        return self.page(f"class={self.code}", self._cookies)

    @property
    def lead(self) -> TeacherBar:
        """The line of the teacher."""
        bar = self.teacher.page._class._bar
        assert isinstance(bar, TeacherBar)
        return bar

    @property
    def school_class(self) -> SchoolClass:
        """The class."""
        assert self.lead._class is not None
        return self.lead._class

    def look(self) -> None:
        """Let the time until the next look at the teacher's page pass."""
        with set_curdoc(self.teacher._document):
            self.lead._look()

    def set(self, path: str, value: Any) -> None:
        """Let the teacher change a setting, and wait for the result."""
        with set_curdoc(self.teacher._document):
            self.teacher.page.session.change(path, value)
        settle(self.teacher)
        self.look()


def settle(*walks: Walk) -> None:
    """Wait for the results of pages, and for what their documents were asked to do."""
    until = time.monotonic() + PATIENCE
    for walk in walks:
        walk.settle()
        while walk.page.session._runs.busy:
            time.sleep(PAUSE)
            assert time.monotonic() < until
        walk.settle()


def bar(walk: Walk) -> StudentBar:
    """Return the line of a student."""
    found = walk.page._class._bar
    assert isinstance(found, StudentBar)
    return found


def words(walk: Walk) -> str:
    """Return what the line of a page says."""
    found = walk.page._class._bar
    assert found is not None
    return str(found._words.object)


def lessons(walk: Walk) -> Lessons:
    """Return the page Lessons."""
    found = walk.page.pages.made(Lessons)
    assert isinstance(found, Lessons)
    return found


@pytest.fixture
def room() -> Iterator[Room]:
    with ExitStack() as stack:
        made = Room(stack)
        yield made
    for one in CLASSES.classes():
        CLASSES.close(one)
    teacher.admit_holders(5006, [])


def test_students_see_settings_tab_and_time_without_another_run(room: Room) -> None:
    early = room.student()
    before = dict(CACHE.computed)
    room.teacher.open("Flight")
    room.teacher.page._time_bar.go(42.0)
    room.set(NOISE, 0.2)
    late = room.student()  # sees the present state at once
    assert all(may_not_end(one._document) for one in (room.teacher, early, late))
    for student in (early, late):
        settle(student)
        assert student.page.session.experiment.to_dict() == room.teacher.page.session.experiment.to_dict()
        assert student.page.session.result is room.teacher.page.session.result
        assert (student.title, student.page.axis.time) == ("Flight", 42.0)
        assert words(student).split(" Changed: ")[0] == FOLLOWING
    assert CACHE.computed["navigation"] == before["navigation"] + 1  # the teacher's
    room.look()
    assert "<b>2</b> here, <b>2</b> follow" in words(room.teacher)


def test_what_the_teacher_changed_is_named_and_flashes(room: Room) -> None:
    student = room.student()
    assert words(student) == FOLLOWING
    panel = student.page._settings
    if panel is None:
        with set_curdoc(student._document):
            student.page._add_settings()
        panel = student.page._settings
    assert panel is not None
    for step in list(student.page._steps):  # its groups are filled one after the other
        with set_curdoc(student._document):
            step()
    (field,) = panel.views([NOISE])

    def flashes() -> list[str]:
        return [one for one in field.css_classes if one.startswith("told")]

    assert flashes() == []
    room.set("seed", 2)  # the settings of the fields of the teacher's page, which are not those of its result
    settle(student)
    room.set(NOISE, 0.5)
    settle(student)
    assert words(student) == f"{FOLLOWING} Changed: Navigator and filter: Q scale 1 → 0.5"
    first = flashes()
    room.set(NOISE, 0.25)
    settle(student)
    assert words(student).endswith("Q scale 1 → 0.25"), "a motion of a slider is one change"
    assert len(first) == len(flashes()) == 1
    assert flashes() != first, "it flashes again"
    room.set("navigator.r_scale", 2.0)
    settle(student)
    assert words(student).endswith("Changed: Navigator and filter: R scale 1 → 2")
    with set_curdoc(student._document):
        bar(student).wander()
    assert words(student) == OWN_WAY
    with set_curdoc(student._document):
        bar(student).follow()
    assert words(student) == FOLLOWING, "nothing has changed meanwhile"


def test_notes_of_the_teacher_stand_beside_those_of_a_student(room: Room) -> None:
    student = room.student()
    session = student.page.session
    with set_curdoc(student._document):
        student.page._address.notes.write(1.0, 2.0, "mine")
    mine = session.notes
    settle(student)
    assert bar(student).follows, "a note of one's own is no way of one's own"
    notes = room.teacher.page._address.notes
    room.teacher.page.session.experiment = Experiment().update(FLIGHT)
    with set_curdoc(room.teacher._document):
        notes.write(30.0, 50.0, "<img src=x onerror=alert(1)>")
        notes.write(60.0, 60.0, "here")
    room.look()
    settle(student)
    assert [one.text for one in session.notes] == ["mine", "<img src=x onerror=alert(1)>", "here"]
    with set_curdoc(room.teacher._document):
        notes.change(0, "")
    room.look()
    settle(student)
    assert [one.text for one in session.notes] == ["mine", "here"]
    assert len(room.teacher.page.session.notes) == 1
    with set_curdoc(student._document):
        bar(student).back()
    assert session.notes[:1] == mine


def test_of_several_steps_in_a_row_the_last_is_shown(room: Room) -> None:
    student = room.student()
    shown: list[float] = []
    student.page._time_bar._follow = shown.append
    for seconds in (5.0, 6.0, 7.0):  # before the document of the student has its turn
        room.teacher.page._time_bar.go(seconds)
        room.look()
    settle(student)
    assert shown == [7.0]


def test_a_student_wanders_off_and_returns_and_keeps_the_own_settings(room: Room) -> None:
    student = room.student()
    student.page.session.change(NOISE, 0.3)
    settle(student)
    assert words(student) == OWN_WAY
    room.set("navigator.r_scale", 2.0)
    room.teacher.open("Covariance")
    room.look()
    settle(student)
    assert student.title == "Overview"
    assert student.page.session.experiment.get("navigator.r_scale") == 1.0
    assert room.school_class.tally(None).following == 0
    bar(student).follow()
    settle(student)
    assert words(student) == KEPT
    assert (student.title, student.page.session.experiment.get(NOISE)) == ("Covariance", 1.0)
    assert room.school_class.tally(None).following == 1
    bar(student).back()
    settle(student)
    assert words(student) == OWN_WAY
    assert (student.title, student.page.session.experiment.get(NOISE)) == ("Overview", 0.3)
    bar(student).wander()
    bar(student).follow()
    settle(student)
    assert student.page.session.result is room.teacher.page.session.result


def test_nothing_a_student_does_reaches_the_teacher(room: Room) -> None:
    student = room.student()
    page, shown = student.page, room.school_class.moment
    for act in (
        lambda: page.session.change("seed", 5),
        lambda: page.pages.open("Flight"),
        lambda: page.session.accept(Experiment().update(FLIGHT)),
        lambda: lessons(student)._open(("shipped", "04-tuning-r")),
    ):
        assert bar(student).follows
        with set_curdoc(student._document):
            act()
        settle(student)
        room.look()
        assert not bar(student).follows
        assert room.school_class.moment == shown
        assert room.teacher.title == "Overview"
        assert room.teacher.page.session.experiment.seed == 1
        bar(student).follow()
        settle(student)


def test_undo_of_a_student_stays_on_the_page_of_the_student(room: Room) -> None:
    student = room.student()
    settings = student.page.session
    for value in (0.2, 0.3):
        room.set(NOISE, value)
        settle(student)
    settings.change("seed", 5)
    settle(student)
    shown, own = room.school_class.moment, settings.experiment.to_dict()
    assert student.ask("undo")["undone"] != ""
    settle(student)
    assert (settings.experiment.seed, settings.experiment.get(NOISE)) == (1, 0.3)
    assert not bar(student).follows
    student.ask("redo")
    bar(student).follow()
    settle(student)
    student.ask("undo")  # what the page took over from the class is one change
    settle(student)
    assert settings.experiment.to_dict() == own
    assert not bar(student).follows
    room.look()
    assert room.school_class.moment == shown
    assert room.teacher.page.session.experiment.seed == 1


def test_a_lesson_is_followed_step_by_step_and_solved_steps_are_counted(room: Room) -> None:
    student = room.student()
    entry = next(one for one in lessons(room.teacher)._catalogue.entries if one.lesson and one.lesson.fault)
    key, lesson = (entry.origin, entry.name), entry.lesson
    assert lesson is not None
    with set_curdoc(room.teacher._document):
        lessons(room.teacher)._open(key)
    room.look()  # the settings of the lesson are not computed yet
    settle(student, room.teacher)
    room.look()
    settle(student)
    assert lessons(student).place == (key, 0)
    assert student.page.session.experiment.hidden == FAULTS[lesson.fault].title
    with set_curdoc(room.teacher._document):
        lessons(room.teacher)._turn(1)
    settle(room.teacher)
    room.look()
    settle(student)
    assert lessons(student).place == (key, 1)
    assert bar(student).follows  # the steps of the teacher are no acts of the student
    student.page.session.solved(key, 1)
    bar(student)._name.value = "Ana <b>"
    room.lead._names.value = True
    room.look()
    assert "step 2 solved by <b>1</b> of 1" in words(room.teacher)
    assert "Ana &lt;b&gt;" in str(room.lead._list.object)
    room.lead._large.value = True  # a projector shows no names
    assert room.teacher.page._view.sidebar_open is False
    assert not room.lead._list.visible
    room.lead._students.value = True
    assert "Ana" not in str(room.lead._list.object)
    with set_curdoc(room.teacher._document):
        lessons(room.teacher)._close_lesson()
    settle(room.teacher)
    room.look()
    settle(student)
    assert lessons(student).place is None
    assert student.page.session.experiment.hidden == ""


def test_a_check_of_a_student_who_follows_counts(room: Room) -> None:
    student = room.student()
    entry = next(
        one for one in lessons(room.teacher)._catalogue.entries if one.lesson and one.lesson.steps[0].choices
    )
    with set_curdoc(room.teacher._document):
        room.teacher.open("Lessons")
        lessons(room.teacher)._open((entry.origin, entry.name))
    settle(room.teacher)
    room.look()
    settle(student)
    assert entry.lesson is not None
    with set_curdoc(student._document):
        lessons(student)._ask(entry.lesson.steps[0].answer)
    while lessons(student)._judging.busy:
        time.sleep(PAUSE)
    settle(student)
    room.look()
    assert "step 1 solved by <b>1</b> of 1" in words(room.teacher)
    assert bar(student).follows


def test_a_teacher_who_reloads_leads_on_from_where_the_class_is(room: Room) -> None:
    student = room.student()
    room.set(NOISE, 0.2)
    room.teacher.open("Flight")
    room.look()
    shown = room.school_class.moment
    again = room.teacher_again()
    assert isinstance(again.page._class._bar, StudentBar)  # another page leads: this one may take over
    assert again.page._class._bar._lead.visible
    again.page.close()
    room.teacher.page.close()
    again = room.teacher_again()
    settle(again, student)
    assert isinstance(again.page._class._bar, TeacherBar)
    assert again.title == "Flight"
    assert again.page.session.experiment.get(NOISE) == 0.2
    found = CLASSES.find(room.code)
    assert found is not None
    assert found.moment == shown
    room.teacher = again
    again.open("Covariance")
    room.look()
    settle(student)
    assert student.title == "Covariance"


def test_students_hear_that_their_teacher_has_left_and_is_back(room: Room) -> None:
    student, own = room.student(), room.student()
    bar(own).wander()
    with set_curdoc(room.teacher._document):
        room.lead.close()
    settle(student, own)
    assert (words(student), words(own)) == (AWAY, OWN_WAY)
    late = room.student()
    assert words(late) == AWAY
    again = room.teacher_again()
    found = again.page._class._bar
    assert isinstance(found, TeacherBar)
    with set_curdoc(again._document):
        found.lead(bar(student).school_class)  # type: ignore[arg-type]
        found._look()
    settle(again, student, late)
    assert words(student).startswith(FOLLOWING)
    assert words(late).startswith(FOLLOWING)


def test_a_closed_class_leaves_the_students_their_pages(room: Room) -> None:
    student = room.student()
    room.lead.end()
    settle(student)
    assert words(student) == ENDED
    assert student.page.session.result is not None
    student.page.session.change("seed", 2)
    late = room.page(f"class={room.code}")
    assert late.page._class.problem == NO_CLASS


def test_the_class_and_the_role_of_a_page_are_known_until_the_class_ends(room: Room) -> None:
    def role(walk: Walk) -> tuple[str, bool]:
        visitor = walk.page.session.visitor()
        return visitor.school_class, visitor.teaches

    student, guest, again = room.student(), room.page(""), room.teacher_again()
    code = room.code
    assert [role(one) for one in (student, guest)] == [(code, False), ("", False)]
    assert [role(one) for one in (room.teacher, again)] == [(code, True)] * 2
    assert len({one.page.session.visitor().identity for one in (student, guest, again)}) == 3
    room.lead.end()  # the page of the student has not been told yet
    assert [role(one) for one in (student, room.teacher, again)] == [("", False), ("", True), ("", True)]


def test_own_settings_in_the_address_come_first(room: Room) -> None:
    student = room.student(has_own=True)
    assert words(student) == OWN_WAY
    assert student.page.session.result is None  # nothing of the teacher's was taken


def test_a_wrong_code_joins_nothing_and_is_not_repeated(room: Room) -> None:
    walk = room.page("")
    for code in ("<script>", "abc", "a" * 10_000, "%00", "2" * 6):
        walk.page._class.problem = ""
        walk.page._class.open(f"class={code}", {}, has_own=False)
        assert walk.page._class.problem == NO_CLASS
        assert walk.page._class._bar is None


def test_without_the_cookie_nobody_teaches(room: Room) -> None:
    walk = room.page("")
    for cookies in ({}, {teacher.cookie_name(): ""}, {teacher.cookie_name(): "x" * 43}, {"other": "y"}):
        walk.page._class.open("", cookies, has_own=False)
        assert walk.page._class._bar is None
        assert not walk.page._class.view.visible


def test_large_type_makes_letters_larger_and_small_again(room: Room) -> None:
    walk = room.teacher
    (first, *_) = walk.figures()
    before = (first.xaxis[0].major_label_text_font_size, first.title.text_font_size)
    walk.page.pages.enlarge(True)
    large = (first.xaxis[0].major_label_text_font_size, first.title.text_font_size)
    assert [float(size[:-2]) for size in large] == [1.5 * float(size[:-2]) for size in before]
    first.title.text_font_size = "1.05em"  # as a browser does when the theme changes
    assert first.title.text_font_size == large[1]
    walk.page.pages.enlarge(False)
    assert (first.xaxis[0].major_label_text_font_size, first.title.text_font_size) == before


def test_a_name_that_is_no_text_is_not_taken(room: Room) -> None:
    student = room.student()
    bar(student)._call({"a": 1})
    bar(student)._call(None)
    assert room.school_class.tally(None).named == ()
    assert isinstance(bar(student)._name, pmui.TextInput)
