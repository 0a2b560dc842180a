"""Class view: the link of a class with its QR code, and the counts of its students, as HTML.

Names that students typed are text only.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from dashboards.teaching.class_link import ClassLink
from dashboards.teaching.school_class import Tally
from lab.base.qr_code import qr_code, qr_svg
from lab.classroom.lessons.lesson import Lesson

STYLE = """
div { font: 15px/1.5 Roboto, sans-serif; }
table { border-collapse: collapse; } td, th { padding: 3px 14px 3px 0; text-align: left; font-weight: 400; }
th { opacity: .7; } td.count { text-align: right; font-variant-numeric: tabular-nums; font-weight: 600; }
p { margin: 4px 0; } .problem { border-left: 4px solid #d0702e; padding: 2px 10px; }
.link { font: 600 clamp(17px, 2.4vw, 40px)/1.35 Roboto, sans-serif; overflow-wrap: anywhere; }
svg { width: min(62vh, 100%); height: auto; display: block; margin: 0 auto; }
.invitation { text-align: center; }
"""
LABEL = "QR code of the link for students"


def invitation_html(link: ClassLink) -> str:
    """Return the QR code of the link, and the link in large letters."""
    problem = f'<p class="problem" role="alert">{escape(link.problem)}</p>' if link.problem else ""
    return (
        f'<div class="invitation">{problem}{qr_svg(qr_code(link.address), LABEL)}'
        f'<p class="link">{escape(link.address)}</p></div>'
    )


def line_html(code: str, tally: Tally, lesson: Lesson | None, step: int) -> str:
    """Return how many students are in a class, and how many of them have solved the step that is open."""
    parts = [f"Class <b>{escape(code)}</b>"]
    if not tally.present:
        parts.append("no student is here yet")
    else:
        parts.append(f"<b>{tally.present}</b> here, <b>{tally.following}</b> follow")
    if tally.present and lesson is not None and lesson.steps[step].asks:
        solved = tally.solved.get(step, 0)
        parts.append(f"step {step + 1} solved by <b>{solved}</b> of {tally.present}")
    return " · ".join(parts)


def students_html(tally: Tally, lesson: Lesson | None, *, with_names: bool) -> str:
    """Return how many students have solved each step, and what those with a name have solved.

    Parameters
    ----------
    tally
        The students.
    lesson
        The lesson that the teacher has open; None without one.
    with_names
        Whether the names are shown; a teacher whose screen is projected does not show them.
    """
    if lesson is None:
        steps = "<p>Open a lesson to see how many students have solved each step.</p>"
    else:
        rows = "".join(
            f'<tr><td>{number + 1}</td><td>{escape(step.title)}</td><td class="count">'
            f"{f'{tally.solved.get(number, 0)} of {tally.present}' if step.asks else '–'}</td></tr>"
            for number, step in enumerate(lesson.steps)
        )
        steps = f"<table><tr><th>step</th><th>{escape(lesson.title)}</th><th>solved</th></tr>{rows}</table>"
    if not with_names:
        return f"<div>{steps}</div>"
    if not tally.named:
        return f"<div>{steps}<p>No student has typed a name.</p></div>"
    names = "".join(
        f"<tr><td>{escape(one.name)}</td><td>{_numbers(one.solved)}</td></tr>" for one in tally.named
    )
    return f"<div>{steps}<table><tr><th>name</th><th>solved steps</th></tr>{names}</table></div>"


def _numbers(steps: Sequence[int]) -> str:
    return ", ".join(str(step + 1) for step in steps) or "–"
