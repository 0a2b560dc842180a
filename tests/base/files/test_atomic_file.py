"""A file appears whole under its name, or not at all; and nothing else appears."""

from __future__ import annotations

import os

import pytest

from lab.base.files.atomic_file import atomic_file


def test_a_file_takes_its_name_when_all_is_written(tmp_path):
    path = tmp_path / "file.txt"
    path.write_bytes(b"old")
    with atomic_file(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert [one.name for one in tmp_path.iterdir()] == ["file.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_what_was_not_finished_leaves_nothing(tmp_path, error):
    path = tmp_path / "file.txt"
    for old in (None, b"old"):
        if old is not None:
            path.write_bytes(old)
        with pytest.raises(error), atomic_file(path) as file:
            file.write(b"half")
            raise error
        assert [one.read_bytes() for one in tmp_path.iterdir()] == ([] if old is None else [old])


@pytest.mark.skipif(os.name == "nt", reason="Windows has other permissions")
def test_others_may_read_it_as_the_umask_says(tmp_path):
    before = os.umask(0o027)
    try:
        with atomic_file(tmp_path / "file.txt") as file:
            file.write(b"new")
    finally:
        os.umask(before)
    assert (tmp_path / "file.txt").stat().st_mode & 0o777 == 0o640
