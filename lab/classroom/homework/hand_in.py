"""Hand-in: what one student hands in: a name, settings, and answers, in a file sealed for the teacher.

A hand-in claims no results: the grader computes them from its settings.
"""

from __future__ import annotations

import base64
import binascii
import math
import os
import re
import stat
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lab.base.files.atomic_file import write_file
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import TomlError, parse_toml, toml_text
from lab.classroom.homework.homework import LONGEST_ANSWER, Homework, fault_titles
from lab.classroom.homework.sealing import SealError, TeacherKey, seal_for_teacher
from lab.classroom.homework.variant import fold_name
from lab.classroom.lessons.lesson import number_typed
from lab.experiment.experiment import Experiment

FORMAT = "ins-lab hand-in 1"
_ANY_FORMAT = r"ins-lab hand-in \d{1,6}"
"""What other versions of the lab call theirs."""
SUFFIX = ".handin"
"""Ending of the names of hand-ins."""
DEEPEST = 3
"""Deepest folder within the folder: learning platforms make one for each student."""
LARGEST = 64_000
"""Largest hand-in accepted [bytes]; one in which every setting is changed has 10 kB."""
LONGEST_NAME = 80
"""Longest name of a student [characters]."""
MOST_CHANGES = 300
"""Most settings in a hand-in; there are fewer than 200."""
_HEAD = "# A hand-in of INS Lab. It is sealed: only the teacher of the homework can open it.\n"


class HandInError(ValueError):
    """A hand-in that is not accepted; the message says why, and what is accepted."""


@dataclass(frozen=True)
class HandIn:
    """What a student hands in.

    Attributes
    ----------
    name : str
        The student's name, as he typed it.
    changes : mapping
        The settings that he changed, by their path.
    faults : tuple of str
        The faults that he named, by their title.
    answers : tuple of str
        His answers to the questions, as chosen or typed; empty texts for those without.
    variant : str
        Tag of the variant that he worked on; empty if all students have the same homework.
    """

    name: str
    changes: Mapping[str, Any]
    faults: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    variant: str = ""


def hand_in(
    homework: Homework,
    name: str,
    experiment: Experiment,
    faults: tuple[str, ...] = (),
    answers: tuple[str, ...] = (),
) -> HandIn:
    """Return a hand-in.

    Parameters
    ----------
    homework
        The homework.
    name
        The student's name.
    experiment
        The experiment with his settings.
    faults
        Titles of the faults that he names.
    answers
        His answers, in the order of the questions; missing ones count as empty.

    Raises
    ------
    HandInError
        If the name or an answer is not accepted.
    SettingError
        If a setting was changed that the homework does not let a student change.
    """
    if homework.student and fold_name(name) != fold_name(homework.student):
        raise HandInError(
            f"has the name {name[:40]!r}, and this file is the homework of {homework.student}; accepted is "
            "this name, because the hidden values are those of one student"
        )
    whole = (*answers, *("",) * (len(homework.questions) - len(answers)))
    for number, (question, answer) in enumerate(zip(homework.questions, whole, strict=False), 1):
        if answer and not question.choices and not math.isfinite(number_typed(answer)):
            raise HandInError(
                f"answer {number}: {answer[:40]!r} is no number; accepted is one without a unit, such as 0.5"
            )
    changes = homework.scenario.changes(experiment)
    return _checked(homework, HandIn(name, changes, tuple(faults), whole, homework.variant))


def hand_in_text(homework: Homework, handed: HandIn) -> str:
    """Return the content of a hand-in file, sealed for the teacher."""
    tables = {
        "name": handed.name,
        "faults": list(handed.faults),
        "answers": list(handed.answers),
        "changes": [
            {"path": path, "value": _to_plain(value)}
            for path, value in handed.changes.items()
            if value is not None
        ],
        "unset": [path for path, value in handed.changes.items() if value is None],
        **({"variant": handed.variant} if handed.variant else {}),
    }
    sealed = seal_for_teacher(homework.public, toml_text(tables).encode(), _context(homework.name))
    return _HEAD + toml_text(
        {"format": FORMAT, "homework": homework.name, "sealed": base64.b64encode(sealed).decode()}
    )


def write_hand_in(path: Path, homework: Homework, handed: HandIn, *, overwrite: bool = False) -> None:
    """Write a hand-in file.

    Raises
    ------
    FileExistsError
        If the file exists and `overwrite` is not given.
    """
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; nothing was written. overwrite=True replaces it")
    write_file(path, hand_in_text(homework, handed))


def open_hand_in(content: bytes, homework: Homework, key: TeacherKey) -> HandIn:
    """Return the hand-in in the content of a file.

    Raises
    ------
    HandInError
        If it is none, is of another homework, or has been changed.
    """
    tables = _tables(content)
    written = tables.get("format")
    if isinstance(written, str) and written != FORMAT and re.fullmatch(_ANY_FORMAT, written):
        raise HandInError(f"is of another version of the lab, {written}; accepted is {FORMAT}")
    if written != FORMAT:
        raise HandInError(
            f"is not a hand-in; accepted is a file *{SUFFIX} from the page or `ins-lab homework`"
        )
    name, sealed = tables.get("homework"), tables.get("sealed")
    if name != homework.name:
        shown = name if isinstance(name, str) and name.isalnum() and len(name) <= 64 else "without a name"
        raise HandInError(f"is of another homework, {shown}; accepted are those of {homework.name}")
    try:
        inside = key.open(base64.b64decode(sealed or "", validate=True), _context(homework.name))
        opened = parse_toml(inside.decode())
    except SealError as error:
        raise HandInError(str(error)) from error
    except (binascii.Error, TypeError, ValueError) as error:
        raise HandInError("is damaged; accepted is the file as the lab wrote it") from error
    return _checked(homework, _make_hand_in(opened))


