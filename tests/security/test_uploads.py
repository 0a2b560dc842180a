"""Uploads are bounded, and gone once their server is, however it ended; saving lets others work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from bokeh.document import Document
from bokeh.server.callbacks import NextTickCallback
from panel.io.state import set_curdoc

from dashboards import exchange
from dashboards.computing import LatestWins, attempt
from dashboards.exchange import Files
from dashboards.held_links import HeldLinks
from dashboards.pages.missions.job import Job
from dashboards.pages.missions.library import Library
from dashboards.session import Session
from dashboards.upload import PREFIX, Upload, remove_abandoned
from dashboards.visitors import VARIABLE
from lab.analysis.rest import read_log
from lab.base.files.locks import folder_lock, lock_folder
from lab.missions import MissionError, describe_mission, missions
from lab.missions import library as mission_library

ROOT = Path(__file__).parents[2]
posix_only = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def document() -> Iterator[Document]:
    made = Document()
    with set_curdoc(made):
        yield made


def test_a_settings_file_is_refused_before_it_is_whole(document: Document, temporary: Path) -> None:
    session = Session(document)
    files = Files(session, HeldLinks(session, document))
    upload = files._upload
    upload._send_msg = lambda _message: None
    piece = bytes(2**18)
    for chunk in range(1, 41):  # 10 MB of the 600 that were taken
        upload._handle_msg(
            {"status": "upload_event", "name": "a.toml", "chunk": chunk, "total_chunks": 2400, "data": piece}
        )
        kept = sum(path.stat().st_size for path in temporary.rglob("*") if path.is_file())
        assert kept <= exchange.MAX_BYTES
    assert not upload._file_buffer
    upload._handle_msg({"status": "finished"})
    assert "accepted are up to 1 MB" in session.problem
    for text, seed in ((b"seed = 7", 7), (b"\xff", 7), (b"seed = 8", 8)):
        piece_of = {"name": "b.toml", "chunk": 1, "total_chunks": 1, "data": text}
        upload._handle_msg({"status": "upload_event", **piece_of})
        upload._handle_msg({"status": "finished"})
        _settle(document, files._reading)
        assert session.experiment.seed == seed
    files.close()
    session.close()
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("data", [10**9, "text", None, [1, 2], {"a": 1}])
def test_a_piece_that_is_no_bytes_is_empty(temporary: Path, data: object) -> None:
    arrived: list[Path] = []
    upload = Upload(arrived.extend, print)
    upload._process_chunk({"name": "a.csv", "chunk": 1, "data": data})
    upload._flush_buffer()
    assert [path.stat().st_size for path in arrived] == [0]
    upload.delete()


def test_no_error_tells_where_a_file_was_put(temporary: Path) -> None:
    """Whatever page reads it: what is wrong goes the same way."""
    arrived: list[Path] = []
    upload = Upload(arrived.extend, print)
    upload._process_chunk({"name": "a.csv", "chunk": 1, "data": b"a,b\n1,2\n"})
    upload._flush_buffer()
    problem = attempt(lambda: read_log(arrived)).problem
    assert problem.startswith("a.csv: ")
    assert str(temporary) not in problem
    upload.delete()


CHILD = """
import asyncio
from dashboards.ending import end_on_signals
from dashboards.upload import Upload, remove_all_here

async def stand():
    end_on_signals(asyncio.get_running_loop(), list, lambda: None, iter([remove_all_here]))
    kept = Upload(print, print)
    kept._process_chunk({"name": "a.csv", "chunk": 1, "data": b"flight"})
    print("there", flush=True)
    await asyncio.Event().wait()

asyncio.run(stand())
"""


@pytest.mark.proof
@posix_only
@pytest.mark.parametrize(("number", "left"), [("SIGTERM", 0), ("SIGKILL", 1)])
def test_a_server_that_is_ended_leaves_none_and_one_that_is_killed_none_for_long(
    temporary: Path, number: str, left: int
) -> None:
    environment = {**os.environ, "TMPDIR": str(temporary)}
    with subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", CHILD], env=environment, cwd=ROOT, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"there\n"
        remove_abandoned()
        assert len(list(temporary.glob(f"{PREFIX}{child.pid}-*/1/a.csv"))) == 1  # its server lives
        child.send_signal(getattr(signal, number))
        assert child.wait(timeout=60) == -getattr(signal, number)
    assert len(list(temporary.iterdir())) == left
    remove_abandoned()
    assert list(temporary.iterdir()) == []


@posix_only
def test_links_and_folders_of_others_are_left_alone(temporary: Path) -> None:
    foreign = temporary / "foreign"
    foreign.mkdir()
    (foreign / ".lock").touch()
    (foreign / "kept").touch()
    (temporary / f"{PREFIX}1-link").symlink_to(foreign)
    (temporary / f"{PREFIX}1-file").touch()
    remove_abandoned()
    assert (foreign / "kept").exists()


def test_saving_waits_for_the_folder_in_a_thread(
    document: Document, mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "edit")
    waiting = threading.Event()

    def lock(folder: Path):
        waiting.set()
        return folder_lock(folder)

    monkeypatch.setattr(mission_library, "folder_lock", lock)
    library = Library(Session(document))
    library._act("edit", "mine")
    library._title.value_input = "Another title"
    held = lock_folder(mine)
    assert held is not None
    library._changing._try_action()  # would wait for the lock, held by this very thread
    assert waiting.wait(60)
    assert missions()["mine"].title == "My flight"
    held.close()
    _settle(document, library._changing._job)
    assert missions()["mine"].title == "Another title"
    assert not library._changing.view.open
    library.close()


def _settle(document: Document, work: Job | LatestWins[bytes]) -> None:
    """Do what the document was asked to do later, until the work is done."""
    until = time.monotonic() + 60
    while True:
        busy = work.busy
        waiting = [one for one in document.session_callbacks if isinstance(one, NextTickCallback)]
        for one in waiting:
            callback = one.callback  # a callback that was removed refers to nothing
            document.remove_next_tick_callback(one)
            callback()
        if not busy and not waiting:
            return
        if not waiting:
            time.sleep(0.005)  # the thread that works needs the interpreter
        assert time.monotonic() < until


def test_a_folder_that_stays_locked_is_said_to_be(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_library, "folder_lock", lambda folder: folder_lock(folder, 0.05))
    held = lock_folder(mine)
    assert held is not None
    with held, pytest.raises(MissionError, match="another program has been changing this folder"):
        describe_mission("mine", title="Another title")
    assert describe_mission("mine", title="Another title").title == "Another title"


BLOCKED = """
import hashlib
from tornado.ioloop import IOLoop
from dashboards.server import serve


def block() -> None:
    print("blocked", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # for minutes, no handler of signals has its turn


IOLoop.current().call_later(0.1, block)
serve(port=0, warm=False)
"""


@pytest.mark.proof
@posix_only
def test_a_server_whose_loop_is_blocked_ends_when_the_system_asks(temporary: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(temporary)}
    with subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", BLOCKED], env=environment, cwd=ROOT, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        assert any(line == b"blocked\n" for line in child.stdout)
        child.send_signal(signal.SIGTERM)
        try:
            # Another thread than the main one ends the process, with the status that shells show for it.
            assert child.wait(timeout=20) == 128 + signal.SIGTERM
        finally:
            child.kill()
