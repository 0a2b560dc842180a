"""The decoder of phones: signs, units and times against motion that was computed independently."""

from __future__ import annotations

import json
import math
import zlib

import numpy as np
import pytest
from live_streams import decoded, fixes, motion
from scipy.spatial.transform import Rotation

from lab.data.protocols.pairing import Pairing
from lab.data.protocols.phone import PhoneDecoder, PhoneEncoder
from lab.data.protocols.phone_line import RADIANS, PhoneLine, parse_line

G = 9.81


def up_of(alpha: float, beta: float, gamma: float) -> np.ndarray:
    """Return the direction up in device axes, by the rotation Z-X'-Y'' of the specification [°]."""
    device_to_earth = Rotation.from_euler("ZXY", [alpha, beta, gamma], degrees=True)
    return device_to_earth.inv().apply([0, 0, 1])


def lines(angles: np.ndarray, sign: float = 1.0, unit: float = 1.0, up: bool = True, **others) -> bytes:
    """Return batches of a phone with these attitudes (n, 3) [°] at 60 Hz; accelerations only by gravity."""
    attitude = Rotation.from_euler("ZXY", angles, degrees=True)
    rate = np.degrees((attitude[:-1].inv() * attitude[1:]).as_rotvec()) * 60 * unit
    force = sign * G * attitude.inv().apply([0, 0, 1])
    data = b""
    for number, at in enumerate(range(1, len(angles) - 5, 6)):
        rows = [
            [one / 60, *rate[one - 1].tolist(), *force[one].tolist()] for one in range(at, at + 6)
        ]  # the rate up to each sample
        direction = up_of(*angles[at + 5]).tolist() if up else None
        data += PhoneLine(number, first=at - 1, up=direction, imu=rows, **others).written()
    return data


HELD = np.array([[20.0, 65.0, -10.0]] * 62)
"""A phone that is held still in front of a face."""


def rate_factor(decoder: PhoneDecoder) -> float:
    """Return the turns of a phone's attitude by those of its angular rates; NaN before it turned."""
    return decoder._lines._turning.factor


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("apple", [False, True])
def test_the_sign_is_found_by_the_attitude_whatever_the_maker(sign, apple):
    decoder = PhoneDecoder()
    found = decoded(decoder, lines(HELD, sign, apple=apple)).imu
    assert len(found) == 60
    np.testing.assert_allclose(found["force"], [G * up_of(*HELD[0])] * 60)
    assert f"{sign * G:+.1f} m/s²" in decoder.evidence
    assert ("negates it" in decoder.evidence) == (sign < 0)


@pytest.mark.parametrize("apple", [False, True])
def test_without_an_attitude_the_maker_decides(apple):
    decoder = PhoneDecoder()
    found = decoded(decoder, lines(HELD, -1.0 if apple else 1.0, up=False, apple=apple)).imu
    np.testing.assert_allclose(found["force"], [G * up_of(*HELD[0])] * 60)
    assert "did not send its attitude" in decoder.evidence


def test_a_sign_that_was_found_does_not_change_in_mid_stream():
    decoder = PhoneDecoder()
    decoder.feed(lines(HELD))
    thrown = decoder.feed(lines(HELD, -0.9)).imu  # the phone is jerked down
    assert thrown["force"][0] @ up_of(*HELD[0]) == pytest.approx(-0.9 * G)


@pytest.mark.parametrize(("unit", "factor"), [(1.0, 1.0), (math.pi / 180, 180 / math.pi), (-1.0, -1.0)])
def test_the_unit_of_angular_rates_is_checked_by_the_attitude(unit, factor):
    turns = np.linspace(0, 3, 302)[:, None]
    angles = np.array([30.0, 40.0, 10.0]) + np.array([80.0, 50.0, 30.0]) * np.sin(turns + np.arange(3))
    decoder = PhoneDecoder()
    decoder.feed(lines(angles, unit=unit))
    assert rate_factor(decoder) == pytest.approx(factor, rel=0.02)
    assert ("check their unit" in decoder.evidence) == (factor != 1)


def test_a_phone_at_rest_says_nothing_of_the_unit():
    decoder = PhoneDecoder()
    decoder.feed(lines(HELD))
    assert math.isnan(rate_factor(decoder))
    assert "angular" not in decoder.evidence


