"""Recordings of simulators, damaged in every way: a flight or a reason, soon, and nothing else."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from writers import WRITERS

from lab.missions import MissionError, mission
from lab.missions.raw_flight import RawFlight
from lab.missions.readers import READERS, read_raw

FORMATS = (
    "INS Lab flight csv",
    "X-Plane Data.txt",
    "MSFS/FSX fsLogger csv",
    "MSFS Flight Recorder csv",
    "FlightGear insgns-gps and insgns-imu",
    "JSBSim csv",
)
SEED_BYTES = 24_000
CELLS = (
    b"", b" ", b"nan", b"-inf", b"1e308", b"-1e308", b"1e-320", b"9" * 400, b"0x1p3", b"1e5", b"-0", b"\0",
    b"\xff\xfe", b'"', b"'", b"#", b"True", b"1_000", "١".encode(), b"1,5", b"\r", b"\n\n",
)  # fmt: skip


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
    begin = time.perf_counter()
    try:
        flight = read_raw(paths)
    except MissionError as error:
        assert len(str(error)) < 3000
        flight = None
    assert time.perf_counter() - begin < 5.0 * max(1.0, sum(map(len, files.values())) / 1e6)
    if flight is not None:
        assert len(flight.time) >= 4
        assert flight.rows_read >= len(flight.time)
        assert all(drop.count > 0 and drop.first_row > 0 for drop in flight.dropped)
    return flight


@pytest.mark.parametrize("name", FORMATS)
@settings(max_examples=60)
@given(data=st.data())
def test_damage_gives_a_flight_or_a_reason(tmp_path_factory, name, data):
    files = {}
    for file, seed in seeds(name).items():
        content = bytearray(seed[: data.draw(st.integers(0, len(seed)))])
        for _ in range(data.draw(st.integers(0, 6))):
            place = data.draw(st.integers(0, len(content)))
            end = place + data.draw(st.integers(0, 30))
            content[place:end] = data.draw(st.one_of(st.sampled_from(CELLS), st.binary(max_size=20)))
        files[file] = bytes(content)
    survives(tmp_path_factory.getbasetemp(), files)


@pytest.mark.parametrize("name", FORMATS)
def test_the_seed_itself_is_a_flight(tmp_path, name):
    # Of FlightGear's pair the first is a flight alone, and cut short they go to different times.
    file, data = next(iter(seeds(name).items()))
    flight = survives(tmp_path, {file: data.rpartition(b"\n")[0]})
    assert flight is not None
    assert flight.dropped == ()


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


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
@given(head=st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_recognising_never_fails(reader, head):
    assert reader.recognises(head) in {True, False}
