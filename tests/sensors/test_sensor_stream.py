"""Sensors piece by piece: the pieces joined are what one piece gives, and what the batch gives."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from live_rows import drive

from lab.motion.truth.growing_trajectory import FlownPiece
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import gps, imu
from lab.sensors.draws import DrawStream, unit_draws
from lab.sensors.imu_draws import ImuDrawStream
from lab.sensors.processes import Flicker, flicker
from lab.sensors.sensor_stream import Sensed, SensorStream
from lab.sensors.suite import SensorSuite
from lab.sensors.temperature import temperature, thermometer

RATE = 100.0
SEED = 5


@cache
def flown() -> Trajectory:
    return drive(60.0)


def suite(*, with_flicker: bool = False) -> SensorSuite:
    """Return sensors with every error that has a past, and the others."""
    sensors = SensorSuite()
    for triad in (sensors.gyro, sensors.accelerometer):
        triad.update(
            {
                "instability": (50.0, 80.0, 20.0) if triad is sensors.gyro else (1.0, 2.0, 0.5),
                "correlation_time": 20.0,
                "rate_random_walk": 40.0,
                "scale_factor_sigma": 0.3,
                "bias_temperature": 0.001,
                "scale_temperature": 0.01,
                "bandwidth": (20.0, 0.0, 35.0),
                "quantisation": 0.01,
                "flicker": 5.0 if with_flicker else 0.0,
            }
        )
    sensors.gyro.g_sensitivity = (0.01, 0.02, 0.03)
    sensors.accelerometer.vibration_density = (500.0, 300.0, 700.0)
    sensors.temperature.update(
        {"profile": "warm_up", "compensation": True, "thermometer_sigma": 0.2, "warm_up_time": 30.0}
    )
    sensors.gps.update(
        {
            "correlated_sigma": 2.0,
            "correlation_time": 10.0,
            "period": 0.25,
            "latency": 0.12,
            "lever_arm": (2.0, 0.5, -1.0),
            "outlier_rate": 0.1,
            "outages": [(20.0, 24.0)],
            "quality_steps": [(40.0, 44.0)],
        }
    )
    return sensors


def in_pieces(sensors: SensorSuite, ends: list[int]) -> Sensed:
    """Return what sensors measure on the drive in pieces that end at some knots."""
    stream = SensorStream(sensors, SEED, RATE)
    whole = len(flown().time) - 1
    parts = [
        stream.sensed(FlownPiece(flown(), 0, begin, end))
        for begin, end in zip([0, *ends], [*ends, whole], strict=True)
    ]
    triads = [
        imu.Measured(
            *(
                np.concatenate([getattr(getattr(part, name), column) for part in parts])
                for column in ("increments", "bias", "scale")
            ),
            saturated=sum(getattr(part, name).saturated for part in parts),
        )
        for name in ("gyro", "accelerometer")
    ]
    fixes = gps.GpsFixes(*(np.concatenate(column) for column in zip(*(p.fixes for p in parts), strict=True)))
    return Sensed(np.concatenate([part.time for part in parts]), *triads, fixes)


def in_one(sensors: SensorSuite) -> tuple[imu.Measured, imu.Measured, gps.GpsFixes]:
    """Return what a batch simulates, composed of the models one by one."""
    trajectory = flown()
    ideal = trajectory.increments(RATE)
    dt, n = ideal.dt, len(ideal.dtheta)
    height = trajectory.at(ideal.time).height
    there = temperature(sensors.temperature, ideal.time[1:], height[1:] - height[0])
    shaken = imu.with_vibration(sensors.accelerometer, SEED, ideal.dvelocity, dt)
    read = thermometer(sensors.temperature, SEED, there)
    found = []
    for name, errors, true in (
        ("gyro", sensors.gyro, ideal.dtheta),
        ("accelerometer", sensors.accelerometer, shaken),
    ):
        draws = imu.ImuDraws.of(SEED, name, n, instability=True, flicker=any(errors.flicker), walk=True)
        measured = imu.measure(true, dt, errors, draws, imu.Environment(there, shaken))
        found.append(imu.compensate(measured, dt, errors, there, read))
    times = gps.fix_times(sensors.gps, trajectory.duration)
    seen = gps.antenna(trajectory, sensors.gps, times)
    draws = gps.GpsDraws.of(SEED, times.size)
    return found[0], found[1], gps.measure(trajectory.at(times), sensors.gps, draws, seen)


CUTS = [
    [],
    [1, 2, 3, 700, 701, 2000, 5999],
    np.random.default_rng(3).choice(np.arange(1, 6000), 60, replace=False).tolist(),
]


@pytest.mark.proof
@pytest.mark.parametrize("ends", CUTS, ids=["one", "few", "many"])
def test_pieces_are_the_batch_bit_for_bit(ends: list[int]) -> None:
    found = in_pieces(suite(), sorted(ends))
    gyro, accelerometer, fixes = in_one(suite())
    for mine, batch in ((found.gyro, gyro), (found.accelerometer, accelerometer)):
        assert mine.saturated == batch.saturated
        for column in ("increments", "bias", "scale"):
            assert np.array_equal(getattr(mine, column), getattr(batch, column)), column
    assert np.array_equal(found.time, flown().increments(RATE).time[1:])
    for name in gps.GpsFixes._fields:
        assert np.array_equal(getattr(found.fixes, name), getattr(fixes, name)), name


@pytest.mark.proof
def test_pieces_with_flicker_are_the_batch_to_a_millionth() -> None:
    sensors = suite(with_flicker=True)
    for triad in (sensors.gyro, sensors.accelerometer):
        triad.quantisation = (0.0, 0.0, 0.0)  # which would make a step of a last digit
    found, (gyro, accelerometer, _) = in_pieces(sensors, sorted(CUTS[2])), in_one(sensors)
    without = in_one(suite())[0].bias
    size = np.abs(gyro.bias - without).max()
    assert size > 1e-6  # rad/s: the flicker is there
    assert np.abs(found.gyro.bias - gyro.bias).max() < 1e-6 * size
    assert np.abs(found.accelerometer.increments - accelerometer.increments).max() < 1e-9


def test_draws_in_pieces_are_those_of_one_piece() -> None:
    stream = DrawStream(7)
    parts = [stream.following("one", (n, 3)) for n in (1, 0, 5, 64)]
    other = unit_draws(stream, "two", (4,))
    assert np.array_equal(np.concatenate(parts), unit_draws(7, "one", (70, 3)))
    assert np.array_equal(other, unit_draws(7, "two", (4,)))


def test_the_constants_of_a_triad_are_drawn_once() -> None:
    stream = ImuDrawStream(3, "gyro", instability=False, flicker=False, walk=False)
    first, second = stream.following(3), stream.following(2)
    assert np.array_equal(first.bias, second.bias)
    assert np.array_equal(first.scale, unit_draws(3, "gyro.scale_factor", (3,)))
    assert not np.array_equal(first.noise[:2], second.noise)


def test_flicker_in_pieces_is_half_a_sum() -> None:
    """Applied twice, (1 − z⁻¹)^(−1/2) is the sum; its pieces are those of the convolution."""
    draws = unit_draws(2, "flicker", (30_000, 3))
    once, twice = Flicker(), Flicker()
    parts = [twice.following(once.following(part)) for part in np.array_split(draws, 777)]
    total = np.cumsum(draws, axis=0)
    assert np.abs(np.concatenate(parts) - total).max() < 2e-6 * np.abs(total).max()
    alone = Flicker().following(draws)
    assert np.abs(alone - flicker(draws)).max() < 1e-6 * np.abs(alone).max()


def test_a_break_ends_the_lag_but_not_the_drift() -> None:
    """A constant force is measured without a transient from the motion before the break."""
    sensors = SensorSuite()
    for triad in (sensors.gyro, sensors.accelerometer):
        triad.update({"noise_density": 0.0, "bias_sigma": 0.0})
    sensors.accelerometer.bandwidth = (0.5, 0.5, 0.5)
    ideal = flown().increments(RATE)
    moving, still = (2300, 2400), (5500, 5600)  # speeding up, and at rest again
    sensed = {}
    for broken in (False, True):
        stream = SensorStream(sensors, SEED, RATE)
        stream.sensed(FlownPiece(flown(), 0, *moving))
        if broken:
            stream.break_off()
        sensed[broken] = stream.sensed(FlownPiece(flown(), 0, *still)).accelerometer.increments
    off = {broken: np.abs(found[0] - ideal.dvelocity[still[0]]).max() for broken, found in sensed.items()}
    assert off[True] < 1e-6
    assert off[False] > 1e-3
