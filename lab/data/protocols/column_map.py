"""Column map: what the columns of text lines are, and in which unit; people see it and may correct it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from lab.base.aid_table import FURTHER, SENT
from lab.data.files.unit_names import KIND_OF_SI, UNITS, Factors, unit_of

_AXES = ("x", "y", "z")
VECTORS = ("rate", "force", "magnetic")
"""Quantities with an x, a y and a z."""
CLOCK = "clock"
"""Unit of a time that is written as hours:minutes:seconds."""
OF_FURTHER = {aid.live: KIND_OF_SI[aid.unit] for aid in FURTHER if aid.live}
"""Readings of further sensors of the aid table, and what their units are spelled as."""
UNITS_OF = {
    "time": Factors({**UNITS["time"], CLOCK: 1.0}),
    "fraction": UNITS["time"],
    "count": {"": 1.0},
    "rate": UNITS["angular rate"],
    "force": UNITS["acceleration"],
    "magnetic": Factors({unit: factor / 1e6 for unit, factor in UNITS["magnetic field"].items()}),
    "temperature": Factors({"°C": 1.0}),
    "pressure": UNITS["pressure"],
    "heading": UNITS["angle"],
    "speed": UNITS["speed"],
    "latitude": UNITS["angle"],
    "longitude": UNITS["angle"],
    "altitude": UNITS["length"],
    **dict.fromkeys(("north", "east", "down"), UNITS["speed"]),
    **{name: UNITS[kind] for name, kind in OF_FURTHER.items()},
}
"""Factor to SI of each unit, by quantity."""
_KINDS = {
    "time": "time", "fraction": "time", "rate": "angular rate", "force": "acceleration",
    "magnetic": "magnetic field", "pressure": "pressure", "heading": "angle", "speed": "speed",
    "latitude": "angle", "longitude": "angle", "altitude": "length", "north": "speed", "east": "speed",
    "down": "speed", **OF_FURTHER,
}  # fmt: skip
"""What the units of a quantity are spelled as (`lab.data.files.unit_names`)."""
OF_A_FIX = ("latitude", "longitude", "altitude", "north", "east", "down")
"""Quantities of a receiver: its position, above the sea, and its velocity."""
READINGS = tuple(aid.live for aid in SENT)
"""Quantities that stand alone: readings of sensors besides the IMU."""
IGNORED = "-"
"""Stands for a column that is not read."""
SOURCE = "source"
"""Stands for the column that says which of several devices a line is of; its unit is what stands in the lines
that are read."""
QUANTITIES = (
    "time", "fraction", "count", *(f"{vector}_{axis}" for vector in VECTORS for axis in _AXES),
    "temperature", "pressure", *READINGS, *OF_A_FIX, SOURCE,
)  # fmt: skip
"""What a column may be."""
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
"""What separates columns, by name; blanks may be any number."""

_COLUMN = re.compile(r"\s*([a-z_]+|-)\s*(?:\[([^\]]*)\])?\s*")
_SIGN = re.compile(r"\{\{|\}\}|\\n|\{([^{}]*)\}")
"""In a form of lines: a brace, the end of a line, or a column."""
_NAMES = {mark: name for name, mark in SEPARATORS.items()}
_LINES, _DECIMAL, _AFTER = ";", "decimal comma", "after "
MAX_COLUMNS = 64
"""Most columns of a sample."""


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
        return 1.0 if self.quantity in (IGNORED, SOURCE) else UNITS_OF[self.kind][self.unit]

    def check(self) -> None:
        """Raise a `ColumnMapError` if there is no such quantity, or no such unit of it."""
        if self.quantity == IGNORED or (self.quantity == SOURCE and self.unit):
            return
        if self.quantity == SOURCE:
            raise ColumnMapError(
                "source says which device's lines are read; accepted is what they hold, such as source[2]"
            )
        if self.quantity not in QUANTITIES:
            raise ColumnMapError(
                f"{self.quantity!r} is no quantity; accepted are {', '.join(QUANTITIES)}, and {IGNORED} for "
                "a column that is not read"
            )
        if self.unit not in UNITS_OF[self.kind]:
            raise ColumnMapError(
                f"{self.quantity}: {self.unit!r} is no unit of it; accepted are "
                f"{', '.join(UNITS_OF[self.kind])}"
            )

    @classmethod
    def of(cls, text: str) -> Column:
        """Return the column that a person writes, such as ``force_x[g]``; units may be spelled as in files.

        Raises
        ------
        ColumnMapError
            If this is no column.
        """
        found = _COLUMN.fullmatch(text)
        if found is None:
            raise ColumnMapError(f"{text!r} is no column; accepted is quantity[unit], such as force_x[g]")
        # Files call the field of a magnetometer so.
        name = re.sub(r"^field_(?=[xyz]$)", "magnetic_", found[1])
        column = cls(name)
        return cls(name, spell_unit(column.kind, found[2] or "")) if name != IGNORED else column

    def __str__(self) -> str:
        return f"{self.quantity}[{self.unit}]" if self.unit else self.quantity


def _refuse_parts(names: Sequence[str]) -> None:
    """Raise if a vector lacks an axis, or a position or velocity of a receiver a part."""
    for vector in VECTORS:
        there = [axis for axis in _AXES if f"{vector}_{axis}" in names]
        if there and len(there) < len(_AXES):
            raise ColumnMapError(f"{vector} has only {', '.join(there)}; accepted are all three axes or none")
    for parts in (OF_A_FIX[:2], OF_A_FIX[3:5]):
        there = [one for one in parts if one in names]
        if there and len(there) < len(parts):
            raise ColumnMapError(
                f"only {', '.join(there)} is there; accepted are {', '.join(parts)} together"
            )


def spell_unit(kind: str, unit: str) -> str:
    """Return a unit as `UNITS_OF` has it; one that is none of the quantity is returned as it is.

    Parameters
    ----------
    kind
        The quantity, without its axis.
    unit
        As a person or a file writes it.
    """
    if unit in UNITS_OF.get(kind, {}) or kind not in _KINDS:
        return unit
    return unit_of(_KINDS[kind], unit) or unit


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
    texts : tuple of tuples of str
        Of lines with words between the cells: for each line of a sample, the texts around its cells, one
        more than these. Empty for lines of cells with separators.
    doubt : tuple of str
        Units that the angular rate may have where neither header nor numbers decide, the likeliest first,
        which it has; empty where there is no doubt.
    """

    columns: tuple[Column, ...]
    separator: str = ","
    prefix: str = ""
    decimal_comma: bool = False
    remarks: tuple[str, ...] = field(default=(), compare=False)
    texts: tuple[tuple[str, ...], ...] = ()
    doubt: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        names = [column.quantity for column in self.columns if column.quantity != IGNORED]
        for column in self.columns:
            column.check()
        for name in names:
            if names.count(name) > 1:
                raise ColumnMapError(
                    f"{name} is there more than once; accepted is one column of each quantity"
                )
        _refuse_parts(names)
        if not {"rate_x", "force_x", "latitude"} & set(names):
            raise ColumnMapError(
                "no column is a rate, a force or a latitude; accepted are maps with three of one of the "
                "first two at least, or with a position"
            )
        if self.texts and sum(len(line) - 1 for line in self.texts) != len(self.columns):
            raise ColumnMapError("the form of the lines has another number of cells than there are columns")
        if "fraction" in names and "time" not in names:
            raise ColumnMapError("fraction is a part of a second; accepted is a time beside it")
        if len(self.columns) > MAX_COLUMNS:
            raise ColumnMapError(f"{len(self.columns)} columns; accepted are up to {MAX_COLUMNS}")
        if self.separator not in _NAMES:
            raise ColumnMapError(
                f"{self.separator!r} separates no columns; accepted are {', '.join(SEPARATORS)}"
            )

    @classmethod
    def of(cls, text: str) -> ColumnMap:
        r"""Return the map that a person writes, as ``str`` shows it.

        Columns stand with commas between them, whatever separates them in the lines:
        ``time[ms],force_x[g],-,rate_x[°/s]``. After a semicolon may follow what the lines have that is not
        usual: the name of the separator, ``decimal comma``, and last ``after`` with what each line begins
        with: ``force_x[g],force_y[g],force_z[g];semicolon;decimal comma;after $IMU,``.

        Lines with words between the numbers stand as they are, with the columns in braces and ``\n`` between
        the lines of one sample: ``Accel X: {force_x[g]} Y: {force_y[g]} Z: {force_z[g]}``. A brace of the
        lines themselves is doubled.

        Raises
        ------
        ColumnMapError
            If this is no map.
        """
        if "{" in text:
            return cls._of_form(text)
        names, *lines = text.split(_LINES, 1)
        columns = [Column.of(cell) for cell in names.split(",")]
        return cls(tuple(columns), *_line_form(lines[0] if lines else ""))

    @classmethod
    def _of_form(cls, text: str) -> ColumnMap:
        """Return the map of lines that stand as they are."""
        columns, lines, line, piece, at = [], [], [], "", 0
        for sign in _SIGN.finditer(text):
            piece, at = piece + text[at : sign.start()], sign.end()
            if sign[1] is not None:
                columns.append(Column.of(sign[1]))
                line.append(piece)
                piece = ""
            elif sign[0] == "\\n":
                lines.append((*line, piece))
                line, piece = [], ""
            else:
                piece += sign[0][0]
        lines.append((*line, piece + text[at:]))
        return cls(tuple(columns), texts=tuple(lines))

    @property
    def _form(self) -> str:
        """The lines of a sample, with the columns in braces."""
        columns = iter(self.columns)
        lines = []
        for texts in self.texts:
            plain = [text.replace("{", "{{").replace("}", "}}") for text in texts]
            cells = [f"{text}{{{next(columns)}}}" for text in plain[:-1]]
            lines.append("".join((*cells, plain[-1])))
        return "\\n".join(lines)

    def in_unit(self, kind: str, unit: str) -> ColumnMap:
        """Return the map with the columns of a quantity in a unit, and no doubt about it any more.

        Parameters
        ----------
        kind
            The quantity, without its axis: ``rate``.
        unit
            As a person or a file writes it.

        Raises
        ------
        ColumnMapError
            If no column has the quantity, or it does not have the unit.
        """
        if not any(column.kind == kind for column in self.columns if column.quantity != IGNORED):
            there = dict.fromkeys(column.kind for column in self.columns if column.quantity != IGNORED)
            raise ColumnMapError(f"{kind!r} is no quantity of these columns; accepted are {', '.join(there)}")
        columns = tuple(
            Column(column.quantity, spell_unit(kind, unit)) if column.kind == kind else column
            for column in self.columns
        )
        return replace(self, columns=columns, doubt=() if kind == "rate" else self.doubt)

    def __str__(self) -> str:
        if self.texts:
            return self._form
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
        if self.texts:
            lines = "a line" if len(self.texts) == 1 else f"{len(self.texts)} lines"
            return f"{lines} a sample: {self}"
        before = f" after {self.prefix!r}" if self.prefix else ""
        comma = ", numbers with a decimal comma" if self.decimal_comma else ""
        return f"{len(self.columns)} columns{before}, separated by {_NAMES[self.separator]}{comma}: {self}"


def _line_form(text: str) -> tuple[str, str, bool]:
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
