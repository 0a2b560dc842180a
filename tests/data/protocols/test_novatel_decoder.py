"""NovAtel: messages of manuals and of receivers have the values that they state, in ASCII and in binary."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from live_streams import decoded, fixes, motion

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.novatel import NovAtelEncoder

WEEK = 604_800.0
# From NovAtel's own tests of its decoder (novatel_edie), gpsd's and others' logs: each with a sound CRC.
PLACE = (
    "#BESTPOSA,USB1,0,58.5,FINESTEERING,2209,502061.000,02000020,cdba,16809;SOL_COMPUTED,PPP,51.15043706870,"
    '-114.03067882331,1097.3462,-17.0001,WGS84,0.0154,0.0139,0.0288,"TSTR",11.000,0.000,43,39,39,38,00,00,7f,37'
    "*52483ac5"
)
VELOCITY = (
    "#BESTVELA,COM1,0,60.0,FINESTEERING,2437,558924.650,00000000,0000,1114;SOL_COMPUTED,DOPPLER_VELOCITY,0.000,"
    "0.000,0.0019,289.119359,0.0016,0.0*896c6970"
)
VELOCITY_IN_BINARY = (
    "aa44121c630002202c000000b8b485096a835021000010000000204e000000000800000000000000000000009af6b592f7515e3f"
    "5b5dcce4e8117240eeead780c473593f01008028898d4b4a"
)
SAMPLE = (
    "%RAWIMUSXA,1692,484620.664;00,11,1692,484620.664389000,00801503,43110635,-817242,-202184,-215194,-41188,"
    "-9895*a5db8c7b"
)
UNTYPED = "%RAWIMUSA,1815,407772.000;1815,407771.985103333,00000077,63811,-6290,6253,7,-31,14*2d2a4cff"
SOLUTION = (
    "%INSPVASA,2083,374524.200;2083,374524.200000000,31.51668826020,120.38636567293,13.9998,13.1095,-12.9404,"
    "-0.0070,2.093819658,2.854168081,316.626703726,INS_SOLUTION_GOOD*8fc5adb1"
)


def crc(data: bytes) -> int:
    """Return the check bit by bit, as the manual defines it."""
    found = 0
    for byte in data:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ (0xEDB88320 if found & 1 else 0)
    return found


def line(text: str) -> bytes:
    """Return a line with its check."""
    body = text.encode()
    return body + f"*{crc(body[1:]):08x}\r\n".encode()


def read(*lines: str):
    return decoded(make_decoder("novatel"), b"".join(f"{one}\r\n".encode() for one in lines))


def test_checks_of_published_messages_pass_and_values_are_theirs():
    for text in (PLACE, VELOCITY, SAMPLE, UNTYPED, SOLUTION):
        assert line(text[:-9]).decode().strip() == text
    (fix,) = read(PLACE).fix
    assert np.degrees([fix["latitude"], fix["longitude"]]) == pytest.approx(
        [51.15043706870, -114.03067882331]
    )
    assert fix["height"] == pytest.approx(1097.3462 - 17.0001)  # above the ellipsoid
    assert (fix["week_time"], fix["time"]) == (502_061.0, 2209 * WEEK + 502_061.0)
    assert fix["horizontal_sigma"] == pytest.approx(np.hypot(0.0154, 0.0139) / np.sqrt(2))
    assert (fix["vertical_sigma"], fix["satellites"], fix["fix_type"]) == (0.0288, 39, 4)
    (fix,) = read(SOLUTION).fix
    assert fix["velocity_n"].tolist() == [13.1095, -12.9404, 0.0070]
    assert (np.degrees(fix["latitude"]), fix["height"]) == pytest.approx((31.51668826020, 13.9998))


def test_a_position_and_the_velocity_of_its_time_are_one_fix_in_both_forms():
    course, speed = np.radians(289.119359), 0.0019
    place = PLACE[:-9].replace("2209,502061.000", "2437,558924.650")
    for velocity in (f"{VELOCITY}\r\n".encode(), bytes.fromhex(VELOCITY_IN_BINARY)):
        for data in (line(place) + velocity, velocity + line(place)):
            (fix,) = decoded(make_decoder("novatel"), velocity + data).fix
            assert fix["velocity_n"] == pytest.approx(
                [speed * np.cos(course), speed * np.sin(course), -0.0016], abs=5e-5
            )
    (fix,) = decoded(make_decoder("novatel"), f"{VELOCITY}\r\n".encode() + f"{PLACE}\r\n".encode()).fix
    assert np.isnan(fix["velocity_n"]).all()  # of another time
    solution = f"{SOLUTION}\r\n".encode()
    assert (
        len(decoded(make_decoder("novatel"), line(place) + 3 * solution).fix) == 1
    )  # the receiver's, not the device's


def test_an_imu_is_known_by_its_type_or_by_its_gravity():
    """HG1700-AG58 counts 2^-27 ft/s and 2^-33 rad; a KVH and an iMAR-FSAS both count 0.05/2^15 m/s."""
    second = SAMPLE[:-9].replace("484620.664389", "484620.674389")
    data = f"{SAMPLE}\r\n".encode() + line(second)
    (row,) = decoded(make_decoder("novatel"), data).imu
    assert row["time"] == 1692 * WEEK + 484_620.674389
    foot = 0.3048
    assert row["force"] == pytest.approx(np.array([-202_184, 817_242, 43_110_635]) * foot / 2**27 / 0.01)
    assert row["rate"] == pytest.approx(np.array([-9895, 41_188, -215_194]) / 2**33 / 0.01)
    assert 9.7 < np.linalg.norm(row["force"]) < 9.9
    epson = [
        one.replace(";00,11,", ";00,41,").replace("43110635", "327680000") for one in (SAMPLE[:-9], second)
    ]
    (row,) = decoded(make_decoder("novatel"), b"".join(map(line, epson))).imu
    assert row["force"][2] == pytest.approx(9.80665)  # 0.2 mg / 2^16 a count, of the force itself
    assert np.degrees(row["rate"][2]) == pytest.approx(-215_194 * 0.008 / 2**16)
    alone = [
        f"%RAWIMUSA,1692,{t:.3f};1692,{t:.9f},00801503,{z},-8172,-2021,-215,-41,-98"
        for t, z in ((100 + 0.01 * k, 43_110_635) for k in range(12))
    ]
    imu = decoded(make_decoder("novatel"), b"".join(map(line, alone))).imu
    assert len(imu) == 4  # eight intervals show 1 g, the last of which is a sample
    assert imu["force"][:, 2] == pytest.approx(43_110_635 * foot / 2**27 / 0.01)
    two = [one.replace("43110635", "63811") for one in alone]  # gyros of two IMUs would fit: none is taken
    assert len(decoded(make_decoder("novatel"), b"".join(map(line, two))).imu) == 0


def test_a_lost_message_does_not_halve_the_rates():
    data = NovAtelEncoder().encode(motion(20), fixes(0))
    size = len(data) // 20
    whole = decoded(make_decoder("novatel"), data).imu
    gap = decoded(make_decoder("novatel"), data[: 8 * size] + data[9 * size :]).imu
    np.testing.assert_allclose(gap["force"], np.delete(whole["force"], 7, axis=0), atol=1e-9)
    np.testing.assert_allclose(whole["rate"], motion(20)["rate"][1:], atol=1e-6)


def test_hostile_numbers_in_messages_with_a_sound_check_raise_nothing():
    rng = np.random.default_rng(5)
    words = ["1e999", "-1e308", "nan", "", "SOL_COMPUTED", "x" * 40, "9" * 60, "-1", "65535"]
    decoder = make_decoder("novatel")
    for text in (PLACE, VELOCITY, SAMPLE, UNTYPED, SOLUTION):
        head, _, body = text[:-9].partition(";")
        for _ in range(200):
            cells = body.split(",")
            for _ in range(int(rng.integers(1, 4))):
                cells[int(rng.integers(len(cells)))] = words[int(rng.integers(len(words)))]
            decoder.feed(line(f"{head};{','.join(cells)}"))
    for number, size in ((42, 72), (99, 44), (507, 88), (268, 40), (1461, 44)):
        for _ in range(100):
            body = struct.pack(
                "<3sBHBBHHBBHIIHH", b"\xaaD\x12", 28, number, 0, 0, size, 0, 0, 0, 9, 9, 0, 0, 0
            )
            body += rng.bytes(size)
            decoder.feed(body + crc(body).to_bytes(4, "little"))
    assert decoder.statistics.frames > 1200
    decoder.finish()
