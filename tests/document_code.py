"""Code in the documents: blocks by their language, and command lines, as a Markdown parser finds them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt

ROOT = Path(__file__).parent.parent
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "missions/README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/theory").glob("*.md")),
    *sorted((ROOT / "docs/site").glob("*.md")),
]
PROGRAMS = (
    *("ins-lab", "make", "pip", "pytest", "python", "python3", "py"),
    *("jupyter", "panel", "dask", "docker"),
)
"""What a command line in the text begins with; beside a block of the shell, nothing else is run."""
_PLACEHOLDER = re.compile(r"\b[A-Z]{3,}\b(?!=)|…")
"""What stands for a name that a reader chooses, as in ``ins-lab record NAME``."""


class Block(NamedTuple):
    """A block of code: its language (``shell`` if it is indented), its first line, and its text."""

    language: str
    line: int
    text: str


class Line(NamedTuple):
    """A command line: words, text, whether it is in a block, and the output that is shown below it."""

    words: list[str]
    text: str
    in_block: bool
    output: str = ""

    @property
    def program(self) -> str:
        """Return the name of the program without the folder of an environment."""
        return re.split(r"[/\\]", self.words[0])[-1]


def name_of(document: Path) -> str:
    """Return the name of a document, as tests are called."""
    return document.relative_to(ROOT).as_posix()


def blocks(document: Path) -> list[Block]:
    """Return all blocks of code of a document."""
    return [
        Block(token.info if token.type == "fence" else "shell", (token.map or [0])[0] + 1, token.content)
        for token in MarkdownIt().parse(document.read_text("utf-8"))
        if token.type in {"fence", "code_block"}
    ]


def lines(document: Path) -> list[Line]:
    """Return all command lines of a document: those of its blocks, then those in its sentences, each once."""
    found: dict[str, Line] = {}
    for block in blocks(document):
        if block.language == "shell":
            found.update((line.text, line) for line in _in_block(block.text))
    for text in _in_sentences(document):
        program = re.split(r"[/\\]", text.partition(" ")[0])[-1]
        if program in PROGRAMS and " " in text and not _PLACEHOLDER.search(text):
            found.setdefault(text, Line(_words(text), text, in_block=False))
    return list(found.values())


def _in_block(text: str) -> Iterator[Line]:
    """Iterate over the lines of a block. If any begins with ``$``, all others are output."""
    if not re.search(r"^\$ ", text, re.M):
        for line in text.splitlines():
            if line.strip():
                yield Line(_words(line), _without_comment(line), in_block=True)
        return
    for part in re.split(r"^\$ ", text, flags=re.M)[1:]:
        line, _, output = part.partition("\n")
        yield Line(_words(line), _without_comment(line), in_block=True, output=output)


def _in_sentences(document: Path) -> Iterator[str]:
    for token in MarkdownIt().enable("table").parse(document.read_text("utf-8")):
        for child in token.children or ():
            if child.type == "code_inline":
                yield child.content


def _without_comment(text: str) -> str:
    return re.sub(r"\s+#.*", "", text).strip()


def _words(text: str) -> list[str]:
    """Return the words of a command line; on Windows, a backslash is part of a path."""
    windows = "\\" in text
    words = shlex.split(text, comments=True, posix=not windows)
    return [word.strip("'\"") for word in words] if windows else words
