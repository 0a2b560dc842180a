"""Lesson file: a lesson from TOML. Every key is checked; a message says where, and what is accepted."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lab.base.parameters.setting_kinds import AxisQuantity, QuantityOrNone
from lab.base.parameters.toml_file import TomlError, parse_toml, read_text
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.lessons.check import Check, CheckError, parse_check
from lab.classroom.lessons.fields import (
    LessonError,
    check_keys,
    read_answer,
    read_number,
    read_settings,
    text_of,
    try_settings,
)
from lab.classroom.lessons.lesson import PAGES, RENAMED, Lesson, Step
from lab.experiment.experiment import Experiment

LARGEST = 100_000
"""Largest file of a lesson [bytes]; the largest that ships has 6 kB."""
MOST_STEPS = 20
"""Most steps; more than a lesson of 90 minutes has."""
MOST_WRONG = 10
"""Most wrong settings that a check is tried with."""
LONGEST = {"title": 80, "summary": 200, "text": 6000, "question": 500, "hint": 1000, "because": 2000}
"""Longest texts [characters]; a page of a book has 3000."""

OF_LESSON = ("title", "summary", "settings", "fault", "step")
OF_STEP = (
    *("title", "text", "settings", "page", "time", "question", "choices", "answer", "tolerance"),
    *("check", "hint", "because", "solution", "wrong"),
)
"""Keys of a step."""


def read_lesson(path: Path) -> Lesson:
    """Return the lesson in a file.

    Raises
    ------
    LessonError
        If the file cannot be read, or is no lesson.
    """
    name = path.name or str(path)  # a point has no name
    try:
        text = _bounded_text(path)
        tables = parse_toml(text)
    except OSError as error:
        raise LessonError(f"{name}: cannot be read: {error.strerror or error}") from error
    except (TomlError, LessonError) as error:
        raise LessonError(f"{name}: {error}") from error
    try:
        return make_lesson(path.stem, tables)
    except LessonError as error:
        message = str(error)
        raise LessonError(f"{name}, line {find_line(text, message)}: {message}") from error


def _bounded_text(path: Path) -> str:
    """Return the text of a file that is not too large: while it is read, all visitors wait."""
    size = path.stat().st_size
    if size > LARGEST:
        raise LessonError(f"has {size} bytes; accepted are lessons up to {LARGEST // 1000} kB")
    return read_text(path)


def make_lesson(name: str, tables: Mapping[str, Any]) -> Lesson:
    """Return the lesson that the tables of a TOML file describe.

    Raises
    ------
    LessonError
        If they describe none.
    """
    check_keys(tables, OF_LESSON, "")
    steps = tables.get("step")
    if not isinstance(steps, list) or not steps or not all(isinstance(step, dict) for step in steps):
        there = "it is one table, [step]" if isinstance(steps, dict) else "there is none"
        raise LessonError(f"step: {there}; accepted are 1 to {MOST_STEPS} tables [[step]]")
    if len(steps) > MOST_STEPS:
        raise LessonError(f"step: there are {len(steps)}; accepted are 1 to {MOST_STEPS}")
    fault = text_of(tables, "fault", "", 20) if "fault" in tables else ""
    if fault and fault not in FAULTS:
        raise LessonError(f"fault = {fault!r}: accepted is one of {', '.join(FAULTS)}")
    settings, trial = read_settings(tables, "settings", "") or {}, Experiment()
    try_settings(trial, settings, "settings")
    return Lesson(
        name=name,
        title=text_of(tables, "title", "", LONGEST["title"]),
        summary=text_of(tables, "summary", "", LONGEST["summary"], needed=False),
        steps=tuple(_step(step, trial, f"step {number}: ") for number, step in enumerate(steps, 1)),
        settings=settings,
        fault=fault,
    )


def _step(table: Mapping[str, Any], trial: Experiment, where: str) -> Step:
    check_keys(table, OF_STEP, where)
    settings = read_settings(table, "settings", where)
    try_settings(trial, settings or {}, f"{where}settings")
    solution = read_settings(table, "solution", where)
    wrong = table.get("wrong", [])
    if (
        not isinstance(wrong, list)
        or not all(isinstance(one, dict) for one in wrong)
        or len(wrong) > MOST_WRONG
    ):
        raise LessonError(f"{where}wrong: accepted are up to {MOST_WRONG} tables of settings")
    for key, tried in (("solution", [solution or {}]), ("wrong", wrong)):
        for one in tried:
            try_settings(trial, one, f"{where}{key}")
    question = text_of(table, "question", where, LONGEST["question"], needed=False, marked=True)
    choices, answer, tolerance = read_answer(table, where)
    if question and answer is None and "check" not in table:
        raise LessonError(f"{where}question: has neither answer nor check; accepted is one of them, or both")
    if answer is not None and not question:
        raise LessonError(f"{where}answer: there is no question; accepted are both or none")
    if (solution is not None or wrong) and "check" not in table:
        raise LessonError(f"{where}solution, wrong: there is no check that they could be tried with")
    return Step(
        title=text_of(table, "title", where, LONGEST["title"]),
        text=text_of(table, "text", where, LONGEST["text"], marked=True),
        settings=settings,
        page=_page(table, where),
        time=read_number(table, "time", where, least=0.0),
        question=question,
        choices=choices,
        answer=answer,
        tolerance=tolerance,
        check=_check(table, trial, where),
        hint=text_of(table, "hint", where, LONGEST["hint"], needed=False, marked=True),
        because=text_of(table, "because", where, LONGEST["because"], needed=False, marked=True),
        solution=solution,
        wrong=tuple(wrong),
    )


def _page(table: Mapping[str, Any], where: str) -> str:
    page = text_of(table, "page", where, LONGEST["title"], needed=False)
    page = RENAMED.get(page, page)
    if page and page not in PAGES:
        raise LessonError(f"{where}page = {page!r}: accepted is one of {', '.join(PAGES)}")
    return page


def _check(table: Mapping[str, Any], trial: Experiment, where: str) -> Check | None:
    text = table.get("check")
    if text is None:
        return None
    if not isinstance(text, str):
        raise LessonError(f"{where}check: is not a text; accepted is a condition such as 'nis < 1.5'")
    try:
        return parse_check(text, numeric_in(trial))
    except CheckError as error:
        raise LessonError(f"{where}check: {error}") from error


def numeric_in(experiment: Experiment) -> Callable[[str], bool]:
    """Return a function that says whether a path is that of a setting with numbers; true counts as 1."""
    numeric = {
        path
        for path, owner, name in experiment.leaves()
        if isinstance(owner.param[name], AxisQuantity | QuantityOrNone)
        or isinstance(owner.param[name].default, int | float)
    }
    return numeric.__contains__


_MESSAGE = re.compile(r"(?:step (?P<step>\d+): )?(?P<key>\w+)(?:, \w+)*(?:: (?P<path>[\w.]+))?")
_HEAD = re.compile(r"\s*\[\[\s*step\s*\]\]")
_TEXTS = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)


def find_line(text: str, message: str) -> int:
    """Return the line, from 1, that a message of `lab.classroom.lessons.lesson_file` is about.

    Parameters
    ----------
    text
        The file, which is TOML.
    message
        The message: the step if there is one, the key, and the path of a setting if it is about one. A
        missing key has the line at which its step begins.
    """
    found = _MESSAGE.match(message)
    lines = _TEXTS.sub(lambda quoted: re.sub(r"[^\n]", " ", quoted[0]), text).split("\n")
    heads = [number for number, line in enumerate(lines) if _HEAD.match(line)]
    first, last = 0, heads[0] if heads else len(lines)
    if found is None:
        return 1
    if found["step"] is not None:
        number = int(found["step"])
        if number > len(heads):  # the steps are written in another way, such as in one line
            return 1
        first, last = heads[number - 1], heads[number] if number < len(heads) else len(lines)
    key = _line_with(lines, found["key"], first, last)
    if key is None:
        return first + 1
    parts = [] if found["path"] is None else found["path"].split(".")
    inside = _line_with(lines, parts[-1], key, last) if parts else None
    return 1 + (key if inside is None else inside)


def _line_with(lines: list[str], name: str, first: int, last: int) -> int | None:
    """Return the first line of a stretch that sets a key, or begins its table; None without one."""
    sets = re.compile(rf"(?:^|[\s.{{,\[]){re.escape(name)}\s*(?:[=.\]]|$)")
    return next((number for number in range(first, last) if sets.search(lines[number])), None)
