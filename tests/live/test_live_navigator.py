"""The live navigator: its solution is the batch's, its σ is honest, and it says what it cannot know."""

from __future__ import annotations

from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from live_rows import HOST, RATE, driven, feed, handled, standing

import lab.live
from lab.displacement import metres_per_radian
from lab.live import live_navigator
from lab.live.axis_map import AxisMap
from lab.live.decoders.catalogue import ENCODERS
from lab.live.live_log import log_of
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import HistoryCursor
from lab.live.live_stream import POSITION_LIMIT
from lab.live.live_view import COASTS_AFTER
from lab.live.raw_recording import RawWriter
from lab.live.recorded_log import log_of_recording
from lab.live.simulated_flight import SimulatedFlight
from lab.live.timed import TIMED_FIX
from lab.live.transport import Chunk
from lab.navigation.recorded import RecordedRun, navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.rotation import wrap
from lab.sensors.cards import card
from lab.sensors.suite import SensorSuite
from lab.settings import SettingError

NO_FIXES = np.empty(0, TIMED_FIX)
TOLERANCE = 1e-9


def suite() -> SensorSuite:
    sensors = SensorSuite()
    sensors.gyro.bias_sigma = (0.3,) * 3
    sensors.accelerometer.bias_sigma = (5.0,) * 3
    return sensors


def navigator(kept: float = 1e6, **settings) -> LiveNavigator:
    return LiveNavigator(suite(), NavigatorSettings(**{"vehicle": "car"} | settings), kept=kept)


def random_pieces(seed: int, longest: int = 150):
    rng = np.random.default_rng(seed)
    while True:
        yield int(rng.integers(1, longest))


def assert_equal(live: LiveNavigator, run: RecordedRun) -> None:
    """Compare with a batch run: metres, metres per second, radians, and the same relative to P."""
    mine, batch = live.solution(), run.solution
    np.testing.assert_array_equal(mine.time, run.imu.time)
    scale = [*map(float, metres_per_radian(batch.position[0, 0], 0.0)), 1.0]
    assert np.abs((mine.position - batch.position) * scale).max() < TOLERANCE
    for name in ("velocity_n", "q_nb", "bias"):
        assert np.abs(getattr(mine, name) - getattr(batch, name)).max() < TOLERANCE, name
    assert np.abs(mine.variance / batch.variance - 1).max() < TOLERANCE
    assert np.abs(mine.covariance - batch.covariance).max() < TOLERANCE
    np.testing.assert_allclose(mine.fix_time, run.fixes.time, atol=TOLERANCE)
    known = np.isfinite(batch.innovation)
    assert np.abs(mine.innovation - batch.innovation)[known].max() < TOLERANCE
    S = mine.innovation_covariance / batch.innovation_covariance.max(axis=(1, 2), keepdims=True)
    T = batch.innovation_covariance / batch.innovation_covariance.max(axis=(1, 2), keepdims=True)
    assert np.abs(S - T).max() < TOLERANCE
    np.testing.assert_array_equal(mine.fix_rejected, batch.fix_rejected)


@pytest.mark.parametrize(
    ("pieces", "late", "settings"),
    [
        (lambda: repeat(1), 0.2, {}),
        (lambda: random_pieces(1), 0.2, {}),
        (lambda: repeat(8000), 0.0, {}),
        (lambda: random_pieces(3), 1.7, {"lever_arm": (1.0, -0.5, -1.2)}),
        (lambda: random_pieces(4), 0.2, {"gate": 0.9}),
        (lambda: random_pieces(5), 0.2, {"correction": "feedforward", "rest_updates": False}),
        (lambda: random_pieces(6), 0.2, {"correction_period": 3.0}),
    ],
)
def test_it_equals_the_batch(pieces, late, settings):
    imu, fixes, _ = driven(late=late, lever_arm=settings.get("lever_arm", (0.0, 0.0, 0.0)))
    live = navigator(**settings)
    feed(live, imu, fixes, pieces())
    log = log_of("replay", imu, fixes, settings.get("lever_arm"), vehicle="car")
    whole = NavigatorSettings(vehicle="car", **settings)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))
    # The batch sees the whole log, and finds the same start here.
    assert_equal(live, navigate_log(log, suite(), whole))
    own = live.log()
    np.testing.assert_array_equal(own.time, log.time)
    np.testing.assert_array_equal(own.dtheta, log.dtheta)
    np.testing.assert_array_equal(own.gnss.velocity_sigma, log.gnss.velocity_sigma)
    if settings.get("rest_updates", True):
        assert live.solution().variance[6500, 9:12].max() < np.radians(0.01) ** 2  # at rest, the bias shows


