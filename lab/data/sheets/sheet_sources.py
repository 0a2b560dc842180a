"""Sheet sources: files that are a table, but not a csv with a header: rewritten as one.

A VBO file of Racelogic names its columns in one section and their units in another; latitude and longitude
are minutes, and west is positive. KITTI has a file of thirty numbers without a header for each sample.
FlySight 2 begins each row with the sensor that it is of. Garmin's FitCSVTool writes name, value and unit of
each field of a FIT file into three cells. Gyroflow has counts, whose size stands above the header, and
RaceCapture the unit and the limits of a column in its heading.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lab.base.files.file_content import ZIP, unzip_files
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import DAY, LEAP_SECONDS
from lab.data.files import fit, fit_imu
from lab.data.sheets import gnss_logger
from lab.data.sheets.json_tables import is_json, json_tables, write_tables
from lab.data.sheets.long_table import is_long, long_tables
from lab.data.sheets.sheet_layout import as_utf8

MAX_MEMBERS = 200
"""Most files in a zip: exports of phones have some twenty."""
ENDINGS = (".csv", ".txt", ".tsv", ".dat")
"""How the names of tables in a zip end."""
_HEAD_BYTES = 2**16
"""Bytes that show whether the rows of a text are of several kinds."""
_VBO = b"[column names]"
_VBO_UNITS = {
    "lat": "arcmin", "latitude": "arcmin", "long": "arcmin", "longitude": "arcmin", "velocity": "km/h",
    "height": "m", "vert-vel": "km/h", "vertical-velocity": "km/h", "heading": "deg",
}  # fmt: skip
"""Units of the columns of a VBO file (Racelogic, "VBO file format")."""
_VBO_WEST = {"long": "longitude_west", "longitude": "longitude_west"}
"""Headings that do not say that west is positive."""
_VBO_SPEED = re.compile(rb"(?im)^(vertical )?velocity (kmh|km/h|knots|kts|mph|m/s)\s*$")

_GPS_EPOCH = 315_964_800.0
"""Start of GPS time, since 1970 [s]."""

_NUMBER = r"[+-]?\d{1,10}(?:\.\d{0,20})?(?:[eE][+-]?\d{1,2})?"
_BEGIN = re.compile(rf"{_NUMBER}(?=,)")
"""The time with which a row begins [s]."""
_FLYSIGHT_TIME = re.compile(rf"\$TIME,({_NUMBER}),({_NUMBER}),(\d{{1,5}})\b")
"""Clock of the device, GPS time of week, and GPS week."""

_MAX_STAMP_ERROR = 1.0
"""Largest distance from the median offset at which a stamp counts [s]: a crystal drifts 0.2 s in an hour."""
_SHORTEST_DRIFT = 30.0
"""Time over which stamps show the drift of the clock [s]: stamps of 1 ms then show 30 ppm."""

KITTI_FRAME = re.compile(r"(?:^|/)oxts/data/\d+\.txt$")
"""Path of the file with one sample."""
KITTI_STAMP = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{9}\r?\n\d{4}-")
"""How the file with the times of a drive begins."""
KITTI_STAMPS = re.compile(r"(?:^|/)oxts/timestamps\.txt$")
_KITTI_HEADINGS = (
    "lat[deg],lon[deg],alt[m],roll,pitch,yaw,vn[m/s],ve[m/s],vf,vl,vu[m/s],acc_x[m/s2],acc_y[m/s2],"
    "acc_z[m/s2],af,al,au,gyro_x[rad/s],gyro_y[rad/s],gyro_z[rad/s],wf,wl,wu,pos_accuracy[m],"
    "vel_accuracy[m/s],navstat,numsats,posmode,velmode,orimode"
)
"""The columns of a sample (KITTI raw data, dataformat.txt); x forward, y left, z up."""


def to_csv_table(data: bytes) -> bytes:
    """Return the text of a file as a csv with a header; any other text as it is."""
    if data.startswith(b"$FLYS"):
        return _of_flysight(data)
    if gnss_logger.is_gnss_logger(data):
        return gnss_logger.split_tables(data)
    if _FIT_CSV.match(data):
        return _of_fit_csv(data)
    if data.startswith(_GCSV):
        return _of_gyroflow(data)
    if _RACECAPTURE.match(data):
        head, _, rest = data.partition(b"\n")
        return _RACECAPTURE.sub(rb"\1[\2],", head).rstrip(b",") + b"\n" + rest
    place = data[: 2**16].lower().find(_VBO)
    return data if place < 0 else _of_vbo(data, place)


def _of_vbo(data: bytes, place: int) -> bytes:
    head, rest = data[:place], data[place:].split(b"\n", 2)
    if len(rest) < len(("section", "names", "rows")):
        return data
    units = {bool(found[1]): found[2].decode().lower() for found in _VBO_SPEED.finditer(head)}
    names, below = [], []
    for name in rest[1].decode("latin-1").split():
        unit = _VBO_UNITS.get(name.lower(), "-")
        names.append(_VBO_WEST.get(name.lower(), name))
        below.append(units.get(name.lower().startswith("vert"), unit) if unit == "km/h" else unit)
    rows = rest[2].partition(b"[data]")[2].lstrip()
    return " ".join(names).encode() + b"\n" + " ".join(below).encode() + b"\n" + rows


def _of_flysight(data: bytes) -> bytes:
    """Return the fixes of a file of FlySight 2, or its IMU with UTC as time."""
    lines = data.decode("latin-1").splitlines()
    sensor = next((one for one in ("GNSS", "IMU") if any(line.startswith(f"${one},") for line in lines)), "")
    names, units = (
        next((line.split(",")[2:] for line in lines if line.startswith(f"${kind},{sensor},")), [])
        for kind in ("COL", "UNIT")
    )
    head = [f"{name}[{unit}]" if unit else name for name, unit in zip(names, units, strict=False)]
    rows = [line.split(",", 1)[1] for line in lines if line.startswith(f"${sensor},")]
    if sensor == "IMU" and head and (clock := _utc_of_clock(lines)) is not None:
        head[0] = "utc[s]"
        begun = [(float(found[0]), row[found.end() :]) for row in rows if (found := _BEGIN.match(row))]
        rows = [f"{clock[1] + time * (1 + clock[0]):.4f}{rest}" for time, rest in begun]
    return "\n".join((",".join(head), *rows, "")).encode()


_FIT_CSV = re.compile(rb"\"?Type\"?,\"?Local Number\"?,\"?Message\"?,\"?Field 1\"?,")
"""How a csv of Garmin's FitCSVTool begins."""
_MAX_FIT_LINE = 65_536
"""Characters of its lines that are read: a record has some 2,000."""


