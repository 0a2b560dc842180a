"""Recorded logs: the start is found, fixes are brought to the IMU, real recordings meet their reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sensor_logs import LATENCY, POSITION, described, tables, write, write_csv

from lab.analysis.fix_causes import CAUSES
from lab.analysis.verdicts.evidence import evidence
from lab.data.log.sensor_log import GnssLog, SensorLog, repair_log
from lab.missions import read_sensor_log
from lab.motion.frames import earth
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_quaternion, wrap
from lab.navigation.alignment.alignment import EXACT, align, level
from lab.navigation.log_navigation import RecordedRun, navigate_log
from lab.navigation.navigator import navigate
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Fixes, Imu
from lab.sensors.suite import SensorSuite


def suite(bias: float = 0.3, velocity_variance: float = 0.01) -> SensorSuite:
    sensors = SensorSuite()
    sensors.gyro.bias_sigma = (bias,) * 3
    sensors.accelerometer.bias_sigma = (5.0,) * 3
    sensors.gps.velocity_variance = (velocity_variance,) * 3
    return sensors


def run(folder: Path, sensors: SensorSuite | None = None) -> tuple[SensorLog, RecordedRun]:
    log = read_sensor_log(folder)
    return log, navigate_log(log, sensors or suite(), NavigatorSettings())


def misses(log: SensorLog, run: RecordedRun, after: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of position, north, east, down [m], and attitude [°], from a time on."""
    reference, time = log.reference, run.imu.time
    rows = (reference.time > time[0] + after) & (reference.time < time[-1])
    at = reference.time[rows]
    position = np.stack([np.interp(at, time, column) for column in run.solution.position.T], axis=-1)
    meridian, transverse = earth.radii(np.sin(position[:, 0]))
    difference = position - reference.position[rows]
    height = position[:, 2]
    north, east = difference[:, 0] * (meridian + height), difference[:, 1] * (transverse + height)
    ned = np.stack((north, east * np.cos(position[:, 0]), -difference[:, 2]), axis=-1)
    euler = euler_from_quaternion(run.solution.q_nb)[np.searchsorted(time, at)]
    return ned, np.degrees(wrap(euler - reference.euler[rows]))


def test_levelling_inverts_the_rotation_of_the_force():
    rng = np.random.default_rng(1)
    for _ in range(50):
        euler = rng.uniform((-1, -1, -3), (1, 1, 3))
        felt = rng.normal(scale=1.0, size=3) - (0, 0, 9.8)
        roll, pitch = level(C_nb_from_euler(euler).T @ felt, felt, euler[2])
        np.testing.assert_allclose((roll, pitch), euler[:2], atol=1e-12)


def at_rest(latitude: float, euler: np.ndarray, bias: np.ndarray) -> SensorLog:
    """Return a log at rest of exact sensors with a gyro bias, irregularly sampled."""
    time = np.sort(np.random.default_rng(2).uniform(0, 20, 2000))
    C_bn = C_nb_from_euler(euler).T
    turning = C_bn @ (earth.RATE * np.array([np.cos(latitude), 0, -np.sin(latitude)])) + bias
    force = C_bn @ (0, 0, -float(earth.gravity(np.sin(latitude), 50.0)))
    jitter = 1e-9 * np.random.default_rng(3).normal(size=(2000, 6))
    samples = np.concatenate((turning, force)) + jitter
    fixes = np.arange(-1.0, 20.0)
    gnss = GnssLog(
        fixes, np.tile((latitude, 0.3, 50.0), (21, 1)), np.zeros((21, 3)), np.full((21, 3), 1.0),
        np.full((21, 3), 0.1), np.zeros(3), 0.0,
    )  # fmt: skip
    return repair_log("rest", time, samples, gnss)


@pytest.mark.parametrize("latitude", [-0.6, 0.0, 0.9])
def test_start_at_rest(latitude):
    euler, bias = np.array([0.2, -0.1, 0.0]), np.radians([1.0, -2.0, 3.0])
    log = at_rest(latitude, euler, bias)
    imu, gnss = Imu(log.time, log.dtheta, log.dvelocity), log.gnss
    found = align(imu, Fixes(gnss.time, gnss.position, gnss.velocity_n), gnss.velocity_sigma)
    assert found.rest >= 18
    np.testing.assert_allclose(euler_from_quaternion(found.start.q_nb)[:2], euler[:2], atol=1e-7)
    # Without a heading, the horizontal part of the Earth's rate counts as bias.
    assert np.abs(found.gyro_bias - bias).max() < 1.01 * earth.RATE
    assert (np.abs(found.gyro_bias - bias) <= 3 * found.gyro_bias_sigma).all()
    assert found.attitude_sigma[2] == np.pi
    assert "heading is unknown" in found.remark


