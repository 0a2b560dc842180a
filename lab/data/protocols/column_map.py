"""Column map: what the columns of text lines are, and in which unit; people see it and may correct it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from lab.base.aid_table import FURTHER, SENT
from lab.data.files.unit_names import UNITS, Factors

_AXES = ("x", "y", "z")
VECTORS = ("rate", "force", "magnetic")
"""Quantities with an x, a y and a z."""
UNITS_OF = {
    "time": UNITS["time"],
    "count": {"": 1.0},
    "rate": UNITS["angular rate"],
    "force": UNITS["acceleration"],
    "magnetic": Factors({unit: factor / 1e6 for unit, factor in UNITS["magnetic field"].items()}),
    "temperature": {"°C": 1.0},
    "pressure": UNITS["pressure"],
    "heading": UNITS["angle"],
    "speed": UNITS["speed"],
    **{aid.live: {aid.unit: 1.0} for aid in FURTHER if aid.live},
}
"""Factor to SI of each unit, by quantity."""
READINGS = tuple(aid.live for aid in SENT)
"""Quantities that stand alone: readings of sensors besides the IMU."""
QUANTITIES = (
    "time", "count", *(f"{vector}_{axis}" for vector in VECTORS for axis in _AXES), "temperature", "pressure",
    *READINGS,
)  # fmt: skip
"""What a column may be."""
IGNORED = "-"
"""Stands for a column that is not read."""
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
"""What separates columns, by name; blanks may be any number."""

_COLUMN = re.compile(r"\s*([a-z_]+|-)\s*(?:\[([^\]]*)\])?\s*")
_NAMES = {mark: name for name, mark in SEPARATORS.items()}
_LINES, _DECIMAL, _AFTER = ";", "decimal comma", "after "
MAX_COLUMNS = 64
"""Most columns of a line."""


class ColumnMapError(ValueError):
    """A text is no column map; the message says why and what is accepted."""


@dataclass(frozen=True)
class Column:
    """A column.

    Attributes
    ----------
    quantity : str
        One of `QUANTITIES`, or `IGNORED`.
    unit : str
        As in `UNITS_OF`.
    """

    quantity: str = IGNORED
    unit: str = ""

    @property
    def kind(self) -> str:
        """The quantity without its axis."""
        return (
            self.quantity if self.quantity in READINGS else self.quantity.rpartition("_")[0] or self.quantity
        )

    @property
    def scale(self) -> float:
        """Factor to SI."""
        return 1.0 if self.quantity == IGNORED else UNITS_OF[self.kind][self.unit]

    def __str__(self) -> str:
        return f"{self.quantity}[{self.unit}]" if self.unit else self.quantity


@dataclass(frozen=True)
class ColumnMap:
    """The columns of text lines.

    Attributes
    ----------
    columns : tuple of Column
        From the left.
    separator : str
        What separates them, a value of `SEPARATORS`.
    prefix : str
        What stands before the first column in every line.
    decimal_comma : bool
        Whether numbers are written with a comma.
    remarks : tuple of str
        Why each was taken for what it is; those that are guesses say so.
    """

    columns: tuple[Column, ...]
    separator: str = ","
    prefix: str = ""
    decimal_comma: bool = False
    remarks: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        names = [column.quantity for column in self.columns if column.quantity != IGNORED]
        for column in self.columns:
            if column.quantity != IGNORED and column.quantity not in QUANTITIES:
                raise ColumnMapError(
                    f"{column.quantity!r} is no quantity; accepted are {', '.join(QUANTITIES)}, and "
                    f"{IGNORED} for a column that is not read"
                )
            if column.quantity != IGNORED and column.unit not in UNITS_OF[column.kind]:
                raise ColumnMapError(
                    f"{column.quantity}: {column.unit!r} is no unit of it; accepted are "
                    f"{', '.join(UNITS_OF[column.kind])}"
                )
        for name in names:
            if names.count(name) > 1:
                raise ColumnMapError(
                    f"{name} is there more than once; accepted is one column of each quantity"
                )
        for vector in VECTORS:
            there = [axis for axis in _AXES if f"{vector}_{axis}" in names]
            if there and len(there) < len(_AXES):
                raise ColumnMapError(
                    f"{vector} has only {', '.join(there)}; accepted are all three axes or none"
                )
        if not {"rate_x", "force_x"} & set(names):
            raise ColumnMapError(
                "no column is a rate or a force; accepted are maps with three of one of them at least"
            )
        if len(self.columns) > MAX_COLUMNS:
            raise ColumnMapError(f"{len(self.columns)} columns; accepted are up to {MAX_COLUMNS}")
        if self.separator not in _NAMES:
            raise ColumnMapError(
                f"{self.separator!r} separates no columns; accepted are {', '.join(SEPARATORS)}"
            )

    @classmethod
    def of(cls, text: str) -> ColumnMap:
        """Return the map that a person writes, as ``str`` shows it.

        Columns stand with commas between them, whatever separates them in the lines:
        ``time[ms],force_x[g],-,rate_x[°/s]``. After a semicolon may follow what the lines have that is not
        usual: the name of the separator, ``decimal comma``, and last ``after`` with what each line begins
        with: ``force_x[g],force_y[g],force_z[g];semicolon;decimal comma;after $IMU,``.

        Raises
        ------
        ColumnMapError
            If this is no map.
        """
        names, *lines = text.split(_LINES, 1)
        columns = []
        for cell in names.split(","):
            found = _COLUMN.fullmatch(cell)
            if found is None:
                raise ColumnMapError(f"{cell!r} is no column; accepted is quantity[unit], such as force_x[g]")
            columns.append(Column(found[1], found[2] or ""))
        return cls(tuple(columns), *_lines_of(lines[0] if lines else ""))

    def __str__(self) -> str:
        parts = [",".join(map(str, self.columns))]
        if self.separator != SEPARATORS["comma"]:
            parts.append(_NAMES[self.separator])
        if self.decimal_comma:
            parts.append(_DECIMAL)
        if self.prefix:
            parts.append(f"{_AFTER}{self.prefix}")
        return _LINES.join(parts)

    @property
    def described(self) -> str:
        """The map in a sentence."""
        before = f" after {self.prefix!r}" if self.prefix else ""
        comma = ", numbers with a decimal comma" if self.decimal_comma else ""
        return f"{len(self.columns)} columns{before}, separated by {_NAMES[self.separator]}{comma}: {self}"


def _lines_of(text: str) -> tuple[str, str, bool]:
    """Return separator, prefix, and whether numbers have a comma, of what stands after the columns."""
    words, _, prefix = text.partition(_AFTER)
    separator, decimal_comma = SEPARATORS["comma"], False
    for word in filter(None, (one.strip() for one in words.split(_LINES))):
        if word in SEPARATORS:
            separator = SEPARATORS[word]
        elif word == _DECIMAL:
            decimal_comma = True
        else:
            raise ColumnMapError(
                f"{word!r} says nothing about the lines; accepted are {', '.join(SEPARATORS)}, {_DECIMAL}, "
                f"and {_AFTER.strip()} with what each line begins with"
            )
    return separator, prefix, decimal_comma
