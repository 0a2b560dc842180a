"""Xsens: captured messages have the values that MT Manager and another library read in them."""

from __future__ import annotations

import re
import struct
from datetime import datetime

import numpy as np
import pytest
from live_streams import capture, decoded, fixes, hexadecimal, motion

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.samples import CLIPPED_FORCE, CLIPPED_RATE
from lab.data.protocols.xsens import NOMINAL_FIELD, XsensEncoder

FULL = hexadecimal(
    "FA FF 36 92 10 20 02 91 8D 10 60 04 01 36 3F A6 20 10 10 3F 35 E0 42 3F 31 CD 15 BD 9F 49 DB BD "
    "A9 38 CF 40 20 0C BD 63 5A 90 41 1D 08 D4 3E 5F AA 50 40 10 0C B9 11 68 00 3C C9 01 00 3A 0F 7D "
    "00 40 30 0C BC 3B 29 80 3C 35 FC 00 3C A4 6E 00 80 20 0C 3C AE A2 41 BB 56 D8 00 BA D5 AC 01 80 "
    "30 10 3F 80 00 00 37 DF 88 01 B6 89 80 00 B6 08 C0 00 C0 20 0C BE FB FB F2 3F 33 C4 85 BF A0 A2 "
    "C1 08 10 04 42 16 80 00 30 10 04 00 01 86 E1 E0 20 04 00 40 00 03 DD "
)
"""MTi-300, Scottapotamas/xsens-mti, docs/mtmanager_packets.md; values of MT Manager in the test."""
SHAKEN = hexadecimal(
    "FA FF 36 8B 10 20 02 FB 85 10 60 04 01 A4 98 DE 20 10 10 3F 2A 14 63 BE D7 EF A7 3C DE E5 08 3F "
    "1D CE C9 40 20 0C C1 F2 46 C3 C1 EC E0 76 C2 8F 85 3F 40 10 0C BD 93 2C CC BD 92 0A 16 BE 3A 6E "
    "EC 40 30 0C 42 51 94 64 C2 7B 5A 5A C1 CC C0 AE 80 20 0C 40 85 4D 6D C1 25 55 9E C0 90 8E 1F 80 "
    "30 10 3F 7F F8 98 3B AA 9E E5 BC 53 9E C0 BB B9 06 0C C0 20 0C 3E DC 74 39 BE 75 2B 48 3F AF 9A "
    "3F 30 10 04 00 01 86 DE E0 20 04 00 48 14 01 8E "
)
"""The same device shaken: gyro y and accelerometer z out of range."""
FORMATS = hexadecimal(
    "FA FF 36 51 10 20 02 3B DD 20 31 0C FF F0 47 35 FF FD C8 86 07 3B 35 C8 80 32 18 00 00 00 01 00 "
    "01 FF E3 E0 C4 FF FF FF EC 25 95 FF FF FF F4 64 E8 FF FF C0 23 18 3F EA AE 0F C0 00 00 00 BF DB "
    "C9 A7 60 00 00 00 3F F9 E2 06 20 00 00 00 08 10 04 41 DB 80 00 AC "
)
"""Numbers in 12.20, 16.32, double and single: the same repository, test/test_xsens_mti_parse_messages.c."""


def framed(payload: bytes) -> bytes:
    """Return a message of items, with its sum."""
    body = b"\xff\x36" + bytes((len(payload),)) + payload
    return b"\xfa" + body + bytes((-sum(body) & 0xFF,))


def item(kind: int, data: bytes) -> bytes:
    """Return an item."""
    return struct.pack(">HB", kind, len(data)) + data


def test_a_full_message_has_the_values_of_mt_manager():
    (row,) = decoded(make_decoder("xsens"), FULL).imu
    assert (row["count"], row["time"]) == (37261, pytest.approx(2033.2454, abs=1e-9))
    np.testing.assert_allclose(row["force"], (-0.05550629, 9.81465530, 0.21842313), atol=5e-9)
    np.testing.assert_allclose(row["rate"], (0.02131760, -0.00327826, -0.00163019), atol=5e-9)
    np.testing.assert_allclose(
        row["magnetic"] / NOMINAL_FIELD, (-0.49215657, 0.70221740, -1.25496686), atol=5e-9
    )
    assert (row["temperature"], row["pressure"], row["clipped"]) == (37.625, 100065, 0)


def test_axes_out_of_range_are_marked():
    (row,) = decoded(make_decoder("xsens"), SHAKEN).imu
    assert row["clipped"] == CLIPPED_FORCE << 2 | CLIPPED_RATE << 1
    np.testing.assert_allclose(row["force"], (-30.28455162, -29.60960007, -71.76024628), atol=5e-9)
    np.testing.assert_allclose(row["rate"], (4.16570139, -10.33340263, -4.51734877), atol=5e-9)


