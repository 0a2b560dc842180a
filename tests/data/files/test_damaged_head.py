"""Files whose beginning is missing or was stored in another way: the message names that, not the format."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from writers import WRITERS

from lab.data.damaged_head import copied_as_text
from lab.data.formats import read_raw
from lab.data.log.sensor_log import SensorLog
from lab.missions import MissionError, mission
from lab.missions.flight_import import read_log


@pytest.fixture(scope="module")
def recording():
    return mission("montreal").recording


def refused(path, data):
    path.write_bytes(data)
    with pytest.raises(MissionError) as refusal:
        read_raw([path])
    return str(refusal.value)


@pytest.mark.parametrize(("name", "ending"), [("ArduPilot DataFlash", "bin"), ("PX4 sdlog2", "px4log")])
def test_a_log_without_the_descriptions_of_its_messages(tmp_path, recording, name, ending):
    data = WRITERS[name](recording)
    said = refused(tmp_path / f"flight.{ending}", data[len(data) * 3 // 10 :])
    assert "its beginning is missing, which describes their fields (FMT)" in said


def test_a_ulog_without_its_beginning(tmp_path, recording):
    data = WRITERS["PX4 ULog"](recording)
    said = refused(tmp_path / "flight.ulg", data[len(data) * 3 // 10 :])
    assert "It looks like a ULog of PX4, but its beginning is missing" in said


def test_twice_compressed_and_empty(tmp_path, recording):
    data = WRITERS["GPX"](recording)
    assert "compressed twice" in refused(tmp_path / "track.gpx.gz", gzip.compress(gzip.compress(data)))
    assert refused(tmp_path / "track.gpx", b"").endswith("track.gpx: the file is empty")
    assert refused(tmp_path / "empty.gz", gzip.compress(b"")).endswith("empty.gz: the file is empty")


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-le"])
def test_sentences_in_utf_16(tmp_path, recording, coding):
    data = WRITERS["NMEA 0183"](recording).decode().encode(coding)
    assert "It is NMEA 0183 in UTF-16" in refused(tmp_path / "walk.nmea", data)


def said_of(read, path, data):
    """Return the remarks on a file, or why it is refused."""
    path.write_bytes(data)
    try:
        found = read(path)
    except MissionError as refusal:
        return str(refusal)
    return " ".join(found.repairs if isinstance(found, SensorLog) else found.remarks)


@pytest.mark.proof
@pytest.mark.parametrize("read", [lambda path: read_raw([path]), lambda path: read_log([path])])
@pytest.mark.parametrize(("name", "ending"), [("ArduPilot DataFlash", "bin"), ("PX4 ULog", "ulg")])
def test_a_binary_log_that_was_copied_as_text(tmp_path, recording, name, ending, read):
    """Windows programs write a carriage return before each line feed; others replace what is no UTF-8."""
    data, path = WRITERS[name](recording), tmp_path / f"flight.{ending}"
    said = said_of(read, path, data.replace(b"\n", b"\r\n"))
    assert "each line feed has got a carriage return before it" in said
    assert "decoded as text and are lost" in said_of(read, path, data.decode("utf-8", "replace").encode())
    assert "copied as text" not in said_of(read, path, data)


def test_a_table_filled_up_with_zeros_was_not_copied_as_text():
    assert not copied_as_text(b"t_s,lat_deg\r\n" + b"1,48.2\r\n" * 500 + bytes(4000))


@pytest.mark.parametrize("seed", range(8))
def test_noise_is_not_taken_for_a_log(tmp_path, seed):
    """Amid noise there often are lines with a delimiter and names of three columns, such as t."""
    said = refused(tmp_path / "noise.bin", np.random.default_rng(seed).bytes(2**17))
    assert "its format is unknown. Accepted" in said


@pytest.mark.parametrize(
    ("text", "why"), [("", "is empty"), ("1,0,0,0,0,0,-9.8\n" * 9, "has no header with known columns")]
)
def test_a_file_of_a_log_without_rows_or_header_is_named(tmp_path, text, why):
    (tmp_path / "imu.csv").write_text(text)
    (tmp_path / "gnss.csv").write_text("t_s,lat_deg,lon_deg,alt_m\n" + "1,48,11,300\n" * 9)
    with pytest.raises(MissionError, match=rf"no complete gyros.*Not read: imu.csv {why}"):
        read_log([tmp_path])
