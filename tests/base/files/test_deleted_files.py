"""Deleted files: they come back, and none is lost where one cannot be moved."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.base.files.deleted_files import DeletedFiles


def test_files_come_back_and_a_file_that_cannot_be_moved_leaves_all_in_place(tmp_path: Path) -> None:
    there = tmp_path / "one.toml"
    there.write_text("title = 'x'")
    with pytest.raises(FileNotFoundError):
        DeletedFiles.taken("mission one", tmp_path, [there, tmp_path / "none.csv"])
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["one.toml"]
    deleted = DeletedFiles.taken("mission one", tmp_path, [there])
    assert not there.exists()
    deleted.restore()
    assert there.read_text() == "title = 'x'"
