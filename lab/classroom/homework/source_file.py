"""Source file: a homework as its teacher writes it, in TOML. Every key is checked, as in a lesson."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from lab.classroom.gallery.faults import FAULTS
from lab.classroom.homework.homework import Goal, Homework, Judge, Question, Solution
from lab.classroom.homework.scenario import CHANGEABLE, SEEDS, Hidden, Scenario, can_be_hidden, is_never
from lab.classroom.homework.sealing import name_of_keys
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
from lab.classroom.lessons.lesson_file import numeric_in
from lab.experiment.experiment import Experiment
from lab.missions import LogMission, missions

MOST_QUESTIONS = 20
"""Most questions, and most goals."""
MOST_FAULTS = 3
"""Most faults hidden in one homework; each pair still has a signature of its own to look for."""
MOST_POINTS = 1000
"""Most points for one answer: a typing error such as 1e9 would bury all others."""
LONGEST = {"title": 80, "text": 6000, "question": 1000, "goal": 200, "condition": 300}
"""Longest texts [characters], as in lessons."""

OF_HOMEWORK = (
    *("title", "text", "settings", "change", "hidden", "names_faults", "fault_points", "question", "goal"),
)
"""Keys of a homework."""
OF_HIDDEN = ("faults", "settings", "seed")
OF_QUESTION = ("text", "choices", "answer", "tolerance", "points")
OF_GOAL = ("text", "condition", "points")


def make_judge(tables: Mapping[str, Any], public: bytes, seed: int) -> Judge:
    """Return the homework that the tables of a TOML file describe, with its solutions.

    Parameters
    ----------
    tables
        The tables.
    public
        The teacher's public keys.
    seed
        Seed of the run, unless the file has one.

    Raises
    ------
    LessonError
        If they describe none; the message says where, and what is accepted.
    """
    check_keys(tables, OF_HOMEWORK, "")
    settings, trial = read_settings(tables, "settings", "") or {}, Experiment()
    try_settings(trial, settings, "settings")
    if isinstance(missions()[trial.mission], LogMission):
        raise LessonError(
            f"settings: {trial.mission} is a sensor log, in which nothing can be hidden; accepted is a flight"
        )
    hidden = _read_hidden(tables.get("hidden", {}), trial, seed)
    title = text_of(tables, "title", "", LONGEST["title"])
    scenario = Scenario(name_of_keys(public), title, settings, _change(tables, trial), hidden, public)
    asked = [_question(one, where) for one, where in _tables(tables, "question")]
    goals = [_read_goal(one, where, trial) for one, where in _tables(tables, "goal")]
    names_faults = tables.get("names_faults", bool(hidden.faults))
    if not isinstance(names_faults, bool):
        raise LessonError("names_faults: accepted is true or false")
    if not (asked or goals or names_faults):
        raise LessonError(
            "there is nothing to solve; accepted are [[question]], [[goal]] or names_faults = true"
        )
    homework = Homework(
        scenario,
        text_of(tables, "text", "", LONGEST["text"], marked=True),
        public,
        names_faults,
        _points(tables, "fault_points", ""),
        tuple(question for question, _ in asked),
        tuple(goal for goal, _ in goals),
    )
    return Judge(homework, tuple(right for _, right in asked), tuple(check for _, check in goals))


def _read_hidden(table: Any, trial: Experiment, seed: int) -> Hidden:
    """Return what is hidden; the trial is not changed."""
    if not isinstance(table, dict):
        raise LessonError("hidden: is not a table; accepted are faults, settings, seed")
    check_keys(table, OF_HIDDEN, "hidden: ")
    faults = table.get("faults", [])
    if not isinstance(faults, list) or not all(isinstance(one, str) and one in FAULTS for one in faults):
        raise LessonError(f"hidden: faults: accepted is a list of {', '.join(FAULTS)}")
    if len(faults) > MOST_FAULTS or len(set(faults)) < len(faults):
        raise LessonError(f"hidden: faults: accepted are up to {MOST_FAULTS}, each once")
    settings = read_settings(table, "settings", "hidden: ") or {}
    for path in _paths(settings):
        if not can_be_hidden(path):
            raise LessonError(
                f"hidden: settings: {path[:60]} cannot be hidden; accepted are errors of the sensors, such "
                "as sensors.gps.latency, and of the start, such as navigator.attitude_error"
            )
    try_settings(trial.copy(), settings, "hidden: settings")
    given = table.get("seed", seed)
    if not isinstance(given, int) or isinstance(given, bool) or not 0 <= given < SEEDS:
        raise LessonError(f"hidden: seed: accepted is a whole number from 0 to {SEEDS - 1}")
    return Hidden(tuple(faults), settings, given)


def _paths(settings: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in settings.items():
        if isinstance(value, dict):
            yield from _paths(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def _change(tables: Mapping[str, Any], trial: Experiment) -> tuple[str, ...]:
    """Return the settings and groups that the student may change."""
    change = tables.get("change", ["navigator"])
    if not isinstance(change, list) or not all(isinstance(one, str) for one in change):
        raise LessonError("change: accepted is a list of settings and groups, such as navigator.r_scale")
    leaves = [path for path, _, _ in trial.leaves()]
    for place in change:
        inside = [path for path in leaves if path == place or path.startswith(f"{place}.")]
        if not inside or place.partition(".")[0] not in CHANGEABLE:
            raise LessonError(
                f"change: there is no such setting or group {place[:60]!r}; accepted are those of "
                f"{' and '.join(CHANGEABLE)}"
            )
        if all(is_never(path) for path in inside):
            raise LessonError(
                f"change: {place} cannot be given to a student: it decides how long a run takes, or what is "
                "measured; accepted are all other settings of navigator and sensors"
            )
    return tuple(change)


def _tables(tables: Mapping[str, Any], key: str) -> list[tuple[Mapping[str, Any], str]]:
    """Return the tables of a list, each with its place for messages."""
    found = tables.get(key, [])
    if (
        not isinstance(found, list)
        or not all(isinstance(one, dict) for one in found)
        or len(found) > MOST_QUESTIONS
    ):
        raise LessonError(f"{key}: accepted are up to {MOST_QUESTIONS} tables [[{key}]]")
    return [(one, f"{key} {number}: ") for number, one in enumerate(found, 1)]


def _question(table: Mapping[str, Any], where: str) -> tuple[Question, Solution]:
    check_keys(table, OF_QUESTION, where)
    text = text_of(table, "text", where, LONGEST["question"], marked=True)
    choices, answer, tolerance = read_answer(table, where)
    if answer is None:
        raise LessonError(f"{where}answer: is missing; accepted is one of the choices, or a number")
    return Question(text, choices, _points(table, "points", where)), Solution(answer, tolerance)


def _read_goal(table: Mapping[str, Any], where: str, trial: Experiment) -> tuple[Goal, Check]:
    check_keys(table, OF_GOAL, where)
    text = text_of(table, "text", where, LONGEST["goal"], needed=False, marked=True)
    condition = text_of(table, "condition", where, LONGEST["condition"])
    try:
        return Goal(text, _points(table, "points", where)), parse_check(condition, numeric_in(trial))
    except CheckError as error:
        raise LessonError(f"{where}condition: {error}") from error


def _points(table: Mapping[str, Any], key: str, where: str) -> float:
    points = read_number(table, key, where, least=0.0)
    if points is not None and (points > MOST_POINTS or not math.isfinite(points)):
        raise LessonError(f"{where}{key} = {points:g}: accepted is a number from 0 to {MOST_POINTS}")
    return 1.0 if points is None else points
