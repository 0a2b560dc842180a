"""Csv files of rocket loggers: the motion of a rocket in closed form, written as the loggers write it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.data.formats import read_raw
from lab.missions.flight_import import read_log

GRAVITY = 9.80665
NORTH, EAST = np.radians(32.99), np.radians(-106.97)
PAD = 1400.0


class Flight:
    """A rocket that stands on its pad, is launched with a lean of 5°, rolls, coasts and falls by a drogue."""

    def __init__(self, rate: float = 100.0) -> None:
        self.time = np.round(np.arange(-20.0, 60.0, 1 / rate), 3)
        lean, azimuth = np.radians(85.0), np.radians(60.0)
        nose = np.array([np.cos(lean) * np.cos(azimuth), np.cos(lean) * np.sin(azimuth), -np.sin(lean)])
        thrust = np.where((self.time >= 0) & (self.time < 3), 80.0, 0.0)
        flying = self.time >= 0
        gravity = np.where(flying[:, None], [0.0, 0.0, GRAVITY], 0.0)
        # Drag holds it at 30 m/s once it falls, as a drogue does, which drifts with the wind.
        wind = np.array([4.0, -3.0, 0.0])
        step, velocity, place = 1 / rate, np.zeros(3), np.zeros(3)
        self.velocity, self.place, acceleration = (np.empty((self.time.size, 3)) for _ in range(3))
        for at in range(self.time.size):
            drag = -0.0002 * np.linalg.norm(velocity) * velocity
            if velocity[2] > 0 and flying[at]:
                drag = -GRAVITY / 30**2 * np.linalg.norm(velocity - wind) * (velocity - wind)
            change = thrust[at] * nose + gravity[at] + (drag if flying[at] else 0)
            self.velocity[at], self.place[at], acceleration[at] = velocity, place, change
            place = place + velocity * step + 0.5 * change * step**2
            velocity = velocity + change * step
        self.roll_rate = np.where(flying, np.radians(90.0), 0.0)
        roll = np.cumsum(self.roll_rate) * step
        angles = np.column_stack((np.full(roll.size, azimuth), np.full(roll.size, lean), roll))
        attitude = Rotation.from_euler("ZYX", angles)
        self.force = attitude.inv().apply(acceleration - [0, 0, GRAVITY])

    @property
    def position(self) -> np.ndarray:
        """Latitude, longitude [°], height [m]."""
        latitude = np.degrees(NORTH + self.place[:, 0] / 6.36e6)
        longitude = np.degrees(EAST + self.place[:, 1] / (6.38e6 * np.cos(NORTH)))
        return np.column_stack((latitude, longitude, PAD - self.place[:, 2]))


@pytest.fixture(scope="module")
def rocket() -> Flight:
    return Flight()


def altos(flight: Flight) -> str:
    """Return a csv as AltosUI exports it (altoslib/AltosCSV.java, version 6): gps repeats its latest fix."""
    head = (
        "#version,serial,flight,call,time,state,state_name,acceleration,pressure,altitude,height,speed,temperature,"
        "drogue_voltage,main_voltage,battery_voltage,accel_x,accel_y,accel_z,gyro_roll,gyro_pitch,gyro_yaw,mag_x,"
        "mag_y,mag_z,tilt,connected,locked,nsat,latitude,longitude,altitude,year,month,day,hour,minute,second,"
        "pad_dist,pad_range,pad_az,pad_el,pdop,hdop,vdop"
    )
    lines, fix = [head], flight.position[0]
    for at, time in enumerate(flight.time.tolist()):
        if round(100 * time) % 20 == 0:
            fix = flight.position[at]
        x, y, z = flight.force[at]
        height = flight.position[at, 2]
        pressure = 101325 * (1 - height / 44330.77) ** 5.2559
        spin, speed = np.degrees(flight.roll_rate[at]), -flight.velocity[at, 2]
        lines.append(
            f"6, 2378, 4,KD7SQG, {time:8.2f}, 3,   boost,{x - GRAVITY:8.2f},{pressure:10.2f},"
            f"{height + 20:8.2f},{height - PAD:8.2f},{speed:8.2f}, 25.0, 3.70, 3.70, 4.10,"
            f"{x:7.2f},{y:7.2f},{-z:7.2f},{spin:7.2f},"
            "   0.00,   0.00,   0.10,   0.20,   0.30,   5.00, 1, 1, 12,"
            f"{fix[0]:12.7f},{fix[1]:12.7f},{fix[2]:8.1f}, 2024,  5, 18, 17, 30, 12,        0,        0,"
            "   0,   0,   1.6,   0.9,   1.3"
        )
    return "\n".join([*lines, ""])


def test_altos_knows_its_rocket_and_its_axes(rocket, tmp_path):
    (tmp_path / "flight.csv").write_text(altos(rocket))
    log = read_log([tmp_path / "flight.csv"])
    assert log.auxiliary.vehicle == "rocket"
    assert not log.auxiliary.forward_assumed
    rates, forces = log.rates
    kept = np.searchsorted(rocket.time, log.time[1:] + log.epoch - 1e-6)
    # Under the drogue, numbers of two decimals repeat, which counts as one sample held, or as a gap.
    measured = ~np.any([(log.time[1:] > start) & (log.time[:-1] < end) for start, end in log.gaps], axis=0)
    assert measured.mean() > 0.9
    np.testing.assert_allclose(forces[measured], rocket.force[kept][measured], atol=0.006)
    np.testing.assert_allclose(rates[:, 0], rocket.roll_rate[kept], atol=1e-3)
    # The second altitude is that of the GPS.
    assert np.nanmax(log.gnss.position[:, 2]) == pytest.approx(rocket.position[:, 2].max(), abs=1.0)
    assert log.gnss.time.size == pytest.approx(5 * 60, abs=12)
    said = " ".join(log.repairs)
    assert "altitude#2" in said
    assert "forward is x, right is y, down is z" in said


def test_the_flight_is_that_of_a_rocket(rocket, tmp_path):
    (tmp_path / "flight.csv").write_text(altos(rocket))
    flight = read_raw(tmp_path / "flight.csv")
    assert flight.vehicle == "rocket"
    assert flight.height.max() == pytest.approx(rocket.position[:, 2].max(), abs=1.0)


def test_a_simulated_rocket_has_its_velocity(rocket, tmp_path):
    """RocketPy writes x to the east, y to the north and z upwards, after a sign of a comment."""
    north, east, down = rocket.velocity.T
    place = rocket.position
    table = np.column_stack((rocket.time, place[:, 0], place[:, 1], place[:, 2], east, north, -down))
    head = "Time (s),Latitude (°),Longitude (°),Z (m),Vx (m/s),Vy (m/s),Vz (m/s)"
    np.savetxt(tmp_path / "flight.csv", table, fmt="%.6f", delimiter=",", header=head, encoding="utf-8")
    flight = read_raw(tmp_path / "flight.csv")
    assert flight.vehicle == "rocket"
    np.testing.assert_allclose(flight.velocity_n, rocket.velocity, atol=1e-5)
    np.testing.assert_allclose(flight.height, place[:, 2], atol=1e-5)
