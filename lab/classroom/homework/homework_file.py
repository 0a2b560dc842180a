"""Homework file: what the students get, signed; and the key file, which stays with the teacher.

The first line of a homework file is the signature of all the others. What the student sees is plain TOML;
what is hidden is covered. The solutions are in the key file only.
"""

from __future__ import annotations

import base64
import binascii
import os
import secrets
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lab.base.parameters.toml_file import TomlError, parse_toml, read_text, toml_text
from lab.classroom.homework import variant
from lab.classroom.homework.homework import Homework, Judge
from lab.classroom.homework.scenario import SEEDS
from lab.classroom.homework.sealing import (
    PUBLIC,
    SECRET,
    SealError,
    TeacherKey,
    check_installed,
    check_signature,
    cover,
    uncover,
)
from lab.classroom.homework.source_file import make_judge
from lab.classroom.lessons.fields import LessonError

FORMAT = "ins-lab homework 1"
KEY_FORMAT = "ins-lab homework key 1"
LARGEST = 200_000
"""Largest source, homework or key file accepted [bytes]; texts and questions have at most 40 kB."""
_SHOWN = ("title", "text", "settings", "change", "names_faults", "fault_points")
_HEAD = "# A homework of INS Lab: open it under Lessons, or with: ins-lab homework show FILE\n"
_KEY_HEAD = (
    "# The key of a homework: it contains the solutions, and grades what is handed in. Keep it secret.\n"
)


@dataclass(frozen=True, repr=False)
class Keyed:
    """A homework with its key, as a teacher has it.

    Attributes
    ----------
    key : TeacherKey
        The key.
    seed : int
        Seed of the run, if the source has none.
    source : str
        The teacher's TOML text.
    judge : Judge
        The homework with its solutions. If each student has a variant, that of nobody.
    varies : bool
        Whether each student has a variant: a seed and hidden values that follow from the name.
    """

    key: TeacherKey
    seed: int
    source: str
    judge: Judge
    varies: bool = False

    @property
    def homework(self) -> Homework:
        """The homework."""
        return self.judge.homework

    @property
    def varying(self) -> variant.Varying:
        """What differs from student to student."""
        return variant.varying_in(parse_toml(self.source))

    def judge_for(self, student: str) -> Judge:
        """Return the homework of one student with its solutions; that of all, unless each has a variant."""
        if not self.varies:
            return self.judge
        name = " ".join(unicodedata.normalize("NFC", student).split())
        tables = variant.tables_of(parse_toml(self.source), self.key, name)
        judge = make_judge(tables, self.key.public, self.seed)
        homework = replace(judge.homework, student=name, variant=variant.variant_tag(self.key, name))
        return replace(judge, homework=homework)


def make_homework(source: Path) -> Keyed:
    """Return a new homework from a teacher's TOML file, with a new key and a random seed.

    Raises
    ------
    LessonError
        If the file cannot be read, or describes no homework.
    SealError
        If cryptography is not installed.
    """
    check_installed()
    text, key = _read_bounded(source), TeacherKey.new()
    made = _make_keyed(key, secrets.randbelow(SEEDS), text, source.name)
    if made.varies:
        try:
            for tables in variant.extremes(parse_toml(text)):
                make_judge(tables, key.public, made.seed)
        except LessonError as error:
            raise LessonError(f"{source.name}: {error}") from error
    return made


def _make_keyed(key: TeacherKey, seed: int, source: str, name: str) -> Keyed:
    try:
        tables = parse_toml(source)
        varies = variant.has_variants(tables)
        if varies:
            tables = variant.tables_of(tables, key, "")
        return Keyed(key, seed, source, make_judge(tables, key.public, seed), varies)
    except (TomlError, LessonError) as error:
        raise LessonError(f"{name}: {error}") from error


def homework_text(made: Keyed, student: str = "") -> str:
    """Return the content of the file for the students, or of that for one student if each has a variant."""
    homework = made.judge_for(student).homework if student else made.homework
    scenario, hidden = homework.scenario, homework.scenario.hidden
    secret = toml_text(
        {"faults": list(hidden.faults), "seed": hidden.seed, "settings": dict(hidden.settings)}
    )
    tables = {
        "format": FORMAT,
        "keys": _text_of(homework.public),
        "title": scenario.title,
        "text": homework.text,
        "change": list(scenario.change),
        "names_faults": homework.names_faults,
        "fault_points": homework.fault_points,
        "covered": _text_of(cover(homework.public, secret.encode())),
        "question": [
            {
                "text": one.text,
                "points": one.points,
                **({"choices": list(one.choices)} if one.choices else {}),
            }
            for one in homework.questions
        ],
        "goal": [{"text": one.text, "points": one.points} for one in homework.goals],
        **({"student": homework.student, "variant": homework.variant} if homework.variant else {}),
        "settings": dict(scenario.settings),
    }
    body = _HEAD + toml_text(tables)
    return f'signature = "{_text_of(made.key.sign(body.encode()))}"\n{body}'


def read_homework(path: Path) -> Homework:
    """Return the homework in a file for students.

    Raises
    ------
    LessonError
        If the file cannot be read, is no homework, or has been changed.
    SealError
        If cryptography is not installed.
    """
    check_installed()
    try:
        return _open_homework(_read_bounded(path))
    except (TomlError, SealError, LessonError, UnicodeDecodeError) as error:
        message = str(error).removeprefix(f"{_file_name(path)}: ")
        raise LessonError(f"{_file_name(path)}: {message}") from error


