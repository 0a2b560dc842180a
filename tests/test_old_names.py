"""Old names: what notebooks of version 0.1 import is found, and named anew."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import lab
import lab.run
from lab.base.old_names import OLD_NAMES
from lab.experiment.experiment import Experiment

ROOT = Path(__file__).parent.parent
IMPORTS = (Path(__file__).parent / "saved" / "imports.txt").read_text("utf-8").splitlines()
"""The imports of the notebooks and documents of version 0.1, and the deep names in its documents."""
NOTEBOOKS = sorted((Path(__file__).parent / "saved" / "notebooks").glob("*.py"))
"""Its notebooks that import by whole names which are old now."""


@pytest.mark.parametrize("old", OLD_NAMES)
def test_an_old_name_is_that_module_today(old: str) -> None:
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} is {OLD_NAMES[old]} now"):
        module = importlib.import_module(old)
    today = importlib.import_module(OLD_NAMES[old])
    public = [name for name in vars(today) if not name.startswith("_")]
    assert public
    for name in public:
        assert getattr(module, name) is getattr(today, name)
    with pytest.raises(AttributeError, match="no_such"):
        _ = module.no_such


def test_no_old_name_hides_a_file() -> None:
    for old in OLD_NAMES:
        path = ROOT.joinpath(*old.split("."))
        assert not path.exists()
        assert not path.with_suffix(".py").exists()


def test_what_was_never_there_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("lab.frames.no_such")
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("lab.no_such")
    with pytest.raises(ImportError):
        exec("from lab.frames import no_such")


@pytest.mark.filterwarnings("ignore:.* now:DeprecationWarning")
@pytest.mark.parametrize("line", IMPORTS)
def test_an_old_import_works(line: str) -> None:
    exec(line, {})


@pytest.mark.proof
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_an_old_notebook_runs(path: Path) -> None:
    """In a process of its own, as `jupyter` runs it; a warning in it names the new name."""
    ran = subprocess.run(
        [sys.executable, "-W", "default::DeprecationWarning", str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert " now" in ran.stderr


def test_a_result_answers_to_the_old_name_of_missing_reason() -> None:
    result = Experiment().run()
    with pytest.warns(DeprecationWarning, match="lacks is Result.missing_reason now"):
        assert result.lacks("errors") == result.missing_reason("errors") == ""


def test_the_error_of_a_result_is_found_where_it_was() -> None:
    with pytest.warns(DeprecationWarning, match="lab.run.ResultError is lab.ResultError now"):
        assert lab.run.ResultError is lab.ResultError
    with pytest.raises(AttributeError, match="no_such"):
        _ = lab.run.no_such