def _of_fit_csv(data: bytes) -> bytes:
    """Return the records of a csv of FitCSVTool as a table."""
    rows = []
    for line in data.decode("utf-8", "replace").splitlines():
        kind, _, message, *cells = next(csv.reader([line[:_MAX_FIT_LINE].replace("\0", "")]), []) + [""] * 3
        if kind == "Data" and message == "record":
            triples = zip(cells[::3], cells[1::3], cells[2::3], strict=False)
            rows.append((message, {f"{name}[{unit}]": value for name, value, unit in triples if name}))
    return next((table for _, table in write_tables(rows, len(data))), b"")


_GCSV = (b"GYROFLOW IMU LOG", b"CAMERA IMU LOG")
"""How a file of Gyroflow begins (Gyroflow documentation, ".gcsv format")."""
_GCSV_SCALE = re.compile(rb"(?m)^([tga])scale,\s*(\d{0,9}\.?\d{1,20}(?:e-\d{1,2})?)\s*$")
"""What a count of the time [s], of the gyros [rad/s] and of the accelerometers [g] is."""
_GCSV_UNITS = {"t": "s", "g": "rad/s", "a": "g"}
_RACECAPTURE = re.compile(rb'"([^"|,\n]{1,99})"\|"([^"|,\n]{0,99})"\|[-+.\d|]{1,99},?')
"""A heading of RaceCapture: name, unit, least, most and rate."""


def _of_gyroflow(data: bytes) -> bytes:
    """Return the rows of a file of Gyroflow below headings whose units are over a number of counts."""
    start = data.find(b"\nt,gx,gy,gz,") + 1
    head, _, rows = data[start:].partition(b"\n")
    scales = {found[1].decode(): float(found[2]) for found in _GCSV_SCALE.finditer(data[:start])}
    names = [
        f"{name}[{_GCSV_UNITS[name[0]]}/{1 / scales[name[0]]:.9f}]" if scales.get(name[0]) else name
        for name in head.decode("utf-8", "replace").strip().split(",")
    ]
    return ",".join(names).encode() + b"\n" + rows if start else data