def test_fixed_point_and_double_numbers_are_read():
    # einride/xsens-go, fixedpoint_test.go.
    fixed = {
        1: ("00 00 00 00 03 9a df 03 00 be 1f 81", (0.0, 57.67944622039795, 11.882691383361816)),
        2: (
            "ad f0 52 98 00 39 e1 f5 89 e9 00 0b f6 3f ca f0 ff ff",
            (57.67944828234613, 11.882652873406187, -0.038089100271463394),
        ),
    }
    for precision, (data, values) in fixed.items():
        (row,) = decoded(make_decoder("xsens"), framed(item(0x4020 | precision, hexadecimal(data)))).imu
        assert tuple(row["force"]) == values
    # The captured message has no rate or force: its numbers are read under the names of those.
    payload = FORMATS[4:-1].replace(b"\xc0\x23", b"\x80\x23").replace(b"\x20\x31", b"\x40\x21")
    assert decoded(make_decoder("xsens"), FORMATS).imu.size == 0
    (row,) = decoded(make_decoder("xsens"), framed(payload)).imu
    np.testing.assert_allclose(
        row["rate"], (0.833747744560242, -0.434182971715927, 1.617681622505188), rtol=1e-15
    )
    np.testing.assert_allclose(row["force"], (-0.9826155, -0.1385441, 115.7006302), atol=5e-8)
    assert (row["temperature"], row["count"]) == (27.4375, 15325)


def test_increments_are_divided_by_the_interval():
    angles = "01 00 01 FF E3 E0 C4 FF FF FF EC 25 95 FF FF FF F4 64 E8 FF FF"
    turned = hexadecimal("00 00 00" + angles)
    first, second = (
        framed(
            item(0x1060, struct.pack(">I", time))
            + item(0x8032, turned)
            + item(0x4010, struct.pack(">3f", 1, 2, -3))
        )
        for time in (1000, 1100)
    )
    (row,) = decoded(make_decoder("xsens"), first + second).imu
    # For small angles the rotation vector is twice the vector of the quaternion: 1e-7 of it off here.
    vector = np.array((-0.000429107808, -0.000302935718, -0.000177090988))
    np.testing.assert_allclose(row["rate"], 2 * vector / 0.01, rtol=2e-7)
    np.testing.assert_allclose(row["force"], (100, 200, -300), rtol=1e-12)


def test_the_slower_form_of_a_sensor_goes_before_the_faster_one():
    def sample(rate: int, force: int, value: float) -> bytes:
        return framed(
            item(rate, struct.pack(">3f", *[value] * 3)) + item(force, struct.pack(">3f", *[value] * 3))
        )

    fast, slow = sample(0x8040, 0x4040, 1.0), sample(0x8020, 0x4020, 2.0)
    assert decoded(make_decoder("xsens"), fast * 3).imu["rate"][:, 0].tolist() == [1, 1, 1]
    assert decoded(make_decoder("xsens"), fast + slow + fast * 9 + slow).imu["force"][:, 0].tolist() == [
        1,
        2,
        2,
    ]


def golden(text: str) -> list[dict[str, list[float]]]:
    """Return the frames of the library's printed form: the numbers under each heading."""
    frames = []
    for block in text.strip().split("\n\n"):
        frame: dict[str, list[float]] = {}
        for line in block.splitlines():
            if not line.startswith(" "):
                name = re.match(r"\w+", line)[0]
                frame[name] = []
            else:
                value = line.strip().rpartition(":")[2] if name != "UTCTime" else line.strip()
                frame[name].append(
                    float(value) if name != "UTCTime" else datetime.fromisoformat(value).timestamp()
                )
        frames.append(frame)
    return frames


def test_all_captured_messages_have_the_values_of_another_library():
    frames = golden(capture("xsens_mti_einride_1.expected.txt").decode())
    decoder = make_decoder("xsens")
    found = decoded(decoder, capture("xsens_mti_einride_1.bin"))
    sensed = [frame for frame in frames if "Acceleration" in frame]
    located = [frame for frame in frames if "GNSSPVTData" in frame]
    assert (len(frames), len(found.imu), len(found.fix)) == (100, len(sensed), len(located)) == (100, 96, 4)
    assert decoder.statistics.skipped == decoder.statistics.failed == 0
    for row, frame in zip(found.imu, sensed, strict=True):
        assert row["force"].tolist() == frame["Acceleration"]
        assert row["rate"].tolist() == frame["RateOfTurn"]
        between = sum(other["PacketCounter"] < frame["PacketCounter"] for other in located)
        assert [row["count"] + between] == frame["PacketCounter"]
        assert row["time"] == pytest.approx(frame["SampleTimeFine"][0] * 1e-4, abs=1e-9)
    _same_fixes(found.fix, located)


