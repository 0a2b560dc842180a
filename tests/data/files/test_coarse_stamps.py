"""Time stamps of recorders that are coarser than the samples, or jitter by more than their interval."""

from __future__ import annotations

import numpy as np
import pytest
from foreign_tables import table

from lab.data.clock.coarse_stamps import distribute_stamps, smooth
from lab.missions import MissionError
from lab.missions.flight_import import read_log

IMU = "time,gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s],acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]"
PLACE = "time,latitude,longitude,altitude,vel_n [m/s],vel_e [m/s]"


@pytest.mark.parametrize("rate", [104.0, 250.0, 999.0, 2000.0])
@pytest.mark.parametrize("step", [0.01, 0.1, 1.0])
def test_truncated_stamps_are_spread(rate, step):
    true = 1000.3 + np.arange(0, 20, 1 / rate)
    time, note = distribute_stamps(np.floor(true / step) * step, np.arange(true.size)[:, None])
    assert np.abs(time - true).max() < 1.1 / rate
    assert np.diff(time).min() > 0.5 * step / np.ceil(step * rate + 1)
    assert "truncated" in note


@pytest.mark.parametrize("size", [2, 10, 32])
def test_batches_are_spread_before_their_stamp_and_gaps_stay(size):
    true = np.arange(50 * size) * 0.01
    true[30 * size :] += 7.0
    stamps = np.repeat(true[size - 1 :: size], size)
    time, note = distribute_stamps(stamps, np.arange(true.size)[:, None])
    np.testing.assert_allclose(time, true, atol=1e-9)
    assert "batch" in note


def test_rows_of_other_sensors_and_rows_that_are_written_twice_are_no_batch():
    true = np.repeat(np.arange(100) * 0.1, 2)
    key = np.repeat(np.arange(100.0), 2)
    assert distribute_stamps(true, key[:, None])[1] == ""
    key[1::2] = np.nan
    assert distribute_stamps(true, key[:, None])[1] == ""


def test_a_moving_average_takes_the_jitter():
    true = np.arange(3000) * 0.01
    jitter = np.random.default_rng(1).normal(scale=0.02, size=true.size)
    even = smooth(true + jitter)
    assert (np.diff(even) > 0).all()
    # Averages of 101 stamps have σ = 20 ms / sqrt(101); at the ends, of 51 on one side, twice that.
    assert np.std(even - true) < 1.5 * 0.02 / np.sqrt(101)
    assert np.abs(even - true).max() < 0.02


def summed(log):
    """Return integrals of all samples up to the end of each second."""
    whole = np.vstack((np.zeros(6), np.cumsum(np.hstack((log.dtheta, log.dvelocity)), axis=0)))
    at = np.arange(3.0, 55.0)
    return np.stack([np.interp(at - log.epoch + 1030, log.time, column) for column in whole.T], axis=-1)


def written(folder, made, stamp, fix_stamp=float):
    imu, gnss = made
    rows = [[stamp(i, t), *row] for i, (t, row) in enumerate(zip(imu[:, 0], imu[:, 1:], strict=True))]
    fixes = [[fix_stamp(t), *row] for t, row in zip(gnss[:, 0], gnss[:, 1:6], strict=True)]
    return [table(folder / "a.csv", IMU, rows), table(folder / "b.csv", PLACE, fixes)]


@pytest.mark.proof
def test_no_sample_is_lost_that_has_the_stamp_of_another(tmp_path, made, expected):
    """A log in whole seconds turns and accelerates as the original does."""
    log = read_log(
        written(tmp_path, made, lambda _, t: float(np.floor(t + 1e-9)), lambda t: float(np.floor(t)))
    )
    truth = summed(expected)
    assert len(log.gnss.time) == len(expected.gnss.time)
    # One sample at either end of a second: 10 ms.
    np.testing.assert_allclose(np.diff(summed(log), axis=0), np.diff(truth, axis=0), atol=0.02 * 10)
    np.testing.assert_allclose(summed(log)[-1] - summed(log)[0], truth[-1] - truth[0], atol=0.02 * 10)
    assert any("spread evenly" in remark for remark in log.repairs)


def test_stamps_that_jitter_keep_the_order_of_the_rows(tmp_path, made, expected):
    jitter = np.random.default_rng(1).normal(scale=0.02, size=len(made[0]))
    log = read_log(written(tmp_path, made, lambda i, t: t + jitter[i]))
    assert len(log.dtheta) == len(expected.dtheta)
    np.testing.assert_allclose(
        log.dtheta[100:-100], expected.dtheta[100:-100], atol=0.2 * np.abs(expected.dtheta).max()
    )
    assert any("jitter" in remark for remark in log.repairs)


def test_a_clock_that_was_set_back_is_refused(tmp_path, made):
    paths = written(tmp_path, made, lambda _, t: t - 5 * (t > 1060), lambda t: t - 5 * (t > 1060))
    with pytest.raises(MissionError, match="runs backwards, from 1060 s to 1055"):
        read_log(paths)