def _open_homework(text: str) -> Homework:
    first, _, body = text.partition("\n")
    tables = parse_toml(text)
    if tables.get("format") != FORMAT or not first.startswith("signature"):
        raise LessonError(
            "is not a homework; accepted is a file that `ins-lab homework make` has written"
            if tables.get("format") != KEY_FORMAT
            else "is the key of a homework, which belongs to the teacher; accepted is the homework"
        )
    public = _bytes_of(tables, "keys", PUBLIC)
    check_signature(public, _bytes_of(tables, "signature"), body.encode())
    # A signed file is one that the lab has written, but a stranger's lab may be another one.
    hidden = parse_toml(uncover(public, _bytes_of(tables, "covered")).decode())
    source: dict[str, Any] = {
        **{key: tables[key] for key in _SHOWN if key in tables},
        "hidden": hidden,
        # The checks of a source need solutions, which are in the key only; these are not used.
        "question": [_solve_question(one) for one in _list_questions(tables, "question")],
        "goal": [{**one, "condition": "nees < 1"} for one in _list_questions(tables, "goal")],
    }
    student, tag = (tables.get(name, "") for name in ("student", "variant"))
    if not isinstance(student, str) or not isinstance(tag, str) or not student.isprintable():
        raise LessonError("student, variant: are damaged; accepted is the original file")
    return replace(make_judge(source, public, 0).homework, student=student, variant=tag)


def _list_questions(tables: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    found = tables.get(key, [])
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def _solve_question(question: Mapping[str, Any]) -> Mapping[str, Any]:
    choices = question.get("choices")
    if isinstance(choices, list) and choices:
        return {**question, "answer": choices[0]}
    return {**question, "answer": 0.0, "tolerance": 0.0}


def key_text(made: Keyed) -> str:
    """Return the content of the key file."""
    tables = {"format": KEY_FORMAT, "secret": made.key.secret.hex(), "seed": made.seed, "source": made.source}
    return _KEY_HEAD + toml_text(tables)


def write_key(path: Path, made: Keyed) -> None:
    """Write the key file, readable by its owner only; an existing file is never replaced.

    Raises
    ------
    FileExistsError
        If there is a file of this name.
    OSError
        If it cannot be written; then there is no file.
    """
    content = key_text(made).encode()
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
    except BaseException as error:
        path.unlink(missing_ok=True)  # a part of a key opens nothing, and would keep the name
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # the system does not name the file when the disk is full
        raise


def read_key(path: Path) -> Keyed:
    """Return the homework of a key file, with its solutions.

    Raises
    ------
    LessonError
        If the file cannot be read, or is no key.
    SealError
        If cryptography is not installed.
    """
    try:
        return parse_key(_read_bounded(path))
    except (TomlError, LessonError) as error:
        message = str(error).removeprefix(f"{_file_name(path)}: ")
        raise LessonError(f"{_file_name(path)}: {message}") from error


def parse_key(text: str) -> Keyed:
    """Return the homework of the content of a key file; see `read_key`.

    Raises
    ------
    TomlError, LessonError
        If it is no key.
    SealError
        If cryptography is not installed.
    """
    check_installed()
    tables = parse_toml(text)
    if tables.get("format") != KEY_FORMAT:
        raise LessonError("is not the key of a homework; accepted is that of `ins-lab homework make`")
    secret, seed, source = (tables.get(name) for name in ("secret", "seed", "source"))
    if not (isinstance(secret, str) and isinstance(seed, int) and isinstance(source, str)):
        raise LessonError("is a damaged key; accepted is one with secret, seed and source")
    return _make_keyed(TeacherKey(_secret(secret)), seed, source, "source")


def _secret(text: str) -> bytes:
    try:
        secret = bytes.fromhex(text)
    except ValueError as error:
        raise LessonError("is a damaged key: its secret is not hexadecimal") from error
    if len(secret) != SECRET:
        raise LessonError(f"is a damaged key: its secret has {len(secret)} bytes instead of {SECRET}")
    return secret


def _read_bounded(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise LessonError(f"{_file_name(path)}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # such as a name with a zero in it
        raise LessonError(f"{_file_name(path)}: cannot be read: {error}") from error
    if size > LARGEST:
        raise LessonError(
            f"{_file_name(path)}: has {size} bytes; accepted are files up to {LARGEST // 1000} kB"
        )
    try:
        return read_text(path)
    except TomlError as error:
        raise LessonError(f"{_file_name(path)}: {error}") from error


def _file_name(path: Path) -> str:
    return path.name or str(path)  # a point has no name


def _text_of(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _bytes_of(tables: Mapping[str, Any], key: str, length: int | None = None) -> bytes:
    try:
        found = base64.b64decode(tables.get(key, ""), validate=True)
    except (binascii.Error, TypeError, ValueError) as error:
        raise LessonError(f"{key}: is damaged; accepted is the original file") from error
    if length is not None and len(found) != length:
        raise LessonError(f"{key}: is damaged; accepted is the original file")
    return found