def test_piece_by_piece_is_the_very_filter(tmp_path):
    """Without lever arm and gaps, and with one R for all fixes, the run is that of `navigate`."""
    log, made = run(write(tmp_path, tables(60, 80)))
    R = np.diag((0.25, 0.25, 0.25, 0.01, 0.01, 0.01))
    np.testing.assert_allclose(log.gnss.position_sigma, 0.5)
    state = made.alignment.gyro_bias
    imu = made.imu
    whole = navigate(
        Imu(imu.time, imu.dtheta - state * np.diff(imu.time)[:, None], imu.dvelocity),
        made.fixes,
        made.alignment.start,
        made.belief._replace(R=R),
    )
    np.testing.assert_allclose(made.solution.position, whole.position, rtol=1e-11)
    np.testing.assert_allclose(made.solution.variance, whole.variance, rtol=1e-6)
    np.testing.assert_array_equal(made.solution.fix_sample, whole.fix_sample)


def test_simulated_log_in_flight(tmp_path):
    log, made = run(write(tmp_path, tables(60, 160)))
    position, attitude = misses(log, made, after=30)
    assert (position.std(axis=0) < 0.5).all()
    assert np.abs(position.mean(axis=0)).max() < 0.3
    assert np.abs(attitude[:, :2]).max() < 1.0
    assert np.abs(attitude[:, 2]).max() < 4.0
    assert "Levelled in motion" in made.remarks[-1]


def test_lever_arm_is_taken_off_with_the_attitude(tmp_path):
    arm = (4.0, -3.0, -2.0)
    flown = tables(60, 160, lever_arm=arm)
    told, untold = (
        np.linalg.norm(misses(*run(write(tmp_path / name, flown, toml)), after=30)[0], axis=1).mean()
        for name, toml in (("told", f"lever_arm_m = {list(arm)}"), ("untold", ""))
    )
    assert told < 0.6
    assert untold > 3.0


def test_latency_is_taken_off(tmp_path):
    flown = tables(60, 100)
    late = flown.gnss.copy()
    late[:, 0] += 0.35
    _, expected = run(write(tmp_path / "prompt", flown))
    _, made = run(write(tmp_path / "late", flown._replace(gnss=late), "latency_s = 0.35"))
    np.testing.assert_allclose(made.solution.position, expected.solution.position, rtol=1e-10)


def test_what_the_receiver_lacks_counts_for_nothing(tmp_path):
    flown = tables(60, 120)
    write(tmp_path, flown)
    write_csv(tmp_path / "gnss.csv", (*POSITION, "vn_m_s", "ve_m_s"), flown.gnss[:, :6])
    log, made = run(tmp_path)
    assert np.isnan(made.solution.innovation[:, 5]).all()
    assert np.isfinite(made.solution.innovation[:, :5]).all()
    position, _ = misses(log, made, after=20)
    assert (position.std(axis=0) < 0.7).all()
    write_csv(tmp_path / "gnss.csv", POSITION, flown.gnss[:, :4])
    log, made = run(tmp_path)
    assert np.isnan(made.solution.innovation[:, 3:]).all()


def test_a_gap_costs_certainty_and_is_recovered(tmp_path):
    flown = tables(60, 120)
    rows = (flown.imu[:, 0] > 1090.2) & (flown.imu[:, 0] < 1091.9)
    log, made = run(write(tmp_path / "gap", flown._replace(imu=flown.imu[~rows])))
    _, whole = run(write(tmp_path / "whole", flown))
    during = np.searchsorted(made.imu.time + log.epoch, 1091.4)
    assert made.solution.variance[during, 3] > 3 * whole.solution.variance[during, 3]
    position, _ = misses(log, made, after=40)
    assert np.abs(position.mean(axis=0)).max() < 0.6


def printed(name: str, position: np.ndarray, attitude: np.ndarray, made: RecordedRun) -> None:
    print(f"\n{name}: {'; '.join(made.remarks)}")
    print(f"  position north, east, down: mean {position.mean(axis=0).round(2)} m, "
          f"std {position.std(axis=0).round(2)} m")  # fmt: skip
    if np.isfinite(attitude).all():
        print(f"  roll, pitch, heading: mean {attitude.mean(axis=0).round(2)}°, "
              f"std {attitude.std(axis=0).round(2)}°")  # fmt: skip
    print(f"  gyro bias {np.degrees(made.solution.bias[-1, :3]).round(2)} °/s")


