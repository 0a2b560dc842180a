"""MAVLink telemetry log as a ground station writes it, frames by pymavlink: of vehicle and station.

The vehicle sends attitude and velocity 20 times a second, its position 10 times, its IMU 50 times in mrad/s
and thousandths of g or, as PX4 does, in SI; its GPS 5 times. All stamps of the vehicle are of its own clock.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from datetime import UTC, datetime

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from lab.missions import Recording
from lab.motion.frames.rotation import euler_from_quaternion
from writers.autopilot import GPS_DELAY, GPS_SIGMA, LEVER_ARM, sensed, solution

BOOT = 61_234
"""Time since boot at which the flight begins [ms]."""
START = datetime(2024, 5, 17, 23, 58, 30, tzinfo=UTC)
GEOID = -31.4
IMU_RATE = 50.0
GRAVITY = 9.80665
PARAMETERS = {
    "GPS1_DELAY_MS": 1000 * GPS_DELAY,
    "GPS1_POS_X": LEVER_ARM[0],
    "GPS1_POS_Y": LEVER_ARM[1],
    "GPS1_POS_Z": LEVER_ARM[2] + 0.125,
    "INS_POS1_Z": 0.125,
}


class Station:
    """Frames in the order of time, as a ground station receives them.

    Parameters
    ----------
    system, component
        Of the sender.
    """

    def __init__(self, system: int = 1, component: int = 1) -> None:
        self._link = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.frames: list[tuple[float, bytes]] = []

    def add(self, time: float, name: str, *values: object, v1: bool = False, **more: object) -> None:
        """Add a message that is sent at a time of the flight [s]."""
        encode: Callable = getattr(self._link, f"{name.lower()}_encode")
        self.frames.append((time, encode(*values, **more).pack(self._link, force_mavlink1=v1)))


def log(*stations: Station) -> bytes:
    """Return a file of what stations sent, each frame after its time of arrival."""
    frames = sorted((frame for station in stations for frame in station.frames), key=lambda one: one[0])
    begin = int(START.timestamp() * 1e6)
    # What arrives is late by some milliseconds.
    return b"".join(
        struct.pack(">Q", begin + round(1e6 * time) + 7000 + 1000 * (at % 5)) + frame
        for at, (time, frame) in enumerate(frames)
    )


def e7(radians: np.ndarray) -> list[int]:
    """Return angles in 1e-7°."""
    return np.rint(np.degrees(radians) * 1e7).astype(int).tolist()


def write(recording: Recording, imu: str = "RAW_IMU") -> bytes:
    """Return the log of a flight, with the messages of one kind of IMU."""
    vehicle, station = Station(), Station(255, 190)
    last = recording.duration
    for second in np.arange(0.0, last, 1.0).tolist():
        vehicle.add(second, "HEARTBEAT", 1, 3, 81, 10, 4)
        vehicle.add(
            second, "SYSTEM_TIME", int((START.timestamp() + second) * 1e6), BOOT + round(1e3 * second)
        )
        station.add(second + 0.5, "HEARTBEAT", 6, 8, 192, 0, 4, v1=True)
    for count, (name, value) in enumerate(PARAMETERS.items()):
        vehicle.add(0.0, "PARAM_VALUE", name.encode(), value, 9, len(PARAMETERS), count)
    known = solution(recording, 20.0)
    euler = euler_from_quaternion(known.q_nb)
    for t, angles, speed in zip(known.time.tolist(), euler.tolist(), known.velocity_n.tolist(), strict=True):
        vehicle.add(t, "ATTITUDE", BOOT + round(1e3 * t), *angles, 0.0, 0.0, 0.0)
        vehicle.add(t, "LOCAL_POSITION_NED", BOOT + round(1e3 * t), 0.0, 0.0, 0.0, *speed)
    known = solution(recording, 10.0)
    rows = zip(
        known.time.tolist(),
        e7(known.latitude),
        e7(known.longitude),
        known.height,
        known.velocity_n,
        strict=True,
    )
    for t, lat, lon, height, speed in rows:
        cm = np.rint(100 * speed).astype(int).tolist()
        alt = round(1e3 * (height - GEOID))
        vehicle.add(t, "GLOBAL_POSITION_INT", BOOT + round(1e3 * t), lat, lon, alt, 0, *cm, 65_535)
    _sense(vehicle, recording, imu)
    return log(vehicle, station)


def _sense(vehicle: Station, recording: Recording, imu: str) -> None:
    seen = sensed(recording, IMU_RATE)
    for t, rates in zip(seen.imu_time.tolist(), seen.rates, strict=True):
        boot = BOOT + 1e3 * t
        if imu == "HIGHRES_IMU":
            numbers = (*rates[3:], *rates[:3], *[0.0] * 7)
            vehicle.add(t, imu, round(1e3 * boot), *numbers, 0x3F)
            continue
        whole = np.rint(1e3 * np.concatenate((rates[3:] / GRAVITY, rates[:3]))).astype(int).tolist()
        stamp = round(1e3 * boot) if imu == "RAW_IMU" else round(boot)
        vehicle.add(t, imu, stamp, *whole, 0, 0, 0)
    north, east, _ = seen.gps_velocity.T
    speed, course = np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360
    place = seen.gps_position
    fixes = zip(
        seen.gps_time.tolist(), e7(place[:, 0]), e7(place[:, 1]), place[:, 2], speed, course, strict=True
    )
    for t, lat, lon, height, metres, degrees in fixes:
        alt = round(1e3 * (height - GEOID))
        numbers = (lat, lon, alt, 70, 110, round(100 * metres), round(100 * degrees) % 36_000, 14)
        sigma = [round(1e3 * one) for one in (GPS_SIGMA[0], GPS_SIGMA[0], GPS_SIGMA[1])]
        vehicle.add(
            t, "GPS_RAW_INT", round(1e3 * BOOT + 1e6 * t), 3, *numbers, alt_ellipsoid=round(1e3 * height),
            h_acc=sigma[0], v_acc=sigma[1], vel_acc=sigma[2],
        )  # fmt: skip
