"""Spikes of a stream: found from the samples before and few after, whatever pieces the samples arrive in."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.log.spikes import StreamSpikes, spikes, stream_spikes

MOST_WAITING = 8
"""Samples after a jump until it is decided."""


def shaken(count: int, seed: int = 1) -> np.ndarray:
    """Return samples of a vehicle that vibrates: 0.3 rad/s and 2 m/s², 1 σ."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 6)) * np.repeat((0.3, 2.0), 3) + (0, 0, 0, 0, 0, -9.8)


def spiked(values: np.ndarray, part: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Write the end of a range, 2000 °/s or 16 g, into single axes of single samples; return also which."""
    rng, values = np.random.default_rng(seed), values.copy()
    hit = np.flatnonzero(rng.random(len(values)) < part)
    hit = hit[hit > 30]
    axis = rng.integers(0, 6, hit.size)
    values[hit, axis] = np.where(axis < 3, 34.9, 157.0) * rng.choice((-1, 1), hit.size)
    which = np.zeros(len(values), np.bool_)
    which[hit] = True
    return values, which


@pytest.mark.parametrize("seed", range(3))
def test_spikes_are_found_in_any_pieces(seed):
    values, hit = spiked(shaken(9000, seed), 0.004, seed)
    np.testing.assert_array_equal(stream_spikes(values), hit)
    rng, found, parts, at = np.random.default_rng(seed), StreamSpikes(), [], 0
    while at < len(values):
        size = int(rng.integers(1, 60))
        parts.append(found.accept(values[at : at + size]))
        at += size
    np.testing.assert_array_equal(np.concatenate((*parts, found.finish())), hit)


def test_samples_wait_only_at_jumps_and_shortly():
    values, hit = spiked(shaken(3000), 0.002)
    found, decided, waiting = StreamSpikes(), 0, []
    for row in values:
        decided += found.accept(row[None]).size
        waiting.append(len(waiting) + 1 - decided)
    assert max(waiting) == MOST_WAITING
    near = np.convolve(hit, np.ones(20), "same") > 0
    assert not np.array(waiting)[~near].any()


def test_a_jump_that_lasts_waits_for_four_samples():
    found = StreamSpikes()
    found.accept(np.zeros((100, 6)))
    turned = np.zeros((20, 6))
    turned[:, 2] = 30.0
    sizes = [found.accept(row[None]).size for row in turned]
    assert sizes[:6] == [0, 0, 0, 0, 1, 1]
    assert sum(sizes) == len(turned)
    assert not found.finish().size


def test_real_flights_and_drives_have_none_and_those_put_in_are_found(recordings):
    for name in ("comma2k19", "rtkx_walk", "vn310_static"):
        log = read_sensor_log(recordings / name)
        values = np.concatenate(log.rates, axis=1)
        assert not stream_spikes(values).any()
        values, hit = spiked(values, 0.005)
        np.testing.assert_array_equal(stream_spikes(values), hit)
        np.testing.assert_array_equal(spikes(values), hit)


def ringing(values):
    """Hit the IMU with 30 g, which decays in a tenth of a second."""
    after = np.arange(60)
    values[500:560, 5] += 300 * np.exp(-after / 10) * np.cos(2.5 * after)


def bursts(values):
    """Write 16 g in four samples together."""
    values[500:504, 3] = 157


def rolling(values):
    """Roll at 1500 °/s for a tenth of a second."""
    values[500:510, 0] += 26


@pytest.mark.parametrize("motion", [ringing, bursts, rolling])
def test_violent_motion_is_no_spike(motion):
    values = shaken(1200) / 100
    motion(values)
    assert not stream_spikes(values).any()


def test_knocks_that_go_on_are_no_spikes():
    """No sample before them can tell the first three from spikes."""
    values = shaken(1200) / 100
    values[100::50, 5] += 120
    np.testing.assert_array_equal(np.flatnonzero(stream_spikes(values)), (100, 150, 200))
