"""Blocks of code in the documents: Python runs, TOML is read by its loader, other programs exist as named.

A new document is found by itself. A language, a key of TOML or a program that is new needs an entry here.
"""

from __future__ import annotations

import importlib.util
import itertools
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from document_code import DOCUMENTS, PROGRAMS, ROOT, Line, blocks, lines, name_of
from document_files import make_files

from lab.classroom.homework.homework_file import make_homework
from lab.classroom.lessons.lesson_file import make_lesson
from lab.data.files.profile import read_profile
from lab.data.log.calibration import Calibration, read_calibration
from lab.experiment.experiment import Experiment
from lab.flying.flight_plan import read_plan
from lab.missions import mission
from lab.sensors.cards import read_cards

NOT_RUN = {
    (
        "docs/live.md",
        "serial:/dev/ttyUSB0",
    ): "a person turns a sensor; tests/live/bench/test_axis_check.py",
    (
        "docs/live.md",
        "xplane:127.0.0.1",
    ): "X-Plane flies for a minute; tests/live/xplane/test_xplane_flight.py",
    (
        "docs/live.md",
        "tcp:192.168.1.20:5555",
    ): "a device sends until it is off; tests/data/streams/test_source.py",
    ("docs/cluster.md", "SSHCluster("): "needs computers that are reached by SSH",
    ("docs/live.md", "drive.inslab"): "compares the recording of that device; tests/live/test_twin.py",
}
"""Python that is not run, by document and a part of its text, and why; its imports are made."""
SHOWN = {
    "text": "a diagram",
    "nginx": "a proxy; tests/browser/test_class_restart.py runs it",
    "ini": "a service of systemd, which systemd-analyze verifies",
    "json": "a row of the live solution; tests/live/outlets/test_documented_lines.py compares it",
    "shell": "see tests/cli/test_document_commands.py",
    "{toctree}": "by Sphinx",
    "{ledger}": "by Sphinx",
    "{scoreboard}": "by Sphinx",
}
"""Blocks of other languages, and what they are."""
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
MARKERS = {"browser", "benchmark", "proof"}


def with_blocks(language: str) -> list[Path]:
    return [one for one in DOCUMENTS if any(block.language == language for block in blocks(one))]


def is_run(document: Path, text: str) -> bool:
    return not any(name == name_of(document) and part in text for name, part in NOT_RUN)


@pytest.mark.proof
@pytest.mark.parametrize("document", with_blocks("python"), ids=name_of)
def test_python_runs(document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path / "library"))
    (waypoints,) = (
        text for text, tables in toml_of(ROOT / "missions/README.md") if "[[flight.waypoints]]" in text
    )
    (tmp_path / "my_plan.toml").write_text(waypoints, "utf-8")
    names: dict[str, Any] = {}
    for block in blocks(document):
        if block.language == "python":
            code = compile(block.text, f"{name_of(document)}:{block.line}", "exec")
            if is_run(document, block.text):
                make_files(" ".join(re.findall(r'"([\w.]+)[":]', block.text)), tmp_path)
                exec(code, names)
            else:
                exec("\n".join(re.findall(r"^(?:import|from) .*", block.text, re.M)), {})
    if "ensemble" in names:
        assert len(names["ensemble"].seeds) == 20
    if "rows" in names:
        assert names["rows"][-1].model == "last fix"
    if "result" in names:
        assert len(names["result"].summary) >= 9


def toml_of(document: Path) -> list[tuple[str, dict[str, Any]]]:
    """Return the TOML blocks of a document, as text and as tables."""
    return [(block.text, tomllib.loads(block.text)) for block in blocks(document) if block.language == "toml"]


def read_flight(text: str, tables: dict[str, Any], folder: Path) -> None:
    """Read a plan; one that only replaces the start of the document's first plan is read with that plan."""
    flight = tables["flight"]
    if set(flight) == {"air_start"}:
        whole = toml_of(ROOT / "missions/README.md")[1][1]["flight"]
        flight = {key: value for key, value in whole.items() if key != "runway"} | flight
        flight["manoeuvres"] = flight["manoeuvres"][-1:]  # from the air, nobody takes off and climbs to 250 m
    read_plan(flight)


def read_mission(text: str, tables: dict[str, Any], folder: Path) -> None:
    """Read the file of a mission, beside a recording of the name that it states."""
    (folder / tables["recording"]).write_bytes(mission("montreal").recording_path.read_bytes())
    (folder / "mine.toml").write_text(text, "utf-8")
    read = mission(str(folder / "mine.toml"))
    assert (read.title, read.aircraft) == (tables["title"], tables["aircraft"])
    assert read.recording.duration > 200


def read_card(text: str, tables: dict[str, Any], folder: Path) -> None:
    (folder / "card.toml").write_text(text, "utf-8")
    (card,) = read_cards(folder / "card.toml").values()
    card.load(Experiment())


def read_own_homework(text: str, tables: dict[str, Any], folder: Path) -> None:
    """Make a homework of what its teacher wrote."""
    (folder / "mine.toml").write_text(text, "utf-8")
    make_homework(folder / "mine.toml")


