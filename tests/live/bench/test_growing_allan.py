"""Growing Allan: the deviation of chunks against that of the whole record, bounded memory, and movements."""

from __future__ import annotations

from collections.abc import Callable

import allantools
import numpy as np
import pytest
from numpy.typing import NDArray

from lab.analysis import allan, rest
from lab.data.clock.timed_samples import TIMED_IMU
from lab.live.bench.growing_allan import LEAST_FOR_CARD, GrowingAllan

HZ = 100.0
GYRO, FORCE = np.radians(0.01), 2e-3  # rad/s/√Hz, m/s²/√Hz


def rows_at_rest(seconds: float, seed: int = 1) -> NDArray[np.void]:
    rng = np.random.default_rng(seed)
    n = round(seconds * HZ)
    rows = np.zeros(n, TIMED_IMU)
    rows["time"] = 1000 + np.arange(n) / HZ
    rows["rate"] = GYRO * np.sqrt(HZ) * rng.normal(size=(n, 3)) + 0.01
    rows["force"] = FORCE * np.sqrt(HZ) * rng.normal(size=(n, 3)) + (0, 0, -9.8)
    return rows


def fed(growing: GrowingAllan, rows: NDArray[np.void], seed: int = 5) -> GrowingAllan:
    """Feed rows in chunks of uneven sizes."""
    rng = np.random.default_rng(seed)
    at = 0
    while at < len(rows):
        size = int(rng.integers(1, 60))
        growing.add(rows[at : at + size])
        at += size
    return growing


def test_chunks_have_the_deviation_of_the_whole_record() -> None:
    rows = rows_at_rest(60)
    growing = fed(GrowingAllan(), rows)
    assert growing.restarts == 0
    record = growing.records()["gyro"]
    assert record.dt == pytest.approx(1 / HZ)
    assert np.array_equal(record.rates, rows["rate"])
    found = allan.deviation(record.rates, record.dt)
    tau, whole, _, _ = allantools.oadev(rows["rate"][:, 1], rate=HZ, data_type="freq", taus=found.tau)
    assert np.allclose(found.tau, tau)
    assert np.allclose(found.deviation[:, 1], whole, rtol=1e-6)


def test_memory_is_bounded_and_long_times_stay_exact() -> None:
    rows = rows_at_rest(120)
    growing = fed(GrowingAllan(room=1000), rows)
    assert len(growing) <= 1000
    assert growing._values.shape == (1000, 6)
    record = growing.records()["accelerometer"]
    assert record.dt == pytest.approx(16 / HZ)  # 12000 samples, averaged by 16
    assert growing.duration == pytest.approx(120, abs=2 * record.dt)
    whole = rows["force"][: len(record.rates) * 16].reshape(-1, 16, 3).mean(axis=1)
    assert np.allclose(record.rates, whole, rtol=0, atol=1e-12)
    found = allan.deviation(record.rates, record.dt)
    _, expected, _, _ = allantools.oadev(rows["force"][:, 0], rate=HZ, data_type="freq", taus=found.tau)
    few = found.degrees < 40  # of the whole record, there are more overlapping estimates
    assert np.allclose(found.deviation[~few, 0], expected[: len(found.tau)][~few], rtol=0.06)


def test_the_time_still_needed() -> None:
    growing = fed(GrowingAllan(), rows_at_rest(40))
    left = growing.time_to(20.0)
    assert left > 60 - 40  # a deviation reaches at most a third of its record
    count = round(left * HZ)
    rows = rows_at_rest(40 + left + 1)
    for more, reaches in ((count - 2, False), (count + 2, True)):
        record = rows["rate"][: len(growing) + more]
        assert (allan.deviation(record, 1 / HZ).tau[-1] >= 20.0 - 1e-9) is np.bool_(reaches)
    assert fed(GrowingAllan(), rows).time_to(20.0) == 0


def test_missing_samples_are_filled_and_a_long_gap_begins_anew() -> None:
    rows = np.delete(rows_at_rest(30), [700, 1500, 1501])
    growing = fed(GrowingAllan(), rows)
    assert (growing.filled, growing.restarts, len(growing)) == (3, 0, 3000)
    assert growing.records()["gyro"].dt == pytest.approx(1 / HZ)
    rows = rows_at_rest(30)
    rows["time"][1000:] += 2.5
    growing = fed(GrowingAllan(), rows)
    assert growing.restarts == 1
    assert "2.5 s are missing after 10 s" in growing.sentence
    assert growing.duration == pytest.approx(20, abs=0.1)


def moved_by_turning(rows: NDArray[np.void]) -> None:
    rows["rate"][2000:2100, 2] += np.radians(2)


def moved_by_tilting(rows: NDArray[np.void]) -> None:
    rows["force"][2000:, 0] += 9.8 * np.sin(np.radians(1.5))


def moved_slowly(rows: NDArray[np.void]) -> None:
    rows["force"][500:, 1] += 0.03 * np.arange(len(rows) - 500) / HZ  # per second, below the noticed change


def moved_by_knocking(rows: NDArray[np.void]) -> None:
    rows["force"][2000:2020] += 3 * np.sin(np.arange(20) * np.pi)[:, None] + 3 * np.tile([[1], [-1]], (10, 3))


@pytest.mark.parametrize("move", [moved_by_turning, moved_by_tilting, moved_slowly, moved_by_knocking])
def test_a_movement_is_told_and_begins_anew(move: Callable[[NDArray[np.void]], None]) -> None:
    rows = rows_at_rest(40)
    move(rows)
    growing = fed(GrowingAllan(), rows)
    assert growing.restarts >= 1
    assert "moved" in growing.sentence or "shaken" in growing.sentence
    assert "began again" in growing.sentence
    assert growing.duration < 24


def test_noisy_gyros_do_not_count_as_moving() -> None:
    rows = rows_at_rest(300)
    rows["rate"] *= 5  # 0.05 °/s/√Hz: seconds differ by up to 0.25 °/s
    assert fed(GrowingAllan(), rows).restarts == 0


def test_what_is_not_gravity_is_told() -> None:
    rows = rows_at_rest(10)
    rows["force"] /= 9.8
    growing = fed(GrowingAllan(), rows)
    assert "not that of a device at rest" in growing.sentence
    assert growing.duration < 2


def test_a_card_has_the_noise_that_was_simulated() -> None:
    growing = GrowingAllan()
    growing.add(rows_at_rest(LEAST_FOR_CARD))
    card = rest.card_of("mine", growing.records(), "a simulated stream")
    density = card.datum("gyro", "noise_density")
    assert density is not None
    assert np.allclose(np.radians(np.array(density.in_unit("°/√h")) / 60), GYRO, rtol=0.05)


def test_nothing_and_little_are_no_record() -> None:
    growing = GrowingAllan()
    assert np.isnan(growing.time_to(1.0))
    growing.add(rows_at_rest(0.2))
    assert "Waiting" in growing.sentence
