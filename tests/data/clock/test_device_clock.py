"""Device clock: simulated arrivals, whose true times are known, against the mapping."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.limits import LIMITS

BASE = 1000.0  # of the host's clock [s]


def arrivals(true: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return when samples arrive: 0.2 ms at least, mostly below 1 ms, now and then 0.1 s later."""
    rng = np.random.default_rng(seed)
    delay = 2e-4 + rng.exponential(5e-4, true.size)
    delay += (rng.random(true.size) < 1e-3) * rng.exponential(0.1, true.size)
    return np.maximum.accumulate(true + delay)


def mapped(clock: DeviceClock, device: np.ndarray, arrival: np.ndarray, many: int = 1) -> np.ndarray:
    """Return the times of samples that arrive one by one, or `many` at once."""
    ends = range(many, device.size + 1, many)
    return np.concatenate([clock.mapped(device[end - many : end], arrival[end - 1])[0] for end in ends])


@pytest.mark.parametrize("rate", [50.0, 1000.0])
@pytest.mark.parametrize("drift", [0.0, 50e-6, -3e-3])
def test_offset_and_drift_are_found_among_late_arrivals(rate: float, drift: float) -> None:
    true = BASE + np.arange(int(100 * rate)) / rate
    device = 55 + (true - BASE) * (1 + drift)
    clock = DeviceClock()
    error = mapped(clock, device, arrivals(true)) - true
    late = error[true > BASE + 60]
    # The least delay of 0.2 ms cannot be told from the offset; that of 50 samples a second is larger.
    assert 1e-4 < late.mean() < 3e-4
    assert late.std() < 3e-5
    assert abs(clock.drift - drift) < 2e-6
    assert clock.steps == 1


def test_intervals_of_samples_are_those_of_the_device() -> None:
    true = BASE + np.arange(60_000) / 1000
    times = mapped(DeviceClock(), true - BASE, arrivals(true))
    steps = np.diff(times)
    assert (steps > 0).all()
    assert np.abs(1000 * steps - 1).max() < LIMITS.drift
    assert np.abs(1000 * steps[30_000:] - 1).max() < 1e-4


def test_samples_that_come_in_bursts_keep_their_intervals() -> None:
    true = BASE + np.arange(20_000) / 200
    arrival = np.ceil(true / 0.016) * 0.016 + 1e-3  # a USB bridge that waits 16 ms
    times = np.array(mapped(DeviceClock(), true - BASE, arrival, many=1))
    assert np.abs(200 * np.diff(times[8_000:]) - 1).max() < 1e-3


@pytest.mark.parametrize("late", [0.01, 0.02, 0.05])
@pytest.mark.parametrize("drift", [0.0, 1e-3])
def test_a_beginning_that_was_late_is_no_drift(late: float, drift: float) -> None:
    """The first samples that were not damaged wait for those after them, so they arrive late."""
    true = BASE + np.arange(8000) / 200
    arrival = true + 1e-3
    arrival[0] = true[0] + 1e-3 + late
    clock = DeviceClock()
    error = mapped(clock, (true - BASE) * (1 + drift), np.maximum.accumulate(arrival)) - true - 1e-3
    assert clock.steps == 1
    assert np.abs(error[true > BASE + 2 + late / LIMITS.made_up]).max() < (2e-3 if drift else 1e-4)
    assert abs(clock.drift - drift) < 1e-4


@pytest.mark.parametrize("step", [-7.0, 2.0])
def test_a_clock_that_was_set_is_mapped_anew(step: float) -> None:
    true = BASE + np.arange(4000) / 200
    device = true - BASE + 10
    device[2000:] += step
    clock = DeviceClock()
    error = mapped(clock, device, arrivals(true)) - true
    assert clock.steps == 2
    assert np.abs(error[-200:]).max() < 5e-3


def test_missing_samples_of_a_counted_stream_are_found_by_the_delay() -> None:
    true = BASE + np.arange(6000) / 200
    there = np.ones(6000, bool)
    there[2000:2100] = False  # half a second, which no counter shows
    clock = DeviceClock(counted=True)
    times = mapped(clock, np.arange(there.sum()) / 200, arrivals(true)[there])
    assert clock.steps == 2
    assert np.abs(times - true[there])[-1000:].max() < 5e-3
    assert LIMITS.step < 0.5


def test_a_network_that_was_cut_moves_no_sample() -> None:
    true = BASE + np.arange(12_000) / 60
    arrival = arrivals(true)
    cut = (true > BASE + 100) & (true < BASE + 110)
    arrival[cut] = BASE + 110 + 1e-4 * np.arange(cut.sum())  # sent again, all at once
    clock = DeviceClock()
    times = mapped(clock, true - BASE, np.maximum.accumulate(arrival))
    assert clock.steps == 1
    assert np.abs(times - true)[true > BASE + 60].max() < 5e-3


@pytest.mark.parametrize("pace", [0.5, 3.0])
def test_a_stream_of_another_pace_keeps_its_own_intervals(pace: float) -> None:
    true = np.arange(6000) / 100
    clock = DeviceClock()
    times = mapped(clock, true, BASE + true / pace)
    assert clock.steps == 1
    assert np.abs(100 * np.diff(times) - 1).max() <= LIMITS.drift + LIMITS.slew + 1e-9


def test_going_on_from_a_state_gives_the_same_bits() -> None:
    true = BASE + np.arange(8000) / 200
    device, arrival = 1.00002 * (true - BASE), arrivals(true)
    whole, first = DeviceClock(), DeviceClock()
    expected = mapped(whole, device, arrival)
    mapped(first, device[:4321], arrival[:4321])
    later = mapped(DeviceClock.restored(first.state), device[4321:], arrival[4321:])
    assert later.tobytes() == expected[4321:].tobytes()


@pytest.mark.proof
@pytest.mark.parametrize("usual", [2e-4, 2e-3, 1e-2])
@pytest.mark.parametrize("drift", [0.0, 2e-4, -1e-3])
def test_the_sigma_of_the_drift_holds_from_the_beginning(usual: float, drift: float) -> None:
    errors, last = [], []
    for seed in range(20):
        rng, clock = np.random.default_rng(seed), DeviceClock()
        for k in range(6000):
            late = rng.exponential(usual) + (rng.random() < 0.02) * rng.exponential(0.05)
            clock.mapped(np.array([0.01 * k * (1 + drift)]), BASE + 0.01 * k + late)
            if k % 100 == 99 and np.isfinite(clock.drift_sigma):
                errors.append((clock.drift - drift) / clock.drift_sigma)
        last.append(clock.drift_sigma)
    assert np.median(last) < (1e-5 if usual < 5e-3 else 1e-4)
    # Those of a quiet host are 1.7 σ at 95 %: the narrowing of the band is passed on.
    assert np.quantile(np.abs(errors), 0.95) < 2.0
