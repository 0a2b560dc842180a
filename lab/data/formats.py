"""Formats: the format of a file is detected by its content, and the module of `lab.data.files` reads it."""

from __future__ import annotations

import gzip
import os
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.data.damaged_head import as_plain_text, copied_as_text, what_is_damaged
from lab.data.files import acmi, ardupilot, fit, gpx, igc, kf_gins, kml, own_csv, sdlog2, tcx, ulog
from lab.data.files.profile import shipped_profiles
from lab.data.files.streams import Stream
from lab.data.log.sensor_log import SensorLog
from lab.data.protocols import mavlink_file, receiver_file
from lab.data.protocols.recognition import sound_frames
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.sheets import flightgear, garmin_csv, sensor_csv, simulator_csv, xplane_data
from lab.data.sheets.flight_columns import recognises_header
from lab.data.sheets.sheet_coordinates import LatitudeError

HEAD_BYTES = 2**16
"""Bytes at the start of a file, decompressed, from which the readers detect its format."""
MAX_FILES = 4
"""Most files one flight may be spread over."""


@dataclass(frozen=True)
class Reader:
    """A format the lab can read.

    Attributes
    ----------
    name : str
        Name for people, such as "X-Plane Data.txt".
    recognises : callable
        Returns from the first `HEAD_BYTES` of a file whether it has this format; never raises.
    read : callable
        Reads the files of one flight, with units (column to unit name) that overrule what the file says.
        Raises `MissionError` for whatever is wrong, and nothing else.
    read_log : callable or None
        Reads the recorded IMU and GPS of a log that has both.
    read_logs : callable or None
        The same of several files, with corrections by a person: units or quantities by column, the axes of
        the IMU that point forward, right and down, and the vehicle.
    read_imu : callable or None
        Reads angular rate and specific force (n, 6) alone, such as those of an IMU at rest.
    is_guessed : bool
        Whether its numbers alone show the format: it is another one if a person says what columns are.
    """

    name: str
    recognises: Callable[[bytes], bool]
    read: Callable[[Sequence[Path], Mapping[str, str]], RawFlight]
    read_log: Callable[[Path], SensorLog] | None = None
    read_logs: Callable[[Sequence[Path], Mapping[str, str], Sequence[str], str], SensorLog] | None = None
    read_imu: Callable[[Path], Stream] | None = None
    is_guessed: bool = False


READERS: tuple[Reader, ...] = (
    Reader(own_csv.NAME, own_csv.recognises, own_csv.read),
    Reader(xplane_data.NAME, xplane_data.recognises, xplane_data.read),
    *(
        Reader(
            one.name,
            partial(recognises_header, profile=one),
            partial((garmin_csv if one.magnetic else simulator_csv).read, one),
        )
        for one in shipped_profiles()
        if one.simulator
    ),
    Reader(flightgear.NAME, flightgear.recognises, flightgear.read),
    Reader(gpx.NAME, gpx.recognises, gpx.read),
    Reader(fit.NAME, fit.recognises, fit.read, read_logs=sensor_csv.read_logs),
    Reader(kml.NAME, kml.recognises, kml.read),
    Reader(tcx.NAME, tcx.recognises, tcx.read),
    *(
        Reader(name, partial(receiver_file.recognises, name), read)
        for name, read in (
            (receiver_file.NMEA, receiver_file.read_nmea),
            (receiver_file.UBX, receiver_file.read_ubx),
            (receiver_file.NOVATEL, partial(receiver_file.read, receiver_file.NOVATEL)),
            (receiver_file.SBF, partial(receiver_file.read, receiver_file.SBF)),
        )
    ),
    Reader(acmi.NAME, acmi.recognises, acmi.read),
    Reader(igc.NAME, igc.recognises, igc.read),
    Reader(
        kf_gins.NAME,
        kf_gins.recognises,
        kf_gins.read,
        read_logs=kf_gins.read_logs,
        read_imu=kf_gins.read_imu,
        is_guessed=True,
    ),
    Reader(ulog.NAME, ulog.recognises, ulog.read, ulog.read_log, read_imu=ulog.read_imu),
    Reader(sdlog2.NAME, sdlog2.recognises, sdlog2.read, sdlog2.read_log, read_imu=sdlog2.read_imu),
    Reader(
        ardupilot.NAME, ardupilot.recognises, ardupilot.read, ardupilot.read_log, read_imu=ardupilot.read_imu
    ),
    Reader(
        mavlink_file.NAME,
        mavlink_file.recognises,
        mavlink_file.read,
        mavlink_file.read_log,
        read_imu=mavlink_file.read_imu,
    ),
    Reader(
        sensor_csv.NAME, sensor_csv.recognises, sensor_csv.read, sensor_csv.read_log, sensor_csv.read_logs
    ),
)
"""All readers. Of all but the last, at most one recognises a file; the last has the tables that are left."""


