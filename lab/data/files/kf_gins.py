"""KF-GINS: text files of numbers without a header: an IMU, the positions of a receiver, and a solution.

The IMU has seven columns: seconds of the GPS week, angle increments [rad] and velocity increments [m/s]
forward, right, down over the interval that ends with the stamp; more columns are not read. The receiver has
seven: seconds, latitude, longitude [°], height above the ellipsoid [m], and σ north, east, down [m]; or
thirteen, with velocity and its σ [m/s] too, where the velocity shows whether angles are in radians. The
solution has eleven: week, seconds, latitude, longitude, height, velocity north, east, down [m/s], roll,
pitch, heading [°]. Data sets of the same group have the IMU as seven numbers of eight bytes a sample.

No heading names a column. Velocity increments add up to gravity, and latitudes and longitudes have seven
decimals and more: a file whose numbers do not show this is not recognised.

References
----------
i2Nav, Wuhan University, *KF-GINS*, *KF-GINS-Matlab* and *Awesome GINS Dataset*, file formats in the README.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import LATITUDES, LONGITUDES, MIN_SAMPLES
from lab.base.files.file_content import TextBlocks, content, read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import STANDARD_GRAVITY, WEEK
from lab.data.checks.imu_axes import axes_matrix
from lab.data.checks.log_check import check_log
from lab.data.files.fields import units_of_the_format
from lab.data.files.streams import Stream
from lab.data.files.track import Track
from lab.data.log.auxiliary_data import AuxiliaryData, Reference
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repair_log
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames.earth import SEMI_MAJOR_AXIS

NAME = "KF-GINS text"

IMU, GNSS, SOLUTION = "IMU", "positions", "solution"
"""Kinds of files."""
_COLUMNS = {IMU: 7, GNSS: 7, SOLUTION: 11}
"""Columns that are read of each."""
_WITH_VELOCITY = 13
"""Columns of positions with velocities."""
_HEAD_LINES = 100
"""Lines by which a file is recognised."""
_MIN_LINES = 5
"""Fewest of them."""
_MIN_WHOLE = 0.8
"""Part of them that are rows of one number of columns: others may be damaged."""
_NUMBERS = re.compile(rb"[-+.0-9eE \t]+")
_DECIMALS = 7
"""Fewest decimals that most latitudes and longitudes have: 1 cm. Positions in metres have fewer."""
_STEPS = (1e-4, 0.2)
"""Shortest and longest usual interval of an IMU [s]."""
_GAP = 1.5
"""Interval between samples, in usual ones, from which samples are missing."""
_LONGEST_STEP = 60.0
"""Longest usual interval of positions [s]."""
_GRAVITY = (0.8 * STANDARD_GRAVITY, 1.3 * STANDARD_GRAVITY)
"""Median specific force of an IMU on a vehicle [m/s²]."""
_MOST_DEGREES = 0.05
"""Longest usual step of a latitude or longitude [°]: an aircraft at 300 m/s in 15 s."""
_LEAST_DEGREES = 1.0
"""Latitude or longitude of a place [°], and angle increment [rad] that no IMU has."""
_SIGMAS = (1e-4, 100.0)
"""σ of positions of a receiver [m]."""
_MIN_FORWARD = 0.9
"""Part of the stamps that are later than those before."""
_RATIO = (0.5, 2.0)
"""Ratio of the path of the positions to that of the velocities at which both are in one unit."""
_MOST_SPEED = 1000.0
"""Largest velocity of a solution [m/s]."""
_FULL_TURN = 360.0
"""Largest angle [°]."""
_BINARY_ROW = 56
"""Bytes of a sample in files that are no text."""
_MISSING = "rows with another number of columns than the first, or with no numbers"


class _Rows(NamedTuple):
    """Rows of one file: its path and kind, numbers (n, columns), and those that cannot be read."""

    path: Path
    kind: str
    values: FloatArray
    lines: FloatArray
    lost: int
    first_lost: int

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        return (Dropped(_MISSING, self.lost, self.first_lost),) if self.lost else ()


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file are rows of one of the three kinds."""
    return bool(_recognise_kind(head)[0])


