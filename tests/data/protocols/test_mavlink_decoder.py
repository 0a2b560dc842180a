"""MAVLink: captured and packed messages have the values that pymavlink reads in them."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from live_streams import capture, decoded, fixes, motion
from pymavlink.dialects.v20 import ardupilotmega as dialect
from writers.mavlink import Station, log

from lab.data.protocols import mavlink_file
from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.decoder import DecoderError
from lab.data.protocols.framing import crc16_mcrf4xx
from lab.data.protocols.mavlink_encoder import MavlinkEncoder
from lab.data.protocols.recognition import recognise
from lab.missions import MissionError

TLOG = "mavlink_blueos_head400k.tlog"
G = 9.80665


def frames(data: bytes) -> list[tuple[int, bytes]]:
    """Return the frames of a tlog and where they end, by their lengths alone."""
    found, at = [], 8
    while at + 3 < len(data):
        size = data[at + 1] + (12 + 13 * (data[at + 2] & 1) if data[at] == 0xFD else 8)
        if at + size > len(data):
            break
        found.append((at + size, data[at : at + size]))
        at += size + 8
    return found


def test_the_check_is_that_of_the_catalogue():
    assert crc16_mcrf4xx(b"123456789") == 0x6F91


def test_the_captured_imu_has_the_values_of_pymavlink():
    data = capture(TLOG)
    link = dialect.MAVLink(None)
    read = [(end, link.decode(bytearray(frame))) for end, frame in frames(data)]
    decoder = make_decoder("mavlink")
    found = decoded(decoder, data)
    assert decoder.statistics.frames == len(read) == 9720
    raw = [(end, message) for end, message in read if message.get_type() == "RAW_IMU"]
    assert len(found.imu) == len(raw) == 128
    first = raw[0][1]
    assert (first.time_usec, first.xacc, first.yacc, first.zacc, first.zgyro, first.xmag) == (
        2154938,
        95,
        992,
        31,
        -29,
        -222,
    )
    for row, (end, message) in zip(found.imu, raw, strict=True):
        assert row["end"] == end
        assert row["time"] == pytest.approx(message.time_usec * 1e-6)
        assert row["force"] == pytest.approx(
            [1e-3 * G * value for value in (message.xacc, message.yacc, message.zacc)]
        )
        assert row["rate"] == pytest.approx(
            [1e-3 * value for value in (message.xgyro, message.ygyro, message.zgyro)]
        )
        assert row["magnetic"] == pytest.approx(
            [1e-7 * value for value in (message.xmag, message.ymag, message.zmag)]
        )
        assert row["temperature"] == pytest.approx(message.temperature * 1e-2)
    fixless = [end for end, message in read if message.get_type() == "GPS_RAW_INT"]
    assert found.fix["end"].tolist() == fixless
    assert (found.fix["fix_type"] == 1).all()


def test_pymavlink_reads_what_is_encoded_and_so_do_we():
    imu, fix = motion(200), fixes(2)
    data = MavlinkEncoder().encode(imu, fix)
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    read = parser.parse_buffer(data)
    samples = [message for message in read if message.get_type() == "HIGHRES_IMU"]
    places = [message for message in read if message.get_type() == "GPS_RAW_INT"]
    found = decoded(make_decoder("mavlink"), data)
    assert (len(found.imu), len(found.fix)) == (len(samples), len(places)) == (200, 2)
    for row, message in zip(found.imu, samples, strict=True):
        assert row["rate"].tolist() == [message.xgyro, message.ygyro, message.zgyro]
        assert row["force"].tolist() == [message.xacc, message.yacc, message.zacc]
        assert row["pressure"] == pytest.approx(message.abs_pressure * 100)
        assert row["temperature"] == message.temperature
    for row, message in zip(found.fix, places, strict=True):
        assert np.degrees(row["latitude"]) == pytest.approx(message.lat * 1e-7, abs=1e-12)
        assert row["height"] == pytest.approx(message.alt_ellipsoid * 1e-3)
        assert row["speed_sigma"] == pytest.approx(message.vel_acc * 1e-3)
        assert np.hypot(*row["velocity_n"][:2]) == pytest.approx(message.vel * 1e-2)
    np.testing.assert_allclose(found.fix["velocity_n"][:, :2], fix["velocity_n"][:, :2], atol=0.01)


def scaled(system: int, kind: str, time: int, acc: int = -1000, v1: bool = False) -> bytes:
    """Return a message of an IMU at rest, with a force along z in thousandths of g."""
    station = Station(system)
    station.add(0.0, kind, 1000 * time if kind == "raw_imu" else time, 0, 0, acc, 1, 2, 3, 0, 0, 0, v1=v1)
    return station.frames[0][1]


def test_one_message_of_one_vehicle_is_the_imu():
    decoder = make_decoder("mavlink")
    stream = b"".join(
        scaled(1, "scaled_imu2", 10 * time)
        + scaled(1, "raw_imu", 10 * time, v1=True)
        + scaled(2, "scaled_imu", 10 * time)
        for time in range(1, 11)
    )
    imu = decoded(decoder, stream).imu
    # SCALED_IMU2 until the first RAW_IMU, which goes before it.
    assert imu["time"].tolist() == pytest.approx([0.01, *np.arange(0.01, 0.105, 0.01)])
    assert imu["rate"][0].tolist() == pytest.approx([0.001, 0.002, 0.003])
    assert imu["force"][:, 2] == pytest.approx(-G)


def test_counts_of_an_unknown_unit_are_not_taken():
    assert (
        decoded(
            make_decoder("mavlink"), b"".join(scaled(1, "raw_imu", time, -16384) for time in range(20))
        ).imu.size
        == 0
    )


def test_without_pymavlink_the_message_names_the_command(tmp_path, monkeypatch):
    station = Station()
    station.add(0.0, "HEARTBEAT", 2, 3, 81, 0, 4)
    (tmp_path / "log").write_bytes(log(station))
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(DecoderError, match=r"needs pymavlink.*pip install 'ins-lab\[mavlink\]'"):
        make_decoder("mavlink")
    assert recognise(b"\xfd" * 100) == []
    path = tmp_path / "log"
    for read in (lambda: mavlink_file.read([path], {}), lambda: mavlink_file.read_log(path)):
        with pytest.raises(MissionError, match=r"needs pymavlink.*pip install 'ins-lab\[mavlink\]'"):
            read()
