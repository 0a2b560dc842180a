"""Rooms: each file of `lab` imports only rooms before its own in CONTRIBUTING, and none is too large.

`pytest -s tests/test_rooms.py` prints the rooms with their floors, the arrows, and how many files are short.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
FILES = sorted(path.relative_to(ROOT) for path in (ROOT / "lab").rglob("*.py"))
EXISTING = set(FILES)
ROWS = re.findall(r"^\| `(lab/[\w/]+/)` \|", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.M)
ROOMS = [row for row in ROWS if row.count("/") == 2]
DATA = [row for row in ROWS if row.count("/") == 3]
"""The rooms, and the folders of `lab/data`, each in the order of the imports."""
TOP = Path("lab/__init__.py")
LARGEST = 0.2
"""Largest part of the lines of `lab` that one folder may hold: a fifth can still be surveyed."""
MOST_FLOORS, MOST_ARROWS = 12, 120
SHORT = 80
"""Lines below which a file with one caller goes home to it."""


def room(file: Path) -> str:
    """Return the room of a file of `lab`, as CONTRIBUTING writes it."""
    return f"lab/{file.parts[1]}/" if len(file.parts) > 2 else file.as_posix()


def folder(file: Path) -> str:
    """Return the room, or the folder in a room, in which a file stands."""
    return "/".join((*file.parts[: min(len(file.parts) - 1, 3)], ""))


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


@cache
def arrows() -> set[tuple[str, str]]:
    """Return which room imports which other room."""
    found = {(room(file), room(other)) for file in FILES if file != TOP for other in imported(file) - {TOP}}
    return {(one, other) for one, other in found if one != other}


def upward(files: list[Path], order: list[str], place: Callable[[Path], str]) -> list[str]:
    """Return the imports of files that lead to a later place of an order."""
    return [
        f"{file} imports {other}"
        for file in files
        for other in sorted(imported(file) - {TOP})
        if place(other) in order and order.index(place(other)) > order.index(place(file))
    ]


def test_there_are_fourteen_rooms_and_nothing_stands_loose() -> None:
    loose = [str(file) for file in FILES if len(file.parts) == 2 and file != TOP]
    assert loose == []
    assert sorted(ROOMS) == sorted({room(file) for file in FILES if file != TOP})
    assert len(ROOMS) == 14


def test_imports_go_one_way() -> None:
    assert not upward([file for file in FILES if file != TOP], ROOMS, room)


def test_data_are_read_in_one_order() -> None:
    assert not upward([file for file in FILES if folder(file) in DATA], DATA, folder)


def test_the_folders_of_data_are_those_of_the_table() -> None:
    assert sorted(DATA) == sorted(
        {folder(file) for file in FILES if file.parts[:2] == ("lab", "data")} - {"lab/data/"}
    )


def test_few_floors_and_arrows() -> None:
    floors: dict[str, int] = {}
    while len(floors) < len(ROOMS):
        ready = [
            one for one in ROOMS
            if one not in floors and all(other in floors for at, other in arrows() if at == one)
        ]  # fmt: skip
        assert ready, f"a circle among {sorted(set(ROOMS) - floors.keys())}"
        floors |= dict.fromkeys(ready, max(floors.values(), default=0) + 1)
    short = [file for file in FILES if file.name != "__init__.py" and _lines(file) < SHORT]
    for one in ROOMS:
        mine = [file for file in FILES if room(file) == one]
        print(f"floor {floors[one]:2}  {one:16} {len(mine):4} files {sum(map(_lines, mine)):6} lines")
    print(f"{len(arrows())} arrows; {len(short)} of {len(FILES)} files have fewer than {SHORT} lines")
    assert max(floors.values()) <= MOST_FLOORS
    assert len(arrows()) <= MOST_ARROWS


def test_no_circle_within_a_room() -> None:
    # A package is not imported by what is in it, and `lab` itself stands on top of all.
    waiting = {file: imported(file) - {file, file.with_name("__init__.py"), TOP} for file in FILES}
    while free := {file for file, needed in waiting.items() if not needed & waiting.keys()}:
        waiting = {file: needed for file, needed in waiting.items() if file not in free}
    assert sorted(map(str, waiting)) == []


def test_no_folder_holds_more_than_a_fifth() -> None:
    lines = Counter[str]()
    for file in FILES:
        lines[folder(file)] += _lines(file)
    largest, count = lines.most_common(1)[0]
    assert count <= LARGEST * lines.total(), f"{largest} has {count} of {lines.total()} lines"


def _lines(file: Path) -> int:
    return len((ROOT / file).read_text("utf-8").splitlines())


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
