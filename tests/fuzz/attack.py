"""Attack: hostile files against a reader, and what must hold whatever is in them.

No exception but `MissionError`, whose message a person can read; an answer within 5 s of a processor per
megabyte; memory of at most ten times the files. What is read is finite, and counts of rows add up.
"""

from __future__ import annotations

import sys
import tracemalloc
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from processor_time import takes_less_than
from writers import WRITERS

from lab.data.formats import HEAD_BYTES, READERS, Reader, read_raw
from lab.data.rebuild.raw_flight import RawFlight
from lab.missions import MissionError, Recording, mission
from lab.missions.flight_import import prepare_import

SECONDS_PER_MEGABYTE = 5.0
TIMES_THE_FILES = 10.0
ALWAYS_ALLOWED = 12e6
"""Memory that a reader may use however small the files, for parsing in pieces [bytes]."""

BY_NAME: dict[str, Reader] = {reader.name: reader for reader in READERS}


def part(start: float = 40.0, seconds: float = 8.0) -> Recording:
    """Return some seconds of montreal."""
    flight = mission("montreal").recording
    rows = (flight.time >= start) & (flight.time < start + seconds)
    names = ("time", "latitude", "longitude", "height", "velocity_n", "euler", "airspeed", "alpha", "beta")
    values = {name: getattr(flight, name) for name in names}
    return Recording(**{name: None if value is None else value[rows] for name, value in values.items()})


@cache
def seeds(name: str, seconds: float = 8.0) -> dict[str, bytes]:
    """Return the files of a flight in a format, by file name."""
    content = WRITERS[name](part(seconds=seconds))
    return content if isinstance(content, dict) else {"recording.dat": content}


def attack(name: str, folder: Path, files: dict[str, bytes], *, weigh: bool = False) -> RawFlight | None:
    """Read files with a reader; return the flight, or None if they are refused.

    Parameters
    ----------
    name
        Of the reader.
    folder
        Where the files are written first.
    files
        Content by file name.
    weigh
        Whether to measure memory too, which takes time.

    Raises
    ------
    AssertionError
        If something does not hold.
    """
    paths = [folder / file for file in files]
    for path, data in zip(paths, files.values(), strict=True):
        path.write_bytes(data)
    size = sum(map(len, files.values()))
    head = next(iter(files.values()))[:HEAD_BYTES]
    assert BY_NAME[name].recognises(head) in {True, False}
    if weigh:
        # The first read imports, and compiles what it imports: that memory is not due to the file.
        _read(name, paths)
        tracemalloc.start()
        flight = _read(name, paths)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak <= TIMES_THE_FILES * size + ALWAYS_ALLOWED, f"{peak / size:.1f} times the {size} bytes"
    else:
        with takes_less_than(SECONDS_PER_MEGABYTE * max(size / 1e6, 1.0)):
            flight = _read(name, paths)
    if flight is not None:
        _check(flight)
    return flight


def rebuild(paths: list[Path]) -> None:
    """Take files the whole way a person's upload takes."""
    try:
        made = prepare_import(paths)
        assert np.isfinite(made.recording.velocity_n).all()
    except MissionError as error:
        _check_message(error)


def _read(name: str, paths: list[Path]) -> RawFlight | None:
    reader, flight = BY_NAME[name], None
    # The reader itself, and the way on which it is found by the content.
    for read in (lambda: reader.read(paths, {}), lambda: read_raw(paths)):
        try:
            flight = read()
        except MissionError as error:
            _check_message(error)
    if reader.read_log is not None:
        try:
            log = reader.read_log(paths[0])
            assert np.isfinite(log.dtheta).all()
            assert np.isfinite(log.gnss.position).all()
        except MissionError as error:
            _check_message(error)
    return flight


def _check_message(error: MissionError) -> None:
    assert 10 < len(str(error)) < 3000, str(error)[:300]


def _check(flight: RawFlight) -> None:
    assert len(flight.time) >= 4
    assert flight.rows_read >= len(flight.time)
    assert all(drop.count > 0 and drop.first_row > 0 for drop in flight.dropped)
    for name in flight.quantities:
        assert np.isfinite(getattr(flight, name)).all()
    if flight.latitude is not None:
        assert np.abs(flight.latitude).max() <= np.pi / 2 + 1e-9