def read_hand_in(path: Path) -> bytes:
    """Return the content of a file that may be a hand-in.

    Raises
    ------
    HandInError
        If it is a link, is no ordinary file, is too large, or cannot be read.
    """
    try:
        status = path.lstat()
        if stat.S_ISLNK(status.st_mode):
            raise HandInError("is a link, which is not followed; accepted are ordinary files")
        if stat.S_ISDIR(status.st_mode):
            raise HandInError(
                "is a folder that is too deep or cannot be listed, so its files are not graded; accepted are "
                f"hand-ins at most {DEEPEST} folders deep"
            )
        if not stat.S_ISREG(status.st_mode):
            raise HandInError("is not an ordinary file")
        if status.st_size > LARGEST:
            raise HandInError(f"has {status.st_size} bytes; accepted are hand-ins up to {LARGEST // 1000} kB")
        flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        descriptor = os.open(path, flags | getattr(os, "O_BINARY", 0))
        with os.fdopen(descriptor, "rb") as file:
            return file.read(LARGEST + 1)[:LARGEST]
    except OSError as error:
        raise HandInError(f"cannot be read: {error.strerror or error}") from error


def _tables(content: bytes) -> dict[str, Any]:
    try:
        return parse_toml(content.decode("utf-8-sig").replace("\r\n", "\n"))
    except (UnicodeDecodeError, TomlError) as error:
        if content.startswith(_HEAD[:20].encode()):
            raise HandInError("is damaged or cut off; accepted is the file as the lab wrote it") from error
        if isinstance(error, UnicodeDecodeError):
            raise HandInError("is not text in UTF-8; accepted is a hand-in as the lab wrote it") from error
        raise HandInError(f"is not a hand-in: {error}") from error


def _make_hand_in(tables: Mapping[str, Any]) -> HandIn:
    """Return what the tables of an opened hand-in say, with the right types."""
    name, faults, answers = (tables.get(key) for key in ("name", "faults", "answers"))
    changes, unset = tables.get("changes", []), tables.get("unset", [])
    variant = tables.get("variant", "")
    right = (
        isinstance(name, str)
        and isinstance(variant, str)
        and all(isinstance(texts, list) for texts in (faults, answers, unset))
        and all(isinstance(one, str) for texts in (faults, answers, unset) for one in texts or ())
        and isinstance(changes, list)
        and len(changes) + len(unset) <= MOST_CHANGES
        and all(
            isinstance(one, dict) and isinstance(one.get("path"), str) and "value" in one for one in changes
        )
    )
    if not right:
        raise HandInError("has other contents than the lab writes; accepted is the file as the lab wrote it")
    values = {one["path"]: one["value"] for one in changes} | dict.fromkeys(unset)
    return HandIn(str(name), values, tuple(faults or ()), tuple(answers or ()), variant)


def _checked(homework: Homework, handed: HandIn) -> HandIn:
    """Return a hand-in whose texts are accepted; the name is normalised."""
    name = " ".join(unicodedata.normalize("NFC", handed.name).split())
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        found = "a name that is not accepted" if name else "no name"
        raise HandInError(f"has {found}; accepted are 1 to {LONGEST_NAME} printable characters")
    unknown = set(handed.faults) - set(fault_titles())
    if unknown or (handed.faults and not homework.names_faults):
        shown = min(unknown)[:40] if unknown else handed.faults[0]
        accepted = (
            f"any of: {', '.join(fault_titles())}" if homework.names_faults else "a hand-in without faults"
        )
        raise HandInError(
            f"names a fault {shown!r}, which the homework does not ask for; accepted is {accepted}"
        )
    if len(handed.answers) != len(homework.questions):
        raise HandInError(
            f"has {len(handed.answers)} answers; accepted are {len(homework.questions)}, one to each question"
        )
    for number, (question, answer) in enumerate(zip(homework.questions, handed.answers, strict=True), 1):
        if len(answer) > LONGEST_ANSWER or not answer.isprintable():
            raise HandInError(f"answer {number}: accepted are up to {LONGEST_ANSWER} printable characters")
        if question.choices and answer and answer not in question.choices:
            raise HandInError(
                f"answer {number}: {answer!r} is none of the choices; accepted is one of "
                f"{', '.join(question.choices)}"
            )
    if "seed" in handed.changes:  # an experiment takes one, to show the same flight with other noise
        raise HandInError("has a seed; accepted is none, because the grader takes the seed of the homework")
    try:
        homework.experiment_with(handed.changes)
    except SettingError as error:
        raise HandInError(str(error)) from error
    return replace(handed, name=name, faults=tuple(sorted(set(handed.faults))))


def _to_plain(value: Any) -> Any:
    return [_to_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _context(name: str) -> str:
    return f"hand-in of the homework {name}"
