"""Damaged head: why a file is recognised by no reader although its rest is of a known format."""

from __future__ import annotations

from pathlib import Path

from lab.readers.dataflash_file import MARKS
from lab.readers.sheet import as_utf8
from lab.readers.ulog_file import SYNC

_GZIP = b"\x1f\x8b"
_MESSAGE_BYTES = 1024
"""Bytes for each mark of a message from which a file consists of such messages: they have 50 on average, and
random bytes have the mark once in 65,536."""
_MIN_MESSAGES = 8
"""Fewest of them."""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_ULOG = ".ulg"
_MISSING = (
    "but its beginning is missing, which describes {}: without that they cannot be decoded. Accepted is the "
    "file from its first byte."
)


def as_plain_text(head: bytes) -> bytes:
    """Return the head of a text in UTF-16 as UTF-8; empty for any other one."""
    looks_so = head.startswith(_UTF_16) or head[1:4000:2].count(0) * 2 > len(head[1:4000:2])
    return as_utf8(head[: len(head) // 2 * 2]) if looks_so else b""


def what_is_damaged(path: Path, head: bytes) -> str:
    """Return a sentence on what is wrong with the beginning of a file; empty if nothing is known.

    Parameters
    ----------
    path
        The file, for the ending of its name.
    head
        Its first bytes, decompressed.
    """
    if head.startswith(_GZIP):
        return "It was compressed twice with gzip: decompress it once."
    if head.count(MARKS) >= max(_MIN_MESSAGES, len(head) // _MESSAGE_BYTES):
        return f"It consists of messages of an ArduPilot or PX4 log, {_MISSING.format('their fields (FMT)')}"
    if SYNC in head or path.suffix.lower() == _ULOG:
        return f"It looks like a ULog of PX4, {_MISSING.format('the fields of its messages')}"
    return ""
