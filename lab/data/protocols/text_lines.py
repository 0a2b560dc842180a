"""Text lines: one sample a line, as an Arduino or a spreadsheet of a phone writes them.

Without a column map, the first lines are held back until they show one. Lines have no check: a line counts
only if it has all its columns, each a plain number, and its time and values are no jump that the next line
does not confirm. A line whose time jumps waits for that; after three in a row, the clock itself jumps. The
line in which a stream begins may be cut, so it is not taken. Damage that leaves a number a number gets
through.

A heading or a speed that repeats that of the line before is the same reading, written again.
"""

from __future__ import annotations

import math
import re
from collections import deque

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols.column_guess import MIN_LINES, NUMBER, guess_columns
from lab.data.protocols.column_map import IGNORED, READINGS, ColumnMap
from lab.data.protocols.decoder import Statistics
from lab.data.protocols.limits import TEXT_LIMITS
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import NAN, UNKNOWN, Samples, Vector
from lab.data.sheets.sheet_layout import as_utf8

LONGEST = 1024
"""Longest line [bytes]; a longer one is skipped."""
_NUMBER = f"({NUMBER})"
_HELD = 64
"""Most lines held back while the columns are not known."""
_STEPS = 10.5
"""Step of time, in usual ones, beyond which the next line must confirm it. With one byte of 1000 damaged,
every tenth line of 100 bytes is lost, and ten in a row never."""
_MOST_WAITING = 3
"""Lines in a row whose times jump without one that confirms another, from which the clock is to blame: at
one damaged byte of 1000, one line in some 60 has a damaged time, so three in a row come once in 200,000."""
_REMEMBERED = 9
"""Steps of time that the usual one is the median of."""
_WRAPS = {"ms": 2**32, "µs": 2**32}
"""Where the counters of microcontrollers start again."""
_ENDS = re.compile(rb"[\r\n]+")
_PIECE = 2**16  # bytes decoded at once


class TextLines:
    """Decodes text lines; a `Decoder`.

    Parameters
    ----------
    columns
        What the columns are; None to find out.
    """

    name = "text"
    longest = (_HELD + 1) * LONGEST

    def __init__(self, columns: ColumnMap | None = None) -> None:
        self.statistics = Statistics()
        self.wrap_period = math.inf
        self._rows = Rows(self.statistics, TEXT_LIMITS)
        self._buffer = bytearray()
        self._before = 0
        self._whole = False  # whether the buffer begins with the start of a line
        self._first = True
        self._held: deque[tuple[str, int]] = deque(maxlen=_HELD)
        self._fresh = 0
        self._map: ColumnMap | None = None
        if columns is not None:
            self._use(columns)

    @property
    def held(self) -> int:
        """Bytes of the stream that are held back."""
        return len(self._buffer) + sum(len(text) for text, _ in self._held)

    @property
    def columns(self) -> ColumnMap | None:
        """The column map in use; None while it is not known."""
        return self._map

    @property
    def evidence(self) -> str:
        """What the columns were taken for, and why; people see it and may correct it."""
        return "" if self._map is None else " ".join((f"{self._map.described}.", *self._map.remarks))

    def feed(self, data: bytes) -> Samples:
        """Return the samples of the lines that end in these bytes."""
        self.statistics.bytes += len(data)
        for begin in range(0, len(data), _PIECE):
            self._buffer += data[begin : begin + _PIECE]
            self._split()
        return self._rows.taken()

    def finish(self) -> Samples:
        """Return the sample of a last line without an end, and those held back."""
        if self._buffer:
            self._line(bytes(self._buffer), self._before + len(self._buffer))
            self._before += len(self._buffer)
            self._buffer.clear()
        if self._map is not None:
            self.statistics.refused += self._clock.refuse()
        if self._map is None:
            self._guess()
            self.statistics.skipped += sum(len(text) for text, _ in self._held)
            self._held.clear()
        return self._rows.taken()

    def _split(self) -> None:
        buffer = self._buffer
        at = 0
        for end in _ENDS.finditer(buffer):
            if end.start() > at:
                # Whether a line feed follows may not be known yet, so it is not counted.
                self._line(bytes(buffer[at : end.start()]), self._before + end.start() + 1)
            self._whole, self._first = True, False
            at = end.end()
        if len(buffer) - at > LONGEST:
            self.statistics.skipped += len(buffer) - at
            self._whole, self._first, at = False, False, len(buffer)
        self._before += at
        del buffer[:at]

    def _line(self, line: bytes, end: int) -> None:
        if len(line) > LONGEST or not (self._whole or self._first):
            self.statistics.skipped += len(line)
            return
        text = (line if line.isascii() else as_utf8(line + b"\n")[:-1]).decode("utf-8", "replace")
        if not self._whole and _begins_with_number(text):
            self.statistics.skipped += len(line)
            return
        if self._map is not None:
            self._accept(text, len(line), end)
            return
        if len(self._held) == _HELD:
            self.statistics.skipped += len(self._held[0][0])
        self._held.append((text, end))
        self._fresh += 1
        if self._fresh >= MIN_LINES:
            self._guess()

    def _guess(self) -> None:
        self._fresh = 0
        found = guess_columns([text for text, _ in self._held])
        if found is None:
            return
        self._use(found)
        for text, end in self._held:
            self._accept(text, len(text), end)
        self._held.clear()

    def _use(self, columns: ColumnMap) -> None:
        self._map = columns
        between = r"\s+" if columns.separator == " " else rf"\s*{re.escape(columns.separator)}\s*"
        number = _NUMBER.replace(r"\.", ",") if columns.decimal_comma else _NUMBER
        other = r"[^,;\t]*?" if columns.separator != " " else r"\S+"
        cells = [f"({other})" if column.quantity == IGNORED else number for column in columns.columns]
        end = r"\s*" if columns.separator == " " else rf"\s*(?:{re.escape(columns.separator)}\s*)?"
        self._pattern = re.compile(re.escape(columns.prefix) + r"\s*" + between.join(cells) + end)
        places = {column.quantity: at for at, column in enumerate(columns.columns)}
        self._scales = {column.quantity: column.scale for column in columns.columns}
        self._vectors = {
            name: tuple((places[f"{name}_{axis}"], self._scales[f"{name}_{axis}"]) for axis in "xyz")
            for name in ("rate", "force", "magnetic")
            if f"{name}_x" in places
        }
        self._places = places
        self._readings = {name: NAN for name in READINGS if name in places}
        unit = next((column.unit for column in columns.columns if column.quantity == "time"), "")
        self._clock = _TimeCheck(_WRAPS.get(unit))
        if unit in _WRAPS:
            self.wrap_period = _WRAPS[unit] * self._scales["time"]

    def _accept(self, text: str, size: int, end: int) -> None:
        found = self._pattern.fullmatch(text)
        if found is None:
            if _begins_with_number(text):
                self.statistics.failed += 1
            else:
                self.statistics.unknown += 1
            self.statistics.skipped += size
            return
        self.statistics.frames += 1
        cells = found.groups()
        if self._map is not None and self._map.decimal_comma:
            cells = tuple(cell.replace(",", ".") for cell in cells)
        if "time" not in self._places:
            self._add(cells, NAN, end)
            return
        accepted, refused = self._clock.accept(float(cells[self._places["time"]]), (cells, end))
        self.statistics.refused += refused
        for counted, (one, place) in accepted:
            self._add(one, counted * self._scales["time"], place)

    def _add(self, cells: tuple[str, ...], time: float, end: int) -> None:
        self._rows.add_imu(
            end,
            time,
            int(self._number(cells, "count", -1.0)),
            self._vector(cells, "rate"),
            self._vector(cells, "force"),
            self._vector(cells, "magnetic"),
            self._number(cells, "temperature", NAN),
            self._number(cells, "pressure", NAN),
        )
        for name, before in self._readings.items():
            value = self._number(cells, name, NAN)
            if value != before:
                self._readings[name] = value
                self._rows.add_reading(end, time, **{name: value})

    def _vector(self, cells: tuple[str, ...], name: str) -> Vector:
        if name not in self._vectors:
            return UNKNOWN
        return [float(cells[at]) * scale for at, scale in self._vectors[name]]

    def _number(self, cells: tuple[str, ...], name: str, unknown: float) -> float:
        if name not in self._places:
            return unknown
        value = float(cells[self._places[name]]) * self._scales[name]
        return value if abs(value) < 2**53 else unknown


