"""Recordings of simulators with strange headers and numbers: a flight or a reason, soon, and nothing else.

Random damage is done in `tests/fuzz`.
"""

from __future__ import annotations

import tracemalloc
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from processor_time import takes_less_than
from writers import WRITERS

from lab.data.formats import read_raw
from lab.data.rebuild.raw_flight import RawFlight
from lab.missions import MissionError, mission

FORMATS = (
    "INS Lab flight csv",
    "X-Plane Data.txt",
    "MSFS/FSX fsLogger csv",
    "MSFS Flight Recorder csv",
    "FlightGear insgns-gps and insgns-imu",
    "JSBSim csv",
)
SEED_BYTES = 24_000


@cache
def seeds(name: str) -> dict[str, bytes]:
    content = WRITERS[name](mission("montreal").recording)
    files = content if isinstance(content, dict) else {"recording.dat": content}
    return {file: data[:SEED_BYTES] for file, data in files.items()}


def survives(folder: Path, files: dict[str, bytes]) -> RawFlight | None:
    """Read files; return the flight, or None if they are refused as a person can understand."""
    paths = [folder / file for file in files]
    for path, data in zip(paths, files.values(), strict=True):
        path.write_bytes(data)
    with takes_less_than(5.0 * max(1.0, sum(map(len, files.values())) / 1e6)):
        try:
            flight = read_raw(paths)
        except MissionError as error:
            assert len(str(error)) < 3000
            flight = None
    if flight is not None:
        assert len(flight.time) >= 4
        assert flight.rows_read >= len(flight.time)
        assert all(drop.count > 0 and drop.first_row > 0 for drop in flight.dropped)
    return flight


@pytest.mark.parametrize("name", FORMATS)
def test_the_seed_itself_is_a_flight(tmp_path, name):
    # Of FlightGear's pair the first is a flight alone, and cut short they go to different times.
    file, data = next(iter(seeds(name).items()))
    flight = survives(tmp_path, {file: data.rpartition(b"\n")[0]})
    assert flight is not None
    assert flight.dropped == ()


@pytest.mark.proof
@pytest.mark.parametrize("name", [name for name in FORMATS if "FlightGear" not in name])
def test_a_header_in_every_line_and_one_without_end(tmp_path, name):
    ((file, seed),) = seeds(name).items()
    lines = seed.splitlines()
    header = next(line for line in lines if b"ime" in line or b"Mill" in line)
    rows = lines[lines.index(header) + 1 : -1]
    survives(tmp_path, {file: b"\n".join([header] * 5000)})
    survives(tmp_path, {file: b"\n".join(line for row in rows for line in (header, row, row))})
    delimiter = b"|" if b"|" in header else b","
    survives(tmp_path, {file: b"\n".join(line + delimiter + b"1" for line in [header, *rows])})
    wide = delimiter + delimiter.join([b"wide"] * 100_000)
    survives(tmp_path, {file: b"\n".join(line + wide for line in [header, *rows[:5]])})
    survives(tmp_path, {file: b"\n".join([header, *rows, b"1" * 3_000_000])})
    survives(tmp_path, {file: header * 2000})
    survives(tmp_path, {file: b"\n".join([header, *[row.replace(b".", b"e5.") for row in rows]])})


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("row", [0, 3, -1])
def test_numbers_beyond_belief_are_left_out_and_counted(tmp_path, name, row):
    file, data = next(iter(seeds(name).items()))
    lines = data.splitlines()[:-1]
    first = next(i for i, line in enumerate(lines) if b"0." in line and b"ime" not in line)
    place = range(first, len(lines))[row]
    delimiter = next(mark for mark in (b"|", b"\t", b",") if mark in lines[place])
    cells = lines[place].split(delimiter)
    lines[place] = delimiter.join([cells[0], *[b"1e300"] * (len(cells) - 1)])
    flight = survives(tmp_path, {file: b"\n".join(lines)})
    if name == "INS Lab flight csv":
        assert flight is None  # which takes whole files only
    else:
        assert flight is not None
        assert sum(drop.count for drop in flight.dropped) == 1
        assert np.isfinite(flight.time).all()


def test_a_line_of_a_million_cells_costs_no_memory(tmp_path):
    """The parser gives every line behind it as many cells: 3000 lines were 12 GB."""
    rows = [f"{t},{50 + t * 1e-5},{8 + t * 1e-5},{100 + t}" for t in range(3000)]
    rows[1500] += ",9.99" * 1_000_000
    path = tmp_path / "log.csv"
    path.write_text("\n".join(("time,lat,lon,alt", *rows, "")))
    tracemalloc.start()
    try:
        with takes_less_than(5.0):
            flight = read_raw([path])
        assert tracemalloc.get_traced_memory()[1] < 10 * path.stat().st_size
    finally:
        tracemalloc.stop()
    assert len(flight.time) == 2999
    assert any("many times as long as the others" in remark for remark in flight.remarks)
