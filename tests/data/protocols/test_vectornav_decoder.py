"""VectorNav: captured and published messages have the values that others read in them."""

from __future__ import annotations

import csv
import math
import struct

import numpy as np
import pytest
from live_streams import capture, decoded, fixes, hexadecimal, motion
from writers.vectornav_lines import lines

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.samples import CLIPPED_FORCE, CLIPPED_RATE, join_samples
from lab.data.protocols.vectornav import VectorNavEncoder

EXAMPLE = hexadecimal("FA 01 08 00 93 50 2E 42 83 3E F1 3F 48 B5 04 BB 92 88")
"""Yaw, pitch and roll: manual UM001, first example."""
BAD_EXAMPLE = hexadecimal("FA 05 08 00 01 00 A4 15 02 42 4D DF EB 3F F6 1A 36 BE BF 2D A4 41 A8 3A")
"""The manual's second example, whose CRC is wrong as printed."""
COMMON = hexadecimal(
    "FA 01 28 05 A8 02 C3 3F E7 89 B0 42 3D A9 6A C1 D0 83 54 3A 92 3E 0B BB 1C 25 30 BA 04 7D 1C 41 "
    "3B B2 83 3D 4E EA 9C BE F1 BD 93 BE A4 55 8C BD 26 C7 77 3E F4 28 E6 41 57 CE C1 42 C0 E9 "
)
"""UWOrbital/obc-firmware, test/unit/test_vn100_unpack.cpp, with the values below."""
LINES = {
    # dawonn/vectornav, getting_started/main.c, and comments of public drivers.
    b"$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,-01.258,-00.100,-09.701,-00.000018,+00.001122,"
    b"-00.000551*69\r\n": (
        (-1.258, -0.1, -9.701),
        (-0.000018, 0.001122, -0.000551),
        (-0.0049, -0.2449, 0.5397),
    ),
    b"$VNYMR,-004.328,+001.357,+178.257,+00.2219,-00.0720,+00.4652,+00.226,-00.321,+10.043,-00.001188,+00.001866,"
    b"-00.007661*6C\r\n": (
        (0.226, -0.321, 10.043),
        (-0.001188, 0.001866, -0.007661),
        (0.2219, -0.072, 0.4652),
    ),
    b"$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,+20.7,+084.322*66"
    b"\r\n": ((-0.015, 0.019, 9.948), (0.002066, -0.008442, -0.044656), (-0.035, 0.4222, -0.6643)),
}
CSV = "vn100_bin_waves_F00294.expected.csv"


def crc(data: bytes) -> int:
    """Return the CRC as the manual computes it, byte by byte."""
    value = 0
    for byte in data:
        value = (value >> 8 | value << 8) & 0xFFFF
        value ^= byte
        value ^= (value & 0xFF) >> 4
        value ^= value << 12 & 0xFFFF
        value ^= (value & 0xFF) << 5
    return value


def message(groups: int, fields: list[int], payload: bytes) -> bytes:
    """Return a message of groups and fields."""
    body = bytes((groups,)) + struct.pack(f"<{len(fields)}H", *fields) + payload
    return b"\xfa" + body + crc(body).to_bytes(2, "big")


def test_the_published_message_has_the_published_values():
    decoder = make_decoder("vectornav")
    (row,) = decoded(decoder, EXAMPLE + BAD_EXAMPLE + COMMON).imu
    np.testing.assert_allclose(row["rate"], (0.00081067998, -0.00212470116, -0.00067193968), rtol=1e-7)
    np.testing.assert_allclose(row["force"], (9.78052139, 0.0643047914, -0.306475103), rtol=1e-7)
    np.testing.assert_allclose(
        row["magnetic"], np.array((-0.288558513, -0.0685227215, 0.241970628)) * 1e-4, rtol=1e-7
    )
    assert (row["temperature"], row["pressure"]) == pytest.approx((28.7699966, 96903.0075), rel=1e-7)
    assert math.isnan(row["time"])
    assert row["end"] == len(EXAMPLE + BAD_EXAMPLE + COMMON)
    assert (decoder.statistics.frames, decoder.statistics.unknown) == (2, 1)
    assert decoder.statistics.failed >= 1
    assert decoder.statistics.skipped == len(BAD_EXAMPLE)


