"""Solutions sheet: everything that the key of a homework knows, as one page to print.

Texts come from a teacher's file: `lab.classroom.lessons.text` makes a few elements of them, and all else is
escaped. The page has no script, and needs nothing from elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from lab.classroom.gallery.faults import FAULTS
from lab.classroom.homework.homework import Judge, Solution
from lab.classroom.homework.homework_file import Keyed
from lab.classroom.lessons.text import text_html

_STYLE = Path(__file__).with_name("solutions_sheet.css").read_text("utf-8")


def solutions_html(keyed: Keyed, students: Sequence[str] = ()) -> str:
    """Return the sheet as a page of HTML.

    Parameters
    ----------
    keyed
        The homework with its key.
    students
        Names, for a row each, if each student has a variant.
    """
    judge = keyed.judge
    homework = judge.homework
    parts = [
        f"<h1>Solutions: {escape(homework.title)}</h1>",
        f"<p>Homework {escape(homework.name)}, {homework.best:g} points. For teachers only.</p>",
        text_html(homework.text),
        "<h2>What is hidden</h2>",
        _hidden_table(keyed),
    ]
    if homework.names_faults:
        titles = [fault.title for fault in homework.scenario.hidden.found]
        shown = (
            "Each student has other faults; see below."
            if "faults" in keyed.varying.paths
            else escape(", ".join(titles) or "none")
        )
        parts += [_question("Which faults are hidden?", homework.fault_points, shown)]
    for number, (question, right) in enumerate(zip(homework.questions, judge.solutions, strict=True), 1):
        title = f"Question {number}"
        own = number in keyed.varying.answers
        answer = "Each student has another answer; see below." if own else escape(_answer(right))
        parts += [_question(title, question.points, answer, text_html(question.text))]
    for number, (goal, check) in enumerate(zip(homework.goals, judge.checks, strict=True), 1):
        words = text_html(goal.text) if goal.text else "<p>Students do not read this goal.</p>"
        parts += [_question(f"Goal {number}", goal.points, f"<code>{escape(check.text)}</code>", words)]
    if keyed.varies:
        parts += [_variants(keyed, students)]
    body = "\n".join(parts)
    title = escape(f"Solutions: {homework.title}")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _question(title: str, points: float, right: str, words: str = "") -> str:
    worth = f"{points:g} point{'' if points == 1 else 's'}"
    head = f'<h2>{escape(title)} <span class="points">({worth})</span></h2>'
    return f'<div class="question">{head}{words}<p class="right">{right}</p></div>'


def _answer(right: Solution) -> str:
    if isinstance(right.answer, str):
        return right.answer
    return f"{right.answer:g} ± {right.tolerance:g}"


def _hidden_table(keyed: Keyed) -> str:
    """Return a table of what is hidden from all students."""
    hidden, varying = keyed.judge.homework.scenario.hidden, keyed.varying
    rows = [("faults", ", ".join(FAULTS[name].title for name in hidden.faults) or "none")]
    rows += [(path, _format_value(value)) for path, value in _leaves(hidden.settings)]
    rows += [("seed", str(hidden.seed))]
    own = {*varying.paths, *(("seed",) if varying.seed else ())}
    rows = [(name, "another for each student" if name in own else value) for name, value in rows]
    cells = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td>{escape(value)}</td></tr>" for name, value in rows
    )
    return f"<table><tr><th>What</th><th>Value</th></tr>{cells}</table>"


def _variants(keyed: Keyed, students: Sequence[str]) -> str:
    if not students:
        return "<h2>Variants</h2><p>Name the students with a roster to see the values of each.</p>"
    names = keyed.varying.paths
    numbers = [k for k in range(1, len(keyed.homework.questions) + 1) if k in keyed.varying.answers]
    head = ["Student", *names, "seed", *(f"Question {k}" for k in numbers)]
    rows = "".join(
        "<tr>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in _cells(keyed.judge_for(name), names, numbers))
        + "</tr>"
        for name in students
    )
    titles = "".join(f"<th>{escape(one)}</th>" for one in head)
    return f'<h2>Variants</h2><div class="scroll"><table><tr>{titles}</tr>{rows}</table></div>'


def _cells(judge: Judge, names: Sequence[str], numbers: Sequence[int]) -> list[str]:
    homework = judge.homework
    hidden = homework.scenario.hidden
    settings = dict(_leaves(hidden.settings))
    values = [
        ", ".join(FAULTS[one].title for one in hidden.faults) or "none"
        if name == "faults"
        else _format_value(settings[name])
        for name in names
    ]
    return [homework.student, *values, str(hidden.seed), *(_answer(judge.solutions[k - 1]) for k in numbers)]


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _format_value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_format_value, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