_COPIED_BYTES = 2**20
"""Bytes by which it is judged whether a file was copied as text: logs of PX4 begin with 64 kB of few line
feeds."""
_JSBSIM = "JSBSim csv"
_UNMISTAKABLE = re.compile(rb"[{}]|[a-z]/[a-z]+-[a-z]")
"""What headings have that are JSBSim's alone: V_{North} (ft/s), or the path of a property."""
_TABLE = (
    "It looks like a table whose headings do not say what its columns are: --column HEADING=QUANTITY[UNIT] "
    "does, with the number of a column where there is no header."
)
_EXPORT = "It is a {} file: export its topics or tables as csv with named columns."
_NOT_READ = {
    rb"PK\x03\x04": "It is a zip archive: unpack it first. Zip files of csv files are read as they are.",
    rb"(?i)[^\n]{0,200}?(?:p_RS_R_x|\btx,? ty,? tz\b|pos(?:ition)?[._]x\b[^\n]*pos(?:ition)?[._]y\b)": (
        "It holds positions in metres from an origin, as of EuRoC or TUM, whose latitude, longitude and "
        "azimuth it does not give; a flight needs positions on the Earth."
    ),
    rb"(?s).{0,2000}?\$(?:G[A-Z]|B[DQ])(?:GGA|RMC|GLL|GNS|VTG),|(?s:.{0,2000}?)\$P[A-Z]{3},": (
        "It looks like NMEA 0183, but has no GGA, GNS, RMC or GLL with a position and a right checksum (*hh "
        "at the end) in its first 64 kB."
    ),
    rb"[^\0]{0,2000}?[#%](?:BEST|INS|RAWIMU|MARK|PSR)[A-Z]{0,10}A,": (
        "It looks like ASCII logs of a NovAtel receiver. ins-lab import FILE --as log makes a sensor log of "
        "them, if they have RAWIMUX and BESTPOS."
    ),
    rb"MATLAB 5|.HDF\r\n": _EXPORT.format("MATLAB or HDF5"),
    rb"#ROSBAG|\x89MCAP|SQLite format 3": _EXPORT.format("ROS bag or database"),
    rb"\s*\d+\s+\d\d:\d\d:\d\d,\d{3} --> ": (
        "It holds subtitles (SRT) of a video: convert them to csv or GPX."
    ),
    rb"(?s).{4}ftyp": "It is a video: extract its telemetry as csv or GPX, for GoPro with gpmf tools.",
    rb"\s*[\[{]\s*[\"{\[]": _EXPORT.format("JSON"),
    rb"[^\n]{40,70}RINEX VERSION": "It holds raw observations of satellites (RINEX) and no positions.",
    rb"[^\0]{0,2000}?\n[^\0A-DF-Za-df-z\n]{0,99}\d[^\0A-Za-z\d\n]{0,9}[,;\t ][^\0A-Za-z\d\n]{0,99}\d": _TABLE,
}
"""How files of known formats that are not read begin, and the advice that is reported."""


def reader_of(path: Path, units: Mapping[str, str] | None = None) -> Reader:
    """Return the reader of a file, by its content.

    Parameters
    ----------
    path
        The file.
    units
        What a person says of columns; quantities among them make any table one with named columns.

    Raises
    ------
    MissionError
        If the file cannot be read, or its format is unknown, listing the known ones.
    """
    head = start_of(path)
    is_said = units is not None and any(sensor_csv.names_quantity(text) for text in units.values())
    for reader in READERS:
        if reader.recognises(head) and not (is_said and reader.is_guessed):
            return reader
    if is_said:
        return READERS[-1]
    if not head:
        raise MissionError(f"{path}: the file is empty")
    advice = next((advice for mark, advice in _NOT_READ.items() if re.match(mark, head)), "")
    if (plain := as_plain_text(head)) and (found := [one.name for one in READERS if one.recognises(plain)]):
        advice = f"It is {found[0]} in UTF-16, as Windows PowerShell writes it: save it as UTF-8 or ASCII."
    advice = (
        what_is_damaged(path, head)
        or advice_on_frames(head)
        or (sensor_csv.missing_time_reason(head) if advice == _TABLE else "")
        or (sensor_csv.what_is_missing(head) if advice in ("", _TABLE) else "")
        or advice
    )
    if advice in ("", _TABLE) and (frames := sound_frames(head)):
        raise MissionError(f"{path}: {frames}")
    hint = f" {advice}" if advice else ""
    raise MissionError(
        f"{path}: its format is unknown.{hint} Accepted: {', '.join(reader.name for reader in READERS)}"
    )


def log_reader_of(path: Path, units: Mapping[str, str] | None = None) -> Reader:
    """Return the reader of the log in a file: a table of a simulator's headings may be one of a log's files.

    Parameters
    ----------
    path
        The file.
    units
        What a person says of columns.

    Raises
    ------
    MissionError
        As `reader_of`.
    """
    reader = reader_of(path, units)
    is_table = reader.read_log is None and sensor_csv.recognises(start_of(path))
    return READERS[-1] if is_table else reader


def may_be_table(path: Path) -> bool:
    """Return whether a file is a table with named columns, or of no known format."""
    try:
        return reader_of(path) is READERS[-1]
    except MissionError:
        return True


