"""Damaged head: why a file is recognised by no reader although its rest is of a known format."""

from __future__ import annotations

import re
from pathlib import Path

from lab.data.files.dataflash_file import MARKS
from lab.data.files.ulog_file import SYNC
from lab.data.sheets.sheet_layout import as_utf8

_GZIP = b"\x1f\x8b"
_MESSAGE_BYTES = 1024
"""Bytes for each mark of a message from which a file consists of such messages: they have 50 on average, and
random bytes have the mark once in 65,536."""
_MIN_MESSAGES = 8
"""Fewest of them."""
_LINE_ENDS = 16
"""Fewest line feeds in a binary file, all after a carriage return, from which it was copied as text: one of
random bytes follows one by chance in 256."""
_REPLACED = 1000
"""Bytes for each U+FFFD from which a file was decoded as UTF-8: random bytes have one in 17 million."""
_BINARY = 0.01
"""Least share of bytes beyond ASCII in a binary file; texts that a logger filled up with zeros have fewer."""
_LONE_LINE_FEED = re.compile(rb"(?<!\r)\n")
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_ASCII = bytes(range(128))
"""All bytes of ASCII."""
_ULOG = ".ulg"
_MISSING = (
    "but its beginning is missing, which describes {}: without that they cannot be decoded. Accepted is the "
    "file from its first byte."
)


def as_plain_text(head: bytes) -> bytes:
    """Return the head of a text in UTF-16 as UTF-8; empty for any other one."""
    looks_so = head.startswith(_UTF_16) or head[1:4000:2].count(0) * 2 > len(head[1:4000:2])
    return as_utf8(head[: len(head) // 2 * 2]) if looks_so else b""


def copied_as_text(head: bytes) -> str:
    """Return a sentence on a binary file that was copied as text; empty if nothing shows it.

    Parameters
    ----------
    head
        Its first bytes, decompressed.
    """
    if b"\0" not in head:
        return ""
    is_decoded = head.count("\ufffd".encode()) * _REPLACED > len(head)
    has_returns = head.count(b"\n") >= _LINE_ENDS and not _LONE_LINE_FEED.search(head)
    if not (is_decoded or has_returns) or len(head.translate(None, _ASCII)) < _BINARY * len(head):
        return ""
    if is_decoded:
        return "Its bytes were decoded as text and are lost: copy it as a binary file."
    return (
        "It was copied as text: each line feed has got a carriage return before it. Copy it as a binary file "
        "(with ftp: the command binary)."
    )


def what_is_damaged(path: Path, head: bytes) -> str:
    """Return a sentence on what is wrong with the beginning of a file; empty if nothing is known.

    Parameters
    ----------
    path
        The file, for the ending of its name.
    head
        Its first bytes, decompressed.
    """
    if said := copied_as_text(head):
        return said
    if head.startswith(_GZIP):
        return "It was compressed twice with gzip: decompress it once."
    if head.count(MARKS) >= max(_MIN_MESSAGES, len(head) // _MESSAGE_BYTES):
        return f"It consists of messages of an ArduPilot or PX4 log, {_MISSING.format('their fields (FMT)')}"
    if SYNC in head or path.suffix.lower() == _ULOG:
        return f"It looks like a ULog of PX4, {_MISSING.format('the fields of its messages')}"
    return ""
