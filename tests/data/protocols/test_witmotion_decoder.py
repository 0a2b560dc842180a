"""WitMotion: messages have the values that the maker's formulas give."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from live_streams import decoded

from lab.data.protocols.catalogue import make_decoder

G = 9.80665
# The maker's formulas: 16 g and 2000 °/s over 32768, hundredths of a degree Celsius.
FORCE = bytes.fromhex("5551000000000008280ae0")  # 0x0800 along z: 1 g; 26 °C
RATE = bytes.fromhex("55520040000000c00000a7")  # 0x4000 and -0x4000: 1000 and -1000 °/s
PRESSURE = bytes.fromhex(
    "5556cd8b010000000000" + f"{(0x55 + 0x56 + 0xCD + 0x8B + 1) & 255:02x}"
)  # 101 325 Pa


def test_an_acceleration_and_the_rate_after_it_are_one_sample():
    time = bytes((0x55, 0x50, 24, 5, 17, 23, 58, 30, 0x2C, 0x01))  # 300 ms
    data = time + bytes((sum(time) & 255,)) + FORCE + RATE + PRESSURE + FORCE + RATE
    imu = decoded(make_decoder("witmotion"), data).imu
    assert len(imu) == 2
    assert imu["force"].tolist() == [pytest.approx([0.0, 0.0, G])] * 2
    assert np.degrees(imu["rate"]).tolist() == [pytest.approx([1000.0, 0.0, -1000.0])] * 2
    assert imu["time"][0] == pytest.approx(1_715_990_310.3)  # 2024-05-17 23:58:30.3 UTC
    assert np.isnan(imu["time"][1])
    assert (imu["temperature"][0], imu["pressure"][1]) == (26.0, 101_325.0)


def test_one_triad_alone_is_a_sample_unless_the_other_was_damaged():
    for alone, missing in ((FORCE, "rate"), (RATE, "force")):
        imu = decoded(make_decoder("witmotion"), 3 * alone).imu
        assert len(imu) == 3
        assert np.isnan(imu[missing]).all()
    assert len(decoded(make_decoder("witmotion"), FORCE + RATE + FORCE + FORCE + RATE + RATE).imu) == 2


def test_combined_messages_count_if_another_one_follows():
    one = b"\x55\x61" + struct.pack("<9h", 0, 0, 2048, 16_384, 0, -16_384, 0, 8192, -8192)
    imu = decoded(make_decoder("witmotion"), b"\x55\x61" + 5 * one + b"noise").imu
    assert len(imu) == 4
    assert imu["force"][0] == pytest.approx([0.0, 0.0, G])
    assert imu["rate"][0] == pytest.approx([math.radians(1000), 0.0, -math.radians(1000)])
