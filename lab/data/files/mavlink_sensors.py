"""MAVLink sensors: messages of a receiver and an IMU in SI units, and the sensor log made of them.

References
----------
MAVLink, *Common Message Set*, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY, TO_SI
from lab.data.files.streams import FIX_3D, Stream, believed_lever_arm, geoid_height, gps_delay, is_position
from lab.data.files.tlog_file import Vehicle
from lab.data.log.sensor_log import SINCE_1970, GnssLog, believed_sigma

Messages = dict[str, FloatArray]

FIELDS = {
    "HEARTBEAT": ("type", "autopilot"),
    "SYSTEM_TIME": ("time_unix_usec", "time_boot_ms"),
    "GPS_RAW_INT": (
        "time_usec", "fix_type", "lat", "lon", "alt", "vel", "cog", "alt_ellipsoid", "h_acc", "v_acc",
        "vel_acc",
    ),
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw"),
    "ATTITUDE_QUATERNION": ("time_boot_ms", "q1", "q2", "q3", "q4"),
    "LOCAL_POSITION_NED": ("time_boot_ms", "vx", "vy", "vz"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "lat", "lon", "alt", "vx", "vy", "vz"),
}  # fmt: skip
"""Fields that are read of the messages of a navigation solution and of a receiver."""
_AXES = ("xgyro", "ygyro", "zgyro", "xacc", "yacc", "zacc")
IMUS = {
    "RAW_IMU": ("time_usec", "id", *_AXES),
    "SCALED_IMU": ("time_boot_ms", *_AXES),
    "HIGHRES_IMU": ("time_usec", "id", *_AXES),
}
"""Fields that are read of the messages of an IMU."""
_ARMS = (("GPS1_POS_", "INS_POS1_"), ("GPS_POS1_", "INS_POS1_"), ("EKF2_GPS_POS_", "EKF2_IMU_POS_"))
_DELAYS = ("GPS1_DELAY_MS", "GPS_DELAY_MS", "EKF2_GPS_DELAY")
PARAMETERS = frozenset(_DELAYS) | {f"{name}{axis}" for pair in _ARMS for name in pair for axis in "XYZ"}
"""Parameters of an autopilot that say where the antenna is and how late its fixes are."""
UNKNOWN_SPEED = 65_535
"""What stands for an unknown speed or course (of GPS_RAW_INT)."""
ONE_G = (0.5, 2.0)
"""Median specific force at which the numbers of an IMU are in the unit supposed [g]."""


def since_boot(vehicle: Vehicle, messages: Messages) -> FloatArray:
    """Return the time of messages since the autopilot was switched on [s]; NaN where it is not known."""
    if "time_boot_ms" in messages:
        return messages["time_boot_ms"] * 1e-3
    time = messages["time_usec"] * 1e-6
    of_day = time > SINCE_1970
    if of_day.any():
        # Either is allowed; the autopilot's own clock says how far they are apart.
        clock = vehicle.numbers("SYSTEM_TIME")
        known = (
            np.empty(0) if clock is None else clock["time_unix_usec"] * 1e-6 - clock["time_boot_ms"] * 1e-3
        )
        known = known[known > SINCE_1970]
        time[of_day] -= np.median(known) if known.size else np.nan
    return np.where(messages["time_usec"] > 0, time, np.nan)


def place_of(messages: Messages) -> FloatArray:
    """Return latitude, longitude [rad] and height above sea level [m], (n, 3), of messages (1e-7°, mm)."""
    angles = np.radians(1e-7 * np.column_stack((messages["lat"], messages["lon"])))
    return np.column_stack((angles, 1e-3 * messages["alt"]))


def fixed(gps: Messages) -> Flags:
    """Return which messages of GPS_RAW_INT have a three-dimensional fix."""
    return (gps["fix_type"] >= FIX_3D) & is_position(place_of(gps))


def geoid_of(vehicle: Vehicle) -> float | None:
    """Return the height of the geoid over the ellipsoid from the receiver [m]; None if it gives none."""
    gps = vehicle.numbers("GPS_RAW_INT")
    if gps is None:
        return None
    heights = 1e-3 * (gps["alt_ellipsoid"] - gps["alt"])[fixed(gps) & (gps["alt_ellipsoid"] != 0)]
    return geoid_height(heights)


def over_ground(gps: Messages) -> tuple[FloatArray, FloatArray]:
    """Return speed [m/s] and course [°]; NaN where they are not known."""
    return (
        np.where(gps["vel"] < UNKNOWN_SPEED, 1e-2 * gps["vel"], np.nan),
        np.where(gps["cog"] < UNKNOWN_SPEED, 1e-2 * gps["cog"], np.nan),
    )


def imu_of(vehicle: Vehicle) -> Stream | None:
    """Return angular rate [rad/s] and specific force [m/s²], from the message that is sent most often."""
    found = []
    for name, gyro, force in (
        ("HIGHRES_IMU", 1.0, 1.0),
        ("SCALED_IMU", 1e-3, TO_SI["mg"]),
        ("RAW_IMU", 1e-3, TO_SI["mg"]),
    ):
        messages = vehicle.numbers(name)
        if messages is None:
            continue
        values = np.column_stack([messages[key] for key in _AXES]) * np.repeat((gyro, force), 3)
        first = messages["id"] == messages["id"].min() if "id" in messages else None
        stream = Stream.of("IMU", since_boot(vehicle, messages), values, first)
        # Raw numbers may be counts of any size; those of ArduPilot are mrad/s and thousandths of g.
        size = float(np.median(np.linalg.norm(stream.values[:, 3:], axis=1))) if stream.usable else 0.0
        if ONE_G[0] < size / STANDARD_GRAVITY < ONE_G[1]:
            found.append(stream)
    return max(found, key=lambda one: len(one.time), default=None)


def gnss_of(vehicle: Vehicle, gps: Messages) -> GnssLog:
    """Return the fixes of GPS_RAW_INT; it has no vertical velocity."""
    time, place = since_boot(vehicle, gps), place_of(gps)
    place[:, 2] += geoid_of(vehicle) or 0.0
    speed, course = over_ground(gps)
    angle = np.radians(course)
    velocity = np.column_stack((speed * np.cos(angle), speed * np.sin(angle), np.full(len(time), np.nan)))
    level, vertical, rate = (believed_sigma(1e-3 * gps[name]) for name in ("h_acc", "v_acc", "vel_acc"))
    fine = fixed(gps) & np.isfinite(time)
    delay = max(vehicle.parameters.get(name, 0.0) for name in _DELAYS)
    return GnssLog(
        time=time[fine],
        position=place[fine],
        velocity_n=velocity[fine],
        position_sigma=np.column_stack((level, level, vertical))[fine],
        velocity_sigma=np.column_stack((rate, rate, rate))[fine],
        lever_arm=_lever_arm(vehicle.parameters),
        latency=gps_delay(1e-3 * delay),
    )


def _lever_arm(parameters: Mapping[str, float]) -> FloatArray:
    """Return the lever arm from the IMU to the antenna that the autopilot's parameters give [m]."""
    for antenna, imu in _ARMS:
        if any(f"{antenna}{axis}" in parameters for axis in "XYZ"):
            return believed_lever_arm(
                [
                    parameters.get(f"{antenna}{axis}", 0.0) - parameters.get(f"{imu}{axis}", 0.0)
                    for axis in "XYZ"
                ]
            )
    return np.zeros(3)
