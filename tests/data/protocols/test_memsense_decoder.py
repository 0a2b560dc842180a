"""MEMSense nIMU: frames of the published layout; no captured bytes are public."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from live_streams import decoded, motion

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.memsense import TICK, MemsenseEncoder

COUNTS = (1000, -2000, 3000, 100, -200, 10922, 500, 600, -700, 1, 2, 3)


def frame(counts: tuple[int, ...] = COUNTS, timer: int = 0, over_frame: bool = True) -> bytes:
    """Return a frame as Gastd/memsense_nano_imu, src/memsense_nano_imu.cpp lays it out."""
    body = b"\xff" * 4 + b"\x26\xff\x14" + struct.pack(">H", timer) + bytes(4) + struct.pack(">12h", *counts)
    return body + bytes((sum(body if over_frame else body[13:]) & 0xFF,))


def test_a_frame_has_the_published_scales():
    (row,) = decoded(make_decoder("memsense"), frame(timer=1000)).imu
    # Published per count: 1.3733e-2 °/s, 9.1553e-5 g, 8.6975e-5 gauss, 1.8165e-2 °C from 25 °C.
    np.testing.assert_allclose(row["rate"], np.radians(1.3733e-2) * np.array(COUNTS[:3]), rtol=2e-5)
    np.testing.assert_allclose(row["force"], 9.1553e-5 * 9.80665 * np.array(COUNTS[3:6]), rtol=1e-5)
    np.testing.assert_allclose(row["magnetic"], 8.6975e-9 * np.array(COUNTS[6:9]), rtol=1e-5)
    assert row["temperature"] == pytest.approx(25 + 2 * 1.8165e-2)
    assert row["time"] == pytest.approx(1000 * 2.1701e-6)


@pytest.mark.parametrize("over_frame", [True, False])
def test_the_sum_first_seen_is_the_one_that_counts(over_frame):
    decoder = make_decoder("memsense")
    stream = (
        frame(over_frame=over_frame) * 5 + frame(over_frame=not over_frame) + frame(over_frame=over_frame)
    )
    assert len(decoded(decoder, stream).imu) == 6
    assert decoder.statistics.failed == 1


def test_a_first_sum_by_chance_is_corrected():
    decoder = make_decoder("memsense")
    assert len(decoded(decoder, frame(over_frame=False) + frame() * 10).imu) == 1 + 8


def test_the_timer_goes_on_when_it_starts_again():
    steps = np.arange(100) * 3072  # 6.67 ms, 150 Hz
    imu = decoded(make_decoder("memsense"), b"".join(frame(timer=int(step) % 65536) for step in steps)).imu
    np.testing.assert_allclose(imu["time"], steps * TICK, rtol=1e-12)
    assert make_decoder("memsense").wrap_period == pytest.approx(0.1422, abs=1e-4)


def test_sync_bytes_in_the_numbers_and_twice_are_survived():
    minus_one = (-1,) * 12
    decoder = make_decoder("memsense")
    stream = (b"\xff" * 3 + frame(minus_one)) * 20 + frame(minus_one) * 20
    assert len(decoded(decoder, stream).imu) == 40
    assert decoder.statistics.skipped == 60


def test_what_is_encoded_is_read_again():
    imu = motion(200)
    decoder = make_decoder("memsense")
    found = decoded(decoder, MemsenseEncoder().encode(imu, imu[:0])).imu
    assert decoder.statistics.skipped == 0
    np.testing.assert_allclose(found["rate"], imu["rate"], atol=np.radians(300) * 1.5 / 65536 + 1e-12)
    np.testing.assert_allclose(found["force"], imu["force"], atol=2 * 9.80665 * 1.5 / 65536 + 1e-12)
    np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=TICK)
