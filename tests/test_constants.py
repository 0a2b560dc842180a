"""Every number that stands alone at module level says what it means: a docstring under it, or a comment."""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

import pytest

import lab

FILES = sorted(Path(lab.__file__).parent.rglob("*.py"))
DIRECTIVES = ("fmt:", "type:", "noqa")
"""Beginnings of comments that are for tools and say nothing of a number."""


def is_numeric(value: ast.expr) -> bool:
    """Return whether there is a number in a value, which is not a truth value."""
    return any(
        isinstance(part, ast.Constant) and isinstance(part.value, int | float | complex)
        and not isinstance(part.value, bool)
        for part in ast.walk(value)
    )  # fmt: skip


def constant_names(statement: ast.stmt) -> list[str]:
    """Return the names in capitals that a statement assigns numbers to."""
    if isinstance(statement, ast.Assign):
        targets, value = statement.targets, statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        targets, value = [statement.target], statement.value
    else:
        return []
    each = [one for target in targets for one in (target.elts if isinstance(target, ast.Tuple) else [target])]
    names = [one.id for one in each if isinstance(one, ast.Name) and one.id.isupper()]
    return names if is_numeric(value) else []


def undocumented(source: str) -> list[str]:
    """Return the numeric constants of a module with neither docstring nor comment, with their lines."""
    body = ast.parse(source).body
    commented = {
        token.start[0]
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and not token.string.lstrip("# ").startswith(DIRECTIVES)
    }
    found = []
    for place, statement in enumerate(body):
        following = body[place + 1] if place + 1 < len(body) else None
        explained = (
            isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
            and isinstance(following.value.value, str)
        )
        lines = range(statement.lineno - 1, (statement.end_lineno or statement.lineno) + 1)
        if not explained and commented.isdisjoint(lines):
            found += [f"line {statement.lineno}: {name}" for name in constant_names(statement)]
    return found


@pytest.mark.parametrize("path", FILES, ids=[str(path.relative_to(FILES[0].parents[0])) for path in FILES])
def test_every_numeric_constant_is_explained(path: Path) -> None:
    assert not undocumented(path.read_text("utf-8"))


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("LIMIT = 3.0\n", ["line 1: LIMIT"]),
        ("_A, _B = 1, 2.0\n", ["line 1: _A", "line 1: _B"]),
        ("LIMIT: float = 3.0\nx = 1\n", ["line 1: LIMIT"]),
        ("LIMIT = np.radians(3.0)  # noqa: X\n", ["line 1: LIMIT"]),
        ('LIMIT = 3.0\n"""Largest length [m]."""\n', []),
        ("LIMIT = 3.0  # largest length [m]\n", []),
        ("# Largest length [m].\nLIMIT = 3.0\n", []),
        ('WORDS = ("a", "b")\nSTRICT = True\nrate = 3.0\n', []),
    ],
)
def test_the_check_finds_what_it_should(source: str, names: list[str]) -> None:
    assert undocumented(source) == names