@pytest.mark.parametrize("settings", [{"filter_rate": 20.0}, {"model": "invariant"}])
def test_it_equals_the_batch_with_another_kernel(settings):
    imu, fixes, _ = driven(late=0.2)
    live = navigator(**settings)
    feed(live, imu[:6000], fixes[fixes["time"] < HOST + 59], random_pieces(1))
    log = log_of("replay", imu[:6000], fixes[fixes["time"] < HOST + 59], vehicle="car")
    whole = NavigatorSettings(vehicle="car", **settings)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))


def test_stamps_that_are_late_are_brought_to_their_time():
    imu, fixes, _ = driven()
    fixes["time"] += 0.15
    fixes["arrival"] += 0.15
    live = navigator(latency=0.15)
    feed(live, imu, fixes, random_pieces(1))
    log = log_of("replay", imu, fixes, latency=0.15, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))
    assert np.abs(np.mean(live.solution().innovation[120:190, :2], axis=0)).max() < 0.3


@pytest.mark.parametrize("axes", [(2,), (0, 1, 2)])
def test_velocities_that_the_receiver_does_not_measure(axes):
    imu, fixes, _ = driven(late=0.2)
    for axis in axes:
        fixes["velocity_n"][:, axis] = np.nan
    fixes["velocity_n"][100, 2] = np.nan
    live = navigator(gate=0.99)
    feed(live, imu, fixes, random_pieces(1))
    log = log_of("replay", imu, fixes, vehicle="car")
    whole = NavigatorSettings(vehicle="car", gate=0.99)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))
    assert np.isnan(live.solution().innovation[:, 5]).all()


def test_rows_that_cannot_be_used_are_counted_and_change_nothing():
    imu, fixes, _ = driven(late=0.2)
    bad = np.concatenate((imu[:3000], imu[2990:3000], imu[3000:]))  # ten rows again
    bad["rate"][4000, 1] = np.nan
    bad["time"][5000] = np.nan
    broken = np.insert(fixes, [40, 80], fixes[[39, 80]])
    broken["latitude"][80] = np.nan
    live = navigator()
    feed(live, bad, broken, random_pieces(1))
    state = live.state
    assert (state.rows.late, state.rows.unusable, state.fixes_refused) == (10, 2, 3)
    assert "3 fixes were not used" in " ".join(state.remarks)
    log = log_of("replay", bad, broken, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


def test_a_polled_sensor_repeats_samples():
    imu, fixes, _ = driven(late=0.2)
    doubled = np.repeat(imu, np.tile((1, 2, 3), 3000))
    doubled["time"] = HOST + np.arange(1, doubled.size + 1) / 200
    doubled["arrival"] = doubled["time"]
    doubled[9000:9040] = doubled[9000]  # a sensor that is stuck
    doubled["time"] = HOST + np.arange(1, doubled.size + 1) / 200
    live = navigator()
    feed(live, doubled, fixes, random_pieces(1, 9))
    log = log_of("replay", doubled, fixes, vehicle="car")
    assert live.state.rows.repeated == doubled.size - log.time.size > 8000
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


def test_a_short_gap_is_filled_as_in_a_log_and_marked():
    imu, fixes, trajectory = driven(late=0.2)
    rows = np.delete(imu, slice(8000, 8100))
    live = navigator()
    feed(live, rows, fixes, random_pieces(1))
    state = live.state
    assert (state.rows.gaps, state.rows.filled, state.rows.breaks) == (1, 100, 0)
    assert "1 gap" in " ".join(state.remarks)
    log = log_of("replay", rows, fixes, vehicle="car")
    np.testing.assert_allclose(live.log().gaps, log.gaps, atol=TOLERANCE)
    np.testing.assert_allclose(live.log().dtheta, log.dtheta, atol=1e-15)
    run = navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment)
    mine = live.solution()
    before = slice(0, 8000)
    np.testing.assert_array_equal(mine.q_nb[before], run.solution.q_nb[before])
    # In the gap the batch takes its noise from the whole log; both know little, and recover.
    sigma = np.sqrt(mine.variance[:, :3])
    whole = navigator()
    feed(whole, imu, fixes, repeat(200))
    assert np.sqrt(mine.variance[8098, 3:6] / whole.solution().variance[8098, 3:6]).max() > 1.5
    truth = trajectory.at(mine.time[8000:] + 0.01)
    miss = (mine.position[8000:] - np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)) * [
        *map(float, metres_per_radian(truth.latitude[0], 0.0)), 1.0,
    ]  # fmt: skip
    assert (np.abs(miss) < 4 * sigma[8000:] + 0.05).all()


