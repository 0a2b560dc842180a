"""Number guess: what the columns of text are by their numbers, and in which unit, where no heading says it.

Time is the column that increases by equal steps, the specific force the first three columns that are about
1 g long, a magnetic field three whose length is steady, and the angular rate the next three. Its unit cannot
be seen at rest: the likeliest comes first, and the map is in doubt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lab.base.aid_table import FURTHER
from lab.base.arrays import FloatArray
from lab.data.protocols.column_map import IGNORED, OF_A_FIX, UNITS_OF, Column
from lab.data.protocols.labelled_lines import AXES, PERIODS

MIN_LINES = 8
"""Fewest lines with numbers that columns are guessed from: fewer do not show which of them is time."""
_DEFAULT_UNITS = {
    "time": "s", "fraction": "ns", "count": "", "temperature": "°C", "pressure": "Pa", "heading": "°",
    "speed": "m/s", "latitude": "°", "longitude": "°", "altitude": "m", "north": "m/s", "east": "m/s",
    "down": "m/s",
    **{aid.live: aid.unit for aid in FURTHER if aid.live},
}  # fmt: skip
_RATES = (4.0, 4500.0)
"""Rates of samples that time columns are believed to have [Hz]: 1,125 times apart, and the units of time
1,000 times, so any even step has a unit, and only steps of 4 to 4.5 Hz have two."""
_UNEVEN = 20.0
"""Largest step of time, in usual ones. A plain choice: up to 19 lines in a row may be lost. It hardly keeps
out columns that grow by chance: of those with exponential steps, 99 % pass in eight lines, and with 5 instead
of 20 still 75 %."""
_MOST_DEGREES = 360.0
"""Largest longitude in degrees; receivers of u-blox count its ten-millionth parts."""
_AT_SEA = 0.1
"""Larger one of latitude and longitude from which both are in radians if they may be: in degrees they are in
the sea off Africa. Simulators that begin at 0°, 0° stay nearer to it."""
FINE = "1e-4 s"
"""Unit of the time that Xsens calls SampleTimeFine; its Movella DOT counts microseconds under this name."""
GROWS = 0.8
"""Part of the lines in which a time increases, and a column has a number: one of ten may be damaged."""
_ONE_G = {"m/s²": (8.0, 11.8), "g": (0.82, 1.2), "mg": (820.0, 1200.0), "g/256": (210.0, 308.0)}
"""Median length of three columns that are a specific force: a sensor that is held or carried, 20 % off."""
_COUNTS_OF_G = (16384, 8192, 4096, 2048)
"""Counts of 1 g of sensors with 16 bits and ranges of 2, 4, 8 and 16 g (data sheet of the MPU-6050)."""
_COUNTS_OF_RATE = ("131", "65.5", "32.8", "16.4")
"""Counts of 1 °/s of the same sensor with ranges of 250, 500, 1000 and 2000 °/s; the first is its default."""
_FIELDS = {"µT": (15.0, 110.0), "G": (0.15, 1.1), "mG": (150.0, 1100.0)}
"""Median length of three columns that are a magnetic field: the Earth's is 25 to 65 µT, indoors half to 1.7
times."""
_STEADY = 0.1
"""Largest scatter of the length of a magnetic field, relative: iron of 8 µT makes 0.09 of 50 µT that are
turned all around. The length of rates that are only noise scatters by 0.42 (Maxwell's distribution)."""
_FAST = 35.0
"""Angular rate that is not in rad/s: most gyros measure at most 2000 °/s, which are 34.9 rad/s."""
_FASTEST = 4000.0
"""Angular rate that is not in °/s: the largest range of MEMS gyros is 4000 °/s (as of the LSM6DSV16X)."""
_MILLIRADIANS = 50.0
"""Median length of whole numbers from which rates are likelier in m°/s than in mrad/s: see `_AT_REST`."""
_AT_REST = 0.05
"""Median length of rates at rest from which they are likelier in °/s than in rad/s: biases and noise of MEMS
gyros are 0.05 to 5 °/s, which are at most 0.09 rad/s, and rarely more than half of that."""
_OF_SENSORS = 3e-4
"""Error of the length of a quaternion that a sensor computes: its parts have 14 bits (BNO085). Each printed
one adds half a step of its last decimal, four of them at most a step."""
_LAST_DECIMAL = 0.1
"""Step of a number with one decimal."""
_MOST_DECIMALS = 9
"""Most decimals that are told apart."""
_UNLIKE = 3
"""Difference of decimals from which columns are of different quantities: printers without a fixed number
leave out zeros at the end, and by chance two of them in all lines."""
_STILL = 0.01
"""Largest scatter of the specific force of a sensor at rest, in its median length: hands that hold one move
it by 2 % and more."""


def columns_by_numbers(rows: FloatArray, remarks: list[str]) -> list[Column]:
    """Return columns by their numbers; the unit of the rate is left open.

    Parameters
    ----------
    rows : (n, k) array
        The numbers.
    remarks
        Gets a sentence on each column.
    """
    said: list[str] = []
    time = time_column(rows, said)
    columns = _vectors_by_numbers(rows, time, said)
    if time is not None and time[1].quantity == "time":
        # A device that is turned has forces that grow from line to line, too, but not by one in each.
        others: list[str] = []
        without = _vectors_by_numbers(rows, None, others)
        if _count_known(without) > _count_known(columns):
            columns, said = without, others
    remarks += said
    return columns


def _count_known(columns: Sequence[Column]) -> int:
    return sum(column.quantity != IGNORED for column in columns)


def _vectors_by_numbers(
    rows: FloatArray, time: tuple[int, Column] | None, remarks: list[str]
) -> list[Column]:
    columns = [Column()] * rows.shape[1]
    numbers = np.flatnonzero(np.isfinite(rows).mean(axis=0) > GROWS).tolist()
    tags = _tags(rows)
    if time is not None:
        columns[time[0]] = time[1]
        # A second column of times, as of each sensor, is none of a vector.
        steps = np.diff(rows, axis=0)
        tags += np.flatnonzero((steps == steps[:, [time[0]]]).mean(axis=0) > GROWS).tolist()
    numbers = [at for at in numbers if at not in tags]
    free = [three for at in range(len(numbers) - 2) if (three := numbers[at : at + 3])[2] == three[0] + 2]
    parts, sure = _quaternions(rows, numbers)
    free = [three for three in free if _are_printed_alike(rows[:, three]) and not set(three) & sure]
    alike = [three for three in free if _gravity(rows[:, three])]
    # Better than what may be parts of a quaternion, or counts that never change, are others that are as long.
    alike = [three for three in alike if not parts & set(three)] or alike
    alike = [three for three in alike if not _is_fixed(rows[:, three])] or alike
    if not alike:
        return columns
    # Of a level device, the columns beside those of the force are as long: the first are taken.
    # Vectors follow each other: a pressure of 1013 hPa behind two small numbers is as long as 1 g in mg.
    away = [numbers.index(three[0]) - numbers.index(alike[0][0]) for three in alike]
    follow = [three for three, step in zip(alike, away, strict=True) if step < AXES or step % AXES == 0]
    steadiest = min(follow, key=lambda three: _scatter(rows[:, three]))
    is_steadier = _scatter(rows[:, steadiest]) < _scatter(rows[:, alike[0]]) / 2
    force = steadiest if is_steadier else alike[0]
    unit, length = _gravity(rows[:, force]) or ("", 0.0)
    _set_vector(columns, "force", unit, force)
    remarks.append(f"force: columns {_numbers(force)} are {length:.3g} {unit} long, about 1 g.")
    place = {at: number for number, at in enumerate(numbers)}
    start = place[force[0]] % 3
    others = [three for three in free if not set(three) & set(force) and place[three[0]] % 3 == start]
    after = [three for three in others if three[0] > force[0]]
    ahead = [three for three in others[::-1] if three[0] < force[0]]
    others = [three for three in after if not _are_flags(rows[:, three])] or ahead or after
    fields = [_field(rows[:, three]) for three in others[:2]]
    # Rates at rest may be as steady as a field: the next three are rates, unless only they are steady.
    if len(fields) == 2 and fields[0] and not fields[1]:
        others, fields = others[1::-1], fields[1::-1]
    # Some devices send the rates first: then what follows the forces is a field, and steadier.
    before = [three for three in free if three[2] < force[0] and place[three[0]] % 3 == start]
    if fields and fields[0] and before and _scatter(rows[:, others[0]]) < _scatter(rows[:, before[-1]]):
        others, fields = [before[-1], others[0]], [None, fields[0]]
    if others:
        _set_vector(columns, "rate", "", others[0])
        remarks.append(f"rate: a guess: columns {_numbers(others[0])} are the three beside these.")
    if len(fields) == 2 and fields[1]:
        unit, length = fields[1]
        _set_vector(columns, "magnetic", unit, others[1])
        remarks.append(
            f"magnetic: a guess: columns {_numbers(others[1])} are {length:.3g} {unit} long, and steadily."
        )
    second = next((three for three in alike if all(columns[at] == Column() for at in three)), None)
    if second is not None:
        remarks.append(f"Columns {_numbers(second)} are about 1 g long, too, and are not read: a second IMU.")
    return columns


def _tags(rows: FloatArray) -> list[int]:
    """Return the columns that say which sensor the next three are of, such as the 3 and 4 of Android.

    These are different whole numbers that never change, four columns apart.
    """
    first = rows[0]
    fixed = np.flatnonzero((rows == first).all(axis=0) & (first % 1 == 0) & (first > 0)).tolist()
    for at in fixed:
        tags = list(range(at, rows.shape[1], AXES + 1))
        if len(tags) > 1 and set(tags) <= set(fixed) and len({first[tag] for tag in tags}) == len(tags):
            return tags
    return []


def _quaternions(rows: FloatArray, numbers: Sequence[int]) -> tuple[set[int], set[int]]:
    """Return columns that may be parts of a quaternion, and those of them that surely are.

    Three parts of a quaternion are as long as 1 g; but three forces in g beside a rate of zero are as long as
    four parts.
    """
    parts, sure = set(), set()
    for at in range(len(numbers) - 3):
        four = numbers[at : at + 4]
        near = max(_LAST_DECIMAL ** max(_decimals(one) for one in rows[:, four].T), _OF_SENSORS)
        if four[3] == four[0] + 3 and _is_unit(rows[:, four], near):
            parts |= set(four)
            three = _is_unit(rows[:, four[:3]], near) or _is_unit(rows[:, four[1:]], near)
            sure |= set() if three else set(four)
    return parts, sure


def _is_unit(columns: FloatArray, near: float) -> bool:
    """Return whether columns have a length of 1 in every line, but for their rounding."""
    lengths = np.linalg.norm(columns[np.isfinite(columns).all(axis=1)], axis=1)
    return bool(lengths.size and (np.abs(lengths - 1) <= near).all())


def _decimals(column: FloatArray) -> int:
    """Return with how many decimals numbers were printed."""
    known = column[np.isfinite(column)]
    return next(
        (n for n in range(_MOST_DECIMALS) if np.allclose(np.round(known, n), known, 1e-12, 0.0)),
        _MOST_DECIMALS,
    )


def _are_printed_alike(three: FloatArray) -> bool:
    """Return whether three columns have as many decimals or digits, but for a few, as those of a vector do.

    A longitude of six decimals beside two rates of two is as long as 1 g in m/s² at 9° east.
    """
    decimals = np.array([_decimals(one) for one in three.T])
    known = decimals > 0  # of whole numbers, zeros among them, these are not seen
    if not known.any():
        return True
    before = np.ceil(np.log10(np.maximum(np.nanmax(np.abs(three), axis=0), 1.0)))
    return bool(min(np.ptp(decimals[known]), np.ptp((decimals + before)[known])) < _UNLIKE)


def _is_fixed(three: FloatArray) -> bool:
    """Return whether one of three columns of large whole numbers never changes: accelerometers have noise."""
    is_large = bool(np.abs(three).max() > _COUNTS_OF_G[-1] / 2 and (three % 1 == 0).all())
    return is_large and bool((three == three[0]).all(axis=0).any())


def _are_flags(three: FloatArray) -> bool:
    """Return whether two of three columns are whole numbers that never change."""
    fixed = (three == three[0]).all(axis=0) & (three[0] % 1 == 0)
    return int(fixed.sum()) == 2


def _scatter(three: FloatArray) -> float:
    """Return the scatter of the length of three columns, relative."""
    lengths = np.linalg.norm(three[np.isfinite(three).all(axis=1)], axis=1)
    return float(np.std(lengths) / np.mean(lengths)) if lengths.size and np.mean(lengths) > 0 else math.inf


def _gravity(three: FloatArray) -> tuple[str, float] | None:
    """Return the unit in which three columns are a specific force of about 1 g, and their length."""
    found = _match_unit(three, _ONE_G)
    if found is not None or not (three == np.round(three)).all():
        return found
    low, high = _ONE_G["g"]
    return _match_unit(three, {f"g/{count}": (low * count, high * count) for count in _COUNTS_OF_G})


def unit_of_steps(step: float) -> str:
    """Return the unit of a time that grows by a step from line to line; empty if none is believed."""
    return next((unit for unit in ("s", "ms", "µs", "ns") if is_believed(step * UNITS_OF["time"][unit])), "")


def is_believed(step: float) -> bool:
    """Return whether a time is believed to grow by this from sample to sample [s]."""
    return step > 0 and _RATES[0] <= 1 / step <= _RATES[1]


def time_column(
    rows: FloatArray, remarks: list[str], among: Sequence[int] | None = None
) -> tuple[int, Column] | None:
    """Return the first column that increases by equal steps, and what it is; None if none does.

    One that increases by 1 is a counter, whose samples come at a rate of their own.
    """
    if len(rows) < PERIODS:
        return None
    steps = np.diff(rows, axis=0)
    usual = np.median(steps, axis=0)
    counter = None
    for place in range(rows.shape[1]) if among is None else among:
        if not ((steps[:, place] > 0).all() and steps[:, place].max() <= _UNEVEN * usual[place]):
            continue
        if (steps[:, place] == 1).all() and (rows[:, place] % 1 == 0).all():
            counter = place if counter is None else counter
        elif unit := unit_of_steps(float(usual[place])):
            rate = 1 / (usual[place] * UNITS_OF["time"][unit])
            remarks.append(
                f"time: column {place + 1} increases by {usual[place]:.4g} a line: "
                f"{rate:.4g} Hz if it is in {unit}."
            )
            return place, Column("time", unit)
    if counter is None:
        return None
    remarks.append(f"count: column {counter + 1} increases by 1 a line.")
    return counter, Column("count")


def _match_unit(three: FloatArray, ranges: dict[str, tuple[float, float]]) -> tuple[str, float] | None:
    """Return the unit in which three columns have a length within a range, and the length."""
    lengths = np.linalg.norm(three, axis=1)
    length = float(np.median(lengths[np.isfinite(lengths)])) if np.isfinite(lengths).any() else 0.0
    for unit, (low, high) in ranges.items():
        if low <= length <= high:
            return unit, length
    return None


def _field(three: FloatArray) -> tuple[str, float] | None:
    return _match_unit(three, _FIELDS) if _scatter(three) <= _STEADY else None


def _set_vector(columns: list[Column], vector: str, unit: str, places: Sequence[int]) -> None:
    for axis, place in zip("xyz", places, strict=True):
        columns[place] = Column(f"{vector}_{axis}", unit)


def _numbers(places: Sequence[int]) -> str:
    return f"{places[0] + 1} to {places[-1] + 1}"


def with_units(
    columns: Sequence[Column], rows: FloatArray, remarks: list[str]
) -> tuple[list[Column], tuple[str, ...]]:
    """Return the columns with the units that are open chosen by the numbers, and those the rate may have.

    Parameters
    ----------
    columns
        The columns.
    rows : (n, k) array
        The numbers.
    remarks
        Gets a sentence on each guess.
    """
    places = {column.quantity: place for place, column in enumerate(columns)}
    units = {column.kind: column.unit for column in columns if column.unit}
    doubt: tuple[str, ...] = ()

    def three(vector: str) -> FloatArray | None:
        names = [f"{vector}_{axis}" for axis in "xyz"]
        return rows[:, [places[name] for name in names]] if all(name in places for name in names) else None

    force, rate, magnetic = three("force"), three("rate"), three("magnetic")
    if force is not None and "force" not in units:
        units["force"] = (_gravity(force) or ("m/s²", 0.0))[0]
        remarks.append(f"force: a guess: {units['force']}, by its length.")
    if rate is not None and "rate" not in units:
        doubt, why = _units_of_rate(rate, force, units.get("force", ""))
        units["rate"] = doubt[0]
        remarks.append(f"rate: a guess: {doubt[0]}, because {why}.")
        doubt = doubt if len(doubt) > 1 else ()
    if magnetic is not None and "magnetic" not in units:
        units["magnetic"] = (_match_unit(magnetic, _FIELDS) or ("µT", 0.0))[0]
    place = [name for name in OF_A_FIX[:2] if name in places and not units.get(name)]
    most = [float(np.nanmax(np.abs(rows[:, places[name]]), initial=0.0)) for name in place]
    units |= {name: "1e-7°" if one > _MOST_DEGREES else "°" for name, one in zip(place, most, strict=True)}
    if len(most) == 2 and most[0] <= np.pi / 2 and most[1] <= np.pi and max(most) > _AT_SEA:
        units |= dict.fromkeys(place, "rad")
        remarks.append("latitude, longitude: a guess: rad, because in ° they would be in the Gulf of Guinea.")
    whole = [name for name in OF_A_FIX[2:] if name in places and not units.get(name)]
    counts = rows[:, [places[name] for name in whole]]
    if units.get("latitude") == "1e-7°" and (np.isnan(counts) | (counts % 1 == 0)).all():
        units |= {name: "mm" if name == "altitude" else "mm/s" for name in whole}  # as receivers of u-blox
    if "time" in places and "time" not in units:
        steps = np.diff(rows[:, places["time"]])
        units["time"] = unit_of_steps(float(np.nanmedian(steps))) if np.isfinite(steps).any() else ""
        units["time"] = units["time"] or "s"
        remarks.append(f"time: a guess: {units['time']}, by its steps.")
    found_columns = [
        column
        if column.quantity == IGNORED or column.unit
        else Column(column.quantity, units.get(column.kind, _DEFAULT_UNITS.get(column.kind, "")))
        for column in columns
    ]
    return found_columns, doubt


def _units_of_rate(rate: FloatArray, force: FloatArray | None, of_force: str) -> tuple[tuple[str, ...], str]:
    """Return the units that an angular rate may have, the likeliest first, and why that one is."""
    base, _, counts = of_force.partition("/")
    if counts.isdecimal() and int(counts) in _COUNTS_OF_G:
        units = tuple(f"°/s/{count}" for count in _COUNTS_OF_RATE)
        return units, "the numbers are counts, and this is the default of the MPU-6050"
    length = float(np.nanmedian(np.linalg.norm(rate, axis=1))) if np.isfinite(rate).all(axis=1).any() else 0.0
    if base == "mg" and force is not None and not (np.nan_to_num(np.hstack((rate, force))) % 1).any():
        units = ("m°/s", "mrad/s") if length > _MILLIRADIANS else ("mrad/s", "m°/s")
        return (*units, "°/s"), "force and rate are whole numbers"
    is_still = force is not None and _is_still(force)
    fastest = float(np.abs(rate[np.isfinite(rate)]).max(initial=0.0))
    if fastest > _FAST:
        if fastest > _FASTEST or (is_still and length > _FAST):
            return ("m°/s", "mrad/s", "°/s"), f"{length:.0f} °/s would be too fast for this device"
        return ("°/s",), "it is too fast for rad/s"
    if base in ("g", "mg"):
        return ("°/s", "rad/s"), f"the force is in {of_force}"
    units, why = ("rad/s", "°/s"), f"the force is in {of_force or 'an unknown unit'}"
    if is_still and length > _AT_REST:
        why = f"the device is still, and {length:.2g} rad/s would be {np.degrees(length):.0f} °/s"
        units = units[::-1]
    return units, why


def _is_still(force: FloatArray) -> bool:
    """Return whether a specific force (n, 3) is that of a device at rest."""
    known = force[np.isfinite(force).all(axis=1)]
    if len(known) < PERIODS:
        return False
    return bool(np.std(known, axis=0).max() < _STILL * np.linalg.norm(np.median(known, axis=0)))
