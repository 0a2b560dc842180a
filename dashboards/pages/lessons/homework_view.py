"""Homework view: the text of a homework, what it asks, and the button with which it is handed in.

Texts come from files of a teacher, or of anybody: `lab.classroom.lessons.text` makes a few elements
of them and escapes all else. A hand-made message of a browser may contain any value, which `HandIn` checks.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from html import escape
from typing import Any, NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.exchange import Download
from dashboards.pages.lessons.step_view import BUTTONS, CHOICES, TEXT, Choices
from dashboards.seen_names import html_as_seen
from dashboards.style import plain_row, whole_column, wide_html
from dashboards.upload import plain_name
from lab.classroom.homework.hand_in import LONGEST_NAME, SUFFIX
from lab.classroom.homework.homework import LONGEST_ANSWER, Homework, fault_titles
from lab.classroom.lessons.text import text_html

PARTS = """
h3 { font: 500 17px/1.35 Roboto, sans-serif; margin: 12px 0 4px; }
h3 .where { font-weight: 400; margin-left: 6px; } h3 .where, li .where { white-space: nowrap; }
"""


class Answers(NamedTuple):
    """What a student has typed and chosen.

    Attributes
    ----------
    name : str
        His name.
    faults : tuple of str
        The faults that he names.
    answers : tuple of str
        His answers to the questions.
    """

    name: str
    faults: tuple[str, ...]
    answers: tuple[str, ...]


class Doings(NamedTuple):
    """What a person can do.

    Attributes
    ----------
    begin, take, close : callable
        Begin with the settings of the homework; run it with the settings at the left; go back to the list.
    hand_in : callable
        Returns the content of the file for answers; None if it is refused.
    changed : callable
        Called when something is typed or chosen.
    """

    begin: Callable[[], None]
    take: Callable[[], None]
    close: Callable[[], None]
    hand_in: Callable[[Answers], bytes | None]
    changed: Callable[[], None]


class HomeworkView:
    """The view of the homework that is open.

    Parameters
    ----------
    doings
        What its buttons do.

    Attributes
    ----------
    view : panel.Column
        What to place on the page.
    """

    def __init__(self, doings: Doings) -> None:
        self._doings = doings
        self._said = wide_html(margin=(2, 4), stylesheets=[TEXT])
        self._faults: Any = None
        self._entries: list[Any] = []
        self.view = whole_column(margin=(6, 12, 20, 12))

    def show(self, homework: Homework) -> None:
        """Show a homework, without answers."""
        self._said.object = ""
        self._name = pmui.TextInput(
            label="Your name",
            value=homework.student,
            disabled=bool(homework.student),  # the hidden values are those of this student
            size="small",
            variant="outlined",
            margin=(8, 4),
            width=280,
        )
        self._name.param.watch(lambda _event: self._rename(), "value")
        self._file = Download(
            callback=self._content,
            filename=f"homework{SUFFIX}",
            label="Save the file to hand in",
            variant="contained",
            size="small",
            margin=(8, 4),
        )
        self._rename()
        head = f'<h2>{escape(homework.title)}</h2><p class="where">{_changes(homework)}</p>'
        self.view[:] = [
            self._html(head + text_html(homework.text)),
            self._buttons(),
            *self._asked(homework),
            *self._goals(homework),
            self._html(
                "<h3>Hand in</h3><p>The file holds your name, your answers, and the settings at the left. It "
                "is sealed for your teacher, who runs your settings again.</p>"
            ),
            self._name,
            self._file,
            self._said,
            self._hand_in_widgets(),
        ]
        for entry in [one for one in (self._name, self._faults, *self._entries) if one is not None]:
            entry.param.watch(lambda _event: self._doings.changed(), "value")

    @property
    def typed(self) -> Answers:
        """What is typed and chosen."""
        return self._answers()

    def type_again(self, given: Answers) -> None:
        """Type and choose what was typed and chosen before."""
        self._name.value = given.name
        if self._faults is not None:
            self._faults.value = [one for one in given.faults if one in self._faults.options]
        for entry, answer in zip(self._entries, given.answers, strict=False):
            if answer and (not isinstance(entry, Choices) or answer in entry.options):
                entry.value = answer

    def say(self, sentence: str, kind: str = "wrong") -> None:
        """Show a sentence in plain text below the button; an empty one shows nothing."""
        words = f'<div class="step"><div class="said {kind}">{escape(sentence)}</div></div>'
        self._said.object = words if sentence else ""

    def _asked(self, homework: Homework) -> list[pn.viewable.Viewable]:
        """Return the questions with their entries."""
        parts: list[pn.viewable.Viewable] = []
        self._faults, self._entries = None, []
        if homework.names_faults:
            self._faults = pmui.CheckBoxGroup(
                options=list(fault_titles()), margin=(0, 8), sizing_mode="stretch_width", sx=CHOICES
            )
            words = f"<h3>Which faults are hidden? {_points(homework.fault_points)}</h3>"
            parts += [self._html(f"{words}<p>A wrong answer cancels a right one.</p>"), self._faults]
        for number, question in enumerate(homework.questions, 1):
            words = f"<h3>Question {number} {_points(question.points)}</h3>{text_html(question.text)}"
            entry: Any = (
                Choices(
                    options=list(question.choices), margin=(0, 8), sizing_mode="stretch_width", sx=CHOICES
                )
                if question.choices
                else pmui.TextInput(
                    label="Your answer, a number", size="small", variant="outlined", margin=(8, 4), width=240
                )
            )
            self._entries.append(entry)
            parts += [self._html(words), entry]
        return parts

    def _goals(self, homework: Homework) -> list[pn.viewable.Viewable]:
        goals = [goal for goal in homework.goals if goal.text]
        if not goals:
            return []
        listed = "".join(
            f"<li>{_unwrap_paragraph(goal.text)} · {_points(goal.points)}</li>" for goal in goals
        )
        return [self._html(f"<h3>What your settings should reach</h3><ul>{listed}</ul>")]

    def _answers(self) -> Answers:
        """Return what is typed and chosen; values of other types count as nothing."""
        faults = self._faults.value if self._faults is not None else []
        named = faults if isinstance(faults, list) else []
        values = [entry.value for entry in self._entries]
        return Answers(
            _text(self._name.value, LONGEST_NAME + 1),
            tuple(one for one in named if isinstance(one, str)),
            tuple(_text(value, LONGEST_ANSWER + 1) for value in values),
        )

    def _content(self) -> io.BytesIO | None:
        content = self._doings.hand_in(self._answers())
        return None if content is None else io.BytesIO(content)

    def _rename(self) -> None:
        """Name the file after the student."""
        name = plain_name(_text(self._name.value, LONGEST_NAME)).replace(" ", "_")
        self._file.filename = f"{name}{SUFFIX}"

    def _buttons(self) -> pn.viewable.Viewable:
        common = {"variant": "outlined", "size": "small", "margin": (4, 4)}
        again = pmui.Button(label="Start again", icon="restart_alt", **common)
        again.on_click(lambda _event: self._doings.begin())
        take = pmui.Button(label="Run with the settings at the left", icon="play_arrow", **common)
        take.on_click(lambda _event: self._doings.take())
        return plain_row(again, take, stylesheets=[BUTTONS])

    def _hand_in_widgets(self) -> pn.viewable.Viewable:
        away = pmui.Button(label="All lessons", icon="list", variant="text", size="small", margin=(14, 4))
        away.on_click(lambda _event: self._doings.close())
        return plain_row(away, stylesheets=[BUTTONS])

    def _html(self, inside: str) -> pn.pane.HTML:
        return wide_html(
            f'<div class="step">{html_as_seen(inside)}</div>', margin=(2, 4), stylesheets=[TEXT, PARTS]
        )


def _changes(homework: Homework) -> str:
    names = ", ".join(f"<code>{escape(place)}</code>" for place in homework.scenario.change)
    return f"Homework · {_points(homework.best)} · You may change: {names or 'nothing'}."


def _points(points: float) -> str:
    return f'<span class="where">{points:g} point{"" if points == 1 else "s"}</span>'


def _unwrap_paragraph(text: str) -> str:
    """Return a text of one paragraph without the element of its paragraph."""
    return text_html(text).removeprefix("<p>").removesuffix("</p>")


def _text(value: object, longest: int) -> str:
    return value[:longest] if isinstance(value, str) else ""
