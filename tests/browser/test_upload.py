"""Uploads as a hostile browser sends them: names, sizes and pieces; no browser is needed to be one."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashboards.upload import LONGEST_NAME, Upload, plain_name
from lab.base.files.locks import LOCK_FILE


class Inbox:
    """An upload, with what it has handed over."""

    def __init__(self) -> None:
        self.paths: list[Path] = []
        self.refusals: list[str] = []
        self.widget = Upload(self.paths.extend, self.refusals.append, largest=100)
        self.widget._send_msg = lambda _message: None

    def send(self, *pieces: tuple[str, int, bytes]) -> None:
        """Send pieces of files, and say that this was all."""
        self.paths.clear()
        for name, chunk, data in pieces:
            piece = {"name": name, "chunk": chunk, "total_chunks": 1, "mime_type": "", "data": data}
            self.widget._handle_msg({"status": "upload_event", **piece})
        self.widget._handle_msg({"status": "finished"})


@pytest.fixture
def inbox(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Inbox]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    made = Inbox()
    yield made
    made.widget.delete()
    assert list(tmp_path.iterdir()) == []


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and path.name != LOCK_FILE]


def test_files_arrive_piece_by_piece_and_replace_those_of_before(inbox: Inbox, tmp_path: Path) -> None:
    inbox.send(("a.csv", 1, b"one "), ("b.csv", 1, b"other"), ("a.csv", 2, b"two"))
    assert [(path.name, path.read_bytes()) for path in inbox.paths] == [
        ("a.csv", b"one two"),
        ("b.csv", b"other"),
    ]
    inbox.send(("c.csv", 1, b"three"))
    assert [path.name for path in files(tmp_path)] == ["c.csv"]
    assert inbox.refusals == []


def test_names_that_come_to_the_same_are_kept_apart(inbox: Inbox, tmp_path: Path) -> None:
    inbox.send(("../x/a.csv", 1, b"1"), ("/etc/a.csv", 1, b"2"), ("..", 1, b"3"))
    assert sorted(path.read_bytes() for path in inbox.paths) == [b"1", b"2", b"3"]
    assert len(set(inbox.paths)) == 3
    assert all(tmp_path in path.parents and not path.is_symlink() for path in files(tmp_path))


@pytest.mark.parametrize(
    "pieces",
    [
        [("a.csv", 1, b"x" * 60), ("b.csv", 1, b"x" * 60)],
        [("a.csv", 2, b"x")],
        [("a.csv", 1, b"x"), ("a.csv", 3, b"x")],
        [("a.csv", 1, b"x"), ("a.csv", 1, b"x")],
        [(f"{number}.csv", 1, b"x") for number in range(5)],
    ],
)
def test_what_is_too_much_or_cut_is_refused_and_gone(
    inbox: Inbox, tmp_path: Path, pieces: list[tuple[str, int, bytes]]
) -> None:
    inbox.send(*pieces)
    assert inbox.paths == []
    assert len(inbox.refusals) == 1
    assert "accepted" in inbox.refusals[0]
    assert files(tmp_path) == []
    inbox.send(("a.csv", 1, b"sound"))
    assert [path.read_bytes() for path in inbox.paths] == [b"sound"]


def test_what_the_browser_refuses_is_said_and_leaves_the_files_of_before(
    inbox: Inbox, tmp_path: Path
) -> None:
    inbox.send(("a.csv", 1, b"sound"))
    kept = list(inbox.paths)
    piece = {"name": "b.csv", "chunk": 1, "total_chunks": 2, "mime_type": "", "data": b"half"}
    inbox.widget._handle_msg({"status": "upload_event", **piece})
    inbox.widget._handle_msg({"status": "error", "error": "<img>", "type": "status"})
    assert len(inbox.refusals) == 1
    assert "accepted are up to" in inbox.refusals[0]
    assert "<img>" not in inbox.refusals[0]
    assert files(tmp_path) == kept
    inbox.send(("b.csv", 1, b"sound too"))
    assert files(tmp_path) == inbox.paths


def test_a_file_without_content_is_refused_and_leaves_the_files_of_before(
    inbox: Inbox, tmp_path: Path
) -> None:
    """A browser cuts it into no pieces, and says all the same that it sent all."""
    inbox.send(("a.csv", 1, b"sound"))
    kept = list(inbox.paths)
    inbox.send()
    assert len(inbox.refusals) == 1
    assert "empty" in inbox.refusals[0]
    assert files(tmp_path) == kept


def test_after_the_session_nothing_is_taken(inbox: Inbox, tmp_path: Path) -> None:
    inbox.send(("a.csv", 1, b"x"))
    inbox.widget.delete()
    inbox.send(("b.csv", 1, b"x"))
    assert inbox.paths == []
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_ends_leaves_no_upload(tmp_path: Path) -> None:
    code = """
from dashboards.upload import Upload
kept = Upload(print, print)
kept._process_chunk({"name": "a.csv", "chunk": 1, "data": b"x"})
"""
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        cwd=Path(__file__).parents[2],
        check=False,
    )
    assert ended.returncode == 0
    assert list(tmp_path.iterdir()) == []


@given(name=st.text() | st.text("𝒳/\\. ", min_size=80))
def test_every_name_becomes_one_of_a_file_in_the_folder(name: str) -> None:
    plain = plain_name(name)
    assert Path("folder", plain).parent == Path("folder")
    assert 0 < len(plain) <= LONGEST_NAME
    assert plain not in {".", ".."}
    assert len(f"4_{plain}".encode()) <= 255
    assert plain.isprintable()
