"""File content: the bytes of a file, compressed or not, in pieces or blocks of lines, up to a limit."""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from lab.base.files.mission_error import MissionError

_BLOCK = 2**21
"""Bytes read at a time: large compared with a line, small compared with a file."""
ZIP = b"PK\x03\x04"
"""First bytes of a zip file."""
MAX_RATIO = 100
"""How many times its stored size a file may grow when decompressed; logs of numbers grow at most 20 times."""

_MIN_DECOMPRESSED_LIMIT = 2**20
"""Size up to which a small file may grow, whatever its ratio [bytes]: a few equal rows compress well."""
_LONGEST_LINE = 2**20
"""Longest line accepted [bytes]: 10 000 columns of 100 characters."""


def check_file(path: Path, limit: int) -> None:
    """Refuse anything but an ordinary file of at most `limit` bytes.

    Raises
    ------
    MissionError
        With the bytes found instead.
    """
    if path.is_dir():
        raise MissionError(f"{path}: is a folder; accepted is a file")
    if not path.exists():
        raise MissionError(f"{path}: there is no such file")
    # A pipe or a device could keep a reader waiting for ever.
    if not path.is_file():
        raise MissionError(f"{path}: is not an ordinary file")
    size = path.stat().st_size
    if size > limit:
        raise MissionError(f"{path}: {size / 2**20:.0f} MB; accepted are files up to {_megabytes(limit)}")


def decompressed_limit(size: int, limit: int) -> int:
    """Return the largest decompressed size accepted of a stored `size`, at most `limit` [bytes]."""
    return min(limit, max(MAX_RATIO * size, _MIN_DECOMPRESSED_LIMIT))


def too_large(path: Path, accepted: int, limit: int) -> MissionError:
    """Return the error for a file that decompresses to more than is accepted."""
    if accepted < limit:
        return MissionError(
            f"{path}: grows more than {MAX_RATIO} times when decompressed; accepted are logs, which grow at "
            "most 20 times"
        )
    return MissionError(f"{path}: accepted are files up to {_megabytes(limit)} when decompressed")


def _megabytes(size: int) -> str:
    return f"{size / 2**20:.0f} MB"


