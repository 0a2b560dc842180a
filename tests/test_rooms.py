"""Rooms: each file of `lab` imports only what stands before it in CONTRIBUTING, and no room is too large."""

from __future__ import annotations

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted(path.relative_to(ROOT) for path in (ROOT / "lab").rglob("*.py"))
EXISTING = set(FILES)
PLACES = [
    place
    for row in re.findall(r"^\|(.*?)\|", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.M)
    for place in re.findall(r"`(lab/\w+(?:/|\.py))`", row)
]
TOP = Path("lab/__init__.py")
LARGEST = 0.2
"""Largest part of the lines of `lab` that one room may hold: a fifth can still be surveyed."""


def room(file: Path) -> str:
    """Return a room of `lab`, or a file that stands by itself, as CONTRIBUTING writes it."""
    return f"lab/{file.parts[1]}/" if len(file.parts) > 2 else str(file.as_posix())


@cache
def imported(file: Path) -> set[Path]:
    """Return the files that a file imports anywhere: at its top, in functions, and for type hints."""
    names = set()
    for node in ast.walk(ast.parse((ROOT / file).read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    assert not any(name.split(".")[0] == "dashboards" for name in names), f"{file} imports dashboards"
    places = [Path(*name.split(".")) for name in names]
    wanted = {place.with_suffix(".py") for place in places} | {place / "__init__.py" for place in places}
    return wanted & EXISTING


@pytest.mark.parametrize("file", [file for file in FILES if len(file.parts) > 1 and file != TOP], ids=str)
def test_imports_go_one_way(file: Path) -> None:
    others = {room(other) for other in imported(file)} - {room(file), str(TOP.as_posix())}
    assert not [other for other in others if PLACES.index(other) > PLACES.index(room(file))]


def test_no_circle_within_a_room() -> None:
    # A package is not imported by what is in it, and `lab` itself stands on top of all.
    waiting = {file: imported(file) - {file, file.with_name("__init__.py"), TOP} for file in FILES}
    while free := {file for file, needed in waiting.items() if not needed & waiting.keys()}:
        waiting = {file: needed for file, needed in waiting.items() if file not in free}
    assert sorted(map(str, waiting)) == []


def test_no_room_holds_more_than_a_fifth() -> None:
    lines = Counter[str]()
    for file in FILES:
        lines[room(file)] += len((ROOT / file).read_text("utf-8").splitlines())
    largest, count = lines.most_common(1)[0]
    assert count <= LARGEST * lines.total(), f"{largest} has {count} of {lines.total()} lines"


def test_each_of_these_nouns_names_one_thing() -> None:
    nouns = ("Filter", "Finding", "Flight", "Motion", "Progress", "Recording")
    named = Counter(
        noun
        for folder in ("lab", "dashboards")
        for path in (ROOT / folder).rglob("*.py")
        for noun in re.findall(r"^(?:class )?(\w+)\b(?=[(:]| = Callable)", path.read_text("utf-8"), re.M)
        if noun in nouns
    )
    assert named == dict.fromkeys(nouns, 1)