def test_time_is_that_since_start():
    # vnproglib 1.1, getting_started/main.c: TimeStartup 43000006000 ns, and attitude.
    stamp = hexadecimal("70 05 00 03 0A 00 00 00")
    whole = hexadecimal("FA 01 09 00") + stamp + hexadecimal("48 0E 2C 42 08 4C 37 C1 10 38 8B C2 D4 CB")
    assert decoded(decoder := make_decoder("vectornav"), whole).imu.size == 0
    assert decoder.statistics.frames == 1
    (row,) = decoded(make_decoder("vectornav"), message(1, [0x21], stamp + struct.pack("<3f", 1, 2, 3))).imu
    assert row["time"] == pytest.approx(43.000006, abs=1e-12)


@pytest.mark.parametrize("line", LINES)
def test_published_lines_have_their_values(line):
    force, rate, magnetic = LINES[line]
    (row,) = decoded(make_decoder("vectornav"), line).imu
    assert tuple(row["force"]) == force
    assert tuple(row["rate"]) == rate
    np.testing.assert_allclose(row["magnetic"], np.array(magnetic) * 1e-4, rtol=1e-12)
    body = line[1 : line.index(b"*")]
    (same,) = decoded(make_decoder("vectornav"), b"$" + body + b"*%04X\r\n" % crc(body)).imu
    assert (same["force"] == row["force"]).all()


@pytest.mark.parametrize(
    "line",
    [
        b"$VNIMU,-00.1462,+00.1761,+00.2623,-00.0780,+00.0700,-09.8010,+00.007910,-00.003443,-00.009322,+36.3,"
        b"+100.871*FF\r\n",  # a public test of a parser: the right check is 57
        b"$VNRRG,1*XX\r\n",  # taken by the device, not from it
        b"$VNIMU,nan,inf,1_0,1,1,1,1,1,1,1,1*00\r\n",
    ],
)
def test_lines_with_a_wrong_check_are_dropped(line):
    decoder = make_decoder("vectornav")
    assert decoded(decoder, line + next(iter(LINES))).imu.size == 1
    assert (decoder.statistics.frames, decoder.statistics.failed) == (1, 1)


def test_replies_of_the_device_are_frames_without_samples():
    decoder = make_decoder("vectornav")
    replies = b"$VNRRG,01,VN-200T-CR*31\r\n$VNWRG,07,2*6F\r\n$VNRRG,35,1,1,1,1*75\r\n$VNERR,12*72\r\n"
    assert decoded(decoder, replies).imu.size == 0
    assert (decoder.statistics.frames, decoder.statistics.unknown) == (4, 4)


def test_a_captured_voyage_has_the_values_of_another_parser():
    rows = list(csv.reader(capture(CSV).decode().splitlines()))[1:]
    expected = np.array([[float(cell) for cell in row[:29]] for row in rows])
    decoder = make_decoder("vectornav")
    imu = decoded(decoder, capture("vn100_bin_waves_F00294.bin")).imu
    assert len(imu) == 99
    assert decoder.statistics.failed == 0
    # The other parser lost the frame before which the sync byte stands twice.
    assert imu["end"][78] == 11754 + 124
    imu = np.delete(imu, 78)
    seven_digits = {"rtol": 5.1e-7, "atol": 0}
    np.testing.assert_allclose(imu["magnetic"] * 1e4, expected[:, :3], **seven_digits)
    np.testing.assert_allclose(imu["force"], expected[:, 3:6], **seven_digits)
    np.testing.assert_allclose(imu["rate"], expected[:, 6:9], **seven_digits)
    np.testing.assert_allclose(imu["temperature"], expected[:, 9], **seven_digits)
    np.testing.assert_allclose(imu["pressure"] * 1e-3, expected[:, 10], **seven_digits)


