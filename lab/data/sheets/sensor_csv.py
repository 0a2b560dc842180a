"""Sensor csv: tables with named columns from phones, ROS, loggers and exports of autopilots.

A log may be one file or several. The headings say what columns are (`lab.data.sheets.column_names`); what
they do not say is guessed by the numbers, and every guess is reported. A person corrects both: for each
heading a unit, such as ``g``, or a quantity with a unit, such as ``force_x[g]``. A zip file is read as the
files in it.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.file_content import ZIP, read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.checks.gyro_check import are_explained
from lab.data.checks.imu_axes import axes_matrix
from lab.data.checks.log_check import is_explained, match_windows
from lab.data.files.track import Track
from lab.data.files.unit_names import refuse_unknown
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import GnssLog, SensorLog, repair_log
from lab.data.log.vehicle import vehicle_of
from lab.data.rebuild.raw_flight import ColumnUnit, RawFlight
from lab.data.sheets.column_names import GIVEN, IGNORED, OF_DIRECTIONS, QUANTITIES, Heading
from lab.data.sheets.json_tables import is_json
from lab.data.sheets.sensor_logger import METADATA, against_gravity, metadata_beside, read_metadata
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_attitude import find_attitude, make_reference
from lab.data.sheets.sheet_axes import Oriented, orient_log
from lab.data.sheets.sheet_blocks import (
    has_velocity,
    in_time_order,
    of_one_instance,
    one_recording,
    read_sheets,
    with_velocities,
)
from lab.data.sheets.sheet_clock import describe_ends, offset_that_agrees
from lab.data.sheets.sheet_field import find_magnetometer
from lab.data.sheets.sheet_fixes import (
    DOUBTFUL,
    Fixes,
    find_fixes,
    find_resets,
    in_height_unit,
    speed_of_fixes,
)
from lab.data.sheets.sheet_gravity import refuse_cm_per_s2
from lab.data.sheets.sheet_heights import about_heights, unit_that_agrees
from lab.data.sheets.sheet_imu import OF_MOTION, Imu, find_imu, in_other_unit, without_gravity
from lab.data.sheets.sheet_layout import TIMES, as_utf8, cells_of, find_layout
from lab.data.sheets.sheet_pressure import find_barometer
from lab.data.sheets.sheet_sources import ENDINGS, KITTI_STAMP, split_tables, tables_in, to_csv_table
from lab.motion.frames.displacement import velocity_of_positions

_Checked = Callable[[Imu, GnssLog], Oriented]
"""Returns the log of an IMU and fixes, or raises a `MissionError`."""

NAME = "csv with named columns"

_KITTI = b"oxts/"
_MIN_QUANTITIES = 3
"""Fewest quantities that the headings of a file must name: time, and two more."""
_CONTROL = re.compile(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f]")
"""Characters that texts do not have: no blanks, no zeros of free room, and no colours of a terminal."""
_MOST_CONTROLS = 0.02
"""Largest part of them in a text with damaged rows: tables of loggers had none, noise at least 5.3 %."""
_MAX_REPORT = 1500
"""Longest report of columns in a message [characters]."""
_NUMBER = re.compile(r"[+-]?\.?\d")
"""How a number begins: prose is no header, and has no numbers below."""
_POSITION = ("latitude", "longitude")
_QUATERNION = ("q0", "q1", "q2", "q3")
_PHONE_WORDS = ("accelerometer", "acceleration")
_ROS = ("angular velocity", "linear acceleration")
"""How ROS names gyros and accelerometers, whose x, y and z point forward, left and up (REP 103)."""


def recognises(head: bytes) -> bool:
    """Return whether a file has a header that names a position or a sensor, or is a zip of such files."""
    if head.startswith(ZIP):
        return _KITTI in head or any(ending.encode() in head for ending in ENDINGS[:2])
    text = as_utf8(head)
    is_binary = len(_CONTROL.findall(text)) > _MOST_CONTROLS * len(text)  # noise names columns too
    if head[:4000].count(0) > len(head[:4000]) // 2 or not (b"\n" in text or is_json(text)) or is_binary:
        return False
    # Columns x, y and z are of a sensor that the name of the file tells.
    return KITTI_STAMP.match(head) is not None or any(
        _names_enough(table, name) for name, table in split_tables("accelerometer", text)
    )


def _names_enough(text: bytes, name: str) -> bool:
    """Return whether a text has a header that names time, and a position or a sensor."""
    try:
        layout = find_layout(to_csv_table(text), name)
    except MissionError:
        return True  # of several profiles, which reading reports
    if layout is None:
        return False
    quantities = {(one.quantity, one.axis) for one in layout.known if one is not None}
    names = {name for name, _ in quantities}
    has_time = bool(names & TIMES) or layout.rate > 0
    if any(one is not None and one.quantity == "pressure" and one.unit for one in layout.known):
        return has_time
    is_motion = set(_POSITION) <= names or set(_QUATERNION) <= names or has_velocity(names)
    is_sensor = bool(names & {"rate", "force", "place", "field"})
    return len(quantities) >= _MIN_QUANTITIES and has_time and (is_motion or is_sensor)


def missing_time_reason(head: bytes) -> str:
    """Return advice for a table that names positions or sensors, and no time; else an empty text."""
    names = {one.quantity for one in _known_in(head)}
    if names & TIMES or not _has_samples(names):
        return ""
    return (
        f"{_list_headings(head)}, and none of its headings names a time: --column HEADING=time[s] says "
        "which one is the time."
    )


def what_is_missing(head: bytes) -> str:
    """Return what a table lacks whose headings name some quantities; else an empty text."""
    names = {one.quantity for one in _known_in(head)} - TIMES
    if not names or _has_samples(names):
        return missing_time_reason(head) if set(_POSITION) <= names else ""
    return (
        f"{_list_headings(head)}, and none of its headings names a position, a gyro or an accelerometer: "
        "--column "
        "HEADING=QUANTITY[UNIT] says what a column is."
    )


def _known_in(head: bytes) -> list[Heading]:
    """Return what the headings of a table name, but for vehicles."""
    try:
        layout = (
            find_layout(to_csv_table(as_utf8(head)), "accelerometer") if b"\0" not in head[:4000] else None
        )
    except MissionError:
        return []
    if layout is None:
        return []
    below = to_csv_table(as_utf8(head)).split(b"\n", layout.line + 4)[layout.line + 1 : layout.line + 4]
    rows = [cells_of(line.decode("utf-8", "replace"), layout.delimiter) for line in below]
    is_prose = not any(len(row) == len(layout.headings) and _NUMBER.match(row[-1] or row[0]) for row in rows)
    known = [one for one in layout.known if one is not None and one.quantity != "craft"]
    return [] if is_prose else known


def _has_samples(names: AbstractSet[str]) -> bool:
    """Return whether quantities are of positions or of an IMU."""
    return set(_POSITION) <= names or bool(names & {"rate", "force"})


def _list_headings(head: bytes) -> str:
    texts = ", ".join(dict.fromkeys(one.text for one in _known_in(head)))[:_MAX_REPORT]
    return f"It is a table with {texts}"


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the positions of the receiver in the files as a track.

    Raises
    ------
    MissionError
        If there are none, or a column that a person names is not there.
    """
    sheets = sheets_of(paths, units)
    fixes = find_fixes(sheets, with_height=False)
    gnss = fixes.gnss
    attitude = find_attitude(sheets, gnss.time, gnss.position, gnss.velocity_n)
    of_imu: list[ColumnUnit] = []
    if any(one.all_of("rate") for one in sheets):
        with contextlib.suppress(MissionError):
            of_imu = units_of_imu(sheets, gnss)
    columns = {one.column: one for one in (*fixes.units, *of_imu) if one.column}
    columns |= {one.column: one for one in (attitude.units if attitude else ())}
    resets, counters = find_resets(fixes)
    remarks = [remark for one in sheets for remark in one.remarks]
    remarks += [*fixes.remarks, *([attitude.remark] if attitude else [])]
    remarks += [
        *describe_unread(sheets, [*columns, *counters], remarks),
        *about_heights(fixes.units[2].column, fixes.sheet.ellipsoid),
    ]
    flight = Track(
        path=paths[0], format=NAME, time=gnss.time, latitude=np.degrees(gnss.position[:, 0]),
        longitude=np.degrees(gnss.position[:, 1]), height=gnss.position[:, 2], speed=fixes.speed,
        course=np.degrees(fixes.course) % 360, lines=np.arange(len(gnss.time)) + 2,
        columns=(ColumnUnit("", "", ""),) * 5, rows_read=len(gnss.time), remarks=tuple(remarks),
        down=gnss.velocity_n[:, 2], euler=attitude.at(gnss.time) if attitude else None,
        vehicle=next(
            (one.profile.vehicle for one in sheets if one.profile is not None and one.profile.vehicle),
            attitude.vehicle if attitude else "",
        ),
    ).flight()  # fmt: skip
    return replace(flight, units=tuple(columns.values()), resets=resets)


