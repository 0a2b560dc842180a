"""A class: who leads, who is counted, and when it ends; bounded, and without a page."""

from __future__ import annotations

import gc
import re
from weakref import ref

import pytest
import segno

from dashboards.teaching import class_register
from dashboards.teaching.class_link import HERE_ONLY, ClassLink, class_link, code_of, listen_on
from dashboards.teaching.class_register import MOST, ClassRegister, is_code
from dashboards.teaching.class_view import invitation_html, line_html, students_html
from dashboards.teaching.moment import Moment
from dashboards.teaching.school_class import (
    ALONE,
    LIFETIME,
    MOST_LESSONS,
    MOST_SEATS,
    MOST_STEPS,
    ClassError,
    Seat,
)
from lab.classroom.lessons.catalogue import Catalogue
from lab.experiment.experiment import Experiment

LESSON = ("shipped", "a")


class Clock:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now


class Sitter:
    """A page that notes what it is told."""

    def __init__(self) -> None:
        self.told, self.connected = 0, True
        self.seat = Seat(self.notify, lambda: self.connected)

    def notify(self) -> None:
        """Note it."""
        self.told += 1


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def register(clock: Clock) -> ClassRegister:
    return ClassRegister(clock)


def moment(time: float = 0.0) -> Moment:
    return Moment(Experiment(), "Errors", time)


def test_only_the_page_that_leads_shows_anything(register: ClassRegister) -> None:
    opened, teacher, student, stranger = register.open(), Sitter(), Sitter(), Sitter()
    opened.lead(teacher.seat)
    opened.join(student.seat)
    shown = moment(3.0)
    opened.show(teacher.seat, shown)
    for other in (student, stranger):
        opened.show(other.seat, moment(9.0))
        assert opened.moment is shown
    assert (student.told, stranger.told) == (1, 0)
    student.seat.follows = False
    opened.show(teacher.seat, moment(4.0))
    assert student.told == 1  # who wandered off is not disturbed


def test_a_second_page_takes_the_lead_and_the_first_is_told(register: ClassRegister) -> None:
    opened, first, second = register.open(), Sitter(), Sitter()
    opened.lead(first.seat)
    assert opened.is_led
    before = first.told
    opened.lead(second.seat)
    assert first.told == before + 1
    assert not opened.is_led_by(first.seat)
    opened.show(first.seat, moment())
    assert opened.moment is None
    opened.leave(first.seat)
    assert opened.is_led_by(second.seat)


def test_those_are_counted_whose_browser_is_there(register: ClassRegister) -> None:
    opened, teacher = register.open(), Sitter()
    opened.lead(teacher.seat)
    sitters = [Sitter() for _ in range(4)]
    for sitter in sitters:
        opened.join(sitter.seat)
        sitter.seat.solve(LESSON, 0)
    sitters[0].seat.solve(LESSON, 2)
    sitters[1].seat.follows = False
    sitters[2].connected = False
    opened.leave(sitters[3].seat)
    tally = opened.tally(LESSON)
    assert (tally.present, tally.following, tally.solved) == (2, 1, {0: 2, 2: 1})
    assert opened.tally(("shipped", "b")).solved == {}
    assert tally.named == ()


def test_names_are_text_bounded_and_only_of_those_who_typed_one(register: ClassRegister) -> None:
    opened, zoe, ana, nobody = register.open(), Sitter(), Sitter(), Sitter()
    for sitter, typed in (
        (zoe, "zoë\u202e <img src=x>"),
        (ana, " Ana\n" + "a" * 1000),
        (nobody, "\u200b \t"),
    ):
        opened.join(sitter.seat)
        sitter.seat.call(typed)
    zoe.seat.solve(LESSON, 1)
    named = opened.tally(LESSON).named
    assert [(len(one.name) <= 40, one.solved) for one in named] == [(True, ()), (True, (1,))]
    lesson = Catalogue().entries[0].lesson
    shown = students_html(opened.tally(LESSON), lesson, with_names=True)
    assert "<img" not in shown
    assert "zoë &lt;img src=x&gt;" in shown
    assert "\u202e" not in shown
    assert "Ana" not in students_html(opened.tally(LESSON), lesson, with_names=False)
    assert "Ana" not in line_html(opened.code, opened.tally(LESSON), lesson, 0)


def test_what_a_seat_keeps_is_bounded(register: ClassRegister) -> None:
    opened, sitter = register.open(), Sitter()
    for number in range(2 * MOST_LESSONS):
        for step in (-1, 0, MOST_STEPS, 10**9):
            sitter.seat.solve(("own", str(number)), step)
    kept = [sitter.seat.solved(("own", str(number))) for number in range(2 * MOST_LESSONS)]
    assert kept == [{0}] * MOST_LESSONS + [frozenset()] * MOST_LESSONS
    for _ in range(MOST_SEATS):
        opened.join(Sitter().seat)
    with pytest.raises(ClassError, match="full"):
        opened.join(sitter.seat)


