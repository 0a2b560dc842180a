"""Septentrio SBF: a published block has the values that its parser states; files are flights."""

from __future__ import annotations

import struct

import numpy as np
import pymap3d
import pytest
from live_streams import decoded, fixes, motion
from sensor_logs import tables
from writers import sbf as writer

from lab.data.formats import read_raw
from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.framing import crc16_xmodem
from lab.data.protocols.recognition import recognise
from lab.data.protocols.sbf import SbfEncoder
from lab.missions import MissionError, mission
from lab.missions.flight_import import any_log
from lab.motion.truth.trajectory import Trajectory

# PVTCartesian with its values as semuconsulting/pysbf2 states them (tests/test_parse.py).
BLOCK = bytes.fromhex(
    "2440b759a60f6000589b730c3f0904001d0e5817fc044d41e6e48be6ea2902c1981928b218755341a6dd414251900138b486"
    "713ac09385bbf90295d0e3afe66e4b6cde3f03e0563e000010408f028f020d093250000000002b007a0088000001"
)
BROKEN = BLOCK[:2] + b"\x5e\x62" + BLOCK[4:]
PLACE = (3803640.1823747293, -148797.3625715144, 5100642.783697508)
VELOCITY = (3.0890401831129566e-05, 0.000921349273994565, -0.004076451063156128)


def checked(body: bytes) -> bytes:
    """Return a block with its check, of what follows it."""
    return b"$@" + crc16_xmodem(body).to_bytes(2, "little") + body


def test_a_published_block_has_its_values():
    (fix,) = decoded(make_decoder("septentrio"), BLOCK).fix
    latitude, longitude, height = pymap3d.ecef2geodetic(*PLACE, deg=False)
    assert (fix["latitude"], fix["longitude"]) == pytest.approx((latitude, longitude), abs=1e-13)
    assert fix["height"] == pytest.approx(height, abs=1e-6)
    east, north, up = pymap3d.ecef2enuv(*VELOCITY, np.degrees(latitude), np.degrees(longitude))
    assert fix["velocity_n"] == pytest.approx((north, east, -up), abs=1e-9)
    assert (fix["week_time"], fix["time"]) == (208_903.0, 2367 * 604_800 + 208_903.0)
    # RTK with fixed ambiguities; HAccuracy 1.22 m is twice the rms of the distance, VAccuracy 1.36 m 2 σ.
    assert (fix["fix_type"], fix["satellites"]) == (6, 16)
    assert fix["horizontal_sigma"] == pytest.approx(1.22 / 2 / np.sqrt(2))
    assert fix["vertical_sigma"] == pytest.approx(0.68)
    decoder = make_decoder("septentrio")
    assert not len(decoded(decoder, BROKEN).fix)
    assert decoder.statistics.failed == 1


def test_the_geodetic_form_is_preferred_and_errors_have_no_position():
    geodetic = SbfEncoder().encode(motion(0), fixes(3))
    found = decoded(make_decoder("septentrio"), geodetic + BLOCK).fix
    assert len(found) == 3
    body = bytearray(BLOCK[4:])
    body[11] = 2  # Error: not enough satellites
    (fix,) = decoded(make_decoder("septentrio"), checked(bytes(body))).fix
    assert fix["fix_type"] == 1
    assert np.isnan(fix["latitude"])
    # An older block without accuracies, and one with numbers that are not known.
    old = bytearray(BLOCK[4:88])
    old[2:4] = (88).to_bytes(2, "little")
    (fix,) = decoded(make_decoder("septentrio"), checked(bytes(old))).fix
    assert np.isnan(fix["horizontal_sigma"])
    unknown = bytearray(BLOCK[4:])
    unknown[4:10] = b"\xff" * 6
    (fix,) = decoded(make_decoder("septentrio"), checked(bytes(unknown))).fix
    assert np.isnan(fix["time"])


def test_what_is_sent_is_read():
    sent = fixes(20)
    found = decoded(make_decoder("septentrio"), SbfEncoder().encode(motion(10), sent)).fix
    for name in ("latitude", "longitude", "height"):
        np.testing.assert_allclose(found[name], sent[name], atol=1e-12)
    np.testing.assert_allclose(found["velocity_n"], sent["velocity_n"], atol=1e-5)
    np.testing.assert_allclose(found["time"], sent["time"], atol=1e-3)
    assert found["fix_type"].tolist() == sent["fix_type"].tolist()


def test_the_protocol_is_recognised():
    (first, *_) = recognise(4 * BLOCK)
    assert first.name == "septentrio"


@pytest.mark.parametrize("name", ["Septentrio SBF", "NovAtel OEM"])
def test_a_file_is_a_flight(tmp_path, name):
    from writers import WRITERS

    (tmp_path / "flight.bin").write_bytes(b"noise" + WRITERS[name](mission("montreal").recording)[:-3])
    flight = read_raw(tmp_path / "flight.bin")
    assert flight.format == name
    since = flight.time - (writer.START % 604_800)
    truth = Trajectory.from_recording(mission("montreal").recording, 100.0).at(since)
    np.testing.assert_allclose(flight.latitude, truth.latitude, atol=1e-9)
    np.testing.assert_allclose(flight.height, truth.height, atol=1e-3)
    np.testing.assert_allclose(flight.velocity_n, truth.velocity_n, atol=1e-4)
    # The flight goes on over the end of the week.
    assert np.diff(flight.time) == pytest.approx(0.2, abs=2e-3)


