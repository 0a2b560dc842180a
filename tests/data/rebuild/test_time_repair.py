"""Repaired time stamps are the times the samples were taken, increase always, and never stretch a flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from raw_flights import weave, without

from lab.data.rebuild import sample_times as clock
from lab.data.rebuild import time_repair
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.rebuild.time_repair import AS_RECORDED, repair
from lab.missions import MissionError

EVEN = np.arange(1500) * 0.05
FRAMES = np.cumsum(np.random.default_rng(7).uniform(0.02, 0.06, 1500))


def error(repaired: np.ndarray, true: np.ndarray) -> float:
    """Return the rms of times about the true ones; an offset of all of them is nothing a clock can know."""
    return float(np.std(repaired - true))


def test_good_stamps_stay_as_they_are():
    for time in (EVEN, FRAMES, 1.7e9 + EVEN):
        found = repair(weave(EVEN) if time[0] > 1e6 else weave(time))
        assert found.method == AS_RECORDED
        assert found.moved_max == 0


@pytest.mark.parametrize(
    ("stamps", "tick"),
    [
        (np.round(np.arange(1500) / 60, 3), 0.001),
        (np.floor(EVEN * 18) / 18, 1 / 18),
        (np.floor(EVEN), 1.0),
        (np.round(EVEN, 1), 0.1),
    ],
)
def test_an_even_clock_that_was_rounded_is_found_again(stamps, tick):
    true = np.arange(1500) / 60 if tick == 0.001 else EVEN
    found = repair(replace(weave(true), time=stamps))
    assert found.tick == pytest.approx(tick, rel=0.02)
    assert found.method in {"even", "spread"}
    assert error(found.raw.time, true) < 0.01 * tick


def test_jitter_about_an_even_clock_is_removed():
    jitter = np.random.default_rng(2).uniform(-2e-3, 2e-3, EVEN.size)
    found = repair(replace(weave(EVEN), time=EVEN + jitter))
    assert found.method == "even"
    assert error(found.raw.time, EVEN) < 1e-4
    assert found.moved_rms == pytest.approx(np.std(jitter), rel=0.05)


def test_samples_at_the_next_frame_are_not_taken_for_jitter():
    # Asked for every 0.1 s, given at the next of 37.1 frames a second: uneven, bounded, and true.
    time = np.unique(np.ceil(np.arange(0, 150, 0.1) * 37.1)) / 37.1
    found = repair(weave(time))
    assert found.moved_max < 1e-6


@pytest.mark.parametrize("tick", [1 / 18, 0.02, 0.01])
def test_uneven_frames_under_a_coarse_clock_are_found_by_the_motion(tick):
    stamps = np.floor(FRAMES / tick) * tick
    raw = replace(weave(FRAMES), time=stamps)
    found = repair(raw)
    assert found.method == "by motion"
    before = np.std(stamps - FRAMES)
    after = error(found.raw.time, FRAMES) if len(found.raw.time) == len(FRAMES) else np.nan
    assert after < 0.25 * before


def test_positions_alone_are_enough_to_find_them():
    stamps = np.floor(FRAMES * 18) / 18
    raw = without(replace(weave(FRAMES), time=stamps), "velocity_n", "euler", "airspeed", "alpha", "beta")
    found = repair(raw)
    assert found.method == "by motion"
    assert error(found.raw.time, FRAMES) < 0.2 * np.std(stamps - FRAMES)


def test_noise_of_positions_is_not_taken_for_time():
    rng = np.random.default_rng(3)
    raw = weave(FRAMES)
    noisy = replace(raw, latitude=raw.latitude + 2e-7 * rng.normal(size=FRAMES.size))
    assert repair(noisy).method == AS_RECORDED


def test_as_recorded_moves_nothing():
    stamps = np.floor(EVEN)
    found = repair(replace(weave(EVEN), time=stamps), AS_RECORDED)
    np.testing.assert_array_equal(found.raw.time, np.unique(stamps))
    assert [one.count for one in found.dropped] == [1500 - 75]


def test_rows_out_of_order_are_put_in_place():
    order = np.arange(1500)
    order[[100, 101, 700, 701]] = order[[101, 100, 701, 700]]
    found = repair(weave(EVEN).rows(order))
    np.testing.assert_array_equal(found.raw.time, EVEN)
    assert "2 rows were out of order" in " ".join(found.raw.remarks)


def test_the_longest_stretch_is_taken_where_the_clock_starts_anew():
    twice = np.concatenate((EVEN[:400], EVEN))
    found = repair(replace(weave(np.arange(1900) * 0.05), time=twice))
    assert found.raw.time.size == 1500
    assert found.dropped[0].count == 400
    assert found.cuts == ((pytest.approx(19.95), pytest.approx(0.0)),)


def test_a_pause_of_the_simulator_cuts():
    raw = weave(EVEN)
    # The simulator stands still for a minute, and the logger goes on writing what it had.
    paused = np.concatenate((np.arange(600), np.full(1200, 599), np.arange(600, 1500)))
    found = repair(replace(raw.rows(paused), time=np.arange(paused.size) * 0.05))
    assert found.raw.time.size == 900
    assert {one.count for one in found.dropped} == {1200, 600}


def test_what_a_longer_gap_would_keep_is_what_it_keeps():
    rng = np.random.default_rng(3)
    # A logger that saves points where the way bends: mostly each second, often after a pause.
    steps = np.where(rng.random(400) < 0.1, rng.uniform(6, 60, 400), 1.0)
    raw = weave(np.concatenate(([0.0], np.cumsum(steps))))
    first = repair(without(raw, "velocity_n", "euler", "airspeed", "alpha", "beta"))
    assert len(first.raw.time) < 100
    assert [more.share for more in first.bridging] == sorted(more.share for more in first.bridging)
    assert first.bridging[-1].share > 0.95
    for more in first.bridging:
        again = repair(raw, longest_gap=more.gap)
        assert len(again.raw.time) == round(more.share * len(raw.time))
    assert not repair(weave(EVEN)).bridging


def test_pauses_that_were_bridged_are_counted_and_shorter_ones_are_not():
    raw = weave(np.arange(1500) / 16)  # exact in binary: three steps are not a bit more than three
    kept = np.ones(1500, dtype=bool)
    kept[[200, 600, 601]] = False  # two and three usual steps
    assert repair(raw.rows(np.flatnonzero(kept)), AS_RECORDED).gaps == 0
    kept[1000:1003] = kept[1200:1220] = False  # four, and more than one second
    found = repair(raw.rows(np.flatnonzero(kept)), AS_RECORDED)
    assert found.gaps == 2
    assert found.raw.time.size == kept.sum()


@pytest.mark.parametrize(("last", "length"), [(9.95, 9.95), (10.05, 10.05), (9.85, 9.9), (10.3, 10.1)])
def test_a_flight_may_differ_from_its_stamps_by_one_step_and_is_stretched_beyond(last, length):
    """Stamps of 101 samples over 10 s at 0.1 s, with times that end earlier or later than they do."""
    stamps, times = np.linspace(0, 10, 101), np.linspace(0, last, 101)
    kept = time_repair._of_the_same_length(times, stamps, 1e-3)
    assert kept[-1] == pytest.approx(length, abs=5e-3)
    np.testing.assert_allclose(kept / kept[-1], times / last, rtol=1e-12)


def test_a_state_written_twice_is_one_sample():
    raw = weave(np.arange(750) * 0.1)
    polled = replace(raw.rows(np.repeat(np.arange(750), 2)), time=np.arange(1500) * 0.05)
    found = repair(polled)
    assert found.dropped[0].count == 750
    np.testing.assert_allclose(np.diff(found.raw.time), 0.1, rtol=1e-9)


def test_a_vehicle_at_rest_keeps_its_samples():
    raw = weave(EVEN)
    still = raw.rows(np.zeros(1500, dtype=np.intp))
    still = replace(still, time=EVEN, velocity_n=np.zeros((1500, 3)))
    assert repair(still).raw.time.size == 1500


def test_a_single_position_far_off_is_left_out():
    raw = weave(EVEN)
    latitude = raw.latitude.copy()
    latitude[700] += 0.01
    found = repair(replace(raw, latitude=latitude))
    assert found.raw.time.size == 1499
    assert "far from the path" in found.dropped[0].reason


def test_a_jump_elsewhere_cuts():
    raw = weave(EVEN)
    longitude = raw.longitude.copy()
    longitude[500:] += 0.02
    found = repair(replace(raw, longitude=longitude))
    assert found.raw.time.size == 1000
    assert found.started == pytest.approx(EVEN[500])


def test_positions_at_zero_are_left_out_unless_the_flight_is_there():
    raw = weave(np.arange(0.0, 60.0, 0.1))
    some = {
        name: np.where(np.arange(600) < 40, 0.0, getattr(raw, name)) for name in ("latitude", "longitude")
    }
    repaired = repair(replace(raw, **some))
    assert len(repaired.raw.time) == 560
    assert "0° N 0° E" in repaired.dropped[0].reason
    here = weave(np.arange(0.0, 60.0, 0.1), latitude=0.0, longitude=0.0)
    assert len(repair(here).raw.time) == 600


def test_positions_that_are_all_zero_are_no_positions():
    raw = weave(np.arange(0.0, 60.0, 0.1))
    zero = np.zeros(600)
    flight = repair(replace(raw, latitude=zero, longitude=zero)).raw
    assert flight.latitude is None
    assert "all are at 0° N 0° E" in flight.remarks[-1]
    with pytest.raises(MissionError, match="all 600 positions are at 0° N 0° E"):
        repair(replace(without(raw, "velocity_n"), latitude=zero, longitude=zero))


def test_impossible_rows_are_counted_and_most_of_them_refused():
    latitude = weave(EVEN).latitude.copy()
    latitude[10:15] = 40.0
    found = repair(replace(weave(EVEN), latitude=latitude))
    assert found.dropped[0].count == 5
    assert found.dropped[0].reason.endswith("first at 0.5 s")
    with pytest.raises(MissionError, match=r"1500 of 1500 samples have a latitude beyond ±90°"):
        repair(replace(weave(EVEN), latitude=np.degrees(weave(EVEN).latitude)))


def test_resolution_of_stamps():
    assert clock.resolution(np.arange(100) * 0.02) == pytest.approx(0.02)
    assert clock.resolution(1e5 + np.arange(100) / 16) == pytest.approx(0.0625)
    assert clock.resolution(FRAMES) == 0
    rng = np.random.default_rng(1)
    steps = rng.integers(1, 5, 500) / 18 + rng.normal(scale=5e-5, size=500)
    assert clock.resolution(np.cumsum(steps)) == pytest.approx(1 / 18, rel=1e-3)


def test_the_prediction_of_a_cubic_is_exact_and_noise_grows_as_said():
    time = np.cumsum(np.random.default_rng(4).uniform(0.5, 1.5, 200))
    cubic = np.stack((time**3 - time, 2 - time**2), axis=-1)
    np.testing.assert_allclose(clock.prediction_error(time, cubic), 0, atol=1e-6)
    noise = np.random.default_rng(4).normal(size=(20_000, 1))
    grown = np.std(clock.prediction_error(np.arange(20_000.0), noise))
    assert grown == pytest.approx(np.sqrt(1.944), rel=0.03)


STAMPS = st.lists(st.floats(-1e9, 1e9) | st.integers(0, 30).map(float), min_size=4, max_size=60)


@given(
    stamps=STAMPS, tick=st.sampled_from([0.0, 1e-3, 0.0555, 1.0]), kind=st.sampled_from(["sorted", "as is"])
)
@example(stamps=[0.0, 1.0, 1.0, 0.01171875, 3e-142], tick=0.0, kind="sorted")
def test_whatever_the_stamps_repaired_time_increases_and_keeps_its_length(stamps, tick, kind):
    time = np.array(sorted(stamps) if kind == "sorted" else stamps)
    time = np.floor(time / tick) * tick if tick else time
    flight = replace(weave(np.arange(time.size) * 0.1), time=time)
    try:
        found = repair(flight, longest_gap=1e9)
    except MissionError:
        return
    repaired = found.raw.time
    assert repaired[0] == 0
    assert (np.diff(repaired) > 0).all()
    steps = np.diff(np.unique(time))
    steps = steps[steps >= 1e-6]  # a stamp that is nearer repeats the one before
    within = max(found.tick, np.median(steps), np.median(np.diff(repaired))) + 1e-6 * np.abs(time).max()
    assert found.started + repaired[-1] <= time.max() + 1.1 * within
    assert found.moved_max <= 2 * within


@given(
    st.integers(4, 300),
    st.sampled_from([0.001, 0.01, 0.0555, 0.1, 1.0]),
    st.floats(0.005, 2.0),
    st.integers(0, 2**32 - 1),
)
def test_rounded_stamps_keep_the_duration_within_a_step(samples, tick, step, seed):
    true = np.cumsum(np.random.default_rng(seed).uniform(0.3, 1.7, samples)) * step
    stamps = np.floor(true / tick) * tick
    try:
        found = repair(replace(weave(true), time=stamps), longest_gap=1e6)
    except MissionError:
        assert len(np.unique(stamps)) < 4
        return
    repaired = found.raw.time
    assert (np.diff(repaired) > 0).all()
    grid = max(found.tick, float(np.median(np.diff(repaired))))
    assert abs(repaired[-1] - (stamps[-1] - stamps[0])) <= 1.1 * grid


@given(st.data())
def test_hostile_numbers_are_refused_with_a_message_or_repaired(data):
    count = data.draw(st.integers(1, 12))
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    column = st.lists(numbers, min_size=count, max_size=count).map(np.array)
    raw = RawFlight(
        format="hostile",
        time=data.draw(column),
        latitude=data.draw(column | st.just(np.zeros(count))),
        longitude=data.draw(column | st.just(np.zeros(count))),
        height=data.draw(st.none() | column),
    )
    try:
        found = repair(raw)
    except MissionError:
        return
    assert (np.diff(found.raw.time) > 0).all()
