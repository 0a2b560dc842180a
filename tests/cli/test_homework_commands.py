"""``ins-lab homework`` and ``ins-lab grade``: the whole way from the document's homework to the grades."""

from __future__ import annotations

import codecs
import csv
import io
import json
import re
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest
from asking import ask, refused

DOCUMENT = Path(__file__).parents[2] / "docs/homework.md"
SOURCE, SCRIPT = (
    re.findall(rf"^```{kind}\n(.*?)^```", DOCUMENT.read_text("utf-8"), re.DOTALL | re.MULTILINE)[0]
    for kind in ("toml", "python")
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "receiver.toml").write_text(SOURCE, encoding="utf-8")
    made = ask("homework", "make", "receiver.toml", "--out", "receiver.homework")
    assert made.exit_code == 0, made.output
    return tmp_path


@pytest.mark.proof
def test_the_homework_of_the_document_is_solved_handed_in_and_graded(folder: Path) -> None:
    assert stat.S_IMODE((folder / "receiver.key").stat().st_mode) == 0o600
    shown = ask("homework", "show", "receiver.homework").stdout
    for words in ("The new receiver", "You may change: navigator", "  fixes that come late", "1. How old"):
        assert words in shown
    facts = json.loads(ask("homework", "show", "receiver.homework", "--json").stdout)
    assert facts["points"] == 8
    assert not {"hidden", "answer", "seed"} & set(re.findall(r"\w+", json.dumps(facts)))
    handed = folder / "handed_in"
    handed.mkdir()
    exec(compile(SCRIPT, str(DOCUMENT), "exec"), {})  # writes ada.handin, as a student in a notebook
    (folder / "ada.handin").rename(handed / "ada.handin")
    of_bob = ask(
        *("homework", "hand-in", "receiver.homework", "--name", "Bob", "--out", "handed_in/bob.handin"),
        *("--answer", "2=white", "--fault", "two axes swapped"),
    )
    assert "settings: as in the homework" in of_bob.stdout
    run = json.loads(ask("homework", "run", "receiver.homework", "--json").stdout)
    assert run["settings"]["sensors"]["gps"]["latency"] == 0.0
    assert any("hidden" in remark for remark in run["remarks"])
    printed = ask("grade", "handed_in", "--key", "receiver.key")
    ada, bob = csv.DictReader(io.StringIO(printed.stdout))
    assert (ada["name"], ada["points"], ada["of"]) == ("Ada Lovelace", "8", "8")
    assert (bob["name"], bob["points"], bob["faults_wrong"]) == ("Bob", "0", "1")
    assert ask("grade", "handed_in", "--key", "receiver.key", "--out", "handed_in/grades.csv").exit_code == 0
    written = (handed / "grades.csv").read_bytes()
    assert written.decode("utf-8-sig") == printed.stdout
    again = ask("grade", "handed_in", "--key", "receiver.key", "--out", "handed_in/grades.csv", "--force")
    assert again.exit_code == 0
    assert (handed / "grades.csv").read_bytes() == written  # the table is no hand-in


def test_what_is_wrong_is_said_and_nothing_is_replaced(folder: Path) -> None:
    key = (folder / "receiver.key").read_bytes()
    refused(ask("homework", "make", "receiver.toml", "--out", "receiver.homework"), "exists already")
    again = ask("homework", "make", "receiver.toml", "--out", "receiver.homework", "--force")
    refused(again, "receiver.key", "never replaced")
    assert (folder / "receiver.key").read_bytes() == key
    refused(ask("homework", "make", "none.toml", "--out", "a.homework"), "none.toml")
    refused(ask("homework", "show", "receiver.key"), "belongs to the teacher")
    one = ("homework", "run", "receiver.homework", "--set")
    refused(ask(*one, "trajectory.imu_rate=1000"), "does not let you change it")
    refused(ask(*one, "sensors.gps.latency=0.1"), "does not let you change it")
    hand_in = ("homework", "hand-in", "receiver.homework", "--out", "a.handin", "--name")
    refused(ask(*hand_in, ""), "name")
    refused(ask(*hand_in, "Ada", "--answer", "3=1"), "from 1 to 2")
    refused(ask(*hand_in, "Ada", "--fault", "none"), "'none'")
    refused(ask(*hand_in, "Ada", "--set", "seed=3"), "seed is not handed in", "homework run")
    refused(ask("grade", ".", "--key", "receiver.homework"), "is not the key")
    refused(ask("grade", "none", "--key", "receiver.key"), "none")
    refused(ask("serve", "--homework", "none"), "--homework none", "accepted")
    assert not (folder / "a.handin").exists()


