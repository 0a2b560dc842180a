"""Decompression: the bytes of a file, decompressed if it is a gzip file, in pieces and up to a limit."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.base.files.text_blocks import check_file, decompressed_limit, too_large


def content(path: Path, limit: int, piece: int = 2**20) -> Iterator[bytes]:
    """Iterate over the bytes of a file.

    Parameters
    ----------
    path
        The file. Its first bytes say whether it is compressed, not its name.
    limit
        Most bytes accepted, stored as well as decompressed.
    piece
        Most bytes at a time.

    Raises
    ------
    MissionError
        If the file cannot be read, is not an ordinary file or is too large, or if it starts like a gzip
        file but is incomplete or grows too much.
    """
    try:
        check_file(path, limit)
        with path.open("rb") as file:
            compressed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            most = decompressed_limit(path, limit) if compressed else limit
            stream = gzip.GzipFile(fileobj=file) if compressed else file
            size = 0
            while data := stream.read(piece):
                size += len(data)
                if size > most:
                    raise too_large(path, most, limit)
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