def test_what_is_written_is_read():
    imu, fix = motion(50), fixes(3)
    decoder = PhoneDecoder()
    found = decoded(decoder, PhoneEncoder().encode(imu, fix))
    for name in ("time", "rate", "force"):
        np.testing.assert_array_equal(found.imu[name], imu[name])
    assert found.imu["count"].tolist() == list(range(50))
    for name in ("time", "utc", "height", "velocity_n", "horizontal_sigma", "vertical_sigma", "speed_sigma"):
        np.testing.assert_array_equal(found.fix[name], fix[name])
    np.testing.assert_allclose(found.fix["latitude"], fix["latitude"], rtol=1e-15)
    assert found.fix["fix_type"].tolist() == [3, 3, 3]


def checked(body: str) -> bytes:
    """Return a line with a checksum that was computed independently."""
    return b'{"phone":1,"check":"%08x' % zlib.crc32(body.encode()) + body.encode() + b"\n"


GOOD = '","number":0,"origin":0.0,"first":0,"source":"x","unit":"rad/s","imu":[[1,0,0,0,0,0,9.8]]}'


def test_a_line_by_hand():
    decoder = PhoneDecoder()
    found = decoder.feed(checked(GOOD)).imu
    assert found["force"].tolist() == [[0, 0, 9.8]]
    assert found["end"].tolist() == [len(checked(GOOD))]
    assert json.loads(checked(GOOD))["imu"][0][6] == 9.8


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("9.8", "NaN"),
        ("9.8", "1e400"),
        ("9.8", "9" * 5000),
        ("9.8", '"9.8"'),
        ("9.8", "true"),
        ("[[1,", "[[null,"),
        ("[[1,", "[[1,2,"),
        ("[[1,0,0,0,0,0,9.8]]", "7"),
        ("[[1,0,0,0,0,0,9.8]]", "[" * 30_000),
        ("[[1,0,0,0,0,0,9.8]]", "[" + "[1,0,0,0,0,0,9]," * 200 + "[1,0,0,0,0,0,9]]"),
        ("0.0", "null"),
        ("rad/s", "rpm"),
        ('"x"', "[]"),
        ("}", ""),
    ],
)
def test_a_sound_checksum_around_nonsense_gives_nothing(old, new):
    assert old in GOOD
    decoder = PhoneDecoder()
    assert len(decoder.feed(checked(GOOD.replace(old, new)) + checked(GOOD)).imu) == 1
    assert decoder.statistics.unknown == 1
    assert decoder.statistics.frames == 2


def test_a_damaged_byte_is_noticed_wherever_it_is():
    line = checked(GOOD)
    for at in range(len(line)):
        damaged = line[:at] + bytes((line[at] ^ 1,)) + line[at + 1 :]
        assert len(decoded(PhoneDecoder(), damaged + line).imu) == 1


def test_a_line_without_a_direction_of_length_one_has_none():
    for up in ("[0,0,0]", "[0,0,2]", "[0,1]", "7", "[null,0,1]"):
        line = parse_line(checked(GOOD.replace('"unit"', f'"up":{up},"unit"')).rstrip())
        assert line is not None
        assert line.up is None


def test_sensors_that_come_by_themselves_are_paired():
    times = np.arange(300) / 200
    line = PhoneLine(
        0,
        unit=RADIANS,
        rate=[[time + 0.0013, math.sin(time), 0.0, 1.0] for time in times[:150].tolist()],
        force=[[time, 2 * time, 0.0, G] for time in times[:150].tolist()],
    )
    later = PhoneLine(1, unit=RADIANS, force=[[1.0, 2.0, 0.0, G], [1.005, 2.01, 0.0, G]])
    decoder = PhoneDecoder()
    data = line.written() + later.written()
    imu = decoder.feed(data[:-10]).imu
    assert len(imu) == 149  # the last rate waits for a later force
    np.testing.assert_allclose(imu["force"][:, 0], 2 * imu["time"], atol=1e-9)
    assert len(decoder.feed(data[-10:]).imu) == 1
    assert len(decoder.finish().imu) == 0


def test_pairing_does_not_bridge_gaps_and_does_not_wait_for_ever():
    pairing = Pairing()
    for time in (0.0, 1.0):
        pairing.add_force(time, (0, 0, time))
    pairing.add_rate(0.5, (1, 0, 0))
    pairing.add_rate(1.0, (2, 0, 0))
    found = list(pairing.samples())
    assert [time for time, _, _ in found] == [0.5, 1.0]
    assert all(math.isnan(one) for one in found[0][2])
    assert tuple(found[1][2]) == (0, 0, 1.0)
    for number in range(2000):
        pairing.add_rate(2 + 0.01 * number, (0, 0, 0))
        list(pairing.samples())
    assert pairing.held <= 512
    assert len(list(pairing.samples(last=True))) <= 512