def test_a_closed_class_forgets_all_and_tells_all(register: ClassRegister) -> None:
    opened, teacher, student = register.open(), Sitter(), Sitter()
    opened.lead(teacher.seat)
    opened.join(student.seat)
    opened.show(teacher.seat, moment())
    told, seat = student.told, ref(student.seat)
    register.close(opened)
    assert student.told == told + 1
    assert opened.closed
    assert opened.moment is None
    assert register.find(opened.code) is None
    with pytest.raises(ClassError, match="ended"):
        opened.join(Sitter().seat)
    del student
    gc.collect()
    assert seat() is None


def test_a_class_without_its_teacher_waits_and_ends(register: ClassRegister, clock: Clock) -> None:
    opened, teacher, student = register.open(), Sitter(), Sitter()
    opened.lead(teacher.seat)
    opened.join(student.seat)
    clock.now = 3 * ALONE
    assert register.find(opened.code.upper()) is opened  # led all the time
    teacher.connected = False
    clock.now += ALONE - 1
    assert register.find(opened.code) is opened
    teacher.connected = True  # the connection is back
    clock.now += 1
    assert register.find(opened.code) is opened
    opened.leave(teacher.seat)
    clock.now += ALONE
    told = student.told
    assert register.classes() == []
    assert opened.closed
    assert student.told == told + 1


def test_a_class_lives_for_a_day_at_most(register: ClassRegister, clock: Clock) -> None:
    opened, teacher = register.open(), Sitter()
    opened.lead(teacher.seat)
    clock.now = LIFETIME
    assert register.find(opened.code) is None


def test_the_number_of_classes_is_bounded_and_codes_differ(
    register: ClassRegister, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = [register.open() for _ in range(MOST)]
    assert all(is_code(one.code) for one in opened)
    with pytest.raises(ClassError, match="Close one first"):
        register.open()
    register.close(opened[0])
    codes = iter([opened[1].code, opened[1].code, "abcdef"])
    monkeypatch.setattr(class_register, "_code", lambda: next(codes))
    assert register.open().code == "abcdef"


@pytest.mark.parametrize("text", ["", "abcde", "abcdefg", "abcde0", "abcde<", "abcdé2", "abc ef", "l" * 6])
def test_what_is_no_code_is_not_looked_up(text: str) -> None:
    assert not is_code(text)


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("class=abcdef", "abcdef"),
        ("seed=2&class=abcdef&class=x", "abcdef"),
        ("", ""),
        ("class=", ""),
        ("&".join("a=1" for _ in range(1000)), ""),
    ],
)
def test_the_code_is_read_from_the_address(query: str, code: str) -> None:
    assert code_of(query) == code


@pytest.mark.parametrize(
    ("page", "link"),
    [
        ("https://lab.example.org/ins/?seed=2#x", "https://lab.example.org/ins/?class=abcdef"),
        ("http://192.0.2.7:5006/", "http://192.0.2.7:5006/?class=abcdef"),
        ("http://[2001:db8::7]:5006/", "http://[2001:db8::7]:5006/?class=abcdef"),
        ("http://lab.local:5006", "http://lab.local:5006/?class=abcdef"),
    ],
)
def test_the_link_has_the_host_and_the_path_of_the_teachers_page(page: str, link: str) -> None:
    assert class_link(page, "abcdef") == (link, "")


def test_of_this_computer_the_link_has_the_address_in_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashboards.teaching.class_link.own_addresses", lambda: ["192.0.2.7", "192.0.2.8"])
    listen_on("0.0.0.0")
    assert class_link("http://localhost:5006/?x=1", "abcdef") == ("http://192.0.2.7:5006/?class=abcdef", "")
    listen_on("127.0.0.1")
    assert class_link("http://localhost:5006/", "abcdef") == (
        "http://localhost:5006/?class=abcdef",
        HERE_ONLY,
    )
    monkeypatch.setattr("dashboards.teaching.class_link.own_addresses", lambda: [])
    listen_on("0.0.0.0")
    assert class_link("http://127.0.0.1:5006/", "abcdef").problem == HERE_ONLY


def test_the_qr_code_of_the_link_is_drawn_as_another_program_makes_it() -> None:
    link = ClassLink("http://192.0.2.7:5006/?class=abcdef", "<b>")
    drawn = invitation_html(link)
    assert "<b>" not in drawn
    runs = re.findall(r"M(\d+) (\d+)h(\d+)v1h-\d+z", drawn)
    dark = {(int(y), int(x) + one) for x, y, length in runs for one in range(int(length))}
    code = segno.make_qr(link.address, error="m")
    rows = enumerate(code.matrix_iter(border=4))
    assert dark == {(y, x) for y, row in rows for x, one in enumerate(row) if one}


def test_a_step_counts_as_solved_in_the_line(register: ClassRegister) -> None:
    opened, sitter = register.open(), Sitter()
    lesson = next(one.lesson for one in Catalogue().entries if one.lesson and one.lesson.steps[0].asks)
    assert "no student is here yet" in line_html(opened.code, opened.tally(LESSON), lesson, 0)
    opened.join(sitter.seat)
    sitter.seat.solve(LESSON, 0)
    assert "step 1 solved by <b>1</b> of 1" in line_html(opened.code, opened.tally(LESSON), lesson, 0)
    assert "solved" not in line_html(opened.code, opened.tally(None), None, 0)
