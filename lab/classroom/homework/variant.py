"""Variant: the seed and hidden values of one student, which follow from the name and the teacher's secret.

Each number is an HMAC-SHA256 of the name, keyed by the secret, so that the grader computes the variant of a
name again, and nobody else can. A table ``hidden.each`` says what differs from student to student. The tables
of a variant are those of a homework without it: nothing else knows of variants.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from lab.classroom.gallery.faults import FAULTS
from lab.classroom.homework.scenario import SEEDS
from lab.classroom.homework.sealing import TeacherKey
from lab.classroom.lessons.fields import LARGEST_NUMBER, LessonError, check_keys

TAG = 16
"""Length of the tag of a variant [hexadecimal digits]: 64 bits, as the name of a homework."""
MOST_CHOICES = 50
"""Most values to choose from; more make no difference in a class."""
MOST_EACH = 20
"""Most settings that differ from student to student."""
_DIGITS = 6
"""Significant digits of a hidden value: an answer with four is then as exact as its tolerance."""
_STEPS = 1e-9
"""Part of a step by which a number of steps may miss a whole number: rounding of decimal fractions."""
_OF_RANGE, _OF_CHOICES, _OF_ANSWER = ("from", "to", "step"), ("choices",), ("of", "axis", "times")

Pick = Callable[[str], float]
"""Returns a number from 0 to 1, 1 excluded, for the name of what is chosen."""


class Varying(NamedTuple):
    """What differs from student to student.

    Attributes
    ----------
    paths : tuple of str
        Paths of hidden settings; ``faults`` for the hidden faults.
    answers : frozenset of int
        Numbers of the questions whose answers differ, from 1.
    seed : bool
        Whether the seed differs.
    """

    paths: tuple[str, ...] = ()
    answers: frozenset[int] = frozenset()
    seed: bool = False


def fold_name(name: str) -> str:
    """Return a name as names are compared: without case, and with single spaces."""
    return " ".join(unicodedata.normalize("NFC", name).split()).casefold()


def has_variants(tables: Mapping[str, Any]) -> bool:
    """Return whether a homework differs from student to student."""
    hidden = tables.get("hidden")
    return isinstance(hidden, Mapping) and "each" in hidden


def varying_in(tables: Mapping[str, Any]) -> Varying:
    """Return what differs from student to student in the tables of a homework that is accepted."""
    if not has_variants(tables):
        return Varying()
    asked = enumerate(tables.get("question", []), 1)
    answers = frozenset(number for number, one in asked if isinstance(one.get("answer"), dict))
    return Varying(tuple(_varying_by_path(tables)), answers, "seed" not in tables["hidden"])


def variant_tag(key: TeacherKey, name: str) -> str:
    """Return the tag of a student's variant: `TAG` hexadecimal digits."""
    return key.digest_of("tag", fold_name(name)).hex()[:TAG]


def tables_of(tables: Mapping[str, Any], key: TeacherKey, name: str) -> dict[str, Any]:
    """Return the tables of a homework with the hidden values of one student.

    Parameters
    ----------
    tables
        The tables, with ``hidden.each``.
    key
        The teacher's key.
    name
        The student's name.

    Raises
    ------
    LessonError
        If ``hidden.each``, or an answer that refers to it, is not accepted.
    """

    def pick(what: str) -> float:
        return int.from_bytes(key.digest_of(what, fold_name(name))[:6], "big") / 2**48

    made = _pick_values(tables, pick)
    hidden = made["hidden"]
    hidden.setdefault("seed", int(pick("seed") * SEEDS))
    return made