_MAX_UNREAD = 20
"""Most headings of columns that are not read that are reported."""


def describe_unread(sheets: Sequence[Sheet], used: Sequence[str], remarks: Sequence[str]) -> list[str]:
    """Return a sentence on the columns of which nothing is used; none if there are none."""
    stamps = {*TIMES, "fraction", "year", "month", "day", "hour", "minute", "side", "instance"}
    texts = [
        text
        for one in sheets
        for text in (*(known.text for known in one.headings if known.quantity not in stamps), *one.unknown)
    ]
    said = " ".join(remarks)
    left = sorted({text for text in texts if text and text not in used and text not in said})
    if not left:
        return []
    more = f" and {len(left) - _MAX_UNREAD} more" if len(left) > _MAX_UNREAD else ""
    return [f"Columns not read: {', '.join(left[:_MAX_UNREAD])}{more}."]


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the receiver in one file; see `read_logs`."""
    return read_logs([path])


def read_logs(
    paths: Sequence[Path],
    units: Mapping[str, str] | None = None,
    axes: Sequence[str] = (),
    vehicle: str = "",
    *,
    lever_arm: Sequence[float] = (0.0, 0.0, 0.0),
    latency: float = 0.0,
) -> SensorLog:
    """Read the IMU and the receiver in the files.

    Parameters
    ----------
    paths
        One file with both, or several of one clock; a zip file counts as the files in it.
    units
        What a person says of columns, by heading: a unit, or a quantity with its unit.
    axes
        Which axes of the IMU point forward, right and down; empty: found by gravity and motion.
    vehicle
        Kind of vehicle, as `lab.data.log.vehicle` has them; empty if unknown.
    lever_arm
        From the IMU to the antenna, forward, right, down [m].
    latency
        By how much the stamps of the fixes are late [s].

    Raises
    ------
    MissionError
        If something is missing or implausible, saying what was understood.
    """
    sheets = sheets_of(paths, units or {})
    imu = find_imu(sheets)
    stamps = [one.text for one in imu.gyro.sheet.headings if one.quantity in ("time", "clock")]
    fixes = find_fixes(sheets, stamps)
    fixes = fixes._replace(gnss=replace(fixes.gnss, lever_arm=np.array(lever_arm, float), latency=latency))
    profiles = [one.profile for one in sheets if one.profile is not None]
    of_imu = imu.gyro.sheet.profile
    axes = axes or (of_imu.axes if of_imu else ())
    vehicle = vehicle or next((one.vehicle for one in profiles if one.vehicle), "")
    name = (
        str(paths[0]) if len(paths) == 1 else f"{paths[0].parent}: {', '.join(path.name for path in paths)}"
    )
    checked = partial(_oriented_log, name, vehicle, axes, speed_of_fixes(fixes))
    imu, (log, forward) = _in_unit_of_motion(imu, fixes, checked)
    refuse_cm_per_s2(imu, fixes.gnss)
    ends_apart = describe_ends(imu.time, fixes.gnss)
    if ends_apart and not is_explained(log) and (found := _leap_seconds(imu, fixes.gnss, checked)):
        raise MissionError(f"{name}: the velocities do not change as the IMU says. {found}")
    height = fixes.units[2]
    if height.source in DOUBTFUL:
        unit, factor = unit_that_agrees(log, height.unit)
        if unit != height.unit:
            fixes = in_height_unit(fixes, unit, factor)
            log, forward = checked(imu, fixes.gnss)
    field, pressure = find_magnetometer(sheets, log, axes_matrix(forward)), find_barometer(sheets, log)
    remarks = [remark for one in sheets for remark in one.remarks]
    remarks += [*imu.remarks, *fixes.remarks, *field.remarks, *pressure.remarks, *filter(None, [ends_apart])]
    reference, told = make_reference(sheets, log, fixes.gnss)
    remarks += told
    named = (*imu.gyro.headings, *imu.accelerometer.headings)
    remarks += describe_unread(
        sheets, [*(one.text for one in named), *(one.column for one in fixes.units)], remarks
    )
    beside = replace(log.auxiliary, magnetometer=field.magnetometer, barometer=pressure.barometer)
    return replace(log, repairs=(*remarks, *log.repairs), auxiliary=beside, reference=reference)


def _oriented_log(
    name: str, vehicle: str, axes: Sequence[str], pace: FloatArray, imu: Imu, gnss: GnssLog
) -> Oriented:
    """Return the log of an IMU and fixes in forward, right, down; `MissionError` if it is implausible."""

    def with_fixes(gnss: GnssLog) -> Callable[[FloatArray], SensorLog]:
        auxiliary = AuxiliaryData(vehicle=vehicle)
        return lambda samples: repair_log(name, imu.time, samples, gnss, auxiliary=auxiliary)

    along = along_track(gnss, pace)
    shown = None if along is None else with_fixes(along)
    # Phones differ in the sign of their accelerations; others write specific force.
    is_phone, sheet = _is_phone(imu), imu.accelerometer.sheet
    named = any(one.sign < 0 or one.sensor == GIVEN for one in imu.accelerometer.headings)
    is_signed = named or sheet.signed or not is_phone
    level = vehicle_of(vehicle).stays_level
    words = {one.headings[0].sensor for one in (imu.gyro, imu.accelerometer)} & {*OF_DIRECTIONS}
    return orient_log(imu.samples, with_fixes(gnss), axes, is_phone, is_signed, shown, level, words)


def _in_unit_of_motion(imu: Imu, fixes: Fixes, checked: _Checked) -> tuple[Imu, Oriented]:
    """Return the IMU with its log, in the other unit of its gyros if the motion contradicts a guessed one."""
    other = in_other_unit(imu)
    try:
        return imu, _borne_out(imu, checked(imu, fixes.gnss))
    except MissionError as error:
        refusal = error
    try:
        if other is not None:
            return other, _borne_out(other, checked(other, fixes.gnss))
    except MissionError:
        pass
    if imu.accelerometer.source.startswith(OF_MOTION):
        raise MissionError(without_gravity(imu.accelerometer))
    # A wrong guess of what the columns are may be the cause.
    hint = _leap_seconds(imu, fixes.gnss, checked)
    cause = ". ".join(filter(None, (str(refusal).removesuffix("."), hint)))
    report = " ".join((*imu.remarks, *fixes.remarks))[:_MAX_REPORT]
    raise MissionError(f"{_in_its_headings(cause, imu)}. The columns were read so: {report}")


_REMEDY = re.compile(r'"(RATE|FORCE)_([XYZ])=(-?)((?:rate|force)_[xyz])\[[^\]]*\]"')
_FOR_PLACES = "With other headings in place of the capitals, and their unit, these options do it"


def _in_its_headings(text: str, imu: Imu) -> str:
    """Return a message whose options name the headings of a file and their units, to be pasted."""

    def name_heading(found: re.Match[str]) -> str:
        triad = imu.gyro if found[1] == "RATE" else imu.accelerometer
        heading = triad.headings["XYZ".index(found[2])]
        sign = "" if (found[3] == "-") == (heading.sign < 0) else "-"
        return f'"{heading.text}={sign}{found[4]}[{triad.unit}]"'

    return _REMEDY.sub(name_heading, text).replace(_FOR_PLACES, "These options do it")


def _borne_out(imu: Imu, read: Oriented) -> Oriented:
    """Return a log, or raise if only the motion can show the unit of its accelerations, and does not."""
    matches = match_windows(read.log) if imu.accelerometer.source.startswith(OF_MOTION) else None
    if matches is not None and not (matches.windows and are_explained(matches)):
        raise MissionError(without_gravity(imu.accelerometer))
    return read


def _leap_seconds(imu: Imu, gnss: GnssLog, checked: _Checked) -> str:
    """Return a sentence if fixes that are off by the leap seconds agree with the IMU, or else nothing."""
    return offset_that_agrees(imu.time, gnss, lambda gnss: checked(imu, gnss).log)


def sheets_of(paths: Sequence[Path], units: Mapping[str, str]) -> list[Sheet]:
    """Return the tables in files, those in zip files included.

    Raises
    ------
    MissionError
        If a file cannot be read, or a person names a column that no file has.
    """
    overrides = {heading: parse_override(text) for heading, text in units.items()}
    sheets: list[Sheet] = []
    metadata = next((found for path in paths if (found := metadata_beside(path))), {})
    for path in paths:
        data = read_whole(path, MAX_BYTES)
        for name, text in tables_in(path, data):
            if name == METADATA:
                metadata = read_metadata(as_utf8(text))
            try:
                sheets += read_sheets(name, to_csv_table(as_utf8(text)), overrides)
            except MissionError as error:
                raise MissionError(f"{path}: {error}") from error
    headings = [text for one in sheets for text in (*(known.text for known in one.headings), *one.unknown)]
    refuse_unknown(", ".join(map(str, paths)), units, headings)
    if not any(len(sheet) for sheet in sheets):
        raise MissionError(
            f"{', '.join(map(str, paths))}: no header with known columns and rows of numbers below it found; "
            f"accepted are columns of {', '.join(QUANTITIES)}"
        )
    sheets = [of_one_instance(sheet) for sheet in against_gravity(sheets, metadata)]
    return with_velocities([in_time_order(sheet) for sheet in one_recording(sheets)])


def names_quantity(text: str) -> bool:
    """Return whether what a person says of a column is a quantity, and not a unit."""
    return "[" in text or text.strip() == IGNORED or text.strip().lstrip("+-").strip() in QUANTITIES


def parse_override(text: str) -> str:
    """Return what `lab.data.sheets.sheet` takes: a quantity as it is, a unit in brackets."""
    return text if names_quantity(text) else f"[{text}]"


def units_of_imu(sheets: Sequence[Sheet], gnss: GnssLog | None) -> list[ColumnUnit]:
    """Return the columns of the IMU with their units, so that a person can correct them.

    Parameters
    ----------
    sheets
        The tables.
    gnss
        The fixes in them, if there are any.

    Raises
    ------
    MissionError
        As `lab.data.sheets.sheet_imu.find_imu`.
    QuestionError
        If the data do not decide the unit.
    """
    imu = find_imu(sheets)
    refuse_cm_per_s2(imu, gnss)
    return [
        ColumnUnit(heading.text, triad.unit, triad.source)
        for triad in (imu.gyro, imu.accelerometer)
        for heading in triad.headings
    ]


def _is_phone(imu: Imu) -> bool:
    """Return whether the sensors are named as phones name them, each by itself."""
    words = imu.accelerometer.headings[0].sensor.lower()
    if imu.gyro.headings[0].sensor.lower().endswith(_ROS[0]) and words.endswith(_ROS[1]):
        return imu.gyro.sheet is not imu.accelerometer.sheet
    profiles = [one.sheet.profile for one in (imu.gyro, imu.accelerometer) if one.sheet.profile is not None]
    if any(one.phone for one in profiles):
        return True
    return imu.gyro.sheet is not imu.accelerometer.sheet or any(word in words for word in _PHONE_WORDS)


_POSITION_SIGMA = 3.0
"""σ of a position whose receiver does not give one [m]: phones in the open."""
_FAST = 3.0
"""Speed of the track from which it is compared with the stated one [m/s]: noise of positions adds to less."""
_LIKE = (0.7, 1.4)
"""Median ratio of both within which they are of one motion; a speed in another unit shows no axes."""
_MIN_FIXES = 3
"""Fewest fixes that show a direction in the middle."""


def along_track(gnss: GnssLog, speed: FloatArray) -> GnssLog | None:
    """Return fixes whose velocities are their speeds in the direction of the track; None if they need none.

    Parameters
    ----------
    gnss
        The fixes.
    speed : (m,) array
        Their speeds over ground [m/s].
    """
    time = gnss.time
    if np.isfinite(gnss.velocity_n[:, :2]).any() or not np.isfinite(speed).any() or time.size < _MIN_FIXES:
        return None
    if not (np.diff(time) > 0).all():
        return None
    north, east, _ = velocity_of_positions(time, gnss.position).T
    moved = np.hypot(north, east)
    fast = (moved > _FAST) & np.isfinite(speed)
    if not fast.any() or not _LIKE[0] < float(np.median(speed[fast] / moved[fast])) < _LIKE[1]:
        return None
    course = np.arctan2(east, north)
    velocity = np.column_stack((speed * np.cos(course), speed * np.sin(course), np.full(time.size, np.nan)))
    position = np.nanmedian(gnss.position_sigma[:, :2]) if np.isfinite(gnss.position_sigma).any() else np.nan
    known = position if np.isfinite(position) else _POSITION_SIGMA
    across = known / (np.sqrt(2) * float(np.median(np.diff(time))))  # of a central difference
    return replace(gnss, velocity_n=velocity, velocity_sigma=np.full((time.size, 3), across))
