"""Every command line of ``ins-lab`` that a document shows is run, cheaply, and does not fail.

A line that names a file of the reader's gets one from `FILES`. A line that no test can run is in `NOT_RUN`,
with the reason; the parser of the command line accepts it all the same.
"""

from __future__ import annotations

import itertools
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from asking import Answer
from document_code import DOCUMENTS, Line, lines, name_of
from document_files import FILES, make_files
from typer.main import get_command
from typer.testing import CliRunner

from dashboards.command_line import app

WRITES = {
    "run": {"--out", "--export"},
    "ensemble": {"--out"},
    "sweep": {"--out"},
    "export": {"--to"},
    "outage": {"--out"},
    "identify": {"--card", "--settings"},
    "allan": {"--card"},
    "calibrate imu": {"--out", "--card"},
    "receiver": {"--settings"},
    "homework make": {"--out"},
    "homework hand-in": {"--out"},
    "homework variants": {"--out"},
    "homework solutions": {"--out"},
    "grade": {"--out", "--feedback", "--moodle"},
}
"""Options of commands that name a file to write: another document may have written it."""
NOT_RUN = {
    r"serve\b.*": "serves until it is stopped; the tests of the page serve",
    r".* --scheduler .*": "needs a cluster; tests/experiment/test_cluster.py has one",
    r"warm": "compiles for minutes; tests/cli/test_warm.py",
    r"cards new( my_sensor\.toml)?": "asks a person; tests/cli/test_cards_new_command.py has a terminal",
    r"record .*": "needs an X-Plane that runs; tests/cli/test_record_command.py has a stand-in",
    r"live \w+ \"?(serial|xplane):.*": "needs a sensor at a port, or an X-Plane that runs",
    r"live simulate .*": "sends in real time until the flight ends; tests/cli/test_live_command.py",
    r"--install-completion": "writes into the user's own shell",
}
"""Lines that are not run, and why."""
ADDED = {
    "run": ["--set", "trajectory.imu_rate=50"],
    "budget": ["--set", "trajectory.imu_rate=50"],
    "compare": ["--set", "trajectory.imu_rate=50"],
    "compare --seeds": ["--seeds", "2"],
    "ensemble": ["--set", "trajectory.imu_rate=50", "--seeds", "2"],
    "sweep": ["--set", "trajectory.imu_rate=50", "--seeds", "1"],
    "outage": ["--set", "trajectory.imu_rate=50", "--seeds", "3"],
    "live watch": ["--seconds", "1"],
    "live navigate": ["--seconds", "15"],
    "delete": ["--yes"],  # nobody is here to be asked
}
"""By a command, also with an option: what is added to lines whose output is not shown."""


def of_lab(document: Path) -> list[Line]:
    return [line for line in lines(document) if line.program == "ins-lab"]


def command_of(words: list[str]) -> tuple[Any, list[str], list[str]]:
    """Return the command of a line, its name, and its arguments."""
    command, name, rest = get_command(app), [], words[1:]
    while hasattr(command, "list_commands") and rest and rest[0] in command.list_commands(None):
        command, name, rest = command.get_command(None, rest[0]), [*name, rest[0]], rest[1:]
    return command, name, rest


def reason(line: Line) -> str:
    """Return why a line is not run; nothing if it is."""
    text = re.split(r"ins-lab\s+", line.text, maxsplit=1)[-1]
    return next((why for pattern, why in NOT_RUN.items() if re.fullmatch(pattern, text)), "")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the reader's folder, with a library of missions: the commands of all documents share it."""
    folder = tmp_path_factory.mktemp("reader")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INS_LAB_MISSIONS", str(folder / "library"))
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def done() -> set[str]:
    """Return the lines that were run: one that several documents show is run once."""
    return set()


@pytest.mark.proof
@pytest.mark.parametrize("document", [one for one in DOCUMENTS if of_lab(one)], ids=name_of)
def test_the_command_lines_of_a_document_run(document: Path, library: Path, done: set[str]) -> None:
    for line in of_lab(document):
        _, name, arguments = command_of(line.words)
        is_mention = not arguments and not line.in_block
        if line.text in done or is_mention or reason(line):
            continue
        done.add(line.text)
        prepare(line, " ".join(name), library)
        answer = run(line, " ".join(name))
        assert answer.exit_code == 0, f"{line.text}\n{answer.output}"
        if line.output:
            shown = [one for one in line.output.splitlines() if one.strip() not in {"", "…"}]
            assert plain(" ".join(shown)) in plain(answer.stdout), line.text


def prepare(line: Line, name: str, folder: Path) -> None:
    """Make the files that a line reads, and remove those that it writes."""
    make_files(line.text, folder)
    for option, word in itertools.pairwise(line.words):
        if option in WRITES.get(name, ()):
            if (folder / word).is_dir():
                shutil.rmtree(folder / word)
            for old in (folder / word, (folder / word).with_suffix(".key")):
                old.unlink(missing_ok=True)


def run(line: Line, name: str) -> Answer:
    """Return what the command line answers; a line whose output is shown is run as it stands."""
    keys = [] if line.output else [name, *(f"{name} {word}" for word in line.words)]
    added = [option for key in keys for option in ADDED.get(key, [])]
    return CliRunner().invoke(app, [*line.words[1:], *added])


def plain(text: str) -> str:
    """Return text without line breaks and indentation, its numbers as ``#``: their last digit may differ."""
    return re.sub(r"\d+(\.\d+)?", "#", " ".join(text.split()))


@pytest.mark.parametrize("document", [one for one in DOCUMENTS if of_lab(one)], ids=name_of)
def test_the_parser_accepts_the_command_lines_that_are_not_run(document: Path) -> None:
    for line in of_lab(document):
        if reason(line):
            command, name, arguments = command_of(line.words)
            known = {option for one in command.params for option in one.opts + one.secondary_opts}
            if name:
                command.make_context(" ".join(name), list(arguments))
            else:
                assert set(arguments) <= known, line.text


def test_each_exception_and_each_file_is_needed() -> None:
    found = [line for document in DOCUMENTS for line in of_lab(document)]
    texts = [re.split(r"ins-lab\s+", line.text, maxsplit=1)[-1] for line in found]
    for pattern in NOT_RUN:
        assert any(re.fullmatch(pattern, text) for text in texts), pattern
    words = {word.partition(":")[0] for line in found for word in line.words}
    assert set(FILES) <= words
