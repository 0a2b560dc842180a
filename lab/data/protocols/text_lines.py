"""Text lines: samples as an Arduino or a spreadsheet of a phone writes them, each on one line or on several.

Without a column map, the first lines are held back until they show one. Lines have no check: a line counts
only if it has all its columns and all words between them, each column a plain number or none, and its time
and values are no jump that the next line does not confirm. A line whose time jumps waits for that; after
three in a row, the clock itself jumps. The line in which a stream begins may be cut, so it is not taken.
Damage that leaves a number a number gets through. Of a sample on several lines, all must come in their
order; lines between that belong to none are left out.

A heading, a speed or a position that repeats that of the line before is the same reading, written again.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols import text_cells
from lab.data.protocols.column_guess import guess_columns, name_columns
from lab.data.protocols.column_map import (
    CLOCK,
    IGNORED,
    OF_A_FIX,
    READINGS,
    SOURCE,
    VECTORS,
    Column,
    ColumnMap,
)
from lab.data.protocols.decoder import Statistics
from lab.data.protocols.framing import xor8
from lab.data.protocols.limits import TEXT_LIMITS
from lab.data.protocols.line_shape import headings_in
from lab.data.protocols.number_guess import MIN_LINES
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import FIX_2D, FIX_3D, NAN, UNKNOWN, Samples, Vector
from lab.data.protocols.text_cells import line_patterns, value_of
from lab.data.sheets.sheet_layout import as_utf8

LONGEST = 2048
"""Longest line [bytes]; a longer one is skipped. The header of a sensor_msgs/Imu as csv has 1300."""
_HELD = 192
"""Most lines held back while the columns are not known: three samples of 60 lines, and what comes before."""
_OFTEN = 8
"""Times as many lines at which columns are looked for each time: what comes before the data is shorter."""
_STEPS = 10.5
"""Step of time, in usual ones, beyond which the next line must confirm it. With one byte of 1000 damaged,
every tenth line of 100 bytes is lost, and ten in a row never."""
_MOST_WAITING = 3
"""Lines in a row whose times jump without one that confirms another, from which the clock is to blame: at
one damaged byte of 1000, one line in some 60 has a damaged time, so three in a row come once in 200,000."""
_REMEMBERED = 9
"""Steps of time that the usual one is the median of."""
_WRAPS = {"ms": 2**32, "µs": 2**32, CLOCK: 86_400}
"""Where the counters of microcontrollers start again, and the time of day."""
_ENDS = re.compile(rb"\r\n|\r|\n")
_CHECKED = re.compile(r"(\$[ -)+-~]*)\*([0-9A-Fa-f]{2})\s*")
"""A line with the check of NMEA."""
_OF_IMU = re.compile(r"(?i)\$[A-Z]{0,8}(?:IMU|INS|ACC|GYR|AHRS|MEMS|SENS|CHRS)")
"""Begin of such lines that are read: those of receivers are full of numbers, too."""
_OF_RECEIVER = re.compile(r"\$(?:[A-Z]{2}(?:GGA|GNS|RMC|GLL|VTG|GSA|GSV|GST|ZDA|HDT|THS)|PUBX),")
"""Begin of sentences of receivers, which hold no IMU even without a check."""
_PIECE = 2**16  # bytes decoded at once


class TextLines:
    """Decodes text lines; a `Decoder`.

    Parameters
    ----------
    columns
        What the columns are; None to find out.
    said
        What a person says of columns that are to be found out, as of `guess_columns`.
    units
        Units that a person says, by quantity without its axis.

    Attributes
    ----------
    before : int
        Bytes before the first line with all columns: what a device says when it starts.
    last : deque of str
        The last lines before the columns are known.
    is_unrecognised : bool
        Whether columns were looked for, and none were found.
    follows_headers : bool
        Whether a header that comes later may name other columns: no person has named them.
    """

    name = "text"
    longest = (_HELD + 1) * LONGEST

    def __init__(
        self,
        columns: ColumnMap | None = None,
        said: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        self._said, self._units = said or {}, units or {}
        self.statistics = Statistics()
        self.wrap_period = math.inf
        self._rows = Rows(self.statistics, TEXT_LIMITS)
        self._buffer = bytearray()
        self._before = 0
        self._whole = False  # whether the buffer begins with the start of a line
        self._first = True
        self._cut = False  # whether the last line ended in a carriage return, and a line feed may follow
        self._held: deque[tuple[str, int]] = deque(maxlen=_HELD)
        self._seen = 0
        self.before = 0
        self.last: deque[str] = deque(maxlen=text_cells.SHOWN_LINES)
        self.is_unrecognised = False
        self.follows_headers = columns is None and not said
        self._known: set[str] = set()  # lines in which the columns were found
        self._guessed = -_HELD  # lines read before
        self._fix = (NAN, NAN, NAN)
        self._part: list[str] = []  # cells of the lines of a sample that have come
        self._line_of = 0  # the line of the sample that is next
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
            self._split_lines()
        return self._rows.taken()

    def finish(self) -> Samples:
        """Return the sample of a last line without an end, and those held back."""
        if self._buffer:
            self._read_line(bytes(self._buffer), self._before + len(self._buffer))
            self._before += len(self._buffer)
            self._buffer.clear()
        if self._map is not None:
            self.statistics.refused += self._clock.refuse()
        if self._map is None:
            self._guess(whole=True)
            self.statistics.skipped += sum(len(text) for text, _ in self._held)
            self._held.clear()
        return self._rows.taken()

    def _split_lines(self) -> None:
        buffer = self._buffer
        at = 0
        for end in _ENDS.finditer(buffer):
            if end.start() > at:
                # Whether a line feed follows may not be known yet, so it is not counted.
                self._read_line(bytes(buffer[at : end.start()]), self._before + end.start() + 1)
            elif self._map is None and self._held and not (self._cut and end[0] == b"\n"):
                self._hold_line("", self._before + end.end())
            self._whole, self._first = True, False
            self._cut = end[0] == b"\r"
            at = end.end()
        if len(buffer) - at > LONGEST:
            self.statistics.skipped += len(buffer) - at
            self._whole, self._first, at = False, False, len(buffer)
        self._before += at
        del buffer[:at]

    def _read_line(self, line: bytes, end: int) -> None:
        if len(line) > LONGEST or not (self._whole or self._first):
            self.statistics.skipped += len(line)
            return
        text = (line if line.isascii() else as_utf8(line + b"\n")[:-1]).decode("utf-8", "replace")
        if "\x1b" in text:
            text = text_cells.without_colours(text)
        if text[:1] == "$" and (checked := _CHECKED.fullmatch(text)):
            is_sound = int(checked[2], 16) == xor8(checked[1].encode()[1:])
            self.statistics.failed += not is_sound
            if not is_sound or not (self._map or self._said or _OF_IMU.match(text)):
                self.statistics.skipped += len(line)
                self.last.append(text)
                return
            text = checked[1]
        elif not (self._map or self._said) and _OF_RECEIVER.match(text):
            self.statistics.skipped += len(line)
            self.last.append(text)
            return
        if not self._whole and _begins_with_number(text):
            self.statistics.skipped += len(line)
            return
        if self._map is not None:
            self._accept(text, len(line), end)
            return
        self.last.append(text)
        self._hold_line(text, end)
        self._seen += 1
        # Of text that shows no columns, a guess is made less and less often.
        twice = self._seen & (self._seen - 1) == 0
        if self._seen >= MIN_LINES and (twice or (self._seen % _HELD == 0 and self._seen <= _OFTEN * _HELD)):
            self._guess()

    def _hold_line(self, text: str, end: int) -> None:
        """Keep a line; an empty one stands for any number of these."""
        if not text and not (self._held and self._held[-1][0]):
            return
        if len(self._held) == _HELD:
            self.statistics.skipped += len(self._held[0][0])
        self._held.append((text, end))

    def _guess(self, whole: bool = False) -> None:
        found = guess_columns([text for text, _ in self._held], self._said, whole)
        self.is_unrecognised = found is None
        if found is None:
            return
        self._use(found)
        held = [line for line in self._held if line[0]]
        self._held.clear()
        self._known = {text for text, _ in held}
        self._guessed = self.statistics.frames
        for text, end in held:
            self._accept(text, len(text), end)

    def _use(self, columns: ColumnMap) -> None:
        for kind, unit in self._units.items():
            if any(column.kind == kind for column in columns.columns):
                columns = columns.in_unit(kind, unit)
        self._patterns = line_patterns(columns)
        others = tuple(Column() if one.quantity == SOURCE else one for one in columns.columns)
        is_of_one = others != columns.columns
        self._others = line_patterns(replace(columns, columns=others)) if is_of_one else []
        # What the lines that are read begin with; nothing if that is a number.
        self._leads = tuple(one[0].strip() for one in columns.texts) or (columns.prefix,)
        self._several, self._comma = len(self._patterns) > 1, columns.decimal_comma
        ends = np.cumsum([one.groups for one in self._patterns])
        used = [at for at, column in enumerate(columns.columns) if column.quantity != IGNORED]
        self._decides = int(np.searchsorted(ends, used[-1], side="right"))  # line with the last column read
        self._scale(columns)
        self._readings = {name: NAN for name in READINGS if name in self._places}
        unit = next((column.unit for column in columns.columns if column.quantity == "time"), "")
        self._clock = _TimeCheck(_WRAPS.get(unit, math.inf))
        if unit in _WRAPS:
            self.wrap_period = _WRAPS[unit] * self._scales["time"]

    def _scale(self, columns: ColumnMap) -> None:
        self._map = columns
        self._places = {column.quantity: at for at, column in enumerate(columns.columns)}
        self._scales = {column.quantity: column.scale for column in columns.columns}
        self._vectors = {
            name: tuple((self._places[f"{name}_{axis}"], self._scales[f"{name}_{axis}"]) for axis in "xyz")
            for name in VECTORS
            if f"{name}_x" in self._places
        }

    def read_times_in(self, unit: str) -> None:
        """Read the times in another unit from the next line on."""
        if self._map is not None:
            self._units = {**self._units, "time": unit}
            self._use(self._map)

    def answer(self, unit: str) -> float:
        """Read the rates in a unit from the next line on; return the factor for those that were read.

        Parameters
        ----------
        unit
            The unit.

        Raises
        ------
        ColumnMapError
            If it is no unit of a rate, or there is none.
        """
        self._units = {**self._units, "rate": unit}
        if self._map is None:
            return 1.0
        before = self._scales.get("rate_x", 1.0)
        self._scale(self._map.in_unit("rate", unit))
        factor = self._scales["rate_x"] / before
        self._rows.scale_rates(factor)
        return factor

    def _accept(self, text: str, size: int, end: int) -> None:
        several = self._several
        found = self._patterns[self._line_of].fullmatch(text)
        if found is None and several:
            found = self._begin_anew(text)
        if found is None:
            if not any(one.fullmatch(text) for one in self._others):  # of another device
                self._leave_out(text, size)
            return
        self.statistics.frames += 1
        cells = found.groups()
        if several:
            self._part += cells
            at, self._line_of = self._line_of, (self._line_of + 1) % len(self._patterns)
            cells = tuple(self._part)
            if not self._line_of:
                self._part = []
            if at != self._decides:  # lines that are not read may follow, and are not waited for
                return
        if self._comma:
            cells = tuple(cell.replace(",", ".") for cell in cells)
        if "time" not in self._places:
            self._add(cells, NAN, end)
            return
        time = self._time(cells)
        if time >= 2 * self._clock.modulus:  # counted since 1970; a leap second ends a day a little late
            self._clock.modulus = self.wrap_period = math.inf
        accepted, refused = self._clock.accept(time, (cells, end))
        self.statistics.refused += refused
        for counted, (one, place) in accepted:
            self._add(one, counted * self._scales["time"], place)

    def _begin_anew(self, text: str) -> re.Match[str] | None:
        """Return the cells of the first line of a sample; one that lacks lines before another is given up."""
        if any(one.fullmatch(text) for one in self._patterns):
            self.statistics.refused += bool(self._line_of)
            self._part, self._line_of = [], 0
        return None if self._line_of else self._patterns[0].fullmatch(text)

    def _is_another_header(self, text: str) -> bool:
        """Return whether a line names other columns than those in use, as after a restart."""
        columns = self._map
        # A guess takes as long as to read the lines that are held.
        is_late = self.statistics.frames >= self._guessed + _HELD
        if columns is None or columns.texts or not is_late or not self.follows_headers or text in self._known:
            return False
        headings = headings_in(text, columns.separator)
        found = [one for one in name_columns(headings, []) if one.kind not in self._units]
        is_of_these = len(headings) == len(columns.columns)
        return is_of_these and any(one.unit and one not in columns.columns for one in found)

    def _leave_out(self, text: str, size: int) -> None:
        if self._is_another_header(text):
            self._map, self._seen = None, 1
            self._hold_line(text, 0)
            return
        if _begins_with_number(text):
            self.statistics.failed += 1
        else:
            self.statistics.unknown += 1
            if self.statistics.frames and all(self._leads) and not text.lstrip().startswith(self._leads):
                return  # of another kind, which the device sends besides
        self.statistics.skipped += size
        if not self.statistics.frames:
            self.before += size

    def _time(self, cells: tuple[str, ...]) -> float:
        """Return the time of a sample in its unit."""
        cell = cells[self._places["time"]]
        time = value_of(cell) if ":" in cell else float(cell)
        if "fraction" in self._places:
            part = float(cells[self._places["fraction"]]) * self._scales["fraction"]
            time += part / self._scales["time"]
        return time

    def _add(self, cells: tuple[str, ...], time: float, end: int) -> None:
        count = int(self._number(cells, "count", -1.0))
        rate, force, magnetic = (self._vector(cells, name) for name in VECTORS)
        temperature, pressure = (self._number(cells, name, NAN) for name in ("temperature", "pressure"))
        if self._vectors:
            self._rows.add_imu(end, time, count, rate, force, magnetic, temperature, pressure)
        if "latitude" in self._places:
            self._add_fix(cells, time, end)
        for name, before in self._readings.items():
            value = self._number(cells, name, NAN)
            if value != before:
                self._readings[name] = value
                self._rows.add_reading(end, time, **{name: value})

    def _add_fix(self, cells: tuple[str, ...], time: float, end: int) -> None:
        """Take the position of a line, if it has another one than the line before."""
        latitude, longitude, height, *velocity = (self._number(cells, name, NAN) for name in OF_A_FIX)
        place = latitude, longitude, height
        if place == self._fix or math.isnan(latitude + longitude) or latitude == longitude == 0:
            return  # zeros are written before the first fix
        self._fix = place
        kind = FIX_2D if math.isnan(height) else FIX_3D
        self._rows.add_fix(end, time, place=place, velocity_n=velocity, fix_type=kind, sea_level=True)

    def _vector(self, cells: tuple[str, ...], name: str) -> Vector:
        if name not in self._vectors:
            return UNKNOWN
        try:
            return [float(cells[at]) * scale for at, scale in self._vectors[name]]
        except ValueError:  # a cell without a number
            return UNKNOWN

    def _number(self, cells: tuple[str, ...], name: str, unknown: float) -> float:
        if name not in self._places:
            return unknown
        try:
            value = float(cells[self._places[name]]) * self._scales[name]
        except ValueError:  # a cell without a number
            return unknown
        return value if abs(value) < 2**53 else unknown


_Line = tuple[tuple[str, ...], int]  # cells, and where the line ends


class _TimeCheck:
    """Accepts times that go on evenly, and jumps that the next line confirms."""

    def __init__(self, modulus: float) -> None:
        self.modulus = modulus
        self._begun = 0.0  # where the turn of the counter began
        self._last: float | None = None
        self._before: float | None = None
        self._waiting: list[tuple[float, _Line]] = []  # lines whose times jump
        self._jumps = False  # whether the clock itself jumps at every line
        self._steps: deque[float] = deque(maxlen=_REMEMBERED)

    def accept(self, value: float, line: _Line) -> tuple[list[tuple[float, _Line]], int]:
        """Return the lines accepted now, with their times as counted on, and how many are refused."""
        last = self._last
        value += self._begun
        if last is not None and last - value > self.modulus / 2:
            value += self.modulus
        waiting = self._waiting
        accepted: list[tuple[float, _Line]] = []
        if last is None or self._is_near(value - last):
            if last is not None and value > last:
                self._steps.append(value - last)
            self._jumps = False
        # If the last time was damaged, this one still follows the time before it.
        elif self._before is not None and self._is_near(value - self._before):
            pass
        elif waiting and self._is_near(value - waiting[-1][0]):
            accepted = waiting[-1:]
        elif self._jumps or len(waiting) == _MOST_WAITING:
            self._jumps, accepted = True, waiting[:]
        else:
            waiting.append((value, line))
            return [], 0
        refused = len(waiting) - len(accepted)
        self._waiting = []
        self._before, self._last = last, value
        if self.modulus < math.inf:
            self._begun = value // self.modulus * self.modulus
        return [*accepted, (value, line)], refused

    def refuse(self) -> int:
        """Give up the lines that wait; return how many these are."""
        refused, self._waiting = len(self._waiting), []
        return refused

    def _is_near(self, step: float) -> bool:
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