def _utc_of_clock(lines: Sequence[str]) -> tuple[float, float] | None:
    """Return drift and offset [s] of UTC against the clock of a FlySight 2, by all its complete stamps."""
    found = [[float(text) for text in match.groups()] for match in map(_FLYSIGHT_TIME.match, lines) if match]
    if not found:
        return None
    clock, of_week, week = np.array(found).T
    offset = week * 7 * DAY + of_week + _GPS_EPOCH - LEAP_SECONDS - clock
    # Before the receiver knows the time a stamp may be far off.
    near = np.abs(offset - np.sort(offset)[offset.size // 2]) < _MAX_STAMP_ERROR
    clock, offset = clock[near], offset[near]
    since = clock - clock.mean()
    if np.ptp(clock) < _SHORTEST_DRIFT:
        return 0.0, float(np.median(offset))
    drift = float(since @ (offset - offset.mean()) / (since @ since))
    return drift, float(offset.mean() - drift * clock.mean())


def kitti_files(stamps: Path, most: int) -> tuple[str, bytes] | None:
    """Return the name and the table of a KITTI drive that lies in a folder; None if there is none.

    Parameters
    ----------
    stamps
        The file ``oxts/timestamps.txt`` of the drive.
    most
        Most bytes of its samples.
    """
    folder = stamps.resolve().parent
    frames = sorted(
        one
        for one in (folder / "data").glob("*.txt")
        if KITTI_FRAME.search(f"oxts/data/{one.name}") and one.is_file()
    )
    if stamps.name != "timestamps.txt" or not frames or sum(one.stat().st_size for one in frames) > most:
        return None
    return folder.parent.name, kitti_table([one.read_bytes() for one in frames], stamps.read_bytes())


def kitti_table(frames: Sequence[bytes], stamps: bytes) -> bytes:
    """Return the samples of a KITTI drive as a csv.

    Parameters
    ----------
    frames
        The files of the samples, in order.
    stamps
        The file with their times, a line for each.
    """
    lines = [f"timestamp,{_KITTI_HEADINGS}"]
    for time, frame in zip(stamps.decode("latin-1").split("\n"), frames, strict=False):
        lines.append(",".join((time.strip(), *frame.decode("latin-1").split())))
    return "\n".join(lines).encode()


def tables_in(path: Path, data: bytes) -> list[tuple[str, bytes]]:
    """Return the tables in a file by name: those in a zip file, a drive of KITTI, or the file itself."""
    if fit.recognises(data):
        return fit_imu.tables(path, data)
    if not data.startswith(ZIP):
        loose = kitti_files(path, MAX_BYTES) if KITTI_STAMP.match(data) else None
        return [loose] if loose else split_tables(path.name, data)
    found = unzip_files(path, data, _wanted_files, MAX_BYTES)
    if not found:
        raise MissionError(
            f"{path}: the zip file has no {', '.join(ENDINGS)} in it; accepted are zip files of such files"
        )
    frames = [(name, text) for name, text in found if KITTI_FRAME.search(name)]
    if not frames:
        return [one for name, text in found for one in split_tables(Path(name).name, text)]
    drive = frames[0][0].partition("/oxts/")[0].rpartition("/")[2]
    return [(drive, kitti_table([text for _, text in frames], found[-1][1]))]


def split_tables(name: str, data: bytes) -> list[tuple[str, bytes]]:
    """Return the tables in a text whose rows are of several kinds, named by these; others as they are.

    Parameters
    ----------
    name
        Name of the file.
    data
        Its bytes.
    """
    head = as_utf8(data[:_HEAD_BYTES])
    of_file, found = "", []
    if is_json(head):
        found = json_tables(as_utf8(data))
    elif is_long(head):
        found, of_file = long_tables(as_utf8(data)), f" of {name}"
    stem = name.partition(".")[0]
    named = [(f"{(kind or stem).replace('.', ' ')}.csv{of_file}", table) for kind, table in found]
    return named or [(name, data)]


def _wanted_files(names: Sequence[str]) -> list[str]:
    """Return the files of a zip file to read: the samples and then the times of a KITTI drive, or tables."""
    frames = sorted(filter(KITTI_FRAME.search, names))
    stamps = list(filter(KITTI_STAMPS.search, names))
    if frames and stamps:
        return [*frames, stamps[0]]
    tables = [one for one in names if one.lower().endswith(ENDINGS) and not one.startswith("__MACOSX")]
    return tables[:MAX_MEMBERS]
