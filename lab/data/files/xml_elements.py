"""XML elements: an XML file parsed safely as a stream.

A document type is refused, since it could declare entities that grow without bound or name other files,
and so is deep nesting. Namespaces are left out of the names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol
from xml.parsers import expat

from lab.base.files.file_content import content
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES

MAX_DEPTH = 100
"""Deepest nesting of elements accepted; recordings have about ten levels."""

_MAX_TEXT = 256
"""Characters kept of an element's text; the texts that are read are shorter."""
_PIECE = 2**18
"""Bytes parsed at a time."""
_HEAD = 4096
"""Bytes at the start of a file in which its first element stands."""


class Handler(Protocol):
    """The receiver of the elements."""

    def begin(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """Take the start of an element and the number of its line."""

    def end(self, name: str, text: str) -> None:
        """Take the end of an element, with its text if it has no other elements in it."""


def has_root(head: bytes, root: str) -> bool:
    """Return whether a file starts like XML and has an element early on, in any namespace.

    Parameters
    ----------
    head
        The first bytes of the file.
    root
        Name of the element.
    """
    plain = head[:_HEAD].replace(b"\0", b"")  # UTF-16 has a zero in every character
    return plain.lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n").startswith(b"<") and bool(
        re.search(rb"<(?:[A-Za-z]\w{0,30}:)?" + root.encode() + rb"[\s>]", plain)
    )


def read_elements(path: Path, reader: str, handler: Handler) -> str:
    """Read all elements of a file.

    Parameters
    ----------
    path
        The file, compressed or not.
    reader
        Name of the format, for messages.
    handler
        What they are given to.

    Returns
    -------
    str
        Where the file is broken and how; empty if it is whole. What comes before is read.

    Raises
    ------
    MissionError
        If the file cannot be read, is too large, declares a document type or is nested too deep.
    """
    elements = _Elements(path, reader, handler)
    for piece in content(path, MAX_BYTES, _PIECE):
        if not elements.feed(piece):
            break
    else:
        elements.feed(b"", last=True)
    return elements.broken


class _Elements:
    """The parser, and the element it is in."""

    def __init__(self, path: Path, reader: str, handler: Handler) -> None:
        self.broken = ""
        self._path, self._reader, self._handler = path, reader, handler
        self._depth = 0
        self._leaf, self._text = False, ""
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters

    def feed(self, piece: bytes, *, last: bool = False) -> bool:
        """Take a piece of the file; return whether more is wanted."""
        try:
            self._parser.Parse(piece, last)
        except (expat.ExpatError, ValueError, LookupError) as error:
            if isinstance(error, MissionError):
                raise
            self.broken = f"row {self._parser.ErrorLineNumber}: {error}"
        return not self.broken

    def _doctype(self, *_: object) -> None:
        raise MissionError(
            f"{self._path}, row {self._parser.CurrentLineNumber}: a document type is declared, in which "
            f"entities could be hidden; accepted is {self._reader} without one"
        )

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        line = self._parser.CurrentLineNumber
        if self._depth > MAX_DEPTH:
            raise MissionError(
                f"{self._path}, row {line}: elements are nested {self._depth} deep; accepted are {MAX_DEPTH} "
                "levels"
            )
        self._leaf, self._text = True, ""
        self._handler.begin(name.rpartition(":")[2], attributes, line)

    def _characters(self, text: str) -> None:
        if self._leaf and len(self._text) < _MAX_TEXT:
            self._text += text[:_MAX_TEXT]

    def _end(self, name: str) -> None:
        self._depth -= 1
        self._handler.end(name.rpartition(":")[2], self._text if self._leaf else "")
        self._leaf, self._text = False, ""
