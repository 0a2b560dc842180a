"""Sheet IMU: gyros and accelerometers out of the sheets of a log, at common times, with a report.

Of several sensors the one that its heading recommends is taken. An accelerometer has gravity in it: phones
also write accelerations without it, which are used only together with their direction of gravity.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DEGREE, STANDARD_GRAVITY
from lab.data.clock.coarse_stamps import smooth
from lab.data.clock.faults import increasing, is_regular, set_backs
from lab.data.clock.stamps import ACCEPTED, ZONES
from lab.data.files.unit_names import UNITS
from lab.data.log.log_remarks import span_text
from lab.data.sheets.column_names import GIVEN, VECTORS, Heading
from lab.data.sheets.column_words import SENSORS, WORSE
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_clock import Clock, find_clock

_ONE_G = (0.6, 1.6)
"""Median length of a specific force [g]: of a vehicle, a walker or a hand it is near 1."""
NAMED = "named in the heading"
"""How the unit of a column is known that its heading, or a person, states."""
_STEADY = 0.9
"""Length of the median vector over the median length from which accelerations of an unknown unit hold
gravity. Measured in motion: 0.98 and more on six real logs, up to 0.69 on the same without gravity."""
_FORCE_UNITS = ("m/s²", "g", "mg")
_FASTEST = 35.0
"""Angular rate that no vehicle has [rad/s]: larger numbers are in °/s."""
_FASTEST_DEGREES = 4000.0
"""Largest range of a MEMS gyro [°/s]: larger numbers beside mg are m°/s."""
_SLOW_DEGREES = 0.15
"""Angular rate below which numbers are no °/s of a moving vehicle: seven real logs have 0.21 °/s and more."""
_RESTLESS = 0.2
"""σ of the size of the specific force from which a vehicle moves or shakes [m/s²]; at rest it is noise."""
_COUNTED = {"acc smooth", "acc adc"}
"""Accelerometers of Betaflight and INAV, which count; how many counts are 1 g depends on the board."""
_COUNTS = (256, 512, 1024, 2048, 4096)
"""Counts that are 1 g on the boards of these: a range of ±8 or ±16 g in 12 to 16 bits."""
_RAW_COUNTS = (1024, 2048, 4096, 8192, 16384)
"""Counts that are 1 g of a MEMS of ±2 to ±32 g in 16 bits, as the MPU-6050 (its register map, ACCEL_XOUT)."""
_LIKE_COUNTS = 0.2
"""Largest deviation of the size from such a number, as a logarithm: the motion adds to gravity."""
_MAX_APART = 2.5
"""Longest interval between samples of an accelerometer, in usual ones, over which it is interpolated."""
_TOGETHER = 0.5
"""Part of the rows with one sensor only, below which gyros and accelerometers share their rows."""
_NUMBERS = re.compile(r"\d+")
_SENSOR_WORDS = SENSORS["gyro"] | SENSORS["accelerometer"]
_ANOTHER_DEVICE = re.compile(r"(?i)wrist|watch|headphone|airpods")
"""Names of tables that an app of a phone writes of another device with an IMU or receiver of its own."""
_JITTERS = 0.01
"""Part of the rows that are out of order from which the stamps jitter, unless sorting makes them regular."""
_MAX_BACK = 2.0
"""Largest displacement of a row in time that is sorted [s]: loggers write batches; more is
a restart."""


class Triad(NamedTuple):
    """A sensor with three axes.

    Attributes
    ----------
    sheet : Sheet
        The sheet it is in.
    clock : Clock
        Time stamps of the sheet.
    values : (n, 3) array
        Its numbers, in SI units.
    headings : tuple of Heading
        Its columns, x, y, z.
    unit : str
        Their unit.
    source : str
        How the unit is known.
    """

    sheet: Sheet
    clock: Clock
    values: FloatArray
    headings: tuple[Heading, ...]
    unit: str
    source: str

    @property
    def place(self) -> str:
        """The first of its columns, and where it stands."""
        return f"{self.headings[0].text} of {self.sheet.name}"

    @property
    def report(self) -> str:
        """Sentence about the columns and their unit."""
        names = ", ".join(f"{'-' if one.sign < 0 else ''}{one.text}" for one in self.headings)
        return f"{names} of {self.sheet.name}, in {self.unit} ({self.source})"


class Imu(NamedTuple):
    """Samples of an IMU in its own axes.

    Attributes
    ----------
    time : (n,) array
        Time stamps, increasing [s].
    samples : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²]; NaN where one is unknown.
    gyro, accelerometer : Triad
        Where they are from.
    remarks : tuple of str
        The report.
    """

    time: FloatArray
    samples: FloatArray
    gyro: Triad
    accelerometer: Triad
    remarks: tuple[str, ...]


def find_imu(sheets: Sequence[Sheet]) -> Imu:
    """Return the IMU of a log.

    Raises
    ------
    MissionError
        If there are no gyros or accelerometers, or the accelerations are without gravity, or in an unknown
        unit.
    """
    gyros, forces = triads(sheets, "rate"), triads(sheets, "force")
    if not gyros or not forces:
        raise MissionError(_what_is_missing(sheets, bool(gyros), bool(forces)))
    force, remarks = _with_gravity(forces, triads(sheets, "gravity"))
    gyro = _gyro(min(gyros, key=lambda one: _differ(one, force)), force)
    time, samples, merged = _merge_samples(gyro, force)
    for what, taken, all_ in (("gyros", gyro, gyros), ("accelerometers", force, forces)):
        if others := [
            one.place for one in all_ if one.headings != taken.headings or one.sheet is not taken.sheet
        ]:
            remarks.append(f"Other {what} in the files are not used: {', '.join(others)}.")
    lines = [f"Gyros: {gyro.report}.", f"Accelerometers: {force.report}.", gyro.clock.report("IMU")]
    return Imu(time, samples, gyro, force, (*lines, *remarks, *merged))


def _differ(gyro: Triad, force: Triad) -> tuple[bool, bool]:
    """Return whether two sensors differ in sheet or numbers, and in the place that their headings name."""
    numbers = [_NUMBERS.findall(one.headings[0].sensor) for one in (gyro, force)]
    places = [
        {word for word in one.headings[0].sensor.lower().split() if word not in _SENSOR_WORDS | WORSE.keys()}
        for one in (gyro, force)
    ]
    return gyro.sheet is not force.sheet or numbers[0] != numbers[1], places[0] != places[1]


def in_order(time: FloatArray, what: str) -> tuple[NDArray[np.intp], FloatArray, list[str]]:
    """Return rows with a time, in order if they are only a little out of it, their times, and a report."""
    rows = np.flatnonzero(np.isfinite(time))
    late = np.maximum.accumulate(time[rows]) - time[rows] if rows.size else np.empty(0)
    count = int((late > 0).sum())
    if not count or late.max() > _MAX_BACK:
        return rows, time[rows], []
    if steps := set_backs(time[rows]):
        kept = increasing(time[rows])
        sizes = " and ".join(
            f"by {size:.3f} s at {time[rows][row - 1] - time[rows][0]:.2f} s" for row, size in steps
        )
        remark = (
            f"The clock of the {what} was set back {sizes}: the {(~kept).sum()} rows behind it are left out."
        )
        return rows[kept], time[rows][kept], [remark]
    back = f"by up to {late.max():.3g} s"
    ordered = rows[np.argsort(time[rows], kind="stable")]
    if count < _JITTERS * rows.size or is_regular(time[ordered]):
        remark = f"{count} rows of the {what} were out of order {back} and were sorted."
        return ordered, time[ordered], [remark]
    even = smooth(time[rows])
    remark = (
        f"The time stamps of the {what} jitter and run backwards {back}: a moving average of them is used, "
        "in the order of the rows."
    )
    return (rows, even, [remark]) if (np.diff(even) > 0).all() else (rows, time[rows], [])


def triads(sheets: Sequence[Sheet], quantity: str) -> list[Triad]:
    """Return all complete sensors of a quantity, the best first; numbers are not in SI units yet."""
    found = []
    for sheet in sheets:
        names = dict.fromkeys(one.sensor for one in sheet.headings if one.quantity == quantity)
        clock = find_clock(sheet, fast=True) if names else None
        for sensor in names:
            # Axes that a person names complete those of a sensor.
            axes = {
                one.axis: (one, values)
                for one, values in sheet.all_of(quantity)[::-1]
                if one.sensor in (sensor, GIVEN)
            }
            if clock is None or len(axes) < len("xyz"):
                continue
            headings = tuple(axes[axis][0] for axis in "xyz")
            named = next((one for one in headings if one.unit), headings[0])
            # Columns without a unit have that of the first one that names it.
            factors = UNITS[named.kind]
            values = np.column_stack(
                [
                    one.sign * (factors[one.unit] / factors[named.unit] if one.unit else 1.0) * numbers
                    for one, numbers in (axes[axis] for axis in "xyz")
                ]
            )
            if np.isfinite(values).all(axis=1).any():
                found.append(Triad(sheet, clock, values, headings, named.unit, named.source))
    return sorted(
        found,
        key=lambda one: (
            is_of_another_device(one.sheet),
            one.headings[0].rank,
            -np.isfinite(one.values[:, 0]).sum(),
        ),
    )


def is_of_another_device(sheet: Sheet) -> bool:
    """Return whether a table is of what is worn beside the phone that recorded it."""
    return _ANOTHER_DEVICE.search(sheet.name) is not None


def _scale_triad(triad: Triad, unit: str, source: str) -> Triad:
    factor = UNITS[VECTORS[triad.headings[0].quantity]][unit]
    return triad._replace(values=triad.values * factor, unit=unit, source=source)


def _length(triad: Triad) -> float:
    return float(np.nanmedian(np.linalg.norm(triad.values, axis=1)))


def _is_steady(triad: Triad) -> bool:
    """Return whether a vector points one way, as gravity makes it: without gravity it has no direction."""
    mean = float(np.linalg.norm(np.nanmedian(triad.values, axis=0)))
    return mean > _STEADY * _length(triad)


OF_MOTION = "guessed by the motion"
"""How a unit is known that only the changes of the fixes can bear out."""
_AT_REST = (0.93, 1.07)
"""Length of a specific force at rest [g]: MEMS have biases of 20 to 50 mg."""
_QUIET = 0.03
"""σ of the samples within a second at rest, over g: idling engines shake by 0.02 g."""
_REST_BLOCK = 1.0
"""Length of a block that is at rest or not [s]."""
_REST_BLOCKS = 3
"""Fewest such blocks at rest."""
_CALMEST = 0.1
"""Part of the blocks that are the calmest ones: a lap of two minutes begins with some ten seconds at rest."""
_MAX_BLOCKS = 3600
"""Most blocks that are looked at."""


def _length_at_rest(triad: Triad, unit: str) -> float:
    """Return how long a vector of an unknown unit is at rest [g]; 0 if that is not gravity.

    Without gravity it would be nearly 0 then.
    """
    known = np.isfinite(triad.values).all(axis=1) & np.isfinite(triad.clock.time)
    values = triad.values[known] * UNITS["acceleration"][unit] / STANDARD_GRAVITY
    step = float(np.median(np.diff(triad.clock.time[known]))) if len(values) > 1 else 0.0
    count = max(2, round(_REST_BLOCK / step)) if step > 0 else len(values) + 1
    blocks = values[: len(values) // count * count].reshape(-1, count, 3)[:_MAX_BLOCKS]
    if len(blocks) < _REST_BLOCKS:
        return 0.0
    mean, shaken = blocks.mean(axis=1), blocks.std(axis=1).max(axis=1)
    calmest = np.argsort(shaken, kind="stable")[: max(_REST_BLOCKS, round(_CALMEST * len(blocks)))]
    for rest in (np.arange(_REST_BLOCKS), calmest):
        size, one_way = np.linalg.norm(mean[rest], axis=1), np.linalg.norm(mean[rest].mean(axis=0))
        inside = (size > _AT_REST[0]) & (size < _AT_REST[1])
        if inside.all() and (shaken[rest] < _QUIET).all() and one_way > _STEADY * size.mean():
            return float(one_way)
    return 0.0


def _with_gravity(forces: Sequence[Triad], gravity: Sequence[Triad]) -> tuple[Triad, list[str]]:
    """Return the first accelerometer with gravity in it, in m/s²; or one without, with gravity added."""
    for guess in _FORCE_UNITS:
        for triad in forces:
            unit = triad.unit or guess
            size = _length(triad) * UNITS["acceleration"][unit] / STANDARD_GRAVITY
            if _ONE_G[0] < size < _ONE_G[1] and (triad.unit or _is_steady(triad)):
                source = triad.source if triad.unit else f"guessed: it is {size:.3g} g long"
                return _scale_triad(triad, unit, source), []
    for triad in forces:
        for unit in () if triad.unit else _FORCE_UNITS:
            if size := _length_at_rest(triad, unit):
                return _scale_triad(triad, unit, f"guessed: at rest it is {size:.3g} g long"), []
    bare = forces[0]
    size, unit = _length(bare), bare.unit or "m/s²"
    beside = next((one for one in gravity if one.sheet is bare.sheet), gravity[0] if gravity else None)
    if beside is not None and (factor := _gravity_factor(beside)):
        total = _scale_triad(bare, unit, bare.source if bare.unit else "assumed")
        added = _interpolate_values(beside.clock.time, beside.values * factor, bare.clock.time)
        return total._replace(values=total.values + added), [
            f"These accelerations are without gravity; {beside.headings[0].text} to "
            f"{beside.headings[2].text} of {beside.sheet.name} was added."
        ]
    counts = min(_COUNTS, key=lambda one: abs(np.log(size / one)))
    if bare.headings[0].sensor in _COUNTED and abs(np.log(size / counts)) < _LIKE_COUNTS:
        values = bare.values * STANDARD_GRAVITY / counts
        source = f"guessed: it is {size:.4g} long"
        return bare._replace(values=values, unit=f"counts, {counts} of which are 1 g", source=source), []
    fitting = [
        other for other in _FORCE_UNITS
        if _ONE_G[0] < size * UNITS["acceleration"][other] / STANDARD_GRAVITY < _ONE_G[1]
    ]  # fmt: skip
    where = f"{bare.sheet.name}, columns {bare.headings[0].text} to {bare.headings[2].text}"
    if bare.unit and fitting and _is_steady(bare):
        raise MissionError(
            f"{where}: the accelerometers measure {size:.3g} {unit} (median), but gravity is 9.81 m/s²: the "
            f"numbers look like {fitting[0]}, although the heading names {unit}; state the unit"
        )
    if not bare.unit and fitting and fitting[0] != unit and not gravity:
        return _scale_triad(bare, fitting[0], f"{OF_MOTION}: it is {size:.3g} {fitting[0]} long"), []
    if size * UNITS["acceleration"][unit] < _ONE_G[0] * STANDARD_GRAVITY or not _is_steady(bare):
        raise MissionError(without_gravity(_scale_triad(bare, unit, "")))
    raise MissionError(
        f"{where}: the accelerometers measure {size:.3g} (median), which is gravity in none of the units "
        f"{', '.join(_FORCE_UNITS)}: the numbers may be raw counts; accepted are numbers with a unit"
        f"{_count_options(bare, size)}"
    )


def _count_options(force: Triad, size: float) -> str:
    """Return the options that make accelerations counts of a usual range of a MEMS; empty if none fits."""
    counts = min(_RAW_COUNTS, key=lambda one: abs(np.log(size / one)))
    if abs(np.log(size / counts)) > _LIKE_COUNTS or force.unit:
        return ""
    options = " ".join(f'--unit "{one.text}=g/{counts}"' for one in force.headings)
    return (
        f". Gravity is near {counts} counts, as of a MEMS of 16 bits: {options} says so, and the unit of the "
        "gyros is likely to be °/s over a number of counts, too"
    )


def without_gravity(force: Triad) -> str:
    """Return why accelerations of an unknown unit are not used, in which gravity does not show.

    Parameters
    ----------
    force
        The accelerations in SI units, with the unit in which they were read.
    """
    size = _length(force) / UNITS["acceleration"][force.unit]
    named = any(one.unit for one in force.headings)
    first = force.headings[0].text
    hint = f'. If they have gravity in them, state their unit: --unit "{first}=g", y and z alike'
    return (
        f"{force.sheet.name}, columns {first} to {force.headings[2].text}: the accelerations are "
        f"{size:.3g} {force.unit} long (median), so they are without gravity; accepted is specific force "
        "with gravity, which phones call accelerometer with g or total acceleration, or the columns of "
        f"gravity beside{'' if named else hint}"
    )


def _gravity_factor(gravity: Triad) -> float:
    size = _length(gravity)
    units = (gravity.unit,) if gravity.unit else _FORCE_UNITS
    factors = [UNITS["acceleration"][unit] for unit in units]
    return next((one for one in factors if _ONE_G[0] < size * one / STANDARD_GRAVITY < _ONE_G[1]), 0.0)


def _is_moving(force: Triad) -> bool:
    """Return whether the specific force changes as on a vehicle in motion."""
    return float(np.nanstd(np.linalg.norm(force.values, axis=1))) > _RESTLESS


def _gyro(gyro: Triad, force: Triad) -> Triad:
    if gyro.unit:
        return _scale_triad(gyro, gyro.unit, gyro.source)
    largest = float(np.nanmax(np.abs(gyro.values)))
    if largest > _FASTEST_DEGREES and force.unit == "mg":
        return _scale_triad(gyro, "m°/s", f"guessed: {largest:.3g} is too fast for °/s")
    if largest > _FASTEST:
        return _scale_triad(gyro, "°/s", f"guessed: {largest:.3g} is too fast for rad/s")
    size = float(np.sqrt(np.nanmean(gyro.values**2)))
    unit, why = "rad/s", "guessed, because the accelerometers are in m/s²"
    if force.unit in ("g", "mg") and size < _SLOW_DEGREES and _is_moving(force):
        why = f"guessed: {size:.2g} (rms) is too slow for °/s in motion"
    elif force.unit in ("g", "mg"):
        unit, why = "°/s", f"guessed, because the accelerometers are in {force.unit}"
    return _scale_triad(gyro, unit, why)


def in_other_unit(imu: Imu) -> Imu | None:
    """Return an IMU with its gyros in the other usual unit, if the unit is a guess without a proof."""
    gyro = imu.gyro
    if not gyro.source.startswith("guessed, "):
        return None
    unit, factor = ("°/s", DEGREE) if gyro.unit == "rad/s" else ("rad/s", 1 / DEGREE)
    samples = imu.samples * np.array([factor] * 3 + [1.0] * 3)
    other = gyro._replace(
        values=gyro.values * factor, unit=unit, source=f"guessed: {gyro.unit} contradicts the motion"
    )
    return Imu(imu.time, samples, other, imu.accelerometer, (f"Gyros: {other.report}.", *imu.remarks[1:]))


def _merge_samples(gyro: Triad, force: Triad) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return the samples at the times of the gyros."""
    if gyro.sheet is force.sheet:
        both = np.column_stack((gyro.values, force.values))
        apart = np.isfinite(both[:, :3]).all(axis=1) != np.isfinite(both[:, 3:]).all(axis=1)
        if apart.mean() < _TOGETHER:
            of_imu = np.isfinite(both).any(axis=1)  # others are of the receiver only
            rows, time, remarks = in_order(np.where(of_imu, gyro.clock.time, np.nan), "IMU")
            return time, both[rows], remarks
    known = np.isfinite(gyro.values).all(axis=1)
    rows, time, remarks = in_order(np.where(known, gyro.clock.time, np.nan), "gyros")
    rate = gyro.values[rows]
    other = np.isfinite(force.values).all(axis=1)
    at, when, more = in_order(np.where(other, force.clock.time, np.nan), "accelerometers")
    both = np.column_stack((rate, _interpolate_values(when, force.values[at], time)))
    inside = np.isfinite(both).all(axis=1)
    if not inside.any():
        raise MissionError(
            f"{force.sheet.name}: the accelerometers were recorded from {span_text(when)}, and "
            f"the gyros of {gyro.sheet.name} from {span_text(time)}; accepted are sensors of one clock, "
            "recorded together"
        )
    first, last = np.flatnonzero(inside)[[0, -1]]
    remarks = [*remarks, *more, "The accelerometers are interpolated to the times of the gyros."]
    return time[first : last + 1], both[first : last + 1], remarks