def _same_fixes(rows: np.ndarray, frames: list[dict[str, list[float]]]) -> None:
    for row, frame in zip(rows, frames, strict=True):
        said = frame["GNSSPVTData"]
        assert row["week_time"] == pytest.approx(said[0] * 1e-3)
        assert np.degrees([row["longitude"], row["latitude"]]) * 1e7 == pytest.approx(said[14:16], abs=1e-6)
        assert row["height"] == pytest.approx(said[16] * 1e-3)
        assert row["velocity_n"] == pytest.approx([speed * 1e-3 for speed in said[20:23]])
        assert row["horizontal_sigma"] == pytest.approx(said[18] * 1e-3)
        assert row["vertical_sigma"] == pytest.approx(said[19] * 1e-3)
        assert row["speed_sigma"] == pytest.approx(said[25] * 1e-3)
        assert (row["satellites"], row["fix_type"]) == (said[12], 3)
        # Its printed time of day is rounded to 0.1 ms.
        assert row["utc"] == pytest.approx(frame["UTCTime"][0], abs=3e-4)


def test_fixed_point_capture_is_the_same_device_still():
    found = decoded(make_decoder("xsens"), capture("xsens_mti_einride_2.bin"))
    assert (len(found.imu), len(found.fix)) == (96, 4)
    # testdata/2/output.golden, first frame and first fix.
    row, fix = found.imu[0], found.fix[0]
    assert row["force"].tolist() == [0.03061389923095703, -7.268850326538086, -1.2509326934814453]
    assert row["rate"].tolist() == [-0.0011949539184570312, 0.000896453857421875, -8.58306884765625e-05]
    assert (fix["week_time"], fix["satellites"]) == (49663.25, 12)
    assert fix["velocity_n"] == pytest.approx([-0.014, 0.017, 0.005])


def test_messages_without_rate_and_force_make_no_samples():
    frames = golden(capture("xsens_mti_einride_5.expected.txt").decode())
    decoder = make_decoder("xsens")
    found = decoded(decoder, capture("xsens_mti_einride_5.bin"))
    located = [frame for frame in frames if "GNSSPVTData" in frame]
    assert (len(found.imu), len(found.fix), decoder.statistics.unknown) == (0, len(located), 97)
    _same_fixes(found.fix, located)


def test_a_sum_that_fits_by_chance_is_not_enough():
    assert decoded(make_decoder("xsens"), framed(item(0x4020, bytes(12)))).imu.size == 1
    decoder = make_decoder("xsens")
    assert decoded(decoder, framed(item(0x4020, bytes(12)) + b"\x80\x20\x0c\x00")).imu.size == 0
    assert decoder.statistics.failed == 1


def _fixed(values):
    """Return numbers of 16.32 bits: the 32 bits after the point, and then those before it."""
    counts = [round(float(value) * 2**32) for value in values]
    return b"".join(struct.pack(">Ih", count & 0xFFFFFFFF, count >> 32) for count in counts)


PRECISIONS = {
    "fp12.20": (
        1,
        lambda values: struct.pack(">3i", *(round(float(value) * 2**20) for value in values)),
        5e-7,
    ),
    "fp16.32": (2, _fixed, 2e-10),
    "double": (3, lambda values: struct.pack(">3d", *values), 0),
}
"""Bits of an identifier, the bytes of three numbers, and by how much these are rounded."""


@pytest.mark.parametrize("precision", PRECISIONS)
def test_numbers_of_each_precision_are_read(precision):
    bits, written, rounding = PRECISIONS[precision]
    imu = motion(300)
    data = b"".join(
        framed(item(0x4020 | bits, written(row["force"])) + item(0x8020 | bits, written(row["rate"])))
        for row in imu
    )
    found = decoded(make_decoder("xsens"), data).imu
    for name in ("rate", "force"):
        np.testing.assert_allclose(found[name], imu[name], rtol=0, atol=rounding)


def test_what_is_encoded_is_read_again():
    imu, fix = motion(300), fixes(3)
    decoder = make_decoder("xsens")
    found = decoded(decoder, XsensEncoder().encode(imu, fix))
    assert decoder.statistics.skipped == decoder.statistics.failed == 0
    for name in ("rate", "force"):
        np.testing.assert_allclose(found.imu[name], imu[name], rtol=0, atol=5e-7)
    np.testing.assert_allclose(found.imu["time"], imu["time"], atol=5.1e-5)
    for name in ("latitude", "longitude", "height", "velocity_n", "horizontal_sigma", "week_time", "utc"):
        np.testing.assert_allclose(
            found.fix[name], fix[name], rtol=0, atol=5.1e-4 if name != "latitude" else 1e-9
        )
