"""Flight csv: our own file of a flight, one named column per quantity, the unit in its name.

One header line, then one row per sample, cells separated by commas, ``.csv`` or ``.csv.gz``. The columns may stand in
any order; columns with other names are ignored. Lines starting with ``#`` may precede the header. UTF-8, with or
without byte order mark; line ends LF or CRLF. Cells are not quoted.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import math
import os
import re
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from lab.missions.errors import MissionError
from lab.missions.recording import Recording
from lab.missions.units_check import check_units

FloatArray = NDArray[np.float64]

MAX_BYTES = 256 * 2**20
"""Largest file accepted, as stored and as decompressed [bytes]."""
MIN_SAMPLES = 4
"""Fewest samples a twice-differentiable curve can be drawn through."""
MAX_DURATION = 86_400.0
"""Longest flight accepted [s]."""

_BLOCK = 8 * 2**20
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?\s*", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class Column:
    """A column of a flight csv.

    Attributes
    ----------
    name : str
        Name in the header, which ends with the unit.
    low, high : float
        Smallest and largest value accepted, in that unit.
    decimals : int
        Decimals written.
    required : bool
        False for columns that may be absent.
    """

    name: str
    low: float
    high: float
    decimals: int
    required: bool = True

    @property
    def accepted(self) -> str:
        """What is accepted, in words."""
        if math.isinf(self.high):
            return "a decimal number"
        return f"a number from {self.low:g} to {self.high:g}"


COLUMNS = (
    Column("time_s", -math.inf, math.inf, 9),
    Column("latitude_deg", -90, 90, 12),
    Column("longitude_deg", -360, 360, 12),
    Column("height_m", -1000, 100_000, 7),
    Column("velocity_north_m_s", -1000, 1000, 8),
    Column("velocity_east_m_s", -1000, 1000, 8),
    Column("velocity_down_m_s", -1000, 1000, 8),
    Column("roll_deg", -360, 360, 9),
    Column("pitch_deg", -90, 90, 9),
    Column("yaw_deg", -360, 360, 9),
    Column("airspeed_m_s", -1, 1000, 6, required=False),
    Column("alpha_deg", -180, 180, 7, required=False),
    Column("beta_deg", -180, 180, 7, required=False),
)
"""All columns, in the order written."""


def read_flight_csv(path: str | os.PathLike[str]) -> Recording:
    """Read a flight csv.

    Parameters
    ----------
    path
        A ``.csv`` file, or a gzip-compressed ``.csv.gz``.

    Returns
    -------
    Recording
        The whole flight: a file with anything wrong in it gives no part of one.

    Raises
    ------
    MissionError
        Naming file, row (the line number an editor shows) and column: if the file cannot be read or is too large, a
        column is missing, a cell is not a finite number within its limits, time does not increase, or numbers look
        like another unit (radians, knots).
    """
    path = Path(path)
    try:
        size = _size(path)
        if size > MAX_BYTES:
            raise MissionError(
                f"{path}: {size / 2**20:.0f} MB; accepted are files up to {MAX_BYTES / 2**20:.0f} MB"
            )
        with path.open("rb") as stored:
            return _read(path, _Lines(path, stored))
    except (OSError, EOFError, zlib.error, ValueError) as error:
        if isinstance(error, MissionError):
            raise
        raise MissionError(f"{path}: cannot be read: {_reason(error)}") from error


def write_flight_csv(path: str | os.PathLike[str], recording: Recording) -> None:
    """Write a flight csv, compressed if the name ends with ``.gz``; the file appears whole or not at all.

    The same recording gives the same bytes. Precision: 1e-12° of position (0.1 µm), 0.1 µm of height, 10 nm/s,
    1e-9° of attitude.

    Raises
    ------
    MissionError
        If the recording holds numbers that are not finite, or the file cannot be written.
    """
    path = Path(path)
    columns, table = _table(recording)
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise MissionError(
            f"{path}: sample {row}: {columns[column].name} is {table[row, column]}; nothing written"
        )
    try:
        with atomic_file(path) as file:
            compressed = path.suffix == ".gz"
            # No name and no time of day in the gzip header: the same flight gives the same bytes.
            out = gzip.GzipFile("", "wb", 9, file, mtime=0) if compressed else contextlib.nullcontext(file)
            with out as stream:
                _write_rows(cast(BinaryIO, stream), columns, table)
    except OSError as error:
        raise MissionError(f"{path}: cannot be written: {_reason(error)}") from error


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes its name only when everything has been written to it."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _table(recording: Recording) -> tuple[list[Column], FloatArray]:
    values: list[FloatArray | None] = [
        recording.time,
        np.degrees(recording.latitude),
        np.degrees(recording.longitude),
        recording.height,
        *recording.velocity_n.T,
        *np.degrees(recording.euler).T,
        recording.airspeed,
        None if recording.alpha is None else np.degrees(recording.alpha),
        None if recording.beta is None else np.degrees(recording.beta),
    ]
    present = [(column, value) for column, value in zip(COLUMNS, values, strict=True) if value is not None]
    return [column for column, _ in present], np.column_stack([value for _, value in present])


def _write_rows(out: BinaryIO, columns: list[Column], table: FloatArray) -> None:
    out.write((",".join(column.name for column in columns) + "\n").encode())
    form = ",".join(f"%.{column.decimals}f" for column in columns) + "\n"
    for start in range(0, len(table), 10_000):
        out.write("".join(form % tuple(row) for row in table[start : start + 10_000].tolist()).encode())


class _Lines:
    """The lines of a file, in blocks of bytes that end with a line end, and the number of the next line."""

    def __init__(self, path: Path, stored: BinaryIO) -> None:
        self._path = path
        self._stream = gzip.GzipFile(fileobj=stored) if path.suffix == ".gz" else stored
        self._rest = b""
        self._read = 0
        self.next_line = 1

    def header(self) -> list[str]:
        """Read up to and including the header and return its cells.

        Raises
        ------
        MissionError
            If there is none.
        """
        self._fill()
        self._rest = self._rest.removeprefix(b"\xef\xbb\xbf")
        while self._rest:
            line, _, self._rest = self._rest.partition(b"\n")
            self.next_line += 1
            if line.strip() and not line.startswith(b"#"):
                return [cell.strip() for cell in self._text(line, self.next_line - 1).split(",")]
        raise MissionError(
            f"{self._path}: the file is empty; accepted is a header line and rows: {_columns()}"
        )

    def blocks(self) -> Iterator[str]:
        """Iterate over what follows, without the last line end; the caller counts `next_line` on."""
        while self._rest or self._fill():
            block, self._rest = self._rest, b""
            yield self._text(block.removesuffix(b"\n"), self.next_line)

    def _fill(self) -> bool:
        parts = []
        while not parts or b"\n" not in parts[-1]:
            parts.append(self._stream.read(_BLOCK))
            self._read += len(parts[-1])
            if self._read > MAX_BYTES:
                raise MissionError(f"{self._path}: more than {MAX_BYTES / 2**20:.0f} MB when decompressed")
            if not parts[-1]:
                break
        rest_of_line = b"" if not parts[-1] or parts[-1].endswith(b"\n") else self._stream.readline(MAX_BYTES)
        self._read += len(rest_of_line)
        text = b"".join([*parts, rest_of_line])
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self._rest = text
        return bool(text)

    def _text(self, block: bytes, first_line: int) -> str:
        start = block.find(b"\0")
        try:
            if start < 0:
                return block.decode()
        except UnicodeDecodeError as error:
            start = error.start
        line = first_line + block.count(b"\n", 0, start)
        raise MissionError(f"{self._path}, row {line}: this is not text; accepted is a csv file in UTF-8")


def _read(path: Path, lines: _Lines) -> Recording:
    header = lines.header()
    columns, indices = _find_columns(path, header, lines.next_line - 1)
    first_line = lines.next_line
    parsed = [np.empty((0, len(columns)))]
    blank_line = 0
    for block in lines.blocks():
        filled = block.rstrip()
        if filled and blank_line:
            raise MissionError(f"{path}, row {blank_line}: the row is empty; accepted is one sample per row")
        if filled:
            values = _parse(path, filled, lines.next_line, columns, indices, len(header))
            _check_values(path, values, lines.next_line, columns)
            parsed.append(values)
        if len(filled) < len(block.rstrip(" \t")):
            blank_line = blank_line or lines.next_line + (filled.count("\n") + 1 if filled else 0)
        lines.next_line += block.count("\n") + 1
    table = np.concatenate(parsed)
    del parsed
    _check_time(path, table[:, 0], first_line)
    check_units(str(path), table)
    return _recording(columns, table)


def _find_columns(path: Path, header: list[str], line: int) -> tuple[list[Column], list[int]]:
    missing = [column.name for column in COLUMNS if column.required and column.name not in header]
    if missing:
        hint = " Cells are separated by commas, not semicolons." if ";" in "".join(header) else ""
        noun = "column" if len(missing) == 1 else "columns"
        raise MissionError(
            f"{path}, row {line}: {noun} {', '.join(missing)} missing in the header.{hint} {_columns()}"
        )
    columns = [column for column in COLUMNS if column.name in header]
    for column in columns:
        if header.count(column.name) > 1:
            raise MissionError(f"{path}, row {line}: column {column.name} occurs twice; accepted once")
    return columns, [header.index(column.name) for column in columns]


def _parse(
    path: Path, block: str, line: int, columns: list[Column], indices: list[int], cells: int
) -> FloatArray:
    _check_cells(path, block, line, cells)
    try:
        return np.loadtxt(io.StringIO(block), delimiter=",", usecols=indices, comments=None, ndmin=2)
    except ValueError as error:
        for number, row in enumerate(block.split("\n"), line):
            texts = row.split(",")
            for column, index in zip(columns, indices, strict=True):
                if not _NUMBER.fullmatch(texts[index]):
                    raise MissionError(_wrong(path, number, column, texts[index].strip())) from error
        raise


def _check_cells(path: Path, block: str, line: int, cells: int) -> None:
    characters = np.frombuffer(block.encode(), dtype=np.uint8)
    ends = np.append(np.flatnonzero(characters == ord("\n")), len(characters))
    counts = np.diff(np.searchsorted(np.flatnonzero(characters == ord(",")), ends), prepend=0) + 1
    wrong = np.flatnonzero(counts != cells)
    if len(wrong):
        number, count = line + int(wrong[0]), int(counts[wrong[0]])
        if not block.split("\n")[wrong[0]].strip():
            raise MissionError(f"{path}, row {number}: the row is empty; accepted is one sample per row")
        raise MissionError(
            f"{path}, row {number}: {count} cells; accepted are {cells}, as many as in the header"
        )


def _check_values(path: Path, values: FloatArray, line: int, columns: list[Column]) -> None:
    low = np.array([column.low for column in columns])
    high = np.array([column.high for column in columns])
    good = np.isfinite(values) & (values >= low) & (values <= high)
    if not good.all():
        row, index = np.argwhere(~good)[0]
        raise MissionError(_wrong(path, line + int(row), columns[index], f"{values[row, index]:.9g}"))


def _check_time(path: Path, time: FloatArray, first_line: int) -> None:
    if len(time) < MIN_SAMPLES:
        raise MissionError(f"{path}: {len(time)} rows of samples; accepted are at least {MIN_SAMPLES}")
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        row = int(back[0]) + 1
        word = "repeats" if time[row] == time[row - 1] else "runs backwards"
        raise MissionError(
            f"{path}, row {first_line + row}, column time_s: time {word}, from {time[row - 1]:.9g} to {time[row]:.9g}; "
            "accepted is time that increases from row to row"
        )
    if time[-1] - time[0] > MAX_DURATION:
        row = int(np.argmax(time - time[0] > MAX_DURATION))
        raise MissionError(
            f"{path}, row {first_line + row}, column time_s: {time[row] - time[0]:.9g} s after the first sample; accepted are "
            f"flights up to {MAX_DURATION:g} s, with time in seconds"
        )


def _recording(columns: list[Column], table: FloatArray) -> Recording:
    optional = {column.name: table[:, index] for index, column in enumerate(columns) if not column.required}
    airspeed, alpha, beta = (optional.get(name) for name in ("airspeed_m_s", "alpha_deg", "beta_deg"))
    return Recording(
        time=table[:, 0],
        latitude=np.radians(table[:, 1]),
        longitude=np.radians(table[:, 2]),
        height=table[:, 3],
        velocity_n=table[:, 4:7],
        euler=np.radians(table[:, 7:10]),
        airspeed=airspeed,
        alpha=None if alpha is None else np.radians(alpha),
        beta=None if beta is None else np.radians(beta),
    )


def _wrong(path: Path, line: int, column: Column, text: str) -> str:
    shown = text if len(text) <= 40 else text[:37] + "..."
    what = f"{shown!r} is not accepted" if shown else "the cell is empty"
    return f"{path}, row {line}, column {column.name}: {what}; accepted is {column.accepted}"


def _columns() -> str:
    required = ", ".join(column.name for column in COLUMNS if column.required)
    optional = ", ".join(column.name for column in COLUMNS if not column.required)
    return f"Columns: {required}; optional: {optional}."


def _size(path: Path) -> int:
    if path.is_dir():
        raise MissionError(f"{path}: is a folder; accepted is a csv file")
    if not path.exists():
        raise MissionError(f"{path}: there is no such file")
    if not path.is_file():
        raise MissionError(f"{path}: is not an ordinary file; accepted is a csv file")
    return path.stat().st_size


def _reason(error: BaseException) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return (
        f"not a complete gzip file ({text})"
        if isinstance(error, EOFError | zlib.error | gzip.BadGzipFile)
        else text
    )