def read_raw(
    paths: Sequence[str | os.PathLike[str]] | str | os.PathLike[str], units: Mapping[str, str] | None = None
) -> RawFlight:
    """Read a flight recording of any format.

    Parameters
    ----------
    paths
        The file, or the files where a format spreads a flight over several, in any order.
    units
        Units that overrule what the file says or the reader guesses, by name of the column.

    Raises
    ------
    MissionError
        For whatever is wrong with a file.
    """
    files = [Path(paths)] if isinstance(paths, str | os.PathLike) else [Path(path) for path in paths]
    if not 1 <= len(files) <= MAX_FILES:
        raise MissionError(f"{len(files)} files given; accepted are 1 to {MAX_FILES} of one flight")
    readers = [reader_of(path, units) for path in files]
    if READERS[-1] in readers and len(set(readers)) > 1:
        readers = [log_reader_of(path, units) for path in files]
    for path, reader in zip(files, readers, strict=True):
        if reader is not readers[0]:
            raise MissionError(
                f"{path}: is {reader.name}, and {files[0]} is {readers[0].name}; accepted are files of one "
                "flight in one format"
            )
    copied = copied_as_text(start_of(files[0], _COPIED_BYTES))
    try:
        raw = readers[0].read(files, units or {})
        return replace(raw, remarks=(*raw.remarks, copied)) if copied else raw
    except MissionError as refusal:
        if copied:
            raise MissionError(f"{refusal}. {copied}") from refusal
        if readers[0].name != _JSBSIM or any(_UNMISTAKABLE.search(start_of(path)) for path in files):
            raise
        # JSBSim's headings time, latitude and vn are those of any receiver, too.
        try:
            return READERS[-1].read(files, units or {})
        except LatitudeError as error:
            raise error from None
        except MissionError:
            pass
        raise


def read_log_of(reader: Reader, path: Path) -> SensorLog:
    """Return the log of an autopilot's file.

    Parameters
    ----------
    reader, path
        The reader, with `read_log`, and its file.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    if reader.read_log is None:
        logs = ", ".join(other.name for other in READERS if other.read_log is not None)
        raise MissionError(f"{path}: is {reader.name}, which has no IMU and GPS; accepted: {logs}")
    copied = copied_as_text(start_of(path, _COPIED_BYTES))
    try:
        log = reader.read_log(path)
    except MissionError as refusal:
        if copied:
            raise MissionError(f"{refusal}. {copied}") from refusal
        raise
    return replace(log, repairs=(*log.repairs, copied)) if copied else log


def start_of(path: Path, size: int = HEAD_BYTES) -> bytes:
    """Return the first bytes of a file, decompressed.

    Raises
    ------
    MissionError
        If it cannot be read.
    """
    try:
        check_file(path, 2**40)
        with path.open("rb") as file:
            head = file.read(size)
        if head.startswith(b"\x1f\x8b"):
            with gzip.open(path, "rb") as stream:
                return stream.read(size)
    except MissionError:
        raise
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise MissionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return head


_TO_LOG = (
    "ins-lab import FILE --as log makes a sensor log of it, and so does the page, if it has intact samples "
    "of an IMU and fixes."
)
_TO_CONVERT = "Convert them with the maker's software to a csv with named columns, or to NMEA."
_FRAMES = (
    ("an IMU of Xsens", (b"\xfa\xff\x36",), _TO_LOG),
    ("an IMU of Xsens, in its older format MTData", (b"\xfa\xff\x32",), _TO_CONVERT),
    ("an IMU of MicroStrain", (b"ue\x80", b"ue\x82", b"ue\x91"), _TO_LOG),
    ("an IMU of VectorNav", (b"\xfa\x01", b"\xfa\x03", b"\xfa\x05", b"\xfa\x15", b"\xfa\x1d"), _TO_LOG),
    ("a NovAtel receiver", (b"\xaaD\x12", b"\xaaD\x13"), _TO_LOG),
    ("a Septentrio receiver", (b"$@",), _TO_LOG),
    ("a SiRF receiver", (b"\xb0\xb3\xa0\xa2",), _TO_CONVERT),
    ("a SkyTraq receiver", (b"\r\n\xa0\xa1",), _TO_CONVERT),
)
"""Devices, the bytes at which their frames begin (their manuals: MTData2 and MTData, MIP, binary output
messages, OEM7, SBF, SiRF Binary, SkyTraq Binary), and what makes a file that is read."""
_FRAME_BYTES = 1024
"""Bytes for each such beginning from which a file consists of frames: they have up to 500 on average."""
_MIN_FRAMES = 8
"""Fewest of them: random bytes have the shortest beginning once in 65,536."""


def advice_on_frames(head: bytes) -> str:
    """Return a sentence on a file of a device's frames; empty for any other one.

    Parameters
    ----------
    head
        Its first bytes, decompressed.
    """
    for device, marks, advice in _FRAMES:
        if sum(head.count(mark) for mark in marks) >= max(_MIN_FRAMES, len(head) / _FRAME_BYTES):
            return f"It looks like binary frames of {device}. {advice}"
    return ""
