"""Recognition: streams are known by the frames that pass their check."""

from __future__ import annotations

import numpy as np
import pytest
from live_streams import capture, damaged, fixes, motion

from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.recognition import recognise

CAPTURES = {
    "vn100_bin_waves_F00294.bin": "vectornav",
    "xsens_mti_einride_1.bin": "xsens",
    "xsens_mti_einride_2.bin": "xsens",
    "xsens_mti_einride_5.bin": "xsens",
    "mip_sdk_mip_data.bin": "mip",
    "ubx_gpsd_neo-m8u.log": "ublox",
    "ubx_gpsd_zed-f9p-hp.log": "ublox",
    "ubx_gnss_imu_walk_1730_head256k.ubx": "ublox",
    "mavlink_blueos_head400k.tlog": "mavlink",
    "csv_gnss_imu_walk_1730_head6000.csv": "text",
    "phyphox_gyroscope_head3000.csv": "text",
}


@pytest.mark.parametrize("name", CAPTURES)
def test_captures_are_recognised_with_evidence(name):
    first, *others = recognise(capture(name))
    assert first.name == CAPTURES[name]
    assert f"{first.frames} " in first.evidence
    assert first.part > 0.75
    assert all(other.name == "nmea" for other in others)


@pytest.mark.parametrize("name", ENCODERS)
def test_streams_of_each_device_are_recognised_from_anywhere_in_them(name):
    data = ENCODERS[name]().encode(motion(300), fixes(20))
    # A header that was missed leaves what the numbers show: time in seconds and forces of 9.8 m/s².
    broken, _ = damaged(data[333:], 1e-3, np.random.default_rng(3))
    first = recognise(broken)[0]
    assert first.name == name
    assert (first.columns is not None) == (name == "text")


def test_nothing_is_recognised_in_noise_and_prose():
    rng = np.random.default_rng(5)
    assert recognise(b"") == []
    assert recognise(rng.bytes(60_000)) == []
    assert recognise(b"What is this, a sensor? No: 1 text, 2 lines, 3 words.\n" * 100) == []


def test_lines_of_columns_amid_other_text_are_not_taken_for_a_sensor():
    rows = "".join(
        f"{10 * number},0.1,0.2,9.8,0.01,0.02,0.03\nand a report of what was done\n" for number in range(50)
    )
    assert recognise(rows.encode()) == []