def _interpolate_values(time: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Return values at other times; NaN outside, and where they are too far apart."""
    kept = np.isfinite(values).all(axis=1) & np.isfinite(time)
    time, values = time[kept], values[kept]
    if time.size < 2:
        return np.full((len(at), 3), np.nan)
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    step = np.diff(time)
    result = interpolate_columns(at, time, values, np.nan)
    usual = float(np.median(step))
    result[step[after - 1] > _MAX_APART * usual] = np.nan
    return result


def of_odd_stamps(sheets: Sequence[Sheet]) -> str:
    """Return a sentence on time stamps that are not understood; empty if there are none."""
    odd = [f"{text!r} in the column {name}" for one in sheets for name, text in one.odd_stamps.items()]
    return (
        f" Time stamps are not understood: {', '.join(odd)}; accepted are {ACCEPTED}, {ZONES}." if odd else ""
    )


def _what_is_missing(sheets: Sequence[Sheet], gyros: bool, forces: bool) -> str:
    missing = [word for word, there in (("gyros", gyros), ("accelerometers", forces)) if not there]
    names = ", ".join(sheet.name for sheet in sheets)
    known = sorted({one.quantity for sheet in sheets for one in sheet.headings})
    unknown = [text for sheet in sheets for text in sheet.unknown][:20]
    untimed = [sheet.name for sheet in sheets if find_clock(sheet, fast=True) is None]
    timeless = f" No column with time stamps in {', '.join(untimed)}." if untimed else ""
    timeless = of_odd_stamps(sheets) or timeless
    return (
        f"{names}: no complete {' and '.join(missing)} found (three axes and time stamps). Columns found: "
        f"{', '.join(known) or 'none'}; not understood: {', '.join(unknown) or 'none'}.{timeless} "
        "Accepted are headings such as gyro_x_rad_s and accel_x_m_s2, or what the columns are: --column "
        "HEADING=rate_x[rad/s]"
    )