_Line = tuple[tuple[str, ...], int]  # cells, and where the line ends


class _TimeCheck:
    """Accepts times that go on evenly, and jumps that the next line confirms."""

    def __init__(self, modulus: int | None) -> None:
        self._modulus = modulus
        self._turns = 0
        self._last: float | None = None
        self._before: float | None = None
        self._waiting: list[tuple[float, _Line]] = []  # lines whose times jump
        self._jumps = False  # whether the clock itself jumps at every line
        self._steps: deque[float] = deque(maxlen=_REMEMBERED)

    def accept(self, value: float, line: _Line) -> tuple[list[tuple[float, _Line]], int]:
        """Return the lines accepted now, with their times as counted on, and how many are refused."""
        last = self._last
        value += self._turns * (self._modulus or 0)
        if self._modulus and last is not None and last - value > self._modulus / 2:
            value += self._modulus
        waiting = self._waiting
        accepted: list[tuple[float, _Line]] = []
        if last is None or self._near(value - last):
            if last is not None and value > last:
                self._steps.append(value - last)
            self._jumps = False
        # If the last time was damaged, this one still follows the time before it.
        elif self._before is not None and self._near(value - self._before):
            pass
        elif waiting and self._near(value - waiting[-1][0]):
            accepted = waiting[-1:]
        elif self._jumps or len(waiting) == _MOST_WAITING:
            self._jumps, accepted = True, waiting[:]
        else:
            waiting.append((value, line))
            return [], 0
        refused = len(waiting) - len(accepted)
        self._waiting = []
        self._before, self._last = last, value
        if self._modulus:
            self._turns = int(value // self._modulus)
        return [*accepted, (value, line)], refused

    def refuse(self) -> int:
        """Give up the lines that wait; return how many these are."""
        refused, self._waiting = len(self._waiting), []
        return refused

    def _near(self, step: float) -> bool:
        if not self._steps:
            return step >= 0
        return 0 <= step <= _STEPS * sorted(self._steps)[len(self._steps) // 2]


def _begins_with_number(text: str) -> bool:
    return text.lstrip()[:1] in set("0123456789+-.")


class TextEncoder:
    """Writes samples as lines under a header of columns and units; an `Encoder`. Numbers are exact."""

    name = "text"

    def __init__(self) -> None:
        self._begun = False

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the lines of samples; the first call begins with the header. Fixes have no columns."""
        lines = [] if self._begun else [TEXT_HEADER]
        self._begun = True
        lines += [
            ",".join(repr(float(one)) for one in (row["time"], *row["rate"], *row["force"])) for row in imu
        ]
        return "".join(f"{line}\r\n" for line in lines).encode()


TEXT_HEADER = "time[s],rate_x[rad/s],rate_y[rad/s],rate_z[rad/s],force_x[m/s²],force_y[m/s²],force_z[m/s²]"
"""Columns that `TextEncoder` writes."""
