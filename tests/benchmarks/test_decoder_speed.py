"""Decoders on one core: a device that sends 1000 samples a second must cost less than 5 % of it."""

from __future__ import annotations

import time

import pytest
from live_streams import fixes, motion

from lab.data.protocols.catalogue import DECODERS, ENCODERS, make_decoder

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(600)]

COUNT = 5000
BOUND = 50e-6
"""Time for a frame at 1 kHz that is 5 % of a core [s]."""


def spent(name: str, frames: list[bytes]) -> float:
    """Return the processor time for each piece [s], least of three."""
    times = []
    for _ in range(3):
        decoder = make_decoder(name)
        begun = time.process_time()
        for frame in frames:
            decoder.feed(frame)
        times.append((time.process_time() - begun) / decoder.statistics.frames)
        assert decoder.statistics.frames >= COUNT - 1
    return min(times)


@pytest.mark.parametrize("name", DECODERS)
def test_a_kilohertz_costs_less_than_a_twentieth_of_a_core(name: str) -> None:
    encoder, imu, fix = ENCODERS[name](), motion(COUNT), fixes(COUNT)
    rows = [
        encoder.encode(imu[at : at + 1], fix[:0])
        if name != "nmea"
        else encoder.encode(imu[:0], fix[at : at + 1])
        for at in range(COUNT)
    ]
    single = spent(name, rows)
    together = spent(name, [b"".join(rows)])
    print(
        f"\n{name}: {1e6 * single:.1f} µs a frame that comes alone, {1e6 * together:.1f} µs of many at once"
    )
    assert single < BOUND
