"""Spikes of an IMU in a stream: dropped as lost samples are, counted, and with one solution in batch."""

from __future__ import annotations

import numpy as np
import pytest
from live_batch import assert_equal, navigator, random_pieces, solution_of, suite
from live_rows import driven, feed

from lab.data.streams.live_log import make_log
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings

SPIKED = (47, 1500, 1501, 1502, 3000, 4200, 7000, -1)
"""Samples with a spike: one early, three together, and the last one."""


def spiked(imu: np.ndarray) -> np.ndarray:
    imu = imu.copy()
    imu["force"][SPIKED[:4], 1] = 157.0
    imu["rate"][SPIKED[4:], 2] = -34.9
    return imu


@pytest.mark.proof
@pytest.mark.parametrize("longest", [2, 150])
def test_it_equals_the_batch_with_spikes(longest):
    imu, fixes, _ = driven(late=0.2)
    rows = spiked(imu)
    rows = np.delete(rows, (2000, 4201, 4202, 6999))  # also missing samples, beside spikes too
    live = navigator()
    feed(live, rows, fixes, random_pieces(1, longest))
    counts = live.state.rows
    assert counts.spikes == len(SPIKED)
    assert f"{len(SPIKED)} samples of the IMU with a spike" in " ".join(live.state.remarks)
    log = make_log("replay", rows, fixes, vehicle="car")
    assert counts.gaps == len(log.gaps)
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


def test_spikes_hardly_change_the_solution():
    imu, fixes, _ = driven(late=0.2)
    found = []
    for rows in (imu, spiked(imu)):
        live = navigator()
        feed(live, rows[:-1], fixes, random_pieces(1))
        found.append(solution_of(live))
    clean, dirty = found
    at = np.searchsorted(dirty.time, clean.time[:-5] - 1e-6)
    # A single sample of 16 g over 10 ms adds 1.6 m/s.
    assert np.abs(dirty.velocity_n[at] - clean.velocity_n[:-5]).max() < 0.1
