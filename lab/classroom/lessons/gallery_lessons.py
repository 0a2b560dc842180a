"""Gallery lessons: ten runs with one hidden fault each, made from the rows of ``gallery.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.base.parameters.toml_file import read_toml
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.lessons.lesson import Lesson
from lab.classroom.lessons.lesson_file import lesson_of

SUMMARY = "Something is wrong in this run. Find it from errors, innovations, NEES and verdict."


def gallery_lessons() -> list[Lesson]:
    """Return the lessons of the gallery; their names and titles do not give the fault away."""
    table = read_toml(Path(__file__).with_name("gallery.toml"))
    return [_lesson(number, row, table) for number, row in enumerate(table["fault"], 1)]


def _lesson(number: int, row: Mapping[str, Any], table: Mapping[str, Any]) -> Lesson:
    seen, known, named, repaired = (dict(step) for step in table["step"])
    seen["answer"], known["answer"] = row["innovations"], row["nees"]
    named["choices"] = sorted(fault.title for fault in FAULTS.values())
    named |= {"answer": FAULTS[row["name"]].title, "because": row["because"]}
    steps = [seen, known, named]
    if "repair" in row:
        repaired["text"] = f"{row['repair']}\n\n{repaired['text']}"
        steps.append(repaired | {key: row[key] for key in ("check", "solution", "wrong")})
    return lesson_of(
        f"break-it-{number:02}",
        {
            "title": f"Break it {number}",
            "summary": SUMMARY,
            "settings": table["settings"],
            "fault": row["name"],
            "step": steps,
        },
    )
