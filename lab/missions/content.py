"""Content: the bytes of a file, decompressed if it is a gzip file, in pieces and up to a limit."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

from lab.missions.errors import MissionError
from lab.missions.text_blocks import check_file

MAX_RATIO = 100
"""How many times its stored size a file may grow when decompressed; logs of numbers grow at most 20 times."""

_ALWAYS_ACCEPTED = 2**20


def content(path: Path, limit: int, piece: int = 2**20) -> Iterator[bytes]:
    """Iterate over the bytes of a file.

    Parameters
    ----------
    path
        The file; that it is compressed is known by its first bytes, not by its name.
    limit
        Most bytes accepted, stored as well as decompressed.
    piece
        Most bytes at a time.

    Raises
    ------
    MissionError
        If it cannot be read, is no ordinary file, is too large, or is no complete gzip file though it starts
        like one, or one that grows beyond all measure.
    """
    try:
        check_file(path, limit)
        with path.open("rb") as file:
            compressed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            most = limit
            if compressed:
                most = min(limit, max(MAX_RATIO * path.stat().st_size, _ALWAYS_ACCEPTED))
            stream = gzip.GzipFile(fileobj=file) if compressed else file
            size = 0
            while data := stream.read(piece):
                size += len(data)
                if size > most:
                    raise MissionError(_too_large(path, limit, most))
                yield data
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise MissionError(f"{path}: is not a complete gzip file ({error})") from error
    except (OSError, ValueError) as error:
        if isinstance(error, MissionError):
            raise
        raise MissionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def whole(path: Path, limit: int) -> bytes:
    """Return all bytes of a file; see `content`."""
    return b"".join(content(path, limit))


def _too_large(path: Path, limit: int, most: int) -> str:
    if most < limit:
        return (
            f"{path}: grows more than {MAX_RATIO} times when decompressed; accepted are logs, which grow at "
            "most 20 times"
        )
    return f"{path}: accepted are files up to {limit / 2**20:.0f} MB when decompressed"