def test_blocks_without_a_position_are_no_flight(tmp_path):
    body = (4027).to_bytes(2, "little") + (16).to_bytes(2, "little") + bytes(8)
    (tmp_path / "raw.sbf").write_bytes(200 * checked(body))
    with pytest.raises(MissionError, match="Septentrio"):
        read_raw(tmp_path / "raw.sbf")


def test_the_attitude_of_a_receiver_is_named_as_not_read(tmp_path):
    """INSPVAS in ASCII, of a published line with other times and places."""
    import binascii

    lines = []
    for at in range(20):
        body = (
            f"INSPVASA,2083,{374524.2 + at:.3f};2083,{374524.2 + at:.9f},{31.51668826 + 1.2e-4 * at:.11f},"
            "120.38636567293,13.9998,13.1095,0.0,-0.0070,2.093819658,2.854168081,316.626703726,INS_SOLUTION_GOOD"
        )
        # The CRC of the manual starts at zero and is not inverted at the end.
        check = binascii.crc32(body.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF
        lines.append(f"%{body}*{check:08x}\r\n")
    (tmp_path / "span.txt").write_text("".join(lines))
    flight = read_raw(tmp_path / "span.txt")
    assert flight.format == "NovAtel OEM"
    np.testing.assert_allclose(np.degrees(flight.latitude), 31.51668826 + 1.2e-4 * np.arange(20), atol=1e-10)
    np.testing.assert_allclose(flight.velocity_n[:, 0], 13.1095)
    assert "The attitude of INSPVA is not read." in flight.remarks


def sensors(stamp, week, *sets):
    """Return an ExtSensorMeas: type and three numbers of each set, in m/s² and °/s."""
    body = b"".join(struct.pack("<4B3d", 1, 4, kind, 0, *values) for kind, values in sets)
    body = struct.pack("<IH2B", stamp, week, len(sets), 28) + body
    return checked(struct.pack("<2H", 4050, 8 + len(body)) + body)


def test_the_measurements_of_its_sensor_are_samples():
    force, rate = (0.25, -0.5, -9.75), (90.0, -45.0, 18.0)
    info = struct.unpack("<3d", struct.pack("<f20x", 31.5))
    whole = sensors(208_903_010, 2367, (0, force), (1, rate), (3, info), (4, (1.0, 2.0, 3.0)))
    unknown = sensors(2**32 - 1, 2367, (1, (-2e10, 1.0, 1.0)))
    alone = sensors(208_903_020, 2**16 - 1, (0, force))
    other = sensors(208_903_030, 2367, (4, (1.0, 2.0, 3.0)))
    decoder = make_decoder("septentrio")
    found = decoded(decoder, whole + unknown + alone + other).imu
    assert len(found) == 2 and decoder.statistics.refused == 1  # a rate of which a part is not known
    assert found["time"][0] == pytest.approx(2367 * 604_800 + 208_903.01)
    np.testing.assert_array_equal(found["force"][0], force)
    np.testing.assert_allclose(found["rate"][0], np.radians(rate), rtol=1e-15)
    assert found["temperature"][0] == 31.5
    assert np.isnan(found["time"][1]) and np.isnan(found["rate"][1]).all()
    np.testing.assert_array_equal(found["force"][1], force)


def test_sets_that_end_beyond_their_block_are_left_out():
    for count, size in ((255, 28), (1, 255), (1, 3), (1, 0)):
        body = struct.pack("<IH2B", 1000, 2367, count, size) + struct.pack("<4B3d", 1, 4, 0, 0, 1, 2, 3)
        block = checked(struct.pack("<2H", 4050, 8 + len(body)) + body)
        assert len(decoded(make_decoder("septentrio"), block).imu) == (count == 255)


def test_a_file_with_a_sensor_is_a_log(tmp_path):
    source = tables(30, 90)
    start = 2367 * 604_800 + 1000.0
    sent = fixes(len(source.gnss))
    sent["time"] = start + source.gnss[:, 0] - source.imu[0, 0]
    sent["latitude"], sent["longitude"] = np.radians(source.gnss[:, 1:3]).T
    sent["height"], sent["velocity_n"] = source.gnss[:, 3], source.gnss[:, 4:7]
    blocks = [(row["time"], SbfEncoder().encode(motion(0), row[None])) for row in sent]
    for t, *values in source.imu:
        stamp = round(1000 * (1000.0 + t - source.imu[0, 0]))
        rates = [float(one) for one in np.degrees(values[:3])]
        blocks.append((start + t - source.imu[0, 0], sensors(stamp, 2367, (0, values[3:]), (1, rates))))
    (tmp_path / "drive.sbf").write_bytes(
        b"".join(block for _, block in sorted(blocks, key=lambda one: one[0]))
    )
    log = any_log([tmp_path / "drive.sbf"])
    rates, forces = log.rates
    at = np.searchsorted(source.imu[:, 0] - source.imu[0, 0], log.time[1:] - log.time[0] - 1e-6)
    np.testing.assert_allclose(forces, source.imu[at, 4:], atol=1e-6)
    np.testing.assert_allclose(rates, source.imu[at, 1:4], atol=1e-9)
    assert len(log.gnss.time) > 100