def test_the_seed_of_saved_settings_is_not_handed_in_and_the_command_says_so(folder: Path) -> None:
    (folder / "mine.toml").write_text("seed = 5\n[navigator]\nlatency = 0.1\n", encoding="utf-8")
    hand_in = ("homework", "hand-in", "receiver.homework", "--out", "a.handin", "--name", "Ada")
    said = ask(*hand_in, "--config", "mine.toml").stdout
    assert "settings: navigator.latency=0.1" in said
    assert "The seed 5 of mine.toml is not handed in" in said
    assert "seed" not in ask(*hand_in, "--set", "navigator.latency=0.1", "--force").stdout


def test_a_missing_package_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    for command in (
        ("homework", "make", "receiver.toml", "--out", "b.homework"),
        ("homework", "show", "receiver.homework"),
        ("grade", ".", "--key", "receiver.key"),
    ):
        refused(ask(*command), "cryptography", "pip install 'ins-lab[homework]'")


@pytest.fixture
def full_at() -> Iterator[Callable[[int], None]]:
    """Return a function after which no file gets larger than some bytes, as on a disk that is almost full."""
    resource = pytest.importorskip("resource", reason="this system has no limit of a file's size")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_reported_and_keeps_no_part_of_a_key(folder: Path, full_at) -> None:
    full_at(100)
    refused(ask("homework", "make", "receiver.toml", "--out", "new.homework"), "new.key", "File too large")
    assert not list(folder.glob("*new*"))


def test_a_homework_that_cannot_be_written_leaves_no_key(folder: Path) -> None:
    """The key is never replaced, so it would refuse the next attempt."""
    name = "n" * 241 + ".homework"  # of 255 letters, but the temporary file has ten more
    refused(ask("homework", "make", "receiver.toml", "--out", name), "File name too long")
    assert not list(folder.glob("*nnn*"))


def test_a_table_in_a_file_begins_with_the_mark_that_excel_needs_for_utf_8(folder: Path) -> None:
    (folder / "handed_in").mkdir()
    (folder / "handed_in/Zoë.txt").write_text("no hand-in", encoding="utf-8")
    one = ("grade", "handed_in", "--key", "receiver.key")
    assert ask(*one, "--out", "grades.csv").exit_code == 0
    written = (folder / "grades.csv").read_bytes()
    assert written.startswith(codecs.BOM_UTF8)
    assert written.decode("utf-8-sig") == ask(*one).stdout
    assert pd.read_csv(folder / "grades.csv")["file"].tolist() == ["Zoë.txt"]


def test_a_table_that_cannot_be_written_is_printed(folder: Path) -> None:
    (folder / "handed_in").mkdir()
    (folder / "handed_in/note.txt").write_text("no hand-in", encoding="utf-8")
    one = ("grade", "handed_in", "--key", "receiver.key")
    printed = ask(*one)
    assert "note.txt" in printed.stdout
    failed = ask(*one, "--out", "g" * 251 + ".csv")  # the temporary file has ten letters more than the 255
    assert failed.exit_code == 2
    assert failed.stdout == printed.stdout
    assert "File name too long; the table is on standard output instead" in failed.stderr
