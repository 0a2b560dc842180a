"""Private parts: attributes of libraries that begin with an underscore are used in two rooms only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted(path for folder in ("lab", "dashboards") for path in (ROOT / folder).rglob("*.py"))
ROOMS = ("dashboards/upstream", "lab/base/compiling")
"""Where private parts may stand: those of Bokeh, Panel and viser; those of Numba."""
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_field_defaults", "_getvalue", "_exit"}
"""Documented names with an underscore: of named tuples, of what Numba's intrinsics return, and of `os`."""


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in PUBLIC


def defined(tree: ast.AST) -> Iterator[str]:
    """Yield each name that a module or a class defines: functions, variables, attributes of its objects."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()):
                yield name
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store()):
                yield name


def inherited(name: str, classes: dict[str, list[ast.ClassDef]]) -> set[str]:
    """Return what the classes of a name and their bases define."""
    found = set()
    for each in classes.get(name, []):
        found |= set(defined(each))
        bases = {ast.unparse(base).split("[")[0].rpartition(".")[2] for base in each.bases} - {name}
        found |= set().union(*(inherited(base, classes) for base in bases))
    return found


def foreign(files: dict[str, str]) -> list[str]:
    """Return each use of a private attribute that no module defines; of `self`, none of its classes."""
    trees = {file: ast.parse(text) for file, text in files.items()}
    own = {name for tree in trees.values() for name in defined(tree)}
    classes: dict[str, list[ast.ClassDef]] = {}
    for tree in trees.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name, []).append(node)
    of_itself: dict[ast.AST, set[str]] = {}
    for name, several in classes.items():
        known = inherited(name, classes)
        for node in (part for one in several for part in ast.walk(one)):
            match node:
                case ast.Attribute(value=ast.Name(id="self" | "cls")):
                    of_itself[node] = known
    return [
        f"{file}: {ast.unparse(node)}"
        for file, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and is_private(node.attr)
        and node.attr not in of_itself.get(node, own)
    ]


@pytest.mark.proof
def test_private_parts_of_libraries_stand_in_their_rooms() -> None:
    files = {file.relative_to(ROOT).as_posix(): file.read_text("utf-8") for file in FILES}
    found = foreign(files)
    assert [use for use in found if not use.startswith(ROOMS)] == []
    assert any(use.startswith(ROOMS[0]) for use in found)
    assert any(use.startswith(ROOMS[1]) for use in found)


def test_a_private_part_is_found() -> None:
    assert foreign({"own.py": "class A:\n def __init__(self):\n  self._b = 1\n  self._b += self._b"}) == []
    assert foreign({"other.py": "def size(model): return model._size"}) == ["other.py: model._size"]
    files = {"a.py": "_size = 1", "b.py": "class B(A):\n def size(self): return self._size"}
    assert foreign(files) == ["b.py: self._size"]
    assert foreign(files | {"c.py": "class A:\n _size = 1"}) == []