def test_a_long_gap_breaks_the_stream_and_is_said():
    imu, fixes, _ = driven(late=0.2)
    away = (imu["time"] > HOST + 48) & (imu["time"] < HOST + 53)
    live = navigator()
    feed(live, imu[~away], fixes, random_pieces(1))
    state = live.state
    assert state.rows.breaks == 1
    assert "silent for 5.0 s" in " ".join(state.remarks)
    assert state.phase == "navigating"
    assert live.log().epoch == pytest.approx(HOST + 53, abs=0.02)
    history = live.since()[1]
    assert not ((history.time > HOST + 48.1) & (history.time < HOST + 52.9)).any()


def test_a_clock_that_is_set_back_begins_a_new_stream():
    imu, _, _ = driven()
    again = imu[:4000].copy()
    live = navigator()
    feed(live, np.concatenate((imu[:4000], again)), NO_FIXES, random_pieces(1, 40))
    state = live.state
    assert 50 <= state.rows.late < 100
    assert "The clock was set back" in " ".join(state.remarks)
    assert state.time == pytest.approx(imu["time"][3999])


def test_fixes_that_stop_let_it_coast_until_the_position_means_nothing():
    imu, fixes, _ = driven()
    more = np.concatenate((imu, imu[-2000:], imu[-2000:], imu[-2000:], imu[-2000:]))
    more["time"] = more["arrival"] = HOST + np.arange(1, more.size + 1) / 100
    live = navigator(kept=60.0)
    early = fixes[fixes["time"] < HOST + 50]
    seen = {}
    for start in range(0, more.size, 100):
        part = more[start : start + 100]
        due = (early["arrival"] <= part["time"][-1]) & (early["arrival"] > part["time"][0] - 0.01)
        live.feed(part, early[due])
        state = live.state
        seen.setdefault(state.phase, (state.time - HOST, state))
    age = seen["coasting"][0] - 50
    assert COASTS_AFTER - 0.5 < age < COASTS_AFTER + 1.5
    assert "last fix" in seen["coasting"][1].reason
    last = live.state
    assert last.phase == "attitude only"
    assert f"up to {POSITION_LIMIT:g} m" in last.reason
    assert np.isnan(last.position).all()
    assert np.isfinite(last.euler).all()
    assert seen["coasting"][1].position_sigma[0] > seen["navigating"][1].position_sigma[0] * 0.5


def test_no_fix_no_position_but_an_attitude_carried_by_the_gyros():
    ratios = []
    for seed in range(1, 4):
        imu, _, trajectory = driven(seed)
        live = navigator(initial_heading=float(np.degrees(0.6)), initial_heading_uncertainty=2.0)
        feed(live, imu[:5000], NO_FIXES, repeat(100))
        state = live.state
        assert state.phase == "attitude only"
        assert np.isnan(state.position).all()
        assert np.isnan(state.displacement).all() or state.displacement_sigma[0] < 10
        true = trajectory.at(np.array([state.time - HOST])).euler[0]
        ratios.append(wrap(state.euler - true) / state.euler_sigma)
        assert state.heading_source == "given"
    print(np.array(ratios).round(2))
    assert np.abs(ratios).max() < 3.5


@pytest.mark.parametrize("name", ["BMI088", "MPU-6000", "ADIS16448"])
def test_sigma_at_rest_is_honest_without_fixes(name):
    """A consumer card on a table: σ of the heading is never below its error, over 20 seeds."""
    sensors = SensorSuite()
    sensors.update(card(name).settings())
    place = np.array([np.radians(45), 0.0, 0.0])
    errors, sigmas = [], []
    for seed in range(1, 21):
        euler = np.random.default_rng(seed).uniform((-0.4, -0.4, -3), (0.4, 0.4, 3))
        live = LiveNavigator(sensors, NavigatorSettings(), place=place)
        feed(live, standing(sensors, tuple(euler), place[0], 20.0, seed, 50.0), NO_FIXES, repeat(1000))
        history = live.since()[1]
        assert np.all(np.abs(wrap(history.euler[:, 2] - euler[2])) <= history.euler_sigma[:, 2])
        errors.append(wrap(history.euler[-1] - euler))
        sigmas.append(history.euler_sigma[-1])
        assert "The heading is relative: these gyros cannot find north" in live.state.reason
    ratio = np.array(errors) / np.array(sigmas)
    rms = np.sqrt(np.mean(ratio**2, axis=0))
    print(name, rms.round(2), np.degrees(sigmas[0]).round(2))
    # 95 % of the root mean squares of 20 seeds lie between 0.69 and 1.31; misalignments count as biases.
    assert (rms[:2] < 1.35).all()
    assert (rms[:2] > 0.4).all()


def test_good_gyros_find_north_and_say_how_well():
    sensors = SensorSuite()
    sensors.update(card("HG9900").settings())
    place = np.array([np.radians(45), 0.0, 0.0])
    ratios = []
    for seed in range(1, 11):
        euler = np.random.default_rng(seed).uniform((-0.4, -0.4, -3), (0.4, 0.4, 3))
        live = LiveNavigator(sensors, NavigatorSettings(), place=place)
        feed(live, standing(sensors, tuple(euler), place[0], 60.0, seed, 50.0), NO_FIXES, repeat(1000))
        state = live.state
        assert state.heading_source == "by gyro-compassing"
        assert state.euler_sigma[2] < np.radians(1.0)
        ratios.append(float(wrap(state.euler[2] - euler[2]) / state.euler_sigma[2]))
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.6
    blind = LiveNavigator(sensors, NavigatorSettings())
    feed(blind, standing(sensors, (0.1, 0.0, 1.0), place[0], 20.0, 1, 50.0), NO_FIXES, repeat(1000))
    assert blind.state.euler_sigma[2] > 0.99 * np.pi  # north needs the latitude


@pytest.mark.parametrize("name", ["BMI088", "ADIS16448"])
def test_sigma_is_honest_after_a_hand_turned_the_sensors(name):
    """Scale factors and misalignments, for which there is no state, must not look like a known bias."""
    sensors = SensorSuite()
    sensors.update(card(name).settings())
    place = np.array([np.radians(45), 0.0, 0.0])
    moving, resting = [], []
    for seed in range(1, 13):
        rows, euler = handled(sensors, place[0], seed)
        live = LiveNavigator(sensors, NavigatorSettings(), place=place)
        for start in range(0, rows.size, 50):
            live.feed(rows[start : start + 50])
            end = start + 49
            if end in {1249, rows.size - 1}:
                ratio = wrap(live.state.euler - euler[end]) / live.state.euler_sigma
                (moving if end == 1249 else resting).append(ratio)
        assert live.state.is_at_rest
    for ratios in (moving, resting):
        rms = np.sqrt(np.mean(np.square(ratios), axis=0))
        print(name, rms.round(2))
        assert (rms < 1.4).all()  # the 97.5 % quantile of 12 seeds is 1.39
        assert (np.abs(ratios)[:, 2] < 1).all()