def extremes(tables: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield tables with the first, the last and each further value of everything that differs.

    Raises
    ------
    LessonError
        As of `tables_of`.
    """
    each = _varying_by_path(tables)
    most = max((len(one["choices"]) for one in each.values() if "choices" in one), default=2)
    for number in range(most):
        part = number / max(most - 1, 1)
        yield _pick_values(tables, lambda _what, part=part: min(part, math.nextafter(1.0, 0.0)))  # type: ignore[misc]


def _pick_values(tables: Mapping[str, Any], pick: Pick) -> dict[str, Any]:
    """Return tables in which everything that differs has the value that was picked."""
    each, hidden = _varying_by_path(tables), dict(tables["hidden"])
    del hidden["each"]
    values = {path: _value(one, path, pick(path)) for path, one in each.items()}
    if "faults" in values:
        if "faults" in hidden:
            raise LessonError("hidden: faults is fixed and in hidden.each; accepted is one of both")
        hidden["faults"] = values.pop("faults")
    settings = _copy_table(hidden.get("settings", {}))
    for path, value in values.items():
        _refuse_twice(path, settings, hidden.get("faults", []))
        _put_value(settings, path, value)
    hidden["settings"] = settings
    questions = tables.get("question", [])
    if isinstance(questions, list):
        questions = [_answered(one, values, f"question {k}: ") for k, one in enumerate(questions, 1)]
    return {**tables, "hidden": hidden, **({"question": questions} if questions else {})}


def _varying_by_path(tables: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return what differs from student to student by its path."""
    each = tables["hidden"]["each"]
    if not isinstance(each, dict):
        raise LessonError("hidden: each: is not a table; accepted are settings with from and to, or choices")
    found = dict(_flatten_table(each))
    if len(found) > MOST_EACH:
        raise LessonError(f"hidden: each: has {len(found)} entries; accepted are up to {MOST_EACH}")
    for path, one in found.items():
        _check(one, f"hidden: each: {path[:60]}: ")
    return found


def _flatten_table(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    for name, value in table.items():
        path = f"{prefix}{name}"
        if not isinstance(value, dict):
            raise LessonError(
                f"hidden: each: {path[:60]}: accepted is {{ from = 0.1, to = 0.2 }}, with a step if you "
                "like, or { choices = [0.1, 0.2] }"
            )
        if {"from", "to", "choices"} & set(value):
            yield path, value
        else:
            yield from _flatten_table(value, f"{path}.")


def _check(one: Mapping[str, Any], where: str) -> None:
    """Raise `LessonError` if this is neither a range nor a list of choices."""
    if "choices" in one:
        check_keys(one, _OF_CHOICES, where)
        choices = one["choices"]
        if not isinstance(choices, list) or not 2 <= len(choices) <= MOST_CHOICES:
            raise LessonError(f"{where}choices: accepted are 2 to {MOST_CHOICES} values")
        return
    check_keys(one, _OF_RANGE, where)
    ends = [one.get(name) for name in ("from", "to")]
    sizes = {len(end) if isinstance(end, list) else 0 for end in ends}
    if len(sizes) != 1 or not all(_is_number(part) for end in ends for part in _parts(end)):
        raise LessonError(f"{where}from, to: accepted are two numbers, or two lists of as many numbers")
    if any(low > high for low, high in zip(*map(_parts, ends), strict=True)):
        raise LessonError(f"{where}from, to: accepted is a to that is at least from")
    step = one.get("step")
    if step is not None and not (_is_number(step) and step > 0):
        raise LessonError(f"{where}step: accepted is a number above 0")


def _value(one: Mapping[str, Any], path: str, part: float) -> Any:
    """Return the value at a part, from 0 to 1, of a range or of a list of choices."""
    if "choices" in one:
        choices: list[Any] = one["choices"]
        return choices[int(part * len(choices))]
    is_list = isinstance(one["from"], list)
    step = one.get("step")
    values = [
        _interpolate_step(low, high, step, part)
        for low, high in zip(_parts(one["from"]), _parts(one["to"]), strict=True)
    ]
    return values if is_list else values[0]


def _interpolate_step(low: float, high: float, step: float | None, part: float) -> float:
    if step is None:
        return float(f"{low + part * (high - low):.{_DIGITS}g}")
    steps = math.floor((high - low) / step + _STEPS)
    return float(f"{low + step * int(part * (steps + 1)):.{_DIGITS}g}")


def _answered(question: Any, values: Mapping[str, Any], where: str) -> Any:
    """Return a question whose answer, if it refers to a hidden value, is this value."""
    if not isinstance(question, dict) or not isinstance(question.get("answer"), dict):
        return question
    asked: Mapping[str, Any] = question["answer"]
    check_keys(asked, _OF_ANSWER, f"{where}answer: ")
    path, times = asked.get("of"), asked.get("times", 1.0)
    if not isinstance(path, str) or path not in values:
        raise LessonError(
            f"{where}answer: of = {str(path)[:60]!r} is not in hidden.each; accepted is one of "
            f"{', '.join(values) or 'none: nothing differs'}"
        )
    value = values[path]
    if isinstance(value, list):
        axis = asked.get("axis")
        if not isinstance(axis, int) or isinstance(axis, bool) or not 1 <= axis <= len(value):
            raise LessonError(
                f"{where}answer: axis: {path} has {len(value)} values; accepted is the number of one"
            )
        value = value[axis - 1]
    elif "axis" in asked:
        raise LessonError(f"{where}answer: axis: {path} is one value; accepted is an answer without axis")
    if not _is_number(value) or not _is_number(times):
        raise LessonError(f"{where}answer: accepted is a hidden number, and a number as times")
    return {**question, "answer": float(f"{value * times:.{_DIGITS}g}")}


def _refuse_twice(path: str, settings: Mapping[str, Any], faults: Any) -> None:
    """Raise `LessonError` if something else decides about a setting that differs."""
    inside: Any = settings
    for name in path.split("."):
        inside = inside.get(name) if isinstance(inside, Mapping) else None
    if inside is not None:
        raise LessonError(f"hidden: {path} is in settings and in each; accepted is one of both")
    for name in faults if isinstance(faults, list) else []:
        if name in FAULTS and path.removeprefix("sensors.") in FAULTS[name].sensors:
            raise LessonError(
                f"hidden: each: {path} is set by the fault {name} too; accepted is one of both: without "
                "the fault, a question can ask for the value"
            )


def _put_value(settings: dict[str, Any], path: str, value: Any) -> None:
    *groups, last = path.split(".")
    for group in groups:
        settings = settings.setdefault(group, {})
        if not isinstance(settings, dict):
            raise LessonError(f"hidden: each: {path[:60]}: {group} is not a group of settings")
    settings[last] = value


def _copy_table(table: Any) -> Any:
    return {name: _copy_table(value) for name, value in table.items()} if isinstance(table, dict) else table


def _parts(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER
