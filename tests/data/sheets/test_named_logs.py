"""Logs of an unknown csv: g in motion is told by the rest and by the fixes; attitudes become the reference.

The drives are closed forms on a plane: a car that stands, then weaves at 30 m/s with up to 0.8 g across.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from lab.missions import MissionError
from lab.missions.flight_import import read_log

GRAVITY = 9.80665
RATE = 25.0


class Drive:
    """Samples at 25 Hz and fixes at 5 Hz of a car."""

    def __init__(self, rest=12.0, duration=110.0, seed=0, gravity=True):
        rng = np.random.default_rng(seed)
        t = np.arange(0.0, duration, 1 / RATE)
        since = np.clip(t - rest, 0.0, None)
        speed = 30.0 * np.clip(since / 10.0, 0.0, 1.0) if rest else np.full_like(t, 30.0)
        turn = 0.27 * np.sin(2 * np.pi * since / 14.0) * (speed > 29)
        heading = 0.6 + cumulative_trapezoid(turn, t, initial=0.0)
        velocity = speed[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
        moved = cumulative_trapezoid(velocity, t, axis=0, initial=0.0)
        ahead = np.gradient(speed, t)
        force = np.column_stack((ahead, speed * turn, np.full_like(t, -GRAVITY if gravity else 0.0)))
        force += 0.03 * rng.standard_normal(force.shape) + [0.05, -0.04, 0.02]
        rate = np.column_stack((0 * t, 0 * t, turn)) + 2e-3 * rng.standard_normal((len(t), 3))
        self.time, self.rate, self.force = t, rate, force
        self.euler = np.column_stack((0 * t, 0 * t, heading))
        some = slice(None, None, 5)
        place = np.column_stack(
            (
                50 + np.degrees(moved[:, 0] / 6.3727e6),
                8 + np.degrees(moved[:, 1] / (6.3907e6 * np.cos(np.radians(50)))),
                np.full_like(t, 200.0),
            )
        )[some]
        noise = rng.standard_normal(place.shape) * [3e-6, 4e-6, 0.5]
        self.fixes = np.column_stack((t[some], place + noise, velocity[some], 0 * t[some]))
        self.fixes[:, 4:] += 0.05 * rng.standard_normal((len(self.fixes), 3))

    def files(self, folder, names="time,gx,gy,gz,ax,ay,az", rate=180 / np.pi, force=1 / GRAVITY, more=None):
        """Write the IMU in some units and the fixes, and return the paths."""
        columns = [self.time, *(rate * self.rate).T, *(force * self.force).T, *(more or {}).values()]
        imu, gps = folder / "imu.csv", folder / "gps.csv"
        for path, head, rows in (
            (imu, ",".join((names, *(more or {}))), np.column_stack(columns)),
            (gps, "time,lat,lon,alt,vel_n,vel_e,vel_d", self.fixes),
        ):
            path.write_text("\n".join((head, *(",".join(f"{x:.10g}" for x in row) for row in rows))))
        return [imu, gps]


NAMES = ("time,gx,gy,gz,ax,ay,az", "t,wx,wy,wz,accX,accY,accZ", "Zeit,Gyroskop x,Gyroskop y,Gyroskop z,"
         "Beschleunigung x,Beschleunigung y,Beschleunigung z")  # fmt: skip


def error_of(log, drive) -> float:
    """Return the rms difference of the specific force from that of the drive [m/s²]."""
    seen = np.column_stack([np.interp(log.time[1:], drive.time, one) for one in drive.force.T])
    return float(np.sqrt(np.mean((log.rates[1] - seen) ** 2)))


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize(("force", "unit"), [(1 / GRAVITY, "g"), (1000 / GRAVITY, "mg"), (1.0, "m/s²")])
def test_the_unit_of_a_lively_drive_is_told_at_rest(tmp_path, names, force, unit):
    drive = Drive()
    log = read_log(drive.files(tmp_path, names, force=force), vehicle="car")
    assert error_of(log, drive) < 0.2
    assert any(f"in {unit} (guessed" in one for one in log.repairs if one.startswith("Accelerometers"))


def test_exchanged_accelerometers_of_a_car_are_named(tmp_path):
    """In turns alone they would be as good as a rotation; the car also gathers speed.

    Mirrored ones, and what mends them, are in `tests/data/checks/test_gyro_check.py`.
    """
    drive = Drive()
    drive.force = drive.force[:, [1, 0, 2]]
    with pytest.raises(MissionError, match="axes"):
        read_log(drive.files(tmp_path), vehicle="car")


@pytest.mark.parametrize("rate", [1.0, 180 / np.pi])
@pytest.mark.parametrize("seed", range(3))
def test_without_a_rest_the_fixes_bear_g_out(tmp_path, rate, seed):
    drive = Drive(rest=0.0, seed=seed)
    log = read_log(drive.files(tmp_path, rate=rate), vehicle="car")
    assert error_of(log, drive) < 0.2


@pytest.mark.parametrize("rest", [0.0, 12.0])
@pytest.mark.parametrize("force", [1.0, 0.2])
def test_accelerations_without_gravity_are_refused_and_g_is_offered(tmp_path, rest, force):
    drive = Drive(rest=rest, gravity=False)
    with pytest.raises(MissionError, match=r'without gravity.*--unit "ax=g"'):
        read_log(drive.files(tmp_path, force=force), vehicle="car")


FRAMES = {
    "roll,pitch,yaw": np.degrees,
    "Roll (rad),Pitch (rad),Heading (rad)": lambda e: e,
}


@pytest.mark.parametrize("names", FRAMES)
def test_an_attitude_whose_rates_are_the_gyros_is_the_reference_of_the_log(tmp_path, names):
    drive = Drive()
    more = dict(zip(names.split(","), FRAMES[names](drive.euler).T, strict=True))
    log = read_log(drive.files(tmp_path, force=1.0, more=more), vehicle="car")
    assert log.reference is not None and np.isnan(log.reference.position).all()
    seen = np.interp(log.reference.time, drive.time - drive.time[0], drive.euler[:, 2])
    assert np.abs(np.sin(log.reference.euler[:, 2] - seen)).max() < 0.02
    assert any("the reference of the log" in one for one in log.repairs)


def test_an_attitude_of_another_body_is_no_reference_and_said(tmp_path):
    drive = Drive()
    rng = np.random.default_rng(2)
    swing = np.cumsum(rng.standard_normal((len(drive.time), 3)), axis=0) * 0.05
    more = dict(zip(("roll", "pitch", "yaw"), np.degrees(drive.euler + swing).T, strict=True))
    log = read_log(drive.files(tmp_path, force=1.0, more=more), vehicle="car")
    assert log.reference is None
    assert any("not used" in one and "roll, pitch, yaw" in one for one in log.repairs)


def test_columns_that_a_log_does_not_use_are_listed(tmp_path):
    drive = Drive()
    more = {"battery": drive.time, "tyre 1": drive.time}
    log = read_log(drive.files(tmp_path, force=1.0, more=more), vehicle="car")
    (said,) = [one for one in log.repairs if one.startswith("Columns not read")]
    assert said == "Columns not read: battery, tyre 1."
