"""Lesson list: all lessons of the server, with the number of steps that this session has solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape

import panel as pn
import panel_material_ui as pmui

from dashboards.style import plain_row, whole_column
from lab.classroom.lessons.catalogue import Entry
from lab.classroom.lessons.lesson import Lesson

HEADINGS = {
    "own": "Lessons of your teacher",
    "shipped": "Lessons",
    "gallery": "Break it: one hidden fault in each",
}
"""Heading of each origin, in the order of the page."""

Key = tuple[str, str]

HEADING = """
h2 { font: 500 18px/1.4 Roboto, sans-serif; margin: 14px 0 2px; }
"""
SUMMARY = """
:host { flex: 1 1 260px !important; min-width: 0 !important; }
div { font: 14px/1.45 Roboto, sans-serif; padding: 6px 0; overflow-wrap: anywhere; }
@media (max-width: 600px) { div { padding: 0 0 4px; } }  /* two nested ones, below the title */
.count { opacity: .7; white-space: nowrap; }
.done { color: color-mix(in srgb, #1a8f4c 65%, currentColor); font-weight: 500; }
.problem { border-left: 3px solid #d0702e; padding-left: 8px; }
"""
ROW = ":host { flex-wrap: wrap; border-bottom: 1px solid rgba(128,128,128,.18); }"
TITLE = {"justifyContent": "flex-start", "textAlign": "left"}
"""Style of the button with the title of a lesson."""
WIDTH = 300
"""Width of the titles [px]."""


class LessonList:
    """The list.

    Parameters
    ----------
    open_lesson
        Called with origin and name of the lesson that a person opens.

    Attributes
    ----------
    view : panel.Column
        The list to place on the page.
    """

    def __init__(self, open_lesson: Callable[[Key], None]) -> None:
        self._open = open_lesson
        self.view = whole_column(margin=(4, 8))

    def show(self, entries: Sequence[Entry], solved: Mapping[Key, set[int]]) -> None:
        """Show lessons, and how many steps of each are solved."""
        shown: list[pn.viewable.Viewable] = []
        for origin, heading in HEADINGS.items():
            of_origin = [entry for entry in entries if entry.origin == origin]
            if of_origin:
                shown.append(pn.pane.HTML(f"<h2>{heading}</h2>", margin=(0, 4), stylesheets=[HEADING]))
            shown += [self._row(entry, solved.get((entry.origin, entry.name), set())) for entry in of_origin]
        self.view[:] = shown

    def _row(self, entry: Entry, solved: set[int]) -> pn.viewable.Viewable:
        button = pmui.Button(
            label=entry.lesson.title if entry.lesson else entry.name,
            icon="school" if entry.origin != "gallery" else "bug_report",
            variant="text",
            margin=0,
            width=WIDTH,
            disabled=entry.lesson is None,
            sx=TITLE,
        )
        key = entry.origin, entry.name
        button.on_click(lambda _event: self._open(key))
        words = pn.pane.HTML(_describe(entry, solved), margin=(0, 4), stylesheets=[SUMMARY])
        return plain_row(button, words, stylesheets=[ROW])


def _describe(entry: Entry, solved: set[int]) -> str:
    if entry.lesson is None:
        return f'<div class="problem">{escape(entry.problem)}</div>'
    return f"<div>{escape(entry.lesson.summary)} {progress_html(entry.lesson, solved)}</div>"


def progress_html(lesson: Lesson, solved: set[int]) -> str:
    """Return how many steps are solved, of those in which there is something to solve; empty without any."""
    asked = {number for number, step in enumerate(lesson.steps) if step.asks}
    if not asked:
        return ""
    done = len(asked & solved)
    kind = "count done" if done == len(asked) else "count"
    return f'<span class="{kind}">{done} of {len(asked)} solved</span>'
