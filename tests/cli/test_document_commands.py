"""Every command line of ``ins-lab`` that a document shows is run, cheaply, and does not fail.

A line that names a file of the reader's gets one from `FILES`. A line that no test can run is in `NOT_RUN`,
with the reason; the parser of the command line accepts it all the same.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import Answer
from copter_logs import copter
from document_code import DOCUMENTS, ROOT, Line, blocks, lines, name_of
from sensor_logs import EPOCH, IMU, Tables, tables, write, write_csv
from typer.main import get_command
from typer.testing import CliRunner
from writers import WRITERS
from xplane_simulator import montreal

from dashboards.command_line import app
from lab.homework.homework_file import homework_text, make_homework
from lab.missions import add_mission

WRITES = {
    "run": {"--out", "--export"},
    "export": {"--to"},
    "identify": {"--card", "--settings"},
    "allan": {"--card"},
    "homework hand-in": {"--out"},
    "homework make": {"--out"},
    "grade": {"--out"},
}
"""Options of commands that name a file to write: another document may have written it."""
NOT_RUN = {
    r"serve\b.*": "serves until it is stopped; the tests of the page serve",
    r"warm": "compiles for minutes; tests/cli/test_warm.py",
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
    "live watch": ["--seconds", "1"],
    "delete": ["--yes"],  # nobody is here to be asked
}
"""By a command, also with an option: what is added to lines whose output is not shown."""


def toml_of(document: str, number: int) -> str:
    """Return the text of a TOML block of a document."""
    found = [block.text for block in blocks(ROOT / document) if block.language == "toml"]
    return found[number]


def written(path: Path, content: str | bytes) -> None:
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def drive(path: Path) -> None:
    """Write a log at 25 Hz, with a clock that begins at 20 s."""
    imu, gnss, reference = tables(20, 110)
    for table in (imu, gnss, reference):
        table[:, 0] -= EPOCH
    write(path, Tables(imu[::4], gnss, reference))


def at_rest(path: Path) -> None:
    """Write five minutes of an IMU at rest."""
    rng = np.random.default_rng(1)
    rows = rng.normal(scale=[1e-3] * 3 + [1e-2] * 3, size=(30_000, 6)) - [0, 0, 0, 0, 0, 9.8]
    write_csv(path, IMU, np.column_stack((np.arange(30_000) / 100, rows)))


def algorithm(path: Path) -> None:
    """Write the algorithm of the document under the name that its command lines have."""
    (block,) = (block for block in blocks(ROOT / "docs/algorithms.md") if block.language == "python")
    written(path, block.text.partition("\n\n\nresult")[0].replace("LastFix", "MyFilter"))


def homework(path: Path) -> None:
    """Write the homework of the document for a student, who has not its key."""
    source = path.with_suffix(".toml")
    FILES[source.name](source)
    written(path, homework_text(make_homework(source)))


MOTION = """ini lat (deg),ini lon (deg),ini alt (m),ini vx_body (m/s),ini vy_body (m/s),ini vz_body (m/s),\
ini yaw (deg),ini pitch (deg),ini roll (deg)
32,120,0,10,0,0,90,0,0
command type,yaw (deg),pitch (deg),roll (deg),vx_body (m/s),vy_body (m/s),vz_body (m/s),command duration (s),\
GPS visibility
1,-15,0,0,0,0,0,6,1
5,0,0,0,20,0,0,30,1
"""
FILES: dict[str, Callable[[Path], Any]] = {
    "Data.txt": lambda path: written(path, WRITERS["X-Plane Data.txt"](montreal(60))),
    "Data.csv": lambda path: written(path, WRITERS["MSFS/FSX fsLogger csv"](montreal(60))),
    "flight.ulg": lambda path: written(path, WRITERS["PX4 ULog"](montreal(60))),
    "my_flight.csv": lambda path: written(path, WRITERS["INS Lab flight csv"](montreal(60))),
    "my_drive": drive,
    "drive": drive,
    "my_copter": lambda path: write(path, copter()),
    "imu.csv": at_rest,
    "settings.toml": lambda path: written(path, toml_of("docs/settings.md", 0)),
    "eight.toml": lambda path: written(path, toml_of("docs/flying.md", 0)),
    "my_plan.toml": lambda path: written(path, toml_of("missions/README.md", 3)),
    "motion_def.csv": lambda path: written(path, MOTION),
    "my_filter.py": algorithm,
    "receiver.toml": lambda path: written(path, toml_of("docs/homework.md", 0)),
    "receiver.homework": homework,
    "handed_in": lambda path: (path.mkdir(), written(path / "other.handin", "of another homework")),
    "my_lesson.toml": lambda path: written(path, toml_of("docs/lessons.md", 0)),
    "my_lessons": lambda path: (path.mkdir(), written(path / "mine.toml", toml_of("docs/lessons.md", 0))),
    "mine": lambda path: add_mission(montreal(60), path.name, title="Mine"),
}
"""What makes the reader's files, folders and missions, by their name in the documents."""


def of_lab(document: Path) -> list[Line]:
    return [line for line in lines(document) if line.program == "ins-lab"]


def command_of(words: list[str]) -> tuple[Any, list[str], list[str]]:
    """Return the command of a line, its name, and its arguments."""
    command, name, rest = get_command(app), [], words[1:]
    while hasattr(command, "commands") and rest and rest[0] in command.commands:
        command, name, rest = command.commands[rest[0]], [*name, rest[0]], rest[1:]
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
    for word in line.words:
        made = folder / word.partition(":")[0]
        if made.name in FILES and not made.exists():
            FILES[made.name](made)
    for option, word in itertools.pairwise(line.words):
        if option in WRITES.get(name, ()):
            (folder / word).unlink(missing_ok=True)


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
