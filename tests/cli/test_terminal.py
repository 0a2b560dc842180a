"""What a terminal shows: tables, and how work goes."""

from __future__ import annotations

import io
import shutil
import sys
import threading
from pathlib import Path

import pytest

from lab.cli.app import main
from lab.cli.terminal import ERASE, ProgressLine, table


def test_a_wide_last_column_goes_on_below_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    lines = table(
        ("name", "text"), [("a", "one two three four five six seven eight nine ten"), ("b", "")]
    ).splitlines()
    assert lines[0] == "name  text"
    assert lines[1].startswith("a     one two")
    assert lines[2].startswith("      ")
    assert all(len(line) <= 40 for line in lines)
    assert lines[-1] == "b"


def test_what_a_stranger_wrote_gives_the_terminal_no_orders(
    own_missions: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    title = 'title = "\\u001b]0;mine\\u0007\\u001b[2J\\u202ekcab\\u009b31m"\n'
    (own_missions / "odd.toml").write_text(f'{title}recording = "none.csv"\n')
    (own_missions / "\x1b[31m.toml").write_text("nothing = 1\n")
    before = sys.stdout, sys.stderr
    try:
        for command in (["missions"], ["run", "\x1b[2J"], ["import", "\x1b]0;\x07.csv"]):
            monkeypatch.setattr(sys, "argv", ["ins-lab", *command])
            with pytest.raises(SystemExit):
                main()
    finally:
        for path in own_missions.iterdir():  # a process that another test stopped may have left a folder
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert (sys.stdout, sys.stderr) == before
    shown = "".join(capsys.readouterr())
    assert shown.count("\\x1b") >= 2  # in the refusals of the last two; the log may go elsewhere in tests
    assert not set(shown) & set("\x1b\x07\x9b\u202e")


def test_a_terminal_says_at_once_that_a_command_starts_until_its_first_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for command, refused in ((["cards"], False), (["run", "no_such_mission"], True)):
        screen = _Screen()
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setattr(sys, "argv", ["ins-lab", *command])
        with pytest.raises(SystemExit) as ended:
            main()
        before, after = screen.getvalue().split(f"starting ...{ERASE}")
        assert not before
        assert bool(ended.value.code) == refused == ("there is no mission" in after)
        assert "starting" not in capsys.readouterr().out
    monkeypatch.setattr(sys, "stderr", io.StringIO())  # a file, as in a script
    with pytest.raises(SystemExit):
        main()
    assert "starting" not in sys.stderr.getvalue()


class _Screen(io.StringIO):
    """A terminal that says when it has been written to."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def isatty(self) -> bool:
        return True

    def flush(self) -> None:
        self.written.set()


def test_quick_work_shows_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.cli.terminal.PATIENCE", 60)
    screen = _Screen()
    with ProgressLine("working", screen) as progress:
        progress("halfway", 0.5)
    assert screen.getvalue() == ""


def test_slow_work_follows_the_news_and_leaves_no_trace_in_a_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("lab.cli.terminal.PATIENCE", 0)
    screen = _Screen()
    with ProgressLine("montreal", screen) as progress:
        assert screen.written.wait(10)
        progress("flying", 0.25)
        progress("flying", 0.5)
        progress("landing", 1.0)
    shown = screen.getvalue().split("\r\x1b[K")
    assert shown[-1] == ""
    lines = [line.rpartition(",")[0] for line in shown[1:-1]]
    assert list(dict.fromkeys(lines)) == [
        "montreal ... 0%",
        "montreal: flying ... 25%",
        "montreal: flying ... 50%",
    ]


def test_slow_work_tells_each_step_once_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.cli.terminal.PATIENCE", 0)
    log = _Screen()
    monkeypatch.setattr(log, "isatty", lambda: False)
    with ProgressLine("montreal", log) as progress:
        assert log.written.wait(10)
        progress("flying", 0.25)
        progress("flying", 0.5)
    assert log.getvalue() == "montreal ...\nmontreal: flying ...\n"


def test_where_there_is_no_terminal_a_count_is_shown_at_each_tenth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.cli.terminal.PATIENCE", 0)
    log = _Screen()
    monkeypatch.setattr(log, "isatty", lambda: False)
    with ProgressLine("montreal", log) as progress:
        assert log.written.wait(10)
        for done in range(1, 1001):
            progress(f"{done:,} of 1,000 runs, {1000 / done:.3g} per second", done / 1000)
        progress("trying the advice", 0.1)
    shown = log.getvalue().splitlines()
    assert shown[1] == "montreal: 1 of 1,000 runs, 1e+03 per second ..."
    assert shown[-1] == "montreal: trying the advice ..."
    assert len(shown) == 3 + 9