def test_comma2k19(recordings, tmp_path):
    log, made = run(described(tmp_path / "log", recordings / "comma2k19"))
    position, attitude = misses(log, made, after=0)
    printed("comma2k19, the whole drive", position, attitude, made)
    assert (position.std(axis=0) <= (0.3, 0.3, 1.0)).all()
    assert (attitude.std(axis=0)[:2] <= 0.4).all()
    np.testing.assert_allclose(np.degrees(made.solution.bias[-1, :3]), (-0.60, -2.05, 3.90), atol=0.3)


def test_latency_of_comma2k19_shows_without_the_reference(recordings):
    """The stamps are early: seen by IMU and fixes alone, with the variances of a u-blox receiver."""
    sensors = suite()
    sensors.gps.position_variance = (0.05,) * 3
    _, made = run(recordings / "comma2k19", sensors)
    seen = evidence(made.solution, made.belief, made.fixes, made.imu).innovations.causes
    receiver = slice(0, CAUSES)  # latency and lever arm
    covariance = np.linalg.inv(seen.matrix[receiver, receiver])
    latency, sigma = (covariance @ seen.vector[receiver])[0], np.sqrt(covariance[0, 0])
    print(f"\ncomma2k19: latency of the stamps by the innovations {latency:.3f} ± {sigma:.3f} s")
    assert sigma < 0.02
    assert abs(latency - LATENCY["comma2k19"]) < 0.02


def test_vn310_static(recordings, tmp_path):
    log, made = run(described(tmp_path / "log", recordings / "vn310_static"))
    position, attitude = misses(log, made, after=0)
    printed("vn310_static", position, attitude, made)
    assert np.abs(attitude[:, :2]).max() < 1.0
    assert (np.abs(position).max(axis=0) < (2.5, 1.2, 2.0)).all()


def test_rtkx_walk(recordings, tmp_path):
    log, made = run(described(tmp_path / "log", recordings / "rtkx_walk"))
    position, attitude = misses(log, made, after=0)
    printed("rtkx_walk", position, attitude, made)
    assert np.isfinite(made.solution.position).all()
    assert (position.std(axis=0) < 0.5).all()


def test_the_gyro_bias_of_a_rest_is_as_uncertain_as_the_noise_makes_it():
    """σ of the bias at the start, against the errors of 40 rests of 15 s with three densities."""
    rng = np.random.default_rng(5)
    rate, seconds, latitude = 100.0, 15.0, np.radians(45.0)
    count = int(rate * seconds)
    fixes = Fixes(
        np.arange(0.0, seconds + 5.5, 1.0), np.tile((latitude, 0.1, 50.0), (21, 1)), np.zeros((21, 3))
    )
    time = np.arange(count + int(5 * rate) + 1) / rate
    for density in np.radians((0.002, 0.05, 0.2)):  # [rad/s/√Hz]
        ratios = []
        for _ in range(40):
            bias = rng.normal(scale=np.radians(0.3), size=3)
            earth_rate = earth.RATE * np.array((np.cos(latitude), 0.0, -np.sin(latitude)))
            noise = rng.normal(scale=density / np.sqrt(rate), size=(time.size - 1, 3)) / rate
            dtheta = (bias + earth_rate) / rate + noise
            dvelocity = np.tile((0.0, 0.0, -earth.gravity(np.sin(latitude), 50.0) / rate), (time.size - 1, 1))
            found = align(
                Imu(time, dtheta, dvelocity),
                fixes,
                np.full((21, 3), 0.1),
                assumed=EXACT._replace(noise=np.repeat((density**2, 0.0), (3, 9))),
            )
            assert found.rest >= seconds
            ratios.append((found.gyro_bias - bias) / found.gyro_bias_sigma)
        assert np.sqrt(np.mean(np.square(ratios))) < 1.25


def test_a_rest_is_one_although_the_receiver_wanders():
    """Velocities with σ 0.45 m/s at rest are often faster than 0.5 m/s."""
    rng = np.random.default_rng(8)
    time = np.arange(3001) / 100
    dtheta = rng.normal(scale=1e-5, size=(3000, 3))
    dvelocity = np.tile((0.0, 0.0, -9.81 / 100), (3000, 1)) + rng.normal(scale=1e-4, size=(3000, 3))
    dvelocity[2000:, 0] += 1.5 / 100  # it drives off
    found = []
    for _ in range(20):
        velocity = rng.normal(scale=0.45, size=(30, 3))
        fixes = Fixes(np.arange(30.0) + 0.5, np.tile((0.8, 0.1, 50.0), (30, 1)), velocity)
        found.append(align(Imu(time, dtheta, dvelocity), fixes, np.full((30, 3), 0.45)).rest)
    assert np.mean(np.array(found) == 20) > 0.8
    fixes.velocity_n[:, 0] += 3.0
    assert align(Imu(time, dtheta, dvelocity), fixes, np.full((30, 3), 0.45)).rest < 5
