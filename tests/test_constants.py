"""Every number at module level says what it means, and thresholds that judge a user's data are there."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path

import pytest

import lab

FILES = sorted(Path(lab.__file__).parent.rglob("*.py"))
DIRECTIVES = ("fmt:", "type:", "noqa")
"""Beginnings of comments that are for tools and say nothing of a number."""
ROOT = FILES[0].parents[0]
JUDGES = (
    *("base/files", "base/parameters", "data", "motion/recordings", "missions", "analysis", "flying", "live"),
    *("classroom/lessons", "navigation/alignment", "navigation/algorithm.py", "navigation/belief.py"),
    *("navigation/checks.py", "navigation/log_navigation.py", "navigation/log_readings.py"),
    *("navigation/standstill.py", "navigation/reference.py", "navigation/kernels/driver.py"),
    *("navigation/filters/observation.py", "sensors/suite.py", "run/log_reference.py"),
    "experiment/log_run.py",
)
"""Rooms and files that refuse, repair or judge what a user brings."""
COMPARING = {"allclose", "clip", "isclose", "max", "maximum", "min", "minimum", "percentile", "quantile"}
"""Functions whose numbers are limits or shares, as those of a comparison are."""
PLAIN = {0, 1, 2}
"""Numbers that need no name: nothing, the whole, a pair, and their negatives."""
ROUNDING = 1e-9
"""Largest number that covers rounding or keeps a divisor from zero: no measurement is judged so finely."""
ORDERING = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
"""Comparisons with a limit; to be equal to a number is to have a shape, or to be that choice."""


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
    without = []
    for statement, following in zip_longest(body, body[1:]):
        explained = (
            isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
            and isinstance(following.value.value, str)
        )
        if not explained and (names := constant_names(statement)):
            without.append((statement, names))
    if not without:
        return []  # comments, which take longer to find than statements, are needed by few files
    commented = {
        token.start[0]
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and not token.string.lstrip("# ").startswith(DIRECTIVES)
    }
    return [
        f"line {statement.lineno}: {name}"
        for statement, names in without
        if commented.isdisjoint(range(statement.lineno - 1, (statement.end_lineno or statement.lineno) + 1))
        for name in names
    ]


def by_file(check: Callable[[str], list[str]], paths: list[Path]) -> dict[str, list[str]]:
    """Return what a check finds in files, by their names; only of those where it finds anything."""
    found = {str(path.relative_to(ROOT)): check(path.read_text("utf-8")) for path in paths}
    return {name: lines for name, lines in found.items() if lines}


def called(function: ast.expr) -> str:
    """Return the last name of what is called or asked for: `clip` of `np.clip`."""
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def numbers(part: ast.AST) -> Iterator[ast.Constant]:
    """Yield the numbers of an expression that need a name; not indices, exponents, arguments."""
    if isinstance(part, ast.Constant):
        if isinstance(part.value, int | float) and not isinstance(part.value, bool):
            size = abs(part.value)
            if size not in PLAIN and size > ROUNDING:
                yield part
    elif isinstance(part, ast.Subscript):
        yield from numbers(part.value)
    elif isinstance(part, ast.Call):
        yield from numbers(part.func)
    elif isinstance(part, ast.BinOp) and isinstance(part.op, ast.Pow):
        yield from numbers(part.left)
    else:
        for inner in ast.iter_child_nodes(part):
            yield from numbers(inner)


def nameless(source: str) -> list[str]:
    """Return the thresholds inside the functions of a module that are bare numbers, with their lines."""
    found = {}
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        for part in ast.walk(function):
            limits: list[ast.expr] = []
            if isinstance(part, ast.Compare) and any(isinstance(one, ORDERING) for one in part.ops):
                limits = [part.left, *part.comparators]
            elif isinstance(part, ast.Call) and called(part.func) in COMPARING:
                limits = [
                    *part.args,
                    *(one.value for one in part.keywords if one.arg in {"rtol", "atol", "q"}),
                ]
            for limit in limits:
                for number in numbers(limit):
                    found[number.lineno, number.col_offset] = number.value
    return [f"line {line}: {value}" for (line, _), value in sorted(found.items())]


def test_every_threshold_has_a_name() -> None:
    judging = [path for path in FILES if str(path.relative_to(ROOT)).startswith(JUDGES)]
    assert not by_file(nameless, judging)


def test_every_judging_room_exists() -> None:
    assert not [name for name in JUDGES if not (ROOT / name).exists()]


@pytest.mark.parametrize(
    ("body", "bare"),
    [
        ("x < 0.3", ["line 2: 0.3"]),
        ("3.5 * y >= x", ["line 2: 3.5"]),
        ("x > -4", ["line 2: 4"]),
        ("len(x) < 5", ["line 2: 5"]),
        ("f(x, 7) > y[8]", []),
        ("(x > 5).any()", ["line 2: 5"]),
        ("np.clip(x, -50, 1)", ["line 2: 50"]),
        ("np.quantile(x, 0.95)", ["line 2: 0.95"]),
        ("np.allclose(x, 1, atol=1e-3)", ["line 2: 0.001"]),
        ("max(x, 1e-12) > LIMIT", []),
        ("len(x) == 3 or x.shape != (4,)", []),
        ("0 < x < 2 or x == -1 or x is True", []),
        ("x[:3] <= y", []),
        ("x**4 < y", []),
        ("not x**4 < 16.3 * y", ["line 2: 16.3"]),
    ],
)
def test_the_check_of_thresholds_finds_what_it_should(body: str, bare: list[str]) -> None:
    assert nameless(f"def judge(x, y):\n    return {body}\n") == bare


def test_every_numeric_constant_is_explained() -> None:
    assert not by_file(undocumented, FILES)


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