def test_a_magnetometer_gives_the_heading_without_fixes():
    sensors, heading = SensorSuite(), 1.0
    rows = standing(sensors, (0.0, 0.0, heading), np.radians(45), 15.0, 1, 50.0)
    # Magnetic north is 10° east of north at this declination.
    pointing = heading - np.radians(10)
    rows["magnetic"] = 1e-6 * np.array([20 * np.cos(pointing), -20 * np.sin(pointing), 45])
    live = LiveNavigator(sensors, NavigatorSettings())
    feed(live, rows, NO_FIXES, repeat(50))
    state = live.state
    assert "magnetic north" in state.heading_source
    assert wrap(state.euler[2] - pointing) == pytest.approx(0, abs=np.radians(2))
    assert np.radians(20) < state.euler_sigma[2] < np.radians(24)
    assert abs(wrap(state.euler[2] - heading)) < state.euler_sigma[2]


def test_a_wait_longer_than_the_memory_starts_later():
    """The vehicle stands for longer than samples are kept: the start moves with the oldest ones."""
    imu, fixes, _ = driven()
    wait = 100.0
    count = round(wait * 100)
    before = np.concatenate([imu[:1900]] * 6)[:count]
    standing_fixes = np.concatenate([fixes[:72]] * 6)[: round(wait * 4)]
    rows = np.concatenate((before, imu))
    rows["time"] = rows["arrival"] = HOST + np.arange(1, rows.size + 1) / 100
    fixes["time"] += wait
    known = np.concatenate((standing_fixes, fixes))
    known["time"][: standing_fixes.size] = HOST + 0.1 + 0.25 * np.arange(standing_fixes.size)
    known["arrival"] = known["time"]
    live = navigator(kept=60.0)
    keeper = []
    for start in range(0, rows.size, 100):
        part = rows[start : start + 100]
        due = (known["time"] <= part["time"][-1]) & (known["time"] > part["time"][0] - 0.01)
        live.feed(part, known[due])
        if live.alignment is not None and not keeper:
            keeper.append(live.log())
            run = navigate_log(keeper[0], suite(), NavigatorSettings(vehicle="car"), start=live.alignment)
            mine = live.solution()
            assert mine.time.size == run.imu.time.size < 62 * 100
            assert np.abs(mine.velocity_n - run.solution.velocity_n).max() < TOLERANCE
            assert np.abs(mine.q_nb - run.solution.q_nb).max() < TOLERANCE
    assert keeper[0].epoch > HOST + 55
    assert live.alignment.rest > 50
    assert live.state.phase == "navigating"


def test_after_a_long_outage_it_starts_again(monkeypatch):
    """Without fixes the position is lost; with them the navigator aligns again, from the heading it kept."""
    imu, fixes, trajectory = driven(late=0.0)
    out = (fixes["time"] > HOST + 24) & (fixes["time"] < HOST + 70)
    monkeypatch.setattr(live_navigator, "STOPS_AT", 30.0)  # reached within 46 s instead of minutes
    live = navigator()
    phases = []
    for start in range(0, imu.size, 100):
        part = imu[start : start + 100]
        due = ~out & (fixes["time"] <= part["time"][-1]) & (fixes["time"] > part["time"][0] - 0.01)
        live.feed(part, fixes[due])
        if not phases or phases[-1] != live.state.phase:
            phases.append(live.state.phase)
    assert phases[-1] == "navigating"
    assert "attitude only" in phases[phases.index("coasting") :]
    assert "stopped, since the σ of the position" in " ".join(live.state.remarks)
    true = trajectory.at(np.array([live.state.time - HOST]))
    assert abs(wrap(live.state.euler[2] - true.euler[0, 2])) < 3 * live.state.euler_sigma[2]


def test_a_steady_turn_is_no_gyro_bias():
    imu = standing(SensorSuite(), (0.0, 0.0, 1.0), 0.8, 20.0, 1, 50.0)
    imu["rate"][:, 2] += np.radians(3.0)
    live = LiveNavigator(SensorSuite(), NavigatorSettings())
    feed(live, imu, NO_FIXES, repeat(50))
    assert live.state.phase == "aligning"
    assert "steady rate of 3" in live.state.reason


def test_memory_is_bounded_and_a_history_is_read_once():
    imu, fixes, _ = driven(late=0.2)
    live = navigator(kept=60.0)
    feed(live, imu, fixes, repeat(50))
    assert live.solution().time.size < 62 * 100
    assert live.solution().time[-1] == pytest.approx(imu["time"][-1] - imu["time"][0])
    cursor, first = live.since()
    assert first.time.size > 20 * 60
    assert first.innovation.shape[0] == live.state.fixes_used
    again, nothing = live.since(cursor)
    assert again == cursor
    assert nothing.time.size == nothing.fix_time.size == 0
    assert live.since(HistoryCursor(10, 5))[1].time[0] == first.time[10]
    assert (np.diff(first.time) > 0).all()


