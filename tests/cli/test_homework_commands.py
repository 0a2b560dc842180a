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


EACH = re.findall(r"^```toml\n(.*?)^```", DOCUMENT.read_text("utf-8"), re.DOTALL | re.MULTILINE)[1]
ROSTER = """Student,ID,SIS User ID,SIS Login ID,Section,How late? (77)
    Points Possible,,,,,2.00
"Lovelace, Ada",11,u11,ada@x.org,A,
"=1+1, Bob",12,u12,bob@x.org,A,
"""


@pytest.fixture
def each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the key of a homework with variants, and a roster."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "each.toml").write_text(EACH, encoding="utf-8")
    (tmp_path / "class.csv").write_text(ROSTER, encoding="utf-8")
    made = ask("homework", "make", "each.toml", "--out", "each.homework")
    assert made.exit_code == 0, made.output
    assert "ins-lab homework variants each.key" in made.stdout
    assert not (tmp_path / "each.homework").exists()
    return tmp_path


def test_the_way_of_a_homework_with_variants(each: Path) -> None:
    """Ada solves hers, Bob puts his name on hers; points and feedback come back, and no formula."""
    made = ask("homework", "variants", "each.key", "--roster", "class.csv", "--name", "Eve", "--out", "files")
    assert made.exit_code == 0, made.output
    names = {path.name for path in (each / "files").iterdir()}
    assert names == {"Ada_Lovelace.homework", "Bob_1_1.homework", "Eve.homework", "links.csv"}
    of_ada = "files/Ada_Lovelace.homework"
    assert "This file is for Ada Lovelace" in ask("homework", "show", of_ada).stdout
    assert json.loads(ask("homework", "show", of_ada, "--json").stdout)["student"] == "Ada Lovelace"
    handed = ("homework", "hand-in", of_ada)
    refused(ask(*handed, "--name", "Bob", "--out", "bob.handin"), "homework of Ada Lovelace")
    (each / "handed").mkdir()
    assert ask(*handed, "--name", "ada lovelace", "--out", "handed/ada.handin").exit_code == 0
    sheet = ask("homework", "solutions", "each.key", "--roster", "class.csv", "--out", "sheet.html")
    assert sheet.exit_code == 0, sheet.output
    assert "<td>Ada Lovelace</td>" in (each / "sheet.html").read_text("utf-8")
    graded = ask(
        *("grade", "handed", "--key", "each.key", "--out", "grades.csv", "--feedback", "feedback"),
        *("--roster", "class.csv", "--canvas", "canvas.csv"),
    )
    assert graded.exit_code == 0, graded.output
    _, ada, bob = csv.DictReader(io.StringIO((each / "canvas.csv").read_text("utf-8")))
    assert (ada["Student"], ada["How late? (77)"]) == ("Lovelace, Ada", "0")
    assert (bob["Student"], bob["How late? (77)"]) == ("'=1+1, Bob", "")
    assert "Points: 0 of 1" in (each / "feedback/ada.handin.feedback.txt").read_text("utf-8")
    again = ("grade", "handed", "--key", "each.key", "--roster", "class.csv")
    refused(ask(*again, "--feedback", "feedback"), "feedback", "not empty")
    refused(ask(*again, "--feedback", "handed/new"), "within the hand-ins")
    refused(ask(*again, "--moodle", "moodle.csv"), "Email")
    refused(ask("grade", "handed", "--key", "each.key", "--canvas", "new.csv"), "--canvas", "--roster")
    refused(ask("homework", "variants", "each.key", "--name", "Zoe", "--out", "files"), "not empty")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "new"], "accepted are --roster FILE.csv"),
        (["--out", "new", "--name", "Ada", "--name", "ADA"], "there twice"),
        (["--out", "new", "--name", " "], "accepted are names"),
        (["--out", "new", "--roster", "each.toml"], "no column with names"),
    ],
)
def test_students_that_are_no_students_are_refused(each: Path, arguments: list[str], words: str) -> None:
    refused(ask("homework", "variants", "each.key", *arguments), words)
    assert not (each / "new").exists()


def test_a_homework_that_is_the_same_for_all_has_no_variants(folder: Path) -> None:
    refused(ask("homework", "variants", "receiver.key", "--name", "Ada", "--out", "new"), "hidden.each")
