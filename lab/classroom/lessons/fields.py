"""Fields: the keys of a teacher's TOML file: texts, numbers, settings and answers, each checked."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from typing import Any

from lab.base.parameters.setting_error import SettingError
from lab.classroom.lessons.text import TextError, settings_named, text_html
from lab.experiment.experiment import Experiment
from lab.missions import missions, names_in_words

MOST_CHOICES = 12
"""Most answers to choose from; the gallery has 10."""
LONGEST_CHOICE = 100
"""Longest answer to choose [characters]."""
LARGEST_NUMBER = 1e300
"""Largest size of a number; TOML has integers that no float can hold."""
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""What a terminal would obey, or what would turn the direction of a line."""


class LessonError(ValueError):
    """A lesson that is not accepted; the message says where, why, and what is accepted."""


def check_keys(table: Mapping[str, Any], accepted: tuple[str, ...], where: str) -> None:
    """Raise `LessonError` if a table has a key that is not accepted; `where` precedes the message."""
    for key in table:
        if key not in accepted:
            close = difflib.get_close_matches(key, accepted, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise LessonError(f"{where}{key[:40]}: is not known.{hint} Accepted are {', '.join(accepted)}")


def text_of(
    table: Mapping[str, Any],
    key: str,
    where: str,
    longest: int,
    *,
    needed: bool = True,
    marked: bool = False,
) -> str:
    """Return a text without the spaces at its ends; empty if it is missing and not needed.

    Parameters
    ----------
    table, key
        The table, and the key of the text.
    where
        Place of the table, which precedes a message.
    longest
        Largest number of characters.
    needed
        Whether it is refused if it is missing or empty.
    marked
        Whether it may have formulas and marks, as in `lab.classroom.lessons.text`. A marked setting must
        exist.

    Raises
    ------
    LessonError
        If it is not accepted.
    """
    value = table.get(key, "")
    if not isinstance(value, str) or (needed and not value.strip()):
        missing = "is missing" if key not in table else "is not a text, or is empty"
        raise LessonError(f"{where}{key}: {missing}; accepted is a text of up to {longest} characters")
    if len(value) > longest:
        raise LessonError(f"{where}{key}: has {len(value)} characters; accepted are up to {longest}")
    if found := _CONTROL.search(value):
        raise LessonError(
            f"{where}{key}: has the control character {found[0]!r}; accepted are printable ones"
        )
    if marked:
        try:
            text_html(value)
            for path in settings_named(value):
                Experiment().get(path)
        except (TextError, SettingError) as error:
            raise LessonError(f"{where}{key}: {error}") from error
    return value.strip()


def read_settings(table: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any] | None:
    """Return a table of settings; None if it is missing. `LessonError` if it is not a table."""
    value = table.get(key)
    if value is not None and not isinstance(value, dict):
        raise LessonError(f"{where}{key}: is not a table; accepted are settings, as in a settings file")
    return value


def try_settings(trial: Experiment, settings: Mapping[str, Any], where: str) -> None:
    """Raise `LessonError` for settings that an experiment refuses; the trial keeps them: copies take long."""
    try:
        for name in sorted(settings, key=lambda name: name != "trajectory"):  # variances depend on its rate
            trial.set(name, settings[name])
    except SettingError as error:
        raise LessonError(f"{where}: {error}") from error
    found = missions()
    if trial.mission not in found:
        accepted = names_in_words(found)
        raise LessonError(
            f"{where}: mission: there is no mission {trial.mission[:60]!r}; accepted is one of {accepted}"
        )


def read_number(table: Mapping[str, Any], key: str, where: str, least: float = -math.inf) -> float | None:
    """Return a finite number; None if it is missing. `LessonError` if it is none, or less than `least`."""
    value = table.get(key)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not -LARGEST_NUMBER < value < LARGEST_NUMBER or value < least:
        bound = f" from {least:g}" if math.isfinite(least) else ""
        raise LessonError(f"{where}{key} = {str(value)[:40]}: accepted is a number{bound}")
    return float(value)


def read_answer(table: Mapping[str, Any], where: str) -> tuple[tuple[str, ...], str | float | None, float]:
    """Return the choices, the right answer and its tolerance.

    Raises
    ------
    LessonError
        If they do not fit together.
    """
    choices = table.get("choices", [])
    is_list = isinstance(choices, list) and all(isinstance(one, str) and one.strip() for one in choices)
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
    answer = read_number(table, "answer", where)
    tolerance = read_number(table, "tolerance", where, least=0.0)
    if (answer is None) != (tolerance is None):
        raise LessonError(f"{where}answer, tolerance: a number needs both; accepted are numbers")
    return (), answer, tolerance or 0.0
