"""The navigator without fixes: its σ is honest, and it says what it cannot know."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from live_batch import NO_FIXES, navigator
from live_rows import HOST, driven, feed, handled, standing

from lab.live.live_navigator import LiveNavigator
from lab.motion.frames.rotation import wrap
from lab.navigation.settings import NavigatorSettings
from lab.sensors.cards import card
from lab.sensors.suite import SensorSuite


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


@pytest.mark.proof
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


@pytest.mark.proof
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


@pytest.mark.proof
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


def test_sigma_is_honest_after_samples_were_lost_in_a_turn():
    """The motion in a filled gap is unknown: σ of the attitude holds the error that filling makes."""
    sensors = SensorSuite()
    sensors.update(card("BMI088").settings())
    place = np.array([np.radians(45), 0.0, 0.0])
    ratios = []
    for seed in range(1, 13):
        rows, euler = handled(sensors, place[0], seed)
        lost = np.arange(1000, 1080)  # 1.6 s
        live = LiveNavigator(sensors, NavigatorSettings(), place=place)
        feed(live, np.delete(rows[:1100], lost), NO_FIXES, repeat(50))
        assert live.state.rows.gaps == 1
        ratios.append(wrap(live.state.euler - euler[1099]) / live.state.euler_sigma)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    print(rms.round(2))
    assert (rms < 1.4).all()  # the 97.5 % quantile of 12 seeds is 1.39


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


def test_a_steady_turn_is_no_gyro_bias():
    imu = standing(SensorSuite(), (0.0, 0.0, 1.0), 0.8, 20.0, 1, 50.0)
    imu["rate"][:, 2] += np.radians(3.0)
    live = LiveNavigator(SensorSuite(), NavigatorSettings())
    feed(live, imu, NO_FIXES, repeat(50))
    assert live.state.phase == "aligning"
    assert "steady rate of 3" in live.state.reason


def test_states_for_scale_factors_do_not_stop_the_attitude_at_rest() -> None:
    live = LiveNavigator(SensorSuite(), NavigatorSettings(states=21))
    feed(live, standing(SensorSuite(), (0.1, 0.05, 1.0), 0.8, 20.0, 1, 50.0), NO_FIXES, repeat(50))
    assert np.degrees(live.state.euler[:2]) == pytest.approx(np.degrees((0.1, 0.05)), abs=1.0)
