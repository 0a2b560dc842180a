"""Content: the bytes of a file, decompressed if it is a gzip file, in pieces and up to a limit."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

from lab.recordings.mission_error import MissionError
from lab.recordings.text_blocks import check_file, decompressed_limit, too_large


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
