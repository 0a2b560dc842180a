"""Headings and speeds in a stream, against pyubx2, pynmeagps and pymavlink."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from live_streams import decoded
from pynmeagps import NMEAMessage, NMEAReader
from pyubx2 import GET, UBXMessage, UBXReader

from lab.data.protocols.catalogue import ENCODERS, make_decoder
from lab.data.protocols.samples import READING

HEADINGS = (0.0, 89.99, 180.0, 270.5, 359.99)
"""[°]."""


def rows(**columns) -> np.ndarray:
    """Return readings of which only these columns are known."""
    made = np.zeros(len(next(iter(columns.values()))), READING)
    for name in READING.names or ():
        made[name] = columns.get(name, 0 if name == "end" else np.nan)
    return made


def relative_position(degrees: float, **flags: int) -> bytes:
    """Return NAV-RELPOSNED as pyubx2 writes it."""
    said = {"gnssFixOK": 1, "isMoving": 1, "relPosHeadingValid": 1} | flags
    return UBXMessage(
        "NAV", "NAV-RELPOSNED", GET, version=1, iTOW=345_600_200, relPosLength=100,
        relPosHeading=degrees, accHeading=0.4, **said,
    ).serialize()  # fmt: skip


@pytest.mark.parametrize("degrees", HEADINGS)
def test_the_heading_of_a_moving_base_is_that_of_pyubx2(degrees: float) -> None:
    (row,) = decoded(make_decoder("ublox"), relative_position(degrees)).reading
    assert math.degrees(row["heading"]) == pytest.approx(degrees, abs=1e-5)
    assert math.degrees(row["heading_sigma"]) == pytest.approx(0.4, abs=1e-5)
    assert row["week_time"] == pytest.approx(345_600.2)
    assert math.isnan(row["speed"])


@pytest.mark.parametrize("flag", ["gnssFixOK", "isMoving", "relPosHeadingValid"])
def test_a_heading_that_is_invalid_or_of_a_base_that_stands_is_not_taken(flag: str) -> None:
    assert not len(decoded(make_decoder("ublox"), relative_position(90.0, **{flag: 0})).reading)


@pytest.mark.parametrize("speed", [0.0, 12.345, -3.2])
def test_the_speed_of_a_vehicle_is_that_of_pyubx2(speed: float) -> None:
    word = 11 << 24 | round(speed * 1e3) & 0xFFFFFF
    message = UBXMessage("ESF", "ESF-MEAS", GET, payload=struct.pack("<IHHI", 7_200, 1 << 11, 0, word))
    assert (message.numMeas, message.dataType_01, message.timeTag) == (1, 11, 7_200)
    (row,) = decoded(make_decoder("ublox"), message.serialize()).reading
    assert row["speed"] == pytest.approx(speed, abs=1e-9)
    assert row["time"] == pytest.approx(7.2)


def test_pyubx2_reads_what_the_encoder_writes() -> None:
    sent = rows(time=[7.2, 7.4], week_time=[345_600.2, 345_600.4], heading=np.radians([359.5, -90.0]))
    sent["heading_sigma"] = np.radians(0.35)
    for data, degrees in zip(
        (ENCODERS["ublox"]().encode_readings(row[None]) for row in sent), (359.5, 270.0), strict=True
    ):
        found = UBXReader.parse(data)
        assert found.relPosHeading == pytest.approx(degrees, abs=1e-4)
        assert found.accHeading == pytest.approx(0.35, abs=1e-5)
        assert (found.relPosHeadingValid, found.isMoving, found.version) == (1, 1, 1)


@pytest.mark.parametrize("degrees", HEADINGS)
def test_headings_of_nmea_are_those_of_pynmeagps(degrees: float) -> None:
    data = NMEAMessage("GP", "HDT", 0, headingT=degrees, headingTu="T").serialize()
    data += NMEAMessage("GN", "THS", 0, headt=degrees, mi="A").serialize()
    found = decoded(make_decoder("nmea"), data).reading
    np.testing.assert_allclose(np.degrees(found["heading"]), [degrees] * 2, atol=1e-9)


@pytest.mark.parametrize("mode", ["E", "V", ""])
def test_an_estimated_or_invalid_heading_is_not_taken(mode: str) -> None:
    data = NMEAMessage("GN", "THS", 0, headt=12.5, mi=mode).serialize()
    assert not len(decoded(make_decoder("nmea"), data).reading)


def test_yaw_and_wheels_are_those_of_pymavlink() -> None:
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    none = (1, 0, 0, 0, 65_535, 65_535, 65_535, 65_535, 255, 0, 0)
    data = b"".join(
        link.gps2_raw_encode(4_000_000, *none, yaw).pack(link) for yaw in (36_000, 9_000, 0, 65_535)
    )
    for number, distance in enumerate((10.0, 12.0, 11.0)):
        wheels = [distance - 0.5, distance + 0.5, *[99.0] * 14]
        data += link.wheel_distance_encode(5_000_000 + 200_000 * number, 2, wheels).pack(link)
    found = decoded(make_decoder("mavlink"), data).reading
    np.testing.assert_allclose(found["heading"], [2 * np.pi, np.pi / 2, np.nan, np.nan])
    np.testing.assert_allclose(found["speed"], [np.nan, np.nan, 10.0, -5.0])
    np.testing.assert_allclose(found["time"], [4.0, 4.0, 5.1, 5.3])


def test_the_uncertainty_of_a_yaw_is_its_sigma() -> None:
    """MAVLink: `hdg_acc` in 1e-5°; PX4 sends it with the yaw, ArduPilot sends 0, which is unknown."""
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    second = (1, 0, 0, 0, 65_535, 65_535, 65_535, 65_535, 255, 0, 0)
    first = (1, 0, 0, 0, 65_535, 65_535, 65_535, 65_535, 255)
    data = b"".join(
        link.gps2_raw_encode(4_000_000, *second, 9_000, hdg_acc=sigma).pack(link)
        + link.gps_raw_int_encode(4_000_000, *first, yaw=9_000, hdg_acc=sigma).pack(link)
        for sigma in (40_000, 0)
    )
    data += link.gps_raw_int_encode(4_000_000, *first, yaw=0, hdg_acc=40_000).pack(link)  # of a course
    found = decoded(make_decoder("mavlink"), data).reading
    np.testing.assert_allclose(np.degrees(found["heading_sigma"]), [0.4, 0.4, np.nan, np.nan])


def test_a_text_line_that_repeats_a_speed_is_no_new_reading() -> None:
    lines = [
        "time[s],rate_x[°/s],rate_y[°/s],rate_z[°/s],ax[g],ay[g],az[g],true heading[°],wheel speed[km/h]"
    ]
    lines += [
        f"{number / 100:.2f},0.1,0.2,0.3,0.01,0.02,1.00,{90 + number // 20},{36 + number // 10}"
        for number in range(40)
    ]
    found = decoded(make_decoder("text"), "".join(f"{line}\n" for line in lines).encode())
    assert len(found.imu) == 40
    speed, heading = (found.reading[name] for name in ("speed", "heading"))
    np.testing.assert_allclose(speed[np.isfinite(speed)], np.arange(36, 40) / 3.6)
    np.testing.assert_allclose(np.degrees(heading[np.isfinite(heading)]), [90, 91])


def test_pyubx2_reads_the_speeds_that_the_encoder_writes() -> None:
    speeds = (0.0, 12.345, -3.2, 83.111)
    sent = rows(time=7.2 + 0.2 * np.arange(4), speed=speeds)
    for row, speed in zip(sent, speeds, strict=True):
        found = UBXReader.parse(ENCODERS["ublox"]().encode_readings(row[None]))
        assert (found.identity, found.numMeas, found.dataType_01) == ("ESF-MEAS", 1, 11)
        word = found.dataField_01
        assert (word - 2**24 if word & 2**23 else word) * 1e-3 == pytest.approx(speed, abs=1e-9)
        assert found.timeTag == round(1e3 * row["time"])


@pytest.mark.parametrize("device", ["nmea", "vectornav", "xsens", "mip"])
def test_pynmeagps_reads_the_headings_that_encoders_write(device: str) -> None:
    data = ENCODERS[device]().encode_readings(rows(heading=np.radians(HEADINGS)))
    found = [NMEAReader.parse(line + b"\n") for line in data.splitlines()]
    assert [one.msgID for one in found] == ["HDT"] * len(HEADINGS)
    np.testing.assert_allclose([one.headingT for one in found], HEADINGS, atol=5e-5)


def test_pymavlink_reads_the_yaw_and_the_wheels_that_the_encoder_writes() -> None:
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    time = 4.0 + 0.2 * np.arange(5)
    sent = rows(time=time, heading=np.radians(HEADINGS), speed=[3.0, 5.0, 4.0, 0.0, -2.0])
    sent["heading_sigma"] = np.radians(0.35)
    found = dialect.MAVLink(None).parse_buffer(ENCODERS["mavlink"]().encode_readings(sent))
    antennas, wheels = (
        [one for one in found if one.get_type() == name] for name in ("GPS2_RAW", "WHEEL_DISTANCE")
    )
    assert [one.yaw for one in antennas] == [36_000, 8_999, 18_000, 27_050, 35_999]
    assert {one.hdg_acc for one in antennas} == {35_000}
    assert {one.fix_type for one in antennas} == {1}  # its position must not be taken
    np.testing.assert_allclose([one.time_usec * 1e-6 for one in (*antennas, *wheels)], [*time, *time])
    # The distance is the integral of a speed that is linear between the readings.
    np.testing.assert_allclose([one.distance[0] for one in wheels], [0.0, 0.8, 1.7, 2.1, 1.9], atol=1e-9)
    assert {one.count for one in wheels} == {1}
