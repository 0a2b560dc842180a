"""The documents: links, files, commands, options and settings named in them exist."""

from __future__ import annotations

import itertools
import re
import shlex
from pathlib import Path

import pytest
from document_code import DOCUMENTS, ROOT, name_of
from typer.main import get_command

from dashboards.command_line import COMMANDS, app
from lab.base.aid_table import AIDS
from lab.data.rebuild.import_settings import ImportSettings
from lab.experiment.experiment import Experiment

LINK = re.compile(r"\]\(([^)]+)\)")
PLACE = re.compile(r"(?<![\w./-])(?:lab|tests|dashboards|notebooks|missions|docs|\.ci)/[\w./*-]*\w")
PLACEHOLDER = "NAME"
"""What stands in the recipes for a name that a reader chooses."""
README_LINES = 200
"""The README is the first five minutes; all else has a page of its own in docs."""
PICTURES = sorted((ROOT / "docs").rglob("*.png"))
PICTURE_BYTES = 150_000
"""A README with four such pictures loads in some seconds on a slow line."""

every_document = pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)


def text_of(document: Path) -> str:
    return document.read_text(encoding="utf-8")


def prose(document: Path) -> str:
    """Return the text of a document without its blocks of code."""
    return re.sub(r"^```.*?^```", "", text_of(document), flags=re.DOTALL | re.MULTILINE)


def anchors(document: Path) -> set[str]:
    """Return what a link may have after #: the headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.+)$", prose(document), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def commands(document: Path) -> list[list[str]]:
    """Return the commands of the laboratory that a document shows, as lists of words."""
    text = text_of(document)
    lines = re.findall(r"^ {4}(?:\$ )?(ins-lab .+)$", text, re.MULTILINE)
    lines += re.findall(r"`(ins-lab [^`]+)`", text)
    return [shlex.split(line, comments=True) for line in lines]


def test_the_readme_is_short() -> None:
    assert len(text_of(ROOT / "README.md").splitlines()) < README_LINES


@every_document
def test_every_link_leads_somewhere(document: Path) -> None:
    for link in LINK.findall(text_of(document)):
        if link.startswith(("https://", "http://")):
            continue
        path, _, anchor = link.partition("#")
        target = document.parent / path if path else document
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@every_document
def test_every_file_that_is_named_exists(document: Path) -> None:
    for place in PLACE.findall(text_of(document)):
        if PLACEHOLDER not in place:
            assert any(ROOT.glob(place)), place


@every_document
def test_every_command_and_option_exists(document: Path) -> None:
    group = get_command(app)
    known = {name: group.get_command(None, name) for name in COMMANDS}  # type: ignore[attr-defined]
    for words in commands(document):
        if words[1].startswith("-"):
            continue
        assert words[1] in known, " ".join(words)
        command = known[words[1]]
        if hasattr(command, "commands"):
            default = getattr(command, "default", "")  # of a group that takes more than names of commands
            name = default if len(words) < 3 or words[2] not in command.commands else words[2]
            assert name, " ".join(words)
            command = command.commands[name]
        accepted = {name for one in command.params for name in one.opts + one.secondary_opts}
        accepted.add("--help")
        assert {word for word in words if re.match(r"--?[a-z]", word)} <= accepted, " ".join(words)


@every_document
def test_every_setting_exists(document: Path) -> None:
    experiment, importing = Experiment(), ImportSettings()
    for path in re.findall(r"`((?:sensors|navigator|trajectory)\.[a-z0-9_.]+)`", text_of(document)):
        experiment.get(path)
    pairs = [pair for words in commands(document) for pair in itertools.pairwise(words)]
    pairs += re.findall(r'`(--set) "?([^"`]+?)"?`', text_of(document))
    for option, assignment in pairs:
        if option == "--set" and "…" not in assignment:
            of_experiment = assignment.partition("=")[0].count(".")
            (experiment if of_experiment else importing).set_texts([assignment.replace('"', "")])


def test_every_other_sensor_is_in_the_tables_of_its_kind() -> None:
    """What it measures, its file in a log, and what a stream has of it."""
    filters, logs, live = (
        (ROOT / f"docs/{name}.md").read_text("utf-8") for name in ("filters", "logs", "live")
    )
    for aid in AIDS:
        setting = f"`sensors.{aid.name}.fitted`"
        assert re.search(rf"^\| {setting} \|", filters, re.M), aid.name
        assert re.search(rf"^\| `{aid.file}` \| `t_s,{aid.column.name}`", logs, re.M), aid.name
        assert not aid.live or re.search(rf"^\|.*{setting}", live, re.M), aid.name


def test_every_command_is_in_the_list_of_commands() -> None:
    shown = {words[1] for words in commands(ROOT / "docs/command-line.md")}
    assert set(COMMANDS) <= shown


def test_the_index_names_every_page_and_every_page_has_one_subject() -> None:
    index = set(LINK.findall(text_of(ROOT / "docs/README.md")))
    for document in (*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/theory").glob("*.md")):
        name = document.relative_to(ROOT / "docs").as_posix()
        assert name == "README.md" or name in index
        assert len(re.findall(r"^# ", prose(document), re.MULTILINE)) == 1, document.name


@every_document
def test_every_picture_is_there_in_light_and_dark(document: Path) -> None:
    for shown in re.findall(r"<picture>.*?</picture>", text_of(document), re.DOTALL):
        light, dark = re.findall(r"src=\"(.+?)\"", shown) + re.findall(r"srcset=\"(.+?)\"", shown)
        assert dark == light.replace("-light.png", "-dark.png")
        assert (document.parent / light).is_file(), light
        assert (document.parent / dark).is_file(), dark
        assert re.search(r'alt="[^"]{20,}"', shown), light


@pytest.mark.parametrize("picture", PICTURES, ids=lambda path: path.name)
def test_pictures_are_shown_and_small(picture: Path) -> None:
    assert picture.stat().st_size <= PICTURE_BYTES
    assert any(f'{picture.name}"' in text_of(document) for document in DOCUMENTS)
