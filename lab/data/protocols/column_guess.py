"""Column guess: the column map of text lines, found in their header or in their numbers.

A header names columns and units, as that of a csv file does. Without one, time is the column that increases
by equal steps, the specific force the first three columns that are about 1 g long, a magnetic field three
whose length is steady, and the angular rate the next three. Its unit cannot be seen at rest: degrees go with
g, radians with m/s². Each guess says so in a remark.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from lab.base.aid_table import FURTHER
from lab.base.arrays import FloatArray
from lab.data.files.unit_names import unit_of
from lab.data.protocols.column_map import MAX_COLUMNS, SEPARATORS, UNITS_OF, Column, ColumnMap, ColumnMapError
from lab.data.sheets.column_names import heading_of

MIN_LINES = 8
"""Fewest lines with numbers that columns are guessed from: fewer do not show which of them is time."""
NUMBER = r"[+-]?(?:\d{1,15}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][+-]?\d{1,3})?"
_IS_NUMBER = re.compile(NUMBER)
_PREFIX = re.compile(r"[^\d+\-.,;\s]{1,16}[=:]?")
_STREAMED = (
    ("count", "", re.compile(r"count|counter|sample|n|index")),
    ("temperature", "", re.compile(r"temp|temperature|t imu")),
    ("pressure", "pressure", re.compile(r"pres|baro")),
    # A heading without a word is often magnetic, and a speed that of a receiver: both have to be said.
    ("heading", "angle", re.compile(r"true heading|heading true")),
    ("speed", "speed", re.compile(r"(?:wheel|odo|odometer) ?speed|odo|odometer")),
    *((aid.live, "", re.compile(aid.live.replace("_", " "))) for aid in FURTHER if aid.live),
)
"""Names of what only streams have, each with the kind of its unit."""
_SHARED = {"time": "time", "rate": "rate", "force": "force", "field": "magnetic", "pressure": "pressure"}
"""What the quantities are called here whose headings csv files share (`lab.data.sheets.column_names`)."""
_DEFAULT_UNITS = {
    "time": "s", "count": "", "temperature": "°C", "pressure": "Pa", "heading": "°", "speed": "m/s",
    **{aid.live: aid.unit for aid in FURTHER if aid.live},
}  # fmt: skip
_RATES = (4.0, 4500.0)
"""Rates of samples that time columns are believed to have [Hz]: 1,125 times apart, and the units of time
1,000 times, so any even step has a unit, and only steps of 4 to 4.5 Hz have two."""
_UNEVEN = 20.0
"""Largest step of time, in usual ones. A plain choice: up to 19 lines in a row may be lost. It hardly keeps
out columns that grow by chance: of those with exponential steps, 99 % pass in eight lines, and with 5 instead
of 20 still 75 %."""
_AXES = 3
"""Fewest columns of a line, those of a vector; a counter beside fewer others is taken for time."""
_ONE_G = {"m/s²": (8.0, 11.8), "g": (0.82, 1.2), "mg": (820.0, 1200.0), "g/256": (210.0, 308.0)}
"""Median length of three columns that are a specific force: a sensor that is held or carried, 20 % off."""
_FIELDS = {"µT": (15.0, 110.0), "G": (0.15, 1.1), "mG": (150.0, 1100.0)}
"""Median length of three columns that are a magnetic field: the Earth's is 25 to 65 µT, indoors half to 1.7
times."""
_STEADY = 0.1
"""Largest scatter of the length of a magnetic field, relative: iron of 8 µT makes 0.09 of 50 µT that are
turned all around. The length of rates that are only noise scatters by 0.42 (Maxwell's distribution)."""
_FAST = 35.0
"""Angular rate that is not in rad/s: most gyros measure at most 2000 °/s, which are 34.9 rad/s."""
_RAZOR = {
    "#YPRAG=": "-,-,-,force_x[g/256],force_y[g/256],force_z[g/256],rate_x[rad/s],rate_y[rad/s],rate_z[rad/s]",
    "#YPRAMG=": "-,-,-,force_x[g/256],force_y[g/256],force_z[g/256],-,-,-,"
    "rate_x[rad/s],rate_y[rad/s],rate_z[rad/s]",
}
"""Lines of the Razor AHRS firmware, which its prefix names: yaw, pitch, roll, then what its letters say."""


def guess_columns(lines: Sequence[str]) -> ColumnMap | None:
    """Return the column map of lines; None if they do not show it.

    Parameters
    ----------
    lines
        Whole lines, without their ends; the header, if they have one, among them.
    """
    for prefix, columns in _RAZOR.items():
        count = columns.count(",") + 1
        if sum(line.startswith(prefix) and line.count(",") == count - 1 for line in lines) >= MIN_LINES:
            found = ColumnMap.of(columns)
            remark = f"{prefix} is the Razor AHRS firmware's: accelerations in 1/256 g, rates in rad/s."
            return ColumnMap(found.columns, ",", prefix, False, (remark,))
    shape = _shape(lines)
    if shape is None:
        return None
    separator, prefix, comma, rows = shape
    headings = _header(lines, separator, rows.shape[1])
    remarks: list[str] = []
    columns_found = _named(headings, remarks) if headings else None
    if columns_found is None or not any(column.kind in ("rate", "force") for column in columns_found):
        columns_found = _columns_by_numbers(rows, remarks) if len(rows) >= MIN_LINES else None
    if columns_found is None:
        return None
    columns_found = _with_units(columns_found, rows, remarks)
    try:
        return ColumnMap(tuple(columns_found), separator, prefix, comma, tuple(remarks))
    except ColumnMapError:
        return None


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line; one after the last separator that is empty is left out."""
    cells = line.split() if separator == " " else [cell.strip() for cell in line.split(separator)]
    return cells[:-1] if cells and not cells[-1] else cells


def _shape(lines: Sequence[str]) -> tuple[str, str, bool, FloatArray] | None:
    """Return separator, prefix, whether numbers have a comma, and the numbers of most lines."""
    best = None
    for separator in SEPARATORS.values():
        for comma in (False, True) if separator in ";\t" else (False,):
            rows, prefixes = [], Counter[str]()
            for line in lines:
                found = _PREFIX.match(line)
                prefix = found[0] if found else ""
                cells = cells_of(line[len(prefix) :], separator)
                if comma:
                    cells = [cell.replace(",", ".") for cell in cells]
                if _AXES <= len(cells) <= MAX_COLUMNS and all(_IS_NUMBER.fullmatch(cell) for cell in cells):
                    rows.append([float(cell) for cell in cells])
                    prefixes[prefix] += 1
            if not rows:
                continue
            count = Counter(map(len, rows)).most_common(1)[0][0]
            kept = [row for row in rows if len(row) == count]
            if best is None or len(kept) * count > best[3].size:
                best = separator, prefixes.most_common(1)[0][0], comma, np.array(kept)
    return best


def _header(lines: Sequence[str], separator: str, count: int) -> list[str] | None:
    """Return the headings of the last line with the right number of cells, of which none is a number."""
    for line in reversed(lines):
        cells = [
            cell.strip(" \"'\ufeff")
            for cell in line.lstrip("#% ").split(separator if separator != " " else None)
        ]
        cells = cells[:-1] if cells and not cells[-1] else cells
        if len(cells) == count and all(cell and not _IS_NUMBER.fullmatch(cell) for cell in cells):
            return cells
    return None


def _named(headings: Sequence[str], remarks: list[str]) -> list[Column]:
    """Return columns by their headings; a unit that is not named is left open."""
    found = [_quantity(heading) for heading in headings]
    best: dict[str, int] = {}  # the place of the best column of each quantity
    for place, (quantity, _unit_name, rank) in enumerate(found):
        if quantity != "-" and (quantity not in best or rank < found[best[quantity]][2]):
            best[quantity] = place
    for quantity, place in sorted(best.items(), key=lambda item: item[1]):
        remarks.append(f"{quantity}: the heading is {headings[place]!r}.")
    return [
        Column(quantity, unit) if best.get(quantity) == place else Column()
        for place, (quantity, unit, _rank) in enumerate(found)
    ]


def _quantity(heading: str) -> tuple[str, str, int]:
    """Return the quantity, unit and rank of a heading; the lowest rank is the best of one quantity."""
    stem, _, unit = heading.rstrip(")] ").replace("[", "(").partition("(")
    name = stem.replace("_", " ").strip().lower()
    for quantity, kind, pattern in _STREAMED:
        if pattern.fullmatch(name):
            return quantity, unit_of(kind, unit) if kind else "", 0
    named = heading_of(heading)
    if named is None or named.quantity not in _SHARED:
        return "-", "", 0
    ours = _SHARED[named.quantity]
    return f"{ours}_{named.axis}" if named.axis else ours, named.unit, named.rank


def _columns_by_numbers(rows: FloatArray, remarks: list[str]) -> list[Column]:
    """Return columns by their numbers; the unit of the rate is left open."""
    columns = [Column()] * rows.shape[1]
    time = _time(rows, remarks)
    if time is not None:
        columns[time[0]] = Column("time", time[1])
    free = [[at, at + 1, at + 2] for at in range(rows.shape[1] - 2)]
    if time is not None:
        free = [three for three in free if time[0] not in three]
    force = next((three for three in free if _matched(rows[:, three], _ONE_G)), None)
    if force is None:
        return columns
    unit, length = _matched(rows[:, force], _ONE_G) or ("", 0.0)
    _put(columns, "force", unit, force)
    remarks.append(f"force: columns {_numbers(force)} are {length:.3g} {unit} long, about 1 g.")
    start = force[0] % 3
    others = [three for three in free if not set(three) & set(force) and three[0] % 3 == start]
    others = [three for three in others if three[0] > force[0]] or others[::-1]
    fields = [_field(rows[:, three]) for three in others[:2]]
    # Rates at rest may be as steady as a field: the next three are rates, unless only they are steady.
    if len(fields) == 2 and fields[0] and not fields[1]:
        others, fields = others[1::-1], fields[1::-1]
    if others:
        _put(columns, "rate", "", others[0])
        remarks.append(f"rate: a guess: columns {_numbers(others[0])} are the next three.")
    if len(fields) == 2 and fields[1]:
        unit, length = fields[1]
        _put(columns, "magnetic", unit, others[1])
        remarks.append(
            f"magnetic: a guess: columns {_numbers(others[1])} are {length:.3g} {unit} long, and steadily."
        )
    return columns


def _time(rows: FloatArray, remarks: list[str]) -> tuple[int, str] | None:
    steps = np.diff(rows, axis=0)
    usual = np.median(steps, axis=0)
    for place in range(rows.shape[1]):
        if not ((steps[:, place] > 0).all() and steps[:, place].max() <= _UNEVEN * usual[place]):
            continue
        if (steps[:, place] == 1).all() and rows.shape[1] > _AXES and _other_time(steps, place):
            continue
        for unit in ("s", "ms", "µs", "ns"):
            rate = 1 / (usual[place] * UNITS_OF["time"][unit])
            if _RATES[0] <= rate <= _RATES[1]:
                remarks.append(
                    f"time: column {place + 1} increases by {usual[place]:.4g} a line: "
                    f"{rate:.4g} Hz if it is in {unit}."
                )
                return place, unit
    return None


def _other_time(steps: FloatArray, place: int) -> bool:
    others = np.delete(steps, place, axis=1)
    return bool((others > 0).all(axis=0).any())


def _matched(three: FloatArray, ranges: dict[str, tuple[float, float]]) -> tuple[str, float] | None:
    """Return the unit in which three columns have a length within a range, and the length."""
    length = float(np.median(np.linalg.norm(three, axis=1)))
    for unit, (low, high) in ranges.items():
        if low <= length <= high:
            return unit, length
    return None


def _field(three: FloatArray) -> tuple[str, float] | None:
    lengths = np.linalg.norm(three, axis=1)
    return _matched(three, _FIELDS) if np.std(lengths) <= _STEADY * np.mean(lengths) else None


def _put(columns: list[Column], vector: str, unit: str, places: Sequence[int]) -> None:
    for axis, place in zip("xyz", places, strict=True):
        columns[place] = Column(f"{vector}_{axis}", unit)


def _numbers(places: Sequence[int]) -> str:
    return f"{places[0] + 1} to {places[-1] + 1}"


def _with_units(columns: Sequence[Column], rows: FloatArray, remarks: list[str]) -> list[Column]:
    """Return the columns with the units that are open chosen by the numbers."""
    places = {column.quantity: place for place, column in enumerate(columns)}
    units = {column.kind: column.unit for column in columns if column.unit}

    def three(vector: str) -> FloatArray | None:
        names = [f"{vector}_{axis}" for axis in "xyz"]
        return rows[:, [places[name] for name in names]] if all(name in places for name in names) else None

    force, rate, magnetic = three("force"), three("rate"), three("magnetic")
    if force is not None and "force" not in units:
        units["force"] = (_matched(force, _ONE_G) or ("m/s²", 0.0))[0]
        remarks.append(f"force: a guess: {units['force']}, by its length.")
    if rate is not None and "rate" not in units:
        fast = np.abs(rate).max(initial=0.0) > _FAST
        units["rate"] = "°/s" if fast or units.get("force", "") in ("g", "mg") else "rad/s"
        why = (
            "it is too fast for rad/s" if fast else f"the force is in {units.get('force', 'an unknown unit')}"
        )
        remarks.append(f"rate: a guess: {units['rate']}, because {why}.")
    if magnetic is not None and "magnetic" not in units:
        units["magnetic"] = (_matched(magnetic, _FIELDS) or ("µT", 0.0))[0]
    if "time" in places and "time" not in units:
        found = _time(rows[:, [places["time"]]], [])
        units["time"] = found[1] if found else "s"
        remarks.append(f"time: a guess: {units['time']}, by its steps.")
    return [
        column
        if column.quantity == "-" or column.unit
        else Column(column.quantity, units.get(column.kind, _DEFAULT_UNITS.get(column.kind, "")))
        for column in columns
    ]
