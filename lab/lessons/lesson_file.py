"""Lesson file: a lesson from TOML. Every key is checked; a message says step, key, and what is accepted."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lab.experiment import Experiment
from lab.gallery.faults import FAULTS
from lab.lessons.check import Check, CheckError, parse_check
from lab.lessons.lesson import PAGES, Lesson, Step
from lab.lessons.text import TextError, text_html
from lab.missions import missions
from lab.setting_kinds import AxisQuantity, QuantityOrNone
from lab.settings import SettingError
from lab.toml_file import TomlError, parse_toml, read_text

LARGEST = 100_000
"""Largest file of a lesson [bytes]; the largest that ships has 6 kB."""
MOST_STEPS = 20
"""Most steps; more than a lesson of 90 minutes has."""
MOST_CHOICES = 12
"""Most answers to choose from; the gallery has 10."""
MOST_WRONG = 10
"""Most wrong settings that a check is tried with."""
LONGEST = {"title": 80, "summary": 200, "text": 6000, "question": 500, "hint": 1000, "because": 2000}
"""Longest texts [characters]; a page of a book has 3000."""
LONGEST_CHOICE = 100
"""Longest answer to choose [characters]."""

OF_LESSON = ("title", "summary", "settings", "fault", "step")
OF_STEP = (
    *("title", "text", "settings", "page", "time", "question", "choices", "answer", "tolerance"),
    *("check", "hint", "because", "solution", "wrong"),
)
"""Keys of a step."""


class LessonError(ValueError):
    """A lesson that is not accepted; the message says where, why, and what is accepted."""


def read_lesson(path: Path) -> Lesson:
    """Return the lesson in a file.

    Raises
    ------
    LessonError
        If the file cannot be read, or is no lesson.
    """
    try:
        return lesson_of(path.stem, parse_toml(_bounded_text(path)))
    except OSError as error:
        raise LessonError(f"{path.name}: cannot be read: {error.strerror or error}") from error
    except (TomlError, LessonError) as error:
        raise LessonError(f"{path.name}: {error}") from error


def _bounded_text(path: Path) -> str:
    """Return the text of a file that is not too large: while it is read, all visitors wait."""
    size = path.stat().st_size
    if size > LARGEST:
        raise LessonError(f"has {size} bytes; accepted are lessons up to {LARGEST // 1000} kB")
    return read_text(path)


def lesson_of(name: str, tables: Mapping[str, Any]) -> Lesson:
    """Return the lesson that the tables of a TOML file describe.

    Raises
    ------
    LessonError
        If they describe none.
    """
    _check_keys(tables, OF_LESSON, "")
    steps = tables.get("step")
    if not isinstance(steps, list) or not steps or not all(isinstance(step, dict) for step in steps):
        raise LessonError(f"step: there is none; accepted are 1 to {MOST_STEPS} tables [[step]]")
    if len(steps) > MOST_STEPS:
        raise LessonError(f"step: there are {len(steps)}; accepted are 1 to {MOST_STEPS}")
    fault = _text(tables, "fault", "", 20) if "fault" in tables else ""
    if fault and fault not in FAULTS:
        raise LessonError(f"fault = {fault!r}: accepted is one of {', '.join(FAULTS)}")
    settings, trial = _settings(tables, "settings", "") or {}, Experiment()
    _try(trial, settings, "settings")
    return Lesson(
        name=name,
        title=_text(tables, "title", "", LONGEST["title"]),
        summary=_text(tables, "summary", "", LONGEST["summary"], needed=False),
        steps=tuple(_step(step, trial, f"step {number}: ") for number, step in enumerate(steps, 1)),
        settings=settings,
        fault=fault,
    )


def _step(table: Mapping[str, Any], trial: Experiment, where: str) -> Step:
    _check_keys(table, OF_STEP, where)
    settings = _settings(table, "settings", where)
    _try(trial, settings or {}, f"{where}settings")
    solution = _settings(table, "solution", where)
    wrong = table.get("wrong", [])
    if (
        not isinstance(wrong, list)
        or not all(isinstance(one, dict) for one in wrong)
        or len(wrong) > MOST_WRONG
    ):
        raise LessonError(f"{where}wrong: accepted are up to {MOST_WRONG} tables of settings")
    for key, tried in (("solution", [solution or {}]), ("wrong", wrong)):
        for one in tried:
            _try(trial, one, f"{where}{key}")
    question = _text(table, "question", where, LONGEST["question"], needed=False, marked=True)
    choices, answer, tolerance = _answer(table, where)
    if question and answer is None and "check" not in table:
        raise LessonError(f"{where}question: has neither answer nor check; accepted is one of them, or both")
    if answer is not None and not question:
        raise LessonError(f"{where}answer: there is no question; accepted are both or none")
    if (solution is not None or wrong) and "check" not in table:
        raise LessonError(f"{where}solution, wrong: there is no check that they could be tried with")
    return Step(
        title=_text(table, "title", where, LONGEST["title"]),
        text=_text(table, "text", where, LONGEST["text"], marked=True),
        settings=settings,
        page=_page(table, where),
        time=_number(table, "time", where, least=0.0),
        question=question,
        choices=choices,
        answer=answer,
        tolerance=tolerance,
        check=_check(table, trial, where),
        hint=_text(table, "hint", where, LONGEST["hint"], needed=False, marked=True),
        because=_text(table, "because", where, LONGEST["because"], needed=False, marked=True),
        solution=solution,
        wrong=tuple(wrong),
    )


def _check_keys(table: Mapping[str, Any], accepted: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in accepted:
            close = difflib.get_close_matches(key, accepted, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise LessonError(f"{where}{key[:40]}: is not known.{hint} Accepted are {', '.join(accepted)}")


def _text(
    table: Mapping[str, Any],
    key: str,
    where: str,
    longest: int,
    *,
    needed: bool = True,
    marked: bool = False,
) -> str:
    value = table.get(key, "")
    if not isinstance(value, str) or (needed and not value.strip()):
        missing = "is missing" if key not in table else "is not a text, or is empty"
        raise LessonError(f"{where}{key}: {missing}; accepted is a text of up to {longest} characters")
    if len(value) > longest:
        raise LessonError(f"{where}{key}: has {len(value)} characters; accepted are up to {longest}")
    if marked:
        try:
            text_html(value)
        except TextError as error:
            raise LessonError(f"{where}{key}: {error}") from error
    return value.strip()


def _settings(table: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any] | None:
    value = table.get(key)
    if value is not None and not isinstance(value, dict):
        raise LessonError(f"{where}{key}: is not a table; accepted are settings, as in a settings file")
    return value


def _try(trial: Experiment, settings: Mapping[str, Any], where: str) -> None:
    """Refuse settings that an experiment does not accept; the trial keeps them, since copies take long."""
    try:
        for name in sorted(settings, key=lambda name: name != "trajectory"):  # variances depend on its rate
            trial.set(name, settings[name])
    except SettingError as error:
        raise LessonError(f"{where}: {error}") from error
    if trial.mission not in missions():
        accepted = ", ".join(missions())
        raise LessonError(
            f"{where}: there is no mission {trial.mission[:60]!r}; accepted is one of {accepted}"
        )


def _page(table: Mapping[str, Any], where: str) -> str:
    page = _text(table, "page", where, LONGEST["title"], needed=False)
    if page and page not in PAGES:
        raise LessonError(f"{where}page = {page!r}: accepted is one of {', '.join(PAGES)}")
    return page


def _number(table: Mapping[str, Any], key: str, where: str, least: float = -math.inf) -> float | None:
    value = table.get(key)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or value < least:
        bound = f" from {least:g}" if math.isfinite(least) else ""
        raise LessonError(f"{where}{key} = {str(value)[:40]}: accepted is a number{bound}")
    return float(value)


def _answer(table: Mapping[str, Any], where: str) -> tuple[tuple[str, ...], str | float | None, float]:
    """Return the choices, the right answer and its tolerance."""
    choices = table.get("choices", [])
    is_list = isinstance(choices, list) and all(isinstance(one, str) and one for one in choices)
    if not is_list or len(choices) == 1 or len(choices) > MOST_CHOICES or len(set(choices)) < len(choices):
        raise LessonError(f"{where}choices: accepted are 2 to {MOST_CHOICES} different texts")
    if any(len(one) > LONGEST_CHOICE for one in choices):
        raise LessonError(f"{where}choices: accepted are texts of up to {LONGEST_CHOICE} characters")
    if choices:
        if table.get("answer") not in choices:
            raise LessonError(
                f"{where}answer: is none of the choices; accepted is one of {', '.join(choices)}"
            )
        if "tolerance" in table:
            raise LessonError(f"{where}tolerance: belongs to a number; accepted are choices without it")
        return tuple(choices), str(table["answer"]), 0.0
    answer = _number(table, "answer", where)
    tolerance = _number(table, "tolerance", where, least=0.0)
    if (answer is None) != (tolerance is None):
        raise LessonError(f"{where}answer, tolerance: a number needs both; accepted are numbers")
    return (), answer, tolerance or 0.0


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