class TextBlocks:
    """An open text file in UTF-8, decompressed if it is a gzip file; a context manager.

    Every error, of the file system, of the compression or of the text, leaves the ``with`` block as a
    `MissionError` that names the file.

    Parameters
    ----------
    path : Path
        The file.
    limit : int
        Most bytes accepted, stored as well as decompressed.
    strict : bool
        False replaces bytes that are not UTF-8 by replacement characters, instead of refusing them.

    Attributes
    ----------
    next_line : int
        Number of the line that is read next, counted from 1 as editors do; the caller of `blocks` advances
        it.
    """

    def __init__(self, path: Path, limit: int, *, strict: bool = True) -> None:
        self._path = path
        self._limit = limit
        self._strict = strict
        self._accepted = self._left = limit
        self._text = b""
        self._start = 0
        self._cut = b""
        self._file: BinaryIO | None = None
        self._stream: BinaryIO | gzip.GzipFile | None = None
        self.next_line = 1

    def __enter__(self) -> Self:
        try:
            check_file(self._path, self._limit)
            self._file = self._path.open("rb")
            compressed = self._file.read(2) == b"\x1f\x8b"
            self._file.seek(0)
        except (OSError, ValueError) as error:
            raise self._error(error) from error
        # A file named .gz that is not compressed is an error, and not another format.
        compressed = compressed or self._path.suffix.lower() == ".gz"
        self._stream = gzip.GzipFile(fileobj=self._file) if compressed else self._file
        if compressed:
            self._accepted = self._left = decompressed_limit(self._path.stat().st_size, self._limit)
        self._fill()
        self._text = self._text.removeprefix(b"\xef\xbb\xbf")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def lines(self) -> Iterator[str]:
        """Iterate over the lines, without their ends; after the last one needed, go on with `blocks`."""
        while self._start < len(self._text) or self._fill():
            end = self._text.find(b"\n", self._start)
            line = self._text[self._start : end if end >= 0 else None]
            self._start += len(line) + 1
            self.next_line += 1
            yield self.decode(line, self.next_line - 1)

    def blocks(self) -> Iterator[bytes]:
        """Iterate over blocks of whole lines, without the last line's end."""
        while self._start < len(self._text) or self._fill():
            block = self._text[self._start :]
            self._text, self._start = b"", 0
            yield block.removesuffix(b"\n")

    def at_end(self) -> bool:
        """Return whether no block follows the latest one."""
        return not (self._start < len(self._text) or self._fill())

    def decode(self, block: bytes, first_line: int) -> str:
        """Return bytes as text.

        Parameters
        ----------
        block
            Whole lines.
        first_line
            Number of the first of them.

        Raises
        ------
        MissionError
            Naming the line that is not text in UTF-8, if that is refused.
        """
        if not self._strict:
            return block.decode("utf-8", "replace")
        start = block.find(b"\0")
        try:
            if start < 0:
                return block.decode()
        except UnicodeDecodeError as error:
            start = error.start
        line = first_line + block.count(b"\n", 0, start)
        raise MissionError(f"{self._path}, row {line}: this is not text; accepted is text in UTF-8")

    def _fill(self) -> bool:
        """Read on to the last line end within the next block; return whether there is anything."""
        new = self._read()
        text = self._cut + new
        end = len(text)
        if new:
            # A carriage return at the very end may be half of a line end.
            end = max(text.rfind(b"\n"), -1 if b"\n" in text else text.rfind(b"\r", 0, -1)) + 1
            if len(text) - end > _LONGEST_LINE:
                raise MissionError(f"{self._path}: a line is longer than {_LONGEST_LINE / 2**20:.0f} MB")
        self._text, self._cut, self._start = text[:end], text[end:], 0
        if b"\r" in self._text:
            self._text = self._text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        return bool(self._text) or (bool(new) and self._fill())

    def _read(self) -> bytes:
        assert self._stream is not None
        try:
            data = self._stream.read(min(_BLOCK, self._left + 1))
        except (OSError, EOFError, zlib.error) as error:
            raise self._error(error) from error
        self._left -= len(data)
        if self._left < 0:
            raise too_large(self._path, self._accepted, self._limit)
        return data

    def _error(self, error: Exception) -> MissionError:
        if isinstance(error, MissionError):
            return error
        if isinstance(error, EOFError | zlib.error | gzip.BadGzipFile):
            return MissionError(f"{self._path}: is not a complete gzip file ({error})")
        return MissionError(f"{self._path}: cannot be read: {getattr(error, 'strerror', None) or error}")


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
            most = decompressed_limit(path.stat().st_size, limit) if compressed else limit
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


def read_whole(path: Path, limit: int) -> bytes:
    """Return all bytes of a file; see `content`."""
    return b"".join(content(path, limit))


def unzip_files(
    path: Path, data: bytes, choose: Callable[[Sequence[str]], Sequence[str]], limit: int
) -> list[tuple[str, bytes]]:
    """Return files in a zip file.

    Parameters
    ----------
    path
        The zip file, for messages.
    data
        Its bytes.
    choose
        Takes the names of all files in it that need no password, and returns those wanted.
    limit
        Most bytes accepted of all wanted files together.

    Returns
    -------
    list of tuple
        Name and bytes of each wanted file.

    Raises
    ------
    MissionError
        If the zip file is damaged, or grows too much.
    """
    most = decompressed_limit(len(data), limit)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            infos = {one.filename: one for one in archive.infolist() if not one.flag_bits & 1}
            wanted = [infos[name] for name in choose(list(infos))]
            if sum(one.file_size for one in wanted) > most:
                raise too_large(path, most, limit)
            return [(one.filename, _member(archive, one)) for one in wanted]
    except MissionError:
        raise
    except (
        zipfile.BadZipFile,
        zlib.error,
        OSError,
        EOFError,
        ValueError,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise MissionError(f"{path}: is not a complete zip file ({error})") from error


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """Return a file of a zip file; `ZipFile.read` would decompress more than the size of a false entry."""
    with archive.open(info) as member:
        return member.read(info.file_size)