FIELDS = {  # size of each field of the manual's tables, by group and bit
    0: (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    1: (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    2: (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    4: (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24),
    5: (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
}


def test_any_mix_of_fields_is_walked_to_the_ones_that_are_read():
    rng = np.random.default_rng(3)
    for _ in range(300):
        chosen = {
            group: int(rng.integers(1 << len(sizes))) for group, sizes in FIELDS.items() if rng.random() < 0.6
        }
        chosen[2] = (
            chosen.get(2, 0) & ~0b1010_0000_1100 | 0b0110_0000_0000
        )  # compensated only, and both of them
        chosen[2] &= 0x1FFF
        chosen[0] = chosen.get(0, 0) & ~0x0320
        payload = b""
        for group in sorted(chosen):
            if not chosen[group]:
                continue
            for bit, size in enumerate(FIELDS[group]):
                if chosen[group] >> bit & 1:
                    special = {(2, 9): (1.5, -2.5, -9.75), (2, 10): (0.25, 0.5, -0.125)}.get((group, bit))
                    payload += struct.pack("<3f", *special) if special else rng.bytes(size)
        used = {group: fields for group, fields in sorted(chosen.items()) if fields}
        data = message(sum(1 << group for group in used), list(used.values()), payload)
        (row,) = decoded(make_decoder("vectornav"), data).imu
        assert tuple(row["force"]) == (1.5, -2.5, -9.75)
        assert tuple(row["rate"]) == (0.25, 0.5, -0.125)


def test_satellites_make_a_message_of_variable_length():
    satellites = bytes((3, 0)) + bytes(3 * 8)
    place = struct.pack("<3d", -45.5, 170.25, 30.0)
    payload = (
        struct.pack("<6f", 1, 2, 3, 4, 5, 6) + struct.pack("<QB", 300_000_250_000_000, 3) + place + satellites
    )
    fields = 1 << 1 | 1 << 4 | 1 << 5 | 1 << 14
    found = decoded(make_decoder("vectornav"), message(1 | 8, [1 << 9, fields], payload))
    assert tuple(found.imu["rate"][0]) == (4, 5, 6)
    (fix,) = found.fix
    assert np.degrees((fix["latitude"], fix["longitude"])) == pytest.approx((-45.5, 170.25), abs=1e-12)
    assert (fix["height"], fix["week_time"], fix["fix_type"]) == (30.0, 300_000.25, 3)


def test_a_fix_that_is_repeated_with_each_sample_counts_once():
    def sample(second: int) -> bytes:
        gps = struct.pack("<Q3d", second * 10**9, 48.0, 11.0, 500.0)
        return message(1 | 8, [1 << 9, 1 << 1 | 1 << 5], struct.pack("<6f", 1, 2, 3, 4, 5, 6) + gps)

    found = decoded(make_decoder("vectornav"), b"".join(sample(second) for second in (5, 5, 5, 6, 6)))
    assert len(found.imu) == 5
    assert found.fix["week_time"].tolist() == [5.0, 6.0]


def test_increments_are_divided_by_their_interval():
    payload = struct.pack("<7f", 0.0125, 0.25, -0.5, 1.0, 0.125, -0.25, 0.5)
    (row,) = decoded(make_decoder("vectornav"), message(1, [1 << 11], payload)).imu
    np.testing.assert_allclose(row["rate"], np.radians((20, -40, 80)), rtol=1e-7)
    np.testing.assert_allclose(row["force"], (10, -20, 40), rtol=1e-7)
    payload = struct.pack("<4f", 0.0, 1, 1, 1) + struct.pack("<3f", 1, 1, 1)
    assert np.isnan(
        decoded(make_decoder("vectornav"), message(4, [1 << 6 | 1 << 7], payload)).imu["rate"]
    ).all()


def test_axes_out_of_range_are_marked():
    payload = struct.pack("<6fH", 1, 2, 3, 4, 5, 6, 1 << 3 | 1 << 8)  # accelerometer x, gyro z
    (row,) = decoded(make_decoder("vectornav"), message(4, [1 << 2 | 1 << 3 | 1 << 11], payload)).imu
    assert row["clipped"] == CLIPPED_FORCE | CLIPPED_RATE << 2


@pytest.mark.parametrize(
    ("form", "rate", "force"), [("binary", 1e-7, 1e-6), ("VNIMU", 6e-7, 6e-4), ("VNYMR", 6e-7, 6e-4)]
)
def test_what_is_encoded_is_read_again(form, rate, force):
    imu, fix = motion(300), fixes(3)
    decoder = make_decoder("vectornav")
    sent = VectorNavEncoder().encode(imu, fix) if form == "binary" else lines(form, imu, fix)
    found = decoded(decoder, sent)
    assert decoder.statistics.skipped == decoder.statistics.failed == decoder.statistics.unknown == 0
    np.testing.assert_allclose(found.imu["rate"], imu["rate"], rtol=0, atol=rate)
    np.testing.assert_allclose(found.imu["force"], imu["force"], rtol=0, atol=force)
    for name in (
        "latitude",
        "longitude",
        "height",
        "velocity_n",
        "horizontal_sigma",
        "speed_sigma",
        "week_time",
    ):
        np.testing.assert_allclose(found.fix[name], fix[name], rtol=0, atol=1e-6)
    assert (found.fix["satellites"] == 12).all()
    if form == "binary":
        np.testing.assert_allclose(found.imu["time"], imu["time"], atol=1e-9)
    assert (np.diff(join_samples([found]).imu["end"]) > 0).all()
