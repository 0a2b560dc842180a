"""Units of phones' gyros, by the app and by the motion: degrees for radians are wrong by a factor of 57."""

from __future__ import annotations

import numpy as np
import pytest
from foreign_tables import phone, table
from phone_drive import drive
from test_sensor_logger import export, metadata

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.log_check import check_log
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.missions import MissionError
from lab.missions.flight_import import read_log


def made():
    """Return the drive as IMU and GPS in the columns of the other tests."""
    one = drive()
    gnss = np.column_stack((one.at, one.position, one.velocity))
    return np.column_stack((one.time, one.rate, one.force)), gnss


def same_rates(log, tolerance=0.05):
    """Check the gyros against the truth: ratio of the turns, and the axis called down."""
    one = drive()
    seen = np.interp(log.time[1:] + log.epoch, one.time, one.rate[:, 2])
    assert np.polyfit(seen, log.rates[0][:, 2], 1)[0] == pytest.approx(1, abs=tolerance)


def written(folder, one, rate, unit):
    """Write a drive as a sensor log with these rates (n, 3), in a column of this unit, and read it."""
    rows = [[t, *w, *f] for t, w, f in zip(one.time, rate, one.force, strict=True)]
    fixes = [
        [t, *p, *v, 2, 2, 3, 0.2, 0.2]
        for t, p, v in zip(one.at, one.position, one.velocity, strict=True)
    ]  # fmt: skip
    names = ",".join(f"g{axis}_{unit}" for axis in "xyz")
    table(folder / "imu.csv", f"t_s,{names},fx_m_s2,fy_m_s2,fz_m_s2", rows)
    header = "t_s,lat_deg,lon_deg,alt_m,vn_m_s,ve_m_s,sd_n_m,sd_e_m,sd_d_m,sd_vn_m_s,sd_ve_m_s"
    table(folder / "gnss.csv", header, fixes)
    (folder / "log.toml").write_text('vehicle = "car"\n')
    return read_sensor_log(folder)


@pytest.mark.parametrize("seed", range(1, 9))
def test_gyros_57_times_too_slow_are_found_on_a_drive(tmp_path, seed):
    """Velocities at 1 Hz leave room for a bias of 2 °/s, which explains a turn; the course shows the unit."""
    one = drive(seed)
    with pytest.raises(MissionError, match="radians where degrees"):
        check_log(written(tmp_path, one, one.rate, "deg_s"))


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 4))
def test_an_axis_that_is_not_quite_level_shows_no_other_unit(tmp_path, seed):
    """It follows the course as well as the vertical one, 50 times as slowly."""
    one = drive(seed)
    rate = one.rate.copy()
    rate[:, 2] += np.random.default_rng(seed).normal(0, 1e-3, one.time.size)
    rate[:, 0], rate[:, 1] = 0.01 * one.rate[:, 2], 0.02 * one.rate[:, 2]
    check_log(written(tmp_path, one, rate, "rad_s"))


def test_sensor_logger_writes_gyros_in_radians_beside_accelerations_in_g(tmp_path):
    imu, gnss = made()
    imu[:, 0] += 1000
    gnss[:, 0] += 1000
    folder = export(tmp_path / "phone", (imu, gnss), -1, uncalibrated=STANDARD_GRAVITY)
    (folder / "Accelerometer.csv").unlink()
    metadata(folder, "ios")
    log = read_log([folder], vehicle="car")
    assert "in rad/s (as Sensor Logger writes)" in " ".join(log.repairs)


def toolbox(path, seed=1):
    """Write a table of Physics Toolbox, which has a speed and no course."""
    one = drive(seed)
    latest = np.clip(np.searchsorted(one.at, one.time, side="right") - 1, 0, None)
    rows = [
        [t, *f, *w, *one.position[k], one.speed[k]]
        for t, f, w, k in zip(
            one.time, phone(one.force) / STANDARD_GRAVITY, phone(one.rate), latest, strict=True
        )
    ]  # fmt: skip
    header = "time,gFx,gFy,gFz,wx,wy,wz,Latitude,Longitude,Altitude (m),Speed (m/s)"
    return table(path, header, rows)


def test_physics_toolbox_writes_gyros_in_radians_beside_accelerations_in_g(tmp_path):
    log = read_log([toolbox(tmp_path / "toolbox.csv")], vehicle="car")
    assert "in rad/s (as Physics Toolbox writes)" in " ".join(log.repairs)
    same_rates(log)


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_speed_without_a_course_shows_the_axes_and_is_no_velocity(tmp_path, seed):
    """The speed changes as the phone's y says; x, which is first for other loggers, would be 90° off."""
    log = read_log([toolbox(tmp_path / "toolbox.csv", seed)], vehicle="car")
    said = " ".join(log.repairs)
    assert "forward is y, right is x, down is -z of the IMU: gravity and the motion show them" in said
    assert "The GPS has no velocity" in said and not np.isfinite(log.gnss.velocity_n).any()
