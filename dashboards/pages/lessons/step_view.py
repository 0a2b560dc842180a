"""Step view: the text of one step, its buttons, its question, and what there is to say of the answer.

Texts come from files of a teacher: `lab.classroom.lessons.text` makes a few elements of them and escapes all
else. Choices and titles of buttons are plain text.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.lessons.lesson_list import progress_html
from dashboards.seen_names import html_as_seen
from dashboards.style import plain_row, whole_column, wide_html
from lab.classroom.exercises.exercise import Outcome
from lab.classroom.lessons.lesson import Answer, Lesson, Step
from lab.classroom.lessons.text import text_html

TEXT = Path(__file__).with_name("step_view.css").read_text("utf-8")
CHOICES = {"& .MuiFormControlLabel-label": {"whiteSpace": "normal", "lineHeight": 1.35, "padding": "5px 0"}}
"""Style of the choices: long ones wrap on a phone."""
BUTTONS = ":host { flex-wrap: wrap; }"
LONGEST_ANSWER = 40
"""Most characters of a typed number that are read."""
_KINDS = {None: ("", ""), True: ("right", "✓ Right."), False: ("wrong", "✗ Not yet.")}


class Choices(pmui.RadioBoxGroup):
    """Choices of which none is chosen at first: the first one may be the answer."""

    _allows_none = True

    def __init__(self, **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]


class Actions(NamedTuple):
    """What a person can do in a step.

    Attributes
    ----------
    apply, look : callable
        Apply the settings of the step; go to its page and time.
    answer : callable
        Check an answer, None where the step asks for none.
    turn : callable
        Go on by so many steps; behind the last one follows the next lesson.
    close : callable
        Go back to the list.
    """

    apply: Callable[[], None]
    look: Callable[[], None]
    answer: Callable[[Answer], None]
    turn: Callable[[int], None]
    close: Callable[[], None]


class StepView:
    """The view of the step that is open.

    Parameters
    ----------
    actions
        What its buttons do.

    Attributes
    ----------
    view : panel.Column
        What to place on the page.
    """

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._said = wide_html(margin=(2, 4), stylesheets=[TEXT])
        self._head = wide_html(margin=(2, 4), stylesheets=[TEXT])
        self._entry: Any = None
        self.view = whole_column(margin=(6, 12, 20, 12))

    def show(self, lesson: Lesson, number: int, solved: set[int], *, has_next: bool) -> None:
        """Show a step of a lesson, without an answer; after the last one, a next lesson may follow."""
        step = lesson.steps[number]
        self._entry = _entry(step)
        self._said.object = ""
        self.show_progress(lesson, number, solved)
        text = self._html(f"<h2>{escape(step.title)}</h2>{text_html(step.text)}")
        parts = [self._head, text, self._action_buttons(step)]
        if step.question:
            parts.append(self._html(text_html(step.question)))
        if self._entry is not None:
            parts.append(self._entry)
        if step.asks:
            word = "Check the answer" if step.answer is not None else "Check my result"
            check = pmui.Button(label=word, icon="check", variant="contained", size="small", margin=(8, 4))
            check.on_click(lambda _event: self._actions.answer(self._answer(step)))
            parts.append(check)
        self.view[:] = [*parts, self._said, self._ways(lesson, number, has_next=has_next)]

    def show_progress(self, lesson: Lesson, number: int, solved: set[int]) -> None:
        """Show which step this is, and how many are solved."""
        self._head.object = (
            f'<div class="step where">{escape(lesson.title)} · step {number + 1} of {len(lesson.steps)} · '
            f"{progress_html(lesson, solved)}</div>"
        )

    def say(self, outcome: Outcome) -> None:
        """Show what there is to say of an answer."""
        kind, word = _KINDS[outcome.right]
        words = f"<p><b>{word}</b></p>" if word else ""
        self._show_outcome(kind, words + text_html(outcome.text))

    def warn(self, sentence: str) -> None:
        """Show a sentence in plain text in place of what is said of an answer."""
        self._show_outcome("wrong", escape(sentence))

    def _show_outcome(self, kind: str, inside: str) -> None:
        self._said.object = f'<div class="step"><div class="said {kind}">{html_as_seen(inside)}</div></div>'

    def _html(self, inside: str) -> pn.pane.HTML:
        return wide_html(f'<div class="step">{html_as_seen(inside)}</div>', margin=(2, 4), stylesheets=[TEXT])

    def _answer(self, step: Step) -> Answer:
        """Return the answer as it is typed or chosen; a hand-made message may contain any value."""
        if self._entry is None:
            return None
        value = self._entry.value
        if step.choices:
            return value if value in step.choices else None
        return value[:LONGEST_ANSWER] if isinstance(value, str) else None

    def _action_buttons(self, step: Step) -> pn.viewable.Viewable:
        """Return the buttons that apply settings, and go to another page."""
        buttons, common = [], {"variant": "outlined", "size": "small", "margin": (4, 4)}
        if step.settings is not None:
            again = pmui.Button(label="Start this step again", icon="restart_alt", **common)
            again.on_click(lambda _event: self._actions.apply())
            buttons.append(again)
        if step.page:
            at = "" if step.time is None else f" at {step.time:g} s"
            look = pmui.Button(label=f"Look at {step.page}{at}", icon="visibility", **common)
            look.on_click(lambda _event: self._actions.look())
            buttons.append(look)
        return plain_row(*buttons, stylesheets=[BUTTONS])

    def _ways(self, lesson: Lesson, number: int, *, has_next: bool) -> pn.viewable.Viewable:
        """Return the buttons to the steps before and after, to the next lesson, and to the list."""
        common = {"variant": "text", "size": "small", "margin": (14, 4)}
        back = pmui.Button(label="Back", icon="arrow_back", disabled=number == 0, **common)
        back.on_click(lambda _event: self._actions.turn(-1))
        is_last = number + 1 == len(lesson.steps)
        word = "Next lesson" if is_last else "Next step"
        on = pmui.Button(label=word, icon="arrow_forward", disabled=is_last and not has_next, **common)
        on.on_click(lambda _event: self._actions.turn(1))
        away = pmui.Button(label="All lessons", icon="list", **common)
        away.on_click(lambda _event: self._actions.close())
        return plain_row(back, on, away, stylesheets=[BUTTONS])


def _entry(step: Step) -> Any:
    """Return the widget for an answer; None where there is none to give."""
    if step.choices:
        return Choices(options=list(step.choices), margin=(0, 8), sizing_mode="stretch_width", sx=CHOICES)
    if step.answer is None:
        return None
    return pmui.TextInput(
        label="Your answer, a number", size="small", variant="outlined", margin=(8, 4), width=240
    )
