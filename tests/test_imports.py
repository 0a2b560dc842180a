"""Imports: a module that is imported changes nothing in its process; exceptions are listed with a reason."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = {Path("dashboards/simulator.py"), Path("dashboards/upstream/rest_routes.py")}
"""Files that a server runs: a page, and what Panel loads with it."""
MODULES = (path.relative_to(ROOT) for top in ("lab", "dashboards") for path in (ROOT / top).rglob("*.py"))
FILES = sorted(set(MODULES) - SCRIPTS)
HARMLESS = {
    "check_files",  # of one function of the package
    "command",  # of the command line, in a group of its own
    "find_old_names",  # of the package's own modules
    "register",  # what a file of the package offers to earlier ones
    "register_cards",  # the displays of the package's own classes, in a notebook
    "register_completion",
    "_declare",  # to the compiler, what operators of a type of numbers do
    "warn_of_foreign_files",  # of another package of this name
    "setflags",  # of an array of the module
    "vars().update",  # of a class: its parameters, made from a table
}


def calls(body: list[ast.stmt]) -> list[str]:
    """Return what statements at module level call for its effect alone, also inside loops and conditions."""
    found = []
    for statement in body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
            called = statement.value.func
            while isinstance(called, ast.Call):  # a call of what a call returns, as of a decorator
                called = called.func
            found.append(ast.unparse(called))
        found += [call for part in ("body", "orelse", "finalbody") for call in calls(inner(statement, part))]
    return found


def inner(statement: ast.stmt, part: str) -> list[ast.stmt]:
    """Return the statements inside one that is carried out on import: none of a function or script."""
    is_definition = isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef)
    is_script = isinstance(statement, ast.If) and ast.unparse(statement.test) == "__name__ == '__main__'"
    return [] if is_definition or is_script else getattr(statement, part, [])


SLOW = (
    r"(import|from) (pandas|xarray|trimesh)\b"
    r"|from scipy(?! import (special|linalg)|\.(special|linalg|spatial))\b"
)
"""Imports of 1,000 modules that the page is shown without: the first time, they take 4 s of a processor.
`scipy.optimize`, written whole after ``import scipy``, is imported when it is used.
"""


def test_no_file_imports_on_loading_what_the_page_shows_without() -> None:
    found = {str(file): re.search(rf"^({SLOW}).*", (ROOT / file).read_text("utf-8"), re.M) for file in FILES}
    assert {file: one[0] for file, one in found.items() if one} == {}


@pytest.mark.proof
def test_an_import_changes_nothing_in_the_process() -> None:
    found = {file: calls(ast.parse((ROOT / file).read_text("utf-8")).body) for file in FILES}
    effects = [(str(file), call) for file, called in found.items() for call in called]
    assert [effect for effect in effects if not HARMLESS & {effect[1], effect[1].rpartition(".")[2]}] == []


def test_a_file_of_tests_runs_alone() -> None:
    # Alone, a file finds what stands in its folder and in that of all tests: not the folders of other tests.
    lost = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^(?:from|import) (test_\w+)", path.read_text("utf-8"), re.M)
        if not path.with_name(f"{name}.py").exists()
    ]
    assert lost == []