def _recognise_kind(head: bytes) -> tuple[str, int]:
    """Return the kind of a file and its columns that are read, by its first bytes; empty for another one."""
    if not _is_text(head):
        rows = np.frombuffer(head[: len(head) // _BINARY_ROW * _BINARY_ROW], "<f8").reshape(-1, 7)
        return (IMU if len(rows) >= _MIN_LINES and _is_imu(rows[:_HEAD_LINES]) else ""), _COLUMNS[IMU]
    lines = [line for line in head.splitlines()[: _HEAD_LINES + 1] if line.strip()]
    cells = [line.split() for line in lines[:-1] if _NUMBERS.fullmatch(line)]  # the last one may be cut
    count = Counter(map(len, cells)).most_common(1)[0][0] if cells else 0
    cells = [row for row in cells if len(row) == count]
    # Headings, also behind a sign of a comment, may say that the columns are others.
    if lines and not _NUMBERS.fullmatch(lines[0]):
        return "", 0
    if len(cells) < max(_MIN_LINES, _MIN_WHOLE * len(lines)):
        return "", 0
    try:
        rows = np.array(cells, dtype=float)
    except ValueError:
        return "", 0
    is_solution = count == _COLUMNS[SOLUTION] and _is_solution(rows) and _have_decimals(cells, (2, 3))
    is_gnss = count in (_COLUMNS[GNSS], _WITH_VELOCITY) and _is_gnss(rows) and _have_decimals(cells, (1, 2))
    if is_solution or is_gnss:
        return (SOLUTION if is_solution else GNSS), count
    return (IMU if count >= _COLUMNS[IMU] and _is_imu(rows) else ""), _COLUMNS[IMU]


def _is_text(head: bytes) -> bool:
    first = head[:_BINARY_ROW]
    return first.isascii() and b"\0" not in first


def _runs(time: FloatArray, longest: float) -> bool:
    """Return whether seconds of a week increase by steps up to a length."""
    steps = np.diff(time)
    inside = ((time >= 0) & (time <= WEEK)).all()
    return bool(inside and 0 < np.median(steps) <= longest and (steps > 0).mean() > _MIN_FORWARD)


def _is_imu(rows: FloatArray) -> bool:
    if not np.isfinite(rows).all() or not _runs(rows[:, 0], _STEPS[1]):
        return False
    step = float(np.median(np.diff(rows[:, 0])))
    # Increments of velocity over the usual step.
    force = float(np.median(np.linalg.norm(rows[:, 4:7], axis=1))) / step
    turns = bool((np.median(np.abs(rows[:, 1:4]), axis=0) < _LEAST_DEGREES).all())
    return turns and step >= _STEPS[0] and _GRAVITY[0] < force < _GRAVITY[1]


def _is_gnss(rows: FloatArray) -> bool:
    sigma = rows[:, 4:7]
    return bool(
        _runs(rows[:, 0], _LONGEST_STEP)
        and _are_places(rows[:, 1:3])
        and ((sigma > _SIGMAS[0]) & (sigma < _SIGMAS[1])).all()
    )


def _is_solution(rows: FloatArray) -> bool:
    return bool(
        _runs(rows[:, 1], _LONGEST_STEP)
        and (rows[:, 0] == np.floor(rows[0, 0])).all()
        and _are_places(rows[:, 2:4])
        and (np.abs(rows[:, 5:8]) < _MOST_SPEED).all()
        and (np.abs(rows[:, 8:]) <= _FULL_TURN).all()
    )


def _are_places(place: FloatArray) -> bool:
    """Return whether latitudes and longitudes (n, 2) [°] are on the Earth, and near each other."""
    inside = (np.abs(place[:, 0]) <= LATITUDES[1]) & (np.abs(place[:, 1]) <= LONGITUDES[1])
    steps = np.median(np.abs(np.diff(place, axis=0)), axis=0)
    is_somewhere = np.abs(np.median(place, axis=0)).max() >= np.radians(_LEAST_DEGREES)
    return bool(inside.all() and (steps < _MOST_DEGREES).all() and is_somewhere)


def _have_decimals(cells: Sequence[Sequence[bytes]], columns: Sequence[int]) -> bool:
    """Return whether most numbers in each of two columns have the decimals of latitudes."""
    return all(
        np.median([len(row[at].partition(b".")[2].partition(b"e")[0]) for row in cells]) >= _DECIMALS
        for at in columns
    )


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution in the files, or else the positions, as a flight.

    Raises
    ------
    MissionError
        If the files cannot be read, or have neither.
    """
    files = _files(paths, units)
    beside = ["The IMU is not used for a flight: --as log makes a sensor log of it."] if IMU in files else []
    beside += ["The positions are not used beside the solution."] if {GNSS, SOLUTION} <= set(files) else []
    if SOLUTION in files:
        return _flight(files[SOLUTION], beside)
    if GNSS not in files:
        raise MissionError(
            f"{paths[0]}: is the IMU of {NAME}, and has no positions; accepted are those beside it, or the "
            "solution"
        )
    rows = files[GNSS]
    fixes = _fixes(rows.values)
    north, east, down = fixes.velocity_n.T
    return Track(
        path=rows.path, format=NAME, time=fixes.time, latitude=np.degrees(fixes.position[:, 0]),
        longitude=np.degrees(fixes.position[:, 1]), height=fixes.position[:, 2], speed=np.hypot(north, east),
        course=np.degrees(np.arctan2(east, north)) % _FULL_TURN, down=down, lines=rows.lines.astype(np.int64),
        columns=units_of_the_format({"2": "°", "3": "°", "4": "m", "8": "m/s", "9": "m/s"}),
        rows_read=len(rows.values) + rows.lost, dropped=rows.dropped,
        remarks=("Time is the seconds of a GPS week.", "Heights are above the ellipsoid.", *beside),
    ).flight()  # fmt: skip


def _reference(values: FloatArray) -> Reference:
    """Return a solution (n, 11) with times that increase."""
    time = _seconds(values[:, 1])
    later = time > np.concatenate(([-np.inf], np.maximum.accumulate(time)[:-1]))
    place = np.column_stack((np.radians(values[:, 2:4]), values[:, 4]))
    return Reference(time[later], place[later], values[later, 5:8], np.radians(values[later, 8:]))


def _flight(rows: _Rows, beside: Sequence[str]) -> RawFlight:
    """Return the flight of a solution."""
    kept = np.isfinite(rows.values).all(axis=1) & (np.abs(rows.values[:, 2]) <= LATITUDES[1])
    if kept.sum() < MIN_SAMPLES:
        raise MissionError(
            f"{rows.path}: {kept.sum()} rows can be used; accepted are at least {MIN_SAMPLES} with time, "
            "position, velocity and attitude"
        )
    _, time, latitude, longitude, height, *rest = rows.values[kept].T
    return RawFlight(
        format=NAME,
        time=_seconds(time),
        latitude=np.radians(latitude),
        longitude=np.radians(longitude),
        height=height,
        velocity_n=np.column_stack(rest[:3]),
        euler=np.radians(np.column_stack(rest[3:])),
        rows_read=len(kept) + rows.lost,
        dropped=(*rows.dropped, *Dropped.of("without a position on the Earth", ~kept, rows.lines)),
        units=units_of_the_format({"3": "°", "4": "°", "5": "m", "6 to 8": "m/s", "9 to 11": "°"}),
        remarks=("Time is the seconds of a GPS week.", "Heights are above the ellipsoid.", *beside),
    )


def read_logs(
    paths: Sequence[Path], units: Mapping[str, str], axes: Sequence[str] = (), vehicle: str = ""
) -> SensorLog:
    """Read the IMU and the positions; a solution beside them is the reference.

    Parameters
    ----------
    paths
        The files, in any order.
    units
        None: the format fixes its units.
    axes
        The axes of the IMU that point forward, right and down, if they are others.
    vehicle
        Kind of vehicle; empty if unknown.

    Raises
    ------
    MissionError
        If one of both is missing, or the numbers contradict their units, axes or clock.
    """
    files = _files(paths, units)
    missing = [kind for kind in (IMU, GNSS) if kind not in files]
    if missing:
        raise MissionError(
            f"{paths[0]}: a log of {NAME} has two files, and the {missing[0]} file is missing; name both: "
            "ins-lab import IMU.txt GNSS.txt --as log"
        )
    imu = files[IMU]
    samples = imu.values[:, 1:7]
    if axes:
        C = axes_matrix(axes)
        samples = np.hstack((samples[:, :3] @ C.T, samples[:, 3:] @ C.T))
    name = str(paths[0].parent) + ": " + ", ".join(path.name for path in paths)
    fixes = _fixes(files[GNSS].values)
    reference = _reference(files[SOLUTION].values) if SOLUTION in files else None
    auxiliary = AuxiliaryData(vehicle=vehicle)
    log = repair_log(
        name, _seconds(imu.values[:, 0]), samples, fixes, reference, increments=True, auxiliary=auxiliary
    )
    check_log(log)
    return log


def read_imu(path: Path) -> Stream:
    """Read angular rate [rad/s] and specific force [m/s²] of an IMU file alone.

    Raises
    ------
    MissionError
        If it is no IMU file.
    """
    rows = _rows(path)
    if rows.kind != IMU:
        raise MissionError(f"{path}: is no IMU file of {NAME}")
    time = _seconds(rows.values[:, 0])
    step = np.diff(time)
    usual = float(np.median(step)) if step.size else np.nan
    # Over a gap the increments are those of the last interval.
    interval = np.where(step > _GAP * usual, usual, np.maximum(step, usual / 2))[:, None]
    return Stream.of("IMU", time[1:], rows.values[1:, 1:7] / interval)


def _fixes(values: FloatArray) -> GnssLog:
    """Return the fixes of a file of positions (n, 7) or (n, 13)."""
    time, unknown = _seconds(values[:, 0]), np.full((len(values), 3), np.nan)
    velocity, sigma = (
        (values[:, 7:10], values[:, 10:]) if values.shape[1] == _WITH_VELOCITY else (unknown,) * 2
    )
    place, speed = values[:, 1:3], np.linalg.norm(velocity[:, :2], axis=1)
    # As if in radians: in degrees the path would be 57 times as long as the velocities say.
    along = np.column_stack((np.diff(place[:, 0]), np.diff(place[:, 1]) * np.cos(place[1:, 0])))
    moved, path = np.hypot(*along.T).sum() * SEMI_MAJOR_AXIS, float(speed[1:] @ np.diff(time))
    is_radians = _RATIO[0] * path < moved < _RATIO[1] * path
    place = place if is_radians else np.radians(place)
    position = np.column_stack((place, values[:, 3]))
    sigmas = believed_sigma(values[:, 4:7]), believed_sigma(sigma)
    return GnssLog(time, position, velocity, *sigmas, np.zeros(3), 0.0)


def _seconds(time: FloatArray) -> FloatArray:
    """Return seconds that go on over the end of a week."""
    known = np.isfinite(time)
    found = time.copy()
    found[known] = np.unwrap(time[known], period=WEEK)
    return found


def _files(paths: Sequence[Path], units: Mapping[str, str]) -> dict[str, _Rows]:
    """Return the rows of files by their kind."""
    if units:
        raise MissionError(
            f"{paths[0]}: {NAME} fixes its units, so that of {next(iter(units))} cannot be given another"
        )
    found: dict[str, _Rows] = {}
    for path in paths:
        rows = _rows(path)
        if rows.kind in found:
            raise MissionError(
                f"{path}: is a second {rows.kind} file beside {found[rows.kind].path.name}; accepted is one"
            )
        found[rows.kind] = rows
    return found


def _rows(path: Path) -> _Rows:
    """Return the rows of a file."""
    data = next(iter(content(path, MAX_BYTES, 2**16)), b"")
    kind, columns = _recognise_kind(data)
    if not kind:
        raise MissionError(
            f"{path}: is no {NAME} file; accepted are rows of an IMU (7 columns), of positions with σ (7 or "
            f"{_WITH_VELOCITY}), or of a solution (11), separated by blanks"
        )
    if not _is_text(data):
        samples = read_whole(path, MAX_BYTES)
        count = len(samples) // _BINARY_ROW
        values = np.frombuffer(samples, "<f8", count * 7).reshape(-1, 7)
        kept = np.isfinite(values).all(axis=1)
        left = int((~kept).sum()) + (len(samples) % _BINARY_ROW > 0)
        first = int(np.argmin(kept)) + 1 if not kept.all() else count + 1
        numbers = (np.flatnonzero(kept) + 1).astype(np.float64)
        return _Rows(path, kind, values[kept], numbers, left, first if left else 0)
    parts: list[FloatArray] = [np.empty((0, columns + 1))]
    lost = first_lost = 0
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        for block in text.blocks():
            lines = block.split(b"\n")
            part, bad, first = _parse_lines(lines, text.next_line, columns)
            parts.append(part)
            lost += bad
            first_lost = first_lost or first
            text.next_line += len(lines)
    table = np.concatenate(parts)
    return _Rows(path, kind, table[:, 1:], table[:, 0], lost, first_lost)


def _parse_lines(lines: Sequence[bytes], number: int, columns: int) -> tuple[FloatArray, int, int]:
    """Return line numbers and leading columns of lines, how many cannot be read, and the first of those."""
    with contextlib.suppress(ValueError):
        whole_block = np.loadtxt(lines, usecols=range(columns), ndmin=2, comments=None)
        if len(whole_block) == len(lines) and np.isfinite(whole_block).all():
            return np.column_stack((np.arange(number, number + len(lines)), whole_block)), 0, 0
    rows, lost = [], []
    for at, line in enumerate(lines, number):
        if not line.strip():
            continue
        try:
            row = [float(cell) for cell in line.split()[:columns]]
        except ValueError:
            row = []
        if len(row) == columns and np.isfinite(row).all():
            rows.append((at, *row))
        else:
            lost.append(at)
    return np.array(rows, dtype=float).reshape(-1, columns + 1), len(lost), lost[0] if lost else 0