def recorded(path: Path, seconds: float) -> Path:
    """Record a simulated flight with a rest before it, as a VectorNav would send it; fixes come late."""
    flight = SimulatedFlight.of("montreal", RATE, seed=3, rest=15.0)
    encoder, writer = ENCODERS["vectornav"](), RawWriter(path, {"protocol": "vectornav"})
    sent = 0
    for end in range(10, int(seconds * RATE), 10):
        rows = flight.imu[end - 10 : end]
        now = float(rows["time"][-1])
        due = int(np.searchsorted(flight.fix["time"], now - 0.15))
        data = encoder.encode(rows, flight.fix[:0])
        data += encoder.encode(rows[:0], flight.fix[sent:due]) if due > sent else b""
        sent = due
        writer.take(Chunk(5000.0 + now, data))
    writer.close()
    return path


def test_following_a_replay_equals_the_batch_on_the_recorded_log(tmp_path):
    path = recorded(tmp_path / "flight.inslab", 80.0)
    live = navigator()
    with lab.live.open(f"replay:{path}?speed=max") as source:
        live.follow(source)
    assert live.state.phase == "navigating"
    settings = NavigatorSettings(vehicle="car")
    assert_equal(live, navigate_log(log_of_recording(path), suite(), settings, start=live.alignment))


def test_other_axes_begin_the_navigation_again():
    flight = SimulatedFlight.of("rest", RATE, rest=40.0)
    imu, _ = flight.timed()
    truth = np.degrees(flight.result.truth_arrays.euler[0])
    device = AxisMap.of("y,-x,z")  # turned by 90° about the vertical
    later = imu["time"] > 20
    imu["rate"][~later] = device.mapped(imu["rate"][~later])
    imu["force"][~later] = device.mapped(imu["force"][~later])
    live = navigator()
    live.feed(imu[~later])
    before = np.degrees(live.state.euler[:2])
    assert np.abs(before - truth[:2]).max() > 3
    live.restart("The axes were changed")
    live.feed(imu[later])
    assert np.abs(np.degrees(live.state.euler[:2]) - truth[:2]).max() < 1
    assert "The axes were changed, so the navigator aligned again." in live.state.remarks


def test_settings_that_a_stream_cannot_use_are_refused():
    for settings in ({"model": "nonlinear"}, {"engine": "filterpy"}):
        with pytest.raises(SettingError, match="accepted for a stream"):
            LiveNavigator(suite(), NavigatorSettings(**settings))


def test_nothing_came():
    live = navigator()
    live.feed(NO_FIXES[:0], NO_FIXES)
    live.finish()
    assert (live.state.phase, live.since()[1].time.size) == ("waiting", 0)
    assert "No sample" in live.state.reason


def test_the_course_of_an_unknown_vehicle_is_compared_first():
    imu, fixes, _ = driven()
    live = navigator(vehicle="auto")
    said = set()
    for start in range(0, 4500, 100):
        part = imu[start : start + 100]
        due = (fixes["time"] <= part["time"][-1]) & (fixes["time"] > part["time"][0] - 0.01)
        live.feed(part, fixes[due])
        if 30 <= live.state.time - HOST < 40:
            said.add(live.state.reason)
            assert live.state.position_sigma[0] == pytest.approx(0.5)  # that of the fix
    assert all("unknown vehicle (navigator.vehicle) is compared" in reason for reason in said)
    assert live.state.phase == "navigating"


def test_states_for_scale_factors_do_not_stop_the_attitude_at_rest() -> None:
    live = LiveNavigator(SensorSuite(), NavigatorSettings(states=21))
    feed(live, standing(SensorSuite(), (0.1, 0.05, 1.0), 0.8, 20.0, 1, 50.0), NO_FIXES, repeat(50))
    assert np.degrees(live.state.euler[:2]) == pytest.approx(np.degrees((0.1, 0.05)), abs=1.0)
