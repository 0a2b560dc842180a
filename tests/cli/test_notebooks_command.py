"""``ins-lab notebooks``: the lessons are listed and copied, and a user's file is never overwritten."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import nbformat
import pytest
from asking import ask, refused

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.stem for path in (ROOT / "notebooks").glob("*.py"))


def test_the_list_has_every_notebook_with_its_heading() -> None:
    listed = json.loads(ask("notebooks", "list", "--json").stdout)
    assert [one["name"] for one in listed] == NAMES
    assert listed[0]["title"] == "A tour of INS Lab"
    assert all(name in ask("notebooks", "list").stdout for name in NAMES)


def test_copies_are_notebooks_for_jupyter_without_outputs(tmp_path: Path) -> None:
    answer = ask("notebooks", "copy", str(tmp_path / "new" / "folder"))
    assert answer.exit_code == 0, answer.stderr
    paths = [Path(line) for line in answer.stdout.splitlines()]
    assert [path.name for path in paths] == [f"{name}.ipynb" for name in NAMES]
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        assert notebook.metadata["kernelspec"]["name"] == "python3"
        code = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert code
        assert not any(cell.outputs or cell.execution_count for cell in code)
        text = (ROOT / "notebooks" / f"{path.stem}.py").read_text("utf-8")
        assert all(cell.source in text for cell in code if not cell.source.startswith("%%"))


def test_a_file_of_the_user_stays_unless_forced(tmp_path: Path) -> None:
    mine = tmp_path / f"{NAMES[0]}.ipynb"
    mine.write_text("my answers", encoding="utf-8")
    answer = ask("notebooks", "copy", str(tmp_path))
    assert answer.exit_code == 0
    assert mine.read_text(encoding="utf-8") == "my answers"
    assert str(mine) not in answer.stdout
    assert mine.name in answer.stderr
    assert "--force" in answer.stderr
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert str(mine) in ask("notebooks", "copy", str(tmp_path), "--force").stdout
    assert mine.read_text(encoding="utf-8") != "my answers"
    # A second copy is the same to the byte: there is nothing random in it.
    assert all((tmp_path / name).read_bytes() == first[name] for name in first if name != mine.name)


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    refused(ask("notebooks", "copy", str(tmp_path / "file")), "file", "cannot be written")


def test_without_jupytext_the_message_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jupytext", None)
    refused(ask("notebooks", "copy", str(tmp_path)), "jupytext", "pip install 'ins-lab[notebook]'")
    assert not list(tmp_path.iterdir())