def read_own_profile(text: str, tables: dict[str, Any], folder: Path) -> None:
    (folder / "mine.toml").write_text(text, "utf-8")
    assert read_profile(folder / "mine.toml").name == tables["name"]


def read_own_calibration(text: str, tables: dict[str, Any], folder: Path) -> Calibration:
    (folder / "sensor.toml").write_text(text, "utf-8")
    return read_calibration(folder / "sensor.toml")


LOADERS: dict[str, Callable[[str, dict[str, Any], Path], Any]] = {
    "hidden": read_own_homework,
    "step": lambda text, tables, folder: make_lesson("mine", tables),
    "flight": read_flight,
    "recording": read_mission,
    "sensors": lambda text, tables, folder: Experiment.from_toml(text),
    "Mine": read_card,
    "needs": read_own_profile,
    "gyro": read_own_calibration,
}
"""By a key at the top of a block: what reads it. The first that is found counts."""


@pytest.mark.parametrize("document", with_blocks("toml"), ids=name_of)
def test_toml_is_read_by_its_loader(document: Path, tmp_path: Path) -> None:
    for text, tables in toml_of(document):
        key = next((key for key in LOADERS if key in tables), None)
        assert key, f"{name_of(document)}: no loader is known for {', '.join(tables)}"
        LOADERS[key](text, tables, tmp_path)


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_each_block_has_a_language_that_is_tested(document: Path) -> None:
    for block in blocks(document):
        assert block.language in {"python", "toml", *SHOWN}, f"{name_of(document)}:{block.line}"


def make_has_the_target(words: list[str]) -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    target, *variables = words[1:]
    assert re.search(rf"^{target}:", makefile, re.M)
    for variable in variables:
        assert re.search(rf"^{variable.partition('=')[0]} \?=", makefile, re.M)


def extras_exist(words: list[str]) -> None:
    if "uninstall" in words:
        return
    named = re.findall(r"\[([\w,]+)\]", " ".join(words))
    assert named
    assert {one for part in named for one in part.split(",")} <= set(EXTRAS)


def paths_exist(words: list[str]) -> None:
    for word in words[1:]:
        if "/" in word:
            assert (ROOT / word).exists(), word
    for expression in (after for word, after in itertools.pairwise(words) if word == "-m"):
        assert set(expression.split()) <= {"not", "and", "or", *MARKERS}


def module_exists(words: list[str]) -> None:
    if words[2] == "pip":
        extras_exist(words)
    elif words[2] != "venv":
        assert importlib.util.find_spec(words[2]), words[2]


def files_exist(words: list[str]) -> None:
    for word in words[2:]:
        copied = Path(word)  # by `ins-lab notebooks copy my_notebooks`
        of_a_copy = copied.parts[0] == "my_notebooks" and copied.suffix == ".ipynb"
        assert (ROOT / (f"notebooks/{copied.stem}.py" if of_a_copy else word)).is_file(), word


def docker_files_exist(words: list[str]) -> None:
    for option, value in itertools.pairwise(words):
        if option == "--file":
            assert (ROOT / value).is_file(), value


def dask_has_the_options(words: list[str]) -> None:
    command = importlib.import_module(f"distributed.cli.dask_{words[1]}").main
    command.make_context(words[1], words[2:])


OTHER_PROGRAMS: dict[str, tuple[str, Callable[[list[str]], None]]] = {
    "make": ("installs, serves, or runs all tests for minutes", make_has_the_target),
    "pip": ("needs the network", extras_exist),
    "pytest": ("runs tests, which run here anyway", paths_exist),
    "python": ("installs, makes an environment, or measures for minutes", module_exists),
    "python3": ("makes an environment", module_exists),
    "py": ("makes an environment on Windows", module_exists),
    "panel": ("serves until it is stopped; tests/test_notebooks.py serves them", files_exist),
    "dask": (
        "serves until it is stopped; tests/experiment/test_cluster.py starts both",
        dask_has_the_options,
    ),
    "docker": ("builds and serves images", docker_files_exist),
    "jupyter": ("serves until it is stopped; tests/test_notebooks.py runs the notebooks", lambda words: None),
}
"""Programs that no test runs from a document: why not, and what is checked of their words."""


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_other_programs_are_named_as_they_are(document: Path) -> None:
    for line in lines(document):
        if line.program != "ins-lab":
            assert line.program in OTHER_PROGRAMS, f"{name_of(document)}: no test runs {line.text!r}"
            OTHER_PROGRAMS[line.program][1](line.words)


def test_each_exception_is_needed() -> None:
    assert set(OTHER_PROGRAMS) == set(PROGRAMS) - {"ins-lab"}
    found: list[Line] = [line for document in DOCUMENTS for line in lines(document)]
    assert set(OTHER_PROGRAMS) <= {line.program for line in found}
    for name, part in NOT_RUN:
        assert sum(part in block.text for block in blocks(ROOT / name)) >= 1, part


def test_the_first_example_is_ten_lines_long() -> None:
    (example,) = (block.text for block in blocks(ROOT / "README.md") if block.language == "python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 10
