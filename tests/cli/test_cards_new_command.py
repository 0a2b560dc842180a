"""``ins-lab cards new``: with options, on a terminal, and what it refuses."""

from __future__ import annotations

import json
import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest
from asking import RUN_SECONDS, ask, refused

from lab.cli.new_card import interview
from lab.sensors import cards
from lab.sensors.data_sheet import asked_terms

SHEET = (
    *("--grade", "consumer", "--source", "sheet, rev. 2"),
    *("--gyro", "zero-rate offset=0.1 % FS", "--gyro", "noise density=3.8 mdps/sqrt(Hz)"),
    *("--gyro", "full scale=2000 dps", "--accelerometer", "noise=1.2 mg rms in 100 Hz"),
)


def test_options_make_a_card_and_say_what_is_assumed_and_missing(tmp_path: Path) -> None:
    out = tmp_path / "mine.toml"
    answer = ask("cards", "new", str(out), *SHEET)
    assert answer.exit_code == 0, answer.output
    made = cards.card(out)
    assert (made.name, made.grade) == ("mine", "consumer")
    assert made.value("gyro", "bias_sigma") == 2.0  # of the range, which came later
    assert made.is_assumed("gyro", "flicker")
    for words in (
        "Assumed, since the card has no source",
        "No source, off when loaded: gyro: Bandwidth",
        str(out),
    ):
        assert words in answer.stdout
    assert "read as 120 µg/√Hz: rms over the root of the bandwidth" in answer.stderr
    flown = ask("run", "los_angeles", "--card", str(out), "--json")
    assert flown.exit_code == 0, flown.stderr


def test_without_a_file_the_card_goes_to_standard_output() -> None:
    text = ask("cards", "new", "--name", "Mine", *SHEET).stdout
    assert "[Mine.gyro.noise_density]" in text
    facts = json.loads(ask("cards", "new", "--name", "Mine", *SHEET, "--json").stdout)
    assert facts["file"] is None
    assert facts["missing"]["gyro"] == ["Bandwidth"]


def test_what_is_wrong_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    out = tmp_path / "mine.toml"
    new = ("cards", "new", str(out))
    refused(ask(*new), "--gyro and --accelerometer", "terminal")
    refused(ask(*new, "--gyro", "noise=3.8 mdps/√Hz"), "--grade is missing")
    refused(ask(*new, *SHEET, "--gyro", "noise"), "WORD=NUMBER UNIT")
    refused(ask(*new, *SHEET, "--gyro", "ARW=0.2 deg/√h"), "is given already")
    refused(
        ask(*new, *SHEET, "--accelerometer", "bias stability=36 g"),
        "too large for a sensor",
        "Is the unit right?",
    )
    refused(ask("cards", "new", str(tmp_path / "mine.txt"), *SHEET), "ending in .toml")
    refused(ask("cards", "new", str(tmp_path / "no" / "mine.toml"), *SHEET), "there is no folder")
    assert not out.exists()
    out.write_text("mine")
    refused(ask(*new, *SHEET), "exists already", "--force")
    assert out.read_text() == "mine"
    assert ask(*new, *SHEET, "--force").exit_code == 0
    assert cards.card(out).name == "mine"


def test_a_wrong_answer_is_asked_again_until_it_is_right_or_empty(capsys: pytest.CaptureFixture[str]) -> None:
    answers = {
        "Name": ["", "Mine"],
        "Manufacturer": ["Me", "Me"],
        "Grade": ["best", "tactical"],
        "Source": ["sheet", "sheet"],
        "In-run": ["8 furlongs", "0.5 deg/h", ""],
    }
    questions = []

    def reply(question: str, default: str) -> str:
        questions.append(question)
        for begin, left in answers.items():
            if question.startswith(begin) and left:
                return left.pop(0)
        return default

    made = interview(reply)
    assert made.value("gyro", "flicker") == 0.5
    assert list(made.terms) == ["gyro"]
    said = capsys.readouterr().err
    for words in ("needs its name", "'furlongs' is no unit"):
        assert words in said
    assert len(questions) == 8 + len(asked_terms("gyro")) + len(asked_terms("accelerometer")) + 1


def test_a_person_at_a_terminal_is_asked(tmp_path: Path) -> None:
    """In a process of its own, on a terminal: answers, and an end in the middle that writes nothing."""
    out = tmp_path / "mine.toml"
    rest = len(asked_terms("gyro")) + len(asked_terms("accelerometer")) - 2
    answers = ["Mine", "", "own", "sheet, rev. 1", "2000 dps", "3.8 mdps/sqrt(Hz)", *[""] * rest]
    said = _at_a_terminal([*answers, "y"], str(out))
    assert "Noise density" in said
    assert cards.card(out).name == "Mine"
    other = tmp_path / "other.toml"
    assert "Grade" in _at_a_terminal(["Mine", "", "\x04"], str(other))  # the end of the input
    assert not other.exists()


def _at_a_terminal(answers: list[str], out: str) -> str:
    """Return what ``cards new`` says at a terminal; each answer is typed when it waits for one."""
    ours, theirs = pty.openpty()
    arguments = [sys.executable, "-m", "dashboards", "cards", "new", out]
    with subprocess.Popen(
        arguments, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
    ) as process:
        os.close(theirs)
        said, left, until = "", list(answers), time.monotonic() + RUN_SECONDS
        asked_at = 0
        while process.poll() is None and time.monotonic() < until:
            if select.select([ours], [], [], 0.2)[0]:
                try:
                    piece = os.read(ours, 65536).decode(errors="replace")
                except OSError:  # the other end is closed
                    break
                if not piece:
                    break
                said += piece
            if left and said[asked_at:].rstrip(" ").endswith(":"):
                asked_at = len(said)
                answer = left.pop(0)
                os.write(ours, answer.encode() + (b"" if answer == "\x04" else b"\n"))
        process.kill()
    os.close(ours)
    return said
